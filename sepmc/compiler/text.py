"""Lines of a module that is being written, and the slabs of its workspace."""

WIDTH = 132


class Text:
    """Lines at an indent; called with lines to add. Texts made by `indented` share them."""

    def __init__(self, indent: int = 0, lines: list[str] | None = None):
        self.lines: list[str] = [] if lines is None else lines
        self.indent = indent

    def __call__(self, *lines: str) -> None:
        self.lines += ["    " * self.indent + line if line else "" for line in lines]

    def indented(self, by: int) -> "Text":
        return Text(self.indent + by, self.lines)

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

    def insert_before(self, start: str, lines: list[str]) -> None:
        """Put lines before the function whose ``def`` starts so, and its decorator."""
        at = next(i for i, line in enumerate(self.lines) if line.startswith(start)) - 1
        self.lines[at:at] = lines


class Slabs:
    """Names of slabs and how many quantities stand in each; their places follow from the order."""

    def __init__(self) -> None:
        self.counts: dict[str, int] = {}
        self.size = False

    def add(self, name: str, count: int) -> bool:
        """Add a slab if it is new. Returns whether it is."""
        if name in self.counts:
            return False
        self.counts[name] = count
        return True

    def has(self, name: str) -> bool:
        return name in self.counts

    def lines(self) -> list[str]:
        lines, start = [], 0
        for name, count in self.counts.items():
            lines.append(f"{name} = {start} * LANES" + (f"  # {count}" if count > 1 else ""))
            start += count
        return [*lines, f"SIZE_Y, SIZE_W = {self.counts['Y']} * LANES, {start} * LANES"]
