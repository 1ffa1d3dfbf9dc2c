"""Whether the cases of a campaign show what is required of it.

A case violates a requirement if its outcome is beyond the bound. A case that did not come to its
end, or does not have the outcome, has shown neither: it counts as a violation where the requirement
is to be shown, and not where it is to be refuted. A requirement on `VIOLATION` is violated by a
case that violates any other. Method: Hanson and Beard, NASA/TP-2010-216447: n cases show a
requirement if they have no more violations than a just insufficient system would have with a
probability of 1 - confidence (`sepmc.analysis.proportions`).
"""

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import asdict, dataclass, fields
from textwrap import fill
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
from sepmc.analysis.statistics_text import WIDTH, rounded
from sepmc.scene.model import VIOLATION, Requirement
from sepmc.schema import is_yes_or_no

_KEPT = "\N{NO-BREAK SPACE}"
ALL_CASES = "all cases"
PASS, FAIL, NOT_SHOWN, NONE = "pass", "fail", "not shown", "no verdict"
# Cases nearest to a bound of which it is known how near: more of them within the numerical error
# leave no verdict.
_NEAR = 65536


# of outcomes by name, as shares of their size or of a scale if that is larger; and these scales, in
# their units (`sepmc.campaign.execution.accuracy.errors`)
Errors = Mapping[str, tuple[float, float]]


class RequirementCounter:
    """Counts the cases that violate a requirement, as they pass by in their order."""

    def __init__(self, requirement: Requirement):
        self.requirement = requirement
        self.others: list[RequirementCounter] = []  # whose violations are its own
        self.cases = self.violations = self.missing = 0
        self.worst = (math.nan, -1)  # value and case
        self.first = self.first_unknown = -1  # case that violates, by its outcome or for want of it
        self._least = math.inf
        self._near = np.empty(0)  # margins nearest to the bound; below zero they violate

    def add(
        self, numbers: np.ndarray, ok: np.ndarray, values: np.ndarray | None, met: np.ndarray
    ) -> tuple[np.ndarray, np.ndarray]:
        """Take cases; returns which of them (n,) are known to violate, and of which it is not
        known.

        Parameters
        ----------
        numbers : ndarray, shape (n,), int
            Their numbers.
        ok : ndarray, shape (n,), bool
            Which of them came to their end.
        values : ndarray, shape (n,), optional
            The outcome; None if the requirement is on a status.
        met : ndarray, shape (n,), bool
            Which of them have that status.
        """
        self.cases += len(numbers)
        if values is None:
            return self._count(numbers, ~ok & met, ~ok & ~met)
        margin = np.where(ok, margins(values, self.requirement), np.nan)
        there = ~np.isnan(margin)
        counted = self._count(numbers, margin < 0.0, ~there)
        margin, values, numbers = margin[there], values[there], numbers[there]
        if not len(margin):
            return counted
        at = int(np.argmin(margin))
        if margin[at] < self._least:
            self._least, self.worst = float(margin[at]), (float(values[at]), int(numbers[at]))
        self._keep_near(margin)
        return counted

    def _keep_near(self, margin: np.ndarray) -> None:
        near = np.concatenate([self._near, margin])
        if len(near) > _NEAR:
            near = near[np.argpartition(np.abs(near), _NEAR)[:_NEAR]]
        self._near = near

    def state(self) -> list[np.ndarray]:
        """What it holds, for `restore`."""
        return [scalars(self), np.array(self.worst), self._near]

    def restore(self, arrays: Arrays) -> None:
        """Hold what another one held."""
        set_scalars(self, next(arrays))
        value, case = next(arrays).tolist()
        self.worst, self._near = (value, int(case)), next(arrays)

    def merge(self, others: "RequirementCounter") -> None:
        """Take cases that come next, which another tally of the same requirement counted."""
        self.cases += others.cases
        self.violations += others.violations
        self.missing += others.missing
        if others._least < self._least:
            self._least, self.worst = others._least, others.worst
        self.first = others.first if self.first < 0 else self.first
        if self.first_unknown < 0:
            self.first_unknown = others.first_unknown
        self._keep_near(others._near)

    def add_any(
        self, numbers: np.ndarray, counted: Sequence[tuple[np.ndarray, np.ndarray]]
    ) -> None:
        """Take cases, by what `add` of the ``others`` returned."""
        self.cases += len(numbers)
        known, unknown = (np.any([each[k] for each in counted], axis=0) for k in (0, 1))
        self._count(numbers, known, unknown & ~known)

    def _count(
        self, numbers: np.ndarray, known: np.ndarray, unknown: np.ndarray
    ) -> tuple[np.ndarray, np.ndarray]:
        """Count cases (n,) that are known to violate, and those of which nothing is known; returns
        both."""
        self.missing += int(np.count_nonzero(unknown))
        self.violations += int(np.count_nonzero(known | unknown))
        if self.first < 0 and known.any():
            self.first = int(numbers[known][0])
        if self.first_unknown < 0 and unknown.any():
            self.first_unknown = int(numbers[unknown][0])
        return known, unknown

    @property
    def extreme(self) -> tuple[float, int]:
        """Value and number of the worst case; of a requirement on what is yes or no, or on a
        status, or if no case has the outcome, no value and the first case that violates it. -1 if
        there is none."""
        item = self.requirement
        on_status = item.at_least is item.at_most is None
        if on_status or is_yes_or_no(item.metric) or self.worst[1] < 0:
            return math.nan, self.first if self.first >= 0 else self.first_unknown
        return self.worst

    @property
    def nearest(self) -> float:
        """Least distance of a case from the bound; infinite if no case has the outcome."""
        return float(np.abs(self._near).min(initial=math.inf))

    def in_doubt(self, error: float) -> tuple[int, int] | None:
        """Violations at least and at most, if outcomes are off by up to an ``error``; None if too
        many cases are that near to the bound."""
        near = self._near[np.abs(self._near) < error]
        if len(near) == _NEAR:
            return None
        below = int(np.count_nonzero(near < 0.0))
        return self.violations - below, self.violations + len(near) - below


