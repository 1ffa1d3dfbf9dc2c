"""The command line: words in, exit code out. Nothing heavy is imported until a command needs it.

Exit codes: 0 done, 1 flown but no case reached the end (verify, stress: a line failed; campaign
--check: a requirement is not shown), 2 bad input (nothing was flown), 3 flown but the audit failed
or the accuracy asked was not met, 130 interrupted.
"""

from typing import Any

import click

from sepmc import __version__, gc_tuning, wording
from sepmc.cli import checks, folders, runs
from sepmc.cli.render import plain_errors

RENAMED_COMMANDS = {"laws": "fit", "drivers": "sensitivity"}
RENAMED_OPTIONS = {
    "--given": "--where",
    "--least": "--min",
    "--greatest": "--max",
    "--film": "--animate",
    "--plan": "--samples",
}


class _Program(click.Group):
    """Group of commands whose errors, those of options included, are single sentences."""

    def resolve_command(self, ctx: click.Context, args: list[str]) -> Any:
        """Look up a command; an earlier name raises UsageError with the present one."""
        if new := RENAMED_COMMANDS.get(args[0]):
            ctx.fail(f"{args[0]} was renamed: sepmc {new}")
        return super().resolve_command(ctx, args)

    def invoke(self, ctx: click.Context) -> Any:
        """Parse the options of a command and run it."""
        with wording.on_command_line(), plain_errors(quiet=False):
            try:
                return super().invoke(ctx)
            except click.NoSuchOption as error:
                if new := RENAMED_OPTIONS.get(error.option_name):
                    said = f"{error.option_name} was renamed: {new}"
                    raise click.UsageError(said, error.ctx) from None
                raise


@click.group(
    cls=_Program, context_settings={"help_option_names": ["-h", "--help"], "max_content_width": 110}
)
@click.version_option(__version__, prog_name="sepmc")
def main() -> None:
    """Monte Carlo of multi-body stage separation by the constraint force equation method.

    \b
    Examples:
      sepmc campaign table2.toml --set body.upper.mass_kg=460 --out runs/heavy
      sepmc replay runs/heavy --case 17

    FILE is a campaign file, a run folder, or the name of a shipped campaign (sepmc list). Exit
    codes: 0 done, 1 flown but no case reached the end (verify, stress: a line failed; campaign
    --check: a requirement is not shown), 2 bad input, 3 flown but the audit failed or the accuracy
    asked was not met, 130 interrupted. SEPMC_CACHE_DIR moves the folder of compiled kernels.
    """
    gc_tuning.put_off()


for _command in (
    runs.campaign,
    runs.sample,
    runs.run,
    runs.replay,
    folders.stats,
    folders.plot,
    folders.doctor,
    folders.sensitivity,
    folders.fit,
    folders.compare,
    folders.report,
    checks.template,
    checks.list_campaigns,
    checks.check,
    checks.draw,
    checks.compile_,
    checks.bench,
    checks.verify,
    checks.stress,
):
    main.add_command(_command)

if __name__ == "__main__":
    main()
