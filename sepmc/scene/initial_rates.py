"""Joints across which one body already turns from the other at the start."""

from collections.abc import Iterator

import numpy as np

from sepmc.routines import layout as at
from sepmc.scene.kinds import KINDS, connected_bodies, joint_axes, rows_of
from sepmc.scene.messages import Problems
from sepmc.scene.model import GROUND, Joint, Scene

_ALONG = 1e-9  # of a rate: as much about an axis that is held is round-off


def initial_rates(
    scene: Scene, dispersed: frozenset[str] = frozenset()
) -> Iterator[tuple[str, set[str]]]:
    """Joints with a rate across them at the start, in some case, and the bodies that it turns: all
    that hang on the second body of the joint."""
    for name, joint in scene.joint.items():
        path = f"joint.{name}.omega."
        if any(joint.omega) or any(one.startswith(path) for one in dispersed):
            yield name, _beyond(scene, name)


def _beyond(scene: Scene, joint: str) -> set[str]:
    """What hangs together with the second body of a joint in the first phase, if the joint itself
    is left out."""
    groups = connected_bodies(scene, scene.phase[0], without=joint)
    return next(group for group in groups if scene.joint[joint].bodies[1] in group)


def check_initial_rates(scene: Scene, dispersed: frozenset[str], problems: Problems) -> None:
    """Rates across joints that a joint does not allow, or that do not say how bodies turn."""
    for name, beyond in initial_rates(scene, dispersed):
        joint, kind = scene.joint[name], scene.phase[0].joints.get(name, "free")
        place, first = f"joint.{name}.omega_deg_s", joint.bodies[0]
        shown = [float(f"{x:.6g}") for x in np.degrees(joint.omega)]
        if GROUND in beyond:
            problems.add(place, "would turn the ground, on which the second body hangs", shown)
        elif first in beyond:
            problems.add(
                place,
                f"{first} hangs on the second body by other joints too: they cannot turn",
                shown,
            )
        elif kind in KINDS or kind in joint.kind:
            if any(joint.omega) and _is_held(joint, kind, np.array(joint.omega)):
                said = f"has a part about an axis that {kind!r}, its kind in the first phase, holds"
                problems.add(place, said, shown)
            varied = [k for k, x in enumerate("xyz") if f"joint.{name}.omega.{x}" in dispersed]
            # several may go together, as rows of a plan do
            if len(varied) == 1 and _is_held(joint, kind, np.eye(3)[varied[0]]):
                problems.add(
                    f"dispersion.joint.{name}.omega_deg_s.{'xyz'[varied[0]]}",
                    f"would vary about an axis that {kind!r}, its kind in the first phase, holds",
                )


def _is_held(joint: Joint, kind: str, rate: np.ndarray) -> bool:
    """Whether a rate has a part about an axis that a kind of a joint holds."""
    axes = joint_axes(joint.x_axis, joint.y_axis).reshape(3, 3)
    for code in rows_of(joint, kind):
        if at.ROTATION <= code < at.ROD:
            second, first = divmod(code - at.ROTATION, 3)
            about = np.cross(axes[second], axes[first])
            if abs(about @ rate) > _ALONG * np.linalg.norm(rate):
                return True
    return False
