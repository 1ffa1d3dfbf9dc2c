"""Emitter of table look-ups: aerodynamic coefficients, their increments near another body, wind and
air over altitude, spring forces.

Every lane (case) stores, for each table, the cell that its point is in: the piece of the table
between neighbouring rows, loaded by `sepmc.routines.splines.load_cell`. One loop checks lane by
lane whether the point is still in the cell, and loads the next one if not; another sums the table
values from the cells of all lanes side by side. Cells of tables with kinks are loaded only at the
start of a case and at the ends of steps (`sepmc.kernel.spec.step_cells`).
"""

import math
from typing import Any

from sepmc.kernel.emit.context import Context, component, origin_height, rejection_unless
from sepmc.kernel.emit.geometry import State
from sepmc.kernel.spec.kernel_spec import KernelSpec, Segment
from sepmc.kernel.spec.packing import PER_RATE, derivative_grids
from sepmc.kernel.spec.step_cells import force_cell, has_unloading, proximity_cell
from sepmc.kernel.tracer.formulas import air, loads, square_root, vec3
from sepmc.kernel.tracer.text import Text
from sepmc.kernel.tracer.tracer import Expr
from sepmc.routines import layout as at
from sepmc.scene.model import XYZ, Proximity, Spring
from sepmc.schema import Status

COEFFICIENTS = 6  # aerodynamic coefficients of a body


def looks_up(spec: KernelSpec, body: str) -> bool:
    """True if the scene has air and a body's aerodynamic coefficients come from a table, or have
    increments from one."""
    aero = spec.scene.body[body].aerodynamics
    in_air = spec.scene.environment.atmosphere != "none" and aero is not None
    return in_air and (
        (aero is not None and aero.table is not None)
        or any(one.body == body for one in spec.scene.proximity)
    )


def table_derivatives(spec: KernelSpec, body: str) -> list[tuple[str, int, str]]:
    """Derivatives of coefficients by angular rates in the aerodynamic table of a body, as (name,
    code of the coefficient, rate: p, q or r); empty without a table. The field LOOKED_UP_body has
    their values in this order, after the six coefficients."""
    aero = spec.scene.body[body].aerodynamics
    return derivative_grids(aero.table) if aero is not None and aero.table is not None else []


def has_wind_profile(spec: KernelSpec) -> bool:
    """True if the scene has a wind profile over altitude."""
    return spec.scene.environment.wind.profile is not None


def has_tables_over_height(spec: KernelSpec) -> bool:
    """True if wind, or the air of any body, comes from a table over altitude."""
    return has_wind_profile(spec) or any(_has_air(spec, body) for body in spec.bodies)


def has_tables(spec: KernelSpec) -> bool:
    """True if a kernel looks up any table: over altitude, of aerodynamics, or of spring forces."""
    return (
        has_tables_over_height(spec)
        or any(looks_up(spec, body) for body in spec.bodies)
        or any(spring.table is not None for spring in spec.scene.spring)
    )


def _has_air(spec: KernelSpec, body: str) -> bool:
    """True if a body has aerodynamics in air that comes from a table over altitude."""
    return spec.feels_air(body) and not spec.in_layers(body)


def emit_look_up(out: Text, c: Context, segment: Segment) -> None:
    """Write the kernel function ``look_up_SEGMENT(w)``, which looks up all tables at the state S,
    and the functions it calls; nothing is written if the kernel has no tables."""
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
    """Append lines to ``text`` that look up the aerodynamic coefficients of ``bodies``, from their
    tables and increments, into the fields LOOKED_UP_body; functions that sum the values of tables
    not used before are written to ``out``."""
    s = State(c, c.scope(), segment, "S")
    for body in bodies:
        if table_start(c, body) >= 0:
            _store_point(s, f"FLOW_{body}", mach_and_angles(s, body))
    for i, entry in _increments(c, bodies):
        _store_point(s, f"DISTANCE_{i}", _relative_motion(s, entry))
    s.scope.write(text)
    for body in bodies:
        c.workspace.add(f"LOOKED_UP_{body}", COEFFICIENTS + len(table_derivatives(c.spec, body)))
        if (start := table_start(c, body)) >= 0:
            _emit_table(out, text, c, start, f"CELL_{body}", f"FLOW_{body}", f"LOOKED_UP_{body}")
        else:
            text.components(f"{COEFFICIENTS} * LANES")(f"w[LOOKED_UP_{body} + e + l] = 0.0")
    for i, entry in _increments(c, bodies):
        start, factor = proximity_start(c, i), int(c.model.proximity_p) + i
        c.workspace.add(f"INCREMENTS_{i}", COEFFICIENTS)
        cell, point = proximity_cell(i), f"DISTANCE_{i}"
        _clamp(text, c, start, cell, point)
        _emit_table(out, text, c, start, cell, point, f"INCREMENTS_{i}")
        inner = text.block(f"for k in range({COEFFICIENTS}):").lanes()
        inner(
            f"w[LOOKED_UP_{entry.body} + k * LANES + l] += w[P + {factor} * LANES + l] * "
            f"w[INCREMENTS_{i} + k * LANES + l]"
        )


