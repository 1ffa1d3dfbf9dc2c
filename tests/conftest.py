"""Scenes that several test files fly."""

import gc
import tomllib

import pytest
from oracles.random_scenes.interpreted import run_interpreted
from small_scenes import PAIR

import sepmc
from sepmc.campaign.campaign import Campaign
from sepmc.engine import compile_workers, interpreted
from sepmc.scene.read import parse_campaign

# Kernels flown as plain Python make millions of small objects, hardly any of them in a cycle:
# looking for those so often takes an eighth of the time.
gc.set_threshold(100_000, 50, 50)


# Processes that compile wait for the next kernel: they hold the formulas compiled.
compile_workers.IDLE_S = 1800.0


class _Recent(dict):
    """The last kernels that were read as plain Python, by their text: tests fly scenes in turn, and
    reading one takes as long as some flights."""

    def clear(self):
        """Forget all but the last seven."""
        for text in list(self)[:-7]:
            del self[text]


interpreted._loaded = _Recent(interpreted._loaded)


@pytest.fixture(scope="session")
def table2():
    """The shipped campaign of Table 2."""
    return sepmc.load("table2.toml")


@pytest.fixture(scope="session")
def pair():
    """Maker of campaigns of two bodies in empty space, with values put in place by TOML path:
    ``pair({path: value})``."""
    return lambda settings=None: Campaign(parse_campaign(tomllib.loads(PAIR), "pair", settings))


@pytest.fixture
def plainly():
    """Campaigns are flown as plain Python meanwhile, in steps found from their first cases."""
    with run_interpreted():
        yield
