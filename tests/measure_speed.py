"""Print what users wait for: ``python tests/measure_speed.py [--before FOLDER] [--big]``. Takes
about five minutes on a machine that does nothing else.

Whole commands with an empty cache and warm; every shipped campaign; what clearances and joint loads
cost; with ``--before``, the kernel of `table2` against that of a checkout of another commit, in
turn; with ``--big``, 1e8 cases of it (three minutes).
"""

import argparse
import copy
import json
import os
import resource
import subprocess
import sys
import tempfile
import time
from functools import partial
from pathlib import Path
from statistics import median

import numpy as np

from sepmc.bench.clock import rounds, seconds
from sepmc.bench.study import drawn
from sepmc.campaign.campaign import Campaign, load
from sepmc.campaign.flight import by_name, fly_once
from sepmc.campaign.pilot import kernel_text, plan_flight
from sepmc.engine import blocks
from sepmc.engine.door import fly_cases, load_kernel
from sepmc.scene.read import parse_campaign, shipped_campaigns

REPEATS, PAIRS, CASES = 7, 5, 10_000
BARE = {"run.history_step_s": 0.0}
IMPORTS = [sys.executable, "-c", "import numba, pandas, pyarrow"]
# the kernel of 10,000 cases on one thread, s: best of nine
KERNEL = """
import sepmc
campaign = sepmc.load("table2.toml", {"run.history_step_s": 0.0})
print(min(campaign.run(threads=1).timing["kernel"] for _ in range(9)))
"""


def command(*words, out, cache):
    """Wall time of a command, s."""
    environment = os.environ | {"SEPMC_CACHE_DIR": str(cache)}
    begun = time.perf_counter()
    words = [sys.executable, "-m", "sepmc", *words, "--quiet", "--overwrite", "--out", str(out)]
    subprocess.run(words, check=True, env=environment, stderr=subprocess.DEVNULL)
    return time.perf_counter() - begun


def imports():
    begun = time.perf_counter()
    subprocess.run(IMPORTS, check=True)
    return time.perf_counter() - begun


def commands(folder):
    """Whole processes: with an empty cache, again with one output more, and warm."""
    one_more = ["campaign", "table2.toml", "--set", 'output.tip_off=["pins"]']
    for cache in (folder / "cold-1", folder / "cold-2"):
        cold = command("campaign", "table2.toml", out=folder / "run", cache=cache)
        again = command(*one_more, out=folder / "run", cache=cache)
        other = folder / f"{cache.name}-srb"
        srb = command("campaign", "srb.toml", "--cases", "100", out=folder / "run", cache=other)
        print(f"empty cache, figures: table2 {cold:.1f} s, then one output more {again:.1f} s; ")
        print(f"  100 cases of srb {srb:.1f} s", flush=True)
    times = {"imports": [], "no figures": [], "figures": []}
    for _ in range(REPEATS):
        times["imports"].append(imports())
        for name, more in (("no figures", ["--no-plots"]), ("figures", [])):
            words = ["campaign", "table2.toml", *more]
            times[name].append(command(*words, out=folder / "run", cache=folder / "cold-1"))
    base = median(times["imports"])
    for name, those in times.items():
        low, high = min(those), max(those)
        print(
            f"warm table2, {name}: {median(those):.2f} s ({low:.2f} to {high:.2f}), "
            f"{median(those) / base:.2f} x the imports",
            flush=True,
        )


def campaigns(folder):
    """10,000 cases of each campaign as shipped, two threads."""
    for file in shipped_campaigns():
        if "dispersion" not in load(file).file.tree:
            continue
        words = ["campaign", file, "--cases", str(CASES), "--threads", "2", "--no-plots"]
        command(*words, out=folder / "run", cache=folder / "all")
        manifest = json.loads((folder / "run" / "manifest.json").read_text())
        times, accuracy = manifest["sessions"][-1]["timing_s"], manifest["accuracy"]
        print(
            f"{file}: kernel {times['kernel']:.3f} s, error {accuracy['achieved']:.1e}, "
            f"flown again {accuracy.get('finer_cases', 0)}",
            flush=True,
        )


def without(campaign, loads, clearances):
    """A campaign without its joint loads, its clearances, or both, and what is required of them."""
    tree = copy.deepcopy(campaign.file.tree)
    gone = []
    if loads:
        gone += ["peak", "jam"]
        for key in ("loads", "guide"):
            tree.get("output", {}).pop(key, None)
    if clearances:
        gone += ["clearance"]
        tree.pop("clearance", None)
        tree["dispersion"] = {
            k: v for k, v in tree["dispersion"].items() if not k.startswith("clearance")
        }
    kept = [
        item
        for item in tree.pop("requirement", [])
        if not any(word in item["metric"] for word in gone)
    ]
    if kept:
        tree["requirement"] = kept
    return Campaign(parse_campaign(tree, campaign.name))


