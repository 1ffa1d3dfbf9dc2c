"""Choice and drawing of the figures of a run. Heavy modules are imported at use."""

import gc
import math
import os
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from functools import partial
from importlib import import_module
from pathlib import Path
from typing import TYPE_CHECKING, Any

from sepmc.cli.render import show
from sepmc.schema import is_yes_or_no

if TYPE_CHECKING:
    from concurrent.futures import Executor

    import pandas as pd

    from sepmc.analysis.requirements import Verdict
    from sepmc.analysis.row_statistics import TableStatistics
    from sepmc.analysis.stored_statistics import StoredStatistics
    from sepmc.analysis.streaming import StreamingStatistics
    from sepmc.campaign.campaign import Campaign
    from sepmc.scene.messages import Log

_DRAWN = 12  # outcomes with a histogram by default: a review reads no hundred of them
# cases whose histories are drawn as bands: the first ones of a larger run, to bound memory
_BANDED = 20_000
# outcomes whose mean and sigma are drawn over the number of cases: alone, and in a report
_CONVERGING, _CONVERGING_IN_REPORT = 4, 2
_INTERESTING = (
    "clearance_mm",
    "transverse_rate",
    "tip_off",
    "_angle_",
    "_from_",
    "separation_distance",
    "separation_speed",
    "release_time",
    "peak_force_N",
    "jam_friction",
)
# outcomes of observation events, and the kind by which they rank
_EVENT_KINDS = (
    ("_transverse_rate_", "transverse_rate"),
    ("_omega_", "tip_off"),
    ("_clearance_mm", "separation_distance"),
)


@contextmanager
def drawing_process(wanted: bool) -> "Iterator[Executor | None]":
    """Context manager: yield an executor of one process, which imports the drawing modules
    meanwhile; yield None if it is not ``wanted`` or there is only one core."""
    if not wanted or (os.cpu_count() or 1) == 1:
        yield None
        return
    from sepmc.processes import processes

    with processes(1) as pool:
        pool.submit(_prepare)
        yield pool


def _prepare() -> None:
    """Import the drawing modules. Later garbage collections leave out what they made: one would
    take 0.1 s."""
    import_module("sepmc.report.figures")
    gc.freeze()


def draw_figures(*arguments: Any, **options: Any) -> list[Path]:
    """Draw the figures of a run; return the files written. Arguments are those of
    `start_figures`."""
    return start_figures(*arguments, **options)()


def start_figures(
    folder: Path,
    campaign: "Campaign",
    summary: "TableStatistics | StreamingStatistics | StoredStatistics",
    table: "pd.DataFrame | None" = None,
    verdicts: "Sequence[Verdict]" = (),
    *,
    log: "Log" = show,
    every: bool = False,
    separate: bool = False,
    converging: bool = False,
    page: Path | None = None,
    suffix: str = ".png",
    second: "Executor | None" = None,
) -> Callable[[], list[Path]]:
    """Start to draw the figures of a run: bands of histories, cases beyond requirements,
    convergence of means, and histograms.

    Parameters
    ----------
    folder : Path
        Run folder.
    campaign : Campaign
    summary : TableStatistics, StreamingStatistics or StoredStatistics
        Source of the histograms.
    table : DataFrame, optional
        Statistics with numerical errors; default those of ``summary``.
    verdicts : sequence of Verdict
        Verdicts on requirements, whose figure is drawn if there are any.
    log : callable (text)
        Called with a message if not all histograms are drawn.
    every : bool
        Draw a histogram of every outcome; otherwise of the first twelve by rank.
    separate : bool
        Draw each histogram in a file of its own, too.
    converging : bool
        Draw how means converge.
    page : Path, optional
        Folder for the figures of a report, as SVG, instead of the run folder.
    suffix : str
        Ending of the files, which gives their format; not used with ``page``.
    second : Executor, optional
        Process that draws the histograms while this one draws the rest.

    Returns
    -------
    callable () -> list of Path
        Draws what the second process does not, waits for that, and returns the files written.
    """
    from sepmc.analysis.constant_outcomes import collapse_constant, constant_value, is_constant
    from sepmc.analysis.requirements import required_bounds

    units = {column.name: column.unit for column in campaign.outcome_columns}
    table = summary.statistics() if table is None else table
    about, into, suffix = run_title(folder), page or folder, ".svg" if page else suffix
    outcomes = ranked_outcomes(campaign, table)
    count = 0 if not converging else _CONVERGING_IN_REPORT if page else _CONVERGING
    converged = [name for name in outcomes if not is_constant(table, name)][:count]
    if len(outcomes) > _DRAWN and not every:
        log(f"histograms of the first {_DRAWN} outcomes; of all: sepmc plot {folder} --all")
        outcomes = outcomes[:_DRAWN]
    histograms = partial(
        _draw_histograms,
        {name: collapse_constant(summary.histogram(name), table, name) for name in outcomes},
        into,
        units,
        campaign.reference,
        source=campaign.file.reference.source if campaign.file.reference else "reference",
        required=required_bounds(campaign.file.requirements),
        about=about,
        suffix=suffix,
        alone=separate,
    )
    drawn = submitted(histograms, second)
    constants = {name: constant_value(table, name) for name in outcomes if is_constant(table, name)}

    def finish() -> list[Path]:
        written = _draw_bands(folder, into, units, about, suffix)
        written += draw_fractions(folder, campaign, verdicts, converged, into, suffix, constants)
        return written + drawn()

    return finish


