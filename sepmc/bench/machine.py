"""Description and peak rate of multiply-adds of this machine."""

import os
import platform
from pathlib import Path
from statistics import median
from typing import Any

from sepmc.bench.clock import rounds
from sepmc.campaign.store import manifests
from sepmc.code_cache import processor, vector_extension
from sepmc.engine import fma_peak as peak
from sepmc.engine.threads import max_threads, use_threads

_PASSES = 10_000  # some 3 ms


def describe(threads: int) -> dict[str, Any]:
    """Return the processor, what code is compiled for, the number of cores and of available
    threads, ``threads`` (those of the benchmark) and the versions of packages, by name."""
    return {
        "cpu": _cpu(),
        "compiled_for": f"{processor()}, {vector_extension()}",
        "cores": os.cpu_count(),
        "threads_available": max_threads(),
        "threads": threads,
        **manifests.versions(),
    }


def _cpu() -> str:
    """Return the name of the processor; "unknown" if the system does not report it."""
    try:
        lines = Path("/proc/cpuinfo").read_text(encoding="utf-8").splitlines()
    except OSError:
        lines = []
    return (
        next(
            (line.partition(":")[2].strip() for line in lines if line.startswith("model name")), ""
        )
        or platform.processor()
        or "unknown"
    )


def fused_peak(threads: int, repeats: int) -> dict[str, float]:
    """Measure the rate of fused multiply-adds on a number of threads; return its ``best`` and
    ``median`` over the repeats (at least 7), Gflop/s. A multiply-add counts as two operations. The
    number of threads of compiled code is set and not restored."""
    use_threads(threads)
    numbers = peak.blocks(threads)
    times = rounds({"": lambda: peak.multiply_add(numbers, _PASSES, 0.5, 0.5)}, max(repeats, 7))[""]
    flops = 1e-9 * peak.FLOPS * _PASSES * threads
    return {"best": flops / min(times), "median": flops / median(times)}
