"""Dense solvers for the small linear systems of the constraint force equations. A failure is
reported by the result; nothing is raised.

``w`` is the workspace; other arguments are positions in it. A matrix A is stored by rows at w[a], n
entries a row; the right-hand side at w[b] is replaced by the solution. Checked in
`tests/engine/test_interpreted.py` and `tests/kernel/test_redundant_rows.py`.
"""

import math

from sepmc.jit import long_formula, noinline, routine
from sepmc.routines.lanes import LANES

# A smaller pivot relative to its diagonal means dependent rows.
_DEPENDENT = 1e-13
# The same in a system with redundant rows, relative to the largest.
_RANK = 1e-11
# A pivot that keeps less may be round-off of a dependent row (2e-13 of it was seen), which only
# pivoting tells from a row that is nearly dependent.
_CLEARLY_INDEPENDENT = 1e-9


@long_formula
def _factor_ldlt(w, a, n):
    """Factor a symmetric positive definite matrix (n x n, at w[a]), given by its lower triangle, as
    L D L^T. The triangle is replaced: L below the diagonal, D on it.

    Returns the smallest ratio of a pivot (an element of D) to the diagonal element of the matrix,
    or 0 if rows are dependent; the factors are then not complete.
    """
    noinline()
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
    """Solve a system of size n from its factors L D L^T at w[a] (`_factor_ldlt`); the right-hand
    side at w[b] is replaced by the solution."""
    noinline()
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
    """Solve a symmetric positive definite system, given by its lower triangle, by L D L^T.

    Parameters
    ----------
    w : array
        Workspace.
    a, b : int
        Positions of the matrix (by rows, replaced by its factors) and of the right-hand side
        (replaced by the solution).
    n : int
        Size of the system.

    Returns
    -------
    float
        Smallest ratio of a pivot to its diagonal element; 0 if rows are dependent: the right-hand
        side is then not replaced.
    """
    noinline()
    smallest = _factor_ldlt(w, a, n)
    if smallest > 0.0:
        _solve_factored(w, a, b, n)
    return smallest


@routine
def _factor_pivoted(w, a, n, used, rest):
    """Factor a positive semidefinite matrix A (n x n, at w[a]) as L L^T by pivoted Cholesky of the
    matrix scaled to a unit diagonal; L is n x rank, its rows in the order of A.

    A is given by its lower triangle and not changed; L is stored at w[a + n n], n entries a row.
    ``used`` and ``rest`` are positions of n scratch numbers each. Returns the rank, and the
    smallest ratio of a pivot to its diagonal element, over the ``rank`` pivots used.
    """
    noinline()
    factor = a + n * n
    for i in range(n):
        w[used + i] = 0.0
        w[rest + i] = 1.0
        for k in range(n):
            w[factor + i * n + k] = 0.0
    smallest = 1.0
    for rank in range(n):
        p = -1
        for i in range(n):
            if w[used + i] == 0.0 and (p < 0 or w[rest + i] > w[rest + p]):
                p = i
        if not w[rest + p] > _RANK:
            return rank, smallest
        smallest = min(smallest, w[rest + p])
        w[used + p] = 1.0
        scale_p, root = math.sqrt(w[a + p * n + p]), math.sqrt(w[rest + p])
        for i in range(n):
            if w[used + i] != 0.0 and i != p:
                continue
            entry = w[a + max(i, p) * n + min(i, p)]
            for k in range(rank):
                entry -= w[factor + i * n + k] * w[factor + p * n + k]
            w[factor + i * n + rank] = entry / (scale_p * root)
            scaled = w[factor + i * n + rank] / math.sqrt(w[a + i * n + i])
            w[rest + i] -= scaled * scaled
    return n, smallest


