"""Smallest distance from the rim of a solid (the circle around an end face) to the inside of a
shell, all in one frame and in metres.

A rim is the tuple (centre, normal, radius); a shell is the tuple (start, axis, length, r0, r1) of
`outlines`. In a view along the axis of the shell the rim is an ellipse. With z along the axis, y
along the common line of rim plane and cross section, and phi the angle on the rim from its largest
z,

    x = x0 + a cos phi,  y = y0 + r sin phi,  z = z0 + b cos phi,  a^2 + b^2 = r^2

and the distance from the wall (of slope m, inside positive) is smallest where rho - m z is largest,
rho^2 = x^2 + y^2. With y0 >= 0 that is where sin phi >= 0. There d(rho - m z)/dphi = J / rho,

    J = sin phi (b^2 cos phi - a x0 + m b rho) + r y0 cos phi

and at every root of J the slope of J / sin phi is negative: -(1 + m^2) b^2 sin phi - r y0 / sin^2
phi. So rho - m z rises, then falls, with one maximum for every tilt and offset of the rim, and the
nearest point of an arc is that maximum or the end next to it.
"""

import math

from sepmc.jit import long_formula, noinline, routine
from sepmc.physics.elementary import arctan2, sine_cosine
from sepmc.physics.outlines import THROUGH, any_normal
from sepmc.physics.vec3 import add, cross, dot, scale, split, sub

_ROUNDS = 80  # Newton steps or halvings: 4 on average, 55 for a maximum at an end of the arc
_CLOSE = 1e-8  # rad: the square of a smaller Newton step is below round-off
_PIECES = 32  # of an arc, for the search by points
_GOLDEN = 0.5 * (3.0 - math.sqrt(5.0))
_NARROWINGS = 75  # 10 are typical
_SHARP = 1e-10  # rad: its square is the error of a smooth minimum


@long_formula
def rim_gap(rim, shell, margin):
    """Smallest signed distance of the points of a rim from a shell, and the nearest points.

    The signed distance of a point is that of `outlines.inside_gap`. Checked against minimisation
    over the rim in steps of 0.01 deg.

    Parameters
    ----------
    rim : tuple
        (centre, normal, radius).
    shell : tuple
        (start, axis, length, r0, r1), length > 0.
    margin : float
        0 for the distance itself. A value above 0, m, for a bound: if all points of the rim move by
        at most ``margin``, none comes nearer than the result minus ``margin``. Then the wall is
        extended by ``margin`` beyond both ends; and so is, further out, the range outside the wall
        in which points count as passed.

    Returns
    -------
    distance : float
        m; infinite if no point of the rim lies between the ends, or ``length`` or ``margin`` is
        NaN; NaN if another number is NaN.
    on_rim, on_wall : tuple of 3 float
        Nearest points of the rim and of the wall, m; without meaning if the distance is not finite.
    """
    noinline()
    centre, normal, radius = rim
    start, axis, length, r0, r1 = shell
    e, v, sine, cosine = axes(normal, axis)
    from_start = sub(centre, start)
    x0, y0, z0 = dot(from_start, e), dot(from_start, v), dot(from_start, axis)
    if y0 < 0.0:
        y0, v = -y0, scale(-1.0, v)
    ellipse = x0, y0, z0, radius * cosine, radius, radius * sine
    wall = r0, (r1 - r0) / length, length, margin
    low, high = _arc(z0, radius * sine, length, margin)
    if not low <= high:
        undefined = math.isnan(z0 + radius * sine)
        return (math.nan if undefined else math.inf), centre, centre
    angle, side = _summit(ellipse, wall[1], low, high), 1.0
    distance, foot, excess, unique = _signed(angle, side, ellipse, wall)
    if not (unique and excess <= 0.0) and radius > 0.0:
        angle, side = _search(ellipse, wall, low, high, angle)
        distance, foot, _, _ = _signed(angle, side, ellipse, wall)
    x, y, z, rho = rim_point(angle, side, ellipse)
    at_wall = (r0 + wall[1] * foot) / rho if rho > 0.0 else 0.0
    on_rim = add(start, add(add(scale(x, e), scale(y, v)), scale(z, axis)))
    if rho > 0.0:
        on_wall = add(
            start, add(add(scale(x * at_wall, e), scale(y * at_wall, v)), scale(foot, axis))
        )
    else:
        on_wall = add(start, add(scale(r0 + wall[1] * foot, e), scale(foot, axis)))
    return distance, on_rim, on_wall


