"""Tracer: formulas called on symbolic expressions are recorded as a graph, which is written as
lines of kernel code for one lane (one of the cases integrated side by side).

The emitter is ordinary Python: ``flow = vec3.unrotate(attitude, vec3.add(velocity, stream))`` on
expressions adds two nodes to the graph. Equal calls are one node, a node on which no stored value
depends is not written, and a value that depends on the parameters of a case alone is computed once,
before the case is integrated, and stored in a field of the workspace.
"""

import math
import re
from collections.abc import Callable, Iterator, Sequence
from typing import Any

from sepmc.kernel.tracer.storage import (
    ATOM,
    CONDITION,
    NUMBER,
    PRECEDENCE,
    READS,
    SYMMETRIC,
    Shape,
    items_of,
    number_code,
    read_of,
    size_of,
    store_line,
)
from sepmc.kernel.tracer.text import Text, Workspace

# names that no traced variable may have: variables written by hand, and names of functions
_TAKEN = {"w", "math", "np", "phase", "typical", "left", "size"}
_TAKEN |= {"e", "i", "k", "l"}  # counters of hand-written loops
_TAKEN |= {
    "add",
    "advance",
    "compute_outcomes",
    "finish_step",
    "make_extension",
    "monitor_loads",
    "note_indicators",
    "polish_event",
    "rates",
    "recentre_air",
    "set_event_flags",
    "write_history",
}


class Expr:
    """Symbolic value in the kernel that is being written: a number, a condition, a vector or a
    tuple, as its ``shape`` says. It is node number ``node`` in the graph of its ``scope``.

    Operators and indices on it add nodes and return new expressions. A condition has no truth
    value while the kernel is written: `where` selects by it.
    """

    def __init__(self, scope: "Scope", node: int, shape: Shape):
        self.scope, self.node, self.shape = scope, node, shape

    def called(self, name: str) -> "Expr":
        """Give the expression a line of its own in the kernel, which assigns it to a variable
        called ``name`` (with a number if that is taken); return the expression. A name given before
        stays. A component of a tuple, a constant and a number that the kernel's text names or that
        all cases share keep their own spelling."""
        self.scope.names.setdefault(self.node, name)
        return self

    def __len__(self) -> int:
        if isinstance(self.shape, tuple):
            return len(self.shape)
        if self.shape in (NUMBER, CONDITION):
            raise TypeError("a symbolic number or condition has no components and no length")
        return 9 if self.shape == SYMMETRIC else int(self.shape)

    def __getitem__(self, i: int) -> "Expr":
        shape = self.shape[i] if isinstance(self.shape, tuple) else NUMBER
        return trace("item", (self, i), shape)

    def __iter__(self) -> Iterator["Expr"]:
        return (self[i] for i in range(len(self)))

    def __bool__(self) -> bool:
        raise TypeError("a condition is not known while the kernel is traced: use where")

    def __add__(self, other: Any) -> "Expr":
        return self if _is(other, 0.0) else trace("+", (self, other), NUMBER)

    def __radd__(self, other: Any) -> "Expr":
        return self if _is(other, 0.0) else trace("+", (other, self), NUMBER)

    def __sub__(self, other: Any) -> "Expr":
        return self if _is(other, 0.0) else trace("-", (self, other), NUMBER)

    def __rsub__(self, other: Any) -> "Expr":
        return -self if _is(other, 0.0) else trace("-", (other, self), NUMBER)

    def __mul__(self, other: Any) -> Any:
        result = _times(self, other)
        return trace("*", (self, other), NUMBER) if result is None else result

    def __rmul__(self, other: Any) -> Any:
        result = _times(self, other)
        return trace("*", (other, self), NUMBER) if result is None else result

    def __truediv__(self, other: Any) -> "Expr":
        return trace("/", (self, other), NUMBER)

    def __rtruediv__(self, other: Any) -> "Expr":
        return trace("/", (other, self), NUMBER)

    def __neg__(self) -> "Expr":
        return trace("neg", (self,), NUMBER)

    def equals(self, other: Any) -> "Expr":
        """Condition that the number equals ``other`` (== compares expressions as objects)."""
        return trace("==", (self, other), CONDITION)

    def __lt__(self, other: Any) -> "Expr":
        return trace("<", (self, other), CONDITION)

    def __le__(self, other: Any) -> "Expr":
        return trace("<=", (self, other), CONDITION)

    def __gt__(self, other: Any) -> "Expr":
        return trace(">", (self, other), CONDITION)

    def __ge__(self, other: Any) -> "Expr":
        return trace(">=", (self, other), CONDITION)

    def __and__(self, other: "Expr") -> "Expr":
        return trace("and", (self, other), CONDITION)

    def __or__(self, other: "Expr") -> "Expr":
        return trace("or", (self, other), CONDITION)


