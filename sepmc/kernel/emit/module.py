"""Assembly of the kernel of a scene: the text of a Python module that calls the physics this scene
needs, in order, and nothing else.

The module integrates LANES cases side by side. Sizes and offsets are constants in it, masses and
coefficients are data: scenes with equal specifications share it. `sepmc check --code` prints it.
"""

from sepmc.kernel.emit.block import emit_block, emit_load_switch
from sepmc.kernel.emit.cells import emit_cells
from sepmc.kernel.emit.clearances import emit_clearances
from sepmc.kernel.emit.context import Context
from sepmc.kernel.emit.energy import emit_energy
from sepmc.kernel.emit.events import emit_event_flags, emit_event_step, emit_pending_event
from sepmc.kernel.emit.extension import emit_extension
from sepmc.kernel.emit.guides import emit_friction
from sepmc.kernel.emit.history import emit_history
from sepmc.kernel.emit.kinks import emit_modes
from sepmc.kernel.emit.loads import emit_layers, emit_recentre_air
from sepmc.kernel.emit.monitor import emit_monitor
from sepmc.kernel.emit.motion import emit_correct
from sepmc.kernel.emit.outcomes import emit_outcomes
from sepmc.kernel.emit.rates import emit_rates
from sepmc.kernel.emit.samples import emit_samples
from sepmc.kernel.emit.start import INITIALLY_ZERO, emit_prepare, shared_size
from sepmc.kernel.emit.steps import (
    coefficients,
    emit_advance,
    emit_event_polish,
    emit_finish_step,
    emit_indicators,
    emit_step_length,
)
from sepmc.kernel.emit.tables import has_tables_over_height, looks_up
from sepmc.kernel.emit.wrenches import emit_min_norm
from sepmc.kernel.spec.kernel_spec import KernelSpec
from sepmc.kernel.spec.methods import method
from sepmc.kernel.tracer.text import Text
from sepmc.routines.layout import FULL_HISTORY, NO_HISTORY, SEPARATION_HISTORY

_HEADER = '''"""Kernel of a scene.

Written by sepmc for scenes of this structure; not edited by hand. {about}
"""

import math

import numpy as np

from sepmc.jit import noinline, routine
from sepmc.kernel.spec.methods import method
from sepmc.physics import guides, joints, quat, springs, vec3
from sepmc.physics.aerodynamics import aero_force, aero_moment, reported_angles, flow_angles
from sepmc.physics.atmosphere import NEAR, density_near, density_series, geometric, geopotential
from sepmc.physics.atmosphere import geopotential_rise, layer, sound_speed
from sepmc.physics.elementary import arctan2, exponential
from sepmc.physics.gravity import inverse_square, inverse_square_near
from sepmc.physics.propulsion import building_up, tail_off, thrust_arm, thrust_direction
from sepmc.physics.quat import SINE_SINGULAR
from sepmc.physics.us1976_table import R0, TOP
from sepmc.physics.vehicle import arm, flight_direction, inertia_tensor
from sepmc.physics.wind import wind
from sepmc.routines import between_nodes, crossings, curves, friction, linear, peaks
from sepmc.routines.arrays import Arrays, block, get_column, indices, put_columns, record, table
from sepmc.routines.arrays import vector
from sepmc.routines.clearances import load_outline, search_clearance
from sepmc.routines.lanes import LANES, get3, get4, get6, get9, put3, put4, put6, put9
from sepmc.routines.lanes import larger, largest3, largest4, nearest_turn, time_left
from sepmc.routines.layout import FULL_HISTORY, NO_HISTORY, Model
from sepmc.routines.screening import screen_motion, screen_parts
from sepmc.routines.splines import load_cell, in_cell
from sepmc.routines.load_intervals import next_load_switch, set_active_loads
'''


