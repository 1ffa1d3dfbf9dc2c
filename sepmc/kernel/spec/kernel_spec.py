"""Kernel specification: everything that the emitter (`sepmc.kernel.emit`) needs to know of a scene
and its dispersions to write a kernel. Bodies, joints and other items have their generated names.

It describes structure (segments of time, rigid groups, constraint rows, events, outputs), not
values of parameters: scenes with equal structure share one compiled kernel. Bodies of a rigid
group rotate together, but may slide on each other.
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
# Kinds that a joint may have: codes of the constraint rows by the number of the kind. Kind 0 has
# the most rows, and a joint only changes to kinds of higher numbers.
Kinds = dict[int, tuple[int, ...]]


@dataclass(frozen=True)
class Row:
    """Constraint row: one scalar constraint equation of a joint, given by its generated name.

    ``code`` is its type as in `sepmc.routines.layout`: 0 to 2 for no translation along axis x, y or
    z; ROTATION + 3 i + j for axis i of the second body perpendicular to axis j of the first; ROD.
    ``kinds`` has the numbers of the joint kinds in which the row is active; empty if it is active
    in all kinds that the joint may have in the segment.
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
    """Instant at which a quantity of the state, or a joint load, reaches a threshold; kernels
    locate it by root-finding.

    ``quantity`` is the code of the quantity (AT_STROKE, ... of `sepmc.routines.layout`), ``item``
    the joint, spring, body, kink (`sepmc.kernel.spec.kinks`) or cell field
    (`sepmc.kernel.spec.step_cells`) that has it. ``threshold`` is the index of the threshold
    in the parameter vector; of an end of a table cell the axis (0 to 2); -1 without a threshold.

    ``ends_phase`` is True if the event ends its phase by itself. Else ``number`` is that of a
    condition in clauses (`Segment.clauses`, `Release.clauses`): with ``any_phase`` in those of a
    release or observation event, else in those that end the phase. It is -1 for borders, kinks and
    ends of spring strokes, which are in no clause. ``direction`` says which crossing counts:
    "rising", "falling" or "either"; with "" the event also occurs if the quantity starts beyond the
    threshold.
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
        """Name of the event in names of workspace fields, unique within its segment: the item, with
        the condition number if it has one, or with the end ("top", "base") of the layer or cell
        that is left, of a cell after the number of its axis."""
        if self.is_cell_end:
            end = "top" if self.quantity == at.AT_CELL_TOP else "base"
            return f"{self.item}_{self.threshold}_{end}"
        if self.is_border:
            return f"{self.item}_{'top' if self.quantity == at.AT_LAYER_TOP else 'base'}"
        return self.item if self.number < 0 else f"{self.item}_{self.number}"

    @property
    def is_border(self) -> bool:
        """True if the event is that a body leaves its atmosphere layer, or a point the cell of its
        table. Such an event, as that of a kink, may occur repeatedly; all others occur once."""
        return self.is_cell_end or self.quantity in (at.AT_LAYER_TOP, at.AT_LAYER_BASE)

    @property
    def is_cell_end(self) -> bool:
        """True if the event is that a point leaves the cell ``item`` of a table with kinks, at one
        end along the axis ``threshold``."""
        return self.quantity in (at.AT_CELL_TOP, at.AT_CELL_BASE)

    def flag(self, segment: str) -> str:
        """Name of the workspace field that is 1 once the event has occurred in the segment of that
        name; at the end of a layer or cell, 1 until the next one is loaded. Of a kink it is the
        field of the mode (-1, 0, 1) that the kink gets at the event; all events that end the phase
        by themselves share the field DONE."""
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
    """Name of the workspace field that is 1 once a spring has reached the end of its stroke."""
    return f"SPENT_{spring}"


ANY_PHASE = "any_phase"  # in place of the segment, for conditions of releases and events


def condition_flag(segment: str, number: int) -> str:
    """Name of the workspace field that is 1 once condition ``number`` has been met; ``segment`` is
    the name of the segment that the condition ends, or ANY_PHASE. Conditions are numbered through
    the whole scene: a number is an index of `sepmc.kernel.spec.conditions.Conditions.leaves`."""
    return f"FLAG_{segment}_{number}"


def condition_numbers(clauses: list[tuple[int, ...]]) -> list[int]:
    """Numbers of the conditions in the given clauses (each a tuple of such numbers), sorted, each
    once."""
    return sorted({number for clause in clauses for number in clause})


@dataclass(frozen=True)
class Due:
    """Time at which a condition on time is met: the sum of the parameters with the indices
    ``slots``, s, since the start of the case or, if ``motor`` is not "", since the ignition of that
    motor."""

    slots: tuple[int, ...]
    motor: str = ""


@dataclass
class Release:
    """Release, called ``name``, of a joint by a condition of its own, in any phase; or, if
    ``joint`` is "", an observation event, which releases nothing.

    It occurs when all conditions of at least one of its ``clauses`` are met; a clause is a tuple of
    condition numbers (as in `condition_flag`). By condition number, ``times`` has the conditions
    that are times and ``springs`` the springs whose end of stroke is the condition; ``events`` has
    the conditions on the state and ``loads`` those on joint loads (`Event.number`).
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
    """Change of a joint to its kind number ``to`` (a key of its `Kinds`).

    ``event`` names the trigger: a phase (at its end) or a release. The change follows the trigger
    after the release delay of the joint. A case in which it does not happen until the end has the
    status never-released; if ``optional``, only if the trigger occurred.
    """

    joint: str
    event: str
    to: int
    optional: bool = False


