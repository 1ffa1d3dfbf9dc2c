"""Stresses of redundant or nearly redundant joints: double welds, a loop of welds, a closed
four-bar, two balls or two hinges, short rods. Every stress is a function that simulates such cases
and returns their judged lines."""

import math
from typing import Any

import numpy as np

from sepmc.scene.messages import SceneError
from sepmc.validation.flights import NominalRun, arm
from sepmc.validation.stresses.line import (
    EPS,
    EXACT,
    FORM,
    NONE,
    Bound,
    Stress,
    conditioned,
    judge,
    relative,
)
from sepmc.validation.stresses.scenes import (
    AFT,
    FORE,
    OMEGA,
    Composite,
    Tree,
    body,
    joint,
    pair,
    phase_of,
    scene,
    simulate,
)

Array = np.ndarray
# Constrained joint axes in translation and rotation, by kind; the axes of a row of a rotation while
# the joint's axes are parallel.
CONSTRAINED = {
    "fixed": ("xyz", "xyz"),
    "revolute": ("xyz", "yz"),
    "spherical": ("xyz", ""),
    "point-on-line": ("yz", ""),
}


def _axes(data: Any) -> Array:
    """Axes of ``data``, a joint of the scene, as unit vectors in the body axes of its first body:
    rows (3, 3)."""
    x = np.asarray(data.x_axis) / np.linalg.norm(data.x_axis)
    y = np.asarray(data.y_axis) - x * (x @ np.asarray(data.y_axis))
    y /= np.linalg.norm(y)
    return np.stack([x, y, np.cross(x, y)])


def jacobian(run: NominalRun) -> Array:
    """Constraint rows (m, 6 n) of all joints at the start, in the engine's order.

    A row is multiplied by a vector (6 n,) with the velocity, then the angular rate of each of the n
    bodies, in body axes; the product is the velocity or rate of the second body of a joint relative
    to the first, along or about a joint axis.
    """
    names, rows = list(run.scene.body), []
    for name, data in run.scene.joint.items():
        translations, rotations = CONSTRAINED[run.scene.phase[0].joints[name]]
        axes, levers = _axes(data), [arm(run.scene, b, data.point) for b in data.bodies]
        for axis, is_translation in [(axis, True) for axis in translations] + [
            (axis, False) for axis in rotations
        ]:
            row, e = np.zeros((len(names), 6)), axes["xyz".index(axis)]
            for b, sign, lever in zip(data.bodies, (-1.0, 1.0), levers, strict=True):
                row[names.index(b)] = np.concatenate(
                    [sign * e, sign * np.cross(lever, e)]
                    if is_translation
                    else [np.zeros(3), sign * e]
                )
            rows.append(row.ravel())
    return np.array(rows)


def multipliers(run: NominalRun) -> Array:
    """Forces, N, and moments, N m, of the engine's joints on their second bodies at the start: one
    component (m,) for each row of `jacobian`, in its order, along the joint axis of that row."""
    components = []
    for name, data in run.scene.joint.items():
        translations, rotations = CONSTRAINED[run.scene.phase[0].joints[name]]
        second, axes = data.bodies[1], _axes(data)
        force, moment = (
            axes @ run.columns(f"{name}_{load}_on_{second}_*_{unit}")[0]
            for load, unit in (("force", "N"), ("moment", "N_m"))
        )
        components += [force["xyz".index(a)] for a in translations] + [
            moment["xyz".index(a)] for a in rotations
        ]
    return np.array(components)


def minimum_norm(run: NominalRun, load: Array) -> Array:
    """Multipliers (m,) of minimum norm at the start of a run, one for each row of `jacobian`, whose
    constraint loads are ``load`` (6 n,), by numpy's pseudo-inverse: for each of the n bodies the
    force, N, then the moment, N m, in body axes. What no multipliers can give is ignored."""
    return np.linalg.pinv(jacobian(run).T, rcond=1e-10) @ load


def _same_motion(label: str, run: NominalRun, without: NominalRun, bound: Bound) -> list[Stress]:
    """Lines of `sepmc stress` on rates and positions of all bodies in ``run`` against ``without``,
    a run without the redundant joint."""
    with_joint, without_joint = ([f.body(name) for name in f.scene.body] for f in (run, without))
    rates = relative([track.w for track in with_joint], [track.w for track in without_joint])
    positions = relative([track.x for track in with_joint], [track.x for track in without_joint])
    return [
        judge(label, "rates", rates, bound, run, True),
        judge(label, "positions", positions, bound, run, True),
    ]


