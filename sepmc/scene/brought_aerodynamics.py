"""Conversion of aerodynamic data in other conventions: signs of DATCOM, slopes per degree, halves
of symmetric tables.

In every function ``key_path`` is the TOML path of the table that it gets, for messages.
"""

import math
from typing import Any

import numpy as np

from sepmc.scene.messages import Problems
from sepmc.scene.model import COEFFICIENTS, DERIVATIVES, RATES
from sepmc.scene.terms import signal_of
from sepmc.scene.units import UNITS, are_numbers, is_number, split_unit

_PER_DEGREE = 180.0 / math.pi
# coefficients that change their sign in the mirror image of a flow, by the angle that does
_ODD = {"alpha": ("normal", "pitch", "roll"), "beta": ("side", "yaw", "roll")}
_ODD_RATES = {"alpha": ("q", "p"), "beta": ("p", "r")}
_LATERAL = ("roll", "yaw")  # moments that decks divide by the span
_ZERO = 1e-9  # of the largest magnitude: an odd coefficient at zero


def convert_aerodynamics(key_path: str, aero: dict[str, Any], problems: Problems) -> list[str]:
    """Convert the aerodynamics of a body, in place, to the conventions of CONVENTIONS.md, and
    remove the keys that name other ones: ``convention``, ``per``, ``table.mirror`` and
    ``lateral_length_*``.

    Parameters
    ----------
    key_path : str
        TOML path of the aerodynamics.
    aero : dict
        Table [body.NAME.aerodynamics], changed in place.
    problems : Problems
        Receives every problem.

    Returns
    -------
    list of str
        A sentence for each conversion, and for each axis of a table that has one row.
    """
    understood: list[str] = []
    table = aero.get("table") if isinstance(aero.get("table"), dict) else None
    if table is not None:
        if (mirror := table.pop("mirror", None)) is not None:
            understood += _mirror(f"{key_path}.table", table, mirror, problems)
        understood += _single_rows(f"{key_path}.table", table)
    if _option(key_path, aero, "per", ("rad", "deg"), problems) == "deg":
        for key in COEFFICIENTS:
            if isinstance(terms := aero.get(key), dict):
                aero[key] = {term: _scaled(x, _PER_DEGREE ** _degree(term)) for term, x in
                             terms.items()}  # fmt: skip
        understood.append(
            f"{key_path}: slopes of the polynomials taken per degree, times 57.2958 each"
        )
        for key in DERIVATIVES:
            if table is not None and key in table:
                table[key] = _scaled(table[key], _PER_DEGREE)
                understood.append(f"{key_path}.table.{key} taken per degree, times 57.2958")
    understood += _lateral_length(key_path, aero, table, problems)
    if _option(key_path, aero, "convention", ("sepmc", "datcom"), problems) == "datcom":
        for tree in (aero, table or {}):
            for key in ("side", "side_p", "side_r"):
                if key in tree:
                    tree[key] = _scaled(tree[key], -1.0)
        understood.append(
            f"{key_path}: C_Y taken as DATCOM's (positive to the right), sign turned; C_l, C_m, "
            "C_n, C_N and C_A have the same signs there"
        )
    return understood


def _option(
    key_path: str, tree: dict[str, Any], key: str, allowed: tuple[str, ...], problems: Problems
) -> Any:
    """Remove the key ``key`` from ``tree`` and return its value, or the first of ``allowed`` if it
    is not set. A value that is not allowed is returned too, after adding a problem."""
    value = tree.pop(key, allowed[0])
    if value not in allowed:
        problems.add(f"{key_path}.{key}", f"must be one of {', '.join(allowed)}", value)
    return value


def _lateral_length(
    key_path: str, aero: dict[str, Any], table: dict[str, Any] | None, problems: Problems
) -> list[str]:
    """Convert coefficients that are made dimensionless by a lateral length (the span) to the
    reference length, in place: rolling and yawing moments, and derivatives by p and r. Works on
    the polynomials in ``aero`` and on its aerodynamic ``table`` (None: it has none). Removes the
    key of the lateral length from ``aero``; returns one sentence, or none if there is no such key
    or it is not valid, which adds a problem."""
    key = next((k for k in aero if split_unit(k)[0] == "lateral_length"), None)
    if key is None:
        return []
    value, unit = aero.pop(key), split_unit(key)[1]
    known = next((k for k in aero if split_unit(k)[0] == "reference_length"), None)
    lengths = UNITS["length"]
    if not _positive(value) or unit not in lengths or known is None:
        reason = "must be a length > 0 with a unit, as lateral_length_m, beside reference_length_m"
        problems.add(f"{key_path}.{key}", reason, value)
        return []
    length = aero[known]
    if not _positive(length) or split_unit(known)[1] not in lengths:
        return []  # noted by the model
    ratio = value * lengths[unit] / (length * lengths[split_unit(known)[1]])
    for tree in (aero, table or {}):
        for name in (*COEFFICIENTS, *DERIVATIVES):
            coefficient, _, rate = name.partition("_")
            if name not in tree:
                continue
            power = (coefficient in _LATERAL) + (rate in ("p", "r"))
            if isinstance(tree[name], dict):
                tree[name] = {
                    term: _scaled(x, ratio ** (power + _is_lateral_rate(term)))
                    for term, x in tree[name].items()
                }
            elif power:
                tree[name] = _scaled(tree[name], ratio**power)
    return [
        f"{key_path}: C_l, C_n and the rates p, r referred to {key} = {value:g}, times {ratio:.6g}"
    ]


