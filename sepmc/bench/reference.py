"""Reference solution for errors: the same scene in steps so small that round-off remains, and a
second opinion."""

from dataclasses import dataclass, replace

import numpy as np

from sepmc.bench.study import FULL, SolverVariant, Study
from sepmc.campaign.execution.step_selection import select_steps
from sepmc.schema import Status

METHOD = "dop853"
_DOUBLINGS = 6
_MAX_CHECKED = 500  # cases run by the other formulation for the second opinion


@dataclass(frozen=True)
class Reference:
    """Reference outcomes (n, o) in SI.

    Parameters
    ----------
    valid : ndarray, shape (n,), bool
        Cases that finished.
    how, setting : str
        Formulation, method and steps in words; the steps alone.
    change : float
        Error by which the last doubling of the steps changed the outcomes.
    other, difference, checked : str, float, int
        The other formulation, method and steps in words; the largest error between it and the
        reference; and the number of cases it ran.
    """

    outcomes: np.ndarray
    valid: np.ndarray
    how: str
    setting: str
    change: float
    other: str
    difference: float
    checked: int

    @property
    def floor(self) -> float:
        """Smallest error that the reference resolves."""
        return max(self.change, self.difference)

    @property
    def sentence(self) -> str:
        """Description of the reference and its uncertainty."""
        return (
            f"reference: {self.how}, {len(self.valid)} cases; halving its resolution changes "
            f"{self.change:.1e}; the {self.other}, "
            f"differs by {self.difference:.1e} ({self.checked} cases)"
        )


def reference_times() -> int:
    """Return the largest time of `make_reference`, over that of one run of the cases."""
    return sum(2**k for k in range(_DOUBLINGS + 1))


def make_reference(study: Study) -> Reference:
    """Return the reference of a study: its cases at ever smaller steps, until halving these
    changes the outcomes no less than before."""
    campaign = study.with_settings({"solver.method": METHOD})
    integration = (
        study.integration if study.method == METHOD else select_steps(campaign, announce=study.say)
    )
    first = SolverVariant(integration, campaign, study.own_cases)
    outcomes, valid, change, refined = _refined(study, first)
    factor = int(refined.integration.steps[0] // first.integration.steps[0])
    other = _second_opinion(study, first, factor)
    difference, _ = study.error(other.fly(study.inputs), outcomes, valid)
    how, opinion = (
        f"{variant.formulation} formulation, {METHOD}, {variant.setting}"
        for variant in (refined, other)
    )
    return Reference(
        outcomes, valid, how, refined.setting, change, opinion, difference, other.cases
    )


def _refined(
    study: Study, variant: SolverVariant
) -> tuple[np.ndarray, np.ndarray, float, SolverVariant]:
    """Double the steps while the change decreases; return outcomes, valid cases, last change and
    variant."""
    previous = variant.fly(study.inputs)
    best = None
    for _ in range(_DOUBLINGS):
        variant = replace(variant, integration=variant.integration.refined())
        block = variant.fly(study.inputs)
        outcomes, valid = block.outcomes[:, : len(study.names)], block.status == Status.OK
        change, _ = study.error(previous, outcomes, valid)
        if best is not None and change >= best[2]:
            break
        best, previous = (outcomes, valid, change, variant), block
    assert best is not None
    return best


def _second_opinion(study: Study, own: SolverVariant, factor: int) -> SolverVariant:
    """Return the other formulation of the equations at ``factor`` times the steps, for some of the
    cases."""
    other = "reduced" if own.formulation == FULL else FULL
    variant = own.by_formulation(study, other)
    cases = min(own.cases, _MAX_CHECKED // (10 if study.quick else 1))
    return replace(variant, integration=variant.integration.refined(factor), cases=cases)
