"""Reading and checks of the tables ``[map]`` and ``[size]`` of a campaign file: defaults of the
commands ``sepmc map`` and ``sepmc size``. Cases do not depend on them."""

import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import Annotated, Any

import numpy as np
from msgspec import Meta, Struct

from sepmc.scene.formula import CONSTANTS, FormulaError, Node, names, parse
from sepmc.scene.limits import CASES
from sepmc.scene.messages import InputError, Problems, nearest
from sepmc.scene.model import Requirement, Scene
from sepmc.scene.parameters import Parameter, UnknownPath, find
from sepmc.scene.setting_checks import matching_keys
from sepmc.scene.tables import read_table

MAX_VARIABLES = 6  # of a sizing
MAX_COSTS = 3
_MAX_POINTS = 1000  # of an axis
_AXIS_EXAMPLE = "spring.*.force_N=600:1200:41"
_VARIABLE_EXAMPLE = "push=spring.*.force_N=600:1200"
_Cases = Annotated[int, Meta(ge=1, le=CASES)]


class MapTable(Struct, frozen=True, kw_only=True):
    """Table ``[map]`` as written: axes ``x`` and ``y``, each ``KEY=LOW:HIGH:COUNT`` (``y`` None:
    one axis), number of cases of every design (None: the default of the command), and the largest
    number (``max_cases``; None: ``cases``) for a design whose verdict is open after fewer."""

    x: str
    y: str | None = None
    cases: _Cases | None = None
    max_cases: _Cases | None = None


class SizeTable(Struct, frozen=True, kw_only=True):
    """Table ``[size]`` as written: formulas of the costs to ``minimise``, design variables to
    ``vary``, ``KEY=LOW:HIGH`` by name, names of the requirements to satisfy (``subject_to``; empty:
    all), and number of cases of every design (None: the default of the command)."""

    minimise: tuple[str, ...] | str
    vary: dict[str, str]
    subject_to: tuple[str, ...] = ()
    cases: _Cases | None = None


@dataclass(frozen=True)
class MapAxis:
    """Axis of a map: a design variable and its evenly spaced values.

    Attributes
    ----------
    key : str
        TOML path with its unit; ``*`` stands for any name.
    low, high : float
        Ends, in that unit.
    count : int
        Number of values, evenly spaced, ends included.
    """

    key: str
    low: float
    high: float
    count: int

    @property
    def values(self) -> np.ndarray:
        """Values (count,) of the variable, rising, in the unit of its key."""
        return np.linspace(self.low, self.high, self.count)


@dataclass(frozen=True)
class Variable:
    """Design variable of a sizing: its name in the formulas of costs, its TOML path with unit
    (``*`` stands for any name), and the ends of its range in that unit."""

    name: str
    key: str
    low: float
    high: float


@dataclass(frozen=True)
class MapPlan:
    """Table ``[map]``, parsed and checked: its one or two axes, and numbers of cases as in
    `MapTable` (None: not given)."""

    axes: tuple[MapAxis, ...]
    cases: int | None
    max_cases: int | None


@dataclass(frozen=True)
class SizePlan:
    """Table ``[size]``, parsed and checked: design variables, formulas of the costs to
    ``minimise``, names of the requirements to satisfy (``subject_to``; empty: all), and number of
    cases (None: not given)."""

    variables: tuple[Variable, ...]
    minimise: tuple[str, ...]
    subject_to: tuple[str, ...]
    cases: int | None


def parse_range(text: str, name: str, form: str, counts: int = 0) -> tuple[str, list[float]]:
    """Parse ``KEY=LOW:HIGH``, or with ``counts`` = 1 ``KEY=LOW:HIGH:COUNT``; KEY is not checked.

    Parameters
    ----------
    text : str
    name : str
        Of the option or key, for messages.
    form : str
        The form that is expected, with an example, for messages.
    counts : int
        Number of integers that follow LOW and HIGH.

    Returns
    -------
    key : str
    numbers : list of float
        LOW, HIGH and the integers.

    Raises
    ------
    InputError
        If the text has another form, or LOW < HIGH does not hold for finite numbers.
    """
    key, _, written = text.rpartition("=")
    try:
        ends = written.split(":")
        numbers = [*map(float, ends[:2]), *map(int, ends[2:])]
        if not key.strip() or len(numbers) != 2 + counts:
            raise ValueError
    except ValueError:
        raise InputError(f"{name} = {text}: must be {form}") from None
    low, high = numbers[:2]
    if not (math.isfinite(low) and math.isfinite(high) and low < high):
        raise InputError(f"{name} = {text}: LOW and HIGH must be finite, and LOW below HIGH")
    return key.strip(), numbers


def parse_axis(text: str, name: str) -> MapAxis:
    """Parse the axis of a map, ``KEY=LOW:HIGH:COUNT``; ``name`` is that of the option or key, for
    messages. KEY is not looked up. Raises InputError if the text has another form, LOW is not below
    HIGH, one of them is not finite, or COUNT is not 2 to 1000."""
    form = f"KEY=LOW:HIGH:COUNT, as {_AXIS_EXAMPLE}"
    key, (low, high, count) = parse_range(text, name, form, counts=1)
    if not 2 <= count <= _MAX_POINTS:
        raise InputError(
            f"{name} = {text}: the last number, the count of points, must be 2 to {_MAX_POINTS}"
        )
    return MapAxis(key, low, high, int(count))


