"""The case table: streams that never drift, laws that have their moments, and cases that do not
know of each other."""

import math
import tomllib
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from oracles.random_scenes.interpreted import run_interpreted
from scipy import stats

from sepmc.campaign import cases
from sepmc.campaign.campaign import Campaign
from sepmc.engine.dispatch import interpreted
from sepmc.scene.messages import SceneError, SceneWarning
from sepmc.scene.read import parse_campaign

TREE = tomllib.loads(
    (Path(__file__).parents[2] / "campaigns" / "table2.toml").read_text(encoding="utf-8")
)
N = 100_000
WORD = 2**64 - 1


def laws(dispersion):
    """The resolved dispersions of table2.toml with other laws; the upper stage has 458 kg, the yaw
    angle is 0."""
    return parse_campaign({**TREE, "dispersion": dispersion}, "t.toml").dispersions


def yaw(law, seed=1, count=N):
    return cases.sample(laws({"initial.yaw_rad": law}), seed, 0, count)[:, 0]


def philox(key, block):
    """Philox 4x64-10 (Salmon et al., Parallel Random Numbers: As Easy as 1, 2, 3, SC 2011) of
    counter ``block``: four numbers."""
    k, x = [key & WORD, key >> 64], [block, 0, 0, 0]
    for _ in range(10):
        left, right = 0xD2E7470EE14C6C93 * x[0], 0xCA5A826395121157 * x[2]
        x = [(right >> 64) ^ x[1] ^ k[0], right & WORD, (left >> 64) ^ x[3] ^ k[1], left & WORD]
        k = [(k[0] + 0x9E3779B97F4A7C15) & WORD, (k[1] + 0xBB67AE8584CAA73B) & WORD]
    return x


def test_philox_known_answer():
    """The authors' own vectors (Random123, kat_vectors): the oracle below is Philox, and numpy's is
    the same."""
    assert philox(0, 0) == [
        0x16554D9ECA36314C,
        0xDB20FE9D672D0FDC,
        0xD7E772CEE186176B,
        0x7E68B68AEC7BA23B,
    ]


@pytest.mark.parametrize(
    ("seed", "path"),
    [(2019, "initial.altitude"), (0, "body.upper.cg.x"), (2**70, "motor.retro.offset.y")],
)
def test_stream_is_philox_of_seed_and_path(seed, path):
    """Counter from 1, key the 16 bytes of BLAKE2b of ``seed:path``, the upper 53 bits of each word
    at the middle of their cell."""
    from hashlib import blake2b

    key = int.from_bytes(blake2b(f"{seed}:{path}".encode(), digest_size=16).digest(), "little")
    words = [word for block in range(1, 26) for word in philox(key, block)]
    expected = [((word >> 11) + 0.5) / 2**53 for word in words]
    np.testing.assert_array_equal(cases.stream(seed, path, 0, 100), expected)
    np.testing.assert_array_equal(cases.stream(seed, path, 37, 5), expected[37:42])


def test_golden_numbers():
    """Written down once: a run of any version with this seed holds these draws."""
    assert cases.stream(2019, "initial.altitude", 0, 3).tolist() == [
        0.9669833326229904,
        0.5893913578357031,
        0.2935104822864701,
    ]
    assert cases.stream(2019, "initial.altitude", 10**12, 1).tolist() == [0.2979764663122128]
    assert (
        Campaign(parse_campaign(TREE, "t.toml")).case(0, seed=2019).inputs["in_initial_altitude_m"]
        == 69850.0 + 300.0 * 0.9669833326229904
    )


@settings(deadline=None)
@given(st.integers(0, 2**64), st.text(max_size=20), st.integers(0, 10**9), st.integers(0, 9))
def test_any_part_of_a_stream(seed, path, first, count):
    whole = cases.stream(seed, path, first, count + 3)
    np.testing.assert_array_equal(cases.stream(seed, path, first + 2, count), whole[2 : 2 + count])
    assert np.all((whole > 0.0) & (whole < 1.0))


def test_largest_number_is_below_one(monkeypatch):
    class Largest(np.random.Philox):
        def advance(self, delta):
            return self

        def random_raw(self, size):
            return np.full(size, WORD, dtype=np.uint64)

    monkeypatch.setattr(np.random, "Philox", Largest)
    assert cases.stream(1, "a", 0, 1)[0] < 1.0


