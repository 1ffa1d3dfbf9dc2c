"""Parsing of CCSDS messages to segments of metadata and rows: orbit ephemerides (OEM, 502.0-B) and
attitude ephemerides (AEM, 504.0-B), in keyword = value notation and in XML (505.0-B)."""

import math
import re
from dataclasses import dataclass, field
from datetime import date

from sepmc.formats.text_table import FormatError, number
from sepmc.formats.xml_tree import Element, parse_xml
from sepmc.scene.messages import shorten

_EPOCH = re.compile(r"(\d{4})-(\d{2})-(\d{2})T(\d{2}):(\d{2}):(\d{2}(?:\.\d*)?)Z?")
_DAY = re.compile(r"(\d{4})-(\d{3})T(\d{2}):(\d{2}):(\d{2}(?:\.\d*)?)Z?")
_TIME = {"EPOCH": ""}
_STATE = dict.fromkeys(("X", "Y", "Z"), "km") | dict.fromkeys(("X_DOT", "Y_DOT", "Z_DOT"), "km/s")
_QUATERNION = dict.fromkeys(("Q1", "Q2", "Q3", "QC"), "")  # in the order of QUATERNION_TYPE = LAST
_ANGLES = dict.fromkeys(("ANGLE_1", "ANGLE_2", "ANGLE_3"), "deg")
_ROTATIONS = dict.fromkeys(("rotation1", "rotation2", "rotation3"), "deg")  # of version 1
_LETTERS = {"1": "X", "2": "Y", "3": "Z"}


@dataclass
class Segment:
    """Segment of a CCSDS message: metadata, and rows of numbers over time.

    Attributes
    ----------
    metadata : dict of str to str
        Values by keyword.
    line : int
        Line number of the file at which the segment begins.
    epochs : list of float
        Time of each row, s since year 1 (`seconds_of`), rising.
    rows : list of list of float
        Numbers of each row, in the order and units of the file.
    first, last : str
        Epochs of the first and the last row as the file writes them.
    """

    metadata: dict[str, str] = field(default_factory=dict)
    line: int = 0
    epochs: list[float] = field(default_factory=list)
    rows: list[list[float]] = field(default_factory=list)
    first: str = ""
    last: str = ""


def seconds_of(text: str) -> float | None:
    """Convert the text of an epoch to seconds since year 1 in its own time system, without leap
    seconds.

    Parameters
    ----------
    text : str
        ``2026-03-01T12:00:41.5``, or with the day of the year ``2026-060T12:00:41.5``; a Z may
        follow. Hour 24 and second 60 (a leap second) are allowed.

    Returns
    -------
    float or None
        None if the text is no epoch.
    """
    try:
        if match := _EPOCH.fullmatch(text):
            day = date(int(match[1]), int(match[2]), int(match[3])).toordinal()
            clock = match.groups()[3:]
        elif match := _DAY.fullmatch(text):
            day = date(int(match[1]), 1, 1).toordinal() + int(match[2]) - 1
            clock = match.groups()[2:]
            if date.fromordinal(day).year != int(match[1]):
                return None
        else:
            return None
    except ValueError:
        return None
    hours, minutes, seconds = int(clock[0]), int(clock[1]), float(clock[2])
    if hours > 24 or minutes > 59 or seconds >= 61.0 or (hours == 24 and minutes + seconds > 0.0):
        return None
    return day * 86400.0 + hours * 3600.0 + minutes * 60.0 + seconds


def parse_message(text: str, kind: str) -> tuple[str, list[Segment]]:
    """Parse a CCSDS message.

    Parameters
    ----------
    text : str
        Text in keyword = value notation, or in XML, which begins with ``<``.
    kind : {"OEM", "AEM"}
        Kind of message that is expected.

    Returns
    -------
    version : str
        Version of the format, as the message gives it.
    segments : list of Segment
        The segments that have rows. Accelerations of an OEM and covariances are left out.

    Raises
    ------
    FormatError
        If the text is no message of this kind, or has no rows.
    """
    parse = _parse_xml if text.lstrip().startswith("<") else _parse_text
    version, segments = parse(text, kind)
    if not any(segment.rows for segment in segments):
        raise FormatError("has no segment with rows, each of an epoch and numbers")
    return version, [segment for segment in segments if segment.rows]


def _parse_text(text: str, kind: str) -> tuple[str, list[Segment]]:
    """Parse a message in keyword = value notation to its version and segments, also those without
    rows; ``kind`` is "OEM" or "AEM". Raises FormatError if it does not begin with the version of
    this kind, or a row is not valid."""
    version, segments = "", list[Segment]()
    where = "header"
    for n, raw in enumerate(text.splitlines(), 1):
        line = raw.strip("\ufeff \t")
        if not line or line.startswith("COMMENT"):
            continue
        keyword, equal, value = (part.strip() for part in line.partition("="))
        if not version:
            if keyword != f"CCSDS_{kind}_VERS" or not value:
                raise FormatError(f"line {n}: begins with {shorten(line)}, not CCSDS_{kind}_VERS =")
            version = value
        elif line == "META_START":
            segments.append(Segment(line=n))
            where = "metadata"
        elif line == "META_STOP":
            where = "data"
        elif line in ("DATA_START", "DATA_STOP"):
            where = "data" if segments else where
        elif line.startswith("COVARIANCE_"):
            where = "data" if line == "COVARIANCE_STOP" else "covariance"
        elif equal and where == "metadata":
            segments[-1].metadata[keyword] = value
        elif where == "data" and segments and not equal:
            _add_row(segments[-1], line.split(), n, kind)
        elif where not in ("covariance", "header"):
            raise FormatError(f"line {n}: {shorten(line)} is no row of numbers")
    if not version:
        raise FormatError("has no rows")
    return version, segments


