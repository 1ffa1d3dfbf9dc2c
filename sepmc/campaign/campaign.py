"""Python interface: load a campaign, run it, simulate single cases and estimate rare events."""

from collections.abc import Iterable, Mapping
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
from sepmc.campaign.session import Session
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
from sepmc.formats.files import read_files
from sepmc.paths import as_path
from sepmc.scene.campaign_files import find_file
from sepmc.scene.contents import contents
from sepmc.scene.fields import convert
from sepmc.scene.limits import CASES
from sepmc.scene.load_checks import SHORTEST
from sepmc.scene.messages import InputError, Log, Problems, RunWarning, warn
from sepmc.scene.read import parse_campaign, read_campaign
from sepmc.scene.scenarios import Scenario, scenario_tree
from sepmc.scene.symbols import Function, with_load
from sepmc.wording import count_cases


def load(
    path: str | Path, settings: dict[str, Any] | None = None, verify: bool = True
) -> "Campaign":
    """Read a campaign from its file, from a run folder, or by the name of a shipped one.

    Parameters
    ----------
    path : str or Path
        Campaign file, run folder, or name of a shipped campaign.
    settings : dict, optional
        Values that replace those of the file, by TOML path: ``{"solver.formulation": "full"}``.
    verify : bool
        For a run folder: check that its manifest, campaign file and sample table are unchanged.

    Returns
    -------
    Campaign

    Raises
    ------
    SceneError
        If there is no such file, folder or shipped campaign, or the file has errors; the message
        lists each with the path of its key.
    StoreError
        If the run folder has the format of another version of sepmc, or contains links, or
        ``verify`` finds that it was changed.
    """
    file = find_file(path)
    flown_settings: dict[str, str] = {}  # settings of the run
    if file.name == folders.CAMPAIGN and folders.is_run(file.parent):
        if verify:
            manifests.read_manifest(file.parent)
        flown_settings = manifests.read_provenance(file.parent).get("settings", {})
    read = read_campaign(path, settings, read_input_table, read_files)
    return Campaign(read, flown_settings | as_text(settings or {}))


class _NoCopyDict(dict[str, Any]):
    """Dict whose deep copy is the dict itself; used in the ``attrs`` of history tables.

    pandas deep-copies ``attrs`` for every column that is taken from a table, which is slow.
    """

    def __deepcopy__(self, memo: dict[int, Any]) -> "_NoCopyDict":
        return self


