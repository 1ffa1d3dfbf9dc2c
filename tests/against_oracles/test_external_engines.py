"""Cases by other engines: `oracles.external_engines`. Each test is skipped if its engine is not
installed."""

import math

import numpy as np
import pytest
from oracles.external_engines import compare, loads
from oracles.external_engines.case import Case

import sepmc

TREES = ("heyoka", "pinocchio")


def engines(*names):
    """``fly`` of these engines."""
    return {
        name: pytest.importorskip(f"oracles.external_engines.{name}", exc_type=ImportError).fly
        for name in names
    }


def apart(data, one, two, times):
    """Largest relative difference of every quantity between the flights of two engines."""
    case = Case(data)
    a, b = (
        compare.peer_record(case, getattr(f, "flight", f))
        for f in (one(data, times), two(data, times))
    )
    return compare.differences(a, b, compare.one_value(case, np.array(times)))


@pytest.mark.parametrize("name", compare.ENGINES)
def test_engine_against_external_engines(name):
    """Table 2: fixed, slider, free; air, wind, gravity and a motor."""
    result = compare.compare(sepmc.load("table2.toml"), [0], 0.05, engines(name))
    assert set(result["quantity"]) == set(compare.FLOORS)
    assert (result["verdict"] == "agrees").all(), result.to_string()


@pytest.mark.parametrize(
    ("campaign", "number", "times"),
    [
        ("nasa-fixed-joint.toml", 0, [0.0, 9.5, 11.0]),
        ("spring-pushers.toml", 1, [0.0, 0.03, 0.1, 2.0]),  # springs
        # ground, break load, a joint of its own kind
        ("missile-rail.toml", 0, [0.0, 0.1, 0.17, 0.3]),
    ],
)
def test_minimal_coordinates_twice(campaign, number, times):
    """Kane's equations in heyoka, the articulated-body algorithm in Pinocchio: round-off (measured:
    6e-14)."""
    flown = engines(*TREES)
    result = apart(sepmc.load(campaign).case(number).to_dict(), *flown.values(), times)
    assert max(result.values()) < 1e-11, result


def test_multipliers_and_minimal_coordinates():
    """Exudyn has redundant coordinates and multipliers, heyoka neither."""
    flown = engines("heyoka", "exudyn")
    result = apart(
        sepmc.load("missile-rail.toml").case(0).to_dict(), *flown.values(), [0.0, 0.1, 0.17, 0.3]
    )
    assert max(result.values()) < 1e-6, result


def test_exudyn_is_of_second_order():
    """Halving the step divides the error by four, before extrapolation."""
    fly = engines("exudyn")["exudyn"]
    result = fly(sepmc.load("missile-rail.toml").case(0).to_dict(), [0.3])
    coarse, fine, _ = (
        abs(level.release["shoe"] - result.flight.release["shoe"]) for level in result.levels
    )
    assert 3.5 < coarse / fine < 4.5


def test_unsupported_features_are_refused():
    data = sepmc.load("table2.toml").case(0).to_dict()
    data["environment"]["atmosphere"] = "table"
    data["parachute"] = [{"name": "main"}]
    with pytest.raises(NotImplementedError, match=r"\[parachute\], tables of air"):
        Case(data)


@pytest.mark.parametrize(("time", "expected"), [(0.05, 0.0), (0.15, 0.0), (0.25, 1.2), (0.35, 0.0)])
def test_thrust_of_a_profile_that_begins_late(time, expected):
    """Ignition at 0.1 s; rows at 0.2 s (half of 2 N) and 0.3 s (0.7 of it): zero before and
    after."""
    profile = {"time": [0.1, 0.2], "fraction": [0.5, 0.7]}
    motor = {"thrust": 2.0, "ignition": 0.1, "burn": 0.2, "profile": profile}
    result = loads.thrust(motor, loads.motor_piece(motor, time), time, math)
    assert result == pytest.approx(expected, abs=1e-12)
