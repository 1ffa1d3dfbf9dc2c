"""`sepmc bench` from end to end, with few cases; nothing here depends on how fast the machine
is."""

import dataclasses
import importlib
import json
import time

import numpy as np
import pandas as pd
import pytest
from click.testing import CliRunner
from oracles.engine_race import tables
from oracles.engine_race.entry import Entry

import sepmc
from sepmc.bench import bench as of
from sepmc.bench import (
    bits,
    clock,
    command_stages,
    features,
    flops,
    row_errors,
    scaling,
    text,
    work_precision,
)
from sepmc.bench.folder import open_folder
from sepmc.bench.reference import make_reference
from sepmc.bench.study import Study, sample_inputs
from sepmc.campaign.execution.integration import by_name
from sepmc.campaign.execution.step_selection import select_steps
from sepmc.campaign.store.untrusted import StoreError
from sepmc.cli import app
from sepmc.kernel.spec.structure import make_kernel_spec

STAGES = ("import", "select steps", "kernel", "statistics")


def call(*arguments):
    return CliRunner().invoke(app.main, [str(a) for a in arguments])


def silent(_):
    """Nobody listens."""


def study_of(name, cases, threads=1, settings=None):
    campaign = sepmc.load(name, {"run.history_step_s": 0.0, **(settings or {})})
    return Study(
        campaign, select_steps(campaign), sample_inputs(campaign, cases), 1, threads, True, silent
    )


@pytest.fixture(scope="module")
def study():
    return study_of("table2", 100)


@pytest.fixture(scope="module")
def reference(study):
    return make_reference(study)


@pytest.fixture(scope="module")
def table(study, reference):
    return work_precision.measure(study, reference)


@pytest.mark.slow
@pytest.mark.parametrize(("name", "formulation"), [("table2", "reduced"), ("table1", "full")])
def test_command(name, formulation, tmp_path, monkeypatch):
    """Files, columns, marks, whichever formulation is the scene's own."""
    monkeypatch.setattr(scaling, "SIZES", (20, 40))
    # compiles for a minute; it has a test of its own
    monkeypatch.setattr(flops, "count", lambda *_: None)
    variants, kept = features._variants, 2 if formulation == "reduced" else 1  # a kernel each
    monkeypatch.setattr(features, "_variants", lambda *given: variants(*given)[:kept])
    if formulation == "full":
        took = [
            {"stage": s, "kind": "stage", "s": 1.0, "best_s": 1.0, "repeats": 1} for s in STAGES
        ]
        monkeypatch.setattr(command_stages, "measure", lambda *_: pd.DataFrame(took))
    out = tmp_path / "bench"
    result = call(
        "bench",
        name,
        "--quick",
        "--cases",
        40,
        "--repeats",
        1,
        "--out",
        out,
        "--set",
        f"solver.formulation={formulation}",
    )
    assert result.exit_code == 0, result.output
    parts = ["features", "scaling", "stages", "work_precision"]
    files = [f"{p}.{kind}" for p in (*parts, "row_errors") for kind in ("parquet", "png")]
    assert sorted(p.name for p in out.iterdir()) == sorted(["bench.json", *files])
    text = json.loads((out / "bench.json").read_text(encoding="utf-8"))
    assert {"campaign", "machine", "reference", "same_bits", "headlines", *parts} <= set(text)
    assert {"cpu", "compiled_for", "threads", "versions"} <= set(text["machine"])
    assert text["headlines"]["compiled for"] == text["machine"]["compiled_for"]
    assert all(text["same_bits"].values())
    frame = pd.read_parquet(out / "work_precision.parquet")
    assert frame["default"].sum() == 1
    assert (frame["ms"] > 0.0).all()
    assert set(frame["formulation"]) == {"reduced", "full"}
    assert (frame["scaled"] == (frame["formulation"] == "full")).all()
    chosen = frame[frame["default"]].iloc[0]
    assert (chosen["formulation"], text["formulation"]) == (formulation, formulation)
    assert f"threads, {formulation} formulation" in result.output
    assert chosen["error"] < 1e-8
    assert {"feature", "time_ratio", "flop_ratio"} <= set(pd.read_parquet(out / "features.parquet"))
    assert {"over", "cases", "threads", "kernel_s", "peak_MB"} <= set(
        pd.read_parquet(out / "scaling.parquet")
    )
    assert set(STAGES) <= set(pd.read_parquet(out / "stages.parquet")["stage"])
    again = call("bench", name, "--out", out)
    assert (again.exit_code, "--overwrite" in again.stderr) == (2, True)


