"""Parameters of a scene, its single numbers, by path: ``body.upper.cg_mm.x`` names a number and
its unit."""

import contextlib
from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass
from typing import Any, get_args, get_origin

import msgspec

from sepmc.scene.fields import Field, fields_of, keys_of
from sepmc.scene.messages import nearest
from sepmc.scene.model import XYZ, Scene, Signal
from sepmc.scene.units import split_unit


@dataclass(frozen=True)
class Parameter:
    """One number of a scene.

    Attributes
    ----------
    key : str
        Path as written in TOML, with the unit: ``body.upper.cg_mm.x``.
    path : str
        Path without the unit, ``body.upper.cg.x``; the seed of its random numbers depends on it.
    unit : str
        Unit suffix of the key, ``mm``; empty if it has none.
    factor : float
        Factor from ``unit`` to SI.
    field : Field or None
        Field of the model that has its type and bounds; None for numbers with free keys, such as
        the terms of polynomials.
    """

    key: str
    path: str
    unit: str
    factor: float
    field: Field | None

    @property
    def column(self) -> str:
        """Name of its column in the table of cases, ``in_body_upper_cg_x_mm``: "in_", the path with
        dots and hyphens as underscores, and the unit."""
        stem = "in_" + self.path.replace(".", "_").replace("-", "_")
        return f"{stem}_{self.unit}" if self.unit else stem


class UnknownPath(KeyError):
    """Raised for a path that names no number of a scene, or one that cannot vary; ``args[0]`` is
    the reason."""


def find(scene: Scene, key: str) -> Parameter:
    """Find the parameter that ``key``, a TOML path with unit, names. Raises `UnknownPath` if the
    path is wrong, is not that of a number, or the number is not set or is given by a signal."""
    node: Any = scene
    path: list[str] = []
    unit, factor, last = "", 1.0, None
    for part in key.split("."):
        if isinstance(node, Signal) and part not in keys_of(fields_of(Signal)):
            last, (name, node) = None, _item(node.constants, part, None)
        elif isinstance(node, msgspec.Struct):
            name, unit, factor, last = _field(node, part)
            if isinstance(node, Signal) and name in node.without_effect:
                raise UnknownPath(
                    f"{part!r} has no effect on this signal, so it cannot vary; delay_s needs "
                    "sample_s; initial needs lag_s, servo, integral or delay_s"
                )
            node = getattr(node, name)
        else:
            container = node
            name, node = _item(node, part, last)
            # the bounds of a table are not those of its entries
            last = None if isinstance(container, dict) else last
            if last and isinstance(node, float | int):
                last = last.component(_names(container, last).index(name))
        path.append(name)
    if isinstance(node, bool) or not isinstance(node, int | float):
        raise UnknownPath(_not_a_number(node, last))
    if (drive := scene.driven.get(".".join(path))) is not None:
        raise UnknownPath(
            f"is given by signal {drive.signal!r} during flight; vary constants of the signal, "
            f"such as signal.{drive.signal}.NAME"
        )
    return Parameter(key, ".".join(path), unit, factor, last)


def all_parameters(scene: Scene, tree: Mapping[str, Any]) -> Iterator[Parameter]:
    """Yield all parameters that a file or the defaults give a value, except those that a signal
    gives, in the order of the model.

    Parameters
    ----------
    scene : Scene
    tree : mapping
        TOML tree of the file. A key has the unit that it has there, else the first of its kind.

    Yields
    ------
    Parameter
    """
    for key in _keys(scene, tree):
        with contextlib.suppress(UnknownPath):
            yield find(scene, ".".join(key))


def _keys(node: Any, tree: Any, field: Field | None = None) -> Iterator[tuple[str, ...]]:
    """Yield the TOML path of each number below a node of the scene, as a tuple of keys from there,
    which end in units: those of the file, where it has the key. ``tree`` is the same node in the
    file (anything else if it is not there), ``field`` the field that has the node."""
    tree = tree if isinstance(tree, Mapping) else {}
    items: Iterable[tuple[str, Any, Any, Field | None]] = ()
    if isinstance(node, msgspec.Struct):
        items = [_item_of_file(node, own, tree) for own in fields_of(type(node)).values()]
        if isinstance(node, Signal):
            items += [(name, number, None, None) for name, number in node.constants.items()]
    elif isinstance(node, dict):
        items = ((name, item, tree.get(name), None) for name, item in node.items())
    elif isinstance(node, tuple) and node:
        within = None if _is_table(node[0]) else field
        items = ((*pair, None, within) for pair in zip(_names(node, field), node, strict=False))
    elif isinstance(node, int | float) and not isinstance(node, bool):
        yield ()
    for key, item, its_tree, its_field in items:
        for rest in _keys(item, its_tree, its_field):
            yield (key, *rest)


def _item_of_file(
    node: msgspec.Struct, field: Field, tree: Mapping[str, Any]
) -> tuple[str, Any, Any, Field]:
    """TOML key of a field of ``node``, its value in the scene, its value in the file (None if it is
    not there), and the field. ``tree`` is that of ``node`` in the file."""
    item = getattr(node, field.name)
    spelling = field.spellings[-1] if _is_table(item) else field
    key = next((key for key in spelling.keys if key in tree), next(iter(spelling.keys)))
    return key, item, tree.get(key), field


