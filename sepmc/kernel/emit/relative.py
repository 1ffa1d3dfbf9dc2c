"""Angles of hinges, and distances and relative attitudes of pairs of bodies, as expressions."""

from typing import Any

from sepmc.kernel.emit.geometry import State
from sepmc.kernel.tracer.formulas import quat, scalar, square_root, vec3


def relative_values(s: State) -> list[Any]:
    """Values of the relative motions that are outputs, at a state, SI, in the order of
    `sepmc.schema.relative_columns`: angle and rate of each hinge; then, of each pair of bodies, the
    distance of the mass centres, and roll, yaw and pitch of the second body relative to the
    first."""
    values: list[Any] = []
    for joint in s.spec.scene.output.hinge:
        values += [hinge_angle(s, joint), hinge_rate(s, joint)]
    for first, second in s.spec.scene.output.relative:
        offset = vec3.sub(s.position(second), s.position(first)).called("offset")
        r = _from_first(s, first, second)
        values += [square_root(vec3.dot(offset, offset)), quat.roll(r), quat.yaw(r), quat.pitch(r)]
    return values


def hinge_angle(s: State, joint: str) -> Any:
    """Angle of a joint about its x axis, rad, -pi to pi: from its y axis as fixed in the first body
    to its y axis as fixed in the second, projected normal to x of the first body. It is positive
    from y toward z."""
    sine, cosine = hinge_components(s, joint)
    return scalar.arctan2(sine, cosine)


def hinge_components(s: State, joint: str) -> tuple[Any, Any]:
    """Sine and cosine of the angle of a joint about its x axis, both times a common factor: the
    components of its y axis, as fixed in the second body, along the z and the y axis fixed in the
    first."""
    turned = s.axis(joint, 1, second=True)
    return vec3.dot(turned, s.axis(joint, 2)), vec3.dot(turned, s.axis(joint, 1))


def hinge_rate(s: State, joint: str) -> Any:
    """Angular rate of the second body of a joint relative to the first, about the x axis of the
    joint, rad/s."""
    first, second = s.spec.scene.joint[joint].bodies
    return vec3.dot(s.axis(joint, 0), vec3.sub(s.spin(second), s.spin(first)))


def _from_first(s: State, first: str, second: str) -> Any:
    """Rotation matrix (nine numbers by rows) from the axes of body ``second`` to those of body
    ``first``; bodies of one rigid group are not treated separately."""
    a, b = s.attitude(first), s.attitude(second)
    columns = [vec3.unrotate(a, (b[k], b[3 + k], b[6 + k])) for k in range(3)]
    return tuple(columns[k][i] for i in range(3) for k in range(3))
