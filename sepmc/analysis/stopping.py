"""Stopping rule of a campaign: run until a statistic is known to a tolerance.

The statistic is checked after 256, 512, ... cases, a mean or a sigma after 2,048, 4,096, ... cases
(later if a rare value of an input needs more). Its interval has a coverage of 95 % whatever the
number n of checks, as each uses the confidence 1 - 0.05 / n (Bonferroni). Intervals of proportions
and percentiles are valid for any distribution. That of a mean requires a sample in which every
input value to which the file gives a probability has occurred often enough, and a sigma that is
itself known well. Coverage on fifteen problems: tests/measure/until.py.
"""

import math
from collections.abc import Collection, Sequence
from dataclasses import dataclass
from typing import NamedTuple, Protocol

import numpy as np
import pandas as pd

from sepmc.analysis.constant_outcomes import round_to_error
from sepmc.analysis.proportions import CONFIDENCE, binomial_interval, raised
from sepmc.analysis.rare_values import Occurrence, RareValue, undersampled
from sepmc.analysis.statistics import PERCENTILES, student_half_width
from sepmc.scene.messages import InputError, nearest
from sepmc.schema import NOT_OK_LABELS, is_yes_or_no
from sepmc.wording import option

_FORMAT = (
    "METRIC:TOLERANCE or METRIC.STATISTIC:TOLERANCE with a tolerance above 0, as "
    "separation_speed_m_s:0.01, upper_pitch_deg.p99:0.1 or upper_pitch_deg:1%"
)
# Cases before the first look; for a mean or a sigma enough to contain an event of 0.2 % probability
# with 98 %, even if no file gives that probability
_FIRST_LOOK, _FIRST_LOOK_OF_MOMENTS = 256, 2048
_MIN_VALUES = 50  # values required to report a mean or a sigma
# Largest relative standard error of sigma at which an interval of the mean is accepted: n is then
# at least 25 times the kurtosis less 1, and so 25 times the squared skewness (Cochran,
# Sampling Techniques, Wiley 1977, eq 2.18)
_MAX_SIGMA_ERROR = 0.1


class _Summary(Protocol):
    @property
    def counts(self) -> dict[str, int]: ...
    def statistics(self, *, confidence: float = CONFIDENCE) -> pd.DataFrame: ...


class InterimEstimate(NamedTuple):
    """Estimate of a statistic at one check: its ``value``, the ends ``low`` and ``high`` of its
    interval, ``sufficient``, True if the run may stop, and ``shortfall``, the reason why the cases
    are too few to report a mean or a sigma, whatever its interval (empty if there is none)."""

    value: float
    low: float
    high: float
    sufficient: bool
    shortfall: str


