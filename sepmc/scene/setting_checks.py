"""Checks of settings: paths, and settings of which one would undo another one."""

from collections.abc import Sequence
from typing import Any

from sepmc.scene.fields import fields_of
from sepmc.scene.messages import Problems
from sepmc.scene.model import Distribution, Scene
from sepmc.scene.units import split_unit

# tables whose keys are names of the user, which do not end in a unit
NAMES = ("body", "joint", "joints", "kind", "outcome")
_ARRAYS = frozenset(
    ["requirement", "correlation"]
    + [field.name for field in fields_of(Scene).values() if field.array_of_tables]
)
_DISTRIBUTION_KEYS = frozenset(
    key for field in fields_of(Distribution).values() for key in field.keys
)


def parts(key: str) -> list[str]:
    """Keys of a TOML path. In [dispersion] the path of a parameter is one key; a key of its
    distribution may follow."""
    table, _, rest = key.partition(".")
    if table != "dispersion" or not rest:
        return key.split(".")
    parameter, _, last = rest.rpartition(".")
    return [table, parameter, last] if parameter and last in _DISTRIBUTION_KEYS else [table, rest]


def split_units(keys: Sequence[str]) -> tuple[tuple[str, ...], str]:
    """Keys of a TOML path without their units, which identify a number in any unit; and the last
    unit, empty if there is none."""
    names, last = [], ""
    for table, key in zip(["", *keys], keys, strict=False):
        name, unit = (key, "") if table in (*NAMES, *_ARRAYS) else split_unit(key)
        names.append(name)
        last = unit or last
    return tuple(names), last


def check_settings(settings: dict[str, Any], problems: Problems) -> None:
    """Note settings that are no paths, and those that would undo an earlier one: the same number
    in another unit, or a whole table after a part of it. A part after its table only changes it."""
    earlier: dict[tuple[str, ...], str] = {}
    for key, value in settings.items():
        if not isinstance(key, str):
            problems.add("settings", "keys must be text, as 'body.upper.mass_kg'", key)
            continue
        path, _ = split_units(parts(key))
        if path in earlier:
            problems.add(key, f"is set twice, also as {earlier[path]!r}", value)
        for other, name in earlier.items():
            if len(other) > len(path) and other[: len(path)] == path:
                reason = f"would undo {name!r}, which is set before it; set it first"
                problems.add(key, reason, value)
        earlier[path] = key
