"""Smallest distance between the outlines of two bodies over a flight, with its time and position:
updated after each integration step.

Within a step every pair of parts is searched by itself: an interval of the step is halved wherever
the pair could be nearer than the minimum so far. A lower bound follows from the relative motion.
The distance is the minimum of many smooth functions of time, one for each pair of points (or point
and plane of a wall), with second derivatives of at most C; between two times dt apart, with the
distances d0 and d1, it is then at least

    d0 + (d1 - d0) u - C dt^2 / 2 u (1 - u),  u in 0 to 1

(Piyavskii's method with a bound of the second derivative). So no minimum between two instants is
missed, and far from the minimum a step takes two distances. The distance of a solid's rim from a
shell ends where the rim leaves the shell: points beyond its ends then count in the bound only by
what they can move.

Checked in `tests/kernel/test_clearances.py` against dense scans.
"""

import math

from sepmc.jit import formula, noinline, routine
from sepmc.physics import outlines, quat, vec3
from sepmc.physics.elementary import sine_cosine
from sepmc.physics.rims import rim_gap
from sepmc.physics.sectors import sector_gap
from sepmc.physics.shell_edge import edge_gap, edge_gap_bound
from sepmc.routines import layout as at
from sepmc.routines.lanes import LANES

# Kinds of pairs: two solids; a rim of a solid within a shell, an edge circle of a shell and a
# solid, or a sector and a solid, with the wall on the first or on the second body.
SOLIDS, SHELL_ON_FIRST, SHELL_ON_SECOND, EDGE_ON_FIRST, EDGE_ON_SECOND = 0, 1, 2, 3, 4
SECTOR_ON_FIRST, SECTOR_ON_SECOND = 5, 6
_SAFE = 2.0  # factor from the largest second difference to the bound of the acceleration
_ROUND_OFF = 1e-14  # of the reach of both parts: smaller differences of distance are ignored
# Times _ROUND_OFF: a rim may be this far beyond the end of its shell and count as within. Rims can
# be flush at the start.
_FLUSH = 100.0
_THROUGH = 1.0 - 1e-9  # of the largest depth of a rim in a wall: then it has passed the wall
_SURE = 1e-7  # m: with a tighter bound than this, C follows from the distances themselves
# Fraction of a shell's radius: smallest distance of a rim from an edge in the bound, whose C grows
# with 1 / distance.
_NEAR_EDGE = 1e-3
# Times the movement of a rim in an interval: a chord this far beyond an end changes smoothly.
_WELL_ACROSS = 256.0
# Limit of the halvings of a step; 10 are typical, 150 where a rim leaves a shell. A step that
# reaches it is abandoned.
_MAX_HALVINGS = 20_000
# Offsets in a node, a time within the step: fraction, distance, C of the interval it ends, pose.
_AT, _VALUE, _CURVATURE, _POSE = 0, 1, 2, 3


