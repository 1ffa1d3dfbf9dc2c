"""Files beside a campaign, from `sepmc.load` to the numbers that are flown."""

import math

import numpy as np
import pytest
from click.testing import CliRunner
from numpy.testing import assert_allclose, assert_array_equal
from small_scenes import PAIR

import sepmc
from sepmc.cli import app
from sepmc.formats.decks import deck_of, read_deck
from sepmc.formats.files import read_files
from sepmc.formats.soundings import read_air, read_wind
from sepmc.formats.text_table import FormatError, parse_table
from sepmc.formats.thrust import parse_eng, read_thrust
from sepmc.physics.atmosphere import us1976
from sepmc.scene.messages import Problems, SceneError

CURVE = "; a motor\n; of two lines\nC6 18 70 0-3-5 0.0108 0.0231 E\n" \
        "0.1 10.0\n0.3 14.0\n0.3 5.0\n1.0 4.0\n1.2 0.0\n;\n"  # fmt: skip
MOTOR = """
[[motor]]
name = "retro"
body = "aft"
station_m = 3.0
profile = { file = "FILE" }
"""
AERO = """
[body.aft.aerodynamics]
reference_area_m2 = 1.0
reference_length_m = 0.5
table = { file = "FILE" }
"""


def campaign(folder, more, file, text, **replaced):
    """A pair of bodies with another table, whose file is written beside it."""
    folder.mkdir(exist_ok=True)
    (folder / file).write_text(text)
    written = PAIR + more.replace("FILE", file)
    for old, new in replaced.items():
        written = written.replace(old, new)
    (folder / "c.toml").write_text(written)
    return sepmc.load(folder / "c.toml")


def problem(*arguments, **keys):
    with pytest.raises(SceneError) as caught:
        campaign(*arguments, **keys)
    return str(caught.value)


# -- thrust --------------------------------------------------------------------------------------


def test_a_rasp_file(tmp_path):
    """The rise from (0, 0), a step at 0.3 s, peak and impulse: 0.5 + 2.4 + 3.15 + 0.4 N s."""
    result = campaign(tmp_path, MOTOR, "c6.eng", CURVE)
    motor = result.scene.motor[0]
    assert motor.thrust == 14.0
    assert motor.profile.time == (0.0, 0.1, 0.3, math.nextafter(0.3, 1.0), 1.0, 1.2)
    assert_allclose(np.array(motor.profile.fraction) * 14.0, [0.0, 10.0, 14.0, 5.0, 4.0, 0.0])
    impulse = np.trapezoid(motor.profile.fraction, motor.profile.time) * motor.thrust
    assert_allclose(impulse, 6.45, rtol=1e-12)
    (said,) = result.file.understood
    assert said.startswith("motor.retro.profile: 'c6.eng': engine C6 of E")
    assert "rises from 0 at the ignition to the first row" in said
    assert "a step at 0.3 s" in said
    assert "0.0108 kg of 0.0231 kg, is taken from no body" in said


def test_a_rasp_file_is_flown(tmp_path):
    """The aft body, 1 kg, alone: its speed afterwards is the impulse."""
    result = campaign(tmp_path, MOTOR, "c6.eng", CURVE).with_settings(
        {"run.end_time_s": 1.5, "phase": [{"name": "free"}]}
    )
    history = result.simulate(step_s=0.5)
    assert history.attrs["status"] == "ok"
    assert_allclose(history["separation_speed_m_s"].iloc[-1], 6.45, rtol=1e-10)


def test_a_scaled_impulse(tmp_path):
    more = MOTOR.replace('"FILE"', '"FILE", total_impulse_N_s = 12.9')
    motor = campaign(tmp_path, more, "c6.eng", CURVE).scene.motor[0]
    impulse = np.trapezoid(motor.profile.fraction, motor.profile.time) * motor.thrust
    assert_allclose(impulse, 12.9, rtol=1e-14)


def test_an_impulse_that_no_finite_thrust_has(tmp_path):
    """Two rows at one time last 5e-324 s."""
    more = MOTOR.replace('"FILE"', '"FILE", total_impulse_N_s = 12.0')
    reason = problem(tmp_path, more, "a.csv", "time_s,thrust_N\n0,1\n0,2\n")
    assert "is too large for a curve of almost no duration" in reason


