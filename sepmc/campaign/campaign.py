"""The Python interface: a campaign is read and flown, what it gave is read, any case of it is flown
alone."""

import time
import warnings
from collections.abc import Callable, Iterable, Mapping
from contextlib import nullcontext
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

import msgspec
import numpy as np
import pandas as pd

from sepmc import schema
from sepmc.analysis import causes, drivers, laws, requirements
from sepmc.analysis.compare import differences
from sepmc.analysis.given import names_of, where
from sepmc.analysis.precision import Until, read_until
from sepmc.analysis.statistics import statistics
from sepmc.campaign import store
from sepmc.campaign.accuracy import Achieved, with_scales
from sepmc.campaign.cases import OF_ITS_SIZE
from sepmc.campaign.chunks import Chunks, Draws, Earlier
from sepmc.campaign.definition import Case, Definition
from sepmc.campaign.flight import Flight
from sepmc.campaign.input_file import read_input_table
from sepmc.campaign.limit import target
from sepmc.campaign.numbers import Numbers
from sepmc.campaign.pilot import plan_flight
from sepmc.campaign.rare import MOST, Rare, seek
from sepmc.campaign.remarks import together
from sepmc.campaign.single import fly_single, invalid
from sepmc.campaign.sinks import Kept
from sepmc.campaign.tally import Tally
from sepmc.campaign.tally import read as read_tally
from sepmc.engine.door import check_every, check_threads, use_threads, whole
from sepmc.scene.fields import convert
from sepmc.scene.load_checks import SHORTEST
from sepmc.scene.messages import InputError, RunWarning, nearest
from sepmc.scene.model import Requirement
from sepmc.scene.read import find_file, parse_campaign, read_campaign
from sepmc.schema import Status, is_yes_or_no

_TOLD = 8  # differences between two campaigns
_LOOKED_AT = 256  # cases, and twice and so on: then it is seen whether these are enough
Progress = Callable[[int, int, int], None]  # cases done, cases in all, failures so far


def load(
    path: str | Path, settings: dict[str, Any] | None = None, verify: bool = True
) -> "Campaign":
    """Read a campaign.

    Parameters
    ----------
    path : str or Path
        A campaign file, a run folder, or the bare name of a shipped campaign.
    settings : dict, optional
        Values to put in place, by TOML path: ``{"solver.formulation": "full"}``.
    verify : bool
        Whether the campaign of a run folder must be as it was flown.

    Raises
    ------
    SceneError
        If anything in the file cannot be flown, with every problem and its place.
    StoreError
        If it is that of a run folder, and was changed since it was flown.
    """
    file = find_file(path)
    if verify and file.name == store.CAMPAIGN and store.is_run(file.parent):
        store.read_manifest(file.parent)
    return Campaign(read_campaign(path, settings, read_input_table))


