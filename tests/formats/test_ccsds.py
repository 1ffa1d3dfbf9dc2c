"""Initial states from OEM and AEM, against values by hand and an independent path."""

import math

import numpy as np
import pytest
from numpy.testing import assert_allclose
from scipy.spatial.transform import Rotation
from small_scenes import SPRUNG

import sepmc
from sepmc.formats.ccsds import read_initial
from sepmc.formats.ccsds_messages import parse_message, seconds_of
from sepmc.formats.files import read_files
from sepmc.formats.text_table import FormatError
from sepmc.scene.messages import Problems

RADIUS, EARTH_RATE = 6378137.0, 7.292115e-5
EPOCH = "2026-03-01T00:00:10"


def oem(tmp_path, *rows, frame="EME2000", center="EARTH", name="s.oem"):
    lines = [
        "CCSDS_OEM_VERS = 2.0", "CREATION_DATE = 2026-01-01T00:00:00", "ORIGINATOR = ME", "",
        "META_START", "OBJECT_NAME = STAGE", f"CENTER_NAME = {center}", f"REF_FRAME = {frame}",
        "TIME_SYSTEM = UTC", "META_STOP", "COMMENT rows",
    ]  # fmt: skip
    lines += [f"2026-03-01T00:00:{t:06.3f} " + " ".join(f"{x!r}" for x in row) for t, *row in rows]
    (tmp_path / name).write_text("\n".join(lines))
    return tmp_path / name


def aem(tmp_path, *rows, extra="", kind="QUATERNION", frames=("EME2000", "SC_BODY_1")):
    lines = [
        "CCSDS_AEM_VERS = 1.0", "META_START", f"REF_FRAME_A = {frames[0]}",
        f"REF_FRAME_B = {frames[1]}", "ATTITUDE_DIR = A2B", f"ATTITUDE_TYPE = {kind}",
        *extra.split("\n"), "META_STOP", "DATA_START",
        *[f"2026-03-01T00:00:{t:06.3f} " + " ".join(map(repr, map(float, x))) for t, *x in rows],
        "DATA_STOP",
    ]  # fmt: skip
    (tmp_path / "s.aem").write_text("\n".join(lines))
    return {"file": str(tmp_path / "s.aem"), "axes": "forward-right-down"}


def test_equator_by_hand(tmp_path):
    """100 km above the equator at x, 2000 m/s east and 300 m/s up over the turning Earth."""
    radius = RADIUS + 1e5
    east = 2000.0 + EARTH_RATE * radius
    path = oem(tmp_path, (10.0, radius / 1e3, 0.0, 0.0, 0.3, east / 1e3, 0.0))
    keys, understood = read_initial(path, {})
    assert_allclose(keys["altitude_m"], 1e5, atol=1e-6)
    assert_allclose(keys["speed_m_s"], math.hypot(2000.0, 300.0), rtol=1e-12)
    assert_allclose(keys["pitch_deg"], math.degrees(math.atan2(300.0, 2000.0)), rtol=1e-12)
    assert keys["path_yaw_deg"] == 0.0
    assert "ground x to azimuth 90 deg" in understood[1]


def test_frame_of_the_earth_has_no_rate(tmp_path):
    path = oem(tmp_path, (10.0, 6500.0, 0.0, 0.0, 0.0, 1.0, 0.0), frame="ITRF2014")
    assert_allclose(read_initial(path, {})[0]["speed_m_s"], 1000.0, rtol=1e-12)


@pytest.mark.parametrize("latitude", [0.0, 28.5, -63.0, 89.0])
def test_height_is_that_above_the_ellipsoid(tmp_path, latitude):
    """The position is made from latitude and height, by the closed form."""
    squared = (2.0 - 1.0 / 298.257223563) / 298.257223563
    b, height = math.radians(latitude), 123456.0
    across = RADIUS / math.sqrt(1.0 - squared * math.sin(b) ** 2)
    x = (across + height) * math.cos(b)
    z = (across * (1.0 - squared) + height) * math.sin(b)
    north = (-math.sin(b), 0.0, math.cos(b))
    path = oem(tmp_path, (10.0, x / 1e3, 0.0, z / 1e3, *north), frame="ITRF2014")
    keys, understood = read_initial(path, {})
    assert_allclose(keys["altitude_m"], height, atol=1e-6)
    assert abs(keys["pitch_deg"]) < 1e-9
    azimuth = float(understood[1].split("azimuth ")[1].split(" deg")[0])
    assert_allclose(math.cos(math.radians(azimuth)), 1.0)


