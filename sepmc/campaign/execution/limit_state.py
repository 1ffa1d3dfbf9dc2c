"""What is sought of a rare event: a requirement as a margin, and what flies scores to it."""

from collections import Counter
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from sepmc import schema
from sepmc.analysis.requirements import margins
from sepmc.analysis.statistics import Worst
from sepmc.analysis.subset_simulation import Estimate
from sepmc.campaign import cases
from sepmc.campaign.definition import Definition
from sepmc.campaign.execution.batch_summary import BatchSummary, count
from sepmc.campaign.execution.flight_log import FlightLog
from sepmc.campaign.execution.integration import Integration, fly
from sepmc.engine.dispatch import Block
from sepmc.scene.messages import InputError, Log, nearest
from sepmc.scene.model import VIOLATION, Requirement
from sepmc.schema import Column, Status, is_yes_or_no
from sepmc.wording import setting

LABELS = [status.label for status in Status]
_AT_ONCE = 4096  # cases that one call flies: it cannot be interrupted
_CONTACT = "_recontact"
_TOUCHED = -1e-9  # mm: the margin of outlines that touch is below zero
# of a discrete law: a value less probable is looked at by itself, in so many cases each, as levels
# may not see it
_SELDOM, _EACH = 0.01, 64
_MATTERS = 0.2  # of the probability that was found


@dataclass(frozen=True)
class LimitState:
    """A requirement on an outcome that comes nearer to its bound by degrees: the outcome's
    ``column`` at its ``place``; of one on a contact, this is the clearance, and ``contact`` the
    place of whether there is one."""

    requirement: Requirement
    column: Column
    place: int
    contact: int | None = None

    @property
    def sentence(self) -> str:
        """What is asked, in words."""
        item, unit = self.requirement, "" if self.column.unit == "1" else f" {self.column.unit}"
        bounds = [
            f"{word} {bound:g}{unit}"
            for word, bound in ((">=", item.at_least), ("<=", item.at_most))
            if bound is not None and self.contact is None
        ]
        said = f"{item.metric} {' and '.join(bounds)}" if bounds else f"no {item.metric}"
        return f"requirement.{item.name}: {said}"

    @property
    def size(self) -> float:
        """Size of the bound, in the unit of the outcome."""
        bounds = (self.requirement.at_least, self.requirement.at_most)
        return max(abs(x) for x in bounds if x is not None) if self.contact is None else 0.0

    def margin(self, block: Block) -> np.ndarray:
        """How far cases (n,) are within the bound; NaN of those of which it is not known, as for a
        verdict."""
        values = block.outcomes[:, self.place] * self.column.scale
        if self.contact is None:
            found = margins(values, self.requirement)
        else:  # what never counts is never near
            met = block.outcomes[:, self.contact]
            apart = np.where(np.isnan(values), np.inf, np.maximum(values, 0.0))
            found = np.where(met > 0.5, np.fmin(values, _TOUCHED), apart)
            found = np.where(np.isnan(met), np.nan, found)
        return np.where(block.status == Status.OK, found, np.nan)


def target(campaign: Definition, name: str) -> LimitState:
    """The requirement of this name. Raises InputError if its violation cannot be approached by
    degrees, or the campaign does not vary by laws."""
    known = {item.name: item for item in campaign.file.requirements}
    if not known:
        raise InputError(f"rare = {name}: needs a [[requirement]] in {campaign.name}")
    if name not in known:
        raise InputError(f"rare = {name}: no such requirement; {nearest(name, known)}")
    item, inputs = known[name], campaign.file.input_table
    place = f"requirement.{name}.metric = {item.metric!r}"
    columns = {column.name: k for k, column in enumerate(campaign.outcome_columns)}
    if item.metric == VIOLATION:
        others = ", ".join(other for other in known if other != name)
        raise InputError(f"{place}: is about several outcomes; seek each by itself: {others}")
    if item.metric not in columns:
        raise InputError(
            f"{place}: is a status, which no case comes nearer to by degrees; give a requirement "
            "with a bound on an outcome that is a number"
        )
    if inputs is not None:
        raise InputError(
            f"run.plan = {inputs.path.name}: rare events are sought beyond the cases of a table; "
            "give [dispersion] laws, and no run.plan"
        )
    if not campaign.file.dispersions:
        raise InputError(f"rare = {name}: nothing is dispersed; give [dispersion]")
    if not is_yes_or_no(item.metric):
        at = columns[item.metric]
        return LimitState(item, campaign.outcome_columns[at], at)
    if (item.at_least or 0.0) > 0.0 or (item.at_most or 0.0) < 0.0:
        raise InputError(
            f"{place}: is 1 or 0, and can be sought with at_most = 0 only: that it is 0"
        )
    at = columns[f"{item.metric.removesuffix(_CONTACT)}_clearance_mm"]
    return LimitState(item, campaign.outcome_columns[at], at, columns[item.metric])


