"""What a kernel has to know of a scene: groups of bodies that turn as one, constraint rows, events.

Only structure counts here, no numbers: scenes of the same shape share a kernel.
"""

from dataclasses import dataclass, field
from functools import cached_property

from sepmc.kernel.spec.naming import Names
from sepmc.kernel.spec.parameter_layout import Plan
from sepmc.routines import layout as at
from sepmc.scene.kinds import joint_axes, slides
from sepmc.scene.model import GROUND, Motor, Scene

_IDENTITY = (1.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 1.0)
# codes of the rows that a joint holds, by the number of its kind: the one that holds most first
Kinds = dict[int, tuple[int, ...]]


@dataclass(frozen=True)
class Row:
    """A constraint row: its joint and its code (`layout`); if it counts in some of its stage only,
    the kinds of its joint, by number, in which it does."""

    joint: str
    code: int
    kinds: tuple[int, ...] = ()

    @property
    def turns(self) -> bool:
        """Whether it constrains a rotation."""
        return at.ROTATION <= self.code < at.ROD


@dataclass(frozen=True)
class Event:
    """A condition on the state: ``what`` (AT_STROKE, ...) of which joint, spring or body, and where
    its threshold stands in w; whether it ends its phase by itself, or else its number among the
    conditions that do so together, or, ``apart`` from phases, release a joint; the ``direction`` in
    which the threshold must be crossed, "" if at or beyond it will do."""

    what: int
    which: str
    threshold: int
    ends_phase: bool
    number: int = -1
    apart: bool = False
    direction: str = ""

    @property
    def name(self) -> str:
        """What it is called within its stage."""
        if self.is_border:
            return f"{self.which}_{'top' if self.what == at.AT_LAYER_TOP else 'base'}"
        return self.which if self.number < 0 else f"{self.which}_{self.number}"

    @property
    def is_border(self) -> bool:
        """Whether it is a border of a body's layer of air, which is met as often as it is
        passed."""
        return self.what in (at.AT_LAYER_TOP, at.AT_LAYER_BASE)

    def flag(self, stage: str) -> str:
        """Where it is noted that it is met."""
        if self.is_border:
            return f"ENTERS_{self.which}"
        if self.ends_phase:
            return "DONE"
        return (
            ended(self.which)
            if self.number < 0
            else met(APART if self.apart else stage, self.number)
        )


def ended(spring: str) -> str:
    """Where it is noted that a spring has come to the end of its stroke."""
    return f"SPENT_{spring}"


APART = "apart"  # in place of a phase, of a condition that releases a joint in any


def met(stage: str, number: int) -> str:
    """Where it is noted that one of several conditions is met."""
    return f"MET_{stage}_{number}"


def numbers_of(clauses: list[tuple[int, ...]]) -> list[int]:
    """Numbers of the conditions that clauses are made of."""
    return sorted({number for clause in clauses for number in clause})


@dataclass(frozen=True)
class Due:
    """A time: places in w of what adds up to it, from the start of the flight or, if a ``motor``
    is named, from its ignition."""

    places: tuple[int, ...]
    motor: str = ""


@dataclass
class Release:
    """A release apart from phases, of a joint, or of none: an instant that is told of. Any of
    clauses, each all of conditions by number; those of these that are times, those that are ends of
    springs, those on the state and those on loads."""

    name: str
    joint: str
    clauses: list[tuple[int, ...]]
    times: dict[int, Due]
    springs: dict[int, str]
    events: list[Event]
    loads: list[Event]


@dataclass(frozen=True)
class Change:
    """What an event tells a joint, the end of a phase or a release apart from phases: to hold its
    kind number ``to``, from its delay on; whether the event is ``optional``: it need not come."""

    joint: str
    event: str
    to: int
    optional: bool = False