@routine
def axes(normal, axis):
    """Axes for the view of a rim along the axis of a shell (or of a part).

    Returns (e, v, sine, cosine): the unit vectors e (x) and v (y), perpendicular to the axis and to
    each other, v in the plane of the rim (any such pair if the rim is perpendicular to the axis);
    and the sine and cosine of the angle between the normal of the rim and the axis.
    """
    v = cross(normal, axis)
    sine, cosine = math.sqrt(dot(v, v)), dot(normal, axis)
    if sine > 1e-14:
        _, v = split(scale(1.0 / sine, v), axis)
        v = scale(1.0 / math.sqrt(dot(v, v)), v)
    else:
        v = any_normal(axis)
    return cross(v, axis), v, sine, cosine


@routine
def _arc(z0, b, length, margin):
    """Range (low, high) of angles, rad, from 0 to pi, in which a rim with z = z0 + b cos(angle),
    b >= 0, lies between the ends of a shell: -margin <= z <= length + margin. low > high if there
    is none."""
    highest, lowest = length + margin - z0, -margin - z0
    if not (highest >= -b and lowest <= b):
        return 1.0, 0.0
    low, high = 0.0, math.pi
    if highest < b:
        low = arctan2(math.sqrt((b - highest) * (b + highest)), highest)
    if lowest > -b:
        high = arctan2(math.sqrt((b - lowest) * (b + lowest)), lowest)
    return low, high


@routine
def rim_point(angle, side, ellipse):
    """Point of a rim at an angle, rad: its coordinates and its distance rho from the axis of the
    shell, (x, y, z, rho), m, with z along the axis.

    ``ellipse`` is (x0, y0, z0, a, r, b) in x = x0 + a cos, y = y0 + side r sin, z = z0 + b cos.
    With ``side`` 1 or -1, angles from 0 to pi cover one half of the rim or the other.
    """
    x0, y0, z0, a, r, b = ellipse
    s, c = sine_cosine(angle)
    x, y = x0 + a * c, y0 + side * r * s
    return x, y, z0 + b * c, math.sqrt(x * x + y * y)


@routine
def _summit(ellipse, slope, low, high):
    """Angle between ``low`` and ``high``, rad, at which rho - slope z of `rim_point` (side 1) is
    largest: a root of its derivative, by Newton's method with a bracket, or an end. ``ellipse`` is
    (x0, y0, z0, a, r, b), as in `rim_point`."""
    x0, y0, _, a, r, b = ellipse
    mb = slope * b
    angle = arctan2(r * y0, a * x0 - mb * r)  # the root without the tilt of the rim
    angle = min(max(angle, low), high)
    for _ in range(_ROUNDS):
        s, c = sine_cosine(angle)
        x, y = x0 + a * c, y0 + r * s
        rho = math.sqrt(x * x + y * y)
        inner = b * b * c - a * x0 + mb * rho
        j = s * inner + r * y0 * c
        # at phi = 0, where sin phi and J are 0, the sign of J / sin phi is used
        direction = inner if j == 0.0 and s < 0.5 else j
        if direction > 0.0:
            low = angle
        elif direction < 0.0:
            high = angle
        else:
            break
        rise = mb * (r * y * c - a * x * s) / rho if rho > 0.0 else 0.0
        fall = s * (b * b * s - rise) + r * y0 * s - c * inner
        guess = angle + j / fall if fall > 0.0 else -1.0
        if low < guess < high:
            done = abs(guess - angle) <= _CLOSE
        else:
            guess = 0.5 * (low + high)
            done = not low < guess < high
        angle = guess
        if done:
            break
    return angle


