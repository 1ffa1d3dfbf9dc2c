"""Whole flights through the public API: closed forms, conservation, the independent oracle, and
what must not change the answer."""

import math

import numpy as np
import pandas as pd
import pytest
from numpy.testing import assert_allclose, assert_array_equal
from scipy.integrate import solve_ivp
from scipy.spatial.transform import Rotation

import sepmc
from sepmc.campaign import cases
from sepmc.campaign.campaign import Campaign
from sepmc.campaign.execution import step_selection
from sepmc.engine.dispatch import interpreted
from sepmc.scene.read import parse_campaign
from sepmc.validation import lagrange

LBF, FT = 4.4482216152605, 0.3048
GUIDED, FREE = {"name": "guided", "joints": {"pins": "slider"}}, {"name": "free"}
CG = [[1.0, 0.05, -0.02], [3.0, -0.04, 0.03]]
LOPSIDED = {
    "body.fore.cg_m": CG[0],
    "body.aft.cg_m": CG[1],
    "body.aft.inertia_products_kg_m2": [0.2, -0.1, 0.15],
}
# 2 m/s2 on the aft body
RETRO = {"name": "retro", "body": "aft", "thrust_N": 2.0, "station_m": 3.0, "cant_deg": 180.0}
# Height (m), speed (m/s), pitch (deg) from which 86 km or the ground are reached: at once, later,
# and back from a throw upward.
LEAVING = [
    (85_990.0, 6800.0, 60.0),
    (85_700.0, 6800.0, 89.0),
    (84_000.0, 6800.0, 60.0),
    (30.0, 100.0, -60.0),
    (10.0, 10.0, 89.0),
    (0.5, 50.0, 0.0),
]
# inputs that change sign with z
MIRRORED = (
    "omega.x",
    "omega.y",
    "initial.yaw",
    "initial.roll",
    "cg.z",
    "offset.z",
    "wind.direction",
)
SIGN_CHANGES = ("beta_deg", "omega_x_deg_s", "omega_y_deg_s", "roll_deg", "yaw_deg")  # and outcomes


def until(stroke_mm, locked_s=None):
    """Phases: locked for a time, if given, then guided over a stroke, then free."""
    locked = (
        [{"name": "locked", "joints": {"pins": "fixed"}, "until": {"time_s": locked_s}}]
        if locked_s
        else []
    )
    return [*locked, GUIDED | {"until": {"joint": "pins", "stroke_mm": stroke_mm}}, FREE]


def state(history, body):
    """Place, velocity, attitude, rates in body axes."""
    x, v = (
        np.array(history[[f"{body}_{p}{a}_{u}" for a in "xyz"]])
        for p, u in (("", "m"), ("v", "m_s"))
    )
    angles = np.array(history[[f"{body}_{a}_deg" for a in ("pitch", "yaw", "roll")]])
    omega = np.radians(np.array(history[[f"{body}_omega_{a}_deg_s" for a in "xyz"]]))
    return x, v, Rotation.from_euler("ZYX", angles, degrees=True), omega


def inertias(campaign):
    """Mass and inertia tensor of each body."""
    for body in campaign.scene.body.values():
        xy, xz, yz = body.inertia_products
        yield body.mass, np.diag(body.inertia) - np.array([[0, xy, xz], [xy, 0, yz], [xz, yz, 0]])


@pytest.fixture(scope="module")
def quiet(table2):
    """Table 2 without histories, at a step of its own."""
    return table2.with_settings({"run.history_step_s": 0.0, "solver.step_s": 0.05})


@pytest.fixture(scope="module")
def sample(quiet):
    return quiet.run(cases=2000)


@pytest.fixture(scope="module")
def measure(sample):
    """Largest |difference| / max(|expected|, sigma of the outcome over 2,000 cases); printed with
    its outcome."""

    def worst(result, expected, names=None):
        scaled = {
            name: np.max(
                np.abs(result[name] - expected[name])
                / np.maximum(np.abs(expected[name]), sample.table[name].std(ddof=1))
            )
            for name in names or sample.outcomes
        }
        print("worst {1:.1e} in {0}".format(*max(scaled.items(), key=lambda item: item[1])))
        return np.max(list(scaled.values()))  # NaN if any is

    return worst


