"""Reading of the output of Digital DATCOM and Missile DATCOM (``for006.dat``): static coefficients
and derivatives over Mach number and alpha.

Both print C_Y positive to the right, moments about their moment centre, C_l and C_n divided by the
lateral length, and derivatives by reduced rates such as q L / (2 V).
"""

import math
import re
from dataclasses import dataclass
from decimal import Decimal, InvalidOperation
from pathlib import Path
from typing import Any

import numpy as np

from sepmc.formats.datcom_pages import (
    BY_ALPHA_RATE,
    BY_BETA,
    BY_RATE,
    STATIC,
    Block,
    Output,
    choose_case,
    choose_output,
    parse_cases,
)
from sepmc.formats.text_table import FormatError, number, read_text
from sepmc.scene.model import COEFFICIENTS, DERIVATIVES
from sepmc.scene.units import UNITS, is_number, split_unit

_SIDESLIP = 30.0  # deg, to which slopes by beta are continued


def is_datcom(path: Path) -> bool:
    """True if a file ends in .dat, .out or .txt and its text looks like an output of DATCOM. Files
    with other endings are not read. Raises FormatError if the file cannot be read."""
    if path.suffix.lower() not in (".dat", ".out", ".txt"):
        return False
    text = read_text(path)
    return "DATCOM" in text[:20_000].upper() or "REFERENCE DIMENSIONS" in text


def read_datcom(
    path: Path, options: dict[str, Any], aero: dict[str, Any]
) -> tuple[dict[str, Any], list[str]]:
    """Read an aerodynamic table from an output of DATCOM and convert it to the conventions of
    CONVENTIONS.md.

    Parameters
    ----------
    path : Path
    options : dict
        See `parse_datcom`.
    aero : dict
        Table [body.NAME.aerodynamics] of the campaign, in whose conventions the result is; it is
        not changed. Its reference area and length must be those of the file within 2 %; one that
        either of them does not give is not compared.

    Returns
    -------
    table : dict
        Keys of ``[body.NAME.aerodynamics.table]``.
    understood : list of str
        Sentences on what was read, for the user.

    Raises
    ------
    FormatError
        With the reason why the file is rejected.
    """
    text = read_text(path)
    output, sideslip = _chosen(text, options)
    table, understood = _table(output, sideslip)
    if aero.get("per") == "deg":
        raise FormatError(
            'states itself which slopes are per degree: leave per = "deg" out of '
            "[body.NAME.aerodynamics]"
        )
    if aero.get("convention") != "datcom":  # else its sign is turned with the polynomials
        for key in ("side", "side_p", "side_r"):
            if key in table:
                table[key] = (0.0 - np.array(table[key])).tolist()
        understood.append("C_Y taken as DATCOM's, sign turned")
    references = _references(text, output)
    _compare(references, aero)
    understood += _moment_point(text, output, aero)
    if {"lref", "latref"} <= references.keys() and not any(
        key.startswith("lateral_length") for key in aero
    ):
        ratio = _ratio(references["latref"], references["lref"])
        for key in (*COEFFICIENTS, *DERIVATIVES):
            coefficient, _, rate = key.partition("_")
            power = (coefficient in ("roll", "yaw")) + (rate in ("p", "r"))
            if key in table and power and ratio != 1.0:
                table[key] = (ratio**power * np.array(table[key])).tolist()
        if ratio != 1.0:
            understood.append(
                f"C_l, C_n and the rates p, r times {ratio:.6g}, lateral over reference length"
            )
    return table, understood


_CARD = re.compile(
    r"\b(SREF|LREF|CBARR|LATREF|BLREF)\s*=\s*(\d+\.?\d*(?:E[+-]?\d{1,3})?)", re.IGNORECASE
)
_CARD_NAMES = {"SREF": "sref", "LREF": "lref", "CBARR": "lref", "LATREF": "latref",
               "BLREF": "latref"}  # fmt: skip
