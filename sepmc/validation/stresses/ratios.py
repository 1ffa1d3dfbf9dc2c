"""Numbers far apart: masses, inertias, lever arms; points that coincide; inertias that are nearly
singular."""

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
    fly,
    held,
    joint,
    pair,
    scene,
)

RATIOS = (1e-9, 1e-6, 1e-3, 1.0, 1e3, 1e6, 1e9)


def _scaled(given: dict, mass: float, inertia: float) -> dict:
    """A body with other mass and inertia."""
    scaled = {
        key: [inertia * x for x in given[key]]
        for key in ("inertia_kg_m2", "inertia_products_kg_m2")
    }
    return given | scaled | {"mass_kg": mass * given["mass_kg"]}


def masses() -> list[Stress]:
    """A weld between bodies of mass ratio 1e-9 to 1e9, sizes alike; every entry of its matrix
    scales with the lighter one.

    Its force is asked of the lighter body: the place of the heavier one in the composite is a
    difference that loses all digits.
    """
    lines = []
    for ratio in RATIOS:
        found = fly(pair("fixed", aft=_scaled(AFT, ratio, ratio)))
        whole, given = (
            Composite(found, "aft" if ratio <= 1.0 else "fore", [2.0, 0.1, 0.0]),
            f"weld, mass x {ratio:.0e}",
        )
        for quantity, error in (
            ("rate", whole.rate_error()),
            ("attitude", whole.attitude_error()),
            ("force", whole.force_error()),
        ):
            lines.append(judge(given, quantity, error, FORM, found, resolved=True))
    return lines


def light_link() -> list[Stress]:
    """A light body welded between two heavy ones: the matrix has the condition number of the ratio
    of masses."""
    lines = []
    for ratio in (1e-3, 1e-6, 1e-9, 1e-12):
        light = _scaled(body(1.0, [1.0, 2.0, 2.2], [2.0, 0.0, 0.0]), ratio, ratio)
        bodies = {"fore": FORE, "link": light, "aft": AFT}
        joints = {
            "front": joint("fore", "link", [1.5, 0.0, 0.0]),
            "rear": joint("link", "aft", [2.5, 0.0, 0.0]),
        }
        bound = conditioned(1.0 / ratio)
        found = fly(scene(bodies, joints, held(front="fixed", rear="fixed"), 2.0, 0.02, OMEGA))
        whole, given = (
            Composite(found, "aft", [2.5, 0.0, 0.0]),
            f"light body of {ratio:.0e} between heavy",
        )
        lines.append(judge(given, "rate", whole.rate_error(), bound, found, ratio >= 1e-9))
        lines.append(judge(given, "force", whole.force_error("rear"), bound, found, ratio >= 1e-9))
    return lines


def inertias() -> list[Stress]:
    """Inertias far apart with like masses: a lever arm over a small inertia is what makes the
    matrix of the weld ill-conditioned."""
    lines = []
    for ratio in RATIOS:
        bound = conditioned(max(1.0, 1.0 / ratio))
        found = fly(pair("fixed", aft=_scaled(AFT, 1.0, ratio)))
        whole, given = Composite(found, "aft", [2.0, 0.1, 0.0]), f"weld, inertia x {ratio:.0e}"
        lines.append(judge(given, "rate", whole.rate_error(), bound, found))
        lines.append(judge(given, "force", whole.force_error(), bound, found))
    return lines


def needles() -> list[Stress]:
    """A free symmetric needle whose moments differ by up to 1e12: the rate about its axis stays,
    the others turn about it."""
    lines = []
    for ratio in (1e-3, 1e-6, 1e-9, 1e-12):
        needle = body(1.0, [0.7 * ratio, 0.7, 0.7], [1.0, 0.0, 0.0])
        found = fly(scene({"needle": needle}, {}, [{"name": "free"}], 2.0, 0.01, OMEGA))
        # w_y' = (Izz - Ixx) w_z w_x / Iyy, w_z' = (Ixx - Iyy) w_x w_y / Izz
        turning = (1.0 - ratio) * OMEGA[0] * found.t
        c, s = np.cos(turning), np.sin(turning)
        expected = np.stack(
            [np.full_like(c, OMEGA[0]), OMEGA[1] * c + OMEGA[2] * s, OMEGA[2] * c - OMEGA[1] * s],
            axis=1,
        )
        error = relative(found.body("needle").w, expected)
        lines.append(
            judge(
                f"needle, Ixx / Iyy = {ratio:.0e}", "rate", error, conditioned(1.0 / ratio), found
            )
        )
    return lines


