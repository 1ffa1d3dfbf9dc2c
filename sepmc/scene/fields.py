"""Fields of the structs of `sepmc.scene.model`: their kind of quantity, the TOML keys that set
them, and the conversion and checks of values."""

import copyreg
import dataclasses
import functools
import inspect
import math
import re
import types
from dataclasses import dataclass
from typing import Annotated, Any, Literal, Union, get_args, get_origin, get_type_hints

import msgspec
import numpy as np

from sepmc.scene.model import Derived, Quantity
from sepmc.scene.units import UNITS


def _make_constraint(arguments: dict[str, Any]) -> msgspec.Meta:
    """Make a constraint (msgspec.Meta) from its arguments; pickle calls this to load one."""
    return msgspec.Meta(**arguments)


def _reduced(meta: msgspec.Meta) -> tuple[Any, tuple[dict[str, Any]]]:
    """Return the function that makes a constraint (``meta``) and the tuple of its arguments, as
    pickle needs them to store it; constraints that are not set are left out."""
    arguments = {name: getattr(meta, name) for name in _CONSTRAINTS}
    set_ones = {name: value for name, value in arguments.items() if value is not None}
    return _make_constraint, (set_ones,)


# msgspec cannot copy or pickle its constraints, which campaigns contain.
_CONSTRAINTS = tuple(inspect.signature(msgspec.Meta).parameters)
copyreg.pickle(msgspec.Meta, _reduced)


@dataclass(frozen=True)
class Field:
    """One field of a struct of the model, and the TOML keys that set it.

    Attributes
    ----------
    name : str
        Of the field in the struct, without a unit.
    type : type
        As annotated, with constraints: msgspec checks values against it.
    bare : type
        ``type`` without ``| None`` and ``Annotated``.
    quantity : Quantity
        Kind of quantity, which determines the units, and component names of a vector.
    required : bool
        True if a file must give the key.
    default : any
        Value if the key is not given, in SI; msgspec.NODEFAULT if the key is required or a function
        makes the value.
    instead : type or None
        Struct of a table that a file may give in place of the number; its key is the field's name
        without a unit.
    """

    name: str
    type: Any
    bare: Any
    quantity: Quantity
    required: bool
    default: Any
    instead: type[msgspec.Struct] | None = None

    @property
    def spellings(self) -> list["Field"]:
        """List of this field and, if a table may replace its number, of a second field, whose type
        is that table."""
        if self.instead is None:
            return [self]
        table = dataclasses.replace(
            self, type=self.instead, bare=self.instead, quantity=Quantity(""), instead=None
        )
        return [self, table]

    @property
    def units(self) -> dict[str, float]:
        """Unit suffixes of the field's quantity with their factors to SI; empty if it has no
        unit."""
        return UNITS.get(self.quantity.kind, {})

    @property
    def keys(self) -> dict[str, float]:
        """TOML keys that set the field, such as ``mass_kg`` and ``mass_lb``, with the factors from
        their unit to SI."""
        if not self.units:
            return {self.name: 1.0}
        return {f"{self.name}_{unit}": factor for unit, factor in self.units.items()}

    def component(self, number: int) -> "Field | None":
        """Field whose type is that of the component ``number`` (from 0) of this vector; None if the
        component has no bounds."""
        kinds = get_args(self.bare)
        kind = kinds[0] if ... in kinds else kinds[number]
        return dataclasses.replace(self, type=kind) if _bounds(kind) else None

    @property
    def table(self) -> type[msgspec.Struct] | None:
        """Struct of the field's value if that is a single table; else None."""
        return (
            self.bare
            if isinstance(self.bare, type) and issubclass(self.bare, msgspec.Struct)
            else None
        )

    @property
    def table_of_tables(self) -> type[msgspec.Struct] | None:
        """Struct of the entries if the field's value is a table of tables by name ([body.NAME]);
        else None."""
        return self._container(dict)

    @property
    def array_of_tables(self) -> type[msgspec.Struct] | None:
        """Struct of the entries if the field's value is an array of tables ([[motor]]); else
        None."""
        return self._container(tuple)

    def _container(self, origin: type) -> type[msgspec.Struct] | None:
        """Struct of the entries if the field's type is a dict or tuple (``origin``) of structs;
        else None."""
        if get_origin(self.bare) is not origin:
            return None
        inner = get_args(self.bare)[1 if origin is dict else 0]
        return inner if isinstance(inner, type) and issubclass(inner, msgspec.Struct) else None


@functools.cache
def fields_of(kind: type[msgspec.Struct]) -> dict[str, Field]:
    """Fields of a struct of the model by name (without unit), in the order of declaration,
    except those that no key sets (`Derived`). The dict is cached: callers must not change it."""
    hints = get_type_hints(kind, include_extras=True)
    result = {}
    for info in msgspec.structs.fields(kind):
        if any(isinstance(extra, Derived) for extra in get_args(hints[info.name])):
            continue
        annotation, instead = _split(hints[info.name])
        bare, quantity = _unwrap(annotation)
        result[info.name] = Field(
            info.name,
            annotation,
            bare,
            quantity or Quantity(""),
            info.required,
            info.default,
            instead,
        )
    return result


def keys_of(fields: dict[str, Field]) -> dict[str, tuple[Field, float]]:
    """For every TOML key that sets one of the fields: the field and the factor to SI.

    For the key of a table that may replace the number of a field (``instead``), the field has the
    type of that table (`Field.spellings`).
    """
    return {
        key: (spelling, factor)
        for field in fields.values()
        for spelling in field.spellings
        for key, factor in spelling.keys.items()
    }


