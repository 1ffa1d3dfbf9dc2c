"""Clearances, least distances and recontact: hand formulas."""

import math

import numpy as np
import pytest
from numpy.testing import assert_allclose
from scipy.optimize import brentq
from support.output_scenes import FREE, RETRO, SLIDER, flown, phases

from sepmc.campaign.execution import step_selection


def tubes(bodies, **settings):
    """The pair parting at 2 m/s2 of the aft body along x, with outlines."""
    scene = {
        "motor": [RETRO],
        "phase": [{"name": "free"}],
        "clearance": [{"name": "gap", "bodies": ["fore", "aft"]}],
    }
    return (
        scene
        | {f"body.{name}.outline": parts for name, parts in bodies.items()}
        | {key.replace("__", "."): value for key, value in settings.items()}
    )


def cylinder(s0, s1, r, offset=(0.0, 0.0), **keys):
    return {"stations_m": [s0, s1], "radii_m": [r, r], "offset_m": list(offset)} | keys


def test_cylinders_parting(pair):
    """Ends 30 mm apart, then s = t^2 more: least at once, at a point of the fore body's end."""
    _, outcomes = flown(
        pair(tubes({"fore": [cylinder(0.0, 2.0, 0.2)], "aft": [cylinder(2.03, 4.0, 0.2)]}))
    )
    assert_allclose(outcomes["gap_clearance_mm"], 30.0, rtol=1e-12)
    assert outcomes["gap_clearance_time_s"] == 0.0
    assert_allclose(outcomes["gap_clearance_station_m"], 2.0, rtol=1e-12)
    assert math.hypot(outcomes["gap_clearance_y_m"], outcomes["gap_clearance_z_m"]) <= 0.2 + 1e-12
    assert outcomes["gap_recontact"] == 0.0


def test_side_by_side(pair):
    """Axes 0.5 m apart, radii 0.2 m and 0.22 m, sliding past each other: 80 mm at all times, the
    nearest point on the fore's side."""
    _, outcomes = flown(
        pair(
            tubes(
                {"fore": [cylinder(0.0, 4.0, 0.2)], "aft": [cylinder(2.0, 4.0, 0.22, (0.3, 0.4))]}
            )
        )
    )
    assert_allclose(outcomes["gap_clearance_mm"], 80.0, rtol=1e-12)
    assert_allclose(
        [outcomes["gap_clearance_y_m"], outcomes["gap_clearance_z_m"]],
        [0.2 * 0.6, 0.2 * 0.8],
        rtol=0,
        atol=1e-9,
    )


PAST = {"name": "side", "body": "aft", "force_N": [0.0, -4.0, 0.0]}  # 4 m/s2 across


@pytest.mark.parametrize(("jump", "touches"), [(1.0, False), (0.97, False), (1.3, True)])
def test_least_distance_in_flight(pair, jump, touches):
    """A point of the aft body falls past the fore's cylinder, (x, y) = (-t^2, h - 2 t^2): the least
    at 120,001 times."""
    scene = tubes(
        {"fore": [cylinder(2.3, 2.6, 0.4)], "aft": [{"points_m": [[1.5, jump, 0.0]]}]},
        load=[PAST],
        run__end_time_s=1.2,
    )
    _, outcomes = flown(pair(scene))
    times = np.linspace(0.0, 1.2, 120_001)
    station, y = 1.5 + times**2, jump - 2.0 * times**2
    distance = np.hypot(
        np.maximum(np.maximum(2.3 - station, station - 2.6), 0.0), np.maximum(np.abs(y) - 0.4, 0.0)
    )
    assert (distance.min() == 0.0) == touches
    assert outcomes["gap_recontact"] == float(touches)
    assert_allclose(outcomes["gap_clearance_mm"] / 1e3, distance.min(), rtol=0, atol=1e-8)
    if not touches:
        assert_allclose(
            outcomes["gap_clearance_time_s"], times[distance.argmin()], rtol=0, atol=1e-4
        )


