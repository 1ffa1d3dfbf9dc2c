"""An hour of constrained motion in empty space with each way to hold drift: what is lost, and what it costs."""

import math
import time
from dataclasses import dataclass
from functools import cache

import numpy as np

from sepmc.campaign.settle import fly_general
from sepmc.schema import AUDIT_BOUNDS
from sepmc.trust.flights import Flight, tensor, to_ground
from sepmc.trust.stresses.line import EPS, Bound, Stress, judge, relative
from sepmc.trust.stresses.scenes import AFT, FORE, OMEGA, Composite, Tree, body, fly, held, joint, make, pair, scene

WAYS = ("none", "baumgarte", "projection")
HOUR, STEP = 3600.0, 0.05  # s
STEPS = round(HOUR / STEP)
REPEATS = 3  # of the timing; the least counts


@dataclass(frozen=True)
class Hour:
    """One flight of an hour: largest changes relative to what is kept, largest violation, and the seconds the kernel took."""

    motion: str
    way: str
    found: Flight
    energy: float
    angular_momentum: float
    attitude: float  # NaN where there is no closed form
    seconds: float


def _chain() -> Tree:
    """Three bodies on two ball joints: nothing regular about its motion."""
    last = body(2.1, [0.8, 1.5, 1.2], [4.2, 0.1, 0.06], [0.0, -0.1, 0.15])
    joints = {"front": joint("fore", "aft", [2.0, 0.1, 0.05]), "rear": joint("aft", "last", [3.6, 0.0, 0.0])}
    return scene({"fore": FORE, "aft": AFT, "last": last}, joints, held(front="spherical", rear="spherical"), HOUR, STEP, OMEGA)


def motions() -> dict[str, Tree]:
    """What flies for an hour: at 1.2 rad/s, 4500 rad in all."""
    return {"weld": pair("fixed", HOUR, STEP), "hinge": pair("revolute", HOUR, STEP), "chain of balls": _chain()}


def invariants(found: Flight) -> tuple[np.ndarray, np.ndarray]:
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
        seconds = _seconds(given)
        for way in WAYS:
            found = fly(given[way])
            energy, spin = invariants(found)
            attitude = Composite(found, "aft", [2.0, 0.1, 0.0]).attitude_error() if motion == "weld" else math.nan
            changes = relative(energy, np.full_like(energy, energy[0])), relative(spin, np.broadcast_to(spin[0], spin.shape))
            flown.append(Hour(motion, way, found, *changes, attitude, seconds[way]))
    return tuple(flown)


def _seconds(given: dict[str, Tree]) -> dict[str, float]:
    """Least processor time of a flight without history, by way; the ways take turns, so that a busy machine slows all alike."""
    campaigns, least = {way: make(tree) for way, tree in given.items()}, dict.fromkeys(given, math.inf)
    for _ in range(REPEATS):
        for way, campaign in campaigns.items():
            start = time.process_time()
            fly_general(campaign, STEP, np.empty((1, 0)))
            least[way] = min(least[way], time.process_time() - start)
    return least


def _bounds() -> dict[str, Bound]:
    """What an hour may lose, relative, by way.

    none: round-off of the accelerations, 100 eps, summed twice, is how far joints drift, and the joint force works over that.
    projection: corrects what is beyond 1e-12 (kernels/correct.py), at most once a step, either way.
    baumgarte: what it pulls with is of the size of the error of the inner stages; only the audit bounds it.
    """
    return {
        "none": Bound(100.0 * EPS * STEP**2 * STEPS**1.5, "100 eps x h^2 N^1.5 (drift)"),
        "projection": Bound(1e-12 * math.sqrt(STEPS), "1e-12 x sqrt(N) (corrections)"),
        "baumgarte": Bound(AUDIT_BOUNDS["energy_residual"], "1e-6 (audit)"),
    }


def hour() -> list[Stress]:
    """An hour of 72,000 steps: energy and angular momentum stay, and a weld is where the closed form has it."""
    lines = []
    turned = float(np.linalg.norm(OMEGA)) * HOUR
    for x in hours():
        bound, given = _bounds()[x.way], f"1 h of {x.motion}, {x.way}"
        lines.append(judge(given, "energy", x.energy, bound, x.found, resolved=x.way == "projection"))
        lines.append(judge(given, "angular momentum", x.angular_momentum, bound, x.found, resolved=x.way == "projection"))
        if x.motion == "weld":
            angle = Bound(bound.value * turned, "that x 4500 rad turned")
            lines.append(judge(given, "attitude", x.attitude, angle, x.found, resolved=x.way == "projection"))
    return lines


def hours_table() -> str:
    """What each way to hold drift loses over an hour, and its run time beside that of none."""
    head = ("motion", "drift", "gap, m", "gap rate, m/s", "angle, rad", "energy", "ang. momentum", "attitude", "time, s", "over none")
    rows: list[tuple[str, ...]] = [head]
    for x in hours():
        o, base = x.found.outcomes, next(y.seconds for y in hours() if y.motion == x.motion and y.way == "none")
        lost = (o["joint_gap_residual_m"], o["joint_gap_rate_residual_m_s"], o["joint_angle_residual_rad"], x.energy, x.angular_momentum)
        attitude = "-" if math.isnan(x.attitude) else f"{x.attitude:.1e}"
        rows.append((x.motion, x.way, *(f"{v:.1e}" for v in lost), attitude, f"{x.seconds:.2f}", f"{x.seconds / base:.3f}"))
    widths = [max(len(row[i]) for row in rows) for i in range(len(rows[0]))]
    text = ["  ".join(c.ljust(w) if i < 2 else c.rjust(w) for i, (c, w) in enumerate(zip(row, widths, strict=True))) for row in rows]
    return "\n".join(line.rstrip() for line in text)
