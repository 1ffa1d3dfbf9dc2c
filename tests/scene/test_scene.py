"""Reading of campaign files: units, parameters by path, settings; any tree gives a campaign or a
message."""

import copy
import inspect
import math
import re
import tomllib
from pathlib import Path

import msgspec
import numpy as np
import pint
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from sepmc.campaign import cases
from sepmc.campaign.campaign import Campaign
from sepmc.kernel.spec.parameter_layout import make_parameter_layout
from sepmc.scene import design_tables, model
from sepmc.scene.campaign_files import shipped_campaigns
from sepmc.scene.fields import convert, fields_of
from sepmc.scene.limits import check_tree
from sepmc.scene.measurements import Measurement
from sepmc.scene.messages import Problems, SceneError
from sepmc.scene.parameters import UnknownPath, find, replace, value
from sepmc.scene.read import parse_campaign, read_campaign
from sepmc.scene.settings import parse_setting
from sepmc.scene.units import UNITS, split_unit

FILE = Path(__file__).parents[2] / "campaigns" / "table2.toml"
TREE = tomllib.loads(FILE.read_text(encoding="utf-8"))
SCENE = parse_campaign(TREE, "t.toml").scene
PINT = {
    "t": "metric_ton",
    "in": "inch",
    "m_s": "m/s",
    "km_s": "km/s",
    "km_h": "km/hour",
    "ft_s": "ft/s",
    "deg_s": "deg/s",
}
PINT |= {
    "rad_s": "rad/s",
    "m_s2": "m/s^2",
    "ft_s2": "ft/s^2",
    "lbf": "force_pound",
    "kg_m2": "kg*m^2",
    "t_m2": "metric_ton*m^2",
}
PINT |= {
    "N_m": "N*m",
    "kN_m": "kN*m",
    "lbf_ft": "force_pound*ft",
    "N_per_m": "N/m",
    "N_per_mm": "N/mm",
    "kN_per_m": "kN/m",
}
PINT |= {
    "lbf_per_in": "force_pound/inch",
    "N_s_per_m": "N*s/m",
    "kN_s_per_m": "kN*s/m",
    "lbf_s_per_in": "force_pound*s/inch",
}
PINT |= {
    "kn": "knot",
    "kg_mm2": "kg*mm^2",
    "kg_cm2": "kg*cm^2",
    "g_cm2": "g*cm^2",
    "lb_ft2": "pound*ft^2",
    "lb_in2": "pound*inch^2",
}
PINT |= {"kg_per_m3": "kg/m^3", "g_per_cm3": "g/cm^3", "slug_per_ft3": "slug/ft^3"}
PINT |= {
    "slug_ft2": "slug*ft^2",
    "in2": "inch^2",
    "m2": "m^2",
    "cm2": "cm^2",
    "mm2": "mm^2",
    "ft2": "ft^2",
    "hz": "hertz",
}


def set_to(**at):
    """table2.toml with other values; ``__`` stands for the dot of a path."""
    return parse_campaign(
        TREE, "t.toml", {key.replace("__", "."): given for key, given in at.items()}
    ).scene


@pytest.mark.parametrize("kind", UNITS)
def test_factors_are_those_of_pint(kind):
    registry = pint.UnitRegistry()
    for suffix, factor in UNITS[kind].items():
        assert factor == pytest.approx(
            registry.Quantity(1.0, PINT.get(suffix, suffix)).to_base_units().magnitude, rel=1e-14
        ), suffix


@pytest.mark.parametrize(
    ("key", "parts"),
    [
        ("mass_kg", ("mass", "kg")),
        ("speed_km_s", ("speed", "km_s")),
        ("inertia_products_kg_m2", ("inertia_products", "kg_m2")),
        ("surface_gravity_m_s2", ("surface_gravity", "m_s2")),
        ("moment_point_mm", ("moment_point", "mm")),
        ("force_factor", ("force_factor", "")),
        ("kg", ("kg", "")),
    ],
)
def test_split_unit(key, parts):
    assert split_unit(key) == parts


