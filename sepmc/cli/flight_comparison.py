"""A run and the telemetry of a flight. Heavy modules are imported at use."""

import json
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from sepmc.cli.options import check_out_file, load_run
from sepmc.cli.render import screen_width, show
from sepmc.cli.results import check_rows

if TYPE_CHECKING:
    import pandas as pd

    from sepmc.analysis.telemetry import FlightComparison, Histories
    from sepmc.campaign.campaign import Campaign
    from sepmc.scene.messages import Log

CASES = 300  # simulated again for the envelope, by default
_MIN_ROWS, _MOST_ROWS = 200, 1000  # of a history
_STORED = 20_000  # cases with stored histories that are read
_MOST_LEFT_OUT = 0.05  # of the time that flight and run could share, without a warning
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
    """Compare a run with the telemetry of a flight; write the files, and print what they say."""
    from sepmc import schema
    from sepmc.analysis.telemetry import Channel, compare_flight
    from sepmc.campaign.store import folders, manifests
    from sepmc.formats.telemetry import parse_map, read_telemetry
    from sepmc.formats.text_table import FormatError
    from sepmc.scene.messages import InputError

    manifest = check_rows(folder)
    into = folder if out is None else out
    campaign = load_run(folder)
    columns = [c.name for c in schema.history_columns(campaign.layout.contents)]
    mapped = [parse_map(text, columns) for text in maps]
    try:
        brought, understood = read_telemetry(data, mapped, columns, time)
    except FormatError as error:
        raise InputError(f"{data}: {error}") from None
    for name in _FILES:
        check_out_file(into / name, (), overwrite)
    show("\n".join(understood))
    channels = {name: Channel(*samples) for name, samples in brought.items()}
    histories = _histories(folder, campaign, manifest, channels, cases, log)
    result = compare_flight(channels, histories, shift_s)
    units = {c.name: c.unit for c in schema.history_columns(campaign.layout.contents)}
    summary = _summary(result, units, data, understood)
    log(render_flight(summary, screen_width(), folder))
    folders.make_writable(into)
    folders.write_text(into / _FILES[0], result.curves.to_csv(index=False))
    folders.write_json(into / _FILES[1], summary)
    written = [
        into / _FILES[0],
        into / _FILES[1],
        draw_flight(result.curves, summary, folder, into),
    ]
    if into == folder:
        manifests.record_derived(folder, written)
    for path in written:
        log(f"wrote {path}")


def _histories(
    folder: Path,
    campaign: "Campaign",
    manifest: dict[str, Any],
    channels: dict[str, Any],
    cases: int,
    log: "Log",
) -> "Histories":
    """Return histories of the columns of the channels: the stored ones if the run has these
    columns, else of the first ``cases`` ok cases, simulated again."""
    import numpy as np

    from sepmc.analysis.statistics import ok_rows
    from sepmc.analysis.telemetry import Histories
    from sepmc.campaign.execution.case_histories import case_histories
    from sepmc.campaign.store import shards
    from sepmc.scene.messages import InputError

    names, rows = tuple(channels), shards.CaseColumns(folder)
    numbers = np.sort(np.asarray(rows["case"])[ok_rows(rows)])
    if not len(numbers):
        raise InputError(f"{folder}: no case is ok, so there is no envelope")
    seed, total = manifest["seed"], manifest.get("of", manifest["cases"])
    end = campaign.scene.run.end_time
    stored = _stored_histories(folder, campaign, names, numbers)
    if stored is not None:
        numbers, step, values = stored
        log(f"envelope: stored histories of {len(numbers)} cases")
        times = np.arange(values.shape[-1]) * step
    else:
        chosen = numbers[:cases]
        log(f"envelope: {len(chosen)} of {len(numbers)} ok cases, simulated again ...")
        spacing = min(float(np.median(np.diff(c.time))) for c in channels.values())
        count = int(np.clip(end / spacing if spacing > 0.0 else 0, _MIN_ROWS, _MOST_ROWS))
        times = np.linspace(0.0, end, count + 1)
        numbers = chosen
        values = case_histories(campaign, list(numbers), names, times, seed, total, log)
    nominal = case_histories(campaign, [-1], names, times, seed, total, log)[0]
    return Histories(numbers, names, float(times[1]), values, nominal)


def _stored_histories(
    folder: Path, campaign: "Campaign", names: tuple[str, ...], ok: Any
) -> "tuple[Any, float, Any] | None":
    """Return numbers, step in s and stored histories (n, c, t) of ok cases; None if the run has
    not all of these columns."""
    import numpy as np

    from sepmc.campaign.store import shards

    if not {c.name for c in campaign.stored_history_columns()} >= set(names):
        return None
    frame = shards.read_histories(folder, shards.case_after(folder, _STORED))
    if frame is None:
        return None
    frame = frame[frame["case"].isin(ok)]
    numbers, counts = np.unique(frame["case"].to_numpy(), return_counts=True)
    if not len(numbers) or counts[0] < 2 or (counts != counts[0]).any():
        return None
    values = frame[list(names)].to_numpy(dtype=float).reshape(len(numbers), counts[0], len(names))
    return numbers, campaign.scene.run.history_step, np.moveaxis(values, 1, 2)