def _reactions(
    label: str, run: NominalRun, without: NominalRun, rows: int, bound: Bound
) -> list[Stress]:
    """Two lines of `sepmc stress` on a run with a redundant joint: its reactions against those of
    minimum norm that put the same load on the bodies as in ``without``, a run without that joint;
    its number of redundant rows against ``rows``."""
    expected = minimum_norm(run, jacobian(without).T @ multipliers(without))
    error = relative(multipliers(run), expected)
    count = abs(run.outcomes["redundant_rows"] - rows)
    return [
        judge(label, "reactions, minimum norm", error, bound, run, True),
        judge(label, "redundant_rows", count, EXACT, run, True),
    ]


def welds() -> list[Stress]:
    """Lines of `sepmc stress` on two fixed joints between the same bodies, from 1 m to 0 m apart:
    they act as one weld, with all six rows of one of them redundant. References are the closed form
    of the rate and a simulation with one of the joints alone. All must be accurate."""
    lines, reference = [], simulate(pair("fixed"))
    for distance in (1.0, 1e-3, 1e-6, 1e-9, 1e-12, 0.0):
        tree = pair("fixed")
        tree["joint"]["again"] = joint("fore", "aft", [2.0, 0.1 + distance, 0.0])
        tree["phase"] = phase_of(link="fixed", again="fixed")
        run, label = simulate(tree), f"two welds {distance:g} m apart"
        lines.append(
            judge(
                label,
                "rate, closed form",
                Composite(run, "aft", [2.0, 0.1, 0.0]).rate_error(),
                FORM,
                run,
                True,
            )
        )
        lines += _same_motion(label, run, reference, FORM) + _reactions(
            label, run, reference, 6, FORM
        )
    tree["solver"]["formulation"] = "full"
    lines += _same_motion("two welds at one point, full", simulate(tree), reference, FORM)
    return lines


def triangle() -> list[Stress]:
    """Lines of `sepmc stress` on three bodies in a loop of three welds, of which two would suffice:
    motion against a simulation with two welds, reactions against those of minimum norm. All must be
    accurate."""
    third = body(2.1, [0.8, 1.5, 1.2], [2.0, 1.5, 0.06], [0.0, -0.1, 0.15])
    joints = {
        "ab": joint("fore", "aft", [2.0, 0.1, 0.0]),
        "bc": joint("aft", "third", [2.6, 0.7, 0.2]),
    }
    kinds = {"ab": "fixed", "bc": "fixed"}
    bodies = {"fore": FORE, "aft": AFT, "third": third}
    without = simulate(scene(bodies, joints, phase_of(**kinds), 2.0, 0.02, OMEGA))
    run = simulate(
        scene(
            bodies,
            joints | {"ca": joint("third", "fore", [1.4, 0.8, -0.1])},
            phase_of(**kinds, ca="fixed"),
            2.0,
            0.02,
            OMEGA,
        )
    )
    return _same_motion("loop of three welds", run, without, FORM) + _reactions(
        "loop of three welds", run, without, 6, FORM
    )


def _bars(last: str) -> Tree:
    """Tree of four bars in a plane, closed to a loop by three hinges along z and a fourth joint of
    the kind ``last``, and turned by a load."""
    corners = [[0.0, 0.0, 0.0], [2.0, 0.3, 0.0], [2.4, 1.6, 0.0], [0.2, 1.1, 0.0]]
    names = ["bar1", "bar2", "bar3", "bar4"]
    bodies, joints = {}, {}
    for k, name in enumerate(names):
        middle = [0.5 * (a + b) for a, b in zip(corners[k], corners[(k + 1) % 4], strict=True)]
        bodies[name] = body(1.0 + 0.3 * k, [0.5, 0.6, 0.4 + 0.1 * k], middle)
        joints[f"pin{k + 1}"] = joint(
            name, names[(k + 1) % 4], corners[(k + 1) % 4], x_axis=[0.0, 0.0, 1.0]
        )
    loads = [
        {"name": "push", "body": "bar1", "force_N": [0.0, 3.0, 0.0], "moment_N_m": [0.1, 0.2, 1.5]}
    ]
    kinds = dict.fromkeys(joints, "revolute") | {"pin4": last}
    return scene(bodies, joints, phase_of(**kinds), 1.0, 0.01, [0.2, 0.1, 0.6], load=loads)


def four_bar() -> list[Stress]:
    """Lines of `sepmc stress` on a plane four-bar with a hinge at each corner: the last one needs
    only two translations, so three of its rows are redundant. The reference is a second simulation,
    in which that corner is a point on a line: same motion, and the reactions of minimum norm.
    All must be accurate."""
    run, without = simulate(_bars("revolute")), simulate(_bars("point-on-line"))
    lines = _same_motion("closed four-bar of hinges", run, without, FORM)
    return lines + _reactions("closed four-bar of hinges", run, without, 3, FORM)


