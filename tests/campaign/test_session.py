"""A session runs a design as a campaign with its values does, for all designs of a box."""

import pickle
from concurrent.futures import ProcessPoolExecutor
from multiprocessing import get_context

import numpy as np
import pandas as pd
import pytest

import sepmc
from sepmc.campaign import session as sessions
from sepmc.campaign.campaign import Campaign
from sepmc.campaign.execution.accuracy import errors, scene_scales, with_scales, with_scales_of
from sepmc.scene.read import parse_campaign
from sepmc.schema import Status

CASES = 300
# shipped campaigns and their designs: nominals of dispersed parameters, numbers that all cases
# share, and numbers from which another one follows (the pitch at which alpha_ref is zero)
BOXES = {
    "table2": {
        "motor.retro.thrust_N": (300.0, 700.0),
        "body.upper.mass_kg": (440.0, 480.0),
        "initial.pitch_deg": (0.0, 2.0),
    },
    "spring-pushers": {"spring.*.force_N": (400.0, 1600.0), "body.payload.mass_kg": (300.0, 500.0)},
}


@pytest.fixture(scope="module", params=BOXES)
def session(request):
    """Session of a shipped campaign."""
    return sepmc.load(request.param).session(BOXES[request.param])


def corner(session, *shares):
    """Design at fractions of the ranges."""
    shares = np.resize(shares, len(session.box.variables))
    return {v.key: v.at(t) for v, t in zip(session.box.variables, shares, strict=True)}


@pytest.mark.parametrize("shares", [(0.0,), (1.0,), (0.31, 0.77, 0.5)])
def test_design_has_the_rows_of_its_campaign(session, shares):
    design = corner(session, *shares)
    result, expected = (
        session.run(design, cases=CASES, seed=3),
        session.with_design(design).run(cases=CASES, seed=3),
    )
    table, rows = result.to_pandas(), expected.to_pandas()
    assert (table["status"] == rows["status"]).all()
    for column in expected.campaign.input_columns:
        values = rows[column.name]
        assert (table[column.name] - values).abs().max() <= 1e-15 * values.abs().max()
    columns = expected.campaign.outcome_columns
    units = [column.unit for column in columns]
    a, b = (
        np.column_stack([frame[c.name].to_numpy(float) / c.scale for c in columns])
        for frame in (table, rows)
    )
    scale = scene_scales(expected.campaign.scene, units)
    # each within the accuracy of its own steps
    decisive = [i for i, c in enumerate(columns) if c.unit not in ("", "s")]
    accuracy = session.campaign.scene.solver.accuracy
    assert np.nanmax(errors(a, b, scale)[:, decisive]) < 2.0 * accuracy
    assert result.accuracy.worst[1] < accuracy
    assert result.statistics().index.tolist() == expected.statistics().index.tolist()


def test_many_designs_have_the_bits_of_single_ones(session, monkeypatch):
    monkeypatch.setattr(sessions, "_ROWS", 4 * CASES)  # several calls, the last one smaller
    shares = np.linspace(0.0, 1.0, 10)
    designs = pd.DataFrame([corner(session, t, 1.0 - t, t * t) for t in shares])
    names = [column.name for column in session.box.outcome_columns[:3]]
    calls = []
    table = session.run_many(
        designs, cases=CASES, columns=names, progress=lambda *done: calls.append(done)
    )
    assert calls == [(4, 10), (8, 10), (10, 10)]
    assert table.summary[list(designs)].equals(designs)
    for k in (0, 3, 4, 9):
        single = session.run(designs.iloc[k].to_dict(), cases=CASES)
        assert (table.columns["status"][k] == single.block.status).all()
        for name in names:
            assert table.columns[name][k].tobytes() == single.column(name).tobytes()
        assert table.summary["ok"][k] == single.ok.sum()
        assert table.summary["error"][k] == single.block.error[single.ok].max()
    by_position = session.run_many(designs.to_numpy(), cases=CASES)
    assert by_position.summary.equals(table.summary)
    assert by_position.columns == {}


