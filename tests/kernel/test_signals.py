"""Loads, motors and springs by formulas: closed forms, kinks, undefined formulas, messages."""

import math
import warnings

import numpy as np
import pytest
from numpy.testing import assert_allclose
from oracles.independent import simulate

from sepmc.campaign.execution.diagnostics import idle_loads
from sepmc.kernel.spec.structure import make_kernel_spec
from sepmc.scene.messages import SceneError

STILL = {
    "phase": [{"name": "free"}],
    "initial.speed_m_s": 0.0,
    "initial.altitude_m": 0.0,
    "run.end_time_s": 1.0,
    "solver.step_s": 0.01,
}
TURNING = STILL | {"initial.omega_deg_s": [0.0, 0.0, 10.0]}
FORE = 3.0  # kg; 0.5 m ahead of the origin, inertia 3, 4, 5 kg m2


def signal(formula, name="push", **constants):
    return {"name": name, "formula": formula, **constants}


def pushed(formula, key="force_N", load=None, **constants):
    """Settings of a load along x, or a moment about z, by a formula."""
    push = ["push", 0.0, 0.0] if key == "force_N" else [0.0, 0.0, "push"]
    jet = {"name": "jet", "body": "fore", key: push} | (load or {})
    return {"signal": [signal(formula, **constants)], "load": [jet]}


def flown(campaign):
    history = campaign.simulate(step_s=0.05)
    assert history.attrs["status"] == "ok"
    return history


def along(history):
    return history["time_s"].to_numpy(), history["fore_x_m"].to_numpy(), history["fore_vx_m_s"]


def test_over_time(pair):
    history = flown(pair(STILL | pushed("peak * exp(-time_s / tau)", peak=6.0, tau=0.2)))
    t, _, v = along(history)
    assert_allclose(v, 6.0 * 0.2 / FORE * -np.expm1(-t / 0.2), rtol=0, atol=1e-12)
    assert_allclose(history["signal_push"], 6.0 * np.exp(-t / 0.2), rtol=1e-14)


def test_over_position(pair):
    t, x, _ = along(flown(pair(STILL | pushed("-k * fore.x_mm", key="force_N", k=0.027))))
    assert_allclose(x, 0.5 * np.cos(3.0 * t), rtol=0, atol=1e-11)


def test_over_angular_rate(pair):
    """A moment -c w damps a rate with the time constant I / c; in degrees as in radians."""
    damped = TURNING | pushed("-c * fore.omega_z_rad_s", key="moment_N_m", c=8.0)
    history = flown(pair(damped))
    t = history["time_s"]
    expected = 10.0 * np.exp(-8.0 / 5.0 * t)
    assert_allclose(history["fore_omega_z_deg_s"], expected, rtol=0, atol=1e-10)
    formula = "-c * fore.omega_z_deg_s * pi / 180"
    degrees = flown(pair(TURNING | pushed(formula, key="moment_N_m", c=8.0)))
    assert_allclose(degrees["fore_omega_z_deg_s"], expected, rtol=0, atol=1e-10)


def test_over_pitch(pair):
    """A torsion spring about pitch: the pitch is (w0 / n) sin n t."""
    settings = TURNING | pushed("-k * fore.pitch_rad", key="moment_N_m", k=80.0)
    history = flown(pair(settings))
    pitch = 10.0 / 4.0 * np.sin(4.0 * history["time_s"])
    assert_allclose(history["fore_pitch_deg"], pitch, rtol=0, atol=1e-10)


def test_full_turns(pair):
    """Pitch counts full turns, in a formula as in the outcomes."""
    settings = STILL | {"initial.omega_deg_s": [0.0, 0.0, 720.0]}
    history = flown(pair(settings | pushed("0 * time_s + fore.pitch_deg")))
    assert_allclose(history["signal_push"], 720.0 * history["time_s"], rtol=0, atol=1e-9)
    assert history["signal_push"].iloc[-1] == pytest.approx(720.0)


