"""One line of `sepmc verify`: a number of the engine beside the number it should be, and whether it
is near enough."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from sepmc.text_table import text_table

# relative; what every comparison with a closed form or another formulation is held to
CLOSE = 1e-10
_TEXT = (33, 36)  # widest case and quantity that are shown whole


@dataclass(frozen=True)
class Line:
    """What was compared: a case, a quantity with its unit, the reference, the engine's value, and
    the difference allowed between them.

    ``at_least``: the reference is a lower bound, and a larger value no fault.
    """

    case: str
    quantity: str
    reference: float
    measured: float
    tolerance: float
    at_least: bool = False

    @property
    def passes(self) -> bool:
        """Whether the difference is within the tolerance. NaN is not."""
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
    """The line of that element of two arrays that differs most; the tolerance is relative to the
    largest reference, or to ``size``."""
    expected, found = np.broadcast_arrays(np.asarray(reference, float), np.asarray(measured, float))
    difference = np.abs(found - expected)
    at = np.unravel_index(
        np.argmax(np.where(np.isnan(difference), np.inf, difference)), difference.shape
    )
    tolerance = relative * max(float(np.max(np.abs(expected))), size)
    return Line(case, quantity, float(expected[at]), float(found[at]), tolerance)


def table(lines: Sequence[Line]) -> str:
    """The lines as plain text of at most 140 columns, with a count below."""
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
    """A row for each check: how many lines, and the one that comes nearest to its tolerance or is
    furthest beyond it."""
    text = [
        f"{'check':22s}{'lines':>6s}   "
        f"{'nearest to what is allowed':60s}{'difference':>11s}{'allowed':>10s}"
    ]
    for name, lines in groups.items():
        # of a lower bound any larger value is fine
        off = [
            max(0.0, x.reference - x.measured) if x.at_least else abs(x.measured - x.reference)
            for x in lines
        ]
        share = [
            np.inf
            if np.isnan(d)
            else d / x.tolerance
            if x.tolerance > 0.0
            else np.inf * d
            if d
            else 0.0
            for d, x in zip(off, lines, strict=True)
        ]
        at = int(np.argmax(share))
        verdict = "pass" if all(x.passes for x in lines) else "FAIL"
        told = f"{lines[at].case}: {lines[at].quantity}"
        text.append(
            f"{name:22s}{len(lines):6d}   {told:60.58s}{off[at]:11.1e}{lines[at].tolerance:10.1e} "
            f" {verdict}"
        )
    count, failed = (
        sum(map(len, groups.values())),
        sum(not x.passes for lines in groups.values() for x in lines),
    )
    return "\n".join(
        [*text, "", f"{count} lines, " + (f"{failed} FAILED" if failed else "all pass")]
    )
