"""Statistics of cases that pass by once, in memory that does not grow with them.

Cases are taken in grains of `ACCUMULATION_BLOCK`, counted from the first case whatever the chunks
they come in, so the result is the same bits for any chunk size. Measured: 140 ns a case for 21
outcomes and 11 audit columns on one thread; shared among two it takes longer, 200 ns.
"""

from collections.abc import Mapping, Sequence
from typing import Any, Protocol

import numpy as np
import pandas as pd

from sepmc.analysis.accumulator_state import Arrays
from sepmc.analysis.moments import GroupList, Moments
from sepmc.analysis.proportions import CONFIDENCE
from sepmc.analysis.quantile_sketch import QuantileSketch
from sepmc.analysis.requirements import (
    Errors,
    RequirementCounter,
    Verdict,
    count_cases,
    design_value,
    has_two_bounds,
    judge,
    margins,
    no_verdict_reason,
    requirement_counters,
)
from sepmc.analysis.statistics import (
    PERCENTILES,
    AuditSummary,
    Histogram,
    audit_table,
    histogram_of,
    percentile_ends,
    statistics_table,
)
from sepmc.scene.model import Requirement
from sepmc.schema import Status

ACCUMULATION_BLOCK = 16384  # 128 kB a column: three of them fit into a level 2 cache of 1 MB
MAX_NAMED = 20  # failed cases of each status that are named
_LABELS = list(dict.fromkeys(status.label for status in Status))


class _Takes(Protocol):
    def add(self, x: np.ndarray, numbers: np.ndarray) -> None:
        """Take values without NaN, shape (n,), and the numbers of their cases, rising."""


class _Counts(Protocol):
    def add(self, values: np.ndarray) -> None:
        """Take values, shape (n,), in the order of their cases."""


class _BlockCounters:
    """What counts cases, a grain at a time: by outcome ``moments``, ``sketches`` and, by
    requirement of two bounds, those of ``margins``; tallies of requirements, audits, and how cases
    ended."""

    def __init__(
        self,
        moments: Mapping[str, _Takes],
        sketches: Mapping[str, _Counts],
        margins: Mapping[str, _Counts],
        audits: Mapping[str, AuditSummary],
        requirements: Sequence[Requirement],
    ):
        self._moments, self._sketches, self._margins = moments, sketches, margins
        self.audits, self.tallies = audits, requirement_counters(requirements)
        self.by_code = np.zeros(len(Status), dtype=np.int64)
        self.failed: dict[str, list[int]] = {}

    def add(self, numbers: np.ndarray, codes: np.ndarray, columns: np.ndarray) -> None:
        """Take a grain: numbers and status codes, shape (n,), and columns, shape (k, n)."""
        counts = np.bincount(codes, minlength=len(self.by_code))
        self.by_code += counts
        ok: slice | np.ndarray = slice(None)
        if counts[Status.OK] < len(codes):
            ok = codes == Status.OK
            for code in (np.flatnonzero(counts[1:]) + 1).tolist():
                self._name(Status(code).label, numbers[codes == code])
        places = {name: k for k, name in enumerate(self._moments)}
        count_cases(
            self.tallies,
            numbers,
            codes == Status.OK,
            lambda name: columns[places[name]] if name in places else None,
            lambda name: np.isin(codes, [int(status) for status in Status if status.label == name]),
        )
        numbers = numbers[ok]
        for (name, moments), column in zip(self._moments.items(), columns, strict=False):
            x, cases = column[ok], numbers
            lost = np.isnan(x)
            if lost.any():
                x, cases = x[~lost], cases[~lost]
            moments.add(x, cases)
            self._sketches[name].add(x)
            for item in (tally.requirement for tally in self.tallies):
                if item.metric == name and item.name in self._margins:
                    self._margins[item.name].add(margins(x, item))
        for worst, column in zip(self.audits.values(), columns[len(self._moments) :], strict=True):
            worst.add(column[ok], numbers)

    def merge(self, others: "_BlockCounters") -> None:
        """Take what does not depend on grains of cases that come next."""
        self.by_code += others.by_code
        for label, numbers in others.failed.items():
            self._name(label, np.array(numbers, dtype=np.int64))
        for own, tally in zip(self.tallies, others.tallies, strict=True):
            own.merge(tally)
        for name, worst in self.audits.items():
            worst.merge(others.audits[name])

    def state(self) -> list[np.ndarray]:
        """What it holds besides what is given to it, for `restore`."""
        named = [[_LABELS.index(label), *numbers] for label, numbers in self.failed.items()]
        own = [self.by_code, [len(named)], *named]
        tallied = [array for tally in self.tallies for array in tally.state()]
        return [*(np.array(one, dtype=float) for one in own), *tallied]

    def restore(self, arrays: Arrays) -> None:
        """Hold what another one held."""
        self.by_code[:] = next(arrays)
        for _ in range(int(next(arrays)[0])):
            label, *numbers = next(arrays).astype(np.int64).tolist()
            self.failed[_LABELS[label]] = numbers
        for tally in self.tallies:
            tally.restore(arrays)

    def _name(self, label: str, numbers: np.ndarray) -> None:
        """Name cases that ended so, if not enough are named."""
        named = self.failed.setdefault(label, [])
        named += numbers[: MAX_NAMED - len(named)].tolist()


