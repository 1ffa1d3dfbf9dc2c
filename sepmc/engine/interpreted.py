"""Written kernels as plain Python: the same text, one lane, nothing compiled. For a few cases of a
new scene, and for a debugger.

The formulas that a text calls are imported a second time with the compiler off; the compiled ones
stay as they are. Numbers are Python's own, with which plain Python is three times as fast as with
numpy's. What these would do and Python's would not is put in on the way: division by zero, roots
and powers without an answer.
"""

import ast
import contextlib
import importlib.abc
import importlib.machinery
import math
import sys
from collections.abc import Iterator
from functools import partial
from types import FunctionType, ModuleType, SimpleNamespace
from typing import Any

import numpy as np

from sepmc.engine.work_budget import SEARCHES, counts
from sepmc.engine.written_kernel import Kernel
from sepmc.jit import config

_AGAIN = ("sepmc.jit", "sepmc.physics", "sepmc.routines")  # what is imported a second time
_plain: dict[str, ModuleType] = {}  # second copies, by name
_loaded: dict[str, Kernel] = {}  # kernels, by their text


class Numbers(list[Any]):
    """Numbers of an array of one axis."""

    @property
    def shape(self) -> tuple[int, ...]:
        """Shape, as an array of one axis has it."""
        return (len(self),)


class Table:
    """An array of several axes that gives and takes Python's numbers."""

    def __init__(self, array: np.ndarray):
        self.array, self.shape, self.item = array, array.shape, array.item

    def __getitem__(self, key: tuple[int, ...]) -> Any:
        return self.item(key)

    def __setitem__(self, key: Any, value: Any) -> None:
        self.array[key] = value


def in_numbers(array: np.ndarray, kept: bool = False) -> Any:
    """What a kernel is given for an array: a list that reads fast, or what is written to the array
    if it is to be ``kept``."""
    if array.dtype.names is not None:
        return [
            SimpleNamespace(**{name: row[name].item() for name in array.dtype.names})
            for row in array
        ]
    return Numbers(array.tolist()) if array.ndim == 1 and not kept else Table(array)


def _over(a: float, b: float) -> float:
    """A number over zero."""
    return (
        math.nan
        if a == 0.0 or math.isnan(a)
        else math.copysign(math.inf, a) * math.copysign(1.0, b)
    )


def _power(a: float, b: float) -> float:
    try:
        found = a**b
    except ArithmeticError:
        found = math.nan
    if isinstance(found, complex) or math.isnan(found):
        with np.errstate(all="ignore"):
            return float(np.float64(a) ** b)
    return found


def _rounded(to: Any) -> Any:
    return lambda x: math.copysign(to(x), x) if math.isfinite(x) else x


_MATH = SimpleNamespace(**vars(math) | {"sqrt": lambda x: math.sqrt(x) if x >= 0.0 else math.nan})
_NUMPY = SimpleNamespace(**vars(np) | {"floor": _rounded(math.floor), "ceil": _rounded(math.ceil)})


class _Divisions(ast.NodeTransformer):
    """``a / b`` as ``a / d if (d := b) else _over(a, d)``; ``a ** 2`` as ``(c := a) * c``, as it is
    compiled, other powers as ``_power(a, b)``."""

    def __init__(self) -> None:
        self.count = 0

    def visit_BinOp(self, node: ast.BinOp) -> ast.AST:
        """A division or a power made safe, its operands first; other operations as they are."""
        self.generic_visit(node)
        return self._safe(node, node.left, node.op, node.right)

    def visit_AugAssign(self, node: ast.AugAssign) -> ast.AST:
        """``a /= b`` and ``a **= b`` as assignments of what is safe; others as they are."""
        self.generic_visit(node)
        left = ast.parse(ast.unparse(node.target), mode="eval").body
        safe = self._safe(node, left, node.op, node.value)
        return node if safe is node else ast.copy_location(ast.Assign([node.target], safe), node)

    def _safe(self, node: Any, left: ast.expr, op: ast.operator, right: ast.expr) -> Any:
        def new(made: Any) -> Any:
            return ast.copy_location(made, node)

        if isinstance(op, ast.Pow) and isinstance(right, ast.Constant) and right.value == 2:
            self.count += 1
            name = f"_base_{self.count}"
            base, again = new(ast.Name(name, ast.Store())), new(ast.Name(name, ast.Load()))
            return new(ast.BinOp(new(ast.NamedExpr(base, left)), ast.Mult(), again))
        if isinstance(op, ast.Pow):
            return new(ast.Call(new(ast.Name("_power", ast.Load())), [left, right], []))
        if not isinstance(op, ast.Div) or (isinstance(right, ast.Constant) and right.value):
            return node
        self.count += 1
        name = f"_divisor_{self.count}"
        divisor, there = new(ast.Name(name, ast.Store())), new(ast.Name(name, ast.Load()))
        other = new(ast.Call(new(ast.Name("_over", ast.Load())), [left, there], []))
        return new(
            ast.IfExp(
                new(ast.NamedExpr(divisor, right)), new(ast.BinOp(left, ast.Div(), there)), other
            )
        )


