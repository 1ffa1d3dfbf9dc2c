"""`sepmc verify`: the engine against closed forms, other formulations and conservation laws, in one
table.

Each line of the table has a case, a quantity, the reference, the measured value and the allowed
difference, which was set before the measurement. Scenes run as plain Python; the checks on
``table2.toml`` also run 200 cases of it in compiled code.
"""

from collections.abc import Callable, Iterable

from sepmc.validation.checks import balances, closed_forms, hinged, kinds, methods, paper, rows
from sepmc.validation.line import Line, brief, table

__all__ = ["CHECKS", "Line", "brief", "table", "verify"]

Check = Callable[[], list[Line]]
CHECKS: dict[str, Check] = {
    check.__name__: check
    for check in (
        closed_forms.free_body,
        closed_forms.welded,
        closed_forms.nasa_boxes,
        closed_forms.pushed_apart,
        closed_forms.thrust_slider,
        closed_forms.rail,
        hinged.pendulum,
        hinged.top,
        hinged.rod_pendulum,
        hinged.hooke,
        rows.rows,
        balances.no_work,
        balances.balance,
        kinds.full_against_reduced,
        kinds.against_lagrange,
        paper.phases,
        paper.cases,
        methods.orders,
    )
}


def verify(names: Iterable[str] | None = None) -> list[Line]:
    """Run checks one after the other and return their lines.

    Parameters
    ----------
    names : iterable of str, optional
        Keys of `CHECKS`; all by default.
    """
    lines = []
    for name in CHECKS if names is None else names:
        lines += CHECKS[name]()
    return lines
