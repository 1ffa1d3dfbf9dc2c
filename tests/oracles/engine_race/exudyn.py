"""Some cases by Exudyn: `oracles.external_engines.exudyn`, with loads as Python functions, as its
users write them."""

from typing import Any

import numpy as np

from oracles.engine_race.inputs import Inputs
from oracles.engine_race.outcomes import Final, outcomes
from oracles.engine_race.vectors import Array
from oracles.external_engines import exudyn
from oracles.external_engines.schedule import PeerFlight


class ExudynFlight:
    """Some cases with a step, s, extrapolated from ``levels`` runs, each with half the step of the
    one before."""

    compile_s = 0.0

    def __init__(self, campaign: Any, inputs: Inputs, step: float, levels: int):
        self.inputs, self.step, self.levels = inputs, step, levels
        self.data = [campaign.case(i).to_dict() for i in range(inputs.count)]

    def fly(self) -> list[PeerFlight]:
        """Every case."""
        return [
            exudyn.fly(data, [self.inputs.end], self.step, self.levels).flight for data in self.data
        ]

    def outcomes(self, flown: list[PeerFlight]) -> dict[str, Array]:
        """Outcome columns of a run; not timed."""
        first, second = (
            Final(
                *(
                    np.array([getattr(f, part)[body.name][-1] for f in flown])
                    for part in ("x", "v", "R", "w")
                )
            )
            for body in self.inputs.bodies
        )
        return outcomes(
            self.inputs, first, second, np.array([next(iter(f.release.values())) for f in flown])
        )
