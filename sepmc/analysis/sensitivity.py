"""Sensitivity of an outcome to its inputs, from the rows of a campaign.

Rank correlation (Spearman 1904) and partial rank correlation, with the other inputs fixed (Saltelli
et al., Global Sensitivity Analysis, Wiley 2008, 1.2.3), give the direction and strength of
monotonic effects. The first-order index, the fraction of the outcome's variance that an input
explains alone, covers other effects too. The outcome's means over the cases with the lowest and the
highest tenth of an input are the ends of its bar in a tornado chart; for an input of few values,
such as a failure that occurs or not, they are those over its lowest and its highest value. A
Saltelli campaign also gives total indices, which include interactions.
"""

from collections.abc import Mapping, Sequence
from textwrap import fill

import numpy as np
import pandas as pd

from sepmc.analysis.dependence import dependence
from sepmc.analysis.statistics import TWO_SIDED, column, ok_rows
from sepmc.analysis.statistics_text import WIDTH, aligned, rounded
from sepmc.analysis.variance_indices import (
    BY_GROUPS,
    BY_ROWS,
    ESTIMATORS,
    PATTERNED,
    PLAN,
    few_cases_warning,
    grouped_index,
    independent_rows,
    ordered_index,
    saltelli_groups,
    saltelli_indices,
)
from sepmc.scene.model import SALTELLI

_MIN_CASES = 20  # fewer cases give no result
_TENTH = 0.1  # fraction of the cases at either end of an input
_MIN_PER_VALUE = 20  # mean cases per value of an input from which its values are groups
# sum of first-order indices that needs no note
_MIN_EXPLAINED = 0.7
_MAX_NAMED = 4  # correlated inputs named in a note
COLUMNS = (
    "rank", "rank_low", "rank_high", "partial", "mean_low", "mean_high", "shift", "first",
    "first_low", "first_high", "total", "total_low", "total_high",
)  # fmt: skip
_INTERVAL_COLUMNS = ["first_low", "first_high", "total_low", "total_high"]