@routine
def steepest(ellipse, slope):
    """Angle, rad, from 0 to pi, at which rho - slope z of `rim_point` (side 1) has its maximum on
    this half of a rim. If y0 < 0 in the ``ellipse``, it is a local maximum inside the half, or any
    angle if there is none.

    With y0 < 0, J / sin phi (J, phi, m in the docstring of this module) falls only where
    sin^3 phi > r |y0| / ((1 + m^2) b^2).
    """
    _, y0, _, _, r, b = ellipse
    if y0 >= 0.0:
        return _summit(ellipse, slope, 0.0, math.pi)
    bend = (1.0 + slope * slope) * b * b
    if not bend > -r * y0:
        return 0.0
    sine = (-r * y0 / bend) ** (1.0 / 3.0)
    low = arctan2(sine, math.sqrt(max(0.0, (1.0 - sine) * (1.0 + sine))))
    return _summit(ellipse, slope, low, math.pi - low)


@routine
def _signed(angle, side, ellipse, wall):
    """Signed distance (as in `outlines.inside_gap`) of a point of a rim from the wall of a shell.

    ``angle``, ``side``, ``ellipse`` as in `rim_point`; ``wall`` is (r0, slope, length, margin), the
    last as in `rim_gap`. Returns four values:

    - the distance, m: positive inside; negative outside while passed, by up to a tenth of the
      radius; positive again further out, beside the shell;
    - the coordinate along the axis of the nearest point of the wall, m;
    - the excess, m: how far the point is outside the range that counts as passed, so above 0 where
      the point is beside the shell;
    - True if no other point of the rim's arc can be nearer, given that this one has the largest rho
      - slope z and is not beside the shell.
    """
    _, _, z, rho = rim_point(angle, side, ellipse)
    r0, slope, length, margin = wall
    radius = r0 + slope * z
    out, factor = rho - radius, 1.0 + THROUGH
    excess = rho - factor * radius - margin * math.sqrt(1.0 + (factor * slope) ** 2)
    projection = (z + slope * (rho - r0)) / (1.0 + slope * slope)
    foot = min(max(projection, -margin), length + margin)
    distance = math.sqrt((z - foot) ** 2 + (rho - r0 - slope * foot) ** 2)
    if out > 0.0 and excess <= 0.0:
        # a point that moves further through the wall is beside it
        if margin > 0.0:
            limit = THROUGH * (radius + abs(slope) * margin)
            distance = min(
                distance, limit / math.sqrt(1.0 + slope * slope) if foot == projection else limit
            )
        distance = -distance
    return distance, foot, excess, slope == 0.0 or (out <= 0.0 and foot == projection)


@routine
def _search(ellipse, wall, low, high, summit):
    """Return the angle and the side (1 or -1, `rim_point`) of the point of a rim that is nearest to
    a wall, by a search of both sides between the angles ``low`` and ``high``. ``ellipse`` and
    ``wall`` as in `_signed`.

    It is used where this need not be the ``summit`` (the angle of the largest rho - slope z): an
    edge of the shell may be nearest, or some of the rim has passed the wall or is beside it (as in
    `outlines.inside_gap`). The distance is sampled at equal steps of the angle; local minima of the
    samples are refined, and so are the angles at which the rim changes between passed and beside.
    """
    noinline()
    piece = (high - low) / _PIECES
    move = piece * ellipse[4]  # of a point between two angles
    band = move * (1.0 + (1.0 + THROUGH) * abs(wall[1]))
    best, angle, side = _signed(summit, 1.0, ellipse, wall)[0], summit, 1.0
    for half in (1.0, -1.0):
        previous = at_border = math.inf
        current, _, excess, _ = _signed(low, half, ellipse, wall)
        for i in range(_PIECES + 1):
            theta, end = low + i * piece, min(high, low + (i + 1) * piece)
            following, next_excess, last_border = math.inf, excess, at_border
            if i < _PIECES:
                following, _, next_excess, _ = _signed(end, half, ellipse, wall)
            at_border = math.inf
            if (excess > 0.0) != (next_excess > 0.0):
                candidate = _border(ellipse, wall, half, theta, excess, end, next_excess)
                at_border = _signed(candidate, half, ellipse, wall)[0]
                if at_border < best:
                    best, angle, side = at_border, candidate, half
            # no refinement where a border is near and has the smallest value
            least = (
                current <= previous
                and current <= following
                and current < min(last_border, at_border)
            )
            if least and (current - move < best or 0.0 < excess < band):
                value, candidate = _narrow(
                    ellipse, wall, half, max(low, theta - piece), end, theta, current
                )
                if value < best:
                    best, angle, side = value, candidate, half
            previous, current, excess = current, following, next_excess
    return angle, side


