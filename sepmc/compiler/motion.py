"""The motion in a phase: the derivative of a state, what joints carry, and the correction of drift off the joints."""

from dataclasses import dataclass, field
from typing import Any

from sepmc.compiler.context import Context, part
from sepmc.compiler.formulas import quat, vec3
from sepmc.compiler.geometry import State
from sepmc.compiler.loads import add_all, body_loads
from sepmc.compiler.rows import Factors, JointRow, Rows, lose_dependent
from sepmc.compiler.shape import Stage
from sepmc.compiler.tables import call_look_up, emit_look_up
from sepmc.compiler.text import Text
from sepmc.scene.model import GROUND


def emit_rates(out: Text, c: Context) -> None:
    """Functions for the derivative in every phase, and one that calls that of the phase."""
    for stage in c.shape.stages:
        emit_look_up(out, c, stage)
        _rates(out, c, stage)
    text = out.function("rates(w, phase: int)", "Derivative D of the state S at the times CLOCK.")
    for number, stage in enumerate(c.shape.stages):
        text.block(f"{'elif' if number else 'if'} phase == {number}:")(f"rates_{stage.name}(w)")


def _rates(out: Text, c: Context, stage: Stage) -> None:
    """Derivative in a phase: loads, motion without the joints, what the joints add."""
    what = [" and ".join(group) + " turn as one" for group in stage.groups if len(group) > 1]
    what.append(f"{len(stage.rows)} constraint rows" if stage.rows else "nothing is constrained")
    text = out.function(f"rates_{stage.name}(w)", f"Phase {stage.name}: {', '.join(what)}.")
    call_look_up(text, c, stage)
    s = State(c, c.scope(), stage, "S")
    motion = make_motion(s)
    for body in c.shape.bodies:
        s.scope.store(f"D + X_{body}", s.speed(body))
        s.scope.store(f"D + V_{body}", motion.acceleration[body])
    for leader in stage.leaders:
        s.scope.store(f"D + Q_{leader}", quat.rate(s.quaternion(leader), s.rate(leader)))
        s.scope.store(f"D + OMEGA_{leader}", motion.spin_rate[leader])
    s.scope.write(text)


@dataclass
class Motion:
    """The moment of the loads on every body (body axes), accelerations of mass centres (ground axes) and angular accelerations of groups
    (body axes, by leader), and the rows of the joints with their multipliers."""

    moment: dict[str, Any]
    acceleration: dict[str, Any]
    spin_rate: dict[str, Any]
    rows: list[JointRow] = field(default_factory=list)
    multipliers: list[Any] = field(default_factory=list)


def make_motion(s: State) -> Motion:
    """The motion at a state."""
    force, moment = body_loads(s)
    s.scope.comment("motion without the joints")
    acceleration = {body: vec3.scale(s.case.inverse_mass(body), force[body]).called("a") for body in s.shape.bodies}
    spin_rate = {group[0]: _spin_rate(s, group, moment).called("spin_rate") for group in s.stage.groups if GROUND not in group}
    if not s.stage.rows:
        return Motion(moment, acceleration, spin_rate)
    rows = Rows(s)
    s.scope.comment("inverse inertia that the rows feel")
    factors = Factors(rows.coupling())
    multipliers = factors.solve(rows.without_joints(acceleration, spin_rate))
    linear, angular = rows.act(multipliers)
    s.scope.comment("what the joints do")
    return Motion(moment, _plus(acceleration, linear), _plus(spin_rate, angular), rows.rows, multipliers)


def _spin_rate(s: State, group: tuple[str, ...], moment: dict[str, Any]) -> Any:
    """Euler's equations of bodies that turn as one."""
    omega = s.rate(group[0])
    turning = vec3.cross(omega, vec3.rotate(s.case.group_inertia(group), omega))
    return vec3.rotate(s.case.inverse_inertia(group), vec3.sub(add_all([moment[body] for body in group]), turning))


def _plus(vectors: dict[str, Any], others: dict[str, Any]) -> dict[str, Any]:
    return {name: vector if others[name] is None else vec3.add(vector, others[name]) for name, vector in vectors.items()}


def emit_correct(out: Text, c: Context, stage: Stage) -> None:
    """A function that notes how far a phase's rows are off, and brings the state back if the scene asks for it."""
    corrects = c.shape.scene.solver.drift == "projection"
    says = "Note how far the state Y is off the constraints"
    says += ", and bring it back onto them by the least correction, weighted by mass." if corrects else "."
    text = out.function(f"correct_{stage.name}(w)", says)
    s = State(c, c.scope(), stage, "Y")
    for k in range(4):
        s.scope.store(part("RESIDUAL_NOW", k), 0.0)
    rows = Rows(s)
    rows.note_residuals()
    coupling = rows.coupling()
    factors = Factors(coupling)
    lose_dependent(s.scope, coupling, factors)
    if corrects:
        _correct(s, rows, factors)
    s.scope.write(text)


def _correct(s: State, rows: Rows, factors: Factors) -> None:
    """Bring a state back onto its constraints: places and attitudes, speeds and rates."""
    shift, turn = rows.act(factors.solve([-one.value for one in rows.rows]))
    kick, swing = rows.act(factors.solve([-one.rate for one in rows.rows]))
    for body in s.shape.bodies:
        for slab, now, change in (("X", s.place(body), shift[body]), ("V", s.speed(body), kick[body])):
            if change is not None:
                s.scope.store(f"Y + {slab}_{body}", vec3.add(now, change))
    for leader in s.stage.leaders:
        if turn[leader] is not None:
            q = s.quaternion(leader)
            d = quat.rate(q, turn[leader]).called("d")
            s.scope.store(f"Y + Q_{leader}", tuple(q[i] + d[i] for i in range(4)))
            s.scope.store(f"Y + OMEGA_{leader}", vec3.add(s.rate(leader), swing[leader]))
