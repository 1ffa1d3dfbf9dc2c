"""Parameter vector of a case: the index and nominal value of every parameter of a scene, and the
structure record (`sepmc.routines.layout.Model`) that compiled routines read."""

import math
from collections.abc import Sequence
from dataclasses import dataclass, field

import numpy as np

from sepmc.kernel.spec import packing
from sepmc.kernel.spec.conditions import Conditions, make_conditions
from sepmc.kernel.spec.packing import Pool
from sepmc.kernel.spec.step_cells import has_unloading, unloading_path
from sepmc.routines import layout as at
from sepmc.scene.contents import contents
from sepmc.scene.kinds import axial_offset, joint_axes, mass_centres
from sepmc.scene.model import GROUND, XYZ, Scene, Signal
from sepmc.scene.parameters import item_names, value
from sepmc.schema import Contents

WIND_FACTOR, WIND_TURN = "environment.wind.profile.factor", "environment.wind.profile.turn"
_LEVEL = 1e-12  # m, or relative to the coordinates: closer mass centres are level with each other


def _vector(key: str, start: int, names: tuple[str, ...] = XYZ) -> dict[str, int]:
    """Consecutive indices from ``start`` on by ``key.name`` for each of the component names."""
    return {f"{key}.{name}": start + i for i, name in enumerate(names)}


_HEAD = {
    "environment.surface_gravity": at.SURFACE_GRAVITY,
    "environment.wind.speed": at.WIND_SPEED,
    "environment.wind.direction": at.WIND_DIRECTION,
    "environment.density_factor": at.DENSITY_FACTOR,
    "initial.altitude": at.ALTITUDE,
    "initial.speed": at.SPEED,
    **_vector("initial.omega", at.OMEGA),
    "initial.alpha": at.ALPHA,
    "initial.pitch": at.PITCH,
    "initial.yaw": at.YAW,
    "initial.roll": at.ROLL,
    "initial.path_yaw": at.PATH_YAW,
    "run.end_time": at.END_TIME,
}
_BODY = {
    "mass": at.MASS,
    **_vector("inertia", at.INERTIA, ("xx", "yy", "zz")),
    **_vector("inertia_products", at.PRODUCTS, ("xy", "xz", "yz")),
    "inertia_factor": at.INERTIA_FACTOR,
    **_vector("cg", at.CG),
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
    "delay": at.IGNITION_DELAY,
    "burn": at.BURN,
    "tail_off": at.TAIL_OFF,
    "station": at.STATION,
    "radius": at.RADIUS,
    "cant": at.CANT,
    "clock": at.CLOCK,
    **_vector("offset", at.OFFSET, ("y", "z")),
    "deflection": at.DEFLECTION,
    "deflection_clock": at.DEFLECTION_CLOCK,
}
_JOINT = {
    **_vector("point", at.POINT),
    **_vector("omega", at.SWING),
    "delay": at.DELAY,
    "fails": at.FAILS,
}
_GUIDE = {
    "circle": at.CIRCLE,
    "clock": at.PIN_CLOCK,
    "engaged": at.ENGAGED,
    "friction": at.FRICTION,
    "slip_speed": at.SLIP_SPEED,
}
_SPRING = {
    **_vector("point", at.POINT),
    "force": at.SPRING_FORCE,
    "stiffness": at.STIFFNESS,
    "damping": at.DAMPING,
    "stroke": at.STROKE,
    "factor": at.SPRING_FACTOR,
}
_LOAD = {
    **_vector("force", at.LOAD_FORCE),
    **_vector("moment", at.LOAD_MOMENT),
    "start": at.LOAD_START,
    "end": at.LOAD_END,
}


