"""The derivative of a state in every phase, and with it what the joints carry that are followed."""

from sepmc.kernel.emit.context import Context
from sepmc.kernel.emit.energy import power
from sepmc.kernel.emit.geometry import State
from sepmc.kernel.emit.motion import before_motion, make_motion
from sepmc.kernel.emit.tables import emit_look_up
from sepmc.kernel.emit.wrenches import store_wrenches
from sepmc.kernel.spec.kernel_spec import Stage
from sepmc.kernel.tracer.formulas import quat
from sepmc.kernel.tracer.text import Text


def emit_rates(out: Text, c: Context) -> None:
    """Functions for the derivative in every phase, and one that calls that of the phase."""
    for stage in c.spec.stages:
        emit_look_up(out, c, stage)
        if not c.hands_on(out, stage, "rates"):
            _rates(out, c, stage)
    text = out.function("rates(w, phase: int)", "Derivative D of the state S at the times CLOCK.")
    for number, stage in enumerate(c.spec.stages):
        text.block(f"{'elif' if number else 'if'} phase == {number}:")(f"rates_{stage.name}(w)")


def _rates(out: Text, c: Context, stage: Stage) -> None:
    """Derivative in a phase: loads, motion without the joints, what the joints add."""
    what = [" and ".join(group) + " turn as one" for group in stage.groups if len(group) > 1]
    what.append(f"{len(stage.rows)} constraint rows" if stage.rows else "nothing is constrained")
    text = out.function(f"rates_{stage.name}(w)", f"Phase {stage.name}: {', '.join(what)}.")
    before_motion(text, c, stage)
    s = State(c, c.scope(), stage, "S")
    motion = make_motion(s)
    for body in c.spec.bodies:
        s.scope.store(f"D + X_{body}", s.speed(body))
        s.scope.store(f"D + V_{body}", motion.acceleration[body])
    for leader in stage.leaders:
        s.scope.store(f"D + Q_{leader}", quat.rate(s.quaternion(leader), s.rate(leader)))
        s.scope.store(f"D + OMEGA_{leader}", motion.spin_rate[leader])
    s.scope.comment("power of the loads")
    s.scope.store("D + WORK", power(s, motion.force, motion.moment))
    if c.carried_by_rates(stage):
        store_wrenches(s, motion)
    s.scope.write(text)
