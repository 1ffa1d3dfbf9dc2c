"""Motors that light at an instant that the flight itself tells: when that is."""

import math

from sepmc.kernel.emit.context import Context
from sepmc.kernel.tracer.tracer import Expr, Scope, where
from sepmc.scene.model import Ignition, Motor


def lights(motor: str) -> str:
    """The field of the time at which such a motor lights, as known when a stretch begins."""
    return f"IGNITION_TIME_{motor}"


def ignition(scope: Scope, c: Context, motor: Motor) -> Expr:
    """When such a motor lights, s; infinite until what it waits for has come."""
    assert motor.trigger is not None
    slots, path = c.spec.layout.slots, f"motor.{motor.name}"
    delay = c.case.number(slots[f"{path}.ignition.delay"]) + c.case.number(slots[f"{path}.delay"])
    return _comes(scope, c, motor.trigger) + delay


def _comes(scope: Scope, c: Context, trigger: Ignition) -> Expr:
    """When the event or release comes, or the joint becomes free, that a motor waits for."""
    if trigger.joint is None:
        place = f"EVENT_TIME_{trigger.event or trigger.release}"
        c.start(place, math.inf)
        return scope.load(place)
    place = f"RELEASE_{trigger.joint}"
    c.start(place, math.nan)
    freed = scope.load(place)
    return where(freed < math.inf, freed, math.inf)


def note_ignitions(scope: Scope, c: Context) -> None:
    """Note when all such motors light, for the loads of the stretch that begins."""
    for motor in c.spec.triggered_motors:
        c.start(lights(motor.name), math.inf)
        scope.store(lights(motor.name), ignition(scope, c, motor))