def _is(a: Any, number: float) -> bool:
    """True if a value is a number of Python, not an expression, and equal to ``number``."""
    return not isinstance(a, Expr) and a == number


def _times(value: Expr, factor: Any) -> Any:
    """Product of an expression and a factor that is known to be 0 (0.0), 1 (the expression) or -1
    (its negative); None for any other factor."""
    if _is(factor, 0.0):
        return 0.0
    return value if _is(factor, 1.0) else -value if _is(factor, -1.0) else None


def called(value: Any, name: str) -> Any:
    """Name an expression (`Expr.called`) and return it; return a known number as it is."""
    return value.called(name) if isinstance(value, Expr) else value


def where(condition: Expr, one: Any, other: Any) -> Expr:
    """Expression that equals ``one`` where a condition is satisfied, else ``other``; the kernel
    computes both."""
    shape = next((v.shape for v in (one, other) if isinstance(v, Expr)), NUMBER)
    return trace("where", (condition, one, other), shape)


def undefined_with(value: Any, other: Any) -> Any:
    """Number that equals ``value``, but is NaN where the number ``other`` is NaN or infinite."""
    if not isinstance(other, Expr):
        return value if math.isfinite(other) else math.nan
    return trace("+", (value, trace("*", (0.0, other), NUMBER)), NUMBER)


def total(values: Sequence[Any]) -> Any:
    """Sum of numbers or expressions (at least one), from left to right."""
    result = values[0]
    for value in values[1:]:
        result = result + value
    return result


def product(a: Any, b: Any) -> Any:
    """Scalar product of two vectors, without the terms in which a component is known to be zero;
    0.0 if no term is left."""
    terms = [x * y for x, y in zip(a, b, strict=True) if not (_is(x, 0.0) or _is(y, 0.0))]
    return total(terms) if terms else 0.0


def trace(op: str, args: tuple[Any, ...], shape: Shape) -> Expr:
    """Record a call of an operator or formula as a node of a scope.

    Parameters
    ----------
    op : str
        operator, or name of the function in the kernel
    args : tuple
        expressions (at least one), known numbers and tuples of these
    shape : Shape
        shape of the result

    Returns
    -------
    Expr
        the result: in the scope of the kernel function that is being written if any argument
        belongs to that, else (all arguments depend on parameters of the case alone) in the scope of
        the case
    """
    scopes = [value.scope for value in _expressions(args)]
    scope = next((scope for scope in scopes if scope.case is not None), scopes[0])
    return scope.add(op, args, shape)


def _expressions(args: Any) -> Iterator[Expr]:
    """Yield the expressions among the arguments of a call, nested tuples included."""
    for a in args:
        if isinstance(a, Expr):
            yield a
        elif isinstance(a, tuple):
            yield from _expressions(a)


_WORD = re.compile(r"[A-Za-z_]\w*")


