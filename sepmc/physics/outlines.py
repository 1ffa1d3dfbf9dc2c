"""Distances between parts of the outlines of two bodies, all in one frame and in metres.

A part is a solid cone frustum, the tuple (start, axis, length, r0, r1): centre of one end, unit
vector to the other end, distance between the ends, radius at the start and at the other end. A part
of length zero is a disc; if its radii are zero, too, it is a point. A shell is the inner wall of a
hollow frustum, given by the same tuple.

Gilbert, Johnson, Keerthi, IEEE J. Robotics and Automation 4 (1988) 193-203 (GJK): the difference of
two convex bodies is convex, and their distance is that of the origin from it. Only the furthest
point in a given direction is needed of each body. On rims and sides GJK converges slowly: after a
few iterations, Newton's method takes over (`separation.widest_gap`).
"""

import math

from sepmc.jit import formula, long_formula, noinline, routine
from sepmc.physics.separation import widest_gap
from sepmc.physics.vec3 import add, cross, dot, scale, split, sub

# Stop at this relative error of the distance, plus this fraction of the coordinates (round-off).
_RELATIVE = 1e-12
_ROUND_OFF = 1e-15
# The bodies overlap if the origin is in the tetrahedron to this fraction of the coordinates.
_WITHIN = 1e-12
# Near contact an iteration may change the direction only, and the distance by less than round-off.
# Stop after as many in a row.
_STALLED = 2
THROUGH = 0.1  # fraction of a shell's radius: a point outside up to this has passed its wall
_FEW = 3  # iterations, after which the direction is near enough for Newton's method
_ROUNDS = 150  # 50 near contact; the best so far is returned at this limit


@long_formula
def gap(a, b):
    """Distance between two solid parts, and their nearest points.

    Accurate to 1e-12 of itself; for parts of metres in near contact to 1e-9 m (999 of 1000 random
    pairs; worst of 400,000: 1.3e-6 m). Checked against closed forms, planes that separate the
    parts, and minimisation over both, in `tests/physics/test_outlines.py`.

    Parameters
    ----------
    a, b : tuple
        Parts (start, axis, length, r0, r1).

    Returns
    -------
    distance : float
        m; 0 if the parts overlap, NaN if a number is NaN.
    x, y : tuple of 3 float
        Nearest points of a and b; any of them if there are many (faces, parallel sides); one common
        point if the parts overlap, to round-off.
    """
    noinline()
    x, y = a[0], b[0]  # nearest points so far
    if not (_is_known(a) and _is_known(b)):
        return math.nan, x, y
    # corners p - q of the triangle of the difference body with the nearest point
    p1 = p2 = p3 = x
    q1 = q2 = q3 = y
    v = sub(x, y)
    distance = math.sqrt(dot(v, v))
    stalled = 0
    for iteration in range(_ROUNDS):
        if iteration == _FEW:
            newton, p, q = widest_gap(a, b, v, _RELATIVE, _ROUND_OFF)
            if newton > 0.0:
                return newton, p, q
        p, q = _furthest(a, scale(-1.0, v)), _furthest(b, v)
        n = sub(p, q)
        size, length = math.sqrt(dot(p, p) + dot(q, q)), math.sqrt(dot(v, v))
        if not distance * length - dot(v, n) > (_RELATIVE * distance + _ROUND_OFF * size) * length:
            break  # the plane through n normal to v has the same distance
        overlap, t, v = _nearest(
            n, sub(sub(p1, q1), n), sub(sub(p2, q2), n), sub(sub(p3, q3), n), _WITHIN * size
        )
        trial_x = _along(p, t, sub(p1, p), sub(p2, p), sub(p3, p))
        trial_y = _along(q, t, sub(q1, q), sub(q2, q), sub(q3, q))
        difference = sub(trial_x, trial_y)
        trial = math.sqrt(dot(difference, difference))
        if overlap or trial <= _ROUND_OFF * size:
            return 0.0, trial_x, trial_y
        if trial < distance:
            x, y, distance, stalled = trial_x, trial_y, trial, 0
        elif stalled == _STALLED:
            break
        else:
            stalled += 1
        if t[0] == 0.0:  # a corner without weight is replaced
            p1, q1 = p, q
        if t[1] == 0.0:
            p2, q2 = p, q
        if t[2] == 0.0:
            p3, q3 = p, q
    return distance, x, y


@routine
def gap_from(a, b, v):
    """Distance between two solid parts, and their nearest points, as `gap`; faster if the vector
    ``v`` has about the direction from the nearest point of b to that of a. The zero vector stands
    for an unknown direction."""
    if dot(v, v) > 0.0:
        distance, x, y = widest_gap(a, b, v, _RELATIVE, _ROUND_OFF)  # proved, or NaN
        if distance > 0.0:
            return distance, x, y
    return gap(a, b)


