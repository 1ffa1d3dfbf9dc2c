"""Screening of a step for a clearance, in all lanes at once: whether the outlines of two bodies may
come nearer than the smallest distance so far. Few steps may; only these are searched
(`sepmc.routines.clearances`), one lane after the other.

The numbers of the screening are a field of the workspace: components at the offsets SCREEN_ from
`sepmc.routines.layout`, each LANES numbers. In the functions here, ``screen`` is the position of
that field.
"""

from sepmc.jit import formula, noinline, routine
from sepmc.physics import outlines
from sepmc.routines import layout as at
from sepmc.routines.clearances import from_layout, greatest_rate, placed, reach, relative_pose
from sepmc.routines.lanes import LANES, get3, get4, get9, larger, put3, put9

_POINT = at.SCREEN_POINT * LANES
_MOVE, _TURN = at.SCREEN_MOVE * LANES, at.SCREEN_TURN * LANES
_PART_A, _PART_B = at.SCREEN_PART_A * LANES, at.SCREEN_PART_B * LANES
_LIMIT, _NEAR, _PAIR = (k * LANES for k in (at.SCREEN_LIMIT, at.SCREEN_NEAR, at.SCREEN_PAIR))


@routine
def screen_motion(w, screen, powers):
    """Compute the poses of body b relative to body a at POSES times of a step, and from them bounds
    of the relative motion, in all lanes.

    Parameters
    ----------
    w : array
        Workspace.
    screen : int
        Position of the screening, of which SCREEN_PATH is read: ``powers`` coefficients of the
        motion, as in `clearances.search_clearance`. Written are SCREEN_POSES, the poses, and the
        bounds SCREEN_MOVE, of the movement of b's origin in the axes of a over the step, m, and
        SCREEN_TURN, of the change of the relative rotation matrix (Frobenius norm).
    powers : int
        Number of coefficients.
    """
    noinline()
    path, point, poses = (
        screen + at.SCREEN_PATH * LANES,
        screen + _POINT,
        screen + at.SCREEN_POSES * LANES,
    )
    for n in range(at.POSES):
        theta, pose = n / (at.POSES - 1), poses + at.POSE * n * LANES
        for e in range(0, at.PATH * LANES, LANES):
            for l in range(LANES):
                value = 0.0
                for q in range(powers - 1, -1, -1):
                    value = value * theta + w[path + q * at.PATH * LANES + e + l]
                w[point + e + l] = value
        for l in range(LANES):
            offset, q_a = get3(w, point + l), get4(w, point + 3 * LANES + l)
            rotation, offset = relative_pose(offset, q_a, get4(w, point + 7 * LANES + l))
            put9(w, pose + l, rotation)
            put3(w, pose + 9 * LANES + l, offset)
    _bound_changes(w, screen + _MOVE, poses + 9 * LANES, 3)
    _bound_changes(w, screen + _TURN, poses, 9)


@routine
def _bound_changes(w, out, first, count):
    """Store, in all lanes, a bound of the change over a step of a vector of ``count`` numbers of
    the poses, estimated from its differences between them (`clearances.greatest_rate`). ``first``
    is the position of its first number in the first pose, ``out`` that of the bound; the component
    after ``out`` is scratch."""
    for l in range(LANES):
        w[out + l] = w[out + LANES + l] = 0.0
    for n in range(2, at.POSES):
        pose = first + at.POSE * n * LANES
        before, earliest = pose - at.POSE * LANES, pose - 2 * at.POSE * LANES
        for l in range(LANES):
            early, late, bend = 0.0, 0.0, 0.0
            for k in range(count):
                c = k * LANES + l
                one, other = w[before + c] - w[earliest + c], w[pose + c] - w[before + c]
                early, late = early + one * one, late + other * other
                bend += (other - one) * (other - one)
            w[out + l] = larger(w[out + l], larger(early, late))
            w[out + LANES + l] = larger(w[out + LANES + l], bend)
    for l in range(LANES):
        w[out + l] = greatest_rate(w[out + l], w[out + LANES + l], 1.0 / (at.POSES - 1))[0]


