"""Limit-state function of a rare-event estimate: `MarginEvaluator` maps standard-normal samples to
margins of a requirement, by running their cases; `LimitState` computes margins from their results.

A margin is the distance of an outcome from the bound of the requirement; below 0 the case violates.
"""

from collections import Counter
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from sepmc import schema
from sepmc.analysis.requirements import margins
from sepmc.analysis.statistics import AuditSummary
from sepmc.analysis.subset_simulation import Estimate
from sepmc.campaign import cases
from sepmc.campaign.definition import Definition
from sepmc.campaign.execution.batch_summary import BatchSummary, count
from sepmc.campaign.execution.flight_log import FlightLog
from sepmc.campaign.execution.integration import Integration, integrate
from sepmc.engine.dispatch import Block
from sepmc.scene.messages import InputError, Log, nearest
from sepmc.scene.model import VIOLATION, Requirement
from sepmc.schema import STATUS_LABELS, Column, Status, is_yes_or_no
from sepmc.wording import setting

_CASES_PER_CALL = 4096  # a call cannot be interrupted
_CONTACT = "_recontact"
_CONTACT_MARGIN = -1e-9  # mm: outlines that touch have a negative margin
# values of a discrete distribution less probable than this get cases of their own, as levels can
# miss them; number of cases for each
_RARE_PROBABILITY, _CASES_PER_VALUE = 0.01, 64
_MIN_FRACTION = 0.2  # of the estimated probability: contributions below are not reported


@dataclass(frozen=True)
class LimitState:
    """Requirement on one outcome, and where in the results of a case its margin is computed from.

    Attributes
    ----------
    requirement : Requirement
    column : Column
        Column of the outcome that is bounded; of the clearance if the requirement is on contact.
    index : int
        Index of that column among the outcomes.
    contact : int or None
        Index of the contact outcome (1 or 0) if the requirement is on contact, else None.
    """

    requirement: Requirement
    column: Column
    index: int
    contact: int | None = None

    @property
    def sentence(self) -> str:
        """Requirement in words, such as "requirement.tip_off: tip_off_deg_s <= 5 deg/s"; two bounds
        are joined by "and", and one on contact reads "requirement.NAME: no METRIC"."""
        item, unit = self.requirement, "" if self.column.unit == "1" else f" {self.column.unit}"
        bounds = [
            f"{word} {bound:g}{unit}"
            for word, bound in ((">=", item.at_least), ("<=", item.at_most))
            if bound is not None and self.contact is None
        ]
        text = f"{item.metric} {' and '.join(bounds)}" if bounds else f"no {item.metric}"
        return f"requirement.{item.name}: {text}"

    @property
    def size(self) -> float:
        """Absolute value of the bound, in the unit of the outcome: the larger one if there are two
        bounds, 0 for a requirement on contact."""
        bounds = (self.requirement.at_least, self.requirement.at_most)
        return max(abs(x) for x in bounds if x is not None) if self.contact is None else 0.0

    def margin(self, block: Block) -> np.ndarray:
        """Margin of each case: positive within the bound, negative beyond it.

        It is NaN for a case that is not ok or does not have the outcome. The margin of a
        requirement on contact is the clearance, but always negative if there was contact and at
        least 0 if not, infinite if the clearance then has no value.

        Parameters
        ----------
        block : Block
            Results of the kernel for n cases.

        Returns
        -------
        ndarray, shape (n,)
            Margins in the unit of the outcome (of the clearance if on contact).
        """
        values = block.outcomes[:, self.index] * self.column.scale
        if self.contact is None:
            margin = margins(values, self.requirement)
        else:  # NaN: the clearance never counts
            contact = block.outcomes[:, self.contact]
            distance = np.where(np.isnan(values), np.inf, np.maximum(values, 0.0))
            margin = np.where(contact > 0.5, np.fmin(values, _CONTACT_MARGIN), distance)
            margin = np.where(np.isnan(contact), np.nan, margin)
        return np.where(block.status == Status.OK, margin, np.nan)


