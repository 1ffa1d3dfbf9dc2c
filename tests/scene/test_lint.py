"""Lint of scenes: mistakes planted in shipped campaigns are found, with place and value; shipped
ones have none."""

import re
import warnings

import numpy as np
import pytest
from click.testing import CliRunner
from oracles.random_scenes.interpreted import run_interpreted
from scipy.stats import norm

import sepmc
from sepmc.campaign.execution.diagnostics import file_notes, min_at_end
from sepmc.campaign.store.manifests import read_manifest
from sepmc.cli import app
from sepmc.scene.campaign_files import shipped_campaigns

BACK = [-1.0, 0.0, 0.0]
UNIT, OVERLAP, BACKWARD = "is it in another unit?", "overlap at the start", "the other way round?"
WIDE, RIGHT = "0.05 with relative = true", "right?"
BY_MASS = "dispersion.body.upper.mass_kg"
PLANTED = [
    # millimetres taken for metres
    ("table2", {"body.upper.cg_m": [1316.2, 5.6, 0.1]}, "body.upper.cg", UNIT),
    ("table2", {"body.lower.cg_m": [3561.7, 4.8, -2.9]}, "body.lower.cg", UNIT),
    ("table2", {"body.upper.cg_m": [1.3162, 0.0056, 0.1]}, None, None),  # none
    ("table2", {"body.upper.cg_m": [1.3162, 56.0, 0.0]}, "body.upper.cg", UNIT),
    ("table2", {"joint.pins.point_m": [2400.0, 0.0, 0.0]}, "joint.pins.point", UNIT),
    ("table2", {"motor.retro.station_m": 4500.0}, "motor.retro.station", UNIT),
    ("spring-pushers", {"body.payload.cg_m": [1400.0, 0.0, 0.0]}, "body.payload.cg", UNIT),
    ("spring-pushers", {"spring.upper_left.point_m": [2000.0, 320.0, -320.0]},
     "spring.upper_left.point", UNIT),
    ("spring-pushers", {"joint.clamp.point_m": [2000.0, 0.0, 0.0]}, "joint.clamp.point", UNIT),
    ("residual-thrust", {"motor.residual.station_m": 21300.0}, "motor.residual.station", UNIT),
    ("residual-thrust", {"body.lower.cg_m": [15000.0, 0.0, 0.0]}, "body.lower.cg", UNIT),
    ("hyper-x", {"joint.guide.point_m": [3700.0, 0.0, 0.0]}, "joint.guide.point", UNIT),
    ("missile-rail", {"motor.boost.station_m": 2850.0}, "motor.boost.station", UNIT),
    # dispersions as wide as what they are about
    ("table2", {BY_MASS: {"uniform": [1.0, 1000.0]}}, "mass_kg: uniform (1, 1000)", WIDE),
    ("table2", {"dispersion.motor.retro.thrust_N": {"normal": 0.5, "relative": True}},
     "motor.retro.thrust_N", WIDE),
    ("spring-pushers", {"dispersion.spring.upper_left.force_N": {"normal": 1000.0}},
     "spring.upper_left.force_N", WIDE),
    ("table2", {"dispersion.body.upper.inertia_factor": {"normal": 0.6}}, "inertia_factor", WIDE),
    # speeds and heights of no such flight
    ("table2", {"initial.altitude_m": 700.0}, "initial.altitude = 700 m", RIGHT),
    ("table2", {"initial.speed_m_s": 24480.0}, "initial.speed = 2.448e+04 m/s", RIGHT),
    ("spring-pushers", {"initial.altitude_km": 5e5}, "initial.altitude = 5e+08 m", RIGHT),
    ("hyper-x", {"initial.speed_m_s": 21073.0}, "initial.speed = 2.107e+04 m/s", RIGHT),
    # bodies that lie in each other
    ("residual-thrust",
     {"body.upper.outline": [{"stations_m": [7.2, 8.8], "radii_m": [0.1, 0.84]}]},
     "outlines of upper and lower", OVERLAP),
    ("hyper-x", {"body.rv.outline": [{"stations_m": [0.0, 4.2], "radii_m": [0.05, 0.3]}]},
     "outlines of rv and booster", OVERLAP),
    # springs that push together
    ("spring-pushers", {"spring.upper_left.axis": BACK}, "spring.upper_left.axis", BACKWARD),
    ("residual-thrust", {"spring.pusher_1.axis": BACK}, "spring.pusher_1.axis", BACKWARD),
    ("residual-thrust", {"spring.pusher_1.force_N": -500.0}, "spring.pusher_1.force", BACKWARD),
    ("hyper-x", {"spring.piston_left.axis": BACK}, "spring.piston_left.axis", BACKWARD),
    # wind that nothing feels
    ("spring-pushers", {"environment.wind.speed_m_s": 10.0}, "environment.wind", "does nothing"),
    ("residual-thrust", {"environment.wind.speed_m_s": 10.0}, "environment.wind", "does nothing"),
    # what never has a value
    ("spring-pushers", {"event": [{"name": "late", "when": {"time_s": 9e9}}]},
     "event.late.when", "after the end of the run"),
    ("spring-pushers", {"phase": [{"name": "clamped", "joints": {"clamp": "fixed"}}]},
     "output.tip_off: clamp", "never released"),
    ("residual-thrust", {"phase": [{"name": "locked", "joints": {"rods": "fixed"}}],
                         "dispersion.phase.locked.until.time_s": None},
     "output.tip_off: rods", "never released"),
    ("spring-pushers", {"phase": [{"name": "free"}], "output": {"loads": ["clamp"]}},
     "output.loads: clamp", "is free in all phases"),
]  # fmt: skip


