"""A campaign: scene and seed to cases, cases through the door in chunks, results to a run folder or to memory."""

import hashlib
import operator
import os
import platform
import time
from collections.abc import Callable
from dataclasses import dataclass, field
from datetime import UTC, datetime
from functools import cached_property
from importlib.metadata import version
from pathlib import Path
from typing import Any

import msgspec
import numpy as np
import pandas as pd

from sepmc import __version__, cases, schema, store
from sepmc.compiler.plan import Plan, make_plan
from sepmc.scene import parameters
from sepmc.scene.checks import MOST_ROWS
from sepmc.scene.model import Scene
from sepmc.scene.read import CampaignFile, parse_campaign, read_campaign
from sepmc.scene.units import unit_text
from sepmc.schema import Column, Status

Progress = Callable[[int, int, int], None]  # cases done, cases in all, failures so far
_NO_HISTORY, _SEPARATION_HISTORY, _FULL_HISTORY = 0, 1, 2


def load(path: str | Path, settings: dict[str, Any] | None = None) -> "Campaign":
    """Read a campaign.

    Parameters
    ----------
    path : str or Path
        A campaign file, a run folder, or the bare name of a shipped campaign.
    settings : dict, optional
        Values to put in place, by TOML path: ``{"solver.formulation": "full"}``.

    Raises
    ------
    SceneError
        If anything in the file cannot be flown, with every problem and its place.
    """
    return Campaign(read_campaign(path, settings))


@dataclass(frozen=True)
class Case:
    """One case, fully resolved.

    ``scene`` holds its values in SI; ``inputs`` the dispersed ones, by column, in the units of the campaign file.
    """

    number: int
    scene: Scene
    inputs: dict[str, float]

    def to_dict(self) -> dict[str, Any]:
        """The scene as plain nested dicts and lists, SI and radians; what is not set is left out."""
        return _set_only(msgspec.to_builtins(self.scene))


def _set_only(node: Any) -> Any:
    if isinstance(node, dict):
        return {key: _set_only(value) for key, value in node.items() if value is not None}
    return [_set_only(item) for item in node] if isinstance(node, list | tuple) else node


@dataclass
class Result:
    """What a campaign gave. ``timing`` is in seconds by stage: compile, sample, kernel, write."""

    campaign: "Campaign"
    table: dict[str, np.ndarray]
    history: dict[str, np.ndarray] | None
    timing: dict[str, float]
    seed: int
    folder: Path | None = None
    notes: list[str] = field(default_factory=list)

    def to_pandas(self) -> pd.DataFrame:
        """One row per case: case, status, inputs (``in_...``), outcomes and audit columns."""
        return pd.DataFrame(self.table)

    def histories(self) -> pd.DataFrame | None:
        """Separation over time in long form (case, time_s, ...), or None if ``run.history_step_s`` is 0."""
        return None if self.history is None else pd.DataFrame(self.history)

    def statistics(self) -> pd.DataFrame:
        """Statistics of every outcome; see `sepmc.analysis.statistics.statistics`."""
        from sepmc.analysis.statistics import statistics  # noqa: PLC0415

        return statistics(self.to_pandas(), self.outcomes, self.campaign.reference)

    def case(self, number: int) -> Case:
        """Case ``number`` as it was flown here, fully resolved in SI."""
        return self.campaign.case(number, self.seed)

    @property
    def outcomes(self) -> list[str]:
        """Names of the outcome columns."""
        return [column.name for column in self.campaign.outcome_columns]

    @property
    def units(self) -> dict[str, str]:
        return {column.name: column.unit for column in self.campaign.columns}

    @property
    def status_counts(self) -> dict[str, int]:
        labels, counts = np.unique(self.table["status"], return_counts=True)
        return dict(zip(labels.tolist(), counts.tolist(), strict=True))


