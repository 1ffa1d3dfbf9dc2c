"""Cases that are drawn and flown together."""

import time
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from sepmc.campaign.case_selection import Numbers
from sepmc.campaign.definition import Definition
from sepmc.campaign.execution.batch_summary import Tally, count
from sepmc.campaign.execution.integration import Flight, Say, fly, history_rows
from sepmc.engine.dispatch import Block, compile_wait_s


@dataclass(frozen=True)
class Draws:
    """Which cases are drawn: by which seed, their numbers, and of how many in ``total``."""

    seed: int
    numbers: Numbers
    total: int

    @property
    def told(self) -> str:
        """The numbers as text; nothing, if they are the first ones and no others are drawn."""
        all_of_them = self.numbers.are_first and self.total == self.numbers.count
        return "" if all_of_them else str(self.numbers)


class Piece(NamedTuple):
    """Cases flown together: the number of the first, their draws (n, d) in the units of the file,
    what the kernel gave, and what is counted of them."""

    first: int
    drawn: np.ndarray
    block: Block
    tally: Tally


def fly_piece(
    campaign: Definition,
    flight: Flight,
    draws: Draws,
    first: int,
    end: int,
    with_histories: bool,
    timing: dict[str, float],
    announce: Say | None = None,
) -> Piece:
    """Draw and fly cases ``first`` to ``end``; seconds are added to ``timing``, by stage."""
    clock = time.perf_counter
    t0 = clock()
    drawn = campaign.draw(first, end - first, draws.seed, draws.total)
    t1, waited = clock(), compile_wait_s()
    room = history_rows(campaign.scene) if with_histories else 0
    block = fly(campaign, flight, campaign.in_si(drawn), room, announce)
    waited = compile_wait_s() - waited  # for a kernel that few cases need
    timing["sample"] += t1 - t0
    timing["compile"] += waited
    timing["kernel"] += clock() - t1 - waited
    return Piece(first, drawn, block, count(campaign, drawn, block))
