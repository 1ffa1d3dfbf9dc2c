"""Time and memory over the number of cases; time over the number of threads."""

import resource
import sys
from functools import partial
from pathlib import Path
from statistics import median
from typing import Any

import pandas as pd

from sepmc.bench import subprocess_calls
from sepmc.bench.clock import rounds, spread
from sepmc.bench.study import Study
from sepmc.campaign.campaign import Campaign
from sepmc.engine.dispatch import use_threads
from sepmc.scene.messages import no_log
from sepmc.scene.read import parse_campaign

SIZES = (1_000, 10_000, 100_000, 1_000_000, 10_000_000)
_LONGEST_S = 20.0  # kernel time of one flight


def measure(study: Study) -> pd.DataFrame:
    """One row a size or number of threads. Sizes are flown in a process each, with ``stats_only``:
    time of the kernel, peak memory."""
    return pd.DataFrame(_by_cases(study) + _by_threads(study))


def _by_cases(study: Study) -> list[dict[str, Any]]:
    rows = []
    tree, name = study.campaign.file.tree, study.campaign.name
    each = 0.0  # s a case, of the size before
    for cases in SIZES[:2] if study.quick else SIZES:
        if each * cases > (_LONGEST_S / 10.0 if study.quick else _LONGEST_S):
            study.say(f"left out, more than {_LONGEST_S:g} s: {cases} cases")
            break
        repeats = study.repeats if each * cases < 1.0 else 1
        study.say(f"flying {cases} cases ...")
        found = subprocess_calls.call(
            "scaling:flown_here", [tree, name, cases, study.threads, repeats]
        )
        each = found["kernel_s"] / cases
        rows.append(
            {
                "over": "cases",
                "cases": cases,
                "threads": study.threads,
                "us_per_case": 1e6 * found["kernel_s"] / cases,
                **found,
            }
        )
    return rows


def _by_threads(study: Study) -> list[dict[str, Any]]:
    cases, way = study.own_cases, study.default
    rows: list[dict[str, Any]] = []

    def on(threads: int) -> None:
        use_threads(threads)
        way.fly(study.draws)

    counts = sorted({*(2**k for k in range(12) if 2**k < study.threads), study.threads})
    times = rounds({str(n): partial(on, n) for n in counts}, study.repeats)
    use_threads(study.threads)
    for n in counts:
        spent = median(times[str(n)])
        rows.append(
            {
                "over": "threads",
                "cases": cases,
                "threads": n,
                "us_per_case": 1e6 * spent / cases,
                "kernel_s": spent,
                "spread": spread(times[str(n)]),
            }
        )
        rows[-1]["speed_up"] = rows[0]["kernel_s"] / spent
    return rows


def flown_here(
    tree: dict[str, Any], name: str, cases: int, threads: int, repeats: int
) -> dict[str, float]:
    """Fly a campaign in this process; times, s, and peak memory, MB."""
    campaign = Campaign(parse_campaign(tree, name))
    campaign.run(1, threads=threads, stats_only=True, announce=no_log)
    timings = [
        campaign.run(cases, threads=threads, stats_only=True, announce=no_log).timing
        for _ in range(repeats)
    ]
    kernel, sample = (median(t[stage] for t in timings) for stage in ("kernel", "sample"))
    return {"kernel_s": kernel, "sample_s": sample, "peak_MB": peak_memory() / 1e6}


def peak_memory() -> float:
    """Most memory that this process has held, bytes. On Linux `getrusage` counts that of the
    process which started it, too."""
    try:
        lines = Path("/proc/self/status").read_text(encoding="utf-8").splitlines()
    except OSError:
        return resource.getrusage(resource.RUSAGE_SELF).ru_maxrss * (
            1.0 if sys.platform == "darwin" else 1024.0
        )
    return next(float(line.split()[1]) * 1024.0 for line in lines if line.startswith("VmHWM"))