def test_to_si():
    """Round numbers scale exactly."""
    upper = SCENE.body["upper"]
    assert (upper.mass, SCENE.initial.speed, SCENE.initial.altitude) == (458.0, 6800.0, 70000.0)
    assert upper.cg == pytest.approx((1.3162, 0.0056, 0.0001), rel=1e-15)
    assert SCENE.motor[0].cant == pytest.approx(math.pi, rel=1e-15)
    assert set_to(body__upper__mass_slug=2.0).body["upper"].mass == pytest.approx(
        29.18780587, rel=1e-9
    )
    assert set_to(motor__retro__thrust_lbf=100.0).motor[0].thrust == pytest.approx(
        444.82216152605, rel=1e-14
    )
    assert set_to(initial__omega_deg_s=[180.0, 0.0, -90.0]).initial.omega == pytest.approx(
        (math.pi, 0.0, -math.pi / 2)
    )
    assert (
        set_to(body__upper__inertia_kg_m2={"xx": 18.6, "yy": 156.3, "zz": 157.2}).body == SCENE.body
    )
    assert set_to(motor__retro__offset_mm={"z": 3.0}).motor[0].offset == (0.0, 0.003)


def test_parameters_round_trip():
    """Every parameter of a kernel can be found, read and replaced by path, and changes no other."""
    layout = make_parameter_layout(SCENE)
    before = {path: value(SCENE, path) for path in layout.slots}
    for path, number in before.items():
        other = replace(SCENE, {path: number + 1.0})
        after = {p: value(other, p) for p in layout.slots}
        assert after == before | {path: number + 1.0}
        assert replace(other, {path: number}) == SCENE


@pytest.mark.parametrize(
    ("key", "path", "unit", "column"),
    [
        ("body.upper.cg_mm.x", "body.upper.cg.x", "mm", "in_body_upper_cg_x_mm"),
        (
            "body.lower.inertia_t_m2.zz",
            "body.lower.inertia.zz",
            "t_m2",
            "in_body_lower_inertia_zz_t_m2",
        ),
        ("motor.retro.thrust_kN", "motor.retro.thrust", "kN", "in_motor_retro_thrust_kN"),
        (
            "phase.guided.until.stroke_m",
            "phase.guided.until.stroke",
            "m",
            "in_phase_guided_until_stroke_m",
        ),
        (
            "body.upper.aerodynamics.pitch.alpha3",
            "body.upper.aerodynamics.pitch.alpha3",
            "",
            "in_body_upper_aerodynamics_pitch_alpha3",
        ),
    ],
)
def test_find(key, path, unit, column):
    result = find(SCENE, key)
    assert (result.key, result.path, result.unit, result.column) == (key, path, unit, column)
    assert result.factor == next((table[unit] for table in UNITS.values() if unit in table), 1.0)


@pytest.mark.parametrize(
    "key",
    [
        "",
        ".",
        "body",
        "body.upper",
        "body.upper.cg_mm",
        "body.upper.mass",
        "body.upper.mass_kg.x",
        "motor.0.thrust_N",
    ],
)
def test_find_nothing(key):
    with pytest.raises(UnknownPath):
        find(SCENE, key)


@pytest.mark.parametrize("name", shipped_campaigns())
def test_toml_round_trip(name):
    """The campaign file of a run folder reads back as the same campaign."""
    heaviest = max(read_campaign(name).scene.body.items(), key=lambda item: item[1].mass)[0]
    first = read_campaign(
        name, {f"body.{heaviest}.mass_lb": 1e6, "run.seed": 5, "solver.step_s": 0.0123}
    )
    again = parse_campaign(tomllib.loads(first.toml), name)
    assert (again.scene, again.dispersions, again.reference, again.title) == (
        first.scene,
        first.dispersions,
        first.reference,
        first.title,
    )
    assert Campaign(again).digest == Campaign(first).digest != Campaign(read_campaign(name)).digest


def test_immutable():
    with pytest.raises(AttributeError):
        SCENE.body["upper"].mass = 1.0
    tree = copy.deepcopy(TREE)
    parse_campaign(tree, "t.toml", {"body.upper.mass_kg": 460.0, "initial.omega_deg_s.x": 9.0})
    assert tree == TREE


