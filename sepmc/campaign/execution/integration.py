"""How a campaign is flown once that is decided: by which kernel, in how many steps; and cases that
its kernel cannot vouch for."""

from collections.abc import Callable
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np

from sepmc.campaign.definition import Definition
from sepmc.campaign.execution.accuracy import (
    SAFETY,
    SMALL,
    AchievedAccuracy,
    decisive,
    errors,
    scene_scales,
)
from sepmc.campaign.execution.error_estimate import Estimate
from sepmc.campaign.execution.step_refinement import (
    AGREEMENTS,
    DOUBTFUL,
    HALVINGS,
    TOO_LONG,
    Converged,
    refine_steps,
)
from sepmc.engine.dispatch import Block, RefinementSummary, integrate_cases, status_in
from sepmc.engine.written_kernel import Kernel
from sepmc.kernel.spec.methods import method
from sepmc.kernel.spec.variant import Variant
from sepmc.routines.layout import (
    BODY_OUTCOMES,
    FINER_STEPS,
    FLOW_ANGLES,
)
from sepmc.scene.messages import Log
from sepmc.scene.model import Scene
from sepmc.schema import Status

SAFE = 0.5  # share of the accuracy asked for that trial cases may use
_TO_LEARN = 64  # times finer steps tell how long the phases of a case last
_AT_ONCE = 1e-9  # of a flight
_MOST_LOST = 3  # halvings of the step of a case that is lost, where a spare kernel may fly it
_NO_CALLS = np.zeros(0, dtype=np.int64)
EVERY_S = 10.0  # between two words on how far trial cases or a single flight are


@dataclass(frozen=True)
class FallbackKernel:
    """A kernel for cases that the one of a flight does not vouch for, because it takes more
    ``care``: a `Variant` of the kernel. ``phases``
    (stages,) are the numbers of the phases that the stages of the flight belong to."""

    variant: int
    make: Callable[["Log | None"], Kernel]
    phases: np.ndarray


@dataclass(frozen=True)
class Integration:
    """How a campaign is flown.

    ``steps`` (stages,) are those of its ``kernel``, by the ``methods`` (stages,) of these numbers,
    or the most exact ones, for ``stages`` (phases, and joints that are
    late in letting go) that usually last ``usual`` (stages,) s; ``step`` (s) is the scene's own,
    which ``steps`` then divide. ``scale`` (o,) is what errors of small outcomes are taken relative
    to, see `sepmc.campaign.execution.accuracy.errors`. ``limits`` (g,) are what guards of a case
    may be for trial cases to tell its error too (`Block.indicators`), ``angles`` the same of the
    size, rad, of sideslip and yaw by their columns: at a right angle, alpha or pitch and roll
    turn about at once. Within these the ``estimate`` tells what the error of a case is; more
    than ``most`` is too much. ``error`` is the largest error of the trial cases, ``achieved``
    what is told of it, ``nominal`` (o,) the outcomes of the nominal case in SI, ``notes`` what
    a person should know. What the kernel does not vouch for is left to ``spares``, one after
    the other; it takes some ``care`` itself."""

    kernel: Kernel
    steps: np.ndarray
    durations: np.ndarray
    stages: list[str] = field(default_factory=list)
    step: float | None = None
    scale: np.ndarray | None = None
    limits: np.ndarray | None = None
    angles: dict[int, float] = field(default_factory=dict)
    estimate: Estimate | None = None
    most: float = np.inf
    error: float = np.nan
    achieved: AchievedAccuracy | None = None
    nominal: np.ndarray | None = None
    notes: list[str] = field(default_factory=list)
    fallbacks: tuple[FallbackKernel, ...] = ()
    methods: np.ndarray | None = None
    variant: int = Variant.STANDARD

    def __getstate__(self) -> dict[str, Any]:
        """What a copy holds, in another process too: `packed`."""
        return {**vars(self), "fallbacks": ()}

    @property
    def packed(self) -> "Integration":
        """The same without what another process has to load for itself; see `pilot.unpacked`."""
        return replace(self, kernel=replace(self.kernel, address=0, table=_NO_CALLS), fallbacks=())

    @property
    def method_names(self) -> list[str]:
        """Names of the methods by which the stages are flown."""
        numbers = np.zeros(self.kernel.n_segments, int) if self.methods is None else self.methods
        return [names[number] for names, number in zip(self.kernel.methods, numbers, strict=True)]

    @property
    def one_method(self) -> str | None:
        """The name of the method by which all stages are flown; None if there are several."""
        names = set(self.method_names)
        return names.pop() if len(names) == 1 else None

    @property
    def evaluations(self) -> int:
        """How many a case takes; with a step that is given, only in proportion."""
        return sum(
            int(steps) * method(name).stages
            for steps, name in zip(self.steps, self.method_names, strict=True)
        )

    @property
    def has_any_order_fallback(self) -> bool:
        """Whether a spare kernel lets cases go each at their own pace, which tells more of a case
        in which an event comes late than ever finer steps."""
        return any(fallback.variant == Variant.ANY_ORDER for fallback in self.fallbacks)

    def by(self, fallback: FallbackKernel, announce: Log | None) -> "Integration":
        """The same by a spare kernel, whose stages are the phases."""
        kernel = fallback.make(announce)
        steps = np.bincount(fallback.phases, self.steps, kernel.n_segments).astype(np.int64)
        durations = np.bincount(fallback.phases, self.durations, kernel.n_segments)
        return replace(
            self,
            kernel=kernel,
            steps=np.maximum(steps, 1),
            durations=durations,
            fallbacks=(),
            methods=None,
        )

    def refined(self, times: int = 2) -> "Integration":
        """The same at so many times the resolution."""
        return replace(
            self, steps=times * self.steps, step=None if self.step is None else self.step / times
        )