def loaded(name, settings):
    tree = {path: value for path, value in settings.items() if value is not None}
    for path in settings.keys() - tree:  # a law that the others leave without its parameter
        laws = sepmc.load(name).file.tree["dispersion"]
        tree["dispersion"] = {k: v for k, v in laws.items() if f"dispersion.{k}" != path}
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        return sepmc.load(name, tree)


@pytest.mark.parametrize(("name", "settings", "place", "message"), PLANTED)
def test_planted(name, settings, place, message):
    """A finding has place and value; one mistake gives one sentence, or one per consequence."""
    result = file_notes(loaded(name, settings))
    result = [one for one in result if "applies to the nominal case only" not in one]
    if place is None:
        assert result == []
        return
    assert any(place in one and message in one for one in result), result


LATE = {"time_s": [0.02, 0.3], "fraction": [0.5, 1.0]}


@pytest.mark.parametrize(
    ("profile", "burn", "message"),
    [
        pytest.param(LATE, {}, "no thrust before, then 0.5 of thrust_N at once", id="a step"),
        pytest.param(
            LATE | {"fraction": [0.0, 1.0]}, {}, "there is no thrust before", id="from zero"
        ),
        pytest.param(LATE, {"burn_s": 0.01}, "does nothing: burn_s = 0.01", id="burnt out"),
        pytest.param(LATE | {"time_s": [0.0, 0.3]}, {}, None, id="from the ignition"),
    ],
)
def test_a_profile_that_begins_late(profile, burn, message):
    """A late profile is found, with the time of its first row."""
    settings = {f"motor.retro.{key}": value for key, value in ({"profile": profile} | burn).items()}
    results = [
        one for one in file_notes(loaded("table2", settings)) if one.startswith("motor.retro")
    ]
    assert len(results) == (message is not None)
    assert message is None or (message in results[0] and "0.02 s after the ignition" in results[0])


@pytest.mark.parametrize(
    ("heights", "speeds", "message"),
    [
        ([0.0, 33000.0], [5.0, 20.0], "rows from 0 to 33000 m, but the flight begins at .* 20 m/s"),
        ([0.0, 33000.0], [5.0, 0.0], None),
        ([0.0, 90000.0], [5.0, 20.0], None),
        ([80000.0, 90000.0], [5.0, 20.0], "that of its first row, 5 m/s"),
    ],
)
def test_a_sounding_that_ends_below_the_flight(heights, speeds, message):
    profile = {"altitude_m": heights, "speed_m_s": speeds, "direction_deg": [0.0, 0.0]}
    settings = {"environment.wind.profile": profile, "initial.altitude_km": 60.0}
    notes = [x for x in file_notes(loaded("table2", settings)) if "wind.profile" in x]
    assert len(notes) == (message is not None)
    assert message is None or re.search(message, notes[0])


