"""The report of a run: one page that holds all it shows, with verdicts, drivers and worst cases."""

import itertools
import re
from html.parser import HTMLParser
from pathlib import Path

import msgspec
import numpy as np
import pytest
from click.testing import CliRunner
from matplotlib.patches import Polygon
from numpy.testing import assert_allclose
from oracles.random_scenes.interpreted import run_interpreted
from support.sizing_problem import END_S
from support.sizing_problem import campaign as pusher

import sepmc
from sepmc.campaign import run_statistics
from sepmc.campaign.execution.replay import worst_case
from sepmc.cli import app
from sepmc.cli.options import load_run
from sepmc.cli.report_content import _worst_cases, tables_beside
from sepmc.physics.propulsion import thrust_arm, thrust_direction
from sepmc.report import drawing as drawing_module
from sepmc.report.drawing import draw_vehicle, nozzle_point
from sepmc.report.page import verdict_row
from sepmc.scene.campaign_files import shipped_campaigns
from sepmc.scene.model import Part

EVERYTHING = Path(__file__).parents[1] / "data" / "everything.toml"
REQUIRED = [
    {"name": "fast", "metric": "separation_speed_m_s", "at_least": 0.53, "probability": 0.9},
    {"name": "slow", "metric": "separation_speed_m_s", "at_most": 10.0, "probability": 0.9},
    {"name": "parts", "metric": "never-released"},
]

BESIDE = {
    "scenarios.csv": "scenario,title,run,name,verdict\n"
    "weak,<script>alert(2)</script>,9,fast,fail\n",
    "limits.csv": "case,limit,low,high,between,in_x_m,status,fast,fast_outcome,fast_margin\n"
    "0,x_m low,x_m,,,0.9,ok,met,0.5412345,0.0112345\n"
    "1,worst of fast,x_m,y_m; z_m,,0.9,ok,violated,,\n",
}


def call(*arguments):
    return CliRunner().invoke(app.main, [str(a) for a in arguments])


@pytest.fixture(scope="module")
def run(tmp_path_factory):
    """A run folder with a requirement that fails and one that is shown, of a campaign with
    scenarios and limit cases."""
    settings = {"requirement": REQUIRED, "title": "A < B & <script>alert(1)</script>"}
    folder = tmp_path_factory.mktemp("report") / "baseline"
    for name, text in BESIDE.items():
        (folder.parent / name).write_text(text, encoding="utf-8")
    with run_interpreted():
        sepmc.load("table2", settings).run(cases=60, seed=3, out=folder)
    return folder


@pytest.fixture(scope="module")
def page(run):
    called = call("report", run)
    assert called.exit_code == 0, called.output
    assert "running case" in called.stdout
    return (run / "report.html").read_text(encoding="utf-8")


class Tags(HTMLParser):
    """All elements open and close in order; what they refer to."""

    def __init__(self):
        super().__init__()
        self.open, self.refers, self.count = [], [], {}

    def handle_starttag(self, tag, attrs):
        self.count[tag] = self.count.get(tag, 0) + 1
        self.refers += [value for name, value in attrs if name in ("src", "href", "xlink:href")]
        if tag not in ("meta", "br", "link", "img", "wbr", "input"):
            self.open.append(tag)

    def handle_endtag(self, tag):
        assert self.open.pop() == tag

    def handle_startendtag(self, tag, attrs):
        self.refers += [value for name, value in attrs if name in ("src", "href", "xlink:href")]


@pytest.mark.slow
def test_scenarios_and_limit_cases_beside_the_run(page):
    section = page.partition("<h2>Scenarios</h2>")[2].partition("<h2>Vehicle</h2>")[0]
    rows = re.findall("<tr>(.*?)</tr>", section, re.DOTALL)
    cells = [re.findall("<t[dh].*?>(.*?)</t[dh]>", row) for row in rows]
    assert cells == [
        ["scenario", "run", "name", "verdict", "title"],
        ["weak", "9", "fast", "fail", "&lt;script&gt;alert(2)&lt;/script&gt;"],
        ["limit", "status", "fast", "fast_outcome", "fast_margin", "low", "high"],
        ["x_m low", "ok", "met", "0.54123", "0.011234", "", ""],
        ["worst of fast", "ok", "violated", "", "", "x_m", "y_m; z_m"],
    ]


