"""Smallest distance from the edge circle of a shell to a solid part, all in one frame and in
metres.

The circle is described as a rim (`rims.axes`): in a view along the axis of the part it is an
ellipse, and a point of it lies at (z, rho) in the half plane through that axis, in which the part
is a trapezoid. The distance f from a convex body is convex along lines, so around a circle its
second derivative has a lower bound (`_bend`): close to zero where both are nearly coaxial. Values
and slopes at two points then give a lower bound of f between them (Piyavskii's method): no minimum
deeper than 3e-7 of the radius is missed, and steps are long where f is far from its minimum.
"""

import math

from sepmc.jit import long_formula, noinline, routine
from sepmc.physics.elementary import arctan2, sine_cosine
from sepmc.physics.rims import axes, rim_point
from sepmc.physics.vec3 import add, cross, dot, scale, split, sub

_FEW = 8  # points of the circle; the descent starts at the lowest
_PIECE = 2.0 * math.pi / _FEW
_CLOSE = 1e-9  # rad: its square is the error of a minimum
_NARROWINGS = 60  # 6 are typical
# rad, smallest step of the search: no minimum between two points is deeper than 3e-7 of the bend
_FINEST = 2.0 * math.pi / 4000.0
_SAME = 1e-14  # of the radius: smaller differences are round-off
_GROWTH = 4.0  # of the steps away from the minimum
_FINEST_OF_ARC = 3e-5  # rad: the same for an arc, to 1e-10 of the bend
_UNIMODAL = 0.2  # rad: the minimum of a shorter interval is searched before it is halved
_DIPS = 16  # successive minima around the circle, each lower than the one before; 1 is typical


@long_formula
def edge_gap(edge, part):
    """Distance of the edge circle of a shell from a solid part, and the nearest points.

    Accurate to round-off, to 1e-9 of the radius in near contact, and to 3e-7 of it for two minima
    of nearly equal depth. Checked against a scan of the circle, and by hand.

    Parameters
    ----------
    edge : tuple
        Circle (centre, normal, radius).
    part : tuple
        (start, axis, length, r0, r1).

    Returns
    -------
    distance : float
        m; 0 if some of the circle is within the solid. NaN if a position, an axis or ``length`` is
        NaN, but infinite if only a radius is NaN.
    on_edge, on_part : tuple of 3 float
        Nearest points.
    """
    noinline()
    centre, normal, radius = edge
    start, axis, length, r0, r1 = part
    e, v, sine, cosine = axes(normal, axis)
    offset = sub(centre, start)
    x0, y0, z0 = dot(offset, e), dot(offset, v), dot(offset, axis)
    if math.isnan(x0 + y0 + z0 + sine + length):
        return math.nan, centre, centre
    ellipse, section = (x0, y0, z0, radius * cosine, radius, radius * sine), (length, r0, r1)
    best, angle = math.inf, 0.0
    for i in range(_FEW):
        f, _ = _distance(i * _PIECE, ellipse, section)
        if f < best:
            best, angle = f, i * _PIECE
    for _ in range(_DIPS):
        best, angle = _descend(angle, best, ellipse, section)
        if best == 0.0:
            break
        lower, theta = _sweep(1.0, angle, best, ellipse, section)
        if not lower < best:
            lower, theta = _sweep(-1.0, angle, best, ellipse, section)
        if not lower < best:
            break
        best, angle = lower, theta
    x, y, z, rho = rim_point(angle, 1.0, ellipse)
    axial, out = _nearest(z, rho, length, r0, r1)
    ratio = out / rho if rho > 0.0 else 0.0
    on_edge = add(start, add(add(scale(x, e), scale(y, v)), scale(z, axis)))
    on_part = add(start, add(add(scale(x * ratio, e), scale(y * ratio, v)), scale(axial, axis)))
    return best, on_edge, on_part


