"""Written kernels run as plain Python: the same text, one lane, nothing compiled. Used for a few
cases of a new scene, and in a debugger.

The formulas that a text calls are imported a second time, for one lane. Python's floats make this
three times as fast as numpy's. Where numpy's would give
infinity or NaN and Python's raise an error (division by zero, roots and powers), safe operations
replace the plain ones.
"""

import ast
import contextlib
import importlib.abc
import importlib.machinery
import math
import sys
from collections.abc import Iterator
from functools import lru_cache, partial
from types import FunctionType, ModuleType, SimpleNamespace
from typing import Any

import numpy as np

from sepmc.engine.work_budget import SEARCHES, counting_lines
from sepmc.engine.written_kernel import Kernel
from sepmc.jit import config

_COPIED = ("sepmc.physics.", "sepmc.routines.")  # imported a second time
_plain: dict[str, ModuleType] = {}  # second copies, by name
_loaded: dict[str, Kernel] = {}  # kernels, by their text
_BETWEEN = "\n\n\n"  # two functions of a kernel


class Numbers(list[Any]):
    """List with the numbers of an array with one axis, and its shape."""

    @property
    def shape(self) -> tuple[int, ...]:
        """Shape, as that of an array with one axis."""
        return (len(self),)


class Table:
    """Array whose elements are read as Python's numbers and written through."""

    def __init__(self, array: np.ndarray):
        self.array, self.shape, self.item = array, array.shape, array.item

    def __getitem__(self, key: tuple[int, ...]) -> Any:
        return self.item(key)

    def __setitem__(self, key: Any, value: Any) -> None:
        self.array[key] = value


def as_python(array: np.ndarray, writable: bool = False) -> Any:
    """Convert an array for a kernel in plain Python.

    Parameters
    ----------
    array : ndarray
    writable : bool
        True if the kernel writes elements that have to arrive in ``array``.

    Returns
    -------
    Numbers, Table or list
        Numbers, fast to read, if the array has one axis and is not to be written; else a Table. For
        an array of records, a list of namespaces with the fields as attributes.
    """
    if array.dtype.names is not None:
        return [
            SimpleNamespace(**{name: row[name].item() for name in array.dtype.names})
            for row in array
        ]
    return Numbers(array.tolist()) if array.ndim == 1 and not writable else Table(array)


def _over(a: float, b: float) -> float:
    """Quotient of a number ``a`` and a zero ``b`` of either sign, as in IEEE 754: NaN or an
    infinity."""
    return (
        math.nan
        if a == 0.0 or math.isnan(a)
        else math.copysign(math.inf, a) * math.copysign(1.0, b)
    )


def _power(a: float, b: float) -> float:
    """Raise a number to a power; the result of numpy's power where Python's fails or is complex."""
    try:
        power = a**b
    except ArithmeticError:
        power = math.nan
    if isinstance(power, complex) or math.isnan(power):
        with np.errstate(all="ignore"):
            return float(np.float64(a) ** b)
    return power


def _rounded(rounding: Any) -> Any:
    """Version of a rounding function (`math.floor`, `math.ceil`) that returns a float with the sign
    of its argument, as numpy's; NaN and infinity stay as they are."""
    return lambda x: math.copysign(rounding(x), x) if math.isfinite(x) else x


_MATH = SimpleNamespace(**vars(math) | {"sqrt": lambda x: math.sqrt(x) if x >= 0.0 else math.nan})
_NUMPY = SimpleNamespace(**vars(np) | {"floor": _rounded(math.floor), "ceil": _rounded(math.ceil)})