def nearly_singular() -> list[Stress]:
    """A thin rod along (1, 2, 3): its inertia is full and nearly singular, and round-off of it is
    large beside the least moment."""
    n = np.array([1.0, 2.0, 3.0]) / math.sqrt(14.0)
    lines = []
    for least in (1e-3, 1e-6, 1e-9, 1e-12, 1e-15):
        j = np.eye(3) - (1.0 - least) * np.outer(n, n)
        rod = body(
            1.0,
            np.diag(j).tolist(),
            [1.0, 0.0, 0.0],
            [float(-j[0, 1]), float(-j[0, 2]), float(-j[1, 2])],
        )
        given, bound, start = (
            f"rod of least moment {least:.0e}",
            conditioned(1.0 / least),
            np.array([0.3, -0.4, 0.5]),
        )
        found = fly(scene({"rod": rod}, {}, [{"name": "free"}], 2.0, 0.01, start.tolist()))
        spin = found.body("rod").w
        moved = found.body("rod").r @ tensor(found.scene, "rod") @ spin[:, :, None]
        expected = np.broadcast_to((tensor(found.scene, "rod") @ start)[:, None], moved.shape)
        lines.append(
            judge(given, "rate about its axis", relative(spin @ n, start @ n), bound, found)
        )
        lines.append(judge(given, "angular momentum", relative(moved, expected), bound, found))
    return lines


def arms() -> list[Stress]:
    """A weld whose point is up to 1 km from both mass centres, and at one or both of them."""
    lines = []
    for length in (0.0, 1e-6, 1.0, 30.0, 1e3):
        fore, aft = FORE | {"cg_m": [0.0, 0.0, 0.0]}, AFT | {"cg_m": [2.0 * length, 0.0, 0.0]}
        tree = pair("fixed", fore=fore, aft=aft)
        tree["joint"]["link"]["point_m"] = [length, 0.0, 0.0]
        found, bound, given = (
            fly(tree),
            conditioned(max(1.0, length * length)),
            f"weld {length:g} m from both mass centres",
        )
        whole = Composite(found, "aft", [length, 0.0, 0.0])
        lines.append(
            judge(given, "rate", whole.rate_error(), bound, found, resolved=length <= 30.0)
        )
        size = max(float(np.max(np.abs(whole.force))), 1.0)
        force = found.columns("link_force_on_aft_*_N")
        lines.append(
            judge(
                given,
                "force",
                relative(force, whole.force, size),
                bound,
                found,
                resolved=length <= 30.0,
            )
        )
    for kind in ("spherical", "revolute", "universal", "fixed"):
        tree = pair(
            kind, fore=FORE | {"cg_m": [2.0, 0.0, 0.0]}, aft=AFT | {"cg_m": [2.0, 0.0, 0.0]}
        )
        tree["joint"]["link"]["point_m"] = [2.0, 0.0, 0.0]
        found = fly(tree)
        forces = found.columns("link_force_on_aft_*_N")
        lines.append(
            judge(
                f"{kind} at both mass centres",
                "force over 1 N",
                float(np.max(np.abs(forces))),
                FORM,
                found,
                resolved=True,
            )
        )
    return lines


def long_pendulum() -> list[Stress]:
    """A small body on a ball joint to the ground 1 km away, let go at 60 deg: a plane pendulum."""
    lines = []
    for length in (1.0, 1e3):
        bob = body(2.0, [0.02, 0.03, 0.03], [length, 0.0, 0.0])
        swing = scene({"bob": bob}, {"ball": joint("ground", "bob", [0.0, 0.0, 0.0])},
        held(ball="spherical"), 10.0, 0.02,
                      environment={"gravity": "constant"}, initial={"pitch_deg": 30.0})  # fmt: skip
        # m L^2 over J: how much the tension's moment would turn the body
        bound = conditioned(length * length / 0.015)
        given = f"ball joint {length:g} m away"
        found = fly(swing)
        g = found.scene.environment.surface_gravity
        frequency = math.sqrt(2.0 * g * length / (0.03 + 2.0 * length**2))
        # along -x: hangs straight down at pitch +90 deg
        to_centre = -arm(found.scene, "bob", [0.0, 0.0, 0.0])
        assert to_centre[0] < 0.0
        angle, rate = ref.pendulum(found.t, frequency, math.radians(30.0 - 90.0))
        largest = frequency * 2.0 * math.sin(math.radians(30.0))  # the rate at the bottom
        lines.append(
            judge(
                given,
                "rate",
                relative(found.body("bob").w[:, 2], rate, largest),
                bound,
                found,
                resolved=True,
            )
        )
        down = np.stack([np.sin(angle), -np.cos(angle), np.zeros_like(angle)], axis=1)
        lines.append(
            judge(
                given,
                "direction",
                relative(-found.body("bob").r[:, :, 0], down),
                bound,
                found,
                resolved=True,
            )
        )
    return lines
