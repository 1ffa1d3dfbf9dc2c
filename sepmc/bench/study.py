"""Study: the cases, selected steps and repeats that all parts of a benchmark share; and variants of
solver settings that are run on its cases."""

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

FULL = "full"  # formulation that takes some 50 times as long as the reduced one
# the full formulation runs 1 / _FULL_FRACTION of the cases, at least these; times are scaled
_FULL_FRACTION, _MIN_FULL_CASES = 16, 16
# a variant that takes longer runs fewer cases, at least these; cases timed for an estimate
_MAX_VARIANT_S, _MIN_CASES, _MAX_TIMED = 0.3, 200, 1000


@dataclass(frozen=True)
class Study:
    """Data that all parts of one benchmark share.

    Attributes
    ----------
    campaign : Campaign
        Without histories.
    integration : Integration
        Kernel, methods and steps selected for the campaign.
    inputs : ndarray, shape (cases, d)
        Dispersed inputs of every case, SI, stored by column, as a campaign passes them to the
        kernel.
    repeats, threads : int
        Repeats of each timing; threads of the kernel.
    quick : bool
        Measure fewer settings, and nothing that takes minutes.
    say : callable (text)
        Receives progress messages.
    """

    campaign: Campaign
    integration: Integration
    inputs: np.ndarray
    repeats: int
    threads: int
    quick: bool
    say: Log

    @property
    def cases(self) -> int:
        """Number of cases."""
        return len(self.inputs)

    @property
    def method(self) -> str:
        """Name of the scene's Runge-Kutta method, or "auto"."""
        return self.campaign.scene.solver.method

    @property
    def formulation(self) -> str:
        """Formulation of the equations in the scene: "reduced" or "full"."""
        return self.campaign.scene.solver.formulation

    @cached_property
    def seconds(self) -> float:
        """Approximate time of a case with the selected steps, s: wall time of many cases on the
        threads in use, divided by their number. It is measured once, after a run to warm up."""
        subset = self.inputs[: self.part(self.formulation)][:_MAX_TIMED]
        self.default.fly(subset)  # warm-up
        start = time.perf_counter()
        self.default.fly(subset)
        return (time.perf_counter() - start) / len(subset)

    def affordable(self, evaluations: int) -> int:
        """Return the number of cases that take about 0.3 s if each needs this number of
        evaluations; at least 200, at most all."""
        seconds_per_case = self.seconds * evaluations / max(1, self.default.evaluations)
        return min(self.cases, max(_MIN_CASES, int(_MAX_VARIANT_S / seconds_per_case)))

    def part(self, formulation: str) -> int:
        """Return the number of cases to run with a formulation: all with "reduced"; with "full",
        which takes some 50 times as long, a sixteenth, but at least 16 or, of fewer, all."""
        return (
            min(self.cases, max(_MIN_FULL_CASES, self.cases // _FULL_FRACTION))
            if formulation == FULL
            else self.cases
        )

    @property
    def own_cases(self) -> int:
        """Number of cases to run with the scene's own formulation: all if it is "reduced", a
        sixteenth, but at least 16, if "full" (see `part`)."""
        return self.part(self.formulation)

    @property
    def default(self) -> "SolverVariant":
        """Variant that a run of the campaign would take: the scene's method and formulation, and
        the steps selected for them (or given in the file)."""
        return SolverVariant(
            self.integration,
            self.campaign,
            self.own_cases,
            self.campaign.scene.solver.accuracy,
            True,
        )

    @cached_property
    def units(self) -> list[str]:
        """Units of the outcomes as text for users ("1" without a unit), in the order of
        `Campaign.outcome_columns`."""
        return [c.unit for c in self.campaign.outcome_columns]

    @cached_property
    def names(self) -> list[str]:
        """Names of the outcomes, in the order of `Campaign.outcome_columns`."""
        return [c.name for c in self.campaign.outcome_columns]

    def with_settings(self, settings: dict[str, Any]) -> Campaign:
        """Return the campaign of the study with other values, by TOML path, as
        `Campaign.with_settings`."""
        return self.campaign.with_settings(settings)

    def error(self, block: Block, reference: np.ndarray, valid: np.ndarray) -> tuple[float, str]:
        """Return the largest relative error of the outcomes of a block against ``reference`` (n,
        o), and the name of the outcome that has it.

        Only cases count that have status ok in the block and are ``valid`` (n,) in the reference.
        Only decisive outcomes count: contact (1 or 0) and the times and positions of extremes are
        left out, as they do not converge with the steps. Without such a case the error is infinite
        and the name empty.
        """
        n = min(len(block.status), len(valid))
        return self.error_of(
            block.outcomes[:n, : len(self.names)], block.status[:n] == Status.OK, reference, valid
        )

    def error_of(
        self, outcomes: np.ndarray, ok: np.ndarray, reference: np.ndarray, valid: np.ndarray
    ) -> tuple[float, str]:
        """Return the largest relative error and the name of its outcome, as `error` does, from the
        ``outcomes`` (m, o) of the first m cases and the mask ``ok`` (m,) of those with status ok.

        ``reference`` (n, o) and the mask ``valid`` (n,) are those of all n cases: errors are
        relative to the reference value, or to the scale of the outcome over the valid cases if that
        is larger (`sepmc.campaign.execution.accuracy.scales`). The result is (infinity, "") if no
        case is both ok and valid.
        """
        common = np.flatnonzero(ok & valid[: len(outcomes)])
        if not len(common):
            return np.inf, ""
        values = reference.copy()
        values[common] = outcomes[common]
        errors = relative_error(
            values[valid],
            reference[valid],
            self.units,
            scene_scales(self.campaign.scene, self.units),
        )
        worst = int(np.argmax(np.where(decisive(self.campaign.outcome_columns), errors, 0.0)))
        return float(errors[worst]), self.names[worst]


@dataclass(frozen=True)
class SolverVariant:
    """Campaign with a method, formulation and steps, and the number of cases of the study to run
    with them.

    Attributes
    ----------
    integration : Integration
        Kernel, methods and steps.
    campaign : Campaign
    cases : int
    requested : float
        Accuracy for which the steps were selected; NaN if they were derived from other steps.
    default : bool
        The steps are those that a run of the campaign would take.
    """

    integration: Integration
    campaign: Campaign
    cases: int
    requested: float = np.nan  # accuracy requested of the step selection
    default: bool = False

    @property
    def method(self) -> str:
        """Name of the Runge-Kutta method, or "auto"."""
        return self.campaign.scene.solver.method

    @property
    def formulation(self) -> str:
        """Formulation of the equations: "reduced" or "full"."""
        return self.campaign.scene.solver.formulation

    @property
    def setting(self) -> str:
        """Steps in words: the fixed step, as "step 0.01 s", or the number of steps in each segment,
        as "steps 1 2"; "steps 1 tp7 2 sharp9" if their methods differ."""
        if self.integration.step is not None:
            return f"step {self.integration.step:.4g} s"
        steps, names = self.integration.steps.tolist(), self.integration.method_names
        if len(set(names)) == 1:
            return "steps " + " ".join(map(str, steps))
        return "steps " + " ".join(
            f"{number} {name}" for number, name in zip(steps, names, strict=True)
        )

    @property
    def evaluations(self) -> int:
        """Approximate number of derivative evaluations of a case. With a fixed step it is that of
        one step in each segment, whatever the length of the step."""
        return self.integration.evaluations

    def by_formulation(self, study: Study, other: str) -> "SolverVariant":
        """Return a variant with the same steps and the formulation ``other``, whose kernel is
        compiled here; no case of it is refined."""
        settings = {"solver.method": self.method, "solver.formulation": other}
        campaign = study.with_settings(settings)
        integration = replace(
            unpacked(campaign, self.integration.packed, history=False, announce=study.say),
            limits=None,
            angles={},
            estimate=None,
            error_limit=np.inf,
        )
        return SolverVariant(integration, campaign, study.part(other), self.requested)

    def fly(self, inputs: np.ndarray) -> Block:
        """Integrate the first `cases` cases of ``inputs`` (n, d), SI; return the block of
        results."""
        return integrate(self.campaign, self.integration, inputs[: self.cases])


def sample_inputs(campaign: Campaign, count: int) -> np.ndarray:
    """Sample the first ``count`` cases of a campaign, with the seed and the number of cases of its
    file; return their dispersed inputs (count, d), SI."""
    return campaign.sample(0, count) * campaign.factors
