"""Writes the kernel of one scene: a readable Python module that calls the physics this scene needs,
in order, and nothing else.

The module flies LANES cases side by side. Sizes and places are constants in it, masses and
coefficients are data: scenes of the same shape share it. `sepmc check --code` prints it.
"""

from sepmc.kernel.emit.block import emit_block, emit_switch
from sepmc.kernel.emit.clearances import emit_clearances
from sepmc.kernel.emit.context import Context
from sepmc.kernel.emit.energy import emit_energy
from sepmc.kernel.emit.events import emit_aim, emit_await, emit_meet
from sepmc.kernel.emit.extension import emit_extension
from sepmc.kernel.emit.guides import emit_rub
from sepmc.kernel.emit.history import emit_history
from sepmc.kernel.emit.loads import emit_centre, emit_layers
from sepmc.kernel.emit.monitor import emit_watch
from sepmc.kernel.emit.motion import emit_correct
from sepmc.kernel.emit.outcomes import emit_report
from sepmc.kernel.emit.rates import emit_rates
from sepmc.kernel.emit.start import ZERO_AT_FIRST, emit_prepare, shared_size
from sepmc.kernel.emit.steps import (
    coefficients,
    emit_advance,
    emit_approach,
    emit_guard,
    emit_lengths,
    emit_settle,
)
from sepmc.kernel.emit.tables import has_tables_over_height, looks_up
from sepmc.kernel.emit.wrenches import emit_shares
from sepmc.kernel.spec.kernel_spec import Shape
from sepmc.kernel.spec.methods import method
from sepmc.kernel.tracer.text import Text
from sepmc.routines.layout import FULL_HISTORY, NO_HISTORY, SEPARATION_HISTORY

_HEADER = '''"""Flight of a scene.

Written by sepmc for scenes of this shape; not edited by hand. {about}
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
from sepmc.routines import curves, friction, linear, peaks
from sepmc.routines.arrays import Arrays, block, get_column, indices, put_columns, record, table
from sepmc.routines.arrays import vector
from sepmc.routines.clearances import load_outline, search_clearance
from sepmc.routines.lanes import LANES, get3, get4, get6, put3, put4, put6
from sepmc.routines.lanes import larger, largest3, largest4, nearest_turn, time_left
from sepmc.routines.layout import FULL_HISTORY, NO_HISTORY, Model
from sepmc.routines.splines import load_cell, in_cell
from sepmc.routines.load_intervals import next_load_switch, set_active_loads
'''


def emit(shape: Shape, method_name: str, history: int = NO_HISTORY) -> str:
    """Text of the module that flies scenes of a shape with a Runge-Kutta method, or the methods
    that AUTO (`sepmc.kernel.spec.methods`) has for each phase; ``history`` is
    what it also writes over time: nothing, separations (`SEPARATION_HISTORY`), or all there is to
    know (`FULL_HISTORY`)."""
    context = Context(
        shape,
        method_name,
        history if shape.scene.joint or history == FULL_HISTORY else NO_HISTORY,
    )
    body = _body(context)  # first: the head names all slabs that its parts add
    return "\n".join(_head(context).lines + body.lines) + "\n"


def _body(c: Context) -> Text:
    """All functions of a module."""
    _first_slabs(c)
    body = Text()
    emit_rates(body, c)
    for stage in c.shape.stages:
        emit_rub(body, c, stage)
    for stage in c.shape.stages:
        emit_energy(body, c, stage)
        if stage.rows:
            emit_correct(body, c, stage)
        if stage.events:
            emit_aim(body, c, stage)
        if stage.awaited:
            emit_await(body, c, stage)
    if c.shape.borders:
        emit_layers(body, c)
    emit_switch(body, c)
    emit_centre(body, c)
    emit_lengths(body, c)
    emit_settle(body, c)
    emit_guard(body, c)
    for rk in c.used.values():
        emit_advance(body, c, rk)
    if any(stage.events for stage in c.shape.stages):
        emit_approach(body, c)
        emit_meet(body, c)
    emit_report(body, c)
    with c.slabs.optional():
        _optional(body, c)
    block = Text()
    # it is entered, so it stands last; what comes before a flight is known when all else is written
    emit_block(block, c)
    emit_prepare(body, c)
    body.lines += block.lines
    return body


def _optional(body: Text, c: Context) -> None:
    """Functions for what happens between the ends of steps."""
    if c.extends:
        emit_extension(body, c)
        for stage in filter(c.carries, c.shape.stages):
            emit_shares(body, c, stage)
    emit_watch(body, c)
    if c.shape.scene.clearance:
        emit_clearances(body, c)
    if c.history:
        emit_history(body, c)