class Scope:
    """Graph of the expressions of one loop over lanes, with what is stored in the workspace.

    ``case`` is the scope of values that depend on the parameters of a case alone, which may be used
    here; it is None for that scope itself.
    """

    def __init__(self, workspace: Workspace, case: "Scope | None" = None):
        self.workspace, self.case = workspace, case
        self.nodes: list[tuple[str, tuple[Any, ...], Shape]] = []
        self.names: dict[int, str] = {}
        self._known: dict[Any, int] = {}
        # by workspace path: number of nodes that existed before the store, and the stored value
        self.stores: dict[str, tuple[int, Expr]] = {}
        # of the scope of the case, by node: workspace field that stores the value for other scopes
        self._fields: dict[int, str] = {}
        self.comments: list[tuple[int, str]] = []  # number of nodes before each, and its text

    # -- tracing

    def add(self, op: str, args: tuple[Any, ...], shape: Shape) -> Expr:
        """Return the expression, in this scope, of a call of an operator or formula (arguments as
        in `trace`); an equal call before it has the same node."""
        args = self._adopted(args)
        key = (op, shape, _key(args))
        if key not in self._known:
            self._known[key] = len(self.nodes)
            self.nodes.append((op, args, shape))
        return Expr(self, self._known[key], shape)

    def load(self, path: str, shape: Shape = NUMBER) -> Expr:
        """Expression of the value at a workspace path such as ``S + X_body1`` (a field, or field
        plus offset); if this scope has stored a value there, that value."""
        return self.stores[path][1] if path in self.stores else self.add("load", (path,), shape)

    def parameter(self, index: int) -> Expr:
        """Expression of a parameter of the case, SI, by its index in the parameter vector."""
        return self.add("parameter", (index,), NUMBER)

    def shared(self, index: int, shape: Shape = NUMBER) -> Expr:
        """Expression of one of the numbers that all cases share, by its index among them; with the
        shape 3, of the vector that begins there."""
        return self.add("shared", (index,), shape)

    def named(self, name: str) -> Expr:
        """Expression of a number that the kernel's text names: a constant of the kernel's module,
        or an argument of the kernel function. The name is not checked."""
        return self.add("named", (name,), NUMBER)

    def store(self, path: str, value: Any) -> None:
        """Store a value (expression, known number or tuple) at a workspace path; of several values
        stored there, the loop writes only the last. A later `load` of the same path returns that
        value, not what the workspace had before the loop."""
        if not isinstance(value, Expr):
            value = self.add(
                "tuple" if isinstance(value, tuple) else "constant",
                (value,),
                len(value) if isinstance(value, tuple) else 1,
            )
        value = self._adopt(value)
        self.stores[path] = len(self.nodes), value

    def comment(self, text: str) -> None:
        """Add a comment line above the line of the node that is added next."""
        self.comments.append((len(self.nodes), text))

    def localize(self, value: Any) -> Any:
        """Return a value as an expression of this scope: a value of the scope of the case is loaded
        from the workspace field that stores it. What is no expression, such as a plain number or a
        tuple, is returned unchanged."""
        return self._adopt(value) if isinstance(value, Expr) else value

    def _adopted(self, args: tuple[Any, ...]) -> tuple[Any, ...]:
        """Arguments of a call, nested tuples included, with each expression replaced by that of
        this scope (`_adopt`)."""
        return tuple(
            self._adopt(a)
            if isinstance(a, Expr)
            else self._adopted(a)
            if isinstance(a, tuple)
            else a
            for a in args
        )

    def _adopt(self, value: Expr) -> Expr:
        """Expression of this scope for ``value``, an expression of this scope (returned as it is)
        or of the scope of the case: that is loaded from its workspace field, but a parameter or
        shared number is read again."""
        if value.scope is self:
            return value
        assert value.scope is self.case, "expression of a function used in another function"
        op, args, shape = value.scope.nodes[value.node]
        if op in ("parameter", "shared"):
            return self.add(op, args, shape)
        return self.add("load", (value.scope.field_of(value),), shape)

    def field_of(self, value: Expr) -> str:
        """Name of the workspace field in which a value of this scope (that of the case) is stored
        for other scopes; the field, and the store, are added when first needed."""
        if value.node not in self._fields:
            name = self.names.get(value.node, self.nodes[value.node][0].rpartition(".")[2])
            name = (name if name.isidentifier() else "value").upper()
            number = 1
            while not self.workspace.add(f"{name}_{number}", size_of(value.shape)):
                number += 1
            path = self._fields[value.node] = f"{name}_{number}"
            self.stores[path] = value.node + 1, value  # right after it is computed
        return self._fields[value.node]

    # -- writing

    def lines(self) -> list[str]:
        """Lines of kernel code that compute and store all stored values, for one lane."""
        return [line for _, _, line in _Writer(self, {}).lines()]

    def write(self, text: Text, most: float = math.inf) -> None:
        """Append the scope to a text as one or more loops over lanes.

        Numbers that all lanes share are read before the loops: a loop that reads them is not
        vectorised.

        Parameters
        ----------
        text : Text
        most : float
            number of lines after which a new loop begins; finite only for the scope of the case,
            since the time to compile a loop grows with the square of its reads and writes. Values
            that a later loop needs are stored in workspace fields.
        """
        writer = _Writer(self, text.names)
        lines = writer.lines()
        text(*writer.shared)
        groups: list[list[tuple[int, str]]] = [[]]
        for node, _, line in lines:
            if len(groups[-1]) >= most and groups[-1][-1][0] < node:
                groups.append([])
            groups[-1].append((node, line))
        previous: dict[str, int] = {}  # names of the previous loops, and their nodes
        reused: list[dict[str, int]] = []
        for group in groups:
            words = set(_WORD.findall(" ".join(line for _, line in group))) if previous else set()
            reused.append({name: node for name, node in previous.items() if name in words})
            last = max((node for node, _ in group), default=-1)
            previous |= {name: node for node, name in writer.named.items() if node <= last}
        crossing = {node: name for needed in reused for name, node in needed.items()}
        parameters = {node for node in crossing if self.nodes[node][0] == "parameter"}
        unstored = crossing.keys() - self._fields.keys() - parameters
        expressions = {node: Expr(self, node, self.nodes[node][2]) for node in crossing}
        paths = {
            node: self.field_of(expressions[node]) for node in sorted(crossing.keys() - parameters)
        }
        for group, needed in zip(groups, reused, strict=True):
            loop = []
            for name, node in needed.items():
                op, args, shape = self.nodes[node]
                code = (
                    READS[op](args[0], shape) if node in parameters else read_of(paths[node], shape)
                )
                loop.append(f"{name} = {code[0]}")
            for node, line in group:
                loop.append(line)
                if node in unstored and line.startswith(f"{crossing[node]} = "):
                    loop += writer.store(paths[node], expressions[node])
            inner = text.lanes()
            for line in loop:
                inner.broken(line)


