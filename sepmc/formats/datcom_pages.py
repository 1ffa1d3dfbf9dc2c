"""Parsing of printed pages of Digital and Missile DATCOM to tables over ALPHA, and the choice of a
case and a configuration.

Missile DATCOM numbers its cases. Digital DATCOM prints a list of the input cards before the pages
of each; a list that only changes flight conditions continues the case before it.
"""

import math
import re
from dataclasses import dataclass, field

from sepmc.formats.text_table import FormatError, number
from sepmc.scene.messages import printable, shorten

# coefficients by their titles, of Digital and of Missile DATCOM
STATIC = {"CN": "normal", "CA": "axial", "CM": "pitch", "CY": "side", "CLN": "yaw", "CLL": "roll"}
BY_BETA = {"CYB": "side", "CNB": "yaw", "CLNB": "yaw", "CLB": "roll", "CLLB": "roll"}
BY_RATE = {
    "CNQ": "normal_q", "CLQ": "normal_q", "CMQ": "pitch_q", "CAQ": "axial_q", "CYP": "side_p",
    "CYR": "side_r", "CLLP": "roll_p", "CLP": "roll_p", "CLLR": "roll_r", "CLR": "roll_r",
    "CLNP": "yaw_p", "CNP": "yaw_p", "CLNR": "yaw_r", "CNR": "yaw_r",
}  # fmt: skip
BY_ALPHA_RATE = ("CNAD", "CLAD", "CMAD", "CAAD")
_TITLES = {*STATIC, *BY_BETA, *BY_RATE, *BY_ALPHA_RATE}
_OTHERS = frozenset(["ALPHA", "CD", "CL", "XCP", "CLA", "CMA", "CNA", "X-C.P.", "CL/CD"])
_TOKEN = re.compile(r"\S+")
_DIGITAL = re.compile(r"^\S?\s*(\.\d+|\d+\.\d*)\s+")
_NUMBER = r"(?:\d+\.?\d*|\.\d+)(?:E[+-]?\d{1,3})?(?![\d.])"
_MACH = re.compile(rf"MACH NO\s*=\s*({_NUMBER})")
_BETA = re.compile(rf"SIDESLIP\s*=\s*(-?{_NUMBER})")
_CONDITION = re.compile(rf"\b(ALTITUDE|ROLL)\s*=\s*(-?{_NUMBER})")
_REFERENCE = re.compile(
    rf"(REF AREA|LAT REF LENGTH|REF LENGTH|MOMENT CENTER)\s*=\s*(-?{_NUMBER})\s*(\S+)?"
)
# of the last columns, below REFERENCE DIMENSIONS; pressures are per area before it
_AREA_UNIT = re.compile(r"(?<!/)\b(FT|IN|CM|M)\*\*2\s+\1\b")
_CASE = re.compile(r"CASE\s+(\d+)\s*$")
_CASE_NAME = re.compile(r"^\s*(?:\d+\s+)?CASEID\s+(.*?)\s*$")
_CARDS_END = re.compile(r"^\s*(?:\d+\s+)?NEXT CASE|INPUT DIMENSIONS ARE|^1")
# input cards that change the vehicle, not only the conditions of its flight
_OTHER_VEHICLE = re.compile(r"\$(?!FLTCON\b)[A-Z]|^\s*(?:NACA|DIM)\b")
_NAME_LENGTH = 40  # letters of the name of a case in a message


@dataclass(frozen=True)
class Value:
    """The number ``value``, which line number ``line`` of the file prints below ``title`` for the
    angle of attack ``alpha``, deg; ``per_degree`` is true if that page gives derivatives per
    degree, not per radian."""

    title: str
    alpha: float
    value: float
    per_degree: bool
    line: int


