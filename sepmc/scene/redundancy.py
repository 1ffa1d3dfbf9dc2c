"""Redundant constraint rows: rows of the constraint Jacobian of a phase that depend linearly on
others. The multipliers are then not unique; those of minimum norm are computed."""

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from sepmc.routines import layout as at
from sepmc.scene.kinds import joint_axes, rows_of
from sepmc.scene.messages import Problems
from sepmc.scene.model import GROUND, Joint, Scene

# Singular values of the rows relative to the largest: below the first, rows are redundant; between
# the two they are nearly so, and round-off would decide.
_REDUNDANT, _NEARLY_REDUNDANT = 1e-14, 1e-6
_INDEPENDENT = 1e-9  # norm of an independent row's part normal to the others


@dataclass(frozen=True)
class Redundancy:
    """Redundancy of the constraint rows of one phase that has redundant rows.

    Attributes
    ----------
    phase : str
        Name of the phase.
    rows : int
        Number of constraint rows of the phase.
    redundant : int
        Number of rows that follow from the others, at least 1: a phase without such rows has no
        `Redundancy`.
    joints : list of str
        Names of the joints whose rows take part in a linear dependence.
    """

    phase: str
    rows: int
    redundant: int
    joints: list[str]

    @property
    def sentence(self) -> str:
        """Sentence for the user on the redundancy and what it means for forces in the joints."""
        return (
            f"phase {self.phase}: {self.redundant} of {self.rows} constraint rows are redundant, "
            f"among {', '.join(self.joints)}: the "
            "motion is that without them, but the forces in these joints are not unique. Reported, "
            "and compared with break loads, are the forces of minimum sum of squares; the column "
            "redundant_rows counts the rows"
        )


def redundancies(scene: Scene) -> list[Redundancy]:
    """Return a `Redundancy` for each phase that has redundant rows in the initial configuration, in
    the order of the phases. Nearly redundant rows (`check_redundancy`) do not count."""
    redundant_phases = []
    for phase, owners, left, ratios in _decompositions(scene):
        rank = int(np.count_nonzero(ratios > _REDUNDANT))
        if rank < len(owners):
            redundant_phases.append(
                Redundancy(
                    phase, len(owners), len(owners) - rank, _joints_of(left[:, rank:], owners)
                )
            )
    return redundant_phases


def check_redundancy(scene: Scene, problems: Problems) -> None:
    """Add a problem for each phase with joints whose rows are nearly but not exactly redundant:
    round-off would determine the motion."""
    for phase, owners, left, ratios in _decompositions(scene):
        weak = (ratios > _REDUNDANT) & (ratios < _NEARLY_REDUNDANT)
        if weak.any():
            joints = _joints_of(left[:, : len(ratios)][:, weak], owners)
            ratio = ratios[weak].min()
            reason = (
                f"{', '.join(joints)} constrain nearly the same (to {ratio:.1e}, relative): make "
                "their points and axes agree, or differ clearly"
            )
            problems.add(f"phase.{phase}.joints", reason)


def _decompositions(scene: Scene) -> Iterator[tuple[str, list[str], np.ndarray, np.ndarray]]:
    """Yield the singular value decomposition of the constraint rows of each phase that has rows:
    name of the phase, name of the joint of each row, left singular vectors (rows, rows) as columns,
    and singular values divided by the largest, in descending order. There are as many values as the
    smaller of the number of rows and 6 times the number of bodies. Phases whose rows overflow are
    left out."""
    for phase in scene.phase:
        with np.errstate(over="ignore", invalid="ignore"):
            coded = [
                (name, code)
                for name, kind in phase.joints.items()
                for code in rows_of(scene.joint[name], kind)
            ]
            rows, owners = (
                _rows(scene, coded).reshape(len(coded), 6 * len(scene.body)),
                [name for name, _ in coded],
            )
        if len(rows) and np.isfinite(rows).all():
            left, sizes, _ = np.linalg.svd(rows)
            yield phase.name, owners, left, sizes / sizes[0]


def _joints_of(vectors: np.ndarray, owners: list[str]) -> list[str]:
    """Names of the joints, each once, with a row whose components in the ``vectors`` (rows, n), the
    columns, have a norm above 1e-3; ``owners`` has the name of the joint of each row."""
    involved = np.linalg.norm(vectors, axis=1) > 1e-3
    return list(
        dict.fromkeys(owner for owner, is_in in zip(owners, involved, strict=True) if is_in)
    )


