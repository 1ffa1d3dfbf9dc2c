"""Motors, springs and constant loads of a random scene."""

import math

from oracles.random_scenes.draft import GROUND, Draft, Tree
from oracles.random_scenes.rng import rounded


def add_loads(draft: Draft) -> None:
    """Some motors, springs and loads, each with some of what it may have; what motors the phases
    need already gets options too."""
    dice, tree = draft.dice, draft.tree
    if draft.special == "still":
        return
    for motor in tree.get("motor", []):
        _options(draft, motor)
    for _ in range(dice.weighted({0: 0.3, 1: 0.45, 2: 0.25})):
        add_motor(draft)
    for _ in range(dice.weighted({0: 0.5, 1: 0.35, 2: 0.15})):
        _add_spring(draft)
    for _ in range(dice.weighted({0: 0.5, 1: 0.35, 2: 0.15})):
        _add_load(draft)


def add_motor(draft: Draft) -> None:
    """A motor somewhere, with some of what it may have."""
    dice = draft.dice
    body = dice.pick(draft.bodies)
    station = rounded(draft.cg(body)[0] + dice.between(-0.5, 0.8))
    motor = {
        "name": draft.names.new("motor"),
        "body": body,
        "thrust_N": _force(draft, body),
        "station_m": station,
    }
    if dice.chance(0.3):
        motor["burn_s"] = dice.between(0.1, 0.9) * draft.span
    if dice.chance(0.35):
        motor["ignition_s"] = dice.between(0.05, 0.6) * draft.span
    _options(draft, motor)
    draft.tree.setdefault("motor", []).append(motor)


def _force(draft: Draft, body: str) -> float:
    return rounded(draft.mass(body) * draft.dice.between(1.0, 25.0))


def _options(draft: Draft, motor: Tree) -> None:
    """What a motor may have besides thrust and place."""
    dice, span = draft.dice, draft.span
    if dice.chance(0.35):
        motor["build_up_s"] = dice.between(0.01, 0.1)
    if dice.chance(0.2):
        motor["delay_s"] = dice.between(0.002, 0.05)
    if dice.chance(0.35):
        motor["tail_off_s"] = dice.between(0.01, 0.1)
    if dice.chance(0.3):
        rows = dice.pick([2, 3, 4])
        times = [rounded(dice.between(0.3, 1.2) * span * row / (rows - 1)) for row in range(rows)]
        if times == sorted(set(times)):
            motor["profile"] = {
                "time_s": times,
                "fraction": [dice.between(0.1, 1.3) for _ in times],
            }
    for key, size, chance in (
        ("radius_m", 0.3, 0.3),
        ("cant_deg", 200.0, 0.6),
        ("clock_deg", 180.0, 0.4),
    ):
        if dice.chance(chance):
            motor[key] = abs(dice.about(size)) if key == "radius_m" else dice.about(size)
    for key, value in (
        ("offset_m", dice.vector(0.02, 2)),
        ("deflection_deg", dice.about(3.0)),
        ("deflection_clock_deg", dice.about(180.0)),
    ):
        if dice.chance(0.3):
            motor[key] = value


def add_late_profiles(draft: Draft) -> None:
    """Thrust that begins some time after the ignition, of half the motors there are."""
    dice, span = draft.dice, draft.span
    if "late profile" not in draft.late:
        return
    for motor in draft.tree.get("motor", []):
        late = dice.between(0.02, 0.4) * span
        rows = motor.get("profile") or {
            "time_s": [0.0, dice.between(0.1, 0.9) * span],
            "fraction": [dice.between(0.0, 1.3) for _ in range(2)],
        }
        if dice.chance(0.5):
            times = [rounded(late + time) for time in rows["time_s"]]
            motor["profile"] = {**rows, "time_s": times}


def _add_spring(draft: Draft) -> None:
    """A spring along an axis or along the line between its points, between two bodies or from the
    ground."""
    dice = draft.dice
    bodies = dice.some(draft.bodies, 2)
    if dice.chance(0.12):
        bodies[0] = GROUND
    if dice.chance(0.5):
        bodies.reverse()
    centres = [draft.cg(body) for body in bodies if body != GROUND]
    point = [
        rounded(x + dice.about(0.15)) for x in (sum(c) / len(c) for c in zip(*centres, strict=True))
    ]
    reduced, turns = draft.reduced(bodies), dice.between(3.0, 30.0)
    spring: Tree = {"name": draft.names.new("spring"), "bodies": bodies, "point_m": point}
    if dice.chance(0.5):
        spring["axis"] = dice.direction()
    if "axis" not in spring or dice.chance(0.3):
        other = dice.direction()
        spring["second_point_m"] = [
            rounded(x + 0.4 * y / math.hypot(*other)) for x, y in zip(point, other, strict=True)
        ]
    if dice.chance(0.8):
        spring["force_N"] = rounded(reduced * dice.about(30.0))
    if dice.chance(0.6):
        spring["stiffness_N_per_m"] = rounded(reduced * turns**2)
    if dice.chance(0.4):
        spring["damping_N_s_per_m"] = rounded(2.0 * dice.between(0.05, 0.7) * reduced * turns)
    if dice.chance(0.4):
        spring["stroke_m"] = dice.decades(1e-3, 0.1)
    if dice.chance(0.2):
        spring["factor"] = dice.pick([0.0, 0.5, 1.2])
    draft.tree.setdefault("spring", []).append(spring)


def _add_load(draft: Draft) -> None:
    """A constant load in body or ground axes, that may begin late and end."""
    dice = draft.dice
    body = dice.pick(draft.bodies)
    force = [rounded(draft.mass(body) * x) for x in dice.vector(15.0)]
    load: Tree = {"name": draft.names.new("load"), "body": body}
    if dice.chance(0.8):
        load["force_N"] = force
    if dice.chance(0.5):
        load["moment_N_m"] = [
            rounded(x * sum(draft.tree["body"][body]["inertia_kg_m2"]) / 3.0)
            for x in dice.vector(8.0)
        ]
    if dice.chance(0.5):
        load["frame"] = "ground"
    if dice.chance(0.5):
        load["point_m"] = [rounded(x + dice.about(0.3)) for x in draft.cg(body)]
    if dice.chance(0.35):
        load["start_s"] = rounded(dice.between(0.05, 0.6) * draft.span)
    if dice.chance(0.35):
        load["end_s"] = rounded(load.get("start_s", 0.0) + dice.between(0.05, 0.7) * draft.span)
    draft.tree.setdefault("load", []).append(load)
