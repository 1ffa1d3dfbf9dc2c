"""How a campaign is flown: by which kernel, in how many steps; found by flying a few cases at the corners of the dispersions first."""

import math
from collections.abc import Callable
from dataclasses import dataclass, field, replace
from types import ModuleType
from typing import TYPE_CHECKING

import numpy as np

from sepmc import cases, schema
from sepmc.compiler import shape
from sepmc.compiler.emit import emit
from sepmc.compiler.plan import make_plan
from sepmc.door import Block, fly_block, fly_specialised, specialised_kernel, warm_up
from sepmc.kernels.layout import NO_HISTORY, SEPARATION_HISTORY
from sepmc.scene.model import Scene
from sepmc.schema import Status

if TYPE_CHECKING:
    from sepmc.campaign import Campaign

CORNERS = 24  # cases flown besides the nominal one
_EDGE = 0.001  # of the probability: what counts as a corner of a dispersion
_SAFE = 0.5  # share of the accuracy asked for that the pilot's cases may use
_MOST_STEPS = 2048  # of a phase
_MAY_BE_LOST = 0.1  # of the pilot's cases may be left to the general kernel
_HALVINGS = 10
_SMALL = 1e-4  # of the largest outcome of the same unit: an outcome below counts as that large, since what it is made of cancels
SAMPLE = 64  # cases of a campaign that are flown again at twice the resolution

Say = Callable[[str], None]


@dataclass(frozen=True)
class Flight:
    """How a campaign is flown.

    ``why`` says why the general kernel flies it; ``steps`` (phases,) are those of the specialised kernel, for phases that usually
    last ``usual`` (phases,) s; ``step`` (s) is that of the general one; ``error`` is what the pilot found: the largest difference of
    an outcome to a reference, see `relative_error`.
    """

    why: list[str] = field(default_factory=list)
    kernel: ModuleType | None = None
    steps: np.ndarray | None = None
    usual: np.ndarray | None = None
    step: float | None = None
    error: float = np.nan

    def sharper(self) -> "Flight":
        """The same at twice the resolution."""
        if self.steps is not None:
            return replace(self, steps=2 * self.steps)
        return replace(self, step=0.5 * self.step) if self.step else self


def reasons(campaign: "Campaign") -> list[str]:
    """Why a campaign is flown by the general kernel; empty if a kernel of its own flies it."""
    return shape.reasons(campaign.plan, campaign.dispersed)


def kernel_text(campaign: "Campaign", method: str | None = None, history: bool = False) -> str:
    """The kernel written for a campaign, as a Python module."""
    return emit(shape.make_shape(campaign.plan, campaign.dispersed), method or campaign.scene.solver.method, history)


def corners(campaign: "Campaign") -> np.ndarray:
    """Draws (n, d), SI: every parameter in the middle, then at one of its ends, by fixed coin tosses. They do not depend on the seed."""
    dispersions = campaign.file.dispersions
    tosses = np.random.Generator(np.random.Philox(key=20)).integers(0, 2, (CORNERS, max(1, len(dispersions))))
    table = np.empty((CORNERS + 1, len(dispersions)), order="F")
    for i, dispersion in enumerate(dispersions):
        u = np.concatenate([[0.5], np.where(tosses[:, i] == 1, 1.0 - _EDGE, _EDGE)])
        if dispersion.parameter.path.endswith(".fails"):  # not a corner of anything
            u[:] = 0.5
        table[:, i] = cases.quantile(dispersion, u) * campaign.factors[i]
    return table


def relative_error(found: np.ndarray, reference: np.ndarray, units: list[str]) -> np.ndarray:
    """Largest difference of every outcome, (n, o) each, over its own size or, if that is larger, its standard deviation; (o,).

    Outcomes that are zero but for round-off count as 1e-4 of the largest of the same unit. NaN at the same place agrees.
    """
    if not len(found):
        return np.zeros(len(units))
    with np.errstate(invalid="ignore", divide="ignore"):
        difference = np.where(np.isnan(found) & np.isnan(reference), 0.0, np.abs(found - reference))
        size = np.abs(np.where(np.isnan(reference), 0.0, reference))
        largest = size.max(axis=0, initial=0.0)
        floor = np.array([_SMALL * max(x for x, other in zip(largest, units, strict=True) if other == unit) for unit in units])
        spread = np.std(np.where(np.isnan(reference), 0.0, reference), axis=0)
        scale = np.maximum(size, np.maximum(spread, floor))
        share = np.where(difference == 0.0, 0.0, difference / scale)
    return np.where(np.isnan(share), np.inf, share).max(axis=0, initial=0.0)


