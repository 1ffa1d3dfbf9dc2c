"""Rare events: known answers, intervals that hold them, cases without an outcome, refusals, and the
command line."""

import json
import math
from types import SimpleNamespace

import numpy as np
import pandas as pd
import pytest
import tomli_w
from click.testing import CliRunner
from numpy.testing import assert_allclose
from scipy import stats

import sepmc
from sepmc.analysis import subset_simulation
from sepmc.campaign import cases
from sepmc.campaign.execution import flight_log
from sepmc.campaign.execution.limit_state import LimitState, limit_state
from sepmc.campaign.store import manifests, shards
from sepmc.campaign.store.folders import StoreError
from sepmc.cli import app
from sepmc.report import rare_figures
from sepmc.report.rare_figures import rare_figure
from sepmc.scene.messages import InputError
from sepmc.scene.model import Requirement
from sepmc.schema import Column, Status

FLIGHTS, SIGMA = 10_000, 2.0  # deg/s
SLOW = {"name": "slow", "metric": "separation_speed_m_s", "at_least": 0.378}


def estimate(margin, dimensions, seed=0, most=FLIGHTS):
    """What is estimated of margins (n,) at scores (n, d); cases are told by their first score."""
    return subset_simulation.estimate(
        lambda u: (margin(u), u[:, :1]), dimensions, lambda what: cases.generator(seed, what), most
    )


def plane(p, d):
    """Margins of an event of probability p: beyond a plane."""
    return lambda u: stats.norm.isf(p) - u.sum(axis=1) / math.sqrt(d)


@pytest.mark.slow
@pytest.mark.parametrize(
    ("margin", "d", "p"),
    [
        (plane(1e-6, 2), 2, 1e-6),
        (plane(1e-6, 30), 30, 1e-6),
        (plane(3e-4, 5), 5, 3e-4),
        (lambda u: stats.norm.isf(5e-7) - np.abs(u[:, 0]), 4, 1e-6),  # two ways
        (lambda u: stats.chi2.isf(1e-6, 6) - (u**2).sum(axis=1), 6, 1e-6),
        (lambda u: np.ceil(2.0 * plane(1e-6, 3)(u)) - 0.5, 3, 1e-6),  # few values
    ],
)
def test_probabilities_that_are_known(margin, d, p):
    """Forty estimates: their intervals hold the probability as often as they say, and their mean is
    it to its own error."""
    results = [estimate(margin, d, seed, 20_000) for seed in range(100, 140)]
    assert all(known is all_of and flights <= 20_000 for known, all_of, flights in results)
    inside = [known.interval[0] <= p <= known.interval[1] for known, _, _ in results]
    assert sum(inside) >= 34  # of 38; fewer by chance in one of a hundred
    each = np.array([known.probability for known, _, _ in results])
    assert abs(each.mean() - p) < 3.5 * each.std(ddof=1) / math.sqrt(len(each))


def test_what_is_frequent_is_counted():
    known, _, flights = estimate(plane(0.3, 3), 3)
    assert len(known.levels) == 1
    assert flights <= FLIGHTS
    low, high = known.interval
    assert low < 0.3 < high < low + 0.02


def test_what_never_happens():
    known, _, _ = estimate(lambda u: 1.0 + np.abs(u[:, 0]), 2)
    assert known.probability == 0.0
    assert known.interval[0] == 0.0
    assert known.interval[1] < 1e-5
    assert (
        "went down to a margin of 1 only, and no case violates"
        in subset_simulation.estimate_warnings(known)[0]
    )
    known, _, _ = estimate(lambda u: np.ones(len(u)), 2)  # as a constant outcome
    assert known.interval == pytest.approx((0.0, 3.9e-4), rel=0.1)
    assert math.isnan(known.spread)


def test_weights_add_up_to_the_estimate():
    known, _, _ = estimate(plane(1e-5, 4), 4)
    violates = known.last.margin < 0.0
    assert_allclose(known.weight[violates].sum(), known.probability, rtol=1e-12)
    assert_allclose(known.weight.sum(), known.levels[-2].reached, rtol=1e-12)
    assert_allclose(known.last.records[:, 0], known.last.scores[:, 0])
    assert_allclose(known.last.margin, plane(1e-5, 4)(known.last.scores))
    mean = np.average(known.last.scores.sum(axis=1) / 2.0, weights=known.weight * violates)
    assert_allclose(mean, stats.norm.pdf(stats.norm.isf(1e-5)) / 1e-5, rtol=0.01)


