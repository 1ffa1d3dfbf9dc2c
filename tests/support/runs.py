"""Comparison of runs to the last bit."""

import pandas as pd
import pyarrow.parquet as pq

from sepmc.campaign.store import shards


def table(folder, kind, order):
    """All shards of a run of one kind, in order."""
    parts = [pq.read_table(folder / one.file) for one in shards.entries(folder, kind)]
    frame = pd.concat([part.to_pandas() for part in parts], ignore_index=True)
    frame["status"] = frame["status"].astype(str) if "status" in frame else ""
    return frame.sort_values(order, ignore_index=True)


def same(one, other):
    """True if two runs have the same bits."""
    told = one / "statistics.csv"
    if told.is_file() and told.read_bytes() != (other / told.name).read_bytes():
        return False
    orders = {"cases": ["case"], "histories": ["case", "time_s"], "selected": ["case"]}
    return all(
        table(one, kind, order).equals(table(other, kind, order))
        for kind, order in orders.items()
        if (one / kind).is_dir()
    )


def statistics_of(result):
    """Statistics of a result as text with all digits."""
    return result.statistics().to_csv(float_format="%.17g")
