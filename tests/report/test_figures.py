"""Figures: the right files, and in them the right data, units and marks. Degenerate data must
neither fail nor warn."""

import subprocess
import sys
from itertools import pairwise

import numpy as np
import pandas as pd
import pytest
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.ticker import AutoLocator, FixedLocator
from numpy.testing import assert_allclose
from scipy import stats

from sepmc.analysis.failure_attribution import Attribution
from sepmc.analysis.statistics import column, histogram
from sepmc.report.bench_figures import _peers
from sepmc.report.figures import band_figures, histogram_figures
from sepmc.report.history_figures import run_figures
from sepmc.report.sensitivity_figures import attribution_figure
from sepmc.report.style import _columns, lay_out, make_axes, save, set_panel_title, set_title

UNITS = {"separation_speed_m_s": "m/s", "separation_distance_mm": "mm", "upper_alpha_deg": "deg"}
REFERENCE = {"upper_alpha_deg": {"mean": 4.06, "sigma": 0.67, "min": 2.42, "max": 5.93}}
NORMAL = "normal, same mean and sigma (where |skewness| < 0.2, |excess kurtosis| < 0.4)"
PNG = b"\x89PNG\r\n\x1a\n"


@pytest.fixture
def drawn(monkeypatch):
    """The figures by file name; laid out and drawn, but not encoded to a file, which takes the most
    time."""
    caught = {}

    def keep(figure, path, **options):
        caught[path.name] = figure
        figure.draw_without_rendering()

    monkeypatch.setattr(Figure, "savefig", keep)
    return caught


def campaign(n=40):
    rng = np.random.default_rng(11)
    cases = pd.DataFrame({"case": np.arange(n), "status": "ok"})
    time, acceleration = np.linspace(0.0, 0.5, 11), rng.normal(1.2, 0.1, n)[:, None]
    cases["upper_alpha_deg"] = rng.normal(4.0, 0.7, n)
    long = {"case": np.repeat(np.arange(n), time.size), "time_s": np.tile(time, n)}
    long["separation_speed_m_s"] = (acceleration * time).ravel()
    long["separation_distance_mm"] = (500.0 * acceleration * time**2).ravel()
    histories = pd.DataFrame(long)
    last = histories.groupby("case").last()
    for name in ("separation_speed_m_s", "separation_distance_mm"):
        cases[name] = last[name].reindex(cases["case"]).to_numpy()
    return cases, histories


def campaign_figures(cases, histories, folder, units, reference=None, labels=None, outcomes=None):
    """Draw the bands and the histograms of the ok cases of a campaign."""
    ok = cases[cases["status"] == "ok"]
    written = []
    if histories is not None:
        written = band_figures(histories[histories["case"].isin(ok["case"])], folder, units, labels)
    names = list(outcomes if outcomes is not None else reference or units)
    histograms = {name: histogram(column(ok, name)) for name in names if name in ok}
    return written + histogram_figures(histograms, folder, units, reference, labels)


def texts(figure):
    return [text.get_text() for legend in figure.legends for text in legend.get_texts()]


def line(ax, label):
    result = [one for one in ax.lines if one.get_label() == label]
    assert result, f"no line {label!r} among {[one.get_label() for one in ax.lines]}"
    return result


def test_campaign_files(tmp_path):
    cases, histories = campaign()
    folder = tmp_path / "new" / "figures"
    written = campaign_figures(cases, histories, folder, UNITS, REFERENCE, outcomes=list(UNITS))
    names = [
        "separation_speed",
        "separation_distance",
        *(f"hist_{name}" for name in UNITS),
        "histograms",
    ]
    assert written == [folder / f"{name}.png" for name in names]
    for path in written:
        assert path.read_bytes().startswith(PNG)
        assert path.stat().st_size > 5000


def test_equal_data_give_equal_bytes(tmp_path):
    cases, histories = campaign()
    first = campaign_figures(cases, histories, tmp_path / "a", UNITS, outcomes=["upper_alpha_deg"])
    second = campaign_figures(cases, histories, tmp_path / "b", UNITS, outcomes=["upper_alpha_deg"])
    assert [path.read_bytes() for path in first] == [path.read_bytes() for path in second]


