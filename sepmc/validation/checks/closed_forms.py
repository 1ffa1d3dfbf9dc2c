"""Checks on free, welded and separating bodies against the closed forms of
`sepmc.validation.references`."""

import math

import numpy as np

from sepmc.validation import references as ref
from sepmc.validation.flights import NominalRun, arm, campaign, tensor
from sepmc.validation.line import Line, worst

LBF, FT = 4.4482216152605, 0.3048
# Rates (rad/s) of free_body.toml by branch of the solution; the last starts along the middle axis
# and turns over.
TOPS = {
    "about the minimum axis": [1.6, 0.2, -0.1],
    "about the maximum axis": [0.2, 0.3, 1.4],
    "turning over": None,
}


def free_body() -> list[Line]:
    """Check rates and attitude of a free body without symmetry against Euler's equations in closed
    form, in both branches of the solution and near the separatrix between them."""
    lines = []
    for name, rates in TOPS.items():
        base = campaign("free_body")
        inertia = tensor(base.scene, "stone")
        if rates is None:
            axes = np.linalg.eigh(inertia)[1]
            rates = (1.8 * axes[:, 1] + 1e-3 * axes[:, 0]).tolist()
        run = NominalRun(base.with_settings({"initial.omega_rad_s": rates}), 0.05)
        w, r = ref.asymmetric_top(run.t, inertia, rates)
        stone, case = run.body("stone"), f"free body {name}"
        lines += [
            worst(case, "rate, rad/s", w, stone.w),
            worst(case, "attitude matrix", r, stone.r),
        ]
    return lines


def _welded(run: NominalRun, joint: str, case: str) -> list[Line]:
    """Lines of `sepmc verify` on rates and attitude of the second of two bodies welded by
    ``joint``, and on the force and moment on it, against those of one composite body; ``case`` is
    their label."""
    scene = run.scene
    first, second = scene.joint[joint].bodies
    # from the joint point
    positions = [-arm(scene, body, scene.joint[joint].point) for body in (first, second)]
    masses, tensors = (
        [scene.body[b].mass for b in (first, second)],
        [tensor(scene, b) for b in (first, second)],
    )
    combined = ref.composite(masses, tensors, positions)
    w, r = ref.asymmetric_top(run.t, combined.inertia, scene.initial.omega)
    body = run.body(second)
    force, moment = ref.weld_wrench(combined, masses[1], tensors[1], positions[1], np.zeros(3), w)
    return [
        worst(case, "rate, rad/s", w, body.w),
        worst(case, "attitude matrix", r, body.r),
        worst(case, f"force on {second}, N", force, run.columns(f"{joint}_force_on_{second}_*_N")),
        worst(
            case,
            f"moment on {second}, N m",
            moment,
            run.columns(f"{joint}_moment_on_{second}_*_N_m"),
        ),
    ]


def welded() -> list[Line]:
    """Check that two asymmetric bodies in a fixed joint move as one rigid body, with the constraint
    force and moment that this needs."""
    return _welded(NominalRun(campaign("welded"), 0.05), "weld", "welded pair")


def nasa_boxes() -> list[Line]:
    """Check NASA/TP-2016-219326 test case 1, two welded boxes, against the closed form, and against
    the printed digits of an independent solution with 24 unknowns, to half a unit of the last
    digit."""
    case, run = "NASA boxes", NominalRun(campaign("nasa_boxes"), 0.05)
    lines = _welded(run, "face", case)
    for axis, value, digits in zip(
        "xyz", (0.43643767, 1.04653498, -0.07596399), run.body("B").w[-1], strict=True
    ):
        lines.append(Line(case, f"rate at 10 s, {axis}, rad/s", value, float(digits), 5e-9))
    force, moment = (
        run.columns("face_force_on_B_*_N")[0] / LBF,
        run.columns("face_moment_on_B_*_N_m")[0] / (LBF * FT),
    )
    for axis, value, digits in zip("xyz", (-1.09, 0.0754717, -0.006), force, strict=True):
        lines.append(Line(case, f"force on B at 0 s, {axis}, lbf", value, float(digits), 5e-8))
    for axis, value, digits in zip("xyz", (0.0, -0.003, -0.0377358), moment, strict=True):
        lines.append(Line(case, f"moment on B at 0 s, {axis}, lbf ft", value, float(digits), 5e-8))
    return lines


def pushed_apart() -> list[Line]:
    """Check two free bodies pushed apart by a linear spring (also with damping) or a constant force
    against the closed form: during the push and, with a stroke limit, after it, where the speeds
    stay those at the limit."""
    lines = []
    for case, settings in (
        ("spring", {}),
        ("spring with stroke", {"spring.push.stroke_m": 0.15}),
        (
            "damped spring with stroke",
            {"spring.push.stroke_m": 0.1, "spring.push.damping_N_s_per_m": 6.0},
        ),
        (
            "constant pusher with stroke",
            {"spring.push.stroke_m": 0.15, "spring.push.stiffness_N_per_m": 0.0},
        ),
    ):
        lines += _pushed(NominalRun(campaign("pushed_apart", settings)), case)
    return lines