def _first_slabs(c: Context) -> None:
    """Slabs that every module has."""
    # state; state of a stage, its derivative; length of the step, for every number of a state
    for name in ("Y", "S", "D", "STEP"):
        c.slabs.add(name, c.size)
    for name in ("T", "CLOCK", "END", "RUN_END", "DONE", "LOST", "LONGEST", *ZERO_AT_FIRST):
        c.slabs.add(name, 1)
    c.slabs.add("DOUBT", c.size), c.slabs.add("RESIDUAL", 4), c.slabs.add("RESIDUAL_NOW", 4)
    with c.slabs.optional():
        c.slabs.add("GUARD", len(c.guards))
        if c.idles:
            for name in (
                "PACE",
                "TIMES",
                "LEFT",
                "FIRST",
                "WAY",
                "HELD_BACK",
                "USUALLY",
                "PIVOT_BEFORE",
            ):
                c.slabs.add(name, 1)
            c.slabs.add("BEFORE", c.size), c.slabs.add("ENERGY_BEFORE", 3)
        # in this order and without a gap
        most = max([rk.stages for rk in c.used.values()] + [len(c.extended.a)] * c.extends)
        for i in range(1, most + 1):
            c.slabs.add(f"K{i}", c.size)


def _head(c: Context) -> Text:
    """Docstring, imports and constants of a module."""
    about = (
        "Not in it, because these scenes do not need it:\n" + ", ".join(features(c.shape)[1]) + "."
    )
    head = Text()
    head(*_HEADER.format(about=about).rstrip().split("\n"))
    for rk in c.used.values():
        head(
            "",
            f"# {rk.name}, order {rk.order}: row i of the stage matrix, weights, doubt, nodes.",
            *coefficients(rk, c.extends and rk is c.extended),
        )
    if any(stage.events for stage in c.shape.stages) and "rk4" not in c.used:
        head("", "# rk4, for the last of the way to an event", *coefficients(method("rk4"), False))
    if c.history == SEPARATION_HISTORY:
        head("", "# Curves over a step, from what is so at its ends and within.")
        head(
            *(
                f"CURVE_{name.upper()} = np.ascontiguousarray(method({name!r}).curve)"
                for name in c.used
            )
        )
    if c.extends:
        head("# Continuous extension: coefficients by powers of the share of a step.")
        head(f"DENSE = np.ascontiguousarray(method({c.extended.name!r}).dense.T)")
    head("", "# Slabs of the workspace of a block of cases, and the places of bodies in a state.")
    head(
        *c.slabs.lines(),
        f"SIZE_SHARED, GUARDS, STAGES, CHANGES = {shared_size(c)}, {len(c.guards)}, "
        f"{len(c.shape.stages)}, {len(c.sudden)}",
        f"METHODS = {tuple(tuple(rk.name for rk in c.methods(one)) for one in c.shape.stages)!r}",
        *_places(c.shape),
    )
    return head


def _places(shape: Shape) -> list[str]:
    """Where places and speeds, then the work of all loads, attitudes and rates stand in a state."""
    lines = [
        f"X_{body}, V_{body} = {6 * i} * LANES, {6 * i + 3} * LANES"
        for i, body in enumerate(shape.bodies)
    ]
    lines.append(f"WORK = {6 * len(shape.bodies)} * LANES")
    start = 6 * len(shape.bodies) + 1
    for i, body in enumerate(shape.turning):
        lines.append(
            f"Q_{body}, OMEGA_{body} = {start + 7 * i} * LANES, {start + 7 * i + 4} * LANES"
        )
    return lines


def features(shape: Shape) -> tuple[list[str], list[str]]:
    """What the kernel of a shape computes, and what it could but does not, because no scene of the
    shape needs it."""
    scene = shape.scene
    air = scene.environment.atmosphere != "none" and any(
        body.aerodynamics for body in scene.body.values()
    )
    parts = {
        "air and aerodynamics": air,
        "gravity": scene.environment.gravity != "none",
        "motors": bool(scene.motor),
        "springs": bool(scene.spring),
        "constant loads": bool(scene.load),
        "loads that switch on or off": shape.switches,
        "constraint rows": any(stage.rows for stage in shape.stages),
        "events on the state": any(stage.events for stage in shape.stages),
        "rates at release": bool(scene.output.tip_off),
        "transverse rates": bool(scene.output.transverse),
        "events that are told of": bool(scene.event),
        "aerodynamic tables": any(looks_up(shape, body) for body in shape.bodies),
        "wind or air over height": has_tables_over_height(shape),
        "friction of pins": any(shape.rubbing(stage) for stage in shape.stages),
        "joint loads": bool(scene.output.loads),
        "pin loads": bool(scene.output.guide),
        "clearances": bool(scene.clearance),
    }
    return [name for name, there in parts.items() if there], [
        name for name, there in parts.items() if not there
    ]
