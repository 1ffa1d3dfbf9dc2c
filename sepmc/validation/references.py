"""Closed forms of motions that occur in separations: references of `sepmc verify` and `sepmc
stress`.

Pure numpy and scipy, SI and radians, independent of the engine. Frames and signs are those of
CONVENTIONS.md. Elliptic functions take m1 = 1 - k^2, so that no digits are lost near a separatrix.
"""

import math
from dataclasses import dataclass

import numpy as np
from numpy.polynomial.legendre import leggauss
from numpy.typing import ArrayLike
from scipy.optimize import brentq
from scipy.special import ellipkm1

from sepmc.validation.elliptic import jacobi_amplitude, legendre_first, legendre_third

Array = np.ndarray


def turn(axis: int, angle: ArrayLike) -> Array:
    """Rotation matrices (..., 3, 3) about a coordinate axis (0, 1, 2 for x, y, z), one for each
    angle, rad."""
    c, s = np.cos(angle), np.sin(angle)
    matrix = np.zeros((*np.shape(angle), 3, 3))
    i, j = (axis + 1) % 3, (axis + 2) % 3
    matrix[..., axis, axis] = 1.0
    matrix[..., i, i], matrix[..., i, j], matrix[..., j, i], matrix[..., j, j] = c, -s, s, c
    return matrix


# --- free rigid body
# --------------------------------------------------------------------------------------------------


@dataclass(frozen=True)
class Composite:
    """Several bodies welded into one: total mass, kg, mass centre (3,), m, and inertia tensor (3,
    3) about it, kg m2, in the axes that the bodies share."""

    mass: float
    centre: Array
    inertia: Array


def composite(masses: ArrayLike, inertias: ArrayLike, positions: ArrayLike) -> Composite:
    """Combine welded rigid bodies into one, by the parallel-axis theorem.

    Parameters
    ----------
    masses : array_like, shape (n,)
        kg.
    inertias : array_like, shape (n, 3, 3)
        Tensor of each body about its own mass centre, kg m2.
    positions : array_like, shape (n, 3)
        Of the mass centres, m; all in one set of axes, from one origin.
    """
    m, x = np.asarray(masses, float), np.asarray(positions, float)
    centre = m @ x / m.sum()
    arms = x - centre
    shift = np.einsum("n,ni,ni->", m, arms, arms) * np.eye(3) - np.einsum(
        "n,ni,nj->ij", m, arms, arms
    )
    return Composite(float(m.sum()), centre, np.sum(inertias, axis=0) + shift)


def weld_wrench(
    combined: Composite, mass: float, inertia: Array, position: Array, point: Array, omega: Array
) -> tuple[Array, Array]:
    """Constraint force and moment on one body of a torque-free composite: F = m a, M = J w' + w x J
    w - (point - position) x F (Newton and Euler).

    Parameters
    ----------
    combined : Composite
    mass, inertia, position : float, ndarray, ndarray
        Of the body: kg; tensor about its mass centre, kg m2; mass centre, m.
    point : ndarray, shape (3,)
        Point about which the moment is taken, m.
    omega : ndarray, shape (n, 3)
        Angular rates of the composite, rad/s. All vectors are in the axes of the composite.

    Returns
    -------
    force, moment : ndarray, shape (n, 3)
        On the body, N and N m.
    """
    w = np.atleast_2d(omega)
    w_rate = np.linalg.solve(combined.inertia, np.cross(w @ combined.inertia, w).T).T
    arm = np.asarray(position, float) - combined.centre
    force = mass * (np.cross(w_rate, arm) + np.cross(w, np.cross(w, arm)))
    moment = (
        w_rate @ inertia
        + np.cross(w, w @ inertia)
        - np.cross(np.asarray(point, float) - position, force)
    )
    return force, moment


