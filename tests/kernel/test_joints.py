"""Joint rows against second differences of the constraints; power and reaction of joint loads;
dense solvers."""

import numpy as np
import pytest
from numpy.testing import assert_allclose
from scipy.spatial.transform import Rotation

from sepmc.physics import joints
from sepmc.routines.linear import solve_ldlt, solve_lu

# Central differences of order 8, offsets -4 to 4.
SECOND = np.array([-1 / 560, 8 / 315, -1 / 5, 8 / 5, -205 / 72, 8 / 5, -1 / 5, 8 / 315, -1 / 560])
FIRST = np.array([1 / 280, -4 / 105, 1 / 5, -4 / 5, 0, 4 / 5, -1 / 5, 4 / 105, -1 / 280])
AXES = np.eye(3)
GUIDED = [
    {"name": "locked", "joints": {"pins": "fixed"}, "until": {"time_s": 0.25}},
    {
        "name": "guided",
        "joints": {"pins": "slider"},
        "until": {"joint": "pins", "stroke_mm": 150.0},
    },
    {"name": "free"},
]
LOPSIDED = {
    "body.fore.cg_m": [1.0, 0.05, -0.02],
    "body.aft.cg_m": [3.0, -0.04, 0.03],
    "body.aft.inertia_products_kg_m2": [0.2, -0.1, 0.15],
}
RETRO = {
    "name": "retro",
    "body": "aft",
    "thrust_N": 2.0,
    "station_m": 3.2,
    "cant_deg": 175.0,
    "offset_m": [0.1, 0.05],
}
SPINNING = LOPSIDED | {
    "motor": [RETRO],
    "initial.altitude_m": 0.0,
    "initial.omega_rad_s": [1.5, 0.8, -1.2],
    "run.end_time_s": 1.0,
}


class Motion:
    """A random smooth motion x0 + v t + a t^2 / 2, exp(S(omega t + omega' t^2 / 2)) R0: its rates
    at t = 0 are known. Takes body axes."""

    def __init__(self, random):
        self.x, self.v, self.a, self.omega, self.omega_rate = random.normal(size=(5, 3))
        self.r = Rotation.from_quat(random.normal(size=4))

    def point(self, t, body):
        return self.x + self.v * t + 0.5 * self.a * t * t + self.turn(t, body)

    def turn(self, t, body):
        return (
            Rotation.from_rotvec(self.omega * t + 0.5 * self.omega_rate * t * t) * self.r
        ).apply(body)


def perpendicular_pair(i, k, ax, ay, az, bx, by):
    """Axis i (x or y) of B and axis k of A."""
    return (bx, by)[i], (ax, ay, az)[k]


def second_difference(function, h=0.02):
    """Second derivative at 0. Measured: good to 2e-10 here, from h^8 times tenth derivatives of 1e7
    over 3e3, and round-off over h^2."""
    return SECOND @ [function(h * i) for i in range(-4, 5)] / h**2


@pytest.mark.parametrize("seed", range(12))
def test_translation_row(seed):
    """C'' of C = (r_B - r_A) . e_A, points far apart and moving, so that no term is small."""
    random = np.random.default_rng(seed)
    a, b = Motion(random), Motion(random)
    rho_a, rho_b, e = random.normal(size=(3, 3))
    ga, gb, ge = a.turn(0.0, rho_a), b.turn(0.0, rho_b), a.turn(0.0, e)
    d = b.x + gb - a.x - ga
    d_rate = b.v + np.cross(b.omega, gb) - a.v - np.cross(a.omega, ga)
    arm_a, arm_b, gamma = joints.translation(
        *(tuple(v) for v in (d, d_rate, ge, ga, gb, a.omega, b.omega))
    )
    result = ge @ (b.a - a.a) + np.dot(arm_b, b.omega_rate) + np.dot(arm_a, a.omega_rate) - gamma
    expected = second_difference(lambda t: (b.point(t, rho_b) - a.point(t, rho_a)) @ a.turn(t, e))
    terms = [
        d @ np.cross(a.omega_rate, ge),
        2 * d_rate @ np.cross(a.omega, ge),
        d @ np.cross(a.omega, np.cross(a.omega, ge)),
    ]
    assert np.min(np.abs(terms)) > 1e-6  # leaving out any term of d would show
    assert_allclose(result, expected, rtol=0, atol=1e-9)


