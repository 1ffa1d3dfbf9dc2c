"""Sampling plans: strata of Latin hypercubes, nets of Sobol sequences, parameters that vary
together; any case drawn alone; what such cases do not show."""

import json
import math

import numpy as np
import pytest
from click.testing import CliRunner
from numpy.testing import assert_allclose, assert_array_equal
from oracles.random_scenes.interpreted import run_interpreted
from scipy import stats

from sepmc.analysis import requirements
from sepmc.analysis.row_statistics import TableStatistics
from sepmc.campaign import cases
from sepmc.campaign.cases import Sampling, probabilities
from sepmc.campaign.store.untrusted import StoreError
from sepmc.cli import app
from sepmc.scene.messages import InputError, SceneError
from sepmc.scene.model import Requirement

PATHS = ["initial.yaw", "body.fore.mass", "body.aft.mass"]
SAMPLERS = ["random", "lhs", "sobol"]
VARIED = {
    "dispersion": {
        "body.fore.mass_kg": {"uniform": 1.0},
        "body.aft.mass_kg": {"normal": 0.1},
        "initial.speed_m_s": {"discrete": [1.0, 2.0, 4.0]},
    },
    "run.cases": 16,
}
TOGETHER = {"parameters": ["body.fore.mass_kg", "body.aft.mass_kg"], "coefficient": 0.7}


def call(*arguments):
    return CliRunner().invoke(app.main, [str(a) for a in arguments])


@pytest.mark.parametrize("sampler", SAMPLERS)
def test_any_part_is_the_same(sampler):
    """Cases drawn one by one, or in parts, are those drawn at once; correlated ones too."""
    sampling = Sampling(sampler, 1000, (cases.Copula((2, 0), ((1.0, 0.0), (-0.6, 0.8))),))
    whole = probabilities(PATHS, 5, 0, 1000, sampling)
    parts = [probabilities(PATHS, 5, *part, sampling) for part in ((0, 1), (1, 13), (14, 986))]
    assert_array_equal(np.hstack(parts), whole)
    assert np.all((whole > 0.0) & (whole < 1.0))
    assert not np.any(probabilities(PATHS, 6, 0, 1000, sampling) == whole)


def test_strata_of_a_latin_hypercube():
    """Every one of n equal parts of every parameter has one case; one more parameter changes none
    of the others."""
    u = probabilities(PATHS, 3, 0, 777, Sampling("lhs", 777))
    for row in u:
        assert_array_equal(np.sort(np.floor(777 * row)), np.arange(777))
    assert_array_equal(probabilities(PATHS[1:], 3, 0, 777, Sampling("lhs", 777)), u[1:])
    assert abs(stats.spearmanr(u[0], u[1]).statistic) < 0.15


def test_nets_of_a_sobol_sequence():
    """2^m points in two dimensions: one in every cell of 2^k by 2^(m - k), for all k (a (0, m,
    2)-net, Sobol 1967), and so in the next 2^m."""
    m = 8
    for first in (0, 2**m, 5 * 2**m):
        x, y = probabilities(PATHS[:2], 11, first, 2**m, Sampling("sobol"))
        for k in range(m + 1):
            cells = np.floor(2**k * x) * 2 ** (m - k) + np.floor(2 ** (m - k) * y)
            assert_array_equal(np.sort(cells), np.arange(2**m))


@pytest.mark.parametrize("sampler", SAMPLERS)
def test_every_parameter_keeps_its_law(sampler):
    """Also one that varies with others: by Kolmogorov and Smirnov, at 1e-4."""
    factor = ((1.0, 0.0, 0.0), (0.9, math.sqrt(0.19), 0.0), (0.3, -0.2, math.sqrt(0.87)))
    sampling = Sampling(sampler, 4096, (cases.Copula((0, 1, 2), factor),))
    for row in probabilities(PATHS, 1, 0, 4096, sampling):
        assert stats.kstest(row, "uniform").pvalue > 1e-4


