"""Verdicts on requirements from the cases of a campaign.

A case violates a requirement if its outcome is beyond a bound, or, for a requirement on a status,
if it ended with that status. A case that did not finish, or has no such outcome, is unknown: it
counts as a violation where the requirement is to be shown, and not where it is to be refuted. A
case violates a requirement on `VIOLATION` if it violates any other requirement. Method: Hanson and
Beard, NASA/TP-2010-216447: n cases pass if a just insufficient system has as few violations with a
probability of at most 1 - confidence (`sepmc.analysis.proportions`).
"""

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import asdict, dataclass, fields
from typing import Any

import numpy as np
import pandas as pd

from sepmc.analysis.accumulator_state import Arrays, scalars, set_scalars
from sepmc.analysis.proportions import (
    allowed_violations,
    binomial_cdf,
    binomial_interval,
    design_rank,
    lower_bound,
    required_cases,
    upper_bound,
)
from sepmc.analysis.statistics import column, ok_rows
from sepmc.scene.model import VIOLATION, Requirement
from sepmc.schema import is_yes_or_no

PASS, FAIL, NOT_SHOWN, NONE = "pass", "fail", "not shown", "no verdict"
# Stored margins nearest to a bound; this many within the numerical error leave no verdict.
_MAX_NEAR = 65536


# Numerical errors by outcome: (relative error, scale). The error is relative to the size of the
# outcome, or to the scale (in its unit) if larger (`sepmc.campaign.execution.accuracy.errors`).
Errors = Mapping[str, tuple[float, float]]


def required_bounds(requirements: Sequence[Requirement]) -> dict[str, list[float]]:
    """Return, by outcome, the list of all lower and upper bounds that requirements set on it, in
    its unit. The list is empty for a status and for `VIOLATION`, which are keys as well."""
    bounds: dict[str, list[float]] = {}
    for item in requirements:
        own = [bound for bound in (item.at_least, item.at_most) if bound is not None]
        bounds[item.metric] = bounds.get(item.metric, []) + own
    return bounds


