"""Clearances of campaign rows against single runs, and against geometry that shares no code with
the kernels."""

import math
from pathlib import Path

import numpy as np
import pytest
from numpy.testing import assert_allclose
from oracles import geometry
from scipy.spatial.transform import Rotation
from support.compiled import compiled
from support.exact_clearances import exact

import sepmc
from sepmc.campaign.execution import step_selection
from sepmc.physics.outlines import gap
from sepmc.physics.rims import rim_gap
from sepmc.physics.shell_edge import edge_gap, edge_gap_bound

gap = compiled(gap)
rim_gap = compiled(rim_gap)
edge_gap = compiled(edge_gap)
edge_gap_bound = compiled(edge_gap_bound)
NOZZLE = Path(__file__).parents[1] / "data" / "nozzle.toml"
FLUSH = Path(__file__).parents[1] / "data" / "flush.toml"


@pytest.fixture(scope="module")
def nozzle():
    return sepmc.load(NOZZLE)


@pytest.fixture(scope="module")
def flown(nozzle):
    return nozzle.run(cases=40)


@pytest.mark.slow
def test_a_nozzle_leaving_an_interstage_meets_the_accuracy(flown):
    """The minimum clearance is at the end of the motion; a step is still found, with its error."""
    assert (flown.to_pandas()["status"] == "ok").all()
    assert flown.accuracy.errors["gap_clearance_mm"] <= 1e-9


@pytest.mark.slow
def test_rows_are_the_single_runs(nozzle, flown):
    rows = flown.to_pandas()
    for i in (0, 7, 31):
        outcomes = nozzle.simulate(nozzle.case(i), step_s=0.1).attrs["outcomes"]
        assert_allclose(rows["gap_clearance_mm"][i], outcomes["gap_clearance_mm"], rtol=1e-9)
        # about a least the distance is flat: its time is known to the root of what the distance is
        assert_allclose(
            rows["gap_clearance_time_s"][i], outcomes["gap_clearance_time_s"], rtol=0, atol=1e-6
        )


@pytest.mark.slow
def test_rows_against_exact_geometry(flown):
    fine, rows = sepmc.load(NOZZLE, {"solver.step_s": 0.01}), flown.to_pandas()
    for i in (0, 5, int(rows["gap_clearance_mm"].argmin())):
        history = fine.simulate(fine.case(i), step_s=0.002)
        least, when = exact(fine, fine.case(i), history)["gap"]
        assert_allclose(rows["gap_clearance_mm"][i], least, rtol=0, atol=1e-6)
        assert_allclose(rows["gap_clearance_time_s"][i], when, rtol=0, atol=1e-6)


def shapes(seed, count=40):
    """Random pairs of frustums, stacked where they agree in size: tuples of one pose each."""
    rng = np.random.default_rng(seed)
    for _ in range(count):
        parts = []
        for _ in range(2):
            axis = Rotation.random(rng=rng).apply([1.0, 0.0, 0.0])
            length, r0, r1 = rng.choice([0.0, 1.0, 2.5]), *rng.uniform(0.0, 1.0, 2)
            parts.append(
                (
                    rng.uniform(-3.0, 3.0, 3),
                    axis,
                    float(length),
                    float(r0),
                    float(r0 if length == 0.0 else r1),
                )
            )
        yield parts


@pytest.mark.slow
def test_the_geometry_agrees_on_solids():
    """A gap as wide as the distance lies between them, which proves it."""
    for parts in shapes(3):
        distance, unproved = geometry.solid_distance(
            *((p[0][None], p[1][None], *p[2:]) for p in parts)
        )
        expected = gap(
            *((tuple(map(float, p[0])), tuple(map(float, p[1])), *p[2:]) for p in parts)
        )[0]
        assert_allclose(distance[0], expected, rtol=0, atol=1e-7)
        assert unproved[0] <= 1e-6 or distance[0] <= 1e-6


@pytest.mark.slow
def test_the_geometry_agrees_on_ends_all_but_parallel():
    """As stages part: tilts of 1e-6 to 0.1 rad, gaps of 0.1 mm to 1 m."""
    rng = np.random.default_rng(5)
    for _ in range(40):
        size, apart, tilt = (
            10.0 ** rng.uniform(-1.0, 0.5, 2),
            10.0 ** rng.uniform(-4.0, 0.0),
            10.0 ** rng.uniform(-6.0, -1.0),
        )
        place = np.array([apart + tilt * size.sum(), *rng.normal(0.0, 0.3 * size[0], 2)])
        axis = Rotation.from_rotvec([0.0, *rng.normal(0.0, tilt, 2)]).apply([1.0, 0.0, 0.0])
        a = (
            np.zeros(3),
            np.array([-1.0, 0.0, 0.0]),
            1.0,
            size[0],
            rng.choice([0.5, 1.0]) * size[0],
        )
        b = (
            place,
            axis,
            *((0.0, size[1], size[1]) if rng.random() < 0.5 else (2.0, size[1], 0.7 * size[1])),
        )
        distance, _ = geometry.solid_distance(*((p[0][None], p[1][None], *p[2:]) for p in (a, b)))
        expected = gap(
            *(
                (tuple(map(float, p[0])), tuple(map(float, p[1])), *map(float, p[2:]))
                for p in (a, b)
            )
        )[0]
        assert_allclose(distance[0], expected, rtol=0, atol=1e-9)


