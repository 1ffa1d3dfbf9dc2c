"""The chunks of one run: each is drawn and flown, and handed to a sink while the next one flies;
the manifest says how far the run got."""

import os
import time
from collections.abc import Callable
from concurrent.futures import Future, ThreadPoolExecutor
from dataclasses import dataclass, field, replace
from datetime import UTC, datetime
from pathlib import Path
from types import TracebackType
from typing import Any, Self

import numpy as np

from sepmc import schema
from sepmc.analysis.precision import Until
from sepmc.campaign import store
from sepmc.campaign.accuracy import Achieved
from sepmc.campaign.definition import Definition
from sepmc.campaign.flight import Flight, Say, fly, history_rows
from sepmc.campaign.numbers import Numbers
from sepmc.campaign.remarks import sampled, still_near, unmet, unsettled
from sepmc.campaign.sinks import InFolder, InMemory, InStatistics, Kept, Piece, Sink
from sepmc.campaign.tally import Tally, count
from sepmc.engine.door import waited_for_compilers
from sepmc.schema import Column, Status

_FIRST = 256  # cases flown first, to see how long they take
# a call into compiled code cannot be interrupted and tells no progress: it flies what takes about
# so long
_CALL_S = 0.5
# what took longer to fly is handed over before its chunk is full, so that little is lost with the
# machine
_PART_S = 5.0
_ROOM = 2**26  # bytes of histories and rows that one part may take in memory


@dataclass(frozen=True)
class Draws:
    """Which cases are drawn: by which seed, their numbers, and of how many in ``total``."""

    seed: int
    numbers: Numbers
    total: int


@dataclass(frozen=True)
class Earlier:
    """What a run that is resumed holds already: how many cases, what was counted of them, and by
    which commands they were flown."""

    held: int = 0
    tally: Tally = field(default_factory=Tally)
    sessions: tuple[dict[str, Any], ...] = ()