@routine
def _apply_pseudo_inverse(w, factor, gram, b, out, t, n, rank):
    """Add A^+ b to the vector at w[out], where A^+ is the pseudo-inverse of A = L L^T, which has a
    known ``rank``: A^+ b = L G^-1 G^-1 L^T b with G = L^T L.

    ``factor`` is the position of L (n entries a row), ``gram`` that of the factors L D L^T of G
    (`_factor_ldlt`), ``b`` that of b, ``t`` that of n scratch numbers.
    """
    noinline()
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
    """Find the solution of minimum norm of a consistent positive semidefinite system, given by its
    lower triangle.

    Parameters
    ----------
    w : array
        Workspace.
    a : int
        Position of the matrix, by rows, which is kept; the 2 n^2 numbers after it are scratch.
    b : int
        Position of the right-hand side, replaced by the solution; the 4 n numbers after it are
        scratch.
    n : int
        Size of the system.

    Returns
    -------
    rank : int
        Rank of the matrix; 0 if a diagonal element is not positive: nothing is then solved.
    smallest : float
        Smallest ratio of a pivot to its diagonal element, over the ``rank`` pivots used; 0 if the
        rank is 0.
    """
    noinline()
    for i in range(n):
        if not w[a + i * n + i] > 0.0:
            return 0, 0.0
    factor, gram = a + n * n, a + 2 * n * n
    out, residual, used, t = b + n, b + 2 * n, b + 3 * n, b + 4 * n
    rank, smallest = _factor_pivoted(w, a, n, used, t)
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
def _gather(w, source, n, a, b):
    """Copy a system of size n of one lane: the lower triangle of its matrix, which is stored by
    rows from w[source] on, LANES apart, to the matrix at w[a], and the right-hand side that follows
    it to w[b]. Both are then without gaps: element (i, j) is at w[a + i * n + j], and those above
    the diagonal are not set."""
    noinline()
    k = source
    for i in range(n):
        for j in range(i + 1):
            w[a + i * n + j] = w[k]
            k += LANES
    for i in range(n):
        w[b + i] = w[k]
        k += LANES


@routine
def solve_min_norm(w, source, n, scratch, out):
    """Solve, for one lane, a consistent positive semidefinite system whose rows may be dependent.
    If the solution is not unique, it is the one of minimum norm.

    Parameters
    ----------
    w : array
        Workspace.
    source : int
        Position of the lower triangle by rows, then of the right-hand side, LANES apart.
    n : int
        Size of the system.
    scratch : int
        Position of 3 n^2 + 5 n scratch numbers.
    out : int
        Position of the solution, LANES apart. It is NaN if a diagonal element is not positive.

    Returns
    -------
    rank : int
        Rank of the matrix; 0 if a diagonal element is not positive.
    smallest : float
        Smallest ratio of a pivot to its diagonal element, over the ``rank`` pivots used; 0 if the
        rank is 0.
    """
    noinline()
    b = scratch + 3 * n * n
    _gather(w, source, n, scratch, b)
    rank, smallest = n, solve_ldlt(w, scratch, b, n)
    if not smallest > _CLEARLY_INDEPENDENT:
        _gather(w, source, n, scratch, b)
        rank, smallest = solve_semidefinite(w, scratch, b, n)
    for i in range(n):
        w[out + i * LANES] = w[b + i] if rank > 0 else math.nan
    return rank, smallest


@routine
def solve_lu(w, a, b, n):
    """Solve a general system by LU with partial pivoting, rows scaled by their largest element.

    Parameters
    ----------
    w : array
        Workspace.
    a, b : int
        Positions of the matrix (by rows, overwritten) and of the right-hand side (replaced by the
        solution).
    n : int
        Size of the system.

    Returns
    -------
    float
        Size of the smallest pivot of the scaled system; 0 if it is singular: the right-hand side is
        then no solution.
    """
    noinline()
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
def eliminate(w, source, n, scratch, out):
    """Solve, for one lane, a general system by `solve_lu`.

    Parameters
    ----------
    w : array
        Workspace.
    source : int
        Position of the matrix by rows, then of the right-hand side, LANES apart.
    n : int
        Size of the system: n rows of n entries.
    scratch : int
        Position of n^2 + n scratch numbers.
    out : int
        Position of the solution, LANES apart, which is written; NaN if there is none.

    Returns
    -------
    float
        Size of the smallest pivot of the scaled system; 0 if it is singular.
    """
    noinline()
    for i in range(n * n + n):
        w[scratch + i] = w[source + i * LANES]
    pivot = solve_lu(w, scratch, scratch + n * n, n)
    for i in range(n):
        w[out + i * LANES] = w[scratch + n * n + i] if pivot > 0.0 else math.nan
    return pivot