@routine
def search_clearance(w, job):
    """Search an integration step for a smaller distance of two outlines than the smallest so far,
    and update the result of the search with it.

    Parameters
    ----------
    w : array
        Workspace.
    job : int
        Position in w of the job: all data of the search, at these offsets from `layout`:

        JOB_TIME, JOB_LENGTH : start and length of the step, s
        JOB_PARTS : position in w of the first part, and number of parts, of outline a, then of b;
        a part has `layout.PART_SIZE` numbers
        JOB_NEAR : position in w of a mark for each pair of parts, LANES apart: the pairs of the
        first part of a, then those of its next part; pairs with 0 are not searched
        JOB_CENTRES : layout points of the centres of mass of bodies a and b
        JOB_POSES : poses (`_pose`) at POSES times of the step, equally far apart
        JOB_PATH : coefficients (JOB_POWERS, PATH) of the powers of the fraction of the step: of the
        vector from a to b (3), and of the attitude quaternions of a and b (4, 4)
        JOB_RESULT : smallest distance, m, its time, s, nearest point of the first body (3, layout,
        m), and 1 on contact, else 0; the distance is NaN at first; updated here
        JOB_DONE : set to 1 if the search was complete, else 0
        JOB_DIRECTION : vector from b to a at the last distance of the pair of solids that is
        searched, from which the next distance starts (3, axes of a, m)
    """
    noinline()
    parts, poses, h = job + at.JOB_PARTS, job + at.JOB_POSES, w[job + at.JOB_LENGTH]
    cg_a, cg_b = vec3.get(w, job + at.JOB_CENTRES), vec3.get(w, job + at.JOB_CENTRES + 3)
    near = int(w[job + at.JOB_NEAR])
    motion, searched = _motion(w, poses, h), True
    for n in range(int(w[parts + 1])):
        pa = int(w[parts]) + at.PART_SIZE * n
        part_a = _part(pa, cg_a, w)
        for m in range(int(w[parts + 3])):
            pb = int(w[parts + 2]) + at.PART_SIZE * m
            part_b = _part(pb, cg_b, w)
            if w[near + (int(w[parts + 3]) * n + m) * LANES] == 0.0:
                continue
            shell_a, shell_b = w[pa] != 0.0, w[pb] != 0.0
            if (shell_a and shell_b) or max(w[pa], w[pb]) == at.SECTOR_ANGLES:
                continue  # two walls: each is paired with the other body's solids
            if max(w[pa], w[pb]) == at.SECTOR:
                kind, position = (SECTOR_ON_FIRST, pa) if shell_a else (SECTOR_ON_SECOND, pb)
                searched = _search((kind, position, part_a, part_b), motion, w, job) and searched
                continue
            kind = SHELL_ON_FIRST if shell_a else (SHELL_ON_SECOND if shell_b else SOLIDS)
            length = part_b[2] if shell_a else part_a[2]
            for end in range(2 if kind != SOLIDS and length > 0.0 else 1):
                searched = _search((kind, end, part_a, part_b), motion, w, job) and searched
            for end in range(2 if kind != SOLIDS else 0):
                edge = EDGE_ON_FIRST if shell_a else EDGE_ON_SECOND
                searched = _search((edge, end, part_a, part_b), motion, w, job) and searched
    w[job + at.JOB_DONE] = 1.0 if searched else 0.0


@routine
def load_outline(w, out, source, parts):
    """Copy the parts of an outline that differs from case to case, for one lane, to w[out] and
    following, in the form of `layout.PART_SIZE`: with a length in place of the second station, 0
    for a point; of the angles of a sector, with the second minus the first in place of the second.
    Both radii of a disc (equal stations) become the larger one.

    Parameters
    ----------
    w : array
        Workspace.
    out : int
        Position of the copy.
    source : int
        Position of the numbers of the parts, LANES apart. Of each part: its kind (0 solid, 1
        hollow, 2 sector); layout point of its start (3); station of its other end (NaN: a point);
        radius at both ends. The angles of a sector follow it, the second in place of the width.
    parts : int
        Number of parts; the angles of a sector count as one more.
    """
    for n in range(parts):
        target, origin = out + at.PART_SIZE * n, source + at.PART_SIZE * n * LANES
        for k in range(at.PART_SIZE):
            w[target + k] = w[origin + k * LANES]
        length = w[target + 4] - w[target + 1]
        w[target + 4] = 0.0 if math.isnan(length) else length
        if length == 0.0:  # a disc has one rim
            w[target + 5] = w[target + 6] = max(w[target + 5], w[target + 6])


@routine
def _part(p, cg, w):
    """Return the part of a body's outline whose numbers are stored at w[p] (`from_layout`, also for
    ``cg``)."""
    return from_layout((w[p], vec3.get(w, p + 1), w[p + 4], w[p + 5], w[p + 6]), cg)


@formula
def from_layout(numbers, cg):
    """Return the part (start, axis, length, r0, r1) of a body's outline, in body axes from the
    centre of mass ``cg`` (layout point, m). ``numbers`` are its kind (not used), the layout point
    of its start, its length aft and its radii, m."""
    _, at_start, length, r0, r1 = numbers
    start = (cg[0] - at_start[0], at_start[1] - cg[1], at_start[2] - cg[2])
    return (start, (-1.0 if length >= 0.0 else 1.0, 0.0, 0.0), abs(length), r0, r1)


