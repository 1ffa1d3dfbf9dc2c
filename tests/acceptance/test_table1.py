"""The paper's single run, Table 1 and Figs 2 to 7."""

import numpy as np
import pytest

import sepmc


@pytest.fixture(scope="module", params=["reduced", "full"])
def history(request):
    """By both formulations: in the full one the wrench on each stage is solved for, and eq (15) is
    an outcome."""
    return sepmc.load("table1.toml", {"solver.formulation": request.param}).simulate()


def vector(history, name, unit):
    return history[[f"{name}_{axis}_{unit}" for axis in "xyz"]].to_numpy()


def test_release_time(history):
    """Section 3.1 and Figs 2-5: the pins act until 0.26 s."""
    assert history.attrs["status"] == "ok"
    assert history.attrs["outcomes"]["release_time_s"] == pytest.approx(0.260, abs=0.005)


def test_forces_are_equal_and_opposite(history):
    upper, lower = (
        vector(history, "pins_force_on_upper", "N"),
        vector(history, "pins_force_on_lower", "N"),
    )
    assert np.abs(upper).max() > 50.0
    assert np.abs(upper + lower).max() <= 1e-12 * np.abs(upper).max()


def test_moments_balance_with_the_gap(history):
    """Eq (15): M_upper + M_lower + (r_lower - r_upper) x F_lower = 0, to 1e-9 N m."""
    gap = vector(history, "pins_gap", "m")
    force = vector(history, "pins_force_on_lower", "N")
    moments = vector(history, "pins_moment_on_upper", "N_m") + vector(
        history, "pins_moment_on_lower", "N_m"
    )
    assert np.abs(vector(history, "pins_moment_on_upper", "N_m")).max() > 50.0
    assert np.abs(moments + np.cross(gap, force)).max() <= 1e-9
    guided = (history["phase"] == "guided").to_numpy()
    # not equal and opposite by themselves, as the paper notes
    assert np.abs(moments[guided]).max() > 1e-3


def test_nothing_acts_after_release(history):
    free = (history["phase"] == "free").to_numpy()
    assert free.sum() > 200
    for what, unit in (("force", "N"), ("moment", "N_m")):
        for body in ("upper", "lower"):
            assert np.all(vector(history, f"pins_{what}_on_{body}", unit)[free] == 0.0)


def test_lower_stage_decelerates_more_after_unlock(history):
    after = history[history["phase"] != "locked"]
    assert (after["lower_axial_acceleration_m_s2"] < after["upper_axial_acceleration_m_s2"]).all()
    locked = history[history["phase"] == "locked"]
    assert np.abs(locked["separation_distance_mm"]).max() < 1e-9


def test_phases_are_where_the_paper_puts_them(history):
    first = history.groupby("phase", sort=False)["time_s"].min()
    assert list(first.index) == ["locked", "guided", "free"]
    assert first["guided"] == 0.05
    assert history["time_s"].iloc[-1] == 0.5


def test_attitudes_agree_until_release(history):
    held = history[history["phase"] != "free"]
    for angle in ("roll", "yaw", "pitch"):
        assert np.abs(held[f"upper_{angle}_deg"] - held[f"lower_{angle}_deg"]).max() < 1e-9
