"""Random scenes: correct runs pass, planted faults are found and reduced, and every scene that
failed once is run."""

import copy
import os
import re
import subprocess
import sys
import time
import tomllib
import warnings
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest
from oracles.independent import simulate
from oracles.random_scenes import compare, run, workers
from oracles.random_scenes.dispersions import kind_of, paths
from oracles.random_scenes.equivalent_scenes import EQUIVALENTS, equivalent_column
from oracles.random_scenes.interpreted import run_interpreted
from oracles.random_scenes.rng import RandomStream
from oracles.random_scenes.scenes import LATE, scene
from oracles.random_scenes.shrink import shrink
from oracles.random_scenes.workers import judge_all

from sepmc.campaign.campaign import Campaign
from sepmc.campaign.execution import step_selection
from sepmc.scene.messages import InputError, SceneError
from sepmc.scene.read import parse_campaign

COMPILED = (10, 47)  # seeds of kernels that compile in seconds
# Scenes that run in seconds each and together have every feature: a minimal set of many.
SEEDS = (1006, 1014, 1016, 1026, 1030, 1051, 1101, 1395, 1398, 420003, 420009, 420021, 420038)
# Quick scenes of named kinds: triggered motors, directions, optional releases, late thrust.
NAMED = ("release", "ignition", "optional", "direction", "late profile")
NAMED_SEEDS = (3000, 3051, 3061, 3085, 3088, 3137)
ENTRY_POINT_SEEDS = (1006, 1014, 1016)
FOUND_SCENES = sorted((Path(__file__).parents[1] / "scenes").glob("*.toml"))

# Two bodies with a spring between them: planted faults must be found in a small scene.
SMALL = {
    "environment": {"atmosphere": "none", "gravity": "none"},
    "body": {
        "fore": {"mass_kg": 3.0, "inertia_kg_m2": [1.0, 2.0, 2.5], "cg_m": [1.0, 0.0, 0.0]},
        "aft": {"mass_kg": 2.0, "inertia_kg_m2": [1.0, 1.5, 2.0], "cg_m": [3.0, 0.02, 0.0]},
    },
    "spring": [
        {
            "name": "push",
            "bodies": ["fore", "aft"],
            "point_m": [2.0, 0.1, 0.0],
            "axis": [-1, 0, 0],
            "force_N": 20.0,
        }
    ],
    "joint": {"pins": {"bodies": ["fore", "aft"], "point_m": [2.0, 0.0, 0.0]}},
    "phase": [
        {"name": "locked", "joints": {"pins": "fixed"}, "until": {"time_s": 0.05}},
        {
            "name": "guided",
            "joints": {"pins": "slider"},
            "until": {"joint": "pins", "stroke_m": 0.02},
        },
        {"name": "clear"},
    ],
    "initial": {"altitude_m": 100.0, "speed_m_s": 30.0, "omega_deg_s": [5.0, 3.0, -4.0]},
    "run": {"end_time_s": 0.4},
    "solver": {"accuracy": 1e-7},
    "dispersion": {"spring.push.force_N": {"uniform": 2.0}, "body.aft.mass_kg": {"uniform": 0.1}},
}


def test_a_seed_gives_one_scene():
    assert scene(5) == scene(5) != scene(6)