def test_bands(tmp_path, drawn):
    cases, histories = campaign()
    cases.loc[7, "status"] = "no_release"
    # a failed case must not stretch the envelope
    histories.loc[histories["case"] == 7, "separation_speed_m_s"] = 1e6
    campaign_figures(cases, histories, tmp_path, UNITS, outcomes=[])
    assert set(drawn) == {"separation_speed.png", "separation_distance.png"}
    (ax,) = drawn["separation_speed.png"].axes
    assert ax.get_xlabel() == "time (s)"
    assert ax.get_ylabel() == "axial separation speed (m/s)"
    ok = histories[histories["case"] != 7].pivot(
        index="time_s", columns="case", values="separation_speed_m_s"
    )
    (median,) = line(ax, "median")
    assert_allclose(median.get_xdata(), ok.index)
    assert_allclose(median.get_ydata(), ok.median(axis=1))
    for band, percents in zip(ax.collections, ((0, 100), (1, 99), (5, 95)), strict=True):
        corners = band.get_paths()[0].vertices
        at_end = corners[corners[:, 0] == ok.index[-1], 1]
        assert (at_end.min(), at_end.max()) == pytest.approx(
            tuple(np.percentile(ok.iloc[-1], percents))
        )
    singles = line(ax, "single cases")
    assert len(singles) == 5
    assert any(np.allclose(singles[0].get_ydata(), ok[case]) for case in ok)
    assert texts(drawn["separation_speed.png"]) == [
        "min to max",
        "1 to 99 %",
        "5 to 95 %",
        "single cases",
        "median",
    ]


def test_histogram_is_a_density_with_its_normal_and_the_reference(tmp_path, drawn):
    cases, _ = campaign(2000)
    campaign_figures(
        cases, None, tmp_path, UNITS, REFERENCE, labels={"upper_alpha_deg": "angle of attack"}
    )
    (ax,) = drawn["hist_upper_alpha_deg.png"].axes
    (bars,) = ax.patches
    heights, edges, _ = bars.get_data()
    assert heights @ np.diff(edges) == pytest.approx(1.0)
    (normal,) = line(ax, NORMAL)
    x, density = normal.get_data()
    assert np.trapezoid(density, x) == pytest.approx(1.0, abs=1e-3)
    assert x[density.argmax()] == pytest.approx(cases["upper_alpha_deg"].mean(), abs=0.02)
    assert density.max() == pytest.approx(
        1.0 / (cases["upper_alpha_deg"].std() * np.sqrt(2.0 * np.pi)), rel=1e-3
    )
    assert [one.get_xdata()[0] for one in line(ax, "reference mean")] == [4.06]
    assert [one.get_xdata()[0] for one in line(ax, "reference min and max")] == [2.42, 5.93]
    assert ax.get_xlabel() == "angle of attack (deg)"
    assert ax.get_ylabel() == "density (1/deg)"
    mean, sigma = cases["upper_alpha_deg"].mean(), cases["upper_alpha_deg"].std()
    assert ax.get_title() == f"n 2,000, mean {mean:.3f}, sigma {sigma:.3f} deg"


def test_units_and_words_of_a_column(tmp_path, drawn):
    cases, _ = campaign()
    cases["hits"] = cases["upper_alpha_deg"].round()
    campaign_figures(cases, None, tmp_path, UNITS, outcomes=["separation_speed_m_s", "hits"])
    (speed,), (hits,) = (
        drawn[f"hist_{name}.png"].axes for name in ("separation_speed_m_s", "hits")
    )
    assert (speed.get_xlabel(), speed.get_ylabel()) == (
        "separation speed (m/s)",
        "density (1/(m/s))",
    )
    assert (hits.get_xlabel(), hits.get_ylabel()) == ("hits", "density")


@pytest.mark.parametrize(("centre", "sigma"), [(70000.0, 0.1), (3e6, 700.0), (-0.012345, 1e-5)])
def test_long_numbers_do_not_run_into_each_other(tmp_path, drawn, centre, sigma):
    cases, _ = campaign()
    for name in ("a_m", "b_m", "c_m"):
        cases[name] = centre + sigma * (cases["upper_alpha_deg"] - 4.0)
    campaign_figures(cases, None, tmp_path, {}, outcomes=["a_m", "b_m", "c_m"])
    for ax in drawn["histograms.png"].axes:
        low, high = ax.get_xlim()
        boxes = [
            tick.get_window_extent()
            for tick in ax.get_xticklabels()
            if low <= tick.get_position()[0] <= high
        ]
        assert len(boxes) >= 2
        assert all(left.x1 < right.x0 for left, right in pairwise(boxes))


def test_overview_shows_the_referenced_outcomes_or_the_first_twelve(tmp_path, drawn):
    cases, _ = campaign()
    for k in range(13):
        cases[f"q{k}_deg"] = cases["upper_alpha_deg"] + k
    outcomes = [f"q{k}_deg" for k in range(13)]
    campaign_figures(cases, None, tmp_path, UNITS, outcomes=outcomes)
    assert [ax.get_xlabel() for ax in drawn["histograms.png"].axes] == [
        f"q{k} deg" for k in range(12)
    ]
    campaign_figures(
        cases,
        None,
        tmp_path,
        UNITS,
        {name: {"mean": 4.0} for name in outcomes[1:5]},
        outcomes=outcomes[:6],
    )
    assert [ax.get_xlabel() for ax in drawn["histograms.png"].axes] == [
        f"q{k} deg" for k in range(1, 5)
    ]


