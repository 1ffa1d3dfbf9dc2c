"""Lines of a written kernel that write what is so over time: separations, or all there is to
know."""

import math
from typing import Any

from sepmc.kernel.emit.clearances import clearance_now, counts_in
from sepmc.kernel.emit.context import Context, component
from sepmc.kernel.emit.geometry import State
from sepmc.kernel.emit.guides import pin_forces
from sepmc.kernel.emit.motion import Motion
from sepmc.kernel.emit.outcomes import of_body
from sepmc.kernel.emit.steps import emit_broadcast, restore_stage
from sepmc.kernel.emit.wrenches import before_wrenches, force_of, make_wrenches, moment_of
from sepmc.kernel.spec.kernel_spec import Segment
from sepmc.kernel.spec.methods import Method
from sepmc.kernel.tracer.formulas import ZERO, quat, scalar, square_root, vec3
from sepmc.kernel.tracer.text import Text
from sepmc.kernel.tracer.tracer import Expr, where
from sepmc.routines import layout as at


def emit_history(out: Text, c: Context) -> None:
    """Functions for the rows of a history."""
    if c.history == at.SEPARATION_HISTORY:
        _emit_curves(out, c)
        return
    for segment in c.spec.segments:
        _everything(out, c, segment)
    _keep_everything(out, c)


def _emit_curves(out: Text, c: Context) -> None:
    """Functions for separations over time: the polynomial of a step through distance and speed at
    its ends and accelerations there and at stages within. They only look on: a flight is the same
    without them."""
    joints = list(c.spec.scene.joint)
    points = 2 + max(len(rk.within) for rk in c.used.values())
    for name, count in (
        ("BEGIN", c.size),
        ("BEGIN_T", 1),
        ("LENGTH", 1),
        ("POINT", at.AT_POINT * len(joints)),
        ("POINTS", points * at.AT_POINT * len(joints)),
        ("CURVES", (points + 4) * len(joints)),
    ):
        c.workspace.add(name, count)
    for segment in c.spec.segments:
        _separation(out, c, segment)
    for rk in c.used.values():
        _emit_fit_curves(out, c, rk)
    says = "Separations of the step just made, every so many seconds, into rows of the history."
    text = out.function("write_history(w, phase: int, first: int, a: Arrays)", says)
    text(
        f"curves.write(w, CURVES, {len(joints)}, {points + 4}, BEGIN_T, T, LENGTH, "
        "vector(a, 5)[0], block(a, 8), first)"
    )


def _separation(out: Text, c: Context, segment: Segment) -> None:
    """A function for the separations at a state of a phase."""
    says = (
        f"Distance, speed and acceleration of every joint at the state S of phase {segment.name}, "
        "which has the derivative D, into POINT."
    )
    text = out.function(f"separation_{segment.name}(w)", says)
    s = State(c, c.scope(), segment, "S")
    for j, joint in enumerate(c.spec.scene.joint):
        line, bodies = s.separation(joint), c.spec.scene.joint[joint].bodies
        acceleration = s.case.separation_sign(joint) * s.lengthening_by("D", bodies, line)
        for k, value in enumerate((line.length, line.rate, acceleration)):
            s.scope.store(component("POINT", at.AT_POINT * j + k), value)
    s.scope.write(text)


def fit_curves(rk: Method) -> str:
    """The name of the function that follows separations over a step by a method."""
    return f"fit_curves_{rk.name}"


def _emit_fit_curves(out: Text, c: Context, rk: Method) -> None:
    """A function for the curves of a step that was just made by a method, whose stages are still
    there."""
    text = out.function(
        f"{fit_curves(rk)}(w, phase: int)",
        f"Curves of the separations over the step from BEGIN just made by {rk.name}, into CURVES.",
    )
    text.lanes()("w[LENGTH + l] = w[STEP + l]")
    stages = (0, *rk.within)
    for number, i in enumerate(stages):
        restore_stage(text, rk, i)
        text.block("for e in range(SIZE_Y):")(f"w[D + e] = w[K{i + 1} + e]")
        _note_point(text, c, number)
    text.block("for e in range(SIZE_Y):")("w[S + e] = w[Y + e]")
    text.lanes()("w[CLOCK + l] = w[T + l]")
    text("rates(w, phase)")
    _note_point(text, c, len(stages))
    joints, points = len(c.spec.scene.joint), 1 + len(stages)
    stride = c.workspace.counts["CURVES"] // joints
    text(
        f"curves.fit(w, POINTS, {joints}, {points}, CURVE_{rk.name.upper()}, LENGTH, CURVES, "
        f"{stride})"
    )


def _note_point(text: Text, c: Context, number: int) -> None:
    """What is so at the state S of a point of a step."""
    for k, segment in enumerate(c.spec.segments):
        text.block(f"{'elif' if k else 'if'} phase == {k}:")(f"separation_{segment.name}(w)")
    size = c.workspace.counts["POINT"]
    text.block(f"for e in range({size} * LANES):")(
        f"w[POINTS + {number * size} * LANES + e] = w[POINT + e]"
    )


def _span(text: Text) -> None:
    """From when to when the steps of all lanes go."""
    text("low, high = math.inf, 0.0")
    text.lanes()(
        "low = min(low, w[BEGIN_T + l])",
        "high = max(high, w[BEGIN_T + l] + w[REACH + l] * w[LENGTH + l])",
    )