EARLY, PAST, MOVED = {"time_s": 0.01}, {"time_s": 9e9}, {"joint": "clamp", "stroke_mm": 1.0}


@pytest.mark.parametrize(
    ("when", "dispersed", "is_past"),
    [
        (PAST, "time_s", False),
        ({"any": [PAST, PAST]}, None, True),
        ({"any": [PAST, PAST]}, "any.1.time_s", False),
        ({"all": [EARLY, PAST]}, None, True),
        ({"all": [EARLY, PAST]}, "all.1.time_s", False),
        ({"all": [EARLY, PAST]}, "all.0.time_s", True),
        ({"all": [EARLY, PAST]} | MOVED, None, False),
        ({"all": [EARLY, PAST], "any": [EARLY]}, None, False),
        ({"any": [PAST]} | EARLY, None, False),
        ({"any": [PAST]} | PAST, None, True),
    ],
)
def test_a_condition_is_past_if_each_way_to_meet_it_is(when, dispersed, is_past):
    """All keys of the condition count, and a nested time may be dispersed to an earlier one."""
    settings = {"event": [{"name": "late", "when": when}]}
    if dispersed is not None:
        settings[f"dispersion.event.late.when.{dispersed}"] = {"uniform": [0.0, 9e9]}
    notes = file_notes(loaded("spring-pushers", settings))
    assert any("event.late.when: comes after the end" in note for note in notes) is is_past, notes


def test_there_are_thirty():
    assert sum(place is not None for _, _, place, _ in PLANTED) >= 30 - 2  # and two below


@pytest.mark.parametrize("name", list(shipped_campaigns()))
def test_shipped_campaigns_have_none(name):
    assert file_notes(sepmc.load(name)) == []


@pytest.mark.parametrize(
    ("weights", "message"),
    [([0.97, 0.3], "add up to 1.27, so the probabilities are 0.764, 0.236"),
     ([0.97, 0.03], ""), ([2.0, 1.0], ""), ([0.33, 0.66], "")],
)  # fmt: skip
def test_weights_that_do_not_add_up(weights, message):
    """Probabilities must add up to 1; ratios need not."""
    law = {"dispersion.motor.retro.thrust_N": {"discrete": [500.0, 0.0], "weights": weights}}
    results = [one for one in file_notes(loaded("table2", law)) if "weights" in one]
    assert [message in one for one in results] == ([True] if message else [])


PUSHER = "spring.upper_left"


def table(*force):
    """Settings of a force table of the pusher, with rows evenly over its stroke."""
    extension = np.linspace(0.0, 0.1, len(force)).tolist()
    rows = {"extension_m": extension, "force_N": list(force), "interpolation": "linear"}
    return {f"{PUSHER}.table": rows}