# axis of B, axis of A: rows against roll, yaw and pitch, and the one that leaves yaw free
PAIRS = [(1, 2), (0, 2), (0, 1), (1, 0)]


@pytest.mark.parametrize("pair_of", PAIRS)
@pytest.mark.parametrize("seed", range(12))
def test_rotation_row(seed, pair_of):
    """C' and C'' of C = a_B . b_A for every pair that a joint kind uses, at any relative
    attitude."""
    random = np.random.default_rng(seed)
    a, b = Motion(random), Motion(random)

    def pair(t):
        return perpendicular_pair(
            *pair_of,
            *(
                tuple(m.turn(t, e))
                for m, e in zip((a, a, a, b, b), (*AXES, *AXES[:2]), strict=True)
            ),
        )

    n, gamma = joints.rotation(*pair(0.0), tuple(a.omega), tuple(b.omega))
    assert_allclose(
        np.dot(n, b.omega_rate - a.omega_rate) - gamma,
        second_difference(lambda t: np.dot(*pair(t))),
        rtol=0,
        atol=1e-9,
    )
    slope = (np.dot(*pair(1e-5)) - np.dot(*pair(-1e-5))) / 2e-5
    assert_allclose(
        joints.rotation_rate(*pair(0.0), tuple(a.omega), tuple(b.omega)), slope, rtol=0, atol=1e-7
    )


@pytest.mark.parametrize("seed", range(12))
def test_rod_row(seed):
    """C'' of C = |r_B - r_A| - L, points far apart and moving."""
    random = np.random.default_rng(seed)
    a, b = Motion(random), Motion(random)
    rho_a, rho_b = random.normal(size=(2, 3))
    ga, gb = a.turn(0.0, rho_a), b.turn(0.0, rho_b)
    d = b.x + gb - a.x - ga
    d_rate = b.v + np.cross(b.omega, gb) - a.v - np.cross(a.omega, ga)
    e, arm_a, arm_b, gamma = joints.rod(*(tuple(v) for v in (d, d_rate, ga, gb, a.omega, b.omega)))
    result = e @ (b.a - a.a) + np.dot(arm_b, b.omega_rate) + np.dot(arm_a, a.omega_rate) - gamma
    expected = second_difference(lambda t: np.linalg.norm(b.point(t, rho_b) - a.point(t, rho_a)))
    scale = (d_rate @ d_rate) / np.linalg.norm(d)  # what turning adds: large for a short rod
    # high derivatives grow with it
    assert_allclose(result, expected, rtol=0, atol=1e-9 * max(1.0, scale) ** 3)


@pytest.mark.parametrize("axis", range(3))
def test_rotation_pair_senses_its_axis_alone(axis):
    """From parallel axes, B turned by 1e-6 about one axis of A: that C is +-1e-6, the others stay 0
    (to 1e-12, second order)."""
    turned = Rotation.from_rotvec(1e-6 * AXES[axis]).apply(AXES)
    c = [
        np.dot(
            *perpendicular_pair(*PAIRS[k], *map(tuple, AXES), tuple(turned[0]), tuple(turned[1]))
        )
        for k in range(3)
    ]
    assert_allclose(np.abs(c), 1e-6 * AXES[axis], rtol=0, atol=1e-12)


