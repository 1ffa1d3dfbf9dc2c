"""Checks of outcomes that a file defines by formulas of other outcomes."""

from sepmc.scene.contents import contents
from sepmc.scene.formula import FormulaError, names, parse
from sepmc.scene.messages import Problems, nearest
from sepmc.scene.model import VIOLATION, Scene
from sepmc.schema import FORMULA_UNITS, NOT_OK_LABELS, outcome_columns

_TAKEN = ("case", "status", "pi", VIOLATION, *NOT_OK_LABELS)


def check_formula_outcomes(scene: Scene, dispersed: frozenset[str], problems: Problems) -> None:
    """Add a problem for each ``[[outcome]]`` with an unknown unit or a reserved column name, or
    whose formula cannot be parsed, names anything but outcomes before it, or names none. If a unit
    is unknown, only units are checked. ``dispersed`` has the paths of dispersed parameters, as the
    columns of outcomes depend on them (`contents`)."""
    if any(one.unit not in FORMULA_UNITS for one in scene.outcome):
        for one in scene.outcome:
            if one.unit not in FORMULA_UNITS:
                reason = "must be a unit of outcomes: " + ", ".join(FORMULA_UNITS)
                problems.add(f"outcome.{one.name}.unit", reason, one.unit)
        return
    columns = [column.name for column in outcome_columns(contents(scene, dispersed))]
    for end, one in enumerate(scene.outcome, len(columns) - len(scene.outcome)):
        if columns[end] in _TAKEN or columns[end].startswith("in_"):
            reason = f"its column would be {columns[end]}, a reserved name: choose another"
            problems.add(f"outcome.{one.name}.name", reason, one.name)
        key_path = f"outcome.{one.name}.formula"
        try:
            named = names(parse(one.formula))
        except FormulaError as error:
            problems.add(key_path, str(error), one.formula)
            continue
        for name in named:
            if name not in columns[:end]:
                reason = "no such outcome, or none before this one; "
                problems.add(key_path, reason + nearest(name, columns[:end]), name)
        if not named:
            problems.add(key_path, "must name an outcome: it is a constant", one.formula)