@long_formula
def arc_gap(arc, part, limit):
    """Distance of a circular arc from a solid part, and the nearest point of the arc, if the
    distance is below a limit.

    Checked against a scan of the arc.

    Parameters
    ----------
    arc : tuple
        (centre, x, y, radius, width): x is the unit vector from the centre to the first point of
        the arc, y the unit vector normal to x towards which the arc turns, width its angle, rad.
    part : tuple
        (start, axis, length, r0, r1).
    limit : float
        m.

    Returns
    -------
    distance : float
        m; 0 if some of the arc is within the part, ``limit`` if no point of the arc is nearer than
        that. NaN if a position, an axis, ``length`` or ``limit`` is NaN; a radius or ``width`` that
        is NaN is not noticed.
    angle : float
        Angle of the nearest point from the first point of the arc, rad; 0 if no point is nearer
        than ``limit``.
    """
    noinline()
    centre, x, y, radius, width = arc
    start, axis, length, r0, r1 = part
    e, v, sine, cosine = axes(cross(x, y), axis)
    offset = sub(centre, start)
    x0, y0, z0 = dot(offset, e), dot(offset, v), dot(offset, axis)
    if math.isnan(x0 + y0 + z0 + sine + length + limit):
        return math.nan, 0.0
    ellipse, section = (x0, y0, z0, radius * cosine, radius, radius * sine), (length, r0, r1)
    # the ellipse is g cos + v sin, of which x is at the angle ``begin``
    g = add(scale(cosine, e), scale(sine, axis))
    c, s = dot(x, g), dot(x, v)
    begin, sign = arctan2(s, c), 1.0 if c * dot(y, v) - s * dot(y, g) > 0.0 else -1.0
    f, slope = _distance(begin, ellipse, section)
    best, at, slope = limit, 0.0, sign * slope
    best = min(best, f)
    covered, searched, step = 0.0, 0.0, width / _FEW
    while covered < width and best > 0.0:
        step = min(step, width - covered)
        theta = begin + sign * (covered + step)
        f_next, slope_next = _distance(theta, ellipse, section)
        slope_next = sign * slope_next
        if f_next < best:
            best, at = f_next, covered + step
        bend = _bend(ellipse, section, best)
        lowest = best - max(_SAME * radius, 0.125 * bend * _FINEST_OF_ARC * _FINEST_OF_ARC)
        bound = _least(f, slope, f_next, slope_next, bend, step)
        if (
            bound < lowest
            and slope < 0.0 < slope_next
            and step <= _UNIMODAL
            and covered >= searched
        ):
            value, minimum = _narrow(
                theta - sign * step, f, slope, theta, slope_next, ellipse, section
            )
            searched = covered + step
            if value < best:
                lowest += value - best
                best, at = value, sign * (minimum - begin)
        if bound < lowest and step > _FINEST_OF_ARC:
            step = max(0.5 * step, _FINEST_OF_ARC)
            continue
        covered += step
        f, slope = f_next, slope_next
        step *= _GROWTH
    return best, at


@long_formula
def edge_gap_bound(edge, part):
    """Lower bound of the distance of a circle, ``edge`` (centre, normal, radius), from a solid part
    (start, axis, length, r0, r1), m; it may be negative. Far cheaper than `edge_gap`."""
    centre, normal, radius = edge
    start, axis, length, r0, r1 = part
    along, across = split(sub(centre, start), axis)
    lateral, tilt = math.sqrt(dot(across, across)), cross(normal, axis)
    # In a view along the axis the circle is an ellipse with this short half-axis. No point of it is
    # nearer to the axis than `rho`, nor further along it from the centre than `deep`, and a point
    # nearer to the axis is not further from the part.
    half, deep = radius * abs(dot(normal, axis)), radius * math.sqrt(dot(tilt, tilt))
    rho = max(half - lateral, lateral - radius, 0.0)
    z, near = _nearest(along, rho, length, r0, r1)
    smallest = math.sqrt((along - z) ** 2 + (rho - near) ** 2)
    return smallest - deep - 1e-12 * (abs(along) + lateral + radius + length)


