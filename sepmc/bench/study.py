"""What all parts of a bench share: the campaign, its cases, how it is flown by default, how often
things are timed."""

import time
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any

import numpy as np

from sepmc.campaign.campaign import Campaign
from sepmc.campaign.execution.accuracy import decisive, scene_scales
from sepmc.campaign.execution.step_selection import Integration, integrate, relative_error, unpacked
from sepmc.engine.dispatch import Block
from sepmc.scene.messages import Log
from sepmc.schema import Status

FULL = "full"  # the formulation that takes some 50 times as long as the reduced one
# of so many cases one is flown by the full formulation, but no fewer than these; times are scaled
_PART, _FEWEST = 16, 16
# A way that takes longer is flown by fewer cases, but no fewer than these; cases that are timed.
_LONG_S, _FEW, _TIMED = 0.3, 200, 1000


@dataclass(frozen=True)
class Study:
    """One bench.

    Attributes
    ----------
    campaign : Campaign
        Without histories.
    flight : Flight
        How the pilot would have it flown.
    draws : ndarray, shape (cases, d)
        SI, stored by column, as a campaign hands them to the kernel.
    repeats, threads : int
    quick : bool
        Fewer settings, and nothing that takes minutes.
    say : callable
        Told what is done.
    """

    campaign: Campaign
    flight: Integration
    draws: np.ndarray
    repeats: int
    threads: int
    quick: bool
    say: Log

    @property
    def cases(self) -> int:
        """Number of cases."""
        return len(self.draws)

    @property
    def method(self) -> str:
        """Name of the scene's Runge-Kutta method."""
        return self.campaign.scene.solver.method

    @property
    def formulation(self) -> str:
        """Formulation of the equations, as the scene has it."""
        return self.campaign.scene.solver.formulation

    @cached_property
    def seconds(self) -> float:
        """That a case takes as it is flown by default, about."""
        few = self.draws[: self.part(self.formulation)][:_TIMED]
        self.default.fly(few)  # what comes only once
        began = time.perf_counter()
        self.default.fly(few)
        return (time.perf_counter() - began) / len(few)

    def affordable(self, evaluations: int) -> int:
        """How many of the cases are flown where a case takes so many evaluations: all, or as many
        as take a third of a second."""
        each = self.seconds * evaluations / max(1, self.default.evaluations)
        return min(self.cases, max(_FEW, int(_LONG_S / each)))

    def part(self, formulation: str) -> int:
        """How many of the cases a formulation flies: all, or a part of them."""
        return (
            min(self.cases, max(_FEWEST, self.cases // _PART))
            if formulation == FULL
            else self.cases
        )

    @property
    def own_cases(self) -> int:
        """How many of the cases the scene's own formulation flies."""
        return self.part(self.formulation)

    @property
    def default(self) -> "SolverVariant":
        """The way that the pilot chose."""
        return SolverVariant(
            self.flight, self.campaign, self.own_cases, self.campaign.scene.solver.accuracy, True
        )

    @cached_property
    def units(self) -> list[str]:
        """Units of the outcomes, in the order of their columns."""
        return [c.unit for c in self.campaign.outcome_columns]

    @cached_property
    def names(self) -> list[str]:
        """Names of the outcomes, in the order of their columns."""
        return [c.name for c in self.campaign.outcome_columns]

    def with_settings(self, settings: dict[str, Any]) -> Campaign:
        """The campaign with other values."""
        return self.campaign.with_settings(settings)

    def error(self, found: Block, reference: np.ndarray, sound: np.ndarray) -> tuple[float, str]:
        """Largest error of the outcomes of a block, and of which; of the cases that it and the
        reference flew to the end. Times and places of extremes, which no step settles, do not
        count."""
        n = min(len(found.status), len(sound))
        return self.error_of(
            found.outcomes[:n, : len(self.names)], found.status[:n] == Status.OK, reference, sound
        )

    def error_of(
        self, found: np.ndarray, ok: np.ndarray, reference: np.ndarray, sound: np.ndarray
    ) -> tuple[float, str]:
        """The same of outcomes (n, o) of the first n cases. The scatter of an outcome is that of
        all cases of the reference."""
        both = np.flatnonzero(ok & sound[: len(found)])
        if not len(both):
            return np.inf, ""
        whole = reference.copy()
        whole[both] = found[both]
        errors = relative_error(
            whole[sound],
            reference[sound],
            self.units,
            scene_scales(self.campaign.scene, self.units),
        )
        worst = int(np.argmax(np.where(decisive(self.campaign.outcome_columns), errors, 0.0)))
        return float(errors[worst]), self.names[worst]


@dataclass(frozen=True)
class SolverVariant:
    """A way to fly: a flight, the campaign with the method and formulation that it was planned for,
    and how many of the cases."""

    flight: Integration
    campaign: Campaign
    cases: int
    asked: float = np.nan  # accuracy that the pilot was given
    default: bool = False

    @property
    def method(self) -> str:
        """Name of the Runge-Kutta method."""
        return self.campaign.scene.solver.method

    @property
    def formulation(self) -> str:
        """Formulation of the equations."""
        return self.campaign.scene.solver.formulation

    @property
    def setting(self) -> str:
        """Steps, in words: the scene's own step, if it has one, or else how many each stage
        takes."""
        if self.flight.step is not None:
            return f"step {self.flight.step:.4g} s"
        steps, names = self.flight.steps.tolist(), self.flight.method_names
        if len(set(names)) == 1:
            return "steps " + " ".join(map(str, steps))
        return "steps " + " ".join(
            f"{number} {name}" for number, name in zip(steps, names, strict=True)
        )

    @property
    def evaluations(self) -> int:
        """About how many a case takes; with a step that is given, only in proportion."""
        return self.flight.evaluations

    def by_formulation(self, study: Study, other: str) -> "SolverVariant":
        """The same steps by the other formulation of the equations, with nothing flown again."""
        given = {"solver.method": self.method, "solver.formulation": other}
        campaign = study.with_settings(given)
        flight = replace(
            unpacked(campaign, self.flight.packed, history=False, announce=study.say),
            limits=None,
            angles={},
            estimate=None,
            error_limit=np.inf,
        )
        return SolverVariant(flight, campaign, study.part(other), self.asked)

    def fly(self, draws: np.ndarray) -> Block:
        """Fly as many cases as the way has, the first of ``draws`` (n, d), SI."""
        return integrate(self.campaign, self.flight, draws[: self.cases])


def sample_inputs(campaign: Campaign, count: int) -> np.ndarray:
    """The first ``count`` cases of a campaign, (count, d), SI."""
    return campaign.sample(0, count) * campaign.factors
