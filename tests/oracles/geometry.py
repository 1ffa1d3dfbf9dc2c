"""Clearance of two bodies, written from the section "Outline" of CONVENTIONS.md: numpy only, no
code of the kernels.

Arrays begin with the poses (n,): many relative attitudes and positions are handled at once. A
frustum is the tuple (start (n, 3), axis (n, 3), length, r0, r1). Distances of solids are proved by
their nearest points and a pair of parallel planes between them.
"""

from collections.abc import Callable
from typing import Any

import numpy as np
from scipy.spatial.transform import Rotation

Array = np.ndarray
THROUGH = (
    0.1  # fraction of a shell's radius within which a point outside has passed through its wall
)
_ANGLES = 360  # samples of a rim
_SECTORS = 8  # sectors of a circle
_MAX_REFINEMENTS = 9  # maximum refinements, each by a factor of about ten in angle or time
_SECTOR_REFINEMENTS, _THIRDS = 11, 55  # of angles; of the length of a line
_SAME = 1e-12  # m: two refinements in a row without a larger gain end the search
_MAX_PROJECTIONS, _FEW_PROJECTIONS = (
    2000,
    60,
)  # maximum projections; the same where only the order of distances matters
_PROVED = 1e-9  # m


def nearest_on_frustum(points: Array, frustum: tuple) -> Array:
    """Nearest points (n, 3) of solid frustums to points (n, 3)."""
    start, axis, length, r0, r1 = frustum
    from_start = points - start
    along = np.einsum("ij,ij->i", from_start, axis)
    across = from_start - along[:, None] * axis
    rho = np.sqrt(np.einsum("ij,ij->i", across, across))
    # in the plane of the axis and the point: the nearest of both ends and the side
    rise, square = r1 - r0, length**2 + (r1 - r0) ** 2
    fraction = (
        _between((along * length + (rho - r0) * rise) / square, 0.0, 1.0)
        if square > 0.0
        else np.zeros_like(along)
    )
    z, r = fraction * length, r0 + fraction * rise
    squares = (along - z) ** 2 + (rho - r) ** 2
    for end, radius in ((0.0, r0), (length, r1)):
        disc = np.minimum(rho, radius)
        squared_distance = (along - end) ** 2 + (rho - disc) ** 2
        nearer = squared_distance < squares
        z, r = np.where(nearer, end, z), np.where(nearer, disc, r)
        squares = np.where(nearer, squared_distance, squares)
    side = r0 + rise * (_between(along / length, 0.0, 1.0) if length > 0.0 else 0.0)
    within = (along >= 0.0) & (along <= length) & (rho <= side)
    # offset of the nearest point along the axis, and as a fraction of rho
    z = np.where(within, 0.0, along - z)
    out = np.where(within, 0.0, (rho - r) / np.where(rho > 0.0, rho, 1.0))
    return points - z[:, None] * axis - out[:, None] * across


def _between(values: Array, minimum: float, high: float) -> Array:
    """Values limited to an interval; `numpy.clip` takes twice as long."""
    return np.minimum(np.maximum(values, minimum), high)


def support(frustum: tuple, u: Array) -> Array:
    """Support function: maximum of u . p (n,) over frustums, attained on one of the two discs."""
    start, axis, length, r0, r1 = frustum
    slope = np.einsum("ij,ij->i", u, axis)
    across = np.sqrt(np.maximum(1.0 - slope**2, 0.0))
    return np.einsum("ij,ij->i", u, start) + np.maximum(r0 * across, length * slope + r1 * across)


