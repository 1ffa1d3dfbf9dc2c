"""The Python side of the door: blocks of arrays in and out of compiled code, threads, compiling,
and what a run may ask for."""

import contextlib
import math
import operator
import os
import time
from collections.abc import Callable, Iterator, Sequence
from contextvars import ContextVar
from dataclasses import dataclass, field
from numbers import Real
from typing import Any

import numpy as np

from sepmc import schema
from sepmc.engine.host_process import loading
from sepmc.engine.written_kernel import Kernel
from sepmc.kernel.spec.parameter_layout import Plan
from sepmc.scene.checks import MOST_ROWS
from sepmc.scene.messages import InputError, shorten
from sepmc.scene.model import Scene
from sepmc.schema import Status

_NO_LIMIT = 2**40  # to the number of steps
_EVERY_S = 5.0  # between two words on how far the compiling is
_waited: list[float] = []  # for compilers, s


def status_in(status: np.ndarray, kinds: Sequence[int]) -> np.ndarray:
    """Which of the cases (n,) have one of some kinds of status; ten times as fast as `numpy.isin`,
    which sorts."""
    found = status == kinds[0]
    for kind in kinds[1:]:
        found |= status == kind
    return np.asarray(found)


@dataclass
class RefinementSummary:
    """Counts and errors of the refined cases of a block.

    Attributes
    ----------
    error : ndarray, shape (o,)
        Largest error of each outcome over the cases that were integrated with refined steps.
    n_refined : int
        Cases integrated again with smaller steps.
    n_fallback : int
        Cases integrated again by a fallback kernel.
    n_unconverged : int
        Cases whose outcomes did not converge.
    indicators : ndarray, shape (g,) or (0,)
        Largest error indicators of the cases that were not refined; they give the errors of the
        outcomes of these cases.
    """

    error: np.ndarray
    n_refined: int = 0
    n_fallback: int = 0
    n_unconverged: int = 0
    indicators: np.ndarray = field(default_factory=lambda: np.zeros(0))

    def merged(self, other: "RefinementSummary") -> "RefinementSummary":
        """Summary of the cases of this one and of another one."""
        return RefinementSummary(
            np.maximum(self.error, other.error),
            self.n_refined + other.n_refined,
            self.n_fallback + other.n_fallback,
            self.n_unconverged + other.n_unconverged,
            self.indicators if len(self.indicators) else other.indicators,
        )


@dataclass
class Block:
    """Arrays that one call of a kernel fills, and the summary of the cases integrated again.

    Attributes
    ----------
    outcomes : ndarray, shape (n, o)
        Outcomes and audit columns, in SI units.
    status : ndarray, shape (n,)
        Status of each case; below 0 if the kernel rejected it.
    times : ndarray, shape (n, rows)
        Times of the history rows, s.
    phases : ndarray, shape (n, rows)
        Phase number of each history row.
    history : ndarray, shape (n, rows, columns)
        Separation speeds and distances.
    rows : ndarray, shape (n,)
        Number of valid history rows of each case.
    indicators : ndarray, shape (n, g), optional
        Error indicators (`sepmc.kernel.emit.context.Context`), not negative. NaN: unknown. Minus
        infinity: the steps were too long to count the full turns of pitch and roll.
    refinement : RefinementSummary, optional
        Summary of the cases integrated again.
    """

    outcomes: np.ndarray
    status: np.ndarray
    times: np.ndarray
    phases: np.ndarray
    history: np.ndarray
    rows: np.ndarray
    indicators: np.ndarray | None = None
    refinement: RefinementSummary | None = None

    @property
    def error(self) -> np.ndarray:
        """Estimated error of each case (n,): the last audit column."""
        return self.outcomes[:, -1]

    @property
    def has_indicators(self) -> np.ndarray:
        """Mask (n,) of the cases with all error indicators known; others are integrated again."""
        assert self.indicators is not None
        return np.asarray((self.indicators >= 0.0).all(axis=1))

    @property
    def turns_unclear(self) -> np.ndarray:
        """Mask (n,) of the cases whose full turns of pitch and roll need shorter steps."""
        if self.indicators is None:
            return np.zeros(len(self.status), dtype=bool)
        return np.asarray(np.isneginf(self.indicators).any(axis=1))

    @property
    def has_outcomes(self) -> np.ndarray:
        """Mask (n,) of the cases that have outcomes."""
        return status_in(self.status, (Status.OK, Status.NEVER_RELEASED))


