"""In a host's process: objects that are copied, and processes, threads and locks that are not
sepmc's own."""

import copy
import pickle

import numpy as np
import pandas as pd
import pytest

import sepmc

QUICK = {
    "solver.step_s": 0.1,
    "run.history_step_s": 0.0,
    "dispersion": {"body.upper.mass_kg": {"uniform": 20.0}},
}
WAYS = {"pickle": lambda x: pickle.loads(pickle.dumps(x)), "deepcopy": copy.deepcopy}


@pytest.fixture(scope="module")
def campaign():
    return sepmc.load("table2.toml", QUICK)


# copies


@pytest.mark.parametrize("name", ["table2", "spring-pushers", "srb"])
@pytest.mark.parametrize("way", WAYS)
def test_copies_of_campaigns_and_cases(name, way):
    """Scene, laws, settings and cases are those of the first, and its fields have their bounds."""
    first = sepmc.load(name, {"run.seed": 7})
    first.columns  # noqa: B018  (what is kept of a campaign is copied with it)
    for again in (WAYS[way](first), WAYS[way](WAYS[way](first))):
        assert (again.digest, again.settings) == (first.digest, {"run.seed": "7"})
        assert again.scene == first.scene
        np.testing.assert_array_equal(again.draw(0, 9), first.draw(0, 9))
        assert again.case(4).scene == WAYS[way](first.case(4)).scene == first.case(4).scene
        for one, other in zip(again.file.dispersions, first.file.dispersions, strict=True):
            assert one.parameter.field == other.parameter.field
        body = next(iter(first.scene.body))
        with pytest.raises(sepmc.SceneError, match="must be > 0"):
            again.with_settings({f"body.{body}.mass_kg": -1.0})


@pytest.mark.parametrize("way", WAYS)
@pytest.mark.parametrize("kind", ["memory", "folder", "statistics"])
def test_copies_of_results(campaign, way, kind, tmp_path):
    folder = tmp_path / "run" if kind == "folder" else None
    result = campaign.run(cases="3:9", out=folder, stats_only=kind == "statistics")
    again = WAYS[way](result)
    pd.testing.assert_frame_equal(again.statistics(), result.statistics(), check_exact=True)
    pd.testing.assert_frame_equal(again.requirements(), result.requirements())
    assert (again.status_counts, again.case(8)) == (result.status_counts, result.case(8))
    if kind != "statistics":
        pd.testing.assert_frame_equal(again.to_pandas(), result.to_pandas(), check_exact=True)
        pd.testing.assert_frame_equal(
            again.campaign.run(cases="3:9").to_pandas(),
            campaign.run(cases="3:9").to_pandas(),
            check_exact=True,
        )
    assert again.flight.method_names == result.flight.method_names


def test_copies_of_histories(campaign):
    history = campaign.simulate(3, step_s=0.1)
    for way in WAYS.values():
        again = way(history)
        pd.testing.assert_frame_equal(again, history, check_exact=True)
        assert again.attrs == history.attrs


def test_a_copied_kernel_holds_no_address(campaign):
    """It would be that of another process."""
    flight = campaign.run(cases=2).flight
    assert flight.kernel.address
    for way in WAYS.values():
        assert (way(flight).kernel.address, len(way(flight).kernel.calls)) == (0, 0)