def test_case_drawn_alone():
    dispersions = parse_campaign(TREE, "t.toml").dispersions
    table = cases.sample(dispersions, 2019, 0, 50)
    assert table.shape == (50, len(TREE["dispersion"]))
    for i in (0, 1, 2, 3, 4, 7, 49):
        np.testing.assert_array_equal(cases.sample(dispersions, 2019, i, 1)[0], table[i])
    np.testing.assert_array_equal(cases.sample(dispersions, 2019, 0, 5000)[:50], table)
    assert not np.any(cases.sample(dispersions, 2020, 0, 50) == table)


def test_one_more_variable_changes_no_other_draw():
    few = {"initial.yaw_deg": {"uniform": 1.0}, "body.upper.mass_kg": {"normal": 3.0}}
    more = {"initial.roll_deg": {"uniform": 1.0}, **few, "body.lower.cg_mm.x": {"uniform": 1.0}}
    np.testing.assert_array_equal(
        cases.sample(laws(more), 7, 0, 99)[:, 1:3], cases.sample(laws(few), 7, 0, 99)
    )


@pytest.mark.parametrize("law", ["uniform", "normal", "triangular"])
def test_unit_of_the_key_does_not_matter(law):
    kilograms = cases.sample(laws({"body.upper.mass_kg": {law: 20.0}}), 7, 0, 1000)
    grams = cases.sample(laws({"body.upper.mass_g": {law: 20e3}}), 7, 0, 1000)
    np.testing.assert_allclose(grams * 1e-3, kilograms, rtol=4e-16)


def doubly_truncated(cut):
    """Variance of a standard normal cut at +-cut (Johnson, Kotz, Balakrishnan, ch. 13)."""
    return 1.0 - 2.0 * cut * stats.norm.pdf(cut) / (2.0 * stats.norm.cdf(cut) - 1.0)


@pytest.mark.parametrize(
    ("law", "mean", "sigma", "scipy"),
    [
        ({"uniform": 0.3}, 0.0, 0.3 / math.sqrt(3.0), stats.uniform(-0.3, 0.6)),
        ({"uniform": [-0.1, 0.4]}, 0.15, 0.5 / math.sqrt(12.0), stats.uniform(-0.1, 0.5)),
        ({"triangular": 0.3}, 0.0, 0.3 / math.sqrt(6.0), stats.triang(0.5, -0.3, 0.6)),
        (
            {"triangular": [-0.1, 0.0, 0.5]},
            0.4 / 3.0,
            math.sqrt(0.31 / 18.0),
            stats.triang(1.0 / 6.0, -0.1, 0.6),
        ),
        (
            {"triangular": [0.0, 0.0, 1.0]},
            1.0 / 3.0,
            math.sqrt(1.0 / 18.0),
            stats.triang(0.0, 0.0, 1.0),
        ),
        (
            {"triangular": [0.0, 1.0, 1.0]},
            2.0 / 3.0,
            math.sqrt(1.0 / 18.0),
            stats.triang(1.0, 0.0, 1.0),
        ),
        ({"normal": 0.2}, 0.0, 0.2, stats.norm(0.0, 0.2)),
        ({"normal": [0.1, 0.2]}, 0.1, 0.2, stats.norm(0.1, 0.2)),
        (
            {"normal": 0.2, "truncate_sigma": 1.5},
            0.0,
            0.2 * math.sqrt(doubly_truncated(1.5)),
            stats.truncnorm(-1.5, 1.5, 0.0, 0.2),
        ),
        (
            {"normal": [0.1, 0.05], "truncate_sigma": 3},
            0.1,
            0.05 * math.sqrt(doubly_truncated(3.0)),
            stats.truncnorm(-3, 3, 0.1, 0.05),
        ),
    ],
)
def test_continuous_laws(law, mean, sigma, scipy):
    """Mean and sigma within 4 standard errors, bounds never left and nearly reached, the whole law
    by Kolmogorov and Smirnov."""
    drawn = yaw(law)
    assert abs(drawn.mean() - mean) < 4.0 * sigma / math.sqrt(N)
    kurtosis = 3.0 + float(scipy.stats(moments="k"))
    assert abs(drawn.std(ddof=1) - sigma) < 4.0 * sigma * math.sqrt((kurtosis - 1.0) / (4.0 * N))
    low, high = scipy.support()
    assert low <= drawn.min()
    assert drawn.max() <= high
    if math.isfinite(low):
        assert scipy.cdf(drawn.min()) < 15.0 / N
        assert scipy.sf(drawn.max()) < 15.0 / N
    assert stats.kstest(drawn, scipy.cdf).pvalue > 1e-3


