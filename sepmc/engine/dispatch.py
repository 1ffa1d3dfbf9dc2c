"""Python side of compiled code: loading and compiling of kernels, calling them with arrays, their
threads, and checks of the arguments of a run."""

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
from sepmc.engine.formula_outcomes import fill_formulas
from sepmc.engine.host_process import loading
from sepmc.engine.written_kernel import Kernel
from sepmc.jit import PLAIN
from sepmc.kernel.spec.parameter_layout import ParameterLayout
from sepmc.scene.checks import MOST_ROWS
from sepmc.scene.messages import InputError, Log, shorten
from sepmc.scene.model import Scene
from sepmc.schema import Status

_NO_LIMIT = 2**40  # number of steps
_EVERY_S = 5.0  # between two messages on the progress of compiling
_waited: list[float] = []  # times waited for compilers, s


def status_in(status: np.ndarray, codes: Sequence[int]) -> np.ndarray:
    """Return the mask of the cases whose status is one of some codes.

    Ten times as fast as `numpy.isin`, which sorts.

    Parameters
    ----------
    status : ndarray, shape (n,)
        Status of each case.
    codes : sequence of int
        At least one code.

    Returns
    -------
    ndarray of bool, shape (n,)
    """
    mask = status == codes[0]
    for code in codes[1:]:
        mask |= status == code
    return np.asarray(mask)


@dataclass
class RefinementSummary:
    """Summary of the cases of a `Block` that were integrated again: with smaller steps, or by
    another kernel.

    Attributes
    ----------
    error : ndarray, shape (o,)
        Largest relative error of each outcome over the cases that were integrated with smaller
        steps; of the outcomes that can have the largest error of a case (`Estimate.leading` of
        `sepmc.campaign.execution.error_estimate`), over the other cases, too. Here o is the number
        of outcomes, without audit columns.
    n_refined : int
        Number of cases integrated again with smaller steps.
    n_fallback : int
        Number of cases integrated again by a fallback kernel, which handles rarer situations.
    n_unconverged : int
        Number of cases whose outcomes did not converge.
    indicators : ndarray, shape (g,) or (0,)
        Largest value of each error indicator over the cases whose estimated error is within the
        limit; the errors of their other outcomes follow from it. Empty: not recorded.
    """

    error: np.ndarray
    n_refined: int = 0
    n_fallback: int = 0
    n_unconverged: int = 0
    indicators: np.ndarray = field(default_factory=lambda: np.zeros(0))

    def merged(self, other: "RefinementSummary") -> "RefinementSummary":
        """Return the summary of the cases of this summary and of another one together. Its
        indicators are not combined: they are those of this one, or, if it has none, of the
        other."""
        return RefinementSummary(
            np.maximum(self.error, other.error),
            self.n_refined + other.n_refined,
            self.n_fallback + other.n_fallback,
            self.n_unconverged + other.n_unconverged,
            self.indicators if len(self.indicators) else other.indicators,
        )