@pytest.mark.parametrize("name", ["residual-thrust", "missile-rail"])
def test_rows_do_not_depend_on_what_flies_beside_them(name):
    """Not in their audit columns either, where switches end steps of some lanes only."""
    loaded = sepmc.load(name, {"run.history_step_s": 0.0})
    rows = loaded.run(cases=1600).to_pandas().set_index("case")
    for first in (3, 5):
        others = loaded.run(f"{first}:1600").to_pandas().set_index("case")
        pd.testing.assert_frame_equal(others, rows[first:], check_exact=True)


@pytest.mark.parametrize("formulation", ["reduced", "full"])
def test_nasa_two_boxes(pair, formulation):
    """Fixed joint, torque-free: NASA/TP-2016-219326 test case 1 with the rates of DOMAIN.md 1.2, to
    the digits printed there."""
    boxes = {
        "A": {
            "mass_slug": 1.0,
            "inertia_slug_ft2": [5 / 12, 26 / 12, 29 / 12],
            "cg_ft": [4.5, 0.0, 0.0],
        },
        "B": {
            "mass_slug": 0.4,
            "inertia_slug_ft2": [1 / 6, 1 / 6, 4 / 15],
            "cg_ft": [1.0, 0.0, 0.0],
        },
    }
    scene = {
        "body": boxes,
        "joint.pins": {"bodies": ["A", "B"], "point_ft": [2.0, 0.0, 0.0]},
        "run.end_time_s": 10.0,
    }
    history = pair(
        scene | {"initial.omega_rad_s": [0.5, 1.0, -0.3], "solver.formulation": formulation}
    ).simulate(step_s=1.0)
    first = history.iloc[0]
    assert_allclose(
        [first[f"pins_force_on_B_{a}_N"] / LBF for a in "xyz"],
        [-1.09, 0.0754717, -0.006],
        rtol=0,
        atol=5e-8,
    )
    assert_allclose(
        [first[f"pins_moment_on_B_{a}_N_m"] / (LBF * FT) for a in "xyz"],
        [0.0, -0.003, -0.0377358],
        rtol=0,
        atol=5e-8,
    )
    assert_allclose(
        state(history, "A")[3][-1], [0.43643767, 1.04653498, -0.07596399], rtol=0, atol=1e-8
    )


def test_locked_pair_is_one_rigid_body(pair):
    """Euler's equations of the composite, integrated by scipy: rates, attitude and both places
    agree to 1e-10 after 2 s."""
    rates = [2.0, 1.0, -1.5]
    campaign = pair(
        LOPSIDED | {"initial.omega_rad_s": rates, "initial.altitude_m": 0.0, "run.end_time_s": 2.0}
    )
    places = (np.array(CG) - np.average(CG, axis=0, weights=[3.0, 1.0])) * (-1.0, 1.0, 1.0)
    inertia = sum(
        j + m * (p @ p * np.eye(3) - np.outer(p, p))
        for (m, j), p in zip(inertias(campaign), places, strict=True)
    )

    def euler(_, y):
        r, w = y[:9].reshape(3, 3), y[9:]
        return np.concatenate(
            [
                (r @ np.cross(np.eye(3), w)).ravel(),
                np.linalg.solve(inertia, np.cross(inertia @ w, w)),
            ]
        )

    end = solve_ivp(
        euler, (0.0, 2.0), [*np.eye(3).ravel(), *rates], "DOP853", rtol=1e-13, atol=1e-14
    ).y[:, -1]
    last = campaign.simulate(step_s=1.0).iloc[[-1]]
    for body, place in zip(("fore", "aft"), places, strict=True):
        x, _, r, omega = state(last, body)
        assert_allclose(omega[0], end[9:], rtol=0, atol=1e-10)
        assert_allclose(r.as_matrix()[0], end[:9].reshape(3, 3), rtol=0, atol=1e-10)
        assert_allclose(x[0], [2.0, 0.0, 0.0] + end[:9].reshape(3, 3) @ place, rtol=0, atol=1e-10)


@pytest.mark.parametrize("stroke", [1.0, 37.0, 100.0, 222.0])
def test_constant_thrust_on_a_slider(pair, stroke):
    """s = F t^2 / (2 m_aft), release at sqrt(2 L m / F): the step's own arithmetic, so 1e-12
    relative."""
    history = pair({"phase": until(stroke), "motor": [RETRO]}).simulate(step_s=0.01)
    assert_allclose(
        history.attrs["outcomes"]["release_time_s"], math.sqrt(stroke / 1e3), rtol=1e-12
    )
    assert_allclose(
        # round-off of arms of a metre
        history["separation_distance_mm"],
        1e3 * history["time_s"] ** 2,
        rtol=1e-12,
        atol=1e-12,
    )
    assert_allclose(
        history["separation_speed_m_s"], 2.0 * history["time_s"], rtol=1e-12, atol=1e-15
    )