@pytest.mark.parametrize("name", ["table2", "spring-pushers"])
def test_same_bits(name):
    """On any number of threads, in any chunks and order."""
    from sepmc.engine.threads import max_threads

    result = bits.same_bits(study_of(name, 60, max_threads()))
    assert len(result) == 4
    assert all(result.values()), result


def test_reference(study, reference):
    assert reference.valid.all()
    assert reference.change < 1e-11
    assert reference.difference < 1e-10
    assert (
        study.error_of(reference.outcomes, reference.valid, reference.outcomes, reference.valid)[0]
        == 0.0
    )


def test_error_counts_the_worst_case(study, reference):
    off = reference.outcomes[:3].copy()
    off[2, 4] += 1e-3 * np.abs(reference.outcomes[:, 4]).max()
    error, worst = study.error_of(off, np.ones(3, dtype=bool), reference.outcomes, reference.valid)
    assert worst == study.names[4]
    assert error > 1e-4
    assert (
        study.error_of(off, np.array([True, True, False]), reference.outcomes, reference.valid)[0]
        == 0.0
    )
    assert (
        study.error_of(off, np.zeros(3, dtype=bool), reference.outcomes, reference.valid)[0]
        == np.inf
    )


def test_more_steps_are_more_exact(table):
    own = table[(table["formulation"] == "reduced") & (table["method"] == "auto")]
    assert own["error"].iloc[0] > 10.0 * own["error"].iloc[-1]
    assert not own["scaled"].any()


def test_full_flies_as_the_reduced_does(table, reference):
    """In the same steps the same errors, by fewer cases."""
    of = {
        name: rows.set_index("requested")
        for name, rows in table[table["requested"].notna()].groupby("formulation")
    }
    assert of["full"]["scaled"].all()
    assert set(of["full"].index) == set(of["reduced"].index)
    assert (of["full"]["error"] <= 1.5 * of["reduced"]["error"].clip(lower=reference.floor)).all()


def test_step_that_is_given():
    """Is flown as it is, and divided."""
    study = study_of("table2", 20, settings={"solver.step_s": 0.1})
    reference = make_reference(study)
    table = work_precision.measure(study, reference)
    assert list(table["setting"][table["formulation"] == "reduced"]) == [
        "step 0.1 s",
        "step 0.05 s",
        "step 0.025 s",
    ]
    assert list(table["setting"][table["formulation"] == "full"]) == ["step 0.1 s"]
    assert table["default"].tolist() == [True, False, False, False]
    assert table["error"].iloc[0] > 10.0 * table["error"].iloc[2]


def test_features_change_the_scene(study):
    """A removed feature and its dispersions are gone; an indispensable one is reported."""
    variants = {v.feature: v.campaign for v in features._variants(study, 0.01)}
    assert {
        features.ALL,
        "aerodynamics",
        "atmosphere",
        "wind",
        "gravity",
        "motors",
        "histories",
    } == set(variants)
    assert all(body.aerodynamics is None for body in variants["aerodynamics"].scene.body.values())
    assert not variants["motors"].scene.motor
    assert not any(
        d.parameter.path.startswith("motor.") for d in variants["motors"].file.dispersions
    )
    assert variants["wind"].scene.environment.wind.speed == 0.0
    assert variants["histories"].scene.run.history_step == 0.01


CODE = """
define linkonce_odr i32 @rates_free(ptr %w) {
entry:
  %a = fmul contract <8 x double> %x, %y
  %b = fadd contract <8 x double> %a, %y
  %c = tail call contract <8 x double> @llvm.sqrt.v8f64(<8 x double> %b)
  %d = tail call contract <8 x double> @llvm.fabs.v8f64(<8 x double> %c)
  %e = fdiv <8 x double> %d, %x
  %f = fcmp olt <8 x double> %e, %x
  ret i32 0
}
define linkonce_odr i32 @rates_pinned(ptr %w) {
loop:
  %i = phi i64 [ 0, %entry ], [ %next, %loop ]
  %a = fsub double %x, %y
  %b = fmul contract double %a, %y
  br i1 %more, label %loop, label %done
done:
  ret i32 0
}
"""


