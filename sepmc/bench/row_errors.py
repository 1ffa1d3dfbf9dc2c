"""The column ``error`` of every case beside its true error."""

import numpy as np
import pandas as pd

from sepmc.bench.reference import Reference
from sepmc.bench.study import Study
from sepmc.campaign.execution.accuracy import decisive, errors

_QUANTILES = (0.01, 0.5, 0.99)


def measure(study: Study, reference: Reference) -> tuple[pd.DataFrame, dict[str, float]]:
    """Every case's ``error`` and ``true_error``, the largest of the outcomes that decide, with the
    ``outcome`` that has it; and what is to be known of them, in a few numbers."""
    block, names = study.default.fly(study.draws), np.array(study.names)
    both = np.flatnonzero(block.has_outcomes & reference.sound[: len(block.status)])
    decides, scale = decisive(study.campaign.outcome_columns), study.flight.scale
    assert scale is not None
    assert block.refinement is not None
    found = errors(
        block.outcomes[both][:, : len(names)][:, decides],
        reference.outcomes[both][:, decides],
        scale[decides],
    )
    true, told = found.max(axis=1, initial=0.0), block.error[both]
    frame = pd.DataFrame(
        {
            "case": both,
            "error": told,
            "true_error": true,
            "outcome": names[decides][found.argmax(axis=1)],
        }
    )
    share = true / told
    low, middle, high = np.quantile(share, _QUANTILES) if len(share) else (np.nan,) * 3
    return frame, {
        "cases": len(frame),
        "flown_again": block.refinement.n_refined,
        "by_another_kernel": block.refinement.n_fallback,
        "largest_error": float(told.max(initial=0.0)),
        "largest_true_error": float(true.max(initial=0.0)),
        "true_over_told_1_percent": float(low),
        "true_over_told_median": float(middle),
        "true_over_told_99_percent": float(high),
        "true_over_told_most": float(share.max(initial=0.0)),
    }


def sentence(told: dict[str, float]) -> str:
    """The same in words."""
    return (
        f"column error: true errors are {told['true_over_told_median']:.2g} of it in the median "
        f"case, {told['true_over_told_1_percent']:.2g} to {told['true_over_told_99_percent']:.2g} "
        f"in 98 % and at most {told['true_over_told_most']:.2g}; the largest is "
        f"{told['largest_error']:.1e}, truly {told['largest_true_error']:.1e}; "
        f"{told['flown_again']} of {told['cases']} cases were flown again"
    )
