"""Pin loads, jamming and friction of guides: hand formulas."""

import math

import numpy as np
import pytest
from numpy.testing import assert_allclose, assert_array_equal
from scipy.integrate import simpson, solve_ivp
from support.output_scenes import FREE, GUIDED, RETRO, SLIDER, flown, phases

CLOCK = math.radians(20.0)


def cart(**settings):
    """The aft body, 1 kg, on a rail that the ground holds: the fore body is fixed to it, the pins
    are between. It moves along x."""
    scene = {
        "joint.hold": {"bodies": ["ground", "fore"], "point_m": [1.0, 0.0, 0.0]},
        "joint.pins.guide": {"pins": 4, "circle_m": 0.5, "engaged_m": 0.25, "clock_deg": 20.0},
        "phase": [{"name": "only", "joints": {"hold": "fixed", "pins": "slider"}}],
        "initial.speed_m_s": 0.0,
        "output.guide": ["pins"],
        "run.end_time_s": 0.1,
    }
    return scene | {key.replace("__", "."): value for key, value in settings.items()}


def pins_by_hand(force, moment, engaged, pins=4, circle=0.5, clock=CLOCK):
    """Greatest load of each pin, and the sum over mouths and tips, for a wrench on the aft body at
    the mouth, which lies aft of it.

    Two bearings, at 0 and at -engaged along x, balance force and moment: N0 + N1 = F, (-engaged, 0,
    0) x N1 = M.
    """
    n1 = np.array([moment[2] / -engaged, moment[1] / engaged])  # y, z
    n0 = np.array(force)[1:] - n1
    loads, total = [], 0.0
    for i in range(pins):
        angle = clock + 2.0 * math.pi * i / pins
        around = 0.5 * moment[0] / (pins * circle) * np.array([-math.sin(angle), math.cos(angle)])
        mouth, tip = np.linalg.norm(n0 / pins + around), np.linalg.norm(n1 / pins + around)
        loads.append(max(mouth, tip))
        total += mouth + tip
    return loads, total


LATERAL = {
    "name": "side",
    "body": "aft",
    "force_N": [-2.0, 3.0, -5.0],
    "moment_N_m": [0.7, 0.4, -1.1],
    "point_m": [2.4, 0.1, 0.2],
}


def lateral_wrench(load=LATERAL):
    """Wrench of the pins on the aft body at the joint point (2, 0, 0): against the load, which the
    slider holds but for x."""
    arm = np.array([2.0, 0.0, 0.0]) - np.array(load["point_m"])  # aft is -x
    arm = np.array([arm[0], load["point_m"][1], load["point_m"][2]])
    force = np.array(load["force_N"])
    about_mouth = np.array(load["moment_N_m"]) + np.cross(arm, force)
    # of 1 kg, one metre aft of the mouth, on the axis: no moment
    acceleration = np.array([force[0] / 1.0, 0.0, 0.0])
    assert not np.cross([-1.0, 0.0, 0.0], acceleration).any()
    return np.array([0.0, -force[1], -force[2]]), -about_mouth


def test_pin_loads(pair):
    """Forces, a couple, torsion: each of four pins as the hand formula says at the start and later,
    when less of it is engaged.

    s = t^2: at 0.1 s 10 mm of 250 mm are out; loads grow as the lever shrinks, so the peaks are
    those of the end.
    """
    _, outcomes = flown(pair(cart(load=[LATERAL])))
    force, moment = lateral_wrench()
    loads, total = pins_by_hand(force, moment, 0.25 - 0.01)
    assert_allclose([outcomes[f"pins_pin{i}_peak_load_N"] for i in range(1, 5)], loads, rtol=1e-11)
    assert_allclose(outcomes["pins_time_in_guide_s"], 0.1, rtol=1e-12)
    assert_allclose(outcomes["pins_jam_friction"], 2.0 / total, rtol=1e-11)


def test_pin_loads_over_time(pair):
    """The same at all times of a history, at hole entry and tip: the larger one is the load of the
    pin; none while the pins do not slide."""
    history, _ = flown(pair(cart(load=[LATERAL])), 0.01)
    force, moment = lateral_wrench()
    for time, row in zip(history["time_s"], history.to_dict("records"), strict=True):
        loads, _ = pins_by_hand(force, moment, 0.25 - time**2)
        for pin, load in enumerate(loads, 1):
            ends = [row[f"pins_pin{pin}_{end}_load_N"] for end in ("mouth", "tip")]
            assert_allclose(max(ends), load, rtol=1e-11)
    guide = {"joint.pins.guide": {"pins": 2, "circle_m": 0.1, "engaged_m": 0.1}}
    history, _ = flown(pair(guide | {"phase": GUIDED, "motor": [RETRO], "run.end_time_s": 0.6}))
    slid = history["pins_pin2_tip_load_N"].notna()
    assert_array_equal(slid, history["phase"] == "p1")
    assert slid.any()


