"""Which inputs, and which pairs of them, set the cases that violate something apart from the
rest.

An input is cut into parts of equally many cases, a pair into cells. What the part or cell of a case
tells of whether the case violates is their mutual information; against what chance would tell, n
cases give a chi-square of 2 n times it (the G-test: Sokal and Rohlf, Biometry, 17). A pair is named
where each of its inputs tells something that the other does not, and where the odds of a violation
are larger by half in a cell than in what else lies in the same part of either.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from itertools import combinations
from textwrap import fill

import numpy as np
import pandas as pd

from sepmc.analysis.requirements import violating
from sepmc.analysis.statistics import WIDTH, column, ok_rows
from sepmc.analysis.variance_indices import PATTERNS
from sepmc.scene.model import Requirement

_PARTS = (2, 8)  # fewest and most parts of an input
_EACH = 1.0  # violations for each part of an input, or cell of a pair, on average: with fewer the
# G-test finds too little; by 12 of them and more chance comes out right within a factor of three
_BOTH = 1.5  # times the odds in the rest of either part, at least, are those in a cell of a pair
_PATTERNED = "what sets them apart is not looked for: cases of sampler {design} are not independent"
_CHANCE = 1e-3  # that anything at all is named of what has no cause


@dataclass(frozen=True)
class Attribution:
    """An input, or a pair, and where its violations are.

    ``inputs`` : one or two names
    ``information`` : share of what there is to know of violations, 0 to 1
    ``chance`` : probability that so much is told by inputs that have nothing to do with it
    ``region`` : of each input the least and greatest value of the part that by itself tells most
    ``inside``, ``violations`` : violations in that part and all; ``cases`` : cases in that part
    """

    inputs: tuple[str, ...]
    information: float
    chance: float
    region: tuple[tuple[float, float], ...]
    inside: int
    violations: int
    cases: int


def attribute_failures(
    cases: Mapping[str, np.ndarray], inputs: Sequence[str], violates: np.ndarray
) -> list[Attribution]:
    """Inputs and pairs that set violating cases apart, what tells most first.

    Parameters
    ----------
    cases : mapping of name to column, shape (n_cases,)
    inputs : names of the dispersed inputs
    violates : ndarray, shape (n_cases,), bool
    """
    n, k = len(violates), int(np.count_nonzero(violates))
    if k in (0, n):
        return []
    each = min(k, n - k) / _EACH
    parts, coarse = _cut(cases, inputs, each), _cut(cases, inputs, np.sqrt(each))
    told = {name: _cell_information(part.of, part.number, violates) for name, part in parts.items()}
    pairs = list(combinations(coarse, 2))
    tests, known = len(parts) + len(pairs), _cell_information(violates.astype(int), 2, violates)
    found = []

    def name_if_sure(within: dict[str, _Parts], bits: float, more: float, freedoms: int) -> None:
        chance = min(1.0, tests * _chance(2.0 * n * more, freedoms))
        if chance < _CHANCE:
            cause = _attribution(within, bits / known, chance, violates)
            found.extend([cause] if cause else [])

    for name, part in parts.items():
        name_if_sure({name: part}, told[name], told[name], part.number - 1)
    coarsely = {
        name: _cell_information(part.of, part.number, violates) for name, part in coarse.items()
    }
    for one, two in pairs:
        a, b = coarse[one], coarse[two]
        both = _cell_information(a.of * b.number + b.of, a.number * b.number, violates)
        # what the second tells within each part of the first, and the other way round
        more = min(
            (both - coarsely[one], a.number * (b.number - 1)),
            (both - coarsely[two], b.number * (a.number - 1)),
            key=lambda each: -_chance(2.0 * n * each[0], each[1]),
        )
        name_if_sure({one: a, two: b}, both, *more)
    return sorted(found, key=lambda cause: -cause.information)


def attribute_violations(
    requirement: Requirement,
    cases: Mapping[str, np.ndarray],
    inputs: Sequence[str],
    others: Sequence[Requirement] = (),
    design: str = "random",
) -> list[Attribution]:
    """Causes of the violations of a requirement among the cases of which it is known; ``others`` as
    for `violating`. None of a patterned ``design``, whose cases the G-test does not hold for: of 40
    Sobol campaigns each named a pair of inputs without effect, 3 a single one."""
    if design in PATTERNS:
        return []
    violates, known = violating(requirement, cases, others)
    return attribute_failures(
        {name: column(cases, name)[known] for name in inputs}, inputs, violates[known]
    )


def attribute_missing(
    metric: str, cases: Mapping[str, np.ndarray], inputs: Sequence[str], design: str = "random"
) -> tuple[int, list[Attribution]]:
    """In how many cases that came to their end an outcome is missing, and what sets them apart."""
    ok = ok_rows(cases)
    lacks = np.isnan(column(cases, metric)[ok])
    if design in PATTERNS or not lacks.any():
        return int(lacks.sum()), []
    return int(lacks.sum()), attribute_failures(
        {n: column(cases, n)[ok] for n in inputs}, inputs, lacks
    )


def _cut(
    cases: Mapping[str, np.ndarray], inputs: Sequence[str], most: float
) -> dict[str, "_Parts"]:
    """The inputs that vary, each in so many parts at most."""
    count = int(np.clip(most, *_PARTS))
    every = {name: _Parts(column(cases, name), count) for name in inputs}
    return {name: part for name, part in every.items() if part.number > 1}


class _Parts:
    """An input cut into parts of equally many cases, at most so many: in which each case lies."""

    def __init__(self, values: np.ndarray, most: int):
        edges = np.unique(values)
        if len(edges) > most:
            edges = np.unique(np.quantile(values, np.arange(most) / most, method="lower"))
        self.values, self.number = values, len(edges)
        self.of = np.searchsorted(edges, values, side="right") - 1


def _cell_information(cells: np.ndarray, number: int, violates: np.ndarray) -> float:
    """Mutual information of the cell of a case, and whether it violates, natural units."""
    counts = [np.bincount(cells[which], minlength=number) for which in (violates, ~violates)]
    return float(_mutual_information(np.array(counts)))


def _mutual_information(counts: np.ndarray) -> np.ndarray:
    """Mutual information of the two first axes of counts (2, cells, ...), natural units."""
    shares = counts / counts.sum(axis=(0, 1))
    expected = shares.sum(axis=0) * shares.sum(axis=1, keepdims=True)
    there = np.where(shares > 0.0, shares, 1.0)
    over = np.where(shares > 0.0, expected, 1.0)
    return np.asarray(np.sum(shares * np.log(there / over), axis=(0, 1)))


def _chance(statistic: float, freedoms: int) -> float:
    """Probability that chi-square is larger."""
    from scipy.special import chdtrc  # noqa: PLC0415  (0.1 s)

    return float(chdtrc(freedoms, max(statistic, 0.0)))


def _attribution(
    within: Mapping[str, _Parts], share: float, chance: float, violates: np.ndarray
) -> Attribution | None:
    """What is told of an input or pair, and the part or cell that tells most by itself, of those
    with a larger share of violations than all; None if there is no cell that it takes both inputs
    of a pair for."""
    shape = tuple(part.number for part in within.values())
    cells = np.ravel_multi_index([part.of for part in within.values()], shape)
    size, k, n = int(np.prod(shape)), int(np.count_nonzero(violates)), len(violates)
    inside = np.bincount(cells[violates], minlength=size).reshape(shape)
    cases = np.bincount(cells, minlength=size).reshape(shape)
    alone = _mutual_information(
        np.array([[inside, k - inside], [cases - inside, n - k - (cases - inside)]])
    )
    alone[inside <= cases * (k / n)] = -1.0
    for axis in range(len(shape)) if len(shape) > 1 else ():  # along each input of a pair
        rest, of_rest = (x.sum(axis=axis, keepdims=True) - x for x in (cases, inside))
        alone[_odds(inside, cases) < _BOTH * _odds(of_rest, rest)] = -1.0
    at = np.unravel_index(int(np.argmax(alone)), shape)
    if alone[at] < 0.0:
        return None
    here = cells == np.ravel_multi_index(at, shape)
    region = tuple(
        (float(part.values[here].min()), float(part.values[here].max())) for part in within.values()
    )
    told = float(np.clip(share, 0.0, 1.0))
    return Attribution(tuple(within), told, chance, region, int(inside[at]), k, int(cases[at]))


def _odds(inside: np.ndarray, cases: np.ndarray) -> np.ndarray:
    """Odds of a violation, with half a case on either side (Haldane, Ann. Hum. Genet. 20, 1956)."""
    return np.asarray((inside + 0.5) / (cases - inside + 0.5))


def attribution_table(found: Mapping[str, Sequence[Attribution]]) -> pd.DataFrame:
    """Causes of what is violated, by its name, a row each; a pair has a second input."""
    rows = [
        {
            "violated": name,
            "input": one.inputs[0],
            "low": one.region[0][0],
            "high": one.region[0][1],
            "second_input": one.inputs[1] if len(one.inputs) > 1 else "",
            "second_low": one.region[1][0] if len(one.inputs) > 1 else np.nan,
            "second_high": one.region[1][1] if len(one.inputs) > 1 else np.nan,
            "information": one.information,
            "chance": one.chance,
            "inside": one.inside,
            "cases": one.cases,
            "violations": one.violations,
        }
        for name, causes_of in found.items()
        for one in causes_of
    ]
    columns = pd.Index(
        ["violated", "input", "low", "high", "second_input", "second_low", "second_high",
         "information", "chance", "inside", "cases", "violations"]
    )  # fmt: skip
    return pd.DataFrame(rows, columns=columns)


def render_attribution(
    what: str,
    found: Sequence[Attribution],
    keys: Mapping[str, str],
    most: int = 5,
    width: int = WIDTH,
    design: str = "random",
) -> str:
    """Causes as an engineer reads them in a terminal; inputs by their ``keys``."""
    if design in PATTERNS:
        return f"{what}: {_PATTERNED.format(design=design)}"
    if not found:
        return f"{what}: no input or pair of inputs is shown to set these cases apart from the rest"
    lines = [f"{what}: what sets these cases apart from the rest"]
    for one in found[:most]:
        where = " and ".join(
            f"{keys.get(name, name)} "
            + (f"= {low:.5g}" if low == high else f"{low:.5g} to {high:.5g}")
            for name, (low, high) in zip(one.inputs, one.region, strict=True)
        )
        told = " and ".join(keys.get(name, name) for name in one.inputs)
        together = " together tell" if len(one.inputs) > 1 else " tells"
        lines.append(
            fill(
                f"{told}{together} {100.0 * one.information:.0f} % of it, most where {where}: "
                f"{one.inside} of the {one.violations} are among these {one.cases} cases",
                width,
                initial_indent="  ",
                subsequent_indent="      ",
            )
        )
    return "\n".join(lines)