@pytest.mark.parametrize(
    "values", [[26.4] * 20, [0.0] * 20, [1e3 + k * 2e-13 for k in range(20)], [3.0]]
)
def test_degenerate_outcome(tmp_path, drawn, values):
    cases = pd.DataFrame({"case": np.arange(len(values)), "status": "ok", "stroke_mm": values})
    campaign_figures(cases, None, tmp_path, {"stroke_mm": "mm"})
    (ax,) = drawn["hist_stroke_mm.png"].axes
    assert [one.get_xdata()[0] for one in line(ax, "all cases")] == [values[0]]
    assert not ax.patches
    title = {
        26.4: "constant 26.40",
        0.0: "constant 0",
        1e3: "constant 1000",
        3.0: "mean 3.000, sigma -",
    }
    assert ax.get_title() == f"n {len(values)}, {title[values[0]]} mm"


@pytest.mark.parametrize(
    "values",
    [[1.0, 2.0], [-1e-12, 1e-12, 0.0], [1e12, 1e12 + 5e3, 3.0], [1.0, np.nan, np.inf, 4.0]],
)
def test_few_and_odd_values(tmp_path, drawn, values):
    cases = pd.DataFrame({"case": np.arange(len(values)), "status": "ok", "stroke_mm": values})
    campaign_figures(cases, None, tmp_path, {"stroke_mm": "mm"})
    (ax,) = drawn["hist_stroke_mm.png"].axes
    assert ax.get_title().startswith(f"n {np.isfinite(values).sum()}, ")


def test_a_long_tail_is_shown_on_a_logarithmic_scale(tmp_path, drawn):
    """A bar of few cases, far from nearly all others, is seen."""
    far = np.linspace(-80.0, 90.0, 60)
    values = np.concatenate([far, np.full(9940, 100.0)])
    result = {"gap_mm": histogram(values), "near_mm": histogram(np.linspace(0.0, 1.0, 500))}
    histogram_figures(result, tmp_path, {}, required={"gap_mm": [0.0]})
    gap, near = drawn["histograms.png"].axes
    assert (gap.get_yscale(), near.get_yscale()) == ("log", "linear")
    assert gap.get_ylabel().endswith("logarithmic")
    heights = gap.patches[0].get_data().values
    low, high = gap.get_ylim()
    assert low < heights[heights > 0.0].min() < heights.max() < high
    assert [one.get_xdata()[0] for one in line(gap, "required bound")] == [0.0]


def test_legends_name_things_in_one_order(tmp_path, drawn):
    """Whichever panel has them first."""
    bell = np.random.default_rng(3).normal(size=5000)
    result = {"flat": histogram(np.linspace(0.0, 1.0, 5000)), "bell": histogram(bell)}
    for names in (("flat", "bell"), ("bell", "flat")):
        histogram_figures({name: result[name] for name in names}, tmp_path, {}, alone=False)
        assert texts(drawn["histograms.png"]) == [
            "cases",
            "bars too low to see",
            "minimum and maximum",
            NORMAL,
        ]


@pytest.mark.parametrize("n", [300, 100_000])
def test_a_normal_curve_is_a_matter_of_shape(tmp_path, drawn, n):
    """However many cases there are: of a normal law, not of those of skewness 0.3, or of excess
    kurtosis -0.6 (triangular) or 1.2 (logistic)."""
    share = (np.arange(n) + 0.5) / n
    laws = {
        "normal": stats.norm, "skewed": stats.gamma(44.0), "flat": stats.triang(0.5),
        "peaked": stats.logistic,
    }  # fmt: skip
    result = {name: histogram(law.ppf(share)) for name, law in laws.items()}
    histogram_figures(result, tmp_path, {}, alone=False)
    axes = drawn["histograms.png"].axes
    curves = [NORMAL in [one.get_label() for one in ax.lines] for ax in axes]
    assert curves == [True, False, False, False]
    assert axes[0].get_title().startswith(f"n {n:,}, mean ")


@pytest.mark.parametrize(("count", "columns"), [(4, 4), (5, 3), (6, 3), (7, 4), (9, 3)])
def test_rows_of_a_legend_are_even(count, columns):
    """Of which four fit beside each other: the last row lacks as few as can be."""
    assert _columns(["a" * 7] * count, 4.5) == columns


@pytest.mark.parametrize(
    ("about", "title"),
    [
        ("a, 40 cases, seed 1", "Axial separation speed\na, 40 cases, seed 1"),
        ("a, 50 cases, seed 1", "Axial separation speed of 40 cases\na, 50 cases, seed 1"),
        ("", "Axial separation speed of 40 cases"),
    ],
)
def test_bands_say_once_of_how_many_cases_they_are(tmp_path, drawn, about, title):
    _, histories = campaign()
    band_figures(histories, tmp_path, UNITS, about=about)
    assert drawn["separation_speed.png"].get_suptitle() == title