def asymmetric_top(
    t: ArrayLike, inertia: ArrayLike, omega: ArrayLike, attitude: ArrayLike | None = None
) -> tuple[Array, Array]:
    """Rates and attitude of a free rigid body at times t, in closed form: Euler's equations by
    Jacobi's elliptic functions.

    Every branch is covered: L^2 above and below 2 E I2 (angular momentum L, energy E, middle moment
    I2), the separatrix between them (k = 1), symmetric and spherical bodies, and steady spin about
    a principal axis.

    Parameters
    ----------
    t : array_like, shape (n,)
        Times, s.
    inertia : ndarray, shape (3, 3)
        Tensor about the mass centre, kg m2.
    omega : array_like, shape (3,)
        Rates at t = 0 in body axes, rad/s.
    attitude : array_like, shape (3, 3), optional
        Rotation matrix from body to ground at t = 0; the identity by default.

    Returns
    -------
    omega : ndarray, shape (n, 3)
        Rates in body axes, rad/s.
    attitude : ndarray, shape (n, 3, 3)
        Rotation matrices from body to ground.

    Notes
    -----
    Landau and Lifshitz, Mechanics, section 37: in principal axes with I3 > I2 > I1 and L^2 > 2 E
    I2, w1 = a cn, w2 = b sn, w3 = c dn of tau = rate t + tau0; for L^2 < 2 E I2 the roles of 1 and
    3 change. The body turns about the fixed L at L/I3 + L (1/I1 - 1/I3) / (1 - n sn^2), n = -I3 (I2
    - I1) / (I1 (I3 - I2)), whose integral is Legendre's of the third kind. Differences such as 2 E
    I3 - L^2 are formed without cancellation. Checked against DOP853 in
    tests/validation/test_references.py.
    """
    times, start = (
        np.atleast_1d(np.asarray(t, float)),
        np.eye(3) if attitude is None else np.asarray(attitude, float),
    )
    moments, axes = np.linalg.eigh(np.asarray(inertia, float))
    # rows: principal axes, right-handed; ascending moments
    axes = axes.T * np.sign(np.linalg.det(axes))
    w = axes @ np.asarray(omega, float)
    w[np.abs(w) <= 4e-16 * np.max(np.abs(w))] = 0.0  # round-off of the rotation into principal axes
    # L^2 - 2 E I2
    toward = (
        moments[0] * (moments[0] - moments[1]) * w[0] ** 2
        + moments[2] * (moments[2] - moments[1]) * w[2] ** 2
    )
    if toward < 0.0:  # descending moments; right-handed
        moments, axes, w = (
            moments[::-1],
            axes[::-1] * [[-1.0], [1.0], [1.0]],
            w[::-1] * (-1.0, 1.0, 1.0),
        )
    if w[2] < 0.0:  # half a turn about the first axis, so that w3 > 0
        axes, w = axes * [[1.0], [-1.0], [-1.0]], w * (1.0, -1.0, -1.0)
    if w[0] < 0.0:  # half a turn about the third axis, so that w1 >= 0
        axes, w = axes * [[-1.0], [-1.0], [1.0]], w * (-1.0, -1.0, 1.0)
    rates, turned = _principal_top(times, moments, w)
    return rates @ axes, start @ axes.T @ turned @ axes