def test_levels_are_told():
    known, _, flights = estimate(plane(1e-4, 3), 3)
    thresholds = [level.threshold for level in known.levels]
    assert thresholds == sorted(thresholds, reverse=True)
    assert thresholds[-1] == 0.0
    assert_allclose(np.prod([x.probability for x in known.levels]), known.probability)
    for level in known.levels:
        assert abs(math.log(level.reached / stats.norm.cdf(
            level.threshold - stats.norm.isf(1e-4)))) < 0.6  # fmt: skip
    assert math.isnan(known.levels[0].acceptance)
    assert all(0.3 < level.acceptance < 0.6 for level in known.levels[1:])
    steps = len(known.levels) - 1
    assert flights == pytest.approx(FLIGHTS, rel=0.03)
    assert known.size * subset_simulation.REPLICAS * (1 + 0.9 * steps) <= FLIGHTS


def test_cases_without_a_margin_are_told_apart():
    """Where they are as rare as violations they are part of the same levels; where they are
    frequent, they are left out of those of the violations."""

    def margin(u, missing, which):
        return np.where(u[:, which] > stats.norm.isf(missing), np.nan, plane(1e-5, 1)(u[:, :1]))

    known, all_of, _ = estimate(lambda u: margin(u, 2e-6, 0), 3, most=40_000)
    assert known is all_of
    assert known.interval[0] < 8e-6 < known.interval[1]
    assert_allclose(known.unknown.mean(), 2e-6, rtol=0.5)
    assert known.interval_with_unknown[0] < 1e-5 < known.interval_with_unknown[1]
    known, all_of, flights = estimate(lambda u: margin(u, 0.02, 1), 3, most=40_000)
    assert flights <= 40_000
    assert known.interval[0] < 0.98e-5 < known.interval[1]
    assert not known.unknown.any()
    low, high = all_of.interval_with_unknown
    assert low < 0.02 < high < 0.03
    known, all_of, _ = estimate(lambda u: np.full(len(u), np.nan), 3)
    assert (known.probability, known.interval[0]) == (0.0, 0.0)
    assert all_of.interval_with_unknown[1] == 1.0


def test_what_is_doubtful_is_told():
    """A second way that no trial case sees, steep at its end, and far from the first one."""

    def margin(u):
        late = np.where(u[:, 1] > 3.2, 3.0 * (4.0 - u[:, 1]), np.inf)
        return np.minimum(6.0 - u[:, 0], late)

    known, _, _ = estimate(margin, 4, 3)
    assert any(
        "replicas disagree" in message for message in subset_simulation.estimate_warnings(known)
    )


def test_what_is_too_rare_for_so_few_flights():
    known, _, flights = estimate(plane(1e-13, 3), 3)
    assert flights <= FLIGHTS
    assert known.probability == 0.0
    assert 1e-13 < known.interval[1] < 1e-5
    assert "or need more cases" in subset_simulation.estimate_warnings(known)[0]


def test_scores_follow_the_laws(pair):
    laws = {
        "initial.omega_deg_s.x": {"normal": [3.0, 0.5]},
        "initial.omega_deg_s.y": {"uniform": [1.0, 2.0]},
        "initial.omega_deg_s.z": {"discrete": [0.0, 1.0], "weights": [0.9, 0.1]},
        "initial.speed_m_s": {"normal": [3.0, 0.5]},
    }
    together = [{"parameters": ["initial.omega_deg_s.x", "initial.speed_m_s"], "coefficient": 0.6}]
    file = pair({"dispersion": laws, "correlation": together}).file
    scores = np.array([[1.0, 0.0, 2.0, 0.5], [-5.0, 9.0, 1.0, -1.0]])
    table = cases.inputs_at_scores(file.dispersions, scores, file.copulas)
    assert_allclose(table[:, 0], [3.5, 0.5], rtol=1e-9)
    assert_allclose(table[:, 1], [1.5, 2.0], rtol=1e-12)
    assert_allclose(table[:, 2], [1.0, 0.0])
    assert_allclose(table[:, 3], [3.0 + 0.5 * (0.6 + 0.8 * 0.5), 3.0 + 0.5 * (-3.0 - 0.8)])