@dataclass
class Table:
    """Table over ALPHA that a page prints, with the heading of the page.

    Attributes
    ----------
    configuration, conditions : str
        Name of the configuration of the vehicle, and conditions such as altitude.
    rates : bool
        True on pages of dynamic derivatives.
    forces : bool
        True if both CN and CA are among the titles of the table.
    mach, beta : float
        Mach number and sideslip of the table, deg.
    references : dict of str to str
        Reference quantities by title, as printed: number and, where it has one, unit.
    values : list of Value
        Numbers of the table in the order of the file.
    """

    configuration: str
    conditions: str
    rates: bool
    forces: bool
    mach: float
    beta: float
    references: dict[str, str]
    values: list[Value] = field(default_factory=list)

    @property
    def place(self) -> str:
        """Configuration and conditions, as messages name the table."""
        return ", ".join(filter(None, (self.configuration, self.conditions)))


@dataclass
class Case:
    """Tables of one case in the order of the file, and its name, empty if it has none."""

    name: str = ""
    tables: list[Table] = field(default_factory=list)


@dataclass
class Block:
    """Values that a case prints for one Mach number and one sideslip (``beta``, deg):
    ``values[title][alpha]`` at alpha in deg. ``per_degree`` has the titles whose values are slopes
    per degree."""

    mach: float
    beta: float
    values: dict[str, dict[float, float]] = field(default_factory=dict)
    per_degree: set[str] = field(default_factory=set)


@dataclass
class Output:
    """Values of one configuration of a case: ``blocks``, one for each Mach number and sideslip;
    ``references``, the reference quantities with unit, as text, by title; and ``understood``,
    sentences for the user on which configuration and tables were chosen."""

    blocks: list[Block] = field(default_factory=list)
    references: dict[str, str] = field(default_factory=dict)
    understood: list[str] = field(default_factory=list)


def choose_case(cases: dict[int, Case], wanted: object) -> Case:
    """Case of the number ``wanted``, or the only one if it is None. Raises FormatError if there is
    no such case, or there are several and none is wanted."""
    known = ", ".join(_case_names(cases)[:20]) + (", ..." if len(cases) > 20 else "")
    if not cases:
        raise FormatError("has no table of coefficients over ALPHA, as DATCOM prints them")
    if wanted is None and len(cases) > 1:
        raise FormatError(f"has {len(cases)} cases; choose one by case = NUMBER, of {known}")
    if wanted is None:
        return next(iter(cases.values()))
    if isinstance(wanted, bool) or not isinstance(wanted, int) or wanted not in cases:
        raise FormatError(f"has no case {shorten(wanted)}; known: {known}")
    return cases[wanted]


def _case_names(cases: dict[int, Case]) -> list[str]:
    """Number of each case, with its name in brackets if it has one."""
    return [
        f"{key} ({case.name if len(case.name) <= _NAME_LENGTH else '...' + case.name[-37:]})"
        if case.name
        else f"{key}"
        for key, case in cases.items()
    ]


def choose_output(case: Case, configuration: object) -> Output:
    """Collect the values of one configuration of a case.

    Parameters
    ----------
    case : Case
    configuration : str or None
        Part of the configuration or of the conditions of the tables to read, such as "WING ALONE"
        or "ALTITUDE 2000"; None for all. Of several configurations that are left, the last one with
        CN and CA is read. If it has no tables of derivatives by rates, those of the last
        configuration with such tables are added: Missile DATCOM names it otherwise there.

    Returns
    -------
    Output

    Raises
    ------
    FormatError
        If no table has that configuration, or the tables of it give two values of a coefficient at
        one Mach number, alpha and sideslip, or have different reference quantities.
    """
    output = Output()
    static = [each for each in case.tables if not each.rates]
    rates = [each for each in case.tables if each.rates]
    if configuration is not None:
        static, rates = (_matching(each, configuration) for each in (static, rates))
        if not static:
            known = list(dict.fromkeys(each.place for each in case.tables if not each.rates))
            raise FormatError(
                f"has no table of the configuration {shorten(configuration)}; known: "
                + "; ".join(known[:20])
            )
    filled = {each.configuration for each in static if each.forces and each.values}
    whole = [each for each in static if each.forces and each.configuration in filled]
    name = whole[-1].configuration if whole else ""
    others = dict.fromkeys(each.configuration for each in whole if each.configuration != name)
    if case.name:
        output.understood.append(f"case {shorten(case.name)}")
    if others:
        output.understood.append(
            f"configuration {name}, the last of its case; NOT read: {', '.join(others)} (choose "
            "one by configuration)"
        )
    elif name:
        output.understood.append(f"configuration {name}")
    if whole:
        static = [each for each in static if each.configuration == name]
    # Missile DATCOM names configurations otherwise on its pages of rates
    if rates and not any(each.configuration == name for each in rates):
        other = rates[-1].configuration
        output.understood.append(f"derivatives by rates of the configuration {other}")
    else:
        other = name
    _fill(output, [*static, *(each for each in rates if each.configuration == other)])
    return output


