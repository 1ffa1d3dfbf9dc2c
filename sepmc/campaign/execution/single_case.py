"""One case by itself, with all there is to know of it over time: by the kernel written for its
scene, as plain Python if that does."""

import math
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np

from sepmc import schema
from sepmc.campaign.execution.accuracy import SAFETY, decisive, errors, scales, scene_scales
from sepmc.campaign.execution.integration import (
    EVERY_S,
    final_status,
    helped,
    motion_is_finite,
    typical_durations,
)
from sepmc.campaign.execution.step_refinement import longest_step, refine_case_steps
from sepmc.engine.dispatch import integrate_nominal, interpreted, load_kernel, progress_reporter
from sepmc.engine.kernel_texts import written
from sepmc.engine.work_budget import COMPILED_LINE_S, LINE_S, Work, WorkLimitError
from sepmc.kernel.spec.kernel_spec import KernelSpec
from sepmc.kernel.spec.naming import Names
from sepmc.kernel.spec.parameter_layout import ParameterLayout, make_parameter_layout
from sepmc.kernel.spec.structure import brief_transient, make_kernel_spec
from sepmc.kernel.spec.variant import Variant
from sepmc.routines.layout import FINER_STEPS, FULL_HISTORY
from sepmc.scene.messages import Log
from sepmc.scene.model import Scene
from sepmc.schema import Column, Status

# times finer than a given step: the first with which a case comes to its end tells how long phases
# last
_TO_LEARN = (2, 16, 128)
_FEWEST = 2  # steps of a stage that are tried first
_HOPELESS = 256  # with so many, a case that ends with no numbers will not have any
# steps of a stage: if more are no clearer on the turns of pitch and roll, the audit tells that
_CLEARER = 1024
_PLAIN = 2048  # steps of a stage: more take plain Python long, and a compiler less
# lines of a kernel that plain Python flies for a case, all its flights together: 9 s; a compiler
# takes as long. Then so many compiled: 60 s
_PLAIN_WORK, _COMPILED_WORK = 2.5e7, 1e10
_LONG_S = 3.0  # of a flight: then it is said before it begins
_MOST = 2**20  # of which a case that will not settle takes no more
_SAME_TIME = 1e-12  # s
_NONE = np.empty((0, 3))  # instants of which rows are wanted


@dataclass
class SingleCase:
    """A case that is flown: its outcomes and audit (o,) in SI, rows (n, columns) in SI at ``times``
    (n,) and in ``phases`` (n,), by number, and what is to be told of it; the numerical error of its
    outcomes, if it has any; whether its kernel was ``compiled``; when ``springs`` with a stroke
    came to its end, s, NaN of those that did not."""

    plan: ParameterLayout
    status: Status
    outcomes: np.ndarray
    times: np.ndarray
    phases: np.ndarray
    rows: np.ndarray
    notes: list[str]
    error: np.ndarray | None = None
    compiled: bool = False
    springs: dict[str, float] = field(default_factory=dict)


class UnknownError(Exception):
    """A case was not flown to an end that is known, in the work that is allowed: with the sentence
    that says so."""


class _SpentError(Exception):
    """A flight would take more work than a case may."""


class _LostError(Exception):
    """The kernel does not vouch for the case: ``status`` is what it says."""

    def __init__(self, status: int):
        self.status = status


def simulate_case(
    scene: Scene,
    columns: list[Column],
    every_s: float,
    announce: Log | None = None,
    plain_work: float | None = None,
) -> SingleCase:
    """A case, as ``scene`` has it, at the step that is given, or else in steps at which its
    outcomes (``columns``) have settled to the accuracy asked: a row every so many seconds, and two
    at each end of a phase. ``announce`` is told if a kernel is compiled: where a case takes more
    work than plain Python does in some ten seconds. If so many lines of ``plain_work`` are given,
    nothing is compiled, and what takes more raises UnknownError."""
    plan, variant = make_parameter_layout(scene), Variant.STANDARD
    work = Work(_PLAIN_WORK if plain_work is None else plain_work)
    while True:
        shape = make_kernel_spec(plan, variant=variant)
        flight = _SingleFlight(shape, plan, columns, every_s, announce, work, plain_work is None)
        try:
            return flight.fly()
        except _LostError as lost:
            status, finite = np.array(lost.status), np.array(flight.finite)
            more = [spare for spare in shape.fallbacks if helped(status, spare, finite)]
            if not more:
                return flight.lost(lost.status)
            variant = more[0] if lost.status != Variant.LEAST_SQUARES else Variant.LEAST_SQUARES


