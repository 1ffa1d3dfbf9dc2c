"""How to fly a campaign to the accuracy it asks for, found by flying trial cases first: corners of
the dispersions and a sample of them.

Trial cases depend on the scene and its laws only, not on the seed or the number of cases; so does
how a campaign is flown.
"""

from collections.abc import Callable
from dataclasses import replace
from functools import cache, partial

import numpy as np

from sepmc.campaign import cases
from sepmc.campaign.definition import Definition
from sepmc.campaign.execution.accuracy import (
    SAFETY,
    SMALL,
    achieved,
    decisive,
    errors,
    relative_error,
    scales,
    scene_scales,
)
from sepmc.campaign.execution.diagnostics import scene_notes
from sepmc.campaign.execution.error_estimate import estimate
from sepmc.campaign.execution.integration import (
    EVERY_S,
    SAFE,
    FallbackKernel,
    Integration,
    helped,
    history_rows,
    integrate,
    integrate_once,
)
from sepmc.campaign.execution.step_refinement import Integrate, longest_step, refine_steps
from sepmc.campaign.execution.step_search import (
    IN_DOUBT,
    NO_OUTCOMES,
    VOUCHED,
    Search,
    find_durations,
    mostly,
)
from sepmc.engine.dispatch import Block, integrate_cases, load_kernel, progress_reporter
from sepmc.engine.kernel_texts import written
from sepmc.engine.written_kernel import Kernel
from sepmc.kernel.spec import structure
from sepmc.kernel.spec.methods import method
from sepmc.kernel.spec.variant import Variant
from sepmc.scene.dispersion import Dispersion
from sepmc.scene.messages import Log
from sepmc.scene.units import UNITS
from sepmc.schema import Status, separation_columns

CORNERS = 24  # cases flown besides the nominal one; more if a discrete law has many values
SAMPLE = 512  # trial cases drawn from the laws
_OF_HARD = 8  # of the sample only a part is flown where every case finds its own steps
_EDGE = 0.001  # of the probability: what counts as a corner of a dispersion
_WIDE = 0.5 * np.pi  # an angle that spreads further has its extremes anywhere
_EACH = 3  # corners at least with every value of a discrete law
# of every phase, to learn how far outcomes spread, from a quarter of the sample
_SPREAD_STEPS, _MOST_SPREAD = 8, 512
_LONG_S = 60.0  # of trial cases: then it is said how to do without
_ROUNDS = 4  # searches for steps, each with the sample's worst cases added
_WORST = 24
# times a guard of trial cases; errors grow by no more than its power 5/3, and are told `SAFETY`
# times as large
_ALIKE = 1.25
_MOST_ESTIMATED = 0.6  # of the accuracy: so large estimates were up to 1.6 times too small
_UNSEEN_LOADS = 0.05  # of the accuracy: what a polynomial may leave out of an impulse
# of a guard of joint loads: what turns within a step is seen by the nodes in part only, and a few
# errors add up
_ALIKE_LOADS = 0.2


def kernel_text(
    campaign: Definition,
    solver: str | None = None,
    history: bool = False,
    variant: int = Variant.STANDARD,
) -> str:
    """The kernel written for a campaign, as a Python module: by another ``solver`` (the name of its
    methods), or one that takes more ``care``, if that is asked for."""
    return written(
        structure.make_kernel_spec(campaign.plan, campaign.dispersed, variant),
        solver or campaign.scene.solver.method,
        history,
    )


def stage_names(campaign: Definition, variant: int = Variant.STANDARD) -> list[str]:
    """What the segments of a campaign's kernel are, in the words of its file."""
    found = structure.make_kernel_spec(campaign.plan, campaign.dispersed, variant)
    return [
        found.names.back[segment.phase] + (" (late joints)" if segment.late else "")
        for segment in found.segments
    ]


def fallbacks(
    campaign: Definition, history: bool = False, variant: int = Variant.STANDARD
) -> tuple[FallbackKernel, ...]:
    """What flies cases that the kernel written for a campaign with some care loses."""
    found = structure.make_kernel_spec(campaign.plan, campaign.dispersed, variant)
    phases = [phase.name for phase in found.scene.phase]
    numbers = np.array([phases.index(segment.phase) for segment in found.segments])

    @cache
    def make(variant: int, announce: Log | None = None) -> Kernel:
        return load_kernel(kernel_text(campaign, history=history, variant=variant), announce)

    return tuple(FallbackKernel(more, partial(make, more), numbers) for more in found.fallbacks)


