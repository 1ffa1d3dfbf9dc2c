"""The classical formulations of `sepmc.validation.lagrange` against equations derived by sympy, and
against what any motion must obey."""

import functools

import numpy as np
import pytest
import sympy as sp
from numpy.testing import assert_allclose
from scipy.spatial.transform import Rotation
from sympy.physics import mechanics as me

from sepmc.validation.lagrange import KINDS, Motion, Pair, accelerate, bodies, simulate

SEEDS = range(5)


def random_pair(random, axes=None):
    """Two bodies, no two numbers alike."""

    def tensor():
        square = random.normal(size=(3, 3))
        return square @ square.T + 2.0 * np.eye(3)

    axes = np.eye(3) if axes is None else axes
    return Pair(
        tuple(random.uniform(1.0, 3.0, 2)),
        (tensor(), tensor()),
        tuple(random.normal(size=(2, 3))),
        axes,
    )


def random_motion(random, kind, axes):
    """A state that a joint of this kind allows."""
    held_translations, held_rotations = KINDS[kind]
    r = Rotation.from_quat(random.normal(size=4)).as_matrix()
    w, relative, gap, gap_rate = random.normal(size=(4, 3))
    if held_translations == "length":
        gap_rate -= gap_rate @ gap / (gap @ gap) * gap
    else:
        free = [axis not in held_translations for axis in "xyz"]
        gap, gap_rate = gap * free, gap_rate * free
    angles = random.normal(size=2)
    turned, spin = Rotation.identity(), np.zeros(3)  # of B relative to A, in joint axes
    if held_rotations == "":
        turned, spin = Rotation.from_rotvec(random.normal(size=3)), relative
    elif held_rotations == "yz":
        turned, spin = Rotation.from_rotvec([angles[0], 0.0, 0.0]), relative * (1, 0, 0)
    elif held_rotations == "z":  # about y of A, then x of B
        turned = Rotation.from_euler("YX", angles)
        spin = relative[1] * np.array([0.0, 1.0, 0.0]) + relative[0] * turned.as_matrix()[:, 0]
    r_ab = axes.T @ turned.as_matrix() @ axes
    return Motion(
        *random.normal(size=(2, 3)), r, w, gap, gap_rate, r @ r_ab, r_ab.T @ (w + axes.T @ spin)
    )


def symmetric(name):
    """A symmetric matrix of symbols."""
    return sp.Matrix(3, 3, lambda i, j: sp.Symbol(f"{name}{min(i, j)}{max(i, j)}"))


@functools.cache
def slider_by(method):
    """The slider pair derived by sympy: by LagrangesMethod (from the kinetic energy) or KanesMethod
    (with rates as speeds).

    Returns a function of speeds, coordinates and parameters that gives the rates of the body's
    turning, and mass matrix and forcing of the speeds.
    """
    x, y, z, pitch, yaw, roll, gap = q = me.dynamicsymbols("x y z pitch yaw roll gap")
    ground = me.ReferenceFrame("N")
    frame = ground.orientnew("A", "Body", [pitch, yaw, roll], "ZYX")
    masses, arms = sp.symbols("m_a m_b"), [sp.symbols(f"arm_{name}_:3") for name in "ab"]
    tensors = [symmetric("J_a_"), symmetric("J_b_")]
    forces, moments = ([sp.symbols(f"{what}_{name}_:3") for name in "ab"] for what in "FM")
    origin = me.Point("O")
    centre_a, centre_b = me.Point("A*"), me.Point("B*")

    def vector(parts):
        return sum((part * axis for part, axis in zip(parts, frame, strict=True)), me.Vector(0))

    lever = vector([a - b for a, b in zip(*arms, strict=True)]) + gap * frame.x
    origin.set_vel(ground, 0)
    centre_a.set_pos(origin, x * ground.x + y * ground.y + z * ground.z)
    centre_b.set_pos(centre_a, lever)
    parameters = [
        *masses,
        *arms[0],
        *arms[1],
        *(t[i, j] for t in tensors for i in range(3) for j in range(i, 3)),
    ]
    parameters += [*forces[0], *forces[1], *moments[0], *moments[1]]
    qd = [sp.diff(c, me.dynamicsymbols._t) for c in q]
    if method == "Lagrange":
        speeds = qd
        centre_a.set_vel(ground, qd[0] * ground.x + qd[1] * ground.y + qd[2] * ground.z)
    else:
        speeds = me.dynamicsymbols("v_:3 w_:3 s")
        rates = frame.ang_vel_in(ground)  # as the angles have it
        frame.set_ang_vel(ground, vector(speeds[3:6]))
        centre_a.set_vel(ground, vector(speeds[:3]))
    centre_b.set_vel(
        ground,
        centre_a.vel(ground)
        + frame.ang_vel_in(ground).cross(lever)
        + (qd[6] if method == "Lagrange" else speeds[6]) * frame.x,
    )
    parts, loads = [], []
    for name, centre, mass, tensor, force, moment in zip(
        "ab", (centre_a, centre_b), masses, tensors, forces, moments, strict=True
    ):
        inertia = me.inertia(
            frame, *(tensor[i, j] for i, j in ((0, 0), (1, 1), (2, 2), (0, 1), (1, 2), (0, 2)))
        )
        parts.append(me.RigidBody(name, centre, frame, mass, (inertia, centre)))
        loads += [(centre, vector(force)), (frame, vector(moment))]
    if method == "Lagrange":
        equations = me.LagrangesMethod(
            me.Lagrangian(ground, *parts), q, forcelist=loads, frame=ground
        )
        equations.form_lagranges_equations()
    else:
        moved = centre_a.pos_from(origin).dt(ground)
        kinematics = [moved.dot(axis) - centre_a.vel(ground).dot(axis) for axis in ground]
        kinematics += [(rates - frame.ang_vel_in(ground)).dot(axis) for axis in frame] + [
            qd[6] - speeds[6]
        ]
        equations = me.KanesMethod(ground, q, speeds, kinematics)
        equations.kanes_equations(parts, loads)
    plain = dict(zip([*speeds, *q], sp.symbols("u_:7 q_:7"), strict=True))
    system = [m.xreplace(plain) for m in (equations.mass_matrix, equations.forcing)]
    return sp.lambdify([*plain.values(), *parameters], system, cse=True)


