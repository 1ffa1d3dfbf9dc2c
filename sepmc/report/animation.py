"""Animation of one case: the separating bodies in side view and top view.

Layout points are points of the vehicle as a scene gives them: station (measured aft), y (up) and z
(right), m. In every function ``scene`` is the scene with the inputs of the case.
"""

from collections.abc import Callable, Sequence
from pathlib import Path

import numpy as np
import pandas as pd
from matplotlib.animation import FFMpegWriter, PillowWriter
from matplotlib.axes import Axes
from matplotlib.patches import Polygon
from scipy.spatial import ConvexHull, QhullError

from sepmc.report.poses import Poses, poses
from sepmc.report.style import BLACK, EDGES, TINTS, VERMILION, make_axes
from sepmc.scene.model import GROUND, Body, Joint, Part, Scene
from sepmc.wording import to_words

FRAMES, _PER_SECOND, _RIM_POINTS = 100, 20, 40  # frames, frames per second; points around a rim
_VIEWS = ((1, "up (m)"), (2, "right (m)"))  # lateral coordinate and its label
_LEGEND = "+ centre of mass; square: joint, filled until its release; arrow: its constraint force"
_ASPECT = 0.3  # smallest height / width of a view
_MARGIN = 0.08  # of the width, around the bodies
_MAX_ARROW = 0.15  # length of the largest constraint force / length of the vehicle


def animate(
    history: pd.DataFrame,
    scene: Scene,
    title: str,
    path: Path,
    progress: Callable[[int], None] = lambda frame: None,
) -> Path:
    """Write the animation of one case, in side view and top view, as GIF or MP4.

    The view moves with the common centre of mass and keeps the initial attitude of the first body:
    stations run to the right, as in drawings of the vehicle. It begins at the size of the vehicle
    and widens as the bodies separate. The square that marks a joint is filled until its release; an
    arrow is the constraint force on a joint's second body, scaled to the largest one. At most
    `FRAMES` frames are written, at about equal steps of time, so that every animation takes about
    as long.

    Parameters
    ----------
    history : DataFrame
        Motion of the case over time, with the columns of `sepmc.schema.history_columns`;
        ``attrs["releases"]`` is the time in s at which each joint became free (NaN if it did not).
    scene : Scene
        Scene with the inputs of this case.
    title : str
        Text above the views, followed by time and phase.
    path : Path
        Ends in .gif, or in .mp4 if ffmpeg is installed.
    progress : callable
        Called with the index, from 0, of each frame that is written.

    Returns
    -------
    Path
        ``path``.

    Raises
    ------
    ValueError
        If ``path`` ends in .mp4 and ffmpeg is not installed.
    """
    if path.suffix == ".mp4" and not FFMpegWriter.isAvailable():
        raise ValueError(f"{path}: an MP4 needs ffmpeg, which is not installed; use .gif")
    writer = (FFMpegWriter if path.suffix == ".mp4" else PillowWriter)(fps=_PER_SECOND)
    motion = poses(history, scene)
    frames = [_Frame(history, motion, scene, row) for row in _rows(history)]
    views, length = _frame_views(frames, scene)
    force = max((frame.largest_force for frame in frames), default=0.0)
    figure, axes = make_axes(2, 1, (8.0, 2.9))

    def show(number: int) -> None:
        frame, view = frames[number], views[number]
        for ax, (up, label) in zip(axes, _VIEWS, strict=True):
            ax.clear()
            frame.draw(ax, up, force, _MAX_ARROW * length)
            ax.set_aspect("equal", adjustable="box")
            ax.set(xlim=view[0], ylim=view[up], ylabel=label)
            ax.grid(True, color="#e4e4e4", linewidth=0.5)
        axes[-1].set_xlabel(f"aft (m)\n{_LEGEND}", fontsize=9)
        figure.suptitle(f"{title}\n{frame.caption}", fontsize=10)

    show(len(frames) - 1)  # the widest view has the longest tick labels
    figure.canvas.draw()
    figure.set_layout_engine("none")  # laid out once: axes do not move, in half the time
    with writer.saving(figure, str(path), dpi=90):
        for number in range(len(frames)):
            show(number)
            writer.grab_frame()
            progress(number)
    return path


