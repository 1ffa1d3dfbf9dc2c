"""Springs, motors and constant loads against closed forms, and against equations of motion
integrated by scipy."""

import math

import numpy as np
import pytest
from numpy.testing import assert_allclose
from scipy.integrate import quad, solve_ivp
from scipy.spatial.transform import Rotation
from small_scenes import PUSH, REDUCED

from sepmc.campaign.execution.diagnostics import scene_notes
from sepmc.campaign.execution.integration import Integration

FREE = {"phase": [{"name": "free"}], "solver.step_s": 0.01}
STILL = FREE | {"initial.speed_m_s": 0.0, "initial.altitude_m": 0.0}
MASS = {"fore": 3.0, "aft": 1.0}
INERTIA = {
    "fore": np.diag([3.0, 4.0, 5.0]),
    "aft": np.array([[1.0, -0.2, 0.1], [-0.2, 2.0, -0.15], [0.1, -0.15, 2.0]]),
}
PRODUCTS = {"body.aft.inertia_products_kg_m2": [0.2, -0.1, 0.15]}
CG = {"fore": np.array([-1.0, 0.0, 0.0]), "aft": np.array([-3.0, 0.0, 0.0])}  # body axes
CENTRE = np.array([-1.5, 0.0, 0.0])
# on the axis, forward: 2 m/s2
MOTOR = {"name": "push", "body": "fore", "thrust_N": 6.0, "station_m": 1.0, "cant_deg": 0.0}


def state(history, body):
    """Position, velocity, attitude (rotation) and body rates of every row."""
    x, v = (
        history[[f"{body}_{p}{a}_{u}" for a in "xyz"]].to_numpy()
        for p, u in (("", "m"), ("v", "m_s"))
    )
    turned = Rotation.from_euler(
        "ZYX",
        history[[f"{body}_{a}_deg" for a in ("pitch", "yaw", "roll")]].to_numpy(),
        degrees=True,
    )
    return x, v, turned, np.radians(history[[f"{body}_omega_{a}_deg_s" for a in "xyz"]].to_numpy())


def momenta(history, bodies=("fore", "aft")):
    """Momentum, angular momentum about the ground's origin, and kinetic energy of all bodies, each
    (rows, ...)."""
    momentum, spin, energy = 0.0, 0.0, 0.0
    for body in bodies:
        x, v, turned, omega = state(history, body)
        momentum = momentum + MASS[body] * v
        spin = spin + MASS[body] * np.cross(x, v) + turned.apply(omega @ INERTIA[body])
        energy = (
            energy
            + 0.5 * MASS[body] * np.sum(v * v, axis=1)
            + 0.5 * np.sum(omega * (omega @ INERTIA[body]), axis=1)
        )
    return momentum, spin, energy


def flown(campaign, step_s=0.01):
    history = campaign.simulate(step_s=step_s)
    assert history.attrs["status"] == "ok"
    return history


def along(history):
    """Extension and its rate between two bodies that move along x, from the start."""
    gap, rate = (
        history["fore_x_m"] - history["aft_x_m"],
        history["fore_vx_m_s"] - history["aft_vx_m_s"],
    )
    return gap.to_numpy() - 2.0, rate.to_numpy()


# from the first point aft to the second: pushes apart
LINE = {"axis": None, "second_point_m": [2.3, 0.0, 0.0]}
KINDS = [
    {},
    LINE,
    {"bodies": ["aft", "fore"], "axis": [1.0, 0.0, 0.0]},
    LINE
    | {"bodies": ["aft", "fore"], "point_m": [2.3, 0.0, 0.0], "second_point_m": [2.0, 0.0, 0.0]},
]


def spring(**keys):
    """The spring with other keys; None takes one out."""
    return {key: value for key, value in (PUSH | keys).items() if value is not None}