@dataclass
class Block:
    """Results of n cases that one call of a kernel integrated, and a summary of those of them that
    were integrated again afterwards. There are o result columns and g error indicators.

    Attributes
    ----------
    outcomes : ndarray, shape (n, o)
        Outcomes and audit columns (`sepmc.schema.result_columns`), in SI units.
    status : ndarray, shape (n,)
        Status of each case; below 0 if the kernel rejected it.
    times : ndarray, shape (n, rows)
        Times of the history rows, s.
    history : ndarray, shape (n, rows, columns)
        Separation speed and distance of each joint (`sepmc.schema.separation_columns`), SI units.
    rows : ndarray, shape (n,)
        Number of valid history rows of each case.
    indicators : ndarray, shape (n, g), optional
        Error indicators (`sepmc.kernel.emit.context.Context`), not negative. NaN: unknown. Minus
        infinity: the steps were too long to count the full turns of pitch and roll.
    refinement : RefinementSummary, optional
        Summary of the cases integrated again; None before that was attempted.
    """

    outcomes: np.ndarray
    status: np.ndarray
    times: np.ndarray
    history: np.ndarray
    rows: np.ndarray
    indicators: np.ndarray | None = None
    refinement: RefinementSummary | None = None

    @property
    def error(self) -> np.ndarray:
        """Estimated relative error of each case (n,): the last audit column, ``error``. The
        kernel leaves it NaN; it is estimated afterwards."""
        return self.outcomes[:, -1]

    @property
    def has_indicators(self) -> np.ndarray:
        """Mask (n,) of the cases whose error indicators are all known (neither NaN nor minus
        infinity). The error of the other cases becomes known only when they are integrated again.
        ``indicators`` must not be None."""
        assert self.indicators is not None
        return np.asarray((self.indicators >= 0.0).all(axis=1))

    @property
    def turns_unclear(self) -> np.ndarray:
        """Mask (n,) of the cases whose steps were too long to count the full turns of pitch and
        roll; False in all cases if ``indicators`` is None."""
        if self.indicators is None:
            return np.zeros(len(self.status), dtype=bool)
        return np.asarray(np.isneginf(self.indicators).any(axis=1))

    @property
    def has_outcomes(self) -> np.ndarray:
        """Mask (n,) of the cases that have outcomes: their status is ok or never-released."""
        return status_in(self.status, (Status.OK, Status.NEVER_RELEASED))


def integrate_cases(
    kernel: Kernel,
    layout: ParameterLayout,
    steps: np.ndarray,
    typical: np.ndarray,
    slots: np.ndarray,
    samples: np.ndarray,
    n_rows: int = 0,
    methods: np.ndarray | None = None,
) -> tuple[Block, np.ndarray]:
    """Integrate cases with the kernel of a scene, in one call.

    Parameters
    ----------
    kernel : Kernel
    layout : ParameterLayout
        Nominal parameters and content of the scene.
    steps : ndarray of int, shape (segments,)
        Number of steps of each segment. If the scene gives ``solver.step``, steps are at most that
        length divided by the largest of these numbers.
    typical : ndarray, shape (segments,)
        Typical duration of each segment, s (`sepmc.engine.blocks.integrate`).
    slots : ndarray of int, shape (d,)
        Positions of the sampled values in the parameter vector.
    samples : ndarray, shape (n, d)
        Sampled values in SI units; fastest if stored by column.
    n_rows : int
        Number of rows of the separation history of a case, from the start at intervals of
        ``run.history_step_s``; 0 for none.
    methods : ndarray of int, shape (segments,), optional
        Index of the integration method in ``kernel.methods`` of each segment; by default the most
        accurate one, 0.

    Returns
    -------
    block : Block
        Its status is below 0 where the kernel rejects a case: FINER_STEPS of
        `sepmc.routines.layout` if shorter steps may succeed, else the code of the
        `sepmc.kernel.spec.variant.Variant` of the kernel that may integrate it.
    ends : ndarray, shape (segments, n)
        Times at which segments end, s: ends of phases, and delayed releases; the end of the run for
        segments that a case does not reach before.
    """
    n, columns = len(samples), schema.result_columns(layout.contents)
    # the kernel writes all outcomes but the last, the estimated error
    outcomes, status = (
        np.empty((len(columns) + kernel.n_indicators, n)),
        np.empty(n, dtype=np.int64),
    )
    outcomes[len(columns) - 1] = np.nan
    ends = np.empty((kernel.n_segments, n))
    width = 2 * len(layout.joints) if n_rows else 0
    history = np.full((n, n_rows, width), np.nan)
    _call(
        kernel, layout, steps, typical, slots, samples, layout.scene.run.history_step, outcomes,
        ends, history, status, methods,
    )  # fmt: skip
    rows = np.broadcast_to(np.arange(n_rows) * layout.scene.run.history_step, (n, n_rows))
    valid = np.where(status > Status.NEVER_RELEASED, 0, n_rows)
    block = Block(
        outcomes[: len(columns)].T, status, rows, history, valid, outcomes[len(columns) :].T
    )
    return block, ends


