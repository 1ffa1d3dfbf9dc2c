"""Running of kernels as plain Python: the same source, one case at a time, nothing compiled. Used
for a few cases of a new scene, and in a debugger.

The formulas and routines that a kernel calls are imported a second time, for one lane (LANES = 1).
They calculate with Python's floats, three times as fast as numpy's. Where Python raises an error
and compiled code gives infinity or NaN (division by zero, roots and powers), safe operations
replace the plain ones.
"""

import ast
import contextlib
import importlib.abc
import importlib.machinery
import math
import re
import sys
from collections.abc import Iterator
from functools import lru_cache, partial
from itertools import repeat
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
# loops over components and, within, lanes (`Text.components`); index of their bodies
_COMPONENTS = re.compile(r"for e in range\(0, (.+), LANES\):\n +for l in range\(LANES\):\n")
_OF_COMPONENT = re.compile(r"\+ e\s+\+ l\b")


class Numbers(list[Any]):
    """List with copies of the numbers of a 1-D array, and the attribute ``shape`` of that array."""

    @property
    def shape(self) -> tuple[int, ...]:
        """Shape of the 1-D array: (number of items,)."""
        return (len(self),)


class Table:
    """Wrapper of an array: elements are read as Python's numbers, and written to the array."""

    def __init__(self, array: np.ndarray):
        self.array, self.shape, self.item = array, array.shape, array.item

    def __getitem__(self, key: tuple[int, ...]) -> Any:
        return self.item(key)

    def __setitem__(self, key: Any, value: Any) -> None:
        self.array[key] = value


def as_python(array: np.ndarray, writable: bool = False) -> Any:
    """Convert an array to an object of Python's numbers, for a kernel that runs as plain Python.

    Parameters
    ----------
    array : ndarray
    writable : bool
        True if elements that the kernel writes must appear in ``array``.

    Returns
    -------
    Numbers, Table or list
        Numbers, a copy that is fast to read, if the array has one axis and is not ``writable``;
        else a Table. For an array of records, a list of namespaces with the fields as attributes.
    """
    if array.dtype.names is not None:
        return [
            SimpleNamespace(**{name: row[name].item() for name in array.dtype.names})
            for row in array
        ]
    return Numbers(array.tolist()) if array.ndim == 1 and not writable else Table(array)


def _over(a: float, b: float) -> float:
    """Return the quotient a / b for a zero ``b`` of either sign, as in IEEE 754: NaN if a is 0 or
    NaN, else infinity with the sign of the quotient."""
    return (
        math.nan
        if a == 0.0 or math.isnan(a)
        else math.copysign(math.inf, a) * math.copysign(1.0, b)
    )


def _power(a: float, b: float) -> float:
    """Return a to the power b: numpy's result (NaN or infinity) where Python raises an error or
    gives a complex number."""
    try:
        power = a**b
    except ArithmeticError:
        power = math.nan
    if isinstance(power, complex) or math.isnan(power):
        with np.errstate(all="ignore"):
            return float(np.float64(a) ** b)
    return power


def _rounded(rounding: Any) -> Any:
    """Return a version of `math.floor` or `math.ceil` that works as numpy's: its result is a float
    with the sign of the argument; NaN and infinity are returned unchanged."""
    return lambda x: math.copysign(rounding(x), x) if math.isfinite(x) else x


_MATH = SimpleNamespace(**vars(math) | {"sqrt": lambda x: math.sqrt(x) if x >= 0.0 else math.nan})
_NUMPY = SimpleNamespace(**vars(np) | {"floor": _rounded(math.floor), "ceil": _rounded(math.ceil)})


class _Divisions(ast.NodeTransformer):
    """Transformer of a syntax tree that makes divisions and powers safe.

    It replaces ``a / b`` by ``a / d if (d := b) else _over(a, d)``, unless b is a constant that is
    not 0; ``a ** 2`` by ``(c := a) * c``, as it is compiled; and other powers by ``_power(a, b)``.
    """

    def __init__(self) -> None:
        self.count = 0

    def visit_BinOp(self, node: ast.BinOp) -> ast.AST:
        """Return the safe expression for a division or a power, and other operations as they are.
        In all of them, divisions and powers within the operands are made safe first."""
        self.generic_visit(node)
        return self._safe(node, node.left, node.op, node.right)

    def visit_AugAssign(self, node: ast.AugAssign) -> ast.AST:
        """Return an assignment of the safe expression for ``a /= b`` and ``a **= b``; return other
        augmented assignments as they are. In all of them, divisions and powers within ``a`` and
        ``b`` are made safe first."""
        self.generic_visit(node)
        left = ast.parse(ast.unparse(node.target), mode="eval").body
        safe = self._safe(node, left, node.op, node.value)
        return node if safe is node else ast.copy_location(ast.Assign([node.target], safe), node)

    def _safe(self, node: Any, left: ast.expr, op: ast.operator, right: ast.expr) -> Any:
        """Return the safe expression for ``left op right`` if it is a division or a power that
        needs one; else the ``node`` itself, from which it was taken."""

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
    """Compile Python source into a code object in whose functions divisions and powers are safe
    (`_Divisions`). ``name`` is its file name in tracebacks."""
    tree, divisions, lines = ast.parse(text), _Divisions(), text.splitlines()
    for k, node in enumerate(tree.body):
        if isinstance(node, ast.FunctionDef) and any(
            "/" in line or "**" in line for line in lines[node.lineno - 1 : node.end_lineno]
        ):
            tree.body[k] = divisions.visit(node)
    return compile(tree, name, "exec")


