"""Cases that settle by themselves, outcomes that no step settles, and what a single run says of
that; gusts that no step jumps over."""

import itertools

import numpy as np
import pytest
from numpy.testing import assert_allclose, assert_array_equal
from oracles.independent import simulate

from sepmc.campaign.execution import step_refinement
from sepmc.campaign.execution.step_refinement import longest_step
from sepmc.kernel.spec.heights import rows_step
from sepmc.schema import Status

ONE = np.ones(2)
BOTH = np.array([True, True])


def flier(error):
    """A stand-in for the kernel: outcomes 1 + ``error(step, case)`` and 2, and the steps each case
    was flown at, last first."""
    flown = {}

    def integrate(step, which):
        for case in which:
            flown.setdefault(int(case), []).insert(0, step)
        return np.array([[1.0 + error(step, case), 2.0] for case in which]), np.zeros(
            len(which), dtype=int
        )

    return integrate, flown


def test_each_case_settles_by_itself():
    """An error of order 4, ten times as large in each case: the step told is the one each case was
    flown at last."""
    integrate, flown = flier(lambda step, case: 10.0**case * step**4)
    result = step_refinement.refine_steps(integrate, 4, 0.1, 1e-9, ONE, BOTH)
    assert result.converged.all()
    assert np.all(np.diff(result.step) <= 0.0)
    assert result.step[3] < result.step[0]
    for case, steps in flown.items():
        assert steps[0] == result.step[case]
        assert 10.0**case * steps[0] ** 4 <= 1e-9
    assert_array_equal(result.change[:, 1], 0.0)


def test_one_agreement_may_be_luck():
    """Halving changes nothing once, between 0.1 and 0.05, and a lot afterwards: that is not
    settled."""
    integrate, _ = flier(lambda step, case: 1e-3 if step > 0.04 else step**4)
    result = step_refinement.refine_steps(integrate, 1, 0.1, 1e-9, ONE, BOTH)
    assert result.converged[0]
    assert result.step[0] ** 4 <= 1e-9


def test_a_case_that_does_not_settle_is_given_up():
    """Noise of 1e-6: not after all halvings, and its change is told."""
    integrate, flown = flier(lambda step, case: 1e-6 * np.sin(1.0 / step))
    result = step_refinement.refine_steps(integrate, 1, 0.1, 1e-9, ONE, BOTH)
    assert not result.converged[0]
    assert 1e-8 < result.change[0, 0] <= 2e-6
    assert len(flown[0]) < 8


@pytest.mark.parametrize("seen_at", [0.1 * 2.0**-6.5, 0.0])
def test_a_case_alone_is_refined_on_until_steps_see_what_happens(pair, seen_at):
    """Halvings that do not help end the search at fine steps only; then the outcome is named."""
    columns = pair({"solver.accuracy": 1e-9}).outcome_columns
    scene = pair({"solver.accuracy": 1e-9}).scene

    def integrate(step, which):
        row = np.ones(len(columns))
        row[1] += 1e-3 * np.sin(1.0 / step) if step > seen_at else step**4
        return np.tile(row, (len(which), 1)), np.zeros(len(which), dtype=int)

    step, change, notes = step_refinement.refine_case_steps(integrate, 0.1, scene, columns)
    assert change.argmax() == 1
    if seen_at:
        assert not notes
        assert step < seen_at
        assert change[1] <= 1e-9
    else:
        assert f"a shorter step changes {columns[1].name} by" in notes[0]
        assert 1e-9 < change[1] < 1e-2


@pytest.mark.parametrize("status", [Status.OUTSIDE_TABLE, Status.OUTSIDE_ATMOSPHERE, Status.JAMMED])
def test_a_status_that_only_long_steps_give_is_no_result(status):
    """The first of two cases leaves its table at steps beyond 0.01, the second at all."""

    def integrate(step, which):
        lost = (which > 0) | (step > 0.01)
        outcomes = np.array([[1.0 + step**4, 2.0] for _ in which])
        return np.where(lost[:, None], np.nan, outcomes), np.where(lost, status, Status.OK)

    result = step_refinement.refine_steps(integrate, 2, 0.5, 1e-9, ONE, BOTH)
    assert_array_equal(result.status, [Status.OK, status])
    assert_array_equal(result.converged, [True, True])
    assert result.step[0] < 0.01 < result.step[1]


