"""Emitter of guide pins: their friction, in balance with the pin loads that it changes, and the pin
loads as outcomes."""

import math
from dataclasses import replace
from typing import Any

from sepmc.kernel.emit.context import Context, component, has_kind, reject_unless, rejection_unless
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

# lateral force (y, z) of each end of each pin: hole entry and tip of the first pin, then the next
Ends = list[tuple[Any, Any]]


def emit_friction(out: Text, c: Context, segment: Segment) -> None:
    """Write the kernel function ``friction_SEGMENT(w)``, which stores the friction force of each
    guide of a segment into the field FRICTION and ends cases that jam (status jammed); the other
    functions of the segment treat friction as a known load. Nothing is written without friction.

    Pin loads are linear in the friction forces: those without friction, and their change per newton
    of each friction force, are passed to `sepmc.routines.friction.balance`.
    """
    joints = c.spec.friction_joints(segment)
    if not joints:
        return
    docstring = (
        f"Friction of the guides of phase {segment.name} at the state S and the times CLOCK, "
        "into FRICTION; reject cases that jam."
    )
    text = out.function(f"friction_{segment.name}(w)", docstring)
    ends = [2 * c.pins(joint) for joint in joints]
    c.workspace.add("FRICTION", len(c.spec.scene.joint))
    c.workspace.add(f"PIN_FORCES_{segment.name}", sum(1 + n * (2 + 2 * len(joints)) for n in ends))
    s = State(c, c.scope(), segment, "S")
    motion, index = make_motion(s, with_friction=False), 0
    drives = [make_drive(s, motion, joint) for joint in joints]
    for joint in joints:
        s.scope.comment(f"pins of {joint}")
        values = [_friction_per_newton(s, joint)]
        for forces in zip(*(pin_forces(s, one, joint) for one in (motion, *drives)), strict=True):
            values += [x for force in forces for x in force]
        for value in values:
            s.scope.store(component(f"PIN_FORCES_{segment.name}", index), value)
            index += 1
    s.scope.write(text)
    inner = text.lanes().block(
        f"if not friction.balance(w, PIN_FORCES_{segment.name} + l, {tuple(ends)}, FRICTION + l):"
    )
    inner(rejection_unless("False", Status.JAMMED))


def _friction_per_newton(s: State, joint: str) -> Any:
    """Friction force on the second body in the direction of separation (negative while the bodies
    separate) per newton of the sum of all contact loads of the pins, at the present sliding speed;
    0 while the pins of the joint cannot slide."""
    p, speed = s.case.joint(joint), s.separation(joint).rate
    friction = guides.friction_force(
        s.case.number(p + at.FRICTION), 1.0, speed, s.case.number(p + at.SLIP_SPEED)
    )
    return friction * s.sliding(joint)


def pin_forces(s: State, motion: Motion, joint: str) -> Ends:
    """Lateral forces of all pins of a joint at their hole entries and tips.

    Parameters
    ----------
    s : State
    motion : Motion
        from `make_motion` or `make_wrenches`; or from `make_drive`: the result is then the change
        of the forces per newton of the driving force
    joint : str

    Returns
    -------
    list of (Expr, Expr)
        forces (y, z) on the second body, joint axes, N, two per pin: at the hole entry and tip of
        the first pin, at those of the second, ...
    """
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
    forces = []
    for pin in range(count):
        around = guides.around_circle(
            float(pin), float(count), c.number(p + at.CIRCLE), c.number(p + at.PIN_CLOCK)
        ).called("around")
        around = (around[0], around[1])
        forces += [
            tuple(guides.pin_force(tuple(end), moment[0], around, float(count)).called("pin"))
            for end in (mouth, tip)
        ]
    return forces


def guide_loads(s: State, motion: Motion, joint: str) -> list[Any]:
    """Monitored vectors of a guide at a state: the driving force along x that separates its bodies,
    the pin loads if friction balanced that force, and the present pin loads. A case in which other
    constraints along x share the driving force is left to the kernel variant LEAST_SQUARES.

    Parameters
    ----------
    s : State
    motion : Motion
        from `make_wrenches`
    joint : str

    Returns
    -------
    list of tuple of Expr
        (driving force, 0, 0), then (0, y, z) of every pin end as if balanced, then as they are; N
    """
    if s.segment.least_squares:
        return _guide_loads_min_norm(s, motion, joint)
    line, per_newton = s.separation(joint), make_drive(s, motion, joint)
    pair, sign = s.spec.scene.joint[joint].bodies, s.case.separation_sign(joint)
    acceleration = sign * s.lengthening(pair, line, motion.acceleration, motion.spin_rate)
    mobility = sign * s.lengthening(
        pair, line, per_newton.acceleration, per_newton.spin_rate, moving=False
    )
    inverse_masses = total([s.case.inverse_mass(body) for body in pair if body != GROUND])
    # other constraints along x would share the driving force
    sliding, is_free = s.sliding(joint), mobility > DEPENDENT * inverse_masses
    reject_unless(
        s.scope,
        is_free | sliding.equals(0.0) if isinstance(sliding, Expr) else is_free,
        Variant.LEAST_SQUARES,
    )
    balance = (acceleration / mobility).called("balance")  # driving force that friction leaves
    forces, forces_per_newton = pin_forces(s, motion, joint), pin_forces(s, per_newton, joint)
    balanced = [
        (y - balance * by_y, z - balance * by_z)
        for (y, z), (by_y, by_z) in zip(forces, forces_per_newton, strict=True)
    ]
    return _guide_components(s, joint, balance, balanced, forces)


