"""The engine against the closed forms of `sepmc.validation.references`."""

import math

import numpy as np

from sepmc.validation import references as ref
from sepmc.validation.flights import NominalFlight, arm, campaign, tensor
from sepmc.validation.line import Line, worst

LBF, FT = 4.4482216152605, 0.3048
# Rates (rad/s) of free_body.toml by branch of the solution; the last sets out along the middle axis
# and turns over.
TOPS = {
    "about the least axis": [1.6, 0.2, -0.1],
    "about the greatest axis": [0.2, 0.3, 1.4],
    "turning over": None,
}


def free_body() -> list[Line]:
    """Euler's equations of a body without symmetry, in both branches and turning over near the
    separatrix between them."""
    lines = []
    for name, rates in TOPS.items():
        flown = campaign("free_body")
        inertia = tensor(flown.scene, "stone")
        if rates is None:
            axes = np.linalg.eigh(inertia)[1]
            rates = (1.8 * axes[:, 1] + 1e-3 * axes[:, 0]).tolist()
        found = NominalFlight(flown.with_settings({"initial.omega_rad_s": rates}), 0.05)
        w, r = ref.asymmetric_top(found.t, inertia, rates)
        stone, case = found.body("stone"), f"free body {name}"
        lines += [
            worst(case, "rate, rad/s", w, stone.w),
            worst(case, "attitude matrix", r, stone.r),
        ]
    return lines


def _welded(found: NominalFlight, joint: str, case: str) -> list[Line]:
    """Rates, attitude and the joint's wrench of two welded bodies against those of the
    composite."""
    scene = found.scene
    first, second = scene.joint[joint].bodies
    # from the joint point
    places = [-arm(scene, body, scene.joint[joint].point) for body in (first, second)]
    masses, tensors = (
        [scene.body[b].mass for b in (first, second)],
        [tensor(scene, b) for b in (first, second)],
    )
    whole = ref.composite(masses, tensors, places)
    w, r = ref.asymmetric_top(found.t, whole.inertia, scene.initial.omega)
    body = found.body(second)
    force, moment = ref.weld_wrench(whole, masses[1], tensors[1], places[1], np.zeros(3), w)
    return [
        worst(case, "rate, rad/s", w, body.w),
        worst(case, "attitude matrix", r, body.r),
        worst(
            case, f"force on {second}, N", force, found.columns(f"{joint}_force_on_{second}_*_N")
        ),
        worst(
            case,
            f"moment on {second}, N m",
            moment,
            found.columns(f"{joint}_moment_on_{second}_*_N_m"),
        ),
    ]


def welded() -> list[Line]:
    """Two lopsided bodies in a fixed joint are one rigid body."""
    return _welded(NominalFlight(campaign("welded"), 0.05), "weld", "welded pair")


def nasa_boxes() -> list[Line]:
    """NASA/TP-2016-219326 test case 1: the closed form, and the digits of an independent solution
    with 24 unknowns (half a last unit)."""
    case, found = "NASA boxes", NominalFlight(campaign("nasa_boxes"), 0.05)
    lines = _welded(found, "face", case)
    for axis, value, digits in zip(
        "xyz", (0.43643767, 1.04653498, -0.07596399), found.body("B").w[-1], strict=True
    ):
        lines.append(Line(case, f"rate at 10 s, {axis}, rad/s", value, float(digits), 5e-9))
    force, moment = (
        found.columns("face_force_on_B_*_N")[0] / LBF,
        found.columns("face_moment_on_B_*_N_m")[0] / (LBF * FT),
    )
    for axis, value, digits in zip("xyz", (-1.09, 0.0754717, -0.006), force, strict=True):
        lines.append(Line(case, f"force on B at 0 s, {axis}, lbf", value, float(digits), 5e-8))
    for axis, value, digits in zip("xyz", (0.0, -0.003, -0.0377358), moment, strict=True):
        lines.append(Line(case, f"moment on B at 0 s, {axis}, lbf ft", value, float(digits), 5e-8))
    return lines


def pushed_apart() -> list[Line]:
    """A linear spring between two free bodies: all along its push, and with a stroke limit, where
    momentum and energy give the speeds."""
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
        lines += _pushed(NominalFlight(campaign("pushed_apart", settings)), case)
    return lines


def _pushed(found: NominalFlight, case: str) -> list[Line]:
    """Extension of the spring and speeds of the bodies."""
    spring, mass = found.scene.spring[0], [found.scene.body[b].mass for b in ("fore", "aft")]
    law = ref.reduced_mass(*mass), spring.force, spring.stiffness
    x, v = ref.spring_extension(found.t, *law, spring.damping)
    if math.isfinite(spring.stroke):
        released, speed = ref.spring_release(*law, spring.stroke, spring.damping)
        after = found.t > released
        x[after], v[after] = spring.stroke + speed * (found.t[after] - released), speed
    lines = [worst(case, "extension, m", x, 1e-3 * found.history["separation_distance_mm"])]
    lines.append(worst(case, "speed apart, m/s", v, found.history["separation_speed_m_s"]))
    for body, share in (("fore", mass[1]), ("aft", -mass[0])):
        lines.append(
            worst(
                case,
                f"speed of the {body} body, m/s",
                v * share / sum(mass),
                found.body(body).v[:, 0],
            )
        )
    return lines


def thrust_slider() -> list[Line]:
    """Thrust along a slider that accelerates both bodies: gap and rate, with build-up and tail-off,
    and the time of release."""
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
        found = NominalFlight(campaign("thrust_slider", settings))
        motor = found.scene.motor[0]
        apart = sum(m.thrust / found.scene.body[m.body].mass for m in found.scene.motor)  # m/s2
        if motor.tail_off:
            gap, rate = ref.burn_gap(found.t, apart, motor.burn, motor.tail_off)
        else:
            gap, rate = ref.thrust_gap(found.t, apart, motor.build_up)
        held = found.phase == "guided"
        lines.append(
            worst(case, "gap, m", gap[held], 1e-3 * found.history["separation_distance_mm"][held])
        )
        lines.append(
            worst(case, "rate of the gap, m/s", rate, found.history["separation_speed_m_s"])
        )
        if not settings:
            release = math.sqrt(2.0 * 0.37 / apart)  # the stroke in the file
            lines.append(worst(case, "release, s", release, found.outcomes["release_time_s"]))
    return lines


def rail() -> list[Line]:
    """Tip-off: a rocket turns about its rear shoe on gravity from where the front one has left the
    rail until the rear one does."""
    found, case = NominalFlight(campaign("rail")), "tip-off from a rail"
    scene = found.scene
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
        worst(case, quantity, expected, found.outcomes[column])
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
    last = found.history["rocket_pitch_deg"][found.phase == "pivot"].iloc[-1]
    return [*lines, worst(case, "pitch at release, deg", pitch, float(last))]
