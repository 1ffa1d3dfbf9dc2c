"""Reference solution of the cases of a benchmark: the same scene in steps so small that round-off
remains, and a check of it by the other formulation of the equations."""

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
    """Reference solution of n cases.

    Attributes
    ----------
    outcomes : ndarray, shape (n, o)
        Outcomes of the cases, SI.
    valid : ndarray, shape (n,), bool
        Cases that ended with status ok.
    how, setting : str
        Formulation, method and steps in words; the steps alone.
    change : float
        Largest relative error of the outcomes at half as many steps.
    other : str
        The check, which every reference has: the other formulation, its method and steps in words.
    difference, checked : float, int
        Largest relative error between the check and the reference, and the number of cases of the
        check.
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
        """Smallest relative error that can be measured against the reference: the larger one of
        `change` and `difference`."""
        return max(self.change, self.difference)

    @property
    def sentence(self) -> str:
        """Sentence on how the reference was made and how far halved steps and the check differ from
        it."""
        return (
            f"reference: {self.how}, {len(self.valid)} cases; halving its resolution changes "
            f"{self.change:.1e}; the {self.other}, "
            f"differs by {self.difference:.1e} ({self.checked} cases)"
        )


def reference_times() -> int:
    """Return the largest time that `make_reference` may take without its check by the other
    formulation, as a multiple of the time of its first run of all cases."""
    return sum(2**k for k in range(_DOUBLINGS + 1))


def make_reference(study: Study) -> Reference:
    """Integrate the study's `own_cases` by dop853 and double the number of steps, up to six times,
    until the change of the outcomes no longer decreases. Return the outcomes of the doubling with
    the smallest change, and their difference from those of the other formulation, which integrates
    some of the cases."""
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
    """Double the number of steps of a variant, up to six times, until the change of the outcomes no
    longer decreases. Return the outcomes (n, o) with the smallest change, the mask (n,) of cases
    with status ok, that change, and the variant that gave them."""
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
    """Return a variant that checks the reference: the other formulation of the equations in
    ``factor`` times as many steps as ``own``, with at most 500 cases (50 if the study is quick)."""
    other = "reduced" if own.formulation == FULL else FULL
    variant = own.by_formulation(study, other)
    cases = min(own.cases, _MAX_CHECKED // (10 if study.quick else 1))
    return replace(variant, integration=variant.integration.refined(factor), cases=cases)