def test_unit_of_the_key(pair):
    """A signal is in the unit of the key that names it."""
    load = {"force_N": [0.0, 0.0, 0.0], "force_kN": ["push", 0, 0]}
    del load["force_N"]
    jet = [{"name": "jet", "body": "fore", **load}]
    settings = STILL | {"signal": [signal("0.006")], "load": jet}
    t, _, v = along(flown(pair(settings)))
    assert_allclose(v, 2.0 * t, rtol=0, atol=1e-12)


def test_signals_of_signals(pair):
    signals = [
        signal("2 * base + base * shape"),
        signal("gain * 1.5", name="base", gain=2.0),
        signal("time_s", name="shape"),
    ]
    jet = [{"name": "jet", "body": "fore", "force_N": {"x": "push"}}]
    t, _, v = along(flown(pair(STILL | {"signal": signals, "load": jet})))
    assert_allclose(v, (6.0 * t + 1.5 * t**2) / FORE, rtol=0, atol=1e-12)


def test_dispersed_constant(pair, plainly):
    """A constant of a signal is dispersed as any number, and a column of the rows."""
    settings = STILL | pushed("peak * time_s", peak=6.0)
    settings["dispersion"] = {"signal.push.peak": {"uniform": [3.0, 9.0]}}
    settings["joint.pins.point_m"] = [2.0, 0.0, 0.0]
    del settings["solver.step_s"]
    rows = pair(settings).run(cases=3).to_pandas()
    assert rows["in_signal_push_peak"].nunique() == 3
    speed = rows["in_signal_push_peak"] / 2.0 / FORE
    assert_allclose(rows["separation_speed_m_s"], speed, rtol=1e-9)


def test_motor(pair):
    """Thrust and deflection by signals: thrust rises, and is turned by 30 deg at once."""
    motor = {
        "name": "main", "body": "fore", "station_m": 1.0, "cant_deg": 0.0,
        "thrust_N": "thrust", "deflection_deg": "angle", "deflection_clock_deg": 90.0,
    }  # fmt: skip
    signals = [
        signal("6 * time_s", name="thrust"),
        signal("where(time_s < 0.5, 0, 30)", name="angle"),
    ]
    history = flown(pair(STILL | {"motor": [motor], "signal": signals}))
    t, _, v = along(history)
    turned = np.clip(t, 0.5, None)
    expected = np.clip(t, None, 0.5) ** 2 + math.cos(math.pi / 6.0) * (turned**2 - 0.25)
    assert_allclose(v, expected, rtol=0, atol=1e-11)
    side = -math.sin(math.pi / 6.0) * (turned**2 - 0.25)
    assert_allclose(history["fore_vy_m_s"], side, rtol=0, atol=1e-11)


def test_spring(pair):
    """A spring whose factor falls to half at an extension: the energy is the area below it."""
    push = {
        "name": "push", "bodies": ["fore", "aft"], "point_m": [2.0, 0.0, 0.0],
        "axis": [-1.0, 0.0, 0.0], "force_N": 12.0, "factor": "weak",
    }  # fmt: skip
    signals = [signal("where(spring.push.extension_mm < 100, 1, 0.5)", name="weak")]
    history = flown(pair(STILL | {"spring": [push], "signal": signals}))
    gap = (history["fore_x_m"] - history["aft_x_m"]).to_numpy() - 2.0
    speed = (history["fore_vx_m_s"] - history["aft_vx_m_s"]).to_numpy()
    work = 12.0 * np.minimum(gap, 0.1) + 6.0 * np.clip(gap - 0.1, 0.0, None)
    assert_allclose(0.5 * 0.75 * speed**2, work, rtol=0, atol=1e-11)


def test_switch_in_time(pair):
    """A step ends at a switch: no error, however long steps are."""
    settings = STILL | pushed("where(time_s < 0.37, 6, 0)") | {"solver.step_s": 0.3}
    t, _, v = along(flown(pair(settings)))
    assert_allclose(v, 2.0 * np.minimum(t, 0.37), rtol=0, atol=1e-13)


