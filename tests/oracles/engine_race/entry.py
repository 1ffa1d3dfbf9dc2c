"""Result of an engine with a setting, and its error."""

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np


@dataclass(frozen=True)
class Entry:
    """Engine with a setting.

    Attributes
    ----------
    engine, setting : str
    cases, threads : int
        Number of cases, and of threads, or of processes if ``note`` says so.
    compile_s : float
        Separate from the times below.
    seconds_per_case : float
        Wall time, all threads together, median of ``repeats``, with ``spread``
        (`sepmc.bench.clock.spread`).
    outcomes : dict of ndarray, shape (cases,)
        By outcome column, of the first ``cases`` cases.
    extrapolated : bool
        Too few cases to fill the threads: run on one, time divided by ``threads``.
    """

    engine: str
    setting: str
    cases: int
    threads: int
    compile_s: float
    seconds_per_case: float
    repeats: int
    outcomes: dict[str, np.ndarray]
    extrapolated: bool
    note: str
    spread: float = np.nan


def worst(
    outcomes: Mapping[str, np.ndarray],
    reference: Mapping[str, np.ndarray],
    sigma: Mapping[str, float],
) -> tuple[float, str]:
    """Largest error of some outcomes, and its outcome: |difference| / max(|reference|, sigma), over
    the cases and outcomes.

    Parameters
    ----------
    outcomes, reference : mapping of ndarray
        By outcome column; the reference has as many cases or more, and selects the outcomes.
    sigma : mapping of float
        Standard deviation of each outcome over the campaign.
    """
    worst = (0.0, "")
    for name, values in outcomes.items():
        right = np.asarray(reference[name])[: len(values)]
        off = np.abs(values - right) / np.maximum(np.maximum(np.abs(right), sigma[name]), 1e-300)
        error = float(np.inf if np.isnan(off).any() else off.max())
        if error > worst[0]:
            worst = (error, name)
    return worst


def error(entry: Entry, reference: Mapping[str, np.ndarray], sigma: Mapping[str, float]) -> float:
    """Largest error of an entry; see `worst`."""
    return worst(entry.outcomes, reference, sigma)[0]
