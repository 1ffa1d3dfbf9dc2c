"""Failure attribution: inputs, and pairs of inputs, that distinguish violating cases from the rest.

The range of an input is divided into parts with about equally many of the n cases; the parts of two
inputs form cells. The measure is the mutual information between the part (or cell) of a case and
whether the case violates; for an input without effect, 2 n times it follows a chi-square
distribution (G-test: Sokal and Rohlf, Biometry, 17). A pair is attributed only if each of its
inputs adds information to the other, and if the odds of a violation in its cell are at least 1.5
times those in the rest of either part.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from itertools import combinations
from textwrap import fill

import numpy as np
import pandas as pd

from sepmc.analysis.requirements import violation_masks
from sepmc.analysis.statistics import column, ok_rows
from sepmc.analysis.statistics_text import WIDTH
from sepmc.analysis.variance_indices import PATTERNS
from sepmc.scene.model import Requirement

_PART_LIMITS = (2, 8)  # parts of an input, at least and at most
# mean violations in a part of an input, or cell of a pair: with fewer the G-test has too little
# power; from 12 on, `chance` is right within a factor of three
_MIN_PER_CELL = 1.0
# smallest ratio of the odds in a pair's cell to those in the rest of either part
_MIN_ODDS_RATIO = 1.5
_PATTERNED = "no failure attribution: cases of sampler {design} are not independent"
_CHANCE = 1e-3  # probability of any false attribution


@dataclass(frozen=True)
class Attribution:
    """An input, or a pair of inputs, that distinguishes violating cases from the rest, and the
    region of its values that does so most.

    Parameters
    ----------
    inputs : tuple of one or two names
    information : float
        Fraction of the information on which cases violate that the inputs explain, 0 to 1.
    chance : float
        Probability that any of the tested inputs and pairs explains as much without an effect.
    region : tuple of (min, max), one per input
        Smallest and largest value of the input in the part or cell with the largest information.
    inside, violations, cases : int
        Violations in the region, all violations, and cases in the region.
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
    """Find inputs, and pairs of inputs, that distinguish violating cases from the rest.

    Parameters
    ----------
    cases : mapping of name to column, shape (n_cases,)
    inputs : sequence of str
        Columns of the dispersed inputs.
    violates : ndarray, shape (n_cases,), bool
        True for cases that violate.

    Returns
    -------
    list of Attribution
        Those with a ``chance`` below 0.001 (`Attribution` explains the fields) in which a part or
        cell stands out (`_attribution`), the largest ``information`` first; empty if no case or
        every case violates.
    """
    n, k = len(violates), int(np.count_nonzero(violates))
    if k in (0, n):
        return []
    per_cell = min(k, n - k) / _MIN_PER_CELL
    fine, coarse = (_partition(cases, inputs, count) for count in (per_cell, np.sqrt(per_cell)))
    pairs = list(combinations(coarse, 2))
    tests = len(fine) + len(pairs)
    total = _information(violates.astype(int), 2, violates)
    attributions = []

    def add_if_significant(
        parts: dict[str, _Partition], information: float, added: float, degrees: int
    ) -> None:
        """Append an attribution to the inputs ``parts`` if it is significant, the number of tests
        considered, and a part or cell stands out (`_attribution`).

        ``information`` (nats) is that of the inputs together; ``added`` is tested: all of it for
        one input, or what the less useful input of a pair adds to the other, by a chi-square with
        ``degrees`` of freedom.
        """
        chance = min(1.0, tests * _chi2_tail(2.0 * n * added, degrees))
        if chance < _CHANCE:
            attribution = _attribution(parts, information / total, chance, violates)
            attributions.extend([attribution] if attribution else [])

    for name, part in fine.items():
        information = _information(part.index, part.number, violates)
        add_if_significant({name: part}, information, information, part.number - 1)
    alone = {name: _information(part.index, part.number, violates) for name, part in coarse.items()}
    for one, two in pairs:
        a, b = coarse[one], coarse[two]
        information = _information(a.index * b.number + b.index, a.number * b.number, violates)
        # information of the second input within each part of the first, and vice versa
        added = min(
            (information - alone[one], a.number * (b.number - 1)),
            (information - alone[two], b.number * (a.number - 1)),
            key=lambda pair: -_chi2_tail(2.0 * n * pair[0], pair[1]),
        )
        add_if_significant({one: a, two: b}, information, *added)
    return sorted(attributions, key=lambda attribution: -attribution.information)