def _rows(scene: Scene, coded: list[tuple[str, int]]) -> np.ndarray:
    """Rows of the constraint Jacobian, which multiply velocity and angular rate of each body, in
    the initial configuration.

    Columns of angular rates are divided by a length, the longest lever arm of any row but at least
    1 m, and rows are then scaled to unit length, so that units do not matter.

    Parameters
    ----------
    scene : Scene
    coded : list of (joint, code)
        Joint name and row code (`kinds.rows_of`) of each row.

    Returns
    -------
    ndarray, shape (rows, bodies, 6)
        The ground is not among the bodies.
    """
    bodies = list(scene.body)
    # the last body is the ground, which does not move
    rows_of_bodies = np.zeros((len(coded), len(bodies) + 1, 6))
    for row, (name, code) in zip(rows_of_bodies, coded, strict=True):
        joint = scene.joint[name]
        for side, (body, coefficients) in enumerate(
            zip(joint.bodies, _coefficients(joint, code, scene), strict=True)
        ):
            row[bodies.index(body) if body != GROUND else -1] += coefficients * (
                -1.0 if side == 0 else 1.0
            )
    rows_of_bodies = rows_of_bodies[:, :-1]
    arms = [
        float(np.linalg.norm(row[:, 3:], axis=1).max())
        for row in rows_of_bodies
        if row[:, :3].any()
    ]
    rows_of_bodies[:, :, 3:] /= max([1.0, *arms])
    return _of_unit_length(rows_of_bodies)


def _of_unit_length(rows: np.ndarray) -> np.ndarray:
    """Copy of an array (rows, bodies, 6) whose rows are scaled to unit length; zero rows stay
    zero."""
    sizes = np.sqrt((rows**2).sum(axis=(1, 2), keepdims=True))
    return np.asarray(rows / np.where(sizes > 0.0, sizes, 1.0))


def dependent_rows(
    scene: Scene, coded: list[tuple[str, int]], groups: list[tuple[str, ...]]
) -> list[int]:
    """Find the constraint rows that, in the initial configuration, depend linearly on rows before
    them. The bodies of a group have one angular rate, which is zero in a group with the ground.

    Parameters
    ----------
    scene : Scene
    coded : list of (joint, code)
        Joint name and row code of each row.
    groups : list of tuple of str
        Names of the bodies of each group that rotates as one rigid body; the ground may be in a
        group, but not alone. Bodies in no group rotate on their own.

    Returns
    -------
    list of int
        Indices in ``coded`` of the dependent rows.
    """
    with np.errstate(over="ignore", invalid="ignore"):
        rows = _rows(scene, coded)
    bodies = list(scene.body)
    for group in groups:
        first, *others = (bodies.index(body) for body in group if body != GROUND)
        for other in others:
            rows[:, first, 3:] += rows[:, other, 3:]
            rows[:, other, 3:] = 0.0
        if GROUND in group:
            rows[:, first, 3:] = 0.0
    dependent, basis = [], np.zeros((0, 6 * len(bodies)))
    for number, row in enumerate(_of_unit_length(rows).reshape(len(coded), 6 * len(bodies))):
        rest = row
        for _ in range(2):  # Gram-Schmidt, repeated against round-off
            rest = rest - basis.T @ (basis @ rest)
        if np.linalg.norm(rest) > _INDEPENDENT:
            basis = np.vstack([basis, rest / np.linalg.norm(rest)])
        else:
            dependent.append(number)
    return dependent


def _coefficients(joint: Joint, code: int, scene: Scene) -> tuple[np.ndarray, np.ndarray]:
    """Coefficients (6,) of a constraint row (type ``code``, as in `sepmc.routines.layout`) for
    velocity (of the mass centre) and angular rate of the joint's first body, both in the vehicle's
    body axes, and those of its second body. The row is the difference: second minus first."""
    axes = joint_axes(joint.x_axis, joint.y_axis).reshape(3, 3)
    if at.ROTATION <= code < at.ROD:
        normal = np.cross(axes[(code - at.ROTATION) // 3], axes[(code - at.ROTATION) % 3])
        rotation = np.concatenate([np.zeros(3), normal])
        return rotation, rotation
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
    """Convert a vector (3,) from the layout, whose x counts aft, to body axes, whose x is
    forward."""
    return np.array([-1.0, 1.0, 1.0]) * layout
