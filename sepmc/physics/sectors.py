"""Distance of a sector of a shell from a solid part, all in one frame and in metres.

A sector is the lateral surface of a cone frustum between two angles about its axis, without end
faces: a thin wall with two sides, such as half of a fairing. It is the tuple (start, axis, length,
r0, r1, x, y, width): a part (`outlines`); the unit vector x from the axis towards its first
straight edge; the unit vector y at right angles to x, in the direction in which the angle grows;
and the angle from the first edge to the second, at most 2 pi.

The nearest points p of the sector and q of a solid that does not touch it are of one of four kinds:

1. p is on a straight edge: the distance of a line from a convex body (`outlines.gap`);
2. p is on the arc of an end: `shell_edge.arc_gap`;
3. p is within the face and q on its outer side: the plane through p separates the solid from the
   whole frustum, so p and q are the nearest points of the solid and the frustum;
4. p is within the face and q on its inner side: q is furthest of the solid in the direction of the
   normal, thus on a rim, where its height over the wall rho - m z is largest. `rims` proves that
   this has one maximum on the half of a rim further from the axis. On the other half its slope
   falls between two known angles only, so that it has at most one more.

Each kind gives a point of the solid; its distance from the sector has a closed form, and the least
is the result. Where none of them is zero, the solid may still reach through the face, between the
edges. The distance of the straight lines of the face changes by at most r per rad, and none is
nearer than the result unless the face is met: few lines prove that (`_is_met`).
"""

import math

from sepmc.jit import long_formula, noinline, routine
from sepmc.physics.elementary import arctan2, sine_cosine
from sepmc.physics.outlines import gap, gap_bound, wall_gap
from sepmc.physics.rims import axes, rim_point, steepest
from sepmc.physics.shell_edge import arc_gap
from sepmc.physics.vec3 import add, dot, scale, split, sub

_ROUND_OFF = 1e-13  # of the coordinates: parts that are as near touch
_LINES = 4000  # of a face, at most, that are compared with the solid
_SHARE = 0.5  # of the result: a line that is about as near proves that the face is met


@long_formula
def sector_gap(sector, part):
    """Distance of a sector from a solid part, and their nearest points.

    Checked against fine scans of the sector in `tests/physics/test_sectors.py`.

    Parameters
    ----------
    sector : tuple
        (start, axis, length, r0, r1, x, y, width), length > 0: the side of a cone frustum as of a
        part, from the angle 0 at the unit vector x to ``width``, rad, towards the unit vector y.
    part : tuple
        (start, axis, length, r0, r1): centre of one end, m, unit vector to the other end, length,
        m, and the radii of both ends, m.

    Returns
    -------
    distance : float
        m; 0 if they touch, NaN if a number is NaN.
    on_sector, on_part : tuple of 3 float
        Nearest points of both, m.
    """
    noinline()
    start, axis, length, r0, r1, x, y, width = sector
    hull = start, axis, length, r0, r1
    best, p, q = math.inf, start, start
    for edge in range(2):
        distance, on_line, on_part = gap(_line(sector, width if edge else 0.0), part)
        if math.isnan(distance):
            return distance, p, q
        if distance < best:
            best, p, q = distance, on_line, on_part
    size = math.sqrt(dot(p, p)) + math.sqrt(dot(q, q)) + length + max(r0, r1)
    overlaps, outside = True, False
    if best > 0.0 and gap_bound(hull, part) < best:
        distance, _, on_part = gap(hull, part)
        overlaps = not distance > 0.0
        if not overlaps and distance < best:
            best, p, q = _nearer(best, p, q, on_part, sector)
    else:
        overlaps = False
    for end in range(2 if part[2] > 0.0 else 1):
        rim = add(part[0], scale(end * part[2], part[1])), part[1], part[4] if end else part[3]
        for side in range(2):
            point, height = _highest(rim, hull, side)
            best, p, q = _nearer(best, p, q, point, sector)
            outside = outside or height > 0.0
    for end in range(2):
        centre, radius = add(start, scale(end * length, axis)), r1 if end else r0
        distance, angle = arc_gap((centre, x, y, radius, width), part, best)
        if distance < best:
            s, c = sine_cosine(angle)
            p = add(centre, scale(radius, add(scale(c, x), scale(s, y))))
            best, q = distance, gap((p, axis, 0.0, 0.0, 0.0), part)[2]
    if not best > _ROUND_OFF * size or (overlaps and outside and _is_met(sector, part, best)):
        best = 0.0
    return best, p, q


