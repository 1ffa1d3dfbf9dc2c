"""Contents of a scene that result columns follow from."""

from sepmc.scene.model import Scene
from sepmc.schema import Contents


def contents(scene: Scene) -> Contents:
    """Names of the bodies, joints, outputs, events and triggered motors of a scene."""
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
    )