def test_threads_and_number_of_cases_do_not_change_a_row(session):
    design = corner(session, 0.4)
    many, few = session.run(design, cases=CASES), session.run(design, cases=7)
    one = session.campaign.session(
        dict.fromkeys(BOXES[session.campaign.name])
        | {v.key: (v.low, v.high) for v in session.box.variables},
        threads=1,
    ).run(design, cases=CASES)
    assert one.block.outcomes.tobytes() == many.block.outcomes.tobytes()
    assert few.block.outcomes.tobytes() == many.block.outcomes[:7].T.copy().T.tobytes()


def run_in_process(session, design):
    """Outcomes of a design, in another process."""
    return session.run(design, cases=20).block.outcomes.copy()


def test_session_works_in_other_processes():
    session = sepmc.load("table2").session(BOXES["table2"])
    design = corner(session, 0.6)
    expected = session.run(design, cases=20).block.outcomes
    assert pickle.loads(pickle.dumps(session)).run(design, cases=20).block.outcomes.tolist() == (
        expected.tolist()
    )
    with ProcessPoolExecutor(1, get_context("spawn")) as pool:
        outcome = pool.submit(run_in_process, session, design).result(timeout=120.0)
    assert outcome.tolist() == expected.tolist()


def test_scales_are_those_of_a_run():
    """Of the largest outcome of a unit, whether or not it has a requirement."""
    result = sepmc.load("table2").session(BOXES["table2"]).run([500.0, 460.0, 1.0], cases=200)
    rows, box = result.to_pandas(), result.box
    outcomes = rows.loc[rows["status"] == "ok", [c.name for c in box.outcome_columns]]
    from_cases = with_scales_of(box, {}, outcomes.to_numpy())
    from_statistics = with_scales(box, {}, result.statistics())
    assert from_cases.keys() == from_statistics.keys()
    for name, (_, scale) in from_cases.items():
        assert scale == pytest.approx(from_statistics[name][1], rel=0.01), name


def test_verdicts_are_those_of_a_run():
    file = sepmc.load("table2", {"run.history_step_s": 0.0}).file
    requirements = [
        {"name": "speed", "metric": "separation_speed_m_s", "at_least": 0.0},
        {"name": "free", "metric": "never-released"},
        {"name": "any", "metric": "violation"},
    ]
    light = sepmc.load("table2", {"body.upper.mass_kg": 450.0})
    speeds = light.run(cases=200).to_pandas()["separation_speed_m_s"]
    requirements[0]["at_least"] = float(speeds.median())
    campaign = Campaign(parse_campaign(file.tree | {"requirement": requirements}, "table2"))
    session = campaign.session({"body.upper.mass_kg": (440.0, 480.0)})
    result = session.run([450.0], cases=200)
    verdicts = session.with_design([450.0]).run(cases=200).requirements()
    expected = verdicts["violations"].tolist()
    assert 0 < expected[0] < 200
    brief = result.verdicts()
    assert brief["violations"].tolist() == expected
    assert brief["missing"].tolist() == verdicts["missing"].tolist()
    assert brief["verdict"].tolist() == verdicts["verdict"].tolist()
    full = result.requirements()
    assert full["violations"].tolist() == expected
    assert full["verdict"].tolist() == verdicts["verdict"].tolist()
    many = session.run_many([[450.0], [470.0]], cases=200).summary
    for name in verdicts.index:
        assert many[f"{name}_violations"][0] == verdicts.loc[name, "violations"]
        assert many[name][0] == verdicts.loc[name, "verdict"]
    assert (many["speed_missing"] == 0).all()


def test_designs_of_dependent_cases_have_no_verdict():
    tree = sepmc.load("table2", {"run.sampler": "sobol"}).file.tree
    item = {"name": "speed", "metric": "separation_speed_m_s", "at_least": 0.0}
    campaign = Campaign(parse_campaign(tree | {"requirement": [item]}, "table2"))
    session = campaign.session({"body.upper.mass_kg": (440.0, 480.0)})
    assert session.run([450.0], cases=64).verdicts()["verdict"].tolist() == ["no verdict"]