def test_closest_approach_of_two_points(pair):
    """Two points, (-0.2 + t^2, 0.4 - 1.5 t^2, 0.1) m apart: a parabola in t^2, least where its
    derivative is nil."""
    load = [PAST | {"force_N": [0.0, -3.0, 0.0]}]
    scene = tubes(
        {"fore": [{"points_m": [[2.5, 0.0, 0.0]]}], "aft": [{"points_m": [[2.3, 0.4, 0.1]]}]},
        load=load,
        run__end_time_s=1.0,
    )
    _, outcomes = flown(pair(scene))
    u = (0.2 + 1.5 * 0.4) / (1.0 + 1.5**2)  # t^2 at which |(-0.2 + u, 0.4 - 1.5 u)| is least
    assert_allclose(
        outcomes["gap_clearance_mm"],
        1e3 * math.sqrt((0.2 - u) ** 2 + (0.4 - 1.5 * u) ** 2 + 0.01),
        rtol=1e-12,
    )
    assert_allclose(outcomes["gap_clearance_time_s"], math.sqrt(u), rtol=0, atol=1e-7)
    assert_allclose(
        [outcomes[f"gap_clearance_{k}_m"] for k in ("station", "y", "z")],
        [2.5, 0.0, 0.0],
        rtol=0,
        atol=1e-12,
    )


@pytest.mark.parametrize("order", [["fore", "aft"], ["aft", "fore"]])
def test_a_point_inside_a_shell(pair, order):
    """A shell of 0.5 m on the fore, a point of the aft at y = 0.3 m in it, which falls 2 t^2:
    through the wall at 0.63 s, still inside."""
    bodies = {
        "fore": [cylinder(2.0, 4.0, 0.5, hollow=True)],
        "aft": [{"points_m": [[2.2, 0.3, 0.0]]}],
    }
    scene = tubes(
        bodies, load=[PAST], run__end_time_s=0.6, clearance=[{"name": "gap", "bodies": order}]
    )
    _, outcomes = flown(pair(scene))
    # y = 0.3 - 2 t^2, at 0.6 s -0.42 m: 80 mm from the wall
    assert_allclose(outcomes["gap_clearance_mm"], 80.0, rtol=1e-9)
    assert_allclose(outcomes["gap_clearance_time_s"], 0.6, rtol=1e-12)
    expected = [2.2 + 0.36, -0.5, 0.0] if order[0] == "fore" else [2.2, 0.3, 0.0]
    assert_allclose(
        [outcomes[f"gap_clearance_{k}_m"] for k in ("station", "y", "z")],
        expected,
        rtol=0,
        atol=1e-9,
    )
    _, later = flown(pair(scene | {"run.end_time_s": 0.7}))
    assert later["gap_recontact"] == 1.0
    # counted as far as a tenth of the radius outside the wall
    assert_allclose(later["gap_clearance_mm"], -50.0, rtol=1e-6)


def test_out_of_a_shell_in_time(pair):
    """The shell is 0.4 m long: the point leaves it before it could meet the wall, and passes its
    lip from outside."""
    bodies = {
        "fore": [cylinder(2.0, 2.4, 0.5, hollow=True)],
        "aft": [{"points_m": [[2.2, 0.3, 0.0]]}],
    }
    _, outcomes = flown(pair(tubes(bodies, load=[PAST], run__end_time_s=1.0)))
    assert outcomes["gap_recontact"] == 0.0
    # out at t^2 = 0.2, when y = -0.1; from the lip at y = -0.5 it is (0.2 - t^2, 0.8 - 2 t^2):
    # least at t^2 = 0.36
    assert_allclose(outcomes["gap_clearance_mm"], 1e3 * math.hypot(0.16, 0.08), rtol=1e-9)
    assert_allclose(outcomes["gap_clearance_time_s"], 0.6, rtol=0, atol=1e-6)