@pytest.mark.slow
def test_weak_and_failed(pair):
    """A factor scales the whole force, as a spring with its three coefficients scaled; a failed
    spring ends its stroke where the other one pushes the bodies."""
    numbers = {"force_N": 12.0, "stiffness_N_per_m": 40.0, "damping_N_s_per_m": 3.0}

    def shown(*springs):
        ended = {"name": "ended", "when": {"spring": springs[-1]["name"]}}
        settings = {"spring": list(springs), "event": [ended], "run.end_time_s": 1.0}
        result = flown(pair(STILL | settings))
        return [along(result)[i][-1] for i in (0, 1)], result.attrs["outcomes"]["ended_time_s"]

    less = spring(stroke_m=0.2, **{key: 0.7 * x for key, x in numbers.items()})
    weak = spring(stroke_m=0.2, factor=0.7, **numbers)
    assert_allclose(shown(weak)[0], shown(less)[0], rtol=0, atol=1e-11)
    failed = spring(stroke_m=0.1, factor=0.0, **numbers) | {"name": "other"}
    last, time = shown(less, failed)
    assert_allclose(last, shown(less)[0], rtol=0, atol=1e-11)
    x = spring(stroke_m=0.1, **{key: 0.0 for key in numbers}) | {"name": "other"}
    assert time == pytest.approx(shown(less, x)[1], abs=1e-12)
    assert 0.0 < time < shown(less)[1]


@pytest.mark.parametrize(
    "kind", KINDS, ids=["axis", "line", "axis, bodies exchanged", "line, bodies exchanged"]
)
def test_stroke_end(pair, kind):
    """m x'' = 12 - 40 x over 0.2 m: x = 0.3 (1 - cos wt), so spent at acos(1/3) / w; speed by
    energy: m v^2 / 2 = 12 s - 40 s^2 / 2."""
    history = flown(
        pair(
            STILL
            | {
                "spring": [spring(stiffness_N_per_m=40.0, stroke_m=0.2, **kind)],
                "run.end_time_s": 1.0,
            }
        )
    )
    w, v = math.sqrt(40.0 / REDUCED), math.sqrt(2.0 * (12.0 * 0.2 - 0.5 * 40.0 * 0.04) / REDUCED)
    end = math.acos(1.0 / 3.0) / w
    time, (x, rate) = history["time_s"].to_numpy(), along(history)
    twice = np.flatnonzero(np.diff(time) == 0.0)
    assert_allclose(time[twice], end, rtol=0, atol=1e-12)
    pushing = time <= end
    assert_allclose(
        x,
        np.where(pushing, 0.3 * (1.0 - np.cos(w * time)), 0.2 + v * (time - end)),
        rtol=0,
        atol=1e-12,
    )
    assert_allclose(rate, np.where(pushing, 0.3 * w * np.sin(w * time), v), rtol=0, atol=1e-12)
    momentum, _, energy = momenta(history)
    assert np.abs(momentum).max() <= 1e-13
    assert_allclose(energy[-1], 1.6, rtol=1e-12)
    assert history.attrs["outcomes"]["event_residual_s"] <= 1e-12


@pytest.mark.parametrize("damping", [2.0, 20.0])
def test_damped(pair, damping):
    """m x'' + c x' + k x = F, under- and overdamped; damping takes energy, which the work of all
    loads accounts for."""
    history = flown(
        pair(
            STILL
            | {
                "spring": [spring(stiffness_N_per_m=40.0, damping_N_s_per_m=damping)],
                "run.end_time_s": 1.0,
            }
        )
    )
    roots = np.roots([REDUCED, damping, 40.0]).astype(complex)
    t = history["time_s"].to_numpy()
    e0, e1 = (np.exp(root * t) for root in roots)
    shape = (roots[1] * e0 - roots[0] * e1) / (roots[0] - roots[1])
    slope = roots[0] * roots[1] * (e0 - e1) / (roots[0] - roots[1])
    x, rate = along(history)
    assert_allclose(x, 0.3 * (1.0 + shape.real), rtol=0, atol=1e-12)
    assert_allclose(rate, 0.3 * slope.real, rtol=0, atol=1e-12)
    assert history.attrs["outcomes"]["energy_residual"] <= 1e-10


