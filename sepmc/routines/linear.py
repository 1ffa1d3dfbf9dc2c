"""Inline dense solvers for the small systems of the constraint force equations. They report; they
never raise.

The matrix stands row by row at w[a], n entries a row; the right-hand side at w[b] is overwritten by
the solution.
"""

import math

from sepmc.jit import keep_apart, long_formula, routine
from sepmc.routines.lanes import LANES

# A pivot that keeps less than this share of its diagonal means dependent rows.
_DEPENDENT = 1e-13
# ... and, once rows are known to be redundant, one that keeps less than this share of the largest.
_RANK = 1e-11
# A pivot that keeps less may be round-off of a dependent row (2e-13 of it was seen), which only
# pivoting tells from a row that is nearly dependent.
_CLEARLY_INDEPENDENT = 1e-9


@long_formula
def _factor_ldlt(w, a, n):
    """L D L^T of a symmetric positive definite matrix given by its lower triangle, in place.
    Returns the smallest pivot relative to its diagonal, or 0 if rows are dependent."""
    keep_apart()
    smallest = 1.0
    for j in range(n):
        row_j = a + j * n
        diagonal = w[row_j + j]
        d = diagonal
        for k in range(j):
            d -= w[row_j + k] * w[row_j + k] * w[a + k * n + k]
        ratio = d / diagonal
        if not ratio > _DEPENDENT:
            return 0.0
        smallest = min(smallest, ratio)
        w[row_j + j] = d
        for i in range(j + 1, n):
            row_i = a + i * n
            s = w[row_i + j]
            for k in range(j):
                s -= w[row_i + k] * w[row_j + k] * w[a + k * n + k]
            w[row_i + j] = s / d
    return smallest


@long_formula
def _solve_factored(w, a, b, n):
    """Solve a system whose matrix is given as L D L^T."""
    keep_apart()
    for i in range(n):
        for k in range(i):
            w[b + i] -= w[a + i * n + k] * w[b + k]
    for i in range(n):
        w[b + i] /= w[a + i * n + i]
    for i in range(n - 1, -1, -1):
        for k in range(i + 1, n):
            w[b + i] -= w[a + k * n + i] * w[b + k]


@routine
def solve_ldlt(w, a, b, n):
    """Solve a symmetric positive definite system given by its lower triangle, by L D L^T.

    Returns the smallest pivot relative to its diagonal, or 0 if rows are dependent (the solution is
    then meaningless).
    """
    keep_apart()
    smallest = _factor_ldlt(w, a, n)
    if smallest > 0.0:
        _solve_factored(w, a, b, n)
    return smallest


@routine
def _factor_pivoted(w, a, n, picked, left):
    """A = L L^T (n x rank, rows in the order of A) of a positive semidefinite A by pivoted Cholesky
    on the scaled matrix.

    A is given by its lower triangle and left as it is; L goes to w[a + n n], by rows of n.
    ``picked`` and ``left`` are places of n numbers of scratch. Returns the rank and the smallest
    pivot taken, as shares of the diagonal.
    """
    keep_apart()
    factor = a + n * n
    for i in range(n):
        w[picked + i] = 0.0
        w[left + i] = 1.0
        for k in range(n):
            w[factor + i * n + k] = 0.0
    smallest = 1.0
    for rank in range(n):
        p = -1
        for i in range(n):
            if w[picked + i] == 0.0 and (p < 0 or w[left + i] > w[left + p]):
                p = i
        if not w[left + p] > _RANK:
            return rank, smallest
        smallest = min(smallest, w[left + p])
        w[picked + p] = 1.0
        scale_p, root = math.sqrt(w[a + p * n + p]), math.sqrt(w[left + p])
        for i in range(n):
            if w[picked + i] != 0.0 and i != p:
                continue
            entry = w[a + max(i, p) * n + min(i, p)]
            for k in range(rank):
                entry -= w[factor + i * n + k] * w[factor + p * n + k]
            w[factor + i * n + rank] = entry / (scale_p * root)
            scaled = w[factor + i * n + rank] / math.sqrt(w[a + i * n + i])
            w[left + i] -= scaled * scaled
    return n, smallest


@routine
def _apply_pseudo_inverse(w, factor, gram, b, out, t, n, rank):
    """out += A^+ b with A = L L^T: L G^-1 G^-1 L^T b, given G = L^T L as L D L^T. ``t``: scratch of
    n numbers."""
    keep_apart()
    for r in range(rank):
        w[t + r] = 0.0
        for i in range(n):
            w[t + r] += w[factor + i * n + r] * w[b + i]
    for _ in range(2):
        _solve_factored(w, gram, t, rank)
    for i in range(n):
        for r in range(rank):
            w[out + i] += w[factor + i * n + r] * w[t + r]


