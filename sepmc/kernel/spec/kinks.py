"""Kinks of the formulas of signals, and of springs that only push: points at which a value is not
a smooth function of the state and time, as abs(x) at x = 0.

A switching function is zero at the kink. Reaching it is an event, so that a step ends there, and
the branch of a formula is constant within a step.
"""

import math
from dataclasses import dataclass
from functools import cached_property

from sepmc.kernel.spec.naming import Names
from sepmc.scene.formula import KINKS, Call, Name, Node, Number, parse, walk
from sepmc.scene.model import Scene, Signal
from sepmc.scene.signals import Quantity, quantity
from sepmc.scene.terms import signal_terms

# begins names, in syntax trees, of the states and parameters of the signal itself; no name of a
# file begins with it
OWN = "@"
STATE, STATE_RATE, HELD = Name(f"{OWN}state"), Name(f"{OWN}state rate"), Name(f"{OWN}held")
_STATES = (STATE, STATE_RATE, HELD)


def own_parameter(key: str) -> Name:
    """Node of a syntax tree that stands for a parameter of the response of the signal that the tree
    belongs to; ``key`` is its key in the file, such as ``lag`` or ``servo.damping``."""
    return Name(f"{OWN}{key}")


def _lag_rate(formula: Node, signal: Signal) -> Node:
    """Syntax tree of the rate of a signal y that follows its ``formula`` u with a lag: (u - y) /
    lag, limited to plus or minus the rate limit of the signal, if it has one."""
    rate: Node = Call("/", (Call("-", (formula, STATE)), own_parameter("lag")))
    if signal.rate_limit is None:
        return rate
    limit = own_parameter("rate_limit")
    return Call("min", (Call("max", (rate, Call("-", (limit,)))), limit))


def _servo_rate(formula: Node) -> Node:
    """Syntax tree of the second time derivative of a signal y that follows its ``formula`` u as a
    servo: y'' = n (n (u - y) - 2 z y') with the natural frequency n, rad/s, which is 2 pi times the
    parameter ``servo.natural``, Hz, and the damping z, the parameter ``servo.damping``."""
    natural = Call("*", (Number(2.0 * math.pi), own_parameter("servo.natural")))
    follows = Call("*", (natural, Call("-", (formula, STATE))))
    damped = Call("*", (Call("*", (Number(2.0), own_parameter("servo.damping"))), STATE_RATE))
    return Call("*", (natural, Call("-", (follows, damped))))


def kink_name(number: int) -> str:
    """Name of a kink in names of workspace fields, by its number from 0: kink1, kink2, ..."""
    return f"kink{number + 1}"


@dataclass(frozen=True)
class Kink:
    """Call in the formula of a signal (abs, min, a comparison, ...) that is not smooth where its
    switching function is zero. ``node`` is the call in the syntax tree of ``signal``, a generated
    name. Its switching function is its argument if it has one, or its first argument minus its
    second."""

    signal: str
    node: Call


@dataclass(frozen=True)
class SlackKink:
    """Kink of a spring that only pushes: its force is cut off at zero. The switching function is
    the force before that (`sepmc.kernel.emit.slack.slack_force`). ``spring`` is the spring's
    generated name."""

    spring: str


