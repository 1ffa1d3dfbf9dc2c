"""Find the numbers the paper does not print, so that the campaign gives its Table 3 and the single
run releases at 0.26 s.

Nonlinear least squares (scipy) on the public API of sepmc, with common random numbers: the same
cases fly at every trial, so the residuals are smooth in the parameters. Run ``python
notebooks/reconstruct.py`` from the project's root; it prints the lines for
``campaigns/table1.toml`` and ``table2.toml``. Nothing is fitted to the seed the campaign ships
with.
"""

import sys
import time

import numpy as np
from scipy.optimize import least_squares

import sepmc

# Path in the campaign file, and the size of a step that matters. The start is what the campaign
# file holds.
LEAST = {
    "environment.wind.speed_m_s": 0.0,
    "motor.retro.build_up_s": 0.001,
    "phase.guided.until.stroke_mm": 1.0,
}
UPPER, LOWER = "body.upper.aerodynamics", "body.lower.aerodynamics"
PARAMETERS = {
    f"{UPPER}.axial.const": 0.05,
    f"{UPPER}.axial.alpha2": 3.0,
    f"{LOWER}.axial.const": 0.05,
    f"{LOWER}.axial.alpha2": 3.0,
    f"{UPPER}.side.beta": 1.0,
    f"{LOWER}.side.beta": 1.0,
    f"{UPPER}.normal.alpha": 1.0,
    f"{LOWER}.normal.alpha": 1.0,
    f"{UPPER}.pitch.const": 0.02,
    f"{UPPER}.pitch.alpha": 0.3,
    f"{UPPER}.pitch.alpha2": 3.0,
    f"{UPPER}.pitch.alpha3": 20.0,
    f"{LOWER}.pitch.const": 0.02,
    f"{LOWER}.pitch.alpha": 0.3,
    f"{LOWER}.pitch.alpha2": 3.0,
    f"{UPPER}.yaw.beta": 0.1,
    f"{LOWER}.yaw.beta": 0.1,
    f"{UPPER}.roll.beta": 0.05,
    f"{LOWER}.roll.beta": 0.05,
    "motor.retro.build_up_s": 0.02,
    "phase.guided.until.stroke_mm": 2.0,
    "environment.wind.speed_m_s": 20.0,
    "initial.pitch_deg": 0.2,
    "initial.alpha_deg": 0.2,
}
# not the seed of the campaign file, nor those of the tests
SEEDS = (101, 202, 303, 404, 505, 606, 707, 808)
CASES = 10_000
RELEASE_S = 0.260  # printed, section 3.1: the pins leave their holes
# A residual of 1 is: means 0.01 sigma, sigmas 1 %, extremes 0.15 sigma (about what one seed differs
# from another), release 1 ms, and one step of a parameter away from where it started counts PRIOR:
# what the data do not determine stays put.
SCALES = {"dev_mean": 0.01, "dev_sigma": 0.01, "dev_min": 0.15, "dev_max": 0.15}
PRIOR = 0.3


def campaigns():
    """The Monte Carlo campaign without curves, and the single run in long steps (error 1e-8)."""
    alone = {"run.history_step_s": 0.0, "run.chunk": CASES}
    return sepmc.load("table2.toml", alone), sepmc.load("table1.toml", {"solver.step_s": 0.1})


def start(table2):
    """Values of the parameters in the campaign file."""
    values = []
    for path in PARAMETERS:
        node = table2.file.tree
        for part in path.split("."):
            node = (
                node[part]
                if isinstance(node, dict)
                else next(item for item in node if item["name"] == part)
            )
        values.append(float(node))
    return np.array(values)


def settings(x):
    return dict(zip(PARAMETERS, map(float, x), strict=True))


def single_run_settings(x):
    """The single run shares the vehicle and the air; its initial state is printed."""
    return {path: value for path, value in settings(x).items() if not path.startswith("initial.")}


def deviations(x, table2, seeds=SEEDS):
    """Deviation from Table 3 by seed: array (seeds, 36), in sigmas (means, extremes) and relative
    (sigmas)."""
    campaign = table2.with_settings(settings(x))
    rows = []
    for seed in seeds:
        stats = campaign.run(cases=CASES, seed=seed).statistics()
        rows.append(stats.loc[list(campaign.reference), list(SCALES)].to_numpy().T.ravel())
    return np.array(rows)


def release_time(x, table1):
    return (
        table1.with_settings(single_run_settings(x))
        .simulate(step_s=0.5)
        .attrs["outcomes"]["release_time_s"]
    )


def weights(table2):
    """What makes a deviation a residual, in the order of `deviations`."""
    return np.repeat([1.0 / scale for scale in SCALES.values()], len(table2.reference))


def residuals(x, x0, table2, table1):
    by_seed = deviations(x, table2)
    middle, extremes = np.split(by_seed, [2 * len(table2.reference)], axis=1)
    # Means and sigmas: averaged over the seeds. Extremes: root mean square over the seeds, so that
    # their scatter counts as well; a long tail that gives the paper's extreme on average gives a
    # wild one on some seed.
    table3 = np.concatenate([middle.mean(axis=0), np.sqrt((extremes**2).mean(axis=0))]) * weights(
        table2
    )
    release = (release_time(x, table1) - RELEASE_S) / 0.001
    return np.concatenate(
        [table3, [release], PRIOR * (x - x0) / np.array(list(PARAMETERS.values()))]
    )


def fit(max_rounds=6, verbose=2):
    """Least squares from the campaign file's values. Returns the scipy result; ``result.x`` in the
    order of PARAMETERS."""
    table2, table1 = campaigns()
    x0 = start(table2)
    scale = np.array(list(PARAMETERS.values()))
    return least_squares(
        residuals,
        x0,
        args=(x0, table2, table1),
        x_scale=scale,
        bounds=(np.array([LEAST.get(path, -np.inf) for path in PARAMETERS]), np.inf),
        diff_step=0.02 * scale / np.maximum(np.abs(x0), 1e-3),
        max_nfev=max_rounds,
        verbose=verbose,
    )


if __name__ == "__main__":
    began = time.perf_counter()
    found = fit(int(sys.argv[1]) if len(sys.argv) > 1 else 6)
    print(f"\ncost {found.cost:.2f} in {time.perf_counter() - began:.0f} s")
    for path, value, old in zip(PARAMETERS, found.x, start(campaigns()[0]), strict=True):
        print(f"{path:44s} {value:12.5g}   (was {old:.5g})")
    table = deviations(found.x, campaigns()[0])
    names = list(campaigns()[0].reference)
    for name, column in zip(names, table.mean(axis=0).reshape(4, -1).T, strict=True):
        print(
            f"{name:26s} mean {column[0]:+.3f}  sigma {column[1]:+.3f}  min {column[2]:+.2f}  max "
            f"{column[3]:+.2f}"
        )
    print(f"worst on one seed: min/max {np.abs(table.reshape(len(SEEDS), 4, -1)[:, 2:]).max():.2f}")
