"""The clearance of two bodies found anew from the sentences of CONVENTIONS.md, "Outline": numpy
only, no code of the kernels.

Arrays lead with the poses (n,): many attitudes and places of one body seen from the other are
worked on at once. A frustum is the tuple (start (n, 3), axis (n, 3), length, r0, r1). Distances of
solids come with a proof: their nearest points, and a slab between them.
"""

from collections.abc import Callable

import numpy as np
from scipy.spatial.transform import Rotation

Array = np.ndarray
THROUGH = 0.1  # share of a shell's radius within which a point outside has gone through its wall
_ANGLES = 360  # of a rim, at first
_SECTORS = 8  # of a lip
_ZOOMS = 9  # each narrows the angle, or the time, by ten; at most
_SAME = 1e-12  # m: two zooms in a row that gain no more have found what there is
_STEPS, _FEW = 2000, 60  # of the projections, at most; where only the order of distances counts
_PROVED = 1e-9  # m


def on_frustum(points: Array, frustum: tuple) -> Array:
    """Nearest points (n, 3) of solid frustums to points (n, 3)."""
    start, axis, length, r0, r1 = frustum
    from_start = points - start
    along = np.einsum("ij,ij->i", from_start, axis)
    across = from_start - along[:, None] * axis
    rho = np.sqrt(np.einsum("ij,ij->i", across, across))
    # in the plane of the axis and the point: which of both ends and the side is nearest
    rise, square = r1 - r0, length**2 + (r1 - r0) ** 2
    share = (
        _between((along * length + (rho - r0) * rise) / square, 0.0, 1.0)
        if square > 0.0
        else np.zeros_like(along)
    )
    z, r = share * length, r0 + share * rise
    squares = (along - z) ** 2 + (rho - r) ** 2
    for end, radius in ((0.0, r0), (length, r1)):
        disc = np.minimum(rho, radius)
        off = (along - end) ** 2 + (rho - disc) ** 2
        nearer = off < squares
        z, r = np.where(nearer, end, z), np.where(nearer, disc, r)
        squares = np.where(nearer, off, squares)
    side = r0 + rise * (_between(along / length, 0.0, 1.0) if length > 0.0 else 0.0)
    within = (along >= 0.0) & (along <= length) & (rho <= side)
    # how far the nearest point is from the point: along the axis, and as a share of rho
    z = np.where(within, 0.0, along - z)
    out = np.where(within, 0.0, (rho - r) / np.where(rho > 0.0, rho, 1.0))
    return points - z[:, None] * axis - out[:, None] * across


def _between(values: Array, least: float, most: float) -> Array:
    """Values no less and no more than so much; `numpy.clip` takes twice as long."""
    return np.minimum(np.maximum(values, least), most)


def reach(frustum: tuple, u: Array) -> Array:
    """Greatest u . p (n,) over frustums: the further of the two discs."""
    start, axis, length, r0, r1 = frustum
    slope = np.einsum("ij,ij->i", u, axis)
    across = np.sqrt(np.maximum(1.0 - slope**2, 0.0))
    return np.einsum("ij,ij->i", u, start) + np.maximum(r0 * across, length * slope + r1 * across)


