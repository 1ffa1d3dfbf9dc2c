"""Sources of the functions that are translated: syntax trees, by function object."""

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
    """Source of a function.

    Attributes
    ----------
    node : ast.FunctionDef
    names : dict
        Values of its global names.
    """

    node: ast.FunctionDef
    names: dict[str, Any]

    @property
    def inlined(self) -> bool:
        """True for a formula, which is inlined wherever it is called."""
        return _INLINED in self._decorators()

    @property
    def general(self) -> bool:
        """True if it is translated once, not anew for each known integer in its calls."""
        return self.inlined or _GENERAL in self._decorators()

    @property
    def body(self) -> list[ast.stmt]:
        """Its statements, without a docstring."""
        return self.node.body[1:] if ast.get_docstring(self.node, False) else self.node.body

    def _decorators(self) -> list[str]:
        return [mark.id for mark in self.node.decorator_list if isinstance(mark, ast.Name)]


@cache
def source_of(function: FunctionType) -> Source:
    """Source of a function of a module."""
    code = function.__code__
    if code.co_freevars:
        raise TypeError(f"{code.co_name} uses variables of the function around it")
    node, compiled = _functions(code.co_filename).get(code.co_firstlineno, (None, None))
    if node is None or compiled != code:
        raise TypeError(f"the file of {code.co_name} has changed since it was imported")
    return Source(node, function.__globals__)


@cache
def _functions(path: str) -> dict[int, tuple[ast.FunctionDef, CodeType]]:
    """Functions of a Python file and what Python compiles them to, by their first lines, decorators
    included."""
    tree = ast.parse(Path(path).read_bytes())
    codes = {code.co_firstlineno: code for code in _codes(compile(tree, path, "exec"))}
    lines = {
        min([node.lineno, *(mark.lineno for mark in node.decorator_list)]): node
        for node in ast.walk(tree)
        if isinstance(node, ast.FunctionDef)
    }
    return {line: (node, codes[line]) for line, node in lines.items()}


def _codes(code: CodeType) -> Iterator[CodeType]:
    """Code of the functions in a piece of code."""
    for inner in code.co_consts:
        if isinstance(inner, CodeType):
            yield inner
            yield from _codes(inner)


def unit_source(text: str, name: str) -> Source:
    """Source of the function ``name`` of the text of a compile unit. Its other functions are among
    its names, as sources."""
    tree = ast.parse(text)
    functions = [node for node in tree.body if isinstance(node, ast.FunctionDef)]
    others = [node for node in tree.body if not isinstance(node, ast.FunctionDef)]
    names: dict[str, Any] = {}
    exec(compile(ast.Module(others, []), "<unit>", "exec"), names)
    sources = {node.name: Source(node, names) for node in functions}
    names.update(sources)
    return sources[name]
