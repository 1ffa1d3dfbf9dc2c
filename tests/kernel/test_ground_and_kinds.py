"""The ground as a body, common and custom joint kinds, redundant joints: hand formulas, and
properties of any joint."""

import itertools
import math

import numpy as np
import pytest
from numpy.testing import assert_allclose
from scipy.integrate import solve_ivp
from scipy.spatial.transform import Rotation

from sepmc.campaign.campaign import Campaign
from sepmc.scene.read import parse_campaign

G, MASS, ARM = 9.80665, 2.0, 0.5
INERTIA = [0.3, 0.4, 0.5]
# Kinds as what they hold, in joint axes: translations and rotations; a rod is none of these.
HELD = {
    "fixed": ("xyz", "xyz"),
    "slider": ("yz", "xyz"),
    "revolute": ("xyz", "yz"),
    "cylindrical": ("yz", "yz"),
    "universal": ("xyz", "z"),
    "spherical": ("xyz", ""),
    "planar": ("x", "yz"),
    "point-on-plane": ("x", ""),
    "point-on-line": ("yz", ""),
}
UP, ACROSS = (
    {"x_axis": [1.0, 0.0, 0.0], "y_axis": [0.0, 1.0, 0.0]},
    {"x_axis": [0.0, 0.0, 1.0], "y_axis": [1.0, 0.0, 0.0]},
)
SUBSETS = ["".join(axes) for n in range(4) for axes in itertools.combinations("xyz", n)]


def bob(kind, joint=None, bodies=("ground", "bob"), **settings):
    """A body of 2 kg that hangs from the ground by its nose, half a metre ahead of its mass centre;
    nose up at first."""
    tree = {
        "environment": {"atmosphere": "none", "gravity": "constant"},
        "body": {"bob": {"mass_kg": MASS, "inertia_kg_m2": INERTIA, "cg_m": [ARM, 0.0, 0.0]}},
        "joint": {"nail": {"bodies": list(bodies), "point_m": [0.0, 0.0, 0.0], **(joint or {})}},
        "phase": [{"name": "only", "joints": {"nail": kind}}],
        "initial": {"altitude_m": 0.0, "speed_m_s": 0.0, "pitch_deg": 90.0},
        "run": {"end_time_s": 1.0},
        "solver": {"step_s": 0.01},
    }
    return Campaign(
        parse_campaign(
            tree, "bob", {key.replace("__", "."): value for key, value in settings.items()}
        )
    )


def flown(campaign, step_s=0.01):
    history = campaign.simulate(step_s=step_s)
    assert history.attrs["status"] == "ok"
    return history


def vector(history, name, unit):
    """Columns ``name_x_unit`` ... as (rows, 3)."""
    return history[[f"{name}_{axis}_{unit}" for axis in "xyz"]].to_numpy().copy()


def turned(history, body):
    return Rotation.from_euler(
        "ZYX",
        history[[f"{body}_{angle}_deg" for angle in ("pitch", "yaw", "roll")]].to_numpy(),
        degrees=True,
    )


ROD = {"second_point_m": [0.2, 0.0, 0.0]}
HANGING = [
    *((kind, {}) for kind in ("fixed", "universal", "spherical", "planar", "point-on-plane")),
    ("revolute", UP),
    ("revolute", ACROSS),
    *((kind, ACROSS) for kind in ("slider", "cylindrical", "point-on-line")),
    ("rod", ROD),
]


@pytest.mark.slow
@pytest.mark.parametrize("formulation", ["reduced", "full"])
@pytest.mark.parametrize(("kind", "joint"), HANGING)
def test_at_rest_the_joint_carries_the_weight(kind, joint, formulation):
    """2 kg hang straight below: 19.6133 N up, no moment, no motion; and the ground is pulled down
    by as much."""
    campaign = bob(kind, joint, solver__formulation=formulation, solver__step_s=0.05)
    history = flown(campaign)
    weight = np.array([MASS * G, 0.0, 0.0])  # body axes: x is up
    assert_allclose(
        vector(history, "nail_force_on_bob", "N"),
        np.broadcast_to(weight, (len(history), 3)),
        rtol=0,
        atol=1e-12,
    )
    assert_allclose(
        vector(history, "nail_force_on_ground", "N"),
        np.broadcast_to(-weight, (len(history), 3)),
        rtol=0,
        atol=1e-12,
    )
    assert_allclose(vector(history, "nail_moment_on_bob", "N_m"), 0.0, rtol=0, atol=1e-12)
    assert_allclose(vector(history, "bob_omega", "deg_s"), 0.0, rtol=0, atol=1e-10)
    assert_allclose(history["bob_y_m"], 0.0, rtol=0, atol=1e-13)