def test_missing_columns_are_left_out(tmp_path):
    cases, histories = campaign()
    cases["never_s"] = np.nan
    assert campaign_figures(cases, None, tmp_path, {}, outcomes=["never_s", "not_a_column"]) == []
    assert campaign_figures(cases, histories[["case", "time_s"]], tmp_path, {}, outcomes=[]) == []
    cases["status"] = "failed"
    assert campaign_figures(cases, histories, tmp_path, UNITS) == []


@pytest.mark.parametrize("rows", [1, 2])
def test_bands_of_one_case_and_one_time(tmp_path, rows):
    cases, histories = campaign(1)
    assert len(campaign_figures(cases, histories[:rows], tmp_path, UNITS, outcomes=[])) == 2


PHASES = (("locked", 0.0, 0.05), ("guided", 0.05, 0.26), ("free", 0.26, 0.5))


def run(phases=PHASES):
    """Two bodies and a joint: both ends of every phase are rows, and the axial force ends with the
    first phase."""
    parts = [
        pd.DataFrame({"time_s": np.linspace(start, end, 6), "phase": name})
        for name, start, end in phases
    ]
    history = pd.concat(parts, ignore_index=True)
    time, locked = history["time_s"], history["phase"] == phases[0][0]
    columns = {"separation_speed_m_s": time, "separation_distance_mm": 500.0 * time**2}
    for sign, body in ((1.0, "upper"), (-1.0, "lower")):
        for k, axis in enumerate("xyz"):
            columns[f"{body}_omega_{axis}_deg_s"] = k + sign * time
            columns[f"pins_force_on_{body}_{axis}_N"] = (
                sign * np.where(locked, -220.0, 0.0) if axis == "x" else k * sign * time
            )
            columns[f"pins_moment_on_{body}_{axis}_N_m"] = sign * (k - 1) * 100.0 * time
        for k, angle in enumerate(("alpha", "beta", "pitch", "yaw")):
            columns[f"{body}_{angle}_deg"] = k + sign * time
        columns[f"{body}_roll_deg"] = 1e-16 * np.cos(40.0 * time)
        columns[f"{body}_axial_acceleration_m_s2"] = -1.0 - time
    return history.assign(**columns)


def test_run_files(tmp_path):
    written = run_figures(run(), tmp_path, ["upper", "lower"], ["pins"])
    names = [f"{kind}_on_{body}" for body in ("upper", "lower") for kind in ("force", "moment")]
    assert written == [
        tmp_path / f"{name}.png"
        for name in [*names, "rates", "angles", "axial_acceleration", "separation"]
    ]
    assert all(path.read_bytes().startswith(PNG) for path in written)


def test_a_step_in_force_is_drawn_as_a_step(tmp_path, drawn):
    history = run()
    run_figures(history, tmp_path, ["upper", "lower"], ["pins"])
    (ax,) = drawn["force_on_upper.png"].axes
    time, force = line(ax, "$F_x$")[0].get_data()
    assert_allclose(force, history["pins_force_on_upper_x_N"])
    assert list(force[np.asarray(time) == 0.05]) == [-220.0, 0.0]
    assert ax.get_ylabel() == "force at pins (N)"
    styles = {
        one.get_label(): one.get_linestyle() for one in ax.lines if one.get_label().startswith("$")
    }
    assert len(set(styles.values())) == 3  # to be told apart in grey print
    assert drawn["moment_on_lower.png"].axes[0].get_ylabel() == "moment at pins (N m)"


def test_phases_are_marked_and_named(tmp_path, drawn):
    run_figures(run(), tmp_path, ["upper", "lower"], ["pins"])
    for name, first in (("force_on_upper.png", 1), ("rates.png", 1), ("angles.png", 2)):
        axes = drawn[name].axes
        for ax in axes:
            assert [
                one.get_xdata()[0]
                for one in ax.lines
                if list(one.get_xdata()) in ([0.05] * 2, [0.26] * 2)
            ] == [0.05, 0.26]
        for ax in axes[:first]:
            assert [(text.get_text(), text.xy[0]) for text in ax.texts] == [
                ("locked", pytest.approx(0.025)),
                ("guided", pytest.approx(0.155)),
                ("free", pytest.approx(0.38)),
            ]
        assert not any(ax.texts for ax in axes[first:])


def test_names_wider_than_their_phase_are_slanted(tmp_path, drawn):
    history = run((("locked", 0.0, 0.05), ("bolts_open", 0.05, 0.055), ("free", 0.055, 0.5)))
    run_figures(history, tmp_path, ["upper", "lower"], ["pins"])
    assert {text.get_rotation() for text in drawn["rates.png"].axes[0].texts} == {35.0}


