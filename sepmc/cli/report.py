"""What the command line tells of a run beyond its statistics: what drives it, and the report."""

from collections.abc import Callable, Mapping
from contextlib import suppress
from dataclasses import dataclass
from io import BytesIO
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

import click
import numpy as np
import pandas as pd

from sepmc.analysis import (
    compare,
    constant_outcomes,
    distributions,
    failure_attribution,
    sensitivity,
)
from sepmc.analysis.requirements import FAIL
from sepmc.analysis.row_statistics import Rows
from sepmc.analysis.statistics import (
    WIDTH,
    audit_text,
    column,
    ok_rows,
    share_lines,
    summary_text,
)
from sepmc.analysis.streaming import Stream
from sepmc.campaign.campaign import Campaign
from sepmc.campaign.cases import SIZE_DEPENDENT
from sepmc.campaign.label import of_run, of_settings
from sepmc.campaign.store import folders, manifests, shards
from sepmc.cli.figures import clearance_bounds, draw_figures, marks_of, telling_outcomes
from sepmc.cli.options import load_campaign, redundant
from sepmc.cli.render import (
    accuracy_text,
    folded,
    screen_width,
    statistics_of,
    summary_of,
    verdicts_of,
)
from sepmc.processes import processes
from sepmc.report import page
from sepmc.report.compare_figures import overlay_figure
from sepmc.report.drawing import drawing
from sepmc.report.figures import run_figures
from sepmc.report.sensitivity_figures import scatter_figure, tornado_figure
from sepmc.scene.limits import CAMPAIGN_BYTES, content
from sepmc.scene.messages import nearest, nobody
from sepmc.scene.model import SALTELLI, VIOLATION, Requirement
from sepmc.schema import Status, is_yes_or_no

_DRIVEN = 4  # outcomes whose drivers are told unless some are named
_REPLAYED_PAGES = ("rates", "angles", "separation", "clearances")
_AS_DRAWN = 1e-5  # of size: what a figure shows of an error
_TOLD = 12  # outcomes in the report's table
_ACROSS = 160  # characters of a line of all outcomes there
# worst cases that the report shows over time; at most, if more requirements fail
_REPLAYED, _AT_MOST = 2, 4
_REPLAY_ROWS = 400


@dataclass
class Driven:
    """What drives outcomes, by name, and what sets apart the cases that violate something, with a
    sentence on how many these are; the paths of inputs in the file, by column."""

    drivers: dict[str, pd.DataFrame]
    causes: dict[str, list[failure_attribution.Cause]]
    violated: dict[str, str]
    keys: dict[str, str]
    design: str = "random"

    def texts(self, width: int) -> tuple[list[str], list[str]]:
        """Both as a screen of so many characters shows them."""
        return (
            [
                sensitivity.text(table, name, self.keys, width=width)
                for name, table in self.drivers.items()
            ],
            [
                failure_attribution.text(
                    said, self.causes[name], self.keys, width=width, design=self.design
                )
                for name, said in self.violated.items()
            ],
        )


def find_drivers(
    folder: Path,
    loaded: Campaign,
    summary: Rows | Stream,
    table: pd.DataFrame,
    named: tuple[str, ...] = (),
) -> Driven:
    """What drives the outcomes ``named``, or those that matter most, and what sets apart the cases
    that violate a requirement or did not come to their end."""
    rows = shards.CaseColumns(folder)
    _check_known(loaded, named)
    keys = {d.parameter.column: d.parameter.key for d in loaded.file.dispersions}
    found = {}
    for name in named or telling_outcomes(loaded, table)[:_DRIVEN]:
        try:
            found[name] = sensitivity.drivers(
                rows,
                list(keys),
                name,
                loaded.design,
                correlated=loaded.correlated,
                within=constant_outcomes.reach(table, name),
            )
        except ValueError as error:
            click.echo(f"warning: {error}", err=True)
    failed = [
        label for label, count in summary.counts.items() if count and label != Status.OK.label
    ]
    items = [*loaded.file.requirements, *(Requirement(name=each, metric=each) for each in failed)]
    required = loaded.file.requirements
    apart = {
        item.name: failure_attribution.of_requirement(
            item, rows, list(keys), required, loaded.design
        )
        for item in items
    }
    violated = {}
    for item in items:
        violates, there = failure_attribution.violating(item, rows, required)
        if count := int((violates & there).sum()):
            unknown = rows.rows - int(there.sum())
            lack = "are not known to" if item.metric == VIOLATION else "have no such outcome"
            left = f" ({unknown} others {lack})" if unknown else ""
            violated[item.name] = f"{item.name}, {count} of {there.sum()} cases{left}"
        if item.metric in table.index:
            count, of = failure_attribution.of_missing(item.metric, rows, list(keys), loaded.design)
            if count:
                name = f"{item.name}, missing"
                violated[name] = f"{item.name}, {count} ok cases without {item.metric}"
                apart[name] = of
    return Driven(found, apart, violated, keys, loaded.design)