@routine
def _distance(angle, ellipse, section):
    """Return the distance of the point of a circle at an ``angle``, rad, from a solid part, m, and
    the derivative of the distance by the angle, m/rad; both are 0 where the point is within the
    part.

    ``ellipse`` describes the circle, as in `rims.rim_point` (with ``side`` 1); ``section`` is
    (length, r0, r1) of the part, whose axis is z from 0 to the length.
    """
    x0, y0, z0, a, r, b = ellipse
    s, c = sine_cosine(angle)
    x, y, z = x0 + a * c, y0 + r * s, z0 + b * c
    rho = math.sqrt(x * x + y * y)
    axial, radius = _nearest(z, rho, section[0], section[1], section[2])
    dz, dr = z - axial, rho - radius
    f = math.sqrt(dz * dz + dr * dr)
    if f == 0.0:
        return 0.0, 0.0
    # derivatives by the angle: x' = -a sin, y' = r cos, z' = -b sin
    turn = (y * r * c - x * a * s) / rho if rho > 0.0 else 0.0
    return f, (dr * turn - dz * b * s) / f


@routine
def _nearest(along, rho, length, r0, r1):
    """Return the point of a solid part nearest to the point (along, rho); both are coordinates
    along the axis of the part and across it, m. In the half plane through its axis the part is a
    trapezoid of the given length, with the radii ``r0`` at its start and ``r1`` at its end, m; a
    point inside of it is returned as it is."""
    rise = r1 - r0
    if 0.0 <= along <= length and (rho - r0) * length <= rise * along and rho <= max(r0, r1):
        return along, rho
    square = length * length + rise * rise
    fraction = (along * length + (rho - r0) * rise) / square if square > 0.0 else 0.0
    fraction = min(max(fraction, 0.0), 1.0)
    z, radius = fraction * length, r0 + fraction * rise
    best = (along - z) ** 2 + (rho - radius) ** 2
    if along < 0.0 and along**2 + max(rho - r0, 0.0) ** 2 < best:
        z, radius = 0.0, min(rho, r0)
    elif along > length and (along - length) ** 2 + max(rho - r1, 0.0) ** 2 < best:
        z, radius = length, min(rho, r1)
    return z, radius


@routine
def _bend(ellipse, section, distance):
    """Return D, m/rad2, such that the second derivative of the distance f by the angle is f'' >= -D
    wherever f is at least half of ``distance``.

    ``ellipse`` and ``section`` as in `_distance`.

    f'' >= -r, and f'' >= -(b + g E): b bounds the second derivative of z, g the fraction of f along
    rho, and rho'' >= -E. rho^2 = (x0 + a cos)^2 + (y0 + r sin)^2, so with r^2 - a^2 = b^2 its slope
    is at most 2 |(a x0, r y0)| + b^2, its second derivative at most 2 |(a x0, r y0)| + 2 b^2, and
    rho'' = (rho^2)'' / (2 rho) - (rho^2)'^2 / (4 rho^3).
    """
    x0, y0, z0, a, r, b = ellipse
    length, r0, r1 = section
    lateral = math.sqrt(x0 * x0 + y0 * y0)
    rho_min, bend = max(abs(a) - lateral, lateral - r), r
    if rho_min > 0.0:
        slope0 = 2.0 * math.sqrt((a * x0) ** 2 + (r * y0) ** 2)
        slope, slope_rate = slope0 + b * b, slope0 + 2.0 * b * b
        bend = min(r, slope_rate / (2.0 * rho_min) + slope * slope / (4.0 * rho_min**3))
    # beyond an end, points over its face have a distance that does not depend on rho
    beside = r + lateral
    if z0 + abs(b) <= 0.0:
        beside = max(0.0, beside - r0)
    elif z0 - abs(b) >= length:
        beside = max(0.0, beside - r1)
    fraction = 2.0 * beside / distance if distance > 2.0 * beside else 1.0
    return min(r, abs(b) + fraction * bend)


