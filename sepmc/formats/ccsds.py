"""Initial states from trajectories of CCSDS: orbit ephemeris (OEM, 502.0-B) and attitude ephemeris
(AEM, 504.0-B) in keyword = value notation."""

import math
import re
from dataclasses import dataclass, field
from datetime import date, datetime
from pathlib import Path
from typing import Any

import numpy as np
from scipy.interpolate import CubicHermiteSpline
from scipy.spatial.transform import Rotation

from sepmc.formats.text_table import FormatError, number, read_text
from sepmc.scene.brought_inertia import axes_matrix
from sepmc.scene.messages import Problems, shorten

# WGS 84: equatorial radius, m, flattening, and rate of the Earth, rad/s
_RADIUS, _FLATTENING, _EARTH_RATE = 6378137.0, 1.0 / 298.257223563, 7.292115e-5
_INERTIAL = ("EME2000", "J2000", "GCRF", "ICRF", "TOD", "TEME", "MOD")
# frames whose axes agree to 0.1 arc seconds
_SAME = {"J2000": "EME2000", "GCRF": "EME2000", "ICRF": "EME2000"}
_EPOCH = re.compile(r"(\d{4})-(\d{2})-(\d{2})T(\d{2}):(\d{2}):(\d{2}(?:\.\d*)?)Z?")
_DAY = re.compile(r"(\d{4})-(\d{3})T(\d{2}):(\d{2}):(\d{2}(?:\.\d*)?)Z?")
_DISAGREEMENT = 0.1  # of positions and velocities, relative; 10 min of a low orbit have 0.04
_LEVEL = 1e-3  # horizontal part of a velocity below which it has no azimuth
_EULER = {"1": "X", "2": "Y", "3": "Z", "X": "X", "Y": "Y", "Z": "Z"}


@dataclass
class Segment:
    """A segment of a message.

    Attributes
    ----------
    metadata : dict of str to str
    line : int
        At which it begins.
    epochs : list of float
        s since year 1.
    rows : list of list of float
    """

    metadata: dict[str, str] = field(default_factory=dict)
    line: int = 0
    epochs: list[float] = field(default_factory=list)
    rows: list[list[float]] = field(default_factory=list)


def seconds_of(text: str) -> float | None:
    """Time of an epoch, s since year 1 of its own time system; None if it is no epoch.

    Parameters
    ----------
    text : str
        ``2026-03-01T12:00:41.5``, or with the day of the year ``2026-060T12:00:41.5``.

    Returns
    -------
    float or None
    """
    try:
        if match := _EPOCH.fullmatch(text):
            day = date(int(match[1]), int(match[2]), int(match[3])).toordinal()
            clock = match.groups()[3:]
        elif match := _DAY.fullmatch(text):
            day = date(int(match[1]), 1, 1).toordinal() + int(match[2]) - 1
            clock = match.groups()[2:]
        else:
            return None
    except ValueError:
        return None
    hours, minutes, seconds = int(clock[0]), int(clock[1]), float(clock[2])
    if hours > 24 or minutes > 59 or seconds >= 61.0:
        return None
    return day * 86400.0 + hours * 3600.0 + minutes * 60.0 + seconds


def parse_message(text: str, kind: str) -> tuple[str, list[Segment]]:
    """Read a message in keyword = value notation.

    Parameters
    ----------
    text : str
    kind : {"OEM", "AEM"}

    Returns
    -------
    version : str
    segments : list of Segment
        Rows as they stand, of an OEM without accelerations; covariances are left out.

    Raises
    ------
    FormatError
    """
    version, segments = "", list[Segment]()
    where = "header"
    for n, raw in enumerate(text.splitlines(), 1):
        line = raw.strip("\ufeff \t")
        if not line or line.startswith("COMMENT"):
            continue
        if not version and line.startswith("<"):
            raise FormatError("is XML; write it in keyword = value notation (KVN)")
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
            _add_row(segments[-1], line, n, kind)
        elif where not in ("covariance", "header"):
            raise FormatError(f"line {n}: {shorten(line)} is no row of numbers")
    if not version:
        raise FormatError("has no rows")
    if not any(segment.rows for segment in segments):
        raise FormatError("has no segment with rows: META_START, META_STOP, epochs and numbers")
    return version, [segment for segment in segments if segment.rows]


def _add_row(segment: Segment, line: str, n: int, kind: str) -> None:
    cells = line.split()
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
    segment.epochs.append(epoch)
    segment.rows.append(row)


