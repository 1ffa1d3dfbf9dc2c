"""What the command line tells of cases before they are flown: what a campaign would take, and the
table of its inputs."""

import shlex
import time
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from sepmc.campaign.campaign import Campaign
    from sepmc.campaign.case_selection import CaseSelection

_TRIED_S = 0.3  # that some cases are to take that are flown to time the others
_FEWEST, _TIMES = 1, 8  # of these, and how many times more are tried next


def tell_plan(
    loaded: "Campaign",
    cases: "int | CaseSelection | None",
    seed: int | None,
    folder: Path,
    stats_only: bool,
    compiling: Sequence[str],
    say: Callable[[str], None],
) -> None:
    """What a campaign would fly, write and take. Where its kernel is compiled, some cases are flown
    for that, else the words of the command that is ``compiling`` it are told; nothing is
    written."""
    from sepmc.campaign.execution.forecast import forecast, size_text, time_text
    from sepmc.campaign.execution.step_selection import kernel_text, select_steps, units_to_compile

    numbers, total = loaded.select_cases(cases)
    n, run, seed = numbers.count, loaded.scene.run, loaded.scene.run.seed if seed is None else seed
    which = "" if numbers.are_first else f" ({numbers})"
    say(f"{loaded.name}: {n} cases{which}, seed {seed}, sampler {run.sampler}, into {folder}")
    inputs, outcomes = len(loaded.input_columns), len(loaded.outcome_columns)
    audits = len(loaded.result_columns) - outcomes
    say(f"  a row     {inputs} inputs, {outcomes} outcomes, {audits} audit columns, status")
    separation = loaded.stored_history_columns(not stats_only)
    takes = forecast(loaded, n, bool(separation))
    disk = "some kB: statistics only"
    if not stats_only:
        disk = f"at most {size_text(n * takes.row)} of cases"
        disk += f" and {size_text(n * takes.history)} of histories" if separation else ""
    say(f"  disk      {disk}")
    say(
        f"  memory    {size_text(takes.memory_bytes)}, in shards of "
        f"{min(n, takes.shard_size)} cases"
    )
    text = kernel_text(loaded, history=bool(separation))
    missing, pieces = units_to_compile(text)
    if missing:
        say(f"  kernel    {missing} of {pieces} pieces to compile, half a second of a core each")
        say(f"  time      known once it is compiled: {shlex.join(compiling)}")
        return
    say(f"  kernel    compiled: {pieces} pieces in the cache")
    begun = time.perf_counter()
    flight = select_steps(loaded, history=bool(separation), announce=None)
    trials = time.perf_counter() - begun
    each, tried = _timed(loaded, flight, numbers, seed, total, separation)
    say(
        f"  time      {time_text(trials)} of trial cases, then {time_text(n * each)}: "
        f"{1e6 * each:.3g} us a case, by {tried} cases flown now"
    )


def _timed(
    loaded: "Campaign",
    flight: Any,
    numbers: "CaseSelection",
    seed: int,
    total: int,
    separation: list,
) -> tuple[float, int]:
    """Seconds that a case takes to draw and fly, by so many cases."""
    from sepmc.campaign.execution.integration import history_rows, integrate

    first, end = numbers.ranges[0]
    integrate(
        loaded, flight, loaded.in_si(loaded.sample(first, 1, seed, total))
    )  # what comes only once
    room, count, seconds = history_rows(loaded.scene) if separation else 0, _FEWEST, 0.0
    while seconds < _TRIED_S and count < end - first:
        count = min(_TIMES * count, end - first)
        begun = time.perf_counter()
        integrate(loaded, flight, loaded.in_si(loaded.sample(first, count, seed, total)), room)
        seconds = time.perf_counter() - begun
    return seconds / count, count


def write_sample(
    loaded: "Campaign", cases: "int | CaseSelection | None", seed: int | None, out: Path
) -> str:
    """Write the table of inputs of a campaign; returns what was written, in words."""
    import numpy as np
    import pandas as pd

    from sepmc.scene.limits import PLAN_NUMBERS
    from sepmc.scene.messages import InputError

    numbers, total = loaded.select_cases(cases)
    if numbers.count * len(loaded.input_columns) > PLAN_NUMBERS:
        most = PLAN_NUMBERS // len(loaded.input_columns)
        raise InputError(f"cases = {numbers.count:,}: a table has room for at most {most:,}")
    parts = [loaded.sample(first, end - first, seed, total) for first, end in numbers.ranges]
    drawn = np.concatenate(parts)
    which = np.concatenate([np.arange(first, end) for first, end in numbers.ranges])
    table = pd.DataFrame({"case": which})
    for i, column in enumerate(loaded.input_columns):
        table[column.name] = drawn[:, i]
    from sepmc.campaign.store import folders, shards

    if out.suffix.lower() == ".csv":
        folders.write_text(out, table.to_csv(index=False))
    else:
        from sepmc.schema import Column

        columns = [Column("case", "1", "number of the case"), *loaded.input_columns]
        shards.write_parquet(out, columns, {c.name: table[c.name].to_numpy() for c in columns})
    return f"{len(table)} cases, {len(loaded.input_columns)} inputs"
