"""The least distance from the rim of a solid to the inside of a shell, all in one frame and in
metres.

A rim is the tuple (centre, normal, radius), a shell that of `outlines`. Seen along the axis of the
shell the rim is an ellipse. With z along the axis, y along the line that rim plane and cross
section share, and phi the angle on the rim from where z is greatest,

    x = x0 + a cos phi,  y = y0 + r sin phi,  z = z0 + b cos phi,  a^2 + b^2 = r^2

and the distance from the wall (of slope m, inside positive) is least where rho - m z is greatest,
rho^2 = x^2 + y^2. With y0 >= 0 that is where sin phi >= 0. There d(rho - m z)/dphi = J / rho,

    J = sin phi (b^2 cos phi - a x0 + m b rho) + r y0 cos phi

and wherever J is zero J / sin phi falls: its slope is -(1 + m^2) b^2 sin phi - r y0 / sin^2 phi. So
rho - m z rises, then falls, with one summit however the rim is tilted or shifted, and the nearest
point of any arc is that summit or the end next to it.
"""

import math

from sepmc.jit import keep_apart, long_formula, routine
from sepmc.physics.elementary import arctan2, sine_cosine
from sepmc.physics.outlines import THROUGH, any_normal
from sepmc.physics.vec3 import add, cross, dot, scale, split, sub

_ROUNDS = 80  # of Newton or halving: 4 on average, 55 where the summit is at an end of the arc
_CLOSE = 1e-8  # rad: a Newton step below this squares to below round-off
_PIECES = 32  # of an arc, where one formula does not do
_GOLDEN = 0.5 * (math.sqrt(5.0) - 1.0)
_NARROWINGS = 75  # of golden section: to 2e-16


@long_formula
def rim_gap(rim, shell, margin):
    """Least of `outlines.inside_gap` over a rim, and the nearest points of rim and wall.

    rim : (centre, normal, radius); shell : (start, axis, length, r0, r1) with a length above zero
    margin : 0 for that. Above it, a bound: no point of the rim that moves by ``margin`` (m) at most
        comes nearer than this less ``margin``, because the wall is taken to go on by so much beyond
        both ends, and what is so little beyond it as through it.

    Infinite if no point of the rim lies between the ends. Checked against minimisation over the rim
    in steps of 0.01 deg.
    """
    keep_apart()
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
        missing = math.isnan(z0 + radius * sine)
        return (math.nan if missing else math.inf), centre, centre
    angle, side = _summit(ellipse, wall[1], low, high), 1.0
    distance, foot, plain = _signed(angle, side, ellipse, wall)
    if not plain and radius > 0.0:
        angle, side = _search(ellipse, wall, low, high, angle)
        distance, foot, _ = _signed(angle, side, ellipse, wall)
    x, y, z, rho = place(angle, side, ellipse)
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
    """x and y of the module's text, and sine and cosine of the angle between the normal of the rim
    and the axis of the shell."""
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
    """Angles, in 0 to pi, between which the rim lies between the ends; the first is the greater if
    it does nowhere."""
    most, least = length + margin - z0, -margin - z0
    if not (most >= -b and least <= b):
        return 1.0, 0.0
    low, high = 0.0, math.pi
    if most < b:
        low = arctan2(math.sqrt((b - most) * (b + most)), most)
    if least > -b:
        high = arctan2(math.sqrt((b - least) * (b + least)), least)
    return low, high


@routine
def place(angle, side, ellipse):
    """Point (x, y, z) of the rim at an angle, and its distance from the axis; ``side`` -1 is the
    other half of the rim."""
    x0, y0, z0, a, r, b = ellipse
    s, c = sine_cosine(angle)
    x, y = x0 + a * c, y0 + side * r * s
    return x, y, z0 + b * c, math.sqrt(x * x + y * y)


@routine
def _summit(ellipse, slope, low, high):
    """Angle between two at which rho - slope z is greatest: the root of J by Newton within a
    bracket, or the end it lies beyond."""
    x0, y0, _, a, r, b = ellipse
    mb = slope * b
    angle = arctan2(r * y0, a * x0 - mb * r)  # the root for a rim of which the tilt does not count
    angle = min(max(angle, low), high)
    for _ in range(_ROUNDS):
        s, c = sine_cosine(angle)
        x, y = x0 + a * c, y0 + r * s
        rho = math.sqrt(x * x + y * y)
        inner = b * b * c - a * x0 + mb * rho
        j = s * inner + r * y0 * c
        # at 0, where sin phi is 0, J / sin phi tells more
        up = inner if j == 0.0 and s < 0.5 else j
        if up > 0.0:
            low = angle
        elif up < 0.0:
            high = angle
        else:
            break
        rise = mb * (r * y * c - a * x * s) / rho if rho > 0.0 else 0.0
        fall = s * (b * b * s - rise) + r * y0 * s - c * inner
        trial = angle + j / fall if fall > 0.0 else -1.0
        if low < trial < high:
            done = abs(trial - angle) <= _CLOSE
        else:
            trial = 0.5 * (low + high)
            done = not low < trial < high
        angle = trial
        if done:
            break
    return angle


