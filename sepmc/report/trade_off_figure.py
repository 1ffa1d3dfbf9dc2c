"""Figure of a trade-off between costs: designs of the front, of which none is better than another
one in every cost, and all designs that the search tried."""

from pathlib import Path

from sepmc.campaign.trade_off import TradeOff
from sepmc.report.style import BLACK, BLUE, VERMILION, make_axes, save, set_title

_SEARCHED = (("not accepted", "#dddddd"), ("accepted by the search", "#9ecae1"))


def trade_off_figure(result: TradeOff, about: str, path: Path) -> Path:
    """Draw the first cost over each of the other costs, a point per design, in a panel each.

    Parameters
    ----------
    result : TradeOff
    about : str
        The campaign, for the title.
    path : Path
        File to write, in a folder that exists; the suffix selects the format.

    Returns
    -------
    Path
        ``path``.
    """
    count = len(result.minimise)
    figure, panels = make_axes(1, count - 1, (6.4, 4.8))
    accepted = result.searched["margin"] >= 0.0
    for k, ax in enumerate(panels, start=2):
        for (name, colour), mask in zip(_SEARCHED, (~accepted, accepted), strict=True):
            rows = result.searched[mask]
            ax.plot(rows[f"cost_{k}"], rows["cost_1"], ".", color=colour, label=name)
        front = result.table
        if count == 2:
            ax.plot(front[f"cost_{k}"], front["cost_1"], color=BLACK, linewidth=0.8)
        for name, colour, mask in (
            ("front, shown on other cases", BLUE, front["shown"]),
            ("front, not shown", VERMILION, ~front["shown"]),
        ):
            rows = front[mask]
            if len(rows):
                ax.plot(rows[f"cost_{k}"], rows["cost_1"], "o", color=colour, label=name)
        ax.set_xlabel(result.minimise[k - 1])
        ax.set_ylabel(result.minimise[0])
    set_title(figure, f"{about}, designs of which none is better in every cost")
    return save(figure, path)
