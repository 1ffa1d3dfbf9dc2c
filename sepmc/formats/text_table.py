"""Reading of tables of numbers in text and Parquet files: finds separator, header, units and
comments, and rejects others with the line and the reason."""

import re
from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass
from itertools import pairwise
from pathlib import Path

import numpy as np

from sepmc.scene.limits import read_limited
from sepmc.scene.messages import printable, shorten

FILE_BYTES = 4_000_000  # of a file: what it contains becomes a part of the campaign
_COMMENTS = ("#", "%", "//", "!")
_SEPARATORS = (";", "\t", ",", " ")
_NUMBER = re.compile(r"[+-]?(\d+\.?\d*|\.\d+)([eEdD][+-]?\d+)?|[+-]?(nan|inf)", re.IGNORECASE)
_DECIMAL_COMMA = re.compile(r"[+-]?\d+,\d+([eE][+-]?\d+)?")
_INVISIBLE = dict.fromkeys((0x200B, 0x200C, 0x200D, 0x2060, 0xFEFF))  # OpenRocket has such units
_NAMES = {",": "comma", ";": "semicolon", "\t": "tab", " ": "blank"}


class FormatError(Exception):
    """Raised for a file that cannot be read or is not in the expected format; the argument is the
    reason, with the line if it is in one, but without the name of the file."""


@dataclass(frozen=True)
class TextTable:
    """Table of numbers that was read from a file.

    Attributes
    ----------
    columns : dict of ndarray (n,)
        Columns by name, in the order of the file.
    comments : tuple of str
        Texts of the comment lines.
    separator : str
        Name of the separator, such as "comma" or "blank"; "Parquet" or "fixed width" for tables
        without one.
    header : str
        Where the names of the columns come from: ``line``, a header line or the caller's names;
        ``comment``, a comment of the file; ``assumed``, the caller's ``assumed`` names.
    lines : tuple of int
        Line number in the file of each row; empty for a file without lines, such as Parquet.
    texts : tuple of str
        Names of the columns of a Parquet file that are not read, as they are no numbers.
    """

    columns: dict[str, np.ndarray]
    comments: tuple[str, ...] = ()
    separator: str = ""
    header: str = "line"
    lines: tuple[int, ...] = ()
    texts: tuple[str, ...] = ()

    def check_numbers(self, name: str) -> None:
        """Raise FormatError if the column of a name is there, but is no column of numbers."""
        if name in self.texts:
            raise FormatError(f"column {shorten(name)}: contains no numbers, as it must")

    def where(self, row: int) -> str:
        """Text for messages on where a row (index from 0) is in the file: "line 12", or "row 9,
        counted from 0" if the file has no lines."""
        return f"line {self.lines[row]}" if self.lines else f"row {row}, counted from 0"


def read_bytes(path: Path, most: int = FILE_BYTES) -> bytes:
    """Contents of a regular file. Raises FormatError if it cannot be read or has more than ``most``
    bytes."""
    try:
        return read_limited(path, most)
    except FileNotFoundError:
        raise FormatError("no such file") from None
    except OSError as error:
        raise FormatError(f"cannot be read: {error.strerror or error}") from None
    except ValueError as error:
        raise FormatError(str(error)) from None


def read_text(path: Path, most: int = FILE_BYTES) -> str:
    """Text of a file, decoded as UTF-8 or, if that fails, Latin-1. Raises FormatError if it cannot
    be read, has more than ``most`` bytes or contains NUL bytes (value 0)."""
    data = read_bytes(path, most)
    if b"\0" in data:
        raise FormatError("is no text: it contains NUL bytes")
    try:
        return data.decode("utf-8-sig")
    except UnicodeDecodeError:
        return data.decode("latin-1")