def solid_distance(a: tuple, b: tuple, steps: int = _STEPS) -> tuple[Array, Array]:
    """Distances (n,) of solid frustums, m, and how far they are proved: no distance is less than
    itself minus that.

    Projections on one and the other in turn, with momentum (Nesterov), which converge to the
    nearest points of convex bodies: from the middle and from both ends of each, since along sides
    that are all but parallel they converge slowly. Along ends that are all but parallel they hardly
    do at all: what is not proved by then is sought along the rims.
    """
    whole = a, b
    shares, count = (0.0, 0.5, 1.0), len(a[0])
    starts = [
        on_frustum(part[0] + share * part[2] * part[1], b) for part in (a, b) for share in shares
    ]
    a, b = (
        (np.tile(part[0], (len(starts), 1)), np.tile(part[1], (len(starts), 1)), *part[2:])
        for part in (a, b)
    )
    q = np.concatenate(starts)
    ahead, momentum = q, np.ones(len(q))
    best, proved = np.full(count, np.inf), np.full(count, -np.inf)
    for step in range(steps):
        p = on_frustum(ahead, a)
        new = on_frustum(p, b)
        # going the wrong way: begin the momentum anew
        turned = np.einsum("ij,ij->i", ahead - new, new - q) > 0.0
        follow = 0.5 * (1.0 + np.sqrt(1.0 + 4.0 * momentum**2))
        share = np.where(turned, 0.0, (momentum - 1.0) / follow)
        momentum = np.where(turned, 1.0, follow)
        ahead, q = new + share[:, None] * (new - q), new
        if step % 20 == 19:
            p = on_frustum(q, a)
            apart = q - p
            distance = np.linalg.norm(apart, axis=1)
            u = apart / np.where(distance > 0.0, distance, 1.0)[:, None]
            slab = np.where(distance > 0.0, -reach(b, -u) - reach(a, u), 0.0)
            best = np.minimum(best, distance.reshape(-1, count).min(axis=0))
            proved = np.maximum(proved, slab.reshape(-1, count).max(axis=0))
            if np.all((best - proved < _PROVED) | (best < _PROVED)):
                break
    doubtful = best - np.maximum(proved, 0.0) > _PROVED
    if doubtful.any():
        one, other = ((part[0][doubtful], part[1][doubtful], *part[2:]) for part in whole)
        around = [
            lip_distance(rim, solid)
            for part, solid in ((one, other), (other, one))
            for rim in _rims(part)
        ]
        best[doubtful] = np.minimum(best[doubtful], np.min(around, axis=0))
    return best, best - np.maximum(proved, 0.0)


def _rims(frustum: tuple) -> list[tuple]:
    """Both rims of frustums, each as centre (n, 3), normal (n, 3) and radius."""
    start, axis, length, r0, r1 = frustum
    return [(start, axis, r0), (start + length * axis, axis, r1)]


def rim_distance(rim: tuple, shell: tuple) -> Array:
    """Least signed distances (n,) of rims from the inside of shells, m; infinite where no point of
    the rim is between the ends.

    rim : centre (n, 3), normal (n, 3), radius
    """
    centre, normal, radius = rim
    start, axis, length, r0, r1 = shell
    u, v = _in_plane(normal)

    def signed(angle: Array) -> Array:
        """Of the points of the rim at angles (n, k)."""
        point = _circle(rim, u, v, angle)
        from_start = point - start[:, None]
        along = np.einsum("ikj,ij->ik", from_start, axis)
        rho = np.linalg.norm(from_start - along[..., None] * axis[:, None], axis=2)
        out = rho - r0 - (r1 - r0) * along / length
        share = np.clip(
            (along * length + (rho - r0) * (r1 - r0)) / (length**2 + (r1 - r0) ** 2), 0.0, 1.0
        )
        distance = np.hypot(along - share * length, rho - r0 - share * (r1 - r0))
        through = (out > 0.0) & (out <= THROUGH * (rho - out))
        return np.where(
            (along < 0.0) | (along > length), np.inf, np.where(through, -distance, distance)
        )

    # angles at which the rim meets the planes of the ends
    slope_u, slope_v = np.einsum("ij,ij->i", u, axis), np.einsum("ij,ij->i", v, axis)
    half, top = radius * np.hypot(slope_u, slope_v), np.arctan2(slope_v, slope_u)
    middle = np.einsum("ij,ij->i", centre - start, axis)
    grid = np.broadcast_to(
        np.linspace(0.0, 2.0 * np.pi, _ANGLES, endpoint=False), (len(centre), _ANGLES)
    )
    ends = []
    for plane in (0.0, length):
        share = (plane - middle) / np.where(half > 0.0, half, 1.0)
        turn = np.arccos(np.clip(share, -1.0, 1.0))
        ends += [top + s * turn * (1.0 + e) for s in (1.0, -1.0) for e in (-1e-13, 1e-13)]
    return _zoom(signed, np.concatenate([grid, np.stack(ends, axis=1)], axis=1))


