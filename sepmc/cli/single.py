"""What the command line tells of one case: flown by itself, or flown again of a run."""

import time
from collections.abc import Callable
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from sepmc.cli.figures import clearance_bounds, marks_of
from sepmc.cli.options import undispersed
from sepmc.cli.render import errors_told, single_error_text, summary_of

if TYPE_CHECKING:
    import pandas as pd

    from sepmc.campaign.campaign import Campaign
    from sepmc.campaign.definition import Case

_SAID = {"least": "has the least of them", "greatest": "has the greatest of them"}


def tell_single(
    loaded: "Campaign",
    number: int | None,
    seed: int | None,
    every_s: float,
    out: Path | None,
    overwrite: bool,
    say: Callable[[str], None],
    plots: bool,
    run: Path | None = None,
    film: str | None = None,
) -> int:
    """Fly a case, or the nominal one, into a folder of its own; as a case of a ``run``, whose row
    is checked. Returns the exit code: 1 if its status is not ok, or its row differs."""
    from sepmc import schema
    from sepmc.campaign.execution.accuracy import zero_below_error
    from sepmc.campaign.store import folders, manifests
    from sepmc.engine.dispatch import check_every
    from sepmc.paths import is_local

    check_every(every_s, loaded.scene, "--every-s")
    about = "nominal case" if number is None else f"case {number}"
    case = loaded.nominal() if number is None else loaded.case(number, seed)
    folder = out or folders.next_folder(
        loaded.name if number is None else f"{loaded.name}-case{number}"
    )
    if film and not is_local(folder):
        raise folders.StoreError(
            f"{folder}: a film is written on this machine; give --out a folder"
        )
    with folders.opened(folder, overwrite, resumable=False):
        start = time.perf_counter()
        history = loaded.simulate(case, every_s, say)
        seconds = time.perf_counter() - start
        _write(folder, loaded, case, history, number, seed)
    flown = history.attrs
    status = schema.Status[flown["status"].upper().replace("-", "_")]
    say(f"{loaded.name}, {about}: {status.label}: {status.sentence}")
    outcomes = zero_below_error(loaded, flown["outcomes"], flown["errors"])
    for name, value in [*case.inputs.items(), *outcomes.items()]:
        say(f"  {name:44s} {value:.9g}")
    if number is not None and number not in loaded.numbers:
        say(f"case {number} is not among those of the file ({loaded.numbers}); it is drawn alike")
    for note in flown["notes"] + ([] if number is None else undispersed(loaded)):
        click.echo(f"warning: {note}", err=True)
    error = single_error_text(flown["outcomes"], flown["errors"], loaded)
    if error is not None:
        say(error)
    how = "compiled" if flown["compiled"] else "in plain Python"
    say(f"flown by the kernel written for it, {how}, in {seconds:.2f} s; {len(history)} rows")
    same = True if run is None or number is None else _check_row(loaded, run, number, say)
    written: list[Path] = []
    if plots:
        from sepmc.campaign.label import of_case
        from sepmc.report.figures import run_figures

        behind = None if run is None else loaded.simulate(None, every_s, say)
        written += run_figures(
            history,
            folder,
            loaded.plan.bodies,
            list(loaded.plan.joints),
            of_case(loaded.name, number, loaded.settings),
            behind=behind,
            required=clearance_bounds(loaded),
            marks=marks_of(flown),
        )
    if film:
        from sepmc.report import animation

        path = folder / f"film.{film}"
        animation.film(history, case.scene, f"{loaded.name}, {about}", path)
        written.append(path)
    manifests.record_derived(folder, written)
    say(f"wrote {folder}")
    return 0 if status is schema.Status.OK and same else 1


