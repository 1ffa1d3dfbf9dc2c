"""An hour of constrained motion in empty space with each way to hold drift: what is lost, and what
it costs."""

import math
import time
from dataclasses import dataclass
from functools import cache

import numpy as np

from sepmc.engine.dispatch import integrate_nominal, load_kernel
from sepmc.kernel.emit.module import emit
from sepmc.kernel.spec.parameter_layout import make_parameter_layout
from sepmc.kernel.spec.structure import make_kernel_spec
from sepmc.routines.layout import FULL_HISTORY
from sepmc.schema import AUDIT_BOUNDS
from sepmc.text_table import text_table
from sepmc.validation.flights import NominalRun, tensor, to_ground
from sepmc.validation.stresses.line import EPS, Bound, Stress, judge, relative
from sepmc.validation.stresses.scenes import (
    AFT,
    FORE,
    OMEGA,
    Composite,
    Tree,
    body,
    fly,
    held,
    joint,
    make,
    pair,
    scene,
)

WAYS = ("none", "baumgarte", "projection")
HOUR, STEP = 3600.0, 0.05  # s
STEPS = round(HOUR / STEP)
TIMED, REPEATS = 6000, 3  # steps that are timed, and how often; the least counts


@dataclass(frozen=True)
class Hour:
    """One flight of an hour: largest changes relative to what is kept, and the seconds that a step
    takes."""

    motion: str
    way: str
    found: NominalRun
    energy: float
    angular_momentum: float
    attitude: float  # NaN where there is no closed form
    step_s: float


def _chain() -> Tree:
    """Three bodies on two ball joints: nothing regular about its motion."""
    last = body(2.1, [0.8, 1.5, 1.2], [4.2, 0.1, 0.06], [0.0, -0.1, 0.15])
    joints = {
        "front": joint("fore", "aft", [2.0, 0.1, 0.05]),
        "rear": joint("aft", "last", [3.6, 0.0, 0.0]),
    }
    return scene(
        {"fore": FORE, "aft": AFT, "last": last},
        joints,
        held(front="spherical", rear="spherical"),
        HOUR,
        STEP,
        OMEGA,
    )


def motions() -> dict[str, Tree]:
    """What flies for an hour: at 1.2 rad/s, 4500 rad in all."""
    return {
        "weld": pair("fixed", HOUR, STEP),
        "hinge": pair("revolute", HOUR, STEP),
        "chain of balls": _chain(),
    }


def invariants(found: NominalRun) -> tuple[np.ndarray, np.ndarray]:
    """Kinetic energy (n,) and angular momentum about the origin (n, 3), ground axes."""
    energy, spin = np.zeros(len(found.t)), np.zeros((len(found.t), 3))
    for name, data in found.scene.body.items():
        x, v, r, w = found.body(name)
        own = w @ tensor(found.scene, name)
        energy += 0.5 * data.mass * np.sum(v * v, axis=1) + 0.5 * np.sum(w * own, axis=1)
        spin += data.mass * np.cross(x, v) + to_ground(r, own)
    return energy, spin


@cache
def hours() -> tuple[Hour, ...]:
    """Every motion with every way to hold drift."""
    flown = []
    for motion, tree in motions().items():
        given = {way: tree | {"solver": {"step_s": STEP, "drift": way}} for way in WAYS}
        seconds = _seconds_a_step(given)
        for way in WAYS:
            found = fly(given[way])
            energy, spin = invariants(found)
            attitude = (
                Composite(found, "aft", [2.0, 0.1, 0.0]).attitude_error()
                if motion == "weld"
                else math.nan
            )
            changes = (
                relative(energy, np.full_like(energy, energy[0])),
                relative(spin, np.broadcast_to(spin[0], spin.shape)),
            )
            flown.append(Hour(motion, way, found, *changes, attitude, seconds[way]))
    return tuple(flown)


def _seconds_a_step(given: dict[str, Tree]) -> dict[str, float]:
    """Least processor time of a step, by way, of flights without rows; the ways take turns, so that
    a busy machine slows all alike."""
    short = {way: make(tree | {"run": {"end_time_s": TIMED * STEP}}) for way, tree in given.items()}
    plans, least = (
        {way: make_parameter_layout(campaign.nominal().scene) for way, campaign in short.items()},
        dict.fromkeys(given, math.inf),
    )
    kernels = {
        way: load_kernel(emit(make_kernel_spec(plan), plan.scene.solver.method, FULL_HISTORY))
        for way, plan in plans.items()
    }
    one, usual, no_rows = np.ones(1, dtype=np.int64), np.full(1, math.inf), np.empty((0, 3))
    for _ in range(REPEATS):
        for way, kernel in kernels.items():
            start = time.process_time()
            integrate_nominal(kernel, plans[way], one, usual, no_rows)
            least[way] = min(least[way], (time.process_time() - start) / TIMED)
    return least


def _bounds() -> dict[str, Bound]:
    """What an hour may lose, relative, by way.

    none: round-off of the accelerations, 100 eps, summed twice, is how far joints drift, and the
    joint force works over that. projection: a correction once a step leaves no more than 1e-12,
    either way.
    baumgarte: what it pulls with is of the size of the error of the inner stages; only the audit
    bounds it.
    """
    return {
        "none": Bound(100.0 * EPS * STEP**2 * STEPS**1.5, "100 eps x h^2 N^1.5 (drift)"),
        "projection": Bound(1e-12 * math.sqrt(STEPS), "1e-12 x sqrt(N) (corrections)"),
        "baumgarte": Bound(AUDIT_BOUNDS["energy_residual"], "1e-6 (audit)"),
    }


def hour() -> list[Stress]:
    """An hour of 72,000 steps: energy and angular momentum stay, and a weld is where the closed
    form has it."""
    lines = []
    turned = float(np.linalg.norm(OMEGA)) * HOUR
    for x in hours():
        bound, given = _bounds()[x.way], f"1 h of {x.motion}, {x.way}"
        lines.append(
            judge(given, "energy", x.energy, bound, x.found, resolved=x.way == "projection")
        )
        lines.append(
            judge(
                given,
                "angular momentum",
                x.angular_momentum,
                bound,
                x.found,
                resolved=x.way == "projection",
            )
        )
        if x.motion == "weld":
            angle = Bound(bound.value * turned, "that x 4500 rad turned")
            lines.append(
                judge(given, "attitude", x.attitude, angle, x.found, resolved=x.way == "projection")
            )
    return lines


def hours_table() -> str:
    """What each way to hold drift loses over an hour, and what a step takes beside one of none, of
    a single case."""
    head = (
        "motion",
        "drift",
        "gap, m",
        "gap rate, m/s",
        "angle, rad",
        "energy",
        "ang. momentum",
        "attitude",
        "a step, us",
        "over none",
    )
    rows: list[tuple[str, ...]] = [head]
    for x in hours():
        o, base = (
            x.found.outcomes,
            next(y.step_s for y in hours() if y.motion == x.motion and y.way == "none"),
        )
        lost = (
            o["joint_gap_residual_m"],
            o["joint_gap_rate_residual_m_s"],
            o["joint_angle_residual_rad"],
            x.energy,
            x.angular_momentum,
        )
        attitude = "-" if math.isnan(x.attitude) else f"{x.attitude:.1e}"
        rows.append(
            (
                x.motion,
                x.way,
                *(f"{v:.1e}" for v in lost),
                attitude,
                f"{1e6 * x.step_s:.2f}",
                f"{x.step_s / base:.3f}",
            )
        )
    return "\n".join(text_table(rows, left=(0, 1)))