_DIM = re.compile(r"^\s*(?:\d+\s+)?DIM\s+(M|CM|FT|IN)\b", re.MULTILINE | re.IGNORECASE)
_METRES = {"M": 1.0, "CM": 0.01, "FT": 0.3048, "IN": 0.0254}
_PRINTED = {"REF AREA": "sref", "REF LENGTH": "lref", "LAT REF LENGTH": "latref"}
_OTHER_POINT = 2e-3  # m between moment centres that are not the same
_OTHER = 0.02  # relative difference of reference quantities that are not the same


@dataclass(frozen=True)
class _Reference:
    """Reference quantity, ``value`` in m or m2, and its ``rounding``: half a unit in the last place
    that is printed, 0 if the value is exact."""

    value: float
    rounding: float = 0.0


def _references(text: str, output: Output) -> dict[str, _Reference]:
    """Reference quantities of a case, in m2 and m, by name: "sref", "lref", "latref"; one that the
    file does not have is left out.

    The number that the case prints counts, with its rounding; but a number of an input card in
    ``text`` counts, as exact, if it equals the printed one within the rounding, or if nothing is
    printed (then that of the last card). A quantity printed as text, such as NA, is left out."""
    metre = _metres_per_unit(text)
    cards: dict[str, list[float]] = {}
    for match in _CARD.finditer(text):
        name, value = _CARD_NAMES[match[1].upper()], number(match[2])
        if value > 0.0:
            cards.setdefault(name, []).append(value * metre ** (2 if name == "sref" else 1))
    references = {name: _Reference(values[-1]) for name, values in cards.items()}
    for title, name in _PRINTED.items():
        digits, _, unit = output.references.get(title, "").partition(" ")
        factor = _METRES.get(unit.partition("**")[0].upper(), metre) ** (2 if name == "sref" else 1)
        try:
            printed = Decimal(digits)
        except InvalidOperation:
            if title in output.references:  # such as NA: cards are those of another case
                references.pop(name, None)
            continue
        if not printed.is_finite() or not 0.0 < float(printed) < 1e30:
            continue
        value = float(printed) * factor
        rounding = 0.5000001 * factor * 10.0 ** int(printed.as_tuple().exponent)
        exact = [each for each in cards.get(name, ()) if abs(each - value) <= rounding]
        references[name] = _Reference(exact[-1]) if exact else _Reference(value, rounding)
    return references


def _metres_per_unit(text: str) -> float:
    """Length in metres of the unit that a card DIM in the text names; that of a foot without such a
    card."""
    dim = _DIM.search(text)
    return _METRES[dim[1].upper() if dim else "FT"]


def _moment_point(text: str, output: Output, aero: dict[str, Any]) -> list[str]:
    """Return a list with a sentence if the moment centre that a case prints and ``moment_point`` of
    the aerodynamics differ, or there is no ``moment_point``; else an empty list, also if no moment
    centre is printed or one of the two cannot be read. Only stations are compared; they may begin
    at different points, so this is no error. ``text`` is the whole file, whose unit of length is
    that of a printed number without a unit."""
    printed = output.references.get("MOMENT CENTER")
    if printed is None:
        return []
    key = next((key for key in aero if split_unit(key)[0] == "moment_point"), None)
    if key is None:
        return [
            f"its moments are about MOMENT CENTER {printed}, but taken about the centre of mass: "
            "give moment_point_m, that point in your stations"
        ]
    digits, _, unit = printed.partition(" ")
    own = aero[key][0] if isinstance(aero[key], list) and aero[key] else None
    factor = UNITS["length"].get(split_unit(key)[1])
    try:
        centre = float(digits) * _METRES.get(unit.upper(), _metres_per_unit(text))
    except ValueError:
        return []
    if not is_number(own) or factor is None:
        return []
    if abs(centre - own * factor) <= _OTHER_POINT:
        return []
    return [
        f"its moments are about MOMENT CENTER {printed}, but taken about {key} = {aero[key]}: "
        "these are one point only if stations of the file begin elsewhere"
    ]


def _ratio(lateral: _Reference, long: _Reference) -> float:
    """Ratio of the lateral to the longitudinal reference length. Raises FormatError if they are
    printed with too few digits."""
    if lateral == long:
        return 1.0
    if lateral.rounding / lateral.value + long.rounding / long.value > _OTHER / 4:
        raise FormatError(
            f"prints its reference lengths with too few digits, {lateral.value:.4g} and "
            f"{long.value:.4g} m; give lateral_length_m beside the table"
        )
    return lateral.value / long.value


