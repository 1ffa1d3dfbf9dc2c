"""What a specialised kernel has to know of a scene: groups of bodies that turn as one, constraint rows, events; and why it cannot fly some.

Only structure counts here, no numbers: scenes of the same shape share a kernel.
"""

import math
from collections.abc import Iterator
from dataclasses import dataclass, field
from functools import cached_property
from itertools import pairwise

from sepmc.compiler.conditions import Leaf, make_conditions
from sepmc.compiler.heights import may_pass_borders, rows_step
from sepmc.compiler.naming import Names
from sepmc.compiler.plan import Plan
from sepmc.kernels import layout as at
from sepmc.scene.kinds import joint_axes, rows_of
from sepmc.scene.model import GROUND, Phase, Scene, Until
from sepmc.scene.redundancy import dependent_rows, redundancies

_ON_STATE = {"stroke": at.AT_STROKE, "distance": at.AT_DISTANCE, "angle": at.AT_ANGLE, "altitude": at.AT_ALTITUDE}
_ON_LOAD = {"force": at.AT_FORCE, "moment": at.AT_MOMENT}
_MOST_ROWS = 256  # steps of such a length that a flight may have
_UNTOLD = 2**17  # stretches of a phase that a load may end: each as long as the phase usually is, or a share of the time left
_IDENTITY = (1.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 1.0)


@dataclass(frozen=True)
class Row:
    """A constraint row: its joint and its code (`sepmc.kernels.layout`); whether its joint lets go of it within its stage."""

    joint: str
    code: int
    goes: bool = False

    @property
    def turns(self) -> bool:
        """Whether it constrains a rotation."""
        return at.ROTATION <= self.code < at.ROD


@dataclass(frozen=True)
class Event:
    """A condition on the state: ``what`` (AT_STROKE, ...) of which joint, spring or body, and where its threshold stands in w; whether it
    ends its phase by itself, or else its number among the conditions that do so together, or, ``apart`` from phases, release a joint."""

    what: int
    which: str
    threshold: int
    ends_phase: bool
    number: int = -1
    apart: bool = False

    @property
    def name(self) -> str:
        """What it is called within its stage."""
        if self.is_border:
            return f"{self.which}_{'top' if self.what == at.AT_LAYER_TOP else 'base'}"
        return self.which if self.number < 0 else f"{self.which}_{self.number}"

    @property
    def is_border(self) -> bool:
        """Whether it is a border of a body's layer of air, which is met as often as it is passed."""
        return self.what in (at.AT_LAYER_TOP, at.AT_LAYER_BASE)

    def flag(self, stage: str) -> str:
        """Where it is noted that it is met."""
        if self.is_border:
            return f"ENTERS_{self.which}"
        if self.ends_phase:
            return "DONE"
        return f"SPENT_{self.which}" if self.number < 0 else met(APART if self.apart else stage, self.number)


APART = "apart"  # in place of a phase, of a condition that releases a joint in any


def met(stage: str, number: int) -> str:
    """Where it is noted that one of several conditions is met."""
    return f"MET_{stage}_{number}"


def numbers_of(clauses: list[tuple[int, ...]]) -> list[int]:
    """Numbers of the conditions that clauses are made of."""
    return sorted({number for clause in clauses for number in clause})


@dataclass
class Cut:
    """A release apart from phases, of a joint: any of clauses, each all of conditions by number; those of these that are times, places of
    what adds up to them, those on the state and those on loads; the place of the joint's delay."""

    joint: str
    clauses: list[tuple[int, ...]]
    times: dict[int, tuple[int, ...]]
    events: list[Event]
    loads: list[Event]
    delay: int


