"""Joint kinds as sets of constraint rows, each an integer code (`sepmc.routines.layout`): 0, 1, 2
for translation along the joint axis x, y, z, others for rotations and for a rod."""

import numpy as np

from sepmc.routines import layout as at
from sepmc.scene.model import GROUND, Joint, Phase, Scene


def _rotation(of_second: int, of_first: int) -> int:
    """Code of the constraint row that keeps a joint axis fixed in the second body perpendicular to
    one fixed in the first (0: x, 1: y, 2: z)."""
    return at.ROTATION + 3 * of_second + of_first


_ROLL, _YAW, _PITCH, _ALIGN_Y = _rotation(1, 2), _rotation(0, 2), _rotation(0, 1), _rotation(1, 0)
# Rows that constrain the rotations about these joint axes; for two axes, the pair that leaves the
# third free through a full turn.
_ROTATIONS = {
    "": (),
    "x": (_ROLL,),
    "y": (_YAW,),
    "z": (_PITCH,),
    "xy": (_ROLL, _YAW),
    "xz": (_ROLL, _ALIGN_Y),
    "yz": (_YAW, _PITCH),
    "xyz": (_ROLL, _YAW, _PITCH),
}


def _rows(translations: str, rotations: str) -> tuple[int, ...]:
    return (*("xyz".index(axis) for axis in translations), *_ROTATIONS[rotations])


KINDS: dict[str, tuple[int, ...]] = {
    "free": (),
    "fixed": _rows("xyz", "xyz"),
    "slider": _rows("yz", "xyz"),
    "revolute": _rows("xyz", "yz"),
    "cylindrical": _rows("yz", "yz"),
    "universal": _rows("xyz", "z"),
    "spherical": _rows("xyz", ""),
    "planar": _rows("x", "yz"),
    "point-on-plane": _rows("x", ""),
    "point-on-line": _rows("yz", ""),
    "rod": (at.ROD,),
}


def rows_of(joint: Joint, kind: str) -> tuple[int, ...]:
    """Codes of the constraint rows of a kind, which is one that the joint defines or one of
    `KINDS`: translations first, then rotations; none for "free". Raises KeyError if it is
    neither."""
    custom = joint.kind.get(kind)
    if custom is None:
        return KINDS[kind]
    return _rows("".join(sorted(set(custom.translations))), "".join(sorted(set(custom.rotations))))


def is_subset(rows: tuple[int, ...], of: tuple[int, ...]) -> bool:
    """True if the constraint rows ``of`` imply all of ``rows`` (codes): each is one of them, or a
    rotation while ``of`` constrains all three rotations."""
    fixes_rotation = sum(at.ROTATION <= row < at.ROD for row in of) == 3
    return all(row in of or (fixes_rotation and at.ROTATION <= row < at.ROD) for row in rows)


def leaves_pins_sliding(rows: tuple[int, ...]) -> bool:
    """True if a joint with these constraint rows can have guide pins that slide: translation along
    x is free, that along y and z and at least two rotations are constrained."""
    return (
        rows.count(1) == rows.count(2) == 1
        and 0 not in rows
        and sum(at.ROTATION <= row < at.ROD for row in rows) >= 2
    )


def joint_axes(x_axis: tuple[float, ...], y_axis: tuple[float, ...]) -> np.ndarray:
    """Orthonormal right-handed joint axes x, y, z, one after the other, shape (9,), from a vector
    along x and one whose part normal to it is along y; in the axes of these two, which need no unit
    length. NaN if one is zero; y and z are NaN or round-off if the two are parallel."""
    x = np.array(x_axis) / np.linalg.norm(x_axis)
    y = np.array(y_axis) - x * (x @ np.array(y_axis))
    y /= np.linalg.norm(y)
    return np.concatenate([x, y, np.cross(x, y)])


def mass_centres(scene: Scene, joint: Joint) -> list[tuple[float, float, float]]:
    """Layout points (m) of the nominal mass centres of a joint's two bodies; for the ground, the
    point of the joint."""
    return [scene.body[b].cg if b in scene.body else joint.point for b in joint.bodies]


def axial_offset(scene: Scene, joint: Joint) -> float:
    """Offset (m), along the x axis of a joint, of its second body's mass centre from its first
    body's, by `mass_centres`."""
    first, second = mass_centres(scene, joint)
    x = joint_axes(joint.x_axis, joint.y_axis)[:3]
    return float(
        (first[0] - second[0]) * x[0]
        + (second[1] - first[1]) * x[1]
        + (second[2] - first[2]) * x[2]
    )


def connected_bodies(scene: Scene, phase: Phase, without: str = "") -> list[set[str]]:
    """Partition of all bodies and the ground into sets of names: bodies of one set are connected by
    joints that constrain them in a phase. The joint ``without`` is not counted."""
    groups = [{name} for name in (*scene.body, GROUND)]
    for name, joint in scene.joint.items():
        if name != without and rows_of(joint, phase.joints.get(name, "free")):
            pair = set(joint.bodies)
            merged = set().union(*(group for group in groups if group & pair))
            groups = [*(group for group in groups if not group & pair), merged]
    return groups