@pytest.mark.parametrize(
    ("text", "parsed"),
    [
        ("a.b=3", ("a.b", 3)),
        ("a = 1e3", ("a", 1000.0)),
        ("a=[1, 2]", ("a", [1, 2])),
        ("a={uniform=3.0}", ("a", {"uniform": 3.0})),
        ("a=full", ("a", "full")),
        ("a='full'", ("a", "full")),
        ('dispersion."b.c"=1', ("dispersion.b.c", 1)),
    ],
)
def test_parse_setting(text, parsed):
    assert parse_setting(text) == parsed


_NAMES = [
    "",
    "x",
    "mass_kg",
    "mass",
    "a.b",
    "name",
    "uniform",
    "normal",
    "relative",
    "discrete",
    "source",
    "upper",
]
_VALUES = [
    True,
    0,
    -1,
    1e308,
    -0.0,
    5e-324,
    10**400,
    math.nan,
    math.inf,
    -math.inf,
    "",
    "upper",
    "\n",
    ["upper", "lower"],
    [1.0, 2.0, 3.0],
]
_VALUES += [
    [],
    [[]],
    [{}],
    {},
    {"x": 1.0},
    {"x": {}},
    {"uniform": 1.0},
    {"time_s": 0.1},
    {"a": {"b": 1.0}},
    [10**400],
]


def _paths(tree, path=()):
    items = (
        tree.items()
        if isinstance(tree, dict)
        else enumerate(tree)
        if isinstance(tree, list)
        else ()
    )
    for key, below in items:
        yield (*path, key)
        yield from _paths(below, (*path, key))


def _edited(tree, edits):
    """Copy of the tree with the edits applied in order, as far as each is still possible."""
    tree = copy.deepcopy(tree)
    for (*way, key), action, name, given_value in edits:
        node = tree
        try:
            for step in way:
                node = node[step]
            old = node[key]
            if action == "delete":
                del node[key]
            elif action == "replace" or not isinstance(node, dict):
                node[key] = copy.deepcopy(given_value)
            elif action == "rename":
                node[name] = node.pop(key)
            elif isinstance(old, dict):
                old[name] = copy.deepcopy(given_value)
        except (KeyError, IndexError, TypeError):
            continue
    return tree


_ACTIONS = st.sampled_from(["delete", "replace", "replace", "add", "rename"])
_EDIT = st.tuples(
    st.sampled_from(list(_paths(TREE))), _ACTIONS, st.sampled_from(_NAMES), st.sampled_from(_VALUES)
)


@pytest.mark.filterwarnings("ignore::sepmc.scene.messages.SceneWarning")
@given(st.lists(_EDIT, min_size=1, max_size=3))
@settings(max_examples=400, deadline=None)
def test_any_tree_is_refused_or_can_be_flown(edits):
    """Any tree gives SceneError with a line per problem, or a campaign that can be laid out,
    sampled and written."""
    try:
        campaign = Campaign(parse_campaign(_edited(TREE, edits), "t.toml"))
    except SceneError as refused:
        if refused.problems and all(line.startswith("t.toml: ") for line in refused.problems):
            return
        raise
    again = Campaign(parse_campaign(tomllib.loads(campaign.file.toml), "t.toml"))
    assert again.digest == campaign.digest
    assert len(campaign.columns) >= 14 + len(campaign.file.dispersions)
    drawn = cases.sample(campaign.file.dispersions, 1, 0, 3) * campaign.factors
    assert np.isfinite(drawn).all()
    assert len(campaign.layout.nominal) > campaign.slots.max(initial=0)


@pytest.mark.parametrize("key", ["body.upper.cg_mm.z", "body.upper.cg_m.z"])
@pytest.mark.parametrize("given", [[1.0, 0.02, 0.0], {"x": 1.0, "y": 0.02}], ids=["list", "table"])
def test_one_component_in_another_unit_keeps_the_others(given, key):
    """A component set in another unit keeps the others, for each spelling of the vector."""
    tree = copy.deepcopy(TREE)
    body = tree["body"]["upper"]
    for old in [k for k in body if k.startswith("cg_")]:
        del body[old]
    body["cg_m"] = given
    scene = parse_campaign(tree, "t.toml", {key: 5.0 if "_mm" in key else 0.005}).scene
    assert scene.body["upper"].cg == pytest.approx((1.0, 0.02, 0.005), rel=1e-15)


