"""Chunks: consecutive cases that are sampled and integrated together."""

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
    """Cases of a run: the case ``numbers`` taken from a sample of ``total`` cases, which the random
    ``seed`` determines."""

    seed: int
    numbers: CaseSelection
    total: int

    @property
    def text(self) -> str:
        """Case numbers as text, such as ``25:50,73`` (25 to 49, and 73); empty if they are all
        cases of the sample."""
        all_of_them = self.numbers.are_first and self.total == self.numbers.count
        return "" if all_of_them else str(self.numbers)


class Chunk(NamedTuple):
    """Inputs and results of n consecutive cases that were integrated together.

    Attributes
    ----------
    first : int
        Case number of the first one.
    inputs : ndarray, shape (n, d)
        Sampled inputs, in the units of the campaign file.
    block : Block
        Results of the kernel, SI.
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
    """Sample the inputs of cases ``first`` to ``end`` - 1 and integrate these cases.

    Parameters
    ----------
    campaign : Definition
    integration : Integration
        Kernel and steps.
    spec : SampleSpec
        Seed and size of the sample that the cases belong to.
    first, end : int
        Number of the first case, and one more than that of the last one.
    with_histories : bool
        If True, the block of the chunk contains separation histories.
    timing : dict of str to float
        Changed in place: seconds are added to the values of the keys sample, compile and kernel.
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
