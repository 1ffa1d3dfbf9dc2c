"""The whole bench of a scene: its parts in turn, tables on the screen, files and figures in a
folder."""

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
_REFERENCE_S = 60.0  # that the reference takes at most, unless a number of cases is asked for


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
    out : Path
        Folder for ``bench.json``, a Parquet file a part, and the figures.
    say : callable
        Told what goes on, and the tables.
    cases, repeats : int, optional
        10,000 and 7; 1000 and 3 if ``quick``, which also leaves out what takes minutes.
    threads : int, optional
        All if None.
    peers : callable, optional
        Measures other engines on the same cases (columns of the table ``peers``).

    Returns
    -------
    told : dict
        What stands in ``bench.json``.

    Raises
    ------
    StoreError
        If the folder cannot be used.
    ValueError
        If there are not so many threads.
    """
    threads = check_threads(threads) or max_threads()
    folder = open_folder(out, overwrite)
    with warnings.catch_warnings(), using_threads(threads):
        warnings.simplefilter("ignore", SceneWarning)  # told when the file was read
        history = campaign.scene.run.history_step
        study = _study(
            campaign,
            cases,
            repeats or (QUICK_REPEATS if quick else REPEATS),
            threads,
            quick,
            say,
        )
        told, frames = _parts(study, history, peers, folder)
    from sepmc.report.bench_figures import draw  # noqa: PLC0415  (matplotlib takes 0.7 s)

    for path in draw(frames, folder, campaign.name, study.threads, told["reference"]["floor"]):
        say(str(path))
    return told


def _study(
    campaign: Campaign, cases: int | None, repeats: int, threads: int, quick: bool, say: Log
) -> Study:
    bare = campaign.with_settings({"run.history_step_s": 0.0})
    flight = select_steps(bare, announce=say)
    wanted = cases or (QUICK_CASES if quick else CASES)
    study = Study(bare, flight, sample_inputs(bare, wanted), repeats, threads, quick, say)
    fit = max(QUICK_CASES, int(_REFERENCE_S / (reference_times() * study.seconds)))
    if cases is None and fit < wanted:
        say(f"{fit} cases, as the reference of {wanted} would take more than {_REFERENCE_S:g} s")
        study = replace(study, draws=study.draws[:fit])
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
    """Every part in turn, told and written as soon as it is there."""
    told: dict[str, Any] = {
        "campaign": study.campaign.name,
        "digest": study.campaign.digest,
        "machine": machine.describe(study.threads),
    }
    told |= {"cases": study.cases, "repeats": study.repeats, "formulation": study.formulation}
    frames: dict[str, pd.DataFrame] = {}

    def write() -> None:
        tables = {name: frames[name].to_dict("records") for name in text.TABLES if name in frames}
        folders.write_json(folder / SUMMARY, told | tables)

    def keep(name: str, frame: pd.DataFrame) -> None:
        frames[name] = frame
        frame.to_parquet(folder / f"{name}.parquet", index=False)
        if name in text.TABLES:
            study.say("\n" + text.table(name, frame) + "\n")
            for warning in text.warnings(name, frame):
                study.say(warning + "\n")
                told.setdefault("warnings", []).append(warning)
        write()

    reference = make_reference(study)
    study.say(reference.sentence)
    if reference.floor > study.campaign.scene.solver.accuracy:
        study.say(
            f"warning: the reference itself is good to {reference.floor:.1e} only, so no smaller "
            "error can be told from it"
        )
    told["reference"] = {"how": reference.how, "change": reference.change, "other": reference.other}
    told["reference"] |= {
        "difference": reference.difference,
        "checked": reference.checked,
        "floor": reference.floor,
    }
    keep("work_precision", work_precision.measure(study, reference))
    rows, told["error_column"] = row_errors.measure(study, reference)
    study.say(row_errors.sentence(told["error_column"]) + "\n")
    keep("row_errors", rows)
    keep("features", features.measure(study, history))
    keep("scaling", scaling.measure(study))
    keep("stages", command_stages.measure(study, history))
    told["same_bits"] = bits.same_bits(study)
    study.say(
        "same bits: "
        + "; ".join(
            f"{what}: {'yes' if same else 'NO'}" for what, same in told["same_bits"].items()
        )
    )
    if peers:
        keep("peers", peers(study, reference))
    told["headlines"] = _headlines(study, frames)
    study.say("\n" + text.headlines(told["headlines"]))
    write()
    return told, frames


def _headlines(study: Study, frames: dict[str, pd.DataFrame]) -> dict[str, Any]:
    """The numbers that a reader looks for first."""
    table = frames["work_precision"]
    chosen = table[table["default"]].iloc[0]
    told: dict[str, Any] = {
        "flown as": f"{chosen['formulation']}, {chosen['method']}, {chosen['setting']}",
        "kernel time for 10,000 cases (ms)": float(chosen["ms"]),
        "error": float(chosen["error"]),
        "accuracy asked": study.campaign.scene.solver.accuracy,
    }
    one, every = (
        machine.fused_peak(1, study.repeats),
        machine.fused_peak(study.threads, study.repeats),
    )
    use_threads(study.threads)
    told |= {
        "peak of multiply-adds, 1 thread (Gflop/s)": one["best"],
        f"peak, {study.threads} threads (Gflop/s)": every["best"],
    }
    whole = frames["features"].iloc[0]
    if whole["flops_per_case"] == whole["flops_per_case"]:
        speed = 1e-9 * whole["flops_per_case"] / (1e-3 * chosen["ms"] / work_precision.PER)
        told |= {
            "evaluations a case": int(whole["evaluations"]),
            "flops an evaluation, mean": float(whole["flops_per_evaluation"]),
            "flops a case, without set-up and events": float(whole["flops_per_case"]),
            "speed (Gflop/s)": float(speed),
            "share of the peak": float(speed / every["best"]),
        }
    airless = frames["features"].query("feature == 'atmosphere'").to_dict("records")
    if airless:
        told |= {"without air: time ratio": float(airless[0]["time_ratio"])}
        if np.isfinite(airless[0]["flop_ratio"]):
            told |= {"without air: flop ratio": float(airless[0]["flop_ratio"])}
    return told
