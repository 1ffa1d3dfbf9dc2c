"""Lines of a written kernel that search every step for the least distance between bodies."""

import math
from typing import Any

from sepmc.kernel.emit.context import Context, among, component, rejection_unless
from sepmc.kernel.emit.geometry import State
from sepmc.kernel.spec.kernel_spec import Segment
from sepmc.kernel.tracer.formulas import vec3
from sepmc.kernel.tracer.text import Text
from sepmc.routines import layout as at
from sepmc.scene.model import GROUND, Clearance


def emit_clearances(out: Text, c: Context) -> None:
    """A function that searches the step of a lane, and for every phase one that searches those of
    all."""
    powers, entries = c.extended.dense.shape[1], c.spec.scene.clearance
    for k in range(at.CLEARANCE_OUTCOMES * len(entries)):
        c.case.scope.store(component("CLEARANCES", k), math.nan)
    c.workspace.add("CLEARANCES", at.CLEARANCE_OUTCOMES * len(entries))
    (
        c.workspace.add("PATH", powers * at.PATH),
        c.workspace.add("JOB", at.JOB_PATH + powers * at.PATH),
    )
    c.workspace.add("CENTRES", 6 * len(entries))
    for i, entry in enumerate(entries):
        for k, body in enumerate(entry.bodies):
            c.case.scope.store(component("CENTRES", 6 * i + 3 * k), c.case.centre_of_mass(body))
    says = (
        "Search the step of a lane for less than a clearance so far: see "
        "`sepmc.routines.clearances.search_clearance`."
    )
    out.function("search_lane(w, job: int)", says)("search_clearance(w, job)")
    for segment in c.spec.segments:
        if which := c.active_clearances(segment):
            text = out.function(
                f"search_clearances_{segment.name}(w)",
                f"Search the step just made in phase {segment.name} for the least clearances.",
            )
            for i in which:
                _search(text, c, segment, i, entries[i])


def _search(text: Text, c: Context, segment: Segment, i: int, entry: Clearance) -> None:
    """Lines that search the steps of all lanes for one clearance."""
    powers = c.extended.dense.shape[1]
    text(f"# {' and '.join(entry.bodies)}")
    s = State(c, c.scope(), segment, "S")
    reach: Any = s.scope.load("REACH")
    share: Any = 1.0
    for q in range(powers):
        a, b = (_place(s, body, q) for body in entry.bodies)
        s.scope.store(component("PATH", at.PATH * q), vec3.scale(share, vec3.sub(b, a)))
        for k, body in enumerate(entry.bodies):
            turning = _attitude(s, body, q)
            s.scope.store(
                component("PATH", at.PATH * q + 3 + 4 * k),
                tuple(share * turning[i] for i in range(4)),
            )
        share = share * reach
    s.scope.write(text)
    moves, counts = f"w[REACH + l] * w[LENGTH + l] > {at.GRAIN}", counts_in(c, segment, i)
    text = text.lanes().block(f"if {moves if counts == 'True' else f'{moves} and ({counts})'}:")
    text(
        f"w[JOB + {at.JOB_TIME}], w[JOB + {at.JOB_LENGTH}] = w[BEGIN_T + l], w[REACH + l] * "
        "w[LENGTH + l]",
    )
    found = ("CLEARANCES", at.CLEARANCE_OUTCOMES * i, at.JOB_RESULT, at.CLEARANCE_OUTCOMES)
    _ask(text, c, i, powers, found)
    inner = text.block(f"for k in range({at.CLEARANCE_OUTCOMES}):")
    inner(
        f"w[CLEARANCES + ({at.CLEARANCE_OUTCOMES * i} + k) * LANES + l] = w[JOB + {at.JOB_RESULT} "
        "+ k]"
    )
    text(rejection_unless(f"w[JOB + {at.JOB_DONE}] > 0.0"))


def counts_in(c: Context, segment: Segment, i: int) -> str:
    """The condition, for a lane, that a clearance counts in a phase: from the start, or once its
    joint is free."""
    after = c.spec.scene.clearance[i].after
    if i not in c.active_clearances(segment):
        return "False"
    return among(after, segment.free_kinds(after)) if after in segment.variable_joints else "True"


