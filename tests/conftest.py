"""Scenes and settings shared by test files."""

import gc
import os
import tomllib
from collections import Counter

# Read when numpy is imported: beside other busy processes, threads that wait for one another take
# up to ten times as long as one.
os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")

import pytest
from oracles.random_scenes.interpreted import run_interpreted
from small_scenes import PAIR

import sepmc
from sepmc.campaign.campaign import Campaign
from sepmc.engine import compile_workers
from sepmc.scene.read import parse_campaign

pytest_plugins = ["pytester", "support.cpu_budgets"]

# Interpreted kernels make millions of small objects, hardly any of them in a cycle: the default
# garbage collection takes an eighth of the time.
gc.set_threshold(100_000, 50, 50)


# Compile workers wait for the next kernel: they have the formulas compiled.
compile_workers.IDLE_S = 1800.0


def pytest_collection_modifyitems(items):
    """Start with the files that have most slow tests: no worker is left with one of them at the
    end."""
    slow = Counter(item.path for item in items if item.get_closest_marker("slow"))
    items.sort(key=lambda item: -slow[item.path])


@pytest.fixture(scope="session")
def table2():
    """Shipped campaign of Table 2."""
    return sepmc.load("table2.toml")


@pytest.fixture(scope="session")
def pair():
    """Factory of campaigns of two bodies in empty space, with settings by TOML path: ``pair({path:
    value})``."""
    return lambda settings=None: Campaign(parse_campaign(tomllib.loads(PAIR), "pair", settings))


@pytest.fixture
def plainly():
    """Campaigns run interpreted, with steps selected from their first cases."""
    with run_interpreted():
        yield
