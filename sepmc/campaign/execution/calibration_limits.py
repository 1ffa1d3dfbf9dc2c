"""Limits of a calibration: error indicators and angles up to which the error model, which is fitted
to calibration cases, applies to other cases.

An error indicator is a number that a kernel computes for each case from its steps: it grows with
the error.
"""

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
    """Upper limit (g,) of each of the g error indicators of a case: beyond any of them the case is
    outside the calibration.

    A limit is the largest value in the ok calibration cases times a factor (1.25; 0.2 for
    indicators of joint loads), or a negligible value if that is larger. ``trials`` are the results
    of the calibration cases, which must have error indicators.
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
    """Largest absolute sideslip and yaw angle, rad, of a case within the calibration, by index of
    the outcome.

    Errors of alpha, pitch and roll grow as one over the cosine of these angles. A limit is the
    angle at which that is 1.25 times as large as in any ok calibration case (cases in which the
    angle is NaN are left out). ``trials`` are the results of the calibration cases.
    """
    limits = {}
    for k, column in enumerate(campaign.outcome_columns):
        if column.name.endswith(("_beta_deg", "_yaw_deg")):
            sizes = np.abs(trials.outcomes[trials.status == Status.OK, k])
            limits[k] = float(np.arccos(np.cos(np.nanmax(sizes, initial=0.0)) / _GROWTH))
    return limits


def unseen_errors(campaign: Definition, trials: Block, scale: np.ndarray) -> np.ndarray:
    """Relative error (o,) that an impulse (time integral of a joint load) can have although its
    error indicator is below the negligible value of `indicator_limits`; 0 for other outcomes. It is
    divided by `SAFETY`, as errors of calibration cases are multiplied by that later.

    ``trials`` are the results of the calibration cases, ``scale`` (o,) the scales of the outcomes
    (`sepmc.campaign.execution.accuracy.scales`).
    """
    unseen, impulses = np.zeros(len(scale)), _impulse_indices(campaign)
    sizes = np.abs(trials.outcomes[trials.has_outcomes][:, impulses])
    omitted = _UNSEEN_IMPULSE * campaign.scene.solver.accuracy * sizes.max(axis=0, initial=0.0)
    unseen[impulses] = _relative_to_smallest(omitted / SAFETY, sizes, scale[impulses])
    return unseen


def direct_errors(campaign: Definition, trials: Block, scale: np.ndarray) -> np.ndarray:
    """Relative error of each outcome per unit of each error indicator, shape (o, g): 0
    except for an impulse (time integral of a joint load) and the indicator of that impulse.

    Over each step, a kernel represents the load by a polynomial; the indicator is the largest error
    of its integral over a step, in the unit of the impulse. The result is `SAFETY` divided by the
    smallest size of the impulse in the calibration cases that have outcomes (`Block.has_outcomes`).
    ``trials`` are the results of these cases, with error indicators; a size below the scale of the
    outcome, from ``scale`` (o,), counts as that scale.
    """
    assert trials.indicators is not None
    impulses = _impulse_indices(campaign)
    direct = np.zeros((len(scale), trials.indicators.shape[1]))
    sizes = np.abs(trials.outcomes[trials.has_outcomes][:, impulses])
    columns = direct.shape[1] - len(impulses) + np.arange(len(impulses))
    direct[impulses, columns] = _relative_to_smallest(np.array(SAFETY), sizes, scale[impulses])
    return direct


def _impulse_indices(campaign: Definition) -> list[int]:
    """Indices of the impulses (N s, N m s) among the outcomes. The last error indicators of a case
    are those of the impulses, in the same order."""
    return [
        k for k, column in enumerate(campaign.outcome_columns) if column.unit in ("N s", "N m s")
    ]


def _relative_to_smallest(amount: np.ndarray, sizes: np.ndarray, scale: np.ndarray) -> np.ndarray:
    """``amount`` (k,) divided by the smallest size of each of k outcomes over n cases.

    ``sizes`` (n, k) are absolute values; a size below the ``scale`` (k,) of its outcome counts as
    that scale. The result is 0 where the smallest size is 0 or there are no cases.
    """
    smallest = np.maximum(sizes, scale).min(axis=0, initial=np.inf)
    return np.divide(amount, smallest, out=np.zeros(len(smallest)), where=smallest > 0.0)
