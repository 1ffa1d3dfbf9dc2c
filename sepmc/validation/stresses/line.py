"""One line of `sepmc stress`: a hard input, the error of a quantity, the bound set beforehand, and
whether an error was told."""

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from sepmc.schema import AUDIT_BOUNDS, Status
from sepmc.text_table import text_table
from sepmc.validation.flights import NominalRun
from sepmc.validation.line import CLOSE

EPS = float(np.finfo(float).eps)
_WIDTHS = (34, 21, 27, 17)  # widest input, quantity, reason and flag that are shown whole
ACCURATE, FLAGGED, SILENT = "accurate", "flagged", "SILENT"


@dataclass(frozen=True)
class Bound:
    """The largest error allowed, and why just that."""

    value: float
    reason: str


# What every comparison of the engine with a closed form is held to.
FORM = Bound(CLOSE, "of every closed form")
ASKED = Bound(1e-9, "the accuracy asked")
EXACT = Bound(0.0, "must be exact")
NONE = Bound(0.0, "no answer: must be told")


def conditioned(condition: float) -> Bound:
    """What round-off becomes in a problem of this condition number: 100 eps, for the sums behind
    it, times that; at most 1e-3."""
    value = min(100.0 * EPS * condition, 1e-3)
    return Bound(value, f"100 eps x {condition:.0e} (condition)") if value > FORM.value else FORM


def promised(steps: float) -> Bound:
    """What status ok promises: 1e-6 a step (schema: attitude_drift)."""
    return Bound(AUDIT_BOUNDS["attitude_drift"] * steps, f"1e-6 x {steps:.0f} steps (audit)")


@dataclass(frozen=True)
class Stress:
    """What was done, and the error it gave.

    input, quantity : what was done, and what was looked at, with its unit where it has one
    error, bound : against a reference or an invariant; NaN if there is no number
    status : label of the case's status, or "refused" if the scene cannot be read
    beyond : audit columns beyond their bounds
    resolved : a fair input, which must come out accurate: a flag is then a fault too
    """

    input: str
    quantity: str
    error: float
    bound: Bound
    status: str
    beyond: tuple[str, ...] = ()
    resolved: bool = False

    @property
    def verdict(self) -> str:
        """Flagged if status or audit says that something is wrong; else accurate within the bound;
        else an error nobody is told of."""
        if self.status != Status.OK.label or self.beyond:
            return FLAGGED
        return ACCURATE if self.error <= self.bound.value else SILENT

    @property
    def holds(self) -> bool:
        """Whether this is as it should be: never silent, and accurate where that is asked."""
        return self.verdict == ACCURATE or (self.verdict == FLAGGED and not self.resolved)


def beyond(outcomes: Mapping[str, float]) -> tuple[str, ...]:
    """Audit columns of a case that are beyond their bounds."""
    return tuple(
        name
        for name, bound in AUDIT_BOUNDS.items()
        if name in outcomes and not outcomes[name] <= bound
    )


def judge(
    given: str,
    quantity: str,
    error: float,
    bound: Bound,
    flown: NominalRun,
    resolved: bool = False,
) -> Stress:
    """The line of a flight."""
    return Stress(
        given, quantity, float(error), bound, flown.status, beyond(flown.outcomes), resolved
    )


def relative(found: ArrayLike, expected: ArrayLike, size: float = 0.0) -> float:
    """Largest difference of two arrays over the largest value expected, or over ``size`` if that is
    larger; NaN if there is one, or if a flight has no rows."""
    ours, should = np.asarray(found, float), np.asarray(expected, float)
    if not ours.size:
        return math.nan
    return float(np.max(np.abs(ours - should)) / max(float(np.max(np.abs(should))), size))


def _told(line: Stress) -> str:
    """Status, and how many audit columns are beyond their bounds."""
    if line.status != Status.OK.label:
        return line.status
    return (
        line.beyond[0] + (f" +{len(line.beyond) - 1}" if len(line.beyond) > 1 else "")
        if line.beyond
        else line.status
    )


def counts(lines: Sequence[Stress]) -> tuple[int, int]:
    """Number of accurate and of flagged lines."""
    verdicts = [line.verdict for line in lines]
    return verdicts.count(ACCURATE), verdicts.count(FLAGGED)


def table(lines: Sequence[Stress]) -> str:
    """The lines as plain text of at most 140 columns, with a count below."""
    rows = [("input", "quantity", "why this bound", "told", "error", "bound", "verdict")]
    for x in lines:
        text = (x.input, x.quantity, x.bound.reason, _told(x))
        error = "-" if math.isnan(x.error) else f"{min(x.error, 9e99):.1e}"
        cells = [cell[:width] for cell, width in zip(text, _WIDTHS, strict=True)]
        verdict = x.verdict + ("" if x.holds else " !")
        rows.append(
            (cells[0], cells[1], cells[2], cells[3], error, f"{x.bound.value:.1e}", verdict)
        )
    order = (0, 1, 4, 5, 2, 3, 6)
    out = text_table([[row[i] for i in order] for row in rows], left=(0, 1, 4, 5, 6))
    count = {
        verdict: sum(x.verdict == verdict for x in lines) for verdict in (ACCURATE, FLAGGED, SILENT)
    }
    faults = sum(not x.holds for x in lines)
    counted = (
        f"{len(lines)} lines: "
        + ", ".join(f"{n} {v}" for v, n in count.items())
        + f"; {faults} not as they should be"
    )
    return "\n".join([*out, "", counted])


def brief(groups: Mapping[str, Sequence[Stress]]) -> str:
    """A row for each stress: its lines by verdict, the accurate one nearest to its bound, and what
    told of the flagged ones."""
    text = [
        f"{'stress':22s}{'lines':>6s}{ACCURATE:>10s}{FLAGGED:>9s}{SILENT:>8s}"
        f"{'error':>10s}{'bound':>10s}   told by"
    ]
    for name, lines in groups.items():
        counts = [
            sum(x.verdict == verdict for x in lines) for verdict in (ACCURATE, FLAGGED, SILENT)
        ]
        near = max(
            (x for x in lines if x.verdict == ACCURATE),
            key=lambda x: x.error / max(x.bound.value, 1e-300),
            default=None,
        )
        numbers = f"{near.error:10.1e}{near.bound.value:10.1e}" if near else f"{'-':>10s}{'-':>10s}"
        told = dict.fromkeys(
            word
            for x in lines
            if x.verdict == FLAGGED
            for word in ([x.status] if x.status != "ok" else x.beyond)
        )
        text.append(
            f"{name:22s}{len(lines):6d}{counts[0]:10d}{counts[1]:9d}{counts[2]:8d}{numbers}   "
            f"{', '.join(told) or '-'}"[:140].rstrip()
        )
    every = [x for lines in groups.values() for x in lines]
    total = [sum(x.verdict == verdict for x in every) for verdict in (ACCURATE, FLAGGED, SILENT)]
    wrong = sum(not x.holds for x in every)
    text.append(
        f"\n{len(every)} lines: {total[0]} accurate, {total[1]} flagged, {total[2]} SILENT; "
        f"{wrong} not as they should be"
    )
    return "\n".join(text)
