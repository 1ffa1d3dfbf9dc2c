"""What a scene has columns for."""

from sepmc.scene.model import Scene
from sepmc.schema import Contents


def contents(scene: Scene) -> Contents:
    """Bodies, joints and outputs of a scene, by name."""
    guides = {joint: scene.joint[joint].guide for joint in scene.output.guide}
    return Contents(
        list(scene.body),
        {name: joint.bodies for name, joint in scene.joint.items()},
        scene.output.loads,
        {joint: guide.pins for joint, guide in guides.items() if guide is not None},
        tuple(clearance.name for clearance in scene.clearance),
        scene.output.tip_off,
        tuple(event.name for event in scene.event),
    )
