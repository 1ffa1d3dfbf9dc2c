"""Which dispersed parameters vary together: a Gaussian copula of their laws."""

from collections.abc import Sequence
from dataclasses import dataclass

from sepmc.scene.dispersion import Dispersion
from sepmc.scene.messages import Problems, nearest
from sepmc.scene.model import Correlation, Scene
from sepmc.scene.parameters import UnknownPath, find

_NONE = 1e-12  # a pivot below this is zero: a parameter follows from those before it


@dataclass(frozen=True)
class Copula:
    """Places of parameters among those that are dispersed, and the lower triangular factor of the
    correlation of their normal scores, row by row."""

    places: tuple[int, ...]
    factor: tuple[tuple[float, ...], ...]


def resolve(
    correlations: Sequence[Correlation],
    scene: Scene,
    dispersions: Sequence[Dispersion],
    problems: Problems,
) -> tuple[Copula, ...]:
    """Resolve the correlations of a file against its dispersions, noting every problem."""
    place_of = {d.parameter.path: i for i, d in enumerate(dispersions)}
    found: list[Copula] = []
    taken: dict[int, int] = {}
    for number, item in enumerate(correlations):
        where, count = f"correlation.{number}", len(problems)
        places = [_place(key, scene, place_of, where, problems) for key in item.parameters]
        matrix = _matrix(item, where, problems)
        if len(problems) > count:
            continue
        by_plan = [
            key for key, k in zip(item.parameters, places, strict=True) if dispersions[k].column
        ]
        if len(by_plan) == len(places):  # and vary together as they do there
            continue
        for key, place in zip(item.parameters, places, strict=True):
            if key in by_plan:
                problems.add(
                    f"{where}.parameters", "is given by run.samples, unlike the others", key
                )
            if place in taken:
                problems.add(f"{where}.parameters", f"correlated already, in {taken[place]}", key)
            elif dispersions[place].distribution == "constant":
                problems.add(f"{where}.parameters", "is constant, so it varies with nothing", key)
            taken[place] = number
        factor = _factor(matrix)
        if factor is None:
            problems.add(
                where,
                "no parameters can be correlated so: the matrix must have no negative eigenvalue",
            )
        else:
            found.append(Copula(tuple(places), factor))
    return tuple(found)


def _place(key: str, scene: Scene, place_of: dict[str, int], where: str, problems: Problems) -> int:
    try:
        path = find(scene, key).path
    except UnknownPath as error:
        problems.add(f"{where}.parameters", str(error.args[0]), key)
        return -1
    if path not in place_of:
        problems.add(f"{where}.parameters", f"is not dispersed; {nearest(path, place_of)}", key)
    return place_of.get(path, -1)


def _matrix(item: Correlation, where: str, problems: Problems) -> list[list[float]]:
    """The correlation matrix that a table gives."""
    n = len(item.parameters)
    if n < 2:
        problems.add(f"{where}.parameters", "name at least two parameters", list(item.parameters))
    if (item.coefficient is None) == (item.matrix is None):
        problems.add(where, "give one of coefficient and matrix")
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
                    f"must be alike at [{i}][{j}] and [{j}][{i}], between -1 and 1",
                    [rows[i][j], rows[j][i]],
                )
    return rows


def _factor(matrix: list[list[float]]) -> tuple[tuple[float, ...], ...] | None:
    """The lower triangular L with L L^T = ``matrix`` (Cholesky); None if there is none."""
    n = len(matrix)
    lower = [[0.0] * n for _ in range(n)]
    for i in range(n):
        for j in range(i + 1):
            left = matrix[i][j] - sum(lower[i][k] * lower[j][k] for k in range(j))
            if i == j:
                if left < -_NONE:
                    return None
                lower[i][i] = max(left, 0.0) ** 0.5 if left > _NONE else 0.0
            elif lower[j][j] > 0.0:
                lower[i][j] = left / lower[j][j]
            elif abs(left) > 1e-9:
                return None
    return tuple(tuple(row) for row in lower)
