"""Requirements and verdicts as text for a terminal or a page."""

import math
from collections.abc import Callable, Mapping, Sequence
from textwrap import fill

from sepmc.analysis.requirements import FAIL, NONE, NOT_SHOWN, Verdict, has_two_bounds
from sepmc.analysis.statistics_text import WIDTH, rounded
from sepmc.scene.model import VIOLATION, Requirement

_NO_BREAK = "\N{NO-BREAK SPACE}"
ALL_CASES = "all cases"


def render_verdicts(
    verdicts: Sequence[Verdict],
    units: Mapping[str, str],
    width: int = WIDTH,
    population: str = ALL_CASES,
) -> str:
    """Render verdicts as text: the head ``requirements``, then a few lines for each.

    Parameters
    ----------
    verdicts : sequence of Verdict
    units : mapping of outcome to unit
    width : int
        Largest number of characters in a line.
    population : str
        Name of the cases that the verdicts refer to; not `ALL_CASES` if a filter selected them.

    Returns
    -------
    str
    """
    parts = (_render_verdict(v, units.get(v.metric, ""), width, population) for v in verdicts)
    return "\n".join(["requirements", *parts])


def render_cases_needed(verdicts: Sequence[Verdict]) -> str:
    """Return a sentence for verdicts on the cases that a filter selects: how many more of them,
    none violating, would show the requirements that are not shown. Empty if no verdict is
    ``not shown``."""
    pending = [v for v in verdicts if v.verdict == NOT_SHOWN]
    if not pending:
        return ""
    most = max(v.more for v in pending)
    subject = pending[0].name if len(pending) == 1 else f"{len(pending)} requirements"
    return (
        f"{subject} not shown: {most} more such cases are needed, none of them a violation; a "
        "campaign with the inputs of the filter fixed (--set) runs such cases only"
    )


def requirement_sentence(
    item: Requirement | Verdict, unit: str, population: str = ALL_CASES
) -> str:
    """Describe a requirement in one sentence.

    Parameters
    ----------
    item : Requirement or Verdict
    unit : str
        Unit of its outcome; none is written for ``1`` and an empty string.
    population : str
        Name of all cases that the fraction refers to, such as "all cases" (`ALL_CASES`).

    Returns
    -------
    str
        As ``NAME: METRIC >= BOUND UNIT in 99 % of POPULATION, with 90 % confidence``; share and
        confidence are always given. A requirement with two bounds has both, one without a bound
        ``does not occur``, and one on `VIOLATION` ``no other requirement is violated`` instead.
    """
    bound = " and ".join(
        f"{sign} {number:g}{_spaced(unit)}"
        for sign, number in ((">=", item.at_least), ("<=", item.at_most))
        if number is not None
    )
    text = f"{item.metric} {bound or 'does not occur'}"
    if item.metric == VIOLATION:
        text = "no other requirement is violated"
    return (
        f"{item.name}: {text} in {_percent(item.probability)} "
        f"of {population}, with {_percent(item.confidence)} confidence"
    )


def _render_verdict(v: Verdict, unit: str, width: int, population: str) -> str:
    """Render one verdict as indented lines, of at most ``width`` characters; other arguments as for
    `requirement_sentence`."""
    required, confidence = _percent(v.probability), _percent(v.confidence)
    lines = [
        requirement_sentence(v, unit, population),
        f"{v.violations} of {v.cases} cases violate it, "
        + (
            f"{v.allowed} are allowed"
            if v.allowed >= 0
            else "too few cases to show it even without one"
        ),
    ]
    if v.verdict == NONE:
        lines.insert(1, v.why)
    else:
        lines[-1] += f"; of {population} {_violating(v)} violate it ({confidence})"
    if v.missing:
        lines.append(render_missing(v))
    if v.verdict == NOT_SHOWN and population == ALL_CASES:
        lines.append(f"{v.more} more cases without a violation would show it")
    if v.worst is not None:
        others = " of the others" if v.missing else ""
        text = f"worst{others} {_number(v.worst)}{_spaced(unit)} (case {v.worst_case})"
        if v.design_value is not None and v.verdict != NONE:
            text += f"; {required} of {population} are {_designed(v, unit)}, with {confidence}"
        lines.append(text)
    head, indent = f"  {v.verdict.upper():10s}  ", " " * 14
    return "\n".join(
        fill(
            line.replace(" %", _NO_BREAK + "%"),
            width,
            initial_indent=indent if i else head,
            subsequent_indent=indent,
        ).replace(_NO_BREAK, " ")
        for i, line in enumerate(lines)
    )


