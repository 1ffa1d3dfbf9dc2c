"""Conversion of TOML trees to structs of the model: values to SI by the unit of their key, and a
problem with its TOML path for each that is not valid."""

import difflib
import math
import re
from typing import Any, get_args, get_origin

import msgspec

from sepmc.scene.fields import Field, convert, fields_of, keys_of, to_si
from sepmc.scene.limits import LARGEST
from sepmc.scene.limits import NAME as LONGEST_NAME
from sepmc.scene.messages import Problems, shorten
from sepmc.scene.units import split_unit

TERMS = (
    "terms are const, alpha, alpha2 ... alpha5, beta ... beta5, products such as alpha_beta2, and "
    "one of the rates p, q, r alone or at the end; or the name of a [[signal]]"
)
NAME_PATTERN = re.compile(r"[A-Za-z][A-Za-z0-9_]*")
_RENAMED = {"plan": "samples"}  # keys of earlier versions


def read_table(kind: type[msgspec.Struct], tree: Any, key_path: str, problems: Problems) -> Any:
    """Convert a TOML table to a struct of the model.

    Parameters
    ----------
    kind : type
        Struct to convert to.
    tree : dict
        The table; anything but a dict is a problem.
    key_path : str
        TOML path of the table.
    problems : Problems
        Receives every problem.

    Returns
    -------
    Struct of type ``kind``, SI; None if there were problems
    """
    if not isinstance(tree, dict):
        problems.add(key_path, "must be a table", tree)
        return None
    fields = fields_of(kind)
    accepted = keys_of(fields)
    values: dict[str, Any] = {}
    seen: dict[str, str] = {}
    misspelt: set[str] = set()
    count = len(problems)
    for key, value in tree.items():
        if key not in accepted:
            meant, reason = _unknown_key(key, fields)
            problems.add(_join(key_path, key), reason)
            seen.setdefault(meant, key)  # already noted: not "missing" as well
            misspelt.add(meant)
            continue
        field, factor = accepted[key]
        if field.name in values or (field.name in seen and field.name not in misspelt):
            problems.add(_join(key_path, key), f"given twice, also as {seen[field.name]!r}")
            continue
        seen[field.name] = key
        units = fields[field.name].units
        if units and field.table and not isinstance(value, dict):
            reason = (
                f"the unit is missing; allowed: {', '.join(fields[field.name].keys)}, or a table"
            )
            problems.add(_join(key_path, key), reason, value)
            continue
        values[field.name] = _read_value(field, value, factor, _join(key_path, key), problems)
    for field in fields.values():
        if field.required and field.name not in seen:
            problems.add(key_path or "file", f"{_missing(field)} is missing")
    if len(problems) > count:
        return None
    return kind(**values)


def _read_value(field: Field, value: Any, factor: float, key_path: str, problems: Problems) -> Any:
    """Convert the value of one key to the type of its field, in SI; ``factor`` is that of the key's
    unit to SI. Adds problems; the result is None, or incomplete, if there are any."""
    if field.table:
        return read_table(field.table, value, key_path, problems)
    if field.table_of_tables:
        return _read_named(field.table_of_tables, value, key_path, problems)
    if field.array_of_tables:
        return read_array(field.array_of_tables, value, key_path, problems)
    if field.quantity.components and isinstance(value, dict):
        value = _components(field, value, factor, key_path, problems)
    if get_origin(field.bare) is dict and isinstance(value, dict) and not field.table_of_tables:
        return _read_items(field, value, key_path, problems)
    scaled = to_si(value, factor)
    fault = _size_fault(scaled)
    if fault and not (field.default == math.inf and value == math.inf):
        problems.add(key_path, fault, value)
        return None
    result, allowed = convert(scaled, field.type)
    if allowed:
        problems.add(key_path, allowed, value)
    return result


def _read_items(
    field: Field, tree: dict[str, Any], key_path: str, problems: Problems
) -> dict[str, Any]:
    """Convert a table whose keys are free, such as the terms of a polynomial or the joints of a
    phase, to a dict of its values; ``field`` is the field that it is the value of, whose type gives
    that of its values. Adds problems; the dict is complete only without them."""
    kind = get_args(field.bare)[1]
    result = {}
    for key, value in tree.items():
        if kind is float and not NAME_PATTERN.fullmatch(key):
            problems.add(_join(key_path, key), TERMS)
        elif fault := _size_fault(value):
            problems.add(_join(key_path, key), fault, value)
        else:
            result[key], allowed = convert(to_si(value, 1.0), kind)
            if allowed:
                problems.add(_join(key_path, key), allowed, value)
    return result


def _components(
    field: Field, value: dict[str, Any], factor: float, key_path: str, problems: Problems
) -> list[Any]:
    """Convert a vector written as a table, ``{ y = 1.0 }``, to the list of its components in the
    unit of its key; omitted ones have their default. ``factor`` is that of the unit to SI."""
    names = field.quantity.components
    for key in value:
        if key not in names:
            problems.add(_join(key_path, key), "is no component; allowed: " + ", ".join(names))
    default = field.default if isinstance(field.default, tuple) else (0.0,) * len(names)
    return [value.get(name, default[i] / factor) for i, name in enumerate(names)]


