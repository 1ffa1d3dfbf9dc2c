"""Runs by workers of a Dask scheduler: ``python tests/measure/cluster.py [--times 50] [--cases 1e7]
[--seed 1]``.

Two workers on this machine run cases with histories, and one of them is killed (SIGKILL) at a
random moment; rows, histories and statistics must be bit-identical to those of one undisturbed
process, each case once. Then the throughput of two workers of one thread is compared with that of
one process of two threads, alternating, three times. Exit code 1 if a run differs.
"""

import argparse
import json
import os
import signal
import statistics
import sys
import tempfile
import threading
import time
from pathlib import Path

sys.path.insert(0, str(Path(__file__).parents[1]))

import numpy as np
from support.runs import same, statistics_of

import sepmc
from sepmc.campaign.store import manifests
from sepmc.cluster import dask_executor

OFTEN = {"run.chunk": 2048, "run.history_step_s": 0.1}
CASES = 60_000


def one_killed(campaign, folder, after, which):
    """Result of a run by two workers, one of which is killed after some seconds."""
    with dask_executor(2, threads=1) as workers:
        pids = list(workers.client.run(os.getpid).values())
        timer = threading.Timer(after, os.kill, (pids[which], signal.SIGKILL))
        timer.start()
        try:
            return campaign.run(cases=CASES, out=folder, executor=workers)
        finally:
            timer.cancel()


def damage(times, seed):
    """Number of runs that differ, of those in which a worker was killed."""
    rng, wrong, campaign = np.random.default_rng(seed), 0, sepmc.load("table2", OFTEN)
    with tempfile.TemporaryDirectory() as temporary:
        whole = Path(temporary) / "whole"
        alone = statistics_of(campaign.run(cases=CASES, out=whole, threads=2))
        for number in range(times):
            folder = Path(temporary) / f"run-{number}"
            after, which = float(rng.uniform(0.0, 3.0)), int(rng.integers(2))
            result = one_killed(campaign, folder, after, which)
            faults = manifests.diagnose(folder)
            bad = not same(whole, folder) or statistics_of(result) != alone or bool(faults)
            wrong += bad
            said = f"DIFFERS {faults}" if bad else "same"
            print(f"{number}: killed after {after:.2f} s, {said}", flush=True)
    return wrong


def throughput(cases):
    """Median seconds of one process of two threads, and of two workers of one thread."""
    campaign = sepmc.load("table2", {"run.history_step_s": 0.0})
    seconds = {"process": [], "workers": []}
    with tempfile.TemporaryDirectory() as temporary, dask_executor(2, threads=1) as workers:
        folder = Path(temporary) / "run"
        told = set()
        for _ in range(4):
            for name, by in (("process", None), ("workers", workers)):
                began = time.perf_counter()
                result = campaign.run(
                    cases=cases, out=folder, threads=2, stats_only=True, executor=by, overwrite=True
                )
                seconds[name].append(time.perf_counter() - began)
                told.add(statistics_of(result))
        assert len(told) == 1
    return {name: statistics.median(times[1:]) for name, times in seconds.items()}


def main():
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--times", type=int, default=50)
    parser.add_argument("--cases", type=float, default=1e7)
    parser.add_argument("--seed", type=int, default=1)
    arguments = parser.parse_args()
    wrong = damage(arguments.times, arguments.seed)
    print(
        f"{wrong} of {arguments.times} runs that lost a worker differ from one that was left alone"
    )
    if arguments.cases:
        took = throughput(int(arguments.cases))
        rates = {name: round(arguments.cases / seconds) for name, seconds in took.items()}
        print(json.dumps({"cases a second": rates}))
        print(f"two workers fly {took['process'] / took['workers']:.2f} x as many as one process")
    sys.exit(1 if wrong else 0)


if __name__ == "__main__":
    main()