@functools.cache
def turning():
    """Body rates from the rates of pitch, yaw, roll (a matrix), and that matrix's rate; functions
    of (angles, their rates)."""
    angles, frame, ground = (
        me.dynamicsymbols("pitch yaw roll"),
        me.ReferenceFrame("A"),
        me.ReferenceFrame("N"),
    )
    rates = [sp.diff(c, me.dynamicsymbols._t) for c in angles]
    frame.orient(ground, "Body", angles, "ZYX")
    matrix = frame.ang_vel_in(ground).to_matrix(frame).jacobian(rates)
    plain = dict(zip([*rates, *angles], sp.symbols("u_:3 q_:3"), strict=True))
    change = sp.diff(matrix, me.dynamicsymbols._t).xreplace(plain)
    return sp.lambdify(list(plain.values()), [matrix.xreplace(plain), change])


@pytest.mark.parametrize("seed", SEEDS)
@pytest.mark.parametrize("method", ["Lagrange", "Kane"])
@pytest.mark.slow
def test_slider_pair_by_sympy(method, seed):
    """Accelerations of random states under random loads: 1e-12 of the largest, round-off of two 7 x
    7 systems."""
    random = np.random.default_rng(seed)
    pair, held = random_pair(random), KINDS["slider"]
    place, velocity, angles, angle_rates, *loads = random.normal(size=(8, 3))
    gap, gap_rate = random.normal(size=2)
    matrix, change = turning()(*angle_rates, *angles)
    r, w = Rotation.from_euler("ZYX", angles).as_matrix(), matrix @ angle_rates
    motion = Motion(
        place, velocity, r, w, np.array([gap, 0.0, 0.0]), np.array([gap_rate, 0.0, 0.0]), r, w
    )
    result = accelerate(pair, held, motion, [(loads[0], loads[1]), (loads[2], loads[3])])
    if method == "Lagrange":
        speeds = [*velocity, *angle_rates, gap_rate]
        ours = [
            *result.a,
            *np.linalg.solve(matrix, result.w_rate - change @ angle_rates),
            result.gap_acceleration[0],
        ]
    else:
        speeds = [*(r.T @ velocity), *w, gap_rate]
        ours = [
            *(r.T @ result.a - np.cross(w, r.T @ velocity)),
            *result.w_rate,
            result.gap_acceleration[0],
        ]
    upper = [tensor[np.triu_indices(3)] for tensor in pair.inertia]
    mass, forcing = slider_by(method)(
        *speeds,
        *place,
        *angles,
        gap,
        *pair.mass,
        *pair.arm[0],
        *pair.arm[1],
        *upper[0],
        *upper[1],
        *loads[0],
        *loads[2],
        *loads[1],
        *loads[3],
    )
    expected = np.linalg.solve(mass, forcing)[:, 0]
    assert_allclose(ours, expected, rtol=0, atol=1e-12 * np.abs(expected).max())