def _field(node: msgspec.Struct, part: str) -> tuple[str, str, float, Field]:
    """Name, unit suffix, factor to SI and field of the key ``part`` of the table ``node``. Raises
    `UnknownPath` if the key is wrong or its value is not set."""
    fields = fields_of(type(node))
    values = {name: getattr(node, name) for name in fields}
    accepted = {
        key: (field, factor)
        for key, (field, factor) in keys_of(fields).items()
        if not (fields[field.name].instead and _is_table(values[field.name]) != bool(field.table))
    }
    if part not in accepted:
        stem = split_unit(part)[0]
        if part in keys_of(fields):  # either a number or a table may stand here: it is the other
            other = next(key for key, (field, _) in accepted.items() if field.name == stem)
            raise UnknownPath(f"{part!r} is not set in this scene, which has {other!r} instead")
        if stem in fields and fields[stem].units:
            raise UnknownPath(
                f"{part!r} has a wrong or missing unit; allowed: " + ", ".join(fields[stem].keys)
            )
        raise UnknownPath(f"no {part!r} here; " + nearest(part, accepted))
    field, factor = accepted[part]
    if values[field.name] is None:
        raise UnknownPath(f"{part!r} is not set in this scene, so it cannot vary")
    return field.name, split_unit(part)[1] if field.units else "", factor, field


def _is_table(node: Any) -> bool:
    return isinstance(node, msgspec.Struct)


def item_names(items: tuple[Any, ...]) -> tuple[str, ...]:
    """Names of the tables of an array, in order; for a table without a name its index as text."""
    return tuple(getattr(item, "name", None) or str(number) for number, item in enumerate(items))


def _item(node: Any, part: str, field: Field | None) -> tuple[str, Any]:
    """Name and value of the item ``part`` of ``node``, a table of tables, an array or a vector.
    ``part``, which is the name returned, is a key of the table, a name of `item_names` in the
    array (an index from 0 for a table without a name), or a component of the vector. ``field`` is
    the field that has ``node``. Raises `UnknownPath` if there is no such item."""
    if isinstance(node, dict):
        if part not in node:
            raise UnknownPath(f"no {part!r} here; " + nearest(part, node))
        return part, node[part]
    if node == ():
        raise UnknownPath(
            f"{field.name if field else 'this'!r} is not set in this scene, so it cannot vary"
        )
    names = _names(node, field) if isinstance(node, tuple) else ()
    if part in names:
        return part, node[names.index(part)]
    if names and isinstance(node[0], float | int):
        raise UnknownPath(f"{part!r} is no component; allowed: " + ", ".join(names))
    if names:
        raise UnknownPath(f"no {part!r} here; " + nearest(part, names))
    raise UnknownPath(f"{part!r} does not exist: the path must end before it")


def _names(node: tuple[Any, ...], field: Field | None) -> tuple[str, ...]:
    """Names that a path uses for the items of an array: names of tables, indices of points,
    component names of a vector; empty for a series, whose numbers have no path. ``field`` is the
    field of the model that has the array; if it is None, the items of a vector have no names."""
    if node and all(isinstance(item, msgspec.Struct) for item in node):
        return item_names(node)
    if node and all(isinstance(item, tuple) for item in node):
        return tuple(map(str, range(len(node))))
    if field and field.quantity.components:
        return field.quantity.components
    inner = get_args(field.bare)[:1] if field else ()
    return XYZ if inner and get_origin(inner[0]) is tuple else ()


def _not_a_number(node: Any, field: Field | None) -> str:
    """Reason, for a message, why the value ``node`` at the end of a path is not a number; of a
    vector or an array it names the components or items, of any other value (table, text, None)
    nothing. ``field`` is the field that has it (None: unknown)."""
    if isinstance(node, tuple) and (names := _names(node, field)):
        if isinstance(node[0], float | int):
            return "is a vector; name one component: ." + ", .".join(names)
        return "is an array; name one of its items: ." + ", .".join(names)
    return "is not a number, so it cannot vary"


def value(scene: Scene, path: str) -> float:
    """Value, in SI, of the number of a scene at a path without unit (`Parameter.path`)."""
    node: Any = scene
    field: Field | None = None
    for part in path.split("."):
        if isinstance(node, Signal) and part in node.constants:
            node = node.constants[part]
        elif isinstance(node, msgspec.Struct):
            field = fields_of(type(node))[part]
            node = getattr(node, part)
        else:
            node = _item(node, part, field)[1]
    return float(node)


def replace(scene: Scene, values: dict[str, float]) -> Scene:
    """Copy of a scene in which the numbers at the paths of ``values`` (without unit) have these
    values, in SI."""
    for path, number in values.items():
        scene = _replace(scene, path.split("."), number, None)
    return scene


def _replace(node: Any, parts: list[str], number: float, field: Field | None) -> Any:
    """Copy of a node of the scene in which the number at the path ``parts`` below it is replaced by
    ``number``, SI; ``field`` is the field that has the node."""
    if not parts:
        return number
    part, rest = parts[0], parts[1:]
    if isinstance(node, Signal) and part in node.constants:
        return msgspec.structs.replace(node, constants={**node.constants, part: number})
    if isinstance(node, msgspec.Struct):
        inner = fields_of(type(node))[part]
        return msgspec.structs.replace(
            node, **{part: _replace(getattr(node, part), rest, number, inner)}
        )
    if isinstance(node, dict):
        return {**node, part: _replace(node[part], rest, number, None)}
    i = _names(node, field).index(part)
    return (*node[:i], _replace(node[i], rest, number, field), *node[i + 1 :])