def test_another_run_has_no_tables_beside_it(tmp_path):
    (tmp_path / "limits.csv").write_text(BESIDE["limits.csv"], encoding="utf-8")
    assert tables_beside(tmp_path / "run") == []
    assert [table.title for table in tables_beside(tmp_path / "baseline")] == ["Limit cases"]


@pytest.mark.slow
def test_one_page(page):
    """It is well formed, asks nothing of other files, and shows what a file says as text."""
    tags = Tags()
    tags.feed(page)
    assert tags.open == []
    assert all(result.startswith(("#", "data:image/png;base64,")) for result in tags.refers)
    assert "fetch(" not in page
    assert "import(" not in page
    assert tags.count["script"] == 6  # four files, and the data of two
    assert not {"iframe", "object", "embed"} & set(tags.count)
    assert "A &lt; B &amp; &lt;script&gt;" in page
    # outcomes over time, as shares, as they converge and as histograms; vehicle; drivers as swings
    # and case by case; three figures of each worst case
    assert tags.count["svg"] == 2 + 1 + 1 + 1 + 1 + 2 + 3 * 2
    assert page.count('<svg role="img"') == tags.count["svg"]
    titles = re.findall(r"<svg [^>]*>\s*<title>([^<]+)</title>", page)
    assert len(titles) == tags.count["svg"]  # for readers who do not see the figures
    assert len(page) < 3e6


@pytest.mark.slow
def test_a_case_that_violates_without_a_value_is_shown(tmp_path):
    """Some are not released before the end: the first of them is among the worst, by its status,
    and replayed."""
    settings = {"requirement": [REQUIRED[2], REQUIRED[1]], "run.end_time_s": 0.25}
    with run_interpreted(cases=4):
        table = (
            sepmc.load("table2", settings).run(cases=6, seed=3, out=tmp_path / "run").to_pandas()
        )
        called = call("report", tmp_path / "run")
    first = int(table["case"][table["status"] == "never-released"].iloc[0])
    assert called.exit_code == 0, called.output
    assert f"running case {first} again, the first that violates parts" in called.stdout
    violations = int((table["status"] == "never-released").sum())
    text = (tmp_path / "run" / "report.html").read_text(encoding="utf-8")
    assert f"case {first}, the first of {violations} that violate parts" in text
    assert f"did not finish (first: case {first}); they count as violations" in text


def test_joint_loads_that_are_not_unique_are_noted(pair, tmp_path):
    """Of two joints that hold the same, as the campaign says when it is flown."""
    settings = {
        "joint.bolt": {"bodies": ["fore", "aft"], "point_m": [2.0, 0.1, 0.0]},
        "phase": [{"name": "locked", "joints": {"pins": "fixed", "bolt": "fixed"}}],
        "dispersion": {"initial.speed_m_s": {"uniform": 0.1}},
    }
    with run_interpreted(cases=4):
        pair(settings).run(cases=25, out=tmp_path / "run")
    called = call("report", tmp_path / "run", "--no-replay")
    assert called.exit_code == 0, called.output
    text = (tmp_path / "run" / "report.html").read_text(encoding="utf-8")
    assert "constraint rows are redundant, among pins, bolt" in text