def input_sensitivities(
    cases: Mapping[str, np.ndarray],
    inputs: Sequence[str],
    outcome: str,
    sampler: str = "random",
    indices: bool = True,
    correlated: Sequence[Sequence[str]] = (),
    spread: float = 0.0,
) -> pd.DataFrame:
    """Compute the sensitivity of an outcome to each input.

    Parameters
    ----------
    cases : mapping of name to column, shape (n_cases,)
        ``status``, the inputs and the outcome; rows that are not ``ok`` or have no outcome are left
        out.
    inputs : sequence of str
        Columns of the dispersed inputs.
    outcome : str
        Column of the outcome.
    sampler : str
        A key of `sepmc.analysis.variance_indices.ESTIMATORS`; ``saltelli`` gives total indices.
    indices : bool
        True to compute variance indices, which take longest; else they are NaN.
    correlated : sequence of sequences of str
        Groups of inputs known to be correlated.
    spread : float
        Largest difference that numerical error can explain, in the outcome's unit
        (`sepmc.analysis.constant_outcomes.max_spread`); 0 for an outcome that is not constant.

    Returns
    -------
    DataFrame, a row per input that varies, by falling ``first_low`` (0 where negative or NaN), then
    by falling ``shift``, then by falling absolute ``rank``
        ``rank`` correlation with a 95 % interval ``rank_low``, ``rank_high`` (Bonett and Wright,
        Psychometrika 65, 2000); ``partial`` rank correlation; ``mean_low`` and ``mean_high``, the
        outcome's means over the cases with the lowest and highest tenth of the input (or its lowest
        and highest of few values), in its unit; ``shift``, the lower end of the two-sided 95 %
        interval of the absolute difference of these means, at least 0 (Welch, Biometrika 34, 1947).
        With ``saltelli``, all these are computed from the independent cases of the design.
        ``first``-order index with a 95 % interval ``first_low``, ``first_high``
        (`sepmc.analysis.variance_indices`), NaN if no estimator is valid for the sampler; ``total``
        index with ``total_low``, ``total_high``, NaN unless the sampler is ``saltelli``. Intervals
        are NaN where outliers determine the variance.
        ``attrs``: ``mean`` of the outcome; ``cases``, the numbers of cases with the outcome and of
        ok cases; ``correlated`` inputs; ``note``, a limitation of the indices or an empty string.

    Raises
    ------
    ValueError
        If fewer than 20 cases have the outcome, it does not vary by more than ``spread``, or no
        input varies.
    """
    y = column(cases, outcome)
    has_outcome = ok_rows(cases) & np.isfinite(y)
    if np.count_nonzero(has_outcome) < _MIN_CASES:
        raise ValueError(f"{outcome}: fewer than {_MIN_CASES} cases are ok and have this outcome")
    x = np.array([column(cases, name) for name in inputs]).reshape(len(inputs), len(y))
    varied = [i for i, row in enumerate(x[:, has_outcome]) if row.min() < row.max()]
    value_range = float(np.ptp(y[has_outcome]))
    if 0.0 < value_range <= spread:
        raise ValueError(
            f"{outcome}: is constant, as its values differ by {value_range:.1g}, at most twice "
            f"their numerical error of {0.5 * spread:.1g}; so no effect of an input can be seen"
        )
    if not varied or value_range == 0.0:
        raise ValueError(f"{outcome}: does not vary from case to case, or no input does")
    names = [inputs[i] for i in varied]
    table = pd.DataFrame(np.nan, index=pd.Index(names, name="input"), columns=list(COLUMNS))
    varied_inputs, outcomes = x[varied][:, has_outcome], y[has_outcome]
    if sampler == SALTELLI:
        independent = independent_rows(cases, len(inputs), sampler)
        rows = has_outcome & independent
        varied_inputs, outcomes = x[varied][:, rows], y[rows]
        if not len(outcomes) or outcomes.min() == outcomes.max():
            raise ValueError(
                f"{outcome}: is missing or the same in all independent cases of the design"
            )
    _by_rank(table, varied_inputs, outcomes)
    # inputs with so few values that cases of a value form a group
    has_few_values = np.array(
        [len(np.unique(row)) * _MIN_PER_VALUE <= len(row) for row in varied_inputs]
    )
    end_means = [
        _end_means(row, outcomes, few)
        for row, few in zip(varied_inputs, has_few_values, strict=True)
    ]
    table[["mean_low", "mean_high", "shift"]] = end_means
    pairs, too_even = dependence(varied_inputs)
    estimator = ESTIMATORS[sampler]
    note = estimator.note
    if indices and estimator.first == BY_GROUPS:
        numbers = np.asarray(cases["case"]) if "case" in cases else np.arange(len(y))
        note = _by_saltelli(table, numbers, x, varied, np.where(has_outcome, y, np.nan))
    elif indices and estimator.first == BY_ROWS and too_even:
        note = PATTERNED.format(what="run.samples" if sampler == PLAN else "the sample of cases")
    elif indices and estimator.first == BY_ROWS:
        _by_rows(table, varied_inputs, outcomes, has_few_values)
    if table["first"].notna().any() and (
        warning := few_cases_warning(varied_inputs[has_few_values], outcomes)
    ):
        table[_INTERVAL_COLUMNS] = np.nan
        note = warning
    table.attrs["note"] = note if indices else ""
    paired = {names[k] for pair in pairs for k in pair} if sampler != SALTELLI else set()
    correlated_inputs = paired | {name for group in correlated for name in group}
    table.attrs["correlated"] = [name for name in names if name in correlated_inputs]
    table.attrs["mean"] = float(outcomes.mean())
    table.attrs["cases"] = int(np.count_nonzero(has_outcome)), int(np.count_nonzero(ok_rows(cases)))
    # sort by the lower bound: a large index of few cases may be chance
    lower_bound = table["first_low"].clip(lower=0.0).fillna(0.0)
    return table.iloc[np.lexsort((-table["rank"].abs(), -table["shift"], -lower_bound))]


