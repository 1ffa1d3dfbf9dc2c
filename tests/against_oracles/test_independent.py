"""The independent simulation against closed forms and single runs, and its refusals."""

import copy
import math
import tomllib

import numpy as np
import pytest
from numpy.testing import assert_allclose
from oracles.independent import simulate
from oracles.independent.constraints import Constraints
from oracles.independent.events import constrains_less
from oracles.independent.flight import Simulation
from oracles.independent.joints import rows_of
from oracles.independent.roots import first_root
from scipy.integrate import quad

import sepmc
from sepmc.scene.read import parse_campaign
from sepmc.schema import Status
from sepmc.validation import lagrange

RETRO = {
    "name": "retro",
    "body": "aft",
    "thrust_N": 2.0,
    "station_m": 3.0,
    "cant_deg": 180.0,
}  # 2 m/s2 on the aft body alone
UP = {
    "initial.alpha_deg": -90.0,
    "initial.speed_m_s": 10.0,
    "environment.gravity": "constant",
}  # level, and climbing
G = 9.80665


def phases(*steps):
    """Phases p0, p1, ... of (kind of pins, until); the last has no until."""
    return [
        {"name": f"p{i}", "joints": {"pins": kind}} | ({"until": until} if until else {})
        for i, (kind, until) in enumerate(steps)
    ]


def flown(campaign):
    """Outcomes and events of a case that must end well."""
    result = simulate(campaign.nominal().to_dict())
    assert result.status == "ok"
    return result.outcomes, result.events


def released(pair, settings):
    return flown(pair(settings))[0]["release_time_s"]


def test_columns_are_the_public_ones(table2):
    result = simulate(table2.case(3).to_dict())
    assert list(result.outcomes) == [column.name for column in table2.outcome_columns]


def test_table2_against_minimal_coordinates(table2):
    """One body's six degrees of freedom and the joint's: another formulation, written
    separately."""
    case = table2.case(5).to_dict()
    other, result = lagrange.simulate(case), simulate(case)
    for name, value in result.outcomes.items():
        if name in other:
            assert_allclose(value, other[name], rtol=1e-10, atol=1e-10, err_msg=name)


@pytest.mark.slow
@pytest.mark.parametrize("name", ["table2.toml", "spring-pushers.toml"])
def test_against_a_single_run(name):
    campaign = sepmc.load(name)
    case = campaign.case(1)
    history, result = campaign.simulate(case, step_s=0.05), simulate(case.to_dict())
    assert result.status == history.attrs["status"]
    for column, value in result.outcomes.items():
        # of a load that stands all but still any time is the peak's
        if not column.endswith("_time_s") or "_peak_" not in column:
            assert_allclose(
                value, history.attrs["outcomes"][column], rtol=1e-8, atol=1e-9, err_msg=column
            )


def test_stroke_of_a_pushed_body(pair):
    """2 m/s2: 90 mm after 0.3 s."""
    settings = {
        "motor": [RETRO],
        "phase": phases(("slider", {"joint": "pins", "stroke_mm": 90.0}), ("free", None)),
    }
    assert_allclose(released(pair, settings), 0.3, rtol=0, atol=1e-13)


def test_late_joint(pair):
    """The phase ends at 0.1 s and the joint is released 0.05 s later; the next phase waits for its
    stroke of 10 mm meanwhile."""
    settings = {"motor": [RETRO], "joint.pins.delay_s": 0.05}
    steps = (
        ("slider", {"time_s": 0.1}),
        ("point-on-line", {"joint": "pins", "stroke_mm": 12.25}),
        ("free", None),
    )
    result, events = flown(pair(settings | {"phase": phases(*steps)}))
    ends = {what: time for time, what in events}
    assert_allclose(ends["phase p1 ended"], math.sqrt(0.01225), rtol=0, atol=1e-13)
    assert_allclose(result["release_time_s"], math.sqrt(0.01225) + 0.05, rtol=0, atol=1e-13)


