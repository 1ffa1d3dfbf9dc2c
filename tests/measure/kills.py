"""Runs killed at random moments and resumed: ``python tests/measure/kills.py [--kills 500] [--seed
1] [--disk DIR]``.

Runs store all rows, or count cases, or count them and store some rows, in turn. Each is killed
(SIGKILL or SIGINT) after a random part of its time, resumed, killed again, and so on until it ends;
then its rows, histories and statistics must be bit-identical to those of an undisturbed run, each
case once. Exit code 1 if not. With ``--disk``, the folder of a small file system (``mount -t tmpfs
-o size=64m tmpfs DIR``), runs are written there, and every fourth time the disk is filled instead,
and freed before the run is resumed.
"""

import argparse
import contextlib
import json
import shutil
import signal
import subprocess
import sys
import tempfile
import time
from collections import Counter
from pathlib import Path

sys.path.insert(0, str(Path(__file__).parents[1]))

import numpy as np
from support.runs import same

from sepmc.campaign.store import folders, manifests

OPTIONS = ["table2.toml", "--cases", "60000", "--set", "run.chunk=4096", "--no-plots", "--quiet"]
OPTIONS += ["--set", "run.history_step_s=0.1"]
FULL = 0.25  # fraction of times in which a small disk is filled
MANNERS = [], ["--stats-only"], ["--keep", "failed,every:7"]
# counts are saved far more often than every ten seconds
PROGRAM = (
    "from sepmc.campaign.execution import runner; runner._SAVE_S = 0.05; import sepmc.__main__"
)


def command(folder, *more):
    """Command line of a run."""
    own = [] if "--resume" in more else MANNERS[int(folder.name.rpartition("-")[2]) % len(MANNERS)]
    words = ["campaign", *OPTIONS, "--out", str(folder), *own, *more]
    return [sys.executable, "-c", PROGRAM, *words]


def fill(disk):
    """Fill a small file system; returns the file that fills it."""
    ballast = disk / "ballast"
    with ballast.open("wb", buffering=0) as file, contextlib.suppress(OSError):
        while True:
            file.write(bytes(4096))
    return ballast


def killed(folder, rng, longest, disk):
    """Start or resume a run and kill it; returns the signal or event, or "" if the run ended
    before."""
    there = folders.is_run(folder)
    run = subprocess.Popen(
        command(folder, *(["--resume"] if there else [])),
        stderr=subprocess.PIPE,
        text=True,
    )
    try:
        _, said = run.communicate(timeout=float(rng.uniform(0.2, longest)))
    except subprocess.TimeoutExpired:
        if disk and rng.random() < FULL:
            ballast = fill(disk)
            _, said = run.communicate()
            ballast.unlink()
            if run.returncode and not any(
                one in said for one in ("No space left", "are free there")
            ):
                raise RuntimeError(said) from None
            return "disk full" if run.returncode else ""
        way = signal.SIGKILL if rng.random() < 0.7 else signal.SIGINT
        run.send_signal(way)
        run.communicate()
        return way.name
    if run.returncode:
        raise RuntimeError(said)
    return ""


def main():
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--kills", type=int, default=500)
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--disk", type=Path)
    arguments = parser.parse_args()
    rng, kills, runs, wrong = np.random.default_rng(arguments.seed), Counter(), 0, 0
    with tempfile.TemporaryDirectory() as temporary:
        whole = [Path(temporary) / f"whole-{number}" for number in range(len(MANNERS))]
        for folder in whole:
            subprocess.run(command(folder), check=True)
        began = time.perf_counter()
        subprocess.run(command(whole[0], "--overwrite"), check=True)
        takes = time.perf_counter() - began
        while kills.total() < arguments.kills:
            folder, runs = (arguments.disk or Path(temporary)) / f"run-{runs}", runs + 1
            while way := killed(folder, rng, 1.3 * takes, arguments.disk):
                kills[way] += 1
            wrong += not same(whole[(runs - 1) % len(MANNERS)], folder) or bool(
                manifests.diagnose(folder)
            )
            shutil.rmtree(folder)
    print(json.dumps({"kills": kills, "runs": runs, "seconds a run": round(takes, 2)}))
    print(f"{wrong} of {runs} runs differ from one that was left alone")
    sys.exit(1 if wrong else 0)


if __name__ == "__main__":
    main()
