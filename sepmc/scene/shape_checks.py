"""What laws may do together to the axes of joints and springs, and to outlines."""

import math
from collections.abc import Sequence

import numpy as np

from sepmc.scene.dispersion import Dispersion
from sepmc.scene.messages import Problems
from sepmc.scene.model import Scene

_XYZ = ("x", "y", "z")
Ranges = dict[str, tuple[float, float]]  # SI, by path


def check_shapes(dispersions: Sequence[Dispersion], scene: Scene, problems: Problems) -> None:
    """Laws by which an axis may have no direction, or a shell no length. Of a normal law that is
    not cut, three sigma count."""
    ranges: Ranges = {}
    for one in dispersions:
        low, high = (bound * one.parameter.factor for bound in one.reach)
        ranges[one.parameter.path] = low, high
    for spring in scene.spring:
        path = f"spring.{spring.name}.axis"
        if spring.axis is not None and _reach(path, spring.axis, ranges) >= _length(spring.axis):
            problems.add(f"dispersion.{path}", "the axis may be zero", list(spring.axis))
    for name, joint in scene.joint.items():
        tilts = 0.0
        for key, axis in (("x_axis", joint.x_axis), ("y_axis", joint.y_axis)):
            share = _reach(f"joint.{name}.{key}", axis, ranges) / _length(axis)
            tilts += math.asin(share) if share < 1.0 else math.pi
        between = abs(math.sin(_angle(joint.x_axis, joint.y_axis)))
        if tilts > 0.0 and (tilts >= 0.5 * math.pi or math.sin(tilts) >= between):
            problems.add(
                f"dispersion.joint.{name}",
                "the y_axis may be zero or parallel to x_axis",
                list(joint.y_axis),
            )
    for name, body in scene.body.items():
        for number, part in enumerate(body.outline):
            place = f"body.{name}.outline.{number}"
            if part.hollow and part.stations is not None:
                first, last = (
                    ranges.get(f"{place}.stations.{k}", (station, station))
                    for k, station in enumerate(part.stations)
                )
                if first[0] <= last[1] and last[0] <= first[1]:
                    problems.add(
                        f"dispersion.{place}.stations",
                        "the shell may have no length",
                        list(part.stations),
                    )


def _length(axis: Sequence[float] | np.ndarray) -> float:
    return float(np.linalg.norm(axis))


def _angle(x: Sequence[float], y: Sequence[float]) -> float:
    return math.atan2(_length(np.cross(x, y)), float(np.dot(x, y)))


def _reach(path: str, axis: Sequence[float], ranges: Ranges) -> float:
    """How far the end of a vector may lie from where it is nominally."""
    away = [
        max(abs(bound - value) for bound in ranges.get(f"{path}.{key}", (value, value)))
        for key, value in zip(_XYZ, axis, strict=True)
    ]
    return _length(away)
