"""`sepmc compare`: differences between two runs, or between a run and a flight."""

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from sepmc.cli.figures import ranked_outcomes
from sepmc.cli.flight_comparison import CASES, check_options, compare_with_flight
from sepmc.cli.options import Folder, check_out_file, load_run, overwrite_option
from sepmc.cli.render import screen_width, show
from sepmc.cli.results import check_rows

if TYPE_CHECKING:
    import numpy as np

    from sepmc.campaign.campaign import Campaign
    from sepmc.campaign.run_statistics import RunStatistics

_SHOWN = 12  # outcomes on the screen and in the figure


@click.command(short_help="Show the differences between two runs, or a run and a flight.")
@click.argument("one", metavar="RUN_A", type=Folder())
@click.argument("two", metavar="[RUN_B]", type=Folder(), required=False)
@click.option(
    "--data",
    type=click.Path(path_type=Path),
    help="Telemetry of a flight: CSV, Parquet, MATLAB; HDF5 with the extra export, MDF and TDMS "
    "with the extra telemetry.",
)
@click.option(
    "--map",
    "maps",
    multiple=True,
    metavar="COLUMN=CHANNEL",
    help="A history column, and the channel it is compared with, with optional sign, factor and "
    'unit: "upper_omega_y_deg_s=-0.5*gyro_z[rad/s]". Default: channels that have the name of a '
    "column.",
)
@click.option("--time", metavar="CHANNEL", help="Channel of time. Default: time, t or similar.")
@click.option(
    "--shift",
    "shift_s",
    type=float,
    metavar="S",
    help="Time of the flight's clock at time 0 of the run, s. Default: estimated.",
)
@click.option(
    "--cases",
    type=click.IntRange(min=2),
    default=CASES,
    show_default=True,
    help="Cases of the envelope, simulated again unless the run stored these columns over time.",
)
@click.option(
    "--out",
    type=click.Path(path_type=Path),
    help="Folder for compare.csv and compare.png, or for telemetry.csv, .json and .png (default "
    "RUN_A).",
)
@overwrite_option("the comparison in --out")
def compare(
    one: Path,
    two: Path | None,
    data: Path | None,
    maps: tuple[str, ...],
    time: str | None,
    shift_s: float | None,
    cases: int,
    out: Path | None,
    overwrite: bool,
) -> None:
    """Show the differences between RUN_A and RUN_B: in their files, statuses, verdicts and
    outcomes, with a 95 % interval of each difference. Cases of the same number are paired
    (Student's t) if both runs have the same inputs there except those that the files change, as
    with one seed; otherwise the samples are independent (Welch). Outcomes that are yes or no are
    compared by their fraction.

    With --data, show the telemetry of a flight in the envelope of RUN_A: clock shift, use of the
    envelope, residuals against the nominal case, and the nearest cases.

    \b
    Examples:
      sepmc compare runs/windy runs/calm --out windy-calm
      sepmc compare runs/windy --data flight.csv --map "upper_omega_y_deg_s=-gyro_z[rad/s]"
    """
    check_options(two, data, {"map": maps, "time": time, "shift": shift_s, "cases": cases})
    if data is not None:
        compare_with_flight(one, data, maps, time, shift_s, cases, out, overwrite, click.echo)
        return
    assert two is not None
    _compare_runs(one, two, out, overwrite)


def _compare_runs(one: Path, two: Path, out: Path | None, overwrite: bool) -> None:
    """Print the differences between two runs, with at most `_SHOWN` outcomes, the most important
    ones. If the folder ``out`` is not None, write compare.csv, with all outcomes, and compare.png,
    with the printed ones, into it; raise InputError if compare.csv is there and ``overwrite`` is
    False."""
    paths = one, two
    for folder in paths:
        check_rows(folder)
    from sepmc.analysis import compare as comparison
    from sepmc.analysis import constant_outcomes
    from sepmc.campaign import run_statistics
    from sepmc.campaign.store import folders, shards

    campaigns = [load_run(folder) for folder in paths]
    if out is not None:
        check_out_file(out / "compare.csv", (), overwrite)
    runs = [run_statistics.read_run(*each) for each in zip(paths, campaigns, strict=True)]
    _show_differences(campaigns, runs)
    rows = [shards.CaseColumns(folder) for folder in paths]
    inputs = _common(*([c.name for c in each.input_columns] for each in campaigns))
    outcomes = _common(*([c.name for c in each.outcome_columns] for each in campaigns))
    resampled = _resampled(campaigns, runs, inputs)
    tables = [run.table for run in runs]
    sizes = {name: constant_outcomes.joint_error(tables[0], tables[1], name) for name in outcomes}
    table = comparison.compare(rows[0], rows[1], inputs, outcomes, resampled, sizes)
    shown = _common(ranked_outcomes(campaigns[0], tables[0]), outcomes)[:_SHOWN]
    click.echo(comparison.render_comparison(table.loc[shown], screen_width()))
    if message := comparison.dependence_warning([each.scene.run.sampler for each in campaigns]):
        show(message)
    if out is None:
        return
    folders.make_writable(out)
    folders.write_text(out / "compare.csv", table.to_csv())
    click.echo(f"wrote {out / 'compare.csv'}")
    if values := _samples(rows, tables, shown):
        from sepmc.report.compare_figures import overlay_figure

        units = {c.name: c.unit for c in campaigns[0].outcome_columns}
        names = str(one), str(two)
        click.echo(f"wrote {overlay_figure(values, out, units, names)}")


