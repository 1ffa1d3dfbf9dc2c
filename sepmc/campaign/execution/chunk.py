"""Chunks of cases, which are sampled and integrated in one call of the kernel."""

import time
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from sepmc.campaign.case_selection import CaseSelection
from sepmc.campaign.definition import Definition
from sepmc.campaign.execution.batch_summary import BatchSummary, count
from sepmc.campaign.execution.integration import Integration, history_rows, integrate
from sepmc.engine.dispatch import Block, compile_wait_s
from sepmc.scene.messages import Log


@dataclass(frozen=True)
class SampleSpec:
    """Cases to sample: the cases ``numbers`` of the sample of ``total`` cases with a ``seed``."""

    seed: int
    numbers: CaseSelection
    total: int

    @property
    def text(self) -> str:
        """Case numbers as text; empty if they are all cases of the sample."""
        all_of_them = self.numbers.are_first and self.total == self.numbers.count
        return "" if all_of_them else str(self.numbers)


class Chunk(NamedTuple):
    """Cases integrated in one call.

    Attributes
    ----------
    first : int
        Number of the first case.
    inputs : ndarray, shape (n, d)
        Sampled inputs, in the units of the campaign file.
    block : Block
        Results of the kernel.
    summary : BatchSummary
        Counts and largest errors of these cases.
    """

    first: int
    inputs: np.ndarray
    block: Block
    summary: BatchSummary


def integrate_chunk(
    campaign: Definition,
    integration: Integration,
    spec: SampleSpec,
    first: int,
    end: int,
    with_histories: bool,
    timing: dict[str, float],
    announce: Log | None = None,
) -> Chunk:
    """Sample and integrate cases ``first`` to ``end`` - 1.

    Parameters
    ----------
    campaign : Definition
    integration : Integration
    spec : SampleSpec
    first, end : int
    with_histories : bool
        Store histories in the block.
    timing : dict of str to float
        Seconds are added to the keys sample, compile and kernel.
    announce : Log, optional
        Called with a message if a fallback kernel is compiled.

    Returns
    -------
    Chunk
    """
    clock = time.perf_counter
    t0 = clock()
    inputs = campaign.sample(first, end - first, spec.seed, spec.total)
    t1, compile_s = clock(), compile_wait_s()
    history_size = history_rows(campaign.scene) if with_histories else 0
    block = integrate(campaign, integration, campaign.in_si(inputs), history_size, announce)
    compile_s = compile_wait_s() - compile_s  # for a kernel that few cases need
    timing["sample"] += t1 - t0
    timing["compile"] += compile_s
    timing["kernel"] += clock() - t1 - compile_s
    return Chunk(first, inputs, block, count(campaign, inputs, block))
