"""Emitter of clearances, the minimum distances between the outlines of two bodies: every step is
searched for a smaller distance."""

import math
from collections.abc import Iterator
from typing import Any, NamedTuple

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
    ``search_clearances_SEGMENT(w)``, which does so for all clearances and lanes; and for these
    ``bound_motion(w)`` and ``screen_outlines(w, ...)``, which find the lanes to search. Add their
    fields to the workspace. Results are stored in the field CLEARANCES, NaN until a distance is
    known."""
    powers, entries = c.extended.dense.shape[1], c.spec.scene.clearance
    for k in range(at.CLEARANCE_OUTCOMES * len(entries)):
        c.case.scope.store(component("CLEARANCES", k), math.nan)
    c.workspace.add("CLEARANCES", at.CLEARANCE_OUTCOMES * len(entries))
    c.workspace.add("SCREEN", at.SCREEN_PATH + powers * at.PATH)
    c.workspace.add("JOB", at.JOB_PATH + powers * at.PATH)
    c.workspace.add("NEAR", max((_pairs(c, i) for i in range(len(entries))), default=0))
    c.workspace.add("CENTRES", 6 * len(entries))
    for i, entry in enumerate(entries):
        for k, body in enumerate(entry.bodies):
            c.case.scope.store(component("CENTRES", 6 * i + 3 * k), c.case.centre_of_mass(body))
    docstring = (
        "Search the step of a lane for a smaller clearance "
        "(`sepmc.routines.clearances.search_clearance`)."
    )
    out.function("search_lane(w, job: int)", docstring)("search_clearance(w, job)")
    docstring = "Bound the relative motion over a step (`sepmc.routines.screening.screen_motion`)."
    out.function("bound_motion(w)", docstring)(f"screen_motion(w, SCREEN, {powers})")
    docstring = "Find lanes whose step may be nearer (`sepmc.routines.screening.screen_parts`)."
    out.function(
        "screen_outlines(w, near: int, a: int, step_a: int, count_a: int, b: int, step_b: int, "
        "count_b: int)",
        docstring,
    )("screen_parts(w, SCREEN, near, a, step_a, count_a, b, step_b, count_b)")
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
        s.scope.store(_path(at.PATH * q), vec3.scale(power, vec3.sub(b, a)))
        for k, body in enumerate(entry.bodies):
            quaternion = _attitude_coefficient(s, body, q)
            s.scope.store(
                _path(at.PATH * q + 3 + 4 * k),
                tuple(power * quaternion[i] for i in range(4)),
            )
        power = power * reach
    s.scope.write(text)
    _emit_screening(text, c, i)
    conditions = [f"w[REACH + l] * w[LENGTH + l] > {at.GRAIN}", is_active(c, segment, i)]
    conditions.append(f"w[{component('SCREEN', at.SCREEN_NEAR)} + l] > 0.0")
    text = text.lanes().block(f"if {' and '.join(f'({x})' for x in conditions if x != 'True')}:")
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


def _emit_screening(text: Text, c: Context, i: int) -> None:
    """Append lines that set the component SCREEN_NEAR to 1 in lanes in which clearance number ``i``
    may fall below its minimum so far in the step just made, whose path is in the field SCREEN, else
    to 0."""
    limit = component("CLEARANCES", at.CLEARANCE_OUTCOMES * i)
    text.lanes()(
        f"w[{component('SCREEN', at.SCREEN_LIMIT)} + l] = w[{limit} + l]",
        f"w[{component('SCREEN', at.SCREEN_NEAR)} + l] = 0.0",
    )
    text.components("6 * LANES")(
        f"w[{component('SCREEN', at.SCREEN_CENTRES)} + e + l] = "
        f"w[{component('CENTRES', 6 * i)} + e + l]"
    )
    text("bound_motion(w)")
    for near, a, b in _searches(c, i):
        numbers = ", ".join(f"{run.start}, {run.step}, {run.parts}" for run in (a, b))
        text.broken(f"screen_outlines(w, {near}, {numbers})")


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
    mass centres, and poses and motion from the field SCREEN, ``powers`` coefficients.

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
        ("SCREEN", at.SCREEN_POSES, at.JOB_POSES, at.POSES * at.POSE),
        ("SCREEN", at.SCREEN_PATH, at.JOB_PATH, powers * at.PATH),
    ):
        text.block(f"for k in range({count}):")(
            f"w[JOB + {offset} + k] = w[{field} + ({first} + k) * LANES + l]"
        )
    lines = []
    for near, *runs in _searches(c, i):
        values = {at.JOB_NEAR: f"{near} + l"}
        for side, run in enumerate(runs):
            values[at.JOB_PARTS + 2 * side] = run.of_lane
            values[at.JOB_PARTS + 2 * side + 1] = str(run.parts)
        lines.append("; ".join(f"w[JOB + {k}] = float({v})" for k, v in values.items()))
    return lines


def _pairs(c: Context, i: int) -> int:
    """Number of pairs of outline parts of clearance number ``i``: all its parts of one body times
    all of the other. Like `_part_runs`, adds workspace fields of outlines."""
    return math.prod(sum(run.parts for run in _part_runs(c, i, side)) for side in range(2))


def _searches(c: Context, i: int) -> Iterator[tuple[str, "_Run", "_Run"]]:
    """Yield, for each search of clearance number ``i``, the workspace path of the marks of its
    pairs and the runs of parts of the first and of the second body."""
    one, other = (_part_runs(c, i, side) for side in range(2))
    before = 0
    for a in one:
        for b in other:
            yield component("NEAR", before), a, b
            before += a.parts * b.parts


class _Run(NamedTuple):
    """Consecutive parts of an outline: workspace path (code) of the first one for lane 0; distance
    in numbers from there to that of the next lane, 0 if all lanes share it; number of parts."""

    start: str
    step: int
    parts: int

    @property
    def of_lane(self) -> str:
        """Workspace path of the first part of lane ``l``."""
        return f"{self.start} + {self.step} * l" if self.step else self.start


def _part_runs(c: Context, i: int, side: int) -> list[_Run]:
    """Runs of consecutive outline parts that clearance number ``i`` includes of its first
    (``side`` 0) or second (1) body. A search follows each pair of a run of the first body and one
    of the second. If parameters of the body's outline vary from case to case, its workspace field
    OUTLINE_BODY is added."""
    model, bodies = c.spec.layout.model, [*c.spec.bodies, GROUND]
    entry, runs = c.spec.scene.clearance[i], []
    body = entry.bodies[side]
    shared, total = (
        int(model.table[int(c.model.parts_i) + 2 * bodies.index(body) + n]) for n in range(2)
    )
    varies = body in c.spec.layout.outlines
    if varies:
        c.workspace.add(f"OUTLINE_{body}", at.PART_SIZE * total)
    for first, count in packed_runs(c.spec.scene, entry, side):
        if varies:
            start, step = f"OUTLINE_{body} + {at.PART_SIZE * first}", at.PART_SIZE * total
        else:
            start, step = f"SHARED + {shared + at.PART_SIZE * first}", 0
        runs.append(_Run(start, step, count))
    return runs


def emit_clearance_at(text: Text, s: State, i: int, active: str, destination: str) -> None:
    """Append lines that store clearance ``i`` (the distance of its two bodies at the state ``s``,
    m) at the workspace path ``destination`` (code of an index, without the lane); NaN in lanes
    where the condition ``active`` (code) is not satisfied. The search is that over a step without
    motion."""
    entry = s.spec.scene.clearance[i]
    path = State(s.c, s.c.scope(), s.segment, s.field, s.clock)
    a, b = (path.position(body) for body in entry.bodies)
    path.scope.store(_path(0), vec3.sub(b, a))
    for k, body in enumerate(entry.bodies):
        path.scope.store(_path(3 + 4 * k), _quaternion(path, body))
    path.scope.write(text)
    powers, pairs = s.c.extended.dense.shape[1], _pairs(s.c, i)
    text.components(f"{(powers - 1) * at.PATH} * LANES")(f"w[{_path(at.PATH)} + e + l] = 0.0")
    text("bound_motion(w)")
    text.components(f"{pairs} * LANES")("w[NEAR + e + l] = 1.0")
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
    """True if clearance number ``i``, from 0, is measured from the start of a case: it waits for no
    release of a joint, or that joint is free from the start."""
    after, first = c.spec.scene.clearance[i].after, c.spec.segments[0]
    return after is None or min(first.joint_kinds[after]) in first.free_kinds(after)


def _path(k: int) -> str:
    """Workspace path of number ``k`` of the path over a step, in the field SCREEN."""
    return component("SCREEN", at.SCREEN_PATH + k)


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
    in the polynomial of the state over the step just made. The fraction is that of LENGTH: it ends
    at REACH, below 1 if the step was cut short."""
    return f"POWERS + {q} * SIZE_Y" if q else "BEGIN"
