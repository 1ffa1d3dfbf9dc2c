"""Joints that hold the same twice, or nearly: welds in a loop, a closed four-bar, two balls on one
line."""

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
    fly,
    held,
    joint,
    pair,
    scene,
)

Array = np.ndarray
# Joint axes held by the kinds used here; what a row of a rotation turns about, with the joint's
# axes still parallel.
HELD = {
    "fixed": ("xyz", "xyz"),
    "revolute": ("xyz", "yz"),
    "spherical": ("xyz", ""),
    "point-on-line": ("yz", ""),
}


def _axes(data: Any) -> Array:
    """Rows: axes of a joint in body axes."""
    x = np.asarray(data.x_axis) / np.linalg.norm(data.x_axis)
    y = np.asarray(data.y_axis) - x * (x @ np.asarray(data.y_axis))
    y /= np.linalg.norm(y)
    return np.stack([x, y, np.cross(x, y)])


def jacobian(found: NominalRun) -> Array:
    """Constraint rows of all joints at the start, on the velocities and rates of all bodies, in
    body axes; in the engine's order."""
    names, rows = list(found.scene.body), []
    for name, data in found.scene.joint.items():
        translations, rotations = HELD[found.scene.phase[0].joints[name]]
        axes, levers = _axes(data), [arm(found.scene, b, data.point) for b in data.bodies]
        for which, along in [(axis, True) for axis in translations] + [
            (axis, False) for axis in rotations
        ]:
            row, e = np.zeros((len(names), 6)), axes["xyz".index(which)]
            for b, sign, lever in zip(data.bodies, (-1.0, 1.0), levers, strict=True):
                row[names.index(b)] = np.concatenate(
                    [sign * e, sign * np.cross(lever, e)] if along else [np.zeros(3), sign * e]
                )
            rows.append(row.ravel())
    return np.array(rows)


def multipliers(found: NominalRun) -> Array:
    """Joint wrenches at the start, as the engine gives them, along the rows of `jacobian`."""
    given = []
    for name, data in found.scene.joint.items():
        translations, rotations = HELD[found.scene.phase[0].joints[name]]
        second, axes = data.bodies[1], _axes(data)
        force, moment = (
            axes @ found.columns(f"{name}_{what}_on_{second}_*_{unit}")[0]
            for what, unit in (("force", "N"), ("moment", "N_m"))
        )
        given += [force["xyz".index(a)] for a in translations] + [
            moment["xyz".index(a)] for a in rotations
        ]
    return np.array(given)


def least(found: NominalRun, load: Array) -> Array:
    """Multipliers of least sum of squares that put this load (n 6,) on the bodies: numpy's
    pseudo-inverse."""
    return np.linalg.pinv(jacobian(found).T, rcond=1e-10) @ load


def _same_motion(given: str, found: NominalRun, without: NominalRun, bound: Bound) -> list[Stress]:
    """Rates and places of all bodies as without the redundant joint."""
    ours, theirs = ([f.body(name) for name in f.scene.body] for f in (found, without))
    rates = relative([track.w for track in ours], [track.w for track in theirs])
    places = relative([track.x for track in ours], [track.x for track in theirs])
    return [
        judge(given, "rates", rates, bound, found, True),
        judge(given, "places", places, bound, found, True),
    ]


def _reactions(
    given: str, found: NominalRun, without: NominalRun, rows: int, bound: Bound
) -> list[Stress]:
    """Reactions of least norm, of the load that the flight without the redundant joint has; and the
    number of redundant rows."""
    expected = least(found, jacobian(without).T @ multipliers(without))
    error = relative(multipliers(found), expected)
    count = abs(found.outcomes["redundant_rows"] - rows)
    return [
        judge(given, "reactions, least norm", error, bound, found, True),
        judge(given, "redundant_rows", count, EXACT, found, True),
    ]


def welds() -> list[Stress]:
    """Two fixed joints between the same bodies, from 1 m to 1e-12 m apart: one weld, and every row
    of one of them redundant."""
    lines, once = [], fly(pair("fixed"))
    for apart in (1.0, 1e-3, 1e-6, 1e-9, 1e-12, 0.0):
        tree = pair("fixed")
        tree["joint"]["again"] = joint("fore", "aft", [2.0, 0.1 + apart, 0.0])
        tree["phase"] = held(link="fixed", again="fixed")
        found, given = fly(tree), f"two welds {apart:g} m apart"
        lines.append(
            judge(
                given,
                "rate, closed form",
                Composite(found, "aft", [2.0, 0.1, 0.0]).rate_error(),
                FORM,
                found,
                True,
            )
        )
        lines += _same_motion(given, found, once, FORM) + _reactions(given, found, once, 6, FORM)
    tree["solver"]["formulation"] = "full"
    lines += _same_motion("two welds at one point, full", fly(tree), once, FORM)
    return lines


