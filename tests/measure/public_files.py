"""Read files of the field that others wrote: read right, or refused with a reason.

    python tests/measure/public_files.py FOLDER

Every file below the folder is read by its ending: ``.eng`` as thrust curves (each engine; its
impulse against the trapezoid of the numbers of the file, from a parser of its own, to 1e-12),
``.csv`` and ``.txt`` as decks, air or wind, ``for006.dat`` and ``.out`` as decks of DATCOM. Prints
the count of each outcome, and every reason; ends with code 1 if one was read wrong or failed with a
traceback. Nothing of such a folder belongs into this repository.
"""

import sys
from collections import Counter
from pathlib import Path

import numpy as np

from sepmc.formats.datcom import is_datcom, parse_datcom
from sepmc.formats.decks import read_deck
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


def main(folder: Path) -> int:
    """Read all files; return the exit code."""
    outcomes, wrong = Counter(), 0
    for file in sorted(p for p in folder.rglob("*") if p.is_file()):
        check = {".eng": check_curves}.get(file.suffix.lower(), check_table)
        try:
            found = check(file)
        except Exception as error:  # what this program looks for
            found = [f"WRONG: traceback: {error!r}"]
        for outcome in found:
            outcomes[f"{file.suffix.lower()}: {outcome.partition(':')[0]}"] += 1
            wrong += outcome.startswith("WRONG")
            if not outcome.startswith("read"):
                print(f"{file.relative_to(folder)}: {outcome}")
    for outcome, count in sorted(outcomes.items()):
        print(f"{count:6d}  {outcome}")
    return int(wrong > 0)


if __name__ == "__main__":
    sys.exit(main(Path(sys.argv[1])))
