"""Aerodynamic tables of DAVE-ML."""

import math

import numpy as np
import pytest
from numpy.testing import assert_allclose

from sepmc.formats.daveml import read_daveml
from sepmc.formats.files import read_files
from sepmc.formats.text_table import FormatError
from sepmc.scene.as_brought import convert_tree
from sepmc.scene.messages import Problems

HEAD = """<?xml version="1.0"?>
<!DOCTYPE DAVEfunc PUBLIC "-//NASA//DTD for Flight Dynamic Models 2.0//EN" "DAVEfunc.dtd">
<DAVEfunc xmlns="http://daveml.org/2010/DAVEML">
<variableDef name="machNumber" varID="M" units="nd"/>
<variableDef name="angleOfAttack" varID="al" units="deg"/>
<variableDef name="angleOfSideslip" varID="be" units="rad"/>
<variableDef name="elevator" varID="de" units="deg"/>
"""
GRID = """<variableDef name="{name}" varID="{id}" units="nd">{more}</variableDef>
<breakpointDef bpID="{id}M"><bpVals>{mach}</bpVals></breakpointDef>
<breakpointDef bpID="{id}A" units="deg"><bpVals>{alpha}</bpVals></breakpointDef>
<griddedTableDef gtID="{id}T"><breakpointRefs><bpRef bpID="{id}M"/><bpRef bpID="{id}A"/>
</breakpointRefs><dataTable>{values}</dataTable></griddedTableDef>
<function name="{id}"><independentVarRef varID="M"/><independentVarRef varID="{second}"/>
<dependentVarRef varID="{id}"/><functionDefn><griddedTableRef gtID="{id}T"/></functionDefn>
</function>
"""
BODY = {"Z": "aeroBodyForceCoefficient_Z", "X": "aeroBodyForceCoefficient_X"}


def grid(name, mach, alpha, values, second="al", more="", identity=None):
    return GRID.format(
        name=name,
        id=identity or name[-1],
        mach=", ".join(map(str, mach)),
        alpha=" ".join(map(str, alpha)),
        values="\n".join(", ".join(map(str, row)) for row in values),
        second=second,
        more=more,
    )


def points(name, title, variable, x, y):
    return (
        f'<variableDef name="{title}" varID="{name}" units="nd"/><function name="{name}">'
        f'<independentVarPts varID="{variable}">{x}</independentVarPts>'
        f'<dependentVarPts varID="{name}">{y}</dependentVarPts></function>'
    )


def read(tmp_path, *parts, **options):
    path = tmp_path / "m.dml"
    path.write_text(HEAD + "".join(parts) + "</DAVEfunc>")
    return read_daveml(path, options)


def test_last_breakpoint_changes_fastest_and_z_points_down(tmp_path):
    values = [[-1.0, 0.5, 2.0], [-3.0, 0.25, 4.0]]
    table, understood = read(tmp_path, grid(BODY["Z"], (0.5, 2), (-5, 0, 10), values))
    assert table["mach"] == [0.5, 2.0]
    assert table["alpha_deg"] == [-5.0, 0.0, 10.0]
    assert_allclose(table["normal"], -np.array(values))
    assert table["interpolation"] == "linear"
    assert "linear between the rows" in understood[1]


def test_tables_of_other_points_meet_on_all_of_them(tmp_path):
    """Linear tables are the same there: values between the rows by hand; ends are kept."""
    table, _ = read(
        tmp_path,
        grid(BODY["Z"], (1, 3), (0, 10), [[0.0, -1.0], [0.0, -3.0]]),
        grid(BODY["X"], (1, 2), (0, 4), [[-0.5, -0.7], [-0.9, -1.1]]),
    )
    assert table["mach"] == [1.0, 2.0, 3.0]
    assert table["alpha_deg"] == [0.0, 4.0, 10.0]
    assert_allclose(table["normal"], [[0.0, 0.4, 1.0], [0.0, 0.8, 2.0], [0.0, 1.2, 3.0]])
    assert_allclose(table["axial"], [[0.5, 0.7, 0.7], [0.9, 1.1, 1.1], [0.9, 1.1, 1.1]])


def test_side_force_to_the_right_turns_its_sign(tmp_path):
    table, _ = read(tmp_path, points("cy", "aeroBodyForceCoefficient_Y", "be", "-1 1", "0.5 -0.5"))
    assert_allclose(table["beta_deg"], np.degrees([-1.0, 1.0]))
    assert_allclose(table["side"], [-0.5, 0.5])


