"""Answers to the questions of the page of `sepmc studio`: runs with changed settings, with their
histograms and verdicts, a case over time, and verdicts over two values."""

import math
import threading
from collections.abc import Callable, Mapping
from concurrent.futures import Executor
from time import perf_counter
from typing import TYPE_CHECKING, Any

import msgspec
import numpy as np

from sepmc.analysis.constant_outcomes import collapse_constant
from sepmc.analysis.requirements import required_bounds
from sepmc.campaign.design_map import MapAxis, map_designs
from sepmc.campaign.run_statistics import RunStatistics, evaluate
from sepmc.engine.dispatch import check_int
from sepmc.report.page import verdict_row
from sepmc.scene.messages import Log, no_log
from sepmc.schema import Status
from sepmc.studio.sliders import (
    Slider,
    available_keys,
    changed_campaign,
    make_slider,
    moved_campaign,
)
from sepmc.wording import to_words

if TYPE_CHECKING:
    import pandas as pd

    from sepmc.campaign.campaign import Campaign
    from sepmc.campaign.result import Result

MAX_CASES = 100_000  # of an answer
_GRID = (13, 9)  # designs of a map
_MAP_S, _MAP_CASES = 4.0, 50  # time that a map may take; its fewest cases of a design
# seconds of a run on one thread: threads of a shorter one wait for each other when other programs
# run (2,000 cases of table2 on two busy cores: 0.88 s on both, 0.27 s on one)
_SHORT_S = 0.1
_DRAWN = 6  # outcomes at the start
_ROWS = 400  # of a history
_ACCURACY = 1e-5  # relative, of a history that is looked at
_STATISTICS = (
    "n", "mean", "sigma", "min", "max", "p1", "p5", "p50", "p95", "p99", "case_min", "case_max",
)  # fmt: skip


class Question(msgspec.Struct, forbid_unknown_fields=True):
    """A question of the page: positions of its sliders, and the fields that a method of `Studio`
    needs.

    Attributes
    ----------
    values, spreads : dict of str to float
        Positions of the sliders that were moved, by key: values in the unit of the key, and factors
        of spreads; see `sepmc.studio.sliders.moved_campaign`.
    cases, seed : int
        Number of cases of the run, and its seed.
    outcomes : tuple of str
        Outcomes to draw; those that the run does not have are ignored, and without any the most
        important ones are drawn.
    case : int
        Number of the case to simulate over time, from 0.
    axes : tuple of (key, low, high)
        Two design variables to map, with their ends in the unit of the key.
    key : str
        TOML path, with its unit, of the parameter that gets a slider.
    """

    values: dict[str, float] = {}
    spreads: dict[str, float] = {}
    cases: int = 2000
    seed: int = 0
    outcomes: tuple[str, ...] = ()
    case: int = 0
    axes: tuple[tuple[str, float, float], ...] = ()
    key: str = ""