def test_a_thrust_that_is_given_keeps_the_newtons(tmp_path):
    more = MOTOR.replace("station_m", "thrust_N = 20.0\nstation_m")
    motor = campaign(tmp_path, more, "c6.eng", CURVE).scene.motor[0]
    assert motor.thrust == 20.0
    assert_allclose(max(motor.profile.fraction), 0.7)


@pytest.mark.parametrize(
    ("text", "thrust"),
    [
        ("time (s),thrust (lbf)\n0,1\n1,2\n", [4.4482216152605, 8.896443230521]),
        ("t_ms;F_N\n0;1\n1000;2\n", [1.0, 2.0]),
        ("# a stand\nTime\tThrust\ns\tkN\n0\t0.001\n1\t0.002\n", [1.0, 2.0]),
        ("# a stand\n# time_s, thrust_kN\n0,0.001\n1,0.002\n", [1.0, 2.0]),  # numpy.savetxt
        ("0,1\n1,2\n", [1.0, 2.0]),  # RocketPy
        ("# stand 3, of May\n# 2 s before\n0,1\n# a pause\n1,2\n", [1.0, 2.0]),
        ("% Retro, batch 7 (N over s)\n0;1\n1;2\n", [1.0, 2.0]),
    ],
)
def test_tables_of_thrust(tmp_path, text, thrust):
    motor = campaign(tmp_path, MOTOR, "c.csv", text).scene.motor[0]
    assert motor.profile.time == (0.0, 1.0)
    assert_allclose(np.array(motor.profile.fraction) * motor.thrust, thrust, rtol=1e-15)


def test_units_without_a_header_are_noted(tmp_path):
    tree = {"motor": [{"name": "m", "profile": {"file": "c.csv"}}]}
    (tmp_path / "c.csv").write_text("0,1\n1,2\n")
    sentences = read_files(tree, tmp_path, Problems())
    assert "no header: taken as time in s and thrust in N" in sentences[0]
    assert "has no header; give the names" in problem(tmp_path, MOTOR, "c.csv", "0,1,2\n1,2,3\n")
    for unit in ("lbf", "kN", "kg", "ms"):
        text = f"# stand 3, {unit}\n0,1\n1,2\n"
        reason = f"has no header, and {unit} in the comment 'stand 3, {unit}'; give the units"
        assert reason in problem(tmp_path, MOTOR, "c.csv", text)
        more = MOTOR.replace('"FILE"', '"FILE", columns = ["time_ms", "thrust_kN"]')
        motor = campaign(tmp_path, more, "c.csv", text).scene.motor[0]
        assert (motor.profile.time, motor.thrust) == ((0.0, 0.001), 2000.0)


@pytest.mark.parametrize("head", ["", "# a stand\n\n", "time_s,thrust_N\n\n# a stand\n"])
def test_lines_of_the_file_are_counted(tmp_path, head):
    line = len(head.splitlines()) + 3
    reason = f"line {line}: the time 0.5 s is before that of the row above"
    assert reason in problem(tmp_path, MOTOR, "c.csv", f"{head}0,1\n1,2\n0.5,3\n")


def test_negative_thrust_is_noted(tmp_path):
    curve = "time_s,thrust_N\n0,0\n0.5,-100\n1,0\n"
    understood = campaign(tmp_path, MOTOR, "c.csv", curve).file.understood
    assert "the thrust is negative in 1 rows, down to -100 N" in " ".join(understood)


def test_fractions_need_a_thrust(tmp_path):
    text = "time_s,fraction\n0,1\n1,0.5\n"
    assert "'thrust_N' is missing" in problem(tmp_path, MOTOR, "c.csv", text)
    more = MOTOR.replace("station_m", "thrust_N = 20.0\nstation_m")
    motor = campaign(tmp_path, more, "c.csv", text).scene.motor[0]
    assert (motor.thrust, motor.profile.fraction) == (20.0, (1.0, 0.5))


def test_columns_that_are_named(tmp_path):
    more = MOTOR.replace(
        '"FILE"',
        '"FILE", columns = { time_ms = "clock", thrust_N = { column = "ch2", scale = -1 } }',
    )
    motor = campaign(tmp_path, more, "c.csv", "clock,ch1,ch2\n0,9,-1\n500,9,-3\n").scene.motor[0]
    assert (motor.profile.time, motor.thrust) == ((0.0, 0.5), 3.0)
    more = MOTOR.replace('"FILE"', '"FILE", columns = ["time_s", "thrust_N"]')
    motor = campaign(tmp_path, more, "c.csv", "0 1\n2 4\n").scene.motor[0]
    assert (motor.profile.time, motor.thrust) == ((0.0, 2.0), 4.0)


