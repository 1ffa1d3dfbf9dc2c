"""A written module split into pieces, each compiled for itself and called by its address.

Numba optimises a function anew in every function that calls it, so a module compiled as a whole
costs two to three times its pieces. Pieces are compiled side by side, and kept by their own text,
without the name: a scene that differs in its outputs compiles only what differs, and phases share
what they have in common.

A piece is a function of the workspace and numbers. Functions that take anything else stay with
their callers. Places in the workspace are numbers in it.
"""

import ast
from dataclasses import dataclass
from functools import lru_cache
from typing import Any

from sepmc.kernel.tracer.folding import fold, whole_numbers
from sepmc.routines.layout import LANES

ALIKE = "flown"  # the name of its function in every piece
_CODES = {"int": "i", "float": "f", "Arrays": "a"}
_MARK = "noinline"  # called in a line that a piece has no use for
_HEAD = '''"""Piece of a written kernel."""

from sepmc.engine.compile_units import callee, compile_unit, workspace
'''


@dataclass(frozen=True)
class Piece:
    """A function of a module, and the text of a module that holds it alone with what it needs."""

    name: str
    text: str


class _Module:
    """What stands in a module: the statement that gives each name its meaning."""

    def __init__(self, text: str):
        module = ast.parse(text)
        self.numbers = numbers = whole_numbers(module, LANES)
        self.functions: dict[str, ast.FunctionDef] = {}
        self.meanings: dict[str, ast.stmt] = {}
        for node in module.body:
            if isinstance(node, ast.FunctionDef):
                fold(node, numbers)
                self.functions[node.name] = node
            elif isinstance(node, ast.ImportFrom):
                self.meanings |= {
                    alias.name: ast.ImportFrom(node.module, [alias], 0) for alias in node.names
                }
            elif isinstance(node, ast.Import):
                self.meanings |= {alias.asname or alias.name: node for alias in node.names}
            elif isinstance(node, ast.Assign):
                self.meanings |= dict.fromkeys(_names(node, ast.Store), node)
        self.codes = {
            name: code
            for name, node in self.functions.items()
            if (code := _codes(node)) is not None
        }
        self.places = {name: place for place, name in enumerate(self.codes)}
        self.order = {name: place for place, name in enumerate(self.meanings)}

    def piece(self, name: str) -> Piece:
        """The piece of a function, with the functions that it calls in the ordinary way."""
        own, called, needed = [name], [], dict[str, None]()
        for function in own:  # which grows
            left = _used(self.functions[function], function == name)
            for used in left:
                if used in self.codes and used != name:
                    called.append(used)
                elif used in self.functions and used not in own:
                    own.append(used)
                elif used in self.meanings and used not in needed:
                    needed[used] = None
                    left += _names(self.meanings[used], ast.Load)
        meanings = (self.meanings[used] for used in sorted(needed, key=self.order.__getitem__))
        lines = list(dict.fromkeys(ast.unparse(meaning) for meaning in meanings))
        lines += [
            f"{used} = callee({self.places[used]}, {self.codes[used]!r})"
            for used in dict.fromkeys(called)
        ]
        lines += [ast.unparse(self.functions[function]) for function in reversed(own[1:])]
        lines.append(ast.unparse(_as_piece(self.functions[name], self.codes[name])))
        return Piece(name, _HEAD + "\n".join(lines) + "\n")


@lru_cache(maxsize=16)
def _module(text: str) -> _Module:
    return _Module(text)


@lru_cache(maxsize=16)
def split(text: str) -> list[Piece]:
    """The pieces of a module in the order of their places in the table of addresses; the last is
    the one that is entered."""
    module = _module(text)
    return [module.piece(name) for name in module.places]


def told(text: str) -> dict[str, Any]:
    """What a kernel says of itself to who enters it: the ``size`` of its workspace, how many
    ``guards``, ``stages`` and sudden ``changes`` it has, and names of the ``methods`` of each
    stage."""
    module = _module(text)
    numbers, methods = module.numbers, module.meanings["METHODS"]
    assert isinstance(methods, ast.Assign)
    return {
        "size": numbers["SIZE_W"],
        "n_indicators": numbers["GUARDS"],
        "n_segments": numbers["STAGES"],
        "n_changes": numbers["CHANGES"],
        "methods": ast.literal_eval(methods.value),
    }


def _as_piece(function: ast.FunctionDef, codes: str) -> ast.FunctionDef:
    """A function whose workspace is given by its address, without its name and what it says."""
    mark, start = (
        ast.parse(line).body[0]
        for line in (f"@compile_unit({codes!r})\ndef {ALIKE}(): ...", _START)
    )
    assert isinstance(mark, ast.FunctionDef)
    arguments = [ast.arg("address"), *(ast.arg(other.arg) for other in function.args.args[1:])]
    mark.args.args, mark.body = arguments, [start, *_lines(function)]
    return mark


_START = "w = workspace(address)"


def _lines(function: ast.FunctionDef) -> list[ast.stmt]:
    """Lines of a function after what it says and the mark that keeps it apart."""
    return [
        line
        for line in function.body[1:]
        if not (isinstance(line, ast.Expr) and _names(line, ast.Load) == [_MARK])
    ]


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


def _used(function: ast.FunctionDef, as_piece: bool) -> list[str]:
    """Names that a function uses; as a piece, or as it stands."""
    lines = _lines(function) if as_piece else [function]
    return list(dict.fromkeys(name for line in lines for name in _names(line, ast.Load)))


def _names(node: ast.AST, use: type[ast.expr_context]) -> list[str]:
    """Names in a statement that are read, or given a meaning."""
    return [n.id for n in ast.walk(node) if isinstance(n, ast.Name) and isinstance(n.ctx, use)]
