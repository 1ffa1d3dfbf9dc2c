"""How well a campaign knows a statistic so far, to stop where that is enough.

A run looks after 256, 512, ... cases, for a mean or a sigma after 2,048, 4,096, ... cases. What it
states then holds with 95 % however often it looked before, as each of n looks states an interval of
1 - 0.05 / n (Bonferroni). Intervals of shares and percentiles hold whatever the distribution is.
That of a mean needs a sample that shows what decides it: every value that the file gives a
probability, and a sigma that is known itself. Coverage on fifteen problems: tests/measure_until.py.
"""

import math
from collections.abc import Collection, Sequence
from dataclasses import dataclass
from typing import NamedTuple, Protocol

import numpy as np
import pandas as pd

from sepmc.analysis.constant_outcomes import known_value
from sepmc.analysis.proportions import CONFIDENCE, interval
from sepmc.analysis.rare_values import Occurrence, Rare, seldom
from sepmc.analysis.statistics import PERCENTILES, student
from sepmc.scene.messages import InputError, nearest
from sepmc.schema import Status, is_yes_or_no
from sepmc.wording import option

_MEANT = "METRIC:TOLERANCE, as separation_speed_m_s:0.01, or upper_pitch_deg.p99:0.1, or :1%"
# Cases after which is looked first; for a mean or a sigma enough that what 0.2 % of all cases do is
# among them, with 98 %, though no file tells of it
_FIRST, _FIRST_OF_MOMENTS = 256, 2048
_FEWEST = 50  # values from which a mean or a sigma is stated
# Standard error of a sigma, as a share of it, at which an interval of the mean is believed: n is
# then at least 25 times the kurtosis less 1, and so 25 times the squared skewness (Cochran,
# Sampling Techniques, Wiley 1977, eq 2.18)
_SIGMA_KNOWN = 0.1


class _Summary(Protocol):
    @property
    def counts(self) -> dict[str, int]: ...
    def statistics(self, *, confidence: float = CONFIDENCE) -> pd.DataFrame: ...


class InterimEstimate(NamedTuple):
    """What cases so far show of a statistic: its value, both ends of its interval, whether that is
    narrow ``enough``, and a sentence on what the cases ``lack`` to state it, if anything."""

    value: float
    low: float
    high: float
    enough: bool
    lack: str


