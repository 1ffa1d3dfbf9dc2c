"""How a campaign is flown once that is decided: by which kernel, in how many steps; and cases that its kernel cannot vouch for."""

from collections.abc import Callable
from dataclasses import dataclass, field, replace

import numpy as np

from sepmc.campaign.accuracy import SMALL, Achieved, decisive, errors, scene_scales
from sepmc.campaign.definition import Definition
from sepmc.campaign.settle import DOUBTFUL, TOO_LONG, Settled, first_step, fly_general, settle
from sepmc.door import Again, Block, fly_specialised, warm_up
from sepmc.kernels.kernel import Kernel
from sepmc.kernels.layout import ANOTHER_KERNEL, FINER_STEPS
from sepmc.scene.model import Scene
from sepmc.schema import Status

SAFE = 0.5  # share of the accuracy asked for that trial cases may use

Say = Callable[[str], None]


@dataclass(frozen=True)
class Spare:
    """A kernel for cases that the one of a flight does not vouch for: in it, joints may let go in any order. ``phases`` (stages,) are the
    numbers of the phases that the stages of the flight belong to."""

    make: Callable[["Say | None"], Kernel]
    phases: np.ndarray


@dataclass(frozen=True)
class Flight:
    """How a campaign is flown.

    ``why`` says why the general kernel flies it; ``steps`` (stages,) are those of the specialised kernel, for ``stages``
    (phases, and joints that are late in letting go) that usually last ``usual`` (stages,) s; ``step`` (s) is that of the
    general one, or the scene's own, which ``steps`` then divide. ``scale`` (o,) is what errors of small outcomes are taken relative to,
    see `sepmc.campaign.accuracy.errors`. ``limits`` (g,) are what guards of a case may be for trial cases to tell its
    error too (`Block.guards`), ``angles`` the same of the size, rad, of sideslip and yaw by their columns: at a right
    angle, alpha or pitch and roll turn about at once. ``error`` is the largest error of the trial cases, ``achieved``
    what is told of it, ``nominal`` (o,) the outcomes of the nominal case in SI, ``notes`` what a person should know. What the specialised
    kernel does not vouch for is left to a ``spare`` one, if there is one.
    """

    why: list[str] = field(default_factory=list)
    kernel: Kernel | None = None
    steps: np.ndarray | None = None
    usual: np.ndarray | None = None
    stages: list[str] = field(default_factory=list)
    step: float | None = None
    scale: np.ndarray | None = None
    limits: np.ndarray | None = None
    angles: dict[int, float] = field(default_factory=dict)
    error: float = np.nan
    achieved: Achieved | None = None
    nominal: np.ndarray | None = None
    notes: list[str] = field(default_factory=list)
    spare: Spare | None = None

    def by_spare(self, announce: Say | None) -> "Flight":
        """The same by the spare kernel, whose stages are the phases."""
        assert self.spare is not None
        assert self.steps is not None
        assert self.usual is not None
        kernel, phases = self.spare.make(announce), self.spare.phases
        steps = np.bincount(phases, self.steps, kernel.stages).astype(np.int64)
        return replace(self, kernel=kernel, steps=np.maximum(steps, 1), usual=np.bincount(phases, self.usual, kernel.stages), spare=None)

    def sharper(self, times: int = 2) -> "Flight":
        """The same at so many times the resolution."""
        steps, step = self.steps, self.step
        return replace(self, steps=None if steps is None else times * steps, step=None if step is None else step / times)


def fly(campaign: Definition, flight: Flight, draws: np.ndarray, room: int = 0, announce: Say | None = None) -> Block:
    """Fly draws (n, d), SI. Cases harder than any trial case, those that seem to leave a table or to jam and those that a specialised
    kernel does not vouch for are flown again at shorter steps; by the general one, if that does not tell."""
    block = fly_once(campaign, flight, draws, room)
    again, doubtful = Again(np.zeros(len(campaign.outcome_columns))), block.flown & ~_is_like_trials(flight, block)
    lost = np.flatnonzero(block.status < 0)
    if campaign.scene.solver.step is None:
        doubtful |= np.isin(block.status, (FINER_STEPS, *TOO_LONG)) | (np.isin(block.status, DOUBTFUL) & (flight.kernel is not None))
        lost = np.flatnonzero(block.status == ANOTHER_KERNEL)
    hard = np.flatnonzero(doubtful)
    if len(hard):
        again, unsettled = _fly_hard(campaign, flight, draws, room, block, hard)
        lost = np.union1d(lost, unsettled)
    if len(lost) and flight.spare is not None:
        more, lost = _fly_spare(campaign, flight.by_spare(announce), draws, room, block, lost)
        again = again.with_others(more)
    if len(lost):
        warm_up(announce)
        again = again.with_others(_fly_lost(campaign, flight, draws, room, block, lost))
    block.again = again
    return block


def history_rows(scene: Scene) -> int:
    """Rows of the stored history of a case."""
    return int(scene.run.end_time / scene.run.history_step + 1e-9) + 1


def fly_once(campaign: Definition, flight: Flight, draws: np.ndarray, room: int = 0) -> Block:
    """Fly draws at the flight's steps, and none of them again."""
    if flight.kernel is None or flight.steps is None or flight.usual is None:
        return fly_general(campaign, flight.step, draws, room)
    return fly_specialised(flight.kernel, campaign.plan, flight.steps, flight.usual, campaign.slots, draws, room)[0]


