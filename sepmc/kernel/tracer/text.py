"""Lines of a module that is being written, and the slabs of its workspace."""

import contextlib
import re
import textwrap
from collections.abc import Iterator
from typing import Any

WIDTH = 100
_BY_HAND = "written by hand"
_ASSIGNED = re.compile(r"(?:for )?((?:[a-z]\w*, )*[a-z]\w*) (?:=|in) ")


class Text:
    """Lines at an indent; called with lines to add. Texts made by `indented` share them, and what
    the names of their function stand for: a name means one kind of thing in a function."""

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
            if found := _ASSIGNED.match(line):
                for name in found[1].split(", "):
                    known = self.names.setdefault(name, _BY_HAND)
                    if known != _BY_HAND and line.startswith("for "):
                        raise TypeError(f"{name} stands for two things in a function: {line}")
        self.lines += ["    " * self.indent + line if line else "" for line in lines]

    def indented(self, by: int) -> "Text":
        """The same lines, continued further to the right."""
        return Text(self.indent + by, self.lines, self.names)

    def block(self, head: str) -> "Text":
        """A line that opens a block, such as a loop; returns where the lines in it go."""
        self(head)
        return self.indented(1)

    def lanes(self) -> "Text":
        """A loop over lanes; returns where the lines in it go."""
        return self.block("for l in range(LANES):")

    def function(self, signature: str, says: str) -> "Text":
        """Head of a function and its docstring; returns where its lines go."""
        self("", "", "@routine")
        inner = Text(self.indent + 1, self.lines)
        self(f"def {signature}:")
        inner(*textwrap.wrap(f'"""{says}"""', WIDTH - 4 * inner.indent, break_long_words=False))
        inner("noinline()")
        return inner

    def broken(self, line: str) -> None:
        """A statement, on as many lines as it takes."""
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
        """A sum, on as many lines as it takes."""
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


class Slabs:
    """Names of slabs and how many quantities stand in each; their places follow from the order.

    What depends on outputs, histories or a given step stands behind all else: so that the text of
    functions that have nothing to do with these is the same with and without them, and is compiled
    once.
    """

    def __init__(self) -> None:
        self.counts: dict[str, int] = {}
        self._last: list[str] = []
        self._optional = False

    def add(self, name: str, count: int, optional: bool = False) -> bool:
        """Add a slab if it is new, one that not all flights of a scene have if ``optional``.
        Returns whether it is new."""
        if name in self.counts:
            return False
        self.counts[name] = count
        if optional or self._optional:
            self._last.append(name)
        return True

    @contextlib.contextmanager
    def optional(self) -> Iterator[None]:
        """All slabs that are added meanwhile are optional."""
        self._optional = True
        try:
            yield
        finally:
            self._optional = False

    def has(self, name: str) -> bool:
        """Whether a slab of that name was added before."""
        return name in self.counts

    def lines(self) -> list[str]:
        """Places of all slabs as named constants, and the sizes of a state and of the workspace."""
        lines, start = [], 0
        for name in [*(name for name in self.counts if name not in self._last), *self._last]:
            count = self.counts[name]
            lines.append(f"{name} = {start} * LANES" + (f"  # {count}" if count > 1 else ""))
            start += count
        return [*lines, f"SIZE_Y = {self.counts['Y']} * LANES", f"SIZE_W = {start} * LANES"]
