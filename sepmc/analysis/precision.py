"""How well a campaign knows a statistic so far, to stop where that is enough."""

import math
from collections.abc import Collection
from dataclasses import dataclass
from typing import Protocol

import numpy as np
import pandas as pd

from sepmc.analysis.proportions import interval
from sepmc.analysis.statistics import PERCENTILES, student
from sepmc.scene.messages import InputError, nearest
from sepmc.schema import Status, is_yes_or_no

_MEANT = "METRIC:TOLERANCE, as separation_speed_m_s:0.01, or upper_pitch_deg.p99:0.1, or :1%"


class _Summary(Protocol):
    @property
    def counts(self) -> dict[str, int]: ...
    def statistics(self) -> pd.DataFrame: ...


@dataclass(frozen=True)
class Until:
    """How far the ends of the 95 % interval of a statistic may be from it: of the ``statistic``
    (mean, sigma, share or a percentile) of a ``metric``, an outcome or a status, in its unit, or as
    a share of the statistic's size if ``relative``."""

    metric: str
    statistic: str
    tolerance: float
    relative: bool

    @property
    def name(self) -> str:
        """What is asked for, in words."""
        return f"{self.statistic} of {self.metric}"

    def known(self, summary: _Summary) -> tuple[float, float, float]:
        """The statistic, and both ends of its 95 % interval: infinite where there are too few
        cases."""
        counts, table = summary.counts, summary.statistics()
        if self.metric not in table.index:
            return _share(counts.get(self.metric, 0), sum(counts.values()))
        row = table.loc[self.metric].astype(float).to_dict()
        if self.statistic == "share":
            return _share(round(row["n"] * row["mean"]) if row["n"] else 0, round(row["n"]))
        value = row[self.statistic]
        if self.statistic in PERCENTILES:
            low, high = row[f"{self.statistic}_low"], row[f"{self.statistic}_high"]
        else:
            half = student(row["n"] - 1) * row[f"{self.statistic}_se"]
            low, high = value - half, value + half
        return value, *((-math.inf, math.inf) if np.isnan(high - low) else (low, high))

    def is_met(self, value: float, low: float, high: float) -> bool:
        """Whether a statistic that is ``known`` so is known well enough."""
        within = self.tolerance * (abs(value) if self.relative else 1.0)
        return max(high - value, value - low) <= within


def _share(k: int, n: int) -> tuple[float, float, float]:
    return (k / n, *interval(k, n)) if n else (math.nan, -math.inf, math.inf)


def read_until(text: str, outcomes: Collection[str]) -> Until:
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
    return Until(metric, statistic, tolerance, relative)