def _read_named(
    kind: type[msgspec.Struct], tree: Any, key_path: str, problems: Problems
) -> dict[str, Any]:
    """Convert a table of tables by name, such as [body.NAME], to a dict of structs of a kind by
    name. Adds a problem for a table that is not valid, which gives None in the dict; for a name
    that is not valid, which stays in the dict; and for a ``tree`` that is not a dict (the result is
    then an empty one)."""
    if not isinstance(tree, dict):
        problems.add(key_path, "must be a table of tables", tree)
        return {}
    for name in tree:
        if not NAME_PATTERN.fullmatch(name):
            problems.add(
                _join(key_path, name), "a name is a letter followed by letters, digits or _"
            )
        elif len(name) > LONGEST_NAME:
            problems.add(
                _join(key_path, shorten(name)), f"must have at most {LONGEST_NAME} characters"
            )
    return {
        name: read_table(kind, sub, _join(key_path, name), problems) for name, sub in tree.items()
    }


def read_array(
    kind: type[msgspec.Struct], tree: Any, key_path: str, problems: Problems
) -> tuple[Any, ...]:
    """Convert an array of tables to a tuple of structs of a kind (`read_table`). Adds problems, in
    which the name of a table, or its index, stands as a key; a table with problems gives None, and
    anything but an array an empty tuple."""
    if not isinstance(tree, list):
        problems.add(key_path, f"must be an array of tables: [[{key_path}]]", tree)
        return ()
    result: list[Any] = []
    names: list[Any] = []
    for number, sub in enumerate(tree):
        name = sub.get("name", number) if isinstance(sub, dict) else number
        result.append(read_table(kind, sub, _join(key_path, str(name)), problems))
        if name in names:
            problems.add(_join(key_path, str(name)), "the name is used twice")
        names.append(name)
    return tuple(result)


def _unknown_key(key: str, fields: dict[str, Field]) -> tuple[str, str]:
    """Guess what an unknown key means: name, without unit, of the field that was probably meant
    (``key`` itself if none is near), and the message on the key. ``fields`` is by such names. A key
    whose name is known but whose unit is missing, wrong or not needed is unknown too."""
    if (renamed := _RENAMED.get(key, "")) in fields:
        return renamed, f"unknown key; it is now called {renamed!r}"
    stem, unit = split_unit(key)
    field = fields.get(stem) or fields.get(key)
    if field is None:
        named = [f for name, f in fields.items() if f.units and key.startswith(f"{name}_")]
        if named:
            meant = max(named, key=lambda f: len(f.name))
            ending = key[len(meant.name) + 1 :]
            near = difflib.get_close_matches(key, meant.keys, n=1)
            hint = f"did you mean {near[0]!r}? " if near else ""
            units = ", ".join(meant.keys)
            reason = f"{ending!r} is not a unit of {meant.quantity.kind}; {hint}allowed: {units}"
            return meant.name, f"unknown key; {reason}"
        # first the nearest name with this unit, so that following the hint keeps the value's
        # meaning
        same_unit = {f"{name}_{unit}": name for name, f in fields.items() if unit in f.units}
        others = {next(iter(f.keys)): name for name, f in fields.items()}
        for known in (same_unit, others):
            match = difflib.get_close_matches(key, known, n=1, cutoff=0.6)
            if match:
                return known[match[0]], f"unknown key; did you mean {match[0]!r}?"
        return key, "unknown key; known here: " + ", ".join(others)
    if not field.units:
        return field.name, f"has no unit; write {field.name!r}"
    problem = f"{unit!r} is not a unit of {field.quantity.kind}" if unit else "the unit is missing"
    return field.name, f"{problem}; allowed: " + ", ".join(field.keys)


def _missing(field: Field) -> str:
    """Name of a missing key or table in a message: ``'mass_kg'``, with its first unit, or ``table
    [body]``, ``table [[phase]]``."""
    if field.table or field.table_of_tables:
        return f"table [{field.name}]"
    if field.array_of_tables:
        return f"table [[{field.name}]]"
    return repr(next(iter(field.keys)))


def _size_fault(value: Any) -> str:
    """Reason, for a message, why a number in a value (in SI, perhaps nested) is rejected: too
    large (beyond `LARGEST`), or not finite; empty if there is none."""
    if isinstance(value, float):
        if abs(value) <= LARGEST:
            return ""
        return f"must be at most {LARGEST:g} in size" if math.isfinite(value) else "must be finite"
    if isinstance(value, dict):
        value = value.values()
    elif not isinstance(value, list):
        return ""
    return next(filter(None, map(_size_fault, value)), "")


def _join(key_path: str, key: str) -> str:
    """TOML path of a key in the table at ``key_path``, which is empty for the file itself."""
    return f"{key_path}.{key}" if key_path else key