@pytest.mark.slow
@pytest.mark.parametrize("bodies", [("ground", "bob"), ("bob", "ground")])
@pytest.mark.parametrize("kind", ["revolute", "custom", "loose"])
def test_pendulum(kind, bodies):
    """Released level, about an axis across: (I + m l^2) a'' = -m g l cos a for its pitch, by scipy;
    the reaction is what Newton says."""
    own = {
        "kind": {
            "custom": {"translations": ["x", "y", "z"], "rotations": ["x", "y"]},
            "loose": {"translations": ["x", "y"]},
        }
    }
    joint = ACROSS | own if kind == "revolute" else own
    history = flown(bob(kind, joint, bodies, initial__pitch_deg=0.0, run__end_time_s=2.0))
    inertia = INERTIA[2] + MASS * ARM**2

    def swing(_, y):  # the mass centre hangs aft of the nail: at (-l cos a, -l sin a)
        return [y[1], MASS * G * ARM * math.cos(y[0]) / inertia]

    time = history["time_s"].to_numpy()
    angle, rate = solve_ivp(swing, (0.0, 2.0), [0.0, 0.0], "DOP853", time, rtol=1e-13, atol=1e-14).y
    assert_allclose(np.radians(history["bob_pitch_deg"]), angle, rtol=0, atol=1e-10)
    assert_allclose(np.radians(history["bob_omega_z_deg_s"]), rate, rtol=0, atol=1e-10)
    away = -np.stack([np.cos(angle), np.sin(angle)], axis=1)  # from nail to mass centre
    turning = MASS * G * ARM * np.cos(angle) / inertia
    acceleration = ARM * (
        turning[:, None] * np.stack([np.sin(angle), -np.cos(angle)], axis=1)
        - rate[:, None] ** 2 * away
    )
    force = vector(history, "nail_force_on_bob", "N")
    if bodies[0] == "bob":
        force = turned(history, "bob").apply(force)
    assert_allclose(force[:, :2], MASS * (acceleration + np.array([0.0, G])), rtol=0, atol=1e-8)


def test_conical_pendulum():
    """A body of equal moments of inertia on a sphere joint, tilted by a and turned with w^2 = g /
    (l cos a): it circles level, steadily."""
    tilt = math.radians(30.0)
    w = math.sqrt(G / (ARM * math.cos(tilt)))
    # the vertical in body axes at 60 deg of pitch
    omega = [w * math.cos(tilt), w * math.sin(tilt), 0.0]
    sphere = {"body__bob__inertia_kg_m2": [0.2, 0.2, 0.2]}
    history = flown(
        bob(
            "spherical",
            initial__pitch_deg=60.0,
            initial__omega_rad_s=omega,
            run__end_time_s=2.0,
            **sphere,
        )
    )
    assert_allclose(history["bob_y_m"], 0.0, rtol=0, atol=1e-11)
    assert_allclose(
        np.hypot(history["bob_vx_m_s"], history["bob_vz_m_s"]), ARM * math.sin(tilt) * w, rtol=1e-11
    )
    assert_allclose(
        np.linalg.norm(vector(history, "nail_force_on_bob", "N"), axis=1),
        MASS * G / math.cos(tilt),
        rtol=1e-10,
    )


