"""Simulation of one case with its time history: in plain Python, or compiled if that takes too
long."""

import math
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from sepmc import schema
from sepmc.campaign.execution.accuracy import SAFETY, decisive, errors, scales, scene_scales
from sepmc.campaign.execution.integration import (
    REPORT_EVERY_S,
    final_status,
    is_accepted_by,
    motion_is_finite,
    typical_durations,
)
from sepmc.campaign.execution.step_refinement import longest_step, refine_case_steps
from sepmc.engine.dispatch import (
    integrate_nominal,
    interpreted,
    load_kernel,
    progress_reporter,
)
from sepmc.engine.kernel_texts import written
from sepmc.engine.work_budget import COMPILED_LINE_S, LINE_S, Work, WorkLimitError
from sepmc.kernel.spec.kernel_spec import KernelSpec
from sepmc.kernel.spec.parameter_layout import ParameterLayout, make_parameter_layout
from sepmc.kernel.spec.structure import brief_transient, make_kernel_spec
from sepmc.kernel.spec.variant import Variant
from sepmc.routines.layout import FINER_STEPS, FULL_HISTORY
from sepmc.scene.messages import Log
from sepmc.scene.model import Scene
from sepmc.schema import Column, Contents, Status

# of a given step: the first refinement at which a case reaches its end gives the durations
_DURATION_FACTORS = (2, 16, 128)
_MIN_STEPS = 2  # of a segment, tried first
_MAX_WITHOUT_NUMBERS = 256  # steps after which a case without finite numbers is given up
# steps of a segment: beyond, unclear turns of pitch and roll are left to the audit
_MAX_FOR_ANGLES = 1024
_MAX_PLAIN_STEPS = 2048  # steps of a segment: more take less time compiled
# kernel lines of a case in plain Python: 9 s, as long as compiling takes; then compiled: 60 s
_PLAIN_WORK, _COMPILED_WORK = 2.5e7, 1e10
_LONG_S = 3.0  # longer integrations are announced
_MAX_STEPS = 2**20  # of a segment, for a case that does not converge
_SAME_TIME = 1e-12  # s
_NO_INSTANTS = np.empty((0, 3))  # times of history rows


@dataclass
class SingleCase:
    """Result of one case with its time history.

    Attributes
    ----------
    layout : ParameterLayout
        Layout of the parameters of the scene of the case.
    status : Status
    outcomes : ndarray, shape (o,)
        Outcomes, then audit columns, SI. The outcomes of a rejected case are NaN; all are NaN for a
        case that was not simulated.
    times : ndarray, shape (n,)
        Times of the history rows, s.
    phases : ndarray, shape (n,)
        Index of the phase of each history row.
    rows : ndarray, shape (n, columns)
        History, SI, in the columns of `sepmc.schema.history_columns`.
    notes : list of str
        Notes for the user if the case did not converge or used up its computing time; else empty.
    error : ndarray, shape (number of outcomes,), optional
        Relative numerical error of each outcome, without audit columns; None if unknown.
    compiled : bool
        True if the kernel was compiled, False if it ran in plain Python.
    """

    layout: ParameterLayout
    status: Status
    outcomes: np.ndarray
    times: np.ndarray
    phases: np.ndarray
    rows: np.ndarray
    notes: list[str]
    error: np.ndarray | None = None
    compiled: bool = False


class UnknownError(Exception):
    """A case could not be finished in plain Python within the allowed number of executed lines; the
    argument is the reason, as text for the user."""


class _SpentError(Exception):
    """The next compiled integration would exceed the number of kernel lines that a case may
    execute."""


class _RejectedError(Exception):
    """The kernel rejects the case: ``status`` is FINER_STEPS or the kernel variant that may
    integrate it."""

    def __init__(self, status: int):
        self.status = status


