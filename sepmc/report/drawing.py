"""The vehicle as it starts, from the side, from above and from behind: outlines, centres of mass,
joints, springs, motors with their thrust, loads; where centres of mass vary, how far."""

import math
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from matplotlib.axes import Axes
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure
from matplotlib.patches import Circle, Ellipse, Polygon

from sepmc.report.style import BLACK, EDGES, GREEN, TINTS, VERMILION, entitle, save
from sepmc.scene.dispersion import Dispersion
from sepmc.scene.model import GROUND, Motor, Part, Scene

_ARROW, _APART = 0.09, 0.05  # of the vehicle's length: arrows, places that are taken for one
_MARK = 6.0  # pixels about a place that a name had better not cover
Point = tuple[float, float, float]


@dataclass(frozen=True)
class _View:
    """Which coordinates of a layout point (station, y, z) lie across and up; words for both."""

    across: int
    up: int
    labels: tuple[str, str]

    def at(self, point: Sequence[float]) -> tuple[float, float]:
        return point[self.across], point[self.up]


# where a name may stand beside its place: points across and up, and which of its sides is there
_BESIDE = [
    (across * far, up * far, side, end)
    for far in (5, 14, 24, 36)
    for up, end in ((1, "bottom"), (-1, "top"), (0, "center"))
    for across, side in ((1, "left"), (-1, "right"), (0, "center"))
    if across or up
]


class _Labels:
    """Names beside places of a view; of those whose places are the same, the first and how many
    there are more."""

    def __init__(self, ax: Axes, apart: float):
        self.ax, self.apart = ax, apart
        self.names: dict[tuple[int, int, str], tuple[tuple[float, float], list[str], str]] = {}
        self.marks: list[tuple[float, float]] = []

    def add(self, at: tuple[float, float], name: str, colour: str) -> None:
        """A name of a place."""
        cell = (round(at[0] / self.apart), round(at[1] / self.apart), colour)
        self.names.setdefault(cell, (at, [], colour))[1].append(name)
        self.marks.append(at)

    def write(self) -> None:
        """Write each name where it covers least of those before it and of places, and lies within
        the axes; the axes have been laid out."""
        canvas = self.ax.figure.canvas
        assert isinstance(canvas, FigureCanvasAgg)
        renderer, within = canvas.get_renderer(), np.array([self.ax.get_window_extent().extents])
        marks = self.ax.transData.transform(self.marks).reshape(-1, 2)
        taken = np.hstack([marks - _MARK, marks + _MARK])
        for at, names, colour in self.names.values():
            text = self.ax.annotate(
                names[0] + (f" +{len(names) - 1}" if len(names) > 1 else ""), at, (0, 0),
                textcoords="offset points", fontsize=7.5, color=colour, zorder=6,
            )  # fmt: skip
            text.set_in_layout(False)  # it lies within
            boxes = []
            for across, up, side, end in _BESIDE:
                text.set(position=(across, up), ha=side, va=end)
                boxes.append(text.get_window_extent(renderer).extents)
            found = np.array(boxes)
            outside = _common(found, found).diagonal() - _common(found, within)[:, 0]
            least = int(np.argmin(outside + _common(found, taken).sum(axis=1)))
            across, up, side, end = _BESIDE[least]
            text.set(position=(across, up), ha=side, va=end)
            taken = np.vstack([taken, found[least]])


def _common(boxes: np.ndarray, others: np.ndarray) -> np.ndarray:
    """Areas (n, m) that boxes (n, 4) have in common with others (m, 4), of two corners each."""
    low = np.maximum(boxes[:, None, :2], others[:, :2])
    high = np.minimum(boxes[:, None, 2:], others[:, 2:])
    return np.prod(np.maximum(high - low, 0.0), axis=2)


_SIDE = _View(0, 1, ("station (m)", "y, up (m)"))
_TOP = _View(0, 2, ("station (m)", "z, right (m)"))
_END = _View(2, 1, ("z, right (m)", "y, up (m)"))


def drawing(scene: Scene, dispersions: Sequence[Dispersion], title: str, path: Path) -> Path:
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
        _outlines(ax, scene, view)
        _masses(labels, scene, view, reach)
        _joints(labels, scene, view)
        _forces(labels, scene, view, _ARROW * size)
        written.append(labels)
        ax.set(xlabel=view.labels[0], ylabel=view.labels[1])
        ax.set_aspect("equal", adjustable="datalim")
        ax.margins(0.08)
        ax.grid(True, color="#e4e4e4", linewidth=0.5)
        ax.set_axisbelow(True)
        ax.spines[["top", "right"]].set_visible(False)
        ax.tick_params(labelsize=9)
    entitle(figure, title)
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


def _outlines(ax: Axes, scene: Scene, view: _View) -> None:
    """Parts of bodies: filled, or dashed where they are hollow."""
    for number, body in enumerate(scene.body.values()):
        tint, edge = TINTS[number % len(TINTS)], EDGES[number % len(EDGES)]
        for part in body.outline:
            style = {"edgecolor": edge, "linewidth": 1.1}
            style |= {"fill": False, "linestyle": "--"} if part.hollow else {"facecolor": tint}
            for shape in _shapes(part, view, style):
                ax.add_patch(shape)
            if part.points:
                ax.plot(*zip(*map(view.at, part.points), strict=True), "o", color=edge, ms=3)


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
