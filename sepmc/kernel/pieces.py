"""A written module split into pieces, each compiled for itself and called by its address.

Numba optimises a function anew in every function that calls it, so a module compiled as a whole
costs two to three times its pieces. Pieces are compiled side by side, and kept by their own text,
without the name: a scene that differs in its outputs compiles only what differs, and phases share
what they have in common.

A piece is a function of the workspace and numbers. Functions that take anything else stay with
their callers.
"""

import ast
import re
from dataclasses import dataclass
from functools import lru_cache

ENTRY = "fly_block"
ALIKE = "flown"  # the name of its function in every piece
_CODES = {"int": "i", "float": "f", "Arrays": "a"}
_MARKS = ("keep_apart()",)  # a line of a stage that a piece has no use for


@dataclass(frozen=True)
class Piece:
    """A function of a module, and the text of a module that holds it alone with what it needs."""

    name: str
    text: str


class _Module:
    """What stands in a module: the line or lines that give each name its meaning."""

    def __init__(self, text: str):
        self.lines = text.splitlines()
        self.functions: dict[str, ast.FunctionDef] = {}
        self.meanings: dict[str, ast.stmt] = {}
        for node in ast.parse(text).body:
            if isinstance(node, ast.FunctionDef):
                self.functions[node.name] = node
            elif isinstance(node, ast.Import | ast.ImportFrom):
                self.meanings |= {alias.asname or alias.name: node for alias in node.names}
            elif isinstance(node, ast.Assign):
                self.meanings |= dict.fromkeys(_stored(node), node)
        self.codes = {
            name: code
            for name, node in self.functions.items()
            if (code := _codes(node)) is not None
        }
        self.places = {name: place for place, name in enumerate(self.codes)}

    def source(self, node: ast.stmt) -> list[str]:
        """Lines of a statement, its decorators among them."""
        first = min([node.lineno, *(d.lineno for d in getattr(node, "decorator_list", []))])
        return self.lines[first - 1 : node.end_lineno]

    def line(self, name: str, node: ast.stmt) -> list[str]:
        """What gives a name its meaning; of an import, only the part that does."""
        return (
            [f"from {node.module} import {name}"]
            if isinstance(node, ast.ImportFrom)
            else self.source(node)
        )

    def piece(self, name: str) -> Piece:
        """The piece of a function, with the functions that it calls in the ordinary way."""
        own: list[str] = []
        called: list[str] = []
        needed: dict[str, ast.stmt] = {}
        left = [name]
        if name == ENTRY:
            needed |= {
                constant: self.meanings[constant] for constant in ("SIZE_W", "GUARDS", "STAGES")
            }
        while left:
            function = left.pop()
            own.append(function)
            names = list(_loaded(self.functions[function], function == name))
            while names:
                used = names.pop(0)
                if used in self.codes and used != name:
                    called.append(used)
                elif used in self.functions and used not in own:
                    left.append(used)
                elif used in self.meanings and used not in needed:
                    needed[used] = self.meanings[used]
                    names += _loaded(self.meanings[used])
        lines = [
            '"""Piece of a written kernel."""',
            "",
            "from sepmc.engine.pieces import callee, piece, workspace",
        ]
        order = sorted(needed, key=lambda used: (needed[used].lineno, used))
        for used in order:
            lines += [text for text in self.line(used, needed[used]) if text not in lines]
        lines += [
            f"{used} = callee({self.places[used]}, {self.codes[used]!r})"
            for used in dict.fromkeys(called)
        ]
        for function in reversed(own):
            source = [
                text
                for text in self.source(self.functions[function])
                if function != name or text.strip() not in _MARKS
            ]
            if function == name:
                source = _as_piece(source, name, self.codes[name])
            lines += ["", "", *source]
        return Piece(name, "\n".join(lines) + "\n")


@lru_cache(maxsize=16)
def split(text: str) -> list[Piece]:
    """The pieces of a module in the order of their places in the table of addresses; the last is
    the one that is entered."""
    module = _Module(text)
    return [module.piece(name) for name in module.places]


def _as_piece(source: list[str], name: str, codes: str) -> list[str]:
    """Lines of a function whose workspace is given by its address, without its name and what it
    says."""
    lines = [f"@piece({codes!r})" if line.startswith("@") else line for line in source]
    head = next(i for i, line in enumerate(lines) if line.startswith("def "))
    lines[head] = re.sub(r": [A-Za-z]+", "", lines[head]).replace(f"{name}(w", f"{ALIKE}(address")
    says = next(i for i, line in enumerate(lines) if line.rstrip().endswith('"""') and i > head)
    return [*lines[: head + 1], "    w = workspace(address)", *lines[says + 1 :]]


def _codes(node: ast.FunctionDef) -> str | None:
    """A letter for each number that a function takes besides the workspace; None if it is not a
    function of these."""
    first, *others = node.args.args
    kinds = [
        other.annotation.id if isinstance(other.annotation, ast.Name) else "" for other in others
    ]
    if first.arg != "w" or not all(kind in _CODES for kind in kinds):
        return None
    return "".join(_CODES[kind] for kind in kinds)


def _stored(node: ast.AST) -> list[str]:
    return [
        n.id for n in ast.walk(node) if isinstance(n, ast.Name) and isinstance(n.ctx, ast.Store)
    ]


@lru_cache(maxsize=4096)
def _loaded(node: ast.stmt, body_only: bool = False) -> list[str]:
    """Names that a statement uses, or the body of a function."""
    parts = node.body if body_only and isinstance(node, ast.FunctionDef) else [node]
    found = [
        n.id
        for part in parts
        for n in ast.walk(part)
        if isinstance(n, ast.Name) and isinstance(n.ctx, ast.Load)
    ]
    return [name for name in dict.fromkeys(found) if not (body_only and f"{name}()" in _MARKS)]
