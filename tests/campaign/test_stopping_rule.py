"""Campaigns that end as soon as a statistic is known: interrupted, counted, with rare values."""

import json

import pandas as pd
import pytest
from click.testing import CliRunner
from oracles.random_scenes.interpreted import run_interpreted
from scipy.special import stdtrit
from small_scenes import SPRUNG

import sepmc
from sepmc.campaign.execution import runner
from sepmc.campaign.store.manifests import read_manifest
from sepmc.cli import figures
from sepmc.cli.app import main
from sepmc.report import convergence_figures
from sepmc.scene.messages import InputError, RunWarning

CASES = 160
LOOKS = 5  # at 16, 32, 64, 128 and 160 cases
# two failures that correlate, each of 40 %
PAIR = """
"spring.push.factor" = { discrete = [1.0, 0.5], weights = [0.6, 0.4] }
"initial.pitch_deg" = { discrete = [0.0, 1.0], weights = [0.6, 0.4] }
[[correlation]]
parameters = ["spring.push.factor", "initial.pitch_deg"]
coefficient = 0.9
"""


class Interrupted(Exception):
    pass


def stopping(most):
    def tell(done, total, failures):
        if done >= most:
            raise Interrupted

    return tell


@pytest.fixture(autouse=True)
def _plainly(monkeypatch):
    """Small first looks and pieces, and what is counted is written after each."""
    monkeypatch.setattr("sepmc.analysis.stopping._FIRST_LOOK_OF_MOMENTS", 16)
    monkeypatch.setattr("sepmc.analysis.stopping._FIRST_LOOK", 16)
    for name, value in (("_SAVE_S", 0.0), ("_SHARD_S", 0.0), ("_FIRST", 8), ("_CALL_S", 1e-9)):
        monkeypatch.setattr(runner, name, value)
    with run_interpreted():
        yield


@pytest.fixture
def written(tmp_path):
    """Write a campaign file of the sprung pair with more laws."""

    def write(more):
        path = tmp_path / "sprung.toml"
        path.write_text(SPRUNG + more, encoding="utf-8")
        return path

    return write


def files_of(folder):
    """What a run holds, but for when and in which parts it was flown."""
    apart = ("manifest.json", "checksums.jsonl")
    return {
        str(path.relative_to(folder)): path.read_bytes()
        for path in folder.rglob("*")
        if path.is_file() and path.name not in apart and path.parent.name != "cases"
    }


@pytest.mark.parametrize("orders", [{}, {"stats_only": True}, {"keep": "failed,every:50"}])
@pytest.mark.parametrize("again", [True, False], ids=["asked again", "as it began"])
@pytest.mark.slow
def test_it_goes_on_as_if_it_had_not_stopped(written, tmp_path, orders, again):
    """Interrupted before the first look, between two, and after one: the same end, the same
    statement, the same bits, whether the rule is given again or was noted."""
    campaign, whole, folder = sepmc.load(written("")), tmp_path / "whole", tmp_path / "run"
    error = campaign.run(64, stats_only=True).statistics()["mean_se"]["separation_speed_m_s"]
    until = f"separation_speed_m_s:{1.01 * error * stdtrit(63, 1.0 - 0.025 / LOOKS)}"
    left_alone = campaign.run(CASES, out=whole, until=until, **orders)
    end = left_alone.numbers.count
    assert end == 64
    for most in (8, 16, 24):
        rule = until if again or most == 8 else None
        with pytest.raises(Interrupted):
            campaign.run(
                CASES, out=folder, until=rule, resume=True, progress=stopping(most), **orders
            )
        assert not read_manifest(folder)["complete"]
    result = campaign.run(CASES, out=folder, until=until if again else None, resume=True)
    assert result.numbers.count == end
    assert 0 < result.resumed < end
    manifest = [read_manifest(place) for place in (whole, folder)]
    for key in ("until", "stopping_rule", "cases", "complete", "rarely_drawn", "notes"):
        assert manifest[0][key] == manifest[1][key], key
    pd.testing.assert_frame_equal(result.statistics(), left_alone.statistics(), check_exact=True)
    if not orders:
        pd.testing.assert_frame_equal(result.to_pandas(), left_alone.to_pandas(), check_exact=True)
    assert files_of(folder) == files_of(whole)
    # told once more, it says the same; a narrower rule goes on
    if not (again and orders.get("stats_only")):
        return
    once_more = campaign.run(CASES, out=folder, until=until, resume=True)
    assert (once_more.numbers.count, once_more.resumed) == (end, end)
    narrower = campaign.run(CASES, out=folder, until="separation_speed_m_s:0.01%", resume=True)
    assert narrower.numbers.count == CASES
    assert any("NOT MET" in note for note in narrower.notes)
    at_once = campaign.run(CASES, **orders)
    pd.testing.assert_frame_equal(narrower.statistics(), at_once.statistics(), check_exact=True)


