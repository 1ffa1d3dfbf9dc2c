"""Commands that fly cases, and that tell of run folders. Nothing heavy is imported until a command
needs it."""

import sys
import time
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING

import click

from sepmc.cli_options import (
    CASES,
    CHECK,
    NO_PLOTS,
    OUT,
    OVERWRITE,
    QUIET,
    SAMPLER,
    SEED,
    SETTINGS,
    load_campaign,
    redundant,
    undispersed,
)
from sepmc.cli_output import (
    INTERRUPTED,
    draw_figures,
    manifest_with_rows,
    plain_errors,
    progress_bar,
    single_error_text,
    speaker,
    summary_of,
    tell_results,
    timing_line,
)

if TYPE_CHECKING:
    from sepmc.campaign.campaign import Campaign
    from sepmc.campaign.numbers import Numbers


@click.command(short_help="Fly the dispersed cases of FILE into a run folder.")
@click.argument("file")
@CASES
@SEED
@SAMPLER
@click.option(
    "--plan",
    type=click.Path(path_type=Path),
    help="Table of inputs, CSV or Parquet, a row for each case, as sepmc sample writes it.",
)
@OUT
@click.option(
    "--threads",
    type=click.IntRange(min=1),
    help="Threads; default all cores. The result does not depend on it.",
)
@SETTINGS
@NO_PLOTS
@OVERWRITE
@click.option("--resume", is_flag=True, help="Fly only the cases missing in --out.")
@click.option(
    "--stats-only",
    is_flag=True,
    help="Keep statistics and histograms, no case rows: memory and disk do not grow with cases.",
)
@click.option(
    "--until",
    metavar="METRIC:TOLERANCE",
    help="Fly no more cases than it takes to know the mean of METRIC so well (95 %): "
    "separation_speed_m_s:0.01, upper_pitch_deg.p99:1%, or the share of a status.",
)
@click.option("--dry-run", is_flag=True, help="Say what would be flown, and fly nothing.")
@CHECK
@QUIET
def campaign(
    file: str,
    cases: "int | Numbers | None",
    seed: int | None,
    sampler: str | None,
    plan: Path | None,
    out: Path | None,
    threads: int | None,
    settings: tuple[str, ...],
    no_plots: bool,
    overwrite: bool,
    resume: bool,
    stats_only: bool,
    until: str | None,
    dry_run: bool,
    must_pass: bool,
    quiet: bool,
) -> None:
    """Fly the dispersed cases of FILE (a path, a run folder, or a shipped campaign) into a run
    folder.

    With --stats-only the folder holds statistics, histograms, audit and counts, but no cases/ and
    no histories/: for millions of cases. Percentiles are then those of a fine grid of bins, exact
    up to 65,536 cases and within 0.41 % of sigma beyond.
    """
    say = speaker(quiet)
    with plain_errors(quiet):
        if (resume or overwrite) and out is None:
            raise click.UsageError(
                f"--{'resume' if resume else 'overwrite'} needs --out, the run folder meant"
            )
        if resume and overwrite:
            raise click.UsageError("--resume and --overwrite exclude each other")
        if resume and stats_only:
            raise click.UsageError(
                "--stats-only keeps no cases to go on from, so it excludes --resume"
            )
        loaded = load_campaign(file, settings, sampler=sampler, plan=plan)
        _check_required(loaded, must_pass)
        from sepmc.campaign import store
        from sepmc.engine.door import check_threads

        check_threads(threads)
        folder = out or store.next_folder(loaded.name)
        numbers, _ = loaded.asked(cases)
        if dry_run:
            from sepmc.cli_plan import tell_plan

            tell_plan(loaded, cases, seed, folder, stats_only, click.echo)
            return
        with progress_bar(numbers.count, quiet) as progress:
            try:
                result = loaded.run(
                    cases,
                    seed,
                    threads,
                    folder,
                    overwrite=overwrite,
                    resume=resume,
                    stats_only=stats_only,
                    until=until,
                    progress=progress,
                    announce=say,
                )
            except KeyboardInterrupt:
                which = "" if numbers.are_first else f" --cases {numbers}"
                what = (
                    f"finished cases are kept. Go on with: sepmc campaign {folder} --out "
                    f"{folder} --resume{which}"
                )
                if stats_only:
                    what = "with --stats-only nothing is kept"
                elif not (folder / store.MANIFEST).is_file():
                    what = "no case was flown yet"
                click.echo(f"\ninterrupted; {what}", err=True)
                sys.exit(INTERRUPTED)
        for note in result.notes + redundant(loaded) + undispersed(loaded):
            click.echo(f"warning: {note}", err=True)
        say(timing_line(result))
        code = tell_results(
            folder, loaded, result.kept.summary, say, plots=not no_plots, check=must_pass
        )
    sys.exit(code)


