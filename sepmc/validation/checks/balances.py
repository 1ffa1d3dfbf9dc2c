"""What every motion must obey, whatever the formulation: joints do no work; momentum, angular
momentum and energy are kept."""

import numpy as np
from scipy.integrate import simpson

from sepmc.validation.checks.kinds import KINDS, flight_of
from sepmc.validation.flights import Array, NominalFlight, arm, campaign, tensor, to_ground
from sepmc.validation.line import Line, worst

ROUND_OFF = 1e-11  # relative to the largest of the terms that cancel


def no_work() -> list[Line]:
    """Power of the wrench of an ideal joint on its two bodies together, F . v(r) + M . w summed,
    relative to its largest term."""
    lines = []
    for kind in KINDS:
        found = flight_of(kind)
        terms = []
        for body, point in zip(("fore", "aft"), _ends(found), strict=True):
            track, lever = found.body(body), arm(found.scene, body, point)
            force, moment = found.wrench("link", body)
            omega = to_ground(track.r, track.w)
            speed = track.v + np.cross(omega, to_ground(track.r, lever))
            terms += [np.sum(force * speed, axis=1), np.sum(moment * omega, axis=1)]
        power, largest = np.sum(terms, axis=0), float(np.max(np.abs(terms)))
        nothing = np.zeros_like(power)
        lines.append(
            worst(
                f"work of {kind}", "power of the joint, W", nothing, power, ROUND_OFF, size=largest
            )
        )
    return lines


def _ends(found: NominalFlight) -> tuple:
    joint = found.scene.joint["link"]
    return joint.point, joint.second_point or joint.point


class _Sums:
    """Momentum, angular momentum about the origin and kinetic energy of all bodies over time."""

    def __init__(self, found: NominalFlight):
        self.momentum, self.spin, self.energy = (
            np.zeros((len(found.t), 3)),
            np.zeros((len(found.t), 3)),
            np.zeros(len(found.t)),
        )
        for name, body in found.scene.body.items():
            x, v, r, w = found.body(name)
            own = w @ tensor(found.scene, name)
            self.momentum += body.mass * v
            self.spin += body.mass * np.cross(x, v) + to_ground(r, own)
            self.energy += 0.5 * body.mass * np.sum(v * v, axis=1) + 0.5 * np.sum(w * own, axis=1)


def _gained(found: NominalFlight, rate: Array) -> Array:
    """Integral of a rate over the flight: Simpson's rule on each phase, whose rows are 1 ms
    apart."""
    return sum(
        simpson(rate[found.phase == phase], x=found.t[found.phase == phase], axis=0)
        for phase in dict.fromkeys(found.phase)
    )


def _thrust(found: NominalFlight) -> tuple[Array, Array, Array]:
    """Force, moment about the origin and power of all motors, ground axes. The thrust is
    constant."""
    force, moment, power = (
        np.zeros((len(found.t), 3)),
        np.zeros((len(found.t), 3)),
        np.zeros(len(found.t)),
    )
    for motor in found.scene.motor:
        cant, clock, (dy, dz) = motor.cant, motor.clock, motor.offset
        # CONVENTIONS.md, Motor
        along = np.array(
            [np.cos(cant), -np.sin(clock) * np.sin(cant), np.cos(clock) * np.sin(cant)]
        )
        lever = arm(
            found.scene,
            motor.body,
            (motor.station, -motor.radius * np.sin(clock) + dy, motor.radius * np.cos(clock) + dz),
        )
        x, v, r, w = found.body(motor.body)
        push, out = to_ground(r, motor.thrust * along), to_ground(r, lever)
        force, moment = force + push, moment + np.cross(x + out, push)
        power += np.sum(push * (v + np.cross(to_ground(r, w), out)), axis=1)
    return force, moment, power


def _springs(found: NominalFlight) -> tuple[Array, Array]:
    """Energy stored in all springs since the start, and the power of their dampers."""
    stored, lost = np.zeros(len(found.t)), np.zeros(len(found.t))
    for spring in found.scene.spring:
        a, b = (found.body(name) for name in spring.bodies)
        out_a, out_b = (
            to_ground(track.r, arm(found.scene, name, point))
            for track, name, point in zip(
                (a, b),
                spring.bodies,
                (spring.point, spring.second_point or spring.point),
                strict=True,
            )
        )
        d = b.x + out_b - a.x - out_a
        d_rate = (
            b.v + np.cross(to_ground(b.r, b.w), out_b) - a.v - np.cross(to_ground(a.r, a.w), out_a)
        )
        if spring.axis is None:
            length = np.linalg.norm(d, axis=1)
            extension, rate = length, np.sum(d * d_rate, axis=1) / length
        else:
            e = to_ground(a.r, np.asarray(spring.axis) / np.linalg.norm(spring.axis))
            extension = np.sum(d * e, axis=1)
            rate = np.sum(d_rate * e, axis=1) + np.sum(d * np.cross(to_ground(a.r, a.w), e), axis=1)
        extension = extension - extension[0]
        stored -= (spring.force - 0.5 * spring.stiffness * extension) * extension
        lost += spring.damping * rate**2
    return stored, lost


def balance() -> list[Line]:
    """Three bodies, a ball joint, a slider that lets go, two springs, two motors: impulse, moment
    and work of thrust account for all."""
    lines = []
    for case, settings in (
        ("chain with springs", {"motor.ahead.thrust_N": 0.0, "motor.retro.thrust_N": 0.0}),
        ("chain with springs and motors", {}),
        (
            "chain with dampers and motors",
            {"spring.pusher.damping_N_s_per_m": 3.0, "spring.strap.damping_N_s_per_m": 2.0},
        ),
    ):
        found = NominalFlight(campaign("chain", settings), 0.001)
        sums, (force, moment, power), (stored, lost) = _Sums(found), _thrust(found), _springs(found)
        momentum, spin, energy = (
            sums.momentum[0] + _gained(found, force),
            sums.spin[0] + _gained(found, moment),
            sums.energy + stored,
        )
        largest = max(
            float(np.abs(body.mass * found.body(name).v).max())
            for name, body in found.scene.body.items()
        )
        turning = float(np.abs(sums.spin).max())
        lines.append(
            worst(case, "momentum at the end, kg m/s", momentum, sums.momentum[-1], size=largest)
        )
        lines.append(
            worst(case, "angular momentum at the end, kg m2/s", spin, sums.spin[-1], size=turning)
        )
        lines.append(
            worst(
                case, "energy at the end, J", energy[0] + _gained(found, power - lost), energy[-1]
            )
        )
    return lines
