"""Replays of a report: the poses, forces and least distances that the page contains, and the page
in Chromium, if there is one."""

import json
import os
import re
from pathlib import Path

import msgspec
import numpy as np
import pandas as pd
import pytest
from click.testing import CliRunner
from numpy.testing import assert_allclose
from scipy.spatial.transform import Rotation
from small_scenes import SPRUNG
from support.browser import CHROMIUM, Page
from support.pusher import MASSES, pusher_tree

from sepmc.analysis.statistics import statistics
from sepmc.campaign.campaign import Campaign
from sepmc.cli import app
from sepmc.physics.propulsion import thrust_direction
from sepmc.report.case_points import MAX_POINTS, case_points
from sepmc.report.load_arrows import _of_table
from sepmc.report.nearest import PlacedPart, nearest_on_part, placed_part
from sepmc.report.page import CaseReplay, ReportContent, write_report
from sepmc.report.replay_data import replay_data, thrust, thrust_lines
from sepmc.scene.model import ForceTable, Part, Profile
from sepmc.scene.read import parse_campaign

SHAPES = {
    "solver.step_s": 0.0025,
    "body.fore.outline": [
        {"stations_m": [0.0, 1.0], "radii_m": [0.0, 0.3]},
        {"stations_m": [1.0, 2.3], "radii_m": [0.2, 0.2]},
        {"points_m": [[0.5, 0.4, 0.0]]},
    ],
    "body.aft.outline": [
        {"stations_m": [2.0, 3.0], "radii_m": [0.3, 0.35], "hollow": True},
        {"stations_m": [3.0, 4.0], "radii_m": [0.0, 0.0], "offset_m": [0.5, 0.0]},
    ],
    "clearance": [{"name": "gap", "bodies": ["fore", "aft"]}],
    "motor": [
        {
            "name": "kick",
            "body": "aft",
            "thrust_N": 20.0,
            "build_up_s": 0.01,
            "ignition_s": 0.1,
            "burn_s": 0.2,
            "tail_off_s": 0.05,
            "station_m": 4.0,
            "radius_m": 0.2,
            "cant_deg": 175.0,
        }
    ],
}


@pytest.fixture(scope="module")
def campaign():
    """Two bodies, a spring and a motor; one leaves the shell of the other."""
    return Campaign(parse_campaign(msgspec.toml.decode(SPRUNG), "sprung", SHAPES))


@pytest.fixture(scope="module")
def history(campaign):
    frame = campaign.simulate(None, 0.005)
    assert frame.attrs["status"] == "ok"
    return frame


@pytest.fixture(scope="module")
def data(campaign, history):
    """The replay, as the page has it."""
    replay = replay_data(history, campaign.scene, "case 3, the worst", 3)
    return json.loads(json.dumps(replay, allow_nan=False))


def test_poses_are_those_of_the_history(campaign, history, data):
    """Distances between bodies and their relative attitude need no common axes."""
    rows = history[~history["time_s"].duplicated(keep="last")]
    assert_allclose(data["time"], rows["time_s"], atol=1e-6)
    assert [data["phases"][k] for k in data["phase"]] == list(rows["phase"])
    fore, aft = (np.reshape(body["at"], (-1, 3)) for body in data["bodies"])
    positions = [rows[[f"{b}_{a}_m" for a in "xyz"]].to_numpy() for b in ("fore", "aft")]
    apart = np.linalg.norm(positions[0] - positions[1], axis=1)
    assert np.ptp(apart) > 0.1
    assert_allclose(np.linalg.norm(fore - aft, axis=1), apart, atol=2e-5)
    assert_allclose(3.0 * fore + aft, 0.0, atol=5e-5)  # from the common centre of mass
    turns = [
        Rotation.from_quat(np.reshape(body["turn"], (-1, 4)), scalar_first=True)
        for body in data["bodies"]
    ]
    angles = [
        rows[[f"{b}_{a}_deg" for a in ("pitch", "yaw", "roll")]].to_numpy().copy()
        for b in ("fore", "aft")
    ]
    ground = [Rotation.from_euler("ZYX", angle, degrees=True) for angle in angles]
    expected = ground[0].inv() * ground[1]
    assert expected.magnitude().max() > 0.01
    assert ((turns[0].inv() * turns[1]).inv() * expected).magnitude().max() < 1e-5
    assert turns[0][0].magnitude() < 1e-6  # the first body begins along the axes


