"""Outputs of DATCOM, of files written here in their form: values, signs, lengths, what is left."""

import math

import numpy as np
import pytest
from numpy.testing import assert_allclose
from small_scenes import PAIR

import sepmc
from sepmc.formats.datcom import _chosen, _references, parse_datcom
from sepmc.formats.text_table import FormatError
from sepmc.scene.messages import SceneError

DEGREE = 180.0 / math.pi


def missile(machs=(0.8, 1.2), case=1, per="RADIAN", cards=True):
    """Pages of Missile DATCOM for a case: C_N = 10 alpha (1 + Mach), C_Y = -2 beta."""
    lines = [f"1         ***** THE USAF AUTOMATED MISSILE DATCOM *****     CASE   {case}"]
    if cards:
        lines += ["   11  $REFQ SREF=0.0127, LREF=0.05, LATREF=0.2,$", "   47 DIM M"]
    for mach in machs:
        lines += [
            f"     MACH NO  =       {mach:.2f}                REYNOLDS NO = 2.318E+06 /M",
            "     SIDESLIP =       0.00 DEG                   ROLL =      0.00 DEG     ",
            "     REF AREA =      0.013 M**2         MOMENT CENTER =     0.446 M",
            "         ALPHA       CN        CM        CA        CY       CLN       CLL",
            "",
        ]
        for alpha in (-5.0, 0.0, 5.0):
            normal = 10.0 * math.radians(alpha) * (1.0 + mach)
            lines.append(
                f"       {alpha:7.2f}  {normal:8.3f}  {-normal:8.3f}     0.300     0.000     0.000"
                "     0.000"
            )
        lines += [
            "         ALPHA       CL        CD      CL/CD     X-C.P.",
            "         -5.00     1.000     0.300     3.000    -4.000",
            "",
            f"                   ---------- DERIVATIVES (PER {per}) ----------",
            "         ALPHA       CNA         CMA         CYB         CLNB        CLLB",
        ]
        lines += [f"       {a:7.2f}  9.0  -9.0  -2.0  1.0  -0.1" for a in (-5.0, 0.0, 5.0)]
        lines += [
            f"                    ------------ DYNAMIC DERIVATIVES (PER {per}) -----------",
            "         ALPHA       CNQ        CMQ        CAQ       CNAD       CMAD",
        ]
        lines += [f"       {a:7.2f}  8.0  -40.0  0.5  7.0  -20.0" for a in (-5.0, 0.0, 5.0)]
        lines += ["         ALPHA       CYR       CLNR       CLLR        CYP       CLNP       CLLP"]
        lines += [f"       {a:7.2f}  5.0  -7.0  0.2  0.1  -0.2  -0.5" for a in (-5.0, 0.0, 5.0)]
        lines += ["    YAW AND ROLL RATE DERIVATIVES NON-DIMENSIONALIZED BY R*LATREF/2*V"]
    return "\n".join(lines) + "\n"


DIGITAL = """
1                               AUTOMATED STABILITY AND CONTROL METHODS PER 1976 VERSION OF DATCOM
 -----------------------  FLIGHT CONDITIONS  ------------------------           --------------  REFERENCE DIMENSIONS  ------------
  MACH    ALTITUDE   VELOCITY    PRESSURE    TEMPERATURE     REYNOLDS             REF.      REFERENCE LENGTH   MOMENT REF. CENTER
 NUMBER                                                       NUMBER              AREA       LONG.     LAT.     HORIZ      VERT
0 0.500                                                    4.2600E+06             2.250      0.800     3.000     2.600     0.000
0                                                               -------------------DERIVATIVE (PER DEGREE)-------------------
0 ALPHA     CD       CL       CM       CN       CA       XCP        CLA          CMA          CYB          CNB          CLB
0
   -2.0    0.020   -0.140    0.0300  -0.141    0.015   -0.170    7.000E-02   -1.100E-02   -2.000E-03   -1.500E-03    5.000E-04
    0.0    0.018    0.000    0.0000   0.000    0.018   ******    7.000E-02   -1.100E-02                              0.000E+00
    2.0    0.020    0.140   -0.0300   0.141    0.015   -0.170    7.000E-02   -1.100E-02                             -5.000E-04
   20.0             1.100   -0.4000                              1.700E-02   -1.900E-02                             -4.000E-03
0                                    ALPHA     Q/QINF    EPSLON  D(EPSLON)/D(ALPHA)
0
                                     -2.0      0.944     -1.234        0.617
"""  # noqa: E501


