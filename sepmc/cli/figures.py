"""Which figures a run gets, and of which outcomes. Nothing heavy is imported until it is needed."""

import math
import os
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from functools import partial
from importlib import import_module
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from sepmc.schema import is_yes_or_no

if TYPE_CHECKING:
    from concurrent.futures import Executor

    import pandas as pd

    from sepmc.analysis.requirements import Verdict
    from sepmc.analysis.row_statistics import TableStatistics
    from sepmc.analysis.stored_statistics import StoredStatistics
    from sepmc.analysis.streaming import StreamingStatistics
    from sepmc.campaign.campaign import Campaign


@contextmanager
def drawing_beside(wanted: bool) -> "Iterator[Executor | None]":
    """A second process that is ready to draw figures when they are asked for, if they are
    ``wanted`` and there is a core for it: to get ready takes it a second."""
    if not wanted or (os.cpu_count() or 1) == 1:
        yield None
        return
    from sepmc.processes import processes

    with processes(1) as pool:
        pool.submit(import_module, "sepmc.report.figures")
        yield pool


_DRAWN = 12  # outcomes, the first by rank: a review reads no hundred histograms
# cases whose histories are drawn as bands: the first ones of a larger run, so that it need not fit
# into memory
_BANDED = 20_000


def draw_figures(
    folder: Path,
    loaded: "Campaign",
    summary: "TableStatistics | StreamingStatistics | StoredStatistics",
    table: "pd.DataFrame | None" = None,
    every: bool = False,
    say: Callable[[str], None] = click.echo,
    page: Path | None = None,
    verdicts: "Sequence[Verdict]" = (),
    converging: bool = False,
    suffix: str = ".png",
    second: "Executor | None" = None,
    alone: bool = False,
) -> list[Path]:
    """Draw bands of stored histories, what share of cases is beyond what is required, how means
    converge if asked for, and histograms of outcomes, of ``every`` one or of the first twelve by
    rank, side by side and, if asked for, each ``alone``, into the run folder; those of a ``page``,
    in one style for it, into that folder instead. A ``second`` process draws histograms meanwhile.
    Returns their paths."""
    from sepmc.analysis.constant_outcomes import collapse_constant, constant_value, is_constant

    units = {c.name: c.unit for c in loaded.outcome_columns}
    table = summary.statistics() if table is None else table
    about, into, suffix = about_run(folder), page or folder, ".svg" if page else suffix
    outcomes = telling_outcomes(loaded, table)
    shown = 0 if not converging else _ON_A_PAGE if page else _CONVERGING
    converged = [name for name in outcomes if not is_constant(table, name)][:shown]
    if len(outcomes) > _DRAWN and not every:
        say(f"histograms of the first {_DRAWN} outcomes; sepmc plot {folder} --all: of all")
        outcomes = outcomes[:_DRAWN]
    histograms = partial(
        _draw_histograms,
        {name: collapse_constant(summary.histogram(name), table, name) for name in outcomes},
        into,
        units,
        loaded.reference,
        source=loaded.file.reference.source if loaded.file.reference else "reference",
        required=required_bounds(loaded),
        about=about,
        suffix=suffix,
        alone=alone,
    )
    drawn = _begun(histograms, second)
    written = _draw_bands(folder, into, units, about, suffix)
    alike = {name: constant_value(table, name) for name in outcomes if is_constant(table, name)}
    written += _share_figures(folder, loaded, verdicts, converged, into, suffix, alike)
    return written + drawn()


def required_bounds(loaded: "Campaign") -> dict[str, list[float]]:
    """The bounds that are required of each outcome."""
    found: dict[str, list[float]] = {}
    for item in loaded.file.requirements:
        at = [bound for bound in (item.at_least, item.at_most) if bound is not None]
        found[item.metric] = found.get(item.metric, []) + at
    return found


def clearance_bounds(loaded: "Campaign") -> dict[str, list[float]]:
    """The same of clearances over time: no recontact is a clearance above 0."""
    found = required_bounds(loaded)
    for name in [name for name in found if name.endswith("_recontact")]:
        clearance = name.removesuffix("_recontact") + "_clearance_mm"
        found[clearance] = [*found.get(clearance, []), 0.0]
    return found


def marks_of(history: Mapping[Any, Any]) -> dict[str, float]:
    """Times (s) of releases and events, by what figures call them, from the ``attrs`` of a history
    or the manifest that keeps them."""
    releases = {f"release of {joint}": t for joint, t in history.get("releases", {}).items()}
    times = {**releases, **history.get("events", {})}
    return {name: float(t) for name, t in times.items() if t is not None and math.isfinite(t)}


