"""The same scenes by the kernels that are written for them, as plain Python: their outcomes."""

import math
from typing import Any

import numpy as np
import pandas as pd

from sepmc import schema
from sepmc.campaign import pilot
from sepmc.campaign.accuracy import scene_scales
from sepmc.campaign.campaign import Campaign, Result
from sepmc.campaign.pilot import kernel_text, reasons
from sepmc.compiler.shape import make_shape
from sepmc.door import fly_specialised, interpreted, specialised_kernel
from sepmc.scene.read import parse_campaign
from sepmc.schema import Status
from sepmc.trust.flights import SIZES, Array, Flight

WRITTEN = "written"  # beside "general": what is said of a flight by a kernel written for its scene
LEFT = "left to general"  # status of a case that a written kernel does not vouch for; a campaign flies it by the general one
UNMET = "accuracy not met"  # status of a case that goes on changing as its steps are halved; a run says so
_FLOWN = (Status.OK, Status.NEVER_RELEASED)
_DOUBLINGS = 4
_STEP = 0.01  # s, where the scene has none
_CORNERS, _SAMPLE = 3, 24  # trial cases of the pilot, in plain Python


def as_written(flown: Campaign) -> Campaign:
    """A campaign without its fixed step: each of its phases then has a number of steps."""
    solver = {key: value for key, value in flown.file.tree.get("solver", {}).items() if key != "step_s"}
    return Campaign(parse_campaign({**flown.file.tree, "solver": solver}, flown.name, None))


class Written(Flight):
    """The nominal case of a campaign in steps as long as the scene's; if ``settled``, in the first of half, a quarter, ... that length at
    which the last halving changed no outcome by more than the accuracy asked.

    ``history`` has one row, at the end, with every outcome under its public name: angles, rates, separation. Places, velocities and joint
    forces are not written. What the kernel does not vouch for is flown by the one in which joints let go in any order.
    """

    kernel = WRITTEN

    def __init__(self, flown: Campaign, settled: bool = False):
        self._fly(flown, settled, False)
        if self.status == LEFT and pilot.spare(as_written(flown)):
            self._fly(flown, settled, True)

    def _fly(self, flown: Campaign, settled: bool, any_order: bool) -> None:
        campaign = as_written(flown)
        self.scene = campaign.scene
        self.t = np.array([self.scene.run.end_time])
        columns = schema.result_columns(campaign.plan.contents)
        steps, usual = _steps(campaign, flown.scene.solver.step or _STEP, any_order)
        outcomes, status, _ = _fly(campaign, steps, usual, any_order)
        unmet = False
        for _ in range(_DOUBLINGS if settled and status in _FLOWN else 0):
            steps, before = 2 * steps, outcomes
            outcomes, status, _ = _fly(campaign, steps, usual, any_order)
            count = len(campaign.outcome_columns)
            unmet = _change(before[:count], outcomes[:count], campaign) > self.scene.solver.accuracy
            if not (status in _FLOWN and unmet):
                break
        self.outcomes: dict[str, Any] = {c.name: float(x * c.scale) for c, x in zip(columns, outcomes, strict=True)}
        self.history = pd.DataFrame({"time_s": self.t, **self.outcomes})
        self.status = LEFT if status < 0 else UNMET if unmet else Status(status).label

    def places(self, name: str) -> tuple[Array, Array]:
        """Not written: NaN."""
        unknown = np.full((len(self.t), 3), math.nan)
        return unknown, unknown


def _fly(campaign: Campaign, steps: Array, usual: Array, any_order: bool) -> tuple[Array, int, Array]:
    """The nominal case in so many steps (phases,) of phases that usually last ``usual`` (phases,), s: its outcomes (o,), its status, less
    than 0 if the kernel does not vouch for it, and the times (phases,) at which phases end."""
    with interpreted():
        kernel = specialised_kernel(kernel_text(campaign, any_order=any_order))
    block, reached = fly_specialised(kernel, campaign.plan, steps, usual, np.empty(0, dtype=np.int64), np.empty((1, 0)))
    return block.outcomes[0], int(block.status[0]), reached[:, 0]


def _steps(campaign: Campaign, step: float, any_order: bool) -> tuple[Array, Array]:
    """Numbers of steps of a length, s, in all phases, and how long phases last, s. A flight in steps that know nothing of when
    phases end tells that; if it does not come to its end, they stay unknown, and there are as many steps as fit in the whole flight."""
    stages = len(make_shape(campaign.plan, campaign.dispersed, any_order).stages)
    steps, usual = np.full(stages, max(2, math.ceil(campaign.scene.run.end_time / step - 1e-9))), np.full(stages, math.inf)
    if stages > 1:
        _, status, reached = _fly(campaign, steps, usual, any_order)
        if status in _FLOWN:
            usual = np.diff(reached, prepend=0.0)
            steps = np.maximum(2, np.ceil(usual / step - 1e-9)).astype(np.int64)
    return steps, usual


def _change(before: Array, after: Array, campaign: Campaign) -> float:
    """Largest change of an outcome, over the largest outcome of its unit or what counts as large."""
    units = {column.unit for column in campaign.outcome_columns}.difference(SIZES)
    size = SIZES | dict(zip(units, scene_scales(campaign.scene, units).tolist(), strict=True))
    for column, value in zip(campaign.outcome_columns, after, strict=True):
        size[column.unit] = max(size[column.unit], abs(float(value * column.scale))) if np.isfinite(value) else size[column.unit]
    worst = 0.0
    for column, x, y in zip(campaign.outcome_columns, before, after, strict=True):
        change = 0.0 if np.isnan(x) and np.isnan(y) else abs(float((x - y) * column.scale)) / size[column.unit]
        worst = max(worst, math.inf if np.isnan(change) else change)
    return worst


def fly_interpreted(flown: Campaign, cases: int) -> Result:
    """Run a campaign, its written kernel as plain Python. The pilot then has few trial cases, for each takes as long as a case.

    Raises
    ------
    ValueError
        If its pilot left the campaign to the general kernel.
    """
    usual = pilot.CORNERS, pilot.SAMPLE
    pilot.CORNERS, pilot.SAMPLE = _CORNERS, _SAMPLE
    try:
        with interpreted():
            result = flown.run(cases=cases)
    finally:
        pilot.CORNERS, pilot.SAMPLE = usual
    if result.flight is None or result.flight.kernel is None:
        raise ValueError(f"{flown.name}: left to the general kernel")
    return result


def both(flown: Campaign, every: float = 0.01, settled: bool = False) -> list[Flight]:
    """A campaign's nominal case by the general kernel, with a history, and by a kernel written for it, if there can be one."""
    general: list[Flight] = [Flight(flown, every)]
    return general if reasons(as_written(flown)) else [*general, Written(flown, settled)]