class RequirementCounter:
    """Accumulator that counts the cases that violate a requirement; cases are added in case order.

    ``cases``, ``violations`` (unknown cases included) and ``missing`` (unknown cases) are counts.
    Unknown cases did not finish or do not have the outcome; for a requirement on a status, those
    that ended with neither ``ok`` nor this status. ``worst`` is the outcome nearest to or
    furthest beyond the bound and its case (NaN, -1: none), ``first`` and ``first_unknown`` the
    first case known to violate and the first unknown one (-1: none). ``others``, empty for any
    other requirement, are the counters that one on `VIOLATION` combines.
    """

    def __init__(self, requirement: Requirement):
        self.requirement = requirement
        self.others: list[RequirementCounter] = []  # for VIOLATION: those of other requirements
        self.cases = self.violations = self.missing = 0
        self.worst = (math.nan, -1)  # value and case
        self.first = self.first_unknown = -1  # first violating case, and first unknown one
        self._min_margin = math.inf
        self._near = np.empty(0)  # margins nearest to the bound; negative ones violate

    def add(
        self, numbers: np.ndarray, ok: np.ndarray, values: np.ndarray | None, has_status: np.ndarray
    ) -> tuple[np.ndarray, np.ndarray]:
        """Count n further cases.

        Parameters
        ----------
        numbers : ndarray, shape (n,), int
            Case numbers.
        ok : ndarray, shape (n,), bool
            True for cases that finished.
        values : ndarray, shape (n,), optional
            The outcome in each case; None if the requirement is on a status.
        has_status : ndarray, shape (n,), bool
            For a requirement on a status, True for cases that ended with it; else unused.

        Returns
        -------
        violates, unknown : ndarray, shape (n,), bool
            Masks of cases that certainly violate, and of unknown ones, which did not finish or do
            not have the outcome (see `RequirementCounter`); no case is in both. For a requirement
            on a status, a case that is neither ok nor has the status is unknown.
        """
        self.cases += len(numbers)
        if values is None:
            return self._count(numbers, ~ok & has_status, ~ok & ~has_status)
        margin = np.where(ok, margins(values, self.requirement), np.nan)
        known = ~np.isnan(margin)
        counted = self._count(numbers, margin < 0.0, ~known)
        margin, values, numbers = margin[known], values[known], numbers[known]
        if not len(margin):
            return counted
        at = int(np.argmin(margin))
        if margin[at] < self._min_margin:
            self._min_margin, self.worst = float(margin[at]), (float(values[at]), int(numbers[at]))
        self._keep_near(margin)
        return counted

    def _keep_near(self, margin: np.ndarray) -> None:
        """Add margins (n,) to the stored ones, of which the `_MAX_NEAR` nearest to the bound are
        kept."""
        near = np.concatenate([self._near, margin])
        if len(near) > _MAX_NEAR:
            near = near[np.argpartition(np.abs(near), _MAX_NEAR)[:_MAX_NEAR]]
        self._near = near

    def state(self) -> list[np.ndarray]:
        """Return what was accumulated so far as float arrays, which `restore` takes."""
        return [scalars(self), np.array(self.worst), self._near]

    def restore(self, arrays: Arrays) -> None:
        """Replace what was accumulated by the arrays of `state`, which are taken from the iterator
        ``arrays`` in that order. Raises ValueError if the first has another length or no number
        where a count is expected (`set_scalars`), or the worst case is no number, OverflowError if
        that is infinite, and StopIteration if there are too few arrays."""
        set_scalars(self, next(arrays))
        value, case = next(arrays).tolist()
        self.worst, self._near = (value, int(case)), next(arrays)

    def merge(self, others: "RequirementCounter") -> None:
        """Add the counts of another counter of the same requirement, whose cases follow those
        already counted."""
        self.cases += others.cases
        self.violations += others.violations
        self.missing += others.missing
        if others._min_margin < self._min_margin:
            self._min_margin, self.worst = others._min_margin, others.worst
        self.first = others.first if self.first < 0 else self.first
        if self.first_unknown < 0:
            self.first_unknown = others.first_unknown
        self._keep_near(others._near)

    def add_any(
        self, numbers: np.ndarray, counted: Sequence[tuple[np.ndarray, np.ndarray]]
    ) -> tuple[np.ndarray, np.ndarray]:
        """Count cases for a requirement on `VIOLATION`, and return their masks as `add` does:
        ``numbers`` (n,) are their case numbers, ``counted`` the masks (violates, unknown) that
        `add` returned for each other requirement."""
        self.cases += len(numbers)
        known, unknown = (np.any([masks[k] for masks in counted], axis=0) for k in (0, 1))
        return self._count(numbers, known, unknown & ~known)

    def _count(
        self, numbers: np.ndarray, known: np.ndarray, unknown: np.ndarray
    ) -> tuple[np.ndarray, np.ndarray]:
        """Add to the counts the cases that violate (mask ``known``) and those without a known
        outcome (mask ``unknown``): the latter count as ``missing`` and, with the former, as
        ``violations``. Note the first number of each among the case ``numbers`` (n,); return the
        two masks (n,) unchanged."""
        self.missing += int(np.count_nonzero(unknown))
        self.violations += int(np.count_nonzero(known | unknown))
        if self.first < 0 and known.any():
            self.first = int(numbers[known][0])
        if self.first_unknown < 0 and unknown.any():
            self.first_unknown = int(numbers[unknown][0])
        return known, unknown

    @property
    def extreme(self) -> tuple[float, int]:
        """Worst value of the outcome and the number of its case.

        For a requirement on a status, on a yes-or-no outcome or on `VIOLATION`, and if no case has
        a value: NaN and the first violating case, else the first unknown one, else -1.
        """
        item = self.requirement
        on_status = item.at_least is item.at_most is None
        if on_status or is_yes_or_no(item.metric) or self.worst[1] < 0:
            return math.nan, self.first if self.first >= 0 else self.first_unknown
        return self.worst

    @property
    def nearest(self) -> float:
        """Smallest distance of the outcome of a case from a bound, on either side, in the unit of
        the outcome; infinite if no case has the outcome."""
        return float(np.abs(self._near).min(initial=math.inf))

    def in_doubt(self, error: float) -> tuple[int, int] | None:
        """Return the smallest and the largest number of violations that are possible if outcomes
        are wrong by up to ``error``, in their unit; None if `_MAX_NEAR` or more cases are that near
        to the bound. Both include the unknown cases, as ``violations`` does."""
        near = self._near[np.abs(self._near) < error]
        if len(near) == _MAX_NEAR:
            return None
        below = int(np.count_nonzero(near < 0.0))
        return self.violations - below, self.violations + len(near) - below


def requirement_counters(requirements: Sequence[Requirement]) -> list[RequirementCounter]:
    """Return an empty counter for each requirement, in their order; ``others`` of one on
    `VIOLATION` are the counters of all requirements that are not on it."""
    counters = [RequirementCounter(item) for item in requirements]
    for counter in counters:
        if counter.requirement.metric == VIOLATION:
            counter.others = [other for other in counters if other.requirement.metric != VIOLATION]
    return counters


