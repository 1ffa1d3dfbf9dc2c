"""Reading of aerodynamic tables in DAVE-ML (AIAA S-119).

A DAVE-ML model computes outputs by functions, which are tables, and by formulas. Only functions of
Mach number, alpha and beta alone are read; outputs of formulas, and functions of other variables
such as deflections, are not.
"""

import math
from collections.abc import Collection
from dataclasses import dataclass
from itertools import combinations
from pathlib import Path
from typing import Any

import numpy as np
from scipy.interpolate import RegularGridInterpolator

from sepmc.formats.columns import check_quantities, named_column, plain
from sepmc.formats.daveml_signs import STANDARD, sign_of
from sepmc.formats.decks import AXES, QUANTITIES, coefficient_of, deck_of
from sepmc.formats.text_table import FormatError, TextTable, read_text
from sepmc.formats.xml_tree import Element, parse_xml
from sepmc.scene.messages import nearest, shorten
from sepmc.scene.model import COEFFICIENTS, DERIVATIVES
from sepmc.scene.units import split_unit

_CELLS = 100_000  # of a table
_UNITS = {"deg": "deg", "d": "deg", "rad": "rad", "r": "rad"}


@dataclass
class _Function:
    """Function of a DAVE-ML file as a gridded table: varIDs of its ``result`` and of its argument
    ``variables``, grid ``points`` of each argument, and ``values`` on that grid, in the units of
    the file; ``element`` is its element ``function``."""

    element: Element
    result: str
    variables: list[str]
    points: list[np.ndarray]
    values: np.ndarray


def read_daveml(
    path: Path, options: dict[str, Any], aero: dict[str, Any] | None = None
) -> tuple[dict[str, Any], list[str]]:
    """Read an aerodynamic table of a campaign from a DAVE-ML file.

    Parameters
    ----------
    path : Path
    options : dict
        ``columns``: name or varID of a variable, or ``{ column, scale }``, by coefficient or axis.
    aero : dict, optional
        Table [body.NAME.aerodynamics] of the campaign, in whose convention the side force is.

    Returns
    -------
    table : dict
        Keys of ``[body.NAME.aerodynamics.table]``, with ``interpolation = "linear"``.
    understood : list of str
        Sentences on what was read, for the user.

    Raises
    ------
    FormatError
        With the reason why the file is rejected.
    """
    root = parse_xml(read_text(path))
    if root.tag != "DAVEfunc":
        raise FormatError(f"line {root.line}: the root is {shorten(root.tag)}; must be DAVEfunc")
    variables = {each.attributes.get("varID", "").strip(): each for each in root.all("variableDef")}
    functions = [_function(each, root, variables) for each in root.all("function")]
    named = _named(options.get("columns"), variables)
    chosen = {variable: key for key, (variable, _) in named.items()}
    quantities = {split_unit(key)[0] for key in named}
    axes = {
        variable: axis
        for variable, element in variables.items()
        for axis, quantity in AXES.items()
        if split_unit(chosen.get(variable, ""))[0] == axis
        or (
            not {variable, axis} & {*chosen, *quantities}
            and {plain(element.attributes.get("name", "")), plain(variable)} & {*quantity.names}
        )
    }
    # what enters a formula is a contribution, and no coefficient unless the campaign says so
    in_formulas = {
        each.text.strip() for formula in root.all("calculation") for each in formula.all("ci")
    }
    usable = [
        each
        for each in functions
        if set(each.variables) <= set(axes)
        and (each.result in chosen or each.result not in in_formulas)
    ]
    if not usable:
        known = ", ".join(each.result for each in functions[:8])
        raise FormatError(
            "has no table over Mach number, alpha and beta alone; name its variables by columns"
            + (f"; tables: {known}" if functions else "")
        )
    readable = usable
    usable = _chosen(readable, variables, chosen, quantities)
    table, titles = _long_table(usable, variables, axes)
    columns = {
        key: {"column": titles[variable], "scale": scale}
        for key, (variable, scale) in named.items()
        if variable in titles
    }
    coefficients = {
        key: (variable, scale)
        for key, (variable, scale) in named.items()
        if variable in titles and split_unit(key)[0] not in AXES
    }
    for each in usable:
        key = coefficient_of(titles[each.result])
        if each.result not in chosen and key and key not in coefficients:
            coefficients[key] = (each.result, 1.0)
            columns[key] = {"column": titles[each.result], "scale": 1.0}
    signs = _turn_signs(columns, coefficients, variables, (aero or {}).get("convention", ""))
    tree, understood = deck_of(table, columns)
    tree["interpolation"] = "linear"
    understood.append("linear between the rows, as DAVE-ML means it")
    understood += signs
    if others := [each.result for each in readable if each not in usable]:
        understood.append(f"not read, as columns names others: {', '.join(others)}")
    left = [each.result for each in functions if each not in readable]
    if left:
        understood.append(f"not read, as of other variables or in formulas: {', '.join(left)}")
    computed = [
        element.attributes.get("name", variable)
        for variable, element in variables.items()
        if element.child("calculation") is not None and element.child("isOutput") is not None
    ]
    if computed:
        understood.append(f"NOT in the table, as they follow from formulas: {', '.join(computed)}")
    return tree, understood


