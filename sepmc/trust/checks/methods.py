"""Every integrator proves its order, with and without an event in the flight."""

from collections.abc import Callable

import numpy as np

from sepmc.campaign.campaign import Campaign
from sepmc.trust import lagrange
from sepmc.trust import references as ref
from sepmc.trust.flights import GENERAL, Flight, campaign, tensor
from sepmc.trust.line import Line
from sepmc.trust.written import WRITTEN, Written

# By method: its order, how far below it a fitted slope may lie, and the longest step (s) of either flight; others follow by half octaves.
# Over these steps errors stand clear of round-off and of a drift of the attitude that ends a case. A written kernel takes a whole number
# of steps to a release, two or three of these: no slope.
STUDIES = {"rk4": (4.0, 0.3, 0.025, 0.025), "dop853": (8.0, 0.7, 0.4, 0.1)}
COUNT = 5
FLIGHTS: dict[str, Callable[[Campaign], Flight]] = {GENERAL: lambda flown: Flight(flown, 20.0), WRITTEN: Written}
SMOOTH = {"initial.omega_rad_s": [2.4, 1.0, -1.6], "run.end_time_s": 20.0}
RELEASE = {
    "phase": [{"name": "guided", "joints": {"link": "slider"}, "until": {"joint": "link", "stroke_m": 0.3}}, {"name": "free"}],
    "initial.omega_rad_s": [3.6, -2.0, 2.8],
    "run.end_time_s": 20.0,
}


def _order(case: str, kernel: str, method: str, largest: float, error: Callable[[str, dict], float]) -> Line:
    """Slope of log error over log step."""
    order, allowed, *_ = STUDIES[method]
    steps = largest / 2.0 ** (0.5 * np.arange(COUNT))
    errors = [error(kernel, {"solver.method": method, "solver.step_s": float(step)}) for step in steps]
    slope = np.polyfit(np.log(steps), np.log(errors), 1)[0]
    return Line(case, f"order of {method}, at least", order, float(slope), allowed, at_least=True, kernel=kernel)


def orders() -> list[Line]:
    """A free body's rates and attitude against the closed form; after a release, against Newton and Euler."""
    smooth, event = campaign("free_body", SMOOTH), campaign("two_bodies", RELEASE)
    w, r = ref.asymmetric_top(20.0, tensor(smooth.scene, "stone"), smooth.scene.initial.omega)
    expected = lagrange.fly(event.nominal().to_dict())
    names = ("release_time_s", *(f"{body}_omega_{axis}_deg_s" for body in ("fore", "aft") for axis in "xyz"))

    def of_smooth(kernel: str, settings: dict) -> float:
        stone = FLIGHTS[kernel](smooth.with_settings(settings)).body("stone")
        return float(max(np.abs(stone.w[-1] - w[0]).max(), np.abs(stone.r[-1] - r[0]).max()))

    def of_event(kernel: str, settings: dict) -> float:
        found = FLIGHTS[kernel](event.with_settings(settings)).outcomes
        return float(max(abs(found[name] - expected[name]) / abs(expected[name]) for name in names))

    lines = []
    for method, (_, _, longest, longest_with_event) in STUDIES.items():
        lines += [_order("smooth flight", kernel, method, longest, of_smooth) for kernel in FLIGHTS]
        lines.append(_order("flight with a release", GENERAL, method, longest_with_event, of_event))
    return lines