@routine
def _pose(theta, w, job, pose):
    """Compute the pose of body b relative to body a at the fraction ``theta`` of the step of a
    job, and store it at w[pose]: the matrix from the axes of b to those of a (9), and the vector
    from the centre of mass of a to that of b, axes of a, m (3)."""
    noinline()
    x, y, z = 0.0, 0.0, 0.0
    a0, a1, a2, a3 = 0.0, 0.0, 0.0, 0.0
    b0, b1, b2, b3 = 0.0, 0.0, 0.0, 0.0
    for q in range(int(w[job + at.JOB_POWERS]) - 1, -1, -1):
        k = job + at.JOB_PATH + at.PATH * q
        x, y, z = x * theta + w[k], y * theta + w[k + 1], z * theta + w[k + 2]
        a0, a1 = a0 * theta + w[k + 3], a1 * theta + w[k + 4]
        a2, a3 = a2 * theta + w[k + 5], a3 * theta + w[k + 6]
        b0, b1 = b0 * theta + w[k + 7], b1 * theta + w[k + 8]
        b2, b3 = b2 * theta + w[k + 9], b3 * theta + w[k + 10]
    rotation, offset = relative_pose((x, y, z), (a0, a1, a2, a3), (b0, b1, b2, b3))
    vec3.put(w, pose, (rotation[0], rotation[1], rotation[2]))
    vec3.put(w, pose + 3, (rotation[3], rotation[4], rotation[5]))
    vec3.put(w, pose + 6, (rotation[6], rotation[7], rotation[8]))
    vec3.put(w, pose + 9, offset)


@formula
def relative_pose(offset, q_a, q_b):
    """Return the pose of body b relative to body a: the matrix from the axes of b to those of a (9,
    by rows), and the vector between their mass centres, axes of a, m. ``offset`` is that vector in
    common axes, ``q_a`` and ``q_b`` are the attitude quaternions, of any length but 0."""
    to, r = quat.matrix(q_a), quat.matrix(q_b)
    x, y, z = (
        vec3.unrotate(to, (r[0], r[3], r[6])),
        vec3.unrotate(to, (r[1], r[4], r[7])),
        vec3.unrotate(to, (r[2], r[5], r[8])),
    )
    rotation = (x[0], y[0], z[0], x[1], y[1], z[1], x[2], y[2], z[2])
    return rotation, vec3.unrotate(to, offset)


@formula
def greatest_rate(change, bend, dt):
    """Return bounds of the rate of a vector and of the rate of that, estimated from its values
    at times ``dt`` s apart: ``change`` is the largest square of its first differences, ``bend``
    that of its second ones."""
    acceleration = _SAFE * math.sqrt(bend) / (dt * dt)
    return math.sqrt(change) / dt + dt * acceleration, acceleration


@routine
def _motion(w, poses, h):
    """Return six bounds of the motion of body b relative to a over a step of ``h`` s, estimated
    from the POSES poses stored at w[poses].

    The first three are speeds: of b's origin in the axes of a, m/s, of a's origin in the axes of b,
    m/s, and of the relative rotation matrix (Frobenius norm of its rate), 1/s. The other three are
    their accelerations, m/s2, m/s2 and 1/s2. Origins are the mass centres.
    """
    noinline()
    dt = h / (at.POSES - 1)
    speed_a, speed_b, axis_speed, accel_a, accel_b, axis_accel = 0.0, 0.0, 0.0, 0.0, 0.0, 0.0
    for n in range(1, at.POSES):
        current, previous = poses + at.POSE * n, poses + at.POSE * (n - 1)
        velocity = vec3.sub(vec3.get(w, current + 9), vec3.get(w, previous + 9))
        velocity_b = vec3.sub(_back(w, current), _back(w, previous))
        speed_a, speed_b = (
            max(speed_a, vec3.dot(velocity, velocity)),
            max(speed_b, vec3.dot(velocity_b, velocity_b)),
        )
        total = 0.0
        for c in range(9):
            total += (w[current + c] - w[previous + c]) ** 2
        axis_speed = max(axis_speed, total)
        if n > 1:
            first = previous - at.POSE
            previous_velocity = vec3.sub(vec3.get(w, previous + 9), vec3.get(w, first + 9))
            difference = vec3.sub(velocity, previous_velocity)
            difference_b = vec3.sub(velocity_b, vec3.sub(_back(w, previous), _back(w, first)))
            accel_a, accel_b = (
                max(accel_a, vec3.dot(difference, difference)),
                max(accel_b, vec3.dot(difference_b, difference_b)),
            )
            total = 0.0
            for c in range(9):
                total += (w[current + c] - 2.0 * w[previous + c] + w[first + c]) ** 2
            axis_accel = max(axis_accel, total)
    (speed_a, accel_a), (speed_b, accel_b), (axis_speed, axis_accel) = (
        greatest_rate(speed_a, accel_a, dt),
        greatest_rate(speed_b, accel_b, dt),
        greatest_rate(axis_speed, axis_accel, dt),
    )
    return speed_a, speed_b, axis_speed, accel_a, accel_b, axis_accel