def _statistics(folder: Path, loaded: Campaign, summary: Rows | Stream) -> pd.DataFrame:
    """`statistics_of` a run by the manifest of its folder."""
    return statistics_of(loaded, summary, manifests.read_manifest(folder).get("accuracy") or {})


def _check_known(loaded: Campaign, named: tuple[str, ...]) -> None:
    """Raise if a campaign has no such outcome."""
    known = [column.name for column in loaded.outcome_columns]
    for name in named:
        if name not in known:
            raise folders.StoreError(f"{name}: no such outcome; {nearest(name, known)}")


def tell_laws(folder: Path, loaded: Campaign, named: tuple[str, ...]) -> None:
    """Which laws the outcomes ``named``, or those that matter most, follow: to the screen, and of
    all outcomes that are numbers to ``laws.csv``."""
    _check_known(loaded, named)
    table = _statistics(folder, loaded, summary_of(folder, loaded))
    every = [str(name) for name in table.index if not is_yes_or_no(str(name))]
    for name in named:
        if name not in every:
            raise folders.StoreError(f"{name}: is yes or no, so it has no law")
    alike = [name for name in every if constant_outcomes.is_constant(table, name)]
    found = distributions.laws(shards.CaseColumns(folder), every, alike)
    told = list(named) or telling_outcomes(loaded, table)[:_TOLD]
    units = {c.name: c.unit for c in loaded.outcome_columns}
    sampler = loaded.scene.run.sampler
    folded(distributions.text(found.loc[told], table, units, screen_width(), sampler))
    folders.write_text(folder / "laws.csv", found.to_csv())
    manifests.record_derived(folder, [folder / "laws.csv"])
    click.echo(folder / "laws.csv")


def tell_drivers(folder: Path, loaded: Campaign, named: tuple[str, ...], plots: bool) -> None:
    """The same to the screen, to ``drivers.csv`` and ``causes.csv``, and as a figure; what
    ``drivers.csv`` has of outcomes that are not ``named`` stays."""
    summary = summary_of(folder, loaded)
    driven = find_drivers(folder, loaded, summary, _statistics(folder, loaded, summary), named)
    for text in [text for texts in driven.texts(screen_width()) for text in texts]:
        folded(text)
    written = [folder / "causes.csv"]
    if driven.drivers:
        noted = {
            name: table.assign(note=" ".join(sensitivity.remarks(table, driven.keys)))
            for name, table in driven.drivers.items()
        }
        table = pd.concat(noted, names=["outcome", "input"]).reset_index()
        before = _told_before(folder, list(table.columns)) if named else table[:0]
        table = pd.concat([before[~before["outcome"].isin(driven.drivers)], table])
        folders.write_text(folder / "drivers.csv", table.to_csv(index=False))
        written.insert(0, folder / "drivers.csv")
    folders.write_text(
        folder / "causes.csv", failure_attribution.table(driven.causes).to_csv(index=False)
    )
    if plots:
        written += draw_drivers(driven, folder, loaded, folder)
    manifests.record_derived(folder, written)
    for path in written:
        click.echo(path)


def _told_before(folder: Path, columns: list[str]) -> pd.DataFrame:
    """What ``drivers.csv`` has, if it is as it was written."""
    path, noted = folder / "drivers.csv", manifests.is_recorded(folder, "drivers.csv")
    if noted:
        with suppress(ValueError):  # what pandas raises of what is no table, too
            found = pd.read_csv(BytesIO(content(path, CAMPAIGN_BYTES)))
            if list(found.columns) == columns:
                return found
    return pd.DataFrame(columns=pd.Index(columns))


