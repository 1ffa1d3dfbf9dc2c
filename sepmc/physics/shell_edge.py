"""The least distance from the lip of a shell, a circle, to a solid part, all in one frame and in
metres.

The circle is told as rims are (`rims.axes`): seen along the axis of the part it is an ellipse, and
a point of it lies (z, rho) in the half plane through that axis, where the part is a trapezoid. A
distance f from a convex body is convex along lines, so around a circle its second derivative is
nowhere less than so much (`_bend`): next to nothing where both are all but on one axis. What f is
nowhere less than between two points then follows from its values and slopes there (Piyavskii's
method): no dip deeper than 3e-7 of the radius is missed, and steps are long where f is far from its
least.
"""

import math

from sepmc.jit import long_formula, noinline, routine
from sepmc.physics.elementary import sine_cosine
from sepmc.physics.rims import axes, place
from sepmc.physics.vec3 import add, cross, dot, scale, split, sub

_FEW = 8  # points of the circle, from the lowest of which the way goes down
_PIECE = 2.0 * math.pi / _FEW
_CLOSE = 1e-9  # rad, of which the square counts
_NARROWINGS = 60  # 6 are usual
# rad, between points that are looked at in the end: between them a dip goes no deeper below the
# least than 3e-7 of the bend
_FINEST = 2.0 * math.pi / 4000.0
_SAME = 1e-14  # of the radius: what is lower by less is as low
_GROWTH = 4.0  # of steps away from the least
_DIPS = 16  # of the distance around the circle, each lower than the one before; 1 is usual


@long_formula
def edge_gap(lip, part):
    """Distance of a circle from a solid part, and the nearest points of circle and part.

    lip : (centre, normal, radius); part : (start, axis, length, r0, r1)
    0 where some of the circle is within the solid. Good to round-off, to 1e-9 of the radius where
    they all but touch, and to 3e-7 of it where two dips are all but as deep as each other. Checked
    against a scan of the circle, and by hand.
    """
    noinline()
    centre, normal, radius = lip
    start, axis, length, r0, r1 = part
    e, v, sine, cosine = axes(normal, axis)
    apart = sub(centre, start)
    x0, y0, z0 = dot(apart, e), dot(apart, v), dot(apart, axis)
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
        lower, at = _sweep(1.0, angle, best, ellipse, section)
        if not lower < best:
            lower, at = _sweep(-1.0, angle, best, ellipse, section)
        if not lower < best:
            break
        best, angle = lower, at
    x, y, z, rho = place(angle, 1.0, ellipse)
    along, out = _nearest(z, rho, length, r0, r1)
    share = out / rho if rho > 0.0 else 0.0
    on_lip = add(start, add(add(scale(x, e), scale(y, v)), scale(z, axis)))
    on_part = add(start, add(add(scale(x * share, e), scale(y * share, v)), scale(along, axis)))
    return best, on_lip, on_part


@long_formula
def edge_gap_bound(lip, part):
    """A distance that a circle and a solid part cannot be nearer than, m, found cheaply."""
    centre, normal, radius = lip
    start, axis, length, r0, r1 = part
    along, across = split(sub(centre, start), axis)
    aside, tilt = math.sqrt(dot(across, across)), cross(normal, axis)
    # seen along the axis the circle is an ellipse, of which this is the short half: no point of it
    # is nearer to the axis than `rho`, nor further along it from the centre than `deep`. What is
    # nearer to the axis is no further from the part.
    half, deep = radius * abs(dot(normal, axis)), radius * math.sqrt(dot(tilt, tilt))
    rho = max(half - aside, aside - radius, 0.0)
    z, near = _nearest(along, rho, length, r0, r1)
    least = math.sqrt((along - z) ** 2 + (rho - near) ** 2)
    return least - deep - 1e-12 * (abs(along) + aside + radius + length)


@routine
def _distance(angle, ellipse, section):
    """Distance of a point of the circle from the part, m, and its slope, m/rad."""
    x0, y0, z0, a, r, b = ellipse
    s, c = sine_cosine(angle)
    x, y, z = x0 + a * c, y0 + r * s, z0 + b * c
    rho = math.sqrt(x * x + y * y)
    along, radius = _nearest(z, rho, section[0], section[1], section[2])
    dz, dr = z - along, rho - radius
    f = math.sqrt(dz * dz + dr * dr)
    if f == 0.0:
        return 0.0, 0.0
    # by the angle: x' = -a sin, y' = r cos, z' = -b sin
    turn = (y * r * c - x * a * s) / rho if rho > 0.0 else 0.0
    return f, (dr * turn - dz * b * s) / f


@routine
def _nearest(along, rho, length, r0, r1):
    """Nearest point (along, rho) of the trapezoid that a part is in the half plane through its
    axis."""
    rise = r1 - r0
    if 0.0 <= along <= length and (rho - r0) * length <= rise * along and rho <= max(r0, r1):
        return along, rho
    square = length * length + rise * rise
    share = (along * length + (rho - r0) * rise) / square if square > 0.0 else 0.0
    share = min(max(share, 0.0), 1.0)
    z, radius = share * length, r0 + share * rise
    best = (along - z) ** 2 + (rho - radius) ** 2
    if along < 0.0 and along**2 + max(rho - r0, 0.0) ** 2 < best:
        z, radius = 0.0, min(rho, r0)
    elif along > length and (along - length) ** 2 + max(rho - r1, 0.0) ** 2 < best:
        z, radius = length, min(rho, r1)
    return z, radius


