"""Reading of the initial state of a flight from CCSDS trajectories: orbit ephemerides (OEM) and
attitude ephemerides (AEM)."""

import math
from datetime import datetime
from pathlib import Path
from typing import Any

import numpy as np
from scipy.interpolate import CubicHermiteSpline
from scipy.spatial.transform import Rotation

from sepmc.formats.ccsds_messages import Segment, parse_message, seconds_of
from sepmc.formats.text_table import FormatError, read_text
from sepmc.scene.brought_inertia import axes_matrix
from sepmc.scene.messages import Problems, shorten
from sepmc.scene.units import is_number

# WGS 84: equatorial radius, m, flattening, and rate of the Earth, rad/s
_RADIUS, _FLATTENING, _EARTH_RATE = 6378137.0, 1.0 / 298.257223563, 7.292115e-5
_INERTIAL = ("EME2000", "J2000", "GCRF", "ICRF", "TOD", "TEME", "MOD")
# frames whose axes agree to 0.1 arc seconds
_SAME = {"J2000": "EME2000", "GCRF": "EME2000", "ICRF": "EME2000"}
_DISAGREEMENT = 0.1  # of positions and velocities, relative; 10 min of a low orbit have 0.04
_LEVEL = 1e-3  # horizontal part of a velocity below which it has no azimuth
_EULER = {"1": "X", "2": "Y", "3": "Z", "X": "X", "Y": "Y", "Z": "Z"}


def _segment_at(segments: list[Segment], epoch: float, text: str) -> Segment:
    """Return the first segment whose first row is not after ``epoch``, s as in `Segment.epochs`,
    and whose last row is not before it. Raises FormatError if there is none; ``text`` is the epoch
    for the message."""
    for segment in segments:
        if segment.epochs[0] <= epoch <= segment.epochs[-1]:
            return segment
    raise FormatError(
        f"has no segment with rows on both sides of the epoch {text}; rows are from "
        f"{segments[0].first} to {segments[-1].last}"
    )