class Chunks:
    """The chunks of one run. Enter it to fly; leaving it waits for what is still being written, and
    raises what went wrong there."""

    def __init__(
        self,
        campaign: Definition,
        flight: Flight,
        draws: Draws,
        timing: dict[str, float],
        earlier: Earlier,
        folder: Path | None = None,
        stats_only: bool = False,
        announce: Say | None = None,
    ):
        self.campaign, self.flight, self.draws = campaign, flight, draws
        self.timing, self.earlier, self.folder = timing, earlier, folder
        self.wanted = draws.numbers.count - earlier.held
        self._known = ""  # how well a statistic is known that decides how many cases are flown
        self._stopped: list[str] = []  # the same if it is not enough
        self.stats_only, self.announce = stats_only, announce
        self.flown, self.failures = 0, 0
        self.held = 0  # those that the sink has taken
        self.tally = earlier.tally
        self.started = datetime.now(UTC)
        joints = list(campaign.plan.joints)
        self.separation = (
            schema.separation_columns(joints) if campaign.has_histories and not stats_only else []
        )
        self.room = history_rows(campaign.scene) if self.separation else 0
        self.size = chunk_size(campaign, self.separation)
        self.sink: Sink = (
            InStatistics(campaign)
            if stats_only
            else InFolder(
                campaign, self.separation, folder, draws.seed, self._which.get("numbers", "")
            )
            if folder
            else InMemory(campaign, self.separation)
        )
        self._call = _FIRST
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
        What is flown is handed over even if this is interrupted."""
        pieces: list[Piece] = []
        begun = time.perf_counter()
        try:
            while first < end:
                now = time.perf_counter()
                if now - begun > _PART_S:
                    pieces, begun = self._hand_over(pieces), now
                until = min(end, first + self._call)
                compiled = self.timing["compile"]
                piece = self._fly(first, until)
                pieces.append(piece)
                seconds = time.perf_counter() - now - (self.timing["compile"] - compiled)
                self._call = max(
                    1, int(min(self.size, (until - first) * _CALL_S / max(seconds, 1e-9)))
                )
                first = until
                self.flown += len(piece.drawn)
                self.failures += int(np.count_nonzero(piece.block.status != Status.OK))
                if first == end:
                    pieces = self._hand_over(pieces)
                tell()
        finally:
            self._hand_over(pieces)

    def _fly(self, first: int, end: int) -> Piece:
        campaign, clock = self.campaign, time.perf_counter
        t0 = clock()
        drawn = campaign.draw(first, end - first, self.draws.seed, self.draws.total)
        t1, waited = clock(), waited_for_compilers()
        block = fly(campaign, self.flight, campaign.in_si(drawn), self.room, self.announce)
        waited = waited_for_compilers() - waited  # for a kernel that few cases need
        self.timing["sample"] += t1 - t0
        self.timing["compile"] += waited
        self.timing["kernel"] += clock() - t1 - waited
        return Piece(first, drawn, block, count(campaign, drawn, block))

    def _hand_over(self, pieces: list[Piece]) -> list[Piece]:
        """Let the sink take the pieces, beside what is flown next. One list at a time waits, so
        memory is bounded. Returns a new list."""
        if pieces:
            self._wait()
            self._taking = self._beside.submit(self._take, pieces)
        return []

    def _take(self, pieces: list[Piece]) -> None:
        start = time.perf_counter()
        self.sink.take(pieces)
        self.held += sum(len(piece.drawn) for piece in pieces)
        self.tally = sum((piece.tally for piece in pieces), self.tally)
        self.timing["write"] += time.perf_counter() - start

    def _wait(self) -> None:
        """Wait for what is being taken; raises what went wrong."""
        taking, self._taking = self._taking, None
        if taking:
            taking.result()

    def write_manifest(self, threads: int | None, complete: bool) -> None:
        """Say what the folder holds, in it."""
        assert self.folder is not None
        campaign = self.campaign
        manifest = {
            "campaign": campaign.name,
            "digest": campaign.digest,
            "seed": self.draws.seed,
            "cases": self.draws.numbers.count,
            **self._which,
            "complete": complete,
            "stats_only": self.stats_only,
            "cases_held": self.earlier.held + (0 if self.stats_only else self.held),
            "failures": self.tally.failures,
            "implausible_inertias": self.tally.implausible,
            "accuracy": self._accuracy(),
            "notes": self.notes,
            "least_at_the_end": self.tally.least_at_the_end,
            **({"until": self._known} if self._known else {}),
            "sessions": [*self.earlier.sessions, self._session(threads)],
        }
        try:
            text = store.campaign_text(campaign.file, cases=self.draws.total, seed=self.draws.seed)
            store.write_manifest(self.folder, manifest, text)
        except OSError as error:
            raise store.StoreError(
                f"{self.folder}: cannot be written: {error.strerror or error}"
            ) from None

    @property
    def _which(self) -> dict[str, Any]:
        """Which cases are wanted, unless they are the first ones, and of how many."""
        numbers, total = self.draws.numbers, self.draws.total
        if numbers.are_first and total == numbers.count:
            return {}
        return {"numbers": str(numbers), "of": total}

    def _session(self, threads: int | None) -> dict[str, Any]:
        """What this command did, on what."""
        return {
            "cases_flown": self.flown,
            "started": self.started.isoformat(timespec="seconds"),
            "finished": datetime.now(UTC).isoformat(timespec="seconds"),
            "timing_s": {k: round(v, 6) for k, v in self.timing.items()},
            "threads": threads or os.cpu_count(),
            **store.versions(),
        }

    @property
    def accuracy(self) -> Achieved:
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
            *sampled(self.campaign, self.draws.numbers),
            *unmet(told, fixed),
            *unsettled(self.tally.unsettled, self.tally.finer),
            *still_near(self.tally.least_at_the_end),
            *self._stopped,
        ]
        return found + [note for note in self.flight.notes if note not in found]

    def is_known(self, until: Until) -> bool:
        """Whether the cases so far are enough to know a statistic; these are then all that are
        wanted."""
        value, low, high = until.known(self.kept().summary)
        enough = until.is_met(value, low, high)
        asked = f"{100 * until.tolerance:g} %" if until.relative else f"{until.tolerance:g}"
        self._known = (
            f"after {self.flown} of {self.draws.numbers.count} cases the {until.name} is "
            f"{value:.6g}, between {low:.6g} and {high:.6g} (95 %); asked: no more than {asked} "
            f"from it{'' if enough else ': NOT MET'}"
        )
        self._stopped = [] if enough else [self._known]
        if enough:
            self.wanted = self.flown
            self.draws = Draws(self.draws.seed, Numbers.first(self.flown), self.flown)
            if self.announce:
                self.announce(self._known)
        return enough

    def kept(self) -> Kept:
        """What the run leaves of what is flown so far."""
        self._wait()
        return self.sink.kept()


def accuracy(flight: Flight, tally: Tally) -> Achieved:
    """Error of cases: the largest that was counted of them, and of the trial cases."""
    told = flight.achieved
    assert told is not None
    # no trial case tells anything, but cases that were flown again do
    if not told.cases and tally.finer:
        told = replace(told, errors=dict.fromkeys(told.errors, 0.0))
    return told.with_errors(dict(tally.errors))


def accuracy_told(campaign: Definition, flight: Flight, tally: Tally) -> dict[str, Any]:
    """What a manifest tells of how cases were flown, and of their error."""
    solver, told = campaign.scene.solver, accuracy(flight, tally)
    said: dict[str, Any] = {
        "formulation": solver.formulation,
        "method": solver.method,
        "methods": flight.method_names,
    }
    if flight.step is not None:
        said |= {"step_s": flight.step}
    else:
        said |= {"steps": flight.steps.tolist(), "stages": flight.stages}
    worst, error = told.worst
    said |= {"achieved": error, "worst_outcome": worst, "cases": told.cases}
    if told.history is not None:
        said |= {"history": told.history}
    if tally.finer:
        said |= {"finer_cases": tally.finer}
        said |= {"unsettled_cases": tally.unsettled}
    if tally.spare:
        said |= {"spare_cases": tally.spare}
    if solver.step is None:
        said |= {"asked": told.asked, "met": told.met}
    if told.worst_place:
        said |= {"worst_place": told.worst_place[0], "places": sorted(told.places)}
    return {**said, "errors": told.errors}


def row_bytes(campaign: Definition, separation: list[Column]) -> tuple[int, int]:
    """Bytes of a case's row, and of its history with these columns."""
    rows = history_rows(campaign.scene) if separation else 0
    return 8 * len(campaign.columns), 8 * rows * (2 + len(separation))


def chunk_size(campaign: Definition, separation: list[Column]) -> int:
    """Cases that are kept in memory until they are handed over."""
    row, history = row_bytes(campaign, separation)
    return max(1, min(campaign.scene.run.chunk, _ROOM // (history + 2 * row)))


def implausible_note(broken: int, drawn: int) -> str:
    """The sentence that counts inertias no solid body has; empty if there is none."""
    return (
        f"{broken} of {drawn} drawn cases have an inertia that breaks the triangle inequality, "
        "which no solid body has"
        if broken
        else ""
    )
