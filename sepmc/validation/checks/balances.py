"""Checks on conservation laws, which hold in every formulation: joints do no work; momentum,
angular momentum and energy are conserved."""

import numpy as np
from scipy.integrate import simpson

from sepmc.validation.checks.kinds import KINDS, nominal_run
from sepmc.validation.flights import Array, NominalRun, arm, campaign, tensor, to_ground
from sepmc.validation.line import Line, worst

ROUND_OFF = 1e-11  # relative to the largest cancelling term


def no_work() -> list[Line]:
    """Check that an ideal joint does no work, one line for each joint kind: in all rows of a
    simulated run (`nominal_run`) the power of its forces and moments on its two bodies, the sum of
    F . v + M . w, is zero relative to the largest term of the sum."""
    lines = []
    for kind in KINDS:
        run = nominal_run(kind)
        terms = []
        for body, point in zip(("fore", "aft"), _ends(run), strict=True):
            track, lever = run.body(body), arm(run.scene, body, point)
            force, moment = run.wrench("link", body)
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


def _ends(run: NominalRun) -> tuple:
    """Layout points of the joint ``link``, m, on its first and second body; they are equal except
    for a rod."""
    joint = run.scene.joint["link"]
    return joint.point, joint.second_point or joint.point


class _Sums:
    """Sums over all bodies in the n rows of a run, ground axes: ``momentum`` (n, 3), kg m/s;
    angular momentum about the origin, ``spin`` (n, 3), kg m2/s; kinetic ``energy`` (n,), J."""

    def __init__(self, run: NominalRun):
        self.momentum, self.spin, self.energy = (
            np.zeros((len(run.t), 3)),
            np.zeros((len(run.t), 3)),
            np.zeros(len(run.t)),
        )
        for name, body in run.scene.body.items():
            x, v, r, w = run.body(name)
            spin_of_body = w @ tensor(run.scene, name)
            self.momentum += body.mass * v
            self.spin += body.mass * np.cross(x, v) + to_ground(r, spin_of_body)
            self.energy += 0.5 * body.mass * np.sum(v * v, axis=1) + 0.5 * np.sum(
                w * spin_of_body, axis=1
            )


def _integral(run: NominalRun, rate: Array) -> Array:
    """Integral over the whole run of a rate (n,) or (n, 3), given in the rows of the run: a number
    or (3,), by Simpson's rule on each phase. The rows must be close, as with 1 ms."""
    return sum(
        simpson(rate[run.phase == phase], x=run.t[run.phase == phase], axis=0)
        for phase in dict.fromkeys(run.phase)
    )


def _thrust(run: NominalRun) -> tuple[Array, Array, Array]:
    """Force (n, 3), N, moment about the origin (n, 3), N m, and power (n,), W, of all motors in the
    n rows of a run, ground axes. Each motor has its full thrust all the time: ignition, profile,
    build-up, burn time, tail-off and deflection are not considered."""
    force, moment, power = (
        np.zeros((len(run.t), 3)),
        np.zeros((len(run.t), 3)),
        np.zeros(len(run.t)),
    )
    for motor in run.scene.motor:
        cant, clock, (dy, dz) = motor.cant, motor.clock, motor.offset
        # CONVENTIONS.md, Motor
        direction = np.array(
            [np.cos(cant), -np.sin(clock) * np.sin(cant), np.cos(clock) * np.sin(cant)]
        )
        lever = arm(
            run.scene,
            motor.body,
            (motor.station, -motor.radius * np.sin(clock) + dy, motor.radius * np.cos(clock) + dz),
        )
        x, v, r, w = run.body(motor.body)
        push, out = to_ground(r, motor.thrust * direction), to_ground(r, lever)
        force, moment = force + push, moment + np.cross(x + out, push)
        power += np.sum(push * (v + np.cross(to_ground(r, w), out)), axis=1)
    return force, moment, power


def _springs(run: NominalRun) -> tuple[Array, Array]:
    """Energy stored in all springs since the start, (n,), J, and power lost in their dampers, (n,),
    W, in the n rows of a run. A spring that has pushed has less energy: below 0. Tables, factors,
    strokes and ``push_only`` of springs are not considered."""
    stored, lost = np.zeros(len(run.t)), np.zeros(len(run.t))
    for spring in run.scene.spring:
        a, b = (run.body(name) for name in spring.bodies)
        out_a, out_b = (
            to_ground(track.r, arm(run.scene, name, point))
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
    """Check the balance of momentum, angular momentum and energy at the end of chain.toml (three
    bodies on a ball joint and a slider that is released, with two springs and two motors) against
    impulse, moment and work of the thrust. The energy includes that stored in the springs; the work
    is less what the dampers take.

    The three cases are springs alone, with motors, and with motors and dampers.
    """
    lines = []
    for case, settings in (
        ("chain with springs", {"motor.ahead.thrust_N": 0.0, "motor.retro.thrust_N": 0.0}),
        ("chain with springs and motors", {}),
        (
            "chain with dampers and motors",
            {"spring.pusher.damping_N_s_per_m": 3.0, "spring.strap.damping_N_s_per_m": 2.0},
        ),
    ):
        run = NominalRun(campaign("chain", settings), 0.001)
        sums, (force, moment, power), (stored, lost) = _Sums(run), _thrust(run), _springs(run)
        momentum, spin, energy = (
            sums.momentum[0] + _integral(run, force),
            sums.spin[0] + _integral(run, moment),
            sums.energy + stored,
        )
        largest = max(
            float(np.abs(body.mass * run.body(name).v).max())
            for name, body in run.scene.body.items()
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
                case, "energy at the end, J", energy[0] + _integral(run, power - lost), energy[-1]
            )
        )
    return lines
