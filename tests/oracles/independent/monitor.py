"""Monitored quantities of a simulation: peaks of joint loads with their times, impulses, pin loads
and jamming."""

import math
from collections.abc import Callable
from functools import cache, partial
from itertools import pairwise
from typing import Any

import numpy as np
from scipy.optimize import minimize_scalar

from oracles.independent.case import Table
from oracles.independent.guides import contacts, slides, total
from oracles.independent.motion import Motion
from oracles.independent.state import Array, State

_SAMPLES = 8  # intervals of a step in which peaks and kinks are bracketed
_NODES, _WEIGHTS = np.polynomial.legendre.leggauss(6)
# allowed difference of whole and halves, relative to the impulse so far; maximum bisections
_QUADRATURE, _HALVINGS = 1e-11, 20
# relative difference of two peaks that count as equal; time between them, s
_FLAT, _DISTINCT = 1e-11, 1e-6
# round-off of a load that is zero, relative to the largest load of a step plus the vehicle's mass
# at 1 m/s2
_ROUND_OFF = 1e-14


class _Instant:
    """Motion at a time: wrenches of the joints, friction of the guides."""

    def __init__(self, motion: Motion, t: float, s: State):
        self.t, self.s = t, s
        _, added, rows, self.friction = motion.at(t, s)
        self.wrenches = motion.wrenches_of(s, added, rows)


