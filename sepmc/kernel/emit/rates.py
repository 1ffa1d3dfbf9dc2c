"""Emitter of the derivative of the state in every segment. Joint loads are not part of it
(`sepmc.kernel.emit.monitor`)."""

from sepmc.kernel.emit.context import Context, state_offset
from sepmc.kernel.emit.energy import power
from sepmc.kernel.emit.geometry import State
from sepmc.kernel.emit.motion import before_motion, make_motion
from sepmc.kernel.emit.signals import reject_undefined, signals_of
from sepmc.kernel.emit.tables import emit_look_up
from sepmc.kernel.spec.kernel_spec import Segment
from sepmc.kernel.tracer.formulas import quat
from sepmc.kernel.tracer.text import Text


def emit_rates(out: Text, c: Context) -> None:
    """Write, for each segment, the kernel functions ``rates_SEGMENT(w)``, which stores the
    derivative of the state S at the time CLOCK into D, and ``look_up_SEGMENT(w)``, which it calls
    to look up tables; and ``rates(w, phase)``, which calls that of segment number ``phase``."""
    for segment in c.spec.segments:
        emit_look_up(out, c, segment)
        if not c.emit_alias(out, segment, "rates"):
            _emit_rates(out, c, segment)
    text = out.function("rates(w, phase: int)", "Derivative D of the state S at the times CLOCK.")
    for number, segment in enumerate(c.spec.segments):
        text.block(f"{'elif' if number else 'if'} phase == {number}:")(f"rates_{segment.name}(w)")


def _emit_rates(out: Text, c: Context, segment: Segment) -> None:
    """Write the kernel function ``rates_SEGMENT(w)``, which computes the derivative D of the state
    S in a segment (motion, work of the loads, states of signals) and ends cases in which a
    formula is undefined (status undefined-formula)."""
    properties = [
        " and ".join(group) + " rotate as one rigid group"
        for group in segment.groups
        if len(group) > 1
    ]
    properties.append(
        f"{len(segment.rows)} constraint rows" if segment.rows else "nothing is constrained"
    )
    text = out.function(
        f"rates_{segment.name}(w)", f"Phase {segment.name}: {', '.join(properties)}."
    )
    before_motion(text, c, segment)
    s = State(c, c.scope(), segment, "S")
    motion = make_motion(s)
    for body in c.spec.bodies:
        s.scope.store(f"D + X_{body}", s.velocity(body))
        s.scope.store(f"D + V_{body}", motion.acceleration[body])
    for leader in segment.leaders:
        s.scope.store(f"D + Q_{leader}", quat.rate(s.quaternion(leader), s.rate(leader)))
        s.scope.store(f"D + OMEGA_{leader}", motion.spin_rate[leader])
    s.scope.comment("power of the loads")
    s.scope.store("D + WORK", power(s, motion.force, motion.moment))
    for signal, first in c.spec.formulas.with_states.items():
        for k, rate in enumerate(signals_of(s).rates(signal)):
            s.scope.store(f"D + {state_offset(first + k)}", rate)
    if c.spec.formulas.used:
        reject_undefined(s)
    s.scope.write(text)
