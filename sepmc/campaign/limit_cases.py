"""Limit cases: every dispersed input at its low and high end, one at a time with the others
nominal, and the combination of ends found worst for each requirement.

The ends are those of the distribution; a normal one ends at 3 sigma (0.135 and 99.865 %) or at its
truncation, whichever is nearer. A wide angle, one that varies by more than a quarter turn, is also
simulated at 7 values between its ends. A combination has each input at its low end, nominal value
or high end, a wide angle also at a value between. It is searched for by changing one input at a
time, always the one with the largest loss of margin, from several starts: each input at the end
that is worst by itself, the worst of some random corners, and the nominal case. Combinations that
the search misses may be worse. A case without the outcome is the worst of all: if the search ends
in one, the worst combination that has the outcome is a further case. Correlations are ignored: a
combination may be one that hardly ever occurs.

A level is an integer that stands for a value of an input: -1 its low end, 0 nominal, 1 its high
end, 2 to 8 values between the ends of a wide angle. Levels (d,) of all d inputs make a case.
"""

import math
from collections.abc import Callable
from dataclasses import dataclass
from functools import cached_property
from typing import TYPE_CHECKING

import numpy as np
import pandas as pd

from sepmc.analysis.requirements import margins
from sepmc.campaign.execution.integration import integrate
from sepmc.campaign.execution.step_selection import select_steps
from sepmc.engine.dispatch import check_threads, using_threads
from sepmc.scene import parameters
from sepmc.scene.dispersion import Dispersion
from sepmc.scene.messages import InputError, Log
from sepmc.scene.model import VIOLATION, Requirement
from sepmc.scene.units import UNITS
from sepmc.schema import STATUS_LABELS, Status

if TYPE_CHECKING:
    from sepmc.campaign.campaign import Campaign

Score = Callable[[np.ndarray], np.ndarray]  # of levels (n, d)

MET, VIOLATED, UNKNOWN = "met", "violated", "no outcome"
NOMINAL, WORST = "nominal", "worst of "
_WIDE_ANGLE = 0.5 * math.pi  # an angle with a wider range can have extremes anywhere
_SIGMAS = 3.0  # ends of a normal distribution
_BETWEEN = 7  # values between the ends of a wide angle
_CORNERS, _STARTS = 64, 4  # random corners, and the worst of them, which are starts
_ROUNDS = 200  # changes from a start, at most


@dataclass(frozen=True)
class LimitCases:
    """Limit cases of a campaign.

    Attributes
    ----------
    table : DataFrame
        A row per case: ``case``, ``limit`` (name of the limit case), ``low`` and ``high`` (keys of
        the inputs at these ends), ``between`` (angles between their ends), the inputs by column,
        ``status``, and of each requirement ``NAME`` (met, violated or no outcome), ``NAME_outcome``
        and ``NAME_margin`` (negative if violated; NaN for a requirement on a status). The table can
        be used as ``run.samples``.
    requirements : tuple of Requirement
        Requirements that the table judges: all but those on a violation of any other one.
    """

    table: pd.DataFrame
    requirements: tuple[Requirement, ...]


def limit_ends(dispersion: Dispersion) -> tuple[float, float]:
    """Return the low and the high end of a dispersed input, in the unit of its key: 3 sigma or the
    truncation, if nearer, for a normal distribution, else the smallest and largest value that can
    occur."""
    numbers = dispersion.numbers
    if dispersion.distribution == "normal":
        mean, sigma, cut = numbers
        width = min(_SIGMAS, cut) * sigma
        return mean - width, mean + width
    if dispersion.distribution == "discrete" and dispersion.weights:
        numbers = tuple(x for x, w in zip(numbers, dispersion.weights, strict=True) if w > 0.0)
    return min(numbers), max(numbers)


def limit_cases(
    campaign: "Campaign", threads: int | None = None, announce: Log | None = None
) -> LimitCases:
    """Simulate the limit cases of a campaign, and judge them by its requirements.

    Parameters
    ----------
    campaign : Campaign
    threads : int, optional
        Number of threads; all cores if None.
    announce : callable (text), optional
        Called with messages, such as on the compilation of a kernel.

    Returns
    -------
    LimitCases

    Raises
    ------
    InputError
        If the campaign has no requirement (other than on a violation of any other one), or no
        input that varies.
    """
    items = tuple(item for item in campaign.file.requirements if item.metric != VIOLATION)
    if not items:
        raise InputError(
            f"{campaign.name}: limit cases are judged by requirements: give [[requirement]]"
        )
    search = _LimitSearch(campaign, items, check_threads(threads), announce)
    if not search.varied:
        raise InputError(
            f"{campaign.name}: no input has two ends, low and high: give [dispersion] a "
            "distribution with a width"
        )
    names = [NOMINAL, *(search.text(level, k) for k in search.varied for level in search.ends(k))]
    levels = np.vstack([search.nominal, search.single])
    worst = [search.worst(item) for item in items]
    names += [f"{WORST}{item.name}" for item in items]
    for item, row in zip(items, list(worst), strict=True):
        if search.lacks(item, row):
            with_value = search.worst(item, with_value=True)
            if not search.lacks(item, with_value):
                names.append(f"{WORST}{item.name} with an outcome")
                worst.append(with_value)
    return LimitCases(search.table(names, np.vstack([levels, *worst])), items)