class Campaign:
    """A scene, its dispersions and its run settings, ready to fly."""

    def __init__(self, file: CampaignFile):
        self.file = file

    @property
    def name(self) -> str:
        return self.file.name

    @property
    def scene(self) -> Scene:
        return self.file.scene

    @cached_property
    def plan(self) -> Plan:
        return make_plan(self.scene)

    def with_settings(self, settings: dict[str, Any]) -> "Campaign":
        """A campaign with other values, by TOML path as in the file: ``{"body.upper.mass_kg": 460.0}``."""
        return Campaign(parse_campaign(self.file.tree, self.name, settings, self.name))

    @property
    def reference(self) -> dict[str, dict[str, float]] | None:
        """Statistics to compare with, by outcome: those given of mean, sigma, min, max."""
        if self.file.reference is None:
            return None
        outcome = msgspec.to_builtins(self.file.reference.outcome)
        return {name: {k: v for k, v in row.items() if v is not None} for name, row in outcome.items()}

    @cached_property
    def input_columns(self) -> list[Column]:
        return [Column(d.parameter.column, unit_text(d.parameter.unit), f"{d.parameter.key}, {d.law}") for d in self.file.dispersions]

    @cached_property
    def outcome_columns(self) -> list[Column]:
        return schema.outcome_columns(self.plan.bodies, list(self.plan.joints))

    @cached_property
    def columns(self) -> list[Column]:
        """Columns of the case table."""
        head = [Column("case", "1", "number of the case"), Column("status", "", "ok, or why the case failed")]
        return [*head, *self.input_columns, *self.outcome_columns, *schema.audit_columns()]

    @cached_property
    def _slots(self) -> np.ndarray:
        """Places of the dispersed parameters in the kernel's vector."""
        return np.array([self.plan.slots[d.parameter.path] for d in self.file.dispersions], dtype=np.int64)

    @cached_property
    def _factors(self) -> np.ndarray:
        return np.array([d.parameter.factor for d in self.file.dispersions])

    @property
    def digest(self) -> str:
        """Digest of all that decides a case's outcome: two runs of equal digest and seed hold equal rows."""
        tree = {k: v for k, v in self.file.tree.items() if k not in ("title", "reference", "name")}
        tree["run"] = {k: v for k, v in tree.get("run", {}).items() if k not in ("cases", "seed", "chunk")}
        return hashlib.sha256(msgspec.json.encode(tree, order="deterministic")).hexdigest()[:16]

    def case(self, number: int, seed: int | None = None) -> Case:
        """Case ``number`` of the campaign, fully resolved in SI, drawn without the others."""
        number = _whole("case", number, 0)
        drawn = cases.draw(self.file.dispersions, self._seed(seed), number, 1)[0]
        values = {d.parameter.path: float(x) for d, x in zip(self.file.dispersions, drawn * self._factors, strict=True)}
        return Case(
            number,
            parameters.replace(self.nominal().scene, values),
            {c.name: float(x) for c, x in zip(self.input_columns, drawn, strict=True)},
        )

    def nominal(self) -> Case:
        """The case without dispersion, number -1. Its zero of ``alpha_ref`` is pinned, so that every case shares it."""
        initial = self.scene.initial
        if initial.path_reference is None:
            initial = msgspec.structs.replace(initial, path_reference=initial.pitch - initial.alpha)
        return Case(-1, msgspec.structs.replace(self.scene, initial=initial), {})

    def simulate(self, case: Case | None = None, step_s: float = 0.001) -> pd.DataFrame:
        """Time history of one case (the nominal if None), a row every ``step_s`` and two at each phase boundary.

        Returns
        -------
        history : DataFrame
            time_s, phase, then the columns of `sepmc.schema.history_columns`. ``attrs`` holds ``units``, the ``outcomes`` of
            the case and its ``status``.
        """
        check_every(step_s, self.scene)
        plan = make_plan((case or self.nominal()).scene, history_step=step_s)
        columns = schema.history_columns(plan.bodies, plan.joints)
        room = int(plan.scene.run.end_time / step_s) + 2 * len(plan.phases) + 4
        block = _fly(plan, np.empty(0, dtype=np.int64), np.empty((1, 0)), room, len(columns), _FULL_HISTORY)
        rows = int(block.rows[0])
        data: dict[str, Any] = {"time_s": block.times[0, :rows], "phase": [plan.phases[p] for p in block.phases[0, :rows]]}
        data |= {c.name: block.history[0, :rows, i] * c.scale for i, c in enumerate(columns)}
        frame = pd.DataFrame(data)
        found = [*schema.outcome_columns(plan.bodies, list(plan.joints)), *schema.audit_columns()]
        frame.attrs = {
            "units": {"time_s": "s", "phase": "", **{c.name: c.unit for c in columns}},
            "outcomes": {c.name: float(x * c.scale) for c, x in zip(found, block.outcomes[0], strict=True)},
            "status": Status(int(block.status[0])).label,
        }
        return frame

    def _seed(self, seed: int | None) -> int:
        return self.scene.run.seed if seed is None else _whole("seed", seed, 0)

    def implausible_inertias(self, drawn: np.ndarray) -> int:
        """Number of rows of a case table (n, d) in which some body's inertia breaks the triangle inequality."""
        place = {d.parameter.path: i for i, d in enumerate(self.file.dispersions)}
        broken = np.zeros(len(drawn), dtype=bool)
        for name in self.scene.body:
            prefixes = (f"body.{name}.inertia.", f"body.{name}.inertia_products.")
            if any(path.startswith(prefixes) for path in place):
                values = {
                    path: drawn[:, place[path]] * self._factors[place[path]] if path in place else parameters.value(self.scene, path)
                    for path in (prefix + part for prefix, parts in zip(prefixes, _TENSOR_PARTS, strict=True) for part in parts)
                }
                tensors = np.moveaxis(_tensor(*[np.broadcast_to(v, len(drawn)) for v in values.values()]), -1, 0)
                low, middle, high = np.linalg.eigvalsh(tensors).T
                broken |= (low > 0.0) & (low + middle < high * (1.0 - 1e-9))
        return int(np.count_nonzero(broken))

    def run(
        self,
        cases: int | None = None,
        seed: int | None = None,
        threads: int | None = None,
        out: str | Path | None = None,
        *,
        overwrite: bool = False,
        resume: bool = False,
        progress: Progress | None = None,
        announce: Callable[[str], None] | None = None,
    ) -> Result:
        """Fly the campaign.

        Parameters
        ----------
        cases, seed : int, optional
            Instead of those of the file.
        threads : int, optional
            All cores if None. The result does not depend on it.
        out : path, optional
            Run folder to write; None keeps everything in memory.
        overwrite, resume : bool
            What to do with an existing ``out``: replace the run in it, or fly only its missing cases.
        progress : callable (done, total, failures), optional
        announce : callable (text), optional
            Told once if kernels must be compiled.

        Raises
        ------
        StoreError
            If ``out`` cannot be used as asked.
        ValueError
            If cases, seed or threads are out of range.

        Notes
        -----
        Interrupted (Ctrl-C) with ``out`` given, all finished chunks are in the folder and ``resume=True`` goes on from there.
        """
        settings = self.scene.run
        total = settings.cases if cases is None else _whole("cases", cases, 1, 10**9)
        seed = self._seed(seed)
        threads = check_threads(threads)
        folder = store.open_folder(Path(out), overwrite, resume) if out is not None else None
        done = self._resumed(folder, seed, total) if folder and resume else np.empty(0, dtype=np.int64)
        timing = {"compile": warm_up(self.plan, threads, announce), "sample": 0.0, "kernel": 0.0, "write": 0.0}
        flight = _Flight(self, seed, total, folder, timing)
        if folder:
            flight.write_manifest(threads, complete=False)
        ranges = store.missing_ranges(total, done, settings.chunk)
        left = sum(end - first for first, end in ranges)
        try:
            if progress:
                progress(0, left, 0)
            for first, end in ranges:
                flight.fly(first, end)
                if progress:
                    progress(flight.flown, left, flight.failures)
        finally:
            if folder:
                flight.write_manifest(threads, complete=flight.flown == left)
        return flight.result(resumed=len(done) > 0)

    def _resumed(self, folder: Path, seed: int, total: int) -> np.ndarray:
        """Cases a folder already holds, if it is the same campaign."""
        if not (folder / store.MANIFEST).is_file():
            return np.empty(0, dtype=np.int64)
        manifest = store.read_manifest(folder)
        for key, here in (("digest", self.digest), ("seed", seed)):
            if manifest.get(key) != here:
                what = "campaign" if key == "digest" else f"seed ({manifest.get(key)}, not {seed})"
                raise store.StoreError(
                    f"{folder}: was flown with another {what}, so its cases cannot be continued; use --overwrite or another --out"
                )
        done = store.cases_done(folder)
        if len(done) and done[-1] >= total:
            raise store.StoreError(f"{folder}: holds cases up to {done[-1]}; --cases {total} would leave some out")
        return done