@routine
def _back(w, pose):
    """Return the vector from the origin of body a to that of b, in the axes of b, for the pose
    stored at w[pose] (`_pose`)."""
    return vec3.unrotate(vec3.get_matrix(w, pose), vec3.get(w, pose + 9))


@formula
def reach(part):
    """Return an upper bound of the distance of the points of a part from the origin of its axes,
    m."""
    start, axis, length, r0, r1 = part
    end = vec3.add(start, vec3.scale(length, axis))
    return max(math.sqrt(vec3.dot(start, start)) + r0, math.sqrt(vec3.dot(end, end)) + r1)


@routine
def _is_rim(kind):
    """Return True if a pair is of the kind rim of a solid within a shell. Its distance exists only
    while the rim is between the ends of the shell."""
    return kind in (SHELL_ON_FIRST, SHELL_ON_SECOND)


@routine
def _is_through(shell, best):
    """Return True if the smallest distance so far, ``best``, is that of a rim that has passed the
    wall of the shell by the largest depth (`outlines.inside_gap`): no distance is smaller."""
    return best <= -_THROUGH * outlines.THROUGH * max(shell[3], shell[4])


@routine
def _placed(part, w, pose):
    """Transform a part of body b from its own axes to the axes of body a, for the pose stored at
    w[pose] (`_pose`)."""
    return placed(part, vec3.get_matrix(w, pose), vec3.get(w, pose + 9))


@formula
def placed(part, rotation, offset):
    """Transform a part of body b from its own axes to the axes of body a, for a pose
    (`relative_pose`)."""
    start, axis, length, r0, r1 = part
    at_start = vec3.add(offset, vec3.rotate(rotation, start))
    return at_start, vec3.rotate(rotation, axis), length, r0, r1


@routine
def _from_other(part, w, pose):
    """Transform a part of body a from its own axes to the axes of body b, for the pose stored at
    w[pose] (`_pose`)."""
    start, axis, length, r0, r1 = part
    r = vec3.get_matrix(w, pose)
    return (
        vec3.unrotate(r, vec3.sub(start, vec3.get(w, pose + 9))),
        vec3.unrotate(r, axis),
        length,
        r0,
        r1,
    )


@routine
def _sector(part, p, w):
    """Return the sector (start, axis, length, r0, r1, x, y, width; see `sepmc.physics.sectors`), in
    body axes, of a ``part`` whose numbers, followed by the angles, are stored at w[p]."""
    start, axis, length, r0, r1 = part
    angles = p + at.PART_SIZE
    s, c = sine_cosine(w[angles + 1])
    return start, axis, length, r0, r1, (0.0, -s, c), (0.0, -c, -s), w[angles + 4]


@routine
def _rim(part, end):
    """Return the rim (centre, normal, radius) of a part at its start (``end`` 0) or at its other
    end (1). The normal of both is the part's axis, which points from its start to its end."""
    start, axis, length, r0, r1 = part
    if end == 0:
        return start, axis, r0
    return vec3.add(start, vec3.scale(length, axis)), axis, r1