@dataclass
class Stage:
    """A phase, or the time after it in which joints are late in letting go: its groups of bodies
    that turn as one (the first leads), its rows, what ends it, and what it does not hold any
    more."""

    name: str
    phase: str
    may: dict[str, Kinds]  # what joints may hold in it: codes of rows, by the number of the kind
    groups: list[tuple[str, ...]] = field(default_factory=list)
    rows: list[Row] = field(default_factory=list)
    # joints that let nothing turn, whose bodies turn as one
    welds: list[str] = field(default_factory=list)
    dropped: list[Row] = field(default_factory=list)  # rows that follow from the others
    # how many would, if each body turned by itself: what joints carry is then not unique
    redundant: int = 0
    # whether bodies turn by themselves, and wrenches and accelerations are solved for together
    full: bool = False
    # whether bodies do turn by themselves, and all rows are solved for, by least sum of squares
    least_squares: bool = False
    events: list[Event] = field(default_factory=list)
    loads: list[Event] = field(default_factory=list)  # conditions on what joints carry
    # places in w of what adds up to the time that ends it; none: the end of the run
    end_time: tuple[int, ...] = ()
    delay: int | None = None  # place in w of the delay of the joint that lets go then
    # joints that are late, and the places of their delays: the last one ends it
    late: dict[str, int] = field(default_factory=dict)
    # whether its end was waited for before it began, while joints were late
    after_late: bool = False
    # the stage after it in which joints are late, if that holds what this does until they let go:
    # one derivative and one correction fly both, which a kernel then compiles once
    flown_as: str = ""
    # the condition that ends the phase after it and is waited for while joints are late
    awaited: Event | None = None
    # of several conditions: any of these ends it, each all of its numbers
    clauses: list[tuple[int, ...]] = field(default_factory=list)
    times: dict[int, Due] = field(default_factory=dict)  # which of them are times
    springs: dict[int, str] = field(default_factory=dict)  # which are ends of springs
    # apart from phases, that may change what joints hold in it
    releases: list[Release] = field(default_factory=list)
    stops: int = 1

    @property
    def shares(self) -> bool:
        """Whether what joints carry is not what moves its groups of bodies, and has to be shared
        out."""
        return self.redundant > 0 and not self.least_squares

    @property
    def every_row(self) -> list[Row]:
        """What all joints hold, each body turning by itself."""
        return [row for joint in self.may for row in self._rows(joint)]

    def _rows(self, joint: str) -> list[Row]:
        """Rows that a joint may have in it."""
        kinds, codes = (
            self.may[joint],
            dict.fromkeys(code for codes in self.may[joint].values() for code in codes),
        )
        having = {code: tuple(k for k, held in kinds.items() if code in held) for code in codes}
        return [
            Row(joint, code, () if len(which) == len(kinds) else which)
            for code, which in having.items()
        ]

    def leader(self, body: str) -> str:
        """The body whose attitude is that of a body, or the ground."""
        return next(group[0] for group in self.groups if body in group)

    def holds(self, joint: str) -> bool:
        """Whether a joint may hold something."""
        return any(self.may[joint].values())

    def free(self, joint: str) -> tuple[int, ...]:
        """The kinds, if any, as which a joint holds nothing."""
        return tuple(k for k, codes in self.may[joint].items() if not codes)

    def sliding(self, joint: str) -> tuple[int, ...]:
        """The kinds, if any, as which the pins of a joint are engaged and may slide."""
        return tuple(k for k, codes in self.may[joint].items() if slides(codes))

    @property
    def masked(self) -> list[str]:
        """Joints that let go within it: what they hold differs from case to case."""
        return [joint for joint, kinds in self.may.items() if len(kinds) > 1]

    @property
    def ends_by_time(self) -> bool:
        """Whether its end is a time that is known as it begins."""
        return bool(self.end_time or self.late)

    @cached_property
    def leaders(self) -> list[str]:
        """One body of every group that turns: those whose attitudes are integrated."""
        return [group[0] for group in self.groups if GROUND not in group]

    @property
    def ends_by_state(self) -> bool:
        """Whether a condition on the state ends it, and not a time."""
        return bool(self.clauses) or any(event.ends_phase for event in (*self.events, *self.loads))

    @property
    def waits_for_load(self) -> bool:
        """Whether what a joint carries may end it: when that will be is not foretold."""
        return any(not load.apart for load in self.loads)


