"""Emitter of kinks of formulas, and of springs that only push, as events.

A kink has a switching function, which is zero where the formula is not smooth, and a mode, which
selects the branch of the formula: the sign of that function at the start of an interval (-1, 0 or
1; 0 if the function stays at zero). The mode is constant within an interval, so that a formula is
smooth within a step. A step ends where the function reaches zero, and the mode changes there.
"""

import math
from typing import Any

from sepmc.kernel.emit.context import Context, component, reject_if
from sepmc.kernel.emit.geometry import State
from sepmc.kernel.emit.jets import Jet
from sepmc.kernel.emit.signals import Signals, mode_field
from sepmc.kernel.emit.slack import slack_force
from sepmc.kernel.emit.tables import call_look_up, has_tables
from sepmc.kernel.spec.kernel_spec import Event
from sepmc.kernel.spec.kinks import Kink, SlackKink, kink_name
from sepmc.kernel.tracer.formulas import scalar
from sepmc.kernel.tracer.text import Text
from sepmc.kernel.tracer.tracer import NUMBER, Expr, Scope, where
from sepmc.routines import layout as at
from sepmc.schema import Status

# A switching function counts as zero within this fraction of the numbers whose difference it is (or
# of 1). The sign of its rate or acceleration then counts, if by it the function moves further than
# that within a millisecond.
_AT_ZERO, _PER_RATE, _PER_ACCELERATION = 1e-12, 1e3, 1e6
# s: step length that makes a kernel reject the case, because the mode was wrong in the step before
_REJECTED = -1.0
_SAME_TIME = 2.0 * at.GRAIN


def time_field(kink: str) -> str:
    """Name of the workspace field of the time, s, at which the mode of a kink (the sign of its
    switching function) last changed; minus infinity before it has changed."""
    return f"SWITCHED_{kink}"


def _tolerance(numbers: list[Any]) -> Any:
    """Largest distance from zero at which a switching function counts as zero, where it is the
    difference (or sum) of the given ``numbers``: 1e-12 of their largest magnitude, but at least
    1e-12."""
    size: Any = max([1.0, *(abs(x) for x in numbers if not isinstance(x, Expr))])
    for x in numbers:
        if isinstance(x, Expr):
            size = scalar.larger(scalar.abs(x), size)
    return _AT_ZERO * size


def time_to_kink(s: State, event: Event) -> tuple[Any, list[tuple[str, Any]]]:
    """Predict when the switching function of a kink reaches zero.

    Returns the expression of the time from the state to that event, s (0 now, infinite if none is
    in sight, -1 if the mode was wrong in the last step: the case is then integrated again with
    smaller steps), and what the caller stores for later steps, as pairs (workspace field,
    expression): value of the function, with the sign that makes it negative before the event, and
    its rate; the present time; the second rate; the mode of the next interval if the present one
    ends here; the start of the present interval.

    Lines are added to the scope that end a case whose mode changes again and again at one instant
    (status too-many-events), and set UNEVEN where the function leaves zero within an interval.
    """
    c, scope, kink = s.c, s.scope, event.item
    name, field = f"{s.segment.name}_{kink}", mode_field(kink)
    for stem, count in (("VALUE", 1), ("RATE", 1), ("PREVIOUS", 2), ("BEGUN", 1)):
        c.workspace.add(f"{stem}_{name}", count)
    c.workspace.add(event.flag(s.segment.name), 1)
    c.start(time_field(kink), -math.inf)
    switches = _kink(s, kink)
    scope.comment(f"{kink} of a {'formula' if isinstance(switches, Kink) else 'spring'}")
    jet, numbers = _switching(_moving(s), switches)
    value = _expression(s, jet.value).called("switching")
    rate = _expression(s, jet.rate).called("switching_rate")
    time, mode = s.time, scope.load(field)
    previous_time, previous_acceleration = (
        scope.load(f"PREVIOUS_{name}"),
        scope.load(component(f"PREVIOUS_{name}", 1)),
    )
    first = previous_time.equals(math.inf)
    elapsed = where(time > previous_time, time - previous_time, math.inf)
    before = scope.load(f"RATE_{name}")
    acceleration = jet.second
    if acceleration is None:
        acceleration = (rate + mode * before) / elapsed
    acceleration = _expression(s, acceleration).called("switching_acceleration")
    jerk = (acceleration - previous_acceleration) / elapsed
    tolerance = _expression(s, _tolerance(numbers)).called("tolerance")
    at_zero = scalar.abs(value) <= tolerance
    trend = where(scalar.abs(acceleration) > _PER_ACCELERATION * tolerance, acceleration, 0.0)
    trend = where(scalar.abs(rate) > _PER_RATE * tolerance, rate, trend)
    trend = where(at_zero, trend, value).called("trend")
    wanted = where(trend > 0.0, 1.0, where(trend < 0.0, -1.0, mode)).called("wanted")
    unset = mode.equals(0.0)
    differs = where(wanted.equals(mode), 0.0, 1.0) > 0.5
    # of one instant: both modes lead to the other one
    switched = time - scope.load(time_field(kink)) <= _SAME_TIME
    reject_if(scope, first & differs & switched, Status.TOO_MANY_EVENTS)
    left_zero = unset & differs & (previous_time < math.inf) & (scalar.abs(value) > tolerance)
    scope.store("UNEVEN", where(left_zero, 1.0, scope.load("UNEVEN")))
    below, slope = -(mode * value), -(mode * rate)
    left = scalar.time_left(below, slope, -(mode * acceleration), -(mode * jerk))
    passed = (below > tolerance) & (slope <= 0.0)
    left = where(passed, _REJECTED, left)
    # at the start of an interval: now, or not before the function has moved away
    now_or_later = where(differs, 0.0, where(at_zero, math.inf, left))
    # an interval of no length ends at the time at which it begins
    begun = where(first, time, scope.load(f"BEGUN_{name}"))
    at_start = first | (time - begun <= _SAME_TIME)
    left = where(at_start, now_or_later, where(unset, where(differs, 0.0, math.inf), left))
    left = where(at_zero & (trend * trend <= 0.0), math.inf, left)
    records = [
        (f"VALUE_{name}", below),
        (f"RATE_{name}", slope),
        (f"PREVIOUS_{name}", time),
        (component(f"PREVIOUS_{name}", 1), acceleration),
        (event.flag(s.segment.name), wanted),
        (f"BEGUN_{name}", begun),
    ]
    return left.called("remaining"), records