def lip_distance(lip: tuple, solid: tuple) -> Array:
    """Least distances (n,) of circles, which stand as rims do, from solid frustums, m."""
    # a least of every sector: where the solid is all but met, dips are narrow
    n, each = len(lip[0]), _ANGLES // _SECTORS
    grid = np.repeat(2.0 * np.pi / _ANGLES * np.arange(_ANGLES).reshape(_SECTORS, each), n, axis=0)
    lip, solid = (
        (np.tile(one[0], (_SECTORS, 1)), np.tile(one[1], (_SECTORS, 1)), *one[2:])
        for one in (lip, solid)
    )
    u, v = _in_plane(lip[1])
    flat = {}

    def distance(angle: Array) -> Array:
        """Of the points of the circle at angles (n, k)."""
        points = _circle(lip, u, v, angle)
        n, k = angle.shape
        if k not in flat:
            flat[k] = (np.repeat(solid[0], k, axis=0), np.repeat(solid[1], k, axis=0), *solid[2:])
        points = points.reshape(-1, 3)
        return np.linalg.norm(points - on_frustum(points, flat[k]), axis=1).reshape(n, k)

    return _zoom(distance, grid).reshape(_SECTORS, -1).min(axis=0)


def _in_plane(normal: Array) -> tuple[Array, Array]:
    """Two unit vectors (n, 3) normal to unit vectors (n, 3) and to each other."""
    other = np.where(np.abs(normal[:, :1]) < 0.6, [[1.0, 0.0, 0.0]], [[0.0, 1.0, 0.0]])
    u = np.cross(normal, other)
    u /= np.linalg.norm(u, axis=1)[:, None]
    return u, np.cross(normal, u)


def _circle(rim: tuple, u: Array, v: Array, angle: Array) -> Array:
    """Points (n, k, 3) of circles at angles (n, k)."""
    return rim[0][:, None] + rim[2] * (
        np.cos(angle)[..., None] * u[:, None] + np.sin(angle)[..., None] * v[:, None]
    )


def _zoom(value: Callable[[Array], Array], angles: Array) -> Array:
    """Least values (n,) of a function of angles: the best of some (n, k), then closer and closer
    around it."""
    values = value(angles)
    width, rows = 2.0 * np.pi / _ANGLES, np.arange(len(angles))
    least, idle = values.min(axis=1), 0
    for _ in range(_ZOOMS):
        chosen = np.argmin(values, axis=1)
        angle = angles[rows, chosen]
        # the middle one is the best so far
        angles = angle[:, None] + width * np.linspace(-1.0, 1.0, 21)
        values = np.minimum(
            value(angles), np.where(np.arange(21) == 10, values[rows, chosen][:, None], np.inf)
        )
        width *= 0.1
        before, least = least, values.min(axis=1)
        idle = 0 if np.any(before > least + _SAME) else idle + 1
        if idle == 2:
            break
    return least


def parts_of(body) -> list[tuple[bool, Array, Array, float, float, float]]:
    """Parts of a body's outline in its axes: (hollow, start (3,), axis (3,), length, r0, r1), from
    its centre of mass."""
    cg, found = np.array(body.cg), []

    def place(station: float, y: float, z: float) -> Array:
        return np.array([cg[0] - station, y - cg[1], z - cg[2]])

    for part in body.outline:
        if part.stations is not None:
            (s0, s1), (r0, r1) = part.stations, part.radii
            axis = np.array([-1.0 if s1 >= s0 else 1.0, 0.0, 0.0])
            found.append((part.hollow, place(s0, *part.offset), axis, abs(s1 - s0), r0, r1))
        found += [
            (False, place(*point), np.array([1.0, 0.0, 0.0]), 0.0, 0.0, 0.0)
            for point in part.points
        ]
    return found


def outline_distance(
    parts_a: list, parts_b: list, attitudes: Array, places: Array, steps: int = _STEPS
) -> Array:
    """Clearances (n,) of two outlines, m; b is seen from a in attitudes (n, 3, 3) at places (n,
    3)."""
    n, best = len(places), np.full(len(places), np.inf)
    for hollow_a, start_a, axis_a, *size_a in parts_a:
        a = (np.broadcast_to(start_a, (n, 3)), np.broadcast_to(axis_a, (n, 3)), *size_a)
        for hollow_b, start_b, axis_b, *size_b in parts_b:
            b = (places + attitudes @ start_b, attitudes @ axis_b, *size_b)
            if hollow_a and hollow_b:
                continue
            if hollow_a or hollow_b:
                solid, shell = (b, a) if hollow_a else (a, b)
                rims = _rims(solid) if solid[2] > 0.0 else [(solid[0], solid[1], max(solid[3:]))]
                for rim in rims:
                    best = np.minimum(best, rim_distance(rim, shell))
                for share, radius in ((0.0, shell[3]), (shell[2], shell[4])):
                    best = np.minimum(
                        best, lip_distance((shell[0] + share * shell[1], shell[1], radius), solid)
                    )
            else:
                near = _axes_apart(a, b) < best  # the others are further than what is known
                if near.any():
                    of_a, of_b = ((part[0][near], part[1][near], *part[2:]) for part in (a, b))
                    best[near] = np.minimum(best[near], solid_distance(of_a, of_b, steps)[0])
    return best


