"""How much work a flight may take, counted: what is told of one that takes more."""

import re

import numpy as np
import pytest
from click.testing import CliRunner

from sepmc.campaign.execution import single_case, step_selection
from sepmc.campaign.execution.step_search import Search
from sepmc.cli import app, check
from sepmc.scene.messages import no_log

# a mote of 1e-4 kg on 1e5 kg that turn 50 times a second
MOTE = """
environment = { atmosphere = "none", gravity = "none" }
[body.fore]
mass_kg = 1e5
inertia_kg_m2 = [3e5, 4e5, 5e5]
cg_m = [1.0, 0.0, 0.0]
[body.aft]
mass_kg = 1e-4
inertia_kg_m2 = [1e-7, 2e-7, 2.5e-7]
cg_m = [3.0, 0.1, 0.0]
[joint.pins]
bodies = ["fore", "aft"]
point_m = [2.0, 0.0, 0.0]
[[phase]]
name = "held"
joints = { pins = "spherical" }
until = { time_s = 5.0 }
[[phase]]
name = "free"
[initial]
altitude_m = 1000.0
speed_m_s = 1.0
omega_deg_s = [18000.0, 0.0, 300.0]
[run]
end_time_s = 10.0
"""
TURNING = {
    "phase": [{"name": "free"}],
    "initial.omega_deg_s": [1.8e5, 0.0, 0.0],
    "run.end_time_s": 1.0,
    "solver": {"accuracy": 1e-6},
}


def test_check_tells_what_it_knows_before_it_flies(tmp_path, monkeypatch):
    """And ends, without saying that the scene can be flown, once its work is spent."""
    from sepmc.campaign.campaign import Campaign

    seen = []
    file = tmp_path / "mote.toml"
    file.write_text(MOTE + '[[load]]\nname = "idle"\nbody = "fore"\n')
    flown = Campaign.simulate
    monkeypatch.setattr(check, "_WORK", 1e6)
    monkeypatch.setattr(
        Campaign, "simulate", lambda *given, **more: (seen.append(1), flown(*given, **more))[1]
    )
    result = CliRunner().invoke(app.main, ["check", str(file)])
    assert result.exit_code == 0
    assert seen
    assert "load.idle does nothing" in result.stderr
    position = result.stderr.index("the nominal case did not reach its end: an integration of ")
    assert result.stderr.index("load.idle does nothing") < position
    assert re.search(r"stopped at [\d.e-]+ of 10 s", result.stderr[position:])
    assert "solver.step_s" in result.stderr[position:]
    assert "can be run\n" not in result.stdout
    assert "whether it runs is not known" in result.stdout
    assert f"sepmc run {file} compiles it" in result.stdout


def test_work_is_counted_alike_each_time(pair):
    """In lines of kernels; no seconds are in it."""
    texts = []
    for _ in range(2):
        with pytest.raises(single_case.UnknownError) as caught:
            pair(TURNING).simulate(step_s=0.5, announce=no_log, plain_work=2e5)
        texts.append(str(caught.value))
    assert texts[0] == texts[1]
    assert "steps a phase takes too long here" in texts[0]
    assert texts[0].endswith("then give solver.step_s, or compile: sepmc run")
    assert "the limit is one of work, not of time" in texts[0]


def test_a_step_that_is_far_too_short(pair):
    """The sentence names it, and how far the flight came."""
    campaign = pair({"solver": {"step_s": 1e-5}})
    with pytest.raises(
        single_case.UnknownError, match=r"in steps of 1e-05 s.*give a longer solver"
    ):
        campaign.simulate(step_s=0.5, announce=no_log, plain_work=2e5)


