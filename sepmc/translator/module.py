"""Module of LLVM: a compile unit with all functions that it calls."""

from typing import Any

import numpy as np

from sepmc.translator.functions import Function, result_type
from sepmc.translator.sources import Source
from sepmc.translator.units import TYPES
from sepmc.translator.values import (
    FLOAT,
    INT,
    POINTER,
    Array,
    Number,
    constant,
    form,
    leaves,
    rebuilt,
)
from sepmc.translator.writer import Writer

_NUMPY = {np.dtype(np.float64): FLOAT, np.dtype(np.int64): INT}


class Module:
    """Functions that are translated together, each once for the types of its arguments."""

    def __init__(self) -> None:
        self.functions: dict[Any, tuple[str, Any]] = {}  # name and result
        self.texts: list[str] = []
        self.declarations: dict[str, None] = {}
        self.arrays: dict[int, tuple[str, np.ndarray]] = {}

    def declare(self, line: str) -> None:
        """Declare a function that is defined elsewhere."""
        self.declarations[line] = None

    def constant_array(self, values: np.ndarray) -> Array:
        """Array of numbers that are known."""
        if values.dtype not in _NUMPY:
            raise TypeError(f"an array of {values.dtype}")
        if id(values) not in self.arrays:
            name = f"@array{len(self.arrays)}"
            self.arrays[id(values)] = name, values
            element = _NUMPY[values.dtype]
            numbers = [constant(value) for value in np.ascontiguousarray(values).ravel().tolist()]
            items = ", ".join(f"{element} {number.text}" for number in numbers)
            self.texts.append(
                f"{name} = private unnamed_addr constant [{len(numbers)} x {element}] [{items}]"
            )
        name, _ = self.arrays[id(values)]
        shape = tuple(constant(size) for size in values.shape)
        return Array(_NUMPY[values.dtype], Number(POINTER, name), shape)

    def call(self, caller: Writer, source: Source, arguments: tuple[Any, ...]) -> Any:
        """Translate the call of a function; return its result."""
        key = (source, tuple(form(argument, not source.general) for argument in arguments))
        if key not in self.functions:
            self._translate(key, source, arguments)
        name, result = self.functions[key]
        operands = ", ".join(f"{leaf.kind} {leaf.text}" for leaf in _passed(arguments, source))
        kinds = [leaf.kind for leaf in leaves(result)]
        kind = result_type(kinds)
        if not kinds:
            caller.run(f"call void {name}({operands})")
            return ()
        flag = "contract " if kinds == [FLOAT] else ""
        number = caller.emit(kind, f"call {flag}{kind} {name}({operands})")
        if len(kinds) == 1:
            return rebuilt(result, iter([number]))
        whole = number.text
        numbers = [
            caller.emit(one, f"extractvalue {kind} {whole}, {k}") for k, one in enumerate(kinds)
        ]
        return rebuilt(result, iter(numbers))

    def _translate(self, key: Any, source: Source, arguments: tuple[Any, ...]) -> None:
        name = f"@f{len(self.functions)}_{source.node.name}"
        self.functions[key] = name, None  # a function that calls itself has no type
        passed = _passed(arguments, source)
        parameters = [Number(leaf.kind, f"%a{k}") for k, leaf in enumerate(passed)]
        inside = _received(arguments, iter(parameters), source)
        function = Function(source, inside, self)
        marks = "alwaysinline" if source.inlined else "noinline" if function.noinline else ""
        kind = result_type([leaf.kind for leaf in leaves(function.result)])
        function.define(f"internal {kind} {name}", parameters, marks)
        self.functions[key] = name, function.result

    def entry(self, source: Source, name: str, codes: str) -> None:
        """Translate the function of a compile unit: of a workspace and numbers, given by letters
        (`sepmc.translator.units.compile_unit`)."""
        kinds = [POINTER, *(TYPES[code] for code in codes)]
        passed = [Number(kind, f"%a{k}") for k, kind in enumerate(kinds)]
        values: list[Any] = [Array(FLOAT, passed[0])]
        for number in passed[1:]:
            values.append(Array(INT, number) if number.kind == POINTER else number)
        Function(source, tuple(values), self).define(f"void @{name}", passed)

    def text(self) -> str:
        """LLVM's assembly of the module."""
        return "\n".join([*self.declarations, *self.texts]) + "\n"


def _is_known(number: Number, source: Source) -> bool:
    return number.kind == INT and number.constant is not None and not source.general


def _passed(value: Any, source: Source) -> list[Number]:
    """Leaves of arguments that are passed; others are known in the function."""
    return [leaf for leaf in leaves(value) if not _is_known(leaf, source)]


def _received(value: Any, parameters: Any, source: Source) -> Any:
    """Argument inside a function, with parameters for the leaves that are passed."""
    known = (leaf if _is_known(leaf, source) else next(parameters) for leaf in leaves(value))
    return rebuilt(value, known)