def by_name(kernel: Kernel, names: list[str]) -> np.ndarray:
    """Numbers (stages,) of the methods with these names in a kernel; of the most exact ones where
    it has not got them."""
    pairs = zip(kernel.methods, names, strict=True)
    return np.array([has.index(name) if name in has else 0 for has, name in pairs], dtype=np.int64)


def integrate(
    campaign: Definition,
    flight: Integration,
    draws: np.ndarray,
    room: int = 0,
    announce: Log | None = None,
) -> Block:
    """Fly draws (n, d), SI. Cases harder than any trial case or with too large an error, those that
    seem to leave a table or to jam and those that the kernel does not vouch for are flown again at
    shorter steps; by spare kernels, if that does not tell. What none vouches for has no
    outcomes."""
    block = integrate_once(campaign, flight, draws, room)
    like = _is_like_trials(flight, block)
    told = _estimated(campaign, flight, block, like)
    beyond = like & (block.error > flight.most)
    hard = _doubtful(campaign, block) | (block.has_outcomes & ~like)
    summary = told.merged(
        _fly_hard(campaign, flight, draws, room, block, np.flatnonzero(beyond & ~hard), 1)
    ).merged(_fly_hard(campaign, flight, draws, room, block, np.flatnonzero(hard)))
    bodies = len(campaign.plan.bodies)
    for fallback in flight.fallbacks:
        finite = motion_is_finite(block.outcomes, bodies)
        lost = np.flatnonzero(helped(block.status, fallback.variant, finite))
        if len(lost):
            other = flight.by(fallback, announce)
            _put(block, lost, integrate_once(campaign, other, draws[lost], room))
            hard = (_doubtful(campaign, block) | block.has_outcomes)[lost]
            summary = summary.merged(_fly_hard(campaign, other, draws, room, block, lost[hard]))
            summary.n_fallback += len(lost)
    lost = np.flatnonzero(block.status < 0)
    finite = motion_is_finite(block.outcomes[lost], bodies)
    block.status[lost] = final_status(block.status[lost], finite)
    # the audit stays
    block.outcomes[lost, : len(campaign.outcome_columns)], block.rows[lost] = np.nan, 0
    block.refinement = summary
    return block


def helped(status: np.ndarray, variant: int, finite: np.ndarray) -> np.ndarray:
    """Which lost cases (n,) a kernel that takes more ``care`` may fly. Those that ask for finer
    steps, and whose outcomes are ``finite`` (n,), least squares would help no more than these."""
    finer = (status == FINER_STEPS) & finite
    return (status < 0) & (status >= variant) & ~(finer & (variant == Variant.LEAST_SQUARES))


def final_status(lost: np.ndarray, finite: np.ndarray) -> np.ndarray:
    """How cases (n,) end that no kernel vouches for, given what the last one said of them, and
    whether their outcomes are numbers."""
    told = np.where(
        lost == Variant.LEAST_SQUARES, int(Status.SINGULAR_JOINT), int(Status.UNRESOLVED)
    )
    return np.where((lost == FINER_STEPS) & ~finite, int(Status.NOT_FINITE), told)


