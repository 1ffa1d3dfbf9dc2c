"""Statistics against hand-computed numbers, repeated sampling and properties that hold for any
data."""

import numpy as np
import pandas as pd
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.testing import assert_allclose

from sepmc.analysis.statistics import (
    PERCENTILES,
    audit,
    percentile_curves,
    statistics,
    status_counts,
)
from sepmc.analysis.statistics_text import render_audit, render_summary, rounded

PERCENTS = list(PERCENTILES)


def table(values, status="ok", **others):
    values = np.asarray(values, dtype=float)
    return pd.DataFrame(
        {"case": np.arange(len(values)) + 100, "status": status, "speed_m_s": values, **others}
    )


@pytest.fixture
def five():
    """Five values in no order, and two rows that must not count."""
    return table(
        [30.0, 10.0, 50.0, 20.0, 40.0, 1e9, -1e9], status=["ok"] * 5 + ["no_release", "not_finite"]
    )


def test_hand_computed(five):
    row = statistics(five, ["speed_m_s"]).loc["speed_m_s"]
    assert (row["n"], row["min"], row["max"], row["p50"]) == (5, 10.0, 50.0, 30.0)
    assert (row["case_min"], row["case_max"]) == (101, 102)
    assert row["mean"] == pytest.approx(30.0)
    assert row["sigma"] == pytest.approx(np.sqrt(250.0))  # (400 + 100 + 0 + 100 + 400) / 4
    assert row["mean_se"] == pytest.approx(np.sqrt(50.0))
    # fourth moment 68 000, s^4 62 500: sqrt((68 000 - 62 500 * 2 / 4) / 5) / (2 sqrt(250))
    assert row["sigma_se"] == pytest.approx(np.sqrt(7350.0) / (2 * np.sqrt(250.0)))
    assert_allclose(
        row[PERCENTS].to_numpy(dtype=float), [10.054, 10.4, 12.0, 30.0, 48.0, 49.6, 49.946]
    )


def test_columns_and_types(five):
    stats = statistics(five, ["speed_m_s"])
    assert list(stats.columns) == [
        "n",
        "mean",
        "sigma",
        "min",
        "max",
        *PERCENTS,
        "mean_se",
        "sigma_se",
        "case_min",
        "case_max",
        *(f"{name}_{end}" for name in PERCENTS for end in ("low", "high")),
    ]
    assert stats.index.name == "outcome"
    assert stats["n"].dtype == "int64"
    assert (stats.dtypes.drop("n") == "float64").all()


def test_nan_is_left_out_of_its_own_column_only():
    cases = table([1.0, 2.0, 3.0, 4.0], release_s=[np.nan, 0.2, np.nan, 0.4])
    stats = statistics(cases, ["speed_m_s", "release_s"])
    assert list(stats["n"]) == [4, 2]
    assert stats.loc["release_s", "mean"] == pytest.approx(0.3)
    assert (stats.loc["release_s", "case_min"], stats.loc["release_s", "case_max"]) == (101, 103)


@pytest.mark.parametrize("status", ["no_release", "ok"])
def test_no_value_at_all(status):
    row = statistics(table([np.nan, np.nan], status=status), ["speed_m_s"]).loc["speed_m_s"]
    assert row["n"] == 0
    assert row.drop("n").isna().all()


def test_empty_table():
    assert statistics(table([]), ["speed_m_s"]).loc["speed_m_s", "n"] == 0
    assert status_counts(table([])) == {"ok": 0}


def test_one_value_has_no_sigma():
    row = statistics(table([7.0]), ["speed_m_s"]).loc["speed_m_s"]
    assert (row["n"], row["mean"], row["min"], row["max"], row["p99_865"]) == (
        1,
        7.0,
        7.0,
        7.0,
        7.0,
    )
    assert row[["sigma", "mean_se", "sigma_se"]].isna().all()


@pytest.mark.parametrize("value", [0.0, 0.1, -26.4, 1e300])
def test_equal_values_have_exactly_zero_sigma(value):
    row = statistics(table([value] * 7), ["speed_m_s"]).loc["speed_m_s"]
    assert (row["mean"], row["sigma"], row["mean_se"], row["sigma_se"]) == (value, 0.0, 0.0, 0.0)


def test_an_infinity_stays_visible():
    row = statistics(table([1.0, 2.0, np.inf]), ["speed_m_s"]).loc["speed_m_s"]
    assert row["n"] == 3
    assert row["max"] == row["mean"] == np.inf
    assert np.isnan(row["sigma"])


def test_missing_column_is_named(five):
    with pytest.raises(KeyError, match="no column spead_m_s"):
        statistics(five, ["spead_m_s"])


LAWS = {
    "uniform": lambda rng, shape: rng.uniform(-1.0, 1.0, shape),
    "normal": lambda rng, shape: rng.normal(3.0, 2.0, shape),
    "skew": lambda rng, shape: rng.gamma(4.0, 1.0, shape),
}


