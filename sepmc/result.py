"""What a campaign gave: the case table, histories, statistics, timing."""

from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
import pandas as pd

if TYPE_CHECKING:
    from sepmc.campaign import Campaign, Case


@dataclass(repr=False)
class Result:
    """What a campaign gave. ``timing`` is in seconds by stage: compile, sample, kernel, write."""

    campaign: "Campaign"
    table: dict[str, np.ndarray]
    history: dict[str, np.ndarray] | None
    timing: dict[str, float]
    seed: int
    folder: Path | None = None
    notes: list[str] = field(default_factory=list)

    def __repr__(self) -> str:
        counts = ", ".join(f"{count} {label}" for label, count in self.status_counts.items())
        return f"<Result of {self.campaign.name}, seed {self.seed}: {counts}{f', in {self.folder}' if self.folder else ''}>"

    def to_pandas(self) -> pd.DataFrame:
        """One row per case: case, status, inputs (``in_...``), outcomes and audit columns."""
        return pd.DataFrame(self.table)

    def histories(self) -> pd.DataFrame | None:
        """Separation over time in long form (case, time_s, ...), or None if ``run.history_step_s`` is 0."""
        return None if self.history is None else pd.DataFrame(self.history)

    def statistics(self) -> pd.DataFrame:
        """Statistics of every outcome; see `sepmc.analysis.statistics.statistics`."""
        from sepmc.analysis.statistics import statistics  # noqa: PLC0415

        return statistics(self.to_pandas(), self.outcomes, self.campaign.reference)

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
        labels, counts = np.unique(self.table["status"], return_counts=True)
        return dict(zip(labels.tolist(), counts.tolist(), strict=True))
