"""Statistics and histograms that a run left in files, where it kept no cases to count again."""

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
import pandas as pd

from sepmc.analysis.statistics import Histogram

_COLUMNS = ["outcome", "from", "to", "cases"]


@dataclass(frozen=True)
class StoredStatistics:
    """A ``table`` of statistics by outcome, and the ``bins`` of histograms."""

    table: pd.DataFrame
    bins: pd.DataFrame

    def statistics(
        self, reference: Mapping[str, Mapping[str, float]] | None = None
    ) -> pd.DataFrame:
        """As `sepmc.analysis.streaming.StreamingStatistics.statistics`; the reference is in it as
        it was told."""
        return self.table

    def histogram(self, name: str) -> Histogram | None:
        """As `sepmc.analysis.streaming.StreamingStatistics.histogram`."""
        row = np.asarray(self.table.loc[[name], ["n", "mean", "sigma", "min", "max"]], dtype=float)
        n, mean, sigma, low, high = row[0].tolist()
        if not n or not np.isfinite(mean):
            return None
        bins = self.bins[self.bins["outcome"] == name]
        edges = np.concatenate([bins["from"], bins["to"][-1:]]).astype(float)
        counts = bins["cases"].to_numpy(dtype=float)
        return Histogram(int(n), mean, sigma, low, high, edges, counts)


def histogram_table(histograms: Mapping[str, Histogram | None]) -> pd.DataFrame:
    """Histograms as a table: a row for each bin."""
    parts = [
        pd.DataFrame({"outcome": name, "from": h.edges[:-1], "to": h.edges[1:], "cases": h.counts})
        for name, h in histograms.items()
        if h is not None and len(h.counts)
    ]
    return pd.concat(parts, ignore_index=True) if parts else pd.DataFrame(columns=_COLUMNS)
