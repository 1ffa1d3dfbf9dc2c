"""Stresses of fast rotation, of steps of every length, and of angles beyond half a turn. Every
stress is a function that simulates such cases and returns their judged lines."""

import math

import numpy as np

from sepmc.validation import references as ref
from sepmc.validation.flights import NominalRun, arm, tensor
from sepmc.validation.stresses.line import (
    EXACT,
    FORM,
    Bound,
    Stress,
    beyond,
    judge,
    promised,
    relative,
)
from sepmc.validation.stresses.scenes import (
    AFT,
    OMEGA,
    Composite,
    body,
    joint,
    pair,
    phase_of,
    scene,
    simulate,
)

STONE = body(1.0, [1.0, 2.0, 2.2], [1.0, 0.0, 0.0], [0.2, -0.1, 0.15])


def _tumbling(deg_s: float, step: float, steps: int) -> NominalRun:
    """Run of a weld of two bodies without symmetry that tumbles at a rate, deg/s, for ``steps``
    steps of ``step``, s."""
    rate = np.array(OMEGA) / np.linalg.norm(OMEGA) * math.radians(deg_s)
    return simulate(pair("fixed", end=steps * step, step=step, omega=rate.tolist()), 10)


def resolved_spins() -> list[Stress]:
    """Lines of `sepmc stress` on a weld tumbling at 0 to 1e5 deg/s for 200 steps of a tenth of a
    radian, or of 0.05 s where that is shorter: rates and attitude against closed forms, which must
    be accurate."""
    lines = []
    for deg_s in (0.0, 1e-6, 1e-3, 1.0, 1e2, 1e3, 1e4, 1e5):
        run = _tumbling(deg_s, min(0.05, 0.1 / max(math.radians(deg_s), 1e-9)), 200)
        label, composite = (
            f"weld at {deg_s:g} deg/s, resolved",
            Composite(run, "aft", [2.0, 0.1, 0.0]),
        )
        rate = relative(run.body("aft").w, composite.rate, 1e-300)
        lines.append(judge(label, "rate", rate, FORM, run, resolved=True))
        lines.append(judge(label, "attitude", composite.attitude_error(), FORM, run, resolved=True))
    return lines


def long_steps() -> list[Stress]:
    """Lines of `sepmc stress` on the attitude in steps of 0.05 s in which the bodies turn by up to
    87 rad: each must be flagged, unless its error is within the bound that status ok promises
    (`promised`)."""
    lines = []
    for turn in (0.2, 0.5, 0.8, 1.1, 1.2, 1.3, 1.4, 1.5, 2.0, 4.0, 8.0, 20.0, 87.3):
        run = _tumbling(math.degrees(turn / 0.05), 0.05, 100)
        composite = Composite(run, "aft", [2.0, 0.1, 0.0])
        lines.append(
            judge(
                f"weld tumbling {turn:g} rad a step",
                "attitude",
                composite.attitude_error(),
                promised(100),
                run,
            )
        )
    for turn in (0.5, 1.1, 1.5, 2.0, 2.3, 2.6, 3.0, 4.0, 2.0 * math.pi, 20.0, 87.3):
        rate = turn / 0.05
        run = simulate(
            scene(
                {"stone": body(1.0, [1.0, 2.0, 2.0], [1.0, 0.0, 0.0])},
                {},
                [{"name": "free"}],
                10.0,
                0.05,
                [rate, 0.0, 0.0],
            ),
            10,
        )
        error = relative(run.body("stone").r, ref.turn(0, rate * run.t))
        lines.append(
            judge(f"steady spin, {turn:.3g} rad a step", "attitude", error, promised(200), run)
        )
    return lines


def step_lengths() -> list[Stress]:
    """Lines of `sepmc stress` on attitude and force of a weld tumbling at 1.2 rad/s in steps from 1
    us to 1 s; up to 0.1 s they must be accurate."""
    lines = []
    for step in (1e-6, 1e-5, 1e-4, 1e-3, 1e-2, 0.1, 0.3, 1.0):
        steps = 10_000 if step < 1e-3 else max(20, round(1.0 / step))
        run = simulate(pair("fixed", end=steps * step, step=step), 10)
        composite = Composite(run, "aft", [2.0, 0.1, 0.0])
        bound = FORM if step <= 0.1 else promised(steps)
        for quantity, error in (
            ("attitude", composite.attitude_error()),
            ("force", composite.force_error()),
        ):
            lines.append(
                judge(f"step of {step:g} s", quantity, error, bound, run, resolved=step <= 0.1)
            )
    return lines