@routine
def _distance(pair, w, job, pose, margin):
    """Return the distance of a pair of parts at the pose stored at w[pose], m, and the nearest
    point of body a, axes of a.

    ``pair`` is (kind, end, part of a, part of b), each part in the axes of its body; kinds are
    SOLIDS, SHELL_ON_FIRST, ... . ``end`` is the end (0 or 1) of the part whose rim or edge counts;
    for a sector it is the position of its numbers in w. ``job`` is the position of the job, of
    which the direction of two solids is used and updated. For a rim and a shell the distance is
    that of `rims.rim_gap`: negative through the wall, infinite beyond the ends; ``margin``, m, is 0
    for this distance, and above 0 for a bound of it after a motion by up to ``margin``. Other kinds
    do not use ``margin``.
    """
    noinline()
    kind, end, part_a, part = pair
    part_b = _placed(part, w, pose)
    if kind == SOLIDS:
        last = job + at.JOB_DIRECTION
        distance, point, other = outlines.gap_from(part_a, part_b, vec3.get(w, last))
        vec3.put(w, last, vec3.sub(point, other))
    elif kind == SHELL_ON_FIRST:
        distance, _, point = rim_gap(_rim(part_b, end), part_a, margin)
    elif kind == SHELL_ON_SECOND:
        distance, point, _ = rim_gap(_rim(part_a, end), part_b, margin)
    elif kind == EDGE_ON_FIRST:
        distance, point, _ = edge_gap(_rim(part_a, end), part_b)
    elif kind == EDGE_ON_SECOND:
        distance, _, point = edge_gap(_rim(part_b, end), part_a)
    elif kind == SECTOR_ON_FIRST:
        distance, point, _ = sector_gap(_sector(part_a, end, w), part_b)
    else:  # in the axes of b, in which the angles of the sector are
        distance, _, point = sector_gap(_sector(part, end, w), _from_other(part_a, w, pose))
        point = vec3.add(vec3.get(w, pose + 9), vec3.rotate(vec3.get_matrix(w, pose), point))
    return distance, point


@routine
def _far(pair, w, pose):
    """Return a lower bound of the distance of a pair (`_distance`) at the pose stored at w[pose],
    m, at low cost. For a rim and a shell it is a bound of the unsigned distance."""
    kind, end, part_a, part = pair
    part_b = _placed(part, w, pose)
    if kind in (SOLIDS, SECTOR_ON_FIRST, SECTOR_ON_SECOND):
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
    """Return, for a pair of a rim and a shell (`_distance`) at the pose stored at w[pose], three
    numbers, m: the smallest and the largest coordinate of the rim along the axis of the shell, 0
    at the start of the shell, and an upper bound of the distance of its points from that axis."""
    kind, end, part_a, part = pair
    part_b = _placed(part, w, pose)
    solid, shell = (part_b, part_a) if kind == SHELL_ON_FIRST else (part_a, part_b)
    centre, normal, radius = _rim(solid, end)
    tilt = vec3.cross(normal, shell[1])
    half = radius * math.sqrt(vec3.dot(tilt, tilt))
    middle, across = vec3.split(vec3.sub(centre, shell[0]), shell[1])
    return middle - half, middle + half, math.sqrt(vec3.dot(across, across)) + radius


@routine
def _least(d0, d1, curvature, dt):
    """Return a lower bound of a function of time in an interval of length ``dt``, from its values
    d0 and d1 at the ends, if its second derivative (with its sign) is at most ``curvature``."""
    s, c = d1 - d0, 0.5 * curvature * dt * dt
    if abs(s) >= c:
        return min(d0, d1)
    return d0 - (c - s) ** 2 / (4.0 * c)


@routine
def _most(x0, x1, move, curvature, dt):
    """Return an upper bound of a coordinate in an interval of length ``dt``, from its values x0 and
    x1 at the ends, if it moves by at most ``move`` and the size of its second derivative is at most
    ``curvature``: the lower one of the bounds by each of these, the first being the larger end
    value plus ``move``."""
    return min(max(x0, x1) + move, -_least(-x0, -x1, curvature, dt))


@routine
def _note(distance, point, time, w, job):
    """Store a new smallest ``distance`` as the result of a job, with its ``time``, the nearest
    ``point`` of the first body (given in its axes, stored in layout coordinates), and 1 on contact,
    else 0."""
    result, cg = job + at.JOB_RESULT, vec3.get(w, job + at.JOB_CENTRES)
    w[result], w[result + 1] = distance, time
    vec3.put(w, result + 2, (cg[0] - point[0], cg[1] + point[1], cg[2] + point[2]))
    w[result + 5] = 1.0 if distance <= 0.0 else 0.0


