"""What drives outcomes: rank correlations, indices of functions that have known ones, planted
causes; through a run folder and the command."""

import numpy as np
import pandas as pd
import pytest
from click.testing import CliRunner
from numpy.testing import assert_allclose
from oracles.random_scenes.interpreted import run_interpreted
from scipy import stats

import sepmc
from sepmc.analysis.failure_attribution import attribute_failures
from sepmc.analysis.failure_attribution import render_attribution as causes_text
from sepmc.analysis.sensitivity import (
    _ranks,
    input_sensitivities,
    leading_inputs,
    render_sensitivities,
)
from sepmc.campaign.cases import Sampling, probabilities, size_fault
from sepmc.cli import app
from sepmc.report import sensitivity_figures
from sepmc.report.sensitivity_figures import scatter_figure, tornado_figure
from sepmc.scene.messages import InputError

# first-order and total indices of Ishigami's function, a = 7, b = 0.1 (Saltelli et al. 2008, 4.7)
ISHIGAMI = [(0.3139, 0.5576), (0.4424, 0.4424), (0.0, 0.2437), (0.0, 0.0)]
G = (0.0, 1.0, 4.5, 9.0)


def call(*arguments):
    return CliRunner().invoke(app.main, [str(a) for a in arguments])


def ishigami(u):
    x = np.pi * (2.0 * u - 1.0)
    return np.sin(x[0]) + 7.0 * np.sin(x[1]) ** 2 + 0.1 * x[2] ** 4 * np.sin(x[0])


def g_function(u):
    """Sobol's function of known indices."""
    a = np.array(G)[:, None]
    return np.prod((np.abs(4.0 * u[:4] - 2.0) + a) / (1.0 + a), axis=0)


def g_indices():
    """V_i = 1 / (3 (1 + a_i)^2), V = prod(1 + V_i) - 1, S_i = V_i / V, ST_i = V_i prod_{j != i} (1
    + V_j) / V (Saltelli et al. 2008, 2.8)."""
    parts = 1.0 / (3.0 * (1.0 + np.array(G)) ** 2)
    whole = np.prod(1.0 + parts) - 1.0
    return [(p / whole, p * np.prod(1.0 + parts) / (1.0 + p) / whole) for p in parts]


def of_function(function, sampling, seed, count=4):
    """Drivers of a function of uniform inputs, in the order of these."""
    names = [f"x{k}" for k in range(count)]
    u = probabilities(names, seed, 0, sampling.cases, sampling)
    y = function(u)
    table = dict(zip(names, u, strict=True)) | {"y": y, "status": np.array(["ok"] * len(y))}
    return input_sensitivities(table, names, "y", sampling.sampler).sort_index()


@pytest.mark.slow
@pytest.mark.parametrize(
    ("function", "known"), [(ishigami, ISHIGAMI), (g_function, g_indices())], ids=["ishigami", "g"]
)
def test_known_indices(function, known):
    """Within the intervals told, of random cases the first-order indices, of Saltelli campaigns
    total ones too: of 20 repeats and four inputs at least 86 %, where 95 % are due."""
    first, total = np.array(known).T
    inside = {"first": [], "first of saltelli": [], "total": []}
    for seed in range(20):
        by_rows = of_function(function, Sampling("random", 3000), seed)
        by_groups = of_function(function, Sampling("saltelli", 6 * 512), seed)
        for what, table, name, true in (
            ("first", by_rows, "first", first),
            ("first of saltelli", by_groups, "first", first),
            ("total", by_groups, "total", total),
        ):
            near = 0.005  # of indices of zero, whose intervals can shrink to nothing
            low, high = table[f"{name}_low"] - near, table[f"{name}_high"] + near
            inside[what] += ((low <= true) & (true <= high)).tolist()
    assert {what for what, result in inside.items() if np.mean(result) < 0.86} == set()
    assert_allclose(by_groups["total"], total, atol=0.06)
    assert_allclose(by_rows["first"], first, atol=0.06)