@dataclass(frozen=True)
class StoppingRule:
    """Rule to stop a run when both ends of the 95 % interval of a statistic are within a tolerance.

    Parameters
    ----------
    metric : str
        An outcome or a status.
    statistic : str
        ``mean``, ``sigma``, ``share`` (proportion of cases) or a percentile such as ``p99``.
    tolerance : float
        Largest distance of either end of the interval from the estimate, in the unit of the
        statistic, or as a fraction of its absolute value if ``relative``.
    relative : bool
        True if the tolerance was given in percent.
    text : str
        The text that `parse_stopping_rule` parses to this rule.
    """

    metric: str
    statistic: str
    tolerance: float
    relative: bool
    text: str

    @property
    def name(self) -> str:
        """Statistic and metric as text: ``mean of separation_speed_m_s``, ``share of jammed``."""
        return f"{self.statistic} of {self.metric}"

    @property
    def is_moment(self) -> bool:
        """True for a mean or a sigma, which depend on input values of low probability that may not
        have occurred in the cases so far."""
        return self.statistic in ("mean", "sigma")

    def first(self, values: Sequence[RareValue]) -> int:
        """Return the number of cases at the first check; each later check has twice as many. For a
        mean or a sigma it is so large that each of ``values`` (values of discrete distributions) is
        expected to occur at least ``min_count`` times."""
        if not self.is_moment:
            return _FIRST_LOOK
        count = _FIRST_LOOK_OF_MOMENTS
        cases_needed = max((value.cases for value in values), default=0)
        return count << max(0, math.ceil(math.log2(max(cases_needed, 1) / count)))

    def check(self, values: Sequence[RareValue], cases: int) -> None:
        """Raise InputError if the rule is on a mean or a sigma and too few ``cases`` are requested:
        one of ``values`` (values of discrete distributions) is expected to occur in them less often
        than its ``min_count``."""
        rarest = max(values, key=lambda value: value.cases, default=None)
        if self.is_moment and rarest is not None and rarest.cases > cases:
            raise InputError(
                f"until: the {self.name} cannot be estimated before {rarest.name} (probability "
                f"{rarest.probability:.3g}) occurs {rarest.min_count} times, in about "
                f"{rarest.cases:,} cases; {cases:,} are requested: set more "
                f"{option('cases')} or leave out {option('until')}"
            )

    def look(
        self, summary: _Summary, looks: int, occurred: Sequence[Occurrence], spread: float = 0.0
    ) -> InterimEstimate:
        """Return the estimate of the statistic from the cases run so far.

        Parameters
        ----------
        summary : object with ``counts`` and ``statistics``
            Statistics of the cases so far, such as `StreamingStatistics`.
        looks : int
            Largest number of checks in the run; the interval of each has the confidence with which
            all of them together are right with 95 % (`raised`).
        occurred : sequence of Occurrence
            Number of occurrences in these cases of each value of the discrete distributions.
        spread : float
            Largest difference between values of a constant outcome
            (`sepmc.analysis.constant_outcomes.max_spread`), 0 for an outcome that is not constant.
            If positive, the interval is the value plus and minus the numerical error, which is half
            of ``spread``; a sigma then has the value 0.
        """
        value, low, high = self.interval(summary, raised(CONFIDENCE, looks))
        if spread > 0.0:
            error = 0.5 * spread
            value = 0.0 if self.statistic == "sigma" else round_to_error(value, error)
            low, high = value - error, value + error
        shortfall = self._shortfall(summary, occurred, spread) if self.is_moment else ""
        return InterimEstimate(
            value, low, high, not shortfall and self.is_met(value, low, high), shortfall
        )

    def interval(
        self, summary: _Summary, confidence: float = CONFIDENCE
    ) -> tuple[float, float, float]:
        """Return the statistic and the low and high ends of its interval with the ``confidence``;
        the ends are infinite if there are too few cases. ``summary`` is as for `look`. The
        proportion of a status is that of all cases, the proportion of a yes-or-no outcome that of
        the ok cases that have it."""
        counts, table = summary.counts, summary.statistics(confidence=confidence)
        if self.metric not in table.index:
            return _proportion(counts.get(self.metric, 0), sum(counts.values()), confidence)
        row = table.loc[self.metric].astype(float).to_dict()
        n, value = round(row["n"]), row.get(self.statistic, math.nan)
        if self.statistic == "share":
            return _proportion(round(n * row["mean"]) if n else 0, n, confidence)
        if self.statistic in PERCENTILES:
            low, high = row[f"{self.statistic}_low"], row[f"{self.statistic}_high"]
        else:
            half = student_half_width(n - 1, confidence) * row[f"{self.statistic}_se"]
            low, high = value - half, value + half
        return value, *((-math.inf, math.inf) if np.isnan(high - low) else (low, high))

    def is_met(self, value: float, low: float, high: float) -> bool:
        """Return True if neither end, ``low`` or ``high``, of the interval is further from
        ``value`` than the tolerance."""
        allowed = self.tolerance * (abs(value) if self.relative else 1.0)
        return max(high - value, value - low) <= allowed

    def sentence(self, look: InterimEstimate, completed: int, cases: int) -> str:
        """Return a sentence for the user on an estimate (from the method `look`) after
        ``completed`` of ``cases`` cases; it contains ``NOT MET`` if the run may not stop yet."""
        tolerance_text = f"{100 * self.tolerance:g} %" if self.relative else f"{self.tolerance:g}"
        not_met = (
            f": NOT MET{'; ' if look.shortfall else ''}{look.shortfall}"
            if not look.sufficient
            else ""
        )
        return (
            f"after {completed} of {cases} cases the {self.name} is {look.value:.6g}, between "
            f"{look.low:.6g} and {look.high:.6g} (95 %); requested: within {tolerance_text} of "
            f"it{not_met}"
        )

    def _shortfall(self, summary: _Summary, occurred: Sequence[Occurrence], spread: float) -> str:
        """Return a sentence on the reason why the cases so far are too few to report a mean or a
        sigma; an empty string if there is none. Arguments as for `look`; with a ``spread`` above
        0, a large standard error of sigma is no reason."""
        if rare := undersampled(occurred):
            rarest = rare[-1]  # the least probable
            return (
                f"{rarest.of.name} (probability {rarest.of.probability:.3g}) occurred in "
                f"{rarest.times} of {rarest.cases} cases; {rarest.of.min_count} are required"
            )
        row = summary.statistics().loc[self.metric].astype(float).to_dict()
        n, sigma, error = round(row["n"]), row["sigma"], row["sigma_se"]
        if n < _MIN_VALUES:
            return f"{n} cases have {self.metric}; {_MIN_VALUES} are required"
        if error > _MAX_SIGMA_ERROR * sigma and not spread:
            return (
                "a few outlying cases determine sigma: its standard error is "
                f"{100.0 * error / sigma:.0f} % of it and must be at most "
                f"{100.0 * _MAX_SIGMA_ERROR:.0f} %"
            )
        return ""


