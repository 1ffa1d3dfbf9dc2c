"""Ranges of cases as work for other processes: what they are told, what they do, and what they give
back."""

import platform
import threading
from collections.abc import Callable, Generator, Iterable
from dataclasses import dataclass
from pathlib import Path
from typing import Protocol

from sepmc import __version__
from sepmc.analysis.streaming import PartialStatistics
from sepmc.campaign.definition import Definition
from sepmc.campaign.execution.batch import Draws, fly_piece
from sepmc.campaign.execution.batch_summary import Tally
from sepmc.campaign.execution.integration import Flight
from sepmc.campaign.execution.sinks import InFolder, KeptRows, add_to
from sepmc.campaign.execution.step_selection import unpacked
from sepmc.campaign.store import folders, ledger
from sepmc.campaign.store.row_selection import Chosen, Keep
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
    flight: Flight
    draws: Draws
    apart: PartialStatistics | None = None
    keep: Keep | None = None

    @property
    def key(self) -> tuple[str, str, bool]:
        """What a process has to load for it, in short."""
        return str(self.folder), self.campaign, self.apart is None


@dataclass(frozen=True)
class Flown:
    """What became of cases ``first`` to ``first + cases``: the parts that were written, or what was
    counted apart; on a processor, by code, of some ``kind``."""

    first: int
    cases: int
    tally: Tally
    timing: dict[str, float]
    kind: str
    parts: tuple[ledger.Entry, ...] = ()
    apart: PartialStatistics | None = None
    chosen: Chosen | None = None


class Crew(Protocol):
    """Others who work: processes of this machine or of many."""

    workers: int

    def map(
        self,
        job: Job,
        function: Callable[[Job, int, int, int], Flown],
        ranges: Iterable[tuple[int, int]],
    ) -> Generator[Flown]:
        """Have ``function(job, first, end, threads)`` called for each range, which are asked for
        one by one, a few ahead; results as they come."""


class OutOfStepError(RuntimeError):
    """A worker that does not see what the run is made of."""


# One range flies at a time in a process; another one's rows are written meanwhile.
_flying = threading.Lock()


def fly_range(job: Job, first: int, end: int, threads: int) -> Flown:
    """Fly cases ``first`` to ``end`` of a job: what a worker does."""
    timing = {"compile": 0.0, "sample": 0.0, "kernel": 0.0}
    with _flying:
        campaign, flight = _ready(job)
        separation = campaign.over_time(job.apart is None)
        with using_threads(threads):
            pieces = [fly_piece(campaign, flight, job.draws, first, end, bool(separation), timing)]
    if not folders.is_called(job.folder, job.word):
        raise OutOfStepError(f"{job.folder}: nobody waits for cases {first} to {end - 1} any more")
    parts: list[ledger.Entry] = []
    chosen = Chosen(job.keep, campaign.file.requirements) if job.keep else None
    if job.apart:
        add_to(job.apart, campaign, pieces)
        if chosen:
            parts = KeptRows(campaign, job.folder, job.draws, chosen).write(pieces)
    else:
        parts = InFolder(campaign, separation, job.folder, job.draws).write(pieces)
    return Flown(
        first, end - first, pieces[0].tally, timing, kind(), tuple(parts), job.apart, chosen
    )


def kind() -> str:
    """Code and processor of this process: rows of one kind are the same to the last bit."""
    from sepmc.jit import processor, sources_digest  # noqa: PLC0415  (numba)

    return f"sepmc {__version__}, {processor()}, code {sources_digest()}"


_last: dict[tuple[str, str, bool], tuple[Definition, Flight]] = {}


def _ready(job: Job) -> tuple[Definition, Flight]:
    """The campaign and the flight of a job, loaded once in a process."""
    if job.key not in _last:
        text = job.folder / folders.CAMPAIGN
        try:
            written = ledger.checksum(text.read_bytes())
        except OSError as error:
            raise OutOfStepError(
                f"{text}: a worker on {platform.node()} cannot read it: {error.strerror}; "
                "it must be in a folder that all workers see under this path"
            ) from None
        if written != job.campaign:
            raise OutOfStepError(
                f"{text}: a worker on {platform.node()} sees another campaign there; it must "
                "be in a folder that all workers share"
            )
        campaign = Definition(read_campaign(text, reader=read_input_table))
        history = campaign.has_histories and job.apart is None
        _last.clear()
        _last[job.key] = campaign, unpacked(campaign, job.flight, history)
    return _last[job.key]
