"""Split of the source text of a kernel into compile units: functions that are compiled separately
and call each other by address.

A compiler that inlines optimises a function again in every function that calls it, so a module
compiled as a whole takes two to three times as long as its units. Units are compiled in parallel
and cached by their text, in which the function has the name `ENTRY`: a scene with other outputs
compiles only what differs, and segments share equal functions.

The function of a unit takes the workspace, numbers and pointers to arrays. Functions with other
arguments are copied into the units that call them. Workspace offsets are folded to numbers.
"""

import ast
from dataclasses import dataclass
from functools import lru_cache
from typing import Any

from sepmc.kernel.tracer.folding import fold, whole_numbers
from sepmc.routines.layout import LANES

ENTRY = "entry"  # name of the function of every compile unit
# by the annotation of an argument: letter of its type in `sepmc.translator.units.compile_unit`
_CODES = {"int": "i", "float": "f", "Arrays": "a"}
_MARK = "noinline"  # call that marks functions that are not inlined; removed from compile units
_HEAD = '''"""CompileUnit of a written kernel."""

from sepmc.translator.units import callee, compile_unit, workspace
'''


@dataclass(frozen=True)
class CompileUnit:
    """Function of a kernel that is compiled separately.

    Attributes
    ----------
    name : str
        Name of the function in the kernel.
    text : str
        Source text of a module that contains the function under the name `ENTRY`, with the
        imports, constants and functions it uses; it calls other compile units by their address.
    """

    name: str
    text: str


class _Module:
    """Syntax trees of a kernel, given as source text: by name its ``functions``, its other
    ``definitions`` (assignments and imports at the top level), and the whole ``numbers`` among
    these, with LANES. Of each function that is a compile unit, ``codes`` has the letters of the
    argument types, and ``indices`` the position in the table of addresses. ``order`` has the
    position of each of the ``definitions`` among them; functions do not count."""

    def __init__(self, text: str):
        module = ast.parse(text)
        self.numbers = numbers = whole_numbers(module, LANES)
        self.functions: dict[str, ast.FunctionDef] = {}
        self.definitions: dict[str, ast.stmt] = {}
        for node in module.body:
            if isinstance(node, ast.FunctionDef):
                fold(node, numbers)
                self.functions[node.name] = node
            elif isinstance(node, ast.ImportFrom):
                self.definitions |= {
                    alias.name: ast.ImportFrom(node.module, [alias], 0) for alias in node.names
                }
            elif isinstance(node, ast.Import):
                self.definitions |= {alias.asname or alias.name: node for alias in node.names}
            elif isinstance(node, ast.Assign):
                self.definitions |= dict.fromkeys(_names(node, ast.Store), node)
        self.codes = {
            name: code
            for name, node in self.functions.items()
            if (code := _codes(node)) is not None
        }
        self.indices = {name: index for index, name in enumerate(self.codes)}
        self.order = {name: index for index, name in enumerate(self.definitions)}

    def unit(self, name: str) -> CompileUnit:
        """Return the compile unit of the function of this name. Its text includes the definitions
        and functions that the function uses; other compile units are called by address."""
        inlined, called, definitions = [name], [], dict[str, None]()
        for function in inlined:  # grows
            pending = _used(self.functions[function], function == name)
            for used in pending:
                if used in self.codes and used != name:
                    called.append(used)
                elif used in self.functions and used not in inlined:
                    inlined.append(used)
                elif used in self.definitions and used not in definitions:
                    definitions[used] = None
                    pending += _names(self.definitions[used], ast.Load)
        statements = (
            self.definitions[used] for used in sorted(definitions, key=self.order.__getitem__)
        )
        lines = list(dict.fromkeys(ast.unparse(statement) for statement in statements))
        lines += [
            f"{used} = callee({self.indices[used]}, {self.codes[used]!r})"
            for used in dict.fromkeys(called)
        ]
        lines += [ast.unparse(self.functions[function]) for function in reversed(inlined[1:])]
        lines.append(ast.unparse(_as_unit(self.functions[name], self.codes[name])))
        return CompileUnit(name, _HEAD + "\n".join(lines) + "\n")


