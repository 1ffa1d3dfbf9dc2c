"""Kernel specification: everything the emitter needs to know of a scene and its dispersions.

It contains structure only (rigid groups, constraint rows, events, outputs), no numbers: scenes with
equal specifications share one compiled kernel.
"""

from dataclasses import dataclass, field
from functools import cached_property

from sepmc.kernel.spec.kinks import Formulas
from sepmc.kernel.spec.naming import Names
from sepmc.kernel.spec.parameter_layout import ParameterLayout
from sepmc.kernel.spec.step_cells import step_cells
from sepmc.kernel.spec.variant import Variant
from sepmc.routines import layout as at
from sepmc.scene.kinds import joint_axes, leaves_pins_sliding
from sepmc.scene.model import GROUND, Motor, Scene

_IDENTITY = (1.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 1.0)
# codes of the constraint rows of a joint by the number of its kind, the most rows first
Kinds = dict[int, tuple[int, ...]]


@dataclass(frozen=True)
class Row:
    """Constraint row of a joint.

    ``code`` is its type (`sepmc.routines.layout`: translation along an axis, rotation, rod). If the
    row is active only while its joint has some of the kinds possible in the segment, ``kinds`` has
    their numbers; empty: always active.
    """

    joint: str
    code: int
    kinds: tuple[int, ...] = ()

    @property
    def turns(self) -> bool:
        """True if the row constrains a rotation."""
        return at.ROTATION <= self.code < at.ROD


@dataclass(frozen=True)
class Event:
    """Condition on the state or on a joint load, compared with a threshold.

    ``quantity`` is its code (AT_STROKE, ... of `sepmc.routines.layout`) and ``item`` the joint,
    spring, body, kink or cell; ``threshold`` is a parameter index, or the axis of a cell. It either
    ends its phase by itself, or is condition ``number`` of several that end a phase together or,
    with ``any_phase``, trigger a release or an observation event. ``direction`` of the crossing
    that counts: rising, falling, either, or "" if the quantity may also start beyond the threshold.
    """

    quantity: int
    item: str
    threshold: int
    ends_phase: bool
    number: int = -1
    any_phase: bool = False
    direction: str = ""

    @property
    def name(self) -> str:
        """Name of the event, unique within its segment."""
        if self.is_cell_end:
            end = "top" if self.quantity == at.AT_CELL_TOP else "base"
            return f"{self.item}_{self.threshold}_{end}"
        if self.is_border:
            return f"{self.item}_{'top' if self.quantity == at.AT_LAYER_TOP else 'base'}"
        return self.item if self.number < 0 else f"{self.item}_{self.number}"

    @property
    def is_border(self) -> bool:
        """True for a border of the atmosphere layer of a body, or of the cell of a table; it may be
        crossed repeatedly."""
        return self.is_cell_end or self.quantity in (at.AT_LAYER_TOP, at.AT_LAYER_BASE)

    @property
    def is_cell_end(self) -> bool:
        """True for an end of the cell ``item`` of a table with kinks, along the axis
        ``threshold``."""
        return self.quantity in (at.AT_CELL_TOP, at.AT_CELL_BASE)

    def flag(self, segment: str) -> str:
        """Workspace field that is 1 once the event has occurred; of a kink, the field of the mode
        that it has from then on."""
        if self.is_border:
            return f"ENTERS_{self.item}"
        if self.quantity == at.AT_KINK:
            return f"SWITCH_{self.item}"
        if self.ends_phase:
            return "DONE"
        return (
            stroke_flag(self.item)
            if self.number < 0
            else condition_flag(ANY_PHASE if self.any_phase else segment, self.number)
        )


def stroke_flag(spring: str) -> str:
    """Workspace field that is 1 once a spring has reached the end of its stroke."""
    return f"SPENT_{spring}"


ANY_PHASE = "any_phase"  # in place of the segment, for conditions of releases and events


def condition_flag(segment: str, number: int) -> str:
    """Workspace field that is 1 once a numbered condition has been met."""
    return f"FLAG_{segment}_{number}"


def condition_numbers(clauses: list[tuple[int, ...]]) -> list[int]:
    """Sorted numbers of the conditions in some clauses."""
    return sorted({number for clause in clauses for number in clause})