def read_initial(path: Path, options: dict[str, Any]) -> tuple[dict[str, Any], list[str]]:
    """Read the initial state of the mated vehicle from an orbit ephemeris.

    Parameters
    ----------
    path : Path
        File of an OEM.
    options : dict
        ``epoch``: epoch of the start of the flight, needed if the file has several rows; between
        two rows, the cubic through their positions and velocities gives the state.
        ``attitude``: table with ``file``, the path of an AEM, and ``axes``, the directions of its
        body axes, such as "forward-right-down"; without it alpha is 0. ``azimuth_deg``: compass
        direction of ground x; by default that of the velocity relative to the Earth.

    Returns
    -------
    keys : dict
        Keys of ``[initial]`` and their values.
    understood : list of str
        Sentences on what was read, for the user.

    Raises
    ------
    FormatError
        With the reason why the file is rejected.
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
            raise FormatError(
                "the velocity is vertical: give azimuth_deg, the compass direction of ground x"
            )
        azimuth = math.degrees(math.atan2(level @ east, level @ north)) % 360.0
    elif not is_number(azimuth):
        raise FormatError(f"the key azimuth_deg = {shorten(azimuth)}: must be a number")
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
        + (", which rotates about z of the frame" if rate else ""),
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
            first, last = segments[0].first, segments[-1].last
            raise FormatError(
                f"has rows from {first} to {last}; give the start of the flight, such as "
                f'epoch = "{first}"'
            )
        return segments[0].epochs[0], "its only epoch"
    given = given.isoformat() if isinstance(given, datetime) else given  # a date of TOML
    epoch = seconds_of(given) if isinstance(given, str) else None
    if epoch is None:
        raise FormatError(
            f"the key epoch = {shorten(given)}: must be a date and time, such as "
            "2026-03-01T12:00:41.5"
        )
    return epoch, given


def _frame(segment: Segment) -> tuple[str, float]:
    """Name of the reference frame of an OEM's segment, and the rate of rotation of the Earth
    relative to it, rad/s (0 if it is fixed to the Earth). Raises FormatError for other frames and
    bodies."""
    center = segment.metadata.get("CENTER_NAME", "").upper()
    if center != "EARTH":
        raise FormatError(
            f"segment at line {segment.line}: CENTER_NAME is {shorten(center)}; must be EARTH"
        )
    frame = segment.metadata.get("REF_FRAME", "").upper()
    if frame in _INERTIAL:
        return frame, _EARTH_RATE
    if frame.startswith("ITRF") or frame in ("TDR", "GRC", "ECEF"):
        return frame, 0.0
    raise FormatError(
        f"segment at line {segment.line}: "
        f"REF_FRAME is {shorten(frame)}; must be {', '.join(_INERTIAL)}, "
        "ITRF..., TDR or GRC"
    )


def _state(segment: Segment, epoch: float) -> tuple[np.ndarray, np.ndarray]:
    """Position (3,), m, and velocity (3,), m/s, of an OEM's segment at ``epoch``, in the frame of
    the segment: those of the row at that epoch, else of the cubic through positions and velocities
    of the two rows around it. The epoch must be within the segment: it is not checked. Raises
    FormatError if these rows contradict each other, or the position is not near the Earth."""
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
                f"segment at line {segment.line}: about the epoch, positions change by "
                f"{np.linalg.norm(chord) / 1e3:.6g} km/s where velocities are "
                f"{np.linalg.norm(mean) / 1e3:.6g} km/s; are rows missing?"
            )
        curve = CubicHermiteSpline(times[pair], positions[pair], velocities[pair])
        at = epoch - segment.epochs[0]
        position, velocity = curve(at), curve(at, 1)
    distance = float(np.linalg.norm(position))
    if not 0.9 * _RADIUS < distance < 100.0 * _RADIUS:
        raise FormatError(
            f"segment at line {segment.line}: "
            f"a distance of {distance / 1e3:.6g} km from the centre of the "
            "Earth is too small or too large; positions are in km"
        )
    return position, velocity


def _vertical(position: np.ndarray) -> tuple[np.ndarray, np.ndarray, float]:
    """Unit vectors up (normal to the ellipsoid of WGS 84) and east, each (3,), at a position (3,),
    m, in Earth axes, and its height above the ellipsoid, m. Raises FormatError within 1 m of the
    axis of the Earth (above a pole)."""
    x, y, z = position
    radius = math.hypot(x, y)
    if radius < 1.0:
        raise FormatError(
            "lies above a pole of the Earth at this epoch, where no direction is east; choose "
            "another epoch"
        )
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
    """Read the attitude of the vehicle at an epoch. Returns the rotation matrix (3, 3) from body
    axes (forward, up, right) to the frame of the trajectory, the angular rate (3,) relative to this
    frame in body axes, rad/s (constant between two rows, 0 if there is only one), and sentences.
    ``attitude`` is the option of `read_initial`, a table with ``file``, an AEM, and ``axes``, the
    directions of its body axes; ``frame`` names the frame of the trajectory, and ``text`` is the
    epoch for messages. Raises FormatError if the option or the file is not valid, no segment
    encloses the epoch, or the file's attitude is relative to another frame."""
    if not isinstance(attitude, dict) or not isinstance(attitude.get("file"), str):
        raise FormatError('the attitude must be a table: { file = "NAME.aem", axes = "..." }')
    if unknown := [key for key in attitude if key not in ("file", "axes")]:
        raise FormatError(f"attitude.{unknown[0]}: unknown key; allowed: file, axes")
    path = Path(attitude["file"])
    name = path.name
    problems = Problems()
    matrix = axes_matrix("axes", attitude.get("axes"), problems)
    if matrix is None:
        raise FormatError(f"attitude.{problems[0]}")
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
    """True if the rotations of an AEM's segment are from the body to ``frame``, that of the
    trajectory; False if they are the reverse. ``version`` is that of the AEM: from 2 on,
    ATTITUDE_DIR may be missing and is then A2B. Raises FormatError if the rotations are between
    other frames, or ATTITUDE_DIR is missing in version 1 or unknown."""
    frames = [segment.metadata.get(f"REF_FRAME_{x}", "").upper() for x in "AB"]
    bodies = [each.startswith(("SC_BODY", "SC BODY", "ACTUATOR", "INSTRUMENT")) for each in frames]
    others = [_SAME.get(each, each) for each, is_body in zip(frames, bodies, strict=True)
              if not is_body]  # fmt: skip
    if sum(bodies) != 1 or others != [_SAME.get(frame, frame)]:
        raise FormatError(
            f"segment at line {segment.line}: "
            f"is an attitude between {frames[0]} and {frames[1]}; must be of "
            f"SC_BODY and the frame of the trajectory, {frame}"
        )
    direction = segment.metadata.get("ATTITUDE_DIR", "A2B" if version[0] != "1" else "").upper()
    if direction not in ("A2B", "B2A"):
        raise FormatError(
            f"segment at line {segment.line}: "
            "ATTITUDE_DIR is missing or unknown; must be A2B or B2A"
        )
    return bodies[0] == (direction == "A2B")


