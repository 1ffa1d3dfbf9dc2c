"""Stresses of large ratios of masses, inertias and lever arms, of coinciding points, and of nearly
singular inertias. Every stress is a function that simulates such cases and returns their judged
lines."""

import math

import numpy as np

from sepmc.validation import references as ref
from sepmc.validation.flights import arm, tensor
from sepmc.validation.stresses.line import FORM, Stress, conditioned, judge, relative
from sepmc.validation.stresses.scenes import (
    AFT,
    FORE,
    OMEGA,
    Composite,
    body,
    joint,
    pair,
    phase_of,
    scene,
    simulate,
)

RATIOS = (1e-9, 1e-6, 1e-3, 1.0, 1e3, 1e6, 1e9)


def _scaled(table: dict, mass: float, inertia: float) -> dict:
    """Copy of a body's table, its mass multiplied by the factor ``mass``, and its moments and
    products of inertia by the factor ``inertia``."""
    scaled = {
        key: [inertia * x for x in table[key]]
        for key in ("inertia_kg_m2", "inertia_products_kg_m2")
    }
    return table | scaled | {"mass_kg": mass * table["mass_kg"]}


def masses() -> list[Stress]:
    """Lines of `sepmc stress` on a weld between two turning bodies of mass ratio 1e-9 to 1e9 and
    similar sizes; all entries of its constraint matrix scale with the lighter body.

    The rate, the attitude and the force in the weld have one line each per ratio, with their error
    against the motion as one rigid body. The force is compared on the lighter body: the position of
    the heavier one in the composite is a difference that loses all digits. All must be accurate.
    """
    lines = []
    for ratio in RATIOS:
        run = simulate(pair("fixed", aft=_scaled(AFT, ratio, ratio)))
        composite, label = (
            Composite(run, "aft" if ratio <= 1.0 else "fore", [2.0, 0.1, 0.0]),
            f"weld, mass x {ratio:.0e}",
        )
        for quantity, error in (
            ("rate", composite.rate_error()),
            ("attitude", composite.attitude_error()),
            ("force", composite.force_error()),
        ):
            lines.append(judge(label, quantity, error, FORM, run, resolved=True))
    return lines


def light_link() -> list[Stress]:
    """Lines of `sepmc stress` on a light body welded between two heavy ones: rate and force against
    closed forms. The condition number of the constraint matrix is the ratio of masses; down to a
    ratio of 1e-9 they must be accurate."""
    lines = []
    for ratio in (1e-3, 1e-6, 1e-9, 1e-12):
        light = _scaled(body(1.0, [1.0, 2.0, 2.2], [2.0, 0.0, 0.0]), ratio, ratio)
        bodies = {"fore": FORE, "link": light, "aft": AFT}
        joints = {
            "front": joint("fore", "link", [1.5, 0.0, 0.0]),
            "rear": joint("link", "aft", [2.5, 0.0, 0.0]),
        }
        bound = conditioned(1.0 / ratio)
        run = simulate(
            scene(bodies, joints, phase_of(front="fixed", rear="fixed"), 2.0, 0.02, OMEGA)
        )
        composite, label = (
            Composite(run, "aft", [2.5, 0.0, 0.0]),
            f"light body of {ratio:.0e} between heavy",
        )
        lines.append(judge(label, "rate", composite.rate_error(), bound, run, ratio >= 1e-9))
        lines.append(
            judge(label, "force", composite.force_error("rear"), bound, run, ratio >= 1e-9)
        )
    return lines


def inertias() -> list[Stress]:
    """Lines of `sepmc stress` on a weld between bodies of similar masses and very different
    inertias: rate and force against closed forms. A lever arm over a small inertia makes the
    constraint matrix ill-conditioned, so a line may also be flagged."""
    lines = []
    for ratio in RATIOS:
        bound = conditioned(max(1.0, 1.0 / ratio))
        run = simulate(pair("fixed", aft=_scaled(AFT, 1.0, ratio)))
        composite, label = Composite(run, "aft", [2.0, 0.1, 0.0]), f"weld, inertia x {ratio:.0e}"
        lines.append(judge(label, "rate", composite.rate_error(), bound, run))
        lines.append(judge(label, "force", composite.force_error(), bound, run))
    return lines


def needles() -> list[Stress]:
    """Lines of `sepmc stress` on the angular rates of a free symmetric needle whose moments of
    inertia differ by up to 1e12: the rate about its axis is constant, and the vector of the other
    two rotates about it. Each line passes also if it is flagged."""
    lines = []
    for ratio in (1e-3, 1e-6, 1e-9, 1e-12):
        needle = body(1.0, [0.7 * ratio, 0.7, 0.7], [1.0, 0.0, 0.0])
        run = simulate(scene({"needle": needle}, {}, [{"name": "free"}], 2.0, 0.01, OMEGA))
        # w_y' = (Izz - Ixx) w_z w_x / Iyy, w_z' = (Ixx - Iyy) w_x w_y / Izz
        turning = (1.0 - ratio) * OMEGA[0] * run.t
        c, s = np.cos(turning), np.sin(turning)
        expected = np.stack(
            [np.full_like(c, OMEGA[0]), OMEGA[1] * c + OMEGA[2] * s, OMEGA[2] * c - OMEGA[1] * s],
            axis=1,
        )
        error = relative(run.body("needle").w, expected)
        lines.append(
            judge(f"needle, Ixx / Iyy = {ratio:.0e}", "rate", error, conditioned(1.0 / ratio), run)
        )
    return lines