def test_switch_on_state(pair):
    """A bang-bang force: parabolas that meet where the position is 0.6 m, located as an event."""
    settings = STILL | pushed("where(fore.x_m < 0.6, 3, -3)") | {"solver.step_s": 0.3}
    t, x, v = along(flown(pair(settings)))
    first = math.sqrt(0.2)
    later = t - first
    before = t <= first
    assert_allclose(v, np.where(before, t, first - later), rtol=0, atol=1e-9)
    expected = np.where(before, 0.5 + 0.5 * t**2, 0.6 + first * later - 0.5 * later**2)
    assert_allclose(x, expected, rtol=0, atol=1e-9)


@pytest.mark.parametrize(
    ("formula", "impulse"),
    [
        ("abs(time_s - 0.4)", 0.5 * (0.16 + 0.36)),
        ("max(0.3 - time_s, 0)", 0.045),
        ("min(time_s, 0.25)", 0.5 * 0.0625 + 0.75 * 0.25),
        ("sign(time_s - 0.7)", 0.3 - 0.7),
        ("clip(4 * time_s - 1, -0.5, 2)", 0.5 * 2.5**2 / 4.0 - 0.5 * 0.75 + 0.125 * -0.5),
        ("where(0.2 < time_s <= 0.5, 1, 0)", 0.3),
        ("where(time_s < 0.2 or not time_s < 0.5, 1, 0)", 0.7),
        ("where(time_s < 0.25, sqrt(0.25 - time_s), 0)", 2.0 / 3.0 * 0.125),
    ],
)
def test_kinks_in_time(pair, formula, impulse):
    """Kinks end steps: the impulse over the run is exact, but for the root's endless slope."""
    if "clip" in formula:  # -0.5 to 0.125 s, then up to 2 at 0.75 s
        impulse = -0.5 * 0.125 + 0.625 * 0.75 + 0.25 * 2.0
    settings = STILL | pushed(formula) | {"solver.step_s": 0.01 if "sqrt" in formula else 0.3}
    _, _, v = along(flown(pair(settings)))
    tolerance = 1e-4 if "sqrt" in formula else 1e-12
    assert v.iloc[-1] * FORE == pytest.approx(impulse, abs=tolerance)


def test_zero_that_stays(pair):
    """A switching function that stays at zero is no event, and its sign is 0."""
    settings = STILL | pushed("3 * sign(fore.omega_y_deg_s) + abs(fore.yaw_deg) + 3")
    t, _, v = along(flown(pair(settings)))
    assert_allclose(v, t, rtol=0, atol=1e-12)


def test_starts_at_a_kink(pair):
    """The sign of a switching function that is zero at the start is that of its acceleration."""
    for force, side in ((3.0, 1.0), (-3.0, -1.0)):
        formula = f"{force!r} * (1 + 0.5 * sign(fore.x_m - 0.5))"
        t, x, _ = along(flown(pair(STILL | pushed(formula))))
        acceleration = force * (1.0 + 0.5 * side) / FORE
        assert_allclose(x, 0.5 + 0.5 * acceleration * t**2, rtol=0, atol=1e-11)


@pytest.mark.parametrize(
    "formula",
    [
        "1 / abs(time_s - 0.5)",
        "1 / max(0.5 - time_s, 0)",
        "log(0.5 - time_s)",
        "sqrt(0.5 - time_s)",
        "exp(2000 * time_s)",
        "(0.5 - time_s) ** 0.5",
        "min(1, log(0.5 - time_s))",
        "where(log(0.5 - time_s) < 100, 1, 2)",
        "0 * log(0.5 - time_s)",
        "1 / exp(2000 * time_s)",
    ],
)
def test_undefined(pair, formula):
    history = pair(STILL | pushed(formula)).simulate(step_s=0.05)
    assert history.attrs["status"] == "undefined-formula"


