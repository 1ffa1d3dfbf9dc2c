"""Commands that tell of run folders: nothing is flown, but to mend one. Nothing heavy is imported
until a command needs it."""

import sys
from functools import partial
from pathlib import Path

import click

from sepmc.cli.figures import clearance_bounds, draw_figures, marks_of
from sepmc.cli.options import CHECK, NO_PLOTS, QUIET, RUN, Place, check_required, load_campaign
from sepmc.cli.render import (
    manifest_with_rows,
    plain_errors,
    speaker,
    statistics_of,
    summary_of,
    tell_given,
    tell_results,
    verdicts_of,
)


@click.command(short_help="Statistics of RUN again, from its files alone.")
@RUN
@click.option(
    "--columns",
    metavar="PATTERN,...",
    help="Tell of these outcomes only: 'upper_*,separation_*'. Files hold all of them.",
)
@click.option(
    "--given",
    multiple=True,
    metavar="TERM",
    help="Of the cases only in which this holds, such as joint.bolt.fails=1 or spring.*.fails=1 "
    "(any of them), or several with ' or ' between them; given twice, both hold. Writes nothing.",
)
@click.option(
    "--json", "as_json", is_flag=True, help="Print what statistics.json holds instead of tables."
)
@CHECK
def stats(
    folder: Path, columns: str | None, given: tuple[str, ...], as_json: bool, must_pass: bool
) -> None:
    """Compute and print the statistics of RUN again, from its files alone; with --given those of
    the cases in which inputs, or outcomes, have certain values.

    \b
    Examples:
      sepmc stats runs/windy --given 'initial.alpha_deg>5'
      sepmc stats runs/windy --columns 'separation_*'
      sepmc stats runs/windy --json | jq .outcomes.separation_speed_m_s.p99
    """
    with plain_errors(False):
        from sepmc.campaign.store import folders, shards

        if shards.read_history(folder) is not None:
            raise folders.StoreError(f"{folder}: is a single run, which has no statistics")
        manifest = manifest_with_rows(folder)
        loaded = load_campaign(str(folder), (), warn=False)
        check_required(loaded, must_pass)
        if given:
            if must_pass:
                raise click.UsageError("--check is of all cases, without --given")
            tell_given(folder, loaded, given, columns, as_json)
            return
        summary = summary_of(folder, loaded)
        if not manifest.get("complete", True):
            held = sum(summary.counts.values())
            click.echo(
                f"warning: the run is not complete: {held} of {manifest.get('cases')} cases",
                err=True,
            )
        for note in manifest.get("notes", ()):
            click.echo(f"warning: {note}", err=True)
        code = tell_results(
            folder,
            loaded,
            summary,
            speaker(quiet=as_json),
            plots=False,
            check=must_pass,
            shown=columns,
        )
        if as_json:
            click.echo((folder / "statistics.json").read_text(encoding="utf-8"), nl=False)
    sys.exit(code)


@click.command()
@RUN
@click.option("--all", "every", is_flag=True, help="A histogram of every outcome, not of twelve.")
@click.option(
    "--format",
    "ending",
    type=click.Choice(("png", "svg", "pdf")),
    default="png",
    show_default=True,
    help="Of the files; PNG at 300 dots an inch.",
)
def plot(folder: Path, every: bool, ending: str) -> None:
    """Draw the figures of RUN again, from its files alone, fit for print, a histogram of each
    outcome by itself, and how its means converge.

    \b
    Example:
      sepmc plot runs/windy --all --format pdf
    """
    with plain_errors(False):
        from sepmc.campaign.label import of_case
        from sepmc.campaign.store import manifests, shards
        from sepmc.report.history_figures import run_figures
        from sepmc.report.style import PRINTED, resolution

        history, suffix = shards.read_history(folder), f".{ending}"
        with resolution(PRINTED):
            if history is not None:
                told = manifests.read_manifest(folder)
                about = of_case(told["campaign"], told["case"], told.get("settings", {}))
                written = run_figures(
                    history,
                    folder,
                    told["bodies"],
                    told["joints"],
                    about,
                    suffix,
                    required=clearance_bounds(load_campaign(str(folder), (), warn=False)),
                    marks=marks_of(told),
                )
            else:
                told = manifests.read_manifest(folder)
                if not (told.get("stats_only") and told.get("complete")):
                    manifest_with_rows(folder)
                draw = partial(
                    draw_figures,
                    every=every,
                    say=partial(click.echo, err=True),
                    suffix=suffix,
                    alone=True,
                )
                loaded = load_campaign(str(folder), (), warn=False)
                if told.get("stats_only"):
                    written = draw(folder, loaded, shards.read_stored_statistics(folder))
                else:
                    summary, accuracy = summary_of(folder, loaded), told.get("accuracy") or {}
                    table = statistics_of(loaded, summary, accuracy)
                    verdicts = verdicts_of(loaded, summary, accuracy, table, summary.audit())
                    written = draw(
                        folder, loaded, summary, table, verdicts=verdicts, converging=True
                    )
                manifests.record_derived(folder, written)
        for path in written:
            click.echo(path)


