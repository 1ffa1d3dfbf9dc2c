"""Motors that ignite at an event, a release or when a joint becomes free."""

import math

import pytest

from sepmc.scene.messages import SceneError

# the aft body is freed at 0.1 s; its motor pushes it aft with 2 N, so 2 m/s2
_FREED = {
    "phase": [
        {"name": "locked", "joints": {"pins": "fixed"}, "until": {"time_s": 0.1}},
        {"name": "free", "joints": {}},
    ],
    "event": [{"name": "cue", "when": {"time_s": 0.15}}],
}


def _motor(**keys):
    return {"name": "retro", "body": "aft", "thrust_N": 2.0, "station_m": 3.0, **keys}


def _flown(pair, **keys):
    """Outcomes of the nominal case with such a motor."""
    campaign = pair({**_FREED, "motor": [_motor(**keys)]})
    return campaign.simulate(step_s=0.1).attrs["outcomes"]


@pytest.mark.parametrize(
    ("ignition", "lights"),
    [
        ({"event": "cue"}, 0.15),
        ({"event": "cue", "delay_s": 0.05}, 0.20),
        ({"joint": "pins"}, 0.10),
        ({"joint": "pins", "delay_ms": 30.0}, 0.13),
    ],
)
def test_speed_of_a_motor_that_lights_late(pair, ignition, lights):
    """v = F / m (t - t0) for a burn that continues, F / m times the burn time for one that ends."""
    flown = _flown(pair, ignition=ignition)
    assert flown["retro_ignition_time_s"] == pytest.approx(lights, abs=1e-12)
    assert flown["separation_speed_m_s"] == pytest.approx(2.0 * (0.5 - lights), rel=1e-9)
    ended = _flown(pair, ignition=ignition, burn_s=0.1)
    assert ended["separation_speed_m_s"] == pytest.approx(0.2, rel=1e-9)


def test_the_clock_of_a_motor_starts_when_it_lights(pair):
    """Build-up, profile and tail-off count from the ignition."""
    ignition, lasts = {"event": "cue"}, 0.35
    built = _flown(pair, ignition=ignition, build_up_s=0.1)
    speed = 2.0 * (lasts - 0.1 * (1.0 - math.exp(-lasts / 0.1)))
    assert built["separation_speed_m_s"] == pytest.approx(speed, rel=1e-9)
    ramp = {"time_s": [0.0, 0.1, 0.2], "fraction": [0.0, 1.0, 0.0]}
    profiled = _flown(pair, ignition=ignition, profile=ramp)
    assert profiled["separation_speed_m_s"] == pytest.approx(0.2, rel=1e-9)
    tailed = _flown(pair, ignition=ignition, burn_s=0.1, tail_off_s=0.05)
    speed = 0.2 + 2.0 * 0.05 * (1.0 - math.exp(-0.25 / 0.05))
    assert tailed["separation_speed_m_s"] == pytest.approx(speed, rel=1e-9)


def test_a_motor_whose_event_does_not_come_does_not_light(pair):
    """Its ignition time is NaN, and its thrust is zero."""
    late = {**_FREED, "event": [{"name": "cue", "when": {"time_s": 0.9}}]}
    campaign = pair({**late, "motor": [_motor(ignition={"event": "cue"})]})
    flown = campaign.simulate(step_s=0.1).attrs["outcomes"]
    assert math.isnan(flown["retro_ignition_time_s"])
    assert flown["separation_speed_m_s"] == pytest.approx(0.0, abs=1e-12)


_BURNING = _motor(burn_s=0.1)
_ROUND = "waits for a burn-out, its own or that of another motor, that itself waits"
_CUE, _VARIED = {"event": "cue"}, {"uniform": [0.0, 0.1]}


def _lit(**scene):
    return {"motor": [_BURNING | {"ignition": _CUE}], **scene}


def _waits(**ignition):
    return {"motor": [_BURNING | {"ignition": ignition}]}