@pytest.mark.parametrize("scale", ["true", "nan", "inf", "'2'"])
def test_a_scale_that_is_no_finite_number_is_refused(tmp_path, scale):
    columns = f'"FILE", columns = {{ thrust_N = {{ column = "ch2", scale = {scale} }} }}'
    text = problem(tmp_path, MOTOR.replace('"FILE"', columns), "c.csv", "time_s,ch2\n0,1\n1,2\n")
    assert "columns.thrust_N: must be the title of a column, or" in text


def test_one_of_two_columns_of_a_coefficient_is_chosen():
    table = parse_table("alpha_deg,CA,cn,C_A,x\n0,1,3,2,4\n5,1,3,2,4\n")
    with pytest.raises(FormatError, match=r"column cn has two meanings: write CN \(normal\) or Cn"):
        deck_of(table, {"normal": "x"})
    both = {"normal": "x", "yaw": "x"}
    with pytest.raises(
        FormatError, match=r"two columns of axial; .* C_A: choose by columns\.axial"
    ):
        deck_of(table, both)
    tree, understood = deck_of(table, both | {"axial": "C_A"})
    assert (tree["axial"], tree["normal"]) == ([2.0, 2.0], [4.0, 4.0])
    assert "not read: CA, cn" in understood


FILES_WITH_COLUMNS = [
    (read_thrust, "time_s,x\n0,1\n1,2\n", "thrust_N"),
    (read_deck, "mach,x\n0.5,1\n0.9,2\n", "axial"),
    (read_air, "altitude_m,x\n0,1\n9,2\n", "density_kg_per_m3"),
    (read_wind, "altitude_m,from_deg,x\n0,1,1\n9,2,2\n", "speed_m_s"),
]


@pytest.mark.parametrize(("read", "text", "key"), FILES_WITH_COLUMNS)
def test_unknown_keys_of_columns_are_refused(tmp_path, read, text, key):
    """A key of the table of one column, a quantity, and an option that is neither list nor
    table."""
    (tmp_path / "c.csv").write_text(text)
    read(tmp_path / "c.csv", {"columns": {key: {"column": "x", "scale": 2}}})
    for columns, message in (
        ({key: {"column": "x", "factor": 2}}, rf"columns\.{key}\.factor: unknown key; allowed: "),
        ({key: "x", "colour": "x"}, r"columns\.colour: no such "),
        (5, "columns: must be a table of titles by quantity, or the list"),
    ):
        with pytest.raises(FormatError, match=message):
            read(tmp_path / "c.csv", {"columns": columns})


def test_an_impulse_that_is_infinite_is_refused(tmp_path):
    more = MOTOR.replace('"FILE"', '"FILE", total_impulse_N_s = inf')
    assert "total_impulse_N_s = inf: must be an impulse > 0" in problem(
        tmp_path, more, "c6.eng", CURVE
    )


def test_one_of_several_engines(tmp_path):
    two = CURVE + CURVE.replace("C6 18", "C7 18").replace("14.0", "28.0")
    assert 'choose one by engine = "NAME": C6, C7' in problem(tmp_path, MOTOR, "c.eng", two)
    more = MOTOR.replace('"FILE"', '"FILE", engine = "C7"')
    assert campaign(tmp_path, more, "c.eng", two).scene.motor[0].thrust == 28.0
    more = MOTOR.replace('"FILE"', '"FILE", engine = true')
    assert "has no engine true" in problem(tmp_path, more, "c.eng", two)


BAD_CURVES = {
    "": "has no engine",
    "0.1 10\n": "line 1: a row of time and thrust before the header",
    "C6 18 70\n0.1 10\n": "line 1: 'C6 18 70' is no header",
    "C6 18 70 0 0.1 0.2 E\n": "engine C6 has no rows",
    "C6 18 70 0 0.1 0.2 E\n0.1 10\n0.05 3\n": "line 3: the time 0.05 s is before that of the row",
    "C6 18 70 0 0.1 0.2 E\n-0.1 10\n0.05 3\n": "line 2: the time -0.1 s is before the ignition",
    "C6 18 70 0 0.1 0.2 E\n0.1 10\n0.2 x\n": "line 3: '0.2 x' is no row",
    "C6 18 70 0 0.1 0.2 E\n0.1 0\n0.2 0\n": "has no thrust at all",
}


