"""What is watched over a whole flight: peaks of joint loads with their times, impulses, pin loads
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

_SAMPLES = 8  # intervals of a step between which peaks and kinks are sought
_NODES, _WEIGHTS = np.polynomial.legendre.leggauss(6)
_QUADRATURE, _HALVINGS = (
    1e-11,
    20,
)  # of an impulse so far, by which whole and halves may differ; most halvings
# of a peak, by which two of its values may differ that count as one; s between them
_FLAT, _APART = 1e-11, 1e-6
# of the largest load of a step, and of the vehicle's mass at 1 m/s2: what a load that is zero may
# show
_ROUND_OFF = 1e-14


class _Instant:
    """A motion at a time: wrenches of its joints, friction of its guides."""

    def __init__(self, motion: Motion, t: float, s: State):
        self.t, self.s = t, s
        _, added, rows, self.friction = motion.at(t, s)
        self.wrenches = motion.wrenches_of(s, added, rows)


class Watch:
    """Peaks and integrals of a flight, step by step. ``peaks``: value and time, by what it is
    of."""

    def __init__(self, motion: Motion, output: Table):
        self.motion, self.loads, self.guides = motion, list(output["loads"]), list(output["guide"])
        self.peaks: dict[Any, tuple[float, float]] = {}
        self.integrals = dict.fromkeys(
            [(name, what) for name in self.loads for what in ("force", "moment")], 0.0
        )
        self.in_guide = dict.fromkeys(self.guides, 0.0)
        self.noise = 0.0  # what a load that is zero showed in the last step that was watched
        # earliest and latest time at which a peak was as good as reached
        self.spans: dict[Any, tuple[float, float]] = {}

    def quantities(self) -> list[Any]:
        """What has a value as the joints hold now."""
        held, joints = self.motion.sequence.held, self.motion.joints
        found: list[Any] = [
            (name, what) for name in self.loads if held[name] for what in ("force", "moment")
        ]
        for name in self.guides:
            if slides(held[name]):
                found += [(name, pin) for pin in range(joints[name].guide["pins"])] + [
                    (name, "jam")
                ]
        return found

    def value(self, what: Any, now: "_Instant") -> float:
        """A quantity at an instant, such that its peak is its greatest value."""
        name, which = what
        joint = self.motion.joints[name]
        if which in ("force", "moment"):
            return float(np.linalg.norm(now.wrenches[name][0 if which == "force" else 1]))
        if which == "jam":
            drive, *wrench = self.motion.held_along(name, now.t, now.s, now.friction)
            carried = total(contacts(joint, now.s, *wrench))
            return -drive / carried if carried > 0.0 else -math.inf
        loads = contacts(joint, now.s, *now.wrenches[name])[:, which]
        return float(np.sqrt(np.sum(loads**2, axis=-1)).max())

    def step(self, dense: Callable[[float], Array], start: float, end: float) -> None:
        """Watch a step from its interpolation."""
        for name in self.guides:
            self.in_guide[name] += end - start if slides(self.motion.sequence.held[name]) else 0.0
        wanted = self.quantities()
        if not wanted or end <= start:
            return

        @cache
        def instant(t: float) -> _Instant:
            return _Instant(self.motion, t, self.motion.vehicle.state(t, dense(t)))

        @cache
        def value(what: Any, t: float) -> float:
            return self.value(what, instant(t))

        times = np.linspace(start, end, _SAMPLES + 1)
        table = np.array([[value(what, float(t)) for what in wanted] for t in times])
        noise = self.noise = _ROUND_OFF * (
            float(np.abs(table[np.isfinite(table)]).max(initial=0.0))
            + float(self.motion.vehicle.mass.sum())
        )
        for i, what in enumerate(wanted):
            one = partial(value, what)
            kinks = self._extremes(what, one, times, table[:, i])
            if what in self.integrals:
                self.integrals[what] += sum(
                    _integral(one, *ends, self.integrals[what], noise * (end - start))
                    for ends in pairwise([start, *kinks, end])
                )

    def _extremes(
        self, what: Any, value: Callable[[float], float], times: Array, found: Array
    ) -> list[float]:
        """Keep the peaks of a quantity; returns the times of its lowest points, where the size of a
        vector may have a kink."""
        kinks = []
        for i, t in enumerate(times):
            self._keep(what, float(found[i]), float(t))
            near = found[max(i - 1, 0) : i + 2]
            low, high = times[max(i - 1, 0)], times[min(i + 1, len(times) - 1)]
            if not np.isfinite(near).all() or np.ptp(near) == 0.0:
                continue
            if found[i] == near.max() and 2.0 * found[i] - near.min() > self._best(what):
                top = minimize_scalar(
                    lambda x: -value(x),
                    bounds=(low, high),
                    method="bounded",
                    options={"xatol": 1e-11},
                ).x
                self._keep(what, value(top), float(top))
            elif (
                found[i] == near.min()
                and 0 < i < len(times) - 1
                and 2.0 * found[i] < near.max()
                and what in self.integrals
            ):
                kinks.append(
                    float(
                        minimize_scalar(
                            value, bounds=(low, high), method="bounded", options={"xatol": 1e-13}
                        ).x
                    )
                )
        return kinks

    def _best(self, what: Any) -> float:
        """Greatest value so far. Of a joint load it begins at zero."""
        return self.peaks.get(what, (0.0 if what in self.integrals else -math.inf, math.nan))[0]

    def _keep(self, what: Any, value: float, t: float) -> None:
        best = self._best(what)
        if abs(value - best) <= _FLAT * abs(best) and what in self.spans:
            self.spans[what] = min(self.spans[what][0], t), max(self.spans[what][1], t)
        elif value > best:
            self.spans[what] = t, t
        if value > best:
            self.peaks[what] = value, t

    def flat(self) -> list[str]:
        """Times of peaks that are nothing but round-off, or are reached at more than one: round-off
        decides which is told."""
        return [
            f"{name}_peak_{what}_time_s"
            for name in self.loads
            for what in ("force", "moment")
            for first, last in [self.spans.get((name, what), (0.0, 0.0))]
            if last - first > _APART or self._best((name, what)) <= self.noise
        ]

    def reached(self) -> dict[str, tuple[float, float]]:
        """Earliest and latest time at which every peak of a joint load was as good as reached, by
        the outcome that tells its time."""
        return {
            f"{name}_peak_{what}_time_s": span
            for (name, what), span in self.spans.items()
            if what in ("force", "moment")
        }

    def report(self) -> dict[str, float]:
        """Outcomes under their public names."""
        out: dict[str, float] = {}
        for name in self.loads:
            for what, unit in (("force", "N"), ("moment", "N_m")):
                value, time = self.peaks.get((name, what), (0.0, math.nan))
                out |= {f"{name}_peak_{what}_{unit}": value, f"{name}_peak_{what}_time_s": time}
                out[f"{name}_{what}_impulse_{unit}_s"] = self.integrals[name, what]
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
    """Integral by Gauss-Legendre, halved until both halves agree with the whole: corners of a size
    near zero are sharp. What is ``noise`` in it, of a load that is zero but for round-off, is not
    refined."""
    middle = 0.5 * (low + high)
    whole = _gauss(value, low, high) if whole is None else whole
    halves = _gauss(value, low, middle), _gauss(value, middle, high)
    if depth == _HALVINGS or abs(sum(halves) - whole) <= _QUADRATURE * (so_far + whole) + noise:
        return sum(halves)
    first = _integral(value, low, middle, so_far, noise, halves[0], depth + 1)
    return first + _integral(value, middle, high, so_far + first, noise, halves[1], depth + 1)


def _gauss(value: Callable[[float], float], low: float, high: float) -> float:
    middle, half = 0.5 * (low + high), 0.5 * (high - low)
    return half * sum(
        float(w) * value(middle + half * float(x)) for x, w in zip(_NODES, _WEIGHTS, strict=True)
    )