def _segment_at(segments: list[Segment], epoch: float, text: str) -> Segment:
    """The segment that contains an epoch; raises FormatError, with ``text`` as the epoch, if none
    does."""
    for segment in segments:
        if segment.epochs[0] <= epoch <= segment.epochs[-1]:
            return segment
    first, last = segments[0].epochs[0], segments[-1].epochs[-1]
    raise FormatError(
        f"has no rows about the epoch {text}: {first - epoch:+.6g} to {last - epoch:+.6g} s from it"
    )


def read_initial(path: Path, options: dict[str, Any]) -> tuple[dict[str, Any], list[str]]:
    """Initial state of the mated vehicle from a trajectory.

    Parameters
    ----------
    path : Path
        An OEM.
    options : dict
        ``epoch``: of the start, needed if there are several rows. ``attitude``: table with
        ``file``, the path of an AEM, and ``axes``, the directions of its body axes, such as
        "forward-right-down". ``azimuth_deg``: compass direction of ground x; by default that of
        the velocity.

    Returns
    -------
    keys : dict
        Keys of ``[initial]`` and their values.
    understood : list of str
        Sentences on what was read, for the user.

    Raises
    ------
    FormatError
        With the reason why the file is refused.
    """
    _, segments = parse_message(read_text(path), "OEM")
    epoch, text = _epoch(options.get("epoch"), segments)
    segment = _segment_at(segments, epoch, text)
    frame, rate = _frame(segment)
    position, velocity = _state(segment, epoch)
    up, east, altitude = _vertical(position)
    relative = velocity - np.cross([0.0, 0.0, rate], position)
    north = np.cross(up, east)
    level = relative - up * (relative @ up)
    speed = float(np.linalg.norm(relative))
    azimuth = options.get("azimuth_deg")
    if azimuth is None:
        if np.linalg.norm(level) <= _LEVEL * speed:
            raise FormatError("the velocity is vertical: give azimuth_deg, of ground x")
        azimuth = math.degrees(math.atan2(level @ east, level @ north)) % 360.0
    elif isinstance(azimuth, bool) or not isinstance(azimuth, int | float):
        raise FormatError(f"azimuth_deg = {shorten(azimuth)}: must be a number")
    forward = math.sin(math.radians(azimuth)) * east + math.cos(math.radians(azimuth)) * north
    ground = np.array([forward, up, np.cross(forward, up)])
    along, rise, right = ground @ relative
    path_pitch = math.degrees(math.atan2(rise, along))
    # 0 by the choice of ground x
    if options.get("azimuth_deg") is None:
        right = 0.0
    path_yaw = -math.degrees(math.asin(max(-1.0, min(1.0, right / speed)))) if speed else 0.0
    understood = [
        f"state of {segment.metadata.get('OBJECT_NAME', 'the object')} at {text} in {frame}: "
        f"altitude above WGS 84, speed relative to the Earth"
        + (", which turns about z of the frame" if rate else ""),
        f"ground x to azimuth {azimuth:.6g} deg; path_pitch {path_pitch:.6g} deg",
    ]
    keys: dict[str, Any] = {
        "altitude_m": float(altitude),
        "speed_m_s": speed,
        "path_yaw_deg": float(path_yaw) + 0.0,
    }
    if options.get("attitude") is None:
        keys["pitch_deg"] = path_pitch
        understood.append("no attitude: pitch is that of the path, alpha 0")
        return keys, understood
    matrix, omega, sentences = _attitude(options["attitude"], epoch, text, frame)
    own = ground @ matrix
    pitch = math.degrees(math.atan2(own[1, 0], own[0, 0]))
    keys |= {
        "pitch_deg": pitch,
        "yaw_deg": -math.degrees(math.asin(max(-1.0, min(1.0, own[2, 0])))) + 0.0,
        "roll_deg": math.degrees(math.atan2(own[2, 1], own[2, 2])),
        "alpha_deg": (pitch - path_pitch + 180.0) % 360.0 - 180.0,
        "omega_deg_s": [math.degrees(x) for x in omega],
    }
    return keys, understood + sentences


def _epoch(given: Any, segments: list[Segment]) -> tuple[float, str]:
    if given is None:
        if sum(len(segment.rows) for segment in segments) > 1:
            raise FormatError('has several rows; choose by epoch = "2026-03-01T12:00:41.5"')
        return segments[0].epochs[0], "its only epoch"
    given = given.isoformat() if isinstance(given, datetime) else given  # a date of TOML
    epoch = seconds_of(given) if isinstance(given, str) else None
    if epoch is None:
        raise FormatError(f"epoch = {shorten(given)}: must be such as 2026-03-01T12:00:41.5")
    return epoch, given