def _principal_top(t: Array, moments: Array, w: Array) -> tuple[Array, Array]:
    """Rates (n, 3), rad/s, of a free body in its principal axes, and rotation matrices (n, 3, 3)
    from these axes at each time to those at t = 0.

    ``moments`` I1, I2, I3 must ascend or descend, in that order for which L^2 lies between 2 E I2
    and 2 E I3; the initial rates ``w`` (3,) must have w1 and w3 >= 0.
    """
    i1, i2, i3 = moments
    toward = i1 * (i1 - i2) * w[0] ** 2 + i3 * (i3 - i2) * w[2] ** 2
    momentum = moments * w
    # steady spin
    if np.linalg.norm(np.cross(w, momentum)) <= 4e-16 * np.linalg.norm(w) * np.linalg.norm(
        momentum
    ):
        speed = np.linalg.norm(w)
        return np.tile(w, (len(t), 1)), rotation(w / speed if speed else w, speed * t)
    side = 1.0 if i3 > i1 else -1.0
    x = side * (i1 * (i3 - i1) * w[0] ** 2 + i2 * (i3 - i2) * w[1] ** 2)  # |2 E I3 - L^2|
    y = side * (i2 * (i2 - i1) * w[1] ** 2 + i3 * (i3 - i1) * w[2] ** 2)  # |L^2 - 2 E I1|
    first, second, third = (
        math.sqrt(q)
        for q in (
            x / (side * i1 * (i3 - i1)),
            x / (side * i2 * (i3 - i2)),
            y / (side * i3 * (i3 - i1)),
        )
    )
    rate = side * math.sqrt(side * (i3 - i2) * y / (i1 * i2 * i3))
    m1 = min((i3 - i1) * toward / ((i3 - i2) * side * y), 1.0)  # 1 - k^2
    phase = math.atan2(w[1] / second, w[0] / first)
    amplitude = jacobi_amplitude(rate * t + float(legendre_first(phase, m1)), m1)
    s, c = np.sin(amplitude), np.cos(amplitude)
    rates = np.stack([first * c, second * s, third * np.sqrt(c * c + m1 * s * s)], axis=1)
    n = -i3 * (i2 - i1) / (i1 * (i3 - i2))
    spin = np.linalg.norm(moments * w)
    precession = spin * t / i3 + spin * (1.0 / i1 - 1.0 / i3) / rate * (
        legendre_third(n, amplitude, m1) - legendre_third(n, phase, m1)
    )

    def attitude(precession: Array, momentum: Array) -> Array:
        """Rotation matrices from principal axes to axes whose z is along L, from the precession
        angle about L, rad, and the angular momentum in principal axes: Rz(precession) Rx(nutation)
        Rz(spin)."""
        nutation = np.arctan2(np.hypot(momentum[..., 0], momentum[..., 1]), momentum[..., 2])
        own = np.arctan2(momentum[..., 0], momentum[..., 1])
        return turn(2, precession) @ turn(0, nutation) @ turn(2, own)

    return rates, attitude(np.zeros(1), (moments * w)[None])[0].T @ attitude(
        precession, moments * rates
    )


def rotation(axis: ArrayLike, angle: ArrayLike) -> Array:
    """Rotation matrices (n, 3, 3) about a unit axis (3,), one for each angle, rad: Rodrigues'
    formula."""
    x, y, z = np.asarray(axis, float)
    k = np.array([[0.0, -z, y], [z, 0.0, -x], [-y, x, 0.0]])
    angles = np.atleast_1d(angle)[:, None, None]
    return np.eye(3) + np.sin(angles) * k + 2.0 * np.sin(0.5 * angles) ** 2 * (k @ k)


# --- pushed apart along a line
# --------------------------------------------------------------------------------------------------


def reduced_mass(first: float, second: float) -> float:
    """Reduced mass of two free bodies, m1 m2 / (m1 + m2), kg."""
    return first * second / (first + second)


def spring_extension(
    t: ArrayLike, mass: float, force: float, stiffness: float, damping: float = 0.0
) -> tuple[Array, Array]:
    """Extension x, m, and its rate, m/s, of m x'' = force - stiffness x - damping x' from rest at x
    = 0.

    Parameters
    ----------
    t : array_like
        Times, s.
    mass : float
        m: the reduced mass of two free bodies, kg.
    force, stiffness, damping : float
        N, N/m, N s/m; below critical damping, else ValueError.

    Notes
    -----
    Step response of an oscillator; for stiffness = damping = 0, force t^2 / (2 m).
    """
    t = np.asarray(t, float)
    if stiffness == 0.0 and damping == 0.0:
        return 0.5 * force / mass * t * t, force / mass * t
    decay = 0.5 * damping / mass
    frequency = math.sqrt(stiffness / mass - decay**2)
    fade, s, c = np.exp(-decay * t), np.sin(frequency * t), np.cos(frequency * t)
    x = force / stiffness * (1.0 - fade * (c + decay / frequency * s))
    return x, force / (mass * frequency) * fade * s


