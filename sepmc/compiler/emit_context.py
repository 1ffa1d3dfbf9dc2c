"""What the parts of a specialised kernel share while it is being written."""

from dataclasses import dataclass, field
from typing import Any

from sepmc.compiler.shape import Shape
from sepmc.compiler.text import Slabs, Text
from sepmc.kernels.methods import Method


@dataclass
class Context:
    """What a module is written for, and what its parts have asked for so far.

    Any part may add slabs, and lines that set them up before a flight: ``parameters`` in the loop over lanes, ``shared`` before it. The
    function that holds these lines and the constants of the slabs are therefore written last.
    """

    shape: Shape
    method: Method
    history: bool
    slabs: Slabs = field(default_factory=Slabs)
    parameters: Text = field(default_factory=lambda: Text(2))
    shared: Text = field(default_factory=lambda: Text(1))

    @property
    def size(self) -> int:
        """Numbers of a state."""
        return 13 * len(self.shape.bodies)

    @property
    def guards(self) -> list[str]:
        """Numbers that tell how hard a case is to integrate. Of every body, what a step may do wrong to its velocity V, attitude Q and rate
        OMEGA; of every event, how long its condition takes for a metre or a radian: the error of its time."""
        doubts = [f"{what}_{body}" for body in self.shape.bodies for what in ("V", "Q", "OMEGA")]
        return doubts + [f"{stage.name}_{event.which}" for stage in self.shape.stages for event in stage.events]

    def guard(self, name: str) -> str:
        """The place of a guard."""
        return f"w[GUARD + {self.guards.index(name)} * LANES + l]"

    @property
    def model(self) -> Any:
        """The record that says where everything stands in the vector of parameters."""
        return self.shape.plan.model.scene[0]

    def shared_vector(self, start: int) -> str:
        """Name of a vector that all cases share, by its place in ``numbers`` and so in SHARED; it is read before the loop over lanes."""
        line = f"shared_{start} = vec3.get(w, SHARED + {start})"
        if line not in (known.strip() for known in self.shared.lines):
            self.shared(line)
        return f"shared_{start}"


def raw(place: int) -> str:
    """A parameter of a case by its place in the vector of parameters."""
    return f"w[P + {place} * LANES + l]"


def raw3(place: int) -> str:
    """A vector of parameters."""
    return f"get3(w, P + {place} * LANES + l)"