class _LimitSearch:
    """Simulates and judges cases, each combination of levels once.

    A case is given by a level for each of the d dispersed inputs: -1 its low end, 0 nominal (the
    middle of the ends if the nominal value lies outside them), 1 its high end, 2 to 8 values
    between the ends of a wide angle. ``items`` are the requirements.
    """

    def __init__(
        self,
        campaign: "Campaign",
        items: tuple[Requirement, ...],
        threads: int | None,
        announce: Log | None,
    ):
        self.campaign, self.items, self.threads = campaign, items, threads
        dispersions = campaign.file.dispersions
        ends = np.array([limit_ends(one) for one in dispersions]).reshape(-1, 2)
        nominal = np.array(
            [
                parameters.value(campaign.scene, one.parameter.path) / one.parameter.factor
                for one in dispersions
            ]
        )
        outside = (nominal < ends[:, 0]) | (nominal > ends[:, 1])
        middle = np.where(outside, ends.mean(axis=1), nominal)
        # values of each input: level k is in column k + 1
        between = np.linspace(ends[:, 0], ends[:, 1], _BETWEEN + 2, axis=1)[:, 1:-1]
        self.values = np.column_stack([ends[:, 0], middle, ends[:, 1], between])
        self.varied = [k for k, (low, high) in enumerate(ends) if low < high]
        # a failure is no end of a tolerance: it stays out of combinations
        self.combined = [
            k for k in self.varied if not dispersions[k].parameter.path.endswith(".fails")
        ]
        with using_threads(threads):
            self.integration = select_steps(campaign, announce=announce)
        self.columns = [column.name for column in campaign.result_columns]
        self.results: dict[bytes, tuple[int, np.ndarray]] = {}  # status and outcomes by levels

    @property
    def nominal(self) -> np.ndarray:
        """Levels (d,) of the nominal case: 0 for every input, its nominal value or, if that lies
        outside the ends of the input, their middle."""
        return np.zeros(len(self.values), dtype=int)

    @cached_property
    def single(self) -> np.ndarray:
        """Levels (n, d) of the n cases in which one varied input is at one of the levels `ends`
        (low, high and, for a wide angle, seven between) and all other inputs are at 0, nominal.
        Levels are codes, -1 to 8, not values."""
        rows = [self._changed(self.nominal, k, to) for k in self.varied for to in self.ends(k)]
        return np.array(rows)

    def ends(self, k: int) -> tuple[int, ...]:
        """Return the levels of input ``k`` other than 0, nominal: -1 and 1, its low and high end;
        for a wide angle also 2 to 8, values between the ends."""
        parameter = self.campaign.file.dispersions[k].parameter
        width = (self.values[k, 2] - self.values[k, 0]) * parameter.factor
        is_wide = parameter.unit in UNITS["angle"] and width > _WIDE_ANGLE
        return (-1, 1, *range(2, 2 + _BETWEEN)) if is_wide else (-1, 1)

    def text(self, level: int, k: int) -> str:
        """Return text for input ``k`` at a level: its key, then "low" (level -1), "high" (level
        1), or at any other level ``= VALUE`` in the unit of the key."""
        key = self.campaign.file.dispersions[k].parameter.key
        words = {-1: "low", 1: "high"}
        return f"{key} {words.get(level) or f'= {self.values[k, level + 1]:.6g}'}"

    @staticmethod
    def _changed(levels: np.ndarray, k: int, to: int) -> np.ndarray:
        """Return a copy of levels (d,), codes from -1 to 8 (`_LimitSearch`), in which input ``k``
        has level ``to``."""
        changed = levels.copy()
        changed[k] = to
        return changed

    def inputs(self, levels: np.ndarray) -> np.ndarray:
        """Return the values of the inputs (n, d), in the units of their keys, of n cases given by
        levels (n, d): -1 low end, 0 nominal, 1 high end, 2 to 8 between the ends."""
        return self.values[np.arange(len(self.values)), levels + 1]

    def run(self, levels: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Return status (n,) and results (n, o), outcomes and audit columns in their units, of the
        cases with levels (n, d), -1 to 8 as in `_LimitSearch`. Only cases that were not simulated
        before are simulated."""
        keys = [row.tobytes() for row in levels]
        new = {key: row for key, row in zip(keys, levels, strict=True) if key not in self.results}
        if new:
            inputs = self.inputs(np.array(list(new.values())))
            with using_threads(self.threads):
                block = integrate(self.campaign, self.integration, self.campaign.in_si(inputs))
            scales = np.array([column.scale for column in self.campaign.result_columns])
            outcomes = block.outcomes[:, : len(scales)] * scales
            for key, status, row in zip(new, block.status, outcomes, strict=True):
                self.results[key] = int(status), row
        rows = [self.results[key] for key in keys]
        return np.array([status for status, _ in rows]), np.array([row for _, row in rows])

    def judge(
        self, item: Requirement, status: np.ndarray, outcomes: np.ndarray
    ) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Judge n cases by the requirement ``item``; ``status`` (n,) and ``outcomes`` (n, o), in
        the units of their columns, are those of `run`.

        Returns outcome, margin and score, each (n,), in the unit of the outcome. Outcome and margin
        are NaN in a case without a result: one that is not ok, or does not have the outcome; for a
        requirement on a status they are NaN in all cases. The score is the margin; for a
        requirement on a status it is -1 in a case with that status, 1 in an ok case. It is negative
        in a violating case, and minus infinity in one without a result.
        """
        is_ok = status == Status.OK
        if item.metric not in self.columns:
            violates = status == STATUS_LABELS.index(item.metric)
            score = np.where(violates, -1.0, np.where(is_ok, 1.0, -math.inf))
            nothing = np.full(len(status), np.nan)
            return nothing, nothing, score
        values = np.where(is_ok, outcomes[:, self.columns.index(item.metric)], np.nan)
        margin = margins(values, item)
        return values, margin, np.where(np.isnan(margin), -math.inf, margin)

    def lacks(self, item: Requirement, levels: np.ndarray) -> bool:
        """Return True if the case with levels (d,), -1 to 8 as in `_LimitSearch`, has no result for
        the requirement ``item``. On an outcome: the case is not ok, or does not have the outcome.
        On a status: the case has neither that status nor ok. It is simulated if it was not yet."""
        return bool(np.isneginf(self.judge(item, *self.run(levels[None]))[2][0]))

    def worst(self, item: Requirement, with_value: bool = False) -> np.ndarray:
        """Search for the combination of levels that is worst for the requirement ``item``, the one
        with the lowest score of `judge`; return its levels (d,), as `inputs` takes them.

        A case without a result is the worst of all, or, if ``with_value``, the best. Not all
        combinations are tried: the search starts from the nominal case, from the worst levels of
        the single inputs together, and from the lowest of some random corners, and changes one
        input at a time. An input ``fails`` of a joint stays nominal."""

        def score(levels: np.ndarray) -> np.ndarray:
            scores = self.judge(item, *self.run(levels))[2]
            return np.where(np.isneginf(scores), math.inf, scores) if with_value else scores

        random = np.random.Generator(np.random.Philox(key=22))
        corners = np.tile(self.nominal, (_CORNERS, 1))
        alone, scores = self.nominal, score(self.single)
        for k in self.combined:
            corners[:, k] = random.choice(self.ends(k), _CORNERS)
            mine = np.flatnonzero(self.single[:, k])
            lowest = mine[scores[mine].argmin()]
            if scores[lowest] < score(self.nominal[None])[0]:
                alone = self._changed(alone, k, self.single[lowest, k])
        lowest_corners = corners[np.argsort(score(corners), kind="stable")[:_STARTS]]
        starts = [alone, *lowest_corners, self.nominal]
        combinations = np.array([self._descend(start, score) for start in starts])
        return np.asarray(combinations[score(combinations).argmin()])

    def _descend(self, levels: np.ndarray, score: Score) -> np.ndarray:
        """From a case with levels (d,), change the level of one input at a time, always the change
        that lowers its ``score`` most, until none does or `_ROUNDS` changes were made; return the
        levels (d,) reached. ``score`` gives the scores (n,) of cases with levels (n, d). An input
        ``fails`` of a joint keeps its level."""
        lowest = score(levels[None])[0]
        for _ in range(_ROUNDS):
            near = [
                self._changed(levels, k, to)
                for k in self.combined
                for to in (0, *self.ends(k))
                if to != levels[k]
            ]
            scores = score(np.array(near)) if near else np.array([math.inf])
            if not scores.min() < lowest:
                break
            lowest, levels = scores.min(), near[int(scores.argmin())]
        return levels

    def table(self, names: list[str], levels: np.ndarray) -> pd.DataFrame:
        """Return `LimitCases.table` for n cases: their names, and their levels (n, d), as `inputs`
        takes them. Cases that were not simulated before are simulated."""
        dispersions = self.campaign.file.dispersions
        keys = np.array([one.parameter.key for one in dispersions], dtype=object)
        status, outcomes = self.run(levels)
        columns: dict[str, object] = {"case": np.arange(len(names)), "limit": names}
        for word, level in (("low", -1), ("high", 1)):
            columns[word] = ["; ".join(keys[row == level]) for row in levels]
        columns["between"] = [
            "; ".join(self.text(row[k], k) for k in np.flatnonzero(row > 1).tolist())
            for row in levels
        ]
        names_of_inputs = [column.name for column in self.campaign.input_columns]
        columns |= dict(zip(names_of_inputs, self.inputs(levels).T, strict=True))
        columns["status"] = [STATUS_LABELS[code] for code in status]
        for item in self.items:
            values, margin, score = self.judge(item, status, outcomes)
            verdict = np.where(score >= 0.0, MET, np.where(np.isneginf(score), UNKNOWN, VIOLATED))
            columns |= {item.name: verdict, f"{item.name}_outcome": values}
            columns[f"{item.name}_margin"] = margin
        return pd.DataFrame(columns)