def plan_flight(campaign: "Campaign", history: bool = False, announce: Say | None = None) -> Flight:
    """Choose how to fly a campaign to the accuracy it asks for."""
    why = reasons(campaign)
    step = campaign.scene.solver.step
    if not why:
        kernel = specialised_kernel(kernel_text(campaign, history=history), announce)
        found = _choose_steps(campaign, kernel)
        if found is not None:
            return found
        why = ["its pilot: no number of steps made the corners agree with twice as many, to the accuracy asked"]
    warm_up(announce)
    return Flight(why, step=step) if step is not None else _choose_step(campaign, why)


def fly(campaign: "Campaign", flight: Flight, draws: np.ndarray, room: int = 0, announce: Say | None = None) -> Block:
    """Fly draws (n, d), SI. Cases that a specialised kernel cannot vouch for are flown again by the general one."""
    if flight.kernel is None or flight.steps is None or flight.usual is None:
        return _fly_general(campaign, flight.step, draws, room)
    block, _ = fly_specialised(flight.kernel, campaign.plan, flight.steps, flight.usual, campaign.slots, draws, room)
    lost = np.flatnonzero(block.status < 0)
    if len(lost):
        _fly_lost(campaign, flight, draws, room, block, lost, announce)
    return block


def _fly_lost(
    campaign: "Campaign", flight: Flight, draws: np.ndarray, room: int, block: Block, lost: np.ndarray, announce: Say | None
) -> None:
    """Fly the cases ``lost`` by the general kernel, into their rows of ``block``."""
    warm_up(announce)
    assert flight.steps is not None
    assert flight.usual is not None
    lasts = flight.usual > 0.0
    step = 0.5 * float(np.min(flight.usual[lasts] / flight.steps[lasts], initial=campaign.scene.run.end_time))
    again = _fly_general(campaign, step, draws[lost], room)
    block.outcomes[lost], block.status[lost] = again.outcomes, again.status
    if room:
        block.history[lost], block.rows[lost] = again.history, again.rows


def _fly_general(campaign: "Campaign", step: float | None, draws: np.ndarray, room: int) -> Block:
    """Fly draws by the general kernel; of its columns those that the campaign keeps: one flown by a specialised kernel has fewer audits."""
    width, level = (2 * len(campaign.plan.joints), SEPARATION_HISTORY) if room else (0, NO_HISTORY)
    block = fly_block(make_plan(campaign.scene, step=step, dispersed=campaign.dispersed), campaign.slots, draws, room, width, level)
    names = [c.name for c in schema.result_columns(replace(campaign.plan.contents, specialised=False))]
    return replace(block, outcomes=block.outcomes[:, [names.index(c.name) for c in campaign.result_columns]])


def _outcomes(campaign: "Campaign", block: Block) -> np.ndarray:
    return block.outcomes[:, : len(campaign.outcome_columns)]


def _units(campaign: "Campaign") -> list[str]:
    return [c.unit for c in campaign.outcome_columns]


