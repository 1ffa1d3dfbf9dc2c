"""Two runs beside each other: pairs of cases, independent samples, files, verdicts."""

import numpy as np
import pandas as pd
import pytest
from click.testing import CliRunner
from numpy.testing import assert_allclose
from oracles.random_scenes.interpreted import run_interpreted
from scipy import stats

import sepmc
from sepmc.analysis.compare import compare, dependence_warning, tree_differences
from sepmc.analysis.proportions import difference_interval, paired_interval
from sepmc.campaign.store import shards
from sepmc.cli import app


def call(*arguments):
    return CliRunner().invoke(app.main, [str(a) for a in arguments])


def table(x, y):
    count = len(x)
    status = np.array(["ok"] * count, dtype=object)
    return {"case": np.arange(count), "status": status, "in_x": x, "y": y}


def test_pairs():
    """As scipy's paired interval; a case that is not ok in one run is no pair."""
    rng = np.random.default_rng(1)
    x, noise = rng.normal(size=200), 0.01 * rng.normal(size=200)
    one, two = table(x, x), table(np.append(x, 0.0), np.append(1.001 * x + 0.1 + noise, 5.0))
    one["status"][3] = two["status"][7] = "never-released"
    row = compare(one, two, ["in_x"], ["y"]).loc["y"]
    kept = np.delete(np.arange(200), [3, 7])
    separate = (two["y"][:200] - one["y"])[kept]
    assert row["pairs"] == 198
    assert_allclose(row["difference"], separate.mean())
    low, high = stats.t.interval(0.95, 197, separate.mean(), stats.sem(separate))
    assert_allclose([row["low"], row["high"]], [low, high])
    assert_allclose(row["mean_one"], np.delete(x, 3).mean())


def test_pairs_are_joined_by_case():
    """Rows of one number belong together, wherever they stand: gaps, other ranges, any order; by
    position 200 rows would be pairs, and the inputs of a quarter of them agree by chance."""
    rng = np.random.default_rng(5)
    x, fails = rng.normal(size=400), rng.integers(0, 2, 400).astype(float)
    one, two = table(x, x), table(x, x + 1.0)
    one["in_fails"] = two["in_fails"] = fails
    order = rng.permutation(np.arange(100, 300))
    for name in two:
        two[name] = two[name][order]
    for name in one:
        one[name] = np.delete(one[name], np.arange(150, 160))
    for inputs, changed in ((["in_x", "in_fails"], []), (["in_x", "in_fails"], ["in_x"])):
        row = compare(one, two, inputs, ["y"], changed).loc["y"]
        assert row["pairs"] == 190
        assert_allclose([row["difference"], row["low"], row["high"]], 1.0)
    shifted = two | {"case": two["case"] + 1}  # other draws of the same numbers
    assert compare(one, shifted, ["in_x", "in_fails"], ["y"]).loc["y", "pairs"] == 0
    assert compare(one, shifted, ["in_fails"], ["y"]).loc["y", "pairs"] == 0


def test_six_pairs_need_students_law():
    """Half an interval of six pairs is 2.571 standard errors, not 1.960; and of two samples of six
    it is Welch's, with the freedoms of both."""
    x = np.arange(6.0)
    one, two = table(x, x), table(x, x + np.array([0.5, 1.0, -0.1, 0.9, -0.3, 0.8]))
    row = compare(one, two, ["in_x"], ["y"]).loc["y"]
    separate = two["y"] - one["y"]
    assert_allclose(
        [row["low"], row["high"]], stats.ttest_1samp(separate, 0.0).confidence_interval(0.95)
    )
    assert row["low"] < 0.0 < row["high"]
    assert separate.mean() - 1.96 * stats.sem(separate) > 0.0
    two["in_x"] = x + 10.0
    row = compare(one, two, ["in_x"], ["y"]).loc["y"]
    welch = stats.ttest_ind(two["y"], one["y"], equal_var=False).confidence_interval(0.95)
    assert row["pairs"] == 0
    assert_allclose([row["low"], row["high"]], [welch.low, welch.high])


@pytest.mark.slow
def test_coverage_of_small_samples():
    """Of 4,000 repeats of five cases 95 % hold the true difference, paired or not."""
    rng, stored = np.random.default_rng(6), np.zeros(2)
    for _ in range(4000):
        x, other, noise = rng.normal(size=(3, 5))
        for k, two in enumerate((table(x, x + 0.3 + noise), table(other, other + 0.3))):
            row = compare(table(x, x), two, ["in_x"], ["y"]).loc["y"]
            stored[k] += row["low"] <= 0.3 <= row["high"]
    assert_allclose(stored / 4000, 0.95, atol=2.0 * np.sqrt(0.95 * 0.05 / 4000) + 0.004)