@dataclass(frozen=True)
class Due:
    """Time of a condition: the sum of the parameters in ``slots``, counted from the start or, if a
    ``motor`` is named, from its ignition."""

    slots: tuple[int, ...]
    motor: str = ""


@dataclass
class Release:
    """Release of a joint independent of phases, or an observation event (``joint`` is "").

    It occurs when all conditions (by number) of any of its ``clauses`` are met. The conditions by
    type: ``times``, ``springs`` (stroke ends), ``events`` (on the state), ``loads`` (on joint
    loads).
    """

    name: str
    joint: str
    clauses: list[tuple[int, ...]]
    times: dict[int, Due]
    springs: dict[int, str]
    events: list[Event]
    loads: list[Event]


@dataclass(frozen=True)
class Change:
    """Change of a joint to kind number ``to``, its release delay after its trigger: the end of the
    phase, or the release, named ``event``; an ``optional`` trigger need not occur."""

    joint: str
    event: str
    to: int
    optional: bool = False


@dataclass
class Segment:
    """Time interval of a case with fixed structure: a phase, or the time between two phases in
    which delayed releases are pending.

    ``groups`` are bodies that rotate as one rigid group; the first body is its leader, whose
    attitude is integrated. A kind of a joint is a set of constraint rows that it may have.
    """

    name: str
    phase: str
    joint_kinds: dict[str, Kinds]  # possible kinds of each joint
    groups: list[tuple[str, ...]] = field(default_factory=list)
    rows: list[Row] = field(default_factory=list)
    # joints without relative rotation: their bodies rotate as one rigid group
    welds: list[str] = field(default_factory=list)
    dropped: list[Row] = field(default_factory=list)  # redundant rows that are left out
    # number of redundant rows if each body rotates by itself: if > 0, multipliers are not unique
    redundant: int = 0
    # bodies rotate by themselves; accelerations and wrenches are solved for in one full system
    full: bool = False
    # bodies rotate by themselves; all rows are solved for the multipliers of minimum norm
    least_squares: bool = False
    events: list[Event] = field(default_factory=list)
    loads: list[Event] = field(default_factory=list)  # conditions on joint forces and moments
    # parameters whose sum is the time that ends it; none: the end of the run
    end_time: tuple[int, ...] = ()
    delay: int | None = None  # parameter: delay of the joint that is released at its end
    # joints with a release delay and the parameter of the delay: the longest one ends the segment
    late: dict[str, int] = field(default_factory=dict)
    # its end condition was evaluated before it began, while delayed releases were pending
    after_late: bool = False
    # the segment of delayed releases after it, if that has the same rows until the releases: both
    # then use the same compiled derivative and projection
    alias_of: str = ""
    # condition that ends the next phase, evaluated while delayed releases are pending
    pending_event: Event | None = None
    # it ends when all conditions (by number) of any clause are satisfied
    clauses: list[tuple[int, ...]] = field(default_factory=list)
    times: dict[int, Due] = field(default_factory=dict)  # conditions that are times
    springs: dict[int, str] = field(default_factory=dict)  # conditions that are stroke ends
    # releases independent of phases, and observation events
    releases: list[Release] = field(default_factory=list)
    max_intervals: int = 1  # integration intervals, divided by events and load switches

    @property
    def needs_min_norm(self) -> bool:
        """True if the joint loads need a second solution. The motion uses only the rows that are
        not redundant; the joint loads are the minimum-norm solution over all rows."""
        return self.redundant > 0 and not self.least_squares

    @property
    def all_rows(self) -> list[Row]:
        """Rows of all joints, each body rotating by itself."""
        return [row for joint in self.joint_kinds for row in self._rows(joint)]

    def _rows(self, joint: str) -> list[Row]:
        """Rows that a joint may have in the segment, those of all its possible kinds."""
        kinds, codes = (
            self.joint_kinds[joint],
            dict.fromkeys(code for codes in self.joint_kinds[joint].values() for code in codes),
        )
        kinds_of_code = {
            code: tuple(k for k, present in kinds.items() if code in present) for code in codes
        }
        return [
            Row(joint, code, () if len(active) == len(kinds) else active)
            for code, active in kinds_of_code.items()
        ]

    def leader(self, body: str) -> str:
        """Leader of the rigid group of a body: the body whose attitude it shares, or the ground."""
        return next(group[0] for group in self.groups if body in group)

    def constrains(self, joint: str) -> bool:
        """True if a joint has constraint rows in at least one of its possible kinds."""
        return any(self.joint_kinds[joint].values())

    def free_kinds(self, joint: str) -> tuple[int, ...]:
        """Numbers of the kinds in which a joint is free."""
        return tuple(k for k, codes in self.joint_kinds[joint].items() if not codes)

    def sliding_kinds(self, joint: str) -> tuple[int, ...]:
        """Numbers of the kinds in which the pins of a joint are engaged and may slide."""
        return tuple(
            k for k, codes in self.joint_kinds[joint].items() if leaves_pins_sliding(codes)
        )

    @property
    def variable_joints(self) -> list[str]:
        """Joints that may change their kind within the segment."""
        return [joint for joint, kinds in self.joint_kinds.items() if len(kinds) > 1]

    @property
    def ends_by_time(self) -> bool:
        """True if it ends at a time that is known when it begins: a parameter, or a release
        delay."""
        return bool(self.end_time or self.late)

    @cached_property
    def leaders(self) -> list[str]:
        """Leaders of all rigid groups that rotate: their attitudes are integrated."""
        return [group[0] for group in self.groups if GROUND not in group]

    @property
    def ends_by_state(self) -> bool:
        """True if conditions end it: one on the state or on a joint load, or several together."""
        return bool(self.clauses) or any(event.ends_phase for event in (*self.events, *self.loads))

    @property
    def may_end_by_load(self) -> bool:
        """True if a condition on a joint load may end it, alone or with others: the step to such an
        event is not predicted."""
        return any(not load.any_phase for load in self.loads)


