"""The least distance from the lip of a shell, a circle, to a solid part, all in one frame and in
metres.

Around the circle the distance to a convex body falls and rises a few times at most: once where the
solid stands within the shell or beside it, twice where it lies across. It is looked at in steps of
5 deg, and every least is narrowed down.
"""

import math

from sepmc.jit import keep_apart, long_formula, routine
from sepmc.physics.elementary import sine_cosine
from sepmc.physics.outlines import any_normal, split
from sepmc.physics.vec3 import add, cross, dot, scale, sub

_PIECES = 72  # of the circle
# of the radius: where neighbours differ by less (solid and shell on one axis), nothing between them
# is nearer
_FLAT = 1e-13
_GOLDEN = 0.5 * (math.sqrt(5.0) - 1.0)
_NARROWINGS = 45  # of golden section: to 1e-10 rad, of which the square counts


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
    before, here = _distance(-piece, lip, frame, part), _distance(0.0, lip, frame, part)
    for i in range(_PIECES):
        at = i * piece
        after = _distance(at + piece, lip, frame, part)
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
    centre, _, radius = lip
    s, c = sine_cosine(angle)
    return add(centre, add(scale(radius * c, frame[0]), scale(radius * s, frame[1])))


@routine
def _distance(angle, lip, frame, part):
    """Distance of a point of the circle from the part: in the half plane through its axis, from the
    trapezoid it is there."""
    start, axis, length, r0, r1 = part
    along, across = split(sub(_point(angle, lip, frame), start), axis)
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
    """The least distance between two angles, by golden section, and its angle; starts from one that
    is known."""
    keep_apart()
    a, b = high - _GOLDEN * (high - low), low + _GOLDEN * (high - low)
    fa, fb = _distance(a, lip, frame, part), _distance(b, lip, frame, part)
    for _ in range(_NARROWINGS):
        if fa < best:
            best, angle = fa, a
        if fb < best:
            best, angle = fb, b
        if best == 0.0:
            break
        if fa <= fb:
            high, b, fb = b, a, fa
            a = high - _GOLDEN * (high - low)
            fa = _distance(a, lip, frame, part)
        else:
            low, a, fa = a, b, fb
            b = low + _GOLDEN * (high - low)
            fb = _distance(b, lip, frame, part)
    return best, angle