def test_jam_of_a_couple(pair):
    """DOMAIN: a couple M on parallel pins is carried as M / L at both ends; friction 2 mu M / L
    holds against F: mu = F L / (2 M)."""
    load = {
        "name": "pull",
        "body": "aft",
        "force_N": [-2.0, 0.0, 0.0],
        "moment_N_m": [0.0, 0.0, 3.0],
    }
    guide = {"pins": 1, "engaged_m": 0.25}
    _, outcomes = flown(
        pair(
            cart(load=[load], joint__pins__guide=guide, run__end_time_s=1e-4, solver__step_s=1e-4)
        ),
        1e-4,
    )
    assert_allclose(outcomes["pins_jam_friction"], 2.0 * 0.25 / (2.0 * 3.0), rtol=1e-6)
    assert_allclose(outcomes["pins_pin1_peak_load_N"], 3.0 / 0.25, rtol=1e-6)


def test_pins_out_of_their_holes(pair):
    """Past 99 % of the engaged length a pin counts as 1 % of it: loads stay finite, the guide ends
    with the phase."""
    guide = {"pins": 2, "circle_m": 0.5, "engaged_m": 0.01}
    load = LATERAL | {
        "point_m": [3.0, 0.0, 0.0],
        "moment_N_m": [0.0, 0.0, 0.0],
        "force_N": [-2.0, 3.0, 0.0],
    }
    _, outcomes = flown(pair(cart(load=[load], joint__pins__guide=guide, run__end_time_s=0.3)))
    loads, _ = pins_by_hand([0.0, -3.0, 0.0], [0.0, 0.0, 3.0], 1e-4, 2, 0.5, 0.0)
    assert_allclose([outcomes[f"pins_pin{i}_peak_load_N"] for i in (1, 2)], loads, rtol=1e-9)


def test_time_in_the_guide(pair):
    """Locked for 0.2 s, then 80 mm of s = (t - 0.2)^2, then free: only sliding counts, and pins
    carry loads only then."""
    settings = {
        "phase": GUIDED,
        "motor": [RETRO],
        "output.guide": ["pins"],
        "joint.pins.guide": {"pins": 1, "engaged_m": 0.1},
    }
    _, outcomes = flown(pair(settings | {"run.end_time_s": 0.6}))
    assert_allclose(outcomes["pins_time_in_guide_s"], math.sqrt(0.08), rtol=1e-12)
    assert outcomes["pins_pin1_peak_load_N"] <= 1e-12


def rubbing(friction, engaged=2.0, **keys):
    """A single long pin; by default it ends at station 4, and its middle stands at the aft body's
    mass centre."""
    return {"pins": 1, "engaged_m": engaged, "friction": friction, "slip_speed_m_s": 1e-6} | keys


def slope(angle_deg, g=9.80665):
    """Gravity on a rail that rises forward by an angle: the aft body slides off it aft."""
    return (
        {"environment.gravity": "constant", "initial.pitch_deg": angle_deg},
        g * math.sin(math.radians(angle_deg)),
        g * math.cos(math.radians(angle_deg)),
    )


@pytest.mark.slow
@pytest.mark.parametrize(("formulation", "end"), [("reduced", 0.2), ("full", 0.05)])
def test_coulomb_on_a_slope(pair, formulation, end):
    """The mass centre stands over the pin's middle, so its ends carry m g cos a in all: a = g sin a
    - mu g cos a v / sqrt(v^2 + v0^2).

    As it slides, the lever of 2 m shrinks and the ends share the load less evenly, but their sum
    stays.
    """
    settings, drive, normal = slope(30.0)
    scene = cart(
        joint__pins__guide=rubbing(0.2, slip_speed_m_s=1e-3),
        solver__formulation=formulation,
        solver__step_s=1e-3,
        run__end_time_s=end,
    )
    history, outcomes = flown(pair(scene | settings))
    v = history["pins_separation_speed_m_s"]
    assert_allclose(
        -history["aft_axial_acceleration_m_s2"],
        drive - 0.2 * normal * v / np.hypot(v, 1e-3),
        rtol=1e-10,
    )
    assert_allclose(v.iloc[-1], (drive - 0.2 * normal) * end, rtol=0, atol=1e-3)
    assert outcomes["energy_residual"] <= 1e-7


