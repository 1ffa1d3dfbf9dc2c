"""The reference that errors are taken against: the same scene at so many steps that round-off is
what is left, and a second opinion."""

from dataclasses import dataclass, replace

import numpy as np

from sepmc.bench.study import FULL, SolverVariant, Study
from sepmc.campaign.execution.step_selection import select_steps
from sepmc.schema import Status

METHOD = "dop853"
_DOUBLINGS = 6
_CHECKED = 500  # cases flown by the other formulation for the second opinion


@dataclass(frozen=True)
class Reference:
    """Outcomes (n, o) in SI that errors are taken against.

    ``sound`` (n,) tells which cases were flown to the end; ``change`` is what the last doubling of
    the steps changed, ``difference`` how far the ``other`` way is off, both as errors; ``floor`` is
    the larger of them, below which an error says nothing.
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
        """Error below which an error says nothing."""
        return max(self.change, self.difference)

    @property
    def sentence(self) -> str:
        """How the reference was flown and how far it is to be trusted, as a line of text."""
        return (
            f"reference: {self.how}, {len(self.sound)} cases; halving its resolution changes "
            f"{self.change:.1e}; the {self.other}, "
            f"differs by {self.difference:.1e} ({self.checked} cases)"
        )


def reference_times() -> int:
    """How many times as long as the cases the reference takes at most."""
    return sum(2**k for k in range(_DOUBLINGS + 1))


def make_reference(study: Study) -> Reference:
    """The reference of a study."""
    campaign = study.with_settings({"solver.method": METHOD})
    flight = study.flight if study.method == METHOD else select_steps(campaign, announce=study.say)
    first = SolverVariant(flight, campaign, study.own_cases)
    outcomes, sound, change, flown = _refined(study, first)
    times = int(flown.flight.steps[0] // first.flight.steps[0])
    other = _other(study, first, times)
    difference, _ = study.error(other.fly(study.draws), outcomes, sound)
    how, opinion = (
        f"{way.formulation} formulation, {METHOD}, {way.setting}" for way in (flown, other)
    )
    return Reference(outcomes, sound, how, flown.setting, change, opinion, difference, other.cases)


def _refined(
    study: Study, way: SolverVariant
) -> tuple[np.ndarray, np.ndarray, float, SolverVariant]:
    """Double the steps while that changes less and less; outcomes, which are sound, the last
    change, and the way they were flown."""
    last = way.fly(study.draws)
    best = None
    for _ in range(_DOUBLINGS):
        way = replace(way, flight=way.flight.refined())
        block = way.fly(study.draws)
        outcomes, sound = block.outcomes[:, : len(study.names)], block.status == Status.OK
        change, _ = study.error(last, outcomes, sound)
        if best is not None and change >= best[2]:
            break
        best, last = (outcomes, sound, change, way), block
    assert best is not None
    return best


def _other(study: Study, own: SolverVariant, times: int) -> SolverVariant:
    """Another way to the same answer: the other formulation of the equations, at so many times its
    resolution, by a part of the cases."""
    other = "reduced" if own.formulation == FULL else FULL
    way = own.by_formulation(study, other)
    cases = min(own.cases, _CHECKED // (10 if study.quick else 1))
    return replace(way, flight=way.flight.refined(times), cases=cases)
