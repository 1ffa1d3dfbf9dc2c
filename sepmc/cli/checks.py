"""Commands about campaign files, about kernels, and about trust in both. Nothing heavy is imported
until a command needs it."""

import sys
import time
import warnings
from collections.abc import Callable, Iterable
from itertools import islice
from pathlib import Path
from textwrap import fill
from typing import TYPE_CHECKING, Any

import click

from sepmc.cli.options import (
    BRIEF,
    FILE,
    QUIET,
    SETTINGS,
    load_campaign,
    redundant,
    undispersed,
)
from sepmc.cli.render import counted, plain_errors, speaker

if TYPE_CHECKING:
    from sepmc.campaign.campaign import Campaign

# cases that are drawn at once, and how often at most, to count inertias that no solid body has
_DRAWN, _TIMES = 65_536, 16
_ROUGH = 1e-4  # accuracy of the flight that looks for slips
_WORK = 1.2e7  # lines of a kernel that it flies at most: 4 s


@click.command(short_help="Write a starter campaign.")
@click.argument("file", default="separation.toml", type=click.Path(path_type=Path))
@click.option("--overwrite", is_flag=True, help="Replace FILE.")
def template(file: Path, overwrite: bool) -> None:
    """Write a commented campaign to start from into FILE (separation.toml): two stages, springs, a
    motor, a clearance and two requirements. It can be flown as it is.

    \b
    Example:
      sepmc template rocket.toml
    """
    from importlib.resources import files

    with plain_errors(False):
        from sepmc.scene.messages import InputError

        if file.exists() and not overwrite:
            raise InputError(f"{file}: is there already; give another name, or --overwrite")
        text = files("sepmc").joinpath("template.toml").read_text(encoding="utf-8")
        try:
            file.write_text(text.replace("separation.toml", file.name), encoding="utf-8")
        except OSError as error:
            raise InputError(f"{file}: cannot be written: {error.strerror}") from None
        click.echo(f"wrote {file}; fly it with: sepmc campaign {file}")


@click.command(name="list")
def list_campaigns() -> None:
    """List the campaigns that come with sepmc.

    \b
    Example:
      sepmc list
    """
    import tomllib

    from sepmc.scene.read import shipped_campaigns

    for name, path in shipped_campaigns().items():
        click.echo(f"{name:24s} {tomllib.loads(path.read_text(encoding='utf-8')).get('title', '')}")


@click.command()
@FILE
@SETTINGS
@click.option(
    "--code", is_flag=True, help="Print the kernel written for the scene instead: a Python module."
)
@click.option("--no-flight", is_flag=True, help="Do not fly the nominal case.")
def check(file: str, settings: tuple[str, ...], code: bool, no_flight: bool) -> None:
    """Validate FILE and say what it contains, and what the kernel that flies it computes and leaves
    out. Warns of what is probably a slip; last, its nominal case is flown for that, roughly, some
    seconds at most.

    \b
    Examples:
      sepmc check table2.toml --set body.upper.mass_kg=460
      sepmc check table2.toml --code > kernel.py
    """
    with plain_errors(False):
        loaded = load_campaign(file, settings)
        from sepmc.campaign.execution import step_selection
        from sepmc.kernel.emit.module import features
        from sepmc.kernel.spec.structure import make_shape

        shape = make_shape(loaded.plan, loaded.dispersed)
        if code:
            for line in shape.names.legend:
                click.echo(fill(line, 100, initial_indent="# ", subsequent_indent="#   "))
            click.echo(
                step_selection.kernel_text(loaded, history=loaded.scene.run.history_step > 0.0)
            )
            return
        from sepmc.analysis.requirements import sentence
        from sepmc.campaign.execution.diagnostics import file_notes, sampling_notes
        from sepmc.campaign.execution.runner import implausible_note
        from sepmc.kernel.spec.describe import lines
        from sepmc.scene.units import unit_text

        settings_of_run = loaded.scene.run
        click.echo(f"{loaded.name}: {loaded.file.title or 'no title'}")
        for line in lines(loaded.plan):
            click.echo("  " + line)
        inside, outside = features(shape)
        click.echo("  kernel       written for the scene (print it with --code)")
        called = shape.names.back
        for stage, stage_name in zip(shape.stages, step_selection.stage_names(loaded), strict=True):
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
        numbers, total = loaded.select_cases()
        which = "" if numbers.are_first else f" ({numbers})"
        click.echo(
            f"  cases        {numbers.count}{which}, seed {settings_of_run.seed}, "
            f"sampler {settings_of_run.sampler}"
        )
        click.echo(f"  dispersed    {len(loaded.file.dispersions)} parameters")
        for dispersion in loaded.file.dispersions:
            key, _, law = dispersion.sentence.partition(": ")
            click.echo(f"    {key:44s} {law} {unit_text(dispersion.parameter.unit)}")
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
        broken = drawn = 0
        for first, end in islice(numbers.split(_DRAWN), _TIMES):
            broken += loaded.implausible_inertias(loaded.sample(first, end - first, None, total))
            drawn += end - first
        note = implausible_note(broken, drawn)
        warned = [*sampling_notes(loaded, numbers), *file_notes(loaded)]
        warned += undispersed(loaded)
        warned += ([note] if note else []) + redundant(loaded)
        for warning in warned:
            click.echo(f"warning: {warning}", err=True)
        if not no_flight and not _nominal_told(loaded, warned):
            click.echo("can be read; whether it can be flown is not known")
            return
        click.echo("can be flown")


