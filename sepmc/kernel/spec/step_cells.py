"""Tables with kinks, and the cells in which they are smooth.

A cell is the part of a table between neighbouring rows along each axis. A lane (a case of those
integrated side by side) stores the cell that its point is in. In a table with kinks this cell
changes only at the end of a step, so that no step passes a kink.

A table has kinks where it is interpolated linearly, where a force table is continued as a constant
within the stroke of its spring, and where the force of a spring jumps as its extension begins to
shrink, since the table has a return factor.
Rows of monotone force tables count as kinks: their second derivative jumps.
"""

from sepmc.scene.model import AeroTable, Scene, Spring


def has_unloading(spring: Spring, dispersed: frozenset[str]) -> bool:
    """True if, in some case, the force from a spring's table is smaller while the extension shrinks
    than while it grows: the table's return factor is not 1, or its path is in ``dispersed``. False
    without a table."""
    return spring.table is not None and (
        spring.table.return_factor != 1.0 or unloading_path(spring.name) in dispersed
    )


def unloading_path(spring: str) -> str:
    """Parameter path of the return factor of a spring's table: the force while the extension
    shrinks over that while it grows."""
    return f"spring.{spring}.table.return_factor"


def has_kinks(spring: Spring, dispersed: frozenset[str]) -> bool:
    """True if the force table of a spring has kinks within its stroke in some case: it is not a
    cubic spline, the stroke begins before its first row or may end beyond its last row, or its
    force may jump (`has_unloading`). False without a table. ``dispersed`` are the paths of
    dispersed parameters."""
    table = spring.table
    if table is None:
        return False
    return (
        table.interpolation != "cubic"
        or table.extension[0] > 0.0
        or spring.stroke > table.extension[-1]
        or f"spring.{spring.name}.stroke" in dispersed
        or has_unloading(spring, dispersed)
    )


def proximity_cell(number: int) -> str:
    """Name of the workspace field of the cell of a table of proximity increments, given by its
    number in the scene, from 0."""
    return f"INCREMENT_CELL_{number}"


def force_cell(spring: str) -> str:
    """Name of the workspace field of the cell of the force table of a spring."""
    return f"FORCE_CELL_{spring}"


def step_cells(scene: Scene, dispersed: frozenset[str]) -> dict[str, tuple[int, ...]]:
    """Cells of the tables with kinks of a scene; each is constant within a step.

    Parameters
    ----------
    scene : Scene
    dispersed : frozenset of str
        paths of dispersed parameters

    Returns
    -------
    dict of str to tuple of int
        by the name of the workspace field of a cell (one for each body and table that it uses, each
        table of increments, each spring): the axes (0 to 2) along which the cell has ends; those
        of a spring are 0, the extension, and 1, its rate if the table has a return factor
    """
    environment, cells = scene.environment, dict[str, tuple[int, ...]]()
    air, wind = environment.air, environment.wind.profile
    has_air = environment.atmosphere != "none"
    for name, body in scene.body.items():
        if wind is not None and wind.interpolation == "linear":
            cells[f"WIND_CELL_{name}"] = (0,)
        if body.aerodynamics is None or not has_air:
            continue
        if environment.atmosphere == "table" and air and air.interpolation == "linear":
            cells[f"AIR_CELL_{name}"] = (0,)
        if axes := _kinked_axes(body.aerodynamics.table):
            cells[f"CELL_{name}"] = axes
    for i, entry in enumerate(scene.proximity):
        if has_air and entry.interpolation == "linear":
            cells[proximity_cell(i)] = tuple(range(len(entry.points)))
    for spring in scene.spring:
        if has_kinks(spring, dispersed):
            cells[force_cell(spring.name)] = (0, 1) if has_unloading(spring, dispersed) else (0,)
    return cells


def _kinked_axes(table: AeroTable | None) -> tuple[int, ...]:
    """Axes (0 Mach number, 1 alpha, 2 beta) with more than one point of an aerodynamic table with
    linear interpolation; empty for other tables, and if no axis has more than two points, since
    the table has no kinks then."""
    if table is None or table.interpolation != "linear":
        return ()
    counts = [len(axis) for axis in (table.mach, table.alpha, table.beta)]
    return tuple(k for k, n in enumerate(counts) if n > 1) if max(counts) > 2 else ()