def attribute_violations(
    requirement: Requirement,
    cases: Mapping[str, np.ndarray],
    inputs: Sequence[str],
    others: Sequence[Requirement] = (),
    design: str = "random",
) -> list[Attribution]:
    """Attribute the violations of a requirement to inputs, among the cases with a known result.

    Parameters
    ----------
    requirement : Requirement
    cases : mapping of name to column, shape (n_cases,)
    inputs : sequence of str
        Columns of the dispersed inputs.
    others : sequence of Requirement
        Requirements that one on `VIOLATION` combines, as for `violation_masks`.
    design : str
        Sampler of the cases. The result is empty for those in `PATTERNS`, for which the G-test is
        invalid: in each of 40 Sobol campaigns it named a pair of inputs without effect.

    Returns
    -------
    list of Attribution
        See `attribute_failures`.
    """
    if design in PATTERNS:
        return []
    violates, known = violation_masks(requirement, cases, others)
    return attribute_failures(
        {name: column(cases, name)[known] for name in inputs}, inputs, violates[known]
    )


def attribute_missing(
    metric: str, cases: Mapping[str, np.ndarray], inputs: Sequence[str], design: str = "random"
) -> tuple[int, list[Attribution]]:
    """Count the ``ok`` cases that do not have an outcome, and attribute them to inputs.

    Parameters
    ----------
    metric : str
        Name of the outcome.
    cases, inputs, design
        As for `attribute_violations`.

    Returns
    -------
    count : int
        Number of ok cases in which the outcome is NaN.
    attributions : list of Attribution
        Inputs that distinguish them from the other ok cases, see `attribute_failures`; empty for a
        ``design`` in `PATTERNS` ("sobol", "saltelli").
    """
    ok = ok_rows(cases)
    missing = np.isnan(column(cases, metric)[ok])
    if design in PATTERNS or not missing.any():
        return int(missing.sum()), []
    return int(missing.sum()), attribute_failures(
        {n: column(cases, n)[ok] for n in inputs}, inputs, missing
    )


def _partition(
    cases: Mapping[str, np.ndarray], inputs: Sequence[str], limit: float
) -> dict[str, "_Partition"]:
    """Return by name the partition of each input that varies in the case table ``cases``, into at
    most ``limit`` parts (raised or lowered to the range 2 to 8). Inputs that do not vary are left
    out."""
    max_parts = int(np.clip(limit, *_PART_LIMITS))
    partitions = {name: _Partition(column(cases, name), max_parts) for name in inputs}
    return {name: partition for name, partition in partitions.items() if partition.number > 1}


class _Partition:
    """Partition of the range of an input into ``number`` parts, at most ``max_parts``, of about
    equally many cases, or one for each value if there are no more values than ``max_parts``:
    ``values`` (n,) of the input, and ``index`` (n,) of the part, from 0, of each case."""

    def __init__(self, values: np.ndarray, max_parts: int):
        edges = np.unique(values)
        if len(edges) > max_parts:
            edges = np.unique(np.quantile(values, np.arange(max_parts) / max_parts, method="lower"))
        self.values, self.number = values, len(edges)
        self.index = np.searchsorted(edges, values, side="right") - 1


def _information(cells: np.ndarray, number: int, violates: np.ndarray) -> float:
    """Return the mutual information, in nats, between the cell and the violation of a case:
    ``cells`` (n,) are indices below ``number``, ``violates`` (n,) is a mask."""
    counts = [np.bincount(cells[rows], minlength=number) for rows in (violates, ~violates)]
    return float(_mutual_information(np.array(counts)))


def _mutual_information(counts: np.ndarray) -> np.ndarray:
    """Return the mutual information, in nats, between the first two axes of ``counts`` (violating
    or not, cells, ...); its shape is that of the further axes."""
    fractions = counts / counts.sum(axis=(0, 1))
    expected = fractions.sum(axis=0) * fractions.sum(axis=1, keepdims=True)
    numerator = np.where(fractions > 0.0, fractions, 1.0)
    denominator = np.where(fractions > 0.0, expected, 1.0)
    return np.asarray(np.sum(fractions * np.log(numerator / denominator), axis=(0, 1)))


def _chi2_tail(statistic: float, degrees: int) -> float:
    """Return the probability that a chi-square variable with ``degrees`` of freedom exceeds the
    ``statistic``."""
    from scipy.special import chdtrc  # noqa: PLC0415  (0.1 s)

    return float(chdtrc(degrees, max(statistic, 0.0)))