@click.command(short_help="Write the table of inputs of FILE's cases.")
@click.argument("file")
@CASES
@SEED
@SAMPLER
@SETTINGS
@click.option(
    "--out", type=click.Path(path_type=Path), help="CSV or Parquet to write; default NAME.parquet."
)
@click.option("--overwrite", is_flag=True, help="Replace the table in --out.")
def sample(
    file: str,
    cases: "int | Numbers | None",
    seed: int | None,
    sampler: str | None,
    settings: tuple[str, ...],
    out: Path | None,
    overwrite: bool,
) -> None:
    """Write the table of inputs of FILE's cases, a row each: columns case and in_..., in the units
    of the file. sepmc campaign FILE --plan TABLE flies exactly these, whoever wrote them; for
    [dispersion] in FILE, a table of an upstream campaign can give any of the inputs."""
    with plain_errors(False):
        from sepmc.cli_plan import write_sample
        from sepmc.scene.messages import InputError

        loaded = load_campaign(file, settings, sampler=sampler)
        path = out or Path(f"{loaded.name}.parquet")
        if path.suffix.lower() not in (".csv", ".parquet"):
            raise InputError(f"--out {path}: must end in .csv or .parquet")
        if path.exists() and not overwrite:
            raise InputError(f"{path}: exists; add --overwrite or choose another --out")
        click.echo(f"wrote {path}: {write_sample(loaded, cases, seed, path)}")


@click.command(short_help="Fly one case of FILE and write its time history.")
@click.argument("file")
@click.option(
    "--case",
    "number",
    type=click.IntRange(min=0),
    help="Dispersed case to fly; default the nominal.",
)
@click.option("--least", metavar="OUTCOME", help="With a run folder: its case of least OUTCOME.")
@click.option(
    "--greatest", metavar="OUTCOME", help="With a run folder: its case of greatest OUTCOME."
)
@click.option("--seed", type=click.IntRange(min=0), help="Seed of the case, instead of the file's.")
@click.option(
    "--every-s",
    type=click.FloatRange(min=0.0, min_open=True),
    default=0.001,
    show_default=True,
    help="Time between rows.",
)
@OUT
@SETTINGS
@NO_PLOTS
@OVERWRITE
@QUIET
def run(
    file: str,
    number: int | None,
    least: str | None,
    greatest: str | None,
    seed: int | None,
    every_s: float,
    out: Path | None,
    settings: tuple[str, ...],
    no_plots: bool,
    overwrite: bool,
    quiet: bool,
) -> None:
    """Fly one case of FILE and write its time history; with a run folder as FILE, --case, --least
    or --greatest replays one of its cases. Exit code 1 if its status is not ok."""
    say = speaker(quiet)
    with plain_errors(quiet):
        loaded = load_campaign(file, settings)
        from sepmc import schema
        from sepmc.campaign import store
        from sepmc.engine.door import check_every

        check_every(every_s, loaded.scene, "--every-s")
        if least or greatest:
            if (number, seed) != (None, None) or (least and greatest):
                raise click.UsageError("give one of --case, --least and --greatest, and no --seed")
            number = _extreme(Path(file), loaded, least or greatest or "", bool(least))
            say(f"{file}: case {number} has the {'least' if least else 'greatest'} of them")
        _check_held(Path(file), number, seed)
        case = loaded.nominal() if number is None else loaded.case(number, seed)
        folder = out or store.next_folder(
            loaded.name if number is None else f"{loaded.name}-case{number}"
        )
        store.open_folder(folder, overwrite, resumable=False)
        start = time.perf_counter()
        history = loaded.simulate(case, every_s, say)
        seconds = time.perf_counter() - start
        meanings = {c.name: c.meaning for c in schema.history_columns(loaded.plan.contents)}
        store.write_history(folder, history, meanings)
        store.write_text(folder / store.CAMPAIGN, loaded.file.toml)
        manifest = {
            "campaign": loaded.name,
            "digest": loaded.digest,
            "case": None if number is None else number,
            "seed": None if number is None else loaded.scene.run.seed if seed is None else seed,
            "inputs": case.inputs,
            "status": history.attrs["status"],
            "compiled": history.attrs["compiled"],
            "outcomes": history.attrs["outcomes"],
            "errors": history.attrs["errors"],
            "notes": history.attrs["notes"],
            "bodies": loaded.plan.bodies,
            "joints": list(loaded.plan.joints),
            **store.versions(),
        }
        store.write_json(folder / store.MANIFEST, manifest)
        status = schema.Status[history.attrs["status"].upper().replace("-", "_")]
        say(
            f"{loaded.name}, {'nominal' if number is None else f'case {number}'}: {status.label}: "
            f"{status.sentence}"
        )
        for name, value in case.inputs.items():
            say(f"  {name:44s} {value:.9g}")
        for name, value in history.attrs["outcomes"].items():
            say(f"  {name:44s} {value:.9g}")
        for note in history.attrs["notes"] + ([] if number is None else undispersed(loaded)):
            click.echo(f"warning: {note}", err=True)
        error = single_error_text(history.attrs["outcomes"], history.attrs["errors"], loaded)
        if error is not None:
            say(error)
        how = "compiled" if history.attrs["compiled"] else "in plain Python"
        say(f"flown by the kernel written for it, {how}, in {seconds:.2f} s; {len(history)} rows")
        if not no_plots:
            from sepmc.report.figures import run_figures

            run_figures(
                history,
                folder,
                loaded.plan.bodies,
                list(loaded.plan.joints),
                f"{loaded.name}, {'nominal case' if number is None else f'case {number}'}",
            )
        say(f"wrote {folder}")
    sys.exit(0 if status is schema.Status.OK else 1)


