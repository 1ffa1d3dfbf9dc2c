"""Limits of a calibration: error indicators and angles up to which the errors of calibration cases
apply to other cases."""

import numpy as np

from sepmc.campaign.definition import Definition
from sepmc.campaign.execution.accuracy import SAFETY, SMALL, scene_scales
from sepmc.engine.dispatch import Block
from sepmc.schema import Status

# on indicators of calibration cases; errors grow by at most its power 5/3, and `SAFETY` covers that
_GROWTH = 1.25
_UNSEEN_IMPULSE = 0.05  # of the accuracy: error of an impulse by its polynomial that is neglected
# on indicators of joint loads: nodes resolve a load that rotates within a step only in part, and
# errors add up
_LOAD_GROWTH = 0.2


def indicator_limits(campaign: Definition, trials: Block) -> np.ndarray:
    """Upper limits (g,) of error indicators within which the calibration applies.

    Each is the largest indicator of the ok calibration cases (``trials``) times a margin, or a
    negligible value if that is larger.
    """
    assert trials.indicators is not None
    indicators = trials.indicators[(trials.status == Status.OK) & trials.has_indicators]
    speed, rate = (
        SMALL * campaign.scene.solver.accuracy * scene_scales(campaign.scene, ["m/s", "deg/s"])
    )
    negligible = np.zeros(trials.indicators.shape[1])
    n_of_states = 3 * len(campaign.layout.bodies)
    negligible[:n_of_states] = np.resize(
        [speed, rate * campaign.scene.run.end_time, rate], n_of_states
    )
    units, impulses = (
        [column.unit for column in campaign.outcome_columns],
        _impulse_indices(campaign),
    )
    sizes = np.abs(trials.outcomes[trials.status == Status.OK][:, impulses]).max(
        axis=0, initial=0.0
    )
    scene_scale = SMALL * scene_scales(campaign.scene, [units[k] for k in impulses])
    # indicators of joint loads come last
    growth, first_load = np.full(len(negligible), _GROWTH), len(negligible) - len(impulses)
    negligible[first_load:] = (
        _UNSEEN_IMPULSE * campaign.scene.solver.accuracy * np.maximum(sizes, scene_scale)
    )
    growth[first_load:] = _LOAD_GROWTH
    return np.maximum(growth * indicators.max(axis=0, initial=0.0), negligible)


def angle_limits(campaign: Definition, trials: Block) -> dict[int, float]:
    """Limits, rad, of sideslip and yaw, by outcome index, from calibration cases (``trials``):
    errors of alpha, pitch and roll grow as one over their cosine."""
    limits = {}
    for k, column in enumerate(campaign.outcome_columns):
        if column.name.endswith(("_beta_deg", "_yaw_deg")):
            sizes = np.abs(trials.outcomes[trials.status == Status.OK, k])
            limits[k] = float(np.arccos(np.cos(np.nanmax(sizes, initial=0.0)) / _GROWTH))
    return limits


def unseen_errors(campaign: Definition, trials: Block, scale: np.ndarray) -> np.ndarray:
    """Relative error (o,) that impulses can have although their indicators are below the
    negligible values of `indicator_limits`; 0 for other outcomes."""
    unseen, impulses = np.zeros(len(scale)), _impulse_indices(campaign)
    sizes = np.abs(trials.outcomes[trials.has_outcomes][:, impulses])
    omitted = _UNSEEN_IMPULSE * campaign.scene.solver.accuracy * sizes.max(axis=0, initial=0.0)
    unseen[impulses] = _relative_to_smallest(omitted / SAFETY, sizes, scale[impulses])
    return unseen


def direct_errors(campaign: Definition, trials: Block, scale: np.ndarray) -> np.ndarray:
    """Relative error (o, g) of impulses per unit of their indicator, due to the polynomials that
    are integrated; 0 elsewhere."""
    assert trials.indicators is not None
    impulses = _impulse_indices(campaign)
    direct = np.zeros((len(scale), trials.indicators.shape[1]))
    sizes = np.abs(trials.outcomes[trials.has_outcomes][:, impulses])
    columns = direct.shape[1] - len(impulses) + np.arange(len(impulses))
    direct[impulses, columns] = _relative_to_smallest(np.array(SAFETY), sizes, scale[impulses])
    return direct


def _impulse_indices(campaign: Definition) -> list[int]:
    """Indices of impulses among the outcomes: their indicators come last, in the same order."""
    return [
        k for k, column in enumerate(campaign.outcome_columns) if column.unit in ("N s", "N m s")
    ]


def _relative_to_smallest(amount: np.ndarray, sizes: np.ndarray, scale: np.ndarray) -> np.ndarray:
    """``amount`` (k,) over the smallest of the ``sizes`` (n, k) of each outcome in n cases, which
    are at least its ``scale`` (k,)."""
    smallest = np.maximum(sizes, scale).min(axis=0, initial=np.inf)
    return np.divide(amount, smallest, out=np.zeros(len(smallest)), where=smallest > 0.0)
