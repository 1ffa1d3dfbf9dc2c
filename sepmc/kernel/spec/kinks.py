"""Kinks of the signals of a scene: places at which a formula is not smooth. They are events, so
that no step passes one, and the branch of the formula is fixed within a step."""

from dataclasses import dataclass
from functools import cached_property

from sepmc.kernel.spec.naming import Names
from sepmc.scene.formula import KINKS, Call, Name, Node, parse, walk
from sepmc.scene.model import Scene, Signal
from sepmc.scene.signals import Quantity, quantity


def kink_name(number: int) -> str:
    """Name of a kink by its number, from 0."""
    return f"kink{number + 1}"


@dataclass(frozen=True)
class Kink:
    """Call in the formula of a signal that is not smooth where its switching function is zero: its
    argument, or the difference of its two arguments."""

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
        """Signals by the name of the kernel."""
        return {signal.name: signal for signal in self.scene.signal}

    @cached_property
    def used(self) -> tuple[str, ...]:
        """Signals that give numbers of the scene, each after those that it depends on."""
        ordered: dict[str, None] = {}

        def add(signal: str) -> None:
            for node in walk(self.tree(signal)):
                if isinstance(node, Name) and (other := self.other(signal, node)):
                    add(other)
            ordered.setdefault(signal)

        for drive in self.scene.driven.values():
            add(drive.signal)
        return tuple(ordered)

    def tree(self, signal: str) -> Node:
        """Syntax tree of a signal."""
        return parse(self.signals[signal].formula)

    def other(self, signal: str, node: Name) -> str:
        """Other signal that a name in the formula of a signal stands for; "" for none."""
        if node.path in self.signals[signal].constants:
            return ""
        return str(self.names.of["signal"].get(node.path, ""))

    def quantity(self, node: Name) -> Quantity:
        """Quantity of a name, with the names of the kernel."""
        known = quantity(node.path, self.names.of)
        assert known is not None
        return known._replace(
            item=self.names.of[known.table][known.item] if known.item else known.item
        )

    def varies(self, signal: str, node: Node) -> bool:
        """True if a part of the formula of a signal changes during flight."""
        for one in walk(node):
            if isinstance(one, Name) and one.path not in self.signals[signal].constants:
                other = self.other(signal, one)
                if not other or self.varies(other, self.tree(other)):
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