def _begun(work: Callable[[], Any], second: "Executor | None") -> Callable[[], Any]:
    """Begin some work in a second process. Returns what gives its result, or does it here, if there
    is no such process any more."""
    if second is None:
        return work
    from concurrent.futures import BrokenExecutor

    def result() -> Any:
        try:
            return there.result()
        except BrokenExecutor:
            return work()

    try:
        there = second.submit(work)
    except BrokenExecutor:
        return work
    return result


def _draw_histograms(*given: Any, **named: Any) -> list[Path]:
    """`sepmc.report.figures.histogram_figures`, imported by the process that draws them."""
    from sepmc.report.figures import histogram_figures

    return histogram_figures(*given, **named)


def _draw_bands(
    folder: Path, into: Path, units: dict[str, str], about: str, suffix: str
) -> list[Path]:
    """Draw bands of the histories that a run folder holds; returns their paths."""
    from sepmc.campaign.store import shards

    below = shards.case_after(folder, _BANDED)
    histories = shards.read_histories(folder, below)
    if histories is None:
        return []
    from sepmc.report.figures import band_figures

    frame = shards.read_cases(folder, below, ["case", "status"])
    ok = histories["case"].isin(frame["case"][frame["status"] == "ok"])
    return band_figures(histories[ok], into, units, about=about, suffix=suffix)


# outcomes whose mean and sigma are drawn over the number of cases, by themselves and in a report
_CONVERGING, _ON_A_PAGE = 4, 2


def _share_figures(
    folder: Path,
    loaded: "Campaign",
    verdicts: "Sequence[Verdict]",
    converged: "Sequence[str]",
    into: Path,
    suffix: str,
    alike: Mapping[str, float],
) -> list[Path]:
    """Draw what share of cases is beyond what is required, and how the means of some outcomes
    converge, if there are rows to see it from; ``alike``: constant outcomes, with their values.
    Returns the paths."""
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
        values[name] = np.where(np.isnan(x), x, alike[name]) if name in alike else x
    units, about = {c.name: c.unit for c in loaded.outcome_columns}, about_run(folder)
    written = []
    if required:
        of = {name: values[name] for name in required}
        written.append(exceedance_figure(of, verdicts, into, units, about, suffix))
    known = {name: values[name][np.isfinite(values[name])] for name in converged}
    if shown := {name: x for name, x in known.items() if len(x) > 1}:
        rarely = manifest.get("rarely_drawn", ())
        said = "\n".join([about, *rarely])
        written.append(convergence_figure(shown, into, units, said, suffix))
    return written


def about_run(folder: Path) -> str:
    """What a run is called in the titles of figures."""
    from sepmc.campaign.label import of_run
    from sepmc.campaign.store import manifests

    return of_run(manifests.read_manifest(folder))


def telling_outcomes(loaded: "Campaign", table: "pd.DataFrame") -> list[str]:
    """Outcomes in the order in which a review asks for them: what is required, then what the
    campaign compares with a reference, or, without one, what varies by more than its numerical
    error, by rank. Those that are yes or no, which have no density, are left out."""
    from sepmc.analysis.constant_outcomes import is_constant

    there = [str(name) for name in table.index if not is_yes_or_no(str(name))]
    required = [item.metric for item in loaded.file.requirements if item.metric in there]
    if loaded.reference:
        others = [name for name in loaded.reference if name in there]
    else:
        varied = [name for name in there if table.at[name, "n"] and not is_constant(table, name)]
        events = tuple(f"{event.name}_" for event in loaded.scene.event)
        others = sorted(_different(varied, table), key=lambda name: _interest(name, events))
    return list(dict.fromkeys([*required, *others]))


def _different(names: list[str], table: "pd.DataFrame") -> list[str]:
    """Of outcomes that are the same, as rates of two bodies that are one, the first alone."""
    found: dict[tuple[str, ...], str] = {}
    for name in names:
        row = table.loc[name].astype(float)
        told = tuple(f"{row[key]:.7g}" for key in ("mean", "sigma", "min", "max"))
        found.setdefault(told, name)
    return list(found.values())


_INTERESTING = (
    "clearance_mm",
    "transverse_rate",
    "tip_off",
    "separation_distance",
    "separation_speed",
    "release_time",
    "peak_force_N",
    "jam_friction",
)


def _interest(outcome: str, events: tuple[str, ...]) -> float:
    """Rank of an outcome among the figures: what separations are judged by comes first; rates at
    ``events``, by how their names begin, count as those at release, clearances as separations, and
    come before these, as they were asked for."""
    if outcome.startswith(events):
        for there, as_if in (
            ("_transverse_rate_", "transverse_rate"),
            ("_omega_", "tip_off"),
            ("_clearance_mm", "separation_distance"),
        ):
            if there in outcome:
                return _INTERESTING.index(as_if) - 0.5
    return next(
        (rank for rank, part in enumerate(_INTERESTING) if part in outcome), len(_INTERESTING)
    )
