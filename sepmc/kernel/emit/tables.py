"""Tables in a written kernel: of aerodynamic coefficients, of increments over a distance, of wind
and air over height.

Every lane holds the cell of a table that it is in (`sepmc.routines.splines`). Whether it still is
there is asked lane by lane, in a loop of its own; what the tables give is then summed for all lanes
side by side.
"""

import math
from typing import Any

from sepmc.kernel.emit.context import Context, component, level, rejection_unless
from sepmc.kernel.emit.geometry import State
from sepmc.kernel.spec.kernel_spec import KernelSpec, Segment
from sepmc.kernel.tracer.formulas import air, loads, square_root, vec3
from sepmc.kernel.tracer.text import Text
from sepmc.kernel.tracer.tracer import Expr
from sepmc.routines import layout as at
from sepmc.scene.model import Proximity
from sepmc.schema import Status

COEFFICIENTS = 6


def looks_up(spec: KernelSpec, body: str) -> bool:
    """Whether a body has coefficients from a table, or increments."""
    aero = spec.scene.body[body].aerodynamics
    in_air = spec.scene.environment.atmosphere != "none" and aero is not None
    return in_air and (
        (aero is not None and aero.table is not None)
        or any(one.body == body for one in spec.scene.proximity)
    )


def has_wind_profile(spec: KernelSpec) -> bool:
    """Whether the wind depends on height."""
    return spec.scene.environment.wind.profile is not None


def has_tables_over_height(spec: KernelSpec) -> bool:
    """Whether wind or air comes from a table over height."""
    return has_wind_profile(spec) or any(_has_air(spec, body) for body in spec.bodies)


def has_tables(spec: KernelSpec) -> bool:
    """Whether anything is looked up."""
    return has_tables_over_height(spec) or any(looks_up(spec, body) for body in spec.bodies)


def _has_air(spec: KernelSpec, body: str) -> bool:
    """Whether a body flies in air from a table over height."""
    return spec.feels_air(body) and not spec.in_layers(body)


def emit_look_up(out: Text, c: Context, segment: Segment) -> None:
    """A function for what tables give at a state of a phase."""
    if not has_tables(c.spec) or c.emit_alias(out, segment, "look_up"):
        return
    text = Text(out.indent + 1)  # that of each table comes before it
    _over_height(out, text, c, segment)
    bodies = [body for body in c.spec.bodies if looks_up(c.spec, body)]
    if bodies:
        _of_bodies(out, text, c, segment, bodies)
    out.function(
        f"look_up_{segment.name}(w)",
        f"What tables give at the state S in phase {segment.name}, into workspace of lanes.",
    ).lines.extend(text.lines)


def _of_bodies(out: Text, text: Text, c: Context, segment: Segment, bodies: list[str]) -> None:
    """Lines for the coefficients of bodies, from tables and with what a distance adds."""
    s = State(c, c.scope(), segment, "S")
    for body in bodies:
        if _table(c, body) >= 0:
            _put_place(s, f"FLOW_{body}", _flow(s, body))
    for i, entry in _entries(c, bodies):
        _put_place(s, f"DISTANCE_{i}", (s.separation(entry.joint).length, 0.0, 0.0))
    s.scope.write(text)
    for body in bodies:
        c.workspace.add(f"LOOKED_UP_{body}", COEFFICIENTS)
        if (start := _table(c, body)) >= 0:
            _sum_cells(out, text, c, start, f"CELL_{body}", f"FLOW_{body}", f"LOOKED_UP_{body}")
        else:
            text.block(f"for e in range({COEFFICIENTS} * LANES):")(f"w[LOOKED_UP_{body} + e] = 0.0")
    for i, entry in _entries(c, bodies):
        start, factor = (
            int(c.spec.layout.model.table[int(c.model.proximity_i) + i]),
            int(c.model.proximity_p) + i,
        )
        c.workspace.add(f"INCREMENTS_{i}", COEFFICIENTS)
        _within_ends(text, c, start, f"DISTANCE_{i}")
        _sum_cells(out, text, c, start, f"INCREMENT_CELL_{i}", f"DISTANCE_{i}", f"INCREMENTS_{i}")
        inner = text.block(f"for k in range({COEFFICIENTS}):").lanes()
        inner(
            f"w[LOOKED_UP_{entry.body} + k * LANES + l] += w[P + {factor} * LANES + l] * "
            f"w[INCREMENTS_{i} + k * LANES + l]"
        )


def _over_height(out: Text, text: Text, c: Context, segment: Segment) -> None:
    """Lines for what depends on the height of a body: logarithm of the density and speed of sound,
    and what the wind has there more."""
    in_air = [body for body in c.spec.bodies if _has_air(c.spec, body)]
    windy = c.spec.bodies if has_wind_profile(c.spec) else []
    if not (in_air or windy):
        return
    s = State(c, c.scope(), segment, "S")
    for name, bodies in (("HEIGHT_OF", in_air), ("WIND_HEIGHT", windy)):
        for body in bodies:
            _put_place(s, f"{name}_{body}", (s.place(body)[1] + level(s.scope, s.time), 0.0, 0.0))
    s.scope.write(text)
    for body in in_air:
        c.workspace.add(f"AIR_OF_{body}", 2)
        _sum_cells(
            out,
            text,
            c,
            int(c.model.air_x),
            f"AIR_CELL_{body}",
            f"HEIGHT_OF_{body}",
            f"AIR_OF_{body}",
            Status.OUTSIDE_ATMOSPHERE,
        )
    for body in windy:
        c.workspace.add(f"WIND_{body}", 2)
        _within_ends(text, c, int(c.model.wind_x), f"WIND_HEIGHT_{body}")
        _sum_cells(
            out,
            text,
            c,
            int(c.model.wind_x),
            f"WIND_CELL_{body}",
            f"WIND_HEIGHT_{body}",
            f"WIND_{body}",
        )