@dataclass
class Shape:
    """A scene as a kernel sees it: all names are those of the kernel (`Names`), in ``plan`` and in
    ``dispersed`` too."""

    plan: Plan
    dispersed: frozenset[str]
    names: Names
    stages: list[Stage]
    # bodies in the order their attitudes stand in the state: leaders of the first phase first
    turning: list[str]
    changes: list[Change]  # what events tell joints
    care: int  # STANDARD, ANY_ORDER or LEAST_SQUARES of `sepmc.routines.layout`
    failing: list[str]  # joints that may fail to let go
    switches: bool  # whether loads switch on or off within a flight
    borders: bool  # whether bodies may pass from one layer of the standard atmosphere to another

    @property
    def scene(self) -> Scene:
        """The scene of the plan."""
        return self.plan.scene

    @property
    def triggered(self) -> list[Motor]:
        """Motors that light at an instant that the flight itself tells."""
        return [motor for motor in self.scene.motor if motor.trigger is not None]

    @property
    def bodies(self) -> list[str]:
        """Names of the bodies, in the order of the plan."""
        return self.plan.bodies

    def may(self, path: str, nominally: bool) -> bool:
        """Whether some case may have what the nominal one has if ``nominally``, since a parameter
        says so that may be dispersed."""
        return nominally or path in self.dispersed

    def feels_air(self, body: str) -> bool:
        """Whether a body has aerodynamics, and air to fly in."""
        return (
            self.scene.environment.atmosphere != "none"
            and self.scene.body[body].aerodynamics is not None
        )

    def in_layers(self, body: str) -> bool:
        """Whether a body flies in the layers of the standard atmosphere, whose density is expanded
        about its height."""
        return self.scene.environment.atmosphere == "us1976" and self.feels_air(body)

    def active(self, stage: Stage) -> int:
        """Numbers of the state that are integrated in a phase."""
        return (
            6 * len(self.bodies)
            + 1
            + 7 * (1 + max((self.turning.index(b) for b in stage.leaders), default=-1))
        )

    @property
    def any_order(self) -> bool:
        """Whether joints that are late, fail or are released apart from phases may let go before or
        after any event."""
        return self.care <= at.ANY_ORDER

    @property
    def spares(self) -> list[int]:
        """With what care kernels may fly cases that one of this shape loses: in which joints are
        late beyond the next event or fail, or bodies leave their layer of air though that was not
        foreseen, or an event comes much later than it is foretold; in which rows cease to follow
        from others, or come to."""
        lost = any(stage.late or stage.delay is not None for stage in self.stages) or bool(
            self.failing
        )
        lost = lost or any(stage.events and stage.stops == 1 for stage in self.stages)
        lost = lost or (not self.borders and any(map(self.in_layers, self.bodies)))
        found = [at.ANY_ORDER] if lost and not self.any_order else []
        return found + (
            [at.LEAST_SQUARES]
            if self.care != at.LEAST_SQUARES and any(stage.rows for stage in self.stages)
            else []
        )

    @cached_property
    def masked(self) -> dict[str, int]:
        """Joints that let go within a stage, and the numbers of the kinds as which they hold at the
        start."""
        names = dict.fromkeys(name for stage in self.stages for name in stage.masked)
        return {name: min(self.stages[0].may[name]) for name in names}

    @property
    def changing(self) -> list[tuple[str, int]]:
        """Joints that let go within a stage, and the numbers of the kinds that they take."""
        found = {
            (name, number)
            for stage in self.stages
            for name in stage.masked
            for number in stage.may[name]
        }
        return sorted((name, number) for name, number in found if number > self.masked[name])

    @property
    def spent(self) -> list[str]:
        """Springs whose strokes may end."""
        return list(
            dict.fromkeys(
                e.which
                for stage in self.stages
                for e in stage.events
                if e.what == at.AT_SPRING_STROKE
            )
        )

    def told(self, joint: str) -> list[Change]:
        """What events tell a joint."""
        return [change for change in self.changes if change.joint == joint]

    def rubbing(self, stage: Stage) -> list[str]:
        """Joints whose pins may slide in a phase, with friction."""
        guides = {
            name: joint.guide
            for name, joint in self.scene.joint.items()
            if joint.guide is not None and stage.sliding(name)
        }
        return [
            name
            for name, guide in guides.items()
            if self.may(f"joint.{name}.guide.friction", guide.friction > 0.0)
        ]

    def plain_axes(self, joint: str) -> bool:
        """Whether a joint's axes are those of its first body."""
        j = self.scene.joint[joint]
        if f"joint.{joint}.x_axis.x" in self.plan.slots:
            return False
        return tuple(joint_axes(j.x_axis, j.y_axis)) == _IDENTITY
