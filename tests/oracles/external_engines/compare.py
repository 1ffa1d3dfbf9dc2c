"""Comparison with external engines: the same cases, quantity by quantity.

Compared quantities, and the scale of their differences (the largest magnitude over the run, but at
least the floor):

================== ============================================== ======================
quantity           difference                                     size (floor)
================== ============================================== ======================
release time       of a joint becoming free                       the time (0.01 s)
gap                vector between the two copies of a joint       its length (0.01 m)
                   point, axes of the first body
position, velocity of every mass centre, in the frame that moves  length (1 m, 1 m/s)
                   with the initial velocity
attitude           angle between the two attitudes of a body      angle since t = 0 (0.01)
rate               angular velocity of every body, body axes      its length (0.01 rad/s)
force, moment      of every joint, on both bodies, each at its    length (1 N, 1 N m)
                   own copy of the point
... at release     the same at the last instant before the joint  the same
                   became free
================== ============================================== ======================

States are compared every ``step_s``, and so are forces and moments, except at the instants at which
a thrust or a load switches, where they have two values; at a release they are those before it.

heyoka and Pinocchio differ by round-off only: if a difference exceeds their tolerance, run the
campaign again with a smaller ``solver.step_s``. The part that vanishes is truncation of the engine,
the rest is a disagreement.
"""

import importlib
import time
from typing import Any

import numpy as np
import pandas as pd

from oracles.external_engines.case import GROUND, Case, attitude
from oracles.external_engines.loads import motor_switches
from sepmc.paths import EXTRA
from sepmc.scene.messages import InputError, Log, no_log

ENGINES = ("heyoka", "pinocchio", "exudyn")
FLOORS = {
    "release time": 0.01,
    "gap": 0.01,
    "position": 1.0,
    "velocity": 1.0,
    "attitude": 0.01,
    "rate": 0.01,
    "force": 1.0,
    "moment": 1.0,
}
FLOORS |= {"force at release": 1.0, "moment at release": 1.0}
TOLERANCES = {
    "heyoka": {"states": 1e-10, "wrenches": 1e-10},
    "pinocchio": {"states": 1e-10, "wrenches": 1e-10},
    "exudyn": {"states": 1e-6, "wrenches": 1e-5},
}
Record = dict[str, np.ndarray]
# Campaign, cases (-1: the nominal), step of the engine and of the compared instants, s. With these
# steps the engine's truncation is below 1e-10.
FLIGHTS = (
    ("table2", list(range(20)), 0.05, 0.01),
    ("nasa-fixed-joint", [-1, 0, 1], 0.05, 0.1),
    ("spring-pushers", [-1, 0, 1], 0.01, 0.02),
    ("residual-thrust", [-1, 0, 1], 0.01, 0.05),
    ("missile-rail", [0, 1, 2], 0.002, 0.005),
    ("srb", [-1], 0.05, 0.05),
)


def installed(say: Log = print) -> dict[str, Any]:
    """Installed engines, by name: their ``fly``."""
    engines = {}
    for name in ENGINES:
        try:
            engines[name] = importlib.import_module(f"oracles.external_engines.{name}").fly
        except ImportError:
            say(f"{name} is not installed, its flights are left out: {EXTRA.format('peers')}")
    return engines


def needed(say: Log) -> dict[str, Any]:
    """Installed engines; raises InputError if there is none."""
    engines = installed(no_log)
    if not engines:
        names = ", ".join(ENGINES)
        raise InputError(f"none of {names} is installed: {EXTRA.format('peers')}")
    return installed(say)


def report(
    say: Log = print, flights=FLIGHTS, engines: dict[str, Any] | None = None
) -> tuple[str, bool]:
    """Simulate `FLIGHTS` with ``engines``, or all installed ones: the differences as a table, and
    whether all are within their tolerances.

    Nothing agrees if no engine is installed.
    """
    from sepmc.campaign.campaign import load

    engines = installed(say) if engines is None else engines
    tables = []
    for name, numbers, step, every in flights if engines else ():
        say(f"{name}: {len(numbers)} cases with {', '.join(engines)} ...")
        tables.append(compare(load(name, {"solver.step_s": step}), numbers, every, engines, say))
    if not tables:
        return "no other engine is installed", False
    frame = pd.concat(tables, ignore_index=True)
    return text(frame), bool((frame["verdict"] == "agrees").all())


