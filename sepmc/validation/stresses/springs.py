"""Stresses of springs up to 1e9 N/m, with steps that resolve their oscillation and steps that do
not. Every stress is a function that simulates such cases and returns their judged lines."""

import math

from sepmc.schema import AUDIT_BOUNDS
from sepmc.validation import references as ref
from sepmc.validation.flights import NominalRun
from sepmc.validation.stresses.line import EPS, FORM, Bound, Stress, judge, promised, relative
from sepmc.validation.stresses.scenes import Tree, pushed, simulate

MASS, FORCE = ref.reduced_mass(3.0, 1.0), 1e3  # kg, N


def _sprung(
    stiffness: float, turn: float, damping: float = 0.0, roll: float = 0.0, steps: int = 100
) -> Tree:
    """Tree of two bodies on a slider pushed apart with 1000 N by a spring (``stiffness``, N/m, and
    ``damping``, N s/m), rolling at ``roll``, rad/s. It runs ``steps`` steps, in each of which the
    spring oscillates by ``turn``, rad."""
    step = turn / math.sqrt(stiffness / MASS)
    tree = pushed(
        1.0,
        end=steps * step,
        step=step,
        spring={"force_N": FORCE, "stiffness_N_per_m": stiffness, "damping_N_s_per_m": damping},
    )
    tree["phase"] = [{"name": "guided", "joints": {"link": "slider"}}]
    tree["initial"]["omega_rad_s"] = [roll, 0.0, 0.0]
    return tree


def _error(run: NominalRun, stiffness: float, damping: float = 0.0) -> float:
    """Largest error of the extension of the spring of `_sprung` against the closed form, relative
    to the largest extension of that or, if it is larger, to FORCE / stiffness."""
    x, _ = ref.spring_extension(run.t, MASS, FORCE, stiffness, damping)
    return relative(1e-3 * run.history["separation_distance_mm"].to_numpy(), x, FORCE / stiffness)


def stiff() -> list[Stress]:
    """Lines of `sepmc stress` on the extension, against its closed form, at stiffnesses of 1 to 1e9
    N/m with 0.1 rad of oscillation in a step, with and without damping; all must be accurate."""
    lines = []
    for stiffness in (1.0, 1e3, 1e6, 1e9):
        for ratio in (0.0, 0.3):
            damping = 2.0 * ratio * math.sqrt(stiffness * MASS)
            label = f"{stiffness:.0e} N/m, 0.1 rad a step" + (", damped" if ratio else "")
            # positions of 1 m are known to eps: an extension of FORCE / stiffness has the remaining
            # digits
            bound = (
                FORM
                if stiffness < 1e7
                else Bound(100.0 * EPS * stiffness / FORCE, "100 eps m over extension")
            )
            run = simulate(_sprung(stiffness, 0.1, damping), 50)
            lines.append(
                judge(label, "extension", _error(run, stiffness, damping), bound, run, True)
            )
    return lines


def unresolved() -> list[Stress]:
    """Lines of `sepmc stress` on the extension, against its closed form, of a spring of 1e9 N/m in
    steps that are too long, and far too long, also nearly critically damped, so that the motion
    ends soon. Only 0.3 rad a step must be accurate."""
    lines = []
    damping = 1.8 * math.sqrt(1e9 * MASS)
    for turn in (0.3, 0.6, 1.0, 1.5, 2.0, 3.0, 6.0, 30.0, 1e3):
        run = simulate(_sprung(1e9, turn), 50)
        lines.append(
            judge(
                f"1e9 N/m, {turn:g} rad a step",
                "extension",
                _error(run, 1e9),
                promised(100),
                run,
                resolved=turn < 0.5,
            )
        )
    for turn in (1.0, 2.0, 3.0, 4.0, 6.0, 10.0):
        run = simulate(_sprung(1e9, turn, damping), 50)
        lines.append(
            judge(
                f"1e9 N/m, {turn:g} rad a step, damped",
                "extension",
                _error(run, 1e9, damping),
                promised(100),
                run,
            )
        )
    return lines


def hidden() -> list[Stress]:
    """Lines of `sepmc stress` on a spring of 1e9 N/m between bodies that roll with 1e3 and 1e6
    times the energy of the spring, which hides an error of the spring: its extension against the
    closed form.

    Each line has the error of the spring's extension, for one of the two energies and for steps in
    which the spring oscillates by 0.3 to 6 rad. Status ok promises the energy to 1e-6 of the whole,
    which can be all the energy of the spring: the bound is the extension that this energy allows.
    Each line passes also if it is flagged.
    """
    lines = []
    for turn in (0.3, 1.0, 1.5, 2.0, 3.0, 6.0):
        for fraction in (1e-3, 1e-6):
            stored = 0.5 * FORCE**2 / 1e9  # J
            run = simulate(_sprung(1e9, turn, roll=math.sqrt(2.0 * stored / fraction / 2.0)), 50)
            size = math.sqrt(2.0 * AUDIT_BOUNDS["energy_residual"] * stored / fraction / MASS) / (
                FORCE / math.sqrt(1e9 * MASS)
            )
            label = f"{turn:g} rad a step, {fraction:.0e} of the energy"
            lines.append(
                judge(
                    label,
                    "extension",
                    _error(run, 1e9),
                    Bound(size, "1e-6 of energy as speed"),
                    run,
                )
            )
    return lines