def test_arrows(campaign, history, data):
    """The constraint force until the release, and the thrust from ignition to tail-off."""
    constraint, kick, push = data["arrows"]
    kinds = [one["kind"] for one in (constraint, kick, push)]
    assert kinds == ["constraint", "thrust", "spring"]
    rows = history[~history["time_s"].duplicated(keep="last")]
    force = rows[[f"pins_force_on_aft_{axis}_N" for axis in "xyz"]].to_numpy()
    sizes = np.linalg.norm(np.reshape(constraint["force"], (-1, 3)), axis=1)
    assert sizes.max() > 1.0
    assert_allclose(sizes, np.linalg.norm(force, axis=1), atol=1e-2)
    assert constraint["until"] == pytest.approx(0.05)
    time = np.array(data["time"])
    since = time - 0.1
    expected = 20.0 * np.where(
        since < 0.2,
        -np.expm1(-np.maximum(since, 0.0) / 0.01),
        -np.expm1(-0.2 / 0.01) * np.exp(-(since - 0.2) / 0.05),
    )
    assert_allclose(np.linalg.norm(np.reshape(kick["force"], (-1, 3)), axis=1), expected, atol=1e-2)
    assert kick["at"] == pytest.approx([-1.0, 0.0, 0.2])


TABLE = {"extension_m": [-0.1, 0.0, 0.03, 0.08, 0.2], "force_N": [70.0, 50.0, 65.0, 30.0, 10.0]}


@pytest.mark.parametrize(
    "spring",
    [
        {"force_N": 900.0, "stiffness_N_per_m": 1500.0, "damping_N_s_per_m": 80.0, "factor": 0.9},
        {"force_N": 20.0, "table": TABLE | {"interpolation": "monotone"}, "axis": None},
        {"table": TABLE | {"return_factor": 0.5}, "stiffness_N_per_m": 4000.0},
        {"force_N": "drive", "stroke_m": 0.05},
        {"force_N": 100.0, "stiffness_N_per_m": 1500.0, "push_only": True},
    ],
)
def test_springs_and_loads_accelerate_their_bodies(spring):
    """The forces on a body that are drawn are those of its motion."""
    spring = {key: value for key, value in spring.items() if value is not None}
    tree = pusher_tree(
        spring,
        run={"end_time_s": 0.4},
        signal=[{"name": "drive", "formula": "300 * exp(-time_s)"}],
        load=[
            {"name": "drag", "body": "fore", "force_N": [-20.0, 5.0, "drive"], "end_s": 0.1,
             "point_m": [0.5, 0.0, 0.1]},
            {"name": "gust", "body": "fore", "force_N": [30.0, -40.0, 10.0], "frame": "ground",
             "start_s": 0.05},
        ],
    )  # fmt: skip
    tree["initial"] |= {"pitch_deg": 30.0, "yaw_deg": -10.0, "roll_deg": 50.0}
    campaign = Campaign(parse_campaign(tree, "pusher.toml"))
    history = campaign.simulate(None, 0.002)
    data = replay_data(history, campaign.scene, "nominal case")
    names = [(one["kind"], one["name"]) for one in data["arrows"] if one["kind"] != "constraint"]
    assert names == [("spring", "pusher"), ("load", "drag"), ("load", "gust")]
    force = sum(np.reshape(one["force"], (-1, 3)) for one in data["arrows"])
    turn = Rotation.from_quat(np.reshape(data["bodies"][1]["turn"], (-1, 4)), scalar_first=True)
    rows = history[~history["time_s"].duplicated(keep="last")]
    expected = MASSES[1] * rows["fore_axial_acceleration_m_s2"].to_numpy()
    assert np.ptp(expected) > 20.0
    assert_allclose(turn.inv().apply(force)[:, 0], expected, atol=0.1)


def test_a_spring_of_locked_bodies_does_not_return():
    """Round-off of its rate, of either sign, is no unloading, as in the kernel."""
    table = ForceTable(extension=(0.0, 1.0), force=(100.0, 0.0), return_factor=0.5)
    rates = np.array([1e-13, 0.0, -1e-13, -1e-11, -1e-10, -1.0])
    assert_allclose(_of_table(table, np.zeros(6), rates), [100.0] * 4 + [50.0] * 2)


