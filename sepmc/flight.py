"""How a campaign is flown once that is decided: by which kernel, in how many steps; and cases that its kernel cannot vouch for."""

from collections.abc import Callable
from dataclasses import dataclass, field, replace
from typing import TYPE_CHECKING

import numpy as np

from sepmc.accuracy import Achieved, decisive, scene_scales
from sepmc.door import Block, Lost, fly_specialised, warm_up
from sepmc.schema import Status
from sepmc.settle import first_step, fly_general, settle

if TYPE_CHECKING:
    from sepmc.campaign import Campaign
    from sepmc.kernels.pieces import Kernel

SAFE = 0.5  # share of the accuracy asked for that trial cases may use

Say = Callable[[str], None]


@dataclass(frozen=True)
class Flight:
    """How a campaign is flown.

    ``why`` says why the general kernel flies it; ``steps`` (phases,) are those of the specialised kernel, for phases that usually
    last ``usual`` (phases,) s; ``step`` (s) is that of the general one. ``scale`` (o,) is what errors of small outcomes are taken
    relative to, see `sepmc.accuracy.errors`. ``error`` is the largest error of the trial cases, ``achieved`` what is told of it,
    ``nominal`` (o,) the outcomes of the nominal case in SI, ``notes`` what a person should know.
    """

    why: list[str] = field(default_factory=list)
    kernel: "Kernel | None" = None
    steps: np.ndarray | None = None
    usual: np.ndarray | None = None
    step: float | None = None
    scale: np.ndarray | None = None
    error: float = np.nan
    achieved: Achieved | None = None
    nominal: np.ndarray | None = None
    notes: list[str] = field(default_factory=list)

    def sharper(self) -> "Flight":
        """The same at twice the resolution."""
        if self.steps is not None:
            return replace(self, steps=2 * self.steps)
        return replace(self, step=0.5 * self.step) if self.step else self


def fly(campaign: "Campaign", flight: Flight, draws: np.ndarray, room: int = 0, announce: Say | None = None) -> Block:
    """Fly draws (n, d), SI. Cases that a specialised kernel cannot vouch for are flown again by the general one; those with a draw
    that is not finite by none."""
    if flight.kernel is None or flight.steps is None or flight.usual is None:
        return fly_general(campaign, flight.step, draws, room)
    block, _ = fly_specialised(flight.kernel, campaign.plan, flight.steps, flight.usual, campaign.slots, draws, room)
    lost = np.flatnonzero(block.status < 0)
    fit = np.isfinite(draws[lost]).all(axis=1)
    block.outcomes[lost[~fit]], block.status[lost[~fit]], block.rows[lost[~fit]] = np.nan, Status.INVALID_INPUT, 0
    lost = lost[fit]
    if len(lost):
        warm_up(announce)
        block.lost = _fly_lost(campaign, flight, draws, room, block, lost)
    return block


def _fly_lost(campaign: "Campaign", flight: Flight, draws: np.ndarray, room: int, block: Block, lost: np.ndarray) -> Lost:
    """Fly the cases ``lost`` by the general kernel into their rows of ``block``, each at a step at which it has settled."""
    assert flight.steps is not None
    assert flight.usual is not None
    columns = campaign.outcome_columns

    def flown(step: float, which: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        cases = lost[which]
        again = fly_general(campaign, step, draws[cases], room)
        block.outcomes[cases], block.status[cases] = again.outcomes, again.status
        if room:
            block.history[cases], block.rows[cases] = again.history, again.rows
        return again.outcomes[:, : len(columns)].copy(), again.status

    lasts = flight.usual > 0.0
    step = float(np.min(flight.usual[lasts] / flight.steps[lasts], initial=first_step(campaign.scene)))
    scale = 1e-4 * scene_scales(campaign.scene, [c.unit for c in columns]) if flight.scale is None else flight.scale
    found = settle(flown, len(lost), step, SAFE * campaign.scene.solver.accuracy, scale, decisive(columns))
    ok = np.isin(found.status, (Status.OK, Status.NEVER_RELEASED))
    return Lost(lost, int(np.count_nonzero(ok & ~found.settled)), found.change[ok].max(axis=0, initial=0.0))