@dataclass
class Stage:
    """A phase, or the time after it in which joints are late in letting go: its groups of bodies that turn as one (the first leads), its
    rows, what ends it, and what it does not hold any more."""

    name: str
    phase: str
    groups: list[tuple[str, ...]]
    rows: list[Row]
    welds: list[str]  # joints that let nothing turn, whose bodies turn as one
    held: "Kinds"  # what joints hold, by the codes of their rows; and what they still hold once all have let go that do so within it
    still_held: "Kinds"
    dropped: list[Row] = field(default_factory=list)  # rows that follow from the others
    redundant: int = 0  # how many would, if each body turned by itself: what joints carry is then not unique
    events: list[Event] = field(default_factory=list)
    loads: list[Event] = field(default_factory=list)  # conditions on what joints carry
    end_time: tuple[int, ...] = ()  # places in w of what adds up to the time that ends it; none: the end of the run
    delay: int | None = None  # place in w of the delay of the joint that lets go then
    late: dict[str, int] = field(default_factory=dict)  # joints that are late, and the places of their delays: the last one ends it
    after_late: bool = False  # whether its end was waited for before it began, while joints were late
    awaited: Event | None = None  # the condition that ends the phase after it and is waited for while joints are late
    clauses: list[tuple[int, ...]] = field(default_factory=list)  # of several conditions: any of these ends it, each all of its numbers
    times: dict[int, tuple[int, ...]] = field(default_factory=dict)  # which of them are times: places of what adds up to them
    cuts: list[Cut] = field(default_factory=list)  # releases apart from phases of joints that it holds
    released: list[str] = field(default_factory=list)  # joints that become free as it begins
    set_free: list[str] = field(default_factory=list)  # joints that become free within it
    stops: int = 1

    @property
    def every_row(self) -> list[Row]:
        """What all joints hold, each body turning by itself."""
        return [Row(joint, code) for joint, codes in self.held.items() for code in codes]

    def leader(self, body: str) -> str:
        """The body whose attitude is that of a body, or the ground."""
        return next(group[0] for group in self.groups if body in group)

    def holds(self, joint: str) -> bool:
        """Whether a joint holds something."""
        return joint in self.welds or any(row.joint == joint for row in (*self.rows, *self.dropped))

    def slides(self, joint: str) -> tuple[bool, bool]:
        """Whether the pins of a joint are engaged and may slide: at first, and once it has let go."""
        return _slides(self.held[joint]), _slides(self.still_held[joint])

    @property
    def masked(self) -> list[str]:
        """Joints that let go within it: their rows count until then."""
        return [*(joint for joint in self.late if len(self.late) > 1), *dict.fromkeys(cut.joint for cut in self.cuts)]

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
    """A scene as a specialised kernel sees it: all names are those of the kernel (`Names`), in ``plan`` and in ``dispersed`` too."""

    plan: Plan
    dispersed: frozenset[str]
    names: Names
    stages: list[Stage]
    turning: list[str]  # bodies in the order their attitudes stand in the state: leaders of the first phase first
    failing: list[str]  # joints that may fail to let go
    switches: bool  # whether loads switch on or off within a flight
    borders: bool  # whether bodies may pass from one layer of the standard atmosphere to another

    @property
    def scene(self) -> Scene:
        return self.plan.scene

    @property
    def bodies(self) -> list[str]:
        return self.plan.bodies

    def may(self, path: str, nominally: bool) -> bool:
        """Whether some case may have what the nominal one has if ``nominally``, since a parameter says so that may be dispersed."""
        return nominally or path in self.dispersed

    def feels_air(self, body: str) -> bool:
        """Whether a body has aerodynamics, and air to fly in."""
        return self.scene.environment.atmosphere != "none" and self.scene.body[body].aerodynamics is not None

    def in_layers(self, body: str) -> bool:
        """Whether a body flies in the layers of the standard atmosphere, whose density is expanded about its height."""
        return self.scene.environment.atmosphere == "us1976" and self.feels_air(body)

    def active(self, stage: Stage) -> int:
        """Numbers of the state that are integrated in a phase."""
        return 6 * len(self.bodies) + 1 + 7 * (1 + max((self.turning.index(b) for b in stage.leaders), default=-1))

    def rubbing(self, stage: Stage) -> list[str]:
        """Joints whose pins may slide in a phase, with friction."""
        guides = {name: joint.guide for name, joint in self.scene.joint.items() if joint.guide is not None and any(stage.slides(name))}
        return [name for name, guide in guides.items() if self.may(f"joint.{name}.guide.friction", guide.friction > 0.0)]

    def plain_axes(self, joint: str) -> bool:
        """Whether a joint's axes are those of its first body."""
        j = self.scene.joint[joint]
        return tuple(joint_axes(j.x_axis, j.y_axis)) == _IDENTITY