def _rows(history: pd.DataFrame) -> list[int]:
    """Return the indices of the rows of a history at about equal time steps, at most `FRAMES`: of
    `FRAMES` equally spaced instants from its first to its last time, the first row at or after
    each, without repetitions."""
    times = history["time_s"].to_numpy()
    frame_times = np.linspace(times[0], times[-1], FRAMES)
    rows = np.clip(np.searchsorted(times, frame_times), 0, len(times) - 1)
    return list(dict.fromkeys(rows.tolist()))


class _Frame:
    """One frame of the animation: positions, attitudes and constraint forces of a case at the row
    with the index ``row`` of its history; ``motion`` is from `poses`."""

    def __init__(self, history: pd.DataFrame, motion: Poses, scene: Scene, row: int):
        self.scene, state = scene, history.iloc[row]
        self.positions = {name: each[row] for name, each in motion.positions.items()}
        self.rotations = {name: each[row] for name, each in motion.rotations.items()}
        self.forces = {name: each[row] for name, each in motion.forces.items()}
        locked = {j for phase in scene.phase for j, kind in phase.joints.items() if kind != "free"}
        releases = history.attrs["releases"]
        # NaN: never released
        self.locked = {j for j in locked if not state["time_s"] >= releases[j]}
        self.caption = f"{state['time_s']:.3f} s, {to_words(state['phase'])}"
        if self.forces and self.largest_force > 0.0:
            joint = max(self.forces, key=lambda name: float(np.linalg.norm(self.forces[name])))
            second = scene.joint[joint].bodies[1]
            prefix = "largest " if len(self.forces) > 1 else ""
            self.caption += (
                f"; {prefix}constraint force {self.largest_force:,.0f} N: of {to_words(joint)} "
                f"on {to_words(second)}"
            )

    @property
    def largest_force(self) -> float:
        """Magnitude of the largest constraint force in this frame, N; 0 without joints between two
        bodies."""
        return max((float(np.linalg.norm(f)) for f in self.forces.values()), default=0.0)

    def in_view(self, body: str, points: np.ndarray) -> np.ndarray:
        """Return layout points (n, 3) of a body, m, in the axes of the view, aft, up and right
        (n, 3), m, from the common centre of mass."""
        arms = (points - np.array(self.scene.body[body].cg)) * [-1.0, 1.0, 1.0]
        return (self.positions[body] + self.rotations[body].apply(arms)) * [-1.0, 1.0, 1.0]

    def outer(self, name: str, body: Body) -> np.ndarray:
        """Return the points (n, 3) of a body that the view must contain, aft, up and right of the
        common centre of mass, m: those of its outline, its centre of mass and its joints."""
        parts = [np.array(p.points) if p.points else _rim_points(p) for p in body.outline]
        return self.in_view(name, np.concatenate([*parts, _mark_points(name, body, self.scene)]))

    def draw(self, ax: Axes, up: int, max_force: float, length: float) -> None:
        """Draw bodies, joints and constraint forces into the axes ``ax``; ``up`` is the index of
        the vertical coordinate: 1 (up) for the side view, 2 (right) for the top view. A force of
        ``max_force`` (N) has an arrow of ``length`` (m)."""
        for number, (name, body) in enumerate(self.scene.body.items()):
            tint, edge = TINTS[number % len(TINTS)], EDGES[number % len(EDGES)]
            for part in body.outline:
                if part.points:
                    points = self.in_view(name, np.array(part.points))[:, [0, up]]
                    ax.plot(*points.T, "o", ms=3, c=edge)
                    continue
                style = {"fill": False, "ls": "--"} if part.hollow else {"fc": tint, "alpha": 0.9}
                if part.sector is not None:
                    style = {"fill": False}
                hull = _hull(self.in_view(name, _rim_points(part))[:, [0, up]])
                ax.add_patch(Polygon(hull, closed=True, ec=edge, lw=1.1, **style))
            if not body.outline:
                marks = self.in_view(name, _mark_points(name, body, self.scene))[:, [0, up]]
                ax.plot(*marks.T, "-", color=edge, lw=2.0, alpha=0.6)
            centre = self.in_view(name, np.array([body.cg]))[0, [0, up]]
            ax.plot(*centre, "+", ms=9, mew=1.8, color=edge)
        for name, joint in self.scene.joint.items():
            self._joint(ax, up, name, joint, max_force, length)

    def _joint(
        self, ax: Axes, up: int, name: str, joint: Joint, max_force: float, length: float
    ) -> None:
        """Draw the joint ``name`` and its constraint force, but nothing for a joint whose second
        body is the ground; other arguments as for `draw`."""
        second = joint.bodies[1]
        if second == GROUND:
            return
        point = joint.second_point or joint.point
        end = self.in_view(second, np.array([point]))[0, [0, up]]
        is_locked = name in self.locked
        ax.plot(*end, "s", ms=5, mfc=BLACK if is_locked else "white", mec=BLACK, zorder=4)
        if name in self.forces and max_force > 0.0:
            force = (self.forces[name] * [-1.0, 1.0, 1.0])[[0, up]] * length / max_force
            if np.linalg.norm(force) > 0.01 * length:
                arrow = {"arrowstyle": "-|>", "color": VERMILION, "linewidth": 1.6}
                ax.annotate("", tuple(end + force), tuple(end), arrowprops=arrow, zorder=5)


