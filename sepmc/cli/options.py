"""Options that commands share, and how they read a campaign."""

import warnings
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click
from click.shell_completion import CompletionItem

if TYPE_CHECKING:
    from sepmc.campaign.campaign import Campaign
    from sepmc.campaign.case_selection import CaseSelection


def _files(ctx: click.Context, param: click.Parameter, begun: str) -> list[CompletionItem]:
    """What FILE can be completed to: shipped campaigns, and files and folders here."""
    from sepmc.scene.read import shipped_campaigns

    shipped = [name for name in shipped_campaigns() if name.startswith(begun)]
    return [*map(CompletionItem, shipped), CompletionItem(begun, type="file")]


FILE = click.argument("file", shell_complete=_files)


class CaseNumbers(click.ParamType):
    """How many cases, or which: 1000, 1e6, 25:50,73."""

    name = "N | A:B,C"

    def convert(
        self, value: Any, param: click.Parameter | None, ctx: click.Context | None
    ) -> "int | CaseSelection":
        """The number, or the numbers."""
        from sepmc.campaign.case_selection import read
        from sepmc.scene.messages import InputError

        try:
            return read(value)
        except InputError as error:
            self.fail(str(error).partition(": ")[2], param, ctx)


CASES = click.option(
    "--cases",
    type=CaseNumbers(),
    help="How many cases (1000, 1e6), or which (25:50,73: cases 25 to 49, and 73), instead of the "
    "file's.",
)
SEED = click.option("--seed", type=click.IntRange(min=0), help="Seed, instead of the file's.")
SAMPLER = click.option(
    "--sampler",
    type=click.Choice(("random", "lhs", "sobol", "saltelli")),
    help="How cases are drawn, instead of the file's run.sampler.",
)
EVERY = click.option(
    "--every-s",
    type=click.FloatRange(min=0.0, min_open=True),
    default=0.001,
    show_default=True,
    help="Time between rows.",
)
SETTINGS = click.option(
    "--set",
    "settings",
    multiple=True,
    metavar="PATH=VALUE",
    help="Put a value in place, e.g. body.upper.mass_kg=460.",
)


class Place(click.ParamType):
    """A folder of this machine or of object storage."""

    name = "path"

    def convert(self, value: Any, param: click.Parameter | None, ctx: click.Context | None) -> Path:
        """Its path."""
        from sepmc.paths import PathError, as_path

        try:
            return as_path(value)
        except PathError as error:
            self.fail(str(error), param, ctx)


RUN = click.argument("folder", metavar="RUN", type=Place())
OUT = click.option(
    "--out",
    type=Place(),
    help="Run folder to write, also s3://BUCKET/RUN; default runs/NAME-N.",
)
OVERWRITE = click.option("--overwrite", is_flag=True, help="Replace the run in --out.")
NO_PLOTS = click.option("--no-plots", is_flag=True, help="Write no figures.")
CHECK = click.option(
    "--check",
    "must_pass",
    is_flag=True,
    help="Exit code 1 unless the cases show all that the file requires.",
)
BRIEF = click.option("--brief", is_flag=True, help="A row for each group of lines only.")
QUIET = click.option("--quiet", is_flag=True, help="Print nothing but errors.")


def load_campaign(
    file: str,
    settings: tuple[str, ...],
    warn: bool = True,
    sampler: str | None = None,
    plan: Path | None = None,
    verify: bool = True,
) -> "Campaign":
    """Read and validate, before anything is written; a run folder ``verify``-ed too."""
    from sepmc.scene.messages import SceneWarning
    from sepmc.scene.read import parse_setting

    given = dict(parse_setting(text) for text in settings)
    if sampler:
        given["run.sampler"] = sampler
    if plan:
        given["run.samples"] = str(plan.absolute())
    with warnings.catch_warnings(record=True) as caught:
        warnings.simplefilter("always", SceneWarning)
        from sepmc.campaign.campaign import load

        loaded = load(file, given, verify)
    for warning in caught if warn else ():
        click.echo(f"warning: {warning.message}", err=True)
    return loaded


def redundant(campaign: "Campaign") -> list[str]:
    """A sentence for each set of joints that hold a freedom twice."""
    from sepmc.scene.redundancy import redundancies

    return [found.sentence for found in redundancies(campaign.scene)]


def undispersed(campaign: "Campaign") -> list[str]:
    """A sentence for a campaign whose cases do not differ."""
    if campaign.file.dispersions:
        return []
    return ["nothing is dispersed, so every case is the nominal one; give [dispersion]"]


def check_required(campaign: "Campaign", must_pass: bool) -> None:
    """There is nothing to check where nothing is required."""
    if must_pass and not campaign.file.requirements:
        raise click.UsageError(f"--check needs a [[requirement]] in {campaign.name}")
