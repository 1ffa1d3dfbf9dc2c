"""Writer of a function in LLVM assembly, instruction by instruction."""

from itertools import count
from typing import Any

from sepmc.translator.values import BOOL, FLOAT, POINTER, RANK, Number, constant


class Writer:
    """Text of a function in LLVM assembly, as a list of lines that grows.

    It consists of basic blocks: a label, instructions, and at the end a jump, branch or return.
    Instructions are added to the current block (``block`` is its label). ``allocations`` are the
    lines that reserve stack memory, which `define` puts before all others.

    Parameters
    ----------
    module : sepmc.translator.module.Module
        Module that `define` adds the function to.
    """

    def __init__(self, module: Any):
        self.module = module
        self.lines: list[str] = []
        self.allocations: list[str] = []
        self.names = count()
        self.block = "start"
        self.ended = False  # True: the current block has its jump, branch or return

    def emit(self, kind: str, text: str) -> Number:
        """Add the instruction ``text``, whose result has the LLVM type ``kind``, such as FLOAT;
        return the result, under a new name."""
        name = f"%v{next(self.names)}"
        self.lines.append(f"{name} = {text}")
        return Number(kind, name)

    def run(self, text: str) -> None:
        """Add an instruction that has no result."""
        self.lines.append(text)

    def label(self) -> str:
        """Return a new label, for a block that `begin` starts later."""
        return f"b{next(self.names)}"

    def begin(self, label: str) -> None:
        """Start the block of a label: instructions are added to it from now on."""
        self.lines.append(f"{label}:")
        self.block, self.ended = label, False

    def jump(self, label: str, metadata: str = "") -> None:
        """End the current block with a jump to a label; do nothing if the block has ended.
        ``metadata`` is what LLVM's assembly has after the jump, from a comma on."""
        if not self.ended:
            self.run(f"br label %{label}{metadata}")
            self.ended = True

    def branch(self, test: Number, yes: str, no: str) -> None:
        """End the current block with a branch to the label ``yes`` if a truth value is true, else
        to the label ``no``."""
        self.run(f"br i1 {test.text}, label %{yes}, label %{no}")
        self.ended = True

    def allocate(self, kind: str, number: int = 1) -> Number:
        """Reserve stack memory of the function for ``number`` numbers of the type ``kind``; return
        a pointer to the first."""
        name = f"%v{next(self.names)}"
        many = f", i64 {number}" if number > 1 else ""
        self.allocations.append(f"{name} = alloca {kind}{many}")
        return Number(POINTER, name)

    def phi(self, ways: list[tuple[Number, str]]) -> Number:
        """Add an instruction that chooses a number by the block from which control came; return the
        chosen number. The current block must have no instruction yet but others of this kind.

        ``ways`` has a pair (number, label of the block) for each block that can jump to the current
        one; all numbers have the same type. No instruction is added if all numbers are equal.
        """
        kind = ways[0][0].kind
        if len({number.text for number, _ in ways}) == 1:
            return ways[0][0]
        pairs = ", ".join(f"[ {number.text}, %{label} ]" for number, label in ways)
        return self.emit(kind, f"phi {kind} {pairs}")

    def converted(self, number: Number, kind: str) -> Number:
        """Convert a number to the type ``kind``, adding an instruction if needed; return the
        result. Raises TypeError if ``kind`` has a lower rank (`RANK`), such as INT for a float."""
        if number.kind == kind:
            return number
        if RANK.get(number.kind, 3) > RANK.get(kind, -1):
            raise TypeError(
                f"a {number.kind} does not fit a {kind}: a value may become one of a later type in "
                "i1, i64, double only"
            )
        if number.constant is not None:
            return constant(float(number.constant) if kind == FLOAT else int(number.constant))
        op = "zext" if kind != FLOAT else "uitofp" if number.kind == BOOL else "sitofp"
        return self.emit(kind, f"{op} {number.kind} {number.text} to {kind}")

    def define(self, head: str, parameters: list[Number], marks: str = "") -> None:
        """Add the definition of the function, with all instructions so far, to the module.

        Parameters
        ----------
        head : str
            Linkage, type of the result and name, such as ``internal double @f0_norm``.
        parameters : list of Number
            Parameters of the function in LLVM.
        marks : str
            LLVM attributes, such as ``alwaysinline``.
        """
        listed = ", ".join(f"{number.kind} {number.text}" for number in parameters)
        lines = ["start:", *self.allocations, *self.lines]
        self.module.texts.append(
            f"define {head}({listed}) {marks} nounwind {{\n" + "\n".join(lines) + "\n}"
        )
