"""Outcomes that a file defines by formulas of other outcomes."""

import copy
import tomllib
from pathlib import Path

import numpy as np
import pytest
from oracles import independent

from sepmc.campaign.campaign import Campaign
from sepmc.scene.campaign_files import shipped_campaigns
from sepmc.scene.messages import SceneError
from sepmc.scene.read import parse_campaign

STORE = tomllib.loads(Path(shipped_campaigns()["store.toml"]).read_text(encoding="utf-8"))
LAG = {
    "name": "lag",
    "formula": "fore_stroke_end_time_s - aft_stroke_end_time_s",
    "unit": "s",
}
RATE = {
    "name": "rate",
    "formula": "max(abs(clear_store_omega_x_deg_s), abs(clear_store_omega_z_deg_s))",
    "unit": "deg_s",
}
RELATIVE = {"name": "relative", "formula": "lag_s / aft_stroke_end_time_s"}
ROOT = {"name": "root", "formula": "sqrt(store_roll_deg)"}


def campaign(*outcomes, **more):
    return Campaign(
        parse_campaign(copy.deepcopy(STORE) | {"outcome": list(outcomes)} | more, "store.toml")
    )


@pytest.fixture(scope="module")
def flown():
    return campaign(LAG, RATE, RELATIVE, ROOT).run(cases=60)


@pytest.mark.slow
def test_rows_are_the_formulas_of_their_columns(flown):
    rows = flown.to_pandas()
    ok = rows[rows["status"] == "ok"]
    lag = ok["fore_stroke_end_time_s"] - ok["aft_stroke_end_time_s"]
    np.testing.assert_array_equal(ok["lag_s"], lag)
    roll, pitch = (ok[f"clear_store_omega_{axis}_deg_s"].abs() for axis in "xz")
    np.testing.assert_allclose(ok["rate_deg_s"], np.maximum(roll, pitch), rtol=1e-15)
    np.testing.assert_allclose(ok["relative"], lag / ok["aft_stroke_end_time_s"], rtol=1e-15)
    np.testing.assert_allclose(ok["root"], np.sqrt(ok["store_roll_deg"]), rtol=1e-15)


@pytest.mark.slow
def test_a_formula_that_is_undefined_fails_its_case(flown):
    """The root of a negative roll angle; its row has no outcomes, and the others keep theirs."""
    rows = flown.to_pandas()
    failed = rows["status"] == "undefined-formula"
    assert 0 < failed.sum() < len(rows)
    assert rows.loc[failed, "store_omega_z_deg_s"].isna().all()
    without = campaign(LAG).run(cases=60).to_pandas()
    assert (without.loc[failed, "store_roll_deg"] < 0.0).all()
    kept = ~failed
    column = "store_roll_deg"
    np.testing.assert_array_equal(rows.loc[kept, column], without.loc[kept, column])


@pytest.mark.slow
def test_formulas_have_errors_statistics_and_requirements(flown):
    assert flown.accuracy.errors["lag_s"] <= 1e-9
    assert flown.accuracy.errors["rate_deg_s"] <= 1e-9
    assert "lag_s" in flown.statistics().index
    judged = campaign(
        LAG,
        requirement=[{"name": "soon", "metric": "lag_s", "at_most": 0.004, "probability": 0.9}],
    ).run(cases=60)
    assert list(judged.requirements()["verdict"]) == ["fail"]


def test_the_nominal_case_agrees_with_the_independent_flight():
    one = campaign(LAG, RATE, RELATIVE)
    expected = independent.simulate(one.nominal().to_dict()).outcomes
    outcomes = one.simulate(one.nominal(), step_s=0.1).attrs["outcomes"]
    for name in ("lag_s", "rate_deg_s", "relative"):
        assert outcomes[name] == pytest.approx(expected[name], rel=1e-9)


def test_a_formula_of_what_did_not_occur_is_missing():
    """The ejectors push no further than 150 mm: the event does not occur, nor its outcomes."""
    one = campaign(LAG, run={"end_time_s": 0.05, "cases": 1})
    frame = one.simulate(one.nominal(), step_s=0.05)
    assert np.isnan(frame.attrs["outcomes"]["lag_s"])
    assert frame.attrs["status"] == "ok"


@pytest.mark.parametrize(
    ("outcome", "message"),
    [
        ({"name": "a", "formula": "nothing + 1"}, r"outcome\.a\.formula = 'nothing': no such"),
        ({"name": "a", "formula": "b_s", "unit": "s"}, "no such outcome, or none before this"),
        ({"name": "a", "formula": "1 + 2"}, "must name an outcome"),
        ({"name": "a", "formula": "lag_s +"}, r"outcome\.a\.formula = 'lag_s \+': is no formula"),
        ({"name": "a", "formula": "__import__('os')"}, r"outcome\.a\.formula"),
        ({"name": "a", "formula": "lag_s.real"}, r"outcome\.a\.formula"),
        ({"name": "a", "formula": "lag_s", "unit": "furlong"}, r"outcome\.a\.unit = 'furlong'"),
        ({"name": "store_pitch", "formula": "lag_s", "unit": "deg"}, "two outcomes called"),
        ({"name": "1a", "formula": "lag_s"}, "a name is a letter"),
        ({"name": "lag", "formula": "lag_s"}, "the name is used twice"),
        ({"name": "status", "formula": "lag_s"}, r"outcome\.status\.name = 'status': its column"),
        ({"name": "case", "formula": "lag_s"}, "its column would be case"),
        ({"name": "jammed", "formula": "lag_s"}, "its column would be jammed"),
        ({"name": "pi", "formula": "lag_s"}, "its column would be pi"),
        ({"name": "in_a", "formula": "lag_s", "unit": "m"}, "its column would be in_a_m"),
    ],
)
def test_wrong_formulas_are_refused(outcome, message):
    after = {"name": "b", "formula": "lag_s", "unit": "s"}
    with pytest.raises(SceneError, match=message):
        campaign(LAG, outcome, after)
