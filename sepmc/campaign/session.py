"""Session: runs many designs of one campaign with one kernel and one selection of steps.

A design is a value for each of some parameters, the design variables; all else, the dispersions
too, is as in the campaign. The box is the set of all designs with every variable in its range.
Designs are compared on common random numbers: case k of every design has the same probabilities.
"""

import copy
import time
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property
from typing import Any

import numpy as np
import pandas as pd

from sepmc.analysis import requirements
from sepmc.analysis.row_statistics import TableStatistics
from sepmc.campaign.definition import Definition
from sepmc.campaign.design_box import DesignBox
from sepmc.campaign.execution import batch_summary
from sepmc.campaign.execution.accuracy import (
    AchievedAccuracy,
    with_errors,
    with_scales,
    with_scales_of,
)
from sepmc.campaign.execution.chunk import Chunk
from sepmc.campaign.execution.diagnostics import accuracy_notes
from sepmc.campaign.execution.integration import Integration, integrate
from sepmc.campaign.execution.sinks import case_table, status_labels
from sepmc.campaign.execution.step_selection import select_steps, unpacked
from sepmc.engine.dispatch import Block, check_int, check_threads, compile_wait_s, using_threads
from sepmc.recent_items import RecentItems
from sepmc.scene.limits import CASES
from sepmc.scene.messages import InputError, Log, RunWarning, nearest, shorten, warn
from sepmc.schema import AUDIT_BOUNDS, Status

_ROWS = 16384  # cases of several designs that one call of the kernel integrates
_CODES = {status.label: status for status in Status}

Values = Mapping[str, float] | Sequence[float] | np.ndarray


@dataclass
class _Sample:
    """Sampled inputs of the first n cases of a seed, from which those of any design follow.

    ``base`` (d, n): a row per input column of the box, SI, at the low end of all variables; rows of
    varied parameters without dispersion are 0. ``ends``: for the index of each column that is both
    varied and dispersed, its inputs at the low and at the high end of its variable, each (n,), in
    the unit of the key; those of a design are interpolated linearly between them.
    """

    base: np.ndarray
    ends: dict[int, tuple[np.ndarray, np.ndarray]]