@lru_cache(maxsize=2000)
def _function_code(text: str) -> Any:
    """Compile a function of a kernel, given by its source, with safe divisions. A loop over
    components and the loop over the one lane within it become one loop, which is faster. The code
    object is cached, since similar scenes share most functions."""
    joined = _COMPONENTS.sub(r"for e, l in zip(range(\1), _ZEROS):\n\n", text)
    return _compiled(_OF_COMPONENT.sub("+ e", joined), "<kernel>")


def _run_module(text: str, names: dict[str, Any]) -> None:
    """Execute the source of a kernel, function by function, which adds its functions and constants
    to the dict ``names``. The functions get the line numbers that they have in ``text``."""
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
    """Return True for a function that is defined in the source of a kernel, not imported by it."""
    return isinstance(value, FunctionType) and value.__code__.co_filename == "<kernel>"


class _Loader(importlib.machinery.SourceFileLoader):
    """Loader that imports a module with safe divisions, and without reading or writing a bytecode
    file."""

    def get_code(self, fullname: str) -> Any:
        """Return the code object of a module, compiled from its source with safe divisions."""
        path = self.get_filename(fullname)
        return _compiled(self.get_data(path).decode(), path)

    def exec_module(self, module: ModuleType) -> None:
        """Execute the module after adding ``_over`` and ``_power`` to its globals."""
        vars(module).update(_over=_over, _power=_power)
        super().exec_module(module)


class _Finder(importlib.abc.MetaPathFinder):
    """Finder of the modules that are imported a second time, with `_Loader`."""

    def find_spec(
        self, fullname: str, path: Any, target: Any = None
    ) -> importlib.machinery.ModuleSpec | None:
        """Return the spec, with `_Loader`, of a module that is imported a second time; None for any
        other module."""
        if not _is_copied(fullname):
            return None
        spec = importlib.machinery.PathFinder.find_spec(fullname, path, target)
        if spec is not None and spec.origin is not None:
            spec.loader = _Loader(fullname, spec.origin)
        return spec


def _is_copied(name: str) -> bool:
    """Return True for the name of a module that is imported a second time: a package of `_COPIED`
    or a module in it."""
    return (name + ".").startswith(_COPIED)


def _copied() -> dict[str, ModuleType]:
    """Return the modules in `sys.modules`, by name, that are formulas or routines: within
    `_second_copies` their second copies, else the first ones (the modules as the rest of sepmc
    imports them)."""
    return {name: module for name, module in sys.modules.items() if _is_copied(name)}


@contextlib.contextmanager
def _second_copies() -> Iterator[None]:
    """Context in which imports of formulas and routines give second copies, with safe divisions and
    one lane. At its end the first copies are put back into `sys.modules`."""
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
    """Return a kernel, given by its source, to run as plain Python
    (`sepmc.engine.blocks.integrate`); the last one is cached."""
    if text not in _loaded:
        module = ModuleType("sepmc_scene")
        vars(module).update(_over=_over, _power=_power, _ZEROS=repeat(0))
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
    """Change the globals of a module so that it calculates with Python's numbers.

    ``math``, ``numpy`` and arrays are replaced by versions for these, `linear.eliminate` by LAPACK;
    functions of the modules `SEARCHES` are wrapped so that they count their lines.
    """
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
    """Solve a system as `linear.eliminate` does, with the same pivoting, but by LAPACK, which is
    ten times as fast in Python.

    Arguments from ``w`` on and the result (smallest pivot, 0 if singular) are those of
    `linear.eliminate`; here a workspace has one lane, so numbers are adjacent in it. Systems with
    NaN or infinity are passed to ``routine``, which is `linear.eliminate` itself. A system is
    singular if, with each row divided by its largest entry, the smallest pivot is at most
    ``dependent``.
    """
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
