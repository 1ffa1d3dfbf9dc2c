"""Stress of one hour of constrained motion in empty space with each method of drift control
(``solver.drift``): accuracy, and the cost of a step."""

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
    joint,
    make,
    pair,
    phase_of,
    scene,
    simulate,
)

METHODS = ("none", "baumgarte", "projection")
HOUR, STEP = 3600.0, 0.05  # s
STEPS = round(HOUR / STEP)
TIMED, REPEATS = 6000, 3  # timed steps and repetitions; the minimum counts


@dataclass(frozen=True)
class Hour:
    """Run of a motion over one hour with a method of drift control.

    ``motion`` is its name, ``method`` one of METHODS, ``run`` its history. ``energy`` and
    ``angular_momentum`` are the largest changes from the start over the hour, relative to the value
    at the start (of a vector to its largest component); ``attitude`` is the largest relative error
    of the attitude of the second body, NaN without a closed form; ``step_s`` is the processor time
    of a step, s."""

    motion: str
    method: str
    run: NominalRun
    energy: float
    angular_momentum: float
    attitude: float
    step_s: float


def _chain() -> Tree:
    """Tree of three bodies on two ball joints, in irregular motion, for one hour."""
    last = body(2.1, [0.8, 1.5, 1.2], [4.2, 0.1, 0.06], [0.0, -0.1, 0.15])
    joints = {
        "front": joint("fore", "aft", [2.0, 0.1, 0.05]),
        "rear": joint("aft", "last", [3.6, 0.0, 0.0]),
    }
    return scene(
        {"fore": FORE, "aft": AFT, "last": last},
        joints,
        phase_of(front="spherical", rear="spherical"),
        HOUR,
        STEP,
        OMEGA,
    )


def motions() -> dict[str, Tree]:
    """Trees of the motions of one hour, by name; they begin at `OMEGA`, 1.245 rad/s (4500 rad in an
    hour)."""
    return {
        "weld": pair("fixed", HOUR, STEP),
        "hinge": pair("revolute", HOUR, STEP),
        "chain of balls": _chain(),
    }


def invariants(run: NominalRun) -> tuple[np.ndarray, np.ndarray]:
    """Kinetic energy (n,), J, and angular momentum about the origin (n, 3), kg m2/s, ground axes,
    of all bodies in the n rows of a run."""
    energy, spin = np.zeros(len(run.t)), np.zeros((len(run.t), 3))
    for name, data in run.scene.body.items():
        x, v, r, w = run.body(name)
        spin_of_body = w @ tensor(run.scene, name)
        energy += 0.5 * data.mass * np.sum(v * v, axis=1) + 0.5 * np.sum(w * spin_of_body, axis=1)
        spin += data.mass * np.cross(x, v) + to_ground(r, spin_of_body)
    return energy, spin


@cache
def hours() -> tuple[Hour, ...]:
    """Runs of one hour of every motion with every method of drift control, cached."""
    runs = []
    for motion, tree in motions().items():
        trees = {method: tree | {"solver": {"step_s": STEP, "drift": method}} for method in METHODS}
        seconds = _seconds_a_step(trees)
        for method in METHODS:
            run = simulate(trees[method])
            energy, spin = invariants(run)
            attitude = (
                Composite(run, "aft", [2.0, 0.1, 0.0]).attitude_error()
                if motion == "weld"
                else math.nan
            )
            changes = (
                relative(energy, np.full_like(energy, energy[0])),
                relative(spin, np.broadcast_to(spin[0], spin.shape)),
            )
            runs.append(Hour(motion, method, run, *changes, attitude, seconds[method]))
    return tuple(runs)


def _seconds_a_step(trees: dict[str, Tree]) -> dict[str, float]:
    """Minimum processor time of a step, s, by method of drift control, of compiled runs without
    history; ``trees`` has a scene for each method. The methods alternate, so that a busy machine
    slows all of them alike."""
    campaigns = {
        method: make(tree | {"run": {"end_time_s": TIMED * STEP}}) for method, tree in trees.items()
    }
    layouts, minimum = (
        {
            method: make_parameter_layout(campaign.nominal().scene)
            for method, campaign in campaigns.items()
        },
        dict.fromkeys(trees, math.inf),
    )
    kernels = {
        method: load_kernel(
            emit(make_kernel_spec(layout), layout.scene.solver.method, FULL_HISTORY)
        )
        for method, layout in layouts.items()
    }
    one, typical, no_rows = np.ones(1, dtype=np.int64), np.full(1, math.inf), np.empty((0, 3))
    for _ in range(REPEATS):
        for method, kernel in kernels.items():
            start = time.process_time()
            integrate_nominal(kernel, layouts[method], one, typical, no_rows)
            minimum[method] = min(minimum[method], (time.process_time() - start) / TIMED)
    return minimum


def _bounds() -> dict[str, Bound]:
    """Allowed relative change of energy and angular momentum over an hour, of N steps of h s, by
    method of drift control.

    none: joints drift by the round-off of the accelerations, 100 eps, summed twice, and the joint
    force does work over that drift: 100 eps h^2 N^1.5. projection: a correction of at most 1e-12 a
    step, of either sign: 1e-12 sqrt(N). baumgarte: its correction is as large as the error of the
    inner stages of a step; only the audit limits it, to the bound of ``energy_residual``.
    """
    return {
        "none": Bound(100.0 * EPS * STEP**2 * STEPS**1.5, "100 eps x h^2 N^1.5 (drift)"),
        "projection": Bound(1e-12 * math.sqrt(STEPS), "1e-12 x sqrt(N) (corrections)"),
        "baumgarte": Bound(AUDIT_BOUNDS["energy_residual"], "1e-6 (audit)"),
    }


def hour() -> list[Stress]:
    """Lines of `sepmc stress` on one hour of 72,000 steps, by motion and method of drift control:
    energy and angular momentum are constant, and a weld follows its closed form. Those of
    ``projection`` must be accurate."""
    lines = []
    turned = float(np.linalg.norm(OMEGA)) * HOUR
    for x in hours():
        bound, label = _bounds()[x.method], f"1 h of {x.motion}, {x.method}"
        lines.append(
            judge(label, "energy", x.energy, bound, x.run, resolved=x.method == "projection")
        )
        lines.append(
            judge(
                label,
                "angular momentum",
                x.angular_momentum,
                bound,
                x.run,
                resolved=x.method == "projection",
            )
        )
        if x.motion == "weld":
            angle = Bound(bound.value * turned, "that x 4500 rad turned")
            lines.append(
                judge(
                    label, "attitude", x.attitude, angle, x.run, resolved=x.method == "projection"
                )
            )
    return lines


def hours_table() -> str:
    """Table of the runs of `hours` as plain text: joint residuals, changes of the invariants, and
    the time of a step of a single case, in us and as a multiple of that without drift control."""
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
            x.run.outcomes,
            next(y.step_s for y in hours() if y.motion == x.motion and y.method == "none"),
        )
        changes = (
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
                x.method,
                *(f"{v:.1e}" for v in changes),
                attitude,
                f"{1e6 * x.step_s:.2f}",
                f"{x.step_s / base:.3f}",
            )
        )
    return "\n".join(text_table(rows, left=(0, 1)))