def nearly_singular() -> list[Stress]:
    """Lines of `sepmc stress` on a thin free rod along (1, 2, 3), whose inertia tensor is full and
    nearly singular, with round-off up to the size of its minimum moment: rate about its axis, and
    angular momentum. Each line passes also if it is flagged."""
    n = np.array([1.0, 2.0, 3.0]) / math.sqrt(14.0)
    lines = []
    for minimum in (1e-3, 1e-6, 1e-9, 1e-12, 1e-15):
        j = np.eye(3) - (1.0 - minimum) * np.outer(n, n)
        rod = body(
            1.0,
            np.diag(j).tolist(),
            [1.0, 0.0, 0.0],
            [float(-j[0, 1]), float(-j[0, 2]), float(-j[1, 2])],
        )
        label, bound, start = (
            f"rod of minimum moment {minimum:.0e}",
            conditioned(1.0 / minimum),
            np.array([0.3, -0.4, 0.5]),
        )
        run = simulate(scene({"rod": rod}, {}, [{"name": "free"}], 2.0, 0.01, start.tolist()))
        spin = run.body("rod").w
        moved = run.body("rod").r @ tensor(run.scene, "rod") @ spin[:, :, None]
        expected = np.broadcast_to((tensor(run.scene, "rod") @ start)[:, None], moved.shape)
        lines.append(judge(label, "rate about its axis", relative(spin @ n, start @ n), bound, run))
        lines.append(judge(label, "angular momentum", relative(moved, expected), bound, run))
    return lines


def arms() -> list[Stress]:
    """Lines of `sepmc stress` on the rate and force of a weld at a point 0 to 1 km from both mass
    centres, and on joints of four kinds at both mass centres, whose force is zero. All but the weld
    1 km away must be accurate."""
    lines = []
    for length in (0.0, 1e-6, 1.0, 30.0, 1e3):
        fore, aft = FORE | {"cg_m": [0.0, 0.0, 0.0]}, AFT | {"cg_m": [2.0 * length, 0.0, 0.0]}
        tree = pair("fixed", fore=fore, aft=aft)
        tree["joint"]["link"]["point_m"] = [length, 0.0, 0.0]
        run, bound, label = (
            simulate(tree),
            conditioned(max(1.0, length * length)),
            f"weld {length:g} m from both mass centres",
        )
        composite = Composite(run, "aft", [length, 0.0, 0.0])
        lines.append(
            judge(label, "rate", composite.rate_error(), bound, run, resolved=length <= 30.0)
        )
        size = max(float(np.max(np.abs(composite.force))), 1.0)
        force = run.columns("link_force_on_aft_*_N")
        lines.append(
            judge(
                label,
                "force",
                relative(force, composite.force, size),
                bound,
                run,
                resolved=length <= 30.0,
            )
        )
    for kind in ("spherical", "revolute", "universal", "fixed"):
        tree = pair(
            kind, fore=FORE | {"cg_m": [2.0, 0.0, 0.0]}, aft=AFT | {"cg_m": [2.0, 0.0, 0.0]}
        )
        tree["joint"]["link"]["point_m"] = [2.0, 0.0, 0.0]
        run = simulate(tree)
        forces = run.columns("link_force_on_aft_*_N")
        lines.append(
            judge(
                f"{kind} at both mass centres",
                "force over 1 N",
                float(np.max(np.abs(forces))),
                FORM,
                run,
                resolved=True,
            )
        )
    return lines


def long_pendulum() -> list[Stress]:
    """Lines of `sepmc stress` on a small body on a ball joint to the ground, 1 m and 1 km away,
    released at 60 deg from the vertical: a plane pendulum. All must be accurate."""
    lines = []
    for length in (1.0, 1e3):
        bob = body(2.0, [0.02, 0.03, 0.03], [length, 0.0, 0.0])
        swing = scene({"bob": bob}, {"ball": joint("ground", "bob", [0.0, 0.0, 0.0])},
        phase_of(ball="spherical"), 10.0, 0.02,
                      environment={"gravity": "constant"}, initial={"pitch_deg": 30.0})  # fmt: skip
        # m L^2 / J: angular acceleration by the moment of the tension
        bound = conditioned(length * length / 0.015)
        label = f"ball joint {length:g} m away"
        run = simulate(swing)
        g = run.scene.environment.surface_gravity
        frequency = math.sqrt(2.0 * g * length / (0.03 + 2.0 * length**2))
        # along -x: hangs vertically at pitch +90 deg
        to_centre = -arm(run.scene, "bob", [0.0, 0.0, 0.0])
        assert to_centre[0] < 0.0
        angle, rate = ref.pendulum(run.t, frequency, math.radians(30.0 - 90.0))
        largest = frequency * 2.0 * math.sin(math.radians(30.0))  # rate at the bottom
        lines.append(
            judge(
                label,
                "rate",
                relative(run.body("bob").w[:, 2], rate, largest),
                bound,
                run,
                resolved=True,
            )
        )
        down = np.stack([np.sin(angle), -np.cos(angle), np.zeros_like(angle)], axis=1)
        lines.append(
            judge(
                label,
                "direction",
                relative(-run.body("bob").r[:, :, 0], down),
                bound,
                run,
                resolved=True,
            )
        )
    return lines
