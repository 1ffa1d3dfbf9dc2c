"""Checks that dispersed joint axes, spring axes and outlines are valid in every case."""

import math
from collections.abc import Sequence

from sepmc.scene.dispersion import Dispersion
from sepmc.scene.limits import FULL_TURN
from sepmc.scene.messages import Problems
from sepmc.scene.model import XYZ, Scene
from sepmc.scene.parameters import item_names

Ranges = dict[str, tuple[float, float]]  # SI, by path
Box = list[tuple[float, float]]
_MAY_BE_ZERO = "the axis may be zero: narrow the distributions"


def check_shapes(dispersions: Sequence[Dispersion], scene: Scene, problems: Problems) -> None:
    """Add a problem for each axis that ``dispersions`` can make zero, each joint whose two axes
    they can make parallel, each shell or sector that they can give no length, and each sector that
    they can give no angle, or more than a full turn. A normal distribution without truncation is
    taken to reach 3 sigma."""
    ranges: Ranges = {}
    for one in dispersions:
        low, high = (bound * one.parameter.factor for bound in one.reach)
        ranges[one.parameter.path] = low, high
    for spring in scene.spring:
        if spring.axis is not None:
            path = f"spring.{spring.name}.axis"
            if _may_vanish(_box(path, spring.axis, ranges)):
                problems.add(f"dispersion.{path}", _MAY_BE_ZERO, list(spring.axis))
    for name, joint in scene.joint.items():
        x, y = (
            _box(f"joint.{name}.{key}", axis, ranges)
            for key, axis in (("x_axis", joint.x_axis), ("y_axis", joint.y_axis))
        )
        if _may_vanish(x):
            problems.add(f"dispersion.joint.{name}.x_axis", _MAY_BE_ZERO, list(joint.x_axis))
        elif _may_vanish(_cross(x, y)):
            problems.add(
                f"dispersion.joint.{name}.y_axis",
                "the axis may be zero or parallel to x_axis: narrow the distributions",
                list(joint.y_axis),
            )
    for name, body in scene.body.items():
        for label, part in zip(item_names(body.outline), body.outline, strict=True):
            key_path = f"body.{name}.outline.{label}"
            if part.sector is not None:
                first, last = (
                    ranges.get(f"{key_path}.sector.{k}", (angle, angle))
                    for k, angle in enumerate(part.sector)
                )
                if not (first[1] < last[0] and last[1] - first[0] <= FULL_TURN):
                    problems.add(
                        f"dispersion.{key_path}.sector_deg",
                        "the sector may have no width, or more than 360 deg: narrow the "
                        "distributions",
                        [math.degrees(x) for x in part.sector],
                    )
            if part.is_wall and part.stations is not None:
                first, last = (
                    ranges.get(f"{key_path}.stations.{k}", (station, station))
                    for k, station in enumerate(part.stations)
                )
                if first[0] <= last[1] and last[0] <= first[1]:
                    problems.add(
                        f"dispersion.{key_path}.stations",
                        "the shell or sector may have no length: narrow the distributions",
                        list(part.stations),
                    )


def _box(path: str, axis: Sequence[float], ranges: Ranges) -> Box:
    """Ranges (low, high) of the three components of an axis vector: of a dispersed component from
    ``ranges``, of others the nominal value twice."""
    return [
        ranges.get(f"{path}.{key}", (value, value)) for key, value in zip(XYZ, axis, strict=True)
    ]


def _may_vanish(box: Box) -> bool:
    """True if the box contains the zero vector."""
    return all(low <= 0.0 <= high for low, high in box)


def _cross(x: Box, y: Box) -> Box:
    """Box that contains the cross product of every vector of one box with every one of another."""
    box = []
    for i in range(3):
        j, k = (i + 1) % 3, (i + 2) % 3
        one, other = _products(x[j], y[k]), _products(x[k], y[j])
        box.append((min(one) - max(other), max(one) - min(other)))
    return box


def _products(a: tuple[float, float], b: tuple[float, float]) -> list[float]:
    """The four products of an end of one range and an end of another."""
    return [p * q for p in a for q in b]
