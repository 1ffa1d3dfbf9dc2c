"""What joints carry: force and moment on the second body of a joint, at its own copy of the joint point."""

from typing import Any

from sepmc.compiler.context import Context, part
from sepmc.compiler.formulas import ZERO, vec3
from sepmc.compiler.geometry import State
from sepmc.compiler.loads import add_all
from sepmc.compiler.motion import Motion, make_motion
from sepmc.compiler.shape import Stage
from sepmc.compiler.tables import call_look_up
from sepmc.compiler.text import Text
from sepmc.scene.model import GROUND


def emit_wrenches(out: Text, c: Context, stage: Stage) -> None:
    """A function for the loads of the joints that are followed, in a phase in which one of them holds."""
    says = "Force and moment of every joint that is followed at the state S and the times CLOCK, in axes of its first body, into WRENCH."
    text = out.function(f"wrenches_{stage.name}(w)", says)
    c.slabs.add("WRENCH", 6 * len(c.followed))
    call_look_up(text, c, stage)
    s = State(c, c.scope(), stage, "S")
    motion = make_motion(s)
    for i, joint in enumerate(c.followed):
        r = s.attitude(c.shape.scene.joint[joint].bodies[0])
        for k, vector in enumerate((force_of(motion, joint), moment_of(s, motion, joint))):
            s.scope.store(part("WRENCH", 6 * i + 3 * k), ZERO if vector is ZERO else vec3.unrotate(r, vector))
    s.scope.write(text)


def force_of(motion: Motion, joint: str) -> Any:
    """Force on the second body of a joint, ground axes."""
    rows = zip(motion.multipliers, motion.rows, strict=True)
    return add_all([vec3.scale(m, one.e) for m, one in rows if one.row.joint == joint and not one.row.turns])


def moment_of(s: State, motion: Motion, joint: str) -> Any:
    """Moment on the second body of a joint, ground axes: what its rows of rotation do, or else what its bodies need to turn as one."""
    if joint in s.stage.welds:
        return _moment_of_weld(s, motion, joint)
    rows = zip(motion.multipliers, motion.rows, strict=True)
    return add_all([vec3.scale(m, one.arms[1]) for m, one in rows if one.row.joint == joint and one.row.turns])


def _moment_of_weld(s: State, motion: Motion, joint: str) -> Any:
    """Euler's equations of the bodies on one side of a joint that lets nothing turn: what other loads and joints leave to it."""
    joints = s.shape.scene.joint
    first, second = joints[joint].bodies
    side = _side(s, joint, second)
    if GROUND in side:  # nothing is known of what else the ground feels
        force, gap = force_of(motion, joint), s.joint(joint).d
        on_first = _left_to(s, motion, joint, _side(s, joint, first))
        return vec3.scale(-1.0, add_all([on_first, ZERO if force is ZERO else vec3.cross(gap, force)]))
    return _left_to(s, motion, joint, side)


def _side(s: State, joint: str, body: str) -> set[str]:
    """Bodies that turn as one with a body though a joint is cut."""
    found, pairs = {body}, [set(s.shape.scene.joint[weld].bodies) for weld in s.stage.welds if weld != joint]
    while more := [pair for pair in pairs if found & pair and not pair <= found]:
        found |= more[0]
    return found


def _left_to(s: State, motion: Motion, joint: str, side: set[str]) -> Any:
    """Moment that bodies which turn as one need besides their loads and the other joints', ground axes."""
    case, terms = s.case, []
    for body in sorted(side):
        leader = s.stage.leader(body)
        if leader == GROUND:
            inertial: Any = ZERO
        else:
            omega, inertia = s.rate(leader), case.inertia(body)
            turning = vec3.cross(omega, vec3.rotate(inertia, omega))
            inertial = vec3.add(vec3.rotate(inertia, motion.spin_rate[leader]), turning)
        moment = motion.moment[body]
        if inertial is not ZERO or moment is not ZERO:
            left = inertial if moment is ZERO else vec3.sub(inertial, moment)
            terms.append(vec3.rotate(s.attitude(body), left))
        for m, one in zip(motion.multipliers, motion.rows, strict=True):
            pair = s.shape.scene.joint[one.row.joint].bodies
            terms += [vec3.scale(-m, arm) for end, arm in zip(pair, one.arms, strict=True) if end == body]
    return add_all(terms)