@pytest.mark.slow
@pytest.mark.parametrize(
    ("kind", "joint"),
    [(kind, joint) for kind in HELD for joint in (UP, ACROSS)] + [("rod", ROD)],
)
@pytest.mark.parametrize("formulation", ["reduced", "full"])
def test_energy_on_the_ground(kind, joint, formulation):
    """Spun and released, tilted: a joint to the ground does no work on its body."""
    campaign = bob(
        kind,
        joint,
        initial__pitch_deg=40.0,
        initial__roll_deg=20.0,
        initial__yaw_deg=-10.0,
        solver__formulation=formulation,
    )
    held = HELD.get(kind, ("", ""))[1]
    axes = np.array([joint.get("x_axis", UP["x_axis"]), joint.get("y_axis", UP["y_axis"])])
    axes = [*axes, np.cross(*axes)]
    omega = sum(
        rate * axis
        for name, rate, axis in zip("xyz", (1.0, 2.0, -1.5), axes, strict=True)
        if name not in held
    ) + np.zeros(3)
    history = flown(campaign.with_settings({"initial.omega_rad_s": omega.tolist()}))
    speeds = history[["bob_vx_m_s", "bob_vy_m_s", "bob_vz_m_s"]].to_numpy()
    rates = np.radians(vector(history, "bob_omega", "deg_s"))
    energy = (
        0.5 * MASS * np.sum(speeds**2, axis=1)
        + 0.5 * np.sum(rates**2 * INERTIA, axis=1)
        + MASS * G * history["bob_y_m"]
    )
    assert np.abs(energy - energy[0]).max() <= 1e-11 * max(1.0, abs(energy).max())
    outcomes = history.attrs["outcomes"]
    assert (
        max(
            outcomes[f"joint_{what}"]
            for what in (
                "gap_residual_m",
                "angle_residual_rad",
                "gap_rate_residual_m_s",
                "angle_rate_residual_rad_s",
            )
        )
        <= 1e-11
    )


@pytest.mark.parametrize(
    "kind", ["slider", "cylindrical", "point-on-line", "planar", "point-on-plane"]
)
@pytest.mark.parametrize("slope", [10.0, 45.0])
def test_down_a_slope(kind, slope):
    """a = -g sin a along a rail or a plane; through the mass centre, so that nothing turns; the
    joint carries m g cos a across."""
    point = {"point_m": [ARM, 0.0, 0.0]}
    if kind in ("planar", "point-on-plane"):
        point |= {"x_axis": [0.0, 1.0, 0.0], "y_axis": [0.0, 0.0, 1.0]}
    history = flown(bob(kind, point, initial__pitch_deg=slope))
    way = -0.5 * G * math.sin(math.radians(slope)) * history["time_s"] ** 2
    along = [math.cos(math.radians(slope)), math.sin(math.radians(slope))]
    assert_allclose(history["bob_x_m"], way * along[0], rtol=0, atol=1e-12)
    assert_allclose(history["bob_y_m"], way * along[1], rtol=0, atol=1e-12)
    expected = np.array([0.0, MASS * G * math.cos(math.radians(slope)), 0.0])
    assert_allclose(
        vector(history, "nail_force_on_bob", "N"),
        np.broadcast_to(expected, (len(history), 3)),
        rtol=0,
        atol=1e-11,
    )


def test_rail_let_go(pair):
    """Up a rail of 0.2 m at 3 g, then free: tip-off by gravity between two shoes is nil for one
    slider; it leaves at sqrt(2 a s)."""
    settings = {
        "environment.gravity": "constant",
        "initial": {"altitude_m": 0.0, "speed_m_s": 0.0, "pitch_deg": 90.0},
        "joint.rail": {"bodies": ["ground", "aft"], "point_m": [3.0, 0.0, 0.0], "apart": 1},
        "motor": [
            {
                "name": "lift",
                "body": "aft",
                "thrust_N": 4.0 * 4.0 * G,
                "station_m": 4.0,
                "cant_deg": 0.0,
            }
        ],
        "phase": [
            {
                "name": "rail",
                "joints": {"rail": "slider", "pins": "fixed"},
                "until": {"joint": "rail", "stroke_m": 0.2},
            },
            {"name": "up", "joints": {"pins": "fixed"}},
        ],
    }
    outcomes = flown(pair(settings)).attrs["outcomes"]
    assert_allclose(
        outcomes["rail_release_time_s"], math.sqrt(2.0 * 0.2 / (3.0 * G)), rtol=0, atol=1e-12
    )
    assert_allclose(outcomes["rail_separation_speed_m_s"], 3.0 * G * 0.5, rtol=1e-12)


