"""Source text of a kernel module that is being written, and the fields of the workspace that its
functions use."""

import contextlib
import re
import textwrap
from collections.abc import Iterator
from typing import Any

WIDTH = 100
_BY_HAND = "written by hand"
_ASSIGNED = re.compile(r"(?:for )?((?:[a-z]\w*, )*[a-z]\w*) (?:=|in) ")


class Text:
    """Lines of source code that are appended at one indent: ``text(line, ...)`` appends lines.

    Texts made from this one (`indented`, `block`, `lanes`) append to the same ``lines``, at a
    deeper indent, and share ``names``, the shape of each variable of the function, by which traced
    code gives values of different shapes different names. A loop written by hand whose counter is a
    variable of traced code raises TypeError; nothing else is checked.
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
                        raise TypeError(
                            f"{name} stands for two things in a function: a traced value, and the "
                            f"counter of the loop: {line}"
                        )
        self.lines += ["    " * self.indent + line if line else "" for line in lines]

    def indented(self, by: int) -> "Text":
        """Return a text that appends to the same lines, ``by`` indents (of four spaces) deeper."""
        return Text(self.indent + by, self.lines, self.names)

    def block(self, head: str) -> "Text":
        """Append the line ``head``, such as ``if x > 0.0:``; return the text for the block below
        it."""
        self(head)
        return self.indented(1)

    def lanes(self) -> "Text":
        """Append the head of a loop over lanes (cases side by side), with the counter ``l``; return
        the text for its body."""
        return self.block("for l in range(LANES):")

    def components(self, size: str) -> "Text":
        """Append the heads of a loop over the components of fields and of a loop over lanes within
        it; return the text for their body. ``size`` is the code of the number of components times
        LANES. In the body, w[X + e + l] is a number of a field X: ``e`` is LANES times the index of
        the component, from 0, ``l`` the lane."""
        return self.block(f"for e in range(0, {size}, LANES):").lanes()

    def function(self, signature: str, docstring: str) -> "Text":
        """Append the head of a kernel function, with decorator, docstring and the mark that it is
        not inlined.

        Parameters
        ----------
        signature : str
            name and arguments, such as ``rates_phase1(w)``
        docstring : str

        Returns
        -------
        Text
            for the body of the function; its variable names are independent of other functions
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
        """Append the statement ``line``, an assignment or a call, broken into lines of at most
        `WIDTH` characters."""
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
        """Append a statement that is the text ``start``, then ``terms`` joined by " + ", then the
        text ``end``; broken between terms into lines of at most `WIDTH` characters. A bracket that
        ``start`` opens and ``end`` closes must then be around the terms."""
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
    """Fields of the workspace, the array in which a kernel keeps all numbers of a block of cases.

    Each field has a name and a number of components (``counts``), which a second `add` does not
    change; a component is LANES numbers, one per lane. Fields are stored in the order in which they
    were added, but optional ones (of outputs, histories or a given step) come last: so functions
    that do not use them have the same text with and without them, and are compiled once.
    """

    def __init__(self) -> None:
        self.counts: dict[str, int] = {}
        self._last: list[str] = []
        self._optional = False

    def add(self, name: str, count: int, optional: bool = False) -> bool:
        """Add a field unless one of that name exists, which then keeps its size.

        Parameters
        ----------
        name : str
        count : int
            number of components
        optional : bool
            True if not every kernel of the scene has the field; it is then stored after all fields
            that are not optional

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
        """Context manager: all fields that are added within it are optional, as by the argument
        ``optional`` of `add`."""
        before, self._optional = self._optional, True
        try:
            yield
        finally:
            self._optional = before

    def has(self, name: str) -> bool:
        """True if a field of that name exists."""
        return name in self.counts

    def lines(self) -> list[str]:
        """Lines of source code that define, as constants, the offset of each field in the workspace
        and the sizes, in numbers, of a state (SIZE_Y) and of the workspace (SIZE_W). Fields are in
        the order in which they were added, but optional ones (`add`) after all others."""
        lines, start = [], 0
        for name in [*(name for name in self.counts if name not in self._last), *self._last]:
            count = self.counts[name]
            lines.append(f"{name} = {start} * LANES" + (f"  # {count}" if count > 1 else ""))
            start += count
        return [*lines, f"SIZE_Y = {self.counts['Y']} * LANES", f"SIZE_W = {start} * LANES"]
