"""Check that outcomes are the same to the last bit for any number of threads, size of chunks and
order of cases, and for one case alone."""

from collections.abc import Callable, Iterator

import numpy as np

from sepmc.bench.study import SolverVariant, Study
from sepmc.engine.dispatch import use_threads

MAX_CASES = 2000  # cases run each time
CHUNKS = (1, 7, 64, 1000)
ALONE = (0, 3, -1)


def same_bits(study: Study) -> dict[str, bool]:
    """Return True or False for each kind of change (threads, chunks, order, one case alone), by its
    description: True if outcomes and statuses stay the same to the last bit. At most 2000 cases are
    run for each."""
    inputs = study.inputs[: min(MAX_CASES, study.own_cases)]
    variant = SolverVariant(study.integration, study.campaign, len(inputs))
    use_threads(study.threads)
    expected = _integrate(variant, inputs)
    return {
        change: all(_identical(run(), select(expected)) for run, select in trials)
        for change, trials in _trials(study, variant, inputs).items()
    }


RowBatch = tuple[np.ndarray, np.ndarray]
Trial = tuple[Callable[[], RowBatch], Callable[[RowBatch], RowBatch]]


def _trials(study: Study, variant: SolverVariant, inputs: np.ndarray) -> dict[str, Iterator[Trial]]:
    """Return the trials of each kind of change, by its description. A trial is a pair of functions:
    the first, without arguments, integrates cases under the change and returns their results; the
    second takes the results of all cases, integrated without it, and selects those of the same
    cases, in the same order. Both must be equal. ``variant`` has the kernel and the steps;
    ``inputs`` (n, d) are those of all cases, SI."""

    def all_of(rows: RowBatch) -> RowBatch:
        """Return all rows."""
        return rows

    def on_one_thread() -> RowBatch:
        """Integrate all cases on one thread; then set the threads of the study again."""
        use_threads(1)
        try:
            return _integrate(variant, inputs)
        finally:
            use_threads(study.threads)

    def in_chunks(size: int) -> Callable[[], RowBatch]:
        """Return a function that integrates the first cases in chunks of ``size``, at most 200
        chunks."""
        subset = inputs[: 200 * size]  # small chunks need not cover all
        return lambda: _concatenate(
            [_integrate(variant, subset[i : i + size]) for i in range(0, len(subset), size)]
        )

    def alone(i: int) -> Callable[[], RowBatch]:
        """Return a function that integrates case ``i`` alone; -1 is the last one."""
        return lambda: _integrate(variant, inputs[i : i + 1] if i >= 0 else inputs[i:])

    return {
        f"1 thread, not {study.threads}": iter([(on_one_thread, all_of)]),
        f"chunks of {', '.join(map(str, CHUNKS))}": iter(
            [(in_chunks(n), lambda rows, n=n: _select(rows, slice(0, 200 * n))) for n in CHUNKS]
        ),
        "cases in reversed order": iter(
            [
                (
                    lambda: _integrate(variant, np.asfortranarray(inputs[::-1])),
                    lambda rows: _select(rows, slice(None, None, -1)),
                )
            ]
        ),
        "one case alone": iter(
            [
                (alone(i), lambda rows, i=i: _select(rows, slice(i, i + 1 if i >= 0 else None)))
                for i in ALONE
            ]
        ),
    }


def _integrate(variant: SolverVariant, inputs: np.ndarray) -> RowBatch:
    """Integrate the cases of ``inputs`` (n, d), SI, with the refinement of a run, on the threads
    that are set; return their outcomes and audit columns (n, o), SI, and statuses (n,)."""
    block = variant.fly(inputs)
    return block.outcomes, block.status


def _select(batch: RowBatch, rows: slice) -> RowBatch:
    """Return the slice ``rows`` of outcomes and of statuses."""
    return batch[0][rows], batch[1][rows]


def _concatenate(parts: list[RowBatch]) -> RowBatch:
    """Concatenate the outcomes and the statuses of several batches of cases."""
    return np.concatenate([part[0] for part in parts]), np.concatenate([part[1] for part in parts])


def _identical(one: RowBatch, other: RowBatch) -> bool:
    """Return True if outcomes and statuses of two batches are equal bit for bit: NaN equals itself,
    0 differs from -0."""
    return all(
        a.shape == b.shape
        and np.ascontiguousarray(a).tobytes() == np.ascontiguousarray(b).tobytes()
        for a, b in zip(one, other, strict=True)
    )
