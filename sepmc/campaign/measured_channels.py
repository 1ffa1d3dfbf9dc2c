"""Measurements of a campaign: samples read from telemetry files, and simulated histories
interpolated at the times of these samples."""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from sepmc import schema
from sepmc.analysis.full_turns import TURN, continuous, nearest_turn
from sepmc.campaign.definition import Definition
from sepmc.formats.telemetry import parse_map, read_telemetry
from sepmc.formats.text_table import FormatError
from sepmc.scene.measurements import Measurement
from sepmc.scene.messages import InputError

_MOST_SAMPLES = 1000  # of a channel; more are averaged in groups
_MIN_ROWS, _MOST_ROWS = 400, 1000  # of histories that are interpolated
_DELAYS = 4.0  # standard deviations of a delay that the samples used allow for


@dataclass(frozen=True)
class MeasuredChannel:
    """The m samples of one measurement that lie within the run.

    Attributes
    ----------
    column, unit : str
        History column that was measured, and its unit.
    time : ndarray, shape (m,)
        Times of the run, s, at the nominal delay.
    values, sigma : ndarray, shape (m,)
        Measured values and their standard deviations, in the unit of the column; if samples are
        averaged, those of the means.
    file : str
        Telemetry file, as given in the campaign.
    delay, delay_sigma : float
        Nominal value and standard deviation, s, of the delay: the time of the file's clock at
        time 0 of the run. It is known if ``delay_sigma`` is 0, else estimated.
    left_out : int
        Number of samples of the file that are not used, as they lie, or may lie with another
        delay, outside the run.
    averaged : int
        Number of samples of the file of which each value is the mean, the last one perhaps of
        fewer; 1 if none is averaged.
    wraps : bool
        True for an angle that stays within one turn: it is compared modulo 360 deg.
    """

    column: str
    unit: str
    time: np.ndarray
    values: np.ndarray
    sigma: np.ndarray
    file: str
    delay: float
    delay_sigma: float
    left_out: int
    averaged: int
    wraps: bool

    def only(self, kept: np.ndarray) -> "MeasuredChannel":
        """Return the channel with only the samples for which the mask ``kept`` (m,) is True."""
        return replace(self, time=self.time[kept], values=self.values[kept], sigma=self.sigma[kept])


def read_measurements(campaign: Definition) -> tuple[list[MeasuredChannel], list[str]]:
    """Read the telemetry of all measurements of a campaign.

    Parameters
    ----------
    campaign : Definition

    Returns
    -------
    channels : list of MeasuredChannel
        One for each measurement, in the order of the file.
    understood : list of str
        Sentences for the user on how each channel was interpreted.

    Raises
    ------
    InputError
        If a file cannot be read, or has fewer than two samples within the run.
    """
    columns = schema.history_columns(campaign.layout.contents)
    names, units = [c.name for c in columns], {c.name: c.unit for c in columns}
    channels, understood = [], list[str]()
    for number, one in enumerate(campaign.file.measurements):
        path, key_path = campaign.file.folder / one.file, f"measurement.{number}"
        channel = one.channel or one.column
        mapped = parse_map(f"{one.column} = {channel}", names, f"{key_path}.channel")
        try:
            series, sentences = read_telemetry(path, [mapped], names, one.time)
        except FormatError as error:
            raise InputError(f"{key_path}.file = {one.file}: {error}") from None
        except OSError as error:
            raise InputError(f"{key_path}.file = {one.file}: {error.strerror}") from None
        own = _within(one, units[one.column], *series[one.column], campaign.scene.run.end_time)
        if len(own.time) < 2:
            raise InputError(
                f"{key_path}: {one.file} has {len(own.time)} samples within the run with delay_s = "
                f"{one.delay:.14g}; must have at least two: set delay_s, the time of the file at "
                "time 0 of the run"
            )
        channels.append(own)
        understood += sentences
        if own.left_out:
            understood[-1] += f"; {own.left_out} outside the run"
        if own.wraps:
            understood[-1] += "; an angle, up to full turns"
        if own.averaged > 1:
            understood[-1] += f"; means of {own.averaged} samples each"
    return channels, understood


