"""Bodies of a random scene, their aerodynamics, and the initial state."""

import math

from oracles.random_scenes.draft import Draft, Tree

# rough density, kg/m3, and scale height, m, for the choice of areas
_RHO0, _SCALE_HEIGHT = 1.225, 7000.0
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
    """Add gravity, atmosphere and wind."""
    rng, still = draft.rng, draft.special == "still"
    environment: Tree = {
        "atmosphere": "none" if still else rng.weighted_choice({"us1976": 0.6, "none": 0.4}),
        "gravity": "none"
        if still
        else rng.weighted_choice({"inverse-square": 0.4, "constant": 0.35, "none": 0.25}),
    }
    if rng.chance(0.2):
        environment["surface_gravity_m_s2"] = rng.uniform(1.0, 15.0)
    if rng.chance(0.2):
        environment["density_factor"] = rng.weighted_choice(
            {0.0: 0.15, rng.uniform(0.5, 1.5): 0.85}
        )
    if not still and rng.chance(0.5):
        environment["wind"] = {
            "speed_m_s": rng.uniform(0.0, 40.0),
            "direction_deg": rng.uniform(0.0, 360.0),
        }
    draft.tree["environment"] = environment


def add_bodies(draft: Draft) -> None:
    """Add two to five bodies, one behind the other."""
    rng = draft.rng
    scale = rng.log_uniform(1.0, 1000.0)
    count = rng.weighted_choice({2: 0.45, 3: 0.3, 4: 0.15, 5: 0.1})
    for number in range(count):
        mass = rng.uniform(0.3 * scale, scale)
        on_axis = draft.special in ("symmetric", "concentric")
        aside = [0.0, 0.0] if on_axis else rng.vector(0.05, 2)
        station = 1.0 if draft.special == "concentric" else 1.0 + 1.4 * number + rng.symmetric(0.2)
        body: Tree = {"mass_kg": mass, "cg_m": [station, *aside], **_inertia(draft, mass)}
        draft.tree["body"][draft.names.new("body")] = body


def _inertia(draft: Draft, mass: float) -> Tree:
    """Moments and products of inertia, kg m2, of a possible solid body: from second moments of its
    mass along its axes."""
    rng = draft.rng
    along, up, side = (rng.uniform(0.03, 0.3) * mass for _ in range(3))
    sort = rng.weighted_choice({"any": 0.65, "round": 0.15, "sphere": 0.1, "flat": 0.1})
    if sort == "round" or draft.special == "symmetric":
        side = up
    elif sort == "sphere":
        along = up = side
    elif sort == "flat":
        along = 0.0
    inertia: Tree = {"inertia_kg_m2": [up + side, along + side, along + up]}
    if sort == "any" and draft.special != "symmetric" and rng.chance(0.6):
        sizes = (math.sqrt(along * up), math.sqrt(along * side), math.sqrt(up * side))
        inertia["inertia_products_kg_m2"] = [rng.symmetric(0.3) * size for size in sizes]
    if rng.chance(0.15):
        inertia["inertia_factor"] = rng.uniform(0.8, 1.2)
    return inertia


def add_air(draft: Draft) -> None:
    """Add polynomial aerodynamics that accelerate a body by some m/s2."""
    rng, initial = draft.rng, draft.tree["initial"]
    if draft.special == "still":
        return
    density = _RHO0 * math.exp(-max(0.0, initial["altitude_m"]) / _SCALE_HEIGHT)
    wind = draft.tree["environment"].get("wind", {}).get("speed_m_s", 0.0)
    pressure = max(0.5 * density * max(initial["speed_m_s"], wind, 10.0) ** 2, 1e-3)
    for body in draft.tree["body"].values():
        if not rng.chance(0.6 if draft.tree["environment"]["atmosphere"] != "none" else 0.15):
            continue
        aero: Tree = {
            "reference_area_m2": min(100.0, body["mass_kg"] * rng.uniform(0.5, 10.0) / pressure),
            "reference_length_m": rng.uniform(0.2, 1.0),
            "axial": {"const": rng.uniform(0.1, 0.8)},
        }
        for name in ("axial", "normal", "side", "roll", "yaw", "pitch"):
            size = 1.0 if name in ("axial", "normal", "side") else 0.2
            for term in rng.subset(_TERMS, rng.choice([0, 1, 2, 3])):
                aero.setdefault(name, {})[term] = rng.symmetric(size)
        for key in ("force_factor", "moment_factor"):
            if rng.chance(0.2):
                aero[key] = rng.weighted_choice({0.0: 0.1, rng.uniform(0.5, 1.5): 0.9})
        if rng.chance(0.3):
            aero["moment_point_m"] = [x + rng.symmetric(0.1) for x in body["cg_m"]]
        body["aerodynamics"] = aero


def add_start(draft: Draft) -> None:
    """Add altitude, speed, angular rates and attitude."""
    rng, still = draft.rng, draft.special == "still"
    air = draft.tree["environment"]["atmosphere"] == "us1976"
    low = rng.chance(0.3)
    initial: Tree = {
        "altitude_m": rng.uniform(300.0, 3000.0)
        if low
        else rng.uniform(300.0, 80000.0)
        if air
        else rng.uniform(-100.0, 4e5),
        "speed_m_s": 0.0
        if still
        else rng.weighted_choice(
            {0.0: 0.1, rng.uniform(5.0, 300.0): 0.6, rng.uniform(300.0, 7000.0): 0.3}
        ),
    }
    if rng.chance(0.6) and not still:
        initial["omega_deg_s"] = rng.vector(rng.choice([10.0, 80.0]))
    for key, size in (
        ("alpha", 8.0),
        ("pitch", 60.0),
        ("yaw", 40.0),
        ("roll", 120.0),
        ("path_yaw", 10.0),
        ("path_reference", 20.0),
    ):
        if rng.chance(0.2 if key.startswith("path") else 0.6):
            initial[f"{key}_deg"] = rng.symmetric(size)
    draft.tree["initial"] = initial