@dataclass
class Segment:
    """Part of a case that one set of kernel functions integrates: a phase, or the time between two
    phases in which delayed releases are pending (then ``phase`` names the phase after it).

    ``groups`` are the rigid groups: bodies that rotate together, but may slide on each other; the
    first body of a group is its leader, whose attitude is integrated. A kind of a joint is the set
    of constraint rows that it has at a time; joints with several possible kinds may change within
    the segment.

    Attributes
    ----------
    joint_kinds : dict of str to Kinds
        Possible kinds of each joint in the segment.
    rows, dropped : list of Row
        Constraint rows, and redundant rows that are left out.
    welds : list of str
        Joints without relative rotation, sliders too: their bodies rotate as one rigid group.
    redundant : int
        Number of redundant rows if each body rotates by itself; if > 0, multipliers are not unique.
    full, least_squares : bool
        With ``full``, accelerations and wrenches are solved for in one system; with
        ``least_squares``, the multipliers of all rows are those of minimum norm. With either, every
        body is a group of its own.
    events, loads : list of Event
        Events on the state, and on joint forces and moments.
    end_time : tuple of int
        Indices of the parameters whose sum is the end time, s; empty: not ended by a given time.
    delay : int or None
        Parameter index of the release delay, s, that is added to the end time; None: no delay.
    late : dict of str to int
        Parameter index of the delay, s, of each joint whose delayed release is pending: the segment
        takes as long as the longest of them.
    after_late : bool
        True if its end condition was evaluated before it began, while delayed releases were
        pending.
    alias_of : str
        Name of the segment of delayed releases after it, if that has the same rows until the
        releases: both then use the same compiled derivative and projection. Else empty.
    pending_event : Event or None
        Condition that ends the next phase, evaluated while delayed releases are pending.
    clauses : list of tuple of int
        The segment ends when all conditions (by number, as in `condition_flag`) of at least one
        clause are met; empty if it is not ended by clauses.
    times, springs : dict by int
        By condition number: conditions of the clauses that are times, and springs whose end of
        stroke is one.
    releases : list of Release
        Releases with conditions of their own, and observation events, that may occur in it.
    max_intervals : int
        Largest number of intervals that events and load switches may divide it into.
    """

    name: str
    phase: str
    joint_kinds: dict[str, Kinds]
    groups: list[tuple[str, ...]] = field(default_factory=list)
    rows: list[Row] = field(default_factory=list)
    welds: list[str] = field(default_factory=list)
    dropped: list[Row] = field(default_factory=list)
    redundant: int = 0
    full: bool = False
    least_squares: bool = False
    events: list[Event] = field(default_factory=list)
    loads: list[Event] = field(default_factory=list)
    end_time: tuple[int, ...] = ()
    delay: int | None = None
    late: dict[str, int] = field(default_factory=dict)
    after_late: bool = False
    alias_of: str = ""
    pending_event: Event | None = None
    clauses: list[tuple[int, ...]] = field(default_factory=list)
    times: dict[int, Due] = field(default_factory=dict)
    springs: dict[int, str] = field(default_factory=dict)
    releases: list[Release] = field(default_factory=list)
    max_intervals: int = 1

    @property
    def needs_min_norm(self) -> bool:
        """True if the joint loads need a solution of their own, because rows are redundant: the
        motion uses only independent rows, the joint loads are the minimum-norm multipliers of all
        rows. False with ``least_squares``, where the motion uses these multipliers too."""
        return self.redundant > 0 and not self.least_squares

    @property
    def all_rows(self) -> list[Row]:
        """Constraint rows of all joints, also those that rigid groups make unnecessary: as if every
        body rotated by itself."""
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
        """Name of the leader of the rigid group of a body: the body (or GROUND) whose attitude it
        shares."""
        return next(group[0] for group in self.groups if body in group)

    def constrains(self, joint: str) -> bool:
        """True if a joint has constraint rows in at least one of its possible kinds."""
        return any(self.joint_kinds[joint].values())

    def free_kinds(self, joint: str) -> tuple[int, ...]:
        """Numbers of those possible kinds of a joint in the segment in which it is free."""
        return tuple(k for k, codes in self.joint_kinds[joint].items() if not codes)

    def sliding_kinds(self, joint: str) -> tuple[int, ...]:
        """Numbers of those possible kinds of a joint in the segment in which pins would be engaged
        and may slide (`leaves_pins_sliding`). Whether the joint has pins is not asked."""
        return tuple(
            k for k, codes in self.joint_kinds[joint].items() if leaves_pins_sliding(codes)
        )

    @property
    def variable_joints(self) -> list[str]:
        """Names of the joints that may change their kind within the segment."""
        return [joint for joint, kinds in self.joint_kinds.items() if len(kinds) > 1]

    @property
    def ends_by_time(self) -> bool:
        """True if the segment ends, at the latest, at a time known when it begins: a time or
        burn-out of the file, or the longest release delay. Events may end it earlier. The end of
        the run, which ends every segment, does not count."""
        return bool(self.end_time or self.late)

    @cached_property
    def leaders(self) -> list[str]:
        """Names of the leaders of all rigid groups without the ground; their attitudes are
        integrated."""
        return [group[0] for group in self.groups if GROUND not in group]

    @property
    def ends_by_state(self) -> bool:
        """True if conditions, not only a given time, may end the segment: one on the state or on a
        joint load, or any clauses (`clauses`)."""
        return bool(self.clauses) or any(event.ends_phase for event in (*self.events, *self.loads))

    @property
    def may_end_by_load(self) -> bool:
        """True if a condition on a joint load may end the segment, alone or with other conditions;
        the time of such an event is not predicted from the state."""
        return any(not load.any_phase for load in self.loads)