@dataclass(frozen=True)
class Formulas:
    """Formulas of the signals of a scene, and the kinks in them. Signals and other items have the
    generated names of the kernel; only within the texts of formulas names are those of the file.

    Attributes
    ----------
    scene : Scene
        with the generated names
    names : Names
        generated names by names of the file
    """

    scene: Scene
    names: Names

    @cached_property
    def signals(self) -> dict[str, Signal]:
        """Signals of the scene, by their generated names, which are also their ``name``."""
        return {signal.name: signal for signal in self.scene.signal}

    @cached_property
    def with_states(self) -> dict[str, int]:
        """Number of the first state, among the states of all signals, of each signal that has
        states to be integrated (a lag, a servo, an integral), by signal."""
        first, count = dict[str, int](), 0
        for name, signal in self.signals.items():
            if signal.states:
                first[name], count = count, count + signal.states
        return first

    @cached_property
    def sampled(self) -> tuple[str, ...]:
        """Names of the signals whose formulas are sampled at intervals."""
        return tuple(name for name, one in self.signals.items() if one.sample is not None)

    def at_once(self, signal: str) -> bool:
        """True if a signal always equals its formula: it has no state and is not sampled."""
        return signal not in self.with_states and signal not in self.sampled

    @cached_property
    def used(self) -> tuple[str, ...]:
        """Names of the signals that the motion needs: those without samples that give parameters or
        aerodynamic terms of the scene, those with states, and the signals that these depend on.

        A signal comes after those that its formula names; signals with states or samples are known
        beforehand and are in no such order. Sampled signals without states are left out.
        """
        ordered: dict[str, None] = {}

        def add(signal: str) -> None:
            """Append a signal to ``ordered``, after those signals named in it that always equal
            their formulas."""
            for node in walk(self.tree(signal)):
                other = self.other(signal, node) if isinstance(node, Name) else ""
                if other and self.at_once(other):
                    add(other)
            ordered.setdefault(signal)

        named = [drive.signal for drive in self.scene.driven.values()]
        if self.scene.environment.atmosphere != "none":
            named += [self.names.of["signal"][x] for x in signal_terms(self.scene).values()]
        for signal in named:
            if self.at_once(signal):
                add(signal)
        for signal in self.with_states:
            add(signal)
        return tuple(ordered)

    def tree(self, signal: str) -> Node:
        """Syntax tree of the value of a signal or, if it has states, of the rate of its last state
        (of a servo the second rate). Names that begin with `OWN` stand for its states, its sample
        in use, and parameters of its response."""
        model = self.signals[signal]
        formula = parse(model.formula) if model.sample is None else HELD
        if model.servo is not None:
            return _servo_rate(formula)
        return _lag_rate(formula, model) if model.lag is not None else formula

    def other(self, signal: str, node: Name) -> str:
        """Generated name of the other signal that ``node``, a name in the formula of ``signal``,
        stands for; "" if it stands for something else."""
        if node.path in self.signals[signal].constants or node.path.startswith(OWN):
            return ""
        return str(self.names.of["signal"].get(node.path, ""))

    def quantity(self, node: Name) -> Quantity:
        """Quantity of the flight (such as an altitude) that a name in a formula stands for; its
        item has its generated name. The name must stand for a quantity."""
        known = quantity(node.path, self.names.of)
        assert known is not None
        return known._replace(
            item=self.names.of[known.table][known.item] if known.item else known.item
        )

    def varies(self, signal: str, node: Node) -> bool:
        """True if the value of ``node``, in the formula of ``signal``, may change during a case: it
        depends on the flight, time, states or samples, not only on constants and parameters."""
        for one in walk(node):
            if isinstance(one, Name) and one.path not in self.signals[signal].constants:
                other = self.other(signal, one)
                is_parameter = one.path.startswith(OWN) and one not in _STATES
                if (other and not self.at_once(other)) or not (other or is_parameter):
                    return True
                if other and self.varies(other, self.tree(other)):
                    return True
        return False

    @cached_property
    def kinks(self) -> tuple[Kink | SlackKink, ...]:
        """Kinks of the signals in use, each after those that its switching function depends on,
        then those of springs that only push. Their order numbers them (`kink_name`)."""
        of_signals: dict[Kink, None] = {}
        for signal in self.used:
            for node in walk(self.tree(signal)):
                if isinstance(node, Call) and node.function in KINKS and self.varies(signal, node):
                    of_signals.setdefault(Kink(signal, node))
        return (*of_signals, *(SlackKink(s.name) for s in self.scene.spring if s.push_only))