def test_names_are_not_units(pair):
    """A joint called strut_t is not strut_m in another unit."""
    strut = {"bodies": ["fore", "aft"], "point_m": [2.0, 0.0, 0.0]}
    phase = {"name": "locked", "joints": {"strut_t": "fixed", "strut_m": "point-on-line"}}
    tree = pair().file.tree | {"joint": {"strut_t": strut, "strut_m": strut}, "phase": [phase]}
    scene = parse_campaign(tree, "t.toml", {"phase.locked.joints.strut_t": "point-on-plane"}).scene
    assert scene.phase[0].joints == {"strut_t": "point-on-plane", "strut_m": "point-on-line"}


def test_every_key_stands_on_the_page():
    """docs/reference/keys.md names every key of the model, in one of its units at least."""
    page = Path(__file__).parents[2] / "docs" / "reference" / "keys.md"
    words = set(re.findall(r"\w+", page.read_text(encoding="utf-8")))
    modules = (model, design_tables)
    classes = [t for one in modules for _, t in inspect.getmembers(one, inspect.isclass)]
    tables = [t for t in classes if t is not msgspec.Struct]
    tables = [t for t in tables if issubclass(t, msgspec.Struct) and not t.__name__.startswith("_")]
    tables.append(Measurement)
    fields = [(t.__name__, field) for t in tables for field in fields_of(t).values()]
    assert len(fields) > 100
    assert not [(name, f.name) for name, f in fields if not words & set(f.keys)]


def test_a_whole_number_beyond_its_bound_names_that_bound():
    """Not the bound of another key; and a fraction is told from a whole number."""
    pins, cases = fields_of(model.Guide)["pins"].type, fields_of(model.Run)["cases"].type
    assert convert(25, pins) == (None, "must be at most 24")
    assert convert(10**10, cases) == (None, "must be at most 1000000000")
    assert convert(1.5, cases) == (None, "must be a whole number")


@pytest.mark.parametrize("value", [2**63, -(2**63) - 1])
def test_bits_of_a_rejected_whole_number_exceed_those_allowed(value):
    problems = Problems()
    check_tree({"run": {"seed": value}}, problems)
    (message,) = problems
    assert "65 bits with its sign: must have at most 64" in message


def test_ends_of_phases_that_differ_by_round_off_are_equal(pair):
    """0.114097 s and the same time, converted from another unit."""
    phases = [
        {"name": "held", "joints": {"pins": "fixed"}, "until": {"time_s": 0.114097}},
        {"name": "guided", "joints": {"pins": "slider"}, "until": {"time_s": 0.11409699999999999}},
        {"name": "free"},
    ]
    assert pair({"phase": phases}).scene.phase[1].until.time < 0.114097
    phases[1]["until"]["time_s"] = 0.114096
    with pytest.raises(SceneError, match="time_s of an earlier phase"):
        pair({"phase": phases})


@pytest.mark.parametrize(
    ("until", "to", "accepted"),
    [
        ({"stroke_mm": 3.0}, "slider", True),
        ({"stroke_mm": 3.0}, "revolute", False),
        ({"angle_deg": 3.0}, "revolute", True),
        ({"angle_deg": 3.0}, "slider", False),
        ({"distance_mm": 3.0}, "slider", True),
        ({"distance_mm": 3.0}, "spherical", False),
    ],
)
def test_a_phase_may_wait_for_a_motion_that_a_release_allows(pair, until, to, accepted):
    """Nested or not, the condition may be met once the joint is released to a kind that moves."""
    pins = {"joint": "pins"} | until
    for condition in (pins, {"any": [pins]}, {"all": [pins, {"time_s": 0.2}]}):
        phases = [{"name": "locked", "joints": {"pins": "fixed"}, "until": condition}]
        release = [{"name": "opened", "joint": "pins", "to": to, "when": {"time_s": 0.1}}]
        settings = {"phase": [*phases, {"name": "free"}], "release": release}
        if accepted:
            assert pair(settings).scene.phase[0].until is not None
            continue
        with pytest.raises(SceneError, match="so that key is never met"):
            pair(settings)
