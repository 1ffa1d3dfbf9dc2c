"""Where the time of a command goes: stages of a campaign in a fresh process, and whole commands,
warm and cold."""

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
from sepmc.campaign.execution import step_selection
from sepmc.campaign.store import manifests
from sepmc.engine import dispatch
from sepmc.scene.messages import nobody

_IMPORTS = "import numba, pandas, pyarrow"


def measure(study: Study, history_step: float) -> pd.DataFrame:
    """One row a stage or command: median time in s, how often it was taken, and of what it is a
    part.

    Stages are those of a process that flies the study's cases into a folder, everything compiled
    before. Of a cold command kernels are compiled, into an empty cache folder.
    """
    campaign = study.with_settings({"run.history_step_s": history_step, "run.cases": study.cases})
    with tempfile.TemporaryDirectory() as folder:
        file = Path(folder) / f"{campaign.name}.toml"
        file.write_text(campaign.file.toml, encoding="utf-8")
        runs = [
            subprocess_calls.call(
                "stages:stages_here", [str(file), study.cases, study.threads, folder]
            )
            for _ in range(study.repeats + 1)
        ][1:]
        rows = [_row(stage, "stage", [run[stage] for run in runs]) for stage in runs[0]]
        out = f"{folder}/out"
        flown = [
            sys.executable,
            "-m",
            "sepmc",
            "campaign",
            str(file),
            "--no-plots",
            "--quiet",
            "--threads",
            str(study.threads),
        ]
        commands = {
            "sepmc campaign FILE --no-plots": lambda: subprocess_calls.run(
                [*flown, "--out", out, *(["--overwrite"] if Path(out).exists() else [])]
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
            rows += _cold(study, [*flown, "--out", f"{folder}/cold"], Path(folder))
    return pd.DataFrame(rows)


def _cold(study: Study, command: list[str], folder: Path) -> list[dict[str, Any]]:
    """The campaign with an empty cache folder, and what of it was compiling."""
    study.say("flying with an empty cache folder ...")
    cache = {"SEPMC_CACHE_DIR": str(folder / "cache")}
    whole = seconds(lambda: subprocess_calls.run(command, cache))
    compiling = manifests.read_manifest(folder / "cold")["sessions"][-1]["timing_s"]["compile"]
    return [
        _row("sepmc campaign FILE --no-plots", "command, cold", [whole]),
        _row("compile and pilot", "stage, cold", [compiling]),
    ]


def _row(name: str, kind: str, times: list[float]) -> dict[str, Any]:
    return {
        "stage": name,
        "kind": kind,
        "s": median(times),
        "best_s": min(times),
        "repeats": len(times),
        "spread": spread(times),
    }


def stages_here(file: str, cases: int, threads: int, folder: str) -> dict[str, float]:
    """Times, s, of the stages of a campaign in this fresh process. The package is imported already,
    so its import is timed apart."""
    found = {"import": import_seconds()}
    campaign = load(file)
    history = campaign.scene.run.history_step > 0.0
    began = time.perf_counter()
    dispatch.load_kernel(step_selection.kernel_text(campaign, history=history))
    found["load kernel"] = time.perf_counter() - began
    found["pilot"] = seconds(lambda: step_selection.select_steps(campaign, history))
    sample_inputs(campaign, 1)
    found["sample"] = seconds(lambda: sample_inputs(campaign, cases))
    result = campaign.run(
        cases,
        threads=threads,
        out=Path(folder) / "stages",
        announce=nobody,
        overwrite=(Path(folder) / "stages").exists(),
    )
    found["kernel"] = result.timing["kernel"]
    found["write"] = result.timing["write"]
    found["statistics"] = seconds(lambda: (result.statistics(), result.kept.summary.audit()))
    return found


def import_seconds() -> float:
    """Seconds to import what a campaign needs, in another fresh process."""
    program = (
        "import time; t = time.perf_counter(); import sepmc.campaign.campaign, "
        "sepmc.engine.blocks; print(time.perf_counter() - t)"
    )
    return float(subprocess_calls.run([sys.executable, "-c", program]))