def count_cases(
    counters: Sequence[RequirementCounter],
    numbers: np.ndarray,
    ok: np.ndarray,
    values: Callable[[str], np.ndarray | None],
    has_status: Callable[[str], np.ndarray],
) -> None:
    """Count n further cases in all counters.

    Parameters
    ----------
    counters : sequence of RequirementCounter
        All of a campaign, from `requirement_counters`.
    numbers, ok
        As for `RequirementCounter.add`.
    values : callable
        Returns the outcome (n,) of a name, None for the name of a status.
    has_status : callable
        Returns the mask (n,) of cases that ended with the status of a name.
    """
    masks = [
        counter.add(
            numbers, ok, values(counter.requirement.metric), has_status(counter.requirement.metric)
        )
        for counter in counters
        if not counter.others
    ]
    for counter in counters:
        if counter.others:
            counter.add_any(numbers, masks)


def has_two_bounds(requirement: "Requirement | Verdict") -> bool:
    """Return True if a requirement has a lower and an upper bound."""
    return requirement.at_least is not None and requirement.at_most is not None


def margins(values: np.ndarray, requirement: "Requirement | Verdict") -> np.ndarray:
    """Return the margins of an outcome: its signed distances from the nearer bound.

    Parameters
    ----------
    values : ndarray, shape (n,)
        The outcome.
    requirement : Requirement or Verdict
        Its bounds are used; a missing bound is never the nearer one.

    Returns
    -------
    ndarray, shape (n,)
        In the unit of the outcome; negative where a bound is violated, NaN where the value is NaN.
    """
    low, high = requirement.at_least, requirement.at_most
    below = values - low if low is not None else np.where(np.isnan(values), np.nan, math.inf)
    above = high - values if high is not None else np.where(np.isnan(values), np.nan, math.inf)
    return np.minimum(below, above)


def violation_masks(
    requirement: Requirement, cases: Mapping[str, Any], others: Sequence[Requirement] = ()
) -> tuple[np.ndarray, np.ndarray]:
    """Return the masks of cases that violate a requirement and of cases with a known result.

    Parameters
    ----------
    requirement : Requirement
    cases : mapping of name to column, shape (n_cases,)
    others : sequence of Requirement
        All requirements of the campaign; used only for one on `VIOLATION`, which combines them.

    Returns
    -------
    violates, known : ndarray, shape (n_cases,), bool
        As `RequirementCounter` counts them: cases that certainly violate, and all but the unknown
        ones, which did not finish or do not have the outcome; a case that violates is known. The
        numerical error of an outcome is not considered.
    """
    counter, statuses = RequirementCounter(requirement), np.asarray(cases["status"], dtype=object)
    numbers = np.arange(len(statuses))
    if requirement.metric == VIOLATION:
        masks = [violation_masks(item, cases) for item in others if item.metric != VIOLATION]
        violates, unknown = counter.add_any(numbers, [(each, ~known) for each, known in masks])
    else:
        values = column(cases, requirement.metric) if requirement.metric in cases else None
        violates, unknown = counter.add(
            numbers, ok_rows(cases), values, statuses == requirement.metric
        )
    return violates, ~unknown


@dataclass(frozen=True)
class Verdict:
    """Result of a requirement for the cases of a campaign.

    Parameters
    ----------
    name, metric, at_least, at_most, probability, confidence
        As in the requirement: name, outcome or status, bounds (None: no such bound), required
        fraction of all cases, and confidence.
    verdict : str
        ``pass``: shown with the confidence; ``fail``: refuted with the confidence; ``not shown``:
        neither; ``no verdict``: see ``why``.
    why : str
        Reason if there is no verdict, else empty.
    cases, violations, allowed : int
        Cases, violations among them (unknown cases included), and allowed violations (-1: too few
        cases to pass).
    missing, lacking : int
        Unknown cases, which did not finish or do not have the outcome (for a status: ended with
        neither ``ok`` nor this status); those of them that finished.
    more : int
        Further cases, none of them violating, with which the requirement would pass; 0 if
        ``violations`` is at most ``allowed``.
    share_low, share_high : float
        95 % Clopper-Pearson interval of the violation probability: its lower end with none, its
        upper end with all of the unknown cases counted as violations; 0 and 1 without cases.
    share_at_least, share_at_most : float
        One-sided bounds of the violation probability, each with the confidence of the requirement,
        with none and with all of the unknown cases counted as violations.
    design_value : float, optional
        Value that bounds the required fraction of all cases with the confidence, in the unit of the
        outcome; with two bounds, such a value of the margin to the nearer one, negative beyond it.
        None for a status or `VIOLATION`, for too few cases, and if the value is infinite.
    worst, worst_case : float, int, optional
        Worst value of the outcome and its case; for a status, a yes-or-no outcome or `VIOLATION`
        None and the first violating case (the first unknown one if none violates). None if there
        is no such value or case.
    first_missing : int, optional
        First unknown case; None if there is none.
    nearest, error : float, optional
        Smallest distance of a case from a bound, on either side, and the numerical error of the
        outcome at the bound, both in its unit. ``nearest`` is None for a status or `VIOLATION` and
        if no case has the outcome. ``error`` is 0 for a status or a yes-or-no outcome, and None for
        `VIOLATION` and if it is not known.
    """

    name: str
    metric: str
    at_least: float | None
    at_most: float | None
    probability: float
    confidence: float
    verdict: str
    why: str
    cases: int
    violations: int
    allowed: int
    missing: int
    more: int
    share_low: float
    share_high: float
    share_at_least: float
    share_at_most: float
    design_value: float | None
    worst: float | None
    worst_case: int | None
    nearest: float | None
    error: float | None
    lacking: int = 0
    first_missing: int | None = None

    def to_dict(self) -> dict[str, Any]:
        """Return all fields as a dict by name."""
        return asdict(self)