@routine
def solve_semidefinite(w, a, b, n):
    """Solution of least sum of squares of a consistent positive semidefinite system, given by its
    lower triangle.

    Needs room for 3 n^2 numbers at w[a] and 5 n at w[b]. Returns the rank and the smallest relative
    pivot; rank 0 if a diagonal is not positive.
    """
    keep_apart()
    for i in range(n):
        if not w[a + i * n + i] > 0.0:
            return 0, 0.0
    factor, gram = a + n * n, a + 2 * n * n
    out, residual, picked, t = b + n, b + 2 * n, b + 3 * n, b + 4 * n
    rank, smallest = _factor_pivoted(w, a, n, picked, t)
    for r in range(rank):
        for s in range(r + 1):
            w[gram + r * rank + s] = 0.0
            for i in range(n):
                w[gram + r * rank + s] += w[factor + i * n + r] * w[factor + i * n + s]
    _factor_ldlt(w, gram, rank)
    for i in range(n):
        w[out + i] = 0.0
        w[residual + i] = w[b + i]
    for _ in range(3):  # the first solves, the others refine
        _apply_pseudo_inverse(w, factor, gram, residual, out, t, n, rank)
        for i in range(n):
            w[residual + i] = w[b + i]
            for k in range(n):
                w[residual + i] -= w[a + max(i, k) * n + min(i, k)] * w[out + k]
    for i in range(n):
        w[b + i] = w[out + i]
    return rank, smallest


@long_formula
def _gather(w, place, n, a, b):
    """Of one lane, at ``place``: the lower triangle of a matrix by rows, into w[a], and behind it
    the right-hand side, into w[b]."""
    keep_apart()
    k = place
    for i in range(n):
        for j in range(i + 1):
            w[a + i * n + j] = w[k]
            k += LANES
    for i in range(n):
        w[b + i] = w[k]
        k += LANES


@routine
def share(w, place, n, scratch, out):
    """For one lane, the solution at ``out`` of a system some of whose rows may follow from others,
    from the lower triangle of its matrix by rows and its right-hand side at ``place``: the only
    one, or that of least sum of squares; not numbers if there is none. ``scratch`` is room for 3
    n^2 + 5 n numbers. Returns the rank and the smallest relative pivot."""
    keep_apart()
    b = scratch + 3 * n * n
    _gather(w, place, n, scratch, b)
    rank, smallest = n, solve_ldlt(w, scratch, b, n)
    if not smallest > _CLEARLY_INDEPENDENT:
        _gather(w, place, n, scratch, b)
        rank, smallest = solve_semidefinite(w, scratch, b, n)
    for i in range(n):
        w[out + i * LANES] = w[b + i] if rank > 0 else math.nan
    return rank, smallest


@routine
def solve_lu(w, a, b, n):
    """Solve a general system by LU with partial pivoting; rows are first scaled by their largest
    entry.

    Returns the smallest pivot of the scaled system, or 0 if it is singular (the solution is then
    meaningless).
    """
    keep_apart()
    for i in range(n):
        largest = 0.0
        for j in range(n):
            largest = max(largest, abs(w[a + i * n + j]))
        if not largest > 0.0:
            return 0.0
        w[b + i] /= largest
        for j in range(n):
            w[a + i * n + j] /= largest
    smallest = 1.0
    for k in range(n):
        p = k
        for i in range(k + 1, n):
            if abs(w[a + i * n + k]) > abs(w[a + p * n + k]):
                p = i
        pivot = abs(w[a + p * n + k])
        if not pivot > _DEPENDENT:
            return 0.0
        smallest = min(smallest, pivot)
        if p != k:
            for j in range(n):
                w[a + k * n + j], w[a + p * n + j] = w[a + p * n + j], w[a + k * n + j]
            w[b + k], w[b + p] = w[b + p], w[b + k]
        for i in range(k + 1, n):
            if w[a + i * n + k] != 0.0:
                f = w[a + i * n + k] / w[a + k * n + k]
                for j in range(k + 1, n):
                    w[a + i * n + j] -= f * w[a + k * n + j]
                w[b + i] -= f * w[b + k]
    for i in range(n - 1, -1, -1):
        for j in range(i + 1, n):
            w[b + i] -= w[a + i * n + j] * w[b + j]
        w[b + i] /= w[a + i * n + i]
    return smallest


@routine
def eliminate(w, place, n, scratch, out):
    """`solve_lu` for one lane: from its matrix by rows and right-hand side at ``place`` the
    solution at ``out``; not numbers if there is none. ``scratch`` is room for n^2 + n numbers.
    Returns the smallest pivot of the scaled system, 0 if it is singular."""
    keep_apart()
    for i in range(n * n + n):
        w[scratch + i] = w[place + i * LANES]
    pivot = solve_lu(w, scratch, scratch + n * n, n)
    for i in range(n):
        w[out + i * LANES] = w[scratch + n * n + i] if pivot > 0.0 else math.nan
    return pivot