def test_spent_for_good(pair):
    """Pushed over 0.1 m; then a load drives the aft body back through that range: the spring does
    not push again."""
    load = {"name": "back", "body": "aft", "force_N": [8.0, 0.0, 0.0], "start_s": 0.5, "end_s": 1.0}
    history = flown(
        pair(STILL | {"spring": [spring(stroke_m=0.1)], "load": [load], "run.end_time_s": 2.0})
    )
    v = math.sqrt(2.0 * 12.0 * 0.1 / REDUCED)
    x, rate = along(history)
    time = history["time_s"].to_numpy()
    assert x.min() < 0.0
    late = time >= 0.5
    assert_allclose(rate[late], v - 8.0 * np.clip(time[late] - 0.5, 0.0, 0.5), rtol=0, atol=1e-12)


def test_a_stroke_that_is_not_reached(pair):
    """Overdrawn at 0.6 m, the spring swings back: F - k x holds to the end."""
    history = flown(
        pair(
            STILL
            | {"spring": [spring(stiffness_N_per_m=40.0, stroke_m=0.601)], "run.end_time_s": 2.0}
        )
    )
    assert_allclose(
        along(history)[0],
        0.3 * (1.0 - np.cos(math.sqrt(40.0 / REDUCED) * history["time_s"])),
        rtol=0,
        atol=1e-12,
    )
    assert not np.any(np.diff(history["time_s"]) == 0.0)


def test_two_springs_end_one_after_the_other(pair):
    """12 N over 10 mm and 6 N over 20 mm, in one step: m v^2 / 2 = 0.12 + 0.12 J."""
    springs = [
        PUSH | {"stroke_mm": 10.0},
        PUSH | {"name": "long", "force_N": 6.0, "stroke_mm": 20.0},
    ]
    history = flown(pair(STILL | {"spring": springs, "solver.step_s": 0.5}))
    _, rate = along(history)
    assert_allclose(rate[-1], math.sqrt(2.0 * 0.24 / REDUCED), rtol=1e-12)
    first = math.sqrt(2.0 * 0.01 * REDUCED / 18.0)
    speed = 18.0 * first / REDUCED
    second = first + (-speed + math.sqrt(speed**2 + 2.0 * 0.01 * 6.0 / REDUCED)) * REDUCED / 6.0
    twice = np.flatnonzero(np.diff(history["time_s"]) == 0.0)
    assert_allclose(history["time_s"].iloc[twice], [first, second], rtol=0, atol=1e-12)


@pytest.mark.parametrize("bodies", [["ground", "fore"], ["fore", "ground"]])
@pytest.mark.parametrize("axis", [None, [1.0, 0.0, 0.0]])
def test_to_the_ground(pair, bodies, axis):
    """The fore body, sent off at 1 m/s, swings on a spring of 30 N/m that is anchored ahead of it:
    x = sin(wt) / w."""
    ends = {"point_m": [0.0, 0.0, 0.0], "second_point_m": [1.0, 0.0, 0.0]}
    if bodies[0] == "fore":
        ends = {"point_m": [1.0, 0.0, 0.0], "second_point_m": [0.0, 0.0, 0.0]}
    swing = {"name": "swing", "bodies": bodies, "stiffness_N_per_m": 30.0, **ends} | (
        {"axis": axis} if axis else {}
    )
    history = flown(pair(FREE | {"spring": [swing], "run.end_time_s": 0.9}))
    w = math.sqrt(30.0 / 3.0)
    assert_allclose(
        history["fore_x_m"] - 0.5, np.sin(w * history["time_s"]) / w, rtol=0, atol=1e-12
    )
    assert_allclose(history["aft_x_m"], -1.5 + history["time_s"], rtol=0, atol=1e-12)
    assert history.attrs["outcomes"]["energy_residual"] <= 1e-11


