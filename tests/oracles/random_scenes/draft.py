"""A scene while it is drawn: its tree so far, and what its parts must know of each other."""

from dataclasses import dataclass, field
from typing import Any

from oracles.random_scenes.names import Names
from oracles.random_scenes.rng import Dice

Tree = dict[str, Any]
GROUND = "ground"


@dataclass
class Draft:
    """The tree of a campaign file while it is drawn.

    ``special`` names the special structure the scene has ("" for none), ``span`` its flight time in
    s, ``late`` the later kinds of feature it may have, see `oracles.random_scenes.scenes.LATE`.
    """

    dice: Dice
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
        """Mass that a force between two bodies moves, kg."""
        return 1.0 / sum(1.0 / self.mass(body) for body in bodies)

    def cg(self, body: str) -> list[float]:
        """Layout point of a body's mass centre."""
        return list(self.tree["body"][body]["cg_m"])