@pytest.mark.parametrize(
    "formula", ["1 / (time_s - 0.5)", "(time_s - 0.5) ** -2", "tan(2 * time_s)"]
)
def test_pole_within_a_step(pair, formula):
    """A step that passes a pole is not resolved, however short."""
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        history = pair(STILL | pushed(formula)).simulate(step_s=0.05)
    assert history.attrs["status"] in ("unresolved", "undefined-formula", "not-finite")


@pytest.mark.parametrize(
    "formula", ["where(time_s < 0.5, log(0.6 - time_s), 1)", "sqrt(max(0.5 - time_s, 0))"]
)
def test_defined_in_its_branch(pair, formula):
    """A branch that is not taken may be undefined."""
    flown(pair(STILL | pushed(formula)))


def test_switch_that_undoes_itself(pair):
    """Dry friction as sign(v) holds the body at rest between two branches: no row is valid."""
    campaign = pair(STILL | pushed("2 - 6 * sign(fore.vx_m_s - 0.1)"))
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        assert campaign.simulate(step_s=0.1).attrs["status"] == "too-many-events"


CONTROLLED = [
    "clip(-400 * fore.pitch_rad - 30 * fore.omega_z_rad_s, -0.4, 0.4)",
    "where(joint.pins.rate_m_s < 0.3, 3, 0.5) - 0.01 * joint.pins.stroke_mm",
    "max(fore.alpha_deg, 0.5) * 0.2 + fore.airspeed_m_s / 20 + min(fore.beta_rad, 0.001)",
    "abs(fore.roll_deg - 1) * 0.1 + atan2(fore.y_m, 900) * tan(fore.yaw_rad) + fore.z_m ** 2",
    "sin(30 * time_s) ** 3 + 2 ** (-time_s) + cos(fore.vz_m_s) + log(1 + time_s)",
]


@pytest.mark.slow
@pytest.mark.parametrize("formula", CONTROLLED)
def test_against_the_independent_flight(pair, plainly, formula):
    settings = {
        "phase": [{"name": "free"}],
        "initial.omega_deg_s": [3.0, -2.0, 6.0],
        "initial.speed_m_s": 30.0,
        "initial.alpha_deg": 1.0,
        "solver": {"accuracy": 1e-8},
        "dispersion": {"body.fore.mass_kg": {"uniform": 0.5}},
        "signal": [signal(formula)],
        "load": [
            {
                "name": "jet",
                "body": "fore",
                "force_N": [4.0, "push", 0.1],
                "moment_N_m": [0.05, 0.1, "push"],
                "point_m": [0.9, 0.01, 0.02],
            }
        ],
    }
    campaign = pair(settings)
    rows = campaign.run(cases=2).to_pandas()
    for row in rows.to_dict("records"):
        expected = simulate(campaign.case(row["case"]).to_dict())
        assert row["status"] == expected.status == "ok"
        for name, value in expected.outcomes.items():
            if math.isfinite(value):
                assert row[name] == pytest.approx(value, rel=1e-7, abs=1e-7), name


def test_a_kernel_without_signals_is_unchanged(pair):
    """A signal that gives no number changes no line of a kernel but its history."""
    from sepmc.kernel.emit.module import emit

    def text(campaign):
        return emit(make_kernel_spec(campaign.layout), "dop853")

    plain, named = text(pair(STILL)), text(pair(STILL | {"signal": [signal("time_s")]}))
    assert named.replace("from sepmc.physics import signals\n", "") == plain


