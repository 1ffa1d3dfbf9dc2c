"""`sepmc stress`: accuracy on numerically hard inputs, in one table.

Each line of the table has an input, the error of a quantity, the bound of that error, which was set
beforehand and states its reason, and whether the status or an audit column reported an error.
"""

from collections.abc import Callable, Iterable

from sepmc.validation.stresses import (
    drift,
    edges,
    events,
    inputs,
    ratios,
    redundant,
    springs,
    strokes,
    turning,
)
from sepmc.validation.stresses.drift import hours_table
from sepmc.validation.stresses.expected import EXPECTED
from sepmc.validation.stresses.line import Stress, brief, counts, table

__all__ = [
    "EXPECTED", "STRESSES", "Stress", "brief", "counts", "hours_table", "stress", "table",
]  # fmt: skip

STRESSES: dict[str, Callable[[], list[Stress]]] = {
    group.__name__: group
    for group in (
        ratios.masses,
        ratios.light_link,
        ratios.inertias,
        ratios.needles,
        ratios.nearly_singular,
        ratios.arms,
        ratios.long_pendulum,
        turning.resolved_spins,
        turning.long_steps,
        turning.step_lengths,
        turning.hinged_steps,
        turning.angles,
        turning.angles_at_long_steps,
        drift.hour,
        strokes.strokes,
        strokes.grazing,
        strokes.slow,
        strokes.spent_springs,
        events.peak_loads,
        events.angle_limits,
        events.simultaneous,
        events.under_load,
        springs.stiff,
        springs.unresolved,
        springs.hidden,
        redundant.welds,
        redundant.triangle,
        redundant.four_bar,
        redundant.two_balls,
        redundant.near_parallel,
        redundant.short_rods,
        edges.aero_tables,
        edges.air,
        edges.wind,
        edges.proximity,
        inputs.not_finite,
        inputs.not_physical,
        inputs.absurd,
        inputs.rods_without_length,
        inputs.refused,
    )
}


def stress(names: Iterable[str] | None = None) -> list[Stress]:
    """Run stresses one after the other and return their lines.

    Parameters
    ----------
    names : iterable of str, optional
        Keys of `STRESSES`; all by default.
    """
    lines = []
    for name in STRESSES if names is None else names:
        lines += STRESSES[name]()
    return lines