def _chosen(
    functions: list[_Function],
    variables: dict[str, Element],
    chosen: Collection[str],
    quantities: Collection[str],
) -> list[_Function]:
    """Return the functions to read: each whose variable is in ``chosen``, the varIDs that the
    option ``columns`` names, and each other one unless its coefficient is in ``quantities``, the
    coefficients and axes that ``columns`` names. Raises FormatError if two of these other ones give
    the same coefficient."""
    kept, coefficients = [], set[str]()
    for each in functions:
        title = _title(variables[each.result])
        name = "" if each.result in chosen else coefficient_of(title)
        if name in coefficients:
            raise FormatError(
                f"line {each.element.line}: another function gives {title} too: choose by "
                f"columns.{name}"
            )
        if name not in quantities:
            kept.append(each)
            coefficients |= {name} - {""}
    return kept


def _named(columns: Any, variables: dict[str, Element]) -> dict[str, tuple[str, float]]:
    """Convert the option ``columns`` to a dict: by key (a coefficient or axis, with its unit), the
    pair (varID, scale) of the variable that it names (by varID or name); values are multiplied by
    ``scale``, 1.0 if the option has none. Empty if the option is None. Raises
    FormatError if it is not valid or there is no such variable."""
    if columns is not None and not isinstance(columns, dict):
        raise FormatError("columns: must be a table of variables by coefficient or axis")
    by_name = {element.attributes.get("name", ""): name for name, element in variables.items()}
    named = {}
    for key, value in (columns or {}).items():
        name, scale = named_column(key, value, "a variable, or { column = NAME, scale = 1.0 }")
        if name not in variables and name not in by_name:
            hint = nearest(name, [*variables, *by_name])
            raise FormatError(f"columns.{key}: no variable {shorten(name)}; {hint}")
        check_quantities([split_unit(key)[0]], QUANTITIES, "coefficient")
        named[key] = (name if name in variables else by_name[name], scale)
    return named


def _turn_signs(
    columns: dict[str, dict[str, Any]],
    coefficients: dict[str, tuple[str, float]],
    variables: dict[str, Element],
    convention: str,
) -> list[str]:
    """Multiply the ``scale`` of ``columns``, in place, by the signs that the file states, and
    return sentences on the signs that are turned or not stated.

    ``columns`` has by coefficient a table whose ``scale`` is set, ``coefficients`` the varID and
    the scale that the campaign gives, ``variables`` the definitions by varID. ``convention`` is
    that of the campaign: with "datcom" the side force is turned later, so one whose sign the file
    states is made positive to the right here; one whose sign it does not state is taken as positive
    to the right. Raises FormatError if a variable is in wind or stability axes, and its coefficient
    in body axes."""
    turned, assumed = [], []
    for key, (variable, scale) in coefficients.items():
        if key not in (*COEFFICIENTS, *DERIVATIVES, "lift", "drag"):
            continue  # refused by its key
        sign, reason, stated = sign_of(key, variables[variable])
        is_datcom = convention == "datcom" and key.startswith("side")
        columns[key]["scale"] = scale * (-sign if is_datcom and stated else sign)
        scaled = f", times scale = {scale:g}" if scale != 1.0 else ""
        if not stated:
            reason = "positive right" if is_datcom else reason
            assumed.append(f"{key} = {variable} ({reason}{scaled})")
        elif sign < 0.0 or scaled:
            minus = "-" if sign < 0.0 else ""
            turned.append(f"{key} = {minus}{variable} ({reason}{scaled})")
    return [
        *([f"signs turned to those of this model: {', '.join(turned)}"] if turned else []),
        *(
            [
                f"sign NOT stated by the file and taken as it stands: {', '.join(assumed)}; if it "
                "is the other, give { column = NAME, scale = -1 } in columns"
            ]
            if assumed
            else []
        ),
    ]


def _title(element: Element) -> str:
    """Title of the column of a variable: the coefficient of which its name, or else its varID, is
    the standard name (`STANDARD`); if neither is one, the name, or the varID without a name."""
    name = element.attributes.get("name", "").strip()
    variable = element.attributes.get("varID", "").strip()
    standard = STANDARD.get(name) or STANDARD.get(variable)
    return standard[0] if standard else name or variable


