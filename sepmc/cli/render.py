"""What the command line tells: results as text and figures, progress, errors in a sentence.

Nothing heavy is imported until it is needed.
"""

import errno
import math
import os
import shutil
import signal
import sys
import threading
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from fnmatch import fnmatchcase
from pathlib import Path
from textwrap import TextWrapper
from typing import TYPE_CHECKING, Any

import click

from sepmc.cli.figures import draw_figures
from sepmc.paths import is_storage_error

if TYPE_CHECKING:
    from concurrent.futures import Executor
    from types import FrameType

    import pandas as pd

    from sepmc.analysis.requirements import Verdict
    from sepmc.analysis.row_statistics import TableStatistics
    from sepmc.analysis.stored_statistics import StoredStatistics
    from sepmc.analysis.streaming import StreamingStatistics
    from sepmc.campaign.campaign import Campaign
    from sepmc.campaign.result import Result

# what a write fails by that names no file: a full disk, and no folder for temporary files
_UNWRITABLE = (errno.ENOSPC, errno.EDQUOT, errno.EROFS, errno.ENOENT)
INTERRUPTED, TERMINATED = 130, 143  # exit codes after Ctrl-C and SIGTERM


class Terminated(KeyboardInterrupt):
    """SIGTERM, which ends a command as Ctrl-C does, with an exit code of its own."""


def stopped(error: KeyboardInterrupt) -> tuple[str, int]:
    """The word for what stopped a command, and its exit code."""
    if isinstance(error, Terminated):
        return "terminated", TERMINATED
    return "interrupted", INTERRUPTED


@contextmanager
def _terminable() -> Iterator[None]:
    """SIGTERM raises `Terminated` meanwhile, unless someone else handles it."""
    mine = threading.current_thread() is threading.main_thread()
    if not mine or signal.getsignal(signal.SIGTERM) is not signal.SIG_DFL:
        yield
        return

    def end(number: int, frame: "FrameType | None") -> None:
        raise Terminated

    signal.signal(signal.SIGTERM, end)
    try:
        yield
    finally:
        signal.signal(signal.SIGTERM, signal.SIG_DFL)


@contextmanager
def plain_errors(quiet: bool) -> Iterator[None]:
    """Bad input and unusable folders end with their sentence and exit code 2, without a traceback;
    Ctrl-C ends with exit code 130, SIGTERM with 143."""
    from sepmc.scene.messages import InputError, SceneError

    try:
        with _terminable():
            yield
    except KeyboardInterrupt as error:
        word, code = stopped(error)
        click.echo(f"\n{word}", err=True)
        sys.exit(code)
    except InputError as error:
        for line in error.problems if isinstance(error, SceneError) else [error]:
            click.echo(f"error: {line}", err=True)
        sys.exit(2)
    except OSError as error:  # a disk that is full, a folder that may not be written
        if error.filename is None and error.errno not in _UNWRITABLE:
            raise
        place = "" if error.filename is None else f"{error.filename}: "
        click.echo(f"error: {place}{error.strerror}", err=True)
        sys.exit(2)
    except Exception as error:
        # by name: their modules take a while to import
        known = ("StoreError", "ClusterError", "OutOfStepError")
        if any(kind.__name__ in known for kind in type(error).__mro__) or is_storage_error(error):
            click.echo(f"error: {error}", err=True)
            sys.exit(2)
        raise


def speaker(quiet: bool) -> Callable[[str], None]:
    """A function that prints sentences, folded to the screen, or does nothing if ``quiet``."""
    return (lambda text: None) if quiet else folded


def screen_width() -> int:
    """Characters of a line of a table: of the terminal or of COLUMNS, or else of plain tables."""
    from sepmc.analysis.statistics_text import WIDTH

    if not sys.stdout.isatty() and "COLUMNS" not in os.environ:
        return WIDTH
    return max(60, shutil.get_terminal_size((WIDTH, 24)).columns)


