"""Results of runs, read from their run folders."""

from pathlib import Path

from sepmc.campaign.campaign import load
from sepmc.campaign.case_selection import CaseSelection
from sepmc.campaign.case_selection import parse as parse_selection
from sepmc.campaign.execution.accuracy import AchievedAccuracy
from sepmc.campaign.execution.sinks import RunOutput
from sepmc.campaign.result import Result
from sepmc.campaign.run_statistics import evaluate, numerical_errors, read_summary
from sepmc.campaign.store import folders, manifests, shards
from sepmc.campaign.store.untrusted import StoreError
from sepmc.paths import as_path


def open_run(folder: str | Path) -> Result:
    """Open a run folder as the result of its run.

    Parameters
    ----------
    folder : str or Path
        Folder that a run wrote, with case rows.

    Returns
    -------
    Result
        As `Campaign.run` returns it, but ``timing`` is empty, ``integration`` None, ``resumed`` 0,
        and ``stopped`` True whenever the run is not complete. Rows are read on demand.

    Raises
    ------
    StoreError
        If the folder is no run folder, has no case rows, has the format of another version of
        sepmc, contains links, or was changed.
    PathError
        As `sepmc.paths.as_path`, for a folder in object storage.
    """
    path = as_path(folder)
    if not folders.is_run(path):
        raise StoreError(f"{path}: is no folder of a run; give one that a run wrote")
    manifest = manifests.read_manifest(path)
    if not manifests.has_case_rows(manifest):
        raise StoreError(
            f"{path}: contains no case rows, which sepmc.open reads: it is a single case, or was "
            "run with statistics only or by --rare"
        )
    campaign = load(path)
    statistics = evaluate(campaign, read_summary(path, campaign), manifest)
    record = statistics.accuracy
    accuracy = None
    if record:
        errors = numerical_errors(record)
        asked = record.get("asked") or campaign.scene.solver.accuracy
        positions = frozenset(record.get("places", ()))
        accuracy = AchievedAccuracy(
            asked, errors, record.get("cases", 0), positions, record.get("history")
        )
    cases = manifest["cases"]
    text = manifest.get("numbers")
    numbers = parse_selection(text) if text else CaseSelection.first(cases)
    histories = shards.entries(path, folders.HISTORIES)
    return Result(
        campaign,
        RunOutput(statistics.summary, shards.CaseColumns(path), None, histories),
        {},
        manifest["seed"],
        numbers,
        manifest.get("of") or cases,
        path,
        list(manifest.get("notes", ())),
        accuracy=accuracy,
        stopped=not manifest.get("complete", True),
        written=statistics,
    )


open = open_run  # sepmc.open