@pytest.fixture(scope="module")
def spinning(pair):
    """Bodies that turn for ever as they begin to: rates across the axis have Rayleigh's law."""
    laws = {f"initial.omega_deg_s.{axis}": {"normal": SIGMA} for axis in "yz"}
    laws["initial.omega_deg_s.x"] = {"uniform": 1.0}
    bound = SIGMA * math.sqrt(-2.0 * math.log(1e-6))
    rate = "fore_transverse_rate_deg_s"
    return pair(
        {
            "body.fore.inertia_kg_m2": [3.0, 4.0, 4.0],
            "initial.omega_deg_s": [0.0, 0.0, 0.0],
            "output.transverse": ["fore"],
            "dispersion": laws,
            "requirement": [
                {"name": "quiet", "metric": rate, "at_most": bound},
                {"name": "level", "metric": "fore_omega_x_deg_s", "at_least": -1.0 + 2e-6},
                {"name": "ends", "metric": "never-released"},
                {"name": "all", "metric": "violation"},
            ],
        }
    )


@pytest.mark.parametrize("name", ["quiet", "level"])
def test_a_campaign_of_known_probability(spinning, name):
    result = spinning.rare(name, most=40_000, seed=5)
    low, high = result.interval
    assert low < 1e-6 < high < 4.0 * low
    assert result.flights <= 40_000
    assert (result.unknown, result.bounds) == (0.0, result.interval)
    assert result.statuses == {"ok": result.flights}
    rows = result.to_pandas()
    violate = rows["margin"] < 0.0
    assert_allclose(rows["weight"][violate].sum(), result.probability, rtol=1e-12)
    if name == "quiet":
        rate = np.hypot(rows["in_initial_omega_y_deg_s"], rows["in_initial_omega_z_deg_s"])
        assert_allclose(rows["fore_transverse_rate_deg_s"], rate, rtol=1e-9)
        assert rows["margin"].is_monotonic_increasing
    else:
        assert next(iter(result.inputs)) == "in_initial_omega_x_deg_s"
        assert result.inputs["in_initial_omega_x_deg_s"][0] < -4.5
    assert repr(result).startswith(f"<RareEventEstimate {name}: probability 1.") or "e-0" in repr(
        result
    )


def test_a_value_that_levels_do_not_see_is_told(spinning):
    """Of a million cases one spins, far beyond the bound: no level leads there."""
    law = {"discrete": [0.0, 50.0], "weights": [1.0 - 1e-6, 1e-6]}
    with_one = spinning.with_settings({"dispersion.initial.omega_deg_s.x": law})
    item = {"name": "slow", "metric": "fore_omega_x_deg_s", "at_most": 1.0}
    result = with_one.with_settings({"requirement": [item]}).rare("slow", most=FLIGHTS)
    assert result.probability == 0.0
    message = (
        "initial.omega_deg_s.x = 50 has a probability of 1e-06, and of the cases with it 100 % "
        "violate"
    )
    assert any(note.startswith(message) for note in result.notes)


@pytest.mark.parametrize(
    ("name", "message"),
    [
        ("ends", "is a status, which has no margin"),
        ("all", "combines other requirements; name one of them: quiet, level, ends"),
        ("loud", "rare = loud: no such requirement; known here: quiet, level, ends, all"),
    ],
)
def test_what_cannot_be_sought(spinning, name, message):
    with pytest.raises(InputError) as error:
        spinning.rare(name)
    assert message in str(error.value)


def test_what_else_is_refused(spinning, pair, tmp_path):
    for most in (500, 10**8):
        with pytest.raises(InputError, match="must be >= 10000 and <= 10000000"):
            spinning.rare("quiet", most=most)
    with pytest.raises(InputError, match=r"quiet: needs a \[\[requirement\]\] in campaign"):
        pair().rare("quiet")
    still = [{"name": "quiet", "metric": "fore_omega_x_deg_s", "at_most": 1.0}]
    with pytest.raises(InputError, match=r"nothing is dispersed; give \[dispersion\]"):
        pair({"requirement": still}).rare("quiet")
    plan = tmp_path / "plan.csv"
    plan.write_text("case,in_initial_omega_x_deg_s\n0,0.1\n1,0.2\n")
    with pytest.raises(InputError, match=r"run.samples = plan.csv: a rare event is estimated"):
        spinning.with_settings({"run.samples": str(plan)}).rare("quiet")


