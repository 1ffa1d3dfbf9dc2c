"""Values that depend on the parameters of a case alone (masses, inertias, arms, initial motion), as
expressions; kernels compute them once per case, before it is integrated."""

from typing import Any

from sepmc.kernel.spec.kernel_spec import KernelSpec
from sepmc.kernel.spec.parameter_layout import WIND_FACTOR, WIND_TURN
from sepmc.kernel.tracer.formulas import ZERO, joints, loads, quat, vec3, vehicle
from sepmc.kernel.tracer.tracer import Expr, Scope, total
from sepmc.routines import layout as at
from sepmc.scene.model import GROUND


class Case:
    """Parameters of a case and values derived from them, as expressions of the given ``scope``,
    whose lines run once per case, before it is integrated. Vectors have three components, tensors
    nine, by rows."""

    def __init__(self, scope: Scope, spec: KernelSpec):
        self.scope, self.spec, self.model = scope, spec, spec.layout.model.scene[0]

    def number(self, index: int) -> Expr:
        """Parameter of the case by its index in the parameter vector, SI."""
        return self.scope.parameter(index)

    def vector(self, index: int) -> tuple[Expr, ...]:
        """Vector of three consecutive parameters, SI, by the index of the first."""
        return tuple(self.scope.parameter(index + i) for i in range(3))

    def body(self, body: str) -> int:
        """Index of the first parameter of a body, not GROUND, in the parameter vector."""
        return at.HEAD + at.BODY_SIZE * self.spec.bodies.index(body)

    def mass(self, body: str) -> Expr:
        """Mass of a body, kg."""
        return self.number(self.body(body) + at.MASS)

    def inverse_mass(self, body: str) -> Expr:
        """Inverse mass of a body, 1/kg."""
        return (1.0 / self.mass(body)).called("inverse_mass")

    def centre_of_mass(self, body: str) -> Any:
        """Mass centre of a body as a layout point (station, y, z), m; for the ground, the common
        mass centre of all bodies."""
        return self.common_centre if body == GROUND else self.vector(self.body(body) + at.CG)

    def inertia(self, body: str) -> Expr:
        """Inertia tensor of a body about its mass centre, body axes, kg m2, its ``inertia_factor``
        included."""
        p = self.body(body)
        return vehicle.inertia_tensor(
            self.number(p + at.INERTIA_FACTOR),
            self.vector(p + at.INERTIA),
            self.vector(p + at.PRODUCTS),
        )

    def group_inertia(self, group: tuple[str, ...]) -> Expr:
        """Sum of the inertia tensors of the bodies of a rigid group, each about its own mass
        centre, kg m2; their body axes stay parallel, but they may slide on each other."""
        inertia = self.inertia(group[0])
        for body in group[1:]:
            inertia = vec3.add_matrices(inertia, self.inertia(body))
        return inertia.called("inertia")

    def inverse_inertia(self, group: tuple[str, ...]) -> Expr:
        """Inverse of the summed inertia tensor of a rigid group (`group_inertia`), 1/(kg m2)."""
        return vec3.symmetric_inverse(self.group_inertia(group)).called("inverse_inertia")

    @property
    def common_centre(self) -> Expr:
        """Common mass centre of all bodies as a layout point (station, y, z), m."""
        bodies = self.spec.bodies
        weighted = vec3.scale(self.mass(bodies[0]), self.centre_of_mass(bodies[0]))
        for body in bodies[1:]:
            weighted = vec3.add(weighted, vec3.scale(self.mass(body), self.centre_of_mass(body)))
        return vec3.scale(1.0 / total([self.mass(body) for body in bodies]), weighted).called(
            "centre"
        )

    @property
    def attitude(self) -> Expr:
        """Initial attitude of the vehicle: quaternion, body to ground, scalar first."""
        return quat.from_angles(
            self.number(at.PITCH), self.number(at.YAW), self.number(at.ROLL)
        ).called("start")

    @property
    def velocity(self) -> Expr:
        """Initial velocity of the mass centre of the vehicle, ground axes, m/s."""
        path = vehicle.flight_direction(
            self.number(at.PITCH) - self.number(at.ALPHA), self.number(at.PATH_YAW)
        )
        return vec3.scale(self.number(at.SPEED), path).called("velocity")

    @property
    def stream(self) -> Expr:
        """Initial velocity of the vehicle relative to the steady wind (without a wind profile),
        ground axes, m/s."""
        wind = loads.wind(self.number(at.WIND_SPEED), self.number(at.WIND_DIRECTION))
        return vec3.sub(self.velocity, wind).called("stream")

    @property
    def gust(self) -> Any:
        """Factor f and turn t (an angle) of the wind profile as the vector f (cos t, 0, sin t);
        None without a profile, or if they are no parameters, but part of the stored profile."""
        slots = self.spec.layout.slots
        if WIND_FACTOR not in slots:
            return None
        return loads.wind(self.number(slots[WIND_FACTOR]), self.number(slots[WIND_TURN])).called(
            "gust"
        )

    def ends(self, start: int, bodies: tuple[str, str], has_second: bool) -> tuple[Any, Any, Any]:
        """Ends of a joint or spring on its two bodies.

        Returns the arm from the mass centre of each body to its point, and the vector from the
        first point to the second at the start; body axes, m. ``start`` is the index of the first
        parameter of the joint or spring. Unless it ``has_second`` point, both points coincide, and
        the vector is `ZERO`.
        """
        first = self.vector(start + at.POINT)
        second = self.vector(start + at.SECOND_POINT) if has_second else first
        one, other = (
            vehicle.arm(self.centre_of_mass(body), point).called("end")
            for body, point in zip(bodies, (first, second), strict=True)
        )
        return one, other, vehicle.arm(first, second) if has_second else ZERO

    def joint(self, name: str) -> int:
        """Index of the first parameter of a joint in the parameter vector."""
        number = list(self.spec.scene.joint).index(name)
        return int(self.model.joints_p) + at.JOINT_SIZE * number

    def joint_ends(self, name: str) -> tuple[Any, Any, Any]:
        """Ends of a joint, as in `ends`: the arms from the mass centres of its two bodies to its
        points, and the vector from the first point to the second at the start; body axes, m."""
        joint = self.spec.scene.joint[name]
        return self.ends(self.joint(name), joint.bodies, joint.second_point is not None)

    def swing(self, name: str, body: str) -> tuple[Any, Any]:
        """Initial angular rate of the second body of joint ``name`` relative to the first, rad/s,
        and the arm from the mass centre of ``body`` to the joint point, m; body axes."""
        start = self.joint(name)
        point = self.vector(start + at.POINT)
        return self.vector(start + at.SWING), vehicle.arm(self.centre_of_mass(body), point)

    def joint_axis(self, name: str, k: int) -> Expr:
        """Axis k (0 x, 1 y, 2 z) of a joint: unit vector in body axes of its first body."""
        slots = self.spec.layout.slots
        if (slot := slots.get(f"joint.{name}.x_axis.x")) is not None:
            ahead = vec3.unit(self.vector(slot)).called("axis")
            if k == 0:
                return ahead
            y = self.vector(slots[f"joint.{name}.y_axis.x"])
            up = joints.across(ahead, y).called("axis")
            return up if k == 1 else vec3.cross(ahead, up).called("axis")
        return self.scope.shared(10 * list(self.spec.scene.joint).index(name) + 3 * k, 3)

    def separation_sign(self, name: str) -> Expr:
        """Sign of the direction along the x axis of a joint in which its second body moves away: 1
        or -1."""
        return self.scope.shared(10 * list(self.spec.scene.joint).index(name) + 9)
