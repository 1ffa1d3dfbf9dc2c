"""Stresses of tables of aerodynamics, air, wind and proximity, entered at their edges and beyond.
Every stress is a function that simulates such cases and returns their judged lines."""

import math

import numpy as np

from sepmc.validation.flights import NominalRun
from sepmc.validation.stresses.line import FORM, NONE, Bound, Stress, judge, relative
from sepmc.validation.stresses.scenes import Tree, body, scene, simulate

SPEED, DENSITY, SOUND, AREA, MASS = 300.0, 0.5, 320.0, 0.2, 50.0  # m/s, kg/m3, m/s, m2, kg
AIR = {
    "altitude_m": [0.0, 5000.0, 10_000.0],
    "density_kg_per_m3": [DENSITY] * 3,
    "speed_of_sound_m_s": [SOUND] * 3,
}


def _probe(
    aero: Tree, environment: Tree | None = None, initial: Tree | None = None, end: float = 1.0
) -> Tree:
    """Tree of a body ``probe`` in uniform air, without gravity, at 5 km and 300 m/s. ``aero``,
    ``environment`` and ``initial`` add keys to, or replace keys of, these tables of the file; end
    time in s."""
    data = {"reference_area_m2": AREA, "reference_length_m": 1.0, **aero}
    tree = scene(
        {"probe": body(MASS, [10.0, 50.0, 50.0], [1.0, 0.0, 0.0], aerodynamics=data)},
        {},
        [{"name": "flight"}],
        end,
        0.05,
    )
    tree["environment"] = {"atmosphere": "table", "gravity": "none", "air": AIR} | (
        environment or {}
    )
    tree["initial"] |= {"altitude_m": 5000.0, "speed_m_s": SPEED} | (initial or {})
    return tree


def _drag(t: np.ndarray, axial: float, speed: float = SPEED) -> np.ndarray:
    """Speed, m/s, at times t, s, of the probe with a constant axial coefficient, from ``speed`` at
    t = 0, m/s: v' = -k v^2."""
    return speed / (1.0 + 0.5 * DENSITY * AREA * axial / MASS * speed * t)


def _speed_error(run: NominalRun, expected: np.ndarray) -> float:
    """Largest relative error (`relative`) of the probe's velocity along ground x over the run;
    ``expected`` in m/s."""
    return relative(run.body("probe").v[:, 0], expected)


def aero_tables() -> list[Stress]:
    """Lines of `sepmc stress` on an aerodynamic table over Mach, alpha or beta, entered within its
    range, at its edge, just beyond and far beyond.

    At an edge the round-off of speed or angle decides: inside and accurate, and outside and
    flagged, are both right. Beyond it, a case must be flagged.
    """
    lines = []
    mach = SPEED / SOUND

    def table(axis: str, low: float, high: float) -> Tree:
        """Tree of ``body.NAME.aerodynamics`` with a table of three rows: a constant axial
        coefficient over ``axis`` from low to high."""
        return {"table": {axis: [low, 0.5 * (low + high), high], "axial": [0.4] * 3}}

    for label, axis, low, high, inside in (
        ("Mach falls from the upper edge", "mach", 0.1, mach, True),
        ("Mach 1e-9 beyond the upper edge", "mach", 0.1, mach * (1.0 - 1e-9), False),
        ("Mach falls through the lower edge", "mach", mach * 0.9, mach * 2.0, False),
    ):
        run = simulate(_probe(table(axis, low, high), end=2.0))
        error = _speed_error(run, _drag(run.t, 0.4)) if inside else math.nan
        lines.append(judge(label, "speed", error, FORM if inside else NONE, run))
    for degrees in (0.0, 10.0 + 1e-9, 11.0, 180.0, -170.0):
        data = {"table": {"alpha_deg": [-10.0, 0.0, 10.0], "axial": [0.4] * 3}}
        run = simulate(_probe(data, initial={"pitch_deg": degrees, "alpha_deg": degrees}))
        inside = degrees == 0.0
        error = _speed_error(run, _drag(run.t, 0.4)) if inside else math.nan
        lines.append(
            judge(
                f"alpha {degrees:.12g} deg, table to 10",
                "speed",
                error,
                FORM if inside else NONE,
                run,
                inside,
            )
        )
    still = {"table": {"alpha_deg": [-10.0, 0.0, 10.0], "axial": [0.0] * 3, "normal": [0.0] * 3}}
    for degrees in (10.0, -10.0):
        run = simulate(_probe(still, initial={"pitch_deg": degrees, "alpha_deg": degrees}))
        error = _speed_error(run, np.full_like(run.t, SPEED))
        lines.append(
            judge(f"alpha {degrees:g} deg, on the edge, no force", "speed", error, FORM, run)
        )
    for degrees in (0.0, 5.0 + 1e-9):
        data = {"table": {"beta_deg": [-5.0, 0.0, 5.0], "axial": [0.4] * 3}}
        run = simulate(_probe(data, initial={"yaw_deg": degrees}))
        inside = degrees == 0.0
        error = _speed_error(run, _drag(run.t, 0.4)) if inside else math.nan
        lines.append(
            judge(
                f"beta {degrees:.12g} deg, table to 5",
                "speed",
                error,
                FORM if inside else NONE,
                run,
                inside,
            )
        )
    return lines


