"""State of the emitter: the specification that a kernel is written for, and what the emitters have
added to its workspace."""

from collections.abc import Iterator
from dataclasses import dataclass, field
from typing import Any

from sepmc.kernel.emit.case import Case
from sepmc.kernel.spec.kernel_spec import KernelSpec, Segment
from sepmc.kernel.spec.methods import Method, methods_of
from sepmc.kernel.tracer.text import Text, Workspace
from sepmc.kernel.tracer.tracer import Expr, Scope, where
from sepmc.routines.layout import FINER_STEPS, FULL_HISTORY

STROKE_END_TIMES = "STROKE_END_TIMES"  # field of the times of all springs with a column


@dataclass
class Context:
    """What the emitters of one kernel share while it is being written: its specification (``spec``,
    ``solver``, ``history``), its ``workspace``, and the values of a ``case``.

    Any emitter may add fields to the workspace and use expressions of the ``case``, which are
    computed before a case is integrated. The function that computes these, and the offsets of the
    fields, are therefore written last.
    """

    spec: KernelSpec
    solver: str  # name of the Runge-Kutta method
    # rows over time: `NO_HISTORY`, `SEPARATION_HISTORY` or `FULL_HISTORY` of
    # `sepmc.routines.layout`
    history: int
    workspace: Workspace = field(default_factory=Workspace)

    def __post_init__(self):
        self.case = Case(Scope(self.workspace), self.spec)

    def methods(self, segment: Segment) -> tuple[Method, ...]:
        """Methods that a segment may be integrated by, the most accurate first."""
        return methods_of(self.solver, self.uses_extension(segment), self.has_extension)

    @property
    def used(self) -> dict[str, Method]:
        """Integration methods of all segments of the kernel, by name."""
        return {rk.name: rk for segment in self.spec.segments for rk in self.methods(segment)}

    @property
    def extended(self) -> Method:
        """Integration method of the segments whose states between the ends of steps are needed: it
        has a continuous extension."""
        methods = methods_of(self.solver, True)
        assert len(methods) == 1
        return methods[0]

    @property
    def change_times(self) -> list[str]:
        """Fields of the times of kind changes and stroke ends within segments: a full history has
        rows just before and after them. Empty for other histories."""
        if self.history != FULL_HISTORY:
            return []
        return [change_time(*change) for change in self.recorded_changes] + [
            stroke_end_time(self.spec, spring) for spring in self.spec.stroke_springs
        ]

    @property
    def recorded_changes(self) -> list[tuple[str, int]]:
        """Joints and kind numbers whose times are recorded: all for a full history, else those of
        partial releases, which are outcomes."""
        changes = self.spec.kind_changes
        if self.history == FULL_HISTORY:
            return changes
        return [change for change in changes if change in self.spec.partial_releases]

    @property
    def monitored_joints(self) -> tuple[str, ...]:
        """Joints whose loads are computed between the ends of steps: those of the outputs, then
        those with load events."""
        return tuple(
            dict.fromkeys(
                [
                    *self.output_joints,
                    *(load.item for segment in self.spec.segments for load in segment.loads),
                ]
            )
        )

    def layer(self, body: str) -> str:
        """Field of the atmosphere layer of a body; a common one if no body can leave its layer."""
        return f"LAYER_{body}" if self.spec.layer_borders else "AIR"

    @property
    def may_idle(self) -> bool:
        """True if lanes may finish a segment before others; they then take steps of zero length,
        which change no bit of a case."""
        return any(self.has_lane_steps(segment) for segment in self.spec.segments)

    def has_lane_steps(self, segment: Segment) -> bool:
        """True if each lane has a step length of its own in a segment: events and load switches
        divide it, or ``solver.step`` limits the step."""
        return segment.max_intervals > 1 or self.spec.scene.solver.step is not None

    @property
    def output_joints(self) -> tuple[str, ...]:
        """Joints whose peak loads and impulses are outputs."""
        return self.spec.scene.output.loads

    @property
    def output_guides(self) -> tuple[str, ...]:
        """Joints whose pin loads are outputs."""
        return self.spec.scene.output.guide

    @property
    def guide_joints(self) -> list[str]:
        """Joints with pins; a full history has their loads."""
        return [name for name, joint in self.spec.scene.joint.items() if joint.guide is not None]

    def pins(self, joint: str) -> int:
        """Number of pins of a joint."""
        guide = self.spec.scene.joint[joint].guide
        assert guide is not None
        return guide.pins

    @property
    def node_size(self) -> int:
        """Number of monitored load components at each of the instants of a step at which loads are
        evaluated: force and moment of joints; of guides the driving force, then the pin forces at
        both ends as if friction balanced that force, and as they are."""
        return 6 * len(self.monitored_joints) + 3 * sum(
            1 + 4 * self.pins(joint) for joint in self.output_guides
        )

    @property
    def guide_fields(self) -> Iterator[tuple[str, int, int, list[int]]]:
        """For each output guide: its joint; the index of its first component among those of a node
        (`node_size`); the index in GUIDES of its sliding time (the minimum ratio of driving force
        to pin load comes next); the indices in GUIDES of the peaks of both ends of each pin."""
        first, offset = 6 * len(self.monitored_joints), 0
        for joint in self.output_guides:
            ends = 2 * self.pins(joint)
            yield joint, first, offset, [offset + 2 + 3 * k for k in range(ends)]
            first, offset = first + 3 * (1 + 2 * ends), offset + 2 + 3 * ends

    def monitors_outputs(self, segment: Segment) -> bool:
        """True if a segment has loads of joints or pins that are outputs."""
        return any(map(segment.constrains, self.output_joints)) or any(
            map(segment.sliding_kinds, self.output_guides)
        )

    def needs_wrenches(self, segment: Segment) -> bool:
        """True if joint loads are computed in a segment, for outputs, load events or a full
        history."""
        return self.monitors_loads(segment) or self.history == FULL_HISTORY

    def monitors_loads(self, segment: Segment) -> bool:
        """True if loads are monitored over the steps of a segment, for outputs or load events."""
        return self.monitors_outputs(segment) or bool(segment.loads)

    def wrenches_from_rates(self, segment: Segment) -> bool:
        """True if the function of a segment's derivative also stores its monitored loads: possible
        without sliding output pins and without a minimum-norm solution."""
        plain = not segment.needs_min_norm and not any(
            map(segment.sliding_kinds, self.output_guides)
        )
        return self.monitors_loads(segment) and plain

    def alias_of(self, segment: Segment) -> str:
        """Name of the segment whose derivative and projection serve this one too, or ""."""
        after = next((one for one in self.spec.segments if one.name == segment.alias_of), None)
        if after is None:
            return ""
        equal = (self.wrenches_from_rates(segment), self.spec.friction_joints(segment)) == (
            self.wrenches_from_rates(after),
            self.spec.friction_joints(after),
        )
        return after.name if equal else ""

    def emit_alias(self, out: Text, segment: Segment, function: str) -> bool:
        """Write a function of a segment that only calls that of the segment in `alias_of`.

        Returns True if there is such a segment.
        """
        after = self.alias_of(segment)
        if after:
            text = out.function(
                f"{function}_{segment.name}(w)", f"Phase {segment.name}: as in {after}."
            )
            text(f"{function}_{after}(w)")
        return bool(after)

    def active_clearances(self, segment: Segment) -> list[int]:
        """Numbers of the clearances that are measured in a segment: from the start, or once their
        joint is free."""
        entries = enumerate(self.spec.scene.clearance)
        return [
            i
            for i, clearance in entries
            if clearance.after is None or segment.free_kinds(clearance.after)
        ]

    def needs_interpolation(self, segment: Segment) -> bool:
        """True if outcomes or the end of a segment depend on states between the ends of steps."""
        return self.monitors_loads(segment) or bool(self.active_clearances(segment))

    def uses_extension(self, segment: Segment) -> bool:
        """True if states between the ends of steps are needed in a segment: for outcomes, for its
        end, or for a full history."""
        return self.history == FULL_HISTORY or self.needs_interpolation(segment)

    @property
    def has_extension(self) -> bool:
        """True if states between the ends of steps are needed in any segment."""
        return any(self.uses_extension(segment) for segment in self.spec.segments)

    @property
    def size(self) -> int:
        """Number of components of a state: 13 per body, the work of all loads, and the states of
        signals."""
        return 13 * len(self.spec.bodies) + 1 + self.spec.n_signal_states

    @property
    def indicators(self) -> list[str]:
        """Names of the error indicators of a case.

        Of each body, the embedded error of its velocity V, attitude Q and angular rate OMEGA; of
        each event, the time per unit of its condition (s/m, s/rad), which scales the error of the
        event time; those of loads.
        """
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
        """Names of the error indicators of the impulses of each output joint's force and moment
        (`sepmc.routines.peaks.truncation`)."""
        return [
            f"load_{what}_{joint}" for joint in self.output_joints for what in ("force", "moment")
        ]

    def indicator(self, name: str) -> str:
        """Workspace path of an error indicator, by its name."""
        return component("INDICATORS", self.indicators.index(name))

    @property
    def model(self) -> Any:
        """Record of the scene's counts and the positions of its blocks
        (`sepmc.routines.layout.Model`)."""
        return self.spec.layout.model.scene[0]

    def start(self, field: str, value: float) -> None:
        """Add a workspace field of one component, if it is new, that has ``value`` at the start of
        every case."""
        if self.workspace.add(field, 1):
            self.case.scope.store(field, value)

    def scope(self) -> Scope:
        """New scope, to be written as a loop over lanes; it may use values of the case."""
        return Scope(self.workspace, self.case.scope)


