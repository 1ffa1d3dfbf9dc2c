"""Closed forms of motions that a separation is made of: the references of `sepmc verify`.

Pure numpy and scipy, SI and radians; nothing here knows the engine. Frames and signs are those of
CONVENTIONS.md. Elliptic functions take m1 = 1 - k^2, so that no digit is lost near a separatrix.
"""

import math
from dataclasses import dataclass

import numpy as np
from numpy.polynomial.legendre import leggauss
from numpy.typing import ArrayLike
from scipy.optimize import brentq
from scipy.special import ellipkm1, elliprf, elliprj

Array = np.ndarray


def turn(axis: int, angle: ArrayLike) -> Array:
    """Rotation matrices about a coordinate axis, one per angle (rad): shape (..., 3, 3)."""
    c, s = np.cos(angle), np.sin(angle)
    found = np.zeros((*np.shape(angle), 3, 3))
    i, j = (axis + 1) % 3, (axis + 2) % 3
    found[..., axis, axis] = 1.0
    found[..., i, i], found[..., i, j], found[..., j, i], found[..., j, j] = c, -s, s, c
    return found


# --- a rigid body left alone
# --------------------------------------------------------------------------------------------------


@dataclass(frozen=True)
class Composite:
    """Two or more bodies as one: mass (kg), mass centre (m) and inertia tensor about it (kg m2), in
    their common axes."""

    mass: float
    centre: Array
    inertia: Array


def composite(masses: ArrayLike, inertias: ArrayLike, places: ArrayLike) -> Composite:
    """Rigid bodies welded together: the parallel-axis theorem.

    Parameters
    ----------
    masses : (n,), inertias : (n, 3, 3) about each mass centre, places : (n, 3) of the mass centres;
        all in one set of axes.
    """
    m, x = np.asarray(masses, float), np.asarray(places, float)
    centre = m @ x / m.sum()
    arms = x - centre
    shift = np.einsum("n,ni,ni->", m, arms, arms) * np.eye(3) - np.einsum(
        "n,ni,nj->ij", m, arms, arms
    )
    return Composite(float(m.sum()), centre, np.sum(inertias, axis=0) + shift)


def weld_wrench(
    whole: Composite, mass: float, inertia: Array, place: Array, point: Array, omega: Array
) -> tuple[Array, Array]:
    """Force and moment that hold one body to a torque-free composite: F = m a, M = J w' + w x J w -
    (point - place) x F.

    Parameters
    ----------
    mass, inertia, place : of the body held (kg, kg m2, m); point : where the moment is taken (m)
    omega : (n, 3)
        Rates of the composite (rad/s). All in the axes of the composite.

    Returns
    -------
    force, moment : (n, 3) on the body held, N and N m. Newton and Euler's laws.
    """
    w = np.atleast_2d(omega)
    w_rate = np.linalg.solve(whole.inertia, np.cross(w @ whole.inertia, w).T).T
    arm = np.asarray(place, float) - whole.centre
    force = mass * (np.cross(w_rate, arm) + np.cross(w, np.cross(w, arm)))
    moment = (
        w_rate @ inertia
        + np.cross(w, w @ inertia)
        - np.cross(np.asarray(point, float) - place, force)
    )
    return force, moment


def asymmetric_top(
    t: ArrayLike, inertia: ArrayLike, omega: ArrayLike, attitude: ArrayLike | None = None
) -> tuple[Array, Array]:
    """Rates and attitude of a free rigid body at times t: Euler's equations by Jacobi's elliptic
    functions.

    Every branch is covered: L^2 above and below 2 E I2, the separatrix between them (k = 1),
    symmetric and spherical bodies, and steady spin about a principal axis.

    Parameters
    ----------
    t : (n,) times, s
    inertia : (3, 3) tensor about the mass centre, kg m2
    omega : (3,) rates at t = 0 in body axes, rad/s
    attitude : (3, 3) body to ground at t = 0; the identity if None

    Returns
    -------
    omega : (n, 3) rates in body axes; attitude : (n, 3, 3) body to ground

    Notes
    -----
    Landau and Lifshitz, Mechanics, section 37: in principal axes with I3 > I2 > I1 and L^2 > 2 E
    I2, w1 = a cn, w2 = b sn, w3 = c dn of tau = rate t + tau0; for L^2 < 2 E I2 the roles of 1 and
    3 change. The body turns about the fixed L at L/I3 + L (1/I1 - 1/I3) / (1 - n sn^2), n = -I3 (I2
    - I1) / (I1 (I3 - I2)), whose integral is Legendre's of the third kind. Differences such as 2 E
    I3 - L^2 are formed without cancellation. Checked against DOP853 in
    tests/validation/test_references.py."""
    times, start = (
        np.atleast_1d(np.asarray(t, float)),
        np.eye(3) if attitude is None else np.asarray(attitude, float),
    )
    moments, axes = np.linalg.eigh(np.asarray(inertia, float))
    # rows: principal axes, right-handed; ascending moments
    axes = axes.T * np.sign(np.linalg.det(axes))
    w = axes @ np.asarray(omega, float)
    w[np.abs(w) <= 4e-16 * np.max(np.abs(w))] = 0.0  # round-off of the turn into principal axes
    # L^2 - 2 E I2
    toward = (
        moments[0] * (moments[0] - moments[1]) * w[0] ** 2
        + moments[2] * (moments[2] - moments[1]) * w[2] ** 2
    )
    if toward < 0.0:  # count from the greatest moment down; a row changes sign to stay right-handed
        moments, axes, w = (
            moments[::-1],
            axes[::-1] * [[-1.0], [1.0], [1.0]],
            w[::-1] * (-1.0, 1.0, 1.0),
        )
    if w[2] < 0.0:  # half a turn about the first axis, so that w3 > 0
        axes, w = axes * [[1.0], [-1.0], [-1.0]], w * (1.0, -1.0, -1.0)
    if w[0] < 0.0:  # and about the third, so that w1 >= 0
        axes, w = axes * [[-1.0], [-1.0], [1.0]], w * (-1.0, -1.0, 1.0)
    rates, turned = _principal_top(times, moments, w)
    return rates @ axes, start @ axes.T @ turned @ axes