def test_conditions_already_met(pair):
    """A stroke of zero and a time in the past end their phases at once."""
    steps = (
        ("fixed", {"time_s": 0.2}),
        ("slider", {"time_s": 0.1}),
        ("point-on-line", {"joint": "pins", "stroke_mm": 0.0}),
        ("free", None),
    )
    case = (
        pair({"phase": phases(("fixed", {"time_s": 0.2}), ("slider", {"time_s": 0.3}), *steps[2:])})
        .nominal()
        .to_dict()
    )
    case["phase"][1]["until"]["time"] = 0.1
    assert simulate(case).outcomes["release_time_s"] == 0.2


def test_failed_joint(pair):
    settings = {"joint.pins.fails": 1, "phase": phases(("fixed", {"time_s": 0.1}), ("free", None))}
    result = simulate(pair(settings).nominal().to_dict())
    assert result.status == "never-released"
    assert math.isnan(result.outcomes["release_time_s"])


@pytest.mark.parametrize(("any_or_all", "expected"), [("any", 0.1), ("all", 0.3)])
def test_any_and_all(pair, any_or_all, expected):
    until = {any_or_all: [{"joint": "pins", "stroke_mm": 90.0}, {"time_s": 0.1}]}
    settings = {"motor": [RETRO], "phase": phases(("slider", until), ("free", None))}
    assert_allclose(released(pair, settings), expected, rtol=0, atol=1e-13)


def test_height_from_above_and_below(pair):
    """Thrown up at 10 m/s: the first body passes 1 m above its start on the way up, and half a
    metre on the way down."""
    up, down = ({"body": "fore", "altitude_m": height} for height in (1001.0, 1000.5))
    settings = UP | {
        "phase": phases(("slider", up), ("point-on-line", down), ("free", None)),
        "run.end_time_s": 3.0,
    }
    _, events = flown(pair(settings))
    times = [
        (10.0 + sign * math.sqrt(100.0 - 2.0 * G * rise)) / G
        for sign, rise in ((-1.0, 1.0), (1.0, 0.5))
    ]
    assert_allclose([time for time, what in events if "ended" in what], times, rtol=0, atol=1e-12)


def test_break_load(pair):
    """2 N (1 - exp(-t / 0.1)) along a locked pair of 3 kg and 1 kg: the joint carries three
    quarters."""
    steps = ("fixed", {"joint": "pins", "force_N": 1.2}), ("free", None)
    time = released(pair, {"motor": [RETRO | {"build_up_s": 0.1}], "phase": phases(*steps)})
    assert_allclose(time, -0.1 * math.log(1.0 - 1.2 / 1.5), rtol=0, atol=1e-12)


@pytest.mark.parametrize("begins", [0.0, 0.06])
def test_thrust_from_ignition_to_tail_off(pair, begins):
    """Speed gained: the integral of build-up times profile, none before its first row, over the
    burn, then of the tail, over 1 kg."""
    profile = {"time_s": [begins, 0.1, 0.3], "fraction": [0.2, 1.0, 0.5]}
    motor = RETRO | {
        "build_up_s": 0.04,
        "ignition_s": 0.03,
        "delay_s": 0.02,
        "burn_s": 0.2,
        "tail_off_s": 0.05,
        "profile": profile,
    }
    result, _ = flown(pair({"motor": [motor], "phase": phases(("free", None))}))

    def thrust(t):
        return 2.0 * -math.expm1(-t / 0.04) * np.interp(t, profile["time_s"], profile["fraction"])

    burnt = quad(thrust, begins, 0.2, points=[0.1], epsabs=1e-14)[0] + thrust(
        0.2
    ) * 0.05 * -math.expm1(-0.25 / 0.05)
    assert_allclose(result["separation_speed_m_s"], burnt, rtol=1e-12)


