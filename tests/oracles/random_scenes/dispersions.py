"""Dispersions of a random scene over any of its numbers: paths come from the model itself, so new
fields are included."""

import math
from collections.abc import Iterator
from typing import Any, NamedTuple

import msgspec

from oracles.random_scenes.rng import RandomStream, rounded
from sepmc.scene.checks import check_dispersion
from sepmc.scene.dispersion import resolve
from sepmc.scene.fields import Field, fields_of
from sepmc.scene.initial_rates import check_initial_rates
from sepmc.scene.messages import Problems
from sepmc.scene.model import Distribution, NotNegative, Scene
from sepmc.scene.parameters import item_names, value

# angles that may vary over a full turn
_FULL_TURN = ("environment.wind.direction", "deflection_clock", "clock", "initial.roll")
# Numbers that decide on times of events: two more of them vary.
_TIMED = (
    "time",
    "delay",
    "fails",
    "ignition",
    "burn",
    "build_up",
    "tail_off",
    "start",
    "end",
    "stroke",
    "distance",
    "angle",
    "altitude",
    "vertical_speed",
)
# Half-width of a distribution around a nominal value of 0, SI, by kind of quantity.
_SIZES = {
    **{
        "mass": 0.1,
        "length": 0.005,
        "area": 0.01,
        "time": 0.05,
        "angle": 0.03,
        "speed": 5.0,
        "angular rate": 0.1,
    },
    **{
        "acceleration": 0.5,
        "force": 5.0,
        "moment": 0.5,
        "stiffness": 50.0,
        "damping": 2.0,
        "inertia": 1e-4,
        "": 0.05,
    },
}


class Path(NamedTuple):
    """Path to a number of a scene: its parts without units, the index of the part that has the
    unit, and its field."""

    parts: tuple[str, ...]
    at: int
    field: Field | None


def _type(table: msgspec.Struct) -> type[msgspec.Struct]:
    """Type of a table of the model."""
    return type(table)


def paths(node: Any, parts: tuple[str, ...] = ()) -> Iterator[Path]:
    """All real numbers that are set in a table of the model."""
    for name, field in fields_of(_type(node)).items():
        entry, path = getattr(node, name), (*parts, name)
        if isinstance(entry, msgspec.Struct):
            yield from paths(entry, path)
        elif isinstance(entry, dict):
            for key, item in entry.items():
                if isinstance(item, msgspec.Struct):
                    yield from paths(item, (*path, key))
                elif isinstance(item, float):
                    yield Path((*path, key), len(parts), None)
        elif isinstance(entry, tuple) and field.array_of_tables:
            for key, item in zip(item_names(entry), entry, strict=True):
                yield from paths(item, (*path, key))
                for constant in getattr(item, "constants", ()):
                    yield Path((*path, key, constant), len(path), None)
        elif isinstance(entry, tuple) and field.quantity.components and isinstance(entry[0], float):
            for component in field.quantity.components:
                yield Path((*path, component), len(parts), field)
        elif isinstance(entry, float):
            yield Path(path, len(parts), field)


def kind_of(path: Path) -> str:
    """Path with the user's names replaced: ``motor.*.thrust``."""
    parts = path.parts
    if parts[0] in (
        "body",
        "joint",
        "motor",
        "spring",
        "load",
        "proximity",
        "clearance",
        "phase",
        "release",
        "event",
    ):
        parts = (parts[0], "*", *parts[2:])
    if len(parts) > 3 and parts[2] == "aerodynamics" and path.field is None:
        parts = (*parts[:3], "term")
    return ".".join(parts)


def _is_unused_return(scene: Scene, path: Path) -> bool:
    """True for the return factor 1 of a force table."""
    name = ".".join(path.parts)
    return path.parts[-1] == "return_factor" and value(scene, name) == 1.0


def add_dispersions(tree: dict[str, Any], scene: Scene, rng: RandomStream) -> None:
    """Add distributions to a tree, from which ``scene`` was read; those that the parser refuses (of
    settings, say) are left out."""
    # scenes of old seeds have no return factors
    all_paths = [path for path in paths(scene) if not _is_unused_return(scene, path)]
    # Each kind of number is equally likely, whatever its count.
    kinds = sorted({kind_of(path) for path in all_paths})
    timed = [kind for kind in kinds if kind.endswith(_TIMED)]
    count = rng.weighted_choice({0: 0.04, 2: 0.2, 5: 0.36, 9: 0.25, 16: 0.15})
    chosen = [*rng.subset(kinds, count), *(rng.subset(timed, 2) if count else [])]
    for kind in dict.fromkeys(chosen):
        key, distribution = _distribution(
            scene, rng.choice([p for p in all_paths if kind_of(p) == kind]), rng
        )
        if _allowed(scene, key, distribution):
            tree.setdefault("dispersion", {})[key] = distribution


