"""Sources of the functions that are translated: syntax trees, by function object."""

import ast
from dataclasses import dataclass
from functools import cache
from pathlib import Path
from types import FunctionType
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
    return Source(_functions(code.co_filename)[code.co_firstlineno], function.__globals__)


@cache
def _functions(path: str) -> dict[int, ast.FunctionDef]:
    """Functions of a Python file, by their first lines, decorators included."""
    return {
        min([node.lineno, *(mark.lineno for mark in node.decorator_list)]): node
        for node in ast.walk(ast.parse(Path(path).read_bytes()))
        if isinstance(node, ast.FunctionDef)
    }


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
