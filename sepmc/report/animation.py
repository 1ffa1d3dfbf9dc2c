"""One case as a moving drawing: the bodies from the side and from above while they part."""

from collections.abc import Callable, Sequence
from pathlib import Path

import numpy as np
import pandas as pd
from matplotlib.animation import FFMpegWriter, PillowWriter
from matplotlib.axes import Axes
from matplotlib.patches import Polygon
from scipy.spatial import ConvexHull, QhullError
from scipy.spatial.transform import Rotation

from sepmc.report.style import BLACK, EDGES, TINTS, VERMILION, make_axes, to_words
from sepmc.scene.model import GROUND, Body, Joint, Part, Scene

FRAMES, _PER_SECOND, _AROUND = 100, 20, 40  # of the film; points around a rim
_VIEWS = ((1, "up (m)"), (2, "right (m)"))  # coordinate across the flight, and its name
_SIGNS = "+ centre of mass; square: joint, filled until its release; arrow: its constraint force"
_SHAPE = 0.3  # height of a view, of its width
_MARGIN = 0.08  # of the width, around what is drawn
_ARROW = 0.15  # of the vehicle's length: the greatest constraint force


def animate(
    history: pd.DataFrame,
    scene: Scene,
    title: str,
    path: Path,
    progress: Callable[[int], None] = lambda frame: None,
) -> Path:
    """Write the film of one case, a GIF or MP4 as its name ends; returns its path.

    The picture moves with the common centre of mass and keeps the attitude that the first body
    starts with: stations run to the right, as in drawings of the vehicle. The view begins at the
    size of the vehicle and widens as the bodies part. A joint is filled until its release; an
    arrow is the constraint force on a joint's second body, the longest the greatest.

    Parameters
    ----------
    history : DataFrame
        Rows of a single flight, see `sepmc.schema.history_columns`; ``attrs["releases"]`` has the
        time in s at which each joint became free (NaN if it did not).
    scene : of this case
    title : above the film
    path : ends in .gif, or in .mp4 where ffmpeg is installed
    progress : told the number of each frame

    Raises
    ------
    ValueError
        If there is no ffmpeg for an MP4.
    """
    if path.suffix == ".mp4" and not FFMpegWriter.isAvailable():
        raise ValueError(f"{path}: an MP4 needs ffmpeg, which is not installed; use .gif")
    writer = (FFMpegWriter if path.suffix == ".mp4" else PillowWriter)(fps=_PER_SECOND)
    shots = [_Shot(history, scene, row) for row in _rows(history)]
    views, length = _views(shots, scene)
    force = max((shot.largest_force for shot in shots), default=0.0)
    figure, axes = make_axes(2, 1, (8.0, 2.9))

    def show(number: int) -> None:
        shot, view = shots[number], views[number]
        for ax, (up, label) in zip(axes, _VIEWS, strict=True):
            ax.clear()
            shot.draw(ax, up, force, _ARROW * length)
            ax.set_aspect("equal", adjustable="box")
            ax.set(xlim=view[0], ylim=view[up], ylabel=label)
            ax.grid(True, color="#e4e4e4", linewidth=0.5)
        axes[-1].set_xlabel(f"aft (m)\n{_SIGNS}", fontsize=9)
        figure.suptitle(f"{title}\n{shot.caption}", fontsize=10)

    show(len(shots) - 1)  # the widest view has the longest numbers at its axes
    figure.canvas.draw()
    figure.set_layout_engine("none")  # found once: frames stand still, and take half of the time
    with writer.saving(figure, str(path), dpi=90):
        for number in range(len(shots)):
            show(number)
            writer.grab_frame()
            progress(number)
    return path


def _rows(history: pd.DataFrame) -> list[int]:
    """Rows of a history at equal steps of time."""
    times = history["time_s"].to_numpy()
    wanted = np.linspace(times[0], times[-1], FRAMES)
    places = np.clip(np.searchsorted(times, wanted), 0, len(times) - 1)
    return list(dict.fromkeys(places.tolist()))


