"""Translation of a function, from its syntax tree to LLVM assembly.

The language is the subset of Python that kernels, formulas and routines are written in: numbers,
tuples, arrays, loops over ranges and tuples, `while`, branches, calls. Types follow from those of
the arguments. A variable that branches or loops assign keeps the type of its first value.
"""

import ast
import builtins
from collections.abc import Callable, Iterable, Iterator
from functools import partial
from types import FunctionType, ModuleType
from typing import Any

import numpy as np

from sepmc.translator import operations
from sepmc.translator.sources import Source, source_of
from sepmc.translator.units import callee
from sepmc.translator.values import (
    BOOL,
    INT,
    POINTER,
    Array,
    Named,
    Number,
    Record,
    common_kind,
    constant,
    leaves,
    rebuilt,
    require_alike,
)
from sepmc.translator.variables import variables_of
from sepmc.translator.writer import Writer

_ZERO_I = constant(0)
_CHEAP = (
    ast.Constant, ast.Name, ast.UnaryOp, ast.Compare, ast.BoolOp, ast.Tuple, ast.expr_context,
    ast.unaryop, ast.cmpop, ast.boolop,
)  # fmt: skip
_ERRORS = (ArithmeticError, AttributeError, LookupError, TypeError, ValueError)


class TranslationError(TypeError):
    """A function uses Python that cannot be translated. The argument is the message, with the name
    of the function and the line."""


