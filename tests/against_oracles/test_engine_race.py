"""Outcomes of other engines on the campaign of Table 2 agree with the engine's, within the accuracy
of each."""

import importlib

import numpy as np
import pytest
from oracles.engine_race import Entry, error, race, worst
from oracles.engine_race.inputs import read

import sepmc

CASES = 11  # not a whole number of batches
NONE = dict.fromkeys(("heyoka", "mujoco", "scipy", "exudyn"), 0)


@pytest.fixture(scope="module")
def campaign():
    return sepmc.load("table2.toml", {"run.history_step_s": 0.0})


@pytest.fixture(scope="module")
def ours(campaign):
    """Outcomes with steps of 0.01 s (their error is below 1e-12), and their scatter."""
    result = campaign.with_settings({"solver.step_s": 0.01}).run(cases=64)
    reference = {name: result.table[name] for name in result.outcomes}
    return reference, {name: float(np.std(values)) for name, values in reference.items()}


def off(flight, ours):
    result = flight.outcomes(flight.fly())
    assert set(result) == set(ours[0])
    return worst(result, *ours)


@pytest.mark.parametrize(
    ("arguments", "bound"),
    [
        ((1e-9,), 1e-8),
        ((1e-15,), 2e-11),
        ((None, (7, 10, 10), (1, 2, 2)), 1e-5),
        ((None, (12, 14, 14), (1, 3, 3)), 1e-10),
    ],
)
@pytest.mark.parametrize("batch", [4, 8])
def test_heyoka(campaign, ours, batch, arguments, bound):
    flight = pytest.importorskip("oracles.engine_race.heyoka", exc_type=ImportError).HeyokaFlight
    assert off(flight(read(campaign, CASES), batch, *arguments), ours)[0] < bound


def test_mujoco_is_of_fourth_order(campaign, ours):
    flight = pytest.importorskip("oracles.engine_race.mujoco", exc_type=ImportError).MujocoFlight
    coarse, fine = (off(flight(read(campaign, CASES), step, 1), ours)[0] for step in (0.05, 0.025))
    assert coarse < 1e-3
    assert 10.0 < coarse / fine < 24.0


def test_exudyn(campaign, ours):
    flight = pytest.importorskip("oracles.engine_race.exudyn", exc_type=ImportError).ExudynFlight
    assert off(flight(campaign, read(campaign, 1), 0.005, 1), ours)[0] < 1e-4


@pytest.mark.slow
def test_race_with_scipy(campaign, ours):
    calls = []
    entries = race(campaign, 1, calls.append, {**NONE, "scipy": 2}, 1)
    assert len(calls) == len(entries)
    assert all(
        isinstance(e, Entry) and e.seconds_per_case > 0.0 and e.extrapolated for e in entries
    )
    by_name = {e.setting: error(e, *ours) for e in entries}
    assert by_name["rtol 1e-12"] < 1e-9
    assert by_name["rtol 1e-12"] < by_name["rtol 1e-06"]


def test_race_in_processes(campaign, ours, monkeypatch):
    """Shares of the cases come back in order."""
    pytest.importorskip("heyoka")
    module = importlib.import_module("oracles.engine_race.race")
    monkeypatch.setattr(module, "TOLERANCES", (1e-6,))  # the rest would compile for a minute
    monkeypatch.setattr(module, "ORDERS", module.ORDERS[:1])
    entries = race(campaign, 2, lambda _: None, {**NONE, "heyoka": 5}, 1)
    assert max(error(e, *ours) for e in entries) < 1e-3
    assert all(
        e.cases == 5 and len(e.outcomes["release_time_s"]) == 5 and e.compile_s > 0.0
        for e in entries
    )


def test_inputs_follow_the_case(campaign):
    """Arrays of all cases against each case resolved alone."""
    from oracles.external_engines.case import Case

    inputs, case = read(campaign, 3), Case(campaign.case(2).to_dict())
    motions = case.initial()
    for body in inputs.bodies:
        np.testing.assert_allclose(
            np.diag(body.inertia[2]), case.bodies[body.name].inertia, rtol=1e-15
        )
        np.testing.assert_allclose(inputs.R[2] @ body.place[2], motions[body.name].x, atol=1e-14)
    np.testing.assert_allclose(inputs.R[2], case.R0, atol=1e-15)
    np.testing.assert_allclose(inputs.velocity[2], case.velocity, rtol=1e-14)


@pytest.mark.parametrize("name", ["srb", "spring-pushers", "missile-rail", "hyper-x"])
def test_other_scenes_are_refused(name):
    with pytest.raises(ValueError, match="table1 and table2"):
        race(sepmc.load(name), 1, lambda _: None)


def test_a_second_threshold_is_refused():
    """Other engines would ignore it."""
    more = {"phase.locked.until.body": "upper", "phase.locked.until.altitude_m": 1e5}
    with pytest.raises(ValueError, match="table1 and table2"):
        race(sepmc.load("table2", more), 1, lambda _: None)


def test_fixed_properties_are_named():
    campaign = sepmc.load(
        "table2.toml", {"dispersion": {"motor.retro.build_up_s": {"uniform": 0.01}}}
    )
    with pytest.raises(ValueError, match=r"cannot vary motor\.retro\.build_up"):
        read(campaign, 2)