def _allowed(scene: Scene, key: str, distribution: dict[str, Any]) -> bool:
    """True if the parser accepts a distribution."""
    problems = Problems()
    try:
        model = msgspec.convert(distribution, Distribution)
    except msgspec.ValidationError:
        return False
    for dispersion in resolve(scene, {key: model}, problems):
        check_dispersion(dispersion, scene, problems)
        check_initial_rates(scene, frozenset({dispersion.parameter.path}), problems)
    return not problems


def _distribution(scene: Scene, path: Path, rng: RandomStream) -> tuple[str, dict[str, Any]]:
    """Key in a random unit, and a distribution in that unit around the number's nominal value."""
    parts = list(path.parts)
    factor = 1.0
    if path.field is not None and path.field.units:
        parts[path.at], factor = rng.choice(list(path.field.keys.items()))
    key, nominal = ".".join(parts), value(scene, ".".join(path.parts))
    if path.parts[-1] == "fails":
        return key, {"discrete": [0, 1], "weights": [0.6, 0.4]}
    low, high = _range(scene, path, nominal, rng)
    return key, _spread(
        rounded(nominal / factor, 12), rounded(low / factor, 5), rounded(high / factor, 5), rng
    )


def _range(scene: Scene, path: Path, nominal: float, rng: RandomStream) -> tuple[float, float]:
    """Range of a distribution, SI."""
    name, span = path.parts[-1], scene.run.end_time
    if math.isinf(nominal):  # burn, end, stroke without limit
        low = 0.004 if name == "stroke" else 0.15 * span
        return low, low * rng.uniform(1.2, 4.0)
    if ".".join(path.parts).endswith(_FULL_TURN) and rng.chance(0.5):
        return 0.0, 2.0 * math.pi
    kind = path.field.quantity.kind if path.field is not None else ""
    positive = (path.field is not None and str(NotNegative) in str(path.field.type)) or kind in (
        "stiffness",
        "damping",
        "time",
    )
    if nominal == 0.0:
        size = _SIZES.get(kind, 0.05) * rng.uniform(0.2, 1.0)
        if kind == "time":
            size = min(size, 0.2 * span)
        if kind in ("force", "moment"):
            size *= min(body.mass for body in scene.body.values())
        return (0.0, size) if positive or kind == "speed" else (-size, size)
    width = abs(nominal) * rng.log_uniform(0.003, 0.1)
    if kind == "angle":
        width = min(width, 0.02)
    return nominal - width, nominal + width


def _spread(nominal: float, low: float, high: float, rng: RandomStream) -> dict[str, Any]:
    """Distribution between two numbers, around the nominal value where possible."""
    centred = math.isfinite(nominal) and low < nominal < high
    half, middle = (
        rounded(0.5 * (high - low)),
        rounded(low + rng.uniform(0.2, 0.8) * (high - low), 6),
    )
    distributions: dict[str, dict[str, Any]] = {
        "pair": {"uniform": [low, high]},
        "peak": {"triangular": sorted([low, middle, high])},
        "values": {
            "discrete": sorted({low, middle, high}),
            **({"weights": [1.0, 2.0, 0.5]} if len({low, middle, high}) == 3 else {}),
        },
        "one": {"constant": middle},
        "bell": {
            "normal": [middle, rounded(half / 3.0)],
            "truncate_sigma": rounded(min(middle - low, high - middle) / (half / 3.0 + 1e-300)),
        },
    }
    if centred:
        distributions |= {
            "half": {"uniform": half},
            "third": {"triangular": half},
            "sigma": {
                "normal": rounded(half / 3.0),
                **({"truncate_sigma": 3.0} if rng.chance(0.6) else {}),
            },
        }
        fraction = half / abs(nominal) if nominal else 0.0
        if fraction and fraction < 0.5:
            distributions |= {
                "share": {"uniform": rounded(fraction), "relative": True},
                "shares": {
                    "uniform": [1.0 - rounded(fraction), 1.0 + rounded(fraction)],
                    "relative": True,
                },
                "sigma share": {
                    "normal": rounded(fraction / 3.0),
                    "relative": True,
                    "truncate_sigma": 2.5,
                },
            }
    return distributions[rng.choice(list(distributions))]
