"""Writing and reading of result files in a run folder: statistics, histograms, and the history of a
single case. Functions that write text or JSON raise OSError if that fails."""

from collections.abc import Sequence
from pathlib import Path
from typing import Any

import pandas as pd

from sepmc.analysis.stored_statistics import StoredStatistics
from sepmc.campaign.store import folders, ledger, shards
from sepmc.campaign.store.untrusted import StoreError
from sepmc.paths import readable
from sepmc.schema import Column
from sepmc.wording import flying_again, switch


def write_statistics(
    folder: Path, stats: pd.DataFrame, of: dict[str, str], content: dict[str, Any]
) -> None:
    """Write ``statistics.csv`` and ``statistics.json`` into a run folder, not into its ledger.

    Parameters
    ----------
    folder : Path
        Run folder.
    stats : DataFrame
        Statistics, a row per outcome, for the CSV file.
    of : dict of str to str
        Unit of each outcome.
    content : dict
        Contents of the JSON file, from `statistics_as_json`.
    """
    frame = _with_units(stats, of)
    folders.write_text(folder / "statistics.csv", frame.to_csv(index_label="outcome"))
    folders.write_json(folder / "statistics.json", content)


def write_histograms(folder: Path, bins: pd.DataFrame) -> Path:
    """Write ``histograms.csv`` into a folder, and return its path; ``bins`` is a table with a row
    for each bin of the histogram of each outcome."""
    path = folder / folders.HISTOGRAMS
    folders.write_text(path, bins.to_csv(index=False))
    return path


def read_stored_statistics(folder: Path) -> StoredStatistics:
    """Read the statistics and histograms of a run that stores no case rows, from its CSV files.
    Raises StoreError if one is missing, not in the ledger or damaged."""
    stored, frames = ledger.read(folder), []
    for name, index in (("statistics.csv", "outcome"), (folders.HISTOGRAMS, None)):
        problem = shards.find_fault(folder, stored[name]) if name in stored else "is not there"
        if problem:
            raise StoreError(
                f"{folder / name}: {problem}; to write it again: {flying_again(folder)}"
            )
        frames.append(pd.read_csv(readable(folder / name), index_col=index))
    table, bins = frames
    return StoredStatistics(table.drop(columns="unit"), bins)


def statistics_as_json(
    stats: pd.DataFrame,
    counts: dict[str, int],
    of: dict[str, str],
    audit: pd.DataFrame,
    failed: dict[str, list[int]] | None = None,
    verdicts: Sequence[dict[str, Any]] = (),
    rarely_drawn: Sequence[str] = (),
) -> dict[str, Any]:
    """Contents of ``statistics.json``, with None in place of NaN in the statistics and the audit.
    Verdicts are taken as they are; `folders.json_text` replaces what is not finite in them.

    Parameters
    ----------
    stats : DataFrame
        Statistics, a row per outcome.
    counts : dict of str to int
        Number of cases by status.
    of : dict of str to str
        Unit of each outcome.
    audit : DataFrame
        Extremes of the audit columns, a row for each of them.
    failed : dict of str to list of int, optional
        Numbers of the first failed cases by status.
    verdicts : sequence of dict
        Verdicts on requirements, each as data.
    rarely_drawn : sequence of str
        Sentences on input values that hardly occur in the cases.

    Returns
    -------
    dict
        Data of JSON types.
    """
    rows, audited = (
        {
            str(name): {k: (None if pd.isna(v) else v) for k, v in row.items()}
            for name, row in table.to_dict("index").items()
        }
        for table in (_with_units(stats, of), audit)
    )
    return {
        "cases": counts,
        "failed_cases": failed or {},
        "requirements": list(verdicts),
        "rarely_drawn": list(rarely_drawn),
        "outcomes": rows,
        "audit": audited,
    }


def _with_units(stats: pd.DataFrame, of: dict[str, str]) -> pd.DataFrame:
    """Copy of a table of statistics (a row per outcome) with a first column ``unit``, from ``of``,
    the unit by outcome; case numbers become integers."""
    columns = {
        str(name): stats[name].astype("Int64") if name in ("case_min", "case_max") else stats[name]
        for name in stats
    }
    units = [of.get(str(name), "") for name in stats.index]
    return pd.DataFrame({"unit": units, **columns}, index=stats.index)


def write_history(folder: Path, history: pd.DataFrame, meanings: dict[str, str]) -> Path:
    """Write the history of a single case as ``history.parquet``, and a ledger with this file alone
    in place of the old one; return the path of the file. Raises StoreError if the file, and OSError
    if the ledger, cannot be written.

    ``history`` has a row per time, and the unit of each column in ``history.attrs["units"]``;
    ``meanings`` are explanations by column, which the file contains.
    """
    columns = [
        Column(str(name), history.attrs["units"][name], meanings.get(str(name), ""))
        for name in history.columns
    ]
    path = folder / folders.HISTORY
    content = shards.write_parquet(
        path,
        columns,
        {
            c.name: history[c.name].to_numpy(dtype=object if c.name == "phase" else None)
            for c in columns
        },
    )
    ledger.rewrite(folder, [ledger.make_entry(folders.HISTORY, content)])
    return path


def read_history(folder: Path) -> pd.DataFrame | None:
    """Read the history of a single case that `write_history` wrote: a table with a row per time, or
    None if the ledger of the folder has none. Raises StoreError if it is missing or damaged."""
    entry = ledger.read(folder).get(folders.HISTORY)
    if entry is None:
        return None
    try:
        content = ledger.read_verified(folder, entry)
    except ValueError as error:
        raise StoreError(
            f"{folder / folders.HISTORY}: {error}; run the case again with {switch('overwrite')}"
        ) from None
    frame = shards.read_table(folder / folders.HISTORY, content=content).to_pandas(
        ignore_metadata=True
    )
    if not {"time_s", "phase"} <= set(frame):
        raise StoreError(
            f"{folder / folders.HISTORY}: is no history, as it lacks column time_s or phase"
        )
    frame["phase"] = frame["phase"].astype(str)
    return frame
