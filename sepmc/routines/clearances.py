"""The least distance between the outlines of two bodies over a flight, step by step, and the time
and place of it.

Within a step every pair of parts is searched on its own: the step is halved wherever the pair could
be nearer than the least so far. How near it could be follows from the relative motion. The distance
is the least of many smooth functions of time, one for each pair of points (or point and plane of a
wall), whose second derivative is at most C; between two times dt apart it is then nowhere less than

    d0 + (d1 - d0) u - C dt^2 / 2 u (1 - u),  u in 0 to 1

(Piyavskii's method with a bound of the second derivative). So no dip between two instants is
missed, and far from the least a step takes two distances. Where the rim of a solid leaves a shell
its distance ends: the bound then counts what is beyond by no more than it can move.
"""

import math

from sepmc.jit import noinline, routine
from sepmc.physics import outlines, quat, vec3
from sepmc.physics.rims import rim_gap
from sepmc.physics.shell_edge import edge_gap, edge_gap_bound
from sepmc.routines import layout as at
from sepmc.routines.lanes import LANES

# two solids; a rim of a solid within a shell; a lip of a shell and a solid. The shell is that of
# the first or of the second body
SOLIDS, SHELL_ON_FIRST, SHELL_ON_SECOND, EDGE_ON_FIRST, EDGE_ON_SECOND = 0, 1, 2, 3, 4
_SAFE = 2.0  # times the greatest second difference of these bounds the acceleration
_ROUND_OFF = 1e-14  # of the reach of both parts: differences of distance below this do not count
# times that may a rim stand before the end of its shell and count as within: rims that are flush at
# the start
_FLUSH = 100.0
_THROUGH = 1.0 - 1e-9  # of the furthest that a rim can be through a wall: then it is through
_SURE = 1e-7  # m: where the bound is as near as this, C follows from the distances themselves
# of a shell's radius: no point of a rim is taken to be nearer to a lip than this (its C goes with 1
# / distance)
_NEAR_LIP = 1e-3
# times what a rim may move in an interval: its chord beyond an end then changes evenly
_WELL_ACROSS = 256.0
# halvings of a step in all; 10 are usual, 150 where a rim leaves a shell. A step that takes them
# all is given up
_MOST = 20_000
# of a node, a time within the step: fraction, distance, C of the interval it ends, pose
_AT, _VALUE, _BEND, _POSE = 0, 1, 2, 3


@routine
def search_clearance(w, job):
    """Search a step for less than the clearance found so far: least distance, its time, the nearest
    point of the first body (3, layout), and whether the bodies touch; NaN at first. All stands at
    w[job] and behind (`layout.JOB_TIME`, ...), as does whether the search came to an end.

    JOB_PARTS : start in ``w`` and number of the parts of both outlines (`layout.PART_SIZE`)
    JOB_CENTRES : layout points of the mass centres
    JOB_PATH : (order + 1, PATH), over the step, by powers of its share gone by: place of b less
        that of a (3), attitudes of a and b (4, 4)
    """
    noinline()
    parts, poses, h = job + at.JOB_PARTS, job + at.JOB_POSES, w[job + at.JOB_LENGTH]
    cg_a, cg_b = vec3.get(w, job + at.JOB_CENTRES), vec3.get(w, job + at.JOB_CENTRES + 3)
    for n in range(at.POSES):
        _pose(n / (at.POSES - 1), w, job, poses + at.POSE * n)
    motion, searched = _motion(w, poses, h), True
    for n in range(int(w[parts + 1])):
        pa = int(w[parts]) + at.PART_SIZE * n
        part_a = _part(pa, cg_a, w)
        for m in range(int(w[parts + 3])):
            pb = int(w[parts + 2]) + at.PART_SIZE * m
            part_b = _part(pb, cg_b, w)
            shell_a, shell_b = w[pa] != 0.0, w[pb] != 0.0
            if shell_a and shell_b:
                continue  # two shells: each is met by the other body's solids
            kind = SHELL_ON_FIRST if shell_a else (SHELL_ON_SECOND if shell_b else SOLIDS)
            length = part_b[2] if shell_a else part_a[2]
            for end in range(2 if kind != SOLIDS and length > 0.0 else 1):
                searched = _search((kind, end, part_a, part_b), motion, w, job) and searched
            for end in range(2 if kind != SOLIDS else 0):
                lip = EDGE_ON_FIRST if shell_a else EDGE_ON_SECOND
                searched = _search((lip, end, part_a, part_b), motion, w, job) and searched
    w[job + at.JOB_DONE] = 1.0 if searched else 0.0


