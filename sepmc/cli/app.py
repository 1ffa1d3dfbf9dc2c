"""The command line program `sepmc`. Heavy modules are imported by the commands that need them."""

import os
from typing import Any

import click

from sepmc import __version__, gc_tuning
from sepmc.cli.allocate import allocate
from sepmc.cli.bench import bench
from sepmc.cli.campaign import campaign
from sepmc.cli.check import check
from sepmc.cli.compare import compare
from sepmc.cli.compile import compile_
from sepmc.cli.doctor import doctor
from sepmc.cli.draw import draw
from sepmc.cli.estimate import estimate
from sepmc.cli.exits import MEANINGS, Program
from sepmc.cli.export import export
from sepmc.cli.fit import fit
from sepmc.cli.import_ import import_
from sepmc.cli.map import map_
from sepmc.cli.plot import plot
from sepmc.cli.replay import replay
from sepmc.cli.report import report
from sepmc.cli.run import run
from sepmc.cli.sample import sample
from sepmc.cli.scenarios import scenarios
from sepmc.cli.sensitivity import sensitivity
from sepmc.cli.size import size
from sepmc.cli.stats import stats
from sepmc.cli.studio import studio
from sepmc.cli.template import list_campaigns, template
from sepmc.cli.verify import stress, verify

RENAMED_COMMANDS = {"laws": "fit", "drivers": "sensitivity"}
RENAMED_OPTIONS = {
    "--given": "--where",
    "--least": "--min",
    "--greatest": "--max",
    "--film": "--animate",
    "--plan": "--samples",
    "--spares": "--fallbacks",
}


class _Sepmc(Program):
    """Program that reports the new name of a command or option that was renamed."""

    def resolve_command(self, ctx: click.Context, args: list[str]) -> Any:
        """Look up a command; raise UsageError with its new name if it was renamed."""
        if new := RENAMED_COMMANDS.get(args[0]):
            ctx.fail(f"the command {args[0]} was renamed: sepmc {new}")
        return super().resolve_command(ctx, args)

    def invoke(self, ctx: click.Context) -> Any:
        """Run a command; raise UsageError with the new name of an option that was renamed."""
        try:
            return super().invoke(ctx)
        except click.NoSuchOption as error:
            if new := RENAMED_OPTIONS.get(error.option_name):
                message = f"{error.option_name} was renamed: {new}"
                raise click.UsageError(message, error.ctx) from None
            raise


@click.group(
    cls=_Sepmc,
    context_settings={"help_option_names": ["-h", "--help"], "max_content_width": 110},
    help=f"""Monte Carlo of multi-body stage separation by the constraint force equation method.

    \b
    Examples:
      sepmc campaign table2.toml --set body.upper.mass_kg=460 --out runs/heavy
      sepmc replay runs/heavy --case 17

    FILE is a campaign file, a run folder, or the name of a shipped campaign (sepmc list).
    {MEANINGS} SEPMC_CACHE_DIR moves the folder of compiled kernels.
    """,
)
@click.version_option(__version__, prog_name="sepmc")
def main() -> None:
    """Prepare this process for any command, before the command itself runs: make garbage collection
    rare, as a command ends soon, and keep numpy's linear algebra to one thread, unless the
    environment sets the number."""
    gc_tuning.reduce_collections()
    # matrices here are small: beside other busy processes, threads that wait for one another take
    # up to 300 ms for a correlation matrix that one thread computes in 0.4 ms
    os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")


for _command in (
    campaign,
    sample,
    run,
    replay,
    stats,
    plot,
    doctor,
    sensitivity,
    fit,
    compare,
    map_,
    size,
    allocate,
    studio,
    estimate,
    scenarios,
    report,
    export,
    import_,
    template,
    list_campaigns,
    check,
    draw,
    compile_,
    bench,
    verify,
    stress,
):
    main.add_command(_command)

if __name__ == "__main__":
    main()
