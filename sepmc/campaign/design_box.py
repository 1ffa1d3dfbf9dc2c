"""Box of designs: a campaign in which the design variables are dispersed over their ranges.

A design is a value for each design variable. One kernel and one selection of steps serve the whole
box. Kernel parameters that follow from a design but are no inputs must be linear in the variables;
otherwise the box is refused.
"""

import copy
import itertools
import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np

from sepmc.campaign.cases import quantile
from sepmc.campaign.definition import Definition
from sepmc.campaign.store.sample_file import read_input_table
from sepmc.kernel.spec.parameter_layout import (
    ParameterLayout,
    make_parameter_layout,
    separation_sign,
)
from sepmc.scene import parameters
from sepmc.scene.design_tables import named_parameters
from sepmc.scene.dispersion import Dispersion
from sepmc.scene.messages import InputError, SceneError, nearest, shorten
from sepmc.scene.parameters import Parameter, UnknownPath
from sepmc.scene.read import parse_campaign

LEVEL = 1e-12  # relative: deviation from a linear dependence on a design
_TAIL = 0.001  # probability of the ends of a dispersed parameter in calibration cases
_MAX_GEOMETRIC = 10  # variables of mass centres and joints: all corners of their ranges are tried
_EXAMPLE = '{"motor.retro.thrust_N": (300.0, 700.0)}'

Settings = dict[str, float]


@dataclass(frozen=True)
class DesignVariable:
    """A design variable: its range, and the parameters that take its value.

    Attributes
    ----------
    key : str
        TOML path with its unit, as given; ``*`` stands for any name.
    low, high : float
        Ends of the range, in that unit.
    parameters : tuple of Parameter
        All parameters that the key names; several only if it has wildcards.
    """

    key: str
    low: float
    high: float
    parameters: tuple[Parameter, ...]

    def at(self, share: float) -> float:
        """Return the value at ``share``, a fraction of the range: 0 gives ``low``, 1 ``high``."""
        return (1.0 - share) * self.low + share * self.high


def design_variables(campaign: Definition, vary: Any) -> tuple[DesignVariable, ...]:
    """Return the design variables of a campaign, one for each entry of ``vary``, a dict of ranges
    (low, high) by TOML path, which may have wildcards.

    Raises
    ------
    InputError
        If ``vary`` is no such dict or is empty, a path names no number of the scene, a number is
        varied twice, or a range is not finite or does not rise.
    """
    if not isinstance(vary, Mapping) or not vary:
        raise InputError(f"vary = {shorten(vary)}: must be ranges by TOML path, as {_EXAMPLE}")
    variables: list[DesignVariable] = []
    varied: dict[str, str] = {}
    for key, ends in vary.items():
        if not isinstance(key, str):
            raise InputError(f"vary, {key!r}: must be a TOML path, as in {_EXAMPLE}")
        low, high = _range(key, ends)
        parameters = tuple(_parameters(campaign, key))
        for parameter in parameters:
            if parameter.path in varied:
                other = varied[parameter.path]
                raise InputError(f"vary, {key}: {parameter.key} is varied twice, also by {other}")
            varied[parameter.path] = key
        variables.append(DesignVariable(key, low, high, parameters))
    return tuple(variables)


def _range(key: str, ends: Any) -> tuple[float, float]:
    """Return the range ``ends`` of a path ``key`` as (low, high). Raises InputError unless it is
    two finite numbers, the lower one first."""
    try:
        low, high = (float(end) for end in ends)
    except (TypeError, ValueError):
        reason = f"must be the lowest and the highest value, as in {_EXAMPLE}"
        raise InputError(f"vary, {key} = {shorten(ends)}: {reason}") from None
    if not (math.isfinite(low) and math.isfinite(high) and low < high):
        raise InputError(f"vary, {key} = ({low:g}, {high:g}): must be finite and rising")
    return low, high


def _parameters(campaign: Definition, key: str) -> Iterator[Parameter]:
    """Yield the parameters that a TOML path, which may have wildcards, names. Raises InputError if
    there are none."""
    try:
        yield from named_parameters(campaign.file.tree, campaign.scene, key)
    except UnknownPath as error:
        raise InputError(f"vary: names no number that can vary: {error.args[0]}") from None


@dataclass(frozen=True)
class DerivedNumber:
    """Element of the kernel's parameter vector that is no input but depends linearly on a design.

    ``index`` is its index in the vector. In SI, ``start`` is its value with all variables at their
    low ends, and ``slopes`` has, for each variable, the change from its low to its high end.
    """

    index: int
    start: float
    slopes: tuple[float, ...]

    def at(self, shares: Sequence[float]) -> float:
        """Return the value (SI) for a design given as ``shares``, for each variable the fraction of
        its range: 0 at the low end, 1 at the high end."""
        return self.start + sum(s * t for s, t in zip(self.slopes, shares, strict=True))


