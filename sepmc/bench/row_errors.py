"""Estimated error of every case (column ``error``) against its true error."""

import numpy as np
import pandas as pd

from sepmc.bench.reference import Reference
from sepmc.bench.study import Study
from sepmc.campaign.execution.accuracy import decisive, errors

_QUANTILES = (0.01, 0.5, 0.99)


def measure(study: Study, reference: Reference) -> tuple[pd.DataFrame, dict[str, float]]:
    """Compare the estimated and the true error of every case.

    Returns
    -------
    frame : DataFrame, a row per case
        ``error``, ``true_error`` (largest of the outcomes that count) and its ``outcome``.
    summary : dict of str to float
        Number of cases and of refined ones, largest errors, and quantiles of the true over the
        estimated error.
    """
    block, names = study.default.fly(study.inputs), np.array(study.names)
    rows = np.flatnonzero(block.has_outcomes & reference.valid[: len(block.status)])
    counted, scale = decisive(study.campaign.outcome_columns), study.integration.scale
    assert scale is not None
    assert block.refinement is not None
    all_errors = errors(
        block.outcomes[rows][:, : len(names)][:, counted],
        reference.outcomes[rows][:, counted],
        scale[counted],
    )
    true, estimated = all_errors.max(axis=1, initial=0.0), block.error[rows]
    frame = pd.DataFrame(
        {
            "case": rows,
            "error": estimated,
            "true_error": true,
            "outcome": names[counted][all_errors.argmax(axis=1)],
        }
    )
    ratio = true / estimated
    low, median, high = np.quantile(ratio, _QUANTILES) if len(ratio) else (np.nan,) * 3
    return frame, {
        "cases": len(frame),
        "flown_again": block.refinement.n_refined,
        "by_another_kernel": block.refinement.n_fallback,
        "largest_error": float(estimated.max(initial=0.0)),
        "largest_true_error": float(true.max(initial=0.0)),
        "true_over_told_1_percent": float(low),
        "true_over_told_median": float(median),
        "true_over_told_99_percent": float(high),
        "true_over_told_most": float(ratio.max(initial=0.0)),
    }


def sentence(summary: dict[str, float]) -> str:
    """Render the summary of `measure` as a sentence."""
    return (
        "column error: true errors are "
        f"{summary['true_over_told_median']:.2g} of it in the median case, "
        f"{summary['true_over_told_1_percent']:.2g} to "
        f"{summary['true_over_told_99_percent']:.2g} in 98 % of the cases "
        f"and at most {summary['true_over_told_most']:.2g}; the largest is "
        f"{summary['largest_error']:.1e}, the true one {summary['largest_true_error']:.1e}; "
        f"{summary['flown_again']} of {summary['cases']} cases were refined"
    )