def simulate_case(
    scene: Scene,
    contents: Contents,
    row_interval_s: float,
    announce: Log | None = None,
    plain_work: float | None = None,
) -> SingleCase:
    """Simulate one case with its history, at the step that the file gives or at steps at which its
    outcomes converge to ``solver.accuracy``.

    Parameters
    ----------
    scene : Scene
        Scene with the values of the case.
    contents : Contents
        Parts of the scene of the campaign, from which the columns of outcomes and histories follow.
    row_interval_s : float
        Interval of history rows, s. There are also rows at the begin and the end of each phase, and
        just before and after each change of a joint and end of a stroke within it.
    announce : Log, optional
        Called with a message if a kernel is compiled, which is done where plain Python takes longer
        than some ten seconds.
    plain_work : float, optional
        Number of lines of the kernel that plain Python may execute (1e7 take some 5 s); if given,
        nothing is compiled.

    Returns
    -------
    SingleCase

    Raises
    ------
    UnknownError
        If the case needs more lines than ``plain_work``.
    """
    layout, variant = _layout(scene, contents), Variant.STANDARD
    columns = schema.outcome_columns(contents)
    work = Work(_PLAIN_WORK if plain_work is None else plain_work)
    while True:
        shape = make_kernel_spec(layout, variant=variant)
        run = _SingleRun(shape, layout, columns, row_interval_s, announce, work, plain_work is None)
        try:
            return run.run()
        except _RejectedError as rejected:
            status, finite = np.array(rejected.status), np.array(run.finite)
            variants = [v for v in shape.fallbacks if is_accepted_by(status, v, finite)]
            if not variants:
                return run.rejected(rejected.status)
            variant = (
                variants[0] if rejected.status != Variant.LEAST_SQUARES else Variant.LEAST_SQUARES
            )


def invalid_case(scene: Scene, contents: Contents) -> SingleCase:
    """Result of a case with an invalid parameter, which is not simulated: status INVALID_INPUT, NaN
    outcomes and audit columns, no history rows. ``contents`` is as for `simulate_case`."""
    layout, columns = _layout(scene, contents), len(schema.result_columns(contents))
    rows = np.empty((0, len(schema.history_columns(contents))))
    return SingleCase(
        layout,
        Status.INVALID_INPUT,
        np.full(columns, np.nan),
        np.empty(0),
        np.empty(0, dtype=np.int64),
        rows,
        [],
    )


def _layout(scene: Scene, contents: Contents) -> ParameterLayout:
    """Layout of the parameters of a case, with the columns (``contents``) of its campaign.

    The campaign may have more columns than the case alone: dispersions may give a stroke to a
    spring that has none in this case.
    """
    return replace(make_parameter_layout(scene), contents=contents)