class Side:
    """One body's columns of a history, in ground axes: rates, lever to its joint point, velocity of
    that point, joint wrench."""

    def __init__(self, history, body, lever):
        def columns(names):
            return np.array(history[[names.replace("*", axis) for axis in "xyz"]])

        def attitude(name):
            return Rotation.from_euler(
                "ZYX",
                np.array(history[[f"{name}_{a}_deg" for a in ("pitch", "yaw", "roll")]]),
                degrees=True,
            )

        x, self.v = columns(f"{body}_*_m"), columns(f"{body}_v*_m_s")
        self.spin = np.radians(columns(f"{body}_omega_*_deg_s"))  # body axes
        self.r, fore = attitude(body), attitude("fore")
        self.omega, self.lever = self.r.apply(self.spin), self.r.apply(lever)
        self.point, self.point_v = x + self.lever, self.v + np.cross(self.omega, self.lever)
        self.force = fore.apply(columns(f"pins_force_on_{body}_*_N"))
        self.moment = fore.apply(columns(f"pins_moment_on_{body}_*_N_m"))
        self.gap = fore.apply(columns("pins_gap_*_m"))


@pytest.fixture(scope="module", params=["reduced", "full"])
def flight(request, pair):
    """A spinning, lopsided pair pushed apart, every 10 ms: its phases and both sides of the
    joint."""
    history = pair(
        SPINNING | {"phase": GUIDED, "solver.formulation": request.param, "solver.step_s": 0.01}
    ).simulate(step_s=0.01)
    assert history.attrs["status"] == "ok"
    return (
        history["phase"].to_numpy(),
        Side(history, "fore", [-1.0, -0.05, 0.02]),
        Side(history, "aft", [1.0, 0.04, -0.03]),
    )


@pytest.mark.parametrize("phase", ["locked", "guided"])
def test_a_joint_does_no_work(flight, phase):
    """F_A . v(r_A) + M_A . w_A + F_B . v(r_B) + M_B . w_B = 0. 1e-13 of the largest of the terms:
    round-off."""
    at = flight[0] == phase
    terms = [
        np.sum(u[at] * v[at], axis=1)
        for side in flight[1:]
        for u, v in ((side.force, side.point_v), (side.moment, side.omega))
    ]
    assert at.sum() > 20
    assert np.abs(sum(terms)).max() <= 1e-13 * np.abs(terms).max()


def test_action_and_reaction(flight):
    """Eq (15), with the gap measured between the joint points: F_A + F_B = 0, M_A + M_B + (r_B -
    r_A) x F_B = 0."""
    _, fore, aft = flight
    gap = aft.point - fore.point
    assert np.linalg.norm(gap, axis=1).max() > 0.15
    assert_allclose(aft.gap, gap, rtol=0, atol=1e-14)
    assert_allclose(fore.force, -aft.force, rtol=0, atol=1e-14)
    assert_allclose(fore.moment + aft.moment, -np.cross(gap, aft.force), rtol=0, atol=1e-13)


@pytest.mark.parametrize("phase", ["locked", "guided", "free"])
def test_the_wrench_moves_the_body_without_a_motor(flight, phase):
    """m v' = F_A, (J w)' = rho_A x F_A + M_A (eqs 12, 13). 1e-11: round-off of speeds and spins
    over 10 ms, and a margin of ten."""
    phases, fore, _ = flight
    # the first row of a phase need not stand on the 10 ms grid
    first = np.flatnonzero(phases == phase)[1]
    rows, middle = slice(first, first + 9), first + 4
    spin = fore.r.apply(fore.spin * [3.0, 4.0, 5.0])
    turning = np.cross(fore.lever[middle], fore.force[middle]) + fore.moment[middle]
    assert_allclose(3.0 * FIRST @ fore.v[rows] / 0.01, fore.force[middle], rtol=0, atol=1e-11)
    assert_allclose(FIRST @ spin[rows] / 0.01, turning, rtol=0, atol=1e-11)


def test_constraints_hold_and_freedoms_carry_nothing(flight):
    """Locked: no gap. Guided: a gap along x only, no force along x. Free: no wrench."""
    phases, fore, aft = flight
    locked, guided, free = (phases == name for name in ("locked", "guided", "free"))
    gap, force = fore.r.inv().apply(aft.gap), np.abs(fore.r.inv().apply(aft.force))
    assert max(np.abs(gap[locked]).max(), np.abs(gap[guided, 1:]).max()) <= 1e-14
    assert (fore.r[guided].inv() * aft.r[guided]).magnitude().max() <= 1e-14
    assert force[guided].max() > 0.5
    assert force[guided, 0].max() <= 1e-14 * force[guided].max()
    assert not np.any([aft.force[free], aft.moment[free], fore.force[free], fore.moment[free]])