@dataclass(frozen=True)
class ParameterLayout:
    """Parameter vector of a scene: nominal values, and the index of every parameter.

    ``nominal``, shape (p,), has the nominal values, SI; ``slots`` maps each parameter path
    (``body.upper.mass``) to its index in ``nominal``. ``model`` has the starts of the parameter
    blocks of bodies, motors, ..., and the numbers that all cases share. ``bodies`` are the names of
    the moving bodies, ``joints`` the two bodies of each joint, ``phases`` the names of the phases;
    ``contents`` names the parts of the scene that have outcome columns. ``outlines`` maps each body
    with a dispersed outline to the index in ``nominal`` of its first part (layout.PART_SIZE numbers
    per part). ``extremes`` are two scenes, with all dispersed parameters at their minimum and at
    their maximum; empty if not known. All names are those of the items of ``scene``: generated ones
    in the layout of a `KernelSpec`, else those of the file.
    """

    scene: Scene
    model: at.Model
    nominal: np.ndarray
    slots: dict[str, int]
    bodies: list[str]
    joints: dict[str, tuple[str, str]]
    phases: list[str]
    contents: Contents
    outlines: dict[str, int] = field(default_factory=dict)
    extremes: tuple[Scene, ...] = ()


def make_parameter_layout(scene: Scene, dispersed: frozenset[str] = frozenset()) -> ParameterLayout:
    """Lay out the parameters of a scene.

    Parameters
    ----------
    scene : Scene
    dispersed : frozenset of str
        paths of dispersed parameters; some quantities, such as axes and outlines, are parameters
        only if they are dispersed, else numbers that all cases share

    Returns
    -------
    ParameterLayout
    """
    conditions = make_conditions(scene, dispersed)
    order = body_order(scene)
    slots, nominal, starts = _parameters(scene, order, conditions)
    varied, outlines, numbers = _varied(scene, dispersed, len(nominal))
    slots, nominal = slots | varied, np.append(nominal, numbers)
    for path, slot in slots.items():
        nominal[slot] = value(scene, path)
    reference = scene.initial.path_reference
    nominal[at.PATH_REFERENCE] = (
        scene.initial.pitch - scene.initial.alpha if reference is None else reference
    )
    for i, motor in enumerate(scene.motor):
        if motor.profile is not None and math.isinf(motor.burn):
            nominal[starts["motors_p"] + at.MOTOR_SIZE * i + at.BURN] = motor.profile.time[-1]
    model = _model(scene, order, starts, len(nominal), WIND_FACTOR in slots, dispersed)
    pairs = {j: joint.bodies for j, joint in scene.joint.items()}
    return ParameterLayout(
        scene,
        model,
        nominal,
        slots,
        list(scene.body),
        pairs,
        [phase.name for phase in scene.phase],
        contents(scene, dispersed),
        outlines,
    )


def body_order(scene: Scene) -> list[str]:
    """Names of the bodies in the order in which their parameter blocks are stored: moving bodies,
    then the ground if a joint or spring connects to it."""
    return [*scene.body, GROUND] if is_ground_named(scene) else list(scene.body)


def is_ground_named(scene: Scene) -> bool:
    """True if a joint or a spring connects a body to the ground."""
    pairs = [j.bodies for j in scene.joint.values()] + [s.bodies for s in scene.spring]
    return any(GROUND in bodies for bodies in pairs)


