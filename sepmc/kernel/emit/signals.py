"""Signals at a state: formulas of the file as expressions of the kernel, and the quantities of the
flight that they name.

Values are jets (`sepmc.kernel.emit.jets`): with their first and second derivative in time, if asked
for. A kink of a formula (abs, min, a comparison, ...) has a mode, which selects the branch of the
formula in the present interval (`sepmc.kernel.emit.kinks`).
"""

import math
from typing import Any

from sepmc.kernel.emit import jets
from sepmc.kernel.emit.context import component, origin_height, reject_unless, state_offset
from sepmc.kernel.emit.geometry import State
from sepmc.kernel.emit.jets import Jet
from sepmc.kernel.emit.relative import hinge_angle, hinge_rate
from sepmc.kernel.emit.tables import mach_and_angles
from sepmc.kernel.spec.kinks import HELD, OWN, STATE, STATE_RATE, Kink, kink_name
from sepmc.kernel.tracer.formulas import ZERO, loads, quat, scalar, signals, square_root, vec3
from sepmc.kernel.tracer.tracer import Expr, total, undefined_with, where
from sepmc.routines import layout as at
from sepmc.scene.formula import (
    COMPARISONS,
    Call,
    Name,
    Node,
    Number,
    may_be_undefined,
    parse,
    walk,
)
from sepmc.scene.model import GROUND
from sepmc.scene.signals import Quantity
from sepmc.schema import Status

_SCALE_HEIGHT = 7000.0  # m: for a rough rate of the density, used only to predict kinks
_OPERATIONS: dict[str, Any] = {
    "+": jets.add,
    "*": jets.multiply,
    "/": jets.divide,
    "**": jets.power,
    "atan2": jets.angle,
}
_OPPOSITE = {"<": ">=", "<=": ">", ">": "<=", ">=": "<"}


def mode_field(kink: str) -> str:
    """Name of the workspace field of the mode of a kink, given by its name: the sign (-1, 0, 1)
    that its switching function has in the present interval."""
    return f"MODE_{kink}"


def held_field(signal: str) -> str:
    """Name of the workspace field of the sample of a signal that is in use now."""
    return f"HELD_{signal}"