class Studio:
    """Runs a campaign with other settings; its methods answer questions of the page with data that
    can be written as JSON.

    A run equals ``campaign.with_settings(settings).run(cases, seed)`` bit by bit. One run follows
    the other; histories and maps are computed in a second process meanwhile.

    Parameters
    ----------
    campaign : Campaign
    sliders : list of Slider
        Sliders at the start.
    rank : callable (campaign, statistics)
        Returns the names of the outcomes, the most important ones first; ``statistics`` has a row
        for each outcome.
    copies : callable (settings, cases, seed)
        Returns texts that make a run: ``command``, of a command line, and ``python``.
    second : Executor
        Runs functions in a second process: histories and maps.
    cases, seed : int
        Number of cases and seed at the start.
    threads : int, optional
        As for `Campaign.run`.
    """

    def __init__(
        self,
        campaign: "Campaign",
        sliders: list[Slider],
        rank: "Callable[[Campaign, pd.DataFrame], list[str]]",
        copies: Callable[[dict[str, Any], int, int], Mapping[str, str]],
        second: Executor,
        cases: int,
        seed: int,
        threads: int | None = None,
    ):
        self.campaign, self.sliders, self._rank, self._second = campaign, sliders, rank, second
        self.cases = check_int("cases", cases, 1, MAX_CASES)
        self.seed, self._threads = seed, threads
        self._copies = copies
        self.message = ""  # of the run in progress
        self._running = threading.Lock()
        self._case_s = 1.0  # seconds of a case in the last run

    def prepare(self, announce: Log) -> None:
        """Run the campaign once without changes, so that the kernel is compiled and the time of a
        case is known; ``announce`` is called with messages. The results are not kept."""
        result = self.campaign.run(self.cases, self.seed, self._threads, announce=announce)
        self._case_s = result.timing["kernel"] / self.cases

    def start(self) -> dict[str, Any]:
        """Return the values, by name, that the page is rendered with at the start: name and title
        of the campaign, number of cases, its maximum, seed, sliders, keys that can have a slider,
        and names of requirements."""
        return {
            "name": self.campaign.name,
            "title": self.campaign.file.title,
            "cases": self.cases,
            "max_cases": MAX_CASES,
            "seed": self.seed,
            "sliders": [one.as_json() for one in self.sliders],
            "keys": available_keys(self.campaign),
            "requirements": [one.name for one in self.campaign.file.requirements],
        }

    def slider(self, question: Question) -> dict[str, Any]:
        """Return a slider for the parameter ``question.key``, as its fields by name. Raises
        InputError if it cannot have one."""
        return make_slider(self.campaign, question.key).as_json()

    def run(self, question: Question) -> dict[str, Any]:
        """Run the cases of a question, at most `MAX_CASES`, with the settings of its sliders, after
        a run in progress has ended. Return, by name, the settings, the number of cases run, a text
        on each status (`_counts`), the seed, notes, whether an audit bound is exceeded in an ok
        case, verdicts (`verdict_row`), names of the outcomes, the most important one first, the
        seconds that the answer took and, for the outcomes to draw, histograms with statistics."""
        begin = perf_counter()
        campaign, settings, notes = self._changed(question)
        cases = min(question.cases, MAX_CASES)
        with self._running:
            threads = 1 if cases * self._case_s < _SHORT_S else self._threads
            result = campaign.run(cases, question.seed, threads, announce=self._announce)
            self.message = ""
            self._case_s = result.timing["kernel"] / cases
        accuracy = {"errors": result.accuracy.errors if result.accuracy else {}}
        run = evaluate(campaign, result.kept.summary, {"accuracy": accuracy})
        ranked = self._rank(campaign, run.table)
        wanted = [name for name in question.outcomes if name in run.table.index] or ranked[:_DRAWN]
        units = result.units
        return {
            "settings": settings,
            "cases": cases,
            "seed": question.seed,
            "counts": _counts(result),
            "notes": [*notes, *result.notes],
            "audit_failed": bool((run.audit["beyond"] > 0).any()),
            "verdicts": [
                {"name": v.name, **verdict_row(v, units.get(v.metric, ""))} for v in run.verdicts
            ],
            "ranked": ranked,
            "outcomes": {name: _outcome(campaign, run, name, units[name]) for name in wanted},
            "seconds": perf_counter() - begin,
        }

    def replay(self, question: Question) -> list[dict[str, Any]]:
        """Simulate the nominal case and ``question.case`` in the second process; return their
        replay data in this order, without a case that has no history (`replays_of`)."""
        campaign = self._changed(question)[0]
        work = self._second.submit(
            replays_of, campaign, question.case, question.seed, min(question.cases, MAX_CASES)
        )
        return work.result()

    def map(self, question: Question) -> dict[str, Any]:
        """Judge designs on a grid over the design variables ``question.axes``, in the second
        process; return the number of cases of each, the axes and, by requirement, the verdicts and
        fractions of violating cases (`verdicts_over`). All designs have as many cases, so that all
        together take about `_MAP_S` seconds: at least `_MAP_CASES`, but at most
        ``question.cases``."""
        campaign = self._changed(question)[0]
        axes = [MapAxis(*axis, n) for axis, n in zip(question.axes, _GRID, strict=False)]
        designs = math.prod(axis.count for axis in axes)
        most = _MAP_S / (designs * max(self._case_s, 1e-9))
        cases = min(question.cases, max(int(min(most, MAX_CASES)), _MAP_CASES))
        return self._second.submit(verdicts_over, campaign, axes, cases, question.seed).result()

    def settings(self, question: Question) -> dict[str, Any]:
        """Return the changed settings as text: ``command`` and ``python``, which run them, and
        ``toml``, the campaign file. The command and the Python text have the next seed, as these
        settings were chosen with the cases of the present one; ``toml`` keeps the seed and the
        number of cases of the file."""
        campaign, settings, _ = self._changed(question)
        cases, seed = question.cases, question.seed + 1
        return {
            **self._copies(settings, cases, seed),
            "toml": campaign.file.toml,
        }

    def _changed(self, question: Question) -> tuple["Campaign", dict[str, Any], list[str]]:
        """Return the campaign with the settings of the sliders, these settings by TOML path, and
        warnings about them. Raises InputError if a key or value is not allowed."""
        with self._running:  # warnings are caught by one thread at a time
            return moved_campaign(self.campaign, question.values, question.spreads)

    def _announce(self, text: str) -> None:
        self.message = text


