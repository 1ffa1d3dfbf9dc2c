"""Execution of a run in chunks of cases: while one is sampled and integrated, a sink stores the
ones before, as rows or as statistics.

The manifest of the run folder states how many cases are stored.
"""

import copy
import os
import time
from collections import Counter
from collections.abc import Callable, Iterable, Iterator
from concurrent.futures import Future, ThreadPoolExecutor
from contextlib import closing
from dataclasses import dataclass, field
from datetime import UTC, datetime
from pathlib import Path
from types import TracebackType
from typing import Any, Self

import numpy as np

from sepmc.analysis.constant_outcomes import max_spread
from sepmc.analysis.quantile_sketch import EXACT_VALUES
from sepmc.analysis.rare_values import Occurrence, occurrences, render_undersampled
from sepmc.analysis.stopping import StoppingRule
from sepmc.analysis.streaming import ACCUMULATION_BLOCK
from sepmc.campaign.case_selection import CaseSelection
from sepmc.campaign.definition import Definition
from sepmc.campaign.execution.accuracy import AchievedAccuracy, with_errors
from sepmc.campaign.execution.batch_summary import BatchSummary, accuracy, accuracy_entries
from sepmc.campaign.execution.calibration_cases import CalibrationSize
from sepmc.campaign.execution.chunk import Chunk, SampleSpec, integrate_chunk
from sepmc.campaign.execution.diagnostics import (
    accuracy_notes,
    failure_notes,
    min_at_end_notes,
    sampling_notes,
    unconverged_notes,
    worker_notes,
)
from sepmc.campaign.execution.forecast import forecast
from sepmc.campaign.execution.integration import Integration
from sepmc.campaign.execution.missing_events import missing_notes
from sepmc.campaign.execution.sinks import (
    MemorySink,
    ParquetSink,
    RunOutput,
    SelectedRowWriter,
    Sink,
    StatisticsSink,
)
from sepmc.campaign.execution.work_ranges import Executor, Job, RangeResult, run_range
from sepmc.campaign.store import folders, ledger, manifests, shards
from sepmc.campaign.store.row_selection import KeepRules, RowSelection
from sepmc.scene.messages import Log
from sepmc.schema import Status
from sepmc.wording import switch

_FIRST = 256  # cases in the first call, to measure the time of a case
# duration of a call: compiled code cannot be interrupted and reports no progress
_CALL_S = 0.5
_SAVE_S = 10.0  # between two writes of accumulators, which take 0.1 s
# a shard is written after this time although it is not full, so that a crash costs little
_SHARD_S = 5.0
# minimum number of ranges per worker; accumulation blocks in a range
_RANGES_PER_WORKER, _BLOCKS_PER_RANGE = 4, 8


@dataclass(frozen=True)
class ExecutionOptions:
    """Options of a run.

    Attributes
    ----------
    threads : int or None
        Number of threads, which the manifest states; None: the number of cores.
    executor : Executor or None
        Workers that run the cases instead of this process.
    until : StoppingRule or None
        The run stops when a statistic is known as precisely as this rule asks.
    max_failures : int or None
        The run stops when more cases than this have failed; None: no limit.
    stats_only : bool
        True: statistics are accumulated, and the rows of cases are not stored.
    keep : KeepRules or None
        Rules that select rows to be saved beside statistics, which needs ``stats_only`` and a run
        folder; None: no rows are saved.
    calibration : CalibrationSize or None
        Number of calibration cases; see `sepmc.campaign.execution.step_selection.select_steps`.
    progress : callable or None
        Called with the number of cases done, of cases to do (without those already stored), and of
        failed cases.
    announce : Log or None
        Called with messages about the run.
    """

    threads: int | None = None
    executor: Executor | None = None
    until: StoppingRule | None = None
    max_failures: int | None = None
    stats_only: bool = False
    keep: KeepRules | None = None
    calibration: CalibrationSize | None = None
    progress: Callable[[int, int, int], None] | None = None
    announce: Log | None = None


@dataclass(frozen=True)
class PreviousRun:
    """State of a run that is resumed, as read from its folder; without arguments, that of a new
    run.

    Attributes
    ----------
    n_stored : int
        Number of cases that are stored or, for a run that stores statistics only, counted.
    summary : BatchSummary
        Summary of these cases.
    sessions : tuple of dict
        Manifest entries of the commands that ran these cases.
    arrays : tuple of ndarray
        Arrays that statistics are computed from (accumulators), as `Runner.save` wrote them; empty
        for a run that stores rows.
    """

    n_stored: int = 0
    summary: BatchSummary = field(default_factory=BatchSummary)
    sessions: tuple[dict[str, Any], ...] = ()
    arrays: tuple[np.ndarray, ...] = ()