@pytest.mark.parametrize(
    ("settings", "message"),
    [
        ({f"{PUSHER}.stiffness_N_per_m": 60_000.0}, "over: force_N"),
        (
            {f"dispersion.{PUSHER}.force_N": {"discrete": [900.0, 0.0], "weights": [0.99, 0.01]}},
            "at an end of its distribution for force: force_N = 0 less",
        ),
        ({f"dispersion.{PUSHER}.factor": {"discrete": [1.0, 0.0], "weights": [0.99, 0.01]}}, None),
        ({f"{PUSHER}.stiffness_N_per_m": 60_000.0, f"{PUSHER}.push_only": True}, None),
        ({f"{PUSHER}.stiffness_N_per_m": 12_000.0, **table(0.0, 900.0)}, None),
        (table(0.0, -900.0), "= 6000 times stroke_m = 0.1, with -900 N of its table"),
        (table(0.0, -900.0, 0.0), "= 6000 times extension = 0.05, with -900 N of its table"),
        (
            {f"{PUSHER}.force_N": 0.0, f"dispersion.{PUSHER}.force_N": None} | table(2000.0, 0.0),
            "pulls with 600 N before",
        ),
    ],
)
def test_a_pusher_that_pulls(settings, message):
    """Stiffer than its force over its stroke; failed by its force, which leaves the stiffness;
    failed by its factor, as it should be; one that cannot pull; a table that keeps one from it;
    tables that make it pull, at the end and in between; and one that pushes by its table alone."""
    results = [
        one for one in file_notes(loaded("spring-pushers", settings)) if " pulls with " in one
    ]
    assert [one.startswith(PUSHER) and message in one for one in results] == (
        [True] if message else []
    )


@pytest.mark.slow
def test_check_holds_the_nominal_case_against_what_is_required(tmp_path):
    """The starter campaign as it is; ended while its nozzle is inside; a bound of the wrong
    side."""
    file = tmp_path / "rocket.toml"
    assert CliRunner().invoke(app.main, ["template", str(file)]).exit_code == 0

    def told(*settings):
        more = [word for setting in settings for word in ("--set", setting)]
        return CliRunner().invoke(app.main, ["check", str(file), *more]).stderr

    assert told() == ""
    early = told("run.end_time_s=0.15")
    assert "the nominal case has no pushed_upper_transverse_rate_deg_s" in early
    assert "gap_clearance_mm is smallest when the nominal case ends" in early
    assert "motor.retro (cant_deg = 0) pushes its body toward" in told("motor.retro.cant_deg=0")
    wrong = told("requirement.clear.at_least=95")
    assert "requirement.clear.at_least = 95: the nominal case violates it" in wrong


@pytest.mark.slow
def test_clearances_that_are_least_at_the_end_are_counted(tmp_path):
    """In the notes and in the manifest of a run that ends too early; not of one that does not."""
    file = tmp_path / "rocket.toml"
    CliRunner().invoke(app.main, ["template", str(file)])
    with run_interpreted(cases=2):
        early = sepmc.load(file, {"run.end_time_s": 0.15}).run(cases=3, out=tmp_path / "early")
        late = sepmc.load(file).run(cases=2)
    note = "gap_clearance_mm is smallest when the run ends in 3 cases"
    assert [one for one in early.notes if one.startswith(note)]
    assert read_manifest(tmp_path / "early")["min_at_end"] == {"gap": 3}
    assert not [one for one in late.notes if "is smallest when the run ends" in one]


def test_check_flies_the_nominal_case():
    """A retro motor the other way round, and a campaign without dispersions."""
    together = CliRunner().invoke(
        app.main,
        ["check", "table2", "--set", "motor.retro.cant_deg=0", "--set", "run.end_time_s=2"],
    )
    assert together.exit_code == 0
    assert "nominal      " in together.stdout
    assert "never-released" in together.stdout or "ends with" in together.stderr
    alone = CliRunner().invoke(app.main, ["check", "table2", "--set", "dispersion={}"])
    assert "nothing is dispersed" in alone.stderr
    unflown = CliRunner().invoke(app.main, ["check", "table2", "--no-flight"])
    assert (unflown.exit_code, unflown.stderr) == (0, "")
    assert "nominal " not in unflown.stdout


