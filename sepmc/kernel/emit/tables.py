"""Table look-ups, as lines of a kernel: aerodynamic coefficients, increments over a distance, wind
and air over altitude.

Every lane stores the table cell that it is in (`sepmc.routines.splines`). A loop of its own checks
lane by lane if the point is still in the cell; the table values are then summed for all lanes side
by side.
"""

import math
from typing import Any

from sepmc.kernel.emit.context import Context, component, origin_height, rejection_unless
from sepmc.kernel.emit.geometry import State
from sepmc.kernel.spec.kernel_spec import KernelSpec, Segment, kinked_axes
from sepmc.kernel.spec.packing import derivative_grids
from sepmc.kernel.tracer.formulas import air, loads, square_root, vec3
from sepmc.kernel.tracer.text import Text
from sepmc.kernel.tracer.tracer import Expr
from sepmc.routines import layout as at
from sepmc.scene.model import Proximity
from sepmc.schema import Status

COEFFICIENTS = 6
# Mach number, rad: a cell is left so far beyond its end, and the next one holds that point
_BESIDE = 1e-9
_MOMENT = 1e-6  # s


def looks_up(spec: KernelSpec, body: str) -> bool:
    """True if a body has coefficients from a table, or increments."""
    aero = spec.scene.body[body].aerodynamics
    in_air = spec.scene.environment.atmosphere != "none" and aero is not None
    return in_air and (
        (aero is not None and aero.table is not None)
        or any(one.body == body for one in spec.scene.proximity)
    )


def table_derivatives(spec: KernelSpec, body: str) -> list[tuple[str, int, str]]:
    """Derivatives by rates in the aerodynamic table of a body: name, index of the coefficient,
    rate. The look-up returns them in this order, after the six coefficients. Empty without a
    table."""
    aero = spec.scene.body[body].aerodynamics
    return derivative_grids(aero.table) if aero is not None and aero.table is not None else []


def has_wind_profile(spec: KernelSpec) -> bool:
    """True if the wind depends on altitude."""
    return spec.scene.environment.wind.profile is not None


def has_tables_over_height(spec: KernelSpec) -> bool:
    """True if wind or air comes from a table over altitude."""
    return has_wind_profile(spec) or any(_has_air(spec, body) for body in spec.bodies)


def has_tables(spec: KernelSpec) -> bool:
    """True if a kernel has table look-ups."""
    return (
        has_tables_over_height(spec)
        or any(looks_up(spec, body) for body in spec.bodies)
        or any(spring.table is not None for spring in spec.scene.spring)
    )


def _has_air(spec: KernelSpec, body: str) -> bool:
    """True if a body is in air from a table over altitude."""
    return spec.feels_air(body) and not spec.in_layers(body)


def emit_look_up(out: Text, c: Context, segment: Segment) -> None:
    """Write the function for the table values at a state of a segment."""
    if not has_tables(c.spec) or c.emit_alias(out, segment, "look_up"):
        return
    text = Text(out.indent + 1)  # the functions of the tables come before it
    _emit_height_tables(out, text, c, segment)
    bodies = [body for body in c.spec.bodies if looks_up(c.spec, body)]
    if bodies:
        _emit_aero_tables(out, text, c, segment, bodies)
    _emit_force_tables(out, text, c, segment)
    out.function(
        f"look_up_{segment.name}(w)",
        f"Table values at the state S in phase {segment.name}.",
    ).lines.extend(text.lines)