@pytest.mark.parametrize("seed", SEEDS)
@pytest.mark.parametrize("kind", [kind for kind in KINDS if kind != "free"])
def test_every_kind_obeys_newton_and_euler(kind, seed):
    """Both bodies move by their loads and a wrench -F, F; the wrench has no component along or
    about a free axis: 1e-11."""
    random = np.random.default_rng(seed)
    axes = Rotation.from_quat(random.normal(size=4)).as_matrix()
    pair, held = random_pair(random, axes), KINDS[kind]
    motion = random_motion(random, kind, axes)
    loads = list(random.normal(size=(2, 2, 3)))
    result = accelerate(pair, held, motion, loads)
    gap = motion.r @ axes.T @ motion.gap
    for i, sign, r, w, a, w_rate in (
        (0, -1.0, motion.r, motion.w, result.a, result.w_rate),
        (1, 1.0, motion.r_b, motion.w_b, result.a_b, result.w_b_rate),
    ):
        moment = sign * result.moment - (np.cross(gap, result.force) if i == 0 else 0.0)
        force = sign * result.force
        total = r.T @ moment + np.cross(pair.arm[i], r.T @ force) + loads[i][1]
        assert_allclose(pair.mass[i] * a, force + r @ loads[i][0], rtol=0, atol=1e-11)
        assert_allclose(
            pair.inertia[i] @ w_rate + np.cross(w, pair.inertia[i] @ w), total, rtol=0, atol=1e-11
        )
    force, moment = axes @ motion.r.T @ result.force, axes @ motion.r.T @ result.moment
    if held[0] == "length":
        assert_allclose(np.cross(force, motion.gap), 0.0, rtol=0, atol=1e-11)
    else:
        assert_allclose(force[[axis not in held[0] for axis in "xyz"]], 0.0, rtol=0, atol=1e-11)
    if held[1] == "":
        assert_allclose(moment, 0.0, rtol=0, atol=1e-11)
    elif held[1] == "yz":
        assert_allclose(moment[0], 0.0, rtol=0, atol=1e-11)
    elif held[1] == "z":
        assert_allclose([moment[1], result.moment @ motion.r_b @ axes[0]], 0.0, rtol=0, atol=1e-11)


# central differences of order 8
SECOND = np.array([-1 / 560, 8 / 315, -1 / 5, 8 / 5, -205 / 72, 8 / 5, -1 / 5, 8 / 315, -1 / 560])


@pytest.mark.parametrize("seed", SEEDS)
@pytest.mark.parametrize("kind", [kind for kind in KINDS if kind != "free"])
def test_every_kind_keeps_its_constraints(kind, seed):
    """Along a motion with these rates and accelerations, the position of B and the constraints have
    the required second derivatives: 1e-7."""
    random = np.random.default_rng(seed)
    axes = Rotation.from_quat(random.normal(size=4)).as_matrix()
    pair, held = random_pair(random, axes), KINDS[kind]
    m = random_motion(random, kind, axes)
    result = accelerate(pair, held, m, list(random.normal(size=(2, 2, 3))))

    def at(t):
        # a rotation vector whose second derivative at 0 is that of the body's turning
        def turned(r, w, w_rate):
            return r @ Rotation.from_rotvec(w * t + 0.5 * w_rate * t * t).as_matrix()

        r_a, r_b = turned(m.r, m.w, result.w_rate), turned(m.r_b, m.w_b, result.w_b_rate)
        gap = m.gap + m.gap_rate * t + 0.5 * result.gap_acceleration * t * t
        moved = Motion(
            m.x + m.v * t + 0.5 * result.a * t * t, m.v, r_a, m.w, gap, m.gap_rate, r_b, m.w_b
        )
        return bodies(pair, moved)[1][0], axes @ r_a.T @ r_b @ axes.T, gap

    h = 0.005
    places, relative, gaps = (
        np.array(part) for part in zip(*(at(h * i) for i in range(-4, 5)), strict=True)
    )
    assert_allclose(np.tensordot(SECOND, places, 1) / h**2, result.a_b, rtol=0, atol=1e-7)
    products = {"x": relative[:, 2, 1], "y": relative[:, 2, 0], "z": relative[:, 1, 0]}
    for axis in held[1]:
        assert_allclose(products[axis][4], 0.0, rtol=0, atol=1e-14)
        assert_allclose(SECOND @ products[axis] / h**2, 0.0, rtol=0, atol=1e-7)
    if held[0] == "length":
        assert_allclose(SECOND @ np.linalg.norm(gaps, axis=1) / h**2, 0.0, rtol=0, atol=1e-7)


def test_what_is_unknown_is_refused():
    """A spring is outside of these formulations: an error, not a simulation without it."""
    case = {"spring": [{"name": "push"}], "joint": {"pins": {}}}
    with pytest.raises(ValueError, match=r"scene\.spring"):
        simulate(case)
