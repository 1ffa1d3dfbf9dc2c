"""Loads as a compiled callback of MuJoCo, called at every stage of a step: state-dependent air,
wind, weight and thrust.

MuJoCo has no such loads. Its batches run on C++ threads and call physics callbacks only if they are
C functions, so this is one, compiled by Numba; a Python callback would cost a hundred times the
step. It reads ``mjData`` at the found positions of its arrays, and a case's numbers from
``userdata``, and sets ``xfrc_applied``: force and moment at each mass centre, world axes.
"""

import ctypes
import math
from typing import Any

import mujoco
import numba
import numpy as np
from numba import types
from numba.extending import intrinsic

from oracles.engine_race.air import atmosphere
from oracles.engine_race.inputs import Inputs
from oracles.engine_race.vectors import Array
from oracles.external_engines import loads

LOCKED, GUIDED, FREE = 0, 1, 2
# numbers in userdata: phase, altitude, climb, gravity, air x y z; per body mass, force, moment
# scale, thrust (6)
CASE, BODY = 7, 9
SIZE = CASE + 2 * BODY
FIELDS = ("qvel", "xfrc_applied", "xipos", "xmat", "userdata")
STEPS_OUT = 100_000  # words of mjData among which its pointers are looked for


_INERTIAL = '<inertial pos="0 0 0" mass="1" diaginertia="1 1 1"/>'


def scene(phase: int, step: float = 1e-3) -> str:
    """Model of a phase: the first body free, the second welded to it, sliding in it, or free
    too."""
    slide, free = '<joint type="slide" axis="1 0 0"/>', "<freejoint/>"
    inner = {
        LOCKED: f"<body>{_INERTIAL}</body>",
        GUIDED: f"<body>{slide}{_INERTIAL}</body>",
        FREE: "",
    }[phase]
    outer = f"<body>{free}{_INERTIAL}</body>" if phase == FREE else ""
    flags = '<flag contact="disable" constraint="disable"/>'
    option = f'<option integrator="RK4" timestep="{step}" gravity="0 0 0">{flags}</option>'
    world = f"<worldbody><body>{free}{_INERTIAL}{inner}</body>{outer}</worldbody>"
    return f"<mujoco>{option}<size nuserdata='{SIZE}'/>{world}</mujoco>"


def places(data: Any) -> dict[str, int]:
    """Positions in ``mjData`` of the pointers of `FIELDS` and of the time, in words of eight
    bytes."""
    wanted = {getattr(data, name).ctypes.data: name for name in FIELDS}
    offsets: dict[str, int] = {}
    kept, data.time = data.time, 0.123456789
    for word in range(STEPS_OUT):
        at = data._address + 8 * word
        name = wanted.get(ctypes.c_uint64.from_address(at).value)
        if name is not None:
            offsets.setdefault(name, word)
        elif "time" not in offsets and ctypes.c_double.from_address(at).value == data.time:
            offsets["time"] = word
        if len(offsets) == len(FIELDS) + 1:
            break
    data.time = kept
    return offsets


def userdata(inputs: Inputs) -> Array:
    """Numbers of every case, (n, `SIZE`); the phase is left zero."""
    air = inputs.velocity - inputs.wind
    gravity = inputs.surface_gravity * loads.EARTH_RADIUS**2
    head = np.column_stack(
        [np.zeros(inputs.count), inputs.altitude, inputs.velocity[:, 1], gravity, air]
    )
    parts = [head]
    for body in inputs.bodies:
        scale = 0.5 * inputs.density_factor * body.area
        parts.append(
            np.column_stack(
                [
                    body.mass,
                    scale * body.force_factor,
                    scale * body.length * body.moment_factor,
                    body.thrust,
                ]
            )
        )
    return np.concatenate(parts, axis=1)