@pytest.mark.slow
def test_an_outcome_without_a_unit(pair, tmp_path):
    settings = {
        "outcome": [{"name": "square", "formula": "fore_pitch_deg ** 2"}],
        "requirement": [{"name": "small", "metric": "square", "at_most": 1e9}],
        "dispersion": {"initial.pitch_deg": {"uniform": 1.0}},
    }
    with run_interpreted(cases=4):
        pair(settings).run(cases=25, out=tmp_path / "run")
    called = call("report", tmp_path / "run", "--no-replay")
    assert called.exit_code == 0, called.output
    text = (tmp_path / "run" / "report.html").read_text(encoding="utf-8")
    assert '<td class="name">square</td>' in text


def test_content(page):
    text = re.sub(r"\s+", " ", re.sub(r"<[^>]+>", " ", page))
    assert "FAIL fast: separation_speed_m_s &gt;= 0.53 m/s in 90 % of all cases" in text
    assert "PASS slow: separation_speed_m_s &lt;= 10 m/s" in text
    assert "NOT SHOWN parts: never-released does not occur in 99.73 %" in text
    assert "60 cases, 60 ok" in text
    assert "Sensitivity of outcomes, inputs by" in text
    assert re.search("fast, [0-9]+ of 60 cases", text)
    assert "the worst of fast: separation_speed_m_s 0.4" in text
    assert "audit passed" in text
    assert "numerical error &lt;= " in text
    assert "name = &#34;fast&#34;" in page  # the campaign file
    # what is folded is not printed: the file, which the run folder holds
    folded = re.findall(r"<details>.*?</details>", page, re.DOTALL)
    assert len(folded) == 1
    assert "campaign.toml of the run folder" in folded[0]


@pytest.mark.slow
@pytest.mark.parametrize("ending", ["png", "svg", "pdf"])
def test_drawing(tmp_path, ending):
    """Of every shipped campaign; nothing is overwritten unasked."""
    path = tmp_path / f"vehicle.{ending}"
    assert call("draw", "srb", "--out", path).exit_code == 0
    first = path.read_bytes()
    assert len(first) > 10_000
    again = call("draw", "srb", "--out", path)
    assert (again.exit_code, "exists; add --overwrite" in again.stderr) == (2, True)
    assert call("draw", "srb", "--out", path, "--overwrite").exit_code == 0
    assert path.read_bytes() == first
    assert call("draw", "srb", "--out", tmp_path / "vehicle.txt").exit_code == 2


@pytest.mark.slow
def test_every_campaign_can_be_drawn(tmp_path):
    for name in (*shipped_campaigns(), str(EVERYTHING)):
        campaign = sepmc.load(name)
        path = tmp_path / f"{campaign.name}.svg"
        draw_vehicle(campaign.scene, campaign.file.dispersions, campaign.name, path)
        text = path.read_text(encoding="utf-8")
        for part in campaign.scene.body:
            assert part in text


@pytest.mark.slow
@pytest.mark.parametrize(
    "name", ["table2", "spring-pushers", "residual-thrust", "missile-rail", "srb"]
)
def test_names_in_a_drawing_do_not_cover_each_other(name, tmp_path, monkeypatch):
    """They lie within their axes, beside each other and beside what they name."""
    figures = []
    monkeypatch.setattr(drawing_module, "save", lambda figure, path: figures.append(figure))
    campaign = sepmc.load(name)
    draw_vehicle(campaign.scene, campaign.file.dispersions, name, tmp_path / "vehicle.png")
    renderer = figures[0].canvas.get_renderer()
    for ax in figures[0].axes:
        within = ax.get_window_extent()
        boxes = [text.get_window_extent(renderer) for text in ax.texts if text.get_text()]
        for k, box in enumerate(boxes):
            assert not any(box.overlaps(other) for other in boxes[:k])
            assert within.contains(box.x0, box.y0)
            assert within.contains(box.x1, box.y1)
        ticks = [label.get_window_extent(renderer) for label in ax.get_xticklabels()]
        assert not any(one.overlaps(two) for one, two in itertools.pairwise(ticks))
        for leader in (text for text in ax.texts if text.arrow_patch and text.xyann != text.xy):
            if leader.arrowprops["arrowstyle"] != "-":
                continue
            start = ax.transData.transform(leader.xy)
            end = start + np.array(leader.xyann) * figures[0].dpi / 72.0
            along = start + np.linspace(0.0, 0.97, 50)[:, None] * (end - start)
            assert not any(box.contains(*point) for box in boxes for point in along)