def _matching(tables: list[Table], text: object) -> list[Table]:
    """Tables whose configuration is a text, in capitals or not; if there are none, those whose
    configuration or conditions contain it. Raises FormatError if it is no text, or blank."""
    if not isinstance(text, str) or not text.strip():
        raise FormatError('configuration: must be a part of the heading, such as "WING ALONE"')
    part = text.strip().upper()
    exact = [each for each in tables if each.configuration == part]
    return exact or [each for each in tables if part in each.place.upper()]


def _fill(output: Output, tables: list[Table]) -> None:
    """Put the values and reference quantities of tables of one configuration into ``output``.
    Raises FormatError if tables have different reference quantities, or a coefficient has two
    different values at one Mach number, sideslip and alpha."""
    seen: dict[tuple[str, float, float, float], tuple[Value, Table]] = {}
    first: Table | None = None
    for table in tables:
        first = first or table
        for title in first.references.keys() & table.references.keys():
            if first.references[title] != table.references[title]:
                raise FormatError(
                    f"has {title} {first.references[title]} at Mach number {first.mach:g} and "
                    f"{table.references[title]} at Mach number {table.mach:g} in one case: its "
                    "tables must have the same reference quantities; keep those of one vehicle"
                )
        output.references |= table.references
        block = next(
            (b for b in output.blocks if b.mach == table.mach and b.beta == table.beta), None
        )
        if block is None:
            block = Block(table.mach, table.beta)
            output.blocks.append(block)
        for each in table.values:
            key = (each.title, table.mach, table.beta, each.alpha)
            before, place = seen.setdefault(key, (each, table))
            if before.value != each.value:
                raise FormatError(
                    f"line {each.line}: {each.title} at Mach number {table.mach:g}, alpha = "
                    f"{each.alpha:g} deg, sideslip {table.beta:g} deg is {each.value:g} "
                    f"({table.place}), but {before.value:g} in line {before.line} ({place.place}): "
                    "choose by configuration, a part of a heading or of conditions as named here"
                )
            block.values.setdefault(each.title, {})[each.alpha] = each.value
            if each.title not in STATIC and each.per_degree:
                block.per_degree.add(each.title)


def parse_cases(text: str) -> dict[int, Case]:
    """Parse an output of DATCOM to its cases by number; cases without coefficients are left out.

    Parameters
    ----------
    text : str

    Returns
    -------
    dict of int to Case
    """
    pages = _Pages()
    for line_number, line in enumerate(text.splitlines(), 1):
        pages.add(line_number, line)
    return {key: each for key, each in pages.cases.items() if each.tables}