def test_thrust_over_a_profile(campaign, history):
    motor = msgspec.structs.replace(
        campaign.scene.motor[0],
        build_up=0.0,
        tail_off=0.0,
        profile=Profile(time=(0.0, 0.1), fraction=(0.0, 1.0)),
    )
    values = dict(zip(history["time_s"], thrust(history, campaign.scene, motor), strict=True))
    assert values[0.05] == 0.0
    assert values[0.15] == pytest.approx(10.0)
    assert values[0.25] == 0.0


def test_thrust_lines_are_those_of_the_formula(campaign):
    rng = np.random.default_rng(2)
    for cant, clock, deflection, of_clock in rng.uniform(-3.0, 3.0, (5, 4)):
        motor = msgspec.structs.replace(campaign.scene.motor[0], cant=cant, clock=clock)
        line = thrust_lines(motor, np.array([deflection]), np.array([of_clock]))[0]
        expected = thrust_direction(cant, clock, deflection, of_clock)
        assert_allclose(line, expected, atol=1e-14)


def test_lines_of_least_distance_have_its_length(data):
    """In the shell, through its wall or not, and beyond its end."""
    (gap,) = data["distances"]
    value = np.array(gap["value"], dtype=float)
    lines = np.array(gap["line"], dtype=float).reshape(-1, 2, 3)
    known = np.isfinite(value)
    assert known.sum() > 50
    length = 1e3 * np.linalg.norm(lines[:, 1] - lines[:, 0], axis=1)
    assert_allclose(length[known], value[known], rtol=1e-3, atol=0.1)
    assert np.isnan(lines[~known]).all()


PARTS = {
    "solid": Part(stations=(0.0, 2.0), radii=(0.3, 0.8), offset=(0.1, -0.2)),
    "reversed": Part(stations=(2.0, 0.0), radii=(0.3, 0.8)),
    "shell": Part(stations=(0.0, 2.0), radii=(0.5, 0.8), hollow=True),
    "line": Part(stations=(0.0, 2.0), radii=(0.0, 0.0), offset=(0.3, 0.0)),
    "sector": Part(stations=(0.0, 2.0), radii=(0.5, 0.8), sector=(0.3, 1.9)),
    "points": Part(points=((0.0, 1.0, 0.0), (0.5, 0.0, 0.7))),
}


def surface(part: PlacedPart) -> np.ndarray:
    """Points (n, 3) of a part: of its surface, and of its volume if it is a solid."""
    if len(part.points):
        return part.points
    low, high = part.sector or (0.0, 2.0 * np.pi)
    t, angle, depth = (
        grid.ravel()
        for grid in np.meshgrid(
            np.linspace(0.0, 1.0, 61),
            np.linspace(low, high, 121),
            [1.0] if part.is_wall else np.linspace(0.0, 1.0, 11),
        )
    )
    radius = depth * (part.radii[0] + t * (part.radii[1] - part.radii[0]))
    start, end = np.array(part.start), np.array(part.end)
    around = np.column_stack([0.0 * t, -radius * np.sin(angle), radius * np.cos(angle)])
    return start + t[:, None] * (end - start) + around


@pytest.mark.parametrize("name", PARTS)
def test_nearest_points_of_parts(name):
    """Not farther than any point of a grid, and on the part."""
    part = placed_part(PARTS[name], (1.0, 0.0, 0.1))
    points = np.random.default_rng(4).uniform(-2.0, 2.0, (40, 3))
    nearest, grid = nearest_on_part(points, part), surface(part)
    distance = np.linalg.norm(points - nearest, axis=1)
    to_grid = np.linalg.norm(points[:, None] - grid, axis=2).min(axis=1)
    assert (distance <= to_grid + 1e-12).all()
    assert np.linalg.norm(nearest[:, None] - grid, axis=2).min(axis=1).max() < 0.06
    assert (to_grid - distance).max() < 0.06


