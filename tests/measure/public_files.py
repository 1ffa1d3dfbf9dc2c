"""Read files of the field that others wrote: read right, or refused with a reason.

    python tests/measure/public_files.py FOLDER

Every file below the folder is read by its ending: ``.eng`` as thrust curves (each engine; its
impulse against the trapezoid of the numbers of the file, from a parser of its own, to 1e-12),
``.csv`` and ``.txt`` as decks, air, wind or, by their name or title, thrust (its impulse too),
soundings of Wyoming and SPC by their titles (every level stands in a row of the file),
``for006.dat`` and ``.out`` as decks of DATCOM (CN and CA of a cell stand in a row of its alpha),
messages of CCSDS by their first lines (the state at every hundredth row; its height between those
above a sphere of the polar and of the equatorial radius), ``.dml`` as decks, ``.urdf``, ``.xml``
and ``.mjcf`` as masses (each link or body; mass, centre and the invariants of the tensor against
numbers read by another parser). Prints the count of each outcome, and every reason; ends with code
1 if one was read wrong or failed with a traceback. Nothing of such a folder belongs into this
repository.

Read so: all models of JSBSim-Team/jsbsim (``aircraft/*/*.xml``), Daniella1/urdf_files_dataset
(``*.urdf``) and Farama-Foundation/Gymnasium-Robotics (``*.xml``), messages of CS-SI/Orekit
(``src/test/resources/ccsds``) and bradsease/oem, examples of bjax/DAVE-ML-Schema (``*.dml``);
DATCOM outputs of arktools/pydatcom, arktools/aircraft-datcom, lkampoli/DATCOM,
shohei/roll_analysis_6dof, AbiyyuMufti/ssm_gazebo, bartkiewiczjacob/OpenPost and
bermejus/Codigo_TFG_MATLAB; soundings of tjlang/SkewT, sharppy/SHARPpy, cwebster2/pyMeteo and
rnleach/sounding-analysis; tables of RocketPy-Team/RocketPy and RocketSerializer,
cuspaceflight/CamPyRoS and ISSUIUC/TARS-Controls.
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
from sepmc.formats.datcom_pages import parse_cases
from sepmc.formats.daveml import read_daveml
from sepmc.formats.decks import read_deck
from sepmc.formats.mass import read_mass
from sepmc.formats.soundings import read_air, read_wind
from sepmc.formats.text_table import FormatError, read_text
from sepmc.formats.thrust import _engines, parse_eng, read_thrust


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


def check_thrust(file: Path) -> list[str]:
    """Outcome of a table of thrust, by its impulse."""
    try:
        curve = read_thrust(file, {})
    except FormatError as error:
        return [f"refused: {error}"]
    numbers = re.compile(r"^[\s\d.eE+;,-]+$")
    lines = [line for line in read_text(file).splitlines() if numbers.match(line) and line.strip()]
    t, f = np.array([re.split(r"[;,\s]+", line.strip())[:2] for line in lines], dtype=float).T
    impulse = float((np.diff(t) * (f[1:] + f[:-1]) / 2.0).sum())
    return ["read" if abs(curve.impulse - impulse) <= 1e-12 * abs(impulse) else
            f"WRONG: impulse {curve.impulse!r}, trapezoid {impulse!r}"]  # fmt: skip


def _number_rows(text: str) -> list[list[float]]:
    """Numbers of every line that has only such, separated by blanks or commas."""
    rows = []
    for line in text.splitlines():
        try:
            rows.append([float(cell) for cell in line.replace(",", " ").split()])
        except ValueError:
            continue
    return rows


def check_datcom(file: Path) -> list[str]:
    """Outcomes of the cases of an output of DATCOM: CN and CA of each cell stand in a row of their
    alpha."""
    text = read_text(file)
    return [_check_case(text, case) for case in parse_cases(text)] or ["refused: has no case"]


def _check_case(text: str, case: int) -> str:
    """Outcome of a case of an output of DATCOM."""
    try:
        tree, _ = parse_datcom(text, {"case": case})
    except FormatError as error:
        return f"refused: {error}"
    rows = {
        (row[0], x) for row in _number_rows(re.sub(r"NDM|\bNA\b|\*+", "", text)) if row for x in row
    }
    for name in ("normal", "axial"):
        values = np.array(tree[name])
        for i, alpha in enumerate(tree["alpha_deg"]):
            middle = tree.get("beta_deg", [0.0]).index(0.0)
            for x in values[:, i].reshape(len(values), -1)[:, middle]:
                if (alpha, x) not in rows and (alpha, round(x, 12)) not in rows:
                    return f"WRONG: no row of alpha {alpha} has {name} {x}"
    return "read as DATCOM"


def check_sounding(file: Path, text: str) -> list[str]:
    """Outcome of a sounding: each level of the air and of the wind stands in a row of the file."""
    try:
        (air, _), (wind, _) = read_air(file, {}), read_wind(file, {})
    except FormatError as error:
        return [f"refused: {error}"]
    rows = [set(row) for row in _number_rows(text.replace("<PRE>", ""))]
    for levels, scales, offsets in (
        (zip(air["geopotential_m"], air["pressure_Pa"], air["temperature_K"], strict=True),
         (1.0, 0.01, 1.0), (0.0, 0.0, -273.15)),
        (zip(wind["geopotential_m"], wind["from_deg"], wind["speed_m_s"], strict=True),
         (1.0, 1.0, 3600.0 / 1852.0), (0.0, 0.0, 0.0)),
    ):  # fmt: skip
        for level in levels:
            own = {round(x * k + d, 6) for x, k, d in zip(level, scales, offsets, strict=True)}
            if not any(own <= row for row in rows):
                return [f"WRONG: no row has {own}"]
    return ["read as sounding"]


def check_table(file: Path) -> list[str]:
    """Outcome of a table: the first kind that reads it."""
    try:
        if is_datcom(file):
            return check_datcom(file)
        text = read_text(file)
    except FormatError as error:
        return [f"refused: {error}"]
    if re.search(r"HGHT\s+TEMP\s+DWPT", text):
        return check_sounding(file, text)
    if re.search("thrust|motor", file.name, re.IGNORECASE) or "Thrust" in text[:200]:
        return check_thrust(file)
    reasons = []
    for reader in (read_deck, read_air, read_wind):
        try:
            reader(file, {})
        except FormatError as error:
            reasons.append(str(error))
        else:
            return [f"read as {reader.__name__.removeprefix('read_')}"]
    return [f"refused: {reasons[0]}" if len(set(reasons)) == 1 else f"refused: {reasons}"]


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
    first = file.read_bytes()[:4000]
    if match := re.match(rb"(?:\xef\xbb\xbf)?\s*CCSDS_(OEM|AEM)_VERS", first) or re.search(
        rb"<(oem|aem)[\s>]", first
    ):
        return lambda path: check_message(path, match[1].decode().upper())
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