def test_discrete_and_constant():
    drawn = yaw({"discrete": [0.1, 0.2, 0.3, 0.4], "weights": [1.0, 0.0, 2.0, 5.0]})
    for number, p in ((0.1, 0.125), (0.2, 0.0), (0.3, 0.25), (0.4, 0.625)):
        assert abs(np.mean(drawn == number) - p) <= 4.0 * math.sqrt(p * (1.0 - p) / N)
    assert abs(np.mean(yaw({"discrete": [0.1, 0.2]}) == 0.1) - 0.5) < 4.0 * 0.5 / math.sqrt(N)
    assert set(yaw({"constant": 0.25}, count=5)) == {0.25}
    for law in (
        {"uniform": 0.0},
        {"triangular": 0.0},
        {"normal": 0.0},
        {"triangular": [0.0, 0.0, 0.0]},
    ):
        assert set(yaw(law, count=5)) == {0.0}


@pytest.mark.parametrize(
    ("law", "support"),
    [
        ({"uniform": 0.1}, (412.2, 503.8)),
        ({"uniform": [0.9, 1.2]}, (412.2, 549.6)),
        ({"triangular": [0.9, 1.0, 1.2]}, (412.2, 549.6)),
        ({"normal": [1.0, 0.01], "truncate_sigma": 3.0}, (444.26, 471.74)),
        ({"discrete": [0.9, 1.1]}, (412.2, 503.8)),
        ({"constant": 1.5}, (687.0, 687.0)),
    ],
)
def test_relative_laws(law, support):
    """Numbers of a relative law are multiples of the nominal 458 kg."""
    (dispersion,) = laws({"body.upper.mass_kg": {**law, "relative": True}})
    assert dispersion.support == pytest.approx(support, rel=1e-14)
    drawn = cases.sample((dispersion,), 3, 0, 5000)
    assert drawn.min() >= dispersion.support[0]
    assert drawn.max() <= dispersion.support[1]
    assert np.ptp(drawn) >= 0.9 * (support[1] - support[0])
    with pytest.raises(SceneError, match="relative to a nominal of 0"):
        laws({"initial.yaw_deg": {**law, "relative": True}})


def test_streams_are_uncorrelated():
    """Between variables, between seeds, and from case to case: every correlation within 5 /
    sqrt(n), and together as they should be."""
    paths = [d.parameter.path for d in parse_campaign(TREE, "t.toml").dispersions]
    table = np.array([cases.stream(seed, path, 0, N) for seed in (2019, 2020) for path in paths])
    lagged = np.vstack([table[:, 1:], table[: len(paths), :-1]])
    result = np.corrcoef(lagged)[np.triu_indices(len(lagged), 1)] * math.sqrt(N)
    assert np.abs(result).max() < 5.0
    assert abs(result.std() - 1.0) < 4.0 / math.sqrt(2.0 * result.size)


def test_independent_inertias_warn_and_are_counted():
    """+-10 % on each axis of the lower stage alone reaches Izz > Ixx + Iyy, which no solid body
    has."""
    laws = {
        f"body.lower.inertia_kg_m2.{axis}": {"uniform": 0.1, "relative": True}
        for axis in ("xx", "yy", "zz")
    }
    with pytest.warns(SceneWarning, match=r"body\.lower\.inertia.*triangle inequality"):
        campaign = Campaign(parse_campaign({**TREE, "dispersion": laws}, "t.toml"))
    xx, yy, zz = (drawn := cases.sample(campaign.file.dispersions, 2019, 0, 200)).T
    broken = np.sum(np.maximum(yy, zz) > xx + np.minimum(yy, zz))
    assert 0 < campaign.implausible_inertias(drawn) == broken < 200