@pytest.mark.parametrize(
    ("title", "sign", "key", "turned"),
    [
        ("aeroBodyForceCoefficient_Y", "", "side", -1.0),
        ("sideforce", "right", "side", -1.0),
        ("CY", "", "side", -1.0),
        ("CY", "+LEFT", "side", 1.0),
        ("CZ0", "down", "normal", -1.0),
        ("CZ0", "", "normal", -1.0),
        ("cz_up", "UP", "normal", 1.0),
        ("cxt", "FWD", "axial", -1.0),
        ("Cl0", "LWD", "roll", -1.0),
        ("Cm0", "nose up", "pitch", 1.0),
        ("Cn0", "ANR", "yaw", 1.0),
        ("CYr", "right/+right", "side_r", -1.0),
        ("Cmq", "up/+down", "pitch_q", -1.0),
    ],
)
def test_signs_of_the_file_count_for_named_variables(tmp_path, title, sign, key, turned):
    """As for those found by their names; a scale of the campaign is on top."""
    table = points("v", title, "be", "-1 1", "0.5 -0.25")
    table = table.replace("units", f'sign="{sign}" units' if sign else "units", 1)
    tree, understood = read(tmp_path, table, columns={key: "v"})
    assert_allclose(tree[key], turned * np.array([0.5, -0.25]))
    assert (f"{key} = -v" in " ".join(understood)) == (turned < 0.0)
    scaled, understood = read(tmp_path, table, columns={key: {"column": "v", "scale": -2.0}})
    assert_allclose(scaled[key], -2.0 * np.array(tree[key]))
    assert "times scale = -2" in " ".join(understood)


def test_a_sign_that_the_file_does_not_state_is_named(tmp_path):
    table = points("v", "sideforce", "be", "-1 1", "0.5 -0.25")
    tree, understood = read(tmp_path, table, columns={"side": "v"})
    assert_allclose(tree["side"], [0.5, -0.25])
    assert "sign NOT stated by the file and taken as it stands: side = v (positive left)" in (
        " ".join(understood)
    )
    wind = table.replace("units", 'axisSystem="wind" units', 1)
    with pytest.raises(FormatError, match="axisSystem = 'wind': side must be in body axes"):
        read(tmp_path, wind, columns={"side": "v"})


@pytest.mark.parametrize(("title", "side"), [("aeroBodyForceCoefficient_Y", -1), ("force", -1)])
def test_a_side_force_is_turned_once(tmp_path, title, side):
    """By the file or, where it is silent, by convention = "datcom"."""
    (tmp_path / "m.dml").write_text(
        HEAD + points("v", title, "be", "-1 1", "0.5 -0.25") + "</DAVEfunc>"
    )
    table = {"file": "m.dml", "columns": {"side": "v"}}
    tree = {"body": {"b": {"aerodynamics": {"table": table, "convention": "datcom"}}}}
    problems = Problems()
    read_files(tree, tmp_path, problems)
    convert_tree(tree, problems)
    assert not problems
    assert_allclose(table["side"], side * np.array([0.5, -0.25]))


def test_variables_are_named_by_columns(tmp_path):
    parts = points("cm_sym", "CLM_sym", "de", "-20 20", "0.1 -0.1")
    with pytest.raises(FormatError, match=r"has no table over .*tables: cm_sym"):
        read(tmp_path, parts)
    columns = {"alpha": "elevator", "pitch": {"column": "CLM_sym", "scale": 2.0}}
    table, _ = read(tmp_path, parts, columns=columns)
    assert_allclose(table["pitch"], [0.2, -0.2])
    with pytest.raises(FormatError, match=r"columns\.pitch: no variable 'CLM'"):
        read(tmp_path, parts, columns=columns | {"pitch": "CLM"})


def test_contributions_to_formulas_are_no_coefficients(tmp_path):
    """Unless the campaign names them."""
    formula = (
        '<variableDef name="total" varID="t" units="nd"><calculation><math><apply><plus/>'
        "<ci>cm</ci><ci>de</ci></apply></math></calculation><isOutput/></variableDef>"
    )
    parts = points("cm", "Cm", "al", "-5 5", "0.1 -0.1"), formula
    with pytest.raises(FormatError, match="has no table over"):
        read(tmp_path, *parts)
    table, understood = read(tmp_path, *parts, columns={"pitch": "cm"})
    assert_allclose(table["pitch"], [0.1, -0.1])
    assert "NOT in the table, as they follow from formulas: total" in understood


