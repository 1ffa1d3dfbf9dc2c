"""Constraints that follow from others: which joints, in which phase. Their forces are then those of least sum of squares."""

from dataclasses import dataclass

import numpy as np

from sepmc.compiler.plan import joint_axes
from sepmc.kernels import layout as at
from sepmc.scene.kinds import rows_of
from sepmc.scene.model import GROUND, Joint, Scene

_SMALL = 1e-9  # share of the largest singular value below which a direction is not held


@dataclass(frozen=True)
class Redundancy:
    """In a phase, how many of its rows follow from the others, and the joints among which that is so."""

    phase: str
    rows: int
    redundant: int
    joints: list[str]

    @property
    def sentence(self) -> str:
        return (
            f"phase {self.phase}: {self.redundant} of {self.rows} constraint rows are redundant, among {', '.join(self.joints)}: the "
            "motion is that of the others; the forces of these joints are the ones of least sum of squares (column redundant_rows)"
        )


def redundancies(scene: Scene) -> list[Redundancy]:
    """Redundant joints of every phase as the scene starts, all bodies parallel."""
    found = []
    for phase in scene.phase:
        rows, owners = _rows(scene, phase.joints)
        if not len(rows):
            continue
        left, sizes, _ = np.linalg.svd(rows)
        rank = int(np.count_nonzero(sizes > _SMALL * sizes[0]))
        if rank < len(rows):
            involved = np.linalg.norm(left[:, rank:], axis=1) > 1e-6
            joints = list(dict.fromkeys(owner for owner, is_in in zip(owners, involved, strict=True) if is_in))
            found.append(Redundancy(phase.name, len(rows), len(rows) - rank, joints))
    return found


def _rows(scene: Scene, joints: dict[str, str]) -> tuple[np.ndarray, list[str]]:
    """Constraint rows (rows, 6 bodies) on velocities and rates of the moving bodies at the start, and the joint of each."""
    bodies = list(scene.body)
    rows, owners = [], []
    for name, kind in joints.items():
        joint = scene.joint[name]
        for code in rows_of(joint, kind):
            row = np.zeros((len(bodies) + 1, 6))  # the last for the ground, which does not move
            for place, (body, share) in enumerate(zip(joint.bodies, _shares(joint, code, scene), strict=True)):
                row[bodies.index(body) if body != GROUND else -1] += share * (-1.0 if place == 0 else 1.0)
            rows.append(row[:-1].ravel())
            owners.append(name)
    return np.array(rows), owners


def _shares(joint: Joint, code: int, scene: Scene) -> tuple[np.ndarray, np.ndarray]:
    """What a row takes of velocity and rate of the first and of the second body, both counted apart."""
    axes = joint_axes(joint.x_axis, joint.y_axis).reshape(3, 3)
    if at.ROTATION <= code < at.ROD:
        normal = np.cross(axes[(code - at.ROTATION) // 3], axes[(code - at.ROTATION) % 3])
        share = np.concatenate([np.zeros(3), normal])
        return share, share
    points = [np.array(joint.point), np.array(joint.second_point or joint.point)]
    if code == at.ROD:
        direction = _to_axes(points[1] - points[0])
        direction /= np.linalg.norm(direction)
    else:
        direction = axes[code]
    arms = [_to_axes(p - np.array(scene.body[b].cg if b in scene.body else p)) for p, b in zip(points, joint.bodies, strict=True)]
    first, second = (np.concatenate([direction, np.cross(arm, direction)]) for arm in arms)
    return first, second


def _to_axes(layout: np.ndarray) -> np.ndarray:
    """A layout vector in body axes: stations run aft."""
    return np.array([-1.0, 1.0, 1.0]) * layout