@pytest.mark.parametrize("sampler", SAMPLERS)
@pytest.mark.parametrize("rho", [-1.0, -0.5, 0.0, 0.8, 1.0])
def test_correlation_of_normal_scores(pair, sampler, rho):
    """Of two normal laws Pearson's coefficient is the one given; of others, Spearman's is 6 / pi
    asin(rho / 2) (Kruskal 1958)."""
    n = 20_000
    laws = {"body.fore.mass_kg": {"normal": 0.1}, "body.aft.mass_kg": {"triangular": 0.5}}
    laws |= {"initial.speed_m_s": {"normal": [2.0, 0.3]}}
    together = {"parameters": ["initial.speed_m_s", *laws][:3], "coefficient": rho}
    drawn = pair(
        {
            "dispersion": laws,
            "correlation": [together | {"parameters": list(together["parameters"][:2])}],
            "run.sampler": sampler,
            "run.cases": n,
        }
    ).sample(0, n)
    bound = 4.5 * (1.0 - rho**2) / math.sqrt(n) + 1e-12
    assert abs(np.corrcoef(drawn[:, 0], drawn[:, 2])[0, 1] - rho) <= bound
    ranks = pair(
        {
            "dispersion": laws,
            "correlation": [{"parameters": list(laws)[:2], "coefficient": rho}],
            "run.sampler": sampler,
            "run.cases": n,
        }
    ).sample(0, n)
    result = stats.spearmanr(ranks[:, 0], ranks[:, 1]).statistic
    assert (
        abs(result - 6.0 / math.pi * math.asin(0.5 * rho))
        <= 5.0 / math.sqrt(n) * (1 - abs(rho)) + 1e-6
    )
    assert abs(stats.spearmanr(ranks[:, 0], ranks[:, 2]).statistic) < 4.5 / math.sqrt(n)


def test_a_matrix_of_correlations(pair):
    """Three parameters; the first of them is drawn as without the others."""
    matrix = [[1.0, 0.5, -0.3], [0.5, 1.0, 0.2], [-0.3, 0.2, 1.0]]
    laws = {name: {"normal": 0.1} for name in ("body.fore.mass_kg", "body.aft.mass_kg")}
    laws["initial.speed_m_s"] = {"normal": 0.2}
    names = list(laws)
    given = {"dispersion": laws, "correlation": [{"parameters": names, "matrix": matrix}]}
    drawn = pair(given).sample(0, 50_000)
    assert_allclose(np.corrcoef(drawn.T), matrix, atol=0.02)
    assert_array_equal(drawn[:, 0], pair({"dispersion": laws}).sample(0, 50_000)[:, 0])


@pytest.mark.parametrize(
    ("correlation", "message"),
    [
        ([{"parameters": ["body.fore.mass_kg"], "coefficient": 0.1}], "at least two"),
        ([{"parameters": ["body.fore.mass_kg", "body.aft.cg_m.x"], "coefficient": 0.1}],
         "is not dispersed"),
        ([{"parameters": ["body.fore.mass_kg", "body.aft.mas_kg"], "coefficient": 0.1}],
         "did you mean 'mass_kg'"),
        ([TOGETHER | {"coefficient": 1.2}], "coefficient = 1.2"),
        ([TOGETHER | {"matrix": [[1, 0], [0, 1]]}], "give either coefficient or matrix"),
        ([{"parameters": TOGETHER["parameters"]}], "give either coefficient or matrix"),
        ([{"parameters": TOGETHER["parameters"], "matrix": [[1.0, 0.5]]}], "2 rows of 2"),
        ([{"parameters": TOGETHER["parameters"], "matrix": [[1.0, 0.5], [0.4, 1.0]]}],
         "equal at [1][0] and [0][1]"),
        ([{"parameters": TOGETHER["parameters"], "matrix": [[1.0, 0.5], [0.5, 0.9]]}],
         "matrix = 0.9: must have 1 at [1][1]"),
        ([TOGETHER, TOGETHER], "correlated already, in correlation.0"),
        ([{"parameters": list(VARIED["dispersion"]), "coefficient": -0.9}],
         "no negative eigenvalue"),
        ([{"parameters": ["body.fore.mass_kg"] * 2, "coefficient": 0.5}], "correlated already"),
        ({"parameters": []}, "[[correlation]]"),
    ],
)  # fmt: skip
def test_bad_correlations(pair, correlation, message):
    with pytest.raises(SceneError) as raised:
        pair(VARIED | {"correlation": correlation})
    assert "correlation" in str(raised.value)
    assert message in str(raised.value)