def solid_distance(a: tuple, b: tuple, steps: int = _MAX_PROJECTIONS) -> tuple[Array, Array]:
    """Distances (n,), m, of solid frustums, and their uncertainties: no distance is smaller by more
    than that.

    Alternating projections with Nesterov's momentum, which converge to the nearest points of convex
    bodies: from the middle and both ends of each, for they converge slowly along nearly parallel
    sides. On nearly parallel ends they hardly converge: what is not proved then is searched along
    the rims.
    """
    frustums = a, b
    fractions, count = (0.0, 0.5, 1.0), len(a[0])
    starts = [
        nearest_on_frustum(part[0] + fraction * part[2] * part[1], b)
        for part in (a, b)
        for fraction in fractions
    ]
    a, b = (
        (np.tile(part[0], (len(starts), 1)), np.tile(part[1], (len(starts), 1)), *part[2:])
        for part in (a, b)
    )
    q = np.concatenate(starts)
    ahead, momentum = q, np.ones(len(q))
    best, proved = np.full(count, np.inf), np.full(count, -np.inf)
    for step in range(steps):
        p = nearest_on_frustum(ahead, a)
        new = nearest_on_frustum(p, b)
        # wrong direction: restart the momentum
        turned = np.einsum("ij,ij->i", ahead - new, new - q) > 0.0
        follow = 0.5 * (1.0 + np.sqrt(1.0 + 4.0 * momentum**2))
        fraction = np.where(turned, 0.0, (momentum - 1.0) / follow)
        momentum = np.where(turned, 1.0, follow)
        ahead, q = new + fraction[:, None] * (new - q), new
        if step % 20 == 19:
            p = nearest_on_frustum(q, a)
            separation = q - p
            distance = np.linalg.norm(separation, axis=1)
            u = separation / np.where(distance > 0.0, distance, 1.0)[:, None]
            lower_bound = np.where(distance > 0.0, -support(b, -u) - support(a, u), 0.0)
            best = np.minimum(best, distance.reshape(-1, count).min(axis=0))
            proved = np.maximum(proved, lower_bound.reshape(-1, count).max(axis=0))
            if np.all((best - proved < _PROVED) | (best < _PROVED)):
                break
    unproved = best - np.maximum(proved, 0.0) > _PROVED
    if unproved.any():
        first, second = ((part[0][unproved], part[1][unproved], *part[2:]) for part in frustums)
        distances = [
            circle_distance(rim, solid)
            for part, solid in ((first, second), (second, first))
            for rim in _rims(part)
        ]
        best[unproved] = np.minimum(best[unproved], np.min(distances, axis=0))
    return best, best - np.maximum(proved, 0.0)


def _rims(frustum: tuple) -> list[tuple]:
    """Both rims of frustums, each as centre (n, 3), normal (n, 3) and radius."""
    start, axis, length, r0, r1 = frustum
    return [(start, axis, r0), (start + length * axis, axis, r1)]


def rim_distance(rim: tuple, shell: tuple) -> Array:
    """Minimum signed distances (n,), m, of rims from the inside of shells; infinite where no point
    of the rim is between the ends.

    Parameters
    ----------
    rim : tuple
        Centre (n, 3), normal (n, 3), radius.
    shell : tuple
        Frustum.
    """
    centre, normal, radius = rim
    start, axis, length, r0, r1 = shell
    u, v = _in_plane(normal)

    def signed(angle: Array) -> Array:
        """Signed distances (n, k), m, from the shell of the points of the rim at angles (n, k);
        infinite beyond the ends of the shell."""
        point = _circle(rim, u, v, angle)
        from_start = point - start[:, None]
        along = np.einsum("ikj,ij->ik", from_start, axis)
        rho = np.linalg.norm(from_start - along[..., None] * axis[:, None], axis=2)
        out = rho - r0 - (r1 - r0) * along / length
        fraction = np.clip(
            (along * length + (rho - r0) * (r1 - r0)) / (length**2 + (r1 - r0) ** 2), 0.0, 1.0
        )
        distance = np.hypot(along - fraction * length, rho - r0 - fraction * (r1 - r0))
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
        fraction = (plane - middle) / np.where(half > 0.0, half, 1.0)
        turn = np.arccos(np.clip(fraction, -1.0, 1.0))
        ends += [top + s * turn * (1.0 + e) for s in (1.0, -1.0) for e in (-1e-13, 1e-13)]
    return _refined_minimum(signed, np.concatenate([grid, np.stack(ends, axis=1)], axis=1))