def test_rank_correlations():
    """As scipy's, and partial ones as those of what a regression on the other ranks leaves."""
    rng = np.random.default_rng(3)
    x = rng.normal(size=(3, 400))
    x[1] += 0.7 * x[0]
    y = np.exp(x[0]) - 0.5 * x[1] + rng.normal(size=400)
    cases = {"a": x[0], "b": x[1], "c": x[2], "y": y, "status": np.array(["ok"] * 400)}
    result = input_sensitivities(cases, ["a", "b", "c"], "y", indices=False)
    ranks = {name: stats.rankdata(column) for name, column in cases.items() if name != "status"}
    for name, others in {"a": "bc", "b": "ac", "c": "ab"}.items():
        assert_allclose(result["rank"][name], stats.spearmanr(cases[name], y).statistic, rtol=1e-12)
        known = np.column_stack([np.ones(400), *(ranks[other] for other in others)])
        left = [
            column - known @ np.linalg.lstsq(known, column, rcond=None)[0]
            for column in (ranks[name], ranks["y"])
        ]
        assert_allclose(result["partial"][name], np.corrcoef(left)[0, 1], rtol=1e-6)


@pytest.mark.slow
def test_coverage_of_rank_intervals():
    """Of 1,000 repeats 95 % hold the rank correlation of a normal law, 6 / pi asin(r / 2), within
    two standard errors and 1 % for Bonett and Wright's approximation."""
    rng, true, stored = np.random.default_rng(5), 6.0 / np.pi * np.arcsin(0.3), 0
    for _ in range(1000):
        x = rng.normal(size=(2, 100))
        y = 0.6 * x[0] + 0.8 * x[1]
        cases = {"a": x[0], "y": y, "status": np.array(["ok"] * 100)}
        row = input_sensitivities(cases, ["a"], "y", indices=False).loc["a"]
        stored += row["rank_low"] <= true <= row["rank_high"]
    assert abs(stored / 1000 - 0.95) < 2.0 * np.sqrt(0.95 * 0.05 / 1000) + 0.01


def test_a_rare_failure_is_among_leading_inputs():
    """One that 4 of 4,000 cases have shifts the mean by 6 sigma, and is among the inputs that are
    shown and drawn, though others explain more of the variance; one that shifts nothing is not."""
    rng, n = np.random.default_rng(2), 4000
    x = {f"x{k:02d}": rng.normal(size=n) for k in range(12)}
    fails, idle = np.zeros(n), np.zeros(n)
    fails[rng.choice(n, 4, replace=False)] = 1.0
    idle[rng.choice(n, 4, replace=False)] = 1.0
    y = sum((1.0 - 0.05 * k) * column for k, column in enumerate(x.values()))
    y = y + 6.0 * y.std() * fails
    names = [*x, "fails", "idle"]
    cases = x | {"fails": fails, "idle": idle, "y": y, "status": np.array(["ok"] * n)}
    result = input_sensitivities(cases, names, "y")
    assert "fails" not in result.index[:3]
    for most in (2, 3, 8):
        shown = leading_inputs(result, most)
        assert len(shown) == most
        assert "fails" in shown.index
        assert "idle" not in shown.index
        assert shown.index.tolist() == [name for name in result.index if name in shown.index]
    row = result.loc["fails"]
    assert_allclose(row["mean_high"] - row["mean_low"], 6.0 * y.std(), rtol=0.3)
    ends = y[fails == 1.0], y[fails == 0.0]
    variance = [max(end.var(ddof=1), y.var(ddof=1)) for end in ends]
    error = np.sqrt(sum(var / len(end) for var, end in zip(variance, ends, strict=True)))
    near = row["mean_high"] - row["mean_low"] - stats.t.ppf(0.975, 3) * error
    assert_allclose(row["shift"], near, rtol=1e-9)
    assert "fails" in render_sensitivities(result, "y", {})


