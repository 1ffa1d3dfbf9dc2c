"""Small SVG figures, 120 x 22 pixels, for cells of tables in a notebook; written without a plotting
library."""

from collections.abc import Sequence

import numpy as np

from sepmc.analysis.statistics import Histogram

_WIDTH, _HEIGHT = 120, 22  # pixels
_MAX_BARS = 30
_BAR, _BOUND, _MARK = "#a9cdea", "#009E73", "#D55E00"


def histogram_svg(histogram: Histogram | None, bounds: Sequence[float] = ()) -> str:
    """Return a histogram as SVG, with vertical lines at the required bounds within its range.

    Adjacent bins are added together so that there are at most 30 bars.

    Parameters
    ----------
    histogram : Histogram or None
    bounds : sequence of float
        Required bounds, in the unit of the histogram.

    Returns
    -------
    str
        SVG element; empty if there is no histogram or it has no bins.
    """
    if histogram is None or not histogram.edges.size:
        return ""
    edges, counts = histogram.edges, histogram.counts
    each = -(-len(counts) // _MAX_BARS)
    starts = np.arange(0, len(counts), each)
    bars = np.add.reduceat(counts, starts)
    low, high = float(edges[0]), float(edges[-1])
    places = _WIDTH * (np.append(edges[starts], high) - low) / (high - low)
    tops = _HEIGHT * (1.0 - bars / bars.max())
    steps = "".join(f"V{top:.1f}H{end:.1f}" for top, end in zip(tops, places[1:], strict=True))
    lines = [
        _line((bound - low) / (high - low), _BOUND) for bound in bounds if low <= bound <= high
    ]
    return _svg(f'<path fill="{_BAR}" d="M0 {_HEIGHT}{steps}V{_HEIGHT}Z"/>{"".join(lines)}')


def position_svg(value: float, low: float, high: float) -> str:
    """Return the SVG of a bar that stands for the range ``low`` to ``high``, with a vertical line
    at ``value`` (at an end if it is outside); an empty string unless ``low`` < ``high``."""
    if not low < high:
        return ""
    share = min(1.0, max(0.0, (value - low) / (high - low)))
    bar = f'<rect width="{_WIDTH}" height="8" y="7" fill="{_BAR}"/>'
    return _svg(bar + _line(share, _MARK))


def _line(share: float, colour: str) -> str:
    """Return the SVG path of a vertical line at the fraction ``share`` of the width, 0 (left) to 1
    (right), with the stroke ``colour``."""
    x = 1.0 + (_WIDTH - 2.0) * share
    return f'<path stroke="{colour}" stroke-width="2" d="M{x:.1f} 0V{_HEIGHT}"/>'


def _svg(content: str) -> str:
    """Return the SVG image that contains the elements ``content``."""
    return f'<svg width="{_WIDTH}" height="{_HEIGHT}" role="img">{content}</svg>'