def reasons(plan: Plan, dispersed: frozenset[str]) -> list[str]:
    """Why the general kernel flies a scene some of whose parameters, by path, are dispersed; empty if a specialised one does."""
    found = _obstacles(plan, dispersed)
    ends = [phase.until for phase in plan.scene.phase if phase.until is not None]
    asked = bool(plan.scene.release or redundancies(plan.scene)) or any(_has_load(until) or _is_manifold(until) for until in ends)
    if found or not asked:
        return found
    shape = make_shape(plan, dispersed)
    stages = shape.stages
    if any(stage.waits_for_load and stage.after_late for stage in stages):
        found.append("a joint's load that ends a phase and is waited for while another joint is late")
    if any(stage.clauses and stage.after_late for stage in stages):
        found.append("several conditions that end a phase and are waited for while a joint is late")
    for stage in stages:
        phase = shape.names.back[stage.phase]
        if stage.redundant and stage.masked:
            found.append(f"redundant rows while joints are late before phase {phase}, or may be released apart from phases")
        elif stage.redundant and any(any(stage.slides(name)) for name, joint in shape.scene.joint.items() if joint.guide is not None):
            found.append(f"pins of a guide in phase {phase}, in which rows are redundant")
    return found


def _obstacles(plan: Plan, dispersed: frozenset[str]) -> list[str]:
    """Why a specialised kernel cannot fly a scene: a phrase each; empty if it can."""
    scene, found = plan.scene, []
    for release in scene.release:
        if release.to != "free":
            found.append(f"release {release.name} of a joint that goes on holding")
        if _may_be_late(scene, release.joint, dispersed) and any(_lets_go_in_part(scene, release.joint, *p) for p in pairwise(scene.phase)):
            found.append(f"release {release.name} of a joint that phases let go late, in part")
    if rows_step(scene, plan.extremes) < scene.run.end_time / _MOST_ROWS:  # steps would have to be as short all the way
        found.append("a table over height whose rows are passed in a small part of the flight")
    if scene.solver.formulation != "reduced":
        found.append("the full formulation")
    return found


def _is_manifold(until: Until) -> bool:
    """Whether a phase ends by several conditions."""
    keys = ("time", "burn_out", "stroke", "distance", "angle", "force", "moment", "altitude")
    return bool(until.any or until.all) or sum(getattr(until, key) is not None for key in keys) != 1


def _has_load(until: Until) -> bool:
    """Whether a condition, or a part of it, is on what a joint carries."""
    return until.force is not None or until.moment is not None or any(map(_has_load, (*until.any, *until.all)))


def _changed(scene: Scene, phase: Phase, after: Phase) -> list[str]:
    """Joints that do not hold the same in a phase and in the one after it."""
    one, other = _kinds(scene, phase), _kinds(scene, after)
    return [name for name in scene.joint if one[name] != other[name]]


def _lets_go_in_part(scene: Scene, joint: str, phase: Phase, after: Phase) -> bool:
    """Whether a joint holds less in the phase after another, but something."""
    return joint in _changed(scene, phase, after) and bool(_kinds(scene, after)[joint])


def _released(scene: Scene, phase: Phase, after: Phase) -> list[str]:
    """Joints that hold something in a phase, and nothing in the one after it."""
    free = {name for name, joint in scene.joint.items() if not rows_of(joint, after.joints.get(name, "free"))}
    return [name for name, kind in phase.joints.items() if name in free and rows_of(scene.joint[name], kind)]


def _may_be_late(scene: Scene, joint: str, dispersed: frozenset[str]) -> bool:
    return scene.joint[joint].delay > 0.0 or f"joint.{joint}.delay" in dispersed