def equations(points, axis, law, moving=("fore", "aft")):
    """Newton and Euler for one spring from fore to a second body: rates of place, velocity,
    attitude, rates of each that moves."""

    def rates(_, y):
        parts = {body: y[18 * i : 18 * i + 18] for i, body in enumerate(moving)}
        place, speed, arms, turned, omega = {}, {}, {}, {}, {}
        for body, point in points.items():
            part = parts.get(
                body, np.concatenate([CENTRE, np.zeros(3), np.eye(3).ravel(), np.zeros(3)])
            )
            turned[body] = part[6:15].reshape(3, 3)
            omega[body] = turned[body] @ part[15:]
            arms[body] = turned[body] @ (point - (CG.get(body, CENTRE)))
            place[body] = part[:3] + arms[body]
            speed[body] = part[3:6] + np.cross(omega[body], arms[body])
        first, second = points
        d, d_rate = place[second] - place[first], speed[second] - speed[first]
        if axis is None:
            length = np.linalg.norm(d)
            e, rate = d / length, d_rate @ d / length
        else:
            e = turned[first] @ axis
            length, rate = d @ e, d_rate @ e + d @ np.cross(omega[first], e)
        force = law(length, rate) * e
        out = []
        for body in moving:
            sign = 1.0 if body == second else -1.0
            # of the line of action: through the second point
            lever = place[second] - parts[body][:3]
            r, w = turned[body], parts[body][15:]
            moment = r.T @ np.cross(lever, sign * force)
            out += [
                parts[body][3:6],
                sign * force / MASS[body],
                (r @ np.cross(np.eye(3), w)).ravel(),
            ]
            out.append(np.linalg.solve(INERTIA[body], moment - np.cross(w, INERTIA[body] @ w)))
        return np.concatenate(out)

    return rates


@pytest.mark.parametrize("axis", [None, np.array([-0.6, 0.8, 0.0])], ids=["line", "axis"])
@pytest.mark.parametrize("ground", [False, True])
def test_off_axis_by_scipy(pair, axis, ground):
    """Tumbling, pushed off the axis, damped; both bodies are turned. State to 1e-10 after 1 s,
    momenta kept to 1e-12 of themselves."""
    points = {
        "fore": np.array([-1.7, 0.3, -0.2]),
        "ground" if ground else "aft": np.array([-2.4, 0.5, 0.1]),
    }
    first, second = points
    layout = [(point * (-1.0, 1.0, 1.0)).tolist() for point in points.values()]
    push = {
        "name": "push",
        "bodies": [first, second],
        "point_m": layout[0],
        "second_point_m": layout[1],
        "force_N": 12.0,
    }
    push |= {"stiffness_N_per_m": 9.0, "damping_N_s_per_m": 1.5} | (
        {} if axis is None else {"axis": axis.tolist()}
    )
    omega = np.array([0.8, 1.0, -1.5])
    history = flown(
        pair(
            STILL
            | PRODUCTS
            | {"spring": [push], "initial.omega_rad_s": omega.tolist(), "run.end_time_s": 1.0}
        )
    )
    gap = points[second] - points[first]
    start = np.linalg.norm(gap) if axis is None else gap @ axis
    moving = ("fore",) if ground else ("fore", "aft")
    y0 = np.concatenate(
        [
            [*(CG[b] - CENTRE), *np.cross(omega, CG[b] - CENTRE), *np.eye(3).ravel(), *omega]
            for b in moving
        ]
    )
    if ground:
        y0[:3] += CENTRE  # the ground's own axes start at the layout's origin here
    else:
        y0[[0, 18]] += CENTRE[0]
    law = lambda length, rate: 12.0 - 9.0 * (length - start) - 1.5 * rate  # noqa: E731
    end = solve_ivp(
        equations(points, axis, law, moving), (0.0, 1.0), y0, "DOP853", rtol=1e-13, atol=1e-14
    ).y[:, -1]
    for i, body in enumerate(moving):
        x, v, turned, w = (part[-1] for part in state(history, body))
        expected = end[18 * i : 18 * i + 18]
        assert_allclose(x, expected[:3] - CENTRE, rtol=0, atol=1e-10)
        assert_allclose(v, expected[3:6], rtol=0, atol=1e-10)
        assert_allclose(turned.as_matrix(), expected[6:15].reshape(3, 3), rtol=0, atol=1e-10)
        assert_allclose(w, expected[15:], rtol=0, atol=1e-10)
    if not ground:
        for name, value in zip(("momentum", "angular momentum"), momenta(history)[:2], strict=True):
            assert np.abs(value - value[0]).max() <= 1e-12 * max(1.0, np.linalg.norm(value[0])), (
                name
            )
    assert history.attrs["outcomes"]["energy_residual"] <= 1e-11