def test_speed_where_the_ground_is_not_held(pair):
    """A joint to the ground that is free from the start: the gap grows with the speed of the
    vehicle."""
    settings = {
        "joint.mark": {"bodies": ["ground", "fore"], "point_m": [0.0, 0.0, 0.0], "apart": 1},
        "initial.speed_m_s": 7.0,
    }
    outcomes = flown(pair(settings)).attrs["outcomes"]
    assert_allclose(
        [outcomes["mark_separation_speed_m_s"], outcomes["mark_separation_distance_mm"]],
        [7.0, 3500.0],
        rtol=1e-12,
    )


# ---- two bodies that tumble

LOPSIDED = {
    "body.fore.cg_m": [1.0, 0.05, -0.02],
    "body.aft.cg_m": [3.0, -0.04, 0.03],
    "body.aft.inertia_products_kg_m2": [0.2, -0.1, 0.15],
}
LOADS = {
    "motor": [
        {
            "name": "retro",
            "body": "aft",
            "thrust_N": 1.0,
            "station_m": 3.2,
            "cant_deg": 150.0,
            "offset_m": [0.1, 0.05],
        }
    ],
    "load": [{"name": "turn", "body": "aft", "moment_N_m": [0.4, -0.2, 0.3]}],
}
TUMBLE = (
    LOPSIDED
    | LOADS
    | {
        "initial.omega_rad_s": [1.5, 0.8, -1.2],
        "initial.altitude_m": 0.0,
        "run.end_time_s": 1.0,
        "solver.step_s": 0.02,
    }
)
TILTED = {"joint.pins.x_axis": [0.9, 0.3, -0.2], "joint.pins.y_axis": [0.1, 1.0, 0.3]}


def only(kind):
    return {"phase": [{"name": "only", "joints": {"pins": kind}}]}


def axes_of(joint):
    """Orthonormal joint axes, rows."""
    x, y = (np.array(joint[f"joint.pins.{axis}_axis"]) for axis in "xy")
    x = x / np.linalg.norm(x)
    y = y - x * (x @ y)
    y /= np.linalg.norm(y)
    return np.array([x, y, np.cross(x, y)])


def check_held(history, held, joint):
    """Constrained gaps and rotations stay; loads along free directions are zero; action is
    reaction."""
    translations, rotations = held
    axes = axes_of(joint)
    gap = vector(history, "pins_gap", "m") @ axes.T
    relative = (turned(history, "fore").inv() * turned(history, "aft")).as_matrix()
    relative = axes @ relative @ axes.T  # columns: axes of the aft body in those of the fore
    force_b, moment_b = (
        vector(history, f"pins_{what}_on_aft", unit)
        for what, unit in (("force", "N"), ("moment", "N_m"))
    )
    force_a, moment_a = (
        vector(history, f"pins_{what}_on_fore", unit)
        for what, unit in (("force", "N"), ("moment", "N_m"))
    )
    for i, axis in enumerate("xyz"):
        if axis in translations:
            assert np.abs(gap[:, i]).max() <= 1e-12
        else:
            assert np.abs(force_b @ axes[i]).max() <= 1e-12 * max(1.0, np.abs(force_b).max())
    bx, by = relative[:, :, 0], relative[:, :, 1]
    if len(rotations) == 3:
        assert np.abs(relative - np.eye(3)).max() <= 1e-12
    elif len(rotations) == 2:  # the axis about which it is free is one axis of both
        (free,) = set("xyz") - set(rotations)
        i = "xyz".index(free)
        assert np.abs(relative[:, i, i] - 1.0).max() <= 1e-12
        assert np.abs(moment_b @ axes[i]).max() <= 1e-12 * max(1.0, np.abs(moment_b).max())
    elif len(rotations) == 1:
        product = {"x": by[:, 2], "y": bx[:, 2], "z": bx[:, 1]}[rotations]
        normal = {
            "x": np.cross(by, [0, 0, 1]),
            "y": np.cross(bx, [0, 0, 1]),
            "z": np.cross(bx, [0, 1, 0]),
        }[rotations]
        assert np.abs(product).max() <= 1e-12
        assert np.abs(np.cross(moment_b @ axes.T, normal)).max() <= 1e-11 * max(
            1.0, np.abs(moment_b).max()
        )
    else:
        assert not np.abs(moment_b).max() > 1e-12
    assert_allclose(force_a + force_b, 0.0, rtol=0, atol=1e-11 * max(1.0, np.abs(force_b).max()))
    assert_allclose(
        moment_a + moment_b + np.cross(vector(history, "pins_gap", "m"), force_b),
        0.0,
        rtol=0,
        atol=1e-11 * max(1.0, np.abs(moment_a).max()),
    )