def _rotations(segment: Segment, version: str) -> tuple[Rotation, str]:
    """Rotations of an AEM's segment, one for each row, and a text on how the file writes them.

    A rotation of CCSDS from one frame to another rotates the axes of the first into those of the
    second. This rotation of axes is returned: its matrix takes components in the second frame to
    components in the first. ``version`` is that of the AEM: version 1 has other required keywords.
    Raises FormatError if the rows or keywords are not valid.
    """
    rows = np.array(segment.rows)
    kind = segment.metadata.get("ATTITUDE_TYPE", "").upper()
    if kind.startswith("QUATERNION"):
        order = segment.metadata.get("QUATERNION_TYPE", "LAST" if version[0] != "1" else "").upper()
        if order not in ("FIRST", "LAST"):
            raise FormatError(
                f"segment at line {segment.line}: "
                "QUATERNION_TYPE is missing or unknown; must be FIRST or "
                "LAST, where the scalar part stands"
            )
        if rows.shape[1] < 4:
            raise FormatError(
                f"segment at line {segment.line}: "
                f"has rows of {rows.shape[1]} numbers after the time: "
                "ATTITUDE_TYPE QUATERNION needs 4 or more, the quaternion first"
            )
        quaternions = rows[:, :4]
        norms = np.linalg.norm(quaternions, axis=1)
        if np.abs(norms - 1.0).max() > 1e-3:
            raise FormatError(
                f"segment at line {segment.line}: "
                f"has a quaternion of length {norms.max():.6g}, not 1"
            )
        if order == "FIRST":
            quaternions = np.roll(quaternions, -1, axis=1)
        return Rotation.from_quat(quaternions), f"quaternions, scalar part {order.lower()}"
    if kind.startswith("EULER_ANGLE"):
        if rows.shape[1] < 3:
            raise FormatError(
                f"segment at line {segment.line}: "
                f"has rows of {rows.shape[1]} numbers after the time: "
                "ATTITUDE_TYPE EULER_ANGLE needs 3 or more, the angles first"
            )
        sequence = segment.metadata.get("EULER_ROT_SEQ", "").upper()
        axes = "".join(_EULER.get(letter, "") for letter in sequence)
        if len(axes) != 3 or len(sequence) != 3 or axes[0] == axes[1] or axes[1] == axes[2]:
            raise FormatError(
                f"segment at line {segment.line}: "
                f"EULER_ROT_SEQ is {shorten(sequence)}; must be three "
                "axes of 1, 2, 3 (or X, Y, Z), neighbours different, such as 321"
            )
        return (
            Rotation.from_euler(axes, rows[:, :3], degrees=True),
            f"angles in the order of EULER_ROT_SEQ {sequence}",
        )
    raise FormatError(
        f"segment at line {segment.line}: "
        f"ATTITUDE_TYPE is {shorten(kind)}; must be QUATERNION or EULER_ANGLE"
    )