def _compiled(text: str, name: str) -> Any:
    """Python's code of a text whose functions divide safely."""
    tree, divisions, lines = ast.parse(text), _Divisions(), text.splitlines()
    for k, node in enumerate(tree.body):
        if isinstance(node, ast.FunctionDef) and any(
            "/" in line or "**" in line for line in lines[node.lineno - 1 : node.end_lineno]
        ):
            tree.body[k] = divisions.visit(node)
    return compile(tree, name, "exec")


class _Loader(importlib.machinery.SourceFileLoader):
    """A module of formulas with divisions made safe; none of that is kept on disk."""

    def get_code(self, fullname: str) -> Any:
        """Code of the module, compiled from its text."""
        path = self.get_filename(fullname)
        return _compiled(self.get_data(path).decode(), path)

    def exec_module(self, module: ModuleType) -> None:
        """Run the module with ``_over`` and ``_power`` among its names."""
        vars(module).update(_over=_over, _power=_power)
        super().exec_module(module)


class _Finder(importlib.abc.MetaPathFinder):
    def find_spec(
        self, fullname: str, path: Any, target: Any = None
    ) -> importlib.machinery.ModuleSpec | None:
        """Where a module is that is imported a second time, with its loader; None for any other."""
        if not _is_ours(fullname):
            return None
        spec = importlib.machinery.PathFinder.find_spec(fullname, path, target)
        if spec is not None and spec.origin is not None:
            spec.loader = _Loader(fullname, spec.origin)
        return spec


def _is_ours(name: str) -> bool:
    return any(name == ours or name.startswith(ours + ".") for ours in _AGAIN)


def _ours() -> dict[str, ModuleType]:
    return {name: module for name, module in sys.modules.items() if _is_ours(name)}


@contextlib.contextmanager
def _without_compiler() -> Iterator[None]:
    """Let formulas and routines, imported meanwhile, be their second copies."""
    compiled, switch, finder = _ours(), config.DISABLE_JIT, _Finder()
    package = sys.modules["sepmc"]
    for name in compiled:
        del sys.modules[name]
    sys.modules.update(_plain)
    config.DISABLE_JIT = 1
    sys.meta_path.insert(0, finder)
    try:
        yield
    finally:
        sys.meta_path.remove(finder)
        config.DISABLE_JIT = switch
        _plain.update(_ours())
        for name in _ours():
            del sys.modules[name]
        sys.modules.update(compiled)
        for name, module in compiled.items():  # the package holds its parts by name, too
            if name.count(".") == 1:
                setattr(package, name.partition(".")[2], module)


def load(text: str) -> Kernel:
    """The kernel with this text, to be flown by `sepmc.engine.blocks.integrate` in plain Python."""
    if text not in _loaded:
        module = ModuleType("sepmc_scene")
        vars(module).update(_over=_over, _power=_power)
        with _without_compiler():
            exec(_compiled(text, "<kernel>"), module.__dict__)
        for name, value in vars(module).items():
            if isinstance(value, FunctionType) and value.__code__.co_filename == "<kernel>":
                setattr(module, name, counts(value, has_workspace=True))
        for plain in (module, *_plain.values()):
            _in_python(plain)
        _loaded.clear()  # one scene at a time: a thousand would fill the memory
        _loaded[text] = Kernel(
            n_indicators=module.GUARDS,
            n_segments=module.STAGES,
            n_changes=module.CHANGES,
            methods=module.METHODS,
            plain=module,
        )
    return _loaded[text]


def _in_python(module: ModuleType) -> None:
    """Let a module calculate with Python's numbers."""
    for name, value in vars(module).items():
        if value is math:
            setattr(module, name, _MATH)
        elif value is np:
            setattr(module, name, _NUMPY)
        elif isinstance(value, np.ndarray):
            setattr(module, name, in_numbers(value))
        elif isinstance(value, FunctionType) and value.__module__ in SEARCHES:
            if not hasattr(value, "__wrapped__"):
                setattr(module, name, counts(value))
        elif name == "eliminate" and not isinstance(value, partial):
            setattr(module, name, partial(_eliminate, value, vars(module)["_DEPENDENT"]))


def _eliminate(
    routine: Any, dependent: float, w: list[float], place: int, n: int, scratch: int, out: int
) -> float:
    """`linear.eliminate` of one lane by LAPACK, which pivots alike: ten times as fast. What is no
    number is left to the routine itself."""
    from scipy.linalg import lapack  # noqa: PLC0415  (that other scenes do not need)

    numbers = np.array(w[place : place + n * n + n])
    if not np.isfinite(numbers).all():
        return float(routine(w, place, n, scratch, out))
    pivot, found = 0.0, np.full(n, math.nan)
    matrix, side = numbers[: n * n].reshape(n, n), numbers[n * n :]
    largest = abs(matrix).max(axis=1)
    if largest.all():
        factors, order, _ = lapack.dgetrf(matrix / largest[:, None])
        smallest = float(abs(factors.diagonal()).min(initial=1.0))
        if smallest > dependent:
            pivot, found = smallest, lapack.dgetrs(factors, order, side / largest)[0]
    w[out : out + n] = found.tolist()
    return pivot