def features(file, cases=2000):
    """What clearances and loads cost, in the same steps and each as the pilot flies it; one
    thread."""
    campaign = load(file, BARE)
    blocks.use_threads(1)
    flight, inputs = plan_flight(campaign), drawn(campaign, cases)
    scenes = {"all": campaign}
    if campaign.scene.output.loads:
        scenes["loads"] = without(campaign, True, False)
    if campaign.scene.clearance:
        scenes["clearances"] = without(campaign, False, True)
    if len(scenes) == 1:
        return
    works = {}
    for name, scene in scenes.items():
        kernel = load_kernel(kernel_text(scene, flight.one_method))
        methods = by_name(kernel, flight.method_names)
        paths = {item.parameter.path for item in scene.file.dispersions}
        columns = [
            i for i, item in enumerate(campaign.file.dispersions) if item.parameter.path in paths
        ]
        those, own = np.asfortranarray(inputs[:, columns]), plan_flight(scene)
        works[name, "same"] = lambda k=kernel, s=scene, d=those, m=methods: fly_cases(
            k, s.plan, flight.steps, flight.usual, s.slots, d, 0, m
        )
        works[name, "own"] = lambda s=scene, o=own, d=those: fly_once(s, o, d)
    found = {key: median(times) for key, times in rounds(works, REPEATS).items()}
    said = [
        f"{name} {found['all', 'same'] / found[name, 'same']:.2f} x in the same steps, "
        f"{found['all', 'own'] / found[name, 'own']:.2f} x as each is flown"
        for name in scenes
        if name != "all"
    ]
    print(f"{file}, with over without: {'; '.join(said)}", flush=True)


def against(before):
    """The kernel of `table2` beside that of another checkout: with estimates and cases flown again,
    and without."""
    campaign = load("table2.toml", BARE)
    blocks.use_threads(1)
    flight, inputs = plan_flight(campaign), drawn(campaign, CASES)
    alone = partial(
        fly_cases,
        flight.kernel,
        campaign.plan,
        flight.steps,
        flight.usual,
        campaign.slots,
        inputs,
        0,
        flight.methods,
    )
    ratios = []
    for _ in range(PAIRS):
        times = []
        for folder in (before, Path(__file__).parents[1]):
            environment = os.environ | {"PYTHONPATH": str(folder), "NUMBA_NUM_THREADS": "1"}
            words = [sys.executable, "-c", KERNEL]
            done = subprocess.run(
                words, check=True, env=environment, capture_output=True, text=True, cwd="/"
            )
            times.append(float(done.stdout))
        bare = min(seconds(alone) for _ in range(9))
        ratios.append((bare / times[0], times[1] / times[0]))
        print(
            f"us a case: before {1e2 * times[0]:.2f}, kernel {1e2 * bare:.2f}, with estimates and "
            f"cases flown again {1e2 * times[1]:.2f}: {ratios[-1][0]:.3f}, {ratios[-1][1]:.3f} x",
            flush=True,
        )
    print("medians: {:.3f}, {:.3f} x".format(*np.median(ratios, axis=0)), flush=True)


def big(folder):
    """1e8 cases of `table2` for statistics alone."""
    words = ["campaign", "table2.toml", "--stats-only", "--no-plots"]
    words += ["--set", "run.history_step_s=0"]
    for cases in (1e6, 1e8):
        out = folder / "run"
        whole = command(*words, "--cases", f"{cases:.0f}", out=out, cache=folder / "all")
        times = json.loads((out / "manifest.json").read_text())["sessions"][-1]["timing_s"]
        most = resource.getrusage(resource.RUSAGE_CHILDREN).ru_maxrss / 1024
        print(
            f"{cases:.0e} cases: {1e6 * times['kernel'] / cases:.2f} us a case, {whole:.0f} s in "
            f"all, {most:.0f} MB",
            flush=True,
        )


def main():
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--before", type=Path)
    parser.add_argument("--big", action="store_true")
    asked = parser.parse_args()
    with tempfile.TemporaryDirectory() as temporary:
        folder = Path(temporary)
        if asked.before:
            against(asked.before)
        if asked.big:
            big(folder)
        commands(folder)
        campaigns(folder)
    for file in shipped_campaigns():
        if "dispersion" in load(file).file.tree:
            features(file)


if __name__ == "__main__":
    main()
