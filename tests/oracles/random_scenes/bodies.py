"""Bodies of a random scene, their air, and how they start."""

import math

from oracles.random_scenes.draft import Draft, Tree

_RHO0, _SCALE_HEIGHT = 1.225, 7000.0  # kg/m3, m: about the air, to choose areas by
_TERMS = (
    "const",
    "alpha",
    "alpha2",
    "alpha3",
    "beta",
    "beta2",
    "beta3",
    "alpha_beta",
    "alpha2_beta2",
    "alpha_beta2",
    "alpha4",
)


def add_environment(draft: Draft) -> None:
    """Gravity, air and wind."""
    dice, still = draft.dice, draft.special == "still"
    environment: Tree = {
        "atmosphere": "none" if still else dice.weighted({"us1976": 0.6, "none": 0.4}),
        "gravity": "none"
        if still
        else dice.weighted({"inverse-square": 0.4, "constant": 0.35, "none": 0.25}),
    }
    if dice.chance(0.2):
        environment["surface_gravity_m_s2"] = dice.between(1.0, 15.0)
    if dice.chance(0.2):
        environment["density_factor"] = dice.weighted({0.0: 0.15, dice.between(0.5, 1.5): 0.85})
    if not still and dice.chance(0.5):
        environment["wind"] = {
            "speed_m_s": dice.between(0.0, 40.0),
            "direction_deg": dice.between(0.0, 360.0),
        }
    draft.tree["environment"] = environment


def add_bodies(draft: Draft) -> None:
    """Two to five bodies, one behind the other."""
    dice = draft.dice
    scale = dice.decades(1.0, 1000.0)
    count = dice.weighted({2: 0.45, 3: 0.3, 4: 0.15, 5: 0.1})
    for number in range(count):
        mass = dice.between(0.3 * scale, scale)
        on_axis = draft.special in ("symmetric", "concentric")
        aside = [0.0, 0.0] if on_axis else dice.vector(0.05, 2)
        station = 1.0 if draft.special == "concentric" else 1.0 + 1.4 * number + dice.about(0.2)
        body: Tree = {"mass_kg": mass, "cg_m": [station, *aside], **_inertia(draft, mass)}
        draft.tree["body"][draft.names.new("body")] = body


def _inertia(draft: Draft, mass: float) -> Tree:
    """Moments and products that a solid body has: from second moments of its mass along its axes,
    kg m2."""
    dice = draft.dice
    along, up, side = (dice.between(0.03, 0.3) * mass for _ in range(3))
    sort = dice.weighted({"any": 0.65, "round": 0.15, "sphere": 0.1, "flat": 0.1})
    if sort == "round" or draft.special == "symmetric":
        side = up
    elif sort == "sphere":
        along = up = side
    elif sort == "flat":
        along = 0.0
    found: Tree = {"inertia_kg_m2": [up + side, along + side, along + up]}
    if sort == "any" and draft.special != "symmetric" and dice.chance(0.6):
        sizes = (math.sqrt(along * up), math.sqrt(along * side), math.sqrt(up * side))
        found["inertia_products_kg_m2"] = [dice.about(0.3) * size for size in sizes]
    if dice.chance(0.15):
        found["inertia_factor"] = dice.between(0.8, 1.2)
    return found


def add_air(draft: Draft) -> None:
    """Polynomial aerodynamics, of a size that moves a body by some m/s2."""
    dice, initial = draft.dice, draft.tree["initial"]
    if draft.special == "still":
        return
    density = _RHO0 * math.exp(-max(0.0, initial["altitude_m"]) / _SCALE_HEIGHT)
    wind = draft.tree["environment"].get("wind", {}).get("speed_m_s", 0.0)
    pressure = max(0.5 * density * max(initial["speed_m_s"], wind, 10.0) ** 2, 1e-3)
    for body in draft.tree["body"].values():
        if not dice.chance(0.6 if draft.tree["environment"]["atmosphere"] != "none" else 0.15):
            continue
        aero: Tree = {
            "reference_area_m2": min(100.0, body["mass_kg"] * dice.between(0.5, 10.0) / pressure),
            "reference_length_m": dice.between(0.2, 1.0),
            "axial": {"const": dice.between(0.1, 0.8)},
        }
        for name in ("axial", "normal", "side", "roll", "yaw", "pitch"):
            size = 1.0 if name in ("axial", "normal", "side") else 0.2
            for term in dice.some(_TERMS, dice.pick([0, 1, 2, 3])):
                aero.setdefault(name, {})[term] = dice.about(size)
        for key in ("force_factor", "moment_factor"):
            if dice.chance(0.2):
                aero[key] = dice.weighted({0.0: 0.1, dice.between(0.5, 1.5): 0.9})
        if dice.chance(0.3):
            aero["moment_point_m"] = [x + dice.about(0.1) for x in body["cg_m"]]
        body["aerodynamics"] = aero


def add_start(draft: Draft) -> None:
    """Height, speed, rates and attitude. What is held to the ground starts at rest, or turns about
    the joint that holds it."""
    dice, still = draft.dice, draft.special == "still"
    air = draft.tree["environment"]["atmosphere"] == "us1976"
    low = dice.chance(0.3)
    initial: Tree = {
        "altitude_m": dice.between(300.0, 3000.0)
        if low
        else dice.between(300.0, 80000.0)
        if air
        else dice.between(-100.0, 4e5),
        "speed_m_s": 0.0
        if still
        else dice.weighted(
            {0.0: 0.1, dice.between(5.0, 300.0): 0.6, dice.between(300.0, 7000.0): 0.3}
        ),
    }
    if dice.chance(0.6) and not still:
        initial["omega_deg_s"] = dice.vector(dice.pick([10.0, 80.0]))
    for key, size in (
        ("alpha", 8.0),
        ("pitch", 60.0),
        ("yaw", 40.0),
        ("roll", 120.0),
        ("path_yaw", 10.0),
        ("path_reference", 20.0),
    ):
        if dice.chance(0.2 if key.startswith("path") else 0.6):
            initial[f"{key}_deg"] = dice.about(size)
    draft.tree["initial"] = initial
