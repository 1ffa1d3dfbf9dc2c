"""Statistics of the cases in which something holds: the same as those of these rows alone."""

import json

import numpy as np
import pandas as pd
import pytest
from click.testing import CliRunner
from oracles.random_scenes.interpreted import run_interpreted

import sepmc
from sepmc.analysis.row_filter import matching_rows
from sepmc.analysis.statistics import statistics
from sepmc.cli.app import main
from sepmc.scene.messages import InputError, nearest

ROWS = {"case": np.arange(5), "in_a": np.array([0.0, 1.0, 1.0, 0.0, np.nan]), "b": np.arange(5.0)}
NAMES = {"in_a": "in_a", "joint.a.fails": "in_a", "b": "b"}


@pytest.mark.parametrize(
    ("terms", "result"),
    [
        (["in_a=1"], [1, 2]),
        (["joint.a.fails = 0"], [0, 3]),
        (["joint.a.fails!=1", "b<=3"], [0, 3]),
        (["b>1", "b<4"], [2, 3]),
        (["b>=4"], [4]),
        (["b>9"], []),
        (["b>3 or in_a=1"], [1, 2, 4]),
        (["b>3  or  in_a=1 or b<1", "b!=4"], [0, 1, 2]),
        (["*a*=1"], [1, 2]),
        (["[bi]*<1"], [0, 3]),
        ([], [0, 1, 2, 3, 4]),
    ],
)
def test_terms(terms, result):
    """All terms must hold, or one of several with or between them, of any name that matches; what
    is no number meets none but !=."""
    assert np.flatnonzero(matching_rows(ROWS, NAMES, terms)).tolist() == result


@pytest.mark.parametrize(
    ("term", "message"),
    [
        ("a", "must be NAME=VALUE"),
        ("in_a=one", "'one' must be a number"),
        ("in_a=1 or b", "several with 'or' between them"),
        ("joint.*.late=1", "no such input or outcome"),
        ("in_b=1", "no such input or outcome; did you mean"),
    ],
)
def test_terms_that_cannot_be(term, message):
    """Errors of terms are reported."""
    with pytest.raises(InputError, match=message):
        matching_rows(ROWS, NAMES, [term])


def test_filter_by_an_input(tmp_path):
    """Given an input, by its key in the file, statistics are those of these rows alone, in Python
    and on the screen, with their verdicts; files of the run stay as they are."""
    required = {"name": "slow", "metric": "separation_speed_m_s", "at_most": 0.5}
    folder = tmp_path / "run"
    result = sepmc.load("table2.toml", {"requirement": [required]}).run(60, out=folder)
    rows = result.to_pandas()
    some = rows[rows["in_initial_alpha_deg"] > 5.0]
    assert 5 < len(some) < 55
    expected = statistics(some, result.outcomes)
    data = result.statistics("initial.alpha_deg>5")
    pd.testing.assert_frame_equal(data[list(expected)], expected)
    before = sorted(folder.iterdir())
    words = ["stats", str(folder), "--where", "initial.alpha_deg>5", "--columns", "upper_pitch*"]
    called = CliRunner().invoke(main, words)
    assert called.exit_code == 0, called.output
    violated = int((some["separation_speed_m_s"] > 0.5).sum())
    assert f"initial.alpha_deg>5: satisfied by {len(some)} of 60 cases" in called.output
    assert f"{violated} of {len(some)} cases violate it" in called.output
    assert "in 99.73 % of such cases" in " ".join(called.output.split())
    assert "of all cases" not in " ".join(called.output.split())
    assert sorted(folder.iterdir()) == before
    called = CliRunner().invoke(main, [*words, "--json"])
    data = json.loads(called.stdout)
    assert data["where"] == ["initial.alpha_deg>5"]
    assert data["cases"]["ok"] == len(some)
    assert data["requirements"][0]["violations"] == violated
    assert list(data["outcomes"]) == ["upper_pitch_deg"]
    assert data["outcomes"]["upper_pitch_deg"]["mean"] == expected.loc["upper_pitch_deg", "mean"]
    called = CliRunner().invoke(main, ["stats", str(folder), "--where", "upper_pitch_deg>0"])
    assert "selected by outcomes (upper_pitch_deg)" in called.output
    assert "selected by outcomes" not in CliRunner().invoke(main, words).output
    nobody = CliRunner().invoke(main, ["stats", str(folder), "--where", "case<0", "--json"])
    assert nobody.exit_code == 2
    assert "case<0: satisfied by none of 60 cases" in nobody.output


def test_filter_by_a_failure_of_all_cases(tmp_path):
    """There are no statistics of cases that all ended otherwise; there are verdicts on them."""
    required = {"name": "parts", "metric": "never-released", "probability": 0.5}
    fails = {"dispersion.joint.pins.fails": {"discrete": [0, 1], "weights": [0.7, 0.3]}}
    with run_interpreted(cases=4):
        sepmc.load("table2", {"requirement": [required], **fails}).run(20, out=tmp_path / "run")
    words = ["stats", str(tmp_path / "run"), "--where", "joint.pins.fails=1"]
    called = CliRunner().invoke(main, words)
    assert called.exit_code == 0, called.output
    assert "no statistics, as none of these cases completed" in called.output
    assert "FAIL        parts: never-released does not occur" in called.output
    output = json.loads(CliRunner().invoke(main, [*words, "--json"]).stdout)
    assert output["requirements"][0]["violations"] == output["cases"]["never-released"] > 0


def test_words_that_a_message_lists():
    """All of few; of many those that have a part of the word, or the first of them."""
    few, many = ["mass", "cg"], [f"{part}_{k}" for part in ("spring", "joint") for k in range(20)]
    assert nearest("thrust", few) == "known here: mass, cg"
    assert nearest("mas", few) == "did you mean 'mass'?"
    reported = nearest("the.joint.fails", many)
    assert reported.startswith("known here: joint_0, joint_1")
    assert reported.endswith("joint_19 and 20 more")
    assert "spring" not in reported
    assert nearest("xyz", many).endswith("joint_3 and 16 more")


def test_suggestions_have_units(tmp_path):
    """In place of a refused unit the key of the file, and of a path without one it is told which
    unit its number is taken in; a key with its unit needs no word."""
    laws = {"body.upper.cg_mm.y": {"uniform": 5.0}}
    required = [
        {"name": name, "metric": "separation_speed_m_s", "at_least": low}
        for name, low in (("slow", 0.1), ("slower", 0.05))
    ]
    with run_interpreted(cases=4):
        campaign = sepmc.load("table2", {"dispersion": laws, "requirement": required})
        campaign.run(12, out=tmp_path / "run")
    refused = CliRunner().invoke(
        main, ["stats", str(tmp_path / "run"), "--where", "body.upper.cg_in.y>-0.1"]
    )
    assert refused.exit_code == 2
    assert "did you mean 'body.upper.cg_mm.y'?" in refused.output
    bare = CliRunner().invoke(
        main, ["stats", str(tmp_path / "run"), "--where", "body.upper.cg.y>-50"]
    )
    assert "body.upper.cg.y is taken in mm, as in_body_upper_cg_y_mm is" in bare.output
    words = ["stats", str(tmp_path / "run"), "--where", "body.upper.cg_mm.y>-50"]
    full = " ".join(CliRunner().invoke(main, words).output.split())
    assert "is taken in" not in full
    # what such cases lack stands once, not with each requirement
    assert full.count("more such cases") == 1
    assert "2 requirements not shown: " in full
    assert "more cases without a violation" not in full