def test_shares_of_yes_or_no():
    """Recontacts are compared as proportions: by pairs that differ as McNemar's exact test has it,
    and never as if none of 20 could not be one of the next."""
    x, none = np.arange(20.0), np.zeros(20)
    one, two = table(x, none), table(x, none)
    one["gap_recontact"], two["gap_recontact"] = none, none.copy()
    low, high = compare(one, two, ["in_x"], ["gap_recontact"]).loc["gap_recontact", ["low", "high"]]
    assert -0.25 < low < -0.15
    assert 0.15 < high < 0.25
    for gained, significant in ((5, False), (6, True)):
        two["gap_recontact"] = (x < gained).astype(float)
        row = compare(one, two, ["in_x"], ["gap_recontact"]).loc["gap_recontact"]
        assert row["difference"] == gained / 20
        assert (row["low"] > 0.0) == significant
        assert significant == (stats.binomtest(gained, gained).pvalue < 0.05)
        assert row["high"] < 0.65


@pytest.mark.parametrize("n", [3, 6, 12])
def test_paired_proportions_enumerated(n):
    """Of all tables of n pairs, weighed by their probabilities, 95 % at least hold the true
    difference, whatever the two probabilities."""
    tables = [(b, c) for b in range(n + 1) for c in range(n + 1 - b)]
    ends = {each: paired_interval(*each, n) for each in tables}
    for p in np.linspace(0.02, 0.95, 12):
        for q in np.linspace(0.01, 0.98 - p, 6) if p < 0.97 else ():
            law, within = stats.multinomial(n, [p, q, 1.0 - p - q]), 0.0
            for (b, c), (low, high) in ends.items():
                if low <= p - q <= high:
                    within += law.pmf([b, c, n - b - c])
            assert within > 0.95, (p, q)


@pytest.mark.parametrize(("n", "m", "least"), [(5, 5, 0.925), (10, 10, 0.94), (12, 30, 0.94)])
def test_independent_proportions_enumerated(n, m, least):
    """The same of two samples, as far as the docstring says."""
    ends = {(a, b): difference_interval(a, n, b, m) for a in range(n + 1) for b in range(m + 1)}
    for p in np.linspace(0.02, 0.98, 9):
        for q in np.linspace(0.02, 0.98, 9):
            of_one, of_two = (stats.binom(k, s).pmf(range(k + 1)) for k, s in ((n, p), (m, q)))
            within = sum(
                of_one[a] * of_two[b]
                for (a, b), (low, high) in ends.items()
                if low <= q - p <= high
            )
            assert within > least, (p, q)


def test_a_changed_input_that_agrees_in_some_cases():
    """A failure that became likelier: pairs are all cases, never those alone that it left as they
    were, which would show that it does nothing."""
    rng = np.random.default_rng(4)
    x, fails = rng.normal(size=(2, 200))
    one, two = table(x, x), table(x, np.where(fails > 1.0, x + 5.0, x))
    one["in_fails"], two["in_fails"] = np.zeros(200), (fails > 1.0).astype(float)
    row = compare(one, two, ["in_x", "in_fails"], ["y"], ["in_fails"]).loc["y"]
    assert row["pairs"] == 200
    assert_allclose(row["difference"], 5.0 * (fails > 1.0).mean())
    assert compare(one, two, ["in_x", "in_fails"], ["y"]).loc["y", "pairs"] == 0
    # nothing else tells which cases belong together: those left as they were would differ by none
    row = compare(one, two, ["in_fails"], ["y"], ["in_fails"]).loc["y"]
    assert row["pairs"] == 0
    assert row["difference"] > 0.1
    one["in_z"], two["in_z"] = fails, fails + 1.0  # correlated now: another value in every case
    names = ["in_x", "in_z", "in_fails"]
    changed = ["in_z", "in_fails"]
    assert compare(one, two, names, ["y"], changed).loc["y", "pairs"] == 200
    assert compare(one, one, names, ["y"], names).loc["y", "pairs"] == 200  # the same cases


def test_independent_samples():
    """Other inputs: no pairs, Welch's interval."""
    rng = np.random.default_rng(2)
    one, two = table(rng.normal(size=300), rng.normal(size=300)), None
    two = table(rng.normal(size=400), 1.0 + 2.0 * rng.normal(size=400))
    row = compare(one, two, ["in_x"], ["y"]).loc["y"]
    assert row["pairs"] == 0
    result = stats.ttest_ind(two["y"], one["y"], equal_var=False).confidence_interval(0.95)
    assert_allclose([row["low"], row["high"]], [result.low, result.high])


