"""Python's door: tables whose rows are found by case number, and slips that get a sentence."""

import pandas as pd
import pytest

import sepmc

QUICK = {
    "solver.step_s": 0.1,
    "run.history_step_s": 0.0,
    "dispersion": {"body.upper.mass_kg": {"uniform": 20.0}},
}


@pytest.fixture(scope="module")
def campaign():
    return sepmc.load("table2.toml", QUICK)


@pytest.fixture(scope="module")
def result(campaign):
    return campaign.run(cases="100:140")


# tables by case number


def test_the_row_of_a_table_is_that_case(result, campaign):
    """README's way to the worst case, of a run whose first case is not 0."""
    table = result.to_pandas()
    assert table.index.tolist() == table["case"].tolist() == list(range(100, 140))
    worst = table["separation_distance_mm"].idxmin()
    row = table.loc[worst]
    assert row["separation_distance_mm"] == table["separation_distance_mm"].min()
    assert result.case(worst).inputs == {name: row[name] for name in ("in_body_upper_mass_kg",)}


def test_pandas_knows_what_case_means(result):
    """It refuses a name that is both of the index and of a column."""
    table = result.to_pandas()
    assert len(table.groupby("case").size()) == 40
    assert table.sort_values("case", ascending=False).index[0] == 139
    assert table.set_index("case").index.name == "case"
    merged = table.merge(table[["case", "separation_speed_m_s"]], on="case", suffixes=("", "_2"))
    assert (merged["separation_speed_m_s"] == merged["separation_speed_m_s_2"]).all()


def test_tables_beside_each_other_join_by_case(result, campaign):
    """Arithmetic and joins of pandas go by the index: no row meets another case's."""
    other = campaign.run(cases=[139, 120, 250]).to_pandas()
    apart = (result.to_pandas()["separation_speed_m_s"] - other["separation_speed_m_s"]).dropna()
    assert apart.to_dict() == {120: 0.0, 139: 0.0}


def test_rows_of_a_folder_are_indexed_too(campaign, tmp_path):
    flown = campaign.run(cases="7:12,30", out=tmp_path / "run").to_pandas()
    assert flown.index.tolist() == [7, 8, 9, 10, 11, 30]
    pd.testing.assert_frame_equal(
        flown.drop(columns=["case", "status"]),
        campaign.run(cases="7:12,30").to_pandas().drop(columns=["case", "status"]),
    )
    read = pd.read_parquet(tmp_path / "run" / "cases").set_index("case")  # as README has it
    assert read["separation_distance_mm"].idxmin() == flown["separation_distance_mm"].idxmin()


# cases that were not flown


@pytest.mark.parametrize("number", [0, 99, 140, 5000])
def test_a_case_that_was_not_flown_is_refused(result, number):
    with pytest.raises(ValueError, match=f"case = {number}: must be one of those flown, 100:140"):
        result.case(number)


@pytest.mark.parametrize("stats_only", [False, True])
def test_nor_one_that_a_stop_left_out(campaign, stats_only):
    """A run that ends as too many cases fail has not flown all that it was asked for."""
    failing = campaign.with_settings({"run.end_time_s": 0.06, "run.chunk": 8})  # before a release
    result = failing.run(cases="10:100", max_failures=3, stats_only=stats_only)
    assert result.stopped
    flown = sum(result.status_counts.values())
    assert flown < 90
    assert result.case(10 + flown - 1).number == 10 + flown - 1
    with pytest.raises(ValueError, match=f"case = {10 + flown}: must be one of those flown"):
        result.case(10 + flown)