def _parameters(
    scene: Scene, order: list[str], conditions: Conditions
) -> tuple[dict[str, int], np.ndarray, dict[str, int]]:
    """Lay out the blocks of the parameter vector of a case; `_varied` adds what follows the blocks.

    ``order`` has the names of the bodies in the order of their blocks (`body_order`);
    ``conditions`` are all those of the scene, whose thresholds are parameters. Returns the
    index of each parameter in the vector, by its path; the vector of these blocks, still without
    values: 0, but NaN for points that default to another point; and the index of the first
    parameter of each block, by its name in `sepmc.routines.layout.STRUCTURE`.
    """
    sizes = {
        "motors_p": at.MOTOR_SIZE * len(scene.motor),
        "joints_p": at.JOINT_SIZE * len(scene.joint),
        "springs_p": at.SPRING_SIZE * len(scene.spring),
        "loads_p": at.LOAD_SIZE * len(scene.load),
        "leaves_p": len(conditions.leaves),
        "proximity_p": len(scene.proximity),
        "terms_p": len(packing.aero_terms(scene)),
    }
    first = at.HEAD + at.BODY_SIZE * len(order)
    ends = np.cumsum([first, *sizes.values()]).tolist()
    starts = dict(zip(sizes, ends, strict=False))
    nominal = np.zeros(ends[-1])

    slots = dict(_HEAD)
    unset: list[int] = []  # points that default to another point
    for b, name in enumerate(scene.body):
        start, aero = at.HEAD + at.BODY_SIZE * b, scene.body[name].aerodynamics
        slots |= {f"body.{name}.{key}": start + offset for key, offset in _BODY.items()}
        if aero is not None:
            slots |= {
                f"body.{name}.aerodynamics.{key}": start + offset for key, offset in _AERO.items()
            }
            slots |= _optional(
                f"body.{name}.aerodynamics.moment_point",
                aero.moment_point,
                start + at.MOMENT_POINT,
                unset,
            )
    for i, motor in enumerate(scene.motor):
        start = starts["motors_p"] + at.MOTOR_SIZE * i
        slots |= {f"motor.{motor.name}.{key}": start + offset for key, offset in _MOTOR.items()}
        if motor.trigger is not None:
            slots[f"motor.{motor.name}.ignition.delay"] = slots.pop(f"motor.{motor.name}.ignition")
    for i, (name, joint) in enumerate(scene.joint.items()):
        start = starts["joints_p"] + at.JOINT_SIZE * i
        slots |= {f"joint.{name}.{key}": start + offset for key, offset in _JOINT.items()}
        slots |= _optional(
            f"joint.{name}.second_point", joint.second_point, start + at.SECOND_POINT, unset
        )
        if joint.guide is not None:
            slots |= {f"joint.{name}.guide.{key}": start + offset for key, offset in _GUIDE.items()}
    for i, spring in enumerate(scene.spring):
        start = starts["springs_p"] + at.SPRING_SIZE * i
        slots |= {f"spring.{spring.name}.{key}": start + offset for key, offset in _SPRING.items()}
        slots |= _optional(
            f"spring.{spring.name}.second_point",
            spring.second_point,
            start + at.SECOND_POINT,
            unset,
        )
    for i, load in enumerate(scene.load):
        start = starts["loads_p"] + at.LOAD_SIZE * i
        slots |= {f"load.{load.name}.{key}": start + offset for key, offset in _LOAD.items()}
        slots |= _optional(f"load.{load.name}.point", load.point, start + at.LOAD_POINT, unset)
    for i, leaf in enumerate(conditions.leaves):
        if leaf.path is not None:
            slots[leaf.path] = starts["leaves_p"] + i
    for i, entry in enumerate(scene.proximity):
        slots[f"proximity.{entry.name}.factor"] = starts["proximity_p"] + i
    slots |= {term.path: starts["terms_p"] + i for i, term in enumerate(packing.aero_terms(scene))}
    nominal[unset] = math.nan
    return slots, nominal, starts


