"""Drawing of the vehicle at the start, in side, top and rear view: outlines, centres of mass with
their dispersion, joints, springs, motors with their thrust, and loads.

Points are in layout coordinates: station (measured aft), y (up) and z (right), m. The scene has its
nominal values.
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass
from itertools import pairwise
from pathlib import Path

import numpy as np
from matplotlib.axes import Axes
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure
from matplotlib.patches import Circle, Ellipse, Patch, Polygon
from matplotlib.ticker import MaxNLocator

from sepmc.report.style import BLACK, EDGES, GREEN, TINTS, VERMILION, lay_out, save, set_title
from sepmc.scene.budget import force_of_table
from sepmc.scene.dispersion import Dispersion
from sepmc.scene.model import GROUND, Motor, Part, Scene
from sepmc.scene.signals import with_sizes

_COUNT_NOTE = "NAME +N: N more of its kind at or near this point"
_ARROW, _MERGE_DISTANCE = 0.09, 0.05  # of the vehicle's length: arrows; points merged to one label
_ARC_POINTS = 49  # of the arc of a sector
_MARK_RADIUS, _LINE_RADIUS = 7.0, 2.0  # pixels, of marks and lines in the placement of labels
Point = tuple[float, float, float]


@dataclass(frozen=True)
class _View:
    """View of layout points (station, y, z): ``across`` and ``up`` are the indices of the
    coordinates drawn to the right and up, ``labels`` those of the two axes."""

    across: int
    up: int
    labels: tuple[str, str]

    def at(self, point: Sequence[float]) -> tuple[float, float]:
        """Return the horizontal and vertical coordinate, m, of a layout point in this view."""
        return point[self.across], point[self.up]


# candidate positions of a label: distances of its edge from the mark, in points, and directions
_LABEL_DISTANCES, _DIRECTIONS = (7, 14, 24, 36, 50, 66, 84, 106, 130), 24
_LEADER_DISTANCE = 20  # points: a label farther away has a leader line
# background of labels
_LABEL_BOX = {"facecolor": "white", "alpha": 0.7, "linewidth": 0.0, "pad": 0.5}
_PAD = np.array([4.0, 1.0])  # pixels around a label
# cost of the area that a label shares with other labels (or has outside the axes), marks and lines;
# and of its distance from the mark
_COST_LABEL, _COST_MARK, _COST_LINE, _COST_DISTANCE = 20.0, 4.0, 1.0, 1.0


class _Labels:
    """Labels of points in a view, collected first and placed by `write`. Points of one colour
    closer than about ``merge_distance`` (m), those in one cell of a grid of that size, share a
    label as `add` collects them: the name of the first one, with the number of further ones."""

    def __init__(self, ax: Axes, merge_distance: float):
        self.ax, self.merge_distance = ax, merge_distance
        self.names: dict[tuple[int, int, str], tuple[tuple[float, float], list[str], str]] = {}
        self.marks: list[tuple[float, float]] = []
        self.lines: list[np.ndarray] = []

    def add(self, at: tuple[float, float], name: str, colour: str) -> None:
        """Add the label ``name`` in a colour to the point ``at``, in coordinates of the view, m."""
        cell = (round(at[0] / self.merge_distance), round(at[1] / self.merge_distance), colour)
        self.names.setdefault(cell, (at, [], colour))[1].append(name)
        self.marks.append(at)

    def line(self, start: tuple[float, float], end: tuple[float, float]) -> None:
        """Add a line between two points of the view, m, that labels should not cover."""
        self.lines.append(np.array([start, end]))

    def write(self) -> None:
        """Draw each label inside the axes and near its point, where it overlaps least with marks,
        lines and earlier labels; a line joins it to its point if it is far. The axes must have
        their final size and limits."""
        canvas = self.ax.figure.canvas
        assert isinstance(canvas, FigureCanvasAgg)
        renderer, bounds = canvas.get_renderer(), np.array([self.ax.get_window_extent().extents])
        scale = canvas.figure.dpi / 72.0  # pixels per point
        marks = self.ax.transData.transform(self.marks).reshape(-1, 2)
        lines = [_boxes_along(*self.ax.transData.transform(one)) for one in self.lines]
        mark_boxes = _boxes_around(marks, _MARK_RADIUS)
        label_boxes, leaders = np.empty((0, 4)), np.empty((0, 4))
        line_boxes = np.concatenate([np.empty((0, 4)), *lines])
        angles = np.linspace(0.0, 2.0 * np.pi, _DIRECTIONS, endpoint=False) + np.pi / 4.0
        directions = np.column_stack([np.cos(angles), np.sin(angles)])
        for at, names, colour in self.names.values():
            text = self.ax.annotate(
                names[0] + (f" +{len(names) - 1}" if len(names) > 1 else ""), at, (0, 0),
                textcoords="offset points", fontsize=7.5, color=colour, zorder=6, ha="center",
                va="center", bbox=_LABEL_BOX,
            )  # fmt: skip
            text.set_in_layout(False)  # it is inside the axes
            half = np.array(text.get_window_extent(renderer).size) / 2.0
            # centres of the label at these distances of its edge in each direction
            corners = np.sign(directions.round(9)) * half
            offsets = np.vstack([directions * far * scale + corners for far in _LABEL_DISTANCES])
            centres = self.ax.transData.transform(at) + offsets
            boxes = _boxes_around(centres, half + _PAD)
            outside = _overlap(boxes, boxes).diagonal() - _overlap(boxes, bounds)[:, 0]
            # a label across a leader would seem to belong to it
            obstacles = np.vstack([label_boxes, leaders])
            cost = _COST_LABEL * (4.0 * outside + _overlap(boxes, obstacles).sum(axis=1))
            cost += _COST_MARK * _overlap(boxes, mark_boxes).sum(axis=1)
            cost += _COST_LINE * _overlap(boxes, line_boxes).sum(axis=1)
            distance = np.hypot(*np.maximum(np.abs(offsets) - half, 0.0).T)
            anchor = self.ax.transData.transform(at)
            edges = np.clip(0.0, offsets - half, offsets + half)  # ends of leader lines
            for k in np.flatnonzero(distance >= _LEADER_DISTANCE * scale):
                leader = _boxes_along(anchor, anchor + edges[k])
                cost[k] += _COST_LABEL * _overlap(leader, obstacles).sum()
            best = int(np.argmin(cost + _COST_DISTANCE * distance * half[1]))
            text.set_position(offsets[best] / scale)
            if distance[best] >= _LEADER_DISTANCE * scale:
                leaders = np.vstack([leaders, _boxes_along(anchor, anchor + edges[best])])
                self.ax.annotate(
                    "", at, edges[best] / scale, textcoords="offset points", zorder=5,
                    arrowprops={"arrowstyle": "-", "color": colour, "linewidth": 0.5},
                ).set_in_layout(False)  # fmt: skip
            label_boxes = np.vstack([label_boxes, boxes[best]])


def _boxes_around(centres: np.ndarray, half: float | np.ndarray) -> np.ndarray:
    """Return boxes (n, 4), each as lower left and upper right corner, around centres (n, 2);
    ``half`` is half their width and height: one number, (2,) or (n, 2)."""
    return np.hstack([centres - half, centres + half])


def _boxes_along(start: np.ndarray, end: np.ndarray) -> np.ndarray:
    """Return small boxes (n, 4) side by side that cover the line from ``start`` to ``end``, in
    pixels."""
    count = int(np.hypot(*(end - start)) / (2.0 * _LINE_RADIUS)) + 1
    fractions = ((np.arange(count) + 0.5) / count)[:, None]
    return _boxes_around(start + (end - start) * fractions, _LINE_RADIUS)


def _overlap(boxes: np.ndarray, others: np.ndarray) -> np.ndarray:
    """Return the area (n, m) that each of the ``boxes`` (n, 4) has in common with each of the
    ``others`` (m, 4). Boxes are given as by `_boxes_around`: lower left and upper right corner."""
    low = np.maximum(boxes[:, None, :2], others[:, :2])
    high = np.minimum(boxes[:, None, 2:], others[:, 2:])
    return np.prod(np.maximum(high - low, 0.0), axis=2)


_SIDE = _View(0, 1, ("station (m)", "y, up (m)"))
_TOP = _View(0, 2, ("station (m)", "z, right (m)"))
_END = _View(2, 1, ("z, right (m)", "y, up (m)"))


def draw_vehicle(scene: Scene, dispersions: Sequence[Dispersion], title: str, path: Path) -> Path:
    """Draw the vehicle of a scene at the start, in three views, and write the figure.

    Parameters
    ----------
    scene : Scene
        Scene with its nominal values.
    dispersions : sequence of Dispersion
        Those of centres of mass are drawn as ellipses that reach to the ends of the distributions,
        or to three sigma; others are not drawn.
    title : str
    path : Path
        File to write, in a folder that exists; the suffix selects the format.

    Returns
    -------
    Path
        ``path``.
    """
    figure = Figure(figsize=(11.0, 6.2), layout="constrained")
    FigureCanvasAgg(figure)
    grid = figure.add_gridspec(2, 2, width_ratios=(3.2, 1.3))
    views = ((grid[0, 0], _SIDE), (grid[1, 0], _TOP), (grid[:, 1], _END))
    size = _size(scene)
    reach = {
        d.parameter.path: (d.reach[0] * d.parameter.factor, d.reach[1] * d.parameter.factor)
        for d in dispersions
    }
    labelled = []
    for cell, view in views:
        ax = figure.add_subplot(cell)
        labels = _Labels(ax, _MERGE_DISTANCE * size)
        _outlines(labels, scene, view)
        _masses(labels, scene, view, reach)
        _joints(labels, scene, view)
        _forces(labels, scene, view, _ARROW * size)
        labelled.append(labels)
        ax.set(xlabel=view.labels[0], ylabel=view.labels[1])
        ax.set_aspect("equal", adjustable="datalim")
        # in rear view the vehicle fills the width, and labels stand beside it
        ax.margins(0.16 if view is _END else 0.08, 0.12)
        if view is _END:  # narrow: labels such as -0.004 would overlap
            ax.xaxis.set_major_locator(MaxNLocator(4, steps=[1, 2, 5, 10]))
        ax.grid(True, color="#e4e4e4", linewidth=0.5)
        ax.set_axisbelow(True)
        ax.spines[["top", "right"]].set_visible(False)
        ax.tick_params(labelsize=9)
    set_title(figure, title)
    if any(len(names) > 1 for labels in labelled for _, names, _ in labels.names.values()):
        figure.supxlabel(_COUNT_NOTE, fontsize=9)
    lay_out(figure)  # the placement of labels needs the final axes
    for labels in labelled:
        labels.ax.apply_aspect()
        labels.write()
    return save(figure, path)


def _size(scene: Scene) -> float:
    """Return the range of the stations of all that is drawn (outlines, centres of mass, motors,
    joints, springs and points of loads), m; at least 1 mm."""
    stations = [body.cg[0] for body in scene.body.values()]
    stations += [motor.station for motor in scene.motor]
    stations += [joint.point[0] for joint in scene.joint.values()]
    stations += [spring.point[0] for spring in scene.spring]
    stations += [load.point[0] for load in scene.load if load.point]
    for body in scene.body.values():
        for part in body.outline:
            stations += part.stations or [point[0] for point in part.points]
    return max(max(stations) - min(stations), 1e-3)


def _outlines(labels: _Labels, scene: Scene, view: _View) -> None:
    """Draw the parts of the outlines of all bodies in a view: solids filled, hollow parts dashed,
    sectors as thick lines, points as dots; labels are to avoid their edges."""
    for number, body in enumerate(scene.body.values()):
        tint, edge = TINTS[number % len(TINTS)], EDGES[number % len(EDGES)]
        for part in body.outline:
            style = {"edgecolor": edge, "linewidth": 1.1}
            style |= {"fill": False, "linestyle": "--"} if part.hollow else {"facecolor": tint}
            if part.sector is not None:
                style = {"edgecolor": edge, "linewidth": 1.8, "fill": False}
            for shape in _shapes(part, view, style):
                labels.ax.add_patch(shape)
                outline = shape.get_path().transformed(shape.get_patch_transform())
                for corners in outline.to_polygons():
                    for start, end in pairwise(np.asarray(corners).tolist()):
                        labels.line(start, end)
            if dots := _dots(part, view):
                labels.ax.plot(*zip(*dots, strict=True), "o", color=edge, ms=3)


def _dots(part: Part, view: _View) -> list[tuple[float, float]]:
    """Return the coordinates in a view, m, of the dots of a part: of its points, and of a part
    without radius (a line) in rear view, where it is seen end-on."""
    points = list(part.points)
    if view is _END and part.stations is not None and part.radii == (0.0, 0.0):
        points.append((part.stations[0], *part.offset))
    return [view.at(point) for point in points]


def _shapes(part: Part, view: _View, style: dict[str, object]) -> list[Patch]:
    """Return the matplotlib patches that draw a part in a view; ``style`` are their keyword
    arguments. The list is empty for a part of points."""
    if part.stations is None or part.radii is None:
        return []
    y, z = part.offset
    if part.sector is not None:
        return _sector_shapes(part, view, style)
    if view is _END:
        return [Circle((z, y), radius, **style) for radius in part.radii if radius > 0.0]
    centre = y if view is _SIDE else z
    (front, aft), (first, second) = part.stations, part.radii
    corners = [
        (front, centre + first),
        (aft, centre + second),
        (aft, centre - second),
        (front, centre - first),
    ]
    return [Polygon(corners, closed=True, **style)]


def _sector_shapes(part: Part, view: _View, style: dict[str, object]) -> list[Patch]:
    """Return the patches of a part that is a sector of a shell: its arcs in rear view, in the other
    views the area that its wall covers; arguments as for `_shapes`."""
    assert part.stations is not None
    assert part.radii is not None
    assert part.sector is not None
    angles = np.linspace(*part.sector, _ARC_POINTS)
    arcs = [
        np.array([view.at((station, *point)) for point in _on_circle(part, radius, angles)])
        for station, radius in zip(part.stations, part.radii, strict=True)
    ]
    if view is _END:
        arcs = arcs[: 1 if part.radii[0] == part.radii[1] else 2]
        return [Polygon(arc, closed=False, **style) for arc in arcs]
    # the wall is seen between the highest and the lowest of its straight lines
    low, high = (np.array([pick(arc[:, 1]) for arc in arcs]) for pick in (np.min, np.max))
    (front, aft) = part.stations
    corners = [(front, high[0]), (aft, high[1]), (aft, low[1]), (front, low[0])]
    return [Polygon(corners, closed=True, **style)]


def _on_circle(part: Part, radius: float, angles: np.ndarray) -> np.ndarray:
    """Return the points (n, 2), y and z, m, at angles (n,) of the circle of a ``radius`` (m) about
    the axis of a part. Angles are about body x, rad: 0 is toward z, pi / 2 toward -y."""
    y, z = part.offset
    return np.column_stack([y - radius * np.sin(angles), z + radius * np.cos(angles)])


def _masses(
    labels: _Labels, scene: Scene, view: _View, reach: dict[str, tuple[float, float]]
) -> None:
    """Draw the centres of mass with names and masses (in rear view names only), and ellipses of
    their dispersion; ``reach`` has the low and high end of each dispersed parameter by its path
    without unit, SI."""
    for number, (name, body) in enumerate(scene.body.items()):
        edge, at = EDGES[number % len(EDGES)], view.at(body.cg)
        labels.ax.plot(*at, marker="o", ms=9, mfc="white", mec=edge, mew=1.6, zorder=4)
        labels.ax.plot(*at, marker="+", ms=9, color=edge, mew=1.6, zorder=5)
        mass = f"{body.mass:,.0f}" if body.mass >= 1e3 else f"{body.mass:.4g}"
        labels.add(at, name if view is _END else f"{name}, {mass} kg", edge)
        ends = [
            reach.get(f"body.{name}.cg.{axis}", (x, x))
            for axis, x in zip("xyz", body.cg, strict=True)
        ]
        if any(low < high for low, high in ends):
            centre = view.at([(low + high) / 2.0 for low, high in ends])
            width, height = view.at([high - low for low, high in ends])
            labels.ax.add_patch(Ellipse(centre, width, height, fill=False, edgecolor=edge, lw=0.8))


def _joints(labels: _Labels, scene: Scene, view: _View) -> None:
    """Draw each joint as a square with its name, and a line to its second point, if it has one."""
    ax = labels.ax
    for name, joint in scene.joint.items():
        at = view.at(joint.point)
        ax.plot(*at, marker="s", ms=6, color=BLACK, zorder=4)
        labels.add(at, name, BLACK)
        if joint.second_point is not None:
            end = view.at(joint.second_point)
            ax.plot(*zip(at, end, strict=True), color=BLACK, linewidth=1.4)
            labels.line(at, end)


def _forces(labels: _Labels, scene: Scene, view: _View, length: float) -> None:
    """Draw each motor, each spring (except those whose second body is the ground) and each load
    with a force in body axes as an arrow of the same ``length`` (m) in the direction of its force.

    The arrow of a spring has the direction of its force on its second body at the start.
    """
    scene = with_sizes(scene)
    for spring in scene.spring:
        # body x points forward, stations count aft
        axis = _unit(spring.axis) if spring.axis else _direction(spring.point, spring.second_point)
        if spring.force + float(force_of_table(spring.table, np.zeros(1))[0]) < 0.0:  # pulls
            axis = (-axis[0], -axis[1], -axis[2])
        if spring.bodies[1] != GROUND:
            _arrow(labels, view, spring.point, axis, length, GREEN, spring.name)
    for motor in scene.motor:
        _arrow(labels, view, nozzle_point(motor), motor.direction, length, VERMILION, motor.name)
    for load in scene.load:
        point = load.point or scene.body[load.body].cg
        if any(load.force) and load.frame == "body":
            _arrow(labels, view, point, _unit(load.force), length, "#6a51a3", load.name)


def _arrow(
    labels: _Labels, view: _View, point: Point, along: Point, length: float, colour: str, name: str
) -> None:
    """Draw an arrow of a ``length`` (m) from a layout point in the direction ``along``, a unit
    vector in body axes, with the label ``name``; a cross without a label if it is seen end-on."""
    ax, start = labels.ax, view.at(point)
    step = view.at((-along[0] * length, along[1] * length, along[2] * length))
    if math.hypot(*step) < 0.05 * length:  # seen end-on
        ax.plot(*start, marker="x", ms=5, color=colour, zorder=4)
        return
    end = (start[0] + step[0], start[1] + step[1])
    arrow = {"arrowstyle": "-|>", "color": colour, "linewidth": 1.5}
    ax.annotate("", end, start, arrowprops=arrow, zorder=4)
    ax.plot(*zip(start, end, strict=True), alpha=0.0)  # includes the arrow in the axis limits
    labels.line(start, end)
    labels.add(end, name, colour)


def nozzle_point(motor: Motor) -> Point:
    """Return the point where a motor's thrust acts, in layout coordinates (station, y, z), m, as
    `sepmc.physics.propulsion.thrust_arm` has it."""
    y, z = motor.offset
    return (
        motor.station,
        -motor.radius * math.sin(motor.clock) + y,
        motor.radius * math.cos(motor.clock) + z,
    )


def _direction(first: Point, second: Point | None) -> Point:
    """Return the unit vector, in body axes, from the ``first`` layout point to the ``second``;
    (1, 0, 0) if they coincide or the second is None."""
    end = second or first
    difference = (first[0] - end[0], end[1] - first[1], end[2] - first[2])
    return _unit(difference) if any(difference) else (1.0, 0.0, 0.0)


def _unit(vector: Sequence[float]) -> Point:
    """Return the unit vector in the direction of a vector (3,) that is not 0."""
    x, y, z = np.array(vector) / np.linalg.norm(vector)
    return float(x), float(y), float(z)