def same_motion(result, expected, bound=1e-11):
    """All columns of two histories, over their own size, or 1 m, s, deg, N."""
    names = list(expected.columns[2:])
    ours, theirs = (history[names].to_numpy(dtype=float) for history in (result, expected))
    least = np.array([1e3 if name.endswith("_mm") else 1.0 for name in names])
    off = np.abs(ours - theirs).max(axis=0) / np.maximum(least, np.abs(theirs).max(axis=0))
    assert (off <= bound).all(), names[int(np.argmax(off))]


@pytest.mark.slow
@pytest.mark.parametrize(
    "joint",
    [{"joint.pins.x_axis": [1.0, 0.0, 0.0], "joint.pins.y_axis": [0.0, 1.0, 0.0]}, TILTED],
    ids=["straight", "tilted"],
)
@pytest.mark.parametrize("kind", HELD)
def test_every_kind_over_a_second(pair, kind, joint):
    """Tumbling and pushed: constraints stay satisfied, free directions carry no load; the full
    formulation equals the reduced one, and the audit is clean."""
    campaign = pair(TUMBLE | joint | only(kind))
    history = flown(campaign)
    check_held(history, HELD[kind], joint)
    same_motion(flown(campaign.with_settings({"solver.formulation": "full"})), history)
    outcomes = history.attrs["outcomes"]
    for what in (
        "gap_residual_m",
        "angle_residual_rad",
        "gap_rate_residual_m_s",
        "angle_rate_residual_rad_s",
    ):
        assert outcomes[f"joint_{what}"] <= 1e-12
    assert outcomes["energy_residual"] <= 1e-10
    assert outcomes["redundant_rows"] == 0.0


@pytest.mark.parametrize("formulation", ["reduced", "full"])
def test_rod_over_a_second(pair, formulation):
    """The distance of two points is constant; the force acts along the rod, without a moment;
    action is reaction."""
    campaign = pair(
        TUMBLE
        | only("rod")
        | {"joint.pins.second_point_m": [2.3, 0.2, -0.1], "solver.formulation": formulation}
    )
    history = flown(campaign)
    gap, force = vector(history, "pins_gap", "m"), vector(history, "pins_force_on_aft", "N")
    assert_allclose(np.linalg.norm(gap, axis=1), math.sqrt(0.09 + 0.04 + 0.01), rtol=0, atol=1e-12)
    assert np.abs(np.cross(gap, force)).max() <= 1e-12
    assert np.abs(force).max() > 0.1
    assert not np.abs(vector(history, "pins_moment_on_aft", "N_m")).max() > 1e-12
    assert_allclose(vector(history, "pins_moment_on_fore", "N_m"), 0.0, rtol=0, atol=1e-11)
    assert_allclose(vector(history, "pins_force_on_fore", "N"), -force, rtol=0, atol=1e-12)
    same_motion(flown(campaign.with_settings({"solver.formulation": "reduced"})), history)


@pytest.mark.slow
@pytest.mark.parametrize("rotations", SUBSETS)
def test_every_custom_kind(pair, rotations):
    """All sets of translations with a set of rotations: they constrain their components, and the
    full formulation equals the reduced one."""
    for translations in SUBSETS:
        if not translations + rotations:
            continue
        own = {
            "joint.pins.kind": {
                "own": {"translations": list(translations), "rotations": list(rotations)}
            }
        }
        campaign = pair(TUMBLE | TILTED | own | only("own") | {"run.end_time_s": 0.1})
        history = flown(campaign, 0.02)
        check_held(history, (translations, rotations), TILTED)
        same_motion(flown(campaign.with_settings({"solver.formulation": "full"}), 0.02), history)


