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

from sepmc.jit import long_formula, noinline, routine
from sepmc.physics.elementary import arctan2, sine_cosine
from sepmc.physics.outlines import THROUGH, any_normal
from sepmc.physics.vec3 import add, cross, dot, scale, split, sub

_ROUNDS = 80  # of Newton or halving: 4 on average, 55 where the summit is at an end of the arc
_CLOSE = 1e-8  # rad: a Newton step below this squares to below round-off
_PIECES = 32  # of an arc, where one formula does not do
_GOLDEN = 0.5 * (3.0 - math.sqrt(5.0))
_NARROWINGS = 75  # 10 are usual
_SHARP = 1e-10  # rad, of which the square counts where the distance is smooth


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
        missing = math.isnan(z0 + radius * sine)
        return (math.nan if missing else math.inf), centre, centre
    angle, side = _summit(ellipse, wall[1], low, high), 1.0
    distance, foot, beyond, plain = _signed(angle, side, ellipse, wall)
    if not (plain and beyond <= 0.0) and radius > 0.0:
        angle, side = _search(ellipse, wall, low, high, angle)
        distance, foot, _, _ = _signed(angle, side, ellipse, wall)
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
    wall is; by how much it is further outside the wall than what counts as through it (then it is
    beside it); and whether no other point of its arc can be nearer, if this one is nearest to the
    wall's line and not beside."""
    _, _, z, rho = place(angle, side, ellipse)
    r0, slope, length, margin = wall
    radius = r0 + slope * z
    out, factor = rho - radius, 1.0 + THROUGH
    beyond = rho - factor * radius - margin * math.sqrt(1.0 + (factor * slope) ** 2)
    share = (z + slope * (rho - r0)) / (1.0 + slope * slope)
    foot = min(max(share, -margin), length + margin)
    distance = math.sqrt((z - foot) ** 2 + (rho - r0 - slope * foot) ** 2)
    if out > 0.0 and beyond <= 0.0:
        # wherever it goes, it is beside the wall once it is further through than that
        if margin > 0.0:
            most = THROUGH * (radius + abs(slope) * margin)
            distance = min(
                distance, most / math.sqrt(1.0 + slope * slope) if foot == share else most
            )
        distance = -distance
    return distance, foot, beyond, slope == 0.0 or (out <= 0.0 and foot == share)


@routine
def _search(ellipse, wall, low, high, summit):
    """Angle and side of the nearest point where a lip of the shell is nearest, or some of the rim
    is through its wall or beside it.

    Every least of some points of the arc is narrowed down, and where the rim stops being through
    the wall and is beside it.
    """
    noinline()
    piece = (high - low) / _PIECES
    most = piece * ellipse[4]  # that a point moves, and how far it may be beside and come through
    near = most * (1.0 + (1.0 + THROUGH) * abs(wall[1]))
    best, angle, side = _signed(summit, 1.0, ellipse, wall)[0], summit, 1.0
    for half in (1.0, -1.0):
        before = at_border = math.inf
        here, _, past, _ = _signed(low, half, ellipse, wall)
        for i in range(_PIECES + 1):
            at, end = low + i * piece, min(high, low + (i + 1) * piece)
            after, following, last_border = math.inf, past, at_border
            if i < _PIECES:
                after, _, following, _ = _signed(end, half, ellipse, wall)
            at_border = math.inf
            if (past > 0.0) != (following > 0.0):
                place = _border(ellipse, wall, half, at, past, end, following)
                at_border = _signed(place, half, ellipse, wall)[0]
                if at_border < best:
                    best, angle, side = at_border, place, half
            # where a border is near and is the least, there is nothing to narrow down
            least = here <= before and here <= after and here < min(last_border, at_border)
            if least and (here - most < best or 0.0 < past < near):
                found, place = _narrow(ellipse, wall, half, max(low, at - piece), end, at, here)
                if found < best:
                    best, angle, side = found, place, half
            before, here, past = here, after, following
    return angle, side


@routine
def _border(ellipse, wall, side, a, past_a, b, past_b):
    """The last angle at which the rim is not beside the wall, between two of which it is at one: by
    Illinois, as far as numbers go."""
    if past_a > 0.0:
        a, past_a, b, past_b = b, past_b, a, past_a
    last = 0
    for _ in range(_NARROWINGS):
        at = a + (b - a) * (past_a / (past_a - past_b))
        if at in (a, b):
            at = 0.5 * (a + b)
            if at in (a, b):
                break
        past = _signed(at, side, ellipse, wall)[2]
        if past > 0.0:
            b, past_b = at, past
            past_a = 0.5 * past_a if last == 1 else past_a
            last = 1
        else:
            a, past_a = at, past
            past_b = 0.5 * past_b if last == -1 else past_b
            last = -1
    return a


@routine
def _narrow(ellipse, wall, side, low, high, angle, best):
    """The least distance between two angles, and its angle, by Brent's method (parabolas, and
    golden section where these do not serve); starts from one that is known."""
    noinline()
    second, third, value2, value3 = angle, angle, best, best  # the best so far but for ``angle``
    step = last = 0.0
    for _ in range(_NARROWINGS):
        middle = 0.5 * (low + high)
        if max(angle - low, high - angle) <= 2.0 * _SHARP:
            break
        r, q = (angle - second) * (best - value3), (angle - third) * (best - value2)
        p = (angle - third) * q - (angle - second) * r
        q = 2.0 * (q - r)
        p, q = (-p, q) if q > 0.0 else (p, -q)
        before, last = last, step
        if abs(p) < abs(0.5 * q * before) and q * (low - angle) < p < q * (high - angle):
            step = p / q  # to the least of the parabola
            if angle + step - low < 2.0 * _SHARP or high - angle - step < 2.0 * _SHARP:
                step = _SHARP if angle < middle else -_SHARP
        else:
            last = (high if angle < middle else low) - angle
            step = _GOLDEN * last
        if abs(step) < _SHARP:
            step = _SHARP if step > 0.0 else -_SHARP
        at = angle + step
        value = _signed(at, side, ellipse, wall)[0]
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
