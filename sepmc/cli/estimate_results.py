"""Files that `sepmc estimate` writes, and text that it prints."""

import math
import time
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from sepmc import __version__
from sepmc.analysis.model_check import LEVEL, ChiSquareTest
from sepmc.campaign.campaign import Campaign
from sepmc.campaign.estimation import CORRELATED, UNINFORMED, Estimation
from sepmc.campaign.store import folders, manifests, shards
from sepmc.scene.messages import Log
from sepmc.text_table import text_table

_EVERY_S = 5.0  # between messages on the progress
_MOST_PAIRS = 8  # correlations shown


def count_sweeps(log: Log) -> Callable[[float, int], None]:
    """Return a function that logs the progress of the sampler, at most every five seconds, and not
    in the first five.

    It is to be called after each move of all cases with the temperature (fraction of the
    information of the measurements that is in use, 0 to 1) and the number of moves so far.
    """
    last = time.monotonic()

    def report(temperature: float, sweeps: int) -> None:
        nonlocal last
        if time.monotonic() - last > _EVERY_S:
            last = time.monotonic()
            log(f"{sweeps} moves of all cases, {100.0 * temperature:.2g} % of the information used")

    return report


def write_samples(estimation: Estimation, campaign: Campaign, path: Path) -> Path:
    """Write the sample of the posterior to a Parquet table for ``run.samples``; return ``path``. It
    has a column for each dispersed input and a row for each draw, but no case numbers. An existing
    file is replaced. Raises StoreError if it cannot be written."""
    about = {"campaign": campaign.name, "digest": campaign.digest, "sepmc": __version__}
    inputs = estimation.inputs
    columns = campaign.input_columns
    data = {column.name: inputs[column.name].to_numpy() for column in columns}
    shards.write_parquet(path, columns, data, about)
    return path


def write_estimation(estimation: Estimation, folder: Path, figure: bool) -> list[Path]:
    """Write ``posterior.csv`` (table of parameters), ``posterior.json`` and, if ``figure``,
    ``posterior.png`` into a run folder, and record these files in its manifest; return their
    paths."""
    written = [folder / "posterior.csv", folder / "posterior.json"]
    folders.write_text(written[0], estimation.table.to_csv(index=False))
    folders.write_json(written[1], _summary(estimation))
    if figure:
        from sepmc.report.posterior_figure import posterior_figure

        written.append(posterior_figure(estimation, folder.name, folder / "posterior.png"))
    manifests.record_derived(folder, written)
    return written


def _summary(estimation: Estimation) -> dict[str, Any]:
    """Return the content of ``posterior.json``, by key: numbers on the sampler and its sample,
    the pairs of correlated parameters, and the check of the model against the measurements."""
    check, sample = estimation.check, estimation.sample
    tests = {"blocks": check.blocks, "parameters": check.parameters, "noise": check.noise}
    return {
        "seed": estimation.seed,
        "cases": len(sample.scores),
        "log_evidence": estimation.log_evidence,
        "temperatures": list(sample.temperatures),
        "moves": sample.sweeps,
        "remaining_correlation": sample.correlation,
        "acceptance": sample.acceptance,
        "effective_cases": float(sample.effective.min()),
        "impossible": estimation.impossible,
        "measurements": estimation.understood,
        "correlations": [
            {"parameters": [a, b], "correlation": value} for a, b, value in estimation.correlations
        ],
        "model_is_short": check.is_short,
        "noise_is_larger": check.noise.fails,
        "tests": {
            name: {"chi_square": one.chi_square, "freedom": one.freedom, "p_value": one.p_value}
            for name, one in tests.items()
        },
        "residuals_of_sigma": [
            {"column": channel.column, "ratio": one.ratio}
            for channel, one in zip(estimation.channels, check.channels, strict=True)
        ],
        "blocks": [
            {
                "column": estimation.channels[one.channel].column,
                "start_s": one.start_s,
                "end_s": one.end_s,
                "residual_sigma": one.residual,
                "score": one.score,
            }
            for one in check.by_time
        ],
    }