def parse_variable(text: str, name: str = "--vary") -> Variable:
    """Parse a design variable, ``NAME=KEY=LOW:HIGH``; ``name`` is that of the option or key, for
    messages. KEY is not looked up. Raises InputError if the text has another form, LOW is not below
    HIGH, one of them is not finite, or NAME is no identifier."""
    form = f"NAME=KEY=LOW:HIGH, as {_VARIABLE_EXAMPLE}"
    both, (low, high) = parse_range(text, name, form)
    own, _, key = (part.strip() for part in both.partition("="))
    if not (own.isidentifier() and key):
        raise InputError(f"{name} = {text}: must be {form}")
    return Variable(own, key, low, high)


def check_variables(variables: Sequence[Variable]) -> None:
    """Raise InputError if there are no or too many design variables, or if a name is used twice or
    is that of a constant of formulas (``pi``)."""
    known = [one.name for one in variables]
    if not 1 <= len(known) <= MAX_VARIABLES:
        raise InputError(f"vary: has {len(known)} variables: must have 1 to {MAX_VARIABLES}")
    if len(set(known)) < len(known):
        raise InputError(f"vary: names a variable twice: {', '.join(known)}")
    if taken := sorted(CONSTANTS.keys() & known):
        raise InputError(f"vary: {taken[0]} is a number in formulas: choose another name")


def cost_tree(minimise: str, variables: Sequence[Variable]) -> Node:
    """Parse the formula ``minimise`` of a cost, of names of design variables, to a syntax tree.
    Raises InputError if it is no formula, names anything else, or names no variable."""
    known = [one.name for one in variables]
    try:
        tree = parse(minimise)
    except FormulaError as error:
        raise InputError(f"minimise = {minimise}: {error}") from None
    for name in names(tree):
        if name not in known:
            raise InputError(f"minimise = {minimise}: no variable {name!r}; {nearest(name, known)}")
    if not names(tree):
        raise InputError(f"minimise = {minimise}: must contain a variable: {', '.join(known)}")
    return tree


def check_subject_to(chosen: Sequence[str], requirements: Sequence[Requirement]) -> None:
    """Raise InputError if one of the names ``chosen`` is not that of a requirement."""
    known = [item.name for item in requirements]
    for name in chosen:
        if name not in known:
            raise InputError(f"subject_to = {name}: no such requirement; {nearest(name, known)}")


def named_parameters(tree: Mapping[str, Any], scene: Scene, key: str) -> Iterator[Parameter]:
    """Yield the parameters of a scene that ``key`` means, a TOML path with unit in which ``*``
    stands for any characters of a name, but not for dots. Names are those in ``tree``, the TOML
    tree of the campaign. Raises UnknownPath, with the path in its message, if there are none or one
    is wrong."""
    keys = matching_keys(dict(tree), key)
    if not keys:
        raise UnknownPath(f"{key}: no table has such a name")
    for one in keys:
        try:
            yield find(scene, one)
        except UnknownPath as error:
            raise UnknownPath(f"{one}: {error.args[0]}") from None


def read_map(tree: Any, scene: Scene, problems: Problems) -> MapPlan | None:
    """Parse the table ``[map]`` in the TOML tree of a campaign. None if there is no such table, or
    after adding problems."""
    table = read_table(MapTable, tree["map"], "map", problems) if "map" in tree else None
    if table is None:
        return None
    count, axes = len(problems), []
    for name, text in (("x", table.x), ("y", table.y)):
        if text is None:
            continue
        try:
            axes.append(parse_axis(text, f"map.{name}"))
            list(named_parameters(tree, scene, axes[-1].key))
        except (InputError, UnknownPath) as error:
            _note(error, f"map.{name}", problems)
    if table.max_cases is not None and table.max_cases < (table.cases or 1):
        problems.add("map.max_cases", f"must be at least cases = {table.cases}", table.max_cases)
    return MapPlan(tuple(axes), table.cases, table.max_cases) if len(problems) == count else None


def read_size(
    tree: Any, scene: Scene, requirements: Sequence[Requirement], problems: Problems
) -> SizePlan | None:
    """Parse the table ``[size]`` in the TOML tree of a campaign; its ``subject_to`` may name some
    of the ``requirements``, or be "all". None if there is no such table, or after adding
    problems."""
    written = tree.get("size")
    if isinstance(written, dict) and written.get("subject_to") == "all":
        written = {key: value for key, value in written.items() if key != "subject_to"}
    table = read_table(SizeTable, written, "size", problems) if "size" in tree else None
    if table is None:
        return None
    count, variables = len(problems), []
    for name, text in table.vary.items():
        key_path = f"size.vary.{name}"
        try:
            variables.append(parse_variable(f"{name}={text}", key_path))
            list(named_parameters(tree, scene, variables[-1].key))
        except (InputError, UnknownPath) as error:
            _note(error, key_path, problems)
    costs = (table.minimise,) if isinstance(table.minimise, str) else table.minimise
    if not 1 <= len(costs) <= MAX_COSTS:
        reason = f"must be a formula, or a list of 1 to {MAX_COSTS}"
        problems.add("size.minimise", reason, list(costs))
    if len(problems) > count:
        return None
    try:
        check_variables(variables)
        for cost in costs:
            cost_tree(cost, variables)
        check_subject_to(table.subject_to, requirements)
    except InputError as error:
        problems.append(f"size.{error}")
        return None
    return SizePlan(tuple(variables), costs, table.subject_to, table.cases)


def _note(error: Exception, key_path: str, problems: Problems) -> None:
    """Add a problem from an error: an UnknownPath gets ``key_path`` in front, the message of an
    InputError begins with it already."""
    if isinstance(error, UnknownPath):
        problems.add(key_path, str(error.args[0]))
    else:
        problems.append(str(error))
