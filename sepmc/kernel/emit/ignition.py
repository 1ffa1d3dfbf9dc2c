"""Emitter of the ignition times of motors that wait for a trigger: an event, a release, or a joint
that becomes free."""

import math

from sepmc.kernel.emit.context import Context
from sepmc.kernel.tracer.tracer import Expr, Scope, where
from sepmc.scene.model import Ignition, Motor


def ignition_time(motor: str) -> str:
    """Name of the workspace field of the ignition time of a triggered motor, s, as known at the
    start of an interval; infinite if not known."""
    return f"IGNITION_TIME_{motor}"


def ignition(scope: Scope, c: Context, motor: Motor) -> Expr:
    """Ignition time of a triggered motor: the time of its trigger plus its delays.

    Parameters
    ----------
    scope : Scope
    c : Context
    motor : Motor

    Returns
    -------
    Expr
        s; infinite until its trigger has occurred
    """
    assert motor.trigger is not None
    slots, path = c.spec.layout.slots, f"motor.{motor.name}"
    delay = c.case.number(slots[f"{path}.ignition.delay"]) + c.case.number(slots[f"{path}.delay"])
    return _trigger_time(scope, c, motor.trigger) + delay


def _trigger_time(scope: Scope, c: Context, trigger: Ignition) -> Expr:
    """Expression of the time at which the trigger of a motor occurred (its event or release, or
    that its joint became free), s; infinite until then."""
    if trigger.joint is None:
        path = f"EVENT_TIME_{trigger.event or trigger.release}"
        c.start(path, math.inf)
        return scope.load(path)
    path = f"RELEASE_{trigger.joint}"
    c.start(path, math.nan)
    freed = scope.load(path)
    return where(freed < math.inf, freed, math.inf)


def store_ignitions(scope: Scope, c: Context) -> None:
    """Add lines to a scope that store the present ignition times of all triggered motors into their
    fields (`ignition_time`), for the loads of the next interval."""
    for motor in c.spec.triggered_motors:
        c.start(ignition_time(motor.name), math.inf)
        scope.store(ignition_time(motor.name), ignition(scope, c, motor))