def clearance_bounds(campaign: "Campaign") -> dict[str, list[float]]:
    """Return, by outcome, the list of all its required bounds; for a requirement on recontact, the
    bound 0 of the clearance in mm is added. For figures of clearances over time."""
    from sepmc.analysis.requirements import required_bounds

    bounds = required_bounds(campaign.file.requirements)
    for name in [name for name in bounds if name.endswith("_recontact")]:
        clearance = name.removesuffix("_recontact") + "_clearance_mm"
        bounds[clearance] = [*bounds.get(clearance, []), 0.0]
    return bounds


def event_times(history: Mapping[Any, Any]) -> dict[str, float]:
    """Return the times (s) of the releases and events that occurred, by their label in figures;
    ``history`` is the ``attrs`` of a history table or the manifest of a single case."""
    releases = {f"release of {joint}": t for joint, t in history.get("releases", {}).items()}
    for name, t in history.get("partial_releases", {}).items():
        joint, _, kind = name.partition(".")
        releases[f"release of {joint} to {kind}"] = t
    times = {**releases, **history.get("events", {})}
    return {name: float(t) for name, t in times.items() if t is not None and math.isfinite(t)}


def submitted(work: Callable[[], Any], second: "Executor | None") -> Callable[[], Any]:
    """Start ``work`` in a second process, and return a function that waits for its result and
    returns it. Without a process, or if it has died (BrokenExecutor), that function does the work
    itself when it is called."""
    if second is None:
        return work
    from concurrent.futures import BrokenExecutor

    try:
        future = second.submit(work)
    except BrokenExecutor:
        return work

    def result() -> Any:
        try:
            return future.result()
        except BrokenExecutor:
            return work()

    return result


def _draw_histograms(*arguments: Any, **options: Any) -> list[Path]:
    """Call `sepmc.report.figures.histogram_figures`, which is imported in the process that draws;
    returns the files written."""
    from sepmc.report.figures import histogram_figures

    return histogram_figures(*arguments, **options)


def _draw_bands(
    folder: Path, into: Path, units: dict[str, str], about: str, suffix: str
) -> list[Path]:
    """Draw percentile bands of the histories of the ok cases among the first `_BANDED` cases that a
    run folder stores, into the folder ``into``; returns the files written, none without histories.
    ``units`` has the unit of each outcome by name, ``about`` is the title of the figures,
    ``suffix`` the ending of the files."""
    from sepmc.campaign.store import shards

    below = shards.case_after(folder, _BANDED)
    histories = shards.read_histories(folder, below)
    if histories is None:
        return []
    from sepmc.report.figures import band_figures

    frame = shards.read_cases(folder, below, ["case", "status"])
    ok = histories["case"].isin(frame["case"][frame["status"] == "ok"])
    return band_figures(histories[ok], into, units, about=about, suffix=suffix)


