"""Cells of tables with kinks, as lines of a kernel.

Such a cell is constant within a step, so that the table is smooth there. A step ends where the
point leaves its cell, as at any other event, and the next cell is entered then.
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

# in the unit of the axis: a cell is left so far beyond its end, and the next one holds that point
BESIDE = 1e-9
_MOMENT, _LONGER_MOMENT = 1e-6, 1e-5  # s


@dataclass(frozen=True)
class _KinkedTable:
    """Table with kinks: fields of its cell and its point, index among the shared numbers, and the
    status of a case that leaves it."""

    cell: str
    point: str
    start: int
    leaves: Status = Status.OUTSIDE_TABLE


def _kinked_tables(c: Context) -> list[_KinkedTable]:
    """Tables with kinks."""
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
    """Append the call for the rates of what is looked up, if conditions need them."""
    if _kinked_tables(c) or slack_tables(c.spec):
        text(f"table_rates_{segment.name}(w)")


def emit_cells(out: Text, c: Context, segment: Segment) -> None:
    """Write the functions for the ends of cells of tables with kinks: the points in a segment with
    their rates, and the entry into the next cells. The first also gives the rates of the forces of
    tables of springs that only push.

    The rate is the difference quotient over `_MOMENT` along the derivative K1, wind and air at that
    place included.
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
    text.block(f"for e in range({size} * LANES):")(f"w[S + e] = w[Y + e] + {_MOMENT} * w[K1 + e]")
    text.lanes()(f"w[CLOCK + l] = w[T + l] + {_MOMENT}")
    text(f"look_up_{segment.name}(w)")
    for name, field, count in known:
        c.workspace.add(f"NOW_{name}", count), c.workspace.add(f"RATE_{name}", count)
        inner = text.block(f"for e in range({count} * LANES):")
        inner(f"w[RATE_{name} + e] = w[{field} + e]")
    _look_up_at_state(text, segment)  # last: kinks of formulas read values that are looked up
    for name, field, count in known:
        inner = text.block(f"for e in range({count} * LANES):")
        inner(f"w[NOW_{name} + e] = w[{field} + e]")
        inner(f"w[RATE_{name} + e] = (w[RATE_{name} + e] - w[NOW_{name} + e]) / {_MOMENT}")
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
    """Fields of the forces of tables of springs that only push, and their sizes."""
    numbers = c.spec.layout.model.numbers
    return [
        (table_force(spring.name), int(numbers[force_table_start(c, i)]))
        for i, spring in slack_tables(c.spec)
    ]


def _look_up_at_state(text: Text, segment: Segment) -> None:
    """Write the lines that look up all tables at the state Y."""
    text.block("for e in range(SIZE_Y):")("w[S + e] = w[Y + e]")
    text.lanes()("w[CLOCK + l] = w[T + l]")
    text(f"look_up_{segment.name}(w)")


def _emit_second_rates(out: Text, c: Context, segment: Segment, tables: list[_KinkedTable]) -> None:
    """Write the function for the second rates of the points in tables with kinks at the start of an
    interval, where no step before tells them: a point at rest on a kink leaves it by them."""
    size = c.spec.active_size(segment)
    docstring = "Second rates of points in tables with kinks at the start of an interval."
    text = out.function(f"cell_second_rates_{segment.name}(w)", docstring)
    _look_up_at_state(text, segment)
    for table in tables:
        c.workspace.add(f"SECOND_{table.cell}", 3)
        inner = text.block("for e in range(3 * LANES):")
        inner(f"w[SECOND_{table.cell} + e] = w[{table.point} + e]")
    for factor in (-2.0, 1.0):
        text(f"rates_{segment.name}(w)")
        inner = text.block(f"for e in range({size} * LANES):")
        inner(f"w[S + e] += {_LONGER_MOMENT} * w[D + e]")
        text.lanes()(f"w[CLOCK + l] += {_LONGER_MOMENT}")
        text(f"look_up_{segment.name}(w)")
        for table in tables:
            inner = text.block("for e in range(3 * LANES):")
            inner(f"w[SECOND_{table.cell} + e] += {factor} * w[{table.point} + e]")
    for table in tables:
        inner = text.block("for e in range(3 * LANES):")
        inner(f"w[SECOND_{table.cell} + e] *= {1.0 / _LONGER_MOMENT**2}")


def cell_end(s: State, cell: str, axis: int, is_top: bool) -> tuple[Any, Any, Any]:
    """Distance of a point beyond an end of its cell along an axis, its rate, and its second rate at
    the start of the interval.

    Parameters
    ----------
    s : State
    cell : str
        workspace field of the cell
    axis : int
    is_top : bool

    Returns
    -------
    distance, rate, second_rate : Expr
        in the unit of the axis, per s, and per s2
    """
    end = s.scope.load(component(cell, at.CELL_ENDS + 3 * axis + int(is_top)))
    value = s.scope.load(component(f"NOW_{cell}", axis))
    rate = s.scope.load(component(f"RATE_{cell}", axis))
    second = s.scope.load(component(f"SECOND_{cell}", axis))
    if is_top:
        return value - end - BESIDE, rate, second
    return end - value - BESIDE, -rate, -second
