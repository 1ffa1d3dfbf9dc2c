"""Reading of thrust curves from RASP files (``.eng``) and from tables of time and thrust."""

import contextlib
import math
import re
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

import numpy as np

from sepmc.formats.columns import Columns, Quantity, check_quantities, split_columns
from sepmc.formats.text_table import FormatError, TextTable, number, read_table, read_text
from sepmc.scene.messages import nearest, shorten

_TIME = Quantity("time", ("time", "t", "times", "burntime"))
_THRUST = Quantity("force", ("thrust", "force", "f", "fx", "thrustforce"))
_FRACTION = Quantity("", ("fraction", "level", "relative", "thrustfraction"))
_ASSUMED = ("time_s", "thrust_N")  # columns of a file without a header
_HEADER = 7  # fields of the first line of an engine
# in a comment: a file without a header may mean it as its unit
_OTHER_UNIT = re.compile(
    r"(?<![a-z])(kn|mn|lbf?|lbs|pounds?|kgf?|kp|gf?|grams?|ozf?|ms|msec|milliseconds?|minutes)"
    r"(?![a-z])",
    re.IGNORECASE,
)


@dataclass
class ThrustCurve:
    """Thrust over time since ignition, linear between the rows.

    Attributes
    ----------
    time : list of float
        s, rising strictly.
    thrust : list of float
        N, or fractions of the motor's ``thrust_N``.
    is_fraction : bool
        True if ``thrust`` has fractions.
    understood : list of str
        Sentences on what was read, for the user.
    """

    time: list[float]
    thrust: list[float]
    is_fraction: bool = False
    understood: list[str] = field(default_factory=list)

    @property
    def impulse(self) -> float:
        """Total impulse, N s; for fractions the integral of these, s."""
        return float(np.trapezoid(self.thrust, self.time))


def read_thrust(path: Path, options: dict[str, Any]) -> ThrustCurve:
    """Read a thrust curve from a file.

    Parameters
    ----------
    path : Path
        A RASP file ``.eng``, or a table in text or Parquet. Two columns without a header are taken
        as time in s and thrust in N; a comment with another unit is then an error.
    options : dict
        ``columns``: of a table, by quantity the title of a column or ``{ column, scale }``; or the
        list of all titles of one without a header. ``engine``: name or number, from 0, of one of
        several engines in a ``.eng``.

    Returns
    -------
    ThrustCurve

    Raises
    ------
    FormatError
        If the file cannot be read or has no valid curve, an engine must be chosen, or the option
        ``engine`` is that of none or of several.
    """
    if path.suffix.lower() == ".eng":
        return parse_eng(read_text(path), options.get("engine"))
    titles, by_name = split_columns(options.get("columns"))
    table = read_table(path, titles, assumed=_ASSUMED)
    time, fraction, thrust = _quantities(table, by_name)
    if table.header == "comment" and time is fraction is thrust is None:
        table = _without_header(table)
        time, fraction, thrust = _quantities(table, by_name)
    if time is None or (fraction is None) == (thrust is None):
        known = [f'"{title}"' for title in table.columns] or ['"TITLE"']
        raise FormatError(
            "needs a column of time and one of either thrust or fraction, not both, such as time_s "
            "and thrust_N; "
            f"has {', '.join(table.columns)}; name them with their units, such as "
            f"columns = {{ time_s = {known[0]}, thrust_N = {known[-1]} }}"
        )
    values = thrust if thrust is not None else fraction
    assert values is not None
    points = list(zip(time.tolist(), values.tolist(), strict=True))
    curve = _curve(points, [table.where(k) for k in range(len(points))])
    curve.is_fraction = thrust is None
    what = "fractions of thrust_N" if curve.is_fraction else "N"
    curve.understood.insert(0, f"{len(curve.time)} rows in {what}, linear between them")
    if table.header == "assumed":
        _check_comments(table)
        curve.understood.insert(
            0,
            "no header: taken as time in s and thrust in N, as RocketPy does; other units by "
            'columns = ["time_s", "thrust_lbf"]',
        )
    return curve


def _quantities(
    table: TextTable, named: dict[str, Any] | None
) -> tuple[np.ndarray | None, np.ndarray | None, np.ndarray | None]:
    """Columns of time (s), fraction and thrust (N) of a table, each (n,); None for those that it
    does not have. ``named`` and the FormatError raised are those of `Columns`."""
    columns = Columns(table, named)
    check_quantities(columns.named, ("time", "fraction", "thrust"), "quantity")
    return (
        columns.find("time", _TIME),
        columns.find("fraction", _FRACTION),
        columns.find("thrust", _THRUST),
    )


def _without_header(table: TextTable) -> TextTable:
    """Copy of a table of two columns whose names, which came from a comment, are replaced by
    ``time_s`` and ``thrust_N`` (its ``header`` is then "assumed"); a table of another number of
    columns is returned unchanged."""
    if len(table.columns) != len(_ASSUMED):
        return table
    columns = dict(zip(_ASSUMED, table.columns.values(), strict=True))
    return replace(table, columns=columns, header="assumed")


def _check_comments(table: TextTable) -> None:
    """Raise FormatError if a comment of a table without a header mentions a unit other than s and
    N, in which its columns may be."""
    for comment in table.comments:
        if unit := _OTHER_UNIT.search(comment):
            raise FormatError(
                f"has no header, and {unit[0]} in the comment {shorten(comment)}; give the units "
                'of its columns: columns = ["time_s", "thrust_N"] or others'
            )


