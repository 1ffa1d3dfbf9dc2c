"""Emitter of the energy audit: the kinetic energy about the common mass centre is compared with the
work of all loads."""

from typing import Any

from sepmc.kernel.emit.context import Context, component
from sepmc.kernel.emit.geometry import State
from sepmc.kernel.emit.loads import vector_sum
from sepmc.kernel.spec.kernel_spec import Segment
from sepmc.kernel.tracer.formulas import ZERO, scalar, vec3
from sepmc.kernel.tracer.text import Text
from sepmc.kernel.tracer.tracer import total, where
from sepmc.scene.model import GROUND

# minimum reference of the defect per mass, m2/s2, plus the same fraction of the square of the
# speed: half the square of 0.1 mm/s, or of 1e-4 of the speed, so that round-off does not count
_AT_REST = 0.5e-8


def power(s: State, force: dict[str, Any], moment: dict[str, Any]) -> Any:
    """Power of all loads (without joint forces) in the frame of the common mass centre, but see
    `_mean_speed` if the ground is connected.

    Parameters
    ----------
    s : State
    force : dict of str to Expr
        force on each body, ground axes, N; `ZERO` for none
    moment : dict of str to Expr
        moment on each body, body axes, N m; `ZERO` for none

    Returns
    -------
    Expr
        W; 0.0 if there are no loads
    """
    mean, terms = _mean_speed(s), []
    for body in s.spec.bodies:
        if force[body] is not ZERO:
            terms.append(vec3.dot(force[body], _relative_velocity(s, body, mean)))
        leader = s.segment.leader(body)
        if leader != GROUND and moment[body] is not ZERO:
            terms.append(vec3.dot(moment[body], s.rate(leader)))
    return total(terms) if terms else 0.0


def _mean_speed(s: State) -> Any:
    """Velocity of the common mass centre of all bodies, ground axes, m/s, in the moving frame of
    `State.velocity`; the object `ZERO` if a joint or spring connects a body to the ground, which
    absorbs momentum."""
    if int(s.c.model.ground) >= 0:
        return ZERO
    whole = total([s.case.mass(body) for body in s.spec.bodies])
    return vector_sum(
        [
            vec3.scale((s.case.mass(body) / whole).called("mass_fraction"), s.velocity(body))
            for body in s.spec.bodies
        ]
    ).called("mean")


def _relative_velocity(s: State, body: str, mean: Any) -> Any:
    """Velocity of a body minus ``mean``, which is from `_mean_speed` (`ZERO` if the ground is
    connected: the velocity itself is then returned); ground axes, m/s."""
    return s.velocity(body) if mean is ZERO else vec3.sub(s.velocity(body), mean).called("relative")


def emit_energy(out: Text, c: Context, segment: Segment) -> None:
    """Write the kernel function ``energy_SEGMENT(w, first)``, which updates the field ENERGY from
    the state Y. ENERGY has three numbers, J: the largest difference so far between the gain of
    kinetic energy and the work of all loads; the initial kinetic energy; and the reference of that
    difference, the largest energy or work so far (at least that of `_AT_REST`).

    Energy and work are about the common mass centre, but see `_mean_speed` if the ground is
    connected.
    The call with ``first`` = 1.0, at the start of a case, sets the initial values.
    """
    docstring = (
        "Largest energy defect (kinetic energy about the mass centre minus its initial value "
        "and the work of all loads) and its reference, into ENERGY;"
    )
    text = out.function(
        f"energy_{segment.name}(w, first: float)",
        docstring + " the ``first`` call sets the initial value.",
    )
    c.workspace.add("ENERGY", 3)  # largest defect, initial energy, reference
    s, case = State(c, c.scope(), segment, "Y"), c.case
    mean, kinetic, at_rest = _mean_speed(s), [], []
    for body in c.spec.bodies:
        v, mass = _relative_velocity(s, body, mean), case.mass(body)
        kinetic.append(0.5 * mass * vec3.dot(v, v))
        at_rest.append(_AT_REST * mass * (1.0 + vec3.dot(s.velocity(body), s.velocity(body))))
    for group in segment.groups:
        if GROUND not in group:
            omega = s.rate(group[0])
            kinetic.append(0.5 * vec3.dot(omega, vec3.rotate(case.group_inertia(group), omega)))
    scope, is_first = s.scope, s.scope.named("first") > 0.0
    energy, work, floor = total(kinetic).called("energy"), scope.load("Y + WORK"), total(at_rest)
    start, defect, reference = (scope.load(component("ENERGY", k)) for k in (1, 0, 2))
    scale = scalar.larger(scalar.larger(energy, floor), scalar.abs(work)).called("scale")
    largest = scalar.larger(defect, scalar.abs(energy - start - work))
    scope.store("ENERGY", where(is_first, 0.0, largest))
    scope.store(component("ENERGY", 1), where(is_first, energy, start))
    scope.store(component("ENERGY", 2), where(is_first, scale, scalar.larger(reference, scale)))
    scope.write(text)
