"""Python's door: tables whose rows are found by case number, and slips that get a sentence."""

import pandas as pd
import pytest

import sepmc
from sepmc.campaign.store.folders import StoreError

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
    with pytest.raises(ValueError, match=f"case = {number}: must be one of those run, 100:140"):
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
    with pytest.raises(ValueError, match=f"case = {10 + flown}: must be one of those run"):
        result.case(10 + flown)


# arguments that cannot be meant

TEXT = "must be text or a path"


@pytest.mark.parametrize("file", [{"body": {}}, {}, None, 3, b"table2", ["table2"], True])
def test_what_is_no_file_is_no_campaign(file):
    with pytest.raises(sepmc.SceneError, match=f"must be the name of a file|{TEXT}"):
        sepmc.load(file)


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        ({"threads": 1.5}, "threads = 1.5: must be a whole number"),
        ({"threads": "2"}, "threads = '2': must be a whole number"),
        ({"threads": float("nan")}, "threads = nan: must be a whole number"),
        ({"cases": [1, [2]]}, "cases = .2.: must be a whole number"),
        ({"cases": {"first": 1}}, "cases = {'first': 1}: must be a whole number"),
        ({"cases": {1.5}}, "cases = 1.5: must be a whole number"),
        ({"cases": set()}, "cases = ..: must be a number of cases"),
        ({"until": 3}, "until = 3: must be text"),
        ({"keep": 3, "out": "nowhere"}, "keep = 3: must be text"),
        ({"keep": "all", "keep_columns": 3, "out": "nowhere"}, "keep_columns = 3: must be text"),
        ({"out": 3}, f"path = 3: {TEXT}"),
    ],
)
def test_runs_that_cannot_be_meant(campaign, arguments, message):
    with pytest.raises(ValueError, match=message):
        campaign.run(**{"cases": 2, **arguments})


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        ((0, -3), "count = -3: must be >= 0"),
        ((-1, 3), "first = -1: must be >= 0"),
        ((0, 2.5), "count = 2.5: must be a whole number"),
        (("a", 1), "first = 'a': must be a whole number"),
        ((999_999_999, 2), "count = 2: must be >= 0 and <= 1"),
        ((0, 3, None, 0), "total = 0: must be >= 1"),
    ],
)
def test_draws_of_cases_that_do_not_exist(campaign, arguments, message):
    with pytest.raises(ValueError, match=message):
        campaign.sample(*arguments)


@pytest.mark.parametrize("sampler", ["lhs", "saltelli"])
def test_draws_beyond_a_design(campaign, sampler):
    """A design has no other cases than its own."""
    design = campaign.with_settings({"run.sampler": sampler, "run.cases": 12})
    assert len(design.sample(10, 2)) == 2
    with pytest.raises(ValueError, match="count = 3: must be >= 0 and <= 2"):
        design.sample(10, 3)


def test_history_rows_need_a_number(campaign):
    for step in ("x", None, True):
        with pytest.raises(ValueError, match=r"step_s = .*: must be a number"):
            campaign.simulate(step_s=step)


# the same number twice


@pytest.mark.parametrize(
    ("settings", "message"),
    [
        (
            {"body.upper.mass_kg": 460.0, "body.upper.mass_g": 3.0},
            "body.upper.mass_g = 3.0: is set twice, also as 'body.upper.mass_kg'",
        ),
        (
            {"body.upper.cg_m.x": 1.0, "body.upper.cg_mm.x": 3.0},
            "body.upper.cg_mm.x = 3.0: is set twice",
        ),
        (
            {"body.upper.cg_m": [1.0, 0.0, 0.0], "body.upper.cg_mm": [1.0, 0.0, 0.0]},
            "is set twice, also as 'body.upper.cg_m'",
        ),
        (
            {
                "dispersion.body.upper.mass_kg": {"uniform": 1.0},
                "dispersion.body.upper.mass_g": {"uniform": 1.0},
            },
            "dispersion.body.upper.mass_g = .*: is set twice",
        ),
        (
            {"motor.retro.thrust_N": 1.0, "motor.retro.thrust_kN": 2.0},
            "motor.retro.thrust_kN = 2.0: is set twice",
        ),
        (
            {"body.upper.cg_m.x": 9.0, "body.upper.cg_m": [1.0, 2.0, 3.0]},
            "body.upper.cg_m = .*: would undo 'body.upper.cg_m.x', which is set before it",
        ),
        ({3: 4}, "settings = 3: keys must be text"),
    ],
)
def test_the_same_number_twice(campaign, settings, message):
    with pytest.raises(sepmc.SceneError, match=message):
        campaign.with_settings(settings)
    with pytest.raises(sepmc.SceneError, match=message):
        sepmc.load("table2", settings)