def test_path_out_of_the_azimuth(tmp_path):
    """30 deg to the right of ground x, level: a negative path_yaw, as CONVENTIONS has it."""
    path = oem(tmp_path, (10.0, 6500.0, 0.0, 0.0, 0.0, 1.0, 0.0), frame="ITRF2014")
    keys, _ = read_initial(path, {"azimuth_deg": 60.0})
    assert_allclose(keys["path_yaw_deg"], -30.0)


def test_between_rows_a_circle_is_followed(tmp_path):
    """Rows of a circular orbit every 20 s: height to 5 mm, and the epoch chooses."""
    r, n = 6878.137, math.sqrt(398600.4418 / 6878.137**3)
    rows = [(t, r * math.cos(n * t), r * math.sin(n * t), 0.0,
             -r * n * math.sin(n * t), r * n * math.cos(n * t), 0.0)
            for t in (0.0, 20.0, 40.0)]  # fmt: skip
    path = oem(tmp_path, *rows)
    with pytest.raises(FormatError, match=r"has rows from .* to .*; give the start of the flight"):
        read_initial(path, {})
    keys, _ = read_initial(path, {"epoch": EPOCH})
    assert_allclose(keys["altitude_m"], 5e5, atol=5e-3)
    assert abs(keys["pitch_deg"]) < 1e-4
    with pytest.raises(FormatError, match="rows are from 2026-03-01T00:00"):
        read_initial(path, {"epoch": "2026-03-01T00:01:00"})


def test_rows_that_disagree_are_refused(tmp_path):
    """Positions of m, with velocities of km/s, or a gap in powered flight."""
    rows = [(t, 6500.0, 0.001 * t, 0.0, 0.0, 1.0, 0.0) for t in (9.0, 11.0)]
    path = oem(tmp_path, *rows, frame="ITRF2014")
    with pytest.raises(FormatError, match=r"positions change by 0\.001 km/s where"):
        read_initial(path, {"epoch": EPOCH})
    keys, _ = read_initial(path, {"epoch": "2026-03-01T00:00:11"})  # that of a row
    assert_allclose(keys["speed_m_s"], 1000.0, rtol=1e-12)


def attitude_of(keys):
    """Matrix from our body axes to the ground, by CONVENTIONS."""
    angles = [keys[f"{name}_deg"] for name in ("pitch", "yaw", "roll")]
    return Rotation.from_euler("ZYX", angles, degrees=True).as_matrix()


def euler_row(matrix):
    """Angles 321 of CCSDS of a body whose axes are the columns of ``matrix`` in the frame."""
    return Rotation.from_matrix(matrix).as_euler("ZYX", degrees=True)


@pytest.mark.parametrize("form", ["last", "first", "euler", "body-first", "b2a"])
def test_attitude_of_a_body_of_field_axes(tmp_path, form):
    """Nose to the north of the velocity's azimuth, 20 deg up, right wing 10 deg down.

    At x of ITRF: up is x, east y, north z. The axes of the body are made one by one.
    """
    path = oem(tmp_path, (10.0, 6500.0, 0.0, 0.0, 0.0, 0.0, 1.0), frame="ITRF2014")
    up, east, north = np.eye(3)
    up20, roll = math.radians(20.0), math.radians(10.0)
    forward = math.cos(up20) * north + math.sin(up20) * up
    lift = math.cos(up20) * up - math.sin(up20) * north
    right = math.cos(roll) * east - math.sin(roll) * lift
    down = np.cross(forward, right)
    body = np.column_stack([forward, right, down])  # body to frame
    q = Rotation.from_matrix(body).as_quat()
    frames, extra, kind = ("ITRF2014", "SC_BODY_1"), "QUATERNION_TYPE = LAST", "QUATERNION"
    row = q
    if form == "first":
        row, extra = np.roll(q, 1), "QUATERNION_TYPE = FIRST"
    elif form == "euler":
        row, extra, kind = euler_row(body), "EULER_ROT_SEQ = 321", "EULER_ANGLE"
    elif form == "body-first":
        row, frames = Rotation.from_quat(q).inv().as_quat(), frames[::-1]
    elif form == "b2a":
        row = Rotation.from_quat(q).inv().as_quat()
    attitude = aem(tmp_path, (10.0, *row), extra=extra, kind=kind, frames=frames)
    if form == "b2a":
        file = tmp_path / "s.aem"
        file.write_text(file.read_text().replace("A2B", "B2A"))
    keys, understood = read_initial(path, {"attitude": attitude})
    assert_allclose(keys["pitch_deg"], 20.0, atol=1e-9)
    assert_allclose(keys["alpha_deg"], 20.0, atol=1e-9)
    assert_allclose(keys["yaw_deg"], 0.0, atol=1e-9)
    # our z axis, right, points down by 10 deg: the ground y component of the third column
    assert_allclose(attitude_of(keys)[1, 2], -math.sin(roll) * math.cos(up20), atol=1e-12)
    assert "axes forward-right-down" in understood[-1]
    assert keys["omega_deg_s"] == [0.0, 0.0, 0.0]