def _ask(text: Text, c: Context, i: int, powers: int, *more: tuple[str, int, int, int]) -> None:
    """Lines that search what PATH tells of a lane, by so many powers, for a clearance; ``more``
    that it is to begin with: field, the first of its numbers, place in the job, count."""
    text(f"w[JOB + {at.JOB_POWERS}] = {float(powers)}")
    model, bodies = c.spec.layout.model, [*c.spec.bodies, GROUND]
    for k, body in enumerate(c.spec.scene.clearance[i].bodies):
        first, count = (
            int(model.table[int(c.model.parts_i) + 2 * bodies.index(body) + n]) for n in range(2)
        )
        place, start = at.JOB_PARTS + 2 * k, f"SHARED + {first}"
        if body in c.spec.layout.outlines:
            c.workspace.add(f"OUTLINE_{body}", at.PART_SIZE * count)
            start = f"OUTLINE_{body} + {at.PART_SIZE * count} * l"
        text(f"w[JOB + {place}], w[JOB + {place + 1}] = float({start}), {float(count)}")
    for field, first, place, count in (
        ("CENTRES", 6 * i, at.JOB_CENTRES, 6),
        *more,
        ("PATH", 0, at.JOB_PATH, powers * at.PATH),
    ):
        text.block(f"for k in range({count}):")(
            f"w[JOB + {place} + k] = w[{field} + ({first} + k) * LANES + l]"
        )
    text("search_lane(w, JOB)")


def clearance_now(text: Text, s: State, i: int, counts: str, place: str) -> None:
    """Lines that put the distance of a clearance's bodies at a state into ``place`` of the lanes,
    NaN where it does not count yet: a step in which nothing moves is searched for it."""
    entry = s.spec.scene.clearance[i]
    path = State(s.c, s.c.scope(), s.segment, s.field, s.clock)
    a, b = (path.place(body) for body in entry.bodies)
    path.scope.store("PATH", vec3.sub(b, a))
    for k, body in enumerate(entry.bodies):
        path.scope.store(component("PATH", 3 + 4 * k), _quaternion(path, body))
    path.scope.write(text)
    text = text.lanes()
    text(f"w[{place} + l] = math.nan")
    text = text.block(f"if {counts}:")
    text(
        f"w[JOB + {at.JOB_TIME}], w[JOB + {at.JOB_LENGTH}] = 0.0, 1.0",
        f"w[JOB + {at.JOB_RESULT}], w[JOB + {at.JOB_RESULT + 1}] = math.nan, math.nan",
    )
    _ask(text, s.c, i, 1)
    text(f"w[{place} + l] = w[JOB + {at.JOB_RESULT}]")


def counts_from_start(c: Context, i: int) -> bool:
    """Whether a clearance counts from the start of a flight, whatever is let go."""
    after, first = c.spec.scene.clearance[i].after, c.spec.segments[0]
    return after is None or min(first.joint_kinds[after]) in first.free_kinds(after)


def _place(s: State, body: str, q: int) -> Any:
    """Coefficient of the place of a body over the step by power ``q`` of its share gone by."""
    if body == GROUND:
        times = s.scope.load("BEGIN_T") if q == 0 else s.scope.load("LENGTH") if q == 1 else 0.0
        return vec3.scale(times, s.speed(GROUND))
    return s.scope.load(f"{_powers(q)} + X_{body}", 3)


def _attitude(s: State, body: str, q: int) -> Any:
    """The same of its quaternion."""
    leader = s.segment.leader(body)
    if leader == GROUND:
        return s.case.attitude if q == 0 else (0.0, 0.0, 0.0, 0.0)
    return s.scope.load(f"{_powers(q)} + Q_{leader}", 4)


def _quaternion(s: State, body: str) -> Any:
    """Attitude quaternion of a body at a state."""
    leader = s.segment.leader(body)
    return s.case.attitude if leader == GROUND else s.quaternion(leader)


def _powers(q: int) -> str:
    return f"POWERS + {q} * SIZE_Y" if q else "BEGIN"