def parse_eng(text: str, engine: Any = None) -> ThrustCurve:
    """Read the thrust curve of an engine from the text of a RASP file.

    The curve rises from (0, 0) to the first row, if that is later than 0 s; two rows at one time
    are a step, and of more rows the first and the last count; a time before that of the row above
    is an error. Comments begin with ``;``.

    Parameters
    ----------
    text : str
    engine : str or int, optional
        Name of the engine, or its number from 0; needed if the file has several.

    Returns
    -------
    ThrustCurve

    Raises
    ------
    FormatError
        If the text has no valid curve, an engine must be chosen, or ``engine`` is that of none or
        of several.
    """
    engines = _engines(text)
    names: list[Any] = [header[0] for _, header, _ in engines]
    if not engines:
        raise FormatError("has no engine, no line of name, diameter, length, delays and masses")
    if engine is None and len(engines) > 1:
        listed = ", ".join(map(str, names[:8]))
        raise FormatError(f'has {len(engines)} engines; choose one by engine = "NAME": {listed}')
    if isinstance(engine, int) and not isinstance(engine, bool) and 0 <= engine < len(engines):
        names[engine] = engine  # by its number
    elif names.count(engine) > 1:
        raise FormatError(f"has engine {shorten(engine)} twice; choose by engine = NUMBER, from 0")
    if engine is not None and engine not in names:
        raise FormatError(f"has no engine {shorten(engine)}; {nearest(str(engine), names)}")
    line, header, rows = engines[names.index(engine) if engine is not None else 0]
    if not rows:
        raise FormatError(f"line {line}: engine {header[0]} has no rows of time and thrust")
    points = [(t, f) for _, t, f in rows]
    lines = [f"line {n}" for n, _, _ in rows]
    understood = [
        f"engine {header[0]} of {header[6]}" if len(header) > 6 else f"engine {header[0]}"
    ]
    if points[0][0] > 0.0:
        points.insert(0, (0.0, 0.0))
        lines.insert(0, lines[0])
        understood.append(
            "the thrust rises from 0 at the ignition to the first row, as RASP means it"
        )
    curve = _curve(points, lines)
    peak = max(curve.thrust)
    understood.append(f"{len(curve.time)} rows, peak {peak:.6g} N, impulse {curve.impulse:.6g} N s")
    with contextlib.suppress(ValueError, IndexError):
        understood.append(
            f"its propellant, {number(header[4]):.6g} kg of {number(header[5]):.6g} kg, is taken "
            "from no body: masses are constant"
        )
    curve.understood = understood + curve.understood
    return curve


def _engines(text: str) -> list[tuple[int, list[str], list[tuple[int, float, float]]]]:
    """Parse a RASP file to its engines. Each is a triple: line number of its header, fields of the
    header, and rows (line number, time in s, thrust in N). Raises FormatError for other lines."""
    engines: list[tuple[int, list[str], list[tuple[int, float, float]]]] = []
    ended = True
    for n, line in enumerate(text.splitlines(), 1):
        cells = line.split(";")[0].split()
        if not cells:
            ended = ended or (line.strip().startswith(";") and bool(engines and engines[-1][2]))
            continue
        pair = _pair(cells)
        if pair is None:
            if not ended and engines[-1][2] and len(cells) < _HEADER - 1:
                raise FormatError(f"line {n}: {shorten(line.strip())} is no row of time and thrust")
            if len(cells) < _HEADER - 1:
                raise FormatError(
                    f"line {n}: {shorten(line.strip())} is no header: name, diameter, length, "
                    "delays, propellant mass, mass, manufacturer"
                )
            engines.append((n, cells, []))
            ended = False
        elif not engines:
            raise FormatError(f"line {n}: a row of time and thrust before the header of an engine")
        else:
            engines[-1][2].append((n, *pair))
    return engines


def _pair(cells: list[str]) -> tuple[float, float] | None:
    if len(cells) != 2:
        return None
    try:
        time, thrust = (number(cell) for cell in cells)
    except ValueError:
        return None
    return (time, thrust) if math.isfinite(time) and math.isfinite(thrust) else None


def _curve(points: list[tuple[float, float]], places: list[str]) -> ThrustCurve:
    """Thrust curve through points (time, thrust). Two points at one time are a step, whose second
    time is made greater by one unit in the last place; of more points at one time the first and the
    last count. Raises FormatError for fewer than two points and, with the text of ``places`` on
    where the point is in the file, if a time is negative or earlier than the one before it."""
    times: list[float] = []
    thrusts: list[float] = []
    steps = list[float]()
    for (time, thrust), where in zip(points, places, strict=True):
        if time < 0.0:
            raise FormatError(f"{where}: the time {time:g} s is before the ignition at 0 s")
        if times and steps and times[-1] == math.nextafter(time, math.inf) and steps[-1] == time:
            thrusts[-1] = thrust  # a third row at one time: the last counts
        elif times and time == times[-1]:
            steps.append(time)
            times.append(math.nextafter(time, math.inf))
            thrusts.append(thrust)
        elif times and time < times[-1]:
            raise FormatError(f"{where}: the time {time:g} s is before that of the row above")
        else:
            times.append(time)
            thrusts.append(thrust)
    if len(times) < 2:
        raise FormatError("has fewer than two rows of time and thrust")
    understood = []
    if negative := sum(thrust < 0.0 for thrust in thrusts):
        understood.append(f"the thrust is negative in {negative} rows, down to {min(thrusts):g} N")
    if steps:
        understood.append(
            f"a step at {', '.join(f'{t:g} s' for t in steps[:4])}: two rows at one time"
        )
    if thrusts[-1] != 0.0:
        understood.append(
            f"the thrust ends at {thrusts[-1]:g}, not 0, at {times[-1]:g} s: there is none after it"
        )
    return ThrustCurve(times, thrusts, False, understood)
