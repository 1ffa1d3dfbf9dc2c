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


def test_what_the_kernel_does_not_vouch_for():
    """A joint that is never released, and the full system: the general kernel flies them."""
    never = sepmc.load("table2.toml", {"phase.guided.until.stroke_mm": 1e5})
    assert single.fly_single(never.nominal().scene, never.outcome_columns, 0.1) is None
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