@dataclass(frozen=True)
class StoppingRule:
    """How far the ends of the 95 % interval of a statistic may be from it: of the ``statistic``
    (mean, sigma, share or a percentile) of a ``metric``, an outcome or a status, in its unit, or as
    a share of the statistic's size if ``relative``; ``text`` is what `parse_stopping_rule`
    reads."""

    metric: str
    statistic: str
    tolerance: float
    relative: bool
    text: str

    @property
    def name(self) -> str:
        """What is asked for, in words."""
        return f"{self.statistic} of {self.metric}"

    @property
    def is_moment(self) -> bool:
        """Whether it is a mean or a sigma, which values that did not occur would change."""
        return self.statistic in ("mean", "sigma")

    def first(self, values: Sequence[Rare]) -> int:
        """Cases after which is looked first; it is looked again whenever they have doubled. For a
        mean or a sigma each of the rare ``values`` is expected to have occurred often enough."""
        if not self.is_moment:
            return _FIRST
        count, needed = _FIRST_OF_MOMENTS, max((each.cases for each in values), default=0)
        return count << max(0, math.ceil(math.log2(max(needed, 1) / count)))

    def check(self, values: Sequence[Rare], cases: int) -> None:
        """Raise InputError if so many cases are not expected to show what a mean or a sigma takes:
        all the rare ``values``."""
        rarest = max(values, key=lambda each: each.cases, default=None)
        if self.is_moment and rarest is not None and rarest.cases > cases:
            raise InputError(
                f"until: the {self.name} is not known before {rarest.name} (probability "
                f"{rarest.probability:.3g}) occurred {rarest.enough} times, in about "
                f"{rarest.cases:,} cases; {cases:,} are asked for: give more "
                f"{option('cases')}, or no {option('until')}"
            )

    def look(
        self, summary: _Summary, looks: int, found: Sequence[Occurrence], within: float = 0.0
    ) -> InterimEstimate:
        """What the cases of a ``summary`` show, if there are at most so many ``looks`` at growing
        numbers of them, and rare values occurred as ``found``. Values of a constant outcome lie
        ``within`` so much of each other (`sepmc.analysis.constant_outcomes.reach`): its intervals
        are those of its numerical error."""
        value, low, high = self.known(summary, 1.0 - (1.0 - CONFIDENCE) / looks)
        if within > 0.0:
            error = 0.5 * within
            value = 0.0 if self.statistic == "sigma" else known_value(value, error)
            low, high = value - error, value + error
        lack = self._lack(summary, found, within) if self.is_moment else ""
        return InterimEstimate(value, low, high, not lack and self.is_met(value, low, high), lack)

    def known(
        self, summary: _Summary, confidence: float = CONFIDENCE
    ) -> tuple[float, float, float]:
        """The statistic, and both ends of its interval: infinite where there are too few cases."""
        counts, table = summary.counts, summary.statistics(confidence=confidence)
        if self.metric not in table.index:
            return _share(counts.get(self.metric, 0), sum(counts.values()), confidence)
        row = table.loc[self.metric].astype(float).to_dict()
        n, value = round(row["n"]), row.get(self.statistic, math.nan)
        if self.statistic == "share":
            return _share(round(n * row["mean"]) if n else 0, n, confidence)
        if self.statistic in PERCENTILES:
            low, high = row[f"{self.statistic}_low"], row[f"{self.statistic}_high"]
        else:
            half = student(n - 1, confidence) * row[f"{self.statistic}_se"]
            low, high = value - half, value + half
        return value, *((-math.inf, math.inf) if np.isnan(high - low) else (low, high))

    def is_met(self, value: float, low: float, high: float) -> bool:
        """Whether a statistic that is ``known`` so is known well enough."""
        within = self.tolerance * (abs(value) if self.relative else 1.0)
        return max(high - value, value - low) <= within

    def sentence(self, look: InterimEstimate, flown: int, cases: int) -> str:
        """What a look at the ``flown`` of so many cases showed."""
        asked = f"{100 * self.tolerance:g} %" if self.relative else f"{self.tolerance:g}"
        missed = f": NOT MET{'; ' if look.lack else ''}{look.lack}" if not look.enough else ""
        return (
            f"after {flown} of {cases} cases the {self.name} is {look.value:.6g}, between "
            f"{look.low:.6g} and {look.high:.6g} (95 %); asked: no more than {asked} from "
            f"it{missed}"
        )

    def _lack(self, summary: _Summary, found: Sequence[Occurrence], within: float) -> str:
        """What cases lack to state a mean or a sigma; empty if nothing."""
        if few := seldom(found):
            one = few[-1]  # the least probable
            return (
                f"{one.of.name} (probability {one.of.probability:.3g}) occurred in {one.times} of "
                f"{one.cases} cases, and should in {one.of.enough}"
            )
        row = summary.statistics().loc[self.metric].astype(float).to_dict()
        n, sigma, error = round(row["n"]), row["sigma"], row["sigma_se"]
        if n < _FEWEST:
            return f"{n} cases have {self.metric}, and {_FEWEST} should"
        if error > _SIGMA_KNOWN * sigma and not within:
            return (
                f"few cases far from the others decide its sigma, whose standard error is "
                f"{100.0 * error / sigma:.0f} % of it and should be {100.0 * _SIGMA_KNOWN:.0f} %"
            )
        return ""


def _share(k: int, n: int, confidence: float) -> tuple[float, float, float]:
    return (k / n, *interval(k, n, confidence)) if n else (math.nan, -math.inf, math.inf)


def parse_stopping_rule(text: str, outcomes: Collection[str]) -> StoppingRule:
    """What ``METRIC:TOLERANCE`` asks for. Raises InputError with what is allowed."""
    name, colon, size = text.rpartition(":")
    relative = size.endswith("%")
    try:
        tolerance = float(size.removesuffix("%")) / (100.0 if relative else 1.0)
    except ValueError:
        tolerance = math.nan
    if not colon or not 0.0 < tolerance < math.inf:
        raise InputError(f"until = {text}: must be {_MEANT}")
    metric, dot, statistic = name.partition(".")
    statuses = [status.label for status in Status if status is not Status.OK]
    if metric not in outcomes and metric not in statuses:
        said = nearest(metric, [*outcomes, *statuses])
        raise InputError(f"until = {text}: no such outcome or status as {metric!r}; {said}")
    if metric in statuses or is_yes_or_no(metric):
        known = ["share"]
    else:
        known = ["mean", "sigma", *PERCENTILES]
    statistic = (statistic if dot else known[0]).replace(".", "_")
    if statistic not in known:
        raise InputError(f"until = {text}: no such statistic as {statistic!r}; {', '.join(known)}")
    return StoppingRule(metric, statistic, tolerance, relative, text)