def test_a_few_cases_that_are_alike_shift_nothing():
    """Of 200 campaigns whose outcome is 0 or 1 whatever a failure of three cases does, at most 5 %
    say that it surely shifts the mean, and two standard errors."""
    rng, n, sure = np.random.default_rng(8), 2000, 0
    for _ in range(200):
        idle = np.zeros(n)
        idle[rng.choice(n, 3, replace=False)] = 1.0
        y = (rng.random(n) < 0.05).astype(float)
        cases = {"idle": idle, "y": y, "status": np.array(["ok"] * n)}
        sure += input_sensitivities(cases, ["idle"], "y", indices=False).loc["idle", "shift"] > 0.0
    assert sure <= 200 * 0.05 + 2.0 * np.sqrt(200 * 0.05 * 0.95)


def test_inputs_that_shift_no_mean_are_shown_first():
    """Eight inputs that do most, by their squares, and eight that do little but shift the mean: at
    most two of these are shown among the eight."""
    rng = np.random.default_rng(9)
    even, odd = rng.normal(size=(2, 8, 4000))
    x = {f"e{k}": even[k] for k in range(8)} | {f"l{k}": odd[k] for k in range(8)}
    cases = x | {"y": (even**2).sum(axis=0) + 0.25 * odd.sum(axis=0)}
    shown = leading_inputs(
        input_sensitivities(cases | {"status": np.array(["ok"] * 4000)}, list(x), "y"), 8
    )
    assert sum(name.startswith("e") for name in shown.index) >= 6


def test_refused_outcomes():
    cases = {"a": np.arange(50.0), "b": np.ones(50), "y": np.ones(50)}
    cases["status"] = np.array(["ok"] * 50)
    with pytest.raises(ValueError, match="y: does not vary"):
        input_sensitivities(cases, ["a", "b"], "y")
    with pytest.raises(ValueError, match="fewer than 20 cases"):
        input_sensitivities({name: column[:19] for name, column in cases.items()}, ["a"], "y")
    result = input_sensitivities(cases | {"y": np.arange(50.0) ** 2}, ["a", "b"], "y")
    assert result.index.tolist() == ["a"]  # b does not vary
    cases["status"][:40] = "never-released"
    with pytest.raises(ValueError, match="fewer than 20 cases"):
        input_sensitivities(cases, ["a"], "y")


def planted(seed):
    """27 inputs of 10,000 cases, violations by one of them beyond a threshold, by two together, or
    within a band of one, among 0.1 to 20 %; the inputs that cause them."""
    rng = np.random.default_rng(seed)
    x, (i, j) = rng.random((27, 10_000)), rng.choice(27, 2, replace=False)
    kind = seed % 3
    if kind == 0:
        level, cause = x[i] + 0.1 * rng.normal(size=10_000), (i,)
    elif kind == 1:
        level = rng.choice([-1.0, 1.0]) * (x[i] - 0.5) * (x[j] - 0.5)
        level, cause = level + 0.01 * rng.normal(size=10_000), tuple(sorted((i, j)))
    else:
        level, cause = -np.abs(x[i] - rng.uniform(0.2, 0.8)), (i,)
    violates = level > np.quantile(level, 1.0 - 10.0 ** rng.uniform(-3.0, -0.7))
    names = [f"x{k:02d}" for k in range(27)]
    return dict(zip(names, x, strict=True)), violates, tuple(names[k] for k in cause)


@pytest.mark.slow
def test_planted_causes():
    """Of 100 campaigns at least 95 name the cause first; where they do, its region holds more
    violations than elsewhere."""
    first = 0
    for seed in range(100):
        cases, violates, cause = planted(seed)
        result = attribute_failures(cases, list(cases), violates)
        first += bool(result) and result[0].inputs == cause
        for one in result[:1]:
            assert one.inside / one.cases > violates.mean()
            stored = np.ones(len(violates), dtype=bool)
            for name, (low, high) in zip(one.inputs, one.region, strict=True):
                stored &= (cases[name] >= low) & (cases[name] <= high)
            assert (stored.sum(), violates[stored].sum()) == (one.cases, one.inside)
    assert first >= 95