@routine
def _signed(angle, side, ellipse, wall):
    """Signed distance of a point of the rim from the wall; how far along the axis its foot on the
    wall is; and whether no other point of its arc can be nearer, if this one is nearest to the
    wall's line."""
    _, _, z, rho = place(angle, side, ellipse)
    r0, slope, length, margin = wall
    radius = r0 + slope * z
    out = rho - radius
    share = (z + slope * (rho - r0)) / (1.0 + slope * slope)
    foot = min(max(share, -margin), length + margin)
    distance = math.sqrt((z - foot) ** 2 + (rho - r0 - slope * foot) ** 2)
    beside = _is_beside(angle, side, ellipse, wall)
    if out > 0.0 and not beside:
        # wherever it goes, it is beside the wall once it is further through than that
        if margin > 0.0:
            most = THROUGH * (radius + abs(slope) * margin)
            distance = min(
                distance, most / math.sqrt(1.0 + slope * slope) if foot == share else most
            )
        distance = -distance
    return distance, foot, not beside and (slope == 0.0 or (out <= 0.0 and foot == share))


@routine
def _search(ellipse, wall, low, high, summit):
    """Angle and side of the nearest point where a lip of the shell is nearest, or some of the rim
    is through its wall or beside it.

    Every least of some points of the arc is narrowed down, and where the rim stops being through
    the wall and is beside it.
    """
    keep_apart()
    piece = (high - low) / _PIECES
    best, angle, side = _signed(summit, 1.0, ellipse, wall)[0], summit, 1.0
    for half in (1.0, -1.0):
        before, here = math.inf, _signed(low, half, ellipse, wall)[0]
        for i in range(_PIECES + 1):
            at, end = low + i * piece, min(high, low + (i + 1) * piece)
            after = _signed(end, half, ellipse, wall)[0] if i < _PIECES else math.inf
            least = here <= before and here <= after
            if least and (here - piece * ellipse[4] < best or _is_beside(at, half, ellipse, wall)):
                found, place = _narrow(ellipse, wall, half, max(low, at - piece), end, at, here)
                if found < best:
                    best, angle, side = found, place, half
            if _is_beside(at, half, ellipse, wall) != _is_beside(end, half, ellipse, wall):
                place = _border(ellipse, wall, half, at, end)
                found = _signed(place, half, ellipse, wall)[0]
                if found < best:
                    best, angle, side = found, place, half
            before, here = here, after
    return angle, side


@routine
def _is_beside(angle, side, ellipse, wall):
    """Whether a point of the rim is further outside the wall than what counts as through it."""
    _, _, z, rho = place(angle, side, ellipse)
    r0, slope, _, margin = wall
    factor = 1.0 + THROUGH
    return rho - factor * (r0 + slope * z) > margin * math.sqrt(1.0 + (factor * slope) ** 2)


@routine
def _border(ellipse, wall, side, a, b):
    """The last angle at which the rim is not beside the wall, between two of which it is at one."""
    if _is_beside(a, side, ellipse, wall):
        a, b = b, a
    for _ in range(_NARROWINGS):
        middle = 0.5 * (a + b)
        if _is_beside(middle, side, ellipse, wall):
            b = middle
        else:
            a = middle
    return a


@routine
def _narrow(ellipse, wall, side, low, high, angle, best):
    """The least distance between two angles, by golden section, and its angle; starts from one that
    is known."""
    keep_apart()
    a, b = high - _GOLDEN * (high - low), low + _GOLDEN * (high - low)
    fa, fb = _signed(a, side, ellipse, wall)[0], _signed(b, side, ellipse, wall)[0]
    for _ in range(_NARROWINGS):
        if fa < best:
            best, angle = fa, a
        if fb < best:
            best, angle = fb, b
        if fa <= fb:
            high, b, fb = b, a, fa
            a = high - _GOLDEN * (high - low)
            fa = _signed(a, side, ellipse, wall)[0]
        else:
            low, a, fa = a, b, fb
            b = low + _GOLDEN * (high - low)
            fb = _signed(b, side, ellipse, wall)[0]
    return best, angle