def _everything(out: Text, c: Context, segment: Segment) -> None:
    """A function for a row of a full history, in the order of `sepmc.schema.history_columns`."""
    says = (
        f"All there is to know of the state S of phase {segment.name} at the times CLOCK, into ROW."
    )
    text = out.function(f"row_{segment.name}(w)", says)
    before_wrenches(text, c, segment)
    s = State(c, c.scope(), segment, "S")
    motion, joints = make_wrenches(s), c.spec.scene.joint
    row = [x for body in c.spec.bodies for x in of_body(s, body, _angles)]
    row += [x for line in map(s.separation, joints) for x in (line.rate, line.length)]
    origin = (0.0, s.scope.load("ORIGIN_HEIGHT"), 0.0)
    for body in c.spec.bodies:
        row.extend(vec3.add(s.place(body), vec3.add(origin, vec3.scale(s.time, s.case.velocity))))
        row.extend(vec3.add(s.speed(body), s.case.velocity))
        row.append(vec3.unrotate(s.attitude(body), motion.acceleration[body])[0])
    for joint, held in joints.items():
        force, moment, gap = force_of(motion, joint), moment_of(s, motion, joint), s.joint(joint).d
        levered = moment if force is ZERO else vec3.add(moment, vec3.cross(gap, force))
        for sign, vector in (
            (-1.0, force),
            (-1.0, levered),
            (1.0, force),
            (1.0, moment),
            (1.0, gap),
        ):
            row.extend(
                ZERO
                if vector is ZERO
                else vec3.unrotate(s.attitude(held.bodies[0]), vec3.scale(sign, vector))
            )
    row += [load for joint in c.guide_joints for load in _pin_loads(s, motion, joint)]
    clearances = c.spec.scene.clearance
    c.workspace.add("ROW", len(row) + len(clearances))
    for k, value in enumerate(row):
        s.scope.store(component("ROW", k), value)
    s.scope.write(text)
    for i in range(len(clearances)):
        clearance_now(text, s, i, counts_in(c, segment, i), component("ROW", len(row) + i))


def _pin_loads(s: State, motion: Motion, joint: str) -> list[Any]:
    """Lateral load of every pin of a joint at the mouth and at the tip, while they may slide."""
    if not s.segment.sliding_kinds(joint):
        return [math.nan] * 2 * s.c.pins(joint)
    sliding = s.sliding(joint)
    loads = [square_root(y * y + z * z).called("load") for y, z in pin_forces(s, motion, joint)]
    return (
        [where(sliding > 0.0, x, math.nan) for x in loads] if isinstance(sliding, Expr) else loads
    )


def _angles(s: State, leader: str) -> tuple[Any, Any]:
    """Pitch and roll of a group within a step, the nearest turn to those at its end."""
    attitude = s.attitude(leader)
    pitch, roll = (component(f"ANGLES_{leader}", k) for k in range(2))
    return scalar.nearest_turn(quat.pitch(attitude), s.scope.load(pitch)), scalar.nearest_turn(
        quat.roll(attitude), s.scope.load(roll)
    )


def _keep_everything(out: Text, c: Context) -> None:
    """A function that writes the rows of a full history whose segment and instant are those of the
    step just made, all lanes alike."""
    says = (
        "Rows at those of the instants (time, segment, side) that fall within the step just "
        "made, or at its end (-1) or beginning (1)."
    )
    text = out.function("write_history(w, phase: int, first: int, a: Arrays)", says)
    text("instants, history = table(a, 5), block(a, 8)")
    _span(text)
    text = text.block("for row in range(instants.shape[0]):")
    text.block("if not low - 1e-12 <= instants[row, 0] <= high + 1e-12:")("continue")
    text("there = 0.0")
    inner = text.lanes()
    inner("t, last = instants[row, 0], w[BEGIN_T + l] + w[REACH + l] * w[LENGTH + l]")
    inner(f"within = w[BEGIN_T + l] - 1e-12 <= t <= last + 1e-12 and w[LENGTH + l] > {at.GRAIN}")
    inner("within = within and instants[row, 1] == phase and w[REJECTED + l] == 0.0")
    inner("within = within and (instants[row, 2] <= 0.0 or t < last - 1e-12)")
    inner("within = within and (instants[row, 2] >= 0.0 or t > w[BEGIN_T + l] + 1e-12)")
    inner("w[WITHIN + l] = 1.0 if within else 0.0", "there += w[WITHIN + l]")
    inner("w[THETA + l] = (t - w[BEGIN_T + l]) / w[LENGTH + l] if within else 0.0")
    c.workspace.add("WITHIN", 1)
    text = text.block("if there > 0.0:")
    emit_broadcast(text, c, "THETA")
    text("interpolate(w, phase)")
    for number, segment in enumerate(c.spec.segments):
        text.block(f"{'elif' if number else 'if'} phase == {number}:")(f"row_{segment.name}(w)")
    inner = text.block("for l in range(min(LANES, history.shape[0] - first)):").block(
        "if w[WITHIN + l] > 0.0:"
    )
    inner.block("for k in range(history.shape[2]):")(
        "history[first + l, row, k] = w[ROW + k * LANES + l]"
    )
