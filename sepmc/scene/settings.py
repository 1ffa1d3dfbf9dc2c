"""Settings, values by TOML path that replace those of a campaign file: their parsing on the command
line, and their application to a TOML tree."""

import json
import tomllib
from collections.abc import Mapping
from typing import Any

import msgspec

from sepmc.scene.fields import fields_of, to_si
from sepmc.scene.messages import Problems, SceneError, nearest
from sepmc.scene.model import XYZ, Scene
from sepmc.scene.setting_checks import NAMES, parts
from sepmc.scene.units import UNITS, split_unit, unit_kind


def apply_settings(tree: dict[str, Any], settings: dict[str, Any], problems: Problems) -> None:
    """Put settings, values by TOML path, into a TOML tree, in place. Keys that are not in the tree
    are created. But a path to a value in a body, joint or entry of an array that is not in the tree
    adds a problem. A key replaces the same one in another unit. Paths have no wildcards here."""
    for key, value in settings.items():
        _put(tree, parts(key), _builtin(value), problems, key)


def _put(
    node: Any, keys: list[str], value: Any, problems: Problems, key: str, table: str = ""
) -> None:
    """Put a value into a tree at a TOML path, in place. Tables that the path needs are created. The
    same key in another unit is removed; if the path names one component of it, the other components
    are converted to the new unit.

    Parameters
    ----------
    node : dict or list
        Part of the tree.
    keys : list of str
        Parts of the path from there, at least one.
    value : any
    problems : Problems
    key : str
        The whole path, for messages.
    table : str
        Key that ``node`` has in its parent; empty at the root and for an entry of an array. A path
        to a value below "body" or "joint" creates no body or joint: a name that is not there adds a
        problem.
    """
    head, rest = keys[0], keys[1:]
    if isinstance(node, list):
        tables = {
            name: item
            for number, item in enumerate(node)
            if isinstance(item, dict) and isinstance(name := item.get("name", str(number)), str)
        }
        if head in tables and rest:
            _put(tables[head], rest, value, problems, key)
        else:
            problems.add(
                key,
                f"{head!r} is a table; name one of its values"
                if head in tables
                else f"no {head!r} here; {nearest(head, tables)}",
            )
        return
    if not isinstance(node, dict):
        problems.add(key, "the path must end before " + repr(head))
        return
    stem, unit = (head, "") if table in NAMES else split_unit(head)
    other = next(
        (k for k in node if k != head and unit and split_unit(k)[1] and split_unit(k)[0] == stem),
        None,
    )
    if other is not None:
        previous, previous_unit = node.pop(other), split_unit(other)[1]
        units = UNITS[unit_kind(unit)]
        if rest and isinstance(previous, list | dict) and previous_unit in units:
            factor = units[previous_unit] / units[unit]
            node[head] = (
                to_si(previous, factor)
                if isinstance(previous, list)
                else {k: to_si(v, factor) for k, v in previous.items()}
            )
    if not rest:
        node[head] = value
    elif stem == "points" and len(rest) == 2 and isinstance(node.get(head), list):
        points = {str(number): point for number, point in enumerate(node[head])}
        if rest[0] in points and rest[1] in XYZ and len(points[rest[0]]) == len(XYZ):
            points[rest[0]][XYZ.index(rest[1])] = value
        else:
            problems.add(key, f"no point {'.'.join(rest)!r} here; a path ends as in points_m.0.x")
    elif head not in node and table in ("body", "joint"):
        problems.add(key, f"no {head!r} here; {nearest(head, node)}")
    elif isinstance(node.get(head), list) and len(rest) == 1 and stem in _COMPONENTS:
        names, count = _COMPONENTS[stem], len(node[head])
        if rest[0] not in names:
            problems.add(key, f"{rest[0]!r} is no component; allowed: " + ", ".join(names))
        elif count != len(names):
            problems.add(key, f"{head} has {count} components: it must have {len(names)}")
        else:
            node[head][names.index(rest[0])] = value
    else:
        _put(node.setdefault(head, {}), rest, value, problems, key, head)


def _vector_components(kind: type[msgspec.Struct]) -> dict[str, tuple[str, ...]]:
    """Component names, such as ("x", "y", "z"), of every field that is a vector, by field name
    without unit, in the struct ``kind`` and the structs nested in it."""
    components: dict[str, tuple[str, ...]] = {}
    for field in fields_of(kind).values():
        inner = field.table or field.table_of_tables or field.array_of_tables
        if inner is kind:
            continue
        if inner is not None:
            components |= _vector_components(inner)
        elif field.quantity.components:
            components[field.name] = field.quantity.components
    return components


_COMPONENTS = _vector_components(Scene)


def _builtin(value: Any) -> Any:
    """Convert a value from Python to types of TOML: numpy numbers and arrays become numbers and
    lists, tuples become lists, also where they are nested."""
    if isinstance(value, dict):
        return {str(k): _builtin(v) for k, v in value.items()}
    if hasattr(value, "tolist"):
        return value.tolist()
    return [_builtin(item) for item in value] if isinstance(value, list | tuple) else value


def parse_setting(text: str) -> tuple[str, Any]:
    """Split a command-line setting ``path=value`` at its first ``=`` into path, without double
    quotes, and value, parsed as TOML; a value that is not TOML is text. Raises SceneError if there
    is no path or no ``=``, or the text is not valid UTF-8."""
    key, separator, raw = text.partition("=")
    try:
        text.encode()
    except UnicodeEncodeError:
        raise SceneError(
            [f"--set {text.encode(errors='replace').decode()}: is not text in UTF-8"]
        ) from None
    if not separator or not key.strip():
        raise SceneError([f"--set {text}: must read path=value, such as body.upper.mass_kg=460"])
    try:
        value = tomllib.loads(f"value = {raw.strip()}")["value"]
    except (ValueError, RecursionError):
        value = raw.strip()
    return key.strip().replace('"', ""), value


def inline_toml(value: Any) -> str:
    """Text of a value in TOML, on one line. Keys of tables are written as they are, without quotes;
    that values are finite and not None is not checked."""
    if isinstance(value, Mapping):
        return f"{{ {', '.join(f'{k} = {inline_toml(v)}' for k, v in value.items())} }}"
    return json.dumps(value)
