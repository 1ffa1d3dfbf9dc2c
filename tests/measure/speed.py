"""Times that users experience: ``python tests/measure/speed.py [--before FOLDER] [PART ...]``. All
parts take about a quarter of an hour on an idle machine.

Parts: ``commands`` with an empty cache and warm; ``campaigns``, each shipped one; ``features``, the
cost of clearances and joint loads; ``big``, 1e8 cases of `table2`, twice (eight minutes);
``before``, kernels beside those of a checkout of another commit, alternating; ``cold``, commands
with an empty cache beside those of the checkout (of all its campaigns and of its template, in
``--rounds N`` rounds of one and a half minutes each). Modules have bytecode, as installed ones do.
"""

import argparse
import copy
import json
import math
import os
import subprocess
import sys
import tempfile
import time
from pathlib import Path
from statistics import median

import numpy as np

from sepmc.bench.clock import rounds
from sepmc.bench.study import sample_inputs
from sepmc.campaign.campaign import Campaign, load
from sepmc.campaign.execution.integration import by_name, integrate_once
from sepmc.campaign.execution.step_selection import kernel_text, select_steps
from sepmc.engine.dispatch import integrate_cases, load_kernel, use_threads
from sepmc.scene.campaign_files import shipped_campaigns
from sepmc.scene.read import parse_campaign

REPEATS, PAIRS, CASES = 7, 7, 10_000
BARE = {"run.history_step_s": 0.0}
IMPORTS = [sys.executable, "-c", "import numba, pandas, pyarrow"]
ONE_MORE = ["--set", 'output.tip_off=["pins"]']
# kernel time of a campaign as shipped on one thread, s, best of nine: by the interface of every
# commit
KERNEL = """
import sys, warnings
import sepmc
warnings.simplefilter("ignore")
campaign = sepmc.load(sys.argv[1])
cases = int(sys.argv[2])
print(min(campaign.run(cases, threads=1).timing["kernel"] for _ in range(9)))
"""
COMPARED = {"table2": 10_000, "srb": 1_000, "hyper-x": 1_000, "residual-thrust": 4_000}


def command(*words, out, cache):
    """Wall time of a command, s."""
    environment = os.environ | {"SEPMC_CACHE_DIR": str(cache)}
    begun = time.perf_counter()
    words = [sys.executable, "-m", "sepmc", *words, "--quiet", "--overwrite", "--out", str(out)]
    subprocess.run(words, check=True, env=environment, stderr=subprocess.DEVNULL)
    return time.perf_counter() - begun


def imports():
    """Wall time of the imports of large libraries, s."""
    begun = time.perf_counter()
    subprocess.run(IMPORTS, check=True)
    return time.perf_counter() - begun


def commands(folder):
    """Whole processes: with an empty cache, again with one more output, and warm."""
    one_more = ["campaign", "table2.toml", *ONE_MORE]
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


def cold(folder, before, count):
    """Commands of 100 cases without figures, of another checkout and of this one in turn, each with
    an empty cache, then (`table2`) with one more output, then warm: wall and processor time, and
    their ratios in ``count`` rounds."""
    ratios = {}
    for number in range(count):
        for name, times in _cold_round(folder / str(number), before).items():
            ratios.setdefault(name, []).append(times)
            (a, b), (c, d) = times
            print(
                f"{name}: {a:.1f} s (processor {b:.1f}) before, {c:.1f} ({d:.1f}): {c / a:.2f} x "
                f"({d / b:.2f} x)",
                flush=True,
            )
    for name, rounds_of_one in ratios.items() if count > 1 else ():
        before_s, here_s = (median(each[k][0] for each in rounds_of_one) for k in (0, 1))
        wall, processor = (
            sorted(each[1][k] / each[0][k] for each in rounds_of_one) for k in (0, 1)
        )
        print(
            f"{name}: medians of {count}, {before_s:.2f} s before, {here_s:.2f}: "
            f"{median(wall):.2f} x ({wall[0]:.2f} to {wall[-1]:.2f}), processor "
            f"{median(processor):.2f} x ({processor[0]:.2f} to {processor[-1]:.2f})",
            flush=True,
        )


def _cold_round(folder, before):
    """By command and state of the cache: (wall, processor) times, s, of the other checkout and of
    this one."""
    here, result = Path(__file__).parents[2], {}
    for file in [*(path.name for path in sorted((before / "campaigns").glob("*.toml"))), ""]:
        times = {}
        for checkout in (before, here):
            place = folder / f"{checkout.name}-{file or 'template'}"
            place.mkdir(parents=True)
            environment = os.environ | {"PYTHONPATH": str(checkout), "SEPMC_CACHE_DIR": str(place)}
            sepmc = [sys.executable, "-m", "sepmc"]
            states = {"empty": []} | ({"output": ONE_MORE} if file == "table2.toml" else {})
            states |= {"warm": []}
            name = file or str(place / "template.toml")
            if not file:
                words = [*sepmc, "template", name]
                subprocess.run(words, check=True, env=environment, cwd=place, capture_output=True)
            words = [*sepmc, "campaign", name, "--cases", "100", "--no-plots", "--quiet"]
            for state, more in states.items():
                out = ["--out", str(place / state), *more]
                begun, used = time.perf_counter(), sum(os.times()[2:4])
                done = subprocess.run(
                    [*words, *out], check=False, env=environment, cwd=place, capture_output=True
                )
                seconds = time.perf_counter() - begun, sum(os.times()[2:4]) - used
                times[checkout, state] = seconds if done.returncode == 0 else (math.nan, math.nan)
        for state in states:
            result[f"{file or 'template'}, {state}"] = times[before, state], times[here, state]
    return result