def for_screen(text: str) -> str:
    """A text, for a terminal with its lines folded between words; for a file as it is, where a
    sentence is looked for in one line."""
    if sys.stdout.isatty():
        folds = TextWrapper(
            screen_width(), subsequent_indent="  ", break_long_words=False, break_on_hyphens=False
        )
        lines = text.split("\n")
        text = "\n".join(folds.fill(one) if len(one) > folds.width else one for one in lines)
    return text


def folded(text: str) -> None:
    """Print a text `for_screen`."""
    click.echo(for_screen(text))


@contextmanager
def progress_bar(total: int, quiet: bool) -> Iterator[Callable[[int, int, int], None] | None]:
    """A bar on a terminal, plain lines every few seconds elsewhere: cases, rate, time left,
    failures."""
    if quiet:
        yield None
        return
    if sys.stderr.isatty():
        from tqdm import tqdm

        with tqdm(total=total, unit=" cases", dynamic_ncols=True) as bar:

            def on_terminal(done: int, left: int, failures: int) -> None:
                if done == 0:
                    bar.reset(total=left)
                    return
                bar.set_postfix(failures=failures, refresh=False)
                bar.update(done - bar.n)

            yield on_terminal
        return
    started = last = 0.0

    def in_lines(done: int, left: int, failures: int) -> None:
        nonlocal started, last
        now = time.perf_counter()
        if done == 0:  # told once before the first chunk, so that compiling does not count
            started = last = now
            return
        if now - last < 5.0 and done < left:
            return
        last = now
        rate = done / max(now - started, 1e-9)
        click.echo(
            f"{done}/{left} cases, {rate:.0f} cases/s, {(left - done) / rate:.0f} s left, "
            f"{failures} failures",
            err=True,
        )

    yield in_lines


@contextmanager
def counted(total: int, quiet: bool) -> Iterator[Callable[[str], None] | None]:
    """A bar over named checks on a terminal, nothing elsewhere."""
    if quiet or not sys.stderr.isatty():
        yield None
        return
    from tqdm import tqdm

    with tqdm(total=total, leave=False) as bar:

        def progress(name: str) -> None:
            bar.set_description(name)
            bar.update()

        yield progress


def timing_line(result: "Result") -> str:
    """How many cases were flown, and the seconds of each stage, as a line of text."""
    total = sum(result.status_counts.values())
    flown = f", {total - result.resumed} of them flown now" if result.resumed else ""
    said = {"compile": "compile and trial flights"}
    return f"{total} cases{flown}: " + ", ".join(
        f"{said.get(stage, stage)} {seconds:.3f} s" for stage, seconds in result.timing.items()
    )


def manifest_with_rows(folder: Path) -> dict[str, Any]:
    """The manifest of a run that holds case rows."""
    from sepmc.campaign.store import folders, manifests

    manifest = manifests.read_manifest(folder)
    if "rare" in manifest:
        raise folders.StoreError(
            f"{folder}: holds {folders.RARE} and no run: see rare.json and rare.png; sepmc "
            f"campaign {folder} --plan {folder / 'rare.parquet'} flies its cases as a run"
        )
    if manifest.get("stats_only"):
        kept = (
            "what there is stands in statistics.csv and statistics.json, and sepmc run "
            f"{folder} --case N flies any of its cases again"
            if manifest.get("complete")
            else f"it was interrupted; to go on: sepmc campaign {folder} --out {folder} --resume"
        )
        of = (
            "and those rows that --keep chose, in selected/"
            if manifest.get("keep")
            else "only and no cases"
        )
        raise folders.StoreError(
            f"{folder}: holds statistics {of}, where all rows, in cases/, are needed; {kept}"
        )
    if "cases" not in manifest:
        raise folders.StoreError(f"{folder}: holds a single flight; give the folder of a campaign")
    return manifest


