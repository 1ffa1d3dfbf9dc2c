"""Bodies and joints as a tree: rigid groups, their connections, and joint wrenches from Newton and
Euler."""

from dataclasses import dataclass

import numpy as np

from oracles.external_engines.case import GROUND, Array, Case, Joint, Motion, cross
from oracles.external_engines.schedule import Mode, Wrench

# a joint that holds one rotation, about x, y or z: axis of the first, axis of the second body
HELD_APART = ((2, 1), (2, 0), (1, 0))


@dataclass
class Group:
    """Rigid group of bodies connected by fixed joints.

    Attributes
    ----------
    lead : str
        The body whose axes are those of the group; body axes are parallel while mated.
    centre : ndarray, shape (3,)
        From the mass centre of ``lead`` to that of the group, m.
    arms : dict of ndarray, shape (3,)
        From the mass centre of the group to that of each body, m.
    """

    lead: str
    centre: Array
    arms: dict[str, Array]
    mass: float
    inertia: Array
    grounded: bool


@dataclass
class Link:
    """Joint that connects a group with its parent; points and axes in the axes of their groups.

    ``slides`` are the joint axes (unit vectors) along which the child moves, fixed in the parent.
    It turns about ``axes`` in sequence: the first fixed in the parent, the second in the child; or
    freely, if ``turns``.
    """

    joint: str
    slides: list[Array]
    axes: list[Array]
    turns: bool
    parent: str  # bodies
    child: str
    parent_group: int
    arm_parent: Array  # from the mass centres of the bodies to the joint point
    arm_child: Array
    from_parent: Array  # from the centre of the parent group to the joint point
    to_child: Array  # from the joint point to the centre of the child group


def _group(case: Case, names: list[str]) -> Group:
    """Rigid group of bodies in mated position."""
    if GROUND in names:
        return Group(
            GROUND,
            np.zeros(3),
            {n: case.ground.arm(case.body(n).cg) for n in names},
            0.0,
            np.zeros((3, 3)),
            True,
        )
    bodies = [case.bodies[n] for n in names]
    mass = sum(b.mass for b in bodies)
    centre = sum((b.mass * bodies[0].arm(b.cg) for b in bodies), np.zeros(3)) / mass
    arms = {b.name: bodies[0].arm(b.cg) - centre for b in bodies}
    inertia = np.zeros((3, 3))
    for b in bodies:
        r = arms[b.name]
        inertia += b.inertia + b.mass * ((r @ r) * np.eye(3) - np.outer(r, r))
    return Group(names[0], centre, arms, mass, inertia, False)


def tree_of(case: Case, kinds: dict[str, str]) -> tuple[list[Group], list[Link | None]]:
    """Groups, parents before children, and the joint of each with its parent (None: free, or the
    ground)."""
    names = [GROUND, *case.bodies]
    label = {n: n for n in names}
    for rigid in case.joints.values():
        if kinds[rigid.name] == "fixed":
            old, new = sorted(
                (label[rigid.first], label[rigid.second]), key=names.index, reverse=True
            )
            label = {n: new if x == old else x for n, x in label.items()}
    groups: list[Group] = []
    links: list[Link | None] = []
    seen: dict[str, int] = {}  # name of a group -> its place
    moving = [j for j in case.joints.values() if kinds[j.name] not in ("fixed", "free")]
    rods = [j.name for j in moving if kinds[j.name] == "rod"]
    if rods:
        raise NotImplementedError(f"no tree is built with rods: {', '.join(rods)}")
    waiting = list(dict.fromkeys(label.values()))
    while waiting:
        # the ground first, then what hangs on something that is placed, then a new free group
        hang = [
            (g, j)
            for g in waiting
            for j in moving
            if g in (label[j.first], label[j.second]) and _other(label, j, g) in seen
        ]
        joint: Joint | None
        root, joint = hang[0] if hang else (waiting[0], None)
        waiting.remove(root)
        group = _group(case, [n for n in names if label[n] == root])
        link = None
        if joint is not None:
            moving.remove(joint)
            forward = label[joint.second] == root
            parent, child = (joint.first, joint.second) if forward else (joint.second, joint.first)
            above, below = (
                (joint.arm_first, joint.arm_second)
                if forward
                else (joint.arm_second, joint.arm_first)
            )
            held = case.held(joint.name, kinds[joint.name])
            slides = [joint.axes[:, k] for k in range(3) if not held[k]]
            about = [joint.axes[:, k] for k in range(3) if not held[3 + k]]
            # the axes of first and second body that stay at right angles, see CONVENTIONS.md
            if len(about) == 2:
                of_first, of_second = HELD_APART[held[3:].index(True)]
                about = [joint.axes[:, of_first], joint.axes[:, of_second]]
            if not forward and slides and about:
                raise NotImplementedError(f"name the body nearer the ground first: {joint.name}")
            place = seen[label[parent]]
            at = groups[place].arms[parent] + above
            to = -(group.arms[child] + below)
            link = Link(
                joint.name,
                slides,
                about if len(about) < 3 else [],
                len(about) == 3,
                parent,
                child,
                place,
                above,
                below,
                at,
                to,
            )
        seen[root] = len(groups)
        groups.append(group)
        links.append(link)
    if moving:
        raise NotImplementedError(
            f"joints close a loop, no tree: {', '.join(j.name for j in moving)}"
        )
    return groups, links


def _other(label: dict[str, str], joint: Joint, group: str) -> str:
    a, b = label[joint.first], label[joint.second]
    return b if a == group else a


def newton_euler(
    case: Case,
    mode: Mode,
    motions: dict[str, Motion],
    accelerations: dict[str, tuple[Array, Array]],
    external: dict[str, tuple[Array, Array]],
) -> dict[str, Wrench]:
    """Wrench of every joint of a tree: load of the bodies beyond it minus their external loads.

    Parameters
    ----------
    accelerations : dict
        Of each body: of its mass centre (m/s2, ground axes) and angular (rad/s2, body axes).
    """
    out = {}
    active = [j for j in case.joints.values() if mode.kinds[j.name] != "free"]
    for joint in case.joints.values():
        a, b = motions[joint.first], motions[joint.second]
        at_a, at_b = a.point(joint.arm_first), b.point(joint.arm_second)
        force, moment = np.zeros(3), np.zeros(3)
        if joint in active:
            beyond, sign, place = (
                _beyond(joint.second, [j for j in active if j is not joint]),
                1.0,
                at_b,
            )
            if GROUND in beyond:
                beyond, sign = _beyond(joint.first, [j for j in active if j is not joint]), -1.0
            for name in beyond:
                body, m = case.bodies[name], motions[name]
                acceleration, alpha = accelerations[name]
                lack = body.mass * acceleration - external[name][0]
                turn = body.inertia @ alpha + cross(m.w, body.inertia @ m.w) - external[name][1]
                force = force + sign * lack
                moment = moment + sign * (m.R @ turn + cross(m.x - place, lack))
        force, moment, gap = a.R.T @ force, a.R.T @ moment, a.R.T @ (at_b - at_a)
        out[joint.name] = (-force, -moment - cross(gap, force), force, moment)
    return out


def _beyond(start: str, joints: list[Joint]) -> list[str]:
    """Bodies that these joints connect with one."""
    bodies = [start]
    for name in bodies:
        for joint in joints:
            if name in (joint.first, joint.second):
                other = joint.second if name == joint.first else joint.first
                if other not in bodies:
                    bodies.append(other)
    return bodies
