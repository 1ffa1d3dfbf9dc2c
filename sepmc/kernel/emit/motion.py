"""Accelerations of the bodies by loads and joints in a segment, and the emitter of the projection
of the state onto the constraints."""

from dataclasses import dataclass, field
from typing import Any

from sepmc.kernel.emit.context import Context, component, reject_unless
from sepmc.kernel.emit.full import FullSystem, Wrench, before_full
from sepmc.kernel.emit.geometry import State
from sepmc.kernel.emit.loads import body_loads, vector_sum
from sepmc.kernel.emit.rows import (
    Factors,
    JointRow,
    Rows,
    Solver,
    check_pivots,
    is_finite,
    make_solver,
)
from sepmc.kernel.emit.tables import call_look_up
from sepmc.kernel.spec.kernel_spec import Segment
from sepmc.kernel.tracer.formulas import ZERO, quat, vec3
from sepmc.kernel.tracer.text import Text
from sepmc.kernel.tracer.tracer import called
from sepmc.scene.model import GROUND


def before_motion(text: Text, c: Context, segment: Segment) -> None:
    """Append lines that prepare what `make_motion` at the state S reads: values looked up in
    tables, friction of guides, and the matrix of the full system, set to zero."""
    call_look_up(text, c, segment)
    if c.spec.friction_joints(segment):
        text(f"friction_{segment.name}(w)")
    if segment.full:
        before_full(text, segment, c.spec.bodies)


@dataclass
class Motion:
    """Loads, accelerations and joint forces at a state, as expressions.

    ``force`` (ground axes, N) and ``moment`` (about the body's mass centre, body axes, N m) are the
    loads on each body without joint forces; ``acceleration`` is that of each mass centre (ground
    axes, m/s2), ``spin_rate`` the angular acceleration of each rigid group by its leader (body
    axes, rad/s2; by body in the full formulation). Joint forces are given either by
    ``multipliers`` of the constraint rows in ``system``, solved with ``factors``, or, from the full
    system, as ``wrenches`` on second bodies: ``multipliers`` are empty then.

    With ``min_norm`` the rows are those of bodies that rotate each by itself, and the multipliers
    those of minimum norm. If not ``moving``, all values are changes per newton of a force, without
    velocity terms.
    """

    force: dict[str, Any]
    moment: dict[str, Any]
    acceleration: dict[str, Any]
    spin_rate: dict[str, Any]
    multipliers: list[Any] = field(default_factory=list)
    system: Rows | None = None
    factors: Solver | None = None
    wrenches: dict[str, Wrench] = field(default_factory=dict)
    moving: bool = True
    min_norm: bool = False

    @property
    def rows(self) -> list[JointRow]:
        """Constraint rows of the joints, in the order of ``multipliers``; also with ``wrenches``,
        when there are no multipliers. Empty if the segment has no constraint rows."""
        return self.system.rows if self.system else []


def make_motion(s: State, with_friction: bool = True) -> Motion:
    """Loads, accelerations and joint forces at a state; lines that `before_motion` appends must run
    before.

    Parameters
    ----------
    s : State
    with_friction : bool
        True to include the friction of guides, which must be in the field FRICTION then; False
        also selects the reduced system in the full formulation

    Returns
    -------
    Motion
    """
    force, moment = body_loads(s, with_friction)
    force, moment = (
        {name: called(vector, what) for name, vector in of.items()}
        for of, what in ((force, "force"), (moment, "moment"))
    )
    s.scope.comment("motion without the joints")
    acceleration, spin_rate = without_joints(s, force, moment)
    if not s.segment.rows:
        return Motion(force, moment, acceleration, spin_rate)
    rows = Rows(s)
    s.scope.comment("inverse inertia along the rows")
    factors = make_solver(s, rows.coupling())
    if s.segment.full and with_friction:
        acceleration, spin_rate, wrenches = FullSystem(s, rows, force, moment).solve()
        return Motion(
            force, moment, acceleration, spin_rate, system=rows, factors=factors, wrenches=wrenches
        )
    multipliers = factors.solve(rows.without_joints(acceleration, spin_rate))
    linear, angular = rows.act(multipliers)
    s.scope.comment("accelerations by the joints")
    return Motion(
        force,
        moment,
        _added(acceleration, linear),
        _added(spin_rate, angular),
        multipliers,
        rows,
        factors,
    )


def without_joints(
    s: State, force: dict[str, Any], moment: dict[str, Any]
) -> tuple[dict[str, Any], dict[str, Any]]:
    """Accelerations as if there were no joint forces, by loads alone: ``force`` on each body, N,
    ground axes, ``moment`` about its mass centre, N m, body axes. The bodies of a rigid group only
    rotate together: each mass centre accelerates by the force on its own body.

    Returns accelerations of mass centres, by body (ground axes, m/s2), and angular accelerations of
    rigid groups without the ground, by leader (body axes, rad/s2).
    """
    acceleration = {
        body: vec3.scale(s.case.inverse_mass(body), force[body]).called("a")
        for body in s.spec.bodies
    }
    return acceleration, {
        group[0]: angular_acceleration(s, group, moment).called("spin_rate")
        for group in s.segment.groups
        if GROUND not in group
    }