class Campaign(Definition):
    """A campaign: scene, dispersions and run settings, with the methods that run it.

    `load` makes one from a file.

    Parameters
    ----------
    file : CampaignFile
        Parsed campaign file.
    settings : mapping of str to str, optional
        Values by TOML path, as text, that ``file`` already has in place of those of the file on
        disk; used only to show and store them.
    """

    def __repr__(self) -> str:
        scene = self.scene
        return (
            f"<Campaign {self.name}: {len(scene.body)} bodies, {len(scene.joint)} joints, "
            f"{len(scene.phase)} phases; {len(self.file.dispersions)} dispersed parameters, "
            f"{count_cases(self.numbers.count)}, seed {scene.run.seed}>"
        )

    def with_settings(self, settings: dict[str, Any]) -> "Campaign":
        """Return a copy of the campaign with some values of its file replaced.

        Parameters
        ----------
        settings : dict
            New values by TOML path: ``{"body.upper.mass_kg": 460.0}``.

        Returns
        -------
        Campaign

        Raises
        ------
        SceneError
            If a path or value is not valid.
        """
        tree, folder, name = self.file.tree, self.file.folder, self.name
        read = parse_campaign(tree, name, settings, name, folder, read_input_table, read_files)
        return Campaign(read, self.settings | as_text(settings or {}))

    def scenarios(self) -> dict[str, "Campaign"]:
        """Return one campaign for each ``[[scenario]]`` of the file, by name of the scenario.

        A parameter that a scenario sets is constant in its campaign. All other parameters are
        dispersed as in this campaign, with the same random numbers.

        Returns
        -------
        dict of str to Campaign

        Raises
        ------
        SceneError
            If the campaign of a scenario is not valid.
        """
        return {one.name: self._scenario(one) for one in self.file.scenarios}

    def _scenario(self, scenario: Scenario) -> "Campaign":
        """Return this campaign with the settings of a scenario. Raises SceneError if the result is
        no valid campaign."""
        problems = Problems()
        table = self.file.input_table
        tree = scenario_tree(self.file.tree, self.scene, scenario, problems, table)
        source, folder = f"{self.name}, scenario {scenario.name}", self.file.folder
        problems.raise_if_any(source)
        read = parse_campaign(tree, source, {}, self.name, folder, read_input_table, read_files)
        return Campaign(read, self.settings | as_text(scenario.settings))

    def with_load(
        self,
        name: str,
        function: Function,
        body: str,
        frame: str = "body",
        point_m: tuple[float, float, float] | None = None,
    ) -> "Campaign":
        """Return the campaign with one more load, whose force a Python function defines.

        The function is called once, with symbols in place of numbers. The expressions that it
        returns become formulas (``[[signal]]``) of the campaign.

        Parameters
        ----------
        name : str
            Name of the load; its signals are ``NAME_force_x``, ...
        function : callable
            ``function(q)`` returns three components of the force, N, or a pair of them and three of
            the moment, N m; each a number or computed from quantities such as
            ``q.upper.pitch_rad`` with operators and functions of numpy.
        body : str
            Body that the load acts on.
        frame : str
            Axes of the components: "body" or "ground".
        point_m : tuple of 3 float, optional
            Layout point of the force; the centre of mass if None.

        Returns
        -------
        Campaign

        Raises
        ------
        InputError
            If the function cannot be turned into formulas.
        SceneError
            If the campaign is not valid with this load.
        """
        load: dict[str, Any] = {"name": name, "body": body, "frame": frame}
        load |= {} if point_m is None else {"point_m": list(point_m)}
        tree, folder = with_load(self.file.tree, load, function), self.file.folder
        read = parse_campaign(
            tree, self.name, None, self.name, folder, read_input_table, read_files
        )
        return Campaign(read, self.settings)

    def session(
        self,
        vary: Mapping[str, tuple[float, float]],
        threads: int | None = None,
        announce: Log | None = None,
    ) -> Session:
        """Make a session, which runs many designs with one kernel and one selection of steps.

        A design is a value for each design variable; all else is as in the campaign. The steps are
        selected at once, for all designs within the ranges.

        Parameters
        ----------
        vary : mapping of str to (float, float)
            Lowest and highest value of each design variable, by TOML path with its unit. ``*``
            stands for any name: ``{"spring.*.force_N": (400.0, 1600.0)}``.
        threads : int, optional
            As for `run`.
        announce : callable (text), optional
            Called with messages, such as on the compilation of a kernel. If None, the session's
            notes are issued as `sepmc.RunWarning`.

        Returns
        -------
        Session

        Raises
        ------
        InputError, SceneError
            If a path of ``vary`` names no number of the scene, a range does not rise, the designs
            cannot share a kernel, or ``threads`` is out of range.
        """
        return Session(self, vary, threads, announce)

    def simulate(
        self,
        case: Case | int | None = None,
        step_s: float = 0.001,
        announce: Log | None = None,
        plain_work: float | None = None,
    ) -> pd.DataFrame:
        """Simulate one case, and return its history over time.

        If the file gives ``solver.step_s``, that is the integration step. Otherwise steps are
        halved until two halvings in a row change no outcome by more than ``solver.accuracy``; a
        case that does not converge within the allowed work gets a note. The kernel runs in plain
        Python, or is compiled if plain Python would take more than about ten seconds. Outcomes
        agree with the row of this case in a run to within the accuracy. A case with a sampled value
        that the model does not allow is not simulated: its status is invalid-input, its outcomes
        are NaN, its history has no rows, and a note gives the value.

        Parameters
        ----------
        case : Case or int, optional
            A case number; or a `Case`, which is simulated with its own ``scene``. The nominal case
            if None.
        step_s : float
            Interval of history rows, s; there are also two rows at each phase boundary.
        announce : callable (text), optional
            Called with messages, such as on the compilation of a kernel. Notes are only in
            ``attrs`` then; if None, they are also issued as `sepmc.RunWarning`.
        plain_work : float, optional
            Maximum number of kernel lines that plain Python may execute (1e7 take 5 s). If given,
            no kernel is compiled.

        Returns
        -------
        DataFrame
            Columns time_s, phase and those of `sepmc.schema.history_columns`. Its ``attrs``:
            ``units`` of its columns; ``outcomes`` and audit columns, by name; ``errors``, the
            relative numerical error of each outcome (twice its change at half of a given step,
            else its change at the last halving), empty if unknown; ``status``; ``compiled``, True
            if the kernel was compiled; ``notes``; and times, s, NaN if not reached: ``releases`` by
            joint, ``partial_releases`` by ``JOINT.KIND``, ``events`` by name, and ``springs``, the
            ends of spring strokes, by name.

        Raises
        ------
        InputError
            If there is no case of this number, a `Case` is of a campaign with other columns, or
            ``step_s`` is out of range.
        UnknownError
            If ``plain_work`` is too small for a result.
        """
        check_history_step(step_s, self.scene)
        if isinstance(case, Case):
            if contents(case.scene, self.dispersed) != self.layout.contents:
                message = (
                    "must be a case of this campaign, made by campaign.case(NUMBER); its scene has "
                    "other result columns"
                )
                raise InputError(f"case = {case!r}: {message}")
        elif case is not None:
            case = self.case(check_int("case", case, 0, CASES - 1))
        scene, invalid = (case or self.nominal()).scene, self._invalid_values(case)
        if invalid:
            scene = self.nominal().scene
            result = invalid_case(scene, self.layout.contents)
        else:
            result = simulate_case(scene, self.layout.contents, step_s, announce, plain_work)
        columns = schema.history_columns(result.layout.contents)
        data: dict[str, Any] = {
            "time_s": result.times,
            "phase": [result.layout.phases[p] for p in result.phases],
        }
        data |= {c.name: result.rows[:, i] * c.scale for i, c in enumerate(columns)}
        frame = pd.DataFrame(data)
        results = schema.result_columns(result.layout.contents)
        outcomes = {
            c.name: float(x * c.scale) for c, x in zip(results, result.outcomes, strict=True)
        }
        releases = schema.release_columns(result.layout.contents)
        events = schema.event_columns(result.layout.contents)
        springs = schema.stroke_columns(result.layout.contents)
        partial = schema.partial_release_columns(result.layout.contents)
        which = "the nominal case" if case is None or case.number < 0 else f"case {case.number}"
        errors = (
            () if result.error is None else zip(self.outcome_columns, result.error, strict=True)
        )
        notes = invalid + result.notes + reversed_joints(scene, outcomes, which)
        _warn(notes, announce)
        frame.attrs = {
            "units": _NoCopyDict({"time_s": "s", "phase": "", **{c.name: c.unit for c in columns}}),
            "outcomes": _NoCopyDict(outcomes),
            "errors": _NoCopyDict({c.name: float(x) for c, x in errors}),
            "status": result.status.label,
            "compiled": result.compiled,
            "notes": notes,
            "releases": _NoCopyDict({j: outcomes[c] for j, c in releases.items()}),
            "partial_releases": _NoCopyDict(
                {f"{joint}.{kind}": outcomes[c] for (joint, kind), c in partial.items()}
            ),
            "events": _NoCopyDict({e: outcomes[c] for e, c in events.items()}),
            "springs": _NoCopyDict({s: outcomes[c] for s, c in springs.items()}),
        }
        return frame

    def _invalid_values(self, case: Case | None) -> list[str]:
        """Return a message for each sampled value of a case that the model does not allow, and for
        each load that ends before it starts; empty for a valid or nominal (None) case."""
        reasons = []
        for dispersion in self.file.dispersions:
            parameter, field = dispersion.parameter, dispersion.parameter.field
            value = (case.inputs if case else {}).get(parameter.column)
            if value is not None and field is not None and dispersion.has_tails:
                reason = convert(value * parameter.factor, field.type)[1]
                reasons += [f"{parameter.key} = {value:g}: {reason}"] if reason else []
        for load in case.scene.load if case else ():
            if load.end - load.start <= SHORTEST:
                reasons.append(
                    f"load.{load.name}.end_s = {load.end:g}: must be > start_s = {load.start:g}"
                )
        return reasons

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
        """Run the campaign: simulate its cases and evaluate their outcomes.

        Parameters
        ----------
        cases : int, str or iterable of int, optional
            Number of cases; or case numbers, as integers or as text, ``"25:50,73"`` (25 to 49, and
            73). Default: those of the sample table, else the first ``run.cases``.
        seed : int, optional
            Default: the seed of the file.
        threads : int, optional
            Number of threads. Default: all cores. The result does not depend on it.
        out : path, optional
            Run folder to write; rows are read from there on demand. If None, all rows stay in
            memory.
        options : RunOptions, optional
            All other options.
        **fields
            Fields of `RunOptions` by name, in place of those of ``options``:
            ``run(out="runs/a", resume=True)``.

        Returns
        -------
        Result

        Raises
        ------
        StoreError
            If ``out`` cannot be used as requested.
        ValueError
            If cases, seed, threads or an option is out of range.
        TypeError
            If ``fields`` has a name that is no field of `RunOptions`.

        Notes
        -----
        An interrupted run (Ctrl-C) with ``out`` stores all finished chunks of cases, and
        ``resume=True`` runs the missing cases in the mode in which the run began. A run that stores
        only statistics saves its state every ten seconds. A run resumed with the same stopping rule
        ``until`` stops at the same case; with a narrower tolerance it continues from the known
        statistic; without a rule it follows the rule it began with.
        """
        options = replace(options or RunOptions(), **fields)
        stats_only, until, resume = options.stats_only, options.until, options.resume
        if resume and cases is None and out is not None:
            cases = previous_run.own_cases(self, as_path(out))
        numbers, total = self.select_cases(cases)
        seed = self.checked_seed(seed)
        threads = check_threads(threads)
        if options.max_failures is not None:
            check_int("max_failures", options.max_failures, 0)
        keep = self._keep(options, out)
        if resume and out is not None:
            stats_only, keep, until = previous_run.original_mode(
                as_path(out), stats_only, keep, until
            )
        stop = None if until is None else self.until(until, numbers)
        is_counted_selection = (stats_only or bool(keep)) and not numbers.are_first
        _check_executor(options.executor, out, until, is_counted_selection)
        execution = ExecutionOptions(
            threads,
            options.executor,
            stop,
            options.max_failures,
            stats_only or keep is not None,
            keep,
            options.calibration,
            options.progress,
            options.announce,
        )
        context = (
            nullcontext()
            if out is None
            else folders.opened(as_path(out), options.overwrite, resume)
        )
        with using_threads(threads), context as folder:
            return self._run(folder, SampleSpec(seed, numbers, total), resume, execution)

    def _run(
        self, folder: Path | None, spec: SampleSpec, resume: bool, options: ExecutionOptions
    ) -> Result:
        """Run the cases of ``spec`` into ``folder``, which is open for writing, or in memory if it
        is None; ``options`` are those of `run`, checked. With ``resume``, run only the cases that
        the folder does not contain yet; it has no effect without a folder. Raises StoreError if the
        run in the folder cannot be resumed, or a file cannot be written."""
        seed, numbers = spec.seed, spec.numbers
        stats_only, announce, executor, stop = (
            options.stats_only,
            options.announce,
            options.executor,
            options.until,
        )
        previous, remaining = (
            previous_run.read_previous(self, folder, spec, stats_only, announce)
            if folder and resume
            else (PreviousRun(), numbers)
        )
        n_left = remaining.count
        if announce:
            announce(
                f"{self.name}: {self.file.title or 'no title'}; {count_cases(numbers.count)}, "
                f"seed {seed}" + (f", into {folder}" if folder else "")
            )
        keep = options.keep
        if folder and (not stats_only or (keep and ALL in keep.rules)):
            with_histories = self.has_histories and not stats_only
            forecast(self, n_left, with_histories, keep).check_disk(folder)
        timing = dict.fromkeys(("text", "compile", "steps", "sample", "kernel", "write"), 0.0)
        flight = select_steps(
            self,
            self.scene.run.history_step > 0.0 and not stats_only,
            announce,
            options.calibration,
            timing,
        )
        if announce and previous.n_stored:
            announce(f"{folder}: {previous.n_stored} cases are stored, {n_left} are left to run")
        runner = Runner(self, flight, spec, timing, previous, folder, options)
        if folder:
            if self.file.input_table:
                shards.write_input_table(folder, self.file.input_table, self.input_columns)
            runner.write_manifest(complete=False)
        try:
            with runner:
                if options.progress:
                    options.progress(0, n_left, 0)

                def report() -> None:
                    if options.progress:
                        options.progress(runner.n_run, n_left, runner.failures)

                if executor:
                    runner.run_on(executor, remaining, report)
                stages = [numbers]
                if stop:
                    stages = list(numbers.doubling(stop.first(self.rare_values)))
                for stage in [] if executor else stages:
                    for first, end in remaining.within(stage).split(runner.size):
                        if not runner.too_many_failed:
                            runner.run(first, end, report)
                    if stop and runner.statistic_is_known(stop, stage.end, len(stages)):
                        break
                runner.finish()
        finally:
            if folder:
                runner.save()
                runner.write_manifest(complete=runner.n_stored == runner.n_wanted)
        output = runner.output()
        statistics = run_statistics.write(folder, self, output.summary) if folder else None
        notes = [*runner.notes, *thread_notes(options.threads)]
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
            resumed=previous.n_stored,
            stopped=runner.too_many_failed,
            written=statistics,
        )

    def _keep(self, options: RunOptions, out: Any) -> KeepRules | None:
        """Return the parsed rules of ``options.keep``, which select the case rows to store beside
        statistics; None if it is None. Raises InputError if the rules or the options that depend
        on them are not valid, or there is no run folder ``out`` to store rows in."""
        keep, columns = options.keep, options.keep_columns
        if keep is None:
            if columns is not None or options.float32:
                raise InputError(
                    "keep_columns, float32: apply only to rows that keep selects; give keep too"
                )
            return None
        if out is None:
            raise InputError(f"keep = {keep}: rows are stored in a folder; give its path as out")
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
        """Estimate the probability of a requirement violation that is too rare to count, by subset
        simulation.

        See `sepmc.analysis.subset_simulation`.

        Parameters
        ----------
        requirement : str
            Name of a requirement on a numeric outcome or on contact.
        most : int
            Maximum number of cases, 1e4 to 1e7. 1e5 cases give a probability of 1e-6 to within 25 %
            (95 % confidence).
        seed, out, threads, overwrite, progress, announce
            As for `run`.
        resume : bool
            Continue an interrupted estimate in ``out``; the result is the same as without the
            interruption.

        Returns
        -------
        RareEventEstimate

        Raises
        ------
        StoreError, ValueError
            If ``out`` cannot be used or is missing with ``resume``, there is no such requirement,
            no margin measures how far a case is from violating it, inputs come from a sample
            table, or a number is out of range.
        """
        check_threads(threads)
        limit_state(self, check_text("requirement", requirement, "a name"))
        if resume and out is None:
            raise InputError("resume: needs out, the folder of the estimate")
        context = nullcontext() if out is None else folders.opened(as_path(out), overwrite, resume)
        with using_threads(threads), context as folder:
            estimate = estimate_rare_event(
                self, requirement, most, seed, threads, folder, progress, announce, resume
            )
        estimate.notes.extend(thread_notes(threads))
        _warn(estimate.notes, announce)
        return estimate

    def until(self, text: str, numbers: CaseSelection) -> StoppingRule:
        """Parse a stopping rule, and check that it can stop a run of the given cases.

        Parameters
        ----------
        text : str
            ``METRIC:TOLERANCE``, as ``until`` of `RunOptions`.
        numbers : CaseSelection
            Cases of the run to be stopped.

        Returns
        -------
        StoppingRule

        Raises
        ------
        InputError
            If the text is no stopping rule for an outcome or status of this campaign, the sampler
            or the selection of cases allows no early stop, or the cases are too few for the rule.
        """
        check_text("until", text, "separation_speed_m_s:0.01")
        rule = parse_stopping_rule(text, [column.name for column in self.outcome_columns])
        if not numbers.are_first or self.scene.run.sampler in SIZE_DEPENDENT:
            sampler = self.scene.run.sampler
            reason = f"run.sampler = {sampler!r}, whose cases depend on their number; use random"
            reason = reason if numbers.are_first else "selected case numbers; give a count of cases"
            raise InputError(f"until = {text}: cannot be combined with {reason}")
        rule.check(self.rare_values, numbers.count)
        return rule


def _check_executor(
    executor: Executor | None, out: Any, until: str | None, is_counted_selection: bool
) -> None:
    """Raise InputError if worker processes (``executor``) are given but cannot run the cases.

    They need a run folder ``out`` and no stopping rule ``until``. ``is_counted_selection`` is True
    for a run that stores statistics of selected case numbers, which they cannot run either.
    """
    if executor is None:
        return
    if out is None:
        raise InputError("executor: its workers write into a run folder; give its path as out")
    if until is not None:
        raise InputError(
            f"until = {until}: cannot be combined with workers, which run cases before it is known "
            "whether they are needed"
        )
    if is_counted_selection:
        message = "cannot be combined with workers for selected case numbers; give a count of cases"
        raise InputError(f"stats_only, keep: {message}")


def _warn(notes: list[str], announce: Log | None) -> None:
    """Issue each note as a `RunWarning` if ``announce`` is None; otherwise do nothing, as the notes
    are part of the result."""
    for note in notes if announce is None else ():
        warn(note, RunWarning)
