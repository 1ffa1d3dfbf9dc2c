"""Force of a spring that only pushes, with its rate, before negative values are cut off: the spring
is slack where this force is below zero."""

import functools
import math
from typing import Any

from sepmc.kernel.emit import jets
from sepmc.kernel.emit.context import component
from sepmc.kernel.emit.jets import Jet
from sepmc.kernel.emit.loads import spring_force
from sepmc.kernel.emit.signals import Signals
from sepmc.kernel.emit.tables import table_force
from sepmc.kernel.spec.kernel_spec import stroke_flag
from sepmc.kernel.spec.kinks import SlackKink
from sepmc.kernel.spec.step_cells import has_unloading, unloading_path
from sepmc.routines import layout as at
from sepmc.scene.model import Spring
from sepmc.scene.signals import Quantity


def slack_force(signals: Signals, kink: SlackKink) -> tuple[Jet, list[Any]]:
    """Force of a spring that only pushes before negative values are cut off: the switching function
    of its kink. It is 0 after the end of the stroke.

    Parameters
    ----------
    signals : Signals
        at the state; with derivatives if ``moving``
    kink : SlackKink
        kink of the spring

    Returns
    -------
    force : Jet
        N; the second derivative may be None (not known)
    sizes : list
        values, N, of the forces whose sum it is (of a table its largest magnitude), as scales for
        round-off
    """
    s = signals.s
    i, spring = next(
        (i, one) for i, one in enumerate(s.spec.scene.spring) if one.name == kink.spring
    )
    path, terms = f"spring.{spring.name}", [_number(signals, spring, i, "force", at.SPRING_FORCE)]
    for key, slot, motion in (
        ("stiffness", at.STIFFNESS, "extension"),
        ("damping", at.DAMPING, "rate"),
    ):
        driven = f"{path}.{key}" in s.spec.scene.driven
        if driven or s.spec.may_occur(f"{path}.{key}", getattr(spring, key) != 0.0):
            of_motion = signals.quantity(Quantity("spring", spring.name, motion, 1.0))
            coefficient = _number(signals, spring, i, key, slot)
            terms.append(jets.negative(jets.multiply(coefficient, of_motion)))
    sizes = [term.value for term in terms]
    if spring.table is not None:
        terms.append(_of_table(signals, spring))
        sizes.append(max(map(abs, spring.table.force)))
    factor = _number(signals, spring, i, "factor", at.SPRING_FACTOR)
    jet = jets.multiply(factor, functools.reduce(jets.add, terms))
    jet = jet._replace(value=spring_force(s, spring, i))
    if s.spec.may_occur(f"{path}.stroke", math.isfinite(spring.stroke)):
        s.c.start(stroke_flag(spring.name), 0.0)
        jet = jets.select(s.scope.load(stroke_flag(spring.name)) > 0.0, Jet(0.0), jet)
    return jet, [factor.value * size for size in sizes]


def _number(signals: Signals, spring: Spring, i: int, key: str, slot: int) -> Jet:
    """Jet of the number ``key`` (such as "stiffness", SI) of a spring, number ``i`` of the scene
    from 0: of the signal that gives it, if any (in SI), else of the parameter at the offset
    ``slot`` of the spring's block, which is constant (both derivatives 0)."""
    s = signals.s
    drive = s.spec.scene.driven.get(f"spring.{spring.name}.{key}")
    if drive is None:
        return Jet(s.case.number(int(s.c.model.springs_p) + at.SPRING_SIZE * i + slot))
    return jets.multiply(Jet(drive.factor), signals.of(drive.signal))


def _of_table(signals: Signals, spring: Spring) -> Jet:
    """Jet of the force of a spring from its table, N, times the return factor while the spring
    shrinks. Its second derivative is not known (None); both derivatives are 0 unless ``signals``
    are ``moving``."""
    s, field = signals.s, table_force(spring.name)
    value, rate = (s.scope.load(name) for name in (field, f"RATE_{field}"))
    if has_unloading(spring, s.spec.dispersed):
        lost = s.case.number(s.spec.layout.slots[unloading_path(spring.name)]) - 1.0
        value = value + lost * s.scope.load(component(field, 1))
        rate = rate + lost * s.scope.load(component(f"RATE_{field}", 1))
    return Jet(value, rate, None) if signals.moving else Jet(value)