class _Divisions(ast.NodeTransformer):
    """Replace ``a / b`` by ``a / d if (d := b) else _over(a, d)``, unless b is a constant, ``a **
    2`` by ``(c := a) * c``, as it is compiled, and other powers by ``_power(a, b)``."""

    def __init__(self) -> None:
        self.count = 0

    def visit_BinOp(self, node: ast.BinOp) -> ast.AST:
        """Replace a division or a power after its operands; keep other operations."""
        self.generic_visit(node)
        return self._safe(node, node.left, node.op, node.right)

    def visit_AugAssign(self, node: ast.AugAssign) -> ast.AST:
        """Replace ``a /= b`` and ``a **= b`` by assignments; keep others."""
        self.generic_visit(node)
        left = ast.parse(ast.unparse(node.target), mode="eval").body
        safe = self._safe(node, left, node.op, node.value)
        return node if safe is node else ast.copy_location(ast.Assign([node.target], safe), node)

    def _safe(self, node: Any, left: ast.expr, op: ast.operator, right: ast.expr) -> Any:
        """Safe expression of a division or a power, or the node itself."""

        def new(created: Any) -> Any:
            return ast.copy_location(created, node)

        if isinstance(op, ast.Pow) and isinstance(right, ast.Constant) and right.value == 2:
            self.count += 1
            name = f"_base_{self.count}"
            base, reused = new(ast.Name(name, ast.Store())), new(ast.Name(name, ast.Load()))
            return new(ast.BinOp(new(ast.NamedExpr(base, left)), ast.Mult(), reused))
        if isinstance(op, ast.Pow):
            return new(ast.Call(new(ast.Name("_power", ast.Load())), [left, right], []))
        if not isinstance(op, ast.Div) or (isinstance(right, ast.Constant) and right.value):
            return node
        self.count += 1
        name = f"_divisor_{self.count}"
        divisor, denominator = new(ast.Name(name, ast.Store())), new(ast.Name(name, ast.Load()))
        quotient = new(ast.Call(new(ast.Name("_over", ast.Load())), [left, denominator], []))
        return new(
            ast.IfExp(
                new(ast.NamedExpr(divisor, right)),
                new(ast.BinOp(left, ast.Div(), denominator)),
                quotient,
            )
        )


def _compiled(text: str, name: str) -> Any:
    """Compile Python source into code whose functions divide safely (`_Divisions`); ``name`` is its
    file name."""
    tree, divisions, lines = ast.parse(text), _Divisions(), text.splitlines()
    for k, node in enumerate(tree.body):
        if isinstance(node, ast.FunctionDef) and any(
            "/" in line or "**" in line for line in lines[node.lineno - 1 : node.end_lineno]
        ):
            tree.body[k] = divisions.visit(node)
    return compile(tree, name, "exec")


@lru_cache(maxsize=2000)
def _function_code(text: str) -> Any:
    """Compile the source of a function of a kernel with safe divisions; cached, since scenes that
    are alike share most functions."""
    return _compiled(text, "<kernel>")


def _run_module(text: str, names: dict[str, Any]) -> None:
    """Run the source of a kernel, function by function, in the namespace ``names``. The functions
    get the line numbers that they have in ``text``."""
    line = 0
    for part in text.split(_BETWEEN):
        before = set(names)
        exec(_function_code(part), names)
        for name in names.keys() - before:
            value = names[name]
            if _is_of_kernel(value):
                code = value.__code__
                value.__code__ = code.replace(co_firstlineno=code.co_firstlineno + line)
        line += (part + _BETWEEN).count("\n")


def _is_of_kernel(value: Any) -> bool:
    """Return True for functions that stand in the text of a kernel."""
    return isinstance(value, FunctionType) and value.__code__.co_filename == "<kernel>"


class _Loader(importlib.machinery.SourceFileLoader):
    """Import a module of formulas with safe divisions, without a cache file."""

    def get_code(self, fullname: str) -> Any:
        """Code of the module, compiled from its text with safe divisions."""
        path = self.get_filename(fullname)
        return _compiled(self.get_data(path).decode(), path)

    def exec_module(self, module: ModuleType) -> None:
        """Run the module with ``_over`` and ``_power`` among its names."""
        vars(module).update(_over=_over, _power=_power)
        super().exec_module(module)


class _Finder(importlib.abc.MetaPathFinder):
    """Find modules that are imported a second time."""

    def find_spec(
        self, fullname: str, path: Any, target: Any = None
    ) -> importlib.machinery.ModuleSpec | None:
        """Spec of a module that is imported a second time, with its loader; None for any other."""
        if not _is_copied(fullname):
            return None
        spec = importlib.machinery.PathFinder.find_spec(fullname, path, target)
        if spec is not None and spec.origin is not None:
            spec.loader = _Loader(fullname, spec.origin)
        return spec


