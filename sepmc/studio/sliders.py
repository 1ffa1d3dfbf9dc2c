"""Sliders of the page of `sepmc studio`: values and spreads of parameters, and the settings of the
campaign that their positions stand for."""

import math
import warnings
from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass, replace
from typing import TYPE_CHECKING, Any

import numpy as np

from sepmc.campaign.allocation import SCALED, scaled_distribution
from sepmc.campaign.design_box import design_variables
from sepmc.scene.dispersion import Dispersion, is_structure
from sepmc.scene.fields import allowed
from sepmc.scene.messages import InputError, SceneWarning
from sepmc.scene.parameters import Parameter, all_parameters, value
from sepmc.scene.units import unit_text

if TYPE_CHECKING:
    from sepmc.campaign.campaign import Campaign

_REACH = 3.0  # half range of a slider / half width of the distribution
_PART = 0.25  # half range of a slider / size of a value without distribution
_HALVINGS = 40


@dataclass(frozen=True)
class Slider:
    """Slider of a parameter: changes its value and, if it is dispersed, its spread.

    If the key names several parameters by ``*``, the slider changes all of them; value, unit and
    distribution are those of the first.

    Attributes
    ----------
    key : str
        TOML path with its unit; ``*`` stands for any name.
    unit : str
        Unit of the key; empty without one.
    value, low, high : float
        Nominal value in the file, and ends of the slider, in that unit.
    distribution : str
        Distribution in the file, as text; empty if the parameter is not dispersed.
    spread : str
        TOML path of the dispersed parameter if the spread of its distribution can be scaled and
        ``key`` names no other parameter; else empty.
    """

    key: str
    unit: str
    value: float
    low: float
    high: float
    distribution: str = ""
    spread: str = ""

    def as_json(self) -> dict[str, Any]:
        """Return the fields by name."""
        return asdict(self)


def available_keys(campaign: "Campaign") -> list[str]:
    """Return the keys of the parameters that can have a slider: finite numbers that may vary
    between cases (see `is_structure`), and whose distribution, if any, is neither discrete nor a
    column of a sample table."""
    numbers = all_parameters(campaign.scene, campaign.file.tree)
    dispersions = {d.parameter.path: d for d in campaign.file.dispersions}
    own = {path: one.parameter.key for path, one in dispersions.items()}
    return [
        own.get(one.path, one.key)
        for one in numbers
        if not is_structure(one.path)
        and math.isfinite(value(campaign.scene, one.path))
        and (one.path not in dispersions or _is_continuous(dispersions[one.path]))
    ]


def _is_continuous(dispersion: Dispersion) -> bool:
    """Return False for a discrete distribution and for a column of a sample table; True for any
    other, also a constant."""
    return not dispersion.column and dispersion.distribution != "discrete"


def first_sliders(
    campaign: "Campaign", vary: Mapping[str, tuple[float, float] | None]
) -> list[Slider]:
    """Return the sliders at the start: one for each key of ``vary``, with the ends given there
    unless None; if it is empty, one for each dispersed parameter that can have a slider. Raises
    InputError as `make_slider`."""
    if vary:
        return [make_slider(campaign, key, ends) for key, ends in vary.items()]
    return [
        make_slider(campaign, one.parameter.key)
        for one in campaign.file.dispersions
        if _is_continuous(one)
    ]


def make_slider(campaign: "Campaign", key: str, ends: tuple[float, float] | None = None) -> Slider:
    """Make the slider of a parameter, or of all those that a key with ``*`` names; it then shows
    the value and distribution of the first.

    Parameters
    ----------
    campaign : Campaign
    key : str
        TOML path with its unit; ``*`` stands for any name.
    ends : (float, float), optional
        Ends of the slider, in the unit of the key. If None, they are chosen three times as far from
        the value as the distribution reaches, or a quarter of the value to either side.

    Returns
    -------
    Slider

    Raises
    ------
    InputError
        If there is no such number; or one of those that the key names is not finite or the same in
        all cases by definition (see `is_structure`), or its distribution is discrete or a column of
        a sample table.
    """
    (variable,) = design_variables(campaign, {key: ends or (0.0, 1.0)})
    by_path = {d.parameter.path: d for d in campaign.file.dispersions}
    for one in variable.parameters:
        _check(campaign, key, one, by_path.get(one.path))
    parameter = variable.parameters[0]
    nominal = value(campaign.scene, parameter.path) / parameter.factor
    dispersion = by_path.get(parameter.path)
    low, high = ends or _ends(variable.parameters, nominal, dispersion)
    has_spread = dispersion and _has_spread(dispersion) and len(variable.parameters) == 1
    return Slider(
        key,
        unit_text(parameter.unit) if parameter.unit else "",
        nominal,
        low,
        high,
        dispersion.sentence.partition(": ")[2] if dispersion else "",
        dispersion.parameter.key if dispersion and has_spread else "",
    )


