"""The start of a flight: the initial state, what disqualifies a case, and what depends on its
parameters alone."""

from typing import Any

from sepmc.kernel.emit.context import Context, component, reject_unless
from sepmc.kernel.emit.tables import has_tables
from sepmc.kernel.spec.variant import Variant
from sepmc.kernel.tracer.formulas import quat, vec3, vehicle
from sepmc.kernel.tracer.text import Text
from sepmc.kernel.tracer.tracer import total, where
from sepmc.routines import layout as at
from sepmc.scene.initial_rates import swings
from sepmc.scene.model import GROUND
from sepmc.schema import Status

_MOST_LINES = 120  # of a loop: in one, that of `srb` takes 9.8 s to compile, so 6.2
ZERO_AT_FIRST = (
    "DRIFT",
    "TURNED_FAR",
    "EVENT_ERROR",
    "STEPS",
    "UNEVEN",
    "WINDING_UNCLEAR",
    "UNRELEASED",
)


def shared_size(c: Context) -> int:
    """Numbers that all cases share: axes of joints and what makes their separation positive, axes
    of springs; outlines and tables."""
    if c.spec.scene.clearance or has_tables(c.spec):
        return len(c.spec.layout.model.numbers)
    return int(c.model.springs_x) + 3 * len(c.spec.scene.spring)


def emit_prepare(out: Text, c: Context) -> None:
    """A function that sets up a flight; written when the other parts have said what they need."""
    spec, workspace, case = c.spec, c.workspace, c.case
    text = out.function("prepare(w)", "What a flight needs of the parameters P of its cases.")
    (
        workspace.add("P", int(c.model.work)),
        workspace.add("NOT_FINITE", 1),
        workspace.add("SHARED", shared_size(c)),
    )
    text.block("for k in range(D, D + SIZE_Y):  # what a phase does not integrate stays")(
        "w[k] = 0.0"
    )
    _start(c)
    scope = case.scope
    for name in (
        *ZERO_AT_FIRST,
        *(component("RESIDUAL", k) for k in range(4)),
        *(c.indicator(name) for name in c.indicators),
    ):
        scope.store(name, 0.0)
    reject_unless(scope, scope.load("NOT_FINITE").equals(0.0), Status.INVALID_INPUT)
    for segment in spec.segments:
        if segment.end_time:
            workspace.add(f"UNTIL_{segment.name}", 1)
            scope.store(
                f"UNTIL_{segment.name}",
                total([case.number(place) for place in (*segment.end_time, *_some(segment.delay))]),
            )
    for joint in [] if spec.any_order else spec.failing_joints:
        reject_unless(
            scope, case.number(spec.layout.slots[f"joint.{joint}.fails"]) < 0.5, Variant.ANY_ORDER
        )
    if workspace.has("AIR"):  # a look-up, lane by lane
        inner = text.lanes()
        inner(
            f"air, w[AIR_TOP + l] = layer(w[P + {at.ALTITUDE} * LANES + l])",
            "put4(w, AIR + l, air)",
        )
    for body, start in spec.layout.outlines.items():
        if workspace.has(held := f"OUTLINE_{body}"):
            size = workspace.counts[held]
            text.lanes()(
                f"load_outline(w, {held} + {size} * l, P + {start} * LANES + l, "
                f"{size // at.PART_SIZE})"
            )
    scope.write(text, _MOST_LINES)


def _some(place: int | None) -> list[int]:
    return [] if place is None else [place]


def _start(c: Context) -> None:
    """The initial state of the mated vehicle, consistent with every joint, and what disqualifies a
    case.

    It is seen from a frame that moves with the first velocity of the mass centre: places and speeds
    of separation are then small numbers, and reject_unless nothing to cancellation. A vehicle held
    to the ground turns about the joint that holds it.
    """
    spec, workspace, case, scope = c.spec, c.workspace, c.case, c.case.scope
    r, omega = quat.matrix(case.attitude).called("r"), case.vector(at.OMEGA)
    pivot, found = _pivot(c), dict(swings(spec.scene, spec.dispersed))
    sound: Any = None
    for body in spec.bodies:
        offset = vec3.scale(
            -1.0, vehicle.arm(case.centre_of_mass(body), case.common_centre)
        ).called("offset")
        turning = offset if pivot is None else vec3.sub(offset, pivot)
        speed, rate = vec3.cross(omega, turning), omega
        for joint in (name for name, beyond in found.items() if body in beyond):
            swing, to_joint = case.swing(joint, body)
            speed = vec3.add(speed, vec3.cross(to_joint, swing))
            rate = vec3.add(rate, swing)
        scope.store(f"Y + X_{body}", vec3.rotate(r, offset))
        scope.store(f"Y + V_{body}", vec3.rotate(r, speed))
        scope.store(f"Y + Q_{body}", case.attitude)
        scope.store(f"Y + OMEGA_{body}", rate)
        if workspace.has(f"ANGLES_{body}"):
            scope.store(f"ANGLES_{body}", case.number(at.PITCH))
            scope.store(component(f"ANGLES_{body}", 1), case.number(at.ROLL))
        if workspace.has(f"HEADING_{body}"):
            scope.store(f"HEADING_{body}", quat.heading(r))
            scope.store(f"LAST_RATE_{body}", rate)
        heavy = (case.mass(body) > 0.0) & vec3.is_positive_definite(case.inertia(body))
        sound = heavy if sound is None else sound & heavy
    scope.store("REJECTED", where(sound, 0.0, float(Status.INVALID_INPUT)))
    scope.store("T", 0.0)
    scope.store("Y + WORK", 0.0)
    scope.store("RUN_END", case.number(at.END_TIME))
    workspace.add("ORIGIN_HEIGHT", 1), workspace.add("ORIGIN_CLIMB", 1)
    scope.store("ORIGIN_HEIGHT", case.number(at.ALTITUDE))
    scope.store("ORIGIN_CLIMB", case.velocity[1])
    for body in spec.bodies:
        if workspace.has(f"CLIMB_{body}"):  # height and its rate at the last end of a step
            scope.store(
                f"CLIMB_{body}", scope.load(f"Y + X_{body}", 3)[1] + case.number(at.ALTITUDE)
            )
            scope.store(
                component(f"CLIMB_{body}", 1), scope.load(f"Y + V_{body}", 3)[1] + case.velocity[1]
            )


def _pivot(c: Context) -> Any:
    """From the mass centre to the joint point about which the vehicle turns at the start; None:
    about the mass centre."""
    if c.model.pivot_joint < 0:
        return None
    joint = list(c.spec.scene.joint.values())[int(c.model.pivot_joint)]
    start = int(c.model.joints_p) + at.JOINT_SIZE * int(c.model.pivot_joint)
    second = joint.bodies[0] != GROUND and joint.second_point is not None
    return vehicle.arm(
        c.case.common_centre, c.case.vector(start + (at.SECOND_POINT if second else at.POINT))
    )