def _varied(
    scene: Scene, dispersed: frozenset[str], start: int
) -> tuple[dict[str, int], dict[str, int], list[float]]:
    """Lay out the parameters that follow the blocks: constants of signals, return factors of
    springs with unloading (`has_unloading`), and quantities that all cases share unless they are
    dispersed (axes of joints and springs, outlines, factor and turn of the wind profile; these two
    also if a profile with monotone interpolation has a turn).

    Returns their indices by path, from ``start`` on; the index of the first part of each dispersed
    outline, by body (parts as in `sepmc.routines.clearances.load_outline`); their nominal values.
    """
    slots, outlines, numbers = dict[str, int](), dict[str, int](), list[float]()

    def varies(*stems: str) -> bool:
        """True if the path of a dispersed parameter begins with one of these stems and a dot."""
        return any(path.startswith(f"{stem}.") for path in dispersed for stem in stems)

    def add(values: Sequence[float], offsets: dict[str, int]) -> None:
        """Append parameter values; ``offsets`` has the position in them of each path."""
        slots.update({path: start + len(numbers) + i for path, i in offsets.items()})
        numbers.extend(map(float, values))

    for signal in scene.signal:
        known = signal_parameters(signal)
        paths = [f"signal.{signal.name}.{key}" for key in known]
        add(list(known.values()), {path: i for i, path in enumerate(paths)})
    for name, joint in scene.joint.items():
        x, y = f"joint.{name}.x_axis", f"joint.{name}.y_axis"
        if varies(x, y):
            add((*joint.x_axis, *joint.y_axis), _vector(x, 0) | _vector(y, 3))
    for spring in scene.spring:
        if spring.axis is not None and varies(path := f"spring.{spring.name}.axis"):
            add(spring.axis, _vector(path, 0))
        if spring.table is not None and has_unloading(spring, dispersed):
            add((spring.table.return_factor,), {unloading_path(spring.name): 0})
    profile = scene.environment.wind.profile
    if profile is not None and (
        not dispersed.isdisjoint({WIND_FACTOR, WIND_TURN})
        # components without overshoot are other ones after a turn: the wind is turned, not its rows
        or (profile.interpolation == "monotone" and profile.turn != 0.0)
    ):
        add((profile.factor, profile.turn), {WIND_FACTOR: 0, WIND_TURN: 1})
    for name, body in scene.body.items():
        if not varies(f"body.{name}.outline"):
            continue
        outlines[name] = start + len(numbers)
        for label, part in zip(item_names(body.outline), body.outline, strict=True):
            stem = f"body.{name}.outline.{label}"
            if part.stations is not None and part.radii is not None:
                keys = ("stations.0", "offset.y", "offset.z", "stations.1", "radii.0", "radii.1")
                first, last = part.stations
                add(
                    (
                        at.SECTOR if part.sector is not None else float(part.hollow),
                        *(first, *part.offset, last, *part.radii),
                    ),
                    {f"{stem}.{key}": i for i, key in enumerate(keys, 1)},
                )
            if part.sector is not None:
                begin, end = part.sector
                add(
                    (at.SECTOR_ANGLES, begin, 0.0, 0.0, end, 0.0, 0.0),
                    {f"{stem}.sector.0": 1, f"{stem}.sector.1": 4},
                )
            for k, point in enumerate(part.points):
                add((0.0, *point, math.nan, 0.0, 0.0), _vector(f"{stem}.points.{k}", 1))
    return slots, outlines, numbers


def signal_parameters(signal: Signal) -> dict[str, float]:
    """Nominal values of the parameters of a signal: its constants, and the numbers of its response
    and sampling. Keys are the part of the parameter path after ``signal.NAME.``, such as ``lag``.
    """
    known = dict(signal.constants)
    if signal.lag is not None:
        known["lag"] = signal.lag
    if signal.rate_limit is not None:
        known["rate_limit"] = signal.rate_limit
    if signal.servo is not None:
        known |= {"servo.natural": signal.servo.natural, "servo.damping": signal.servo.damping}
    if signal.sample is not None:
        known |= {"sample": signal.sample, "delay": signal.delay}
    if signal.states or signal.sample is not None:
        known["initial"] = signal.initial
    return known


def _optional(
    path: str, point: tuple[float, float, float] | None, start: int, unset: list[int]
) -> dict[str, int]:
    """Parameter indices, by path, of the three coordinates of a point that may be absent, from
    ``start`` on. Without a ``point`` the result is empty, and the three indices are appended to
    ``unset``, the list of those whose values are NaN."""
    if point is None:
        unset += range(start, start + 3)
        return {}
    return _vector(path, start)