@pytest.mark.parametrize("formulation", ["reduced", "full"])
def test_conservation_in_all_phases(pair, formulation):
    """Nothing acts but the joint; its spin throws the pair apart. Momentum, angular momentum and
    energy keep to 1e-12 of themselves."""
    campaign = pair(
        LOPSIDED
        | {
            "phase": until(300.0, 0.2),
            "initial.omega_rad_s": [0.8, 1.0, -1.5],
            "initial.altitude_m": 0.0,
            "run.end_time_s": 1.0,
        }
        | {"solver.step_s": 0.02, "solver.formulation": formulation}
    )
    history = campaign.simulate(step_s=0.01)
    momentum, spin, energy = 0.0, 0.0, 0.0
    for body, (mass, inertia) in zip(("fore", "aft"), inertias(campaign), strict=True):
        x, v, r, omega = state(history, body)
        momentum = momentum + mass * v
        spin = spin + mass * np.cross(x, v) + r.apply(omega @ inertia)
        energy = (
            energy
            + 0.5 * mass * np.sum(v * v, axis=1)
            + 0.5 * np.sum(omega * (omega @ inertia), axis=1)
        )
    assert set(history["phase"]) == {"locked", "guided", "free"}
    for name, value in (("momentum", momentum), ("angular momentum", spin), ("energy", energy)):
        assert np.abs(value - value[0]).max() <= 1e-12 * np.linalg.norm(value[0]), name


def test_never_released(pair):
    """Nothing pushes: the status says so, the release time is NaN, all other outcomes are there."""
    result = pair({"phase": until(10.0)}).simulate().attrs
    assert result["status"] == "never-released"
    assert [name for name, value in result["outcomes"].items() if math.isnan(value)] == [
        "release_time_s"
    ]


def test_no_stroke_releases_at_once(quiet):
    """Guided for no time: every case is released when the bolts open. 1e-12 s: two times closer
    than this are one."""
    table = quiet.with_settings({"phase.guided.until.stroke_mm": 0.0}).run(cases=100).table
    assert np.all(table["status"] == "ok")
    assert_allclose(table["release_time_s"], 0.05, rtol=0, atol=1e-12)


@pytest.mark.parametrize("ulps", [-4, -1, 0, 1, 4])
def test_release_at_the_end_of_a_step(pair, ulps):
    """10 mm at 2 m/s2 takes 0.1 s, two steps of 0.05 s; a stroke some units in the last place off
    must not matter."""
    stroke = 10.0 * (1.0 + ulps * 2.0**-52)
    result = pair({"phase": until(stroke), "motor": [RETRO]}).simulate().attrs
    assert result["status"] == "ok"
    # the tolerance of the root
    assert_allclose(result["outcomes"]["release_time_s"], 0.1, rtol=0, atol=1e-13)


@pytest.mark.slow
def test_table2_against_the_oracle(table2, quiet, sample, measure):
    """8 cases by Lagrange's equations and scipy: every outcome to 1e-8, at a usual step and at the
    default accuracy, reactions just before release to 1e-8 of their magnitude. Measured: 5e-11 and
    1e-12."""
    expected = [lagrange.simulate(quiet.case(i).to_dict()) for i in range(8)]
    by_name = {name: np.array([case[name] for case in expected]) for name in sample.outcomes}
    shipped = table2.with_settings({"run.history_step_s": 0.0}).run(cases=8)
    for result in (sample, shipped):
        assert measure({n: result.table[n][:8] for n in sample.outcomes}, by_name) <= 1e-8
    for i, case in enumerate(expected):
        history = quiet.simulate(quiet.case(i))
        last = history[history["phase"] == "guided"].iloc[-1]
        for what, unit in (("force", "N"), ("moment", "N_m")):
            results = [last[f"pins_{what}_on_lower_{axis}_{unit}"] for axis in "xyz"]
            reference = case[f"release_{what}_on_lower_{unit}"]
            assert np.linalg.norm(results - reference) <= 1e-8 * np.linalg.norm(reference)


def test_full_against_reduced(quiet, sample, measure):
    """200 cases, every outcome: two ways to solve the same equations, equal to 1e-10. Measured:
    1e-12."""
    full = quiet.with_settings({"solver.formulation": "full"}).run(cases=200)
    assert (
        measure(full.table, {name: sample.table[name][:200] for name in sample.outcomes}) <= 1e-10
    )