def test_rates_are_those_between_rows(tmp_path):
    """Pitching up by 2 deg/s: about our z axis, right; in the field's axes about y."""
    path = oem(tmp_path, *((t, 6500.0, 0.0, t - 10.0, 0.0, 0.0, 1.0) for t in (9.0, 11.0)),
               frame="ITRF2014")  # fmt: skip
    rows = []
    for t in (9.0, 11.0):
        up = math.radians(20.0 + 2.0 * (t - 10.0))
        forward, right = np.array([math.sin(up), 0.0, math.cos(up)]), np.array([0.0, 1.0, 0.0])
        body = np.column_stack([forward, right, np.cross(forward, right)])
        rows.append((t, *Rotation.from_matrix(body).as_quat()))
    attitude = aem(tmp_path, *rows, extra="QUATERNION_TYPE = LAST",
                   frames=("ITRF2014", "SC_BODY_1"))  # fmt: skip
    keys, _ = read_initial(path, {"attitude": attitude, "epoch": EPOCH, "azimuth_deg": 0.0})
    assert_allclose(keys["pitch_deg"], 20.0, atol=1e-9)
    assert_allclose(keys["omega_deg_s"], [0.0, 0.0, 2.0], atol=1e-9)


def test_campaign_has_the_state_and_its_own_keys(tmp_path):
    oem(tmp_path, (10.0, 6500.0, 0.0, 0.0, 0.0, 1.0, 0.0), frame="ITRF2014")
    tree = {"initial": {"trajectory": {"file": "s.oem"}, "omega_deg_s": [1.0, 0.0, 0.0]}}
    problems = Problems()
    understood = read_files(tree, tmp_path, problems)
    assert not problems
    assert tree["initial"]["speed_m_s"] == pytest.approx(1000.0)
    assert "trajectory" not in tree["initial"]
    assert understood[0].startswith("initial.trajectory: 's.oem': state of STAGE")
    twice = {"initial": {"trajectory": {"file": "s.oem"}, "speed_km_s": 1.0}}
    read_files(twice, tmp_path, problems)
    assert problems == ["initial.speed_m_s: is given by the file too: leave it out here"]


@pytest.mark.parametrize(
    ("change", "reason"),
    [
        (("EARTH", "MARS"), "segment at line 5: CENTER_NAME is 'MARS'; must be EARTH"),
        (("EME2000", "RTN"), "segment at line 5: REF_FRAME is 'RTN'"),
        (("2026-03-01T00:00:10.000", "yesterday"), "line 12: 'yesterday' is no epoch"),
        (("6500.0", "6500.0x"), "line 12: .* is no row of numbers"),
        (("6500.0", "nan"), "line 12: .* not finite"),
        (("6500.0", "6500000.0"), "positions are in km"),
        (("CCSDS_OEM_VERS", "CCSDS_OPM_VERS"), "line 1: begins with"),
        (("META_STOP", "META_END"), "line 10: 'META_END' is no row of numbers"),
        (("0.0 1.0 0.0", "0.0 1.0"), "line 12: has 5 numbers; must be position"),
    ],
)
def test_faults_are_named_with_their_line(tmp_path, change, reason):
    path = oem(tmp_path, (10.0, 6500.0, 0.0, 0.0, 0.0, 1.0, 0.0))
    path.write_text(path.read_text().replace(*change))
    with pytest.raises(FormatError, match=reason):
        read_initial(path, {})


@pytest.mark.parametrize("azimuth", [True, math.nan, math.inf, "90"])
def test_an_azimuth_that_is_no_finite_number_is_refused(tmp_path, azimuth):
    path = oem(tmp_path, (10.0, 7000.0, 0.0, 0.0, 0.0, 7.5, 0.0))
    with pytest.raises(FormatError, match=r"the key azimuth_deg = .*: must be a number"):
        read_initial(path, {"azimuth_deg": azimuth})


