"""The cases flown by heyoka: batches of 4 or 8 in SIMD registers, a Taylor integrator per phase,
all threads.

F. Biscani and D. Izzo, "Revisiting high-order Taylor methods for astrodynamics and celestial
mechanics", MNRAS 504(2), 2021.

Two ways. ``tol 1e-09``: heyoka alone decides on its steps, and its terminal event ends the guided
phase, as its manual has it. ``order 9 12 12, steps 1 2 2``: so many equal steps a phase, of such an
order; the release is the root of the Taylor polynomial of the last guided step, by Newton's method
over many cases at once, and the state there is that polynomial's value. (heyoka shortens a step by
the size of the largest state, so a state that stands still and is huge makes it take those asked
for.) That is faster by a third to a half at the same error.

`propagate_until` lets other threads of Python run and `step` does not, but two threads still waited
for each other's lock longer than they flew (10,000 cases: 60 ms on two, 31 ms on one), hence a
process a thread. heyoka's own ensembles ask Python for each batch too, and copy the integrator for
it, which takes 1 ms. Measured and not used: compact mode (1.2 to 1.9 times slower), batches of 16
and 32 (a fifth faster below order 8, where the error is 1e-3; no faster at 10, slower at 14, and
ten times longer to compile).
"""

import math
import time
from dataclasses import dataclass
from typing import Any

import heyoka as hy
import numpy as np

from oracles.engine_race import heyoka_equations as equations
from oracles.engine_race.heyoka_release import at_root, evaluate, parting
from oracles.engine_race.heyoka_terms import Equations
from oracles.engine_race.inputs import Inputs
from oracles.engine_race.outcomes import Final, outcomes
from oracles.engine_race.vectors import Array, attitude_from

CHUNK = 128  # batches
HUGE = 1e30
Three = tuple[int, int, int]


@dataclass
class Phase:
    """Phase ready to run: its integrator; parameters, (batches, p, batch); states by name."""

    names: list[str]
    integrator: Any
    parameters: Array
    compile_s: float


def by_batch(rows: Array, batch: int) -> Array:
    """(k, n) to (batches, k, batch); the last batch is filled up with the last case."""
    count = rows.shape[1]
    full = np.concatenate([rows, np.repeat(rows[:, -1:], -count % batch, axis=1)], axis=1)
    return np.ascontiguousarray(full.reshape(len(rows), -1, batch).transpose(1, 0, 2))


def by_case(batches: Array, count: int) -> Array:
    """(batches, k, batch) to (k, n)."""
    return batches.transpose(1, 0, 2).reshape(batches.shape[1], -1)[:, :count]


def _phase(eq: Equations, tolerance: float, huge: bool, events: list[Any], batch: int) -> Phase:
    system = eq.system
    if huge:
        system.append((hy.expression("huge"), hy.expression(0.0)))
    began = time.perf_counter()
    one = hy.taylor_adaptive_batch(
        system, state=np.zeros((len(system), batch)), pars=np.zeros((len(eq.parameters), batch)),
        tol=tolerance, compact_mode=False,
        t_events=events,
    )  # fmt: skip
    spent = time.perf_counter() - began
    if huge:
        one.state[-1] = HUGE
    return Phase(list(eq.rates), one, by_batch(np.array(eq.parameters), batch), spent)