class DesignBox(Definition):
    """Campaign in which the varied parameters are dispersed uniformly over all values that they
    have in the designs of the box; made by `of`.

    Attributes
    ----------
    variables : tuple of DesignVariable
    ends : tuple of Definition
        The campaign with all variables at their low ends, at their high ends, and half way.
    derived : tuple of DerivedNumber
        Kernel parameters that are no inputs but follow from the design.
    """

    variables: tuple[DesignVariable, ...]
    ends: tuple[Definition, Definition, Definition]
    derived: tuple[DerivedNumber, ...] = ()

    @classmethod
    def of(cls, campaign: Any, vary: Any) -> "DesignBox":
        """Make the box of a campaign for the ranges ``vary``, as in `design_variables`.

        It is built from the designs with all variables at their low ends, at their high ends and
        half way, and with each variable alone at its high end. Raises InputError or SceneError if
        one of these is not a valid campaign or the designs cannot share a kernel, and as
        `_check_signs` and `_check_distributions`."""
        variables = design_variables(campaign, vary)
        low, high, middle = (
            _at_end(campaign, {v.key: v.at(share) for v in variables}, end)
            for share, end in ((0.0, "the low end"), (1.0, "the high end"), (0.5, "the middle"))
        )
        file = campaign.file
        tree = copy.deepcopy(file.tree)
        laws = tree.setdefault("dispersion", {})
        keys = {d.parameter.path: k for k, d in enumerate(file.dispersions)}
        for v in variables:
            for parameter in v.parameters:
                number = keys.get(parameter.path)
                if number is None:
                    laws[parameter.key] = {"uniform": [v.low, v.high]}
                else:
                    each = low.file.dispersions[number], high.file.dispersions[number]
                    laws[each[0].parameter.key] = {"uniform": _extent(*each)}
        box = cls(parse_campaign(tree, file.name, {}, file.name, file.folder, read_input_table))
        box.variables, box.ends = variables, (low, high, middle)
        single = [
            _at_end(
                campaign,
                {w.key: w.high if w is v else w.low for w in variables},
                f"the high end of {v.key} and the low end of all others",
            )
            for v in variables
        ]
        box.derived = tuple(_derived_numbers(box, [box.layout_of(one) for one in single]))
        _check_signs(box)
        _check_distributions(box)
        return box

    def layout_of(self, definition: Definition) -> ParameterLayout:
        """Return the parameter layout of the box, with the nominal values of ``definition``, a
        campaign that has the same parameters, such as one of `ends`."""
        return make_parameter_layout(definition.scene, self.dispersed)

    @cached_property
    def variable_of_column(self) -> dict[int, int]:
        """Index of the design variable that varies an input column, by the index of the column;
        other columns are left out."""
        columns = {d.parameter.path: k for k, d in enumerate(self.file.dispersions)}
        return {
            columns[parameter.path]: i
            for i, v in enumerate(self.variables)
            for parameter in v.parameters
        }

    @cached_property
    def slots_with_derived(self) -> np.ndarray:
        """Indices, in the parameter vector of the kernel, of the inputs, then of `derived`."""
        return np.append(self.slots, np.array([d.index for d in self.derived], dtype=np.int64))

    def check_designs(self, designs: np.ndarray) -> np.ndarray:
        """Return m designs, an array (m, variables) in the units of the variables, unchanged.
        Raises InputError if the shape is wrong, m is 0 or a design is outside the box."""
        if designs.ndim != 2 or not len(designs) or designs.shape[1] != len(self.variables):
            keys = ", ".join(v.key for v in self.variables)
            raise InputError(f"design: needs {len(self.variables)} values, in this order: {keys}")
        for k, v in enumerate(self.variables):
            outside = ~((v.low <= designs[:, k]) & (designs[:, k] <= v.high))
            if outside.any():
                value = designs[np.argmax(outside), k]
                reason = f"must lie in {v.low:g} to {v.high:g}, the box of this session"
                raise InputError(f"design, {v.key} = {value:g}: {reason}")
        return designs

    def values_of(self, design: Any) -> list[Any]:
        """Return the values of a ``design`` in the order of the variables. A dict has them by key
        of the variable; a number or a sequence is taken to be in this order, and its length is not
        checked. Raises InputError if a key of the dict is missing or not varied."""
        if not isinstance(design, Mapping):
            return list(np.atleast_1d(design))
        keys = [v.key for v in self.variables]
        for key in design:
            if key not in keys:
                raise InputError(
                    f"design, {key}: is not varied in this session; {nearest(str(key), keys)}"
                )
        if missing := [key for key in keys if key not in design]:
            raise InputError(f"design: needs a value of {', '.join(missing)}")
        return [design[key] for key in keys]


def _at_end(campaign: Any, design: Settings, end: str) -> Any:
    """Return a campaign with the values of a design; ``end`` says in messages where in its ranges
    the design is. Raises SceneError if the design is not valid."""
    try:
        return campaign.with_settings(design)
    except SceneError as error:
        values = ", ".join(f"{key} = {value:g}" for key, value in design.items())
        place = f"vary, at {end} ({values})"
        raise SceneError([f"{place}: {problem}" for problem in error.problems]) from None


