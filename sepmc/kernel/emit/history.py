"""Emitter of histories: separations at equal time intervals, or full rows with all quantities at
requested instants."""

import math
from typing import Any

from sepmc.kernel.emit.clearances import emit_clearance_at, is_active
from sepmc.kernel.emit.context import Context, component
from sepmc.kernel.emit.geometry import State
from sepmc.kernel.emit.guides import pin_forces
from sepmc.kernel.emit.motion import Motion
from sepmc.kernel.emit.outcomes import body_outcomes
from sepmc.kernel.emit.relative import relative_values
from sepmc.kernel.emit.signals import signals_of
from sepmc.kernel.emit.steps import restore_stage
from sepmc.kernel.emit.wrenches import before_wrenches, force_of, make_wrenches, moment_of
from sepmc.kernel.spec.kernel_spec import Segment
from sepmc.kernel.spec.methods import Method
from sepmc.kernel.tracer.formulas import ZERO, quat, scalar, square_root, vec3
from sepmc.kernel.tracer.text import Text
from sepmc.kernel.tracer.tracer import Expr, where
from sepmc.routines import layout as at


def emit_history(out: Text, c: Context) -> None:
    """Write the kernel function ``write_history(w, phase, first, a)``, which writes the history
    rows of the step just made into the output array, and the functions it calls. ``phase`` is the
    number of the segment, ``first`` that of the case in the first lane, ``a`` has the input and
    result arrays of the kernel. Rows are separations at equal time intervals, or full rows at
    requested instants (`Context.history`). Not to be called for a kernel without history."""
    if c.history == at.SEPARATION_HISTORY:
        _emit_curves(out, c)
        return
    for segment in c.spec.segments:
        _emit_row(out, c, segment)
    _emit_full_history(out, c)


def _emit_curves(out: Text, c: Context) -> None:
    """Write the kernel functions for a history of separations: ``write_history`` and those it
    needs.

    A polynomial through distance and speed at the ends of a step, and through accelerations there
    and at stages within it, is evaluated at the history times. The history does not change the
    integration.
    """
    joints = list(c.spec.scene.joint)
    points = 2 + max(len(rk.within) for rk in c.used.values())
    for name, count in (
        ("BEGIN", c.size),
        ("BEGIN_T", 1),
        ("LENGTH", 1),
        ("POINT", at.AT_POINT * len(joints)),
        ("POINTS", points * at.AT_POINT * len(joints)),
        ("CURVES", (points + 4) * len(joints)),
        ("VALUES", 2),
    ):
        c.workspace.add(name, count)
    for segment in c.spec.segments:
        _emit_separation(out, c, segment)
    for rk in c.used.values():
        _emit_fit_curves(out, c, rk)
    docstring = (
        "Write the separations of the step just made at equal time intervals into the history."
    )
    text = out.function("write_history(w, phase: int, first: int, a: Arrays)", docstring)
    text(
        f"curves.write(w, CURVES, {len(joints)}, {points + 4}, BEGIN_T, T, LENGTH, "
        "VALUES, vector(a, 5)[0], block(a, 8), first)"
    )


def _emit_separation(out: Text, c: Context, segment: Segment) -> None:
    """Write the kernel function ``separation_SEGMENT(w)``, which stores separation distance, speed
    and acceleration of every joint at the state S (with its derivative D) into the field POINT."""
    docstring = (
        f"Distance, speed and acceleration of every joint at the state S of phase {segment.name}, "
        "which has the derivative D, into POINT."
    )
    text = out.function(f"separation_{segment.name}(w)", docstring)
    s = State(c, c.scope(), segment, "S")
    for j, joint in enumerate(c.spec.scene.joint):
        line, bodies = s.separation(joint), c.spec.scene.joint[joint].bodies
        acceleration = s.case.separation_sign(joint) * s.lengthening_by("D", bodies, line)
        for k, value in enumerate((line.length, line.rate, acceleration)):
            s.scope.store(component("POINT", at.AT_POINT * j + k), value)
    s.scope.write(text)


def fit_curves(rk: Method) -> str:
    """Name of the kernel function that fits polynomials to the separations over a step by the
    method ``rk``; `_emit_fit_curves` writes that function."""
    return f"fit_curves_{rk.name}"