def integrate_nominal(
    kernel: Kernel,
    layout: ParameterLayout,
    steps: np.ndarray,
    typical: np.ndarray,
    instants: np.ndarray,
) -> tuple[np.ndarray, int, bool, np.ndarray, np.ndarray]:
    """Integrate the nominal case, without dispersions, with a kernel written for full histories.

    Parameters
    ----------
    kernel : Kernel
    layout : ParameterLayout
    steps : ndarray of int, shape (segments,)
        As in `integrate_cases`.
    typical : ndarray, shape (segments,)
        Typical duration of each segment, s (`sepmc.engine.blocks.integrate`).
    instants : ndarray, shape (m, 3)
        As in `integrate_histories`.

    Returns
    -------
    outcomes : ndarray, shape (o,)
        Outcomes and audit columns, in SI units.
    status : int
        As in `integrate_cases`.
    turns_unclear : bool
        True if the steps were too long to count the full turns of pitch and roll.
    ends : ndarray, shape (segments + changes,)
        Times at which segments end, then times of the changes of joints and the ends of strokes
        within segments, s.
    rows : ndarray, shape (m, columns)
        History row for each of the ``instants``, SI units (`sepmc.schema.history_columns`); NaN
        where the case is in another segment or has ended.
    """
    outcomes, status, ends, rows = integrate_histories(
        kernel, layout, steps, typical, np.empty(0, dtype=np.int64), np.empty((1, 0)), instants
    )
    columns = len(schema.result_columns(layout.contents))
    return (
        outcomes[:columns, 0],
        int(status[0]),
        bool(np.isneginf(outcomes[columns:]).any()),
        ends[:, 0],
        rows[0],
    )


def integrate_histories(
    kernel: Kernel,
    layout: ParameterLayout,
    steps: np.ndarray,
    typical: np.ndarray,
    slots: np.ndarray,
    samples: np.ndarray,
    instants: np.ndarray,
    rows: np.ndarray | None = None,
) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
    """Integrate cases with a kernel written for full histories, in one call.

    Parameters
    ----------
    kernel : Kernel
    layout : ParameterLayout
    steps : ndarray of int, shape (segments,)
        As in `integrate_cases`.
    typical : ndarray, shape (segments,)
        Typical duration of each segment, s (`sepmc.engine.blocks.integrate`).
    slots : ndarray of int, shape (d,)
        Positions of the sampled values in the parameter vector.
    samples : ndarray, shape (n, d)
        Sampled values in SI units.
    instants : ndarray, shape (m, 3)
        For each history row its time, s; the number of its segment; and 1 for the state just after
        that time, -1 for that just before it, 0 where they do not differ.
    rows : ndarray, shape (n, m, columns), optional
        Array to write the history rows into; by default a new one.

    Returns
    -------
    outcomes : ndarray, shape (o + indicators, n)
        Outcomes and audit columns in SI units, then error indicators.
    status : ndarray, shape (n,)
        As in `integrate_cases`.
    ends : ndarray, shape (segments + changes, n)
        Times at which segments end, then times of the changes of joints and the ends of strokes
        within segments, s.
    rows : ndarray, shape (n, m, columns)
        History rows in SI units (`sepmc.schema.history_columns`); NaN where a case is in another
        segment or has ended.
    """
    n, columns = len(samples), len(schema.result_columns(layout.contents))
    outcomes = np.full((columns + kernel.n_indicators, n), np.nan)
    status = np.zeros(n, dtype=np.int64)
    ends = np.empty((kernel.n_segments + kernel.n_changes, n))
    if rows is None:
        rows = np.empty((n, len(instants), len(schema.history_columns(layout.contents))))
    rows.fill(np.nan)
    _call(
        kernel, layout, steps, typical, slots, samples, instants, outcomes, ends, rows, status,
    )  # fmt: skip
    return outcomes, status, ends, rows


