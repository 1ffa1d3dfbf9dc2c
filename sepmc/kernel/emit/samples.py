"""Emitter of sampled signals: an interval of integration ends where a signal is sampled, and where
a sample begins to be used."""

import math
from collections.abc import Iterator

from sepmc.kernel.emit.context import Context, reject_unless
from sepmc.kernel.emit.geometry import State
from sepmc.kernel.emit.signals import Signals, held_field
from sepmc.kernel.emit.tables import call_look_up, has_tables
from sepmc.kernel.spec.kernel_spec import Segment
from sepmc.kernel.tracer.formulas import scalar
from sepmc.kernel.tracer.text import Text
from sepmc.kernel.tracer.tracer import NUMBER, Expr, Scope, where
from sepmc.routines import layout as at
from sepmc.schema import Status

_SAME_TIME = 2.0 * at.GRAIN


def _fields(signal: str) -> tuple[str, str, str]:
    """Names of the workspace fields of a sampled signal: number of samples taken, time from which
    the last sample is used (infinite if used already), value of the last sample."""
    return f"SAMPLES_{signal}", f"USE_TIME_{signal}", f"SAMPLE_{signal}"


def next_samples(scope: Scope, c: Context) -> Iterator[Expr]:
    """Yield two expressions for each sampled signal: the time of its next sample, s, then the time
    from which its last sample is used, s (infinite if it is used already)."""
    for signal in c.spec.formulas.sampled:
        samples, use_time, _ = _fields(signal)
        interval = c.case.number(c.spec.layout.slots[f"signal.{signal}.sample"])
        yield scope.load(samples) * interval
        yield scope.load(use_time)


def take_samples(segment: Segment) -> str:
    """Kernel code of the call of the function that samples signals in a segment; also the signature
    of that function."""
    return f"take_samples_{segment.name}(w)"


def emit_samples(out: Text, c: Context, segment: Segment) -> None:
    """Write the kernel function ``take_samples_SEGMENT(w)``, which, at the end of an interval,
    begins to use samples and takes new ones where they are due, and ends cases in which a sampled
    value is NaN or infinite (status undefined-formula). Nothing is written without sampled signals.

    Signals are updated one after the other in the order of the file. The formula of a signal sees
    the samples that signals before it use from this instant on. Its own sample that waited until
    now comes into use, unless a new one without delay replaces it.
    """
    sampled, slots = c.spec.formulas.sampled, c.spec.layout.slots
    if not sampled:
        return
    text = out.function(
        take_samples(segment),
        "Use samples of signals, and take new ones, where they are due.",
    )
    if has_tables(c.spec):
        text.components("SIZE_Y")("w[S + e + l] = w[Y + e + l]")
        text.lanes()("w[CLOCK + l] = w[T + l]")
        call_look_up(text, c, segment)
    s = State(c, c.scope(), segment, "Y")
    scope, finite = s.scope, getattr(scalar, "math.isfinite")
    for signal in sampled:
        held, (samples, use_time, sample) = held_field(signal), _fields(signal)
        initial, interval, delay = (
            c.case.number(slots[f"signal.{signal}.{key}"]) for key in ("initial", "sample", "delay")
        )
        for field, start in ((samples, 0.0), (use_time, math.inf), (sample, 0.0), (held, initial)):
            if c.workspace.add(field, 1):
                c.case.scope.store(field, start)
        value = Signals(s).sample(signal)  # a common one would remember samples taken before
        if not isinstance(value, Expr):
            value = scope.add("constant", (value,), NUMBER)
        count, at_once = scope.load(samples), delay <= _SAME_TIME
        due = (count * interval <= s.time + _SAME_TIME).called("due")
        used = (scope.load(use_time) <= s.time + _SAME_TIME).called("used")
        reject_unless(scope, finite(where(due, value, 0.0)), Status.UNDEFINED_FORMULA)
        now = where(used, scope.load(sample), scope.load(held))
        scope.store(held, where(due & at_once, value, now))
        waiting = where(used, math.inf, scope.load(use_time))
        later = where(at_once, math.inf, count * interval + delay)
        scope.store(use_time, where(due, later, waiting))
        scope.store(sample, where(due, value, scope.load(sample)))
        scope.store(samples, where(due, count + 1.0, count))
    scope.write(text)