@formula
def gap_bound(a, b):
    """Lower bound of the distance of two solid parts (start, axis, length, r0, r1), m, far cheaper
    than `gap`; it may be negative.

    It is the largest of three bounds: the distance of both axes minus the largest radius of each
    part, and the distances by which either part lies beyond the ends of the other (`_beyond`).
    Nearest points a + s d1, b + t d2 of two segments: Ericson, Real-Time Collision Detection,
    5.1.9.
    """
    d1, d2, r = scale(a[2], a[1]), scale(b[2], b[1]), sub(a[0], b[0])
    e1, e2, f1, f2, g = dot(d1, d1), dot(d2, d2), dot(d1, r), dot(d2, r), dot(d1, d2)
    s = _limited_ratio(g * f2 - f1 * e2, e1 * e2 - g * g, 1e-12 * e1 * e2)
    t = _limited_ratio(g * s + f2, e2, 0.0)
    s = _limited_ratio(g * t - f1, e1, 0.0)
    offset = sub(add(r, scale(s, d1)), scale(t, d2))
    radii = (a[3] if a[3] > a[4] else a[4]) + (b[3] if b[3] > b[4] else b[4])
    # the last term: axes that are nearly parallel
    beside = math.sqrt(dot(offset, offset)) - radii - 1e-6 * (a[2] + b[2])
    return max(beside, _beyond(a, b), _beyond(b, a))


@formula
def _beyond(a, b):
    """Distance by which part b lies beyond the ends of part a, along the axis of a, m; negative if
    both overlap along that axis."""
    first, cosine = dot(sub(b[0], a[0]), a[1]), dot(a[1], b[1])
    last, sine = first + cosine * b[2], math.sqrt(max(0.0, 1.0 - cosine * cosine))
    low, high = (
        min(first - sine * b[3], last - sine * b[4]),
        max(first + sine * b[3], last + sine * b[4]),
    )
    return max(low - a[2], -high) - 1e-12 * (a[2] + b[2])


@formula
def _limited_ratio(numerator, denominator, threshold):
    """Quotient of two numbers, limited to the range 0 to 1; 0 unless the denominator exceeds
    ``threshold``."""
    if not denominator > threshold:
        return 0.0
    ratio = numerator / denominator
    return 0.0 if ratio < 0.0 else (1.0 if ratio > 1.0 else ratio)


@long_formula
def inside_gap(point, shell):
    """Signed distance of a point from a shell (the inner wall of a hollow frustum).

    Parameters
    ----------
    point : tuple of 3 float
        m.
    shell : tuple
        Inner wall (start, axis, length, r0, r1).

    Returns
    -------
    distance : float
        m. Positive inside. Negative outside by up to `THROUGH` (a tenth) of the radius, where the
        point has passed the wall. Positive further out, where it is beside the shell. Infinite
        before the start and beyond the other end.
    nearest : tuple of 3 float
        Nearest point of the wall, m.
    """
    start, axis, length, r0, r1 = shell
    distance, nearest = wall_gap(point, shell)
    along, across = split(sub(point, start), axis)
    if along < 0.0 or along > length:
        return math.inf, nearest
    radius = r0 + (r1 - r0) * along / length if length > 0.0 else r0
    out = math.sqrt(dot(across, across)) - radius
    return (-distance if 0.0 < out < THROUGH * radius else distance), nearest


@long_formula
def wall_gap(point, shell):
    """Return the unsigned distance of a point from the wall of a shell (start, axis, length, r0,
    r1), m, and the nearest point of the wall. The point may be inside, outside or beyond an end."""
    start, axis, length, r0, r1 = shell
    along, across = split(sub(point, start), axis)
    rho = math.sqrt(dot(across, across))
    # in the half plane through the axis and the point the wall goes from (0, r0) to (length, r1)
    rise = r1 - r0
    square = length * length + rise * rise
    fraction = (along * length + (rho - r0) * rise) / square if square > 0.0 else 0.0
    fraction = 0.0 if fraction < 0.0 else (1.0 if fraction > 1.0 else fraction)
    radius = r0 + fraction * rise
    outward = scale(1.0 / rho, across) if rho > 0.0 else any_normal(axis)
    nearest = add(add(start, scale(fraction * length, axis)), scale(radius, outward))
    distance = math.sqrt((along - fraction * length) ** 2 + (rho - radius) ** 2)
    return distance, nearest


@routine
def _furthest(part, d):
    """Point of a solid part that is furthest in the direction of the vector d, of any length: the
    support function of GJK."""
    start, axis, length, r0, r1 = part
    along, across = split(d, axis)
    s = math.sqrt(dot(across, across))
    if length * along + r1 * s > r0 * s:
        radius, start = r1, add(start, scale(length, axis))
    else:
        radius = r0
    if not s > 4e-15 * abs(along):  # along the axis: all points of the end are as far
        return start
    return add(start, scale(radius / s, across))


@routine
def any_normal(axis):
    """Some unit vector normal to the unit vector ``axis``."""
    x, y, z = axis
    if abs(x) < 0.6:
        return scale(1.0 / math.sqrt(y * y + z * z), (0.0, -z, y))
    return scale(1.0 / math.sqrt(x * x + y * y), (-y, x, 0.0))


