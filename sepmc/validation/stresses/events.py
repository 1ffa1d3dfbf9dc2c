"""Stresses of events: releases at the peak of a load, at angle limits, at one instant, and under
load. Every stress is a function that simulates such cases and returns their judged lines."""

import math
from typing import Any

import numpy as np
from scipy.optimize import brentq

from sepmc.schema import AUDIT_BOUNDS
from sepmc.validation import references as ref
from sepmc.validation.flights import NominalRun
from sepmc.validation.stresses.drift import invariants
from sepmc.validation.stresses.line import EPS, FORM, Bound, Stress, judge, relative
from sepmc.validation.stresses.scenes import Tree, body, joint, phase_of, pushed, scene, simulate
from sepmc.validation.stresses.strokes import ROOT, located


def _swung(condition: dict[str, float], step: float) -> Tree:
    """Tree of a body on a hinge to the ground that swings from rest at 80 deg from its lowest
    position. The hinge is released on ``condition``, keys of ``until``, or at 1 s, whichever is
    first. Step in s."""
    bob = body(2.0, [0.1, 0.3, 0.3], [1.0, 0.0, 0.0])
    hinge = joint("ground", "bob", [0.0, 0.0, 0.0], x_axis=[0.0, 0.0, 1.0])
    until = {"any": [{"joint": "hinge", **condition}, {"time_s": 1.0}]}
    phases: list[Tree] = [
        {"name": "swinging", "joints": {"hinge": "revolute"}, "until": until},
        {"name": "free"},
    ]
    return scene({"bob": bob}, {"hinge": hinge}, phases, 1.2, step,
    environment={"gravity": "constant"},
                 initial={"pitch_deg": 10.0}, output={"loads": ["hinge"]})  # fmt: skip


def _load(angle: float, start: float) -> float:
    """Force of the hinge of `_swung`, N, at an angle from the lowest position, rad, in a swing from
    rest at ``start``, rad: from its components along and across the arm, with m = 2, L = 1, J =
    2.3."""
    weight, fraction = 2.0 * 9.80665, 2.0 / 2.3
    tangent = weight * (math.cos(angle) + 2.0 * fraction * (math.cos(angle) - math.cos(start)))
    return math.hypot(tangent, weight * (1.0 - fraction) * math.sin(angle))


def peak_loads() -> list[Stress]:
    """Lines of `sepmc stress` on the release time of a hinge with a break load just below, or just
    above, the peak load of a swing, which lies within a step. A load above the peak is not
    reached: the release expected then is that by time, at 1 s. All must be accurate."""
    frequency, start = math.sqrt(2.0 * 9.80665 / 2.3), math.radians(-80.0)
    lowest, peak = 0.25 * ref.pendulum_period(frequency, start), _load(0.0, start)
    lines = []
    for step in (0.005, 0.02, 0.05, 0.1):
        for margin in (1e-2, 1e-3, 1e-4, 1e-6, -1e-6, -1e-3):
            limit, time, bound = peak * (1.0 - margin), 1.0, located(1.0)
            run = simulate(_swung({"force_N": limit}, step))
            if margin > 0.0:
                time = brentq(
                    lambda t, f=limit: (
                        _load(float(ref.pendulum(t, frequency, start)[0]), start) - f
                    ),
                    0.0,
                    lowest,
                    xtol=1e-15,
                )
                slope = (
                    limit - _load(float(ref.pendulum(time - 1e-6, frequency, start)[0]), start)
                ) / 1e-6
                # relative to the load: requested of a resolved swing
                fraction = FORM.value if step <= 0.05 else AUDIT_BOUNDS["energy_residual"]
                bound = Bound(ROOT + peak * fraction / slope, f"{fraction:.0e} of the load / slope")
            error = abs(run.outcomes["release_time_s"] - time)
            lines.append(
                judge(
                    f"load {margin:+.0e} below peak, h {step:g} s",
                    "release, s",
                    error,
                    bound,
                    run,
                    True,
                )
            )
    return lines