def invalid(scene: Scene, columns: int) -> SingleCase:
    """A case with a parameter that may not be: nothing is flown."""
    plan = make_parameter_layout(scene)
    rows = np.empty((0, len(schema.history_columns(plan.contents))))
    return SingleCase(
        plan,
        Status.INVALID_INPUT,
        np.full(columns, np.nan),
        np.empty(0),
        np.empty(0, dtype=np.int64),
        rows,
        [],
    )


class _SingleFlight:
    """Flights of a case by the kernel of a shape, in as many steps as it takes."""

    def __init__(
        self,
        shape: KernelSpec,
        plan: ParameterLayout,
        columns: list[Column],
        every_s: float,
        announce: Log | None,
        work: Work,
        may_compile: bool,
    ):
        self.shape, self.plan, self.columns, self.every_s, self.announce = (
            shape,
            plan,
            columns,
            every_s,
            announce,
        )
        self.text, self.compiled = written(shape, plan.scene.solver.method, FULL_HISTORY), False
        with interpreted():
            self.kernel = load_kernel(self.text)
        stages = self.kernel.n_segments
        self.durations = np.full(stages, np.inf)
        self.outcomes, self.steps = np.empty(0), np.ones(stages, dtype=np.int64)
        # ends of stages and changes of joints, by steps and what stages usually last
        self.known: dict[tuple[bytes, bytes], tuple[np.ndarray, np.ndarray]] = {}
        self.tell = progress_reporter(announce, EVERY_S)
        self.work, self.may_compile = work, may_compile
        self.per_step = 0.0  # lines for each step of a stage, of the last flight in plain Python
        # steps and outcomes of the flights, in more and more steps, that came to an end
        self.ended: list[tuple[np.ndarray, np.ndarray]] = []
        self.spent = ""  # what is told of a case whose work was spent

    @property
    def finite(self) -> bool:
        """Whether the last flight ended with numbers."""
        return bool(motion_is_finite(self.outcomes[None, :], len(self.plan.bodies))[0])

    def fly(self) -> SingleCase:
        """The case. Raises _LostError if the kernel does not vouch for it."""
        scene, steps = self.plan.scene, np.ones(self.kernel.n_segments, dtype=np.int64)
        if scene.solver.step is None:
            steps, error, notes = self._settled(steps)
            return self._told(self._with_rows(steps, notes), error)
        self._compile_for(scene.run.end_time / scene.solver.step)
        finer = self._learn(steps)
        found = self._with_rows(steps, [])
        if finer is None or found.status > Status.NEVER_RELEASED:
            return found
        units, count = [c.unit for c in self.columns], len(self.columns)
        scale = scales(finer[None, :count], units, scene_scales(scene, units))
        error = SAFETY * errors(found.outcomes[None, :count], finer[None, :count], scale)[0]
        return self._told(found, error)

    def _told(self, found: SingleCase, error: np.ndarray) -> SingleCase:
        """The case with the error (o,) of its outcomes."""
        if found.status <= Status.NEVER_RELEASED:
            found.outcomes[-1] = error[decisive(self.columns)].max(initial=0.0)
        return replace(found, error=error)

    def lost(self, status: int) -> SingleCase:
        """The case as it is though no kernel vouches for it."""
        return self._with_rows(
            self.steps,
            [self.spent] if self.spent else [],
            Status(int(final_status(np.array([status]), np.array([self.finite]))[0])),
        )

    def _learn(self, steps: np.ndarray) -> np.ndarray | None:
        """How long phases last, so that later flights look for their ends where they are, from one
        in finer steps than so many (stages,). Returns its outcomes, if it came to its end."""
        solver, most = self.plan.scene.solver, _MOST if self.compiled else _PLAIN
        assert solver.step is not None
        known = self.kernel.n_segments == 1  # it lasts as long as the flight
        affordable = most * solver.step / self.plan.scene.run.end_time
        for times in _TO_LEARN:
            if times > _TO_LEARN[0] and (known or times > affordable):
                break
            found, status, _ = self._once(times * steps)
            if status != FINER_STEPS:
                return found.copy() if 0 <= status <= Status.NEVER_RELEASED else None
        return None

    def _once(
        self, steps: np.ndarray, instants: np.ndarray = _NONE
    ) -> tuple[np.ndarray, int, np.ndarray]:
        stages, self.steps = self.kernel.n_segments, steps
        given = self.plan.scene.solver.step is not None
        how = "" if given else f", now in {steps.max()} steps a phase"
        self.tell(lambda seconds: f"still flying after {seconds:.0f} s{how} ...")
        self.outcomes, status, unclear, ends, rows = self._flown(steps, instants)
        self.known[steps.tobytes(), self.durations.tobytes()] = ends[:stages], ends[stages:]
        if status in (Status.OK, Status.NEVER_RELEASED) and np.isinf(self.durations).all():
            self.durations[:] = typical_durations(ends[:stages, None], np.ones(1, dtype=bool))
        if (
            unclear
            and self.plan.scene.solver.step is None
            and steps.max() <= _CLEARER
            and 0 <= status <= Status.NEVER_RELEASED
        ):
            status = FINER_STEPS
        return self.outcomes, status, rows

    def _flown(self, steps: np.ndarray, instants: np.ndarray) -> Any:
        """What `integrate_nominal` gives: in plain Python, or compiled once that works too much."""
        most = float(steps.max())
        if not self.compiled:
            self._foretell(self.per_step * most)
        if not self.compiled:
            before = self.work.done
            try:
                with self.work.counted():
                    found = integrate_nominal(
                        self.kernel, self.plan, steps, self.durations, instants
                    )
                if not len(instants):
                    self.per_step = (self.work.done - before) / most
                return found
            except WorkLimitError:
                self.per_step = max(self.per_step, (self.work.done - before) / most)
                self._compile(self._time())
        return integrate_nominal(self.kernel, self.plan, steps, self.durations, instants)

    def _foretell(self, lines: float) -> None:
        """Say how long a flight of so many lines in plain Python will take, if that is long;
        compile instead, if it is more than is left."""
        if lines > self.work.left and self.may_compile:
            self._compile()
        elif lines * LINE_S > _LONG_S and self.announce:
            self.announce(f"the next flight takes plain Python about {lines * LINE_S:.0f} s ...")

    def _with_rows(
        self, steps: np.ndarray, notes: list[str], told: Status | None = None
    ) -> SingleCase:
        """The case in so many steps (stages,), with its history; with none but that if it is
        ``told`` to have failed."""
        scene = self.plan.scene
        ends, changes = self._moments(steps)
        instants, phases = _instants(
            self.shape, np.fmin(ends, scene.run.end_time), changes, self.every_s
        )
        found, status, rows = self._once(steps, instants)
        # the step in which it fails has no rows
        if status > Status.NEVER_RELEASED and scene.solver.step is None:
            steps = np.maximum(steps, min(_PLAIN, math.ceil(scene.run.end_time / self.every_s)))
            found, status, rows = self._once(steps, instants)
        if told is None and status < 0:
            raise _LostError(status)
        if told is not None:
            status, found[: len(self.columns)] = told, np.nan  # the audit stays
        there = ~np.isnan(rows).all(axis=1)
        return SingleCase(
            self.plan,
            Status(status),
            found,
            instants[there, 0],
            phases[there],
            rows[there],
            notes,
            None,
            self.compiled,
            self._springs(changes),
        )

    def _springs(self, changes: np.ndarray) -> dict[str, float]:
        """When strokes end of springs, by their names, from the times (n,) of ``_moments``, of
        which theirs come last (`sepmc.kernel.emit.context.Context.change_times`)."""
        back, spent = Names(self.plan.scene).back, self.shape.stroke_springs
        times = changes[len(changes) - len(spent) :].tolist()
        return {back[name]: time for name, time in zip(spent, times, strict=True)}

    def _moments(self, steps: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Ends of stages (stages,) and times at which joints let go within (n,) of a flight in so
        many steps (stages,), which is flown if that is not known."""
        if self.kernel.n_segments == 1 and self.kernel.n_changes == 0:
            return np.array([self.plan.scene.run.end_time]), np.empty(0)
        flown = steps.tobytes(), self.durations.tobytes()
        if flown not in self.known:
            self._once(steps)
        return self.known[flown]

    def _settled(self, one: np.ndarray) -> tuple[np.ndarray, np.ndarray, list[str]]:
        """Steps (stages,) at which the case has settled, its error (o,) there, and what is to be
        told of that; ``one`` step of every stage is (stages,) ones."""
        scene = self.plan.scene
        fewest = max(
            _FEWEST,
            math.ceil(scene.run.end_time / longest_step(scene, brief=brief_transient(scene))),
        )

        def tried(share: float, _: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
            found, status = self._tried(round(fewest / share) * one)
            return found[None, : len(self.columns)], np.array(
                [Status.UNRESOLVED if status < 0 else status]
            )

        most = max(_HOPELESS, 2 * fewest)
        try:
            while self._tried(fewest * one)[1] == FINER_STEPS:
                if fewest >= most and not self.finite:
                    raise _LostError(FINER_STEPS)
                fewest *= 2
            share, error, notes = refine_case_steps(tried, 1.0, scene, self.columns)
        except _SpentError:
            return self._unsettled()
        return round(fewest / share) * one, error, notes

    def _unsettled(self) -> tuple[np.ndarray, np.ndarray, list[str]]:
        """What `_settled` gives for a case whose work is spent before it has settled: the last
        flight that came to its end. Raises _LostError if none did."""
        left = "; give solver.step_s, or ask for less (solver.accuracy), to go on"
        if not self.ended:
            self.spent = (
                f"{int(self.steps.max())} steps a phase do not suffice, and more are beyond the "
                f"work that a case may take{left}"
            )
            raise _LostError(FINER_STEPS)
        steps, _ = self.ended[-1]
        count, scene = len(self.columns), self.plan.scene
        error = np.full(count, np.inf)
        if len(self.ended) > 1:
            units = [column.unit for column in self.columns]
            before, found = (
                np.nan_to_num(outcomes[None, :count]) for _, outcomes in self.ended[-2:]
            )
            error = errors(before, found, scales(found, units, scene_scales(scene, units)))[0]
        worst = int(np.where(decisive(self.columns), error, 0.0).argmax())
        return (
            steps,
            error,
            [
                f"the work of this case was spent at {int(steps.max())} steps a phase, before it "
                f"settled: the last halving of the step changed {self.columns[worst].name} by "
                f"{error[worst]:.1e} of its size, and the accuracy {scene.solver.accuracy:g} was "
                f"asked{left}"
            ],
        )

    def _tried(self, steps: np.ndarray) -> tuple[np.ndarray, int]:
        """Outcomes (o,) and status in so many steps (stages,), compiled if these are many. Raises
        _LostError if they are too many, or if another kernel has to fly the case."""
        if steps.max() > _MOST:
            raise _LostError(FINER_STEPS)
        self._compile_for(float(steps.max()))
        if self.compiled:
            self.work.compiled += self.per_step * float(steps.max())
            if self.work.compiled > _COMPILED_WORK:
                raise _SpentError
        found, status, _ = self._once(steps)
        if 0 <= status <= Status.NEVER_RELEASED:
            self.ended.append((steps, found.copy()))
        spared = steps.max() > _HOPELESS and Variant.ANY_ORDER in self.shape.fallbacks
        if status < FINER_STEPS or (status == FINER_STEPS and spared):
            raise _LostError(status)
        return found, status

    def _compile_for(self, steps: float) -> None:
        """Compile the kernel if it is to fly in so many steps of a stage that plain Python would
        take minutes."""
        if steps > _PLAIN and not self.compiled:
            self._compile()

    def _compile(self, reached: float | None = None) -> None:
        """Fly compiled from now on, where a flight in plain Python was stopped that had ``reached``
        so many s, or none was begun. Raises UnknownError if that is not allowed."""
        if not self.may_compile:
            raise UnknownError(self._told_unknown(reached))
        if self.announce:
            self.announce(
                "this case takes more steps than plain Python flies in some seconds: compiled, its "
                f"flights take up to about {_COMPILED_WORK * COMPILED_LINE_S:.0f} s, more only "
                "beside others"
            )
        self.kernel, self.compiled = load_kernel(self.text, self.announce), True
        self.known.clear()  # its ends may differ in the last bit

    def _time(self) -> float:
        """Time, s, that a flight in plain Python has reached."""
        assert self.kernel.plain is not None
        return float(self.work.numbers[self.kernel.plain.BEGIN_T])

    def _told_unknown(self, reached: float | None) -> str:
        """What is told of a case that takes more work than is allowed."""
        end, given = self.plan.scene.run.end_time, self.plan.scene.solver.step
        how = (
            f"of {self.steps.max()} steps a phase" if given is None else f"in steps of {given:g} s"
        )
        far = (
            ""
            if reached is None or math.isnan(reached)
            else f", stopped at {reached:.4g} of {end:g} s"
        )
        said = f"a flight {how} takes too long here{far}"
        if given is not None:
            return f"{said}; give a longer solver.step_s"
        if self.ended and self.ended[-1][0].max() < self.steps.max():
            most = self.ended[-1][0].max()
            said += f"; in {most} it came to its end, but its outcomes had not settled"
        return f"{said}; look at what is warned of, or give solver.step_s"


def _instants(
    shape: KernelSpec, ends: np.ndarray, changes: np.ndarray, every_s: float
) -> tuple[np.ndarray, np.ndarray]:
    """Times, stages and sides (n, 3) of the rows of a history, and their phases (n,), by number:
    every so many seconds, and both sides of the end of a phase and of the ``changes`` of joints
    within. A joint that is late is late in the phase after."""
    grid = np.arange(int(ends[-1] / every_s + 1e-9) + 1) * every_s
    found: list[tuple[float, int, int]] = []
    phases: list[int] = []
    begin = 0.0
    for number, (segment, end) in enumerate(zip(shape.segments, ends, strict=True)):
        late = 0.0 if segment.delay is None else float(shape.layout.nominal[segment.delay])
        for until, phase in (
            (max(begin, end - late), _phase(shape, number)),
            (end, _phase(shape, number + (segment.delay is not None))),
        ):
            if until - begin > _SAME_TIME:
                within = np.unique(
                    changes[(changes > begin + _SAME_TIME) & (changes < until - _SAME_TIME)]
                )
                steady = [
                    t
                    for t in grid
                    if begin + _SAME_TIME < t < until - _SAME_TIME
                    and (np.abs(within - t) > _SAME_TIME).all()
                ]
                rows = [(t, number, 0) for t in (begin, *steady, until)] + [
                    (t, number, side) for t in within for side in (-1, 1)
                ]
                found += sorted(rows)
                phases += len(rows) * [phase]
                begin = until
    return np.array(found), np.array(phases)


def _phase(shape: KernelSpec, number: int) -> int:
    """The phase of a segment; that in which joints are late is part of the next."""
    following = next(segment for segment in shape.segments[number:] if not segment.late)
    return [phase.name for phase in shape.scene.phase].index(following.phase)
