"""Direction of the widest gap between two solid frustums, by Newton's method.

The distance of two convex bodies a and b is the largest width of a gap between two parallel planes
that separate them. Along a unit vector u from b to a that width is

    g(u) = min over a of (u . p) - max over b of (u . q)

and its gradient is p - q, with the points p of a and q of b that touch the planes. Where both are
on rims (of radii r_a and r_b; s is the sine of the angle of u to the axis, e the tangent of the
rim), a Newton step in u solves

    (g + r_a / s_a e_a e_a' + r_b / s_b e_b e_b') du = (p - q) - g u

Where u is normal to the side of one of them, all points of a line on that side touch; u is then
kept normal to that side, and the point of the line nearest to the other body is used. At the
largest g, p - q is along u, and |p - q| = g; every other pair of points is further apart.
"""

import math

from sepmc.jit import formula, long_formula, noinline
from sepmc.physics.vec3 import add, cross, dot, scale, split, sub

_STEPS = 8  # 2 are typical
_NEAR_SIDE = 0.2  # sine of the angle to the normal of a side, below which u starts normal to it
_FLAT = 1e-6  # sine to the axis of a body, below which all points of its end are nearest


@long_formula
def widest_gap(a, b, v, relative, round_off):
    """Distance of two solid parts whose nearest points are on rims or sides, and these points.

    Checked against `outlines.gap` without this method.

    Parameters
    ----------
    a, b : tuple
        Parts (start, axis, length, r0, r1).
    v : tuple of 3 float
        Approximate direction from b to a.
    relative, round_off : float
        Tolerances of the distance: relative to itself, and relative to the coordinates.

    Returns
    -------
    distance : float
        m; NaN if the method did not converge, as where the parts overlap, or where a nearest point
        is within an end face, or both are on sides.
    p, q : tuple of 3 float
        Nearest points of a and b; without meaning if the distance is NaN.
    """
    noinline()
    u = scale(1.0 / math.sqrt(dot(v, v)), v)
    slope_a, slope_b = _lean(a, scale(-1.0, u)), _lean(b, u)
    on_a = abs(slope_a) < _NEAR_SIDE and abs(slope_a) <= abs(slope_b)
    on_b = abs(slope_b) < _NEAR_SIDE and not on_a
    end_a, end_b = slope_a > 0.0, slope_b > 0.0
    for _ in range(_STEPS):
        if on_a:
            u = scale(-1.0, _normal_to_side(a, scale(-1.0, u)))
        if on_b:
            u = _normal_to_side(b, u)
        s_a, w_a = _radial(a, scale(-1.0, u))
        s_b, w_b = _radial(b, u)
        if not (s_a > _FLAT and s_b > _FLAT):
            break
        before_a, before_b = end_a, end_b
        end_a, end_b = (
            end_a if on_a else _lean(a, scale(-1.0, u)) > 0.0,
            end_b if on_b else _lean(b, u) > 0.0,
        )
        crossed_a, crossed_b = end_a != before_a, end_b != before_b
        if crossed_a or crossed_b:  # from one rim to the other: the nearest point is on the side
            if on_a or on_b or (crossed_a and crossed_b):
                break
            on_a, on_b = crossed_a, crossed_b
            continue
        fraction_a, fraction_b = 1.0 if end_a else 0.0, 1.0 if end_b else 0.0
        if on_a:
            fraction_a = _nearest_fraction(a, w_a, _on_side(b, w_b, fraction_b))
            if not 0.0 < fraction_a < 1.0:
                on_a, end_a = False, fraction_a >= 1.0
                fraction_a = 1.0 if end_a else 0.0
        elif on_b:
            fraction_b = _nearest_fraction(b, w_b, _on_side(a, w_a, fraction_a))
            if not 0.0 < fraction_b < 1.0:
                on_b, end_b = False, fraction_b >= 1.0
                fraction_b = 1.0 if end_b else 0.0
        p, q = _on_side(a, w_a, fraction_a), _on_side(b, w_b, fraction_b)
        n = sub(p, q)
        g, distance = dot(u, n), math.sqrt(dot(n, n))
        if not g > 0.0:
            break
        if distance - g <= relative * distance + round_off * math.sqrt(dot(p, p) + dot(q, q)):
            return distance, p, q
        radius_a, radius_b = _radius(a, fraction_a) / s_a, _radius(b, fraction_b) / s_b
        e_a, e_b = cross(a[1], w_a), cross(b[1], w_b)
        u = add(u, _step(sub(n, scale(g, u)), g, (radius_a, e_a), (radius_b, e_b), on_a, on_b))
        u = scale(1.0 / math.sqrt(dot(u, u)), u)
    return math.nan, a[0], b[0]