@pytest.mark.parametrize("law", LAWS)
def test_standard_errors_are_the_scatter_of_repeated_campaigns(law):
    """The standard error stated by one campaign is the scatter over many; 1500 repeats know that
    scatter to 1.8 %."""
    samples = LAWS[law](np.random.default_rng(2019), (400, 1500))
    columns = [f"r{k}" for k in range(samples.shape[1])]
    cases = pd.concat([table(samples[:, 0]), pd.DataFrame(samples, columns=columns)], axis=1)
    stats = statistics(cases, columns)
    assert stats["mean_se"].mean() == pytest.approx(stats["mean"].std(), rel=0.06)
    assert stats["sigma_se"].mean() == pytest.approx(stats["sigma"].std(), rel=0.06)


def test_deviations_from_the_reference(five):
    reference = {
        "speed_m_s": {"mean": 28.0, "sigma": 10.0, "min": 15.0, "max": 45.0},
        "other_mm": {"mean": 0.0},
    }
    row = statistics(five, ["speed_m_s"], reference).loc["speed_m_s"]
    assert (row["ref_mean"], row["ref_sigma"], row["ref_min"], row["ref_max"]) == (
        28.0,
        10.0,
        15.0,
        45.0,
    )
    assert (row["dev_mean"], row["dev_min"], row["dev_max"]) == pytest.approx((0.2, -0.5, 0.5))
    assert row["dev_sigma"] == pytest.approx(np.sqrt(250.0) / 10.0 - 1.0)


def test_a_reference_may_be_partial(five):
    five["other_mm"] = 1.0
    stats = statistics(five, ["speed_m_s", "other_mm"], {"speed_m_s": {"mean": 28.0}})
    assert stats.loc["speed_m_s", "ref_mean"] == 28.0
    # no sigma to measure in
    assert stats.loc["speed_m_s", ["ref_sigma", "dev_mean", "dev_sigma"]].isna().all()
    assert stats.loc["other_mm", [c for c in stats if c.startswith(("ref_", "dev_"))]].isna().all()
    zero = statistics(five, ["speed_m_s"], {"speed_m_s": {"mean": 28.0, "sigma": 0.0}})
    assert np.isnan(zero.loc["speed_m_s", "dev_mean"])


VALUES = st.lists(st.floats(-1e6, 1e6, allow_subnormal=False), min_size=2, max_size=40)


@given(values=VALUES)
@settings(deadline=None, max_examples=60)
def test_order_of_the_columns(values):
    row = statistics(table(values), ["speed_m_s"]).loc["speed_m_s"]
    assert (np.diff(row[["min", *PERCENTS, "max"]].to_numpy(dtype=float)) >= -1e-9).all()
    assert row["sigma"] >= 0.0
    assert row["sigma_se"] >= 0.0
    assert values[int(row["case_min"]) - 100] == row["min"]
    assert values[int(row["case_max"]) - 100] == row["max"]


@given(values=VALUES, junk=st.lists(st.floats(), max_size=5), seed=st.integers(0, 99))
@settings(deadline=None, max_examples=60)
def test_neither_order_nor_failed_cases_matter(values, junk, seed):
    plain = statistics(table(values), ["speed_m_s"])
    mixed = table(values + junk, status=["ok"] * len(values) + ["failed"] * len(junk)).sample(
        frac=1.0, random_state=seed
    )
    other = statistics(mixed, ["speed_m_s"])
    figures = plain.columns.drop(["case_min", "case_max"])  # of equal extremes the first is named
    assert_allclose(
        other[figures].to_numpy(dtype=float),
        plain[figures].to_numpy(dtype=float),
        rtol=1e-9,
        atol=1e-9,
    )


@given(
    values=st.lists(st.integers(-1000, 1000), min_size=2, max_size=40),
    scale=st.floats(1e-3, 1e3),
    shift=st.floats(-1e3, 1e3),
)
@settings(deadline=None, max_examples=60)
def test_a_change_of_unit_changes_nothing_else(values, scale, shift):
    plain = statistics(table(values), ["speed_m_s"]).loc["speed_m_s"]
    other = statistics(table(np.array(values) * scale + shift), ["speed_m_s"]).loc["speed_m_s"]
    for name in ("mean", "min", "max", *PERCENTS):
        assert other[name] == pytest.approx(plain[name] * scale + shift, rel=1e-9, abs=1e-8)
    for name in ("sigma", "mean_se", "sigma_se"):
        assert other[name] == pytest.approx(plain[name] * scale, rel=1e-6, abs=1e-8)