def _pushed(run: NominalRun, case: str) -> list[Line]:
    """Lines of `sepmc verify` on the extension of the spring, on the separation speed and on the
    speeds of both bodies, against the closed form; ``case`` is their label."""
    spring, mass = run.scene.spring[0], [run.scene.body[b].mass for b in ("fore", "aft")]
    spring_data = ref.reduced_mass(*mass), spring.force, spring.stiffness
    x, v = ref.spring_extension(run.t, *spring_data, spring.damping)
    if math.isfinite(spring.stroke):
        released, speed = ref.spring_release(*spring_data, spring.stroke, spring.damping)
        after = run.t > released
        x[after], v[after] = spring.stroke + speed * (run.t[after] - released), speed
    lines = [worst(case, "extension, m", x, 1e-3 * run.history["separation_distance_mm"])]
    lines.append(worst(case, "separation speed, m/s", v, run.history["separation_speed_m_s"]))
    for body, other_mass in (("fore", mass[1]), ("aft", -mass[0])):
        lines.append(
            worst(
                case,
                f"speed of the {body} body, m/s",
                v * other_mass / sum(mass),
                run.body(body).v[:, 0],
            )
        )
    return lines


def thrust_slider() -> list[Line]:
    """Check a slider along which motors drive both bodies apart: gap and its rate, with constant
    thrust, build-up and tail-off, and the release time with constant thrust."""
    motors = [f"motor.{name}" for name in ("ahead", "retro")]
    ending = {f"{motor}.burn_s": 0.3 for motor in motors} | {
        f"{motor}.tail_off_s": 0.1 for motor in motors
    }
    lines = []
    for case, settings in (
        ("thrust on a slider", {}),
        ("thrust with build-up", {f"{motor}.build_up_s": 0.1 for motor in motors}),
        ("thrust with tail-off", ending),
    ):
        run = NominalRun(campaign("thrust_slider", settings))
        motor = run.scene.motor[0]
        acceleration = sum(m.thrust / run.scene.body[m.body].mass for m in run.scene.motor)  # m/s2
        if motor.tail_off:
            gap, rate = ref.burn_gap(run.t, acceleration, motor.burn, motor.tail_off)
        else:
            gap, rate = ref.thrust_gap(run.t, acceleration, motor.build_up)
        joined = run.phase == "guided"
        lines.append(
            worst(case, "gap, m", gap[joined], 1e-3 * run.history["separation_distance_mm"][joined])
        )
        lines.append(worst(case, "rate of the gap, m/s", rate, run.history["separation_speed_m_s"]))
        if not settings:
            release = math.sqrt(2.0 * 0.37 / acceleration)  # stroke of the file
            lines.append(worst(case, "release, s", release, run.outcomes["release_time_s"]))
    return lines


def rail() -> list[Line]:
    """Check the tip-off of a rocket, which turns about its rear shoe under gravity after the front
    shoe has left the rail: release time of the rear shoe, and pitch and rate then and at the
    end."""
    run, case = NominalRun(campaign("rail")), "tip-off from a rail"
    scene = run.scene
    body, motor, g, elevation = (
        scene.body["rocket"],
        scene.motor[0],
        scene.environment.surface_gravity,
        scene.initial.pitch,
    )
    first, second = (
        phase.until.stroke for phase in scene.phase[:2] if phase.until and phase.until.stroke
    )
    driven = motor.thrust / body.mass - g * math.sin(elevation)
    at_burnout = driven * motor.burn
    coast = first - 0.5 * driven * motor.burn**2
    speed = math.sqrt(at_burnout**2 - 2.0 * g * math.sin(elevation) * coast)
    leaves = motor.burn + 2.0 * coast / (at_burnout + speed)
    ahead, above, _ = -arm(scene, "rocket", scene.joint["shoe"].point)
    tip = ref.tip_off(
        body.mass, tensor(scene, "rocket")[2, 2], ahead, above, g, elevation, speed, second - first
    )
    release, rate = leaves + tip.time, math.degrees(tip.rate)
    pitch = math.degrees(elevation + tip.angle)
    lines = [
        worst(case, quantity, expected, run.outcomes[column])
        for quantity, expected, column in (
            ("release, s", release, "release_time_s"),
            ("rate at release, deg/s", rate, "shoe_tip_off_rocket_z_deg_s"),
            ("rate at the end, deg/s", rate, "rocket_omega_z_deg_s"),
            (
                "pitch at the end, deg",
                pitch + rate * (scene.run.end_time - release),
                "rocket_pitch_deg",
            ),
        )
    ]
    last = run.history["rocket_pitch_deg"][run.phase == "pivot"].iloc[-1]
    return [*lines, worst(case, "pitch at release, deg", pitch, float(last))]