def _frame(segment: Segment) -> tuple[str, float]:
    """Reference frame of an OEM, and the rate of the Earth in it, rad/s."""
    center = segment.metadata.get("CENTER_NAME", "").upper()
    if center != "EARTH":
        raise FormatError(f"line {segment.line}: CENTER_NAME is {shorten(center)}; must be EARTH")
    frame = segment.metadata.get("REF_FRAME", "").upper()
    if frame in _INERTIAL:
        return frame, _EARTH_RATE
    if frame.startswith("ITRF") or frame in ("TDR", "GRC", "ECEF"):
        return frame, 0.0
    raise FormatError(
        f"line {segment.line}: REF_FRAME is {shorten(frame)}; must be {', '.join(_INERTIAL)}, "
        "ITRF..., TDR or GRC"
    )


def _state(segment: Segment, epoch: float) -> tuple[np.ndarray, np.ndarray]:
    """Position, m, and velocity, m/s, at an epoch: cubic through states and velocities."""
    rows = np.array(segment.rows)
    times = np.array(segment.epochs) - segment.epochs[0]
    positions, velocities = 1e3 * rows[:, :3], 1e3 * rows[:, 3:6]
    exact = np.flatnonzero(times == epoch - segment.epochs[0])
    if len(exact):
        position, velocity = positions[exact[0]], velocities[exact[0]]
    else:
        k = int(np.clip(np.searchsorted(times, epoch - segment.epochs[0]) - 1, 0, len(times) - 2))
        pair = slice(k, k + 2)
        chord = np.diff(positions[pair], axis=0)[0] / (times[k + 1] - times[k])
        mean = velocities[pair].mean(axis=0)
        if np.linalg.norm(chord - mean) > _DISAGREEMENT * np.linalg.norm(mean):
            raise FormatError(
                f"line {segment.line}: about the epoch, positions change by "
                f"{np.linalg.norm(chord) / 1e3:.6g} km/s where velocities are "
                f"{np.linalg.norm(mean) / 1e3:.6g} km/s; are rows missing?"
            )
        curve = CubicHermiteSpline(times[pair], positions[pair], velocities[pair])
        at = epoch - segment.epochs[0]
        position, velocity = curve(at), curve(at, 1)
    distance = float(np.linalg.norm(position))
    if not 0.9 * _RADIUS < distance < 100.0 * _RADIUS:
        raise FormatError(
            f"line {segment.line}: a distance of {distance / 1e3:.6g} km from the centre of the "
            "Earth; positions are in km"
        )
    return position, velocity


def _vertical(position: np.ndarray) -> tuple[np.ndarray, np.ndarray, float]:
    """Unit vectors up (normal of WGS 84) and east, and the height above WGS 84, m."""
    x, y, z = position
    radius = math.hypot(x, y)
    if radius < 1.0:
        raise FormatError("lies above a pole, where there is no east")
    squared = _FLATTENING * (2.0 - _FLATTENING)
    latitude, height = math.atan2(z, radius * (1.0 - squared)), 0.0
    for _ in range(10):
        across = _RADIUS / math.sqrt(1.0 - squared * math.sin(latitude) ** 2)
        latitude = math.atan2(z + squared * across * math.sin(latitude), radius)
    across = _RADIUS / math.sqrt(1.0 - squared * math.sin(latitude) ** 2)
    # radius cos + (z + e2 N sin) sin - N: without division near the poles
    height = (
        radius * math.cos(latitude)
        + (z + squared * across * math.sin(latitude)) * math.sin(latitude)
        - across
    )
    longitude = math.atan2(y, x)
    up = np.array(
        [
            math.cos(latitude) * math.cos(longitude),
            math.cos(latitude) * math.sin(longitude),
            math.sin(latitude),
        ]
    )
    return up, np.array([-math.sin(longitude), math.cos(longitude), 0.0]), height


