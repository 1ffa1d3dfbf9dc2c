"""Times of repeated runs and of many designs, beside their kernel time: ``python
tests/measure/designs.py [--designs 10000] [--before CHECKOUT]``. Some minutes on an idle machine.

A design is run as `Session.run` does, a new one each time. Kernel times are those of
`Campaign.run` at the same designs. ``--before`` runs another commit by the interface of both.
"""

import argparse
import os
import subprocess
import sys
import tempfile
import time
from pathlib import Path
from statistics import median

import numpy as np
from scipy.optimize import differential_evolution

import sepmc
from sepmc.bench.clock import spread

CASES, REPEATS = 2000, 7
BARE = {"run.history_step_s": 0.0}
BOXES = {
    "spring-pushers": {"spring.*.force_N": (600.0, 1200.0), "body.payload.mass_kg": (350.0, 450.0)},
    "table2": {"motor.retro.thrust_N": (300.0, 700.0), "body.upper.mass_kg": (440.0, 480.0)},
    "template": {"spring.*.force_N": (2000.0, 3000.0)},
}
# time of a run with a seed not used before, in a process that ran the campaign, s: by the
# interface of every commit
AGAIN = """
import sys, time, warnings
import sepmc
warnings.simplefilter("ignore")
campaign = sepmc.load(sys.argv[1], {"run.history_step_s": 0.0})
campaign.run(2000, seed=1)
times = []
for seed in range(2, 9):
    begun = time.perf_counter()
    campaign.run(2000, seed=seed)
    times.append(time.perf_counter() - begun)
print(sorted(times)[3])
"""


def template(folder):
    """Path of the file of ``sepmc template``."""
    path = Path(folder) / "template.toml"
    subprocess.run([sys.executable, "-m", "sepmc", "template", str(path)], check=True)
    return path


def text(times, unit=1e3):
    """Median and spread of times."""
    return f"{unit * median(times):.2f} ms (spread {100 * spread(times):.0f} %)"


def designs_of(session, count):
    """Random designs of a box."""
    random = np.random.Generator(np.random.Philox(key=5))
    low, high = (np.array([v.at(t) for v in session.box.variables]) for t in (0.0, 1.0))
    return low + random.random((count, len(low))) * (high - low)


def single(name, file):
    """Designs one by one."""
    campaign = sepmc.load(file, BARE)
    session = campaign.session(BOXES[name])
    table = designs_of(session, REPEATS + 1)
    session.run(table[0], cases=CASES)
    times, kernels = [], []
    for design in table[1:]:
        begun = time.perf_counter()
        session.run(design, cases=CASES)
        times.append(time.perf_counter() - begun)
        alone = session.with_design(design)
        alone.run(CASES)
        kernels.append(min(alone.run(CASES).timing["kernel"] for _ in range(3)))
    ratios = [a / b for a, b in zip(times, kernels, strict=True)]
    print(
        f"session.run, {CASES} cases of {name}: {text(times)}, kernel {text(kernels)}: "
        f"{median(ratios):.2f} x ({min(ratios):.2f} to {max(ratios):.2f})",
        flush=True,
    )


def many(count, cases=1000):
    """Many designs of `table2`."""
    campaign = sepmc.load("table2", BARE)
    session = campaign.session(BOXES["table2"])
    table = designs_of(session, count)
    session.run_many(table[:20], cases=cases)
    begun = time.perf_counter()
    session.run_many(table, cases=cases)
    seconds = time.perf_counter() - begun
    kernel = campaign.run(count * cases, stats_only=True).timing["kernel"]
    print(
        f"run_many, {count} designs of {cases} cases: {seconds:.2f} s; kernel of {count * cases} "
        f"cases {kernel:.2f} s: {seconds / kernel:.2f} x",
        flush=True,
    )


def optimiser():
    """Differential evolution over three parameters, 2,000 cases a point."""
    ranges = BOXES["table2"] | {"initial.pitch_deg": (0.0, 2.0)}
    session, count = sepmc.load("table2", BARE).session(ranges), 0

    def cost(values):
        nonlocal count
        count += 1
        return -session.run(values, cases=CASES).column("separation_distance_mm").min()

    begun = time.perf_counter()
    bounds = [(v.low, v.high) for v in session.box.variables]
    differential_evolution(cost, bounds, maxiter=20, seed=1, polish=False)
    seconds = time.perf_counter() - begun
    print(f"differential evolution: {count / seconds:.0f} designs a second", flush=True)


def again(name, given, before):
    """Another seed in the same process, beside an earlier commit in turn."""
    checkouts = {"now": Path(__file__).parents[2]} | ({"before": before} if before else {})
    times = {which: [] for which in checkouts}
    for _ in range(REPEATS):
        for which, folder in checkouts.items():
            file = given
            environment = os.environ | {"PYTHONPATH": str(folder)}
            if which == "before" and name == "template":  # its own: keys may be new
                file = Path(file).with_name("template-before.toml")
                command = [sys.executable, "-P", "-m", "sepmc", "template", str(file)]
                file.unlink(missing_ok=True)
                subprocess.run(command, check=True, capture_output=True, env=environment)
            words = [sys.executable, "-P", "-c", AGAIN, str(file)]
            done = subprocess.run(
                words, check=True, capture_output=True, text=True, env=environment
            )
            times[which].append(float(done.stdout.split()[-1]))
    line = "; ".join(f"{which} {text(those)}" for which, those in times.items())
    print(f"another seed, {CASES} cases of {name}: {line}", flush=True)


def main():
    """Measure and print."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--designs", type=int, default=10_000)
    parser.add_argument("--before", type=Path)
    options = parser.parse_args()
    with tempfile.TemporaryDirectory() as folder:
        files = {name: name for name in BOXES} | {"template": template(folder)}
        for name, file in files.items():
            single(name, file)
            again(name, file, options.before)
    optimiser()
    many(options.designs)


if __name__ == "__main__":
    main()