@pytest.mark.parametrize(
    ("settings", "message"),
    [
        (
            pushed("peek * 2", peak=1.0),
            "signal.push.formula = 'peek * 2': peek: no such constant or signal; did you mean "
            "'peak'?",
        ),
        (pushed("2", peak=1.0), "signal.push.peak: is neither a key of signals nor a constant"),
        (
            pushed("time * 2"),
            "time: the unit is missing or wrong; allowed: time_s, time_ms, time_min",
        ),
        (
            pushed("fore.pitch"),
            "fore.pitch: the unit is missing or wrong; allowed: fore.pitch_deg, fore.pitch_rad",
        ),
        (pushed("fore.pich_deg"), "no such quantity; did you mean 'pitch_deg'?"),
        (pushed("for.pitch_deg"), "for.pitch_deg: no such body; did you mean 'fore'?"),
        (
            pushed("clearance.gap_mm"),
            "clearance.gap_mm: a clearance is no quantity of signals",
        ),
        (pushed("joint.pin.stroke_m"), "write joint.NAME.QUANTITY with the name of a joint"),
        (pushed("joint.pins.stroke"), "allowed: joint.pins.stroke_m, joint.pins.stroke_mm"),
        (
            pushed("fore.dynamic_pressure_Pa"),
            "needs a body with aerodynamics, in an atmosphere",
        ),
        (pushed("1 +"), "signal.push.formula = '1 +': is no formula"),
        (pushed("2 * push"), "signal.push.formula: depends on itself at once: push -> push"),
        (
            pushed("1", load={"force_N": ["pull", 0, 0]}),
            "load.jet.force_N.x = 'pull': must be a number or the name of a [[signal]]; "
            "known here: push",
        ),
        (pushed("a", a=True), "signal.push.a = true: must be a number"),
        (pushed("a", a="b"), "signal.push.a = 'b': must be a number"),
        (pushed("a", a=math.inf), "must be finite"),
        (pushed("a", a=1e70), "must be finite and at most 1e+60 in size"),
        ({"signal": [signal("1", **{"min": 1.0})]}, "is a reserved word of formulas"),
        ({"signal": [signal("1", name="sin")]}, "is a reserved word of formulas"),
        ({"signal": [signal("1"), signal("2")]}, "signal.push: the name is used twice"),
        ({"signal": 3}, "signal = 3: must be an array of tables"),
        ({"signal": [3]}, "signal.0 = 3: must be a table"),
        ({"signal": [{"name": "push"}]}, "'formula' is missing"),
        (
            pushed("1") | {"dispersion": {"load.jet.force_N.x": {"uniform": 1.0}}},
            "is given by signal 'push' during flight",
        ),
        (
            pushed("k * time_s", k=1.0) | {"dispersion": {"signal.push.j": {"uniform": 1.0}}},
            "dispersion.signal.push.j: no 'j' here; known here: k",
        ),
    ],
)
def test_messages(pair, settings, message):
    with pytest.raises(SceneError) as error:
        pair(STILL | settings)
    assert message in str(error.value)


def test_setting(pair):
    """A setting changes a constant, a formula or a use of a signal."""
    settings = STILL | pushed("peak * time_s", peak=6.0)
    t, _, v = along(flown(pair(settings | {"signal.push.peak": 3.0})))
    assert_allclose(v, 0.5 * t**2, rtol=0, atol=1e-12)
    t, _, v = along(flown(pair(settings | {"signal.push.formula": "peak"})))
    assert_allclose(v, 2.0 * t, rtol=0, atol=1e-12)
    t, _, v = along(flown(pair(settings | {"load.jet.force_N": [3.0, 0, 0]})))
    assert_allclose(v, t, rtol=0, atol=1e-12)


EVENTFUL = {
    "initial.speed_m_s": 0.0,
    "initial.altitude_m": 0.0,
    "run.end_time_s": 1.0,
    "solver.step_s": 0.01,
    "phase": [
        {"name": "locked", "joints": {"pins": "fixed"}, "until": {"time_s": 0.3}},
        {"name": "free"},
    ],
    "event": [{"name": "far", "when": {"joint": "pins", "stroke_m": 0.05}}],
}


