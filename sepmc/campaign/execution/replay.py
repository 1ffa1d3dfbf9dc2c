"""Replay of one case of a run: choice of the case, comparison of its row with the stored one."""

from dataclasses import dataclass
from pathlib import Path

import numpy as np

from sepmc.analysis.requirements_text import render_missing
from sepmc.analysis.row_statistics import TableStatistics
from sepmc.analysis.statistics import column, ok_rows
from sepmc.analysis.streaming import StreamingStatistics
from sepmc.campaign.definition import Definition
from sepmc.campaign.execution.integration import Integration, history_rows, integrate
from sepmc.campaign.execution.step_selection import kernel_text, select_steps, units_to_compile
from sepmc.campaign.store import shards
from sepmc.scene.messages import InputError, Log, nearest
from sepmc.schema import Status


@dataclass(frozen=True)
class RowComparison:
    """Result of the comparison of a stored row of a run with the same case run again alone.

    Attributes
    ----------
    number : int
        Case number, from 0.
    was_run : bool
        False if the case was not run again, as the campaign's kernel is not in the cache of
        compiled kernels.
    columns : tuple of str
        Names of the columns whose values differ in any bit, and ``status`` if it differs; empty if
        the rows are the same.
    """

    number: int
    was_run: bool
    columns: tuple[str, ...] = ()

    @property
    def sentence(self) -> str:
        """Result of the comparison in words, for the user: the row was not run again, is the same
        bit by bit, or differs in columns, of which up to three are named without their values."""
        if not self.was_run:
            return "its row was not run again: the campaign's kernel is not compiled here"
        if not self.columns:
            return f"run again by the campaign's kernel, row {self.number} is the same bit by bit"
        some = ", ".join(self.columns[:3]) + (", ..." if len(self.columns) > 3 else "")
        return (
            f"run again by the campaign's kernel, row {self.number} differs in "
            f"{len(self.columns)} columns: {some}"
        )


def earlier_integration(campaign: Definition, log: Log | None = None) -> Integration | None:
    """Kernel and steps that the run of a campaign used, selected again by its calibration; None if
    the kernel is not in the cache of compiled kernels, so that nothing is compiled here. ``log``
    receives messages on calibration."""
    history = campaign.has_histories
    if units_to_compile(kernel_text(campaign, history=history))[0]:
        return None
    return select_steps(campaign, history=history, announce=log)


def compare_row(
    campaign: Definition,
    integration: Integration | None,
    folder: Path,
    number: int,
    seed: int,
    total: int,
) -> RowComparison:
    """Run a case again as its campaign did, and compare its row with the one stored in the folder.

    Parameters
    ----------
    campaign : Definition
    integration : Integration or None
        Result of `earlier_integration`; if None, the case is not run and no row is read: the result
        has ``was_run`` False.
    folder : Path
        Run folder with the row.
    number, seed, total : int
        Case number, seed of the run, and number of cases of the sample that it belongs to.

    Returns
    -------
    RowComparison

    Raises
    ------
    StoreError
        If the row is not stored, or its shard is damaged.
    """
    if integration is None:
        return RowComparison(number, was_run=False)
    inputs = campaign.sample(number, 1, seed, total)
    history_size = history_rows(campaign.scene) if campaign.has_histories else 0
    block = integrate(campaign, integration, campaign.in_si(inputs), history_size)
    scales = np.array([c.scale for c in campaign.result_columns])
    own_values = {c.name: x for c, x in zip(campaign.input_columns, inputs[0], strict=True)}
    results = block.outcomes[0] * scales
    own_values |= {c.name: x for c, x in zip(campaign.result_columns, results, strict=True)}
    row = shards.read_row(folder, number)
    # a run by an earlier version may lack a column
    different = [
        name for name, x in own_values.items() if name in row and not _same_bits(x, row[name])
    ]
    if row.get("status") != Status(int(block.status[0])).label:
        different.insert(0, "status")
    return RowComparison(number, True, tuple(different))


def _same_bits(a: float, b: float) -> bool:
    return np.float64(a).tobytes() == np.float64(b).tobytes() or (np.isnan(a) and np.isnan(b))