def read_table(
    path: Path,
    names: list[str] | None = None,
    most: int = FILE_BYTES,
    gaps: bool = False,
    assumed: Sequence[str] = (),
) -> TextTable:
    """Read a table from a text or Parquet file.

    Parameters
    ----------
    path : Path
    names : list of str, optional
        Names of all columns of a text file, in place of a header in it.
    most : int
        Largest number of bytes of the file. A Parquet file, which may unpack to much more, may have
        at most a quarter as many numbers.
    gaps : bool
        True, for logs: cells that are blank or no number become NaN, even if a whole column is, and
        columns of one title are numbered, ``height #1 (m)``. False: such cells and columns, and
        numbers that are not finite, are rejected. A cell with a decimal comma is always rejected.
        In a Parquet file a column of another type than numbers becomes NaN with ``gaps``; without
        it, it is one of ``texts``. Equal titles are always rejected there.
    assumed : sequence of str
        Names of the columns of a text file that has no header and as many columns.

    Returns
    -------
    TextTable

    Raises
    ------
    FormatError
        If the file cannot be read, or is not a table of numbers.
    """
    if path.suffix.lower() == ".parquet":
        return _read_parquet(path, most, gaps)
    return parse_table(read_text(path, most), names, gaps, assumed)


def parse_table(
    text: str,
    names: list[str] | None = None,
    gaps: bool = False,
    assumed: Sequence[str] = (),
) -> TextTable:
    """Read a table of numbers from a text.

    Lines that begin with ``#``, ``%``, ``!`` or ``//`` are comments, blank lines are skipped. The
    separator is a semicolon, tab, comma or blanks: the first that the first line of numbers has.
    The last line of text before it is the header; if that consists of units, the header is the line
    above it with these units. Without such a line, the last comment before the numbers that has as
    many cells is the header.

    Parameters
    ----------
    text : str
    names, gaps, assumed : see `read_table`

    Returns
    -------
    TextTable

    Raises
    ------
    FormatError
        If the text is not a table of numbers, or has no header and the caller gives no names.
    """
    comments, lines, before = list[str](), list[tuple[int, str]](), 0
    for number, line in enumerate(text.splitlines(), 1):
        stripped = line.strip(" \r\n\ufeff")
        if stripped.startswith(_COMMENTS):
            comments.append(stripped.lstrip("#%!/ "))
            before += not lines
        elif stripped.strip("\t;,"):
            lines.append((number, stripped))
    if not lines:
        raise FormatError("has no rows")
    separator, first = _first_row(lines, gaps, comments[:before])
    rows = [(number, _cells(line, separator)) for number, line in lines[first:]]
    header, kind = names or _header(lines[:first], separator), "line"
    if not header:
        kind = "comment"
        titles = [_cells(comment, separator) for comment in comments[:before]]
        header = next((each for each in titles[::-1] if len(each) == len(rows[0][1])), [])
    if not header and len(rows[0][1]) == len(assumed):
        header, kind = list(assumed), "assumed"
    if not header:
        raise FormatError(
            f"line {rows[0][0]}: has no header; give the names of its {len(rows[0][1])} columns, "
            'with units: columns = ["NAME_UNIT", ...]'
        )
    columns = _numbers(header, rows, separator, gaps)
    numbers = tuple(number for number, _ in rows)
    return TextTable(columns, tuple(comments), _NAMES[separator], kind, numbers)


def _first_row(lines: list[tuple[int, str]], gaps: bool, comments: list[str]) -> tuple[str, int]:
    """Find the separator and the index in ``lines`` (line number, text) of the first row of
    numbers. With ``gaps`` a row may have blank cells or, below a header of as many cells, any cells
    of which at least one is a number; that header may be the last of the ``comments``, which stand
    before the lines. Raises FormatError if there is no row, or it has a decimal comma."""
    for index, (line_number, line) in enumerate(lines):
        for separator in _SEPARATORS:
            cells = [cell for cell in _cells(line, separator) if cell]
            if len(cells) < 2 or not all(map(_is_number_or_comma, cells)):
                continue
            comma = next((cell for cell in cells if not _is_number(cell)), None)
            if comma is not None:
                raise FormatError(
                    f"line {line_number}: {comma} has a decimal comma; write it with a point, "
                    f"{comma.replace(',', '.')}"
                )
            while gaps and index and _is_row_with_gaps(lines[index - 1][1], separator, line):
                index -= 1
            return separator, index
    above_first = [(0, comments[-1])] if comments else []
    first = 1 - len(above_first)
    pairs = pairwise([*above_first, *lines]) if gaps else ()
    for index, ((_, above), (_, line)) in enumerate(pairs, first):
        for separator in _SEPARATORS:
            header, cells = _cells(above, separator), _cells(line, separator)
            is_header = len(header) == len(cells) > 1 and not any(map(_is_number, header))
            if is_header and any(map(_is_number, cells)):
                return separator, index
    line_number, line = lines[min(1, len(lines) - 1)]
    raise FormatError(
        f"line {line_number}: is no line of numbers, such as 0.1, 25.0: {shorten(line)}"
    )