def _compare(references: dict[str, _Reference], aero: dict[str, Any]) -> None:
    """Raise FormatError if the reference area or length of a file differs from that of the campaign
    by more than 2 % of that of the file and the rounding there; one that either of them does not
    give is not compared. ``references`` has those of the file by their DATCOM names, here ``sref``
    and ``lref``; ``aero`` is the table ``aerodynamics`` as in TOML, not yet in SI."""
    for name, stem, kind in (
        ("sref", "reference_area", "area"),
        ("lref", "reference_length", "length"),
    ):
        key = next((key for key in aero if split_unit(key)[0] == stem), None)
        unit = UNITS[kind].get(split_unit(key)[1]) if key else None
        value = aero.get(key or "")
        if name not in references or unit is None or not is_number(value):
            continue
        own, rounding = references[name].value, references[name].rounding
        if abs(value * unit - own) > _OTHER * own + rounding:
            first = next(iter(UNITS[kind]))
            raise FormatError(
                f"has the {stem.replace('_', ' ')} {own:.6g} {first}, but {key} is "
                f"{value:g}: give that of the file, by which its coefficients are divided"
            )


def parse_datcom(text: str, options: dict[str, Any]) -> tuple[dict[str, Any], list[str]]:
    """Read an aerodynamic table from the text of an output of DATCOM, without converting it to the
    signs and the reference lengths of the campaign.

    Parameters
    ----------
    text : str
    options : dict
        ``case``: number, from 1, of the case to read, needed if there are several.
        ``configuration``: part of the configuration or conditions of the tables to read (default:
        all). Of several configurations that are left, the last one with CN and CA is read.
        ``sideslip_deg``: sideslip up to which slopes by beta are extended as lines (default 30).

    Returns
    -------
    table : dict
        Keys of ``[body.NAME.aerodynamics.table]``. Coefficients have DATCOM's signs and refer to
        its area and lengths, which are not in the table; slopes are per rad.
    understood : list of str
        Sentences on what was read, for the user.

    Raises
    ------
    FormatError
        With the reason why the file is rejected.
    """
    output, sideslip = _chosen(text, options)
    return _table(output, sideslip)


def _chosen(text: str, options: dict[str, Any]) -> tuple[Output, float]:
    """Output of one configuration of one case, which ``options`` choose as for `parse_datcom`, and
    the sideslip, deg, up to which slopes by beta are extended (`_SIDESLIP` by default). Raises
    FormatError if an option is not valid, or if there are several cases and none is chosen."""
    case = choose_case(parse_cases(text), options.get("case"))
    output = choose_output(case, options.get("configuration"))
    sideslip = options.get("sideslip_deg", _SIDESLIP)
    if not (is_number(sideslip) and 0.0 < sideslip < 90.0):
        raise FormatError("sideslip_deg must be an angle above 0, below 90")
    return output, float(sideslip)


