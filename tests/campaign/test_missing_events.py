"""What a scene waits for and some cases do not get: counted, told, and not passed over."""

import json
from dataclasses import replace

import numpy as np
import pytest
from click.testing import CliRunner
from oracles.random_scenes.interpreted import run_interpreted
from small_scenes import BODIES

import sepmc
from sepmc.analysis.requirements_text import render_missing
from sepmc.analysis.row_statistics import TableStatistics
from sepmc.campaign import campaign as campaigns
from sepmc.campaign.execution.limit_state import MarginEvaluator, limit_state
from sepmc.campaign.execution.missing_events import expected_events
from sepmc.campaign.store.manifests import read_manifest
from sepmc.cli import app
from sepmc.scene.model import Requirement
from sepmc.schema import Status

# A spring of dispersed force pushes a body off along a rail: in some cases it comes 20 mm far, and
# the event, the cap's release and the motor, which all wait for that, come; in others not.
SCENE = (
    """
name = "waiting"
"""
    + BODIES
    + """
[body.cap]
mass_kg = 1.0
inertia_kg_m2 = [1.0, 1.0, 1.0]
cg_m = [0.2, 0.0, 0.0]
[joint.pins]
bodies = ["aft", "fore"]
point_m = [2.0, 0.0, 0.0]
[joint.bolt]
bodies = ["fore", "cap"]
point_m = [0.5, 0.0, 0.0]
[[spring]]
name = "push"
bodies = ["aft", "fore"]
point_m = [2.0, 0.0, 0.0]
axis = [1.0, 0.0, 0.0]
force_N = 4.0
[[event]]
name = "far"
when = { joint = "pins", stroke_mm = 20.0 }
[[release]]
name = "open"
joint = "bolt"
when = { joint = "pins", stroke_mm = 20.0 }
optional = true
[[motor]]
name = "kick"
body = "fore"
thrust_N = 2.0
station_m = 0.0
ignition = { event = "far", delay_s = 0.01 }
[[phase]]
name = "slide"
joints = { pins = "slider", bolt = "fixed" }
[initial]
altitude_m = 1000.0
speed_m_s = 1.0
[output]
tip_off = ["bolt"]
[[requirement]]
name = "calm"
metric = "far_fore_omega_z_deg_s"
at_most = 1.0
probability = 0.5
confidence = 0.9
[[requirement]]
name = "steady"
metric = "bolt_tip_off_cap_z_deg_s"
at_most = 1.0
probability = 0.5
confidence = 0.9
[dispersion]
"spring.push.force_N" = { uniform = 4.0 }
[run]
cases = 40
end_time_s = 0.1
[solver]
step_s = 0.025
"""
)
WAITED = ("event.far", "joint.bolt", "motor.kick")


def call(*arguments):
    return CliRunner().invoke(app.main, [str(a) for a in arguments], catch_exceptions=False)


@pytest.fixture(scope="module")
def file(tmp_path_factory):
    """The file of that scene."""
    path = tmp_path_factory.mktemp("waiting") / "waiting.toml"
    path.write_text(SCENE)
    return path


@pytest.fixture(scope="module")
def run(file):
    """Its run, and what the command printed."""
    with run_interpreted():
        called = call("campaign", file, "--out", file.parent / "run", "--no-plots")
    return file.parent / "run", called


@pytest.fixture(scope="module")
def expected(run):
    """In how many ok cases each of these does not come, from the rows."""
    rows = sepmc.campaign.store.shards.read_cases(run[0])
    ok = rows[rows["status"] == "ok"]
    columns = {"event.far": "far", "joint.bolt": "bolt_release", "motor.kick": "kick_ignition"}
    by_name = {name: int(ok[f"{start}_time_s"].isna().sum()) for name, start in columns.items()}
    assert len(ok) == 40
    assert 5 < by_name["event.far"] < 35
    return by_name


def test_what_is_waited_for(file):
    """Events, motors and joints that something frees; not a joint that holds all along."""
    columns = expected_events(sepmc.load(file))
    assert columns == {
        "joint.bolt": "bolt_release_time_s",
        "event.far": "far_time_s",
        "motor.kick": "kick_ignition_time_s",
    }
    kept = sepmc.load(file, {"release": []})  # nothing frees the cap
    assert set(expected_events(kept)) == {"event.far", "motor.kick"}


def test_they_are_counted_in_notes_and_manifest(run, expected):
    """On the screen, in the manifest, and again by sepmc stats."""
    folder, reported = run
    manifest = read_manifest(folder)
    assert manifest["missing"] == expected
    for output in (reported.output, call("stats", folder).output):
        assert f"event.far does not occur in {expected['event.far']} of 40 ok cases" in output
        assert f"motor.kick does not light in {expected['motor.kick']} of 40 ok" in output
        assert (
            f"joint.bolt does not become free (its release is optional) in "
            f"{expected['joint.bolt']} of 40 ok cases" in output
        )


