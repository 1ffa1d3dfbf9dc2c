"""Forecast of a campaign: `sepmc campaign --dry-run`. Heavy modules are imported at use."""

import shlex
import time
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from sepmc.wording import count_cases

if TYPE_CHECKING:
    from sepmc.campaign.campaign import Campaign
    from sepmc.campaign.case_selection import CaseSelection
    from sepmc.campaign.execution.integration import Integration

_TIMED_S = 0.3  # time to spend on cases that measure the speed
_FEWEST, _GROWTH = 8, 8  # cases of the first measurement, and growth to the next one


def show_forecast(
    campaign: "Campaign",
    cases: "int | CaseSelection | None",
    seed: int | None,
    folder: Path,
    stats_only: bool,
    compile_command: Sequence[str],
) -> None:
    """Print a forecast of a run of a campaign into a folder (columns of a row, disk, memory, time).
    The time is measured on a few cases, for which steps are selected and stored in the cache; if
    the kernel is not compiled yet, the command that compiles it, ``compile_command`` by words, is
    printed in place of the time. ``folder`` is only printed: nothing is written into it.

    ``cases`` is a number of cases or a selection of case numbers; None, and None for ``seed``, are
    the values of the campaign. With ``stats_only`` the run would store no rows.
    """
    from sepmc.campaign.execution.forecast import forecast, size_text, time_text
    from sepmc.campaign.execution.step_selection import kernel_text, select_steps, units_to_compile

    selection, total = campaign.select_cases(cases)
    n, run = selection.count, campaign.scene.run
    seed = run.seed if seed is None else seed
    which = "" if selection.are_first else f" ({selection})"
    click.echo(
        f"{campaign.name}: {count_cases(n)}{which}, seed {seed}, sampler {run.sampler}, "
        f"into {folder}"
    )
    inputs, outcomes = len(campaign.input_columns), len(campaign.outcome_columns)
    audits = len(campaign.result_columns) - outcomes
    click.echo(f"  a row     {inputs} inputs, {outcomes} outcomes, {audits} audit columns, status")
    separation = campaign.stored_history_columns(not stats_only)
    need = forecast(campaign, n, bool(separation))
    disk = "some kB: statistics only"
    if not stats_only:
        disk = f"at most {size_text(n * need.row)} of cases"
        disk += f" and {size_text(n * need.history)} of histories" if separation else ""
    click.echo(f"  disk      {disk}")
    click.echo(
        f"  memory    {size_text(need.memory_bytes)}, in chunks of "
        f"{count_cases(min(n, need.shard_size))}"
    )
    missing, units = units_to_compile(kernel_text(campaign, history=bool(separation)))
    if missing:
        click.echo(
            f"  kernel    {missing} of {units} compile units left to compile, half a core second "
            "each"
        )
        click.echo(f"  time      known once it is compiled: {shlex.join(compile_command)}")
        return
    click.echo(f"  kernel    compiled: {units} compile units in the cache")
    start = time.perf_counter()
    integration = select_steps(campaign, history=bool(separation), announce=None)
    calibration_s = time.perf_counter() - start
    case_s, timed = _time_per_case(campaign, integration, selection, seed, total, separation)
    click.echo(
        f"  time      {time_text(calibration_s)} of calibration cases, then "
        f"{time_text(n * case_s)}: {1e6 * case_s:.3g} us a case, measured on {count_cases(timed)}"
    )


def _time_per_case(
    campaign: "Campaign",
    integration: "Integration",
    selection: "CaseSelection",
    seed: int,
    total: int,
    separation: list[Any],
) -> tuple[float, int]:
    """Measure how long it takes to sample and integrate a case, on the first cases of the longest
    range of a selection. All cores are used, and start-up costs are not counted.

    ``total`` is the number of cases of the whole sample, ``separation`` the columns of stored
    histories: if there are any, the cases are integrated with their histories. The measurement is
    repeated on more cases until it takes long enough. Returns the seconds per case, and the number
    of cases of the last measurement.
    """
    from sepmc.campaign.execution.integration import history_rows
    from sepmc.campaign.execution.integration import integrate as integrate_samples

    first, end = max(selection.ranges, key=lambda of: of[1] - of[0])

    def integrate(count: int, rows: int = 0) -> None:
        samples = campaign.in_si(campaign.sample(first, count, seed, total))
        integrate_samples(campaign, integration, samples, rows)

    integrate(1)  # start-up costs
    rows = history_rows(campaign.scene) if separation else 0
    count, seconds = 0, 0.0
    while seconds < _TIMED_S and count < end - first:
        count = min(max(_FEWEST, _GROWTH * count), end - first)
        start = time.perf_counter()
        integrate(count, rows)
        seconds = time.perf_counter() - start
    return seconds / count, count
