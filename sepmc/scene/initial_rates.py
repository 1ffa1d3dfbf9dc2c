"""Initial relative angular rates across joints: which joints have one, and checks of them."""

from collections.abc import Iterator

import numpy as np

from sepmc.routines import layout as at
from sepmc.scene.kinds import KINDS, connected_bodies, joint_axes, rows_of
from sepmc.scene.messages import Problems
from sepmc.scene.model import GROUND, Joint, Scene

_ALONG = 1e-9  # relative: a smaller rate about a constrained axis is round-off


def initial_rates(
    scene: Scene, dispersed: frozenset[str] = frozenset()
) -> Iterator[tuple[str, set[str]]]:
    """Yield the joints with an initial relative rate (``omega``), nominal or dispersed.

    Parameters
    ----------
    scene : Scene
    dispersed : frozenset of str
        Paths of dispersed parameters.

    Yields
    ------
    joint : str
    rotated : set of str
        Names of the bodies that the rate rotates: the second body of the joint, and those that
        other joints connect to it in the first phase.
    """
    for name, joint in scene.joint.items():
        path = f"joint.{name}.omega."
        if any(joint.omega) or any(one.startswith(path) for one in dispersed):
            yield name, _rotated_bodies(scene, name)


def _rotated_bodies(scene: Scene, joint: str) -> set[str]:
    """Names of the second body of a joint and of those that other joints connect to it in the first
    phase."""
    groups = connected_bodies(scene, scene.phase[0], without=joint)
    return next(group for group in groups if scene.joint[joint].bodies[1] in group)


def check_initial_rates(scene: Scene, dispersed: frozenset[str], problems: Problems) -> None:
    """Add a problem for each initial rate that would rotate the ground, that would rotate the first
    body too, since other joints connect it to the second, or that has, or would vary in, a
    component that the joint constrains. ``dispersed`` has the paths of dispersed parameters; if two
    or three components of one rate are dispersed, these are not checked."""
    for name, rotated in initial_rates(scene, dispersed):
        joint, kind = scene.joint[name], scene.phase[0].joints.get(name, "free")
        key_path, first = f"joint.{name}.omega_deg_s", joint.bodies[0]
        rate = [float(f"{x:.6g}") for x in np.degrees(joint.omega)]
        if GROUND in rotated:
            problems.add(
                key_path,
                "must be 0: it would turn the ground, to which the second body is connected",
                rate,
            )
        elif first in rotated:
            problems.add(
                key_path,
                f"{first} is connected to the second body by other joints too, so this rate would "
                "turn both of them",
                rate,
            )
        elif kind in KINDS or kind in joint.kind:
            constrained_by = f"{kind!r}, its kind in the first phase, constrains"
            if any(joint.omega) and _is_constrained(joint, kind, np.array(joint.omega)):
                reason = f"must be 0 about an axis that {constrained_by}"
                problems.add(key_path, reason, rate)
            varied = [k for k, x in enumerate("xyz") if f"joint.{name}.omega.{x}" in dispersed]
            # several together may be valid, as in rows of run.samples
            if len(varied) == 1 and _is_constrained(joint, kind, np.eye(3)[varied[0]]):
                problems.add(
                    f"dispersion.joint.{name}.omega_deg_s.{'xyz'[varied[0]]}",
                    f"would vary about an axis that {constrained_by}",
                )


def _is_constrained(joint: Joint, kind: str, rate: np.ndarray) -> bool:
    """True if an angular rate (3,), in body axes, has a component about an axis about which the
    joint, of this kind, constrains rotation."""
    axes = joint_axes(joint.x_axis, joint.y_axis).reshape(3, 3)
    for code in rows_of(joint, kind):
        if at.ROTATION <= code < at.ROD:
            second, first = divmod(code - at.ROTATION, 3)
            about = np.cross(axes[second], axes[first])
            if abs(about @ rate) > _ALONG * np.linalg.norm(rate):
                return True
    return False