def test_it_does_not_look_at_more_cases_than_a_look_has(written, tmp_path):
    """Rows that are flown already, beyond the first looks: it looks next where it would have."""
    campaign, folder = sepmc.load(written("")), tmp_path / "run"
    campaign.run(20, out=folder)
    rule = "separation_speed_m_s.p50:50%"
    result = campaign.run(CASES, out=folder, until=rule, resume=True)
    assert result.numbers.count == 32
    gone = sorted((folder / "cases").glob("*.parquet"))[0]
    gone.unlink()
    again = campaign.run(CASES, out=folder, until=rule, resume=True)
    assert again.to_pandas().equals(campaign.run(again.numbers.count).to_pandas())


def test_a_pair_that_correlates_must_have_occurred(written, tmp_path):
    """Both failures together have 33 %: ten of them are expected after 31 cases, each by itself
    after 25; both ways of keeping cases stop at the same."""
    campaign = sepmc.load(written(PAIR))
    rule = "separation_speed_m_s:50%"
    rows = campaign.run(CASES, out=tmp_path / "run", until=rule)
    counted = campaign.run(CASES, until=rule, stats_only=True)
    assert rows.numbers.count == counted.numbers.count
    table = rows.to_pandas()
    both = (table["in_spring_push_factor"] == 0.5) & (table["in_initial_pitch_deg"] == 1.0)
    assert both.sum() >= 10
    with pytest.raises(InputError, match=r"with initial\.pitch_deg = 1 .* occurs 10 times"):
        campaign.run(28, until=rule)


def test_workers_are_refused_before_anything_is_flown(written, tmp_path):
    called = CliRunner().invoke(
        main,
        [
            *("campaign", str(written("")), "--until", "separation_speed_m_s:1%"),
            *("--workers", "2", "--out", str(tmp_path / "run"), "--no-plots"),
        ],
    )
    assert called.exit_code == 2
    assert "cannot be combined with workers" in called.stderr
    assert not (tmp_path / "run" / "cases").exists()


def test_values_that_were_rarely_drawn_are_told_beside_statistics(written, tmp_path, monkeypatch):
    """In the terminal, in statistics.json, and on the figure of convergence."""
    titles = []
    monkeypatch.setattr(convergence_figures, "set_title", lambda figure, text: titles.append(text))
    rare = '"spring.push.factor" = { discrete = [1.0, 0.5], weights = [0.998, 0.002] }\n'
    called = CliRunner().invoke(
        main,
        [
            *("campaign", str(written(rare)), "--cases", "60", "--no-plots"),
            *("--out", str(tmp_path / "run")),
        ],
    )
    assert called.exit_code == 0, called.output
    message = "spring.push.factor = 0.5 (probability 0.002) occurred in 0 of 60 cases"
    assert message in " ".join(called.stderr.split())
    (reported,) = json.loads((tmp_path / "run" / "statistics.json").read_text())["rarely_drawn"]
    assert message in reported
    figures.draw_fractions(
        tmp_path / "run",
        sepmc.load(tmp_path / "run"),
        (),
        ["separation_speed_m_s"],
        tmp_path,
        ".png",
        {},
    )
    assert any(title.startswith("Convergence of") and message in title for title in titles)


def test_a_run_without_rare_values_tells_of_none(written, tmp_path):
    campaign = sepmc.load(written(""))
    with pytest.warns(RunWarning, match="NOT MET"):
        campaign.run(40, out=tmp_path / "run", until="separation_speed_m_s.sigma:1e-9")
    assert read_manifest(tmp_path / "run")["rarely_drawn"] == []
