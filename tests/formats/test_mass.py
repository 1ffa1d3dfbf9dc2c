"""Mass properties from URDF, MJCF and JSBSim: each of the same body, made of points."""

import math

import numpy as np
import pytest
from numpy.testing import assert_allclose
from scipy.spatial.transform import Rotation
from small_scenes import SPRUNG

import sepmc
from sepmc.formats.files import read_files
from sepmc.formats.mass import read_mass
from sepmc.formats.text_table import FormatError
from sepmc.scene.as_brought import convert_tree
from sepmc.scene.messages import Problems

# a lopsided body: masses, kg, and points, m, in axes forward, up, right from the nose backwards
MASSES = np.array([120.0, 80.0, 60.0, 40.0])
POINTS = np.array([[-1.0, 0.3, 0.2], [-2.5, -0.2, 0.4], [-1.7, 0.5, -0.6], [-3.0, -0.4, -0.1]])
MASS = float(MASSES.sum())
CENTER = MASSES @ POINTS / MASS
FROM_CENTER = POINTS - CENTER
SQUARES = np.einsum("k,ki,kj->ij", MASSES, FROM_CENTER, FROM_CENTER)
MOMENTS = np.trace(SQUARES) - np.diag(SQUARES)  # Ixx, Iyy, Izz
PRODUCTS = SQUARES[0, 1], SQUARES[0, 2], SQUARES[1, 2]  # positive integrals

# directions of other axes in forward, up, right: rows
FIELD = {
    "forward-left-up": np.array([[1, 0, 0], [0, 0, -1], [0, 1, 0]]),
    "forward-right-down": np.array([[1, 0, 0], [0, 0, 1], [0, -1, 0]]),
    "aft-right-up": np.array([[-1, 0, 0], [0, 0, 1], [0, 1, 0]]),
}


def in_axes(name):
    """Center and tensor about it, in other axes, from the points themselves."""
    points = FROM_CENTER @ FIELD[name].T
    tensor = sum(
        m * (p @ p * np.eye(3) - np.outer(p, p)) for m, p in zip(MASSES, points, strict=True)
    )
    return FIELD[name] @ CENTER, tensor


def numbers(values):
    return " ".join(f"{float(x)!r}" for x in values)


def urdf(angles=(0.0, 0.0, 0.0), name="stage"):
    center, tensor = in_axes("forward-left-up")
    turn = Rotation.from_euler("xyz", angles).as_matrix()
    own = turn.T @ tensor @ turn
    entries = {"ixx": own[0, 0], "iyy": own[1, 1], "izz": own[2, 2],
               "ixy": own[0, 1], "ixz": own[0, 2], "iyz": own[1, 2]}  # fmt: skip
    inertia = " ".join(f'{k}="{float(v)!r}"' for k, v in entries.items())
    return (
        f'<link name="{name}"><inertial>\n<origin xyz="{numbers(center)}" rpy="{numbers(angles)}"/>'
        f'<mass value="{MASS}"/>\n<inertia {inertia}/></inertial></link>'
    )


def mjcf(inertia, compiler=""):
    center, _ = in_axes("forward-left-up")
    return (
        f"<mujoco>\n{compiler}<worldbody><body><body name='stage'>\n"
        f'<inertial pos="{numbers(center)}" mass="{MASS}" {inertia}/></body></body></worldbody>'
        "</mujoco>"
    )


def jsbsim(sign=None, unit=True):
    center, tensor = in_axes("aft-right-up")
    factor = -1.0 if sign == "false" else 1.0
    attribute = f' negated_crossproduct_inertia="{sign}"' if sign else ""
    size, kind = (1.0, ' unit="KG*M2"') if unit else (1.3558179483314004, "")
    length, inch = (1.0, ' unit="M"') if unit else (0.0254, "")
    kilogram, pound = (1.0, ' unit="KG"') if unit else (0.45359237, "")
    rows = {"ixx": tensor[0, 0], "iyy": tensor[1, 1], "izz": tensor[2, 2],
            "ixy": factor * tensor[0, 1], "ixz": factor * tensor[0, 2],
            "iyz": factor * tensor[1, 2]}  # fmt: skip
    lines = [f"<{k}{kind}> {float(v / size)!r} </{k}>" for k, v in rows.items()]
    x, y, z = (float(c / length) for c in center)
    return "\n".join(
        ["<?xml version='1.0'?>", "<fdm_config>", f"<mass_balance{attribute}>", *lines,
         f"<emptywt{pound}> {MASS / kilogram!r} </emptywt>", f'<location name="CG"{inch}>',
         f"<x> {x!r} </x><y> {y!r} </y><z> {z!r} </z></location>", "</mass_balance>",
         "</fdm_config>"]
    )  # fmt: skip


def principal():
    """Principal moments of the body, and the axes in columns, a right-handed triad."""
    values, axes = np.linalg.eigh(in_axes("forward-left-up")[1])
    return values, axes * np.linalg.det(axes)