def draw_drivers(
    driven: Driven, folder: Path, loaded: Campaign, into: Path, suffix: str = ".png"
) -> list[Path]:
    """Draw tornado charts, and outcomes over inputs, if there is anything to draw; returns the
    paths."""
    if not driven.drivers:
        return []
    units = {c.name: c.unit for c in loaded.outcome_columns}
    about = of_run(manifests.read_manifest(folder))
    cases = shards.CaseColumns(folder)
    ok = ok_rows(cases)
    by_metric: dict[str, np.ndarray] = {}
    every = np.zeros(cases.rows, dtype=bool)
    for item in loaded.file.requirements:
        violates = np.logical_and(
            *failure_attribution.violating(item, cases, loaded.file.requirements)
        )
        by_metric[item.metric] = by_metric.get(item.metric, False) | violates
        every |= violates
    violating = {name: by_metric.get(name, every)[ok] for name in driven.drivers}
    names = {*driven.drivers, *(str(name) for t in driven.drivers.values() for name in t.index)}
    rows = {name: column(cases, name)[ok] for name in names}
    return [
        tornado_figure(driven.drivers, into, units, driven.keys, about, suffix),
        scatter_figure(driven.drivers, rows, violating, into, units, driven.keys, about, suffix),
    ]


def tell_comparison(
    places: tuple[Path, Path],
    runs: tuple[Campaign, Campaign],
    out: Path | None,
    overwrite: bool,
) -> None:
    """What differs between two runs, in their files, statuses, verdicts and outcomes: to the
    screen, and to ``compare.csv`` and ``compare.png`` in a folder if one is given."""
    if out is not None and (out / "compare.csv").exists() and not overwrite:
        raise folders.StoreError(
            f"{out}: holds a comparison; add --overwrite or choose another --out"
        )
    rows = [shards.CaseColumns(folder) for folder in places]
    summaries = [summary_of(folder, run) for folder, run in zip(places, runs, strict=True)]
    tables = [_statistics(*each) for each in zip(places, runs, summaries, strict=True)]
    recorded = [manifests.read_manifest(folder) for folder in places]
    told_of = [manifest.get("accuracy") or {} for manifest in recorded]
    found = compare.differences(_but_cases(runs[0].file.tree), _but_cases(runs[1].file.tree))
    flown = [str(manifest.get("numbers") or f"0:{manifest['cases']}") for manifest in recorded]
    found += [f"cases: {' -> '.join(flown)}"] if flown[0] != flown[1] else []
    lines = "\n".join("  " + line for line in found or ["nothing"])
    click.echo(f"what differs in the files\n{lines}")
    counts = [summary.counts for summary in summaries]
    for label in dict.fromkeys([*counts[0], *counts[1]]):
        click.echo(f"{label}: {counts[0].get(label, 0)} -> {counts[1].get(label, 0)} cases")
    verdicts = [
        {v.name: v for v in verdicts_of(run, summary, accuracy, table, summary.audit())}
        for run, summary, accuracy, table in zip(runs, summaries, told_of, tables, strict=True)
    ]
    for name in dict.fromkeys([*verdicts[0], *verdicts[1]]):
        told = [
            f"{found[name].verdict}, {found[name].violations} of {found[name].cases}"
            if name in found
            else "not required"
            for found in verdicts
        ]
        click.echo(f"requirement {name}: {' -> '.join(told)}")
    inputs = _common(*([c.name for c in run.input_columns] for run in runs))
    outcomes = _common(*([c.name for c in run.outcome_columns] for run in runs))
    laws_of = [_laws(run) for run in runs]
    draws = [_drawn(manifests.read_manifest(f), run) for f, run in zip(places, runs, strict=True)]
    given = {d.parameter.column for run in runs for d in run.file.dispersions if d.column}
    redrawn = [
        name
        for name in inputs
        if (draws[0] != draws[1] and name not in given)
        or laws_of[0].get(name) != laws_of[1].get(name)
    ]
    sizes = {name: constant_outcomes.comparable(tables[0], tables[1], name) for name in outcomes}
    table = compare.compare(rows[0], rows[1], inputs, outcomes, redrawn, sizes)
    telling = _common(telling_outcomes(runs[0], tables[0]), outcomes)[:_TOLD]
    click.echo(compare.text(table.loc[telling], screen_width()))
    if said := compare.dependent([run.scene.run.sampler for run in runs]):
        folded(said)
    if out is None:
        return
    folders.make_writable(out)
    folders.write_text(out / "compare.csv", table.to_csv())
    click.echo(f"wrote {out / 'compare.csv'}")
    values = {}
    for name in telling:
        both = [column(cases, name)[ok_rows(cases)] for cases in rows]
        one, two = (
            np.full(len(x), constant_outcomes.settled_value(t, name))
            if constant_outcomes.is_constant(t, name)
            else x
            for t, x in zip(tables, (x[np.isfinite(x)] for x in both), strict=True)
        )
        if len(one) and len(two):
            values[name] = one, two
    if values:
        units = {c.name: c.unit for c in runs[0].outcome_columns}
        names = str(places[0]), str(places[1])
        click.echo(f"wrote {overlay_figure(values, out, units, names)}")


