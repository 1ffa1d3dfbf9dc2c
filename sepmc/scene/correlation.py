"""Conversion of the correlations of a file to Gaussian copulas, which join the distributions of
groups of dispersed parameters."""

from collections.abc import Sequence
from dataclasses import dataclass

from sepmc.scene.dispersion import Dispersion
from sepmc.scene.messages import Problems, nearest
from sepmc.scene.model import Correlation, Scene
from sepmc.scene.parameters import UnknownPath, find

_NONE = 1e-12  # a pivot below this is zero: the parameter depends on those before it


@dataclass(frozen=True)
class Copula:
    """Gaussian copula of a group of correlated dispersions.

    Attributes
    ----------
    places : tuple of int
        Index, among the dispersions of the campaign, of each parameter of the correlation.
    factor : tuple of tuple of float
        Lower triangular Cholesky factor (n, n) of the correlation matrix of the normal scores of
        these parameters, row by row: times n independent normal scores, it gives correlated ones.
    """

    places: tuple[int, ...]
    factor: tuple[tuple[float, ...], ...]


def resolve(
    correlations: Sequence[Correlation],
    scene: Scene,
    dispersions: Sequence[Dispersion],
    problems: Problems,
) -> tuple[Copula, ...]:
    """Convert the correlations of a file, which name parameters, to copulas of dispersions.

    Parameters
    ----------
    correlations : sequence of Correlation
    scene : Scene
    dispersions : sequence of Dispersion
    problems : Problems
        Receives every problem.

    Returns
    -------
    copulas : tuple of Copula
        One for each correlation, except those whose parameters are all columns of ``run.samples``:
        these are correlated as in the table. Not valid if problems were added.
    """
    index_of = {d.parameter.path: i for i, d in enumerate(dispersions)}
    copulas: list[Copula] = []
    group_of: dict[int, int] = {}
    for number, item in enumerate(correlations):
        where, count = f"correlation.{number}", len(problems)
        places = [_index(key, scene, index_of, where, problems) for key in item.parameters]
        matrix = _matrix(item, where, problems)
        if len(problems) > count:
            continue
        from_samples = [
            key for key, k in zip(item.parameters, places, strict=True) if dispersions[k].column
        ]
        if len(from_samples) == len(places):  # correlated as in the samples
            continue
        for key, key_path in zip(item.parameters, places, strict=True):
            if key in from_samples:
                problems.add(
                    f"{where}.parameters",
                    "is given by run.samples, unlike the others: give all parameters of a "
                    "correlation by columns of run.samples, or none",
                    key,
                )
            if key_path in group_of:
                problems.add(
                    f"{where}.parameters",
                    f"is correlated already, in correlation.{group_of[key_path]}: keep one",
                    key,
                )
            group_of[key_path] = number
        factor = _factor(matrix)
        if factor is None:
            problems.add(
                where,
                "is not positive semidefinite: the matrix must have no negative eigenvalue",
            )
        else:
            copulas.append(Copula(tuple(places), factor))
    return tuple(copulas)


def _index(key: str, scene: Scene, index_of: dict[str, int], where: str, problems: Problems) -> int:
    """Index, by ``index_of`` (path to index), of the dispersion of the parameter ``key``; -1, after
    adding a problem, if there is none."""
    try:
        path = find(scene, key).path
    except UnknownPath as error:
        problems.add(f"{where}.parameters", str(error.args[0]), key)
        return -1
    if path not in index_of:
        problems.add(f"{where}.parameters", f"is not dispersed; {nearest(path, index_of)}", key)
    return index_of.get(path, -1)


def _matrix(item: Correlation, where: str, problems: Problems) -> list[list[float]]:
    """Correlation matrix (n, n) of the n parameters of a ``[[correlation]]``: its matrix, or one
    with its coefficient for all pairs. Adds problems, at the TOML path ``where`` of the table; the
    result is empty if there is no matrix of this shape, and not valid if problems were added. That
    it is positive semidefinite is not checked here."""
    n = len(item.parameters)
    if n < 2:
        problems.add(f"{where}.parameters", "name at least two parameters", list(item.parameters))
    if (item.coefficient is None) == (item.matrix is None):
        problems.add(where, "give either coefficient or matrix")
        return []
    if item.matrix is None:
        return [[1.0 if i == j else item.coefficient or 0.0 for j in range(n)] for i in range(n)]
    rows = [list(row) for row in item.matrix]
    if [len(row) for row in rows] != [n] * n:
        problems.add(f"{where}.matrix", f"must have {n} rows of {n} numbers")
        return []
    for i in range(n):
        for j in range(i + 1):
            if i == j and rows[i][i] != 1.0:
                problems.add(f"{where}.matrix", f"must have 1 at [{i}][{i}]", rows[i][i])
            elif rows[i][j] != rows[j][i] or abs(rows[i][j]) > 1.0:
                problems.add(
                    f"{where}.matrix",
                    f"must be equal at [{i}][{j}] and [{j}][{i}], and between -1 and 1",
                    [rows[i][j], rows[j][i]],
                )
    return rows


def _factor(matrix: list[list[float]]) -> tuple[tuple[float, ...], ...] | None:
    """Rows of the lower triangular matrix L with L L^T = ``matrix`` (Cholesky); None if ``matrix``
    is not positive semidefinite."""
    n = len(matrix)
    lower = [[0.0] * n for _ in range(n)]
    for i in range(n):
        for j in range(i + 1):
            rest = matrix[i][j] - sum(lower[i][k] * lower[j][k] for k in range(j))
            if i == j:
                if rest < -_NONE:
                    return None
                lower[i][i] = max(rest, 0.0) ** 0.5 if rest > _NONE else 0.0
            elif lower[j][j] > 0.0:
                lower[i][j] = rest / lower[j][j]
            elif abs(rest) > 1e-9:
                return None
    return tuple(tuple(row) for row in lower)