def _summary(
    result: "FlightComparison",
    units: dict[str, str],
    data: Path,
    understood: list[str],
) -> dict[str, Any]:
    """Return the content of ``telemetry.json``."""
    return {
        "data": data.name,
        "channels_read": understood,
        "cases": result.n_cases,
        "clock_shift_s": result.shift.value,
        "clock_shift_error_s": result.shift.error,
        "clock_shift_is_estimated": result.shift.is_estimated,
        "channels": {
            str(name): {"unit": units[str(name)], **row}
            for name, row in result.channels.to_dict("index").items()
        },
        "left_out": result.left_out,
        "nearest": [{"case": case, "distance": distance} for case, distance in result.nearest],
    }


def render_flight(summary: dict[str, Any], width: int, folder: Path) -> str:
    """Return the comparison of the run in a folder with a flight as text, from the content of
    ``telemetry.json``."""
    from textwrap import fill

    from sepmc.text_table import text_table

    def number(value: float | None, digits: int = 4) -> str:
        return "-" if value is None else f"{value:.{digits}g}"

    shift, how = f"{summary['clock_shift_s']:.15g} s", "given"
    if summary["clock_shift_is_estimated"]:
        shift = f"{summary['clock_shift_s']:.6f} s"  # of clocks since 1970, too
        how = f"estimated, standard error {number(summary['clock_shift_error_s'], 2)} s"
    rows = [
        ("channel", "unit", "samples", "noise", "envelope used", "at s", "inside 99 %",
         "residual rms", "largest", "at s")
    ]  # fmt: skip
    for name, row in summary["channels"].items():
        rows.append((
            name, row["unit"], str(row["samples"]), number(row["noise"], 2),
            number(row["envelope_used"], 3), number(row["envelope_used_at_s"]),
            f"{100.0 * row['inside_99']:.1f} %", number(row["residual_rms"], 3),
            number(row["residual_max"], 3), number(row["residual_max_at_s"]),
        ))  # fmt: skip
    nearest = ", ".join(f"{n['case']} ({number(n['distance'], 3)})" for n in summary["nearest"])
    first = summary["nearest"][0]["case"]
    text = [
        f"clock shift (time of the flight at time 0 of the run): {shift}, {how}",
        *_left_out_note(summary["left_out"]),
        *text_table(rows, (0, 1)),
        f"envelope used: of the 99 % band of {summary['cases']} cases, widened by the noise of the "
        "channel; 1 is its edge. Residuals are flight minus nominal case.",
        f"nearest cases (rms distance in units of spread and noise): {nearest}; sepmc replay "
        f"{folder} --case {first}",
    ]
    return "\n".join(
        line if "  " in line else fill(line, width, break_on_hyphens=False) for line in text
    )


def _left_out_note(left_out: float) -> list[str]:
    """Note on a shift that leaves much of the flight outside the run."""
    if left_out <= _MOST_LEFT_OUT:
        return []
    return [
        f"warning: this shift leaves {100.0 * left_out:.0f} % of what flight and run could share "
        "outside the run: check sign, factor and unit of the channels, or give --shift"
    ]


def draw_flight(
    curves: "pd.DataFrame", summary: dict[str, Any], folder: Path, into: Path, suffix: str = ".png"
) -> Path:
    """Draw the flight over the envelope of the run in a folder; return the path."""
    from sepmc.report.flight_figure import flight_figure

    units = {name: row["unit"] for name, row in summary["channels"].items()}
    about = f"{folder.name}, {summary['cases']} cases; {summary['data']}"
    return flight_figure(curves, units, about, into / f"telemetry{suffix}")


def read_stored_flight(folder: Path) -> "tuple[pd.DataFrame, dict[str, Any]] | None":
    """Return curves and summary of the comparison with a flight in a run folder; None if there is
    none, or its files were changed."""
    import pandas as pd

    from sepmc.campaign.store import manifests

    if not all(manifests.is_recorded(folder, name) for name in _FILES[:2]):
        return None
    summary = json.loads((folder / _FILES[1]).read_text(encoding="utf-8"))
    return pd.read_csv(folder / _FILES[0]), summary


def check_options(two: Path | None, data: Path | None, others: dict[str, Any]) -> None:
    """Raise UsageError unless there is one of a second run and telemetry, and the options of
    telemetry come with it."""
    if (two is None) == (data is None):
        raise click.UsageError("give RUN_B, or the telemetry of a flight by --data")
    given = [name for name, value in others.items() if value not in (None, (), CASES)]
    if data is None and given:
        raise click.UsageError(f"--{given[0]} needs --data")
