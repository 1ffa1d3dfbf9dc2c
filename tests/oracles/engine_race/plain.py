"""Cases by scipy's `solve_ivp` with events, in plain Python: the independent simulation, the
approach that most users would try first."""

from typing import Any

import numpy as np

from oracles.engine_race.inputs import Inputs
from oracles.engine_race.vectors import Array
from oracles.independent import CaseResult, simulate
from sepmc.campaign.campaign import Campaign
from sepmc.scene.read import parse_campaign


class ScipyFlight:
    """Some cases at a tolerance, relative."""

    compile_s = 0.0

    def __init__(self, tree: dict[str, Any], name: str, inputs: Inputs, tolerance: float):
        self.campaign = campaign = Campaign(parse_campaign(tree, name, None, name))
        self.cases, self.tolerance = (
            [campaign.case(i).to_dict() for i in range(inputs.count)],
            tolerance,
        )

    def fly(self) -> list[CaseResult]:
        """Every case."""
        return [simulate(case, self.tolerance) for case in self.cases]

    def outcomes(self, flown: list[CaseResult]) -> dict[str, Array]:
        """Outcome columns of a run; not timed."""
        return {
            c.name: np.array([one.outcomes.get(c.name, np.nan) for one in flown])
            for c in self.campaign.outcome_columns
        }