def test_the_geometry_agrees_on_rims():
    rng = np.random.default_rng(4)
    for _ in range(60):
        slope = rng.choice([0.0, 0.1, -0.1])
        shell = (np.zeros((1, 3)), np.array([[1.0, 0.0, 0.0]]), 2.0, 0.8, 0.8 + 2.0 * slope)
        normal = np.array([1.0, *(rng.choice([0.0, 0.01, 0.3]) * rng.normal(size=2))])
        centre = np.array([rng.uniform(-0.05, 2.05), *(0.1 * rng.normal(size=2))])
        rim = (centre[None], (normal / np.linalg.norm(normal))[None], 0.5)
        ours = rim_gap(
            (tuple(map(float, centre)), tuple(map(float, rim[1][0])), 0.5),
            ((0.0, 0.0, 0.0), (1.0, 0.0, 0.0), *shell[2:]),
            0.0,
        )[0]
        result = geometry.rim_distance(rim, shell)[0]
        assert math.isinf(ours) == math.isinf(result)
        if math.isfinite(ours):
            assert_allclose(result, ours, rtol=0, atol=1e-10)


def tuples(*vectors):
    return (tuple(map(float, vector)) for vector in vectors)


def test_the_geometry_agrees_on_lips():
    """And both nearest points lie as far apart, the cheap bound is one, and a circle on the axis
    needs no search."""
    rng = np.random.default_rng(5)
    for i in range(200):
        axis, start, radius = (
            Rotation.random(rng=rng).apply([1.0, 0.0, 0.0]),
            rng.normal(size=3),
            float(rng.uniform(0.2, 1.5)),
        )
        length, r0 = (
            float(rng.choice([0.0, 0.5, 2.5])),
            float(rng.choice([0.0, rng.uniform(0.0, 1.0)])),
        )
        part = (
            start[None],
            axis[None],
            length,
            r0,
            r0 if length == 0.0 else float(rng.uniform(0.0, 1.0)),
        )
        normal = axis + rng.choice([0.0, 1e-6, 0.02, 0.3, 3.0]) * rng.normal(size=3)
        normal /= np.linalg.norm(normal)
        centre = (
            start
            + axis * rng.uniform(-0.3, 1.3) * max(length, 0.5)
            + rng.choice([0.0, 0.01, 0.1, 1.0]) * rng.normal(size=3)
        )
        lip = *tuples(centre, normal), radius
        solid = *tuples(start, axis), *part[2:]
        distance, on_lip, on_solid = edge_gap(lip, solid)
        assert_allclose(
            distance,
            geometry.circle_distance((centre[None], normal[None], radius), part)[0],
            rtol=0,
            atol=1e-10,
            err_msg=i,
        )
        assert_allclose(math.dist(on_lip, on_solid), distance, rtol=0, atol=1e-12)
        assert_allclose(math.dist(on_lip, centre), radius, rtol=1e-12)
        assert edge_gap_bound(lip, solid) <= distance


def test_lips_by_hand():
    """On the axis, shifted, past the end, and touching; NaN stays NaN."""
    part = ((0.0, 0.0, 0.0), (1.0, 0.0, 0.0), 2.0, 0.3, 0.3)
    assert_allclose(edge_gap(((1.0, 0.0, 0.0), (1.0, 0.0, 0.0), 0.5), part)[0], 0.2, rtol=1e-14)
    distance, on_lip, on_solid = edge_gap(((1.0, 0.06, -0.08), (1.0, 0.0, 0.0), 0.5), part)
    assert_allclose([distance, *on_lip], [0.1, 1.0, -0.24, 0.32], rtol=0, atol=1e-9)
    assert_allclose(on_solid, [1.0, -0.18, 0.24], rtol=0, atol=1e-9)
    assert_allclose(edge_gap(((2.3, 0.0, 0.0), (1.0, 0.0, 0.0), 0.7), part)[0], 0.5, rtol=1e-14)
    assert edge_gap(((1.0, 0.25, 0.0), (1.0, 0.0, 0.0), 0.5), part)[0] == 0.0
    assert math.isnan(edge_gap(((math.nan, 0.0, 0.0), (1.0, 0.0, 0.0), 0.5), part)[0])


@pytest.mark.slow
def test_a_rim_flush_with_the_mouth_of_its_shell():
    """It leaves with no speed, so slowly that where it is was not told from round-off: a third of
    the cases were given up."""
    rows = sepmc.load(FLUSH).run().to_pandas()
    assert (rows["status"] == "ok").all()
    assert (rows["nozzle_clearance_time_s"] > 0.25).mean() > 0.5


@pytest.mark.slow
def test_clearances_are_the_same_at_any_step(monkeypatch):
    """Of rims that leave straight or at a slant, within a step of any length."""
    monkeypatch.setattr(step_selection, "SAMPLE", 8)  # the step is given
    rows = [
        sepmc.load(FLUSH, {"solver.step_s": step_s}).run().to_pandas()["nozzle_clearance_mm"]
        for step_s in (0.001, 0.0041, 0.01)
    ]
    for other in rows[1:]:
        assert_allclose(other, rows[0], rtol=0, atol=1e-9)


@pytest.mark.slow
@pytest.mark.parametrize("number", [2, 102])
def test_a_nozzle_that_leaves_at_a_slant(number):
    """Its rim crosses the mouth for a while, and the nearest point runs along the mouth faster than
    the rim moves."""
    campaign = sepmc.load(FLUSH)
    case = campaign.case(number)
    outcomes = campaign.simulate(case, step_s=0.1).attrs["outcomes"]
    least, _ = exact(sepmc.load(FLUSH, {"solver.step_s": 0.002}), case)["nozzle"]
    assert abs(outcomes["nozzle_clearance_mm"] - least) <= 1e-6
