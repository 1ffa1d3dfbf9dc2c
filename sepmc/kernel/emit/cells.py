"""Emitter of the changes of cells of tables with kinks (`sepmc.kernel.spec.step_cells`).

The cell of such a table, the part between neighbouring rows that contains the point, is constant
within a step, so that the table is smooth there. That the point leaves its cell is an event, at
which a step ends and the next cell is loaded.
"""

from dataclasses import dataclass
from typing import Any

from sepmc.kernel.emit.context import Context, component, rejection_unless
from sepmc.kernel.emit.geometry import State
from sepmc.kernel.emit.tables import (
    axis_ends,
    force_table_start,
    proximity_start,
    slack_tables,
    table_force,
    table_start,
)
from sepmc.kernel.spec.kernel_spec import Segment
from sepmc.kernel.spec.step_cells import force_cell, proximity_cell
from sepmc.kernel.tracer.text import Text
from sepmc.routines import layout as at
from sepmc.schema import Status

# in the unit of the axis: a cell is left this far beyond its end, so that the next one contains
# the point
BESIDE = 1e-9
_MOMENT, _LONGER_MOMENT = 1e-6, 1e-5  # s, of difference quotients for first and second rates


@dataclass(frozen=True)
class _KinkedTable:
    """Table with kinks, as one body, spring or increment uses it: names of the workspace fields of
    its ``cell`` and its ``point`` (coordinates along the axes), index ``start`` of the table among
    the shared numbers, and the status of a case whose point ``leaves`` the table."""

    cell: str
    point: str
    start: int
    leaves: Status = Status.OUTSIDE_TABLE


def _kinked_tables(c: Context) -> list[_KinkedTable]:
    """Tables with kinks of the scene, one entry for each body, spring or increment that uses one
    and each kind of table (wind, air, aerodynamics)."""
    wind, air = int(c.model.wind_x), int(c.model.air_x)
    tables = []
    for body in c.spec.bodies:
        tables += [
            _KinkedTable(f"WIND_CELL_{body}", f"WIND_HEIGHT_{body}", wind),
            _KinkedTable(f"AIR_CELL_{body}", f"HEIGHT_OF_{body}", air, Status.OUTSIDE_ATMOSPHERE),
            _KinkedTable(f"CELL_{body}", f"FLOW_{body}", table_start(c, body)),
        ]
    for i in range(len(c.spec.scene.proximity)):
        tables.append(_KinkedTable(proximity_cell(i), f"DISTANCE_{i}", proximity_start(c, i)))
    for i, spring in enumerate(c.spec.scene.spring):
        start, point = force_table_start(c, i), f"EXTENSION_{spring.name}"
        tables.append(_KinkedTable(force_cell(spring.name), point, start))
    return [table for table in tables if table.cell in c.spec.step_cells]


def call_table_rates(text: Text, c: Context, segment: Segment) -> None:
    """Append the call of the kernel function ``table_rates_SEGMENT(w)`` (`emit_cells`), if the
    kernel has tables with kinks or tables of springs that only push."""
    if _kinked_tables(c) or slack_tables(c.spec):
        text(f"table_rates_{segment.name}(w)")


def emit_cells(out: Text, c: Context, segment: Segment) -> None:
    """Write the kernel functions that a segment needs to change cells of tables with kinks.

    ``table_rates_SEGMENT(w)`` stores the points in these tables at the state Y, and their rates,
    into the fields NOW_... and RATE_...; also the forces from tables of springs that only push. A
    rate is the difference quotient over `_MOMENT` along the derivative K1, with the change of wind
    and air included. ``cell_second_rates_SEGMENT(w)`` stores second rates (`_emit_second_rates`).
    ``enter_cells_SEGMENT(w, ahead)`` loads a cell for each point that is flagged to have left its
    own, and rejects cases in which there is none: with ``ahead`` = 1.0 the one into which the point
    moves, with 0.0 the one that contains it (the point then stays flagged). Without tables with
    kinks only ``table_rates_SEGMENT`` is written, and that only if such springs have a table.
    """
    tables = _kinked_tables(c)
    known = [(table.cell, table.point, 3) for table in tables]
    known += [(field, field, count) for field, count in _slack_forces(c)]
    if not known:
        return
    size = c.spec.active_size(segment)
    docstring = (
        "Points in tables with kinks, and some looked-up values, at Y; their rates along K1."
    )
    text = out.function(f"table_rates_{segment.name}(w)", docstring)
    text.components(f"{size} * LANES")(f"w[S + e + l] = w[Y + e + l] + {_MOMENT} * w[K1 + e + l]")
    text.lanes()(f"w[CLOCK + l] = w[T + l] + {_MOMENT}")
    text(f"look_up_{segment.name}(w)")
    for name, field, count in known:
        c.workspace.add(f"NOW_{name}", count), c.workspace.add(f"RATE_{name}", count)
        inner = text.components(f"{count} * LANES")
        inner(f"w[RATE_{name} + e + l] = w[{field} + e + l]")
    _look_up_at_state(text, segment)  # last: kinks of formulas read values that are looked up
    for name, field, count in known:
        inner = text.components(f"{count} * LANES")
        inner(f"w[NOW_{name} + e + l] = w[{field} + e + l]")
        inner(
            f"change = w[RATE_{name} + e + l] - w[NOW_{name} + e + l]",
            f"w[RATE_{name} + e + l] = change / {_MOMENT}",
        )
    if not tables:
        return
    _emit_second_rates(out, c, segment, tables)
    docstring = (
        "Move points that have left the cell of their table into the one that holds them or, with "
        "``ahead``, that they move into."
    )
    text = out.function(f"enter_cells_{segment.name}(w, ahead: float)", docstring)
    for table in tables:
        cell, flag = table.cell, f"ENTERS_{table.cell}"
        inner = text.lanes().block(f"if w[{flag} + l] > 0.0:")
        for k, axis in enumerate("xyz"):
            inner(f"{axis} = w[{component(f'NOW_{cell}', k)} + l]")
            if k not in c.spec.step_cells[cell]:
                continue
            first, last = axis_ends(c, table.start, k)
            rate = f"w[{component(f'RATE_{cell}', k)} + l]"
            inner(
                f"there = {axis} + ({2.0 * BESIDE} if {rate} > 0.0 else {-2.0 * BESIDE})",
                f"is_in = w[SHARED + {first}] <= there <= w[SHARED + {last}]",
                f"{axis} = there if ahead > 0.0 and abs({rate}) > 0.0 and is_in else {axis}",
            )
        inner(
            f"inside = load_cell(w, {cell} + l, SHARED + {table.start}, x, y, z)",
            rejection_unless("inside", table.leaves),
            f"w[{flag} + l] = 0.0 if ahead > 0.0 else 1.0",
        )