@pytest.mark.parametrize("size", [1e-200, 1e200])
def test_neither_underflow_nor_overflow(size):
    row = statistics(table(np.array([30.0, 10.0, 50.0, 20.0, 40.0]) * size), ["speed_m_s"]).loc[
        "speed_m_s"
    ]
    assert row["sigma_se"] / size == pytest.approx(np.sqrt(7350.0) / (2 * np.sqrt(250.0)))


def test_status_counts():
    cases = table(np.zeros(6), status=["late", "ok", "ok", "stuck", "late", "late"])
    counts = status_counts(cases)
    assert list(counts.items()) == [("ok", 2), ("late", 3), ("stuck", 1)]
    assert all(type(count) is int for count in counts.values())
    cases["status"] = pd.Categorical(cases["status"], categories=["ok", "late", "stuck", "never"])
    assert status_counts(cases) == counts


@given(status=st.lists(st.sampled_from(["ok", "late", "stuck"]), max_size=30))
@settings(deadline=None, max_examples=30)
def test_every_case_is_counted_once(status):
    assert sum(
        status_counts(pd.DataFrame({"status": pd.Series(status, dtype=str)})).values()
    ) == len(status)


def test_percentile_curves():
    rng = np.random.default_rng(3)
    values = rng.normal(size=(30, 3))
    values[4, 1] = np.nan
    times = np.array([0.0, 0.1, 0.3])
    long = pd.DataFrame(
        {
            "case": np.repeat(np.arange(30), 3),
            "time_s": np.tile(times, 30),
            "speed_m_s": values.ravel(),
        }
    )
    long.loc[long["case"] > 20, "time_s"] += 1e-13  # another sum of steps, the same time
    curves = percentile_curves(long.sample(frac=1.0, random_state=1), "speed_m_s")
    assert list(curves.columns) == ["min", "p1", "p5", "p50", "p95", "p99", "max", "mean"]
    assert curves.index.name == "time_s"
    assert_allclose(curves.index, times, atol=1e-12)
    assert_allclose(
        curves.to_numpy()[:, :-1].T,
        np.nanpercentile(values, [0, 1, 5, 50, 95, 99, 100], axis=0),
        atol=1e-14,
    )
    assert_allclose(curves["mean"], np.nanmean(values, axis=0), atol=1e-14)


def test_percentile_curves_of_little():
    long = pd.DataFrame({"case": [0, 0], "time_s": [0.0, 0.1], "speed_m_s": [2.0, np.nan]})
    curves = percentile_curves(long, "speed_m_s")
    assert (curves.loc[0.0] == 2.0).all()
    assert curves.loc[0.1].isna().all()
    assert percentile_curves(long[:0], "speed_m_s").empty


@pytest.mark.parametrize(
    ("value", "scale", "text"),
    [
        (4.06012, 0.6716, "4.060"),
        (118.2149, 13.19, "118.2"),
        (0.56, 0.0575, "0.5600"),
        (-1e-5, 1.025, "0.00"),  # no minus sign on a zero
        (300400.4, 2500.0, "300400"),
        (26.4, 0.0, "26.40"),
        (0.0, 0.0, "0"),
        (26.4, np.nan, "26.40"),
        (-0.0, np.nan, "0"),
        (1.5e-11, 1e-11, "1.500e-11"),
        (np.nan, 1.0, "-"),
        (np.inf, np.nan, "inf"),
    ],
)
def test_rounded(value, scale, text):
    assert rounded(value, scale) == text


def paper_like(n):
    rng = np.random.default_rng(5)
    cases = pd.DataFrame({"case": np.arange(n), "status": "ok"})
    cases["upper_alpha_ref_deg"] = rng.normal(4.1, 0.7, n)
    cases["separation_distance_mm"] = rng.normal(118.0, 13.0, n)
    cases["peak_dynamic_pressure_of_the_mated_vehicle_Pa"] = rng.normal(3e5, 100.0, n)
    cases["never_s"] = np.nan
    reference = {
        "upper_alpha_ref_deg": {"max": 5.93, "min": 2.42, "mean": 4.06, "sigma": 0.6716},
        "separation_distance_mm": {"max": 162.3, "min": 75.83, "mean": 118.21, "sigma": 13.19},
    }
    return cases, reference


def test_summary_text():
    cases, reference = paper_like(2000)
    cases.loc[[3, 5], "status"] = "no_release"
    stats = statistics(cases, list(cases.columns[2:]), reference)
    text = render_summary(stats, status_counts(cases), {"separation_distance_mm": "mm"})
    lines = text.splitlines()
    assert max(map(len, lines)) <= 118
    assert lines[0] == "2000 cases, 1998 ok; left out: no_release 2"
    beside = text[text.index("Compared with the paper") :]
    row = next(
        line for line in beside.splitlines() if line.startswith("upper_alpha_ref_deg")
    ).split()
    alpha = stats.loc["upper_alpha_ref_deg"]
    assert row[1:4] == ["4.06", f"{alpha['mean']:.3f}", f"{alpha['dev_mean']:+.2f}"]
    assert row[4:7] == ["0.6716", f"{alpha['sigma']:.3f}", f"{100 * alpha['dev_sigma']:+.1f}%"]
    assert row[7] == "5.93"
    assert row[10] == "2.42"
    assert "never_s" not in beside
    never = next(line for line in lines if line.startswith("never_s")).split()
    assert set(never[2:]) == {"-"}