def design_value(
    counter: RequirementCounter, count: int, at_ranks: Callable[[np.ndarray], np.ndarray]
) -> float:
    """Return the design value of a requirement: the value of a case that bounds the required
    fraction of all cases with the required confidence.

    Parameters
    ----------
    counter : RequirementCounter
        Counter of all cases.
    count : int
        Number of cases that have the outcome.
    at_ranks : callable
        Maps zero-based ranks (k,) to the values of these ranks in increasing order; with two bounds
        to their `margins` instead.

    Returns
    -------
    float
        NaN for a requirement on a status or on `VIOLATION`, and with too few cases.
    """
    item = counter.requirement
    if item.at_least is item.at_most is None:  # on a status
        return math.nan
    rank = design_rank(
        count, item.probability, item.confidence, item.at_least is None, counter.missing
    )
    return math.nan if rank is None else float(at_ranks(np.array([rank]))[0])


def no_verdict_reason(audit_failed: bool, sampler: str) -> str:
    """Return the reason why the cases of a run allow no verdict on any requirement; an empty string
    if they allow verdicts. ``audit_failed`` is True if an ok case is beyond a bound of the audit;
    ``sampler`` is the value of ``run.sampler``: only "random" allows verdicts."""
    if audit_failed:
        return "the audit failed: some ok cases are beyond the bound of an audit column"
    if sampler != "random":
        return (
            f"cases of run.sampler = {sampler!r} are not independent, so no confidence "
            "applies to them; use run.sampler = 'random'"
        )
    return ""


def judge(
    counter: RequirementCounter,
    errors: Errors,
    design_value: float,
    reason: str = "",
    lacking: int = 0,
) -> Verdict:
    """Return the verdict on a requirement.

    Parameters
    ----------
    counter : RequirementCounter
        Counter of all cases.
    errors : mapping
        Numerical errors of outcomes, see `Errors`.
    design_value : float
        See `design_value`; NaN if there is none.
    reason : str
        Reason why there can be no verdict, from `no_verdict_reason`; else empty.
    lacking : int
        Number of cases that finished and do not have the outcome.
    """
    item, n, k = counter.requirement, counter.cases, counter.violations
    allowed = allowed_violations(n, item.probability, item.confidence) if n else -1
    bounded = _with_errors(counter, errors)
    verdict, why = _verdict(counter, bounded, reason)
    known = k - counter.missing
    worst, worst_case = counter.extreme
    return Verdict(
        item.name,
        item.metric,
        item.at_least,
        item.at_most,
        item.probability,
        item.confidence,
        verdict,
        why,
        n,
        k,
        allowed,
        counter.missing,
        0 if k <= allowed else required_cases(k, item.probability, item.confidence) - n,
        binomial_interval(known, n)[0] if n else 0.0,
        binomial_interval(k, n)[1] if n else 1.0,
        lower_bound(known, n, item.confidence) if n else 0.0,
        upper_bound(k, n, item.confidence) if n else 1.0,
        _known(design_value),
        _known(worst),
        worst_case if worst_case >= 0 else None,
        _known(counter.nearest),
        _known(bounded[0][1]) if not counter.others else None,
        lacking,
        counter.first_unknown if counter.missing else None,
    )


