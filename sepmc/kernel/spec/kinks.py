"""Kinks of the signals of a scene: places at which a formula is not smooth. They are events, so
that no step passes one, and the branch of the formula is fixed within a step."""

import math
from dataclasses import dataclass
from functools import cached_property

from sepmc.kernel.spec.naming import Names
from sepmc.scene.formula import KINKS, Call, Name, Node, Number, parse, walk
from sepmc.scene.model import Scene, Signal
from sepmc.scene.signals import Quantity, quantity
from sepmc.scene.terms import signal_terms

OWN = "@"  # begins names that no file has: states and parameters of the signal itself
STATE, STATE_RATE, HELD = Name(f"{OWN}state"), Name(f"{OWN}state rate"), Name(f"{OWN}held")
_STATES = (STATE, STATE_RATE, HELD)


def own_parameter(key: str) -> Name:
    """Name, in a syntax tree, of a parameter of the response of the signal itself, such as its
    ``lag``."""
    return Name(f"{OWN}{key}")


def _lag_rate(formula: Node, signal: Signal) -> Node:
    """Syntax tree of the rate of a signal y with a lag: (u - y) / lag, limited to plus or minus the
    rate limit of the signal, if any, with its formula u."""
    rate: Node = Call("/", (Call("-", (formula, STATE)), own_parameter("lag")))
    if signal.rate_limit is None:
        return rate
    limit = own_parameter("rate_limit")
    return Call("min", (Call("max", (rate, Call("-", (limit,)))), limit))


def _servo_rate(formula: Node) -> Node:
    """Syntax tree of the second rate of a signal y that is a servo: y'' = n (n (u - y) - 2 z y')
    with its formula u, the natural frequency n, rad/s, and the damping z."""
    natural = Call("*", (Number(2.0 * math.pi), own_parameter("servo.natural")))
    follows = Call("*", (natural, Call("-", (formula, STATE))))
    damped = Call("*", (Call("*", (Number(2.0), own_parameter("servo.damping"))), STATE_RATE))
    return Call("*", (natural, Call("-", (follows, damped))))


def kink_name(number: int) -> str:
    """Name of a kink by its number, from 0."""
    return f"kink{number + 1}"


@dataclass(frozen=True)
class Kink:
    """Call (``node``) in the formula of a ``signal`` that is not smooth where its switching
    function is zero. That function is the argument of the call, or the difference of its two
    arguments."""

    signal: str
    node: Call


@dataclass(frozen=True)
class Formulas:
    """Formulas of a scene with the names of the kernel; in their texts names are those of the
    file.

    Attributes
    ----------
    scene : Scene
        with the names of the kernel
    names : Names
    """

    scene: Scene
    names: Names

    @cached_property
    def signals(self) -> dict[str, Signal]:
        """Signals of the scene, by their names in the kernel."""
        return {signal.name: signal for signal in self.scene.signal}

    @cached_property
    def with_states(self) -> dict[str, int]:
        """Signals with states that are integrated, and the number of the first state of each."""
        first, count = dict[str, int](), 0
        for name, signal in self.signals.items():
            if signal.states:
                first[name], count = count, count + signal.states
        return first

    @cached_property
    def sampled(self) -> tuple[str, ...]:
        """Signals whose formulas are sampled."""
        return tuple(name for name, one in self.signals.items() if one.sample is not None)

    def at_once(self, signal: str) -> bool:
        """True if a signal follows its formula at once: it has no state and is not sampled."""
        return signal not in self.with_states and signal not in self.sampled

    @cached_property
    def used(self) -> tuple[str, ...]:
        """Signals that drive numbers or aerodynamic terms of the scene or have states, and all that
        these depend on; ordered so that each comes after those that its formula names, except
        signals with states or samples."""
        ordered: dict[str, None] = {}

        def add(signal: str) -> None:
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
        """Syntax tree of the value of a signal or, if it has states, of the rate of its last state.
        Names that begin with `OWN` stand for its states, the sample used now, and parameters."""
        model = self.signals[signal]
        formula = parse(model.formula) if model.sample is None else HELD
        if model.servo is not None:
            return _servo_rate(formula)
        return _lag_rate(formula, model) if model.lag is not None else formula

    def other(self, signal: str, node: Name) -> str:
        """Other signal that a name in the formula of a signal stands for; "" for none."""
        if node.path in self.signals[signal].constants or node.path.startswith(OWN):
            return ""
        return str(self.names.of["signal"].get(node.path, ""))

    def quantity(self, node: Name) -> Quantity:
        """Quantity of the flight that a name in a formula stands for, its item with the name of the
        kernel."""
        known = quantity(node.path, self.names.of)
        assert known is not None
        return known._replace(
            item=self.names.of[known.table][known.item] if known.item else known.item
        )

    def varies(self, signal: str, node: Node) -> bool:
        """True if a node of the formula of a signal may change during a case: it depends on more
        than constants and parameters."""
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
    def kinks(self) -> tuple[Kink, ...]:
        """Kinks of the signals in use, each after those that its switching function depends on."""
        found: dict[Kink, None] = {}
        for signal in self.used:
            for node in walk(self.tree(signal)):
                if isinstance(node, Call) and node.function in KINKS and self.varies(signal, node):
                    found.setdefault(Kink(signal, node))
        return tuple(found)
