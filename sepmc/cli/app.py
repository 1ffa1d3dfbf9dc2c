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


class _Program(click.Group):
    """Commands whose errors end in a sentence, those of their options too."""

    def invoke(self, ctx: click.Context) -> Any:
        """Read the options of a command, and run it."""
        with wording.on_command_line(), plain_errors(quiet=False):
            return super().invoke(ctx)


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
    gc_tuning.reduce_collections()


for _command in (
    runs.campaign,
    runs.sample,
    runs.run,
    runs.replay,
    folders.stats,
    folders.plot,
    folders.doctor,
    folders.drivers,
    folders.laws,
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