@pytest.mark.parametrize(
    ("law", "expected"),
    [
        ({"normal": [0.1, 0.04]}, 10_000 * norm.sf(2.5)),
        ({"normal": [0.1, 0.1]}, 10_000 * norm.sf(1.0)),
        ({"normal": [-0.2, 0.1]}, 10_000 * norm.cdf(2.0)),
        ({"normal": [0.0, 0.1]}, 5_000.0),
        ({"normal": 0.3, "relative": True}, 10_000 * norm.sf(1.0 / 0.3)),
        ({"normal": 0.2, "relative": True}, 0.0),  # 0.003 cases
        ({"normal": 0.3, "relative": True, "truncate_sigma": 3.0}, 0.0),
    ],
)
def test_cases_that_a_normal_law_draws_beyond_a_bound(law, expected):
    """The expected number of cases outside the bounds of a parameter is found before a run."""
    key = BY_MASS if "relative" in law else "dispersion.motor.retro.burn_s"
    burn = {"motor.retro.burn_s": 0.1}
    results = [
        one for one in file_notes(loaded("table2", {key: law} | burn)) if "truncate_sigma" in one
    ]
    assert len(results) == bool(expected)
    for one in results:
        shown = f"{expected:.0f}" if expected >= 100.0 else f"{expected:.2g}"
        assert f"about {shown} of 10000 cases" in one
        assert key.removeprefix("dispersion.") in one


@pytest.mark.parametrize("radius", [0.8, 1.0])
def test_what_is_as_far_through_a_shell_as_is_told_may_not_become_less(radius):
    """A tenth of the greatest radius of the shell of that case, whether it is dispersed or not."""
    laws = {"body.upper.mass_kg": {"uniform": 1.0}}
    if radius != 0.8:
        laws |= {f"body.lower.outline.1.radii_m.{k}": {"uniform": 0.3} for k in range(2)}
    campaign = sepmc.load("residual-thrust", {"dispersion": laws})
    end, deepest = campaign.scene.run.end_time, -100.0 * radius
    least = np.array([deepest, 0.999 * deepest, deepest, 20.0, -1.0])
    when = np.array([end, end, 0.9 * end, end, end])
    outcomes = {"gap_clearance_mm": least, "gap_clearance_time_s": when}
    drawn = np.array([[4500.0, radius, radius][: len(laws)]] * len(least))
    assert min_at_end(campaign, outcomes, drawn) == {"gap": 3}
    assert not min_at_end(campaign, {k: x[0] for k, x in outcomes.items()})  # the nominal
    assert "limited to 0.1 of its radius" in next(
        column.meaning for column in campaign.outcome_columns if column.name == "gap_clearance_mm"
    )


LEVEL = """
environment = {{ atmosphere = "none", gravity = "none" }}
initial = {{ altitude_m = 1000.0, speed_m_s = 10.0 }}
run = {{ end_time_s = 0.3 }}
phase = [
    {{ name = "held", joints = {{ strut = "fixed" }}, until = {{ time_s = 0.1 }} }},
    {{ name = "free" }},
]
[body]
core = {{ mass_kg = 9.0, inertia_kg_m2 = [1, 2, 2], cg_m = [4.0, 0.0, 0.0] }}
side = {{ mass_kg = 3.0, inertia_kg_m2 = [1, 2, 2], cg_m = [8.0, {shift}, 0.0] }}
[joint.strut]
bodies = ["core", "side"]
point_m = [6.0, 0.0, 0.0]
x_axis = [0.0, 1.0, 0.0]
y_axis = [1.0, 0.0, 0.0]
{more}
"""


def level_notes(folder, shift, more=""):
    """Findings on a joint with a lateral axis; the second body lies 4 m aft, ``shift`` m beside."""
    file = folder / "level.toml"
    file.write_text(LEVEL.format(shift=shift, more=more), encoding="utf-8")
    return [note for note in file_notes(sepmc.load(file)) if "nearly level" in note]


@pytest.mark.parametrize(
    ("shift", "reported"), [(0.0, 1), (-0.05, 1), (0.07, 1), (0.2, 0), (-2.0, 0)]
)
def test_a_side_that_is_nearly_level_is_told(tmp_path, shift, reported):
    """Within 2 % of 4 m the finding gives the sign; setting `apart` removes it."""
    notes = level_notes(tmp_path, shift)
    assert len(notes) == reported
    side = "positive" if shift >= 0.0 else "negative"
    assert all(f"separation is counted {side} along its x axis" in note for note in notes)
    assert not level_notes(tmp_path, shift, "apart = 1")


