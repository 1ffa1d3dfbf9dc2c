"""Emitter of the start of a case: initial state, rejection of invalid parameters, and all values
that depend on the parameters alone."""

from typing import Any

from sepmc.kernel.emit.context import Context, component, reject_unless, state_offset
from sepmc.kernel.emit.tables import has_tables
from sepmc.kernel.spec.variant import Variant
from sepmc.kernel.tracer.formulas import quat, vec3, vehicle
from sepmc.kernel.tracer.text import Text
from sepmc.kernel.tracer.tracer import total, where
from sepmc.routines import layout as at
from sepmc.scene.initial_rates import initial_rates
from sepmc.scene.model import GROUND
from sepmc.schema import Status

_MOST_LINES = 120  # per loop: a single loop of `srb` takes 9.8 s to compile, divided ones 6.2 s
INITIALLY_ZERO = (
    "DRIFT",
    "TURNED_FAR",
    "EVENT_ERROR",
    "STEPS",
    "UNEVEN",
    "WINDING_UNCLEAR",
    "UNRELEASED",
)


def shared_size(c: Context) -> int:
    """Number of values, common to all cases, that a kernel copies into its field SHARED: joint axes
    and separation signs, spring axes; if needed, also outlines and tables."""
    if c.spec.scene.clearance or has_tables(c.spec):
        return len(c.spec.layout.model.numbers)
    return int(c.model.springs_x) + 3 * len(c.spec.scene.spring)


def emit_prepare(out: Text, c: Context) -> None:
    """Write the kernel function ``prepare(w)``, which computes, once per case, the initial state
    and all values that follow from the parameters alone. It ends cases with invalid parameters
    (status invalid-input) and, in the variant STANDARD, leaves cases with a joint that fails to
    release to the kernel variant ANY_ORDER. It must be written after all functions that use such
    values."""
    spec, workspace, case = c.spec, c.workspace, c.case
    text = out.function(
        "prepare(w)",
        "Compute the initial state and all values that depend on the parameters P alone.",
    )
    (
        workspace.add("P", int(c.model.work)),
        workspace.add("NOT_FINITE", 1),
        workspace.add("SHARED", shared_size(c)),
    )
    text.block(
        "for k in range(D, D + SIZE_Y):  # components that a segment does not integrate stay 0"
    )("w[k] = 0.0")
    _set_initial_state(c)
    scope = case.scope
    for name in (
        *INITIALLY_ZERO,
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
                total(
                    [
                        case.number(slot)
                        for slot in (*segment.end_time, *_optional_slot(segment.delay))
                    ]
                ),
            )
    for joint in [] if spec.any_order else spec.failing_joints:
        reject_unless(
            scope, case.number(spec.layout.slots[f"joint.{joint}.fails"]) < 0.5, Variant.ANY_ORDER
        )
    if workspace.has("AIR"):  # look-up, lane by lane
        inner = text.lanes()
        inner(
            f"air, w[AIR_TOP + l] = layer(w[P + {at.ALTITUDE} * LANES + l])",
            "put4(w, AIR + l, air)",
        )
    for body, start in spec.layout.outlines.items():
        if workspace.has(outline_field := f"OUTLINE_{body}"):
            size = workspace.counts[outline_field]
            text.lanes()(
                f"load_outline(w, {outline_field} + {size} * l, P + {start} * LANES + l, "
                f"{size // at.PART_SIZE})"
            )
    scope.write(text, _MOST_LINES)


def _optional_slot(slot: int | None) -> list[int]:
    """List with a parameter index, or empty for None."""
    return [] if slot is None else [slot]


def _set_initial_state(c: Context) -> None:
    """Add lines to the scope of the case that set the initial state of the mated vehicle and end a
    case (status invalid-input) with a mass or inertia tensor that is not positive.

    The frame moves with the initial velocity of the common mass centre: positions and velocities of
    the separation are then small numbers without cancellation. The vehicle rotates about its mass
    centre or, if it is connected to the ground, about that joint; initial rates across joints are
    added.
    """
    spec, workspace, case, scope = c.spec, c.workspace, c.case, c.case.scope
    r, omega = quat.matrix(case.attitude).called("r"), case.vector(at.OMEGA)
    pivot, rates_of_joints = _pivot(c), dict(initial_rates(spec.scene, spec.dispersed))
    valid: Any = None
    for body in spec.bodies:
        offset = vec3.scale(
            -1.0, vehicle.arm(case.centre_of_mass(body), case.common_centre)
        ).called("offset")
        arm = offset if pivot is None else vec3.sub(offset, pivot)
        speed, rate = vec3.cross(omega, arm), omega
        for joint in (name for name, bodies in rates_of_joints.items() if body in bodies):
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
        physical = (case.mass(body) > 0.0) & vec3.is_positive_definite(case.inertia(body))
        valid = physical if valid is None else valid & physical
    scope.store("REJECTED", where(valid, 0.0, float(Status.INVALID_INPUT)))
    scope.store("T", 0.0)
    scope.store("Y + WORK", 0.0)
    for signal, first in spec.formulas.with_states.items():
        initial = case.number(spec.layout.slots[f"signal.{signal}.initial"])
        for k in range(spec.formulas.signals[signal].states):
            scope.store(f"Y + {state_offset(first + k)}", 0.0 if k else initial)
    scope.store("RUN_END", case.number(at.END_TIME))
    workspace.add("ORIGIN_HEIGHT", 1), workspace.add("ORIGIN_CLIMB", 1)
    scope.store("ORIGIN_HEIGHT", case.number(at.ALTITUDE))
    scope.store("ORIGIN_CLIMB", case.velocity[1])
    for body in spec.bodies:
        if workspace.has(f"CLIMB_{body}"):  # height and its rate at the end of the last step
            scope.store(
                f"CLIMB_{body}", scope.load(f"Y + X_{body}", 3)[1] + case.number(at.ALTITUDE)
            )
            scope.store(
                component(f"CLIMB_{body}", 1), scope.load(f"Y + V_{body}", 3)[1] + case.velocity[1]
            )


def _pivot(c: Context) -> Any:
    """Vector from the common mass centre to the joint point on the ground about which the vehicle
    rotates at the start, body axes, m; None if it rotates about the mass centre."""
    if c.model.pivot_joint < 0:
        return None
    joint = list(c.spec.scene.joint.values())[int(c.model.pivot_joint)]
    start = int(c.model.joints_p) + at.JOINT_SIZE * int(c.model.pivot_joint)
    second = joint.bodies[0] != GROUND and joint.second_point is not None
    return vehicle.arm(
        c.case.common_centre, c.case.vector(start + (at.SECOND_POINT if second else at.POINT))
    )
