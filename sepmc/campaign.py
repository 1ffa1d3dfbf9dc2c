"""A campaign: a scene, what varies in it and how it is run. The Python interface."""

import hashlib
import time
from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import cached_property
from pathlib import Path
from typing import Any

import msgspec
import numpy as np
import pandas as pd

from sepmc import cases, schema, store
from sepmc.chunks import Chunks
from sepmc.compiler.plan import Plan, apart, make_plan
from sepmc.compiler.shape import reasons
from sepmc.door import check_every, check_threads, fly_block, use_threads, warm_up, whole
from sepmc.kernels.layout import FULL_HISTORY
from sepmc.pilot import plan_flight
from sepmc.remarks import together
from sepmc.result import Result
from sepmc.scene import parameters
from sepmc.scene.checks import breaks_triangle, tensor
from sepmc.scene.fields import convert
from sepmc.scene.messages import InputError
from sepmc.scene.model import Scene
from sepmc.scene.read import CampaignFile, parse_campaign, read_campaign
from sepmc.scene.units import unit_text
from sepmc.schema import Column, Status
from sepmc.settle import settle_case

Progress = Callable[[int, int, int], None]  # cases done, cases in all, failures so far


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
        plan = make_plan(self.scene, dispersed=self.dispersed)
        return replace(plan, contents=replace(plan.contents, specialised=not reasons(plan, self.dispersed)))

    @cached_property
    def dispersed(self) -> frozenset[str]:
        """Paths of the parameters that vary."""
        return frozenset(d.parameter.path for d in self.file.dispersions)

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
        return [Column(d.parameter.column, unit_text(d.parameter.unit), d.sentence) for d in self.file.dispersions]

    @cached_property
    def outcome_columns(self) -> list[Column]:
        return schema.outcome_columns(self.plan.contents)

    @cached_property
    def result_columns(self) -> list[Column]:
        """All that the kernel writes of a case, in its order."""
        return schema.result_columns(self.plan.contents)

    @cached_property
    def columns(self) -> list[Column]:
        """Columns of the case table."""
        head = [Column("case", "1", "number of the case"), Column("status", "", "ok, or why the case failed")]
        return [*head, *self.input_columns, *self.result_columns]

    @property
    def summarised(self) -> tuple[list[str], list[str], dict[str, float]]:
        """What statistics are made of: names of outcomes and of audit columns, and the bounds of these."""
        audits = schema.audit_columns(self.plan.contents.specialised)
        return [c.name for c in self.outcome_columns], [c.name for c in audits], schema.AUDIT_BOUNDS

    @cached_property
    def slots(self) -> np.ndarray:
        """Places of the dispersed parameters in the kernel's vector."""
        return np.array([self.plan.slots[d.parameter.path] for d in self.file.dispersions], dtype=np.int64)

    @cached_property
    def factors(self) -> np.ndarray:
        return np.array([d.parameter.factor for d in self.file.dispersions])

    def in_si(self, drawn: np.ndarray) -> np.ndarray:
        """A case table (n, d) in SI, as a kernel takes it; NaN, which no kernel flies, where a law's tail reaches what may not be."""
        draws = drawn * self.factors
        for i, dispersion in enumerate(self.file.dispersions):
            if dispersion.has_tails:
                draws[~dispersion.allowed(drawn[:, i]), i] = np.nan
        return draws

    @property
    def digest(self) -> str:
        """Digest of all that decides a case's outcome: two runs of equal digest and seed hold equal rows."""
        tree = {k: v for k, v in self.file.tree.items() if k not in ("title", "reference", "name")}
        tree["run"] = {k: v for k, v in tree.get("run", {}).items() if k not in ("cases", "seed", "chunk")}
        return hashlib.sha256(msgspec.json.encode(tree, order="deterministic")).hexdigest()[:16]

    def case(self, number: int, seed: int | None = None) -> Case:
        """Case ``number`` of the campaign, fully resolved in SI, drawn without the others."""
        number = whole("case", number, 0)
        drawn = cases.draw(self.file.dispersions, self._seed(seed), number, 1)[0]
        values = {d.parameter.path: float(x) for d, x in zip(self.file.dispersions, drawn * self.factors, strict=True)}
        return Case(
            number,
            parameters.replace(self.nominal().scene, values),
            {c.name: float(x) for c, x in zip(self.input_columns, drawn, strict=True)},
        )

    def nominal(self) -> Case:
        """The case without dispersion, number -1. What all cases share is pinned: the zero of ``alpha_ref``, the sign of apart."""
        initial = self.scene.initial
        if initial.path_reference is None:
            initial = msgspec.structs.replace(initial, path_reference=initial.pitch - initial.alpha)
        joints = {name: msgspec.structs.replace(joint, apart=apart(self.scene, name)) for name, joint in self.scene.joint.items()}
        return Case(-1, msgspec.structs.replace(self.scene, initial=initial, joint=joints), {})

    def simulate(self, case: Case | None = None, step_s: float = 0.001) -> pd.DataFrame:
        """Time history of one case (the nominal if None), a row every ``step_s`` and two at each phase boundary.

        Flown by the general kernel: at ``solver.step_s``, or else at a step at which two halvings in a row changed no outcome by more
        than ``solver.accuracy``. Its outcomes are then those of the campaign's row to that accuracy.

        Returns
        -------
        history : DataFrame
            time_s, phase, then the columns of `sepmc.schema.history_columns`. ``attrs`` holds ``units``, the ``outcomes`` of
            the case, its ``status`` and ``notes``, sentences on what deserves a look.
        """
        check_every(step_s, self.scene)
        warm_up()
        scene = (case or self.nominal()).scene
        unfit = self._unfit(case)
        step, notes = (scene.solver.step, []) if scene.solver.step or unfit else settle_case(scene, self.outcome_columns)
        plan = make_plan(scene, history_step=step_s, step=step)
        columns = schema.history_columns(plan.contents)
        counts = plan.model.scene[0]
        changes = counts.n_events + counts.n_joints * (counts.n_phases + counts.n_releases)  # each with a row before and one after
        room = int(plan.scene.run.end_time / step_s) + 2 * int(changes) + 4
        block = fly_block(plan, self.slots[: len(unfit)], np.full((1, len(unfit)), np.nan), room, len(columns), FULL_HISTORY)
        rows = int(block.rows[0])
        data: dict[str, Any] = {"time_s": block.times[0, :rows], "phase": [plan.phases[p] for p in block.phases[0, :rows]]}
        data |= {c.name: block.history[0, :rows, i] * c.scale for i, c in enumerate(columns)}
        frame = pd.DataFrame(data)
        found = schema.result_columns(plan.contents)
        outcomes = {c.name: float(x * c.scale) for c, x in zip(found, block.outcomes[0], strict=True)}
        which = "the nominal case" if case is None or case.number < 0 else f"case {case.number}"
        frame.attrs = {
            "units": {"time_s": "s", "phase": "", **{c.name: c.unit for c in columns}},
            "outcomes": outcomes,
            "status": Status(int(block.status[0])).label,
            "notes": unfit + notes + together(scene, outcomes, which),
        }
        return frame

    def _unfit(self, case: Case | None) -> list[str]:
        """A sentence for each number of a case that may not be, drawn from the tail of a law."""
        found = []
        for dispersion in self.file.dispersions:
            parameter, field = dispersion.parameter, dispersion.parameter.field
            value = (case.inputs if case else {}).get(parameter.column)
            if value is not None and field is not None and dispersion.has_tails:
                why = convert(value * parameter.factor, field.type)[1]
                found += [f"{parameter.key} = {value:g}: {why}"] if why else []
        return found

    def _seed(self, seed: int | None) -> int:
        return self.scene.run.seed if seed is None else whole("seed", seed, 0)

    def implausible_inertias(self, drawn: np.ndarray) -> int:
        """Number of rows of a case table (n, d) in which some body's inertia breaks the triangle inequality."""
        place = {d.parameter.path: i for i, d in enumerate(self.file.dispersions)}
        broken = np.zeros(len(drawn), dtype=bool)
        for name in self.scene.body:
            prefixes = (f"body.{name}.inertia.", f"body.{name}.inertia_products.")
            if any(path.startswith(prefixes) for path in place):
                values = {
                    path: drawn[:, place[path]] * self.factors[place[path]] if path in place else parameters.value(self.scene, path)
                    for path in (prefix + part for prefix, parts in zip(prefixes, _TENSOR_PARTS, strict=True) for part in parts)
                }
                tensors = np.moveaxis(tensor(*[np.broadcast_to(v, len(drawn)) for v in values.values()]), -1, 0)
                principal = np.linalg.eigvalsh(tensors)
                broken |= (principal[:, 0] > 0.0) & breaks_triangle(principal)
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
        stats_only: bool = False,
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
            Run folder to write, whose rows are then read from there when asked for; None keeps everything in memory.
        overwrite, resume : bool
            What to do with an existing ``out``: replace the run in it, or fly only its missing cases.
        stats_only : bool
            Keep statistics, histograms, audit and counts only, in memory that does not grow with the cases: no rows, no histories,
            nothing to resume. Percentiles are exact up to 65,536 cases, then within 0.41 % of sigma; see `sepmc.analysis.sketch`.
        progress : callable (done, total, failures), optional
        announce : callable (text), optional
            Told what begins, and that kernels must be compiled if so.

        Raises
        ------
        StoreError
            If ``out`` cannot be used as asked.
        ValueError
            If cases, seed or threads are out of range, or ``resume`` meets ``stats_only``.

        Notes
        -----
        Interrupted (Ctrl-C) with ``out`` given, all finished chunks are in the folder and ``resume=True`` goes on from there.
        """
        settings = self.scene.run
        total = settings.cases if cases is None else whole("cases", cases, 1, 10**9)
        seed = self._seed(seed)
        threads = check_threads(threads)
        if stats_only and resume:
            raise InputError("stats_only keeps no cases to go on from; fly without resume")
        folder = store.open_folder(Path(out), overwrite, resume) if out is not None else None
        done = self._resumed(folder, seed, total) if folder and resume else np.empty(0, dtype=np.int64)
        if announce:
            announce(f"{self.name}: {self.file.title or 'no title'}; {total} cases, seed {seed}" + (f", into {folder}" if folder else ""))
        use_threads(threads)
        begun = time.perf_counter()
        flight = plan_flight(self, history=settings.history_step > 0.0 and not stats_only, announce=announce)
        timing = {"compile": time.perf_counter() - begun, "sample": 0.0, "kernel": 0.0, "write": 0.0}
        earlier = None
        if folder and len(done):
            held, failed = store.cases_held(folder, Status.OK.label)
            earlier = store.read_manifest(folder) | {"cases_held": held, "failures": failed}
        left = total - len(done)
        chunks = Chunks(self, flight, seed, total, timing, folder, earlier, stats_only, announce)
        if folder:
            chunks.write_manifest(threads, complete=False)
        try:
            with chunks:
                if progress:
                    progress(0, left, 0)
                for first, end in store.missing_ranges(total, done, chunks.size):
                    chunks.fly(first, end, (lambda: progress(chunks.flown, left, chunks.failures)) if progress else lambda: None)
        finally:
            if folder:
                chunks.write_manifest(threads, complete=chunks.held == left)
        return Result(self, chunks.kept(), timing, seed, folder, chunks.notes, flight, chunks.accuracy)

    def _resumed(self, folder: Path, seed: int, total: int) -> np.ndarray:
        """Cases a folder already holds, if it is the same campaign."""
        if not (folder / store.MANIFEST).is_file():
            return np.empty(0, dtype=np.int64)
        manifest = store.read_manifest(folder)
        if manifest.get("stats_only"):
            raise store.StoreError(
                f"{folder}: holds statistics only, so there are no cases to go on from; use --overwrite or another --out"
            )
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