class HeyokaFlight:
    """All cases of some inputs, for repeated runs.

    Parameters
    ----------
    batch : int
        Cases in a SIMD register.
    tolerance : float, optional
        heyoka selects its own steps.
    orders, steps : three int, optional
        Or given numbers of steps and orders of the locked, guided and free phase.
    """

    def __init__(
        self,
        inputs: Inputs,
        batch: int,
        tolerance: float | None,
        orders: Three = (0, 0, 0),
        steps: Three = (1, 1, 1),
    ):
        self.inputs, self.batch, self.steps = inputs, batch, steps
        self.adaptive = tolerance is not None
        tolerances = [tolerance or math.exp(-2.0 * (order - 1.5)) for order in orders]
        gap = inputs.first.arm[:, 0] - inputs.second.arm[:, 0]
        guided = equations.mated(inputs, True)
        # of rx at the release
        self.target = by_batch((gap + inputs.apart * inputs.stroke)[None], batch)[:, 0]
        events = []
        if self.adaptive:
            stroke = inputs.apart * (
                hy.expression("rx") - guided.par(gap + inputs.apart * inputs.stroke)
            )
            events = [hy.t_event_batch(stroke, direction=hy.event_direction.positive)]
        systems = (equations.mated(inputs, False), guided, equations.free(inputs))
        self.phases = [
            _phase(eq, tol, not self.adaptive, event, batch)
            for eq, tol, event in zip(systems, tolerances, ([], events, []), strict=True)
        ]
        begin = equations.start(inputs)
        self.start = by_batch(np.array([begin[name] for name in self.phases[0].names]), batch)
        self.gap = by_batch(gap[None], batch)[:, 0]
        self.unlock = by_batch(inputs.unlock[None], batch)[:, 0]
        total = inputs.first.mass + inputs.second.mass
        shares = [-inputs.second.mass / total, inputs.first.mass / total]
        self.split = by_batch(
            np.array([*shares, *(inputs.first.arm - inputs.second.arm).T[1:]]), batch
        ).transpose(1, 0, 2)
        began = time.perf_counter()
        names = self.phases[1].names
        self.part = parting(names, self.phases[2].names)
        self.root = at_root(len(names), names.index("rx"), self.phases[1].integrator.order)
        self.compile_s = sum(p.compile_s for p in self.phases) + time.perf_counter() - began
        self.typical = 0.0  # s: a guess how long the guided phase lasts
        if steps[1] > 1 and not self.adaptive:
            pilot = HeyokaFlight(inputs.part(0, batch), batch, None, (8, 12, 8))
            self.typical = float(np.mean(pilot.fly()[1] - pilot.inputs.unlock))

    def fly(self) -> tuple[Array, Array]:
        """Final states (33, n) and release times (n,)."""
        count = len(self.start)
        final, release = (
            np.empty((count, len(self.phases[2].names), self.batch)),
            np.empty((count, self.batch)),
        )
        for first in range(0, count, CHUNK):
            rows = slice(first, min(first + CHUNK, count))
            self._chunk(rows, final[rows], release[rows])
        return by_case(final, self.inputs.count), release.reshape(-1)[: self.inputs.count]

    def _chunk(self, rows: slice, final: Array, release: Array) -> None:
        locked, guided, free = ((p.integrator, p.parameters[rows]) for p in self.phases)
        state = np.zeros((len(final), len(self.phases[1].names), self.batch))
        size = self.start.shape[1]
        n0, n1, n2 = (1, 1, 1) if self.adaptive else self.steps
        unlock = self.unlock[rows]
        self._leap(*locked, self.start[rows], unlock, n0, state)
        state[:, size] = self.gap[rows]
        if self.adaptive:
            self._to_event(*guided, state, unlock, release)
        else:
            release[:] = unlock + self._to_root(*guided, state, n1, self.target[rows])
        begin = evaluate(self.part, np.concatenate([state.transpose(1, 0, 2), self.split[:, rows]]))
        self._leap(*free, begin.transpose(1, 0, 2), self.inputs.end - release, n2, final)

    def _leap(
        self, ta: Any, parameters: Array, begin: Array, spans: Array, steps: int, out: Array
    ) -> None:
        """Every batch over its spans of time, in equal steps if they are prescribed."""
        size = begin.shape[1]
        state, pars, fly = ta.state[:size], ta.pars, ta.propagate_until
        for at, span in enumerate(spans / steps):
            state[:], pars[:] = begin[at], parameters[at]
            for _ in range(steps):
                ta.set_time(0.0)
                fly(span)
            out[at, :size] = state

    def _to_root(
        self, ta: Any, parameters: Array, state: Array, steps: int, target: Array
    ) -> Array:
        """Run the guided phase from ``state`` to the release, into ``state``; returns its duration,
        (batches, batch)."""
        size = state.shape[1]
        now, pars, fly, series = ta.state[:size], ta.pars, ta.propagate_until, ta.tc[:size]
        step = np.full(self.batch, self.typical / steps if steps > 1 else self.inputs.end)
        coefficients = np.empty((*series.shape[:2], len(state), self.batch))
        for at, begin in enumerate(state):
            now[:], pars[:] = begin, parameters[at]
            for _ in range(steps - 1):
                ta.set_time(0.0)
                fly(step)
            ta.set_time(0.0)
            fly(step, write_tc=True)
            coefficients[:, :, at] = series
        rows = evaluate(
            self.root,
            np.concatenate([coefficients.reshape(-1, len(state), self.batch), target[None]]),
        )
        state[:] = rows[:-1].transpose(1, 0, 2)
        return rows[-1] + (steps - 1) * step

    def _to_event(
        self, ta: Any, parameters: Array, state: Array, unlock: Array, release: Array
    ) -> None:
        """The same with heyoka's terminal event, which stops a batch at the first event of its
        cases."""
        for at, begin in enumerate(state):
            ta.state[:], ta.pars[:] = begin, parameters[at]
            ta.set_time(0.0)
            ta.reset_cooldowns()
            goal = self.inputs.end - unlock[at]
            for _ in range(self.batch + 1):  # each ends one case at least
                ta.propagate_until(goal)
                for lane, result in enumerate(ta.propagate_res):
                    if int(result[0]) == -1:
                        goal[lane] = ta.time[lane]
                if not (ta.time < goal).any():
                    break
            else:
                raise RuntimeError(f"heyoka does not reach the release: {ta.propagate_res}")
            state[at], release[at] = ta.state, unlock[at] + ta.time

    def outcomes(self, flown: tuple[Array, Array]) -> dict[str, Array]:
        """Outcome columns of a run; not timed."""
        state, release = flown
        rows = dict(zip(self.phases[2].names, state, strict=True))
        finals = []
        for tag in "ab":
            X, D, U, e, w = (
                np.stack([rows[f"{v}{tag}{a}"] for a in "xyz"], axis=-1) for v in "XDUew"
            )
            R = attitude_from(U, e, self.inputs.velocity - self.inputs.wind)
            finals.append(Final(np.einsum("nij,nj->ni", R, X), np.einsum("nij,nj->ni", R, D), R, w))
        return outcomes(self.inputs, finals[0], finals[1], release)
