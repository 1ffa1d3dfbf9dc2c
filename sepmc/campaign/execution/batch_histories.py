"""Histories of many cases of a campaign on common times, a few kernel calls for all of them."""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from sepmc import schema
from sepmc.campaign.definition import Definition
from sepmc.campaign.execution.integration import typical_durations
from sepmc.campaign.execution.step_selection import fallbacks, kernel_spec
from sepmc.engine.dispatch import integrate_histories, load_kernel, using_threads
from sepmc.engine.kernel_texts import written
from sepmc.engine.written_kernel import Kernel
from sepmc.routines.layout import FULL_HISTORY
from sepmc.scene.messages import Log
from sepmc.schema import Status

_FIRST_STEPS, _MOST_STEPS = 8, 1024  # of a segment
_TRIALS = 64  # cases that steps are selected with
_FINER = (4, 16)  # times the steps, for cases that the kernel rejects
_BYTES = 2**25  # of the rows of one call


@dataclass(frozen=True)
class _Way:
    """Kernel and arrays with which `BatchHistories` integrates cases.

    ``steps`` and ``durations`` (segments,) are the number of steps and the typical duration, s, of
    each segment. ``instants`` (m, 3) has the time, s, the segment and a 0, as in
    `integrate_histories`, of each history row that the kernel writes: all times in the first
    segment, then all in the second, ..., as the segment of a case at a time is not known before.
    """

    kernel: Kernel
    steps: np.ndarray
    durations: np.ndarray
    instants: np.ndarray

    @classmethod
    def of(cls, kernel: Kernel, steps: np.ndarray, times: np.ndarray) -> "_Way":
        """Make a `_Way` of a kernel with ``steps`` (segments,), the number in each segment. It has
        a row at each of the ``times`` (t,), s, in each segment, and infinite durations, which means
        that they are not known yet."""
        segments = range(kernel.n_segments)
        rows = [np.column_stack([times, np.full(len(times), k), 0 * times]) for k in segments]
        return cls(kernel, steps, np.full(kernel.n_segments, np.inf), np.concatenate(rows))

    def refined(self, factor: int) -> "_Way":
        """Return a copy with ``factor`` times the number of steps."""
        return replace(self, steps=factor * self.steps)


