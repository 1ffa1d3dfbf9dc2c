"""Inline dense solvers for the small systems of the constraint force equations. They report; they never raise.

The matrix stands row by row at w[a], n entries a row; the right-hand side at w[b] is overwritten by the solution.
"""

from sepmc.kernels._jit import stage

# A pivot that keeps less than this share of its diagonal means dependent rows.
_DEPENDENT = 1e-13


@stage
def solve_ldlt(w, a, b, n):
    """Solve a symmetric positive definite system given by its lower triangle, by L D L^T.

    Returns the smallest pivot relative to its diagonal, or 0 if rows are dependent (the solution is then meaningless).
    """
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
    for i in range(n):
        for k in range(i):
            w[b + i] -= w[a + i * n + k] * w[b + k]
    for i in range(n):
        w[b + i] /= w[a + i * n + i]
    for i in range(n - 1, -1, -1):
        for k in range(i + 1, n):
            w[b + i] -= w[a + k * n + i] * w[b + k]
    return smallest


@stage
def solve_lu(w, a, b, n):
    """Solve a general system by LU with partial pivoting; rows are first scaled by their largest entry.

    Returns the smallest pivot of the scaled system, or 0 if it is singular (the solution is then meaningless).
    """
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