def emit(spec: KernelSpec, method_name: str, history: int = NO_HISTORY) -> str:
    """Write the kernel of a specification: the module that integrates the cases of a scene.

    Parameters
    ----------
    spec : KernelSpec
    method_name : str
        name of a Runge-Kutta method, or AUTO (`sepmc.kernel.spec.methods`): the kernel then has
        several methods for each segment, of which a run selects one
    history : int
        which rows over time the kernel can write: `NO_HISTORY`, `SEPARATION_HISTORY` (of joints; as
        `NO_HISTORY` in a scene without joints) or `FULL_HISTORY`

    Returns
    -------
    str
        source text of a Python module, whose entry is ``integrate_block``
    """
    context = Context(
        spec,
        method_name,
        history if spec.scene.joint or history == FULL_HISTORY else NO_HISTORY,
    )
    body = _body(context)  # first: the head lists the fields that it adds
    return "\n".join(_head(context).lines + body.lines) + "\n"


def _body(c: Context) -> Text:
    """Text of all functions of a kernel, each before those that call it; the fields of its
    workspace are added to the context."""
    _add_common_fields(c)
    body = Text()
    emit_rates(body, c)
    for segment in c.spec.segments:
        emit_friction(body, c, segment)
    for segment in c.spec.segments:
        emit_energy(body, c, segment)
        if segment.rows:
            emit_correct(body, c, segment)
        if segment.events:
            emit_cells(body, c, segment)
            emit_event_step(body, c, segment)
        if segment.pending_event:
            emit_pending_event(body, c, segment)
    if c.spec.layer_borders:
        emit_layers(body, c)
    for segment in c.spec.segments:
        emit_samples(body, c, segment)
    emit_modes(body, c)
    emit_load_switch(body, c)
    emit_recentre_air(body, c)
    emit_step_length(body, c)
    emit_finish_step(body, c)
    emit_indicators(body, c)
    for rk in c.used.values():
        emit_advance(body, c, rk)
    if any(segment.events for segment in c.spec.segments):
        emit_event_polish(body, c)
        emit_event_flags(body, c)
    emit_outcomes(body, c)
    with c.workspace.optional():
        _emit_optional(body, c)
    block = Text()
    # the entry comes last; the preparation of a case is known when everything else is written
    emit_block(block, c)
    emit_prepare(body, c)
    body.lines += block.lines
    return body


def _emit_optional(body: Text, c: Context) -> None:
    """Write the kernel functions that only some scenes, outputs or histories need: the continuous
    extension, minimum-norm multipliers for joint loads, the monitoring of joint loads, clearances
    and histories. They use states between the ends of steps."""
    if c.has_extension:
        emit_extension(body, c)
        for segment in filter(c.needs_wrenches, c.spec.segments):
            emit_min_norm(body, c, segment)
    emit_monitor(body, c)
    if c.spec.scene.clearance:
        emit_clearances(body, c)
    if c.history:
        emit_history(body, c)


def _add_common_fields(c: Context) -> None:
    """Add the workspace fields that every kernel has: of the state, steps, errors and stages."""
    # state; state of a stage and its derivative; step length, for each component of a state
    for name in ("Y", "S", "D", "STEP"):
        c.workspace.add(name, c.size)
    for name in (
        "T",
        "CLOCK",
        "END",
        "RUN_END",
        "DONE",
        "REJECTED",
        "MAX_NEXT_STEP",
        *INITIALLY_ZERO,
    ):
        c.workspace.add(name, 1)
    (
        c.workspace.add("EMBEDDED_ERROR", c.size),
        c.workspace.add("RESIDUAL", 4),
        c.workspace.add("RESIDUAL_NOW", 4),
    )
    with c.workspace.optional():
        c.workspace.add("INDICATORS", len(c.indicators))
        if c.may_idle:
            for name in (
                "MAX_STEP",
                "STEP_FACTOR",
                "STEPS_LEFT",
                "FIRST_STEP",
                "PROGRESS",
                "INACTIVE",
                "TYPICAL_END",
                "PIVOT_BEFORE",
            ):
                c.workspace.add(name, 1)
            c.workspace.add("STATE_BEFORE", c.size), c.workspace.add("ENERGY_BEFORE", 3)
        # in this order and without a gap
        most = max([rk.stages for rk in c.used.values()] + [len(c.extended.a)] * c.has_extension)
        for i in range(1, most + 1):
            c.workspace.add(f"K{i}", c.size)