def test_scenes_are_rarely_refused_and_have_every_feature():
    """Of 120 scenes without later kinds hardly one is refused; all joint kinds, ends and most kinds
    of number occur."""
    refused, kinds, ends, dispersed, all_paths = 0, set(), set(), set(), set()
    for seed in range(120):
        tree = scene(seed, ())
        try:
            with warnings.catch_warnings():
                warnings.simplefilter("ignore")
                campaign = Campaign(parse_campaign(tree, f"seed {seed}"))
        except SceneError:
            refused += 1
            continue
        kinds |= {kind for phase in tree["phase"] for kind in phase["joints"].values()}
        ends |= {key for phase in tree["phase"] for key in phase.get("until", {})}
        by_name = {".".join(path.parts): kind_of(path) for path in paths(campaign.scene)}
        all_paths |= set(by_name.values())
        dispersed |= {by_name[d.parameter.path] for d in campaign.file.dispersions}
    assert refused <= 4
    assert {
        "fixed",
        "slider",
        "revolute",
        "cylindrical",
        "universal",
        "spherical",
        "planar",
        "rod",
    } <= kinds
    assert {"point-on-line", "point-on-plane", "free"} <= kinds
    assert {"time_s", "stroke_m", "distance_m", "angle_deg", "altitude_m", "burn_out"} <= ends
    assert {
        "motor.*.burn",
        "motor.*.build_up",
        "motor.*.tail_off",
        "spring.*.stroke",
        "load.*.end",
        "joint.*.delay",
    } <= dispersed
    settings = {path for path in all_paths if path.startswith(("run.", "solver."))}
    assert len(dispersed) > 0.75 * len(all_paths - settings)


def test_later_kinds_occur_and_are_read():
    """Of 30 scenes with all later kinds hardly one is refused; all kinds occur, and the columns of
    equivalent scenes are known."""
    refused, result = 0, set()
    for seed in range(30):
        tree = scene(seed, LATE)
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")
            nominal = tree | {"dispersion": {}}
            try:
                parse_campaign(tree, f"seed {seed}")
                campaign = Campaign(parse_campaign(nominal, f"seed {seed}"))
            except SceneError:
                refused += 1
                continue
            renamed = EQUIVALENTS["other names"](copy.deepcopy(nominal), RandomStream(1))
            other = Campaign(parse_campaign(renamed, "renamed"))
        known = {column.name for column in other.outcome_columns}
        assert {
            equivalent_column(column.name, "other names", tree)
            for column in campaign.outcome_columns
        } <= known
        result |= set(compare.features(tree))
    assert refused <= 2
    assert {
        "until any",
        "until all",
        "until force",
        "until moment",
        "release",
        "proximity",
        "clearance",
    } <= result
    assert {
        "wind profile",
        "table of the air",
        "aerodynamic table",
        "guide",
        "guide friction",
    } <= result
    assert {f"output {kind}" for kind in ("loads", "guide", "tip_off", "transverse")} <= result


def test_later_kinds_leave_the_rest_of_a_seed():
    """Later kinds come from a random stream of their own, and most scenes have none."""
    same = [seed for seed in range(40) if scene(seed) == scene(seed, ())]
    assert 20 <= len(same) < 40


@pytest.mark.parametrize("variant", EQUIVALENTS)
def test_equivalent_scenes_are_accepted(variant):
    """The parser accepts every equivalent scene."""
    tree = {key: value for key, value in copy.deepcopy(SMALL).items() if key != "dispersion"}
    parse_campaign(EQUIVALENTS[variant](tree, RandomStream(1)), variant)


def test_faults_are_distinguished():
    """Verdicts beside a reference that is right, off by 1e-3, of another status, does not know the
    scene, or fails."""

    def reference(status, share):
        return lambda case, rtol=1e-12: SimpleNamespace(
            status=status,
            outcomes=_times(simulate(case).outcomes, 1.0 + share),
            indeterminate=(),
            reached={},
        )

    def broken(error):
        def reference(case, rtol=1e-12):
            raise error

        return reference

    with run_interpreted():
        assert compare.judge(SMALL, "right", 2, reference("ok", 0.0)).rows == {"same": 2}
        off = compare.judge(SMALL, "off", 2, reference("ok", 1e-3))
        assert off.rows == {"silent": 2}
        assert off.fails
        assert compare.judge(SMALL, "another", 2, reference("never-released", 0.0)).rows == {
            "status": 2
        }
        unknown = compare.judge(SMALL, "unknown", 2, broken(ValueError("motor.x")))
        assert "motor.x" in unknown.not_flown
        assert not unknown.fails
        assert "KeyError" in compare.judge(SMALL, "broken", 2, broken(KeyError("y"))).crash


