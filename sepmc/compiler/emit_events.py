"""Lines of a specialised kernel that foretell when the conditions on a state will be met, and note that they are."""

from sepmc.compiler.emit_context import Context, raw
from sepmc.compiler.emit_geometry import Geometry, emit_separation, emit_spring_line, emit_state, relative_acceleration
from sepmc.compiler.shape import Event, Stage
from sepmc.compiler.text import Text
from sepmc.kernels import layout as at
from sepmc.scene.model import GROUND


def emit_aim(out: Text, c: Context, stage: Stage) -> None:
    """A function that finds the time to a phase's next event."""
    says = "Time to the next event, into STEP, foretold from values, rates and accelerations (in K1) of the conditions and from how fast"
    text = out.function(f"aim_{stage.name}(w, usual: float)", says + " these change; at most to END.").lanes()
    g = emit_state(text, c, stage, "Y")
    for body in c.shape.bodies:
        text(f"a_{body} = get3(w, K1 + V_{body} + l)")
    for leader in stage.leaders:
        text(f"spin_rate_{leader} = get3(w, K1 + OMEGA_{leader} + l)")
    text("t = w[T + l]", "ahead = w[END + l] - t")
    for event in stage.events:
        name = f"{stage.name}_{event.which}"
        c.slabs.add(f"VALUE_{name}", 1), c.slabs.add(f"RATE_{name}", 1), c.slabs.add(f"LAST_{name}", 2), c.slabs.add(f"AT_ONCE_{name}", 1)
        _event(text, g, event)
        text(f"earlier, before = w[LAST_{name} + l], w[LAST_{name} + LANES + l]")
        text("jerk = (acceleration - before) / (t - earlier) if t > earlier else 0.0")
        if not event.ends_phase:  # it may be met and left again within a step: then the tangents at its ends cross beyond
            text(f"past, slope, h = w[VALUE_{name} + l], w[RATE_{name} + l], t - earlier")
            text("turns = earlier != math.inf and slope > 0.0 and rate < 0.0 and past < 0.0")
            text("top = past + slope * (value - past - rate * h) / (slope - rate if turns else 1.0)")
            text(f"w[UNEVEN + l] = 1.0 if turns and top >= 0.0 and w[SPENT_{event.which} + l] == 0.0 else w[UNEVEN + l]")
        text(f"w[RATE_{name} + l] = rate")
        text(f"w[VALUE_{name} + l], w[LAST_{name} + l], w[LAST_{name} + LANES + l] = value, t, acceleration")
        text(f"at_once = (1.0 if value >= -1e-12 else 0.0) if earlier == math.inf else w[AT_ONCE_{name} + l]")
        text(f"w[AT_ONCE_{name} + l] = at_once", "wait = time_left(value, rate, acceleration, jerk)")
        text("wait = 0.0 if at_once > 0.0 else wait  # met before it was waited for")
        if event.ends_phase and stage.after_late is not None:  # met in the meantime, or it recedes and may have been
            text(f"early = earlier == math.inf and (value >= -1e-12 or value - 2.0 * rate * {raw(stage.after_late)} >= 0.0)")
            text("w[LOST + l] = 1.0 if early and w[DONE + l] == 0.0 else w[LOST + l]")
        if event.ends_phase:
            text("wait = usual if earlier == math.inf and wait > usual else wait")
        else:
            text(f"wait = math.inf if w[SPENT_{event.which} + l] > 0.0 else wait")
        text("ahead = wait if wait < ahead else ahead")
    text("w[STEP + l] = ahead")


def _event(text: Text, g: Geometry, event: Event) -> None:
    """Local names value (below zero before the event), rate and acceleration of a condition."""
    scene = g.shape.scene
    threshold = f"THRESHOLD_{event.which}_{event.threshold}"
    if g.slabs.add(threshold, 1):
        g.parameters(f"w[{threshold} + l] = {raw(event.threshold)}")
    if event.what == at.AT_SPRING_STROKE:
        spring = next(s for s in scene.spring if s.name == event.which)
        bodies = spring.bodies
        emit_spring_line(text, g, spring)
        text(f"value = length - w[START_{event.which} + l] - w[{threshold} + l]")
    elif event.what == at.AT_DISTANCE:
        bodies = scene.joint[event.which].bodies
        g.joint(text, event.which)
        text("e, arm_a, arm_b, gamma = joints.rod(d, d_rate, rho_a, rho_b, spin_a, spin_b)")
        text("away = math.sqrt(vec3.dot(d, d))  # 0 where the points are one: a direction there is not yet")
        text(f"value, rate = away - w[{threshold} + l], vec3.dot(d_rate, e) if away > 0.0 else 0.0")
    else:
        bodies = scene.joint[event.which].bodies
        emit_separation(text, g, event.which)
        text("arm_a, arm_b, gamma = joints.translation(d, d_rate, e, rho_a, rho_b, spin_a, spin_b)")
        text(f"value = distance - w[{threshold} + l]")
    text(f"acceleration = vec3.dot(e, {relative_acceleration(bodies)}) - gamma")
    for body, arm in zip(bodies, ("arm_a", "arm_b"), strict=True):
        leader = g.stage.leader(body)
        if leader != GROUND:
            text(f"acceleration += vec3.dot(vec3.unrotate(r_{leader}, {arm}), spin_rate_{leader})")
    if event.what == at.AT_DISTANCE:
        text("acceleration = acceleration if away > 0.0 else 0.0")
    if event.what == at.AT_STROKE:  # the separation distance counts positive apart
        text("acceleration = apart * acceleration")


def emit_met(text: Text, c: Context) -> None:
    """After the last step to an event: which conditions of the phase are met."""
    for number, stage in enumerate(c.shape.stages):
        if not stage.events:
            continue
        inner = text.block(f"if phase == {number}:")
        inner(f"aim_{stage.name}(w, math.inf)")
        inner = inner.lanes()
        for event in stage.events:
            name = f"{stage.name}_{event.which}"
            inner(f"met, rate = w[VALUE_{name} + l] >= -1e-12, w[RATE_{name} + l]")
            flag = "DONE" if event.ends_phase else f"SPENT_{event.which}"
            if not event.ends_phase and c.slabs.add(flag, 1):
                c.parameters(f"w[{flag} + l] = 0.0")
            inner(f"waited_for = met and w[{flag} + l] == 0.0 and w[AT_ONCE_{name} + l] == 0.0")
            inner("slow = (1.0 / rate if rate > 0.0 else math.inf) if waited_for else 0.0")
            inner(f"{c.guard(name)} = larger({c.guard(name)}, slow)")
            inner(f"w[{flag} + l] = 1.0 if met else w[{flag} + l]")