def typical_durations(ends: np.ndarray, sound: np.ndarray) -> np.ndarray:
    """How long stages usually last, s, shape (stages,), given when they end in some cases, (stages,
    n), of which some are ``sound`` (n,). One that usually is over as it begins lasts as long as in
    the cases, sound or not, in which it is not."""
    durations, lengths = (
        np.diff(np.median(ends[:, sound], axis=1), prepend=0.0),
        np.diff(ends, axis=0, prepend=0.0),
    )
    for k in np.flatnonzero(durations <= _AT_ONCE * ends[-1].max()):
        lasting = lengths[k][lengths[k] > _AT_ONCE * ends[-1].max()]
        durations[k] = np.median(lasting) if len(lasting) else 0.0
    return durations


def history_rows(scene: Scene) -> int:
    """Rows of the stored history of a case."""
    return int(scene.run.end_time / scene.run.history_step + 1e-9) + 1


def integrate_once(
    campaign: Definition, flight: Integration, draws: np.ndarray, room: int = 0
) -> Block:
    """Fly draws at the flight's steps, and none of them again."""
    return integrate_cases(
        flight.kernel,
        campaign.plan,
        flight.steps,
        flight.durations,
        campaign.slots,
        draws,
        room,
        flight.methods,
    )[0]


def motion_is_finite(outcomes: np.ndarray, bodies: int) -> np.ndarray:
    """Whether the rates and attitudes of so many bodies at the end are numbers, (n,), given
    outcomes (n, o); the angles of the flow are of no value in still air."""
    of_bodies = outcomes[:, : BODY_OUTCOMES * bodies].reshape(-1, bodies, BODY_OUTCOMES)
    return np.asarray(np.isfinite(of_bodies[:, :, FLOW_ANGLES:]).all(axis=(1, 2)))


def _is_like_trials(flight: Integration, block: Block) -> np.ndarray:
    """Which cases (n,) are no harder to integrate than trial cases."""
    assert block.indicators is not None
    if flight.limits is None:
        return np.ones(len(block.status), dtype=bool)
    like = block.has_indicators & (block.indicators <= flight.limits).all(axis=1)
    for column, limit in flight.angles.items():
        like &= ~(np.abs(block.outcomes[:, column]) > limit)  # NaN: no angle that could be wrong
    return np.asarray(like)


def _estimated(
    campaign: Definition, flight: Integration, block: Block, like: np.ndarray
) -> RefinementSummary:
    """Put the estimate of the error into the rows of a block that are ``like`` (n,) trial cases.
    Returns what is to be told of those that need not fly again."""
    nothing = RefinementSummary(np.zeros(len(campaign.outcome_columns)))
    if flight.estimate is None:
        return nothing
    assert block.indicators is not None
    known = like & block.has_outcomes
    guards = _some(block.indicators, known)
    error = flight.estimate.of_cases(guards)
    block.error[known] = error
    settled = _some(guards, ~(error > flight.most))
    leading = flight.estimate.of_leading(settled)
    return RefinementSummary(
        leading, indicators=settled.max(axis=0, initial=0.0) if len(settled) else nothing.indicators
    )


def _some(guards: np.ndarray, which: np.ndarray) -> np.ndarray:
    """Rows of guards (n, g) that are stored by column, all or some of them."""
    return guards if which.all() else guards.T[:, which].T


def _doubtful(campaign: Definition, block: Block) -> np.ndarray:
    """Which cases (n,) may end otherwise at shorter steps, if none is given."""
    return status_in(block.status, (FINER_STEPS, *TOO_LONG, *DOUBTFUL)) & (
        campaign.scene.solver.step is None
    )