def _is_row_with_gaps(line: str, separator: str, row: str) -> bool:
    """True if a line has as many cells as ``row``, a line of numbers, and at least one of its cells
    is blank and all others are numbers."""
    cells = _cells(line, separator)
    known = [cell for cell in cells if cell]
    return len(known) < len(cells) == len(_cells(row, separator)) and all(map(_is_number, known))


def _is_number_or_comma(cell: str) -> bool:
    return _is_number(cell) or _DECIMAL_COMMA.fullmatch(cell) is not None


def _cells(line: str, separator: str) -> list[str]:
    if separator == " ":
        return line.split()
    return [cell.strip().strip("\"'").strip() for cell in line.split(separator)]


def _is_number(cell: str) -> bool:
    return _NUMBER.fullmatch(cell) is not None


def number(cell: str) -> float:
    """Convert the text of a cell to a number; an exponent may begin with d or D, as Fortran writes
    it. "nan" and "inf" give NaN and infinity. Raises ValueError for other text."""
    return float(cell.lower().replace("d", "e"))


def _header(lines: list[tuple[int, str]], separator: str) -> list[str]:
    """Names of the columns from the lines (line number, text) before the numbers: the cells of the
    last line or, if those are all units, of the line above with these units as ``name (unit)``, if
    it has as many cells. Empty without lines."""
    if not lines:
        return []
    cells = _cells(lines[-1][1], separator)
    if len(lines) > 1 and all(_is_unit(cell) for cell in cells) and any(cells):
        above = _cells(lines[-2][1], separator)
        if len(above) == len(cells):
            return [f"{a} ({u.strip('()[]')})" if u else a for a, u in zip(above, cells)]  # noqa: B905
    return cells


_UNITS = re.compile(r"[(\[]?(-|1|[A-Za-z°%]{1,4}([/_^*. ]?[A-Za-z]{1,4})?[23²³]?)[)\]]?")
_NO_UNITS = frozenset(["time", "mach", "ca", "cn", "cy", "cm", "cl", "cd", "cll", "cln", "alt"])


def _is_unit(cell: str) -> bool:
    bare = cell.strip("()[]").lower()
    return not cell or (_UNITS.fullmatch(cell) is not None and bare not in _NO_UNITS)