def content(data, **changes):
    """Report of a few cases, two of them with a replay."""
    cases = pd.DataFrame({"case": np.arange(30), "status": "ok"})
    rng = np.random.default_rng(1)
    for name, scale in (("speed_m_s", 1.0), ("angle_deg", 100.0), ("distance_mm", 10.0)):
        cases[name] = rng.normal(0.0, scale, 30)
    cases.loc[3, "speed_m_s"], cases.loc[17, "speed_m_s"] = -9.0, 9.0
    table = statistics(cases, ["speed_m_s", "angle_deg", "distance_mm"])
    replays = [
        CaseReplay(number, f"case {number}", [], {**data, "number": number, "title": "case"})
        for number in (3, 8)
    ]
    nominal = {**data, "number": None, "title": "nominal case"}
    texts = dict.fromkeys(("title", "facts", "counts", "accuracy", "audit", "campaign"), "text")
    values = {
        **texts,
        **dict.fromkeys(("notes", "verdicts", "failures", "proportions"), ()),
        "name": "small",
        "statistics": table,
        "leading": list(table.index),
        "units": {},
        "tail_note": "",
        "comparison": "",
        "sessions": [],
        "run": "runs/'some one'",
        "replays": replays,
        "nominal": nominal,
        "points": case_points(
            dict(cases), ["speed_m_s", "distance_mm"], ["angle_deg"], {}, {"speed_m_s": [-5.0]}
        ),
    }
    return ReportContent(**(values | changes))


@pytest.fixture
def path(data, tmp_path):
    return write_report(content(data), tmp_path / "report.html", [], [], [])


def embedded(path):
    """The data in a page."""
    text = path.read_text(encoding="utf-8")
    return re.search('id="replay-data">(.*?)</script>', text, re.DOTALL)[1]


def test_names_do_not_break_out(data, tmp_path):
    name = "</script><script>alert(1)</script><!--"
    body = {**data["bodies"][0], "name": name}
    replay = {**data, "bodies": [body, data["bodies"][1]], "title": name}
    replays = [CaseReplay(3, name, [], replay)]
    hostile = content(data, replays=replays, run="<script>", name=name)
    page = write_report(hostile, tmp_path / "report.html", [], [], [])
    text = page.read_text(encoding="utf-8")
    assert text.count("<script") == text.count("</script>") == 6
    assert "alert(1)</script>" not in text
    assert json.loads(embedded(page))[1]["bodies"][0]["name"] == name


def test_size(data, path):
    """Of 400 rows: 10 replays and the nominal case within 8 MB leave most to the figures."""
    assert len(json.loads(embedded(path))) == 3
    each = len(embedded(path)) / (3 * len(data["time"]))
    assert each * 400 < 150_000


def test_case_numbers_are_links_or_texts(path):
    text = path.read_text(encoding="utf-8")
    assert '<a class="case" href="#case-3">3</a>' in text
    assert '<h3 id="case-3">' in text
    assert '<span class="case">17</span>' in text


@pytest.mark.parametrize("numbers", ["", "one", "-1", "3;4", ",".join(map(str, range(101)))])
def test_numbers_that_are_none(numbers, tmp_path):
    (tmp_path / "cases").mkdir()
    called = CliRunner().invoke(app.main, ["report", str(tmp_path), f"--replays={numbers}"])
    assert called.exit_code == 2
    assert "case numbers" in called.stderr


chromium = pytest.mark.skipif(CHROMIUM is None, reason="no Chromium")


@pytest.fixture(scope="module")
def browser(data, tmp_path_factory):
    """The page in Chromium; no error, no other address."""
    page = write_report(content(data), tmp_path_factory.mktemp("page") / "report.html", [], [], [])
    with Page(page) as opened:
        yield opened
        assert opened.errors == []
        assert [address for address in opened.requests if address != page.as_uri()] == []


@pytest.mark.slow
@chromium
def test_slider_and_play(browser):
    browser.evaluate("document.getElementById('slider').focus()")
    browser.key("Home")
    assert browser.text("#time") == "0.000 s, locked"
    for _ in range(3):
        browser.key("ArrowRight")
    assert browser.text("#time") == "0.015 s, locked"
    assert "0.015 s, locked" in browser.evaluate(
        "document.getElementById('slider').getAttribute('aria-valuetext')"
    )
    browser.click("#play")
    assert browser.text("#play") == "Pause"
    browser.evaluate("new Promise(done => setTimeout(done, 600))")
    browser.click("#play")
    assert browser.text("#play") == "Play"
    assert browser.text("#time") > "0.015 s, locked"