class Signals:
    """Values of signals at a state, as expressions; signals are given by their generated names. A
    `Jet` is a value with its first and second derivative in time.

    Parameters
    ----------
    s : State
    moving : bool
        True to compute first and second derivatives too, from the derivative K1 of the state.
    """

    def __init__(self, s: State, moving: bool = False):
        self.s, self.moving, self.formulas = s, moving, s.spec.formulas
        self._kinks = {kink: k for k, kink in enumerate(self.formulas.kinks)}
        self._signals: dict[str, Jet] = {}
        self._nodes: dict[tuple[str, Node], Jet] = {}
        self._quantities: dict[Quantity, Jet] = {}
        self._of_quantities = Quantities(s, moving)

    def value(self, signal: str) -> Any:
        """Value of a signal (see `of`): in the unit of the key of the file that it drives (mm for
        ``..._mm``), not SI."""
        return self.of(signal).value

    def of(self, signal: str) -> Jet:
        """Jet (value and time derivatives) of a signal: of its first state if it has states, else
        of its formula or, if it is sampled, of the sample in use."""
        if signal not in self._signals:
            self._signals[signal] = (
                self._state(signal, 0)
                if signal in self.formulas.with_states
                else self._number(signal, self.formulas.tree(signal))
            )
        return self._signals[signal]

    def rates(self, signal: str) -> list[Any]:
        """Time derivatives of the one or two states of a signal that has states, in their order: of
        the signal, in its unit per s; of a servo also of its rate, in its unit per s2."""
        is_single = self.formulas.signals[signal].states == 1
        last = self.of_formula(signal)
        return [last] if is_single else [self._state(signal, 1).value, last]

    def of_formula(self, signal: str) -> Any:
        """Value of the tree of a signal (`Formulas.tree`): of its formula or sample in use or, if
        it has states, the rate of its last state."""
        return self._number(signal, self.formulas.tree(signal)).value

    def sample(self, signal: str) -> Any:
        """Present value of the formula of a sampled signal: the sample that would be taken now."""
        return self._number(signal, parse(self.formulas.signals[signal].formula)).value

    def _state(self, signal: str, k: int) -> Jet:
        """Jet (value and time derivatives) of state ``k`` of a signal with states: 0 the signal
        itself, 1 its rate."""
        first, scope = self.formulas.with_states[signal], self.s.scope
        value = scope.load(f"{self.s.field} + {state_offset(first + k)}")
        if not self.moving:
            return Jet(value)
        rate = scope.load(f"K1 + {state_offset(first + k)}")
        has_rate = k + 1 < self.formulas.signals[signal].states
        second = scope.load(f"K1 + {state_offset(first + k + 1)}") if has_rate else None
        return Jet(value, rate, second)

    def switching(self, kink: Kink) -> tuple[Jet, list[Any]]:
        """Jet (value and time derivatives) of the switching function of a kink, and the values of
        the arguments of its call: one, which is the function, or two, whose difference it is."""
        numbers = [self._number(kink.signal, one) for one in kink.node.arguments]
        if len(numbers) == 1:
            return numbers[0], [numbers[0].value]
        a, b = numbers
        return jets.add(a, jets.negative(b)), [a.value, b.value]

    def inputs(self, signal: str) -> list[Any]:
        """Expressions of the values of the quantities, states, samples in use and response
        parameters on which the tree of a signal (`Formulas.tree`) depends, directly or through
        other signals; without time, constants and known numbers. One that occurs twice is in the
        list twice. Of another signal with a state or samples only its present value counts."""
        values: list[Any] = []
        for node in walk(self.formulas.tree(signal)):
            if not isinstance(node, Name):
                continue
            if node.path.startswith(OWN):
                values.append(self._own(signal, node).value)
            elif other := self.formulas.other(signal, node):
                at_once = self.formulas.at_once(other)
                values += self.inputs(other) if at_once else [self.of(other).value]
            elif node.path not in self.formulas.signals[signal].constants:
                quantity = self.formulas.quantity(node)
                value = self.quantity(quantity).value
                if quantity.table != "time" and isinstance(value, Expr):
                    values.append(value)
        return values

    def _number(self, signal: str, node: Node) -> Jet:
        """Jet (value and time derivatives) of ``node``, a number (not a condition) in the formula
        of ``signal``."""
        if isinstance(node, Number):
            return Jet(node.value)
        key = (signal, node)
        if key not in self._nodes:
            self._nodes[key] = (
                self._name(signal, node) if isinstance(node, Name) else self._call(signal, node)
            )
        return self._nodes[key]

    def _name(self, signal: str, node: Name) -> Jet:
        """Jet (value and time derivatives) of a name in the formula of ``signal``: a constant,
        another signal, a quantity in the unit that its name ends with, or a state or parameter of
        the signal itself (`_own`)."""
        if node.path.startswith(OWN):
            return self._own(signal, node)
        if node.path in self.formulas.signals[signal].constants:
            slot = self.s.spec.layout.slots[f"signal.{signal}.{node.path}"]
            return Jet(self.s.case.number(slot))
        if other := self.formulas.other(signal, node):
            return self.of(other)
        quantity = self.formulas.quantity(node)
        jet = self.quantity(quantity)
        if quantity.factor == 1.0:
            return jet
        return Jet(*(None if x is None else x * (1.0 / quantity.factor) for x in jet))

    def _own(self, signal: str, node: Name) -> Jet:
        """Jet (value and time derivatives) of a name that stands for a state, the sample in use, or
        a response parameter of ``signal`` itself. Samples and parameters have zero derivatives;
        a state has a second derivative only if its rate is the next state."""
        if node == HELD:
            return Jet(self.s.scope.load(held_field(signal)))
        if node in (STATE, STATE_RATE):
            return self._state(signal, int(node == STATE_RATE))
        path = f"signal.{signal}.{node.path.removeprefix(OWN)}"
        return Jet(self.s.case.number(self.s.spec.layout.slots[path]))

    def quantity(self, quantity: Quantity) -> Jet:
        """Jet (value and time derivatives) of a quantity of the flight, SI."""
        key = quantity._replace(factor=1.0)
        if key not in self._quantities:
            self._quantities[key] = self._of_quantities.jet(key)
        return self._quantities[key]

    def _call(self, signal: str, node: Call) -> Jet:
        """Jet (value and time derivatives) of ``node``, a call with a number as result, in the
        formula of ``signal``."""
        function = node.function
        if function == "where":
            return self._where(signal, node)
        arguments = [self._number(signal, one) for one in node.arguments]
        if function in ("abs", "sign", "min", "max"):
            return self._kinked(signal, node, arguments)
        if function == "-":
            last = jets.negative(arguments[-1])
            return last if len(arguments) == 1 else jets.add(arguments[0], last)
        if function in _OPERATIONS:
            return _OPERATIONS[function](*arguments)
        return jets.apply(function, arguments[0])

    def _where(self, signal: str, node: Call) -> Jet:
        """Jet (value and time derivatives) of ``node``, a call of ``where`` in the formula of
        ``signal``: that of the branch that the modes select in the present interval. A step may
        pass the end of the interval by a little; where that branch is undefined there, the branch
        by the present condition counts. The value is NaN where the condition is undefined."""
        condition, switching = self._condition(signal, node.arguments[0])
        one, other = (self._number(signal, x) for x in node.arguments[1:])
        result = jets.select(condition, one, other)
        if self._may_be_undefined(signal, *node.arguments[1:]) and isinstance(result.value, Expr):
            now, _ = self._condition(signal, node.arguments[0], by_mode=False)
            defined = getattr(scalar, "math.isfinite")(result.value)
            value = jets.select(now, one, other).value
            result = result._replace(value=where(defined, result.value, value))
        return self._tied(result, switching)

    def _kinked(self, signal: str, node: Call, arguments: list[Jet]) -> Jet:
        """Jet (value and time derivatives) of ``node``, a call of abs, sign, min or max in the
        formula of ``signal``, given the jets of its arguments. The branch of sign follows the mode
        of its kink, that of abs, min and max the present value of the switching function."""
        first, last = arguments[0], arguments[-1]
        # only sign jumps: the others may pass a kink by the little that a step passes its end
        low, high = self._sides(signal, node, by_mode=node.function == "sign")
        if node.function == "sign":
            up = jets.select(high, Jet(1.0), Jet(0.0))
            result = jets.select(low, Jet(-1.0), up)
        elif node.function == "abs":
            result = jets.select(low, jets.negative(first), first)
        else:
            below, above = (first, last) if node.function == "min" else (last, first)
            result = jets.select(low, below, above)
        undefined = self._may_be_undefined(signal, node)
        return self._tied(result, [one.value for one in arguments] if undefined else [])

    def _sides(self, signal: str, node: Call, by_mode: bool = True) -> tuple[Any, Any]:
        """Two conditions: that the switching function of the call ``node`` in the formula of
        ``signal`` is negative, and that it is positive.

        With ``by_mode`` the mode of the call's kink counts, that is the sign of the function in the
        present interval; without ``by_mode``, or if the kink has no mode, the function's present
        value."""
        number = self._kinks.get(Kink(signal, node)) if by_mode else None
        if number is not None:
            mode = self.s.scope.load(mode_field(kink_name(number)))
            return mode < 0.0, mode > 0.0
        jet, _ = self.switching(Kink(signal, node))
        return jet.value < 0.0, jet.value > 0.0

    def _condition(
        self, signal: str, node: Node, negated: bool = False, by_mode: bool = True
    ) -> tuple[Any, list[Any]]:
        """Condition that the node ``node`` of a formula stands for or, if ``negated``, its
        opposite; and the list of numbers that must be finite for it. ``by_mode`` as in `_sides`."""
        assert isinstance(node, Call)
        if node.function == "not":
            return self._condition(signal, node.arguments[0], not negated, by_mode)
        if node.function in COMPARISONS:
            low, high = self._sides(signal, node, by_mode)
            function = _OPPOSITE[node.function] if negated else node.function
            undefined = self._may_be_undefined(signal, node)
            tied = [self._number(signal, one).value for one in node.arguments] if undefined else []
            if function == "<":
                return low, tied
            if function == ">":
                return high, tied
            return _opposite(low if function == ">=" else high), tied
        (one, of_one), (other, of_other) = (
            self._condition(signal, x, negated, by_mode) for x in node.arguments
        )
        joins = (node.function == "and") != negated
        return _joined(one, other, joins), [*of_one, *of_other]

    def _may_be_undefined(self, signal: str, *nodes: Node) -> bool:
        """True if any of the ``nodes`` of the formula of ``signal``, or a signal named in them, may
        be undefined for some values."""
        return any(may_be_undefined(one) for node in nodes for one in self._expanded(signal, node))

    def _expanded(self, signal: str, node: Node) -> list[Node]:
        """The node, and the syntax trees of the signals named in it, directly or through others,
        that always equal their formulas."""
        trees = [node]
        for one in walk(node):
            other = self.formulas.other(signal, one) if isinstance(one, Name) else ""
            if other and self.formulas.at_once(other):
                trees += self._expanded(other, self.formulas.tree(other))
        return trees

    def _tied(self, jet: Jet, values: list[Any]) -> Jet:
        """The jet, but with the value NaN where any of the ``values`` is NaN or infinite."""
        value = jet.value
        for other in values:
            value = undefined_with(value, other)
        return jet._replace(value=value)