def _attribution(
    partition_of: Mapping[str, _Partition],
    information_fraction: float,
    chance: float,
    violates: np.ndarray,
) -> Attribution | None:
    """Build the attribution to an input, or to a pair of inputs (``partition_of`` has one or two).

    Its region is the part or cell with the most information, of those in which a larger fraction
    of the cases violates than of all n cases. For a pair, the odds of a violation in the cell must
    also be at least 1.5 times those in the rest of either part. None if there is no such part or
    cell. ``information_fraction`` (clipped to 0 to 1) and ``chance`` become fields of the
    attribution; ``violates`` (n,) is a mask.
    """
    shape = tuple(partition.number for partition in partition_of.values())
    cells = np.ravel_multi_index([partition.index for partition in partition_of.values()], shape)
    size, k, n = int(np.prod(shape)), int(np.count_nonzero(violates)), len(violates)
    inside = np.bincount(cells[violates], minlength=size).reshape(shape)
    cases = np.bincount(cells, minlength=size).reshape(shape)
    information = _mutual_information(
        np.array([[inside, k - inside], [cases - inside, n - k - (cases - inside)]])
    )
    information[inside <= cases * (k / n)] = -1.0
    for axis in range(len(shape)) if len(shape) > 1 else ():  # along each input of a pair
        other_cases, other_violations = (
            x.sum(axis=axis, keepdims=True) - x for x in (cases, inside)
        )
        information[
            _odds(inside, cases) < _MIN_ODDS_RATIO * _odds(other_violations, other_cases)
        ] = -1.0
    best = np.unravel_index(int(np.argmax(information)), shape)
    if information[best] < 0.0:
        return None
    inside_region = cells == np.ravel_multi_index(best, shape)
    region = tuple(
        (float(partition.values[inside_region].min()), float(partition.values[inside_region].max()))
        for partition in partition_of.values()
    )
    fraction = float(np.clip(information_fraction, 0.0, 1.0))
    return Attribution(
        tuple(partition_of), fraction, chance, region, int(inside[best]), k, int(cases[best])
    )


def _odds(inside: np.ndarray, cases: np.ndarray) -> np.ndarray:
    """Return the odds of a violation from the numbers of violations (``inside``) and of ``cases``,
    of equal shape; half a case is added to the violating and half to the other ones (Haldane, Ann.
    Hum. Genet. 20, 1956)."""
    return np.asarray((inside + 0.5) / (cases - inside + 0.5))


def attribution_table(attributions: Mapping[str, Sequence[Attribution]]) -> pd.DataFrame:
    """Return a table of attributions.

    Parameters
    ----------
    attributions : mapping of str to sequence of Attribution
        By the name of the requirement or other failure.

    Returns
    -------
    DataFrame, a row per attribution
        ``violated``, the name; ``input`` with its region ``low`` to ``high``; ``second_input``,
        ``second_low`` and ``second_high`` likewise for a pair, else empty and NaN; and the fields
        ``information``, ``chance``, ``inside``, ``cases`` and ``violations`` of `Attribution`.
    """
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
        for name, each in attributions.items()
        for one in each
    ]
    columns = pd.Index(
        ["violated", "input", "low", "high", "second_input", "second_low", "second_high",
         "information", "chance", "inside", "cases", "violations"]
    )  # fmt: skip
    return pd.DataFrame(rows, columns=columns)


def render_attribution(
    what: str,
    attributions: Sequence[Attribution],
    keys: Mapping[str, str],
    most: int = 5,
    width: int = WIDTH,
    design: str = "random",
) -> str:
    """Render the attributions of one failure as text: a head, then a paragraph for each.

    Parameters
    ----------
    what : str
        Name of the requirement or other failure, which begins the text.
    attributions : sequence of Attribution
    keys : mapping of input column to TOML path
    most : int
        Largest number of attributions rendered, the first ones.
    width : int
        Characters in a line.
    design : str
        Sampler of the cases; for one in `PATTERNS` the text says why there is no attribution.

    Returns
    -------
    str
        A line that says so if there are no attributions.
    """
    if design in PATTERNS:
        return f"{what}: {_PATTERNED.format(design=design)}"
    if not attributions:
        return f"{what}: no input or pair of inputs distinguishes these cases from the rest"
    lines = [f"{what}: inputs that distinguish these cases from the rest"]
    for attribution in attributions[:most]:
        region = " and ".join(
            f"{keys.get(name, name)} "
            + (f"= {low:.5g}" if low == high else f"{low:.5g} to {high:.5g}")
            for name, (low, high) in zip(attribution.inputs, attribution.region, strict=True)
        )
        names = " and ".join(keys.get(name, name) for name in attribution.inputs)
        verb = " together explain" if len(attribution.inputs) > 1 else " explains"
        lines.append(
            fill(
                f"{names}{verb} {100.0 * attribution.information:.0f} % of the information on "
                f"which cases these are, mostly where {region}: {attribution.inside} of the "
                f"{attribution.violations} such cases are among the {attribution.cases} cases "
                "there",
                width,
                initial_indent="  ",
                subsequent_indent="      ",
            )
        )
    return "\n".join(lines)