def test_hinges_relative_motions_and_signals_are_drawn(tmp_path, drawn):
    """One line for each joint and each pair of bodies; separations and forces that stay 0 are
    not drawn."""
    time = np.linspace(0.0, 1.0, 5)
    columns = {"time_s": time, "separation_speed_m_s": 0.0 * time}
    columns |= {"door_angle_deg": 40.0 * time, "door_angle_rate_deg_s": 40.0 + time}
    columns |= {"signal_push": time**2}
    columns |= {f"door_force_on_a_{axis}_N": 0.0 * time for axis in "xyz"}
    columns |= {f"b_from_a_{key}_deg": time for key in ("roll", "yaw", "pitch")}
    history = pd.DataFrame(columns | {"b_from_a_distance_m": 3.0 + time})
    written = run_figures(history, tmp_path, ["a", "b"], ["door", "latch"])
    assert [path.stem for path in written] == ["hinges", "relative_motion", "signals"]
    assert_allclose(drawn["signals.png"].axes[0].lines[0].get_ydata(), time**2)
    angle, rate = drawn["hinges.png"].axes
    assert [line.get_label() for line in angle.lines] == ["door"]
    assert_allclose(rate.lines[0].get_ydata(), history["door_angle_rate_deg_s"])
    labels = [ax.get_ylabel() for ax in drawn["relative_motion.png"].axes]
    assert labels == ["distance (m)", "pitch (deg)", "yaw (deg)", "roll (deg)"]


def test_joints_share_the_panels_of_their_separation(tmp_path, drawn):
    """However many joints there are, one panel of speed and one of distance; each joint has a line
    of its own colour and style."""
    history, joints = run(), [f"strut_{k}" for k in range(8)]
    for k, joint in enumerate(joints):
        for name in ("separation_speed_m_s", "separation_distance_mm"):
            history[f"{joint}_{name}"] = (1.0 + k) * history[name]
    history = history.drop(columns=["separation_speed_m_s", "separation_distance_mm"])
    run_figures(history, tmp_path, ["upper"], joints, only=["separation"])
    speed, distance = drawn["separation.png"].axes
    assert speed.get_ylabel().replace("\n", " ") == "axial separation speed (m/s)"
    assert distance.get_ylabel().replace("\n", " ") == "axial separation distance (mm)"
    assert [texts(drawn["separation.png"])[k] for k in (0, 7)] == ["strut 0", "strut 7"]
    lines = [one for one in speed.lines if one.get_label().startswith("strut")]
    assert len({(one.get_color(), one.get_linestyle()) for one in lines}) == 8
    assert_allclose(lines[3].get_ydata(), history["strut_3_separation_speed_m_s"])


def test_rates_and_angles(tmp_path, drawn):
    history = run()
    run_figures(history, tmp_path, ["upper", "lower"], ["pins"])
    assert [ax.get_ylabel() for ax in drawn["rates.png"].axes] == ["upper (deg/s)", "lower (deg/s)"]
    assert_allclose(
        line(drawn["rates.png"].axes[1], r"$\omega_z$")[0].get_ydata(),
        history["lower_omega_z_deg_s"],
    )
    angles = drawn["angles.png"].axes
    assert [ax.get_ylabel() for ax in angles] == [
        "alpha (deg)",
        "pitch (deg)",
        "yaw (deg)",
        "roll (deg)",
    ]
    assert [line(angles[1], body)[0].get_linestyle() for body in ("upper", "lower")] == ["--", "-."]
    assert_allclose(line(angles[1], "lower")[0].get_ydata(), history["lower_pitch_deg"])
    assert texts(drawn["angles.png"]) == ["upper", "lower"]
    assert angles[3].get_ylim() == pytest.approx((-0.5, 0.5))  # round-off in roll is not blown up


def test_panels_of_one_quantity_share_a_scale(tmp_path, drawn):
    """But for one whose lines would be flat in it, which says so."""
    history = run()
    for axis in "xyz":
        history[f"third_omega_{axis}_deg_s"] = 1e-3 * history["time_s"]
    bodies = ["upper", "lower", "third"]
    run_figures(history, tmp_path, bodies, ["pins"], only=["rates", "angles"])
    upper, lower, third = drawn["rates.png"].axes
    assert upper.get_ylim() == lower.get_ylim()
    assert upper.get_ylim()[0] < -0.5 < 2.5 < upper.get_ylim()[1]
    assert lower.get_ylabel() == "lower (deg/s)"
    assert third.get_ylabel() == "third (deg/s)\nown scale"
    assert third.get_ylim()[1] < 1e-3
    assert len({ax.get_ylim() for ax in drawn["angles.png"].axes}) == 4


