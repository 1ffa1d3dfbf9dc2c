"""State that the emitters of one kernel share: the specification that it is written for, the fields
added to its workspace so far, and helpers for names of fields and for rejecting cases. A workspace
path is code of the index of a number in the workspace, without the lane."""

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
    """State that the emitters of one kernel share while it is being written: its specification
    (``spec``, ``solver``, ``history``), the fields of its ``workspace``, and in ``case`` the values
    that depend on the parameters of a case alone.

    Any emitter may add fields to the workspace and use expressions of ``case``, which are computed
    before a case is integrated. The function that computes these, and the offsets of the fields,
    are therefore written last. ``solver`` is the name of the integration method, or AUTO;
    ``history`` (NO_HISTORY, SEPARATION_HISTORY or FULL_HISTORY) states which rows over time the
    kernel writes.
    """

    spec: KernelSpec
    solver: str  # name of the Runge-Kutta method, or AUTO (`sepmc.kernel.spec.methods`)
    # which rows over time the kernel writes: `NO_HISTORY`, `SEPARATION_HISTORY` or `FULL_HISTORY`
    # of `sepmc.routines.layout`
    history: int
    workspace: Workspace = field(default_factory=Workspace)

    def __post_init__(self):
        self.case = Case(Scope(self.workspace), self.spec)

    def methods(self, segment: Segment) -> tuple[Method, ...]:
        """Integration methods of a segment that the kernel contains, the most accurate first; each
        run selects one of them."""
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
        """Workspace paths of the times of kind changes of joints and of stroke ends within
        segments: a full history has rows just before and after them. Empty for other histories."""
        if self.history != FULL_HISTORY:
            return []
        return [change_time(*change) for change in self.recorded_changes] + [
            stroke_end_time(self.spec, spring) for spring in self.spec.stroke_springs
        ]

    @property
    def recorded_changes(self) -> list[tuple[str, int]]:
        """Kind changes within segments whose times are recorded, as pairs (joint, number of the new
        kind): all for a full history, else those of partial releases, whose times are outcomes."""
        changes = self.spec.kind_changes
        if self.history == FULL_HISTORY:
            return changes
        return [change for change in changes if change in self.spec.partial_releases]

    @property
    def monitored_joints(self) -> tuple[str, ...]:
        """Names of the joints whose loads are computed between the ends of steps: those whose loads
        are outputs, then those with conditions on their loads."""
        return tuple(
            dict.fromkeys(
                [
                    *self.output_joints,
                    *(load.item for segment in self.spec.segments for load in segment.loads),
                ]
            )
        )

    def layer(self, body: str) -> str:
        """Name of the workspace field of the atmosphere layer of a body; of one common field if no
        body leaves its layer."""
        return f"LAYER_{body}" if self.spec.layer_borders else "AIR"

    @property
    def may_idle(self) -> bool:
        """True if a lane may finish a segment before others; it then takes steps of zero length,
        which change no bit of its case."""
        return any(self.has_lane_steps(segment) for segment in self.spec.segments)

    def has_lane_steps(self, segment: Segment) -> bool:
        """True if each lane has its own number of steps in a segment: events, load switches or
        samples divide the segment, or ``solver.step`` limits the step."""
        return segment.max_intervals > 1 or self.spec.scene.solver.step is not None

    @property
    def output_joints(self) -> tuple[str, ...]:
        """Names of the joints whose peak loads and impulses are outputs."""
        return self.spec.scene.output.loads

    @property
    def output_guides(self) -> tuple[str, ...]:
        """Names of the joints whose pin loads are outputs."""
        return self.spec.scene.output.guide

    @property
    def guide_joints(self) -> list[str]:
        """Names of all joints with guide pins; a full history has their pin loads."""
        return [name for name, joint in self.spec.scene.joint.items() if joint.guide is not None]

    def pins(self, joint: str) -> int:
        """Number of guide pins of a joint that has them."""
        guide = self.spec.scene.joint[joint].guide
        assert guide is not None
        return guide.pins

    @property
    def node_size(self) -> int:
        """Number of load components that are stored for each node, an instant of a step at which
        loads are evaluated: force and moment of each monitored joint; then, of each output guide,
        three for the driving force and, of each of its pins, three for each of the two ends as if
        friction balanced that force, and three for each end as it is."""
        return 6 * len(self.monitored_joints) + 3 * sum(
            1 + 4 * self.pins(joint) for joint in self.output_guides
        )

    @property
    def guide_fields(self) -> Iterator[tuple[str, int, int, list[int]]]:
        """Yield for each output guide: the name of its joint; the index of its first component
        among those of a node (`node_size`); the component of the field GUIDES with its sliding time
        (followed by its minimum ratio of driving force to pin load); the first of the three
        components of GUIDES for the peak of each end of each pin."""
        first, offset = 6 * len(self.monitored_joints), 0
        for joint in self.output_guides:
            ends = 2 * self.pins(joint)
            yield joint, first, offset, [offset + 2 + 3 * k for k in range(ends)]
            first, offset = first + 3 * (1 + 2 * ends), offset + 2 + 3 * ends

    def monitors_outputs(self, segment: Segment) -> bool:
        """True if, in a segment, a joint with loads as outputs may have constraint rows, or pins
        with loads as outputs may slide."""
        return any(map(segment.constrains, self.output_joints)) or any(
            map(segment.sliding_kinds, self.output_guides)
        )

    def needs_wrenches(self, segment: Segment) -> bool:
        """True if joint loads must be computed in a segment: for outputs, conditions on joint loads
        or a full history."""
        return self.monitors_loads(segment) or self.history == FULL_HISTORY

    def monitors_loads(self, segment: Segment) -> bool:
        """True if loads are evaluated within every step of a segment: for outputs or conditions on
        joint loads."""
        return self.monitors_outputs(segment) or bool(segment.loads)

    def alias_of(self, segment: Segment) -> str:
        """Name of the next segment if its derivative and projection serve this one too
        (`Segment.alias_of`), and so do its joint loads; else ""."""
        after = next((one for one in self.spec.segments if one.name == segment.alias_of), None)
        if after is None:
            return ""
        loads, loads_after = (
            (
                self.monitors_loads(one),
                self.spec.friction_joints(one),
                [one.sliding_kinds(joint) for joint in self.output_guides],
            )
            for one in (segment, after)
        )
        return after.name if loads == loads_after else ""

    def emit_alias(self, out: Text, segment: Segment, function: str) -> bool:
        """Write, for a segment with an alias (`alias_of`), the kernel function
        ``FUNCTION_SEGMENT(w)``, which only calls that of the alias; SEGMENT is the name of a
        segment. Return True if it was written; False without an alias."""
        after = self.alias_of(segment)
        if after:
            text = out.function(
                f"{function}_{segment.name}(w)", f"Phase {segment.name}: as in {after}."
            )
            text(f"{function}_{after}(w)")
        return bool(after)

    def active_clearances(self, segment: Segment) -> list[int]:
        """Numbers of the clearances that may be measured in a segment: those measured from the
        start of a case, and those whose joint ``after`` may be free in it."""
        entries = enumerate(self.spec.scene.clearance)
        return [
            i
            for i, clearance in entries
            if clearance.after is None or segment.free_kinds(clearance.after)
        ]

    def needs_interpolation(self, segment: Segment) -> bool:
        """True if the kernel computes states between the ends of the steps of a segment: for joint
        loads, which outcomes or a condition need, or for clearances. Other ends of a segment (a
        time, a stroke) need no such states."""
        return self.monitors_loads(segment) or bool(self.active_clearances(segment))

    def uses_extension(self, segment: Segment) -> bool:
        """True if states between the ends of steps are needed in a segment: for outcomes, for its
        end, or for a full history. Its method then has a continuous extension."""
        return self.history == FULL_HISTORY or self.needs_interpolation(segment)

    @property
    def has_extension(self) -> bool:
        """True if states between the ends of steps are needed in any segment."""
        return any(self.uses_extension(segment) for segment in self.spec.segments)

    @property
    def size(self) -> int:
        """Number of components of the state vector: 13 per body, one for the work of all loads, and
        the states of signals."""
        return 13 * len(self.spec.bodies) + 1 + self.spec.n_signal_states

    @property
    def indicators(self) -> list[str]:
        """Names of the error indicators of a case, in the order of the field INDICATORS.

        First, of each body, the maximum embedded error of its velocity V, attitude Q and angular
        rate OMEGA; then, of each event and joint load condition of each segment, the time per unit
        of its condition (such as s/m), which converts an error of the state to one of the event
        time; then those of the loads of output joints (`load_indicators`).
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
        """Names of the error indicators of the integrated force and moment of each output joint
        (`sepmc.routines.peaks.truncation`): "load_force_JOINT", "load_moment_JOINT"."""
        return [
            f"load_{what}_{joint}" for joint in self.output_joints for what in ("force", "moment")
        ]

    def indicator(self, name: str) -> str:
        """Workspace path of an error indicator, by its name, one of `indicators`; ValueError for
        any other name."""
        return component("INDICATORS", self.indicators.index(name))

    @property
    def model(self) -> Any:
        """Record of the scene (`sepmc.routines.layout.STRUCTURE`): counts of its elements, and
        positions of their data. The end of a name says in which array
        (`sepmc.routines.layout.Model`): ``loads_p`` is an index in the parameters of a case."""
        return self.spec.layout.model.scene[0]

    def start(self, field: str, value: float) -> None:
        """Add a workspace field of one component that has ``value`` at the start of every case; if
        the field exists, change nothing."""
        if self.workspace.add(field, 1):
            self.case.scope.store(field, value)

    def scope(self) -> Scope:
        """Return a new scope, to be written as a loop over lanes; it may use expressions of
        ``case``."""
        return Scope(self.workspace, self.case.scope)


def change_time(joint: str, number: int) -> str:
    """Name of the workspace field of the time, s, at which a joint changed to the kind with this
    number, or past it to one of a higher number; NaN before."""
    return f"CHANGE_TIME_{joint}_{number}"


def stroke_end_time(spec: KernelSpec, spring: str) -> str:
    """Workspace path of the time at which a spring, one of `KernelSpec.stroke_columns`, reached the
    end of its stroke."""
    return component(STROKE_END_TIMES, spec.stroke_columns.index(spring))


def has_kind(joint: str, kinds: tuple[int, ...]) -> str:
    """Kernel code, within a loop over lanes, of the condition that the present kind of a joint has
    one of these numbers; comparisons of several are joined by ``or`` without parentheses."""
    return " or ".join(f"w[KIND_{joint} + l] == {number}.0" for number in kinds)


def component(field: str, k: int) -> str:
    """Workspace path (code of an index, without the lane) of component ``k`` of a field."""
    return f"{field} + {k} * LANES" if k else field


def state_offset(number: int) -> str:
    """Code of the offset, within a state vector, of the signal state with this number, counted from
    0 over all signals, such as ``SIGNALS + 2 * LANES``."""
    return component("SIGNALS", number)


def origin_height(scope: Scope, time: Expr) -> Expr:
    """Height above the ground, m, at a time, s, of the origin from which positions in the state are
    counted: it moves with the initial velocity of the vehicle."""
    return scope.load("ORIGIN_HEIGHT") + scope.load("ORIGIN_CLIMB") * time


def height(scope: Scope, body: str) -> Expr:
    """Height of the mass centre of a body, not GROUND, above the ground, m, at the state Y."""
    return scope.load(f"Y + X_{body}", 3)[1] + origin_height(scope, scope.load("T"))


def reject_unless(scope: Scope, condition: Expr, status: int = FINER_STEPS) -> None:
    """Add lines to a scope that reject the case of a lane, unless it is rejected already, where a
    condition is not satisfied: its status is stored in the field REJECTED.

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
    """Add lines to a scope that reject the case of a lane, unless it is rejected already, where a
    condition is satisfied; ``status`` is as in `reject_unless`. A comparison with NaN is not
    satisfied, so it does not reject here, but does in `reject_unless`."""
    _reject(scope, where(condition, float(status), 0.0))


def _reject(scope: Scope, status: Expr) -> None:
    """Add lines to a scope that store ``status`` in REJECTED unless that is set already; a status
    0 rejects nothing."""
    rejected = scope.load("REJECTED")
    scope.store("REJECTED", where(rejected.equals(0.0), status, rejected))


def rejection_unless(condition: str, status: int = FINER_STEPS) -> str:
    """Line of kernel code, for a loop over lanes, that rejects the case of a lane, unless it is
    rejected already, where ``condition`` (kernel code) is not satisfied; ``status`` as in
    `reject_unless`."""
    return (
        f"w[REJECTED + l] = {float(status)} if w[REJECTED + l] == 0.0 and not ({condition}) else "
        "w[REJECTED + l]"
    )
