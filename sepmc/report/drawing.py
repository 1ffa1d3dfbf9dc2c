"""The vehicle as it starts, from the side, from above and from behind: outlines, centres of mass,
joints, springs, motors with their thrust, loads; where centres of mass vary, how far."""

import math
from collections.abc import Sequence
from dataclasses import dataclass
from itertools import pairwise
from pathlib import Path

import numpy as np
from matplotlib.axes import Axes
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure
from matplotlib.patches import Circle, Ellipse, Polygon

from sepmc.report.style import BLACK, EDGES, GREEN, TINTS, VERMILION, save, set_title
from sepmc.scene.dispersion import Dispersion
from sepmc.scene.model import GROUND, Motor, Part, Scene

_SEVERAL = "NAME +N: so many more of its kind at or near this place"
_ARROW, _APART = 0.09, 0.05  # of the vehicle's length: arrows, places that are taken for one
_MARK, _THIN = 7.0, 2.0  # pixels about places, and lines, that a name had better not cover
Point = tuple[float, float, float]


@dataclass(frozen=True)
class _View:
    """Which coordinates of a layout point (station, y, z) lie across and up; words for both."""

    across: int
    up: int
    labels: tuple[str, str]

    def at(self, point: Sequence[float]) -> tuple[float, float]:
        return point[self.across], point[self.up]


# where the middle of a name may stand from its place: so far beyond its edge, in points, and in so
# many directions
_FAR, _DIRECTIONS = (7, 14, 24, 36, 50, 66, 84, 106, 130), 24
_LEADER = 20  # points: a name that stands farther has a line to its place
_BEHIND = {"facecolor": "white", "alpha": 0.7, "linewidth": 0.0, "pad": 0.5}  # names
_PAD = np.array([4.0, 1.0])  # pixels about a name
# what an area costs that a name shares with another name, or that lies outside, or with a mark, or
# with a line; and a name that is far from its place
_ON_NAMES, _ON_MARKS, _ON_LINES, _AWAY = 20.0, 4.0, 1.0, 1.0


class _Labels:
    """Names beside places of a view; of those whose places are the same, the first and how many
    there are more."""

    def __init__(self, ax: Axes, apart: float):
        self.ax, self.apart = ax, apart
        self.names: dict[tuple[int, int, str], tuple[tuple[float, float], list[str], str]] = {}
        self.marks: list[tuple[float, float]] = []
        self.lines: list[np.ndarray] = []

    def add(self, at: tuple[float, float], name: str, colour: str) -> None:
        """A name of a place."""
        cell = (round(at[0] / self.apart), round(at[1] / self.apart), colour)
        self.names.setdefault(cell, (at, [], colour))[1].append(name)
        self.marks.append(at)

    def line(self, start: tuple[float, float], end: tuple[float, float]) -> None:
        """A line that names had better not cover."""
        self.lines.append(np.array([start, end]))

    def write(self) -> None:
        """Write each name where it covers least of those before it and of places, and lies within
        the axes and near its place; the axes have been laid out."""
        canvas = self.ax.figure.canvas
        assert isinstance(canvas, FigureCanvasAgg)
        renderer, within = canvas.get_renderer(), np.array([self.ax.get_window_extent().extents])
        dot = canvas.figure.dpi / 72.0  # pixels a point
        marks = self.ax.transData.transform(self.marks).reshape(-1, 2)
        lines = [_dotted(*self.ax.transData.transform(one)) for one in self.lines]
        marked, taken, leaders = _about(marks, _MARK), np.empty((0, 4)), np.empty((0, 4))
        crossed = np.concatenate([np.empty((0, 4)), *lines])
        turns = np.linspace(0.0, 2.0 * np.pi, _DIRECTIONS, endpoint=False) + np.pi / 4.0
        along = np.column_stack([np.cos(turns), np.sin(turns)])
        for at, names, colour in self.names.values():
            text = self.ax.annotate(
                names[0] + (f" +{len(names) - 1}" if len(names) > 1 else ""), at, (0, 0),
                textcoords="offset points", fontsize=7.5, color=colour, zorder=6, ha="center",
                va="center", bbox=_BEHIND,
            )  # fmt: skip
            text.set_in_layout(False)  # it lies within
            half = np.array(text.get_window_extent(renderer).size) / 2.0
            # the nearest middles in each direction at which the place is so far beyond the edge
            beside = np.vstack([along * far * dot + np.sign(along.round(9)) * half for far in _FAR])
            middle = self.ax.transData.transform(at) + beside
            found = _about(middle, half + _PAD)
            outside = _common(found, found).diagonal() - _common(found, within)[:, 0]
            # a name across a leader would be taken for the one that it leads to
            both = np.vstack([taken, leaders])
            cost = _ON_NAMES * (4.0 * outside + _common(found, both).sum(axis=1))
            cost += _ON_MARKS * _common(found, marked).sum(axis=1)
            cost += _ON_LINES * _common(found, crossed).sum(axis=1)
            far = np.hypot(*np.maximum(np.abs(beside) - half, 0.0).T)
            place = self.ax.transData.transform(at)
            edges = np.clip(0.0, beside - half, beside + half)  # where a line to it would end
            over = np.array([_common(_dotted(place, place + e), both).sum() for e in edges])
            cost += _ON_NAMES * (far >= _LEADER * dot) * over
            least = int(np.argmin(cost + _AWAY * far * half[1]))
            text.set_position(beside[least] / dot)
            if far[least] >= _LEADER * dot:
                leaders = np.vstack([leaders, _dotted(place, place + edges[least])])
                self.ax.annotate(
                    "", at, edges[least] / dot, textcoords="offset points", zorder=5,
                    arrowprops={"arrowstyle": "-", "color": colour, "linewidth": 0.5},
                ).set_in_layout(False)  # fmt: skip
            taken = np.vstack([taken, found[least]])


