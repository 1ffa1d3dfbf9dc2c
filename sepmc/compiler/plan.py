"""A scene as the arrays a kernel reads: its structure (`Model`), its nominal numbers, and the place of each number."""

import math
from dataclasses import dataclass

import numpy as np

from sepmc.kernels import layout as at
from sepmc.kernels.methods import method
from sepmc.scene.model import Scene
from sepmc.scene.parameters import value

_ATMOSPHERE = {"none": at.NO_ATMOSPHERE, "us1976": at.US1976}
_GRAVITY = {"none": at.NO_GRAVITY, "constant": at.CONSTANT_GRAVITY, "inverse-square": at.INVERSE_SQUARE}
_FORMULATION = {"reduced": at.REDUCED, "full": at.FULL}
_COEFFICIENTS = {"axial": at.AXIAL, "normal": at.NORMAL, "side": at.SIDE, "roll": at.ROLLING, "yaw": at.YAWING, "pitch": at.PITCHING}
# Constrained axes of a joint: translations x y z, rotations x y z. 1 marks an axis along or about which it holds.
JOINT_ROWS = {"fixed": (1, 1, 1, 1, 1, 1), "slider": (0, 1, 1, 1, 1, 1), "free": (0, 0, 0, 0, 0, 0)}

_HEAD = {
    "environment.surface_gravity": at.SURFACE_GRAVITY,
    "environment.wind.speed": at.WIND_SPEED,
    "environment.wind.direction": at.WIND_DIRECTION,
    "initial.altitude": at.ALTITUDE,
    "initial.speed": at.SPEED,
    "initial.omega.x": at.OMEGA,
    "initial.omega.y": at.OMEGA + 1,
    "initial.omega.z": at.OMEGA + 2,
    "initial.alpha": at.ALPHA,
    "initial.pitch": at.PITCH,
    "initial.yaw": at.YAW,
    "initial.roll": at.ROLL,
    "initial.path_yaw": at.PATH_YAW,
    "run.end_time": at.END_TIME,
}
_BODY = {
    "mass": at.MASS,
    "inertia.xx": at.INERTIA,
    "inertia.yy": at.INERTIA + 1,
    "inertia.zz": at.INERTIA + 2,
    "inertia_products.xy": at.PRODUCTS,
    "inertia_products.xz": at.PRODUCTS + 1,
    "inertia_products.yz": at.PRODUCTS + 2,
    "inertia_factor": at.INERTIA_FACTOR,
    "cg.x": at.CG,
    "cg.y": at.CG + 1,
    "cg.z": at.CG + 2,
}
_AERO = {
    "reference_area": at.AREA,
    "reference_length": at.LENGTH,
    "force_factor": at.FORCE_FACTOR,
    "moment_factor": at.MOMENT_FACTOR,
}
_MOTOR = {
    "thrust": at.THRUST,
    "build_up": at.BUILD_UP,
    "ignition": at.IGNITION,
    "burn": at.BURN,
    "station": at.STATION,
    "radius": at.RADIUS,
    "cant": at.CANT,
    "clock": at.CLOCK,
    "offset.y": at.OFFSET,
    "offset.z": at.OFFSET + 1,
    "deflection": at.DEFLECTION,
    "deflection_clock": at.DEFLECTION_CLOCK,
}


