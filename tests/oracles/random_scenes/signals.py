"""Formulas of a random scene: signals over time and state in place of numbers of its loads."""

from oracles.random_scenes.draft import Draft, Tree
from oracles.random_scenes.rng import rounded

_KIND = "signal"
# quantity, and a number of its unit over which it changes much
_OF_BODY = {
    "pitch_deg": 3.0, "yaw_rad": 0.05, "roll_deg": 3.0, "omega_x_deg_s": 10.0,
    "omega_y_rad_s": 0.2, "omega_z_deg_s": 10.0, "vx_m_s": 20.0, "vy_m_s": 20.0, "vz_km_h": 20.0,
    "x_m": 5.0, "z_ft": 5.0, "alpha_deg": 5.0, "beta_rad": 0.1, "airspeed_m_s": 20.0,
}  # fmt: skip


def add_signals(draft: Draft) -> None:
    """Put the names of one to three signals in place of numbers of loads, motors and springs."""
    rng, tree = draft.rng, draft.tree
    places = _places(tree)
    if _KIND not in draft.late or not places or draft.special == "still":
        return
    signals: list[Tree] = []
    for number in range(min(len(places), rng.choice([1, 1, 2, 3]))):
        table, key, component = places.pop(int(rng.generator.integers(len(places))))
        size = table[key] if component is None else table[key][component]
        name = f"signal{number + 1}"
        signals.append(_signal(draft, name, float(size) or 1.0, [s["name"] for s in signals]))
        if component is None:
            table[key] = name
        else:
            table[key] = [name if k == component else x for k, x in enumerate(table[key])]
    tree["signal"] = signals


def add_control_terms(draft: Draft) -> None:
    """Let signals act on coefficients of bodies in the air."""
    rng, tree = draft.rng, draft.tree
    bodies = [body["aerodynamics"] for body in tree["body"].values() if "aerodynamics" in body]
    if "control derivative" not in draft.late or not bodies:
        return
    tree.setdefault("signal", [_signal(draft, "signal1", 1.0, [])])
    for signal in tree["signal"]:
        aero = rng.choice(bodies)
        for key in rng.subset(("axial", "normal", "side", "roll", "yaw", "pitch"), 2):
            part = rng.symmetric(0.2) / (abs(signal["size"]) or 1.0)
            aero[key] = {**aero.get(key, {}), signal["name"]: rounded(part)}


def _places(tree: Tree) -> list[tuple[Tree, str, int | None]]:
    """Tables, keys and components of the numbers that a signal may give."""
    places: list[tuple[Tree, str, int | None]] = []
    for load in tree.get("load", []):
        for key in ("force_N", "moment_N_m"):
            places += [(load, key, k) for k in range(3) if key in load]
    for motor in tree.get("motor", []):
        places += [(motor, key, None) for key in ("thrust_N", "deflection_deg") if key in motor]
    for spring in tree.get("spring", []):
        keys = ("force_N", "stiffness_N_per_m", "factor")
        places += [(spring, key, None) for key in keys if key in spring]
    return places


def _signal(draft: Draft, name: str, size: float, others: list[str]) -> Tree:
    """Signal of about a size."""
    rng = draft.rng
    terms = [_term(draft) for _ in range(rng.choice([1, 1, 2, 3]))]
    formula = terms[0]
    for term in terms[1:]:
        formula = f"{formula} {rng.choice(['+', '-', '*'])} {term}"
    if others and rng.chance(0.3):
        # signals have sizes of their own
        formula = f"{formula} + 0.3 * sin({rng.choice(others)})"
    if rng.chance(0.2):
        formula = f"clip({formula}, {-rng.uniform(0.2, 1.0)}, {rng.uniform(0.2, 1.0)})"
    return {
        "name": name,
        "formula": f"size * ({formula})",
        "size": rounded(size),
        **_response(draft, size),
    }


def _response(draft: Draft, size: float) -> Tree:
    """Lag, servo or integral of some signals, and samples of some."""
    rng, span = draft.rng, draft.span
    kind = rng.weighted_choice({"": 0.6, "lag": 0.15, "servo": 0.15, "integral": 0.1})
    keys: Tree = {}
    if kind == "lag":
        keys["lag_s"] = rounded(rng.uniform(0.05, 0.5) * span)
        if rng.chance(0.3):
            keys["rate_limit"] = rounded(abs(size) * rng.uniform(0.5, 5.0) / span)
    elif kind == "servo":
        natural = rounded(rng.uniform(0.5, 4.0) / span)
        keys["servo"] = {"natural_hz": natural, "damping": rng.uniform(0.2, 1.2)}
    elif kind == "integral":
        keys["integral"] = True
    if rng.chance(0.25):
        keys["sample_s"] = rounded(rng.uniform(0.05, 0.4) * span)
        if rng.chance(0.5):
            keys["delay_ms"] = rounded(1e3 * keys["sample_s"] * rng.uniform(0.1, 0.9))
    if kind and rng.chance(0.5):
        keys["initial"] = rounded(size * rng.symmetric(1.0))
    return keys


def _term(draft: Draft) -> str:
    """A term of about 1: smooth, with a kink, or with a jump."""
    rng = draft.rng
    x = _argument(draft)
    y = _argument(draft)
    a, b, c = (rng.uniform(0.2, 1.5) for _ in range(3))
    over_time = rng.chance(0.5)
    at = f"time_s < {rounded(rng.uniform(0.1, 0.9) * draft.span)}" if over_time else f"{x} < {a}"
    smooth = [
        f"{a}",
        f"sin({b} * {x} + {c})",
        f"exp(-{a} * time_s / {draft.span})",
        f"{x} / sqrt(1 + ({x}) ** 2)",
        f"{a} * cos({rounded(rng.uniform(3.0, 30.0))} * time_s)",
        f"atan2({x}, {b} + time_ms / 1000)",
        f"log(1 + ({x}) ** 2) * {a}",
        f"({a} + time_s) ** {rng.choice(['2', '3', '0.5', '-1.5'])}",
        f"tan({b} * sin({x}))",
    ]
    kinked = [
        f"abs(sin({x}) - {a} * 0.5)",
        f"max({x} / sqrt(1 + ({x}) ** 2), {rng.symmetric(0.5)})",
        f"min(sin({x}), cos({y}))",
        f"clip({x}, {-a}, {b})",
        f"sqrt(max(sin({x}), 0) ** 3)",
    ]
    jumping = [
        f"where({at}, {a}, {b})",
        f"where({at} and time_s > {rounded(0.05 * draft.span)}, {a}, -{c})",
        f"sign(time_s - {rounded(0.4 * draft.span)})",
        f"where(not ({at} or {y} > {c}), {a}, sin({x}))",
    ]
    kind = rng.weighted_choice({"smooth": 0.6, "kinked": 0.25, "jumping": 0.15})
    return rng.choice({"smooth": smooth, "kinked": kinked, "jumping": jumping}[kind])


def _argument(draft: Draft) -> str:
    """A quantity over a number of its size."""
    rng, tree = draft.rng, draft.tree
    choices = [("time_s", draft.span)]
    body = rng.choice(draft.bodies)
    quantity = rng.choice(list(_OF_BODY))
    choices += [(f"{body}.{quantity}", _OF_BODY[quantity])] * 3
    for name in list(tree.get("joint", {}))[:2]:
        choices += [(f"joint.{name}.stroke_mm", 20.0), (f"joint.{name}.rate_m_s", 0.5)]
    for spring in tree.get("spring", [])[:1]:
        choices += [(f"spring.{spring['name']}.extension_m", 0.05)]
    name, size = rng.choice(choices)
    return f"{name} / {size}"