def _is_like_trials(flight: Flight, block: Block) -> np.ndarray:
    """Which cases (n,) are no harder to integrate than trial cases."""
    assert block.guards is not None
    if flight.limits is None:
        return np.ones(len(block.status), dtype=bool)
    like = block.guarded & (block.guards <= flight.limits).all(axis=1)
    for column, limit in flight.angles.items():
        like &= np.abs(block.outcomes[:, column]) <= limit
    return np.asarray(like)


def _fly_hard(
    campaign: Definition, flight: Flight, draws: np.ndarray, room: int, block: Block, hard: np.ndarray
) -> tuple[Again, np.ndarray]:
    """Fly the cases ``hard`` into their rows of ``block``, each at steps at which it has settled; with a step that is given, only to
    learn their error. Returns what is to be told of them, and those that a specialised kernel did not settle."""
    guarded = np.zeros(len(block.status), dtype=bool)

    def flown(share: float, which: np.ndarray) -> Block:
        found = fly_once(campaign, flight.sharper(round(1.0 / share)), draws[which], room)
        guarded[which] = found.guarded if flight.kernel is not None else True
        return found

    given = campaign.scene.solver.step is not None
    before = _rows(block, hard)
    found = _settle(campaign, flight, block, hard, 1.0, flown)
    held = found.settled & (np.isin(found.status, DOUBTFUL) | (block.flown & guarded)[hard])
    change = found.change
    if given:
        assert flight.scale is not None
        n = len(flight.scale)
        change = np.maximum(change, errors(before.outcomes[:, :n], block.outcomes[hard, :n], flight.scale))
        _put(block, hard, before)
    if flight.kernel is None:
        return Again(_largest(change), finer=len(hard), unsettled=0 if given else int(np.count_nonzero(~held))), hard[:0]
    return Again(_largest(change[held]), finer=int(np.count_nonzero(held))), hard[~held]


def _fly_spare(
    campaign: Definition, flight: Flight, draws: np.ndarray, room: int, block: Block, lost: np.ndarray
) -> tuple[Again, np.ndarray]:
    """Fly the cases ``lost`` by the spare kernel, whose ``flight`` this is, into their rows of ``block``. Returns what is to be told of
    them, and those that it does not vouch for either."""
    if campaign.scene.solver.step is not None:
        _put(block, lost, fly_once(campaign, flight, draws[lost], room))
        return Again(np.zeros(len(campaign.outcome_columns))), lost[block.status[lost] < 0]
    return _fly_hard(campaign, flight, draws, room, block, lost)


def _fly_lost(campaign: Definition, flight: Flight, draws: np.ndarray, room: int, block: Block, lost: np.ndarray) -> Again:
    """Fly the cases ``lost`` by the general kernel into their rows of ``block``, each at a step at which it has settled."""
    assert flight.kernel is not None
    assert flight.steps is not None
    assert flight.usual is not None
    lasts, first = flight.usual > 0.0, first_step(campaign.scene, campaign.file.dispersions)
    step = flight.step or float(np.min((flight.usual / flight.steps)[lasts], initial=first))
    found = _settle(campaign, flight, block, lost, step, lambda step, which: fly_general(campaign, step, draws[which], room))
    ok = np.isin(found.status, (Status.OK, Status.NEVER_RELEASED))
    return Again(_largest(found.change[ok]), left=lost, unsettled=int(np.count_nonzero(ok & ~found.settled)))


def _settle(
    campaign: Definition, flight: Flight, block: Block, which: np.ndarray, step: float, flown: Callable[[float, np.ndarray], Block]
) -> Settled:
    """Fly cases into their rows of a block, by ``flown`` (step, cases), at half the step and so on until they have settled."""
    columns = campaign.outcome_columns

    def fly_some(step: float, some: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        again = flown(step, which[some])
        _put(block, which[some], again)
        return again.outcomes[:, : len(columns)].copy(), np.where((again.status < 0) | again.turns_unclear, Status.UNRESOLVED, again.status)

    scale = SMALL * scene_scales(campaign.scene, [c.unit for c in columns]) if flight.scale is None else flight.scale
    return settle(fly_some, len(which), step, SAFE * campaign.scene.solver.accuracy, scale, decisive(columns))


def _rows(block: Block, which: np.ndarray) -> Block:
    """Some rows of a block."""
    guards = None if block.guards is None else block.guards[which]
    return Block(
        block.outcomes[which], block.status[which], block.times[which], block.phases[which], block.history[which], block.rows[which], guards
    )


def _put(block: Block, which: np.ndarray, rows: Block) -> None:
    """Put the rows of a block in place of some of another."""
    block.outcomes[which], block.status[which] = rows.outcomes, rows.status
    block.history[which], block.rows[which] = rows.history, rows.rows
    if block.guards is not None and rows.guards is not None and block.guards.shape[1] == rows.guards.shape[1]:
        block.guards[which] = rows.guards


def _largest(change: np.ndarray) -> np.ndarray:
    """Largest of the changes (n, o) of every outcome."""
    return np.asarray(change.max(axis=0, initial=0.0))
