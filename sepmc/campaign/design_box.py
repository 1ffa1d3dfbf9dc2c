"""Box of designs: a campaign in which the varied parameters are dispersed over their ranges.

Kernel and steps are made for the box. Numbers that follow from a design, and are no inputs, are
linear in it, or the box is refused.
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
from sepmc.scene.dispersion import Dispersion
from sepmc.scene.messages import InputError, nearest, shorten
from sepmc.scene.parameters import Parameter, UnknownPath, find
from sepmc.scene.read import parse_campaign
from sepmc.scene.setting_checks import matching_keys

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
        As given: a TOML path, with its unit.
    low, high : float
        Ends of its range, in that unit.
    parameters : tuple of Parameter
        Several if the key has wildcards.
    """

    key: str
    low: float
    high: float
    parameters: tuple[Parameter, ...]

    def at(self, share: float) -> float:
        """Value at a fraction of the range: 0 is ``low``, 1 is ``high``."""
        return (1.0 - share) * self.low + share * self.high


def design_variables(campaign: Definition, vary: Any) -> tuple[DesignVariable, ...]:
    """Design variables, one for each entry of ``vary``: ranges (low, high) by TOML path, which may
    have wildcards.

    Raises
    ------
    InputError
        If a path names no number of the scene, a number is varied twice, or a range does not rise.
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
    """Lowest and highest value of the range ``ends`` of a path ``key``. Raises InputError."""
    try:
        low, high = (float(end) for end in ends)
    except (TypeError, ValueError):
        reason = f"must be the lowest and the highest value, as in {_EXAMPLE}"
        raise InputError(f"vary, {key} = {shorten(ends)}: {reason}") from None
    if not (math.isfinite(low) and math.isfinite(high) and low < high):
        raise InputError(f"vary, {key} = ({low:g}, {high:g}): must be finite, lowest value first")
    return low, high


def _parameters(campaign: Definition, key: str) -> Iterator[Parameter]:
    """Parameters that a path with wildcards names. Raises InputError."""
    keys = matching_keys(campaign.file.tree, key)
    if not keys:
        raise InputError(f"vary, {key}: no table has such a name")
    for one in keys:
        try:
            yield find(campaign.scene, one)
        except UnknownPath as error:
            raise InputError(f"vary, {one}: {error.args[0]}") from None


@dataclass(frozen=True)
class DerivedNumber:
    """Number of the parameter vector that follows from a design.

    ``index`` is its index there; ``start`` its value at the low end of all variables, ``slopes``
    its changes from the low to the high end of each variable, SI.
    """

    index: int
    start: float
    slopes: tuple[float, ...]

    def at(self, shares: Sequence[float]) -> float:
        """Value (SI) at fractions of the ranges of the design variables."""
        return self.start + sum(s * t for s, t in zip(self.slopes, shares, strict=True))


class DesignBox(Definition):
    """Campaign in which the varied parameters are dispersed uniformly over all their values.

    Attributes
    ----------
    variables : tuple of DesignVariable
    ends : tuple of Definition
        The campaign with all variables at their low ends, at their high ends, and half way.
    derived : tuple of DerivedNumber
    """

    variables: tuple[DesignVariable, ...]
    ends: tuple[Definition, Definition, Definition]
    derived: tuple[DerivedNumber, ...] = ()

    @classmethod
    def of(cls, campaign: Any, vary: Any) -> "DesignBox":
        """Box of a campaign, for ranges ``vary`` as in `design_variables`. Raises InputError or
        SceneError if the designs cannot share a kernel."""
        variables = design_variables(campaign, vary)
        low, high, middle = (
            campaign.with_settings({v.key: v.at(share) for v in variables})
            for share in (0.0, 1.0, 0.5)
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
            campaign.with_settings({w.key: w.high if w is v else w.low for w in variables})
            for v in variables
        ]
        box.derived = tuple(_derived_numbers(box, [box.layout_of(one) for one in single]))
        _check_signs(box)
        _check_distributions(box)
        return box

    def layout_of(self, definition: Definition) -> ParameterLayout:
        """Layout of the parameter vector, with the nominal values of a design."""
        return make_parameter_layout(definition.scene, self.dispersed)

    @cached_property
    def variable_of_column(self) -> dict[int, int]:
        """Index of the design variable, by the index of each input column that it gives."""
        columns = {d.parameter.path: k for k, d in enumerate(self.file.dispersions)}
        return {
            columns[parameter.path]: i
            for i, v in enumerate(self.variables)
            for parameter in v.parameters
        }

    @cached_property
    def slots_with_derived(self) -> np.ndarray:
        """Indices of the inputs, then of the derived numbers, in the parameter vector."""
        return np.append(self.slots, np.array([d.index for d in self.derived], dtype=np.int64))

    def check_designs(self, designs: np.ndarray) -> np.ndarray:
        """Return designs (m, variables), in the units of the variables, unchanged. Raises
        InputError if one is outside the box."""
        if designs.ndim != 2 or not len(designs) or designs.shape[1] != len(self.variables):
            keys = ", ".join(v.key for v in self.variables)
            raise InputError(f"design: needs {len(self.variables)} values, of {keys}")
        for k, v in enumerate(self.variables):
            outside = ~((v.low <= designs[:, k]) & (designs[:, k] <= v.high))
            if outside.any():
                value = designs[np.argmax(outside), k]
                reason = f"must lie in {v.low:g} to {v.high:g}, the box of this session"
                raise InputError(f"design, {v.key} = {value:g}: {reason}")
        return designs

    def values_of(self, design: Any) -> list[Any]:
        """Values of a design, given by key or in order, in the order of the variables. Raises
        InputError if a key is missing or not varied."""
        if not isinstance(design, Mapping):
            return list(np.atleast_1d(design))
        keys = [v.key for v in self.variables]
        for key in design:
            if key not in keys:
                raise InputError(f"design, {key}: is not varied; {nearest(str(key), keys)}")
        if missing := [key for key in keys if key not in design]:
            raise InputError(f"design: needs a value of {', '.join(missing)}")
        return [design[key] for key in keys]


def _extent(low: Dispersion, high: Dispersion) -> list[float]:
    """Lowest and highest value of a dispersed parameter whose nominal is varied, in the unit of its
    key; ``low`` and ``high`` are its distributions at the ends of the design variable."""
    u = np.array([_TAIL, 0.5, 1.0 - _TAIL])
    values = np.concatenate([quantile(low, u), quantile(high, u)])
    values = values[low.allowed(values)] if low.has_tails else values
    return [float(values.min()), float(values.max())]


def _check_signs(box: DesignBox) -> None:
    """Raise InputError if a joint opens to the other side than in the nominal scene anywhere in the
    box, or if the box has too many corners to try: the distance along the axis of the joint is
    linear in each variable, so its extremes are at corners."""
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
                    "at some of these designs; choose ranges on one side of it"
                )


def _check_distributions(box: DesignBox) -> None:
    """Raise InputError if the quantiles of a varied dispersed parameter do not change in proportion
    to the value of its design variable."""
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
    """Numbers other than inputs that follow from a design; ``single`` are the layouts with one
    variable at its high end.

    Raises InputError if a design changes what all cases share, or a number in no linear way.
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
                    "vary: a number that is computed from these parameters is not linear in them; "
                    "run each design with Campaign.with_settings"
                )
        yield number


def _equal(a: np.ndarray, b: np.ndarray) -> np.ndarray:
    """Mask of equal numbers; NaN, a number that is not set, equals NaN."""
    return np.asarray((a == b) | (np.isnan(a) & np.isnan(b)))


def _have_one_model(a: ParameterLayout, b: ParameterLayout) -> bool:
    """Return True if two layouts have the same structure and the same common numbers."""
    return (
        a.slots == b.slots
        and a.contents == b.contents
        and a.model.scene.tobytes() == b.model.scene.tobytes()
        and a.model.table.tobytes() == b.model.table.tobytes()
        and a.model.numbers.tobytes() == b.model.numbers.tobytes()
    )