@dataclass(repr=False)
class Result:
    """What a campaign gave.

    Rows of a run into a folder are read from there when they are asked for; a run without one keeps
    them in memory. ``timing`` is in seconds by stage: compile, sample, kernel, write; the last goes
    on while the kernel flies, so the sum can exceed the time taken. ``flight`` is how it was flown,
    ``accuracy`` its numerical error, ``notes`` what deserves a look: an accuracy that is not met, a
    nominal case that goes together instead of apart.
    """

    campaign: "Campaign"
    kept: Kept
    timing: dict[str, float]
    seed: int
    numbers: Numbers  # of the cases
    total: int  # cases that these are drawn of
    folder: Path | None = None
    notes: list[str] = field(default_factory=list)
    flight: Flight | None = None
    accuracy: Achieved | None = None
    resumed: int = 0  # cases that the folder held already

    def __repr__(self) -> str:
        counts = ", ".join(
            f"{count} {label}" for label, count in self.status_counts.items() if count
        )
        return (
            f"<Result of {self.campaign.name}, seed {self.seed}: "
            f"{counts}{f', in {self.folder}' if self.folder else ''}>"
        )

    def _repr_html_(self) -> str:
        """A notebook's view: what came of the cases, and the statistics."""
        from html import escape  # noqa: PLC0415

        columns = ["n", "mean", "sigma", "min", "p50", "max", "case_min", "case_max"]
        return f"<p>{escape(repr(self))}</p>{self.statistics()[columns].to_html()}"

    @property
    def table(self) -> dict[str, np.ndarray]:
        """The case table by column. Raises ValueError if no rows were kept."""
        return dict(self._rows())

    def to_pandas(self) -> pd.DataFrame:
        """One row per case: case, status, inputs (``in_...``), outcomes and audit columns.

        Raises
        ------
        ValueError
            If only statistics were kept, ``stats_only=True``.
        """
        return pd.DataFrame(self.table)

    def histories(self) -> pd.DataFrame | None:
        """Separation over time in long form (case, time_s, ...), or None if ``run.history_step_s``
        is 0."""
        self._rows()
        if self.folder:
            return store.read_histories(self.folder)
        return None if self.kept.histories is None else pd.DataFrame(dict(self.kept.histories))

    def statistics(self, *given: str) -> pd.DataFrame:
        """Statistics of every outcome, see `sepmc.analysis.statistics.statistics`: of all cases, or
        of those for which all terms ``given`` hold, such as ``"joint.bolt.fails=1"``."""
        if given:
            rows, outcomes = self._rows(), self.campaign.summarised[0]
            held = where(rows, names_of(self.campaign.file.dispersions, list(rows)), given)
            kept = {name: rows[name][held] for name in ("case", "status", *outcomes)}
            return statistics(kept, outcomes)
        table = self.kept.summary.statistics(self.campaign.reference)
        if self.accuracy:
            table["error"] = [self.accuracy.errors.get(str(name), np.nan) for name in table.index]
        return table

    def requirements(self) -> pd.DataFrame:
        """Verdicts on what the campaign requires, a row each; see
        `sepmc.analysis.requirements.Verdict`."""
        told = self.accuracy.errors if self.accuracy else {}
        errors = with_scales(self.campaign, told, self.kept.summary.statistics())
        sampler, audited = self.campaign.scene.run.sampler, self.kept.summary.audit()
        return requirements.table(self.kept.summary.verdicts(errors, audited, sampler))

    def drivers(self, outcome: str, indices: bool = True) -> pd.DataFrame:
        """How much each input drives an outcome, a row each; see
        `sepmc.analysis.drivers.drivers`, which raises ValueError if the outcome does not vary."""
        if outcome not in self.outcomes:
            raise InputError(f"{outcome}: no such outcome; {nearest(outcome, self.outcomes)}")
        sampler = self.campaign.scene.run.sampler
        return drivers.drivers(self._rows(), self._inputs, outcome, sampler, indices)

    def laws(self) -> pd.DataFrame:
        """Shape of every outcome that is a number, and the law nearest to it, a row each; see
        `sepmc.analysis.laws.laws`."""
        return laws.laws(self._rows(), [n for n in self.outcomes if not is_yes_or_no(n)])

    def causes(self, name: str) -> list[causes.Cause]:
        """Inputs and pairs of inputs that set the cases apart which violate a requirement, or have
        a status; see `sepmc.analysis.causes.causes`."""
        rows, known = self._rows(), {item.name: item for item in self.campaign.file.requirements}
        statuses = [status.label for status in Status if status is not Status.OK]
        if name not in known and name not in statuses:
            said = nearest(name, [*known, *statuses])
            raise InputError(f"{name}: no such requirement or status; {said}")
        item = known.get(name) or Requirement(name=name, metric=name)
        return causes.of_requirement(item, rows, self._inputs, list(known.values()))

    @property
    def _inputs(self) -> list[str]:
        return [column.name for column in self.campaign.input_columns]

    def case(self, number: int) -> Case:
        """Case ``number`` as it was flown here, fully resolved in SI. Raises ValueError if there is
        no such case."""
        number = whole("case", number, 0)
        if number not in self.numbers:
            raise InputError(f"case = {number}: must be one of those flown, {self.numbers}")
        found = self.campaign.case(number, self.seed, self.total)
        run = msgspec.structs.replace(found.scene.run, cases=self.total, seed=self.seed)
        return replace(found, scene=msgspec.structs.replace(found.scene, run=run))

    @property
    def outcomes(self) -> list[str]:
        """Names of the outcome columns."""
        return [column.name for column in self.campaign.outcome_columns]

    @property
    def units(self) -> dict[str, str]:
        """Unit of each column of the case table."""
        return {column.name: column.unit for column in self.campaign.columns}

    @property
    def status_counts(self) -> dict[str, int]:
        """Number of cases by status, of those that occur."""
        return {label: count for label, count in self.kept.summary.counts.items() if count}

    def _rows(self) -> Mapping[str, np.ndarray]:
        if self.kept.rows is None:
            raise InputError(
                "this run kept statistics only, so it has no rows; run without stats_only, or fly "
                "single cases by case(number)"
            )
        return self.kept.rows


