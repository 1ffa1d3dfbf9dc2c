"""The Python side of the door: blocks of arrays in and out of compiled code, threads, compiling, and what a run may ask for."""

import contextlib
import operator
import time
from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace
from types import ModuleType
from typing import Any

import numpy as np

from sepmc import schema
from sepmc.compiler.plan import Plan
from sepmc.scene.checks import MOST_ROWS
from sepmc.scene.model import Scene
from sepmc.schema import Status


@dataclass
class Block:
    """Arrays a call of the door fills."""

    outcomes: np.ndarray
    status: np.ndarray
    times: np.ndarray
    phases: np.ndarray
    history: np.ndarray
    rows: np.ndarray


def fly_block(plan: Plan, slots: np.ndarray, draws: np.ndarray, room: int, width: int, level: int) -> Block:
    """One call of the general kernel's door; draws (n, d) in SI. Its audit columns are all there are, whatever the plan's contents say."""
    from sepmc.kernels.batch import fly  # noqa: PLC0415

    n = len(draws)
    outcomes = len(schema.result_columns(replace(plan.contents, specialised=False)))
    block = Block(
        np.full((n, outcomes), np.nan),
        np.full(n, int(Status.NOT_FLOWN), dtype=np.int64),
        np.full((n, room), np.nan),
        np.zeros((n, room), dtype=np.int64),
        np.full((n, room, width), np.nan),
        np.zeros(n, dtype=np.int64),
    )
    nominal = np.ascontiguousarray(plan.nominal)
    fly(
        plan.model.scene, plan.model.table, plan.model.numbers, plan.tableau, nominal, slots, np.ascontiguousarray(draws),
        block.outcomes, block.status, block.times, block.phases, block.history, block.rows, level,
    )  # fmt: skip
    return block


def fly_specialised(
    kernel: ModuleType, plan: Plan, steps: np.ndarray, usual: np.ndarray, slots: np.ndarray, draws: np.ndarray, room: int = 0
) -> tuple[Block, np.ndarray]:
    """One call of a scene's own kernel; draws (n, d) in SI, fastest if stored by column.

    Returns the block, whose status is -1 where another kernel has to fly a case, and the times (phases, n) at which phases end.
    """
    n, columns = len(draws), schema.result_columns(replace(plan.contents, specialised=True))
    outcomes, status, ends = np.full((len(columns), n), np.nan), np.zeros(n, dtype=np.int64), np.empty((len(plan.phases), n))
    width = 2 * len(plan.joints) if room else 0
    history = np.full((n, room, width), np.nan)
    every = plan.tableau.history_step
    from sepmc.kernels.blocks import fly  # noqa: PLC0415

    model, nominal, drawn = plan.model, np.ascontiguousarray(plan.nominal), np.ascontiguousarray(draws.T)
    fly(
        kernel, model.scene, model.table, model.numbers, nominal, slots, drawn, steps, usual, every, outcomes, ends, history, status,
    )  # fmt: skip
    times = np.broadcast_to(np.arange(room) * every, (n, room))
    phases = np.broadcast_to(np.zeros(1, dtype=np.int64), (n, room))
    return Block(outcomes.T, status, times, phases, history, np.full(n, room)), ends


def whole(name: str, value: Any, least: int, most: int | None = None) -> int:
    """A whole number in range; raises ValueError with the name, the value and what is allowed."""
    try:
        if isinstance(value, bool):
            raise TypeError
        number = operator.index(value)
    except TypeError:
        raise ValueError(f"{name} = {value!r}: must be a whole number") from None
    if number < least or (most is not None and number > most):
        raise ValueError(f"{name} = {number}: must be >= {least}" + (f" and <= {most}" if most is not None else ""))
    return number


def check_every(step_s: float, scene: Scene, name: str = "step_s") -> None:
    """Raise ValueError if a history cannot have a row every ``step_s``."""
    most = 10 * MOST_ROWS
    if not (step_s > 0.0 and scene.run.end_time / step_s <= most):
        raise ValueError(f"{name} = {step_s}: must be > 0, and >= {scene.run.end_time / most:g} so that there are at most {most} rows")


def check_threads(threads: int | None) -> int | None:
    """``threads`` if this machine can use so many; raises ValueError otherwise."""
    if threads is None:
        return None
    from sepmc.kernels.batch import max_threads  # noqa: PLC0415

    if isinstance(threads, bool) or not 1 <= threads <= max_threads():
        raise ValueError(f"threads = {threads}: must lie in 1 to {max_threads()}, the cores of this machine")
    return threads


def use_threads(threads: int | None) -> None:
    """Fly on this many threads from now on, or on all."""
    from sepmc.kernels import batch  # noqa: PLC0415

    batch.use_threads(threads)


def warm_up(announce: Callable[[str], None] | None = None) -> float:
    """Make the general kernel ready: load it from the disk cache, after compiling it there if need be. Returns the seconds it took."""
    start = time.perf_counter()
    from sepmc.kernels import batch  # noqa: PLC0415

    if not batch.is_compiled():
        if announce:
            announce("compiling the general kernel, once per installation (one to two minutes) ...")
        batch.compile_apart()
    batch.compile_door()
    return time.perf_counter() - start


_interpreting = False


@contextlib.contextmanager
def interpreted(wanted: bool = True) -> Iterator[None]:
    """Fly kernels that are loaded meanwhile as plain Python: nothing is compiled, a case takes milliseconds instead of microseconds."""
    global _interpreting  # noqa: PLW0603
    before, _interpreting = _interpreting, wanted
    try:
        yield
    finally:
        _interpreting = before


def specialised_kernel(text: str, announce: Callable[[str], None] | None = None) -> ModuleType:
    """The kernel with this text, ready to fly: loaded from the disk cache, after compiling it there if need be."""
    if _interpreting:
        from sepmc.kernels import interpreted as plain  # noqa: PLC0415

        return plain.load(text)
    from sepmc.kernels import specialised  # noqa: PLC0415

    name = specialised.write(text)
    if not specialised.is_compiled(name):
        if announce:
            announce("compiling a kernel for scenes of this shape, once (some fifteen seconds) ...")
        specialised.compile_apart(name)
    return specialised.load(name)
