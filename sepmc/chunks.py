"""The chunks of one run: each is drawn, flown, stored and counted; the manifest says how far the run got."""

import os
import time
from dataclasses import replace
from datetime import UTC, datetime
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from sepmc import __version__, cases, schema, store
from sepmc.door import Block, fly_block
from sepmc.kernels.layout import NO_HISTORY, SEPARATION_HISTORY
from sepmc.result import Result
from sepmc.schema import Column, Status

if TYPE_CHECKING:
    from sepmc.campaign import Campaign


class Chunks:
    """The chunks of one run: draws, flies, stores and counts them."""

    def __init__(
        self,
        campaign: "Campaign",
        seed: int,
        total: int,
        folder: Path | None,
        timing: dict[str, float],
        earlier: dict[str, Any] | None = None,
    ):
        self.campaign, self.seed, self.total, self.folder, self.timing = campaign, seed, total, folder, timing
        self.parts: list[dict[str, np.ndarray]] = []
        self.history_parts: list[dict[str, np.ndarray]] = []
        self.flown, self.failures = 0, 0
        self.earlier = earlier or {}  # the manifest of the run that is resumed
        self.implausible = self.earlier.get("implausible_inertias", 0)
        self.started = datetime.now(UTC)
        joints = list(campaign.plan.joints)
        self.separation = schema.separation_columns(joints) if campaign.scene.run.history_step > 0.0 and joints else []
        self.about = {"campaign": campaign.name, "digest": campaign.digest, "seed": str(seed), "sepmc": __version__}
        self.labels = np.array([status.label for status in Status])

    def fly(self, first: int, end: int) -> None:
        campaign, clock = self.campaign, time.perf_counter
        t0 = clock()
        drawn = cases.draw(campaign.file.dispersions, self.seed, first, end - first)
        self.implausible += campaign.implausible_inertias(drawn)
        t1 = clock()
        level = SEPARATION_HISTORY if self.separation else NO_HISTORY
        run = campaign.scene.run
        room = int(run.end_time / run.history_step + 1e-9) + 1 if self.separation else 0
        block = fly_block(campaign.plan, campaign.slots, drawn * campaign.factors, room, len(self.separation), level)
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
                store.write_parquet(store.part_path(self.folder, store.HISTORIES, first), columns, history, self.about)
            store.write_parquet(store.part_path(self.folder, store.CASES, first), campaign.columns, part, self.about)
        t3 = clock()
        for stage, seconds in (("sample", t1 - t0), ("kernel", t2 - t1), ("write", t3 - t2)):
            self.timing[stage] += seconds
        self.parts.append(part)
        if history:
            self.history_parts.append(history)
        self.flown += end - first
        self.failures += int(np.count_nonzero(block.status != Status.OK))

    def _part(self, first: int, end: int, drawn: np.ndarray, block: Block) -> dict[str, np.ndarray]:
        campaign = self.campaign
        part: dict[str, np.ndarray] = {"case": np.arange(first, end), "status": self.labels[block.status].astype(object)}
        part |= {c.name: drawn[:, i] for i, c in enumerate(campaign.input_columns)}
        found = schema.result_columns(campaign.plan.contents)
        part |= {c.name: block.outcomes[:, i] * c.scale for i, c in enumerate(found)}
        return part

    def _history(self, first: int, end: int, block: Block) -> dict[str, np.ndarray]:
        keep = np.arange(block.times.shape[1])[None, :] < block.rows[:, None]
        number = np.broadcast_to(np.arange(first, end)[:, None], keep.shape)
        history = {"case": number[keep], "time_s": block.times[keep]}
        return history | {c.name: block.history[:, :, i][keep] * c.scale for i, c in enumerate(self.separation)}

    def write_manifest(self, threads: int | None, complete: bool) -> None:
        assert self.folder is not None
        campaign = self.campaign
        tree = {**campaign.file.tree, "run": {**campaign.file.tree.get("run", {}), "cases": self.total, "seed": self.seed}}
        store.write_text(self.folder / store.CAMPAIGN, replace(campaign.file, tree=tree).toml)
        held, failed = store.cases_held(self.folder, Status.OK.label)
        manifest = {
            "campaign": campaign.name,
            "digest": campaign.digest,
            "seed": self.seed,
            "cases": self.total,
            "complete": complete,
            "cases_held": held,
            "failures": failed,
            "implausible_inertias": self.implausible,
            "sessions": [*self.earlier.get("sessions", []), self._session(threads)],
        }
        store.write_json(self.folder / store.MANIFEST, manifest)

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
    def notes(self) -> list[str]:
        note = implausible_note(self.implausible, self.earlier.get("cases_held", 0) + self.flown)
        return [note] if note else []

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


def implausible_note(broken: int, drawn: int) -> str:
    """The sentence that counts inertias no solid body has; empty if there is none."""
    return f"{broken} of {drawn} drawn cases have an inertia that breaks the triangle inequality, which no solid body has" if broken else ""


def _join(parts: list[dict[str, np.ndarray]]) -> dict[str, np.ndarray]:
    return {name: np.concatenate([part[name] for part in parts]) for name in parts[0]}
