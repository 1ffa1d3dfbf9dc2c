"""Forecast of the disk space, memory and time that a run will need."""

import shutil
from dataclasses import dataclass
from pathlib import Path

from sepmc.campaign.definition import Definition
from sepmc.campaign.execution.integration import history_rows
from sepmc.campaign.store.row_selection import KeepRules
from sepmc.campaign.store.untrusted import StoreError
from sepmc.paths import is_local
from sepmc.wording import count_cases, option, setting, switch

_SHARD_BYTES = 2**26  # bytes of histories and rows of a shard in memory, at most
_SHARDS_IN_MEMORY = 3  # one is run, one waits, one is written
_PROCESS_BYTES = 300e6  # bytes of a process without shards
# Minimum ratio of file size to memory: dispersed numbers do not compress; times and case numbers of
# histories do. Measured on shipped campaigns: 0.86 and 0.53.
_ROWS, _HISTORIES = 0.8, 0.45
_LONG_S, _LARGE = 20.0, 5e9  # shorter and smaller runs are not announced


@dataclass(frozen=True)
class Forecast:
    """Forecast size of a run.

    Attributes
    ----------
    cases : int
        Number of cases.
    row, history : int
        Bytes in memory of one case: of its row in the case table, and of its stored history (0 if
        none is stored).
    shard_size : int
        Maximum number of cases in a shard (one Parquet file).
    """

    cases: int
    row: int
    history: int
    shard_size: int

    @property
    def disk_bytes(self) -> tuple[float, float]:
        """Smallest and largest probable size of the run folder, bytes; they differ by how far the
        numbers can be compressed."""
        min_bytes = _ROWS * self.row + _HISTORIES * self.history
        return self.cases * min_bytes, self.cases * float(self.row + self.history)

    @property
    def memory_bytes(self) -> float:
        """Approximate memory that the run needs, bytes: that of the process, and that of the rows
        and histories of three shards. Workers and statistics are not counted."""
        return _PROCESS_BYTES + _SHARDS_IN_MEMORY * min(self.shard_size, self.cases) * float(
            self.row + self.history
        )

    def check_disk(self, folder: Path) -> None:
        """Raise StoreError if the disk of a local folder has less free space than the smallest
        probable size of the run."""
        if not is_local(folder):
            return
        free, (min_bytes, max_bytes) = (
            shutil.disk_usage(_nearest_existing(folder)).free,
            self.disk_bytes,
        )
        if min_bytes <= free:
            return
        advice = f"{switch('stats_only')} stores no rows"
        if _HISTORIES * self.history > 0.1 * min_bytes / self.cases:
            fraction = self.history / (self.row + self.history)
            advice += (
                f", {setting('run.history_step_s', 0)} no histories ({100 * fraction:.0f} % of it)"
            )
        raise StoreError(
            f"{folder}: {self.cases} cases take {size_text(min_bytes)} to {size_text(max_bytes)}, "
            f"and {size_text(free)} are free there; {advice}, or choose another {option('out')}"
        )

    def sentence(self, seconds: float, on_disk: bool) -> str:
        """Sentence that announces time, disk space (if ``on_disk``: rows are stored) and memory of
        the run at ``seconds`` per case; empty if the run takes less than 20 s and less than 5 GB
        of disk space."""
        time, max_bytes = self.cases * seconds, self.disk_bytes[1] if on_disk else 0.0
        if time < _LONG_S and max_bytes < _LARGE:
            return ""
        disk = f", up to {size_text(max_bytes)} on disk" if on_disk else ""
        return (
            f"about {time_text(time)} for {count_cases(self.cases)} ({1e6 * seconds:.3g} us each)"
            f"{disk}, {size_text(self.memory_bytes)} in memory"
        )


def forecast(
    campaign: Definition, cases: int, with_histories: bool, keep: KeepRules | None = None
) -> Forecast:
    """Forecast the size of a run from the columns that it stores.

    Parameters
    ----------
    campaign : Definition
    cases : int
        Number of cases.
    with_histories : bool
        True if histories are stored, provided that the campaign has them.
    keep : KeepRules, optional
        Rules that reduce the columns of rows, or their precision.

    Returns
    -------
    Forecast
    """
    columns = campaign.stored_history_columns(with_histories)
    rows = history_rows(campaign.scene) if columns else 0
    columns_kept = keep.columns(campaign.columns) if keep else campaign.columns
    row = (4 if keep and keep.single else 8) * len(columns_kept)
    history = 8 * rows * (2 + len(columns))
    shard_size = max(1, min(campaign.scene.run.chunk, _SHARD_BYTES // (history + 2 * row)))
    return Forecast(cases, row, history, shard_size)


def _nearest_existing(folder: Path) -> Path:
    """The folder or its nearest existing parent."""
    return next((path for path in (folder, *folder.absolute().parents) if path.exists()), Path())


def size_text(count: float) -> str:
    """Number of bytes as text, in B, kB, MB or GB (powers of 1000): a whole number, in GB with one
    decimal."""
    for unit in ("B", "kB", "MB"):
        if count < 1000:
            return f"{count:.0f} {unit}"
        count /= 1000
    return f"{count:.1f} GB"


def time_text(seconds: float) -> str:
    """Duration as text: in s below 100 s, in min below 100 min, else in h."""
    if seconds < 100:
        return f"{seconds:.2g} s"
    return f"{seconds / 60:.0f} min" if seconds < 6000 else f"{seconds / 3600:.1f} h"