@dataclass(frozen=True)
class Plan:
    """What a kernel needs to fly a scene.

    ``slots`` maps each parameter path to its place in the vector ``nominal`` (p,), which is in SI.
    """

    scene: Scene
    model: at.Model
    tableau: at.Tableau
    nominal: np.ndarray
    slots: dict[str, int]
    bodies: list[str]
    joints: dict[str, tuple[str, str]]
    phases: list[str]

    @property
    def lines(self) -> list[str]:
        """What the plan contains, for ``sepmc check``."""
        m = self.model
        rows = [sum(sum(JOINT_ROWS[kind]) for kind in phase.joints.values()) for phase in self.scene.phase]
        found = [
            f"bodies       {len(self.bodies)}: {', '.join(self.bodies)}",
            f"joints       {len(self.joints)}: " + (", ".join(f"{j} ({a} - {b})" for j, (a, b) in self.joints.items()) or "none"),
            f"motors       {m.n_motors}: " + (", ".join(motor.name for motor in self.scene.motor) or "none"),
            f"atmosphere   {self.scene.environment.atmosphere}, {m.n_terms} aerodynamic terms",
            f"gravity      {self.scene.environment.gravity}",
            f"solver       {self.scene.solver.formulation}, {self.scene.solver.method}, step {self.scene.solver.step:g} s",
        ]
        for phase, count in zip(self.scene.phase, rows, strict=True):
            until = phase.until
            if until is None:
                ends = f"{self.scene.run.end_time:g} s"
            else:
                parts = [f"{until.time:g} s"] if until.time is not None else []
                parts += [f"{until.joint} at {1e3 * until.stroke:g} mm"] if until.stroke is not None else []
                ends = " or ".join(parts)
            found.append(f"phase        {phase.name}: {count} constraint rows, until {ends}")
        return found


def make_plan(scene: Scene, history_step: float | None = None) -> Plan:
    """Pack a scene. ``history_step`` (s) overrides the one of ``run``."""
    bodies, joints = list(scene.body), list(scene.joint)
    motors_at = at.HEAD + at.BODY_SIZE * len(bodies)
    joints_at = motors_at + at.MOTOR_SIZE * len(scene.motor)
    phases_at = joints_at + at.JOINT_SIZE * len(joints)
    terms_at = phases_at + at.PHASE_SIZE * len(scene.phase)

    slots = dict(_HEAD)
    for b, name in enumerate(bodies):
        start = at.HEAD + at.BODY_SIZE * b
        slots |= {f"body.{name}.{key}": start + offset for key, offset in _BODY.items()}
        aero = scene.body[name].aerodynamics
        if aero is not None:
            slots |= {f"body.{name}.aerodynamics.{key}": start + offset for key, offset in _AERO.items()}
            if aero.moment_point is not None:
                slots |= {f"body.{name}.aerodynamics.moment_point.{axis}": start + at.MOMENT_POINT + i for i, axis in enumerate("xyz")}
    for m, motor in enumerate(scene.motor):
        slots |= {f"motor.{motor.name}.{key}": motors_at + at.MOTOR_SIZE * m + offset for key, offset in _MOTOR.items()}
    for j, name in enumerate(joints):
        slots |= {f"joint.{name}.point.{axis}": joints_at + at.JOINT_SIZE * j + i for i, axis in enumerate("xyz")}
    terms, paths = _aero_terms(scene)
    slots |= {path: terms_at + k for k, path in enumerate(paths)}

    nominal = np.zeros(terms_at + len(terms))
    nominal[phases_at:terms_at] = math.inf
    for p, phase in enumerate(scene.phase):
        start = phases_at + at.PHASE_SIZE * p
        if phase.until is not None and phase.until.time is not None:
            slots[f"phase.{phase.name}.until.time"] = start + at.UNTIL_TIME
        if phase.until is not None and phase.until.stroke is not None:
            slots[f"phase.{phase.name}.until.stroke"] = start + at.UNTIL_STROKE
    for b in range(len(bodies)):
        nominal[at.HEAD + at.BODY_SIZE * b + at.MOMENT_POINT] = math.nan
    for path, slot in slots.items():
        nominal[slot] = value(scene, path)
    reference = scene.initial.path_reference
    nominal[at.PATH_REFERENCE] = scene.initial.pitch - scene.initial.alpha if reference is None else reference

    model = _model(scene, (motors_at, joints_at, phases_at, terms_at), terms, len(nominal))
    rk = method(scene.solver.method)
    history = scene.run.history_step if history_step is None else history_step
    tableau = at.Tableau(rk.a, rk.b, rk.c, rk.dense, scene.solver.step, history)
    pairs = {j: scene.joint[j].bodies for j in joints}
    return Plan(scene, model, tableau, nominal, slots, bodies, pairs, [phase.name for phase in scene.phase])


