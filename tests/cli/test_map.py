"""`sepmc map` judges every design as a run of it does, and refuses what it cannot judge."""

import json
from pathlib import Path

import numpy as np
import pandas as pd
import pyarrow.parquet as pq
import pytest
from click.testing import CliRunner
from support.sizing_problem import END_S
from support.sizing_problem import campaign as pusher

import sepmc
from sepmc.analysis.proportions import binomial_interval, required_cases
from sepmc.campaign.campaign import Campaign
from sepmc.campaign.design_map import DesignMap, MapAxis, map_designs, parse_axis
from sepmc.cli.app import main
from sepmc.report import map_figure as map_figures
from sepmc.report.map_figure import map_figure
from sepmc.scene.read import parse_campaign

X, Y = "motor.retro.thrust_N", "body.upper.mass_kg"
ITEM = {
    "name": "speed",
    "metric": "separation_speed_m_s",
    "at_least": 0.5,
    "probability": 0.9,
    "confidence": 0.9,
}


def campaign(**requirement):
    """Table 2 with a requirement on the separation speed."""
    tree = sepmc.load("table2", {"run.history_step_s": 0.0}).file.tree
    return Campaign(parse_campaign(tree | {"requirement": [ITEM | requirement]}, "table2"))


@pytest.fixture
def file(tmp_path, monkeypatch):
    """File of that campaign, in the working folder."""
    monkeypatch.chdir(tmp_path)
    path = tmp_path / "table2.toml"
    path.write_text(campaign().file.toml, encoding="utf-8")
    return path


def call(*words):
    """Result of a command."""
    return CliRunner().invoke(main, list(map(str, words)))


def test_cells_have_the_verdicts_of_runs():
    axes = [MapAxis(X, 400.0, 600.0, 5), MapAxis(Y, 440.0, 480.0, 3)]
    designs = map_designs(campaign(), axes, cases=60, seed=4)
    assert len(designs.table) == 15
    assert set(designs.table["speed"]) == {"pass", "fail", "not shown"}
    for row in (0, 4, 7, 14):
        one = designs.table.iloc[row]
        run = campaign().with_settings({X: one[X], Y: one[Y]}).run(cases=60, seed=4)
        verdict = run.requirements().loc["speed"]
        assert one["speed"] == verdict["verdict"]
        assert one["speed_violations"] == verdict["violations"]
        low, high = binomial_interval(int(verdict["violations"]), 60)
        assert (one["speed_low"], one["speed_high"]) == (low, high)
    assert (designs.grid(X)[1] == axes[0].values).all()
    assert (designs.grid(Y)[:, 2] == axes[1].values).all()


def test_open_cells_get_more_cases():
    """They are judged as runs of these cases are, at the confidence for all looks."""
    axes = [MapAxis(X, 400.0, 600.0, 9)]
    designs = map_designs(campaign(), axes, cases=40, seed=4, max_cases=150)
    assert designs.looks == (40, 80, 150)
    table = designs.table
    assert set(table["cases"]) == {40, 80, 150}
    assert (table.loc[table["cases"] < 150, "speed"] != "not shown").all()
    assert (table[X] == axes[0].values).all()
    raised = {"requirement.speed.confidence": 1.0 - 0.1 / 3}
    for count in (40, 80, 150):
        one = table[table["cases"] == count].iloc[0]
        run = campaign().with_settings({X: one[X]} | raised).run(cases=count, seed=4)
        verdict = run.requirements().loc["speed"]
        assert one["speed"] == verdict["verdict"]
        assert one["speed_violations"] == verdict["violations"]
        interval = binomial_interval(int(verdict["violations"]), count, 1.0 - 0.05 / 3)
        assert (one["speed_low"], one["speed_high"]) == interval


def test_map_writes_a_table_and_a_figure(file):
    words = ["map", file, "--x", f"{X}=400:600:4", "--cases", 40]
    done = call(*words)
    assert done.exit_code == 0, done.output
    assert "4 designs, 40 cases each" in done.output
    table = pd.read_parquet("table2-map.parquet")
    assert table[X].tolist() == np.linspace(400.0, 600.0, 4).tolist()
    assert (file.parent / "table2-map-speed.png").stat().st_size > 10_000
    again = call(*words)
    assert again.exit_code == 2
    assert "--overwrite" in again.output
    (file.parent / "table2-map.parquet").unlink()
    assert "table2-map-speed.png" in call(*words).output  # is not replaced either
    assert call(*words, "--overwrite", "--quiet").output == ""
    axes = f'[map]\nx = "{X}=400:600:3"\ny = "{Y}=440:480:2"\ncases = 40\n'
    file.write_text(file.read_text() + axes, encoding="utf-8")
    done = call("map", file, "--out", "m.csv")
    assert done.exit_code == 0, done.output
    assert "6 designs, 40 cases each" in done.output
    assert len(pd.read_csv("m.csv")) == 6
    assert (file.parent / "m-speed.png").exists()


def test_options_replace_the_axes_of_the_file(file):
    """--y alone replaces the second axis, --x both."""
    axes = f'[map]\nx = "{X}=400:600:3"\ny = "{Y}=440:480:2"\ncases = 40\n'
    file.write_text(file.read_text() + axes, encoding="utf-8")
    words = ["map", file, "--no-plots", "--overwrite", "--cases", 5]
    assert "12 designs, 5 cases each" in call(*words, "--y", f"{Y}=440:480:4").output
    assert "2 designs, 5 cases each" in call(*words, "--x", f"{X}=400:600:2").output


def test_a_map_without_axes_is_refused(file):
    for words in ([], ["--y", f"{Y}=440:480:4"]):
        assert "has no [map]: give --x" in call("map", file, *words).output