def _guide_loads_min_norm(s: State, motion: Motion, joint: str) -> list[Any]:
    """`guide_loads` in a segment with minimum-norm multipliers: the driving force is the multiplier
    of an additional row that constrains the guide along x, and that may share the force with other
    constraints."""
    sliding = s.segment.sliding_kinds(joint)
    along = Row(joint, 0, sliding if len(sliding) < len(s.segment.joint_kinds[joint]) else ())
    rows = Rows(s, [*s.segment.rows, along])
    acceleration, spin_rate = without_joints(s, motion.force, motion.moment)
    multipliers = LeastSquares(s, rows.coupling(), joint).solve(
        rows.without_joints(acceleration, spin_rate)
    )
    constrained = replace(motion, multipliers=multipliers, system=rows)
    balance = -s.case.separation_sign(joint) * multipliers[-1]
    return _guide_components(
        s, joint, balance, pin_forces(s, constrained, joint), pin_forces(s, motion, joint)
    )


def _guide_components(
    s: State, joint: str, balance: Any, balanced: Ends, forces: Ends
) -> list[Any]:
    """Result of `guide_loads`: the vector (driving force, 0, 0), then (0, y, z) for each of the pin
    forces ``balanced`` (those if friction balanced the driving force), then for each of the present
    pin forces ``forces``; N. ``balance`` is the driving force plus the present friction force."""
    friction = s.friction(joint)
    driving_force = balance if friction is None else balance - friction
    return [(driving_force, 0.0, 0.0), *((0.0, y, z) for y, z in (*balanced, *forces))]


def reset_guides(c: Context) -> None:
    """Add the workspace field GUIDES (`Context.guide_fields`), and lines to the scope of the case
    that store there the values that the guide outcomes have at the start of a case."""
    for _, _, time, peaks in c.guide_fields:
        for index, value in ((time, 0.0), (time + 1, math.inf), *((peak, 0.0) for peak in peaks)):
            c.case.scope.store(component("GUIDES", index), value)
    if c.output_guides:
        c.workspace.add("GUIDES", sum(2 + 6 * c.pins(joint) for joint in c.output_guides))


def update_guides(text: Text, c: Context, segment: Segment) -> None:
    """Append lines, within a loop over lanes, that update the field GUIDES by the step just made in
    a segment, in lanes in which the pins may slide: the time for which they slide, the peak load of
    each end of a pin, and the minimum ratio of driving force to pin load. Peaks and minimum are
    those within the step, from the loads stored at its nodes (WRENCHES). The lines read the length
    of the step, s, from the variable ``h``."""
    for joint, first, time, peaks in c.guide_fields:
        sliding = segment.sliding_kinds(joint)
        if not sliding:
            continue
        inner = (
            text
            if len(sliding) == len(segment.joint_kinds[joint])
            else text.block(f"if {has_kind(joint, sliding)}:")
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
    """Outcomes of all output guides at the end of a case, from the field GUIDES.

    Parameters
    ----------
    s : State

    Returns
    -------
    list of Expr
        for each output guide: sliding time, s (0 if the guide never slid); maximum load of each
        pin, at its hole entry or its tip, N (NaN if the guide never slid);
        minimum friction coefficient that would have jammed it (NaN if there is none)
    """
    outcomes: list[Any] = []
    for _, _, index, peaks in s.c.guide_fields:
        time, jamming_friction = (
            s.scope.load(component("GUIDES", index)),
            s.scope.load(component("GUIDES", index + 1)),
        )
        loads = [s.scope.load(component("GUIDES", peak)) for peak in peaks]
        outcomes.append(time)
        outcomes += [
            where(time > 0.0, scalar.larger(*loads[k : k + 2]), math.nan)
            for k in range(0, len(loads), 2)
        ]
        outcomes.append(where(jamming_friction < math.inf, jamming_friction, math.nan))
    return outcomes