@pytest.mark.parametrize(("text", "reason"), BAD_CURVES.items())
def test_curves_that_are_refused(tmp_path, text, reason):
    told = problem(tmp_path, MOTOR, "c.eng", text)
    assert "c.toml: motor.retro.profile.file = 'c.eng'" in told
    assert reason in told


def test_a_curve_at_ignition_has_no_rise():
    curve = parse_eng("C6 18 70 0 0.1 0.2 E\n0.0 10\n0.2 5\n")
    assert curve.time == [0.0, 0.2]
    assert "ends at 5, not 0" in " ".join(curve.understood)


# -- aerodynamics --------------------------------------------------------------------------------

DECK = """mach,alpha_deg,CA,CN,Cm,CMQ
0.8,-5,0.31,-0.2,0.02,-3
0.8,5,0.31,0.2,-0.02,-3
1.2,5,0.62,0.3,-0.03,-4
1.2,-5,0.62,-0.3,0.03,-4
"""


def test_a_long_table(tmp_path):
    """Rows in any order; the grid that they make, and what is said of it."""
    result = campaign(tmp_path, AERO, "deck.csv", DECK)
    table = result.scene.body["aft"].aerodynamics.table
    assert table.mach == (0.8, 1.2)
    assert_allclose(np.degrees(table.alpha), [-5.0, 5.0])
    assert table.normal == [[-0.2, 0.2], [-0.3, 0.3]]
    assert table.pitch_q == [[-3.0, -3.0], [-4.0, -4.0]]
    assert (
        "2 rows of mach, 2 rows of alpha; axial, normal, pitch, pitch_q"
        in result.file.understood[0]
    )


def test_options_beside_a_file(tmp_path):
    more = AERO.replace('"FILE"', '"FILE", interpolation = "linear"')
    more = more.replace("table", 'convention = "datcom"\nper = "deg"\ntable')
    deck = "mach,CA,CY,CMQ\n1,0.3,0.1,-0.1\n2,0.3,0.2,-0.1\n"
    table = campaign(tmp_path, more, "deck.csv", deck).scene.body["aft"].aerodynamics.table
    assert table.interpolation == "linear"
    assert table.side == [-0.1, -0.2]
    assert_allclose(table.pitch_q, -0.1 * 180.0 / math.pi)


def test_lift_and_drag():
    """At 30 deg CL 1 and CD 0.2: the force turned by 30 deg."""
    table, said = deck_of(parse_table("alpha,CL,CD\n0,0.5,0.1\n30,1,0.2\n"), {})
    assert_allclose(table["normal"], [0.5, math.sqrt(0.75) + 0.1])
    assert_allclose(table["axial"], [0.1, 0.2 * math.sqrt(0.75) - 0.5])
    assert "CN = CL cos alpha + CD sin alpha" in " ".join(said)


BAD_DECKS = {
    "CA,CN\n0.1,0.2\n": "needs a column of mach, alpha_deg or beta_deg",
    "mach,x\n0.1,0.2\n": "has no coefficient",
    "mach,cn\n1,0.2\n2,0.3\n": "write CN (normal) or Cn (yaw)",
    "mach,cl\n1,0.2\n2,0.3\n": "write CL (lift) or Cl (roll)",
    "mach,alpha,CN\n1,0,0\n1,5,0.2\n2,0,0\n": "has no row for mach = 2, alpha = 5 deg (1 of 4",
    "mach,CN\n1,0\n\n1,0.2\n": "line 4: mach = 1 is there twice",
    "mach,CL\n1,0\n2,0.2\n": "needs CL and CD together",
    "alpha,Cd,Cl\n1,0,0\n2,0,0\n": "of them; Cl is the roll moment here: lift is CL",
}


@pytest.mark.parametrize(("text", "reason"), BAD_DECKS.items())
def test_decks_that_are_refused(text, reason):
    with pytest.raises(FormatError) as caught:
        deck_of(parse_table(text), {})
    assert reason in str(caught.value)