@click.command(short_help="Statistics of RUN again, from its files alone.")
@click.argument("folder", metavar="RUN", type=click.Path(path_type=Path))
@CHECK
def stats(folder: Path, must_pass: bool) -> None:
    """Compute and print the statistics of RUN again, from its files alone."""
    with plain_errors(False):
        from sepmc.campaign import store

        if store.read_history(folder) is not None:
            raise store.StoreError(f"{folder}: is a single run, which has no statistics")
        manifest = manifest_with_rows(folder)
        loaded = load_campaign(str(folder), (), warn=False)
        _check_required(loaded, must_pass)
        summary = summary_of(folder, loaded)
        if not manifest.get("complete", True):
            held = sum(summary.counts.values())
            click.echo(
                f"warning: the run is not complete: {held} of {manifest.get('cases')} cases",
                err=True,
            )
        for note in manifest.get("notes", ()):
            click.echo(f"warning: {note}", err=True)
        code = tell_results(folder, loaded, summary, click.echo, plots=False, check=must_pass)
    sys.exit(code)


@click.command()
@click.argument("folder", metavar="RUN", type=click.Path(path_type=Path))
@click.option("--all", "every", is_flag=True, help="A histogram of every outcome, not of twelve.")
def plot(folder: Path, every: bool) -> None:
    """Draw the figures of RUN again, from its files alone."""
    with plain_errors(False):
        from sepmc.campaign import store
        from sepmc.report.figures import run_figures

        history = store.read_history(folder)
        if history is not None:
            manifest = store.read_manifest(folder)
            number = manifest["case"]
            about = (
                f"{manifest['campaign']}, {'nominal case' if number is None else f'case {number}'}"
            )
            written = run_figures(history, folder, manifest["bodies"], manifest["joints"], about)
        else:
            manifest_with_rows(folder)
            loaded = load_campaign(str(folder), (), warn=False)
            summary, warn = summary_of(folder, loaded), partial(click.echo, err=True)
            written = draw_figures(folder, loaded, summary, every=every, say=warn)
        for path in written:
            click.echo(path)


