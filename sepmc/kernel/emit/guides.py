"""Pins of guides in a written kernel: friction in balance with the loads that it changes, and what
each pin carries."""

import math
from dataclasses import replace
from typing import Any

from sepmc.kernel.emit.context import Context, among, component, reject_unless, rejection_unless
from sepmc.kernel.emit.geometry import State
from sepmc.kernel.emit.motion import Motion, make_drive, make_motion, without_joints
from sepmc.kernel.emit.rows import DEPENDENT, LeastSquares, Rows
from sepmc.kernel.emit.wrenches import force_of, moment_of
from sepmc.kernel.spec.kernel_spec import Row, Segment
from sepmc.kernel.spec.variant import Variant
from sepmc.kernel.tracer.formulas import ZERO, guides, scalar, vec3
from sepmc.kernel.tracer.text import Text
from sepmc.kernel.tracer.tracer import Expr, total, where
from sepmc.routines import layout as at
from sepmc.scene.model import GROUND
from sepmc.schema import Status

# lateral forces (y, z) of pins: of every pin at the mouth and at the tip
Ends = list[tuple[Any, Any]]


def emit_friction(out: Text, c: Context, segment: Segment) -> None:
    """A function for the friction of a phase's guides; the other functions of the phase take it as
    a load that is known."""
    joints = c.spec.friction_joints(segment)
    if not joints:
        return
    says = (
        f"Friction of the guides of phase {segment.name} at the state S and the times CLOCK, "
        "into FRICTION; a case may jam."
    )
    text = out.function(f"friction_{segment.name}(w)", says)
    ends = [2 * c.pins(joint) for joint in joints]
    c.workspace.add("FRICTION", len(c.spec.scene.joint))
    c.workspace.add(f"PIN_FORCES_{segment.name}", sum(1 + n * (2 + 2 * len(joints)) for n in ends))
    s = State(c, c.scope(), segment, "S")
    motion, place = make_motion(s, rubs=False), 0
    drives = [make_drive(s, motion, joint) for joint in joints]
    for joint in joints:
        s.scope.comment(f"pins of {joint}")
        numbers = [_friction_per_newton(s, joint)]
        for forces in zip(*(pin_forces(s, one, joint) for one in (motion, *drives)), strict=True):
            numbers += [x for force in forces for x in force]
        for number in numbers:
            s.scope.store(component(f"PIN_FORCES_{segment.name}", place), number)
            place += 1
    s.scope.write(text)
    inner = text.lanes().block(
        f"if not friction.balance(w, PIN_FORCES_{segment.name} + l, {tuple(ends)}, FRICTION + l):"
    )
    inner(rejection_unless("False", Status.JAMMED))


def _friction_per_newton(s: State, joint: str) -> Any:
    """What 1 N on the pins of a joint rubs, along the direction of separation."""
    p, speed = s.case.joint(joint), s.separation(joint).rate
    friction = guides.friction_force(
        s.case.number(p + at.FRICTION), 1.0, speed, s.case.number(p + at.SLIP_SPEED)
    )
    return friction * s.sliding(joint)


def pin_forces(s: State, motion: Motion, joint: str) -> Ends:
    """Lateral forces of all pins of a joint, or by how much a force changes them."""
    c, p, count = s.case, s.case.joint(joint), s.c.pins(joint)
    axes = [s.axis(joint, k) for k in range(3)]
    force, moment = (
        tuple(0.0 if vector is ZERO else vec3.dot(vector, axis) for axis in axes)
        for vector in (force_of(motion, joint), moment_of(s, motion, joint))
    )
    closed = c.number(p + at.ENGAGED)
    engaged = scalar.larger(closed - s.separation(joint).length, at.MIN_ENGAGED * closed).called(
        "engaged"
    )
    mouth, tip = guides.bearing_forces(force, moment, engaged, c.separation_sign(joint)).called(
        "bearing"
    )
    found = []
    for pin in range(count):
        around = guides.around_circle(
            float(pin), float(count), c.number(p + at.CIRCLE), c.number(p + at.PIN_CLOCK)
        ).called("around")
        around = (around[0], around[1])
        found += [
            tuple(guides.pin_force(tuple(end), moment[0], around, float(count)).called("pin"))
            for end in (mouth, tip)
        ]
    return found


