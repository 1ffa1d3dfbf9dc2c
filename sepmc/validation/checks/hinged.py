"""Checks on pendulums, tops and shafts on joints to the ground against the closed forms of
`sepmc.validation.references`."""

import math

import numpy as np

from sepmc.validation import references as ref
from sepmc.validation.flights import NominalRun, arm, campaign, tensor, to_ground
from sepmc.validation.line import Line, worst


def pendulum() -> list[Line]:
    """Check a body without symmetry on a revolute joint, swinging and circling: attitude, rate,
    force and moment of the hinge, and the period of the swing."""
    lines = []
    for case, rate in (("physical pendulum", 0.0), ("pendulum over the top", 9.0)):
        run = NominalRun(campaign("pendulum", {"initial.omega_rad_s": [0.0, 0.0, rate]}))
        scene, bob = run.scene, run.body("bob")
        mass, g, inertia = (
            scene.body["bob"].mass,
            scene.environment.surface_gravity,
            tensor(scene, "bob"),
        )
        to_centre = -arm(scene, "bob", scene.joint["hinge"].point)
        length = math.hypot(to_centre[0], to_centre[1])
        frequency = math.sqrt(mass * g * length / (inertia[2, 2] + mass * length**2))
        # pitch at which the mass centre hangs straight down
        hang = -0.5 * math.pi - math.atan2(to_centre[1], to_centre[0])
        start = math.remainder(scene.initial.pitch - hang, 2.0 * math.pi)
        angle, turning = ref.pendulum(run.t, frequency, start, rate)
        lines.append(worst(case, "attitude matrix", ref.turn(2, angle + hang), bob.r))
        lines.append(worst(case, "rate, rad/s", turning, bob.w[:, 2]))
        wrench = [
            ref.hinge_wrench(
                mass, inertia, to_centre, w, -(frequency**2) * math.sin(a), -mass * g * r[1]
            )
            for a, w, r in zip(angle, turning, ref.turn(2, angle + hang), strict=True)
        ]
        force, moment = (np.array(part) for part in zip(*wrench, strict=True))
        lines.append(
            worst(case, "force of the hinge, N", force, run.columns("hinge_force_on_bob_*_N"))
        )
        lines.append(
            worst(
                case, "moment of the hinge, N m", moment, run.columns("hinge_moment_on_bob_*_N_m")
            )
        )
        if rate == 0.0:
            period = ref.pendulum_period(frequency, start)
            last = float(
                NominalRun(campaign("pendulum", {"run.end_time_s": period}), period)
                .body("bob")
                .w[-1, 2]
            )
            # Newton's step to where the rate vanishes
            measured = period + last / (frequency**2 * math.sin(start))
            lines.append(worst(case, "period, s", period, measured))
    return lines


def _started_top(pitch: float, spin: float, precession: float) -> NominalRun:
    """Run of top.toml, started with a pitch, rad, a ``spin``, which is the whole component of the
    angular rate along the axis of the top, rad/s, and a ``precession``, the rate at which that axis
    turns about the upward vertical, rad/s.

    The axis, from the ball to the mass centre, is body -x; the upward vertical in body axes is
    (sin, cos, 0) of the pitch.
    """
    rates = [-spin, precession * math.cos(pitch), 0.0]
    return NominalRun(
        campaign("top", {"initial.pitch_deg": math.degrees(pitch), "initial.omega_rad_s": rates})
    )


def top() -> list[Line]:
    """Check a symmetric body on a spherical joint: tilt and spin of a nutating top and of a
    spherical pendulum, and the direction of the axis in steady precession of both."""
    scene = campaign("top").scene
    g, length, mass = (
        scene.environment.surface_gravity,
        float(arm(scene, "top", scene.joint["ball"].point)[0]),
        scene.body["top"].mass,
    )
    axial, across, _ = scene.body["top"].inertia
    top_data = axial, across + mass * length**2, mass * g * length
    lines = []
    for case, degrees, spin, precession in (
        ("spherical pendulum", 50.0, 0.0, 2.5),
        ("top, nutating", -40.0, 90.0, 1.0),
    ):
        pitch = math.radians(degrees)
        run = _started_top(pitch, spin, precession)
        body = run.body("top")
        tilt = ref.heavy_top(run.t, *top_data, 0.5 * math.pi + pitch, spin, precession)
        lines.append(worst(case, "cosine of the tilt", tilt, -body.r[:, 1, 0]))
        lines.append(worst(case, "spin, rad/s", spin, -body.w[:, 0], size=precession))
    for case, degrees, spin, root in (
        ("conical pendulum", 50.0, 0.0, 0),
        ("top, slow precession", -40.0, 90.0, 0),
        ("top, fast precession", -40.0, 90.0, 1),
    ):
        pitch = math.radians(degrees)
        precession = ref.steady_precession(*top_data, 0.5 * math.pi + pitch, spin)[root]
        run = _started_top(pitch, spin, precession)
        azimuth = precession * run.t  # about the upward vertical, from x toward -z
        level = [np.cos(azimuth), np.zeros_like(azimuth), -np.sin(azimuth)]
        axis = np.cos(pitch) * np.stack(level, axis=1) + np.sin(pitch) * np.array([0.0, 1.0, 0.0])
        lines.append(worst(case, "direction of the axis", axis, run.body("top").r[:, :, 0]))
    return lines


