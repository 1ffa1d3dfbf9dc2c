"""Energy of the motion about the mass centre in a written kernel: the power of all loads, and what
is lost between the two."""

from typing import Any

from sepmc.kernel.emit.context import Context, component
from sepmc.kernel.emit.geometry import State
from sepmc.kernel.emit.loads import add_all
from sepmc.kernel.spec.kernel_spec import Segment
from sepmc.kernel.tracer.formulas import ZERO, scalar, vec3
from sepmc.kernel.tracer.text import Text
from sepmc.kernel.tracer.tracer import total, where
from sepmc.scene.model import GROUND

# m2/s2, and of the square of a speed: half the square of 0.1 mm/s, or of 1e-4 of a speed, of which
# round-off is a share
_AT_REST = 0.5e-8


def power(s: State, force: dict[str, Any], moment: dict[str, Any]) -> Any:
    """Power of all loads, W: force in ground axes, moment in body axes."""
    mean, terms = _mean_speed(s), []
    for body in s.spec.bodies:
        if force[body] is not ZERO:
            terms.append(vec3.dot(force[body], _apart(s, body, mean)))
        leader = s.segment.leader(body)
        if leader != GROUND and moment[body] is not ZERO:
            terms.append(vec3.dot(moment[body], s.rate(leader)))
    return total(terms) if terms else 0.0


def _mean_speed(s: State) -> Any:
    """Velocity of the mass centre of all bodies; none where there is a ground, which can take
    momentum."""
    if int(s.c.model.ground) >= 0:
        return ZERO
    whole = total([s.case.mass(body) for body in s.spec.bodies])
    return add_all(
        [
            vec3.scale((s.case.mass(body) / whole).called("share"), s.speed(body))
            for body in s.spec.bodies
        ]
    ).called("mean")


def _apart(s: State, body: str, mean: Any) -> Any:
    return s.speed(body) if mean is ZERO else vec3.sub(s.speed(body), mean).called("apart")


def emit_energy(out: Text, c: Context, segment: Segment) -> None:
    """A function for the energy that is lost in a phase."""
    says = (
        "Kinetic energy about the mass centre less that at the start and the work of all "
        "loads: the largest, into ENERGY, and what"
    )
    text = out.function(
        f"energy_{segment.name}(w, first: float)",
        says + " counts as large; ``first`` of all it is that at the start.",
    )
    c.workspace.add("ENERGY", 3)  # that is lost, that at the start, what counts as large
    s, case = State(c, c.scope(), segment, "Y"), c.case
    mean, moving, slow = _mean_speed(s), [], []
    for body in c.spec.bodies:
        v, mass = _apart(s, body, mean), case.mass(body)
        moving.append(0.5 * mass * vec3.dot(v, v))
        slow.append(_AT_REST * mass * (1.0 + vec3.dot(s.speed(body), s.speed(body))))
    for group in segment.groups:
        if GROUND not in group:
            omega = s.rate(group[0])
            moving.append(0.5 * vec3.dot(omega, vec3.rotate(case.group_inertia(group), omega)))
    scope, begins = s.scope, s.scope.named("first") > 0.0
    now, work, rest = total(moving).called("energy"), scope.load("Y + WORK"), total(slow)
    start, lost, large = (scope.load(component("ENERGY", k)) for k in (1, 0, 2))
    counts = scalar.larger(scalar.larger(now, rest), scalar.abs(work)).called("counts")
    missing = scalar.larger(lost, scalar.abs(now - start - work))
    scope.store("ENERGY", where(begins, 0.0, missing))
    scope.store(component("ENERGY", 1), where(begins, now, start))
    scope.store(component("ENERGY", 2), where(begins, counts, scalar.larger(large, counts)))
    scope.write(text)
