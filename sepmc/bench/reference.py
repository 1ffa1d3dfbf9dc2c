"""The reference that errors are taken against: the same scene at so many steps that round-off is what is left, and a second opinion."""

from dataclasses import dataclass, replace

import numpy as np

from sepmc.bench.study import Study, Way
from sepmc.campaign.pilot import plan_flight
from sepmc.schema import Status

METHOD = "dop853"
_DOUBLINGS = 6
_CHECKED = 500  # cases flown by the general kernel for the second opinion


@dataclass(frozen=True)
class Reference:
    """Outcomes (n, o) in SI that errors are taken against.

    ``sound`` (n,) tells which cases were flown to the end; ``change`` is what the last doubling of the steps changed, ``difference`` how
    far the ``other`` way is off, both as errors; ``floor`` is the larger of them, below which an error says nothing.
    """

    outcomes: np.ndarray
    sound: np.ndarray
    how: str
    setting: str
    change: float
    other: str
    difference: float
    checked: int

    @property
    def floor(self) -> float:
        return max(self.change, self.difference)

    @property
    def sentence(self) -> str:
        return (
            f"reference: {self.how}, {len(self.sound)} cases; halving its resolution changes {self.change:.1e}; {self.other} "
            f"differs by {self.difference:.1e} ({self.checked} cases)"
        )


def make_reference(study: Study) -> Reference:
    """The reference of a study."""
    campaign = study.with_settings({"solver.method": METHOD})
    if study.specialised:
        flight = study.flight if study.method == METHOD else plan_flight(campaign, announce=study.say)
        way = Way("specialised", METHOD, flight, campaign, study.cases)
    else:
        way = Way("reduced", METHOD, replace(study.general, step=0.5 * study.base_step), campaign, study.few)
    outcomes, sound, change, flown = _refined(study, way)
    other = _other(study, flown)
    checked = min(_CHECKED // (10 if study.quick else 1), len(sound), study.few)
    difference, _ = study.error(replace(other, cases=checked).fly(study.draws), outcomes, sound)
    how = f"{_kernel(flown)}, {METHOD}, {flown.setting}"
    return Reference(outcomes, sound, how, flown.setting, change, f"{_kernel(other)}, {other.setting},", difference, checked)


def _refined(study: Study, way: Way) -> tuple[np.ndarray, np.ndarray, float, Way]:
    """Double the steps while that changes less and less; outcomes, which are sound, the last change, and the way they were flown."""
    last = way.fly(study.draws)
    best = None
    for _ in range(_DOUBLINGS if study.specialised else 3):
        way = replace(way, flight=way.flight.sharper())
        block = way.fly(study.draws)
        outcomes, sound = block.outcomes[:, : len(study.names)], block.status == Status.OK
        change, _ = study.error(last, outcomes, sound)
        if best is not None and change >= best[2]:
            break
        best, last = (outcomes, sound, change, way), block
    assert best is not None
    return best


def _other(study: Study, flown: Way) -> Way:
    """Another way to the same answer: the general kernel at a fine step; for scenes that it flies anyway, the other formulation."""
    if study.specialised:
        general = replace(study.general, step=0.25 * study.base_step)
        return Way("reduced", METHOD, general, study.with_settings({"solver.method": METHOD}), study.cases)
    other = "full" if study.campaign.scene.solver.formulation == "reduced" else "reduced"
    campaign = study.with_settings({"solver.method": METHOD, "solver.formulation": other})
    return replace(flown, formulation=other, campaign=campaign)


def _kernel(way: Way) -> str:
    return "the scene's own kernel" if way.formulation == "specialised" else f"the general kernel ({way.formulation})"