def _slack_forces(c: Context) -> list[tuple[str, int]]:
    """Pairs (workspace field, number of its components) of the forces from the tables of springs
    that only push; springs without a table are left out."""
    numbers = c.spec.layout.model.numbers
    return [
        (table_force(spring.name), int(numbers[force_table_start(c, i)]))
        for i, spring in slack_tables(c.spec)
    ]


def _look_up_at_state(text: Text, segment: Segment) -> None:
    """Append lines that copy the state Y to S and the time T to CLOCK, and look up all tables
    there."""
    text.components("SIZE_Y")("w[S + e + l] = w[Y + e + l]")
    text.lanes()("w[CLOCK + l] = w[T + l]")
    text(f"look_up_{segment.name}(w)")


def _emit_second_rates(out: Text, c: Context, segment: Segment, tables: list[_KinkedTable]) -> None:
    """Write the kernel function ``cell_second_rates_SEGMENT(w)``, which stores the second time
    derivatives of the points in tables with kinks, at the start of an interval, into the fields
    SECOND_...; by them a point that is at rest on a kink leaves it."""
    size = c.spec.active_size(segment)
    docstring = "Second rates of points in tables with kinks at the start of an interval."
    text = out.function(f"cell_second_rates_{segment.name}(w)", docstring)
    _look_up_at_state(text, segment)
    for table in tables:
        c.workspace.add(f"SECOND_{table.cell}", 3)
        inner = text.components("3 * LANES")
        inner(f"w[SECOND_{table.cell} + e + l] = w[{table.point} + e + l]")
    for factor in (-2.0, 1.0):
        text(f"rates_{segment.name}(w)")
        inner = text.components(f"{size} * LANES")
        inner(f"w[S + e + l] += {_LONGER_MOMENT} * w[D + e + l]")
        text.lanes()(f"w[CLOCK + l] += {_LONGER_MOMENT}")
        text(f"look_up_{segment.name}(w)")
        for table in tables:
            inner = text.components("3 * LANES")
            inner(f"w[SECOND_{table.cell} + e + l] += {factor} * w[{table.point} + e + l]")
    for table in tables:
        inner = text.components("3 * LANES")
        inner(f"w[SECOND_{table.cell} + e + l] *= {1.0 / _LONGER_MOMENT**2}")


def cell_end(s: State, cell: str, axis: int, is_top: bool) -> tuple[Any, Any, Any]:
    """Distance of a point beyond one end of its cell along an axis of the table, less `BESIDE`
    (negative within the cell), with its first and second time derivatives.

    Parameters
    ----------
    s : State
    cell : str
        workspace field of the cell
    axis : int
        0 to 2
    is_top : bool
        True for the upper end of the cell, False for the lower one

    Returns
    -------
    distance, rate, second_rate : Expr
        in the unit of the axis, per s and per s2; the second rate is that at the start of the
        interval
    """
    end = s.scope.load(component(cell, at.CELL_ENDS + 3 * axis + int(is_top)))
    value = s.scope.load(component(f"NOW_{cell}", axis))
    rate = s.scope.load(component(f"RATE_{cell}", axis))
    second = s.scope.load(component(f"SECOND_{cell}", axis))
    if is_top:
        return value - end - BESIDE, rate, second
    return end - value - BESIDE, -rate, -second
