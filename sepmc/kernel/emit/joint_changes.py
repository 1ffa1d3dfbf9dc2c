"""Emitter of the changes of joints from one kind to another within segments: when they are due,
that they are made, and what is recorded at a release.

A kind of a joint is the set of its constraint rows; kinds have numbers, and a joint only changes to
a higher number, with fewer rows.
"""

import math
from collections.abc import Iterator
from typing import Any

from sepmc.kernel.emit.context import Context, change_time, component
from sepmc.kernel.emit.outcomes import tip_off_field
from sepmc.kernel.spec.kernel_spec import Change, Segment
from sepmc.kernel.tracer.formulas import ZERO
from sepmc.kernel.tracer.text import Text
from sepmc.kernel.tracer.tracer import Expr, Scope, where
from sepmc.routines import layout as at
from sepmc.scene.model import GROUND


def flag_unreleased(text: Text, c: Context) -> None:
    """Append lines that, at the end of the run, set UNRELEASED to 1 (status never-released) in
    lanes where a joint has not made one of its changes. An optional change may be missing if its
    trigger has not occurred."""
    scope = c.scope()
    for joint in c.spec.initial_kinds:
        for change in c.spec.changes_of(joint):
            missing = kind_of(scope, c, joint) < float(change.to)
            if change.optional:
                missing = missing & (event_time(scope, c, change) < math.inf)
            scope.store("UNRELEASED", where(missing, 1.0, scope.load("UNRELEASED")))
    scope.write(text)


def kind_of(scope: Scope, c: Context, joint: str) -> Expr:
    """Expression of the number of the present kind of a joint (field KIND_joint)."""
    c.start(f"KIND_{joint}", float(c.spec.initial_kinds[joint]))
    return scope.load(f"KIND_{joint}")


def event_time(scope: Scope, c: Context, change: Change) -> Expr:
    """Expression of the time at which the trigger of a change (the end of a phase, or a release)
    occurred, s; infinite until then."""
    c.start(f"EVENT_TIME_{change.event}", math.inf)
    return scope.load(f"EVENT_TIME_{change.event}")


def due_changes(
    scope: Scope, c: Context, segment: Segment, joint: str
) -> Iterator[tuple[Change, Expr]]:
    """Yield each change that a joint may make in a segment, and the expression of the time at which
    it is due, s: that of its trigger plus the release delay of the joint; infinite before the
    trigger, and for a joint that fails to release."""
    slots = c.spec.layout.slots
    delay = c.case.number(slots[f"joint.{joint}.delay"])
    if joint in c.spec.failing_joints:  # it is never released
        delay = where(c.case.number(slots[f"joint.{joint}.fails"]) >= 0.5, math.inf, delay)
    for change in c.spec.changes_of(joint):
        if change.to in segment.joint_kinds[joint] and change.to > min(segment.joint_kinds[joint]):
            yield change, event_time(scope, c, change) + delay


def release_joints(text: Text, c: Context, segment: Segment) -> None:
    """Append lines that change the kinds of joints where a change is due in a segment, and record
    the times of changes and releases (`record_change`, `record_release`)."""
    scope = c.scope()
    now = scope.load("T")
    for joint in segment.variable_joints:
        kind_before = kind = kind_of(scope, c, joint)
        for change, due in due_changes(scope, c, segment, joint):
            kind = where(
                (now >= due - at.GRAIN) & (kind < float(change.to)), float(change.to), kind
            )
        scope.store(f"KIND_{joint}", kind)
        record_change(scope, c, joint, kind_before, kind)
        for free in segment.free_kinds(joint):
            record_release(
                scope, c, segment, joint, (kind_before < float(free)) & (kind >= float(free))
            )
    scope.write(text)


def record_change(scope: Scope, c: Context, joint: str, before: Expr, kind: Expr) -> None:
    """Add lines to a scope that record the present time of a joint's change from the kind number
    ``before`` to ``kind``, in the field (`change_time`) of each recorded number above ``before`` up
    to ``kind``; but not in a case in which an earlier phase had not ended at the end of the run."""
    for changing_joint, number in c.recorded_changes:
        if changing_joint == joint:
            path = change_time(joint, number)
            c.start(path, math.nan)
            changes = (before < float(number)) & (kind >= float(number))
            changes = changes & scope.load("UNRELEASED").equals(0.0)
            scope.store(path, where(changes, scope.load("T"), scope.load(path)))


def record_release(
    scope: Scope, c: Context, segment: Segment, joint: str, goes: Expr | None
) -> None:
    """Add lines to a scope that record the present time as that at which a joint becomes free
    (field RELEASE_joint), and the tip-off rates of its bodies if these are outputs.

    They do so where the condition ``goes`` is satisfied (None: in all cases), but not in a case in
    which an earlier phase had not ended at the end of the run.
    """
    c.start(f"RELEASE_{joint}", math.nan)
    in_time = scope.load("UNRELEASED").equals(0.0)
    goes = in_time if goes is None else goes & in_time
    records = [(f"RELEASE_{joint}", scope.load("T"))]
    for path, rate in _tip_off(scope, c, segment, joint):
        records += [(component(path, k), rate[k]) for k in range(3)]
    for path, now in records:
        scope.store(path, where(goes, now, scope.load(path)))


def _tip_off(scope: Scope, c: Context, segment: Segment, joint: str) -> Iterator[tuple[str, Any]]:
    """Yield, for each moving body of a joint whose tip-off rates are outputs, the workspace field
    of its tip-off rate and its present angular rate, body axes, rad/s."""
    if joint in c.spec.scene.output.tip_off:
        for body in c.spec.scene.joint[joint].bodies:
            if body != GROUND:
                leader = segment.leader(body)
                yield (
                    tip_off_field(joint, body),
                    ZERO if leader == GROUND else scope.load(f"Y + OMEGA_{leader}", 3),
                )