def _table(output: Output, sideslip: float) -> tuple[dict[str, Any], list[str]]:
    """Convert the output of a case to an aerodynamic table and sentences, as `parse_datcom` returns
    them. The axes are Mach number, alpha and, if values or slopes over it are there, beta; slopes
    by beta become lines up to +-``sideslip``, deg. Mach numbers and angles of attack at which CN or
    CA is missing are left out, with a sentence. Raises FormatError if none is left, or a sideslip
    is missing at one of the Mach numbers."""
    understood = [f"{name} {value}" for name, value in output.references.items()]
    understood += output.understood
    blocks = [b for b in output.blocks if "CN" in b.values and "CA" in b.values]
    if not blocks:
        raise FormatError("has no table of CN and CA over ALPHA")
    blank = sorted(
        {f"{b.mach:g}" for b in output.blocks} - {f"{b.mach:g}" for b in blocks}, key=float
    )
    if blank:
        understood.append(f"not read, as CN or CA is blank there: Mach number {', '.join(blank)}")
    machs, betas = sorted({b.mach for b in blocks}), sorted({b.beta for b in blocks})
    by_point = {(b.mach, b.beta): b for b in blocks}
    if len(by_point) < len(machs) * len(betas):
        mach, beta = next((m, b) for m in machs for b in betas if (m, b) not in by_point)
        raise FormatError(
            f"has no table at Mach number {mach:g} and sideslip {beta:g} deg: must have every "
            "sideslip at every Mach number"
        )
    alphas, dropped = _common_alphas(blocks)
    if dropped:
        listed = ", ".join(f"{a:g}" for a in dropped)
        understood.append(f"not read, as CN or CA is blank there: alpha = {listed}")
    if len(alphas) < 1:
        raise FormatError("has no alpha with CN and CA at all Mach numbers")
    shape = (len(machs), len(alphas), len(betas))
    values: dict[str, np.ndarray] = {}
    for i, mach in enumerate(machs):
        for k, beta in enumerate(betas):
            block = by_point[mach, beta]
            for title in block.values:
                row = _row(block, title, alphas)
                if row is not None and title not in BY_ALPHA_RATE:
                    values.setdefault(title, np.full(shape, np.nan))[i, :, k] = row
    left = [title for title, grid in values.items() if not np.isfinite(grid).all()]
    for title in left:
        del values[title]
    if left:
        understood.append(f"not read, as some are blank: {', '.join(left)}")
    tree = {name: values[title] for title, name in STATIC.items() if title in values}
    for title, name in BY_RATE.items():
        if title in values:
            tree[name] = values[title]
            if title == "CLQ":
                understood.append("CLQ taken for CNQ, as at small alpha")
    rates = [title for title in BY_ALPHA_RATE if any(title in b.values for b in blocks)]
    if rates:
        understood.append(
            f"NOT read: {', '.join(rates)}, derivatives by the rate of alpha, which the model does "
            "not have (in small oscillations they act as CMQ and CNQ: add them to pitch_q and "
            "normal_q yourself if you want that)"
        )
    slopes = {name: values[title] for title, name in BY_BETA.items() if title in values}
    if slopes and len(betas) == 1:
        betas = [betas[0] - sideslip, betas[0], betas[0] + sideslip]
        steps = np.radians([-sideslip, 0.0, sideslip])
        tree = {name: np.repeat(grid, 3, axis=2) for name, grid in tree.items()}
        for name, slope in slopes.items():
            tree[name] = tree.get(name, 0.0) + slope * steps
        understood.append(
            f"slopes by beta ({', '.join(t for t in BY_BETA if t in values)}) continued as lines "
            f"to {sideslip:g} deg of sideslip"
        )
    axes = {"mach": machs, "alpha_deg": alphas, "beta_deg": betas}
    if len(betas) == 1:
        del axes["beta_deg"]
        tree = {name: grid[:, :, 0] for name, grid in tree.items()}
    head = ", ".join(f"{len(points)} rows of {key.removesuffix('_deg')}" for key, points in
                     axes.items())  # fmt: skip
    understood.insert(0, f"{head}; {', '.join(tree)}")
    return {**axes, **{name: grid.tolist() for name, grid in tree.items()}}, understood


def _common_alphas(blocks: list[Block]) -> tuple[list[float], list[float]]:
    """Two lists of the angles of attack, deg, rising, for which a block has any value: those for
    which all blocks have CN and CA, and the others."""
    all_alphas = sorted({a for b in blocks for column in b.values.values() for a in column})
    complete = [
        a for a in all_alphas if all(a in b.values["CN"] and a in b.values["CA"] for b in blocks)
    ]
    return complete, [a for a in all_alphas if a not in complete]


def _row(block: Block, title: str, alphas: list[float]) -> np.ndarray | None:
    """Values (n,) of a title, which the block must have, at the angles ``alphas``, slopes converted
    to per rad; a derivative that is printed for one alpha only is used for all. None if values are
    missing."""
    column = block.values[title]
    factor = 180.0 / math.pi if title in block.per_degree else 1.0
    given = [column[a] for a in alphas if a in column]
    if len(given) == len(alphas):
        return factor * np.array(given)
    if len(column) == 1 and title not in STATIC:
        return np.full(len(alphas), factor * next(iter(column.values())))
    return None
