"""Compiled flights for a process that runs plain Python: the general kernel would take minutes there, so one beside it flies them.

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
    pilot._fly_general = _fly_general


def simulate(campaign: Campaign, number: int, seed: int) -> tuple[dict[str, float], str]:
    """Outcomes and status of the single run of a case."""
    return _ask("simulate", campaign, number, seed)


def _fly_general(campaign: Campaign, step: float | None, draws: np.ndarray, room: int) -> Block:
    return _ask("fly", campaign, step, draws, room)


def _ask(what: str, campaign: Campaign, *given: Any) -> Any:
    process = _beside()
    assert process.stdin is not None
    assert process.stdout is not None
    pickle.dump((what, msgspec.json.encode(campaign.file.tree), campaign.name, given), process.stdin)
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


def _answer(what: str, campaign: Campaign, given: tuple[Any, ...]) -> Any:
    if what == "fly":
        return pilot._fly_general(campaign, *given)
    history = campaign.simulate(campaign.case(*given), step_s=campaign.scene.run.end_time)
    return history.attrs["outcomes"], history.attrs["status"]


def main() -> None:
    answers = os.fdopen(os.dup(1), "wb")
    os.dup2(2, 1)
    while True:
        try:
            what, tree, name, given = pickle.load(sys.stdin.buffer)
        except EOFError:
            return
        answer: Any
        try:
            answer = _answer(what, _campaign(tree, name), given)
        except Exception as error:
            answer = error
        pickle.dump(answer, answers)
        answers.flush()


if __name__ == "__main__":
    main()