@pytest.mark.parametrize("formulation", ["reduced", "full"])
def test_redundant_joints_are_reported(pair, formulation):
    """Two fixed joints between the same bodies: the motion is unique, the reactions are not; the
    row reports that."""
    turning = {"initial.omega_deg_s": [10.0, 20.0, 30.0], "solver.formulation": formulation}
    twice = turning | {"joint.again": {"bodies": ["fore", "aft"], "point_m": [2.1, 0.2, 0.0]}}
    twice["phase"] = [{"name": "locked", "joints": {"pins": "fixed", "again": "fixed"}}]
    result, once = pair(twice).simulate().attrs, pair(turning).simulate().attrs
    assert result["status"] == once["status"] == "ok"
    assert (result["outcomes"]["redundant_rows"], once["outcomes"]["redundant_rows"]) == (6, 0)
    for axis in "xyz":
        name = f"fore_omega_{axis}_deg_s"
        assert result["outcomes"][name] == pytest.approx(once["outcomes"][name], rel=1e-11)


def solve(solver, matrix, right):
    """Through the solver's own layout, both blocks away from the start of the array; nothing else
    may change."""
    n = len(right)
    w = np.full(n * n + n + 9, 7.0)
    w[2 : 2 + n * n], w[5 + n * n : 5 + n * n + n] = np.ravel(matrix), right
    with np.errstate(invalid="ignore"):  # compiled code does not warn
        pivot = solver(w, 2, 5 + n * n, n)
    assert np.all(np.delete(w, np.r_[2 : 2 + n * n, 5 + n * n : 5 + n * n + n]) == 7.0)
    return pivot, w[5 + n * n : 5 + n * n + n]


@pytest.mark.parametrize("n", [1, 2, 5, 6, 12, 24])
@pytest.mark.parametrize("solver", [solve_ldlt, solve_lu])
def test_solvers_against_numpy(solver, n):
    """Random systems: equal to LAPACK's solution within the condition number times round-off, a
    hundredfold."""
    random = np.random.default_rng(n)
    square = random.normal(size=(n, n))
    matrix = square @ square.T + 0.1 * np.eye(n) if solver is solve_ldlt else square
    right = random.normal(size=n)
    # LDL^T reads the lower triangle
    pivot, result = solve(solver, np.tril(matrix) if solver is solve_ldlt else matrix, right)
    assert 0.0 < pivot <= 1.0
    assert np.linalg.norm(result - np.linalg.solve(matrix, right)) <= 1e-14 * np.linalg.cond(
        matrix
    ) * np.linalg.norm(result)


def test_lu_pivots():
    """A zero where elimination begins, and rows of very different size."""
    assert_allclose(
        solve(solve_lu, [[0.0, 2.0], [4.0, 0.0]], [6.0, 8.0])[1], [2.0, 3.0], rtol=1e-15
    )
    assert_allclose(
        solve(solve_lu, [[1e-20, 1.0], [1.0, 1.0]], [1.0, 2.0])[1], [1.0, 1.0], rtol=1e-15
    )


@pytest.mark.parametrize("solver", [solve_ldlt, solve_lu])
@pytest.mark.parametrize(
    "corner",
    [
        [1.0, 1.0, 1.0],
        [0.0, 0.0, 1.0],
        [np.nan, 0.0, 1.0],
        [1.0, np.nan, 1.0],
        [1.0, 1.0, 1.0 + 1e-14],
    ],
)
def test_singular_systems_are_reported(solver, corner):
    """Dependent rows, a zero row, NaN, and rows dependent to round-off: pivot 0."""
    a, b, d = corner
    assert solve(solver, [[a, b], [b, d]], [1.0, 1.0])[0] == 0.0