_TENSOR_PARTS = (("xx", "yy", "zz"), ("xy", "xz", "yz"))


def _tensor(xx, yy, zz, xy, xz, yz) -> np.ndarray:
    """Inertia tensors from arrays of moments and products; shape (3, 3, n)."""
    return np.array([[xx, -xy, -xz], [-xy, yy, -yz], [-xz, -yz, zz]])


@dataclass
class _Block:
    """Arrays a call of the door fills."""

    outcomes: np.ndarray
    status: np.ndarray
    times: np.ndarray
    phases: np.ndarray
    history: np.ndarray
    rows: np.ndarray


def _fly(plan: Plan, slots: np.ndarray, draws: np.ndarray, room: int, width: int, level: int) -> _Block:
    """One call of the door; draws (n, d) in SI."""
    from sepmc.kernels.batch import fly  # noqa: PLC0415

    n = len(draws)
    outcomes = len(schema.outcome_columns(plan.bodies, list(plan.joints))) + len(schema.audit_columns())
    block = _Block(
        np.full((n, outcomes), np.nan),
        np.full(n, int(Status.NOT_FLOWN), dtype=np.int64),
        np.full((n, room), np.nan),
        np.zeros((n, room), dtype=np.int64),
        np.full((n, room, width), np.nan),
        np.zeros(n, dtype=np.int64),
    )
    nominal = np.ascontiguousarray(plan.nominal)
    fly(
        plan.model, plan.tableau, nominal, slots, np.ascontiguousarray(draws),
        block.outcomes, block.status, block.times, block.phases, block.history, block.rows, level,
    )  # fmt: skip
    return block