def _put_place(s: State, field: str, place: tuple[Any, Any, Any]) -> None:
    """Record where in a table a lane is."""
    s.c.workspace.add(field, 3)
    for k, value in enumerate(place):
        s.scope.store(component(field, k), value)


def _within_ends(text: Text, c: Context, start: int, place: str) -> None:
    """Lines that hold a place between the ends of a pack of one axis."""
    first, last = start + 2, start + 2 + int(c.spec.layout.model.numbers[start + 1])
    text.lanes()(
        f"w[{place} + l] = min(max(w[{place} + l], w[SHARED + {first}]), w[SHARED + {last}])"
    )


def _sum_cells(
    out: Text,
    text: Text,
    c: Context,
    start: int,
    cell: str,
    place: str,
    found: str,
    leaves: Status = Status.OUTSIDE_TABLE,
) -> None:
    """Lines that put what a pack gives at places of three numbers where it is read, and, the first
    time, a function that sums it; ``start`` is that of the pack among the numbers that cases share,
    ``cell`` where lanes hold theirs; who ``leaves`` it is lost so."""
    functions, counts = int(c.spec.layout.model.numbers[start]), _counts(c, start)
    if c.workspace.add(cell, at.CELL_COEFFICIENTS + functions * math.prod(counts)):
        for n in range(3):  # holds no place
            c.case.scope.store(component(cell, at.CELL_ENDS + 3 * n), math.inf)
        says = "What a table gives at the places of lanes, from the cells that they hold."
        inner = out.function(f"sum_{cell}(w)", says).lanes()
        for line in sum_of_cell(cell, place, found, functions, counts):
            inner.broken(line)
    inner = text.lanes()
    inner("x, y, z = " + ", ".join(f"w[{component(place, k)} + l]" for k in range(3)))
    inner = inner.block(f"if not in_cell(w, {cell} + l, x, y, z):")
    inner(
        f"inside = load_cell(w, {cell} + l, SHARED + {start}, x, y, z)",
        rejection_unless("inside", leaves),
    )
    text(f"sum_{cell}(w)")


def sum_of_cell(cell: str, place: str, found: str, functions: int, counts: list[int]) -> list[str]:
    """Lines for one lane: the basis functions of each axis at its place, their products, and what
    so many functions are with these; all places are constants, so that lanes are vectorised."""

    def held(k: int) -> str:
        return f"w[{component(cell, k)} + l]"

    lines, products = [], [""]
    for n, (axis, count) in enumerate(zip("uvz", counts, strict=True)):
        if count == 1:  # an axis of one point: its function is 1
            continue
        lines.append(f"s = w[{component(place, n)} + l] - {held(at.CELL_ENDS + 3 * n + 2)}")
        for i in range(count):
            a, b, c, d = (held(at.CELL_BASIS + 16 * n + 4 * i + q) for q in range(4))
            lines.append(f"{axis}{i} = {a} + s * ({b} + s * ({c} + s * {d}))")
        products = [
            f"{product} * {axis}{i}" if product else f"{axis}{i}"
            for product in products
            for i in range(count)
        ]
    weights = [f"weight_{k}" for k in range(len(products))]
    lines += [
        f"{weight} = {product or '1.0'}" for weight, product in zip(weights, products, strict=True)
    ]
    for f in range(functions):
        terms = (
            f"{weight} * {held(at.CELL_COEFFICIENTS + functions * k + f)}"
            for k, weight in enumerate(weights)
        )
        lines.append(f"w[{component(found, f)} + l] = {' + '.join(terms)}")
    return lines


def _counts(c: Context, start: int) -> list[int]:
    """Basis functions that a place sees along each axis of a pack."""
    found, axis = [], start + 1
    for _ in range(3):
        spans = int(c.spec.layout.model.numbers[axis])
        found.append(4 if spans else 1)
        axis += 2 + 17 * spans
    return found


def call_look_up(text: Text, c: Context, segment: Segment) -> None:
    """A line for it, ahead of what needs it."""
    if has_tables(c.spec):
        text(f"look_up_{segment.name}(w)")


def _entries(c: Context, bodies: list[str]) -> list[tuple[int, Proximity]]:
    """Increments over a distance of separation, and their numbers."""
    return [(i, entry) for i, entry in enumerate(c.spec.scene.proximity) if entry.body in bodies]


def _table(c: Context, body: str) -> int:
    """Where a body's table over Mach number, alpha and beta starts among the numbers that cases
    share; -1 if it has none."""
    return int(
        c.spec.layout.model.table[int(c.model.aero_table_i) + list(c.spec.bodies).index(body)]
    )


def _flow(s: State, body: str) -> tuple[Expr, Expr, Expr]:
    """Mach number, alpha and beta."""
    flow: Any = vec3.unrotate(s.attitude(body), vec3.add(s.speed(body), s.stream(body))).called(
        "flow"
    )
    alpha, beta = loads.flow_angles(flow).called("angles")
    if not s.spec.in_layers(body):
        return (
            square_root(vec3.dot(flow, flow)) / s.scope.load(component(f"AIR_OF_{body}", 1)),
            alpha,
            beta,
        )
    base = s.scope.load(s.c.layer(body), 4)
    higher = air.geopotential(s.place(body)[1] + level(s.scope, s.time)) - base[0]
    temperature = (1.0 + base[1] * higher) / base[2]
    return square_root(vec3.dot(flow, flow)) / air.sound_speed(temperature), alpha, beta
