"""Tables with kinks: their cells change at the ends of steps only, so that no step passes a kink.

A table has kinks where it is made of lines, where a force table is continued as a constant within
the stroke of its spring, and where the force of a spring drops as its stroke shrinks. Rows of
monotone force tables count as kinks: their second derivative jumps.
"""

from sepmc.scene.model import AeroTable, Scene, Spring


def has_unloading(spring: Spring, dispersed: frozenset[str]) -> bool:
    """True if the force of a spring's table drops in some case as its stroke shrinks."""
    return spring.table is not None and (
        spring.table.return_factor != 1.0 or unloading_path(spring.name) in dispersed
    )


def unloading_path(spring: str) -> str:
    """Path of the return factor of a spring's table."""
    return f"spring.{spring}.table.return_factor"


def has_kinks(spring: Spring, dispersed: frozenset[str]) -> bool:
    """True if the table of a spring has kinks within its stroke in some case."""
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
    """Workspace field of the cell of a table of increments, by its number."""
    return f"INCREMENT_CELL_{number}"


def force_cell(spring: str) -> str:
    """Workspace field of the cell of the table of a spring."""
    return f"FORCE_CELL_{spring}"


def step_cells(scene: Scene, dispersed: frozenset[str]) -> dict[str, tuple[int, ...]]:
    """Cells of tables with kinks, which are constant within a step.

    Parameters
    ----------
    scene : Scene
    dispersed : frozenset of str
        paths of dispersed parameters

    Returns
    -------
    dict of str to tuple of int
        Axes of the table by the workspace field of the cell.
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
    """Axes (0 Mach number, 1 alpha, 2 beta) of an aerodynamic table, if it is of lines with
    kinks."""
    if table is None or table.interpolation != "linear":
        return ()
    counts = [len(axis) for axis in (table.mach, table.alpha, table.beta)]
    return tuple(k for k, n in enumerate(counts) if n > 1) if max(counts) > 2 else ()