def _whole(name: str, value: Any, least: int, most: int | None = None) -> int:
    """A whole number in range; raises ValueError with the name, the value and what is allowed."""
    try:
        if isinstance(value, bool):
            raise TypeError
        number = operator.index(value)
    except TypeError:
        raise ValueError(f"{name} = {value!r}: must be a whole number") from None
    if number < least or (most is not None and number > most):
        raise ValueError(f"{name} = {number}: must be >= {least}" + (f" and <= {most}" if most is not None else ""))
    return number


def check_every(step_s: float, scene: Scene, name: str = "step_s") -> None:
    """Raise ValueError if a history cannot have a row every ``step_s``."""
    most = 10 * MOST_ROWS
    if not (step_s > 0.0 and scene.run.end_time / step_s <= most):
        raise ValueError(f"{name} = {step_s}: must be > 0, and >= {scene.run.end_time / most:g} so that there are at most {most} rows")


def check_threads(threads: int | None) -> int | None:
    """``threads`` if this machine can use so many; raises ValueError otherwise."""
    if threads is None:
        return None
    from sepmc.kernels.batch import max_threads  # noqa: PLC0415

    if isinstance(threads, bool) or not 1 <= threads <= max_threads():
        raise ValueError(f"threads = {threads}: must lie in 1 to {max_threads()}, the cores of this machine")
    return threads


def warm_up(plan: Plan, threads: int | None = None, announce: Callable[[str], None] | None = None) -> float:
    """Compile the kernels, or load them from the disk cache, by flying no case. Returns the seconds it took."""
    start = time.perf_counter()
    from sepmc.kernels import _jit, batch  # noqa: PLC0415

    if announce and not _jit.is_cached():
        announce("compiling the kernels, once per version of sepmc (about half a minute) ...")
    batch.use_threads(threads)
    _fly(plan, np.empty(0, dtype=np.int64), np.empty((0, 0)), 0, 0, _NO_HISTORY)
    return time.perf_counter() - start