def test_coverage():
    """Of 1,000 repeats 95 % hold the true difference, within two standard errors: paired or
    not."""
    rng, stored = np.random.default_rng(3), np.zeros(2)
    for _ in range(1000):
        x, other = rng.normal(size=(2, 150))
        one = table(x, x)
        y = x + 0.3 + 0.2 * rng.normal(size=150)
        for k, two in enumerate((table(x, y), table(other, other + 0.3))):
            row = compare(one, two, ["in_x"], ["y"]).loc["y"]
            stored[k] += row["low"] <= 0.3 <= row["high"]
    assert_allclose(stored / 1000, 0.95, atol=2.0 * np.sqrt(0.95 * 0.05 / 1000) + 0.005)


def test_differences_of_files():
    one = {"run": {"cases": 5}, "spring": [{"name": "a", "force_N": 1.0}], "title": "t"}
    two = {"run": {"cases": 6, "seed": 1}, "spring": [{"name": "a", "force_N": 2.0}]}
    assert tree_differences(one, two) == [
        "run.cases: 5 -> 6",
        "run.seed: - -> 1",
        "spring.a.force_N: 1.0 -> 2.0",
        "title: t -> -",
    ]
    assert tree_differences(one, one) == []


def test_a_number_in_another_unit_is_one_difference_or_none():
    """Files are compared by the paths of their parameters, in SI."""
    cg = "body.upper.cg_m.x"
    one = {
        "body": {"upper": {"cg_m": [0.1, 0.2, 0.3], "mass_kg": 1.0}, "x_mm": {"mass_kg": 1.0}},
        "spring": [{"name": "a", "stroke_mm": 20.0}],
        "dispersion": {cg: {"normal": [0.1, 0.01], "truncate_sigma": 3.0}},
    }
    two = {
        "body": {"upper": {"cg_mm": [100.0, 200.0, 300.0], "mass_g": 1.5e3}, "x_m": {}},
        "spring": [{"name": "a", "stroke_m": 0.02}],
        "dispersion": {"body.upper.cg_mm.x": {"normal": [100.0, 10.0], "truncate_sigma": 3.0}},
    }
    result = tree_differences(one, two)
    assert result == [
        "body.upper.mass_kg: 1.0 -> mass_g = 1500.0",
        "body.x_mm: {'mass_kg': 1.0} -> -",
        "body.x_m: - -> {}",
    ]
    assert len(tree_differences(one, two, units=True)) == len(result) + 3
    two["dispersion"]["body.upper.cg_mm.x"]["truncate_sigma"] = 2.0
    assert len(tree_differences(one, two)) == len(result) + 1


@pytest.fixture(scope="module")
def runs(tmp_path_factory):
    """Two runs of one seed, of which the second has a heavier lower stage."""
    folder = tmp_path_factory.mktemp("compare")
    fast = {"name": "fast", "metric": "separation_speed_m_s", "at_least": 0.4, "probability": 0.5}
    with run_interpreted():
        for name, mass in (("light", 0.0), ("heavy", 20.0)):
            nominal = sepmc.load("table2").scene.body["lower"].mass
            settings = {"requirement": [fast], "body.lower.mass_kg": nominal + mass}
            settings["dispersion.body.lower.mass_kg"] = {"constant": nominal + mass}
            sepmc.load("table2", settings).run(cases=25, seed=3, out=folder / name)
    return folder


