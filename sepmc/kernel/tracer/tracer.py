"""Records formulas that are called on values of a kernel being written, and writes them down as
lines for one lane.

The wiring of a kernel is ordinary Python: ``flow = vec3.unrotate(attitude, vec3.add(velocity,
stream))`` on expressions records two calls. The same call is recorded once, a value that nothing
asks for is not written, and a value that depends on the parameters of a case alone is computed
before the flight and kept in a field.
"""

import math
import re
from collections.abc import Callable, Iterator, Sequence
from typing import Any

from sepmc.kernel.tracer.text import Text, Workspace

# Parts of a value: one number, a condition, so many numbers, a symmetric matrix (nine numbers kept
# as six), or a tuple of values.
Shape = int | str | tuple[Any, ...]
NUMBER, CONDITION, SYMMETRIC = 1, "condition", "symmetric"

# suffix of get and put, numbers
_KEPT: dict[Shape, tuple[str, int]] = {3: ("3", 3), 4: ("4", 4), SYMMETRIC: ("6", 6), 9: ("9", 9)}
_PRECEDENCE = {
    "where": 0,
    "or": 1,
    "and": 2,
    "==": 3,
    "<": 3,
    "<=": 3,
    ">": 3,
    ">=": 3,
    "+": 4,
    "-": 4,
    "*": 5,
    "/": 5,
    "neg": 6,
}
_ATOM = 9
# names that functions have already, and functions
_TAKEN = {"w", "math", "np", "phase", "usual", "left", "size"}
_TAKEN |= {"e", "i", "k", "l"}  # count loops that are written by hand
_TAKEN |= {
    "add",
    "advance",
    "compute_outcomes",
    "finish_step",
    "interpolate",
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
    """A number, a condition or a tuple of them in the kernel that is being written."""

    def __init__(self, scope: "Scope", node: int, shape: Shape):
        self.scope, self.node, self.shape = scope, node, shape

    def called(self, name: str) -> "Expr":
        """This value, written on a line of its own under that name, or that and a number."""
        self.scope.names.setdefault(self.node, name)
        return self

    def __len__(self) -> int:
        if isinstance(self.shape, tuple):
            return len(self.shape)
        if self.shape in (NUMBER, CONDITION):
            raise TypeError("a number has no parts")
        return 9 if self.shape == SYMMETRIC else int(self.shape)

    def __getitem__(self, i: int) -> "Expr":
        shape = self.shape[i] if isinstance(self.shape, tuple) else NUMBER
        return trace("item", (self, i), shape)

    def __iter__(self) -> Iterator["Expr"]:
        return (self[i] for i in range(len(self)))

    def __bool__(self) -> bool:
        raise TypeError("a condition of the kernel is not known while it is written: use where")

    def __add__(self, other: Any) -> "Expr":
        return self if _is(other, 0.0) else trace("+", (self, other), NUMBER)

    def __radd__(self, other: Any) -> "Expr":
        return self if _is(other, 0.0) else trace("+", (other, self), NUMBER)

    def __sub__(self, other: Any) -> "Expr":
        return self if _is(other, 0.0) else trace("-", (self, other), NUMBER)

    def __rsub__(self, other: Any) -> "Expr":
        return -self if _is(other, 0.0) else trace("-", (other, self), NUMBER)

    def __mul__(self, other: Any) -> Any:
        found = _times(self, other)
        return trace("*", (self, other), NUMBER) if found is None else found

    def __rmul__(self, other: Any) -> Any:
        found = _times(self, other)
        return trace("*", (other, self), NUMBER) if found is None else found

    def __truediv__(self, other: Any) -> "Expr":
        return trace("/", (self, other), NUMBER)

    def __rtruediv__(self, other: Any) -> "Expr":
        return trace("/", (other, self), NUMBER)

    def __neg__(self) -> "Expr":
        return trace("neg", (self,), NUMBER)

    def equals(self, other: Any) -> "Expr":
        """The condition that this number is another."""
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
    """Whether something is a number known now, and that one."""
    return not isinstance(a, Expr) and a == number


def _times(value: Expr, factor: Any) -> Any:
    """A product with 0, 1 or -1."""
    if _is(factor, 0.0):
        return 0.0
    return value if _is(factor, 1.0) else -value if _is(factor, -1.0) else None


def called(value: Any, name: str) -> Any:
    """`Expr.called` of what may be a number known now."""
    return value.called(name) if isinstance(value, Expr) else value


def where(condition: Expr, one: Any, other: Any) -> Expr:
    """``one`` where a condition holds, elsewhere ``other``; both are computed."""
    shape = next((v.shape for v in (one, other) if isinstance(v, Expr)), NUMBER)
    return trace("where", (condition, one, other), shape)


def total(values: Sequence[Any]) -> Any:
    """Sum of numbers, at least one."""
    found = values[0]
    for value in values[1:]:
        found = found + value
    return found


def product(a: Any, b: Any) -> Any:
    """Scalar product of two vectors, some of whose parts may be numbers known now: what is
    multiplied by zero is not written."""
    terms = [x * y for x, y in zip(a, b, strict=True) if not (_is(x, 0.0) or _is(y, 0.0))]
    return total(terms) if terms else 0.0


def trace(op: str, args: tuple[Any, ...], shape: Shape) -> Expr:
    """A call of an operator or formula, in the scope of what it depends on most: a phase's
    function, or else the case alone."""
    found = [value.scope for value in _expressions(args)]
    scope = next((scope for scope in found if scope.case is not None), found[0])
    return scope.add(op, args, shape)


def _expressions(args: Any) -> Iterator[Expr]:
    for a in args:
        if isinstance(a, Expr):
            yield a
        elif isinstance(a, tuple):
            yield from _expressions(a)


_WORD = re.compile(r"[A-Za-z_]\w*")


class Scope:
    """Lines of one loop over lanes. ``case`` is the scope of what depends on the parameters of a
    case alone; it has none itself."""

    def __init__(self, workspace: Workspace, case: "Scope | None" = None):
        self.workspace, self.case = workspace, case
        self.nodes: list[tuple[str, tuple[Any, ...], Shape]] = []
        self.names: dict[int, str] = {}
        self._known: dict[Any, int] = {}
        # what places hold, and after how many nodes that was stored
        self.stores: dict[str, tuple[int, Expr]] = {}
        # of the case: workspace that its values are kept in, for other scopes
        self._kept: dict[int, str] = {}
        self.comments: list[tuple[int, str]] = []  # and after how many nodes each stands

    # -- recording

    def add(self, op: str, args: tuple[Any, ...], shape: Shape) -> Expr:
        """Record a call, or find it."""
        args = self._adopted(args)
        key = (op, shape, _key(args))
        if key not in self._known:
            self._known[key] = len(self.nodes)
            self.nodes.append((op, args, shape))
        return Expr(self, self._known[key], shape)

    def load(self, place: str, shape: Shape = NUMBER) -> Expr:
        """What stands at a place of the workspace, such as ``S + X_body1``; or what was stored
        there before."""
        return self.stores[place][1] if place in self.stores else self.add("load", (place,), shape)

    def parameter(self, place: int) -> Expr:
        """A parameter of a case by its place in the vector of parameters."""
        return self.add("parameter", (place,), NUMBER)

    def shared(self, place: int, shape: Shape = NUMBER) -> Expr:
        """What all cases share, by its place."""
        return self.add("shared", (place,), shape)

    def named(self, name: str) -> Expr:
        """A constant of the module, or an argument of the function."""
        return self.add("named", (name,), NUMBER)

    def store(self, place: str, value: Any) -> None:
        """Put a value at a place; only what stands there at the end is written."""
        if not isinstance(value, Expr):
            value = self.add(
                "tuple" if isinstance(value, tuple) else "constant",
                (value,),
                len(value) if isinstance(value, tuple) else 1,
            )
        value = self._adopt(value)
        self.stores[place] = len(self.nodes), value

    def comment(self, text: str) -> None:
        """A comment above what is recorded next."""
        self.comments.append((len(self.nodes), text))

    def here(self, value: Any) -> Any:
        """A value as this scope sees it, so that its parts are read where the whole is kept."""
        return self._adopt(value) if isinstance(value, Expr) else value

    def _adopted(self, args: tuple[Any, ...]) -> tuple[Any, ...]:
        return tuple(
            self._adopt(a)
            if isinstance(a, Expr)
            else self._adopted(a)
            if isinstance(a, tuple)
            else a
            for a in args
        )

    def _adopt(self, value: Expr) -> Expr:
        """A value as this scope sees it: one of the case is kept in a field; numbers of the file
        are read where they stand."""
        if value.scope is self:
            return value
        assert value.scope is self.case, "a value of another function"
        op, args, shape = value.scope.nodes[value.node]
        if op in ("parameter", "shared"):
            return self.add(op, args, shape)
        return self.add("load", (value.scope.keep(value),), shape)

    def keep(self, value: Expr) -> str:
        """The field in which a value of the case is kept for the flight."""
        if value.node not in self._kept:
            name = self.names.get(value.node, self.nodes[value.node][0].rpartition(".")[2])
            name = (name if name.isidentifier() else "value").upper()
            number = 1
            while not self.workspace.add(f"{name}_{number}", _size(value.shape)):
                number += 1
            place = self._kept[value.node] = f"{name}_{number}"
            self.stores[place] = value.node + 1, value  # as soon as it is known
        return self._kept[value.node]

    # -- writing

    def lines(self) -> list[str]:
        """All that leads to what is stored, for one lane."""
        return [line for _, _, line in _Writer(self, {}).lines()]

    def write(self, text: Text, most: float = math.inf) -> None:
        """Write a loop over lanes, and before it what is the same for all lanes: a loop that reads
        it is not vectorised. Of the case, loops of at most so many lines: the time to compile one
        grows with the square of its reads and writes. Values that a later loop needs are kept in
        workspace."""
        writer = _Writer(self, text.names)
        lines = writer.lines()
        text(*writer.shared)
        groups: list[list[tuple[int, str]]] = [[]]
        for node, _, line in lines:
            if len(groups[-1]) >= most and groups[-1][-1][0] < node:
                groups.append([])
            groups[-1].append((node, line))
        known: dict[str, int] = {}  # names of the loops before, and their nodes
        again: list[dict[str, int]] = []
        for group in groups:
            words = set(_WORD.findall(" ".join(line for _, line in group))) if known else set()
            again.append({name: node for name, node in known.items() if name in words})
            last = max((node for node, _ in group), default=-1)
            known |= {name: node for node, name in writer.named.items() if node <= last}
        crossing = {node: name for needed in again for name, node in needed.items()}
        read = {node for node in crossing if self.nodes[node][0] == "parameter"}
        fresh = crossing.keys() - self._kept.keys() - read
        values = {node: Expr(self, node, self.nodes[node][2]) for node in crossing}
        places = {node: self.keep(values[node]) for node in sorted(crossing.keys() - read)}
        for group, needed in zip(groups, again, strict=True):
            loop = []
            for name, node in needed.items():
                op, args, shape = self.nodes[node]
                code = _READINGS[op](args[0], shape) if node in read else _load(places[node], shape)
                loop.append(f"{name} = {code[0]}")
            for node, line in group:
                loop.append(line)
                if node in fresh and line.startswith(f"{crossing[node]} = "):
                    loop += writer.store(places[node], values[node])
            inner = text.lanes()
            for line in loop:
                inner.broken(line)


class _Writer:
    """The names and lines of a scope."""

    def __init__(self, scope: Scope, of_function: dict[str, Any]):
        self.scope, self.of_function = scope, of_function
        self.uses: dict[int, int] = {}
        # values that a choice is between: computed before it, so that lanes need not part
        self.alone: set[int] = set()
        for _, value in scope.stores.values():
            self._visit((value,))
        self.spelled: dict[int, tuple[str, int]] = {}
        self.named: dict[int, str] = {}  # values that have a line of their own
        self.shared: list[str] = []
        self.taken = {
            op.partition(".")[0] for op, _, _ in scope.nodes if op not in _READINGS
        } | _TAKEN

    def _visit(self, args: tuple[Any, ...]) -> None:
        left = list(args)
        while left:
            a = left.pop()
            if isinstance(a, tuple):
                left += a
            elif isinstance(a, Expr):
                self.uses[a.node] = self.uses.get(a.node, 0) + 1
                if self.uses[a.node] == 1:
                    op, parts, _ = self.scope.nodes[a.node]
                    left += parts
                    if op == "where":
                        self.alone |= {item.node for item in parts[1:] if isinstance(item, Expr)}

    def lines(self) -> list[tuple[int, int, str]]:
        """The lines of a lane, each with the number of its value and its order there; what stands
        before its loop is then in ``shared``."""
        written: list[tuple[int, int, str]] = []  # node, order at the same node, line
        for node in sorted(self.uses):
            line = self._line(node)
            if line is not None:
                written.append((node, 1, line))
        for place, (after, value) in self.scope.stores.items():
            written += [(after - 1, 2, line) for line in self.store(place, value)]
        last = max((node for node, _, _ in written), default=-1)
        written += [(node, 0, f"# {says}") for node, says in self.scope.comments if node <= last]
        return sorted(written, key=lambda item: item[:2])

    def _line(self, node: int) -> str | None:
        """The line that gives a value its name; None if it is spelled where it is used."""
        op, args, shape = self.scope.nodes[node]
        code, precedence = self._code(op, args, shape)
        if op == "shared":
            name = self._name(f"shared_{args[0]}", shape)
            self.shared.append(f"{name} = {code}")
            self.spelled[node] = name, _ATOM
            return None
        # what a place holds may change before it is used
        reads = op == "load" and args[0] not in self.scope.stores
        plain = op in ("item", "constant", "tuple") or (op in _READINGS and (op != "load" or reads))
        once = (
            self.uses[node] == 1
            and not (op == "load" and not reads)
            and (node not in self.alone or plain)
        )
        if (once and node not in self.scope.names) or op in ("item", "constant", "named"):
            self.spelled[node] = code, precedence
            return None
        name = self._name(self.scope.names.get(node) or _word(op, args), shape)
        self.spelled[node], self.named[node] = (name, _ATOM), name
        return f"{name} = {code}"

    def _name(self, base: str, shape: Shape) -> str:
        """A name that stands for nothing else here, and in its function for nothing of another
        shape: a variable of compiled code has one type."""
        name, number = base, 1
        while name in self.taken or self.of_function.get(name, shape) != shape:
            number += 1
            name = f"{base}_{number}"
        self.taken.add(name)
        self.of_function[name] = shape
        return name

    def _code(self, op: str, args: tuple[Any, ...], shape: Shape) -> tuple[str, int]:
        """How a call is written, and how tightly that binds."""
        rank = _PRECEDENCE.get(op, _ATOM)
        if op in _READINGS:
            return _READINGS[op](args[0], shape)
        if op in ("constant", "tuple"):
            code = self._spell(args[0])
        elif op == "item":
            code = f"{self._spell(args[0], _ATOM)}[{args[1]}]"
        elif op == "neg":
            code = f"-{self._spell(args[0], rank)}"
        elif op == "where":
            condition, one, other = (self._spell(a, rank + 1) for a in args)
            code = f"{one} if {condition} else {other}"
        elif rank < _ATOM:
            code = f"{self._spell(args[0], rank)} {op} {self._spell(args[1], rank + 1)}"
        else:
            code = f"{op}({', '.join(self._spell(a) for a in args)})"
        return code, rank

    def _spell(self, a: Any, least: int = 0) -> str:
        """How a value, number or tuple is written, in parentheses if it binds more loosely than
        ``least``."""
        if isinstance(a, tuple):
            return f"({', '.join(self._spell(item) for item in a)}{',' if len(a) == 1 else ''})"
        if not isinstance(a, Expr):
            return _number(a)
        code, precedence = self.spelled[a.node]
        return code if precedence >= least else f"({code})"

    def store(self, place: str, value: Expr) -> list[str]:
        """The lines that put a value at a place, one behind the other the items of a tuple."""
        code = self._spell(value)
        if isinstance(value.shape, tuple):
            assert value.node in self.named, "a tuple without a name would be computed again"
            return [
                _store(to, f"{code}[{k}]", shape)
                for k, (to, shape) in enumerate(_items(place, value.shape))
            ]
        return [_store(place, code, value.shape)]


def _size(shape: Shape) -> int:
    """How many numbers a value has."""
    if isinstance(shape, tuple):
        return sum(_size(item) for item in shape)
    return _KEPT[shape][1] if shape in _KEPT else 1


def _items(place: str, shapes: tuple[Shape, ...]) -> Iterator[tuple[str, Shape]]:
    """Where the items of a tuple are kept, and their shapes."""
    behind = 0
    for shape in shapes:
        yield (f"{place} + {behind} * LANES" if behind else place), shape
        behind += _size(shape)


def _store(place: str, code: str, shape: Shape) -> str:
    if shape in _KEPT:
        return f"put{_KEPT[shape][0]}(w, {place} + l, {code})"
    return f"w[{place} + l] = {f'1.0 if {code} else 0.0' if shape == CONDITION else code}"


def _load(place: str, shape: Shape) -> tuple[str, int]:
    if isinstance(shape, tuple):
        return f"({', '.join(_load(at, item)[0] for at, item in _items(place, shape))})", _ATOM
    if shape in _KEPT:
        return f"get{_KEPT[shape][0]}(w, {place} + l)", _ATOM
    return (
        (f"w[{place} + l] > 0.0", _PRECEDENCE[">"])
        if shape == CONDITION
        else (f"w[{place} + l]", _ATOM)
    )


def _shared(place: int, shape: Shape) -> tuple[str, int]:
    return f"w[SHARED + {place}]" if shape == NUMBER else f"vec3.get(w, SHARED + {place})", _ATOM


_READINGS: dict[str, Callable[[Any, Shape], tuple[str, int]]] = {
    "load": _load,
    "parameter": lambda place, _: (f"w[P + {place} * LANES + l]", _ATOM),
    "shared": _shared,
    "named": lambda name, _: (name, _ATOM),
}


def _key(a: Any) -> Any:
    if isinstance(a, Expr):
        return ("value", a.node)
    if isinstance(a, tuple):
        return tuple(_key(item) for item in a)
    return (type(a).__name__, repr(a))


def _word(op: str, args: tuple[Any, ...]) -> str:
    """What a value is called if the wiring does not say."""
    if op in ("load", "parameter", "shared", "tuple"):
        word = str(args[0]).rpartition(" + ")[2].lower() if op == "load" else op
        return word if word.isidentifier() else "value"
    if op in _PRECEDENCE:
        return {
            "where": "chosen",
            "and": "holds",
            "or": "holds",
            "<": "holds",
            "<=": "holds",
            ">": "holds",
            ">=": "holds",
        }.get(op, "x")
    return op.rpartition(".")[2]


def _number(a: Any) -> str:
    if isinstance(a, float) and not math.isfinite(a):
        return "math.nan" if math.isnan(a) else "math.inf" if a > 0.0 else "-math.inf"
    return repr(a)


class Formulas:
    """Formulas of a module of the physics, which the wiring calls as it would call them: on
    expressions they are recorded."""

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
    "where",
]