def test_a_constant_varies_with_nothing(pair):
    """The other parameters keep their numbers."""
    values = VARIED["dispersion"]
    fixed = values | {"body.fore.mass_kg": {"constant": 3.0}}
    varied, constant = (
        pair({"dispersion": one, "correlation": [TOGETHER]}).sample(0, 100)
        for one in (values, fixed)
    )
    assert_array_equal(constant[:, 0], 3.0)
    assert_array_equal(constant[:, 1:], varied[:, 1:])


@pytest.mark.parametrize("sampler", SAMPLERS)
def test_rows_are_their_cases(pair, sampler, tmp_path):
    """Through a run folder too: what it holds is what is drawn again from its campaign.toml."""
    import sepmc

    campaign = pair(VARIED | {"run.sampler": sampler, "correlation": [TOGETHER]})
    with run_interpreted():
        result = campaign.run(cases=12, out=tmp_path / "run")
    frame, again = result.to_pandas(), sepmc.load(tmp_path / "run")
    for i in (0, 5, 11):
        for case in (result.case(i), again.case(i)):
            assert case.inputs == {name: frame[name][i] for name in case.inputs}
    if sampler == "lhs":
        with pytest.raises(InputError, match=r"case = 12: must be >= 0 and <= 11"):
            again.case(12)


def test_a_latin_hypercube_has_its_number_of_cases(pair, tmp_path):
    campaign = pair(VARIED | {"run.sampler": "lhs"})
    with run_interpreted():
        campaign.run(cases=8, out=tmp_path / "run")
        with pytest.raises(StoreError, match="Latin hypercube of 8 cases, which cannot be cont"):
            campaign.run(cases=9, out=tmp_path / "run", resume=True)
        campaign.run(cases=8, out=tmp_path / "run", resume=True)


def test_dependent_cases_get_no_verdict():
    """All cases are within the bound, but a confidence is one of independent cases."""
    item = Requirement(name="clear", metric="gap_mm", at_least=5.0, probability=0.9)
    table = {"case": np.arange(100), "status": np.array(["ok"] * 100, dtype=object)}
    table |= {"gap_mm": np.linspace(6.0, 9.0, 100)}
    rows = TableStatistics(table, ["gap_mm"], [], {}, [item])
    errors = {"gap_mm": (1e-9, 1.0)}
    assert rows.verdicts(errors, rows.audit())[0].verdict == requirements.PASS
    for sampler in ("lhs", "sobol"):
        result = rows.verdicts(errors, rows.audit(), sampler)[0]
        assert result.verdict == requirements.NONE
        assert repr(sampler) in result.why


def test_command(tmp_path):
    """``--sampler`` is the file's ``run.sampler``, kept in the run folder; what its cases are not
    is told."""
    with run_interpreted():
        called = call(
            "campaign", "table2", "--cases", 6, "--sampler", "sobol", "--out", tmp_path / "run",
            "--no-plots", "--set", "run.end_time_s=0.3",
        )  # fmt: skip
    assert called.exit_code == 0
    assert "mostly too wide; requirements get no verdict" in called.stderr
    assert "run 4 or 8 cases, not 6" in called.stderr
    assert 'sampler = "sobol"' in (tmp_path / "run" / "campaign.toml").read_text()
    notes = json.loads((tmp_path / "run" / "manifest.json").read_text())["notes"]
    assert any("power of two" in note for note in notes)
    assert call("campaign", "table2", "--sampler", "halton").exit_code == 2
    checked = call("check", "table2", "--set", "run.sampler=lhs")
    assert "sampler lhs" in checked.stdout
    assert "'lhs': confidence intervals are computed as for" in checked.stderr
