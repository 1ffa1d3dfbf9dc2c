"""Ranges of cases that worker processes run: the job, the result and the executor interface."""

import platform
import threading
from collections.abc import Callable, Generator, Iterable
from dataclasses import dataclass
from pathlib import Path
from typing import Protocol

from sepmc import __version__
from sepmc.analysis.streaming import PartialStatistics
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
    """Description of a run that workers need.

    Attributes
    ----------
    folder : Path
        Run folder, which all workers see under this path.
    campaign : str
        Checksum of the campaign file in the folder.
    lease : str
        Token of `sepmc.campaign.store.folders.issue_lease`.
    integration : Integration
        Without kernels; see `Integration.packed`.
    spec : SampleSpec
        Sample that the cases belong to.
    accumulator : PartialStatistics or None
        Empty statistics to add cases to; None if rows are written.
    keep : KeepRules or None
        Rules for rows that are saved beside statistics.
    """

    folder: Path
    campaign: str
    lease: str
    integration: Integration
    spec: SampleSpec
    accumulator: PartialStatistics | None = None
    keep: KeepRules | None = None

    @property
    def key(self) -> tuple[str, str, bool]:
        """Key of the campaign and kernel that a process loads for the job."""
        return str(self.folder), self.campaign, self.accumulator is None


@dataclass(frozen=True)
class RangeResult:
    """Result of cases ``first`` to ``first + cases`` - 1.

    Attributes
    ----------
    first, cases : int
        First case, and number of cases.
    summary : BatchSummary
        Counts and largest errors of the cases.
    timing : dict of str to float
        Seconds by stage.
    kind : str
        Code version and processor of the worker.
    shards : tuple of Entry
        Ledger entries of the files written.
    accumulator : PartialStatistics or None
        Statistics of the cases; None if rows are written.
    selection : RowSelection or None
        Worst cases of the range, by the rules for rows that are saved beside statistics.
    """

    first: int
    cases: int
    summary: BatchSummary
    timing: dict[str, float]
    kind: str
    shards: tuple[ledger.Entry, ...] = ()
    accumulator: PartialStatistics | None = None
    selection: RowSelection | None = None


class Executor(Protocol):
    """Workers, a number ``workers`` of them, on this machine or others."""

    workers: int

    def map(
        self,
        job: Job,
        function: Callable[[Job, int, int, int], RangeResult],
        ranges: Iterable[tuple[int, int]],
    ) -> Generator[RangeResult]:
        """Call ``function(job, first, end, threads)`` for each range; yield results as they
        complete.

        Ranges are taken one by one, a few ahead of the completed ones.
        """


class StaleWorkerError(RuntimeError):
    """The worker sees another state of the run folder than the command."""


# one range runs at a time in a process, while rows of another are written
_running = threading.Lock()


def run_range(job: Job, first: int, end: int, threads: int) -> RangeResult:
    """Run cases ``first`` to ``end`` - 1 of a job in a worker, on some threads, and write their
    shards; the caller records these in the ledger.

    Raises
    ------
    StaleWorkerError
        If the folder is not the one of the job, or its lease was revoked.
    """
    timing = {"compile": 0.0, "sample": 0.0, "kernel": 0.0}
    with _running:
        campaign, integration = _ready(job)
        separation = campaign.stored_history_columns(job.accumulator is None)
        with using_threads(threads):
            chunks = [
                integrate_chunk(
                    campaign, integration, job.spec, first, end, bool(separation), timing
                )
            ]
    if not folders.lease_is_valid(job.folder, job.lease):
        raise StaleWorkerError(
            f"{job.folder}: the campaign no longer waits for this worker: its cases {first} to "
            f"{end - 1} are not written"
        )
    shards: list[ledger.Entry] = []
    selection = RowSelection(job.keep, campaign.file.requirements) if job.keep else None
    if job.accumulator:
        add_to(job.accumulator, campaign, chunks)
        if selection:
            shards = SelectedRowWriter(campaign, job.folder, job.spec, selection).write(chunks)
    else:
        shards = ParquetSink(campaign, separation, job.folder, job.spec).write(chunks)
    return RangeResult(
        first,
        end - first,
        chunks[0].summary,
        timing,
        kind(),
        tuple(shards),
        job.accumulator,
        selection,
    )


def kind() -> str:
    """Code version and processor of this process: rows of one kind have the same bits."""
    from sepmc.code_cache import processor, sources_digest  # noqa: PLC0415  (llvmlite)

    return f"sepmc {__version__}, {processor()}, code {sources_digest()}"


_last: dict[tuple[str, str, bool], tuple[Definition, Integration]] = {}


def _ready(job: Job) -> tuple[Definition, Integration]:
    """Campaign and integration (with kernels) of a job, loaded once in a process. Raises
    StaleWorkerError if the campaign file is missing or another one."""
    if job.key not in _last:
        text = job.folder / folders.CAMPAIGN
        try:
            checksum = ledger.checksum(text.read_bytes())
        except OSError as error:
            raise StaleWorkerError(
                f"{text}: a worker on {platform.node()} cannot read it: {error.strerror}; "
                "it must be in a folder that all workers see under this path"
            ) from None
        if checksum != job.campaign:
            raise StaleWorkerError(
                f"{text}: a worker on {platform.node()} sees another campaign there; it must "
                "be in a folder that all workers share"
            )
        campaign = Definition(read_campaign(text, reader=read_input_table))
        history = campaign.has_histories and job.accumulator is None
        _last.clear()
        _last[job.key] = campaign, unpacked(campaign, job.integration, history)
    return _last[job.key]