@lru_cache(maxsize=16)
def _module(text: str) -> _Module:
    """Parsed source text of a kernel; cached."""
    return _Module(text)


@lru_cache(maxsize=16)
def split(text: str) -> list[CompileUnit]:
    """Split a kernel into its compile units.

    Parameters
    ----------
    text : str
        source text of the kernel

    Returns
    -------
    list of CompileUnit
        in the order of the table of addresses, by which they call each other; the last one is the
        entry of the kernel
    """
    module = _module(text)
    return [module.unit(name) for name in module.indices]


def kernel_properties(text: str) -> dict[str, Any]:
    """Read the properties that a kernel states as constants of its module.

    Parameters
    ----------
    text : str
        source text of the kernel

    Returns
    -------
    dict
        ``size`` of the workspace, in floats; ``n_indicators``, ``n_segments`` and ``n_changes``,
        the numbers of error indicators, of segments, and of recorded times of kind changes and
        stroke ends within segments; ``methods``, for each segment a tuple of the names of its
        integration methods
    """
    module = _module(text)
    numbers, methods = module.numbers, module.definitions["METHODS"]
    assert isinstance(methods, ast.Assign)
    return {
        "size": numbers["SIZE_W"],
        "n_indicators": numbers["N_INDICATORS"],
        "n_segments": numbers["N_SEGMENTS"],
        "n_changes": numbers["N_CHANGES"],
        "methods": ast.literal_eval(methods.value),
    }


def _as_unit(function: ast.FunctionDef, codes: str) -> ast.FunctionDef:
    """Return a copy of a kernel function as the function of a compile unit: called `ENTRY`, with
    the address of the workspace as first argument, from which its first line makes ``w``; without
    docstring and the mark against inlining. ``codes`` are the letters of the types of its other
    arguments (`sepmc.translator.units.compile_unit`)."""
    mark, start = (
        ast.parse(line).body[0]
        for line in (f"@compile_unit({codes!r})\ndef {ENTRY}(): ...", _START)
    )
    assert isinstance(mark, ast.FunctionDef)
    arguments = [ast.arg("address"), *(ast.arg(other.arg) for other in function.args.args[1:])]
    mark.args.args, mark.body = arguments, [start, *_lines(function)]
    return mark


_START = "w = workspace(address)"


def _lines(function: ast.FunctionDef) -> list[ast.stmt]:
    """Statements of a function, without its docstring and the mark against inlining."""
    return [
        line
        for line in function.body[1:]
        if not (isinstance(line, ast.Expr) and _names(line, ast.Load) == [_MARK])
    ]


def _codes(node: ast.FunctionDef) -> str | None:
    """Letters of the types of a function's arguments after the workspace (values of `_CODES`), one
    each; None if the function cannot be a compile unit, because its first argument is not ``w`` or
    another one has no annotation of `_CODES`."""
    first, *others = node.args.args
    types = [
        other.annotation.id if isinstance(other.annotation, ast.Name) else "" for other in others
    ]
    if first.arg != "w" or not all(kind in _CODES for kind in types):
        return None
    return "".join(_CODES[kind] for kind in types)


def _used(function: ast.FunctionDef, as_unit: bool) -> list[str]:
    """Names that a function reads, each once, in the order of a walk through its syntax tree; with
    ``as_unit`` those in its statements only, not in its decorator, arguments and mark against
    inlining."""
    lines = _lines(function) if as_unit else [function]
    return list(dict.fromkeys(name for line in lines for name in _names(line, ast.Load)))


def _names(node: ast.AST, use: type[ast.expr_context]) -> list[str]:
    """Names that occur in a syntax tree in one ``use``: `ast.Load` (read) or `ast.Store`
    (assigned); a name may occur several times."""
    names, pending = [], [node]
    for part in pending:  # grows; `ast.walk` takes twice as long
        if isinstance(part, ast.Name):
            if isinstance(part.ctx, use):
                names.append(part.id)
            continue
        for field in part._fields:
            value = getattr(part, field, None)
            if isinstance(value, list):
                pending += value
            elif isinstance(value, ast.AST):
                pending.append(value)
    return names