def _run_unless_refused(tree: Tree) -> NominalRun | None:
    """Run of a scene, or None if it is refused with a SceneError."""
    try:
        return simulate(tree)
    except SceneError:
        return None


def two_balls() -> list[Stress]:
    """Lines of `sepmc stress` on two ball joints 1 m to 1e-12 m apart, which act as a hinge about
    the line between them, with one redundant row: rates against a simulation with that hinge, and
    the number of redundant rows.

    The lever arms of that hinge are as short as the distance, so the condition number of the
    constraint matrix is the inverse of its square. From 1e-5 m on a run must be accurate; from 1e-2
    m on the scene must not be refused either.
    """
    lines = []
    hinge = pair("revolute")
    hinge["joint"]["link"]["x_axis"], hinge["joint"]["link"]["y_axis"] = (
        [0.0, 1.0, 0.0],
        [0.0, 0.0, 1.0],
    )
    reference = simulate(hinge)
    for distance in (1.0, 1e-1, 1e-2, 1e-3, 1e-4, 1e-5, 1e-6, 1e-8, 1e-10, 1e-12):
        tree = pair("spherical")
        tree["joint"]["again"] = joint("fore", "aft", [2.0, 0.1 + distance, 0.0])
        tree["phase"] = phase_of(link="spherical", again="spherical")
        label, bound = f"two ball joints {distance:.0e} m apart", conditioned(1.0 / distance**2)
        run = _run_unless_refused(tree)
        if run is None:
            lines.append(Stress(label, "any", math.nan, NONE, "refused", resolved=distance >= 1e-2))
            continue
        error = relative(
            [run.body(b).w for b in ("fore", "aft")],
            [reference.body(b).w[: len(run.t)] for b in ("fore", "aft")],
        )
        lines.append(judge(label, "rates", error, bound, run, distance >= 1e-5))
        lines.append(
            judge(
                label,
                "redundant_rows",
                abs(run.outcomes["redundant_rows"] - 1),
                EXACT,
                run,
                distance >= 1e-5,
            )
        )
    return lines


def near_parallel() -> list[Stress]:
    """Lines of `sepmc stress` on two hinges at one point with axes 1 to 1e-12 rad apart: they
    constrain all three rotations, the third one weakly, so they act as a weld. Rates are compared
    with a simulation of that weld; at 1e-2 rad and more they must be accurate."""
    lines, reference = [], simulate(pair("fixed"))
    for angle in (1.0, 1e-2, 1e-4, 1e-6, 1e-8, 1e-10, 1e-12):
        tree = pair("revolute")
        tree["joint"]["again"] = joint("fore", "aft", [2.0, 0.1, 0.0], x_axis=[1.0, angle, 0.0])
        tree["phase"] = phase_of(link="revolute", again="revolute")
        label, bound = f"two hinges {angle:.0e} rad apart", conditioned(1.0 / angle**2)
        run = _run_unless_refused(tree)
        if run is None:
            lines.append(Stress(label, "any", math.nan, NONE, "refused", resolved=angle >= 1e-2))
            continue
        error = relative(
            [run.body(b).w for b in ("fore", "aft")], [reference.body(b).w for b in ("fore", "aft")]
        )
        lines.append(judge(label, "rates", error, bound, run, angle >= 1e-2))
    return lines


def short_rods() -> list[Stress]:
    """Lines of `sepmc stress` on a rod of 1 m to 1e-12 m between two turning bodies: error of its
    length, in m whatever the length, and energy. Rods of 1 mm and more must be accurate."""
    lines = []
    for length in (1.0, 1e-3, 1e-6, 1e-9, 1e-12):
        tree = pair("rod", step=0.01)
        tree["joint"]["link"]["second_point_m"] = [2.0 + length, 0.1, 0.0]
        energy_bound, label = (
            Bound(max(FORM.value, 100.0 * EPS / length), "100 eps m over the length"),
            f"rod of {length:g} m",
        )
        run = simulate(tree)
        lines.append(
            judge(
                label,
                "length, m",
                run.outcomes["joint_gap_residual_m"],
                FORM,
                run,
                length >= 1e-3,
            )
        )
        lines.append(
            judge(
                label,
                "energy_residual",
                run.outcomes["energy_residual"],
                energy_bound,
                run,
                length >= 1e-3,
            )
        )
    return lines