def test_a_contact_is_approached_by_its_clearance():
    residual = sepmc.load("residual-thrust")
    aim = limit_state(residual, "no_recontact")
    assert aim.column.name == "gap_clearance_mm"
    assert aim.sentence == "requirement.no_recontact: no gap_recontact"
    item = Requirement(name="x", metric="gap_recontact", at_most=0.0)
    aim = LimitState(item, Column("gap_clearance_mm", "mm", "", 1000.0), 0, 1)
    block = SimpleNamespace(
        outcomes=np.array([[0.2, 0], [0, 0], [0, 1], [-0.1, 1], [np.nan, 0], [np.nan, np.nan],
                           [0.2, 0]]),
        status=np.array([Status.OK] * 6 + [Status.JAMMED]),
    )  # fmt: skip
    margin = aim.margin(block)
    assert_allclose(margin, [200.0, 0.0, -1e-9, -100.0, np.inf, np.nan, np.nan])
    other = {"name": "x", "metric": "gap_recontact", "at_least": 1.0}
    touching = residual.with_settings({"requirement": [other]})
    with pytest.raises(InputError, match="a rare event needs the bound at_most = 0"):
        limit_state(touching, "x")


@pytest.mark.slow
def test_threads_change_nothing():
    campaign = sepmc.load("table2", {"requirement": [SLOW]})
    one, two = (campaign.rare("slow", most=FLIGHTS, seed=3, threads=n) for n in (1, 2))
    assert one.replicas == two.replicas
    pd.testing.assert_frame_equal(one.to_pandas(), two.to_pandas(), check_exact=True)
    other = campaign.rare("slow", most=FLIGHTS, seed=4)
    assert other.replicas != one.replicas
    low, high = (min(x.interval[0] for x in (one, other)), max(x.interval[1] for x in (one, other)))
    assert low < 1.090e-5 < high  # 10,898 of 1e9 plain cases


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    """A folder that the command line wrote, and what it printed."""
    root = tmp_path_factory.mktemp("rare")
    tree = {**sepmc.load("table2").file.tree, "name": "slow", "requirement": [SLOW]}
    (root / "slow.toml").write_text(tomli_w.dumps(tree))
    ran = invoke("campaign", root / "slow.toml", "--rare", "slow", "--cases", "1e4", "--out",
                 root / "run")  # fmt: skip
    assert ran.exit_code == 0, ran.output
    return root / "run", ran.output


def invoke(*words):
    return CliRunner().invoke(app.main, [str(word) for word in words], catch_exceptions=False)


@pytest.mark.slow
def test_a_folder(folder):
    run, printed = folder
    content = json.loads((run / "rare.json").read_text())
    assert "slow: probability of violation" in printed
    assert f"{content['flights']} cases" in printed
    assert "numerical error <= " in printed
    assert {path.name for path in run.iterdir()} == {
        "campaign.toml", "manifest.json", "checksums.jsonl", "rare.json", "rare.parquet",
        "rare.png",
    }  # fmt: skip
    assert manifests.diagnose(run) == []
    manifest = manifests.read_manifest(run)
    assert manifest["rare"]["name"] == "slow"
    assert manifest["accuracy"]["met"]
    rows = pd.read_parquet(run / "rare.parquet")
    violate = rows["separation_speed_m_s"] < SLOW["at_least"]
    assert (violate == (rows["margin"] < 0.0)).all()
    assert violate.sum() == content["violating_cases_kept"]
    assert_allclose(rows["weight"][violate].sum(), content["probability"])
    assert len(content["levels"][-1]["replicas"]) == len(content["replicas"]) == 10


def test_its_cases_fly_again(folder, tmp_path):
    run, _ = folder
    again = invoke("campaign", run, "--samples", run / "rare.parquet", "--cases", 40, "--out",
                   tmp_path / "again", "--no-plots", "--quiet")  # fmt: skip
    assert again.exit_code == 0, again.output
    rows, kept = shards.read_cases(tmp_path / "again"), pd.read_parquet(run / "rare.parquet")
    for name in (column for column in rows if str(column).startswith("in_")):
        assert (rows[name] == kept[name][:40]).all()
    name = "separation_speed_m_s"
    assert_allclose(rows[name], kept[name][:40], rtol=1e-9)
    one = invoke("run", run, "--case", 2, "--set", "run.samples=rare.parquet", "--out",
                 tmp_path / "one", "--no-plots")  # fmt: skip
    assert one.exit_code == 0, one.output
    message = next(line for line in one.output.splitlines() if name in line)
    assert_allclose(float(message.split()[-1]), kept[name][2], rtol=1e-8)


