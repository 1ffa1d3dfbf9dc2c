"""Comparison of the telemetry of a flight with the cases of a run: clock shift, envelope,
residuals, nearest cases.

A channel is a measured quantity over time; it is compared with a column of the histories of the
cases, both in the unit of the column, angles up to full turns. The time of the flight's clock is
the time of the run plus the clock shift. The envelope is a band of percentiles of the cases at each
time.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from html import escape
from typing import Any

import numpy as np
import pandas as pd

from sepmc.analysis.full_turns import TURN, continuous, nearest_turn
from sepmc.scene.messages import InputError

INSIDE = 99.0  # %, of the band whose use is reported
CURVES = {"p0.5": 0.5, "p5": 5.0, "p50": 50.0, "p95": 95.0, "p99.5": 99.5}
_NORMAL = 2.5758293035489004  # half width of the 99 % band of noise, in sigmas
_NEAREST = 5  # cases listed
_SAMPLES = 2_000  # of a channel, that the shift is estimated from
_STEPS = 200  # of a coarse scan, over the duration of the run
_MOST_SHIFTS = 20_000  # of a coarse scan
_SCANS, _FINE = 3, 20  # fine scans, each of so many steps to either side
_REFERENCES = 8  # cases of a coarse scan beside the nominal one
_LEAST_NOISE = 1e-3  # of a channel, in units of its scale, in the weights of its samples
_WINDOW = 0.1  # of the run, to either side of the coarse scan: shifts that other cases may have
_OVERLAP = 0.5  # least part of the shorter of run and flight that must coincide
_MOST_LEFT_OUT = 0.05  # of the time that flight and run could share, without a note
_GIVE_SHIFT = "give the shift in s by --shift (shift_s in Python)"


@dataclass(frozen=True)
class Channel:
    """A measured quantity over time: a channel of telemetry.

    Attributes
    ----------
    time : ndarray, shape (m,)
        Times of the samples by the flight's clock, s, not falling.
    values : ndarray, shape (m,)
        Measured values, in the unit of the column they are compared with.
    unit : str
        Unit of the values.
    """

    time: np.ndarray
    values: np.ndarray
    unit: str = ""

    @property
    def is_angle(self) -> bool:
        """True if the unit is deg: values that differ by full turns then mean the same."""
        return self.unit == "deg"


@dataclass(frozen=True)
class Histories:
    """Histories of the cases of a run, all on one time grid.

    Attributes
    ----------
    numbers : ndarray of int, shape (n,)
        Case numbers.
    names : tuple of str, length c
        Column names.
    step : float
        Step of the time grid, which starts at 0, s.
    values : ndarray, shape (n, c, t)
        Value of each case, column and time, in the unit of the column; NaN after the end of a case.
    nominal : ndarray, shape (c, t)
        Values of the nominal case, likewise.
    """

    numbers: np.ndarray
    names: tuple[str, ...]
    step: float
    values: np.ndarray
    nominal: np.ndarray

    @property
    def times(self) -> np.ndarray:
        """Times (t,) of the grid, s."""
        return np.arange(self.values.shape[-1]) * self.step

    @property
    def end(self) -> float:
        """Last time of the grid, s."""
        return (self.values.shape[-1] - 1) * self.step


@dataclass(frozen=True)
class ClockShift:
    """Time of the flight's clock at time 0 of the run.

    Attributes
    ----------
    value, error : float
        The shift and its standard error, s; the error is 0 if the user gave the shift.
    is_estimated : bool
        False if the user gave the shift.
    """

    value: float
    error: float = 0.0
    is_estimated: bool = False


@dataclass(frozen=True, repr=False)
class FlightComparison:
    """Result of a comparison of a flight with the cases of a run.

    Attributes
    ----------
    shift : ClockShift
        Time of the flight's clock at time 0 of the run.
    n_cases : int
        Number of cases that form the envelope.
    channels : DataFrame
        A row per channel, indexed by its column: ``unit``; number of ``samples`` within the run;
        ``noise``, its sigma, from second differences; ``envelope_used``, the largest distance from
        the median of the cases over the width of their 99 % band on that side of the median
        (widened by the noise), and its time ``envelope_used_at_s``; ``inside_99``, the fraction
        of the time within that band; ``residual_rms`` and ``residual_max``, of flight minus nominal
        case, and its time ``residual_max_at_s``.
    curves : DataFrame
        A row per channel and sample: channel, time_s (of the run), flight, nominal, and the
        percentiles p0.5 to p99.5 of the cases.
    nearest : list of (int, float)
        Case number and distance of the five nearest cases, the nearest first. The distance is the
        rms difference from the flight over all samples, each in units of the combined spread of the
        cases and noise of its channel.
    left_out : float
        Fraction, 0 to 1, of the time that flight and run could share which lies outside the run at
        this shift, for the channel where it is largest. More than 0.05 suggests a wrong sign,
        factor or unit.
    run, data : str
        Name of the run, and of the file of telemetry.
    channels_read : tuple of str
        A text for each channel on how it was read from the file.
    """

    shift: ClockShift
    n_cases: int
    channels: pd.DataFrame
    curves: pd.DataFrame
    nearest: list[tuple[int, float]]
    left_out: float = 0.0
    run: str = ""
    data: str = ""
    channels_read: tuple[str, ...] = ()

    def __repr__(self) -> str:
        case, distance = self.nearest[0]
        return (
            f"<FlightComparison of {self.run} and {self.data}, {self.n_cases} cases: clock shift "
            f"{self.shift.value:.14g} s, nearest case {case} ({distance:.3g})>"
        )

    def _repr_html_(self) -> str:
        """Return the summary and the table of the channels as HTML, for notebooks."""
        return f"<p>{escape(repr(self))}</p>{self.channels.to_html()}"

    @property
    def notes(self) -> list[str]:
        """Notes for the user, a list: one if the shift leaves more than 5 % of the time that flight
        and run could share outside the run, else none."""
        if self.left_out <= _MOST_LEFT_OUT:
            return []
        return [
            f"this shift leaves {100.0 * self.left_out:.0f} % of the time that flight and run "
            "could share outside the run: check sign, factor and unit of the channels, or "
            f"{_GIVE_SHIFT}"
        ]

    def to_dict(self) -> dict[str, Any]:
        """Return the content of ``telemetry.json``.

        Returns
        -------
        dict
            JSON types by key; all but the curves and the name of the run.
        """
        return {
            "data": self.data,
            "channels_read": list(self.channels_read),
            "cases": self.n_cases,
            "clock_shift_s": self.shift.value,
            "clock_shift_error_s": self.shift.error,
            "clock_shift_is_estimated": self.shift.is_estimated,
            "channels": {str(k): row for k, row in self.channels.to_dict("index").items()},
            "left_out": self.left_out,
            "nearest": [{"case": case, "distance": distance} for case, distance in self.nearest],
        }

    @classmethod
    def from_dict(
        cls, content: Mapping[str, Any], curves: pd.DataFrame, run: str
    ) -> "FlightComparison":
        """Restore a comparison from the content of ``telemetry.json`` and ``telemetry.csv``.

        Parameters
        ----------
        content : mapping
            From `to_dict`, or with None in place of numbers that are not finite.
        curves : DataFrame
            The attribute ``curves``, from ``telemetry.csv``.
        run : str
            Name of the run.

        Returns
        -------
        FlightComparison
        """
        channels = pd.DataFrame.from_dict(content["channels"], orient="index")
        channels.index.name = "channel"
        return cls(
            ClockShift(
                content["clock_shift_s"],
                content["clock_shift_error_s"],
                content["clock_shift_is_estimated"],
            ),
            content["cases"],
            channels,
            curves,
            [(each["case"], each["distance"]) for each in content["nearest"]],
            content["left_out"],
            run,
            content["data"],
            tuple(content["channels_read"]),
        )


def noise_of(values: np.ndarray) -> float:
    """Return the standard deviation of the noise in a channel, from the median of its absolute
    second differences, so that single outliers do not count; samples are taken as equally spaced.

    Parameters
    ----------
    values : ndarray, shape (m,)
        Samples in the order of time.

    Returns
    -------
    float
        In the unit of the values; 0 for fewer than five values.
    """
    if len(values) < 5:
        return 0.0
    return float(1.4826 * np.median(np.abs(np.diff(values, 2))) / np.sqrt(6.0))


def compare_channels(
    channels: Mapping[str, Channel], histories: Histories, shift_s: float | None = None
) -> FlightComparison:
    """Compare the channels of a flight with the cases of a run.

    Parameters
    ----------
    channels : mapping of column to Channel
    histories : Histories
        Histories of the cases in these columns.
    shift_s : float, optional
        Time of the flight's clock at time 0 of the run; estimated if None.

    Returns
    -------
    FlightComparison

    Raises
    ------
    InputError
        If a channel has fewer than two samples within the run, or the shift cannot be estimated.
    """
    ordered = [channels[name] for name in histories.names]
    ordered = [replace(c, values=continuous(c.values)) if c.is_angle else c for c in ordered]
    histories = _continuous(histories, ordered)
    scales = _scales(ordered, histories)
    shift = ClockShift(shift_s or 0.0)
    if shift_s is None:
        shift = _estimate_shift(ordered, histories, scales)
    rows, curves, squares, count = [], [], np.zeros(len(histories.numbers)), 0
    left_out = 0.0
    for i, (name, channel) in enumerate(zip(histories.names, ordered, strict=True)):
        time, flight = _within(channel, shift.value, histories.end)
        if len(time) < 2:
            raise InputError(
                f"{name}: the flight has {len(time)} samples within the run (0 to "
                f"{histories.end:g} s) at a clock shift of {shift.value:.14g} s; must have at "
                "least two"
            )
        shared = min(float(np.ptp(channel.time)), histories.end)
        left_out = max(left_out, 1.0 - float(np.ptp(time)) / shared)
        cases = _at(histories.values[:, i], histories.step, time)
        nominal = _at(histories.nominal[None, i], histories.step, time)[0]
        if channel.is_angle:
            flight = np.where(np.isfinite(nominal), nearest_turn(flight, nominal), flight)
        bands = np.nanpercentile(cases, list(CURVES.values()), axis=0)
        low, _, median, _, high = bands
        noise = _NORMAL * noise_of(channel.values)
        half = np.hypot(np.where(flight > median, high - median, median - low), noise)
        used = np.abs(flight - median) / np.where(half > 0.0, half, np.inf)
        used[(half == 0.0) & (flight != median)] = np.inf
        weights = np.gradient(time) if np.ptp(time) > 0.0 else np.ones(len(time))
        residual = flight - nominal
        worst, largest = int(np.nanargmax(used)), int(np.nanargmax(np.abs(residual)))
        rows.append(
            {
                "unit": channel.unit,
                "samples": len(time),
                "noise": noise / _NORMAL,
                "envelope_used": used[worst],
                "envelope_used_at_s": time[worst],
                "inside_99": float(weights[used <= 1.0].sum() / weights.sum()),
                "residual_rms": float(np.sqrt(np.nanmean(residual**2))),
                "residual_max": residual[largest],
                "residual_max_at_s": time[largest],
            }
        )
        table = {"channel": name, "time_s": time, "flight": flight, "nominal": nominal}
        curves.append(pd.DataFrame(table | dict(zip(CURVES, bands, strict=True))))
        squares += _sum_squares((cases - flight) / scales[i])
        count += len(time)
    distances = np.sqrt(squares / count)
    order = np.argsort(distances, kind="stable")[:_NEAREST]
    return FlightComparison(
        shift,
        len(histories.numbers),
        pd.DataFrame(rows, index=pd.Index(histories.names, name="channel")),
        pd.concat(curves, ignore_index=True),
        [(int(histories.numbers[k]), float(distances[k])) for k in order],
        left_out,
    )


def _continuous(histories: Histories, channels: Sequence[Channel]) -> Histories:
    """Return histories whose angles do not jump by full turns: neither over time nor, at the start,
    from the nominal case (`Histories.nominal`) to another. ``channels`` are in the order of the
    columns; those that are no angles are unchanged."""
    values, nominal = np.array(histories.values), np.array(histories.nominal)
    for i, channel in enumerate(channels):
        if channel.is_angle:
            nominal[i], curves = continuous(nominal[i]), continuous(values[:, i])
            offset = nearest_turn(curves[:, :1], nominal[i, :1]) - curves[:, :1]
            values[:, i] = curves + np.nan_to_num(offset)
    return replace(histories, values=values, nominal=nominal)


def _scales(channels: Sequence[Channel], histories: Histories) -> list[float]:
    """Return for each channel the scale of its differences, in its unit: the root of the sum of the
    squares of the spread of the cases (rms over time) and of the noise of the channel, but at least
    1e-9 of the largest absolute value of the cases; 1 if all of these are 0."""
    scales = []
    for i, channel in enumerate(channels):
        values = histories.values[:, i]
        variance = float(np.nanmean(np.nanvar(values, axis=0)))
        scale = np.hypot(np.sqrt(variance), noise_of(channel.values))
        extent = float(np.nanmax(np.abs(values), initial=0.0))
        scales.append(max(float(scale), 1e-9 * extent) or 1.0)
    return scales


def _within(channel: Channel, shift: float, end: float) -> tuple[np.ndarray, np.ndarray]:
    """Return the samples of a channel that lie within the run, 0 to ``end`` (s), at a clock
    ``shift`` (s): their times (k,) in the time of the run, s, and their values (k,)."""
    time = channel.time - shift
    first, last = np.searchsorted(time, [-1e-9 * end, end * (1 + 1e-9)])
    return np.clip(time[first:last], 0.0, end), channel.values[first:last]


def _at(values: np.ndarray, step: float, times: np.ndarray) -> np.ndarray:
    """Return the values (n, m) of histories (n, t), on a grid with a ``step`` from time 0, at times
    (m,) or at a row of times (n, m) for each case; linear in between, NaN outside the grid."""
    position = times / step
    index = np.clip(position.astype(np.int64), 0, values.shape[1] - 2)
    part = position - index
    if times.ndim == 1:
        low, high = values[:, index], values[:, index + 1]
    else:
        low, high = (np.take_along_axis(values, k, axis=1) for k in (index, index + 1))
    inside = (position >= -1e-9) & (position <= values.shape[1] - 1 + 1e-9)
    return np.where(inside, low + part * (high - low), np.nan)


def _sum_squares(differences: np.ndarray) -> np.ndarray:
    """Return the sums (n,) of the squares of differences (n, m) of n cases. A square that is not
    finite counts as the mean of the finite ones of its case; the sum is infinite without these."""
    squares = differences**2
    known = np.isfinite(squares)
    total, count = np.where(known, squares, 0.0).sum(axis=1), known.sum(axis=1)
    return np.where(count > 0, total * squares.shape[1] / np.maximum(count, 1), np.inf)


@dataclass(frozen=True)
class _Curves:
    """Histories of the cases for one channel, in units of its scale (`_scales`).

    Attributes
    ----------
    values : ndarray, shape (n, t)
        A row per case, on the time grid.
    weights : ndarray, shape (n, t)
        Weight of a flight sample between a grid time and the next: v / (v + b^2), with the variance
        v of the noise and the second difference b of the history there. It is nearly 1 where the
        history is smooth, and small where it jumps or bends: that time is known to a step only.
    step : float
        Step of the time grid, s.
    turn : float
        Full turn of an angle, in units of the scale: multiples of it are taken off its differences;
        0 for other channels.
    """

    values: np.ndarray
    weights: np.ndarray
    step: float
    turn: float

    @classmethod
    def of(
        cls, values: np.ndarray, scale: float, noise: float, step: float, is_angle: bool
    ) -> "_Curves":
        """Build the curves from histories (n, t), the ``scale`` and the ``noise`` sigma, all in the
        unit of the channel, and the ``step`` of the time grid, s. Where a history bends from row to
        row by more than the noise, it gets a smaller weight. ``is_angle`` is true for an angle:
        full turns do not count in its differences (`differences`); its values stay as they are."""
        scaled = values / scale
        bend = np.zeros_like(scaled)
        bend[:, 1:-1] = np.abs(np.diff(scaled, 2, axis=1))
        bend[:, :-1] = np.maximum(bend[:, :-1], bend[:, 1:])
        variance = max(noise / scale, _LEAST_NOISE) ** 2
        weights = variance / (variance + np.nan_to_num(bend, nan=np.inf) ** 2)
        return cls(scaled, weights, step, TURN / scale if is_angle else 0.0)

    def differences(
        self, time: np.ndarray, flight: np.ndarray, shifts: np.ndarray | float
    ) -> tuple[np.ndarray, np.ndarray]:
        """Return the differences (n, m), history minus flight, and their weights (n, m); both are 0
        where a history has no value.

        ``flight`` (m,) are samples in units of the scale, ``time`` (m,) their times by the flight's
        clock, s; ``shifts`` is one clock shift for all cases, or one for each (n,), s, which is
        subtracted from ``time``. Differences of an angle lie within half a turn.
        """
        times = _run_times(time, shifts)
        residual = _at(self.values, self.step, times) - flight
        if self.turn:
            residual -= self.turn * np.round(residual / self.turn)
        index = np.clip((times / self.step).astype(np.int64), 0, self.values.shape[1] - 1)
        if times.ndim == 1:
            weights = self.weights[:, index]
        else:
            weights = np.take_along_axis(self.weights, index, axis=1)
        known = np.isfinite(residual)
        return np.where(known, residual, 0.0), np.where(known, weights, 0.0)

    def slopes(self, times: np.ndarray) -> np.ndarray:
        """Return the slopes (n, m) of the histories, per s, at times (m,) or (n, m) of the run; 0
        where a history has no slope."""
        slopes = _at(np.gradient(self.values, self.step, axis=1), self.step, times)
        return np.nan_to_num(slopes, nan=0.0)

    def only(self, case: int) -> "_Curves":
        """Return the curves of the case with index ``case`` alone."""
        part = slice(case, case + 1)
        return _Curves(self.values[part], self.weights[part], self.step, self.turn)


Samples = Sequence[tuple[np.ndarray, np.ndarray]]


def _estimate_shift(
    channels: Sequence[Channel], histories: Histories, scales: Sequence[float]
) -> ClockShift:
    """Estimate the clock shift: each case has a best shift, and that of the nearest case is used.

    ``scales`` are those of `_scales`. The error combines that of a least-squares fit with the
    residuals of that case, correlated in time, and the spread of the best shifts of the other
    cases, weighted by how near they are. Raises InputError if no shift can be estimated.
    """
    noise = [noise_of(channel.values) for channel in channels]
    start, step = _coarse_shift(channels, histories, scales, noise)
    width = max(2.0 * step, _WINDOW * histories.end)
    samples = []
    for channel, scale in zip(channels, scales, strict=True):
        time, values = _within(channel, start - width, histories.end + 2.0 * width)
        stride = -(-len(time) // _SAMPLES) or 1
        samples.append((time[::stride] + start - width, values[::stride] / scale))
    curves = [
        _Curves.of(histories.values[:, i], scales[i], noise[i], histories.step, each.is_angle)
        for i, each in enumerate(channels)
    ]
    shifts, resolution = np.full(len(histories.numbers), start), width
    for _ in range(_SCANS):  # the jumps of a history have no slopes to go by
        offsets = resolution * np.linspace(-1.0, 1.0, 2 * _FINE + 1)
        fits = np.array([_mean_squares(samples, curves, shifts + offset) for offset in offsets])
        fits = np.where(np.isfinite(fits), fits, np.inf)
        shifts, squares = shifts + offsets[fits.argmin(axis=0)], fits.min(axis=0)
        resolution /= _FINE
    best = int(squares.argmin())
    own = [each.only(best) for each in curves]
    variance, effective = _variance(samples, own, shifts[best : best + 1])
    if not np.isfinite(variance):
        raise InputError(
            "clock shift: the cases do not change over time in these columns, so it cannot be "
            f"estimated; {_GIVE_SHIFT}"
        )
    variance += resolution**2 / 12.0
    least = max(float(squares[best]), 1e-300)
    weights = np.exp(-0.5 * effective * np.minimum(squares / least - 1.0, 1e6))
    spread = float(np.sum(weights * (shifts - shifts[best]) ** 2) / weights.sum())
    return ClockShift(float(shifts[best]), float(np.sqrt(variance + spread)), True)


def _coarse_shift(
    channels: Sequence[Channel],
    histories: Histories,
    scales: Sequence[float],
    noise: Sequence[float],
) -> tuple[float, float]:
    """Scan all clock shifts at which flight and run overlap enough, for the nominal and a few other
    cases; return the shift at which any of them is nearest, and the step of the scan, s.

    A shift is the time of the flight's clock at time 0 of the run. ``scales`` (as of `_scales`) and
    ``noise`` (sigma) have a number for each channel, in its unit. Raises InputError if the channels
    have no time in common or overlap with the run at no shift.
    """
    first = max(channel.time[0] for channel in channels)
    last = min(channel.time[-1] for channel in channels)
    overlap = _OVERLAP * min(last - first, histories.end)
    if not overlap > 0.0:
        raise InputError(
            "clock shift: cannot be estimated, as the channels have no time in common; "
            f"{_GIVE_SHIFT}"
        )
    low, high = first - histories.end + overlap, last - overlap
    step = max(histories.end / _STEPS, (high - low) / _MOST_SHIFTS)
    count = len(histories.numbers)
    chosen = np.linspace(0, count - 1, min(_REFERENCES, count)).round().astype(int)
    curves = [
        _Curves.of(
            np.vstack([histories.nominal[None, i], histories.values[chosen, i]]),
            scales[i],
            noise[i],
            histories.step,
            each.is_angle,
        )
        for i, each in enumerate(channels)
    ]
    best = (np.inf, 0.0)
    for shift in np.arange(low, high + 0.5 * step, step):
        samples = []
        for channel, scale in zip(channels, scales, strict=True):
            time, values = _within(channel, shift, histories.end)
            stride = -(-len(time) // (2 * _STEPS)) or 1
            samples.append((time[::stride] + shift, values[::stride] / scale))
        squares = np.nan_to_num(_mean_squares(samples, curves, shift), nan=np.inf)
        best = min(best, (float(squares.min()), float(shift)))
    if not np.isfinite(best[0]):
        raise InputError(
            "clock shift: cannot be estimated, as flight and run overlap at no shift; "
            f"{_GIVE_SHIFT}"
        )
    return best[1], float(step)


def _run_times(time: np.ndarray, shifts: np.ndarray | float) -> np.ndarray:
    """Return times by the flight's clock (m,) as times of the run: ``time`` minus the clock shift,
    s; (m,) for one shift, (n, m) for one of each of n cases (n,)."""
    return time - shifts if np.ndim(shifts) == 0 else time - np.asarray(shifts)[:, None]


def _mean_squares(
    samples: Samples, curves: Sequence[_Curves], shifts: np.ndarray | float
) -> np.ndarray:
    """Return for each case the weighted mean square (n,) of its differences from the flight, over
    the samples of all channels; weights are those of `_Curves`, by the bends of the histories.

    ``samples`` are (times by the flight's clock, s; values) of each channel, and ``curves`` the
    histories of the cases for each channel, both in units of its scale. ``shifts`` is one clock
    shift, or one for each case (n,), s. NaN if a case has no value at any of the times.
    """
    total = count = np.zeros(len(curves[0].values))
    for (time, flight), own in zip(samples, curves, strict=True):
        residual, weights = own.differences(time, flight, shifts)
        total = total + (weights * residual**2).sum(axis=1)
        count = count + weights.sum(axis=1)
    return np.where(count > 0.0, total / np.where(count > 0.0, count, 1.0), np.nan)


def _variance(
    samples: Samples, curves: Sequence[_Curves], shift: np.ndarray
) -> tuple[float, float]:
    """Return the variance, s^2, of the best ``shift`` (1,) of a single case, and the number of
    independent samples.

    ``samples`` and ``curves``, of this case alone, are as for `_mean_squares`. Residuals that are
    correlated in time count as fewer, by their correlation from one sample to the next. Channels
    with fewer than three samples are left out. The variance is infinite if none is left, or if the
    case does not change over time in those left.
    """
    top = bottom = effective = 0.0
    for (time, flight), own in zip(samples, curves, strict=True):
        residual, weights = (x[0] for x in own.differences(time, flight, shift))
        slope = own.slopes(_run_times(time, shift))[0]
        count = float(weights.sum())
        if count < 3.0:
            continue
        variance = float((weights * residual**2).sum()) / count
        weighted = np.sqrt(weights) * residual
        product = float((weighted[1:] * weighted[:-1]).sum()) / count
        correlation = min(max(product / variance, 0.0), 1.0 - 1.0 / count) if variance else 0.0
        inflation = (1.0 + correlation) / (1.0 - correlation)
        information = float((weights * slope**2).sum())
        top += variance * inflation * information
        bottom += information
        effective += count / inflation
    return (top / bottom**2 if bottom > 0.0 else np.inf), effective