def _nominal_told(loaded: "Campaign", warned: list[str]) -> bool:
    """Fly the nominal case roughly, and tell of it what is not ``warned`` of yet. Returns whether
    it was flown to its end in the work that a check may take."""
    from sepmc.campaign.execution.diagnostics import nominal_notes
    from sepmc.campaign.execution.single_case import UnknownError
    from sepmc.scene.messages import SceneWarning, nobody

    with warnings.catch_warnings():  # the file's are told already
        warnings.simplefilter("ignore", SceneWarning)
        rough = loaded.with_settings({"solver.accuracy": _ROUGH})
    try:
        flown = rough.simulate(
            step_s=rough.scene.run.end_time, announce=nobody, plain_work=_WORK
        ).attrs
    except UnknownError as unknown:
        click.echo("  nominal      not flown to its end")
        click.echo(f"warning: nominal flight not flown to its end: {unknown}", err=True)
        return False
    click.echo(f"  nominal      {flown['status']}")
    springs = flown["springs"] if flown["status"] in ("ok", "never-released") else None
    for warning in [*flown["notes"], *nominal_notes(loaded, flown["outcomes"], springs)]:
        if warning not in warned:
            click.echo(f"warning: {warning}", err=True)
    return True


@click.command(short_help="Draw the vehicle of FILE.")
@FILE
@SETTINGS
@click.option(
    "--out", type=click.Path(path_type=Path), help="PNG, SVG or PDF to write; default NAME.png."
)
@click.option("--overwrite", is_flag=True, help="Replace the drawing in --out.")
def draw(file: str, settings: tuple[str, ...], out: Path | None, overwrite: bool) -> None:
    """Draw the vehicle of FILE as it starts, from the side, from above and from behind: outlines,
    centres of mass, joints, springs, motors with their thrust.

    \b
    Example:
      sepmc draw srb.toml --out srb.svg
    """
    with plain_errors(False):
        loaded = load_campaign(file, settings)
        from sepmc.campaign.label import of_settings
        from sepmc.report.drawing import drawing
        from sepmc.scene.messages import InputError

        path = out or Path(f"{loaded.name}.png")
        if path.suffix not in (".png", ".svg", ".pdf"):
            raise InputError(f"{path}: must end with .png, .svg or .pdf")
        if path.exists() and not overwrite:
            raise InputError(f"{path}: is there already; give another name, or --overwrite")
        said = loaded.file.title.replace("$", r"\$")  # or it would be set as a formula
        title = f"{loaded.name}: {said}" if said else loaded.name
        title += of_settings(loaded.settings)
        try:
            click.echo(f"wrote {drawing(loaded.scene, loaded.file.dispersions, title, path)}")
        except OSError as error:
            raise InputError(f"{path}: cannot be written: {error.strerror}") from None