def _opposite(condition: Any) -> Any:
    """Opposite of a condition, symbolic or a known bool."""
    if isinstance(condition, bool):
        return not condition
    return where(condition, 0.0, 1.0) > 0.5


def _joined(one: Any, other: Any, both: bool) -> Any:
    """Condition that both conditions are satisfied or, if not ``both``, that at least one is; each
    is symbolic or a known bool."""
    for known, unknown in ((one, other), (other, one)):
        if isinstance(known, bool):
            return unknown if known == both else known
    return one & other if both else one | other


class Quantities:
    """Quantities of the flight at a state that formulas may name, as jets, SI.

    Unless ``moving``, only their values are computed; else also their first and second derivatives
    in time, from the derivative K1 of the state (a second derivative may be None, not known).
    """

    def __init__(self, s: State, moving: bool):
        self.s, self.moving = s, moving

    def jet(self, quantity: Quantity) -> Jet:
        """Jet (value and time derivatives) of a quantity; its item has its generated name."""
        if quantity.table != "body":
            of_table = {
                "time": self._time,
                "joint": self._joint,
                "spring": self._spring,
                "event": self._event,
            }
            return of_table[quantity.table](quantity)
        key, body = quantity.key, quantity.item
        if key in ("pitch", "yaw", "roll"):
            return self._attitude(body, key)
        if key in ("alpha", "beta", "airspeed", "dynamic_pressure", "mach"):
            return self._flow(body, key)
        of_axis = {"omega_": self._rate, "": self._place, "v": self._speed}
        return of_axis[key[:-1]](body, "xyz".index(key[-1]))

    def _time(self, _: Quantity) -> Jet:
        """Jet (value and time derivatives) of the time since the start of the case, s; its rate is
        1, or 0 unless ``moving``."""
        return Jet(self.s.time, 1.0 if self.moving else 0.0)

    def _event(self, quantity: Quantity) -> Jet:
        """Jet (value and time derivatives) of the time since the event ``quantity.item``, s; 0
        before it, and while it has not occurred."""
        return self._since(f"EVENT_TIME_{quantity.item}", math.inf)

    def _since(self, field: str, never: float) -> Jet:
        """Jet (value and time derivatives) of the time, s, since the instant stored in a workspace
        field; 0 before it. Its rate is 1 from that instant on, or always 0 unless ``moving``. The
        field has the value ``never`` (infinity or NaN) while the instant is not known."""
        self.s.c.start(field, never)
        begun = self.s.scope.load(field)
        passed = begun <= self.s.time
        elapsed = where(passed, self.s.time - where(passed, begun, 0.0), 0.0)
        return Jet(elapsed, where(passed, 1.0, 0.0) if self.moving else 0.0)

    def _acceleration(self, body: str) -> Any:
        """Acceleration of the mass centre of a body, not GROUND, in ground axes, m/s2: the rate of
        the velocity of that body in K1, the derivative of the state."""
        return self.s.scope.load(f"K1 + V_{body}", 3)

    def _jet(self, value: Any, rate: Any, second: Any = None) -> Jet:
        """Jet with a ``value`` and, if ``moving``, the time derivatives that the functions ``rate``
        and ``second`` (None: not known) return; derivatives 0 if not ``moving``."""
        return Jet(value, rate(), second() if second else None) if self.moving else Jet(value)

    def _rate(self, body: str, k: int) -> Jet:
        """Jet (value and time derivatives) of component ``k`` (0 x, 1 y, 2 z) of the angular rate
        of a body, body axes, rad/s."""
        leader = self.s.segment.leader(body)
        if leader == GROUND:
            return Jet(0.0)
        return self._jet(
            self.s.rate(leader)[k], lambda: self.s.scope.load(f"K1 + OMEGA_{leader}", 3)[k]
        )

    def _place(self, body: str, k: int) -> Jet:
        """Jet (value and time derivatives) of coordinate ``k`` (0 x, 1 y, 2 z) of the mass centre
        of a body, ground axes, m: x and z from the initial common mass centre, y the height above
        the ground."""
        s = self.s
        if k == 1:
            value = s.position(body)[1] + origin_height(s.scope, s.time)
        else:
            value = s.position(body)[k] + s.time * s.case.velocity[k]
        return self._jet(
            value,
            lambda: s.velocity(body)[k] + s.case.velocity[k],
            lambda: self._acceleration(body)[k],
        )

    def _speed(self, body: str, k: int) -> Jet:
        """Jet (value and time derivatives) of component ``k`` (0 x, 1 y, 2 z) of the velocity of
        the mass centre of a body relative to the ground, ground axes, m/s."""
        value = self.s.velocity(body)[k] + self.s.case.velocity[k]
        return self._jet(value, lambda: self._acceleration(body)[k])

    def _joint(self, quantity: Quantity) -> Jet:
        """Jet (value and time derivatives) of a quantity of a joint, by its key: separation
        distance along the x axis, m; its rate, m/s; angle about the x axis, rad; its rate, rad/s;
        or time since the joint became free, s (0 before)."""
        s, joint = self.s, quantity.item
        if quantity.key == "angle":
            return self._hinge_angle(joint)
        if quantity.key == "angle_rate":
            return self._jet(hinge_rate(s, joint), lambda: self._hinge_acceleration(joint))
        if quantity.key == "time_since_release":
            return self._since(f"RELEASE_{joint}", math.nan)
        line, bodies = s.separation(joint), s.spec.scene.joint[joint].bodies

        def second() -> Any:
            """Separation acceleration, m/s2."""
            return s.case.separation_sign(joint) * s.lengthening_by("K1", bodies, line)

        if quantity.key == "rate":
            return self._jet(line.rate, second)
        return self._jet(line.length, lambda: line.rate, second)

    def _hinge_angle(self, joint: str) -> Jet:
        """Jet (value and time derivatives) of the angle of a joint about its x axis, rad, -pi to
        pi."""
        value = hinge_angle(self.s, joint)
        if not self.moving:
            return Jet(value)
        return Jet(value, hinge_rate(self.s, joint), self._hinge_acceleration(joint))

    def _hinge_acceleration(self, joint: str) -> Any:
        """Time derivative of the angular rate of a joint's second body relative to the first, about
        the joint's x axis, rad/s2, from the derivative K1."""
        first, second = self.s.spec.scene.joint[joint].bodies
        x, spin = self.s.axis(joint, 0), self.s.spin(first)
        relative = vec3.sub(self.s.spin(second), spin)
        rates = vec3.sub(self._spin_rate(second), self._spin_rate(first))
        return vec3.dot(x, rates) + vec3.dot(vec3.cross(spin, x), relative)

    def _spin_rate(self, body: str) -> Any:
        """Angular acceleration of a body, ground axes, rad/s2, from the derivative K1; `ZERO` for
        one that is in the rigid group of the ground."""
        leader = self.s.segment.leader(body)
        if leader == GROUND:
            return ZERO
        return vec3.rotate(self.s.attitude(leader), self.s.scope.load(f"K1 + OMEGA_{leader}", 3))

    def _spring(self, quantity: Quantity) -> Jet:
        """Jet (value and time derivatives) of the extension of a spring since the start, m, or, if
        the key of ``quantity`` is "rate", of the rate of that extension, m/s."""
        s = self.s
        spring = next(one for one in s.spec.scene.spring if one.name == quantity.item)
        line = s.spring(spring)

        def second() -> Any:
            """Second derivative of the extension, m/s2."""
            return s.lengthening_by("K1", spring.bodies, line)

        if quantity.key == "rate":
            return self._jet(line.rate, second)
        return self._jet(line.length - s.spring_start(spring), lambda: line.rate, second)

    def _attitude(self, body: str, key: str) -> Jet:
        """Jet (value and time derivatives) of the angle ``key`` ("pitch", "yaw" or "roll") of a
        body, rad; pitch and roll count full turns."""
        s, leader = self.s, self.s.segment.leader(body)
        if leader == GROUND:
            return Jet(s.case.number({"pitch": at.PITCH, "yaw": at.YAW, "roll": at.ROLL}[key]))
        r = s.attitude(body)
        if key == "yaw":
            value = quat.yaw(r)
        else:
            last = s.scope.load(component(f"ANGLES_{leader}", int(key == "roll")))
            value = scalar.nearest_turn(getattr(quat, key)(r), last)
        if not self.moving:
            return Jet(value)
        if key == "pitch":
            jet = jets.angle(self._axis(body, 0, 1), self._axis(body, 0, 0))
        elif key == "roll":
            jet = jets.angle(self._axis(body, 1, 2), self._axis(body, 2, 2))
        else:
            along, up = self._axis(body, 0, 0), self._axis(body, 0, 1)
            level = jets.apply("sqrt", jets.add(jets.multiply(along, along), jets.multiply(up, up)))
            jet = jets.angle(jets.negative(self._axis(body, 0, 2)), level)
        return jet._replace(value=value)

    def _axis(self, body: str, axis: int, k: int) -> Jet:
        """Jet (value and time derivatives) of component ``k`` in ground axes of the unit vector
        along body axis number ``axis`` of a body that is not in the rigid group of the ground; for
        both numbers 0 is x, 1 y, 2 z."""
        s, leader = self.s, self.s.segment.leader(body)
        r, spin = s.attitude(body), s.spin(body)
        e = (r[axis], r[axis + 3], r[axis + 6])
        spin_rate = vec3.rotate(r, s.scope.load(f"K1 + OMEGA_{leader}", 3)).called("spin_rate")
        e_rate = vec3.cross(spin, e).called("e_rate")
        e_second = vec3.add(vec3.cross(spin_rate, e), vec3.cross(spin, e_rate)).called("e_second")
        return Jet(e[k], e_rate[k], e_second[k])

    def _flow(self, body: str, key: str) -> Jet:
        """Jet of a quantity of the flow at a body, by ``key``: alpha or beta, rad, airspeed, m/s,
        Mach number, or dynamic pressure, Pa, with the density factor of the case.

        If ``moving``, the jet has a rate, which neglects changes of the wind and of the speed of
        sound and takes the density as exponential in height; its second derivative is then None.
        """
        from sepmc.kernel.emit.loads import air_density  # noqa: PLC0415

        s = self.s
        flow = vec3.unrotate(s.attitude(body), vec3.add(s.velocity(body), s.stream(body))).called(
            "flow"
        )
        flow_rate: Any = ZERO
        if self.moving:
            leader = s.segment.leader(body)
            flow_rate = vec3.unrotate(s.attitude(body), self._acceleration(body))
            if leader != GROUND:
                flow_rate = vec3.sub(flow_rate, vec3.cross(s.rate(leader), flow))
            flow_rate = flow_rate.called("flow_rate")
        u, v, w = (
            Jet(flow[k], flow_rate[k], None) if self.moving else Jet(flow[k]) for k in range(3)
        )
        if key in ("alpha", "beta"):
            alpha, beta = loads.flow_angles(flow).called("angles")
            if not self.moving:
                return Jet(alpha if key == "alpha" else beta)
            if key == "alpha":
                return jets.angle(jets.negative(v), u)._replace(value=alpha)
            level = jets.apply("sqrt", jets.add(jets.multiply(u, u), jets.multiply(v, v)))
            return jets.angle(w, level)._replace(value=beta)
        square = jets.add(jets.add(jets.multiply(u, u), jets.multiply(v, v)), jets.multiply(w, w))
        if key in ("airspeed", "mach"):
            speed = square_root(vec3.dot(flow, flow))
            jet = jets.apply("sqrt", square)._replace(value=speed) if self.moving else Jet(speed)
            if key == "airspeed":
                return jet
            mach = mach_and_angles(s, body)[0]
            return (
                Jet(mach, jet.rate * signals.quotient(mach, speed), None)
                if self.moving
                else Jet(mach)
            )
        density = Jet(0.5 * s.case.number(at.DENSITY_FACTOR) * air_density(s, body))
        if self.moving:
            climb = self._place(body, 1).rate
            density = Jet(density.value, density.value * climb * (-1.0 / _SCALE_HEIGHT), None)
        return jets.multiply(density, square)