def corner_cases(campaign: Definition) -> np.ndarray:
    """Draws (n, d), SI: every parameter in the middle, then at one of its ends, by fixed coin
    tosses.

    Angles that spread over more than a quarter turn are spaced over all of it instead, and discrete
    laws take every value they have, however rare.
    """
    laws = campaign.file.dispersions
    count = max(
        [CORNERS, *(_EACH * len(_middles(law)) for law in laws if law.distribution == "discrete")]
    )
    random = np.random.Generator(np.random.Philox(key=20))
    tosses = np.resize(
        random.integers(0, 2, (max(1, CORNERS), max(1, len(laws)))), (count, max(1, len(laws)))
    )
    table = np.empty((count + 1, len(laws)), order="F")
    for i, law in enumerate(laws):
        u = np.where(tosses[:, i] == 1, 1.0 - _EDGE, _EDGE)
        if law.parameter.path.endswith(".fails"):  # not a corner of anything
            u = np.full(count, 0.5)
        elif law.distribution == "discrete":
            u = random.permutation(np.resize(_middles(law), count))
        elif _is_wide(law):
            u = (random.permutation(count) + 0.5) / max(1, count)
        table[:, i] = _quantiles(law, np.concatenate([[0.5], u]))
    return table * campaign.factors


def calibration_sample(campaign: Definition, count: int) -> np.ndarray:
    """Draws (count, d), SI, from the laws: every parameter spaced evenly over its probability, in
    random order (a Latin hypercube).

    In the second half all values of a discrete law are equally frequent.
    """
    laws, half = campaign.file.dispersions, (count + 1) // 2
    random = np.random.Generator(np.random.Philox(key=21))
    table = np.empty((count, len(laws)), order="F")
    for i, law in enumerate(laws):
        u = np.concatenate(
            [(random.permutation(n) + random.random(n)) / max(1, n) for n in (half, count - half)]
        )
        if law.distribution == "discrete" and not law.parameter.path.endswith(".fails"):
            u[half:] = random.permutation(np.resize(_middles(law), count - half))
        table[:, i] = _quantiles(law, np.clip(u, 2.0**-54, 1.0 - 2.0**-53))
    return table * campaign.factors


def _quantiles(law: Dispersion, u: np.ndarray) -> np.ndarray:
    """Values of a law at probabilities; the middle one in place of what the parameter may not
    be."""
    values = cases.quantile(law, u)
    return (
        np.where(law.allowed(values), values, cases.quantile(law, np.array([0.5])))
        if law.has_tails
        else values
    )


def _middles(law: Dispersion) -> np.ndarray:
    """Probabilities at which a discrete law gives each value that it can give."""
    weights = np.array(law.weights)
    edges = np.cumsum(weights) / np.sum(weights)
    return (edges - 0.5 * weights / np.sum(weights))[weights > 0.0]


def _is_wide(law: Dispersion) -> bool:
    """Whether a parameter is an angle that spreads further than its ends tell."""
    if law.parameter.unit not in UNITS["angle"]:
        return False
    low, high = cases.quantile(law, np.array([_EDGE, 1.0 - _EDGE])) * law.parameter.factor
    return bool(high - low > _WIDE)


def select_steps(
    campaign: Definition, history: bool = False, announce: Log | None = None
) -> Integration:
    """Choose how to fly a campaign to the accuracy it asks for."""
    variant: int = Variant.STANDARD
    while True:
        kernel = load_kernel(kernel_text(campaign, history=history, variant=variant), announce)
        _tell_trials(announce)
        left, stages = fallbacks(campaign, history, variant), stage_names(campaign, variant)
        room = history_rows(campaign.scene) if history and campaign.scene.joint else 0
        found = _choose_steps(campaign, kernel, stages, _counted(announce), room)
        if found is not None:
            found = replace(found, fallbacks=left, variant=variant)
            return replace(found, notes=scene_notes(campaign, found))
        wanted = _more_care(campaign, kernel, left)
        if wanted is None:
            found = replace(_each_by_itself(campaign, kernel, stages, left), variant=variant)
            return _finished(campaign, found, room)
        variant = wanted


