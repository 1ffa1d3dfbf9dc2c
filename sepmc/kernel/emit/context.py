"""What the parts of a written kernel share while it is being written."""

from collections.abc import Iterator
from dataclasses import dataclass, field
from typing import Any

from sepmc.kernel.emit.case import Case
from sepmc.kernel.spec.kernel_spec import Shape, Stage
from sepmc.kernel.spec.methods import Method, methods_of
from sepmc.kernel.tracer.text import Slabs, Text
from sepmc.kernel.tracer.tracer import Scope, Value, where
from sepmc.routines.layout import FINER_STEPS, FULL_HISTORY


@dataclass
class Context:
    """What a module is written for, and what its parts have asked for so far.

    Any part may add slabs, and ask for Values of the ``case``, which are computed before a flight.
    The function that does this and the constants of the slabs are therefore written last.
    """

    shape: Shape
    solver: str  # name of its Runge-Kutta method
    # what is written over time: `NO_HISTORY`, `SEPARATION_HISTORY`, `FULL_HISTORY` of
    # `sepmc.routines.layout`
    history: int
    slabs: Slabs = field(default_factory=Slabs)

    def __post_init__(self):
        self.case = Case(Scope(self.slabs), self.shape)

    def methods(self, stage: Stage) -> tuple[Method, ...]:
        """Methods by which a stage may be flown, the most exact first."""
        return methods_of(self.solver, self.notes(stage), self.extends)

    @property
    def used(self) -> dict[str, Method]:
        """All methods that stages may be flown by, by their names."""
        return {rk.name: rk for stage in self.shape.stages for rk in self.methods(stage)}

    @property
    def extended(self) -> Method:
        """The method of stages whose states between the ends of steps are needed."""
        found = methods_of(self.solver, True)
        assert len(found) == 1
        return found[0]

    @property
    def sudden(self) -> list[str]:
        """Slabs of the times within stages on both sides of which a full history has rows: joints
        take another of their kinds, springs end their strokes."""
        if self.history != FULL_HISTORY:
            return []
        return [went(*change) for change in self.shape.changing] + [
            spent(spring) for spring in self.shape.spent
        ]

    @property
    def followed(self) -> tuple[str, ...]:
        """Joints whose loads are computed between the ends of steps: those that are watched, then
        those that break."""
        return tuple(
            dict.fromkeys(
                [
                    *self.watched,
                    *(load.which for stage in self.shape.stages for load in stage.loads),
                ]
            )
        )

    def layer(self, body: str) -> str:
        """The slab of the layer of air in which a body flies: that of all, if none can leave it."""
        return f"LAYER_{body}" if self.shape.borders else "AIR"

    @property
    def idles(self) -> bool:
        """Whether lanes may be through with a stage before others: steps of no length then leave a
        case as it is, to the last bit."""
        return any(self.paces(stage) for stage in self.shape.stages)

    def paces(self, stage: Stage) -> bool:
        """Whether lanes go through a phase each in steps of its own, and not all in as many: where
        events and switches divide it, or steps are to be no longer than so many seconds."""
        return stage.stops > 1 or self.shape.scene.solver.step is not None

    @property
    def watched(self) -> tuple[str, ...]:
        """Joints whose loads are followed over the flight."""
        return self.shape.scene.output.loads

    @property
    def guides(self) -> tuple[str, ...]:
        """Joints whose pins are followed over the flight."""
        return self.shape.scene.output.guide

    @property
    def guided(self) -> list[str]:
        """Joints whose pins a full history tells of."""
        return [name for name, joint in self.shape.scene.joint.items() if joint.guide is not None]

    def pins(self, joint: str) -> int:
        """Number of pins of a joint."""
        guide = self.shape.scene.joint[joint].guide
        assert guide is not None
        return guide.pins

    @property
    def node_size(self) -> int:
        """Numbers that are followed: force and moment of joints; of guides what drives them, and
        the forces of each pin at both ends, if friction held the guide and as they are."""
        return 6 * len(self.followed) + 3 * sum(1 + 4 * self.pins(joint) for joint in self.guides)

    @property
    def noted_of_guides(self) -> Iterator[tuple[str, int, int, list[int]]]:
        """Of every guide that is followed: where its numbers start among those at a node; in
        GUIDES, where the time stands for which it slid, with the least friction that jams behind
        it, and the peaks of both ends of each pin."""
        first, place = 6 * len(self.followed), 0
        for joint in self.guides:
            ends = 2 * self.pins(joint)
            yield joint, first, place, [place + 2 + 3 * k for k in range(ends)]
            first, place = first + 3 * (1 + 2 * ends), place + 2 + 3 * ends

    def watches(self, stage: Stage) -> bool:
        """Whether a joint whose loads are asked for holds something in a phase, or pins may slide
        that are."""
        return any(map(stage.holds, self.watched)) or any(map(stage.sliding, self.guides))

    def carries(self, stage: Stage) -> bool:
        """Whether what joints carry in a phase is asked for."""
        return self.follows_loads(stage) or self.history == FULL_HISTORY

    def follows_loads(self, stage: Stage) -> bool:
        """Whether loads are followed over the steps of a phase: asked for, or waited for."""
        return self.watches(stage) or bool(stage.loads)

    def carried_by_rates(self, stage: Stage) -> bool:
        """Whether the derivative in a phase gives what is followed of joints too: all but pins, and
        redundant rows' least sum of squares."""
        plain = not stage.shares and not any(map(stage.sliding, self.guides))
        return self.follows_loads(stage) and plain

    def flown_as(self, stage: Stage) -> str:
        """The name of the stage whose derivative and correction fly this one too, if one does."""
        after = next((one for one in self.shape.stages if one.name == stage.flown_as), None)
        if after is None:
            return ""
        alike = (self.carried_by_rates(stage), self.shape.rubbing(stage)) == (
            self.carried_by_rates(after),
            self.shape.rubbing(after),
        )
        return after.name if alike else ""

    def hands_on(self, out: Text, stage: Stage, what: str) -> bool:
        """Write a function of a stage that only calls that of the stage by which it is flown.
        Returns whether there is such a stage."""
        after = self.flown_as(stage)
        if after:
            text = out.function(f"{what}_{stage.name}(w)", f"Phase {stage.name}: as in {after}.")
            text(f"{what}_{after}(w)")
        return bool(after)

    def counted(self, stage: Stage) -> list[int]:
        """Clearances that count in a phase: from the start, or once their joint is free."""
        entries = enumerate(self.shape.scene.clearance)
        return [i for i, one in entries if one.after is None or stage.free(one.after)]

    def follows(self, stage: Stage) -> bool:
        """Whether outcomes or the end of a phase depend on states between the ends of its steps."""
        return self.follows_loads(stage) or bool(self.counted(stage))

    def notes(self, stage: Stage) -> bool:
        """Whether such states are needed in a phase, be it for a full history only."""
        return self.history == FULL_HISTORY or self.follows(stage)

    @property
    def extends(self) -> bool:
        """Whether they are needed in any."""
        return any(self.notes(stage) for stage in self.shape.stages)

    @property
    def size(self) -> int:
        """Numbers of a state: of every body, and the work of all loads."""
        return 13 * len(self.shape.bodies) + 1

    @property
    def guards(self) -> list[str]:
        """Numbers that tell how hard a case is to integrate. Of every body, what a step may do
        wrong to its velocity V, attitude Q and rate OMEGA; of every event, how long its condition
        takes for a metre or a radian: the error of its time."""
        doubts = [f"{what}_{body}" for body in self.shape.bodies for what in ("V", "Q", "OMEGA")]
        events = [
            (stage, event) for stage in self.shape.stages for event in (*stage.events, *stage.loads)
        ]
        return [
            *doubts,
            *(f"{stage.name}_{event.name}" for stage, event in events),
            *self.load_guards,
        ]

    @property
    def load_guards(self) -> list[str]:
        """Of every joint that is watched, how sharply its force and its moment turn within a step
        (`peaks.update_size`)."""
        return [f"load_{what}_{joint}" for joint in self.watched for what in ("force", "moment")]

    def guard(self, name: str) -> str:
        """The place of a guard."""
        return part("GUARD", self.guards.index(name))

    @property
    def model(self) -> Any:
        """The record that says where everything stands in the vector of parameters."""
        return self.shape.plan.model.scene[0]

    def start(self, slab: str, value: float) -> None:
        """A slab of one number a case, and what stands there before a flight."""
        if self.slabs.add(slab, 1):
            self.case.scope.store(slab, value)

    def scope(self) -> Scope:
        """A new loop over lanes."""
        return Scope(self.slabs, self.case.scope)