@pytest.mark.parametrize(("name", "noted"), [("srb", True), ("table1", False)])
def test_labels_of_coincident_points(name, noted, tmp_path, monkeypatch):
    """The meaning of "+5" is explained below the drawing if such a label exists."""
    figures = []
    monkeypatch.setattr(drawing_module, "save", lambda figure, path: figures.append(figure))
    campaign = sepmc.load(name)
    draw_vehicle(campaign.scene, campaign.file.dispersions, name, tmp_path / "vehicle.png")
    names = [text.get_text() for ax in figures[0].axes for text in ax.texts]
    assert any(" +" in one for one in names) == noted
    assert (drawing_module._COUNT_NOTE in figures[0].get_supxlabel()) == noted


def test_sectors_and_lines_are_drawn_in_rear_view(tmp_path, monkeypatch):
    """The upper half of a shell as an arc above the axis, a line as a dot."""
    figures = []
    monkeypatch.setattr(drawing_module, "save", lambda figure, path: figures.append(figure))
    campaign = sepmc.load("fairing")
    scene, line = campaign.scene, Part(stations=(3.0, 8.0), radii=(0.0, 0.0), offset=(0.5, 1.2))
    left = msgspec.structs.replace(scene.body["left"], outline=(*scene.body["left"].outline, line))
    scene = msgspec.structs.replace(scene, body=scene.body | {"left": left})
    draw_vehicle(scene, [], "fairing", tmp_path / "vehicle.png")
    side, _, rear = figures[0].axes
    arc = next(
        shape.get_xy() for shape in rear.patches
        if isinstance(shape, Polygon) and shape.get_xy()[:, 1].min() >= -1e-9
    )  # fmt: skip
    assert np.hypot(*arc.T) == pytest.approx(1.3)
    assert (arc[0], arc[-1]) == (pytest.approx([-1.3, 0.0]), pytest.approx([1.3, 0.0]))
    dots = [one.get_xydata()[0].tolist() for one in rear.lines if one.get_marker() == "o"]
    assert [1.2, 0.5] in dots
    wall = next(
        shape.get_xy() for shape in side.patches
        if isinstance(shape, Polygon) and shape.get_xy()[:, 0].min() == 3.0
    )  # fmt: skip
    assert np.ptp(wall, axis=0) == pytest.approx([5.0, 1.3])


def test_springs_of_a_vehicle_without_outlines_are_seen(tmp_path, monkeypatch):
    """The store has one body: its size is that of its ejectors' distance, 0.5 m."""
    figures = []
    monkeypatch.setattr(drawing_module, "save", lambda figure, path: figures.append(figure))
    scene = sepmc.load("store").scene
    draw_vehicle(scene, [], "store", tmp_path / "vehicle.png")
    low, high = figures[0].axes[2].get_ylim()
    assert 0.04 < high - low < 0.5


@pytest.mark.parametrize("sign", [1.0, -1.0])
def test_the_arrow_of_a_spring_that_pulls(tmp_path, monkeypatch, sign):
    """It points as the force on the second body does."""
    drawn = {}
    monkeypatch.setattr(
        drawing_module,
        "_arrow",
        lambda labels, view, point, along, length, colour, name: drawn.setdefault(name, along),
    )
    scene = sepmc.load("spring-pushers").scene
    spring = msgspec.structs.replace(scene.spring[0], axis=(0.6, 0.0, 0.8), force=sign, table=None)
    scene = msgspec.structs.replace(scene, spring=(spring,))
    draw_vehicle(scene, [], "pusher", tmp_path / "vehicle.png")
    assert drawn[spring.name] == pytest.approx([0.6 * sign, 0.0, 0.8 * sign])