def make_drive(s: State, motion: Motion, joint: str) -> Motion:
    """Change of the motion per newton of a force that pushes the two bodies of a joint apart along
    its x axis: on the second body in the direction that makes the separation distance larger
    (`separation_sign`), on the first one the opposite.

    Parameters
    ----------
    s : State
    motion : Motion
        from `make_motion` at the state, in a segment with constraint rows
    joint : str

    Returns
    -------
    Motion
        with ``moving`` False: changes per newton
    """
    assert motion.system is not None
    assert motion.factors is not None
    acceleration, moment = dict.fromkeys(s.spec.bodies, ZERO), dict.fromkeys(s.spec.bodies, ZERO)
    line, outward = s.separation(joint), s.case.separation_sign(joint)
    for body, sign, arm in zip(
        s.spec.scene.joint[joint].bodies, (-1.0, 1.0), (line.arm_a, line.arm_b), strict=True
    ):
        if body != GROUND:
            acceleration[body] = vec3.scale(sign * outward * s.case.inverse_mass(body), line.e)
            moment[body] = vec3.scale(outward, vec3.unrotate(s.attitude(body), arm))
    spin_rate = dict.fromkeys(s.segment.leaders, ZERO)
    for group in s.segment.groups:
        group_moment = vector_sum([moment[body] for body in group if body != GROUND])
        if group[0] in spin_rate and group_moment is not ZERO:
            spin_rate[group[0]] = vec3.rotate(s.case.inverse_inertia(group), group_moment)
    multipliers = motion.factors.solve(
        motion.system.without_joints(acceleration, spin_rate, moving=False)
    )
    linear, angular = motion.system.act(multipliers)
    changes = _added(acceleration, linear), _added(spin_rate, angular)
    return Motion(
        dict.fromkeys(moment, ZERO),
        moment,
        *changes,
        multipliers,
        motion.system,
        motion.factors,
        moving=False,
    )


def angular_acceleration(s: State, group: tuple[str, ...], moment: dict[str, Any]) -> Any:
    """Angular acceleration of a rigid group, body axes, rad/s2, by Euler's equations I w' = m - w x
    I w; without the second term if the ground leads the group. m is the sum of the moments on its
    bodies (``moment`` by body, body axes, N m), I that of their inertias, each about the mass
    centre of its own body; joints act only as far as ``moment`` includes them."""
    leader, total_moment = s.segment.leader(group[0]), vector_sum([moment[body] for body in group])
    if leader != GROUND:
        omega = s.rate(leader)
        total_moment = vec3.sub(
            total_moment, vec3.cross(omega, vec3.rotate(s.case.group_inertia(group), omega))
        )
    return vec3.rotate(s.case.inverse_inertia(group), total_moment)


def _added(vectors: dict[str, Any], others: dict[str, Any]) -> dict[str, Any]:
    """Sum of two vectors for each name in ``vectors``; None in ``others`` counts as zero. A sum of
    `ZERO` only is `ZERO` (`vector_sum`)."""
    additions = {name: ZERO if other is None else other for name, other in others.items()}
    return {name: vector_sum([vector, additions[name]]) for name, vector in vectors.items()}


def emit_correct(out: Text, c: Context, segment: Segment) -> None:
    """Write the kernel function ``correct_SEGMENT(w)``, which stores the largest constraint
    residuals of a segment at the state Y into RESIDUAL_NOW and, with ``solver.drift =
    "projection"``, projects the state onto the constraints. A case in which rows have become
    redundant (or have ceased to be) is left to the kernel variant LEAST_SQUARES; one whose state is
    not finite is integrated again with smaller steps."""
    if c.emit_alias(out, segment, "correct"):
        return
    corrects = c.spec.scene.solver.drift == "projection"
    docstring = "Update the residuals of the constraints at the state Y"
    docstring += (
        ", and project it onto them by the minimum correction, weighted by mass."
        if corrects
        else "."
    )
    text = out.function(f"correct_{segment.name}(w)", docstring)
    s = State(c, c.scope(), segment, "Y")
    for k in range(4):
        s.scope.store(component("RESIDUAL_NOW", k), 0.0)
    reject_unless(s.scope, is_finite(s))
    rows = Rows(s)
    rows.update_residuals()
    coupling = rows.coupling()
    factors = make_solver(s, coupling)
    if isinstance(factors, Factors):
        dropped = Rows(s, s.segment.dropped)
        dropped.update_residuals()
        for one in dropped.rows:
            rows.reject_independent(one, factors)
    else:
        factors.solve([one.value for one in rows.rows])
    check_pivots(s, coupling, factors)
    if corrects:
        _project(s, rows, factors)
    s.scope.write(text)


def _project(s: State, rows: Rows, factors: Solver) -> None:
    """Add lines to the scope of a state that project it onto the constraints ``rows``: positions
    and attitudes by one Newton step, weighted by mass, velocities and angular rates by another.
    Both steps start from the residuals of the state as it was; ``factors`` solves systems with the
    coupling matrix of the rows there."""
    position_change, rotation = rows.act(factors.solve([-one.value for one in rows.rows]))
    velocity_change, rate_change = rows.act(factors.solve([-one.rate for one in rows.rows]))
    for body in s.spec.bodies:
        for vector, value, change in (
            ("X", s.position(body), position_change[body]),
            ("V", s.velocity(body), velocity_change[body]),
        ):
            if change is not None:
                s.scope.store(f"Y + {vector}_{body}", vec3.add(value, change))
    for leader in s.segment.leaders:
        if rotation[leader] is not None:
            q = s.quaternion(leader)
            d = quat.rate(q, rotation[leader]).called("d")
            s.scope.store(f"Y + Q_{leader}", tuple(q[i] + d[i] for i in range(4)))
            s.scope.store(f"Y + OMEGA_{leader}", vec3.add(s.rate(leader), rate_change[leader]))
