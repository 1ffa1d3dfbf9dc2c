"""Read files of the field that others wrote: read right, or refused with a reason.

    python tests/measure/public_files.py FOLDER

Every file below the folder is read by its ending: ``.eng`` as thrust curves (each engine; its
impulse against the trapezoid of the numbers of the file, from a parser of its own, to 1e-12),
``.csv`` and ``.txt`` as decks, air or wind, ``for006.dat`` and ``.out`` as decks of DATCOM,
messages of CCSDS by their first line (the state at every hundredth row; its height between those
above a sphere of the polar and of the equatorial radius), ``.dml`` as decks, ``.urdf``, ``.xml``
and ``.mjcf`` as masses (each link or body; mass, centre and the invariants of the tensor against
numbers read by another parser). Prints the count of each outcome, and every reason; ends with code
1 if one was read wrong or failed with a traceback. Nothing of such a folder belongs into this
repository.

Read so: all models of JSBSim-Team/jsbsim (``aircraft/*/*.xml``), Daniella1/urdf_files_dataset
(``*.urdf``) and Farama-Foundation/Gymnasium-Robotics (``*.xml``), messages of CS-SI/Orekit
(``src/test/resources/ccsds``) and bradsease/oem, examples of bjax/DAVE-ML-Schema (``*.dml``).
"""

import re
import sys
from collections import Counter
from datetime import datetime, timedelta
from pathlib import Path
from xml.etree import ElementTree

import numpy as np

from sepmc.formats.ccsds import read_initial
from sepmc.formats.ccsds_messages import parse_message
from sepmc.formats.datcom import is_datcom, parse_datcom
from sepmc.formats.daveml import read_daveml
from sepmc.formats.decks import read_deck
from sepmc.formats.mass import read_mass
from sepmc.formats.soundings import read_air, read_wind
from sepmc.formats.text_table import FormatError, read_text
from sepmc.formats.thrust import _engines, parse_eng


def plain_impulses(text: str) -> list[float]:
    """Impulse of each engine of a RASP file, N s: rows of two numbers between other lines."""
    impulses, rows = [], []

    def end() -> None:
        if rows:
            points = np.array([(0.0, 0.0), *rows] if rows[0][0] > 0.0 else rows)
            t, f = points.T
            impulses.append(float((np.diff(t) * (f[1:] + f[:-1]) / 2.0).sum()))
        rows.clear()

    for line in text.splitlines():
        cells = line.split(";")[0].split()
        try:
            time, thrust = map(float, cells)
        except ValueError:
            if cells:
                end()
            continue
        rows.append((time, thrust))
    end()
    return impulses


def check_curves(file: Path) -> list[str]:
    """Outcomes of the engines of a file."""
    try:
        text = read_text(file)
        count = len(_engines(text))
        expected = plain_impulses(text)
    except FormatError as error:
        return [f"refused: {error}"]
    outcomes = []
    for number in range(count or 1):
        try:
            curve = parse_eng(text, number)
        except FormatError as error:
            outcomes.append(f"refused: {error}")
            continue
        if len(expected) != count:
            outcomes.append(f"WRONG: {count} engines, {len(expected)} runs of rows")
        elif abs(curve.impulse - expected[number]) > 1e-12 * abs(expected[number]):
            outcomes.append(f"WRONG: impulse {curve.impulse!r}, trapezoid {expected[number]!r}")
        else:
            outcomes.append("read")
    return outcomes


def check_table(file: Path) -> list[str]:
    """Outcome of a table: the first kind that reads it."""
    reasons = []
    if is_datcom(file):
        try:
            parse_datcom(read_text(file), {"case": 1})
        except FormatError as error:
            return [f"refused: {error}"]
        return ["read as DATCOM"]
    for reader in (read_deck, read_air, read_wind):
        try:
            reader(file, {})
        except FormatError as error:
            reasons.append(str(error))
        else:
            return [f"read as {reader.__name__.removeprefix('read_')}"]
    return [f"refused: {reasons[0]}"]


def check_message(file: Path, kind: str) -> list[str]:
    """Outcome of a message of CCSDS, by its states at some rows."""
    try:
        _, segments = parse_message(read_text(file), kind)
    except FormatError as error:
        return [f"refused: {error}"]
    if kind == "AEM":
        return ["read as AEM"]
    for segment in segments:
        for k in range(0, len(segment.rows), 100):
            epoch = datetime(1, 1, 1) + timedelta(seconds=segment.epochs[k] - 86400.0)
            try:
                keys, _ = read_initial(file, {"epoch": epoch.isoformat(), "azimuth_deg": 0.0})
            except FormatError as error:
                return [f"refused: {error}"]
            distance = 1e3 * float(np.linalg.norm(segment.rows[k][:3]))
            if not -1.0 < distance - keys["altitude_m"] - 6356752.3 < 21386.0:
                return [f"WRONG: height {keys['altitude_m']} at a distance of {distance}"]
    return ["read as OEM"]


