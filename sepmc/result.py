"""What a campaign gave: the case table, histories, statistics, timing."""

from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
import pandas as pd

from sepmc import store
from sepmc.accuracy import Achieved
from sepmc.flight import Flight
from sepmc.scene.messages import InputError
from sepmc.sinks import Kept

if TYPE_CHECKING:
    from sepmc.campaign import Campaign, Case


@dataclass(repr=False)
class Result:
    """What a campaign gave.

    Rows of a run into a folder are read from there when they are asked for; a run without one keeps them in memory. ``timing`` is in
    seconds by stage: compile, sample, kernel, write; the last goes on while the kernel flies, so the sum can exceed the time taken.
    ``flight`` is how it was flown, ``accuracy`` its numerical error, ``notes`` what deserves a look: an accuracy that is not met, a
    nominal case that goes together instead of apart.
    """

    campaign: "Campaign"
    kept: Kept
    timing: dict[str, float]
    seed: int
    folder: Path | None = None
    notes: list[str] = field(default_factory=list)
    flight: Flight | None = None
    accuracy: Achieved | None = None

    def __repr__(self) -> str:
        counts = ", ".join(f"{count} {label}" for label, count in self.status_counts.items() if count)
        return f"<Result of {self.campaign.name}, seed {self.seed}: {counts}{f', in {self.folder}' if self.folder else ''}>"

    @property
    def table(self) -> dict[str, np.ndarray]:
        """The case table by column. Raises ValueError if no rows were kept."""
        return dict(self._rows())

    def to_pandas(self) -> pd.DataFrame:
        """One row per case: case, status, inputs (``in_...``), outcomes and audit columns.

        Raises
        ------
        ValueError
            If only statistics were kept, ``stats_only=True``.
        """
        return pd.DataFrame(self.table)

    def histories(self) -> pd.DataFrame | None:
        """Separation over time in long form (case, time_s, ...), or None if ``run.history_step_s`` is 0."""
        self._rows()
        if self.folder:
            return store.read_histories(self.folder)
        return None if self.kept.histories is None else pd.DataFrame(dict(self.kept.histories))

    def statistics(self) -> pd.DataFrame:
        """Statistics of every outcome; see `sepmc.analysis.statistics.statistics`."""
        table = self.kept.summary.statistics(self.campaign.reference)
        if self.accuracy:
            table["error"] = [self.accuracy.errors.get(str(name), np.nan) for name in table.index]
        return table

    def case(self, number: int) -> "Case":
        """Case ``number`` as it was flown here, fully resolved in SI."""
        return self.campaign.case(number, self.seed)

    @property
    def outcomes(self) -> list[str]:
        """Names of the outcome columns."""
        return [column.name for column in self.campaign.outcome_columns]

    @property
    def units(self) -> dict[str, str]:
        return {column.name: column.unit for column in self.campaign.columns}

    @property
    def status_counts(self) -> dict[str, int]:
        return {label: count for label, count in self.kept.summary.counts.items() if count}

    def _rows(self) -> Mapping[str, np.ndarray]:
        if self.kept.rows is None:
            raise InputError(
                "this run kept statistics only, so it has no rows; run without stats_only, or fly single cases by case(number)"
            )
        return self.kept.rows
