"""What all parts of a bench share: the campaign, its cases, how it is flown by default, how often things are timed."""

from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any

import numpy as np

from sepmc.bench.clock import rounds
from sepmc.campaign import cases
from sepmc.campaign.accuracy import scene_scales
from sepmc.campaign.campaign import Campaign
from sepmc.campaign.pilot import Flight, fly, relative_error
from sepmc.door import Block, warm_up
from sepmc.schema import Status

Say = Callable[[str], None]
GENERAL_S = 0.3  # one flight by the general kernel may take so long: it flies fewer cases, and the time is scaled
GENERAL_CASES = 2000
FEWEST = 16


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
    flight: Flight
    draws: np.ndarray
    repeats: int
    threads: int
    quick: bool
    say: Say

    @property
    def cases(self) -> int:
        return len(self.draws)

    @property
    def specialised(self) -> bool:
        """Whether a kernel of its own flies the campaign."""
        return self.flight.steps is not None

    @cached_property
    def units(self) -> list[str]:
        return [c.unit for c in self.campaign.outcome_columns]

    @cached_property
    def names(self) -> list[str]:
        return [c.name for c in self.campaign.outcome_columns]

    @cached_property
    def few(self) -> int:
        """Cases that the general kernel flies in about `GENERAL_S` at the base step; all cases, if that is fewer."""
        warm_up(self.say)
        trial = self.draws[: min(self.cases, 2 * self.threads)]
        way = Way("reduced", self.method, replace(self.general, step=self.base_step), self.campaign, len(trial))
        spent = min(rounds({"": lambda: way.fly(trial)}, 2)[""]) / len(trial)
        most = int(GENERAL_S / max(spent, 1e-9)) // FEWEST * FEWEST
        return min(self.cases, max(FEWEST, min(GENERAL_CASES // (8 if self.quick else 1), most)))

    @property
    def method(self) -> str:
        return self.campaign.scene.solver.method

    @cached_property
    def general(self) -> Flight:
        """A flight by the general kernel."""
        return Flight(why=self.flight.why or ["the bench"], step=self.base_step)

    @cached_property
    def base_step(self) -> float:
        """Step of the general kernel from which others are made, s: the pilot's; in its absence about that of the scene's own kernel."""
        if self.flight.steps is not None and self.flight.step is None:
            return self.campaign.scene.run.end_time / float(self.flight.steps.sum())
        return self.flight.step or self.campaign.scene.run.end_time / 8.0

    def with_settings(self, settings: dict[str, Any]) -> Campaign:
        """The campaign with other values."""
        return self.campaign.with_settings(settings)

    def error(self, found: Block, reference: np.ndarray, sound: np.ndarray) -> tuple[float, str]:
        """Largest error of the outcomes of a block, and of which; of the cases that it and the reference flew to the end."""
        n = min(len(found.status), len(sound))
        return self.error_of(found.outcomes[:n, : len(self.names)], found.status[:n] == Status.OK, reference, sound)

    def error_of(self, found: np.ndarray, ok: np.ndarray, reference: np.ndarray, sound: np.ndarray) -> tuple[float, str]:
        """The same of outcomes (n, o) of the first n cases. The scatter of an outcome is that of all cases of the reference."""
        both = np.flatnonzero(ok & sound[: len(found)])
        if not len(both):
            return np.inf, ""
        whole = reference.copy()
        whole[both] = found[both]
        errors = relative_error(whole[sound], reference[sound], self.units, scene_scales(self.campaign.scene, self.units))
        worst = int(np.argmax(errors))
        return float(errors[worst]), self.names[worst]


@dataclass(frozen=True)
class Way:
    """A way to fly: formulation ("specialised", "reduced", "full"), method, flight, and how many of the cases."""

    formulation: str
    method: str
    flight: Flight
    campaign: Campaign
    cases: int
    asked: float = np.nan  # accuracy that the pilot was given
    default: bool = False

    @property
    def setting(self) -> str:
        """Steps, in words."""
        if self.flight.steps is not None and self.flight.step is None:
            return "steps " + " ".join(map(str, self.flight.steps.tolist()))
        return f"step {self.flight.step:.4g} s"

    def fly(self, draws: np.ndarray) -> Block:
        return fly(self.campaign, self.flight, draws[: self.cases])


def drawn(campaign: Campaign, count: int) -> np.ndarray:
    """The first ``count`` cases of a campaign, (count, d), SI."""
    return cases.draw(campaign.file.dispersions, campaign.scene.run.seed, 0, count) * campaign.factors
