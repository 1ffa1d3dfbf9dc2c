"""LLVM module of a compile unit: the assembly of its function and of all functions that it calls
and that are not compile units themselves."""

from typing import Any

import numpy as np

from sepmc.translator.functions import Function, TranslationError, result_type
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
    """LLVM module in the making: functions, declarations and constant arrays.

    A function is translated once for each structure and types of its arguments (`values.form`);
    unless it is general (`Source.general`), also once for each set of known integers in them.
    """

    def __init__(self) -> None:
        self.functions: dict[Any, tuple[str, Any]] = {}  # name and result
        self.texts: list[str] = []
        self.metadata = ['!0 = !{!"llvm.loop.unroll.disable"}']
        self.declarations: dict[str, None] = {}
        self.arrays: dict[int, tuple[str, np.ndarray]] = {}

    def rolled_loop(self) -> str:
        """Add a metadata node for one more loop that LLVM must not unroll; return its name, such as
        ``!1``, which the loop's last jump refers to."""
        name = f"!{len(self.metadata)}"
        self.metadata.append(f"{name} = distinct !{{{name}, !0}}")
        return name

    def declare(self, line: str) -> None:
        """Add the LLVM declaration of a function that the module calls and does not define; a line
        that was added before is not repeated."""
        self.declarations[line] = None

    def constant_array(self, values: np.ndarray) -> Array:
        """Add a NumPy array to the module as constant data, once per array object; return its view.
        Raises TypeError unless its elements are float64 or int64."""
        if values.dtype not in _NUMPY:
            raise TypeError(
                f"a constant array of {values.dtype}: the elements must be float64 or int64"
            )
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
        """Add instructions to ``caller`` that call the function of ``source``; return the value of
        the call. If the module does not have the function yet for arguments of this structure and
        these types, it is translated first."""
        key = (source, tuple(form(argument, not source.general) for argument in arguments))
        if key not in self.functions:
            self._translate(key, source, arguments)
        name, result = self.functions[key]
        if result is None:
            raise TranslationError(f"{source.node.name} calls itself")
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
        self.functions[key] = name, None  # found by `call` if the function calls itself
        passed = _passed(arguments, source)
        parameters = [Number(leaf.kind, f"%a{k}") for k, leaf in enumerate(passed)]
        inside = _received(arguments, iter(parameters), source)
        function = Function(source, inside, self)
        marks = "alwaysinline" if source.inlined else "noinline" if function.noinline else ""
        kind = result_type([leaf.kind for leaf in leaves(function.result)])
        function.define(f"internal {kind} {name}", parameters, marks)
        self.functions[key] = name, function.result

    def entry(self, source: Source, name: str, codes: str) -> None:
        """Translate the function of a compile unit into this module.

        Parameters
        ----------
        source : Source
        name : str
            Name of the function in the object file.
        codes : str
            Types of its arguments after the workspace, as in `sepmc.translator.units.compile_unit`.
        """
        kinds = [POINTER, *(TYPES[code] for code in codes)]
        passed = [Number(kind, f"%a{k}") for k, kind in enumerate(kinds)]
        values: list[Any] = [Array(FLOAT, passed[0])]
        for number in passed[1:]:
            values.append(Array(INT, number) if number.kind == POINTER else number)
        function = Function(source, tuple(values), self, keeps_loops=True)
        function.define(f"void @{name}", passed)

    def text(self) -> str:
        """Return the LLVM assembly of the whole module."""
        return "\n".join([*self.declarations, *self.texts, *self.metadata]) + "\n"


def _is_known(number: Number, source: Source) -> bool:
    """True if an argument is an integer known during translation, and so a constant in the called
    function, whose source is ``source``; always False for a general one (`Source.general`)."""
    return number.kind == INT and number.constant is not None and not source.general


def _passed(value: Any, source: Source) -> list[Number]:
    """Return the leaves (numbers and pointers) of the arguments ``value`` that become parameters in
    LLVM of the called function, whose source is ``source``. Integers known during translation are
    left out, as they are constants in the function, unless it is general (`Source.general`)."""
    return [leaf for leaf in leaves(value) if not _is_known(leaf, source)]


def _received(value: Any, parameters: Any, source: Source) -> Any:
    """Return the arguments ``value`` as the called function, whose source is ``source``, sees them.
    The leaves that `_passed` returns are replaced by the next items of the iterator ``parameters``;
    integers that are constants in the function stay."""
    known = (leaf if _is_known(leaf, source) else next(parameters) for leaf in leaves(value))
    return rebuilt(value, known)