def _attitude(
    attitude: Any, epoch: float, text: str, frame: str
) -> tuple[np.ndarray, np.ndarray, list[str]]:
    """Matrix (3, 3) from body axes (forward, up, right) to the frame of the trajectory at an epoch,
    angular rate (3,) in body axes, rad/s, and sentences."""
    if not isinstance(attitude, dict) or not isinstance(attitude.get("file"), str):
        raise FormatError('the attitude must be a table: { file = "NAME.aem", axes = "..." }')
    if unknown := [key for key in attitude if key not in ("file", "axes")]:
        raise FormatError(f"attitude.{unknown[0]}: unknown key; allowed: file, axes")
    path = Path(attitude["file"])
    name = path.name
    problems = Problems()
    matrix = axes_matrix("axes", attitude.get("axes"), problems)
    if matrix is None:
        raise FormatError(f"the attitude needs {problems[0]}")
    try:
        version, segments = parse_message(read_text(path), "AEM")
        segment = _segment_at(segments, epoch, text)
        is_from_body = _direction(segment, version, frame)
        rotations, how = _rotations(segment, version)
    except FormatError as error:
        raise FormatError(f"{name}: {error}") from None
    if is_from_body:
        rotations = rotations.inv()
    times = np.array(segment.epochs) - epoch
    if len(times) == 1:
        rotation, rate = rotations[0], np.zeros(3)
        rates = "rates 0, as there is one row"
    else:
        k = int(np.clip(np.searchsorted(times, 0.0) - 1, 0, len(times) - 2))
        turn = (rotations[k].inv() * rotations[k + 1]).as_rotvec()
        rate = turn / (times[k + 1] - times[k])
        rotation = rotations[k] * Rotation.from_rotvec(-times[k] * rate)
        rates = "rates by the difference of two rows"
    sentence = f"attitude by {name}: {how}; body axes {attitude['axes']}; {rates}"
    return rotation.as_matrix() @ matrix, matrix.T @ rate, [sentence]


def _direction(segment: Segment, version: str, frame: str) -> bool:
    """True if rotations are from the body to the frame of the trajectory."""
    frames = [segment.metadata.get(f"REF_FRAME_{x}", "").upper() for x in "AB"]
    bodies = [each.startswith(("SC_BODY", "SC BODY", "ACTUATOR", "INSTRUMENT")) for each in frames]
    others = [_SAME.get(each, each) for each, is_body in zip(frames, bodies, strict=True)
              if not is_body]  # fmt: skip
    if sum(bodies) != 1 or others != [_SAME.get(frame, frame)]:
        raise FormatError(
            f"line {segment.line}: is of {frames[0]} and {frames[1]}; must be of SC_BODY and the "
            f"frame of the trajectory, {frame}"
        )
    direction = segment.metadata.get("ATTITUDE_DIR", "A2B" if version[0] != "1" else "").upper()
    if direction not in ("A2B", "B2A"):
        raise FormatError(f"line {segment.line}: ATTITUDE_DIR is missing; must be A2B or B2A")
    return bodies[0] == (direction == "A2B")


def _rotations(segment: Segment, version: str) -> tuple[Rotation, str]:
    """Rotations that take components in frame B to components in frame A, one for each row, and a
    text on how they are written.

    CCSDS turns frames: its rotation from A to B takes components in A to components in B, the
    inverse of the rotation of the axes, which is returned.
    """
    rows = np.array(segment.rows)
    kind = segment.metadata.get("ATTITUDE_TYPE", "").upper()
    if kind.startswith("QUATERNION"):
        order = segment.metadata.get("QUATERNION_TYPE", "LAST" if version[0] != "1" else "").upper()
        if order not in ("FIRST", "LAST"):
            raise FormatError(
                f"line {segment.line}: QUATERNION_TYPE is missing; must be FIRST or LAST, where "
                "the scalar part stands"
            )
        if rows.shape[1] < 4:
            raise FormatError(f"line {segment.line}: has rows of {rows.shape[1]} numbers, not 4")
        quaternions = rows[:, :4]
        norms = np.linalg.norm(quaternions, axis=1)
        if np.abs(norms - 1.0).max() > 1e-3:
            raise FormatError(f"line {segment.line}: has a quaternion of length {norms.max():.6g}")
        if order == "FIRST":
            quaternions = np.roll(quaternions, -1, axis=1)
        return Rotation.from_quat(quaternions), f"quaternions, scalar part {order.lower()}"
    if kind.startswith("EULER_ANGLE") and rows.shape[1] >= 3:
        sequence = segment.metadata.get("EULER_ROT_SEQ", "").upper()
        axes = "".join(_EULER.get(letter, "") for letter in sequence)
        if len(axes) != 3 or len(sequence) != 3 or axes[0] == axes[1] or axes[1] == axes[2]:
            raise FormatError(
                f"line {segment.line}: EULER_ROT_SEQ is {shorten(sequence)}; must be such as 321"
            )
        return (
            Rotation.from_euler(axes, rows[:, :3], degrees=True),
            f"angles in the order of EULER_ROT_SEQ {sequence}",
        )
    raise FormatError(
        f"line {segment.line}: ATTITUDE_TYPE is {shorten(kind)}; must be QUATERNION or EULER_ANGLE"
    )