def _but_cases(tree: Mapping[str, Any]) -> dict[str, Any]:
    """A campaign's tree without how many cases it asks for: which were flown is told."""
    run = {key: value for key, value in tree.get("run", {}).items() if key != "cases"}
    return {**tree, "run": run}


def _drawn(manifest: dict[str, Any], run: Campaign) -> tuple[Any, ...]:
    """What the draws of a case follow from, but for the laws."""
    sampler, drawn = run.scene.run.sampler, [d for d in run.file.dispersions if not d.column]
    together = tuple(d.parameter.path for d in drawn) if sampler in ("sobol", SALTELLI) else ()
    size = run.scene.run.cases if sampler in SIZE_DEPENDENT else 0
    return manifest.get("seed"), sampler, together, size


def _laws(run: Campaign) -> dict[str, tuple[Any, ...]]:
    """Law of each input, by column, and what it varies together with."""
    laws_of = run.file.dispersions
    found: dict[str, tuple[Any, ...]] = {
        d.parameter.column: (d.law, d.numbers, d.weights) for d in laws_of
    }
    for copula in run.file.copulas:
        names = tuple(laws_of[place].parameter.column for place in copula.places)
        found |= {name: (*found[name], names, copula.factor) for name in names}
    return found


def _common(one: list[str], two: list[str]) -> list[str]:
    """Names that both lists have, in the order of the first."""
    return [name for name in one if name in set(two)]


def tell_report(folder: Path, loaded: Campaign, replays: bool, say: Callable[[str], None]) -> Path:
    """Write the report of a run, with its worst cases over time if wanted; returns its path. A
    second process draws the vehicle and the outcomes, while this one finds the rest."""
    with TemporaryDirectory() as temporary, processes(1) as second:
        into = Path(temporary)
        drawn = second.submit(_draw_run, folder, into)
        report, driven = _found(folder, loaded, replays, into, say)
        drivers = draw_drivers(driven, folder, loaded, into, ".svg")
        path = page.write_report(report, folder / "report.html", *drawn.result(), drivers)
        manifests.record_derived(folder, [path])
        return path


def _draw_run(folder: Path, into: Path) -> tuple[list[Path], list[Path]]:
    """Draw the vehicle, and the outcomes, of a run into a folder; returns the paths of both."""
    loaded = load_campaign(str(folder), (), warn=False)
    summary = summary_of(folder, loaded)
    table, manifest = _statistics(folder, loaded, summary), manifests.read_manifest(folder)
    accuracy = manifest.get("accuracy") or {}
    vehicle = drawing(loaded.scene, loaded.file.dispersions, loaded.name, into / "vehicle.svg")
    outcomes = draw_figures(
        folder,
        loaded,
        summary,
        table,
        say=nobody,
        page=into,
        verdicts=verdicts_of(loaded, summary, accuracy, table, summary.audit()),
        converging=True,
    )
    return [vehicle], outcomes