@dataclass
class DesignResult:
    """Cases of one design.

    Attributes
    ----------
    values : dict of str to float
        Values of the design variables, by key of ``vary``.
    inputs : ndarray, shape (n, d)
        Inputs of n cases, SI (in `table` in the units of the columns), in the order of
        ``box.input_columns``.
    block : Block
        Results of the kernel, SI.
    timing : dict of str to float
        Elapsed seconds by stage: sample, compile (of a fallback kernel), kernel.
    box : DesignBox
        Campaign with the varied parameters as dispersed inputs; it has the columns and the
        requirements.
    integration : Integration
        Kernel and steps.
    """

    values: dict[str, float]
    inputs: np.ndarray
    block: Block
    timing: dict[str, float]
    box: DesignBox = field(repr=False)
    integration: Integration = field(repr=False)

    @cached_property
    def table(self) -> dict[str, np.ndarray]:
        """Case table, arrays (n,) by column name, in the units of the columns: case, status (text),
        inputs (the varied parameters too), outcomes and audit columns."""
        chunk = Chunk(0, self.inputs / self.box.factors, self.block, batch_summary.BatchSummary())
        return case_table(self.box, [chunk]) | {"status": status_labels(self.block.status)}

    def to_pandas(self) -> pd.DataFrame:
        """Case table, one row per case; see `Result.to_pandas`.

        Returns
        -------
        DataFrame
        """
        return pd.DataFrame(self.table)

    def column(self, name: str) -> np.ndarray:
        """Values of an outcome or audit column, one per case.

        Parameters
        ----------
        name : str
            Name of the column.

        Returns
        -------
        ndarray, shape (n,)
            In the unit of the column (`sepmc.schema.Column`).

        Raises
        ------
        InputError
            If there is no such column.
        """
        results = self.box.result_columns
        k = _position(self.box, name)
        return np.asarray(self.block.outcomes[:, k] * results[k].scale)

    @property
    def ok(self) -> np.ndarray:
        """Mask (n,) of the cases with status ok."""
        return np.asarray(self.block.status == Status.OK)

    def verdicts(self) -> pd.DataFrame:
        """Verdict and counts of each requirement, in a tenth of the time of `requirements`.

        Returns
        -------
        DataFrame
            A row per requirement, indexed by its name: ``verdict``, ``violations`` and ``missing``
            (unknown cases, which did not finish or do not have the outcome; ``violations``
            includes them), as in
            `sepmc.analysis.requirements.Verdict`.
        """
        rows = _verdicts(self.box, self.accuracy.errors, self.block)
        columns = ["verdict", "violations", "missing"]
        return pd.DataFrame.from_dict(rows, orient="index", columns=columns)

    @cached_property
    def accuracy(self) -> AchievedAccuracy:
        """Largest relative numerical error of each outcome over these and the calibration cases."""
        return _accuracy(self.integration, self.block, self.box)

    @property
    def notes(self) -> list[str]:
        """Note for the user, a list of one, if the accuracy is not met or is unknown; else empty
        (`accuracy_notes`)."""
        return accuracy_notes(self.accuracy, self.integration.step is not None)

    def statistics(self) -> pd.DataFrame:
        """Statistics of every outcome; see `Result.statistics`.

        Returns
        -------
        DataFrame
        """
        table = TableStatistics(self.table, *self.box.summary_inputs).statistics(None)
        return with_errors(self.box, self.accuracy.errors, table)

    def requirements(self) -> pd.DataFrame:
        """Verdicts on the requirements with all their fields; see `Result.requirements`.

        Returns
        -------
        DataFrame
        """
        summary = TableStatistics(self.table, *self.box.summary_inputs)
        errors = with_scales(self.box, self.accuracy.errors, summary.statistics(None))
        sampler = self.box.scene.run.sampler
        return requirements.verdict_table(summary.verdicts(errors, summary.audit(), sampler))


@dataclass
class DesignTable:
    """Cases of many designs.

    Attributes
    ----------
    summary : DataFrame
        A row per design: the values of its variables, by key; ``ok``, the number of ok cases; of
        each requirement its verdict ``NAME``, and the counts ``NAME_violations`` and
        ``NAME_missing`` (`DesignResult.verdicts`); ``error``, the largest relative numerical error
        of an ok case, 0 if no case is ok.
    columns : dict of str to ndarray, shape (designs, cases)
        Requested outcomes and audit columns by name, in their units, and ``status``, the status
        codes (`sepmc.schema.Status`); empty if none was requested.
    timing : dict of str to float
        Elapsed seconds by stage: sample, compile (of a fallback kernel), kernel.
    """

    summary: pd.DataFrame
    columns: dict[str, np.ndarray]
    timing: dict[str, float]


