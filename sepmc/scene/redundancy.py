"""Constraints that follow from others: which joints, in which phase. Their forces are then those of
least sum of squares."""

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from sepmc.routines import layout as at
from sepmc.scene.kinds import joint_axes, rows_of
from sepmc.scene.messages import Problems
from sepmc.scene.model import GROUND, Joint, Scene

# Singular values of the rows as shares of the largest: below the first a direction is held twice,
# between the two it is held so weakly that round-off decides whether it is.
_TWICE, _WEAKLY = 1e-14, 1e-6
_INDEPENDENT = 1e-9  # of a row that is left when what others hold is taken off


@dataclass(frozen=True)
class Redundancy:
    """In a phase, how many of its rows follow from the others, and the joints among which that is
    so."""

    phase: str
    rows: int
    redundant: int
    joints: list[str]

    @property
    def sentence(self) -> str:
        """What is redundant, and what joint forces then are, in words."""
        return (
            f"phase {self.phase}: {self.redundant} of {self.rows} constraint rows are redundant, "
            f"among {', '.join(self.joints)}: the "
            "motion is that of the others; the forces of these joints are not unique, the ones of "
            "least sum of squares are given "
            "(column redundant_rows), and a break load of one of them is compared with that"
        )


def redundancies(scene: Scene) -> list[Redundancy]:
    """Redundant joints of every phase as the scene starts, all bodies parallel."""
    found = []
    for phase, owners, left, shares in _directions(scene):
        rank = int(np.count_nonzero(shares > _TWICE))
        if rank < len(owners):
            found.append(
                Redundancy(phase, len(owners), len(owners) - rank, _among(left[:, rank:], owners))
            )
    return found


def check_redundancy(scene: Scene, problems: Problems) -> None:
    """Joints that hold nearly the same direction: neither one joint nor two, so nothing a motion
    could be computed for."""
    for phase, owners, left, shares in _directions(scene):
        weak = (shares > _TWICE) & (shares < _WEAKLY)
        if weak.any():
            joints = _among(left[:, : len(shares)][:, weak], owners)
            share = shares[weak].min()
            said = (
                f"{', '.join(joints)} hold nearly the same (to {share:.1e}): make their points "
                "and axes agree, or differ clearly"
            )
            problems.add(f"phase.{phase}.joints", said)


def _directions(scene: Scene) -> Iterator[tuple[str, list[str], np.ndarray, np.ndarray]]:
    """Of every phase that holds something: its name, the joint of each row, and the rows' left
    singular vectors with their singular values as shares of the largest."""
    for phase in scene.phase:
        with np.errstate(over="ignore", invalid="ignore"):
            held = [
                (name, code)
                for name, kind in phase.joints.items()
                for code in rows_of(scene.joint[name], kind)
            ]
            rows, owners = (
                _rows(scene, held).reshape(len(held), 6 * len(scene.body)),
                [name for name, _ in held],
            )
        if len(rows) and np.isfinite(rows).all():
            left, sizes, _ = np.linalg.svd(rows)
            yield phase.name, owners, left, sizes / sizes[0]


def _among(vectors: np.ndarray, owners: list[str]) -> list[str]:
    """Joints whose rows have a part in any of the vectors (rows, n)."""
    involved = np.linalg.norm(vectors, axis=1) > 1e-3
    return list(
        dict.fromkeys(owner for owner, is_in in zip(owners, involved, strict=True) if is_in)
    )


def _rows(scene: Scene, held: list[tuple[str, int]]) -> np.ndarray:
    """Constraint rows (rows, bodies, 6) on velocities and rates of the moving bodies at the start,
    given by joint and code.

    Rates count as speeds at the end of the longest arm, and rows have unit length, so that no
    choice of units makes one weak.
    """
    bodies = list(scene.body)
    # the last body is the ground, which does not move
    found = np.zeros((len(held), len(bodies) + 1, 6))
    for row, (name, code) in zip(found, held, strict=True):
        joint = scene.joint[name]
        for place, (body, share) in enumerate(
            zip(joint.bodies, _shares(joint, code, scene), strict=True)
        ):
            row[bodies.index(body) if body != GROUND else -1] += share * (
                -1.0 if place == 0 else 1.0
            )
    found = found[:, :-1]
    arms = [float(np.linalg.norm(row[:, 3:], axis=1).max()) for row in found if row[:, :3].any()]
    found[:, :, 3:] /= max([1.0, *arms])
    return _of_unit_length(found)


def _of_unit_length(rows: np.ndarray) -> np.ndarray:
    sizes = np.sqrt((rows**2).sum(axis=(1, 2), keepdims=True))
    return np.asarray(rows / np.where(sizes > 0.0, sizes, 1.0))


def dependent_rows(
    scene: Scene, held: list[tuple[str, int]], groups: list[tuple[str, ...]]
) -> list[int]:
    """Which of the rows, given by joint and code, follow at the start from those before them;
    bodies of a group turn as one."""
    with np.errstate(over="ignore", invalid="ignore"):
        rows = _rows(scene, held)
    bodies = list(scene.body)
    for group in groups:
        first, *others = (bodies.index(body) for body in group if body != GROUND)
        for other in others:
            rows[:, first, 3:] += rows[:, other, 3:]
            rows[:, other, 3:] = 0.0
        if GROUND in group:
            rows[:, first, 3:] = 0.0
    found, kept = [], np.zeros((0, 6 * len(bodies)))
    for number, row in enumerate(_of_unit_length(rows).reshape(len(held), 6 * len(bodies))):
        left = row
        for _ in range(2):  # the second time takes off what round-off left of the first
            left = left - kept.T @ (kept @ left)
        if np.linalg.norm(left) > _INDEPENDENT:
            kept = np.vstack([kept, left / np.linalg.norm(left)])
        else:
            found.append(number)
    return found


def _shares(joint: Joint, code: int, scene: Scene) -> tuple[np.ndarray, np.ndarray]:
    """What a row takes of velocity and rate of the first and of the second body, both counted
    apart."""
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
    arms = [
        _to_axes(p - np.array(scene.body[b].cg if b in scene.body else p))
        for p, b in zip(points, joint.bodies, strict=True)
    ]
    first, second = (np.concatenate([direction, np.cross(arm, direction)]) for arm in arms)
    return first, second


def _to_axes(layout: np.ndarray) -> np.ndarray:
    """A layout vector in body axes: stations run aft."""
    return np.array([-1.0, 1.0, 1.0]) * layout
