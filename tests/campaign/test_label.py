"""What a run is called in titles."""

import sepmc
from sepmc.campaign import label
from sepmc.campaign.store import manifests


def test_a_run_tells_what_was_set(tmp_path):
    """The manifest keeps it, and a run of a run's file adds to what was set before."""
    first, second = tmp_path / "first", tmp_path / "second"
    given = {"body.upper.mass_kg": 460.0, "run.sampler": "lhs", "run.cases": 20}
    sepmc.load("table2.toml", given).run(out=first)
    assert label.of_run(manifests.read_manifest(first)) == (
        "table2, 20 cases, seed 2019, sampler lhs\nset: body.upper.mass_kg = 460.0"
    )
    again = sepmc.load(first, {"solver.accuracy": 1e-8})
    assert again.with_settings({"body.upper.mass_kg": 470.0}).settings == {
        "body.upper.mass_kg": "470.0",
        "run.sampler": "lhs",
        "run.cases": "20",
        "solver.accuracy": "1e-08",
    }
    again.run(out=second)
    assert label.of_run(manifests.read_manifest(second)).endswith(
        "\nset: body.upper.mass_kg = 460.0, solver.accuracy = 1e-08"
    )


def test_a_title_stays_short():
    settings = label.as_text({f"a.b{k}": k for k in range(6)} | {"run.samples": "/a/b/plan.csv"})
    assert label.of_case("a", None, settings) == (
        "a, nominal case\nset: a.b0 = 0, a.b1 = 1, a.b2 = 2, a.b3 = 3, and 3 more"
    )
    assert settings["run.samples"] == "plan.csv"
    assert len(label.as_text({"a": "b" * 100})["a"]) == 48
    assert label.of_run({"campaign": "a", "cases": 3, "seed": 1}) == "a, 3 cases, seed 1"
    assert label.of_run({"campaign": "a", "cases": 10**7, "seed": 1}) == (
        "a, 10,000,000 cases, seed 1"
    )