def _about(middles: np.ndarray, half: float | np.ndarray) -> np.ndarray:
    """Boxes (n, 4), of two corners each, about middles (n, 2), of half their width and height."""
    return np.hstack([middles - half, middles + half])


def _dotted(start: np.ndarray, end: np.ndarray) -> np.ndarray:
    """Boxes (n, 4) in a row along a line, in pixels."""
    count = int(np.hypot(*(end - start)) / (2.0 * _THIN)) + 1
    return _about(start + (end - start) * ((np.arange(count) + 0.5) / count)[:, None], _THIN)


def _common(boxes: np.ndarray, others: np.ndarray) -> np.ndarray:
    """Areas (n, m) that boxes (n, 4) have in common with others (m, 4), of two corners each."""
    low = np.maximum(boxes[:, None, :2], others[:, :2])
    high = np.minimum(boxes[:, None, 2:], others[:, 2:])
    return np.prod(np.maximum(high - low, 0.0), axis=2)


_SIDE = _View(0, 1, ("station (m)", "y, up (m)"))
_TOP = _View(0, 2, ("station (m)", "z, right (m)"))
_END = _View(2, 1, ("z, right (m)", "y, up (m)"))


def draw_vehicle(scene: Scene, dispersions: Sequence[Dispersion], title: str, path: Path) -> Path:
    """Draw a scene; returns the path.

    Parameters
    ----------
    scene : with its nominal values
    dispersions : those of centres of mass are drawn as ellipses to their ends, or to three sigma
    title : above the drawing
    path : of the file; its ending says which kind
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
    written = []
    for place, view in views:
        ax = figure.add_subplot(place)
        labels = _Labels(ax, _APART * size)
        _outlines(labels, scene, view)
        _masses(labels, scene, view, reach)
        _joints(labels, scene, view)
        _forces(labels, scene, view, _ARROW * size)
        written.append(labels)
        ax.set(xlabel=view.labels[0], ylabel=view.labels[1])
        ax.set_aspect("equal", adjustable="datalim")
        # from behind, the vehicle is as wide as its view, and names stand beside it
        ax.margins(0.16 if view is _END else 0.08, 0.12)
        ax.grid(True, color="#e4e4e4", linewidth=0.5)
        ax.set_axisbelow(True)
        ax.spines[["top", "right"]].set_visible(False)
        ax.tick_params(labelsize=9)
    set_title(figure, title)
    if any(len(names) > 1 for labels in written for _, names, _ in labels.names.values()):
        figure.supxlabel(_SEVERAL, fontsize=9)
    figure.draw_without_rendering()  # it is laid out: names know how much room they have
    for labels in written:
        labels.write()
    return save(figure, path)


def _size(scene: Scene) -> float:
    """Length of the vehicle, m."""
    stations = [body.cg[0] for body in scene.body.values()]
    stations += [motor.station for motor in scene.motor]
    stations += [joint.point[0] for joint in scene.joint.values()]
    for body in scene.body.values():
        for part in body.outline:
            stations += part.stations or [point[0] for point in part.points]
    return max(max(stations) - min(stations), 1e-3)


def _outlines(labels: _Labels, scene: Scene, view: _View) -> None:
    """Parts of bodies: filled, or dashed where they are hollow."""
    for number, body in enumerate(scene.body.values()):
        tint, edge = TINTS[number % len(TINTS)], EDGES[number % len(EDGES)]
        for part in body.outline:
            style = {"edgecolor": edge, "linewidth": 1.1}
            style |= {"fill": False, "linestyle": "--"} if part.hollow else {"facecolor": tint}
            for shape in _shapes(part, view, style):
                labels.ax.add_patch(shape)
                outline = shape.get_path().transformed(shape.get_patch_transform())
                for corners in outline.to_polygons():
                    for start, end in pairwise(np.asarray(corners).tolist()):
                        labels.line(start, end)
            if part.points:
                labels.ax.plot(*zip(*map(view.at, part.points), strict=True), "o", color=edge, ms=3)


def _shapes(part: Part, view: _View, style: dict[str, object]) -> list[Polygon | Circle]:
    if part.stations is None or part.radii is None:
        return []
    y, z = part.offset
    if view is _END:
        return [Circle((z, y), radius, **style) for radius in part.radii if radius > 0.0]
    middle = y if view is _SIDE else z
    (front, aft), (first, second) = part.stations, part.radii
    corners = [
        (front, middle + first),
        (aft, middle + second),
        (aft, middle - second),
        (front, middle - first),
    ]
    return [Polygon(corners, closed=True, **style)]


def _masses(
    labels: _Labels, scene: Scene, view: _View, reach: dict[str, tuple[float, float]]
) -> None:
    """Centres of mass, and how far they vary."""
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
            middle = view.at([(low + high) / 2.0 for low, high in ends])
            width, height = view.at([high - low for low, high in ends])
            labels.ax.add_patch(Ellipse(middle, width, height, fill=False, edgecolor=edge, lw=0.8))


def _joints(labels: _Labels, scene: Scene, view: _View) -> None:
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
    """Springs, motors and loads as arrows of one length, in the direction of their force."""
    for spring in scene.spring:
        # body x points forward, stations count aft
        axis = _unit(spring.axis) if spring.axis else _between(spring.point, spring.second_point)
        if spring.bodies[1] != GROUND:
            _arrow(labels, view, spring.point, axis, length, GREEN, spring.name)
    for motor in scene.motor:
        _arrow(labels, view, _nozzle(motor), motor.direction, length, VERMILION, motor.name)
    for load in scene.load:
        point = load.point or scene.body[load.body].cg
        if any(load.force) and load.frame == "body":
            _arrow(labels, view, point, _unit(load.force), length, "#6a51a3", load.name)


def _arrow(
    labels: _Labels, view: _View, point: Point, along: Point, length: float, colour: str, name: str
) -> None:
    ax, start = labels.ax, view.at(point)
    step = view.at((-along[0] * length, along[1] * length, along[2] * length))
    if math.hypot(*step) < 0.05 * length:  # seen along it
        ax.plot(*start, marker="x", ms=5, color=colour, zorder=4)
        return
    end = (start[0] + step[0], start[1] + step[1])
    arrow = {"arrowstyle": "-|>", "color": colour, "linewidth": 1.5}
    ax.annotate("", end, start, arrowprops=arrow, zorder=4)
    ax.plot(*zip(start, end, strict=True), alpha=0.0)  # what the limits take into account
    labels.line(start, end)
    labels.add(end, name, colour)


def _nozzle(motor: Motor) -> Point:
    """Where a motor's force acts (`sepmc.physics.propulsion.thrust_arm`), layout coordinates."""
    y, z = motor.offset
    return (
        motor.station,
        -motor.radius * math.sin(motor.clock) + y,
        motor.radius * math.cos(motor.clock) + z,
    )


def _between(first: Point, second: Point | None) -> Point:
    """From one layout point to another, body axes."""
    end = second or first
    apart = (first[0] - end[0], end[1] - first[1], end[2] - first[2])
    return _unit(apart) if any(apart) else (1.0, 0.0, 0.0)


def _unit(vector: Sequence[float]) -> Point:
    x, y, z = np.array(vector) / np.linalg.norm(vector)
    return float(x), float(y), float(z)
