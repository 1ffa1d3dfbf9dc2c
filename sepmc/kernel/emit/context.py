"""What the parts of a written kernel share while it is being written."""

from collections.abc import Iterator
from dataclasses import dataclass, field
from typing import Any

from sepmc.kernel.emit.case import Case
from sepmc.kernel.spec.kernel_spec import KernelSpec, Segment
from sepmc.kernel.spec.methods import Method, methods_of
from sepmc.kernel.tracer.text import Text, Workspace
from sepmc.kernel.tracer.tracer import Expr, Scope, where
from sepmc.routines.layout import FINER_STEPS, FULL_HISTORY


@dataclass
class Context:
    """What a module is written for, and what its parts have asked for so far.

    Any component may add workspace, and ask for expressions of the ``case``, which are computed
    before a flight. The function that does this and the constants of the workspace are therefore
    written last."""

    spec: KernelSpec
    solver: str  # name of its Runge-Kutta method
    # what is written over time: `NO_HISTORY`, `SEPARATION_HISTORY`, `FULL_HISTORY` of
    # `sepmc.routines.layout`
    history: int
    workspace: Workspace = field(default_factory=Workspace)

    def __post_init__(self):
        self.case = Case(Scope(self.workspace), self.spec)

    def methods(self, segment: Segment) -> tuple[Method, ...]:
        """Methods by which a segment may be flown, the most exact first."""
        return methods_of(self.solver, self.uses_extension(segment), self.has_extension)

    @property
    def used(self) -> dict[str, Method]:
        """All methods that segments may be flown by, by their names."""
        return {rk.name: rk for segment in self.spec.segments for rk in self.methods(segment)}

    @property
    def extended(self) -> Method:
        """The method of segments whose states between the ends of steps are needed."""
        found = methods_of(self.solver, True)
        assert len(found) == 1
        return found[0]

    @property
    def change_times(self) -> list[str]:
        """Workspace of the times within segments on both sides of which a full history has rows:
        joints take another of their kinds, springs end their strokes."""
        if self.history != FULL_HISTORY:
            return []
        return [went(*change) for change in self.spec.kind_changes] + [
            spent(spring) for spring in self.spec.stroke_springs
        ]

    @property
    def monitored_joints(self) -> tuple[str, ...]:
        """Joints whose loads are computed between the ends of steps: those that are watched, then
        those that break."""
        return tuple(
            dict.fromkeys(
                [
                    *self.output_joints,
                    *(load.item for segment in self.spec.segments for load in segment.loads),
                ]
            )
        )

    def layer(self, body: str) -> str:
        """The field of the layer of air in which a body flies: that of all, if none can leave
        it."""
        return f"LAYER_{body}" if self.spec.layer_borders else "AIR"

    @property
    def may_idle(self) -> bool:
        """Whether lanes may be through with a segment before others: steps of no length then leave
        a case as it is, to the last bit."""
        return any(self.has_lane_steps(segment) for segment in self.spec.segments)

    def has_lane_steps(self, segment: Segment) -> bool:
        """Whether lanes go through a phase each in steps of its own, and not all in as many: where
        events and switches divide it, or steps are to be no longer than so many seconds."""
        return segment.max_intervals > 1 or self.spec.scene.solver.step is not None

    @property
    def output_joints(self) -> tuple[str, ...]:
        """Joints whose loads are followed over the flight."""
        return self.spec.scene.output.loads

    @property
    def output_guides(self) -> tuple[str, ...]:
        """Joints whose pins are followed over the flight."""
        return self.spec.scene.output.guide

    @property
    def guide_joints(self) -> list[str]:
        """Joints whose pins a full history tells of."""
        return [name for name, joint in self.spec.scene.joint.items() if joint.guide is not None]

    def pins(self, joint: str) -> int:
        """Number of pins of a joint."""
        guide = self.spec.scene.joint[joint].guide
        assert guide is not None
        return guide.pins

    @property
    def node_size(self) -> int:
        """Numbers that are followed: force and moment of joints; of guides what drives them, and
        the forces of each pin at both ends, if friction held the guide and as they are."""
        return 6 * len(self.monitored_joints) + 3 * sum(
            1 + 4 * self.pins(joint) for joint in self.output_guides
        )

    @property
    def guide_fields(self) -> Iterator[tuple[str, int, int, list[int]]]:
        """Of every guide that is followed: where its numbers start among those at a node; in
        GUIDES, where the time stands for which it slid, with the least friction that jams behind
        it, and the peaks of both ends of each pin."""
        first, place = 6 * len(self.monitored_joints), 0
        for joint in self.output_guides:
            ends = 2 * self.pins(joint)
            yield joint, first, place, [place + 2 + 3 * k for k in range(ends)]
            first, place = first + 3 * (1 + 2 * ends), place + 2 + 3 * ends

    def monitors_outputs(self, segment: Segment) -> bool:
        """Whether a joint whose loads are asked for holds something in a phase, or pins may slide
        that are."""
        return any(map(segment.constrains, self.output_joints)) or any(
            map(segment.sliding_kinds, self.output_guides)
        )

    def needs_wrenches(self, segment: Segment) -> bool:
        """Whether what joints carry in a phase is asked for."""
        return self.monitors_loads(segment) or self.history == FULL_HISTORY

    def monitors_loads(self, segment: Segment) -> bool:
        """Whether loads are followed over the steps of a phase: asked for, or waited for."""
        return self.monitors_outputs(segment) or bool(segment.loads)

    def wrenches_from_rates(self, segment: Segment) -> bool:
        """Whether the derivative in a phase gives what is followed of joints too: all but pins, and
        redundant rows' least sum of squares."""
        plain = not segment.needs_min_norm and not any(
            map(segment.sliding_kinds, self.output_guides)
        )
        return self.monitors_loads(segment) and plain

    def alias_of(self, segment: Segment) -> str:
        """The name of the segment whose derivative and correction fly this one too, if one does."""
        after = next((one for one in self.spec.segments if one.name == segment.alias_of), None)
        if after is None:
            return ""
        alike = (self.wrenches_from_rates(segment), self.spec.friction_joints(segment)) == (
            self.wrenches_from_rates(after),
            self.spec.friction_joints(after),
        )
        return after.name if alike else ""

    def emit_alias(self, out: Text, segment: Segment, what: str) -> bool:
        """Write a function of a segment that only calls that of the segment by which it is flown.
        Returns whether there is such a segment."""
        after = self.alias_of(segment)
        if after:
            text = out.function(
                f"{what}_{segment.name}(w)", f"Phase {segment.name}: as in {after}."
            )
            text(f"{what}_{after}(w)")
        return bool(after)

    def active_clearances(self, segment: Segment) -> list[int]:
        """Clearances that count in a phase: from the start, or once their joint is free."""
        entries = enumerate(self.spec.scene.clearance)
        return [i for i, one in entries if one.after is None or segment.free_kinds(one.after)]

    def needs_interpolation(self, segment: Segment) -> bool:
        """Whether outcomes or the end of a phase depend on states between the ends of its steps."""
        return self.monitors_loads(segment) or bool(self.active_clearances(segment))

    def uses_extension(self, segment: Segment) -> bool:
        """Whether such states are needed in a phase, be it for a full history only."""
        return self.history == FULL_HISTORY or self.needs_interpolation(segment)

    @property
    def has_extension(self) -> bool:
        """Whether they are needed in any."""
        return any(self.uses_extension(segment) for segment in self.spec.segments)

    @property
    def size(self) -> int:
        """Numbers of a state: of every body, and the work of all loads."""
        return 13 * len(self.spec.bodies) + 1

    @property
    def indicators(self) -> list[str]:
        """Numbers that tell how hard a case is to integrate. Of every body, what a step may do
        wrong to its velocity V, attitude Q and rate OMEGA; of every event, how long its condition
        takes for a metre or a radian: the error of its time."""
        of_bodies = [f"{what}_{body}" for body in self.spec.bodies for what in ("V", "Q", "OMEGA")]
        events = [
            (segment, event)
            for segment in self.spec.segments
            for event in (*segment.events, *segment.loads)
        ]
        return [
            *of_bodies,
            *(f"{segment.name}_{event.name}" for segment, event in events),
            *self.load_indicators,
        ]

    @property
    def load_indicators(self) -> list[str]:
        """Of every joint that is watched, how sharply its force and its moment turn within a step
        (`peaks.update_size`)."""
        return [
            f"load_{what}_{joint}" for joint in self.output_joints for what in ("force", "moment")
        ]

    def indicator(self, name: str) -> str:
        """The place of a indicator."""
        return component("INDICATORS", self.indicators.index(name))

    @property
    def model(self) -> Any:
        """The record that says where everything stands in the vector of parameters."""
        return self.spec.layout.model.scene[0]

    def start(self, field: str, value: float) -> None:
        """A field of one number a case, and what stands there before a flight."""
        if self.workspace.add(field, 1):
            self.case.scope.store(field, value)

    def scope(self) -> Scope:
        """A new loop over lanes."""
        return Scope(self.workspace, self.case.scope)