def test_dispersed_springs(pair):
    """m v^2 / 2 = F s - k s^2 / 2 of each case's own force, stiffness and stroke."""
    laws = {
        "force_N": {"normal": [12.0, 0.5]},
        "stiffness_N_per_m": {"uniform": [20.0, 40.0]},
        "stroke_mm": {"triangular": [90.0, 100.0, 120.0]},
    }
    push = PUSH | {"stiffness_N_per_m": 30.0, "stroke_mm": 100.0}
    table = (
        pair(
            STILL
            | {"spring": [push]}
            | {f"dispersion.spring.push.{key}": law for key, law in laws.items()}
        )
        .run(cases=100)
        .to_pandas()
    )
    force, stiffness, stroke = (table[f"in_spring_push_{key}"] for key in laws)
    work = force * stroke / 1e3 - 0.5 * stiffness * (stroke / 1e3) ** 2
    assert_allclose(table["separation_speed_m_s"], np.sqrt(2.0 * work / REDUCED), rtol=1e-12)


def fore_speed(pair, motors, end=1.0, step_s=0.05):
    """Speed gained by the fore body, every row."""
    history = flown(pair(FREE | {"motor": motors, "run.end_time_s": end}), step_s)
    return history["time_s"].to_numpy(), history["fore_vx_m_s"].to_numpy() - 1.0


def test_motor_delay(pair):
    """Ignition at 0.1 s, 0.033 s late, 0.2 s of 2 m/s2."""
    time, speed = fore_speed(pair, [MOTOR | {"ignition_s": 0.1, "delay_s": 0.033, "burn_s": 0.2}])
    assert_allclose(speed, 2.0 * np.clip(time - 0.133, 0.0, 0.2), rtol=0, atol=1e-13)


PROFILE = {"time_s": [0.0, 0.11, 0.3, 0.62], "fraction": [0.2, 1.0, 0.8, 0.0]}


def impulse(time, profile):
    """Integral of a piecewise linear profile, zero after its last row: a quadratic in every
    piece."""
    knots, values = np.array(profile["time_s"]), np.array(profile["fraction"])
    done = np.concatenate([[0.0], np.cumsum(0.5 * np.diff(knots) * (values[1:] + values[:-1]))])
    t = np.clip(time, 0.0, knots[-1])
    i = np.clip(np.searchsorted(knots, t, side="right") - 1, 0, len(knots) - 2)
    return done[i] + 0.5 * (t - knots[i]) * (values[i] + np.interp(t, knots, values))