def _within(
    one: Measurement, unit: str, time: np.ndarray, values: np.ndarray, end: float
) -> MeasuredChannel:
    """Make the channel of the measurement ``one`` from the samples of its file.

    ``time`` (k,) is of the file's clock, s; ``values`` (k,) are in ``unit``; ``end`` is the end of
    the run, s. Samples are used that lie within the run at every probable delay (4 sigma); more
    than 1,000 are averaged in groups of consecutive ones. The channel is empty if there are none.
    """
    time, margin = time - one.delay, _DELAYS * one.delay_sigma
    inside = (time >= margin - 1e-9 * end) & (time <= end - margin + 1e-9 * end)
    left_out, time, values = int(np.count_nonzero(~inside)), time[inside], values[inside]
    wraps = unit == "deg" and len(values) > 0 and bool(np.ptp(values) <= TURN)
    group = -(-len(time) // _MOST_SAMPLES) or 1
    starts = np.arange(0, len(time), group)
    if not len(starts):
        time, values, sigma = np.empty((3, 0))
    else:
        counts = np.diff(starts, append=len(time))
        if wraps and group > 1:  # no means over jumps by a full turn
            values = continuous(values)
        time, values = (np.add.reduceat(x, starts) / counts for x in (time, values))
        sigma = one.sigma / np.sqrt(counts)
    time = np.clip(time, 0.0, end)
    return MeasuredChannel(
        one.column,
        unit,
        time,
        values,
        sigma,
        one.file,
        one.delay,
        one.delay_sigma,
        left_out,
        group,
        wraps,
    )


def history_times(channels: Sequence[MeasuredChannel], end: float) -> np.ndarray:
    """Choose the times at which cases are simulated: those of the samples, which all lie within the
    run, if all delays are known (``delay_sigma`` is 0) and there are at most 1,000. Else evenly
    spaced times, two per sample but 400 to 1,000, from 4 times the largest ``delay_sigma`` before
    the first sample to as much after the last, cut to the run.

    Parameters
    ----------
    channels : sequence of MeasuredChannel
    end : float
        End of the run, s.

    Returns
    -------
    ndarray, shape (t,)
        Times, s, rising.
    """
    times = np.unique(np.concatenate([channel.time for channel in channels]))
    margin = _DELAYS * max(channel.delay_sigma for channel in channels)
    if margin == 0.0 and len(times) <= _MOST_ROWS:
        return times
    count = int(np.clip(2 * len(times), _MIN_ROWS, _MOST_ROWS))
    return np.linspace(max(times[0] - margin, 0.0), min(times[-1] + margin, end), count)


def at_samples(
    values: np.ndarray, times: np.ndarray, channel: MeasuredChannel, delays: np.ndarray | None
) -> np.ndarray:
    """Interpolate the histories of n cases linearly at the times of the samples of a channel.

    Before the first and after the last history row, the values of that row are returned.

    Parameters
    ----------
    values : ndarray, shape (n, t)
        Histories of the column of the channel.
    times : ndarray, shape (t,)
        Times of the history rows, s.
    channel : MeasuredChannel
        With m samples.
    delays : ndarray, shape (n,) or None
        Deviation of the delay of the file from its nominal value in each case, s; it is subtracted
        from the times of the samples. None for 0.

    Returns
    -------
    ndarray, shape (n, m)
        Angles that wrap get full turns so that they are within half a turn of the measured ones.
    """
    samples = channel.time
    if delays is None:
        index = np.searchsorted(times, samples)
        if index[-1] < len(times) and (times[index] == samples).all():
            exact = np.asarray(values[:, index])
            return nearest_turn(exact, channel.values) if channel.wraps else exact
        delays = np.zeros(1)
    wanted = np.clip(samples - delays[:, None], times[0], times[-1])
    index = np.clip(np.searchsorted(times, wanted, side="right") - 1, 0, len(times) - 2)
    part = (wanted - times[index]) / (times[index + 1] - times[index])
    rows = np.broadcast_to(index, (len(values), len(samples)))
    low = np.take_along_axis(values, rows, axis=1)
    high = np.take_along_axis(values, rows + 1, axis=1)
    if channel.wraps:
        low = nearest_turn(low, channel.values)
        high = nearest_turn(high, low)
    return np.asarray((1.0 - part) * low + np.where(part > 0.0, part * high, 0.0))


__all__ = ["MeasuredChannel", "at_samples", "history_times", "read_measurements"]