@long_formula
def point_gap(point, sector):
    """Return the distance of a point from a sector (start, axis, length, r0, r1, x, y, width), m,
    and the nearest point of the sector."""
    start, axis, length, r0, r1, x, y, width = sector
    from_axis = sub(point, start)
    angle = arctan2(dot(from_axis, y), dot(from_axis, x))
    if angle + (2.0 * math.pi if angle < 0.0 else 0.0) > width:
        one, on_one = _line_gap(point, _line(sector, 0.0))
        other, on_other = _line_gap(point, _line(sector, width))
        return (one, on_one) if one < other else (other, on_other)
    distance, nearest = wall_gap(point, (start, axis, length, r0, r1))
    _, across = split(from_axis, axis)
    if not dot(across, across) > 0.0:  # on the axis all directions are as near
        _, nearest = _line_gap(point, _line(sector, 0.0))
    return distance, nearest


@routine
def _nearer(best, p, q, point, sector):
    """Return the nearer of two pairs of points, as (distance, point of the sector, point of the
    solid): the pair so far, (best, p, q), or ``point``, a point of the solid, with the point of the
    sector nearest to it."""
    distance, on_sector = point_gap(point, sector)
    if distance < best:
        return distance, on_sector, point
    return best, p, q


@routine
def _line(sector, angle):
    """Return the straight line on the surface of a sector at an ``angle``, rad, from its first
    edge, as a part of `outlines` with radii 0."""
    start, axis, length, r0, r1, x, y, _ = sector
    s, c = sine_cosine(angle)
    outward = add(scale(c, x), scale(s, y))
    along = add(scale(length, axis), scale(r1 - r0, outward))
    size = math.sqrt(dot(along, along))
    return add(start, scale(r0, outward)), scale(1.0 / size, along), size, 0.0, 0.0


@routine
def _line_gap(point, line):
    """Return the distance of a point from a straight ``line`` between two ends (a part of
    `outlines`, whose radii are ignored), m, and the nearest point of the line."""
    start, axis, length, _, _ = line
    along = min(max(dot(sub(point, start), axis), 0.0), length)
    nearest = add(start, scale(along, axis))
    offset = sub(point, nearest)
    return math.sqrt(dot(offset, offset)), nearest


@routine
def _highest(rim, shell, side):
    """Return the point of a rim (centre, normal, radius) that is highest over the wall of a shell
    (start, axis, length, r0, r1), and its height rho - r0 - slope z, m, outwards positive: rho and
    z are its coordinates across and along the axis, slope is (r1 - r0) / length.

    With ``side`` 0 it is the highest on the half of the rim further from the axis; with 1 it is a
    local maximum on the other half, or any point if there is none.
    """
    centre, normal, radius = rim
    start, axis, length, r0, r1 = shell
    e, v, sine, cosine = axes(normal, axis)
    offset = sub(centre, start)
    x0, y0, z0 = dot(offset, e), dot(offset, v), dot(offset, axis)
    if (y0 < 0.0) == (side == 0):
        y0, v = -y0, scale(-1.0, v)
    ellipse, slope = (x0, y0, z0, radius * cosine, radius, radius * sine), (r1 - r0) / length
    x, y, z, rho = rim_point(steepest(ellipse, slope), 1.0, ellipse)
    point = add(start, add(add(scale(x, e), scale(y, v)), scale(z, axis)))
    return point, rho - r0 - slope * z


@routine
def _is_met(sector, part, distance):
    """Return True if a solid part meets the face of a sector.

    ``distance``, m, is the result that `sector_gap` has if it does not: no point that can then be
    nearest is closer. A straight line of the face that is clearly nearer to the solid therefore
    proves that the face is met; lines all over the face are compared.
    """
    noinline()
    radius, width, angle = max(sector[3], sector[4]), sector[7], 0.0
    for _ in range(_LINES):
        line = _line(sector, angle)
        value = gap_bound(line, part)
        if value < _SHARE * distance:
            value = gap(line, part)[0]
            if value < 1.5 * _SHARE * distance:
                return True
        # a line that is met is value / radius away at least, and the next one is then this near
        angle += max((value + _SHARE * distance) / radius, width / _LINES)
        if angle >= width:
            break
    return False