def test_thrust_is_drawn_as_it_acts():
    """As the formulas that fly it have it."""
    motors = sepmc.load("srb").scene.motor
    assert any(motor.cant not in (0.0, np.pi) for motor in motors)
    rng = np.random.default_rng(1)
    for motor in motors:
        motor = msgspec.structs.replace(motor, radius=rng.uniform(0.1, 2.0))
        expected = thrust_direction(motor.cant, motor.clock, 0.0, 0.0)
        assert_allclose(motor.direction, expected, atol=1e-15)
        y, z = motor.offset
        arm = thrust_arm((0.0, 0.0, 0.0), motor.station, motor.radius, motor.clock, y, z)
        assert_allclose(nozzle_point(motor), (-arm[0], *arm[1:]), atol=1e-15)


@pytest.mark.slow
def test_options(run, tmp_path):
    called = call("report", run, "--no-replay", "--quiet")
    assert (called.exit_code, called.output) == (0, "")
    assert "Cases over time" not in (run / "report.html").read_text(encoding="utf-8")
    wrong = call("report", tmp_path)
    assert wrong.exit_code == 2
    assert str(tmp_path) in wrong.stderr


@pytest.mark.slow
def test_chosen_cases_are_replayed(run):
    """Besides the worst ones; a number that the run does not have is refused."""
    wrong = call("report", run, "--replays", "3,60")
    assert wrong.exit_code == 2
    assert "--case 60 is none of them" in wrong.stderr
    called = call("report", run, "--no-replay", "--replays", "17,3")
    assert called.exit_code == 0, called.output
    text = (run / "report.html").read_text(encoding="utf-8")
    assert re.findall(r'<h3 id="case-(\d+)">', text) == ["3", "17"]


@pytest.mark.slow
def test_the_first_case_without_the_outcome_is_replayed(pusher_run):
    """Although another one, with a value, is the worst; its number is in the table."""
    folder, first, count = pusher_run
    called = call("report", folder)
    assert called.exit_code == 0, called.output
    assert f"running case {first} again, the first without the outcome of soon" in called.stdout
    page = (folder / "report.html").read_text(encoding="utf-8")
    title = f"case {first}, the first of {count} without pusher_stroke_end_time_s"
    assert f"{title}: it counts as a violation of soon" in page
    assert f"{count} cases lack the outcome (first: case {first}); they count as violations" in page
    assert f'without the outcome: case <a class="case" href="#case-{first}">{first}</a>' in page


def test_verdicts_name_the_first_case_without_the_outcome(pusher_run):
    """Verdict and worst case of the row; what is two-sided is so named."""
    folder, first, _ = pusher_run
    run = run_statistics.read_run(folder, sepmc.load(folder / "campaign.toml"))
    (verdict,) = run.verdicts
    assert verdict.first_missing == first != verdict.worst_case
    assert verdict_row(verdict, "s")["without"] == first
    number, text = worst_case(run.summary, load_run(folder), {}, "soon")
    assert number == verdict.worst_case
    assert f"(first: case {first}); they count as violations" in text
    cases = _worst_cases(load_run(folder), run)
    assert list(cases) == [verdict.worst_case, first]


@pytest.fixture(scope="module")
def pusher_run(tmp_path_factory):
    """A run folder in which some cases end before the stroke of a spring; the first of them, and
    their number."""
    item = {"name": "soon", "metric": "pusher_stroke_end_time_s", "at_most": 1.0}
    folder = tmp_path_factory.mktemp("pusher") / "run"
    one = pusher(item | {"probability": 0.5}).with_settings({"run.end_time_s": END_S})
    with run_interpreted():
        table = one.run(cases=40, seed=3, out=folder).to_pandas()
    lacking = table["case"][table["pusher_stroke_end_time_s"].isna()]
    assert 1 < len(lacking) < 20
    return folder, int(lacking.iloc[0]), len(lacking)