@routine
def _border(ellipse, wall, side, a, excess_a, b, excess_b):
    """Angle at which a rim changes between beside the wall and not beside it, to round-off; the
    result is on the side where it is not.

    It lies between the angles ``a`` and ``b``, at one of which the rim is beside; ``excess_a`` and
    ``excess_b`` are the excesses of `_signed` there, which has the other arguments too. Illinois
    method.
    """
    if excess_a > 0.0:
        a, excess_a, b, excess_b = b, excess_b, a, excess_a
    last = 0
    for _ in range(_NARROWINGS):
        theta = a + (b - a) * (excess_a / (excess_a - excess_b))
        if theta in (a, b):
            theta = 0.5 * (a + b)
            if theta in (a, b):
                break
        excess = _signed(theta, side, ellipse, wall)[2]
        if excess > 0.0:
            b, excess_b = theta, excess
            excess_a = 0.5 * excess_a if last == 1 else excess_a
            last = 1
        else:
            a, excess_a = theta, excess
            excess_b = 0.5 * excess_b if last == -1 else excess_b
            last = -1
    return a


@routine
def _narrow(ellipse, wall, side, low, high, angle, best):
    """Return a minimum of the signed distance (`_signed`) between the angles ``low`` and ``high``,
    and its angle: Brent's method (parabolas, with golden section as a fallback), which starts at
    ``angle`` with the distance ``best``; other arguments as in `_signed`."""
    noinline()
    second, third, value2, value3 = angle, angle, best, best  # second and third best so far
    step = last = 0.0
    for _ in range(_NARROWINGS):
        middle = 0.5 * (low + high)
        if max(angle - low, high - angle) <= 2.0 * _SHARP:
            break
        r, q = (angle - second) * (best - value3), (angle - third) * (best - value2)
        p = (angle - third) * q - (angle - second) * r
        q = 2.0 * (q - r)
        p, q = (-p, q) if q > 0.0 else (p, -q)
        before_last, last = last, step
        if abs(p) < abs(0.5 * q * before_last) and q * (low - angle) < p < q * (high - angle):
            step = p / q  # to the minimum of the parabola
            if angle + step - low < 2.0 * _SHARP or high - angle - step < 2.0 * _SHARP:
                step = _SHARP if angle < middle else -_SHARP
        else:
            last = (high if angle < middle else low) - angle
            step = _GOLDEN * last
        if abs(step) < _SHARP:
            step = _SHARP if step > 0.0 else -_SHARP
        theta = angle + step
        value = _signed(theta, side, ellipse, wall)[0]
        if value <= best:
            if theta < angle:
                high = angle
            else:
                low = angle
            second, third, angle = angle, second, theta
            value2, value3, best = best, value2, value
        else:
            if theta < angle:
                low = theta
            else:
                high = theta
            if value <= value2 or second == angle:
                second, third, value2, value3 = theta, second, value, value2
            elif value <= value3 or third in (angle, second):
                third, value3 = theta, value
    return best, angle
