"""A case of a run flown again: the one that is asked for, its row to the last bit, its film."""

import shutil

import numpy as np
import pandas as pd
import pytest
from click.testing import CliRunner
from PIL import Image

import sepmc
from sepmc.campaign.store import ledger, manifests, shards
from sepmc.cli.app import main
from sepmc.cli.figures import event_times
from sepmc.report import animation, history_figures
from sepmc.report.animation import _Frame
from sepmc.report.poses import poses
from sepmc.report.style import make_axes


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    """A run of cases 5 to 44 of Table 2, with a requirement."""
    folder = tmp_path_factory.mktemp("replay") / "run"
    required = {"name": "slow", "metric": "separation_speed_m_s", "at_most": 0.6}
    sepmc.load("table2.toml", {"requirement": [required]}).run("5:45", out=folder)
    return folder


def command(*words):
    """Exit code and output of a command."""
    called = CliRunner().invoke(main, [str(word) for word in words])
    assert called.exception is None or isinstance(called.exception, SystemExit), called.output
    return called.exit_code, called.output


def values(folder, outcome):
    """An outcome by the number of its case."""
    return pd.read_parquet(folder / "cases").set_index("case")[outcome]


@pytest.mark.slow
@pytest.mark.parametrize(
    ("words", "which"),
    [
        (["--min", "upper_pitch_deg"], lambda f: values(f, "upper_pitch_deg").idxmin()),
        (["--max", "upper_pitch_deg"], lambda f: values(f, "upper_pitch_deg").idxmax()),
        (["--worst", "slow"], lambda f: values(f, "separation_speed_m_s").idxmax()),
        (["--worst", "separation_speed_m_s"], lambda f: values(f, "separation_speed_m_s").idxmax()),
        (
            ["--nearest", "upper_pitch_deg:p50"],
            lambda f: (
                (values(f, "upper_pitch_deg") - values(f, "upper_pitch_deg").median())
                .abs()
                .idxmin()
            ),
        ),
        (
            ["--nearest", "upper_pitch_deg:0.25"],
            lambda f: (values(f, "upper_pitch_deg") - 0.25).abs().idxmin(),
        ),
        (["--case", 44], lambda f: 44),
    ],
)
def test_the_case_that_is_asked_for(folder, tmp_path, words, which):
    """The worst, least, greatest, nearest or named case is flown again, and its row comes out the
    same; its outcomes alone agree with the row to the accuracy of both."""
    out = tmp_path / "case"
    code, message = command("replay", folder, *words, "--out", out, "--no-plots", "--every-s", 0.01)
    number = int(which(folder))
    assert (code, f"row {number} is the same bit by bit" in message) == (0, True), message
    manifest = manifests.read_manifest(out)
    assert manifest["case"] == number
    row = shards.read_row(folder, number)
    for name in ("separation_speed_m_s", "upper_omega_x_deg_s"):
        assert manifest["outcomes"][name] == pytest.approx(row[name], rel=1e-7)


def test_a_row_that_was_changed(folder, tmp_path):
    """One bit in one column of a row is found, and named, though the checksum is of what is
    there."""
    folder = shutil.copytree(folder, tmp_path / "run")
    manifest, (one,) = manifests.read_manifest(folder), shards.entries(folder, "cases")
    table = pd.read_parquet(folder / one.file)
    table.loc[table["case"] == 7, "upper_pitch_deg"] *= 1.0 + 2.0**-52
    table.to_parquet(folder / one.file)
    words = ("--case", 7, "--out", tmp_path / "a", "--no-plots", "--every-s", 0.01)
    code, message = command("replay", folder, *words)
    assert (code, "was changed" in message) == (2, True), message
    content = (folder / one.file).read_bytes()
    ledger.add(folder, ledger.make_entry(one.file, content, one.first, one.cases))
    manifests.seal(folder, manifest)
    code, message = command("replay", folder, *words, "--overwrite")
    assert (code, "row 7 differs in 1 columns: upper_pitch_deg" in message) == (1, True), message


@pytest.mark.parametrize(
    ("words", "message"),
    [
        (["--case", 4], "contains cases 5:45; --case 4 is none of them"),
        ([], "one of --case, --worst"),
        (["--case", 5, "--min", "upper_pitch_deg"], "one of --case, --worst"),
        (["--min", "upper_pich_deg"], "did you mean 'upper_pitch_deg'"),
        (["--worst", "slowly"], "no such requirement; did you mean 'slow'"),
        (["--nearest", "upper_pitch_deg"], "must be OUTCOME:p99.73"),
        (["--nearest", "upper_pitch_deg:p101"], "must be a percentile from p0 to p100"),
    ],
)
def test_what_replay_refuses(folder, words, message):
    """What there is not is told before anything is flown."""
    code, text = command("replay", folder, *words)
    assert (code, message in text) == (2, True), text


def test_replay_needs_a_run():
    """What is no run folder is told."""
    code, text = command("replay", "table2", "--case", 1)
    assert (code, "give the folder of a run" in text) == (2, True), text