def circle_distance(circle: tuple, solid: tuple) -> Array:
    """Minimum distances (n,), m, of circles, given as rims are, from solid frustums."""
    # a minimum for every sector: minima are narrow where the solid is nearly touched
    n, each = len(circle[0]), _ANGLES // _SECTORS
    grid = np.repeat(2.0 * np.pi / _ANGLES * np.arange(_ANGLES).reshape(_SECTORS, each), n, axis=0)
    circle, solid = (
        (np.tile(part[0], (_SECTORS, 1)), np.tile(part[1], (_SECTORS, 1)), *part[2:])
        for part in (circle, solid)
    )
    u, v = _in_plane(circle[1])
    flat = {}

    def distance(angle: Array) -> Array:
        """Distances of the points of the circle at angles (n, k)."""
        points = _circle(circle, u, v, angle)
        n, k = angle.shape
        if k not in flat:
            flat[k] = (np.repeat(solid[0], k, axis=0), np.repeat(solid[1], k, axis=0), *solid[2:])
        points = points.reshape(-1, 3)
        return np.linalg.norm(points - nearest_on_frustum(points, flat[k]), axis=1).reshape(n, k)

    return _refined_minimum(distance, grid).reshape(_SECTORS, -1).min(axis=0)


def sector_distance(
    sector: tuple, angles: tuple[float, float], right: Array, up: Array, solid: tuple
) -> Array:
    """Minimum distances (n,), m, of sectors of frustums from solid frustums: of their straight
    lines, about a degree apart and refined around the nearest one of every 30 deg.

    Along a line the distance from a solid is convex.

    Parameters
    ----------
    sector : tuple
        Frustum.
    angles : tuple of 2 float
        First and last angle, rad, from ``right`` to where -``up`` points.
    right, up : ndarray, shape (n, 3)
        Axes z and y of the body.
    solid : tuple
        Frustum.
    """
    borders = np.linspace(*angles, 2 + int(np.ptp(angles) / 0.5))
    low, high = (np.repeat(one, len(sector[0]))[:, None] for one in (borders[:-1], borders[1:]))
    sector, solid = (
        (*(np.tile(one, (len(borders) - 1, 1)) for one in part[:2]), *part[2:])
        for part in (sector, solid)
    )
    right, up = (np.tile(axis, (len(borders) - 1, 1)) for axis in (right, up))
    rows, minimum = np.arange(len(low)), np.full(len(low), np.inf)
    middle, half = 0.5 * (low + high), 0.5 * (high - low)
    for _ in range(_SECTOR_REFINEMENTS):
        at = np.clip(middle + half * np.linspace(-1.0, 1.0, 25), low, high)
        values = _line_distances(sector, at, right, up, solid)
        chosen = np.argmin(values, axis=1)
        minimum = np.minimum(minimum, values[rows, chosen])
        middle, half = at[rows, chosen][:, None], 0.15 * half
    return minimum.reshape(len(borders) - 1, -1).min(axis=0)


def _line_distances(sector: tuple, angle: Array, right: Array, up: Array, solid: tuple) -> Array:
    """Distances (n, k) of the straight lines of sectors at angles (n, k), rad, from solids."""
    start, axis, length, r0, r1 = sector
    n, k = angle.shape
    out = np.cos(angle)[..., None] * right[:, None] - np.sin(angle)[..., None] * up[:, None]
    begin = (start[:, None] + r0 * out).reshape(-1, 3)
    along = (length * axis[:, None] + (r1 - r0) * out).reshape(-1, 3)
    other = (np.repeat(solid[0], k, axis=0), np.repeat(solid[1], k, axis=0), *solid[2:])

    def distance(fraction: Array) -> Array:
        points = begin + fraction[:, None] * along
        return np.linalg.norm(points - nearest_on_frustum(points, other), axis=1)

    low, high = np.zeros(n * k), np.ones(n * k)
    best = np.minimum(distance(low), distance(high))
    for _ in range(_THIRDS):
        third = (high - low) / 3.0
        one, two = distance(low + third), distance(high - third)
        best = np.minimum(best, np.minimum(one, two))
        low, high = np.where(one < two, low, low + third), np.where(one < two, high - third, high)
    return best.reshape(n, k)