def test_flops_in_code():
    """Vectors of all lanes, and a loop over single ones."""
    result = [flops.flops_in_llvm(CODE, f"rates_{phase}") for phase in ("free", "pinned", "gone")]
    assert result == [4.0, 2.0, None]


@pytest.mark.slow
def test_flops_of_a_case(study):
    steps, names = np.array([1, 1, 1]), ["tp7", "sharp9", "sharp9"]
    methods = by_name(study.integration.kernel, names)
    flight = dataclasses.replace(
        study.integration, steps=steps, durations=np.full(3, np.inf), methods=methods
    )
    assert flight.method_names == names
    counted = flops.count(study.campaign, flight)
    assert set(counted.evaluations) == set(counted.each) == {"locked", "guided", "free"}
    assert (counted.evaluations["locked"], counted.evaluations["free"]) == (9, 15)
    assert 300.0 < counted.evaluation < 3000.0
    active = [
        make_kernel_spec(study.campaign.layout).active_size(segment)
        for segment in make_kernel_spec(study.campaign.layout).segments
    ]
    assert counted.sums > 12 * sum(active)


def test_peers_beside_ours(study, reference, monkeypatch):
    outcomes = dict(
        zip(
            study.names,
            (reference.outcomes * [c.scale for c in study.campaign.outcome_columns])[:4].T,
            strict=True,
        )
    )
    entry = Entry("other", "exact", 4, 1, 0.5, 1e-3, 1, outcomes, True, "")
    monkeypatch.setattr(tables, "race", lambda *_: [entry])
    frame = tables.measure(study, reference)
    assert set(frame["engine"]) == {"sepmc", "other"}
    other = frame[frame["engine"] == "other"].iloc[0]
    assert other["error"] < 1e-13
    assert other["ms"] == pytest.approx(10_000.0)
    assert other["scaled"]


def test_unknown_peers_are_left_out(study, reference, monkeypatch):
    """Each with a sentence, before anything is flown; ours stay."""
    # the package's name for it is the function
    race = importlib.import_module("oracles.engine_race.race")

    def missing(name):
        raise ImportError(name)

    monkeypatch.setattr(race.importlib, "import_module", missing)
    monkeypatch.setattr(
        tables, "QUICK", {"scipy": 0} | dict.fromkeys(("heyoka", "mujoco", "exudyn"), 1)
    )
    frame = tables.measure(study, reference)
    assert set(frame["engine"]) == {"sepmc"}
    reported = race.left_out(tables.QUICK)
    assert sum("is left out: not installed, or too old" in text for text in reported) == 3
    assert "scipy is left out: not in a quick look" in reported