@click.command(name="compile", short_help="Compile the kernel of FILE ahead.")
@FILE
@SETTINGS
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
@QUIET
def compile_(
    file: str, settings: tuple[str, ...], stats_only: bool, spares: bool, quiet: bool
) -> None:
    """Compile the kernel that flies campaigns of FILE into the cache, so that the first one starts
    at once. Flies nothing.

    \b
    Example:
      sepmc compile srb.toml --spares
    """
    say = speaker(quiet)
    with plain_errors(quiet):
        loaded = load_campaign(file, settings)
        from sepmc.campaign.execution import step_selection
        from sepmc.engine.dispatch import load_kernel
        from sepmc.kernel.spec.structure import make_shape
        from sepmc.routines.layout import USUAL

        history = loaded.scene.run.history_step > 0.0 and not stats_only
        cares = [USUAL, *(make_shape(loaded.plan, loaded.dispersed).spares if spares else [])]
        start = time.perf_counter()
        for care in cares:
            load_kernel(step_selection.kernel_text(loaded, history=history, variant=care), say)
        what = "its kernel is" if len(cares) == 1 else f"its {len(cares)} kernels are"
        say(f"{loaded.name}: {what} in the cache, after {time.perf_counter() - start:.1f} s")


@click.command(
    short_help="Hold the engine against closed forms, other formulations and conservation laws."
)
@BRIEF
@QUIET
def verify(brief: bool, quiet: bool) -> None:
    """Hold the engine against closed forms, classical formulations and conservation laws: one
    table, exit code 1 on any miss.

    \b
    Example:
      sepmc verify --brief
    """
    with plain_errors(quiet):
        from sepmc.validation import verify as suite

        passed = all(
            line.passes for line in _flown(suite, suite.CHECKS, suite.verify, brief, quiet)
        )
    sys.exit(0 if passed else 1)


@click.command(
    short_help="Fly purposely hard inputs and say which are accurate, flagged or silent."
)
@BRIEF
@QUIET
def stress(brief: bool, quiet: bool) -> None:
    """Fly purposely hard inputs: each is accurate to its bound or flagged; exit code 1 if one is
    silently wrong.

    \b
    Example:
      sepmc stress --brief
    """
    with plain_errors(quiet):
        from sepmc.validation import stress as suite

        lines = _flown(suite, suite.STRESSES, suite.stress, brief, quiet, here=("hour",))
        click.echo(
            "\nAn hour of torque-free motion in joints, by solver.drift:\n" + suite.hours_table()
        )
    sys.exit(0 if all(line.holds for line in lines) else 1)


@click.command(short_help="Measure speed and accuracy of FILE on this machine.")
@FILE
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
@SETTINGS
@QUIET
def bench(
    file: str,
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
    bench.json and figures, into a folder. It takes 4 to 10 minutes on two cores, a minute or two
    with --quick.

    \b
    Example:
      sepmc bench table2.toml --quick
    """
    with plain_errors(quiet):
        if overwrite and out is None:
            raise click.UsageError("--overwrite needs --out, the folder meant")
        loaded = load_campaign(file, settings)
        from sepmc.bench.bench import bench as measure
        from sepmc.campaign.store import folders

        folder = out or folders.next_folder(f"bench-{loaded.name}")
        measure(
            loaded,
            folder,
            speaker(quiet),
            cases=cases,
            repeats=repeats,
            threads=threads,
            quick=quick,
            overwrite=overwrite,
        )
        speaker(quiet)(f"wrote {folder}")


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
    from sepmc.validation.groups import side_by_side

    names = list(names)
    with counted(len(names), quiet) as progress:
        groups = side_by_side(fly, names, here, progress)
    lines = [line for group in groups.values() for line in group]
    click.echo(suite.brief(groups) if brief else suite.table(lines))
    return lines