def test_summary_names_its_reference():
    cases, reference = paper_like(800)
    stats = statistics(cases, ["upper_alpha_ref_deg"], reference)
    text = render_summary(stats, status_counts(cases), source="flight test")
    assert "Compared with the flight test" in text
    assert "paper" not in text


@pytest.mark.parametrize("n", [0, 1, 2, 30])
def test_summary_text_of_few_cases(n):
    cases, reference = paper_like(n)
    text = render_summary(
        statistics(cases, list(cases.columns[2:]), reference), status_counts(cases)
    )
    assert text.startswith(f"{n} {'case' if n == 1 else 'cases'}, {n} ok\n")
    assert max(map(len, text.splitlines())) <= 118
    assert "nan" not in text.lower()
    assert ("fewer than 741 values" in text) == (n > 0)


def test_summary_text_without_outcomes_or_reference():
    cases, _ = paper_like(800)
    assert render_summary(statistics(cases, []), status_counts(cases)) == "800 cases, 800 ok\n"
    assert "Beside" not in render_summary(
        statistics(cases, ["separation_distance_mm"]), status_counts(cases)
    )


def test_audit():
    """Worst values and cases beyond their bounds, of ok cases only; NaN is beyond every bound."""
    cases = pd.DataFrame(
        {
            "case": [3, 4, 5, 6],
            "status": ["ok", "ok", "ok", "unresolved"],
            "gap": [1e-12, 2e-9, np.nan, 1.0],
            "smallest_pivot": [0.5, 0.1, 0.3, 0.0],
        }
    )
    table = audit(cases, {"gap": 1e-9}, ["gap", "smallest_pivot", "absent"])
    assert list(table.index) == ["gap", "smallest_pivot"]
    assert (table.loc["gap", "beyond"], table.loc["gap", "case"]) == (2, 5)
    assert (
        table.loc["smallest_pivot", "worst"],
        table.loc["smallest_pivot", "case"],
        table.loc["smallest_pivot", "beyond"],
    ) == (0.1, 4, 0)
    bounded = audit(cases, {"smallest_pivot": 0.2}, ["smallest_pivot"])
    assert bounded.loc["smallest_pivot", "beyond"] == 2  # 0.5 and 0.3
    assert "AUDIT FAILED: 2 cases have gap > 1e-09" in render_audit(table)
    passed = audit(cases[:1], {"gap": 1e-9}, ["gap"])
    assert render_audit(passed) == "audit passed; worst of all ok cases: gap 1.0e-12"
    passed.loc["attitude_singular"] = [1.0, 7, np.nan, 0]
    assert "may have jumped (case 7)" in render_audit(passed)


def test_percentiles_lie_between_their_order_statistics():
    """Of 1,000 values the 469th to the 532nd smallest hold the median, and the 941st or so the 95 %
    point; 100 are too few for both ends of the 99 % point."""
    random = np.random.default_rng(9)
    for n, name, low, high in ((1000, "p50", 469, 532), (100, "p99", 97, None)):
        values = random.permutation(np.arange(1.0, n + 1.0))
        cases = {"case": np.arange(n), "status": np.array(["ok"] * n, dtype=object), "x": values}
        row = statistics(cases, ["x"]).loc["x"]
        assert row[f"{name}_low"] == low
        assert (row[f"{name}_high"] == high) if high else np.isnan(row[f"{name}_high"])
        assert row[f"{name}_low"] <= row[name]


def test_yes_or_no_is_a_share():
    """An outcome that is 1 or 0 has no mean and sigma on the screen, but a count and an interval;
    none of 5,000 reads < 6.0e-04."""
    n = 5000
    cases = {"case": np.arange(n), "status": np.array(["ok"] * n, dtype=object)}
    cases |= {"gap_recontact": np.zeros(n), "speed_m_s": np.arange(float(n))}
    text = render_summary(statistics(cases, ["gap_recontact", "speed_m_s"]), {"ok": n})
    assert "gap_recontact: 0 of 5000 ok cases; probability < 6.0e-04 (95 %, one-sided)" in text
    assert "speed_m_s" in text
    cases["gap_recontact"][:190] = 1.0
    text = render_summary(statistics(cases, ["gap_recontact"]), {"ok": n})
    assert (
        "gap_recontact: 190 of 5000 ok cases; probability 0.033 to 0.044 (95 %, two-sided)" in text
    )