def _extent(low: Dispersion, high: Dispersion) -> list[float]:
    """Return the lowest and highest value, in the unit of its key, of a dispersed parameter whose
    nominal is varied, over the 0.1, 50 and 99.9 % quantiles of ``low`` and ``high``, its
    distributions at the ends of the design variable. Quantiles in unlimited tails that the key does
    not allow are left out."""
    u = np.array([_TAIL, 0.5, 1.0 - _TAIL])
    values = np.concatenate([quantile(low, u), quantile(high, u)])
    values = values[low.allowed(values)] if low.has_tails else values
    return [float(values.min()), float(values.max())]


def _check_signs(box: DesignBox) -> None:
    """Raise InputError if somewhere in the box a joint opens to the other side along its axis than
    in the nominal scene (`separation_sign` differs). Only variables of mass centres and of joints
    change this: it tries all corners of their ranges, as the distance along the axis is linear in
    each, and raises InputError too if they are more than `_MAX_GEOMETRIC`."""
    variables = [
        v
        for v in box.variables
        if any(p.path.startswith("joint.") or ".cg." in p.path for p in v.parameters)
    ]
    if len(variables) > _MAX_GEOMETRIC:
        raise InputError(
            f"vary: {len(variables)} variables of mass centres and joints: must be at most "
            f"{_MAX_GEOMETRIC}"
        )
    signs = {joint: separation_sign(box.scene, joint) for joint in box.scene.joint}
    for corner in itertools.product((0.0, 1.0), repeat=len(variables)):
        values = {
            p.path: v.at(share) * p.factor
            for v, share in zip(variables, corner, strict=True)
            for p in v.parameters
        }
        scene = parameters.replace(box.ends[0].scene, values)
        for joint, sign in signs.items():
            if separation_sign(scene, joint) != sign:
                raise InputError(
                    f"vary: joint.{joint} would open to the other side than in the nominal scene "
                    "in some designs of these ranges; choose ranges that keep it on one side"
                )


def _check_distributions(box: DesignBox) -> None:
    """Raise InputError if the quantiles of a varied dispersed parameter are constant over the range
    of its design variable, or do not change linearly."""
    u = np.array([_TAIL, 0.3, 0.8])
    laws = [end.file.dispersions for end in box.ends]
    for k, i in box.variable_of_column.items():
        if k >= len(laws[0]):
            continue
        low, high, middle = (quantile(law[k], u) for law in laws)
        key = box.variables[i].key
        if np.array_equal(low, high):
            raise InputError(
                f"vary, {key}: its distribution has absolute values, so it does not follow the "
                "design; give it a width about the nominal, or relative = true"
            )
        size = LEVEL * np.maximum(np.abs(low), np.abs(high))
        if not (np.abs(0.5 * (low + high) - middle) <= size).all():
            raise InputError(
                f"vary, {key}: its distribution is not in proportion to the nominal over this "
                "range; choose a range in which the nominal keeps its sign"
            )


def _derived_numbers(box: DesignBox, single: Sequence[ParameterLayout]) -> Iterator[DerivedNumber]:
    """Yield the kernel parameters that are no inputs but change with the design; ``single`` has,
    for each variable, the layout with it at its high end and the others at their low ends.

    Raises InputError if the designs change what all cases share, such as tables, or if such a
    parameter is not linear in the variables.
    """
    low, high, middle = map(box.layout_of, box.ends)
    if not all(_have_one_model(box.layout, layout) for layout in (low, high, middle, *single)):
        raise InputError(
            "vary: these designs change tables, outlines or the side to which a joint opens, "
            "which all cases of a run share; run each design with Campaign.with_settings"
        )
    layouts = [high, middle, *single]
    changes = [~_equal(layout.nominal, low.nominal) for layout in layouts]
    inputs = set(box.slots.tolist())
    for index in map(int, np.flatnonzero(np.any(changes, axis=0))):
        if index in inputs:
            continue
        start = float(low.nominal[index])
        slopes = tuple(float(layout.nominal[index]) - start for layout in single)
        number = DerivedNumber(index, start, slopes)
        for layout, share in ((high, 1.0), (middle, 0.5)):
            value, expected = number.at([share] * len(slopes)), float(layout.nominal[index])
            size = max(abs(start), abs(value), *map(abs, slopes))
            if not abs(value - expected) <= LEVEL * size:
                raise InputError(
                    "vary: the kernel needs a number that is computed from these parameters but is "
                    "not linear in them; run each design with Campaign.with_settings"
                )
        yield number


def _equal(a: np.ndarray, b: np.ndarray) -> np.ndarray:
    """Return the mask of equal elements of two arrays; NaN, which marks an unset number, equals
    NaN."""
    return np.asarray((a == b) | (np.isnan(a) & np.isnan(b)))


def _have_one_model(a: ParameterLayout, b: ParameterLayout) -> bool:
    """Return True if two layouts have the same structure, and the same tables and numbers that all
    cases share."""
    return (
        a.slots == b.slots
        and a.contents == b.contents
        and a.model.scene.tobytes() == b.model.scene.tobytes()
        and a.model.table.tobytes() == b.model.table.tobytes()
        and a.model.numbers.tobytes() == b.model.numbers.tobytes()
    )