def _principal_top(t: Array, moments: Array, w: Array) -> tuple[Array, Array]:
    """Rates (n, 3) in principal axes, and attitudes (n, 3, 3) from the start; L^2 on the side of
    I3, w1 and w3 >= 0."""
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
        """Body to axes whose z is along L: Rz(precession) Rx(nutation) Rz(spin)."""
        nutation = np.arctan2(np.hypot(momentum[..., 0], momentum[..., 1]), momentum[..., 2])
        own = np.arctan2(momentum[..., 0], momentum[..., 1])
        return turn(2, precession) @ turn(0, nutation) @ turn(2, own)

    return rates, attitude(np.zeros(1), (moments * w)[None])[0].T @ attitude(
        precession, moments * rates
    )


def jacobi_amplitude(u: ArrayLike, m1: float) -> Array:
    """Jacobi's amplitude am(u), continuous over all periods; sn = sin am, cn = cos am.

    By the arithmetic-geometric mean (Abramowitz and Stegun 16.4) from m1 = 1 - k^2, which near k =
    1 holds digits that k^2 has lost.
    """
    u = np.asarray(u, float)
    if m1 <= 0.0:
        return 2.0 * np.arctan(np.tanh(0.5 * u))
    a, b = 1.0, math.sqrt(m1)
    ratios: list[float] = []
    while (a - b) > 4e-16 * a or not ratios:
        a, b, c = 0.5 * (a + b), math.sqrt(a * b), 0.5 * (a - b)
        ratios.append(c / a)
    angle = 2.0 ** len(ratios) * a * u
    for ratio in reversed(ratios):
        angle = 0.5 * (angle + np.arcsin(ratio * np.sin(angle)))
    return angle


def legendre_first(angle: ArrayLike, m1: float) -> Array:
    """Legendre's incomplete integral of the first kind, within a quarter turn: F of an angle, with
    m1 = 1 - k^2. DLMF 19.25.5."""
    s, c = np.sin(angle), np.cos(angle)
    return s * elliprf(c * c, c * c + m1 * s * s, 1.0)


def legendre_third(n: float, angle: ArrayLike, m1: float) -> Array:
    """Legendre's incomplete integral of the third kind: of 1 / ((1 - n sin^2) sqrt(1 - k^2 sin^2))
    from 0 to an angle.

    n <= 0 and m1 = 1 - k^2; angles of any size, within a quarter turn if m1 = 0. DLMF 19.25.14, by
    Carlson's R_F and R_J.
    """
    angles = np.asarray(angle, float)
    whole = np.round(angles / math.pi)

    def within(angle: Array) -> Array:
        s2, c2 = np.sin(angle) ** 2, np.cos(angle) ** 2
        first, third = (
            elliprf(c2, c2 + m1 * s2, 1.0),
            elliprj(c2, c2 + m1 * s2, 1.0, c2 + (1.0 - n) * s2),
        )
        return np.sin(angle) * (first + n / 3.0 * s2 * third)

    return 2.0 * whole * (within(np.array(0.5 * math.pi)) if np.any(whole) else 0.0) + within(
        angles - whole * math.pi
    )