class _Writer:
    """Writer of the code of one scope: it names variables and orders lines. ``of_function`` has, by
    name, the shapes of the variables that the kernel function already has; names of the scope are
    added to it."""

    def __init__(self, scope: Scope, of_function: dict[str, Any]):
        self.scope, self.of_function = scope, of_function
        self.uses: dict[int, int] = {}
        # operands of `where`: computed before it, so that lanes do not diverge
        self.operands: set[int] = set()
        for _, value in scope.stores.values():
            self._visit((value,))
        self.spelled: dict[int, tuple[str, int]] = {}
        self.named: dict[int, str] = {}  # values with a line of their own
        self.shared: list[str] = []
        self.taken = {op.partition(".")[0] for op, _, _ in scope.nodes if op not in READS} | _TAKEN

    def _visit(self, args: tuple[Any, ...]) -> None:
        """Count, in ``uses``, the uses of all nodes on which the given expressions depend, and note
        in ``operands`` the two values that a `where` selects from: they are computed before it."""
        pending = list(args)
        while pending:
            a = pending.pop()
            if isinstance(a, tuple):
                pending += a
            elif isinstance(a, Expr):
                self.uses[a.node] = self.uses.get(a.node, 0) + 1
                if self.uses[a.node] == 1:
                    op, operands, _ = self.scope.nodes[a.node]
                    pending += operands
                    if op == "where":
                        self.operands |= {
                            item.node for item in operands[1:] if isinstance(item, Expr)
                        }

    def lines(self) -> list[tuple[int, int, str]]:
        """Lines of the loop body as sorted tuples (node, order, line); at one node, order is 0 for
        a comment, 1 for an assignment, 2 for a store. ``shared`` then has the lines to write before
        the loop."""
        written: list[tuple[int, int, str]] = []  # node, order at the same node, line
        for node in sorted(self.uses):
            line = self._line(node)
            if line is not None:
                written.append((node, 1, line))
        for path, (position, value) in self.scope.stores.items():
            written += [(position - 1, 2, line) for line in self.store(path, value)]
        last = max((node for node, _, _ in written), default=-1)
        written += [
            (node, 0, f"# {comment}") for node, comment in self.scope.comments if node <= last
        ]
        return sorted(written, key=lambda item: item[:2])

    def _line(self, node: int) -> str | None:
        """Line that assigns the value of a node to a variable; None if the node has no line in the
        loop, because its code is inserted where it is used or stands before the loop. To be called
        once for each node, in order: the code that stands for the node in later lines is noted in
        ``spelled``, its variable in ``named``, a line before the loop in ``shared``."""
        op, args, shape = self.scope.nodes[node]
        code, precedence = self._code(op, args, shape)
        if op == "shared":
            name = self._name(f"shared_{args[0]}", shape)
            self.shared.append(f"{name} = {code}")
            self.spelled[node] = name, ATOM
            return None
        # the value at a path may change before it is used
        reads = op == "load" and args[0] not in self.scope.stores
        plain = op in ("item", "constant", "tuple") or (op in READS and (op != "load" or reads))
        inline = (
            self.uses[node] == 1
            and not (op == "load" and not reads)
            and (node not in self.operands or plain)
        )
        if (inline and node not in self.scope.names) or op in ("item", "constant", "named"):
            self.spelled[node] = code, precedence
            return None
        name = self._name(self.scope.names.get(node) or _word(op, args), shape)
        self.spelled[node], self.named[node] = (name, ATOM), name
        return f"{name} = {code}"

    def _name(self, base: str, shape: Shape) -> str:
        """Return a variable name, ``base`` or with a number after it, that is new in the scope and
        has no other shape in the function, since a compiled variable has one type; reserve it."""
        name, number = base, 1
        while name in self.taken or self.of_function.get(name, shape) != shape:
            number += 1
            name = f"{base}_{number}"
        self.taken.add(name)
        self.of_function[name] = shape
        return name

    def _code(self, op: str, args: tuple[Any, ...], shape: Shape) -> tuple[str, int]:
        """Code of a node, given its operator or formula, its arguments and its shape; and the
        precedence of that code (`PRECEDENCE` or ATOM)."""
        rank = PRECEDENCE.get(op, ATOM)
        if op in READS:
            return READS[op](args[0], shape)
        if op in ("constant", "tuple"):
            code = self._spell(args[0])
        elif op == "item":
            code = f"{self._spell(args[0], ATOM)}[{args[1]}]"
        elif op == "neg":
            code = f"-{self._spell(args[0], rank)}"
        elif op == "where":
            condition, one, other = (self._spell(a, rank + 1) for a in args)
            code = f"{one} if {condition} else {other}"
        elif rank < ATOM:
            code = f"{self._spell(args[0], rank)} {op} {self._spell(args[1], rank + 1)}"
        else:
            code = f"{op}({', '.join(self._spell(a) for a in args)})"
        return code, rank

    def _spell(self, a: Any, precedence_needed: int = 0) -> str:
        """Code of an argument (expression, known number or tuple), in parentheses if its precedence
        is below ``precedence_needed``."""
        if isinstance(a, tuple):
            return f"({', '.join(self._spell(item) for item in a)}{',' if len(a) == 1 else ''})"
        if not isinstance(a, Expr):
            return number_code(a)
        code, precedence = self.spelled[a.node]
        return code if precedence >= precedence_needed else f"({code})"

    def store(self, path: str, value: Expr) -> list[str]:
        """Lines that store a value at a workspace path; one line for each item of a tuple."""
        code = self._spell(value)
        if isinstance(value.shape, tuple):
            assert value.node in self.named, "stored tuple has no variable; name it with called()"
            return [
                store_line(to, f"{code}[{k}]", shape)
                for k, (to, shape) in enumerate(items_of(path, value.shape))
            ]
        return [store_line(path, code, value.shape)]


