"""Which inputs drive an outcome, from the rows of a campaign.

Rank correlation (Spearman 1904) and partial rank correlation, in which the other inputs are held
fixed (Saltelli et al., Global Sensitivity Analysis, Wiley 2008, 1.2.3), tell direction and strength
of what rises or falls all along; the first-order index, the share of the outcome's variance that an
input explains by itself, also what does not. Between the lowest and the highest tenth of an input
the outcome's mean swings from one end of its tornado bar to the other; of an input of few values,
as a failure mode is, between the lowest and the highest. A Saltelli campaign also gives total
indices: with all that an input does together with others.
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

_FEWEST = 20  # cases from which anything is told
_TENTH = 0.1  # of the cases, at either end of an input
_MANY = 20  # cases of each value of an input, on average, from which its values are groups
# from it on first-order indices say what drives an outcome
_EXPLAINED = 0.7
_NAMED = 4  # inputs that vary together, by name
COLUMNS = (
    "rank", "rank_low", "rank_high", "partial", "mean_low", "mean_high", "shift", "first",
    "first_low", "first_high", "total", "total_low", "total_high",
)  # fmt: skip
_ENDS = ["first_low", "first_high", "total_low", "total_high"]


def input_sensitivities(
    cases: Mapping[str, np.ndarray],
    inputs: Sequence[str],
    outcome: str,
    sampler: str = "random",
    indices: bool = True,
    correlated: Sequence[Sequence[str]] = (),
    within: float = 0.0,
) -> pd.DataFrame:
    """How much each input drives an outcome.

    Parameters
    ----------
    cases : mapping of name to column, shape (n_cases,)
        ``status``, the inputs and the outcome; rows that are not ``ok`` or do not have the outcome
        are left out.
    inputs : names of the dispersed inputs
    outcome : name of a column
    sampler : how the cases were drawn, a key of `sepmc.analysis.variance_indices.ESTIMATORS`; those
    of
        ``saltelli`` give total indices
    indices : whether to compute indices, which take longest
    correlated : inputs that are known to vary together, group by group
    within : how far values may be apart by numerical error, if it is known that none are further
        (`sepmc.analysis.constant_outcomes.max_spread`)

    Returns
    -------
    DataFrame, a row per input, what drives most first
        ``rank`` with a 95 % interval ``rank_low``, ``rank_high`` (Bonett and Wright, Psychometrika
        65, 2000); ``partial``; ``mean_low`` and ``mean_high``, the outcome's means over the tenths
        of the cases in which the input is lowest and highest (over its lowest and highest value, if
        these are few), in its unit, and ``shift``, how far these are apart at least, with 95 %
        (Welch, Biometrika 34, 1947); all of these of the independent cases of a Saltelli design
        alone; ``first`` with a 95 % interval (see `sepmc.analysis.variance_indices`), NaN if no
        estimator is valid for the cases; ``total`` with a 95 % interval, NaN unless the sampler is
        ``saltelli``; intervals are NaN where few cases decide the variance. ``attrs["mean"]`` is
        the outcome's mean, ``attrs["cases"]`` how many cases have it, and how many are ok;
        ``attrs["correlated"]`` inputs that vary together, ``attrs["said"]`` what limits the
        indices, a sentence or none.

    Raises
    ------
    ValueError
        If the outcome does not vary by more than its numerical error, or too few cases have it.
    """
    y = column(cases, outcome)
    there = ok_rows(cases) & np.isfinite(y)
    if np.count_nonzero(there) < _FEWEST:
        raise ValueError(f"{outcome}: fewer than {_FEWEST} cases have it")
    x = np.array([column(cases, name) for name in inputs]).reshape(len(inputs), len(y))
    varied = [i for i, row in enumerate(x[:, there]) if row.min() < row.max()]
    span = float(np.ptp(y[there]))
    if 0.0 < span <= within:
        raise ValueError(
            f"{outcome}: is constant, as its values differ by {span:.1g} and their numerical error "
            f"is {0.5 * within:.1g}; so nothing drives it"
        )
    if not varied or span == 0.0:
        raise ValueError(f"{outcome}: does not vary, or no input does")
    names = [inputs[i] for i in varied]
    table = pd.DataFrame(np.nan, index=pd.Index(names, name="input"), columns=list(COLUMNS))
    known, outcomes = x[varied][:, there], y[there]
    if sampler == SALTELLI:
        apart = independent_rows(cases, len(inputs), sampler)
        known, outcomes = x[varied][:, there & apart], y[there & apart]
        if not len(outcomes) or outcomes.min() == outcomes.max():
            raise ValueError(f"{outcome}: does not vary in cases that do not repeat each other")
    _by_rank(table, known, outcomes)
    # whether an input has so few values that cases with the same are groups
    few = np.array([len(np.unique(row)) * _MANY <= len(row) for row in known])
    tenths = [_tails(row, outcomes, of_few) for row, of_few in zip(known, few, strict=True)]
    table[["mean_low", "mean_high", "shift"]] = tenths
    pairs, even = dependence(known)
    valid = ESTIMATORS[sampler]
    said = valid.said
    if indices and valid.first == BY_GROUPS:
        numbers = np.asarray(cases["case"]) if "case" in cases else np.arange(len(y))
        said = _by_saltelli(table, numbers, x, varied, np.where(there, y, np.nan))
    elif indices and valid.first == BY_ROWS and even:
        said = PATTERNED.format(what="run.samples" if sampler == PLAN else "what the cases give")
    elif indices and valid.first == BY_ROWS:
        _by_rows(table, known, outcomes, few)
    if table["first"].notna().any() and (unsure := few_cases_warning(known[few], outcomes)):
        table[_ENDS] = np.nan
        said = unsure
    table.attrs["said"] = said if indices else ""
    of_pairs = {names[k] for pair in pairs for k in pair} if sampler != SALTELLI else set()
    together = of_pairs | {name for group in correlated for name in group}
    table.attrs["correlated"] = [name for name in names if name in together]
    table.attrs["mean"] = float(outcomes.mean())
    table.attrs["cases"] = int(np.count_nonzero(there)), int(np.count_nonzero(ok_rows(cases)))
    # a large index of few cases may be none
    sure = table["first_low"].clip(lower=0.0).fillna(0.0)
    return table.iloc[np.lexsort((-table["rank"].abs(), -table["shift"], -sure))]


def leading_inputs(table: pd.DataFrame, most: int) -> pd.DataFrame:
    """The ``most`` inputs of `input_sensitivities` that do most, in its order: the first of it, but
    a place in four for those of the others that surely shift the mean farthest, as a failure of few
    cases may that explains little of the variance."""
    kept = most - max(1, most // 4)
    others = table.iloc[kept:]["shift"].sort_values(ascending=False, kind="stable").index
    return table[table.index.isin([*table.index[:kept], *others[: most - kept]])]


def order_description(table: pd.DataFrame, most: int) -> str:
    """In what order `leading_inputs` has inputs."""
    given = table["first_low"].notna().any()
    first = "the surest first-order index first" if given else "what surely shifts its mean first"
    return first + ("" if len(table) <= most else ", then what else shifts its mean most")


def _by_rank(table: pd.DataFrame, x: np.ndarray, y: np.ndarray) -> None:
    """Rank correlations of inputs (d, n) with an outcome (n,)."""
    from scipy.stats import rankdata  # noqa: PLC0415  (1 s)

    ranks = np.array([rankdata(row) for row in (*x, y)])
    correlation = np.corrcoef(ranks)
    rank = correlation[-1, :-1]
    width = TWO_SIDED * np.sqrt((1.0 + 0.5 * rank**2) / (len(y) - 3.0))
    within = np.arctanh(np.clip(rank, -1.0 + 1e-15, 1.0 - 1e-15))
    table["rank"], table["rank_low"] = rank, np.tanh(within - width)
    table["rank_high"] = np.tanh(within + width)
    if np.linalg.cond(correlation[:-1, :-1]) < 1e10:
        # an outcome that follows from the inputs altogether leaves nothing unexplained
        precision = np.linalg.inv(correlation + 1e-12 * np.eye(len(correlation)))
        scale = np.sqrt(np.diag(precision))
        table["partial"] = -precision[-1, :-1] / (scale[-1] * scale[:-1])


def _tails(x: np.ndarray, y: np.ndarray, of_few: bool) -> tuple[float, float, float]:
    """Means of an outcome where an input, ``of_few`` values or many, is lowest, and highest, and
    how far they are apart at least: the near end of Student's interval with the freedoms of the
    fewer cases, no less than 0. Cases of one of few values vary as all do, at least."""
    from scipy.special import ndtr, stdtrit  # noqa: PLC0415  (0.1 s)

    low, high = (x.min(), x.max()) if of_few else np.quantile(x, (_TENTH, 1.0 - _TENTH))
    ends = y[x <= low], y[x >= high]
    first, last, fewer = float(ends[0].mean()), float(ends[1].mean()), min(map(len, ends))
    if fewer == 1:
        return first, last, 0.0
    # few cases can be alike by chance
    least = y.var(ddof=1) if of_few else 0.0
    spread = np.sqrt(sum(max(end.var(ddof=1), least) / len(end) for end in ends))
    reach = stdtrit(fewer - 1, ndtr(TWO_SIDED)) * spread
    return first, last, max(abs(last - first) - float(reach), 0.0)


def _by_rows(table: pd.DataFrame, x: np.ndarray, y: np.ndarray, few: np.ndarray) -> None:
    """First-order indices from independent cases, of inputs of ``few`` values (d,) or many."""
    estimators = [grouped_index if of_few else ordered_index for of_few in few]
    found = np.array([of(row, y) for of, row in zip(estimators, x, strict=True)])
    _put(table, "first", *found.T)


def _by_saltelli(
    table: pd.DataFrame, numbers: np.ndarray, x: np.ndarray, varied: list[int], y: np.ndarray
) -> str:
    """First-order and total indices from whole groups of a Saltelli design. Returns what is to be
    said of it."""
    try:
        groups = saltelli_groups(numbers, x, y)
    except ValueError as error:
        return f"first-order and total indices are not given: {error}"
    first, total = saltelli_indices(groups)
    _put(table, "first", *first[:, varied])
    _put(table, "total", *total[:, varied])
    left = groups.left_out
    return f"indices are of whole groups of cases: {left} groups are left out" if left else ""


def _put(table: pd.DataFrame, name: str, index: np.ndarray, half: np.ndarray) -> None:
    table[name], table[f"{name}_low"], table[f"{name}_high"] = index, index - half, index + half


def render_sensitivities(
    table: pd.DataFrame,
    outcome: str,
    keys: Mapping[str, str],
    most: int = 8,
    width: int = WIDTH,
) -> str:
    """What drives an outcome, as an engineer reads it in a terminal; inputs by their ``keys``."""
    head = ["input", "first-order", "total", "rank", "partial", "mean, lowest to highest tenth"]
    scale = float(np.nanmax(np.abs(table["mean_high"] - table["mean_low"])))
    rows = [
        [
            keys.get(str(name), str(name)),
            _with_half(row, "first"),
            _with_half(row, "total"),
            f"{row['rank']:.2f}",
            f"{row['partial']:.2f}",
            f"{rounded(row['mean_low'], scale)} to {rounded(row['mean_high'], scale)}",
        ]
        for name, row in leading_inputs(table, most).iterrows()
    ]
    kept = [k for k in range(len(head)) if any(row[k] for row in rows)]
    lines = aligned([[row[k] for k in kept] for row in [head, *rows]], width - 2)
    left = len(table) - len(rows)
    having, ok = table.attrs["cases"]
    some = f"; of the {having} of {ok} ok cases that have it" if having < ok else ""
    return "\n".join(
        [
            f"what drives {outcome}: {order_description(table, most)}{some}",
            *(f"  {line}".rstrip() for line in lines),
        ]
        + ([f"  and {left} more inputs"] if left > 0 else [])
        + [
            fill(each, width, initial_indent="  ", subsequent_indent="  ")
            for each in index_notes(table, keys)
        ]
    )


def index_notes(table: pd.DataFrame, keys: Mapping[str, str]) -> list[str]:
    """Sentences on what indices of `input_sensitivities` mean, or why there are none; inputs by
    ``keys``."""
    lines = [table.attrs["said"]] if table.attrs["said"] else []
    if not table["first"].notna().any():
        return lines
    together = float(table["first"].clip(lower=0.0).sum())
    if correlated := table.attrs["correlated"]:
        names = [keys.get(name, name) for name in correlated]
        named = ", ".join(names[:_NAMED]) + (
            f" and {len(names) - _NAMED} more" if len(names) > _NAMED else ""
        )
        lines.append(
            f"{named} vary together: the first-order index of each also holds what it tells of the "
            f"others, so indices do not add up (here to {together:.2f})"
        )
    elif together < _EXPLAINED and table["total"].isna().all():
        lines.append(
            f"first-order indices add up to {together:.2f}: what is left is due to inputs "
            "together, or to chance; run.sampler saltelli flies cases that tell total indices"
        )
    return lines


def _with_half(row: pd.Series, name: str) -> str:
    """An index and half its interval, if that is known; nothing if neither is."""
    if np.isnan(row[name]):
        return ""
    half = row[f"{name}_high"] - row[name]
    return f"{row[name]:.3f}" + ("" if np.isnan(half) else f" +- {half:.3f}")