@dataclass
class KernelSpec:
    """Specification of the kernel of a scene.

    All names are those of the kernel (`Names`), in ``layout`` and ``dispersed`` too.
    """

    layout: ParameterLayout
    dispersed: frozenset[str]
    names: Names
    segments: list[Segment]
    # bodies in the order of their attitudes in the state: leaders of the first segment first
    attitude_order: list[str]
    changes: list[Change]
    variant: Variant
    failing_joints: list[str]  # joints that may fail to release
    load_switches: bool  # loads switch on or off within a case
    layer_borders: bool  # bodies may pass between layers of the standard atmosphere

    @property
    def scene(self) -> Scene:
        """The scene, with the names of the kernel."""
        return self.layout.scene

    @cached_property
    def step_cells(self) -> dict[str, tuple[int, ...]]:
        """Axes of the tables with kinks by the fields of their cells, which change at the ends of
        steps only."""
        return step_cells(self.scene, self.dispersed)

    @cached_property
    def formulas(self) -> Formulas:
        """Formulas of the signals of the scene."""
        return Formulas(self.scene, self.names)

    @property
    def n_signal_states(self) -> int:
        """Number of states of signals, which are integrated with the motion."""
        return sum(signal.states for signal in self.scene.signal)

    @property
    def triggered_motors(self) -> list[Motor]:
        """Motors that ignite at an event, a release or when a joint becomes free."""
        return [motor for motor in self.scene.motor if motor.trigger is not None]

    @property
    def bodies(self) -> list[str]:
        """Names of the moving bodies, in the order of the parameters."""
        return self.layout.bodies

    def may_occur(self, path: str, nominally: bool) -> bool:
        """Return True if a feature occurs in some case: nominally, or by a dispersed parameter.

        Parameters
        ----------
        path : str
            parameter that the feature depends on
        nominally : bool
            True if the nominal case has the feature
        """
        return nominally or path in self.dispersed

    def feels_air(self, body: str) -> bool:
        """True if a body has aerodynamics and the scene an atmosphere."""
        return (
            self.scene.environment.atmosphere != "none"
            and self.scene.body[body].aerodynamics is not None
        )

    def in_layers(self, body: str) -> bool:
        """True if the density around a body comes from the layers of the standard atmosphere,
        expanded in a series about its height."""
        return self.scene.environment.atmosphere == "us1976" and self.feels_air(body)

    def active_size(self, segment: Segment) -> int:
        """Number of leading state components that are integrated in a segment: position and
        velocity of every body, the work of the loads, states of signals, and attitude and rate up
        to the last leader of the segment."""
        return (
            6 * len(self.bodies)
            + 1
            + self.n_signal_states
            + 7 * (1 + max((self.attitude_order.index(b) for b in segment.leaders), default=-1))
        )

    @property
    def any_order(self) -> bool:
        """True if delayed, failing or phase-independent releases may occur before or after any
        event."""
        return self.variant <= Variant.ANY_ORDER

    @property
    def fallbacks(self) -> list[Variant]:
        """Variants that may integrate cases which this kernel rejects.

        ANY_ORDER: a release may be delayed beyond the next event or fail, a body may leave its
        atmosphere layer unexpectedly, or an event may occur much later than predicted.
        LEAST_SQUARES: rows may become redundant or cease to be.
        """
        any_order_helps = any(
            segment.late or segment.delay is not None for segment in self.segments
        ) or bool(self.failing_joints)
        any_order_helps = any_order_helps or any(
            segment.events and segment.max_intervals == 1 for segment in self.segments
        )
        any_order_helps = any_order_helps or (
            not self.layer_borders and any(map(self.in_layers, self.bodies))
        )
        variants = [Variant.ANY_ORDER] if any_order_helps and not self.any_order else []
        return variants + (
            [Variant.LEAST_SQUARES]
            if self.variant != Variant.LEAST_SQUARES
            and any(segment.rows for segment in self.segments)
            else []
        )

    @cached_property
    def initial_kinds(self) -> dict[str, int]:
        """Joints that change within a segment, and their kind numbers at the start."""
        names = dict.fromkeys(name for segment in self.segments for name in segment.variable_joints)
        return {name: min(self.segments[0].joint_kinds[name]) for name in names}

    @property
    def kind_changes(self) -> list[tuple[str, int]]:
        """Pairs (joint, number of a kind that it may change to) of the joints that change within a
        segment, sorted."""
        pairs = {
            (name, number)
            for segment in self.segments
            for name in segment.variable_joints
            for number in segment.joint_kinds[name]
        }
        return sorted((name, number) for name, number in pairs if number > self.initial_kinds[name])

    @property
    def stroke_columns(self) -> list[str]:
        """Springs whose end of stroke is an outcome, in the order of the columns."""
        springs = self.names.of["spring"]
        return [springs[name] for name in self.layout.contents.springs]

    @property
    def partial_releases(self) -> list[tuple[str, int]]:
        """Joint and kind number of the partial releases that are outcomes, in the order of the
        columns."""
        joints, numbers = self.names.of["joint"], {c.event: c.to for c in self.changes}
        kinds = {(r.joint, r.to): numbers[r.name] for r in self.scene.release}
        return [
            (joints[name], kinds[joints[name], kind])
            for name, kind in self.layout.contents.partial_releases
        ]

    @property
    def stroke_springs(self) -> list[str]:
        """Springs that may reach the end of their stroke."""
        return list(
            dict.fromkeys(
                e.item
                for segment in self.segments
                for e in segment.events
                if e.quantity == at.AT_SPRING_STROKE
            )
        )

    def changes_of(self, joint: str) -> list[Change]:
        """Changes of a joint by phases and releases."""
        return [change for change in self.changes if change.joint == joint]

    def friction_joints(self, segment: Segment) -> list[str]:
        """Joints whose pins may slide with friction in a segment."""
        guides = {
            name: joint.guide
            for name, joint in self.scene.joint.items()
            if joint.guide is not None and segment.sliding_kinds(name)
        }
        return [
            name
            for name, guide in guides.items()
            if self.may_occur(f"joint.{name}.guide.friction", guide.friction > 0.0)
        ]

    def has_body_axes(self, joint: str) -> bool:
        """True if the axes of a joint are those of its first body in every case."""
        j = self.scene.joint[joint]
        if f"joint.{joint}.x_axis.x" in self.layout.slots:
            return False
        return tuple(joint_axes(j.x_axis, j.y_axis)) == _IDENTITY