def test_other_numbers_of_one_name():
    """Components in units of their own, a part after its whole, and two bodies are no
    repetition."""
    changed = sepmc.load("table2", {"body.upper.cg_m.x": 1.0, "body.upper.cg_mm.y": 3.0})
    assert changed.scene.body["upper"].cg[:2] == (1.0, 0.003)
    part = {"body.upper.cg_m": [1.0, 2.0, 3.0], "body.upper.cg_m.x": 9.0}
    assert sepmc.load("table2", part).scene.body["upper"].cg == (9.0, 2.0, 3.0)
    both = {"body.upper.mass_kg": 460.0, "body.lower.mass_g": 4e5}
    assert sepmc.load("table2", both).scene.body["lower"].mass == 400.0
    again = sepmc.load("table2").with_settings({"body.upper.mass_kg": 460.0})
    assert again.with_settings({"body.upper.mass_g": 3e5}).scene.body["upper"].mass == 300.0


# which cases


def test_a_set_of_case_numbers(campaign):
    """In any order, from what gives numbers one by one, too; rows are sorted."""
    expected = campaign.run(cases=[2, 5, 9]).to_pandas()
    several = (
        {9, 2, 5},
        frozenset({5, 9, 2}),
        (x for x in (5, 2, 9)),
        dict.fromkeys([5, 9, 2]).keys(),
    )
    for numbers in several:
        pd.testing.assert_frame_equal(campaign.run(cases=numbers).to_pandas(), expected)


def test_a_filter_that_matches_nothing_warns(result):
    with pytest.warns(sepmc.RunWarning, match="mass_kg<0: satisfied by none of 40 cases") as caught:
        outcome = result.statistics("body.upper.mass_kg<0")
    assert (outcome["n"] == 0).all()
    assert caught[0].filename == __file__


def test_a_filter_that_matches_failures_only_warns(campaign):
    never = campaign.with_settings({"run.end_time_s": 0.06}).run(cases=4)
    with pytest.warns(sepmc.RunWarning, match="4 of 4 cases; none of them has the status ok"):
        never.statistics("case>=0")


def test_a_case_of_another_campaign(campaign):
    other = sepmc.load("spring-pushers").case(0)
    with pytest.raises(ValueError, match=r"case = <Case 0: .*must be a case of this campaign"):
        campaign.simulate(other)


def test_columns_of_a_result_are_not_written_to(result):
    """Statistics are of the same arrays; a data frame is a copy."""
    before = result.statistics()
    with pytest.raises(ValueError, match="read-only"):
        result.table["separation_speed_m_s"][:] = 0.0
    table = result.to_pandas()
    table["separation_speed_m_s"] = 0.0
    assert result.statistics().equals(before)


def test_a_resumed_run_keeps_its_cases(campaign, tmp_path):
    """As the repair that is offered says: the cases of the run, not those of its file."""
    campaign.run(cases="7:19", out=tmp_path / "run").to_pandas()
    again = sepmc.load(tmp_path / "run").run(out=tmp_path / "run", resume=True)
    assert (again.resumed, list(again.to_pandas().index)) == (12, list(range(7, 19)))
    with pytest.raises(StoreError, match=r"contains|fewer"):
        sepmc.load(tmp_path / "run").run(cases=9, out=tmp_path / "run", resume=True)


def test_histories_are_of_the_run_that_was_asked(tmp_path):
    """Not of what is in its folder now; of a run that has grown, those of its own cases."""
    campaign, out = (
        sepmc.load("table2.toml", {**QUICK, "run.history_step_s": 0.1}),
        tmp_path / "run",
    )
    first = campaign.run(cases=4, seed=1, out=out)
    before = first.histories()
    grown = campaign.run(cases=6, seed=1, out=out, resume=True)
    assert first.histories().equals(before)
    assert grown.histories()["case"].nunique() == 6
    campaign.run(cases=4, seed=2, out=out, overwrite=True)
    with pytest.raises(StoreError):
        first.histories()