@pytest.mark.slow
@pytest.mark.parametrize("kind", HELD)
def test_custom_kinds_that_are_common(pair, kind):
    """A custom kind with the rows of a common one has the same bits."""
    own = {
        "joint.pins.kind": {
            "own": {"translations": list(HELD[kind][0]), "rotations": list(HELD[kind][1])}
        }
    }
    campaign = pair(TUMBLE | own | only("own"))
    assert flown(campaign).equals(flown(campaign.with_settings({"phase": only(kind)["phase"]})))


@pytest.mark.slow
@pytest.mark.parametrize("kind", [*HELD, "rod"])
def test_ground_or_a_great_mass(pair, kind):
    """The aft body on a fore body of 1e9 kg at rest moves as on the ground, to 1e-7, the ratio of
    the masses over a second."""
    second = {"second_point_m": [2.3, 0.2, -0.1]} if kind == "rod" else {}
    heavy = {
        "body.fore.mass_kg": 1e9,
        "body.fore.inertia_kg_m2": [1e9, 1e9, 1e9],
        "initial.speed_m_s": 0.0,
        "initial.omega_rad_s": [0.0, 0.0, 0.0],
    }
    joint = {"joint.pins": {"bodies": ["fore", "aft"], "point_m": [2.0, 0.0, 0.0], **second}}
    settings = {
        key: value for key, value in TUMBLE.items() if not key.startswith("initial.omega")
    } | {"initial.altitude_m": 1000.0}
    on_body = flown(pair(settings | joint | heavy | only(kind)))
    on_ground = flown(
        pair(
            settings
            | {
                "joint.pins": joint["joint.pins"] | {"bodies": ["ground", "aft"]},
                "initial.speed_m_s": 0.0,
            }
            | only(kind)
        )
    )
    for name in (
        "pitch_deg",
        "yaw_deg",
        "roll_deg",
        "omega_x_deg_s",
        "omega_z_deg_s",
        "vx_m_s",
        "vy_m_s",
        "vz_m_s",
    ):
        assert_allclose(
            on_body[f"aft_{name}"], on_ground[f"aft_{name}"], rtol=0, atol=1e-6, err_msg=name
        )


# ---- joints that hold twice


@pytest.mark.parametrize("formulation", ["reduced", "full"])
def test_two_fixed_joints_share(pair, formulation):
    """Symmetric about the axis: the motion of one joint; each carries half the force, six rows of
    twelve are redundant."""
    push = {
        "motor": [
            {"name": "retro", "body": "aft", "thrust_N": 2.0, "station_m": 3.0, "cant_deg": 180.0}
        ],
        "solver.formulation": formulation,
    }
    spin = {"initial.omega_rad_s": [1.5, 0.0, 0.0], "initial.altitude_m": 0.0}
    one = flown(pair(push | spin))
    twice = {
        side: {"bodies": ["fore", "aft"], "point_m": [2.0, 0.0, z]}
        for side, z in (("left", -0.3), ("right", 0.3))
    }
    campaign = pair(
        push
        | spin
        | {
            "joint": twice,
            "phase": [{"name": "locked", "joints": {"left": "fixed", "right": "fixed"}}],
        }
    )
    two = flown(campaign)
    for name in one.columns[2:]:
        if name in two.columns and not name.startswith("pins"):
            assert_allclose(two[name], one[name], rtol=0, atol=1e-12, err_msg=name)
    whole = vector(one, "pins_force_on_aft", "N")
    halves = [vector(two, f"{side}_force_on_aft", "N") for side in ("left", "right")]
    for half in halves:
        assert_allclose(half[:, 0], 0.5 * whole[:, 0], rtol=1e-11)
    assert_allclose(halves[0] + halves[1], whole, rtol=0, atol=1e-11)
    assert two.attrs["outcomes"]["redundant_rows"] == 6.0
    assert one.attrs["outcomes"]["redundant_rows"] == 0.0
