"""Kinematics at a state, as expressions: attitudes, angular rates, and relative positions and
motions of two bodies."""

from dataclasses import dataclass, replace
from typing import Any

from sepmc.kernel.emit.context import Context, component
from sepmc.kernel.spec.kernel_spec import Segment
from sepmc.kernel.tracer.formulas import UNIT, ZERO, joints, quat, square_root, vec3
from sepmc.kernel.tracer.tracer import Expr, Scope, product, where
from sepmc.routines import layout as at
from sepmc.scene.model import GROUND, Spring


@dataclass(frozen=True)
class Pair:
    """Relative position of a point fixed in body A and a point fixed in body B; ground axes.

    ``d`` = r_B - r_A is the vector between the points, m, ``d_rate`` its rate, m/s; ``rho_a``,
    ``rho_b`` are the arms from the mass centres to the points, m; ``spin_a``, ``spin_b`` the
    angular rates of the bodies, rad/s.
    """

    d: Any
    d_rate: Any
    rho_a: Any
    rho_b: Any
    spin_a: Any
    spin_b: Any


@dataclass(frozen=True)
class Slide:
    """Relative motion of two bodies A and B of one rigid group, which rotate together but may slide
    along each other; body axes of the group's ``leader``.

    ``r`` = R^T (x_B - x_A) is the vector between their mass centres, m, with the attitude R of the
    group; ``rate`` its rate, m/s; ``turning`` the velocity terms of its second derivative, m/s2:
    r'' = R^T (x_B'' - x_A'') - w' x r - turning, with the angular rate w of the group.
    """

    leader: str
    r: Any
    rate: Any
    turning: Any


@dataclass(frozen=True)
class Line:
    """Line between points of two bodies A and B, along which a force or constraint acts; ground
    axes.

    ``e`` is the unit vector along it: from A to B, or an axis fixed in A. One newton along the line
    is the force e on B and -e on A, both at B's point; ``arm_a``, ``arm_b`` are its moments on A
    and on B about their mass centres, m: e x (rho_a + d) and rho_b x e in terms of `Pair`.
    ``length`` is the component along e of the vector d from A's point to B's, m (along an axis it
    may be negative), ``rate`` its rate, m/s; ``gamma`` is minus the velocity terms of its second
    derivative, m/s2.
    ``own`` has direction and lever in the axes of the rigid group if ``e`` is fixed in a group that
    contains both bodies, else None.
    """

    e: Any
    arm_a: Any
    arm_b: Any
    gamma: Any
    length: Any
    rate: Any
    own: "Own | None" = None


@dataclass(frozen=True)
class Own:
    """Direction ``e`` (unit vector) along which two bodies of the rigid group led by ``leader`` may
    slide, and ``lever``: the moment on the group, per newton, of a force between the bodies along
    e, m. Both in body axes of the group; the lever is e x r with the r of `Slide`."""

    leader: str
    e: Any
    lever: Any