@pytest.mark.parametrize(("least", "scale"), [(20.0, "log"), (-20.0, "linear")])
def test_clearances_of_a_case(tmp_path, drawn, least, scale):
    """The case, the nominal one, what is required; a logarithmic scale is announced."""
    time = np.linspace(0.0, 1.0, 20)
    frame = pd.DataFrame({"time_s": time, "gap_clearance_mm": least + 900.0 * time})
    behind = frame.assign(gap_clearance_mm=60.0 + 900.0 * time)
    bounds = {"gap_clearance_mm": [4.0]}
    run_figures(frame, tmp_path, [], [], behind=behind, required=bounds)
    figure = drawn["clearances.png"]
    (ax,) = figure.axes
    assert ax.get_yscale() == scale
    message = ax.get_ylabel().split("\n")
    assert message[0] == "gap (mm)"
    at = frame["gap_clearance_mm"].idxmin()
    assert message[1] == f"minimum {least:.4g} at {frame['time_s'][at]:.4g} s"
    assert message[2:] == (["logarithmic"] if scale == "log" else [])
    assert list(line(ax, "required bound")[0].get_ydata()) == [4.0, 4.0]
    assert ax.get_ylim()[0] < 4.0
    assert_allclose(line(ax, "this case")[0].get_ydata(), frame["gap_clearance_mm"])
    assert texts(figure) == ["nominal case (pale)", "this case", "required bound"]


def test_an_engine_timed_by_few_cases_has_no_line():
    """Its times are noise; one case is one case."""
    ours = {"engine": "sepmc", "scaled": False, "default": True, "cases": 2000, "setting": "a 1"}
    slow = ours | {"setting": "b 1", "scaled": True, "default": False, "cases": 500}
    other = {"engine": "other", "scaled": True, "default": False, "cases": 1, "setting": "b 1"}
    rows = [
        row | {"ms": ms, "error": e} for row in (slow, ours, other) for ms, e in ((1, 1e-9), (2, 1))
    ]
    (ax,) = _peers(pd.DataFrame(rows), "title", 1e-12).axes
    assert line(ax, "sepmc")[0].get_linestyle() == "-"
    assert line(ax, "other (1 case, scaled)")[0].get_linestyle() == "None"


def test_a_joint_draws_only_the_bodies_it_touches(tmp_path, drawn):
    history = run()
    for name in [name for name in history if name.startswith("pins_force_on_lower")]:
        history[name.replace("pins", "strut").replace("lower", "booster")] = history[name]
        history[name.replace("pins", "strut")] = history[name]
    written = run_figures(history, tmp_path, ["upper", "lower", "booster"], ["pins", "strut"])
    assert "moment_on_booster.png" not in {path.name for path in written}
    assert [ax.get_ylabel() for ax in drawn["force_on_booster.png"].axes] == ["force at strut (N)"]
    assert [ax.get_ylabel() for ax in drawn["force_on_lower.png"].axes] == [
        "force at pins (N)",
        "force at strut (N)",
    ]


def test_little_to_draw(tmp_path):
    history = run()
    assert run_figures(history[:0], tmp_path, ["upper", "lower"], ["pins"]) == []
    assert run_figures(history[["time_s", "phase"]], tmp_path, ["upper"], []) == []
    assert len(run_figures(history[:1], tmp_path, ["upper"], ["pins"])) == 6
    assert [
        path.name
        for path in run_figures(
            history[["time_s", "upper_alpha_deg"]], tmp_path, ["upper"], ["pins"]
        )
    ] == ["angles.png"]


def test_large_forces_are_written_out(tmp_path, drawn):
    history = run()
    history["pins_force_on_upper_x_N"] *= 1e5
    run_figures(history, tmp_path, ["upper"], ["pins"])
    (ax,) = drawn["force_on_upper.png"].axes
    assert ax.yaxis.get_offset_text().get_text() == ""
    assert "−20000000" in [label.get_text() for label in ax.get_yticklabels()]


def test_more_bodies_than_line_styles(tmp_path, drawn):
    history = pd.DataFrame(
        {"time_s": [0.0, 1.0]} | {f"b{k}_alpha_deg": [k, k + 1.0] for k in range(6)}
    )
    run_figures(history, tmp_path, [f"b{k}" for k in range(6)], [])
    assert len(drawn["angles.png"].axes[0].lines) == 6


