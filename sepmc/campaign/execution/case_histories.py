"""Full histories of many cases of a campaign on one time grid."""

from collections.abc import Callable, Sequence

import msgspec
import numpy as np

from sepmc import schema
from sepmc.campaign.definition import Definition
from sepmc.campaign.execution.single_case import SingleCase, simulate_case, simulate_cases
from sepmc.campaign.execution.step_selection import kernel_spec
from sepmc.scene.messages import Log
from sepmc.schema import Status


def case_histories(
    campaign: Definition,
    numbers: Sequence[int],
    names: Sequence[str],
    times: np.ndarray,
    seed: int,
    total: int,
    announce: Log | None = None,
    progress: Callable[[int], None] | None = None,
) -> np.ndarray:
    """Simulate cases of a run again, and interpolate columns of their histories.

    Parameters
    ----------
    campaign : Definition
    numbers : sequence of int
        Case numbers; -1 is the nominal case.
    names : sequence of str
        Columns of `sepmc.schema.history_columns`.
    times : ndarray, shape (t,)
        At least two, evenly spaced from 0, s.
    seed, total : int
        Seed of the run, and number of cases of its sample.
    announce : Log, optional
        Called with a message if the kernel is compiled.
    progress : callable (n_done), optional
        Called with the number of cases done, after each case.

    Returns
    -------
    ndarray, shape (cases, names, t)
        In the units of the columns; NaN after the end of a case, and for a failed case.
    """
    columns = schema.history_columns(campaign.layout.contents)
    indices = [[c.name for c in columns].index(name) for name in names]
    scales = np.array([columns[i].scale for i in indices])
    spec, step = kernel_spec(campaign), float(times[1] - times[0])
    histories = np.full((len(numbers), len(names), len(times)), np.nan)
    vectors = (_parameter_vector(campaign, number, seed, total) for number in numbers)
    for k, result in enumerate(simulate_cases(spec, vectors, step, announce)):
        if result is None:
            result = _simulate_alone(campaign, numbers[k], step, seed, total)
        if result.status <= Status.NEVER_RELEASED:
            for i, (index, scale) in enumerate(zip(indices, scales, strict=True)):
                rows = result.rows[:, index] * scale
                histories[k, i] = np.interp(times, result.times, rows, right=np.nan)
        if progress:
            progress(k + 1)
    return histories


def _parameter_vector(campaign: Definition, number: int, seed: int, total: int) -> np.ndarray:
    """Parameter vector (p,) of the kernel for a case, SI; ``number`` -1 is the nominal case."""
    vector = campaign.layout.nominal.copy()
    if number >= 0:
        vector[campaign.slots] = campaign.in_si(campaign.sample(number, 1, seed, total))[0]
    return vector


def _simulate_alone(
    campaign: Definition, number: int, step: float, seed: int, total: int
) -> SingleCase:
    """Simulate a case, which the kernel of the campaign rejects, by a kernel of its own; ``step``
    is the time, s, between rows of the history."""
    case = campaign.nominal() if number < 0 else campaign.case(number, seed, total)
    run = msgspec.structs.replace(case.scene.run, seed=seed)
    scene = msgspec.structs.replace(case.scene, run=run)
    return simulate_case(scene, campaign.layout.contents, step)
