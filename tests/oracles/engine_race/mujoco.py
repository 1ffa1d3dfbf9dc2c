"""Cases by MuJoCo: a model per phase, a batch of all cases, fourth-order Runge-Kutta, all threads.

E. Todorov, T. Erez and Y. Tassa, "MuJoCo: a physics engine for model-based control", IROS 2012. The
locked phase is one tree without joints, the guided one a tree with a slide joint, the free one two
free bodies: no soft constraint, so that only the error of the integrator remains. Its open-loop
rollouts have no state-dependent loads; here these are a compiled callback at every stage
(`mujoco_loads`), which is the fastest way that MuJoCo offers. Masses, inertias, positions and time
steps differ from case to case.

Each phase takes steps of equal length, those of the guided one until the stroke is passed; the step
that passes it is repeated with other lengths, by the secant method, until it ends there.
"""

import ctypes
import time

import mujoco
import numpy as np
from mujoco.batch import Batch

from oracles.engine_race.inputs import Inputs
from oracles.engine_race.mujoco_loads import FREE, GUIDED, LOCKED, callback, scene, userdata
from oracles.engine_race.outcomes import Final, outcomes
from oracles.engine_race.vectors import Array, cross

ROUNDS = 12
ROOT = 1e-13  # s


class MujocoFlight:
    """All cases of some inputs with a time step, s, for repeated runs."""

    def __init__(self, inputs: Inputs, step: float, threads: int):
        self.inputs, self.step = inputs, step
        began = time.perf_counter()
        self.kept = callback(inputs)
        self.compile_s = time.perf_counter() - began
        self.batches = [self._batch(phase, threads) for phase in (LOCKED, GUIDED, FREE)]
        q = _quaternion(inputs.R)
        turn = np.einsum("nij,nj->ni", inputs.R, inputs.first.place)
        swing = np.einsum("nij,nj->ni", inputs.R, cross(inputs.omega, inputs.first.place))
        self.begin = (
            np.concatenate([turn, q], axis=1),
            np.concatenate([swing, inputs.omega], axis=1),
        )

    def _batch(self, phase: int, threads: int) -> Batch:
        inputs = self.inputs
        batch = Batch(
            mujoco.MjModel.from_xml_string(scene(phase, self.step)), inputs.count, threads
        )
        for k, body in enumerate(inputs.bodies, 1):
            batch.expand("body_mass")[:, k], batch.expand("body_inertia")[:, k] = (
                body.mass,
                body.inertia,
            )
        if phase != FREE:
            batch.expand("body_pos")[:, 2] = inputs.first.arm - inputs.second.arm
        batch.set_const()
        batch.expand("opt.timestep")
        numbers = userdata(inputs)
        numbers[:, 0] = phase
        batch.bind("userdata")[:] = numbers
        return batch

    def fly(self) -> tuple[Array, Array, Array]:
        """Positions, velocities and release times."""
        kind = ctypes.CFUNCTYPE(None, ctypes.c_void_p, ctypes.c_void_p)
        mujoco.set_mjcb_control(kind(self.kept.address))
        try:
            return self._fly()
        finally:
            mujoco.set_mjcb_control(None)

    def _fly(self) -> tuple[Array, Array, Array]:
        inputs = self.inputs
        locked, guided, free = self.batches
        locked.bind("qpos")[:], locked.bind("qvel")[:], locked.bind("time")[:] = *self.begin, 0.0
        _leap(locked, inputs.unlock, self.step)
        guided.bind("qpos")[:, :7], guided.bind("qvel")[:, :6] = (
            locked.bind("qpos"),
            locked.bind("qvel"),
        )
        guided.bind("qpos")[:, 7:], guided.bind("qvel")[:, 6:], guided.bind("time")[:] = (
            0.0,
            0.0,
            inputs.unlock,
        )
        self._to_stroke(guided)
        release = guided.bind("time").copy()
        free.bind("qpos")[:], free.bind("qvel")[:] = self._part(
            guided.bind("qpos"), guided.bind("qvel")
        )
        free.bind("time")[:] = release
        _leap(free, inputs.end - release, self.step)
        return free.bind("qpos").copy(), free.bind("qvel").copy(), release

    def _to_stroke(self, batch: Batch) -> None:
        """Run the guided phase to the release."""
        slid, goal = batch.bind("qpos")[:, 7], self.inputs.apart * self.inputs.stroke
        steps = batch.expand("opt.timestep")
        steps[:] = self.step
        on = np.arange(self.inputs.count)
        before = batch.state.copy()
        while len(on):
            before[on] = batch.state[on]
            batch.step(on)
            on = on[
                (np.abs(slid[on]) < self.inputs.stroke[on])
                & (batch.bind("time")[on] < self.inputs.end)
            ]
        old, h = np.zeros(self.inputs.count), np.full(self.inputs.count, self.step)
        batch_start = before[:, batch._component(mujoco.mjtState.mjSTATE_QPOS)[0] + 7] - goal
        off_old, off = batch_start, slid - goal
        for _ in range(ROUNDS):
            change = off * (h - old) / np.where(off == off_old, 1.0, off - off_old)
            old, off_old, h = h, off, h - change
            if np.abs(change).max() < ROOT:
                break
            batch.state[:] = before
            steps[:] = h
            batch.step()
            off = slid - goal

    def _part(self, qpos: Array, qvel: Array) -> tuple[Array, Array]:
        """Positions and velocities of two free bodies from those of the sliding pair."""
        R, w = _matrix(qpos[:, 3:7]), qvel[:, 3:6]
        r = self.inputs.first.arm - self.inputs.second.arm
        r[:, 0] += qpos[:, 7]
        swing = cross(w, r)
        swing[:, 0] += qvel[:, 6]
        second = (
            qpos[:, :3] + np.einsum("nij,nj->ni", R, r),
            qvel[:, :3] + np.einsum("nij,nj->ni", R, swing),
        )
        return np.concatenate([qpos[:, :7], second[0], qpos[:, 3:7]], axis=1), np.concatenate(
            [qvel[:, :6], second[1], w], axis=1
        )

    def outcomes(self, flown: tuple[Array, Array, Array]) -> dict[str, Array]:
        """Outcome columns of a run; not timed."""
        q, v, release = flown
        finals = [
            Final(
                q[:, 7 * k : 7 * k + 3],
                v[:, 6 * k : 6 * k + 3],
                _matrix(q[:, 7 * k + 3 : 7 * k + 7]),
                v[:, 6 * k + 3 : 6 * k + 6],
            )
            for k in (0, 1)
        ]
        return outcomes(self.inputs, finals[0], finals[1], release)


