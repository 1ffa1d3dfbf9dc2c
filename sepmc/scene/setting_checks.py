"""Settings of which one undoes another one, as the same number in two units."""

from typing import Any

from sepmc.scene.fields import fields_of
from sepmc.scene.messages import Problems
from sepmc.scene.model import Distribution, Scene
from sepmc.scene.units import split_unit

# tables whose keys are names, in which nothing is a unit
NAMES = ("body", "joint", "joints", "kind", "outcome")
_ARRAYS = frozenset(
    ["requirement", "correlation"]
    + [field.name for field in fields_of(Scene).values() if field.array_of_tables]
)
_DISTRIBUTION_KEYS = frozenset(
    key for field in fields_of(Distribution).values() for key in field.keys
)


def parts(key: str) -> list[str]:
    """Keys of a TOML path: of [dispersion] the path of a parameter is one, and what its law says
    may follow."""
    table, _, rest = key.partition(".")
    if table != "dispersion" or not rest:
        return key.split(".")
    parameter, _, last = rest.rpartition(".")
    return [table, parameter, last] if parameter and last in _DISTRIBUTION_KEYS else [table, rest]


def _without_units(key: str) -> tuple[str, ...]:
    """The keys of a TOML path without their units: one path for each number."""
    keys = parts(key)
    tables = ["", *keys]
    named = (*NAMES, *_ARRAYS)
    return tuple(
        each if table in named else split_unit(each)[0]
        for table, each in zip(tables, keys, strict=False)
    )


def check_settings(settings: dict[str, Any], problems: Problems) -> None:
    """Note settings that are no paths, and those that undo an earlier one: the same number in
    another unit, or a whole table after a part of it. A part after its table only changes it."""
    earlier: dict[tuple[str, ...], str] = {}
    for key, value in settings.items():
        if not isinstance(key, str):
            problems.add("settings", "keys must be text, as 'body.upper.mass_kg'", key)
            continue
        path = _without_units(key)
        if path in earlier:
            problems.add(key, f"is set twice, also as {earlier[path]!r}", value)
        for other, name in earlier.items():
            if len(other) > len(path) and other[: len(path)] == path:
                said = f"would undo {name!r}, which is set before it; set it first"
                problems.add(key, said, value)
        earlier[path] = key