def callback(inputs: Inputs) -> Any:
    """Compiled callback; keep a reference as long as MuJoCo may call it."""
    where = places(mujoco.MjData(mujoco.MjModel.from_xml_string(scene(FREE))))
    base, one, by_closeness, power = atmosphere(inputs)
    radius = loads.EARTH_RADIUS
    first, second = (_polynomials(body.coefficients()) for body in inputs.bodies)
    QVEL, FORCE, XIPOS, XMAT, USER, TIME = (where[name] for name in (*FIELDS, "time"))
    build_up = inputs.build_up

    @numba.njit(error_model="numpy")
    def into(R, m, x, y, z):
        """R^T (x, y, z), with R in nine numbers from R[m] on."""
        return (
            R[m] * x + R[m + 3] * y + R[m + 6] * z,
            R[m + 1] * x + R[m + 4] * y + R[m + 7] * z,
            R[m + 2] * x + R[m + 5] * y + R[m + 8] * z,
        )

    @numba.njit(error_model="numpy")
    def load(polynomials, R, m, height, v, user, k, level, force, out):
        """Loads of one body that moves through the air with v (body axes), into force[out:]; its
        numbers begin at user[k]."""
        u, side, w = v
        flat = u * u + side * side
        closeness = 1.0 / (radius + height)
        q = base * (one + by_closeness * closeness) ** power * (flat + w * w)
        ca, cn, cy, cl, cyaw, cm = polynomials(math.atan2(-side, u), math.atan2(w, math.sqrt(flat)))
        qf, qm = q * user[k + 1], q * user[k + 2]
        fx, fy, fz = (
            level * user[k + 3] - qf * ca,
            level * user[k + 4] + qf * cn,
            level * user[k + 5] - qf * cy,
        )
        mx, my, mz = (
            level * user[k + 6] + qm * cl,
            level * user[k + 7] - qm * cyaw,
            level * user[k + 8] + qm * cm,
        )
        for i in range(3):
            row = m + 3 * i
            force[out + i] = R[row] * fx + R[row + 1] * fy + R[row + 2] * fz
            force[out + 3 + i] = R[row] * mx + R[row + 1] * my + R[row + 2] * mz
        force[out + 1] -= user[k] * user[3] * closeness * closeness

    pointer = types.CPointer(types.float64)

    @numba.cfunc(types.void(types.voidptr, types.CPointer(pointer)), error_model="numpy")
    def apply(_, fields):
        qvel, force, place, R, user = (
            fields[QVEL],
            fields[FORCE],
            fields[XIPOS],
            fields[XMAT],
            fields[USER],
        )
        t = _carray(_numbers(fields), (TIME + 1,), numba.float64)[TIME]
        level, rise, phase = 1.0 - math.exp(-t / build_up), user[1] + user[2] * t, user[0]
        u, v, w = into(R, 9, qvel[0] + user[4], qvel[1] + user[5], qvel[2] + user[6])
        load(first, R, 9, rise + place[4], (u, v, w), user, CASE, level, force, 6)
        if phase == FREE:
            u, v, w = into(R, 18, qvel[6] + user[4], qvel[7] + user[5], qvel[8] + user[6])
        else:
            x, y, z = into(R, 9, place[6] - place[3], place[7] - place[4], place[8] - place[5])
            p, q, r = qvel[3], qvel[4], qvel[5]
            u, v, w = u + q * z - r * y, v + r * x - p * z, w + p * y - q * x
            if phase == GUIDED:
                u += qvel[6]
        load(second, R, 18, rise + place[7], (u, v, w), user, CASE + BODY, level, force, 12)

    return apply


def _untyped(context, fields):
    """The same memory without a type."""

    def generate(context, builder, signature, arguments):
        return builder.bitcast(arguments[0], context.get_value_type(types.voidptr))

    return types.voidptr(fields), generate


_numbers: Any = intrinsic(_untyped)
_carray: Any = numba.carray


def _polynomials(table: Array) -> Any:
    """The six coefficients over alpha and beta."""
    rows = tuple(tuple(row) for row in table)

    @numba.njit(error_model="numpy")
    def row(c, a, b):
        of_alpha = c[0] + a * (c[1] + a * (c[2] + a * (c[3] + a * (c[4] + a * c[5]))))
        return of_alpha + b * (c[6] + b * (c[7] + b * (c[8] + b * (c[9] + b * c[10]))))

    @numba.njit(error_model="numpy")
    def coefficients(a, b):
        return (
            row(rows[0], a, b),
            row(rows[1], a, b),
            row(rows[2], a, b),
            row(rows[3], a, b),
            row(rows[4], a, b),
            row(rows[5], a, b),
        )

    return coefficients