# -- air and wind --------------------------------------------------------------------------------

AIR = """
[environment.air]
file = "FILE"
"""
TABLED = {'atmosphere = "none"': 'atmosphere = "table"', "environment = {": "[environment]\n",
          ', gravity = "none" }': '\ngravity = "none"'}  # fmt: skip


def test_air_of_a_table(tmp_path):
    heights = [0.0, 2000.0, 9000.0]
    rows = "\n".join(
        f"{h / 1000:g};{float(us1976(h)[1]) / 100.0!r};{us1976(h)[2] - 273.15!r}" for h in heights
    )
    text = f"Height (km);Pressure (hPa);Temperature (°C)\n{rows}\n"
    air = campaign(tmp_path, AIR, "air.csv", text, **TABLED).scene.environment.air
    assert_allclose(air.altitude, heights)
    assert_allclose(air.density, [us1976(h)[0] for h in heights], rtol=1e-12)


WYOMING = """72520 PIT Pittsburgh Observations at 12Z
-----------------------------------------------------------------------------
   PRES   HGHT   TEMP   DWPT   RELH   MIXR   DRCT   SKNT   THTA   THTE   THTV
    hPa     m      C      C      %    g/kg    deg   knot     K      K      K
-----------------------------------------------------------------------------
 1000.0    100
  980.0    360   10.0    8.0     87   6.90    180      5  284.8  304.4  286.0
  850.0   1500    2.0   -1.0     80   4.20    250     20  288.3  300.8  289.0
  700.0   3000   -8.0  -20.0     38   1.10    270     40  293.5  297.2  293.7
Station information and sounding indices
"""
WIND = """
[environment.wind]
azimuth_deg = 90.0
profile = { file = "FILE" }
"""


def test_a_sounding(tmp_path):
    """Fixed width, knots, from by compass: launched to the east, from 270 deg is along x."""
    heading = {"environment = {": "[environment]\n", ', gravity = "none" }': '\ngravity = "none"'}
    result = campaign(tmp_path, WIND, "wyo.txt", WYOMING, **heading)
    profile = result.scene.environment.wind.profile
    assert_allclose(profile.speed, np.array([5.0, 20.0, 40.0]) * 1852.0 / 3600.0)
    assert_allclose(math.cos(profile.direction[2]), 1.0)
    # geopotential heights of a wind are heights of a few metres less
    assert_array_equal(np.round(profile.altitude, 1), [360.0, 1500.4, 3001.4])


def test_wind_of_components_by_compass(tmp_path):
    """Air that moves to the east comes from 270 deg, and north is 0."""
    (tmp_path / "w.csv").write_text("alt_ft,u_east_kn,North (m/s)\n0,10,0\n1000,0,-2\n2000,-1,1\n")
    tree, understood = read_wind(tmp_path / "w.csv", {})
    knot = 1852.0 / 3600.0
    assert_allclose(tree["speed_m_s"], [10.0 * knot, 2.0, math.hypot(knot, 1.0)])
    assert_allclose(tree["from_deg"], [270.0, 0.0, 90.0 + math.degrees(math.atan2(1.0, knot))])
    assert "where the air moves to" in " ".join(understood)


def test_a_wind_whose_sense_is_not_said_is_chosen(tmp_path):
    (tmp_path / "w.csv").write_text("alt_m,Wind Direction (deg),speed_m_s\n0,270,1\n9,280,2\n")
    with pytest.raises(FormatError, match=r'from = "TITLE"'):
        read_wind(tmp_path / "w.csv", {})
    tree, _ = read_wind(tmp_path / "w.csv", {"columns": {"from": "Wind Direction (deg)"}})
    assert tree["from_deg"] == [270.0, 280.0]


@pytest.mark.parametrize(("title", "unit"), [("SKNT", 1852.0 / 3600.0), ("SPED", 1.0)])
@pytest.mark.parametrize("head", ["", "\n\n", "a title\n\n \n"])
def test_the_speed_of_a_sounding_is_in_the_unit_of_its_title(tmp_path, title, unit, head):
    """Blank lines above the titles too."""
    titles_on = WYOMING.splitlines(keepends=True)[2:]
    (tmp_path / "wyo.txt").write_text(head + "".join(titles_on).replace("SKNT", title))
    tree, understood = read_wind(tmp_path / "wyo.txt", {})
    assert_allclose(tree["speed_m_s"], np.array([5.0, 20.0, 40.0]) * unit)
    assert f"{title} ({'kn' if title == 'SKNT' else 'm/s'})" in " ".join(understood)