def went(joint: str, number: int) -> str:
    """The field of the time at which a joint took a kind, by number."""
    return f"CHANGE_TIME_{joint}_{number}"


def spent(spring: str) -> str:
    """The field of the time at which a spring ended its stroke."""
    return f"STROKE_END_TIME_{spring}"


def among(joint: str, kinds: tuple[int, ...]) -> str:
    """The condition, for a lane, that a joint holds one of some kinds."""
    return " or ".join(f"w[KIND_{joint} + l] == {number}.0" for number in kinds)


def component(field: str, k: int) -> str:
    """The place of number ``k`` of a field."""
    return f"{field} + {k} * LANES" if k else field


def level(scope: Scope, time: Expr) -> Expr:
    """Height at some time of what places are seen from: it moves with the vehicle's first speed."""
    return scope.load("ORIGIN_HEIGHT") + scope.load("ORIGIN_CLIMB") * time


def height(scope: Scope, body: str) -> Expr:
    """Height of a body's mass centre at the end of a step."""
    return scope.load(f"Y + X_{body}", 3)[1] + level(scope, scope.load("T"))


def reject_unless(scope: Scope, unless: Expr, status: int = FINER_STEPS) -> None:
    """A case that is not lost yet is, where a condition does not hold: with a status, or for finer
    steps or another kernel to tell."""
    _reject(scope, where(unless, 0.0, float(status)))


def reject_if(scope: Scope, condition: Expr, status: int = FINER_STEPS) -> None:
    """The same where a condition holds."""
    _reject(scope, where(condition, float(status), 0.0))


def _reject(scope: Scope, status: Expr) -> None:
    lost = scope.load("REJECTED")
    scope.store("REJECTED", where(lost.equals(0.0), status, lost))


def rejection_unless(condition: str, status: int = FINER_STEPS) -> str:
    """The line for it, for a lane."""
    return (
        f"w[REJECTED + l] = {float(status)} if w[REJECTED + l] == 0.0 and not ({condition}) else "
        "w[REJECTED + l]"
    )