def spring_release(
    mass: float, force: float, stiffness: float, stroke: float, damping: float = 0.0
) -> tuple[float, float]:
    """Time, s, at which a spring as in `spring_extension` has pushed two bodies apart over its
    stroke, m, and the separation speed, m/s, at that time.

    ``mass`` is the reduced mass, kg. Without damping the speed follows from energy, m v^2 / 2 =
    force stroke - stiffness stroke^2 / 2, and the time is acos(1 - stiffness stroke / force) /
    frequency, computed from its sine so that a short stroke loses no digits. Raises ValueError if
    the spring does not push as far as ``stroke``.
    """
    if damping == 0.0:
        speed = math.sqrt((2.0 * force - stiffness * stroke) * stroke / mass)
        if stiffness == 0.0:
            return math.sqrt(2.0 * mass * stroke / force), speed
        frequency = math.sqrt(stiffness / mass)
        return 2.0 * math.asin(math.sqrt(0.5 * stiffness * stroke / force)) / frequency, speed
    # where the rate vanishes
    last = math.pi / math.sqrt(stiffness / mass - (0.5 * damping / mass) ** 2)
    time = brentq(
        lambda t: float(spring_extension(t, mass, force, stiffness, damping)[0]) - stroke,
        0.0,
        last,
        xtol=1e-16,
        rtol=1e-15,
    )
    return time, float(spring_extension(time, mass, force, stiffness, damping)[1])


def thrust_gap(t: ArrayLike, acceleration: float, build_up: float = 0.0) -> tuple[Array, Array]:
    """Gap, m, and its rate, m/s, of two bodies on a slider whose motors, in line with it, drive
    them apart.

    Parameters
    ----------
    t : array_like
        Times, s.
    acceleration : float
        Thrust over mass, summed over both bodies, m/s2.
    build_up : float
        Time constant, s; the thrust is F (1 - exp(-t / build_up)).

    Notes
    -----
    With s = t / build_up: gap = a build_up^2 (s^2 / 2 - s + 1 - e^-s), rate = a build_up (s - 1 +
    e^-s); a t^2 / 2 and a t without build-up.
    """
    t = np.asarray(t, float)
    if build_up == 0.0:
        return 0.5 * acceleration * t * t, acceleration * t
    s = t / build_up
    lag = s + np.expm1(-s)
    return acceleration * build_up**2 * (0.5 * s * s - lag), acceleration * build_up * lag


def burn_gap(
    t: ArrayLike, acceleration: float, burn: float, tail_off: float
) -> tuple[Array, Array]:
    """Gap, m, and its rate, m/s, as `thrust_gap` without build-up, for a thrust that is constant up
    to the time ``burn``, s, and then falls as exp(-(t - burn) / tail_off), with ``tail_off`` in
    s."""
    t = np.asarray(t, float)
    on, after = np.minimum(t, burn), np.maximum(t - burn, 0.0)
    gained = -np.expm1(-after / tail_off) * tail_off  # integral of the falling exponential
    gap = 0.5 * on * on + on * after + tail_off * (after - gained)
    return acceleration * gap, acceleration * (on + gained)


# --- hinge and ball joint
# --------------------------------------------------------------------------------------------------