def angle_limits() -> list[Stress]:
    """Lines of `sepmc stress` on the release time of a hinge with an angle limit from 1e-6 deg to
    180 deg, where the angle between two bodies turns back. Each passes also if it is flagged."""
    lines = []
    for degrees in (1e-6, 90.0, 179.0, 179.999, 180.0):
        for step in (0.05, 0.013):
            stone = body(1.0, [1.0, 1.0, 1.0], [0.0, 0.0, 0.0])
            phases: list[Tree] = [
                {
                    "name": "turning",
                    "joints": {"hinge": "revolute"},
                    "until": {"joint": "hinge", "angle_deg": degrees},
                },
                {"name": "free"},
            ]
            hinge = joint("ground", "stone", [0.0, 0.0, 0.0], x_axis=[0.0, 0.0, 1.0])
            run = simulate(
                scene({"stone": stone}, {"hinge": hinge}, phases, 5.0, step, [0.0, 0.0, 1.0])
            )
            error = abs(run.outcomes["release_time_s"] - math.radians(degrees))
            # the angle follows from the sine of its half, whose slope is cos(angle / 2)
            bound = Bound(
                ROOT + 50.0 * EPS / max(math.cos(0.5 * math.radians(degrees)), math.sqrt(EPS)),
                "50 eps / cos(angle / 2)",
            )
            lines.append(
                judge(f"hinge until {degrees:g} deg, h {step:g} s", "release, s", error, bound, run)
            )
    return lines


def _boosters(releases: list[Tree], phases: list[Tree]) -> NominalRun:
    """Run of a core with two boosters beside it, ``left`` and ``right``, on joints of these names,
    pushed aft equally; ``releases`` and ``phases`` as in a file."""
    bodies = {"core": body(4.0, [2.0, 5.0, 5.0], [2.0, 0.0, 0.0])}
    joints, springs = {}, []
    for name, side in (("left", 1.0), ("right", -1.0)):
        point = [2.0, side, 0.0]
        bodies[name] = body(1.0, [0.2, 1.0, 1.0], point)
        joints[name] = joint("core", name, point, apart=-1)
        springs.append(
            {
                "name": f"push_{name}",
                "bodies": ["core", name],
                "point_m": point,
                "axis": [-1.0, 0.0, 0.0],
                "force_N": 2.0,
            }
        )
    return simulate(scene(bodies, joints, phases, 0.5, 0.05, spring=springs, release=releases))


def simultaneous() -> list[Stress]:
    """Lines of `sepmc stress` on release times: of two joints at one instant (and on the sideways
    rates of the body between them, which stay 0); of a phase ended by a time or a stroke that are
    met at one instant, or nearly so; of conditions met before their phase begins; of a delayed
    joint. All must be accurate."""
    lines = []
    # 2 N on 1 kg, and 4 N on 4 kg the other way: 3 m/s2
    stroke, time = 0.0375, math.sqrt(2.0 * 0.0375 / 3.0)
    by_stroke = [
        {"name": f"go_{j}", "joint": j, "when": {"joint": j, "stroke_m": stroke}}
        for j in ("left", "right")
    ]
    until = {"all": [release["when"] for release in by_stroke]}
    at_once: list[Tree] = [
        {"name": "on", "joints": {"left": "slider", "right": "slider"}, "until": until},
        {"name": "off"},
    ]
    for label, releases, phases in (
        ("two joints, each on its own stroke", by_stroke, phase_of(left="slider", right="slider")),
        ("two joints, one phase, both strokes", [], at_once),
    ):
        run = _boosters(releases, phases)
        for j in ("left", "right"):
            error = abs(run.outcomes[f"{j}_release_time_s"] - time)
            lines.append(judge(label, f"release of {j}, s", error, located(3.0 * time), run, True))
        lines.append(
            judge(
                label,
                "sideways rates",
                float(np.max(np.abs(run.body("core").w))),
                FORM,
                run,
                True,
            )
        )
    lines += [
        _line("stroke reached at a time given", {"time_s": 0.5}, 0.25, 0.5),
        _line("time given 1e-13 s before the stroke", {"time_s": 0.5 - 1e-13}, 0.25, 0.5),
    ]
    lines.append(_line("time given 1e-9 s after the stroke", {"time_s": 0.5 + 1e-9}, 0.25, 0.5))
    lines.append(_line("event at 0 s", {"time_s": 0.0}, 0.25, 0.0))
    lines += _cascade()
    return lines