def _model(
    scene: Scene,
    order: list[str],
    starts: dict[str, int],
    size_p: int,
    gusty: bool,
    dispersed: frozenset[str],
) -> at.Model:
    """Counts of the elements of a scene, positions of their data, and the numbers that all cases
    share, as a kernel reads them.

    ``order`` are the bodies in the order of `body_order`; ``starts`` the indices of the parameter
    blocks, to which those of interval data are added in place; ``size_p`` is the number of
    parameters; ``gusty`` is True if factor and turn of the wind profile are parameters;
    ``dispersed`` are the paths of dispersed parameters, on which force tables of springs depend.
    """
    joints = list(scene.joint)
    pool = Pool()
    pool.add(
        [
            x
            for j in joints
            for x in (
                *joint_axes(scene.joint[j].x_axis, scene.joint[j].y_axis),
                separation_sign(scene, j),
            )
        ]
    )
    springs_x = pool.add([x for spring in scene.spring for x in packing.direction(spring.axis)])
    air_x, wind_x = packing.add_air(pool, scene), packing.add_wind(pool, scene, gusty)
    tables = {
        "profile_i": [x for motor in scene.motor for x in packing.add_profile(pool, motor)],
        "aero_table_i": [packing.add_aero_table(pool, scene, b) for b in order],
        "proximity_i": [packing.add_proximity(pool, entry) for entry in scene.proximity],
        "parts_i": [x for b in order for x in packing.add_outline(pool, scene, b)],
        "force_tables_i": [
            packing.add_force_table(pool, spring, dispersed) for spring in scene.spring
        ],
    }
    table_starts = dict(
        zip(
            tables,
            np.cumsum([0, *(len(table) for table in tables.values())]).tolist(),
            strict=False,
        )
    )
    behind = {
        "work": 0,
        "motors_w": at.MOTOR_WORK * len(scene.motor),
        "loads_w": at.LOAD_WORK * len(scene.load),
        "size_w": 0,
    }
    starts |= dict(zip(behind, np.cumsum([size_p, *behind.values()]).tolist(), strict=False))
    structure = dict(
        ground=len(order) - 1 if order[-1] == GROUND else -1,
        n_motors=len(scene.motor),
        n_loads=len(scene.load),
        n_terms=len(packing.aero_terms(scene)),
        n_proximity=len(scene.proximity),
        pivot_joint=_pivot_joint(scene),
        **starts,
        **table_starts,
        springs_x=springs_x,
        air_x=air_x,
        wind_x=wind_x,
    )
    record = np.zeros(1, dtype=at.STRUCTURE)
    for name, number in structure.items():
        record[name] = number
    return at.Model(
        record,
        np.array([x for table in tables.values() for x in table], dtype=np.int64),
        pool.array(),
    )


def _pivot_joint(scene: Scene) -> int:
    """Number, from 0, of the joint about which the vehicle rotates at the start: the first joint to
    the ground that is not free in the first phase; -1 if there is none."""
    for number, (name, joint) in enumerate(scene.joint.items()):
        if GROUND in joint.bodies and scene.phase[0].joints.get(name, "free") != "free":
            return number
    return -1


def separation_sign(scene: Scene, name: str) -> int:
    """Sign of the x axis of a joint that makes its separation distance positive as the second body
    moves away from the first.

    Parameters
    ----------
    scene : Scene
    name : str
        joint; its x axis is the line of separation

    Returns
    -------
    int
        1 if the second body moves away along +x, else -1: the joint's ``apart`` of the file, if
        given; else the side along x of the second body's mass centre, seen from that of the first
        body (from the joint's point if that body is the ground); 1 if both are level to round-off
    """
    joint = scene.joint[name]
    if joint.apart is not None:
        return joint.apart
    level = _LEVEL * max(1.0, *(abs(x) for centre in mass_centres(scene, joint) for x in centre))
    return 1 if axial_offset(scene, joint) >= -level else -1