@pytest.mark.parametrize("order", [["fore", "aft"], ["aft", "fore"]])
def test_a_side_on_the_lip_of_a_shell(pair, order):
    """A cylinder of 0.3 m that stands out of a ring of 0.5 m at both ends falls 2 t^2: it touches
    both lips at t^2 = 0.1."""
    bodies = {"fore": [cylinder(2.0, 2.2, 0.5, hollow=True)], "aft": [cylinder(1.0, 4.0, 0.3)]}
    scene = tubes(
        bodies, load=[PAST], run__end_time_s=0.25, clearance=[{"name": "gap", "bodies": order}]
    )
    _, outcomes = flown(pair(scene))
    assert_allclose(outcomes["gap_clearance_mm"], 75.0, rtol=1e-9)
    assert_allclose(
        [outcomes["gap_clearance_time_s"], outcomes["gap_clearance_z_m"]],
        [0.25, 0.0],
        rtol=0,
        atol=1e-6,
    )
    _, later = flown(pair(scene | {"run.end_time_s": 0.5}))
    assert (later["gap_recontact"], later["gap_clearance_mm"]) == (1.0, 0.0)
    assert_allclose(later["gap_clearance_time_s"], math.sqrt(0.1), rtol=0, atol=1e-8)


def test_recontact(pair):
    """Driven back into each other: a negative clearance."""
    load = [{"name": "back", "body": "aft", "force_N": [6.0, 0.0, 0.0]}]
    _, outcomes = flown(
        pair(
            tubes({"fore": [cylinder(0.0, 2.0, 0.2)], "aft": [cylinder(2.03, 4.0, 0.2)]}, load=load)
        )
    )
    assert outcomes["gap_clearance_mm"] <= 0.0
    assert outcomes["gap_recontact"] == 1.0


def test_clearance_after_a_joint(pair):
    """Measured from the release on, when it is the stroke; never without a release."""
    bodies = {"fore": [cylinder(0.0, 2.0, 0.2)], "aft": [cylinder(2.0, 4.0, 0.2)]}
    clearance = [
        {"name": "gap", "bodies": ["fore", "aft"], "after": "pins"},
        {"name": "all", "bodies": ["fore", "aft"]},
    ]
    steps = phases((SLIDER, {"joint": "pins", "stroke_mm": 50.0}), (FREE, None))
    campaign = pair(tubes(bodies, clearance=clearance, phase=steps))
    _, outcomes = flown(campaign)
    assert_allclose(outcomes["gap_clearance_mm"], 50.0, rtol=1e-9)
    assert_allclose(outcomes["gap_clearance_time_s"], math.sqrt(0.05), rtol=1e-9)
    assert outcomes["gap_recontact"] == 0.0
    assert outcomes["all_recontact"] == 1.0
    _, held = flown(campaign.with_settings({"joint.pins.fails": 1}), status="never-released")
    assert all(math.isnan(value) for name, value in held.items() if name.startswith("gap_"))


def test_clearance_over_time(pair):
    """Every row of a history has the distance at its time; the outcome is the minimum. None before
    the joint is free."""
    fore, aft = [cylinder(2.3, 2.6, 0.4)], [{"points_m": [[1.5, 0.97, 0.0]]}]
    history, outcomes = flown(
        pair(tubes({"fore": fore, "aft": aft}, load=[PAST], run__end_time_s=1.2)), 0.01
    )
    station, y = 1.5 + history["time_s"] ** 2, 0.97 - 2.0 * history["time_s"] ** 2
    distance = np.hypot(
        np.maximum(np.maximum(2.3 - station, station - 2.6), 0.0), np.maximum(np.abs(y) - 0.4, 0.0)
    )
    assert_allclose(history["gap_clearance_mm"], 1e3 * distance, rtol=0, atol=1e-8)
    assert outcomes["gap_clearance_mm"] <= history["gap_clearance_mm"].min() + 1e-9
    bodies = {"fore": [cylinder(0.0, 2.0, 0.2)], "aft": [cylinder(2.0, 4.0, 0.2)]}
    history, _ = flown(
        pair(
            tubes(
                bodies,
                clearance=[{"name": "gap", "bodies": ["fore", "aft"], "after": "pins"}],
                phase=phases((SLIDER, {"joint": "pins", "stroke_mm": 50.0}), (FREE, None)),
            )
        )
    )
    free = history["phase"] == history["phase"].iloc[-1]
    assert history["gap_clearance_mm"][~free].isna().all()
    assert_allclose(
        history["gap_clearance_mm"][free], history["separation_distance_mm"][free], rtol=1e-9
    )


