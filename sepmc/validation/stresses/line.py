"""Line of the table of `sepmc stress` (a hard input, the error of a quantity, its bound, and
whether an error was reported), and the table itself."""

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
_WIDTHS = (34, 21, 27, 17)  # maximum widths of input, quantity, reason and flag
ACCURATE, FLAGGED, SILENT = "accurate", "flagged", "SILENT"


@dataclass(frozen=True)
class Bound:
    """Largest allowed error of a line, and the reason for it as text."""

    value: float
    reason: str


# Bound of comparisons with closed forms.
FORM = Bound(CLOSE, "of every closed form")
REQUESTED = Bound(1e-9, "the requested accuracy")
EXACT = Bound(0.0, "must be exact")
NONE = Bound(0.0, "no answer: must be flagged")


def conditioned(condition: float) -> Bound:
    """Bound of round-off in a linear problem with a condition number: 100 eps (for the sums behind
    it) times that number; at least 1e-10, that of `FORM`, and at most 1e-3."""
    value = min(100.0 * EPS * condition, 1e-3)
    return Bound(value, f"100 eps x {condition:.0e} (condition)") if value > FORM.value else FORM


def promised(steps: float) -> Bound:
    """Bound of the error that a case with status ok may have after a number of ``steps``: 1e-6 for
    each step, the audit bound of ``attitude_drift``."""
    return Bound(AUDIT_BOUNDS["attitude_drift"] * steps, f"1e-6 x {steps:.0f} steps (audit)")