def triangle() -> list[Stress]:
    """Three bodies in a loop of three welds: two would do."""
    third = body(2.1, [0.8, 1.5, 1.2], [2.0, 1.5, 0.06], [0.0, -0.1, 0.15])
    joints = {
        "ab": joint("fore", "aft", [2.0, 0.1, 0.0]),
        "bc": joint("aft", "third", [2.6, 0.7, 0.2]),
    }
    kinds = {"ab": "fixed", "bc": "fixed"}
    bodies = {"fore": FORE, "aft": AFT, "third": third}
    without = fly(scene(bodies, joints, held(**kinds), 2.0, 0.02, OMEGA))
    found = fly(
        scene(
            bodies,
            joints | {"ca": joint("third", "fore", [1.4, 0.8, -0.1])},
            held(**kinds, ca="fixed"),
            2.0,
            0.02,
            OMEGA,
        )
    )
    return _same_motion("loop of three welds", found, without, FORM) + _reactions(
        "loop of three welds", found, without, 6, FORM
    )


def _bars(last: str) -> Tree:
    """Four bars in a plane closed by four hinges along z, turned by a load; the last joint may hold
    less."""
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
    return scene(bodies, joints, held(**kinds), 1.0, 0.01, [0.2, 0.1, 0.6], load=loads)


def four_bar() -> list[Stress]:
    """A plane four-bar of hinges in space: the last need only hold two translations; three of its
    rows are redundant."""
    found, without = fly(_bars("revolute")), fly(_bars("point-on-line"))
    lines = _same_motion("closed four-bar of hinges", found, without, FORM)
    return lines + _reactions("closed four-bar of hinges", found, without, 3, FORM)


def _fly_unless_refused(tree: Tree) -> NominalRun | None:
    """The flight of a scene, or None if it is refused."""
    try:
        return fly(tree)
    except SceneError:
        return None


def two_balls() -> list[Stress]:
    """Two ball joints apart by 1 m to 1e-12 m are a hinge about the line between them, with one row
    redundant.

    What keeps them a hinge are levers of their distance: the matrix has the condition number of its
    square.
    """
    lines = []
    hinge = pair("revolute")
    hinge["joint"]["link"]["x_axis"], hinge["joint"]["link"]["y_axis"] = (
        [0.0, 1.0, 0.0],
        [0.0, 0.0, 1.0],
    )
    once = fly(hinge)
    for apart in (1.0, 1e-1, 1e-2, 1e-3, 1e-4, 1e-5, 1e-6, 1e-8, 1e-10, 1e-12):
        tree = pair("spherical")
        tree["joint"]["again"] = joint("fore", "aft", [2.0, 0.1 + apart, 0.0])
        tree["phase"] = held(link="spherical", again="spherical")
        given, bound = f"two ball joints {apart:.0e} m apart", conditioned(1.0 / apart**2)
        found = _fly_unless_refused(tree)
        if found is None:
            lines.append(Stress(given, "any", math.nan, NONE, "refused", resolved=apart >= 1e-2))
            continue
        error = relative(
            [found.body(b).w for b in ("fore", "aft")],
            [once.body(b).w for b in ("fore", "aft")][: len(found.t)],
        )
        lines.append(judge(given, "rates", error, bound, found, apart >= 1e-5))
        lines.append(
            judge(
                given,
                "redundant_rows",
                abs(found.outcomes["redundant_rows"] - 1),
                EXACT,
                found,
                apart >= 1e-5,
            )
        )
    return lines


def near_parallel() -> list[Stress]:
    """Two hinges at one point whose axes are 1 to 1e-12 rad apart hold all three rotations, the
    third one weakly: a weld."""
    lines, once = [], fly(pair("fixed"))
    for angle in (1.0, 1e-2, 1e-4, 1e-6, 1e-8, 1e-10, 1e-12):
        tree = pair("revolute")
        tree["joint"]["again"] = joint("fore", "aft", [2.0, 0.1, 0.0], x_axis=[1.0, angle, 0.0])
        tree["phase"] = held(link="revolute", again="revolute")
        given, bound = f"two hinges {angle:.0e} rad apart", conditioned(1.0 / angle**2)
        found = _fly_unless_refused(tree)
        if found is None:
            lines.append(Stress(given, "any", math.nan, NONE, "refused", resolved=angle >= 1e-2))
            continue
        error = relative(
            [found.body(b).w for b in ("fore", "aft")], [once.body(b).w for b in ("fore", "aft")]
        )
        lines.append(judge(given, "rates", error, bound, found, angle >= 1e-2))
    return lines


def short_rods() -> list[Stress]:
    """A rod from 1 m to 1e-9 m long between two turning bodies; without any length it is refused,
    or told in flight."""
    lines = []
    for length in (1.0, 1e-3, 1e-6, 1e-9, 1e-12):
        tree = pair("rod", step=0.01)
        tree["joint"]["link"]["second_point_m"] = [2.0 + length, 0.1, 0.0]
        energy_bound, given = (
            Bound(max(FORM.value, 100.0 * EPS / length), "100 eps m over the length"),
            f"rod of {length:g} m",
        )
        found = fly(tree)
        lines.append(
            judge(
                given,
                "length, m",
                found.outcomes["joint_gap_residual_m"],
                FORM,
                found,
                length >= 1e-3,
            )
        )
        lines.append(
            judge(
                given,
                "energy_residual",
                found.outcomes["energy_residual"],
                energy_bound,
                found,
                length >= 1e-3,
            )
        )
    return lines