def _emit_aero_tables(
    out: Text, text: Text, c: Context, segment: Segment, bodies: list[str]
) -> None:
    """Append lines for the coefficients of bodies, from tables and increments."""
    s = State(c, c.scope(), segment, "S")
    for body in bodies:
        if _table_start(c, body) >= 0:
            _store_point(s, f"FLOW_{body}", mach_and_angles(s, body))
    for i, entry in _increments(c, bodies):
        _store_point(s, f"DISTANCE_{i}", (s.separation(entry.joint).length, 0.0, 0.0))
    s.scope.write(text)
    for body in bodies:
        c.workspace.add(f"LOOKED_UP_{body}", COEFFICIENTS + len(table_derivatives(c.spec, body)))
        if (start := _table_start(c, body)) >= 0:
            is_held = bool(kinked_axes(c.spec.scene, body))
            cell, values = f"CELL_{body}", f"LOOKED_UP_{body}"
            _emit_table(out, text, c, start, cell, f"FLOW_{body}", values, is_held=is_held)
        else:
            text.block(f"for e in range({COEFFICIENTS} * LANES):")(f"w[LOOKED_UP_{body} + e] = 0.0")
    for i, entry in _increments(c, bodies):
        start, factor = (
            int(c.spec.layout.model.table[int(c.model.proximity_i) + i]),
            int(c.model.proximity_p) + i,
        )
        c.workspace.add(f"INCREMENTS_{i}", COEFFICIENTS)
        _clamp(text, c, start, f"DISTANCE_{i}")
        _emit_table(out, text, c, start, f"INCREMENT_CELL_{i}", f"DISTANCE_{i}", f"INCREMENTS_{i}")
        inner = text.block(f"for k in range({COEFFICIENTS}):").lanes()
        inner(
            f"w[LOOKED_UP_{entry.body} + k * LANES + l] += w[P + {factor} * LANES + l] * "
            f"w[INCREMENTS_{i} + k * LANES + l]"
        )