def _found(
    folder: Path, loaded: Campaign, replays: bool, into: Path, say: Callable[[str], None]
) -> tuple[page.Report, Driven]:
    """What the report of a run tells, with its worst cases flown again and drawn into a folder, and
    what drives its outcomes."""
    summary, manifest = summary_of(folder, loaded), manifests.read_manifest(folder)
    accuracy: dict[str, Any] = manifest.get("accuracy") or {}
    table, audited = statistics_of(loaded, summary, accuracy), summary.audit()
    verdicts = verdicts_of(loaded, summary, accuracy, table, audited)
    driven = find_drivers(folder, loaded, summary, table)
    texts = driven.texts(WIDTH)
    units = {c.name: c.unit for c in loaded.outcome_columns}
    source = loaded.file.reference.source if loaded.file.reference else "reference"
    sentences = {status.label: status.sentence for status in Status}
    every = summary_text(table, summary.counts, units, source, _ACROSS)
    last = manifest["sessions"][-1]
    report = page.Report(
        name=loaded.name,
        title=loaded.file.title,
        facts=f"{loaded.name}, {manifest['cases']:,} cases, seed {manifest['seed']}, sampler "
        f"{loaded.scene.run.sampler}; flown {last['finished'][:10]} by sepmc {last['sepmc']}; "
        f"campaign {manifest['digest']}{of_settings(loaded.settings).replace(chr(10), '; ')}",
        notes=[*manifest.get("notes", ()), *redundant(loaded)],
        verdicts=verdicts,
        counts=every.partition("\n")[0],
        failures=[
            f"{count} cases {label}: {sentences.get(label, '')}"
            for label, count in summary.counts.items()
            if count and label != Status.OK.label
        ],
        shares=share_lines(table),
        statistics=table,
        telling=telling_outcomes(loaded, table)[:_TOLD],
        units=units,
        every=every,
        accuracy=accuracy_text(
            accuracy, accuracy.get("stages") or [phase.name for phase in loaded.scene.phase]
        )
        if "errors" in accuracy
        else "",
        audit=audit_text(audited),
        sessions=manifest["sessions"],
        campaign=loaded.file.toml,
        drivers=texts[0],
        causes=texts[1],
        replays=_worst(loaded, verdicts, manifest["seed"], into, say) if replays else [],
    )
    return report, driven


def _worst(
    loaded: Campaign, verdicts: list[Any], seed: int, into: Path, say: Callable[[str], None]
) -> list[page.Replay]:
    """The worst cases of the requirements, flown again and drawn into a folder."""
    told = [v for v in verdicts if v.worst_case is not None and v.metric != VIOLATION]
    # what fails goes first, then what is violated, of each the cases that have the outcome
    told.sort(key=lambda v: (v.verdict != FAIL, not v.violations, v.worst is None))
    worst = {v.worst_case: v for v in reversed(told)}
    found, solver = [], loaded.scene.solver
    if solver.step is None and solver.accuracy < _AS_DRAWN:
        loaded = loaded.with_settings({"solver.accuracy": _AS_DRAWN})
    fail = sum(v.verdict == FAIL for v in worst.values())
    for number, v in list(reversed(worst.items()))[: min(max(_REPLAYED, fail), _AT_MOST)]:
        which = "the first that violates" if v.worst is None else "the worst of"
        say(f"flies case {number} again, {which} {v.name}")
        every_s = loaded.scene.run.end_time / _REPLAY_ROWS
        history = loaded.simulate(loaded.case(number, seed), every_s, say)
        unit = next((c.unit for c in loaded.outcome_columns if c.name == v.metric), "")
        title = (
            f"case {number}, the first of {v.violations} that violate {v.name}"
            if v.worst is None
            else f"case {number}, the worst of {v.name}: {v.metric} {v.worst:.5g} {unit}"
        )
        figures = run_figures(
            history,
            into / str(number),
            loaded.plan.bodies,
            list(loaded.plan.joints),
            suffix=".svg",
            only=_REPLAYED_PAGES,
            required=clearance_bounds(loaded),
            marks=marks_of(history.attrs),
        )
        found.append(page.Replay(title.rstrip(), figures))
    return found