def hinged_steps() -> list[Stress]:
    """Lines of `sepmc stress` on rate and pitch of a pendulum in steps from 1 ms to 1 s, a quarter
    of its period, against elliptic functions; up to 10 ms they must be accurate."""
    lines = []
    for step in (1e-3, 1e-2, 0.1, 0.3, 1.0):
        bob = AFT | {"cg_m": [1.0, 0.0, 0.0]}
        tree = scene({"bob": bob}, {"hinge": joint("ground", "bob", [0.0, 0.0, 0.0], x_axis=[0.0,
        0.0, 1.0])}, phase_of(hinge="revolute"),
                     40.0 * min(step, 0.25), step, environment={"gravity": "constant"},
                     initial={"pitch_deg": 10.0})  # fmt: skip
        run = simulate(tree, 10)
        length = float(np.linalg.norm(arm(run.scene, "bob", [0.0, 0.0, 0.0])))
        inertia = tensor(run.scene, "bob")[2, 2] + length**2
        angle, rate = ref.pendulum(
            run.t,
            math.sqrt(run.scene.environment.surface_gravity * length / inertia),
            math.radians(10.0 - 90.0),
        )
        bound = FORM if step <= 0.01 else promised(run.outcomes["steps"])
        lines.append(
            judge(
                f"pendulum, step of {step:g} s",
                "rate",
                relative(run.body("bob").w[:, 2], rate),
                bound,
                run,
                step <= 0.01,
            )
        )
        pitch = np.radians(run.history["bob_pitch_deg"]) - 0.5 * math.pi
        lines.append(
            judge(
                f"pendulum, step of {step:g} s",
                "pitch",
                relative(pitch, angle),
                bound,
                run,
                step <= 0.01,
            )
        )
    return lines


def _judge_angles(
    label: str, error: float, bound: Bound, run: NominalRun, resolved: bool = False
) -> Stress:
    """Line of `sepmc stress` on angles of the history, as `judge` makes it from the same arguments;
    ``attitude_singular`` = 1 counts as a flag too, as the angles may have jumped."""
    flags = beyond(run.outcomes) + (
        ("attitude_singular",) if run.outcomes["attitude_singular"] == 1.0 else ()
    )
    return Stress(label, "reported angle", error, bound, run.status, flags, resolved)


def angles() -> list[Stress]:
    """Lines of `sepmc stress` on the angles of a steadily turning body: pitch and roll are
    continuous through 90 deg, half a turn and many turns; through yaw = 90 deg they jump, which
    must be flagged."""
    lines = []
    round_stone = {"stone": body(1.0, [2.0, 2.0, 2.0], [1.0, 0.0, 0.0])}
    for name, axis, rate in (
        ("pitch", 2, 3.0),
        ("pitch", 2, -3.0),
        ("roll", 0, 3.0),
        ("roll", 0, -3.0),
        ("yaw", 1, 3.0),
        ("yaw", 1, -3.0),
    ):
        omega = [0.0, 0.0, 0.0]
        omega[axis] = rate
        run = simulate(scene(round_stone, {}, [{"name": "free"}], 10.0, 0.05, omega), 400)
        angle_columns = run.history[f"stone_{name}_deg"].to_numpy()
        error = relative(angle_columns, np.degrees(rate * run.t))
        lines.append(
            _judge_angles(
                f"{name} through {math.degrees(rate * 10.0):.0f} deg",
                error,
                FORM,
                run,
                name != "yaw",
            )
        )
        error = relative(run.body("stone").r, ref.turn(axis, rate * run.t))
        # asin loses half of the digits at yaw = 90 deg
        bound = FORM if name != "yaw" else Bound(1e-7, "sqrt(eps): asin at 90 deg")
        lines.append(
            judge(
                f"{name} through {math.degrees(rate * 10.0):.0f} deg",
                "attitude by angles",
                error,
                bound,
                run,
                True,
            )
        )
        if name == "yaw":
            error = 1.0 - run.outcomes["attitude_singular"]
            lines.append(
                judge("yaw through 90 deg", "attitude_singular flagged", error, EXACT, run, True)
            )
    return lines


def angles_at_long_steps() -> list[Stress]:
    """Lines of `sepmc stress`, one for each of 12 rates, on pitch and roll, deg, of random
    tumbling at 0.1 to 1.3 rad in a step of 0.05 s: at all rows of the history they must agree
    within 1 deg with those in steps of 5 ms, or be flagged."""
    lines = []
    random = np.random.default_rng(1)
    for number in range(12):
        omega = random.normal(size=3)
        rate = 0.1 * 2.0 ** (number / 3.0) / 0.05  # rad/s: 0.1 to 1.3 rad a step
        omega *= rate / np.linalg.norm(omega)
        runs = [
            simulate(scene({"stone": STONE}, {}, [{"name": "free"}], 2.0, h, omega.tolist()), 40)
            for h in (0.05, 0.005)
        ]
        angle_columns = [f.history[["stone_pitch_deg", "stone_roll_deg"]].to_numpy() for f in runs]
        error = float(np.max(np.abs(angle_columns[0] - angle_columns[1][: len(angle_columns[0])])))
        label = f"tumbling {rate * 0.05:.2f} rad a step"
        lines.append(_judge_angles(label, error, Bound(1.0, "1 deg: a lost turn is 360"), runs[0]))
    return lines
