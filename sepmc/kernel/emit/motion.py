"""The motion in a phase: accelerations by loads and joints, and the correction of drift off the
joints."""

from dataclasses import dataclass, field
from typing import Any

from sepmc.kernel.emit.context import Context, component, reject_unless
from sepmc.kernel.emit.full import FullSystem, Wrench, before_full
from sepmc.kernel.emit.geometry import State
from sepmc.kernel.emit.loads import add_all, body_loads
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
    """Lines for what has to be known of a state S before its motion: what tables give, and
    friction."""
    call_look_up(text, c, segment)
    if c.spec.friction_joints(segment):
        text(f"friction_{segment.name}(w)")
    if segment.full:
        before_full(text, segment, c.spec.bodies)


@dataclass
class Motion:
    """Force (ground axes) and moment (body axes) of the loads on every body, accelerations of mass
    centres (ground axes) and angular accelerations of groups (body axes, by leader), and the rows
    of the joints with their multipliers, or wrenches by the full system; or by how much a force
    changes all these, whatever the bodies do that are ``moving``."""

    force: dict[str, Any]
    moment: dict[str, Any]
    acceleration: dict[str, Any]
    spin_rate: dict[str, Any]
    multipliers: list[Any] = field(default_factory=list)
    system: Rows | None = None
    factors: Solver | None = None
    wrenches: dict[str, Wrench] = field(default_factory=dict)
    moving: bool = True
    # whether the rows are those of bodies that turn apart, the multipliers those of least sum of
    # squares
    shared: bool = False

    @property
    def rows(self) -> list[JointRow]:
        """Rows of the joints; none if there is no system of them."""
        return self.system.rows if self.system else []


def make_motion(s: State, rubs: bool = True) -> Motion:
    """The motion at a state; with the friction of guides, which has to be known, if it ``rubs``."""
    force, moment = body_loads(s, rubs)
    force, moment = (
        {name: called(vector, what) for name, vector in of.items()}
        for of, what in ((force, "force"), (moment, "moment"))
    )
    s.scope.comment("motion without the joints")
    acceleration, spin_rate = without_joints(s, force, moment)
    if not s.segment.rows:
        return Motion(force, moment, acceleration, spin_rate)
    rows = Rows(s)
    s.scope.comment("inverse inertia that the rows feel")
    factors = make_solver(s, rows.coupling())
    if s.segment.full and rubs:
        acceleration, spin_rate, wrenches = FullSystem(s, rows, force, moment).solve()
        return Motion(
            force, moment, acceleration, spin_rate, system=rows, factors=factors, wrenches=wrenches
        )
    multipliers = factors.solve(rows.without_joints(acceleration, spin_rate))
    linear, angular = rows.act(multipliers)
    s.scope.comment("what the joints do")
    return Motion(
        force,
        moment,
        _plus(acceleration, linear),
        _plus(spin_rate, angular),
        multipliers,
        rows,
        factors,
    )


def without_joints(
    s: State, force: dict[str, Any], moment: dict[str, Any]
) -> tuple[dict[str, Any], dict[str, Any]]:
    """Accelerations of bodies and angular accelerations of groups by loads alone."""
    acceleration = {
        body: vec3.scale(s.case.inverse_mass(body), force[body]).called("a")
        for body in s.spec.bodies
    }
    return acceleration, {
        group[0]: spin_rate_of(s, group, moment).called("spin_rate")
        for group in s.segment.groups
        if GROUND not in group
    }