def _fly_hard(
    campaign: Definition,
    flight: Integration,
    draws: np.ndarray,
    room: int,
    block: Block,
    hard: np.ndarray,
    agreements: int = AGREEMENTS,
) -> RefinementSummary:
    """Fly the cases ``hard`` into their rows of ``block``, each at steps at which it has settled;
    with a step that is given, only to learn their error. Returns what is to be told of them."""
    given = campaign.scene.solver.step is not None
    columns = campaign.outcome_columns
    if not len(hard):
        return RefinementSummary(np.zeros(len(columns)))
    before = _rows(block, hard)
    found = _settle(
        campaign,
        flight,
        block,
        hard,
        lambda refined, some: integrate_once(campaign, refined, draws[some], room),
        agreements,
        before,
    )
    decides = decisive(columns)
    if given:
        assert flight.scale is not None
        n = len(flight.scale)
        change = np.maximum(
            found.change, errors(before.outcomes[:, :n], block.outcomes[hard, :n], flight.scale)
        )
        _put(block, hard, before)
        flown = block.has_outcomes[hard]
        block.error[hard[flown]] = _told(flight, change[flown], decides)
        return RefinementSummary(SAFETY * _largest(change), n_refined=len(hard))
    finite = motion_is_finite(block.outcomes[hard], len(campaign.plan.bodies))
    left = np.flatnonzero((block.status[hard] == FINER_STEPS) & finite)
    for number in left:
        own = _alone(campaign, flight, draws, room, block, hard[number])
        found.change[number], found.settled[number] = own.change[0], own.settled[0]
    flown = block.has_outcomes[hard]
    block.error[hard[flown]] = _told(flight, found.change[flown], decides)
    return RefinementSummary(
        SAFETY * _largest(found.change[flown]),
        n_refined=len(hard),
        n_unconverged=int(np.count_nonzero(flown & ~found.settled)),
    )


def _told(flight: Integration, change: np.ndarray, decides: np.ndarray) -> np.ndarray:
    """What is told of the errors of cases (n,) whose outcomes the last halvings changed, (n, o): no
    less than of any other case."""
    least = flight.estimate.floor if flight.estimate else np.zeros(change.shape[1])
    return np.asarray(np.maximum(SAFETY * change, least)[:, decides].max(axis=1, initial=0.0))


def _alone(
    campaign: Definition,
    flight: Integration,
    draws: np.ndarray,
    room: int,
    block: Block,
    number: int,
) -> Converged:
    """Fly a case, into its row of ``block``, whose phases last so much longer than usual that an
    event is looked for far too early: what they last is learnt from a flight of its own."""
    one, sharp = draws[number : number + 1], flight.refined(_TO_LEARN)
    _, ends = integrate_cases(
        flight.kernel,
        campaign.plan,
        sharp.steps,
        flight.durations,
        campaign.slots,
        one,
        methods=flight.methods,
    )
    own = replace(flight, durations=typical_durations(ends, np.ones(1, dtype=bool)))
    return _settle(
        campaign,
        own,
        block,
        np.array([number]),
        lambda refined, _: integrate_once(campaign, refined, one, room),
    )


def _settle(
    campaign: Definition,
    flight: Integration,
    block: Block,
    which: np.ndarray,
    flown: Callable[[Integration, np.ndarray], Block],
    agreements: int = AGREEMENTS,
    before: Block | None = None,
) -> Converged:
    """Fly cases into their rows of a block, by ``flown`` (flight, cases), at twice the resolution
    and so on until they have settled; what they gave ``before`` in the steps of the flight, if that
    is known, is not flown again."""
    columns = campaign.outcome_columns

    def fly_some(share: float, some: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        if share == 1.0 and before is not None:
            again = _rows(before, some)
        else:
            again = flown(flight.refined(round(1.0 / share)), which[some])
        _put(block, which[some], again)
        return again.outcomes[:, : len(columns)].copy(), np.where(
            (again.status < 0) | again.turns_unclear, Status.UNRESOLVED, again.status
        )

    scale = (
        SMALL * scene_scales(campaign.scene, [c.unit for c in columns])
        if flight.scale is None
        else flight.scale
    )
    return refine_steps(
        fly_some,
        len(which),
        1.0,
        SAFE * campaign.scene.solver.accuracy,
        scale,
        decisive(columns),
        _MOST_LOST if flight.has_any_order_fallback else HALVINGS,
        agreements,
    )


def _rows(block: Block, which: np.ndarray) -> Block:
    """Some rows of a block."""
    guards = None if block.indicators is None else block.indicators[which]
    return Block(
        block.outcomes[which],
        block.status[which],
        block.times[which],
        block.phases[which],
        block.history[which],
        block.rows[which],
        guards,
    )


def _put(block: Block, which: np.ndarray, rows: Block) -> None:
    """Put the rows of a block in place of some of another."""
    block.outcomes[which], block.status[which] = rows.outcomes, rows.status
    block.history[which], block.rows[which] = rows.history, rows.rows
    if (
        block.indicators is not None
        and rows.indicators is not None
        and block.indicators.shape[1] == rows.indicators.shape[1]
    ):
        block.indicators[which] = rows.indicators


def _largest(change: np.ndarray) -> np.ndarray:
    """Largest of the changes (n, o) of every outcome."""
    return np.asarray(change.max(axis=0, initial=0.0))