def test_friction_near_rest(pair):
    """Coulomb's law is smooth through rest: mu N v / sqrt(v^2 + v0^2), here with v0 of the size of
    v, integrated by scipy."""
    settings, drive, normal = slope(30.0)
    guide = rubbing(0.2, slip_speed_m_s=0.3)
    history, _ = flown(
        pair(
            cart(joint__pins__guide=guide, run__end_time_s=0.4) | settings | {"solver.step_s": 0.01}
        )
    )
    end = solve_ivp(
        lambda _, v: [drive - 0.2 * normal * v[0] / math.hypot(v[0], 0.3)],
        (0.0, 0.4),
        [0.0],
        "DOP853",
        rtol=1e-12,
        atol=1e-14,
    ).y[0, -1]
    assert_allclose(history["pins_separation_speed_m_s"].iloc[-1], end, rtol=1e-10)


@pytest.mark.slow
def test_friction_stops_a_slider(pair):
    """Pushed by 4 N for 0.02 s, then only 10 N across it and 0.1 of friction: 1 N against 1 kg
    stops 0.06 m/s... until it creeps at rest."""
    load = [
        {"name": "push", "body": "aft", "force_N": [-4.0, 0.0, 0.0], "end_s": 0.02},
        {"name": "side", "body": "aft", "force_N": [0.0, 0.0, 10.0]},
    ]
    guide = rubbing(0.1, slip_speed_m_s=1e-4)
    history, outcomes = flown(
        pair(
            cart(load=load, joint__pins__guide=guide, run__end_time_s=0.1, solver__step_s=2e-4)
            | {"output.loads": []}
        ),
        0.001,
    )
    time, speed = history["time_s"].to_numpy(), history["pins_separation_speed_m_s"].to_numpy()
    expected = np.where(time < 0.02, 3.0 * time, 0.06 - (time - 0.02))
    moving = (expected > 0.02) & (time > 0.005)
    assert moving.sum() > 40
    assert_allclose(speed[moving], expected[moving], rtol=0, atol=5e-5)
    assert_allclose(speed[time > 0.09], 0.0, rtol=0, atol=1e-6)
    assert_allclose(outcomes["energy_residual"], 0.0, rtol=0, atol=1e-6)


def test_jam_friction_of_what_nothing_drives(pair):
    """Pushed by 4 N for 0.02 s, then coasting under a load across: nothing drives it any more, so
    any friction would hold it: 0."""
    load = [
        {"name": "push", "body": "aft", "force_N": [-4.0, 0.0, 0.0], "end_s": 0.02},
        {"name": "side", "body": "aft", "force_N": [0.0, 0.0, 10.0]},
    ]
    for friction in (0.0, 0.1):
        guide = rubbing(friction, slip_speed_m_s=1e-3)
        _, outcomes = flown(
            pair(
                cart(load=load, joint__pins__guide=guide, run__end_time_s=0.06, solver__step_s=1e-3)
            )
        )
        assert_allclose(outcomes["pins_jam_friction"], 0.0, rtol=0, atol=1e-12)


@pytest.mark.slow
@pytest.mark.parametrize("friction", [0.0, 0.05, 0.15])
def test_jam_friction_is_that_of_the_drive(pair, friction):
    """4 N along, 10 N across: 0.4 jams, however much friction there is already."""
    load = {"name": "push", "body": "aft", "force_N": [-4.0, 0.0, 10.0]}
    guide = rubbing(friction, slip_speed_m_s=1e-3)
    _, outcomes = flown(
        pair(cart(load=[load], joint__pins__guide=guide, run__end_time_s=0.1, solver__step_s=1e-3))
    )
    assert_allclose(outcomes["pins_jam_friction"], 0.4, rtol=1e-9)


@pytest.mark.slow
@pytest.mark.parametrize("friction", [0.02, 0.3, 0.7])
def test_jam_friction_counts_the_loads_that_friction_causes(pair, friction):
    """Pulled apart through the mass centres, the pin 0.3 m beside them: friction f bends it, at
    both ends by 0.3 f / L, and hardly anything else does. It balances 2 mu 0.3 f / L = f at mu = L
    / 0.6, least where 0.45 m of it are left; the status says so too."""
    two = {"mass_kg": 100.0, "inertia_kg_m2": [10.0, 50.0, 50.0]}
    settings = {
        "body": {"fore": two | {"cg_m": [1.0, 0.0, 0.0]}, "aft": two | {"cg_m": [3.0, 0.0, 0.0]}},
        "load": [
            {
                "name": "pull",
                "body": "aft",
                "force_N": [-1000.0, 0.0, 0.0],
                "moment_N_m": [0.0, 0.05, 0.0],
            }
        ],
        "joint.pins.point_m": [2.0, 0.3, 0.0],
        "joint.pins.guide": rubbing(friction, 0.5),
        "phase": phases((SLIDER, {"joint": "pins", "stroke_mm": 50.0}), (FREE, None)),
        "output.guide": ["pins"],
        "solver.step_s": 1e-3,
    }
    _, outcomes = flown(pair(settings))
    assert_allclose(outcomes["pins_jam_friction"], 0.75, rtol=1e-6)
    flown(pair(settings | {"joint.pins.guide": rubbing(0.76, 0.5)}), status="jammed")