def rotation(axis: ArrayLike, angle: ArrayLike) -> Array:
    """Rotation matrices about a unit axis (3,), one per angle (rad): Rodrigues' formula, shape (n,
    3, 3)."""
    x, y, z = np.asarray(axis, float)
    k = np.array([[0.0, -z, y], [z, 0.0, -x], [-y, x, 0.0]])
    angles = np.atleast_1d(angle)[:, None, None]
    return np.eye(3) + np.sin(angles) * k + 2.0 * np.sin(0.5 * angles) ** 2 * (k @ k)


# --- pushed apart along a line
# --------------------------------------------------------------------------------------------------


def reduced_mass(first: float, second: float) -> float:
    """Mass that a force between two free bodies accelerates: m1 m2 / (m1 + m2), kg."""
    return first * second / (first + second)


def spring_extension(
    t: ArrayLike, mass: float, force: float, stiffness: float, damping: float = 0.0
) -> tuple[Array, Array]:
    """Extension x (m) and its rate (m/s) of m x'' = force - stiffness x - damping x' from rest at x
    = 0.

    Parameters
    ----------
    mass : kg, the reduced mass of two free bodies; force : N; stiffness : N/m; damping : N s/m,
        below critical

    Notes
    -----
    The response of an oscillator to a step, as in any text on vibrations; for stiffness = damping =
    0, force t^2 / (2 m).
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
    """Time (s) at which a spring has pushed over its stroke (m), and the speed apart it leaves
    (m/s).

    Without damping the speed follows from energy alone, m v^2 / 2 = force stroke - stiffness
    stroke^2 / 2, and the time is acos(1 - stiffness stroke / force) / frequency, here by its sine
    so that a short stroke loses no digits.
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
    """Gap (m) and its rate (m/s) of two bodies that accelerate apart along a slider, aligned with
    it.

    Parameters
    ----------
    acceleration : m/s2, thrust / mass summed over both bodies
    build_up : s; the thrust is F (1 - exp(-t / build_up))

    Notes
    -----
    With s = t / build_up: gap = a build_up^2 (s^2 / 2 - s + 1 - e^-s), rate = a build_up (s - 1 +
    e^-s); a t^2 / 2 and a t without.
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
    """Gap (m) and rate (m/s) as `thrust_gap` without build-up, of a thrust that after ``burn`` (s)
    falls as exp(-(t - burn) / tail_off)."""
    t = np.asarray(t, float)
    on, after = np.minimum(t, burn), np.maximum(t - burn, 0.0)
    gained = -np.expm1(-after / tail_off) * tail_off  # integral of the falling exponential
    gap = 0.5 * on * on + on * after + tail_off * (after - gained)
    return acceleration * gap, acceleration * (on + gained)


# --- on a hinge or a ball
# --------------------------------------------------------------------------------------------------


def pendulum(
    t: ArrayLike, frequency: float, angle: float, rate: float = 0.0
) -> tuple[Array, Array]:
    """Angle (rad) and rate (rad/s) of angle'' = -frequency^2 sin(angle) from any start: swinging,
    circling or on the separatrix.

    Parameters
    ----------
    frequency : rad/s of small swings: sqrt(m g h / J), J about the hinge; sqrt(g / L) for a mass on
        a rod
    angle, rate : at t = 0, from the rest position, within half a turn

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
    """Period (s) of a pendulum of finite amplitude (rad): 4 K(sin^2(amplitude / 2)) / frequency."""
    return 4.0 * float(ellipkm1(math.cos(0.5 * amplitude) ** 2)) / frequency


def hinge_wrench(
    mass: float, inertia: Array, arm: ArrayLike, rate: float, rate_rate: float, weight: ArrayLike
) -> tuple[Array, Array]:
    """Force (N) and moment (N m) of a fixed hinge along z on the body it carries, moment about the
    hinge point, body axes.

    Parameters
    ----------
    inertia : (3, 3) about the mass centre, kg m2; arm : from the hinge to the mass centre, m
    rate, rate_rate : about the hinge, rad/s and rad/s2; weight : force of gravity in body axes, N

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
    """Cosine of the tilt of a symmetric top on a fixed ball joint, that starts where its tilt is
    stationary; cos(tilt) > 0 is upright.

    A spherical pendulum is the top without spin. Its period in tilt is `nutation_period`.

    Parameters
    ----------
    axial, transverse : moments of inertia about the ball, kg m2
    torque : m g l, N m
    tilt : at t = 0, between the axis (from the ball to the mass centre) and the vertical, rad
    spin : rate about the axis, constant, rad/s
    precession : rate of the axis about the upward vertical at t = 0, rad/s

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
    """Period (s) of the tilt of `heavy_top`."""
    _, _, rate, m1 = _nutation(axial, transverse, torque, tilt, spin, precession)
    return 2.0 * float(ellipkm1(m1)) / rate