class Function(Writer):
    """Function of Python translated to LLVM; creating the object translates the whole function.

    Afterwards ``lines`` has its instructions, ``result`` the value that it returns, and
    ``noinline`` is true if it must not be inlined. `define` then adds it to the module.

    Parameters
    ----------
    source : Source
    arguments : tuple
        Value (`sepmc.translator.values`) of each argument.
    module : sepmc.translator.module.Module
        Module that gets the functions that this one calls, and this one by `define`.
    keeps_loops : bool
        True if LLVM must not unroll any loop over a range, as it must not those over
        ``range(LANES)``: it would take them apart before it looks for loops to vectorise, and their
        code would stay scalar.

    Raises
    ------
    TranslationError
        If a statement or expression cannot be translated.
    TypeError
        If the number of arguments is not that of the function.
    """

    def __init__(
        self,
        source: Source,
        arguments: tuple[Any, ...],
        module: Any,
        keeps_loops: bool = False,
    ):
        super().__init__(module)
        self.source, self.keeps_loops = source, keeps_loops
        self.variables = variables_of(source.node)
        self.values: dict[str, Any] = {}  # of names
        self.slots: dict[str, Any] = {}  # of names: pointers to their numbers, first value
        self.loops: list[tuple[str, str]] = []  # labels after `continue` and `break`
        self.result: Any = None
        self.returns = False
        self.noinline = False
        names = [argument.arg for argument in source.node.args.args]
        if len(names) != len(arguments):
            raise TypeError(
                f"{source.node.name} takes {len(names)} arguments; this call has another number"
            )
        for name, value in zip(names, arguments, strict=True):
            self._assign_name(name, value)
        self._body(source.body)
        if not self.ended:
            self._return(())

    # Statements

    def _fail(self, node: ast.AST, reason: str) -> TranslationError:
        line = getattr(node, "lineno", 0)
        return TranslationError(f"{self.source.node.name}, line {line}: {reason}")

    def _body(self, lines: list[ast.stmt]) -> None:
        for line in lines:
            if self.ended:
                return
            method = getattr(self, f"_{type(line).__name__.lower()}_line", None)
            if method is None:
                raise self._fail(line, f"{type(line).__name__} cannot be translated")
            if getattr(line, "orelse", None) and not isinstance(line, ast.If):
                raise self._fail(line, "a loop has no else here")
            try:
                method(line)
            except TranslationError:
                raise
            except _ERRORS as error:
                raise self._fail(line, str(error)) from error

    def _expr_line(self, line: ast.Expr) -> None:
        self.value(line.value)

    def _pass_line(self, line: ast.Pass) -> None:
        pass

    def _assign_line(self, line: ast.Assign) -> None:
        value = self.value(line.value)
        for target in line.targets:
            self._assign(target, value)

    def _augassign_line(self, line: ast.AugAssign) -> None:
        target = line.target
        if isinstance(target, ast.Name):
            value = self.value(line.value)
            self._assign_name(target.id, self.operate(line.op, self._read(target), value))
            return
        assert isinstance(target, ast.Subscript)
        element, pointer = self._element(target)
        old = self.emit(element, f"load {element}, ptr {pointer.text}")
        value = self.value(line.value)
        self._store(self.operate(line.op, old, value), element, pointer)

    def _assign(self, target: ast.expr, value: Any) -> None:
        if isinstance(target, ast.Name):
            self._assign_name(target.id, value)
        elif isinstance(target, ast.Tuple):
            items = value.values if isinstance(value, Named) else value
            for one, item in zip(target.elts, items, strict=True):
                self._assign(one, item)
        elif isinstance(target, ast.Subscript):
            element, pointer = self._element(target)
            self._store(value, element, pointer)
        else:
            raise self._fail(
                target, "an assignment must be to a name, a tuple of targets or an array element"
            )

    def _store(self, value: Number, element: str, pointer: Number) -> None:
        number = self.converted(value, element)
        self.run(f"store {element} {number.text}, ptr {pointer.text}")

    def _assign_name(self, name: str, value: Any) -> None:
        if not self.variables[name]:
            self.values[name] = value
            return
        if name not in self.slots:
            pointers = [self.allocate(number.kind) for number in leaves(value)]
            self.slots[name] = rebuilt(value, iter(pointers)), value
        slot, first = self.slots[name]
        require_alike(first, value)
        for number, pointer, like in zip(leaves(value), leaves(slot), leaves(first), strict=True):
            self._store(number, like.kind, pointer)

    def _read(self, node: ast.Name) -> Any:
        name = node.id
        if name in self.slots:
            slot, first = self.slots[name]
            numbers = [
                self.emit(like.kind, f"load {like.kind}, ptr {pointer.text}")
                for pointer, like in zip(leaves(slot), leaves(first), strict=True)
            ]
            return rebuilt(first, iter(numbers))
        if name in self.values:
            return self.values[name]
        if name in self.variables:
            raise self._fail(node, f"{name} is read before the first assignment in the text")
        return self.lift(self._global(node))

    def _global(self, node: ast.Name) -> Any:
        names = self.source.names
        if node.id in names:
            return names[node.id]
        try:
            return getattr(builtins, node.id)
        except AttributeError:
            raise self._fail(
                node, f"unknown name {node.id}: no variable, global name or builtin of Python"
            ) from None

    def lift(self, value: Any) -> Any:
        """Return the value of a Python object that the function reads as a global: numbers, tuples
        of them and NumPy arrays become constants; other objects, such as functions, are returned
        unchanged."""
        if isinstance(value, bool | int | float | np.floating):
            return constant(value)
        if isinstance(value, tuple) and not hasattr(value, "_fields"):
            return tuple(self.lift(item) for item in value)
        if isinstance(value, np.ndarray):
            return self.module.constant_array(value)
        return value

    def _return_line(self, line: ast.Return) -> None:
        self._return(() if line.value is None else self.value(line.value))

    def _return(self, value: Any) -> None:
        if not self.returns:
            self.result, self.returns = value, True
        require_alike(self.result, value)
        kinds = [leaf.kind for leaf in leaves(self.result)]
        numbers = [
            self.converted(number, kind) for number, kind in zip(leaves(value), kinds, strict=True)
        ]
        if not kinds:
            self.run("ret void")
        elif len(kinds) == 1:
            self.run(f"ret {kinds[0]} {numbers[0].text}")
        else:
            kind, whole = result_type(kinds), "poison"
            for k, number in enumerate(numbers):
                text = f"insertvalue {kind} {whole}, {number.kind} {number.text}, {k}"
                whole = self.emit(kind, text).text
            self.run(f"ret {kind} {whole}")
        self.ended = True

    def _if_line(self, line: ast.If) -> None:
        test = operations.truth(self, self.value(line.test))
        if test.constant is not None:
            self._body(line.body if test.constant else line.orelse)
            return
        yes, no, after = self.label(), self.label(), self.label()
        self.branch(test, yes, no)
        goes_on = False
        for label, lines in ((yes, line.body), (no, line.orelse)):
            self.begin(label)
            self._body(lines)
            goes_on = goes_on or not self.ended
            self.jump(after)
        if goes_on:
            self.begin(after)

    def _while_line(self, line: ast.While) -> None:
        test, body, after = self.label(), self.label(), self.label()
        self.jump(test)
        self.begin(test)
        self.branch(operations.truth(self, self.value(line.test)), body, after)
        self.begin(body)
        self._round(line, test, after)
        self.begin(after)

    def _round(self, line: ast.For | ast.While, following: str, after: str) -> None:
        """Translate the body of a loop. ``following`` is the label at which the next iteration
        begins, ``after`` the label behind the loop: the targets of `continue` and `break`."""
        self.loops.append((following, after))
        self._body(line.body)
        self.loops.pop()
        self.jump(following)

    def _for_line(self, line: ast.For) -> None:
        if isinstance(line.iter, ast.Call) and self.value(line.iter.func) is range:
            self._range(line, [self.value(argument) for argument in line.iter.args])
            return
        items = self.value(line.iter)
        if not isinstance(items, tuple):
            raise self._fail(line, "a `for` loop must go over a range or a tuple")
        after = self.label()
        for item in items:
            following = self.label()
            self._assign(line.target, item)
            self._round(line, following, after)
            self.begin(following)
        self.jump(after)
        self.begin(after)

    def _range(self, line: ast.For, limits: list[Number]) -> None:
        """Translate a loop over a range, given by the one to three arguments ``limits`` of the
        range. Raises TranslationError if its step is not a known whole number other than 0."""
        limits = [self.converted(limit, INT) for limit in limits]
        first, last, step = {
            1: lambda: (_ZERO_I, limits[0], 1),
            2: lambda: (limits[0], limits[1], 1),
            3: lambda: (limits[0], limits[1], limits[2].constant),
        }[len(limits)]()
        if not isinstance(step, int) or step == 0:
            raise self._fail(line, "the step of a range must be a known whole number, not 0")
        test, body, following, after = (self.label() for _ in range(4))
        before = self.block
        index, rest = Number(INT, f"%v{next(self.names)}"), Number(INT, f"%v{next(self.names)}")
        self.jump(test)
        self.begin(test)
        self.run(
            f"{index.text} = phi i64 [ {first.text}, %{before} ], [ {rest.text}, %{following} ]"
        )
        relation = "slt" if step > 0 else "sgt"
        goes_on = self.emit(BOOL, f"icmp {relation} i64 {index.text}, {last.text}")
        self.branch(goes_on, body, after)
        self.begin(body)
        self._assign(line.target, index)
        self._round(line, following, after)
        self.begin(following)
        self.run(f"{rest.text} = add nsw i64 {index.text}, {step}")
        whole = self.keeps_loops or ast.unparse(line.iter) == "range(LANES)"
        self.jump(test, f", !llvm.loop {self.module.rolled_loop()}" if whole else "")
        self.begin(after)

    def _continue_line(self, line: ast.Continue) -> None:
        self.jump(self.loops[-1][0])

    def _break_line(self, line: ast.Break) -> None:
        self.jump(self.loops[-1][1])

    # Expressions

    def value(self, node: ast.expr) -> Any:
        """Translate an expression: add the instructions that compute it, and return its value.
        Raises TranslationError if it is of a kind that cannot be translated."""
        method: Callable[[Any], Any] | None = getattr(self, f"_{type(node).__name__.lower()}", None)
        if method is None:
            raise self._fail(node, f"{type(node).__name__} cannot be translated")
        return method(node)

    def _name(self, node: ast.Name) -> Any:
        return self._read(node)

    def _constant(self, node: ast.Constant) -> Any:
        if not isinstance(node.value, bool | int | float):
            raise self._fail(node, f"constant {node.value!r}: must be a number or a truth value")
        return constant(node.value)

    def _tuple(self, node: ast.Tuple) -> tuple[Any, ...]:
        items: list[Any] = []
        for item in node.elts:
            if isinstance(item, ast.Starred):
                items += self.value(item.value)
            else:
                items.append(self.value(item))
        return tuple(items)

    def _attribute(self, node: ast.Attribute) -> Any:
        owner = self.value(node.value)
        if isinstance(owner, Named):
            return owner.values[owner.type._fields.index(node.attr)]
        if isinstance(owner, Array) and node.attr == "shape":
            return owner.shape
        if isinstance(owner, Record):
            offset = 8 * owner.fields.index(node.attr)
            pointer = self.emit(POINTER, f"getelementptr i8, ptr {owner.data.text}, i64 {offset}")
            return self.emit(INT, f"load i64, ptr {pointer.text}")
        if isinstance(owner, ModuleType):
            return self.lift(getattr(owner, node.attr))
        raise self._fail(node, f"no attribute {node.attr} can be translated for this value")

    def _subscript(self, node: ast.Subscript) -> Any:
        owner = self.value(node.value)
        if isinstance(owner, Named):
            owner = owner.values
        if isinstance(owner, tuple):
            index = self.value(node.slice)
            if index.constant is not None:
                return owner[index.constant]
            return self._dynamic(owner, index)
        element, pointer = self._element(node, owner)
        return self.emit(element, f"load {element}, ptr {pointer.text}")

    def _dynamic(self, items: tuple[Any, ...], index: Number) -> Number:
        """Return the item of a tuple of numbers at an index that only running code knows: the
        tuple is put into memory. All items become numbers of one type; the index is not
        checked."""
        items = tuple(self._alike(*items))
        kind = items[0].kind
        if all(item.constant is not None for item in items):
            values = np.array([item.constant for item in items])
            base = self.module.constant_array(values).data
        else:
            base = self.allocate(kind, len(items))
            for k, item in enumerate(items):
                text = f"getelementptr {kind}, ptr {base.text}, i64 {k}"
                self._store(item, kind, self.emit(POINTER, text))
        text = f"getelementptr {kind}, ptr {base.text}, i64 {index.text}"
        return self.emit(kind, f"load {kind}, ptr {self.emit(POINTER, text).text}")

    def _element(self, node: ast.Subscript, owner: Any = None) -> tuple[str, Number]:
        """Translate the element that a subscript addresses, in the array ``owner`` (by default the
        value of the subscripted expression). Returns the element type and a pointer to it. Raises
        TranslationError for a value that is no array, and for indices that are not whole numbers,
        too few or too many, or known to be negative."""
        array = self.value(node.value) if owner is None else owner
        if not isinstance(array, Array):
            raise self._fail(node, "the subscripted value is no array and no tuple")
        keys = self.value(node.slice)
        keys = keys if isinstance(keys, tuple) else (keys,)
        if len(keys) != max(1, len(array.shape)) or any(key.kind != INT for key in keys):
            raise self._fail(node, "the indices of an array must be a whole number for each axis")
        if any(key.constant is not None and key.constant < 0 for key in keys):
            raise self._fail(
                node, "an index of an array counts from its first element, so it must not be < 0"
            )
        place = keys[0]
        for key, size in zip(keys[1:], array.shape[1:], strict=True):
            place = operations.add_int(self, operations.multiply_int(self, place, size), key)
        text = f"getelementptr inbounds {array.element}, ptr {array.data.text}, i64 {place.text}"
        return array.element, self.emit(POINTER, text)

    def _unaryop(self, node: ast.UnaryOp) -> Any:
        value = self.value(node.operand)
        if isinstance(node.op, ast.Not):
            return operations.negation(self, operations.truth(self, value))
        if isinstance(node.op, ast.USub):
            return operations.minus(self, value)
        raise self._fail(node, "of the unary operators only `-` and `not` can be translated")

    def _binop(self, node: ast.BinOp) -> Any:
        return self.operate(node.op, self.value(node.left), self.value(node.right))

    def operate(self, op: ast.operator, left: Any, right: Any) -> Any:
        """Translate an arithmetic operation on two numbers, given by its node of the syntax tree,
        or the concatenation (``op`` is ``ast.Add()``) of two tuples; return the result."""
        if isinstance(left, tuple) and isinstance(op, ast.Add):
            return left + right
        return operations.arithmetic(self, op, left, right)

    def _compare(self, node: ast.Compare) -> Number:
        left = self.value(node.left)

        def tests() -> Iterator[Callable[[], Number]]:
            current = left
            for op, right in zip(node.ops, node.comparators, strict=True):

                def test(op: ast.cmpop = op, right: ast.expr = right) -> Number:
                    nonlocal current
                    other = self.value(right)
                    before, current = current, other
                    if isinstance(op, ast.In):
                        return operations.is_in(self, before, other)
                    return operations.comparison(self, op, before, other)

                yield test

        simple = all(map(self._is_simple, node.comparators[1:]))
        return self._connected(tests(), True, simple)

    def _boolop(self, node: ast.BoolOp) -> Number:
        def test(item: ast.expr) -> Number:
            value: Number = self.value(item)
            if value.kind != BOOL:
                raise self._fail(item, "`and` and `or` are for truth values")
            return value

        tests = [partial(test, item) for item in node.values]
        simple = all(map(self._is_simple, node.values[1:]))
        return self._connected(tests, isinstance(node.op, ast.And), simple)

    def _connected(
        self, tests: Iterable[Callable[[], Number]], wanted: bool, simple: bool
    ) -> Number:
        """Translate `and` (``wanted`` True) or `or` (False) of tests; return the truth value.

        Each test is a function that translates it when called. The running code evaluates a test
        only if those before it leave the result open; but all tests if ``simple`` is true.
        """
        first, *rest = tests
        value = first()
        if simple:
            for test in rest:
                value = operations.connected(self, value, test(), wanted)
            return value
        end, ways = self.label(), []
        for test in rest:
            if value.constant is not None:
                if value.constant != wanted:
                    break
                value = test()
                continue
            ways.append((constant(not wanted), self.block))
            following = self.label()
            yes, no = (following, end) if wanted else (end, following)
            self.branch(value, yes, no)
            self.begin(following)
            value = test()
        if not ways:
            return value
        ways.append((value, self.block))
        self.jump(end)
        self.begin(end)
        return self.phi(ways)

    def _ifexp(self, node: ast.IfExp) -> Any:
        test = operations.truth(self, self.value(node.test))
        if test.constant is not None:
            return self.value(node.body if test.constant else node.orelse)
        if self._is_simple(node.body) and self._is_simple(node.orelse):
            yes, no = self._alike(self.value(node.body), self.value(node.orelse))
            chosen = [
                operations.select(self, test, a, b)
                for a, b in zip(leaves(yes), leaves(no), strict=True)
            ]
            return rebuilt(yes, iter(chosen))
        yes, no, end = self.label(), self.label(), self.label()
        self.branch(test, yes, no)
        values, blocks = [], []
        for label, expression in ((yes, node.body), (no, node.orelse)):
            self.begin(label)
            values.append(self.value(expression))
            blocks.append(self.block)
            self.jump(end)
        self.begin(end)
        before = len(self.lines)
        pairs = zip(*(leaves(value) for value in self._alike(*values)), strict=True)
        if len(self.lines) > before:
            raise self._fail(node, "both values of `a if test else b` must have the same type")
        numbers = [self.phi(list(zip(pair, blocks, strict=True))) for pair in pairs]
        return rebuilt(values[0], iter(numbers))

    def _alike(self, *values: Any) -> list[Any]:
        """Convert values so that numbers at the same position in them have the same type; raises
        TypeError if the values differ in structure."""
        require_alike(*values)
        rows = []
        for numbers in zip(*(leaves(value) for value in values), strict=True):
            kind = common_kind(*numbers)
            rows.append([self.converted(number, kind) for number in numbers])
        columns = zip(*rows, strict=True) if rows else [()] * len(values)
        return [rebuilt(value, iter(column)) for value, column in zip(values, columns, strict=True)]

    def _is_simple(self, node: ast.expr) -> bool:
        """Return True if an expression consists of cheap nodes only (`_is_cheap`). It may then be
        evaluated even if its value turns out not to be needed, which saves a branch."""
        return all(self._is_cheap(part) for part in ast.walk(node))

    def _is_cheap(self, part: ast.AST) -> bool:
        """Return True if a node of an expression, its operands apart, costs next to nothing and
        reads no array: a name, constant, unary operation, comparison, `and`, `or`, tuple, item of a
        tuple at a constant index, or attribute of a Python module."""
        owner = getattr(part, "value", None)
        if isinstance(part, ast.Attribute) and isinstance(owner, ast.Name):
            return isinstance(self.source.names.get(owner.id), ModuleType)
        if isinstance(part, ast.Subscript) and isinstance(owner, ast.Name):
            is_tuple = isinstance(self.values.get(owner.id), tuple)
            return is_tuple and isinstance(part.slice, ast.Constant)
        return isinstance(part, _CHEAP)

    def _call(self, node: ast.Call) -> Any:
        function = self.value(node.func)
        if node.keywords:
            raise self._fail(node, "arguments have no names here: give them by position")
        arguments = self._tuple(ast.Tuple(node.args, ast.Load()))
        known = operations.CALLS.get(function)
        if known is not None:
            return known(self, *arguments)
        if isinstance(function, type) and hasattr(function, "_fields"):
            return Named(function, arguments)
        if isinstance(function, Source | FunctionType):
            source = function if isinstance(function, Source) else source_of(function)
            return self.module.call(self, source, arguments)
        if isinstance(function, callee):
            return function.call(self, *arguments)
        raise self._fail(node, f"no such function: {ast.unparse(node.func)}")


def result_type(kinds: list[str]) -> str:
    """Return the LLVM type of a function's result, given the types of its leaves: void, the type of
    a single leaf, or a struct type."""
    if not kinds:
        return "void"
    return kinds[0] if len(kinds) == 1 else "{ " + ", ".join(kinds) + " }"