@pytest.mark.parametrize("step", [0.05, 0.5])
def test_profile(pair, step):
    """Linear between its rows, so that speeds are quadratic and exact, for any step; ignition 0.05
    s."""
    history = flown(
        pair(
            FREE
            | {
                "motor": [MOTOR | {"ignition_s": 0.05, "profile": PROFILE}],
                "run.end_time_s": 1.0,
                "solver.step_s": step,
            }
        )
    )
    expected = 2.0 * impulse(history["time_s"].to_numpy() - 0.05, PROFILE)
    assert_allclose(history["fore_vx_m_s"] - 1.0, expected, rtol=0, atol=1e-13)
    assert_allclose(expected[-1], 2.0 * (0.066 + 0.171 + 0.128), rtol=1e-13)


def test_profile_cut_by_burn_out(pair):
    """Its own rows go to 0.62 s, but it burns 0.2 s only."""
    time, speed = fore_speed(pair, [MOTOR | {"burn_s": 0.2, "profile": PROFILE}])
    assert_allclose(speed, 2.0 * impulse(np.minimum(time, 0.2), PROFILE), rtol=0, atol=1e-13)


LATE = {"time_s": [0.1, 0.3], "fraction": [0.5, 1.0]}


@pytest.mark.parametrize(
    ("keys", "begins", "ends"),
    [
        pytest.param({}, 0.1, 0.3, id="from the start"),
        pytest.param({"ignition_s": 0.05, "delay_s": 0.02}, 0.17, 0.37, id="late ignition"),
        pytest.param({"burn_s": 0.25}, 0.1, 0.25, id="cut by burn-out"),
        pytest.param({"burn_s": 0.08}, 0.08, 0.08, id="burnt out before its first row"),
        pytest.param({"burn_s": 0.08, "tail_off_s": 0.1}, 0.08, 0.08, id="no tail of no thrust"),
    ],
)
def test_profile_whose_first_row_is_late(pair, keys, begins, ends):
    """No thrust before its first row, at which it begins at once with its first fraction."""
    time, speed = fore_speed(pair, [MOTOR | {"profile": LATE} | keys])
    since = np.clip(time, begins, ends) - begins
    assert_allclose(speed, 2.0 * (0.5 * since + 1.25 * since**2), rtol=0, atol=1e-13)


def test_profile_with_build_up(pair):
    """Both multiply: 6 N (1 - exp(-t / 0.1)) times the fraction, integrated by scipy."""
    time, speed = fore_speed(pair, [MOTOR | {"build_up_s": 0.1, "profile": PROFILE}])

    def level(t):
        return 2.0 * -math.expm1(-t / 0.1) * np.interp(t, PROFILE["time_s"], PROFILE["fraction"])

    expected = [quad(level, 0.0, min(t, 0.62), points=[0.11, 0.3], epsabs=1e-13)[0] for t in time]
    assert_allclose(speed, expected, rtol=0, atol=1e-12)


@pytest.mark.parametrize("build_up", [0.0, 0.08])
def test_tail_off(pair, build_up):
    """After 0.2 s of burning the thrust it has reached falls as exp(-t / 0.06), without end."""
    time, speed = fore_speed(
        pair, [MOTOR | {"burn_s": 0.2, "tail_off_s": 0.06, "build_up_s": build_up}]
    )
    on, after = np.clip(time, 0.0, 0.2), np.clip(time - 0.2, 0.0, None)
    reached = -math.expm1(-0.2 / build_up) if build_up else 1.0
    burnt = on + build_up * np.expm1(-on / build_up) if build_up else on
    assert_allclose(
        speed, 2.0 * (burnt - reached * 0.06 * np.expm1(-after / 0.06)), rtol=0, atol=1e-12
    )


def test_tail_off_after_a_profile(pair):
    """From the last fraction on, 0.4, without a jump; a profile that ends at nothing has no
    tail."""
    profile = {"time_s": [0.0, 0.2], "fraction": [1.0, 0.4]}
    time, speed = fore_speed(pair, [MOTOR | {"tail_off_s": 0.06, "profile": profile}])
    tail = 0.4 * 0.06 * -np.expm1(-np.clip(time - 0.2, 0.0, None) / 0.06)
    assert_allclose(speed, 2.0 * (impulse(time, profile) + tail), rtol=0, atol=1e-12)


