"""Statistics and audits as text tables for a terminal."""

from collections.abc import Mapping, Sequence
from itertools import groupby
from textwrap import fill

import numpy as np
import pandas as pd

from sepmc.analysis import constant_outcomes
from sepmc.analysis.proportions import CONFIDENCE, binomial_interval, upper_bound
from sepmc.analysis.statistics import OK, PERCENTILES, REFERENCED
from sepmc.schema import is_yes_or_no
from sepmc.text_table import text_table
from sepmc.wording import count_cases

WIDTH = 118  # default width of tables, in characters
# 1 / 0.00135: with fewer values the 0.135 % and 99.865 % points lie between the two extreme values
_TAIL_CASES = 741


def render_audit(table: pd.DataFrame, width: int = WIDTH) -> str:
    """Render an audit as text.

    Parameters
    ----------
    table : DataFrame
        From `sepmc.analysis.statistics.audit`.
    width : int
        Largest number of characters in a line; lines ``AUDIT FAILED`` may be longer.

    Returns
    -------
    str
        A line ``AUDIT FAILED`` for each column with cases beyond its bound; if there are none, one
        sentence with the worst value of each column that has a bound, and another if roll and
        pitch may have jumped. A line that says so if there is no ok case.
    """
    if not len(table) or table["case"].max() < 0:
        return "audit: no ok case to audit"
    failed = table[table["beyond"] > 0]
    if len(failed):
        lines = [
            f"AUDIT FAILED: {row['beyond']:.0f} cases have {name} > {row['bound']:g} (worst "
            f"{row['worst']:.2g}, case {row['case']:.0f})"
            for name, row in failed.iterrows()
        ]
        return "\n".join(lines)
    bounded = table[table["bound"].notna()]
    worst = ", ".join(f"{name} {row['worst']:.1e}" for name, row in bounded.iterrows())
    text = fill(f"audit passed; worst of all ok cases: {worst}", width)
    if "attitude_singular" in table.index and table["worst"]["attitude_singular"] > 0.0:
        case = table["case"]["attitude_singular"]
        text += "\n" + fill(
            f"roll and pitch of some cases may have jumped (case {case:.0f}): see the column "
            "attitude_singular",
            width,
        )
    return text


def rounded(value: float, scale: float, digits: int = 3) -> str:
    """Format a number with as many decimals as show a related scale to some significant digits.

    Parameters
    ----------
    value : float
    scale : float
        Size that determines the decimals, such as the sigma of the outcome whose mean is formatted;
        if it is not positive and finite, the value itself to one more digit.
    digits : int
        Significant digits to which the scale would be shown.

    Returns
    -------
    str
        In exponential notation above 1e8 or with more than seven decimals; "-" for NaN.
    """
    if pd.isna(value):
        return "-"
    if not (np.isfinite(scale) and scale > 0.0):  # scale by the value itself
        scale, digits = abs(value), digits + 1
    if not (np.isfinite(scale) and scale > 0.0):
        return f"{value:zg}"
    decimals = max(0, digits - 1 - int(np.floor(np.log10(scale))))
    plain = decimals <= 7 and abs(value) < 1e8
    return f"{value:z.{decimals}f}" if plain else f"{value:z.{digits}e}"


def render_summary(
    stats: pd.DataFrame,
    counts: Mapping[str, int],
    units: Mapping[str, str] | None = None,
    source: str = "paper",
    width: int = WIDTH,
) -> str:
    """Render statistics as text: case counts, yes-or-no and constant outcomes, the table of all
    others, and the comparison with a reference.

    Parameters
    ----------
    stats : DataFrame
        From `statistics`; with ``ref_*`` columns a comparison with the reference follows. Yes-or-no
        and constant outcomes (`sepmc.analysis.constant_outcomes`) have a line each before the
        table.
    counts : mapping of status to number of cases
        From `status_counts`.
    units : mapping of outcome to unit, optional
        Adds a column of units.
    source : str
        Name of the reference in column heads.
    width : int
        Largest number of characters in a line; further columns go to a block below.

    Returns
    -------
    str
        Numbers have the decimals that show sigma to three digits, standard errors to two.
    """
    parts = [render_counts(counts, width)]
    for lines in (render_proportions(stats), constant_outcomes.render_constants(stats, units)):
        parts += ["\n".join(f"  {line}" for line in lines)] if lines else []
    stats = stats[~_are_proportions(stats)]
    varied = stats[~stats["constant"].to_numpy(dtype=bool)] if "constant" in stats else stats
    if len(varied):
        parts.append(_layout(list(varied.index), column_groups(varied, units), width))
    parts += [fill(note, width) for note in (tail_note(stats),) if note]
    comparison = render_comparison(stats, source, width)
    return "\n\n".join(parts + ([comparison] if comparison else [])) + "\n"