class _Shot:
    """Where the bodies of a case are at one instant."""

    def __init__(self, history: pd.DataFrame, scene: Scene, row: int):
        self.scene, now, start = scene, history.iloc[row], history.iloc[0]
        first, *_ = scene.body
        to_picture = _attitude(start, first).inv()
        masses = np.array([body.mass for body in scene.body.values()])
        places = np.array([[now[f"{b}_{axis}_m"] for axis in "xyz"] for b in scene.body])
        centre = masses @ places / masses.sum()
        self.places = dict(zip(scene.body, to_picture.apply(places - centre), strict=True))
        self.turns = {name: to_picture * _attitude(now, name) for name in scene.body}
        self.forces = {
            name: self.turns[joint.bodies[0]].apply(
                [now[f"{name}_force_on_{joint.bodies[1]}_{axis}_N"] for axis in "xyz"]
            )
            for name, joint in scene.joint.items()
            if GROUND not in joint.bodies
        }
        held = {j for phase in scene.phase for j, kind in phase.joints.items() if kind != "free"}
        releases = history.attrs["releases"]
        self.held = {j for j in held if not now["time_s"] >= releases[j]}  # NaN: never released
        self.caption = f"{now['time_s']:.3f} s, {to_words(now['phase'])}"
        if self.forces and self.largest_force > 0.0:
            joint = max(self.forces, key=lambda name: float(np.linalg.norm(self.forces[name])))
            second = scene.joint[joint].bodies[1]
            several = "largest " if len(self.forces) > 1 else ""
            self.caption += (
                f"; {several}constraint force {self.largest_force:,.0f} N: of {to_words(joint)} "
                f"on {to_words(second)}"
            )

    @property
    def largest_force(self) -> float:
        """The largest constraint force, N."""
        return max((float(np.linalg.norm(f)) for f in self.forces.values()), default=0.0)

    def at(self, body: str, points: np.ndarray) -> np.ndarray:
        """Layout points (n, 3) of a body in the picture: aft, up, right (n, 3)."""
        arms = (points - np.array(self.scene.body[body].cg)) * [-1.0, 1.0, 1.0]
        return (self.places[body] + self.turns[body].apply(arms)) * [-1.0, 1.0, 1.0]

    def outer(self, name: str, body: Body) -> np.ndarray:
        """Points (n, 3) of a body that the view must hold."""
        parts = [np.array(p.points) if p.points else _rims(p) for p in body.outline]
        return self.at(name, np.concatenate([*parts, _marks(name, body, self.scene)]))

    def draw(self, ax: Axes, up: int, greatest: float, length: float) -> None:
        """Draw the bodies, joints and forces into a view."""
        for number, (name, body) in enumerate(self.scene.body.items()):
            tint, edge = TINTS[number % len(TINTS)], EDGES[number % len(EDGES)]
            for part in body.outline:
                if part.points:
                    ax.plot(*self.at(name, np.array(part.points))[:, [0, up]].T, "o", ms=3, c=edge)
                    continue
                style = {"fill": False, "ls": "--"} if part.hollow else {"fc": tint, "alpha": 0.9}
                hull = _hull(self.at(name, _rims(part))[:, [0, up]])
                ax.add_patch(Polygon(hull, closed=True, ec=edge, lw=1.1, **style))
            if not body.outline:
                marks = self.at(name, _marks(name, body, self.scene))[:, [0, up]]
                ax.plot(*marks.T, "-", color=edge, lw=2.0, alpha=0.6)
            ax.plot(*self.at(name, np.array([body.cg]))[0, [0, up]], "+", ms=9, mew=1.8, color=edge)
        for name, joint in self.scene.joint.items():
            self._joint(ax, up, name, joint, greatest, length)

    def _joint(
        self, ax: Axes, up: int, name: str, joint: Joint, greatest: float, length: float
    ) -> None:
        second = joint.bodies[1]
        if second == GROUND:
            return
        point = joint.second_point or joint.point
        end = self.at(second, np.array([point]))[0, [0, up]]
        held = name in self.held
        ax.plot(*end, "s", ms=5, mfc=BLACK if held else "white", mec=BLACK, zorder=4)
        if name in self.forces and greatest > 0.0:
            force = (self.forces[name] * [-1.0, 1.0, 1.0])[[0, up]] * length / greatest
            if np.linalg.norm(force) > 0.01 * length:
                arrow = {"arrowstyle": "-|>", "color": VERMILION, "linewidth": 1.6}
                ax.annotate("", tuple(end + force), tuple(end), arrowprops=arrow, zorder=5)


def _attitude(row: pd.Series, body: str) -> Rotation:
    """Body to ground of a row: Rz(pitch) Ry(yaw) Rx(roll)."""
    angles = [row[f"{body}_{angle}_deg"] for angle in ("pitch", "yaw", "roll")]
    return Rotation.from_euler("ZYX", angles, degrees=True)


def _rims(part: Part) -> np.ndarray:
    """Layout points (n, 3) around both rims of a part."""
    assert part.stations is not None
    assert part.radii is not None
    around = np.linspace(0.0, 2.0 * np.pi, _AROUND, endpoint=False)
    y, z = part.offset
    return np.concatenate(
        [
            np.column_stack([np.full(_AROUND, s), y + r * np.cos(around), z + r * np.sin(around)])
            for s, r in zip(part.stations, part.radii, strict=True)
        ]
    )


def _hull(points: np.ndarray) -> np.ndarray:
    """The silhouette (m, 2) of points (n, 2) of a convex part."""
    try:
        return points[ConvexHull(points).vertices]
    except QhullError:  # seen edge on
        return points


def _marks(name: str, body: Body, scene: Scene) -> np.ndarray:
    """Layout points (n, 3) that stand for a body without an outline: its centre of mass and its
    joints."""
    points = [joint.point for joint in scene.joint.values() if name in joint.bodies]
    return np.array([point for joint in points for point in (body.cg, joint)] or [body.cg])


_View = tuple[tuple[float, float], ...]  # ends of the axes aft, up and right, m


def _views(shots: Sequence[_Shot], scene: Scene) -> tuple[list[_View], float]:
    """The view of each shot, which never shrinks and holds all bodies, and the vehicle's length in
    m."""
    views = []
    low, high = np.full(3, np.inf), np.full(3, -np.inf)
    length = 0.0
    for shot in shots:
        points = np.concatenate([shot.outer(name, body) for name, body in scene.body.items()])
        length = length or float(np.ptp(points[:, 0]))
        low, high = np.minimum(low, points.min(axis=0)), np.maximum(high, points.max(axis=0))
        middle, half = (low + high) / 2.0, (high - low) / 2.0 + _MARGIN * max(high - low)
        half[1:] = max(half[1], half[2], _SHAPE * half[0])
        half[0] = half[1] / _SHAPE
        ends = zip((middle - half).tolist(), (middle + half).tolist(), strict=True)
        views.append(tuple(ends))
    return views, length