def _emit_height_tables(out: Text, text: Text, c: Context, segment: Segment) -> None:
    """Append lines for tables over altitude: log density and speed of sound, and the wind
    profile."""
    in_air = [body for body in c.spec.bodies if _has_air(c.spec, body)]
    windy = c.spec.bodies if has_wind_profile(c.spec) else []
    if not (in_air or windy):
        return
    s = State(c, c.scope(), segment, "S")
    for name, bodies in (("HEIGHT_OF", in_air), ("WIND_HEIGHT", windy)):
        for body in bodies:
            _store_point(
                s, f"{name}_{body}", (s.place(body)[1] + origin_height(s.scope, s.time), 0.0, 0.0)
            )
    s.scope.write(text)
    for body in in_air:
        c.workspace.add(f"AIR_OF_{body}", 2)
        _emit_table(
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
        _clamp(text, c, int(c.model.wind_x), f"WIND_HEIGHT_{body}")
        _emit_table(
            out,
            text,
            c,
            int(c.model.wind_x),
            f"WIND_CELL_{body}",
            f"WIND_HEIGHT_{body}",
            f"WIND_{body}",
        )


def _emit_force_tables(out: Text, text: Text, c: Context, segment: Segment) -> None:
    """Append lines for the forces of springs from tables over extension."""
    springs = [(i, one) for i, one in enumerate(c.spec.scene.spring) if one.table is not None]
    if not springs:
        return
    s = State(c, c.scope(), segment, "S")
    for _, spring in springs:
        extension = s.spring(spring).length - s.spring_start(spring)
        _store_point(s, f"EXTENSION_{spring.name}", (extension, 0.0, 0.0))
    s.scope.write(text)
    for i, spring in springs:
        start = int(c.spec.layout.model.table[int(c.model.force_tables_i) + i])
        point = f"EXTENSION_{spring.name}"
        c.workspace.add(table_force(spring.name), 1)
        _clamp(text, c, start, point)
        _emit_table(
            out, text, c, start, f"FORCE_CELL_{spring.name}", point, table_force(spring.name)
        )


def table_force(spring: str) -> str:
    """Workspace field of the force of a spring from its table, N."""
    return f"TABLE_FORCE_{spring}"


def held_cells(spec: KernelSpec) -> list[str]:
    """Bodies whose tables are of lines with kinks: their cells change at the ends of steps only."""
    return [body for body in spec.bodies if kinked_axes(spec.scene, body)]


def emit_cells(out: Text, c: Context, segment: Segment) -> None:
    """Write the functions for the ends of cells of tables of lines: the flow in a segment and its
    rate, and the entry into the next cells.

    The rate is the difference quotient over `_MOMENT` along the derivative K1, wind and air at that
    place included.
    """
    bodies = held_cells(c.spec)
    if not bodies:
        return
    size = c.spec.active_size(segment)
    docstring = "Flow at bodies with tables of lines at the state Y, and its rate along K1."
    text = out.function(f"cell_flow_{segment.name}(w)", docstring)
    text.block("for e in range(SIZE_Y):")("w[S + e] = w[Y + e]")
    text.lanes()("w[CLOCK + l] = w[T + l]")
    text(f"look_up_{segment.name}(w)")
    for body in bodies:
        c.workspace.add(f"FLOW_NOW_{body}", 3), c.workspace.add(f"FLOW_RATE_{body}", 3)
        inner = text.block("for e in range(3 * LANES):")
        inner(f"w[FLOW_NOW_{body} + e] = w[FLOW_{body} + e]")
    text.block(f"for e in range({size} * LANES):")(f"w[S + e] = w[Y + e] + {_MOMENT} * w[K1 + e]")
    text.lanes()(f"w[CLOCK + l] = w[T + l] + {_MOMENT}")
    text(f"look_up_{segment.name}(w)")
    for body in bodies:
        inner = text.block("for e in range(3 * LANES):")
        inner(
            f"w[FLOW_RATE_{body} + e] = (w[FLOW_{body} + e] - w[FLOW_NOW_{body} + e]) / {_MOMENT}"
        )
    docstring = (
        "Move bodies whose flow has left the cell of their table into the one that holds it or, "
        "with ``ahead``, that it moves into."
    )
    text = out.function(f"enter_cells_{segment.name}(w, ahead: float)", docstring)
    for body in bodies:
        start, flag = _table_start(c, body), f"ENTERS_CELL_{body}"
        inner = text.lanes().block(f"if w[{flag} + l] > 0.0:")
        axes = kinked_axes(c.spec.scene, body)
        for k, axis in enumerate("xyz"):
            inner(f"{axis} = w[{component(f'FLOW_NOW_{body}', k)} + l]")
            if k not in axes:
                continue
            first, last = _range(c, start, k)
            rate = f"w[{component(f'FLOW_RATE_{body}', k)} + l]"
            inner(
                f"there = {axis} + ({2.0 * _BESIDE} if {rate} > 0.0 else {-2.0 * _BESIDE})",
                f"is_in = w[SHARED + {first}] <= there <= w[SHARED + {last}]",
                f"{axis} = there if ahead > 0.0 and abs({rate}) > 0.0 and is_in else {axis}",
            )
        inner(
            f"inside = load_cell(w, CELL_{body} + l, SHARED + {start}, x, y, z)",
            rejection_unless("inside", Status.OUTSIDE_TABLE),
            f"w[{flag} + l] = 0.0 if ahead > 0.0 else 1.0",
        )


def _range(c: Context, start: int, axis: int) -> tuple[int, int]:
    """Indices of the first and the last point of an axis of a table among the shared numbers."""
    at_axis = start + 1
    for _ in range(axis):
        at_axis += 2 + 17 * int(c.spec.layout.model.numbers[at_axis])
    return at_axis + 1, at_axis + 1 + int(c.spec.layout.model.numbers[at_axis])


def cell_end(s: State, body: str, axis: int, is_top: bool) -> tuple[Any, Any]:
    """Distance of the flow at a body beyond an end of its cell along an axis, and its rate.

    Parameters
    ----------
    s : State
    body : str
    axis : int
        0 Mach number, 1 alpha (rad), 2 beta (rad)
    is_top : bool

    Returns
    -------
    distance, rate : Expr
        per s
    """
    end = s.scope.load(component(f"CELL_{body}", at.CELL_ENDS + 3 * axis + int(is_top)))
    value = s.scope.load(component(f"FLOW_NOW_{body}", axis))
    rate = s.scope.load(component(f"FLOW_RATE_{body}", axis))
    return (value - end - _BESIDE, rate) if is_top else (end - value - _BESIDE, -rate)


def _store_point(s: State, field: str, point: tuple[Any, Any, Any]) -> None:
    """Store the table coordinates of a lane."""
    s.c.workspace.add(field, 3)
    for k, value in enumerate(point):
        s.scope.store(component(field, k), value)


def _clamp(text: Text, c: Context, start: int, point: str) -> None:
    """Append lines that limit a coordinate to the range of a table of one axis."""
    first, last = start + 2, start + 2 + int(c.spec.layout.model.numbers[start + 1])
    text.lanes()(
        f"w[{point} + l] = min(max(w[{point} + l], w[SHARED + {first}]), w[SHARED + {last}])"
    )


def _emit_table(
    out: Text,
    text: Text,
    c: Context,
    start: int,
    cell: str,
    point: str,
    values: str,
    leaves: Status = Status.OUTSIDE_TABLE,
    is_held: bool = False,
) -> None:
    """Append lines that evaluate a table at the stored points and, the first time, write the
    function that sums its values.

    ``start`` is the index of the table among the shared numbers, ``cell`` the field of the cells; a
    lane outside the table is rejected with the status ``leaves``. A cell that ``is_held`` changes
    at the ends of steps only (`emit_enter_cells`).
    """
    functions, counts = int(c.spec.layout.model.numbers[start]), _basis_counts(c, start)
    if c.workspace.add(cell, at.CELL_COEFFICIENTS + functions * math.prod(counts)):
        for n in range(3):  # contains no point
            c.case.scope.store(component(cell, at.CELL_ENDS + 3 * n), math.inf)
        docstring = "Table values at the points of the lanes, from their cells."
        inner = out.function(f"sum_{cell}(w)", docstring).lanes()
        for line in cell_sum_lines(cell, point, values, functions, counts):
            inner.broken(line)
    if not is_held:
        inner = text.lanes()
        inner("x, y, z = " + ", ".join(f"w[{component(point, k)} + l]" for k in range(3)))
        inner = inner.block(f"if not in_cell(w, {cell} + l, x, y, z):")
        inner(
            f"inside = load_cell(w, {cell} + l, SHARED + {start}, x, y, z)",
            rejection_unless("inside", leaves),
        )
    text(f"sum_{cell}(w)")


def cell_sum_lines(
    cell: str, point: str, values: str, functions: int, counts: list[int]
) -> list[str]:
    """Lines of a lane for the values of a table in its cell.

    Basis functions of each axis, their products, and the sums over coefficients; all offsets are
    constants, so that lanes are vectorised.

    Parameters
    ----------
    cell, point, values : str
        fields of cell, point and values
    functions : int
        number of functions in the table
    counts : list of int
        number of basis functions of each axis

    Returns
    -------
    list of str
    """

    def cell_value(k: int) -> str:
        return f"w[{component(cell, k)} + l]"

    lines, products = [], [""]
    for n, (axis, count) in enumerate(zip("uvz", counts, strict=True)):
        if count == 1:  # axis of a single point: its function is 1
            continue
        lines.append(f"s = w[{component(point, n)} + l] - {cell_value(at.CELL_ENDS + 3 * n + 2)}")
        for i in range(count):
            a, b, c, d = (cell_value(at.CELL_BASIS + 16 * n + 4 * i + q) for q in range(4))
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
            f"{weight} * {cell_value(at.CELL_COEFFICIENTS + functions * k + f)}"
            for k, weight in enumerate(weights)
        )
        lines.append(f"w[{component(values, f)} + l] = {' + '.join(terms)}")
    return lines