# -- the campaign --------------------------------------------------------------------------------


def test_a_run_needs_no_file(tmp_path):
    """The resolved campaign is complete; its digest follows the contents, not the name."""
    first = campaign(tmp_path / "a", MOTOR, "c6.eng", CURVE)
    (tmp_path / "alone.toml").write_text(first.file.toml)
    again = sepmc.load(tmp_path / "alone.toml")
    assert again.scene == first.scene
    assert again.digest == first.digest
    same = campaign(tmp_path / "b", MOTOR, "other.eng", CURVE)
    assert same.digest == first.digest
    other = campaign(tmp_path / "c", MOTOR, "c6.eng", CURVE.replace("1.2 0.0", "1.3 0.0"))
    assert other.digest != first.digest


@pytest.mark.parametrize("file", ["../c6.eng", "/etc/c6.eng", "link/c6.eng"])
def test_files_elsewhere_are_refused(tmp_path, file):
    """As the table of run.samples: beside the campaign, or in a folder there."""
    folder = tmp_path / "c"
    folder.mkdir()
    (tmp_path / "c6.eng").write_text(CURVE)
    (folder / "link").symlink_to(tmp_path)
    (folder / "c.toml").write_text(PAIR + MOTOR.replace("FILE", file))
    with pytest.raises(SceneError) as caught:
        sepmc.load(folder / "c.toml")
    assert "motor.retro.profile.file" in str(caught.value)
    assert "must lie beside the campaign, or in a folder there" in str(caught.value)


def test_a_setting_takes_any_file(tmp_path):
    (tmp_path / "c6.eng").write_text(CURVE.replace("14.0", "28.0"))
    folder = tmp_path / "c"
    campaign(folder, MOTOR, "c6.eng", CURVE)
    settings = {"motor.retro.profile.file": str(tmp_path / "c6.eng")}
    assert sepmc.load(folder / "c.toml", settings).scene.motor[0].thrust == 28.0


@pytest.mark.parametrize(
    ("file", "reason"),
    [("c6.xls", "must end in .csv"), ("none.eng", "no such file"), ("", "must be the name of")],
)
def test_files_that_are_none(tmp_path, file, reason):
    (tmp_path / "c6.xls").write_text(CURVE)
    (tmp_path / "c.toml").write_text(PAIR + MOTOR.replace("FILE", file))
    with pytest.raises(SceneError, match=reason):
        sepmc.load(tmp_path / "c.toml")


def test_keys_beside_a_file_that_gives_them(tmp_path):
    more = MOTOR.replace('"FILE"', '"FILE", time_s = [0.0, 1.0]')
    assert "motor.retro.profile.time: is given by the file too" in problem(
        tmp_path, more, "c6.eng", CURVE
    )
    more = AERO.replace('"FILE"', '"FILE", mach = [0.0, 1.0]')
    assert "table.mach: is given by the file too" in problem(tmp_path, more, "d.csv", DECK)


def test_check_says_what_was_read(tmp_path):
    campaign(tmp_path, MOTOR, "c6.eng", CURVE)
    result = CliRunner().invoke(app.main, ["check", str(tmp_path / "c.toml"), "--no-flight"])
    assert "understood   motor.retro.profile: 'c6.eng': engine C6 of E" in result.output
    assert "impulse      retro: 6.45 N s" in result.output


def test_a_sounding_with_a_wind_that_is_no_number(tmp_path):
    """A row with a speed that is not finite is left, and said."""
    from sepmc.formats.soundings import read_wind

    (tmp_path / "w.txt").write_text(WYOMING.replace("     40", "    inf"))
    table, said = read_wind(tmp_path / "w.txt", {})
    assert len(table["speed_m_s"]) == 2
    assert np.isfinite(table["speed_m_s"]).all()
    assert "rows" in said[0]