# the spring ends where the event comes, and the release leaves the cap on a slider
LOOSENED = {"spring.push.stroke_m": 0.02, "release.open.to": "slider", "output": {}}


def test_strokes_and_partial_releases_are_counted(file, expected, tmp_path):
    """A stroke that does not end, and a release to another kind than free: in the notes, in the
    manifest and again by sepmc stats."""
    count = expected["event.far"]
    settings = [f"--set={key}={value}" for key, value in LOOSENED.items() if value]
    with run_interpreted():
        told = call(
            *("campaign", file, "--out", tmp_path / "run", "--no-plots"),
            *(*settings, "--set=output.tip_off=[]", "--set=requirement=[]"),
        )
    assert told.exit_code == 0, told.output
    manifest = read_manifest(tmp_path / "run")
    assert manifest["missing"] == {
        "joint.bolt.slider": count, "event.far": count, "spring.push": count,
        "motor.kick": expected["motor.kick"],
    }  # fmt: skip
    for output in (told.output, call("stats", tmp_path / "run").output):
        assert (
            f"joint.bolt is not released to slider (its release is optional) in {count} of 40 ok "
            "cases" in output
        )
        assert (
            f"spring.push does not reach the end of its stroke, and pushes on in {count} of 40 "
            "ok cases" in output
        )
    rows = sepmc.campaign.store.shards.read_cases(tmp_path / "run")
    waiting = rows["far_time_s"].isna()
    assert waiting.sum() == count
    for column in ("push_stroke_end_time_s", "bolt_release_to_slider_time_s"):
        assert (rows[column].isna() == waiting).all()
        assert np.allclose(rows[column][~waiting], rows["far_time_s"][~waiting], rtol=0, atol=1e-9)


def test_requirement_on_the_end_of_a_stroke(file, expected):
    """Cases whose stroke does not end violate it, and are counted as lacking the outcome."""
    bound = {
        "name": "spent", "metric": "push_stroke_end_time_s", "at_most": 1.0, "probability": 0.5,
    }  # fmt: skip
    with run_interpreted():
        result = sepmc.load(file, LOOSENED | {"requirement": [bound]}).run()
    (verdict,) = result.requirements().itertuples()
    assert verdict.lacking == verdict.violations == expected["event.far"]
    assert any("spring.push does not reach the end" in note for note in result.notes)
    row = result.statistics().loc["push_stroke_end_time_s"]
    assert row["min"] > 0.05
    assert row["max"] <= 0.1


@pytest.mark.slow
@pytest.mark.parametrize("how", [{"stats_only": True}, {"keep": "every:10"}, {}])
def test_however_it_is_flown(file, expected, tmp_path, how):
    """Statistics only, some rows kept, in memory: the same counts in the notes of the result."""
    out = {} if not how else {"out": tmp_path / "run"}
    with run_interpreted():
        result = sepmc.load(file).run(**how, **out)
    texts = [note for note in result.notes if " ok cases: outcomes that wait for it" in note]
    assert len(texts) == 3
    assert any(f"in {expected['event.far']} of 40" in note for note in texts)


def test_a_run_that_is_resumed_counts_all_of_them(file, expected, tmp_path):
    """What was counted of cases that a folder holds stays counted."""
    with run_interpreted():
        part = sepmc.load(file).run(cases="0:16", out=tmp_path / "run")
        assert sum("ok cases: outcomes that wait" in note for note in part.notes) == 3
        call("campaign", file, "--out", tmp_path / "other", "--no-plots", "--cases", 20)
        called = call(
            "campaign", file, "--out", tmp_path / "other", "--no-plots", "--resume", "--cases", 40
        )
    assert called.exit_code in (0, 1), called.output
    assert read_manifest(tmp_path / "other")["missing"] == expected


def test_missing_does_not_pass(run, expected):
    """Cases without the outcome count against a requirement, and are told by number."""
    folder, reported = run
    verdicts = {
        one["name"]: one
        for one in json.loads((folder / "statistics.json").read_text())["requirements"]
    }
    for name, place in (("calm", "event.far"), ("steady", "joint.bolt")):
        one = verdicts[name]
        assert one["violations"] == one["missing"] == one["lacking"] == expected[place]
        assert one["verdict"] != "pass"
        count, first = expected[place], one["first_missing"]
        message = f"{count} cases lack the outcome (first: case {first}); they count as violations"
        assert message in " ".join(reported.output.split())
    assert "did not finish" not in reported.output