@pytest.mark.parametrize(
    ("settings", "message"),
    [
        (_waits(event="cus"), "ignition.event = 'cus': no such event; did you mean 'cue'?"),
        (_waits(release="cut"), "ignition.release = 'cut': no such release; known here: nothing"),
        (_waits(joint="pinz"), "ignition.joint = 'pinz': no such joint; did you mean 'pins'?"),
        (_waits(event="cue", delay_s=-0.1), "ignition.delay_s = -0.1: must be >= 0"),
        (_waits(event="cue", delay_s=math.inf), "ignition.delay_s = inf: must be finite"),
        (_waits(event="cue", delay=0.1), "ignition.delay: the unit is missing; allowed: delay_s"),
        (_waits(event="cue", joint="pins"), "give exactly one of event, release, joint, not"),
        (_waits(), "ignition: give exactly one of event, release, joint"),
        (_waits(event=3), "ignition.event = 3: must be text, got a whole number"),
        (_waits(event=["cue"]), "ignition.event = ['cue']: must be text, got a list"),
        ({"motor": [_BURNING | {"ignition": 0.3}]}, "ignition = 0.3: the unit is missing"),
        ({"motor": [_BURNING | {"ignition": _CUE, "ignition_s": 0.3}]}, "ignition_s: given twice"),
        (_lit(event=[{"name": "cue", "when": {"burn_out": "retro"}}]), f"ignition: never comes: "
         f"it {_ROUND}"),
        ({"event": [{"name": name, "when": {"burn_out": other}} for name, other in
                    (("cue", "kick"), ("reply", "retro"))],
          "motor": [_BURNING | {"ignition": _CUE},
                    _BURNING | {"name": "kick", "ignition": {"event": "reply"}}]}, _ROUND),
        (_lit(phase=[{"name": "locked", "joints": {"pins": "fixed"},
                      "until": {"burn_out": "retro"}}, {"name": "free"}])
         | _waits(joint="pins"), _ROUND),
        (_waits(joint="pins") | {"phase": [{"name": "free"}]}, "is free from the start"),
        (_waits(joint="pins") | {"phase": [{"name": "a", "joints": {"pins": "fixed"}}]},
         "is never free: no phase or [[release]] frees it"),
        (_lit(dispersion={"motor.retro.ignition_s": _VARIED}),
         "ignition_s: 'ignition_s' is not set in this scene, which has 'ignition' instead"),
        ({"motor": [_BURNING], "dispersion": {"motor.retro.ignition.delay_s": _VARIED}},
         "'ignition' is not set in this scene, which has 'ignition_s' instead"),
        (_lit(dispersion={"motor.retro.ignition.event": _VARIED}), "is not a number"),
        (_lit(dispersion={"motor.retro.ignition.delay_s": {"uniform": [-0.1, 0.1]}}),
         "the distribution reaches -0.1, but the value must be >= 0"),
    ],
)  # fmt: skip
def test_an_ignition_that_cannot_be(pair, settings, message):
    """The message has the place, the value and the allowed values."""
    with pytest.raises(SceneError) as refused:
        pair(_FREED | settings)
    line = next(line for line in str(refused.value).splitlines() if message in line)
    assert "motor.retro.ignition" in line


def test_an_event_called_as_an_ignition_is_told(pair):
    """Both have a time column of one name."""
    events = [{"name": "retro_ignition", "when": {"time_s": 0.1}}]
    waits = {"ignition": {"event": "retro_ignition"}}
    with pytest.raises(SceneError, match=r"event\.retro_ignition .* two outcomes called retro_ig"):
        pair(_FREED | {"event": events, "motor": [_BURNING | waits]})


def test_a_campaign_lights_as_a_single_run_does(pair, plainly):
    """Rows of a campaign have the outcomes of single runs, with a dispersed delay.
    `test_everything` compiles one."""
    path = "motor.retro.ignition.delay_s"
    campaign = pair(
        {
            **_FREED,
            "motor": [_motor(ignition={"event": "cue", "delay_s": 0.05}, burn_s=0.1)],
            "dispersion": {path: {"uniform": [0.0, 0.1]}},
        }
    )
    cases = campaign.run(8, announce=lambda text: None).to_pandas()
    assert (cases["status"] == "ok").all()
    lit = 0.15 + cases["in_motor_retro_ignition_delay_s"]
    assert cases["retro_ignition_time_s"].to_numpy() == pytest.approx(lit.to_numpy(), abs=1e-12)
    assert cases["separation_speed_m_s"].to_numpy() == pytest.approx(0.2, rel=1e-8)