def _emit_height_tables(out: Text, text: Text, c: Context, segment: Segment) -> None:
    """Append lines to ``text`` that look up tables over altitude: logarithm of the density and
    speed of sound into the fields AIR_OF_body, wind into WIND_body; functions that sum the values
    of tables not used before are written to ``out``."""
    in_air = [body for body in c.spec.bodies if _has_air(c.spec, body)]
    windy = c.spec.bodies if has_wind_profile(c.spec) else []
    if not (in_air or windy):
        return
    s = State(c, c.scope(), segment, "S")
    for name, bodies in (("HEIGHT_OF", in_air), ("WIND_HEIGHT", windy)):
        for body in bodies:
            _store_point(
                s,
                f"{name}_{body}",
                (s.position(body)[1] + origin_height(s.scope, s.time), 0.0, 0.0),
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
        _clamp(text, c, int(c.model.wind_x), f"WIND_CELL_{body}", f"WIND_HEIGHT_{body}")
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
    """Append lines to ``text`` that look up the forces of springs in their tables over extension,
    into the fields `table_force`; functions that sum the values of tables not used before are
    written to ``out``."""
    springs = [(i, one) for i, one in enumerate(c.spec.scene.spring) if one.table is not None]
    if not springs:
        return
    s = State(c, c.scope(), segment, "S")
    for _, spring in springs:
        line = s.spring(spring)
        extension = line.length - s.spring_start(spring)
        rate: Any = PER_RATE * line.rate if has_unloading(spring, c.spec.dispersed) else 0.0
        _store_point(s, f"EXTENSION_{spring.name}", (extension, rate, 0.0))
    s.scope.write(text)
    for i, spring in springs:
        start = force_table_start(c, i)
        point = f"EXTENSION_{spring.name}"
        c.workspace.add(table_force(spring.name), int(c.spec.layout.model.numbers[start]))
        _clamp(text, c, start, force_cell(spring.name), point)
        _emit_table(out, text, c, start, force_cell(spring.name), point, table_force(spring.name))


def table_force(spring: str) -> str:
    """Name of the workspace field of the force of a spring from its table, N, without the return
    factor. With unloading (`has_unloading`) the field has a second component: the same force while
    the extension shrinks, 0 while it grows."""
    return f"TABLE_FORCE_{spring}"


def slack_tables(spec: KernelSpec) -> list[tuple[int, Spring]]:
    """Pairs (number from 0 in the scene, spring) of the springs with a force table that only
    push."""
    springs = enumerate(spec.scene.spring)
    return [(i, one) for i, one in springs if one.push_only and one.table is not None]


def _store_point(s: State, field: str, point: tuple[Any, Any, Any]) -> None:
    """Add lines to the scope of a state that store the three coordinates of a point in a table, in
    the units of the table's axes, into a workspace field, which is added."""
    s.c.workspace.add(field, 3)
    for k, value in enumerate(point):
        s.scope.store(component(field, k), value)


def _relative_motion(s: State, entry: Proximity) -> tuple[Any, Any, Any]:
    """Three coordinates, at a state, in the table of the proximity increments ``entry``. Without
    ``axes`` the first is the separation distance of its joint, m; otherwise each is what the axis
    names: a displacement of the second body since the start (`State.displacement`), m, or a
    relative angle (`State.relative_angles`), rad. 0 for missing axes."""
    if entry.axes is None:
        return s.separation(entry.joint).length, 0.0, 0.0
    known: dict[str, Any] = {
        axis: s.displacement(entry.joint, k) for k, axis in enumerate(XYZ) if axis in entry.points
    }
    if not known.keys() >= entry.points.keys():
        known |= dict(zip(("pitch", "yaw", "roll"), s.relative_angles(entry.joint), strict=True))
    values = [known[axis] for axis in entry.points]
    x, y, z = values + [0.0] * (3 - len(values))
    return x, y, z


def _clamp(text: Text, c: Context, start: int, cell: str, point: str) -> None:
    """Append lines that limit the coordinates of a point (field ``point``) to the range of the
    table with index ``start``; none if its cell is that of a table with kinks, which has spans
    beyond its range."""
    if cell in c.spec.step_cells:
        return
    for k in range(sum(count > 1 for count in _basis_counts(c, start))):
        first, last = axis_ends(c, start, k)
        path = f"w[{component(point, k)} + l]"
        text.lanes()(f"{path} = min(max({path}, w[SHARED + {first}]), w[SHARED + {last}])")


def axis_ends(c: Context, start: int, axis: int) -> tuple[int, int]:
    """Indices, among the shared numbers (as in `table_start`), of the first and the last break of
    an axis (0 to 2) of the packed table with index ``start``: the ends of its range."""
    at_axis = start + 1
    for _ in range(axis):
        at_axis += 2 + 17 * int(c.spec.layout.model.numbers[at_axis])
    return at_axis + 1, at_axis + 1 + int(c.spec.layout.model.numbers[at_axis])


def _emit_table(
    out: Text,
    text: Text,
    c: Context,
    start: int,
    cell: str,
    point: str,
    values: str,
    leaves: Status = Status.OUTSIDE_TABLE,
) -> None:
    """Append lines to ``text`` that evaluate a table at the points of the lanes; the first time for
    a cell, also write to ``out`` the kernel function ``sum_CELL(w)``, which sums the table values.

    ``start`` is the index of the packed table among the shared numbers; ``cell``, ``point`` and
    ``values`` are the fields of the cell, of the point (coordinates along the axes) and of the
    result. A case outside the table ends with the status ``leaves``. Cells of tables with kinks
    change at the ends of steps only (`sepmc.kernel.emit.cells`), but one that is still empty is
    loaded here: other tables and signals read values at the start, before the first step.
    """
    functions, counts = int(c.spec.layout.model.numbers[start]), _basis_counts(c, start)
    if c.workspace.add(cell, at.CELL_COEFFICIENTS + functions * math.prod(counts)):
        for n in range(3):  # contains no point
            c.case.scope.store(component(cell, at.CELL_ENDS + 3 * n), math.inf)
        docstring = "Table values at the points of the lanes, from their cells."
        inner = out.function(f"sum_{cell}(w)", docstring).lanes()
        for line in cell_sum_lines(cell, point, values, functions, counts):
            inner.broken(line)
    leaves_cell = f"not in_cell(w, {cell} + l, x, y, z)"
    if cell in c.spec.step_cells:
        leaves_cell = f"w[{component(cell, at.CELL_ENDS)} + l] == math.inf"
    inner = text.lanes()
    inner("x, y, z = " + ", ".join(f"w[{component(point, k)} + l]" for k in range(3)))
    inner = inner.block(f"if {leaves_cell}:")
    inner(
        f"inside = load_cell(w, {cell} + l, SHARED + {start}, x, y, z)",
        rejection_unless("inside", leaves),
    )
    text(f"sum_{cell}(w)")


def cell_sum_lines(
    cell: str, point: str, values: str, functions: int, counts: list[int]
) -> list[str]:
    """Lines of code, within a loop over lanes, that compute the values of a table from its cell.

    They compute the basis functions of each axis, their products, and the sums over coefficients;
    all offsets are constants, so that lanes are vectorised.

    Parameters
    ----------
    cell, point, values : str
        workspace fields of the cell, of the point (coordinates along the axes, not from the cell's
        start), and of the computed values
    functions : int
        number of functions in the table
    counts : list of int
        number of basis functions of each of the three axes: 4, or 1 for an axis of one point

    Returns
    -------
    list of str
    """

    def cell_value(k: int) -> str:
        """Kernel code of number ``k`` of the cell."""
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
    """Number of basis functions on a span of each of the three axes of a table: 4, or 1 for an axis
    of one point. ``start`` is the index of the packed table among the shared numbers."""
    counts, axis = [], start + 1
    for _ in range(3):
        spans = int(c.spec.layout.model.numbers[axis])
        counts.append(4 if spans else 1)
        axis += 2 + 17 * spans
    return counts


def call_look_up(text: Text, c: Context, segment: Segment) -> None:
    """Append the call of the kernel function ``look_up_SEGMENT(w)``, which looks up all tables at
    the state S; nothing if the kernel has no tables."""
    if has_tables(c.spec):
        text(f"look_up_{segment.name}(w)")


def _increments(c: Context, bodies: list[str]) -> list[tuple[int, Proximity]]:
    """Pairs (number from 0 in the scene, increments) of the proximity increments of the given
    bodies."""
    return [(i, entry) for i, entry in enumerate(c.spec.scene.proximity) if entry.body in bodies]


def table_start(c: Context, body: str) -> int:
    """Index, among the shared numbers (those of all cases, in the field SHARED), of the packed
    aerodynamic table of a body; -1 if the body has none."""
    return int(
        c.spec.layout.model.table[int(c.model.aero_table_i) + list(c.spec.bodies).index(body)]
    )


def proximity_start(c: Context, number: int) -> int:
    """Index, among the shared numbers (as in `table_start`), of the packed table of proximity
    increments with the given number (from 0) in the scene."""
    return int(c.spec.layout.model.table[int(c.model.proximity_i) + number])


def force_table_start(c: Context, number: int) -> int:
    """Index, among the shared numbers (as in `table_start`), of the packed force table of the
    spring with the given number (from 0) in the scene; -1 if the spring has none."""
    return int(c.spec.layout.model.table[int(c.model.force_tables_i) + number])


def mach_and_angles(s: State, body: str) -> tuple[Expr, Expr, Expr]:
    """Expressions of the Mach number, alpha and beta, rad, of the flow at a body at a state. A
    speed of sound from a table, and a wind from a profile, must have been looked up at the state
    before."""
    flow: Any = vec3.unrotate(s.attitude(body), vec3.add(s.velocity(body), s.stream(body))).called(
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
        air.geopotential(s.position(body)[1] + origin_height(s.scope, s.time)) - base[0]
    )
    temperature = (1.0 + base[1] * height_above_base) / base[2]
    return square_root(vec3.dot(flow, flow)) / air.sound_speed(temperature), alpha, beta