@routine
def _bend(ellipse, section, distance):
    """By how much, at most, the slope of the distance falls in a radian, m, while it is at least
    half of a ``distance``.

    f'' >= -r, and f'' >= -(b + g D): b tells how z bends, g how much of f is along rho, rho'' >=
    -D. rho^2 = (x0 + a cos)^2 + (y0 + r sin)^2, so with r^2 - a^2 = b^2 its slope is at most
    2 |(a x0, r y0)| + b^2, what that changes by at most 2 |(a x0, r y0)| + 2 b^2, and
    rho'' = (rho^2)'' / (2 rho) - (rho^2)'^2 / (4 rho^3).
    """
    x0, y0, z0, a, r, b = ellipse
    length, r0, r1 = section
    aside = math.sqrt(x0 * x0 + y0 * y0)
    least, bend = max(abs(a) - aside, aside - r), r
    if least > 0.0:
        lean = 2.0 * math.sqrt((a * x0) ** 2 + (r * y0) ** 2)
        slope, change = lean + b * b, lean + 2.0 * b * b
        bend = min(r, change / (2.0 * least) + slope * slope / (4.0 * least**3))
    # beyond an end, what is over its face is at one distance from it
    beside = r + aside
    if z0 + abs(b) <= 0.0:
        beside = max(0.0, beside - r0)
    elif z0 - abs(b) >= length:
        beside = max(0.0, beside - r1)
    share = 2.0 * beside / distance if distance > 2.0 * beside else 1.0
    return min(r, abs(b) + share * bend)


@routine
def _descend(angle, distance, ellipse, section):
    """From a point of the circle at so much ``distance`` down to a least one: that and its
    angle."""
    noinline()
    low, f_low, fall = angle, distance, _distance(angle, ellipse, section)[1]
    if fall == 0.0:
        return distance, angle
    way = 1.0 if fall < 0.0 else -1.0
    fall, high, rise = -abs(fall), low, 0.0
    for _ in range(_FEW):
        high = low + way * _PIECE
        f, slope = _distance(high, ellipse, section)
        rise = way * slope
        if not (f < f_low and rise < 0.0):
            break
        low, f_low, fall = high, f, rise
    return _narrow(low, f_low, fall, high, rise, ellipse, section)


@routine
def _narrow(low, f_low, fall, high, rise, ellipse, section):
    """The least distance between two angles and where it is, by the root of its slope: toward
    ``high`` it falls at ``low``, where it is ``f_low``; at ``high`` it rises or is no less."""
    noinline()
    best, angle, last = f_low, low, 0
    way = 1.0 if high > low else -1.0
    for _ in range(_NARROWINGS):
        wide = abs(high - low)
        if wide <= 2.0 * _CLOSE:
            break
        # the root of the chord of the slopes (Illinois), or the middle
        share = fall / (fall - rise) if rise > 0.0 else 0.5
        at = low + way * min(max(share * wide, _CLOSE), wide - _CLOSE)
        f, slope = _distance(at, ellipse, section)
        slope = way * slope
        if f < best:
            best, angle = f, at
        if slope < 0.0 and f <= f_low:
            low, f_low, fall = at, f, slope
            rise = 0.5 * rise if last == 1 else rise
            last = 1
        else:
            high, rise = at, slope
            fall = 0.5 * fall if last == -1 else fall
            last = -1
    return best, angle


@routine
def _sweep(way, angle, best, ellipse, section):
    """Half of the circle from its least distance on: a lower one, if there is any, and its
    angle."""
    noinline()
    radius, bend = ellipse[4], _bend(ellipse, section, best)
    lowest, unseen = best - _SAME * radius, best - 0.125 * bend * _FINEST * _FINEST
    f, slope = best, way * _distance(angle, ellipse, section)[1]
    gone, step = 0.0, _FINEST
    while gone < math.pi:
        step = min(step, math.pi - gone)
        at = angle + way * (gone + step)
        f_next, slope_next = _distance(at, ellipse, section)
        slope_next = way * slope_next
        if f_next < lowest:
            return f_next, at
        if _least(f, slope, f_next, slope_next, bend, step) < unseen:
            if step > _FINEST:
                step = max(0.5 * step, _FINEST)
                continue
            if slope < 0.0 < slope_next:
                lower, place = _narrow(at - way * step, f, slope, at, slope_next, ellipse, section)
                if lower < lowest:
                    return lower, place
        gone += step
        f, slope = f_next, slope_next
        step *= _GROWTH
    return best, angle


@routine
def _least(f0, slope0, f1, slope1, bend, step):
    """What the distance is nowhere less than between two points: where the parabolas meet that fall
    from its tangents there."""
    turn = slope0 - slope1 - bend * step
    if not turn < 0.0:
        return min(f0, f1)
    at = (f1 - f0 - slope1 * step - 0.5 * bend * step * step) / turn
    at = min(max(at, 0.0), step)
    return min(f0, f1, f0 + slope0 * at - 0.5 * bend * at * at)