@pytest.mark.slow
@pytest.mark.parametrize("reference", [None, REFERENCE])
def test_nothing_is_clipped_and_no_legend_lies_on_data(tmp_path, drawn, reference):
    cases, histories = campaign()
    campaign_figures(cases, histories, tmp_path, UNITS, reference, outcomes=list(UNITS))
    run_figures(run(), tmp_path, ["upper", "lower"], ["pins"])
    for name, figure in drawn.items():
        width, height = figure.canvas.get_width_height()
        for legend in figure.legends:
            box = legend.get_window_extent()
            assert box.x0 >= 0, name
            assert box.x1 <= width, name
            assert not any(box.overlaps(ax.get_window_extent()) for ax in figure.axes), name
        for ax in figure.axes:
            box = ax.get_tightbbox()
            assert box.x0 >= -1, name
            assert box.x1 <= width + 1, name
            assert box.y1 <= height + 1, name


def test_pyplot_stays_out():
    """It would cost import time, and may look for a display."""
    code = "import sys, sepmc.report.figures; sys.exit('matplotlib.pyplot' in sys.modules)"
    assert subprocess.run([sys.executable, "-c", code], check=False).returncode == 0


def test_required_bounds_are_marked(drawn, tmp_path):
    """A line at the bound, in the panel of its outcome, which comes first."""
    result = {name: histogram(np.linspace(0.0, 10.0, 100)) for name in ("gap_mm", "speed_m_s")}
    histogram_figures(result, tmp_path, {"speed_m_s": "m/s"}, required={"speed_m_s": [4.0]})
    first, second = drawn["histograms.png"].axes
    assert first.get_xlabel() == "speed (m/s)"
    marked = [line.get_xdata()[0] for line in first.lines if line.get_label() == "required bound"]
    assert marked == [4.0]
    assert "required bound" not in [line.get_label() for line in second.lines]


def test_long_numbers_are_no_wider_than_their_panel(drawn, tmp_path):
    """A rate that is round-off: 0.0000004, with a sigma of 0.0000153."""
    tiny = 1.5e-5 * np.sin(np.arange(1000.0)) + 4e-7
    names = [f"{name}_deg_s" for name in ("one", "two", "three")]
    units = dict.fromkeys(names, "deg/s")
    histogram_figures({name: histogram(tiny) for name in names}, tmp_path, units)
    figure = drawn["histograms.png"]
    assert "0.0000" in figure.axes[2].get_title()
    width = figure.canvas.get_width_height()[0]
    for ax in figure.axes:
        box = ax.title.get_window_extent()
        assert (box.x0 >= 0.0, box.x1 <= width) == (True, True)


def test_outcomes_that_the_file_defines_are_drawn_first(monkeypatch):
    """After required ones; and an outcome with the statistics of another is drawn once."""
    import sepmc
    from sepmc.analysis import constant_outcomes
    from sepmc.cli.figures import ranked_outcomes

    monkeypatch.setattr(constant_outcomes, "is_constant", lambda table, name: False)
    campaign = sepmc.load("fairing")
    names = [column.name for column in campaign.outcome_columns]
    numbers = np.arange(4.0 * len(names)).reshape(-1, 4)
    table = pd.DataFrame(numbers, names, ["mean", "sigma", "min", "max"]).assign(n=10)
    same = ["left_gap_clearance_mm", "left_hinge_separation_distance_mm"]
    table.loc[same[1]] = table.loc[same[0]]
    ranked = ranked_outcomes(campaign, table)
    assert ranked[:3] == ["left_gap_clearance_mm", "right_gap_clearance_mm", "opening_lag_s"]
    assert same[1] not in ranked


@pytest.mark.slow
def test_a_second_process_draws_the_same(tmp_path):
    """Byte for byte; and where it was killed, they are drawn all the same."""
    import sepmc
    from sepmc.cli.figures import draw_figures
    from sepmc.processes import processes

    campaign = sepmc.load("table2.toml")
    result = campaign.run(cases=50, out=tmp_path / "run")
    given = tmp_path / "run", campaign, result.kept.summary
    here = draw_figures(*given, separate=True)
    drawn = {path: path.read_bytes() for path in here}
    assert {"histograms", "separation_speed", "hist_upper_roll_deg"} <= {p.stem for p in here}
    for path in here:
        path.unlink()
    with processes(1) as second:
        assert draw_figures(*given, second=second, separate=True) == here
        assert {path: path.read_bytes() for path in here} == drawn
        (process,) = second._processes.values()
        process.kill()
        process.join()
        assert draw_figures(*given, second=second, separate=True) == here
    assert {path: path.read_bytes() for path in here} == drawn


def test_no_recontact_is_a_clearance_above_zero():
    """The bound that is drawn over time; of a clearance that has one of its own, both."""
    import sepmc
    from sepmc.analysis.requirements import required_bounds
    from sepmc.cli.figures import clearance_bounds

    campaign = sepmc.load("residual-thrust")
    assert required_bounds(campaign.file.requirements) == {"gap_recontact": [0.0]}
    assert clearance_bounds(campaign)["gap_clearance_mm"] == [0.0]
    wide = {"name": "wide", "metric": "gap_clearance_mm", "at_least": 40.0}
    touch = {"name": "touch", "metric": "gap_recontact", "at_most": 0.0}
    both = campaign.with_settings({"requirement": [wide, touch]})
    assert clearance_bounds(both)["gap_clearance_mm"] == [40.0, 0.0]