def draw_fractions(
    folder: Path,
    campaign: "Campaign",
    verdicts: "Sequence[Verdict]",
    converged: "Sequence[str]",
    into: Path,
    suffix: str,
    constants: Mapping[str, float],
) -> list[Path]:
    """Draw the fraction of cases beyond each value of the required outcomes, and how the means of
    the outcomes ``converged`` converge with the number of cases.

    The required outcomes are those of the ``verdicts``, without outcomes that are yes or no or that
    no case has. Only ok cases count in the means; a run without case rows has no figures.
    ``constants`` has the values of constant outcomes, by name, ``suffix`` is the ending of the
    files. Returns the files written into the folder ``into``.
    """
    import numpy as np

    from sepmc.analysis.statistics import column, ok_rows
    from sepmc.campaign.store import manifests, shards
    from sepmc.report.convergence_figures import convergence_figure, exceedance_figure

    required = [v.metric for v in verdicts if v.worst is not None and not is_yes_or_no(v.metric)]
    manifest = manifests.read_manifest(folder)
    if manifest.get("stats_only") or not (required or converged):
        return []
    cases, values = shards.CaseColumns(folder), {}
    ok = ok_rows(cases)
    for name in dict.fromkeys([*required, *converged]):
        x = np.where(ok, column(cases, name), np.nan)
        values[name] = np.where(np.isnan(x), x, constants[name]) if name in constants else x
    units, about = {c.name: c.unit for c in campaign.outcome_columns}, run_title(folder)
    written = []
    if required:
        beyond = {name: values[name] for name in required}
        written.append(exceedance_figure(beyond, verdicts, into, units, about, suffix))
    known = {name: values[name][np.isfinite(values[name])] for name in converged}
    if drawn := {name: x for name, x in known.items() if len(x) > 1}:
        title = "\n".join([about, *manifest.get("rarely_drawn", ())])
        written.append(convergence_figure(drawn, into, units, title, suffix))
    return written


def run_title(folder: Path) -> str:
    """Return the title of figures of the run in a folder: campaign, number of cases, seed and the
    settings of the run (`sepmc.campaign.label.of_run`)."""
    from sepmc.campaign.label import of_run
    from sepmc.campaign.store import manifests

    return of_run(manifests.read_manifest(folder))


def ranked_outcomes(campaign: "Campaign", table: "pd.DataFrame") -> list[str]:
    """Return names of outcomes, the most important for a review first.

    Required outcomes come first. If the campaign has reference values, those with a reference
    follow; otherwise those that vary by more than their numerical error: formulas of the file, then
    the others by kind, without outcomes whose statistics equal those of an earlier one. Outcomes
    that are yes or no are left out.
    """
    from sepmc.analysis.constant_outcomes import is_constant

    names = [str(name) for name in table.index if not is_yes_or_no(str(name))]
    required = [item.metric for item in campaign.file.requirements if item.metric in names]
    if campaign.reference:
        others = [name for name in campaign.reference if name in names]
    else:
        varied = [name for name in names if table.at[name, "n"] and not is_constant(table, name)]
        events = tuple(f"{event.name}_" for event in campaign.scene.event)
        formulas = len(campaign.scene.outcome)
        own = [column.name for column in campaign.outcome_columns[-formulas:] if formulas]
        ranked = sorted(varied, key=lambda name: (name not in own, _rank(name, events)))
        others = _distinct([*required, *ranked], table)
    return list(dict.fromkeys([*required, *others]))


def _distinct(names: list[str], table: "pd.DataFrame") -> list[str]:
    """Return the names without those whose mean, sigma, minimum and maximum equal, to seven digits,
    those of an earlier name, such as the rates of two bodies that move as one."""
    first: dict[tuple[str, ...], str] = {}
    for name in names:
        row = table.loc[name].astype(float)
        key = tuple(f"{row[column]:.7g}" for column in ("mean", "sigma", "min", "max"))
        first.setdefault(key, name)
    return list(first.values())


def _rank(outcome: str, events: tuple[str, ...]) -> float:
    """Return the rank of an outcome by the kind that its name shows; lower is more important.
    Transverse rates, rates and clearances at observation events, whose names begin with one of the
    prefixes ``events``, come just before all transverse rates, tip-off rates and separation
    distances, respectively."""
    if outcome.startswith(events):
        for part, kind in _EVENT_KINDS:
            if part in outcome:
                return _INTERESTING.index(kind) - 0.5
    return next(
        (rank for rank, part in enumerate(_INTERESTING) if part in outcome), len(_INTERESTING)
    )