def _proportion(k: int, n: int, confidence: float) -> tuple[float, float, float]:
    """Return k / n and the low and high ends of its interval; NaN and infinite ends if n is 0."""
    return (k / n, *binomial_interval(k, n, confidence)) if n else (math.nan, -math.inf, math.inf)


def parse_stopping_rule(text: str, outcomes: Collection[str]) -> StoppingRule:
    """Parse the text of a stopping rule.

    Parameters
    ----------
    text : str
        ``METRIC:TOLERANCE`` or ``METRIC.STATISTIC:TOLERANCE``; the tolerance must be > 0, and one
        that ends with % is a percentage of the statistic's absolute value. Without a statistic it
        is the mean, or the proportion for a status or a yes-or-no outcome.
    outcomes : collection of str
        Names of the outcomes of the campaign.

    Returns
    -------
    StoppingRule

    Raises
    ------
    InputError
        If the text is not of this form, or the outcome, status or statistic does not exist; the
        message names what is allowed.
    """
    name, colon, size = text.rpartition(":")
    relative = size.endswith("%")
    try:
        tolerance = float(size.removesuffix("%")) / (100.0 if relative else 1.0)
    except ValueError:
        tolerance = math.nan
    if not colon or not 0.0 < tolerance < math.inf:
        raise InputError(f"until = {text}: must be {_FORMAT}")
    metric, dot, statistic = name.partition(".")
    if metric not in outcomes and metric not in NOT_OK_LABELS:
        hint = nearest(metric, [*outcomes, *NOT_OK_LABELS])
        raise InputError(f"until = {text}: no such outcome or status as {metric!r}; {hint}")
    if metric in NOT_OK_LABELS or is_yes_or_no(metric):
        allowed = ["share"]
    else:
        allowed = ["mean", "sigma", *PERCENTILES]
    statistic = (statistic if dot else allowed[0]).replace(".", "_")
    if statistic not in allowed:
        raise InputError(
            f"until = {text}: no such statistic as {statistic!r}; allowed: {', '.join(allowed)}"
        )
    return StoppingRule(metric, statistic, tolerance, relative, text)