def _line(label: str, until: dict[str, Any], stroke: float, time: float) -> Stress:
    """Line of `sepmc stress` on the release time in the scene that `pushed` makes: its slider ends
    at ``stroke``, m, or at a condition in ``until``, whichever is first. ``time`` is the expected
    release time, s. It must be accurate."""
    run = simulate(pushed(stroke, **until))
    return judge(
        label,
        "release, s",
        abs(run.outcomes["release_time_s"] - time),
        located(2.0 * max(time, 0.1)),
        run,
        True,
    )


def _cascade() -> list[Stress]:
    """Two lines of `sepmc stress` on release times: phases whose conditions are met before they
    begin all end at one instant; a joint with a delay is released that much after its condition is
    met."""
    tree = pushed(0.04)
    at = {"joint": "link", "stroke_m": 0.04}
    tree["phase"] = [
        {"name": "fixed", "joints": {"link": "fixed"}, "until": {"time_s": 0.1}},
        {"name": "guided", "joints": {"link": "slider"}, "until": at},
        {
            "name": "looser",
            "joints": {"link": "point-on-line"},
            "until": {"joint": "link", "stroke_m": 0.03},
        },
        {"name": "free"},
        {"name": "freer", "until": {"any": [{"time_s": 0.2}, at]}},
        {"name": "last"},
    ]
    tree["phase"][3]["until"] = at
    run = simulate(tree)
    lines = [
        judge(
            "three events at one instant",
            "release, s",
            abs(run.outcomes["release_time_s"] - 0.3),
            located(0.4),
            run,
            True,
        )
    ]
    late = pushed(0.04)
    late["joint"]["link"]["delay_s"] = 0.1
    run = simulate(late)
    return [
        *lines,
        judge(
            "joint released two steps late",
            "release, s",
            abs(run.outcomes["release_time_s"] - 0.3),
            located(0.4),
            run,
            True,
        ),
    ]


def under_load() -> list[Stress]:
    """Lines of `sepmc stress` on a weld released under a load of 2e3 to 2e11 N: rates, energy and
    angular momentum are constant, and the mass centre of the second body continues along its
    tangent. All must be accurate."""
    lines = []
    for rate in (1.0, 100.0, 1e4):
        bodies = {
            "fore": body(2e3, [1e3, 1e3, 1e3], [0.0, 0.0, 0.0]),
            "aft": body(1e3, [1e3, 1e3, 1e3], [3.0, 0.0, 0.0]),
        }
        phases: list[Tree] = [
            {"name": "held", "joints": {"link": "fixed"}, "until": {"time_s": 0.5 / rate}},
            {"name": "free"},
        ]
        run = simulate(
            scene(
                bodies,
                {"link": joint("fore", "aft", [1.0, 0.0, 0.0])},
                phases,
                1.0 / rate,
                0.05 / rate,
                [0.0, 0.0, rate],
            )
        )
        energy, spin = invariants(run)
        label = f"release under {1e3 * rate**2 * 2.0:.0e} N"
        error = relative([run.body(b).w[-1] for b in ("fore", "aft")], [0.0, 0.0, rate])
        lines.append(judge(label, "rates", error, FORM, run, True))
        lines.append(
            judge(
                label,
                "energy",
                relative(energy, np.full_like(energy, energy[0])),
                FORM,
                run,
                True,
            )
        )
        lines.append(
            judge(
                label,
                "angular momentum",
                relative(spin, np.broadcast_to(spin[0], spin.shape)),
                FORM,
                run,
                True,
            )
        )
        angle = np.minimum(rate * run.t, 0.5)
        # aft is 2 m behind the mass centre
        tangent = (
            np.stack([np.sin(angle), -np.cos(angle), np.zeros_like(angle)], axis=1) * 2.0 * rate
        )
        lines.append(
            judge(label, "velocity", relative(run.body("aft").v, tangent), FORM, run, True)
        )
    return lines