def _write(
    folder: Path,
    loaded: "Campaign",
    case: "Case",
    history: "pd.DataFrame",
    number: int | None,
    seed: int | None,
) -> None:
    """Write the history of a case, its file and its manifest."""
    from sepmc import schema
    from sepmc.campaign.store import manifests, shards

    meanings = {c.name: c.meaning for c in schema.history_columns(loaded.plan.contents)}
    shards.write_history(folder, history, meanings)
    if loaded.file.input_table:
        shards.write_input_table(folder, loaded.file.input_table, loaded.input_columns)
    own = loaded.scene.run.seed if seed is None else seed
    manifest = {
        "campaign": loaded.name,
        "digest": loaded.digest,
        "case": number,
        "seed": None if number is None else own,
        "settings": loaded.settings,
        "inputs": case.inputs,
        **{key: history.attrs[key] for key in _TOLD},
        "bodies": loaded.plan.bodies,
        "joints": list(loaded.plan.joints),
        **manifests.versions(),
    }
    manifests.write_manifest(folder, manifest, shards.campaign_text(loaded.file))


_TOLD = ("status", "compiled", "outcomes", "errors", "notes", "releases", "events")


def _check_row(loaded: "Campaign", run: Path, number: int, say: Callable[[str], None]) -> bool:
    """Say whether the row of a case comes out again to the last bit."""
    from sepmc.campaign.execution import replay
    from sepmc.campaign.store import manifests

    manifest = manifests.read_manifest(run)
    total = manifest.get("of", manifest["cases"])
    flight = replay.earlier_integration(loaded, say)
    found = replay.compare_row(loaded, flight, run, number, manifest["seed"], total)
    other = _other_versions(manifest)
    said = f"{found.sentence}{'; the run was made with ' + other if other else ''}"
    if found.columns:
        click.echo(f"warning: {said}", err=True)
    else:
        say(said)
    return not found.columns


def _other_versions(manifest: dict[str, Any]) -> str:
    """Versions and machine of a run that are not those of today."""
    from sepmc.campaign.store import manifests

    made, now = manifest["sessions"][-1], manifests.versions()
    before, here = (
        {"sepmc": one.get("sepmc"), **one.get("versions", {}), "machine": one.get("machine")}
        for one in (made, now)
    )
    return ", ".join(f"{key} {before[key]}" for key in before if before[key] != here.get(key))


def chosen(
    folder: Path, loaded: "Campaign", way: str, asked: str, say: Callable[[str], None]
) -> int:
    """The case of a run that is asked for as the worst, least, greatest or nearest."""
    from sepmc.campaign.execution import replay
    from sepmc.campaign.execution.accuracy import with_scales
    from sepmc.campaign.store import manifests, shards

    cases = shards.CaseColumns(folder)
    if way == "worst":
        summary = summary_of(folder, loaded)
        told = errors_told(manifests.read_manifest(folder).get("accuracy") or {})
        errors = with_scales(loaded, told, summary.statistics())
        number, said = replay.worst_case(summary, loaded, errors, asked)
    elif way == "nearest":
        number, what = replay.nearest_case(cases, asked)
        said = f"is nearest to {what}"
    else:
        number, said = replay.extreme_case(cases, asked, way == "least"), f"{_SAID[way]}: {asked}"
    say(f"{folder}: case {number} {said}")
    return number


def check_held(file: Path, number: int | None, seed: int | None, has_plan: bool = False) -> None:
    """A case replayed from a run folder must be one that the run holds."""
    from sepmc.campaign.case_selection import parse
    from sepmc.campaign.store import folders, manifests

    if number is None or seed is not None or not (file / folders.MANIFEST).is_file():
        return
    manifest = manifests.read_manifest(file)
    if "rare" in manifest:
        if has_plan:
            return
        raise folders.StoreError(
            f"{file}: holds {folders.RARE}, whose cases are those of rare.parquet: add "
            "--set run.samples=rare.parquet"
        )
    held, which = manifest.get("cases"), manifest.get("numbers")
    if which and number not in parse(which):
        raise folders.StoreError(f"{file}: holds cases {which}; --case {number} is none of them")
    if not which and isinstance(held, int) and number >= held:
        raise folders.StoreError(
            f"{file}: holds cases 0 to {held - 1}; --case {number} is none of them"
        )