def pendulum(
    t: ArrayLike, frequency: float, angle: float, rate: float = 0.0
) -> tuple[Array, Array]:
    """Angle, rad, and rate, rad/s, of angle'' = -frequency^2 sin(angle) at times t, from any start:
    swinging, circling or on the separatrix.

    Parameters
    ----------
    t : array_like
        Times, s.
    frequency : float
        Of small swings, rad/s: sqrt(m g h / J), J about the hinge; sqrt(g / L) for a mass on a rod.
    angle, rate : float
        At t = 0, rad from the lowest position, within half a turn, and rad/s.

    Notes
    -----
    With k^2 = sin^2(angle / 2) + (rate / (2 frequency))^2 at the start: sin(angle / 2) = k
    sn(frequency t + u0, k^2) for k < 1, angle / 2 = am(k frequency t + u0, 1 / k^2) for k >= 1.
    Whittaker, Analytical Dynamics, section 44.
    """
    t = np.asarray(t, float)
    x, y = math.sin(0.5 * angle), 0.5 * rate / frequency
    k = math.hypot(x, y)
    m1 = math.cos(0.5 * angle) ** 2 - y * y  # 1 - k^2
    if m1 > 0.0:
        swing = jacobi_amplitude(frequency * t + float(legendre_first(math.atan2(x, y), m1)), m1)
        return 2.0 * np.arcsin(k * np.sin(swing)), 2.0 * k * frequency * np.cos(swing)
    m1, way = -m1 / (k * k), math.copysign(1.0, rate)
    half = jacobi_amplitude(way * k * frequency * t + float(legendre_first(0.5 * angle, m1)), m1)
    return 2.0 * half, 2.0 * way * k * frequency * np.sqrt(
        np.cos(half) ** 2 + m1 * np.sin(half) ** 2
    )


def pendulum_period(frequency: float, amplitude: float) -> float:
    """Period, s, of a pendulum that swings to an amplitude, rad, with ``frequency``, rad/s, as in
    `pendulum`: 4 K(sin^2(amplitude / 2)) / frequency."""
    return 4.0 * float(ellipkm1(math.cos(0.5 * amplitude) ** 2)) / frequency


def hinge_wrench(
    mass: float, inertia: Array, arm: ArrayLike, rate: float, rate_rate: float, weight: ArrayLike
) -> tuple[Array, Array]:
    """Force, N, and moment about the hinge point, N m, that a fixed hinge along body z exerts on a
    body that turns about it, body axes.

    Parameters
    ----------
    mass : float
        kg.
    inertia : ndarray, shape (3, 3)
        About the mass centre, kg m2.
    arm : array_like, shape (3,)
        From the hinge to the mass centre, m.
    rate, rate_rate : float
        Angular rate about the hinge and its derivative, rad/s and rad/s2.
    weight : array_like, shape (3,)
        Force of gravity in body axes, N.

    Notes
    -----
    F = m a - weight; M = J w' + w x J w - arm x weight with J about the hinge. Products of inertia
    load the hinge across its axis.
    """
    r, g, z = np.asarray(arm, float), np.asarray(weight, float), np.array([0.0, 0.0, 1.0])
    about = np.asarray(inertia, float) + mass * (r @ r * np.eye(3) - np.outer(r, r))
    force = mass * (rate_rate * np.cross(z, r) + rate**2 * np.cross(z, np.cross(z, r))) - g
    moment = rate_rate * about[:, 2] + rate**2 * np.cross(z, about[:, 2]) - np.cross(r, g)
    return force, moment


def heavy_top(
    t: ArrayLike,
    axial: float,
    transverse: float,
    torque: float,
    tilt: float,
    spin: float,
    precession: float,
) -> Array:
    """Cosine of the tilt of a symmetric top on a fixed ball joint, at times t, from a start at
    which the tilt is stationary; cos(tilt) > 0 is upright.

    A spherical pendulum is the top without spin. Its period in tilt is `nutation_period`.

    Parameters
    ----------
    t : array_like
        Times, s.
    axial, transverse : float
        Moments of inertia about the ball, kg m2: about the axis of the top, and across it.
    torque : float
        m g l, N m, with the distance l from the ball to the mass centre.
    tilt : float
        At t = 0, between the axis (from the ball to the mass centre) and the upward vertical, rad.
    spin : float
        Rate about the axis, rad/s; it is constant.
    precession : float
        Rate of the axis about the upward vertical at t = 0, rad/s.

    Notes
    -----
    Lagrange's case; u = cos(tilt) follows u'^2 = f(u), a cubic with f(u0) = 0 at the start, so that
    its other roots come from a quadratic; u = u1 + (u2 - u1) sn^2. Whittaker, Analytical Dynamics,
    section 71.
    """
    u0, other, rate, m1 = _nutation(axial, transverse, torque, tilt, spin, precession)
    angle = jacobi_amplitude(rate * np.asarray(t, float), m1)
    s2, c2 = np.sin(angle) ** 2, np.cos(angle) ** 2
    # from the upper end: cn^2 / dn^2 = sn^2(u + K)
    return u0 + (other - u0) * (s2 if other > u0 else m1 * s2 / (c2 + m1 * s2))