class Session:
    """Runs designs of a campaign with one kernel; made by `Campaign.session`.

    Parameters
    ----------
    campaign : Campaign
    vary : dict
        Range (low, high) of each design variable, by TOML path with its unit, which may have
        wildcards.
    threads : int, optional
        Default: all cores.
    announce : callable (text), optional
        Called with messages.

    Attributes
    ----------
    campaign : Campaign
    box : DesignBox
        Design variables with their ranges.
    integration : Integration
        Kernel and steps, for all designs of the box.
    notes : list of str
        Notes for the user, such as an accuracy that is not met; issued as `RunWarning` if
        ``announce`` is None.
    """

    def __init__(
        self, campaign: Any, vary: Any, threads: int | None = None, announce: Log | None = None
    ):
        self.campaign, self._threads = campaign, check_threads(threads)
        self.box = DesignBox.of(campaign, vary)
        with using_threads(self._threads):
            self.integration = select_steps(self.box, announce=announce)
        self._samples = _no_samples()
        achieved = self.integration.achieved
        assert achieved is not None
        fixed = self.integration.step is not None
        self.notes = [*self.integration.notes, *accuracy_notes(achieved, fixed)]
        if announce is None:
            for note in self.notes:
                warn(note, RunWarning)

    def __repr__(self) -> str:
        ranges = ", ".join(f"{v.key} {v.low:g} to {v.high:g}" for v in self.box.variables)
        return f"<Session of {self.campaign.name}: {ranges}>"

    def __getstate__(self) -> dict[str, Any]:
        """Return the state to pickle for another process; it has no kernels and no samples."""
        without = {"integration": self.integration.packed, "_samples": _no_samples()}
        return {**vars(self), **without}

    def __setstate__(self, state: dict[str, Any]) -> None:
        self.__dict__.update(state)
        self.integration = unpacked(self.box, self.integration, history=False)

    def run(
        self, design: Values, cases: int | None = None, seed: int | None = None
    ) -> DesignResult:
        """Run one design.

        Parameters
        ----------
        design : mapping of str to float, or sequence of float
            Values of the design variables by key of ``vary``, or in its order; in the units of the
            keys.
        cases : int, optional
            Number of cases; that of the file if None.
        seed : int, optional
            That of the file if None. Designs with one seed have common random numbers.

        Returns
        -------
        DesignResult

        Raises
        ------
        InputError
            If a value is missing, unknown or outside the box, or ``cases`` or ``seed`` is out of
            range.
        """
        values = self._design(design)
        start = time.perf_counter()
        sample = self._sample(*self._size(cases, seed))
        width, count = sample.base.shape
        rows = np.empty((width + len(self.box.derived), count))
        rows[:width] = sample.base
        self._write(rows, sample, values)
        timing = {"sample": time.perf_counter() - start, "compile": 0.0, "kernel": 0.0}
        block = self._integrate(rows, timing)
        named = {v.key: float(x) for v, x in zip(self.box.variables, values, strict=True)}
        return DesignResult(named, rows[:width].T, block, timing, self.box, self.integration)

    def run_many(
        self,
        designs: pd.DataFrame | Mapping[str, Sequence[float]] | np.ndarray,
        cases: int | None = None,
        seed: int | None = None,
        columns: Sequence[str] = (),
        progress: Callable[[int, int], None] | None = None,
    ) -> DesignTable:
        """Run many designs, each with the same number of cases and the same seed.

        Parameters
        ----------
        designs : DataFrame, mapping of str to sequence, or ndarray, shape (m, variables)
            A row per design; a column per design variable, by key of ``vary`` or in its order.
        cases, seed : int, optional
            Of every design, as for `run`.
        columns : sequence of str
            Names of outcomes or audit columns to return for every case; each takes 8 bytes per
            design and case.
        progress : callable (done, total), optional
            Called with the number of designs run so far, and of all designs.

        Returns
        -------
        DesignTable

        Raises
        ------
        InputError
            If a design is incomplete or outside the box, ``cases`` or ``seed`` is out of range, or
            there is no such column.
        """
        table = self._designs(designs)
        cases, seed = self._size(cases, seed)
        if isinstance(columns, str):
            raise InputError(f"columns = {columns!r}: must be a list of names, as ['error']")
        positions = {name: _position(self.box, name) for name in columns}
        start = time.perf_counter()
        sample = self._sample(cases, seed)
        width, per_call = len(sample.base), max(1, min(len(table), _ROWS // cases))
        rows = np.empty((width + len(self.box.derived), per_call, cases))
        rows[:width] = sample.base[:, None, :]
        timing = {"sample": time.perf_counter() - start, "compile": 0.0, "kernel": 0.0}
        summaries: list[dict[str, Any]] = []
        kept = {name: np.empty((len(table), cases)) for name in columns}
        if columns:
            kept["status"] = np.empty((len(table), cases), dtype=np.int8)
        for first in range(0, len(table), per_call):
            start = time.perf_counter()
            part = table[first : first + per_call]
            for k, values in enumerate(part):
                self._write(rows[:, k], sample, values)
            # the last call has fewer designs
            inputs = rows if len(part) == per_call else rows[:, : len(part)].copy()
            timing["sample"] += time.perf_counter() - start
            block = self._integrate(inputs.reshape(len(rows), -1), timing)
            errors = _accuracy(self.integration, block, self.box).errors
            summaries += _summarise(self.box, errors, block, cases)
            shape, end = (len(part), cases), first + len(part)
            for name, k in positions.items():
                scale = self.box.result_columns[k].scale
                kept[name][first:end] = block.outcomes[:, k].reshape(shape) * scale
            if columns:
                kept["status"][first:end] = block.status.reshape(shape)
            if progress:
                progress(end, len(table))
        values = pd.DataFrame(table, columns=[v.key for v in self.box.variables])
        summary = pd.concat([values, pd.DataFrame(summaries)], axis=1)
        return DesignTable(summary, kept, timing)

    def with_design(self, design: Values) -> Any:
        """Return the campaign with the values of a design, to replay a case or to run it alone.

        Parameters
        ----------
        design : mapping of str to float, or sequence of float
            As for `run`.

        Returns
        -------
        Campaign
        """
        pairs = zip(self.box.variables, self._design(design), strict=True)
        return self.campaign.with_settings({v.key: float(value) for v, value in pairs})

    def _size(self, cases: int | None, seed: int | None) -> tuple[int, int]:
        """Return (cases, seed), checked; those of the file replace None. Raises InputError if one
        of them is not a whole number in its range."""
        cases = self.campaign.scene.run.cases if cases is None else cases
        return check_int("cases", cases, 1, CASES), self.campaign.checked_seed(seed)

    def _design(self, design: Values) -> np.ndarray:
        """Return the values (variables,) of a design, in the units of the keys. Raises InputError
        if the design is incomplete or outside the box."""
        return self.box.check_designs(_numbers(self.box.values_of(design))[None])[0]

    def _designs(self, designs: Any) -> np.ndarray:
        """Return the values (m, variables) of m designs, in the units of the keys, from a table of
        columns by key (DataFrame or mapping) or an array of this shape, two-dimensional also for
        one design. Raises InputError if a design is incomplete, not finite or outside the box, or a
        column is that of a key that is not varied."""
        if isinstance(designs, pd.DataFrame | Mapping):
            columns = self.box.values_of(dict(designs))
            if len({len(np.atleast_1d(column)) for column in columns}) > 1:
                raise InputError("designs: all columns must have the same number of values")
            designs = np.column_stack([_numbers(column) for column in columns])
        return self.box.check_designs(_numbers(designs))

    def _sample(self, cases: int, seed: int) -> _Sample:
        """Return the sample of the first ``cases`` cases of a seed; the last samples are cached."""
        key = cases, seed
        sample = self._samples.get(key)
        if sample is None:
            low, high = (end.sample(0, cases, seed, cases) for end in self.box.ends[:2])
            width = low.shape[1]
            base = np.zeros((len(self.box.factors), cases))
            base[:width] = (low * self.box.ends[0].factors).T
            varied = [k for k in self.box.variable_of_column if k < width]
            ends = {k: (low[:, k].copy(), high[:, k].copy()) for k in varied}
            sample = _Sample(base, ends)
            self._samples.put(key, sample)
        return sample

    def _write(self, rows: np.ndarray, sample: _Sample, values: np.ndarray) -> None:
        """Write the varied inputs and the derived numbers (`DesignBox.derived`) of a design, SI,
        into ``rows``, which has a row per input or derived number and a column per case; its other
        rows stay as they are. ``sample`` has the inputs at both ends of the design variables;
        ``values`` (variables,) are the design, in the units of its keys."""
        box = self.box
        ranges = [(v.low, v.high - v.low) for v in box.variables]
        shares = [float((x - low) / r) for (low, r), x in zip(ranges, values, strict=True)]
        for k, i in box.variable_of_column.items():
            if k in sample.ends:
                low, high = sample.ends[k]
                np.multiply((1.0 - shares[i]) * low + shares[i] * high, box.factors[k], out=rows[k])
            else:
                rows[k] = values[i] * box.factors[k]
        for k, number in enumerate(box.derived, start=len(box.factors)):
            rows[k] = number.at(shares)

    def _for_kernel(self, rows: np.ndarray) -> np.ndarray:
        """Return the inputs ``rows`` (d, n), SI, with NaN in invalid cases, which a kernel skips
        (as `Definition.in_si`): a copy, or ``rows`` itself if all cases are valid.

        A case is invalid if an input is out of the bounds of its parameter, which is then NaN, or
        if a load does not end after its start (`Definition.ends_before_start`): all its dispersed
        inputs are then NaN. One NaN suffices for a kernel to skip the case."""
        factors, laws = self.box.factors, self.box.ends[0].file.dispersions
        masks = {
            k: ~law.allowed(rows[k] / factors[k]) for k, law in enumerate(laws) if law.has_tails
        }
        early = self.box.ends_before_start(rows[: len(factors)].T)
        if not early.any() and not any(mask.any() for mask in masks.values()):
            return rows
        rows = rows.copy()
        for k, mask in masks.items():
            rows[k, mask] = np.nan
        rows[: len(factors), early] = np.nan
        return rows

    def _integrate(self, rows: np.ndarray, timing: dict[str, float]) -> Block:
        """Integrate n cases of inputs ``rows`` (d, n), SI; add the seconds spent to ``timing``."""
        start, waited = time.perf_counter(), compile_wait_s()
        with using_threads(self._threads):
            block = integrate(self._runs, self.integration, self._for_kernel(rows).T)
        waited = compile_wait_s() - waited
        timing["compile"] += waited
        timing["kernel"] += time.perf_counter() - start - waited
        return block

    @property
    def _runs(self) -> Definition:
        """New copy of `box`, at every access, in which the derived numbers (`DesignBox.derived`)
        are inputs of the kernel too."""
        runs = copy.copy(self.box)
        runs.__dict__["slots"] = self.box.slots_with_derived
        return runs


def _accuracy(integration: Integration, block: Block, box: Definition) -> AchievedAccuracy:
    """Return the largest relative numerical error of each outcome over the cases of a block and
    the calibration cases of ``integration``; ``box`` is the campaign of both."""
    return batch_summary.accuracy(integration, batch_summary.count_errors(box, block))


def _position(box: Definition, name: str) -> int:
    """Return the index of an outcome or audit column in ``box.result_columns``. Raises InputError
    if there is none of this name."""
    names = [column.name for column in box.result_columns]
    if name not in names:
        raise InputError(f"{name}: no such outcome; {nearest(name, names)}")
    return names.index(name)


def _no_samples() -> RecentItems[tuple[int, int], _Sample]:
    """Return an empty cache of the four samples used last, by (number of cases, seed)."""
    return RecentItems(4)


def _numbers(values: Any) -> np.ndarray:
    """Return values of designs as an array of floats. Raises InputError unless all are finite
    numbers."""
    try:
        if np.iscomplexobj(values):
            raise TypeError
        array = np.asarray(values, dtype=float)
    except (TypeError, ValueError):
        raise InputError(f"design = {shorten(values)}: must be numbers") from None
    if not np.isfinite(array).all():
        raise InputError(f"design = {shorten(values)}: must be finite numbers")
    return array


def _verdicts(
    box: Definition, errors: Mapping[str, float], block: Block
) -> dict[str, tuple[str, int, int]]:
    """Judge each requirement by the cases of one design.

    Parameters
    ----------
    box : Definition
        Campaign with the requirements.
    errors : mapping of str to float
        Relative numerical error by outcome.
    block : Block
        Cases of the design.

    Returns
    -------
    dict of str to (str, int, int)
        By name of the requirement: verdict, number of violations, and number of those violations
        that are unknown cases, which did not finish or do not have the outcome.
    """
    if not box.file.requirements:
        return {}
    columns = {column.name: k for k, column in enumerate(box.result_columns)}
    is_ok = np.asarray(block.status == Status.OK)

    def values(name: str) -> np.ndarray | None:
        k = columns.get(name)
        return None if k is None else block.outcomes[:, k] * box.result_columns[k].scale

    counters = requirements.requirement_counters(box.file.requirements)
    requirements.count_cases(
        counters,
        np.arange(len(is_ok)),
        is_ok,
        values,
        lambda name: np.asarray(block.status == _CODES.get(name, -1)),
    )
    reason = requirements.no_verdict_reason(_audit_failed(box, block, is_ok), box.scene.run.sampler)
    metrics = {item.metric for item in box.file.requirements}
    scaled = {}
    if is_ok.any():
        scaled = with_scales_of(box, errors, _outcomes(box, block, is_ok), metrics)
    return {
        one.requirement.name: (
            requirements.brief_verdict(one, scaled, reason),
            one.violations,
            one.missing,
        )
        for one in counters
    }


def _outcomes(box: Definition, block: Block, is_ok: np.ndarray) -> np.ndarray:
    """Return the outcomes (ok cases, o) of a block in the units of their columns, which are those
    of the campaign ``box``; ``is_ok`` (n,) is the mask of the ok cases."""
    columns = box.outcome_columns
    return block.outcomes[is_ok, : len(columns)] * np.array([column.scale for column in columns])


def _audit_failed(box: Definition, block: Block, is_ok: np.ndarray) -> bool:
    """Return True if in any ok case of a block (mask ``is_ok``, (n,)) an audit column is above its
    bound in `AUDIT_BOUNDS`, or NaN; ``box`` is the campaign, which has the columns."""
    audited = [
        (k, column.scale, AUDIT_BOUNDS[column.name])
        for k, column in enumerate(box.result_columns)
        if column.name in AUDIT_BOUNDS
    ]
    columns, sizes, bounds = (np.array(each) for each in zip(*audited, strict=True))
    passes = block.outcomes[:, columns] * sizes <= bounds
    return not bool((passes | ~is_ok[:, None]).all())


def _part(block: Block, first: int, end: int) -> Block:
    """Return cases ``first`` to ``end`` - 1 of a block as a block, whose arrays are views. Its
    ``refinement`` is still that of the whole block."""
    cases = slice(first, end)
    fields = ("outcomes", "status", "times", "history", "rows")
    part = replace(block, **{name: getattr(block, name)[cases] for name in fields})
    part.indicators = None if block.indicators is None else block.indicators[cases]
    return part


def _summarise(
    box: Definition, errors: Mapping[str, float], block: Block, cases: int
) -> list[dict[str, Any]]:
    """Return the rows of `DesignTable.summary` (number of ok cases, verdicts with their counts,
    largest error), without the values of the designs, from a block that has the cases of one
    design after the other, ``cases`` each. ``box`` is the campaign with the requirements.
    ``errors`` are the relative numerical errors by outcome, which the verdicts take into
    account."""
    rows = []
    for first in range(0, len(block.status), cases):
        part = _part(block, first, first + cases)
        is_ok = part.status == Status.OK
        row: dict[str, Any] = {"ok": int(np.count_nonzero(is_ok))}
        for name, (verdict, violations, missing) in _verdicts(box, errors, part).items():
            row |= {name: verdict, f"{name}_violations": violations, f"{name}_missing": missing}
        rows.append(row | {"error": float(part.error[is_ok].max(initial=0.0))})
    return rows