def _show_differences(campaigns: "Sequence[Campaign]", runs: "Sequence[RunStatistics]") -> None:
    """Print the values that differ in the campaign files of two runs and, if they differ, the case
    numbers; then of every status the number of cases, and of every requirement the verdict, in both
    runs (``A -> B``), also where these are equal."""
    from sepmc.analysis.compare import tree_differences
    from sepmc.campaign.case_selection import parse

    trees = [_without_cases(each.file.tree) for each in campaigns]
    lines = tree_differences(trees[0], trees[1])
    numbers = [(run.manifest.get("numbers"), run.manifest["cases"]) for run in runs]
    cases = [str(parse(text)) if text else f"0:{count}" for text, count in numbers]
    lines += [f"cases: {' -> '.join(cases)}"] if cases[0] != cases[1] else []
    click.echo(
        "\n".join(["differences of the campaign files", *(f"  {x}" for x in lines or ["none"])])
    )
    counts = [run.summary.counts for run in runs]
    for label in dict.fromkeys([*counts[0], *counts[1]]):
        click.echo(f"{label}: {counts[0].get(label, 0)} -> {counts[1].get(label, 0)} cases")
    verdicts = [{verdict.name: verdict for verdict in run.verdicts} for run in runs]
    for name in dict.fromkeys([*verdicts[0], *verdicts[1]]):
        texts = [
            f"{each[name].verdict}, {each[name].violations} of {each[name].cases} cases violate it"
            if name in each
            else "not required"
            for each in verdicts
        ]
        click.echo(f"requirement {name}: {' -> '.join(texts)}")


def _without_cases(tree: Mapping[str, Any]) -> dict[str, Any]:
    """Return a copy of the tree of a campaign file without the key ``run.cases``, the number of
    cases. The copy has a table ``run`` in any case, if need be an empty one."""
    run = {key: value for key, value in tree.get("run", {}).items() if key != "cases"}
    return {**tree, "run": run}


def _resampled(
    campaigns: "Sequence[Campaign]", runs: "Sequence[RunStatistics]", inputs: list[str]
) -> list[str]:
    """Return the names of the ``inputs`` whose samples differ between two runs because their random
    numbers (`_sampling`) or distributions differ. An input that a column of a sample table gives in
    one of the runs has no random numbers; the values in the tables are not compared here."""
    sampling = [_sampling(r.manifest, each) for r, each in zip(runs, campaigns, strict=True)]
    from_table = {
        d.parameter.column for each in campaigns for d in each.file.dispersions if d.column
    }
    one, two = (_distributions(each) for each in campaigns)
    return [
        name
        for name in inputs
        if (sampling[0] != sampling[1] and name not in from_table) or one.get(name) != two.get(name)
    ]


def _sampling(manifest: Mapping[str, Any], campaign: "Campaign") -> tuple[Any, ...]:
    """Return the tuple (seed, sampler, paths of jointly sampled parameters, number of cases) of a
    run, given by its manifest and its campaign.

    Two runs with equal tuples have the same random numbers. The paths are an empty tuple unless the
    sampler is sobol or saltelli, and the number is 0 unless it is lhs or saltelli: the random
    numbers of the other samplers do not depend on them.
    """
    from sepmc.campaign.cases import SIZE_DEPENDENT
    from sepmc.scene.model import SALTELLI

    sampler = campaign.scene.run.sampler
    sampled = [d for d in campaign.file.dispersions if not d.column]
    jointly = sampler in ("sobol", SALTELLI)
    parameters = tuple(d.parameter.path for d in sampled) if jointly else ()
    size = campaign.scene.run.cases if sampler in SIZE_DEPENDENT else 0
    return manifest.get("seed"), sampler, parameters, size


def _distributions(campaign: "Campaign") -> dict[str, tuple[Any, ...]]:
    """Return a tuple with the distribution and the correlations of each dispersed input, by column;
    an input has the same distribution in two campaigns if its tuples there are equal. Correlations
    are in the order of the file, so another order counts as a difference."""
    dispersions = campaign.file.dispersions
    distributions: dict[str, tuple[Any, ...]] = {
        d.parameter.column: (d.distribution, d.numbers, d.weights) for d in dispersions
    }
    for copula in campaign.file.copulas:
        names = tuple(dispersions[index].parameter.column for index in copula.places)
        distributions |= {name: (*distributions[name], names, copula.factor) for name in names}
    return distributions


def _samples(
    rows: Sequence[Any], tables: Sequence[Any], names: list[str]
) -> "dict[str, tuple[np.ndarray, np.ndarray]]":
    """Return, by outcome, the finite values (n,) and (m,) of the ok cases of two runs. Values of a
    constant outcome are all its constant. Outcomes without values in one of the runs are left out.

    ``rows`` and ``tables`` are the case columns and the statistics of each run, ``names`` the
    outcomes.
    """
    import numpy as np

    from sepmc.analysis.constant_outcomes import constant_value, is_constant
    from sepmc.analysis.statistics import column, ok_rows

    values = {}
    for name in names:
        finite = []
        for cases, table in zip(rows, tables, strict=True):
            x = column(cases, name)[ok_rows(cases)]
            x = x[np.isfinite(x)]
            constant = is_constant(table, name)
            finite.append(np.full(len(x), constant_value(table, name)) if constant else x)
        if len(finite[0]) and len(finite[1]):
            values[name] = finite[0], finite[1]
    return values


def _common(one: list[str], two: list[str]) -> list[str]:
    """Return the names that are in both lists, in the order of the first."""
    return [name for name in one if name in set(two)]