def summary_of(folder: Path, loaded: "Campaign") -> "TableStatistics | StreamingStatistics":
    """Statistics of a run folder, from its case rows."""
    from sepmc.analysis.row_statistics import summarise
    from sepmc.campaign.store import folders, shards

    cases = shards.CaseColumns(folder)
    outcomes = loaded.summary_inputs[0]
    if lost := [name for name in ("case", "status", *outcomes) if name not in cases]:
        raise folders.StoreError(
            f"{folder}: its cases have no column {lost[0]}: they were flown by another version of "
            "sepmc, or changed; fly them again"
        )
    return summarise(cases, *loaded.summary_inputs)


def tell_results(
    folder: Path,
    loaded: "Campaign",
    summary: "TableStatistics | StreamingStatistics",
    say: Callable[[str], None],
    plots: bool,
    check: bool = False,
    shown: str | None = None,
    second: "Executor | None" = None,
) -> int:
    """Statistics and verdicts to the screen and to files, and figures if wanted; an error if the
    run is not to be trusted. On the screen, only outcomes that match one of the patterns ``shown``,
    if there are some. Returns the exit code: 1 if no case was flown to the end, 3 if the
    audit failed or the accuracy asked was not met, 1 if it is to ``check`` requirements and one is
    not passed, or else 0."""
    from sepmc.analysis import requirements
    from sepmc.analysis.constant_outcomes import collapse_constant
    from sepmc.analysis.statistics_text import render_audit, render_summary
    from sepmc.analysis.stored_statistics import histogram_table
    from sepmc.campaign.store import manifests, shards
    from sepmc.schema import Status

    units = {c.name: c.unit for c in loaded.outcome_columns}
    manifest = manifests.read_manifest(folder)
    accuracy, rarely = manifest.get("accuracy") or {}, manifest.get("rarely_drawn", ())
    table, counts = statistics_of(loaded, summary, accuracy), summary.counts
    audited = summary.audit()
    chosen = _matching(table, shown)
    verdicts = verdicts_of(loaded, summary, accuracy, table, audited)
    of = [verdict.to_dict() for verdict in verdicts]
    told = shards.statistics_as_json(table, counts, units, audited, summary.failed, of, rarely)
    shards.write_statistics(folder, table, units, told)
    source = loaded.file.reference.source if loaded.file.reference else "reference"
    width = screen_width()
    say(render_summary(chosen, counts, units, source, width))
    sentences = {status.label: status.sentence for status in Status}
    for label, count in counts.items():
        if label != Status.OK.label and count:
            first = ", ".join(map(str, summary.failed[label]))
            say(
                f"{count} cases {label}: {sentences.get(label, '')} (case "
                f"{first}{', ...' if count > len(summary.failed[label]) else ''})"
            )
    total, ok = sum(counts.values()), counts.get(Status.OK.label, 0)
    if 0 < ok < 0.9 * total:
        click.echo(
            f"warning: {total - ok} of {total} cases are left out: these statistics are of the "
            "others",
            err=True,
        )
    say(render_audit(audited, width))
    if "errors" in accuracy:
        stages = accuracy.get("stages") or [phase.name for phase in loaded.scene.phase]
        say(for_screen(accuracy_text(accuracy, stages)))
    if verdicts:
        say(requirements.render_verdicts(verdicts, units, width))
    written = [folder / "statistics.csv", folder / "statistics.json"]
    if manifest.get("stats_only"):  # no rows to count them of again
        bins = histogram_table(
            {n: collapse_constant(summary.histogram(n), table, n) for n in map(str, table.index)}
        )
        written.append(shards.write_histograms(folder, bins))
    if plots:
        written += draw_figures(
            folder, loaded, summary, table, say=say, verdicts=verdicts, second=second
        )
    manifests.record_derived(folder, written)
    say(f"wrote {folder}")
    faults = (
        (not ok, 1, "no case was flown to the end; see the column status"),
        (
            (audited["beyond"] > 0).any(),
            3,
            "the audit failed; shorten solver.step_s or look at the cases named in statistics.json",
        ),
        (
            not accuracy.get("met", True),
            3,
            "the accuracy asked was not met; see the warning above",
        ),
        (
            check and any(verdict.verdict != requirements.PASS for verdict in verdicts),
            1,
            "the cases do not show all that is required",
        ),
    )
    code, why = next(((code, why) for found, code, why in faults if found), (0, ""))
    if code:
        click.echo(f"error: {why}", err=True)
    return code


