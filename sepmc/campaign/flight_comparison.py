"""Comparison of a run with the telemetry of a flight: reads the channels of the file, and finds the
histories of the cases that form the envelope."""

import math
from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from sepmc import schema
from sepmc.analysis.statistics import ok_rows
from sepmc.analysis.telemetry import Channel, FlightComparison, Histories, compare_channels
from sepmc.campaign.execution.batch_histories import BatchHistories
from sepmc.campaign.store import shards
from sepmc.formats.telemetry import parse_map, read_telemetry
from sepmc.formats.text_table import FormatError
from sepmc.scene.messages import InputError, Log, shorten

if TYPE_CHECKING:
    from sepmc.campaign.result import Result

CASES = 300  # simulated again for the envelope, by default
_MIN_ROWS, _MOST_ROWS = 200, 1000  # of a history
_NUMERICAL = 1e-6  # error of a history, of the extent of its channel
_STORED = 20_000  # cases with stored histories that are read


def compare_with_flight(
    result: "Result",
    data: Path,
    mapping: Mapping[str, str],
    time: str | None,
    shift_s: float | None,
    cases: int,
    announce: Log,
) -> FlightComparison:
    """Compare a run with the telemetry of a flight, the file ``data``.

    Parameters, result and errors are those of `Result.compare_flight`: ``mapping`` (its ``map``)
    has the channel of the file by history column, if empty the channels with the name of a column
    are used; ``time`` is the channel of time (None: one with a usual name); ``shift_s`` is the time
    of the flight's clock at time 0 of the run (None: estimated); ``cases`` is the number of cases
    that are simulated again if the run did not store these columns; ``announce`` receives messages.
    """
    if not isinstance(mapping, Mapping):
        example = '{"upper_omega_y_deg_s": "-gyro_z[rad/s]"}'
        raise InputError(
            f"map = {shorten(mapping)}: must be a dict of channels of the file by history column, "
            f"as {example}"
        )
    is_number = isinstance(shift_s, int | float) and not isinstance(shift_s, bool)
    if shift_s is not None and not (is_number and math.isfinite(shift_s)):
        raise InputError(
            f"shift_s = {shorten(shift_s)}: must be a finite number of seconds, or None"
        )
    columns = {c.name: c.unit for c in schema.history_columns(result.campaign.layout.contents)}
    mapped = [parse_map(f"{column}={text}", list(columns)) for column, text in mapping.items()]
    try:
        brought, understood = read_telemetry(data, mapped, list(columns), time)
    except FormatError as error:
        raise InputError(f"{data}: {error}") from None
    for sentence in understood:
        announce(sentence)
    channels = {name: Channel(*each, columns[name]) for name, each in brought.items()}
    comparison = compare_channels(channels, _histories(result, channels, cases, announce), shift_s)
    run = result.folder.name if result.folder else result.campaign.name
    return replace(comparison, run=run, data=data.name, channels_read=tuple(understood))


def _histories(
    result: "Result", channels: Mapping[str, Channel], cases: int, announce: Log
) -> Histories:
    """Return histories of ok cases, and of the nominal case, in the columns that ``channels`` has
    data of. Those of the ok cases are the ones stored by the run if it has all these columns, else
    the first ``cases`` ok cases are simulated again. The nominal case is always simulated.
    ``announce`` receives a message that says where the histories are from. Raises InputError if no
    case is ok."""
    campaign, rows, names = result.campaign, result.table, tuple(channels)
    numbers = np.sort(np.asarray(rows["case"])[ok_rows(rows)])
    if not len(numbers):
        raise InputError("no case of the run has the status ok, so there is no envelope to compare")
    end = campaign.scene.run.end_time
    stored, chosen = _stored_histories(result, names, numbers), numbers[:cases]
    if stored is not None:
        numbers, step, values = stored
        announce(f"envelope: stored histories of {len(numbers)} cases")
        times = np.arange(values.shape[-1]) * step
    else:
        announce(f"envelope: {len(chosen)} of {len(numbers)} ok cases, simulated again ...")
        numbers = chosen
        spacing = min(float(np.median(np.diff(c.time))) for c in channels.values())
        count = int(np.clip(end / spacing if spacing > 0.0 else 0, _MIN_ROWS, _MOST_ROWS))
        times = np.linspace(0.0, end, count + 1)
    own = [campaign.sample(int(number), 1, result.seed, result.total) for number in chosen]
    inputs = np.concatenate(own)
    tolerances = [_NUMERICAL * float(np.ptp(c.values)) or np.inf for c in channels.values()]
    simulate = BatchHistories(campaign, names, times, tolerances, inputs, None, announce)
    if stored is None:
        values = simulate(inputs)
    nominal = simulate.of_samples(campaign.layout.nominal[None, campaign.slots])[0]
    return Histories(numbers, names, float(times[1]), values, nominal)


def _stored_histories(
    result: "Result", names: tuple[str, ...], ok: np.ndarray
) -> tuple[np.ndarray, float, np.ndarray] | None:
    """Return the stored histories of ok cases: their case numbers (n,), the step of the time grid,
    s, and the values (n, c, t) of the c columns ``names``.

    ``ok`` are the case numbers with status ok. Of a run folder only the first `_STORED` stored
    cases are read. None if the run stored no histories, not all of these columns, fewer than two
    rows of a case, or different numbers of rows (then there is no common time grid).
    """
    if not {c.name for c in result.campaign.stored_history_columns()} >= set(names):
        return None
    if result.folder:
        frame = shards.read_histories(result.folder, shards.case_after(result.folder, _STORED))
    else:
        frame = result.histories()
    if frame is None:
        return None
    frame = frame[frame["case"].isin(ok)]
    numbers, counts = np.unique(frame["case"].to_numpy(), return_counts=True)
    if not len(numbers) or counts[0] < 2 or (counts != counts[0]).any():
        return None
    values = frame[list(names)].to_numpy(dtype=float).reshape(len(numbers), counts[0], len(names))
    return numbers, result.campaign.scene.run.history_step, np.moveaxis(values, 1, 2)