def test_three_motors_on_a_body(pair):
    """Retro, profile and build-up: velocities add."""
    motors = [
        MOTOR
        | {"name": "retro", "cant_deg": 180.0, "thrust_N": 1.5, "ignition_s": 0.2, "burn_s": 0.35},
        MOTOR | {"name": "shaped", "profile": PROFILE},
        MOTOR | {"name": "slow", "build_up_s": 0.07, "burn_s": 0.6},
    ]
    together = fore_speed(pair, motors)
    alone = [fore_speed(pair, [motor]) for motor in motors]
    assert_allclose(together[1], sum(speed for _, speed in alone), rtol=0, atol=1e-12)


def test_a_motor_off_the_axis_turns_its_body(pair):
    """6 N forward, 0.1 m above the axis: it pushes the nose down, 0.6 N m on 5 kg m2; and a small
    angle later no longer along x."""
    history = flown(
        pair(FREE | {"motor": [MOTOR | {"offset_m": [0.1, 0.0]}], "run.end_time_s": 0.5})
    )
    t = history["time_s"].to_numpy()
    assert_allclose(history["fore_omega_z_deg_s"], np.degrees(-0.12 * t), rtol=1e-12, atol=1e-12)
    fallen = [quad(lambda u: 2.0 * math.sin(-0.06 * u * u), 0.0, end)[0] for end in t]
    assert_allclose(history["fore_vy_m_s"], fallen, rtol=0, atol=1e-13)


SPIN = 2.0  # rad/s about z
SPINNING = {
    "initial.omega_rad_s": [0.0, 0.0, SPIN],
    "initial.altitude_m": 0.0,
    "run.end_time_s": 1.0,
}


def from_start(history, column):
    """A velocity less its value at the start."""
    return history[column].to_numpy() - history[column].iloc[0]


def test_load_in_ground_axes(pair):
    """On a spinning body, from 0.13 s to 0.57 s: what it gains is F (t - 0.13) / m."""
    load = {
        "name": "pull",
        "body": "aft",
        "force_N": [1.0, -2.0, 3.0],
        "frame": "ground",
        "start_s": 0.13,
        "end_s": 0.57,
    }
    history = flown(pair(FREE | SPINNING | {"load": [load]}))
    on = np.clip(history["time_s"].to_numpy() - 0.13, 0.0, 0.44)
    for axis, force in zip("xyz", (1.0, -2.0, 3.0), strict=True):
        assert_allclose(from_start(history, f"aft_v{axis}_m_s"), force * on, rtol=0, atol=1e-13)
    assert not from_start(history, "fore_vy_m_s").any()


def test_load_in_body_axes(pair):
    """The same turning with its body: 2 N along its y axis give 2 (cos wt - 1) / w along x and 2
    sin(wt) / w along y."""
    history = flown(
        pair(
            FREE
            | SPINNING
            | {"load": [{"name": "pull", "body": "aft", "force_N": [0.0, 2.0, 0.5]}]}
        )
    )
    t = history["time_s"].to_numpy()
    assert_allclose(
        from_start(history, "aft_vx_m_s"), 2.0 * (np.cos(SPIN * t) - 1.0) / SPIN, rtol=0, atol=1e-13
    )
    assert_allclose(
        from_start(history, "aft_vy_m_s"), 2.0 * np.sin(SPIN * t) / SPIN, rtol=0, atol=1e-13
    )
    assert_allclose(history["aft_vz_m_s"], 0.5 * t, rtol=0, atol=1e-13)