@routine
def load_outline(w, held, numbers, parts):
    """Put the parts of a lane's own outline, whose numbers stand LANES apart from w[numbers] on,
    to w[held] and behind, as `layout.PART_SIZE` has them.

    numbers : of each part hollow, layout point of its start, station of its other end (NaN: a
        point), radius at both ends
    """
    for n in range(parts):
        to, of = held + at.PART_SIZE * n, numbers + at.PART_SIZE * n * LANES
        for k in range(at.PART_SIZE):
            w[to + k] = w[of + k * LANES]
        length = w[to + 4] - w[to + 1]
        w[to + 4] = 0.0 if math.isnan(length) else length
        if length == 0.0:  # a disc has one rim
            w[to + 5] = w[to + 6] = max(w[to + 5], w[to + 6])


@routine
def _part(p, cg, w):
    """Part of a body's outline, whose numbers start at w[p], in the axes of the body from its
    centre of mass."""
    start = (cg[0] - w[p + 1], w[p + 2] - cg[1], w[p + 3] - cg[2])
    length = w[p + 4]
    return (
        start,
        (-1.0 if length >= 0.0 else 1.0, 0.0, 0.0),
        abs(length),
        w[p + 5],
        w[p + 6],
    )


@routine
def _pose(theta, w, job, pose):
    """Attitude (9) and place of body b in the axes of body a, from mass centre to mass centre, at a
    fraction of the step; to w[pose] and behind."""
    noinline()
    for n in range(at.PATH):
        w[pose + n] = 0.0
    for q in range(int(w[job + at.JOB_POWERS]) - 1, -1, -1):
        for n in range(at.PATH):
            w[pose + n] = w[pose + n] * theta + w[job + at.JOB_PATH + at.PATH * q + n]
    apart = vec3.get(w, pose)
    to = quat.matrix(quat.unit((w[pose + 3], w[pose + 4], w[pose + 5], w[pose + 6])))
    r = quat.matrix(quat.unit((w[pose + 7], w[pose + 8], w[pose + 9], w[pose + 10])))
    for n in range(3):
        column = vec3.unrotate(to, (r[n], r[3 + n], r[6 + n]))
        w[pose + n], w[pose + 3 + n], w[pose + 6 + n] = column
    vec3.put(w, pose + 9, vec3.unrotate(to, apart))


@routine
def _motion(w, poses, h):
    """Of body b seen from a: greatest speed, m/s, and acceleration, m/s2, of its origin, of a's
    origin seen from b, and of its axes."""
    noinline()
    piece = h / (at.POSES - 1)
    speed_a, speed_b, turn, bend_a, bend_b, curl = 0.0, 0.0, 0.0, 0.0, 0.0, 0.0
    for n in range(1, at.POSES):
        now, last = poses + at.POSE * n, poses + at.POSE * (n - 1)
        rate = vec3.sub(vec3.get(w, now + 9), vec3.get(w, last + 9))
        back = vec3.sub(_back(w, now), _back(w, last))
        speed_a, speed_b = max(speed_a, vec3.dot(rate, rate)), max(speed_b, vec3.dot(back, back))
        total = 0.0
        for c in range(9):
            total += (w[now + c] - w[last + c]) ** 2
        turn = max(turn, total)
        if n > 1:
            first = last - at.POSE
            before = vec3.sub(vec3.get(w, last + 9), vec3.get(w, first + 9))
            change = vec3.sub(rate, before)
            change_back = vec3.sub(back, vec3.sub(_back(w, last), _back(w, first)))
            bend_a, bend_b = (
                max(bend_a, vec3.dot(change, change)),
                max(bend_b, vec3.dot(change_back, change_back)),
            )
            total = 0.0
            for c in range(9):
                total += (w[now + c] - 2.0 * w[last + c] + w[first + c]) ** 2
            curl = max(curl, total)
    square = piece * piece
    bend_a, bend_b, curl = (
        _SAFE * math.sqrt(bend_a) / square,
        _SAFE * math.sqrt(bend_b) / square,
        _SAFE * math.sqrt(curl) / square,
    )
    return (
        math.sqrt(speed_a) / piece + piece * bend_a, math.sqrt(speed_b) / piece + piece * bend_b,
        math.sqrt(turn) / piece + piece * curl,
        bend_a, bend_b, curl,
    )  # fmt: skip


