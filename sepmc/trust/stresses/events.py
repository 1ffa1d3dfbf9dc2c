"""Strokes that are short, grazing, exact or out of reach; events at one instant; releases under load."""

import math
from typing import Any

import numpy as np

from sepmc.trust import references as ref
from sepmc.trust.flights import Flight
from sepmc.trust.stresses.drift import invariants
from sepmc.trust.stresses.line import EPS, FORM, NONE, Bound, Stress, judge, relative
from sepmc.trust.stresses.scenes import Tree, body, fly, held, joint, pushed, scene

ROOT, TOUCH = 1e-13, 1e-12  # s, m: how near an event is located; what counts as met (kernels/flight.py, events.py)
ACCELERATION = 2.0  # m/s2, of the gap in `pushed`


def _located(speed: float) -> Bound:
    """Error of the time of an event that is passed at a speed, m/s: the root's own, and round-off of places of some metres."""
    return Bound(ROOT + 50.0 * EPS / speed, "1e-13 s + 50 eps m / speed")


def strokes() -> list[Stress]:
    """Pins from 0 to 1 m long, drawn with 2 m/s2: when they let go, and how fast the bodies then part."""
    lines = []
    for stroke in (0.0, 1e-15, 1e-12, 1.001e-12, 1e-11, 1e-9, 1e-6, 1e-3, 0.25):
        found = fly(pushed(stroke))
        time, speed = math.sqrt(2.0 * stroke / ACCELERATION), math.sqrt(2.0 * ACCELERATION * stroke)
        bound = _located(speed) if stroke > TOUCH else Bound(math.sqrt(2.0 * TOUCH / ACCELERATION), "1e-12 m counts as met")
        given = f"pins of {stroke:g} m" + (", at the end of a step" if stroke == 0.25 else "")
        lines.append(judge(given, "release, s", abs(found.outcomes["release_time_s"] - time), bound, found, True))
        lines.append(judge(given, "speed at the end", relative(found.outcomes["separation_speed_m_s"], 2.0), FORM, found, True))
    for given, tree in (
        ("pins never drawn", pushed(2.0)),
        ("pins pushed the other way", pushed(1e-9, spring={"force_N": -1.5})),
    ):
        lines.append(judge(given, "release, s", fly(tree).outcomes["release_time_s"], NONE, fly(tree)))
    found = fly(pushed(1.0))
    lines.append(judge("pins drawn just at the end of the run", "release, s", abs(found.outcomes["release_time_s"] - 1.0), _located(2.0), found))
    return lines


FREQUENCY = 2.0 * math.pi  # rad/s, of the oscillation below
TOP = 0.1  # m


def _oscillator(stroke: float, end: float = 0.9, step: float = 0.05, where: str = "stroke_m") -> Tree:
    """`pushed` by a spring that swings the gap between 0 and TOP with a period of 1 s; released at a stroke, or at 0.8 s."""
    mass = ref.reduced_mass(3.0, 1.0)
    spring = {"force_N": 0.5 * mass * FREQUENCY**2 * TOP, "stiffness_N_per_m": mass * FREQUENCY**2}
    tree = pushed(stroke, end=end, step=step, spring=spring)
    tree["phase"][0]["until"] = {"joint": "link", where: stroke, "time_s": end - 0.1}
    return tree