class MarginEvaluator:
    """What flies scores of a campaign, and counts what it flies."""

    def __init__(
        self,
        campaign: Definition,
        flight: Integration,
        aim: LimitState,
        tell: Callable[[int, int], None],
        announce: Log | None,
        log: FlightLog | None = None,
    ):
        self.campaign, self.flight, self.aim = campaign, flight, aim
        self.tell, self.announce, self.log = tell, announce, log
        self.count, self.tally, self.statuses = 0, BatchSummary(), Counter[str]()
        self.lacking = 0  # ok cases that do not have the outcome
        self.scales = np.array([column.scale for column in campaign.result_columns])
        names = [column.name for column in campaign.result_columns]
        self.audited = {
            names.index(column.name): Worst(column.name, schema.AUDIT_BOUNDS)
            for column in schema.audit_columns()
        }

    def margins(self, scores: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Margins (n,) at scores (n, d), and what is told of the cases (n, k): inputs, status and
        results, in their units."""
        parts = [
            self._margins(scores[first : first + _AT_ONCE])
            for first in range(0, len(scores), _AT_ONCE)
        ]
        margin, told = zip(*parts, strict=True)
        return np.concatenate(margin), np.concatenate(told)

    def _margins(self, scores: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        file = self.campaign.file
        drawn = cases.at_scores(file.dispersions, scores, file.copulas)
        logged = self.log.answer(drawn) if self.log else None
        margin, told = logged or self._fly(drawn)
        if self.log and logged:
            self.tally = self.log.tally
        elif self.log:
            self.log.add(margin, told, self.tally)
        inputs = drawn.shape[1]
        status, results = told[:, inputs], told[:, inputs + 1 :]
        numbers, ok = self.count + np.arange(len(drawn)), status == Status.OK
        for place, worst in self.audited.items():  # audit columns have SI units
            worst.add(results[ok, place], numbers[ok])
        self.lacking += int(np.count_nonzero(ok & np.isnan(margin)))
        self.count += len(drawn)
        self.statuses.update(LABELS[int(code)] for code in status)
        self.tell(self.count, self.tally.failures)
        return margin, told

    def _fly(self, drawn: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Margins (n,) and rows (n, k) of cases of these inputs (n, d), which are flown."""
        campaign = self.campaign
        block = fly(campaign, self.flight, campaign.in_si(drawn), 0, self.announce)
        self.tally += count(campaign, drawn, block)
        told = np.column_stack([drawn, block.status, block.outcomes * self.scales])
        return self.aim.margin(block), told

    @property
    def beyond(self) -> dict[str, int]:
        """How many flown cases are beyond each bound of the audit, of those that are."""
        names = [column.name for column in self.campaign.result_columns]
        return {names[k]: worst.beyond for k, worst in self.audited.items() if worst.beyond}


@dataclass(frozen=True)
class RareValue:
    """A value of a discrete law that few cases have: the place of its parameter, its
    ``probability``, and the share of such cases that violate or are not known not to."""

    place: int
    value: float
    probability: float
    share: float

    def missed(self, campaign: Definition, found: Estimate) -> str:
        """The sentence that an estimate does not hold most of what such cases add to it; empty if
        it does, or that is little."""
        adds, last = self.probability * self.share, found.last
        held = found.weight[(last.told[:, self.place] == self.value) & ~(last.margin >= 0.0)].sum()
        whole = found.probability + float(found.unknown.mean())
        if adds <= _MATTERS * whole or held > adds / 3.0:
            return ""
        key = campaign.file.dispersions[self.place].parameter.key
        return (
            f"{key} = {self.value:g} has a probability of {self.probability:.2g}, and of such "
            f"cases {100.0 * self.share:.0f} % violate or have no outcome: that adds {adds:.1e}, "
            "which the levels have not found; seek them by themselves, with "
            f"{setting(f'dispersion.{key}.constant', f'{self.value:g}')}"
        )


def seldom(flights: MarginEvaluator, random: np.random.Generator) -> list[RareValue]:
    """Values of discrete laws that few cases have, each flown in some cases."""
    laws, found = flights.campaign.file.dispersions, []
    together = {place for copula in flights.campaign.file.copulas for place in copula.places}
    for place, law in enumerate(laws):
        weights = np.array(law.weights) / sum(law.weights) if law.law == "discrete" else ()
        for number, weight in enumerate(weights):
            if not 0.0 < weight < _SELDOM or place in together:
                continue
            scores = random.standard_normal((_EACH, len(laws)))
            scores[:, place] = cases.score(sum(weights[:number]) + 0.5 * weight)
            margin, _ = flights.margins(scores)
            share = float(np.mean(~(margin >= 0.0)))
            found.append(RareValue(place, law.numbers[number], float(weight), share))
    return found