def test_what_did_not_end_is_told_apart():
    """Cases that failed, and cases that ended without the outcome."""
    rows = {
        "case": np.arange(6),
        "status": np.array(["ok", "ok", "ok", "never-released", "ok", "ok"], dtype=object),
        "x_mm": np.array([1.0, np.nan, np.nan, np.nan, 2.0, 3.0]),
    }
    item = Requirement(name="a", metric="x_mm", at_most=5.0, probability=0.5, confidence=0.9)
    summary = TableStatistics(rows, ["x_mm"], [], {}, [item])
    (verdict,) = summary.verdicts({"x_mm": (0.0, 1.0)}, summary.audit())
    assert (verdict.violations, verdict.missing, verdict.lacking) == (3, 3, 2)
    reported = (
        "2 cases lack the outcome, 1 did not finish (first: case 1); they count as violations"
    )
    assert render_missing(verdict) == reported
    alone = replace(verdict, missing=1, lacking=1)
    assert render_missing(alone) == "1 case lacks the outcome (case 1); it counts as a violation"


def test_rare_events_count_them_too(file):
    """Cases whose margin is not known, though they came to their end, are counted by themselves."""
    campaign = sepmc.load(file)
    with run_interpreted():
        flight = campaigns.select_steps(campaign)  # by few trial cases
        flights = MarginEvaluator(campaign, flight, limit_state(campaign, "calm"), _nothing, None)
        margin, _ = flights.margins(np.linspace(-2.0, 2.0, 21)[:, None])
    assert 0 < np.isnan(margin).sum() == flights.n_without_outcome < 21
    assert flights.summary.missing["event.far"] == flights.n_without_outcome
    assert flights.summary.failures == 0


def _nothing(count, failures):
    """What hears of progress."""


def test_what_sets_them_apart(run, expected):
    """The causes of a missing outcome are looked for, among cases that came to their end."""
    called = call("sensitivity", run[0], "--no-plots").output
    count = expected["event.far"]
    assert f"calm, {count} ok cases without far_fore_omega_z_deg_s: inputs that" in called
    assert "spring.push.force_N explains " in called


def test_check_tells_it_of_the_nominal_case(file):
    """`check` of a nominal that is too weak, and of one that is not."""
    weak = call("check", file, "--set", "spring.push.force_N=1.0", "--set", "dispersion={}")
    for message in (
        "event.far does not occur in the nominal case, which ends at 0.1 s",
        "motor.kick does not light in the nominal case",
        "joint.bolt does not become free (its release is optional) in the nominal case",
    ):
        assert message in weak.stderr
    assert "spring.push" not in weak.stderr
    strong = call("check", file, "--set", "spring.push.force_N=30.0")
    assert "nominal case, which ends" not in strong.stderr


def test_check_tells_of_strokes_that_do_not_end(file):
    """A spring that is still within its stroke as the nominal case ends, and one that is not."""
    for stroke, expected in ((0.5, True), (0.01, False)):
        called = call("check", file, "--set", f"spring.push.stroke_m={stroke}")
        message = "spring.push does not reach the end of its stroke, and pushes on in the nominal"
        assert (message in called.stderr) == expected, called.stderr


def test_check_tells_of_partial_releases(file):
    """Of a release to a kind that does not come in the nominal case."""
    settings = [f"--set={key}={value}" for key, value in LOOSENED.items() if value]
    weak = call(
        "check", file, *settings, "--set=output.tip_off=[]", "--set=requirement=[]",
        "--set=spring.push.force_N=1.0", "--set=dispersion={}",
    )  # fmt: skip
    assert "joint.bolt is not released to slider (its release is optional) in the" in weak.stderr


def test_check_passes_over_a_spring_without_a_nominal_stroke(file):
    """Only its dispersion gives it one: the nominal spring pushes on by its nature."""
    strokes = '--set=dispersion={"spring.push.stroke_m" = {uniform = [0.01, 0.5]}}'
    assert "end of its stroke" not in call("check", file, strokes).stderr


def test_a_release_that_must_come_says_what_may_be_done(file):
    """Without `optional` the case is never-released, whose sentence names releases."""
    sentence = Status.NEVER_RELEASED.sentence
    assert "[[release]]" in sentence
    assert "optional" in sentence
    text = file.read_text().replace("optional = true\n", "")
    (file.parent / "must.toml").write_text(text)
    with run_interpreted():
        called = call(
            "campaign", file.parent / "must.toml", "--out", file.parent / "must", "--no-plots"
        )
    assert "never-released: a phase had not ended" in called.output
    # what comes in all cases that are left is not told of
    assert "joint.bolt" not in read_manifest(file.parent / "must")["missing"]
