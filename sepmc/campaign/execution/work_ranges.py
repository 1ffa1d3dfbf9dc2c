"""Ranges of cases as work for other processes: what they are told, what they do, and what they give
back."""

import platform
import threading
from collections.abc import Callable, Generator, Iterable
from dataclasses import dataclass
from pathlib import Path
from typing import Protocol

from sepmc import __version__
from sepmc.analysis.streaming import Apart
from sepmc.campaign.definition import Definition
from sepmc.campaign.execution.batch_summary import BatchSummary
from sepmc.campaign.execution.chunk import SampleSpec, integrate_chunk
from sepmc.campaign.execution.integration import Integration
from sepmc.campaign.execution.sinks import ParquetSink, SelectedRowWriter, add_to
from sepmc.campaign.execution.step_selection import unpacked
from sepmc.campaign.store import folders, ledger
from sepmc.campaign.store.row_selection import KeepRules, RowSelection
from sepmc.campaign.store.sample_file import read_input_table
from sepmc.engine.dispatch import using_threads
from sepmc.scene.read import read_campaign


@dataclass(frozen=True)
class Job:
    """What flies ranges of a run. Its ``folder`` holds the campaign, whose text has the checksum
    ``campaign``, and the ``word`` by which workers know that they are called still; it takes the
    parts, if there are to be any; else cases are counted ``apart``, and some rows may be
    ``keep``-t."""

    folder: Path
    campaign: str
    word: str
    flight: Integration
    draws: SampleSpec
    apart: Apart | None = None
    keep: KeepRules | None = None

    @property
    def key(self) -> tuple[str, str, bool]:
        """What a process has to load for it, in short."""
        return str(self.folder), self.campaign, self.apart is None


@dataclass(frozen=True)
class RangeResult:
    """What became of cases ``first`` to ``first + cases``: the parts that were written, or what was
    counted apart; on a processor, by code, of some ``kind``."""

    first: int
    cases: int
    tally: BatchSummary
    timing: dict[str, float]
    kind: str
    parts: tuple[ledger.Entry, ...] = ()
    apart: Apart | None = None
    chosen: RowSelection | None = None


class Executor(Protocol):
    """Others who work: processes of this machine or of many."""

    workers: int

    def map(
        self,
        job: Job,
        function: Callable[[Job, int, int, int], RangeResult],
        ranges: Iterable[tuple[int, int]],
    ) -> Generator[RangeResult]:
        """Have ``function(job, first, end, threads)`` called for each range, which are asked for
        one by one, a few ahead; results as they come."""


class StaleWorkerError(RuntimeError):
    """A worker that does not see what the run is made of."""


# One range flies at a time in a process; another one's rows are written meanwhile.
_flying = threading.Lock()


def run_range(job: Job, first: int, end: int, threads: int) -> RangeResult:
    """Fly cases ``first`` to ``end`` of a job: what a worker does."""
    timing = {"compile": 0.0, "sample": 0.0, "kernel": 0.0}
    with _flying:
        campaign, flight = _ready(job)
        separation = campaign.over_time(job.apart is None)
        with using_threads(threads):
            chunks = [
                integrate_chunk(campaign, flight, job.draws, first, end, bool(separation), timing)
            ]
    if not folders.is_called(job.folder, job.word):
        raise StaleWorkerError(
            f"{job.folder}: nobody waits for cases {first} to {end - 1} any more"
        )
    parts: list[ledger.Entry] = []
    chosen = RowSelection(job.keep, campaign.file.requirements) if job.keep else None
    if job.apart:
        add_to(job.apart, campaign, chunks)
        if chosen:
            parts = SelectedRowWriter(campaign, job.folder, job.draws, chosen).write(chunks)
    else:
        parts = ParquetSink(campaign, separation, job.folder, job.draws).write(chunks)
    return RangeResult(
        first, end - first, chunks[0].tally, timing, kind(), tuple(parts), job.apart, chosen
    )


def kind() -> str:
    """Code and processor of this process: rows of one kind are the same to the last bit."""
    from sepmc.jit import processor, sources_digest  # noqa: PLC0415  (numba)

    return f"sepmc {__version__}, {processor()}, code {sources_digest()}"


_last: dict[tuple[str, str, bool], tuple[Definition, Integration]] = {}


def _ready(job: Job) -> tuple[Definition, Integration]:
    """The campaign and the flight of a job, loaded once in a process."""
    if job.key not in _last:
        text = job.folder / folders.CAMPAIGN
        try:
            written = ledger.checksum(text.read_bytes())
        except OSError as error:
            raise StaleWorkerError(
                f"{text}: a worker on {platform.node()} cannot read it: {error.strerror}; "
                "it must be in a folder that all workers see under this path"
            ) from None
        if written != job.campaign:
            raise StaleWorkerError(
                f"{text}: a worker on {platform.node()} sees another campaign there; it must "
                "be in a folder that all workers share"
            )
        campaign = Definition(read_campaign(text, reader=read_input_table))
        history = campaign.has_histories and job.apart is None
        _last.clear()
        _last[job.key] = campaign, unpacked(campaign, job.flight, history)
    return _last[job.key]
