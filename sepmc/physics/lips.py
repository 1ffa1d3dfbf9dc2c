"""The least distance from the lip of a shell, a circle, to a solid part, all in one frame and in
metres.

Around the circle the distance to a convex body falls and rises a few times at most: once where the
solid stands within the shell or beside it, twice where it lies across. It is looked at in steps of
5 deg, and every least is narrowed down (Brent, Algorithms for Minimization without Derivatives,
1973, ch. 5: parabolas, and golden section where these do not serve).
"""

import math

from sepmc.jit import formula, keep_apart, long_formula, routine
from sepmc.physics.elementary import sine_cosine
from sepmc.physics.outlines import any_normal
from sepmc.physics.vec3 import add, cross, dot, scale, split, sub

_PIECES = 72  # of the circle
# of the radius: where neighbours differ by less (solid and shell on one axis), nothing between them
# is nearer
_FLAT = 1e-13
_COSINE, _SINE = math.cos(2.0 * math.pi / _PIECES), math.sin(2.0 * math.pi / _PIECES)
_GOLDEN = 0.5 * (3.0 - math.sqrt(5.0))
_CLOSE = 1e-9  # rad, of which the square counts
_NARROWINGS = 60  # 9 are usual


@long_formula
def lip_gap(lip, part):
    """Distance of a circle from a solid part, and the nearest points of circle and part.

    lip : (centre, normal, radius); part : (start, axis, length, r0, r1)
    0 where some of the circle is within the solid. Checked against a scan of the circle, and by
    hand.
    """
    keep_apart()
    centre, normal, radius = lip
    u = any_normal(normal)
    frame = u, cross(normal, u)
    size = dot(centre, centre) + dot(part[0], part[0]) + part[2]
    if math.isnan(size):
        return math.nan, centre, centre
    piece = 2.0 * math.pi / _PIECES
    best, angle = math.inf, 0.0
    before = _distance(_turned(_COSINE, -_SINE, lip, frame), part)
    here = _distance(_turned(1.0, 0.0, lip, frame), part)
    c, s = _COSINE, _SINE
    for i in range(_PIECES):
        at = i * piece
        after = _distance(_turned(c, s, lip, frame), part)
        c, s = c * _COSINE - s * _SINE, s * _COSINE + c * _SINE
        if here <= before and here <= after and here - 0.5 * radius * piece < best:
            found, place = here, at
            if max(before, after) > here + _FLAT * radius:
                found, place = _narrow(at - piece, at + piece, at, here, lip, frame, part)
            if found < best:
                best, angle = found, place
        before, here = here, after
    on_lip = _point(angle, lip, frame)
    return best, on_lip, _foot(on_lip, part)


@long_formula
def lip_least(lip, part):
    """A distance that a circle and a solid part cannot be nearer than, m, found cheaply."""
    centre, normal, radius = lip
    start, axis, length, r0, r1 = part
    widest = max(r0, r1)
    along, across = split(sub(centre, start), axis)
    aside = math.sqrt(dot(across, across))
    beyond = max(-along, along - length, 0.0)
    far = math.sqrt(beyond * beyond + aside * aside) - radius
    # seen along the axis the circle is an ellipse; this is its short half
    around = radius * abs(dot(normal, axis)) - aside
    return max(far, around) - widest - 1e-12 * (abs(along) + aside + radius)


@routine
def _point(angle, lip, frame):
    """Point of the circle at an angle."""
    s, c = sine_cosine(angle)
    return _turned(c, s, lip, frame)


@formula
def _turned(c, s, lip, frame):
    """The same by cosine and sine of the angle."""
    centre, _, radius = lip
    return add(centre, add(scale(radius * c, frame[0]), scale(radius * s, frame[1])))


@routine
def _distance(point, part):
    """Distance of a point from the part: in the half plane through its axis, from the trapezoid it
    is there."""
    start, axis, length, r0, r1 = part
    along, across = split(sub(point, start), axis)
    rho = math.sqrt(dot(across, across))
    z, radius = _nearest(along, rho, length, r0, r1)
    return math.sqrt((along - z) ** 2 + (rho - radius) ** 2)


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
def _foot(point, part):
    """Nearest point of a part to a point that is not within; the point itself if it is."""
    start, axis, length, r0, r1 = part
    along, across = split(sub(point, start), axis)
    rho = math.sqrt(dot(across, across))
    z, radius = _nearest(along, rho, length, r0, r1)
    outward = scale(radius / rho, across) if rho > 0.0 else (0.0, 0.0, 0.0)
    return add(start, add(scale(z, axis), outward))


@routine
def _narrow(low, high, angle, best, lip, frame, part):
    """The least distance between two angles, and its angle; starts from one that is known."""
    keep_apart()
    second, third, value2, value3 = angle, angle, best, best  # the best so far but for ``angle``
    step = last = 0.0
    for _ in range(_NARROWINGS):
        middle = 0.5 * (low + high)
        if best == 0.0 or max(angle - low, high - angle) <= 2.0 * _CLOSE:
            break
        r, q = (angle - second) * (best - value3), (angle - third) * (best - value2)
        p = (angle - third) * q - (angle - second) * r
        q = 2.0 * (q - r)
        p, q = (-p, q) if q > 0.0 else (p, -q)
        before, last = last, step
        if abs(p) < abs(0.5 * q * before) and q * (low - angle) < p < q * (high - angle):
            step = p / q  # to the least of the parabola
            if angle + step - low < 2.0 * _CLOSE or high - angle - step < 2.0 * _CLOSE:
                step = _CLOSE if angle < middle else -_CLOSE
        else:
            last = (high if angle < middle else low) - angle
            step = _GOLDEN * last
        if abs(step) < _CLOSE:
            step = _CLOSE if step > 0.0 else -_CLOSE
        at = angle + step
        value = _distance(_point(at, lip, frame), part)
        if value <= best:
            if at < angle:
                high = angle
            else:
                low = angle
            second, third, angle = angle, second, at
            value2, value3, best = best, value2, value
        else:
            if at < angle:
                low = at
            else:
                high = at
            if value <= value2 or second == angle:
                second, third, value2, value3 = at, second, value, value2
            elif value <= value3 or third in (angle, second):
                third, value3 = at, value
    return best, angle
