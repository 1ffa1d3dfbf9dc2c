"""Analysis of the local variables of a function: which of them must be stored in memory.

A variable needs no memory if every read gets the value of the last assignment before it in the
text. If branches or loops may make another assignment the latest one, it is stored in memory, and
LLVM turns it into registers.
"""

import ast
from collections import defaultdict
from dataclasses import dataclass, field

# (id of a list of statements, position in it) for each such list around a use, outermost first
_Path = tuple[tuple[int, int], ...]


@dataclass
class _Use:
    """An assignment or a read of a name.

    ``order`` counts the uses of a function in the order of its text, from 1; ``path`` has, for each
    list of statements around the use, outermost first, the id of the list and the position in it,
    and is empty for an argument; ``loops`` are the ids of the loops around it, outermost first;
    ``is_store`` is true for an assignment and for an argument.
    """

    order: int
    path: _Path
    loops: tuple[int, ...]
    is_store: bool


@dataclass
class _Uses:
    """Assignments and reads of all names of a function, by name, in the order of the text.

    The methods add those of a piece of its syntax tree; ``path`` and ``loops`` locate this piece,
    as in `_Use`. ``count`` is the number of uses so far.
    """

    by_name: dict[str, list[_Use]] = field(default_factory=lambda: defaultdict(list))
    count: int = 0

    def add(self, name: str, path: _Path, loops: tuple[int, ...], is_store: bool) -> None:
        """Add one assignment (``is_store``) or read of a name."""
        self.count += 1
        self.by_name[name].append(_Use(self.count, path, loops, is_store))

    def expression(self, node: ast.AST | None, path: _Path, loops: tuple[int, ...]) -> None:
        """Add the reads of names in an expression; None has none."""
        for part in ast.walk(node) if node is not None else ():
            if isinstance(part, ast.Name) and isinstance(part.ctx, ast.Load):
                self.add(part.id, path, loops, False)

    def target(self, node: ast.AST, path: _Path, loops: tuple[int, ...]) -> None:
        """Add the reads in the target of an assignment (as the index in ``a[i] = x``), then its
        assignments of names."""
        self.expression(node, path, loops)
        for part in ast.walk(node):
            if isinstance(part, ast.Name) and isinstance(part.ctx, ast.Store):
                self.add(part.id, path, loops, True)

    def body(self, lines: list[ast.stmt], path: _Path, loops: tuple[int, ...]) -> None:
        """Add the assignments and reads in a list of statements."""
        for position, line in enumerate(lines):
            self.statement(line, (*path, (id(lines), position)), loops)

    def statement(self, line: ast.stmt, path: _Path, loops: tuple[int, ...]) -> None:
        """Add the assignments and reads in a statement, nested statements included."""
        if isinstance(line, ast.Assign):
            self.expression(line.value, path, loops)
            for target in line.targets:
                self.target(target, path, loops)
        elif isinstance(line, ast.AugAssign):
            self.expression(line.value, path, loops)
            if isinstance(line.target, ast.Name):
                self.add(line.target.id, path, loops, False)
            self.target(line.target, path, loops)
        elif isinstance(line, ast.If):
            self.expression(line.test, path, loops)
            self.body(line.body, path, loops)
            self.body(line.orelse, path, loops)
        elif isinstance(line, ast.While):
            inner = (*loops, id(line))
            self.expression(line.test, path, inner)
            self.body(line.body, path, inner)
        elif isinstance(line, ast.For):
            self.expression(line.iter, path, loops)
            inner = (*loops, id(line))
            self.target(line.target, (*path, (id(line.body), -1)), inner)
            self.body(line.body, path, inner)
        elif isinstance(line, ast.Return | ast.Expr):
            self.expression(line.value, path, loops)


def variables_of(node: ast.FunctionDef) -> dict[str, bool]:
    """Return, for each name that a function assigns and each of its arguments, True if the variable
    must be stored in memory, False if every read gets the last assignment before it in the text."""
    uses = _Uses()
    for argument in node.args.args:
        uses.add(argument.arg, (), (), True)
    uses.body(node.body, (), ())
    return {
        name: not _is_simple(items)
        for name, items in uses.by_name.items()
        if any(use.is_store for use in items)
    }


def _is_simple(uses: list[_Use]) -> bool:
    """Return True if every read among the uses of one name, in the order of the text, gets the
    value of the last assignment before it in the text."""
    stores = [use for use in uses if use.is_store]
    last: _Use | None = None
    for use in uses:
        if use.is_store:
            last = use
        elif not (last is not None and _reaches(last, use, stores)):
            return False
    return True


def _reaches(store: _Use, read: _Use, stores: list[_Use]) -> bool:
    """Return True if ``read`` always gets the value of ``store``, the last assignment before it in
    the text.

    This requires that control cannot reach the read without passing the assignment, and that no
    loop around the read, but not around ``store``, contains a later one of the name's assignments
    ``stores``, whose value would arrive in the next iteration.
    """
    if store.path:
        *around, (block, position) = store.path
        depth = len(around)
        if len(read.path) <= depth or list(read.path[:depth]) != around:
            return False
        other_block, other_position = read.path[depth]
        if other_block != block or other_position < position:
            return False
    return not any(
        later.order > read.order
        and any(loop in later.loops and loop not in store.loops for loop in read.loops)
        for later in stores
    )