class _Told(dict[str, Any]):
    """Told of a history in its ``attrs``, of which pandas makes deep copies for every column that
    is taken from it: this one stays what it is."""

    def __deepcopy__(self, memo: dict[int, Any]) -> "_Told":
        return self


class Campaign(Definition):
    """A scene, its dispersions and its run settings, ready to fly."""

    def __repr__(self) -> str:
        scene = self.scene
        return (
            f"<Campaign {self.name}: {len(scene.body)} bodies, {len(scene.joint)} joints, "
            f"{len(scene.phase)} phases; {len(self.file.dispersions)} dispersed parameters, "
            f"{self.numbers.count} cases, seed {scene.run.seed}>"
        )

    def with_settings(self, settings: dict[str, Any]) -> "Campaign":
        """A campaign with other values, by TOML path as in the file: ``{"body.upper.mass_kg":
        460.0}``."""
        tree, folder, name = self.file.tree, self.file.folder, self.name
        return Campaign(parse_campaign(tree, name, settings, name, folder, read_input_table))

    def simulate(
        self,
        case: Case | int | None = None,
        step_s: float = 0.001,
        announce: Callable[[str], None] | None = None,
    ) -> pd.DataFrame:
        """Time history of one case (the nominal if None, or that of a number), a row every
        ``step_s`` and two at each phase boundary.

        Flown at ``solver.step_s``, or else in steps at which two halvings in a row changed no
        outcome by more than ``solver.accuracy``: by the kernel written for the scene, as plain
        Python or, where that takes thousands of steps, compiled, which ``announce`` is told of. Its
        outcomes are those of the campaign's row to that accuracy.

        Returns
        -------
        history : DataFrame
            time_s, phase, then the columns of `sepmc.schema.history_columns`. ``attrs`` holds
            ``units``, the ``outcomes`` of the case, their ``errors`` (relative, see
            `sepmc.campaign.accuracy.errors`: at a given step twice the change at half of it, else
            the last change), its ``status``, whether its kernel was ``compiled``, and ``notes``,
            sentences on what deserves a look.
        """
        check_every(step_s, self.scene)
        if case is not None and not isinstance(case, Case):
            case = self.case(whole("case", case, 0))
        scene, unfit = (case or self.nominal()).scene, self._unfit(case)
        if unfit:
            scene = self.nominal().scene
            found = invalid(scene, len(self.result_columns))
        else:
            found = fly_single(scene, self.outcome_columns, step_s, announce)
        columns = schema.history_columns(found.plan.contents)
        data: dict[str, Any] = {
            "time_s": found.times,
            "phase": [found.plan.phases[p] for p in found.phases],
        }
        data |= {c.name: found.rows[:, i] * c.scale for i, c in enumerate(columns)}
        frame = pd.DataFrame(data)
        results = schema.result_columns(found.plan.contents)
        outcomes = {
            c.name: float(x * c.scale) for c, x in zip(results, found.outcomes, strict=True)
        }
        which = "the nominal case" if case is None or case.number < 0 else f"case {case.number}"
        errors = () if found.error is None else zip(self.outcome_columns, found.error, strict=True)
        notes = unfit + found.notes + together(scene, outcomes, which)
        _warn(notes, announce)
        frame.attrs = {
            "units": _Told({"time_s": "s", "phase": "", **{c.name: c.unit for c in columns}}),
            "outcomes": _Told(outcomes),
            "errors": _Told({c.name: float(x) for c, x in errors}),
            "status": found.status.label,
            "compiled": found.compiled,
            "notes": notes,
        }
        return frame

    def _unfit(self, case: Case | None) -> list[str]:
        """A sentence for each number of a case that may not be, as laws give it."""
        found = []
        for dispersion in self.file.dispersions:
            parameter, field = dispersion.parameter, dispersion.parameter.field
            value = (case.inputs if case else {}).get(parameter.column)
            if value is not None and field is not None and dispersion.has_tails:
                why = convert(value * parameter.factor, field.type)[1]
                found += [f"{parameter.key} = {value:g}: {why}"] if why else []
        for load in case.scene.load if case else ():
            if load.end - load.start <= SHORTEST:
                found.append(
                    f"load.{load.name}.end_s = {load.end:g}: must be > start_s = {load.start:g}"
                )
        return found

    def run(
        self,
        cases: int | str | Numbers | Iterable[int] | None = None,
        seed: int | None = None,
        threads: int | None = None,
        out: str | Path | None = None,
        *,
        overwrite: bool = False,
        resume: bool = False,
        stats_only: bool = False,
        until: str | None = None,
        progress: Progress | None = None,
        announce: Callable[[str], None] | None = None,
    ) -> Result:
        """Fly the campaign.

        Parameters
        ----------
        cases : int, text or numbers, optional
            How many cases, or which, as ``"25:50,73"`` or a list of their numbers, instead of those
            of the file.
        seed : int, optional
            Instead of that of the file.
        threads : int, optional
            All cores if None. The result does not depend on it.
        out : path, optional
            Run folder to write, whose rows are then read from there when asked for; None keeps
            everything in memory.
        overwrite, resume : bool
            What to do with an existing ``out``: replace the run in it, or fly only its missing
            cases.
        stats_only : bool
            Keep statistics, histograms, audit and counts only, in memory that does not grow with
            the cases: no rows, no histories, nothing to resume. Percentiles are exact up to 65,536
            cases, then within 0.41 % of sigma; see `sepmc.analysis.sketch`.
        until : str, optional
            Fly no more of the cases, once 256, 512, ... of them are flown, than it takes to know a
            statistic: ``"separation_speed_m_s:0.01"``, half of the 95 % interval of its mean in its
            unit, or ``:1%``; of ``.sigma`` or a percentile, ``.p99``, instead of the mean; of the
            share of a status.
        progress : callable (done, total, failures), optional
        announce : callable (text), optional
            Told what begins, and that kernels must be compiled if so. Without it, notes on the run
            are also given as warnings (`sepmc.RunWarning`).

        Raises
        ------
        StoreError
            If ``out`` cannot be used as asked.
        ValueError
            If cases, seed or threads are out of range, or ``resume`` meets ``stats_only``.

        Notes
        -----
        Interrupted (Ctrl-C) with ``out`` given, all finished chunks are in the folder and
        ``resume=True`` goes on from there.
        """
        numbers, total = self.asked(cases)
        seed = self._seed(seed)
        threads = check_threads(threads)
        stop = None if until is None else self.until(until, numbers, resume)
        if stats_only and resume:
            raise InputError("stats_only keeps no cases to go on from; fly without resume")
        place = nullcontext() if out is None else store.opened(Path(out), overwrite, resume)
        with place as folder:
            return self._run(
                folder, numbers, total, seed, threads, stop, resume, stats_only, progress, announce
            )

    def _run(
        self,
        folder: Path | None,
        numbers: Numbers,
        total: int,
        seed: int,
        threads: int | None,
        stop: Until | None,
        resume: bool,
        stats_only: bool,
        progress: Progress | None,
        announce: Callable[[str], None] | None,
    ) -> Result:
        """`run`, in memory or into a folder that is open."""
        settings = self.scene.run
        done = (
            self._resumed(folder, seed, numbers, total, announce)
            if folder and resume
            else np.empty(0, dtype=np.int64)
        )
        if folder and resume and announce and not len(done):
            announce(f"{folder}: there are no cases to go on from, so all are flown")
        if announce:
            announce(
                f"{self.name}: {self.file.title or 'no title'}; {numbers.count} cases, seed {seed}"
                + (f", into {folder}" if folder else "")
            )
        use_threads(threads)
        begun = time.perf_counter()
        flight = plan_flight(
            self, history=settings.history_step > 0.0 and not stats_only, announce=announce
        )
        timing = {
            "compile": time.perf_counter() - begun,
            "sample": 0.0,
            "kernel": 0.0,
            "write": 0.0,
        }
        earlier = Earlier()
        if folder and len(done):
            tally = sum((read_tally(text) for text in store.tallies(folder)), Tally())
            earlier = Earlier(len(done), tally, tuple(store.made_by(folder).get("sessions", ())))
        wanted = numbers.without(done)
        left = wanted.count
        if announce and len(done):
            announce(f"{folder}: {len(done)} cases are there, {left} are left to fly")
        draws = Draws(seed, numbers, total)
        chunks = Chunks(self, flight, draws, timing, earlier, folder, stats_only, announce)
        if folder:
            if self.file.input_table:
                store.write_input_table(folder, self.file.input_table, self.input_columns)
            chunks.write_manifest(threads, complete=False)
        try:
            with chunks:
                if progress:
                    progress(0, left, 0)
                for some in wanted.growing(_LOOKED_AT) if stop else (wanted,):
                    for first, end in some.pieces(chunks.size):
                        chunks.fly(
                            first,
                            end,
                            (lambda: progress(chunks.flown, left, chunks.failures))
                            if progress
                            else lambda: None,
                        )
                    if stop and chunks.is_known(stop):
                        break
        finally:
            if folder:
                chunks.write_manifest(threads, complete=chunks.held == chunks.wanted)
        _warn(chunks.notes, announce)
        return Result(
            self,
            chunks.kept(),
            timing,
            seed,
            chunks.draws.numbers,
            chunks.draws.total,
            folder,
            chunks.notes,
            flight,
            chunks.accuracy,
            resumed=len(done),
        )

    def rare(
        self,
        requirement: str,
        most: int = MOST,
        seed: int | None = None,
        out: str | Path | None = None,
        *,
        threads: int | None = None,
        overwrite: bool = False,
        progress: Progress | None = None,
        announce: Callable[[str], None] | None = None,
    ) -> Rare:
        """How rarely a requirement is violated, where plain cases are too few to count: subset
        simulation, see `sepmc.analysis.rare`.

        Parameters
        ----------
        requirement : str
            Its name; on an outcome that is a number, or that there is no contact.
        most : int
            Flights allowed: 1e5 tell 1e-6 to a quarter of it (95 %).
        seed, out, threads, overwrite, progress, announce : as for `run`

        Raises
        ------
        StoreError, ValueError
            If ``out`` cannot be used as asked, or the requirement cannot be sought.
        """
        check_threads(threads)
        target(self, requirement)
        place = nullcontext() if out is None else store.opened(Path(out), overwrite, False, False)
        with place as folder:
            found = seek(self, requirement, most, seed, threads, folder, progress, announce)
        _warn(found.notes, announce)
        return found

    def until(self, text: str, numbers: Numbers, resume: bool) -> Until:
        """When to stop. Raises InputError if that cannot be told of these cases."""
        found = read_until(text, [column.name for column in self.outcome_columns])
        if resume or not numbers.are_first or self.scene.run.sampler in OF_ITS_SIZE:
            what = "a sampler whose cases depend on how many there are"
            what = "resume" if resume else what if numbers.are_first else "cases that are named"
            raise InputError(f"until = {text}: excludes {what}")
        return found

    def _resumed(
        self,
        folder: Path,
        seed: int,
        numbers: Numbers,
        total: int,
        announce: Callable[[str], None] | None,
    ) -> np.ndarray:
        """Cases a folder already holds whole, if it is the same campaign."""
        if not store.is_run(folder):
            return np.empty(0, dtype=np.int64)
        manifest = store.made_by(folder)
        if "rare" in manifest:
            raise store.StoreError(
                f"{folder}: holds {store.RARE}, so there are no cases to go on from; use "
                "--overwrite or another --out"
            )
        if manifest.get("stats_only"):
            raise store.StoreError(
                f"{folder}: holds statistics only, so there are no cases to go on from; use "
                "--overwrite or another --out"
            )
        if manifest.get("digest") not in (None, self.digest):
            raise store.StoreError(
                f"{folder}: was flown with another campaign, so its cases cannot be continued; use "
                f"--overwrite or another --out. {self._differences(folder)}"
            )
        if manifest.get("seed") not in (None, seed):
            raise store.StoreError(
                f"{folder}: was flown with another seed ({manifest.get('seed')}, not {seed}), so "
                "its cases cannot be continued; use --overwrite or another --out"
            )
        sampler, held = self.scene.run.sampler, manifest.get("of", manifest.get("cases"))
        if sampler in OF_ITS_SIZE and held not in (None, total):
            what = "a Latin hypercube" if sampler == "lhs" else "a Saltelli design"
            raise store.StoreError(
                f"{folder}: is {what} of {held} cases, which cannot be continued to {total}; use "
                "--overwrite or another --out"
            )
        dropped = store.drop_damaged(folder, self.has_histories)
        done, own = store.cases_done(folder), [column.name for column in self.columns]
        if len(done) and (other := set(own).symmetric_difference(store.CaseColumns(folder))):
            raise store.StoreError(
                f"{folder}: was flown by another version of sepmc, whose rows differ in "
                f"{', '.join(sorted(other))}, so its cases cannot be continued; use --overwrite or "
                "another --out"
            )
        if numbers.leave_out(done):
            raise store.StoreError(
                f"{folder}: holds cases up to {done[-1]}; --cases {_said(numbers)} would leave "
                "some out"
            )
        if dropped and announce:
            announce(
                f"{folder}: {dropped} cases, or their histories, are gone or not as they were "
                "written, so these are flown again"
            )
        return done

    def _differences(self, folder: Path) -> str:
        """What differs from the campaign of a run folder, key by key."""
        try:
            other = read_campaign(str(folder))
        except InputError:
            return f"What differs is not known, as its {store.CAMPAIGN} cannot be read."
        found = differences(other.tree, self.file.tree)
        more = f", and {len(found) - _TOLD} more" if len(found) > _TOLD else ""
        return f"It differs in {'; '.join(found[:_TOLD])}{more}"


def _warn(notes: list[str], announce: Callable[[str], None] | None) -> None:
    """Give notes as warnings, where nothing is announced to anyone."""
    for note in notes if announce is None else ():
        warnings.warn(note, RunWarning, stacklevel=3)


def _said(numbers: Numbers) -> str:
    """Numbers of cases as ``--cases`` takes them: how many, where they are the first ones."""
    return str(numbers.count if numbers.are_first else numbers)