@pytest.mark.parametrize(
    "words", [["stats"], ["plot"], ["report"], ["sensitivity"], ["fit"], ["replay", "--case", "1"]]
)
def test_what_reads_runs_says_what_it_is(folder, words):
    run, _ = folder
    called = invoke(words[0], run, *words[1:])
    assert called.exit_code == 2
    assert "contains the estimate of a rare event and no run: see rare.json" in called.output


def test_it_is_not_gone_on_with(folder, tmp_path):
    run, _ = folder
    called = invoke("campaign", run, "--out", run, "--resume")
    assert called.exit_code == 2
    assert "so there are no cases to continue" in called.output
    called = invoke("run", run, "--case", 1, "--out", tmp_path / "one")
    assert "add --set run.samples=rare.parquet" in called.output
    called = invoke("campaign", run, "--rare", "slow", "--out", run)
    assert "exists; add --overwrite to replace it" in called.output


class _Stop:
    """Progress that interrupts after so many flights."""

    def __init__(self, flights):
        self.flights = flights

    def __call__(self, done, most, failed):
        if done >= self.flights:
            raise KeyboardInterrupt


def _interrupted(campaign, folder, flights):
    with pytest.raises(KeyboardInterrupt):
        campaign.rare("slow", FLIGHTS, 3, folder, resume=True, progress=_Stop(flights))


@pytest.mark.slow
def test_an_interrupted_estimate_is_resumed(tmp_path, monkeypatch):
    """It ends in the numbers of one that was left alone, however often it was interrupted, and
    flies what was flown before no more."""
    monkeypatch.setattr(flight_log, "_SAVE_NUMBERS", 100_000)
    campaign, folder = sepmc.load("table2", {"requirement": [SLOW]}), tmp_path / "run"
    for flights in (1, 5_000, 8_000):
        _interrupted(campaign, folder, flights)
    assert not manifests.read_manifest(folder)["complete"]
    result = campaign.rare("slow", FLIGHTS, 3, folder, resume=True)
    alone = campaign.rare("slow", FLIGHTS, 3)
    assert (result.replicas, result.statuses, result.flights) == (
        alone.replicas, alone.statuses, alone.flights
    )  # fmt: skip
    assert result.notes == alone.notes
    pd.testing.assert_frame_equal(result.to_pandas(), alone.to_pandas(), check_exact=True)
    manifest = manifests.read_manifest(folder)
    assert manifest["complete"]
    assert manifest["sessions"][-1]["cases_flown"] <= result.flights - 5_000
    assert not (folder / "accumulators").exists()
    assert manifests.diagnose(folder) == []


@pytest.mark.slow
def test_a_damaged_log_is_flown_again(tmp_path, monkeypatch):
    """What follows a shard that was changed does not answer."""
    monkeypatch.setattr(flight_log, "_SAVE_NUMBERS", 100_000)
    campaign, folder = sepmc.load("table2", {"requirement": [SLOW]}), tmp_path / "run"
    _interrupted(campaign, folder, 8_000)
    first, second, *_ = sorted((folder / "accumulators").iterdir())
    second.write_bytes(first.read_bytes())
    result = campaign.rare("slow", FLIGHTS, 3, folder, resume=True)
    assert result.replicas == campaign.rare("slow", FLIGHTS, 3).replicas


def test_another_estimate_is_not_resumed(folder, tmp_path):
    """Another seed, number of flights, requirement or folder is refused by name."""
    campaign, other = sepmc.load("table2", {"requirement": [SLOW]}), tmp_path / "run"
    _interrupted(campaign, other, 1)
    for words, seed, most in (
        ("another seed", 4, FLIGHTS),
        ("another number of cases", 3, 2 * FLIGHTS),
    ):
        with pytest.raises(StoreError, match=words):
            campaign.rare("slow", most, seed, other, resume=True)
    run, _ = folder
    with pytest.raises(StoreError, match="contains an estimate that is complete"):
        campaign.rare("slow", FLIGHTS, 3, run, resume=True)
    with pytest.raises(InputError, match="resume: needs out"):
        campaign.rare("slow", FLIGHTS, 3, resume=True)
    campaign.run(8, out=tmp_path / "cases")
    with pytest.raises(StoreError, match="contains no estimate of a rare event"):
        campaign.rare("slow", FLIGHTS, 3, tmp_path / "cases", resume=True)