def limit_state(campaign: Definition, name: str) -> LimitState:
    """Find where in the results of a case the margin of a requirement is computed from.

    No case is run: `MarginEvaluator` runs the cases.

    Parameters
    ----------
    campaign : Definition
    name : str
        Name of the requirement.

    Returns
    -------
    LimitState

    Raises
    ------
    InputError
        If the campaign has no requirement with this name, if its violation cannot be expressed as a
        margin, or if inputs are not sampled from distributions.
    """
    known = {item.name: item for item in campaign.file.requirements}
    if not known:
        raise InputError(f"rare = {name}: needs a [[requirement]] in {campaign.name}")
    if name not in known:
        raise InputError(f"rare = {name}: no such requirement; {nearest(name, known)}")
    item, inputs = known[name], campaign.file.input_table
    key = f"requirement.{name}.metric = {item.metric!r}"
    columns = {column.name: k for k, column in enumerate(campaign.outcome_columns)}
    if item.metric == VIOLATION:
        others = ", ".join(other for other in known if other != name)
        raise InputError(f"{key}: combines other requirements; name one of them: {others}")
    if item.metric not in columns:
        raise InputError(
            f"{key}: is a status, which has no margin; give a requirement with a bound on an "
            "outcome that is a number"
        )
    if inputs is not None:
        raise InputError(
            f"run.samples = {inputs.path.name}: a rare event is estimated beyond the cases of a "
            "table; give [dispersion] distributions, and no run.samples"
        )
    if not campaign.file.dispersions:
        raise InputError(f"rare = {name}: nothing is dispersed; give [dispersion]")
    if not is_yes_or_no(item.metric):
        index = columns[item.metric]
        return LimitState(item, campaign.outcome_columns[index], index)
    if (item.at_least or 0.0) > 0.0 or (item.at_most or 0.0) < 0.0:
        raise InputError(
            f"{key}: is 1 or 0: a rare event needs the bound at_most = 0, so that 1 violates it"
        )
    index = columns[f"{item.metric.removesuffix(_CONTACT)}_clearance_mm"]
    return LimitState(item, campaign.outcome_columns[index], index, columns[item.metric])