def test_the_time_of_a_flat_peak_may_be_any_on_it():
    """Times of peaks count from the nearest time at which the peak is reached; NaN stays NaN."""
    flown = SimpleNamespace(reached={"pins_peak_force_time_s": (0.1, 0.2)})
    columns = [
        SimpleNamespace(name="pins_peak_force_time_s"),
        SimpleNamespace(name="release_time_s"),
    ]
    for result, expected in ((0.05, 0.1), (0.15, 0.15), (0.3, 0.2), (np.nan, 0.12)):
        assert compare.nearest_reached(
            flown, np.array([result, 0.3]), np.array([0.12, 0.4]), columns
        ).tolist() == [expected, 0.4]


def _times(outcomes, share):
    return {name: value * share for name, value in outcomes.items()}


@pytest.mark.slow
@pytest.mark.parametrize(
    "planted",
    [
        pytest.param((r"vec3\.scale\(-force", "vec3.scale(force"), id="spring on the first body"),
        pytest.param((r"vec3\.sub\(vec3\.add\(", "vec3.add(vec3.add("), id="gyroscopic moment"),
    ],
)
def test_a_planted_fault_is_found(planted, monkeypatch):
    """A sign changed in the text of a kernel: rows that passed are silent faults, and the scene is
    reduced with the fault."""
    text = step_selection.kernel_text

    def wrong(*given, **named):
        lines, count = re.subn(*planted, text(*given, **named))
        assert count, "nothing to plant a fault in"
        return lines

    with run_interpreted():
        assert compare.judge(SMALL, "right", 2).rows == {"same": 2}
        monkeypatch.setattr(step_selection, "kernel_text", wrong)
        assert compare.judge(SMALL, "planted", 2).rows == {"silent": 2}
        assert "dispersion" not in shrink(SMALL, 1, 8)


@pytest.mark.slow
def test_random_scenes():
    """Random scenes, interpreted, agree with the independent simulation; some are compared by their
    entry points too. These scenes have all features of a hundred."""
    kinds = {seed: set(compare.features(scene(seed))) for seed in (*SEEDS, *range(1000, 1100))}
    flown = [kinds[seed] for seed in SEEDS]
    flown += [set(compare.features(scene(seed, kinds=NAMED))) for seed in NAMED_SEEDS]
    assert set().union(*flown) >= set().union(*kinds.values())
    jobs = [{"seed": seed, "cases": 1, "entry_points": seed in ENTRY_POINT_SEEDS} for seed in SEEDS]
    result = list(judge_all(jobs))
    assert not [v for v in result if run.fails(v) or v.get("not_flown")], run.table(result)


@pytest.mark.slow
def test_random_scenes_of_named_kinds():
    """Every scene has the named kinds where they apply; some releases never occur."""
    trees = [scene(seed, kinds=NAMED) for seed in NAMED_SEEDS]
    assert all("release" in tree for tree in trees)
    assert {
        "ignition at event",
        "ignition at joint",
        "ignition at release",
        "late profile",
        "release optional",
        "until direction",
        "until vertical_speed",
    } <= set().union(*map(compare.features, trees))
    result = list(judge_all([{"seed": s, "cases": 1, "kinds": NAMED} for s in NAMED_SEEDS]))
    assert not [v for v in result if run.fails(v) or v.get("not_flown")], run.table(result)
    assert {"ok", "never-released"} == set().union(*(v["statuses"] for v in result))


def test_an_unknown_kind_is_refused():
    with pytest.raises(InputError, match=r"optionl.*optional"):
        run.judge_scenes(1, kinds=["optionl"])


def test_a_swapped_joint_leaves_the_spring_along_it():
    """Joint and spring may share one list of bodies: the equivalent scene runs the same."""
    tree = copy.deepcopy(SMALL)
    tree["spring"][0]["bodies"] = tree["joint"]["pins"]["bodies"]
    tree["phase"][1]["until"] = {"time_s": 0.1}
    turned = EQUIVALENTS["bodies of joints and springs swapped"](
        copy.deepcopy(tree), RandomStream(1)
    )
    assert turned["joint"]["pins"]["bodies"] == ["aft", "fore"]
    assert turned["spring"][0]["bodies"] == ["fore", "aft"]