def body_of(tmp_path, text, **options):
    """The body of a campaign that names a file, as the model has it."""
    (tmp_path / "m.xml").write_text(text)
    tree = {"body": {"upper": {"mass_properties": {"file": "m.xml"} | options}}}
    problems = Problems()
    understood = read_files(tree, tmp_path, problems) + convert_tree(tree, problems)
    problems.raise_if_any("test")
    return tree["body"]["upper"], understood


def check(body):
    assert_allclose(body["mass_kg"], MASS)
    assert_allclose(body["cg_m"], [-CENTER[0], CENTER[1], CENTER[2]], atol=1e-12)
    assert_allclose(body["inertia_kg_m2"], MOMENTS, rtol=1e-12)
    assert_allclose(body["inertia_products_kg_m2"], PRODUCTS, rtol=1e-9, atol=1e-9)
    assert set(body) == {"mass_kg", "cg_m", "inertia_kg_m2", "inertia_products_kg_m2"}


@pytest.mark.parametrize("angles", [(0.0, 0.0, 0.0), (0.3, -0.7, 1.1)])
def test_urdf(tmp_path, angles):
    text = f"<robot name='r'>{urdf(angles)}</robot>"
    body, understood = body_of(tmp_path, text, axes="forward-left-up")
    check(body)
    assert "ixy, ixz, iyz are tensor entries" in understood[0]
    assert ("turned by the rpy" in understood[0]) == any(angles)
    assert "inertia in axes forward-left-up" in understood[1]


def test_link_is_chosen_by_name(tmp_path):
    text = f"<robot>{urdf()}{urdf(name='lower')}<link name='empty'/></robot>"
    check(body_of(tmp_path, text, axes="forward-left-up", link="lower")[0])
    for options, reason in [
        ({}, 'has 2 elements <link>; choose one by link = "NAME": stage, lower'),
        ({"link": "uper"}, "has no link 'uper'"),
    ]:
        with pytest.raises(ValueError, match=reason):
            body_of(tmp_path, text, axes="forward-left-up", **options)


@pytest.mark.parametrize(
    "form", ["full", "quat", "euler", "EULER", "radian", "axisangle", "xyaxes", "zaxis"]
)
def test_mjcf(tmp_path, form):
    tensor, (moments, axes) = in_axes("forward-left-up")[1], principal()
    turn, compiler = Rotation.from_matrix(axes), ""
    how = {
        "quat": lambda: f'quat="{numbers(2.0 * np.roll(turn.as_quat(), 1))}"',
        "euler": lambda: f'euler="{numbers(turn.as_euler("XYZ", degrees=True))}"',
        "EULER": lambda: f'euler="{numbers(turn.as_euler("zyx", degrees=True))}"',
        "radian": lambda: f'euler="{numbers(turn.as_euler("XYZ"))}"',
        "axisangle": lambda: axis_angle(turn),
        "xyaxes": lambda: f'xyaxes="{numbers([*axes[:, 0], *(axes[:, 1] + 0.3 * axes[:, 0])])}"',
    }
    if form == "full":
        entries = [*np.diag(tensor), tensor[0, 1], tensor[0, 2], tensor[1, 2]]
        inertia = f'fullinertia="{numbers(entries)}"'
    elif form == "zaxis":  # with two equal moments, the z axis is enough
        moments = np.array([50.0, 50.0, 20.0])
        inertia = f'diaginertia="{numbers(moments)}" zaxis="{numbers(3.0 * axes[:, 2])}"'
    else:
        inertia = f'diaginertia="{numbers(moments)}" {how[form]()}'
    if form in ("EULER", "radian"):
        compiler = {"EULER": '<compiler eulerseq="ZYX"/>', "radian": '<compiler angle="radian"/>'}[
            form
        ]
    body, _ = body_of(tmp_path, mjcf(inertia, compiler), axes="forward-left-up")
    if form == "zaxis":
        expected = FIELD["forward-left-up"].T @ (
            50.0 * np.eye(3) - 30.0 * np.outer(axes[:, 2], axes[:, 2])
        ) @ FIELD["forward-left-up"]  # fmt: skip
        assert_allclose(body["inertia_kg_m2"], np.diag(expected))
        assert_allclose(body["inertia_products_kg_m2"][0], -expected[0, 1], atol=1e-12)
    else:
        check(body)


def axis_angle(turn):
    vector = turn.as_rotvec()
    angle = np.linalg.norm(vector)
    return f'axisangle="{numbers([*(5.0 * vector / angle), np.degrees(angle)])}"'


@pytest.mark.parametrize("sign", [None, "true", "false"])
@pytest.mark.parametrize("unit", [True, False])
def test_jsbsim(tmp_path, sign, unit):
    body, understood = body_of(tmp_path, jsbsim(sign, unit))
    check(body)
    assert ("positive integrals" in understood[0]) == (sign == "false")


def test_origin_of_the_file_is_a_station(tmp_path):
    text = f"<robot>{urdf()}</robot>"
    body, _ = body_of(tmp_path, text, axes="forward-left-up", origin_m=[4.0, 0.1, -0.2])
    expected = [4.0 - CENTER[0], 0.1 + CENTER[1], -0.2 + CENTER[2]]
    assert_allclose(body["cg_m"], expected)


