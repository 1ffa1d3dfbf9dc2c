"""Lines of a specialised kernel for the motion in a phase: the derivative of a state, and the correction of its drift off the joints."""

from sepmc.compiler.emit_context import Context
from sepmc.compiler.emit_geometry import emit_state
from sepmc.compiler.emit_loads import emit_loads
from sepmc.compiler.emit_rows import emit_rows
from sepmc.compiler.shape import Stage
from sepmc.compiler.text import Text
from sepmc.scene.model import GROUND


def emit_rates(out: Text, c: Context) -> None:
    """Functions for the derivative in every phase, and one that calls that of the phase."""
    for stage in c.shape.stages:
        _rates(out, c, stage)
    text = out.function("rates(w, phase: int)", "Derivative D of the state S at the times CLOCK.")
    for number, stage in enumerate(c.shape.stages):
        text.block(f"{'elif' if number else 'if'} phase == {number}:")(f"rates_{stage.name}(w)")


def _rates(out: Text, c: Context, stage: Stage) -> None:
    """Derivative in a phase: loads, motion without the joints, what the joints add."""
    what = [" and ".join(group) + " turn as one" for group in stage.groups if len(group) > 1]
    what.append(f"{len(stage.rows)} constraint rows" if stage.rows else "nothing is constrained")
    text = out.function(f"rates_{stage.name}(w)", f"Phase {stage.name}: {', '.join(what)}.").lanes()
    text("t = w[CLOCK + l]")
    g = emit_state(text, c, stage, "S")
    emit_loads(text, g)
    text("# motion without the joints")
    for body in c.shape.bodies:
        if c.slabs.add(f"INVERSE_MASS_{body}", 1):
            c.parameters(f"w[INVERSE_MASS_{body} + l] = 1.0 / mass_{body}")
    for body in c.shape.bodies:
        text(f"a_{body} = vec3.scale(w[INVERSE_MASS_{body} + l], force_{body})")
    for group in stage.groups:
        if GROUND not in group:
            _turning(text, c, group)
    if stage.rows:
        emit_rows(text, g, "motion")
    text("# derivative")
    for body in c.shape.bodies:
        text(f"put3(w, D + X_{body} + l, v_{body})", f"put3(w, D + V_{body} + l, a_{body})")
    for leader in stage.leaders:
        text(f"put4(w, D + Q_{leader} + l, quat.rate(q_{leader}, omega_{leader}))")
        text(f"put3(w, D + OMEGA_{leader} + l, spin_rate_{leader})")


def _turning(text: Text, c: Context, group: tuple[str, ...]) -> None:
    """Euler's equations of bodies that turn as one: their inertias and moments add up, since their axes are parallel."""
    leader, name = group[0], "_".join(group)
    _add_inertia(c, group)
    text(f"inertia_{leader}, inverse_{leader} = get6(w, INERTIA_{name} + l), get6(w, INVERSE_{name} + l)")
    moments = f"moment_{leader}"
    for body in group[1:]:
        moments = f"vec3.add({moments}, moment_{body})"
    text(f"turning = vec3.cross(omega_{leader}, vec3.rotate(inertia_{leader}, omega_{leader}))")
    text(f"spin_rate_{leader} = vec3.rotate(inverse_{leader}, vec3.sub({moments}, turning))")


def _add_inertia(c: Context, group: tuple[str, ...]) -> None:
    """Slabs of a group's inertia and its inverse."""
    name = "_".join(group)
    if c.slabs.add(f"INERTIA_{name}", 6):
        c.slabs.add(f"INVERSE_{name}", 6)
        total = f"tensor_{group[0]}"
        for body in group[1:]:
            total = f"vec3.add_matrices({total}, tensor_{body})"
        c.parameters(f"tensor = {total}", f"put6(w, INERTIA_{name} + l, tensor)")
        c.parameters(f"put6(w, INVERSE_{name} + l, vec3.symmetric_inverse(tensor))")


def emit_correct(out: Text, c: Context, stage: Stage) -> None:
    """A function that notes how far a phase's rows are off, and brings the state back if the scene asks for it."""
    corrects = c.shape.scene.solver.drift == "projection"
    says = "Note how far the state Y is off the constraints"
    says += ", and bring it back onto them by the least correction, weighted by mass." if corrects else "."
    text = out.function(f"correct_{stage.name}(w)", says).lanes()
    for k in range(4):
        text(f"w[RESIDUAL_NOW + {k} * LANES + l] = 0.0")
    g = emit_state(text, c, stage, "Y")
    for group in stage.groups:
        if GROUND not in group:
            _add_inertia(c, group)
            text(f"inverse_{group[0]} = get6(w, INVERSE_{'_'.join(group)} + l)")
    emit_rows(text, g, "drift" if corrects else "residual")
    if not corrects:
        return
    for body in c.shape.bodies:
        text(f"put3(w, Y + X_{body} + l, vec3.add(x_{body}, shift_{body}))")
        text(f"put3(w, Y + V_{body} + l, vec3.add(v_{body}, kick_{body}))")
    for leader in stage.leaders:
        text(f"d0, d1, d2, d3 = quat.rate(q_{leader}, turn_{leader})", f"q0, q1, q2, q3 = q_{leader}")
        text(f"put4(w, Y + Q_{leader} + l, (q0 + d0, q1 + d1, q2 + d2, q3 + d3))")
        text(f"put3(w, Y + OMEGA_{leader} + l, vec3.add(omega_{leader}, swing_{leader}))")