def test_a_case_that_ends_otherwise_has_not_settled():
    def integrate(step, which):
        return np.ones((len(which), 2)), np.full(
            len(which), Status.OK if step < 0.06 else Status.NEVER_RELEASED
        )

    result = step_refinement.refine_steps(integrate, 1, 0.1, 1e-9, ONE, BOTH)
    assert result.converged[0]
    assert result.step[0] == 0.0125


def test_a_status_that_does_not_last_is_infinitely_wrong():
    ok, lost = np.zeros(1, dtype=int), np.array([Status.UNRESOLVED])
    same = np.ones((1, 2))
    assert_array_equal(
        step_refinement.changes(same, ok, same, lost, ONE, np.array([True, False])), [[np.inf, 0.0]]
    )
    assert_array_equal(
        step_refinement.changes(same, lost, 2.0 * same, lost, ONE, BOTH), [[1.0, 1.0]]
    )
    invalid = np.array([Status.INVALID_INPUT])
    assert_array_equal(
        step_refinement.changes(same, invalid, 2.0 * same, invalid, ONE, BOTH), [[0.0, 0.0]]
    )


@pytest.mark.parametrize("accuracy", [1e-3, 1e-9])
def test_a_single_run_is_as_accurate_as_asked(table2, accuracy):
    campaign = table2.with_settings({"solver.accuracy": accuracy})
    result = campaign.simulate(step_s=0.1).attrs
    fine = table2.with_settings({"solver.accuracy": 1e-11}).simulate(step_s=0.1).attrs
    assert result["notes"] == []
    for name in ("upper_omega_z_deg_s", "separation_distance_mm", "release_time_s"):
        assert result["outcomes"][name] == pytest.approx(fine["outcomes"][name], rel=accuracy)


@pytest.mark.slow
def test_no_gust_is_jumped_over(pair):
    """Steps pass four rows of a wind profile at most: a gust of a millisecond, between the nodes of
    usual first steps, turns the body."""
    heights = 1500.0 + 0.25 * np.arange(-12, 13)
    rows = {
        "altitude_m": [0.0, *heights, 80_000.0],
        "speed_m_s": [0.0, *(100.0 * np.exp(-(np.arange(-12, 13) ** 2) / 8.0)), 0.0],
    }
    rows |= {"direction_deg": [90.0] * len(rows["altitude_m"])}
    air = {"reference_area_m2": 0.1, "reference_length_m": 1.0, "roll": {"beta": 1.0}}
    settings = {
        "environment": {"atmosphere": "us1976", "gravity": "none", "wind": {"profile": rows}},
        "body.fore.aerodynamics": air,
        "initial": {"altitude_m": 1000.0, "speed_m_s": 1000.0, "pitch_deg": 90.0},
        "phase": [{"name": "free"}],
        "run.end_time_s": 1.0,
        "solver": {"accuracy": 1e-6},
    }
    campaign = pair(settings)
    assert longest_step(campaign.scene) <= 1.0 / 1000.0
    result = campaign.run(cases=1).table["fore_omega_x_deg_s"][0]
    expected = simulate(campaign.case(0).to_dict()).outcomes["fore_omega_x_deg_s"]
    assert abs(expected) > 0.1
    assert_allclose(result, expected, rtol=1e-5)


def test_extremes_of_a_discrete_law(table2):
    """Its values stand in any order."""
    campaign = table2.with_settings(
        {"dispersion": {"initial.altitude_m": {"discrete": [500.0, 9000.0, 100.0]}}}
    )
    assert [scene.initial.altitude for scene in campaign.layout.extremes] == [100.0, 9000.0]


