"""Kernel time of loads by formulas over that of the same loads built in: ``python
tests/measure/signals.py [--cases 20000]``.

CPU time of one thread, best of several alternating runs, at equal steps. Pairs: a constant force; a
spring as a force over its extension and rate; thrust that builds up; a moment that damps a rate
beside a constant one, which has no built-in equal.
"""

import argparse
import time
import warnings

import sepmc
from sepmc.campaign.execution.step_selection import kernel_text, select_steps
from sepmc.engine.dispatch import integrate_cases, load_kernel, use_threads

REPEATS = 9
FORCE = [30.0, 5.0, 1.0]
SPRING = {
    "name": "extra", "bodies": ["stage", "payload"], "point_m": [2.0, 0.0, 0.0],
    "axis": [1.0, 0.0, 0.0], "force_N": 500.0, "stiffness_N_per_m": 900.0,
    "damping_N_s_per_m": 30.0,
}  # fmt: skip
BY_FORMULA = {
    "name": "f", "k": 900.0, "c": 30.0, "f0": 500.0,
    "formula": "f0 - k * spring.extra.extension_m - c * spring.extra.rate_m_s",
}  # fmt: skip
MOTOR = {
    "name": "kick", "body": "payload", "station_m": 1.0, "cant_deg": 0.0, "thrust_N": 400.0,
    "build_up_s": 0.1,
}  # fmt: skip
BUILT = {"name": "f", "formula": "peak * (1 - exp(-time_s / tau))", "peak": 400.0, "tau": 0.1}


def load(force):
    """Load with a force on the payload."""
    return [{"name": "jet", "body": "payload", "force_N": force}]


def parts(springs):
    """Pairs of settings by name: built in, and by a formula."""
    plain = {key: value for key, value in SPRING.items() if not key.startswith(("stiff", "damp"))}
    motor = {key: value for key, value in MOTOR.items() if key != "build_up_s"}
    push = {"name": "f", "formula": "push", "push": FORCE[0]}
    damp = {"name": "f", "formula": "-c * payload.omega_z_rad_s", "c": 40.0}
    turn = [{"name": "jet", "body": "payload", "moment_N_m": [0.0, 0.0, "f"]}]
    steady = [{"name": "jet", "body": "payload", "moment_N_m": [0.0, 0.0, 0.01]}]
    return {
        "constant force": (
            {"load": load(FORCE)},
            {"load": load(["f", *FORCE[1:]]), "signal": [push]},
        ),
        "spring": (
            {"spring": [*springs, SPRING]},
            {"spring": [*springs, plain | {"force_N": "f"}], "signal": [BY_FORMULA]},
        ),
        "thrust": ({"motor": [MOTOR]}, {"motor": [motor | {"thrust_N": "f"}], "signal": [BUILT]}),
        "damping": ({"load": steady}, {"load": turn, "signal": [damp]}),
    }


def springs_of(file):
    """Springs of a shipped campaign as settings."""
    return sepmc.load(file).file.tree["spring"]


def main():
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--cases", type=int, default=20_000)
    cases = parser.parse_args().cases
    use_threads(1)
    for name, pair in parts(springs_of("spring-pushers.toml")).items():
        campaigns = [
            sepmc.load("spring-pushers.toml", {**settings, "solver.method": "dop853"})
            for settings in pair
        ]
        flight, times = select_steps(campaigns[0]), ([], [])
        kernels = [flight.kernel, load_kernel(kernel_text(campaigns[1]))]
        inputs = [campaign.in_si(campaign.sample(0, cases)) for campaign in campaigns]
        for _ in range(REPEATS):
            for k, campaign in enumerate(campaigns):
                begun = time.process_time()
                block, _ = integrate_cases(
                    kernels[k],
                    campaign.layout,
                    flight.steps,
                    flight.durations,
                    campaign.slots,
                    inputs[k],
                    0,
                    flight.methods,
                )
                times[k].append(time.process_time() - begun)
                assert (block.status == 0).all()
        print(f"{name}: {min(times[1]) / min(times[0]):.3f}", flush=True)


if __name__ == "__main__":
    warnings.simplefilter("ignore")
    main()
