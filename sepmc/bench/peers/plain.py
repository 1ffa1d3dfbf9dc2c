"""The cases flown by scipy's `solve_ivp` (DOP853 with events) on our own right-hand side as plain Python: what everyone would try first.

Runs in a process of its own in which Numba compiles nothing; this is the one module of the bench's peers that knows the kernels.
"""

from typing import Any

import numpy as np
from scipy.integrate import solve_ivp

from sepmc.bench.peers.inputs import Inputs
from sepmc.bench.peers.outcomes import Final, outcomes
from sepmc.bench.peers.vectors import Array
from sepmc.campaign.campaign import Campaign
from sepmc.campaign.cases import draw
from sepmc.kernels import layout as at
from sepmc.kernels.cfe import separation
from sepmc.kernels.dynamics import derivative, set_attitudes
from sepmc.kernels.flight import _begin
from sepmc.kernels.layers import set_layers
from sepmc.kernels.layout import Model
from sepmc.kernels.places import joint_work
from sepmc.kernels.prepare import prepare
from sepmc.kernels.quat import matrix
from sepmc.kernels.stretches import set_stretch
from sepmc.scene.read import parse_campaign


class Flight:
    """Some cases at a tolerance, relative and absolute."""

    compile_s = 0.0

    def __init__(self, tree: dict[str, Any], name: str, inputs: Inputs, tolerance: float):
        self.campaign = campaign = Campaign(parse_campaign(tree, name, None, name))
        self.inputs, self.tolerance = inputs, tolerance
        self.rows = draw(campaign.file.dispersions, campaign.scene.run.seed, 0, inputs.count) * campaign.factors

    def fly(self) -> list[tuple[Array, float]]:
        """Final state and release time of every case."""
        return [self._fly(i, row) for i, row in enumerate(self.rows)]

    def _fly(self, i: int, row: Array) -> tuple[Array, float]:
        plan, inputs = self.campaign.plan, self.inputs
        m = Model(plan.model.scene[0], plan.model.table, plan.model.numbers)
        size = at.STATE * m.scene.n_bodies + 1
        w, y, out = np.zeros(m.scene.size_w), np.empty(size), np.empty(size)
        prepare(np.ascontiguousarray(plan.nominal), self.campaign.slots, row, w, y, m)
        _begin(y, np.empty(1000), m, w)
        set_stretch(0.5 * inputs.end, m, w)

        def rate(t: float, state: Array) -> Array:
            set_layers(t, state, m, w)
            derivative(t, state, out, m, w)
            return out.copy()

        def stroke(_: float, state: Array) -> float:
            set_attitudes(state, m, w)
            return float(separation(state, 0, m, w)[0] - inputs.stroke[i])

        stroke.terminal = True  # type: ignore[attr-defined]
        t, spans = 0.0, (inputs.unlock[i], inputs.end, inputs.end)
        release = np.nan
        for phase, until in enumerate(spans):
            w[joint_work(0, m) + at.KIND] = m.table[m.scene.phase_kinds_i + phase]
            events = stroke if phase == 1 else None
            found = solve_ivp(rate, (t, until), y, method="DOP853", rtol=self.tolerance, atol=self.tolerance, events=events)
            t, y = float(found.t[-1]), found.y[:, -1]
            if phase == 1:
                release = t
        return y, release

    def outcomes(self, flown: list[tuple[Array, float]]) -> dict[str, Array]:
        """Outcome columns of a flight; not timed."""
        states = np.array([y for y, _ in flown])
        finals = []
        for b in (0, 1):
            y = states[:, at.STATE * b : at.STATE * (b + 1)]
            q = y[:, at.QUATERNION : at.QUATERNION + 4]
            q = q / np.linalg.norm(q, axis=1)[:, None]
            R = np.array([np.reshape(matrix(tuple(row)), (3, 3)) for row in q])
            finals.append(Final(y[:, at.POSITION : at.POSITION + 3], y[:, at.VELOCITY : at.VELOCITY + 3], R, y[:, at.RATE : at.RATE + 3]))
        first = 0 if next(iter(self.campaign.scene.body)) == self.inputs.first.name else 1
        return outcomes(self.inputs, finals[first], finals[1 - first], np.array([t for _, t in flown]))