def render_estimation(estimation: Estimation, folder: Path) -> str:
    """Return an estimation as text: parameters, correlations, sampler, evidence and the check of
    the model. ``folder`` is the run folder of the posterior sample."""
    lines = [*estimation.understood, ""]
    lines += _parameters(estimation)
    for first, second, value in estimation.correlations[:_MOST_PAIRS]:
        lines.append(
            f"correlation {value:+.2f} of {first} and {second}: the flight determines them only "
            "together"
        )
    more = len(estimation.correlations) - _MOST_PAIRS
    if more > 0:
        lines.append(f"and {more} more pairs beyond {CORRELATED:g} in posterior.json")
    sample = estimation.sample
    lines += [
        "",
        f"sampler: {sample.sweeps} moves of all cases, {100.0 * sample.acceptance:.0f} % of the "
        f"last ones accepted; {len(sample.scores)} cases are worth at least "
        f"{sample.effective.min():.0f} independent ones",
        f"log evidence {estimation.log_evidence:.2f} (natural)",
    ]
    if estimation.impossible > 0.0:
        lines.append(
            f"{100.0 * estimation.impossible:.2g} % of the cases of the distributions lack a value "
            "at some sample; they count as impossible"
        )
    lines += _check(estimation)
    path = folder / folders.SAMPLES
    lines.append(f"posterior: {len(estimation.inputs)} cases, to run with --samples {path}")
    return "\n".join(lines)


def _parameters(estimation: Estimation) -> list[str]:
    """Return lines of text: a table, with a header, of the parameters that the flight informs, the
    best known first; their number; and the names of the others."""
    table = estimation.table.sort_values("std_ratio", kind="stable")
    informed = table[table["std_ratio"] <= UNINFORMED]
    head = ("parameter", "unit", "before", "std", "after", "std", "5 %", "95 %", "ratio")
    rows = [
        [
            row["parameter"],
            row["unit"],
            *_rounded(row, "prior_std", ("prior_mean", "prior_std")),
            *_rounded(row, "std", ("mean", "std", "low", "high")),
            f"{row['std_ratio']:.2f}",
        ]
        for row in informed.to_dict("records")
    ]
    others = table[table["std_ratio"] > UNINFORMED]["parameter"]
    lines = list(text_table([head, *rows], left=(0, 1))) if rows else []
    lines.append(
        f"{len(rows)} of {len(table)} parameters are known better: ratio, of the standard "
        f"deviations after and before, at most {UNINFORMED:g}"
    )
    if len(others):
        lines.append(f"hardly known better: {', '.join(others)}")
    return lines


def _rounded(row: Mapping[Any, Any], spread: str, names: Sequence[str]) -> list[str]:
    """Return the values ``names`` of a row as text, with as many decimals as show two digits of the
    standard deviation, column ``spread``: 0 to 12, and 0 if that is zero or NaN."""
    digits = 0
    if row[spread] > 0.0:
        digits = min(max(1 - math.floor(math.log10(row[spread])), 0), 12)
    return [f"{row[name]:.{digits}f}" for name in names]


def _test_text(test: ChiSquareTest) -> str:
    """Return a chi-square test as text: value, degrees of freedom and p-value."""
    return (
        f"chi-square {test.chi_square:.4g} with {test.freedom} degrees of freedom "
        f"(p = {test.p_value:.2g})"
    )


def _check(estimation: Estimation) -> list[str]:
    """Return the check of the model against the measurements as lines of text: one line with three
    chi-square tests (residuals by time, parameters, all residuals), then one that the model
    explains the measurements, or a line for each of the first two tests that fails. If the last
    test fails and the first does not, one more line says that residuals scatter too much."""
    check = estimation.check
    lines = [
        f"model check: residuals by time {_test_text(check.blocks)}; parameters against their "
        f"distributions {_test_text(check.parameters)}; all residuals {_test_text(check.noise)}"
    ]
    if not (check.is_short or check.noise.fails):
        lines.append(
            "the model with these distributions explains the measurements (false alarms: "
            f"{100.0 * LEVEL:g} %)"
        )
    if check.blocks.fails:
        worst = check.worst
        column = estimation.channels[worst.channel].column
        score = "" if np.isnan(worst.score) else f", {abs(worst.score):.1f} times its deviation"
        lines.append(
            "MODEL SHORTFALL: residuals that no values of the parameters remove, the largest in "
            f"{column} from {worst.start_s:.4g} to {worst.end_s:.4g} s: mean {worst.residual:+.2g} "
            f"sigma{score}. A load or an effect is missing there; the estimate cannot be trusted"
        )
    if check.parameters.fails:
        lines.append(
            "MODEL SHORTFALL: the estimate lies outside the distributions: they are too narrow, or "
            "the parameters stand for a load or an effect that is missing"
        )
    if check.noise.fails and not check.blocks.fails:
        ratios = [np.nan_to_num(one.ratio) for one in check.channels]
        worst_channel = int(np.argmax(ratios))
        lines.append(
            "residuals scatter more than the sigma of their channel, most in "
            f"{estimation.channels[worst_channel].column}, {ratios[worst_channel]:.2g} times: "
            "sigma is too small, or the model lacks something fast"
        )
    return lines