@dataclass(frozen=True)
class Stress:
    """One line of `sepmc stress`: the error of a quantity for a hard input.

    Attributes
    ----------
    input, quantity : str
        Labels: the hard input; what is compared, with its unit, if any.
    error : float
        Error against a reference or an invariant; NaN if there is none.
    bound : Bound
        Largest error of an accurate line.
    status : str
        Status label of the case, or "refused" if the scene cannot be read.
    beyond : tuple of str
        Names of the audit columns beyond their bounds.
    resolved : bool
        The input is reasonable and must be accurate: a flag is a fault too.
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
        """Verdict of the line: "flagged" if the status is not ok or an audit column is beyond its
        bound; else "accurate" if the error is within the bound; else "SILENT", as for a NaN
        error."""
        if self.status != Status.OK.label or self.beyond:
            return FLAGGED
        return ACCURATE if self.error <= self.bound.value else SILENT

    @property
    def passes(self) -> bool:
        """True if the verdict is accurate, or if it is flagged and the line need not be accurate
        (``resolved`` is False)."""
        return self.verdict == ACCURATE or (self.verdict == FLAGGED and not self.resolved)


def beyond(outcomes: Mapping[str, float]) -> tuple[str, ...]:
    """Names of the audit columns whose value in ``outcomes``, by column name, exceeds the bound of
    `AUDIT_BOUNDS` or is NaN. Columns that ``outcomes`` lacks are not among them."""
    return tuple(
        name
        for name, bound in AUDIT_BOUNDS.items()
        if name in outcomes and not outcomes[name] <= bound
    )


def judge(
    label: str,
    quantity: str,
    error: float,
    bound: Bound,
    run: NominalRun,
    resolved: bool = False,
) -> Stress:
    """Line of `sepmc stress` on the error of a quantity of a nominal run, with the status of the
    run and its audit columns beyond their bounds.

    ``label`` names the hard input. With ``resolved`` the line passes only if it is accurate, else
    also if it is flagged. ``quantity``, ``error`` and ``bound`` are as in `Stress`.
    """
    return Stress(label, quantity, float(error), bound, run.status, beyond(run.outcomes), resolved)


def relative(values: ArrayLike, expected: ArrayLike, size: float = 0.0) -> float:
    """Largest difference between two arrays, relative to the largest magnitude of ``expected``, or
    to ``size`` if that is larger; NaN if a value is NaN, or if ``values`` is empty. If both sizes
    are 0, it is NaN or infinite."""
    measured, references = np.asarray(values, float), np.asarray(expected, float)
    if not measured.size:
        return math.nan
    return float(
        np.max(np.abs(measured - references)) / max(float(np.max(np.abs(references))), size)
    )


def _flag(line: Stress) -> str:
    """Text of the column "flag": the status if it is not ok; else the first audit column beyond its
    bound and the number of others, such as "energy_residual +1"; else "ok"."""
    if line.status != Status.OK.label:
        return line.status
    return (
        line.beyond[0] + (f" +{len(line.beyond) - 1}" if len(line.beyond) > 1 else "")
        if line.beyond
        else line.status
    )


def counts(lines: Sequence[Stress]) -> tuple[int, int]:
    """Return the number of lines with the verdict "accurate", then that with "flagged"
    (`Stress.verdict`)."""
    verdicts = [line.verdict for line in lines]
    return verdicts.count(ACCURATE), verdicts.count(FLAGGED)


def table(lines: Sequence[Stress]) -> str:
    """Table of all lines as plain text at most 140 columns wide, ended by `_summary`."""
    rows = [("input", "quantity", "reason of bound", "flag", "error", "bound", "verdict")]
    for x in lines:
        text = (x.input, x.quantity, x.bound.reason, _flag(x))
        error = "-" if math.isnan(x.error) else f"{min(x.error, 9e99):.1e}"
        cells = [cell[:width] for cell, width in zip(text, _WIDTHS, strict=True)]
        verdict = x.verdict + ("" if x.passes else " !")
        rows.append(
            (cells[0], cells[1], cells[2], cells[3], error, f"{x.bound.value:.1e}", verdict)
        )
    order = (0, 1, 4, 5, 2, 3, 6)
    out = text_table([[row[i] for i in order] for row in rows], left=(0, 1, 4, 5, 6))
    return "\n".join([*out, "", _summary(lines)])


def _summary(lines: Sequence[Stress]) -> str:
    """Text with the number of lines, of lines by verdict ("accurate", "flagged", "SILENT"), and of
    those that do not pass (`Stress.passes`)."""
    verdicts = [line.verdict for line in lines]
    by_verdict = ", ".join(f"{verdicts.count(v)} {v}" for v in (ACCURATE, FLAGGED, SILENT))
    return f"{len(lines)} lines: {by_verdict}; {sum(not line.passes for line in lines)} fail"


def brief(groups: Mapping[str, Sequence[Stress]]) -> str:
    """Table with one row for each stress, as plain text: its number of lines by verdict, error and
    bound of its accurate line nearest to the bound, and the statuses and audit columns that flag
    its flagged lines. It is ended by `_summary`. ``groups`` has the lines of each stress by its
    name."""
    text = [
        f"{'stress':22s}{'lines':>6s}{ACCURATE:>10s}{FLAGGED:>9s}{SILENT:>8s}"
        f"{'error':>10s}{'bound':>10s}   flags"
    ]
    for name, lines in groups.items():
        accurate, flagged = counts(lines)
        near = max(
            (x for x in lines if x.verdict == ACCURATE),
            key=lambda x: x.error / max(x.bound.value, 1e-300),
            default=None,
        )
        numbers = f"{near.error:10.1e}{near.bound.value:10.1e}" if near else f"{'-':>10s}{'-':>10s}"
        flags = dict.fromkeys(
            word
            for x in lines
            if x.verdict == FLAGGED
            for word in ([x.status] if x.status != "ok" else x.beyond)
        )
        silent = len(lines) - accurate - flagged
        row = f"{name:22s}{len(lines):6d}{accurate:10d}{flagged:9d}{silent:8d}{numbers}   "
        text.append(f"{row}{', '.join(flags) or '-'}"[:140].rstrip())
    text.append("\n" + _summary([line for lines in groups.values() for line in lines]))
    return "\n".join(text)
