"""Statistics and histograms read from the files of a run that stored no case rows."""

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
import pandas as pd

from sepmc.analysis.statistics import Histogram

_COLUMNS = ["outcome", "from", "to", "cases"]


@dataclass(frozen=True)
class StoredStatistics:
    """Stored statistics: a ``table`` with a row per outcome, and the ``bins`` of histograms (see
    `histogram_table`)."""

    table: pd.DataFrame
    bins: pd.DataFrame

    def statistics(
        self, reference: Mapping[str, Mapping[str, float]] | None = None
    ) -> pd.DataFrame:
        """Return the stored table; it contains the reference that was given when it was written."""
        return self.table

    def histogram(self, name: str) -> Histogram | None:
        """Return the histogram of an outcome, or None if it has no finite value."""
        row = np.asarray(self.table.loc[[name], ["n", "mean", "sigma", "min", "max"]], dtype=float)
        n, mean, sigma, low, high = row[0].tolist()
        if not n or not np.isfinite(mean):
            return None
        bins = self.bins[self.bins["outcome"] == name]
        edges = np.concatenate([bins["from"], bins["to"][-1:]]).astype(float)
        counts = bins["cases"].to_numpy(dtype=float)
        return Histogram(int(n), mean, sigma, low, high, edges, counts)


def histogram_table(histograms: Mapping[str, Histogram | None]) -> pd.DataFrame:
    """Return histograms by outcome as a table with a row per bin: outcome, from, to, cases."""
    tables = [
        pd.DataFrame({"outcome": name, "from": h.edges[:-1], "to": h.edges[1:], "cases": h.counts})
        for name, h in histograms.items()
        if h is not None and len(h.counts)
    ]
    return pd.concat(tables, ignore_index=True) if tables else pd.DataFrame(columns=_COLUMNS)