@pytest.mark.parametrize(
    ("vary", "message"),
    [
        ({}, "must be ranges by TOML path"),
        (["motor.retro.thrust_N"], "must be ranges by TOML path"),
        ({3: (1, 2)}, "must be a TOML path"),
        ({"motor.retro.thrust_N": 500.0}, "the lowest and the highest value"),
        ({"motor.retro.thrust_N": (500.0, 500.0)}, "must be finite and rising"),
        ({"motor.retro.thrust_N": (500.0, float("nan"))}, "must be finite and rising"),
        ({"motor.retro.thrust": (400.0, 500.0)}, "unit"),
        ({"motor.none.thrust_N": (400.0, 500.0)}, "none"),
        ({"motors.*.thrust_N": (400.0, 500.0)}, "no table has such a name"),
        ({"motor.*.thrust_N": (4, 5), "motor.retro.thrust_kN": (1, 2)}, "varied twice"),
        (
            {"body.upper.mass_kg": (-1.0, 5.0)},
            r"at the low end \(body\.upper\.mass_kg = -1\): .*> 0",
        ),
        ({"spring.*.factor": (0.5, 1.0)}, "no table has such a name"),
        ({"run.end_time_s": (0.4, 0.5)}, "setting of the scene"),
        ({"motor.retro.deflection_clock_deg": (0.0, 90.0)}, "absolute values"),
    ],
)
def test_boxes_that_cannot_be_are_refused(vary, message):
    campaign = sepmc.load("table2")

    def run():
        session = campaign.session(vary)
        session.run([v.low for v in session.box.variables], cases=5)

    with pytest.raises((sepmc.InputError, sepmc.SceneError), match=message):
        run()


@pytest.mark.parametrize(
    ("design", "message"),
    [
        ({"motor.retro.thrust_N": 500.0}, "needs a value of body.upper.mass_kg"),
        ({"motor.retro.thrust_kN": 0.5}, "is not varied"),
        ([500.0], "needs 3 values"),
        ([500.0, 450.0, 2.1], "initial.pitch_deg = 2.1: must lie in 0 to 2"),
        ([500.0, float("nan"), 1.0], "finite"),
        (["many", 450.0, 1.0], "must be numbers"),
    ],
)
def test_designs_outside_the_box_are_refused(design, message):
    session = sepmc.load("table2").session(BOXES["table2"])
    with pytest.raises(sepmc.InputError, match=message):
        session.run(design, cases=5)


def test_other_arguments_are_checked():
    session = sepmc.load("table2").session(BOXES["table2"])
    design = corner(session, 0.5)
    for arguments, message in (
        ({"cases": 0}, "cases = 0"),
        ({"seed": -1}, "seed"),
        ({"cases": 1.5}, "cases"),
    ):
        with pytest.raises(sepmc.InputError, match=message):
            session.run(design, **arguments)
    with pytest.raises(sepmc.InputError, match="separation_distance_mm"):
        session.run_many([list(design.values())], columns=["separation_distance"])
    with pytest.raises(sepmc.InputError, match="separation_distance_mm"):
        session.run(design, cases=3).column("separation_distance")
    with pytest.raises(sepmc.InputError, match="same number of values"):
        session.run_many({key: [value] * (k + 1) for k, (key, value) in enumerate(design.items())})


def test_tails_beyond_the_bounds_are_failed_cases():
    settings = {"dispersion.body.upper.mass_kg": {"normal": 200.0}}
    campaign = sepmc.load("table2", {"run.history_step_s": 0.0}).with_settings(settings)
    session = campaign.session({"body.upper.mass_kg": (300.0, 500.0)})
    result = session.run([300.0], cases=400, seed=1)
    expected = session.with_design([300.0]).run(cases=400, seed=1).to_pandas()
    assert (result.to_pandas()["status"] == expected["status"]).all()
    assert (result.block.status != Status.OK).sum() > 5