def grazing() -> list[Stress]:
    """A stroke just reached, and just not, at the top of an oscillation that lies between two steps of 0.05 to 0.3 s."""
    lines = []
    for step in (0.05, 0.17, 0.3):
        for margin in (1e-3, 1e-6, 1e-9, 1e-12, 0.0, -1e-11, -1e-9, -1e-6, -1e-3):
            found = fly(_oscillator(TOP * (1.0 - margin), step=step))
            # from the top the gap falls as TOP (1 - cos) / 2, so the time before it is 2 asin(sqrt(margin))
            before = 2.0 * math.asin(math.sqrt(max(margin, 0.0))) / FREQUENCY
            time = math.pi / FREQUENCY - before if margin > 0.0 else 0.8
            bound = _located(0.5 * TOP * FREQUENCY * math.sin(FREQUENCY * before) if margin > 0.0 else 1.0)
            if step > 0.05:  # the oscillation itself is known to the order of the method: a step of z rad loses z^9 / 9!
                lost = TOP * (step * FREQUENCY) ** 9 / math.factorial(9)
                bound = Bound(bound.value * (1.0 + lost / (50.0 * EPS)), "+ truncation z^9/9! over speed")
            if abs(margin) <= 1e-11:  # as much as counts as met, or less: reached or not
                error = min(abs(found.outcomes["release_time_s"] - t) for t in (math.pi / FREQUENCY, 0.8))
                bound = Bound(math.sqrt(4.0 * TOUCH / TOP) / FREQUENCY * 4.0, "1e-12 m counts as met")
            else:
                error = abs(found.outcomes["release_time_s"] - time)
            lines.append(judge(f"stroke {margin:+.0e} below the top, h {step:g} s", "release, s", error, bound, found, True))
    found = fly(_oscillator(TOP * (1.0 + 1e-9), end=20.1))
    lines.append(judge("stroke 1e-9 above 20 tops", "release, s", abs(found.outcomes["release_time_s"] - 20.0), _located(1.0), found, True))
    return lines


def spent_springs() -> list[Stress]:
    """A spring whose own stroke ends just below, or just above, the top of the swing: it is spent, or pulls the bodies back."""
    lines = []
    for margin in (1e-3, 1e-6, 1e-9, -1e-9, -1e-6, -1e-3):
        tree = _oscillator(2.0 * TOP)
        stroke = TOP * (1.0 - margin)
        tree["spring"][0]["stroke_m"] = stroke
        tree["joint"]["link"]["bodies"] = ["fore", "aft"]
        found = fly(tree)
        end = 0.9
        if margin > 0.0:
            before = 2.0 * math.asin(math.sqrt(margin)) / FREQUENCY
            speed = 0.5 * TOP * FREQUENCY * math.sin(FREQUENCY * before)
            gap = stroke + speed * (end - math.pi / FREQUENCY + before)
            bound = Bound(max(FORM.value * TOP, 50.0 * EPS / math.sin(FREQUENCY * before)), "50 eps m over the slope there")
        else:
            gap, bound = 0.5 * TOP * (1.0 - math.cos(FREQUENCY * end)), Bound(FORM.value * TOP, FORM.reason)
        error = abs(1e-3 * found.outcomes["separation_distance_mm"] - gap)
        lines.append(judge(f"spring spent {margin:+.0e} below the top", "gap at the end, m", error, bound, found, True))
    return lines


def _swung(condition: dict[str, float], step: float) -> Tree:
    """A body on a hinge to the ground that swings from 80 deg beside straight down; let go on a condition, or at 1 s."""
    bob = body(2.0, [0.1, 0.3, 0.3], [1.0, 0.0, 0.0])
    hinge = joint("ground", "bob", [0.0, 0.0, 0.0], x_axis=[0.0, 0.0, 1.0])
    until = {"any": [{"joint": "hinge", **condition}, {"time_s": 1.0}]}
    phases = [{"name": "swinging", "joints": {"hinge": "revolute"}, "until": until}, {"name": "free"}]
    return scene({"bob": bob}, {"hinge": hinge}, phases, 1.2, step, environment={"gravity": "constant"},
                 initial={"pitch_deg": 10.0}, output={"loads": ["hinge"]})  # fmt: skip


