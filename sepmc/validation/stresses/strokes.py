"""Stresses of strokes that are short, grazed, passed slowly, reached exactly at the end of a step,
or out of reach. Every stress is a function that simulates such cases and returns their judged
lines."""

import math

from sepmc.validation import references as ref
from sepmc.validation.stresses.line import (
    EPS,
    FORM,
    NONE,
    REQUESTED,
    Bound,
    Stress,
    judge,
    relative,
)
from sepmc.validation.stresses.scenes import Tree, pushed, simulate, without_step

# s, m: tolerance of event times; tolerance of conditions
ROOT, TOUCH = 1e-13, 1e-12
ACCELERATION = 2.0  # second time derivative of the gap in `pushed`, m/s2


def located(speed: float, truncated: float = 0.0, size: float = 1.0) -> Bound:
    """Bound on the error of the time, s, of an event that is passed at a speed, m/s: the tolerance
    of the root, plus (round-off of positions of ``size``, m, plus the error ``truncated``, m) over
    the speed."""
    return Bound(
        ROOT + (50.0 * EPS * size + truncated) / speed,
        "1e-13 s, round-off / speed" if truncated == 0.0 else "truncation z^9/9! / speed",
    )


def truncation(z: float) -> float:
    """Relative truncation error of one step of z rad of an oscillation, by a method of order 8: the
    first missing term of the exponential series, z^9 / 9!."""
    return z**9 / math.factorial(9)


def strokes() -> list[Stress]:
    """Lines of `sepmc stress` on the release time and final speed of a slider with a stroke of 0 to
    1 m at a relative acceleration of 2 m/s2, which must be accurate up to 0.25 m, and on strokes
    that are never reached: their release time, which is NaN, must be flagged."""
    lines = []
    for stroke in (0.0, 1e-15, 1e-12, 1.001e-12, 1e-11, 1e-9, 1e-6, 1e-3, 0.25):
        time, speed = math.sqrt(2.0 * stroke / ACCELERATION), math.sqrt(2.0 * ACCELERATION * stroke)
        bound = (
            located(speed)
            if stroke > TOUCH
            else Bound(math.sqrt(2.0 * TOUCH / ACCELERATION), "1e-12 m counts as met")
        )
        label = f"pins of {stroke:g} m" + (", at the end of a step" if stroke == 0.25 else "")
        run = simulate(pushed(stroke))
        lines.append(
            judge(
                label,
                "release, s",
                abs(run.outcomes["release_time_s"] - time),
                bound,
                run,
                True,
            )
        )
        lines.append(
            judge(
                label,
                "speed at the end",
                relative(run.outcomes["separation_speed_m_s"], 2.0),
                FORM,
                run,
                True,
            )
        )
    for label, tree in (
        ("pins never drawn", pushed(2.0)),
        ("pins pushed the other way", pushed(1e-9, spring={"force_N": -1.5})),
    ):
        run = simulate(tree)
        lines.append(judge(label, "release, s", run.outcomes["release_time_s"], NONE, run))
    run = simulate(pushed(1.0))
    error = abs(run.outcomes["release_time_s"] - 1.0)
    return [
        *lines,
        judge("pins drawn at the end of the run", "release, s", error, located(2.0), run),
    ]


FREQUENCY = 2.0 * math.pi  # rad/s
TOP = 0.1  # m


def _oscillator(
    stroke: float, end: float = 0.9, step: float = 0.05, where: str = "stroke_m"
) -> Tree:
    """Tree of `pushed` with a spring that oscillates the gap between 0 and TOP with a period of 1
    s; the slider is released when the quantity ``where``, a key of ``until``, reaches ``stroke``,
    m, or 0.1 s before the end time ``end``. ``end`` and ``step`` (of the solver) are in s."""
    mass = ref.reduced_mass(3.0, 1.0)
    spring = {"force_N": 0.5 * mass * FREQUENCY**2 * TOP, "stiffness_N_per_m": mass * FREQUENCY**2}
    tree = pushed(stroke, end=end, step=step, spring=spring)
    tree["phase"][0]["until"] = {"joint": "link", where: stroke, "time_s": end - 0.1}
    return tree


def _lead_time(margin: float) -> float:
    """Time, s, from the instant at which the gap TOP (1 - cos) / 2 reaches TOP (1 - margin) to that
    at which it reaches TOP; 0 for a negative margin."""
    return 2.0 * math.asin(math.sqrt(max(margin, 0.0))) / FREQUENCY


