"""Signals with states: lags, servos and integrals against closed forms, and closed loops."""

import math

import numpy as np
import pytest
from numpy.testing import assert_allclose
from oracles.independent import simulate
from scipy.integrate import solve_ivp

from sepmc.scene.messages import SceneError

STILL = {
    "phase": [{"name": "free"}],
    "initial.speed_m_s": 0.0,
    "initial.altitude_m": 0.0,
    "run.end_time_s": 1.0,
    "solver.step_s": 0.01,
}
TURNING = STILL | {"initial.omega_deg_s": [0.0, 0.0, 10.0]}
JET = [{"name": "jet", "body": "fore", "force_N": ["out", 0.0, 0.0]}]
TURN = [{"name": "jet", "body": "fore", "moment_N_m": [0.0, 0.0, "out"]}]
INERTIA = 5.0  # kg m2, of `fore` about z


def flown(campaign, step_s=0.01):
    history = campaign.simulate(step_s=step_s)
    assert history.attrs["status"] == "ok"
    return history, history["time_s"].to_numpy()


def out(formula, **keys):
    return {"signal": [{"name": "out", "formula": formula, **keys}], "load": JET}


def test_lag(pair):
    """The step response of a lag is 1 - exp(-t / T), and the impulse its integral."""
    history, t = flown(pair(STILL | out("6", lag_s=0.2)))
    assert_allclose(history["signal_out"], -6.0 * np.expm1(-t / 0.2), rtol=0, atol=1e-11)
    impulse = 6.0 * (t + 0.2 * np.expm1(-t / 0.2))
    assert_allclose(3.0 * history["fore_vx_m_s"], impulse, rtol=0, atol=1e-11)


def test_initial_value(pair):
    history, t = flown(pair(STILL | out("0", lag_ms=200.0, initial=6.0)))
    assert_allclose(history["signal_out"], 6.0 * np.exp(-t / 0.2), rtol=0, atol=1e-11)


def test_rate_limit(pair):
    """A lag of 0.1 s that is limited to 20 a second: a ramp until (6 - y) / 0.1 s is as small, from
    y = 4 at 0.2 s on an exponential. The corner ends a step."""
    settings = STILL | out("6", lag_s=0.1, rate_limit=20.0) | {"solver.step_s": 0.03}
    history, t = flown(pair(settings))
    expected = np.where(t < 0.2, 20.0 * t, 6.0 - 2.0 * np.exp(-(t - 0.2) / 0.1))
    assert_allclose(history["signal_out"], expected, rtol=0, atol=1e-10)


def test_integral(pair):
    history, t = flown(pair(STILL | out("3 * time_s", integral=True, initial=1.0)))
    assert_allclose(history["signal_out"], 1.0 + 1.5 * t**2, rtol=0, atol=1e-12)


def test_servo(pair):
    """Step response of a servo, damping 0.3, 5 Hz: overshoot exp(-pi z / sqrt(1 - z^2)) at the time
    1 / (2 f sqrt(1 - z^2))."""
    z, f = 0.3, 5.0
    servo = {"natural_hz": f, "damping": z}
    root, n = math.sqrt(1.0 - z * z), 2.0 * math.pi * f
    peak = 1.0 / (2.0 * f * root)
    settings = STILL | out("1", servo=servo) | {"run.end_time_s": peak, "solver.step_s": 0.002}
    history, t = flown(pair(settings), step_s=peak / 40.0)
    decay = np.exp(-z * n * t)
    expected = 1.0 - decay * (np.cos(n * root * t) + z / root * np.sin(n * root * t))
    assert_allclose(history["signal_out"], expected, rtol=0, atol=1e-10)
    overshoot = math.exp(-math.pi * z / root)
    assert history["signal_out"].iloc[-1] == pytest.approx(1.0 + overshoot, abs=1e-9)
    # the slope is zero there: a parabola through the last rows has its top at the peak
    last = np.polyfit(t[-4:] - peak, history["signal_out"].iloc[-4:], 3)
    assert -last[2] / (2.0 * last[1]) == pytest.approx(0.0, abs=1e-4)


def test_closed_loop(pair):
    """A pitch controller whose command passes a servo and is limited before it: against scipy."""
    signals = [
        {
            "name": "command",
            "formula": "clip(-kp * fore.pitch_rad - kd * fore.omega_z_rad_s, -2, 2)",
            "kp": 300.0,
            "kd": 40.0,
        },
        {"name": "out", "formula": "command", "servo": {"natural_hz": 8.0, "damping": 0.7}},
    ]
    settings = TURNING | {"signal": signals, "load": TURN, "solver.step_s": 0.002}
    history, t = flown(pair(settings))
    n = 2.0 * math.pi * 8.0

    def rates(_, y):
        command = min(max(-300.0 * y[0] - 40.0 * y[1], -2.0), 2.0)
        return [y[1], y[2] / INERTIA, y[3], n * n * (command - y[2]) - 2.0 * 0.7 * n * y[3]]

    start = [0.0, math.radians(10.0), 0.0, 0.0]
    expected = solve_ivp(
        rates, (0.0, 1.0), start, "DOP853", t, rtol=1e-12, atol=1e-13, max_step=1e-3
    )
    assert_allclose(history["fore_pitch_deg"], np.degrees(expected.y[0]), rtol=0, atol=1e-6)
    assert_allclose(history["signal_out"], expected.y[2], rtol=0, atol=1e-6)
    assert history["signal_command"].min() == -2.0


