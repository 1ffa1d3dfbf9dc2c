"""Time of the stages of a campaign in a fresh process, and of whole commands, with a warm and with
an empty (cold) cache of kernels."""

import sys
import tempfile
import time
from pathlib import Path
from statistics import median
from typing import Any

import pandas as pd

from sepmc.bench import subprocess_calls
from sepmc.bench.clock import rounds, seconds, spread
from sepmc.bench.study import Study, sample_inputs
from sepmc.campaign.campaign import load
from sepmc.campaign.execution import step_selection, step_store
from sepmc.campaign.store import manifests
from sepmc.engine import dispatch
from sepmc.scene.messages import no_log

_IMPORTS = "import numba, pandas, pyarrow"


def measure(study: Study, history_step: float) -> pd.DataFrame:
    """Measure the time of the stages of a campaign, and of whole commands.

    Stages are those of a fresh process that runs the study's cases into a folder with a warm cache.
    A cold command compiles its kernels into an empty cache folder; it is left out of a quick study.

    Parameters
    ----------
    study : Study
    history_step : float
        Interval of history rows, s; 0 for no histories.

    Returns
    -------
    DataFrame, a row per stage or command
        ``stage``, name of the stage or text of the command; ``kind``: "stage", "command, warm",
        "command, cold", or "stage, cold" for a stage of the cold command (cold: with an empty cache
        of kernels); ``s`` and ``best_s``, median and smallest time in s; number of ``repeats`` and
        their ``spread`` (interquartile range over the median).
    """
    campaign = study.with_settings({"run.history_step_s": history_step, "run.cases": study.cases})
    with tempfile.TemporaryDirectory() as folder:
        file = Path(folder) / f"{campaign.name}.toml"
        file.write_text(campaign.file.toml, encoding="utf-8")
        runs = [
            subprocess_calls.call(
                "command_stages:time_stages", [str(file), study.cases, study.threads, folder]
            )
            for _ in range(study.repeats + 1)
        ][1:]
        rows = [_row(stage, "stage", [run[stage] for run in runs]) for stage in runs[0]]
        out = f"{folder}/out"
        options = ["--no-plots", "--quiet", "--threads", str(study.threads)]
        command = [sys.executable, "-m", "sepmc", "campaign", str(file), *options]
        commands = {
            "sepmc campaign FILE --no-plots": lambda: subprocess_calls.run(
                [*command, "--out", out, *(["--overwrite"] if Path(out).exists() else [])]
            ),
            "sepmc --help": lambda: subprocess_calls.run([sys.executable, "-m", "sepmc", "--help"]),
            f"python -c '{_IMPORTS}'": lambda: subprocess_calls.run(
                [sys.executable, "-c", _IMPORTS]
            ),
        }
        rows += [
            _row(name, "command, warm", times)
            for name, times in rounds(commands, study.repeats).items()
        ]
        if not study.quick:
            rows += _cold(study, [*command, "--out", f"{folder}/cold"], Path(folder))
    return pd.DataFrame(rows)


def _cold(study: Study, command: list[str], folder: Path) -> list[dict[str, Any]]:
    """Time the campaign command with an empty cache folder; return table rows of its whole time,
    and of its stages that emit the kernel, compile it and select steps. The cache and the run are
    subfolders of ``folder``; the command must write the run to ``cold``."""
    study.say("timing a campaign with an empty cache of kernels ...")
    cache = {"SEPMC_CACHE_DIR": str(folder / "cache")}
    whole = seconds(lambda: subprocess_calls.run(command, cache))
    timing = manifests.read_manifest(folder / "cold")["sessions"][-1]["timing_s"]
    return [
        _row("sepmc campaign FILE --no-plots", "command, cold", [whole]),
        *(_row(stage, "stage, cold", [timing[stage]]) for stage in ("text", "compile", "steps")),
    ]


def _row(name: str, kind: str, times: list[float]) -> dict[str, Any]:
    """Return the row of a stage or command in the table of `measure`, with the median and the
    minimum of its ``times``, s, their number and their `spread`; ``kind`` is the value of that
    column."""
    return {
        "stage": name,
        "kind": kind,
        "s": median(times),
        "best_s": min(times),
        "repeats": len(times),
        "spread": spread(times),
    }


def time_stages(file: str, cases: int, threads: int, folder: str) -> dict[str, float]:
    """Run ``cases`` cases of the campaign ``file`` on ``threads`` threads in this fresh process;
    return the time of each stage by name, s.

    The stages are ``import`` (timed in another process), ``load kernel`` (from the cache), ``select
    steps`` (anew), ``load steps`` (from the cache), ``sample``, ``kernel``, ``write`` and
    ``statistics``. The run is written to the subfolder ``stages`` of ``folder``.
    """
    times = {"import": import_seconds()}
    campaign = load(file)
    history = campaign.scene.run.history_step > 0.0
    start = time.perf_counter()
    dispatch.load_kernel(step_selection.kernel_text(campaign, history=history))
    times["load kernel"] = time.perf_counter() - start
    times["select steps"] = seconds(
        lambda: step_selection.select_steps(campaign, history, again=True)
    )
    step_selection.select_steps(campaign, history)  # stored
    step_store.forget()
    times["load steps"] = seconds(lambda: step_selection.select_steps(campaign, history))
    sample_inputs(campaign, 1)
    times["sample"] = seconds(lambda: sample_inputs(campaign, cases))
    result = campaign.run(
        cases,
        threads=threads,
        out=Path(folder) / "stages",
        announce=no_log,
        overwrite=(Path(folder) / "stages").exists(),
    )
    times["kernel"] = result.timing["kernel"]
    times["write"] = result.timing["write"]
    times["statistics"] = seconds(lambda: (result.statistics(), result.kept.summary.audit()))
    return times


def import_seconds() -> float:
    """Return the time that one fresh process takes to import what a campaign needs, s, without the
    start of Python before that."""
    program = (
        "import time; t = time.perf_counter(); import sepmc.campaign.campaign, "
        "sepmc.engine.blocks; print(time.perf_counter() - t)"
    )
    return float(subprocess_calls.run([sys.executable, "-c", program]))