def tell_given(
    folder: Path,
    loaded: "Campaign",
    given: tuple[str, ...],
    shown: str | None,
    as_json: bool = False,
) -> None:
    """Statistics and verdicts of the cases of a run in which terms hold, to the screen: as tables,
    or as what ``statistics.json`` would hold of these cases."""
    import pandas as pd

    from sepmc.analysis import requirements
    from sepmc.analysis.row_filter import (
        assumed_units,
        describe_filter,
        filter_names,
        filter_outcomes,
        matching_rows,
    )
    from sepmc.analysis.row_statistics import TableStatistics
    from sepmc.analysis.statistics import ok_rows
    from sepmc.analysis.statistics_text import render_summary
    from sepmc.campaign.store import folders, manifests, shards
    from sepmc.scene.messages import InputError

    cases = shards.CaseColumns(folder)
    names = filter_names(loaded.file.dispersions, list(cases))
    held = matching_rows(cases, names, given)
    if not held.any():
        raise InputError(f"{describe_filter(given)}: holds in none of {cases.rows} cases")
    outcomes, audits, bounds, required = loaded.summary_inputs
    kept = {name: cases[name][held] for name in ("case", "status", *outcomes, *audits)}
    summary = TableStatistics(kept, outcomes, audits, bounds, required)
    units, width = {c.name: c.unit for c in loaded.outcome_columns}, screen_width()
    ok = int(ok_rows(cases)[held].sum())
    accuracy = manifests.read_manifest(folder).get("accuracy") or {}
    table, audited = statistics_of(loaded, summary, accuracy, beside=False), summary.audit()
    verdicts = verdicts_of(loaded, summary, accuracy, table, audited)
    if as_json:
        told: dict[str, Any] = {"given": list(given)}
        of = [verdict.to_dict() for verdict in verdicts]
        told |= shards.statistics_as_json(
            _matching(table, shown), summary.counts, units, audited, summary.failed, of
        )
        click.echo(folders.json_text(told), nl=False)
        return
    folded(f"{describe_filter(given)}: {held.sum()} of {cases.rows} cases")
    for said in assumed_units(names, given):
        folded(said)
    if not ok:
        ends = pd.Series(cases["status"][held]).value_counts()
        said = ", ".join(f"{count} {label}" for label, count in ends.items())
        folded(f"none of them came to its end as asked, so there are no statistics: {said}")
    else:
        folded(render_summary(_matching(table, shown), summary.counts, units, width=width))
    if verdicts:
        folded(requirements.render_verdicts(verdicts, units, width, population="such cases"))
        if too_few := requirements.render_cases_needed(verdicts):
            folded(too_few)
    if by := filter_outcomes(names, given):
        folded(
            f"chosen by what they did ({', '.join(by)}), not by inputs: what is required of these "
            "cases may follow from the choice"
        )


def _matching(table: "pd.DataFrame", shown: str | None) -> "pd.DataFrame":
    """Rows of statistics whose names match one of the patterns, split by commas."""
    from sepmc.scene.messages import InputError, nearest

    if shown is None:
        return table
    patterns = [pattern.strip() for pattern in shown.split(",")]
    for pattern in patterns:
        if not any(fnmatchcase(name, pattern) for name in table.index):
            raise InputError(
                f"--columns {pattern}: no such outcome; {nearest(pattern, table.index)}"
            )
    return table[[any(fnmatchcase(name, p) for p in patterns) for name in table.index]]


def _error(number: float | None) -> str:
    """An error of the manifest as text."""
    return f"{_number(number):.1e}"


def statistics_of(
    loaded: "Campaign",
    summary: "TableStatistics | StreamingStatistics | StoredStatistics",
    accuracy: dict[str, Any],
    beside: bool = True,
) -> "pd.DataFrame":
    """Statistics of a run, ``beside`` the reference if it has one, with the numerical errors that
    its manifest tells, and which outcomes are constant."""
    from sepmc.campaign.execution.accuracy import with_errors

    table = summary.statistics(loaded.reference if beside else None)
    return with_errors(loaded, errors_told(accuracy), table)