def went(joint: str, number: int) -> str:
    """The slab of the time at which a joint took a kind, by number."""
    return f"WENT_{joint}_{number}"


def spent(spring: str) -> str:
    """The slab of the time at which a spring ended its stroke."""
    return f"WHEN_SPENT_{spring}"


def among(joint: str, kinds: tuple[int, ...]) -> str:
    """The condition, for a lane, that a joint holds one of some kinds."""
    return " or ".join(f"w[KIND_{joint} + l] == {number}.0" for number in kinds)


def part(slab: str, k: int) -> str:
    """The place of number ``k`` of a slab."""
    return f"{slab} + {k} * LANES" if k else slab


def level(scope: Scope, time: Value) -> Value:
    """Height at some time of what places are seen from: it moves with the vehicle's first speed."""
    return scope.load("ORIGIN_HEIGHT") + scope.load("ORIGIN_CLIMB") * time


def height(scope: Scope, body: str) -> Value:
    """Height of a body's mass centre at the end of a step."""
    return scope.load(f"Y + X_{body}", 3)[1] + level(scope, scope.load("T"))


def lose(scope: Scope, unless: Value, status: int = FINER_STEPS) -> None:
    """A case that is not lost yet is, where a condition does not hold: with a status, or for finer
    steps or another kernel to tell."""
    _lose(scope, where(unless, 0.0, float(status)))


def lose_if(scope: Scope, condition: Value, status: int = FINER_STEPS) -> None:
    """The same where a condition holds."""
    _lose(scope, where(condition, float(status), 0.0))


def _lose(scope: Scope, status: Value) -> None:
    lost = scope.load("LOST")
    scope.store("LOST", where(lost.equals(0.0), status, lost))


def lost_unless(condition: str, status: int = FINER_STEPS) -> str:
    """The line for it, for a lane."""
    return (
        f"w[LOST + l] = {float(status)} if w[LOST + l] == 0.0 and not ({condition}) else "
        "w[LOST + l]"
    )