def _axes_apart(a: tuple, b: tuple) -> Array:
    """Less than the distance of two frustums: that of the middles of their axes, less half lengths
    and radii."""
    middle = a[0] + 0.5 * a[2] * a[1] - b[0] - 0.5 * b[2] * b[1]
    return np.linalg.norm(middle, axis=1) - 0.5 * (a[2] + b[2]) - max(a[3:]) - max(b[3:])


Motion = Callable[[Array], tuple[Array, Array]]


def relative_motion(history, a: str, b: str) -> Motion:
    """Attitude (n, 3, 3) and place (n, 3) of body b seen from a at times (n,), between the rows of
    a history.

    Places by cubics through position and velocity; attitudes of each body turn evenly from row to
    row but for a cubic in time.
    """
    time = history["time_s"].to_numpy()
    keep = np.append(np.diff(time) > 0.0, True)
    rows = history[keep]
    time = time[keep]
    apart, speed = (
        np.subtract(
            *(rows[[f"{name}_{what}{axis}_{unit}" for axis in "xyz"]].to_numpy() for name in (b, a))
        )
        for what, unit in (("", "m"), ("v", "m_s"))
    )
    turns, rates = [], []
    for name in (a, b):
        turns.append(
            Rotation.from_euler(
                "ZYX",
                np.radians(rows[[f"{name}_{k}_deg" for k in ("pitch", "yaw", "roll")]].to_numpy()),
            )
        )
        rates.append(np.radians(rows[[f"{name}_omega_{k}_deg_s" for k in "xyz"]].to_numpy()))

    def at(times: Array) -> tuple[Array, Array]:
        i = np.clip(np.searchsorted(time, times, side="right") - 1, 0, len(time) - 2)
        h = time[i + 1] - time[i]
        u = ((times - time[i]) / h)[:, None]
        h = h[:, None]
        f0, f1 = (1.0 + 2.0 * u) * (1.0 - u) ** 2, u**2 * (3.0 - 2.0 * u)
        g0, g1 = u * (1.0 - u) ** 2 * h, -(u**2) * (1.0 - u) * h
        place = f0 * apart[i] + f1 * apart[i + 1] + g0 * speed[i] + g1 * speed[i + 1]
        found = []
        for turn, rate in zip(turns, rates, strict=True):
            vector = (turn[i].inv() * turn[i + 1]).as_rotvec()
            # the rates of the rotation vector are those of the body, to third order in it
            start, end = rate[i], rate[i + 1] + 0.5 * np.cross(vector, rate[i + 1])
            found.append(turn[i] * Rotation.from_rotvec(f1 * vector + g0 * start + g1 * end))
        seen = found[0].inv()
        return (seen * found[1]).as_matrix(), seen.apply(place)

    return at


def least_clearance(
    motion: Motion, parts_a: list, parts_b: list, times: Array, coarse: int = 400
) -> tuple[float, float]:
    """Least clearance over some times (m,), m, and when: at ``coarse`` of them, then closer and
    closer around the lowest three."""
    grid = np.unique(np.concatenate([times[:: max(1, len(times) // coarse)], times[[0, -1]]]))
    values = outline_distance(parts_a, parts_b, *motion(grid), _FEW)
    padded = np.concatenate([[np.inf], values, [np.inf]])
    low = np.flatnonzero((values <= padded[:-2]) & (values <= padded[2:]) & np.isfinite(values))
    best, when = np.inf, np.nan
    for i in low[np.argsort(values[low], kind="stable")][:3]:
        least, time, width, idle = np.inf, grid[i], np.diff(grid).max(), 0
        for _ in range(_ZOOMS + 1):
            near = np.clip(time + width * np.linspace(-1.0, 1.0, 25), times[0], times[-1])
            found = outline_distance(parts_a, parts_b, *motion(near))
            idle = idle + 1 if found.min() >= least - _SAME else 0
            if found.min() <= least:
                least, time = found.min(), near[np.argmin(found)]
            if idle == 2:
                break
            width *= 0.12
        if least < best:
            best, when = float(least), float(time)
    return best, when