@pytest.mark.slow
def test_command(runs, tmp_path):
    called = call("compare", runs / "light", runs / "heavy", "--out", tmp_path / "beside")
    assert called.exit_code == 0, called.output
    text = called.stdout
    assert "body.lower.mass_kg: " in text
    assert "ok: 25 -> 25 cases" in text
    assert "requirement fast: pass, 0 of 25 cases violate it -> " in text
    kept = pd.read_csv(tmp_path / "beside" / "compare.csv", index_col="outcome")
    row = kept.loc["separation_speed_m_s"]
    # a heavier stage is slowed less: every pair says so, two means of 25 cases would not
    assert row["high"] < 0.0
    assert (tmp_path / "beside" / "compare.png").stat().st_size > 20_000
    assert kept["pairs"].max() == 25  # a law of one value that became another
    key, thrusts = "dispersion.motor.retro.thrust_N", {"discrete": [500.0, 250.0]}
    with run_interpreted():
        for name, weights in (("rarely", [0.9, 0.1]), ("often", [0.4, 0.6])):
            law = {key: thrusts | {"weights": weights}}
            sepmc.load(runs / "light", law).run(cases=25, seed=3, out=tmp_path / name)
    weak = call("compare", tmp_path / "rarely", tmp_path / "often", "--out", tmp_path / "and")
    assert f"{key}.weights" in weak.stdout
    kept = pd.read_csv(tmp_path / "and" / "compare.csv", index_col="outcome")
    assert kept.loc["separation_speed_m_s", "pairs"] == 25
    assert kept.loc["separation_speed_m_s", "difference"] < -0.05
    with run_interpreted():  # some of the cases: rows of one number belong together
        sepmc.load(tmp_path / "often").run(cases="8:20", out=tmp_path / "some")
    command = call("compare", tmp_path / "rarely", tmp_path / "some", "--out", tmp_path / "part")
    assert "  cases: 0:25 -> 8:20\n" in command.stdout
    assert "run.cases" not in command.stdout
    kept = pd.read_csv(tmp_path / "part" / "compare.csv", index_col="outcome")
    every, some = (shards.read_cases(tmp_path / name) for name in ("rarely", "some"))
    separate = some.set_index("case")["upper_roll_deg"] - every.set_index("case")["upper_roll_deg"]
    called = kept.loc["upper_roll_deg"]
    assert called["pairs"] == 12
    assert_allclose(called["difference"], separate[8:20].mean())
    with run_interpreted():  # another seed: few differ in an input of two values, and yet no pairs
        sepmc.load(tmp_path / "rarely").run(cases=25, seed=4, out=tmp_path / "other")
    call("compare", tmp_path / "rarely", tmp_path / "other", "--out", tmp_path / "seeds")
    kept = pd.read_csv(tmp_path / "seeds" / "compare.csv", index_col="outcome")
    assert (kept["pairs"] == 0).all()
    with run_interpreted():  # of this sampler each number of cases is another draw
        for count in (20, 40):
            settings = {"run.sampler": "lhs", key: thrusts | {"weights": [0.9, 0.1]}}
            several = sepmc.load(runs / "light", settings)
            several.run(cases=count, seed=3, out=tmp_path / f"lhs{count}")
    command = call("compare", tmp_path / "lhs20", tmp_path / "lhs40", "--out", tmp_path / "sizes")
    assert "sampler lhs: the cases of a run are not independent" in " ".join(command.stdout.split())
    kept = pd.read_csv(tmp_path / "sizes" / "compare.csv", index_col="outcome")
    assert (kept["pairs"] == 0).all()
    same = call("compare", runs / "light", runs / "light")
    assert "differences of the campaign files\n  none\n" in same.stdout
    assert "sampler" not in same.stdout
    assert call("compare", runs / "light", tmp_path).exit_code == 2


@pytest.mark.slow
def test_rows_that_were_resumed_or_kept(runs, tmp_path):
    """A run in parts of which one was flown again, out of order, is compared as one that was left
    alone; of a run that keeps rows of some cases no others are made up."""
    parts = tmp_path / "parts"
    with run_interpreted():
        loaded = sepmc.load(runs / "heavy")
        for count in (9, 17, 25):
            loaded.run(cases=count, seed=3, out=parts, resume=True)
        sorted((parts / "cases").glob("*.parquet"))[0].unlink()
        loaded.run(cases=25, seed=3, out=parts, resume=True)
        loaded.run(cases=25, seed=3, out=tmp_path / "kept", keep="every:5")
    frames = []
    for other, out in ((runs / "heavy", "whole"), (parts, "resumed")):
        assert call("compare", runs / "light", other, "--out", tmp_path / out).exit_code == 0
        frames.append(pd.read_csv(tmp_path / out / "compare.csv", index_col="outcome"))
    pd.testing.assert_frame_equal(*frames)
    kept = call("compare", runs / "light", tmp_path / "kept")
    assert kept.exit_code == 2
    assert "the rows selected by --keep" in " ".join(kept.output.split())
    # rows that someone chose from either run, in any order: joined by case
    one, two = (shards.read_cases(runs / name) for name in ("light", "heavy"))
    some = two[two["case"] % 3 == 1].iloc[::-1]
    table = compare(one, some, ["in_initial_alpha_deg"], ["separation_speed_m_s"])
    row = table.loc["separation_speed_m_s"]
    separate = (two["separation_speed_m_s"] - one["separation_speed_m_s"])[two["case"] % 3 == 1]
    assert row["pairs"] == len(some)
    assert_allclose(row["difference"], separate.mean())


def test_dependence_warning_by_sampler():
    assert dependence_warning(["random", "random"]) == ""
    assert dependence_warning(["sobol", "random"]).startswith("sampler sobol: ")
    assert dependence_warning(["lhs", "sobol"]).startswith("sampler lhs and sobol: ")
    assert "too narrow" in dependence_warning(["random", "saltelli"])