def air() -> list[Stress]:
    """Lines of `sepmc stress` on flights at the edges of a table of air and of the 1976 atmosphere,
    which must be accurate, and through the edges, which must be flagged."""
    lines = []
    drag = {"axial": {"const": 0.4}}
    for label, altitude, pitch, inside in (
        ("level at the top of a table of air", 10_000.0, 0.0, True),
        ("level at its bottom", 0.0, 0.0, True),
        ("1e-9 m above its top", 10_000.000000001, 0.0, False),
        ("climbing through its top", 9_900.0, 30.0, False),
        ("diving through its bottom", 100.0, -30.0, False),
    ):
        run = simulate(_probe(drag, initial={"altitude_m": altitude, "pitch_deg": pitch}))
        error = _speed_error(run, _drag(run.t, 0.4)) if inside else math.nan
        lines.append(judge(label, "speed", error, FORM if inside else NONE, run, inside))
    thin = {"atmosphere": "us1976", "gravity": "none"}
    for label, altitude, pitch, inside in (
        ("1976 atmosphere, level at 86 km", 86_000.0, 0.0, True),
        ("1976 atmosphere, climbing from 86 km", 86_000.0, 1.0, False),
        ("1976 atmosphere, level at 0 m", 0.0, 0.0, True),
        ("1976 atmosphere, diving from 1 m", 1.0, -1.0, False),
        ("1976 atmosphere, level at 11 km", 11_000.0, 0.0, True),
    ):
        tree = _probe(drag, initial={"altitude_m": altitude, "pitch_deg": pitch})
        tree["environment"] = dict(thin)
        run = simulate(tree)
        bound = Bound(0.0, "height must not change") if inside else NONE
        error = float(np.max(np.abs(run.body("probe").x[:, 1] - altitude))) if inside else math.nan
        lines.append(judge(label, "height, m", error, bound, run, inside))
    tree = _probe(
        {"axial": {"const": 0.0}},
        initial={"altitude_m": 85_000.0, "pitch_deg": 89.0, "speed_m_s": 7000.0},
        end=3.0,
    )
    tree["environment"] = dict(thin)
    return [
        *lines,
        judge("1976 atmosphere, out of it in a step", "height, m", math.nan, NONE, simulate(tree)),
    ]


def wind() -> list[Stress]:
    """Lines of `sepmc stress` on the speed of the probe below, within and above the rows of a wind
    profile, which is constant beyond them, and at its first and last row: one for each altitude.
    All must be accurate."""
    lines = []
    profile = {
        "altitude_m": [1000.0, 5000.0, 6000.0],
        "speed_m_s": [30.0, 30.0, 30.0],
        "direction_deg": [0.0, 0.0, 0.0],
    }
    for altitude in (10.0, 1000.0, 3000.0, 6000.0, 9000.0):
        tree = _probe({"axial": {"const": 0.4}}, initial={"altitude_m": altitude})
        tree["environment"]["wind"] = {"profile": profile}
        run = simulate(tree)
        error = _speed_error(run, 30.0 + _drag(run.t, 0.4, SPEED - 30.0))
        lines.append(
            judge(f"wind at {altitude:g} m, rows from 1 to 6 km", "speed", error, FORM, run, True)
        )
    return lines


def _near(distance: list[float], axial: list[float], step: float, push: float) -> Tree:
    """Tree of two free bodies, of which the first has increments ``axial`` to its axial
    coefficient, given at the values ``distance`` of their separation distance, m, which is 0 at the
    start. A force ``push``, N, separates them, or drives them together if negative; step in s."""
    tree = _probe({}, end=1.0)
    data = tree["body"]["probe"]["aerodynamics"]
    tree["body"]["other"] = body(MASS, [10.0, 50.0, 50.0], [3.0, 0.0, 0.0], aerodynamics=dict(data))
    tree["joint"] = {"gap": {"bodies": ["probe", "other"], "point_m": [2.0, 0.0, 0.0]}}
    tree["proximity"] = [
        {"name": "near", "body": "probe", "joint": "gap", "distance_m": distance, "axial": axial}
    ]
    tree["load"] = [{"name": "push", "body": "other", "force_N": [-push, 0.0, 0.0]}]
    tree["solver"]["step_s"] = step
    return tree


def proximity() -> list[Stress]:
    """Lines of `sepmc stress` on the speed of a body with proximity increments: far beyond both
    ends of their table of distances, where they are constant, against the closed form; and with
    the corner at the end of the table within a step, against a run in much smaller steps, where
    flagged errors pass too."""
    lines: list[Stress] = []
    for label, distance, push in (
        ("proximity, beyond its last row", [0.0, 0.05, 0.1], 100.0),
        ("proximity, before its first row", [0.0, 0.05, 0.1], -5000.0),
        ("proximity, ever before its first row", [50.0, 60.0, 70.0], 100.0),
    ):
        run = simulate(_near(distance, [0.4] * 3, 0.05, push))
        lines.append(judge(label, "speed", _speed_error(run, _drag(run.t, 0.4)), FORM, run, True))
    push, rows, steep = 2e3, [0.0, 0.1, 0.2], [0.0, 0.4, 0.8]
    fine, mass = simulate(_near(rows, steep, 2e-3, push)), 0.5 * DENSITY * AREA * SPEED**2 / MASS
    for step in (0.1, 0.05, 0.01):
        run = simulate(_near(rows, steep, step, push))
        # corner in the force: a smooth method does not see the jump of its slope over half a step
        # each way
        parting = math.sqrt(2.0 * 0.2 * (push / MASS + 0.8 * mass))
        bound = Bound(mass * 4.0 * parting * step**2 / 8.0 / SPEED, "corner in a step: h^2 / 8")
        lines.append(
            judge(
                f"end of a table in a step of {step:g} s",
                "speed",
                _speed_error(run, fine.body("probe").v[:, 0]),
                bound,
                run,
            )
        )
    return lines