def brief_verdict(counter: RequirementCounter, errors: Errors, reason: str = "") -> str:
    """Return only the field ``verdict`` of the `Verdict` that `judge` would return, 20 times as
    fast; arguments as for `judge`."""
    return _verdict(counter, _with_errors(counter, errors), reason)[0]


def _with_errors(
    counter: RequirementCounter, errors: Errors
) -> list[tuple[RequirementCounter, float]]:
    """Return (counter, numerical error at its bound) for each counter that a verdict depends on:
    ``counter`` itself, or for `VIOLATION` those of the other requirements, of which one is returned
    if several have the same outcome and bounds. The error is in the unit of the outcome."""
    # requirements on the same bound count once
    distinct = {
        (one.requirement.metric, one.requirement.at_least, one.requirement.at_most): one
        for one in counter.others or [counter]
    }
    return [(one, _error_at(one.requirement, errors)) for one in distinct.values()]


def _known(number: float) -> float | None:
    """Return a number if it is finite, else None."""
    return number if math.isfinite(number) else None


def _error_at(item: Requirement, errors: Errors) -> float:
    """Return the numerical error of a requirement's outcome at its bound (of two, the larger in
    size), in the unit of the outcome: 0 for a status or a yes-or-no outcome, NaN if unknown. It is
    the relative error times the bound, or times the scale of the outcome in ``errors`` if that is
    larger than the bound."""
    bounds = [abs(bound) for bound in (item.at_least, item.at_most) if bound is not None]
    if not bounds or is_yes_or_no(item.metric):
        return 0.0
    relative, scale = errors.get(item.metric, (math.nan, math.nan))
    return relative * max(*bounds, scale)


def _verdict(
    counter: RequirementCounter, bounded: Sequence[tuple[RequirementCounter, float]], reason: str
) -> tuple[str, str]:
    """Return the fields ``verdict`` and ``why`` of `Verdict`: ``bounded`` is from `_with_errors`;
    if ``reason`` is not empty, it is the reason for no verdict."""
    item, n = counter.requirement, counter.cases
    if not n:
        return NONE, "no case was run"
    if reason:
        return NONE, reason
    if counter.missing == n:
        outcomes_text = "all of these outcomes" if counter.others else "this outcome"
        return NONE, f"no case finished with {outcomes_text}"
    unknown = [each.requirement.metric for each, error in bounded if math.isnan(error)]
    if unknown:
        return NONE, f"the numerical error of {', '.join(unknown)} is not known"
    results, near_violations, near_passes = set(), 0, 0
    for each, error in bounded:
        bounds = each.in_doubt(error)
        if bounds is None:
            break
        near_violations += each.violations - bounds[0]
        near_passes += bounds[1] - each.violations
    else:
        k = counter.violations
        ends = max(k - near_violations, 0), min(k + near_passes, n)
        results = {_shown(end, min(counter.missing, end), n, item) for end in ends}
    if len(results) != 1:
        size = f" of {bounded[0][1]:.1e}" if not counter.others else ""
        return NONE, (
            f"cases nearer to the bound than the numerical error{size} determine the result; a "
            "finer solver.accuracy may resolve it, except for times and positions of extremes"
        )
    return results.pop(), ""


def _shown(k: int, missing: int, n: int, item: Requirement) -> str:
    """Return `PASS`, `FAIL` or `NOT_SHOWN` on requirement ``item`` for k violations in n cases;
    ``missing`` of the violations are unknown cases."""
    if k <= allowed_violations(n, item.probability, item.confidence):
        return PASS
    # probability of as many known violations in a system that just satisfies the requirement
    risk = 1.0 - item.confidence
    probability = (
        1.0 - binomial_cdf(k - missing - 1, n, 1.0 - item.probability) if k > missing else 1.0
    )
    return FAIL if probability <= risk else NOT_SHOWN


def lacking_decides(violations: int, missing: int, cases: int, item: Requirement) -> bool:
    """Return True if ``cases`` neither show nor refute a requirement, but would refute it if the
    ``missing`` ones among the ``violations``, which are unknown, were known to violate it."""
    shown = _shown(violations, missing, cases, item)
    return shown == NOT_SHOWN and _shown(violations, 0, cases, item) == FAIL


def verdict_table(verdicts: Sequence[Verdict]) -> pd.DataFrame:
    """Return a table with a row per verdict, indexed by the name of its requirement; its columns
    are the other fields of `Verdict`."""
    names = [field.name for field in fields(Verdict)]
    rows = [verdict.to_dict() for verdict in verdicts]
    return pd.DataFrame(rows, columns=pd.Index(names)).set_index("name")