def _leap(batch: Batch, spans: Array, step: float) -> None:
    """Advance every case over its time span in equal steps, the same number for all."""
    count = int(np.ceil(np.max(spans) / step - 1e-9))
    batch.expand("opt.timestep")[:] = spans / count
    batch.step(nstep=count)


def _quaternion(R: Array) -> Array:
    """Scalar first; for rotations below 90 deg."""
    w = 0.5 * np.sqrt(1.0 + R[:, 0, 0] + R[:, 1, 1] + R[:, 2, 2])
    parts = [R[:, 2, 1] - R[:, 1, 2], R[:, 0, 2] - R[:, 2, 0], R[:, 1, 0] - R[:, 0, 1]]
    return np.stack([w, *(p / (4.0 * w) for p in parts)], axis=-1)


def _matrix(q: Array) -> Array:
    w, x, y, z = (q / np.linalg.norm(q, axis=1)[:, None]).T
    rows = [
        [1.0 - 2.0 * (y * y + z * z), 2.0 * (x * y - w * z), 2.0 * (x * z + w * y)],
        [2.0 * (x * y + w * z), 1.0 - 2.0 * (x * x + z * z), 2.0 * (y * z - w * x)],
        [2.0 * (x * z - w * y), 2.0 * (y * z + w * x), 1.0 - 2.0 * (x * x + y * y)],
    ]
    return np.moveaxis(np.array(rows), -1, 0)