@pytest.mark.parametrize(
    ("arguments", "says"),
    [
        (("no-such-scene",), "no such file"),
        (("table2", "--threads", 100_000), "threads = 100000"),
        (("table2", "--overwrite"), "--overwrite needs --out"),
        (("table2", "--cases", 0), "--cases"),
        (("table2", "--set", "body.upper.mass_kg=-3"), "must be > 0"),
    ],
)
def test_bad_input(arguments, says, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    result = call("bench", *arguments)
    assert result.exit_code == 2
    assert says in result.stderr
    assert not (tmp_path / "runs").exists()


def test_folders(tmp_path):
    """Only what a bench has written is replaced."""
    (tmp_path / "notes.txt").write_text("mine", encoding="utf-8")
    with pytest.raises(StoreError, match=r"no bench\.json"):
        open_folder(tmp_path, overwrite=True)
    with pytest.raises(StoreError, match="is a file"):
        open_folder(tmp_path / "notes.txt")
    folder = open_folder(tmp_path / "bench")
    (folder / "bench.json").touch(), (folder / "old.png").touch(), (folder / "notes.txt").touch()
    with pytest.raises(StoreError, match="--overwrite"):
        open_folder(folder)
    assert [p.name for p in open_folder(folder, overwrite=True).iterdir()] == ["notes.txt"]


def test_rounds_take_turns():
    order = []
    result = clock.rounds({"a": lambda: order.append("a"), "b": lambda: order.append("b")}, 2)
    assert order == list("ababab")
    assert {name: len(times) for name, times in result.items()} == {"a": 2, "b": 2}


def test_long_tasks_are_repeated_less(monkeypatch):
    """Once at least, besides the first time."""
    monkeypatch.setattr(clock, "_MAX_S", 0.05)
    result = clock.rounds({"long": lambda: time.sleep(0.03), "short": lambda: None}, 4)
    assert [len(result[name]) for name in ("long", "short")] == [1, 4]


def test_defaults():
    assert (of.CASES, of.REPEATS) == (10_000, 7)


def test_spread():
    assert clock.spread([1.0, 1.0, 1.0, 5.0]) == pytest.approx(1.0)
    assert clock.spread([2.0, 2.0, 2.0]) == 0.0
    assert np.isnan(clock.spread([2.0]))


@pytest.mark.parametrize(("spread", "warns"), [(0.02, False), (0.4, True), (np.nan, False)])
def test_noise_warning(spread, warns):
    frame = pd.DataFrame({"spread": [spread, spread, 9.0 if warns else spread]})
    reported = text.noise_warning("features", frame)
    assert ("is 40 % of their median" in reported) == warns
    assert bool(reported) == warns


@pytest.mark.parametrize(("speed_up", "warns"), [([1.0, 1.9], False), ([1.0, 0.9], True)])
def test_threads_warning(speed_up, warns):
    frame = pd.DataFrame({"threads": [2.0, 1.0, 2.0], "speed_up": [np.nan, *speed_up]})
    rendered = text.warnings("scaling", frame)
    assert [message.partition(":")[0] for message in rendered] == ["warning"] * warns
    assert not warns or "2 threads are 0.90 times as fast as one" in rendered[0]
    assert text.threads_warning(frame[:2]) == ""


def test_parts_are_written_at_once(tmp_path, monkeypatch):
    """A bench that stops leaves what it has measured."""

    def stop(*_):
        raise KeyboardInterrupt

    monkeypatch.setattr(features, "measure", stop)
    campaign = sepmc.load("table2", {"run.history_step_s": 0.0})
    with pytest.raises(KeyboardInterrupt):
        of.bench(campaign, tmp_path / "b", silent, cases=40, repeats=1, threads=1, quick=True)
    text = json.loads((tmp_path / "b" / "bench.json").read_text(encoding="utf-8"))
    assert {"work_precision", "error_column", "machine"} <= set(text)
    assert pd.read_parquet(tmp_path / "b" / "row_errors.parquet")["error"].between(0, 1e-9).all()


def test_cases_without_errors_have_no_ratio():
    """As a case in which nothing acts; and an error that no estimate shows is infinite."""
    reported = row_errors.ratio_summary(
        np.array([0.0, 1.0, 2.0, 0.0]), np.array([0.0, 2.0, 2.0, 1])
    )
    names = ("1_percent", "median", "99_percent", "max")
    assert [reported[f"true_over_estimated_{name}"] for name in names] == [0.0, 0.5, 1.0, 1.0]
    reported = row_errors.ratio_summary(np.ones(3), np.array([0.0, 1.0, 0.0]))
    assert [reported[f"true_over_estimated_{name}"] for name in names] == [1.0, *[np.inf] * 3]


def test_rows_tell_their_errors(study, reference):
    """True errors of all cases lie below three times what their rows tell."""
    frame, reported = row_errors.measure(study, reference)
    assert len(frame) == reported["cases"] == 100
    median, maximum = (reported[f"true_over_estimated_{name}"] for name in ("median", "max"))
    assert 0.0 < median < maximum < 3.0
    assert reported["largest_true_error"] == frame["true_error"].max()
    assert set(frame["outcome"]) <= set(study.names)
    assert reported["n_refined"] <= 2
    assert f"{reported['n_refined']} of 100 cases were refined" in row_errors.sentence(reported)
