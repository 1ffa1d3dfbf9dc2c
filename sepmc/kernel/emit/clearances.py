"""Emitter of clearances, the minimum distances between the outlines of two bodies: every step is
searched for a smaller distance."""

import math
from typing import Any

from sepmc.kernel.emit.context import Context, component, has_kind, rejection_unless
from sepmc.kernel.emit.geometry import State
from sepmc.kernel.spec.kernel_spec import Segment
from sepmc.kernel.tracer.formulas import vec3
from sepmc.kernel.tracer.text import Text
from sepmc.routines import layout as at
from sepmc.scene.model import GROUND, Clearance
from sepmc.scene.outline_parts import packed_runs


def emit_clearances(out: Text, c: Context) -> None:
    """Write the kernel functions ``search_lane(w, job)``, which searches the step of one lane for
    a distance smaller than the smallest one so far, and, for every segment with clearances,
    ``search_clearances_SEGMENT(w)``, which does so for all clearances and lanes. Results are stored
    in the field CLEARANCES, NaN until a distance is known."""
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
    docstring = (
        "Search the step of a lane for a smaller clearance "
        "(`sepmc.routines.clearances.search_clearance`)."
    )
    out.function("search_lane(w, job: int)", docstring)("search_clearance(w, job)")
    for segment in c.spec.segments:
        if active := c.active_clearances(segment):
            text = out.function(
                f"search_clearances_{segment.name}(w)",
                f"Search the step just made in phase {segment.name} for the minimum clearances.",
            )
            for i in active:
                _emit_search(text, c, segment, i, entries[i])


def _emit_search(text: Text, c: Context, segment: Segment, i: int, entry: Clearance) -> None:
    """Append lines that search the step just made, in all lanes, for a smaller distance of
    clearance ``entry``, which has the number ``i``, than the smallest one so far; a case is
    rejected (for smaller steps) if the search is not complete."""
    powers = c.extended.dense.shape[1]
    text(f"# {' and '.join(entry.bodies)}")
    s = State(c, c.scope(), segment, "S")
    reach: Any = s.scope.load("REACH")
    power: Any = 1.0
    for q in range(powers):
        a, b = (_position_coefficient(s, body, q) for body in entry.bodies)
        s.scope.store(component("PATH", at.PATH * q), vec3.scale(power, vec3.sub(b, a)))
        for k, body in enumerate(entry.bodies):
            quaternion = _attitude_coefficient(s, body, q)
            s.scope.store(
                component("PATH", at.PATH * q + 3 + 4 * k),
                tuple(power * quaternion[i] for i in range(4)),
            )
        power = power * reach
    s.scope.write(text)
    moves, active = f"w[REACH + l] * w[LENGTH + l] > {at.GRAIN}", is_active(c, segment, i)
    text = text.lanes().block(f"if {moves if active == 'True' else f'{moves} and ({active})'}:")
    text(
        f"w[JOB + {at.JOB_TIME}], w[JOB + {at.JOB_LENGTH}] = w[BEGIN_T + l], w[REACH + l] * "
        "w[LENGTH + l]",
    )
    results = ("CLEARANCES", at.CLEARANCE_OUTCOMES * i, at.JOB_RESULT, at.CLEARANCE_OUTCOMES)
    for parts in _emit_job(text, c, i, powers, results):
        text(parts, "search_lane(w, JOB)")
        text(rejection_unless(f"w[JOB + {at.JOB_DONE}] > 0.0"))
    inner = text.block(f"for k in range({at.CLEARANCE_OUTCOMES}):")
    inner(
        f"w[CLEARANCES + ({at.CLEARANCE_OUTCOMES * i} + k) * LANES + l] = w[JOB + {at.JOB_RESULT} "
        "+ k]"
    )


def is_active(c: Context, segment: Segment, i: int) -> str:
    """Kernel code, within a loop over lanes, of the condition that clearance number ``i``, from 0,
    is measured in a segment: "True", "False", or a comparison that is true once the joint that the
    clearance names in ``after`` is free."""
    after = c.spec.scene.clearance[i].after
    if i not in c.active_clearances(segment):
        return "False"
    return (
        has_kind(after, segment.free_kinds(after)) if after in segment.variable_joints else "True"
    )


def _emit_job(
    text: Text, c: Context, i: int, powers: int, *more: tuple[str, int, int, int]
) -> list[str]:
    """Append lines that copy the inputs of a search for clearance ``i`` in a lane to the field JOB:
    mass centres, and the motion from the field PATH, ``powers`` coefficients.

    ``more`` are further inputs to copy, as (field, first component, offset in the job, count).

    Returns
    -------
    list of str
        For each search of the lane, the line that sets which parts of both outlines are searched;
        the caller appends it before the call of the search.
    """
    text(f"w[JOB + {at.JOB_POWERS}] = {float(powers)}")
    for field, first, offset, count in (
        ("CENTRES", 6 * i, at.JOB_CENTRES, 6),
        *more,
        ("PATH", 0, at.JOB_PATH, powers * at.PATH),
    ):
        text.block(f"for k in range({count}):")(
            f"w[JOB + {offset} + k] = w[{field} + ({first} + k) * LANES + l]"
        )
    one, other = (_part_lines(c, i, side) for side in range(2))
    return [f"{a}; {b}" for a in one for b in other]


