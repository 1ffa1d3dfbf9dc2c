"""Benchmark of a scene: measures its parts one after the other, prints tables, and writes files and
figures into a folder."""

import warnings
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd

from sepmc.bench import (
    bits,
    command_stages,
    features,
    machine,
    row_errors,
    scaling,
    text,
    work_precision,
)
from sepmc.bench.folder import SUMMARY, open_folder
from sepmc.bench.reference import Reference, make_reference, reference_times
from sepmc.bench.study import Study, sample_inputs
from sepmc.campaign.campaign import Campaign
from sepmc.campaign.execution.step_selection import select_steps
from sepmc.campaign.store import folders
from sepmc.engine.dispatch import check_threads, use_threads, using_threads
from sepmc.engine.threads import max_threads
from sepmc.scene.messages import Log, SceneWarning

CASES, QUICK_CASES = 10_000, 1000
REPEATS, QUICK_REPEATS = 7, 3
_MAX_REFERENCE_S = 60.0  # largest time of the reference, unless a number of cases is requested


def bench(
    campaign: Campaign,
    out: Path,
    say: Log,
    *,
    cases: int | None = None,
    repeats: int | None = None,
    threads: int | None = None,
    quick: bool = False,
    peers: Callable[[Study, Reference], pd.DataFrame] | None = None,
    overwrite: bool = False,
) -> dict[str, Any]:
    """Measure speed and accuracy of a scene on this machine.

    Parameters
    ----------
    campaign : Campaign
    out : Path
        Folder for ``bench.json``, a Parquet file for each part, and the figures.
    say : callable (text)
        Receives progress messages and tables.
    cases, repeats : int, optional
        Timed cases (default 10,000, or 1000 if ``quick``; fewer where the reference would take too
        long) and repeats of each timing (default 7, or 3 if ``quick``).
    threads : int, optional
        Threads of the kernel; all available ones if None.
    quick : bool
        Measure fewer settings, and leave out what takes minutes.
    peers : callable (Study, Reference), optional
        Measures other engines on the same cases; returns the table ``peers``.
    overwrite : bool
        Replace an earlier benchmark in the folder.

    Returns
    -------
    results : dict
        The content of ``bench.json``.

    Raises
    ------
    StoreError
        If the folder contains other files, or a benchmark and ``overwrite`` is False, or is not
        writable.
    InputError
        If ``threads`` exceeds the threads available.
    """
    threads = check_threads(threads) or max_threads()
    folder = open_folder(out, overwrite)
    with warnings.catch_warnings(), using_threads(threads):
        warnings.simplefilter("ignore", SceneWarning)  # reported when the file was read
        history = campaign.scene.run.history_step
        study = _study(
            campaign, cases, repeats or (QUICK_REPEATS if quick else REPEATS), threads, quick, say
        )
        results, frames = _parts(study, history, peers, folder)
    from sepmc.report.bench_figures import draw  # noqa: PLC0415  (matplotlib takes 0.7 s)

    for path in draw(frames, folder, campaign.name, study.threads, results["reference"]["floor"]):
        say(str(path))
    return results


def _study(
    campaign: Campaign, cases: int | None, repeats: int, threads: int, quick: bool, say: Log
) -> Study:
    """Return the study of a campaign: its sampled cases and the steps selected for it, without
    histories; log its size.

    If ``cases`` is None, their number is the default, smaller if ``quick``, or fewer where the
    reference solution would take more than `_MAX_REFERENCE_S` seconds (but at least
    `QUICK_CASES`). ``repeats``, ``threads``, ``quick`` and ``say`` are as in `Study`.
    """
    bare = campaign.with_settings({"run.history_step_s": 0.0})
    integration = select_steps(bare, announce=say)
    requested = cases or (QUICK_CASES if quick else CASES)
    study = Study(bare, integration, sample_inputs(bare, requested), repeats, threads, quick, say)
    affordable = max(QUICK_CASES, int(_MAX_REFERENCE_S / (reference_times() * study.seconds)))
    if cases is None and affordable < requested:
        say(
            f"only {affordable} cases are run: the reference solution of {requested} would take "
            f"more than {_MAX_REFERENCE_S:g} s; --cases sets the number"
        )
        study = replace(study, inputs=study.inputs[:affordable])
    say(
        f"{campaign.name}: {study.cases} cases, {repeats} repeats, {threads} threads, "
        f"{bare.scene.solver.formulation} formulation"
    )
    return study