def test_nothing_is_made_up():
    """Of 100 campaigns whose violations have no cause, none names one (0.1 are due)."""
    rng = np.random.default_rng(1)
    for _ in range(100):
        cases = {f"x{k}": rng.random(2000) for k in range(12)}
        assert (
            attribute_failures(
                cases, list(cases), rng.random(2000) < 10.0 ** rng.uniform(-2.5, -0.5)
            )
            == []
        )
    assert attribute_failures(cases, list(cases), np.zeros(2000, dtype=bool)) == []


def test_discrete_inputs():
    """A failed spring behind all violations: its values are the parts."""
    rng = np.random.default_rng(2)
    fails, other = (rng.random(5000) < 0.02).astype(float), rng.random(5000)
    (result,) = attribute_failures(
        {"fails": fails, "other": other}, ["fails", "other"], fails > 0.5
    )
    assert result.inputs == ("fails",)
    assert result.region == ((1.0, 1.0),)
    assert (result.inside, result.cases) == (result.violations, result.violations)
    assert result.information > 0.99


def test_causes_by_themselves_are_no_pairs():
    """Violations by a failed spring, by a slow motor, or by one that is high at random: each of the
    two is named alone, and what is told of a region is told of the cases in it."""
    rng = np.random.default_rng(3)
    fails, thrust, other = (rng.random(8000) < 0.02).astype(float), *rng.random((2, 8000))
    violates = (fails > 0.5) | (thrust < 0.05) | (rng.random(8000) < 0.01)
    cases = {"fails": fails, "thrust": thrust, "other": other}
    result = attribute_failures(cases, list(cases), violates)
    assert sorted(one.inputs for one in result) == [("fails",), ("thrust",)]
    text = causes_text("late", result, {"fails": "spring.aft.fails"})
    assert "spring.aft.fails explains" in text
    assert f"mostly where spring.aft.fails = 1: {int(fails.sum())} of the " in " ".join(
        text.split()
    )
    by_name = {one.inputs[0]: one for one in result}
    assert by_name["thrust"].region[0][0] == thrust.min()
    assert by_name["thrust"].region[0][1] < 0.2
    assert by_name["fails"].inside == by_name["fails"].cases == fails.sum()


def test_a_pair_where_most_cases_violate():
    """Two inputs that violate together where both are high or both low, in 90 % of the cases, and
    elsewhere in 65 %: neither tells anything alone."""
    rng = np.random.default_rng(10)
    a, b, other = rng.random((3, 6000))
    violates = rng.random(6000) < np.where((a > 0.5) == (b > 0.5), 0.9, 0.65)
    (result,) = attribute_failures({"a": a, "b": b, "other": other}, ["a", "b", "other"], violates)
    assert result.inputs == ("a", "b")


def test_the_region_of_a_cause_is_no_chance_cell():
    """Of cells of a pair, one that is full of violations but small does not stand for the pair:
    the one that tells most by itself does."""
    rng = np.random.default_rng(4)
    a, b = rng.random((2, 6000))
    violates = (a > 0.5) & (b > 0.5) & (rng.random(6000) < 0.4)
    rare = np.zeros(6000)
    rare[np.flatnonzero(violates)[:2]] = 1.0
    result = attribute_failures({"a": a, "b": b, "rare": rare}, ["a", "b", "rare"], violates)
    assert result[0].inputs == ("a", "b")
    assert all(low >= 0.45 for low, _ in result[0].region)
    assert not any("rare" in one.inputs for one in result)


@pytest.mark.parametrize("chance", [0.003, 0.01, 0.1, 0.5])
def test_a_rare_value_drives(chance):
    """y = 15 a + b, a one of two values, b normal: the index of a is that of two groups, 225 p q /
    (225 p q + 1), within the interval told in 34 of 40 campaigns or more; the bar goes from one
    group's mean to the other's."""
    rng, inside = np.random.default_rng(5), 0
    known = 225.0 * chance * (1.0 - chance)
    known /= known + 1.0
    for _ in range(40):
        a, b = (rng.random(3000) < chance).astype(float), rng.normal(size=3000)
        cases = {"a": a, "b": b, "y": 15.0 * a + b, "status": np.array(["ok"] * 3000)}
        row = input_sensitivities(cases, ["a", "b"], "y").loc["a"]
        inside += row["first_low"] <= known <= row["first_high"]
    assert inside >= 34
    assert abs(row["mean_low"]) < 0.1
    assert row["mean_high"] == pytest.approx(15.0, abs=1.0)
    assert row["first"] == pytest.approx(known, abs=0.25)