@routine
def _back(w, pose):
    """Origin of body a in the axes of b, but for its sign."""
    return vec3.unrotate(vec3.get_matrix(w, pose), vec3.get(w, pose + 9))


@routine
def _reach(part):
    """How far a part reaches from the origin of its axes, m."""
    start, axis, length, r0, r1 = part
    end = vec3.add(start, vec3.scale(length, axis))
    return max(math.sqrt(vec3.dot(start, start)) + r0, math.sqrt(vec3.dot(end, end)) + r1)


@routine
def _is_rim(kind):
    """Whether a pair is a rim of a solid within a shell, whose distance ends where the rim
    leaves."""
    return kind in (SHELL_ON_FIRST, SHELL_ON_SECOND)


@routine
def _is_through(shell, best):
    """Whether a rim is known to be as far through the wall of its shell as one can be
    (`outlines.inside_gap`): no distance is less."""
    return best <= -_THROUGH * outlines.THROUGH * max(shell[3], shell[4])


@routine
def _placed(part, w, pose):
    """A part of body b in the axes of body a."""
    start, axis, length, r0, r1 = part
    r = vec3.get_matrix(w, pose)
    return (
        vec3.add(vec3.get(w, pose + 9), vec3.rotate(r, start)),
        vec3.rotate(r, axis),
        length,
        r0,
        r1,
    )


@routine
def _rim(part, end):
    """Rim of a part: centre, normal, radius."""
    start, axis, length, r0, r1 = part
    if end == 0:
        return start, axis, r0
    return vec3.add(start, vec3.scale(length, axis)), axis, r1


@routine
def _distance(pair, w, pose, margin):
    """Distance of a pair and its nearest point on body a, axes of a."""
    noinline()
    kind, end, part_a, part = pair
    part_b = _placed(part, w, pose)
    if kind == SOLIDS:
        distance, here, _ = outlines.gap(part_a, part_b)
    elif kind == SHELL_ON_FIRST:
        distance, _, here = rim_gap(_rim(part_b, end), part_a, margin)
    elif kind == SHELL_ON_SECOND:
        distance, here, _ = rim_gap(_rim(part_a, end), part_b, margin)
    elif kind == EDGE_ON_FIRST:
        distance, here, _ = edge_gap(_rim(part_a, end), part_b)
    else:
        distance, _, here = edge_gap(_rim(part_b, end), part_a)
    return distance, here


@routine
def _far(pair, w, pose):
    """What a pair cannot be nearer than, m, found cheaply. Of a rim and a shell: as a distance
    without sign."""
    kind, end, part_a, part = pair
    part_b = _placed(part, w, pose)
    if kind == SOLIDS:
        return outlines.gap_bound(part_a, part_b)
    if kind == EDGE_ON_FIRST:
        return edge_gap_bound(_rim(part_a, end), part_b)
    if kind == EDGE_ON_SECOND:
        return edge_gap_bound(_rim(part_b, end), part_a)
    solid, shell = (part_b, part_a) if kind == SHELL_ON_FIRST else (part_a, part_b)
    centre, _, radius = _rim(solid, end)
    return outlines.wall_gap(centre, shell)[0] - radius


@routine
def _along(pair, w, pose):
    """Least and greatest coordinate of a rim along the axis of its shell, m, and how far from the
    axis it reaches at most."""
    kind, end, part_a, part = pair
    part_b = _placed(part, w, pose)
    solid, shell = (part_b, part_a) if kind == SHELL_ON_FIRST else (part_a, part_b)
    centre, normal, radius = _rim(solid, end)
    tilt = vec3.cross(normal, shell[1])
    half = radius * math.sqrt(vec3.dot(tilt, tilt))
    middle, across = vec3.split(vec3.sub(centre, shell[0]), shell[1])
    return middle - half, middle + half, math.sqrt(vec3.dot(across, across)) + radius