def nutation_period(
    axial: float, transverse: float, torque: float, tilt: float, spin: float, precession: float
) -> float:
    """Period, s, of the tilt of the top of `heavy_top`; parameters are those of `heavy_top`."""
    _, _, rate, m1 = _nutation(axial, transverse, torque, tilt, spin, precession)
    return 2.0 * float(ellipkm1(m1)) / rate


def _nutation(
    axial: float, transverse: float, torque: float, tilt: float, spin: float, precession: float
) -> tuple[float, float, float, float]:
    """Return four numbers on the top of `heavy_top`: cos(tilt) at the start and at its other
    extreme, and the rate, 1/s, and 1 - k^2 of the elliptic function that leads from one to the
    other."""
    u0, s2 = math.cos(tilt), math.sin(tilt) ** 2
    a, beta = axial * spin / transverse, 2.0 * torque / transverse
    # f(u) = (alpha - beta u)(1 - u^2) - (b - a u)^2 with alpha = beta u0 + precession^2 s2 and b =
    # precession s2 + a u0; over (u - u0) it is beta u^2 - p u + q, with p >= 0.
    p = precession**2 * s2 + a * a
    q = 2.0 * a * (precession * s2 + a * u0) - beta - p * u0
    third = (p + math.sqrt(p * p - 4.0 * beta * q)) / (2.0 * beta)
    other = q / (beta * third)
    low, high = min(u0, other), max(u0, other)
    return u0, other, 0.5 * math.sqrt(beta * (third - low)), (third - high) / (third - low)


def steady_precession(
    axial: float, transverse: float, torque: float, tilt: float, spin: float
) -> tuple[float, float]:
    """Slow and fast rate, rad/s, at which the top of `heavy_top` precesses about the upward
    vertical at a constant tilt; parameters are those of `heavy_top`.

    They are the roots w of transverse cos(tilt) w^2 - axial spin w + torque = 0. Without spin and
    hanging, they are +-sqrt(torque / (transverse |cos|)): the conical pendulum. Raises ValueError
    if they are not real: a top that spins too slowly does not stay at that tilt.
    """
    a, b = transverse * math.cos(tilt), axial * spin
    root = math.sqrt(b * b - 4.0 * a * torque)
    if b == 0.0:
        return root / (2.0 * a), -root / (2.0 * a)
    fast = (b + math.copysign(root, b)) / (2.0 * a)
    return torque / (a * fast), fast


def conical_rate(length: float, gravity: float, tilt: float) -> float:
    """Rate, rad/s, at which a mass on a rod circles at a constant tilt, rad, from the downward
    vertical: sqrt(g / (L cos(tilt))), with the length L, m, and the gravity g, m/s2."""
    return math.sqrt(gravity / (length * math.cos(tilt)))


def hooke_angle(angle: ArrayLike, bend: float) -> Array:
    """Angle of the driven shaft of a universal joint, rad, from the angle of the driving shaft:
    tan(driven) = tan(angle) cos(bend), with the angle ``bend``, rad, between the shafts.

    Both angles count, in the same sense, from the position in which the pin of the driving fork is
    normal to the plane of the shafts; full turns are kept. Textbook kinematics of Hooke's joint;
    the ratio of rates is `hooke_ratio`.
    """
    s, c, k = np.sin(angle), np.cos(angle), math.cos(bend)
    return np.asarray(angle, float) + np.arctan2((k - 1.0) * s * c, c * c + k * s * s)