def integrate_cases(
    kernel: Kernel,
    plan: Plan,
    steps: np.ndarray,
    typical: np.ndarray,
    slots: np.ndarray,
    draws: np.ndarray,
    room: int = 0,
    methods: np.ndarray | None = None,
) -> tuple[Block, np.ndarray]:
    """One call of a scene's own kernel; draws (n, d) in SI, fastest if stored by column. ``steps``,
    ``typical`` and ``methods``, each (stages,), as `sepmc.engine.blocks.integrate` has them; without
    methods, every stage is flown by its most exact one. A scene's ``solver.step`` is the pace of
    all its stages, and ``steps`` are in how many parts it is divided.

    Returns the block, whose status is below 0 where the kernel does not vouch for a case
    (FINER_STEPS and ANOTHER_KERNEL of `sepmc.routines.layout`), and the times (stages, n) at which
    phases end, and joints that are late have let go.
    """
    n, columns = len(draws), schema.result_columns(plan.contents)
    # kernels write all of it but the estimate of the error, the last of the columns
    outcomes, status = (
        np.empty((len(columns) + kernel.n_indicators, n)),
        np.empty(n, dtype=np.int64),
    )
    outcomes[len(columns) - 1] = np.nan
    ends = np.empty((kernel.n_segments, n))
    width = 2 * len(plan.joints) if room else 0
    history = np.full((n, room, width), np.nan)
    _call(
        kernel,
        plan,
        steps,
        typical,
        slots,
        draws,
        plan.scene.run.history_step,
        outcomes,
        ends,
        history,
        status,
        methods,
    )
    rows = np.broadcast_to(np.arange(room) * plan.scene.run.history_step, (n, room))
    phases = np.broadcast_to(np.zeros(1, dtype=np.int64), (n, room))
    kept = np.where(status > Status.NEVER_RELEASED, 0, room)
    block = Block(
        outcomes[: len(columns)].T, status, rows, phases, history, kept, outcomes[len(columns) :].T
    )
    return block, ends


def integrate_nominal(
    kernel: Kernel, plan: Plan, steps: np.ndarray, typical: np.ndarray, instants: np.ndarray
) -> tuple[np.ndarray, int, bool, np.ndarray, np.ndarray]:
    """The nominal case of a plan by a kernel written for full histories: outcomes and audit (o,) in
    SI; its status, as `integrate_cases` has it; whether shorter steps may tell by how many turns pitch
    and roll went on; the times (stages + changes,) at which stages end, then those at which joints
    let go within, and rows (n, columns) at ``instants`` (n, 3), each a time, the number of a stage,
    and 1 or -1 if the row is to be as things are just after that time or before; NaN if the case
    did not get so far."""
    columns, none = len(schema.result_columns(plan.contents)), np.empty(0, dtype=np.int64)
    outcomes, status = (
        np.full((columns + kernel.n_indicators, 1), np.nan),
        np.zeros(1, dtype=np.int64),
    )
    ends = np.empty((kernel.n_segments + kernel.n_changes, 1))
    history = np.full((1, len(instants), len(schema.history_columns(plan.contents))), np.nan)
    _call(
        kernel,
        plan,
        steps,
        typical,
        none,
        np.empty((1, 0)),
        instants,
        outcomes,
        ends,
        history,
        status,
    )
    return (
        outcomes[:columns, 0],
        int(status[0]),
        bool(np.isneginf(outcomes[columns:]).any()),
        ends[:, 0],
        history[0],
    )


def _call(
    kernel, plan, steps, typical, slots, draws, every, outcomes, ends, history, status, methods=None
) -> None:
    """One call of the door of written kernels."""
    from sepmc.engine.blocks import integrate  # noqa: PLC0415

    model, nominal, drawn = (
        plan.model,
        np.ascontiguousarray(plan.nominal),
        np.ascontiguousarray(draws.T),
    )
    if plan.scene.solver.step is not None:
        times, steps, pace = (
            int(steps.max()),
            np.full(kernel.n_segments, _NO_LIMIT),
            np.full(kernel.n_segments, plan.scene.solver.step),
        )
    else:
        times, pace = 1, np.zeros(kernel.n_segments)
    integrate(
        kernel, model.scene, model.table, model.numbers, nominal, slots, drawn, steps, pace,
        times, typical, every, outcomes, ends, history,
        status, np.zeros(kernel.n_segments, dtype=np.int64) if methods is None else methods,
    )  # fmt: skip


def check_int(name: str, value: Any, least: float, most: float | None = None) -> int:
    """A whole number in range; raises InputError (a ValueError) with the name, the value and what
    is allowed."""
    try:
        if isinstance(value, bool):
            raise TypeError
        is_whole = isinstance(value, float) and value.is_integer()  # as tables of numbers hold it
        number = int(value) if is_whole else operator.index(value)
    except TypeError:
        raise InputError(f"{name} = {value!r}: must be a whole number") from None
    if number < least or (most is not None and number > most):
        raise InputError(
            f"{name} = {number}: must be >= {least}"
            + (f" and <= {most}" if most is not None else "")
        )
    return number