def _model(scene: Scene, starts: tuple[int, int, int, int], terms: np.ndarray, size_p: int) -> at.Model:
    """The scene's structure, and the layout of a case's array: parameters first, then scratch."""
    bodies, joints = list(scene.body), list(scene.joint)
    unknowns = 6 * len(bodies) + 12 * len(joints)
    tables = {
        "motor_body_i": [bodies.index(motor.body) for motor in scene.motor],
        "joint_bodies_i": [bodies.index(b) for j in joints for b in scene.joint[j].bodies],
        "phase_rows_i": [flag for phase in scene.phase for j in joints for flag in JOINT_ROWS[phase.joints.get(j, "free")]],
        "all_axes_i": [1] * (6 * len(joints)),
        "phase_event_i": [joints.index(p.until.joint) if p.until and p.until.joint else -1 for p in scene.phase],
        "terms_i": terms.ravel().tolist(),
    }
    lengths = [len(table) for table in tables.values()]
    table_starts = dict(zip(tables, np.cumsum([0, *lengths[:-1]]).tolist(), strict=True))
    motors_w = size_p + at.WORK_HEAD + at.BODY_WORK * len(bodies)
    joints_w = motors_w + at.MOTOR_WORK * len(scene.motor)
    rows_w = joints_w + at.JOINT_WORK * len(joints)
    matrix_w = rows_w + at.ROW_WORK * 6 * len(joints)
    rhs_w = matrix_w + unknowns**2
    return at.Model(
        n_bodies=len(bodies),
        n_motors=len(scene.motor),
        n_joints=len(joints),
        n_phases=len(scene.phase),
        n_terms=len(terms),
        atmosphere=_ATMOSPHERE[scene.environment.atmosphere],
        gravity=_GRAVITY[scene.environment.gravity],
        formulation=_FORMULATION[scene.solver.formulation],
        motors_p=starts[0],
        joints_p=starts[1],
        phases_p=starts[2],
        terms_p=starts[3],
        work=size_p,
        motors_w=motors_w,
        joints_w=joints_w,
        rows_w=rows_w,
        matrix_w=matrix_w,
        rhs_w=rhs_w,
        size_w=rhs_w + unknowns,
        **table_starts,
        table=np.array([x for table in tables.values() for x in table], dtype=np.int64),
        numbers=np.array([x for j in joints for x in (*_axes(scene.joint[j].x_axis, scene.joint[j].y_axis), apart(scene, j))], dtype=float),
    )


def _aero_terms(scene: Scene) -> tuple[np.ndarray, list[str]]:
    terms, paths = [], []
    for b, (name, body) in enumerate(scene.body.items()):
        for coefficient, code in _COEFFICIENTS.items():
            for term in getattr(body.aerodynamics, coefficient) if body.aerodynamics else ():
                terms.append((b, code, _power(term, "alpha"), _power(term, "beta")))
                paths.append(f"body.{name}.aerodynamics.{coefficient}.{term}")
    return np.array(terms, dtype=np.int64).reshape(-1, 4), paths


def _power(term: str, angle: str) -> int:
    """Power of ``angle`` in a term such as ``alpha2_beta``."""
    for factor in term.split("_"):
        if factor.startswith(angle):
            return int(factor[len(angle) :] or 1)
    return 0


def _axes(x_axis: tuple[float, ...], y_axis: tuple[float, ...]) -> np.ndarray:
    """Right-handed orthonormal axes (rows) from an x axis and a vector near the y axis."""
    x = np.array(x_axis) / np.linalg.norm(x_axis)
    y = np.array(y_axis) - x * (x @ np.array(y_axis))
    y /= np.linalg.norm(y)
    return np.concatenate([x, y, np.cross(x, y)])


def apart(scene: Scene, name: str) -> int:
    """Sign that makes the separation positive when the second body moves away from the first along the joint's x axis."""
    joint = scene.joint[name]
    if joint.apart is not None:
        return joint.apart
    first, second = (scene.body[b].cg for b in joint.bodies)
    x = _axes(joint.x_axis, joint.y_axis)[:3]
    toward_second = (first[0] - second[0]) * x[0] + (second[1] - first[1]) * x[1] + (second[2] - first[2]) * x[2]
    return 1 if toward_second >= 0.0 else -1