def text(frame: pd.DataFrame) -> str:
    """Differences as a plain table of at most 140 columns: a row for each campaign and engine, a
    column for each quantity."""
    short = {
        q: q.replace(" at release", " rel.").replace("release time", "release") for q in FLOORS
    }
    lines = [
        f"{'campaign':17s}{'engine':10s}"
        + "".join(f"{short[q]:>11.11s}" for q in FLOORS)
        + f"{'s/case':>8s}  verdict"
    ]
    for (campaign, engine), rows in frame.groupby(["campaign", "engine"], sort=False):
        differences = dict(zip(rows["quantity"], rows["difference"], strict=True))
        cells = "".join(
            f"{differences[q]:11.1e}" if q in differences else f"{'-':>11s}" for q in FLOORS
        )
        verdict = "agrees" if (rows["verdict"] == "agrees").all() else "DIFFERS"
        lines.append(
            f"{campaign:17.16s}{engine:10s}{cells}{rows['seconds_per_case'].iloc[0]:8.1f}  "
            f"{verdict}"
        )
    return "\n".join(lines)


def _turned(a: np.ndarray, b: np.ndarray) -> np.ndarray:
    """Angle between attitudes, rad, without loss for small ones: |A - B| = 2 sqrt(2) sin(angle /
    2)."""
    return 2.0 * np.arcsin(np.minimum(1.0, np.linalg.norm(a - b, axis=(-2, -1)) / np.sqrt(8.0)))


def _gap(case: Case, record: Any, joint: str) -> np.ndarray:
    """Gap of a joint (n, 3), m, from the states of its bodies, axes of the first body."""
    j = case.joints[joint]
    place = []
    for body, arm in ((j.first, j.arm_first), (j.second, j.arm_second)):
        still = case.ground_motion(0.0)
        x, R = (
            (still.x - np.outer(record.times, case.velocity), still.R)
            if body == GROUND
            else (record.x[body], record.R[body])
        )
        place.append(x + R @ arm)
    R_a = still.R[None] if j.first == GROUND else record.R[j.first]
    return np.einsum("nji,nj->ni", np.broadcast_to(R_a, (len(place[0]), 3, 3)), place[1] - place[0])


def peer_record(case: Case, flight: Any) -> dict[str, Record]:
    """Quantities of an external engine's result, by body or joint."""
    out: dict[str, Record] = {"release time": {n: np.array([t]) for n, t in flight.release.items()}}
    out["gap"] = {n: _gap(case, flight, n) for n in case.joints}
    out["position"], out["velocity"], out["attitude"], out["rate"] = (
        flight.x,
        flight.v,
        flight.R,
        flight.w,
    )
    for k, what in enumerate(("force", "moment")):
        out[what] = {n: w[:, [k, k + 2]] for n, w in flight.wrench.items()}
        out[f"{what} at release"] = {n: w[[k, k + 2]][None] for n, w in flight.at_release.items()}
    return out


def our_record(case: Case, history: pd.DataFrame, times: np.ndarray) -> dict[str, Record]:
    """The same quantities of a history."""
    before = history.drop_duplicates("time_s", keep="first")
    at = np.searchsorted(before["time_s"].to_numpy(), times - 1e-9)
    rows = before.iloc[at]
    outcomes = history.attrs["outcomes"]
    lone = len(case.joints) == 1

    def vectors(frame: pd.DataFrame, pattern: str) -> np.ndarray:
        return frame[[pattern.format(a) for a in "xyz"]].to_numpy()

    out: dict[str, Record] = {q: {} for q in FLOORS}
    for b in case.bodies:
        drift = np.outer(times, case.velocity) + np.array([0.0, case.altitude, 0.0])
        out["position"][b] = vectors(rows, b + "_{}_m") - drift
        out["velocity"][b] = vectors(rows, b + "_v{}_m_s") - case.velocity
        out["rate"][b] = np.radians(vectors(rows, b + "_omega_{}_deg_s"))
        angles = np.radians(rows[[f"{b}_{a}_deg" for a in ("pitch", "yaw", "roll")]].to_numpy())
        out["attitude"][b] = _attitudes(*angles.T)
    for n, j in case.joints.items():
        out["release time"][n] = np.array(
            [outcomes["release_time_s" if lone else f"{n}_release_time_s"]]
        )
        out["gap"][n] = vectors(rows, n + "_gap_{}_m")
        last = before[np.abs(before["time_s"] - out["release time"][n][0]) < 1e-12]
        for what, unit in (("force", "N"), ("moment", "N_m")):
            patterns = [f"{n}_{what}_on_{b}_{{}}_{unit}" for b in (j.first, j.second)]
            out[what][n] = np.stack([vectors(rows, p) for p in patterns], axis=1)
            none = np.full((1, 2, 3), np.nan)
            out[f"{what} at release"][n] = (
                np.stack([vectors(last, p) for p in patterns], axis=1) if len(last) else none
            )
    return out


def _attitudes(pitch: np.ndarray, yaw: np.ndarray, roll: np.ndarray) -> np.ndarray:
    return np.array([attitude(*angles) for angles in zip(pitch, yaw, roll, strict=True)])


