"""Time and peak memory over the number of cases, and time over the number of threads."""

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
_MAX_S = 20.0  # kernel time of one run


def measure(study: Study) -> pd.DataFrame:
    """Measure scaling; return a table with a row for each number of cases, which a process of its
    own runs with ``stats_only`` (``over`` is "cases"), and one for each number of threads
    ("threads").

    All have ``cases``, ``threads``, ``us_per_case`` and ``kernel_s``, median kernel times. Rows
    over cases also have ``sample_s`` and ``peak_MB``, those over threads ``spread`` and
    ``speed_up``, over one thread.
    """
    return pd.DataFrame(_by_cases(study) + _by_threads(study))


def _by_cases(study: Study) -> list[dict[str, Any]]:
    """Time campaigns of more and more cases, and end before the first number that would take too
    long; return a table row (values by column) for each campaign that was run."""
    rows = []
    tree, name = study.campaign.file.tree, study.campaign.name
    seconds_per_case = 0.0  # s a case, of the size before
    for cases in SIZES[:2] if study.quick else SIZES:
        limit = _MAX_S / 10.0 if study.quick else _MAX_S
        if seconds_per_case * cases > limit:
            study.say(f"scaling ends before {cases} cases, which would take over {limit:g} s")
            break
        repeats = study.repeats if seconds_per_case * cases < 1.0 else 1
        study.say(f"running {cases} cases ...")
        times = subprocess_calls.call(
            "scaling:run_campaign", [tree, name, cases, study.threads, repeats]
        )
        seconds_per_case = times["kernel_s"] / cases
        rows.append(
            {
                "over": "cases",
                "cases": cases,
                "threads": study.threads,
                "us_per_case": 1e6 * times["kernel_s"] / cases,
                **times,
            }
        )
    return rows


def _by_threads(study: Study) -> list[dict[str, Any]]:
    """Time the study's `own_cases` on 1, 2, 4, ... threads, and on the number of threads of the
    study, which is the largest; return a table row (values by column) for each number, with the
    median of the repeats, s and us per case, and the speed-up over one thread."""
    cases, variant = study.own_cases, study.default
    rows: list[dict[str, Any]] = []

    def run_on(threads: int) -> None:
        """Integrate the study's `own_cases` on a number of threads."""
        use_threads(threads)
        variant.fly(study.inputs)

    counts = sorted({*(2**k for k in range(12) if 2**k < study.threads), study.threads})
    times = rounds({str(n): partial(run_on, n) for n in counts}, study.repeats)
    use_threads(study.threads)
    for n in counts:
        time = median(times[str(n)])
        rows.append(
            {
                "over": "threads",
                "cases": cases,
                "threads": n,
                "us_per_case": 1e6 * time / cases,
                "kernel_s": time,
                "spread": spread(times[str(n)]),
            }
        )
        rows[-1]["speed_up"] = rows[0]["kernel_s"] / time
    return rows


def run_campaign(
    tree: dict[str, Any], name: str, cases: int, threads: int, repeats: int
) -> dict[str, float]:
    """Run ``cases`` cases of a campaign ``repeats`` times in this process, statistics only; return
    the median times of kernel and sampling, s, and the peak memory, MB: ``kernel_s``, ``sample_s``,
    ``peak_MB``. ``tree`` and ``name`` are the content and name of the campaign file."""
    campaign = Campaign(parse_campaign(tree, name))
    campaign.run(1, threads=threads, stats_only=True, announce=no_log)
    timings = [
        campaign.run(cases, threads=threads, stats_only=True, announce=no_log).timing
        for _ in range(repeats)
    ]
    kernel, sample = (median(t[stage] for t in timings) for stage in ("kernel", "sample"))
    return {"kernel_s": kernel, "sample_s": sample, "peak_MB": peak_memory() / 1e6}


def peak_memory() -> float:
    """Return the peak memory of this process, bytes; on Linux without that of its parent, which
    `getrusage` would include."""
    try:
        lines = Path("/proc/self/status").read_text(encoding="utf-8").splitlines()
    except OSError:
        return resource.getrusage(resource.RUSAGE_SELF).ru_maxrss * (
            1.0 if sys.platform == "darwin" else 1024.0
        )
    return next(float(line.split()[1]) * 1024.0 for line in lines if line.startswith("VmHWM"))
