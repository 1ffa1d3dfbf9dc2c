"""Nearest points of the outlines of two bodies, which replays show as ends of a line.

Their distance is known from the history of the case; only the points are computed here. A point is
projected onto a part of one outline and onto a part of the other in turn, which converges to the
nearest points of convex parts. The wall of a shell is not convex: there it is done from several
starting points.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import product

import numpy as np
from scipy.spatial.transform import Rotation

from sepmc.scene.model import Part, Vector

_AROUND = 12  # starts around a rim
_PROJECTIONS, _PROJECTIONS_AT_WALLS = 60, 12
# largest difference from the distance of the history: fraction of it, and m
_RELATIVE, _ABSOLUTE = 0.03, 1e-3


@dataclass(frozen=True)
class PlacedPart:
    """A part of a body's outline in body axes from the body's centre of mass, lengths in m: a
    frustum, its wall, a sector of the wall, or points.

    Parameters
    ----------
    start, end : tuple of 3 float
        Centres of the two end circles; without meaning for points.
    radii : tuple of 2 float
        Radii of the circles at ``start`` and at ``end``; 0 for points.
    is_wall : bool
        True for a surface (a hollow part or a sector); False for a solid and for points.
    sector : tuple of 2 float, optional
        First and last angle of a sector about body x, rad: 0 is toward z, pi / 2 toward -y.
    points : ndarray, shape (m, 3)
        Points of a part that consists of points; m is 0 for other parts.
    """

    start: Vector
    end: Vector
    radii: tuple[float, float]
    is_wall: bool
    sector: tuple[float, float] | None
    points: np.ndarray


def placed_part(part: Part, cg: Vector) -> PlacedPart:
    """Return a part of an outline in body axes from the centre of mass; the part and the centre of
    mass ``cg`` are given in layout coordinates: station (measured aft), y (up) and z (right), m.
    All points of a part stay together in one placed part."""
    points = (np.array(part.points).reshape(-1, 3) - cg) * [-1.0, 1.0, 1.0]
    front, aft = part.stations or (0.0, 0.0)
    y, z = part.offset[0] - cg[1], part.offset[1] - cg[2]
    return PlacedPart(
        (cg[0] - front, y, z),
        (cg[0] - aft, y, z),
        part.radii or (0.0, 0.0),
        part.is_wall,
        part.sector,
        points,
    )


@dataclass(frozen=True)
class MovingOutline:
    """Some parts of the outline of a body that moves: ``positions`` (n, 3) of its centre of mass at
    n instants, m, and n ``rotations`` from body axes to the common axes of all bodies."""

    parts: Sequence[PlacedPart]
    positions: np.ndarray
    rotations: Rotation


def nearest_lines(one: MovingOutline, two: MovingOutline, distances: np.ndarray) -> np.ndarray:
    """Return the nearest points of two outlines at each of n instants.

    Parameters
    ----------
    one, two : MovingOutline
        In the same common axes.
    distances : ndarray, shape (n,)
        Least distance of the outlines, m, from the history; NaN where there is none.

    Returns
    -------
    ndarray, shape (n, 2, 3)
        Nearest point of ``one`` and of ``two``, m, in the common axes; NaN where no pair of parts
        has that distance, to 3 % or 1 mm, whichever is larger.
    """
    lines = np.full((len(distances), 2, 3), np.nan)
    known = np.flatnonzero(np.isfinite(distances))
    if not len(known):
        return lines
    one, two = (
        MovingOutline(each.parts, each.positions[known], each.rotations[known])
        for each in (one, two)
    )
    least = np.abs(distances[known])
    tolerance = np.maximum(_RELATIVE * least, _ABSOLUTE)
    best = np.full(len(known), np.inf)
    for a, b in product(one.parts, two.parts):
        if a.is_wall and b.is_wall:
            continue
        x, y = _nearest_points(a, one, b, two)
        difference = np.abs(np.linalg.norm(x - y, axis=1) - least)
        better = (difference < best) & (difference <= tolerance)
        best[better] = difference[better]
        lines[known[better]] = np.stack([x, y], axis=1)[better]
    return lines


def _nearest_points(
    a: PlacedPart, one: MovingOutline, b: PlacedPart, two: MovingOutline
) -> tuple[np.ndarray, np.ndarray]:
    """Return the points (n, 3) of part ``a`` of outline ``one`` and (n, 3) of part ``b`` of outline
    ``two`` that are nearest to each other at each of n instants, in common axes, m; at most one of
    the parts may be a wall."""
    at_walls = a.is_wall or b.is_wall
    starts, count = _starts(b if a.is_wall else a, at_walls), len(one.positions)
    first, second = (b, two) if a.is_wall else (a, one), (a, one) if a.is_wall else (b, two)
    into = first[1]
    x = np.concatenate([into.positions + into.rotations.apply(start) for start in starts])
    y = x
    for _ in range(_PROJECTIONS_AT_WALLS if at_walls else _PROJECTIONS):
        y = _project(x, *second)
        x = _project(y, *first)
    distance = np.linalg.norm(x - y, axis=1).reshape(-1, count)
    chosen = distance.argmin(axis=0) * count + np.arange(count)
    return (y[chosen], x[chosen]) if a.is_wall else (x[chosen], y[chosen])


def _starts(part: PlacedPart, around: bool) -> np.ndarray:
    """Return the points (k, 3) of a part, in body axes, m, from which projections start: its own
    points if it has any; else points around both end circles if ``around`` is True; else the middle
    and the ends of its axis."""
    if len(part.points):
        return part.points
    ends = np.array([part.start, part.end])
    if not around:
        return np.array([ends.mean(axis=0), *ends])
    angles = np.linspace(0.0, 2.0 * np.pi, _AROUND if max(part.radii) > 0.0 else 1, endpoint=False)
    circle = np.column_stack([np.zeros_like(angles), np.cos(angles), np.sin(angles)])
    return np.concatenate([end + r * circle for end, r in zip(ends, part.radii, strict=True)])


def _project(points: np.ndarray, part: PlacedPart, outline: MovingOutline) -> np.ndarray:
    """Return the points (k n, 3) of a part that are nearest to ``points`` (k n, 3), both in common
    axes, m: n instants of the moving ``outline`` for each of k starts, the instants varying
    fastest."""
    count = len(outline.positions)
    result = np.empty_like(points)
    for k in range(0, len(points), count):  # every start in turn
        arms = outline.rotations.apply(points[k : k + count] - outline.positions, inverse=True)
        nearest = nearest_on_part(arms, part)
        result[k : k + count] = outline.positions + outline.rotations.apply(nearest)
    return result


def nearest_on_part(arms: np.ndarray, part: PlacedPart) -> np.ndarray:
    """Return the points (n, 3) of a part that are nearest to the points ``arms`` (n, 3), both in
    body axes from the centre of mass, m; a point inside a solid is its own nearest point."""
    if len(part.points):
        squares = ((arms[:, None] - part.points) ** 2).sum(axis=2)
        return part.points[squares.argmin(axis=1)]
    start, length = np.array(part.start), part.start[0] - part.end[0]
    along, across = start[0] - arms[:, 0], arms[:, 1:] - start[1:]
    rho = np.hypot(*across.T)
    angle = np.arctan2(-across[:, 0], across[:, 1])
    if part.sector is not None:
        middle, half = np.mean(part.sector), (part.sector[1] - part.sector[0]) / 2.0
        turned = (angle - middle + np.pi) % (2.0 * np.pi) - np.pi
        inside = np.clip(turned, -half, half)
        # of a point beside the sector, what counts is its projection onto the nearest edge
        rho, angle = rho * np.cos(turned - inside), middle + inside
    (r0, r1), rise = part.radii, part.radii[1] - part.radii[0]
    square = length**2 + rise**2
    fraction = (
        np.clip((along * length + (rho - r0) * rise) / square, 0.0, 1.0)
        if square > 0.0
        else np.zeros_like(along)
    )
    z, r = fraction * length, r0 + fraction * rise
    if not part.is_wall:
        squares = (along - z) ** 2 + (rho - r) ** 2
        for end, radius in ((0.0, r0), (length, r1)):
            disc = np.minimum(rho, radius)
            nearer = (along - end) ** 2 + (rho - disc) ** 2 < squares
            squares = np.where(nearer, (along - end) ** 2 + (rho - disc) ** 2, squares)
            z, r = np.where(nearer, end, z), np.where(nearer, disc, r)
        side = r0 + rise * np.clip(along / length, 0.0, 1.0) if length else np.zeros_like(along)
        within = (along >= min(0.0, length)) & (along <= max(0.0, length)) & (rho <= side)
        z, r = np.where(within, along, z), np.where(within, rho, r)
    return np.column_stack(
        [start[0] - z, start[1] - r * np.sin(angle), start[2] + r * np.cos(angle)]
    )