def make_shape(plan: Plan, dispersed: frozenset[str] = frozenset()) -> Shape:
    """The shape of a scene that has no obstacles."""
    names = Names(plan.scene)
    plan, dispersed = names.plan(plan), frozenset(names.path(path) for path in dispersed)
    scene = plan.scene
    stages: list[Stage] = []
    spent = {s.name: s.bodies for s in scene.spring if math.isfinite(s.stroke) or f"spring.{s.name}.stroke" in dispersed}
    switches = _breaks(scene, dispersed)
    cuts = _cuts(plan, dispersed)
    for number, phase in enumerate(scene.phase):
        stage = _stage(scene, phase.name, phase.name, _kinds(scene, phase), plan.bodies, cuts)
        if phase.until is not None and _is_manifold(phase.until):
            _add_clauses(stage, number, plan, dispersed)
        else:
            _add_end(stage, phase, plan, dispersed)
        if number:
            before = scene.phase[number - 1]
            stage.released = _released(scene, before, phase)
            _add_late(stages, stage, scene, before, phase, plan, dispersed, cuts)
        stages.append(stage)
    borders = may_pass_borders(scene, plan.extremes)
    for stage in stages:
        stage.events += [
            Event(at.AT_SPRING_STROKE, name, plan.slots[f"spring.{name}.stroke"], False)
            for name, bodies in spent.items()
            if not _still(scene, stage, bodies)
        ]
        for body in plan.bodies if borders else []:
            if scene.body[body].aerodynamics is not None:
                stage.events += [Event(what, body, -1, False) for what in (at.AT_LAYER_TOP, at.AT_LAYER_BASE)]
        stage.events += dict.fromkeys(event for cut in stage.cuts for event in cut.events)
        stage.loads += dict.fromkeys(load for cut in stage.cuts for load in cut.loads)
        times = len(stage.times) + sum(len(cut.times) for cut in stage.cuts)
        others = sum(not event.ends_phase for event in (*stage.events, *stage.loads))
        stage.stops = 1 + others + times + switches + len(stage.masked) + (_UNTOLD if stage.waits_for_load else 0)
    turning: list[str] = []
    for stage in stages:
        turning += [b for b in stage.leaders if b not in turning]
    turning += [b for b in plan.bodies if b not in turning]
    failing = [name for name, joint in scene.joint.items() if joint.fails > 0.0 or f"joint.{name}.fails" in dispersed]
    return Shape(plan, dispersed, names, stages, turning, failing, switches > 0, borders)


def _add_late(
    stages: list[Stage], stage: Stage, scene: Scene, before: Phase, phase: Phase, plan: Plan, dispersed: frozenset[str], cuts: list[Cut]
) -> None:
    """What joints that are late in letting go between two phases add: a delay to the end of the first, if that is a time and no other joint
    changes; or else a stage of its own, in which those joints hold as before and all others as from now on.

    What ends the second phase is waited for meanwhile, too: cases in which it may have come are lost (`Stage.after_late`).
    """
    changed = _changed(scene, before, phase)
    late = {name: plan.slots[f"joint.{name}.delay"] for name in changed if _may_be_late(scene, name, dispersed)}
    if not late:
        return
    if len(changed) == 1 and stages[-1].end_time:
        stages[-1].delay, stage.after_late = late[changed[0]], True
        stages[-1].awaited = next((event for event in stage.events if event.ends_phase), None)
        return
    kinds = _kinds(scene, phase) | {name: _kinds(scene, before)[name] for name in late}
    between = _stage(scene, f"{phase.name}_late", phase.name, kinds, plan.bodies, cuts, late, _kinds(scene, phase))
    free = stage.released
    between.released = [joint for joint in free if joint not in late]
    between.set_free += [joint for joint in free if joint in late and joint in between.masked]
    stage.released = [joint for joint in free if joint in late and joint not in between.masked]
    stage.after_late = True
    between.awaited = next((event for event in stage.events if event.ends_phase), None)
    stages.append(between)