@pytest.mark.slow
@chromium
def test_a_click_on_a_case(browser):
    """Opens its replay, or shows the command that makes one; by keyboard, too."""
    browser.click("a.case[href='#case-3']")
    assert browser.evaluate("document.getElementById('case').value") == "3"
    assert browser.evaluate("document.activeElement.id") == "slider"
    assert not browser.evaluate("document.getElementById('command').checkVisibility()")
    browser.evaluate("[...document.querySelectorAll('button.case')].at(0).focus()")
    number = browser.evaluate("document.activeElement.textContent")
    browser.key("Enter")
    assert browser.text("#command code") == f"sepmc replay runs/'some one' --case {number}"


@pytest.mark.slow
@chromium
def test_view(browser):
    """Dragging, keys, the wheel and buttons change the picture; so does the nominal case."""
    picture = "document.getElementById('canvas').toDataURL()"
    drawn = "new Promise(done => requestAnimationFrame(() => requestAnimationFrame(done)))"
    pictures = []

    def look():
        browser.evaluate(drawn)
        pictures.append(browser.evaluate(picture))

    browser.evaluate("document.querySelector('[data-view=side]').click()")
    look()
    x, y = browser.centre("#canvas")
    look()
    assert pictures[0] == pictures[1]
    pictures.clear()
    browser.mouse("mousePressed", x, y, button="left", clickCount=1)
    browser.mouse("mouseMoved", x + 60, y + 30, button="left", buttons=1)
    browser.mouse("mouseReleased", x + 60, y + 30, button="left")
    look()
    browser.mouse("mouseWheel", x, y, deltaX=0, deltaY=-200)
    look()
    browser.evaluate("document.getElementById('canvas').focus()")
    for key in ("ArrowLeft", "+", "Home"):
        browser.key(key)
        look()
    for button in ("#ghost", "#nearest", "#out", "[data-view=top]", "[data-view=rear]"):
        browser.click(button)
        look()
    assert len(set(pictures)) == len(pictures)


@pytest.mark.slow
@chromium
def test_tables_sort_and_filter(browser):
    column = "[...document.querySelectorAll('table')[0].tBodies[0].rows].filter(r => !r.hidden)"
    names = f"{column}.map(r => r.cells[0].innerText)"
    browser.click("table thead th:nth-child(5) button")  # sigma
    assert browser.evaluate(names) == ["speed_m_s", "distance_mm", "angle_deg"]
    browser.key("Enter")  # the button has the focus
    assert browser.evaluate(names) == ["angle_deg", "distance_mm", "speed_m_s"]
    head = "document.querySelector('table thead th:nth-child(5)').getAttribute('aria-sort')"
    assert browser.evaluate(head) == "descending"
    browser.click(".filter input")
    browser.type("deg")
    assert browser.evaluate(names) == ["angle_deg"]
    assert browser.text(".filter output") == "1 of 3 rows"


def test_points_are_extremes_and_others():
    """Of many cases: rows of the table, the extremes of each outcome, and bars of all of them."""
    rng, count = np.random.default_rng(5), 10_000
    cases = pd.DataFrame({"case": np.arange(count) + 7, "status": "ok"})
    cases["a_m"], cases["b_N"] = rng.normal(0.0, 1e-3, count), rng.normal(2e5, 3.0, count)
    cases["in_c_kg"], cases["same"] = rng.uniform(1.0, 2.0, count), 4.0
    cases.loc[5, "status"], cases.loc[5, "a_m"] = "timeout", 9.0
    cases.loc[6, "b_N"] = np.nan
    units, bounds = {"a_m": "m", "b_N": "N", "in_c_kg": "kg"}, {"a_m": [0.002]}
    points = case_points(dict(cases), ["a_m", "b_N", "same"], ["in_c_kg"], units, bounds)
    assert points["total"] == count - 1
    assert len(points["cases"]) == MAX_POINTS == len(set(points["cases"]))
    rows = cases.set_index("case").loc[points["cases"]]
    assert (rows["status"] == "ok").all()
    a, b, c = points["columns"]
    assert [(x["words"], x["kind"], x["bounds"]) for x in (a, b, c)] == [
        ("a", "outcome", [0.002]), ("b", "outcome", []), ("c", "input", []),
    ]  # fmt: skip
    ok = cases[cases["status"] == "ok"]
    for drawn in (a, b, c):
        known = ok[drawn["name"]].dropna()
        assert (drawn["low"], drawn["high"]) == (known.min(), known.max())
        assert sum(drawn["counts"]) == len(known)
        values = np.array(drawn["values"], dtype=float)
        assert_allclose(values, rows[drawn["name"]], atol=1e-4 * (known.max() - known.min()))
        if drawn["kind"] == "outcome":
            assert {known.idxmin() + 7, known.idxmax() + 7} <= set(points["cases"])
    assert len(json.dumps(points)) < 100_000
    few = case_points(dict(cases[:50]), ["a_m"], [], units, bounds)
    assert len(few["cases"]) == few["total"] == 49