def _in_plane(normal: Array) -> tuple[Array, Array]:
    """Two unit vectors (n, 3) normal to unit vectors (n, 3) and to each other."""
    second = np.where(np.abs(normal[:, :1]) < 0.6, [[1.0, 0.0, 0.0]], [[0.0, 1.0, 0.0]])
    u = np.cross(normal, second)
    u /= np.linalg.norm(u, axis=1)[:, None]
    return u, np.cross(normal, u)


def _circle(rim: tuple, u: Array, v: Array, angle: Array) -> Array:
    """Points (n, k, 3) of circles at angles (n, k)."""
    return rim[0][:, None] + rim[2] * (
        np.cos(angle)[..., None] * u[:, None] + np.sin(angle)[..., None] * v[:, None]
    )


def _refined_minimum(value: Callable[[Array], Array], angles: Array) -> Array:
    """Minima (n,) of a function of angles: the best of some (n, k), refined around it."""
    values = value(angles)
    width, rows = 2.0 * np.pi / _ANGLES, np.arange(len(angles))
    minimum, idle = values.min(axis=1), 0
    for _ in range(_MAX_REFINEMENTS):
        chosen = np.argmin(values, axis=1)
        angle = angles[rows, chosen]
        # the middle one is the best so far
        angles = angle[:, None] + width * np.linspace(-1.0, 1.0, 21)
        values = np.minimum(
            value(angles), np.where(np.arange(21) == 10, values[rows, chosen][:, None], np.inf)
        )
        width *= 0.1
        before, minimum = minimum, values.min(axis=1)
        idle = 0 if np.any(before > minimum + _SAME) else idle + 1
        if idle == 2:
            break
    return minimum


def parts_of(body) -> list[tuple[Any, Array, Array, float, float, float]]:
    """Parts of a body's outline in body axes from its mass centre: (wall, start (3,), axis (3,),
    length, r0, r1). ``wall`` is False of a solid, True of the inside of a shell, and of a sector
    its angles."""
    cg, parts = np.array(body.cg), []

    def place(station: float, y: float, z: float) -> Array:
        """Layout point in body axes from the mass centre, m."""
        return np.array([cg[0] - station, y - cg[1], z - cg[2]])

    for part in body.outline:
        if part.stations is not None:
            (s0, s1), (r0, r1) = part.stations, part.radii
            axis = np.array([-1.0 if s1 >= s0 else 1.0, 0.0, 0.0])
            wall = part.hollow if part.sector is None else part.sector
            parts.append((wall, place(s0, *part.offset), axis, abs(s1 - s0), r0, r1))
        parts += [
            (False, place(*point), np.array([1.0, 0.0, 0.0]), 0.0, 0.0, 0.0)
            for point in part.points
        ]
    return parts


def outline_distance(
    parts_a: list, parts_b: list, attitudes: Array, places: Array, steps: int = _MAX_PROJECTIONS
) -> Array:
    """Clearances (n,), m, of two outlines; b has relative attitudes (n, 3, 3) and positions (n, 3)
    in axes of a."""
    n, best = len(places), np.full(len(places), np.inf)
    fixed = np.broadcast_to(np.eye(3), attitudes.shape)
    for hollow_a, start_a, axis_a, *size_a in parts_a:
        a = (np.broadcast_to(start_a, (n, 3)), np.broadcast_to(axis_a, (n, 3)), *size_a)
        for hollow_b, start_b, axis_b, *size_b in parts_b:
            b = (places + attitudes @ start_b, attitudes @ axis_b, *size_b)
            if hollow_a and hollow_b:
                continue
            if isinstance(hollow_a, tuple) or isinstance(hollow_b, tuple):
                first = isinstance(hollow_a, tuple)
                wall, solid, angles = (a, b, hollow_a) if first else (b, a, hollow_b)
                axes = fixed if first else attitudes
                distance = sector_distance(wall, angles, axes[:, :, 2], axes[:, :, 1], solid)
                best = np.minimum(best, distance)
            elif hollow_a or hollow_b:
                solid, shell = (b, a) if hollow_a else (a, b)
                rims = _rims(solid) if solid[2] > 0.0 else [(solid[0], solid[1], max(solid[3:]))]
                for rim in rims:
                    best = np.minimum(best, rim_distance(rim, shell))
                for fraction, radius in ((0.0, shell[3]), (shell[2], shell[4])):
                    best = np.minimum(
                        best,
                        circle_distance((shell[0] + fraction * shell[1], shell[1], radius), solid),
                    )
            else:
                near = (
                    _axes_distance(a, b) < best
                )  # the others are further away than the best so far
                if near.any():
                    of_a, of_b = ((part[0][near], part[1][near], *part[2:]) for part in (a, b))
                    best[near] = np.minimum(best[near], solid_distance(of_a, of_b, steps)[0])
    return best