@dataclass
class KernelSpec:
    """Specification of the kernel of a scene.

    All items have their generated names (`Names`: body1, joint2, ...), in ``layout`` and in the
    paths of the ``dispersed`` parameters too; ``names`` maps the names of the file to them.
    ``variant`` says which cases the kernel can integrate: those whose joints release in the order
    of the phases, in any order, or also those whose constraint rows become redundant (`Variant`).

    ``segments`` are the parts of a case in the order of time; ``attitude_order`` has the bodies in
    the order of their attitudes in the state, leaders of the first segment first; ``changes`` are
    the changes of joint kinds. ``failing_joints`` may fail to release; ``load_switches`` is True if
    loads switch on or off within a case, ``layer_borders`` if bodies may pass between layers of the
    standard atmosphere.
    """

    layout: ParameterLayout
    dispersed: frozenset[str]
    names: Names
    segments: list[Segment]
    attitude_order: list[str]
    changes: list[Change]
    variant: Variant
    failing_joints: list[str]
    load_switches: bool
    layer_borders: bool

    @property
    def scene(self) -> Scene:
        """The scene, its items with their generated names."""
        return self.layout.scene

    @cached_property
    def step_cells(self) -> dict[str, tuple[int, ...]]:
        """Cells of tables with kinks, as the function `sepmc.kernel.spec.step_cells.step_cells`
        returns them: by the workspace field of a cell, the axes (0 to 2) along which it has
        ends."""
        return step_cells(self.scene, self.dispersed)

    @cached_property
    def formulas(self) -> Formulas:
        """Formulas and kinks of the signals of the scene."""
        return Formulas(self.scene, self.names)

    @property
    def n_signal_states(self) -> int:
        """Number of state components of all signals (of lags, servos, integrals), which are
        integrated with the motion."""
        return sum(signal.states for signal in self.scene.signal)

    @property
    def triggered_motors(self) -> list[Motor]:
        """Motors that ignite at an event, a release or when a joint becomes free."""
        return [motor for motor in self.scene.motor if motor.trigger is not None]

    @property
    def bodies(self) -> list[str]:
        """Generated names of the moving bodies (without the ground), in the order of their
        parameters."""
        return self.layout.bodies

    def may_occur(self, path: str, nominally: bool) -> bool:
        """Return True if a feature occurs in the nominal case or may occur in a dispersed one.

        Parameters
        ----------
        path : str
            Path of the parameter that the feature depends on; it may occur in a dispersed case if
            exactly this path is dispersed.
        nominally : bool
            True if the nominal case has the feature.
        """
        return nominally or path in self.dispersed

    def feels_air(self, body: str) -> bool:
        """True if a body has aerodynamics and the scene an atmosphere."""
        return (
            self.scene.environment.atmosphere != "none"
            and self.scene.body[body].aerodynamics is not None
        )

    def in_layers(self, body: str) -> bool:
        """True if a body has aerodynamics in air of the US standard atmosphere 1976, whose density
        within a layer is expanded in a series about a height near the body. False for other
        atmospheres and in a vacuum."""
        return self.scene.environment.atmosphere == "us1976" and self.feels_air(body)

    def active_size(self, segment: Segment) -> int:
        """Number of leading components of the state vector that are integrated in a segment:
        position and velocity of every body, the work of the loads, states of signals, then attitude
        and rate of the bodies in ``attitude_order`` up to the last leader of the segment."""
        return (
            6 * len(self.bodies)
            + 1
            + self.n_signal_states
            + 7 * (1 + max((self.attitude_order.index(b) for b in segment.leaders), default=-1))
        )

    @property
    def any_order(self) -> bool:
        """True if the variant of the kernel lets delayed, failing or phase-independent releases
        occur before or after any event (ANY_ORDER or LEAST_SQUARES)."""
        return self.variant <= Variant.ANY_ORDER

    @property
    def fallbacks(self) -> list[Variant]:
        """More general variants that may integrate cases which this kernel rejects, the less
        general first.

        ANY_ORDER is among them if a release may be delayed beyond the next event or fail, a body
        may leave its atmosphere layer unexpectedly, or an event may occur much later than
        predicted; LEAST_SQUARES if there are constraint rows, which may become redundant.
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
        """Kind number at the start of a case of each joint that may change its kind within a
        segment, by joint."""
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
        """Generated names of the springs whose time of the end of stroke is an outcome, in the
        order of the outcome columns."""
        springs = self.names.of["spring"]
        return [springs[name] for name in self.layout.contents.springs]

    @property
    def partial_releases(self) -> list[tuple[str, int]]:
        """Pairs (generated name of a joint, number of the kind that it is released to) of the
        partial releases whose times are outcomes, in the order of the outcome columns. A partial
        release leaves some constraint rows."""
        joints, numbers = self.names.of["joint"], {c.event: c.to for c in self.changes}
        kinds = {(r.joint, r.to): numbers[r.name] for r in self.scene.release}
        return [
            (joints[name], kinds[joints[name], kind])
            for name, kind in self.layout.contents.partial_releases
        ]

    @property
    def stroke_springs(self) -> list[str]:
        """Names of the springs that may reach the end of their stroke in some segment, in the order
        in which they first may."""
        return list(
            dict.fromkeys(
                e.item
                for segment in self.segments
                for e in segment.events
                if e.quantity == at.AT_SPRING_STROKE
            )
        )

    def changes_of(self, joint: str) -> list[Change]:
        """Changes of a joint to other kinds, by phases and by releases."""
        return [change for change in self.changes if change.joint == joint]

    def friction_joints(self, segment: Segment) -> list[str]:
        """Names of the joints whose guide pins may slide with friction in a segment."""
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
        """True if the axes of a joint coincide with the body axes of its first body in every
        case."""
        j = self.scene.joint[joint]
        if f"joint.{joint}.x_axis.x" in self.layout.slots:
            return False
        return tuple(joint_axes(j.x_axis, j.y_axis)) == _IDENTITY