def _write_bytecode(folder, *checkouts):
    """Compile modules as an installer does, into a folder that later processes read it from."""
    os.environ.pop("PYTHONDONTWRITEBYTECODE", None)
    os.environ["PYTHONPYCACHEPREFIX"] = str(folder / "bytecode")
    for checkout in checkouts:
        words = [sys.executable, "-m", "compileall", "-q", str(checkout / "sepmc")]
        subprocess.run(words, check=True)
    for _ in range(2):  # of other packages
        imports()


def campaigns(folder, files):
    """10,000 cases of each campaign as shipped, two threads."""
    for file in files:
        words = ["campaign", file, "--cases", str(CASES), "--threads", "2", "--no-plots"]
        command(*words, out=folder / "run", cache=folder / "all")
        manifest = json.loads((folder / "run" / "manifest.json").read_text())
        times, accuracy = manifest["sessions"][-1]["timing_s"], manifest["accuracy"]
        print(
            f"{file}: kernel {times['kernel']:.3f} s, error {accuracy['achieved']:.1e}, "
            f"flown again {accuracy.get('n_refined', 0)}",
            flush=True,
        )


def without(campaign, loads, clearances):
    """Campaign without its joint loads, its clearances, or both, and without their requirements."""
    tree = copy.deepcopy(campaign.file.tree)
    gone = []
    if loads:
        gone += ["peak", "jam"]
        for key in ("loads", "guide"):
            tree.get("output", {}).pop(key, None)
    if clearances:
        gone += ["clearance", "recontact"]
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
    """Cost of clearances and loads, in the same steps and in the selected steps of each; one
    thread."""
    campaign = load(file, BARE)
    use_threads(1)
    flight, inputs = select_steps(campaign), sample_inputs(campaign, cases)
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
        those, own = np.asfortranarray(inputs[:, columns]), select_steps(scene)
        works[name, "same"] = lambda k=kernel, s=scene, d=those, m=methods: integrate_cases(
            k, s.layout, flight.steps, flight.durations, s.slots, d, 0, m
        )
        works[name, "own"] = lambda s=scene, o=own, d=those: integrate_once(s, o, d)
    medians = {key: median(times) for key, times in rounds(works, REPEATS).items()}
    said = [
        f"{name} {medians['all', 'same'] / medians[name, 'same']:.2f} x in the same steps, "
        f"{medians['all', 'own'] / medians[name, 'own']:.2f} x as each is flown"
        for name in scenes
        if name != "all"
    ]
    print(f"{file}, with over without: {'; '.join(said)}", flush=True)


def against(before):
    """Kernel time of campaigns, with error estimates and refined cases, beside that of another
    checkout."""
    for file, cases in COMPARED.items():
        ratios = []
        for _ in range(PAIRS):
            times = []
            for folder in (before, Path(__file__).parents[2]):
                environment = os.environ | {"PYTHONPATH": str(folder), "NUMBA_NUM_THREADS": "1"}
                words = [sys.executable, "-c", KERNEL, f"{file}.toml", str(cases)]
                done = subprocess.run(
                    words, check=True, env=environment, capture_output=True, text=True, cwd="/"
                )
                times.append(1e6 / cases * float(done.stdout))
            ratios.append(times[1] / times[0])
            print(f"{file}: {times[0]:.2f} us a case before, {times[1]:.2f}, {ratios[-1]:.3f} x")
        print(f"{file}: median {median(ratios):.3f} x", flush=True)


def big(folder):
    """1e5 and 1e8 cases of `table2`: for statistics only, and with columns of all rows stored."""
    keep = ["--keep", "all", "--keep-columns", "separation_*,upper_*", "--float32"]
    for what, more in (("statistics alone", ["--stats-only"]), ("rows kept", keep)):
        for cases in (1e5, 1e8):
            out = folder / "run"
            words = ["campaign", "table2.toml", "--no-plots", *more, "--cases", f"{cases:.0f}"]
            words += ["--set", "run.history_step_s=0", "--quiet", "--overwrite", "--out", str(out)]
            begun = time.perf_counter()
            process = subprocess.Popen([sys.executable, "-m", "sepmc", *words])
            _, code, used = os.wait4(process.pid, 0)
            assert code == 0
            seconds = time.perf_counter() - begun
            kernel = json.loads((out / "manifest.json").read_text())["sessions"][-1]["timing_s"]
            size = sum(path.stat().st_size for path in out.rglob("*") if path.is_file())
            print(
                f"{cases:.0e} cases, {what}: {cases / seconds:.3g} a second, of the kernel alone "
                f"{cases / kernel['kernel']:.3g}; {used.ru_maxrss / 1024:.0f} MB of memory, "
                f"{size / 1e6:.0f} MB on disk",
                flush=True,
            )


def main():
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--before", type=Path, metavar="FOLDER")
    parser.add_argument("--rounds", type=int, default=1, metavar="N")
    parser.add_argument("part", nargs="*", metavar="PART", default=["all"])
    arguments = parser.parse_args()
    dispersed = [file for file in shipped_campaigns() if "dispersion" in load(file).file.tree]
    with tempfile.TemporaryDirectory() as temporary:
        folder, here = Path(temporary), Path(__file__).parents[2]
        _write_bytecode(folder, here, *filter(None, [arguments.before]))
        parts = {
            "before": lambda: arguments.before and against(arguments.before),
            "cold": lambda: arguments.before and cold(folder, arguments.before, arguments.rounds),
            "big": lambda: big(folder),
            "commands": lambda: commands(folder),
            "campaigns": lambda: campaigns(folder, dispersed),
            "features": lambda: [features(file) for file in dispersed],
        }
        for name, part in parts.items():
            if name in arguments.part or "all" in arguments.part:
                part()


if __name__ == "__main__":
    main()