def _counts(result: "Result") -> list[str]:
    """Return a text for each status that occurred: its number of cases, its label and, unless it is
    ok, its meaning and remedy."""
    sentences = {status.label: status.sentence for status in Status}
    return [
        f"{count:,} {label}" + ("" if label == Status.OK.label else f": {sentences[label]}")
        for label, count in result.status_counts.items()
    ]


def _outcome(campaign: "Campaign", run: RunStatistics, name: str, unit: str) -> dict[str, Any]:
    """Return title, unit (empty without one), required bounds, histogram and statistics of an
    outcome, as data for the page. Edges and counts are empty if there is no histogram; a statistic
    that is not finite is None."""
    histogram = collapse_constant(run.summary.histogram(name), run.table, name)
    words = to_words(name, unit)
    return {
        "title": words if unit == "1" else f"{words} ({unit})",
        "unit": "" if unit == "1" else unit,
        "bounds": required_bounds(campaign.file.requirements).get(name, []),
        "edges": [] if histogram is None else histogram.edges.tolist(),
        "counts": [] if histogram is None else histogram.counts.tolist(),
    } | {key: _number(run.table.at[name, key]) for key in _STATISTICS}


def _number(x: Any) -> float | None:
    """Return a number for JSON; None if it is not finite."""
    return float(x) if np.isfinite(x) else None


def replays_of(campaign: "Campaign", number: int, seed: int, total: int) -> list[dict[str, Any]]:
    """Simulate the nominal case and case ``number`` (from 0) of a sample of ``total`` cases with a
    ``seed``, at an accuracy of `_ACCURACY` if the file asks for a finer one; return their replay
    data, without cases that have no history. Called in a second process."""
    from sepmc.report.replay_data import replay_data  # noqa: PLC0415  (matplotlib)

    if campaign.scene.solver.step is None and campaign.scene.solver.accuracy < _ACCURACY:
        campaign = changed_campaign(campaign, {"solver.accuracy": _ACCURACY})[0]
    every_s = campaign.scene.run.end_time / _ROWS
    data: list[dict[str, Any]] = []
    for title, own, case in (
        ("nominal case", None, campaign.nominal()),
        (f"case {number}", number, campaign.case(number, seed, total)),
    ):
        history = campaign.simulate(case, every_s, no_log)
        if len(history):
            data.append(replay_data(history, case.scene, title, own))
    return data


def verdicts_over(
    campaign: "Campaign", axes: list[MapAxis], cases: int, seed: int
) -> dict[str, Any]:
    """Judge the designs of a grid over one or two design variables. Return the number of cases of
    each design, the axes and, by requirement, the verdicts and the fractions of violating cases as
    nested lists: one inner list, over the first axis, for each value of the second one (a single
    list with one axis). Called in a second process. Raises InputError if the campaign has no
    requirement, its cases are not random, both axes vary the same key, or the designs cannot share
    a kernel."""
    designs = map_designs(campaign, axes, cases, seed, announce=no_log)
    return {
        "cases": cases,
        "axes": [{"key": axis.key, "values": axis.values.tolist()} for axis in axes],
        "requirements": {
            item.name: {
                "verdicts": designs.grid(item.name).tolist(),
                "fractions": (designs.grid(f"{item.name}_violations") / cases).tolist(),
            }
            for item in campaign.file.requirements
        },
    }


def as_json(data: Mapping[str, Any] | list[Any]) -> bytes:
    """Return an answer as JSON, encoded in UTF-8; NaN and infinity become null."""
    return msgspec.json.encode(data)
