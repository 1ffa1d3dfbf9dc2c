"""Line of the table of `sepmc verify` (a value of the engine beside its reference, with the allowed
difference), and the table itself."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from sepmc.text_table import text_table

# relative tolerance of comparisons with closed forms and other formulations
CLOSE = 1e-10
_TEXT = (33, 36)  # maximum widths of case and quantity


@dataclass(frozen=True)
class Line:
    """One comparison of `sepmc verify`.

    Attributes
    ----------
    case, quantity : str
        Labels: what was simulated; what is compared, with its unit.
    reference, measured : float
        Expected value, and the value of the engine.
    tolerance : float
        Allowed absolute difference.
    at_least : bool
        The reference is a lower bound: larger values pass, and smaller ones within the tolerance.
    """

    case: str
    quantity: str
    reference: float
    measured: float
    tolerance: float
    at_least: bool = False

    @property
    def passes(self) -> bool:
        """True if the measured value differs from the reference by at most the tolerance (with
        ``at_least``: if it is not further below it); False for NaN."""
        difference = self.measured - self.reference
        return bool(
            difference >= -self.tolerance if self.at_least else abs(difference) <= self.tolerance
        )


def worst(
    case: str,
    quantity: str,
    reference: ArrayLike,
    measured: ArrayLike,
    relative: float = CLOSE,
    size: float = 0.0,
) -> Line:
    """Line of `sepmc verify` on the element that differs most between two arrays; NaN counts as the
    largest difference.

    Parameters
    ----------
    case, quantity : str
        Labels of the line.
    reference, measured : array_like
        Expected and measured values; broadcast to one shape.
    relative : float
        Tolerance, relative to the largest magnitude of the reference, or to ``size`` if that is
        larger.
    size : float
        Scale, in the unit of the quantity, for a reference that is or may be zero.
    """
    expected, values = np.broadcast_arrays(
        np.asarray(reference, float), np.asarray(measured, float)
    )
    difference = np.abs(values - expected)
    at = np.unravel_index(
        np.argmax(np.where(np.isnan(difference), np.inf, difference)), difference.shape
    )
    tolerance = relative * max(float(np.max(np.abs(expected))), size)
    return Line(case, quantity, float(expected[at]), float(values[at]), tolerance)


def table(lines: Sequence[Line]) -> str:
    """Table of all lines as plain text at most 140 columns wide, ended by the number of lines and
    of failures."""
    rows = [("case", "quantity", "reference", "measured", "difference", "allowed", "")]
    for x in lines:
        numbers = (
            f"{x.reference:.8g}",
            f"{x.measured:.8g}",
            f"{x.measured - x.reference:.1e}",
            f"{x.tolerance:.1e}",
        )
        rows.append(
            (x.case[: _TEXT[0]], x.quantity[: _TEXT[1]], *numbers, "pass" if x.passes else "FAIL")
        )
    text = text_table(rows, left=(0, 1, 6))
    failed = sum(not x.passes for x in lines)
    return "\n".join(
        [*text, "", f"{len(lines)} lines, " + (f"{failed} FAILED" if failed else "all pass")]
    )


def brief(groups: Mapping[str, Sequence[Line]]) -> str:
    """Table with one row for each check, as plain text: its number of lines, and of these the one
    nearest to its tolerance, or furthest beyond it. The last line has the number of lines and of
    failures. ``groups`` has the lines of each check, at least one, by its name."""
    text = [
        f"{'check':22s}{'lines':>6s}   "
        f"{'nearest to the allowed difference':60s}{'difference':>11s}{'allowed':>10s}"
    ]
    for name, lines in groups.items():
        # any larger value is fine for a lower bound
        differences = [
            max(0.0, x.reference - x.measured) if x.at_least else abs(x.measured - x.reference)
            for x in lines
        ]
        fractions = [
            np.inf
            if np.isnan(d)
            else d / x.tolerance
            if x.tolerance > 0.0
            else np.inf * d
            if d
            else 0.0
            for d, x in zip(differences, lines, strict=True)
        ]
        at = int(np.argmax(fractions))
        verdict = "pass" if all(x.passes for x in lines) else "FAIL"
        nearest = f"{lines[at].case}: {lines[at].quantity}"
        text.append(
            f"{name:22s}{len(lines):6d}   {nearest:60.58s}{differences[at]:11.1e}"
            f"{lines[at].tolerance:10.1e}  {verdict}"
        )
    count, failed = (
        sum(map(len, groups.values())),
        sum(not x.passes for lines in groups.values() for x in lines),
    )
    return "\n".join(
        [*text, "", f"{count} lines, " + (f"{failed} FAILED" if failed else "all pass")]
    )