def unpacked(
    campaign: Definition, flight: Integration, history: bool, announce: Log | None = None
) -> Integration:
    """A flight that another process planned (`Integration.packed`), with kernels of this one."""
    text = kernel_text(campaign, history=history, variant=flight.variant)
    left = fallbacks(campaign, history, flight.variant)
    return replace(flight, kernel=load_kernel(text, announce), fallbacks=left)


def _more_care(
    campaign: Definition, kernel: Kernel, left: tuple[FallbackKernel, ...]
) -> int | None:
    """With what care a kernel may fly most of the corners that this one loses; None if there is
    none."""
    steps, durations = _unknown(kernel)
    block, _ = integrate_cases(
        kernel,
        campaign.plan,
        _SPREAD_STEPS * steps,
        durations,
        campaign.slots,
        corner_cases(campaign),
    )
    for fallback in left:
        flown = np.count_nonzero(helped(block.status, fallback.variant, np.array(True)))
        if 2 * flown >= np.count_nonzero(block.status < 0) > 0:
            return fallback.variant
    return None


def _unknown(kernel: Kernel) -> tuple[np.ndarray, np.ndarray]:
    """Steps (stages,), and how long stages usually last, while nothing is known of that."""
    return np.full(kernel.n_segments, _SPREAD_STEPS), np.full(kernel.n_segments, np.inf)