def test_attributions_are_bars(drawn, tmp_path):
    """One for each input, or pair, of each failure; the first at the top, with where most are."""
    one = Attribution(("a",), 0.4, 1e-9, ((1.0, 2.0),), 8, 10, 25)
    two = Attribution(("a", "b"), 0.6, 1e-9, ((1.0, 2.0), (3.0, 3.0)), 9, 10, 12)
    each = {"small": [two, one], "parts": [one]}
    failures = {"small": "small, 10 of 60 cases", "parts": "parts, 10 of 60 cases"}
    path = attribution_figure(each, failures, tmp_path, {"a": "body.a.mass_kg"}, "some", ".svg")
    assert path.name == "attribution.svg"
    first, second = drawn["attribution.svg"].axes
    assert [bar.get_width() for bar in first.patches] == pytest.approx([40.0, 60.0])
    labels = [label.get_text() for label in first.get_yticklabels()]
    assert labels == ["body.a.mass_kg 1 to 2", "body.a.mass_kg 1 to 2\nb 3"]
    assert first.texts[1].get_text() == "9 of 10, among 12 cases"
    assert second.get_title(loc="left") == failures["parts"]


def test_svg_has_a_title_for_readers_who_do_not_see_it(tmp_path):
    figure, _ = make_axes(1, 1, (3.0, 2.0))
    set_title(figure, "A title that is folded into lines, as it is wider than this figure\nsome")
    path = save(figure, tmp_path / "small.svg")
    text = path.read_text(encoding="utf-8")
    folded = "A title that is folded into lines, as it is wider than this figure some"
    assert f"<title>{folded}</title>" in text


def test_the_unit_of_a_density_is_not_clipped(tmp_path, drawn):
    """A panel of the overview is lower than "density (1/(deg/s)), logarithmic" is long."""
    values = np.concatenate([np.linspace(-80.0, 90.0, 60), np.full(9940, 100.0)])
    names = [f"{name}_deg_s" for name in ("one", "two", "three", "four")]
    histogram_figures(
        {name: histogram(values) for name in names}, tmp_path, dict.fromkeys(names, "deg/s")
    )
    for ax in drawn["histograms.png"].axes:
        label, panel = ax.yaxis.label.get_window_extent(), ax.get_window_extent()
        assert ax.get_ylabel().endswith("logarithmic")
        assert label.height <= 1.05 * panel.height


@pytest.mark.parametrize(
    ("locator", "lines", "text", "times"),
    [
        (FixedLocator([0.0, 3.0]), 1, "", 1),
        (FixedLocator([0.0, 3.0]), 12, "", 2),
        (AutoLocator(), 4, "", 2),
        (FixedLocator([0.0, 3.0]), 1, "beyond the axes", 2),
    ],
)
def test_a_layout_measures_panels_again_only_if_needed(monkeypatch, locator, lines, text, times):
    """If the ticks change, if a label of many lines makes the axes smaller, or if they have texts,
    which move with the width."""
    measured = []

    def measure(ax, *arguments, _measure=Axes.get_tightbbox, **options):
        measured.append(ax)
        return _measure(ax, *arguments, **options)

    monkeypatch.setattr(Axes, "get_tightbbox", measure)
    figure, (ax,) = make_axes(1, 1, (4.0, 3.0))
    ax.plot([0.0, 7.0], [0.0, 1.0])
    if text:
        ax.text(3.5, 0.5, text)
    ax.xaxis.set_major_locator(locator)
    ax.yaxis.set_major_locator(FixedLocator([0.0, 1.0]))
    ax.set_ylabel("an ordinate\n" * lines)
    lay_out(figure)
    assert len(measured) == times
    box = ax.get_tightbbox(figure.canvas.get_renderer())
    assert np.all(box.min >= 0.0)
    assert np.all(box.max <= figure.bbox.max)


@pytest.mark.parametrize("scale", [1.0, 1e9])
def test_titles_of_panels_keep_off_powers_of_ten(scale):
    figure, (ax,) = make_axes(1, 1, (3.0, 2.0))
    ax.plot([0.0, 1.0], [0.0, scale])
    set_panel_title(ax, "A title that is as wide as the axes", 9)
    figure.draw_without_rendering()
    title, power = (text.get_window_extent() for text in (ax.title, ax.yaxis.get_offset_text()))
    assert bool(ax.yaxis.get_offset_text().get_text()) == (scale > 1.0)
    assert title.y0 >= (power.y1 if scale > 1.0 else ax.get_window_extent().y1)
