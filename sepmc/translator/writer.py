"""Writer of the instructions of a function, in LLVM's assembly."""

from itertools import count
from typing import Any

from sepmc.translator.values import BOOL, FLOAT, POINTER, RANK, Number, constant


class Writer:
    """Instructions of a function, in blocks.

    Parameters
    ----------
    module : sepmc.translator.module.Module
        Where the function stands.
    """

    def __init__(self, module: Any):
        self.module = module
        self.lines: list[str] = []
        self.allocations: list[str] = []
        self.names = count()
        self.block = "start"
        self.ended = False  # the block

    def emit(self, kind: str, text: str) -> Number:
        """Add an instruction with a result of a type; return the result."""
        name = f"%v{next(self.names)}"
        self.lines.append(f"{name} = {text}")
        return Number(kind, name)

    def run(self, text: str) -> None:
        """Add an instruction without result."""
        self.lines.append(text)

    def label(self) -> str:
        """Name of a new block."""
        return f"b{next(self.names)}"

    def begin(self, label: str) -> None:
        """Begin a block."""
        self.lines.append(f"{label}:")
        self.block, self.ended = label, False

    def jump(self, label: str) -> None:
        """End the block, if it has not ended."""
        if not self.ended:
            self.run(f"br label %{label}")
            self.ended = True

    def branch(self, test: Number, yes: str, no: str) -> None:
        """End the block with a branch to one of two others."""
        self.run(f"br i1 {test.text}, label %{yes}, label %{no}")
        self.ended = True

    def allocate(self, kind: str, number: int = 1) -> Number:
        """Pointer to memory of the function, for one or several numbers of a type."""
        name = f"%v{next(self.names)}"
        many = f", i64 {number}" if number > 1 else ""
        self.allocations.append(f"{name} = alloca {kind}{many}")
        return Number(POINTER, name)

    def phi(self, ways: list[tuple[Number, str]]) -> Number:
        """Number that depends on the block that control comes from."""
        kind = ways[0][0].kind
        if len({number.text for number, _ in ways}) == 1:
            return ways[0][0]
        pairs = ", ".join(f"[ {number.text}, %{label} ]" for number, label in ways)
        return self.emit(kind, f"phi {kind} {pairs}")

    def converted(self, number: Number, kind: str) -> Number:
        """Number as one of a type of the same or a higher rank."""
        if number.kind == kind:
            return number
        if RANK.get(number.kind, 3) > RANK.get(kind, -1):
            raise TypeError(f"a {number.kind} does not fit a {kind}")
        if number.constant is not None:
            return constant(float(number.constant) if kind == FLOAT else int(number.constant))
        op = "zext" if kind != FLOAT else "uitofp" if number.kind == BOOL else "sitofp"
        return self.emit(kind, f"{op} {number.kind} {number.text} to {kind}")

    def define(self, head: str, parameters: list[Number], marks: str = "") -> None:
        """Add the function to the module.

        Parameters
        ----------
        head : str
            Linkage, type of the result, name.
        parameters : list of Number
        marks : str
            Attributes.
        """
        listed = ", ".join(f"{number.kind} {number.text}" for number in parameters)
        lines = ["start:", *self.allocations, *self.lines]
        self.module.texts.append(
            f"define {head}({listed}) {marks} nounwind {{\n" + "\n".join(lines) + "\n}"
        )