@pytest.mark.slow
@pytest.mark.parametrize("by", ["thrust", "a law of speed", "a law of altitude"])
def test_no_gust_is_jumped_over_that_only_loads_or_laws_lead_to(pair, by):
    """The nominal start is at rest or far away; the gust is where the motor, or the law of the
    first state, takes the vehicle."""
    speeds = [0.0, 0.0, 0.0, 10.0, 40.0, 10.0, 0.0, 0.0, 0.0]
    heights = [0.0, *(2030.0 + np.arange(-3, 4)), 80_000.0]
    rows = {"altitude_m": heights, "speed_m_s": speeds, "direction_deg": [90.0] * len(speeds)}
    air = {"reference_area_m2": 0.1, "reference_length_m": 1.0, "roll": {"beta": 1.0}}
    settings = {
        "environment": {"atmosphere": "us1976", "gravity": "none", "wind": {"profile": rows}},
        "body.fore.aerodynamics": air,
        "initial": {"altitude_m": 2000.0, "speed_m_s": 0.0, "pitch_deg": 90.0},
        "phase": [{"name": "together", "joints": {"pins": "fixed"}}],
        "run.end_time_s": 0.5,
        "solver": {"accuracy": 1e-6},
    }
    if by == "thrust":
        settings |= {
            "motor": [
                {"name": "m", "body": "fore", "thrust_N": 4000.0, "station_m": 0.0, "cant_deg": 0.0}
            ]
        }
    elif by == "a law of speed":
        settings |= {"dispersion": {"initial.speed_m_s": {"uniform": [400.0, 500.0]}}}
    else:
        settings["initial"] = {"altitude_m": 9000.0, "speed_m_s": 100.0, "pitch_deg": 90.0}
        settings |= {"dispersion": {"initial.altitude_m": {"uniform": [2010.0, 2020.0]}}}
    campaign = pair(settings)
    result = campaign.run(cases=3).table["fore_omega_x_deg_s"]
    expected = np.array(
        [simulate(campaign.case(i).to_dict()).outcomes["fore_omega_x_deg_s"] for i in range(3)]
    )
    assert np.abs(expected).min() > 1e-3
    assert_allclose(result, expected, rtol=1e-5)


def test_the_bound_of_speed_holds_for_any_mix_of_extremes(pair):
    """A strong soft spring, a load that comes early and stays long: neither end of all laws
    together, and the step is no longer."""
    rows = {
        "altitude_m": [0.0, 1000.0, 80_000.0],
        "speed_m_s": [0.0, 0.0, 0.0],
        "direction_deg": [90.0] * 3,
    }
    spring = {"bodies": ["fore", "aft"], "point_m": [2.0, 0.0, 0.0], "axis": [-1.0, 0.0, 0.0]}
    settings = {
        "environment": {"atmosphere": "none", "gravity": "none", "wind": {"profile": rows}},
        "initial": {"altitude_m": 1000.0, "speed_m_s": 0.0},
        "spring": [
            {"name": "s", **spring, "force_N": 1000.0, "stiffness_N_per_m": 1000.0, "stroke_m": 5.0}
        ],
        "load": [
            {
                "name": "l",
                "body": "fore",
                "force_N": [500.0, 0.0, 0.0],
                "start_s": 0.3,
                "end_s": 0.6,
            }
        ],
    }
    laws = {
        "spring.s.force_N": [100.0, 1900.0],
        "spring.s.stiffness_N_per_m": [100.0, 1900.0],
        "load.l.start_s": [0.0, 0.5],
        "load.l.end_s": [0.55, 0.9],
    }
    given = pair(settings | {"dispersion": {key: {"uniform": ends} for key, ends in laws.items()}})
    bound = rows_step(given.scene, given.layout.extremes)
    mixed = [dict(zip(laws, ends, strict=True)) for ends in itertools.product(*laws.values())]
    alone = [rows_step(pair(settings).with_settings(values).scene) for values in mixed]
    assert bound <= min(alone) * (1.0 + 1e-5)  # ends of laws are those of all but 1e-6 of the draws
    assert min(alone) < 0.9 * min(rows_step(scene) for scene in given.layout.extremes)