def test_too_few_cases_are_named(file):
    needed = required_cases(0, ITEM["probability"], ITEM["confidence"])
    words = ["map", file, "--x", f"{X}=400:600:2", "--no-plots"]
    assert f"--cases {needed}" in call(*words, "--cases", needed - 1).output
    assert "--cases" not in call(*words, "--cases", needed, "--overwrite").output
    more = [*words, "--overwrite", "--cases", 5, "--max-cases", 20]
    needed = required_cases(0, ITEM["probability"], 1.0 - (1.0 - ITEM["confidence"]) / 3)
    assert f"20 cases cannot show it; give at least --max-cases {needed}" in call(*more).output


def test_cases_of_designs_that_all_looked_again():
    """The fewest and the most cases that a design has, not those of the first look."""
    for cases, text in (([40, 10], "10 to 40 cases each"), ([40, 40], "40 cases each")):
        designs = DesignMap((), pd.DataFrame({"cases": cases}), (10, 20, 40), 1, {})
        assert designs.cases_text == text


@pytest.mark.parametrize(
    ("words", "message"),
    [
        (["--x", "thrust"], "KEY=LOW:HIGH:COUNT"),
        (["--x", f"{X}=400:600"], "KEY=LOW:HIGH:COUNT"),
        (["--x", f"{X}=a:600:3"], "KEY=LOW:HIGH:COUNT"),
        (["--x", f"{X}=600:400:3"], "LOW below HIGH"),
        (["--x", f"{X}=400:nan:3"], "LOW below HIGH"),
        (["--x", f"{X}=400:600:1"], "2 to 1000"),
        (["--x", f"{X}=400:600:2.5"], "KEY=LOW:HIGH:COUNT"),
        (["--x", "motor.retro.thrust=400:600:3"], "unit"),
        (["--x", f"{X}=400:600:3", "--y", f"{X}=300:500:3"], "both axes"),
        (
            ["--x", f"{X}=400:600:3", "--max-cases", "9"],
            "max_cases = 9: must be at least",
        ),
        (["--x", f"{X}=400:600:3", "--out", "map.png"], ".csv, .parquet"),
        (["--x", f"{X}=400:600:3", "--set", "run.sampler=sobol"], "random"),
    ],
)
def test_bad_maps_are_refused(file, words, message):
    done = call("map", file, *words, "--cases", 10)
    assert done.exit_code == 2
    assert message in done.output
    assert "Traceback" not in done.output
    assert not list(file.parent.glob("*map*"))


def test_a_map_needs_a_requirement():
    with pytest.raises(sepmc.InputError, match="requirement"):
        map_designs(sepmc.load("table2"), [parse_axis(f"{X}=1:2:3", "--x")], cases=5)


def test_figure_marks_the_nominal_only_inside(tmp_path):
    axes = [MapAxis(X, 400.0, 600.0, 3), MapAxis(Y, 440.0, 480.0, 3)]
    designs, item = map_designs(campaign(), axes, cases=30), campaign().file.requirements[0]
    images = [
        map_figure(designs, item, "speed", nominal, "table2", tmp_path / f"{k}.png").read_bytes()
        for k, nominal in enumerate([(500.0, 458.0), (None, 458.0), (700.0, 458.0)])
    ]
    assert images[0] != images[1] == images[2]


def test_designs_open_by_cases_without_the_outcome_are_told_apart(tmp_path, monkeypatch):
    """Unknown cases refute nothing, as in a run; the text, the figure and a mask say that they are
    why a design is open. Where no case has the outcome, too."""
    monkeypatch.chdir(tmp_path)
    item = {"name": "soon", "metric": "pusher_stroke_end_time_s", "at_most": 1.0}
    one = pusher(item | {"probability": 0.9, "confidence": 0.9})
    Path("p.toml").write_text(one.file.toml, encoding="utf-8")
    axis = "spring.pusher.force_N=1000:5000:3"
    words = ["map", "p.toml", "--x", axis, "--cases", 60, "--set", f"run.end_time_s={END_S}"]
    figures = []
    monkeypatch.setattr(map_figures, "save", lambda figure, path: figures.append(figure) or path)
    done = call(*words)
    assert done.exit_code == 0, done.output
    assert "shown at 1 designs, refuted at 0, open at 2" in done.output
    assert "at 2 of the open designs, cases did not finish or lack the outcome" in done.output
    table = pd.read_parquet("campaign-map.parquet")
    assert table["soon"].tolist() == ["no verdict", "not shown", "pass"]
    (figure,) = figures
    assert "60 cases each, seed 1" in figure.get_suptitle()
    assert f"set: run.end_time_s = {END_S}" in figure.get_suptitle()
    labels = figure.axes[0].get_legend_handles_labels()[1]
    assert "shown, one-sided at 90 %" in labels
    assert "95 % interval of the fraction, two-sided" in labels
    assert "open: cases lack the outcome; as violations they would refute it" in labels
    about = pq.read_schema("campaign-map.parquet").metadata
    assert json.loads(about[b"settings"]) == {"run.end_time_s": str(END_S)}


def test_the_figure_has_the_confidence_of_several_looks(monkeypatch):
    designs = map_designs(campaign(), [MapAxis(X, 400.0, 600.0, 3)], cases=40, max_cases=80)
    figures = []
    monkeypatch.setattr(map_figures, "save", lambda figure, path: figures.append(figure) or path)
    map_figure(designs, campaign().file.requirements[0], "speed", (None,), "table2", Path("x.png"))
    assert "raised to 95 % for 2 looks" in figures[0].get_suptitle()
    labels = figures[0].axes[0].get_legend_handles_labels()[1]
    assert {"refuted, one-sided at 95 %", "97.5 % interval of the fraction, two-sided"} <= set(
        labels
    )
    assert not any("lack the outcome;" in label for label in labels)