def test_missile_datcom():
    """Every coefficient, slopes by beta as lines, derivatives by rates; C_L and C_D left."""
    table, said = parse_datcom(missile(), {})
    assert table["mach"] == [0.8, 1.2]
    assert table["alpha_deg"] == [-5.0, 0.0, 5.0]
    assert table["beta_deg"] == [-30.0, 0.0, 30.0]
    assert_allclose(np.array(table["normal"])[1, 2], round(10.0 * math.radians(5.0) * 2.2, 3))
    assert_allclose(table["axial"], 0.3)
    assert_allclose(np.array(table["side"])[0, 0], -2.0 * np.radians([-30.0, 0.0, 30.0]))
    assert_allclose(np.array(table["yaw"])[0, 0, 2], math.radians(30.0))
    assert_allclose(table["pitch_q"], -40.0)
    assert_allclose(table["roll_p"], -0.5)
    assert_allclose(table["side_r"], 5.0)
    assert "2 rows of mach, 3 rows of alpha, 3 rows of beta" in said[0]


def test_derivatives_per_degree():
    table, _ = parse_datcom(missile(per="DEGREE"), {"sideslip_deg": 10.0})
    assert_allclose(table["pitch_q"], -40.0 * DEGREE)
    assert_allclose(np.array(table["side"])[0, 0, 2], -2.0 * 10.0)


def test_digital_datcom():
    """Blank columns stay blank: CYB and CNB are printed once, CN and CA not at 20 deg."""
    table, said = parse_datcom(DIGITAL, {})
    assert table["alpha_deg"] == [-2.0, 0.0, 2.0]
    assert_allclose(np.array(table["normal"])[0, :, 1], [-0.141, 0.0, 0.141])
    assert_allclose(np.array(table["axial"])[0, :, 1], [0.015, 0.018, 0.015])
    assert_allclose(np.array(table["pitch"])[0, :, 1], [0.03, 0.0, -0.03])
    assert_allclose(np.array(table["side"])[0, :, 2], -0.002 * 30.0)
    assert_allclose(np.array(table["roll"])[0, :, 2], [0.015, 0.0, -0.015])
    assert any("not read, as CN or CA is blank there: alpha = 20" in one for one in said)


HEADING = """1                               AUTOMATED STABILITY AND CONTROL METHODS PER 1976 VERSION OF DATCOM
                                         CHARACTERISTICS AT ANGLE OF ATTACK AND IN SIDESLIP
                                                   {} CONFIGURATION
"""  # noqa: E501
CARDS = "1          THE FOLLOWING IS A LIST OF ALL INPUT CARDS FOR THIS CASE.\n0\n"


def page(configuration="WING-BODY", normal=0.141, title="", **changes):
    """A page of Digital DATCOM with that CN at 2 deg; ``changes``: other numbers of its table."""
    text = DIGITAL.split("\n", 2)[2].replace(
        " 0.140   -0.0300   0.141", f" 0.140   -0.0300   {normal}"
    )
    for old, new in changes.values():
        text = text.replace(old, new)
    return HEADING.format(configuration) + f"          {title}\n" * bool(title) + text


def cards(*lines):
    return CARDS + "".join(f" {line}\n" for line in lines) + " NEXT CASE\n"


def at_two_degrees(text, **options):
    table, understood = parse_datcom(text, options)
    return np.array(table["normal"])[0, -1, 1], " ".join(understood)


def test_cases_of_digital_datcom():
    """Each list of input cards with a name of its own begins a case; the user must choose."""
    text = cards(" $BODY NX=8.0$", "CASEID FLAPS", "SAVE") + page(title="FLAPS")
    text += cards(" $SYMFLP FTYPE=1.0$", "CASEID TOTAL", "SAVE") + page(normal=0.2, title="TOTAL")
    with pytest.raises(FormatError, match=r"has 2 cases; .*, of 1 \(FLAPS\), 2 \(TOTAL\)"):
        parse_datcom(text, {})
    assert at_two_degrees(text, case=1)[0] == 0.141
    assert at_two_degrees(text, case=2)[0] == 0.2
    assert "case 'TOTAL'" in at_two_degrees(text, case=2)[1]
    with pytest.raises(FormatError, match=r"has no case 3; known: 1 \(FLAPS\), 2"):
        parse_datcom(text, {"case": 3})
    # the same without the lists, by the titles of the pages
    pages = page(title="FLAPS") + page(normal=0.2, title="TOTAL")
    assert at_two_degrees(pages, case=2)[0] == 0.2


def test_a_vehicle_with_more_mach_numbers_is_one_case():
    """Input cards of flight conditions continue the case before; others begin a new one."""
    first = cards(" $BODY NX=8.0$", "CASEID ROCKET", "SAVE") + page()
    other = page(mach=("0 0.500", "0 0.700"))
    table, _ = parse_datcom(first + cards(" $FLTCON MACH(1)=0.7$", "DAMP") + other, {})
    assert table["mach"] == [0.5, 0.7]
    with pytest.raises(FormatError, match="has 2 cases"):
        parse_datcom(first + cards(" $WGPLNF CHRDR=3.0$") + other, {})