def _numbers(
    header: list[str], rows: list[tuple[int, list[str]]], separator: str, gaps: bool
) -> dict[str, np.ndarray]:
    """Convert the cells of ``rows`` (line number, cells) to columns (n,) by the names of
    ``header``; columns with a blank name are left out. With ``gaps``, as in `read_table`, blank
    cells and text become NaN. Raises FormatError for a name that occurs twice (with ``gaps`` it
    gets a number instead), a wrong number of cells (blank ones beyond the header do not count), a
    decimal comma and, without ``gaps``, any cell that is not a finite number. ``separator`` is only
    named in messages."""
    header = [name.translate(_INVISIBLE) for name in header]
    while header and not header[-1] and all(len(row) < len(header) or not row[len(header) - 1]
                                            for _, row in rows):  # fmt: skip
        header = header[:-1]  # a separator at the end of each line
    header = _numbered(header) if gaps else header
    _check_names(header)
    values = np.empty((len(rows), len(header)))
    for k, (line, row) in enumerate(rows):
        cells = row[: len(header)] if not any(row[len(header) :]) else row
        if len(cells) != len(header):
            raise FormatError(
                f"line {line}: has {len(cells)} values, the header {len(header)} "
                f"({_NAMES[separator]} between them)"
            )
        for i, cell in enumerate(cells):
            if not cell and gaps:
                values[k, i] = np.nan
                continue
            if not cell:
                raise FormatError(f"line {line}: column {header[i] or i + 1} is blank")
            if not _is_number(cell):
                is_comma = _DECIMAL_COMMA.fullmatch(cell) is not None
                if gaps and not is_comma:
                    values[k, i] = np.nan
                    continue
                reason = "has a decimal comma" if is_comma else "is no number"
                raise FormatError(f"line {line}: {shorten(cell)} {reason}")
            values[k, i] = number(cell)
            if not (gaps or np.isfinite(values[k, i])):
                raise FormatError(f"line {line}: {shorten(cell)} is not finite")
    return {name: values[:, i] for i, name in enumerate(header) if name}


_MARK = re.compile(r" #\d+(?=\s*[(\[]|$)")


def _numbered(names: list[str]) -> list[str]:
    """Copy of the titles in which those that occur several times have a number from 1, before a
    unit in brackets: ``height #1 (m)``."""
    counts, seen = Counter(name for name in names if name), Counter[str]()
    result = []
    for name in names:
        seen[name] += 1
        match = re.fullmatch(r"(.*?)(\s*[(\[][^()\[\]]*[)\]])?", name)
        assert match is not None
        many = counts[name] > 1
        result.append(f"{match[1]} #{seen[name]}{match[2] or ''}" if many else name)
    return result


def without_number(title: str) -> str:
    """Title as it stands in the file, of one that `read_table` may have numbered."""
    return _MARK.sub("", title)


def _check_names(names: Sequence[str]) -> None:
    """Raise FormatError if a name occurs twice or has characters that cannot be printed. Blank
    names are allowed."""
    for name, count in Counter(name for name in names if name).items():
        if count > 1:
            raise FormatError(f"has the column {shorten(name)} twice")
        if printable(name) != name:
            raise FormatError(
                "has a column whose name has characters that cannot be printed: "
                f"{printable(name, 60)}"
            )


def _read_parquet(path: Path, most: int, gaps: bool) -> TextTable:
    import pyarrow as pa  # noqa: PLC0415  (that text files do not need)
    import pyarrow.parquet as pq  # noqa: PLC0415

    read_bytes(path, most)
    try:
        with pq.ParquetFile(path) as file:
            groups, metadata = file.metadata.num_row_groups, file.metadata
            rows = sum(metadata.row_group(k).num_rows for k in range(groups))
            if max(rows, metadata.num_rows) * max(1, metadata.num_columns) > most // 4:
                raise FormatError(
                    f"has {rows:,} rows of {metadata.num_columns:,} columns; must have at most "
                    f"{most // 4:,} numbers"
                )
            table = file.read()
    except (OSError, ValueError, pa.ArrowException) as error:
        reason = printable(str(error).partition("\n")[0])
        raise FormatError(f"cannot be read as Parquet: {reason}") from None
    if not table.num_rows:
        raise FormatError("has no rows")
    _check_names(table.column_names)
    columns, texts = {}, []
    for name, column in zip(table.column_names, table.columns, strict=True):
        if not (pa.types.is_floating(column.type) or pa.types.is_integer(column.type)):
            if gaps:
                columns[name] = np.full(len(column), np.nan)
            else:
                texts.append(name)
            continue
        values = np.asarray(column.cast(pa.float64(), safe=False).to_numpy(), dtype=float)
        if not (gaps or np.isfinite(values).all()):
            row = int(np.argmin(np.isfinite(values)))
            where = TextTable({}).where(row)
            raise FormatError(f"{where}: column {shorten(name)} has no finite number")
        columns[name] = values
    return TextTable(columns, (), "Parquet", texts=tuple(texts))