def _nutation(
    axial: float, transverse: float, torque: float, tilt: float, spin: float, precession: float
) -> tuple[float, float, float, float]:
    """The start and the other end of cos(tilt), and rate and 1 - k^2 of the elliptic functions
    between them."""
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
    """Both rates (rad/s) at which the top of `heavy_top` turns at a constant tilt: slow, fast.

    Roots of transverse cos(tilt) w^2 - axial spin w + torque = 0. Without spin and hanging,
    +-sqrt(torque / (transverse |cos|)): the conical pendulum.
    """
    a, b = transverse * math.cos(tilt), axial * spin
    root = math.sqrt(b * b - 4.0 * a * torque)
    if b == 0.0:
        return root / (2.0 * a), -root / (2.0 * a)
    fast = (b + math.copysign(root, b)) / (2.0 * a)
    return torque / (a * fast), fast


def conical_rate(length: float, gravity: float, tilt: float) -> float:
    """Rate (rad/s) at which a mass on a rod of a length (m) circles at a constant tilt from the
    vertical: sqrt(g / (L cos(tilt)))."""
    return math.sqrt(gravity / (length * math.cos(tilt)))


def hooke_angle(angle: ArrayLike, bend: float) -> Array:
    """Angle of the driven shaft of a universal joint: tan(driven) = tan(angle) cos(bend).

    Angles (rad) are from where the driving fork's pin stands across the plane of the shafts, with
    the same sense. Text-book kinematics of Hooke's joint; the ratio of rates is `hooke_ratio`.
    """
    s, c, k = np.sin(angle), np.cos(angle), math.cos(bend)
    return np.asarray(angle, float) + np.arctan2((k - 1.0) * s * c, c * c + k * s * s)


def hooke_ratio(angle: ArrayLike, bend: float) -> Array:
    """Rate of the driven shaft over that of the driving one: cos(bend) / (1 - sin^2(bend)
    sin^2(angle)); see `hooke_angle`."""
    return math.cos(bend) / (1.0 - (math.sin(bend) * np.sin(angle)) ** 2)


# --- off a rail
# --------------------------------------------------------------------------------------------------


@dataclass(frozen=True)
class TipOff:
    """How a body leaves its rail: time since its front shoe left (s), angle (rad) and rate (rad/s)
    about z when the rear one does."""

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
    """Tip-off of a coasting body that turns about its rear shoe once the front one has left a
    straight rail.

    Parameters
    ----------
    mass, inertia : kg, kg m2 about z through the mass centre
    ahead, above : of the mass centre, from the rear shoe along and across the rail, m
    gravity : m/s2; elevation : of the rail, rad
    speed : along the rail when the front shoe leaves, m/s; travel : of the rear shoe from then to
        the end of the rail, m

    Notes
    -----
    The rail pushes across itself only. So along it the mass centre moves as thrown, speed t - g
    sin(elevation) t^2 / 2, and across it energy is kept: (J + m c^2) w^2 / 2 = -m g cos(elevation)
    h, with h = ahead sin(a) + above (cos(a) - 1) the rise of the mass centre and c = dh/da. The
    rate is a function of the angle, in closed form; the time is a quadrature over the angle a =
    -q^2, whose integrand is smooth.
    """
    pull = mass * gravity * math.cos(elevation)

    def lever(a: float) -> float:
        return ahead * math.cos(a) - above * math.sin(a)

    def rate(a: float) -> float:
        # rise = lever of the half angle times the chord, exact and without cancellation
        rise = 2.0 * math.sin(0.5 * a) * (ahead * math.cos(0.5 * a) - above * math.sin(0.5 * a))
        return -math.sqrt(-2.0 * pull * rise / (inertia + mass * lever(a) ** 2))

    def slowness(q: float) -> float:
        """dt/dq: 2 q / |rate|, finite at the start."""
        if q == 0.0:
            return 2.0 * math.sqrt((inertia + mass * ahead**2) / (2.0 * pull * ahead))
        return -2.0 * q / rate(-q * q)

    def time(q: float) -> float:
        nodes, weights = leggauss(40)  # Gauss and Legendre; 30 nodes give the same to round-off
        return (
            0.5
            * q
            * sum(
                weight * slowness(0.5 * q * (1.0 + node))
                for node, weight in zip(nodes, weights, strict=True)
            )
        )

    def left(q: float) -> float:
        """Travel of the rear shoe still to go: that of the mass centre, less how far the shoe
        trails it."""
        t, a = time(q), -q * q
        shift = ahead * (1.0 - math.cos(a)) + above * math.sin(a)
        return travel - (speed * t - 0.5 * gravity * math.sin(elevation) * t * t + shift)

    q = brentq(left, 0.0, math.sqrt(0.5), xtol=1e-16, rtol=1e-15)
    return TipOff(time(q), -q * q, rate(-q * q))
