"""The Python interface: a campaign is read and flown, what it gave is read, any case of it is flown
alone."""

import time
from collections.abc import Iterable
from contextlib import nullcontext
from dataclasses import replace
from pathlib import Path
from typing import Any

import pandas as pd

from sepmc import schema
from sepmc.analysis.stopping import StoppingRule, parse_stopping_rule
from sepmc.campaign import run_statistics
from sepmc.campaign.case_selection import CaseSelection
from sepmc.campaign.cases import SIZE_DEPENDENT
from sepmc.campaign.definition import Case, Definition
from sepmc.campaign.execution import previous_run
from sepmc.campaign.execution.chunk import SampleSpec
from sepmc.campaign.execution.diagnostics import reversed_joints
from sepmc.campaign.execution.forecast import forecast
from sepmc.campaign.execution.limit_state import limit_state
from sepmc.campaign.execution.rare_event import (
    DEFAULT_FLIGHTS,
    RareEventEstimate,
    estimate_rare_event,
)
from sepmc.campaign.execution.runner import ExecutionOptions, PreviousRun, Runner
from sepmc.campaign.execution.single_case import invalid_case, simulate_case
from sepmc.campaign.execution.step_selection import select_steps
from sepmc.campaign.execution.work_ranges import Executor
from sepmc.campaign.label import as_text
from sepmc.campaign.result import Result
from sepmc.campaign.run_options import Progress, RunOptions
from sepmc.campaign.store import folders, manifests, shards
from sepmc.campaign.store.row_selection import ALL, KeepRules, parse_keep_rules
from sepmc.campaign.store.sample_file import read_input_table
from sepmc.engine.dispatch import (
    check_history_step,
    check_int,
    check_text,
    check_threads,
    thread_notes,
    using_threads,
)
from sepmc.kernel.spec.parameter_layout import make_parameter_layout
from sepmc.paths import as_path
from sepmc.scene.fields import convert
from sepmc.scene.limits import CASES
from sepmc.scene.load_checks import SHORTEST
from sepmc.scene.messages import InputError, Log, RunWarning, warn
from sepmc.scene.read import find_file, parse_campaign, read_campaign


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
    before: dict[str, str] = {}  # what was set when it was flown
    if file.name == folders.CAMPAIGN and folders.is_run(file.parent):
        if verify:
            manifests.read_manifest(file.parent)
        before = manifests.read_provenance(file.parent).get("settings", {})
    read = read_campaign(path, settings, read_input_table)
    return Campaign(read, before | as_text(settings or {}))