class _Pages:
    """Reader of the lines of an output: `add` takes one after the other, ``cases`` has the tables
    read so far, by number of the case; case 1 is there from the start, without tables."""

    def __init__(self) -> None:
        self.cases: dict[int, Case] = {1: Case()}
        self.case = 1
        self.mach, self.beta, self.per_degree = math.nan, 0.0, False
        self.references: dict[str, str] = {}
        self.titles: list[tuple[str, float]] = []
        self.table: Table | None = None
        self.heading: list[str] = []
        self.cards: list[str] = []
        self.conditions: dict[str, str] = {}
        self.in_heading = self.in_cards = self.wants_conditions = self.has_cards = False
        self.length_unit = ""

    def add(self, line_number: int, line: str) -> None:
        """Read the next line of the output: a row of coefficients goes into a table of ``cases``,
        headings and conditions of flight describe the tables that follow, other lines are skipped.
        A line with text among its cells ends the table; rows before the first Mach number are
        skipped. ``line_number`` is counted from 1."""
        if self._header(line):
            return
        upper = line.upper()
        if "PER DEGREE" in upper or "PER RADIAN" in upper:
            self.per_degree = "PER DEGREE" in upper
        self._condition(line, upper)
        cells = [(m[0], (m.start() + m.end()) / 2) for m in _TOKEN.finditer(line)]
        words = [cell for cell, _ in cells if cell != "0"]
        if words and words[0] == "ALPHA":
            self.titles = [cell for cell in cells if cell[0] != "0"]
            self.table = None
            if not all(word in _TITLES or word in _OTHERS for word in words):
                self.titles = []
            return
        if not self.titles or not words:
            return
        if not all(_is_value(cell) for cell, _ in cells):
            self.titles = []
        elif not math.isnan(self.mach):
            self._row(line_number, cells)

    def _header(self, line: str) -> bool:
        """Read a line if it belongs to input cards or the heading of a page. Returns True for a
        card and the first line of a heading, in which there is nothing else to read."""
        if "LIST OF ALL INPUT CARDS" in line:
            self.in_cards, self.has_cards, self.cards = True, True, []
            self.titles = []
            return True
        if self.in_cards:
            if not _CARDS_END.search(line):
                self.cards.append(line)
                return True
            self._end_cards()
        if "AUTOMATED" in line and "DATCOM" in line:
            if match := _CASE.search(line):
                self._begin(int(match[1]))
            self.in_heading, self.heading, self.titles, self.conditions = True, [], [], {}
            return True
        if self.in_heading:
            self.in_heading = "FLIGHT CONDITIONS" not in line
            if self.in_heading and line.strip() and len(self.heading) < 8:
                self.heading.append(printable(" ".join(line.split())))
            elif not self.in_heading:
                self._end_heading()
        return False

    def _begin(self, case: int) -> None:
        """Make ``case`` the number of the case that is read; that case is created if it is not
        there. If the number changes, the reference quantities are forgotten."""
        if case != self.case:
            self.references = {}
        self.case = case
        self.cases.setdefault(case, Case())

    def _end_cards(self) -> None:
        """End a list of input cards of Digital DATCOM, and take the name of the case from them.

        A new case begins if the cards give another name than that of the present case or, once the
        present case has tables, another vehicle; not if they only change flight conditions, or if
        the present case has no tables and no name yet."""
        self.in_cards = False
        names = [printable(match[1]) for card in self.cards if (match := _CASE_NAME.match(card))]
        current = self.cases[self.case]
        changed = any(map(_OTHER_VEHICLE.search, self.cards))
        renamed = names not in ([], [current.name])
        if (current.tables and (changed or renamed)) or (current.name and renamed):
            self._begin(max(self.cases) + 1)
        if names:
            self.cases[self.case].name = names[0]

    def _end_heading(self) -> None:
        """Set the name of the case from the heading of a page. An output of Digital DATCOM with
        input cards has its names there, so nothing changes; without cards, a name other than that
        of the present case begins a new case."""
        if "MISSILE" in " ".join(self.heading[:1]).upper():
            kind = self.heading[-1]
            known = "STATIC AERODYNAMICS FOR" in kind or "DYNAMIC DERIVATIVES" in kind
            name = self.heading[1] if known and len(self.heading) == 3 else ""
        else:
            extra = [each for each in self.heading[2:] if " INCLUDED IN THE " not in each]
            name = extra[-1] if extra else ""
            if self.has_cards or not name or "AUXILIARY" in self.heading[0]:
                return
            if self.cases[self.case].name not in ("", name):
                self._begin(max(self.cases) + 1)
        if name:
            self.cases[self.case].name = name

    def _condition(self, line: str, upper: str) -> None:
        """Read the conditions of flight and the reference quantities in a line, if it has some;
        ``upper`` is the line in capitals."""
        if match := _MACH.search(line):
            self.mach, self.titles = float(match[1]), []
        if match := _BETA.search(line):
            self.beta = float(match[1])
        for match in _CONDITION.finditer(line):
            self.conditions[match[1]] = match[2]
        for match in _REFERENCE.finditer(line):
            self.references[match[1]] = f"{match[2]} {match[3] or ''}".strip()
        if "REFERENCE DIMENSIONS" in upper:  # of Digital DATCOM
            self.wants_conditions, self.beta, self.titles, self.conditions = True, 0.0, [], {}
        elif self.wants_conditions and (match := _AREA_UNIT.search(line)):
            self.length_unit = match[1]
        elif self.wants_conditions and line.startswith("0") and (match := _DIGITAL.match(line[1:])):
            self.mach, self.wants_conditions = float(match[1]), False
            self._digital_references(line)

    def _digital_references(self, line: str) -> None:
        """Read the altitude, and the area, lengths and moment centre at the end of a line of flight
        conditions of Digital DATCOM."""
        numbers = line.split()[1:] if line.startswith("0 ") else line[1:].split()
        if len(numbers) >= 11:
            self.conditions["ALTITUDE"] = numbers[1]
        if len(numbers) >= 6:
            names = ("REF AREA", "REF LENGTH", "LAT REF LENGTH", "MOMENT CENTER")
            for name, value in zip(names, numbers[-5:-1], strict=True):
                square = "**2" if name == "REF AREA" and self.length_unit else ""
                self.references[name] = f"{value} {self.length_unit}{square}".strip()

    def _row(self, line_number: int, cells: list[tuple[str, float]]) -> None:
        """Add the values of a printed line to the table below its titles. ``cells`` are pairs
        (text, column of its middle), the first of which is alpha.

        If there are as many cells as titles, alpha included, they belong together in order; else a
        value belongs to the title whose column is nearest. Values that are not printed (NDM, NA,
        ***) and those below a title that is not in `_TITLES` are left out, and so is a line without
        a printed alpha.
        """
        if self.table is None:
            self.table = self._new_table()
            self.cases[self.case].tables.append(self.table)
        if cells[0][0] in ("NDM", "NA") or "*" in cells[0][0]:
            return
        alpha = number(cells[0][0])
        aligned = len(cells) == len(self.titles)
        for k, (cell, middle) in enumerate(cells[1:], 1):
            title = (
                self.titles[k][0]
                if aligned
                else min(self.titles, key=lambda t: abs(t[1] - middle))[0]
            )
            if title in _TITLES and cell not in ("NDM", "NA") and "*" not in cell:
                self.table.values.append(
                    Value(title, alpha, number(cell), self.per_degree, line_number)
                )

    def _new_table(self) -> Table:
        """Empty table with the configuration, conditions, Mach number and references of the page
        that is read; the caller appends it to the tables of the case."""
        lines = [each for each in self.heading if "PAGE" not in each]
        extra: list[str] = []
        if lines and len(lines) == len(self.heading):  # of Digital DATCOM
            configuration = lines[1] if len(lines) > 1 else ""
            extra = [each for each in lines[2:] if " INCLUDED IN THE " in each]
        else:
            configuration = lines[-1] if lines else ""
        for word in ("STATIC AERODYNAMICS FOR ", " DYNAMIC DERIVATIVES", " CONFIGURATION"):
            configuration = configuration.replace(word, "")
        return Table(
            configuration.removeprefix("DATCOM "),
            ", ".join([*extra, *(f"{key} {value}" for key, value in self.conditions.items())]),
            any("DYNAMIC DERIVATIVES" in each for each in self.heading),
            {"CN", "CA"} <= {title for title, _ in self.titles},
            self.mach,
            self.beta,
            dict(self.references),
        )


def _is_value(cell: str) -> bool:
    """True if a cell is a finite number, or stands for one that is not printed: NDM, NA, ***."""
    if cell in ("NDM", "NA") or set(cell) == {"*"}:
        return True
    try:
        return math.isfinite(number(cell))
    except ValueError:
        return False