class PartialStatistics:
    """Counts whole grains of cases for a `StreamingStatistics`, which takes them: elsewhere, or
    later."""

    def __init__(self, stream: "StreamingStatistics"):
        self.groups = {name: GroupList() for name in stream.moments}
        self.sketches = {name: sketch.new_partial() for name, sketch in stream.sketches.items()}
        self.margins = {name: sketch.new_partial() for name, sketch in stream.margins.items()}
        audits = {name: worst.new_partial() for name, worst in stream.audits.items()}
        requirements = [tally.requirement for tally in stream.tallies]
        self.counters = _BlockCounters(
            self.groups, self.sketches, self.margins, audits, requirements
        )

    def add(self, numbers: np.ndarray, codes: np.ndarray, columns: np.ndarray) -> None:
        """As `StreamingStatistics.add`; the first one is that of a grain."""
        for first in range(0, len(numbers), ACCUMULATION_BLOCK):
            grain = slice(first, first + ACCUMULATION_BLOCK)
            self.counters.add(numbers[grain], codes[grain], columns[:, grain])


class StreamingStatistics:
    """Takes the cases of a campaign in their order, and gives what `TableStatistics` of
    `sepmc.analysis.row_statistics` gives: statistics, audit, histograms.

    Parameters
    ----------
    outcomes, audits : names of the columns that are added, in their order
    bounds : bound of each audit column that has one
    requirements : what verdicts are given on
    """

    def __init__(
        self,
        outcomes: Sequence[str],
        audits: Sequence[str],
        bounds: Mapping[str, float],
        requirements: Sequence[Requirement] = (),
    ):
        self.moments = {name: Moments() for name in outcomes}
        self.sketches = {name: QuantileSketch() for name in outcomes}
        self.margins = {
            item.name: QuantileSketch() for item in requirements if has_two_bounds(item)
        }
        self.audits = {name: AuditSummary(name, bounds) for name in audits}
        self._counters = _BlockCounters(
            self.moments, self.sketches, self.margins, self.audits, requirements
        )
        self.tallies, self.failed = self._counters.tallies, self._counters.failed
        self._held = np.empty((len(outcomes) + len(audits), ACCUMULATION_BLOCK))
        self._numbers, self._codes, self._filled = (
            np.empty(ACCUMULATION_BLOCK, dtype=np.int64),
            np.empty(ACCUMULATION_BLOCK, dtype=np.int64),
            0,
        )

    def new_partial(self) -> PartialStatistics:
        """What counts cases for this one to `merge`."""
        return PartialStatistics(self)

    def merge(self, others: PartialStatistics) -> None:
        """Take cases that come next, after whole grains, counted by what was made with `apart`."""
        assert self._filled == 0
        for name, moments in self.moments.items():
            for group in others.groups[name]:
                moments.merge(group)
        for name, sketch in self.sketches.items():
            sketch.merge(others.sketches[name])
        for name, sketch in self.margins.items():
            sketch.merge(others.margins[name])
        self._counters.merge(others.counters)

    def add(self, numbers: np.ndarray, codes: np.ndarray, columns: np.ndarray) -> None:
        """Take cases: their numbers and status codes, shape (n,), and columns, shape (k, n), each
        row contiguous."""
        done, count = 0, len(numbers)
        while done < count:
            if (
                self._filled == 0 and count - done >= ACCUMULATION_BLOCK
            ):  # whole grains need no copy
                self._counters.add(
                    numbers[done : done + ACCUMULATION_BLOCK],
                    codes[done : done + ACCUMULATION_BLOCK],
                    columns[:, done : done + ACCUMULATION_BLOCK],
                )
                done += ACCUMULATION_BLOCK
                continue
            part = min(ACCUMULATION_BLOCK - self._filled, count - done)
            here, there = slice(self._filled, self._filled + part), slice(done, done + part)
            self._numbers[here], self._codes[here], self._held[:, here] = (
                numbers[there],
                codes[there],
                columns[:, there],
            )
            self._filled, done = self._filled + part, done + part
            if self._filled == ACCUMULATION_BLOCK:
                self._flush()

    def state(self) -> list[np.ndarray]:
        """What it holds, for `restore`."""
        held = slice(0, self._filled)
        waiting = self._numbers[held], self._codes[held], self._held[:, held].ravel()
        own = [array for part in self._parts for array in part.state()]
        return [*(array.astype(float) for array in waiting), *own]

    def restore(self, arrays: Arrays) -> None:
        """Hold what another one held, of the same outcomes and requirements. Raises ValueError if
        that cannot be."""
        try:
            numbers, codes, columns = next(arrays), next(arrays), next(arrays)
            self._filled = len(numbers)
            held = slice(0, self._filled)
            if not np.isin(codes, np.arange(len(self._counters.by_code))).all():
                raise ValueError("what is counted has a status that is none")
            self._numbers[held], self._codes[held] = numbers, codes
            self._held[:, held] = columns.reshape(len(self._held), -1)
            for part in self._parts:
                part.restore(arrays)
        except (StopIteration, LookupError, ArithmeticError, TypeError) as error:
            raise ValueError(f"what is counted cannot be read: {error}") from None

    @property
    def _parts(self) -> list[Any]:
        counted = (self.moments, self.sketches, self.margins, self.audits)
        return [*(one for each in counted for one in each.values()), self._counters]

    def _flush(self) -> None:
        """Take what is held, a grain or the last part of one."""
        count, self._filled = self._filled, 0
        if count:
            self._counters.add(self._numbers[:count], self._codes[:count], self._held[:, :count])

    @property
    def counts(self) -> dict[str, int]:
        """Cases of each status: ok first, then the failures, most frequent first."""
        self._flush()
        failures = [
            (int(self._counters.by_code[status]), status.label)
            for status in Status
            if status != Status.OK and self._counters.by_code[status]
        ]
        ordered = {label: count for count, label in sorted(failures, key=lambda pair: -pair[0])}
        return {Status.OK.label: int(self._counters.by_code[Status.OK])} | ordered

    def statistics(
        self,
        reference: Mapping[str, Mapping[str, float]] | None = None,
        confidence: float = CONFIDENCE,
    ) -> pd.DataFrame:
        """As `sepmc.analysis.statistics.statistics`; percentiles are those of a
        `QuantileSketch`."""
        self._flush()
        percents = list(PERCENTILES.values())
        rows = [
            moments.row()
            | dict(zip(PERCENTILES, self.sketches[name].percentiles(percents), strict=True))
            | percentile_ends(moments.n, self.sketches[name].ranked, confidence)
            for name, moments in self.moments.items()
        ]
        return statistics_table(rows, list(self.moments), reference)

    def audit(self) -> pd.DataFrame:
        """As `sepmc.analysis.statistics.audit`."""
        self._flush()
        return audit_table(self.audits)

    def verdicts(
        self, errors: Errors, audit: pd.DataFrame, sampler: str = "random"
    ) -> list[Verdict]:
        """As `sepmc.analysis.row_statistics.TableStatistics.verdicts`; design values are those of a
        `QuantileSketch`."""
        why = no_verdict_reason(audit, sampler)
        return [judge(t, errors, self._design(t), why, self._lacking(t)) for t in self.tallies]

    def _lacking(self, tally: RequirementCounter) -> int:
        """How many ok cases do not have the outcome that a requirement is on."""
        known = self.moments.get(tally.requirement.metric)
        return 0 if known is None else int(self._counters.by_code[Status.OK]) - known.n

    def _design(self, tally: RequirementCounter) -> float:
        name = tally.requirement.metric
        if name not in self.moments:
            return float("nan")
        known = self.margins.get(tally.requirement.name, self.sketches[name])
        return design_value(tally, self.moments[name].n, known.ranked)

    def histogram(self, name: str) -> Histogram | None:
        """Histogram of an outcome, or None if it has no value or an infinite one."""
        self._flush()
        row = {"mean": np.nan, "sigma": np.nan} | self.moments[name].row()
        if not row["n"] or not np.isfinite(row["mean"]):
            return None
        return histogram_of(
            self.moments[name].n,
            row["mean"],
            row["sigma"],
            row["min"],
            row["max"],
            self.sketches[name].histogram,
        )
