"""Parameters of a scene by path: ``body.upper.cg_mm.x`` names one number, with its unit."""

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
        Path as written in TOML, with its unit.
    path : str
        Path without the unit; names its random stream.
    unit : str
        Suffix of the key, empty if dimensionless.
    factor : float
        Factor from ``unit`` to SI.
    field : Field or None
        Its field of the model; None for an entry of a table without one.
    """

    key: str
    path: str
    unit: str
    factor: float
    field: Field | None

    @property
    def column(self) -> str:
        """Column of the case table: ``in_body_upper_cg_x_mm``."""
        stem = "in_" + self.path.replace(".", "_").replace("-", "_")
        return f"{stem}_{self.unit}" if self.unit else stem


class UnknownPath(KeyError):
    """A path that names no number of the scene; its argument is the reason."""


def find(scene: Scene, key: str) -> Parameter:
    """Parameter named by ``key``, a path with unit. Raises `UnknownPath` if there is none."""
    node: Any = scene
    path: list[str] = []
    unit, factor, last = "", 1.0, None
    for part in key.split("."):
        if isinstance(node, Signal) and part not in keys_of(fields_of(Signal)):
            last, (name, node) = None, _item(node.constants, part, None)
        elif isinstance(node, msgspec.Struct):
            name, unit, factor, last = _field(node, part)
            if isinstance(node, Signal) and name in node.without_effect:
                raise UnknownPath(f"{part!r} has no effect on this signal, so it cannot vary")
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


def _field(node: msgspec.Struct, part: str) -> tuple[str, str, float, Field]:
    """Name, unit, factor to SI and field of the key ``part`` of a table. Raises `UnknownPath`."""
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
    """Names of the tables of an array, in order; its index as text for one without a name."""
    return tuple(getattr(item, "name", None) or str(number) for number, item in enumerate(items))


def _item(node: Any, part: str, field: Field | None) -> tuple[str, Any]:
    """Name and value of the item ``part`` of a table of tables, an array or a vector, whose field
    is ``field``. Raises `UnknownPath`."""
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
    raise UnknownPath(f"{part!r} does not exist: the path ends before it")


def _names(node: tuple[Any, ...], field: Field | None) -> tuple[str, ...]:
    """Names of the items of an array in a path: components of a vector, names of tables, numbers of
    points; empty for a series."""
    if node and all(isinstance(item, msgspec.Struct) for item in node):
        return item_names(node)
    if node and all(isinstance(item, tuple) for item in node):
        return tuple(map(str, range(len(node))))
    if field and field.quantity.components:
        return field.quantity.components
    inner = get_args(field.bare)[:1] if field else ()
    return XYZ if inner and get_origin(inner[0]) is tuple else ()


def _not_a_number(node: Any, field: Field | None) -> str:
    """Reason why a path does not end at a number."""
    if isinstance(node, tuple) and (names := _names(node, field)):
        if isinstance(node[0], float | int):
            return "is a vector; name one component: ." + ", .".join(names)
        return "is an array; name one of its items: ." + ", .".join(names)
    return "is not a number, so it cannot vary"


def value(scene: Scene, path: str) -> float:
    """SI value at a path without unit (`Parameter.path`)."""
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
    """Copy of a scene with SI ``values`` by path without unit."""
    for path, number in values.items():
        scene = _replace(scene, path.split("."), number, None)
    return scene


def _replace(node: Any, parts: list[str], number: float, field: Field | None) -> Any:
    """Copy of a node of the scene with the number at the end of a path, ``parts``, replaced;
    ``field`` is that of the node."""
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