def _parse_xml(text: str, kind: str) -> tuple[str, list[Segment]]:
    """Parse a message in XML, which may be the only one of its ``kind`` ("OEM" or "AEM") in an
    ``ndm``, to its version and segments, also those without rows. Raises FormatError if it is not
    XML, there is not exactly one, it has no version, or a state is not valid."""
    root, tag = parse_xml(text), kind.lower()
    messages = [root] if root.tag == tag else [x for x in root.children if x.tag == tag]
    if len(messages) != 1:
        many = "no message" if not messages else f"{len(messages)} messages"
        raise FormatError(f"line {root.line}: <{root.tag}> has {many} <{tag}>; must have one")
    version, segments = messages[0].attributes.get("version", ""), list[Segment]()
    if not version:
        raise FormatError(f"line {messages[0].line}: <{tag}> has no version")
    for element in messages[0].all("segment"):
        segment = Segment(line=element.line)
        metadata, data = element.child("metadata"), element.child("data")
        for each in metadata.children if metadata else ():
            segment.metadata[each.tag] = each.text.strip()
        segments.append(segment)
        for state in data.children if data else ():
            if state.tag == "stateVector" and kind == "OEM":
                numbers = _cells(state, _STATE)
            elif state.tag == "attitudeState" and kind == "AEM":
                numbers = _attitude_cells(state, segment)
            else:
                continue
            _add_row(segment, _cells(state, _TIME) + numbers, state.line, kind)
    return version, segments


def _cells(state: Element, units: dict[str, str]) -> list[str]:
    """Texts of the elements of a state whose tags are the keys of ``units``, in that order. Raises
    FormatError if one is missing or there twice, or states another unit than that of ``units``
    (one that states none has that unit)."""
    cells = []
    for tag, unit in units.items():
        elements = list(state.all(tag))
        if len(elements) != 1:
            count = f"{len(elements)} elements" if elements else "no"
            raise FormatError(
                f"line {state.line}: <{state.tag}> has {count} <{tag}>, must have one"
            )
        element = elements[0]
        own = element.attributes.get("units", unit)
        if unit and own.lower() != unit:
            raise FormatError(f"line {element.line}: <{tag}> is in {shorten(own)}; must be {unit}")
        cells.append("".join(element.text.split()))
    return cells


def _attitude_cells(state: Element, segment: Segment) -> list[str]:
    """Texts of the numbers of an attitude, an element ``state`` of XML: of a quaternion with the
    scalar part last, which is also written into the metadata of ``segment``, or of Euler angles in
    the order of EULER_ROT_SEQ. Raises FormatError if it is of another type, a number is missing, or
    the angles are not in that order."""
    kind = segment.metadata.get("ATTITUDE_TYPE", "").upper()
    if kind.startswith("QUATERNION"):
        segment.metadata["QUATERNION_TYPE"] = "LAST"
        return _cells(state, _QUATERNION)
    if not kind.startswith("EULER_ANGLE"):
        raise FormatError(
            f"segment at line {segment.line}: "
            f"ATTITUDE_TYPE is {shorten(kind)}; must be QUATERNION or "
            "EULER_ANGLE"
        )
    rotations = next(state.all("rotationAngles"), None)
    state, tags = (state, _ANGLES) if rotations is None else (rotations, _ROTATIONS)
    sequence = segment.metadata.get("EULER_ROT_SEQ", "").upper()
    for tag, letter in zip(tags, sequence, strict=False):
        element = next(state.all(tag), None)
        angle = element.attributes.get("angle", "") if element else ""
        if angle and angle[0].upper() != _LETTERS.get(letter, letter):
            raise FormatError(
                f"line {state.line}: <{tag}> has angle = {shorten(angle)}, but EULER_ROT_SEQ is "
                f"{sequence}; both must give the same axis"
            )
    return _cells(state, tags)


def _add_row(segment: Segment, cells: list[str], n: int, kind: str) -> None:
    """Convert the texts of a row, epoch and numbers, and add them to a segment, without the
    acceleration of an OEM; a row equal to the one before it is left out. ``n`` is the line number,
    ``kind`` "OEM" or "AEM". Raises FormatError if the row is not valid, or its epoch is not after
    that of the row above."""
    line = " ".join(cells)
    epoch = seconds_of(cells[0])
    if epoch is None:
        raise FormatError(
            f"line {n}: {shorten(cells[0])} is no epoch, such as 2026-03-01T12:00:41.5"
        )
    try:
        row = [number(cell) for cell in cells[1:]]
    except ValueError:
        raise FormatError(f"line {n}: {shorten(line)} is no row of numbers") from None
    if not all(map(math.isfinite, row)):
        raise FormatError(f"line {n}: {shorten(line)} has a number that is not finite")
    if kind == "OEM":
        if len(row) not in (6, 9):
            raise FormatError(
                f"line {n}: has {len(row)} numbers; must be position and velocity, and an "
                "acceleration or none"
            )
        row = row[:6]
    if segment.rows and len(row) != len(segment.rows[0]):
        raise FormatError(f"line {n}: has {len(row)} numbers, the row above {len(segment.rows[0])}")
    if segment.epochs and epoch == segment.epochs[-1] and row == segment.rows[-1]:
        return  # a row twice
    if segment.epochs and epoch <= segment.epochs[-1]:
        raise FormatError(f"line {n}: the epoch {cells[0]} is not after that of the row above")
    segment.first, segment.last = segment.first or cells[0], cells[0]
    segment.epochs.append(epoch)
    segment.rows.append(row)