SPC = """%TITLE%
 OAX   140616/1900

   LEVEL       HGHT       TEMP       DWPT       WDIR       WSPD
-------------------------------------------------------------------
%RAW%
 1000.00,    34.00,  -9999.00,  -9999.00,  -9999.00,  -9999.00
 965.00,    350.00,     27.00,     23.80,    150.00,     20.00
 962.00,    377.50,     26.00,     22.80,  -9999.00,  -9999.00
 850.00,   1500.00,     15.00,      9.00,    200.00,     30.00
%END%
"""


def test_sounding_of_spc(tmp_path):
    """Each quantity has the rows that have it; -9999 is none."""
    (tmp_path / "s.oax").write_text(SPC)
    air, understood = read_air(tmp_path / "s.oax", {})
    assert air["geopotential_m"] == [350.0, 377.5, 1500.0]
    assert_allclose(air["pressure_Pa"], [96500.0, 96200.0, 85000.0], rtol=1e-15)
    assert_allclose(air["temperature_K"], [300.15, 299.15, 288.15], rtol=1e-15)
    assert "1 rows without PRES, HGHT, TEMP are not read" in " ".join(understood)
    wind, _ = read_wind(tmp_path / "s.oax", {})
    assert (wind["geopotential_m"], wind["from_deg"]) == ([350.0, 1500.0], [150.0, 200.0])
    assert_allclose(wind["speed_m_s"], np.array([20.0, 30.0]) * 1852.0 / 3600.0)


def test_a_row_of_a_sounding_that_is_none_has_its_line(tmp_path):
    (tmp_path / "s.oax").write_text(SPC.replace(" 962.00,  ", " 962.00  "))
    with pytest.raises(FormatError, match=r"line 9: .* is no row of PRES HGHT TEMP"):
        read_air(tmp_path / "s.oax", {})


def test_several_soundings_in_a_file_are_refused(tmp_path):
    for text in (SPC, WYOMING):
        (tmp_path / "s.txt").write_text(2 * text)
        with pytest.raises(FormatError, match="has 2 soundings; must have one"):
            read_air(tmp_path / "s.txt", {})


RASAERO = """Mach,Alpha,CD,CD Power-Off,CA Power-Off,CA Power-On,CL,CN,CP
0.5,0,0.5,0.5,0.5,0.4,0,0,90
0.5,4,0.5,0.5,0.6,0.5,0.4,0.45,90
"""


def test_coefficient_of_two_conditions_is_chosen():
    """RASAero has the axial force of the burning and of the coasting rocket."""
    table = parse_table(RASAERO)
    with pytest.raises(FormatError, match="has CA as CA Power-Off and CA Power-On; choose by"):
        deck_of(table, {})
    deck, _ = deck_of(table, {"axial": "CA Power-On"})
    assert (deck["axial"], deck["normal"]) == ([[0.4, 0.5]], [[0.0, 0.45]])


def test_titles_of_openrocket():
    """The header is a comment among others, with a unit of no width."""
    text = (
        "# Simulation 7\n# Time (s),Margin (\u200b),Speed (m/s)\n# Event LAUNCH at t=0\n0,NaN,1\n"
    )
    table = parse_table(text + "# Event APOGEE, or so, at t=1\n1,2,3\n", gaps=True)
    assert list(table.columns) == ["Time (s)", "Margin ()", "Speed (m/s)"]
    assert_array_equal(table.columns["Speed (m/s)"], [1.0, 3.0])


def test_columns_of_a_sounding_are_not_chosen(tmp_path):
    for text, kind in ((SPC, "SPC"), (WYOMING, "fixed width")):
        (tmp_path / "s.txt").write_text(text)
        for read, columns in ((read_air, {"density": "X"}), (read_wind, ["a", "b"])):
            with pytest.raises(FormatError, match=f"is a sounding of {kind}.* leave out columns ="):
                read(tmp_path / "s.txt", {"columns": columns})


def test_a_header_that_says_too_little_is_named_by_columns(tmp_path):
    """The refusal has the option that reads the file."""
    path = tmp_path / "t.csv"
    for header in ("date,thrust", "date,force_of_engine"):
        path.write_text(header + "\n0,0\n1,5\n")
        with pytest.raises(FormatError, match=r"columns = \{ .*thrust_N = ") as caught:
            read_thrust(path, {})
        name = header.partition(",")[2]
        assert f'thrust_N = "{name}" }}' in str(caught.value)
        columns = {"time_s": "date", "thrust_N": name}
        assert read_thrust(path, {"columns": columns}).thrust == [0.0, 5.0]
