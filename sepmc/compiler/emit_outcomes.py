"""Lines of a specialised kernel for the outcomes of a flight: from the final state into slabs, from slabs into the columns of results."""

from sepmc.compiler.emit_context import Context, raw
from sepmc.compiler.emit_geometry import ZERO, emit_separation, emit_state
from sepmc.compiler.text import Text
from sepmc.kernels import layout as at
from sepmc.scene.model import GROUND


def emit_report(out: Text, c: Context) -> None:
    """A function for the outcomes of all lanes."""
    shape, stage = c.shape, c.shape.stages[-1]
    text = out.function("report(w)", "Outcomes of the final state, in the order of the columns, into OUT.").lanes()
    c.slabs.add("OUT", len(shape.bodies) * at.BODY_OUTCOMES + len(shape.scene.joint) * at.JOINT_OUTCOMES)
    c.slabs.add("PATH_REFERENCE", 1), c.slabs.add("STREAM", 3)
    c.parameters(f"w[PATH_REFERENCE + l] = {raw(at.PATH_REFERENCE)}")
    g = emit_state(text, c, stage, "Y")
    o = 0
    for body in shape.bodies:
        leader = stage.leader(body)
        spin = ZERO if leader == GROUND else f"omega_{leader}"
        text(f"alpha, beta = flow_angles(vec3.unrotate({g.attitude(body)}, vec3.add(v_{body}, get3(w, STREAM + l))))")
        text(f"pitch, yaw, roll = w[ANGLES_{leader} + l], quat.yaw({g.attitude(body)}), w[ANGLES_{leader} + LANES + l]")
        text(f"put3(w, OUT + {o} * LANES + l, (alpha, beta, pitch - w[PATH_REFERENCE + l]))")
        text(f"put3(w, OUT + {o + 3} * LANES + l, {spin})", f"put3(w, OUT + {o + 6} * LANES + l, (roll, yaw, pitch))")
        o += at.BODY_OUTCOMES
    for joint in shape.scene.joint:
        emit_separation(text, g, joint)
        c.slabs.add(f"RELEASE_{joint}", 1)
        c.parameters(f"w[RELEASE_{joint} + l] = math.nan")
        text(f"put3(w, OUT + {o} * LANES + l, (rate, distance, w[RELEASE_{joint} + l]))")
        o += at.JOINT_OUTCOMES
    if any(GROUND in group for group in stage.groups):
        c.slabs.add(f"ANGLES_{GROUND}", 2)
        c.parameters(f"w[ANGLES_{GROUND} + l], w[ANGLES_{GROUND} + LANES + l] = {raw(at.PITCH)}, {raw(at.ROLL)}")


def emit_results(text: Text, c: Context) -> None:
    """Lines that copy outcomes, rates at release, audit columns and ends of phases into the arrays of a block, and say which cases hold."""
    shape, bodies = c.shape, len(c.shape.bodies) * at.BODY_OUTCOMES
    text("# outcomes", "report(w)")
    text = text.block("for l in range(min(LANES, draws.shape[1] - first)):")
    text("i = first + l", "sound = w[LOST + l] == 0.0 and w[DRIFT + l] <= 1e-6 and w[T + l] >= w[RUN_END + l]")
    o = bodies + len(shape.scene.joint) * at.JOINT_OUTCOMES
    inner = text.block(f"for k in range({o}):")
    inner("outcomes[k, i] = w[OUT + k * LANES + l]", f"sound = sound and (k >= {bodies} or math.isfinite(outcomes[k, i]))")
    for joint in shape.scene.output.tip_off:
        for body in shape.scene.joint[joint].bodies:
            if body != GROUND:
                if c.slabs.has(f"TIP_OFF_{joint}_{body}"):
                    text(f"outcomes[{o}, i], outcomes[{o + 1}, i], outcomes[{o + 2}, i] = get3(w, TIP_OFF_{joint}_{body} + l)")
                o += 3
    text.block("for k in range(4):")(f"outcomes[{o} + k, i] = w[RESIDUAL + k * LANES + l]")
    for k, name in enumerate(("DRIFT", "EVENT_ERROR", "TURNED_FAR", "STEPS")):
        text(f"outcomes[{o + 4 + k}, i] = w[{name} + l]")
    text.block("for k in range(GUARDS):")(f"outcomes[{o + 8} + k, i] = w[GUARD + k * LANES + l] if w[UNEVEN + l] == 0.0 else math.nan")
    for number, stage in enumerate(shape.stages):
        text(f"ends[{number}, i] = w[ENDED_{stage.name} + l]")
    text("status[i] = 0 if sound else -1")
