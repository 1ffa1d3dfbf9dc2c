"""Tables of inputs in files: CSV or Parquet to the cases that a campaign flies."""

from pathlib import Path

import numpy as np
import pandas as pd
import pyarrow as pa
import pyarrow.parquet as pq
from pyarrow import csv

from sepmc.places import source
from sepmc.scene.input_table import CASE, InputTable
from sepmc.scene.messages import Problems

_MOST = 10**9
_PARQUET = ".parquet"
_ENDINGS = (_PARQUET, ".csv", ".txt")


def read_input_table(path: Path, problems: Problems) -> InputTable | None:
    """Read a table of inputs in CSV or Parquet; None, with the problems noted, if that cannot
    be."""
    place, count = "run.plan", len(problems)
    if not path.exists():
        problems.add(place, "no such file", str(path))
        return None
    ending = path.suffix.lower()
    if ending not in _ENDINGS:
        problems.add(place, f"must end in {', '.join(_ENDINGS)}", str(path))
        return None
    try:
        table = pq.read_table(source(path)) if ending == _PARQUET else csv.read_csv(source(path))
        frame = table.rename_columns([name.strip() for name in table.column_names]).to_pandas()
    except (OSError, pa.ArrowException) as error:
        said = str(error).splitlines()[0]
        kind = "Parquet" if ending == _PARQUET else "CSV"
        problems.add(place, f"cannot be read as {kind}: {said}", str(path))
        return None
    if not len(frame):
        problems.add(place, "has no rows", str(path))
        return None
    numbers = np.arange(len(frame))
    if CASE in frame:
        given = pd.to_numeric(frame[CASE], errors="coerce").to_numpy(dtype=float)
        whole = np.isfinite(given) & (given % 1 == 0) & (given >= 0) & (given < _MOST)
        if not whole.all():
            bad = str(frame[CASE].iloc[int(np.argmin(whole))])
            problems.add(
                f"{place}, column {CASE}", f"must hold whole numbers from 0 to {_MOST - 1}", bad
            )
        elif len(np.unique(given)) < len(given):
            problems.add(f"{place}, column {CASE}", "holds a number twice")
        else:
            numbers = given.astype(np.int64)
    if len(problems) > count:
        return None
    order = np.argsort(numbers)
    words = {}  # a word among numbers makes a column one of words
    for name in frame:
        bad_ones = pd.to_numeric(frame[name], errors="coerce").isna() & frame[name].notna()
        if bad_ones.any():
            at = int(np.argmax(bad_ones))
            words[str(name)] = f"{str(frame[name].iloc[at])!r} in case {numbers[at]} is no number"
    kept = frame.select_dtypes("number").drop(columns=CASE, errors="ignore")
    columns = {str(name): kept[name].to_numpy(dtype=float)[order] for name in kept}
    return InputTable(path, numbers[order], columns, words)