def test_the_last_configuration_of_a_case_is_taken():
    text = page("WING ALONE", 0.1) + page("BODY ALONE", 0.12) + page("WING-BODY")
    normal, understood = at_two_degrees(text)
    assert normal == 0.141
    assert "WING-BODY, the last of its case; NOT read: WING ALONE, BODY ALONE" in understood
    assert at_two_degrees(text, configuration="Wing alone")[0] == 0.1
    with pytest.raises(
        FormatError, match="no table of the configuration 'TAIL'; known: WING ALONE"
    ):
        parse_datcom(text, {"configuration": "TAIL"})
    # blank at the last Mach number, where the wing alone has values: still not the wing
    blank = page("WING-BODY", mach=("0 0.500", "0 0.700"), a=(" -0.141 ", "  NDM   "),
                 b=(" 0.141 ", " NDM   "), c=(" 0.000    0.018 ", " NDM      NDM  "))  # fmt: skip
    text += page("WING ALONE", 0.1, mach=("0 0.500", "0 0.700")) + blank
    assert at_two_degrees(text)[0] == 0.141


def test_two_values_at_one_point_are_refused():
    """Such as those of two altitudes, which the conditions of flight tell apart."""
    low = ("0 0.500                     ", "0 0.500 0.0 600. 2.E+03 518. ")
    high = ("0 0.500                     ", "0 0.500 9000.0 600. 2.E+03 518. ")
    text = page(altitude=low) + page(normal=0.15, altitude=high)
    with pytest.raises(FormatError, match=r"is 0\.15 \(WING-BODY, ALTITUDE 9000\.0\), but 0\.141"):
        parse_datcom(text, {})
    assert at_two_degrees(text, configuration="ALTITUDE 9000")[0] == 0.15
    assert at_two_degrees(text + page(altitude=low), configuration="ALTITUDE 0.0")[0] == 0.141


def test_two_reference_areas_in_a_case_are_refused():
    text = page() + page(mach=("0 0.500", "0 0.700"), area=(" 2.250 ", " 8.850 "))
    with pytest.raises(FormatError, match=r"REF AREA 2\.250 at Mach .* and 8\.850 at Mach"):
        parse_datcom(text, {})


def test_derivatives_by_the_rate_of_alpha_are_named():
    assert "NOT read: CNAD, CMAD, derivatives by the rate of" in " ".join(
        parse_datcom(missile(), {})[1]
    )


def test_one_of_several_cases():
    text = missile() + missile(case=2).replace("0.300", "0.400")
    with pytest.raises(FormatError, match="has 2 cases; choose one by case = NUMBER, of 1, 2"):
        parse_datcom(text, {})
    assert_allclose(parse_datcom(text, {"case": 2})[0]["axial"], 0.4)
    with pytest.raises(FormatError, match="has no case 3; known: 1, 2"):
        parse_datcom(text, {"case": 3})


@pytest.mark.parametrize(
    ("text", "reason"),
    [
        ("DATCOM\nnothing\n", "has no table of coefficients"),
        (missile().replace("       CN ", "       CX "), "has no table of CN and CA"),
    ],
)
def test_outputs_that_are_refused(text, reason):
    with pytest.raises(FormatError, match=reason):
        parse_datcom(text, {})


@pytest.mark.parametrize("sideslip", [True, math.nan, math.inf, "30", 0.0, 90.0])
def test_a_sideslip_that_is_no_angle_is_refused(sideslip):
    with pytest.raises(FormatError, match="sideslip_deg must be an angle above 0, below 90"):
        parse_datcom(missile(), {"sideslip_deg": sideslip})


AERO = """
[body.aft.aerodynamics]
reference_area_m2 = 0.0127
reference_length_m = 0.05
MORE
table = { file = "for006.dat" }
"""


def loaded(folder, text, more="", old="", new=""):
    (folder / "for006.dat").write_text(text)
    (folder / "c.toml").write_text(PAIR + AERO.replace("MORE", more).replace(old, new))
    return sepmc.load(folder / "c.toml")


@pytest.mark.parametrize("more", ["", 'convention = "datcom"'])
def test_a_deck_of_a_campaign(tmp_path, more):
    """C_Y turned once, moments and rates from the lateral length (four times) to the other."""
    campaign = loaded(tmp_path, missile(), more)
    table = campaign.scene.body["aft"].aerodynamics.table
    assert_allclose(np.array(table.side)[0, 0], 2.0 * np.radians([-30.0, 0.0, 30.0]))
    assert_allclose(np.array(table.yaw)[0, 0, 2], 4.0 * math.radians(30.0))
    assert_allclose(table.yaw_r, 16.0 * -7.0)
    assert_allclose(table.side_r, -4.0 * 5.0)
    assert_allclose(table.roll_p, 16.0 * -0.5)
    assert_allclose(table.pitch_q, -40.0)
    said = " ".join(campaign.file.understood)
    assert "C_Y taken as DATCOM's" in said
    assert "sign turned" in said
    assert "times 4" in said