class _Flight:
    """The chunks of one run: draws, flies, stores and counts them."""

    def __init__(self, campaign: Campaign, seed: int, total: int, folder: Path | None, timing: dict[str, float]):
        self.campaign, self.seed, self.total, self.folder, self.timing = campaign, seed, total, folder, timing
        self.parts: list[dict[str, np.ndarray]] = []
        self.history_parts: list[dict[str, np.ndarray]] = []
        self.flown, self.failures, self.implausible = 0, 0, 0
        self.started = datetime.now(UTC)
        joints = list(campaign.plan.joints)
        self.separation = schema.separation_columns(joints) if campaign.scene.run.history_step > 0.0 and joints else []
        self.labels = np.array([status.label for status in Status])

    def fly(self, first: int, end: int) -> None:
        campaign, clock = self.campaign, time.perf_counter
        t0 = clock()
        drawn = cases.draw(campaign.file.dispersions, self.seed, first, end - first)
        self.implausible += campaign.implausible_inertias(drawn)
        t1 = clock()
        level = _SEPARATION_HISTORY if self.separation else _NO_HISTORY
        run = campaign.scene.run
        room = int(run.end_time / run.history_step + 1e-9) + 1 if self.separation else 0
        block = _fly(campaign.plan, campaign._slots, drawn * campaign._factors, room, len(self.separation), level)
        t2 = clock()
        part = self._part(first, end, drawn, block)
        history = self._history(first, end, block) if self.separation else None
        if self.folder:
            if history:  # before the cases, which say what is done
                columns = [
                    Column("case", "1", "number of the case"),
                    Column("time_s", "s", "time since the start of the case"),
                    *self.separation,
                ]
                store.write_parquet(store.part_path(self.folder, store.HISTORIES, first), columns, history)
            store.write_parquet(store.part_path(self.folder, store.CASES, first), campaign.columns, part)
        t3 = clock()
        for stage, seconds in (("sample", t1 - t0), ("kernel", t2 - t1), ("write", t3 - t2)):
            self.timing[stage] += seconds
        self.parts.append(part)
        if history:
            self.history_parts.append(history)
        self.flown += end - first
        self.failures += int(np.count_nonzero(block.status != Status.OK))

    def _part(self, first: int, end: int, drawn: np.ndarray, block: _Block) -> dict[str, np.ndarray]:
        campaign = self.campaign
        part: dict[str, np.ndarray] = {"case": np.arange(first, end), "status": self.labels[block.status].astype(object)}
        part |= {c.name: drawn[:, i] for i, c in enumerate(campaign.input_columns)}
        found = [*campaign.outcome_columns, *schema.audit_columns()]
        part |= {c.name: block.outcomes[:, i] * c.scale for i, c in enumerate(found)}
        return part

    def _history(self, first: int, end: int, block: _Block) -> dict[str, np.ndarray]:
        keep = np.arange(block.times.shape[1])[None, :] < block.rows[:, None]
        number = np.broadcast_to(np.arange(first, end)[:, None], keep.shape)
        history = {"case": number[keep], "time_s": block.times[keep]}
        return history | {c.name: block.history[:, :, i][keep] * c.scale for i, c in enumerate(self.separation)}

    def write_manifest(self, threads: int | None, complete: bool) -> None:
        assert self.folder is not None
        campaign = self.campaign
        tree = {**campaign.file.tree, "run": {**campaign.file.tree.get("run", {}), "cases": self.total, "seed": self.seed}}
        resolved = CampaignFile(
            campaign.name, campaign.file.title, campaign.scene, campaign.file.dispersions, campaign.file.reference, tree
        )
        store.write_text(self.folder / store.CAMPAIGN, resolved.toml)
        manifest = {
            "campaign": campaign.name,
            "digest": campaign.digest,
            "seed": self.seed,
            "cases": self.total,
            "complete": complete,
            "cases_flown_by_this_command": self.flown,
            "failures": self.failures,
            "notes": self.notes,
            "started": self.started.isoformat(timespec="seconds"),
            "finished": datetime.now(UTC).isoformat(timespec="seconds"),
            "timing_s": {k: round(v, 6) for k, v in self.timing.items()},
            "threads": threads or os.cpu_count(),
            "sepmc": __version__,
            "versions": {"python": platform.python_version(), **{p: version(p) for p in ("numpy", "numba", "pandas", "pyarrow")}},
            "machine": f"{platform.machine()} {platform.system()}",
        }
        store.write_json(self.folder / store.MANIFEST, manifest)

    @property
    def notes(self) -> list[str]:
        if not self.implausible:
            return []
        return [
            f"{self.implausible} of {self.flown} drawn cases have an inertia that breaks the triangle inequality, which no solid body has"
        ]

    def result(self, resumed: bool) -> Result:
        campaign = self.campaign
        if resumed and self.folder:
            frame = store.read_cases(self.folder)
            frame = frame[frame["case"] < self.total]
            histories = store.read_histories(self.folder)
            table = {str(name): frame[name].to_numpy() for name in frame.columns}
            history = None if histories is None else {str(name): histories[name].to_numpy() for name in histories.columns}
        else:
            table = _join(self.parts)
            history = _join(self.history_parts) if self.history_parts else None
        return Result(campaign, table, history, self.timing, self.seed, self.folder, self.notes)


def _join(parts: list[dict[str, np.ndarray]]) -> dict[str, np.ndarray]:
    return {name: np.concatenate([part[name] for part in parts]) for name in parts[0]}
