"""Chi-square tests for dependent inputs, and for samples that are too even to be independent.

The range of each input is divided into parts of about equally many cases, and the cases are counted
in the grid cells that the parts of two inputs form.
"""

from functools import lru_cache

import numpy as np

_MAX_PARTS, _MIN_EXPECTED = 8, 5.0  # parts of an input; mean cases in a cell of a pair
_CHUNK = 16_384  # rows counted at once
_CHANCE = 1e-4  # probability of a false report of any pair
_STRENGTH = 0.02  # smallest chi-square / n of a reported pair: a correlation of 0.14
_TOO_EVEN = -6.0  # sigmas of the sum of chi-squares: probability 1e-9 for random cases


def dependence(x: np.ndarray) -> tuple[list[tuple[int, int]], bool]:
    """Find pairs of dependent inputs, and detect samples that are too even to be independent.

    Parameters
    ----------
    x : ndarray, shape (d, n)
        Values of d inputs in n cases.

    Returns
    -------
    pairs : list of (int, int)
        Indices, below d, of two inputs that depend on each other.
    too_even : bool
        True if the cases fill the grid cells of pairs of inputs more evenly than independent cases
        would, as points of a Sobol sequence or of a grid do.
    """
    pairs, too_even = _dependence(np.ascontiguousarray(x).tobytes(), len(x))
    return list(pairs), too_even


@lru_cache(maxsize=2)  # all outcomes of a run have the same inputs
def _dependence(data: bytes, count: int) -> tuple[tuple[tuple[int, int], ...], bool]:
    """Return the result of `dependence`, cached; ``data`` are the bytes of its array ``x`` (d, n),
    in C order, and ``count`` is the number of inputs d."""
    from scipy.special import chdtrc  # noqa: PLC0415  (0.1 s)

    x = np.frombuffer(data).reshape(count, -1)
    n = x.shape[1]
    n_parts = int(np.clip(np.sqrt(n / _MIN_EXPECTED), 2, _MAX_PARTS))
    parts = [_part_indices(row, n_parts) for row in x]
    counts = np.zeros((n_parts * count, n_parts * count))
    for first in range(0, n, _CHUNK):
        membership = np.concatenate(
            [part[first : first + _CHUNK] == k for part in parts for k in range(n_parts)]
        ).reshape(n_parts * count, -1)
        counts += membership.astype(np.float32) @ membership.astype(np.float32).T
    pairs, excess, degrees = [], 0.0, 0
    for i in range(count):
        for j in range(i + 1, count):
            table = counts[n_parts * i : n_parts * (i + 1), n_parts * j : n_parts * (j + 1)]
            table = table[table.sum(axis=1) > 0][:, table.sum(axis=0) > 0]
            cell_degrees = (table.shape[0] - 1) * (table.shape[1] - 1)
            if not cell_degrees:
                continue
            expected = np.outer(table.sum(axis=1), table.sum(axis=0)) / n
            chi_square = float(np.sum(((table - expected) ** 2 / expected)[expected >= 1.0]))
            tests = count * (count - 1) / 2.0
            if chi_square > _STRENGTH * n and chdtrc(cell_degrees, chi_square) * tests < _CHANCE:
                pairs.append((i, j))
            elif expected.min() >= _MIN_EXPECTED - 1.0:
                excess, degrees = excess + chi_square, degrees + cell_degrees
    is_even = degrees > 0 and (excess - degrees) / np.sqrt(2.0 * degrees) < _TOO_EVEN
    return tuple(pairs), bool(is_even)


def _part_indices(values: np.ndarray, n_parts: int) -> np.ndarray:
    """Return for each of the values (n,) of an input the index of the part that contains it, from
    0; the values are divided into at most ``n_parts`` parts of about equally many cases."""
    edges = np.unique(np.quantile(values, np.arange(n_parts) / n_parts, method="lower"))
    return np.searchsorted(edges, values, side="right") - 1
