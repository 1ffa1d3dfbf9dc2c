"""`sepmc verify` and `sepmc stress`: validate the engine of this installation."""

import sys
from collections.abc import Callable, Iterable
from typing import Any

import click

from sepmc.cli.exits import DONE, FAILED
from sepmc.cli.options import BRIEF, QUIET
from sepmc.cli.progress import check_bar


@click.command(
    short_help="Check the engine against closed forms, other formulations and conservation laws."
)
@BRIEF
@QUIET
def verify(brief: bool, quiet: bool) -> None:
    """Check the engine against closed forms, classical formulations and conservation laws. Prints
    one table with a line per check (with --brief, per group of checks); exit code 1 if a check
    fails.

    \b
    Example:
      sepmc verify --brief
    """
    from sepmc.validation import verify as suite

    lines = _run(suite, suite.CHECKS, suite.verify, brief, quiet)
    sys.exit(DONE if all(line.passes for line in lines) else FAILED)


@click.command(
    short_help="Run hard inputs, and show which are accurate, flagged or silently wrong."
)
@BRIEF
@QUIET
def stress(brief: bool, quiet: bool) -> None:
    """Run hard inputs, and print for each whether its result is accurate to its bound, flagged as
    uncertain, or silently wrong; then a table on an hour of torque-free motion. Exit code 1 if a
    result is silently wrong, or flagged although its input is reasonable and it must be accurate.

    \b
    Example:
      sepmc stress --brief
    """
    from sepmc.validation import stress as suite

    lines = _run(suite, suite.STRESSES, suite.stress, brief, quiet, in_this_process=("hour",))
    click.echo(
        "\nAn hour of torque-free motion in joints, by solver.drift:\n" + suite.hours_table()
    )
    sys.exit(DONE if all(line.passes for line in lines) else FAILED)


def _run(
    suite: Any,
    names: Iterable[str],
    function: Callable[..., list[Any]],
    brief: bool,
    quiet: bool,
    in_this_process: Iterable[str] = (),
) -> list[Any]:
    """Run groups of checks, print their table, and return the lines of all groups.

    ``function([name])`` runs the group of a name and returns its lines; the groups
    ``in_this_process`` run here, the others in processes beside it; a single group runs here.
    ``suite`` is the module that renders the table; if ``brief``, it has a row per group instead of
    a row per line. ``quiet`` hides the progress bar.
    """
    from sepmc.validation.groups import side_by_side

    names = list(names)
    with check_bar(len(names), quiet) as progress:
        groups = side_by_side(function, names, in_this_process, progress)
    click.echo(
        suite.brief(groups)
        if brief
        else suite.table([line for group in groups.values() for line in group])
    )
    return [line for group in groups.values() for line in group]