def change_time(joint: str, number: int) -> str:
    """Field of the time at which a joint changed to the kind of this number."""
    return f"CHANGE_TIME_{joint}_{number}"


def stroke_end_time(spec: KernelSpec, spring: str) -> str:
    """Workspace path of the time at which a spring reached the end of its stroke."""
    return component(STROKE_END_TIMES, spec.stroke_columns.index(spring))


def has_kind(joint: str, kinds: tuple[int, ...]) -> str:
    """Code, within a loop over lanes, of the condition that a joint now has one of the kinds with
    these numbers."""
    return " or ".join(f"w[KIND_{joint} + l] == {number}.0" for number in kinds)


def component(field: str, k: int) -> str:
    """Index expression of component ``k`` of a field of the workspace."""
    return f"{field} + {k} * LANES" if k else field


def state_offset(number: int) -> str:
    """Code of the offset, within a state, of the signal state with this number."""
    return component("SIGNALS", number)


def origin_height(scope: Scope, time: Expr) -> Expr:
    """Height above the ground, m, at a time, of the origin that positions are counted from: it
    moves with the initial velocity of the vehicle."""
    return scope.load("ORIGIN_HEIGHT") + scope.load("ORIGIN_CLIMB") * time


def height(scope: Scope, body: str) -> Expr:
    """Height of the mass centre of a body, m, at the end of a step."""
    return scope.load(f"Y + X_{body}", 3)[1] + origin_height(scope, scope.load("T"))


def reject_unless(scope: Scope, condition: Expr, status: int = FINER_STEPS) -> None:
    """Reject a case, unless it is rejected already, where a condition is not satisfied.

    Parameters
    ----------
    scope : Scope
    condition : Expr
    status : int
        status of rejected cases: FINER_STEPS, a `Variant` that may integrate them, or a final
        `Status`
    """
    _reject(scope, where(condition, 0.0, float(status)))


def reject_if(scope: Scope, condition: Expr, status: int = FINER_STEPS) -> None:
    """Reject a case where a condition is satisfied; see `reject_unless`."""
    _reject(scope, where(condition, float(status), 0.0))


def _reject(scope: Scope, status: Expr) -> None:
    rejected = scope.load("REJECTED")
    scope.store("REJECTED", where(rejected.equals(0.0), status, rejected))


def rejection_unless(condition: str, status: int = FINER_STEPS) -> str:
    """Line of code, within a loop over lanes, that rejects the case of a lane, unless it is
    rejected already, where a condition (code) is not satisfied; ``status`` as in
    `reject_unless`."""
    return (
        f"w[REJECTED + l] = {float(status)} if w[REJECTED + l] == 0.0 and not ({condition}) else "
        "w[REJECTED + l]"
    )