@click.command(short_help="Say what is wrong with RUN, file by file.")
@RUN
@click.option(
    "--repair", is_flag=True, help="Fly, count and draw again what is gone, or was changed."
)
@QUIET
def doctor(folder: Path, repair: bool, quiet: bool) -> None:
    """Say what is wrong with RUN, file by file: what is gone, was cut short or changed since it was
    written, and what was never finished. Exit code 1 if something is. With --repair it is flown,
    counted and drawn again, to the same bits, but for the campaign itself.

    \b
    Example:
      sepmc doctor runs/windy --repair
    """
    say = speaker(quiet)
    with plain_errors(quiet):
        from sepmc.campaign.store import manifests

        found = manifests.diagnose(folder)
        for finding in found:
            click.echo(finding.text)
        if not found:
            say(f"{folder}: is as it was written")
            return
        if not repair:
            how = (one.advice for one in found if not one.repairable)
            click.echo(next(how, f"to mend it: sepmc doctor {folder} --repair"), err=True)
            sys.exit(1)
        from sepmc.cli.doctor import mend

        code = mend(folder, found, say)
    sys.exit(code)


@click.command(short_help="What drives the outcomes of RUN, and what its failures have in common.")
@RUN
@click.argument("outcomes", metavar="[OUTCOME]...", nargs=-1)
@NO_PLOTS
def drivers(folder: Path, outcomes: tuple[str, ...], no_plots: bool) -> None:
    """Which inputs drive each OUTCOME of RUN, or the four that matter most: first-order indices
    (of a Saltelli campaign total ones too), rank and partial rank correlation, and the means where
    the input is lowest and highest; inputs of the surest index first, among them those that shift
    the mean farthest. Then which inputs, and pairs of inputs, set apart the cases that violate a
    requirement or did not come to their end. Writes drivers.csv (what it has of other outcomes
    stays), causes.csv, drivers.png and scatter.png into RUN.

    \b
    Sampler of RUN    first-order index, 95 % interval     total  what sets cases apart
      random, a plan  of neighbours, or of groups          -      by the G-test
      lhs             the same, holds at least 95 %        -      by the G-test
      sobol           none: its points are patterned       -      none
      saltelli        of the design                        yes    none

    Indices have no intervals where few cases, far from the others, decide the outcome's variance;
    inputs that vary together are named, as their indices do not add up.

    \b
    Example:
      sepmc drivers runs/windy upper_pitch_deg separation_speed_m_s
    """
    with plain_errors(False):
        from sepmc.cli.report import tell_drivers

        manifest_with_rows(folder)
        tell_drivers(
            folder, load_campaign(str(folder), (), warn=False), outcomes, plots=not no_plots
        )


@click.command(short_help="Which laws the outcomes of RUN follow, and whether they are normal.")
@RUN
@click.argument("outcomes", metavar="[OUTCOME]...", nargs=-1)
def laws(folder: Path, outcomes: tuple[str, ...]) -> None:
    """Which law each OUTCOME of RUN follows, or those that matter most: skewness and kurtosis
    (with one standard error, if it is normal), whether it may be normal, the nearest of six laws,
    and where that puts the 99.865 % point beside where the cases put it. Writes laws.csv, of all
    outcomes, into RUN.

    \b
    Example:
      sepmc laws runs/windy separation_speed_m_s
    """
    with plain_errors(False):
        from sepmc.cli.report import tell_laws

        manifest_with_rows(folder)
        tell_laws(folder, load_campaign(str(folder), (), warn=False), outcomes)


@click.command(short_help="What differs between two runs.")
@click.argument("one", metavar="RUN_A", type=Place())
@click.argument("two", metavar="RUN_B", type=Place())
@click.option(
    "--out", type=click.Path(path_type=Path), help="Folder for compare.csv and compare.png."
)
@click.option("--overwrite", is_flag=True, help="Replace the comparison in --out.")
def compare(one: Path, two: Path, out: Path | None, overwrite: bool) -> None:
    """What differs between RUN_A and RUN_B: in their files, in statuses and verdicts, and in their
    outcomes, with a 95 % interval of each difference: of pairs of cases of the same number
    (Student's t), if both runs have the same inputs there but for those that the files change, as
    with one seed; else of independent samples (Welch). What is yes or no is compared as a share.

    \b
    Example:
      sepmc compare runs/windy runs/calm --out windy-calm
    """
    with plain_errors(False):
        from sepmc.cli.report import tell_comparison

        manifest_with_rows(one)
        manifest_with_rows(two)
        first, second = (load_campaign(str(folder), (), warn=False) for folder in (one, two))
        tell_comparison((one, two), (first, second), out, overwrite)


@click.command()
@RUN
@click.option("--no-replay", is_flag=True, help="Do not fly the worst cases again.")
@QUIET
def report(folder: Path, no_replay: bool, quiet: bool) -> None:
    """Write the report of RUN, report.html: verdicts, statistics, figures, what drives the
    outcomes, the worst cases over time, and how it was flown, in one page that needs no network.

    \b
    Example:
      sepmc report runs/windy
    """
    say = speaker(quiet)
    with plain_errors(quiet):
        from sepmc.cli.report import tell_report

        manifest_with_rows(folder)
        loaded = load_campaign(str(folder), (), warn=False)
        say(f"wrote {tell_report(folder, loaded, not no_replay, say)}")