def signals_of(s: State) -> Signals:
    """Values of signals at a state; the same object at each call for one state."""
    known: Signals | None = getattr(s, "_signals", None)
    if known is None:
        known = Signals(s)
        s._signals = known  # type: ignore[attr-defined]
    return known


def number(s: State, path: str, slot: int) -> Any:
    """Value, SI, of the parameter at a path such as ``motor.main.thrust``: that of the signal that
    gives it, if any, converted from the unit of the key, else the parameter of the case with the
    index ``slot``."""
    drive = s.spec.scene.driven.get(path)
    if drive is None:
        return s.case.number(slot)
    value = signals_of(s).value(drive.signal)
    return value * drive.factor


def three_numbers(s: State, path: str, slot: int) -> Any:
    """Vector of the values, SI, of the three parameters ``path.x``, ``path.y`` and ``path.z``: of
    each the value of the signal that gives it, if any, else the parameter of the case. ``slot`` is
    the index of the first."""
    if not any(f"{path}.{axis}" in s.spec.scene.driven for axis in "xyz"):
        return s.case.vector(slot)
    return tuple(number(s, f"{path}.{axis}", slot + k) for k, axis in enumerate("xyz"))


def reject_undefined(s: State) -> None:
    """Add lines to the scope of a state that end a case (status undefined-formula) where the
    formula of a signal in use is not finite although the quantities and states in it are."""
    known = signals_of(s)
    finite = getattr(scalar, "math.isfinite")
    for signal in s.spec.formulas.used:
        if not known._may_be_undefined(signal, s.spec.formulas.tree(signal)):
            continue
        value = known.of_formula(signal)
        if not isinstance(value, Expr):
            value = s.time * 0.0 + value
        defined = finite(value)
        if inputs := known.inputs(signal):
            defined = defined | _opposite(finite(total(inputs)))
        reject_unless(s.scope, defined, Status.UNDEFINED_FORMULA)


__all__ = ["Signals", "mode_field", "number", "reject_undefined", "signals_of", "three_numbers"]