def test_time_since(pair):
    """Times since a release and since an event: forces that begin there, each a ramp."""
    formula = "where(event.far.time_since_s > 0, 12, 6) * joint.pins.time_since_release_s"
    settings = EVENTFUL | pushed(formula)
    history = flown(pair(settings))
    t, _, v = along(history)
    far = history.attrs["events"]["far"]
    assert far == pytest.approx(0.3 + (0.05 * 3.0) ** (1.0 / 3.0), abs=1e-9)  # 2 t'' = 6 t / 3
    s = np.clip(t - 0.3, 0.0, None)
    reached = far - 0.3
    expected = np.where(t <= far, s**2, 2.0 * s**2 - reached**2)
    assert_allclose(v, expected, rtol=0, atol=1e-8)
    assert_allclose(history["signal_push"].iloc[-1], 12.0 * 0.7, rtol=1e-12)


@pytest.mark.slow
def test_air_against_the_independent_flight(pair, plainly):
    """Mach number, dynamic pressure and times since events of a body in the atmosphere."""
    aerodynamics = {
        "reference_area_m2": 0.1,
        "reference_length_m": 0.5,
        "axial": {"const": 0.3},
        "normal": {"alpha": 1.0},
        "pitch": {"alpha": -0.2},
    }
    formula = (
        "3 * fore.mach + fore.dynamic_pressure_kPa / 5 + clip(fore.alpha_deg, -1, 1)"
        " - joint.pins.time_since_release_s + where(fore.mach < 0.85, 1, 0)"
        " + 2 * event.far.time_since_s"
    )
    settings = EVENTFUL | pushed(formula)
    settings |= {
        "environment.atmosphere": "us1976",
        "body.fore.aerodynamics": aerodynamics,
        "initial.altitude_m": 9000.0,
        "initial.speed_m_s": 260.0,
        "initial.alpha_deg": 2.0,
        "solver": {"accuracy": 1e-8},
        "dispersion": {"body.fore.mass_kg": {"uniform": 0.5}},
    }
    del settings["solver.step_s"]
    campaign = pair(settings)
    for row in campaign.run(cases=2).to_pandas().to_dict("records"):
        expected = simulate(campaign.case(row["case"]).to_dict())
        assert row["status"] == expected.status == "ok"
        for name, value in expected.outcomes.items():
            if math.isfinite(value):
                assert row[name] == pytest.approx(value, rel=1e-7, abs=1e-7), name


def test_idle_signals_are_noted(pair):
    signals = [signal("2 * base"), signal("1", name="base"), signal("push", name="spare")]
    settings = STILL | pushed("1") | {"signal": signals}
    notes = [note for note in idle_loads(pair(settings).scene, set()) if note.startswith("signal.")]
    reason = "no load, motor, spring, coefficient or other signal names it"
    assert notes == [f"signal.spare does nothing: {reason}"]


def test_quantities_that_are_known(pair):
    """A body that is fixed to the ground has no rates: a formula of them is a number."""
    formula = (
        "6 + abs(fore.omega_x_deg_s) + where(fore.omega_y_deg_s < 1, 0, 5)"
        " + min(fore.omega_z_deg_s, 2) + sqrt(fore.omega_x_deg_s) + sign(fore.omega_x_deg_s)"
    )
    settings = {
        "initial.speed_m_s": 0.0,
        "initial.altitude_m": 0.0,
        "run.end_time_s": 1.0,
        "solver.step_s": 0.01,
        "joint.post": {"bodies": ["ground", "fore"], "point_m": [1.0, 0.0, 0.0]},
        "joint.pins.bodies": ["fore", "aft"],
        "phase": [{"name": "held", "joints": {"post": "fixed"}}],
    }
    jet = {"load": [{"name": "jet", "body": "aft", "force_N": ["push", 0.0, 0.0]}]}
    history = flown(pair(settings | pushed(formula) | jet))
    assert history["aft_vx_m_s"].iloc[-1] == pytest.approx(6.0, abs=1e-12)
    assert_allclose(history["signal_push"], 6.0, rtol=0, atol=1e-15)
