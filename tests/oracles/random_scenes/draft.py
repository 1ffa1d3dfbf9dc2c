"""Scene under construction: its tree so far, and what the generators of its parts need to know."""

from dataclasses import dataclass, field
from typing import Any

from oracles.random_scenes.names import Names
from oracles.random_scenes.rng import RandomStream

Tree = dict[str, Any]
GROUND = "ground"


@dataclass
class Draft:
    """Tree of a campaign file under construction.

    ``special`` names a special structure ("" for none), ``span`` is the simulated time in s,
    ``late`` names the later kinds of feature, see `oracles.random_scenes.scenes.LATE`.
    """

    rng: RandomStream
    names: Names
    special: str
    span: float
    late: frozenset[str] = frozenset()
    tree: Tree = field(default_factory=dict)

    @property
    def bodies(self) -> list[str]:
        """Names of the bodies so far."""
        return list(self.tree["body"])

    def mass(self, body: str) -> float:
        """Mass of a body, kg; infinite for the ground."""
        return float(self.tree["body"][body]["mass_kg"]) if body != GROUND else float("inf")

    def reduced(self, bodies: list[str]) -> float:
        """Reduced mass, kg, of a force between two bodies."""
        return 1.0 / sum(1.0 / self.mass(body) for body in bodies)

    def cg(self, body: str) -> list[float]:
        """Layout point of a body's mass centre."""
        return list(self.tree["body"][body]["cg_m"])
