"""Mass properties, impulses and energies that `sepmc check` prints, against sums over points and
quadrature."""

import itertools
import math

import numpy as np
import pytest
from click.testing import CliRunner
from numpy.testing import assert_allclose
from scipy.integrate import quad
from scipy.spatial.transform import Rotation

from sepmc.cli import app
from sepmc.scene.budget import budget_lines, energy, impulse, mated, of_body
from sepmc.scene.model import Body, ForceTable, Motor, Profile, Spring


def test_mated_bodies_are_their_points(pair):
    """Two bodies as twelve points each: mass, centre and inertia of all points."""
    random = np.random.default_rng(5)
    points = {
        name: random.normal(0.0, 1.0, (12, 3)) - [x, 0.0, 0.0]  # body axes: x forward
        for name, x in (("fore", 1.0), ("aft", 3.0))
    }
    bodies = {}
    for name, at in points.items():
        centre = at.mean(axis=0)
        r = at - centre
        bodies[name] = {
            "mass_kg": 12.0,
            "cg_m": [-centre[0], centre[1], centre[2]],
            "inertia_kg_m2": [float((r**2).sum() - (r[:, k] ** 2).sum()) for k in range(3)],
            "inertia_products_kg_m2": [
                float((r[:, i] * r[:, j]).sum()) for i, j in ((0, 1), (0, 2), (1, 2))
            ],
        }
    whole = mated(pair({"body": bodies}).scene)
    at = np.concatenate(list(points.values()))
    r = at - at.mean(axis=0)
    assert whole.mass == 24.0
    assert_allclose(whole.centre * (-1.0, 1.0, 1.0), at.mean(axis=0), atol=1e-14)
    assert_allclose(whole.inertia, (r**2).sum() * np.eye(3) - r.T @ r, rtol=1e-13, atol=1e-13)


def test_principal_axes():
    """A body turned by 10 deg about y: its principal moments by axis, and that angle."""
    turn = Rotation.from_euler("y", 10.0, degrees=True).as_matrix()
    tensor = turn @ np.diag([1.0, 9.0, 7.0]) @ turn.T
    products = (-tensor[0, 1], -tensor[0, 2], -tensor[1, 2])
    inertia = tuple(np.diag(tensor))
    body = Body(mass=1.0, inertia=inertia, inertia_products=products, cg=(0.0, 0.0, 0.0))
    moments, angle = of_body(body).principal
    assert_allclose(moments, [1.0, 9.0, 7.0], rtol=1e-13)
    assert_allclose(math.degrees(angle), 10.0, rtol=1e-9)


MOTORS = {
    "constant": {"burn": 2.0},
    "cut by the end": {},
    "build-up and tail-off": {"burn": 0.4, "build_up": 0.1, "tail_off": 0.05},
    "profile": {"profile": Profile(time=(0.1, 0.3, 1.0), fraction=(0.5, 1.0, 0.2))},
    "profile to its last row": {
        "profile": Profile(time=(0.0, 1.0), fraction=(1.0, 0.4)),
        "build_up": 0.2,
        "tail_off": 0.1,
    },
    "profile cut short": {
        "profile": Profile(time=(0.0, 1.0), fraction=(1.0, 0.4)),
        "burn": 0.7,
        "tail_off": 0.1,
    },
    "burn beyond the profile": {
        "profile": Profile(time=(0.0, 1.0), fraction=(1.0, 0.4)),
        "burn": 1.5,
        "tail_off": 0.1,
    },
}


@pytest.mark.parametrize("keys", MOTORS.values(), ids=list(MOTORS))
def test_impulse(keys):
    """The integral of the thrust of CONVENTIONS.md, written from there."""
    motor = Motor(name="m", body="b", thrust=30.0, station=0.0, **keys)
    end, profile = 3.0, motor.profile
    burn = min(motor.burn, profile.time[-1] if profile and math.isinf(motor.burn) else end)

    def thrust(t):
        built = 1.0 - math.exp(-t / motor.build_up) if motor.build_up else 1.0
        level = np.interp(t, profile.time, profile.fraction, 0.0, 0.0) if profile else 1.0
        return motor.thrust * built * level

    knots = [0.0, *(t for t in (profile.time if profile else ()) if 0.0 < t < burn), burn]
    expected = sum(
        quad(thrust, a + 1e-13, b - 1e-13, epsrel=1e-12)[0] for a, b in itertools.pairwise(knots)
    )
    if motor.tail_off:
        expected += thrust(burn) * motor.tail_off
    assert_allclose(impulse(motor, end), expected, rtol=1e-10)