def test_joint_residuals(sample):
    """All 2,000 cases: constraints hold to 1e-9 m, and to the last bit where bodies turn as one.
    Measured: 3e-16."""
    gap, angle = sample.table["joint_gap_residual_m"], sample.table["joint_angle_residual_rad"]
    print(f"gap {gap.max():.1e} m")
    assert 0.0 < gap.max() <= 1e-9
    assert angle.max() == 0.0


def si_draws(campaign, count):
    return (
        cases.sample(campaign.file.dispersions, campaign.scene.run.seed, 0, count)
        * campaign.factors
    )


def fly(campaign, draws):
    """Outcomes by name of cases given by their draws in SI."""
    block = step_selection.integrate(campaign, step_selection.select_steps(campaign), draws)
    return {c.name: block.outcomes[:, i] * c.scale for i, c in enumerate(campaign.outcome_columns)}


def test_no_dispersion_gives_equal_rows(quiet):
    """And each is the nominal, which is flown alone by the method that tells of states within steps
    too; 1e-12: a value drawn in mm or deg and scaled need not be the nominal's last bit."""
    same = quiet.with_settings({"solver.method": "dop853"})
    still = same.with_settings(
        {f"dispersion.{d.parameter.key}": {"uniform": 0.0} for d in quiet.file.dispersions}
    )
    table, nominal = still.run(cases=10).table, same.simulate().attrs["outcomes"]
    for name in still.run(cases=10).outcomes:
        assert np.all(table[name] == table[name][0])
        assert_allclose(table[name][0], nominal[name], rtol=1e-12, atol=1e-12)


def test_seen_in_a_mirror(quiet, sample, measure):
    """z -> -z in every input: angles and rates out of the plane change sign, everything else stays.
    1e-12: round-off over a flight."""
    draws, paths = si_draws(quiet, 200), [d.parameter.path for d in quiet.file.dispersions]
    signs = np.array([-1.0 if path.endswith(MIRRORED) else 1.0 for path in paths])
    clock = paths.index("motor.retro.deflection_clock")
    mirrored = draws * signs
    mirrored[:, clock] = np.pi - draws[:, clock]
    expected = {
        name: sample.table[name][:200] * (-1.0 if name.endswith(SIGN_CHANGES) else 1.0)
        for name in sample.outcomes
    }
    assert np.sum(signs < 0.0) == 8
    assert measure(fly(quiet, mirrored), expected) <= 1e-12


def test_turned_about_the_vertical(table2, sample, measure):
    """Level flight with heading, path and wind turned by 50 deg: nothing the vehicle feels changes.
    1e-12: round-off over a flight."""
    level = {
        "initial.pitch_deg": 0.0,
        "initial.alpha_deg": 0.0,
        "initial.roll_deg": 10.0,
        "initial.omega_deg_s": [4.0, 2.0, -1.0],
    }
    here = table2.with_settings(level | {"environment.wind.direction_deg": 30.0})
    there = here.with_settings(
        {
            "initial.yaw_deg": 50.0,
            "initial.path_yaw_deg": 50.0,
            "environment.wind.direction_deg": -20.0,
        }
    )
    felt = [
        name
        for name in sample.outcomes
        if not name.endswith(("pitch_deg", "yaw_deg", "roll_deg", "alpha_ref_deg"))
    ]
    assert (
        measure(there.simulate().attrs["outcomes"], here.simulate().attrs["outcomes"], felt)
        <= 1e-12
    )


def test_order_of_the_bodies_in_the_file(quiet, sample, measure):
    """The lower stage written first: the same outcomes but for the order of sums, 1e-12."""
    tree = quiet.file.tree
    swapped = Campaign(
        parse_campaign({**tree, "body": dict(reversed(tree["body"].items()))}, "swapped")
    )
    assert swapped.layout.bodies == ["lower", "upper"]
    assert (
        measure(
            swapped.run(cases=200).table,
            {name: sample.table[name][:200] for name in sample.outcomes},
        )
        <= 1e-12
    )


def test_axes_carried_by_either_body(quiet, sample, measure):
    """The joint's axes fixed in the lower stage: the same motion; only the free separation is then
    measured along another axis."""
    result = quiet.with_settings({"joint.pins.bodies": ["lower", "upper"]}).run(cases=200).table
    names = [name for name in sample.outcomes if not name.startswith("separation")]
    assert measure(result, {name: sample.table[name][:200] for name in names}, names) <= 1e-12