def requirement_counters(requirements: Sequence[Requirement]) -> list[RequirementCounter]:
    """A tally of each requirement, in their order."""
    found = [RequirementCounter(item) for item in requirements]
    for tally in found:
        if tally.requirement.metric == VIOLATION:
            tally.others = [other for other in found if other.requirement.metric != VIOLATION]
    return found


def count_cases(
    all_tallies: Sequence[RequirementCounter],
    numbers: np.ndarray,
    ok: np.ndarray,
    values: Callable[[str], np.ndarray | None],
    met: Callable[[str], np.ndarray],
) -> None:
    """Take cases into all tallies: ``values`` gives an outcome (n,) by its name, None of a status,
    ``met`` which cases (n,) have a status; the others as for `RequirementCounter.add`."""
    counted = [
        tally.add(numbers, ok, values(tally.requirement.metric), met(tally.requirement.metric))
        for tally in all_tallies
        if not tally.others
    ]
    for tally in all_tallies:
        if tally.others:
            tally.add_any(numbers, counted)


def has_two_bounds(requirement: "Requirement | Verdict") -> bool:
    """Whether a requirement has a bound on either side."""
    return requirement.at_least is not None and requirement.at_most is not None


def margins(values: np.ndarray, requirement: "Requirement | Verdict") -> np.ndarray:
    """How far values (n,) are within the bound; below zero beyond it; NaN of NaN."""
    low, high = requirement.at_least, requirement.at_most
    below = values - low if low is not None else np.where(np.isnan(values), np.nan, math.inf)
    above = high - values if high is not None else np.where(np.isnan(values), np.nan, math.inf)
    return np.minimum(below, above)