def _add_end(stage: Stage, phase: Phase, plan: Plan, dispersed: frozenset[str]) -> None:
    """What ends a phase: a time, the end of a burn, or a condition on a joint."""
    until, path = phase.until, f"phase.{phase.name}.until"
    leaves = {leaf.path: place for leaf, place in _thresholds(plan, dispersed)}
    if until is None:
        return
    if until.time is not None:
        stage.end_time = (leaves[f"{path}.time"],)
    elif until.burn_out is not None:
        stage.end_time = _burn_out(plan, until.burn_out)
    elif key := next((key for key in _ON_LOAD if getattr(until, key) is not None), None):
        assert until.joint is not None
        stage.loads.append(Event(_ON_LOAD[key], until.joint, leaves[f"{path}.{key}"], True))
    else:
        key, what = next((key, what) for key, what in _ON_STATE.items() if getattr(until, key) is not None)
        which = until.body if what == at.AT_ALTITUDE else until.joint
        assert which is not None
        stage.events.append(Event(what, which, leaves[f"{path}.{key}"], True))


def _burn_out(plan: Plan, motor: str) -> tuple[int, ...]:
    """Places in w of what adds up to the time of a burn-out."""
    return tuple(plan.slots[f"motor.{motor}.{key}"] for key in ("ignition", "delay", "burn"))


def _add_clauses(stage: Stage, number: int, plan: Plan, dispersed: frozenset[str]) -> None:
    """Several conditions that end phase ``number``."""
    stage.clauses, stage.times, events, loads = _clauses(number, plan, dispersed)
    stage.events += events
    stage.loads += loads


def _clauses(
    number: int, plan: Plan, dispersed: frozenset[str]
) -> tuple[list[tuple[int, ...]], dict[int, tuple[int, ...]], list[Event], list[Event]]:
    """What makes the event ``number`` of all, the ends of phases first: any of clauses, each all of conditions; those that are times, those
    on the state, those on loads."""
    conditions, first = make_conditions(plan.scene, dispersed), int(plan.model.scene[0].leaves_p)
    start, count = conditions.events[2 * number : 2 * number + 2]
    clauses: list[tuple[int, ...]] = []
    times: dict[int, tuple[int, ...]] = {}
    on_state: list[Event] = []
    on_load: list[Event] = []
    for clause in range(start, start + count):
        begin, size = conditions.clauses[2 * clause : 2 * clause + 2]
        clauses.append(tuple(conditions.clause_leaves[begin : begin + size]))
    for k, leaf in enumerate(conditions.leaves):
        if leaf.event != number:
            continue
        if leaf.what == at.AT_TIME:
            times[k] = (first + k,)
        elif leaf.what == at.AT_BURN_OUT:
            times[k] = _burn_out(plan, leaf.which)
        else:
            event = Event(leaf.what, leaf.which, first + k, False, k, number >= len(plan.scene.phase))
            (on_load if leaf.what in _ON_LOAD.values() else on_state).append(event)
    return clauses, times, on_state, on_load


def _cuts(plan: Plan, dispersed: frozenset[str]) -> list[Cut]:
    """Releases apart from phases."""
    found, first = [], len(plan.scene.phase)
    for number, release in enumerate(plan.scene.release, first):
        found.append(Cut(release.joint, *_clauses(number, plan, dispersed), plan.slots[f"joint.{release.joint}.delay"]))
    return found


def _thresholds(plan: Plan, dispersed: frozenset[str]) -> Iterator[tuple[Leaf, int]]:
    """Leaves with a path of their own, and the place of their thresholds."""
    first = int(plan.model.scene[0].leaves_p)
    for number, leaf in enumerate(make_conditions(plan.scene, dispersed).leaves):
        if leaf.path is not None:
            yield leaf, first + number


def _still(scene: Scene, stage: Stage, bodies: tuple[str, str]) -> bool:
    """Whether two bodies cannot move relative to each other: one joint holds them altogether."""
    between = [row.joint for row in stage.rows if set(scene.joint[row.joint].bodies) == set(bodies) and not row.goes]
    return stage.leader(bodies[0]) == stage.leader(bodies[1]) and any(between.count(joint) == 3 for joint in between)


def brief_transient(scene: Scene) -> float:
    """Time constant, s, below which a transient is a stretch of its own, in which a kernel takes all steps of its phase."""
    return at.BRIEF / at.TRANSIENT * scene.run.end_time