def test_doctor_looks_at_it(folder, tmp_path):
    run, _ = folder
    other = tmp_path / "run"
    other.mkdir()
    for path in run.iterdir():
        (other / path.name).write_bytes(path.read_bytes())
    (other / "rare.json").write_text("{}")
    called = invoke("doctor", other)
    assert called.exit_code == 1
    assert "rare.json: was changed" in called.output
    called = invoke("doctor", other, "--repair")
    assert called.exit_code == 2
    assert "cannot be repaired; run it again" in called.output


@pytest.mark.parametrize(
    ("words", "message"),
    [
        (["--until", "separation_speed_m_s:1%"], "--rare and --until exclude each other"),
        (["--stats-only"], "--rare and --stats-only exclude each other"),
        (["--sampler", "lhs"], "--rare and --sampler exclude each other"),
        (["--check"], "--rare and --check exclude each other"),
        (["--max-failures", "0"], "--rare and --max-failures exclude each other"),
        (["--keep", ""], "--rare and --keep exclude each other"),
        (["--cases", "3:9"], "takes a number of cases"),
        (["--cases", "77"], "cases = 77: must be >= 10000"),
        (["--dry-run"], "separation_speed_m_s >= 0.378 m/s; at most 100000 cases, into"),
    ],
)
def test_options_beside_it(folder, tmp_path, words, message):
    run, _ = folder
    ran = invoke("campaign", run, "--rare", "slow", "--out", tmp_path / "none", *words)
    assert message in ran.output
    assert ran.exit_code == (0 if words == ["--dry-run"] else 2)
    assert not (tmp_path / "none").exists()


@pytest.mark.parametrize(("bound", "reported"), [(0.47, True), (0.378, False)])
def test_what_is_not_rare_is_told(bound, reported):
    """Violated by 6 % of the cases, plain ones tell it with fewer flights; by 1e-5, they do not."""
    campaign = sepmc.load("table2", {"requirement": [{**SLOW, "at_least": bound}]})
    result = campaign.rare("slow", most=FLIGHTS, announce=lambda message: None)
    assert any("this is not rare: " in message for message in result.notes) == reported
    assert subset_simulation.equivalent_direct_cases(1e-6, (0.8e-6, 1.25e-6)) == pytest.approx(
        7.7e7, rel=0.01
    )
    assert math.isnan(subset_simulation.equivalent_direct_cases(1e-6, (0.0, 1e-6)))


def test_replicas_that_come_to_no_threshold_say_nothing():
    """Most cases have one margin, and so few chains that no replica comes beyond it."""

    def margin(u):
        return np.minimum(3.0 - u[:, 0], 2.9 - stats.norm.isf(0.005)) + 1e-3

    for seed in range(60):
        known, _, _ = estimate(margin, 5, seed)
        low, high = known.interval
        assert 0.0 <= low <= known.probability <= high <= 1.0


def test_levels_at_one_margin_are_a_jump(tmp_path, monkeypatch):
    """No curve goes up where many cases have the same margin: it is marked, and said."""
    caught = []
    monkeypatch.setattr(rare_figures, "save", lambda figure, path: caught.append(figure))
    spread = np.array([0.9, 1.0, 1.1])
    levels = tuple(
        subset_simulation.Level(margin, share, share, share * spread, 0.4, 9)
        for margin, share in ((100.0, 0.4), (100.0 - 1e-7, 0.1), (40.0, 0.03), (0.0, 0.01))
    )
    result = SimpleNamespace(
        inputs={}, levels=levels, metric="gap_clearance_mm", unit="mm", probability=0.01,
        interval=(0.008, 0.012),
    )  # fmt: skip
    rare_figure(result, tmp_path, {}, "title")
    (ax,) = caught[0].axes
    drawn = {}
    for line in ax.lines:
        drawn.setdefault(line.get_label(), []).append(list(line.get_xdata()))
    assert drawn["mean of the replicas"] == [[100.0], [100.0 - 1e-7, 40.0, 0.0]]
    assert drawn["many cases have this margin"] == [[100.0, 100.0 - 1e-7]]
    assert drawn["required bound"] == [[0.0, 0.0]]
    assert ax.get_ylabel() == "probability that the margin is less"