def test_film(folder, tmp_path, monkeypatch):
    """The film has its frames, in which something moves; bodies stand where the history has them:
    while the joint is locked, their copies of its point coincide, and later its gap lies between
    them."""
    monkeypatch.setattr(animation, "FRAMES", 3)
    campaign = sepmc.load(folder)
    case = campaign.case(9)
    history = campaign.simulate(case, 0.05)
    path = animation.animate(history, case.scene, "title", tmp_path / "animation.gif")
    with Image.open(path) as film:
        assert film.n_frames == 3
        frames = []
        for number in range(3):
            film.seek(number)
            frames.append(np.asarray(film.convert("RGB")).astype(int))
    assert np.abs(frames[0] - frames[2]).max() > 100
    joint = case.scene.joint["pins"]
    for row in (0, len(history) - 1):
        frame = _Frame(history, poses(history, case.scene), case.scene, row)
        first, second = (frame.in_view(body, np.array([joint.point]))[0] for body in joint.bodies)
        gap = [history[f"pins_gap_{axis}_m"].iloc[row] for axis in "xyz"]
        own = frame.rotations[joint.bodies[0]].apply(gap) * [-1.0, 1.0, 1.0]
        assert second - first == pytest.approx(own, abs=1e-9)
    assert gap[0] < -0.02


def test_a_single_flight_has_no_rows(tmp_path):
    """It is refused before anything is flown."""
    command("run", "table1.toml", "--out", tmp_path / "one", "--no-plots", "--every-s", 0.1)
    code, message = command("replay", tmp_path / "one", "--case", 0)
    assert code == 2
    assert "contains a single case; give the folder of a campaign" in message


# a hinge of which a release, apart from the only phase, lets go
_LETS_GO = {
    "phase": [{"name": "only", "joints": {"pins": "revolute"}}],
    "release": [{"name": "cut", "joint": "pins", "when": {"time_s": 0.2}}],
    "event": [{"name": "late", "when": {"time_s": 0.4}}],
}


def test_film_shows_what_a_release_lets_go(pair):
    """A joint that a release frees within a phase is drawn as free from that instant on."""
    campaign = pair(_LETS_GO)
    history = campaign.simulate(step_s=0.05)
    assert history.attrs["releases"] == pytest.approx({"pins": 0.2})
    assert history.attrs["events"] == pytest.approx({"late": 0.4})
    locked = {
        float(history["time_s"].iloc[row]): bool(
            _Frame(history, poses(history, campaign.scene), campaign.scene, row).locked
        )
        for row in range(len(history))
    }
    assert all(holds == (time < 0.2 - 1e-9) for time, holds in locked.items()), locked


def test_film_shows_a_joint_that_never_lets_go(pair):
    """A joint without a release time is drawn as held to the end, though a phase frees it."""
    phases = [
        {"name": "locked", "joints": {"pins": "fixed"}, "until": {"time_s": 0.2}},
        {"name": "free", "joints": {}},
    ]
    campaign = pair({"phase": phases, "joint.pins.fails": 1})
    history = campaign.simulate(step_s=0.05)
    frame = _Frame(history, poses(history, campaign.scene), campaign.scene, len(history) - 1)
    assert frame.locked == {"pins"}
    assert "of pins on aft" in frame.caption or frame.largest_force == 0.0


def test_film_begins_at_the_size_of_the_vehicle(pair):
    """The view holds the vehicle at first, and widens only as its bodies part."""
    apart = {
        "phase": [{"name": "free", "joints": {}}],
        "load": [{"name": "push", "body": "aft", "force_N": [-1000.0, 0.0, 0.0]}],
    }
    campaign = pair(apart)
    history = campaign.simulate(step_s=0.01)
    frames = [
        _Frame(history, poses(history, campaign.scene), campaign.scene, row)
        for row in (0, len(history) - 1)
    ]
    views, length = animation._frame_views(frames, campaign.scene)
    widths = [high - low for low, high in (view[0] for view in views)]
    assert length == pytest.approx(2.0)  # from centre of mass to centre of mass
    assert widths[0] < 2.0 * length
    assert widths[1] > 50.0 * length


def test_figures_mark_releases_and_events(pair, tmp_path):
    """A release and an event within a phase have a line each, named in the legend."""
    history = pair(_LETS_GO).simulate(step_s=0.05)
    _figure, (ax,) = make_axes(1, 1, (4.0, 3.0))
    ax.set_xlim(0.0, 0.5)
    history_figures._mark(ax, event_times(history.attrs))
    _, names = ax.get_legend_handles_labels()
    assert names == ["release of pins (0.2 s)", "late (0.4 s)"]


def test_figures_mark_partial_releases(pair):
    """A release to another kind than free has its time and its line too."""
    loosened = {"name": "loosen", "joint": "pins", "to": "slider", "when": {"time_s": 0.1}}
    phase = [{"name": "only", "joints": {"pins": "fixed"}}]
    attributes = pair({"phase": phase, "release": [loosened]}).simulate(step_s=0.05).attrs
    assert attributes["partial_releases"] == pytest.approx({"pins.slider": 0.1})
    assert event_times(attributes) == pytest.approx({"release of pins to slider": 0.1})