@click.command(short_help="What drives the outcomes of RUN, and what its failures have in common.")
@click.argument("folder", metavar="RUN", type=click.Path(path_type=Path))
@click.argument("outcomes", metavar="[OUTCOME]...", nargs=-1)
@NO_PLOTS
def drivers(folder: Path, outcomes: tuple[str, ...], no_plots: bool) -> None:
    """Which inputs drive each OUTCOME of RUN, or the four that matter most: first-order indices
    (of a Saltelli campaign total ones too), rank and partial rank correlation, and the means where
    the input is lowest and highest. Then which inputs, and pairs of inputs, set apart the cases
    that violate a requirement or did not come to their end. Writes drivers.csv, causes.csv and
    drivers.png into RUN."""
    with plain_errors(False):
        from sepmc.cli_report import tell_drivers

        manifest_with_rows(folder)
        tell_drivers(
            folder, load_campaign(str(folder), (), warn=False), outcomes, plots=not no_plots
        )


@click.command(short_help="What differs between two runs.")
@click.argument("one", metavar="RUN_A", type=click.Path(path_type=Path))
@click.argument("two", metavar="RUN_B", type=click.Path(path_type=Path))
@click.option(
    "--out", type=click.Path(path_type=Path), help="Folder for compare.csv and compare.png."
)
def compare(one: Path, two: Path, out: Path | None) -> None:
    """What differs between RUN_A and RUN_B: in their files, in statuses and verdicts, and in their
    outcomes, with a 95 % interval of each difference: of pairs of cases, where both runs have the
    same inputs in a case of the same number, as two runs of one seed have."""
    with plain_errors(False):
        from sepmc.cli_report import tell_comparison

        manifest_with_rows(one)
        manifest_with_rows(two)
        first, second = (load_campaign(str(folder), (), warn=False) for folder in (one, two))
        tell_comparison((one, two), (first, second), out)


@click.command()
@click.argument("folder", metavar="RUN", type=click.Path(path_type=Path))
@click.option("--no-replay", is_flag=True, help="Do not fly the worst cases again.")
@QUIET
def report(folder: Path, no_replay: bool, quiet: bool) -> None:
    """Write the report of RUN, report.html: verdicts, statistics, figures, what drives the
    outcomes, the worst cases over time, and how it was flown, in one page that needs no network."""
    say = speaker(quiet)
    with plain_errors(quiet):
        from sepmc.cli_report import tell_report

        manifest_with_rows(folder)
        loaded = load_campaign(str(folder), (), warn=False)
        say(f"wrote {tell_report(folder, loaded, not no_replay, say)}")


def _check_required(campaign: "Campaign", must_pass: bool) -> None:
    """There is nothing to check where nothing is required."""
    if must_pass and not campaign.file.requirements:
        raise click.UsageError(f"--check needs a [[requirement]] in {campaign.name}")


def _extreme(folder: Path, loaded: "Campaign", outcome: str, least: bool) -> int:
    """The case of a run folder with the least or greatest value of an outcome."""
    from sepmc.campaign import store
    from sepmc.scene.messages import nearest

    known = [column.name for column in loaded.outcome_columns]
    if outcome not in known:
        raise store.StoreError(f"{outcome}: no such outcome; {nearest(outcome, known)}")
    manifest_with_rows(folder)
    rows = store.read_cases(folder, columns=["case", "status", outcome])
    there = ((rows["status"] == "ok") & rows[outcome].notna()).to_numpy()
    if not there.any():
        raise store.StoreError(f"{folder}: no ok case has {outcome}")
    numbers, values = rows["case"].to_numpy()[there], rows[outcome].to_numpy()[there]
    return int(numbers[values.argmin() if least else values.argmax()])


def _check_held(file: Path, number: int | None, seed: int | None) -> None:
    """A case replayed from a run folder must be one that the run holds."""
    from sepmc.campaign import store
    from sepmc.campaign.numbers import named

    if number is not None and seed is None and (file / store.MANIFEST).is_file():
        held = store.read_manifest(file).get("cases")
        which = store.read_manifest(file).get("numbers")
        if which and number not in named(which):
            raise store.StoreError(f"{file}: holds cases {which}; --case {number} is none of them")
        if not which and isinstance(held, int) and number >= held:
            raise store.StoreError(
                f"{file}: holds cases 0 to {held - 1}; --case {number} is none of them"
            )
