"""The direction along which two solid frustums are furthest apart, sharpened by Newton's method.

Two convex bodies are apart by what a slab between them can be wide at most. Along a unit vector u
from b to a that width is

    g(u) = min over a of (u . p) - max over b of (u . q)

and its gradient is p - q, of the points p and q that touch the slab. Where both stand on rims (of
radii r_a and r_b, r / s the radius over the sine of u to the axis, e the tangent of the rim), a
step in u solves

    (g + r_a / s_a e_a e_a' + r_b / s_b e_b e_b') du = (p - q) - g u

Where u is normal to the side of one of them, all points of a line on that side touch; it is then
kept normal to that side, and the one of the line that is nearest to the other body counts. At the
greatest g, p - q is along u, and both are as long: any other pair of points is further apart.
"""

import math

from sepmc.jit import formula, long_formula, noinline
from sepmc.physics.vec3 import add, cross, dot, scale, split, sub

_STEPS = 8  # 2 are usual
_NEAR_SIDE = 0.2  # sine of the angle to the normal of a side: first steps take it to be normal
_FLAT = 1e-6  # sine to the axis of a body below which all of its end is as near


@long_formula
def widest_gap(a, b, v, relative, round_off):
    """Distance of two parts whose nearest points stand on rims or sides, and these points.

    a, b : parts (start, axis, length, r0, r1); v : about the direction from b to a
    relative, round_off : known to this share of itself, plus this share of the coordinates
    Returns m and two points; NaN where it is not found: nearest points within ends, or on both
    sides, parts that overlap. Checked against `outlines.gap` without it.
    """
    noinline()
    u = scale(1.0 / math.sqrt(dot(v, v)), v)
    lean_a, lean_b = _lean(a, scale(-1.0, u)), _lean(b, u)
    on_a = abs(lean_a) < _NEAR_SIDE and abs(lean_a) <= abs(lean_b)
    on_b = abs(lean_b) < _NEAR_SIDE and not on_a
    end_a, end_b = lean_a > 0.0, lean_b > 0.0
    for _ in range(_STEPS):
        if on_a:
            u = scale(-1.0, _normal_to_side(a, scale(-1.0, u)))
        if on_b:
            u = _normal_to_side(b, u)
        s_a, w_a = _radial(a, scale(-1.0, u))
        s_b, w_b = _radial(b, u)
        if not (s_a > _FLAT and s_b > _FLAT):
            break
        was_a, was_b = end_a, end_b
        end_a, end_b = (
            end_a if on_a else _lean(a, scale(-1.0, u)) > 0.0,
            end_b if on_b else _lean(b, u) > 0.0,
        )
        crossed_a, crossed_b = end_a != was_a, end_b != was_b
        if crossed_a or crossed_b:  # from one rim to the other: the side is between
            if on_a or on_b or (crossed_a and crossed_b):
                break
            on_a, on_b = crossed_a, crossed_b
            continue
        share_a, share_b = 1.0 if end_a else 0.0, 1.0 if end_b else 0.0
        if on_a:
            share_a = _share(a, w_a, _on_side(b, w_b, share_b))
            if not 0.0 < share_a < 1.0:
                on_a, end_a = False, share_a >= 1.0
                share_a = 1.0 if end_a else 0.0
        elif on_b:
            share_b = _share(b, w_b, _on_side(a, w_a, share_a))
            if not 0.0 < share_b < 1.0:
                on_b, end_b = False, share_b >= 1.0
                share_b = 1.0 if end_b else 0.0
        p, q = _on_side(a, w_a, share_a), _on_side(b, w_b, share_b)
        n = sub(p, q)
        g, distance = dot(u, n), math.sqrt(dot(n, n))
        if not g > 0.0:
            break
        if distance - g <= relative * distance + round_off * math.sqrt(dot(p, p) + dot(q, q)):
            return distance, p, q
        round_a, round_b = _radius(a, share_a) / s_a, _radius(b, share_b) / s_b
        e_a, e_b = cross(a[1], w_a), cross(b[1], w_b)
        u = add(u, _step(sub(n, scale(g, u)), g, (round_a, e_a), (round_b, e_b), on_a, on_b))
        u = scale(1.0 / math.sqrt(dot(u, u)), u)
    return math.nan, a[0], b[0]


@formula
def _step(t, g, bend_a, bend_b, on_a, on_b):
    """Change of the direction for a gradient t normal to it: along the tangent of a body whose side
    it is kept normal to, or free."""
    (round_a, e_a), (round_b, e_b) = bend_a, bend_b
    along_a, along_b, c = dot(e_a, t), dot(e_b, t), dot(e_a, e_b)
    if on_a:
        return scale(along_a / (g + round_a + round_b * c * c), e_a)
    if on_b:
        return scale(along_b / (g + round_b + round_a * c * c), e_b)
    det = (g + round_a) * (g + round_b) - round_a * round_b * c * c
    by_a = round_a * ((g + round_b) * along_a - round_b * c * along_b) / det
    by_b = round_b * ((g + round_a) * along_b - round_a * c * along_a) / det
    return scale(1.0 / g, sub(t, add(scale(by_a, e_a), scale(by_b, e_b))))


@formula
def _radial(part, d):
    """Of a unit vector: sine to the axis of a part, and its unit vector across the axis."""
    _, across = split(d, part[1])
    s = math.sqrt(dot(across, across))
    return s, scale(1.0 / s, across) if s > 0.0 else across


@formula
def _lean(part, d):
    """Sine from the normal of a part's side to a unit vector: positive if the far rim is furthest
    that way."""
    along, rise = dot(d, part[1]), part[4] - part[3]
    s = math.sqrt(max(0.0, 1.0 - along * along))
    slant = _slant(part)
    return (part[2] * along + rise * s) / slant if part[2] > 0.0 else (1.0 if rise > 0.0 else -1.0)


@formula
def _normal_to_side(part, d):
    """The unit vector normal to the side of a part that is nearest to d; d if it is along the
    axis."""
    s, w = _radial(part, d)
    rise, slant = part[4] - part[3], _slant(part)
    if not s > _FLAT:
        return d
    return add(scale(-rise / slant, part[1]), scale(part[2] / slant, w))


@formula
def _slant(part):
    return math.sqrt(part[2] * part[2] + (part[4] - part[3]) * (part[4] - part[3]))


@formula
def _radius(part, share):
    return part[3] + share * (part[4] - part[3])


@formula
def _on_side(part, w, share):
    """Point of a part's side across the axis by w, at a share of its length."""
    return add(add(part[0], scale(share * part[2], part[1])), scale(_radius(part, share), w))


@formula
def _share(part, w, point):
    """Share of the length at which the line on a part's side, across the axis by w, is nearest to a
    point."""
    line = add(scale(part[2], part[1]), scale(part[4] - part[3], w))
    return dot(sub(point, _on_side(part, w, 0.0)), line) / dot(line, line)