def test_masses_no_body_can_have(quiet):
    """A normal law with a tail below zero: those cases, and only those, are invalid; none
    raises."""
    table = (
        quiet.with_settings({"dispersion.body.upper.mass_kg": {"normal": 300.0}})
        .run(cases=300)
        .table
    )
    impossible = table["in_body_upper_mass_kg"] <= 0.0
    assert 5 < np.sum(impossible) < 100
    assert_array_equal(table["status"] == "invalid-input", impossible)
    assert np.isnan(table["upper_omega_z_deg_s"][impossible]).all()


@pytest.mark.parametrize("locked", [True, False])
@pytest.mark.parametrize("start", LEAVING, ids=str)
def test_leaving_the_atmosphere(quiet, start, locked):
    """Out of 0 to 86 km, in a joint or free, in the first step or later: the status says that,
    whatever became NaN first."""
    phase = {"name": "locked", "joints": {"pins": "fixed"}} if locked else FREE
    # air that has a density but pushes nothing: at these angles the polynomials mean nothing
    calm = {
        **{
            f"body.{b}.aerodynamics.{f}_factor": 0.0
            for b in ("upper", "lower")
            for f in ("force", "moment")
        },
        "initial.alpha_deg": 0.0,
        "environment.wind.speed_m_s": 0.0,
        "motor.retro.thrust_N": 0.0,
        "phase": [phase],
        "run.end_time_s": 5.0,
    }
    height, speed, pitch = start
    calm |= {"initial.altitude_m": height, "initial.speed_m_s": speed, "initial.pitch_deg": pitch}
    tree = {key: value for key, value in quiet.file.tree.items() if key != "dispersion"}
    result = Campaign(parse_campaign(tree, "calm", calm)).simulate(step_s=0.1).attrs
    assert result["status"] == "outside-atmosphere"
    assert math.isnan(result["outcomes"]["upper_omega_z_deg_s"])


@pytest.mark.slow
def test_a_step_too_long_is_told(quiet):
    """A pitch rate that the aerodynamics make explode: never a number that looks like an answer."""
    tree = {key: value for key, value in quiet.file.tree.items() if key != "dispersion"}
    result = (
        Campaign(parse_campaign(tree, "wild", {"initial.omega_deg_s": [0.0, 0.0, 60.0]}))
        .simulate(step_s=0.1)
        .attrs
    )
    assert result["status"] in ("unresolved", "not-finite")
    assert math.isnan(result["outcomes"]["upper_omega_z_deg_s"])


def test_sign_of_apart_is_that_of_the_nominal(monkeypatch):
    """A slider across the vehicle whose bodies' dispersed centres pass each other: a case alone
    equals its row in the campaign."""
    bodies = {
        name: {"mass_kg": 10.0, "inertia_kg_m2": [1.0, 1.0, 1.0], "cg_m": [0.0, y, 0.0]}
        for name, y in (("tube", 0.0), ("box", 0.001))
    }
    tree = {
        "environment": {"atmosphere": "none", "gravity": "none"},
        "body": bodies,
        "motor": [
            {
                "name": "push",
                "body": "box",
                "thrust_N": 10.0,
                "station_m": 0.0,
                "cant_deg": 90.0,
                "clock_deg": -90.0,
            }
        ],
        "joint": {
            "rail": {
                "bodies": ["tube", "box"],
                "point_m": [0.0, 0.0, 0.0],
                "x_axis": [0, 1, 0],
                "y_axis": [1, 0, 0],
            }
        },
        "phase": [
            {
                "name": "guided",
                "joints": {"rail": "slider"},
                "until": {"joint": "rail", "stroke_m": 0.2},
            },
            {"name": "free"},
        ],
        "initial": {"altitude_m": 0.0, "speed_m_s": 1.0},
        "dispersion": {"body.box.cg_m.y": {"uniform": 0.005}},
        "run": {"end_time_s": 1.0, "cases": 20},
        "solver": {"step_s": 0.05},
    }
    monkeypatch.setattr(step_selection, "CORNERS", 2)
    monkeypatch.setattr(step_selection, "SAMPLE", 4)
    campaign = Campaign(parse_campaign(tree, "across"))
    with interpreted():
        result = campaign.run()
    assert set(result.table["status"]) == {"ok"}
    assert np.ptp(np.sign(result.table["in_body_box_cg_y_m"])) > 0
    for i in range(5):
        alone = campaign.simulate(result.case(i)).attrs["outcomes"]["release_time_s"]
        assert_allclose(alone, result.table["release_time_s"][i], rtol=1e-14)
