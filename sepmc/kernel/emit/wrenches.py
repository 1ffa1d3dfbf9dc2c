"""Joint loads (wrenches): force and moment on the second body of a joint, at the second body's copy
of the joint point."""

from dataclasses import replace
from typing import Any

from sepmc.kernel.emit.context import Context, component
from sepmc.kernel.emit.geometry import State
from sepmc.kernel.emit.loads import body_loads, vector_sum
from sepmc.kernel.emit.motion import Motion, angular_acceleration, before_motion, make_motion
from sepmc.kernel.emit.rows import Rows
from sepmc.kernel.spec.kernel_spec import Segment
from sepmc.kernel.tracer.formulas import ZERO, vec3
from sepmc.kernel.tracer.text import Text
from sepmc.scene.model import GROUND


def emit_min_norm(out: Text, c: Context, segment: Segment) -> None:
    """Write the kernel function ``min_norm_SEGMENT(w)``, which stores the minimum-norm multipliers
    of all constraint rows of a segment, which give its joint loads, into MIN_NORM_MULTIPLIERS.
    Nothing is written unless the segment has redundant rows (`Segment.needs_min_norm`)."""
    if not segment.needs_min_norm:
        return
    docstring = (
        f"Joint loads of phase {segment.name} at the state S and the times CLOCK: the "
        "multipliers of minimum"
    )
    text = out.function(
        f"min_norm_{segment.name}(w)", docstring + " norm, into MIN_NORM_MULTIPLIERS."
    )
    s = State(c, c.scope(), segment, "S")
    force, moment = body_loads(s)
    rows, count = Rows(s, segment.all_rows, per_body=True), len(segment.all_rows)
    acceleration = {
        body: vec3.scale(s.case.inverse_mass(body), force[body]).called("a")
        for body in c.spec.bodies
    }
    spin_rate = {
        body: angular_acceleration(s, (body,), moment).called("spin_rate") for body in c.spec.bodies
    }
    system = [x for row in rows.coupling() for x in row] + rows.without_joints(
        acceleration, spin_rate
    )
    (
        c.workspace.add("SYSTEM", len(system)),
        c.workspace.add("MIN_NORM_MULTIPLIERS", count),
        c.workspace.add("SYSTEM_SCRATCH", 3 * count**2 + 5 * count),
    )
    for k, value in enumerate(system):
        s.scope.store(component("SYSTEM", k), value)
    s.scope.write(text)
    sizes = f"SYSTEM + l, {count}, SYSTEM_SCRATCH, MIN_NORM_MULTIPLIERS + l"
    text.lanes()(f"linear.solve_min_norm(w, {sizes})")


def before_wrenches(text: Text, c: Context, segment: Segment) -> None:
    """Append lines that prepare what `make_wrenches` at the state S reads: look-ups, friction and,
    with redundant rows, the minimum-norm multipliers."""
    before_motion(text, c, segment)
    if segment.needs_min_norm:
        text(f"min_norm_{segment.name}(w)")


def make_wrenches(s: State) -> Motion:
    """Motion at a state, from whose ``multipliers`` (in the full formulation ``wrenches``, without
    multipliers) `force_of` and `moment_of` give the joint loads; lines that `before_wrenches`
    appends must run before.

    Parameters
    ----------
    s : State

    Returns
    -------
    Motion
        where `Segment.needs_min_norm`, ``multipliers`` are those of minimum norm of all rows
        (``min_norm`` is True), accelerations those by the rows that are not redundant
    """
    motion = make_motion(s)
    if not s.segment.needs_min_norm:
        return motion
    rows = Rows(s, s.segment.all_rows, per_body=True)
    return replace(
        motion,
        multipliers=[
            s.scope.load(component("MIN_NORM_MULTIPLIERS", k)) for k in range(len(rows.rows))
        ],
        system=rows,
        min_norm=True,
    )


def store_wrenches(s: State, motion: Motion) -> None:
    """Add lines to the scope of a state that store force, N, and moment, N m, on the second body of
    every monitored joint (`Context.monitored_joints`), in body axes of its first body, into the
    field WRENCH. ``motion`` is from `make_wrenches`."""
    s.c.workspace.add("WRENCH", s.c.node_size, optional=True)
    for i, joint in enumerate(s.c.monitored_joints):
        first, own = s.spec.scene.joint[joint].bodies[0], _own_forces(motion)
        force = own[joint] if joint in own else _in_axes_of(s, first, force_of(motion, joint))
        s.scope.store(component("WRENCH", 6 * i), force)
        moment = (
            _moment_of_weld(s, motion, joint)
            if _is_weld(s, motion, joint)
            else _in_axes_of(s, first, moment_of(s, motion, joint))
        )
        s.scope.store(component("WRENCH", 6 * i + 3), moment)


def _in_axes_of(s: State, body: str, vector: Any) -> Any:
    """Vector in body axes of a body, given in ground axes; `ZERO` stays."""
    return ZERO if vector is ZERO else vec3.unrotate(s.attitude(body), vector)