def test_loop_through_a_state(pair):
    """Signals may depend on each other through a state: an oscillator of two integrals."""
    signals = [
        {"name": "out", "formula": "4 * rate", "integral": True, "initial": 1.0},
        {"name": "rate", "formula": "push", "integral": True},
        {"name": "push", "formula": "-4 * out"},
    ]
    history, t = flown(pair(STILL | {"signal": signals, "load": JET}))
    assert_allclose(history["signal_out"], np.cos(4.0 * t), rtol=0, atol=1e-11)


def test_dispersed_response(pair, plainly):
    """The numbers of a response are dispersed as any others."""
    settings = STILL | out("6", servo={"natural_hz": 5.0, "damping": 0.3}, initial=2.0)
    settings["dispersion"] = {
        "signal.out.servo.natural_hz": {"uniform": [4.0, 6.0]},
        "signal.out.servo.damping": {"uniform": [0.2, 0.4]},
        "signal.out.initial": {"uniform": 1.0},
    }
    del settings["solver.step_s"]
    campaign = pair(settings)
    rows = campaign.run(cases=2).to_pandas()
    for row in rows.to_dict("records"):
        n, z = (
            2.0 * math.pi * row["in_signal_out_servo_natural_hz"],
            row["in_signal_out_servo_damping"],
        )

        def rates(_, y, n=n, z=z):
            return [y[1], n * n * (6.0 - y[0]) - 2.0 * z * n * y[1], y[0] / 3.0]

        start = [row["in_signal_out_initial"], 0.0, 0.0]
        end = solve_ivp(rates, (0.0, 1.0), start, "DOP853", rtol=1e-12, atol=1e-13).y[2, -1]
        assert row["separation_speed_m_s"] == pytest.approx(end, rel=1e-8)


@pytest.mark.parametrize(
    ("keys", "message"),
    [
        (
            {"lag_s": 0.1, "integral": True},
            "signal.out: has lag_s and integral: give only one of them",
        ),
        ({"rate_limit": 2.0}, "signal.out.rate_limit = 2.0: needs lag_s"),
        ({"initial": 2.0}, "signal.out.initial = 2.0: needs lag_s, servo, integral or delay_s"),
        ({"delay_s": 0.1}, "signal.out.delay_s = 0.1: needs sample_s"),
        ({"delay_s": 0.1, "sample_s": 0.05}, "must be at most sample_s = 0.05"),
        ({"sample_s": 1e-6}, "gives more than 100,000 samples up to 1 s"),
        ({"lag_s": 0.0}, "signal.out.lag_s = 0.0: must be > 0"),
        ({"servo": {"natural_hz": 5.0}}, "'damping' is missing"),
        ({"servo": {"natural_hz": 5.0, "damping": -1.0}}, "must be >= 0"),
        ({"integral": 1}, "must be true or false"),
    ],
)
def test_messages(pair, keys, message):
    with pytest.raises(SceneError) as error:
        pair(STILL | out("1", **keys))
    assert message in str(error.value)


@pytest.mark.parametrize("key", ["initial", "delay_s"])
def test_numbers_without_effect_cannot_vary(pair, key):
    settings = STILL | out("1") | {"dispersion": {f"signal.out.{key}": {"uniform": [0.0, 0.1]}}}
    with pytest.raises(SceneError, match="has no effect on this signal, so it cannot vary"):
        pair(settings)


def test_initial_value_of_a_sampled_signal_needs_a_delay_to_vary(pair):
    """The sample at the start takes effect at once without one: no value comes before it."""
    vary = {"dispersion": {"signal.out.initial": {"uniform": [0.0, 0.1]}}}
    with pytest.raises(SceneError, match="has no effect on this signal, so it cannot vary"):
        pair(STILL | out("1", sample_s=0.1) | vary)
    pair(STILL | out("1", sample_s=0.1, delay_s=0.05) | vary)


def test_loop_without_a_state(pair):
    signals = [{"name": "out", "formula": "2 * b"}, {"name": "b", "formula": "out"}]
    with pytest.raises(SceneError, match="depends on itself at once: out -> b -> out; a lag_s"):
        pair(STILL | {"signal": signals, "load": JET})


def sampled_pendulum(kp, kd, sample, delay, end):
    """Times, pitch and rate of a body under a sampled controller, at the samples: parabolas between
    the changes of its moment."""
    y, moment, rows = np.array([0.0, math.radians(10.0)]), 0.0, []

    def moved(y, h):
        turned = y[0] + h * y[1] + 0.5 * h * h * moment / INERTIA
        return np.array([turned, y[1] + h * moment / INERTIA])

    for k in range(round(end / sample) + 1):
        rows.append((k * sample, *y))
        command = -kp * y[0] - kd * y[1]
        y = moved(y, delay)
        moment = command
        y = moved(y, sample - delay)
    return rows