def test_energy():
    spring = {"name": "s", "bodies": ("a", "b"), "point": (0.0, 0.0, 0.0)}
    assert energy(Spring(**spring, force=100.0, stiffness=500.0, stroke=0.1)) == 7.5
    assert energy(Spring(**spring, force=100.0, stiffness=500.0)) == 10.0
    assert energy(Spring(**spring, force=100.0, stroke=0.1, factor=0.5)) == 5.0
    assert math.isinf(energy(Spring(**spring, force=100.0)))


@pytest.mark.parametrize(
    ("extension", "force", "more", "work"),
    [
        ((0.0, 0.1), (200.0, 0.0), {}, 10.0),
        ((0.0, 0.05, 0.1), (200.0, 150.0, 50.0), {}, 85.0 / 6.0),  # a parabola: Simpson's rule
        ((0.02, 0.1), (200.0, 0.0), {"factor": 0.5}, 6.0),  # 200 N before its first row
        ((-0.1, 0.1), (400.0, 0.0), {}, 10.0),
        ((0.0, 0.1), (200.0, 100.0), {"stroke": 0.15}, 20.0),  # 100 N beyond its last row
        ((0.0, 0.1), (200.0, 0.0), {"stroke": 0.05, "force": 100.0}, 12.5),
        ((0.05, 0.1), (200.0, 0.0), {"stroke": 0.02}, 4.0),
    ],
)
def test_energy_of_a_table(extension, force, more, work):
    table = ForceTable(extension=extension, force=force)
    spring = {"name": "s", "bodies": ("a", "b"), "point": (0.0, 0.0, 0.0), "stroke": 0.1}
    assert energy(Spring(**spring | more, table=table)) == pytest.approx(work)


@pytest.mark.parametrize(
    ("spring", "work"),
    [
        ({"force": 100.0, "stiffness": 500.0, "stroke": 0.3}, 10.0),  # spent at 0.2 m
        ({"force": 100.0, "stiffness": 500.0, "stroke": 0.1}, 7.5),
        ({"force": -100.0, "stiffness": 500.0}, 0.0),
        ({"force": -100.0}, 0.0),
        ({"force": 0.0, "table": (100.0, -100.0, 100.0)}, 5.0),  # triangles of 50 mm and 100 N
        ({"force": 50.0, "table": (50.0, -150.0, 50.0)}, 5.0),
        ({"force": -100.0, "table": (50.0, 0.0, 50.0)}, 0.0),
    ],
)
def test_energy_of_a_spring_that_only_pushes(spring, work):
    if "table" in spring:
        table = ForceTable(extension=(0.0, 0.1, 0.2), force=spring["table"], interpolation="linear")
        spring = spring | {"table": table, "stroke": 0.2}
    common = {"name": "s", "bodies": ("a", "b"), "point": (0.0, 0.0, 0.0), "push_only": True}
    assert energy(Spring(**common | spring)) == pytest.approx(work, rel=1e-5)


def test_check_prints_them():
    result = CliRunner().invoke(app.main, ["check", "hyper-x.toml", "--no-flight"])
    assert "mated        6075 kg, centre of mass [7.2148, 0, 0] m" in result.output
    assert "body         rv: principal inertia [250, 1250, 1400] kg m2" in result.output
    assert "energy       piston_right: 8048.85 J" in result.output


@pytest.mark.parametrize(("burn", "until"), [({"burn_s": 0.5}, ""), ({"burn_s": 5.0}, " in 1 s")])
def test_an_impulse_says_when_the_run_cuts_it(pair, burn, until):
    """A burn that goes on at the end of the run counts up to there, as an unlimited one does."""
    motor = {"name": "m", "body": "fore", "thrust_N": 10.0, "station_m": 0.0} | burn
    lines = list(budget_lines(pair({"motor": [motor], "run.end_time_s": 1.0}).scene))
    assert f"impulse      m: {min(burn['burn_s'], 1.0) * 10:g} N s{until}" in lines
