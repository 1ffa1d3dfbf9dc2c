"""Simulation of one case into a folder of its own, with its history over time. Heavy modules are
imported at use."""

import time
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

from sepmc.cli.exits import FAILED
from sepmc.cli.figures import clearance_bounds, event_times
from sepmc.cli.options import undispersed
from sepmc.cli.render import render_case_error, warn

if TYPE_CHECKING:
    import pandas as pd

    from sepmc.campaign.campaign import Campaign
    from sepmc.campaign.definition import Case
    from sepmc.scene.messages import Log

_MANIFEST = (
    *("status", "compiled", "outcomes", "errors", "notes"),
    *("releases", "partial_releases", "events"),
)


@dataclass(frozen=True)
class SingleRun:
    """Options of the simulation of a single case.

    Attributes
    ----------
    number : int or None
        Case number; None is the nominal case.
    seed : int or None
        Seed of the sample; that of the campaign if None.
    every_s : float
        Time between rows of the history, s.
    out : Path or None
        Folder to write; a new one in ``runs`` if None.
    overwrite : bool
        Replace the run in the folder.
    plots : bool
        Draw figures.
    run : Path or None
        Run folder whose row of case ``number`` is checked by integrating it again; figures then
        show the nominal case behind. None: no check, and no nominal case in the figures.
    animate : str or None
        Format of an animation to write, "gif" or "mp4"; None: no animation.
    """

    number: int | None
    seed: int | None
    every_s: float
    out: Path | None
    overwrite: bool
    plots: bool
    run: Path | None = None
    animate: str | None = None


def simulate_single(campaign: "Campaign", single: SingleRun, log: "Log") -> int:
    """Simulate a case, write its folder, and print its outcomes. Returns the exit code: 1 if the
    status is not ok, or the row of the case in ``single.run`` is not reproduced; else 0. Raises
    StoreError if the folder cannot be used, and InputError if ``single.every_s`` is not valid."""
    from sepmc import schema
    from sepmc.campaign.execution.accuracy import zero_below_error
    from sepmc.campaign.store import folders, manifests
    from sepmc.engine.dispatch import check_history_step
    from sepmc.paths import is_local

    number, every_s = single.number, single.every_s
    check_history_step(every_s, campaign.scene, "--every-s")
    title = "nominal case" if number is None else f"case {number}"
    case = campaign.nominal() if number is None else campaign.case(number, single.seed)
    folder = single.out or folders.next_folder(
        campaign.name if number is None else f"{campaign.name}-case{number}"
    )
    if single.animate and not is_local(folder):
        raise folders.StoreError(f"{folder}: an animation needs a local folder; give another --out")
    with folders.opened(folder, single.overwrite, resumable=False):
        start = time.perf_counter()
        history = campaign.simulate(case, every_s, log)
        seconds = time.perf_counter() - start
        _write(folder, campaign, case, history, single)
    attributes = history.attrs
    status = schema.Status[attributes["status"].upper().replace("-", "_")]
    log(f"{campaign.name}, {title}: {status.label}: {status.sentence}")
    outcomes = zero_below_error(campaign, attributes["outcomes"], attributes["errors"])
    for name, value in [*case.inputs.items(), *outcomes.items()]:
        log(f"  {name:44s} {value:.9g}")
    if number is not None and number not in campaign.numbers:
        log(f"case {number} is not in the campaign, cases {campaign.numbers} (A:B is without B)")
    warn(*attributes["notes"], *([] if number is None else undispersed(campaign)))
    error = render_case_error(attributes["outcomes"], attributes["errors"], campaign)
    if error is not None:
        log(error)
    how = "compiled" if attributes["compiled"] else "as plain Python"
    log(f"kernel run {how}, in {seconds:.2f} s; {len(history)} rows")
    same = single.run is None or number is None or _check_row(campaign, single.run, number, log)
    written: list[Path] = []
    if single.plots:
        from sepmc.campaign.label import of_case
        from sepmc.report.history_figures import run_figures

        written += run_figures(
            history,
            folder,
            campaign.layout.bodies,
            list(campaign.layout.joints),
            of_case(campaign.name, number, campaign.settings),
            behind=None if single.run is None else campaign.simulate(None, every_s, log),
            required=clearance_bounds(campaign),
            marks=event_times(attributes),
        )
    if single.animate:
        from sepmc.report import animation

        path = folder / f"animation.{single.animate}"
        animation.animate(history, case.scene, f"{campaign.name}, {title}", path)
        written.append(path)
    manifests.record_derived(folder, written)
    log(f"wrote {folder}")
    return 0 if status is schema.Status.OK and same else FAILED