def tail_note(stats: pd.DataFrame) -> str:
    """Return a sentence, which names no outcome, that the extreme percentiles of fewer than 741
    values lie between the two extreme values; empty if all outcomes that vary have at least 741, or
    none. ``stats`` is a table of `statistics`; only with the column ``constant`` does it say which
    do not vary."""
    varied = stats[~stats["constant"].to_numpy(dtype=bool)] if "constant" in stats else stats
    if not varied["n"].between(1, _TAIL_CASES - 1).any():
        return ""
    return (
        f"With fewer than {_TAIL_CASES} values: the 0.135 % and 99.865 % points lie between "
        "the two extreme values."
    )


def render_comparison(stats: pd.DataFrame, source: str = "paper", width: int = WIDTH) -> str:
    """Render the comparison of a table of `statistics` with its reference values as text; empty if
    it has none. Arguments as for `render_summary`."""
    stats = constant_outcomes.with_constant_values(stats)
    compared = (
        stats[stats[[f"ref_{name}" for name in REFERENCED]].notna().any(axis=1)]
        if "ref_mean" in stats
        else stats[:0]
    )
    if not len(compared):
        return ""
    source_name = source if source[:1].isupper() else f"the {source}"  # "Table 3", "the paper"
    head = (
        f"Compared with {source_name} (dev: this run minus {source_name}; mean, max and min in "
        "its sigmas, sigma in percent)"
    )
    comparisons = [
        (name, _comparison(compared, name, source)) for name in ("mean", "sigma", "max", "min")
    ]
    return fill(head, width) + "\n\n" + _layout(list(compared.index), comparisons, width)


def render_counts(counts: Mapping[str, int], width: int) -> str:
    """Render the number of all cases, of ok cases, and of the others by status, folded to lines of
    ``width`` characters; ``counts`` is from `status_counts`."""
    total, ok = sum(counts.values()), counts.get(OK, 0)
    others = ", ".join(f"{status} {count}" for status, count in counts.items() if status != OK)
    left_out = f"; left out: {others}" if others else ""
    return fill(f"{count_cases(total)}, {ok} ok{left_out}", width)


def _are_proportions(stats: pd.DataFrame) -> np.ndarray:
    """Return the mask (n_outcomes,) of the rows of a table of `statistics` that are yes-or-no
    outcomes, by their names."""
    return stats.index.map(is_yes_or_no).to_numpy(dtype=bool)


def render_proportions(stats: pd.DataFrame) -> list[str]:
    """Render each yes-or-no outcome of a table of `statistics` as a line: number of cases in which
    it occurs, and 95 % interval of its probability (one-sided if it occurs in none)."""
    lines, table = [], stats[_are_proportions(stats)]
    for name, n, mean in zip(table.index, table["n"], table["mean"], strict=True):
        k = round(n * mean) if n else 0
        low, high = binomial_interval(k, int(n)) if n else (0.0, 1.0)
        is_none = n and not k
        interval = f"< {upper_bound(0, int(n)):.1e}" if is_none else f"{low:.2g} to {high:.2g}"
        sides = "one" if is_none else "two"
        lines.append(
            f"{name}: {k} of {n} ok cases; probability {interval} "
            f"({100.0 * CONFIDENCE:g} %, {sides}-sided)"
        )
    return lines


def column_groups(
    stats: pd.DataFrame, units: Mapping[str, str] | None
) -> list[tuple[str, dict[str, list[str]]]]:
    """Return the columns of the main table of outcomes as groups to be kept together.

    Each group is (heading, {column: its cells as text, one per outcome}); some headings are empty.
    A constant outcome has ``constant`` in place of its sigma.
    ``stats`` is a table of `statistics`; ``units``, if given, adds a column of units.
    """
    stats = constant_outcomes.with_constant_values(stats)

    def column(name: str) -> list[str]:
        return [
            rounded(value, sigma) for value, sigma in zip(stats[name], stats["sigma"], strict=True)
        ]

    def error(name: str) -> list[str]:
        return [rounded(value, value, 2) for value in stats[name]]

    def case(name: str) -> list[str]:
        return ["-" if pd.isna(value) else str(int(value)) for value in stats[name]]

    is_constant = stats["constant"] if "constant" in stats else np.zeros(len(stats), dtype=bool)
    sigma = np.where(is_constant, "constant", column("sigma")).tolist()
    first = {"unit": [units.get(name, "") for name in stats.index]} if units else {}
    percent = {f"{value:g} %": column(name) for name, value in PERCENTILES.items()}
    # two groups, so that wide tables can be folded between them
    lower, upper = list(percent.items())[:4], list(percent.items())[4:]
    return [
        ("", first | {"n": [str(n) for n in stats["n"]]}),
        ("", {"mean": column("mean"), "s.e.": error("mean_se")}),
        ("", {"sigma": sigma, "s.e.": error("sigma_se")}),
        ("", {"min": column("min"), "case": case("case_min")}),
        ("", {"max": column("max"), "case": case("case_max")}),
        ("percentiles", dict(lower)),
        ("percentiles", dict(upper)),
    ]