def _part_lines(c: Context, i: int, side: int) -> list[str]:
    """Lines of kernel code, one for each run of consecutive outline parts that clearance number
    ``i`` includes of its first (``side`` 0) or second (1) body.

    A line sets two components of the field JOB: the position in the workspace of the first part of
    the run, and the number of its parts. A search (``search_lane``) follows each pair of a line of
    the first body and one of the second."""
    model, bodies = c.spec.layout.model, [*c.spec.bodies, GROUND]
    entry, lines = c.spec.scene.clearance[i], []
    body, offset = entry.bodies[side], at.JOB_PARTS + 2 * side
    shared, total = (
        int(model.table[int(c.model.parts_i) + 2 * bodies.index(body) + n]) for n in range(2)
    )
    varies = body in c.spec.layout.outlines
    if varies:
        c.workspace.add(f"OUTLINE_{body}", at.PART_SIZE * total)
    for first, count in packed_runs(c.spec.scene, entry, side):
        start = f"SHARED + {shared + at.PART_SIZE * first}"
        if varies:
            start = f"OUTLINE_{body} + {at.PART_SIZE} * ({total} * l + {first})"
        lines.append(f"w[JOB + {offset}], w[JOB + {offset + 1}] = float({start}), {float(count)}")
    return lines


def emit_clearance_at(text: Text, s: State, i: int, active: str, destination: str) -> None:
    """Append lines that store clearance ``i`` (the distance of its two bodies at the state ``s``,
    m) at the workspace path ``destination`` (code of an index, without the lane); NaN in lanes
    where the condition ``active`` (code) is not satisfied. The search is that over a step without
    motion."""
    entry = s.spec.scene.clearance[i]
    path = State(s.c, s.c.scope(), s.segment, s.field, s.clock)
    a, b = (path.position(body) for body in entry.bodies)
    path.scope.store("PATH", vec3.sub(b, a))
    for k, body in enumerate(entry.bodies):
        path.scope.store(component("PATH", 3 + 4 * k), _quaternion(path, body))
    path.scope.write(text)
    text = text.lanes()
    text(f"w[{destination} + l] = math.nan")
    text = text.block(f"if {active}:")
    text(
        f"w[JOB + {at.JOB_TIME}], w[JOB + {at.JOB_LENGTH}] = 0.0, 1.0",
        f"w[JOB + {at.JOB_RESULT}], w[JOB + {at.JOB_RESULT + 1}] = math.nan, math.nan",
    )
    for parts in _emit_job(text, s.c, i, 1):
        text(parts, "search_lane(w, JOB)")
    text(f"w[{destination} + l] = w[JOB + {at.JOB_RESULT}]")


def is_active_at_start(c: Context, i: int) -> bool:
    """True if clearance number ``i``, from 0, is measured from the start of a case, not only after
    the release of a joint."""
    after, first = c.spec.scene.clearance[i].after, c.spec.segments[0]
    return after is None or min(first.joint_kinds[after]) in first.free_kinds(after)


def _position_coefficient(s: State, body: str, q: int) -> Any:
    """Coefficient (vector, m) of power ``q`` of the elapsed fraction of the step just made, in the
    polynomial of the position of a body's mass centre over that step. Positions are those of
    `State.position`: in the frame that moves with the vehicle, so that the ground moves too."""
    if body == GROUND:
        times = s.scope.load("BEGIN_T") if q == 0 else s.scope.load("LENGTH") if q == 1 else 0.0
        return vec3.scale(times, s.velocity(GROUND))
    return s.scope.load(f"{_power_field(q)} + X_{body}", 3)


def _attitude_coefficient(s: State, body: str, q: int) -> Any:
    """Coefficient (4 numbers) of power ``q`` of the elapsed fraction of the step just made, in the
    polynomial of the attitude quaternion of a body over that step."""
    leader = s.segment.leader(body)
    if leader == GROUND:
        return s.case.attitude if q == 0 else (0.0, 0.0, 0.0, 0.0)
    return s.scope.load(f"{_power_field(q)} + Q_{leader}", 4)


def _quaternion(s: State, body: str) -> Any:
    """Attitude quaternion, body to ground, of a body at a state."""
    leader = s.segment.leader(body)
    return s.case.attitude if leader == GROUND else s.quaternion(leader)


def _power_field(q: int) -> str:
    """Workspace path of the coefficients (a state vector) of power ``q`` of the elapsed fraction,
    in the polynomial of the state over the step just made."""
    return f"POWERS + {q} * SIZE_Y" if q else "BEGIN"