def _each_by_itself(
    campaign: Definition, kernel: Kernel, stages: list[str], left: tuple[FallbackKernel, ...]
) -> Integration:
    """Where no steps suit most trial cases: every case finds its own."""
    draws, given = (
        np.vstack([corner_cases(campaign), calibration_sample(campaign, SAMPLE // _OF_HARD)]),
        campaign.scene.solver.step,
    )
    steps, durations = _unknown(kernel)
    steps = steps if given is None else np.ones_like(steps)
    units = [c.unit for c in campaign.outcome_columns]
    own, nothing = scene_scales(campaign.scene, units), np.full(kernel.n_indicators, -np.inf)
    flight = Integration(
        kernel, steps, durations, stages, given, SMALL * own, nothing, fallbacks=left
    )
    block = integrate(campaign, flight, draws)
    assert block.refinement is not None
    ok, decides = block.status == Status.OK, decisive(campaign.outcome_columns)
    told = achieved(campaign, block.refinement.error / SAFETY, int(np.count_nonzero(ok)))
    nominal = block.outcomes[0, : len(units)] if ok[0] else None
    scale = scales(block.outcomes[ok][:, : len(units)], units, own)
    return replace(
        flight,
        scale=scale,
        error=float(block.refinement.error[decides].max(initial=0.0)) / SAFETY,
        achieved=told,
        nominal=nominal,
    )


def _finished(campaign: Definition, found: Integration, room: int) -> Integration:
    """The flight with what is to be told of its nominal case and of histories of so many rows."""
    if room and found.achieved is not None:
        draws = np.empty((1, 0))
        if campaign.file.dispersions:
            draws = np.vstack([corner_cases(campaign), calibration_sample(campaign, SAMPLE)])
        assert found.scale is not None
        one, two = (integrate_once(campaign, way, draws, room) for way in (found, found.refined()))
        error = _history_error(campaign, one, two, found.scale)
        found = replace(found, achieved=replace(found.achieved, history=SAFETY * error))
    return replace(found, notes=scene_notes(campaign, found))


def _history_error(campaign: Definition, one: Block, two: Block, scale: np.ndarray) -> float:
    """Largest error of separation speed and distance between the ends of steps, over trial cases
    flown in some steps and in half of these: a step's interpolation is of a lower order than the
    step. Relative to size or ``scale`` (o,) as the outcomes are."""
    names = [column.name for column in campaign.outcome_columns]
    width = two.history.shape[2]
    own = np.array(
        [scale[names.index(c.name)] for c in separation_columns(list(campaign.plan.joints))]
    )
    both = (one.status == Status.OK) & (two.status == Status.OK)
    there = one.history[both].reshape(-1, width), two.history[both].reshape(-1, width)
    return float(errors(*there, own).max(initial=0.0))


def _tell_trials(announce: Log | None) -> None:
    if announce:
        announce("flying trial cases to find the steps for the accuracy asked ...")


def _counted(announce: Log | None) -> Callable[[int], None]:
    """What is told of every so many flights of trial cases: now and then, how many there were."""
    tell, total = progress_reporter(announce, EVERY_S), 0

    def count(flights: int) -> None:
        nonlocal total
        total += flights
        tell(
            lambda seconds: (
                f"{total} flights of trial cases in {seconds:.0f} s"
                + ("; solver.step_s, a step of your own, needs none" if seconds > _LONG_S else "")
                + " ..."
            )
        )

    return count


def _choose_steps(
    campaign: Definition,
    kernel: Kernel,
    stages: list[str],
    tell: Callable[[int], None],
    room: int = 0,
) -> Integration | None:
    """Fewest steps in every phase with which trial cases come within the accuracy, or the step that
    is given; None if none are found. The error of histories of so many rows, the ``room``, is told
    too."""
    tried, drawn = (
        corner_cases(campaign),
        calibration_sample(campaign, SAMPLE if campaign.file.dispersions else 0),
    )
    first, durations, given = (
        len(tried),
        find_durations(campaign, kernel, tried),
        campaign.scene.solver.step,
    )
    if durations is None:
        return None
    longest = longest_step(
        campaign.scene, campaign.file.dispersions, structure.brief_transient(campaign.scene)
    )
    least = np.maximum(2, np.ceil(durations / longest)).astype(np.int64)
    columns = campaign.outcome_columns
    units, decides = [c.unit for c in columns], decisive(columns)
    goal = SAFE * campaign.scene.solver.accuracy
    evaluations = [[method(name).stages for name in names] for names in kernel.methods]
    beyond = np.zeros(0, dtype=np.int64)  # cases of the sample that are further off than the goal

    def block_of(
        steps: np.ndarray, draws: np.ndarray, methods: np.ndarray | None = None, room: int = 0
    ) -> Block:
        block, _ = integrate_cases(
            kernel, campaign.plan, steps, durations, campaign.slots, draws, room, methods
        )
        tell(len(draws))
        return block

    def flown(
        steps: np.ndarray, methods: np.ndarray, draws: np.ndarray
    ) -> tuple[np.ndarray, np.ndarray]:
        block = block_of(steps, draws, methods)
        return block.outcomes[:, : len(units)], _verdict(block, given)

    spread, some = (
        _SPREAD_STEPS if given is None else 1,
        np.vstack([tried[:1], drawn[: (len(drawn) + 3) // 4]]),
    )
    few = block_of(np.full(kernel.n_segments, spread), some)
    # a body may turn too far in a step for any of them
    while not mostly(_verdict(few, given)) and spread < _MOST_SPREAD:
        spread *= 2
        few = block_of(np.full(kernel.n_segments, spread), some)
    scale = scales(_ended(few, given)[:, : len(units)], units, scene_scales(campaign.scene, units))
    for _ in range(_ROUNDS):
        tried = np.vstack([tried, drawn[beyond]])
        search = Search(flown, tried, scale, goal, decides, evaluations)
        fewest = search.fewest(least) if given is None else search.of_one_step(kernel.n_segments)
        if fewest is None:
            return None
        steps = fewest
        # corners and sample once in these steps and once in half of them, for all that is told
        every = np.vstack([tried[:first], drawn])
        trials, halved = (block_of(times * steps, every, search.methods, room) for times in (1, 2))
        (one, verdict), (two, finer) = (
            (block.outcomes[first:, : len(units)], _verdict(block, given)[first:])
            for block in (trials, halved)
        )
        fair, finely = verdict == VOUCHED, finer == VOUCHED
        found = np.where((fair & finely)[:, None], errors(one, two, scale), 0.0)
        beyond = _beyond(found[:, decides].max(axis=1, initial=0.0), search.goal)
        if given is not None or not len(beyond):
            break
    largest = np.maximum(search.largest(steps), found.max(axis=0, initial=0.0))
    again, sound = trials.outcomes[:first, : len(units)], _verdict(trials, given)[:first] == VOUCHED
    both = sound & search.fair[:first]
    known = np.vstack(
        [errors(again[both], search.reference[:first][both], scale), found[fair & finely]]
    )
    known_of = np.concatenate([both, fair & finely])
    doubted = np.vstack([tried[:first][sound & ~search.fair[:first]], drawn[fair & ~finely]])
    if len(doubted):
        vouched = np.vstack([again[sound & ~search.fair[:first]], one[fair & ~finely]])

        def finely_flown(share: float, which: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
            block = block_of(round(1.0 / share) * steps, doubted[which], search.methods)
            return block.outcomes[:, : len(units)], np.where(
                _verdict(block, given) == IN_DOUBT, Status.UNRESOLVED, block.status
            )

        largest = np.maximum(largest, _doubted(finely_flown, vouched, goal, scale, decides))
    limits, angles = _limits(campaign, trials), _angles(campaign, trials)
    largest = np.maximum(largest, _unseen(campaign, trials, scale))
    assert trials.indicators is not None
    told_by_guards = trials.has_indicators[known_of]  # with a step that is given, maybe not all
    own = estimate(
        trials.indicators[known_of][told_by_guards],
        known[told_by_guards],
        SAFETY * search.of_reference,
        _left_out(campaign, trials, scale),
        decides,
    )
    count = int(np.count_nonzero(fair) + np.count_nonzero(sound))
    told = achieved(campaign, largest, count)
    if room:
        told = replace(told, history=SAFETY * _history_error(campaign, trials, halved, scale))
    nominal = search.reference[0] if trials.status[0] == Status.OK and search.fair[0] else None
    error = float(largest[decides].max(initial=0.0))
    most = np.inf if given is not None else _MOST_ESTIMATED * campaign.scene.solver.accuracy
    if search.goal > goal:  # what trial cases do not reach in any steps is not asked of others
        most = 2.0 * SAFETY * error
    return Integration(
        kernel,
        steps,
        durations,
        stages,
        given,
        scale,
        limits,
        angles,
        own,
        most,
        error,
        told,
        nominal,
        methods=search.methods,
    )


def _verdict(block: Block, given: float | None) -> np.ndarray:
    """Of which cases (n,) a kernel vouches for the outcomes: those with a guard that is not known
    are flown again, unless the step is ``given``."""
    vouched = block.has_outcomes & (given is not None or block.has_indicators)
    return np.where(
        block.status > Status.NEVER_RELEASED, NO_OUTCOMES, np.where(vouched, VOUCHED, IN_DOUBT)
    )


def _ended(block: Block, given: float | None) -> np.ndarray:
    """Outcomes (n, o) of the cases that statistics are of, which came to their end; if none did, of
    all that a kernel vouches for."""
    vouched = _verdict(block, given) == VOUCHED
    ended = vouched & (block.status == Status.OK)
    return np.asarray(block.outcomes[ended if ended.any() else vouched])


def _limits(campaign: Definition, trials: Block) -> np.ndarray:
    """Guards (g,) up to which trial cases tell the error of a case: their own largest and a little
    more, or what no outcome would show."""
    assert trials.indicators is not None
    sound = trials.indicators[(trials.status == Status.OK) & trials.has_indicators]
    speed, rate = (
        SMALL * campaign.scene.solver.accuracy * scene_scales(campaign.scene, ["m/s", "deg/s"])
    )
    unseen = np.zeros(trials.indicators.shape[1])
    of_states = 3 * len(campaign.plan.bodies)
    unseen[:of_states] = np.resize([speed, rate * campaign.scene.run.end_time, rate], of_states)
    units, impulses = [column.unit for column in campaign.outcome_columns], _impulses(campaign)
    sizes = np.abs(trials.outcomes[trials.status == Status.OK][:, impulses]).max(
        axis=0, initial=0.0
    )
    own = SMALL * scene_scales(campaign.scene, [units[k] for k in impulses])
    # guards of joint loads come last
    alike, first = np.full(len(unseen), _ALIKE), len(unseen) - len(impulses)
    unseen[first:] = _UNSEEN_LOADS * campaign.scene.solver.accuracy * np.maximum(sizes, own)
    alike[first:] = _ALIKE_LOADS
    return np.maximum(alike * sound.max(axis=0, initial=0.0), unseen)


def _impulses(campaign: Definition) -> list[int]:
    """Places of the impulses among the outcomes: their guards come last, in the same order."""
    return [
        k for k, column in enumerate(campaign.outcome_columns) if column.unit in ("N s", "N m s")
    ]


def _unseen(campaign: Definition, trials: Block, scale: np.ndarray) -> np.ndarray:
    """Error (o,) that outcomes may have without a guard that tells: what polynomials may leave out
    of impulses (`_limits`)."""
    found, impulses = np.zeros(len(scale)), _impulses(campaign)
    sizes = np.abs(trials.outcomes[trials.has_outcomes][:, impulses])
    left_out = _UNSEEN_LOADS * campaign.scene.solver.accuracy * sizes.max(axis=0, initial=0.0)
    found[impulses] = _over_least(left_out / SAFETY, sizes, scale[impulses])
    return found


def _left_out(campaign: Definition, trials: Block, scale: np.ndarray) -> np.ndarray:
    """Error (o, g) that outcomes may have for each unit of a guard: impulses, for what polynomials
    leave out of them."""
    assert trials.indicators is not None
    impulses = _impulses(campaign)
    found = np.zeros((len(scale), trials.indicators.shape[1]))
    sizes = np.abs(trials.outcomes[trials.has_outcomes][:, impulses])
    guards = found.shape[1] - len(impulses) + np.arange(len(impulses))
    found[impulses, guards] = _over_least(np.array(SAFETY), sizes, scale[impulses])
    return found


def _over_least(amount: np.ndarray, sizes: np.ndarray, scale: np.ndarray) -> np.ndarray:
    """An amount, or one for each of some outcomes (k,), over what each is in the case where it is
    least, given ``sizes`` (n, k), but no less than its ``scale`` (k,)."""
    least = np.maximum(sizes, scale).min(axis=0, initial=np.inf)
    return np.divide(amount, least, out=np.zeros(len(least)), where=least > 0.0)


def _angles(campaign: Definition, trials: Block) -> dict[int, float]:
    """How near sideslip and yaw, by column, may come to a right angle, rad: an error of alpha, or
    pitch and roll, goes with one over the cosine."""
    found = {}
    for k, column in enumerate(campaign.outcome_columns):
        if column.name.endswith(("_beta_deg", "_yaw_deg")):
            sizes = np.abs(trials.outcomes[trials.status == Status.OK, k])
            found[k] = float(np.arccos(np.cos(np.nanmax(sizes, initial=0.0)) / _ALIKE))
    return found


def _doubted(
    integrate: Integrate, outcomes: np.ndarray, goal: float, scale: np.ndarray, decides: np.ndarray
) -> np.ndarray:
    """Largest error (o,) of cases that a kernel vouches for, but at finer steps does not: against
    what they settle at."""
    right = np.empty_like(outcomes)

    def flown(share: float, which: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        found, status = integrate(share, which)
        right[which] = found
        return found, status

    settled = refine_steps(flown, len(outcomes), 1.0, goal, scale, decides)
    found = errors(outcomes, right, scale)
    found[~settled.settled | (settled.status > Status.NEVER_RELEASED)] = np.inf
    return found.max(axis=0)


def _beyond(errors_of_cases: np.ndarray, goal: float) -> np.ndarray:
    """The worst of the cases whose errors (n,) are larger than the goal."""
    return np.argsort(-errors_of_cases)[: min(_WORST, np.count_nonzero(errors_of_cases > goal))]


__all__ = [
    "CORNERS",
    "SAFE",
    "SAMPLE",
    "SMALL",
    "Integration",
    "calibration_sample",
    "corner_cases",
    "integrate",
    "kernel_text",
    "relative_error",
    "select_steps",
]  # fmt: skip


def units_to_compile(text: str) -> tuple[int, int]:
    """How many pieces of a kernel are not in the cache of compiled ones, and how many it has."""
    from sepmc.engine import kernel_cache as compiled  # noqa: PLC0415  (numba)

    pieces = compiled.compile_units_of(text)
    return len(compiled.missing_units(pieces)), len(pieces.names)