def _call(
    kernel,
    layout,
    steps,
    typical,
    slots,
    samples,
    history_times,
    outcomes,
    ends,
    history,
    status,
    methods=None,
) -> None:
    """Integrate cases with the nominal parameters and content of a layout
    (`sepmc.engine.blocks.integrate`, which explains the arguments), then compute the outcomes by
    formulas. The results are written into ``outcomes``, ``ends``, ``history`` and ``status``.

    Unlike there, ``samples`` has a row for each case. If the scene gives ``solver.step``, that is
    ``pace`` there, and the maximum of ``steps`` is ``times``. ``methods`` None: the most accurate
    one in each segment."""
    from sepmc.engine.blocks import integrate  # noqa: PLC0415

    model, nominal, sampled = (
        layout.model,
        np.ascontiguousarray(layout.nominal),
        np.ascontiguousarray(samples.T),
    )
    if layout.scene.solver.step is not None:
        times, steps, pace = (
            int(steps.max()),
            np.full(kernel.n_segments, _NO_LIMIT),
            np.full(kernel.n_segments, layout.scene.solver.step),
        )
    else:
        times, pace = 1, np.zeros(kernel.n_segments)
    integrate(
        kernel, model.scene, model.table, model.numbers, nominal, slots, sampled, steps, pace,
        times, typical, history_times, outcomes, ends, history,
        status, np.zeros(kernel.n_segments, dtype=np.int64) if methods is None else methods,
    )  # fmt: skip
    fill_formulas(layout.contents, outcomes, status)


def check_int(name: str, value: Any, minimum: float, maximum: float | None = None) -> int:
    """Convert a value to an integer and check that it lies in a range.

    Parameters
    ----------
    name : str
        Name of the argument, for the message.
    value : object
        An integer, or a float with an integer value (tables of numbers contain such); no bool.
    minimum, maximum : float
        Inclusive bounds; no upper bound if ``maximum`` is None.

    Returns
    -------
    int

    Raises
    ------
    InputError
        If it is no such value; the message has the name, the value and what is allowed.
    """
    try:
        if isinstance(value, bool):
            raise TypeError
        is_whole = isinstance(value, float) and value.is_integer()  # as in tables of numbers
        number = int(value) if is_whole else operator.index(value)
    except TypeError:
        raise InputError(f"{name} = {value!r}: must be a whole number") from None
    if number < minimum or (maximum is not None and number > maximum):
        allowed = f">= {minimum}" if maximum is None else f">= {minimum} and <= {maximum}"
        raise InputError(f"{name} = {number}: must be {allowed}")
    return number


def check_text(name: str, value: Any, example: str) -> str:
    """Return ``value`` if it is text.

    Raises
    ------
    InputError
        If it is anything else; the message has ``name``, the value and ``example``, a valid text.
    """
    if not isinstance(value, str):
        raise InputError(f"{name} = {shorten(value)}: must be text, such as {example!r}")
    return value


def check_history_step(step_s: float, scene: Scene, name: str = "step_s") -> None:
    """Raise InputError unless ``step_s`` can be the interval between the rows of a history of the
    scene: a number of seconds > 0 that gives at most ten times `MOST_ROWS` rows. ``name`` is the
    name of ``step_s`` in the message."""
    limit = 10 * MOST_ROWS
    if isinstance(step_s, bool) or not isinstance(step_s, Real):
        raise InputError(f"{name} = {shorten(step_s)}: must be a number of seconds")
    if not (step_s > 0.0 and scene.run.end_time / step_s <= limit):
        raise InputError(
            f"{name} = {step_s}: must be > 0, and >= {scene.run.end_time / limit:g} so that the "
            f"history has at most {limit} rows"
        )


def check_threads(threads: int | None) -> int | None:
    """Return ``threads``, as an integer, if that many can be requested (1 to `max_threads`); None,
    which means all of them, is returned as None. A forked process accepts them too, but uses one.
    The threads of compiled code are started by this.

    Raises
    ------
    InputError
        If they cannot be requested, or if Numba's threading layer is unknown or not installed.
    """
    from sepmc.engine import threads as pool  # noqa: PLC0415  (numba)

    pool.in_use()
    if threads is None:
        return None
    count, limit = check_int("threads", threads, -math.inf), pool.max_threads()
    if not 1 <= count <= limit:
        raise InputError(
            f"threads = {count}: must lie in 1 to {limit}, the cores that this process "
            "may use, or NUMBA_NUM_THREADS where that is set"
        )
    return count


