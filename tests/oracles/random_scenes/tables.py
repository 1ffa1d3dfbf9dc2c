"""Tables of a random scene: wind and air over height, aerodynamic coefficients, increments over a
distance."""

import math
from typing import Any

from oracles.random_scenes.draft import Draft, Tree
from oracles.random_scenes.rng import rounded

COEFFICIENTS = ("axial", "normal", "side", "roll", "yaw", "pitch")
_SOUND = 300.0  # m/s, about


def add_profiles(draft: Draft) -> None:
    """Add wind and air over the heights of the trajectory; sometimes it leaves the table of the
    air."""
    rng, environment, initial = draft.rng, draft.tree["environment"], draft.tree["initial"]
    reach = max(30.0, initial["speed_m_s"] * draft.span)
    if "wind profile" in draft.late:
        heights = _axis(draft, initial["altitude_m"], 0.6 * reach, rng.choice([2, 3, 5]))
        environment.setdefault("wind", {})["profile"] = {
            "altitude_m": heights,
            "speed_m_s": [rng.symmetric(40.0) for _ in heights],
            "direction_deg": [rng.uniform(0.0, 360.0) for _ in heights],
        }
    if "table of the air" in draft.late:
        heights = _axis(
            draft,
            initial["altitude_m"],
            reach * rng.weighted_choice({2.0: 0.85, 0.4: 0.15}),
            rng.choice([2, 4, 6]),
        )
        density = [
            rounded(0.8 * math.exp(-(h - heights[0]) / 7000.0) * rng.uniform(0.8, 1.2))
            for h in heights
        ]
        environment["atmosphere"] = "table"
        environment["air"] = {
            "altitude_m": heights,
            "density_kg_per_m3": density,
            "speed_of_sound_m_s": [rng.uniform(280.0, 340.0) for _ in heights],
        }


def add_aero_tables(draft: Draft) -> None:
    """Add coefficients on grids over some of Mach, alpha and beta around the initial flow; some are
    left on the way."""
    rng, initial = draft.rng, draft.tree["initial"]
    if "aerodynamic table" not in draft.late:
        return
    wind = draft.tree["environment"].get("wind", {}).get("speed_m_s", 0.0)
    for body in draft.tree["body"].values():
        if "aerodynamics" not in body or not rng.chance(0.8):
            continue
        mach = initial["speed_m_s"] / _SOUND
        wide = (
            180.0
            if initial["speed_m_s"] < 3.0 * wind
            else rng.weighted_choice({180.0: 0.6, 60.0: 0.4})
        )
        axes = {
            "mach": [rounded(x) for x in _axis(draft, mach, max(0.3, mach), rng.choice([2, 3, 5]))],
            "alpha_deg": _axis(draft, 0.0, wide, rng.choice([3, 5])),
            "beta_deg": _axis(draft, 0.0, 0.5 * wide, rng.choice([2, 4])),
        }
        chosen = rng.subset(list(axes), rng.choice([1, 1, 2, 3]))
        table: Tree = {axis: axes[axis] for axis in chosen}
        shape = [len(table[axis]) for axis in chosen]
        for name in rng.subset(COEFFICIENTS, rng.choice([1, 2, 4])):
            table[name] = _grid(draft, shape, 0.6 if name in ("axial", "normal", "side") else 0.1)
        body["aerodynamics"]["table"] = table


def add_increments(draft: Draft) -> None:
    """Add increments to the coefficients of bodies over the distance at a joint."""
    rng, tree = draft.rng, draft.tree
    with_air = [name for name, body in tree["body"].items() if "aerodynamics" in body]
    if "proximity" not in draft.late or not with_air or not tree["joint"]:
        return
    for _ in range(rng.choice([1, 2])):
        count, reach = rng.choice([2, 3, 5]), rng.log_uniform(0.02, 1.0)
        rows = [rounded(reach * (row + rng.uniform(0.0, 0.5)) / count) for row in range(count)]
        entry: Tree = {
            "name": draft.names.new("proximity"),
            "body": rng.choice(with_air),
            "joint": rng.choice(list(tree["joint"])),
            "distance_m": rows,
        }
        for name in rng.subset(COEFFICIENTS, rng.choice([1, 2, 6])):
            size = 0.5 if name in ("axial", "normal", "side") else 0.1
            entry[name] = [rng.symmetric(size) for _ in rows]
        if rng.chance(0.3):
            entry["factor"] = rng.uniform(0.0, 1.5)
        tree.setdefault("proximity", []).append(entry)


def vary_tables(draft: Draft) -> None:
    """Give tables other interpolations, springs corners and return factors, and increments axes of
    relative motion."""
    rng, tree = draft.rng, draft.tree
    if "table variant" not in draft.late:
        return
    environment = tree["environment"]
    tables = [environment.get("air"), environment.get("wind", {}).get("profile")]
    tables += [body.get("aerodynamics", {}).get("table") for body in tree["body"].values()]
    tables += [*tree.get("proximity", []), *(one.get("table") for one in tree.get("spring", []))]
    for table in filter(None, tables):
        table["interpolation"] = rng.weighted_choice({"linear": 0.6, "monotone": 0.2, "cubic": 0.2})
    for spring in tree.get("spring", []):
        table = spring.get("table", {})
        if table and rng.chance(0.4):
            later = rng.uniform(0.002, 0.02)
            table["extension_m"] = [rounded(x + later) for x in table["extension_m"]]
        if table and rng.chance(0.5):
            table["return_factor"] = rng.uniform(0.0, 1.0)
    for entry in tree.get("proximity", []):
        if rng.chance(0.6):
            _add_axes(draft, entry)


def _add_axes(draft: Draft, entry: Tree) -> None:
    """Replace the distance of increments by one to three axes of relative motion."""
    rng = draft.rng
    reach = max(abs(x) for x in entry.pop("distance_m"))
    names = rng.subset(["x", "y", "z", "pitch", "yaw", "roll"], rng.choice([1, 2, 2, 3]))
    axes = {
        f"{name}_m" if name in "xyz" else f"{name}_deg": _axis(
            draft,
            rng.symmetric(0.3 * reach if name in "xyz" else 3.0),
            reach if name in "xyz" else rng.uniform(3.0, 40.0),
            rng.choice([2, 3, 4]),
        )
        for name in names
    }
    shape = [len(points) for points in axes.values()]
    for name in [name for name in COEFFICIENTS if name in entry]:
        entry[name] = _grid(draft, shape, 0.5 if name in ("axial", "normal", "side") else 0.1)
    entry["axes"] = axes


def _axis(draft: Draft, middle: float, half: float, count: int) -> list[float]:
    """Strictly increasing points from ``middle - half`` to ``middle + half``, unevenly spaced."""
    step = 2.0 * half / (count - 1)
    inner = [middle - half + step * (row + draft.rng.symmetric(0.3)) for row in range(1, count - 1)]
    return [rounded(x, 8) for x in (middle - half, *inner, middle + half)]


def _grid(draft: Draft, shape: list[int], size: float) -> Any:
    """Nested lists of numbers up to ``size``."""
    flat: list[Any] = [draft.rng.symmetric(size) for _ in range(math.prod(shape))]
    for length in reversed(shape[1:]):
        flat = [flat[i : i + length] for i in range(0, len(flat), length)]
    return flat
