"""Check of the order of convergence of the methods rk4 and dop853, with and without a release."""

from collections.abc import Callable

import numpy as np

from sepmc.validation import lagrange
from sepmc.validation import references as ref
from sepmc.validation.flights import NominalRun, campaign, tensor
from sepmc.validation.line import Line

# By method: its order, allowed deficit of the fitted slope, longest step (s) of the smooth run (the
# others follow by half octaves), and numbers of steps until the release, for a kernel takes a whole
# number of them. All these errors are well above round-off, and no body turns too far in a step.
STUDIES = {
    "rk4": (4.0, 0.3, 0.05, (12, 16, 24, 32, 48)),
    "dop853": (8.0, 0.7, 0.28, (2, 3, 4, 5, 6)),
}
COUNT = 5
SMOOTH = {"initial.omega_rad_s": [2.4, 1.0, -1.6], "run.end_time_s": 20.0}
RELEASE = {
    "phase": [
        {
            "name": "guided",
            "joints": {"link": "slider"},
            "until": {"joint": "link", "stroke_m": 0.3},
        },
        {"name": "free"},
    ],
    "initial.omega_rad_s": [3.6, -2.0, 2.8],
    "run.end_time_s": 5.0,
}


def _order(case: str, method: str, steps: np.ndarray, error: Callable[[dict], float]) -> Line:
    """Line of `sepmc verify` on the order of a method, which must reach that of `STUDIES`: the
    slope of log error over log step, fitted at ``steps``, s. ``error`` takes settings by TOML path
    and returns the error of a run with them; ``case`` is the label of the line."""
    order, allowed, *_ = STUDIES[method]
    errors = [error({"solver.method": method, "solver.step_s": float(step)}) for step in steps]
    slope = np.polyfit(np.log(steps), np.log(errors), 1)[0]
    return Line(case, f"order of {method}, at least", order, float(slope), allowed, at_least=True)


def orders() -> list[Line]:
    """Check the order of convergence of the methods in `STUDIES`, two lines each: of a free body
    against the closed form, and of two bodies with a release against
    `sepmc.validation.lagrange`."""
    smooth, event = campaign("free_body", SMOOTH), campaign("two_bodies", RELEASE)
    w, r = ref.asymmetric_top(
        smooth.scene.run.end_time, tensor(smooth.scene, "stone"), smooth.scene.initial.omega
    )
    expected = lagrange.simulate(event.nominal().to_dict())
    names = (
        "release_time_s",
        *(f"{body}_omega_{axis}_deg_s" for body in ("fore", "aft") for axis in "xyz"),
    )

    def of_smooth(settings: dict) -> float:
        """Largest absolute error of all components of the rates, rad/s, and of the attitude matrix
        at the end of a run of the free body, with ``settings``, against the closed form."""
        stone = NominalRun(smooth.with_settings(settings), smooth.scene.run.end_time).body("stone")
        return float(max(np.abs(stone.w[-1] - w[0]).max(), np.abs(stone.r[-1] - r[0]).max()))

    def of_event(settings: dict) -> float:
        """Largest relative error of the release time and of the rates at the end of a run with a
        release, with ``settings``, against `sepmc.validation.lagrange`."""
        outcomes = NominalRun(event.with_settings(settings), event.scene.run.end_time).outcomes
        return float(
            max(abs(outcomes[name] - expected[name]) / abs(expected[name]) for name in names)
        )

    lines = []
    for method, (_, _, max_step, counts) in STUDIES.items():
        lines.append(
            _order("smooth flight", method, max_step / 2.0 ** (0.5 * np.arange(COUNT)), of_smooth)
        )
        lines.append(
            _order(
                "flight with a release",
                method,
                expected["release_time_s"] / np.array(counts),
                of_event,
            )
        )
    return lines
