"""Constant folding of whole numbers in a written kernel: workspace offsets become sums of at most
two terms, which reduces the work of compiler and interpreter by a fifth."""

import ast
import operator
from collections.abc import Callable
from typing import Any

_OPERATIONS: dict[type[ast.operator], Callable[[int, int], int]] = {
    ast.Add: operator.add,
    ast.Mult: operator.mul,
}


def whole_numbers(module: ast.Module, lanes: int) -> dict[str, int]:
    """Integer constants of a kernel module, in their order of definition.

    Parameters
    ----------
    module : ast.Module
        its constants are folded in place
    lanes : int
        number of cases side by side

    Returns
    -------
    dict of str to int
        values by name; LANES, with the number of lanes, comes first
    """
    numbers = {"LANES": lanes}
    for node in module.body:
        if isinstance(node, ast.Assign):
            folded = node.value = _Folding(numbers).visit(node.value)
            values: list[Any] = folded.elts if isinstance(folded, ast.Tuple) else [folded]
            for name, value in zip(_targets(node), values, strict=False):
                if _is_whole(value):
                    numbers[name] = value.value
    return numbers


def fold(function: ast.FunctionDef, numbers: dict[str, int]) -> None:
    """Replace constant names by their values in a function that does not redefine them.

    Parameters
    ----------
    function : ast.FunctionDef
        changed in place
    numbers : dict of str to int
        values of the constants by name, of `whole_numbers`
    """
    for line in function.body:
        _Folding(numbers).visit(line)


def _targets(node: ast.Assign) -> list[str]:
    """Names assigned by a statement."""
    names = node.targets[0]
    return [
        target.id
        for target in (names.elts if isinstance(names, ast.Tuple) else [names])
        if isinstance(target, ast.Name)
    ]


def _is_whole(node: ast.expr) -> Any:
    """True for an integer constant."""
    return isinstance(node, ast.Constant) and type(node.value) is int


class _Folding(ast.NodeTransformer):
    """Replaces names of integer constants by their values and evaluates sums and products."""

    def __init__(self, numbers: dict[str, int]):
        self.numbers = numbers

    def visit_Name(self, node: ast.Name) -> ast.expr:
        """Replace a constant name by its value."""
        if isinstance(node.ctx, ast.Load) and node.id in self.numbers:
            return ast.copy_location(ast.Constant(self.numbers[node.id]), node)
        return node

    def visit_BinOp(self, node: ast.BinOp) -> ast.expr:
        """Evaluate a sum or product of constants."""
        left, right = self.visit(node.left), self.visit(node.right)
        do = _OPERATIONS.get(type(node.op))
        if do and _is_whole(left) and _is_whole(right):
            return ast.copy_location(ast.Constant(do(left.value, right.value)), node)
        node.left, node.right = left, right
        return node