class State:
    """State of the bodies in a segment, and kinematics of it as expressions of ``scope``.

    The state vector is in the workspace field ``field``: S (a stage), Y (the end of a step), or
    another field. ``time`` names the field of its time; "" for CLOCK with S, else T. Vectors and
    matrices are expressions too; a body in a rigid group has the attitude and angular rate of the
    group's leader.
    """

    def __init__(self, c: Context, scope: Scope, segment: Segment, field: str, time: str = ""):
        self.c, self.scope, self.segment, self.field = c, scope, segment, field
        self.clock = time or ("CLOCK" if field == "S" else "T")
        self.spec, self.case = c.spec, c.case

    @property
    def time(self) -> Expr:
        """Time of the state, s."""
        return self.scope.load(self.clock)

    def position(self, body: str) -> Any:
        """Position of the mass centre of a body, ground axes, m, in a frame that moves with the
        initial velocity of the vehicle; its origin is at first the common mass centre. Of the
        ground it is the point at which the common mass centre was at the start."""
        if body == GROUND:  # its axes start at the initial mass centre
            return vec3.scale(self.time, self.velocity(GROUND)).called("x_ground")
        return self.scope.load(f"{self.field} + X_{body}", 3).called(f"x_{body}")

    def velocity(self, body: str) -> Any:
        """Velocity of the mass centre of a body, ground axes, m/s, in a frame that moves with the
        initial velocity of the vehicle: a part of the state, or for GROUND minus that velocity."""
        if body == GROUND:
            return vec3.scale(-1.0, self.case.velocity).called("ground_speed")
        return self.scope.load(f"{self.field} + V_{body}", 3).called(f"v_{body}")

    def stream(self, body: str) -> Any:
        """Initial velocity of the vehicle minus the wind at a body, ground axes, m/s: `velocity`
        plus this is the velocity of the body relative to the air."""
        if self.spec.scene.environment.wind.profile is None:
            return self.case.stream
        along, across = (self.scope.load(component(f"WIND_{body}", k)) for k in range(2))
        gust = self.case.gust
        if gust is not None:
            along, across = (
                along * gust[0] - across * gust[2],
                along * gust[2] + across * gust[0],
            )
        return vec3.sub(self.case.stream, (along, 0.0, across)).called("stream")

    def quaternion(self, leader: str) -> Expr:
        """Attitude quaternion (body to ground) of the rigid group that ``leader`` leads; not for
        GROUND, which has no field (`attitude` allows it)."""
        return self.scope.load(f"{self.field} + Q_{leader}", 4).called(f"q_{leader}")

    def rate(self, leader: str) -> Expr:
        """Angular rate of the rigid group that ``leader`` leads, body axes, rad/s; not for GROUND,
        which has no field (`spin` allows it)."""
        return self.scope.load(f"{self.field} + OMEGA_{leader}", 3).called(f"omega_{leader}")

    def attitude(self, body: str) -> Any:
        """Rotation matrix (nine numbers by rows) from the axes of a body to ground axes."""
        leader = self.segment.leader(body)
        if leader == GROUND:
            return quat.matrix(self.case.attitude).called("r_ground")
        return quat.matrix(self.quaternion(leader)).called(f"r_{leader}")

    def spin(self, body: str) -> Any:
        """Angular rate of a body, ground axes, rad/s; `ZERO` for one that is in the rigid group of
        the ground."""
        leader = self.segment.leader(body)
        return (
            ZERO
            if leader == GROUND
            else vec3.rotate(self.attitude(leader), self.rate(leader)).called(f"spin_{leader}")
        )

    def axis(self, joint: str, k: int, second: bool = False) -> Any:
        """Axis k (0 x, 1 y, 2 z) of a joint as fixed in its first body or, with ``second``, in its
        second body: unit vector, ground axes. Both are the same while the vehicle is mated."""
        r = self.attitude(self.spec.scene.joint[joint].bodies[int(second)])
        if self.spec.has_body_axes(joint):
            return (r[k], r[k + 3], r[k + 6])
        return vec3.rotate(r, self.case.joint_axis(joint, k)).called("e")

    def pair(self, bodies: tuple[str, str], end_a: Any, end_b: Any) -> Pair:
        """Relative position and velocity of a point of each of two bodies, the arms to the points
        and the rates of the bodies, in ground axes; ``end_a``, ``end_b`` are the arms from their
        mass centres to the points, body axes, m."""
        a, b = bodies
        rho_a = vec3.rotate(self.attitude(a), end_a).called("rho")
        rho_b = vec3.rotate(self.attitude(b), end_b).called("rho")
        spin_a, spin_b = self.spin(a), self.spin(b)
        gap = joints.between(
            self.position(a),
            self.velocity(a),
            rho_a,
            spin_a,
            self.position(b),
            self.velocity(b),
            rho_b,
            spin_b,
        )
        d, d_rate = gap.called("gap")
        return Pair(d, d_rate, rho_a, rho_b, spin_a, spin_b)

    def slide(self, bodies: tuple[str, str]) -> Slide | None:
        """Motion of the second of two ``bodies`` of one rigid group relative to the first, on which
        it may slide; None if they are not in one group, or the group contains the ground."""
        a, b = bodies
        leader = self.segment.leader(a)
        if leader == GROUND or self.segment.leader(b) != leader:
            return None
        attitude, omega = self.attitude(leader), self.rate(leader)
        r = vec3.unrotate(attitude, vec3.sub(self.position(b), self.position(a))).called("offset")
        across = vec3.cross(omega, r).called("swept")
        speed = vec3.unrotate(attitude, vec3.sub(self.velocity(b), self.velocity(a)))
        rate = vec3.sub(speed, across).called("slide")
        turning = vec3.cross(omega, vec3.add(vec3.add(rate, rate), across)).called("turning")
        return Slide(leader, r, rate, turning)

    def sliding_line(self, joint: str, k: int) -> Line | None:
        """Line along axis k (0 x, 1 y, 2 z) of a joint between bodies of one rigid group without
        the ground; its length is the distance of the joint's two points along the axis, m, which
        changes as the bodies slide. None for other joints."""
        slide = self.slide(self.spec.scene.joint[joint].bodies)
        if slide is None:
            return None
        plain = self.spec.has_body_axes(joint)
        e: Any = UNIT[k] if plain else self.case.joint_axis(joint, k)
        end_a, end_b, _ = self.case.joint_ends(joint)
        r = slide.r
        lever = tuple(
            e[(i + 1) % 3] * r[(i + 2) % 3] - e[(i + 2) % 3] * r[(i + 1) % 3] for i in range(3)
        )
        ends = vec3.sub(end_b, end_a).called("ends")
        pair, along = self.joint(joint), self.axis(joint, k)
        arm_a, arm_b, _ = translation(pair, along)
        return Line(
            along,
            arm_a,
            arm_b,
            product(e, slide.turning),
            product(e, r) + product(e, ends),
            product(e, slide.rate),
            Own(slide.leader, e, lever),
        )

    def joint(self, name: str) -> Pair:
        """Relative position and velocity of the points of a joint on its two bodies, with arms and
        rates, as `pair` returns them."""
        end_a, end_b, _ = self.case.joint_ends(name)
        return self.pair(self.spec.scene.joint[name].bodies, end_a, end_b)

    def separation(self, joint: str) -> Line:
        """Line along the x axis of a joint, but with the separation distance, m, and speed, m/s, as
        length and rate: zero at the start, positive as the bodies move apart. Direction, arms and
        gamma are those of the x axis, without the separation sign."""
        sign = self.case.separation_sign(joint)
        start = vec3.dot(self.case.joint_ends(joint)[2], self.case.joint_axis(joint, 0))
        line = self.sliding_line(joint, 0)
        if line is not None:
            distance = (sign * (line.length - start)).called("distance")
            return replace(line, length=distance, rate=sign * line.rate)
        pair, e = self.joint(joint), self.axis(joint, 0)
        arm_a, arm_b, gamma = translation(pair, e)
        distance = sign * (vec3.dot(pair.d, e) - start)
        return Line(
            e, arm_a, arm_b, gamma, distance.called("distance"), sign * translation_rate(pair, e)
        )

    def displacement(self, joint: str, k: int) -> Any:
        """Displacement since the start of the second body's point of a joint relative to the first
        body, along axis k (0 x, 1 y, 2 z) of the joint, m."""
        start = vec3.dot(self.case.joint_ends(joint)[2], self.case.joint_axis(joint, k))
        line = self.sliding_line(joint, k)
        if line is not None:
            return line.length - start
        return vec3.dot(self.joint(joint).d, self.axis(joint, k)) - start

    def relative_angles(self, joint: str) -> tuple[Any, Any, Any]:
        """Pitch, yaw and roll of the second body of a joint relative to the first, rad, with
        respect to the axes of the joint; zeros within a rigid group."""
        first, second = self.spec.scene.joint[joint].bodies
        if self.segment.leader(first) == self.segment.leader(second):
            return 0.0, 0.0, 0.0
        axes = [[self.axis(joint, k, second) for k in range(3)] for second in (False, True)]
        r = tuple(vec3.dot(a, b) for a in axes[0] for b in axes[1])
        return quat.pitch(r), quat.yaw(r), quat.roll(r)

    def sliding(self, joint: str) -> Any:
        """Number that is 1 while the present kind of a joint lets its guide pins slide, else 0; the
        known number 1.0 if all kinds possible in the segment do. At least one of them must."""
        return self.is_active(joint, self.segment.sliding_kinds(joint))

    def is_active(self, joint: str, kinds: tuple[int, ...]) -> Any:
        """Number that is 1 while the present kind of a joint has one of the numbers ``kinds`` (at
        least one), else 0; the known number 1.0 if these are all kinds possible in the segment."""
        if len(kinds) == len(self.segment.joint_kinds[joint]):
            return 1.0
        kind, active = self.scope.load(f"KIND_{joint}"), None
        for number in kinds:
            active = (
                kind.equals(float(number))
                if active is None
                else active | kind.equals(float(number))
            )
        assert active is not None
        return where(active, 1.0, 0.0).called("active")

    def friction(self, joint: str) -> Any:
        """Friction force of the guide pins on the second body of a joint, N, positive in the
        direction of separation, from the field FRICTION; None for a joint without friction."""
        friction_joints = self.spec.friction_joints(self.segment)
        return (
            self.scope.load(component("FRICTION", friction_joints.index(joint)))
            if joint in friction_joints
            else None
        )

    def lengthening(
        self,
        bodies: tuple[str, str],
        line: Line,
        accelerations: dict[str, Any],
        spin_rates: dict[str, Any],
        moving: bool = True,
    ) -> Any:
        """Second derivative of the length of a line between two bodies, for given accelerations.

        Parameters
        ----------
        bodies : tuple of str
            the two bodies of the line
        line : Line
        accelerations : dict of str to Expr
            accelerations of mass centres, by body, ground axes, m/s2
        spin_rates : dict of str to Expr
            angular accelerations of rigid groups, by leader, body axes, rad/s2
        moving : bool
            False to leave out the velocity terms (``gamma``), for the effect of a force alone

        Returns
        -------
        Expr
            m/s2
        """
        relative = relative_acceleration(accelerations, bodies)
        if line.own is not None:
            second_derivative = product(
                line.own.e, vec3.unrotate(self.attitude(line.own.leader), relative)
            )
            second_derivative = second_derivative - line.gamma if moving else second_derivative
            return second_derivative + product(line.own.lever, spin_rates[line.own.leader])
        second_derivative = vec3.dot(line.e, relative)
        second_derivative = second_derivative - line.gamma if moving else second_derivative
        for body, arm in zip(bodies, (line.arm_a, line.arm_b), strict=True):
            leader = self.segment.leader(body)
            if leader != GROUND:
                second_derivative = second_derivative + vec3.dot(
                    vec3.unrotate(self.attitude(leader), arm), spin_rates[leader]
                )
        return second_derivative

    def lengthening_by(self, field: str, bodies: tuple[str, str], line: Line) -> Any:
        """Second derivative of the length of a line between two bodies, m/s2, for the accelerations
        in the derivative of the state that the workspace field ``field`` (K1 or D) stores."""
        moving = {body: self.scope.load(f"{field} + V_{body}", 3) for body in self.spec.bodies}
        turning = {
            one: self.scope.load(f"{field} + OMEGA_{one}", 3) for one in self.segment.leaders
        }
        return self.lengthening(bodies, line, moving, turning)

    def rod(self, pair: Pair) -> Line:
        """Line from the first to the second point of a pair; not finite where the points
        coincide."""
        e, arm_a, arm_b, gamma = joints.rod(
            pair.d, pair.d_rate, pair.rho_a, pair.rho_b, pair.spin_a, pair.spin_b
        ).called("line")
        return Line(
            e, arm_a, arm_b, gamma, square_root(vec3.dot(pair.d, pair.d)), vec3.dot(pair.d_rate, e)
        )

    def spring(self, spring: Spring) -> Line:
        """Line of action of a spring: along its axis, which is fixed in its first body, if it has
        one, else between its two points."""
        end_a, end_b, _ = self._spring_ends(spring)
        pair = self.pair(spring.bodies, end_a, end_b)
        if spring.axis is None:
            return self.rod(pair)
        r = self.attitude(spring.bodies[0])
        e = (r[0], r[3], r[6])
        if self._spring_axis_slot(spring) is not None or tuple(spring.axis) != (1.0, 0.0, 0.0):
            e = vec3.rotate(r, self._spring_axis(spring)).called("e")
        arm_a, arm_b, gamma = translation(pair, e)
        return Line(e, arm_a, arm_b, gamma, vec3.dot(pair.d, e), translation_rate(pair, e))

    def spring_start(self, spring: Spring) -> Any:
        """Length of a spring at the start of the case, m: the distance of its points or, if it has
        an axis, the component along the axis, which may be negative."""
        gap = self._spring_ends(spring)[2]
        if spring.axis is None:
            return square_root(vec3.dot(gap, gap)).called("spring_start")
        return vec3.dot(gap, self._spring_axis(spring)).called("spring_start")

    def _spring_ends(self, spring: Spring) -> tuple[Any, Any, Any]:
        """Ends of a spring: the arms from the mass centres of its two bodies to its points, and the
        vector from the first point to the second at the start; body axes, m."""
        start = int(self.c.model.springs_p) + at.SPRING_SIZE * self._number(spring)
        return self.case.ends(start, spring.bodies, spring.second_point is not None)

    def _spring_axis_slot(self, spring: Spring) -> int | None:
        """Parameter index of the x component of the axis of a spring; None if the axis is not
        dispersed."""
        return self.spec.layout.slots.get(f"spring.{spring.name}.axis.x")

    def _spring_axis(self, spring: Spring) -> Expr:
        """Axis of a spring that has one: unit vector, body axes of its first body."""
        if (slot := self._spring_axis_slot(spring)) is not None:
            return vec3.unit(self.case.vector(slot)).called("axis")
        return self.case.scope.shared(int(self.c.model.springs_x) + 3 * self._number(spring), 3)

    def _number(self, spring: Spring) -> int:
        """Index of a spring among those of the scene."""
        return [s.name for s in self.spec.scene.spring].index(spring.name)