@pytest.mark.slow
@pytest.mark.parametrize(
    "keys",
    [
        {"lag_s": 0.1, "rate_limit": 3.0},
        {"servo": {"natural_hz": 4.0, "damping": 0.4}, "initial": 0.5},
        {"integral": True, "sample_s": 0.11},
        {"sample_s": 0.11, "delay_s": 0.05, "initial": 0.7},
    ],
)
def test_against_the_independent_flight(pair, plainly, keys):
    """A response that feeds back, with kinks of what follows it."""
    formula = "sin(6 * time_s) - fore.omega_z_rad_s"
    signals = [
        {"name": "push", "formula": formula, **keys},
        {"name": "out", "formula": "max(push, 0.2) + where(push > 0.5, 0.3, 0)"},
    ]
    load = {"name": "jet", "body": "fore", "force_N": [5.0, "push", "out"]}
    load |= {"moment_N_m": [0.0, 0.3, "push"], "point_m": [0.9, 0.0, 0.05]}
    settings = {"phase": [{"name": "free"}], "run.end_time_s": 1.0, "solver": {"accuracy": 1e-8}}
    settings["dispersion"] = {"body.fore.mass_kg": {"uniform": 0.5}}
    campaign = pair(settings | {"signal": signals, "load": [load]})
    for row in campaign.run(cases=2).to_pandas().to_dict("records"):
        expected = simulate(campaign.case(row["case"]).to_dict())
        assert row["status"] == expected.status == "ok"
        for name, value in expected.outcomes.items():
            if math.isfinite(value):
                assert row[name] == pytest.approx(value, rel=1e-7, abs=1e-7), name


@pytest.mark.parametrize("delay", [0.0, 0.015])
def test_sampled_controller(pair, delay):
    """A sampled and delayed controller of pitch: exact parabolas between its changes."""
    signal = {
        "name": "out",
        "formula": "-kp * fore.pitch_rad - kd * fore.omega_z_rad_s",
        "kp": 200.0,
        "kd": 20.0,
        "sample_s": 0.04,
        "delay_s": delay,
    }
    settings = TURNING | {"signal": [signal], "load": TURN, "solver.step_s": 0.3}
    history, t = flown(pair(settings), step_s=0.04)
    for time, pitch, rate in sampled_pendulum(200.0, 20.0, 0.04, delay, 1.0):
        row = history.iloc[np.abs(t - time).argmin()]
        assert row["time_s"] == pytest.approx(time, abs=1e-12)
        assert row["fore_pitch_deg"] == pytest.approx(math.degrees(pitch), abs=1e-10)
        assert row["fore_omega_z_deg_s"] == pytest.approx(math.degrees(rate), abs=1e-10)
    assert abs(history["fore_pitch_deg"].iloc[-1]) < 1.0


def test_sampled_ramp(pair):
    """A sampled ramp is a staircase; a servo follows the held value; a kink of it is passed."""
    signals = [
        {"name": "stairs", "formula": "time_s", "sample_s": 0.25},
        {"name": "out", "formula": "max(3 * stairs - 1, 0) + where(stairs > 0.6, 1, 0)"},
    ]
    history, t = flown(pair(STILL | {"signal": signals, "load": JET, "solver.step_s": 0.3}))
    inside = np.abs(t / 0.25 - np.round(t / 0.25)) > 1e-9
    stairs = 0.25 * np.floor(t / 0.25)
    assert_allclose(history["signal_stairs"][inside], stairs[inside], rtol=0, atol=1e-12)
    impulse = 0.25 * (0.0 + 0.0 + 0.5 + 1.25 + 1.0)
    assert history["fore_vx_m_s"].iloc[-1] * 3.0 == pytest.approx(impulse, abs=1e-12)


@pytest.mark.parametrize("first", ["b", "time_s"])
def test_samples_due_at_one_instant_are_taken_in_the_order_of_the_file(pair, first):
    """A signal sees the samples that others before it have just taken, also if a third one, still
    before these, has read the old ones."""
    signals = [
        {"name": "a", "formula": first, "sample_s": 0.25},
        {"name": "b", "formula": "time_s", "sample_s": 0.25},
        {"name": "out", "formula": "b + 0 * a", "sample_s": 0.25},
    ]
    history, t = flown(pair(STILL | {"signal": signals, "load": JET, "solver.step_s": 0.3}))
    inside = np.abs(t / 0.25 - np.round(t / 0.25)) > 1e-9
    stairs = 0.25 * np.floor(t[inside] / 0.25)
    assert_allclose(history["signal_out"][inside], stairs, rtol=0, atol=1e-12)
    before = np.maximum(stairs - 0.25, 0.0) if first == "b" else stairs
    assert_allclose(history["signal_a"][inside], before, rtol=0, atol=1e-12)


def test_undefined_sample(pair):
    signal = {"name": "out", "formula": "log(0.5 - time_s)", "sample_s": 0.3}
    history = pair(STILL | {"signal": [signal], "load": JET}).simulate(step_s=0.1)
    assert history.attrs["status"] == "undefined-formula"