def _write(
    folder: Path,
    campaign: "Campaign",
    case: "Case",
    history: "pd.DataFrame",
    single: SingleRun,
) -> None:
    """Write the history of a case, its campaign file, its sample table if it has one, and its
    manifest into a folder."""
    from sepmc import schema
    from sepmc.campaign.store import manifests, result_files, shards

    meanings = {c.name: c.meaning for c in schema.history_columns(campaign.layout.contents)}
    result_files.write_history(folder, history, meanings)
    if campaign.file.input_table:
        shards.write_input_table(folder, campaign.file.input_table, campaign.input_columns)
    seed = campaign.scene.run.seed if single.seed is None else single.seed
    manifest = {
        "campaign": campaign.name,
        "digest": campaign.digest,
        "case": single.number,
        "seed": None if single.number is None else seed,
        "settings": campaign.settings,
        "inputs": case.inputs,
        **{key: history.attrs[key] for key in _MANIFEST},
        "bodies": campaign.layout.bodies,
        "joints": list(campaign.layout.joints),
        **manifests.versions(),
    }
    manifests.write_manifest(folder, manifest, shards.campaign_text(campaign.file))


def _check_row(campaign: "Campaign", run: Path, number: int, log: "Log") -> bool:
    """Integrate case ``number`` again in the way its run folder ``run`` did, and print whether its
    row has the same bits. Returns False if a column differs; True if none does, or if the row was
    not compared because the kernel of the run is not in the cache of compiled kernels."""
    from sepmc.campaign.execution import replay
    from sepmc.campaign.store import manifests

    manifest = manifests.read_manifest(run)
    total = manifest.get("of", manifest["cases"])
    integration = replay.earlier_integration(campaign, log)
    row = replay.compare_row(campaign, integration, run, number, manifest["seed"], total)
    versions = _other_versions(manifest)
    message = f"{row.sentence}{'; the run was made with ' + versions if versions else ''}"
    if row.columns:
        warn(message)
    else:
        log(message)
    return not row.columns


def _other_versions(manifest: dict[str, Any]) -> str:
    """Return the versions and the machine of the last session of a run, from its manifest, that
    differ from the present ones, as text: ``sepmc 1.2, numpy 2.0``; empty if none does."""
    from sepmc.campaign.store import manifests

    before, present = (
        {"sepmc": one.get("sepmc"), **one.get("versions", {}), "machine": one.get("machine")}
        for one in (manifest["sessions"][-1], manifests.versions())
    )
    return ", ".join(f"{key} {before[key]}" for key in before if before[key] != present.get(key))


def check_stored(
    path: Path, number: int | None, seed: int | None, has_samples: bool = False
) -> None:
    """Raise StoreError if ``path`` is a run folder that does not contain case ``number``.

    Any number is allowed if ``seed`` replaces that of the run, and None, the nominal case, always.
    The folder of a rare-event estimate counts as containing cases only if its sample table is given
    (``has_samples``).
    """
    from sepmc.campaign.case_selection import parse
    from sepmc.campaign.store import folders, manifests

    if number is None or seed is not None or not (path / folders.MANIFEST).is_file():
        return
    manifest = manifests.read_manifest(path)
    if "rare" in manifest:
        if has_samples:
            return
        raise folders.StoreError(
            f"{path}: contains {folders.RARE}, whose cases are those of rare.parquet: add "
            "--set run.samples=rare.parquet"
        )
    count, which = manifest.get("cases"), manifest.get("numbers")
    if which and number not in parse(which):
        raise folders.StoreError(
            f"{path}: contains cases {which}; --case {number} is none of them (A:B is without B)"
        )
    if not which and isinstance(count, int) and number >= count:
        raise folders.StoreError(
            f"{path}: contains cases 0 to {count - 1}; --case {number} is none of them"
        )