def grazing() -> list[Stress]:
    """Lines of `sepmc stress` on the release time at a stroke just reached, or just missed, at the
    top of an oscillation: in converged steps, between the ends of given steps of 0.05 to 0.3 s,
    and missed at 20 tops in a row. A case that misses the stroke is released by time, 0.1 s before
    its end.

    Where the margin is less than the tolerance of a condition, or than the truncation error, either
    answer is right. With a given step, a kernel may miss a condition that is nearly reached within
    a step. Those in converged steps, and those 1e-3 of the top away in steps of 0.05 s, must be
    accurate; the others pass also if they are flagged.
    """
    lines = []
    for margin in (1e-3, 1e-6, -1e-6, -1e-3):
        run, lead_time = (
            simulate(without_step(_oscillator(TOP * (1.0 - margin)))),
            _lead_time(margin),
        )
        error = abs(run.outcomes["release_time_s"] - (0.5 - lead_time if margin > 0.0 else 0.8))
        lines.append(
            judge(
                f"stroke {margin:+.0e} below top, converged",
                "release, s",
                error,
                REQUESTED,
                run,
                True,
            )
        )
    for step in (0.05, 0.17, 0.3):
        truncated = TOP * truncation(step * FREQUENCY)
        for margin in (1e-3, 1e-6, 1e-9, 1e-12, 0.0, -1e-11, -1e-9, -1e-6, -1e-3):
            run = simulate(_oscillator(TOP * (1.0 - margin), step=step))
            lead_time = _lead_time(margin)
            times, bound = [0.5 - lead_time if margin > 0.0 else 0.8], located(1.0)
            if margin > 0.0:
                bound = located(0.5 * TOP * FREQUENCY * math.sin(FREQUENCY * lead_time), truncated)
            if abs(margin) * TOP <= max(TOUCH, truncated):
                times = [0.5, 0.8]
                bound = Bound(
                    4.0 * math.sqrt(max(TOUCH, truncated) / TOP) / FREQUENCY,
                    "as far from the top as met",
                )
            error = min(abs(run.outcomes["release_time_s"] - t) for t in times)
            fair = step == 0.05 and abs(margin) >= 1e-3
            lines.append(
                judge(
                    f"stroke {margin:+.0e} below top, h {step:g} s",
                    "release, s",
                    error,
                    bound,
                    run,
                    fair,
                )
            )
    run = simulate(_oscillator(TOP * (1.0 + 1e-9), end=20.1))
    lines.append(
        judge(
            "stroke 1e-9 above 20 tops",
            "release, s",
            abs(run.outcomes["release_time_s"] - 20.0),
            located(1.0),
            run,
        )
    )
    return lines


def slow() -> list[Stress]:
    """Lines of `sepmc stress` on the release time at a stroke of 1 mm that is passed slowly, far
    from the mass centres: positions are known to round-off, and so is the time.
    All must be accurate."""
    lines = []
    for force, station in (
        (1e-2, 2.0),
        (1e-4, 2.0),
        (1e-6, 2.0),
        (1e-2, 50.0),
        (1e-4, 50.0),
        (1e-6, 50.0),
    ):
        time = math.sqrt(2.0 * 1e-3 / (force / 0.75))
        tree = pushed(
            1e-3,
            end=1.2 * time,
            step=0.02 * time,
            spring={"force_N": force, "point_m": [station, 0.0, 0.0]},
        )
        tree["body"]["fore"]["cg_m"], tree["body"]["aft"]["cg_m"] = (
            [0.0, 0.0, 0.0],
            [2.0 * station, 0.0, 0.0],
        )
        tree["joint"]["link"]["point_m"] = [station, 0.0, 0.0]
        speed = force / 0.75 * time
        run, bound = simulate(tree), located(speed, size=station)
        error = abs(run.outcomes["release_time_s"] - time)
        lines.append(
            judge(
                f"1 mm at {speed:.0e} m/s, {station:g} m arms",
                "release, s",
                error,
                bound,
                run,
                True,
            )
        )
    return lines


def spent_springs() -> list[Stress]:
    """Lines of `sepmc stress` on the gap at the end with a spring whose own stroke ends just below
    the top of the oscillation, so that its force ends, or just above it, so that it pulls the
    bodies back. At 1e-3 of the top from it, and in steps chosen for an accuracy, all must be
    accurate; elsewhere they may be flagged."""
    lines = []
    for margin in (1e-3, 1e-6, 1e-9, -1e-9, -1e-6, -1e-3):
        tree = _oscillator(2.0 * TOP)
        stroke = TOP * (1.0 - margin)
        tree["spring"][0]["stroke_m"] = stroke
        # no other event within the run
        tree["phase"] = [{"name": "guided", "joints": {"link": "slider"}}]
        end = 0.9
        if margin > 0.0:
            lead_time = _lead_time(margin)
            speed = 0.5 * TOP * FREQUENCY * math.sin(FREQUENCY * lead_time)
            gap = stroke + speed * (end - math.pi / FREQUENCY + lead_time)
            truncated = TOP * truncation(0.05 * FREQUENCY)
            bound = Bound(
                (50.0 * EPS + truncated) / math.sin(FREQUENCY * lead_time),
                "truncation z^9/9! / slope",
            )
        else:
            gap, bound = (
                0.5 * TOP * (1.0 - math.cos(FREQUENCY * end)),
                Bound(FORM.value * TOP, FORM.reason),
            )
        runs = [("", tree, bound, abs(margin) >= 1e-3)]
        runs += [(", conv.", without_step(tree), REQUESTED, True)] if abs(margin) >= 1e-6 else []
        for suffix, tree_of_run, allowed, fair in runs:
            run = simulate(tree_of_run)
            error = abs(1e-3 * run.outcomes["separation_distance_mm"] - gap)
            lines.append(
                judge(
                    f"spring spent {margin:+.0e} below top{suffix}",
                    "gap at the end, m",
                    error,
                    allowed,
                    run,
                    fair,
                )
            )
    return lines