@routine
def _is_known(part):
    """Return True if no number of a part is NaN."""
    start, axis, length, r0, r1 = part
    total = start[0] + start[1] + start[2] + axis[0] + axis[1] + axis[2] + length + r0 + r1
    return not math.isnan(total)


@routine
def _nearest(n, e1, e2, e3, tiny):
    """Find the point n + t1 e1 + t2 e2 + t3 e3 of a tetrahedron (corner n, edges e1, e2, e3) that
    is nearest to the origin, among the faces, edges and corner that contain n.

    All of these are tested and the nearest point is kept, so that flat tetrahedra and double
    corners are safe. Returns True if the origin is inside, to ``tiny`` m; (t1, t2, t3); and the
    vector from the origin to the point, or n if the origin is inside.
    """
    best = dot(n, n), (0.0, 0.0, 0.0), n
    t, v = _edge(n, e1)
    if t > 0.0:
        best = _better(best, (t, 0.0, 0.0), v, n, e1, e2, e3)
    t, v = _edge(n, e2)
    if t > 0.0:
        best = _better(best, (0.0, t, 0.0), v, n, e1, e2, e3)
    t, v = _edge(n, e3)
    if t > 0.0:
        best = _better(best, (0.0, 0.0, t), v, n, e1, e2, e3)
    s, t, v = _triangle(n, e1, e2)
    if s > 0.0:
        best = _better(best, (s, t, 0.0), v, n, e1, e2, e3)
    s, t, v = _triangle(n, e1, e3)
    if s > 0.0:
        best = _better(best, (s, 0.0, t), v, n, e1, e2, e3)
    s, t, v = _triangle(n, e2, e3)
    if s > 0.0:
        best = _better(best, (0.0, s, t), v, n, e1, e2, e3)
    inside, weights = _origin_within(n, e1, e2, e3, tiny)
    if inside:
        return True, weights, n
    return False, best[1], best[2]


@routine
def _better(best, t, v, n, e1, e2, e3):
    """Return the nearer of two points to the origin, as (squared distance, t, v): ``best`` (also if
    both are as near), or n + t1 e1 + t2 e2 + t3 e3. Its ``v`` is not used but passed on: the vector
    to the point as the caller computed it."""
    point = _along(n, t, e1, e2, e3)
    square = dot(point, point)
    return (square, t, v) if square < best[0] else best


@routine
def _edge(n, e):
    """Project the origin on the edge from n to n + e. Returns the fraction of the edge at which the
    projection lies, and the vector to it; 0 and n if it is not between the ends."""
    g, h = dot(e, e), -dot(n, e)
    if 0.0 < h < g:
        v = add(n, scale(h / g, e))
        return h / g, sub(v, scale(dot(v, e) / g, e))  # twice, to be normal to e even if v is short
    return 0.0, n


@routine
def _triangle(n, e1, e2):
    """Project the origin on the triangle with the corner n and the edges e1, e2. Returns the
    fractions s, t of the edges (the projection is n + s e1 + t e2) and the vector to the
    projection; 0, 0 and n if it is not within the triangle, or on its edge.

    They follow from the normal: on the thin triangles of curved rims, products of edges lose twice
    the digits, and n + s e1 + t e2 is too short to give the direction well.
    """
    normal = cross(e1, sub(e2, e1))
    square = dot(normal, normal)
    s, t = dot(cross(e2, n), normal), dot(cross(n, e1), normal)
    if s > 0.0 and t > 0.0 and s + t < square:
        return s / square, t / square, scale(dot(n, normal) / square, normal)
    return 0.0, 0.0, n


@routine
def _origin_within(n, e1, e2, e3, tiny):
    """Test whether a tetrahedron (corner n, edges e1, e2, e3) contains the origin.

    Returns the answer and the fractions (t1, t2, t3) with n + t1 e1 + t2 e2 + t3 e3 = 0, by
    Cramer's rule; they have no meaning if the answer is False. A flat tetrahedron, whose fractions
    miss the origin by more than ``tiny`` m by round-off, counts as not containing it, and so does
    one with the origin on its surface.
    """
    c = cross(e2, e3)
    det = dot(e1, c)
    if det != 0.0:
        t = (-dot(n, c) / det, -dot(n, cross(e3, e1)) / det, -dot(n, cross(e1, e2)) / det)
        if t[0] > 0.0 and t[1] > 0.0 and t[2] > 0.0 and t[0] + t[1] + t[2] < 1.0:
            point = _along(n, t, e1, e2, e3)
            return dot(point, point) <= tiny * tiny, t
    return False, (0.0, 0.0, 0.0)


@routine
def _along(n, t, e1, e2, e3):
    """Return the vector n + t1 e1 + t2 e2 + t3 e3."""
    return add(n, add(scale(t[0], e1), add(scale(t[1], e2), scale(t[2], e3))))