def watch_guide(s: State, motion: Motion, joint: str) -> list[Any]:
    """Numbers of a guide at a state, vectors all: what drives it apart, what each pin would carry
    at both ends if friction balanced that, and what it does carry."""
    if s.segment.least_squares:
        return _watch_held(s, motion, joint)
    line, per_newton = s.separation(joint), make_drive(s, motion, joint)
    pair, apart = s.spec.scene.joint[joint].bodies, s.case.separation_sign(joint)
    faster = apart * s.lengthening(pair, line, motion.acceleration, motion.spin_rate)
    mobility = apart * s.lengthening(
        pair, line, per_newton.acceleration, per_newton.spin_rate, moving=False
    )
    alone = total([s.case.inverse_mass(body) for body in pair if body != GROUND])
    # what else holds them along x would share the drive
    sliding, drives = s.sliding(joint), mobility > DEPENDENT * alone
    reject_unless(
        s.scope,
        drives | sliding.equals(0.0) if isinstance(sliding, Expr) else drives,
        Variant.LEAST_SQUARES,
    )
    left = (faster / mobility).called("left")  # of the drive, by friction
    forces, of_one = pin_forces(s, motion, joint), pin_forces(s, per_newton, joint)
    held = [
        (y - left * by_y, z - left * by_z)
        for (y, z), (by_y, by_z) in zip(forces, of_one, strict=True)
    ]
    return _numbers_of_guide(s, joint, left, held, forces)


def _watch_held(s: State, motion: Motion, joint: str) -> list[Any]:
    """The same where all rows are solved for by least sum of squares: with one more, which holds
    the guide along x, and perhaps shares what drives it with others that do."""
    sliding = s.segment.sliding_kinds(joint)
    along = Row(joint, 0, sliding if len(sliding) < len(s.segment.joint_kinds[joint]) else ())
    rows = Rows(s, [*s.segment.rows, along])
    acceleration, spin_rate = without_joints(s, motion.force, motion.moment)
    multipliers = LeastSquares(s, rows.coupling(), joint).solve(
        rows.without_joints(acceleration, spin_rate)
    )
    holding = replace(motion, multipliers=multipliers, system=rows)
    left = -s.case.separation_sign(joint) * multipliers[-1]
    return _numbers_of_guide(
        s, joint, left, pin_forces(s, holding, joint), pin_forces(s, motion, joint)
    )


def _numbers_of_guide(s: State, joint: str, left: Any, held: Ends, forces: Ends) -> list[Any]:
    friction = s.friction(joint)
    drive = left if friction is None else left - friction
    return [(drive, 0.0, 0.0), *((0.0, y, z) for y, z in (*held, *forces))]


def start_guides(c: Context) -> None:
    """Nothing is noted of guides at first."""
    for _, _, time, peaks in c.guide_fields:
        for place, value in ((time, 0.0), (time + 1, math.inf), *((peak, 0.0) for peak in peaks)):
            c.case.scope.store(component("GUIDES", place), value)
    if c.output_guides:
        c.workspace.add("GUIDES", sum(2 + 6 * c.pins(joint) for joint in c.output_guides))


def note_guides(text: Text, c: Context, segment: Segment) -> None:
    """Lines for one lane that follow the guides of a phase over the step just made, of length h."""
    for joint, first, time, peaks in c.guide_fields:
        sliding = segment.sliding_kinds(joint)
        if not sliding:
            continue
        inner = (
            text
            if len(sliding) == len(segment.joint_kinds[joint])
            else text.block(f"if {among(joint, sliding)}:")
        )
        nodes = [
            f"{component('WRENCHES', first + 3 * k)} + l, {c.node_size} * LANES"
            for k in range(1 + 2 * len(peaks))
        ]
        inner(f"w[{component('GUIDES', time)} + l] += h")
        for k, peak in enumerate(peaks, 1 + len(peaks)):
            inner(
                f"peaks.update_peak(w, {nodes[k]}, SCRATCH, {component('GUIDES', peak)} + l, "
                "w[BEGIN_T + l], h)"
            )
        inner(
            f"peaks.update_min_drive_ratio(w, {nodes[0]}, {len(peaks)}, SCRATCH, "
            f"{component('GUIDES', time + 1)} + l)"
        )


def guide_outcomes(s: State) -> list[Any]:
    """Of every guide that is watched: time for which its pins slid, greatest load of each, least
    friction that would jam them."""
    found: list[Any] = []
    for _, _, place, peaks in s.c.guide_fields:
        time, jams = (
            s.scope.load(component("GUIDES", place)),
            s.scope.load(component("GUIDES", place + 1)),
        )
        loads = [s.scope.load(component("GUIDES", peak)) for peak in peaks]
        found.append(time)
        found += [
            where(time > 0.0, scalar.larger(*loads[k : k + 2]), math.nan)
            for k in range(0, len(loads), 2)
        ]
        found.append(where(jams < math.inf, jams, math.nan))
    return found