class _SingleRun:
    """Integrations of one case by one kernel variant, at more and more steps: in plain Python, or
    compiled if that takes too long. A new one has loaded the kernel in plain Python, and integrated
    nothing.

    ``steps`` (segments,) always are numbers of steps, not their lengths: one for each segment of
    the kernel, that is a phase or a part of one. If the file gives the step, each is the number of
    steps that a given step is divided into. o is the number of outcomes.

    ``shape`` is the specification of the kernel, ``layout`` has the scene and the parameters of the
    case, and ``columns`` are those of its outcomes. ``row_interval_s`` is the interval of history
    rows, s. ``announce`` is called with messages on long integrations and on compiling. ``work``
    counts the lines that all kernel variants execute for this case. If ``may_compile`` is False,
    UnknownError is raised where a compiled kernel would be needed.
    """

    def __init__(
        self,
        shape: KernelSpec,
        layout: ParameterLayout,
        columns: list[Column],
        row_interval_s: float,
        announce: Log | None,
        work: Work,
        may_compile: bool,
    ):
        self.shape, self.layout, self.columns, self.row_interval_s, self.announce = (
            shape,
            layout,
            columns,
            row_interval_s,
            announce,
        )
        self.compiled = False
        self.text = written(shape, layout.scene.solver.method, FULL_HISTORY)
        with interpreted():
            self.kernel = load_kernel(self.text)
        stages = self.kernel.n_segments
        self.durations = np.full(stages, np.inf)
        self.outcomes, self.steps = np.empty(0), np.ones(stages, dtype=np.int64)
        # ends of segments and changes of joints, by steps and durations
        self.times_by_steps: dict[tuple[bytes, bytes], tuple[np.ndarray, np.ndarray]] = {}
        self.report = progress_reporter(announce, REPORT_EVERY_S)
        self.work, self.may_compile = work, may_compile
        self.per_step = 0.0  # lines per step, of the last integration in plain Python
        # steps and outcomes of the integrations that reached their end, in order of steps
        self.completed: list[tuple[np.ndarray, np.ndarray]] = []
        self.spent_note = ""  # note on a case without work left

    @property
    def finite(self) -> bool:
        """True if rates and attitudes of all bodies are finite at the end of the last
        integration."""
        return bool(motion_is_finite(self.outcomes[None, :], len(self.layout.bodies))[0])

    def run(self) -> SingleCase:
        """Simulate the case, and return its result with history and errors. Steps are added until
        the accuracy is reached. If the file gives ``solver.step_s``, steps have that length, and
        finer integrations give the durations of segments and the errors; there are no errors if
        one of them does not reach the end. Raises _RejectedError if the kernel rejects the case,
        UnknownError if it takes too long and must not be compiled."""
        scene, steps = self.layout.scene, np.ones(self.kernel.n_segments, dtype=np.int64)
        if scene.solver.step is None:
            steps, error, notes = self._converged_steps(steps)
            return self._with_error(self._with_rows(steps, notes), error)
        self._compile_for(scene.run.end_time / scene.solver.step)
        refined_outcomes = self._measure_durations(steps)
        result = self._with_rows(steps, [])
        if refined_outcomes is None or result.status > Status.NEVER_RELEASED:
            return result
        units, count = [c.unit for c in self.columns], len(self.columns)
        scale = scales(refined_outcomes[None, :count], units, scene_scales(scene, units))
        error = (
            SAFETY * errors(result.outcomes[None, :count], refined_outcomes[None, :count], scale)[0]
        )
        return self._with_error(result, error)

    def _with_error(self, result: SingleCase, error: np.ndarray) -> SingleCase:
        """Copy of ``result`` with the relative errors ``error`` (o,) of its outcomes. If the case
        reached its end, the largest one of a decisive outcome is also written into the audit column
        ``error`` of the outcomes, which both share."""
        if result.status <= Status.NEVER_RELEASED:
            result.outcomes[-1] = error[decisive(self.columns)].max(initial=0.0)
        return replace(result, error=error)

    def rejected(self, status: int) -> SingleCase:
        """Result of a case that every kernel rejects, with NaN outcomes and the history of the last
        steps tried; ``status`` is the (negative) one of the last rejection."""
        return self._with_rows(
            self.steps,
            [self.spent_note] if self.spent_note else [],
            Status(int(final_status(np.array([status]), np.array([self.finite]))[0])),
        )

    def _measure_durations(self, steps: np.ndarray) -> np.ndarray | None:
        """Measure the durations of the segments of a case whose step the file gives.

        The case is integrated with twice the ``steps`` (segments,), then with 16 and 128 times as
        many while the kernel asks for smaller steps and that is not too many. The durations are
        stored in this object. Returns outcomes and audit columns of the last integration, SI; None
        if the case does not reach its end in it.
        """
        solver, max_steps = (
            self.layout.scene.solver,
            _MAX_STEPS if self.compiled else _MAX_PLAIN_STEPS,
        )
        assert solver.step is not None
        is_known = self.kernel.n_segments == 1  # its duration is the end time
        affordable = max_steps * solver.step / self.layout.scene.run.end_time
        for times in _DURATION_FACTORS:
            if times > _DURATION_FACTORS[0] and (is_known or times > affordable):
                break
            outcomes, status, _ = self._integrate_at(times * steps)
            if status != FINER_STEPS:
                return outcomes.copy() if 0 <= status <= Status.NEVER_RELEASED else None
        return None

    def _integrate_at(
        self, steps: np.ndarray, instants: np.ndarray = _NO_INSTANTS
    ) -> tuple[np.ndarray, int, np.ndarray]:
        stages, self.steps = self.kernel.n_segments, steps
        given_step = self.layout.scene.solver.step is not None
        how = "" if given_step else f", now in {steps.max()} steps a phase"
        self.report(lambda seconds: f"still running after {seconds:.0f} s{how} ...")
        self.outcomes, status, unclear, ends, rows = self._call_kernel(steps, instants)
        self.times_by_steps[steps.tobytes(), self.durations.tobytes()] = (
            ends[:stages],
            ends[stages:],
        )
        if status in (Status.OK, Status.NEVER_RELEASED) and np.isinf(self.durations).all():
            self.durations[:] = typical_durations(ends[:stages, None], np.ones(1, dtype=bool))
        if (
            unclear
            and self.layout.scene.solver.step is None
            and steps.max() <= _MAX_FOR_ANGLES
            and 0 <= status <= Status.NEVER_RELEASED
        ):
            status = FINER_STEPS
        return self.outcomes, status, rows

    def _call_kernel(self, steps: np.ndarray, instants: np.ndarray) -> Any:
        """Call `integrate_nominal` with ``steps`` (segments,) in plain Python, or compiled once the
        lines allowed for plain Python are used up.

        ``instants`` (n, 3), from `_instants`, are those of the history rows. Returns outcomes,
        status, True if full turns of pitch or roll are unclear, end times of segments followed by
        times of changes, and history rows. Raises UnknownError if the kernel would have to be
        compiled and must not be."""
        most = float(steps.max())
        if not self.compiled:
            self._report_forecast(self.per_step * most)
        if not self.compiled:
            before = self.work.done
            try:
                with self.work.counted():
                    result = integrate_nominal(
                        self.kernel, self.layout, steps, self.durations, instants
                    )
                if not len(instants):
                    self.per_step = (self.work.done - before) / most
                return result
            except WorkLimitError:
                self.per_step = max(self.per_step, (self.work.done - before) / most)
                self._compile(self._reached_time())
        return integrate_nominal(self.kernel, self.layout, steps, self.durations, instants)

    def _report_forecast(self, lines: float) -> None:
        """Announce an integration of a number of kernel ``lines`` in plain Python if it takes
        longer than three seconds. If the lines exceed those left and compiling is allowed, compile
        the kernel instead; if it is not allowed, nothing is raised here."""
        if lines > self.work.left and self.may_compile:
            self._compile()
        elif lines * LINE_S > _LONG_S and self.announce:
            self.announce(
                f"the next integration takes plain Python about {lines * LINE_S:.0f} s ..."
            )

    def _with_rows(
        self, steps: np.ndarray, notes: list[str], forced_status: Status | None = None
    ) -> SingleCase:
        """Integrate with ``steps`` (segments,); return the result with its history and ``notes``.
        A case that fails is integrated once more, in at least about a step for each row of the
        history, unless the file gives the step: the step that fails has no rows.

        With a ``forced_status`` the result has that status and NaN outcomes, but its audit columns
        stay. Without one, _RejectedError is raised if the kernel rejects the case.
        """
        scene = self.layout.scene
        ends, changes = self._event_times(steps)
        instants, phases = _instants(
            self.shape, np.fmin(ends, scene.run.end_time), changes, self.row_interval_s
        )
        outcomes, status, rows = self._integrate_at(steps, instants)
        # the step that fails has no rows
        if status > Status.NEVER_RELEASED and scene.solver.step is None:
            steps = np.maximum(
                steps, min(_MAX_PLAIN_STEPS, math.ceil(scene.run.end_time / self.row_interval_s))
            )
            outcomes, status, rows = self._integrate_at(steps, instants)
        if forced_status is None and status < 0:
            raise _RejectedError(status)
        if forced_status is not None:
            status, outcomes[: len(self.columns)] = forced_status, np.nan  # audit columns are kept
        has_values = ~np.isnan(rows).all(axis=1)
        return SingleCase(
            self.layout,
            Status(status),
            outcomes,
            instants[has_values, 0],
            phases[has_values],
            rows[has_values],
            notes,
            None,
            self.compiled,
        )

    def _event_times(self, steps: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """End times of segments (segments,), and times (n,) of the changes of joints and ends of
        strokes within segments, s, as integrated with ``steps`` (segments,). The case is integrated
        only if that was not done before."""
        if self.kernel.n_segments == 1 and self.kernel.n_changes == 0:
            return np.array([self.layout.scene.run.end_time]), np.empty(0)
        key = steps.tobytes(), self.durations.tobytes()
        if key not in self.times_by_steps:
            self._integrate_at(steps)
        return self.times_by_steps[key]

    def _converged_steps(self, ones: np.ndarray) -> tuple[np.ndarray, np.ndarray, list[str]]:
        """Numbers of steps (segments,) with which the case converges, its relative errors (o,)
        there, and notes (one if it does not converge). ``ones`` (segments,) is an array of ones.
        Raises _RejectedError if the kernel rejects the case, UnknownError as `_compile`."""
        scene = self.layout.scene
        min_steps = max(
            _MIN_STEPS,
            math.ceil(scene.run.end_time / longest_step(scene, brief=brief_transient(scene))),
        )

        def try_ratio(ratio: float, _: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
            result, status = self._try_steps(round(min_steps / ratio) * ones)
            return result[None, : len(self.columns)], np.array(
                [Status.UNRESOLVED if status < 0 else status]
            )

        most = max(_MAX_WITHOUT_NUMBERS, 2 * min_steps)
        try:
            while self._try_steps(min_steps * ones)[1] == FINER_STEPS:
                if min_steps >= most and not self.finite:
                    raise _RejectedError(FINER_STEPS)
                min_steps *= 2
            ratio, error, notes = refine_case_steps(try_ratio, 1.0, scene, self.columns)
        except _SpentError:
            return self._last_completed()
        return round(min_steps / ratio) * ones, error, notes

    def _last_completed(self) -> tuple[np.ndarray, np.ndarray, list[str]]:
        """Result of `_converged_steps` for a case that may execute no more lines: steps
        (segments,) of the last integration that reached its end, relative errors (o,), which are
        its changes from the integration before (infinite if there was none), and a list with one
        note. Raises _RejectedError if no integration reached its end."""
        advice = "; to continue, give solver.step_s or a larger solver.accuracy"
        if not self.completed:
            self.spent_note = (
                f"{int(self.steps.max())} steps a phase do not suffice, and more would exceed the "
                f"computing time that a case may take{advice}"
            )
            raise _RejectedError(FINER_STEPS)
        steps, _ = self.completed[-1]
        count, scene = len(self.columns), self.layout.scene
        error = np.full(count, np.inf)
        if len(self.completed) > 1:
            units = [column.unit for column in self.columns]
            before, after = (
                np.nan_to_num(outcomes[None, :count]) for _, outcomes in self.completed[-2:]
            )
            error = errors(before, after, scales(after, units, scene_scales(scene, units)))[0]
        worst = int(np.where(decisive(self.columns), error, 0.0).argmax())
        return (
            steps,
            error,
            [
                f"the computing time of a case was used up at {int(steps.max())} steps a phase, "
                f"before it converged: the last halving of the step changed "
                f"{self.columns[worst].name} by "
                f"{error[worst]:.1e} of its size; requested {scene.solver.accuracy:g}{advice}"
            ],
        )

    def _try_steps(self, steps: np.ndarray) -> tuple[np.ndarray, int]:
        """Integrate the case with ``steps`` (segments,), the number of steps of each segment, by
        the compiled kernel if the largest of them is large (`_compile_for`) or the kernel has been
        compiled before; return its outcomes (o,), SI, and its status, which is FINER_STEPS if
        smaller steps are needed.

        An integration that reached its end is appended to ``completed``. Raises _RejectedError if
        the steps are too many, the case needs another kernel variant, or it needs smaller steps
        after many steps and another variant may do without; UnknownError if the kernel
        has to be compiled but may not be, _SpentError if the case may execute no more lines.
        """
        if steps.max() > _MAX_STEPS:
            raise _RejectedError(FINER_STEPS)
        self._compile_for(float(steps.max()))
        if self.compiled:
            self.work.compiled += self.per_step * float(steps.max())
            if self.work.compiled > _COMPILED_WORK:
                raise _SpentError
        outcomes, status, _ = self._integrate_at(steps)
        if 0 <= status <= Status.NEVER_RELEASED:
            self.completed.append((steps, outcomes.copy()))
        spared = steps.max() > _MAX_WITHOUT_NUMBERS and Variant.ANY_ORDER in self.shape.fallbacks
        if status < FINER_STEPS or (status == FINER_STEPS and spared):
            raise _RejectedError(status)
        return outcomes, status

    def _compile_for(self, steps: float) -> None:
        """Compile the kernel (`_compile`) if ``steps``, the largest number of steps of a segment,
        is more than plain Python takes (2,048). Raises UnknownError if the case needs it but
        compiling is not allowed."""
        if steps > _MAX_PLAIN_STEPS and not self.compiled:
            self._compile()

    def _compile(self, reached: float | None = None) -> None:
        """Compile the kernel, and use it from now on; raises UnknownError if that is not allowed.

        ``reached`` is the simulated time, s, at which an integration in plain Python was stopped,
        for the message of the error; None if none was.
        """
        if not self.may_compile:
            raise UnknownError(self._unknown_reason(reached))
        if self.announce:
            self.announce(
                "this case needs more steps than plain Python takes in some seconds, so its kernel "
                "is compiled; "
                f"its integrations take up to about {_COMPILED_WORK * COMPILED_LINE_S:.0f} s, "
                "longer if the machine is busy"
            )
        self.kernel, self.compiled = load_kernel(self.text, self.announce), True
        self.times_by_steps.clear()  # compiled, times can differ in the last bit

    def _reached_time(self) -> float:
        """Simulated time, s, that the integration in plain Python had reached when it stopped."""
        assert self.kernel.plain is not None
        return float(self.work.numbers[self.kernel.plain.BEGIN_T])

    def _unknown_reason(self, reached: float | None) -> str:
        """Text of `UnknownError`; ``reached`` is the simulated time, s, at which the integration
        was stopped, if known."""
        end, given_step = self.layout.scene.run.end_time, self.layout.scene.solver.step
        how = (
            f"of {self.steps.max()} steps a phase"
            if given_step is None
            else f"in steps of {given_step:g} s"
        )
        where = (
            ""
            if reached is None or math.isnan(reached)
            else f", stopped at {reached:.4g} of {end:g} s"
        )
        reason = f"an integration {how} takes too long here{where}"
        if given_step is not None:
            return f"{reason}; give a longer solver.step_s"
        if self.completed and self.completed[-1][0].max() < self.steps.max():
            most = self.completed[-1][0].max()
            reason += f"; with {most} it reached its end, but its outcomes had not converged"
        return (
            f"{reason}; the limit is one of work, not of time, and tables or loads with many kinks "
            "reach it too: look at the warnings, then give solver.step_s, or compile: sepmc run"
        )


def _instants(
    shape: KernelSpec, ends: np.ndarray, changes: np.ndarray, row_interval_s: float
) -> tuple[np.ndarray, np.ndarray]:
    """Instants of the history rows of a case, and the index of the phase of each row (n,).

    ``shape`` is the specification of the kernel, which has the segments and their delays. Each
    instant, a row of an array (n, 3), has the time, s, the index of the segment, and the side:
    -1 just before one of the ``changes``, 1 just after it, else 0. Instants are at every interval
    ``row_interval_s``, at the begin and end of each segment (``ends`` (segments,), s), and on both
    sides of ``changes``, times (s) of changes of joints and ends of strokes within segments. While
    the delayed release of a joint is pending, the phase is the next one. A segment that takes no
    time has no instants; where two segments meet, each has one.
    """
    grid = np.arange(int(ends[-1] / row_interval_s + 1e-9) + 1) * row_interval_s
    instants: list[tuple[float, int, int]] = []
    phases: list[int] = []
    begin = 0.0
    for number, (segment, end) in enumerate(zip(shape.segments, ends, strict=True)):
        delay = 0.0 if segment.delay is None else float(shape.layout.nominal[segment.delay])
        for upper, phase in (
            (max(begin, end - delay), _phase(shape, number)),
            (end, _phase(shape, number + (segment.delay is not None))),
        ):
            if upper - begin > _SAME_TIME:
                inside = np.unique(
                    changes[(changes > begin + _SAME_TIME) & (changes < upper - _SAME_TIME)]
                )
                grid_times = [
                    t
                    for t in grid
                    if begin + _SAME_TIME < t < upper - _SAME_TIME
                    and (np.abs(inside - t) > _SAME_TIME).all()
                ]
                rows = [(t, number, 0) for t in (begin, *grid_times, upper)] + [
                    (t, number, side) for t in inside for side in (-1, 1)
                ]
                instants += sorted(rows)
                phases += len(rows) * [phase]
                begin = upper
    return np.array(instants).reshape(-1, 3), np.array(phases)


def _phase(shape: KernelSpec, number: int) -> int:
    """Index of the phase of the segment with index ``number`` of the kernel ``shape``; a segment in
    which delayed releases are pending belongs to the next phase."""
    following = next(segment for segment in shape.segments[number:] if not segment.late)
    return [phase.name for phase in shape.scene.phase].index(following.phase)