@pytest.mark.parametrize("axis", [None, [-1.0, 0.0, 0.0]])
def test_spring_to_its_stroke(pair, axis):
    """24 N less 100 N/m over 0.2 m, between 3 kg and 1 kg: energy 24 x 0.2 - 50 x 0.04 = 2.8 J;
    speed sqrt(2 E / 0.75 kg)."""
    spring = {
        "name": "push",
        "bodies": ["fore", "aft"],
        "point_m": [2.0, 0.0, 0.0],
        "second_point_m": [2.3, 0.0, 0.0],
    }
    spring |= {"force_N": 24.0, "stiffness_N_per_m": 100.0, "stroke_mm": 200.0} | (
        {"axis": axis} if axis else {}
    )
    result, _ = flown(pair({"spring": [spring], "phase": phases(("slider", None))}))
    assert_allclose(result["separation_speed_m_s"], math.sqrt(2.0 * 2.8 / 0.75), rtol=1e-12)


def test_load_from_start_to_end(pair):
    """3 N in ground axes across a body of 1 kg that pitches at 1 rad/s, for 0.2 s: 0.6 m/s upward
    whatever its attitude."""
    load = {
        "name": "side",
        "body": "aft",
        "force_N": [0.0, 3.0, 0.0],
        "frame": "ground",
        "start_s": 0.1,
        "end_s": 0.3,
    }
    turning = {"initial.omega_rad_s": [0.0, 0.0, 1.0], "run.end_time_s": 0.5}
    result, _ = flown(pair(turning | {"load": [load], "phase": phases(("free", None))}))
    still, _ = flown(pair(turning | {"phase": phases(("free", None))}))
    alpha = math.radians(result["aft_pitch_deg"] - result["aft_alpha_deg"])
    before = math.radians(still["aft_pitch_deg"] - still["aft_alpha_deg"])
    # the aft mass centre moves down at 1.5 m/s beside 1 m/s ahead, as it turns about a point 1.5 m
    # before it
    assert_allclose(math.tan(alpha) - math.tan(before), 0.6, rtol=1e-11)


def test_turns_are_counted(pair):
    result, _ = flown(
        pair({"initial.omega_deg_s": [0.0, 0.0, 1000.0], "phase": phases(("fixed", None))})
    )
    assert_allclose([result["fore_pitch_deg"], result["aft_pitch_deg"]], 500.0, rtol=1e-12)


@pytest.mark.parametrize(
    ("settings", "status"),
    [
        ({"body.fore.mass": -1.0}, "invalid-input"),
        ({"body.fore.inertia_products": (9.0, 0.0, 0.0)}, "invalid-input"),
        ({"body.fore.mass": math.nan}, "invalid-input"),
        (
            {"joint.pins.bodies": ("ground", "aft"), "initial.omega": (0.0, 1.0, 0.0)},
            "inconsistent-start",
        ),
    ],
)
def test_statuses(pair, settings, status):
    case = pair({"phase": phases(("slider", None))}).nominal().to_dict()
    for path, value in settings.items():
        *tables, key = path.split(".")
        node = case
        for table in tables:
            node = node[table]
        node[key] = value
    result = simulate(case)
    assert result.status == status
    assert status in {each.label for each in Status}
    assert all(math.isnan(value) for value in result.outcomes.values())


def test_beyond_the_atmosphere(table2):
    """Climbing at 85.9 km."""
    case = table2.nominal().to_dict()
    case["initial"] |= {"altitude": 85_900.0, "pitch": 1.2}
    assert simulate(case).status == "outside-atmosphere"


def test_unknown_keys_are_refused(pair):
    case = pair().nominal().to_dict()
    for place, table in (
        ("scene", case),
        ("body.fore", case["body"]["fore"]),
        ("joint.pins", case["joint"]["pins"]),
    ):
        table["novelty"] = 1.0
        with pytest.raises(ValueError, match=rf"{place}.novelty"):
            simulate(case)
        del table["novelty"]
    case["clearance"] = [{"name": "gap"}]
    with pytest.raises(ValueError, match="clearance"):
        simulate(case)


def test_joints_only_release():
    assert constrains_less(rows_of("slider", {}), rows_of("fixed", {}))
    assert constrains_less(rows_of("universal", {}), rows_of("fixed", {}))
    assert not constrains_less(rows_of("point-on-plane", {}), rows_of("point-on-line", {}))
    assert not constrains_less(rows_of("fixed", {}), rows_of("slider", {}))