class BatchHistories:
    """Callable that integrates cases of a campaign and returns their histories on common times:
    an array (n, c, t) for n cases, c columns and t times, in the units of the columns.

    Creating one loads the kernel and selects the steps.

    Parameters
    ----------
    campaign : Definition
    names : sequence of str
        Names of the history columns to return, from `sepmc.schema.history_columns`.
    times : ndarray, shape (t,)
        Times of the history rows, s: rising, between 0 and the end time.
    tolerances : sequence of float
        For each column, the allowed root mean square over time of its numerical error, in its unit.
    trials : ndarray, shape (k, d)
        Inputs, in the units of the file, of the cases that the steps are selected with; only the
        first 64 are used.
    threads : int, optional
        Number of threads; all if None.
    announce : Log, optional
        Called with a message if a kernel is compiled.

    Attributes
    ----------
    error : float
        Largest numerical error of the trial cases, as a multiple of the tolerances; 0 if the file
        gives the step.
    """

    def __init__(
        self,
        campaign: Definition,
        names: Sequence[str],
        times: np.ndarray,
        tolerances: Sequence[float],
        trials: np.ndarray,
        threads: int | None = None,
        announce: Log | None = None,
    ):
        self._campaign, self._threads, self._announce = campaign, threads, announce
        columns = schema.history_columns(campaign.layout.contents)
        positions = {column.name: k for k, column in enumerate(columns)}
        self._columns = [positions[name] for name in names]
        self._scales = np.array([columns[k].scale for k in self._columns])
        # a number of every row
        self._always = positions[f"{campaign.layout.bodies[0]}_omega_x_deg_s"]
        self._times, self.error = times, 0.0
        self._rows = np.empty((0, 0, 0))  # of a call; new memory would take as long as the kernel
        spec = kernel_spec(campaign)
        self._fallbacks = fallbacks(campaign, spec, FULL_HISTORY)
        text = written(spec, campaign.scene.solver.method, FULL_HISTORY)
        kernel = load_kernel(text, announce)
        has_step = campaign.scene.solver.step is not None
        steps = np.full(kernel.n_segments, 1 if has_step else _FIRST_STEPS)
        self._way = _Way.of(kernel, steps, times)
        trials = trials[:_TRIALS]
        with using_threads(threads):
            if not has_step:
                self._select_steps(campaign.in_si(trials), np.asarray(tolerances))

    def _select_steps(self, trials: np.ndarray, tolerances: np.ndarray) -> None:
        """Double the steps until the root mean square over time of the change by the last doubling
        is within the tolerance in each column of each trial case, and the kernel rejects fewer
        than half of these cases; or until a segment has 1,024 steps. Sets steps and durations of
        this object, and `error`, the largest such change as a multiple of its tolerance.

        ``trials`` (k, d) are inputs, SI; ``tolerances`` (c,) are allowed errors by column, in the
        units of the columns.
        """
        before = None
        while True:
            status, histories, ends = self._integrate(self._way, trials)
            is_ok = status == Status.OK
            if is_ok.any():
                durations = typical_durations(ends, is_ok)
                if (durations > 0.0).all():
                    self._way = replace(self._way, durations=durations)
            if before is not None:
                with np.errstate(invalid="ignore"):
                    change = (histories - before) ** 2
                both = np.isfinite(change)
                mean = np.where(both, change, 0.0).sum(axis=2) / np.maximum(both.sum(axis=2), 1)
                self.error = float((np.sqrt(mean) / tolerances).max())
                rejected = float(np.mean(status < 0))
                if (self.error <= 1.0 and rejected < 0.5) or self._way.steps[0] >= _MOST_STEPS:
                    return
            before, self._way = histories, self._way.refined(2)

    def __call__(self, inputs: np.ndarray) -> np.ndarray:
        """Integrate cases and return their histories.

        Parameters
        ----------
        inputs : ndarray, shape (n, d)
            Inputs of n cases, in the units of the file.

        Returns
        -------
        ndarray, shape (n, c, t)
            Values of the c columns at the t times, in the units of the columns. NaN at times after
            the end of a case, and in all values of a case whose status is neither ok nor
            never-released.
        """
        return self.of_samples(self._campaign.in_si(inputs))

    def of_samples(self, samples: np.ndarray) -> np.ndarray:
        """Return the histories (n, c, t), as `__call__` does, of cases with inputs ``samples``
        (n, d) in SI; all NaN for a case whose status is neither ok nor never-released."""
        with using_threads(self._threads):
            status, histories, _ = self._integrate(self._way, samples)
            if self._campaign.scene.solver.step is None:
                for factor in _FINER:
                    self._repair(self._way.refined(factor), samples, status, histories)
            for fallback in self._fallbacks:
                if (status < 0).any():
                    kernel = fallback.make(self._announce)
                    counts = np.bincount(fallback.phases, self._way.steps, kernel.n_segments)
                    way = _Way.of(kernel, np.maximum(counts.astype(np.int64), 1), self._times)
                    self._repair(way, samples, status, histories)
        histories[(status != Status.OK) & (status != Status.NEVER_RELEASED)] = np.nan
        return histories

    def _repair(
        self, way: _Way, samples: np.ndarray, status: np.ndarray, histories: np.ndarray
    ) -> None:
        """Integrate the rejected cases (negative status) of ``samples`` (n, d), SI, with another
        kernel or other steps, ``way``; overwrite their ``status`` (n,) and ``histories`` (n, c, t)
        in place."""
        rejected = np.flatnonzero(status < 0)
        if len(rejected):
            status[rejected], histories[rejected], _ = self._integrate(way, samples[rejected])

    def _integrate(
        self, way: _Way, samples: np.ndarray
    ) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Integrate cases with inputs ``samples`` (n, d), SI; return their status (n,), histories
        (n, c, t) in the units of the columns, and end times, s, of segments (segments, n)."""
        campaign, segments = self._campaign, way.kernel.n_segments
        width = len(schema.history_columns(campaign.layout.contents))
        per_call = max(8, _BYTES // (8 * len(way.instants) * width) // 8 * 8)
        status = np.empty(len(samples), dtype=np.int64)
        histories = np.full((len(samples), len(self._columns), len(self._times)), np.nan)
        ends = np.empty((segments, len(samples)))
        shape = (min(per_call, len(samples)), len(way.instants), width)
        if self._rows.shape[1:] != shape[1:] or len(self._rows) < shape[0]:
            self._rows = np.empty(shape)
        for first in range(0, len(samples), per_call):
            part = slice(first, first + per_call)
            _, status[part], times, rows = integrate_histories(
                way.kernel,
                campaign.layout,
                way.steps,
                way.durations,
                campaign.slots,
                samples[part],
                way.instants,
                self._rows[: len(samples[part])],
            )
            ends[:, part] = times[:segments]
            rows = rows.reshape(len(rows), segments, len(self._times), width)
            for k in range(segments):
                own = np.moveaxis(rows[:, k][:, :, self._columns] * self._scales, 1, 2)
                is_here = np.isfinite(rows[:, k, :, self._always])[:, None]
                histories[part] = np.where(is_here, own, histories[part])
        return status, histories, ends


__all__ = ["BatchHistories"]