def check_text(name: str, value: Any, example: str) -> str:
    """A text; raises InputError (a ValueError) with the name, the value and an example."""
    if not isinstance(value, str):
        raise InputError(f"{name} = {shorten(value)}: must be text, as {example!r}")
    return value


def check_history_step(step_s: float, scene: Scene, name: str = "step_s") -> None:
    """Raise InputError, a ValueError, if a history cannot have a row every ``step_s``."""
    most = 10 * MOST_ROWS
    if isinstance(step_s, bool) or not isinstance(step_s, Real):
        raise InputError(f"{name} = {shorten(step_s)}: must be a number of seconds")
    if not (step_s > 0.0 and scene.run.end_time / step_s <= most):
        raise InputError(
            f"{name} = {step_s}: must be > 0, and >= {scene.run.end_time / most:g} so that there "
            f"are at most {most} rows"
        )


def check_threads(threads: int | None) -> int | None:
    """``threads`` if compiled code can use so many here.

    Raises
    ------
    InputError
        If it cannot, or if Numba's settings allow no threads at all.
    """
    from sepmc.engine import threads as own  # noqa: PLC0415  (numba)

    own.in_use()
    if threads is None:
        return None
    found, most = check_int("threads", threads, -math.inf), own.max_threads()
    if not 1 <= found <= most:
        raise InputError(
            f"threads = {found}: must lie in 1 to {most}, the cores of this machine or fewer where "
            "NUMBA_NUM_THREADS is set"
        )
    return found


def thread_notes(threads: int | None) -> list[str]:
    """What deserves a look of the number of threads: `sepmc.engine.threads.fork_notes`."""
    from sepmc.engine import threads as own  # noqa: PLC0415

    return own.fork_notes(threads)


def use_threads(threads: int | None) -> None:
    """Fly on this many threads from now on, or on all."""
    from sepmc.engine import threads as own  # noqa: PLC0415

    own.use_threads(threads)


@contextlib.contextmanager
def using_threads(threads: int | None) -> Iterator[None]:
    """Fly on this many threads meanwhile, or on all; then on as many as Numba was set to."""
    from sepmc.engine import threads as own  # noqa: PLC0415

    with own.using_threads(threads):
        yield


# of this Python thread: others go on as they were
_interpreting: ContextVar[bool] = ContextVar("interpreting", default=False)


@contextlib.contextmanager
def interpreted(wanted: bool = True) -> Iterator[None]:
    """Fly kernels that are loaded meanwhile as plain Python: nothing is compiled, a case takes
    milliseconds instead of microseconds."""
    before = _interpreting.set(wanted)
    try:
        yield
    finally:
        _interpreting.reset(before)


def progress_reporter(
    announce: Callable[[str], None] | None, every_s: float
) -> Callable[[Callable[[float], str]], None]:
    """What tells how far something is, if the last word on it was so many seconds ago: by a text
    made of the seconds since it began."""
    begun = last = time.monotonic()

    def tell(text: Callable[[float], str]) -> None:
        nonlocal last
        now = time.monotonic()
        if announce and now - last > every_s:
            last = now
            announce(text(now - begun))

    return tell


def load_kernel(text: str, announce: Callable[[str], None] | None = None) -> Kernel:
    """The kernel with this text, ready to fly: loaded from the disk cache, after compiling there
    what of it is not yet."""
    if _interpreting.get() or os.environ.get("NUMBA_DISABLE_JIT", "0") != "0":
        from sepmc.engine import interpreted as plain  # noqa: PLC0415

        with loading:
            return plain.load(text)
    from sepmc.engine import kernel_cache  # noqa: PLC0415

    pieces = kernel_cache.compile_units_of(text)
    left = len(kernel_cache.missing_units(pieces))
    if left:
        if announce:
            announce(
                f"compiling {left} piece{'s' * (left != 1)} of this scene's kernel, once; about "
                "half a second of a core each ..."
            )
        tell = progress_reporter(announce, _EVERY_S)

        def progress(done: int, total: int) -> None:
            if done < total:
                tell(lambda seconds: f"compiled {done} of {total} in {seconds:.0f} s")
            elif announce:  # the last word, however soon after another
                announce(f"compiled {done} of {total}")

        begun = time.monotonic()
        try:
            kernel_cache.compile_in_subprocesses(pieces, progress)
        finally:
            _waited.append(time.monotonic() - begun)
    with loading:
        return kernel_cache.load(pieces)


def compile_wait_s() -> float:
    """How long this process has waited for compilers so far, s."""
    return sum(_waited)