def check_model(file: Path) -> list[str]:
    """Outcome of a model of DAVE-ML."""
    try:
        read_daveml(file, {})
    except FormatError as error:
        return [f"refused: {error}"]
    return ["read as DAVE-ML"]


def _numbers_of(inertial):
    """Mass, centre and entries of the tensor, but for turns, of an inertial of URDF or MJCF."""
    if inertial.find("mass") is None:
        full = inertial.get("fullinertia", inertial.get("diaginertia", "")).split()
        entries = [float(x) for x in full] + [0.0] * (6 - len(full))
        return float(inertial.get("mass")), map(float, inertial.get("pos").split()), entries
    numbers = {k: float(v) for k, v in inertial.find("inertia").attrib.items()}
    origin = inertial.find("origin")
    text = "0 0 0" if origin is None else origin.get("xyz", "0 0 0")
    entries = [numbers.get(k, 0.0) for k in ("ixx", "iyy", "izz", "ixy", "ixz", "iyz")]
    return float(inertial.find("mass").get("value")), map(float, text.split()), entries


def check_masses(file: Path) -> list[str]:
    """Outcomes of the links or bodies of a model."""
    try:
        root = ElementTree.parse(file).getroot()
    except ElementTree.ParseError:
        root = ElementTree.Element("none")
    tag = {"robot": "link", "mujoco": "body"}.get(root.tag, "")
    named = [each for each in root.iter(tag) if each.find("inertial") is not None] if tag else []
    outcomes = []
    for element in named or [None]:
        name = None if element is None else element.get("name")
        axes = {} if root.tag == "fdm_config" else {"axes": "forward-up-right"}
        try:
            keys, _ = read_mass(file, axes | ({"link": name} if name else {}))
        except FormatError as error:
            outcomes.append(f"refused: {error}")
            continue
        if not tag:
            outcomes.append(f"read as {root.tag}")
            continue
        mass, (x, y, z), (xx, yy, zz, xy, xz, yz) = _numbers_of(element.find("inertial"))
        invariants = (
            xx + yy + zz,
            xx * yy + yy * zz + zz * xx - xy**2 - xz**2 - yz**2,
            xx * yy * zz + 2 * xy * xz * yz - xx * yz**2 - yy * xz**2 - zz * xy**2,
        )
        own = np.poly(np.array(keys["inertia_tensor_kg_m2"]))[1:] * (-1, 1, -1)
        same = (
            np.allclose(own, invariants, rtol=1e-6, atol=1e-9 * max(map(abs, invariants)))
            and keys["mass_kg"] == mass
            and np.allclose(keys["cg_m"], [-x, y, z], rtol=0, atol=1e-12)
        )
        outcomes.append(f"read as {tag}" if same else f"WRONG: {name}: {keys}")
    return outcomes


def check_of(file: Path):
    """The check of a file, by its ending and its first line."""
    if match := re.match(rb"(?:\xef\xbb\xbf)?\s*CCSDS_(OEM|AEM)_VERS", file.read_bytes()[:200]):
        return lambda path: check_message(path, match[1].decode())
    endings = {".eng": check_curves, ".dml": check_model}
    endings |= dict.fromkeys((".urdf", ".xml", ".mjcf"), check_masses)
    return endings.get(file.suffix.lower(), check_table)


def main(folder: Path) -> int:
    """Read all files; return the exit code."""
    outcomes, wrong = Counter(), 0
    for file in sorted(p for p in folder.rglob("*") if p.is_file()):
        try:
            results = check_of(file)(file)
        except Exception as error:  # what this program looks for
            results = [f"WRONG: traceback: {error!r}"]
        for outcome in results:
            outcomes[f"{file.suffix.lower()}: {outcome.partition(':')[0]}"] += 1
            wrong += outcome.startswith("WRONG")
            if not outcome.startswith("read"):
                print(f"{file.relative_to(folder)}: {outcome}")
    for outcome, count in sorted(outcomes.items()):
        print(f"{count:6d}  {outcome}")
    return int(wrong > 0)


if __name__ == "__main__":
    sys.exit(main(Path(sys.argv[1])))