def make_drive(s: State, motion: Motion, joint: str) -> Motion:
    """By how much 1 N changes a motion that drives the bodies of a joint apart along its x axis."""
    assert motion.system is not None
    assert motion.factors is not None
    acceleration, moment = dict.fromkeys(s.spec.bodies, ZERO), dict.fromkeys(s.spec.bodies, ZERO)
    line, apart = s.separation(joint), s.case.separation_sign(joint)
    for body, sign, arm in zip(
        s.spec.scene.joint[joint].bodies, (-1.0, 1.0), (line.arm_a, line.arm_b), strict=True
    ):
        if body != GROUND:
            acceleration[body] = vec3.scale(sign * apart * s.case.inverse_mass(body), line.e)
            moment[body] = vec3.scale(apart, vec3.unrotate(s.attitude(body), arm))
    spin_rate = dict.fromkeys(s.segment.leaders, ZERO)
    for group in s.segment.groups:
        turning = add_all([moment[body] for body in group if body != GROUND])
        if group[0] in spin_rate and turning is not ZERO:
            spin_rate[group[0]] = vec3.rotate(s.case.inverse_inertia(group), turning)
    multipliers = motion.factors.solve(
        motion.system.without_joints(acceleration, spin_rate, moving=False)
    )
    linear, angular = motion.system.act(multipliers)
    changed = _plus(acceleration, linear), _plus(spin_rate, angular)
    return Motion(
        dict.fromkeys(moment, ZERO),
        moment,
        *changed,
        multipliers,
        motion.system,
        motion.factors,
        moving=False,
    )


def spin_rate_of(s: State, group: tuple[str, ...], moment: dict[str, Any]) -> Any:
    """Euler's equations of bodies that turn as one."""
    leader, felt = s.segment.leader(group[0]), add_all([moment[body] for body in group])
    if leader != GROUND:
        omega = s.rate(leader)
        felt = vec3.sub(felt, vec3.cross(omega, vec3.rotate(s.case.group_inertia(group), omega)))
    return vec3.rotate(s.case.inverse_inertia(group), felt)


def _plus(vectors: dict[str, Any], others: dict[str, Any]) -> dict[str, Any]:
    added = {name: ZERO if other is None else other for name, other in others.items()}
    return {name: add_all([vector, added[name]]) for name, vector in vectors.items()}


def emit_correct(out: Text, c: Context, segment: Segment) -> None:
    """A function that notes how far a phase's rows are off, and brings the state back if the scene
    asks for it."""
    if c.emit_alias(out, segment, "correct"):
        return
    corrects = c.spec.scene.solver.drift == "projection"
    says = "Note how far the state Y is off the constraints"
    says += (
        ", and bring it back onto them by the least correction, weighted by mass."
        if corrects
        else "."
    )
    text = out.function(f"correct_{segment.name}(w)", says)
    s = State(c, c.scope(), segment, "Y")
    for k in range(4):
        s.scope.store(component("RESIDUAL_NOW", k), 0.0)
    reject_unless(s.scope, is_finite(s))
    rows = Rows(s)
    rows.note_residuals()
    coupling = rows.coupling()
    factors = make_solver(s, coupling)
    if isinstance(factors, Factors):
        dropped = Rows(s, s.segment.dropped)
        dropped.note_residuals()
        for one in dropped.rows:
            rows.reject_independent(one, factors)
    else:
        factors.solve([one.value for one in rows.rows])
    check_pivots(s, coupling, factors)
    if corrects:
        _correct(s, rows, factors)
    s.scope.write(text)


def _correct(s: State, rows: Rows, factors: Solver) -> None:
    """Bring a state back onto its constraints: places and attitudes, speeds and rates."""
    shift, turn = rows.act(factors.solve([-one.value for one in rows.rows]))
    kick, swing = rows.act(factors.solve([-one.rate for one in rows.rows]))
    for body in s.spec.bodies:
        for vector, now, change in (
            ("X", s.place(body), shift[body]),
            ("V", s.speed(body), kick[body]),
        ):
            if change is not None:
                s.scope.store(f"Y + {vector}_{body}", vec3.add(now, change))
    for leader in s.segment.leaders:
        if turn[leader] is not None:
            q = s.quaternion(leader)
            d = quat.rate(q, turn[leader]).called("d")
            s.scope.store(f"Y + Q_{leader}", tuple(q[i] + d[i] for i in range(4)))
            s.scope.store(f"Y + OMEGA_{leader}", vec3.add(s.rate(leader), swing[leader]))
