"""Description and peak performance of the machine."""

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
    """Return processor, what code is compiled for, cores, threads and versions of packages, by
    name."""
    return {
        "cpu": _cpu(),
        "compiled_for": f"{processor()}, {vector_extension()}",
        "cores": os.cpu_count(),
        "threads_available": max_threads(),
        "threads": threads,
        **manifests.versions(),
    }


def _cpu() -> str:
    """Return the name of the processor."""
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
    """Return the measured Gflop/s of fused multiply-adds, best and median of the repeats; an FMA
    counts as two."""
    use_threads(threads)
    numbers = peak.blocks(threads)
    times = rounds({"": lambda: peak.multiply_add(numbers, _PASSES, 0.5, 0.5)}, max(repeats, 7))[""]
    flops = 1e-9 * peak.FLOPS * _PASSES * threads
    return {"best": flops / min(times), "median": flops / median(times)}
