"""Names of bodies, joints and other entries of a scene that determine its result columns."""

import math

from sepmc.scene.model import Scene
from sepmc.schema import Contents, Formula


def contents(scene: Scene, dispersed: frozenset[str] = frozenset()) -> Contents:
    """Collect the names of bodies, joints, outputs and other entries of a scene for which results
    have columns.

    Parameters
    ----------
    scene : Scene
    dispersed : frozenset of str
        Paths of dispersed parameters: a spring has columns if its stroke is finite or dispersed.

    Returns
    -------
    Contents
    """
    pins = {
        name: joint.guide.pins for name, joint in scene.joint.items() if joint.guide is not None
    }
    return Contents(
        list(scene.body),
        {name: joint.bodies for name, joint in scene.joint.items()},
        scene.output.loads,
        {joint: pins[joint] for joint in scene.output.guide if joint in pins},
        tuple(clearance.name for clearance in scene.clearance),
        tuple(joint for joint in scene.output.tip_off if joint in scene.joint),
        tuple(event.name for event in scene.event),
        pins,
        scene.output.transverse,
        tuple(motor.name for motor in scene.motor if motor.trigger is not None),
        tuple(
            spring.name
            for spring in scene.spring
            if math.isfinite(spring.stroke) or f"spring.{spring.name}.stroke" in dispersed
        ),
        tuple(dict.fromkeys((r.joint, r.to) for r in scene.release if r.to != "free")),
        tuple(Formula(one.name, one.formula, one.unit) for one in scene.outcome),
        tuple(signal.name for signal in scene.signal),
        scene.output.hinge,
        scene.output.relative,
    )