def _emit_fit_curves(out: Text, c: Context, rk: Method) -> None:
    """Write the kernel function ``fit_curves_METHOD(w, phase, size)``, which stores the polynomials
    of the separations over the step just made by the method ``rk`` in segment number ``phase`` into
    the field CURVES; it uses the derivatives at the stages of that step, which are still stored.
    ``size`` is the number of state components of the segment, times LANES."""
    text = out.function(
        f"{fit_curves(rk)}(w, phase: int, size: int)",
        f"Curves of the separations over the step from BEGIN just made by {rk.name}, into CURVES.",
    )
    text.lanes()("w[LENGTH + l] = w[STEP + l]")
    stages = (0, *rk.within)
    for number, i in enumerate(stages):
        restore_stage(text, rk, i, "size")
        text.components("size")(f"w[D + e + l] = w[K{i + 1} + e + l]")
        _store_point(text, c, number)
    text.components("size")("w[S + e + l] = w[Y + e + l]")
    text.lanes()("w[CLOCK + l] = w[T + l]")
    text("rates(w, phase)")
    _store_point(text, c, len(stages))
    joints, points = len(c.spec.scene.joint), 1 + len(stages)
    stride = c.workspace.counts["CURVES"] // joints
    text(
        f"curves.fit(w, POINTS, {joints}, {points}, CURVE_{rk.name.upper()}, LENGTH, CURVES, "
        f"{stride})"
    )


def _store_point(text: Text, c: Context, number: int) -> None:
    """Append lines that compute the separations at the state S and store them into the field POINTS
    as those of point ``number`` (from 0) of the step."""
    for k, segment in enumerate(c.spec.segments):
        text.block(f"{'elif' if k else 'if'} phase == {k}:")(f"separation_{segment.name}(w)")
    size = c.workspace.counts["POINT"]
    text.components(f"{size} * LANES")(
        f"w[POINTS + {number * size} * LANES + e + l] = w[POINT + e + l]"
    )


def _emit_range(text: Text) -> None:
    """Append lines that set the variables ``low`` and ``high`` to the earliest start and latest
    end, s, over all lanes, of the step just made."""
    text("low, high = math.inf, 0.0")
    text.lanes()(
        "low = min(low, w[BEGIN_T + l])",
        "high = max(high, w[BEGIN_T + l] + w[REACH + l] * w[LENGTH + l])",
    )


def _emit_row(out: Text, c: Context, segment: Segment) -> None:
    """Write the kernel function ``row_SEGMENT(w)``, which stores the row of a full history at the
    state S into the field ROW, in the order of `sepmc.schema.history_columns`: SI, but signals as
    their formulas give them."""
    docstring = (
        f"Full history row of the state S of phase {segment.name} at the times CLOCK, into ROW."
    )
    text = out.function(f"row_{segment.name}(w)", docstring)
    before_wrenches(text, c, segment)
    s = State(c, c.scope(), segment, "S")
    motion, joints = make_wrenches(s), c.spec.scene.joint
    row = [x for body in c.spec.bodies for x in body_outcomes(s, body, _nearest_angles)]
    row += [x for line in map(s.separation, joints) for x in (line.rate, line.length)]
    origin = (0.0, s.scope.load("ORIGIN_HEIGHT"), 0.0)
    for body in c.spec.bodies:
        row.extend(
            vec3.add(s.position(body), vec3.add(origin, vec3.scale(s.time, s.case.velocity)))
        )
        row.extend(vec3.add(s.velocity(body), s.case.velocity))
        row.append(vec3.unrotate(s.attitude(body), motion.acceleration[body])[0])
    for joint, joint_model in joints.items():
        force, moment, gap = force_of(motion, joint), moment_of(s, motion, joint), s.joint(joint).d
        moment_on_first = moment if force is ZERO else vec3.add(moment, vec3.cross(gap, force))
        for sign, vector in (
            (-1.0, force),
            (-1.0, moment_on_first),
            (1.0, force),
            (1.0, moment),
            (1.0, gap),
        ):
            row.extend(
                ZERO
                if vector is ZERO
                else vec3.unrotate(s.attitude(joint_model.bodies[0]), vec3.scale(sign, vector))
            )
    row += [load for joint in c.guide_joints for load in _pin_loads(s, motion, joint)]
    row += [signals_of(s).value(signal.name) for signal in c.spec.scene.signal]
    row += relative_values(s)
    clearances = c.spec.scene.clearance
    c.workspace.add("ROW", len(row) + len(clearances))
    for k, value in enumerate(row):
        s.scope.store(component("ROW", k), value)
    s.scope.write(text)
    for i in range(len(clearances)):
        emit_clearance_at(text, s, i, is_active(c, segment, i), component("ROW", len(row) + i))


