"""Statistics and histograms of a run that stored no case rows, from the tables in its
statistics.csv and histograms.csv."""

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
import pandas as pd

from sepmc.analysis.statistics import Histogram

_COLUMNS = ["outcome", "from", "to", "cases"]


@dataclass(frozen=True)
class StoredStatistics:
    """Statistics of a run as it stored them: ``table``, that of
    `sepmc.analysis.statistics.statistics`, and ``bins``, that of `histogram_table`."""

    table: pd.DataFrame
    bins: pd.DataFrame

    def statistics(
        self, reference: Mapping[str, Mapping[str, float]] | None = None
    ) -> pd.DataFrame:
        """Return the stored table. The argument ``reference`` is ignored: the table contains the
        columns of the reference that was given when it was written."""
        return self.table

    def histogram(self, name: str) -> Histogram | None:
        """Return the histogram of an outcome, or None if it has no value or an infinite one. Raises
        KeyError for a name that is not in ``table``."""
        row = np.asarray(self.table.loc[[name], ["n", "mean", "sigma", "min", "max"]], dtype=float)
        n, mean, sigma, low, high = row[0].tolist()
        if not n or not np.isfinite(mean):
            return None
        bins = self.bins[self.bins["outcome"] == name]
        edges = np.concatenate([bins["from"], bins["to"][-1:]]).astype(float)
        counts = bins["cases"].to_numpy(dtype=float)
        return Histogram(int(n), mean, sigma, low, high, edges, counts)


def histogram_table(histograms: Mapping[str, Histogram | None]) -> pd.DataFrame:
    """Return the bins of histograms, by outcome, as a table with a row per bin: ``outcome``, edges
    ``from`` and ``to``, and number of ``cases``. A histogram without bins has no row."""
    tables = [
        pd.DataFrame({"outcome": name, "from": h.edges[:-1], "to": h.edges[1:], "cases": h.counts})
        for name, h in histograms.items()
        if h is not None and len(h.counts)
    ]
    return pd.concat(tables, ignore_index=True) if tables else pd.DataFrame(columns=_COLUMNS)