def peak_loads() -> list[Stress]:
    """A break load just below, and just above, the greatest load of a swing, which lies within a step."""
    frequency, start = math.sqrt(2.0 * 9.80665 / 2.3), math.radians(-80.0)
    lowest = 0.25 * ref.pendulum_period(frequency, start)
    peak = 2.0 * 9.80665 * (1.0 + 2.0 * 2.0 / 2.3 * (1.0 - math.cos(start)))  # m g + m L w^2 at the bottom, from energy
    lines = []
    for step in (0.005, 0.02, 0.05, 0.1):
        for margin in (1e-2, 1e-3, 1e-4, 1e-6, -1e-6, -1e-3):
            found = fly(_swung({"force_N": peak * (1.0 - margin)}, step))
            time = 1.0
            if margin > 0.0:  # F = m g cos(a) + m L w^2 falls from its peak by (1 + 2 m L^2 / J) m g (1 - cos(a))
                angle = math.acos(1.0 - peak * margin / (2.0 * 9.80665 * (1.0 + 4.0 / 2.3)))
                t = np.linspace(lowest - 0.5, lowest, 200_001)
                time = float(np.interp(angle, -ref.pendulum(t, frequency, start)[0][::-1], t[::-1]))
            error = abs(found.outcomes["release_time_s"] - time)
            bound = Bound(1e-8, "1e-8 s: table of the reference")
            lines.append(judge(f"break load {margin:+.0e} below peak, h {step:g} s", "release, s", error, bound, found, True))
    return lines


def angle_limits() -> list[Stress]:
    """A hinge let go at an angle just below, at and beyond half a turn, where the angle between two bodies turns back."""
    lines = []
    for degrees in (1e-6, 90.0, 179.0, 179.999, 180.0):
        for step in (0.05, 0.013):
            stone = body(1.0, [1.0, 1.0, 1.0], [0.0, 0.0, 0.0])
            phases = [{"name": "turning", "joints": {"hinge": "revolute"}, "until": {"joint": "hinge", "angle_deg": degrees}}, {"name": "free"}]
            hinge = joint("ground", "stone", [0.0, 0.0, 0.0], x_axis=[0.0, 0.0, 1.0])
            found = fly(scene({"stone": stone}, {"hinge": hinge}, phases, 5.0, step, [0.0, 0.0, 1.0]))
            error = abs(found.outcomes["release_time_s"] - math.radians(degrees))
            # the angle comes from the sine of its half, whose slope is cos(angle / 2)
            bound = Bound(ROOT + 50.0 * EPS / max(math.cos(0.5 * math.radians(degrees)), math.sqrt(EPS)), "50 eps / cos(angle / 2)")
            lines.append(judge(f"hinge let go at {degrees:g} deg, h {step:g} s", "release, s", error, bound, found))
    return lines


def _boosters(releases: list[Tree], phases: list[Tree]) -> Flight:
    """A core with two boosters beside it on sliders, pushed back alike."""
    bodies = {"core": body(4.0, [2.0, 5.0, 5.0], [2.0, 0.0, 0.0])}
    joints, springs = {}, []
    for name, side in (("left", 1.0), ("right", -1.0)):
        point = [2.0, side, 0.0]
        bodies[name] = body(1.0, [0.2, 1.0, 1.0], point)
        joints[name] = joint("core", name, point, apart=-1)
        springs.append({"name": f"push_{name}", "bodies": ["core", name], "point_m": point, "axis": [-1.0, 0.0, 0.0], "force_N": 2.0})
    return fly(scene(bodies, joints, phases, 0.5, 0.05, spring=springs, release=releases))