def test_points_have_the_extremes_of_many_outcomes():
    """However many outcomes there are, the lowest and the highest case of each is a point."""
    rng, count, names = np.random.default_rng(6), 5_000, [f"a{k}_m" for k in range(100)]
    cases = pd.DataFrame(rng.normal(size=(count, len(names))), columns=names)
    cases["case"], cases["status"] = np.arange(count), "ok"
    points = case_points(dict(cases), names, [], dict.fromkeys(names, "m"), {})
    assert len(points["cases"]) == MAX_POINTS
    extremes = {*cases[names].idxmin(), *cases[names].idxmax()}
    assert extremes <= set(points["cases"])


@pytest.mark.slow
@chromium
def test_points(browser):
    """Hover names a case, the wheel and keys zoom, a click or Enter opens it."""
    picture = "document.getElementById('points-canvas').toDataURL()"
    drawn = "new Promise(done => requestAnimationFrame(() => requestAnimationFrame(done)))"
    browser.evaluate("document.getElementById('points-canvas').focus()")
    browser.key("Home")
    browser.key("ArrowRight")
    assert browser.text("#points-value") == "case 3: speed m s -9"
    browser.evaluate("document.getElementById('command').hidden = true")
    browser.key("Enter")
    assert browser.evaluate("document.getElementById('case').value") == "3"
    browser.evaluate("document.getElementById('points-canvas').focus()")
    browser.key("Home")
    browser.key("ArrowLeft")
    assert browser.text("#points-value").startswith("case 17: ")
    browser.key("Enter")
    assert browser.text("#command code").endswith(" --case 17")
    pictures = []
    for act in ("+", "-", "Home"):
        browser.key(act)
        browser.evaluate(drawn)
        pictures.append(browser.evaluate(picture))
    assert pictures[0] != pictures[1]
    x, y = browser.centre("#points-canvas")
    browser.mouse("mouseWheel", x, y, deltaX=0, deltaY=-300)
    browser.evaluate(drawn)
    assert browser.evaluate(picture) not in pictures
    browser.evaluate(
        "(() => { const y = document.getElementById('points-y'); y.value = 1; y.onchange(); })()"
    )
    browser.evaluate(drawn)
    browser.evaluate("document.getElementById('points-canvas').focus()")
    browser.key("ArrowRight")
    value = browser.text("#points-value")
    assert value.startswith("case 3: speed m s -9, distance mm ")
    left, top, width, height = browser.evaluate(
        "(() => { const b = document.getElementById('points-canvas').getBoundingClientRect();"
        "return [b.x, b.y, b.width, b.height]; })()"
    )
    place, names = left + 65 + 0.03 / 1.06 * (width - 78), set()  # of the lowest value
    for k in range(5, int(height), 12):
        browser.mouse("mouseMoved", place, top + k)
        names.add(browser.text("#points-value"))
    assert value in names


@pytest.mark.slow
@chromium
def test_readable_without_scripts(path):
    with Page(path, scripts=False) as page:
        nodes = page.call("DOMSnapshot.captureSnapshot", computedStyles=["display"])
        texts = nodes["strings"]
        layout = nodes["documents"][0]
        names = [texts[k] for k in layout["nodes"]["nodeName"]]
        shown = {names[k] for k in layout["layout"]["nodeIndex"]}
        assert {"speed_", "case 8"} <= {texts[k] for k in layout["layout"]["text"]}
        assert {"TABLE", "A", "H3"} <= shown
        assert not {"CANVAS", "INPUT", "BUTTON", "CODE"} & shown


@pytest.mark.slow
@chromium
@pytest.mark.skipif("AXE" not in os.environ, reason="AXE is not the path of axe.min.js")
def test_accessibility(browser):
    """By axe-core (npm pack axe-core), best practices included."""
    browser.evaluate(Path(os.environ["AXE"]).read_text(encoding="utf-8"))
    violations = browser.evaluate("axe.run().then(result => result.violations)")
    assert [(one["id"], [n["html"] for n in one["nodes"]]) for one in violations] == []