def thread_notes(threads: int | None) -> list[str]:
    """Return the note that this forked process uses one thread instead of ``threads`` (None: all);
    an empty list if it does not, or has returned the note before."""
    from sepmc.engine import threads as pool  # noqa: PLC0415

    return pool.fork_notes(threads)


def use_threads(threads: int | None) -> None:
    """Make compiled code that this Python thread calls run on ``threads`` threads from now on;
    None, or more than there are: on all. ``threads`` is not checked; InputError is raised if
    Numba's threading layer is unknown or not installed."""
    from sepmc.engine import threads as pool  # noqa: PLC0415

    pool.use_threads(threads)


@contextlib.contextmanager
def using_threads(threads: int | None) -> Iterator[None]:
    """Context in which compiled code runs on ``threads`` threads (1 or more; None: on all); the
    former number is restored at its end. Raises InputError if Numba's threading layer is unknown or
    not installed."""
    from sepmc.engine import threads as pool  # noqa: PLC0415

    with pool.using_threads(threads):
        yield


# a context variable: other Python threads are not affected
_interpreting: ContextVar[bool] = ContextVar("interpreting", default=False)


@contextlib.contextmanager
def interpreted(wanted: bool = True) -> Iterator[None]:
    """Context in which kernels are loaded as plain Python if ``wanted`` is true, else as compiled
    code (unless NUMBA_DISABLE_JIT is set); other Python threads are not affected. In plain Python
    nothing is compiled, but a case takes milliseconds, not microseconds."""
    before = _interpreting.set(wanted)
    try:
        yield
    finally:
        _interpreting.reset(before)


def is_interpreting() -> bool:
    """Return True if kernels that are loaded now run as plain Python: in a context of
    `interpreted`, or if the environment variable NUMBA_DISABLE_JIT is set and not 0."""
    return _interpreting.get() or os.environ.get(PLAIN, "0") != "0"


def progress_reporter(log: Log | None, every_s: float) -> Callable[[Callable[[float], str]], None]:
    """Create a function that logs progress at most once per interval.

    Parameters
    ----------
    log : callable (str), optional
        Receives the messages; None: no messages.
    every_s : float
        Minimum time between two messages, s; the first comes no earlier than this, either.

    Returns
    -------
    callable
        Call it often with a function that renders the message from the seconds since the start;
        that function is called only if a message is due.
    """
    start = reported = time.monotonic()

    def report(render: Callable[[float], str]) -> None:
        nonlocal reported
        now = time.monotonic()
        if log and now - reported > every_s:
            reported = now
            log(render(now - start))

    return report


def load_kernel(text: str, log: Log | None = None) -> Kernel:
    """Load a kernel: compiled, from the disk cache, after compiling the compile units that are
    missing there; or as plain Python, if `is_interpreting`.

    Parameters
    ----------
    text : str
        Python source of the kernel.
    log : callable (str), optional
        Receives messages on the progress of compiling.

    Returns
    -------
    Kernel
    """
    if is_interpreting():
        from sepmc.engine import interpreted as plain  # noqa: PLC0415

        with loading:
            return plain.load(text)
    from sepmc.engine import kernel_cache  # noqa: PLC0415

    units = kernel_cache.compile_units_of(text)
    count = len(kernel_cache.missing_units(units))
    if count:
        if log:
            log(
                f"compiling {count} unit{'s' * (count != 1)} of this scene's kernel, once; about "
                "0.1 s of a core each ..."
            )
        report = progress_reporter(log, _EVERY_S)

        def progress(done: int, total: int) -> None:
            if done < total:
                report(lambda seconds: f"compiled {done} of {total} units in {seconds:.0f} s")
            elif log:  # the last message is never skipped
                log(f"compiled {done} of {total} units")

        start = time.monotonic()
        try:
            kernel_cache.compile_missing(units, progress)
        finally:
            _waited.append(time.monotonic() - start)
    with loading:
        return kernel_cache.load(units)


def compile_wait_s() -> float:
    """Return the total time, s, for which this process has waited for the compilation of
    kernels."""
    return sum(_waited)
