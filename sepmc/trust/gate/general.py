"""The general kernel for a process that runs plain Python: flown compiled, by a process beside it, as it would take minutes there.

`python -m sepmc.trust.gate.general` answers pickles on its standard input.
"""

import os
import pickle
import subprocess
import sys
from functools import cache
from typing import Any

import msgspec
import numpy as np

from sepmc import pilot
from sepmc.campaign import Campaign
from sepmc.door import Block
from sepmc.scene.read import parse_campaign


def install() -> None:
    """Let the pilot of this process fly the general kernel in one beside it."""
    pilot._fly_general = _ask


def _ask(campaign: Campaign, step: float | None, draws: np.ndarray, room: int) -> Block:
    process = _beside()
    assert process.stdin is not None
    assert process.stdout is not None
    pickle.dump((msgspec.json.encode(campaign.file.tree), campaign.name, step, draws, room), process.stdin)
    process.stdin.flush()
    answer = pickle.load(process.stdout)
    if isinstance(answer, Exception):
        raise answer
    return answer


@cache
def _beside() -> subprocess.Popen[bytes]:
    environment = {**os.environ, "NUMBA_DISABLE_JIT": "0"}
    program = [sys.executable, "-m", "sepmc.trust.gate.general"]
    return subprocess.Popen(program, env=environment, stdin=subprocess.PIPE, stdout=subprocess.PIPE)


@cache
def _campaign(tree: bytes, name: str) -> Campaign:
    return Campaign(parse_campaign(msgspec.json.decode(tree), name))


def main() -> None:
    answers = os.fdopen(os.dup(1), "wb")
    os.dup2(2, 1)
    while True:
        try:
            tree, name, step, draws, room = pickle.load(sys.stdin.buffer)
        except EOFError:
            return
        answer: Any
        try:
            answer = pilot._fly_general(_campaign(tree, name), step, draws, room)
        except Exception as error:
            answer = error
        pickle.dump(answer, answers)
        answers.flush()


if __name__ == "__main__":
    main()