def violation_masks(
    requirement: Requirement, cases: Mapping[str, Any], others: Sequence[Requirement] = ()
) -> tuple[np.ndarray, np.ndarray]:
    """Which cases of a table (n_cases,) violate a requirement, and of which of them it is known;
    ``others`` are those that a requirement on `VIOLATION` is about."""
    if requirement.metric == VIOLATION:
        found = [violation_masks(one, cases) for one in others if one.metric != VIOLATION]
        ended = ok_rows(cases)  # of others it is known what they are, but not what they would be
        found = [(one, there & (ended | one)) for one, there in found]
        violates = np.any([one & there for one, there in found], axis=0)
        return violates, violates | np.all([there for _, there in found], axis=0)
    labels = np.asarray(cases["status"], dtype=object)
    if requirement.metric in cases:
        margin = margins(column(cases, requirement.metric), requirement)
        return margin < 0.0, ok_rows(cases) & ~np.isnan(margin)
    return labels == requirement.metric, np.ones(len(labels), dtype=bool)


@dataclass(frozen=True)
class Verdict:
    """What the cases of a campaign say of a requirement.

    ``verdict`` : pass; fail: shown not to hold, with the same confidence; not shown: neither; no
    verdict, and ``why``
    ``violations`` of ``cases``, ``allowed`` of them (-1: too few cases); ``missing``: those of them
    that did not come to their end or have no such outcome, of which it is not known; ``lacking``:
    those of them that came to their end
    ``more`` : further cases, none of which violates, that would show it; 0 if it passes
    ``share_low``, ``share_high`` : 95 % interval of the share that violates (Clopper-Pearson), from
    no and from all cases of which it is not known; ``share_at_least``, ``share_at_most``: each with
    the confidence of the requirement
    ``design_value`` : what the required share of all cases does not pass, with the confidence: an
    order statistic; between two bounds, of the margin to the nearer one, below zero beyond it; None
    if the cases are too few
    ``worst``, ``worst_case`` : the outcome that is worst, and its case; where it is yes or no, a
    status, a violation of others, or in no case there, None, and the first case that violates
    ``nearest`` : least distance of a case from the bound; ``error`` : numerical error there; None
    where others are violated
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

    def to_dict(self) -> dict[str, Any]:
        """All fields by name."""
        return asdict(self)


def design_value(
    tally: RequirementCounter, count: int, ranked: Callable[[np.ndarray], np.ndarray]
) -> float:
    """The design value among so many outcomes, of two bounds `margins`, ``ranked`` by rising
    places; NaN if there is none."""
    item = tally.requirement
    if item.at_least is item.at_most is None:  # on a status
        return math.nan
    place = design_rank(
        count, item.probability, item.confidence, item.at_least is None, tally.missing
    )
    return math.nan if place is None else float(ranked(np.array([place]))[0])


def no_verdict_reason(audit: pd.DataFrame, sampler: str) -> str:
    """Why the cases of a run can show nothing, whatever they are; empty if they can."""
    if (audit["beyond"] > 0).any():
        return "the audit failed"
    if sampler != "random":
        return (
            f"cases of run.sampler = {sampler!r} do not come independently of each other, so "
            "they show nothing with a confidence; fly random ones"
        )
    return ""


def judge(
    tally: RequirementCounter, errors: Errors, design: float, none: str = "", lacking: int = 0
) -> Verdict:
    """The verdict on a requirement.

    Parameters
    ----------
    tally : of all cases
    errors : of outcomes
    design : the `design_value`; NaN if there is none
    none : why there can be no verdict; see `no_verdict_reason`
    lacking : cases that came to their end without the outcome
    """
    item, n, k = tally.requirement, tally.cases, tally.violations
    may = allowed_violations(n, item.probability, item.confidence) if n else -1
    # what two say of one bound is in doubt once
    about = {
        (one.requirement.metric, one.requirement.at_least, one.requirement.at_most): one
        for one in tally.others or [tally]
    }
    parts = [(one, _error_at(one.requirement, errors)) for one in about.values()]
    verdict, why = _verdict(tally, parts, none)
    known = k - tally.missing
    worst, worst_case = tally.extreme
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
        may,
        tally.missing,
        0 if k <= may else required_cases(k, item.probability, item.confidence) - n,
        binomial_interval(known, n)[0] if n else 0.0,
        binomial_interval(k, n)[1] if n else 1.0,
        lower_bound(known, n, item.confidence) if n else 0.0,
        upper_bound(k, n, item.confidence) if n else 1.0,
        _known(design),
        _known(worst),
        worst_case if worst_case >= 0 else None,
        _known(tally.nearest),
        _known(parts[0][1]) if not tally.others else None,
        lacking,
    )


def _known(number: float) -> float | None:
    return number if math.isfinite(number) else None


def _error_at(item: Requirement, errors: Errors) -> float:
    """Numerical error of an outcome at its bound, in its unit; NaN if it is not known."""
    bounds = [abs(bound) for bound in (item.at_least, item.at_most) if bound is not None]
    if not bounds or is_yes_or_no(item.metric):
        return 0.0
    share, scale = errors.get(item.metric, (math.nan, math.nan))
    return share * max(*bounds, scale)


def _verdict(
    tally: RequirementCounter, parts: Sequence[tuple[RequirementCounter, float]], none: str
) -> tuple[str, str]:
    """The verdict, and why there is none, if ``parts``, what it is about, have such errors."""
    item, n = tally.requirement, tally.cases
    if not n:
        return NONE, "no case was flown"
    if none:
        return NONE, none
    if tally.missing == n:
        what = "all of these outcomes" if tally.others else "this outcome"
        return NONE, f"no case came to its end with {what}"
    unknown = [part.requirement.metric for part, error in parts if math.isnan(error)]
    if unknown:
        return NONE, f"the numerical error of {', '.join(unknown)} is not known"
    found, fewer, more = set(), 0, 0
    for part, error in parts:
        doubt = part.in_doubt(error)
        if doubt is None:
            break
        fewer, more = fewer + part.violations - doubt[0], more + doubt[1] - part.violations
    else:
        ends = max(tally.violations - fewer, 0), min(tally.violations + more, n)
        found = {_shown(k, min(tally.missing, k), n, item) for k in ends}
    if len(found) != 1:
        size = f" of {parts[0][1]:.1e}" if not tally.others else ""
        return NONE, (
            f"cases nearer to the bound than the numerical error{size} decide; a finer "
            "solver.accuracy may tell, but for times and places of extremes"
        )
    return found.pop(), ""


def _shown(k: int, missing: int, n: int, item: Requirement) -> str:
    """What k violations in n cases show, of which so many are ``missing``."""
    if k <= allowed_violations(n, item.probability, item.confidence):
        return PASS
    # a system that is just sufficient would rarely have so many that are known
    rarely = 1.0 - item.confidence
    as_many = 1.0 - binomial_cdf(k - missing - 1, n, 1.0 - item.probability) if k > missing else 1.0
    return FAIL if as_many <= rarely else NOT_SHOWN


def verdict_table(verdicts: Sequence[Verdict]) -> pd.DataFrame:
    """Verdicts by the name of their requirement."""
    names = [field.name for field in fields(Verdict)]
    rows = [verdict.to_dict() for verdict in verdicts]
    return pd.DataFrame(rows, columns=pd.Index(names)).set_index("name")


def render_verdicts(
    verdicts: Sequence[Verdict],
    units: Mapping[str, str],
    width: int = WIDTH,
    of: str = ALL_CASES,
) -> str:
    """Verdicts as an engineer reads them in a terminal, ``of`` the cases that there are; nothing if
    nothing is required."""
    told = (_render_verdict(v, units.get(v.metric, ""), width, of) for v in verdicts)
    return "\n".join(["requirements", *told])


def render_cases_needed(verdicts: Sequence[Verdict]) -> str:
    """The sentence on what some cases, chosen from others, lack to show what is required of them;
    empty if nothing is: they are as rare as what they were chosen by."""
    few = [v for v in verdicts if v.verdict == NOT_SHOWN]
    if not few:
        return ""
    most = max(v.more for v in few)
    which = few[0].name if len(few) == 1 else f"{len(few)} requirements"
    return (
        f"{which} not shown: {most} more such cases, none of which violates, would; a campaign "
        "whose file fixes what is given (--set) flies such cases only"
    )


def requirement_sentence(item: Requirement | Verdict, unit: str, of: str = ALL_CASES) -> str:
    """A requirement in words, ``of`` the cases that it is held to."""
    bound = " and ".join(
        f"{sign} {number:g}{_spaced(unit)}"
        for sign, number in ((">=", item.at_least), ("<=", item.at_most))
        if number is not None
    )
    what = f"{item.metric} {bound or 'does not occur'}"
    if item.metric == VIOLATION:
        what = "no other requirement is violated"
    return (
        f"{item.name}: {what} in {_percent(item.probability)} "
        f"of {of}, with {_percent(item.confidence)} confidence"
    )


def _render_verdict(v: Verdict, unit: str, width: int, of: str) -> str:
    required, confidence = _percent(v.probability), _percent(v.confidence)
    lines = [
        requirement_sentence(v, unit, of),
        f"{v.violations} of {v.cases} cases violate it, "
        + (f"{v.allowed} may" if v.allowed >= 0 else "where even none would not show it")
        + (f"; {render_missing(v)}" if v.missing else ""),
    ]
    if v.verdict == NONE:
        lines.insert(1, v.why)
    else:
        lines[-1] += f"; of {of} {_violating(v)} do ({confidence})"
    if v.verdict == NOT_SHOWN and of == ALL_CASES:
        lines.append(f"{v.more} more cases, none of which violates it, would show it")
    if v.worst is not None:
        said = f"worst {_number(v.worst)}{_spaced(unit)} (case {v.worst_case})"
        if v.design_value is not None and v.verdict != NONE:
            said += f"; {required} of {of} are {_designed(v, unit)}, with {confidence}"
        lines.append(said)
    head, indent = f"  {v.verdict.upper():10s}  ", " " * 14
    return "\n".join(
        fill(
            line.replace(" %", _KEPT + "%"),
            width,
            initial_indent=indent if i else head,
            subsequent_indent=indent,
        ).replace(_KEPT, " ")
        for i, line in enumerate(lines)
    )


def render_missing(v: Verdict) -> str:
    """Of how many cases that count as violations nothing is known, and why."""
    ended = v.missing - v.lacking
    if v.metric == VIOLATION:
        unknown = {"did not come to their end, or lack an outcome": v.missing}
    elif v.at_least is v.at_most is None:
        unknown = {"ended in another way": v.missing}
    else:
        unknown = {"have no such outcome": v.lacking, "did not come to their end": ended}
    return ", ".join(f"{count} of them {why}" for why, count in unknown.items() if count)


def _designed(v: Verdict, unit: str) -> str:
    """The design value in words."""
    value = v.design_value or 0.0
    if has_two_bounds(v):
        size = f"{_number(abs(value))}{_spaced(unit)}"
        if value >= 0.0:
            return f"at least {size} within both bounds"
        return f"at most {size} beyond a bound"
    return f"{'>=' if v.at_least is not None else '<='} {_number(value)}{_spaced(unit)}"


def _violating(v: Verdict) -> str:
    """What share of all cases violates a requirement."""
    return (
        f"> {format_proportion(v.share_at_least, math.floor)}"
        if v.verdict == FAIL
        else f"< {format_proportion(v.share_at_most, math.ceil)}"
    )


def _percent(share: float) -> str:
    return f"{100.0 * share:g} %"


def _spaced(unit: str) -> str:
    return f" {unit}" if unit not in ("", "1") else ""


def format_proportion(share: float, rounding: Callable[[float], int] = round) -> str:
    """A share of cases in two digits; of a bound that is to hold as it is printed, by another
    ``rounding``."""
    if 0.0 < share < 1.0:
        unit = 10.0 ** (math.floor(math.log10(share)) - 1)
        share = rounding(share / unit * (1.0 - 1e-12 * (rounding is math.ceil))) * unit
    return f"{share:.1e}" if 0.0 < share < 0.0095 else f"{share:.2g}"


def _number(value: float) -> str:
    return rounded(value, abs(value), 4)
