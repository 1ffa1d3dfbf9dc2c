"""Which inputs vary together, and whether cases are spread more evenly than chance would spread
them, from the cases alone: counts in the cells of every pair of inputs."""

import numpy as np

_LEVELS, _EACH = 8, 5.0  # most parts of an input; cases in a cell of a pair, at least, on average
_CHUNK = 16_384  # rows counted at once
_CHANCE = 1e-4  # that any pair of independent inputs is named
_STRENGTH = 0.02  # chi-square over the cases from which a pair is named: a correlation of 0.14
_TOO_EVEN = -6.0  # sigmas of the sum of chi-squares: 1e-9 of random cases


def dependence(x: np.ndarray) -> tuple[list[tuple[int, int]], bool]:
    """Pairs of inputs (d, n) that vary together, and whether all are spread too evenly for
    independent cases, as points of a Sobol sequence or of a grid are."""
    from scipy.special import chdtrc  # noqa: PLC0415  (0.1 s)

    count, n = len(x), x.shape[1]
    levels = int(np.clip(np.sqrt(n / _EACH), 2, _LEVELS))
    parts = [_parts(row, levels) for row in x]
    counts = np.zeros((levels * count, levels * count))
    for first in range(0, n, _CHUNK):
        ones = np.concatenate(
            [part[first : first + _CHUNK] == k for part in parts for k in range(levels)]
        ).reshape(levels * count, -1)
        counts += ones.astype(np.float32) @ ones.astype(np.float32).T
    pairs, over, freedoms = [], 0.0, 0
    for i in range(count):
        for j in range(i + 1, count):
            of = counts[levels * i : levels * (i + 1), levels * j : levels * (j + 1)]
            of = of[of.sum(axis=1) > 0][:, of.sum(axis=0) > 0]
            free = (of.shape[0] - 1) * (of.shape[1] - 1)
            if not free:
                continue
            expected = np.outer(of.sum(axis=1), of.sum(axis=0)) / n
            square = float(np.sum(((of - expected) ** 2 / expected)[expected >= 1.0]))
            tests = count * (count - 1) / 2.0
            if square > _STRENGTH * n and chdtrc(free, square) * tests < _CHANCE:
                pairs.append((i, j))
            elif expected.min() >= _EACH - 1.0:
                over, freedoms = over + square, freedoms + free
    return pairs, freedoms > 0 and (over - freedoms) / np.sqrt(2.0 * freedoms) < _TOO_EVEN


def _parts(values: np.ndarray, most: int) -> np.ndarray:
    """In which of ``most`` parts of about equally many cases each value lies (n,)."""
    edges = np.unique(np.quantile(values, np.arange(most) / most, method="lower"))
    return np.searchsorted(edges, values, side="right") - 1