def _head(c: Context) -> Text:
    """Text of the docstring, imports and constants of a kernel; all fields of its workspace must
    have been added before."""
    about = (
        "Not in it, because these scenes do not need it:\n" + ", ".join(features(c.spec)[1]) + "."
    )
    head = Text()
    head(*_HEADER.format(about=about).rstrip().split("\n"))
    if c.spec.scene.signal:
        head("from sepmc.physics import signals")
    for rk in c.used.values():
        head(
            "",
            f"# {rk.name}, order {rk.order}: stage matrix A, weights B, error weights E, nodes C; "
            "of its extension also D.",
            *coefficients(rk, c.has_extension and rk is c.extended),
        )
    if any(segment.events for segment in c.spec.segments) and "rk4" not in c.used:
        head("", "# rk4, for the last step to an event", *coefficients(method("rk4"), False))
    if c.history == SEPARATION_HISTORY:
        head("", "# Polynomials over a step, fitted to values at its ends and within.")
        head(
            *(
                f"CURVE_{name.upper()} = np.ascontiguousarray(method({name!r}).curve)"
                for name in c.used
            )
        )
    head("", "# Workspace fields of a block of cases, and offsets of bodies in a state.")
    head(
        *c.workspace.lines(),
        f"SIZE_SHARED, N_INDICATORS, N_SEGMENTS, N_CHANGES = {shared_size(c)}, "
        f"{len(c.indicators)}, {len(c.spec.segments)}, {len(c.change_times)}",
        f"METHODS = {tuple(tuple(rk.name for rk in c.methods(one)) for one in c.spec.segments)!r}",
        *_state_offsets(c.spec),
    )
    return head


def _state_offsets(spec: KernelSpec) -> list[str]:
    """Lines of code that define the offsets of quantities in a state vector, in this order:
    position and velocity of each body, the work of all loads, states of signals, attitude and
    angular rate of each body in the order `attitude_order`."""
    lines = [
        f"X_{body}, V_{body} = {6 * i} * LANES, {6 * i + 3} * LANES"
        for i, body in enumerate(spec.bodies)
    ]
    lines.append(f"WORK = {6 * len(spec.bodies)} * LANES")
    start = 6 * len(spec.bodies) + 1
    if spec.n_signal_states:
        lines.append(f"SIGNALS = {start} * LANES")
        start += spec.n_signal_states
    for i, body in enumerate(spec.attitude_order):
        lines.append(
            f"Q_{body}, OMEGA_{body} = {start + 7 * i} * LANES, {start + 7 * i + 4} * LANES"
        )
    return lines


def features(spec: KernelSpec) -> tuple[list[str], list[str]]:
    """List the features of a kernel in words, such as "gravity" or "friction of pins".

    Parameters
    ----------
    spec : KernelSpec

    Returns
    -------
    present, absent : list of str
        features that the kernel computes, and those that it leaves out because the scene does not
        need them; "relative motion" is listed only if present
    """
    scene = spec.scene
    air = scene.environment.atmosphere != "none" and any(
        body.aerodynamics for body in scene.body.values()
    )
    is_present = {
        "air and aerodynamics": air,
        "gravity": scene.environment.gravity != "none",
        "motors": bool(scene.motor),
        "springs": bool(scene.spring),
        "constant loads": bool(scene.load),
        "loads that switch on or off": spec.load_switches,
        "constraint rows": any(segment.rows for segment in spec.segments),
        "events on the state": any(segment.events for segment in spec.segments),
        "tip-off rates": bool(scene.output.tip_off),
        "transverse rates": bool(scene.output.transverse),
        "observation events": bool(scene.event),
        "aerodynamic tables": any(looks_up(spec, body) for body in spec.bodies),
        "wind or air over height": has_tables_over_height(spec),
        "friction of pins": any(spec.friction_joints(segment) for segment in spec.segments),
        "joint loads": bool(scene.output.loads),
        "pin loads": bool(scene.output.guide),
        "clearances": bool(scene.clearance),
    }
    if scene.output.hinge or scene.output.relative:
        is_present["relative motion"] = True
    return [name for name, present in is_present.items() if present], [
        name for name, present in is_present.items() if not present
    ]
