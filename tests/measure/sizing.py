"""Sizing: false verdicts on a problem of known risk, of single designs and of fronts, and optima
against brute-force grids.

``python tests/measure/sizing.py [--repeats 200] [--fronts 100]``
"""

import argparse
import sys
import time
from pathlib import Path

import numpy as np

sys.path.insert(0, str(Path(__file__).resolve().parents[1]))
from support.pusher import MASSES
from support.sizing_problem import FORCE, SPEED, campaign, risk

import sepmc
from sepmc.campaign.campaign import Campaign
from sepmc.campaign.sizing import Variable, accepted_violations, size
from sepmc.campaign.trade_off import trade_off
from sepmc.scene.read import parse_campaign

# campaign, requirement, variable, settings
SCENES = (
    ("table2", ("separation_speed_m_s", 0.45), ("motor.retro.thrust_N", 300.0, 1200.0)),
    ("spring-pushers", ("separation_speed_m_s", 1.1), ("spring.*.force_N", 500.0, 1500.0)),
    ("store", ("clear_separation_speed_m_s", 3.5), ("spring.aft.factor", 0.5, 1.5)),
)
CASES = 1000


def verdicts(repeats: int) -> None:
    """Print how often a design is shown although its risk is too large, and how often not shown."""
    problem, allowed = campaign(), 1.0 - SPEED["probability"]
    wrong = missed = tries = 0
    for seed in range(repeats):
        sizing = size(problem, [FORCE], "push", cases=200, seed=1000 + 10 * seed)
        wrong += sizing.shown and risk(sizing.values[FORCE.key]) > allowed
        missed += not sizing.shown
        tries += sizing.tries
    print(
        f"{repeats} sizings: {wrong} wrong verdicts "
        f"(stated: at most {1 - SPEED['confidence']:.0%}), {missed} not shown, "
        f"{tries / repeats:.2f} tries each"
    )


def fronts(repeats: int) -> None:
    """Print how often any design of a front is shown although its risk is too large."""
    problem, allowed = campaign(), 1.0 - SPEED["probability"]
    mass = Variable("mass", "body.fore.mass_kg", 60.0, 100.0)
    wrong = missed = designs = 0
    for seed in range(repeats):
        costs = ["push", "100 - mass"]
        table = trade_off(problem, [FORCE, mass], costs, cases=200, seed=1000 + 10 * seed).table
        pairs = table[[FORCE.key, mass.key]].to_numpy()
        risks = np.array([risk(force, masses=(MASSES[0], own)) for force, own in pairs])
        wrong += bool((table["shown"] & (risks > allowed)).any())
        missed += int((~table["shown"]).sum())
        designs += len(table)
    print(
        f"{repeats} fronts of {designs / repeats:.3g} designs: {wrong} with a wrong verdict "
        f"(stated: at most {1 - SPEED['confidence']:.0%}), {missed} designs not shown",
        flush=True,
    )


def optimum(name: str, bound: tuple[str, float], variable: tuple[str, float, float]) -> None:
    """Print the optimum of a shipped campaign and that of a grid of 401 designs."""
    item = {"name": "bound", "metric": bound[0], "at_least": bound[1], "probability": 0.95}
    tree = sepmc.load(name, {"run.history_step_s": 0.0}).file.tree | {"requirement": [item]}
    scene = Campaign(parse_campaign(tree, name))
    key, low, high = variable
    start = time.perf_counter()
    sizing = size(scene, [Variable("x", key, low, high)], "x", cases=CASES)
    took = time.perf_counter() - start
    grid = np.linspace(low, high, 401)
    table = scene.session({key: (low, high)}).run_many(grid[:, None], cases=CASES)
    most = accepted_violations(scene.file.requirements[0], CASES)
    best = grid[(table.summary["bound_violations"] <= most).to_numpy()].min()
    print(
        f"{name}: {key} = {sizing.cost:.6g}, grid {best:.6g} (steps of {grid[1] - grid[0]:.4g}), "
        f"{len(sizing.searched)} designs, {took:.1f} s, {'shown' if sizing.shown else 'NOT shown'}"
    )


if __name__ == "__main__":
    parser = argparse.ArgumentParser()
    parser.add_argument("--repeats", type=int, default=200)
    parser.add_argument("--fronts", type=int, default=100)
    asked = parser.parse_args()
    fronts(asked.fronts)
    for scene in SCENES:
        optimum(*scene)
    verdicts(asked.repeats)
