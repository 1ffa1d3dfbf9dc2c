"""Checks of settings (values by TOML path that replace those of a campaign file): paths, wildcards,
and settings of which one would undo another."""

from collections.abc import Iterator, Sequence
from fnmatch import fnmatchcase
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
    """Split a TOML path into keys. In [dispersion] the path of the parameter stays one key, which a
    key of its distribution may follow: ``["dispersion", "body.upper.mass_kg", "uniform"]``."""
    table, _, rest = key.partition(".")
    if table != "dispersion" or not rest:
        return key.split(".")
    parameter, _, last = rest.rpartition(".")
    return [table, parameter, last] if parameter and last in _DISTRIBUTION_KEYS else [table, rest]


def expand(settings: dict[str, Any], tree: dict[str, Any], problems: Problems) -> dict[str, Any]:
    """Copy of settings in which each path with ``*``, such as ``spring.*.force_N``, is replaced by
    the paths in ``tree`` that it matches. Adds a problem if it matches none, or a path that an
    earlier setting sets."""
    expanded: dict[str, Any] = {}
    for key, value in settings.items():
        if not isinstance(key, str) or "*" not in key:
            expanded[key] = value
            continue
        names = matching_keys(tree, key)
        if not names:
            problems.add(key, "no table has such a name (* stands for any characters)", value)
        for name in names:
            if name in expanded:
                problems.add(key, f"sets {name!r}, which an earlier key sets: remove one", value)
            expanded[name] = value
    return expanded


def matching_keys(tree: dict[str, Any], key: str) -> list[str]:
    """TOML paths in a tree that a path with wildcards ``*`` matches: each key with a wildcard is
    replaced by the names that it matches in the tree. The last key, and keys without a wildcard,
    are taken as they are: they need not be in the tree."""
    return [".".join(match) for match in _matches(tree, parts(key))]


def _matches(node: Any, keys: Sequence[str]) -> Iterator[list[str]]:
    """Yield the paths below ``node``, as lists of keys, that the path ``keys`` with wildcards
    matches; its last key is not matched but appended. A key without a wildcard is taken as it is,
    even if ``node`` does not have it."""
    head, rest = keys[0], keys[1:]
    if not rest:
        yield [head]
        return
    named = node if isinstance(node, dict) else {}
    if isinstance(node, list):
        named = {
            str(item.get("name", number)): item
            for number, item in enumerate(node)
            if isinstance(item, dict)
        }
    for name in [one for one in named if fnmatchcase(one, head)] if "*" in head else [head]:
        for match in _matches(named.get(name), rest):
            yield [name, *match]


def split_units(keys: Sequence[str]) -> tuple[tuple[str, ...], str]:
    """Strip the units from the keys of a TOML path; names of items, such as bodies, stay as they
    are. Returns the stems, equal for one number in any unit, and the last unit suffix, without
    its underscore, empty if there is none."""
    names, last = [], ""
    for table, key in zip(["", *keys], keys, strict=False):
        name, unit = (key, "") if table in (*NAMES, *_ARRAYS) else split_unit(key)
        names.append(name)
        last = unit or last
    return tuple(names), last


def check_settings(settings: dict[str, Any], problems: Problems) -> None:
    """Add a problem for each setting whose path is not text, or which would undo an earlier one:
    the same number in another unit, or a whole table after a key in it. A key after its table is
    valid. Paths with wildcards are compared as they are written, not by what they match."""
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
                reason = f"would undo {name!r}, which is set before it; set this table first"
                problems.add(key, reason, value)
        earlier[path] = key