def _rim_points(part: Part) -> np.ndarray:
    """Return layout points (n, 3), m, around the two end circles of a part with stations and radii,
    or along the two end arcs of a sector."""
    assert part.stations is not None
    assert part.radii is not None
    around = np.linspace(0.0, 2.0 * np.pi, _RIM_POINTS, endpoint=False)
    if part.sector is not None:  # there angles count from z toward -y, here from y toward z
        around = np.linspace(*part.sector, _RIM_POINTS) + 0.5 * np.pi
    y, z = part.offset
    return np.concatenate(
        [
            np.column_stack(
                [np.full_like(around, s), y + r * np.cos(around), z + r * np.sin(around)]
            )
            for s, r in zip(part.stations, part.radii, strict=True)
        ]
    )


def _hull(points: np.ndarray) -> np.ndarray:
    """Return the corners (m, 2), in order around it, of the convex hull of points (n, 2), the
    silhouette of a convex part; the points themselves if they are on one line."""
    try:
        return points[ConvexHull(points).vertices]
    except QhullError:  # seen edge-on
        return points


def _mark_points(name: str, body: Body, scene: Scene) -> np.ndarray:
    """Return layout points (n, 3), m, of a line from the centre of mass of the body ``name`` to its
    first joint, back, to its second joint, and so on; it ends at its last joint. It is drawn for a
    body without an outline. Without joints it is the centre of mass alone, (1, 3)."""
    points = [joint.point for joint in scene.joint.values() if name in joint.bodies]
    return np.array([point for joint in points for point in (body.cg, joint)] or [body.cg])


_View = tuple[tuple[float, float], ...]  # ends of the axes aft, up and right, m


def _frame_views(frames: Sequence[_Frame], scene: Scene) -> tuple[list[_View], float]:
    """Return the view of each frame (low and high end of the axes aft, up and right, m) and the
    length of the vehicle at the start, m. A view contains, with a margin, all bodies as they are
    in this frame and in all earlier ones."""
    views = []
    low, high = np.full(3, np.inf), np.full(3, -np.inf)
    length = 0.0
    for frame in frames:
        points = np.concatenate([frame.outer(name, body) for name, body in scene.body.items()])
        length = length or float(np.ptp(points[:, 0]))
        low, high = np.minimum(low, points.min(axis=0)), np.maximum(high, points.max(axis=0))
        centre, half = (low + high) / 2.0, (high - low) / 2.0 + _MARGIN * max(high - low)
        half[1:] = max(half[1], half[2], _ASPECT * half[0])
        half[0] = half[1] / _ASPECT
        ends = zip((centre - half).tolist(), (centre + half).tolist(), strict=True)
        views.append(tuple(ends))
    return views, length