def extreme_case(cases: shards.CaseColumns, outcome: str, minimum: bool) -> int:
    """Number of the ok case with the smallest value of an outcome (``minimum`` True) or the largest
    (False). ``outcome`` may also be an input or audit column. Raises InputError if there is no
    such column or no ok case has a value in it."""
    numbers, values = _values(cases, outcome)
    return int(numbers[values.argmin() if minimum else values.argmax()])


def nearest_case(cases: shards.CaseColumns, query: str) -> tuple[int, str]:
    """Number of the ok case whose outcome is nearest to a target value, and the text ``OUTCOME =
    TARGET``.

    ``query`` is ``OUTCOME:p99.73`` (a percentile), ``OUTCOME:mean`` or ``OUTCOME:12.5``. Raises
    InputError for any other text, or if there is no such outcome or no ok case has a value of it.
    """
    outcome, colon, point = query.rpartition(":")
    if not colon:
        raise InputError(f"nearest = {query}: must be OUTCOME:p99.73, OUTCOME:mean or OUTCOME:12.5")
    numbers, values = _values(cases, outcome)
    try:
        if point == "mean":
            target = float(values.mean())
        elif point.startswith("p"):
            percent = float(point[1:])
            if not 0.0 <= percent <= 100.0:
                raise ValueError
            target = float(np.percentile(values, percent))
        else:
            target = float(point)
    except ValueError:
        raise InputError(
            f"nearest = {query}: {point!r} must be a percentile from p0 to p100, mean or a value"
        ) from None
    return int(numbers[np.abs(values - target).argmin()]), f"{outcome} = {target:.6g}"


def worst_case(
    summary: TableStatistics | StreamingStatistics, campaign: Definition, errors: dict, query: str
) -> tuple[int, str]:
    """Worst case of a requirement: the ok case with the smallest margin.

    If the requirement is on a 1-or-0 outcome, a status or violations, or no case has its outcome,
    it is the first case that violates it, or else the first one whose result is unknown.

    Parameters
    ----------
    summary : TableStatistics or StreamingStatistics
        Statistics of the run.
    campaign : Definition
    errors : dict of str to (float, float)
        Relative error and scale by outcome; see `sepmc.campaign.execution.accuracy.with_scales`.
    query : str
        Name or metric of the requirement.

    Returns
    -------
    (int, str)
        Number of the case, and the reason of the choice as the end of a sentence, such as "is the
        worst of NAME".

    Raises
    ------
    InputError
        If no requirement has this name or metric, or there is no such case.
    """
    names = [name for item in campaign.file.requirements for name in (item.name, item.metric)]
    audited, sampler = summary.audit(), campaign.scene.run.sampler
    for verdict in summary.verdicts(errors, audited, sampler):
        if query in (verdict.name, verdict.metric):
            if verdict.worst_case is None:
                raise InputError(f"worst = {query}: no case violates {verdict.name}")
            if verdict.worst is None:
                text = f"is the first of {verdict.violations} that violate {verdict.name}"
            else:
                text = f"is the worst of {verdict.name}"
                if verdict.missing:
                    text += f" of those with the outcome; {render_missing(verdict)}"
            return int(verdict.worst_case), text
    advice = "; without a requirement, ask for the min or max of an outcome"
    raise InputError(f"worst = {query}: no such requirement; {nearest(query, names)}{advice}")


def _values(cases: shards.CaseColumns, outcome: str) -> tuple[np.ndarray, np.ndarray]:
    """Case numbers (n,) and values (n,) of a column (outcome, input or audit column), of the ok
    cases in which it is finite. Raises InputError if there is no such column or no such case."""
    names = [name for name in cases if name not in ("case", "status")]
    if outcome not in names:
        raise InputError(f"{outcome}: no such outcome; {nearest(outcome, names)}")
    values = column(cases, outcome)
    is_valid = ok_rows(cases) & np.isfinite(values)
    if not is_valid.any():
        raise InputError(f"{cases.folder}: no ok case has {outcome}")
    return np.asarray(cases["case"])[is_valid], values[is_valid]
