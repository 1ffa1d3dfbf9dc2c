"""Emitter of the clauses (lists of conditions) that end phases, trigger releases and mark
observation events: whether all conditions of a clause are met, and when that happened."""

import math
from collections.abc import Iterator
from typing import Any

from sepmc.kernel.emit.context import Context, component
from sepmc.kernel.emit.ignition import ignition
from sepmc.kernel.emit.outcomes import event_angle, event_field
from sepmc.kernel.spec.kernel_spec import (
    ANY_PHASE,
    Due,
    Release,
    Segment,
    condition_flag,
    condition_numbers,
    stroke_flag,
)
from sepmc.kernel.tracer.formulas import ZERO
from sepmc.kernel.tracer.text import Text
from sepmc.kernel.tracer.tracer import Expr, Scope, total, where
from sepmc.routines import layout as at
from sepmc.scene.model import GROUND


def reset_clauses(text: Text, c: Context, segment: Segment) -> None:
    """Append lines that, as a segment begins, set the flags of the conditions in its own clauses
    (those that end its phase) to 0 (not met), then update them (`update_clauses`)."""
    scope = c.scope()
    for number in condition_numbers(segment.clauses):
        c.workspace.add(condition_flag(segment.name, number), 1)
        scope.store(condition_flag(segment.name, number), 0.0)
    scope.write(text)
    update_clauses(text, c, segment)


def update_clauses(text: Text, c: Context, segment: Segment) -> None:
    """Append lines that set to 1 the flags of those conditions in the clauses of a segment that are
    times, or ends of spring strokes, and have passed; and then DONE to 1 if all conditions of at
    least one clause are met. These are the clauses that end the phase of the segment; those of
    releases and events are left alone. Flags and DONE that are 1 stay 1."""
    scope = c.scope()
    done = (scope.load("DONE") > 0.0) | _clause_met(scope, c, segment.name, segment)
    scope.store("DONE", where(done, 1.0, 0.0))
    scope.write(text)


def _clause_met(
    scope: Scope,
    c: Context,
    segment: str,
    source: Segment | Release,
) -> Expr:
    """Return the condition that all conditions of at least one clause of ``source`` are met; store
    in the scope the flags of those that are times or ends of spring strokes. ``segment`` is the
    segment's name in the names of the flag fields (`condition_flag`), or ANY_PHASE."""
    flags = {}
    for number in condition_numbers(source.clauses):
        flags[number] = scope.load(condition_flag(segment, number)) > 0.0
    for number, occurs in _passive_conditions(scope, c, source):
        flags[number] = flags[number] | occurs
        scope.store(condition_flag(segment, number), where(flags[number], 1.0, 0.0))
    met = None
    for clause in source.clauses:
        all_met = flags[clause[0]]
        for number in clause[1:]:
            all_met = all_met & flags[number]
        met = all_met if met is None else met | all_met
    assert met is not None
    return met


def _passive_conditions(
    scope: Scope, c: Context, source: Segment | Release
) -> Iterator[tuple[int, Expr]]:
    """Yield, for each condition of ``source`` that is a time or the end of a spring's stroke, its
    condition number (as in `condition_flag`) and the symbolic condition that it is met now. Flags
    of all other conditions are set where their events are located."""
    now = scope.load("T")
    for number, due in source.times.items():
        yield number, now >= due_time(scope, c, due) - at.GRAIN
    for number, spring in source.springs.items():
        c.start(stroke_flag(spring), 0.0)
        yield number, scope.load(stroke_flag(spring)) > 0.0


def due_time(scope: Scope, c: Context, due: Due) -> Expr:
    """Expression of the time, s since the start, at which a condition on time is met: the sum of
    the parameters of ``due`` and, if it counts from the ignition of a motor, the time of that
    ignition; infinite while that motor has not been triggered."""
    terms = [c.case.number(slot) for slot in due.slots]
    for motor in c.spec.triggered_motors:
        if motor.name == due.motor:
            terms.insert(0, ignition(scope, c, motor))
    return total(terms)


def record_events(text: Text, c: Context, segment: Segment) -> None:
    """Append lines that set to 1 the flags of those conditions of a segment's releases and
    observation events that are times or ends of spring strokes and have passed; record the present
    time as EVENT_TIME_... of each release or event that occurs now for the first time; and store
    the state at each such observation event."""
    scope = c.scope()
    for release in segment.releases:
        for number in condition_numbers(release.clauses):
            c.start(condition_flag(ANY_PHASE, number), 0.0)
        path = f"EVENT_TIME_{release.name}"
        c.start(path, math.inf)
        occurs = _clause_met(scope, c, ANY_PHASE, release) & scope.load(path).equals(math.inf)
        scope.store(path, where(occurs, scope.load("T"), scope.load(path)))
        if not release.joint:
            c.workspace.add(f"OCCURS_NOW_{release.name}", 1)
            scope.store(f"OCCURS_NOW_{release.name}", where(occurs, 1.0, 0.0))
    scope.write(text)
    for release in segment.releases:
        if not release.joint:
            _store_event_state(text, c, segment, release.name)


def _store_event_state(text: Text, c: Context, segment: Segment, event: str) -> None:
    """Append lines that store the state Y into the field of an observation event (`event_field`) in
    lanes in which it occurs now. Every body that leads a rigid group in the last segment gets its
    own attitude, pitch and roll there, also if another body leads its group now."""
    path = event_field(event)
    text.block(f"for k in range({c.size}):").lanes()(
        f"w[{path} + k * LANES + l] = w[Y + k * LANES + l] "
        f"if w[OCCURS_NOW_{event} + l] > 0.0 else w[{path} + k * LANES + l]"
    )
    scope = c.scope()
    now = scope.load(f"OCCURS_NOW_{event}") > 0.0
    for body in c.spec.segments[-1].leaders:
        leader = segment.leader(body)
        if leader == GROUND:
            values: list[tuple[str, int, Any]] = [
                (f"{path} + Q_{body}", 4, c.case.attitude),
                (f"{path} + OMEGA_{body}", 3, ZERO),
            ]
            angles = [c.case.number(at.PITCH), c.case.number(at.ROLL)]
        else:
            values = [
                (f"{path} + Q_{body}", 4, scope.load(f"Y + Q_{leader}", 4)),
                (f"{path} + OMEGA_{body}", 3, scope.load(f"Y + OMEGA_{leader}", 3)),
            ]
            angles = [scope.load(component(f"ANGLES_{leader}", k)) for k in range(2)]
        if leader != body:
            for field, count, value in values:
                for k in range(count):
                    scope.store(
                        component(field, k), where(now, value[k], scope.load(component(field, k)))
                    )
        for k, value in enumerate(angles):
            angle = event_angle(c, event, body, k)
            scope.store(angle, where(now, value, scope.load(angle)))
    scope.write(text)
