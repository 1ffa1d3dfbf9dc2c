"""Outcomes that a campaign file defines by formulas of other outcomes: computed after the kernel,
from the outcomes that it has written."""

import numpy as np

from sepmc.scene.formula import evaluate, names, parse
from sepmc.schema import Contents, Status, outcome_columns, result_columns


def fill_formulas(contents: Contents, outcomes: np.ndarray, status: np.ndarray) -> None:
    """Compute, for n cases, the outcomes that the campaign file defines by formulas of others.

    A case fails if a formula is undefined although all outcomes in it are finite: it gets the
    status UNDEFINED_FORMULA, and NaN as its outcomes and audit columns.

    Parameters
    ----------
    contents : Contents
        Contents of the scene; gives the formulas and the order of the columns.
    outcomes : ndarray, shape (columns, n)
        A row for each result column, SI units; rows after these are ignored. The rows of outcomes
        by formulas are written.
    status : ndarray of int, shape (n,)
        Status of the cases, changed in place; only OK and NEVER_RELEASED are replaced.
    """
    if not contents.formulas:
        return
    columns = outcome_columns(contents)
    indices = {column.name: k for k, column in enumerate(columns)}
    undefined = np.zeros(len(status), dtype=bool)
    first = len(columns) - len(contents.formulas)
    for k, formula in enumerate(contents.formulas, first):
        tree = parse(formula.text)
        named = {
            name: outcomes[indices[name]] * columns[indices[name]].scale for name in names(tree)
        }
        value = evaluate(tree, named)
        is_known = np.logical_and.reduce([np.isfinite(one) for one in named.values()])
        undefined |= is_known & np.isnan(value)
        outcomes[k] = value / columns[k].scale
    failed = undefined & (status >= Status.OK) & (status <= Status.NEVER_RELEASED)
    status[failed] = Status.UNDEFINED_FORMULA
    outcomes[: len(result_columns(contents)) - 1, failed] = np.nan
