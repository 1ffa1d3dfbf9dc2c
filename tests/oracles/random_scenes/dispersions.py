"""Laws of a random scene, over any number of it: its paths come from the model itself, so a new
field is dispersed too."""

import math
from collections.abc import Iterator
from typing import Any, NamedTuple

import msgspec

from oracles.random_scenes.rng import Dice, rounded
from sepmc.scene.checks import check_dispersion
from sepmc.scene.dispersion import resolve
from sepmc.scene.fields import Field, fields_of
from sepmc.scene.initial_rates import check_initial_rates
from sepmc.scene.messages import Problems
from sepmc.scene.model import Distribution, NotNegative, Scene
from sepmc.scene.parameters import item_names, value

# angles that laws take all round
_ROUND = ("environment.wind.direction", "deflection_clock", "clock", "initial.roll")
# Numbers that decide when something happens: two of them more often vary than others.
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
# Half-width of a law over a nominal of 0, in SI, by kind of quantity.
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
    """A number of a scene: the parts of its path without units, which of them has the unit, and its
    field."""

    parts: tuple[str, ...]
    at: int
    field: Field | None


def _type(table: msgspec.Struct) -> type[msgspec.Struct]:
    return type(table)


def paths(node: Any, parts: tuple[str, ...] = ()) -> Iterator[Path]:
    """All numbers of a table of the model that are set, and not whole numbers."""
    for name, field in fields_of(_type(node)).items():
        found, here = getattr(node, name), (*parts, name)
        if isinstance(found, msgspec.Struct):
            yield from paths(found, here)
        elif isinstance(found, dict):
            for key, item in found.items():
                if isinstance(item, msgspec.Struct):
                    yield from paths(item, (*here, key))
                elif isinstance(item, float):
                    yield Path((*here, key), len(parts), None)
        elif isinstance(found, tuple) and field.array_of_tables:
            for key, item in zip(item_names(found), found, strict=True):
                yield from paths(item, (*here, key))
        elif isinstance(found, tuple) and field.quantity.components and isinstance(found[0], float):
            for component in field.quantity.components:
                yield Path((*here, component), len(parts), field)
        elif isinstance(found, float):
            yield Path(here, len(parts), field)


def kind_of(path: Path) -> str:
    """A path with the names of a scene's own things left out: ``motor.*.thrust``."""
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


def add_dispersions(tree: dict[str, Any], scene: Scene, dice: Dice) -> None:
    """Put laws into a tree whose scene was read from it. What the parser refuses (settings, say) is
    left out."""
    places = list(paths(scene))
    # Each kind of number is as likely as another, however many of it there are.
    kinds = sorted({kind_of(path) for path in places})
    timed = [kind for kind in kinds if kind.endswith(_TIMED)]
    count = dice.weighted({0: 0.04, 2: 0.2, 5: 0.36, 9: 0.25, 16: 0.15})
    chosen = [*dice.some(kinds, count), *(dice.some(timed, 2) if count else [])]
    for kind in dict.fromkeys(chosen):
        key, law = _law(scene, dice.pick([p for p in places if kind_of(p) == kind]), dice)
        if _allowed(scene, key, law):
            tree.setdefault("dispersion", {})[key] = law


def _allowed(scene: Scene, key: str, law: dict[str, Any]) -> bool:
    problems = Problems()
    try:
        model = msgspec.convert(law, Distribution)
    except msgspec.ValidationError:
        return False
    for dispersion in resolve(scene, {key: model}, problems):
        check_dispersion(dispersion, scene, problems)
        check_initial_rates(scene, frozenset({dispersion.parameter.path}), problems)
    return not problems


def _law(scene: Scene, path: Path, dice: Dice) -> tuple[str, dict[str, Any]]:
    """A key with some unit, and a law in that unit that suits the number's nominal."""
    parts = list(path.parts)
    factor = 1.0
    if path.field is not None and path.field.units:
        parts[path.at], factor = dice.pick(list(path.field.keys.items()))
    key, nominal = ".".join(parts), value(scene, ".".join(path.parts))
    if path.parts[-1] == "fails":
        return key, {"discrete": [0, 1], "weights": [0.6, 0.4]}
    low, high = _range(scene, path, nominal, dice)
    return key, _spread(
        rounded(nominal / factor, 12), rounded(low / factor, 5), rounded(high / factor, 5), dice
    )


def _range(scene: Scene, path: Path, nominal: float, dice: Dice) -> tuple[float, float]:
    """Between what a law may lie, SI."""
    name, span = path.parts[-1], scene.run.end_time
    if math.isinf(nominal):  # burn, end, stroke: for ever
        low = 0.004 if name == "stroke" else 0.15 * span
        return low, low * dice.between(1.2, 4.0)
    if ".".join(path.parts).endswith(_ROUND) and dice.chance(0.5):
        return 0.0, 2.0 * math.pi
    kind = path.field.quantity.kind if path.field is not None else ""
    positive = (path.field is not None and str(NotNegative) in str(path.field.type)) or kind in (
        "stiffness",
        "damping",
        "time",
    )
    if nominal == 0.0:
        size = _SIZES.get(kind, 0.05) * dice.between(0.2, 1.0)
        if kind == "time":
            size = min(size, 0.2 * span)
        if kind in ("force", "moment"):
            size *= min(body.mass for body in scene.body.values())
        return (0.0, size) if positive or kind == "speed" else (-size, size)
    width = abs(nominal) * dice.decades(0.003, 0.1)
    if kind == "angle":
        width = min(width, 0.02)
    return nominal - width, nominal + width


def _spread(nominal: float, low: float, high: float, dice: Dice) -> dict[str, Any]:
    """A law between two numbers; where it may, one about the nominal."""
    centred = math.isfinite(nominal) and low < nominal < high
    half, middle = (
        rounded(0.5 * (high - low)),
        rounded(low + dice.between(0.2, 0.8) * (high - low), 6),
    )
    laws: dict[str, dict[str, Any]] = {
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
        laws |= {
            "half": {"uniform": half},
            "third": {"triangular": half},
            "sigma": {
                "normal": rounded(half / 3.0),
                **({"truncate_sigma": 3.0} if dice.chance(0.6) else {}),
            },
        }
        share = half / abs(nominal) if nominal else 0.0
        if share and share < 0.5:
            laws |= {
                "share": {"uniform": rounded(share), "relative": True},
                "shares": {
                    "uniform": [1.0 - rounded(share), 1.0 + rounded(share)],
                    "relative": True,
                },
                "sigma share": {
                    "normal": rounded(share / 3.0),
                    "relative": True,
                    "truncate_sigma": 2.5,
                },
            }
    return laws[dice.pick(list(laws))]