def test_a_group_that_drives_nothing():
    """Indices of values that do nothing: as often below zero as above."""
    rng, result = np.random.default_rng(6), []
    for _ in range(200):
        a, y = rng.integers(0, 5, 500).astype(float), rng.normal(size=500)
        cases = {"a": a, "y": y, "status": np.array(["ok"] * 500)}
        result.append(input_sensitivities(cases, ["a"], "y").loc["a", "first"])
    assert abs(np.mean(result)) < 2.0 * np.std(result) / np.sqrt(200.0)


def test_note_on_interactions():
    """y = a b of inputs about zero: no input explains anything by itself."""
    a, b = np.random.default_rng(7).normal(size=(2, 2000))
    cases = {"a": a, "b": b, "y": a * b, "status": np.array(["ok"] * 2000)}
    text = render_sensitivities(input_sensitivities(cases, ["a", "b"], "y"), "y", {})
    assert "the rest is due to interactions" in text
    assert "interactions" not in render_sensitivities(
        input_sensitivities(cases | {"y": a}, ["a", "b"], "y"), "y", {}
    )


def test_groups_of_a_saltelli_design():
    """Each case of a group is its first with one parameter of its last; a count that makes no whole
    groups is refused with those that do."""
    u = probabilities(["a", "b"], 3, 0, 16, Sampling("saltelli", 16)).T.reshape(4, 4, 2)
    for first, of_a, of_b, last in u:
        assert (of_a == [last[0], first[1]]).all()
        assert (of_b == [first[0], last[1]]).all()
    # any part of it can be drawn alone
    part = probabilities(["a", "b"], 3, 5, 6, Sampling("saltelli", 16)).T
    assert (part == u.reshape(16, 2)[5:11]).all()
    assert size_fault(Sampling("saltelli", 16), 2) == ""
    assert "groups of 5 cases: give a multiple, best 80 or 160" in size_fault(
        Sampling("saltelli", 99), 3
    )
    assert size_fault(Sampling("saltelli", 99), 0) == "a Saltelli design needs a [dispersion]"
    assert size_fault(Sampling("random", 99), 3) == ""


@pytest.mark.slow
def test_through_a_run_folder(tmp_path):
    """Python and the command tell the same of a run whose cases partly are never released, and
    partly violate a requirement."""
    slow = {"name": "slow", "metric": "separation_speed_m_s", "at_least": 0.55}
    campaign = sepmc.load("table2", {"run.end_time_s": 0.26, "requirement": [slow]})
    with run_interpreted():
        result = campaign.run(cases=150, seed=7, out=tmp_path / "run")
    called = call("sensitivity", tmp_path / "run", "separation_speed_m_s", "--no-plots")
    assert called.exit_code == 0, called.output
    table = result.sensitivity("separation_speed_m_s")
    kept = pd.read_csv(tmp_path / "run" / "sensitivity.csv")
    assert kept["input"].tolist() == table.index.tolist()
    assert_allclose(kept["rank"], table["rank"], rtol=1e-14)
    order = "by first-order index (lower bound), then by shift of the mean"
    assert f"sensitivity of separation_speed_m_s: {order}\n" in called.stdout
    rows = result.to_pandas()
    ok = rows[rows["status"] == "ok"]
    late = f"({len(rows) - len(ok)} others have no such outcome)"
    violations = (ok["separation_speed_m_s"] < 0.55).sum()
    assert f"slow, {violations} of {len(ok)} cases {late}" in called.stdout
    first = result.causes("never-released")[0]
    causes_kept = pd.read_csv(tmp_path / "run" / "causes.csv")
    of_release = causes_kept[causes_kept["violated"] == "never-released"].iloc[0]
    assert of_release["input"] == first.inputs[0]
    assert f"never-released, {first.violations} of 150 cases: inputs that" in called.stdout
    assert not (tmp_path / "run" / "sensitivity.png").exists()
    assert call("sensitivity", tmp_path / "run").exit_code == 0
    assert (tmp_path / "run" / "sensitivity.png").stat().st_size > 20_000
    called = pd.read_csv(tmp_path / "run" / "sensitivity.csv")
    one, other = called["outcome"].unique()[:2]
    assert call("sensitivity", tmp_path / "run", other, "--no-plots").exit_code == 0
    again = pd.read_csv(tmp_path / "run" / "sensitivity.csv")
    assert again["outcome"].unique()[-1] == other  # what was told of others stays
    pd.testing.assert_frame_equal(again[again["outcome"] == one], called[called["outcome"] == one])
    assert len(again) == len(called)
    wrong = call("sensitivity", tmp_path / "run", "separation_sped_m_s")
    assert wrong.exit_code == 2
    assert "did you mean 'separation_speed_m_s'" in wrong.stderr
    with pytest.raises(InputError, match="no such requirement or status; did you mean 'slow'"):
        result.causes("slo")


