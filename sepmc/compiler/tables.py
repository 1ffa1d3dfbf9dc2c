"""Aerodynamic tables: looked up lane by lane, in a loop of its own, so that the rest of a derivative stays vectorised."""

from typing import Any

from sepmc.compiler.context import Context, level, part
from sepmc.compiler.formulas import air, loads, square_root, vec3
from sepmc.compiler.geometry import State
from sepmc.compiler.shape import Shape, Stage
from sepmc.compiler.text import Text
from sepmc.scene.model import GROUND, Proximity


def looks_up(shape: Shape, body: str) -> bool:
    """Whether a body has coefficients from a table."""
    aero = shape.scene.body[body].aerodynamics
    in_air = shape.scene.environment.atmosphere != "none" and aero is not None
    return in_air and ((aero is not None and aero.table is not None) or any(one.body == body for one in shape.scene.proximity))


def emit_look_up(out: Text, c: Context, stage: Stage) -> None:
    """A function for what tables give at a state of a phase."""
    bodies = [body for body in c.shape.bodies if looks_up(c.shape, body)]
    if not bodies:
        return
    text = out.function(f"look_up_{stage.name}(w)", f"Coefficients that tables give at the state S in phase {stage.name}, into LOOKED_UP.")
    s = State(c, c.scope(), stage, "S")
    for body in bodies:
        c.slabs.add(f"LOOKED_UP_{body}", 6)
        if _table(c, body) >= 0:
            c.slabs.add(f"FLOW_{body}", 3)
            for k, value in enumerate(_flow(s, body)):
                s.scope.store(part(f"FLOW_{body}", k), value)
    for i, entry in _entries(c, bodies):
        c.slabs.add(f"APART_{i}", 1)
        s.scope.store(f"APART_{i}", s.separation(entry.joint).length)
    s.scope.write(text)
    inner = text.lanes()
    for body in bodies:
        if (start := _table(c, body)) >= 0:
            flow = ", ".join(f"w[{part(f'FLOW_{body}', k)} + l]" for k in range(3))
            inner(f"put_grid6(w, LOOKED_UP_{body} + l, SHARED + {start}, {flow})")
        else:
            inner(f"put6_zero(w, LOOKED_UP_{body} + l)")
    for i, entry in _entries(c, bodies):
        start, factor = int(c.shape.plan.model.table[int(c.model.proximity_i) + 3 * i + 2]), int(c.model.proximity_p) + i
        inner(f"add_curves6(w, LOOKED_UP_{entry.body} + l, SHARED + {start}, w[APART_{i} + l], w[P + {factor} * LANES + l])")


def call_look_up(text: Text, c: Context, stage: Stage) -> None:
    """A line for it, ahead of what needs it."""
    if any(looks_up(c.shape, body) for body in c.shape.bodies):
        text(f"look_up_{stage.name}(w)")


def _entries(c: Context, bodies: list[str]) -> list[tuple[int, Proximity]]:
    """Increments over a distance of separation, and their numbers."""
    return [(i, entry) for i, entry in enumerate(c.shape.scene.proximity) if entry.body in bodies]


def _table(c: Context, body: str) -> int:
    """Where a body's table over Mach number, alpha and beta starts among the numbers that cases share; -1 if it has none."""
    return int(c.shape.plan.model.table[int(c.model.aero_table_i) + [*c.shape.bodies, GROUND].index(body)])


def _flow(s: State, body: str) -> tuple[Any, Any, Any]:
    """Mach number, alpha and beta."""
    flow = vec3.unrotate(s.attitude(body), vec3.add(s.speed(body), s.case.stream)).called("flow")
    alpha, beta = loads.flow_angles(flow).called("angles")
    base = s.scope.load("AIR", 4)
    higher = air.geopotential(s.place(body)[1] + level(s.scope, s.time)) - base[0]
    temperature = (1.0 + base[1] * higher) / base[2]
    return square_root(vec3.dot(flow, flow)) / air.sound_speed(temperature), alpha, beta