def _function(element: Element, root: Element, variables: dict[str, Element]) -> _Function:
    """Convert an element ``function`` to a table, whose grid points are in the element itself or in
    breakpoint definitions of ``root``. ``variables`` is by varID. Raises FormatError if it is not
    complete, its interpolation is not linear, its points do not rise or it has more than `_CELLS`
    values."""
    result = next(
        (each.attributes.get("varID", "").strip() for each in element.children
         if each.tag in ("dependentVarRef", "dependentVarPts")), ""
    )  # fmt: skip
    inputs = [
        each for each in element.children if each.tag in ("independentVarRef", "independentVarPts")
    ]
    names = [each.attributes.get("varID", "").strip() for each in inputs]
    if unknown := [name for name in (result, *names) if name not in variables]:
        raise FormatError(f"line {element.line}: no variableDef of {shorten(unknown[0])}")
    for each in inputs:
        way = each.attributes.get("interpolate", "linear")
        if way != "linear":
            raise FormatError(f"line {each.line}: interpolate = {shorten(way)}: must be linear")
    if any(each.tag == "independentVarPts" for each in inputs):
        points = [np.array(each.numbers(each.text, "independentVarPts")) for each in inputs]
        cells = element.child("dependentVarPts")
    else:
        grid = _grid(element, root)
        breakpoints = {
            each.attributes.get("bpID", "").strip(): each for each in root.all("breakpointDef")
        }
        points = [_points(each, breakpoints) for each in grid.all("bpRef")]
        cells = grid.child("dataTable")
    if cells is None:
        raise FormatError(f"line {element.line}: the function of {result} has no values")
    shape = tuple(map(len, points))
    if len(points) != len(names) or not points or math.prod(shape) > _CELLS:
        raise FormatError(
            f"line {element.line}: {result} has {len(points)} sets of breakpoints for "
            f"{len(names)} variables, {' x '.join(map(str, shape))} values: must have one set for "
            "each variable, and at most 100,000 values"
        )
    for name, axis in zip(names, points, strict=True):
        if (np.diff(axis) <= 0.0).any():
            raise FormatError(f"line {element.line}: the points of {name} do not rise")
    values = np.array(cells.numbers(cells.text, cells.tag, math.prod(shape)))
    return _Function(element, result, names, points, values.reshape(shape))


def _grid(element: Element, root: Element) -> Element:
    """Element of the gridded table of a function: the one in ``element``, or the one in ``root`` to
    which it refers. Raises FormatError if there is none."""
    own = next(element.all("griddedTableDef"), None) or next(element.all("griddedTable"), None)
    if own is not None:
        return own
    reference = next(element.all("griddedTableRef"), None)
    if reference is None:
        raise FormatError(
            f"line {element.line}: has no gridded table; tables of other kinds are not read"
        )
    name = reference.attributes.get("gtID", "").strip()
    tables = {each.attributes.get("gtID", "").strip(): each for each in root.all("griddedTableDef")}
    if name not in tables:
        raise FormatError(f"line {reference.line}: no griddedTableDef {shorten(name)}")
    return tables[name]


def _points(reference: Element, breakpoints: dict[str, Element]) -> np.ndarray:
    name = reference.attributes.get("bpID", "").strip()
    values = breakpoints[name].child("bpVals") if name in breakpoints else None
    if values is None:
        raise FormatError(f"line {reference.line}: no breakpointDef {shorten(name)} with bpVals")
    return np.array(values.numbers(values.text, "bpVals"))


def _long_table(
    functions: list[_Function], variables: dict[str, Element], axes: dict[str, str]
) -> tuple[TextTable, dict[str, str]]:
    """Evaluate all functions on one grid, which has all their points. Raises FormatError if two
    variables are the same axis, two functions give one variable, or the grid is too large.

    Linear interpolation on this finer grid gives the same values. Beyond its own points a function
    has the value at its end.

    Parameters
    ----------
    functions : list of _Function
    variables : dict of str to Element
        Definitions of variables by varID.
    axes : dict of str to str
        "mach", "alpha" or "beta" by varID.

    Returns
    -------
    table : TextTable
        A row for each point of the grid, a column for each axis and function.
    titles : dict of str to str
        Title of the column of each variable, by varID.
    """
    used = [name for name in axes if any(name in each.variables for each in functions)]
    for first, second in combinations(used, 2):
        if axes[first] == axes[second]:
            raise FormatError(f"{first} and {second} are both {axes[first]}: choose one by columns")
    points = {
        name: np.unique(np.concatenate([
            each.points[each.variables.index(name)] for each in functions if name in each.variables
        ]))
        for name in used
    }  # fmt: skip
    if math.prod(map(len, points.values())) > _CELLS:
        raise FormatError(
            "has tables whose points, joined to one grid, are more than 100,000: give them "
            "the same breakpoints"
        )
    mesh = dict(zip(used, np.meshgrid(*points.values(), indexing="ij"), strict=True))
    columns, titles = {}, {}
    for name in used:
        units = variables[name].attributes.get("units", "").strip().lower()
        unit = "" if axes[name] == "mach" else _UNITS.get(units, units)
        titles[name] = f"{axes[name]} ({unit})" if unit else axes[name]
        columns[titles[name]] = mesh[name].ravel()
    for each in functions:
        table = RegularGridInterpolator(each.points, each.values, method="linear")
        at = [
            np.clip(mesh[name], ends[0], ends[-1])
            for name, ends in zip(each.variables, each.points, strict=True)
        ]
        title = _title(variables[each.result])
        if each.result in titles:
            raise FormatError(
                f"line {each.element.line}: another function gives {title} too: leave one out"
            )
        title = f"{title} ({each.result})" if title in columns else title
        titles[each.result] = title
        columns[title] = table(np.stack(at, axis=-1)).ravel()
    return TextTable(columns), titles