def aerodynamics(**more):
    return {"reference_area_m2": 1.0, "reference_length_m": 2.0, **more}


STABLE = {"normal": {"alpha": 3.0}, "side": {"beta": 3.0}, "pitch": {"alpha": -1.0}}
GRID = [[-0.6, -0.1, 0.5], [-0.7, -0.1, 0.6], [-0.8, -0.2, 0.7]]  # over alpha in each row
AXES = {"mach": [1.0, 2.0, 3.0], "alpha_deg": [-10.0, 0.0, 10.0]}
MIRRORED = {
    name: {
        "mass_kg": 3.0,
        "inertia_kg_m2": [3.0, 4.0, 5.0],
        "inertia_products_kg_m2": products,
        "cg_m": [1.0, 0.0, aside],
    }
    for name, products, aside in (("fore", [0.1, 0.2, 0.3], 0.5), ("aft", [0.1, 0.2, 0.3], -0.5))
}
CANNOT_BE_MEANT = {
    "slope per degree": (aerodynamics(normal={"alpha": 0.1}), "changes by 0.1 per rad of alpha"),
    "slope of a table": (
        aerodynamics(table=AXES | {"normal": [[-0.01, 0.0, 0.01]] * 3}),
        "changes by 0.0573 per rad of alpha",
    ),
    "slope of a table beside a polynomial": (  # 3.1, 2.4 and 0.1 in all: the steepest counts
        aerodynamics(
            normal={"alpha": 3.0},
            table={"mach": [1.0, 2.0, 3.0], "alpha_rad": [-0.1, 0.0, 0.1]}
            | {"normal": [[-k, 0.0, k] for k in (0.01, -0.06, -0.29)]},
        ),
        None,
    ),
    "side force of DATCOM": (aerodynamics(**STABLE | {"side": {"beta": -3.0}}), "points left here"),
    "stable in alpha only": (
        aerodynamics(**STABLE, yaw={"beta": -1.0}),
        "statically stable in alpha (C_m -1 per rad) and not in beta (C_n -1 per rad)",
    ),
    "stable in both": (aerodynamics(**STABLE, yaw={"beta": 1.0}), None),
    "moment point": (  # 1 m aft of the mass centre, half a length: C_n about it is -0.5 + 1.5
        aerodynamics(**STABLE, yaw={"beta": -0.5}, moment_point_m=[4.0, 0.0, 0.0]),
        None,
    ),
    "transposed": (
        aerodynamics(table=AXES | {"normal": np.transpose(GRID).tolist()}),
        "is the table transposed? Its rows are those of mach",
    ),
    "as it is": (aerodynamics(table=AXES | {"normal": GRID}), None),
    "normal force of C_Z": (
        aerodynamics(table=AXES | {"normal": (-np.array(GRID)).tolist()}),
        "so a nose above the path is pushed down: does it point down in your data, as C_Z does?",
    ),
    "normal force of C_Z, polynomial": (
        aerodynamics(normal={"alpha": -3.0, "alpha3": 9.0}),
        "normal has the slope -3 per rad of alpha",
    ),
    "normal force that falls beyond zero only": (
        aerodynamics(table={"alpha_deg": [20.0, 30.0, 40.0], "normal": [2.0, 1.0, 0.8]}),
        None,
    ),
    "normal force that falls at one Mach number": (
        aerodynamics(table=AXES | {"normal": [*GRID[:2], [0.05, 0.0, -0.05]]}),
        None,
    ),
    "axial force of C_X": (
        aerodynamics(table={"mach": [0.5, 1.0, 1.5], "axial": [-0.3, -0.4, -0.5]}),
        "axial is -0.4 at alpha = 0: a positive C_A points aft here",
    ),
    "axial force of C_X, polynomial": (
        aerodynamics(axial={"const": -0.3}),
        "so the air pushes this body forward",
    ),
    "axial force of a wing": (  # turns forward at larger alpha, as its lift leans forward
        aerodynamics(
            table={
                "alpha_deg": [-8.0, -4.0, 0.0, 4.0, 8.0],
                "axial": [-0.2, -0.1, 0.02, -0.1, -0.2],
            }
        ),
        None,
    ),
    "degrees in an axis of rad": (
        aerodynamics(table={"alpha_rad": [-10.0, 0.0, 10.0], "normal": [-9.0, 0.0, 9.0]}),
        "table.alpha reaches 573 deg (10 rad)",
    ),
    "half a deck": (
        aerodynamics(table={"alpha_deg": [0.0, 10.0], "normal": [0.0, 0.5]}),
        "alpha begins at 0, so a case that turns below it ends with the status outside-table",
    ),
    "half a deck, mirrored": (
        aerodynamics(table={"alpha_deg": [0.0, 10.0], "normal": [0.0, 0.5], "mirror": "alpha"}),
        None,
    ),
    "radians in an axis of degrees": (
        aerodynamics(table={"alpha_deg": [-0.2, 0.0, 0.2], "normal": [-0.5, 0.0, 0.5]}),
        "table.alpha reaches 0.2 deg only",
    ),
}


