"""`sepmc compare RUN --data FILE`: a run and the telemetry of a flight. Heavy modules are imported
at use."""

import json
import math
import warnings
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from sepmc.cli.options import check_out_file
from sepmc.cli.render import screen_width
from sepmc.cli.results import check_rows

if TYPE_CHECKING:
    from sepmc.analysis.telemetry import FlightComparison
    from sepmc.scene.messages import Log

CASES = 300  # simulated again for the envelope, by default
_FILES = ("telemetry.csv", "telemetry.json", "telemetry.png")


def compare_with_flight(
    folder: Path,
    data: Path,
    maps: tuple[str, ...],
    time: str | None,
    shift_s: float | None,
    cases: int,
    out: Path | None,
    overwrite: bool,
    log: "Log",
) -> None:
    """Compare the run in ``folder`` with the telemetry of a flight, print the result, and write
    ``telemetry.csv``, ``.json`` and ``.png`` into ``out``, the run folder if None.

    ``maps`` are texts COLUMN=CHANNEL. Other parameters are those of `Result.compare_flight`.
    """
    from sepmc.campaign.store import folders, manifests
    from sepmc.campaign.stored_result import open_run
    from sepmc.report.flight_figure import draw_flight
    from sepmc.scene.messages import SceneWarning

    check_rows(folder)
    into = folder if out is None else out
    for name in _FILES:
        check_out_file(into / name, (), overwrite)
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", SceneWarning)
        result = open_run(folder)
    comparison = result.compare_flight(data, _mapping(maps), time, shift_s, cases, log)
    log(render_flight(comparison, screen_width(), folder))
    folders.make_writable(into)
    folders.write_text(into / _FILES[0], comparison.curves.to_csv(index=False))
    folders.write_json(into / _FILES[1], comparison.to_dict())
    written = [
        into / _FILES[0],
        into / _FILES[1],
        draw_flight(comparison, into / _FILES[2]),
    ]
    if into == folder:
        manifests.record_derived(folder, written)
    for path in written:
        log(f"wrote {path}")


def _mapping(maps: tuple[str, ...]) -> dict[str, str]:
    """Return the channels of the file by history column, from texts ``COLUMN=CHANNEL``. Raises
    UsageError for another form, or a second channel for a column."""
    mapping = dict[str, str]()
    for text in maps:
        column, equal, channel = (part.strip() for part in text.partition("="))
        if not equal:
            raise click.UsageError(f"--map {text}: must be COLUMN=CHANNEL")
        if column in mapping:
            raise click.UsageError(f"--map {text}: is a second channel for {column}; give one")
        mapping[column] = channel
    return mapping


def render_flight(comparison: "FlightComparison", width: int, folder: Path) -> str:
    """Return a comparison of the run in ``folder`` with a flight as text, lines of ``width``
    characters: clock shift, notes, a table of the channels, and the nearest cases."""
    from textwrap import fill

    from sepmc.text_table import text_table

    def number(value: float | None, digits: int = 4) -> str:
        return "-" if value is None or math.isnan(value) else f"{value:.{digits}g}"

    shift = comparison.shift
    text, how = f"{shift.value:.15g} s", "given"
    if shift.is_estimated:
        text = f"{shift.value:.6f} s"  # of clocks since 1970, too
        how = f"estimated, standard error {number(shift.error, 2)} s"
    rows = [
        ("channel", "unit", "samples", "noise", "envelope used", "at s", "inside 99 %",
         "residual rms", "largest", "at s")
    ]  # fmt: skip
    for name, row in comparison.channels.to_dict("index").items():
        rows.append((
            str(name), row["unit"], str(row["samples"]), number(row["noise"], 2),
            number(row["envelope_used"], 3), number(row["envelope_used_at_s"]),
            f"{100.0 * row['inside_99']:.1f} %", number(row["residual_rms"], 3),
            number(row["residual_max"], 3), number(row["residual_max_at_s"]),
        ))  # fmt: skip
    nearest = ", ".join(f"{case} ({number(distance, 3)})" for case, distance in comparison.nearest)
    lines = [
        f"clock shift (time of the flight at time 0 of the run): {text}, {how}",
        *(f"warning: {note}" for note in comparison.notes),
        *text_table(rows, (0, 1)),
        f"envelope used: of the 99 % band of {comparison.n_cases} cases, widened by the noise of "
        "the channel; 1 is its edge. Residuals are flight minus nominal case.",
        f"nearest cases (rms distance in units of spread and noise): {nearest}; sepmc replay "
        f"{folder} --case {comparison.nearest[0][0]}",
    ]
    return "\n".join(
        line if "  " in line else fill(line, width, break_on_hyphens=False) for line in lines
    )


def read_stored_flight(folder: Path) -> "FlightComparison | None":
    """Return the comparison with a flight that is stored in a run folder; None if there is none, or
    its files were changed."""
    from sepmc.campaign.store import manifests

    if not all(manifests.is_recorded(folder, name) for name in _FILES[:2]):
        return None
    import pandas as pd

    from sepmc.analysis.telemetry import FlightComparison

    content = json.loads((folder / _FILES[1]).read_text(encoding="utf-8"))
    return FlightComparison.from_dict(content, pd.read_csv(folder / _FILES[0]), folder.name)


def check_options(two: Path | None, data: Path | None, others: dict[str, Any]) -> None:
    """Raise UsageError unless either a second run ``two`` or telemetry ``data`` is given, not both,
    or if one of the options of telemetry, ``others`` (values by name), has another value than its
    default without telemetry. Defaults other than None are listed in the function."""
    if (two is None) == (data is None):
        raise click.UsageError("give RUN_B, or the telemetry of a flight by --data, not both")
    defaults = {"map": (), "cases": CASES}
    given = [name for name, value in others.items() if value != defaults.get(name)]
    if data is None and given:
        raise click.UsageError(f"--{given[0]} needs --data")