def _mirror(key_path: str, table: dict[str, Any], mirror: Any, problems: Problems) -> list[str]:
    """Extend a table whose axis ``mirror`` (alpha or beta) begins at zero by its mirror image at
    negative angles, in place: odd coefficients change their sign there, even ones do not. Returns
    one sentence; none, after adding a problem, if the axis cannot be mirrored. An odd coefficient
    that is not 0 at angle 0 adds a problem too; its grid is then not extended."""
    if mirror not in _ODD:
        problems.add(f"{key_path}.mirror", 'must be "alpha" or "beta"', mirror)
        return []
    axes = [(split_unit(key)[0], key) for key in table]
    order = [key for name in ("mach", "alpha", "beta") for stem, key in axes if stem == name]
    key = next((each for each in order if split_unit(each)[0] == mirror), None)
    rows = table.get(key or "")
    if not (isinstance(rows, list) and rows and all(map(is_number, rows))):
        reason = f"needs the axis {mirror}_deg in this table, a list of numbers"
        problems.add(f"{key_path}.mirror", reason, mirror)
        return []
    if rows[0] != 0.0:
        problems.add(f"{key_path}.{key}", "must begin at 0, as mirror adds its negatives", rows)
        return []
    assert key is not None
    number = order.index(key)
    for name in (*COEFFICIENTS, *DERIVATIVES):
        if name not in table or not are_numbers(table[name]):
            continue  # the latter is noted by the model
        try:
            grid = np.array(table[name], dtype=float)
            grid = np.moveaxis(grid, number, 0)
        except ValueError:
            continue  # noted by the model
        if len(grid) != len(rows):
            continue
        coefficient, _, rate = name.partition("_")
        odd = (coefficient in _ODD[mirror]) != (rate in _ODD_RATES[mirror] and bool(rate))
        if odd and np.abs(grid[0]).max() > _ZERO * np.abs(grid).max():
            problems.add(
                f"{key_path}.{name}",
                f"is not 0 at {mirror} = 0, but must be: its mirror image has the opposite sign",
            )
            continue
        image = (-1.0 if odd else 1.0) * grid[:0:-1]
        table[name] = np.moveaxis(np.concatenate([image, grid]) + 0.0, 0, number).tolist()
    table[key] = [-x for x in rows[:0:-1]] + rows
    turned = ", ".join(f"C_{short}" for short in ("N, C_m, C_l" if mirror == "alpha" else
                                                  "Y, C_n, C_l").split(", C_"))  # fmt: skip
    return [f"{key_path}: mirrored in {mirror}; {turned} change their signs, the others do not"]


def _single_rows(key_path: str, table: dict[str, Any]) -> list[str]:
    """Return a sentence for each of the axes mach, alpha, beta with a single row, on which the
    table does not depend. The table is not changed."""
    understood = []
    for key, rows in table.items():
        name = split_unit(key)[0]
        single = isinstance(rows, list) and len(rows) == 1
        if name in ("mach", "alpha", "beta") and single:
            understood.append(f"{key_path}: one row of {name} ({rows[0]}): used at all {name}")
    return understood


def _degree(term: str) -> int:
    """Number of factors of a term that are angles or rates, counted with their powers: 3 for
    ``alpha2_q``. 0 for the constant and for a signal."""
    total = 0
    if signal_of(term):
        return total
    for factor in term.split("_"):
        for angle in ("alpha", "beta"):
            if factor.startswith(angle):
                power = factor.removeprefix(angle)
                total += int(power) if power.isdigit() else 1
        total += factor in RATES
    return total


def _is_lateral_rate(term: str) -> bool:
    """True if the last factor of a term of a polynomial is the rate p or r, as in ``alpha2_p``;
    False for the name of a signal."""
    return not signal_of(term) and term.rsplit("_", maxsplit=1)[-1] in ("p", "r")


def _scaled(value: Any, factor: float) -> Any:
    """Copy of a TOML value in which all numbers, also those in nested lists and tables, are
    multiplied by a factor; other values are unchanged."""
    if isinstance(value, bool):
        return value
    if isinstance(value, int | float):
        return value * factor + 0.0
    if isinstance(value, list):
        return [_scaled(item, factor) for item in value]
    if isinstance(value, dict):
        return {key: _scaled(item, factor) for key, item in value.items()}
    return value


def _positive(value: Any) -> bool:
    return is_number(value) and value > 0.0