class Runner:
    """Execution of one run: integrates its cases, passes them to a sink, and writes the manifest.

    It is a context manager: leaving the context waits for pending writes and raises their errors.

    Parameters
    ----------
    campaign : Definition
    flight : Integration
        Kernel and steps.
    spec : SampleSpec
        Wanted cases, those already stored included.
    timing : dict of str to float
        Changed in place: the run adds its seconds to the values by stage (sample, compile, kernel,
        write).
    previous : PreviousRun
        State of the run in the folder; an empty one for a new run.
    folder : Path or None
        Run folder, open for writing; None: rows or statistics stay in memory.
    options : ExecutionOptions
    """

    def __init__(
        self,
        campaign: Definition,
        flight: Integration,
        spec: SampleSpec,
        timing: dict[str, float],
        previous: PreviousRun,
        folder: Path | None,
        options: ExecutionOptions,
    ):
        self.campaign, self.flight, self.spec = campaign, flight, spec
        self.timing, self.previous, self.folder = timing, previous, folder
        self.n_wanted = spec.numbers.count - previous.n_stored
        self._stopping_text = ""  # how precisely the statistic of the stopping rule is known
        self._stopping_notes: list[str] = []  # the same, if that is not enough
        self.options = options
        stats_only, announce = options.stats_only, options.announce
        self.n_run, self.failures = 0, 0
        self.n_stored = 0  # of this command, taken by the sink
        self.summary = previous.summary
        self.started = datetime.now(UTC)
        self.separation = campaign.stored_history_columns(not stats_only)
        self.forecast = forecast(campaign, self.n_wanted, bool(self.separation))
        self.size, self._forecast_reported = self.forecast.shard_size, announce is None
        self.rows: SelectedRowWriter | None = None
        if folder and options.keep:
            selection = RowSelection(options.keep, campaign.file.requirements)
            self.rows = SelectedRowWriter(campaign, folder, spec, selection)
        self.sink: Sink = (
            StatisticsSink(campaign, self.rows)
            if stats_only
            else ParquetSink(campaign, self.separation, folder, spec)
            if folder
            else MemorySink(campaign, self.separation)
        )
        if previous.arrays:
            self._restore(previous.arrays)
        # statistics and counts are of the same cases; when they were written
        self._consistent, self._saved = True, time.monotonic()
        self._call_size = _FIRST
        self._case_s = 1e-9  # a case takes in a worker
        self.worker_kinds: Counter[str] = Counter()  # cases by kind of worker
        self._writer = ThreadPoolExecutor(1)
        self._writing: Future[None] | None = None

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
        try:
            self._wait()
        finally:
            self._writer.shutdown()

    def run(self, first: int, end: int, report: Callable[[], None]) -> None:
        """Run cases ``first`` to ``end`` - 1 in this process, in chunks of about half a second, and
        pass them to the sink; call ``report`` after each chunk.

        It ends early if too many cases fail. Completed chunks are stored even if an error or an
        interruption ends it.
        """
        chunks: list[Chunk] = []
        shard_start_s = time.perf_counter()
        try:
            while first < end:
                start_s = time.perf_counter()
                if start_s - shard_start_s > _SHARD_S:
                    chunks, shard_start_s = self._hand_over(chunks), start_s
                until = min(end, first + self._call_size)
                compiled = self.timing["compile"]
                chunk = self._run_chunk(first, until)
                chunks.append(chunk)
                seconds = time.perf_counter() - start_s - (self.timing["compile"] - compiled)
                self._call_size = max(
                    1, int(min(self.size, (until - first) * _CALL_S / max(seconds, 1e-9)))
                )
                first = until
                if self.n_run or seconds > _CALL_S:  # the first call is short and slow
                    self._report_forecast(seconds / len(chunk.inputs))
                self.n_run += len(chunk.inputs)
                self.failures += int(np.count_nonzero(chunk.block.status != Status.OK))
                if first == end:
                    chunks = self._hand_over(chunks)
                report()
                if self.too_many_failed:
                    break
        finally:
            self._hand_over(chunks)

    def _run_chunk(self, first: int, end: int) -> Chunk:
        return integrate_chunk(
            self.campaign,
            self.flight,
            self.spec,
            first,
            end,
            bool(self.separation),
            self.timing,
            self.options.announce,
        )

    def run_on(
        self, executor: Executor, numbers: CaseSelection, report: Callable[[], None]
    ) -> None:
        """Let the workers of ``executor`` run the cases ``numbers``, in ranges; call ``report``
        after each completed range. It ends early if too many cases fail. The run must have a
        folder.

        If statistics are accumulated, the first cases are run in this process: they define the
        histogram grids of all others.
        """
        assert self.folder is not None
        stream = self.sink.stream if isinstance(self.sink, StatisticsSink) else None
        done = 0
        if stream:
            n_stored = self.previous.n_stored
            done = min(max(EXACT_VALUES, n_stored + -n_stored % ACCUMULATION_BLOCK), numbers.end)
            self.run(n_stored, done, report)
            self._wait()
            if self.too_many_failed:
                return
        text = (self.folder / folders.CAMPAIGN).read_bytes()
        left = CaseSelection(tuple((max(a, done), b) for a, b in numbers.ranges if b > done))
        try:
            job = Job(
                self.folder.absolute(),
                ledger.checksum(text),
                folders.issue_lease(self.folder),
                self.flight.packed,
                self.spec,
                stream.new_partial() if stream else None,
                self.options.keep,
            )
            ranges = self._ranges(left, executor.workers)
            with closing(executor.map(job, run_range, ranges)) as results:
                for result in _in_order(results, done) if stream else results:
                    if stream:
                        assert result.accumulator is not None
                        self._consistent = False
                        stream.merge(result.accumulator)
                    self._receive(result)
                    self._consistent = True
                    self._save_at_times()
                    report()
                    if self.too_many_failed:
                        break
        finally:
            folders.revoke_lease(self.folder)
        folders.remove_temporary_shards(self.folder)

    def _ranges(self, left: CaseSelection, workers: int) -> Iterator[tuple[int, int]]:
        """Yield ranges (first, end), without ``end``, of the cases ``left``, each for one of the
        ``workers``: some seconds long, and at least four for each worker. If statistics are
        accumulated, ranges are whole accumulation blocks (`ACCUMULATION_BLOCK` cases)."""
        block_size = ACCUMULATION_BLOCK if self.options.stats_only else 1
        max_size = max(block_size, -(-left.count // (_RANGES_PER_WORKER * workers)))
        max_size = min(
            max_size,
            self.size if not self.options.stats_only else _BLOCKS_PER_RANGE * ACCUMULATION_BLOCK,
        )
        for first, end in left.ranges:
            start = first
            while start < end:
                size = min(max_size, max(_FIRST, int(_SHARD_S / self._case_s)))
                stop = min(end, start + -(-size // block_size) * block_size)
                yield start, stop
                start = stop

    def _receive(self, result: RangeResult) -> None:
        """Add the counts, times and worst cases of a range that a worker ran to those of this run,
        and record the files (shards) that the worker wrote in the ledger."""
        if result.shards:
            assert self.folder is not None
            shards.record_shards(self.folder, result.shards)
        if result.selection and self.rows:
            self.rows.selection.take(result.selection)
        self.summary += result.summary
        self.n_run += result.cases
        self.n_stored += result.cases
        self.failures += result.summary.failures
        for stage, seconds in result.timing.items():
            self.timing[stage] += seconds
        spent = result.timing["sample"] + result.timing["kernel"]
        self._case_s = max(self._case_s, spent / result.cases)
        self.worker_kinds[result.kind] += result.cases

    def _report_forecast(self, seconds: float) -> None:
        """Announce the time and space that the run will take, at ``seconds`` per case: at the first
        call only, and only if the run is long or large."""
        if not self._forecast_reported:
            self._forecast_reported = True
            text = self.forecast.sentence(
                seconds, bool(self.folder) and not self.options.stats_only
            )
            if text and self.options.announce:
                self.options.announce(text)

    @property
    def n_complete(self) -> int:
        """Number of cases that are stored or counted so far, those of the resumed run included."""
        return self.previous.n_stored + self.n_stored

    @property
    def too_many_failed(self) -> bool:
        """True if more cases failed, those of the resumed run included, than ``max_failures``;
        False if that is None."""
        failure_notes = self.previous.summary.failures + self.failures
        return self.options.max_failures is not None and failure_notes > self.options.max_failures

    def _hand_over(self, chunks: list[Chunk]) -> list[Chunk]:
        """Wait until the chunks before are stored, then let the sink store these in the background;
        return an empty list, for the next chunks. At most one list is pending, so memory is
        bounded. For an empty list nothing is waited for or stored."""
        if chunks:
            self._wait()
            self._writing = self._writer.submit(self._take, chunks)
        return []

    def _take(self, chunks: list[Chunk]) -> None:
        start = time.perf_counter()
        self._consistent = False
        self.sink.take(chunks)
        self.n_stored += sum(len(chunk.inputs) for chunk in chunks)
        self.summary = sum((chunk.summary for chunk in chunks), self.summary)
        self._consistent = True
        self._save_at_times()
        self.timing["write"] += time.perf_counter() - start

    def _wait(self) -> None:
        """Wait until the pending chunks are stored; raises the error of that, if there was one."""
        taking, self._writing = self._writing, None
        if taking:
            taking.result()

    def _save_at_times(self) -> None:
        if time.monotonic() - self._saved > _SAVE_S:
            self.save()

    def save(self) -> None:
        """Write the arrays that statistics are computed from (accumulators) into the folder, so
        that the run can be resumed.

        It does nothing for a run that stores rows or has no folder, nor while cases are being
        added.
        """
        sink = self.sink
        if self.folder is None or not (isinstance(sink, StatisticsSink) and self._consistent):
            return
        about = sink.about(self.spec, self.summary)
        if self.rows:
            rows = sum(part.cases for part in shards.entries(self.folder, folders.SELECTED))
            about["rows"] = str(rows)
        arrays = [*sink.stream.state(), *(self.rows.selection.state() if self.rows else ())]
        shards.write_accumulators(self.folder, self.n_complete, arrays, about)
        self._saved = time.monotonic()

    def _restore(self, arrays: Iterable[np.ndarray]) -> None:
        """Load the accumulators of the previous run, ``arrays`` in the order in which `save` wrote
        them, into the sink and the rules for saved rows. Raises StoreError if they do not fit this
        campaign."""
        assert isinstance(self.sink, StatisticsSink)
        remaining = iter(arrays)
        try:
            with np.errstate(invalid="raise"):  # NaN where an integer is expected
                self.sink.stream.restore(remaining)
                if self.rows:
                    self.rows.selection.restore(remaining)
        except (ValueError, ArithmeticError, StopIteration) as error:
            raise folders.StoreError(
                f"{self.folder}: its statistics cannot be continued: {error}; run it again with "
                f"{switch('overwrite')}"
            ) from None

    def finish(self) -> None:
        """Wait for pending writes. In a run with statistics and rules for saved rows, then `save`
        the statistics, and remove the saved rows that no rule selects any more, now that all cases
        are known."""
        self._wait()
        if self.rows:
            self.save()  # or rows of later cases would be saved twice
            self.rows.finish()

    def write_manifest(self, complete: bool) -> None:
        """Write the manifest and the campaign text into the folder, which the run must have; the
        manifest states ``complete``, which is True if all wanted cases are stored. Raises
        StoreError if a file cannot be written."""
        assert self.folder is not None
        campaign = self.campaign
        manifest = {
            "campaign": campaign.name,
            "digest": campaign.digest,
            "seed": self.spec.seed,
            "sampler": campaign.scene.run.sampler,
            "settings": campaign.settings,
            "cases": self.spec.numbers.count,
            **self._selection_entries,
            "complete": complete,
            "stats_only": self.options.stats_only,
            **({"keep": self.options.keep.text} if self.options.keep else {}),
            "n_stored": 0 if self.options.stats_only else self.n_complete,
            "failures": self.summary.failures,
            "implausible_inertias": self.summary.implausible,
            "accuracy": self._accuracy(),
            "notes": self.notes,
            "rarely_drawn": render_undersampled(self.occurred),
            "min_at_end": self.summary.min_at_end,
            **({"stopping_rule": self.options.until.text} if self.options.until else {}),
            "missing": self.summary.missing,
            **({"until": self._stopping_text} if self._stopping_text else {}),
            "sessions": [*self.previous.sessions, self._session()],
        }
        try:
            text = shards.campaign_text(campaign.file, cases=self.spec.total, seed=self.spec.seed)
            manifests.write_manifest(self.folder, manifest, text)
        except OSError as error:
            raise folders.StoreError(
                f"{self.folder}: cannot be written: {error.strerror or error}"
            ) from None

    @property
    def _selection_entries(self) -> dict[str, Any]:
        """Manifest entries, by key: ``numbers`` (wanted case numbers, as text) and ``of`` (size of
        the sample); empty if all cases of the sample are wanted."""
        text = self.spec.text
        return {"numbers": text, "of": self.spec.total} if text else {}

    def _session(self) -> dict[str, Any]:
        """Manifest entry, by key, of the command that executes this run: number of cases that it
        has run (without those that the folder contained already), times, threads, kinds of workers
        and versions."""
        return {
            "cases_flown": self.n_run,
            "started": self.started.isoformat(timespec="seconds"),
            "finished": datetime.now(UTC).isoformat(timespec="seconds"),
            "timing_s": {k: round(v, 6) for k, v in self.timing.items()},
            "threads": self.options.threads or os.cpu_count(),
            **({"workers": dict(self.worker_kinds)} if self.worker_kinds else {}),
            **manifests.versions(),
        }

    @property
    def accuracy(self) -> AchievedAccuracy:
        """Numerical error of the run so far: by outcome the larger one of its own cases and of the
        calibration cases."""
        return accuracy(self.flight, self.summary)

    def _accuracy(self) -> dict[str, Any]:
        return accuracy_entries(self.campaign, self.flight, self.summary)

    @property
    def notes(self) -> list[str]:
        """Notes on the run so far for the user, as sentences: on the sample, its inertias and rare
        values, the numerical error, the clearances and missing events, workers of several kinds,
        why the run stopped; then those of ``flight`` that are not yet among them."""
        achieved, fixed = self.accuracy, self.campaign.scene.solver.step is not None
        note = implausible_note(self.summary.implausible, self.n_complete)
        notes = [
            *([note] if note else []),
            *worker_notes(self.worker_kinds),
            *sampling_notes(self.campaign, self.spec.numbers, self.spec.total),
            *render_undersampled(self.occurred),
            *accuracy_notes(achieved, fixed),
            *unconverged_notes(self.summary.unconverged, self.summary.refined),
            *min_at_end_notes(self.summary.min_at_end),
            *missing_notes(
                self.campaign,
                self.summary.missing,
                self.n_complete - self.summary.failures,
            ),
            *self._stopping_notes,
            *failure_notes(self.summary.failures, self.n_complete, self.options.max_failures),
        ]
        return notes + [note for note in self.flight.notes if note not in notes]

    def statistic_is_known(self, until: StoppingRule, end: int, n_looks: int) -> bool:
        """Return True if the first ``end`` cases give a statistic as precisely as the rule
        ``until`` asks. The wanted cases of the run are then reduced to these, and a sentence on the
        precision is announced.
        ``n_looks`` is the maximum number of such checks in a run, on which the confidence of each
        depends. The result is False for a resumed run with more than ``end`` cases: it went on, so
        these were not enough.
        """
        summary = self.output().summary
        if self.n_complete > end:
            return False
        if self.options.stats_only:  # reading them closes the accumulation block
            summary = copy.deepcopy(summary)
        table = with_errors(self.campaign, self.accuracy.errors, summary.statistics())
        within = max_spread(table, until.metric) if until.metric in table.index else 0.0
        look = until.look(summary, n_looks, self.occurred, within)
        self._stopping_text = until.sentence(look, self.n_complete, self.spec.numbers.count)
        self._stopping_notes = [] if look.sufficient else [self._stopping_text]
        if look.sufficient:
            self.n_wanted = self.n_stored
            self.spec = SampleSpec(
                self.spec.seed, CaseSelection.first(self.n_complete), self.n_complete
            )
            if self.options.announce:
                self.options.announce(self._stopping_text)
        return look.sufficient

    @property
    def occurred(self) -> list[Occurrence]:
        """How often each of `Definition.rare_values` occurred in the cases so far."""
        return occurrences(self.campaign.rare_values, self.summary.occurred)

    def output(self) -> RunOutput:
        """Statistics, rows and histories of the cases so far, as the sink returns them, after
        waiting for pending writes."""
        self._wait()
        return self.sink.output()


def _in_order(results: Iterable[RangeResult], first: int) -> Iterator[RangeResult]:
    """Yield the results of consecutive ranges in the order of their cases; results that come too
    early wait. ``first`` is the number of the first case of all ranges."""
    waiting: dict[int, RangeResult] = {}
    for result in results:
        waiting[result.first] = result
        while first in waiting:
            following = waiting.pop(first)
            yield following
            first += following.cases


def implausible_note(broken: int, cases: int) -> str:
    """Note for the user that ``broken`` of ``cases`` cases have an inertia that no solid body has;
    empty if ``broken`` is 0."""
    return (
        f"{broken} of {cases} sampled cases have an inertia that breaks the triangle inequality, "
        "which no solid body has"
        if broken
        else ""
    )