@pytest.mark.slow
@pytest.mark.parametrize("gain", [0.2, 0.5, 0.9, 1.5, 3.0])
def test_friction_that_lowers_its_own_load(pair, gain):
    """Pushed through the pin, the mass centre half a metre beside it: the couple is arm (F - f), so
    f = k (F - f), k = 2 mu arm / L.

    The balance F - f = F / (1 + k) exists whatever k; L and mu are those of the row: the pin slides
    out, friction is smooth through rest.
    """
    arm, push = 0.5, 4.0
    load = {"name": "push", "body": "aft", "force_N": [-push, 0.0, 0.0], "point_m": [3.0, 0.0, 0.0]}
    scene = cart(
        load=[load],
        joint__pins__guide=rubbing(0.5 * gain / arm, 1.0, slip_speed_m_s=1e-2),
        body__aft__cg_m=[3.0, arm, 0.0],
    )
    history, _ = flown(pair(scene | {"solver.step_s": 1e-3}))
    v, out = history["pins_separation_speed_m_s"], history["pins_separation_distance_mm"] / 1e3
    k = gain / (1.0 - out) * v / np.hypot(v, 1e-2)
    assert_allclose(-history["aft_axial_acceleration_m_s2"], push / (1.0 + k), rtol=1e-9)


def through_the_centre(friction, arm, engaged=1.0):
    """Pushed through its mass centre, ``arm`` beside the pin, and a little across: friction makes
    the couple it rubs with."""
    load = {"name": "push", "body": "aft", "force_N": [-4.0, 0.0, 0.1], "point_m": [3.0, arm, 0.0]}
    guide = rubbing(friction, engaged, slip_speed_m_s=1e-6)
    return cart(
        load=[load],
        joint__pins__guide=guide,
        body__aft__cg_m=[3.0, arm, 0.0],
        run__end_time_s=0.02,
        solver__step_s=1e-3,
    )


@pytest.mark.parametrize(
    ("gain", "status"),
    [(0.3, "ok"), (0.8, "ok"), (0.95, "ok"), (1.2, "jammed"), (4.0, "jammed")],
)
def test_jams_when_friction_feeds_itself(pair, gain, status):
    """The couple is arm f, so friction grows by k = 2 mu arm / L of itself: below 1 there is a
    balance, from 1 on there is none."""
    settings = through_the_centre(gain, 0.5)
    result = pair(settings).simulate(step_s=0.01).attrs
    assert result["status"] == status
    assert math.isnan(result["outcomes"]["aft_omega_x_deg_s"]) == (status == "jammed")


@pytest.mark.slow
def test_work_of_friction(pair):
    """On 30 deg of slope over 0.2 s: kinetic energy is what gravity gives less what friction takes,
    to the audit's own sum."""
    settings, drive, normal = slope(30.0)
    history, outcomes = flown(
        pair(
            cart(joint__pins__guide=rubbing(0.2, slip_speed_m_s=0.01), run__end_time_s=0.2)
            | settings
            | {"solver.step_s": 5e-4}
        )
    )
    v, s = (
        history["pins_separation_speed_m_s"].to_numpy(),
        history["pins_separation_distance_mm"].to_numpy() / 1e3,
    )
    taken = 0.2 * normal * simpson(v * v / np.hypot(v, 0.01), x=history["time_s"])
    assert_allclose(0.5 * v[-1] ** 2, drive * s[-1] - taken, rtol=1e-4)
    assert outcomes["energy_residual"] <= 1e-9


@pytest.mark.slow
def test_dispersed_friction(pair, plainly):
    """Each case its own coefficient, integrated by scipy."""
    settings, drive, normal = slope(30.0)
    scene = (
        cart(joint__pins__guide=rubbing(0.2, slip_speed_m_s=1e-2), solver__step_s=2e-3) | settings
    )
    table = (
        pair(scene | {"dispersion.joint.pins.guide.friction": {"uniform": [0.1, 0.3]}})
        .run(cases=5)
        .to_pandas()
    )
    for friction, speed in zip(
        table["in_joint_pins_guide_friction"], table["pins_separation_speed_m_s"], strict=True
    ):
        rate = lambda _, v, mu=friction: [drive - mu * normal * v[0] / math.hypot(v[0], 1e-2)]  # noqa: E731
        end = solve_ivp(rate, (0.0, 0.1), [0.0], "DOP853", rtol=1e-12, atol=1e-14).y[0, -1]
        assert_allclose(speed, end, rtol=1e-8)