def test_clearance_between_turning_bodies(pair):
    """A corner of the aft body, spun about z at the release, comes nearest to the fore's end face:
    its least station by brentq."""
    load = [{"name": "turn", "body": "aft", "moment_N_m": [0.0, 0.0, 4.0]}]  # 2 rad/s2: t^2
    bodies = {"fore": [cylinder(0.0, 2.0, 2.0)], "aft": [{"points_m": [[2.1, 1.0, 0.0]]}]}
    _, outcomes = flown(pair(tubes(bodies, load=load, motor=[], run__end_time_s=0.9)))
    # from the mass centre (0.9, 1.0): forward part 0.9 cos a - 1.0 sin a, a = t^2; it starts 0.1 m
    # off and recedes, for z turns the nose up
    assert_allclose(outcomes["gap_clearance_mm"], 100.0, rtol=1e-9)
    back = [{"name": "turn", "body": "aft", "moment_N_m": [0.0, 0.0, -1.0]}]  # a = -t^2 / 4
    bodies["aft"] = [{"points_m": [[2.5, 1.0, 0.0]]}]
    _, outcomes = flown(pair(tubes(bodies, load=back, motor=[], run__end_time_s=2.5)))
    forward = math.hypot(0.5, 1.0)
    assert_allclose(
        outcomes["gap_clearance_mm"], 0.0 if forward > 1.0 else 1e3 * (1.0 - forward), rtol=1e-9
    )
    touch = brentq(lambda a: 0.5 * math.cos(a) + math.sin(a) - 1.0, 0.0, 1.0)
    assert touch < 2.5**2 / 4.0
    assert outcomes["gap_recontact"] == 1.0


@pytest.mark.slow
@pytest.mark.parametrize("parts", ["cones", "shell"])
def test_least_distance_does_not_depend_on_the_step(pair, parts, monkeypatch):
    """Cones of many slopes that pass each other, tumbling, in one, two or twenty steps: 100 cases,
    minimum distance to 1 um."""
    monkeypatch.setattr(step_selection, "SAMPLE", 8)  # the step is given
    fore = [
        {"stations_m": [0.0, 2.0], "radii_m": [0.05, 0.4]},
        {"stations_m": [2.0, 2.6], "radii_m": [0.4, 0.1]},
    ]
    aft = [{"stations_m": [2.2, 4.0], "radii_m": [0.02, 0.3], "offset_m": [0.85, 0.3]}]
    if parts == "shell":
        fore, aft = (
            [cylinder(-2.0, 9.0, 1.9, hollow=True)],
            [*aft, {"points_m": [[2.2, 0.6, 0.5], [2.0, 0.3, 0.0]]}],
        )
    load = {
        "name": "side",
        "body": "aft",
        "force_N": [4.0, -2.0, 0.5],
        "moment_N_m": [0.0, 2.0, 4.0],
    }
    scene = tubes({"fore": fore, "aft": aft}, load=[load], motor=[], run__end_time_s=0.8)
    laws = {
        "force_N.x": {"uniform": 3.0},
        "force_N.y": {"uniform": 2.0},
        "moment_N_m.z": {"uniform": 6.0},
        "moment_N_m.y": {"uniform": 3.0},
    }
    campaign = pair(scene | {f"dispersion.load.side.{key}": law for key, law in laws.items()})
    coarse, fine = (
        campaign.with_settings({"solver.step_s": step}).run(cases=100).to_pandas()
        for step in (0.1, 0.005)
    )
    near = coarse["gap_clearance_mm"] > 0.0
    assert near.sum() > 20
    assert coarse["gap_recontact"].equals(fine["gap_recontact"])
    assert_allclose(
        coarse["gap_clearance_mm"][near], fine["gap_clearance_mm"][near], rtol=0, atol=1e-3
    )
