"""Rendering of results as text, and printing of text. Heavy modules are imported at use."""

import math
import os
import shutil
import sys
from collections.abc import Mapping, Sequence
from textwrap import TextWrapper
from typing import TYPE_CHECKING, Any

import click

from sepmc.text_table import text_table
from sepmc.wording import count_cases

if TYPE_CHECKING:
    from sepmc.campaign.campaign import Campaign
    from sepmc.campaign.execution.rare_event import RareEventEstimate
    from sepmc.campaign.result import Result
    from sepmc.scene.messages import Log

_INPUTS = 6  # inputs of violating cases on the screen
_STAGES = {"text": "kernel text", "steps": "step selection"}


def screen_width() -> int:
    """Return the width of tables in characters: that of the terminal or of the environment variable
    COLUMNS, at least 60; `sepmc.analysis.statistics_text.WIDTH` without both."""
    from sepmc.analysis.statistics_text import WIDTH

    if not sys.stdout.isatty() and "COLUMNS" not in os.environ:
        return WIDTH
    return max(60, shutil.get_terminal_size((WIDTH, 24)).columns)


def for_screen(text: str) -> str:
    """Return a text with long lines folded between words if output goes to a terminal; elsewhere
    the text as it is, for searching."""
    if not sys.stdout.isatty():
        return text
    folds = TextWrapper(
        screen_width(), subsequent_indent="  ", break_long_words=False, break_on_hyphens=False
    )
    return "\n".join(
        folds.fill(line) if len(line) > folds.width else line for line in text.split("\n")
    )


def show(text: str) -> None:
    """Print a text to standard output, with long lines folded on a terminal."""
    click.echo(for_screen(text))


def logger(quiet: bool) -> "Log":
    """Return a function that prints a message to standard output as `show` does, or ignores it if
    ``quiet``."""
    return (lambda text: None) if quiet else show


def warn(*messages: str) -> None:
    """Print each message as a warning to standard error."""
    for message in messages:
        click.echo(f"warning: {message}", err=True)


def render_timing(result: "Result") -> str:
    """Return a line of text: the number of cases of a run, and the seconds that each stage took."""
    total = sum(result.status_counts.values())
    n_run = f", {total - result.resumed} of them run now" if result.resumed else ""
    return f"{count_cases(total)}{n_run}: " + ", ".join(
        f"{_STAGES.get(stage, stage)} {seconds:.3f} s" for stage, seconds in result.timing.items()
    )


def render_accuracy(accuracy: Mapping[str, Any], phases: Sequence[str]) -> str:
    """Return the numerical error and the integration steps of a run as text.

    ``accuracy`` is that entry of the manifest of the run; ``phases`` are the names of the kernel
    segments, by `sepmc.cli.results.phases`.
    """
    # manifests without "methods" have one method for all phases
    methods = accuracy.get("methods") or len(phases) * [accuracy["method"]]
    steps, same = accuracy.get("steps", ()), len(set(methods)) == 1
    each = ", ".join(
        f"{phase} {number}" + ("" if same else f" ({method})")
        for phase, number, method in zip(phases, steps, methods, strict=False)
    )
    how = f"steps: {each}" if each else f"step {accuracy['step_s']:g} s"
    how = f"{methods[0]}, {how}" if same else how
    how = how if accuracy["formulation"] == "reduced" else f"full system, {how}"
    if not accuracy["cases"]:
        return f"numerical error not known: no calibration case completed; {how}"
    requested = (
        f"; requested {accuracy['asked']:g}" + ("" if accuracy.get("met", True) else ": NOT MET")
        if "asked" in accuracy
        else ""
    )
    history = f"; of histories {_error(accuracy['history'])}" if "history" in accuracy else ""
    flat = accuracy.get("worst_place")
    extremes = (
        f"; of times and positions of flat extremes, which are ill-conditioned, "
        f"{_error(accuracy['errors'][flat])} ({flat})"
        if flat
        else ""
    )
    refined, fallback = accuracy.get("n_refined"), accuracy.get("n_fallback")
    why = "for their error" if "step_s" in accuracy else "for their accuracy"
    others = f"; {refined} case{'s' * (refined != 1)} refined {why}" if refined else ""
    others += f"; {fallback} cases by a fallback kernel" if fallback else ""
    return (
        f"numerical error <= {_error(accuracy['achieved'])} ({accuracy['worst_outcome']}), "
        f"relative to size or sigma{requested}{extremes}{history}. Estimated per case (column "
        f"error, within a factor of 2), calibrated on {accuracy['cases']} cases, corners of the "
        f"distributions included; {how}{others}"
    )


