"""Clearances of campaign rows against single runs, and against geometry that shares no code with the kernels."""

import math
from pathlib import Path

import numpy as np
import pytest
from measure_clearance import exact
from numpy.testing import assert_allclose
from scipy.spatial.transform import Rotation

import sepmc
from sepmc.kernels.outlines import gap
from sepmc.kernels.rims import rim_gap
from sepmc.trust import geometry

NOZZLE = Path(__file__).parent / "nozzle.toml"


@pytest.fixture(scope="module")
def nozzle():
    return sepmc.load(NOZZLE)


@pytest.fixture(scope="module")
def flown(nozzle):
    return nozzle.run(cases=40)


def test_a_nozzle_leaving_an_interstage_meets_the_accuracy(flown):
    """Its least clearance is where the distance ends; the pilot finds a step all the same, and says how good it is."""
    assert (flown.to_pandas()["status"] == "ok").all()
    assert flown.accuracy.errors["gap_clearance_mm"] <= 1e-9


def test_rows_are_the_single_runs(nozzle, flown):
    rows = flown.to_pandas()
    for i in (0, 7, 31):
        outcomes = nozzle.simulate(nozzle.case(i), step_s=0.1).attrs["outcomes"]
        assert_allclose(rows["gap_clearance_mm"][i], outcomes["gap_clearance_mm"], rtol=1e-9)
        # about a least the distance is flat: its time is known to the root of what the distance is
        assert_allclose(rows["gap_clearance_time_s"][i], outcomes["gap_clearance_time_s"], rtol=0, atol=1e-6)


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
            parts.append((rng.uniform(-3.0, 3.0, 3), axis, float(length), float(r0), float(r0 if length == 0.0 else r1)))
        yield parts


def test_the_geometry_agrees_on_solids():
    """And is proved: a slab as wide lies between them."""
    for parts in shapes(3):
        distance, unproved = geometry.solid_distance(*((p[0][None], p[1][None], *p[2:]) for p in parts))
        expected = gap(*((tuple(map(float, p[0])), tuple(map(float, p[1])), *p[2:]) for p in parts))[0]
        assert_allclose(distance[0], expected, rtol=0, atol=1e-7)
        assert unproved[0] <= 1e-6 or distance[0] <= 1e-6


def test_the_geometry_agrees_on_rims():
    rng = np.random.default_rng(4)
    for _ in range(60):
        slope = rng.choice([0.0, 0.1, -0.1])
        shell = (np.zeros((1, 3)), np.array([[1.0, 0.0, 0.0]]), 2.0, 0.8, 0.8 + 2.0 * slope)
        normal = np.array([1.0, *(rng.choice([0.0, 0.01, 0.3]) * rng.normal(size=2))])
        centre = np.array([rng.uniform(-0.05, 2.05), *(0.1 * rng.normal(size=2))])
        rim = (centre[None], (normal / np.linalg.norm(normal))[None], 0.5)
        ours = rim_gap((tuple(map(float, centre)), tuple(map(float, rim[1][0])), 0.5), ((0.0, 0.0, 0.0), (1.0, 0.0, 0.0), *shell[2:]), 0.0)[
            0
        ]
        found = geometry.rim_distance(rim, shell)[0]
        assert math.isinf(ours) == math.isinf(found)
        if math.isfinite(ours):
            assert_allclose(found, ours, rtol=0, atol=1e-10)