def _comparison(stats: pd.DataFrame, name: str, source: str) -> dict[str, list[str]]:
    """Return the columns of the comparison of one statistic, ``mean``, ``sigma``, ``min`` or
    ``max``: reference (headed by its name ``source``), value of this run and deviation from the
    reference (in its sigmas; of sigma in percent), as texts, one per outcome. The reference keeps
    up to six digits."""
    reference = ["-" if np.isnan(value) else f"{value:.6g}" for value in stats[f"ref_{name}"]]
    values = [
        rounded(value, sigma) for value, sigma in zip(stats[name], stats["sigma"], strict=True)
    ]
    unit = (100.0, ".1f", "%") if name == "sigma" else (1.0, ".2f", "")
    deviation = [
        "-" if np.isnan(dev) else f"{dev * unit[0]:+z{unit[1]}}{unit[2]}"
        for dev in stats[f"dev_{name}"]
    ]
    return {source: reference, "here": values, "dev": deviation}


def aligned(rows: Sequence[Sequence[str]], width: int = WIDTH) -> list[str]:
    """Return lines of text with the cells of ``rows`` in aligned columns: the first left, the
    others right. Columns beyond ``width`` characters go to a block below, after the first one."""
    widths = [max(len(row[k]) for row in rows) for k in range(len(rows[0]))]
    blocks, used = [[0]], widths[0]
    for k in range(1, len(widths)):
        if used + 2 + widths[k] > width and len(blocks[-1]) > 1:
            blocks, used = [*blocks, [0]], widths[0]
        blocks[-1].append(k)
        used += 2 + widths[k]
    lines: list[str] = []
    for block in blocks:
        lines += [""] if lines else []
        lines += text_table([[row[k] for k in block] for row in rows])
    return lines


_MIN_GROUP = 3  # outcomes with the same first word that form a group


def _gaps(names: list[str]) -> set[int]:
    """Return the indices of the names before which a blank line separates groups; at least three
    outcomes in a row with the same first word, a body or joint, form a group."""
    words = [name.split("_")[0] for name in names]
    runs = [len(list(run)) for _, run in groupby(words)]
    starts = np.cumsum([0, *runs])
    large = [run >= _MIN_GROUP for run in runs]
    return {int(starts[k]) for k in range(1, len(runs)) if large[k] or large[k - 1]}


def _layout(names: list[str], groups: list[tuple[str, dict[str, list[str]]]], width: int) -> str:
    """Return a text table of outcomes ``names`` with groups of columns (see `column_groups`) side
    by side under their headings; groups beyond ``width`` characters go to a block below."""
    longest = max(len(name) for name in [*names, "outcome"])
    stub = [text.ljust(longest) for text in ["", "outcome", *names]]
    blocks, used = [[stub]], longest
    for heading, columns in groups:
        padded = [
            [cell.rjust(max(map(len, [head, *cells]))) for cell in [head, *cells]]
            for head, cells in columns.items()
        ]
        lines = ["  ".join(row) for row in zip(*padded, strict=True)]
        lines = [heading.center(len(lines[0]), "-") if heading else " " * len(lines[0]), *lines]
        if used + 3 + len(lines[0]) > width and len(blocks[-1]) > 1:
            blocks, used = [*blocks, [stub]], longest
        blocks[-1].append(lines)
        used += 3 + len(lines[0])
    gaps, texts = _gaps(names), []
    for block in blocks:
        first, head, *rows = ["   ".join(row).rstrip() for row in zip(*block, strict=True)]
        body = [line for k, row in enumerate(rows) for line in ([""] if k in gaps else []) + [row]]
        texts.append("\n".join([*([first] if first else []), head, *body]))
    return "\n\n".join(texts)