def _error(number: float | None) -> str:
    """Return the text of a relative error from a manifest; None there stands for infinity."""
    return f"{math.inf if number is None else number:.1e}"


def render_case_error(
    outcomes: Mapping[str, float], errors: Mapping[str, float], campaign: "Campaign"
) -> str | None:
    """Return a sentence on the largest relative error of one case, over its decisive outcomes
    (`sepmc.campaign.execution.accuracy.decisive`), from its ``outcomes`` and their ``errors`` by
    name; None if none of these outcomes has a known error."""
    from sepmc.campaign.execution.accuracy import decisive

    columns, step = campaign.outcome_columns, campaign.scene.solver.step
    known = {
        column.name: errors[column.name]
        for column, decides in zip(columns, decisive(columns), strict=True)
        if decides and column.name in errors and not math.isnan(outcomes[column.name])
    }
    if not known:
        return None
    worst = max(known, key=lambda name: known[name])
    how = (
        f"; requested {campaign.scene.solver.accuracy:g}"
        if step is None
        else f": twice the change at half the step of {step:g} s"
    )
    return f"numerical error <= {known[worst]:.1e} ({worst}), relative to size{how}"


def render_rare_event(estimate: "RareEventEstimate") -> str:
    """Return a rare-event estimate as text: a table of the levels of subset simulation, the
    probability with its interval, and up to `_INPUTS` inputs whose values in the violating cases
    differ most from those in all cases."""
    from sepmc.analysis.subset_simulation import equivalent_direct_cases

    unit = "" if estimate.unit == "1" else f" {estimate.unit}"
    rows = [["level", f"margin{unit}", "probability", "of level", "accepted", "cases"]]
    for number, level in enumerate(estimate.levels):
        rows.append(
            [
                str(number),
                f"{level.threshold:.5g}",
                f"{level.reached:.3e}",
                f"{level.probability:.3f}",
                "" if math.isnan(level.acceptance) else f"{level.acceptance:.2f}",
                str(level.seeds),
            ]
        )
    mean, (low, high) = estimate.probability, estimate.interval
    lines = [
        *text_table(rows, left=()),
        "",
        f"{estimate.requirement}: probability of violation {mean:.3e}, 95 % interval {low:.2e} "
        f"to {high:.2e}; {estimate.flights} cases",
    ]
    if estimate.unknown:
        lines.append(
            f"cases without a known result have a probability of {estimate.unknown:.2e}; if none "
            f"or all of them violate: {estimate.bounds[0]:.2e} to {estimate.bounds[1]:.2e}"
        )
    if mean and len(estimate.levels) > 1:
        plain = equivalent_direct_cases(mean, estimate.interval)
        lines.append(
            f"{len(estimate.replicas)} independent replicas: {min(estimate.replicas):.2e} to "
            f"{max(estimate.replicas):.2e}"
            + (f"; random cases needed for this interval: {plain:.1e}" if plain > 0.0 else "")
        )
    if estimate.inputs:
        lines += ["", "inputs of the violating cases (normal scores; all cases: 0 +- 1):"]
        some = list(estimate.inputs.items())[:_INPUTS]
        lines += [f"  {name:44s} {m:+6.2f} +- {s:.2f}" for name, (m, s) in some]
    return "\n".join(lines)