@pytest.mark.parametrize(
    ("text", "options", "reason"),
    [
        ("<robot/>", {}, "has no link with mass properties"),
        ("<sdf/>", {}, "line 1: the root is 'sdf'; must be robot"),
        ("<robot>\n<link", {}, "line 2: is no XML: unclosed token"),
        ('<!DOCTYPE r [<!ENTITY a "b">]><robot>&a;</robot>', {}, "line 1: has entities of its own"),
        ('<!DOCTYPE r SYSTEM "file:///etc/passwd"><robot>&a;</robot>', {}, "line 1: has entities"),
        ("a" * 9, {}, "is no URDF, MJCF or JSBSim, which are XML; write numbers of a data sheet"),
        ("<a", {}, "line 1: is no XML"),
        ("<r>" * 500, {}, "line 1: elements are nested too deeply"),
        ("{urdf}", {"axes": "up-up-up"}, "must name the directions of x, y and z"),
        ("{urdf}", {}, "must name the directions of x, y and z"),
        ("{urdf}", {"axes": "forward-left-up", "origin_m": 3}, "must be three numbers, as cg_m"),
        (
            "{urdf}",
            {"axes": "forward-left-up", "origin_m": [math.nan, 0.0, 0.0]},
            "must be three numbers, as cg_m",
        ),
        ("{xacro}", {"axes": "forward-left-up"}, "line 2: value = .* expand it by xacro first"),
    ],
)
def test_faults_are_named(tmp_path, text, options, reason):
    filled = text.replace("{urdf}", f"<robot>{urdf()}</robot>")
    xacro = f"<robot>{urdf()}</robot>".replace(f'value="{MASS}"', 'value="${m}"')
    (tmp_path / "m.urdf").write_text(filled.replace("{xacro}", xacro))
    with pytest.raises(FormatError, match=reason):
        read_mass(tmp_path / "m.urdf", options)


@pytest.mark.parametrize(
    ("change", "reason"),
    [
        (("diaginertia", "dia"), "line 3: inertial has no diaginertia"),
        (("<worldbody>", "<compiler inertiafromgeom='true'/><worldbody>"), "has inertiafromgeom"),
        (("<worldbody>", "<compiler boundmass='1000'/><worldbody>"), "has boundmass"),
        (("<worldbody>", "<compiler boundinertia='9'/><worldbody>"), "has boundinertia"),
        (("<worldbody>", "<compiler balanceinertia='true'/><worldbody>"), "has balanceinertia"),
        (("<worldbody>", "<compiler coordinate='global'/><worldbody>"), "has coordinate"),
        (("<inertial", "<joint/><geom"), "has no body with mass properties"),
        (('1.0 0.0 0.0 0.0"', '0 0 0 0"'), "gives no attitude"),
        (('1.0 0.0 0.0 0.0"', '1 0 0"'), "quat = .*: must be 4 finite numbers"),
    ],
)
def test_faults_of_mjcf(tmp_path, change, reason):
    text = mjcf('diaginertia="1 2 2" quat="1.0 0.0 0.0 0.0"').replace(*change)
    (tmp_path / "m.xml").write_text(text)
    with pytest.raises(FormatError, match=reason):
        read_mass(tmp_path / "m.xml", {"axes": "forward-left-up"})


def test_angles_of_a_model_with_includes_are_refused(tmp_path):
    text = mjcf('diaginertia="1 2 2" euler="10 0 0"', "<include file='other.xml'/>")
    (tmp_path / "m.xml").write_text(text)
    with pytest.raises(FormatError, match="line 2: an included file may say how euler is meant"):
        read_mass(tmp_path / "m.xml", {"axes": "forward-left-up"})


def test_unit_that_is_none(tmp_path):
    (tmp_path / "m.xml").write_text(jsbsim().replace("KG*M2", "LB*FT2"))
    with pytest.raises(FormatError, match=r"line 4: ixx is in 'LB\*FT2'; must be in SLUG\*FT2"):
        read_mass(tmp_path / "m.xml", {})


def test_campaign_with_masses_loads(tmp_path):
    (tmp_path / "m.xml").write_text(jsbsim())
    own = SPRUNG.partition("[body.fore]")[2].partition("[body.aft]")[0]
    text = SPRUNG.replace(own, '\nmass_properties = { file = "m.xml" }\n')
    (tmp_path / "c.toml").write_text(text)
    body = sepmc.load(tmp_path / "c.toml").scene.body["fore"]
    assert body.mass == MASS
    assert_allclose(body.inertia_products, PRODUCTS)


def test_keys_beside_the_file_are_refused(tmp_path):
    (tmp_path / "m.xml").write_text(jsbsim())
    table = {"file": "m.xml", "bodies": 2}
    tree = {"body": {"upper": {"mass_properties": table, "mass_t": 1.0}}}
    problems = Problems()
    read_files(tree, tmp_path, problems)
    assert problems == [
        "body.upper.mass_properties.bodies: unknown key; allowed: file, link, axes, origin_m",
        "body.upper.mass_kg: is given by the file too: leave it out here",
    ]