TAIL = {
    "body": {
        name: {
            "mass_kg": mass,
            "inertia_kg_m2": [mass, 2.0 * mass, 2.0 * mass],
            "cg_m": [station, 0.0, 0.0],
        }
        for name, mass, station in (("upper", 100.0, 1.0), ("lower", 200.0, 3.0))
    },
    "environment": {"atmosphere": "none", "gravity": "none"},
    "motor": [
        {
            "name": "retro",
            "body": "lower",
            "thrust_N": 2000.0,
            "station_m": 4.0,
            "build_up_s": 0.05,
            "burn_s": 0.06,
            "tail_off_s": 0.1,
        }
    ],
    "joint": {"bolt": {"bodies": ["upper", "lower"], "point_m": [2.0, 0.0, 0.0]}},
    "phase": [
        {"name": "locked", "joints": {"bolt": "fixed"}, "until": {"time_s": 0.1}},
        {"name": "free"},
    ],
    "initial": {"altitude_m": 1000.0, "speed_m_s": 100.0},
    "run": {"end_time_s": 0.5, "cases": 20},
    "solver": {"accuracy": 1e-6},
}


@pytest.mark.parametrize("key", ["joint.bolt.delay_s", "motor.retro.burn_s"])
def test_a_tail_that_may_not_be(key):
    """A negative delay or burn, drawn by a normal law that is not cut: a status, of the row and of
    its replay, and no number."""
    campaign = Campaign(
        parse_campaign(TAIL, "tail.toml", {"dispersion": {key: {"normal": [0.03, 0.03]}}})
    )
    with run_interpreted():
        table = campaign.run(cases=12).to_pandas()
    bad = (table[campaign.input_columns[0].name] < 0.0).to_numpy()
    assert 1 <= bad.sum() <= 4
    assert list(table["status"][bad].unique()) == ["invalid-input"]
    assert list(table["status"][~bad].unique()) == ["ok"]
    assert table.loc[bad, [c.name for c in campaign.outcome_columns]].isna().all(axis=None)
    history = campaign.simulate(campaign.case(int(np.flatnonzero(bad)[0])))
    assert history.attrs["status"] == "invalid-input"
    assert f"{key} = -" in history.attrs["notes"][0]


def test_a_load_that_ends_before_it_starts():
    """Refused as a value; drawn by laws it is a status, of the row and of its replay, and not a
    flight without the load."""
    load = {
        "name": "gust",
        "body": "lower",
        "force_N": [0.0, 50.0, 0.0],
        "start_s": 0.15,
        "end_s": 0.2,
    }
    laws = {"load.gust.start_s": {"uniform": 0.1}, "load.gust.end_s": {"uniform": 0.05}}
    campaign = Campaign(parse_campaign(TAIL | {"load": [load]}, "early.toml", {"dispersion": laws}))
    with run_interpreted():
        table = campaign.run(cases=10).to_pandas()
    early = (table["in_load_gust_end_s"] <= table["in_load_gust_start_s"]).to_numpy()
    assert 1 <= early.sum() <= 5
    assert list(table["status"][early].unique()) == ["invalid-input"]
    assert list(table["status"][~early].unique()) == ["ok"]
    history = campaign.simulate(campaign.case(int(np.flatnonzero(early)[0])))
    assert history.attrs["status"] == "invalid-input"
    assert "load.gust.end_s = " in history.attrs["notes"][0]


def test_a_value_that_only_the_nominal_case_would_have_is_said(pair):
    """A law with ends of its own goes on wherever the nominal is put; a half-width goes with it."""
    laws = {
        "dispersion": {
            "body.aft.mass_kg": {"uniform": [0.9, 1.1]},
            "body.fore.mass_kg": {"uniform": 0.1},
        }
    }
    campaign = pair(laws | {"run.end_time_s": 0.1})
    assert campaign.with_settings({"body.fore.mass_kg": 3.5}).file.no_effect == ()
    assert campaign.with_settings(laws | {"body.aft.mass_kg": 1.05}).file.no_effect == ()
    with interpreted():
        (note,) = campaign.with_settings({"body.aft.mass_t": 0.001}).run(cases=2).notes
    for part in (
        "body.aft.mass_t = 0.001 ",
        "nominal",
        "uniform (0.9, 1.1)",
        "dispersion.body.aft.mass_kg = { constant = 1 }",
    ):
        assert part in note
