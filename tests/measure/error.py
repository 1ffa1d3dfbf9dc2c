"""Reported errors of campaigns compared with true ones: ``python tests/measure/error.py [FILE ...]
[--set PATH=VALUE]``.

Runs the cases of each campaign as usual, and again at eight times the resolution and a hundredth of
the accuracy; without FILE all shipped campaigns and variants that are hard for step selection. For
the column ``error`` it prints quantiles of true over reported error: 1 %, median, 99 % and maximum.
Exit code 1 if an error, of the run or of a row, is reported below a third of the true one, or as
met when it is not.
"""

import argparse
import sys
import time

import numpy as np

import sepmc
from sepmc.campaign import cases
from sepmc.campaign.execution import accuracy, step_selection
from sepmc.campaign.execution.integration import integrate
from sepmc.campaign.execution.step_refinement import changes
from sepmc.scene.campaign_files import shipped_campaigns
from sepmc.scene.settings import parse_setting

QUIET = {"run.history_step_s": 0.0}
ROUND = {"uniform": [0.0, 360.0]}
VARIANTS = {
    "angles all round": (
        "table2",
        {
            "dispersion": {
                "motor.retro.clock_deg": ROUND,
                "motor.retro.deflection_deg": {"uniform": 20.0},
            }
        },
    ),
    "strong wind from anywhere": (
        "table2",
        {
            "environment.wind.speed_m_s": 300.0,
            "dispersion": {"environment.wind.direction_deg": ROUND, "initial.roll_deg": ROUND},
        },
    ),
    "strong wind, all else as shipped": ("table2", {"environment.wind.speed_m_s": 300.0}),
    "rare harsh thrust": (
        "table2",
        {
            "dispersion": {
                "motor.retro.thrust_N": {"discrete": [500.0, 20000.0], "weights": [0.999, 0.001]},
                "body.upper.mass_kg": {"uniform": 20.0},
            }
        },
    ),
    "rare fast spin": (
        "table2",
        {
            "dispersion": {
                "initial.omega_deg_s.z": {"discrete": [0.0, 300.0], "weights": [0.999, 0.001]},
                "initial.pitch_deg": {"uniform": 1.0},
            }
        },
    ),
    "leaves its layer of air": ("table2", {"initial.altitude_m": 71000.0}),
    "rarely leaves its layer of air": (
        "table2",
        {"initial.altitude_m": 70800.0, "initial.pitch_deg": 2.0},
    ),
    "climbs fast through a layer": (
        "table2",
        {"initial.altitude_m": 70500.0, "initial.pitch_deg": 20.0},
    ),
    "climbs into a layer of another kind": (
        "table2",
        {
            "initial.altitude_m": 50900.0,
            "initial.speed_m_s": 1500.0,
            "initial.pitch_deg": 30.0,
            "dispersion.initial.altitude_m": {"uniform": 150.0},
        },
    ),
    "a joint that stays shut": (
        "table2",
        {"phase": [{"name": "locked", "joints": {"pins": "fixed"}}]},
    ),
}


def measure(name, campaign, count, seconds):
    """Print the reported and the true errors of a campaign; returns False if they disagree."""
    start = time.perf_counter()
    trial = step_selection.select_steps(campaign)
    planned = time.perf_counter() - start
    draws = (
        cases.sample(campaign.file.dispersions, campaign.scene.run.seed, 0, count)
        * campaign.factors
    )
    few = draws[:32]
    start = time.perf_counter()
    integrate(campaign, trial, few)
    spent = (time.perf_counter() - start) / len(few)
    draws = draws[: max(64, min(count, int(seconds / (10.0 * spent))))]
    result = campaign.run(cases=len(draws))
    told = result.accuracy
    fine = campaign.with_settings(
        {"solver.accuracy": max(1e-12, 0.01 * campaign.scene.solver.accuracy)}
    )
    sharp = trial.refined().refined().refined()
    reference = integrate(fine, sharp, draws)
    own = integrate(campaign, trial, draws)
    columns = campaign.outcome_columns
    n, decides = len(columns), accuracy.decisive(columns)
    units = [c.unit for c in columns]
    good = reference.status == 0
    size = accuracy.scales(
        reference.outcomes[good, :n], units, accuracy.scene_scales(campaign.scene, units)
    )
    table = changes(
        own.outcomes[:, :n], own.status, reference.outcomes[:, :n], reference.status, size, decides
    )
    table[own.status != 0] = 0.0  # rows that are not ok
    true = table.max(axis=0)
    worst = int(np.where(decides, true, 0.0).argmax())
    ratio = told.worst[1] / true[worst] if true[worst] else np.inf
    place = (
        f"; places {told.worst_position[1]:.1e} for {true[~decides].max():.1e}"
        if told.worst_position
        else ""
    )
    requested = (
        "-" if campaign.scene.solver.step else f"{told.asked:g} {'met' if told.met else 'NOT MET'}"
    )
    ok = (own.status == 0) & (reference.status == 0)
    if not ok.any():
        print(f"| {name} | {len(draws)} | no case comes to its end |", flush=True)
        return True
    with np.errstate(divide="ignore", invalid="ignore"):
        share = table[ok][:, decides].max(axis=1) / own.error[ok]
    share = np.where(np.isnan(share), 0.0, share)
    rows = " ".join(f"{x:.2g}" for x in np.quantile(share, [0.01, 0.5, 0.99, 1.0]))
    failed = (
        ratio < 1 / 3
        or share.max() > 3.0
        or (requested.endswith(" met") and true[worst] > told.asked)
    )
    how = trial.steps.tolist() if trial.step is None else f"{trial.step:.4g} s"
    lost = f", {own.refinement.n_refined} finer" if own.refinement.n_refined else ""
    lost += f", {own.refinement.n_fallback} by a spare kernel" if own.refinement.n_fallback else ""
    lost += f", {own.refinement.n_unconverged} unsettled" if own.refinement.n_unconverged else ""
    other = np.count_nonzero((own.status != reference.status) & (own.status == 0))
    print(
        f"| {name} | {len(draws)} | {told.worst[1]:.1e} ({told.worst[0]}) | {true[worst]:.1e} "
        f"({columns[worst].name}) | {ratio:.2g} | {rows} | "
        f"{requested} | {how}{lost}; {other} end otherwise; pilot {planned:.2f} "
        f"s{place}{' | FAILS' if failed else ''} |",
        flush=True,
    )
    for note in result.notes:
        print(f"|   note: {note}", flush=True)
    return not failed


def main():
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("files", nargs="*")
    parser.add_argument("--set", dest="settings", action="append", default=[])
    parser.add_argument("--cases", type=int, default=10_000)
    parser.add_argument(
        "--seconds", type=float, default=20.0, help="about that long may the reference take (20)"
    )
    parser.add_argument("--variants", action="store_true", help="the variants only")
    given = parser.parse_args()
    settings = QUIET | dict(parse_setting(text) for text in given.settings)
    print(
        "| campaign | cases | reported | true | ratio | rows: true of told | asked | flown "
        "|\n|---|---|---|---|---|---|---|---|",
        flush=True,
    )
    names = given.files or ([] if given.variants else list(shipped_campaigns()))
    passed = [
        measure(name, sepmc.load(name, settings), given.cases, given.seconds) for name in names
    ]
    if not given.files:
        passed += [
            measure(name, sepmc.load(base, QUIET | more | settings), given.cases, given.seconds)
            for name, (base, more) in VARIANTS.items()
        ]
    sys.exit(0 if all(passed) else 1)


if __name__ == "__main__":
    main()
