"""Springs by a table of force over extension."""

import math

import numpy as np
import pytest
from numpy.testing import assert_allclose
from oracles import independent
from scipy.interpolate import CubicSpline, PchipInterpolator
from support.pusher import MASSES, pusher_tree

from sepmc.campaign.campaign import Campaign
from sepmc.campaign.execution.diagnostics import file_notes
from sepmc.scene.messages import SceneError
from sepmc.scene.read import parse_campaign

EXTENSION = [0.0, 0.01, 0.025, 0.06, 0.1]
FORCE = [5000.0, 4200.0, 3900.0, 1500.0, 400.0]
PHASES = [
    {"name": "held", "joints": {"ring": "fixed"}, "until": {"time_s": 0.01}},
    {"name": "free"},
]
RUN = {"end_time_s": 0.4, "cases": 20, "seed": 1}


def campaign(table, spring=None, **more):
    """Campaign of two bodies, first held, that a pusher with a table separates."""
    tree = pusher_tree({"table": table} | (spring or {}), phase=PHASES, run=RUN)
    return Campaign(parse_campaign(tree | more, "pusher.toml"))


def speed(energy):
    """Separation speed, m/s, after a work, J, on both bodies."""
    return math.sqrt(2.0 * energy * sum(1.0 / mass for mass in MASSES))


def outcomes(one):
    return one.simulate(one.nominal(), step_s=0.2).attrs["outcomes"]


@pytest.mark.parametrize("rows", [2, 3, 4, 5])
def test_the_work_is_the_integral_of_the_force(rows):
    """The stroke ends at the last row; rows of a line, a parabola and splines."""
    x, force = EXTENSION[:rows], FORCE[:rows]
    result = outcomes(campaign({"extension_m": x, "force_N": force}))
    work = CubicSpline(x, force).integrate(0.0, x[-1])
    assert_allclose(result["separation_speed_m_s"], speed(work), rtol=1e-9)
    assert math.isfinite(result["pusher_stroke_end_time_s"])


@pytest.mark.slow
def test_rows_of_a_campaign_have_the_work_of_their_factor():
    one = campaign(
        {"extension_mm": [1e3 * x for x in EXTENSION], "force_kN": [1e-3 * f for f in FORCE]},
        dispersion={"spring.pusher.factor": {"uniform": [0.9, 1.1]}},
    )
    rows = one.run().to_pandas()
    assert (rows["status"] == "ok").all()
    work = CubicSpline(EXTENSION, FORCE).integrate(0.0, EXTENSION[-1])
    expected = [speed(work * factor) for factor in rows["in_spring_pusher_factor"]]
    difference = np.abs(rows["separation_speed_m_s"] / expected - 1.0)
    assert (difference <= rows["error"] + 1e-12).all()
    assert difference.max() <= 1e-9


def test_a_table_adds_to_the_linear_force():
    x, force = [0.0, 0.05], [1000.0, 500.0]
    both = outcomes(
        campaign(
            {"extension_m": x, "force_N": force},
            {"force_N": 2000.0, "stiffness_N_per_m": 8000.0, "stroke_m": 0.04},
        )
    )
    work = 3000.0 * 0.04 - 0.5 * 18000.0 * 0.04**2
    assert_allclose(both["separation_speed_m_s"], speed(work), rtol=1e-9)


def test_corners_cost_no_steps():
    """Constant force to 20 mm, then a line to 60 mm, then constant to 80 mm: the work by hand, at
    long steps."""
    x, force = [0.02, 0.06], [1500.0, 500.0]
    one = campaign({"extension_m": x, "force_N": force}, {"stroke_m": 0.08})
    result = one.simulate(one.nominal(), step_s=0.2).attrs
    work = 1500.0 * 0.02 + 0.5 * (1500.0 + 500.0) * 0.04 + 500.0 * 0.02
    assert_allclose(result["outcomes"]["separation_speed_m_s"], speed(work), rtol=1e-10)
    assert max(result["errors"].values()) < 1e-9


@pytest.mark.parametrize(
    ("interpolation", "work"),
    [
        ("linear", np.trapezoid(FORCE, EXTENSION)),
        ("monotone", PchipInterpolator(EXTENSION, FORCE).integrate(0.0, 0.1)),
    ],
)
def test_the_work_of_other_interpolations(interpolation, work):
    table = {"extension_m": EXTENSION, "force_N": FORCE, "interpolation": interpolation}
    result = outcomes(campaign(table))
    assert_allclose(result["separation_speed_m_s"], speed(work), rtol=1e-9)


RETURNING = {"extension_m": [0.0, 0.4], "force_N": [2000.0, -2000.0], "return_factor": 0.4}
PRESS = 500.0  # N, against the pusher


def pressed(table, end_s, **more):
    """Campaign of a pusher from the ground, free at once, against a constant load."""
    tree = pusher_tree(
        {"bodies": ["ground", "fore"], "table": table, "stroke_m": 1.0},
        load=[{"name": "press", "body": "fore", "force_N": [-PRESS, 0.0, 0.0]}],
        run={"end_time_s": end_s},
    )
    tree["joint"]["ring"]["bodies"] = ["ground", "fore"]
    tree["phase"] = [{"name": "free", "joints": {}}]
    tree["initial"] |= {"speed_m_s": 0.0, "altitude_m": 0.0}
    del tree["body"]["aft"]
    return Campaign(parse_campaign(tree | more, "pressed.toml"))