def test_campaign_chooses_the_interpolation(tmp_path):
    (tmp_path / "m.dml").write_text(HEAD + points("cm", "Cm", "al", "-5 5", "1 2") + "</DAVEfunc>")
    for own, expected in [({}, "linear"), ({"interpolation": "cubic"}, "cubic")]:
        table = {"file": "m.dml"} | own
        problems = Problems()
        read_files({"body": {"b": {"aerodynamics": {"table": table}}}}, tmp_path, problems)
        assert not problems
        assert table["interpolation"] == expected


@pytest.mark.parametrize(
    ("change", "reason"),
    [
        (("<DAVEfunc", "<DAVE"), "must be DAVEfunc"),
        (("0.1 -0.1", "0.1"), "line 8: dependentVarPts = '0.1': must be 2 finite numbers"),
        (("-5 5", "5 -5"), "the points of al do not rise"),
        (('<independentVarPts varID="al"', '<independentVarPts varID="x"'), "no variableDef of"),
        (("<independentVarPts", '<independentVarPts interpolate="cubicSpline"'), "must be linear"),
        (("-5 5", "-5 inf"), "must be some finite numbers"),
    ],
)
def test_faults_are_named(tmp_path, change, reason):
    text = HEAD + points("cm", "Cm", "al", "-5 5", "0.1 -0.1") + "</DAVEfunc>"
    path = tmp_path / "m.dml"
    path.write_text(text.replace(*change).replace("</DAVEfunc>", f"</{change[1][1:]}>" if
                    change[0] == "<DAVEfunc" else "</DAVEfunc>"))  # fmt: skip
    with pytest.raises(FormatError, match=reason):
        read_daveml(path, {})


@pytest.mark.parametrize("title", ["CM", "Cm"])
def test_one_of_two_functions_of_a_coefficient_is_chosen(tmp_path, title):
    """Of one title, or of two that mean the same; and both as two coefficients."""
    parts = [points("a", "CM", "al", "-1 1", "1 -1"), points("b", title, "al", "-1 1", "2 -2")]
    with pytest.raises(FormatError, match=r"too: choose by columns\.pitch"):
        read(tmp_path, *parts)
    table, understood = read(tmp_path, *parts, columns={"pitch": "b"})
    assert_allclose(table["pitch"], [2.0, -2.0])
    assert "not read, as columns names others: a" in understood
    table, _ = read(tmp_path, *parts, columns={"pitch": "b", "yaw": "a"})
    assert_allclose([table["pitch"], table["yaw"]], [[2.0, -2.0], [1.0, -1.0]])


def test_one_of_two_variables_of_an_axis_is_chosen(tmp_path):
    parts = [
        '<variableDef name="alpha" varID="a2" units="deg"/>',
        points("a", "CM", "al", "-1 1", "1 -1"),
        points("b", "CN", "a2", "-2 2", "2 -2"),
    ]
    with pytest.raises(FormatError, match="al and a2 are both alpha: choose one by columns"):
        read(tmp_path, *parts)
    table, _ = read(tmp_path, *parts, columns={"alpha": "a2"})
    assert (table["alpha_deg"], table.get("pitch")) == ([-2.0, 2.0], None)


def test_unknown_keys_of_columns_are_refused(tmp_path):
    """Of the table of one variable, and a coefficient, also if its variable is not read."""
    table = points("cm", "CM", "al", "-1 1", "1 -1")
    for columns, message in (
        (
            {"pitch": {"column": "cm", "factor": 2}},
            r"columns\.pitch\.factor: unknown key; allowed: ",
        ),
        ({"colour": "M"}, r"columns\.colour: no such coefficient"),
    ):
        with pytest.raises(FormatError, match=message):
            read(tmp_path, table, columns=columns)


@pytest.mark.parametrize("scale", [True, math.nan, math.inf, "2"])
def test_a_scale_that_is_no_finite_number_is_refused(tmp_path, scale):
    table = points("cm", "Cm", "al", "-5 5", "0.1 -0.1")
    with pytest.raises(FormatError, match=r"columns.pitch: must be a variable, or"):
        read(tmp_path, table, columns={"pitch": {"column": "cm", "scale": scale}})


def test_an_unknown_coefficient_is_refused(tmp_path):
    with pytest.raises(FormatError, match=r"columns\.side_z: no such coefficient"):
        read(tmp_path, points("v", "CY", "be", "-1 1", "1 -1"), columns={"side_z": "v"})