def _breaks(scene: Scene, dispersed: frozenset[str]) -> int:
    """Number of times within a flight at which a load switches, at most."""
    count = 0
    for motor in scene.motor:
        path = f"motor.{motor.name}"
        count += motor.ignition > 0.0 or motor.delay > 0.0 or bool(dispersed & {f"{path}.ignition", f"{path}.delay"})
        count += math.isfinite(motor.burn) or motor.profile is not None or f"{path}.burn" in dispersed
        count += len(motor.profile.time) if motor.profile else 0
        for key in ("build_up", "tail_off"):  # only a brief one is a stretch of its own, and some case may have one
            count += 0.0 < getattr(motor, key) < brief_transient(scene) or f"{path}.{key}" in dispersed
    for load in scene.load:
        path = f"load.{load.name}"
        count += load.start > 0.0 or f"{path}.start" in dispersed
        count += math.isfinite(load.end) or f"{path}.end" in dispersed
    return int(count)


def _slides(codes: tuple[int, ...]) -> bool:
    """Whether rows leave their bodies free along x, but neither sideways nor to tilt: pins are engaged."""
    return codes.count(1) == codes.count(2) == 1 and 0 not in codes and sum(at.ROTATION <= code < at.ROD for code in codes) >= 2


def _kinds(scene: Scene, phase: Phase) -> "Kinds":
    """Codes of the rows of every joint in a phase."""
    return {name: tuple(rows_of(joint, phase.joints.get(name, "free"))) for name, joint in scene.joint.items()}


Kinds = dict[str, tuple[int, ...]]  # codes of the rows of every joint


def _stage(
    scene: Scene,
    name: str,
    phase: str,
    kinds: Kinds,
    bodies: list[str],
    cuts: list[Cut],
    late: dict[str, int] | None = None,
    after: Kinds | None = None,
) -> Stage:
    """Groups and rows of a stage. Rotations within a group are left out: its bodies share one attitude. With ``late`` joints, what all hold
    ``after`` it."""
    made = Stage(name, phase, [], [], [], kinds, kinds, late=late or {}, cuts=[cut for cut in cuts if kinds[cut.joint]])
    if after is not None and len(made.late) > 1:
        made.still_held = after
    made.still_held = made.still_held | {cut.joint: () for cut in made.cuts}
    made.set_free = list(dict.fromkeys(cut.joint for cut in made.cuts))
    staying = made.still_held
    group: dict[str, tuple[str, ...]] = {body: (body,) for body in [*bodies, GROUND]}
    order = [*bodies, GROUND]
    turns = {joint: sum(at.ROTATION <= code < at.ROD for code in staying[joint]) for joint in kinds}
    welds = [joint for joint, count in turns.items() if count == 3]
    for joint in welds:
        first, second = scene.joint[joint].bodies
        merged = tuple(sorted({*group[first], *group[second]}, key=order.index))
        merged = (GROUND, *(b for b in merged if b != GROUND)) if GROUND in merged else merged
        for body in merged:
            group[body] = merged
    rows: list[Row] = []
    for joint, codes in kinds.items():
        first, second = scene.joint[joint].bodies
        turn_as_one = group[first] == group[second]
        rows += [Row(joint, code, code not in staying[joint]) for code in codes if not (at.ROTATION <= code < at.ROD and turn_as_one)]
    named = {b for joint in scene.joint.values() for b in joint.bodies} | {b for spring in scene.spring for b in spring.bodies}
    found = [g for g in dict.fromkeys(group.values()) if g != (GROUND,) or GROUND in named]
    dependent = dependent_rows(scene, [(row.joint, row.code) for row in rows], [group for group in found if group != (GROUND,)])
    every = [(row.joint, row.code) for row in made.every_row]
    made.groups, made.welds, made.redundant = found, welds, len(dependent_rows(scene, every, []))
    made.rows = [row for number, row in enumerate(rows) if number not in dependent]
    made.dropped = [rows[number] for number in dependent]
    return made