def test_a_saltelli_campaign(tmp_path):
    settings = {"run.sampler": "saltelli", "run.end_time_s": 0.4}
    settings["dispersion"] = {
        "body.upper.mass_kg": {"uniform": 20.0},
        "initial.pitch_deg": {"uniform": 1.0},
    }
    campaign = sepmc.load("table2", settings)
    with pytest.raises(InputError, match="groups of 4 cases: give a multiple, best 8 or 16"):
        campaign.run(cases=15)
    with run_interpreted():
        result = campaign.run(cases=256, out=tmp_path / "run")
    assert any("differ from another one in one parameter only" in note for note in result.notes)
    table = result.sensitivity("upper_pitch_deg")
    assert table.index[0] == "in_initial_pitch_deg"
    # ranks are of the cases that do not repeat each other: the first and the last of each four
    alone = result.to_pandas()[lambda rows: (rows["case"] % 4).isin([0, 3])]
    expected = alone[table.index].corrwith(alone["upper_pitch_deg"], method="spearman")
    assert_allclose(table["rank"], expected)
    assert_allclose(table["total"], [1.0, 0.0], atol=0.15)


@pytest.mark.parametrize("n", [1000, 10_000])
@pytest.mark.parametrize("shape", ["exponential", "jump"])
def test_first_order_index_of_a_steep_outcome(n, shape):
    """Its interval holds the closed form as often as it says: ten waves by themselves would tell
    four fifths of the first at 10,000 cases. Where few cases decide the variance there is none."""
    own, other = np.array([1.0, 0.7, 0.4]), 0.3
    exact = (np.e - 1.0) / (np.exp(np.sum(own**2)) - 1.0)
    beyond = stats.norm.sf(1.0) * stats.norm.cdf(1.0)
    exact = exact if shape == "exponential" else beyond / (beyond + other**2)
    stored, given, result = 0, 0, []
    for seed in range(20):
        u = np.random.default_rng(seed).standard_normal((n, 3))
        y = np.exp(u @ own) if shape == "exponential" else (u[:, 0] > 1.0) + other * u[:, 1]
        names = ["in_a", "in_b", "in_c"]
        cases = {"status": np.full(n, "ok"), "y": y, **dict(zip(names, u.T, strict=True))}
        row = input_sensitivities(cases, names, "y").loc["in_a"]
        stored += row["first_low"] <= exact <= row["first_high"]
        given += np.isfinite(row["first_low"])
        result.append(row["first"])
    assert given - stored <= 3
    assert given == 20 if shape == "jump" else given < 10
    assert np.mean(result) == pytest.approx(exact, rel=0.1)


