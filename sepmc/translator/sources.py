"""Sources of the Python functions that are translated to LLVM assembly: the syntax tree of a
function, and the global names that it uses."""

import ast
from collections.abc import Iterator
from dataclasses import dataclass
from functools import cache
from pathlib import Path
from types import CodeType, FunctionType
from typing import Any

_INLINED, _GENERAL = "formula", "for_any_numbers"  # decorators


@dataclass(frozen=True, eq=False)
class Source:
    """Source of a function to translate.

    Attributes
    ----------
    node : ast.FunctionDef
        Syntax tree of the function.
    names : dict
        Globals of the function: objects by name.
    """

    node: ast.FunctionDef
    names: dict[str, Any]

    @property
    def inlined(self) -> bool:
        """True if the function has the decorator `sepmc.jit.formula`: LLVM inlines every call."""
        return _INLINED in self._decorators()

    @property
    def general(self) -> bool:
        """True if the function has the decorator `sepmc.jit.formula` or `for_any_numbers`: integers
        that are known in a call are passed as ordinary arguments. Otherwise the function is
        translated anew for each set of known integers, which become constants in it."""
        return self.inlined or _GENERAL in self._decorators()

    @property
    def body(self) -> list[ast.stmt]:
        """Statements of the function, without its docstring."""
        return self.node.body[1:] if ast.get_docstring(self.node, False) else self.node.body

    def _decorators(self) -> list[str]:
        return [mark.id for mark in self.node.decorator_list if isinstance(mark, ast.Name)]


@cache
def source_of(function: FunctionType) -> Source:
    """Return the source of a Python function, read from the file that defines it.

    Raises TypeError if the function uses variables of a function around it, or if its file has
    changed since Python imported it.
    """
    code = function.__code__
    if code.co_freevars:
        raise TypeError(
            f"{code.co_name} uses variables of the function around it; it must use its arguments "
            "and globals only"
        )
    node, compiled = _functions(code.co_filename).get(code.co_firstlineno, (None, None))
    if node is None or compiled != code:
        raise TypeError(f"the file of {code.co_name} has changed since it was imported")
    return Source(node, function.__globals__)


@cache
def _functions(path: str) -> dict[int, tuple[ast.FunctionDef, CodeType]]:
    """Parse a Python file. Returns, by the line number at which each of its functions begins
    (with its decorators), the syntax tree and the code object of the function."""
    tree = ast.parse(Path(path).read_bytes())
    codes = {code.co_firstlineno: code for code in _codes(compile(tree, path, "exec"))}
    lines = {
        min([node.lineno, *(mark.lineno for mark in node.decorator_list)]): node
        for node in ast.walk(tree)
        if isinstance(node, ast.FunctionDef)
    }
    return {line: (node, codes[line]) for line, node in lines.items()}


def _codes(code: CodeType) -> Iterator[CodeType]:
    """Yield all code objects (of functions, classes, lambdas) nested in a code object, at any
    depth."""
    for inner in code.co_consts:
        if isinstance(inner, CodeType):
            yield inner
            yield from _codes(inner)


def unit_source(text: str, name: str) -> Source:
    """Return the source of the function ``name`` in ``text``, the Python source of a compile unit.

    The imports and constants of ``text`` are executed; its functions are not, but are `Source`
    objects among the globals of each other.
    """
    tree = ast.parse(text)
    functions = [node for node in tree.body if isinstance(node, ast.FunctionDef)]
    others = [node for node in tree.body if not isinstance(node, ast.FunctionDef)]
    names: dict[str, Any] = {}
    exec(compile(ast.Module(others, []), "<unit>", "exec"), names)
    sources = {node.name: Source(node, names) for node in functions}
    names.update(sources)
    return sources[name]