KINDS = [
    "fixed",
    "slider",
    "revolute",
    "cylindrical",
    "universal",
    "spherical",
    "planar",
    "point-on-line",
    "point-on-plane",
    "rod",
    "own",
]


@pytest.mark.parametrize("kind", KINDS)
def test_rates_are_those_of_the_constraints(kind):
    """C' against differences of C, the bias against differences of C', for two bodies in any
    motion."""
    scene = copy.deepcopy(_ANY) | {"phase": [{"name": "only", "joints": {"pin": kind}}]}
    scene["joint"]["pin"]["second_point_m"] = (
        [2.4, 0.3, -0.2] if kind == "rod" else scene["joint"]["pin"]["point_m"]
    )
    case = parse_campaign(scene, "any").scene
    flight = _flight(case)
    rng = np.random.default_rng(1)
    y = flight.y + 0.3 * rng.standard_normal(flight.y.shape)
    constraints: Constraints = flight.motion.constraints
    step = 1e-5

    def at(h):
        """The motion of constant speeds and body rates, h seconds later."""
        s = flight.state(0.0, y)
        moved = y.reshape(2, 13).copy()
        moved[:, :3] += h * s.v[:-1]
        for b in range(2):
            moved[b, 6:10] = _turned(moved[b, 6:10], s.w[b], h)
        return flight.state(0.0, moved.ravel())

    rates = [
        constraints.rates(s.x, s.r, s.v[:, :, None], s.w[:, :, None])[:, 0]
        for s in (at(-step), at(0.0), at(step))
    ]
    values = [constraints.values(at(h)) for h in (-step, step)]
    assert_allclose(rates[1], (values[1] - values[0]) / (2.0 * step), rtol=0, atol=1e-8)
    assert_allclose(
        constraints.at(at(0.0)).bias, (rates[2] - rates[0]) / (2.0 * step), rtol=0, atol=1e-8
    )


def _turned(q, w, h):
    half = 0.5 * h * np.linalg.norm(w)
    p = np.array([math.cos(half), *(math.sin(half) * w / np.linalg.norm(w))])
    return np.array(
        [q[0] * p[0] - q[1:] @ p[1:], *(q[0] * p[1:] + p[0] * q[1:] + np.cross(q[1:], p[1:]))]
    )


def _flight(scene):
    import msgspec
    from oracles.independent.case import read
    from oracles.independent.state import Vehicle

    table = read(msgspec.to_builtins(scene))
    vehicle = Vehicle(table)
    vehicle.prepare()
    return Simulation(table, vehicle, 1e-12)


_ANY = tomllib.loads("""
environment = { atmosphere = "none", gravity = "none" }
[body.one]
mass_kg = 3.0
inertia_kg_m2 = [3.0, 4.0, 5.0]
inertia_products_kg_m2 = [0.3, -0.2, 0.1]
cg_m = [1.0, 0.1, 0.0]
[body.two]
mass_kg = 1.0
inertia_kg_m2 = [1.0, 2.0, 2.0]
cg_m = [3.0, 0.0, -0.2]
[joint.pin]
bodies = ["one", "two"]
point_m = [2.0, 0.1, 0.1]
x_axis = [1.0, 0.2, -0.3]
y_axis = [0.3, 1.0, 0.4]
[joint.pin.kind.own]
translations = ["x", "z"]
rotations = ["x", "z"]
[initial]
altitude_m = 0.0
speed_m_s = 0.0
[run]
end_time_s = 1.0
""")


def test_roots_between_samples():
    """A touch between two samples is found, a miss is not, and the first of several counts."""
    assert_allclose(
        first_root(lambda t: 1e-6 - (t - 0.4321) ** 2, 0.0, 1.0), 0.4311, rtol=0, atol=1e-9
    )
    assert first_root(lambda t: -1e-6 - (t - 0.4321) ** 2, 0.0, 1.0) is None
    assert_allclose(
        first_root(lambda t: math.sin(9.0 * t - 1.0), 0.0, 1.0), 1.0 / 9.0, rtol=0, atol=1e-14
    )