@routine
def _search(pair, motion, w, job):
    """Search the step of a job, whose numbers begin at w[job] (`search_clearance`), for a smaller
    distance of a pair of parts than the job's result, or for an earlier contact, and update the
    result. Returns True if the whole step was searched, False if the limit of halvings was reached.

    ``pair`` is as in `_distance`; ``motion`` has the bounds of `_motion`. The step is halved from
    left to right, depth first. The first of the job's nodes is the left end of the current
    interval, node ``top`` its right end; the nodes between are the right ends of the intervals that
    follow.
    """
    noinline()
    kind, _, part_a, part_b = pair
    size, h = reach(part_a) + reach(part_b), w[job + at.JOB_LENGTH]
    if kind == SHELL_ON_SECOND:
        speed, curvature = (
            motion[1] + motion[2] * reach(part_a),
            motion[4] + motion[5] * reach(part_a),
        )
    else:
        speed, curvature = (
            motion[0] + motion[2] * reach(part_b),
            motion[3] + motion[5] * reach(part_b),
        )
    tiny = _ROUND_OFF * size
    shell = part_a if kind == SHELL_ON_FIRST else part_b
    limit = w[job + at.JOB_RESULT]  # NaN: no distance so far
    if _is_rim(kind):
        if _is_through(shell, limit):
            return True
        limit = (
            max(limit, outlines.THROUGH * max(shell[3], shell[4]))
            if not math.isnan(limit)
            else math.inf
        )
    elif limit < 0.0:
        return True
    first, last = job + at.JOB_POSES, job + at.JOB_POSES + at.POSE * (at.POSES - 1)
    move = speed * h  # at most, so that the distance is at least half of: both ends - move
    at_first = _far(pair, w, first)
    if at_first - move > limit:
        return True
    at_last = _far(pair, w, last)
    if 0.5 * (at_first + at_last - move) > limit:
        return True
    left, static = job + at.JOB_NODES, not move > tiny
    vec3.put(w, job + at.JOB_DIRECTION, (0.0, 0.0, 0.0))
    for end in range(1 if static else 2):
        if end == 1 and not _is_rim(kind):
            known = w[left + _VALUE]  # most pairs that are never the nearest end here
            if 0.5 * (known + at_last - move) > w[job + at.JOB_RESULT]:
                return True
        node = left + at.NODE * end
        for n in range(at.POSE):
            w[node + _POSE + n] = w[(last if end else first) + n]
        w[node + _AT], w[node + _CURVATURE] = float(end), math.inf
        _visit(pair, w, job, node, tiny)
    top, halvings = 0 if static else 1, 0
    while top > 0 and halvings < _MAX_HALVINGS:
        right = left + at.NODE * top
        dt = (w[right + _AT] - w[left + _AT]) * h
        if top > at.DEPTH or not _worth_halving(pair, w, job, right, curvature, speed, dt, tiny):
            for n in range(at.NODE):
                w[left + n] = w[right + n]
            top -= 1
            continue
        middle = right + at.NODE
        w[middle + _AT] = 0.5 * (w[left + _AT] + w[right + _AT])
        _pose(w[middle + _AT], w, job, middle + _POSE)
        _visit(pair, w, job, middle, tiny)
        value_left, value, value_right = w[left + _VALUE], w[middle + _VALUE], w[right + _VALUE]
        estimate = math.inf
        if max(value_left, value, value_right) < math.inf:  # twice the second derivative
            estimate = 8.0 * abs(value_left - 2.0 * value + value_right) / (dt * dt)
        w[middle + _CURVATURE] = w[right + _CURVATURE] = estimate
        top += 1
        halvings += 1
    return top == 0


