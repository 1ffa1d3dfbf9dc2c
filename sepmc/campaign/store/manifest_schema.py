"""Schema of the manifest of a run folder (``manifest.json``): types, ranges and required keys,
which are checked when a manifest is read."""

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
_REQUIRED = ("campaign", "files", "files_sha256", "campaign_sha256")
_REQUIRED_OF_CASES = ("seed", "cases", "sessions")
_REQUIRED_OF_CASE = ("bodies", "joints")
_REQUIRED_OF_RARE_EVENT = ("seed", "sessions")


class _Session(Struct):
    """Entry of a manifest for one command (session) that ran cases of the run: versions of
    ``sepmc`` and of packages, machine, ``started`` and ``finished`` (ISO dates and times, UTC),
    number of cases run (``cases_flown``), threads, number of cases by kind of worker (``workers``),
    and times by stage, s (``timing_s``)."""

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
    """Entry ``accuracy`` of a manifest, on the steps and the numerical error of a run, which
    `sepmc.campaign.execution.batch_summary.accuracy_entries` creates; infinite errors are null.

    Attributes
    ----------
    errors : dict of str to float
        Relative error by outcome.
    achieved, worst_outcome : float, str
        Largest of these errors, and its outcome, without the outcomes ``places``.
    places, worst_place : list of str, str
        Outcomes that are times or positions of extremes, or contact; the one of them with the
        largest error.
    cases : int
        Number of calibration cases that the errors are estimated from.
    history : float or None
        Relative error of stored histories.
    asked, met : float, bool
        Requested accuracy, and True if ``achieved`` is at most that; None if the file gives the
        step.
    step_s, steps : float or None, list of int
        Length of the steps, s, if the file gives it (``steps`` is empty then), else None;
        number of steps of each segment.
    methods, stages : list of str
        Integration method and name of each segment; ``formulation`` and ``method`` are those of the
        file.
    n_refined, n_unconverged, n_fallback : int
        Numbers of cases integrated again with smaller steps, of those that did not converge, and of
        cases integrated by a fallback kernel.
    """

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
    """Keys and types of the manifest of a campaign, a rare-event estimate or a single case.

    ``format`` is that of the run folder (`FORMAT`). ``campaign`` is the name of the campaign,
    ``seed`` the random seed, and ``sampler`` the sampling method. ``sessions`` has an entry for
    each command that ran cases; ``accuracy`` is on steps and numerical errors (None if unknown);
    ``notes`` are those for the user.

    ``cases`` is the number of wanted cases; ``numbers`` are their case numbers, as 25:50,73
    (25 to 49, and 73), if they are not all ``of`` cases of the sample. ``complete`` is True once
    all of them have run. ``stats_only`` is True if case rows are not stored, except those that the
    rules ``keep`` select.
    ``n_stored`` is the number of rows in the folder without those, ``failures`` that of cases not
    ok, ``implausible_inertias`` that of cases with an inertia that no body can have. ``min_at_end``
    has, by clearance, the number of cases in which it is smallest at the end time, ``missing``, by
    event, that of ok cases in which it does not occur (`BatchSummary`). ``until`` is the sentence
    on the ``stopping_rule``, ``rarely_drawn`` warnings on values that occurred too rarely.
    ``digest`` is that of the campaign with its ``settings``, ``files`` the number of files in the
    ledger; ``files_sha256``, ``campaign_sha256`` and ``sha256`` are checksums of the ledger
    entries, the campaign file and this manifest. Of a single case ``case`` is its number (None:
    nominal), and ``bodies`` and ``joints`` are those of its scene.
    """

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


def shard_provenance(metadata: Mapping[bytes, bytes]) -> dict[str, Any]:
    """Manifest entries, by key, that follow from the metadata of a shard (Parquet file): ``digest``
    and ``settings`` of the campaign, ``seed``, and ``numbers``, ``stats_only`` and ``keep`` of the
    run if they apply.

    Raises
    ------
    KeyError, ValueError
        If the metadata are incomplete or not valid.
    """
    provenance: dict[str, Any] = {
        "digest": metadata[b"digest"].decode(),
        "seed": int(metadata[b"seed"]),
    }
    if numbers_text := metadata[b"numbers"].decode():
        provenance["numbers"] = numbers_text
    if b"lengths" in metadata or b"keep" in metadata:  # of a run of statistics
        provenance |= {"stats_only": True, "keep": metadata.get(b"keep", b"").decode()}
    try:
        settings = msgspec.json.decode(metadata.get(b"settings", b"{}"), type=dict[str, str])
    except (msgspec.MsgspecError, UnicodeDecodeError) as error:
        raise ValueError(f"its metadata have invalid settings: {error}") from None
    _check(settings)
    return provenance | {"settings": settings}


def read(content: bytes) -> dict[str, Any]:
    """Decode and check the content of ``manifest.json``.

    Parameters
    ----------
    content : bytes

    Returns
    -------
    dict of str to Any
        Entries of the manifest by key.

    Raises
    ------
    ValueError
        If the content is no JSON, if a type or range is not that of a manifest, or if a manifest
        with a checksum lacks a required key. Its text is the reason.
    """
    try:
        manifest = json.loads(content.decode("utf-8"))
    except RecursionError:
        raise ValueError("its JSON is nested too deep") from None
    _check(manifest)
    try:
        msgspec.convert(manifest, _Manifest)
    except msgspec.ValidationError as error:
        raise ValueError(f"it is not a manifest: {error}") from None
    if "sha256" in manifest:
        own = (
            _REQUIRED_OF_CASE
            if "case" in manifest
            else _REQUIRED_OF_RARE_EVENT
            if "rare" in manifest
            else _REQUIRED_OF_CASES
        )
        required = (*_REQUIRED, *own)
        for key in required:
            if manifest.get(key) is None or (key == "sessions" and not manifest[key]):
                raise ValueError(f"it is not a complete manifest: key {key} is missing or empty")
    return dict(manifest)


def _check(manifest: Any) -> None:
    """Raise ValueError, with the place, if the JSON data of a manifest or of a part of one have too
    many entries in a table or list, are nested too deep, or have whole numbers of more than 64
    bits, too long texts, or texts with control characters. Keys and types are not checked."""
    problems = Problems()
    with contextlib.suppress(TooManyProblems):
        check_tree(manifest, problems, _TEXT)
    if problems:
        raise ValueError(problems[0])