@pytest.fixture
def drawn(monkeypatch):
    """Figures of drivers as they are, not written."""
    caught = []
    monkeypatch.setattr(sensitivity_figures, "save", lambda figure, *_: caught.append(figure))
    return caught


def test_bars_without_significance_are_pale(tmp_path, drawn):
    """y = 3 a + b^2: a swings the mean, b has an index, c and d have neither; the indices stand
    beside, with the intervals of the table."""
    x = dict(zip("abcd", np.random.default_rng(1).normal(size=(4, 800)), strict=True))
    cases = x | {"y": 3.0 * x["a"] + x["b"] ** 2, "status": np.array(["ok"] * 800)}
    table = input_sensitivities(cases, list(x), "y")
    assert table.loc["b", "shift"] == 0.0
    tornado_figure({"y": table}, tmp_path, {}, {}, "title\nset: k = 1")
    (figure,) = drawn
    bars, indices = figure.axes
    assert figure.get_suptitle().endswith("title\nset: k = 1")
    strong = {}
    for patch in bars.patches:
        if np.isfinite(patch.get_width()):
            name = table.index[::-1][round(patch.get_y() + patch.get_height() / 2.0)]
            strong.setdefault(name, set()).add(patch.get_alpha() == 1.0)
    assert strong == {"a": {True}, "b": {True}, "c": {False}, "d": {False}}
    assert "pale: effect alone not significant (95 %)" in bars.get_legend_handles_labels()[1]
    (_, _, (reach,)), top = indices.containers[0], table[::-1]
    ends = np.array([segment[:, 0] for segment in reach.get_segments()])
    assert_allclose(ends, top[["first_low", "first_high"]])


def test_outcomes_over_inputs_say_of_which_run(tmp_path, drawn):
    """What was set ends the title; a long name is folded beside its axis."""
    x = np.random.default_rng(1).normal(size=(2, 100))
    name = "the_upper_stage_has_a_very_long_name_transverse_rate_deg_s"
    cases = {"a": x[0], name: x[0] + x[1], "status": np.array(["ok"] * 100)}
    table = input_sensitivities(cases, ["a"], name)
    crossed = {name: np.zeros((2, 100), dtype=bool)}
    units = {name: "deg/s"}
    scatter_figure({name: table}, cases, crossed, tmp_path, units, {}, "title\nset: k = 1")
    (figure,) = drawn
    assert figure.get_suptitle() == "Outcomes over their leading inputs\ntitle\nset: k = 1"
    figure.draw_without_rendering()
    ax = figure.axes[0]
    assert ax.yaxis.label.get_window_extent().height <= 1.05 * ax.get_window_extent().height


def test_cases_without_a_required_outcome_are_marked(tmp_path, drawn):
    """At their value, or at the lower edge without one; beyond the first 1,500 cases as well."""
    a = np.random.default_rng(1).normal(size=2000)
    y = a.copy()
    y[1990] = np.nan
    cases = {"a": a, "y": y, "status": np.array(["ok"] * 2000)}
    marks = np.zeros((2, 2000), dtype=bool)
    marks[0, 1980], marks[1, [1985, 1990]] = True, True
    table = input_sensitivities(cases, ["a"], "y")
    scatter_figure({"y": table}, cases, {"y": marks}, tmp_path, {}, {}, "title")
    (figure,) = drawn
    dots, crossed, lacking, edge = figure.axes[0].lines
    assert not np.isin(a[[1980, 1985, 1990]], dots.get_xdata()).any()
    assert (crossed.get_xdata(), crossed.get_ydata()) == (a[1980], y[1980])
    assert (lacking.get_xdata(), lacking.get_ydata()) == (a[1985], y[1985])
    assert (edge.get_xdata(), edge.get_ydata()) == (a[1990], 0.0)
    assert lacking.get_label() == edge.get_label()


def test_ranks_of_equal_values_are_their_mean():
    rng = np.random.default_rng(3)
    x = np.array([rng.normal(size=200), rng.integers(0, 5, 200), np.zeros(200)])
    assert np.array_equal(_ranks(x), [stats.rankdata(row) for row in x])
