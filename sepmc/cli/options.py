"""Options that commands share, and how commands load a campaign."""

import warnings
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click
from click.shell_completion import CompletionItem

from sepmc.wording import exists

if TYPE_CHECKING:
    from sepmc.campaign.campaign import Campaign
    from sepmc.campaign.case_selection import CaseSelection


def _files(ctx: click.Context, param: click.Parameter, incomplete: str) -> list[CompletionItem]:
    """Return the shell completions of the argument FILE: names of shipped campaigns that begin with
    ``incomplete``, and local files and folders."""
    from sepmc.scene.campaign_files import shipped_campaigns

    shipped = [name for name in shipped_campaigns() if name.startswith(incomplete)]
    return [*map(CompletionItem, shipped), CompletionItem(incomplete, type="file")]


class CaseNumbers(click.ParamType):
    """Option type: a number of cases (1000, 1e6), which becomes an int, or case numbers, which
    become a CaseSelection: 25:50,73 are the cases 25 to 49, and 73."""

    name = "N | A:B,C"

    def convert(
        self, value: Any, param: click.Parameter | None, ctx: click.Context | None
    ) -> "int | CaseSelection":
        """Convert the text to a number of cases (int) or to case numbers (CaseSelection)."""
        from sepmc.campaign.case_selection import read
        from sepmc.scene.messages import InputError

        try:
            return read(value)
        except InputError as error:
            self.fail(str(error).partition(": ")[2], param, ctx)


class Folder(click.ParamType):
    """Option type: path of a folder, local or in object storage."""

    name = "path"

    def convert(self, value: Any, param: click.Parameter | None, ctx: click.Context | None) -> Path:
        """Convert the text to a path; one that is not valid ends the command with a usage error."""
        from sepmc.paths import PathError, as_path

        try:
            return as_path(value)
        except PathError as error:
            self.fail(str(error), param, ctx)


FILE = click.argument("file", shell_complete=_files)
RUN = click.argument("folder", metavar="RUN", type=Folder())
OUTCOMES = click.argument("outcomes", metavar="[OUTCOME]...", nargs=-1)
CASES = click.option(
    "--cases",
    type=CaseNumbers(),
    help="Number of cases (1000, 1e6), or which cases (25:50,73: cases 25 to 49, and 73). "
    "Default: run.cases of the file.",
)
SEED = click.option(
    "--seed", type=click.IntRange(min=0), help="Random seed. Default: run.seed of the file."
)
SAMPLER = click.option(
    "--sampler",
    type=click.Choice(("random", "lhs", "sobol", "saltelli")),
    help="Sampling method. Default: run.sampler of the file.",
)
THREADS = click.option(
    "--threads",
    type=click.IntRange(min=1),
    help="Threads. Default: all cores. The result does not depend on it.",
)
EVERY = click.option(
    "--every-s",
    type=click.FloatRange(min=0.0, min_open=True),
    default=0.001,
    show_default=True,
    help="Time between rows of the history, s.",
)
SETTINGS = click.option(
    "--set",
    "settings",
    multiple=True,
    metavar="PATH=VALUE",
    help="Replace a value of the file, e.g. body.upper.mass_kg=460.",
)
OUT = click.option(
    "--out",
    type=Folder(),
    help="Run folder to write, also s3://BUCKET/RUN. Default: runs/NAME-N.",
)
NO_PLOTS = click.option("--no-plots", is_flag=True, help="Write no figures.")
CHECK = click.option(
    "--check",
    "must_pass",
    is_flag=True,
    help="Exit with code 1 unless the cases show every requirement of the file.",
)
BRIEF = click.option("--brief", is_flag=True, help="Print one row per group of lines.")
QUIET = click.option("--quiet", is_flag=True, help="Print errors only.")


def overwrite_option(what: str) -> Any:
    """Return the option ``--overwrite``; ``what`` is the text in its help for what it replaces."""
    return click.option("--overwrite", is_flag=True, help=f"Replace {what}.")


OVERWRITE = overwrite_option("the run in --out")


def out_file_option(default: str, kinds: str) -> Any:
    """Return the option ``--out`` for a file to write; its help text lists the ``default`` name and
    the ``kinds`` of files."""
    return click.option(
        "--out",
        type=click.Path(path_type=Path),
        help=f"File to write: {kinds}. Default: {default}.",
    )


def check_out_file(
    path: Path, endings: tuple[str, ...], overwrite: bool, other: str | None = None
) -> None:
    """Raise InputError unless a file to write has one of the ``endings`` (any if empty), and does
    not exist yet or ``overwrite`` is True. ``other`` is the argument that gives the path, for the
    message; by default ``--out``."""
    from sepmc.scene.messages import InputError

    if endings and path.suffix.lower() not in endings:
        raise InputError(f"{path}: must end in {', '.join(endings)}")
    if path.exists() and not overwrite:
        raise InputError(exists(path, other=other))


def load_campaign(
    file: str,
    settings: tuple[str, ...],
    warn: bool = True,
    sampler: str | None = None,
    samples: Path | None = None,
    verify: bool = True,
) -> "Campaign":
    """Read and validate a campaign file, run folder or shipped campaign.

    ``settings`` (texts PATH=VALUE), ``sampler`` and the table ``samples`` replace values of the
    file. Its warnings are printed if ``warn``. Raises SceneError for errors in the file or in one
    of these values, and StoreError if a run folder has the format of another version of sepmc,
    contains links or, only if ``verify``, was changed.
    """
    from sepmc.scene.messages import SceneWarning
    from sepmc.scene.settings import parse_setting

    values = dict(parse_setting(text) for text in settings)
    if sampler:
        values["run.sampler"] = sampler
    if samples:
        values["run.samples"] = str(samples.absolute())
    with warnings.catch_warnings(record=True) as caught:
        warnings.simplefilter("always", SceneWarning)
        from sepmc.campaign.campaign import load

        campaign = load(file, values, verify)
    for warning in caught if warn else ():
        click.echo(f"warning: {warning.message}", err=True)
    return campaign


def load_run(folder: Path) -> "Campaign":
    """Read the campaign of a run folder, without warnings. Raises SceneError or StoreError as
    `load_campaign`."""
    return load_campaign(str(folder), (), warn=False)


def redundant(campaign: "Campaign") -> list[str]:
    """Return a message for each phase in which joints constrain a degree of freedom more than once;
    empty if there is none."""
    from sepmc.scene.redundancy import redundancies

    return [redundancy.sentence for redundancy in redundancies(campaign.scene)]


def undispersed(campaign: "Campaign") -> list[str]:
    """Return a message if no parameter of a campaign is dispersed; else an empty list."""
    if campaign.file.dispersions:
        return []
    return ["nothing is dispersed, so every case is the nominal one; give [dispersion]"]


def check_required(campaign: "Campaign", must_pass: bool) -> None:
    """Raise UsageError if ``must_pass`` (``--check``) and the campaign has no requirement."""
    if must_pass and not campaign.file.requirements:
        raise click.UsageError(f"--check needs a [[requirement]] in {campaign.name}")