def verdicts_of(
    loaded: "Campaign",
    summary: "TableStatistics | StreamingStatistics",
    accuracy: dict[str, Any],
    table: "pd.DataFrame",
    audited: "pd.DataFrame",
) -> "list[Verdict]":
    """Verdicts on the requirements of a run, from its statistics and audit."""
    from sepmc.campaign.execution.accuracy import with_scales

    errors = with_scales(loaded, errors_told(accuracy), table)
    return summary.verdicts(errors, audited, loaded.scene.run.sampler)


def errors_told(accuracy: dict[str, Any]) -> dict[str, float]:
    """Numerical errors of outcomes that a manifest tells of how its run was flown."""
    return {name: _number(error) for name, error in accuracy.get("errors", {}).items()}


def _number(error: float | None) -> float:
    """An error of the manifest as a number: what is null there is infinite."""
    return math.inf if error is None else error


def single_error_text(
    outcomes: dict[str, float], errors: dict[str, float], loaded: "Campaign"
) -> str | None:
    """How exact one case is, in a sentence; None if nothing is told of an outcome that it has."""
    from sepmc.campaign.execution.accuracy import decisive

    columns, step = loaded.outcome_columns, loaded.scene.solver.step
    settled = {
        c.name: errors[c.name]
        for c, decides in zip(columns, decisive(columns), strict=True)
        if decides and c.name in errors and not math.isnan(outcomes[c.name])
    }
    if not settled:
        return None
    worst = max(settled, key=lambda name: settled[name])
    how = (
        f", asked {loaded.scene.solver.accuracy:g}"
        if step is None
        else f": twice the change at half the step of {step:g} s"
    )
    return f"numerical error at most {settled[worst]:.1e} ({worst}) of size{how}"


def accuracy_text(accuracy: dict[str, Any], stages: list[str]) -> str:
    """How a campaign was flown and how exact that was, in a sentence."""
    # runs of versions without "methods" had one for all phases
    methods = accuracy.get("methods") or len(stages) * [accuracy["method"]]
    steps, same = accuracy.get("steps", ()), len(set(methods)) == 1
    each = ", ".join(
        f"{stage} {number}" + ("" if same else f" ({method})")
        for stage, number, method in zip(stages, steps, methods, strict=False)
    )
    how = f"steps: {each}" if each else f"step {accuracy['step_s']:g} s"
    how = f"{methods[0]}, {how}" if same else how
    how = how if accuracy["formulation"] == "reduced" else f"full system, {how}"
    if not accuracy["cases"]:
        return f"numerical error not known, no trial case came to its end; {how}"
    said = (
        f"numerical error at most {_error(accuracy['achieved'])} ({accuracy['worst_outcome']}) "
        "of size or sigma"
    )
    asked = (
        f", asked {accuracy['asked']:g}" + ("" if accuracy.get("met", True) else ": NOT MET")
        if "asked" in accuracy
        else ""
    )
    place = accuracy.get("worst_place")
    history = f"; of histories {_error(accuracy['history'])}" if "history" in accuracy else ""
    places = (
        f"; of times and places of extremes, which nothing settles where an extreme is flat, "
        f"{_error(accuracy['errors'][place])} ({place})"
        if place
        else ""
    )
    finer, spare = accuracy.get("n_refined"), accuracy.get("n_fallback")
    why = "to learn their error" if "step_s" in accuracy else "of their own"
    others = f", {finer} case{'s' * (finer != 1)} flown again at finer steps {why}" if finer else ""
    others += f", {spare} cases by a second kernel" if spare else ""
    trials = (
        "estimated for every case (column error, to a factor of 2) and found in "
        f"{accuracy['cases']} trial cases, corners of the laws among them"
    )
    return f"{said}{asked}{places}{history}: {trials}; {how}{others}"