def _choose_steps(campaign: "Campaign", kernel: ModuleType) -> Flight | None:
    """Fewest steps in every phase with which the corners come within the accuracy of a reference at many steps; None if none is found."""
    draws, units, goal = corners(campaign), _units(campaign), _SAFE * campaign.scene.solver.accuracy

    def flown(steps: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        block, ends = fly_specialised(kernel, campaign.plan, steps, usual, campaign.slots, draws)
        sound = block.status == 0
        if np.isinf(usual).any() and sound.any():
            usual[:] = np.diff(np.median(ends[:, sound], axis=1), prepend=0.0)
        return _outcomes(campaign, block), sound

    def error(steps: np.ndarray) -> float:
        """Infinite if more cases are lost than may be: the general kernel would fly them."""
        found, sound = flown(steps)
        both = sound & fair
        if np.count_nonzero(fair & ~sound) > _MAY_BE_LOST * len(draws) or not both.any():
            return np.inf
        return float(relative_error(found[both], reference[both], units).max())

    usual = np.full(len(campaign.scene.phase), np.inf)
    steps = np.full(len(campaign.scene.phase), 2, dtype=np.int64)
    reference, fair = flown(steps)
    settled = np.inf  # what halving the steps of the reference changes
    while settled > 0.02 * goal and 2 * steps.max() <= _MOST_STEPS:
        coarse, steps = steps, 2 * steps
        reference, fair = flown(steps)
        now = error(coarse)
        if goal >= settled <= now < np.inf:  # round-off
            break
        settled = min(settled, now)
    if settled > 2.0 * goal or not fair.mean() > 0.5:
        return None
    chosen = steps.copy()
    for phase in range(len(chosen)):  # each alone, the others as fine as the reference
        low, high = 0, int(steps[phase])
        while high - low > 1:
            trial = steps.copy()
            trial[phase] = middle = (low + high) // 2
            low, high = (low, middle) if error(trial) <= goal else (middle, high)
        chosen[phase] = high
    final = error(chosen)
    while final > goal and (chosen < steps).any():  # together: one more step where it helps most
        trials = [np.minimum(chosen + unit, steps) for unit in np.eye(len(chosen), dtype=np.int64)]
        errors = [error(trial) if (trial > chosen).any() else np.inf for trial in trials]
        if not min(errors) < np.inf:
            chosen, final = np.minimum(2 * chosen, steps), error(np.minimum(2 * chosen, steps))
            continue
        chosen, final = trials[int(np.argmin(errors))], min(errors)
    return Flight(kernel=kernel, steps=chosen, usual=usual, error=max(final, settled))


def _choose_step(campaign: "Campaign", why: list[str]) -> Flight:
    """Step of the general kernel at which halving it changes the corners by no more than the accuracy."""
    draws = corners(campaign)[:9]
    step, error = settled_step(campaign.scene, campaign.slots, draws, _units(campaign))
    return Flight(why, step=step, error=error)


def settled_step(scene: Scene, slots: np.ndarray, draws: np.ndarray, units: list[str]) -> tuple[float, float]:
    """Longest step, s, of the general kernel, of end time / 8, / 16, ..., at which the outcomes of some draws (n, d), SI, change by no
    more than the accuracy when it is halved; and by how much they do.

    Outcomes that no step settles (the time of a peak that is flat, say) do not count, unless none settles.
    """
    step, steps, changes, before = scene.run.end_time / 8.0, [], [], None
    for _ in range(_HALVINGS):
        block = fly_block(make_plan(scene, step=step), slots, draws, 0, 0, NO_HISTORY)
        now, ok = block.outcomes[:, : len(units)], np.isin(block.status, (Status.OK, Status.NEVER_RELEASED))
        if before is not None and (both := ok & before[1]).any():
            steps.append(2.0 * step)
            changes.append(relative_error(before[0][both], now[both], units))
            if changes[-1].max() <= scene.solver.accuracy:
                return steps[-1], float(changes[-1].max())
        before, step = (now, ok), 0.5 * step
    if not changes:
        return step, math.nan
    table = np.array(changes)
    settles = table.min(axis=0) <= scene.solver.accuracy
    largest = table[:, settles].max(axis=1) if settles.any() else table.max(axis=1)
    good = np.flatnonzero(largest <= scene.solver.accuracy)
    chosen = int(good[0]) if len(good) else int(np.argmin(largest))
    return steps[chosen], float(largest[chosen])


@dataclass(frozen=True)
class Achieved:
    """Error of a campaign: of every outcome, the largest over a sample flown again at twice the resolution."""

    asked: float
    errors: dict[str, float]
    cases: int

    @property
    def worst(self) -> tuple[str, float]:
        """The outcome with the largest error, and that."""
        name = max(self.errors, key=lambda n: self.errors[n])
        return name, self.errors[name]


def achieved(campaign: "Campaign", flight: Flight, draws: np.ndarray) -> Achieved:
    """Fly a sample of a campaign, draws (n, d) in SI, again at twice the resolution."""
    one, two = fly(campaign, flight, draws), fly(campaign, flight.sharper(), draws)
    both = (one.status == Status.OK) & (two.status == Status.OK)
    errors = relative_error(_outcomes(campaign, one)[both], _outcomes(campaign, two)[both], _units(campaign))
    names = [c.name for c in campaign.outcome_columns]
    return Achieved(campaign.scene.solver.accuracy, dict(zip(names, errors.tolist(), strict=True)), int(both.sum()))