def test_wildcards_set_every_table_of_a_name():
    campaign = sepmc.load("spring-pushers")
    several = campaign.with_settings({"spring.*.force_N": 700.0})
    assert {spring.force for spring in several.scene.spring} == {700.0}
    upper = campaign.with_settings({"spring.upper_*.force_N": 700.0}).scene.spring
    assert {s.force for s in upper if s.name.startswith("upper_")} == {700.0}
    assert {s.force for s in upper if not s.name.startswith("upper_")} == {900.0}
    with pytest.raises(sepmc.SceneError, match="no table has such a name"):
        campaign.with_settings({"spring.none*.force_N": 700.0})
    with pytest.raises(sepmc.SceneError, match="an earlier key sets"):
        campaign.with_settings({"spring.upper_left.force_N": 1.0, "spring.*.force_N": 700.0})


def with_load():
    """Shipped springs with a load whose times are dispersed."""
    tree = sepmc.load("spring-pushers", {"run.history_step_s": 0.0}).file.tree
    load = {"name": "push", "body": "payload", "force_N": [5.0, 0.0, 0.0]}
    load |= {"start_s": 0.4, "end_s": 0.8}
    laws = tree["dispersion"] | {
        "load.push.start_s": {"normal": 0.1},
        "load.push.end_s": {"uniform": 0.1},
    }
    tree = tree | {"load": [load], "dispersion": laws}
    return Campaign(parse_campaign(tree, "pushed"))


@pytest.mark.slow
def test_loads_that_end_before_they_start_are_those_of_the_design(monkeypatch):
    campaign = with_load()
    session = campaign.session({"load.push.end_s": (0.45, 1.5)})
    for end in (0.5, 1.5):
        result, expected = (
            session.run([end], cases=300, seed=1),
            session.with_design([end]).run(300, seed=1),
        )
        table, rows = result.to_pandas(), expected.to_pandas()
        assert (table["status"] == rows["status"]).all()
        for column in expected.campaign.input_columns:  # those of invalid cases too
            np.testing.assert_allclose(table[column.name], rows[column.name], rtol=1e-13)
    assert (session.run([0.5], cases=300, seed=1).block.status != Status.OK).any()
    # a design leaves nothing behind for the next one, in a call or between calls
    single = [int(session.run([end], cases=300).ok.sum()) for end in (0.5, 1.5)]
    for rows in (300, 600, 16384):
        monkeypatch.setattr(sessions, "_ROWS", rows)
        ok = session.run_many([[0.5], [1.5], [0.5], [1.5], [0.5]], cases=300).summary["ok"]
        assert ok.tolist() == [single[k] for k in (0, 1, 0, 1, 0)]


def test_a_joint_that_opens_to_the_other_side_in_a_corner_is_refused():
    settings = {"run.history_step_s": 0.0, "joint.clamp.x_axis": [1.0, -1.0, 0.0]}
    campaign = sepmc.load("spring-pushers", settings)
    ranges = {
        "body.payload.cg_m.x": (2.5, 3.5),
        "body.payload.cg_m.y": (0.0, 1.0),
        "body.stage.cg_m.x": (4.0, 5.5),
    }
    with pytest.raises(sepmc.InputError, match=r"joint.clamp would open to the other side"):
        campaign.session(ranges)


def test_an_accuracy_that_is_missed_is_noted():
    settings = {"run.history_step_s": 0.0, "solver.accuracy": 1e-12, "solver.method": "rk4"}
    campaign = sepmc.load("table2", settings)
    with pytest.warns(sepmc.RunWarning, match="accuracy"):
        session = campaign.session({"motor.retro.thrust_N": (400.0, 500.0)})
    assert any("accuracy" in note for note in session.notes)
    assert any("accuracy" in note for note in session.run([450.0], cases=5).notes)
    announced = []
    campaign.session({"motor.retro.thrust_N": (400.0, 500.0)}, announce=announced.append)
    assert session.run([450.0], cases=5).accuracy.worst[1] > 1e-12


@pytest.mark.parametrize("values", ["error", ("separation",)])
def test_columns_are_names(values):
    session = sepmc.load("table2").session({"motor.retro.thrust_N": (400.0, 500.0)})
    with pytest.raises(sepmc.InputError, match=r"list of names|no such outcome"):
        session.run_many([[450.0]], cases=3, columns=values)
    with pytest.raises(sepmc.InputError, match="numbers"):
        session.run([450.0 + 1.0j], cases=3)