def _pin_loads(s: State, motion: Motion, joint: str) -> list[Any]:
    """Magnitudes of the lateral loads on the pins of a joint, N: for each pin that at its hole
    entry, then that at its tip; NaN while the pins cannot slide. ``motion`` is from
    `make_wrenches`."""
    if not s.segment.sliding_kinds(joint):
        return [math.nan] * 2 * s.c.pins(joint)
    sliding = s.sliding(joint)
    loads = [square_root(y * y + z * z).called("load") for y, z in pin_forces(s, motion, joint)]
    return (
        [where(sliding > 0.0, x, math.nan) for x in loads] if isinstance(sliding, Expr) else loads
    )


def _nearest_angles(s: State, leader: str) -> tuple[Any, Any]:
    """Pitch and roll of the rigid group of ``leader`` (not GROUND) at a state within a step, rad,
    with the full turns that bring them nearest to those at the end of the step."""
    attitude = s.attitude(leader)
    pitch, roll = (component(f"ANGLES_{leader}", k) for k in range(2))
    return scalar.nearest_turn(quat.pitch(attitude), s.scope.load(pitch)), scalar.nearest_turn(
        quat.roll(attitude), s.scope.load(roll)
    )


def _emit_full_history(out: Text, c: Context) -> None:
    """Write the kernel function ``write_history(w, phase, first, a)`` for a full history (arguments
    as in `emit_history`): it writes the rows at those requested instants (time, number of the
    segment, side) that are in the step just made. Side -1 is the state just before a change at that
    time (the end of a step, not the start of one), side 1 that just after it; 0: no change."""
    docstring = (
        "Write the rows of the instants (time, segment, side) within the step just made, or at "
        "its end (side -1) or start (side 1)."
    )
    text = out.function("write_history(w, phase: int, first: int, a: Arrays)", docstring)
    text("instants, history = table(a, 5), block(a, 8)")
    _emit_range(text)
    text = text.block("for row in range(instants.shape[0]):")
    text.block("if not low - 1e-12 <= instants[row, 0] <= high + 1e-12:")("continue")
    text("n_rows = 0.0")
    inner = text.lanes()
    inner("t, last = instants[row, 0], w[BEGIN_T + l] + w[REACH + l] * w[LENGTH + l]")
    inner(f"within = w[BEGIN_T + l] - 1e-12 <= t <= last + 1e-12 and w[LENGTH + l] > {at.GRAIN}")
    inner("within = within and instants[row, 1] == phase and w[REJECTED + l] == 0.0")
    inner("within = within and (instants[row, 2] <= 0.0 or t < last - 1e-12)")
    inner("within = within and (instants[row, 2] >= 0.0 or t > w[BEGIN_T + l] + 1e-12)")
    inner("w[WITHIN + l] = 1.0 if within else 0.0", "n_rows += w[WITHIN + l]")
    inner("w[THETA + l] = (t - w[BEGIN_T + l]) / w[LENGTH + l] if within else 0.0")
    c.workspace.add("WITHIN", 1)
    text = text.block("if n_rows > 0.0:")
    for number, segment in enumerate(c.spec.segments):
        text.block(f"{'elif' if number else 'if'} phase == {number}:")(
            f"interpolate_{segment.name}(w)", f"row_{segment.name}(w)"
        )
    inner = text.block("for l in range(min(LANES, history.shape[0] - first)):").block(
        "if w[WITHIN + l] > 0.0:"
    )
    inner.block("for k in range(history.shape[2]):")(
        "history[first + l, row, k] = w[ROW + k * LANES + l]"
    )