def render_missing(v: Verdict) -> str:
    """Render how many of the violations of a verdict are unknown cases, the first of them, and why
    they are unknown, as ``2 cases lack the outcome, 1 did not finish (first: case 7); they count as
    violations``; empty if there are none."""
    if v.metric == VIOLATION:
        unknown = [(v.missing, "did not finish or {lack} an outcome")]
    elif v.at_least is v.at_most is None:
        unknown = [(v.missing, "ended in another way")]
    else:
        unknown = [(v.lacking, "{lack} the outcome"), (v.missing - v.lacking, "did not finish")]
    texts = [
        f"{count} {why.format(lack='lacks' if count == 1 else 'lack')}"
        for count, why in unknown
        if count
    ]
    if not texts:
        return ""
    number, _, why = texts[0].partition(" ")
    is_one = v.missing == 1
    first = f"({'' if is_one else 'first: '}case {v.first_missing})"
    ending = "it counts as a violation" if is_one else "they count as violations"
    reasons = ", ".join([f"{number} case{'s' * (number != '1')} {why}", *texts[1:]])
    return f"{reasons} {first}; {ending}"


def _designed(v: Verdict, unit: str) -> str:
    """Render the design value as a bound: of the outcome, such as ``>= 0.4 m/s``, or, for a
    requirement with two bounds, of its distance from the nearer one."""
    value = v.design_value or 0.0
    if has_two_bounds(v):
        size = f"{_number(abs(value))}{_spaced(unit)}"
        if value >= 0.0:
            return f"at least {size} within both bounds"
        return f"at most {size} beyond a bound"
    return f"{'>=' if v.at_least is not None else '<='} {_number(value)}{_spaced(unit)}"


def _violating(v: Verdict) -> str:
    """Format the one-sided bound of the violation probability that supports the verdict: the lower
    one (``> 0.02``) of a refuted requirement, else the upper one (``< 0.02``)."""
    return (
        f"> {format_proportion(v.share_at_least, math.floor)}"
        if v.verdict == FAIL
        else f"< {format_proportion(v.share_at_most, math.ceil)}"
    )


def _percent(fraction: float) -> str:
    """Format a fraction as percent, with up to six significant digits: 0.9973 is ``99.73 %``."""
    return f"{100.0 * fraction:g} %"


def _spaced(unit: str) -> str:
    """Return a unit with a leading space, empty for dimensionless."""
    return f" {unit}" if unit not in ("", "1") else ""


def format_proportion(value: float, rounding: Callable[[float], int] = round) -> str:
    """Format a proportion with two significant digits, as ``0.032``, or ``3.2e-05`` below 0.0095.

    Parameters
    ----------
    value : float
        0 to 1.
    rounding : callable
        ``math.floor`` or ``math.ceil`` to round down or up: a lower or upper bound stays a bound.

    Returns
    -------
    str
    """
    if 0.0 < value < 1.0:
        unit = 10.0 ** (math.floor(math.log10(value)) - 1)
        value = rounding(value / unit * (1.0 - 1e-12 * (rounding is math.ceil))) * unit
    return f"{value:.1e}" if 0.0 < value < 0.0095 else f"{value:.2g}"


def _number(value: float) -> str:
    """Format a number with at least four significant digits, as ``0.01235``, ``12.35`` or
    ``123456``; very large and very small ones with an exponent (`rounded`); "-" for NaN."""
    return rounded(value, abs(value), 4)
