"""One case by itself, flown by the kernel written for its scene in plain Python: against the general kernel, row by row."""

import numpy as np
import pytest
from click.testing import CliRunner
from numpy.testing import assert_allclose
from specialised_scenes import scene

import sepmc
from sepmc import cli, schema
from sepmc.campaign import single

NONE = np.empty(0, dtype=np.int64)


def both(campaign, every_s):
    """The nominal case by its own kernel and by the general one."""
    alone = campaign.nominal().scene
    columns = campaign.outcome_columns
    return single.fly_single(alone, columns, every_s), single.fly_single_generally(alone, columns, every_s, NONE)


def by_instant(flown):
    """Rows by time and phase; where a time comes twice in a phase, the last."""
    return {(round(t, 9), phase): row for t, phase, row in zip(flown.times, flown.phases, flown.rows, strict=True)}


@pytest.mark.slow
@pytest.mark.parametrize("name", ["table1.toml", "table2.toml", "spring-pushers.toml", "stack"])
def test_histories_agree(name):
    """Every column of every row, to 1e-8 of the largest of its unit; rows at every instant and on both sides of the end of every phase."""
    campaign = sepmc.load(name) if name.endswith("toml") else scene(name)
    if campaign.scene.solver.step:
        solver = {key: value for key, value in campaign.file.tree["solver"].items() if key != "step_s"}
        campaign = campaign.with_settings({"solver": solver})
    written, general = both(campaign, campaign.scene.run.end_time / 40)
    assert (written.kernel, general.kernel, written.notes, general.notes) == ("written", "general", [], [])
    ours, theirs = by_instant(written), by_instant(general)
    assert set(ours) <= set(theirs)  # the general kernel has rows at events within a phase too
    assert {phase for _, phase in ours} == set(range(len(campaign.scene.phase)))
    grid = {round(t, 9) for t in np.arange(41) * campaign.scene.run.end_time / 40}
    assert grid <= {time for time, _ in ours}
    found, expected = (np.array([table[key] for key in sorted(ours)]) for table in (ours, theirs))
    columns = schema.history_columns(written.plan.contents)
    for k, column in enumerate(columns):
        size = np.abs(expected[:, [c.unit == column.unit for c in columns]]).max()
        assert_allclose(found[:, k], expected[:, k], rtol=0.0, atol=1e-8 * max(size, 1e-6), err_msg=column.name)


@pytest.mark.slow
def test_a_late_joint_is_late_in_the_next_phase():
    """Its force goes on, in the phase that has begun, until it lets go."""
    campaign = sepmc.load("table2.toml", {"joint.pins.delay_ms": 5.0, "phase.guided.until": {"time_s": 0.4}})
    frame = campaign.simulate(step_s=0.01)
    assert frame.attrs["kernel"] == "written"
    late = frame[(frame["phase"] == "free") & (frame["time_s"] < 0.405 - 1e-9)]
    assert len(late) >= 1
    assert (late["pins_force_on_lower_z_N"].abs() > 0.0).all()
    assert (frame.loc[frame["time_s"] > 0.405 + 1e-9, "pins_force_on_lower_z_N"] == 0.0).all()


LEAVES = {
    "environment": {"atmosphere": "table", "gravity": "none", "air": {"altitude_m": [0.0, 2000.0], "density_kg_per_m3": [2.0, 2.0]}},
    "phase": [{"name": "free"}],
    "initial": {"altitude_m": 1000.0, "speed_m_s": 100.0, "omega_deg_s": [0.0, 0.0, 40.0]},
    "body.aft.aerodynamics": {
        "reference_area_m2": 1.0,
        "reference_length_m": 0.5,
        "table": {"alpha_deg": [-5.0, 5.0], "pitch": [0.001, -0.001]},
    },
    "solver": {"accuracy": 1e-9},
}


@pytest.mark.slow
@pytest.mark.parametrize("status", ["never-released", "outside-table"])
def test_a_case_that_fails(pair, status):
    """Its status, and rows as far as it got, are those of the general kernel; so are its outcomes, if it has any."""
    campaign = pair(LEAVES) if status == "outside-table" else sepmc.load("table2.toml", {"phase.guided.until.stroke_mm": 1e5})
    written, general = both(campaign, 0.02)
    assert (written.status.label, general.status.label) == (status, status)
    count = len(campaign.outcome_columns)
    assert np.isnan(written.outcomes[:count]).all() == (status != "never-released")
    assert_allclose(written.outcomes[:count], general.outcomes[:count], rtol=1e-7, atol=1e-9)
    ours, theirs = by_instant(written), by_instant(general)
    assert abs(max(theirs)[0] - max(ours)[0]) < 0.03
    for key in set(ours) & set(theirs):
        assert_allclose(ours[key], theirs[key], rtol=1e-7, atol=1e-7 * np.abs(theirs[key]).max())


def test_what_the_kernel_does_not_vouch_for():
    """The full system: the general kernel flies it."""
    full = sepmc.load("table2.toml", {"solver.formulation": "full"})
    assert single.fly_single(full.nominal().scene, full.outcome_columns, 0.1) is None


def test_nothing_is_compiled(tmp_path, monkeypatch):
    """`sepmc run table1.toml` with an empty cache."""
    from sepmc import door

    monkeypatch.setattr(door, "warm_up", None)
    monkeypatch.setattr("sepmc.campaign.campaign.warm_up", None)
    result = CliRunner().invoke(cli.main, ["run", "table1.toml", "--out", str(tmp_path / "one"), "--every-s", "0.05", "--no-plots"])
    assert result.exit_code == 0, result.output
    assert "in plain Python" in result.output
