"""What a run will take, before it is flown: disk, memory and time."""

import shutil
from dataclasses import dataclass
from pathlib import Path

from sepmc.campaign.definition import Definition
from sepmc.campaign.execution.integration import history_rows
from sepmc.campaign.store.row_selection import KeepRules
from sepmc.campaign.store.untrusted_files import StoreError
from sepmc.paths import is_local
from sepmc.wording import option, setting, switch

_ROOM = 2**26  # bytes of histories and rows that one part may take in memory
_AT_ONCE = 3  # parts in memory: one flies, one waits, one is written
_BASE = 300e6  # bytes that a process takes beside
# Of the bytes in memory, what a file takes at least: numbers that are dispersed do not compress,
# of histories times and numbers of cases do. Measured on shipped campaigns: 0.86 and 0.53.
_ROWS, _HISTORIES = 0.8, 0.45
_LONG_S, _LARGE = 20.0, 5e9  # worth a word before a run


@dataclass(frozen=True)
class Forecast:
    """Bytes of the rows and histories of so many ``cases``, and how many of these are in memory at
    once."""

    cases: int
    row: int
    history: int
    chunk: int

    @property
    def disk(self) -> tuple[float, float]:
        """Bytes of a run folder, at least and at most."""
        least = _ROWS * self.row + _HISTORIES * self.history
        return self.cases * least, self.cases * float(self.row + self.history)

    @property
    def memory(self) -> float:
        """Bytes of memory, about."""
        return _BASE + _AT_ONCE * min(self.chunk, self.cases) * float(self.row + self.history)

    def check_disk(self, folder: Path) -> None:
        """Raise StoreError, with the figures, if the disk of a folder cannot hold the cases."""
        if not is_local(folder):
            return
        free, (least, most) = shutil.disk_usage(_there(folder)).free, self.disk
        if least <= free:
            return
        ways = f"{switch('stats_only')} keeps no rows"
        if _HISTORIES * self.history > 0.1 * least / self.cases:
            part = self.history / (self.row + self.history)
            ways += f", {setting('run.history_step_s', 0)} no histories ({100 * part:.0f} % of it)"
        raise StoreError(
            f"{folder}: {self.cases} cases take {size_text(least)} to {size_text(most)}, and "
            f"{size_text(free)} are free there; {ways}, or choose another {option('out')}"
        )

    def sentence(self, seconds: float, on_disk: bool) -> str:
        """What the cases take at so many seconds a case; nothing where that is little."""
        time, most = self.cases * seconds, self.disk[1] if on_disk else 0.0
        if time < _LONG_S and most < _LARGE:
            return ""
        disk = f", up to {size_text(most)} on disk" if on_disk else ""
        return (
            f"about {time_text(time)} for {self.cases} cases ({1e6 * seconds:.3g} us each){disk}, "
            f"{size_text(self.memory)} in memory"
        )


def forecast(
    campaign: Definition, cases: int, with_histories: bool, keep: KeepRules | None = None
) -> Forecast:
    """What so many cases of a campaign take, with all their columns or those that are kept."""
    columns = campaign.over_time(with_histories)
    rows = history_rows(campaign.scene) if columns else 0
    kept = keep.columns(campaign.columns) if keep else campaign.columns
    row = (4 if keep and keep.single else 8) * len(kept)
    history = 8 * rows * (2 + len(columns))
    chunk = max(1, min(campaign.scene.run.chunk, _ROOM // (history + 2 * row)))
    return Forecast(cases, row, history, chunk)


def _there(folder: Path) -> Path:
    """A folder, or the nearest above it that exists."""
    return next((path for path in (folder, *folder.absolute().parents) if path.exists()), Path())


def size_text(count: float) -> str:
    """Bytes, as text."""
    for unit in ("B", "kB", "MB"):
        if count < 1000:
            return f"{count:.0f} {unit}"
        count /= 1000
    return f"{count:.1f} GB"


def time_text(seconds: float) -> str:
    """Seconds, as text."""
    if seconds < 100:
        return f"{seconds:.2g} s"
    return f"{seconds / 60:.0f} min" if seconds < 6000 else f"{seconds / 3600:.1f} h"