def test_vertical_velocity_needs_an_azimuth(tmp_path):
    path = oem(tmp_path, (10.0, 6500.0, 0.0, 0.0, 1.0, 0.0, 0.0), frame="ITRF2014")
    with pytest.raises(FormatError, match="the velocity is vertical: give azimuth_deg"):
        read_initial(path, {})
    assert_allclose(read_initial(path, {"azimuth_deg": 90.0})[0]["pitch_deg"], 90.0)


@pytest.mark.parametrize(
    ("extra", "kind", "row", "reason"),
    [
        ("", "QUATERNION", [0, 0, 0, 1], "QUATERNION_TYPE is missing"),
        ("QUATERNION_TYPE = LAST", "QUATERNION", [0, 0, 0, 2], "quaternion of length 2"),
        ("EULER_ROT_SEQ = 332", "EULER_ANGLE", [0, 0, 0], "EULER_ROT_SEQ is '332'"),
        ("", "SPIN", [0, 0, 0, 0], "ATTITUDE_TYPE is 'SPIN'"),
    ],
)
def test_faults_of_attitudes(tmp_path, extra, kind, row, reason):
    path = oem(tmp_path, (10.0, 6500.0, 0.0, 0.0, 0.0, 1.0, 0.0))
    attitude = aem(tmp_path, (10.0, *row), extra=extra, kind=kind)
    with pytest.raises(FormatError, match=rf"s\.aem: .*{reason}"):
        read_initial(path, {"attitude": attitude})
    with pytest.raises(FormatError, match="must name the directions"):
        read_initial(path, {"attitude": {"file": attitude["file"]}})


def test_campaign_with_a_trajectory_loads(tmp_path):
    """Its scene has the state; its tree, as a run stores it, has plain numbers."""
    rows = [(t, 6500.0, t - 10.0, 0.1 * (t - 10.0), 0.0, 1.0, 0.1) for t in (9.0, 11.0)]
    oem(tmp_path, *rows, frame="ITRF2014")
    quaternions = [(t, 0.0, 0.0, math.sin(0.01 * t), math.cos(0.01 * t)) for t in (9.0, 11.0)]
    aem(tmp_path, *quaternions, extra="QUATERNION_TYPE = LAST", frames=("ITRF2014", "SC_BODY_1"))
    table = (
        f'trajectory = {{ file = "s.oem", epoch = {EPOCH}, azimuth_deg = 80, attitude = '
        '{ file = "s.aem", axes = "forward-right-down" } }'
    )
    text = SPRUNG.replace("altitude_m = 1000.0\nspeed_m_s = 1.0", table)
    (tmp_path / "c.toml").write_text(text)
    campaign = sepmc.load(tmp_path / "c.toml")
    assert campaign.scene.initial.speed == pytest.approx(math.hypot(1000.0, 100.0))
    numbers = [x for x in campaign.file.tree["initial"].values() if not isinstance(x, list)]
    assert len(numbers) == 7
    assert {type(x) for x in numbers} == {float}


def test_epochs_of_both_forms():
    assert seconds_of("2026-060T00:00:10") == seconds_of("2026-03-01T00:00:10.000Z")
    assert seconds_of("2026-03-01T00:00:10.25") - seconds_of("2026-02-28T00:00:00") == 86410.25
    assert seconds_of("2026-13-01T00:00:10") is None
    assert seconds_of("2026-02-28T24:00:00") == seconds_of("2026-059T24:00:00Z")
    assert seconds_of("2024-366T00:00:00") == seconds_of("2024-12-31T00:00:00")


@pytest.mark.parametrize(
    "text", ["2026-000T00:00:00", "2026-366T00:00:00", "2026-01-01T24:00:01", "2026-01-01T24:59:00"]
)
def test_epochs_that_no_calendar_or_clock_has(text):
    assert seconds_of(text) is None


def test_covariances_and_segments(tmp_path):
    path = oem(tmp_path, (10.0, 6500.0, 0.0, 0.0, 0.0, 1.0, 0.0))
    text = path.read_text() + "\nCOVARIANCE_START\nEPOCH = 2026-03-01T00:00:10\n1e-3\n"
    text += "1e-4 2e-3\nCOVARIANCE_STOP\nMETA_START\nCENTER_NAME = EARTH\nMETA_STOP\n"
    text += "2026-03-02T00:00:00 7000 0 0 0 1 0\n2026-03-02T00:00:09 7000 9 0 0 1 0 .1 .2 .3\n"
    version, segments = parse_message(text, "OEM")
    assert (version, len(segments)) == ("2.0", 2)
    assert [len(each.rows) for each in segments] == [1, 2]
    assert segments[1].rows[1] == [7000.0, 9.0, 0.0, 0.0, 1.0, 0.0]