def test_other_reference_quantities_are_refused(tmp_path):
    with pytest.raises(SceneError, match=r"has the reference area 0.0127 m2, but reference_area"):
        loaded(tmp_path, missile(), old="0.0127", new="0.0314")
    with pytest.raises(SceneError, match="states itself which slopes are per degree: leave per"):
        loaded(tmp_path, missile(), 'per = "deg"')


@pytest.mark.parametrize(
    ("more", "sentence"),
    [
        ("", "but taken about the centre of mass: give moment_point_m"),
        ("moment_point_m = [1.2, 0, 0]", "but taken about moment_point_m = [1.2, 0, 0]: these"),
        ("moment_point_mm = [446, 0, 0]", None),
    ],
)
@pytest.mark.parametrize("unit", ["M", "FT"])
def test_the_moment_centre_is_compared(tmp_path, more, sentence, unit):
    text = missile()
    if unit == "FT":
        text = text.replace("0.446 M", "1.463 FT")
    understood = " ".join(loaded(tmp_path, text, more).file.understood)
    assert ("its moments are about MOMENT CENTER" in understood) == (sentence is not None)
    assert (sentence or "") in understood


def test_printed_reference_quantities_count_where_no_card_gives_them(tmp_path):
    """DATCOM takes the largest section without SREF; printed digits are half a unit off."""
    text = missile(cards=False)
    loaded(tmp_path, text, old="0.0127", new="0.01275")
    with pytest.raises(SceneError, match=r"has the reference area 0.013 m2, but reference_area"):
        loaded(tmp_path, text, old="0.0127", new="0.0141")
    # a card of another case is not of this one
    other = text + missile(case=2).replace("0.013 M**2", "0.050 M**2").replace("0.0127", "0.05")
    loaded(tmp_path, other.replace("DIM M", "DIM M "), old='"for006.dat"',
           new='"for006.dat", case = 1')  # fmt: skip


@pytest.mark.parametrize(("unit", "metre"), [("FT", 0.3048), ("M", 1.0)])
def test_printed_lengths_of_digital_datcom(tmp_path, unit, metre):
    """Lateral over long length is 3.75, of lines without cards; lengths are of the unit above."""
    units = f"             {unit}       {unit}/SEC     LB/FT**2       DEG R         1/{unit}     "
    units += f"         {unit}**2        {unit}        {unit}        {unit}        {unit}\n0 0.500 "
    text = DIGITAL.replace("0 0.500 ", units)
    area, length = f"{2.25 * metre**2!r}", f"{0.8 * metre!r}"
    more = AERO.replace("0.0127", area).replace("0.05", length).replace("MORE", "")
    (tmp_path / "for006.dat").write_text(text)
    (tmp_path / "c.toml").write_text(PAIR + more)
    table = sepmc.load(tmp_path / "c.toml").scene.body["aft"].aerodynamics.table
    roll = parse_datcom(text, {})[0]["roll"]
    assert_allclose(np.squeeze(table.roll), 3.75 * np.squeeze(roll))
    (tmp_path / "c.toml").write_text(PAIR + more.replace(length, "0.9"))
    with pytest.raises(SceneError, match="has the reference length 0"):
        sepmc.load(tmp_path / "c.toml")


def test_lengths_of_too_few_digits_are_refused(tmp_path):
    lines = "     REF LENGTH =     0.05 M           LAT REF LENGTH =      0.20 M\n     SIDESLIP"
    text = missile(cards=False).replace("     SIDESLIP", lines)
    with pytest.raises(
        SceneError, match=r"with too few digits, 0\.2 and 0\.05 m; give lateral_len"
    ):
        loaded(tmp_path, text, old="0.0127", new="0.013")
    loaded(tmp_path, text, "lateral_length_m = 0.2", old="0.0127", new="0.013")


@pytest.mark.parametrize(
    ("old", "new"),
    [
        ("REF AREA =      0.013", "REF AREA =      0..13"),
        ("SIDESLIP =       0.00", "SIDESLIP =       0..0"),
        ("MACH NO  =       0.80", "MACH NO  =       0.8.0"),
        ("         -5.00 ", "           NDM "),
        ("SREF=0.0127", "SREF=1..7"),
        ("-0.5", "1e999"),
    ],
)
def test_damaged_outputs(old, new):
    """Read without what is damaged, or refused; no traceback."""
    try:
        text = missile().replace(old, new)
        table, _ = parse_datcom(text, {})
        _references(text, _chosen(text, {})[0])
    except FormatError:
        return
    assert all(np.isfinite(values).all() for values in table.values())
