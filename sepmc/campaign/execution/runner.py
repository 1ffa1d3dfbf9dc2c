"""The chunks of one run: each is drawn and flown, and handed to a sink while the next one flies;
the manifest says how far the run got."""

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

from sepmc.analysis.constant_outcomes import reach
from sepmc.analysis.quantile_sketch import ROOM
from sepmc.analysis.rare_values import Occurrence, not_shown, occurrences
from sepmc.analysis.stopping import StoppingRule
from sepmc.analysis.streaming import GRAIN
from sepmc.campaign.case_selection import CaseSelection
from sepmc.campaign.definition import Definition
from sepmc.campaign.execution.accuracy import AchievedAccuracy, with_errors
from sepmc.campaign.execution.batch_summary import BatchSummary, accuracy, accuracy_told
from sepmc.campaign.execution.chunk import Chunk, SampleSpec, integrate_chunk
from sepmc.campaign.execution.diagnostics import (
    failed,
    mixed,
    sampled,
    still_near,
    unmet,
    unsettled,
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

_FIRST = 256  # cases flown first, to see how long they take
# a call into compiled code cannot be interrupted and tells no progress: it flies what takes about
# so long
_CALL_S = 0.5
_SAVE_S = 10.0  # from one writing of what is counted to the next: it takes a tenth of a second
# what took longer to fly is handed over before its chunk is full, so that little is lost with the
# machine
_PART_S = 5.0
# ranges for each worker, at least; grains that are counted in one
_FEW, _COUNTED = 4, 8


@dataclass(frozen=True)
class ExecutionOptions:
    """How cases are to be flown: with how many ``threads``, or by a ``crew``; ``until`` a statistic
    is known, or more than ``max_failures`` failed; ``stats_only``, with the rows that are to be
    ``keep``-t, or with all rows; who is told of ``progress``, and what is to ``announce``."""

    threads: int | None = None
    crew: Executor | None = None
    until: StoppingRule | None = None
    max_failures: int | None = None
    stats_only: bool = False
    keep: KeepRules | None = None
    progress: Callable[[int, int, int], None] | None = None
    announce: Log | None = None


@dataclass(frozen=True)
class PreviousRun:
    """What a run that is resumed holds already: how many cases, what was counted of them, by which
    commands they were flown, and of a run of statistics these, as `Chunks.save` wrote them."""

    held: int = 0
    tally: BatchSummary = field(default_factory=BatchSummary)
    sessions: tuple[dict[str, Any], ...] = ()
    arrays: tuple[np.ndarray, ...] = ()


class Runner:
    """The chunks of one run. Enter it to fly; leaving it waits for what is still being written, and
    raises what went wrong there."""

    def __init__(
        self,
        campaign: Definition,
        flight: Integration,
        draws: SampleSpec,
        timing: dict[str, float],
        earlier: PreviousRun,
        folder: Path | None,
        orders: ExecutionOptions,
    ):
        self.campaign, self.flight, self.draws = campaign, flight, draws
        self.timing, self.earlier, self.folder = timing, earlier, folder
        self.wanted = draws.numbers.count - earlier.held
        self._known = ""  # how well a statistic is known that decides how many cases are flown
        self._stopped: list[str] = []  # the same if it is not enough
        self.orders = orders
        stats_only, announce = orders.stats_only, orders.announce
        self.flown, self.failures = 0, 0
        self.held = 0  # those that the sink has taken
        self.tally = earlier.tally
        self.started = datetime.now(UTC)
        self.separation = campaign.over_time(not stats_only)
        self.forecast = forecast(campaign, self.wanted, bool(self.separation))
        self.size, self._foretold = self.forecast.chunk, announce is None
        self.rows: SelectedRowWriter | None = None  # that are kept though cases are let go
        if folder and orders.keep:
            chosen = RowSelection(orders.keep, campaign.file.requirements)
            self.rows = SelectedRowWriter(campaign, folder, draws, chosen)
        self.sink: Sink = (
            StatisticsSink(campaign, self.rows)
            if stats_only
            else ParquetSink(campaign, self.separation, folder, draws)
            if folder
            else MemorySink(campaign, self.separation)
        )
        if earlier.arrays:
            self._restore(earlier.arrays)
        # statistics are those of the cases held, and when they were written
        self._sound, self._saved = True, time.monotonic()
        self._call = _FIRST
        self._seconds = 1e-9  # that a worker takes for a case
        self.kinds: Counter[str] = Counter()  # cases that workers flew, by their kind
        self._beside = ThreadPoolExecutor(1)
        self._taking: Future[None] | None = None

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
            self._beside.shutdown()

    def fly(self, first: int, end: int, tell: Callable[[], None]) -> None:
        """Fly cases ``first`` to ``end`` in calls of about half a second, and ``tell`` after each.
        What is flown is handed over even if this is interrupted, or too many fail."""
        chunks: list[Chunk] = []
        begun = time.perf_counter()
        try:
            while first < end:
                now = time.perf_counter()
                if now - begun > _PART_S:
                    chunks, begun = self._hand_over(chunks), now
                until = min(end, first + self._call)
                compiled = self.timing["compile"]
                chunk = self._fly(first, until)
                chunks.append(chunk)
                seconds = time.perf_counter() - now - (self.timing["compile"] - compiled)
                self._call = max(
                    1, int(min(self.size, (until - first) * _CALL_S / max(seconds, 1e-9)))
                )
                first = until
                if self.flown or seconds > _CALL_S:  # the first ones are few, and slow
                    self._foretell(seconds / len(chunk.drawn))
                self.flown += len(chunk.drawn)
                self.failures += int(np.count_nonzero(chunk.block.status != Status.OK))
                if first == end:
                    chunks = self._hand_over(chunks)
                tell()
                if self.too_many_failed:
                    break
        finally:
            self._hand_over(chunks)

    def _fly(self, first: int, end: int) -> Chunk:
        return integrate_chunk(
            self.campaign,
            self.flight,
            self.draws,
            first,
            end,
            bool(self.separation),
            self.timing,
            self.orders.announce,
        )

    def fly_by(self, crew: Executor, numbers: CaseSelection, tell: Callable[[], None]) -> None:
        """Let others fly cases, and ``tell`` after each range that is done. Of statistics alone the
        first ones are flown here: they lay out the grids that all are counted in."""
        assert self.folder is not None
        stream = self.sink.stream if isinstance(self.sink, StatisticsSink) else None
        done = 0
        if stream:
            held = self.earlier.held
            done = min(max(ROOM, held + -held % GRAIN), numbers.end)
            self.fly(held, done, tell)
            self._wait()
            if self.too_many_failed:
                return
        text = (self.folder / folders.CAMPAIGN).read_bytes()
        left = CaseSelection(tuple((max(a, done), b) for a, b in numbers.ranges if b > done))
        try:
            job = Job(
                self.folder.absolute(),
                ledger.checksum(text),
                folders.call(self.folder),
                self.flight.packed,
                self.draws,
                stream.apart() if stream else None,
                self.orders.keep,
            )
            ranges = self._ranges(left, crew.workers)
            with closing(crew.map(job, run_range, ranges)) as results:
                for flown in _in_order(results, done) if stream else results:
                    if stream:
                        assert flown.apart is not None
                        self._sound = False
                        stream.take(flown.apart)
                    self._receive(flown)
                    self._sound = True
                    self._save_at_times()
                    tell()
                    if self.too_many_failed:
                        break
        finally:
            folders.call_off(self.folder)
        folders.sweep_parts(self.folder)

    def _ranges(self, left: CaseSelection, workers: int) -> Iterator[tuple[int, int]]:
        """Ranges of what is left, each of which a worker flies in a few seconds, but no fewer than
        a few for every worker."""
        grain = GRAIN if self.orders.stats_only else 1
        most = max(grain, -(-left.count // (_FEW * workers)))
        most = min(most, self.size if not self.orders.stats_only else _COUNTED * GRAIN)
        for first, end in left.ranges:
            start = first
            while start < end:
                size = min(most, max(_FIRST, int(_PART_S / self._seconds)))
                stop = min(end, start + -(-size // grain) * grain)
                yield start, stop
                start = stop

    def _receive(self, flown: RangeResult) -> None:
        """Take what a worker has flown."""
        if flown.parts:
            assert self.folder is not None
            shards.note_parts(self.folder, flown.parts)
        if flown.chosen and self.rows:
            self.rows.chosen.take(flown.chosen)
        self.tally += flown.tally
        self.flown += flown.cases
        self.held += flown.cases
        self.failures += flown.tally.failures
        for stage, seconds in flown.timing.items():
            self.timing[stage] += seconds
        spent = flown.timing["sample"] + flown.timing["kernel"]
        self._seconds = max(self._seconds, spent / flown.cases)
        self.kinds[flown.kind] += flown.cases

    def _foretell(self, seconds: float) -> None:
        """Say once, of a long run, what it takes at so many seconds a case."""
        if not self._foretold:
            self._foretold = True
            said = self.forecast.sentence(seconds, bool(self.folder) and not self.orders.stats_only)
            if said and self.orders.announce:
                self.orders.announce(said)

    @property
    def too_many_failed(self) -> bool:
        """Whether more cases failed than may."""
        failed = self.earlier.tally.failures + self.failures
        return self.orders.max_failures is not None and failed > self.orders.max_failures

    def _hand_over(self, chunks: list[Chunk]) -> list[Chunk]:
        """Let the sink take the pieces, beside what is flown next. One list at a time waits, so
        memory is bounded. Returns a new list."""
        if chunks:
            self._wait()
            self._taking = self._beside.submit(self._take, chunks)
        return []

    def _take(self, chunks: list[Chunk]) -> None:
        start = time.perf_counter()
        self._sound = False
        self.sink.take(chunks)
        self.held += sum(len(chunk.drawn) for chunk in chunks)
        self.tally = sum((chunk.tally for chunk in chunks), self.tally)
        self._sound = True
        self._save_at_times()
        self.timing["write"] += time.perf_counter() - start

    def _wait(self) -> None:
        """Wait for what is being taken; raises what went wrong."""
        taking, self._taking = self._taking, None
        if taking:
            taking.result()

    def _save_at_times(self) -> None:
        if time.monotonic() - self._saved > _SAVE_S:
            self.save()

    def save(self) -> None:
        """Write what is counted so far, if cases are let go: where an interrupted run goes on
        from."""
        sink = self.sink
        if self.folder is None or not (isinstance(sink, StatisticsSink) and self._sound):
            return
        about = sink.about(self.draws, self.tally)
        if self.rows:
            rows = sum(part.cases for part in shards.parts(self.folder, folders.KEPT))
            about["rows"] = str(rows)
        arrays = [*sink.stream.state(), *(self.rows.chosen.state() if self.rows else ())]
        shards.write_counted(self.folder, self.earlier.held + self.held, arrays, about)
        self._saved = time.monotonic()

    def _restore(self, arrays: Iterable[np.ndarray]) -> None:
        """Go on from what was counted. Raises StoreError if it is of another run."""
        assert isinstance(self.sink, StatisticsSink)
        held = iter(arrays)
        try:
            with np.errstate(invalid="raise"):  # where what is to be whole is no number
                self.sink.stream.restore(held)
                if self.rows:
                    self.rows.chosen.restore(held)
        except (ValueError, ArithmeticError, StopIteration) as error:
            raise folders.StoreError(
                f"{self.folder}: {error}; fly it with {switch('overwrite')}"
            ) from None

    def finish(self) -> None:
        """Let go of rows that are not to be kept, now that all are known."""
        self._wait()
        if self.rows:
            self.save()  # later rows would be kept twice
            self.rows.finish()

    def write_manifest(self, complete: bool) -> None:
        """Say what the folder holds, in it."""
        assert self.folder is not None
        campaign = self.campaign
        manifest = {
            "campaign": campaign.name,
            "digest": campaign.digest,
            "seed": self.draws.seed,
            "sampler": campaign.scene.run.sampler,
            "settings": campaign.settings,
            "cases": self.draws.numbers.count,
            **self._which,
            "complete": complete,
            "stats_only": self.orders.stats_only,
            **({"keep": self.orders.keep.text} if self.orders.keep else {}),
            "cases_held": 0 if self.orders.stats_only else self.earlier.held + self.held,
            "failures": self.tally.failures,
            "implausible_inertias": self.tally.implausible,
            "accuracy": self._accuracy(),
            "notes": self.notes,
            "rarely_drawn": not_shown(self.occurred),
            "least_at_the_end": self.tally.least_at_the_end,
            **({"stopping_rule": self.orders.until.text} if self.orders.until else {}),
            "missing": self.tally.missing,
            **({"until": self._known} if self._known else {}),
            "sessions": [*self.earlier.sessions, self._session()],
        }
        try:
            text = shards.campaign_text(campaign.file, cases=self.draws.total, seed=self.draws.seed)
            manifests.write_manifest(self.folder, manifest, text)
        except OSError as error:
            raise folders.StoreError(
                f"{self.folder}: cannot be written: {error.strerror or error}"
            ) from None

    @property
    def _which(self) -> dict[str, Any]:
        """Which cases are wanted, unless they are the first ones, and of how many."""
        told = self.draws.told
        return {"numbers": told, "of": self.draws.total} if told else {}

    def _session(self) -> dict[str, Any]:
        """What this command did, on what."""
        return {
            "cases_flown": self.flown,
            "started": self.started.isoformat(timespec="seconds"),
            "finished": datetime.now(UTC).isoformat(timespec="seconds"),
            "timing_s": {k: round(v, 6) for k, v in self.timing.items()},
            "threads": self.orders.threads or os.cpu_count(),
            **({"flown_by": dict(self.kinds)} if self.kinds else {}),
            **manifests.versions(),
        }

    @property
    def accuracy(self) -> AchievedAccuracy:
        """Error of the run: the largest of its cases and of the trial cases."""
        return accuracy(self.flight, self.tally)

    def _accuracy(self) -> dict[str, Any]:
        return accuracy_told(self.campaign, self.flight, self.tally)

    @property
    def notes(self) -> list[str]:
        """What a person should know of the run."""
        told, fixed = self.accuracy, self.campaign.scene.solver.step is not None
        note = implausible_note(self.tally.implausible, self.earlier.held + self.held)
        found = [
            *([note] if note else []),
            *mixed(self.kinds),
            *sampled(self.campaign, self.draws.numbers),
            *not_shown(self.occurred),
            *unmet(told, fixed),
            *unsettled(self.tally.unsettled, self.tally.finer),
            *still_near(self.tally.least_at_the_end),
            *missing_notes(
                self.campaign,
                self.tally.missing,
                self.earlier.held + self.held - self.tally.failures,
            ),
            *self._stopped,
            *failed(self.tally.failures, self.earlier.held + self.held, self.orders.max_failures),
        ]
        return found + [note for note in self.flight.notes if note not in found]

    def is_known(self, until: StoppingRule, end: int, looks: int) -> bool:
        """Whether cases up to ``end`` are enough to know a statistic, which is looked at so many
        times at most; these are then all that are wanted. Cases beyond, which a resumed run may
        hold, were flown as those before them were not enough."""
        summary = self.kept().summary
        held = self.earlier.held + self.held
        if held > end:
            return False
        if self.orders.stats_only:  # to be asked would end its grain of cases here
            summary = copy.deepcopy(summary)
        table = with_errors(self.campaign, self.accuracy.errors, summary.statistics())
        within = reach(table, until.metric) if until.metric in table.index else 0.0
        look = until.look(summary, looks, self.occurred, within)
        self._known = until.sentence(look, held, self.draws.numbers.count)
        self._stopped = [] if look.enough else [self._known]
        if look.enough:
            self.wanted = self.held
            self.draws = SampleSpec(self.draws.seed, CaseSelection.first(held), held)
            if self.orders.announce:
                self.orders.announce(self._known)
        return look.enough

    @property
    def occurred(self) -> list[Occurrence]:
        """How often values occurred that the file gives a probability."""
        return occurrences(self.campaign.rare_values, self.tally.occurred)

    def kept(self) -> RunOutput:
        """What the run leaves of what is flown so far."""
        self._wait()
        return self.sink.kept()


def _in_order(results: Iterable[RangeResult], first: int) -> Iterator[RangeResult]:
    """Results as their cases follow each other, from the ``first``."""
    waiting: dict[int, RangeResult] = {}
    for flown in results:
        waiting[flown.first] = flown
        while first in waiting:
            following = waiting.pop(first)
            yield following
            first += following.cases


def implausible_note(broken: int, drawn: int) -> str:
    """The sentence that counts inertias no solid body has; empty if there is none."""
    return (
        f"{broken} of {drawn} drawn cases have an inertia that breaks the triangle inequality, "
        "which no solid body has"
        if broken
        else ""
    )