@routine
def _descend(angle, distance, ellipse, section):
    """Descend along the circle from the point at ``angle``, whose distance from the part is
    ``distance``, to a local minimum. Returns the distance there and its angle. ``ellipse`` and
    ``section`` as in `_distance`."""
    noinline()
    low, f_low, fall = angle, distance, _distance(angle, ellipse, section)[1]
    if fall == 0.0:
        return distance, angle
    sign = 1.0 if fall < 0.0 else -1.0
    fall, high, rise = -abs(fall), low, 0.0
    for _ in range(_FEW):
        high = low + sign * _PIECE
        f, slope = _distance(high, ellipse, section)
        rise = sign * slope
        if not (f < f_low and rise < 0.0):
            break
        low, f_low, fall = high, f, rise
    return _narrow(low, f_low, fall, high, rise, ellipse, section)


@routine
def _narrow(low, f_low, fall, high, rise, ellipse, section):
    """Return a minimum of the distance between the angles ``low`` and ``high``, and its angle: a
    root of the slope. ``ellipse`` and ``section`` as in `_distance`.

    ``high`` may be on either side of ``low``; slopes count from low to high. At low the distance is
    ``f_low`` and its slope ``fall`` < 0; at high the slope is ``rise``, or the distance is no
    smaller than at low.
    """
    noinline()
    best, angle, last = f_low, low, 0
    sign = 1.0 if high > low else -1.0
    for _ in range(_NARROWINGS):
        width = abs(high - low)
        if width <= 2.0 * _CLOSE:
            break
        # the root of the chord of the slopes (Illinois), or the middle
        fraction = fall / (fall - rise) if rise > 0.0 else 0.5
        theta = low + sign * min(max(fraction * width, _CLOSE), width - _CLOSE)
        f, slope = _distance(theta, ellipse, section)
        slope = sign * slope
        if f < best:
            best, angle = f, theta
        if slope < 0.0 and f <= f_low:
            low, f_low, fall = theta, f, slope
            rise = 0.5 * rise if last == 1 else rise
            last = 1
        else:
            high, rise = theta, slope
            fall = 0.5 * fall if last == -1 else fall
            last = -1
    return best, angle


@routine
def _sweep(sign, angle, best, ellipse, section):
    """Search half of a circle for a smaller distance than ``best``, its distance at ``angle``. The
    half begins at ``angle`` and goes in the direction ``sign`` (1 or -1). Returns the first smaller
    distance and its angle; ``best`` and ``angle`` if there is none. ``ellipse`` and ``section`` as
    in `_distance`."""
    noinline()
    radius, bend = ellipse[4], _bend(ellipse, section, best)
    lowest, tolerance = best - _SAME * radius, best - 0.125 * bend * _FINEST * _FINEST
    f, slope = best, sign * _distance(angle, ellipse, section)[1]
    covered, step = 0.0, _FINEST
    while covered < math.pi:
        step = min(step, math.pi - covered)
        theta = angle + sign * (covered + step)
        f_next, slope_next = _distance(theta, ellipse, section)
        slope_next = sign * slope_next
        if f_next < lowest:
            return f_next, theta
        if _least(f, slope, f_next, slope_next, bend, step) < tolerance:
            if step > _FINEST:
                step = max(0.5 * step, _FINEST)
                continue
            if slope < 0.0 < slope_next:
                value, minimum = _narrow(
                    theta - sign * step, f, slope, theta, slope_next, ellipse, section
                )
                if value < lowest:
                    return value, minimum
        covered += step
        f, slope = f_next, slope_next
        step *= _GROWTH
    return best, angle


@routine
def _least(f0, slope0, f1, slope1, bend, step):
    """Lower bound of a function in an interval of length ``step``, given its values and slopes at
    the start (``f0``, ``slope0``) and at the end (``f1``, ``slope1``), if its second derivative is
    at least -bend. Two parabolas with this second derivative, tangent to the function at either
    end, bound it from below; the bound is their value where they intersect, or at an end."""
    denominator = slope0 - slope1 - bend * step
    if not denominator < 0.0:
        return min(f0, f1)
    crossing = (f1 - f0 - slope1 * step - 0.5 * bend * step * step) / denominator
    crossing = min(max(crossing, 0.0), step)
    return min(f0, f1, f0 + slope0 * crossing - 0.5 * bend * crossing * crossing)