def _key(a: Any) -> Any:
    """Hashable key of the argument of a call: equal for arguments that are the same node, numbers
    (or texts) of one type that are written alike, or tuples of such. So 0.0 and -0.0 differ, and
    NaN equals NaN."""
    if isinstance(a, Expr):
        return ("value", a.node)
    if isinstance(a, tuple):
        return tuple(_key(item) for item in a)
    return (type(a).__name__, repr(a))


def _word(op: str, args: tuple[Any, ...]) -> str:
    """Variable name for a node that the emitter has not named, from its operator or formula and, of
    a value loaded from the workspace, from its field."""
    if op in ("load", "parameter", "shared", "tuple"):
        word = str(args[0]).rpartition(" + ")[2].lower() if op == "load" else op
        return word if word.isidentifier() else "value"
    if op in PRECEDENCE:
        return {
            "where": "selected",
            "and": "condition",
            "or": "condition",
            "<": "condition",
            "<=": "condition",
            ">": "condition",
            ">=": "condition",
        }.get(op, "x")
    return op.rpartition(".")[2]


class Formulas:
    """Formulas of one module as attributes, which are called on expressions: ``vec3.add(a, b)``
    records the call as a node and returns the expression of its result (`trace`). At least one
    argument must be an expression or have one in it; others may be known numbers.

    Parameters
    ----------
    prefix : str
        Name of the module in the kernel; "" for functions imported by name.
    shapes : dict of str to Shape
        Shape of the result of each formula, by name; other names are an AttributeError.
    """

    def __init__(self, prefix: str, shapes: dict[str, Shape]):
        self._prefix, self._shapes = prefix, shapes

    def __getattr__(self, name: str) -> Callable[..., Expr]:
        if name not in self._shapes:
            raise AttributeError(name)
        op = f"{self._prefix}.{name}" if self._prefix else name
        return lambda *args: trace(op, args, self._shapes[name])


__all__ = [
    "CONDITION",
    "NUMBER",
    "SYMMETRIC",
    "Expr",
    "Formulas",
    "Scope",
    "called",
    "product",
    "total",
    "trace",
    "undefined_with",
    "where",
]