def _check(
    campaign: "Campaign", key: str, parameter: Parameter, dispersion: Dispersion | None
) -> None:
    """Raise InputError if a parameter that ``key`` names, of this ``dispersion``, cannot have a
    slider: it is the same in all cases by definition (`is_structure`), its nominal value is not
    finite, or its distribution is discrete or a column of a sample table."""
    name = key if parameter.key == key else f"{key}: {parameter.key}"
    if is_structure(parameter.path) or not math.isfinite(value(campaign.scene, parameter.path)):
        raise InputError(
            f"{name}: cannot have a slider: it must be a finite number that may vary between cases"
        )
    if dispersion and not _is_continuous(dispersion):
        reason = (
            "its distribution is discrete; give a continuous one, or none"
            if dispersion.weights
            else "a column of run.samples gives its values; leave the column out of that table"
        )
        raise InputError(f"{name}: cannot have a slider: {reason}")


def _ends(
    parameters: Sequence[Parameter], nominal: float, dispersion: Dispersion | None
) -> tuple[float, float]:
    """Return the ends (low, high) of a slider about a nominal value, in the unit of the key.

    They lie at a distance of three times half the width of the distribution's `reach`; without a
    distribution, or if that width is 0, of a quarter of the nominal value, or of 1 if the nominal
    value is 0. An end that one of the parameters does not allow is moved toward the nominal value
    until it is allowed.
    """
    half = _PART * abs(nominal) or 1.0
    if dispersion and dispersion.reach[0] < dispersion.reach[1]:
        half = _REACH * 0.5 * (dispersion.reach[1] - dispersion.reach[0])
    ends = []
    for end in (nominal - half, nominal + half):
        for _ in range(_HALVINGS):
            if all(
                one.field is None or allowed(one.field.type, np.array([end * one.factor]))[0]
                for one in parameters
            ):
                break
            end = 0.5 * (end + nominal)
        else:
            end = nominal
        ends.append(float(f"{end:.6g}"))
    return min(ends[0], nominal), max(ends[1], nominal)


def _has_spread(dispersion: Dispersion) -> bool:
    """Return True if the spread of a distribution can be scaled: it is of a kind in `SCALED`, wider
    than one value, and no column of a sample table."""
    return (
        dispersion.distribution in SCALED
        and not dispersion.column
        and dispersion.reach[0] < dispersion.reach[1]
    )


def moved_campaign(
    campaign: "Campaign", values: Mapping[str, float], spreads: Mapping[str, float]
) -> tuple["Campaign", dict[str, Any], list[str]]:
    """Return a campaign at the positions of its sliders.

    A distribution moves with the nominal value of its parameter, also if the file gives it by
    absolute numbers.

    Parameters
    ----------
    campaign : Campaign
        The campaign of the file.
    values : mapping of key to float
        Values of parameters, in the units of the keys.
    spreads : mapping of key to float
        Factors of the spreads of dispersed parameters, about their centres.

    Returns
    -------
    moved : Campaign
    settings : dict
        Values by TOML path with which `Campaign.with_settings` makes ``moved``.
    notes : list of str
        Warnings about ``moved``.

    Raises
    ------
    InputError
        If a key or a value is not allowed.
    """
    settings: dict[str, Any] = dict(values)
    moved, notes = changed_campaign(campaign, settings)
    if distributions := _distributions(campaign, moved, spreads):
        settings |= distributions
        moved, notes = changed_campaign(campaign, settings)
    return moved, settings, notes


def _distributions(
    campaign: "Campaign", at: "Campaign", spreads: Mapping[str, float]
) -> dict[str, Any]:
    """Return settings, distributions by TOML path, for two kinds of dispersed parameters: those
    with absolute numbers, which are shifted here by the change of the nominal value from
    ``campaign`` to the moved campaign ``at``; and those whose spread is multiplied by a factor of
    ``spreads``, by key. Raises InputError for a key of ``spreads`` without a spread."""
    known = {d.parameter.key for d in at.file.dispersions if _has_spread(d)}
    for key in spreads:
        if key not in known:
            raise InputError(f"{key}: has no distribution whose spread can be scaled")
    settings: dict[str, Any] = {}
    for before, one in zip(campaign.file.dispersions, at.file.dispersions, strict=True):
        key, path, own = one.parameter.key, one.parameter.path, one
        change = value(at.scene, path) - value(campaign.scene, path)
        is_absolute = change and one.numbers == before.numbers
        if is_absolute and one.distribution in (*SCALED, "constant"):
            own = _shifted(one, change / one.parameter.factor)
        factor = spreads.get(key, 1.0)
        if own.distribution == "constant":
            if own is not one:
                settings[f"dispersion.{key}"] = {"constant": own.numbers[0]}
        elif own is not one or factor != 1.0:
            settings[f"dispersion.{key}"] = scaled_distribution(own, factor)
    return settings


def _shifted(dispersion: Dispersion, change: float) -> Dispersion:
    """Return a dispersion whose distribution is moved by ``change``, in the unit of its key."""
    numbers = dispersion.numbers
    fixed = 1 if dispersion.distribution == "normal" else len(numbers)  # sigma and its limit stay
    shifted = tuple(x + change if k < fixed else x for k, x in enumerate(numbers))
    return replace(dispersion, numbers=shifted)


def changed_campaign(
    campaign: "Campaign", settings: Mapping[str, Any]
) -> tuple["Campaign", list[str]]:
    """Return a copy of the campaign with further ``settings``, values by TOML path that replace
    those of its file, and the warnings about the copy. Settings that it had before remain."""
    with warnings.catch_warnings(record=True) as caught:
        warnings.simplefilter("always", SceneWarning)
        return campaign.with_settings(dict(settings)), [str(one.message) for one in caught]