def simultaneous() -> list[Stress]:
    """Two joints that let go at one instant; a stroke reached at a time given too; conditions met before their phase begins."""
    lines = []
    stroke, time = 0.0375, math.sqrt(2.0 * 0.0375 / 3.0)  # 2 N on 1 kg, and 4 N on 4 kg the other way: 3 m/s2
    both = [{"name": f"go_{j}", "joint": j, "when": {"joint": j, "stroke_m": stroke}} for j in ("left", "right")]
    for given, releases, phases in (
        ("two joints, each on its own stroke", both, held(left="slider", right="slider")),
        (
            "two joints, one phase, both strokes",
            [],
            [
                {"name": "on", "joints": {"left": "slider", "right": "slider"}, "until": {"all": [r["when"] for r in both]}},
                {"name": "off"},
            ],
        ),
    ):
        found = _boosters(releases, phases)
        for j in ("left", "right"):
            error = abs(found.outcomes[f"{j}_release_time_s"] - time)
            lines.append(judge(given, f"release of {j}, s", error, _located(3.0 * time), found, True))
        lines.append(judge(given, "sideways rates", float(np.max(np.abs(found.body("core").w))), FORM, found, True))
    lines += [_line("stroke reached at a time given", {"time_s": 0.5}, 0.25, 0.5), _line("time given 1e-13 s before the stroke", {"time_s": 0.5 - 1e-13}, 0.25, 0.5)]
    lines.append(_line("time given 1e-9 s after the stroke", {"time_s": 0.5 + 1e-9}, 0.25, 0.5))
    lines.append(_line("event at 0 s", {"time_s": 0.0}, 0.25, 0.0))
    lines += cascade()
    return lines


def _line(given: str, until: dict[str, Any], stroke: float, time: float) -> Stress:
    found = fly(pushed(stroke, **until))
    return judge(given, "release, s", abs(found.outcomes["release_time_s"] - time), _located(2.0 * max(time, 0.1)), found, True)


def cascade() -> list[Stress]:
    """Phases whose conditions are met before they begin are passed at one instant; a joint that lets go late does so after its delay."""
    tree = pushed(0.04)
    at = {"joint": "link", "stroke_m": 0.04}
    tree["phase"] = [
        {"name": "fixed", "joints": {"link": "fixed"}, "until": {"time_s": 0.1}},
        {"name": "guided", "joints": {"link": "slider"}, "until": at},
        {"name": "half", "joints": {"link": "point-on-line"}, "until": {"joint": "link", "stroke_m": 0.03}},
        {"name": "less", "joints": {"link": "point-on-plane"}, "until": {"any": [{"time_s": 0.2}, at]}},
        {"name": "free"},
    ]
    tree["phase"][3]["joints"] = {}
    found = fly(tree)
    lines = [judge("three events at one instant", "release, s", abs(found.outcomes["release_time_s"] - 0.3), _located(0.4), found, True)]
    late = pushed(0.04)
    late["joint"]["link"]["delay_s"] = 0.1
    found = fly(late)
    lines.append(judge("late by two steps", "release, s", abs(found.outcomes["release_time_s"] - 0.3), _located(0.4), found, True))
    return lines


def under_load() -> list[Stress]:
    """A weld that carries up to 1e9 N lets go: momentum and energy stay, and each mass centre goes on along its tangent."""
    lines = []
    for rate in (1.0, 100.0, 1e4):
        bodies = {"fore": body(2e3, [1e3, 1e3, 1e3], [0.0, 0.0, 0.0]), "aft": body(1e3, [1e3, 1e3, 1e3], [3.0, 0.0, 0.0])}
        phases = [{"name": "held", "joints": {"link": "fixed"}, "until": {"time_s": 0.5 / rate}}, {"name": "free"}]
        found = fly(scene(bodies, {"link": joint("fore", "aft", [1.0, 0.0, 0.0])}, phases, 1.0 / rate, 0.05 / rate, [0.0, 0.0, rate]))
        energy, spin = invariants(found)
        given = f"release under {1e3 * rate**2 * 2.0:.0e} N"
        lines.append(judge(given, "energy", relative(energy, np.full_like(energy, energy[0])), FORM, found, True))
        lines.append(judge(given, "angular momentum", relative(spin, np.broadcast_to(spin[0], spin.shape)), FORM, found, True))
        angle = np.minimum(rate * found.t, 0.5)
        along = np.stack([np.sin(angle), -np.cos(angle), np.zeros_like(angle)], axis=1) * 2.0 * rate  # aft is 2 m behind the mass centre
        lines.append(judge(given, "velocity", relative(found.body("aft").v, along), FORM, found, True))
    return lines