def returned(factor, t):
    """Position and speed of the pressed body, m and m/s, at a time after it has turned: harmonic
    to the turn, then harmonic about another point with the force times a factor."""
    stiffness, mass = 4000.0 / 0.4, MASSES[1]
    middle, rate = (2000.0 - PRESS) / stiffness, math.sqrt(stiffness / mass)
    turn, top = math.pi / rate, 2.0 * middle
    middle, rate = (2000.0 - PRESS / factor) / stiffness, math.sqrt(factor * stiffness / mass)
    angle = rate * (t - turn)
    assert 0.0 < angle < math.pi
    swing = top - middle
    return middle + swing * math.cos(angle), -swing * rate * math.sin(angle)


@pytest.mark.slow
def test_a_shrinking_stroke_has_the_return_factor():
    """Position and speed after the turn in closed form and against the independent flight, for the
    nominal case and for dispersed ones."""
    one = pressed(
        RETURNING, 0.6, dispersion={"spring.pusher.table.return_factor": {"uniform": [0.3, 0.7]}}
    )
    result = one.simulate(step_s=0.6)
    x, v = returned(0.4, 0.6)
    assert_allclose(result.iloc[-1][["fore_x_m", "fore_vx_m_s"]].tolist(), [x, v], rtol=1e-9)
    assert max(result.attrs["errors"].values()) < 1e-9
    for number in range(2):
        case = one.case(number)
        last = one.simulate(case, step_s=0.6).iloc[-1]
        factor = case.to_dict()["spring"][0]["table"]["return_factor"]
        assert_allclose(
            last[["fore_x_m", "fore_vx_m_s"]].tolist(), returned(factor, 0.6), rtol=1e-9
        )
        expected = independent.simulate(case.to_dict()).outcomes["separation_distance_mm"]
        assert_allclose(last["separation_distance_mm"], expected, rtol=1e-9)


def test_a_joint_that_holds_is_no_return():
    """At rest in a fixed joint the force is that of the table, whatever round-off of the rate: the
    work is its integral, although a shrinking stroke would have no force."""
    table = {"extension_m": EXTENSION, "force_N": FORCE, "return_factor": 0.0}
    result = outcomes(campaign(table, initial={"altitude_m": 1e5, "speed_m_s": 7000.0}))
    work = CubicSpline(EXTENSION, FORCE).integrate(0.0, EXTENSION[-1])
    assert_allclose(result["separation_speed_m_s"], speed(work), rtol=1e-9)


@pytest.mark.slow
def test_off_axis_pushers_agree_with_the_independent_flight():
    table = {"extension_m": EXTENSION, "force_N": FORCE}
    one = campaign(table, {"point_m": [1.0, 0.2, -0.1], "damping_N_s_per_m": 50.0})
    expected, result = independent.simulate(one.nominal().to_dict()), outcomes(one)
    for name in ("separation_speed_m_s", "fore_omega_y_deg_s", "fore_omega_z_deg_s"):
        assert_allclose(result[name], expected.outcomes[name], rtol=1e-8)


@pytest.mark.parametrize(
    ("table", "message"),
    [
        (
            {"extension_m": [0.0], "force_N": [1.0]},
            r"table\.extension_m = \[0\.0\]: needs at least",
        ),
        ({"extension_m": [0.0, 0.0], "force_N": [1.0, 2.0]}, "must rise strictly"),
        ({"extension_m": [0.0, 0.1], "force_N": [1.0]}, r"table\.force_N: has 1 values"),
        ({"extension_m": [-0.2, -0.1], "force_N": [1.0, 2.0]}, "must end beyond 0"),
        ({"extension_m": [0.0, 0.1]}, "force"),
        (
            {"extension_m": [0.0, 0.1], "force_N": [1.0, 2.0], "return_factor": 1.2},
            r"return_factor = 1\.2: must be",
        ),
        ({"stroke_m": [0.0, 0.1], "force_N": [1.0, 2.0]}, "stroke_m: unknown key"),
        ({"extension_m": [0.0, math.inf], "force_N": [1.0, 2.0]}, "finite"),
    ],
)
def test_wrong_tables_are_refused(table, message):
    with pytest.raises(SceneError, match=message):
        campaign(table)


def test_a_table_of_zeros_does_nothing():
    one = campaign({"extension_m": [0.0, 0.1], "force_N": [0.0, 0.0]})
    assert any("spring.pusher does nothing" in note for note in file_notes(one))


def test_a_table_that_overshoots_is_noted():
    """All rows push, but the spline through them pulls with 745 N: it does 9 J instead of 125 J."""
    table = {"extension_m": [0.0, 0.05, 0.1, 0.3], "force_N": [1000.0, 900.0, 400.0, 50.0]}
    (note,) = [one for one in file_notes(campaign(table)) if "table.force" in one]
    assert "spring.pusher.table.force: the smooth function through the rows reaches -7" in note
    for other in ("linear", "monotone"):
        notes = file_notes(campaign(table | {"interpolation": other}))
        assert not any("table.force" in one for one in notes)


def test_a_table_that_pulls_less_on_the_way_back_is_noted():
    table = {"extension_m": [0.0, 0.1], "force_N": [100.0, -50.0], "return_factor": 0.6}
    assert any("can hold its bodies" in one for one in file_notes(campaign(table)))
    assert not any("can hold" in one for one in file_notes(campaign(table | {"return_factor": 1})))
    assert not any("can hold" in one for one in file_notes(campaign(table, {"push_only": True})))