def _basis_counts(c: Context, start: int) -> list[int]:
    """Number of basis functions at a point along each axis of a table."""
    counts, axis = [], start + 1
    for _ in range(3):
        spans = int(c.spec.layout.model.numbers[axis])
        counts.append(4 if spans else 1)
        axis += 2 + 17 * spans
    return counts


def call_look_up(text: Text, c: Context, segment: Segment) -> None:
    """Append the call of the look-up, if the kernel has tables."""
    if has_tables(c.spec):
        text(f"look_up_{segment.name}(w)")


def _increments(c: Context, bodies: list[str]) -> list[tuple[int, Proximity]]:
    """Coefficient increments of some bodies, with their numbers."""
    return [(i, entry) for i, entry in enumerate(c.spec.scene.proximity) if entry.body in bodies]


def _table_start(c: Context, body: str) -> int:
    """Index of the aerodynamic table of a body among the shared numbers; -1 if it has none."""
    return int(
        c.spec.layout.model.table[int(c.model.aero_table_i) + list(c.spec.bodies).index(body)]
    )


def mach_and_angles(s: State, body: str) -> tuple[Expr, Expr, Expr]:
    """Mach number, alpha and beta at a body."""
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
    height_above_base = (
        air.geopotential(s.place(body)[1] + origin_height(s.scope, s.time)) - base[0]
    )
    temperature = (1.0 + base[1] * height_above_base) / base[2]
    return square_root(vec3.dot(flow, flow)) / air.sound_speed(temperature), alpha, beta