def _split(annotation: Any) -> tuple[Any, type[msgspec.Struct] | None]:
    """Split an annotation such as ``Time | Ignition``, also with ``None``, into the type of the
    number and the struct of the table that may replace it. Without a struct (``Time | None``),
    return the whole annotation and None."""
    options = get_args(annotation) if get_origin(annotation) in (Union, types.UnionType) else ()
    tables = [a for a in options if isinstance(a, type) and issubclass(a, msgspec.Struct)]
    others = [a for a in options if a not in tables and a is not type(None)]
    return (others[0], tables[0]) if tables and others else (annotation, None)


def _unwrap(annotation: Any) -> tuple[Any, Quantity | None]:
    """Strip ``| None`` and ``Annotated`` from an annotation; returns the bare type and the
    annotated quantity, None if there is none. A union of several types besides None is returned as
    it is, with None as quantity."""
    if get_origin(annotation) in (Union, types.UnionType):
        options = [a for a in get_args(annotation) if a is not type(None)]
        if len(options) == 1:
            return _unwrap(options[0])
        return annotation, None
    if get_origin(annotation) is Annotated:
        inner, *extras = get_args(annotation)
        quantity = next((e for e in extras if isinstance(e, Quantity)), None)
        bare, nested = _unwrap(inner)
        return bare, quantity or nested
    return annotation, None


def allowed(kind: Any, values: np.ndarray) -> np.ndarray:
    """Mask (n,), True where ``values`` (n,), in SI, are finite and within the bounds of an
    annotated type; these are the values that `convert` accepts."""
    fits = np.isfinite(values)
    for bound in _bounds(kind):
        fits &= values > bound.gt if bound.gt is not None else True
        fits &= values >= bound.ge if bound.ge is not None else True
        fits &= values < bound.lt if bound.lt is not None else True
        fits &= values <= bound.le if bound.le is not None else True
    return fits


def _bounds(annotation: Any) -> list[msgspec.Meta]:
    """Constraints (msgspec.Meta) of an annotated type, also those of its nested types."""
    bounds = (
        [extra for extra in get_args(annotation)[1:] if isinstance(extra, msgspec.Meta)]
        if get_origin(annotation) is Annotated
        else []
    )
    inner = (
        get_args(annotation)
        if get_origin(annotation) in (Union, types.UnionType)
        else get_args(annotation)[:1]
    )
    return bounds + [bound for option in inner for bound in _bounds(option)]


def to_si(value: Any, factor: float) -> Any:
    """Multiply a number, or all numbers in nested lists, by ``factor``; other values, such as a
    bool, are returned unchanged, for a later type check. A product is a float; with a factor of 1
    an int below 2^63 in size stays an int. Overflow gives infinity."""
    if isinstance(value, bool):
        return value
    if isinstance(value, int | float):
        try:
            return value if factor == 1.0 and abs(value) < 2**63 else float(value) * factor
        except OverflowError:
            return math.inf
    if isinstance(value, list):
        return [to_si(item, factor) for item in value]
    return value


def convert(value: Any, kind: Any) -> tuple[Any, str | None]:
    """Convert a value of a TOML file to a type of the model and check its constraints.

    Parameters
    ----------
    value : any
        In SI.
    kind : type
        With its constraints, as annotated in the model.

    Returns
    -------
    value : any
        The converted value; None if it does not fit.
    allowed : str or None
        Text on what is allowed, "must be > 0", if it does not fit; else None.
    """
    try:
        return msgspec.convert(value, kind), None
    except msgspec.ValidationError as error:
        options = _options(kind)
        return None, f"must be one of {', '.join(options)}" if options else _plain(str(error))


def _options(kind: Any) -> list[str]:
    """Allowed values of a Literal type, or of an optional or annotated one, as texts; empty for
    other types."""
    bare, _ = _unwrap(kind)
    return [str(option) for option in get_args(bare)] if get_origin(bare) is Literal else []


_WORDS = {
    "`float` > 0.0": "must be > 0",
    "`int` > 0": "must be > 0",
    "`float` >= 0.0": "must be >= 0",
    "`int` >= 0": "must be >= 0",
    "`int` >= 1": "must be >= 1",
    "`float` <= 3.14": "must be at most 180 deg (an angle between two attitudes is no larger)",
    "`str` of length <= ": "a name has at most 64 characters",
    "`str` matching regex": "a name is a letter followed by letters, digits or _",
}
_TYPES = {
    "float": "a number",
    "int": "a whole number",
    "str": "text",
    "bool": "true or false",
    "array": "a list",
    "object": "a table",
}


def _plain(message: str) -> str:
    """Translate an error message of msgspec to plain words: "must be a number, got text"."""
    text = message.split(" - at ", maxsplit=1)[0].replace("Expected ", "")
    for ours, plain in _WORDS.items():
        if text.startswith(ours):
            return plain
    text = text.replace(" | null", "").replace("`", "")
    text = re.sub(r"^int <= ", "at most ", text).replace("int, got float", "int")
    for ours, plain in _TYPES.items():
        text = re.sub(rf"\b{ours}\b", plain, text)
    return text if text.startswith("Invalid") else f"must be {text.replace(' | ', ' or ')}"