def leading_inputs(table: pd.DataFrame, count: int) -> pd.DataFrame:
    """Select the leading inputs of an outcome.

    Parameters
    ----------
    table : DataFrame
        From `input_sensitivities`.
    count : int
        Largest number of inputs.

    Returns
    -------
    DataFrame
        At most ``count`` rows in their order: the first three quarters are the first rows of the
        table; the last quarter, at least one, are those of the others with the largest ``shift``,
        as a rare failure may shift the mean and explain little of the variance.
    """
    n_by_index = count - max(1, count // 4)
    others = table.iloc[n_by_index:]["shift"].sort_values(ascending=False, kind="stable").index
    return table[table.index.isin([*table.index[:n_by_index], *others[: count - n_by_index]])]


def order_description(table: pd.DataFrame, count: int) -> str:
    """Return in words the rule by which `leading_inputs` selects and orders the inputs, as ``by
    first-order index (lower bound), then by shift of the mean``; arguments are as there."""
    has_intervals = table["first_low"].notna().any()
    rule = f"by {'first-order index' if has_intervals else 'shift of the mean'} (lower bound)"
    return rule + ("" if len(table) <= count else ", then by shift of the mean")


def _by_rank(table: pd.DataFrame, x: np.ndarray, y: np.ndarray) -> None:
    """Set the columns ``rank``, ``rank_low``, ``rank_high`` (rank correlation and the ends of its
    95 % interval) and ``partial`` (partial rank correlation; it stays NaN if inputs determine each
    other) of ``table``, a row for each of d inputs, from the inputs ``x`` (d, n) and the outcome
    ``y`` (n,)."""
    correlation = np.corrcoef(_ranks(np.vstack([x, y])))
    rank = correlation[-1, :-1]
    half_width = TWO_SIDED * np.sqrt((1.0 + 0.5 * rank**2) / (len(y) - 3.0))
    transformed = np.arctanh(np.clip(rank, -1.0 + 1e-15, 1.0 - 1e-15))
    table["rank"], table["rank_low"] = rank, np.tanh(transformed - half_width)
    table["rank_high"] = np.tanh(transformed + half_width)
    if np.linalg.cond(correlation[:-1, :-1]) < 1e10:
        # regularise: an outcome that the inputs explain completely makes the matrix singular
        precision = np.linalg.inv(correlation + 1e-12 * np.eye(len(correlation)))
        scale = np.sqrt(np.diag(precision))
        table["partial"] = -precision[-1, :-1] / (scale[-1] * scale[:-1])


def _ranks(x: np.ndarray) -> np.ndarray:
    """Return the ranks (d, n), from 1, of the values in each row of ``x`` (d, n); equal values have
    the mean of their ranks."""
    order = np.argsort(x)
    ranks = np.empty(x.shape)
    np.put_along_axis(ranks, order, np.arange(1.0, x.shape[1] + 1.0)[None], axis=1)
    tied = (np.diff(np.take_along_axis(x, order, axis=1)) == 0.0).any(axis=1)
    if tied.any():  # as scipy.stats.rankdata, which takes 1 s to import; 5 times as long as above
        ranks[tied] = pd.DataFrame(x[tied].T).rank().to_numpy().T
    return ranks


def _end_means(x: np.ndarray, y: np.ndarray, few: bool) -> tuple[float, float, float]:
    """Return the mean of the outcome ``y`` (n,) over the lowest tenth of the input ``x`` (n,), that
    over the highest tenth, and the lower end of the two-sided 95 % interval of their absolute
    difference, at least 0.

    For an input of ``few`` values its lowest and highest value take the place of the tenths, and
    the variance at an end is at least that of all cases. It uses Student's t with the
    degrees of freedom of the smaller end, and is 0 if that has one case.
    """
    from scipy.special import ndtr, stdtrit  # noqa: PLC0415  (0.1 s)

    low, high = (x.min(), x.max()) if few else np.quantile(x, (_TENTH, 1.0 - _TENTH))
    ends = y[x <= low], y[x >= high]
    low_mean, high_mean, n_min = float(ends[0].mean()), float(ends[1].mean()), min(map(len, ends))
    if n_min == 1:
        return low_mean, high_mean, 0.0
    # few cases can be equal by chance
    min_variance = y.var(ddof=1) if few else 0.0
    error = np.sqrt(sum(max(end.var(ddof=1), min_variance) / len(end) for end in ends))
    half_width = stdtrit(n_min - 1, ndtr(TWO_SIDED)) * error
    return low_mean, high_mean, max(abs(high_mean - low_mean) - float(half_width), 0.0)


def _by_rows(table: pd.DataFrame, x: np.ndarray, y: np.ndarray, has_few_values: np.ndarray) -> None:
    """Set the first-order indices and their intervals in ``table``, from inputs ``x`` (d, n) and
    the outcome ``y`` (n,) of independent cases. ``has_few_values`` (d,) is True for inputs with so
    few values that the cases of a value form a group."""
    estimators = [grouped_index if few else ordered_index for few in has_few_values]
    indices = np.array([estimate(row, y) for estimate, row in zip(estimators, x, strict=True)])
    _set_index(table, "first", *indices.T)


def _by_saltelli(
    table: pd.DataFrame, numbers: np.ndarray, x: np.ndarray, varied: list[int], y: np.ndarray
) -> str:
    """Set first-order and total indices, with intervals, in ``table`` from the complete groups of a
    Saltelli design.

    ``numbers`` (n,) are case numbers, ``x`` (d, n) all inputs, ``varied`` the indices of those with
    a row in the table, and ``y`` (n,) the outcome, NaN where absent. Return a note on the number of
    groups left out, or on the reason why no indices are set; an empty string without a note.
    """
    try:
        groups = saltelli_groups(numbers, x, y)
    except ValueError as error:
        return f"first-order and total indices are not given: {error}"
    first, total = saltelli_indices(groups)
    _set_index(table, "first", *first[:, varied])
    _set_index(table, "total", *total[:, varied])
    n_left_out = groups.left_out
    note = f"indices are of complete groups of cases only: {n_left_out} groups are left out"
    return note if n_left_out else ""


def _set_index(table: pd.DataFrame, name: str, index: np.ndarray, half_width: np.ndarray) -> None:
    """Set the columns ``name``, ``name``_low and ``name``_high of ``table`` from an ``index`` and
    the ``half_width`` of its interval, each (d,), a value per row."""
    table[name] = index
    table[f"{name}_low"], table[f"{name}_high"] = index - half_width, index + half_width


def render_sensitivities(
    table: pd.DataFrame, outcome: str, keys: Mapping[str, str], count: int = 8, width: int = WIDTH
) -> str:
    """Render the sensitivity of an outcome as a text table of its leading inputs, with notes.

    Parameters
    ----------
    table : DataFrame
        From `input_sensitivities`.
    outcome : str
        Name of the outcome, for the head.
    keys : mapping of input column to TOML path
    count : int
        Largest number of inputs, see `leading_inputs`.
    width : int
        Largest number of characters in a line.

    Returns
    -------
    str
    """
    head = ["input", "first-order", "total", "rank", "partial", "mean, lowest to highest tenth"]
    scale = float(np.nanmax(np.abs(table["mean_high"] - table["mean_low"])))
    rows = [
        [
            keys.get(str(name), str(name)),
            _format_index(row, "first"),
            _format_index(row, "total"),
            f"{row['rank']:.2f}",
            f"{row['partial']:.2f}",
            f"{rounded(row['mean_low'], scale)} to {rounded(row['mean_high'], scale)}",
        ]
        for name, row in leading_inputs(table, count).iterrows()
    ]
    columns = [k for k in range(len(head)) if any(row[k] for row in rows)]
    lines = aligned([[row[k] for k in columns] for row in [head, *rows]], width - 2)
    n_hidden = len(table) - len(rows)
    n_with_outcome, ok = table.attrs["cases"]
    subset = f"; {n_with_outcome} of {ok} ok cases have it" if n_with_outcome < ok else ""
    return "\n".join(
        [
            f"sensitivity of {outcome}: {order_description(table, count)}{subset}",
            *(f"  {line}".rstrip() for line in lines),
        ]
        + ([f"  and {n_hidden} more inputs"] if n_hidden > 0 else [])
        + [
            fill(note, width, initial_indent="  ", subsequent_indent="  ")
            for note in index_notes(table, keys)
        ]
    )


def index_notes(table: pd.DataFrame, keys: Mapping[str, str]) -> list[str]:
    """Return the notes, a sentence each, on what limits the indices in a table of
    `input_sensitivities`; ``keys`` maps input columns to TOML paths."""
    lines = [table.attrs["note"]] if table.attrs["note"] else []
    if not table["first"].notna().any():
        return lines
    total = float(table["first"].clip(lower=0.0).sum())
    if correlated := table.attrs["correlated"]:
        names = [keys.get(name, name) for name in correlated]
        named = ", ".join(names[:_MAX_NAMED]) + (
            f" and {len(names) - _MAX_NAMED} more" if len(names) > _MAX_NAMED else ""
        )
        lines.append(
            f"{named} are correlated: the first-order index of each includes the effect of the "
            f"others, so indices do not add up to 1 (here to {total:.2f})"
        )
    elif total < _MIN_EXPLAINED and table["total"].isna().all():
        lines.append(
            f"first-order indices add up to {total:.2f}: the rest is due to "
            "interactions or chance; run.sampler saltelli gives total indices"
        )
    return lines


def _format_index(row: pd.Series, name: str) -> str:
    """Format the index ``name`` of a row as ``index +- half-width`` of its interval, with three
    decimals; only the index if the half-width is NaN; an empty string if the index is NaN. The
    half-width is the column ``NAME_high``, the upper end, minus the index."""
    if np.isnan(row[name]):
        return ""
    half_width = row[f"{name}_high"] - row[name]
    return f"{row[name]:.3f}" + ("" if np.isnan(half_width) else f" +- {half_width:.3f}")