@routine
def _least(d0, d1, bend, dt):
    """What a distance is nowhere less than between two times dt apart, its second derivative at
    most ``bend``."""
    s, c = d1 - d0, 0.5 * bend * dt * dt
    if abs(s) >= c:
        return min(d0, d1)
    return d0 - (c - s) ** 2 / (4.0 * c)


@routine
def _most(x0, x1, move, bend, dt):
    """What a coordinate is nowhere more than between two times, if it moves by at most ``move`` and
    bends by at most ``bend``."""
    return min(max(x0, x1) + move, -_least(-x0, -x1, bend, dt))


@routine
def _note(distance, here, time, w, job):
    """Take over a new least distance with its time and the nearest point of the first body,
    layout."""
    found, cg = job + at.JOB_RESULT, vec3.get(w, job + at.JOB_CENTRES)
    w[found], w[found + 1] = distance, time
    vec3.put(w, found + 2, (cg[0] - here[0], cg[1] + here[1], cg[2] + here[2]))
    w[found + 5] = 1.0 if distance <= 0.0 else 0.0


@routine
def _search(pair, motion, w, job):
    """Search a step for a pair being nearer than known, or in touch earlier. Returns whether the
    search came to an end.

    From left to right and always as deep as needed: the first of the job's nodes is the left end of
    an interval, number ``top`` its right end, and below that stand the right ends of those that
    follow.
    """
    noinline()
    kind, _, part_a, part_b = pair
    size, h = _reach(part_a) + _reach(part_b), w[job + at.JOB_LENGTH]
    if kind == SHELL_ON_SECOND:
        speed, bend = motion[1] + motion[2] * _reach(part_a), motion[4] + motion[5] * _reach(part_a)
    else:
        speed, bend = motion[0] + motion[2] * _reach(part_b), motion[3] + motion[5] * _reach(part_b)
    tiny = _ROUND_OFF * size
    shell = part_a if kind == SHELL_ON_FIRST else part_b
    beyond = w[job + at.JOB_RESULT]  # NaN: nothing known yet
    if _is_rim(kind):
        if _is_through(shell, beyond):
            return True
        beyond = (
            max(beyond, outlines.THROUGH * max(shell[3], shell[4]))
            if not math.isnan(beyond)
            else math.inf
        )
    elif beyond < 0.0:
        return True
    first, last = job + at.JOB_POSES, job + at.JOB_POSES + at.POSE * (at.POSES - 1)
    if 0.5 * (_far(pair, w, first) + _far(pair, w, last) - speed * h) > beyond:
        return True
    left, still = job + at.JOB_NODES, not speed * h > tiny
    for end in range(1 if still else 2):
        node = left + at.NODE * end
        for n in range(at.POSE):
            w[node + _POSE + n] = w[(last if end else first) + n]
        w[node + _AT], w[node + _BEND] = float(end), math.inf
        _visit(pair, w, job, node, tiny)
    top, halvings = 0 if still else 1, 0
    while top > 0 and halvings < _MOST:
        right = left + at.NODE * top
        dt = (w[right + _AT] - w[left + _AT]) * h
        if top > at.DEPTH or not _worth_halving(pair, w, job, right, bend, speed, dt, tiny):
            for n in range(at.NODE):
                w[left + n] = w[right + n]
            top -= 1
            continue
        middle = right + at.NODE
        w[middle + _AT] = 0.5 * (w[left + _AT] + w[right + _AT])
        _pose(w[middle + _AT], w, job, middle + _POSE)
        _visit(pair, w, job, middle, tiny)
        before, now, after = w[left + _VALUE], w[middle + _VALUE], w[right + _VALUE]
        curve = math.inf
        if max(before, now, after) < math.inf:  # twice the second derivative
            curve = 8.0 * abs(before - 2.0 * now + after) / (dt * dt)
        w[middle + _BEND] = w[right + _BEND] = curve
        top += 1
        halvings += 1
    return top == 0


