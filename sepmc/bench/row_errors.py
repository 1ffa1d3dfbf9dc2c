"""Estimated error of every case (column ``error`` of its row) against its true error."""

import numpy as np
import pandas as pd

from sepmc.bench.reference import Reference
from sepmc.bench.study import Study
from sepmc.campaign.execution.accuracy import decisive, errors

_QUANTILES = (0.01, 0.5, 0.99)


def measure(study: Study, reference: Reference) -> tuple[pd.DataFrame, dict[str, float]]:
    """Compare the estimated with the true error of every case that has both.

    Returns
    -------
    frame : DataFrame, a row per case
        ``case``; the estimated ``error``; ``true_error``, the largest of the outcomes, without
        contact (1 or 0) and the times and positions of extremes; and the ``outcome`` that has it.
        Both errors are relative to the outcome, or to its scale if that is larger
        (`sepmc.campaign.execution.accuracy.errors`).
    summary : dict of str to float
        ``cases`` in the table; ``n_refined`` and ``n_fallback``, the numbers of cases that were
        refined and that a fallback kernel integrated; ``largest_error`` (estimated) and
        ``largest_true_error``; and the quantiles of `ratio_summary`.
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
    return frame, {
        "cases": len(frame),
        "n_refined": block.refinement.n_refined,
        "n_fallback": block.refinement.n_fallback,
        "largest_error": float(estimated.max(initial=0.0)),
        "largest_true_error": float(true.max(initial=0.0)),
        **ratio_summary(true, estimated),
    }


def ratio_summary(true: np.ndarray, estimated: np.ndarray) -> dict[str, float]:
    """Quantiles of the true over the estimated error of n cases: ``true_over_estimated_1_percent``,
    ``_median`` and ``_99_percent``, NaN without cases, and ``true_over_estimated_max``, at least 0.

    Cases of which both errors are 0 have no ratio and are left out; where only the estimated one is
    0, the ratio is infinite.
    """
    has_error = (true > 0.0) | (estimated > 0.0)
    with np.errstate(divide="ignore"):
        ratio = true[has_error] / estimated[has_error]
    # to the nearest case: nothing is interpolated between infinite ratios
    quantiles = np.quantile(ratio, _QUANTILES, method="nearest") if len(ratio) else (np.nan,) * 3
    names = ("1_percent", "median", "99_percent", "max")
    values = (*quantiles, ratio.max(initial=0.0))
    return {f"true_over_estimated_{name}": float(x) for name, x in zip(names, values, strict=True)}


def sentence(summary: dict[str, float]) -> str:
    """Return the summary of `measure` as a sentence."""
    return (
        "column error: the true error over the estimated one is "
        f"{summary['true_over_estimated_median']:.2g} in the median case, "
        f"{summary['true_over_estimated_1_percent']:.2g} to "
        f"{summary['true_over_estimated_99_percent']:.2g} in 98 % of the cases "
        f"and at most {summary['true_over_estimated_max']:.2g}; the largest estimated error is "
        f"{summary['largest_error']:.1e}, the largest true one "
        f"{summary['largest_true_error']:.1e}; "
        f"{summary['n_refined']} of {summary['cases']} cases were refined"
    )