def test_a_case_whose_work_is_spent_says_so(pair, monkeypatch):
    """Its status stands, its error is told as it is, and a note says why."""
    monkeypatch.setattr(single_case, "_COMPILED_WORK", 1e4)
    monkeypatch.setattr(single_case, "_PLAIN_WORK", 1e4)
    heard = []

    def plainly(text, announce=None):
        heard.append("compiled")
        with single_case.interpreted():
            return load(text)

    load = single_case.load_kernel
    monkeypatch.setattr(single_case, "load_kernel", plainly)
    result = pair(
        TURNING | {"initial.omega_deg_s": [180.0, 0.0, 90.0], "solver": {"accuracy": 1e-12}}
    ).simulate(step_s=0.5, announce=heard.append)
    assert result.attrs["status"] == "ok"
    assert any("its integrations take up to about" in text for text in heard)
    note = result.attrs["notes"][0]
    assert re.search(r"time of a case was used up at \d+ steps a phase, before it converged", note)


def test_a_case_that_no_steps_suffice_is_unresolved(pair, monkeypatch):
    """Its work is spent before a body turns no more than it may in a step."""
    monkeypatch.setattr(single_case, "_PLAIN_WORK", 2e5)
    monkeypatch.setattr(single_case, "_COMPILED_WORK", 2e5)
    load = single_case.load_kernel

    def plainly(text, announce=None):
        with single_case.interpreted():
            return load(text)

    monkeypatch.setattr(single_case, "load_kernel", plainly)
    result = pair(TURNING | {"initial.omega_deg_s": [1.8e6, 0.0, 0.0]}).simulate(
        step_s=0.5, announce=no_log
    )
    assert result.attrs["status"] == "unresolved"
    assert any("steps a phase do not suffice" in note for note in result.attrs["notes"])


def test_a_long_flight_is_foretold(pair, monkeypatch):
    """How many seconds, before it begins."""
    monkeypatch.setattr(single_case, "_LONG_S", 0.0)
    heard = []
    pair({"solver": {"accuracy": 1e-9}}).simulate(step_s=0.1, announce=heard.append)
    assert any(
        re.fullmatch(r"the next integration takes plain Python about \d+ s ...", t) for t in heard
    )


def test_trial_cases_are_flown_no_more_than_needed(plainly, pair, monkeypatch):
    """All of the sample twice, in the steps found and in half of these, histories among it."""
    flights, integrate_cases = [], step_selection.integrate_cases

    def counted(kernel, plan, steps, usual, slots, draws, *more, **named):
        flights.append(len(draws))
        return integrate_cases(kernel, plan, steps, usual, slots, draws, *more, **named)

    monkeypatch.setattr(step_selection, "integrate_cases", counted)
    monkeypatch.setattr("sepmc.campaign.execution.common_steps.integrate_cases", counted)
    monkeypatch.setattr("sepmc.campaign.execution.integration.integrate_cases", counted)
    campaign = pair(
        {"solver": {"accuracy": 1e-6}, "run.history_step_s": 0.1,
         "dispersion": {"body.aft.mass_kg": {"uniform": 0.1}}}
    )  # fmt: skip
    result = step_selection.select_steps(campaign, history=True)
    all_of_them = step_selection.CORNERS + 1 + step_selection.SAMPLE
    assert sum(n >= step_selection.SAMPLE for n in flights) == 2
    assert flights.count(all_of_them) == 2
    assert np.isfinite(result.achieved.history)


def test_a_search_of_steps_that_is_spent_makes_do(monkeypatch):
    """It tries no more once its work is spent, and its steps still come within the goal."""
    spent = []

    def flown(steps, methods, draws):
        spent.append(len(draws) * int(steps.sum()))
        return np.full((len(draws), 1), 1.0 + (1e-3 / steps**2).sum()), np.ones(len(draws))

    def found():
        spent.clear()
        search = Search(flown, np.zeros((3, 0)), np.ones(1), 1e-8, np.array([True]), [[4]] * 3)
        steps = search.fewest_steps(np.full(3, 2))
        return steps, search.error(steps), sum(spent)

    steps, error, whole = found()
    assert error <= 1e-8
    monkeypatch.setattr("sepmc.campaign.execution.step_search._MAX_WORK", whole // 2)
    fewer, error, work = found()
    assert error <= 1e-8
    assert (fewer >= steps).all()
    assert work < whole