def differences(
    ours: dict[str, Record], theirs: dict[str, Record], keep: np.ndarray
) -> dict[str, float]:
    """Largest relative difference of every quantity; ``keep`` flags the instants at which forces
    have one value."""
    out = {}
    for quantity, floor in FLOORS.items():
        worst = []
        for name, a in ours[quantity].items():
            b = theirs[quantity][name]
            if quantity in ("force", "moment"):
                a, b = a[keep], b[keep]
            if quantity == "attitude":
                size, gap = _turned(a, a[:1]).max(), _turned(a, b)
            else:
                a, b = a.reshape(-1, a.shape[-1]), b.reshape(-1, b.shape[-1])
                size, gap = (
                    np.nanmax(np.linalg.norm(a, axis=-1), initial=0.0),
                    np.linalg.norm(a - b, axis=-1),
                )
            gap = np.where(
                np.isnan(a).reshape(len(gap), -1).any(1) & np.isnan(b).reshape(len(gap), -1).any(1),
                0.0,
                gap,
            )
            worst.append(np.inf if np.isnan(gap).any() else gap.max(initial=0.0) / max(size, floor))
        if worst:
            out[quantity] = float(max(worst))
    return out


def one_value(case: Case, times: np.ndarray) -> np.ndarray:
    """Instants at which no thrust and no load switches."""
    switches = [s for m in case.data.get("motor", ()) for s in motor_switches(m)]
    switches += [
        s for c in case.data.get("load", ()) for s in (c.get("start", 0.0), c.get("end", np.inf))
    ]
    return np.array(
        [min((abs(t - s) for s in switches if s > 0.0), default=1.0) > 1e-9 for t in times]
    )


def compare(
    campaign: Any,
    numbers: list[int],
    step_s: float = 0.01,
    engines: dict[str, Any] | None = None,
    say: Log = print,
) -> pd.DataFrame:
    """Simulate cases of a campaign with every installed engine.

    Parameters
    ----------
    campaign : sepmc.Campaign
    numbers : list of int
        Cases; -1 is the nominal one.
    step_s : float
        Between the compared instants.
    engines : dict of callable, optional
        Name to ``fly(data, times)``; those of `installed` by default.
    say : callable
        Called with messages on what an engine cannot simulate.

    Returns
    -------
    DataFrame
        engine, campaign, quantity, difference (largest relative one over the cases), case (of the
        largest), tolerance, verdict, and seconds a case.
    """
    engines = installed(say) if engines is None else engines
    largest: dict[tuple[str, str], tuple[float, int]] = {}
    spent = dict.fromkeys(engines, 0.0)
    for number in numbers:
        resolved = campaign.nominal() if number < 0 else campaign.case(number)
        data = resolved.to_dict()
        case = Case(data)
        times = np.arange(int(np.floor(case.end_time / step_s + 1e-9)) + 1) * step_s
        times[-1] = min(times[-1], case.end_time)
        history = campaign.simulate(resolved, step_s, no_log)
        if history.attrs["status"] != "ok":
            raise ValueError(f"case {number} did not fly: {history.attrs['status']}")
        if history["time_s"].iloc[-1] < times[-1] - 1e-9:
            raise ValueError(
                f"the history of case {number} ends at {history['time_s'].iloc[-1]} s, before the "
                "flight does"
            )
        ours, keep = our_record(case, history, times), one_value(case, times)
        for name, fly in list(engines.items()):
            began = time.perf_counter()
            try:
                flight = fly(data, list(times))
            except NotImplementedError as reason:
                say(f"{name} does not fly {campaign.name}: {reason}")
                engines = {n: f for n, f in engines.items() if n != name}
                continue
            spent[name] += time.perf_counter() - began
            theirs = peer_record(case, getattr(flight, "flight", flight))
            for quantity, value in differences(ours, theirs, keep).items():
                if value >= largest.get((name, quantity), (-1.0, 0))[0]:
                    largest[name, quantity] = (value, number)
    rows = []
    for (name, quantity), (value, number) in largest.items():
        tolerance = TOLERANCES.get(name, TOLERANCES["exudyn"])[
            "wrenches" if quantity.startswith(("force", "moment")) else "states"
        ]
        verdict = "agrees" if value <= tolerance else "DIFFERS"
        rows.append(
            (
                name,
                campaign.name,
                quantity,
                value,
                number,
                tolerance,
                verdict,
                spent[name] / len(numbers),
            )
        )
    return pd.DataFrame(
        rows,
        columns=[
            "engine",
            "campaign",
            "quantity",
            "difference",
            "case",
            "tolerance",
            "verdict",
            "seconds_per_case",
        ],
    )