def rod_pendulum() -> list[Line]:
    """Check a body hung by its mass centre on a rod: position and tension of the simple pendulum,
    position of the conical pendulum, no moment of the rod, and free rotation of the body."""
    scene = campaign("rod_pendulum").scene
    mass, g, length = (
        scene.body["bob"].mass,
        scene.environment.surface_gravity,
        scene.body["bob"].cg[0],
    )
    # from hanging, backward
    frequency, start = math.sqrt(g / length), 0.5 * math.pi - scene.initial.pitch
    case, run = "rod pendulum", NominalRun(campaign("rod_pendulum"))
    angle, rate = ref.pendulum(run.t, frequency, start)
    position = length * np.stack([-np.sin(angle), -np.cos(angle), np.zeros_like(angle)], axis=1)
    moved = run.body("bob").x
    lines = [worst(case, "position, m", position - position[0], moved - moved[0])]
    force, moment = run.wrench("rod", "bob")
    tension = mass * (length * rate**2 + g * np.cos(angle))
    lines.append(worst(case, "tension, N", tension[:, None] * -position / length, force))
    lines.append(
        worst(
            case,
            "moment of the rod, N m",
            np.zeros_like(moment),
            moment,
            size=length * float(tension.max()),
        )
    )
    pitch = math.radians(50.0)
    around = ref.conical_rate(length, g, 0.5 * math.pi - pitch)
    rates = np.array([math.sin(pitch), math.cos(pitch), 0.0]) * around
    run = NominalRun(
        campaign("rod_pendulum", {"initial.pitch_deg": 50.0, "initial.omega_rad_s": rates.tolist()})
    )
    azimuth, bob = around * run.t, run.body("bob")
    position = length * np.stack(
        [
            -np.cos(pitch) * np.cos(azimuth),
            np.full_like(azimuth, -np.sin(pitch)),
            np.cos(pitch) * np.sin(azimuth),
        ],
        axis=1,
    )
    lines.append(
        worst("conical rod pendulum", "position, m", position - position[0], bob.x - bob.x[0])
    )
    w, _ = ref.asymmetric_top(run.t, tensor(scene, "bob"), rates)
    return [*lines, worst("conical rod pendulum", "rate of the bob, rad/s", w, bob.w)]


def hooke() -> list[Line]:
    """Check a universal joint between two shafts in bearings, a closed loop through the ground:
    attitude and rate of the driven shaft, and the kinetic energy of both shafts, as functions of
    the angle of the driving shaft."""
    case, bend, run = "Hooke's joint", math.radians(40.0), NominalRun(campaign("hooke"))
    driving, driven = run.body("driving"), run.body("driven")
    angle = np.radians(run.history["driving_roll_deg"].to_numpy())
    shaft = np.array([math.cos(bend), math.sin(bend), 0.0])
    # The driving fork's pin, z, stands across the plane of the shafts at the start.
    expected = ref.rotation(shaft, ref.hooke_angle(angle, bend))
    rate = ref.hooke_ratio(angle, bend) * driving.w[:, 0]
    lines = [worst(case, "attitude of the driven shaft", expected, driven.r)]
    driven_rate = rate[:, None] * shaft
    lines.append(
        worst(case, "rate of the driven shaft, rad/s", driven_rate, to_ground(driven.r, driven.w))
    )
    work = 0.2 * angle  # work of the moment on the first shaft
    energy = (
        0.5 * np.einsum("ni,ij,nj->n", driven.w, tensor(run.scene, "driven"), driven.w)
        + 0.5 * 0.02 * driving.w[:, 0] ** 2
    )
    return [*lines, worst(case, "energy, J", work, energy)]
