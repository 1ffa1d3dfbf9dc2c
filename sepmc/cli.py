"""The command line: words in, exit code out. Nothing heavy is imported until a command needs it.

Exit codes: 0 done, 1 flown but no case reached the end (verify, stress: a line failed; campaign
--check: a requirement is not shown), 2 bad input (nothing was flown), 3 flown but the audit failed
or the accuracy asked was not met, 130 interrupted.
"""

import gc
import sys
import time
import warnings
from collections.abc import Callable, Iterable
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from sepmc import __version__
from sepmc.cli_output import (
    INTERRUPTED,
    counted,
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

_SETTINGS = click.option(
    "--set",
    "settings",
    multiple=True,
    metavar="PATH=VALUE",
    help="Put a value in place, e.g. body.upper.mass_kg=460.",
)
_OUT = click.option(
    "--out", type=click.Path(path_type=Path), help="Run folder to write; default runs/NAME-N."
)
_OVERWRITE = click.option("--overwrite", is_flag=True, help="Replace the run in --out.")
_NO_PLOTS = click.option("--no-plots", is_flag=True, help="Write no figures.")
_CHECK = click.option(
    "--check",
    "must_pass",
    is_flag=True,
    help="Exit code 1 unless the cases show all that the file requires.",
)
_BRIEF = click.option("--brief", is_flag=True, help="A row for each group of lines only.")
_QUIET = click.option("--quiet", is_flag=True, help="Print nothing but errors.")


@click.group(context_settings={"help_option_names": ["-h", "--help"], "max_content_width": 110})
@click.version_option(__version__, prog_name="sepmc")
def main() -> None:
    """Monte Carlo of multi-body stage separation by the constraint force equation method.

    \b
    Examples:
      sepmc campaign table2.toml --set body.upper.mass_kg=460 --out runs/heavy
      sepmc run runs/heavy --case 17

    FILE is a campaign file, a run folder, or the name of a shipped campaign (sepmc list). Exit
    codes: 0 done, 1 flown but no case reached the end (verify, stress: a line failed; campaign
    --check: a requirement is not shown), 2 bad input, 3 flown but the audit failed or the accuracy
    asked was not met, 130 interrupted. SEPMC_CACHE_DIR moves the folder of compiled kernels.
    """
    # imports leave 160,000 objects that stay: to look for garbage among them took a sixth of a
    # short command
    gc.set_threshold(100_000)


@main.command(short_help="Fly the dispersed cases of FILE into a run folder.")
@click.argument("file")
@click.option(
    "--cases", type=click.IntRange(min=1, max=10**9), help="Number of cases, instead of the file's."
)
@click.option("--seed", type=click.IntRange(min=0), help="Seed, instead of the file's.")
@click.option(
    "--sampler",
    type=click.Choice(("random", "lhs", "sobol", "saltelli")),
    help="How cases are drawn, instead of the file's run.sampler.",
)
@_OUT
@click.option(
    "--threads",
    type=click.IntRange(min=1),
    help="Threads; default all cores. The result does not depend on it.",
)
@_SETTINGS
@_NO_PLOTS
@_OVERWRITE
@click.option("--resume", is_flag=True, help="Fly only the cases missing in --out.")
@click.option(
    "--stats-only",
    is_flag=True,
    help="Keep statistics and histograms, no case rows: memory and disk do not grow with cases.",
)
@_CHECK
@_QUIET
def campaign(
    file: str,
    cases: int | None,
    seed: int | None,
    sampler: str | None,
    out: Path | None,
    threads: int | None,
    settings: tuple[str, ...],
    no_plots: bool,
    overwrite: bool,
    resume: bool,
    stats_only: bool,
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
        loaded = _load(file, (*settings, f"run.sampler={sampler}") if sampler else settings)
        _check_required(loaded, must_pass)
        from sepmc.campaign import store
        from sepmc.engine.door import check_threads

        check_threads(threads)
        folder = out or store.next_folder(loaded.name)
        n = cases or loaded.scene.run.cases
        with progress_bar(n, quiet) as progress:
            try:
                ways = {"overwrite": overwrite, "resume": resume, "stats_only": stats_only}
                result = loaded.run(
                    cases, seed, threads, folder, **ways, progress=progress, announce=say
                )
            except KeyboardInterrupt:
                what = (
                    f"finished cases are kept. Go on with: sepmc campaign {folder} --out "
                    f"{folder} --resume"
                )
                if stats_only:
                    what = "with --stats-only nothing is kept"
                elif not (folder / store.MANIFEST).is_file():
                    what = "no case was flown yet"
                click.echo(f"\ninterrupted; {what}", err=True)
                sys.exit(INTERRUPTED)
        for note in result.notes + _redundant(loaded) + _undispersed(loaded):
            click.echo(f"warning: {note}", err=True)
        say(timing_line(result))
        code = tell_results(
            folder, loaded, result.kept.summary, say, plots=not no_plots, check=must_pass
        )
    sys.exit(code)


@main.command(short_help="Fly one case of FILE and write its time history.")
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
@_OUT
@_SETTINGS
@_NO_PLOTS
@_OVERWRITE
@_QUIET
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
        loaded = _load(file, settings)
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
        for note in history.attrs["notes"] + ([] if number is None else _undispersed(loaded)):
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


@main.command(short_help="Statistics of RUN again, from its files alone.")
@click.argument("folder", metavar="RUN", type=click.Path(path_type=Path))
@_CHECK
def stats(folder: Path, must_pass: bool) -> None:
    """Compute and print the statistics of RUN again, from its files alone."""
    with plain_errors(False):
        from sepmc.campaign import store

        if store.read_history(folder) is not None:
            raise store.StoreError(f"{folder}: is a single run, which has no statistics")
        manifest = manifest_with_rows(folder)
        loaded = _load(str(folder), (), warn=False)
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


@main.command()
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
            loaded = _load(str(folder), (), warn=False)
            summary, warn = summary_of(folder, loaded), partial(click.echo, err=True)
            written = draw_figures(folder, loaded, summary, every=every, say=warn)
        for path in written:
            click.echo(path)


@main.command(short_help="What drives the outcomes of RUN, and what its failures have in common.")
@click.argument("folder", metavar="RUN", type=click.Path(path_type=Path))
@click.argument("outcomes", metavar="[OUTCOME]...", nargs=-1)
@_NO_PLOTS
def drivers(folder: Path, outcomes: tuple[str, ...], no_plots: bool) -> None:
    """Which inputs drive each OUTCOME of RUN, or the four that matter most: first-order indices
    (of a Saltelli campaign total ones too), rank and partial rank correlation, and the means where
    the input is lowest and highest. Then which inputs, and pairs of inputs, set apart the cases
    that violate a requirement or did not come to their end. Writes drivers.csv, causes.csv and
    drivers.png into RUN."""
    with plain_errors(False):
        from sepmc.cli_report import tell_drivers

        manifest_with_rows(folder)
        tell_drivers(folder, _load(str(folder), (), warn=False), outcomes, plots=not no_plots)


@main.command()
@click.argument("folder", metavar="RUN", type=click.Path(path_type=Path))
@click.option("--no-replay", is_flag=True, help="Do not fly the worst cases again.")
@_QUIET
def report(folder: Path, no_replay: bool, quiet: bool) -> None:
    """Write the report of RUN, report.html: verdicts, statistics, figures, what drives the
    outcomes, the worst cases over time, and how it was flown, in one page that needs no network."""
    say = speaker(quiet)
    with plain_errors(quiet):
        from sepmc.cli_report import tell_report

        manifest_with_rows(folder)
        say(f"wrote {tell_report(folder, _load(str(folder), (), warn=False), not no_replay, say)}")


@main.command()
@click.argument("file")
@_SETTINGS
@click.option(
    "--code", is_flag=True, help="Print the kernel written for the scene instead: a Python module."
)
def check(file: str, settings: tuple[str, ...], code: bool) -> None:
    """Validate FILE and say what it contains, and what the kernel that flies it computes and leaves
    out. Flies nothing."""
    with plain_errors(False):
        loaded = _load(file, settings)
        from sepmc.campaign import pilot
        from sepmc.kernel.emit import features
        from sepmc.kernel.structure import make_shape

        if code:
            click.echo(pilot.kernel_text(loaded, history=loaded.scene.run.history_step > 0.0))
            return
        from sepmc.analysis.requirements import sentence
        from sepmc.campaign.chunks import implausible_note
        from sepmc.campaign.remarks import of_file, sampled
        from sepmc.kernel.describe import lines

        settings_of_run = loaded.scene.run
        click.echo(f"{loaded.name}: {loaded.file.title or 'no title'}")
        for line in lines(loaded.plan):
            click.echo("  " + line)
        shape = make_shape(loaded.plan, loaded.dispersed)
        inside, outside = features(shape)
        click.echo("  kernel       written for the scene (print it with --code)")
        called = shape.names.back
        for stage, stage_name in zip(shape.stages, pilot.stage_names(loaded), strict=True):
            groups = [
                " and ".join(called.get(body, body) for body in group)
                for group in stage.groups
                if len(group) > 1
            ]
            together = (
                "; ".join(group + " turn as one" for group in groups) or "all turn by themselves"
            )
            rows = (
                f", {len(stage.rows)} constraint rows solved" if stage.rows else ", nothing is held"
            )
            click.echo(f"    {stage_name:14s} {together}{rows}")
        click.echo(f"    has in it      {', '.join(inside)}")
        click.echo(f"    left out       {', '.join(outside)}")
        click.echo(
            f"  cases        {settings_of_run.cases}, seed {settings_of_run.seed}, "
            f"sampler {settings_of_run.sampler}"
        )
        click.echo(f"  dispersed    {len(loaded.file.dispersions)} parameters")
        for dispersion in loaded.file.dispersions:
            numbers = ", ".join(f"{x:g}" for x in dispersion.numbers)
            click.echo(
                f"    {dispersion.parameter.key:44s} {dispersion.law} ({numbers}) "
                f"{dispersion.parameter.unit}"
            )
        for copula in loaded.file.copulas:
            keys = [loaded.file.dispersions[place].parameter.key for place in copula.places]
            click.echo(f"    together: {', '.join(keys)}")
        required, units = (
            loaded.file.requirements,
            {c.name: c.unit for c in loaded.outcome_columns},
        )
        click.echo(f"  required     {len(required) or 'nothing'}")
        for item in required:
            click.echo("    " + sentence(item, units.get(item.metric, "")))
        drawn = loaded.draw(0, settings_of_run.cases)
        note = implausible_note(loaded.implausible_inertias(drawn), settings_of_run.cases)
        warned = [*sampled(settings_of_run.sampler, settings_of_run.cases), *of_file(loaded)]
        for warning in warned + ([note] if note else []) + _redundant(loaded):
            click.echo(f"warning: {warning}", err=True)
        click.echo("can be flown")


@main.command(name="compile", short_help="Compile the kernel of FILE ahead.")
@click.argument("file")
@_SETTINGS
@click.option(
    "--stats-only",
    is_flag=True,
    help="The kernel of a campaign with --stats-only, which keeps no histories.",
)
@click.option(
    "--spares",
    is_flag=True,
    help="The kernels, too, that cases may need which the first one does not vouch for.",
)
@_QUIET
def compile_(
    file: str, settings: tuple[str, ...], stats_only: bool, spares: bool, quiet: bool
) -> None:
    """Compile the kernel that flies campaigns of FILE into the cache, so that the first one starts
    at once. Flies nothing."""
    say = speaker(quiet)
    with plain_errors(quiet):
        loaded = _load(file, settings)
        from sepmc.campaign import pilot
        from sepmc.engine.door import load_kernel
        from sepmc.kernel.structure import make_shape
        from sepmc.routines.layout import USUAL

        history = loaded.scene.run.history_step > 0.0 and not stats_only
        cares = [USUAL, *(make_shape(loaded.plan, loaded.dispersed).spares if spares else [])]
        start = time.perf_counter()
        for care in cares:
            load_kernel(pilot.kernel_text(loaded, history=history, care=care), say)
        what = "its kernel is" if len(cares) == 1 else f"its {len(cares)} kernels are"
        say(f"{loaded.name}: {what} in the cache, after {time.perf_counter() - start:.1f} s")


@main.command(
    short_help="Hold the engine against closed forms, other formulations and other engines."
)
@click.option(
    "--peers",
    is_flag=True,
    help="Fly cases with other engines too; needs pip install 'sepmc[peers]'.",
)
@click.option(
    "--random",
    "count",
    type=click.IntRange(min=1),
    help="Instead: fly so many random scenes, and each independently.",
)
@click.option(
    "--seed",
    type=click.IntRange(min=0),
    default=0,
    show_default=True,
    help="With --random: the seed of the first scene.",
)
@click.option(
    "--compiled",
    type=click.IntRange(min=0),
    default=0,
    help="With --random: scenes whose kernels fly compiled as well.",
)
@_BRIEF
@_QUIET
def verify(
    peers: bool, count: int | None, seed: int, compiled: int, brief: bool, quiet: bool
) -> None:
    """Hold the engine against closed forms, classical formulations and conservation laws: one
    table, exit code 1 on any miss.

    With --peers also 20 cases of table2.toml and cases of other campaigns, flown by other engines.
    With --random N, instead, N random scenes flown as a campaign flies them, and every row held
    against an independent flight of its case.
    """
    with plain_errors(quiet):
        if count is not None:
            from sepmc.trust.gate import drive

            found = drive.gate(count, seed, compiled, speaker(quiet))
            click.echo(drive.table(found))
            sys.exit(1 if any(map(drive.fails, found)) else 0)
        from sepmc.trust import verify as suite

        passed = all(
            line.passes for line in _flown(suite, suite.CHECKS, suite.verify, brief, quiet)
        )
        if peers:
            from sepmc.trust.peers import compare

            text, agreed = compare.report(speaker(quiet))
            click.echo("\n" + text)
            passed = passed and agreed
    sys.exit(0 if passed else 1)


@main.command(short_help="Fly purposely hard inputs and say which are accurate, flagged or silent.")
@_BRIEF
@_QUIET
def stress(brief: bool, quiet: bool) -> None:
    """Fly purposely hard inputs: each is accurate to its bound or flagged; exit code 1 if one is
    silently wrong."""
    with plain_errors(quiet):
        from sepmc.trust import stress as suite

        lines = _flown(suite, suite.STRESSES, suite.stress, brief, quiet, here=("hour",))
        click.echo(
            "\nAn hour of torque-free motion in joints, by solver.drift:\n" + suite.hours_table()
        )
    sys.exit(0 if all(line.holds for line in lines) else 1)


@main.command(short_help="Measure speed and accuracy of FILE on this machine.")
@click.argument("file")
@click.option(
    "--peers",
    is_flag=True,
    help="Let other engines fly the same cases too; needs pip install 'sepmc[peers]'.",
)
@click.option(
    "--out", type=click.Path(path_type=Path), help="Folder to write; default runs/bench-NAME-N."
)
@click.option(
    "--cases",
    type=click.IntRange(min=1, max=10**7),
    help="Cases that are timed; default 10000, with --quick 1000.",
)
@click.option(
    "--repeats",
    type=click.IntRange(min=1),
    help="Times of which the median is taken; default 7, with --quick 3.",
)
@click.option("--threads", type=click.IntRange(min=1), help="Threads; default all cores.")
@click.option(
    "--quick",
    is_flag=True,
    help="Fewer settings, and nothing that takes minutes: a look, not a measurement.",
)
@click.option("--overwrite", is_flag=True, help="Replace the bench in --out.")
@_SETTINGS
@_QUIET
def bench(
    file: str,
    peers: bool,
    out: Path | None,
    cases: int | None,
    repeats: int | None,
    threads: int | None,
    quick: bool,
    overwrite: bool,
    settings: tuple[str, ...],
    quiet: bool,
) -> None:
    """Measure speed and accuracy of FILE on this machine: error over time, cost of each feature,
    scaling, time by stage.

    Errors are against a reference at very many steps. Tables go to the screen and as Parquet, with
    bench.json and figures, into a folder.
    """
    with plain_errors(quiet):
        if overwrite and out is None:
            raise click.UsageError("--overwrite needs --out, the folder meant")
        loaded = _load(file, settings)
        from sepmc.bench.bench import bench as measure
        from sepmc.campaign import store

        folder = out or store.next_folder(f"bench-{loaded.name}")
        measure(
            loaded,
            folder,
            speaker(quiet),
            cases=cases,
            repeats=repeats,
            threads=threads,
            quick=quick,
            peers=peers,
            overwrite=overwrite,
        )
        speaker(quiet)(f"wrote {folder}")


def _check_required(campaign: "Campaign", must_pass: bool) -> None:
    """There is nothing to check where nothing is required."""
    if must_pass and not campaign.file.requirements:
        raise click.UsageError(f"--check needs a [[requirement]] in {campaign.name}")


def _undispersed(campaign: "Campaign") -> list[str]:
    """A sentence for a campaign whose cases do not differ."""
    if campaign.file.dispersions:
        return []
    return ["nothing is dispersed, so every case is the nominal one; give [dispersion]"]


def _redundant(campaign: "Campaign") -> list[str]:
    """A sentence for each set of joints that hold a freedom twice."""
    from sepmc.scene.redundancy import redundancies

    return [found.sentence for found in redundancies(campaign.scene)]


def _flown(
    suite: Any,
    names: Iterable[str],
    fly: Callable[..., list[Any]],
    brief: bool,
    quiet: bool,
    here: Iterable[str] = (),
) -> list[Any]:
    """Fly the groups of a suite with a bar, and print its table, or a row for each group. Returns
    all lines."""
    from sepmc.trust.groups import side_by_side

    names = list(names)
    with counted(len(names), quiet) as progress:
        groups = side_by_side(fly, names, here, progress)
    lines = [line for group in groups.values() for line in group]
    click.echo(suite.brief(groups) if brief else suite.table(lines))
    return lines


@main.command(name="list")
def list_campaigns() -> None:
    """List the campaigns that come with sepmc."""
    import tomllib

    from sepmc.scene.read import shipped_campaigns

    for name, path in shipped_campaigns().items():
        click.echo(f"{name:24s} {tomllib.loads(path.read_text(encoding='utf-8')).get('title', '')}")


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

    if number is not None and seed is None and (file / store.MANIFEST).is_file():
        held = store.read_manifest(file).get("cases")
        if isinstance(held, int) and number >= held:
            raise store.StoreError(
                f"{file}: holds cases 0 to {held - 1}; --case {number} is none of them"
            )


def _load(file: str, settings: tuple[str, ...], warn: bool = True) -> "Campaign":
    """Read and validate, before anything is written."""
    from sepmc.scene.messages import SceneWarning
    from sepmc.scene.read import parse_setting

    given = dict(parse_setting(text) for text in settings)
    with warnings.catch_warnings(record=True) as caught:
        warnings.simplefilter("always", SceneWarning)
        from sepmc.campaign.campaign import load

        loaded = load(file, given)
    for warning in caught if warn else ():
        click.echo(f"warning: {warning.message}", err=True)
    return loaded


if __name__ == "__main__":
    main()