def _own_forces(motion: Motion) -> dict[str, Any]:
    """Force on the second body of each joint with rows in the axes of a rigid group, in these axes,
    N, by joint (`Rows.own_forces`)."""
    return (
        motion.system.own_forces(motion.multipliers) if motion.system and motion.multipliers else {}
    )


def _is_weld(s: State, motion: Motion, joint: str) -> bool:
    """True if the moment of a joint follows from the balance of bodies of its rigid group."""
    return joint in s.segment.welds and not (motion.min_norm or motion.wrenches)


def force_of(motion: Motion, joint: str) -> Any:
    """Force on the second body of a joint, ground axes, N; `ZERO` if the joint carries none. With a
    motion from `make_drive`, its change per newton of the driving force."""
    if motion.wrenches:
        return motion.wrenches[joint][0] if joint in motion.wrenches else ZERO
    rows = zip(motion.multipliers, motion.rows, strict=True)
    return vector_sum(
        [vec3.scale(m, one.e) for m, one in rows if one.row.joint == joint and not one.row.turns]
    )


def moment_of(s: State, motion: Motion, joint: str) -> Any:
    """Moment on the second body of a joint at its joint point, ground axes, N m: from the rotation
    rows of the joint or, within a rigid group, from the balance of the group's bodies; `ZERO` if
    the joint carries none. With a motion from `make_drive`, its change per newton of the driving
    force."""
    if motion.wrenches:
        return motion.wrenches[joint][1] if joint in motion.wrenches else ZERO
    if _is_weld(s, motion, joint):
        moment = _moment_of_weld(s, motion, joint)
        r = s.attitude(s.spec.scene.joint[joint].bodies[0])
        return ZERO if moment is ZERO else vec3.rotate(r, moment)
    rows = zip(motion.multipliers, motion.rows, strict=True)
    return vector_sum(
        [vec3.scale(m, one.arms[1]) for m, one in rows if one.row.joint == joint and one.row.turns]
    )


def _moment_of_weld(s: State, motion: Motion, joint: str) -> Any:
    """Moment on the second body of a joint within a rigid group (bodies that rotate together, but
    may slide), whose rotation rows are left out, body axes, N m: from Euler's equations of the
    bodies on one side of the joint."""
    joints = s.spec.scene.joint
    first, second = joints[joint].bodies
    side = _side(s, joint, second)
    if GROUND in side:  # other loads on the ground are unknown
        # the arms of the rows include the couple of a force that misses the first body's point
        return vec3.scale(-1.0, _required_moment(s, motion, _side(s, joint, first)))
    return _required_moment(s, motion, side)


def _side(s: State, joint: str, body: str) -> set[str]:
    """Bodies that the joints without relative rotation still connect to ``body``, itself included,
    if the joint ``joint`` is cut: one side of that joint in its rigid group."""
    bodies, pairs = (
        {body},
        [set(s.spec.scene.joint[weld].bodies) for weld in s.segment.welds if weld != joint],
    )
    while connected := [pair for pair in pairs if bodies & pair and not pair <= bodies]:
        bodies |= connected[0]
    return bodies


def _required_moment(s: State, motion: Motion, side: set[str]) -> Any:
    """Moment, body axes, N m, that must act on the bodies ``side`` of a rigid group besides their
    loads and constraint rows: the sum over the bodies of the moment that the angular acceleration
    needs (about the body's mass centre) minus the moments of loads and rows; `ZERO` if it is known
    to be zero."""
    case, own, terms, arms = s.case, _own_forces(motion), [], []
    for body in sorted(side):
        leader = s.segment.leader(body)
        if leader == GROUND:
            inertial: Any = ZERO
        else:
            omega, inertia = s.rate(leader), case.inertia(body)
            gyroscopic = vec3.cross(omega, vec3.rotate(inertia, omega)) if motion.moving else ZERO
            inertial = vector_sum([vec3.rotate(inertia, motion.spin_rate[leader]), gyroscopic])
        moment = motion.moment[body]
        if inertial is not ZERO or moment is not ZERO:
            terms.append(inertial if moment is ZERO else vec3.sub(inertial, moment))
        for m, one in zip(motion.multipliers, motion.rows, strict=True):
            pair = s.spec.scene.joint[one.row.joint].bodies
            if one.own and body == pair[0]:  # the moment on both bodies; less that on the second
                terms.append(vec3.scale(-m, one.own.lever))
            elif not one.own:
                arms += [
                    vec3.scale(-m, arm)
                    for end, arm in zip(pair, one.arms, strict=True)
                    if end == body
                ]
        for joint, force in own.items():
            pair = s.spec.scene.joint[joint].bodies
            if body in pair:
                on_second = vec3.cross(case.joint_ends(joint)[1], force)
                terms.append(on_second if body == pair[0] else vec3.scale(-1.0, on_second))
    if arms:
        terms.append(_in_axes_of(s, min(side), vector_sum(arms)))
    return vector_sum(terms)
