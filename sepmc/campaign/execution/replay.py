"""A case of a run flown once more: which one, and whether its row comes out again to the last
bit."""

from dataclasses import dataclass
from pathlib import Path

import numpy as np

from sepmc.analysis.row_statistics import Rows
from sepmc.analysis.statistics import column, ok_rows
from sepmc.analysis.streaming import Stream
from sepmc.campaign.definition import Definition
from sepmc.campaign.execution.integration import Integration, fly, history_rows
from sepmc.campaign.execution.step_selection import kernel_text, left_to_compile, select_steps
from sepmc.campaign.store import shards
from sepmc.scene.messages import InputError, Log, nearest
from sepmc.schema import Status


@dataclass(frozen=True)
class RowComparison:
    """A row of a run beside the same case flown alone by its compiled kernel: names of the
    ``columns`` whose bits differ. It is not ``flown`` where that kernel is not compiled here."""

    number: int
    flown: bool
    columns: tuple[str, ...] = ()

    @property
    def sentence(self) -> str:
        """What was found."""
        if not self.flown:
            return "its row was not flown again: the campaign's kernel is not compiled here"
        if not self.columns:
            return f"flown again by the campaign's kernel, row {self.number} is the same bit by bit"
        some = ", ".join(self.columns[:3]) + (", ..." if len(self.columns) > 3 else "")
        return (
            f"flown again by the campaign's kernel, row {self.number} differs in "
            f"{len(self.columns)} columns: {some}"
        )


def earlier_integration(campaign: Definition, say: Log | None = None) -> Integration | None:
    """How the campaign of a run was flown; None where its kernel is not compiled here."""
    history = campaign.has_histories
    if left_to_compile(kernel_text(campaign, history=history))[0]:
        return None
    return select_steps(campaign, history=history, announce=say)


def check_row(
    campaign: Definition,
    flight: Integration | None,
    folder: Path,
    number: int,
    seed: int,
    total: int,
) -> RowComparison:
    """Fly a case of a run by `earlier_integration` and compare its row with the stored one."""
    if flight is None:
        return RowComparison(number, flown=False)
    drawn = campaign.draw(number, 1, seed, total)
    room = history_rows(campaign.scene) if campaign.has_histories else 0
    block = fly(campaign, flight, campaign.in_si(drawn), room)
    scales = np.array([c.scale for c in campaign.result_columns])
    here = {c.name: x for c, x in zip(campaign.input_columns, drawn[0], strict=True)}
    results = block.outcomes[0] * scales
    here |= {c.name: x for c, x in zip(campaign.result_columns, results, strict=True)}
    row = shards.read_row(folder, number)
    # a run by an earlier version may lack a column
    differ = [name for name, x in here.items() if name in row and not _same(x, row[name])]
    if row.get("status") != Status(int(block.status[0])).label:
        differ.insert(0, "status")
    return RowComparison(number, True, tuple(differ))


def _same(one: float, two: float) -> bool:
    return np.float64(one).tobytes() == np.float64(two).tobytes() or (
        np.isnan(one) and np.isnan(two)
    )


def extreme(cases: shards.CaseColumns, outcome: str, least: bool) -> int:
    """The case with the least or greatest value of an outcome, of those that are ok."""
    numbers, values = _values(cases, outcome)
    return int(numbers[values.argmin() if least else values.argmax()])


def near(cases: shards.CaseColumns, asked: str) -> tuple[int, str]:
    """The case nearest to what ``OUTCOME:p99.73``, ``OUTCOME:mean`` or ``OUTCOME:12.5`` asks for,
    of those that are ok, and what that is, in words."""
    outcome, colon, place = asked.rpartition(":")
    if not colon:
        raise InputError(f"nearest = {asked}: must be OUTCOME:p99.73, OUTCOME:mean or a value")
    numbers, values = _values(cases, outcome)
    try:
        if place == "mean":
            target = float(values.mean())
        elif place.startswith("p"):
            share = float(place[1:])
            if not 0.0 <= share <= 100.0:
                raise ValueError
            target = float(np.percentile(values, share))
        else:
            target = float(place)
    except ValueError:
        raise InputError(
            f"nearest = {asked}: {place!r} must be a percentile from p0 to p100, mean or a value"
        ) from None
    return int(numbers[np.abs(values - target).argmin()]), f"{outcome} = {target:.6g}"


def worst(
    summary: Rows | Stream, campaign: Definition, errors: dict, asked: str
) -> tuple[int, str]:
    """The worst case of a requirement, which is named, or by its metric, and what it is; of an
    outcome that is yes or no, of a status or of a violation, the first that violates it."""
    known = [name for item in campaign.file.requirements for name in (item.name, item.metric)]
    audited, sampler = summary.audit(), campaign.scene.run.sampler
    for verdict in summary.verdicts(errors, audited, sampler):
        if asked in (verdict.name, verdict.metric):
            if verdict.worst_case is None:
                raise InputError(f"worst = {asked}: no case violates {verdict.name}")
            if verdict.worst is None:
                said = f"is the first of {verdict.violations} that violate {verdict.name}"
            else:
                said = f"is the worst of {verdict.name}"
            return int(verdict.worst_case), said
    ways = "; without a requirement, ask for the min or max of an outcome"
    raise InputError(f"worst = {asked}: no such requirement; {nearest(asked, known)}{ways}")


def _values(cases: shards.CaseColumns, outcome: str) -> tuple[np.ndarray, np.ndarray]:
    """Numbers and values (n,) of an outcome, of cases that are ok and have it."""
    known = [name for name in cases if name not in ("case", "status")]
    if outcome not in known:
        raise InputError(f"{outcome}: no such outcome; {nearest(outcome, known)}")
    values = column(cases, outcome)
    there = ok_rows(cases) & np.isfinite(values)
    if not there.any():
        raise InputError(f"{cases.folder}: no ok case has {outcome}")
    return np.asarray(cases["case"])[there], values[there]