class _NoCopyDict(dict[str, Any]):
    """Told of a history in its ``attrs``, of which pandas makes deep copies for every column that
    is taken from it: this one stays what it is."""

    def __deepcopy__(self, memo: dict[int, Any]) -> "_NoCopyDict":
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
        read = parse_campaign(tree, name, settings, name, folder, read_input_table)
        return Campaign(read, self.settings | as_text(settings or {}))

    def simulate(
        self,
        case: Case | int | None = None,
        step_s: float = 0.001,
        announce: Log | None = None,
        plain_work: float | None = None,
    ) -> pd.DataFrame:
        """Time history of one case (the nominal if None, or that of a number), a row every
        ``step_s`` and two at each phase boundary.

        Flown at ``solver.step_s``, or else in steps at which two halvings in a row changed no
        outcome by more than ``solver.accuracy``: by the kernel written for the scene, as plain
        Python or, where that takes more than some ten seconds, compiled, which ``announce`` is told
        of. Its outcomes are those of the campaign's row to that accuracy; one that has not settled
        when its work is spent has a note. With ``plain_work``, lines of its kernel that plain
        Python may fly (1e7 in 5 s), nothing is compiled, and what takes more raises
        `sepmc.campaign.execution.single_case.UnknownError`. A case is flown as its ``scene`` has
        it, whatever this campaign has; one of a campaign with other columns raises InputError.

        Returns
        -------
        history : DataFrame
            time_s, phase, then the columns of `sepmc.schema.history_columns`. ``attrs`` holds
            ``units``, the ``outcomes`` of the case, their ``errors`` (relative, see
            `sepmc.campaign.execution.accuracy.errors`: at a given step twice the change at half of
            it, else the last change), its ``status``, whether its kernel was ``compiled``,
            ``notes``, sentences on what deserves a look, and the times (s) of ``releases`` by joint
            and of ``events`` by name, NaN of those that did not come.
        """
        check_history_step(step_s, self.scene)
        if isinstance(case, Case):
            if make_parameter_layout(case.scene).contents != self.plan.contents:
                said = "must be a case of this campaign: it has other columns"
                raise InputError(f"case = {case!r}: {said}")
        elif case is not None:
            case = self.case(check_int("case", case, 0, CASES - 1))
        scene, unfit = (case or self.nominal()).scene, self._unfit(case)
        if unfit:
            scene = self.nominal().scene
            found = invalid_case(scene, len(self.result_columns))
        else:
            found = simulate_case(scene, self.outcome_columns, step_s, announce, plain_work)
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
        releases = schema.release_columns(found.plan.contents)
        events = schema.event_columns(found.plan.contents)
        which = "the nominal case" if case is None or case.number < 0 else f"case {case.number}"
        errors = () if found.error is None else zip(self.outcome_columns, found.error, strict=True)
        notes = unfit + found.notes + reversed_joints(scene, outcomes, which)
        _warn(notes, announce)
        frame.attrs = {
            "units": _NoCopyDict({"time_s": "s", "phase": "", **{c.name: c.unit for c in columns}}),
            "outcomes": _NoCopyDict(outcomes),
            "errors": _NoCopyDict({c.name: float(x) for c, x in errors}),
            "status": found.status.label,
            "compiled": found.compiled,
            "notes": notes,
            "releases": _NoCopyDict({j: outcomes[c] for j, c in releases.items()}),
            "events": _NoCopyDict({e: outcomes[c] for e, c in events.items()}),
            "springs": _NoCopyDict(found.springs),
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
        cases: int | str | CaseSelection | Iterable[int] | None = None,
        seed: int | None = None,
        threads: int | None = None,
        out: str | Path | None = None,
        *,
        options: RunOptions | None = None,
        **fields: Any,
    ) -> Result:
        """Run the campaign.

        Parameters
        ----------
        cases : int, str or iterable of int, optional
            Number of cases, or which cases, such as ``"25:50,73"`` or their numbers. Default: those
            of the file.
        seed : int, optional
            Default: the seed of the file.
        threads : int, optional
            Default: all cores. The result does not depend on it.
        out : path, optional
            Run folder to write; rows are read from there on demand. If None, all rows stay in
            memory.
        options : RunOptions, optional
            All other options.
        **fields
            Fields of `RunOptions` by name, in place of those of ``options``:
            ``run(out="runs/a", resume=True)``.

        Raises
        ------
        StoreError
            If ``out`` cannot be used as asked.
        ValueError
            If cases, seed, threads or an option is out of range.
        TypeError
            If ``fields`` has a name that is no field of `RunOptions`.

        Notes
        -----
        An interrupted run (Ctrl-C) with ``out`` stores all finished chunks, and ``resume=True``
        runs the missing cases in the mode in which the run began. A run that stores statistics
        only saves its state every ten seconds. Resumed with the same stopping rule ``until``, it
        stops at the same case; with a narrower tolerance it continues from the known statistic;
        without a rule, it follows the rule it began with.
        """
        options = replace(options or RunOptions(), **fields)
        stats_only, until, resume = options.stats_only, options.until, options.resume
        if resume and cases is None and out is not None:
            cases = previous_run.own_cases(self, as_path(out))
        numbers, total = self.select_cases(cases)
        seed = self._seed(seed)
        threads = check_threads(threads)
        if options.max_failures is not None:
            check_int("max_failures", options.max_failures, 0)
        kept = self._keep(options, out)
        if resume and out is not None:
            stats_only, kept, until = previous_run.original_mode(
                as_path(out), stats_only, kept, until
            )
        stop = None if until is None else self.until(until, numbers)
        some_counted = (stats_only or bool(kept)) and not numbers.are_first
        _check_executor(options.executor, out, until, some_counted)
        orders = ExecutionOptions(
            threads,
            options.executor,
            stop,
            options.max_failures,
            stats_only or kept is not None,
            kept,
            options.progress,
            options.announce,
        )
        into = (
            nullcontext()
            if out is None
            else folders.opened(as_path(out), options.overwrite, resume)
        )
        with using_threads(threads), into as folder:
            return self._run(folder, SampleSpec(seed, numbers, total), resume, orders)

    def _run(
        self, folder: Path | None, draws: SampleSpec, resume: bool, orders: ExecutionOptions
    ) -> Result:
        """`run`, in memory or into a folder that is open."""
        seed, numbers = draws.seed, draws.numbers
        stats_only, announce, crew, stop = (
            orders.stats_only,
            orders.announce,
            orders.crew,
            orders.until,
        )
        earlier, wanted = (
            previous_run.read_previous(self, folder, draws, stats_only, announce)
            if folder and resume
            else (PreviousRun(), numbers)
        )
        left = wanted.count
        if announce:
            announce(
                f"{self.name}: {self.file.title or 'no title'}; {numbers.count} cases, seed {seed}"
                + (f", into {folder}" if folder else "")
            )
        keep = orders.keep
        if folder and (not stats_only or (keep and ALL in keep.rules)):
            over_time = self.has_histories and not stats_only
            forecast(self, left, over_time, keep).check_disk(folder)
        begun = time.perf_counter()
        flight = select_steps(
            self, history=self.scene.run.history_step > 0.0 and not stats_only, announce=announce
        )
        timing = {
            "compile": time.perf_counter() - begun,
            "sample": 0.0,
            "kernel": 0.0,
            "write": 0.0,
        }
        if announce and earlier.n_stored:
            announce(f"{folder}: {earlier.n_stored} cases are there, {left} are left to fly")
        runner = Runner(self, flight, draws, timing, earlier, folder, orders)
        if folder:
            if self.file.input_table:
                shards.write_input_table(folder, self.file.input_table, self.input_columns)
            runner.write_manifest(complete=False)
        try:
            with runner:
                if orders.progress:
                    orders.progress(0, left, 0)

                def tell() -> None:
                    if orders.progress:
                        orders.progress(runner.n_run, left, runner.failures)

                if crew:
                    runner.run_on(crew, wanted, tell)
                parts = [numbers]
                if stop:
                    parts = list(numbers.doubling(stop.first(self.rare_values)))
                for part in [] if crew else parts:
                    for first, end in wanted.within(part).split(runner.size):
                        if not runner.too_many_failed:
                            runner.run(first, end, tell)
                    if stop and runner.statistic_is_known(stop, part.end, len(parts)):
                        break
                runner.finish()
        finally:
            if folder:
                runner.save()
                runner.write_manifest(complete=runner.n_stored == runner.n_wanted)
        output = runner.output()
        statistics = run_statistics.write(folder, self, output.summary) if folder else None
        notes = [*runner.notes, *thread_notes(orders.threads)]
        _warn(notes, announce)
        return Result(
            self,
            output,
            timing,
            seed,
            runner.spec.numbers,
            runner.spec.total,
            folder,
            notes,
            flight,
            runner.accuracy,
            resumed=earlier.n_stored,
            stopped=runner.too_many_failed,
            written=statistics,
        )

    def _keep(self, options: RunOptions, out: Any) -> KeepRules | None:
        """Parse the rules for rows to store. Raises InputError if they are not valid."""
        keep, columns = options.keep, options.keep_columns
        if keep is None:
            if columns or options.float32:
                raise InputError("keep_columns and float32 are of rows that are kept by keep")
            return None
        if out is None:
            raise InputError(f"keep = {keep}: rows are kept in a folder; give out")
        check_text("keep", keep, "failed,worst:20")
        if columns is not None:
            check_text("keep_columns", columns, "in_*,separation_*")
        return parse_keep_rules(
            keep, columns, options.float32, self.file.requirements, self.columns
        )

    def rare(
        self,
        requirement: str,
        most: int = DEFAULT_FLIGHTS,
        seed: int | None = None,
        out: str | Path | None = None,
        *,
        threads: int | None = None,
        overwrite: bool = False,
        resume: bool = False,
        progress: Progress | None = None,
        announce: Log | None = None,
    ) -> RareEventEstimate:
        """How rarely a requirement is violated, where plain cases are too few to count: subset
        simulation, see `sepmc.analysis.subset_simulation`.

        Parameters
        ----------
        requirement : str
            Its name; on an outcome that is a number, or that there is no contact.
        most : int
            Flights allowed: 1e5 tell 1e-6 to a quarter of it (95 %).
        seed, out, threads, overwrite, progress, announce : as for `run`
        resume : bool
            Go on with an estimate in ``out`` that was interrupted; asked for in the same way, it
            ends in the same numbers.

        Raises
        ------
        StoreError, ValueError
            If ``out`` cannot be used as asked, or the requirement cannot be sought.
        """
        check_threads(threads)
        limit_state(self, check_text("requirement", requirement, "a name"))
        if resume and out is None:
            raise InputError("resume: needs out, the folder of the estimate")
        into = nullcontext() if out is None else folders.opened(as_path(out), overwrite, resume)
        with using_threads(threads), into as folder:
            found = estimate_rare_event(
                self, requirement, most, seed, threads, folder, progress, announce, resume
            )
        found.notes.extend(thread_notes(threads))
        _warn(found.notes, announce)
        return found

    def until(self, asked: str, numbers: CaseSelection) -> StoppingRule:
        """When to stop. Raises InputError if that cannot be told of these cases."""
        check_text("until", asked, "separation_speed_m_s:0.01")
        found = parse_stopping_rule(asked, [column.name for column in self.outcome_columns])
        if not numbers.are_first or self.scene.run.sampler in SIZE_DEPENDENT:
            what = "a sampler whose cases depend on how many there are"
            what = what if numbers.are_first else "cases that are named"
            raise InputError(f"until = {asked}: excludes {what}")
        found.check(self.rare_values, numbers.count)
        return found


def _check_executor(
    executor: Executor | None, out: Any, until: str | None, some_counted: bool
) -> None:
    """Raise InputError if workers cannot fly what is asked for."""
    if executor is None:
        return
    if out is None:
        raise InputError("executor: workers fly into a folder; give out")
    if until is not None:
        raise InputError(f"until = {until}: excludes workers, who fly ahead of what is known")
    if some_counted:
        raise InputError("stats_only of cases that are named: excludes workers")


def _warn(notes: list[str], announce: Log | None) -> None:
    """Give notes as warnings, where nothing is announced to anyone."""
    for note in notes if announce is None else ():
        warn(note, RunWarning)
