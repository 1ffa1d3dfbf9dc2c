"""Race: every installed engine runs the same cases with several settings.

The timed part is from the initial to the final states, with the release located on the way. Reading
the case table into the engine's arrays and converting final states into outcome columns are not
timed. Compile times are separate.
"""

import importlib
import itertools
import time
from collections.abc import Iterator
from statistics import median
from typing import Any

import numpy as np

from oracles.engine_race.entry import Entry
from oracles.engine_race.inputs import Inputs, read
from oracles.engine_race.worker import Workers
from sepmc.bench.clock import spread
from sepmc.paths import EXTRA
from sepmc.scene.messages import Log

CASES = {"heyoka": 10000, "mujoco": 1024, "scipy": 4, "exudyn": 2}
TOLERANCES = (1e-6, 1e-9, 1e-12, 1e-15)
# heyoka with steps of our choice: orders and numbers of steps, locked, guided, free; of those tried
# the fastest at their error
ORDERS = (
    ((6, 8, 8), (1, 2, 2)),
    ((7, 10, 10), (1, 2, 2)),
    ((9, 12, 12), (1, 2, 2)),
    ((10, 14, 14), (1, 2, 2)),
    ((12, 16, 16), (1, 2, 2)),
    ((12, 14, 14), (1, 3, 3)),
)
BATCHES = (4, 8)  # of heyoka: each suits some processors; the faster one counts
STEPS = (0.05, 0.025, 0.01, 0.005, 0.0025)  # s, of MuJoCo
EXUDYN = ((0.005, 1), (0.0005, 3))  # s and levels
PLAIN = (1e-6, 1e-9, 1e-12)


def race(
    campaign: Any, threads: int, say: Log, cases: dict[str, int] | None = None, repeats: int = 7
) -> list[Entry]:
    """Run the first cases of a campaign with every installed engine.

    Parameters
    ----------
    campaign : sepmc.Campaign
    threads : int
    say : callable
        Called with progress messages.
    cases : dict of int, optional
        Cases by engine, instead of `CASES`; an engine with none is left out.
    repeats : int
        Runs of which the median time is taken; one if the cases are few and the time extrapolated.

    Raises
    ------
    ValueError
        If these engines do not run such a scene, naming the scenes that they run.
    """
    counts = {**CASES, **(cases or {})}
    inputs = read(campaign, max(counts.values()))
    racers = {"heyoka": _heyoka, "mujoco": _mujoco, "scipy": _scipy, "exudyn": _exudyn}
    entries = []
    for name, racer in racers.items():
        if counts[name] == 0 or not _is_installed(name):
            continue
        for entry in racer(campaign, inputs.part(0, counts[name]), threads, repeats):
            say(
                f"{entry.engine}, {entry.setting}: {entry.seconds_per_case * 1e7:.3g} ms per "
                "10,000 cases"
            )
            entries.append(entry)
    return entries


def left_out(cases: dict[str, int] | None = None) -> list[str]:
    """A sentence for each engine that does not run: not installed, or with no ``cases``."""
    absent = f"not installed, or too old: {EXTRA.format('peers')}"
    return [
        f"{name} is left out: {'not in a quick look' if count == 0 else absent}"
        for name, count in {**CASES, **(cases or {})}.items()
        if count == 0 or not _is_installed(name)
    ]


def _is_installed(name: str) -> bool:
    if name not in ("heyoka", "mujoco", "exudyn"):
        return True
    try:
        importlib.import_module("mujoco.batch" if name == "mujoco" else name)
    except ImportError:
        return False
    return True


def _heyoka(_: Any, inputs: Inputs, threads: int, repeats: int) -> Iterator[Entry]:
    settings: list[tuple[str, tuple[Any, ...]]] = [
        (f"tol {tolerance:.0e}", (tolerance,)) for tolerance in TOLERANCES
    ]
    for orders, steps in ORDERS:
        setting = "order {}, steps {}".format(
            *(" ".join(map(str, three)) for three in (orders, steps))
        )
        settings.append((setting, (None, orders, steps)))
    for batch, (setting, arguments) in itertools.product(BATCHES, settings):
        shares = [(share, batch, *arguments) for share in inputs.shares(threads)]
        note = (
            "a process a thread; its own steps and terminal event"
            if arguments[0]
            else "a process a thread; prescribed steps"
        )
        yield _apart(
            f"heyoka batch {batch}",
            setting,
            "oracles.engine_race.heyoka:HeyokaFlight",
            shares,
            inputs,
            threads,
            repeats,
            note,
        )


def _scipy(campaign: Any, inputs: Inputs, threads: int, _: int) -> Iterator[Entry]:
    for tolerance in PLAIN:
        note = "the independent flight, in plain Python"
        share = [(campaign.file.tree, campaign.name, inputs, tolerance)]
        yield _apart(
            "scipy DOP853",
            f"rtol {tolerance:.0e}",
            "oracles.engine_race.plain:ScipyFlight",
            share,
            inputs,
            threads,
            1,
            note,
        )


def _apart(
    engine: str,
    setting: str,
    factory: str,
    shares: list[tuple[Any, ...]],
    inputs: Inputs,
    threads: int,
    repeats: int,
    note: str,
) -> Entry:
    """An engine in its own processes, one for each share of the cases. The few cases of plain
    Python run in one."""
    plain = factory.endswith("plain:ScipyFlight")
    environment = {"NUMBA_DISABLE_JIT": "1"} if plain else {}
    with Workers(factory, shares, environment) as workers:
        if not plain:
            workers.fly()
        spent = [workers.fly() for _ in range(repeats)]
        parts = workers.outcomes()
    table = {name: np.concatenate([part[name] for part in parts]) for name in parts[0]}
    seconds = median(spent) / inputs.count / (threads if plain else 1)
    return Entry(
        engine,
        setting,
        inputs.count,
        threads,
        workers.compile_s,
        seconds,
        repeats,
        table,
        plain,
        note,
        spread(spent),
    )


def _mujoco(_: Any, inputs: Inputs, threads: int, repeats: int) -> Iterator[Entry]:
    from oracles.engine_race.mujoco import MujocoFlight

    for step in STEPS:
        flight = MujocoFlight(inputs, step, threads)
        spent, apart, flown = _timed(flight, repeats)
        note = "batch of a model a phase, loads as a compiled callback"
        table = flight.outcomes(flown)
        yield Entry(
            "MuJoCo RK4",
            f"step {step:g} s",
            inputs.count,
            threads,
            flight.compile_s,
            spent / inputs.count,
            repeats,
            table,
            False,
            note,
            apart,
        )


def _exudyn(campaign: Any, inputs: Inputs, threads: int, _: int) -> Iterator[Entry]:
    from oracles.engine_race.exudyn import ExudynFlight

    for step, levels in EXUDYN:
        flight = ExudynFlight(campaign, inputs, step, levels)
        lasted, _apart, flown = _timed(flight, 1)
        setting = f"step {step:g} s" + (f", {levels} levels" if levels > 1 else "")
        seconds, table = lasted / inputs.count / threads, flight.outcomes(flown)
        yield Entry(
            "Exudyn",
            setting,
            inputs.count,
            threads,
            0.0,
            seconds,
            1,
            table,
            True,
            "loads as Python functions",
        )


def _timed(flight: Any, repeats: int) -> tuple[float, float, Any]:
    """Median seconds of a run, their spread, and the last result."""
    spent, flown = [], None
    for _ in range(repeats):
        began = time.perf_counter()
        flown = flight.fly()
        spent.append(time.perf_counter() - began)
    return median(spent), spread(spent), flown
