"""Map of designs: the verdict on each requirement at every point of a grid of one or two design
variables."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any

import msgspec
import numpy as np
import pandas as pd

from sepmc.analysis.proportions import CONFIDENCE, binomial_interval, raised
from sepmc.analysis.requirements import FAIL, NOT_SHOWN, PASS, lacking_decides
from sepmc.campaign.judging import judged_requirements, raised_confidence
from sepmc.scene.design_tables import MapAxis, parse_axis
from sepmc.scene.messages import InputError, Log
from sepmc.scene.model import Requirement


@dataclass
class DesignMap:
    """Verdicts on a grid of designs.

    Attributes
    ----------
    axes : tuple of MapAxis
        One or two.
    table : DataFrame
        A row per design, the first axis varying fastest: the columns of `DesignTable.summary`, the
        number of ``cases``, and of each requirement the confidence interval of the probability of a
        violation, ``NAME_low`` and ``NAME_high`` (Clopper and Pearson, two-sided, with the
        confidence `interval_confidence`). Cases that did not finish or lack the outcome count as
        violations in ``NAME_high`` only.
    looks : tuple of int
        Planned numbers of cases of a design, rising: every design is run with the first number,
        and with each further one while the verdict on a requirement is neither pass nor fail.
    seed : int
    timing : dict of str to float
        Elapsed seconds by stage, as `DesignTable.timing`, over all looks.
    """

    axes: tuple[MapAxis, ...]
    table: pd.DataFrame
    looks: tuple[int, ...]
    seed: int
    timing: dict[str, float]

    @property
    def cases_text(self) -> str:
        """Text on the number of cases of a design: "1,000 cases each", or, if a design had more
        than the first look, that of this look and the largest, "1,000 to 8,000 cases each"."""
        first, last = (int(n) for n in (self.table["cases"].min(), self.table["cases"].max()))
        return f"{first:,} cases each" if first == last else f"{first:,} to {last:,} cases each"

    def confidence(self, requirement: Requirement) -> float:
        """Return the confidence of each verdict on a requirement of the campaign, raised for the
        number of looks."""
        return raised(requirement.confidence, len(self.looks))

    @property
    def interval_confidence(self) -> float:
        """Confidence of the intervals in the table: 95 %, raised for the number of looks."""
        return raised(CONFIDENCE, len(self.looks))

    def open_by_lacking(self, requirement: Requirement) -> np.ndarray:
        """Return the mask (n designs,) of designs that are open for a requirement because of
        unknown cases, which did not finish or lack its outcome: counted as known violations, these
        would refute it."""
        name, confidence = requirement.name, self.confidence(requirement)
        item = msgspec.structs.replace(requirement, confidence=confidence)
        counts = self.table[[f"{name}_violations", f"{name}_missing", "cases"]].to_numpy(dtype=int)
        is_open = ~self.table[name].isin((PASS, FAIL)).to_numpy()
        decided = [lacking_decides(k, missing, n, item) for k, missing, n in counts.tolist()]
        return is_open & np.array(decided, dtype=bool)

    def grid(self, column: str) -> np.ndarray:
        """Return a column of the table as an array over the grid, shape (count of y, count of x);
        (1, count of x) with one axis."""
        return self.table[column].to_numpy().reshape(-1, self.axes[0].count)


def map_designs(
    campaign: Any,
    axes: Sequence[MapAxis],
    cases: int | None = None,
    seed: int | None = None,
    threads: int | None = None,
    progress: Callable[[int, int], None] | None = None,
    announce: Log | None = None,
    max_cases: int | None = None,
) -> DesignMap:
    """Judge the requirements of a campaign at every point of a grid.

    A design at which a requirement is neither shown nor refuted is run again with twice as many
    cases, repeatedly up to ``max_cases``. Each of these looks has the cases of the one before and
    more. Its confidence is raised for the number of looks.

    Parameters
    ----------
    campaign : Campaign
    axes : sequence of MapAxis
        One or two.
    cases, seed : int, optional
        Cases in the first look at every design, and their seed, one for all designs; those of the
        file if None.
    threads, announce
        As for `Campaign.session`.
    progress : callable (done, total), optional
        Called with the number of cases run so far, and of all; the total grows with each look.
    max_cases : int, optional
        Maximum number of cases of a design; ``cases`` if None.

    Returns
    -------
    DesignMap

    Raises
    ------
    InputError
        If the campaign has no requirement, its cases are not random, both axes vary the same key,
        ``max_cases`` is smaller than ``cases``, or the designs cannot share a kernel.
    """
    requirements = judged_requirements(campaign)
    if len({axis.key for axis in axes}) < len(axes):
        raise InputError(f"{axes[0].key}: is varied by both axes; give the second another variable")
    cases = campaign.scene.run.cases if cases is None else cases
    looks = look_sizes(cases, max_cases)
    if len(looks) > 1:
        campaign = campaign.with_settings(raised_confidence(campaign, len(looks)))
    session = campaign.session({a.key: (a.low, a.high) for a in axes}, threads, announce)
    columns = np.meshgrid(*(axis.values for axis in axes))
    designs = np.column_stack([column.ravel() for column in columns])
    done = 0
    if progress:
        progress(0, len(designs) * cases)

    def run(which: np.ndarray, count: int) -> tuple[pd.DataFrame, dict[str, float]]:
        nonlocal done
        start = done

        def report(designs_done: int, total: int) -> None:
            if progress:
                progress(start + designs_done * count, start + total * count)

        result = session.run_many(designs[which], count, seed, progress=report)
        done += len(which) * count
        result.summary.insert(designs.shape[1], "cases", count)
        return result.summary.set_index(which), result.timing

    names = [item.name for item in requirements]
    table, timing = run(np.arange(len(designs)), cases)
    for count in looks[1:]:
        is_open = (table[names] == NOT_SHOWN).any(axis=1)
        if not is_open.any():
            break
        more, more_timing = run(np.flatnonzero(is_open), count)
        table = pd.concat([table[~is_open], more]).sort_index()
        timing = {key: timing[key] + more_timing[key] for key in timing}
    confidence = raised(CONFIDENCE, len(looks))
    for name in names:
        counts = table[[f"{name}_violations", f"{name}_missing", "cases"]].to_numpy()
        table[[f"{name}_low", f"{name}_high"]] = [
            (
                binomial_interval(k - missing, n, confidence)[0],
                binomial_interval(k, n, confidence)[1],
            )
            for k, missing, n in counts
        ]
    return DesignMap(tuple(axes), table, looks, campaign.checked_seed(seed), timing)


def look_sizes(cases: int, max_cases: int | None) -> tuple[int, ...]:
    """Return the total number of cases of a design at each look: ``cases``, then twice the number
    before, the last one ``max_cases``. Only ``cases`` is returned if ``max_cases`` is None. Raises
    InputError if ``max_cases`` is smaller than ``cases``."""
    if max_cases is None:
        return (cases,)
    if max_cases < cases:
        raise InputError(f"max_cases = {max_cases}: must be at least cases = {cases}")
    looks = [cases]
    while looks[-1] < max_cases:
        looks.append(min(2 * looks[-1], max_cases))
    return tuple(looks)


__all__ = ["DesignMap", "MapAxis", "map_designs", "parse_axis"]