@formula
def _step(t, g, rim_a, rim_b, on_a, on_b):
    """Newton step (a vector) of the unit direction u, for the gradient ``t`` of the width ``g``; t
    is normal to u.

    ``rim_a`` and ``rim_b`` are (radius over the sine of u to the axis, tangent of the rim) of both
    bodies. If u is kept normal to the side of a body (``on_a``, ``on_b``), the step is along the
    tangent of that body, else in any direction.
    """
    (radius_a, e_a), (radius_b, e_b) = rim_a, rim_b
    along_a, along_b, c = dot(e_a, t), dot(e_b, t), dot(e_a, e_b)
    if on_a:
        return scale(along_a / (g + radius_a + radius_b * c * c), e_a)
    if on_b:
        return scale(along_b / (g + radius_b + radius_a * c * c), e_b)
    det = (g + radius_a) * (g + radius_b) - radius_a * radius_b * c * c
    by_a = radius_a * ((g + radius_b) * along_a - radius_b * c * along_b) / det
    by_b = radius_b * ((g + radius_a) * along_b - radius_a * c * along_a) / det
    return scale(1.0 / g, sub(t, add(scale(by_a, e_a), scale(by_b, e_b))))


@formula
def _radial(part, d):
    """Return the sine of the angle between the unit vector ``d`` and the axis of a part (start,
    axis, length, r0, r1), and the unit vector of d's component across the axis; the zero vector if
    d is along the axis."""
    _, across = split(d, part[1])
    s = math.sqrt(dot(across, across))
    return s, scale(1.0 / s, across) if s > 0.0 else across


@formula
def _lean(part, d):
    """Sine of the angle from the normal of the side of a part (start, axis, length, r0, r1) to the
    unit vector ``d``: positive if the rim at the far end (start + length axis) is furthest in the
    direction d, negative if the other rim is. For a disc (length 0) 1 if r1 > r0, else -1."""
    along, rise = dot(d, part[1]), part[4] - part[3]
    s = math.sqrt(max(0.0, 1.0 - along * along))
    slant = _slant(part)
    return (part[2] * along + rise * s) / slant if part[2] > 0.0 else (1.0 if rise > 0.0 else -1.0)


@formula
def _normal_to_side(part, d):
    """Return the outward unit normal of the conical side of a part (start, axis, length, r0, r1)
    that is nearest to the unit vector ``d``; d itself if it is along the axis."""
    s, w = _radial(part, d)
    rise, slant = part[4] - part[3], _slant(part)
    if not s > _FLAT:
        return d
    return add(scale(-rise / slant, part[1]), scale(part[2] / slant, w))


@formula
def _slant(part):
    """Slant height of a part (start, axis, length, r0, r1): length of its side in a plane through
    the axis, m."""
    return math.sqrt(part[2] * part[2] + (part[4] - part[3]) * (part[4] - part[3]))


@formula
def _radius(part, fraction):
    """Radius of a part (start, axis, length, r0, r1) at a ``fraction`` of its length from the
    start, m."""
    return part[3] + fraction * (part[4] - part[3])


@formula
def _on_side(part, w, fraction):
    """Point on the side of a part (start, axis, length, r0, r1) in the direction of the unit vector
    ``w`` across the axis, at a ``fraction`` of its length from the start."""
    return add(add(part[0], scale(fraction * part[2], part[1])), scale(_radius(part, fraction), w))


@formula
def _nearest_fraction(part, w, point):
    """Fraction of the length of a part (start, axis, length, r0, r1) at which the straight line on
    its side, in the direction of the unit vector ``w`` across the axis, is nearest to a point;
    below 0 or above 1 beyond its ends."""
    line = add(scale(part[2], part[1]), scale(part[4] - part[3], w))
    return dot(sub(point, _on_side(part, w, 0.0)), line) / dot(line, line)