@routine
def _visit(pair, w, job, node, tiny):
    """Distance of a pair at a time whose pose stands at a node; taken over if it is less, or
    touches earlier."""
    noinline()
    distance, here = _distance(pair, w, node + _POSE, _FLUSH * tiny)
    w[node + _VALUE] = distance
    time = w[job + at.JOB_TIME] + w[node + _AT] * w[job + at.JOB_LENGTH]
    best, since = w[job + at.JOB_RESULT], w[job + at.JOB_RESULT + 1]
    if (
        distance < best - tiny
        or (math.isnan(best) and distance < math.inf)
        or (distance == best == 0.0 and time < since)
        or math.isnan(distance)
    ):
        _note(distance, here, time, w, job)


@routine
def _worth_halving(pair, w, job, right, bend, speed, dt, tiny):
    """Whether a pair may be nearer than known from the first node to the one at ``right``, or touch
    earlier."""
    noinline()
    left, best = job + at.JOB_NODES, w[job + at.JOB_RESULT]
    kind, d0, d1, curve = pair[0], w[left + _VALUE], w[right + _VALUE], w[right + _BEND]
    move = speed * dt
    if not move > tiny:
        return False
    if not _is_rim(kind):
        if best == 0.0:  # only touching earlier counts
            may_touch = d1 == 0.0 or _least_solids(d0, d1, bend, curve, move, dt) < 0.0
            time = w[job + at.JOB_TIME] + w[left + _AT] * w[job + at.JOB_LENGTH]
            return may_touch and d0 > 0.0 and time < w[job + at.JOB_RESULT + 1]
        return _least_solids(d0, d1, bend, curve, move, dt) < best - tiny
    lowest0, highest0, outmost0 = _along(pair, w, left + _POSE)
    lowest1, highest1, outmost1 = _along(pair, w, right + _POSE)
    shell = pair[2] if kind == SHELL_ON_FIRST else pair[3]
    _, _, length, r0, r1 = shell
    if _is_through(shell, best):
        return False
    lowest = -_most(-lowest0, -lowest1, move, bend, dt)  # from the ends
    highest = length - _most(highest0, highest1, move, bend, dt)
    flush = _FLUSH * tiny
    if highest > length + flush or lowest > length + flush:
        return False
    narrow, wide, rise = min(r0, r1), max(r0, r1), abs(r1 - r0)
    # some of the rim may be
    beside = max(outmost0, outmost1) + move > (1.0 + outlines.THROUGH) * narrow
    limit = math.inf if math.isnan(best) else best - tiny
    # A rim well across one end: its nearest point there moves along the end much faster than the
    # rim, but smoothly.
    well = _WELL_ACROSS * move
    across_start = (
        min(highest0, highest1) > well and max(lowest0, lowest1) < -well and highest > 0.0
    )
    across_end = (
        max(lowest0, lowest1) < length - well
        and min(highest0, highest1) > length + well
        and lowest > 0.0
    )
    if (across_start or across_end) and 0.125 * curve * dt * dt <= _SURE:
        return _least(d0, d1, curve, dt) < limit
    if beside or not (lowest >= 0.0 and highest >= 0.0):  # or may come or go at the ends
        margin = move + flush
        d0 = _distance(pair, w, left + _POSE, margin)[0]
        d1 = _distance(pair, w, right + _POSE, margin)[0]
        if max(d0, d1) == math.inf:
            return False
    lip = wide * rise / length  # how deep within the ends a lip can be nearest
    lips = rise > 0.0 and not (lowest >= lip and highest >= lip)
    if limit > 0.0 and (beside or lips):  # such distances are positive
        bend += 4.0 * speed * speed / max(0.5 * (d0 + d1 - move), _NEAR_LIP * wide)
    if 0.125 * bend * dt * dt <= _SURE:
        bend = min(bend, curve)
    return _least(d0, d1, bend, dt) < limit


@routine
def _least_solids(d0, d1, bend, curve, move, dt):
    """What two solids, or a lip and a solid, are nowhere nearer than between two times."""
    low = 0.5 * (d0 + d1 - move)
    if not low > 0.0:
        return low
    bend += (move / dt) ** 2 / low
    if 0.125 * bend * dt * dt <= _SURE:
        bend = min(bend, curve)
    return max(low, _least(d0, d1, bend, dt))