def notes_of(pair, settings):
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        return file_notes(pair(settings))


@pytest.mark.parametrize(("aero", "message"), CANNOT_BE_MEANT.values(), ids=list(CANNOT_BE_MEANT))
def test_aerodynamics_that_cannot_be_meant(pair, aero, message):
    """Each trap alone, with place and value; none where nothing is wrong."""
    notes = notes_of(pair, {"environment.atmosphere": "us1976", "body.aft.aerodynamics": aero})
    assert (notes == []) == (message is None), notes
    assert message is None or (len(notes) == 1 and message in notes[0]), notes
    assert all(note.startswith("body.aft.aerodynamics") for note in notes)


def test_angles_of_more_than_a_turn(pair):
    (note,) = notes_of(pair, {"initial.pitch_rad": 12.0})
    assert note.startswith("initial.pitch = 687.5 deg (12 rad)")
    assert notes_of(pair, {"initial.pitch_deg": 120.0}) == []


def test_stations_that_count_forward(pair):
    settings = {"body.fore.cg_m": [-1.0, 0.0, 0.0], "body.aft.cg_m": [-3.0, 0.0, 0.0]}
    settings |= {"joint.pins.point_m": [-2.0, 0.0, 0.0]}
    (note,) = notes_of(pair, settings)
    assert "negative (-3 to -1 m): stations count aft from the nose" in note
    outline = [{"stations_m": [2.0, 4.0], "radii_m": [0.2, 0.2]}]
    engine = {"name": "engine", "body": "aft", "thrust_N": 5.0, "station_m": 2.0, "cant_deg": 0.0}
    (note,) = notes_of(pair, {"body.aft.outline": outline, "motor": [engine]})
    assert "motor.engine.station = 2 m pushes aft forward from its front end" in note
    assert (
        notes_of(pair, {"body.aft.outline": outline, "motor": [engine | {"station_m": 4.0}]}) == []
    )


@pytest.mark.parametrize(
    ("products", "wrong"), [([0.1, 0.2, 0.3], True), ([0.1, -0.2, -0.3], False)]
)
def test_products_of_mirrored_bodies(pair, products, wrong):
    """Mirrored in z, xz and yz change their sign; xy does not."""
    bodies = MIRRORED | {"aft": MIRRORED["aft"] | {"inertia_products_kg_m2": products}}
    notes = [note for note in file_notes(pair({"body": bodies})) if "mirrors" in note]
    assert bool(notes) == wrong
    assert not wrong or "body.aft mirrors body.fore in z" in notes[0]
    assert not wrong or "xz and yz" in notes[0]


def test_a_burn_shorter_than_its_build_up(pair):
    motor = {"name": "kick", "body": "aft", "thrust_N": 5.0, "station_m": 3.0}
    (note,) = [
        note
        for note in file_notes(pair({"motor": [motor | {"build_up_s": 0.2, "burn_s": 0.1}]}))
        if "build_up_s" in note
    ]
    assert "reaches 39 % only" in note  # 1 - exp(-1/2)