class MarginEvaluator:
    """Limit-state function of an estimate: `margins` runs the cases of standard-normal samples and
    returns their margins and rows; cases, statuses and failures of the audit are counted.

    Parameters
    ----------
    campaign : Definition
    integration : Integration
        Kernel and steps.
    limit_state : LimitState
    report : callable (n_cases, n_failures)
        Called after each batch with the numbers of cases and of failed cases so far.
    announce : Log or None
        Called with a message if a fallback kernel is compiled.
    log : FlightLog, optional
        Receives the batches that are run, and returns those of an interrupted estimate.
    """

    def __init__(
        self,
        campaign: Definition,
        integration: Integration,
        limit_state: LimitState,
        report: Callable[[int, int], None],
        announce: Log | None,
        log: FlightLog | None = None,
    ):
        self.campaign, self.integration, self.limit_state = campaign, integration, limit_state
        self.report, self.announce, self.log = report, announce, log
        self.count, self.summary, self.statuses = 0, BatchSummary(), Counter[str]()
        self.n_without_outcome = 0  # ok cases that do not have the outcome
        self.scales = np.array([column.scale for column in campaign.result_columns])
        names = [column.name for column in campaign.result_columns]
        self.audited = {
            names.index(column.name): AuditSummary(column.name, schema.AUDIT_BOUNDS)
            for column in schema.audit_columns()
        }

    def margins(self, scores: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Run the cases of some samples, or take them from the log, and return their margins.

        The counts of this object are updated, and ``report`` is called.

        Parameters
        ----------
        scores : ndarray, shape (n, d)
            Independent standard-normal scores of the d inputs of n cases.

        Returns
        -------
        margin : ndarray, shape (n,)
            See `LimitState.margin`.
        rows : ndarray, shape (n, k)
            Inputs, status code, and results (outcomes and audit columns) of each case, in the units
            of their columns.
        """
        parts = [
            self._margins_of_batch(scores[first : first + _CASES_PER_CALL])
            for first in range(0, len(scores), _CASES_PER_CALL)
        ]
        margin, rows = zip(*parts, strict=True)
        return np.concatenate(margin), np.concatenate(rows)

    def _margins_of_batch(self, scores: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        file = self.campaign.file
        inputs = cases.inputs_at_scores(file.dispersions, scores, file.copulas)
        logged = self.log.answer(inputs) if self.log else None
        margin, rows = logged or self._fly(inputs)
        if self.log and logged:
            self.summary = self.log.summary
        elif self.log:
            self.log.add(margin, rows, self.summary)
        n_inputs = inputs.shape[1]
        status, results = rows[:, n_inputs], rows[:, n_inputs + 1 :]
        numbers, ok = self.count + np.arange(len(inputs)), status == Status.OK
        for index, worst in self.audited.items():  # audit columns have SI units
            worst.add(results[ok, index], numbers[ok])
        self.n_without_outcome += int(np.count_nonzero(ok & np.isnan(margin)))
        self.count += len(inputs)
        self.statuses.update(STATUS_LABELS[int(code)] for code in status)
        self.report(self.count, self.summary.failures)
        return margin, rows

    def _fly(self, inputs: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Integrate cases with ``inputs`` (n, d), in the units of the file, and add them to
        ``summary``; return margins (n,) and rows (n, k) as `margins` does."""
        campaign = self.campaign
        block = integrate(campaign, self.integration, campaign.in_si(inputs), 0, self.announce)
        self.summary += count(campaign, inputs, block)
        rows = np.column_stack([inputs, block.status, block.outcomes * self.scales])
        return self.limit_state.margin(block), rows

    @property
    def beyond_bounds(self) -> dict[str, int]:
        """Number of ok cases so far beyond the bound of an audit column (a check of the
        integration, such as a joint gap), or with NaN in it, by column; columns without such cases
        are left out."""
        names = [column.name for column in self.campaign.result_columns]
        return {names[k]: worst.beyond for k, worst in self.audited.items() if worst.beyond}


@dataclass(frozen=True)
class RareValue:
    """Rare value of a discrete distribution, and how many cases with it violate the requirement.

    Attributes
    ----------
    index : int
        Index of the parameter among the dispersed ones.
    value, probability : float
        The value, in the unit of its key in the file, and its probability.
    fraction : float
        Fraction of the cases with this value that violate the requirement or have no margin.
    """

    index: int
    value: float
    probability: float
    fraction: float

    def note(self, campaign: Definition, values: Estimate) -> str:
        """Note for the user if an estimate, ``values``, misses most of the contribution of cases
        with this value to its probability; empty if not.

        That is so if the contribution is above a fifth of the probability that a case violates or
        has no margin, and the cases of the estimate stand for at most a third of it."""
        contribution, last = self.probability * self.fraction, values.last
        weight_found = values.weight[
            (last.records[:, self.index] == self.value) & ~(last.margin >= 0.0)
        ].sum()
        total = values.probability + float(values.unknown.mean())
        if contribution <= _MIN_FRACTION * total or weight_found > contribution / 3.0:
            return ""
        key = campaign.file.dispersions[self.index].parameter.key
        return (
            f"{key} = {self.value:g} has a probability of {self.probability:.2g}, and of the "
            f"cases with it {100.0 * self.fraction:.0f} % violate or have no outcome: that adds "
            f"{contribution:.1e} to the probability, which the estimate misses; estimate it with "
            f"{setting(f'dispersion.{key}.constant', f'{self.value:g}')}"
        )


def rare_discrete_values(
    evaluator: MarginEvaluator, random: np.random.Generator
) -> list[RareValue]:
    """Run 64 cases at each value that a discrete distribution gives a probability below 1 %, and
    return all these values, each with the fraction of its cases that violate the requirement or
    have no margin.

    ``evaluator`` runs the cases, and adds them to its counts. The other inputs are sampled by
    ``random``. Values of probability 0 and correlated parameters are left out.
    """
    dispersions, values = evaluator.campaign.file.dispersions, []
    correlated = {index for copula in evaluator.campaign.file.copulas for index in copula.places}
    for index, dispersion in enumerate(dispersions):
        weights = (
            np.array(dispersion.weights) / sum(dispersion.weights)
            if dispersion.distribution == "discrete"
            else ()
        )
        for number, weight in enumerate(weights):
            if not 0.0 < weight < _RARE_PROBABILITY or index in correlated:
                continue
            scores = random.standard_normal((_CASES_PER_VALUE, len(dispersions)))
            scores[:, index] = cases.normal_score(sum(weights[:number]) + 0.5 * weight)
            margin, _ = evaluator.margins(scores)
            fraction = float(np.mean(~(margin >= 0.0)))
            values.append(RareValue(index, dispersion.numbers[number], float(weight), fraction))
    return values