def hooke_ratio(angle: ArrayLike, bend: float) -> Array:
    """Rate of the driven shaft over that of the driving one: cos(bend) / (1 - sin^2(bend)
    sin^2(angle)), with the ``angle`` of the driving shaft, rad, and the angle ``bend``, rad,
    between the shafts, as in `hooke_angle`."""
    return math.cos(bend) / (1.0 - (math.sin(bend) * np.sin(angle)) ** 2)


# --- rail
# --------------------------------------------------------------------------------------------------


@dataclass(frozen=True)
class TipOff:
    """Tip-off from a rail: time from release of the front shoe to release of the rear one, s; angle
    from the rail, rad, and rate, rad/s, about z at the release of the rear one. Both are negative,
    as the nose drops."""

    time: float
    angle: float
    rate: float


def tip_off(
    mass: float,
    inertia: float,
    ahead: float,
    above: float,
    gravity: float,
    elevation: float,
    speed: float,
    travel: float,
) -> TipOff:
    """Tip-off of a coasting body that turns about its rear shoe under gravity after the front shoe
    has left a straight rail, until the rear shoe leaves it. Raises ValueError if the body has
    turned by 0.5 rad before that.

    Parameters
    ----------
    mass, inertia : float
        kg, and kg m2 about z through the mass centre.
    ahead, above : float
        Position of the mass centre from the rear shoe, along and across the rail, m.
    gravity, elevation : float
        Gravity, m/s2; angle of the rail above the horizontal, rad.
    speed : float
        Along the rail when the front shoe leaves, m/s.
    travel : float
        Path of the rear shoe from that instant to the end of the rail, m.

    Notes
    -----
    The rail exerts a force only across itself. So the mass centre moves along it as thrown, speed t
    - g sin(elevation) t^2 / 2, and across it energy is conserved: (J + m c^2) w^2 / 2 = -m g
    cos(elevation) h, with h = ahead sin(a) + above (cos(a) - 1) the rise of the mass centre and c =
    dh/da. The rate is a function of the angle, in closed form; the time is a quadrature over the
    angle a = -q^2, whose integrand is smooth.
    """
    pull = mass * gravity * math.cos(elevation)

    def lever(a: float) -> float:
        """Lever arm c = dh/da, m, at the angle a, rad, that the body has turned about the rear
        shoe: the distance along the rail from that shoe to the mass centre, whose rise across the
        rail is h."""
        return ahead * math.cos(a) - above * math.sin(a)

    def rate(a: float) -> float:
        # rise = lever of the half angle times the chord, exact and without cancellation
        """Rate da/dt, rad/s, at the angle a < 0, rad, from energy; it is negative."""
        rise = 2.0 * math.sin(0.5 * a) * (ahead * math.cos(0.5 * a) - above * math.sin(0.5 * a))
        return -math.sqrt(-2.0 * pull * rise / (inertia + mass * lever(a) ** 2))

    def slowness(q: float) -> float:
        """dt/dq, s: 2 q / |rate| at the angle -q^2, finite at the start."""
        if q == 0.0:
            return 2.0 * math.sqrt((inertia + mass * ahead**2) / (2.0 * pull * ahead))
        return -2.0 * q / rate(-q * q)

    def time(q: float) -> float:
        """Time, s, from release of the front shoe to the angle -q^2."""
        nodes, weights = leggauss(40)  # Gauss and Legendre; 30 nodes give the same to round-off
        return (
            0.5
            * q
            * sum(
                weight * slowness(0.5 * q * (1.0 + node))
                for node, weight in zip(nodes, weights, strict=True)
            )
        )

    def remaining_travel(q: float) -> float:
        """Distance, m, from the rear shoe to the end of the rail at the angle -q^2: ``travel``
        minus the path of the shoe, which is that of the mass centre plus the shift between them."""
        t, a = time(q), -q * q
        shift = ahead * (1.0 - math.cos(a)) + above * math.sin(a)
        return travel - (speed * t - 0.5 * gravity * math.sin(elevation) * t * t + shift)

    q = brentq(remaining_travel, 0.0, math.sqrt(0.5), xtol=1e-16, rtol=1e-15)
    return TipOff(time(q), -q * q, rate(-q * q))
