"""Motors, springs and constant loads of a random scene."""

import math

from oracles.random_scenes.draft import GROUND, Draft, Tree
from oracles.random_scenes.rng import rounded


def add_loads(draft: Draft) -> None:
    """Add motors, springs and loads with random options; motors that phases wait for get options
    too."""
    rng, tree = draft.rng, draft.tree
    if draft.special == "still":
        return
    for motor in tree.get("motor", []):
        _options(draft, motor)
    for _ in range(rng.weighted_choice({0: 0.3, 1: 0.45, 2: 0.25})):
        add_motor(draft)
    for _ in range(rng.weighted_choice({0: 0.5, 1: 0.35, 2: 0.15})):
        _add_spring(draft)
    for _ in range(rng.weighted_choice({0: 0.5, 1: 0.35, 2: 0.15})):
        _add_load(draft)


def add_motor(draft: Draft) -> None:
    """Add a motor with random options."""
    rng = draft.rng
    body = rng.choice(draft.bodies)
    station = rounded(draft.cg(body)[0] + rng.uniform(-0.5, 0.8))
    motor = {
        "name": draft.names.new("motor"),
        "body": body,
        "thrust_N": _force(draft, body),
        "station_m": station,
    }
    if rng.chance(0.3):
        motor["burn_s"] = rng.uniform(0.1, 0.9) * draft.span
    if rng.chance(0.35):
        motor["ignition_s"] = rng.uniform(0.05, 0.6) * draft.span
    _options(draft, motor)
    draft.tree.setdefault("motor", []).append(motor)


def add_force_tables(draft: Draft) -> None:
    """Give some springs a table of force over extension besides what they have."""
    rng = draft.rng
    for spring in draft.tree.get("spring", []):
        if not rng.chance(0.25):
            continue
        count = rng.choice([2, 3, 4, 6])
        steps = [rng.uniform(0.01, 0.1) for _ in range(count - 1)]
        first = rng.choice([0.0, 0.0, -0.005])
        force = max(abs(spring.get("force_N", 0.0)), 10.0)
        spring["table"] = {
            "extension_m": [rounded(first + sum(steps[:k])) for k in range(count)],
            "force_N": [rounded(force * rng.uniform(-0.2, 1.0)) for _ in range(count)],
        }


def cut_pulls(draft: Draft) -> None:
    """Let most springs only push."""
    for spring in draft.tree.get("spring", []):
        if "push only" in draft.late and draft.rng.chance(0.8):
            spring["push_only"] = True


def _force(draft: Draft, body: str) -> float:
    """Thrust, N, that accelerates a body by 1 to 25 m/s2."""
    return rounded(draft.mass(body) * draft.rng.uniform(1.0, 25.0))


def _options(draft: Draft, motor: Tree) -> None:
    """Add options of a motor besides thrust and position."""
    rng, span = draft.rng, draft.span
    if rng.chance(0.35):
        motor["build_up_s"] = rng.uniform(0.01, 0.1)
    if rng.chance(0.2):
        motor["delay_s"] = rng.uniform(0.002, 0.05)
    if rng.chance(0.35):
        motor["tail_off_s"] = rng.uniform(0.01, 0.1)
    if rng.chance(0.3):
        rows = rng.choice([2, 3, 4])
        times = [rounded(rng.uniform(0.3, 1.2) * span * row / (rows - 1)) for row in range(rows)]
        if times == sorted(set(times)):
            motor["profile"] = {
                "time_s": times,
                "fraction": [rng.uniform(0.1, 1.3) for _ in times],
            }
    for key, size, chance in (
        ("radius_m", 0.3, 0.3),
        ("cant_deg", 200.0, 0.6),
        ("clock_deg", 180.0, 0.4),
    ):
        if rng.chance(chance):
            motor[key] = abs(rng.symmetric(size)) if key == "radius_m" else rng.symmetric(size)
    for key, value in (
        ("offset_m", rng.vector(0.02, 2)),
        ("deflection_deg", rng.symmetric(3.0)),
        ("deflection_clock_deg", rng.symmetric(180.0)),
    ):
        if rng.chance(0.3):
            motor[key] = value


def add_late_profiles(draft: Draft) -> None:
    """Add thrust profiles that begin some time after the ignition, to half of the motors."""
    rng, span = draft.rng, draft.span
    if "late profile" not in draft.late:
        return
    for motor in draft.tree.get("motor", []):
        late = rng.uniform(0.02, 0.4) * span
        rows = motor.get("profile") or {
            "time_s": [0.0, rng.uniform(0.1, 0.9) * span],
            "fraction": [rng.uniform(0.0, 1.3) for _ in range(2)],
        }
        if rng.chance(0.5):
            times = [rounded(late + time) for time in rows["time_s"]]
            motor["profile"] = {**rows, "time_s": times}


def _add_spring(draft: Draft) -> None:
    """Add a spring along an axis or between its points, between two bodies or from the ground."""
    rng = draft.rng
    bodies = rng.subset(draft.bodies, 2)
    if rng.chance(0.12):
        bodies[0] = GROUND
    if rng.chance(0.5):
        bodies.reverse()
    centres = [draft.cg(body) for body in bodies if body != GROUND]
    point = [
        rounded(x + rng.symmetric(0.15))
        for x in (sum(c) / len(c) for c in zip(*centres, strict=True))
    ]
    reduced, turns = draft.reduced(bodies), rng.uniform(3.0, 30.0)
    spring: Tree = {"name": draft.names.new("spring"), "bodies": bodies, "point_m": point}
    if rng.chance(0.5):
        spring["axis"] = rng.direction()
    if "axis" not in spring or rng.chance(0.3):
        other = rng.direction()
        spring["second_point_m"] = [
            rounded(x + 0.4 * y / math.hypot(*other)) for x, y in zip(point, other, strict=True)
        ]
    if rng.chance(0.8):
        spring["force_N"] = rounded(reduced * rng.symmetric(30.0))
    if rng.chance(0.6):
        spring["stiffness_N_per_m"] = rounded(reduced * turns**2)
    if rng.chance(0.4):
        spring["damping_N_s_per_m"] = rounded(2.0 * rng.uniform(0.05, 0.7) * reduced * turns)
    if rng.chance(0.4):
        spring["stroke_m"] = rng.log_uniform(1e-3, 0.1)
    if rng.chance(0.2):
        spring["factor"] = rng.choice([0.0, 0.5, 1.2])
    draft.tree.setdefault("spring", []).append(spring)


def _add_load(draft: Draft) -> None:
    """Add a constant load in body or ground axes, with start and end in some."""
    rng = draft.rng
    body = rng.choice(draft.bodies)
    force = [rounded(draft.mass(body) * x) for x in rng.vector(15.0)]
    load: Tree = {"name": draft.names.new("load"), "body": body}
    if rng.chance(0.8):
        load["force_N"] = force
    if rng.chance(0.5):
        load["moment_N_m"] = [
            rounded(x * sum(draft.tree["body"][body]["inertia_kg_m2"]) / 3.0)
            for x in rng.vector(8.0)
        ]
    if rng.chance(0.5):
        load["frame"] = "ground"
    if rng.chance(0.5):
        load["point_m"] = [rounded(x + rng.symmetric(0.3)) for x in draft.cg(body)]
    if rng.chance(0.35):
        load["start_s"] = rounded(rng.uniform(0.05, 0.6) * draft.span)
    if rng.chance(0.35):
        load["end_s"] = rounded(load.get("start_s", 0.0) + rng.uniform(0.05, 0.7) * draft.span)
    draft.tree.setdefault("load", []).append(load)