def translation(pair: Pair, e: Any) -> Any:
    """Terms of the constraint that the points of a pair keep their distance along the unit vector
    ``e``, fixed in body A: its moments on A and on B per unit of force along e, m (``arm_a``,
    ``arm_b`` of `Line`), and gamma, m/s2; ground axes (`sepmc.physics.joints.translation`)."""
    return joints.translation(
        pair.d, pair.d_rate, e, pair.rho_a, pair.rho_b, pair.spin_a, pair.spin_b
    ).called("row")


def translation_rate(pair: Pair, e: Any) -> Any:
    """Rate, m/s, of the distance of the points of a pair along the unit vector ``e``, which is
    fixed in body A; ground axes."""
    return joints.translation_rate(pair.d, pair.d_rate, e, pair.spin_a)


def relative_acceleration(accelerations: dict[str, Any], bodies: tuple[str, str]) -> Any:
    """Acceleration of the mass centre of the second of two bodies minus that of the first, ground
    axes, m/s2, from ``accelerations`` by body; that of the ground is zero. The object `ZERO` stands
    for an acceleration known to be zero, also in the result."""
    of_a, of_b = (ZERO if body == GROUND else accelerations[body] for body in bodies)
    if of_a is ZERO:
        return of_b
    return vec3.scale(-1.0, of_a) if of_b is ZERO else vec3.sub(of_b, of_a)