@pytest.mark.slow
def test_compiled_scenes():
    """Compiled kernels agree as well."""
    result = list(judge_all([{"seed": seed, "compiled": True} for seed in COMPILED]))
    assert not [v for v in result if run.fails(v) or v.get("not_flown")], run.table(result)
    assert all(v["compiled"] for v in result)


@pytest.mark.slow
@pytest.mark.parametrize("path", FOUND_SCENES, ids=lambda path: path.stem)
def test_a_scene_that_failed_once(path):
    """A scene that failed before, reduced, run as random scenes are."""
    with run_interpreted(cases=2):
        verdict = compare.judge(tomllib.loads(path.read_text(encoding="utf-8")), path.stem, 2)
    assert not verdict.not_flown
    assert not verdict.fails, "\n".join([verdict.crash, *verdict.said])


def test_a_scene_that_takes_too_long_is_compiled(monkeypatch):
    """A scene that takes too long interpreted is judged compiled and counted there; if that takes
    too long as well, it is listed by its seed, and none of its rows counts as same."""
    late = [{"seed": 5, "cases": 2}]
    (verdict,) = judge_all(late, processes=1, limit_s=0.05)
    assert verdict["compiled"]
    assert verdict["rows"]["same"] == 2
    text = run.table([verdict])
    assert "1 scenes were compiled since they took too long interpreted" in text

    monkeypatch.setattr(workers, "COMPILED_LIMIT_S", 0.05)
    result = list(judge_all(late, processes=1, limit_s=0.05))
    assert [v["not_flown"] for v in result] == ["no verdict within 0.05 s"]
    assert not any(map(run.fails, result))
    text = run.table(result)
    assert "not compared: 1 x no verdict within 0.05 s (seeds 5)" in text
    assert text.splitlines()[1].split() == ["all", *["0"] * (len(text.splitlines()[1].split()) - 1)]


@pytest.mark.parametrize(
    ("decided", "rows"),
    [({"rows": {"same": 2}, "crash": ""}, {"same": 2}), (None, {"silent": 1})],
    ids=["with user's steps", "too late"],
)
def test_a_fault_beyond_the_time_limit_stays_a_fault(monkeypatch, decided, rows):
    """A fault with few calibration cases is repeated with the step selection of users, with a
    longer limit; without a verdict it stays a fault."""
    requests = []

    class Worker:
        def __init__(self, limit_s):
            self.stopped = True

        def judge(self, job, limit_s=1.0):
            requests.append((job.get("compiled", False), limit_s))
            return decided if job.get("compiled") else {"rows": {"silent": 1}, "crash": ""}

        def close(self):
            pass

        kill = close

    monkeypatch.setattr(workers, "Worker", Worker)
    result = list(workers.judge_all([{"seed": 5, "cases": 1}], processes=1, limit_s=1.0))
    assert [v["rows"] for v in result] == [rows]
    assert run.fails(result[0]) == ("silent" in rows)
    assert requests == [(False, 1.0), (True, workers.COMPILED_LIMIT_S)]


@pytest.mark.slow
@pytest.mark.skipif(not hasattr(os, "fork"), reason="no copies of processes")
def test_a_fork_ends_with_its_parent():
    """A fork in a long run ends with its parent."""
    asks = (
        "import time\nfrom oracles.random_scenes import worker\n"
        "def work(job):\n    print(1, flush=True)\n    time.sleep(60.0)\n"
        "worker.work = work\nworker._judge_in_fork({'limit_s': 60.0})"
    )
    command, environment = [sys.executable, "-c", asks], workers.environment()
    with subprocess.Popen(command, stdout=subprocess.PIPE, text=True, env=environment) as one:
        assert one.stdout.readline()  # the copy is at work
        one.kill()
        begun = time.monotonic()
        one.stdout.read()  # ends as the last of them does
    assert time.monotonic() - begun < 30.0
