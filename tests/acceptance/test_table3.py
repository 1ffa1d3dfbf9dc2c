"""The paper's Table 3: all 36 numbers, on the campaign's own seed and five others."""

import numpy as np
import pytest

import sepmc

# the first is the campaign's; none was used by notebooks/reconstruct.py
SEEDS = (2019, 1, 2, 3, 4, 5)
# What one seed differs from another at 10,000 cases: means 0.01 sigma, sigmas 1 %, extremes 0.04 to
# 0.13 sigma, the greatest pitch rate 0.31 (tests/measure/targets.py). The rest is room for what the
# reconstruction cannot give.
MEAN, SIGMA, EXTREME_AVERAGE, EXTREME_SEED = 0.05, 0.05, 0.6, 0.9


@pytest.fixture(scope="module")
def deviations():
    """Deviations by seed: arrays (6, 9) by name, in sigmas of Table 3 or relative for sigma."""
    campaign = sepmc.load("table2.toml", {"run.history_step_s": 0.0})
    assert campaign.scene.run.seed == SEEDS[0]
    assert campaign.scene.run.cases == 10_000
    rows = [campaign.run(seed=seed).statistics().loc[list(campaign.reference)] for seed in SEEDS]
    assert all((row["n"] == 10_000).all() for row in rows)
    return {
        name: np.array([row[name] for row in rows])
        for name in ("dev_mean", "dev_sigma", "dev_min", "dev_max")
    }


def test_nine_means(deviations):
    assert np.abs(deviations["dev_mean"]).max() <= MEAN


def test_nine_sigmas(deviations):
    assert np.abs(deviations["dev_sigma"]).max() <= SIGMA


@pytest.mark.parametrize("end", ["dev_min", "dev_max"])
def test_eighteen_extremes(deviations, end):
    assert np.abs(deviations[end].mean(axis=0)).max() <= EXTREME_AVERAGE
    assert np.abs(deviations[end]).max() <= EXTREME_SEED


def test_seeds_differ(deviations):
    """The six campaigns are six samples, not one: their means scatter by about sigma / sqrt(n)."""
    scatter = deviations["dev_mean"].std(axis=0, ddof=1)
    assert np.all(scatter > 0.001)
    assert np.all(scatter < 0.03)