class Monitor:
    """Peaks and integrals of a simulation, step by step. ``peaks``: value and time by quantity."""

    def __init__(self, motion: Motion, output: Table):
        self.motion, self.loads, self.guides = motion, list(output["loads"]), list(output["guide"])
        self.peaks: dict[Any, tuple[float, float]] = {}
        self.integrals = dict.fromkeys(
            [(name, quantity) for name in self.loads for quantity in ("force", "moment")], 0.0
        )
        self.in_guide = dict.fromkeys(self.guides, 0.0)
        self.noise = 0.0  # round-off of a load that is zero in the last step
        # earliest and latest time at which a peak was reached within _FLAT
        self.spans: dict[Any, tuple[float, float]] = {}

    def quantities(self) -> list[Any]:
        """Quantities that exist with the present active rows."""
        active, joints = self.motion.sequence.active, self.motion.joints
        quantities: list[Any] = [
            (name, quantity)
            for name in self.loads
            if active[name]
            for quantity in ("force", "moment")
        ]
        for name in self.guides:
            if slides(active[name]):
                quantities += [(name, pin) for pin in range(joints[name].guide["pins"])] + [
                    (name, "jam")
                ]
        return quantities

    def value(self, quantity: Any, instant: "_Instant") -> float:
        """Value of a quantity at an instant; its peak is its maximum."""
        name, kind = quantity
        joint = self.motion.joints[name]
        if kind in ("force", "moment"):
            return float(np.linalg.norm(instant.wrenches[name][0 if kind == "force" else 1]))
        if kind == "jam":
            drive, *wrench = self.motion.driving_force(name, instant.t, instant.s, instant.friction)
            contact_load = total(contacts(joint, instant.s, *wrench))
            return -drive / contact_load if contact_load > 0.0 else -math.inf
        loads = contacts(joint, instant.s, *instant.wrenches[name])[:, kind]
        return float(np.sqrt(np.sum(loads**2, axis=-1)).max())

    def step(self, dense: Callable[[float], Array], start: float, end: float) -> None:
        """Update peaks and integrals from the dense output of a step."""
        for name in self.guides:
            self.in_guide[name] += end - start if slides(self.motion.sequence.active[name]) else 0.0
        quantities_now = self.quantities()
        if not quantities_now or end <= start:
            return

        @cache
        def instant(t: float) -> _Instant:
            return _Instant(self.motion, t, self.motion.vehicle.state(t, dense(t)))

        @cache
        def value(quantity: Any, t: float) -> float:
            return self.value(quantity, instant(t))

        times = np.linspace(start, end, _SAMPLES + 1)
        table = np.array(
            [[value(quantity, float(t)) for quantity in quantities_now] for t in times]
        )
        noise = self.noise = _ROUND_OFF * (
            float(np.abs(table[np.isfinite(table)]).max(initial=0.0))
            + float(self.motion.vehicle.mass.sum())
        )
        for i, quantity in enumerate(quantities_now):
            of_time = partial(value, quantity)
            kinks = self._extremes(quantity, of_time, times, table[:, i])
            if quantity in self.integrals:
                self.integrals[quantity] += sum(
                    _integral(of_time, *ends, self.integrals[quantity], noise * (end - start))
                    for ends in pairwise([start, *kinks, end])
                )

    def _extremes(
        self, quantity: Any, value: Callable[[float], float], times: Array, values: Array
    ) -> list[float]:
        """Update the peaks of a quantity; returns the times of its minima, where the magnitude of a
        vector may have a kink."""
        kinks = []
        for i, t in enumerate(times):
            self._update_peak(quantity, float(values[i]), float(t))
            near = values[max(i - 1, 0) : i + 2]
            low, high = times[max(i - 1, 0)], times[min(i + 1, len(times) - 1)]
            if not np.isfinite(near).all() or np.ptp(near) == 0.0:
                continue
            if values[i] == near.max() and 2.0 * values[i] - near.min() > self._maximum(quantity):
                top = minimize_scalar(
                    lambda x: -value(x),
                    bounds=(low, high),
                    method="bounded",
                    options={"xatol": 1e-11},
                ).x
                self._update_peak(quantity, value(top), float(top))
            elif (
                values[i] == near.min()
                and 0 < i < len(times) - 1
                and 2.0 * values[i] < near.max()
                and quantity in self.integrals
            ):
                kinks.append(
                    float(
                        minimize_scalar(
                            value, bounds=(low, high), method="bounded", options={"xatol": 1e-13}
                        ).x
                    )
                )
        return kinks

    def _maximum(self, quantity: Any) -> float:
        """Maximum so far; zero at first for a joint load."""
        return self.peaks.get(
            quantity, (0.0 if quantity in self.integrals else -math.inf, math.nan)
        )[0]

    def _update_peak(self, quantity: Any, value: float, t: float) -> None:
        """Update maximum, its time and the interval in which it is reached."""
        best = self._maximum(quantity)
        if abs(value - best) <= _FLAT * abs(best) and quantity in self.spans:
            self.spans[quantity] = min(self.spans[quantity][0], t), max(self.spans[quantity][1], t)
        elif value > best:
            self.spans[quantity] = t, t
        if value > best:
            self.peaks[quantity] = value, t

    def flat_peaks(self) -> list[str]:
        """Names of the times of peaks that are round-off only, or that are reached at several
        times."""
        return [
            f"{name}_peak_{quantity}_time_s"
            for name in self.loads
            for quantity in ("force", "moment")
            for first, last in [self.spans.get((name, quantity), (0.0, 0.0))]
            if last - first > _DISTINCT or self._maximum((name, quantity)) <= self.noise
        ]

    def reached(self) -> dict[str, tuple[float, float]]:
        """Earliest and latest time, s, at which every peak of a joint load was reached within
        1e-11, by the name of its time outcome."""
        return {
            f"{name}_peak_{quantity}_time_s": span
            for (name, quantity), span in self.spans.items()
            if quantity in ("force", "moment")
        }

    def report(self) -> dict[str, float]:
        """Outcomes by public name."""
        out: dict[str, float] = {}
        for name in self.loads:
            for quantity, unit in (("force", "N"), ("moment", "N_m")):
                value, time = self.peaks.get((name, quantity), (0.0, math.nan))
                out |= {
                    f"{name}_peak_{quantity}_{unit}": value,
                    f"{name}_peak_{quantity}_time_s": time,
                }
                out[f"{name}_{quantity}_impulse_{unit}_s"] = self.integrals[name, quantity]
        for name in self.guides:
            out[f"{name}_time_in_guide_s"] = self.in_guide[name]
            for pin in range(self.motion.joints[name].guide["pins"]):
                out[f"{name}_pin{pin + 1}_peak_load_N"] = self.peaks.get(
                    (name, pin), (math.nan, math.nan)
                )[0]
            out[f"{name}_jam_friction"] = -self.peaks.get((name, "jam"), (math.nan, math.nan))[0]
        return out


def _integral(
    value: Callable[[float], float],
    low: float,
    high: float,
    so_far: float,
    noise: float,
    whole: float | None = None,
    depth: int = 0,
) -> float:
    """Integral by Gauss-Legendre quadrature, bisected until halves and whole agree: corners of a
    magnitude near zero are sharp. ``noise`` is not refined: round-off of a load that is zero."""
    middle = 0.5 * (low + high)
    whole = _gauss(value, low, high) if whole is None else whole
    halves = _gauss(value, low, middle), _gauss(value, middle, high)
    if depth == _HALVINGS or abs(sum(halves) - whole) <= _QUADRATURE * (so_far + whole) + noise:
        return sum(halves)
    first = _integral(value, low, middle, so_far, noise, halves[0], depth + 1)
    return first + _integral(value, middle, high, so_far + first, noise, halves[1], depth + 1)


def _gauss(value: Callable[[float], float], low: float, high: float) -> float:
    """Integral by six nodes of Gauss-Legendre quadrature."""
    middle, half = 0.5 * (low + high), 0.5 * (high - low)
    return half * sum(
        float(w) * value(middle + half * float(x)) for x, w in zip(_NODES, _WEIGHTS, strict=True)
    )