@routine
def _visit(pair, w, job, node, tiny):
    """Evaluate the distance of a pair at the pose of a node and store it in the node. It becomes
    the result of the job, too, if it is smaller by more than ``tiny`` m, an earlier contact, the
    first distance, or NaN."""
    noinline()
    distance, point = _distance(pair, w, job, node + _POSE, _FLUSH * tiny)
    w[node + _VALUE] = distance
    time = w[job + at.JOB_TIME] + w[node + _AT] * w[job + at.JOB_LENGTH]
    best, best_time = w[job + at.JOB_RESULT], w[job + at.JOB_RESULT + 1]
    if (
        distance < best - tiny
        or (math.isnan(best) and distance < math.inf)
        or (distance == best == 0.0 and time < best_time)
        or math.isnan(distance)
    ):
        _note(distance, point, time, w, job)


@routine
def _worth_halving(pair, w, job, right, curvature, speed, dt, tiny):
    """Return True if the interval from the first node of a job to the one at w[right] has to be
    halved: the pair may be nearer in it than the smallest distance so far by more than ``tiny`` m,
    or in contact earlier.

    ``speed`` and ``curvature`` bound the relative motion, m/s and m/s2; ``dt`` is the length of the
    interval, s.
    """
    noinline()
    left, best = job + at.JOB_NODES, w[job + at.JOB_RESULT]
    kind, d0, d1, estimate = pair[0], w[left + _VALUE], w[right + _VALUE], w[right + _CURVATURE]
    move = speed * dt
    if not move > tiny:
        return False
    if not _is_rim(kind):
        if best == 0.0:  # only an earlier contact counts
            may_touch = d1 == 0.0 or _least_solids(d0, d1, curvature, estimate, move, dt) < 0.0
            time = w[job + at.JOB_TIME] + w[left + _AT] * w[job + at.JOB_LENGTH]
            return may_touch and d0 > 0.0 and time < w[job + at.JOB_RESULT + 1]
        return _least_solids(d0, d1, curvature, estimate, move, dt) < best - tiny
    lowest0, highest0, outmost0 = _along(pair, w, left + _POSE)
    lowest1, highest1, outmost1 = _along(pair, w, right + _POSE)
    shell = pair[2] if kind == SHELL_ON_FIRST else pair[3]
    _, _, length, r0, r1 = shell
    if _is_through(shell, best):
        return False
    lowest = -_most(-lowest0, -lowest1, move, curvature, dt)  # from the ends
    highest = length - _most(highest0, highest1, move, curvature, dt)
    flush = _FLUSH * tiny
    if highest > length + flush or lowest > length + flush:
        return False
    narrow, wide, rise = min(r0, r1), max(r0, r1), abs(r1 - r0)
    # some of the rim may be beside
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
    if (across_start or across_end) and 0.125 * estimate * dt * dt <= _SURE:
        return _least(d0, d1, estimate, dt) < limit
    if beside or not (lowest >= 0.0 and highest >= 0.0):  # or it may cross an end
        margin = move + flush
        d0 = _distance(pair, w, job, left + _POSE, margin)[0]
        d1 = _distance(pair, w, job, right + _POSE, margin)[0]
        if max(d0, d1) == math.inf:
            return False
    edge_depth = wide * rise / length  # depth within the ends at which an edge can be nearest
    edges = rise > 0.0 and not (lowest >= edge_depth and highest >= edge_depth)
    if limit > 0.0 and (beside or edges):  # these distances are positive
        curvature += 4.0 * speed * speed / max(0.5 * (d0 + d1 - move), _NEAR_EDGE * wide)
    if 0.125 * curvature * dt * dt <= _SURE:
        curvature = min(curvature, estimate)
    return _least(d0, d1, curvature, dt) < limit


@routine
def _least_solids(d0, d1, curvature, estimate, move, dt):
    """Return a lower bound, m, of the distance of two solids, of a sector or an edge and a solid,
    between two times ``dt`` s apart, from its values d0 and d1 there.

    The relative movement is at most ``move`` m; ``curvature`` bounds the relative acceleration,
    m/s2. ``estimate``, of the second derivative of the distance, m/s2, replaces the bound of that
    only where even the bound would lower the result by at most `_SURE`. If the distance may reach
    0, the result is not above 0.
    """
    low = 0.5 * (d0 + d1 - move)
    if not low > 0.0:
        return low
    curvature += (move / dt) ** 2 / low
    if 0.125 * curvature * dt * dt <= _SURE:
        curvature = min(curvature, estimate)
    return max(low, _least(d0, d1, curvature, dt))