def _axes_distance(a: tuple, b: tuple) -> Array:
    """Lower bound of the distance of two frustums: distance of the middles of their axes, minus
    half lengths and radii."""
    middle = a[0] + 0.5 * a[2] * a[1] - b[0] - 0.5 * b[2] * b[1]
    return np.linalg.norm(middle, axis=1) - 0.5 * (a[2] + b[2]) - max(a[3:]) - max(b[3:])


Motion = Callable[[Array], tuple[Array, Array]]


def relative_motion(history, a: str, b: str) -> Motion:
    """Function of times (n,) for the attitude (n, 3, 3) and position (n, 3) of body b in axes of a,
    interpolated between the rows of a history.

    Positions by cubics through position and velocity; attitudes of each body by a rotation vector
    that is a cubic in time.
    """
    time = history["time_s"].to_numpy()
    keep = np.append(np.diff(time) > 0.0, True)
    rows = history[keep]
    time = time[keep]
    separation, speed = (
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
        """Relative attitudes and positions at times (n,)."""
        i = np.clip(np.searchsorted(time, times, side="right") - 1, 0, len(time) - 2)
        h = time[i + 1] - time[i]
        u = ((times - time[i]) / h)[:, None]
        h = h[:, None]
        f0, f1 = (1.0 + 2.0 * u) * (1.0 - u) ** 2, u**2 * (3.0 - 2.0 * u)
        g0, g1 = u * (1.0 - u) ** 2 * h, -(u**2) * (1.0 - u) * h
        place = f0 * separation[i] + f1 * separation[i + 1] + g0 * speed[i] + g1 * speed[i + 1]
        attitudes = []
        for turn, rate in zip(turns, rates, strict=True):
            vector = (turn[i].inv() * turn[i + 1]).as_rotvec()
            # the rate of the rotation vector, to third order in it
            start, end = rate[i], rate[i + 1] + 0.5 * np.cross(vector, rate[i + 1])
            attitudes.append(turn[i] * Rotation.from_rotvec(f1 * vector + g0 * start + g1 * end))
        seen = attitudes[0].inv()
        return (seen * attitudes[1]).as_matrix(), seen.apply(place)

    return at


def min_clearance(
    motion: Motion, parts_a: list, parts_b: list, times: Array, coarse: int = 400
) -> tuple[float, float]:
    """Minimum clearance, m, over times (m,), and its time, s: at ``coarse`` of them, then refined
    around the lowest three."""
    grid = np.unique(np.concatenate([times[:: max(1, len(times) // coarse)], times[[0, -1]]]))
    values = outline_distance(parts_a, parts_b, *motion(grid), _FEW_PROJECTIONS)
    padded = np.concatenate([[np.inf], values, [np.inf]])
    low = np.flatnonzero((values <= padded[:-2]) & (values <= padded[2:]) & np.isfinite(values))
    best, time_of_best = np.inf, np.nan
    for i in low[np.argsort(values[low], kind="stable")][:3]:
        minimum, time, width, idle = np.inf, grid[i], np.diff(grid).max(), 0
        for _ in range(_MAX_REFINEMENTS + 1):
            near = np.clip(time + width * np.linspace(-1.0, 1.0, 25), times[0], times[-1])
            distances = outline_distance(parts_a, parts_b, *motion(near))
            idle = idle + 1 if distances.min() >= minimum - _SAME else 0
            if distances.min() <= minimum:
                minimum, time = distances.min(), near[np.argmin(distances)]
            if idle == 2:
                break
            width *= 0.12
        if minimum < best:
            best, time_of_best = float(minimum), float(time)
    return best, time_of_best