def _expression(s: State, number: Any) -> Expr:
    """A number, known or symbolic, as an expression of the scope of a state."""
    return number if isinstance(number, Expr) else s.scope.add("constant", (number,), NUMBER)


def _moving(s: State) -> Signals:
    """Signals with their rates at a state; the same object at each call for one state."""
    known: Signals | None = getattr(s, "_moving", None)
    if known is None:
        known = Signals(s, moving=True)
        s._moving = known  # type: ignore[attr-defined]
    return known


def _switching(signals: Signals, kink: Kink | SlackKink) -> tuple[Jet, list[Any]]:
    """Jet (value and time derivatives) of the switching function of a kink, and a list of numbers
    whose sizes give its round-off: the function itself or the two whose difference it is, of a
    spring the forces whose sum it is. The derivatives are 0 unless ``signals`` are ``moving``."""
    return slack_force(signals, kink) if isinstance(kink, SlackKink) else signals.switching(kink)


def _kink(s: State, name: str) -> Kink | SlackKink:
    """Kink by its name (`kink_name`)."""
    return next(kink for k, kink in enumerate(s.spec.formulas.kinks) if kink_name(k) == name)


def set_mode(scope: Scope, c: Context, event: Event, segment: str) -> None:
    """Add lines to a scope that, at the end of an interval of a segment, set the mode of the kink
    ``event`` for the next interval; where the mode changes, they record the time and raise the
    error indicator of the event time."""
    kink = event.item
    field, time = mode_field(kink), time_field(kink)
    mode, wanted = scope.load(field), scope.load(event.flag(segment))
    changes = (where(wanted.equals(mode), 0.0, 1.0) > 0.5).called("changes")
    rate = scope.load(f"RATE_{segment}_{kink}")
    time_per_unit = where(rate > 0.0, 1.0 / rate, 0.0)
    indicator = c.indicator(f"{segment}_{event.name}")
    scope.store(
        indicator,
        scalar.larger(scope.load(indicator), where(changes, time_per_unit, 0.0)),
    )
    scope.store(time, where(changes, scope.load("T"), scope.load(time)))
    scope.store(field, where(changes, wanted, mode))


def emit_modes(out: Text, c: Context) -> None:
    """Write the kernel function ``set_modes(w)``, which sets, at the start of a case, the mode of
    each kink to the sign of its switching function in each lane: -1, 1, or 0 within round-off of
    zero. Nothing is written without kinks."""
    kinks = c.spec.formulas.kinks
    if not kinks:
        return
    text = out.function("set_modes(w)", "Set the modes of kinks at the start.")
    segment = c.spec.segments[0]
    if has_tables(c.spec):
        text.components("SIZE_Y")("w[S + e + l] = w[Y + e + l]")
        text.lanes()("w[CLOCK + l] = w[T + l]")
        call_look_up(text, c, segment)
    s = State(c, c.scope(), segment, "Y")
    signals = Signals(s)
    for k, kink in enumerate(kinks):
        field = mode_field(kink_name(k))
        c.workspace.add(field, 1)
        jet, numbers = _switching(signals, kink)
        value, tolerance = _expression(s, jet.value), _tolerance(numbers)
        mode = where(value > tolerance, 1.0, where(value < -tolerance, -1.0, 0.0))
        s.scope.store(field, mode)
    s.scope.write(text)
