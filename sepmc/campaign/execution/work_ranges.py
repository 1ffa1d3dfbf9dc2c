"""Ranges of cases that worker processes run: the job that describes the run, the result of a range,
and the interface of executors, which distribute ranges to workers."""

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
    """Description of a run, which is sent to workers: all that they need to run its cases.

    Attributes
    ----------
    folder : Path
        Run folder, which all workers see under this path.
    campaign : str
        Checksum of the campaign file in the folder.
    lease : str
        Token from `sepmc.campaign.store.folders.issue_lease`: workers write only while it is valid.
    integration : Integration
        Steps, without kernels; see `Integration.packed`.
    spec : SampleSpec
        Sample that the cases belong to.
    accumulator : PartialStatistics or None
        Empty statistics to which a worker adds its cases; None if rows are written.
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
        """Key under which a worker process keeps the campaign and kernel of the job: folder,
        checksum of the campaign, and True if rows are written."""
        return str(self.folder), self.campaign, self.accumulator is None


@dataclass(frozen=True)
class RangeResult:
    """What a worker returns for a range of cases, ``first`` to ``first + cases`` - 1.

    Attributes
    ----------
    first, cases : int
        Number of the first case, and number of cases.
    summary : BatchSummary
        Counts and largest errors of the cases.
    timing : dict of str to float
        Seconds by stage: sample, compile, kernel.
    kind : str
        Code version and processor of the worker.
    shards : tuple of Entry
        Ledger entries of the Parquet files that the worker wrote, not recorded yet.
    accumulator : PartialStatistics or None
        Statistics of the cases; None if rows are written.
    selection : RowSelection or None
        Worst cases of the range, if rows are saved beside statistics; else None.
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
    """Distributes ranges of cases to workers on this machine or others; ``workers`` is their
    number."""

    workers: int

    def map(
        self,
        job: Job,
        function: Callable[[Job, int, int, int], RangeResult],
        ranges: Iterable[tuple[int, int]],
    ) -> Generator[RangeResult]:
        """Call ``function(job, first, end, threads)`` in a worker for each range (first, end) of
        the cases ``first`` to ``end`` - 1; yield the results as they complete, in any order.

        ``ranges`` is iterated a few ranges ahead of the completed ones. An error of ``function`` is
        raised here, too.
        """


class StaleWorkerError(RuntimeError):
    """A worker sees another run folder than the command that sent the job, or the command no longer
    waits for it."""


# one range runs at a time in a process, while rows of another are written
_running = threading.Lock()


def run_range(job: Job, first: int, end: int, threads: int) -> RangeResult:
    """Run cases ``first`` to ``end`` - 1 of a job in this worker process, with a number of
    ``threads``.

    Rows, or selected rows, are written into the run folder; the caller has to record the files in
    its ledger. If statistics are accumulated, the cases are added to ``job.accumulator``, which the
    result then contains.

    Raises
    ------
    StaleWorkerError
        If the campaign file of the folder is missing or differs from that of the job, or the lease
        of the job is no longer valid.
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
    """Kind of this process, as text: code version and processor. Processes of one kind compute the
    same bits."""
    from sepmc.code_cache import processor, sources_digest  # noqa: PLC0415  (llvmlite)

    return f"sepmc {__version__}, {processor()}, code {sources_digest()}"


_last: dict[tuple[str, str, bool], tuple[Definition, Integration]] = {}


def _ready(job: Job) -> tuple[Definition, Integration]:
    """Campaign and integration (with kernels) of a job: loaded at the first call in this process,
    and kept until a job of another run comes. Only where it is loaded is the campaign file checked:
    StaleWorkerError is raised if it cannot be read or is not that of the job."""
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
