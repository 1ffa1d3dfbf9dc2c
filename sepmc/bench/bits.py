"""The same bits, however a campaign is cut up: threads, chunks, order of the cases, one case
alone."""

from collections.abc import Callable, Iterator

import numpy as np

from sepmc.bench.study import SolverVariant, Study
from sepmc.engine.dispatch import use_threads

MOST = 2000  # cases flown each time
CHUNKS = (1, 7, 64, 1000)
ALONE = (0, 3, -1)


def same_bits(study: Study) -> dict[str, bool]:
    """Whether outcomes and statuses are the same to the last bit, by what is varied."""
    draws = study.draws[: min(MOST, study.own_cases)]
    way = SolverVariant(study.flight, study.campaign, len(draws))
    use_threads(study.threads)
    whole = _flown(way, draws)
    return {
        what: all(_same(flown(), wanted(whole)) for flown, wanted in trials)
        for what, trials in _trials(study, way, draws).items()
    }


RowBatch = tuple[np.ndarray, np.ndarray]
Trial = tuple[Callable[[], RowBatch], Callable[[RowBatch], RowBatch]]


def _trials(study: Study, way: SolverVariant, draws: np.ndarray) -> dict[str, Iterator[Trial]]:
    def all_of(rows: RowBatch) -> RowBatch:
        return rows

    def on_one() -> RowBatch:
        use_threads(1)
        try:
            return _flown(way, draws)
        finally:
            use_threads(study.threads)

    def in_chunks(size: int) -> Callable[[], RowBatch]:
        most = draws[: 200 * size]  # small chunks need not cover all
        return lambda: _joined([_flown(way, most[i : i + size]) for i in range(0, len(most), size)])

    def alone(i: int) -> Callable[[], RowBatch]:
        return lambda: _flown(way, draws[i : i + 1] if i >= 0 else draws[i:])

    return {
        f"1 thread, not {study.threads}": iter([(on_one, all_of)]),
        f"chunks of {', '.join(map(str, CHUNKS))}": iter(
            [(in_chunks(n), lambda rows, n=n: _part(rows, slice(0, 200 * n))) for n in CHUNKS]
        ),
        "cases in reversed order": iter(
            [
                (
                    lambda: _flown(way, np.asfortranarray(draws[::-1])),
                    lambda rows: _part(rows, slice(None, None, -1)),
                )
            ]
        ),
        "one case alone": iter(
            [
                (alone(i), lambda rows, i=i: _part(rows, slice(i, i + 1 if i >= 0 else None)))
                for i in ALONE
            ]
        ),
    }


def _flown(way: SolverVariant, draws: np.ndarray) -> RowBatch:
    block = way.fly(draws)
    return block.outcomes, block.status


def _part(rows: RowBatch, which: slice) -> RowBatch:
    return rows[0][which], rows[1][which]


def _joined(parts: list[RowBatch]) -> RowBatch:
    return np.concatenate([part[0] for part in parts]), np.concatenate([part[1] for part in parts])


def _same(one: RowBatch, other: RowBatch) -> bool:
    """Bit for bit: a NaN is itself, 0 is not -0."""
    return all(
        a.shape == b.shape
        and np.ascontiguousarray(a).tobytes() == np.ascontiguousarray(b).tobytes()
        for a, b in zip(one, other, strict=True)
    )
