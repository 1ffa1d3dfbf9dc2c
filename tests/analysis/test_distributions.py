"""Laws of outcomes: the probabilities told are those of simulation, planted laws are found."""

import numpy as np
import pandas as pd
import pytest
from click.testing import CliRunner

from sepmc.analysis import distributions
from sepmc.analysis.statistics import statistics
from sepmc.cli import app

REPEATS = 1000


def cases(**outcomes):
    n = len(next(iter(outcomes.values())))
    return pd.DataFrame({"case": np.arange(n), "status": n * ["ok"], **outcomes})


def drawn(name, size, seed=0):
    """Values of a law with some location and scale."""
    law, rng = distributions.DISTRIBUTIONS[name], np.random.default_rng(seed)
    location, scale = (0.3, 0.4) if law.of_logarithm else (-2.0, 3.0)
    y = law.frozen(location, scale).rvs(size, random_state=rng)
    return np.exp(y) if law.of_logarithm else y


@pytest.mark.slow
@pytest.mark.parametrize("name", ["normal", "logistic", "extreme value, largest"])
@pytest.mark.parametrize("n", [20, 500])
def test_probabilities_are_those_of_simulation(name, n):
    """Of fitted laws: 1,000 samples fall below 10 and 2.5 % as often as they should, within 3
    standard errors."""
    law = distributions.DISTRIBUTIONS[name]
    collected = []
    for x in np.sort(drawn(name, (REPEATS, n)), axis=1):
        fitted = law.frozen(*law.fit(x))
        collected.append(law.probability(distributions._anderson_darling(fitted, x), n))
    for level in (0.1, 0.025):
        share = np.mean(np.array(collected) < level)
        assert abs(share - level) < 3.0 * np.sqrt(level * (1.0 - level) / REPEATS), level


@pytest.mark.parametrize("name", distributions.DISTRIBUTIONS)
def test_a_planted_law_is_found(name):
    """The nearest, with its parameters and ends, and nothing speaks against it."""
    row = distributions.fit_distributions(cases(x=drawn(name, 4000, seed=5)), ["x"]).loc["x"]
    assert row["distribution"] == name
    assert row["p"] > distributions.LEVEL
    law = distributions.DISTRIBUTIONS[name]
    location, scale = (0.3, 0.4) if law.of_logarithm else (-2.0, 3.0)
    assert abs(row["location"] - location) < 0.1 * scale
    assert abs(row["scale"] - scale) < 0.1 * scale
    exact = law.frozen(location, scale).ppf(0.99865)
    assert row["p99_865"] == pytest.approx(np.exp(exact) if law.of_logarithm else exact, rel=0.1)
    assert (row["normal_p"] > distributions.LEVEL) == (name == "normal")


def test_shape():
    """Skewness and kurtosis of a uniform law are 0 and -1.2; it is none of the laws."""
    row = distributions.fit_distributions(
        cases(x=np.random.default_rng(1).uniform(size=5000)), ["x"]
    ).loc["x"]
    assert abs(row["skewness"]) < 3.0 * row["skewness_se"]
    assert abs(row["kurtosis"] + 1.2) < 3.0 * row["kurtosis_se"]
    assert row["p"] == 0.01


def test_no_fit():
    """Too few values, the same one again and again, and cases that failed."""
    x = np.random.default_rng(2).normal(size=100)
    table = cases(few=np.where(np.arange(100) < 10, x, np.nan), same=np.repeat(x[:5], 20), x=x)
    table["status"] = np.where(np.arange(100) < 60, "ok", "unresolved")
    result = distributions.fit_distributions(table, ["few", "same", "x"])
    assert list(result["distribution"]) == ["too few cases", "discrete", "normal"]
    assert list(result["n"]) == [10, 60, 60]
    assert result.loc["same", ["skewness", "p"]].isna().all()


def test_text():
    """A poor fit is reported, beside the interval of the percentile of all cases."""
    rng = np.random.default_rng(3)
    table = cases(speed_m_s=rng.normal(2.0, 0.1, 2000), angle_deg=rng.uniform(0, 1, 2000))
    names = ["speed_m_s", "angle_deg"]
    text = distributions.render_fits(
        distributions.fit_distributions(table, names),
        statistics(table, names),
        {"speed_m_s": "m/s"},
        width=200,
    ).splitlines()
    assert "normal, p" in text[0]
    assert "normal" in text[1]
    assert "none (" in text[2]
    assert "< 0.01" in text[2]


def test_through_a_run_folder(pair, plainly, tmp_path):
    """The command and Python tell the same; what the sampler does to p is said."""
    spring = {
        "name": "push", "bodies": ["fore", "aft"], "point_m": [2.0, 0.0, 0.0],
        "axis": [-1, 0, 0], "force_N": 20.0,
    }  # fmt: skip
    laws_of_inputs = {"spring.push.force_N": {"normal": 2.0}, "body.aft.mass_kg": {"uniform": 0.1}}
    settings = {"spring": [spring], "dispersion": laws_of_inputs, "solver.step_s": 0.05}
    settings["phase"] = [{"name": "free", "joints": {"pins": "slider"}}]
    result = pair(settings).run(cases=60, seed=3, out=tmp_path / "run")
    called = CliRunner().invoke(app.main, ["fit", str(tmp_path / "run"), "separation_speed_m_s"])
    assert called.exit_code == 0, called.output
    assert "99.865 %: fitted" in called.stdout
    assert "not independent" not in called.stdout
    kept = pd.read_csv(tmp_path / "run" / "distributions.csv", index_col="outcome")
    row = result.fit().loc["separation_speed_m_s"]
    assert kept.loc["separation_speed_m_s", "distribution"] == row["distribution"] != ""
    assert kept.loc["separation_speed_m_s", "p"] == row["p"] > distributions.LEVEL
    wrong = CliRunner().invoke(app.main, ["fit", str(tmp_path / "run"), "separation_sped_m_s"])
    assert wrong.exit_code == 2
    assert "did you mean 'separation_speed_m_s'" in wrong.stderr
    pair(settings | {"run.sampler": "sobol"}).run(cases=32, out=tmp_path / "sobol")
    called = CliRunner().invoke(app.main, ["fit", str(tmp_path / "sobol")])
    assert "run.sampler = 'sobol' are not independent" in called.stdout
