"""What a manifest says, checked when it is read: types, ranges, and what a sealed one must have."""

import contextlib
import json
from collections.abc import Mapping
from typing import Annotated, Any

import msgspec
from msgspec import Meta, Struct

from sepmc.scene.limits import CASES, NAME, SEED, check_tree
from sepmc.scene.messages import Problems, TooManyProblems
from sepmc.scene.model import Name

FORMAT = 2  # of run folders: raised when their keys or folders are renamed
_Count = Annotated[int, Meta(ge=0, le=CASES)]
_TEXT = 100_000  # characters of a note
_OF_ALL = ("campaign", "files", "files_sha256", "campaign_sha256")
_OF_CASES = ("seed", "cases", "sessions")
_OF_ONE = ("bodies", "joints")
_OF_EVENT = ("seed", "sessions")


class _Session(Struct):
    """What one command did."""

    sepmc: str
    started: str = ""
    finished: str = ""
    machine: str = ""
    cases_flown: _Count = 0
    threads: int | None = None
    workers: dict[str, _Count] = {}
    versions: dict[str, str] = {}
    timing_s: dict[str, float] = {}


class _Accuracy(Struct):
    """How exact a run is; an infinite error is null."""

    achieved: float | None = None
    worst_outcome: str = ""
    cases: _Count = 0
    history: float | None = None
    asked: float | None = None
    met: bool | None = None
    step_s: float | None = None
    formulation: str = ""
    method: str = ""
    methods: list[str] = []
    steps: list[int] = []
    stages: list[str] = []
    n_refined: _Count = 0
    n_unconverged: _Count = 0
    n_fallback: _Count = 0
    worst_place: str = ""
    places: list[str] = []
    errors: dict[str, float | None] = {}


class _Manifest(Struct):
    """Of a campaign, or of one case."""

    digest: str
    format: int = 1
    campaign: Annotated[str, Meta(pattern=r"^[A-Za-z0-9][A-Za-z0-9._-]*\Z", max_length=NAME)] = "x"
    seed: Annotated[int, Meta(ge=0, le=SEED)] | None = None
    cases: _Count = 0
    of: _Count = 0
    numbers: str = ""
    complete: bool = True
    stats_only: bool = False
    keep: str = ""
    sampler: str = ""
    settings: dict[str, str] = {}
    n_stored: _Count = 0
    failures: _Count = 0
    implausible_inertias: _Count = 0
    accuracy: _Accuracy | None = None
    notes: list[str] = []
    stopping_rule: str = ""
    until: str = ""
    rarely_drawn: list[str] = []
    min_at_end: dict[str, int] = {}
    missing: dict[str, int] = {}
    sessions: list[_Session] = []
    case: _Count | None = None
    bodies: list[Name] = []
    joints: list[Name] = []
    files: _Count = 0
    sha256: str = ""
    files_sha256: str = ""
    campaign_sha256: str = ""


def shard_provenance(said: Mapping[bytes, bytes]) -> dict[str, Any]:
    """What a part says of the run that it is of, as a manifest would. Raises ValueError or KeyError
    if it does not."""
    found: dict[str, Any] = {"digest": said[b"digest"].decode(), "seed": int(said[b"seed"])}
    if numbers := said[b"numbers"].decode():
        found["numbers"] = numbers
    if b"lengths" in said or b"keep" in said:  # of cases that are counted, and let go but for some
        found |= {"stats_only": True, "keep": said.get(b"keep", b"").decode()}
    try:
        settings = msgspec.json.decode(said.get(b"settings", b"{}"), type=dict[str, str])
    except (msgspec.MsgspecError, UnicodeDecodeError) as error:
        raise ValueError(f"its settings are none: {error}") from None
    _check(settings)
    return found | {"settings": settings}


def read(written: bytes) -> dict[str, Any]:
    """A manifest, from what its file holds. Raises ValueError, with what is wrong, if it is
    none."""
    try:
        said = json.loads(written.decode("utf-8"))
    except RecursionError:
        raise ValueError("is too deep") from None
    _check(said)
    try:
        msgspec.convert(said, _Manifest)
    except msgspec.ValidationError as error:
        raise ValueError(f"it holds no manifest: {error}") from None
    if "sha256" in said:
        own = _OF_ONE if "case" in said else _OF_EVENT if "rare" in said else _OF_CASES
        wanted = (*_OF_ALL, *own)
        for key in wanted:
            if said.get(key) is None or (key == "sessions" and not said[key]):
                raise ValueError(f"it holds no manifest: {key} is missing")
    return dict(said)


def _check(said: Any) -> None:
    """Raise ValueError for what is too large, or no screen can show."""
    problems = Problems()
    with contextlib.suppress(TooManyProblems):
        check_tree(said, problems, _TEXT)
    if problems:
        raise ValueError(problems[0])