@routine
def screen_parts(w, screen, near, first_a, step_a, count_a, first_b, step_b, count_b):
    """Mark, in each lane, the pairs of a part of body a and one of body b that may come nearer than
    SCREEN_LIMIT (m; NaN: no distance so far) during the step. SCREEN_NEAR, of the whole lane, also
    becomes 1 where a pair is marked; it is never set to 0 here, so several calls add up.

    Parameters
    ----------
    w : array
        Workspace.
    screen : int
        Position of the screening, after `screen_motion`; SCREEN_CENTRES has the layout points of
        the centres of mass of bodies a and b.
    near : int
        Position in w of the marks of the pairs, which are written, 1 or 0 in each lane: ``count_b``
        marks of the first part of a, then those of its next part.
    first_a, first_b : int
        Position in w of the first part of each outline, for lane 0.
    step_a, step_b : int
        Distance in w from a part to that of the next lane; 0 if all lanes have the same.
    count_a, count_b : int
        Numbers of parts.
    """
    noinline()
    pose = screen + at.SCREEN_POSES * LANES
    centre_a = screen + at.SCREEN_CENTRES * LANES
    for m in range(count_b):
        b = first_b + at.PART_SIZE * m
        _load_part(w, screen + _PART_B, b, step_b)
        for l in range(LANES):
            part = from_layout(_part(w, screen + _PART_B + l), get3(w, centre_a + 3 * LANES + l))
            w[screen + at.SCREEN_REACH * LANES + l] = reach(part)
            moved = placed(part, get9(w, pose + l), get3(w, pose + 9 * LANES + l))
            put3(w, screen + at.SCREEN_PLACED * LANES + l, moved[0])
            put3(w, screen + (at.SCREEN_PLACED + 3) * LANES + l, moved[1])
        for n in range(count_a):
            a = first_a + at.PART_SIZE * n
            _load_part(w, screen + _PART_A, a, step_a)
            _screen_pair(w, screen)
            mark = near + (count_b * n + m) * LANES
            for l in range(LANES):
                w[mark + l] = w[screen + _PAIR + l]
                w[screen + _NEAR + l] = larger(w[screen + _NEAR + l], w[screen + _PAIR + l])


@routine
def _load_part(w, out, source, step):
    """Copy a part of an outline, whose numbers are at w[source] for lane 0 and ``step`` further on
    for every next lane, to the components at w[out]."""
    for k in range(at.PART_SIZE):
        for l in range(LANES):
            w[out + k * LANES + l] = w[source + step * l + k]


@formula
def _part(w, k):
    """Return a lane's part of an outline, whose first component is at w[k], as `from_layout` takes
    it: kind, layout point of its start (tuple of 3), length aft and the two radii, m."""
    return (
        w[k], get3(w, k + LANES), w[k + 4 * LANES], w[k + 5 * LANES], w[k + 6 * LANES],
    )  # fmt: skip


@routine
def _screen_pair(w, screen):
    """Set SCREEN_PAIR to 1 in lanes in which the pair of parts that is loaded may come nearer than
    SCREEN_LIMIT, else to 0. A wall counts as the solid that it encloses, which is as near or
    nearer; a rim that has passed a wall is searched, up to the depth at which it no longer
    counts."""
    centre_a, placed_b = screen + at.SCREEN_CENTRES * LANES, screen + at.SCREEN_PLACED * LANES
    for l in range(LANES):
        a, b = _part(w, screen + _PART_A + l), _part(w, screen + _PART_B + l)
        part_a = from_layout(a, get3(w, centre_a + l))
        part_b = (get3(w, placed_b + l), get3(w, placed_b + 3 * LANES + l), abs(b[2]), b[3], b[4])
        turn, size = w[screen + _TURN + l], w[screen + at.SCREEN_REACH * LANES + l]
        move = w[screen + _MOVE + l] + turn * size
        depth = outlines.THROUGH * larger(
            larger(a[3], a[4]) if a[0] != 0.0 else 0.0, larger(b[3], b[4]) if b[0] != 0.0 else 0.0
        )
        limit = w[screen + _LIMIT + l]
        limit = depth if limit < depth else limit
        is_far = outlines.gap_bound(part_a, part_b) - move > limit
        w[screen + _PAIR + l] = 0.0 if is_far else 1.0
