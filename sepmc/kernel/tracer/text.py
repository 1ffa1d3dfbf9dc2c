"""Text of a module that is being written, and the fields of its workspace."""

import contextlib
import re
import textwrap
from collections.abc import Iterator
from typing import Any

WIDTH = 100
_BY_HAND = "written by hand"
_ASSIGNED = re.compile(r"(?:for )?((?:[a-z]\w*, )*[a-z]\w*) (?:=|in) ")


class Text:
    """Lines at an indent; a call appends lines.

    Texts made by `indented` share the lines and the shapes of variable names: a name has one shape
    in a function.
    """

    def __init__(
        self,
        indent: int = 0,
        lines: list[str] | None = None,
        names: dict[str, Any] | None = None,
    ):
        self.lines: list[str] = [] if lines is None else lines
        self.names: dict[str, Any] = {} if names is None else names
        self.indent = indent

    def __call__(self, *lines: str) -> None:
        for line in lines:
            if assignment := _ASSIGNED.match(line):
                for name in assignment[1].split(", "):
                    shape = self.names.setdefault(name, _BY_HAND)
                    if shape != _BY_HAND and line.startswith("for "):
                        raise TypeError(f"{name} stands for two things in a function: {line}")
        self.lines += ["    " * self.indent + line if line else "" for line in lines]

    def indented(self, by: int) -> "Text":
        """Text that appends to the same lines with a deeper indent."""
        return Text(self.indent + by, self.lines, self.names)

    def block(self, head: str) -> "Text":
        """Append a line that opens a block; return the text of its body."""
        self(head)
        return self.indented(1)

    def lanes(self) -> "Text":
        """Append the head of a loop over lanes, with the counter ``l``; return the text of its
        body."""
        return self.block("for l in range(LANES):")

    def function(self, signature: str, docstring: str) -> "Text":
        """Append the head of a compiled function.

        Parameters
        ----------
        signature : str
            name and arguments, such as ``rates_phase1(w)``
        docstring : str

        Returns
        -------
        Text
            body of the function
        """
        self("", "", "@routine")
        inner = Text(self.indent + 1, self.lines)
        self(f"def {signature}:")
        inner(
            *textwrap.wrap(f'"""{docstring}"""', WIDTH - 4 * inner.indent, break_long_words=False)
        )
        inner("noinline()")
        return inner

    def broken(self, line: str) -> None:
        """Append a statement, broken into lines of at most `WIDTH` characters."""
        if 4 * self.indent + len(line) <= WIDTH:
            self(line)
            return
        name, equals, code = line.partition(" = ")
        width = WIDTH - 4 * (self.indent + 1)
        if not equals:  # a call
            first, *rest = textwrap.wrap(line, WIDTH - 4 * self.indent, break_long_words=False)
            self(
                first,
                *(
                    "    " + part
                    for part in textwrap.wrap(" ".join(rest), width, break_long_words=False)
                ),
            )
            return
        self(
            f"{name} = (",
            *("    " + part for part in textwrap.wrap(code, width, break_long_words=False)),
            ")",
        )

    def wrapped(self, start: str, terms: list[str], end: str) -> None:
        """Append a statement ``start`` + sum of ``terms`` + ``end``, broken into lines of at most
        `WIDTH` characters."""
        lead = "    " * self.indent
        whole = lead + start + " + ".join(terms) + end
        if len(whole) <= WIDTH:
            self.lines.append(whole)
            return
        self.lines.append(lead + start)
        line = lead + "    " + terms[0]
        for term in terms[1:]:
            if len(line) + len(term) + 3 > WIDTH:
                self.lines.append(line)
                line = lead + "    + " + term
            else:
                line += " + " + term
        self.lines += [line, lead + end]


class Workspace:
    """Fields of the workspace, each with a number of components per lane; their offsets follow the
    order in which they were added.

    Optional fields (of outputs, histories or a given step) come last: so functions that do not use
    them have the same text with and without them, and are compiled once.
    """

    def __init__(self) -> None:
        self.counts: dict[str, int] = {}
        self._last: list[str] = []
        self._optional = False

    def add(self, name: str, count: int, optional: bool = False) -> bool:
        """Add a field if it is new.

        Parameters
        ----------
        name : str
        count : int
            components per lane
        optional : bool
            True if not every kernel of the scene has the field

        Returns
        -------
        bool
            True if the field is new
        """
        if name in self.counts:
            return False
        self.counts[name] = count
        if optional or self._optional:
            self._last.append(name)
        return True

    @contextlib.contextmanager
    def optional(self) -> Iterator[None]:
        """Make all fields that are added inside the context optional."""
        self._optional = True
        try:
            yield
        finally:
            self._optional = False

    def has(self, name: str) -> bool:
        """True if a field of that name exists."""
        return name in self.counts

    def lines(self) -> list[str]:
        """Definitions of the field offsets as constants, and the sizes of a state and of the
        workspace."""
        lines, start = [], 0
        for name in [*(name for name in self.counts if name not in self._last), *self._last]:
            count = self.counts[name]
            lines.append(f"{name} = {start} * LANES" + (f"  # {count}" if count > 1 else ""))
            start += count
        return [*lines, f"SIZE_Y = {self.counts['Y']} * LANES", f"SIZE_W = {start} * LANES"]
