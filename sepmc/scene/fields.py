"""What the model's fields are: their quantity, the TOML keys they accept, and how one value is
converted and checked."""

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

from sepmc.scene.model import Quantity
from sepmc.scene.units import UNITS


def _constraint(given: dict[str, Any]) -> msgspec.Meta:
    return msgspec.Meta(**given)


def _reduced(meta: msgspec.Meta) -> tuple[Any, tuple[dict[str, Any]]]:
    given = {name: getattr(meta, name) for name in _CONSTRAINTS}
    return _constraint, ({name: value for name, value in given.items() if value is not None},)


# msgspec's constraints cannot be copied or pickled, and so could no campaign.
_CONSTRAINTS = tuple(inspect.signature(msgspec.Meta).parameters)
copyreg.pickle(msgspec.Meta, _reduced)


@dataclass(frozen=True)
class Field:
    """One field of a table of the model."""

    name: str
    type: Any  # as annotated, with constraints: what msgspec checks a value against
    bare: Any  # without `| None` and `Annotated`
    quantity: Quantity
    required: bool
    default: Any
    # a table that may stand in place of the number, under the field's name without a unit
    instead: type[msgspec.Struct] | None = None

    @property
    def spellings(self) -> list["Field"]:
        """The field, and as another field the table that may stand in its place."""
        if self.instead is None:
            return [self]
        table = dataclasses.replace(
            self, type=self.instead, bare=self.instead, quantity=Quantity(""), instead=None
        )
        return [self, table]

    @property
    def units(self) -> dict[str, float]:
        """Units of its quantity, with the factor of each to SI; none if it has no units."""
        return UNITS.get(self.quantity.kind, {})

    @property
    def keys(self) -> dict[str, float]:
        """TOML keys this field accepts, with the factor of each to SI."""
        if not self.units:
            return {self.name: 1.0}
        return {f"{self.name}_{unit}": factor for unit, factor in self.units.items()}

    def component(self, number: int) -> "Field | None":
        """The same for one component of a vector, if it has bounds of its own."""
        kinds = get_args(self.bare)
        kind = kinds[0] if ... in kinds else kinds[number]
        return dataclasses.replace(self, type=kind) if _bounds(kind) else None

    @property
    def table(self) -> type[msgspec.Struct] | None:
        """The nested table, if the field is one."""
        return (
            self.bare
            if isinstance(self.bare, type) and issubclass(self.bare, msgspec.Struct)
            else None
        )

    @property
    def table_of_tables(self) -> type[msgspec.Struct] | None:
        """The table that each entry is, if the field is tables by name."""
        return self._container(dict)

    @property
    def array_of_tables(self) -> type[msgspec.Struct] | None:
        """The table that each entry is, if the field is an array of tables."""
        return self._container(tuple)

    def _container(self, origin: type) -> type[msgspec.Struct] | None:
        if get_origin(self.bare) is not origin:
            return None
        inner = get_args(self.bare)[1 if origin is dict else 0]
        return inner if isinstance(inner, type) and issubclass(inner, msgspec.Struct) else None


@functools.cache
def fields_of(kind: type[msgspec.Struct]) -> dict[str, Field]:
    """Fields of a table by name, in the order they are declared."""
    hints = get_type_hints(kind, include_extras=True)
    result = {}
    for info in msgspec.structs.fields(kind):
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
    """Every TOML key that fields of a table accept: its field, and the factor of its unit to SI."""
    return {
        key: (spelling, factor)
        for field in fields.values()
        for spelling in field.spellings
        for key, factor in spelling.keys.items()
    }


def _split(annotation: Any) -> tuple[Any, type[msgspec.Struct] | None]:
    """A type without the table that may stand in its place, and that table."""
    options = get_args(annotation) if get_origin(annotation) in (Union, types.UnionType) else ()
    tables = [a for a in options if isinstance(a, type) and issubclass(a, msgspec.Struct)]
    others = [a for a in options if a not in tables and a is not type(None)]
    return (others[0], tables[0]) if tables and others else (annotation, None)


def _unwrap(annotation: Any) -> tuple[Any, Quantity | None]:
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
    """Which of the values (n,) a field of a type may have: what `convert` says of each, from the
    bounds alone."""
    fits = np.isfinite(values)
    for bound in _bounds(kind):
        fits &= values > bound.gt if bound.gt is not None else True
        fits &= values >= bound.ge if bound.ge is not None else True
        fits &= values < bound.lt if bound.lt is not None else True
        fits &= values <= bound.le if bound.le is not None else True
    return fits


def _bounds(annotation: Any) -> list[msgspec.Meta]:
    """All bounds of a type."""
    found = (
        [extra for extra in get_args(annotation)[1:] if isinstance(extra, msgspec.Meta)]
        if get_origin(annotation) is Annotated
        else []
    )
    inner = (
        get_args(annotation)
        if get_origin(annotation) in (Union, types.UnionType)
        else get_args(annotation)[:1]
    )
    return found + [bound for option in inner for bound in _bounds(option)]


def to_si(value: Any, factor: float) -> Any:
    """Scale a number or a list of numbers; anything else is left for the type check to name. What
    overflows becomes infinite."""
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
    """Convert one value to ``kind``; returns the value and, if it does not fit, what is allowed."""
    try:
        return msgspec.convert(value, kind), None
    except msgspec.ValidationError as error:
        options = _options(kind)
        return None, f"must be one of {', '.join(options)}" if options else _plain(str(error))


def _options(kind: Any) -> list[str]:
    """What a choice may be, for the message."""
    bare, _ = _unwrap(kind)
    return [str(option) for option in get_args(bare)] if get_origin(bare) is Literal else []


_WORDS = {
    "`float` > 0.0": "must be > 0",
    "`int` > 0": "must be > 0",
    "`float` >= 0.0": "must be >= 0",
    "`int` >= 0": "must be >= 0",
    "`int` >= 1": "must be >= 1",
    "`float` <= 3.14": "must be at most 180 deg (an angle between two attitudes is no larger)",
    "`int` <= ": "must be at most 1000000000",
    "`str` of length <= ": "a name has at most 64 letters",
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
    text = message.split(" - at ", maxsplit=1)[0].replace("Expected ", "")
    for ours, plain in _WORDS.items():
        if text.startswith(ours):
            return plain
    text = text.replace(" | null", "").replace("`", "")
    for ours, plain in _TYPES.items():
        text = re.sub(rf"\b{ours}\b", plain, text)
    return text if text.startswith("Invalid") else f"must be {text.replace(' | ', ' or ')}"