@pytest.mark.parametrize("frame", ["body", "ground"])
def test_moment(pair, frame):
    """3 N m about z between 0.2 s and 0.6 s on 5 kg m2; z stays where it is, so both frames give
    the same."""
    load = {
        "name": "turn",
        "body": "fore",
        "moment_N_m": [0.0, 0.0, 3.0],
        "frame": frame,
        "start_s": 0.2,
        "end_s": 0.6,
    }
    history = flown(pair(FREE | SPINNING | {"load": [load]}))
    expected = SPIN + 0.6 * np.clip(history["time_s"] - 0.2, 0.0, 0.4)
    assert_allclose(np.radians(history["fore_omega_z_deg_s"]), expected, rtol=1e-13)


def test_moment_in_ground_axes_on_a_turned_body(pair):
    """Rolled by 90 deg, ground y is body -z: a moment of 3 N m about ground y turns about body -z,
    5 kg m2."""
    load = {"name": "turn", "body": "fore", "moment_N_m": [0.0, 3.0, 0.0], "frame": "ground"}
    history = flown(pair(FREE | {"load": [load], "initial.roll_deg": 90.0}))
    assert_allclose(
        np.radians(history["fore_omega_z_deg_s"]), -0.6 * history["time_s"], rtol=1e-12, atol=1e-15
    )


@pytest.mark.parametrize("frame", ["body", "ground"])
def test_load_at_a_point(pair, frame):
    """5 N along z at a point 0.4 m ahead of the mass centre and 0.3 m above it: (0.4, 0.3, 0) x (0,
    0, 5) = (1.5, -2, 0) N m at once."""
    load = {
        "name": "pull",
        "body": "fore",
        "force_N": [0.0, 0.0, 5.0],
        "point_m": [0.6, 0.3, 0.0],
        "frame": frame,
        "end_s": 1e-3,
    }
    history = flown(pair(FREE | {"load": [load], "run.end_time_s": 1e-3}), 1e-3)
    omega = np.radians([history[f"fore_omega_{axis}_deg_s"].iloc[-1] for axis in "xyz"])
    assert_allclose(omega[:2], [1.5e-3 / 3.0, -2e-3 / 4.0], rtol=1e-6)


@pytest.mark.slow
def test_dispersed_loads(pair, plainly):
    """Force, start and end, each case its own: v = F (end - start) / m."""
    load = {"name": "pull", "body": "aft", "force_N": [1.0, 0.0, 0.0], "start_s": 0.1, "end_s": 0.3}
    laws = {
        "force_N.x": {"normal": [1.0, 0.2]},
        "start_s": {"uniform": [0.05, 0.15]},
        "end_s": {"discrete": [0.2, 0.3, 0.4]},
    }
    table = (
        pair(
            FREE
            | {"load": [load]}
            | {f"dispersion.load.pull.{key}": law for key, law in laws.items()}
        )
        .run(cases=100)
        .to_pandas()
    )
    force, start, end = (table[f"in_load_pull_{key}"] for key in ("force_x_N", "start_s", "end_s"))
    assert_allclose(table["separation_speed_m_s"], -force * (end - start), rtol=1e-12)


def test_loads_that_do_nothing_are_said(pair):
    """A load, spring or motor without force in any case; a tail-off without burn-out."""
    spring = PUSH | {"force_N": 0.0}
    load = {"name": "gust", "body": "fore"}
    motors = [MOTOR | {"thrust_N": 0.0}, MOTOR | {"name": "slow", "tail_off_s": 0.5}]
    given = {"uniform": [0.0, 1.0]}
    laws = {
        "load.gust.moment_N_m.y": given,
        "spring.push.damping_N_s_per_m": given,
        "motor.push.thrust_N": given,
        "motor.slow.burn_s": {"uniform": [0.1, 0.2]},
    }
    scene = FREE | {"spring": [spring], "load": [load], "motor": motors}
    not_flown = Integration(None, None, None)
    assert scene_notes(pair(scene | {"dispersion": laws}), not_flown) == []
    assert [note.partition(" does nothing")[0] for note in scene_notes(pair(scene), not_flown)] == [
        "motor.push",
        "motor.slow.tail_off_s = 0.5",
        "load.gust",
        "spring.push",
    ]