def _parts(
    study: Study,
    history: float,
    peers: Callable[[Study, Reference], pd.DataFrame] | None,
    folder: Path,
) -> tuple[dict[str, Any], dict[str, pd.DataFrame]]:
    """Measure every part one after the other; print it and write it to the folder as soon as it is
    complete. Return the content of ``bench.json`` and the tables by name of the part. ``history``
    is the interval of history rows, s; 0: the scene has no histories. ``peers`` is that of `bench`;
    None leaves out the part."""
    results: dict[str, Any] = {
        "campaign": study.campaign.name,
        "digest": study.campaign.digest,
        "machine": machine.describe(study.threads),
    }
    results |= {"cases": study.cases, "repeats": study.repeats, "formulation": study.formulation}
    frames: dict[str, pd.DataFrame] = {}

    def write() -> None:
        """Write the results and tables so far to ``bench.json``."""
        tables = {name: frames[name].to_dict("records") for name in text.TABLES if name in frames}
        folders.write_json(folder / SUMMARY, results | tables)

    def keep(name: str, frame: pd.DataFrame) -> None:
        """Add the table of a part to ``frames``, and write it as Parquet. If the part has a text
        table, also print that with its warnings, and store the rows of ``frame`` and the warnings
        in ``bench.json``."""
        frames[name] = frame
        frame.to_parquet(folder / f"{name}.parquet", index=False)
        if name in text.TABLES:
            study.say("\n" + text.render_table(name, frame) + "\n")
            for warning in text.warnings(name, frame):
                study.say(warning + "\n")
                results.setdefault("warnings", []).append(warning)
        write()

    reference = make_reference(study)
    study.say(reference.sentence)
    if reference.floor > study.campaign.scene.solver.accuracy:
        study.say(
            f"warning: the reference resolves errors only down to {reference.floor:.1e}, which is "
            "more than solver.accuracy: smaller errors in the tables are not reliable"
        )
    results["reference"] = {
        "how": reference.how,
        "change": reference.change,
        "other": reference.other,
    }
    results["reference"] |= {
        "difference": reference.difference,
        "checked": reference.checked,
        "floor": reference.floor,
    }
    keep("work_precision", work_precision.measure(study, reference))
    rows, results["error_column"] = row_errors.measure(study, reference)
    study.say(row_errors.sentence(results["error_column"]) + "\n")
    keep("row_errors", rows)
    keep("features", features.measure(study, history))
    keep("scaling", scaling.measure(study))
    keep("stages", command_stages.measure(study, history))
    results["same_bits"] = bits.same_bits(study)
    study.say(
        "outcomes the same to the last bit with: "
        + "; ".join(
            f"{change}: {'yes' if same else 'NO'}" for change, same in results["same_bits"].items()
        )
    )
    if peers:
        keep("peers", peers(study, reference))
    cpu, compiled_for = (results["machine"][name] for name in ("cpu", "compiled_for"))
    results["headlines"] = {"processor": cpu, "compiled for": compiled_for}
    results["headlines"] |= _headlines(study, frames)
    study.say("\n" + text.render_headlines(results["headlines"]))
    write()
    return results, frames


def _headlines(study: Study, frames: dict[str, pd.DataFrame]) -> dict[str, Any]:
    """Return the most important results of a benchmark, by label with unit, from its tables by
    part, of which "work_precision" and "features" must be there; measures the peak rate of
    multiply-adds of the machine for them."""
    table = frames["work_precision"]
    default = table[table["default"]].iloc[0]
    headlines: dict[str, Any] = {
        "run as": f"{default['formulation']}, {default['method']}, {default['setting']}",
        "kernel time for 10,000 cases (ms)": float(default["ms"]),
        "error": float(default["error"]),
        "accuracy requested": study.campaign.scene.solver.accuracy,
    }
    one, all_threads = (
        machine.fused_peak(1, study.repeats),
        machine.fused_peak(study.threads, study.repeats),
    )
    use_threads(study.threads)
    headlines |= {
        "peak of multiply-adds, 1 thread (Gflop/s)": one["best"],
        f"peak, {study.threads} threads (Gflop/s)": all_threads["best"],
    }
    whole = frames["features"].iloc[0]
    if whole["flops_per_case"] == whole["flops_per_case"]:
        speed = 1e-9 * whole["flops_per_case"] / (1e-3 * default["ms"] / work_precision.PER)
        headlines |= {
            "evaluations a case": int(whole["evaluations"]),
            "flops an evaluation, mean": float(whole["flops_per_evaluation"]),
            "flops a case, without set-up and events": float(whole["flops_per_case"]),
            "speed (Gflop/s)": float(speed),
            "fraction of the peak": float(speed / all_threads["best"]),
        }
    airless = frames["features"].query("feature == 'atmosphere'").to_dict("records")
    if airless:
        headlines |= {"without air: time ratio": float(airless[0]["time_ratio"])}
        if np.isfinite(airless[0]["flop_ratio"]):
            headlines |= {"without air: flop ratio": float(airless[0]["flop_ratio"])}
    return headlines