def _is_copied(name: str) -> bool:
    """Return True for modules that are imported a second time."""
    return (name + ".").startswith(_COPIED)


def _copied() -> dict[str, ModuleType]:
    """Modules of formulas and routines in `sys.modules`, by name: those that are imported a second
    time."""
    return {name: module for name, module in sys.modules.items() if _is_copied(name)}


@contextlib.contextmanager
def _second_copies() -> Iterator[None]:
    """Context in which imports of formulas and routines give second copies; the first ones are back
    in `sys.modules` afterwards."""
    first, switch, finder = _copied(), config.plain, _Finder()
    package = sys.modules["sepmc"]
    for name in first:
        del sys.modules[name]
    sys.modules.update(_plain)
    config.plain = True
    sys.meta_path.insert(0, finder)
    try:
        yield
    finally:
        sys.meta_path.remove(finder)
        config.plain = switch
        _plain.update(_copied())
        for name in _copied():
            del sys.modules[name]
        sys.modules.update(first)
        for name, module in first.items():  # also attributes of the package
            if name.count(".") == 1:
                setattr(package, name.partition(".")[2], module)


def load(text: str) -> Kernel:
    """Load a kernel to run in plain Python (`sepmc.engine.blocks.integrate`)."""
    if text not in _loaded:
        module = ModuleType("sepmc_scene")
        vars(module).update(_over=_over, _power=_power)
        with _second_copies():
            _run_module(text, module.__dict__)
        for name, value in vars(module).items():
            if _is_of_kernel(value):
                setattr(module, name, counting_lines(value, has_workspace=True))
        for plain in (module, *_plain.values()):
            _in_python(plain)
        _loaded.clear()  # keep one scene: a thousand would fill the memory
        _loaded[text] = Kernel(
            n_indicators=module.N_INDICATORS,
            n_segments=module.N_SEGMENTS,
            n_changes=module.N_CHANGES,
            methods=module.METHODS,
            plain=module,
        )
    return _loaded[text]


def _in_python(module: ModuleType) -> None:
    """Change the names of a module so that it calculates with Python's numbers: replace math, numpy
    and arrays by versions for these, `linear.eliminate` by LAPACK, and wrap searches so that they
    count their lines."""
    for name, value in vars(module).items():
        if value is math:
            setattr(module, name, _MATH)
        elif value is np:
            setattr(module, name, _NUMPY)
        elif isinstance(value, np.ndarray):
            setattr(module, name, as_python(value))
        elif isinstance(value, FunctionType) and value.__module__ in SEARCHES:
            if not hasattr(value, "__wrapped__"):
                setattr(module, name, counting_lines(value))
        elif name == "eliminate" and not isinstance(value, partial):
            setattr(module, name, partial(_eliminate, value, vars(module)["_DEPENDENT"]))


def _eliminate(
    routine: Any, dependent: float, w: list[float], start: int, n: int, scratch: int, out: int
) -> float:
    """`linear.eliminate` for one lane by LAPACK, with the same pivoting: ten times as fast. Systems
    with NaN or infinity go to the ``routine`` itself; a pivot of at most ``dependent`` means a
    singular system."""
    from scipy.linalg import lapack  # noqa: PLC0415  (few scenes need it)

    numbers = np.array(w[start : start + n * n + n])
    if not np.isfinite(numbers).all():
        return float(routine(w, start, n, scratch, out))
    pivot, solution = 0.0, np.full(n, math.nan)
    matrix, right_side = numbers[: n * n].reshape(n, n), numbers[n * n :]
    largest = abs(matrix).max(axis=1)
    if largest.all():
        factors, order, _ = lapack.dgetrf(matrix / largest[:, None])
        smallest = float(abs(factors.diagonal()).min(initial=1.0))
        if smallest > dependent:
            pivot, solution = smallest, lapack.dgetrs(factors, order, right_side / largest)[0]
    w[out : out + n] = solution.tolist()
    return pivot
