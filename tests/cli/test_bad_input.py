"""Bad input: exit code 2, a line per problem with its place, value and what is allowed, no
traceback, and nothing written."""

from pathlib import Path

import pytest
from click.testing import CliRunner

import sepmc as package
from sepmc.cli.app import main
from sepmc.scene.messages import SceneError, nearest

TEXT = (Path(__file__).parents[2] / "campaigns" / "table2.toml").read_text(encoding="utf-8")
MASS, INERTIA, UNTIL = (
    "mass_kg = 458.0",
    "inertia_kg_m2 = [18.6, 156.3, 157.2]",
    "until = { time_s = 0.05 }",
)
LAW = '"initial.altitude_m" = { uniform = 150.0 }'
BROKEN = [  # what to replace in table2.toml, by what, and what the message must contain
    (MASS, "mas_kg = 458.0", ["body.upper.mas_kg", "unknown key", "'mass_kg'"]),
    (
        MASS,
        "mass_km = 458.0",
        ["body.upper.mass_km", "not a unit of mass", "mass_kg, mass_g, mass_t, mass_lb, mass_slug"],
    ),
    (MASS, "mass = 458.0", ["body.upper.mass", "the unit is missing", "mass_kg"]),
    (MASS, "", ["body.upper", "'mass_kg' is missing"]),
    (MASS, "mass_kg = -3", ["body.upper.mass_kg = -3", "must be > 0"]),
    (MASS, "mass_g = 0.0", ["body.upper.mass_g = 0.0", "must be > 0"]),
    (MASS, "mass_kg = nan", ["body.upper.mass_kg = nan", "must be finite"]),
    (MASS, "mass_kg = inf", ["body.upper.mass_kg = inf", "must be finite"]),
    (MASS, "mass_kg = '458'", ["body.upper.mass_kg = '458'", "must be a number"]),
    (MASS, "mass_kg = true", ["body.upper.mass_kg = true", "must be a number"]),
    (MASS, "mass_kg = [458.0]", ["body.upper.mass_kg = [458.0]", "must be a number"]),
    (MASS, MASS + "\nmass_g = 458e3", ["body.upper.mass_g", "given twice", "'mass_kg'"]),
    (
        INERTIA,
        "inertia_kg_m2 = [-1.0, 156.3, 157.2]",
        ["body.upper.inertia_kg_m2 = [-1.0, 156.3, 157.2]", "positive definite"],
    ),
    (
        INERTIA,
        INERTIA + "\ninertia_products_kg_m2 = [60.0, 0.0, 0.0]",
        ["body.upper.inertia_kg_m2", "positive definite"],
    ),
    (
        INERTIA,
        "inertia_kg_m2 = [1.0, 10.0, 11.2]",
        ["body.upper.inertia_kg_m2", "triangle inequality", "1 + 10 < 11.2"],
    ),
    (
        INERTIA,
        "inertia_kg_m2 = [18.6, 156.3]",
        ["body.upper.inertia_kg_m2 = [18.6, 156.3]", "length 3"],
    ),
    (
        INERTIA,
        "inertia_kg_m2 = [18.6, nan, 157.2]",
        ["body.upper.inertia_kg_m2", "nan", "must be finite"],
    ),
    ("[initial]", "[initia]", ["initia", "did you mean 'initial'"]),
    ("[run]\nend_time_s = 0.5", "", ["run", "missing"]),
    ("cases = 10000", "cases = 0", ["run.cases = 0", "must be >= 1"]),
    ("cases = 10000", "cases = 1.5", ["run.cases = 1.5", "whole number"]),
    ("cases = 10000", "chunk = 0", ["run.chunk = 0", "must be >= 1"]),
    ("seed = 2019", "seed = -1", ["run.seed = -1", "must be >= 0"]),
    ("end_time_s = 0.5", "end_time_s = 0.0", ["run.end_time_s = 0.0", "must be > 0"]),
    (UNTIL, "", ["phase.locked", "never ends"]),
    (UNTIL, "until = {}", ["phase.locked.until", "is never met"]),
    (
        UNTIL,
        "until = { time_s = 0.6 }",
        ["phase.locked.until.time_s = 0.6", "run.end_time_s = 0.5"],
    ),
    (
        UNTIL,
        'until = { joint = "pins", stroke_mm = 3.0 }',
        ["phase.locked.until.joint = 'pins'", "'fixed' in this phase, which has no stroke"],
    ),
    (
        'name = "free"',
        'name = "free"\nuntil = { time_s = 0.4 }',
        ["phase.free.until", "end_time_s"],
    ),
    ('name = "free"', 'name = "guided"', ["phase.guided", "used twice"]),
    (
        "speed_m_s = 6800",
        "speed_mm_s = 6800",
        ["initial.speed_mm_s", "'mm_s' is not a unit of speed", "allowed: speed_m_s, speed_km_s"],
    ),
    (
        '{ pins = "slider" }',
        '{ pin = "slider" }',
        ["phase.guided.joints = 'pin'", "did you mean 'pins'"],
    ),
    (
        '{ pins = "slider" }',
        '{ pins = "slide" }',
        ["phase.guided.joints.pins = 'slide'", "did you mean 'slider'?"],
    ),
    (
        'bodies = ["upper", "lower"]',
        'bodies = ["uper", "lower"]',
        ["joint.pins.bodies = 'uper'", "did you mean 'upper'"],
    ),
    (
        'bodies = ["upper", "lower"]',
        'bodies = ["upper", "upper"]',
        ["joint.pins.bodies", "two different bodies"],
    ),
    ('body = "lower"', 'body = "lover"', ["motor.retro.body = 'lover'", "did you mean 'lower'"]),
    ('"us1976"', '"us76"', ["environment.atmosphere = 'us76'", "us1976, table, none"]),
    (
        '"inverse-square"',
        '"round"',
        ["environment.gravity = 'round'", "inverse-square, constant, none"],
    ),
    (
        "accuracy = 1e-9",
        'method = "rk5"',
        ["solver.method = 'rk5'", "auto, sharp9, dop853, tp7, dopri5, rk4"],
    ),
    ("accuracy = 1e-9", 'formulation = "x"', ["solver.formulation = 'x'", "reduced, full"]),
    (
        "accuracy = 1e-9",
        "accuracy = 1e-13",
        ["solver.accuracy = 1e-13", "must be a number >= 1e-12"],
    ),
    ("accuracy = 1e-9", "accuracy = 0.2", ["solver.accuracy = 0.2", "must be a number <= 0.1"]),
    ("accuracy = 1e-9", "step_s = 0.0", ["solver.step_s = 0.0", "must be > 0"]),
    ("altitude_km = 70.0", "altitude_km = 90.0", ["initial.altitude_m = 90000.0", "86000"]),
    ("yaw_deg = 0.0", "yaw_deg = 120.0", ["initial.yaw_deg = 120.0:", "within +-89 deg"]),
    ("side = { beta =", "side = { bta =", ["body.upper.aerodynamics.side.bta", "const, alpha"]),
    (
        LAW,
        '"initial.altitude_m" = { uniform = 150.0, normal = 3.0 }',
        ["initial.altitude_m", "exactly one", "uniform and normal"],
    ),
    (LAW, '"initial.altitude_m" = {}', ["dispersion.initial.altitude_m", "exactly one"]),
    (
        LAW,
        '"initial.altitude_m" = { uniform = -150.0 }',
        ["dispersion.initial.altitude_m = -150.0", ">= 0"],
    ),
    (
        LAW,
        '"initial.altitude_m" = { uniform = [2.0, 1.0] }',
        ["dispersion.initial.altitude_m", "must be low <= high"],
    ),
    (
        LAW,
        '"initial.altitude_m" = { uniform = 17e3 }',
        ["dispersion.initial.altitude_m", "53000 to 87000", "86000"],
    ),
    (
        LAW,
        '"initial.altitude_m" = { uniform = nan }',
        ["dispersion.initial.altitude_m.uniform = nan", "finite"],
    ),
    (
        LAW,
        '"initial.altitude_m" = { discrete = [1.0], weights = [1.0, 2.0] }',
        ["dispersion.initial.altitude_m", "weights"],
    ),
    (
        LAW,
        '"initial.altitude" = { uniform = 150.0 }',
        ["dispersion.initial.altitude", "unit", "altitude_m"],
    ),
    (
        LAW,
        '"initial.altitud_m" = { uniform = 150.0 }',
        ["dispersion.initial.altitud_m", "did you mean 'altitude_m'"],
    ),
    (LAW, "initial.altitude_m = { uniform = 150.0 }", ["dispersion.initial", "quotes"]),
    (
        LAW,
        LAW + '\n"initial.altitude_km" = { uniform = 0.15 }',
        ["dispersion.initial.altitude_km", "given twice", "'initial.altitude_m'"],
    ),
    (
        LAW,
        '"initial.omega_deg_s" = { uniform = 1.0 }',
        ["dispersion.initial.omega_deg_s", "vector", ".x, .y, .z"],
    ),
    (LAW, '"run.end_time_s" = { uniform = 0.1 }', ["dispersion.run.end_time_s", "cannot vary"]),
    (
        LAW,
        '"joint.pins.y_axis.y" = { uniform = 1.0 }',
        ["dispersion.joint.pins.y_axis", "may be zero or parallel to x_axis"],
    ),
    (
        '"body.upper.mass_kg" = { uniform = 20.0 }',
        '"body.upper.mass_kg" = { uniform = 500.0 }',
        ["body.upper.mass_kg", "-42", "> 0"],
    ),
    (
        "upper_roll_deg =",
        "uper_roll_deg =",
        ["reference.outcome.uper_roll_deg", "did you mean 'upper_roll_deg'"],
    ),
    (
        "sigma = 0.6716",
        "sigma = -1.0",
        ["reference.outcome.upper_alpha_ref_deg.sigma = -1.0", "must be > 0"],
    ),
    (
        'joints = { pins = "fixed" }',
        "joints = {}",
        [
            "phase.guided.joints.pins = 'slider'",
            "not named in a phase is free",
            "cannot gain constraints",
        ],
    ),
    (
        'name = "free"',
        'name = "free"\njoints = { pins = "fixed" }',
        ["phase.free.joints.pins = 'fixed'", "it is 'slider'"],
    ),
    (
        'joints = { pins = "fixed" }',
        'joints = { pins = "welded" }',
        ["phase.locked.joints.pins = 'welded'", "free, fixed, slider, revolute"],
    ),
    ("build_up_s =", "build_upp_s =", ["motor.retro.build_upp_s", "did you mean 'build_up_s'"]),
    (MASS, "mass_t = 1e308", ["body.upper.mass_t", "finite"]),  # overflows to inf kg and is flown
    (MASS, f"mass_g = 1{'0' * 400}", ["body.upper.mass_g"]),  # OverflowError
    (MASS, f"mass_kg = 1{'0' * 5000}", ["bad.toml", "digits"]),  # the file is not named
    ('name = "retro"', 'name = ["retro"]', ["motor", "must be text"]),  # TypeError: unhashable
    # runs/a/b-1; with "../../a" outside of runs/
    ('name = "table2"', 'name = "a/b"', ["name = 'a/b'"]),
    # nominal is inf: draws nan
    (LAW, '"motor.retro.burn_s" = { uniform = 1.0 }', ["dispersion.motor.retro.burn_s"]),
    (
        '"initial.yaw_deg" = { uniform = 2.0 }',
        '"initial.yaw_deg" = { uniform = 120.0 }',
        ["dispersion.initial.yaw_deg", "89"],
    ),  # range is not checked
    # overflows: draws inf
    (
        LAW,
        '"initial.path_yaw_deg" = { uniform = [-1e308, 1.7e308] }',
        ["dispersion.initial.path_yaw_deg"],
    ),
    (TEXT, "a = " + "[" * 9999 + "]" * 9999, ["bad.toml", "TOML"]),  # RecursionError
]


RICH = (Path(__file__).parents[1] / "data" / "everything.toml").read_text(encoding="utf-8")
PUSHER, TIE = (
    "point_m = [2.0, 0.2, 0.1]\naxis = [-1.0, 0.0, 0.0]",
    "second_point_m = [0.3, 0.4, 0.0]",
)
HIGH = '{ body = "upper", altitude_m = 2990.0 }'
APART = (
    'until = { any = [{ joint = "hinge", angle_deg = 3.0 }, '
    + HIGH
    + ', { joint = "pins", distance_m = 1.5 }] }'
)
SHED = 'when = { joint = "hinge", angle_deg = 12.0, moment_N_m = 1e6 }'
ROWS = "[[0.30, 0.20, 0.21, 0.30], [0.32, 0.22, 0.23, 0.32], [0.40, 0.30, 0.31, 0.40]]"
FAILS = '"joint.pins.fails" = { discrete = [0, 1], weights = [0.9, 0.1] }'
OTHERS = [  # the same for everything.toml
    # conditions
    (
        'burn_out = "main"',
        'burn_out = "mian"',
        ["phase.locked.until.any.0.burn_out = 'mian'", "did you mean 'main'?"],
    ),
    ("burn_s = 0.08", "", ["phase.locked.until.any.0.burn_out = 'main'", "burns for ever"]),
    (
        'joint = "tie", force_kN = 50.0',
        'joint = "tei", force_kN = 50.0',
        ["phase.locked.until.any.1.joint = 'tei'", "did you mean 'tie'?"],
    ),
    (
        'joint = "tie", force_kN = 50.0',
        "force_kN = 50.0",
        ["phase.locked.until.any.1.force_N", "needs joint"],
    ),
    (
        'joint = "tie", force_kN = 50.0',
        'joint = "tie"',
        ["phase.locked.until.any.1", "is never met", "with joint a stroke_m, distance_m, angle"],
    ),
    (
        'joint = "tie", force_kN = 50.0',
        'time_s = 0.1, joint = "tie"',
        ["phase.locked.until.any.1.joint = 'tie'", "needs at least one of stroke_m, distance_m"],
    ),
    (
        'joint = "tie", force_kN = 50.0',
        'joint = "tie", force_kN = 0.0',
        ["force_kN = 0.0", "must be > 0"],
    ),
    (
        'joint = "tie", force_kN = 50.0',
        'joint = "tie", force = 50.0',
        ["phase.locked.until.any.1.force", "the unit is missing"],
    ),
    (
        'joint = "tie", force_kN = 50.0',
        'joint = "tie", farce_kN = 50.0',
        ["phase.locked.until.any.1.farce_kN", "unknown key"],
    ),
    (
        "{ time_s = 0.15 }, ",
        "{}, ",
        ["phase.guided.until.all.0", "is never met: give time_s, burn_out"],
    ),
    (
        'body = "upper", altitude_m = 2990.0',
        'body = "uper", altitude_m = 2990.0',
        ["phase.apart.until.any.1.body = 'uper'", "did you mean 'upper'?"],
    ),
    (
        'body = "upper", altitude_m = 2990.0',
        "altitude_m = 2990.0",
        ["phase.apart.until.any.1", "body needs altitude_m or vertical_speed_m_s, and"],
    ),
    (
        'body = "upper", altitude_m = 2990.0',
        'time_s = 0.4, body = "upper"',
        ["phase.apart.until.any.1", "body needs altitude_m or vertical_speed_m_s, and"],
    ),
    (APART, "until = { any = 3 }", ["phase.apart.until.any = 3"]),
    (
        SHED,
        'when = { joint = "pins", angle_dg = 1.0 }',
        ["release.shed.when.angle_dg", "unknown key"],
    ),
    (
        SHED,
        'when = { joint = "hinge", angle_deg = 200.0 }',
        ["release.shed.when.angle_deg = 200.0", "at most 180 deg"],
    ),
    (
        APART,
        'until = { joint = "hinge", angle_deg = 181.0 }',
        ["phase.apart.until.angle_deg = 181.0", "at most 180 deg"],
    ),
    (SHED, "when = {}", ["release.shed.when", "is never met"]),
    (SHED, "", ["release.shed", "[when] is missing"]),
    # kinds, releases, letting go
    (
        'joint = "hinge"\nwhen',
        'joint = "hing"\nwhen',
        ["release.shed = 'hing'", "did you mean 'hinge'?"],
    ),
    (
        'joint = "hinge"\nwhen',
        'joint = "hinge"\nto = "losse"\nwhen',
        ["release.shed.hinge = 'losse'", "no such joint kind", "did you mean 'loose'?"],
    ),
    (
        'joint = "hinge"\nwhen',
        'joint = "hinge"\nto = "fixed"\nwhen',
        ["release.shed.to = 'fixed'", "releases nothing: hinge is revolute, loose in the phases"],
    ),
    (
        '{ hinge = "loose" }',
        '{ hinge = "lose" }',
        ["phase.open.joints.hinge = 'lose'", "did you mean 'loose'?"],
    ),
    (
        '{ hinge = "loose" }',
        '{ hinge = "slider" }',
        [
            "phase.open.joints.hinge = 'slider'",
            "in phase 'apart' it is 'revolute'",
            "cannot gain constraints",
        ],
    ),
    (
        '{ hinge = "loose" }',
        '{ hinge = "loose", tie = "rod" }',
        ["phase.open.joints.tie = 'rod'", "not named in a phase is free"],
    ),
    (TIE, "", ["joint.tie.second_point_m", "is needed by a rod"]),
    (TIE, "second_point_m = [0.3, 0.1, 0.0]", ["joint.tie.second_point_m", "is needed by a rod"]),
    (
        'tie = "rod"',
        'tie = "spherical"',
        ["joint.tie.second_point_m", "must not differ from point_m where the joint is 'spherical'"],
    ),
    (
        "[joint.hinge.kind.loose]",
        "[joint.hinge.kind.slider]",
        ["joint.hinge.kind.slider", "is the name of a common joint kind"],
    ),
    ('rotations = ["y"]', 'rotations = ["q"]', ["joint.hinge.kind.loose.rotations"]),
    (
        'rotations = ["y"]',
        'rotates = ["y"]',
        ["joint.hinge.kind.loose.rotates", "did you mean 'rotations'?"],
    ),
    (
        'hinge = "revolute", tie = "rod" }',
        'hinge = "revolute", tie = "rod", pad = "fixed" }',
        ["initial.speed_m_s = 150.0", "must be 0", "connects to the ground"],
    ),
    (
        "delay_s = 0.002",
        "fails = 0.5",
        ["joint.pins.fails = 0.5", "0 (releases) or 1 (never does)"],
    ),
    ("delay_s = 0.002", "delay_s = -0.1", ["joint.pins.delay_s = -0.1", "must be >= 0"]),
    (FAILS, '"joint.pins.fails" = { discrete = [0, 2] }', ["dispersion.joint.pins.fails"]),
    (
        "friction = 0.05",
        "friction = 0.0",
        ["dispersion.joint.pins.guide.friction", "its nominal is > 0"],
    ),
    ("pins = 3\n", "pins = 0\n", ["joint.pins.guide.pins = 0", ">= 1"]),
    ("pins = 3\n", "pins = 2.5\n", ["joint.pins.guide.pins = 2.5", "whole number"]),
    ("circle_m = 0.3", "", ["joint.pins.guide.circle_m", "must be > 0 with more than one pin"]),
    (
        '{ pins = "slider", hinge',
        '{ pins = "point-on-line", hinge',
        [
            "joint.pins.guide",
            "does nothing",
            "at least two rotations",
            "it is fixed, point-on-line, free in the phases",
        ],
    ),
    ("engaged_mm = 60.0", "engaged_mm = 0.0", ["joint.pins.guide.engaged_mm = 0.0", "must be > 0"]),
    # springs and loads
    (
        'bodies = ["upper", "lower"]\npoint_m = [2.0',
        'bodies = ["uppr", "lower"]\npoint_m = [2.0',
        ["spring.pusher.bodies = 'uppr'", "did you mean 'upper'?"],
    ),
    (
        'bodies = ["upper", "lower"]\npoint_m = [2.0',
        'bodies = ["upper", "upper"]\npoint_m = [2.0',
        ["spring.pusher.bodies", "two different bodies"],
    ),
    (
        PUSHER,
        PUSHER.replace("-1.0", "0.0"),
        ["spring.pusher.axis = [0.0, 0.0, 0.0]", "must not be zero"],
    ),
    (
        PUSHER,
        "point_m = [2.0, 0.2, 0.1]",
        ["spring.pusher.axis", "is needed where both points are one"],
    ),
    (
        "second_point_m = [0.8, 0.3, 0.0]",
        "second_point_m = [0.8, 0.1, 0.0]",
        ["spring.strut.axis", "is needed where both points are one"],
    ),
    ("stroke_mm = 80.0", "stroke_mm = 0.0", ["spring.strut.stroke_mm = 0.0", "must be > 0"]),
    (
        "stiffness_N_per_m = 8000.0",
        "stiffness_N_per_m = -1.0",
        ["spring.pusher.stiffness_N_per_m = -1.0", "must be >= 0"],
    ),
    (
        "stiffness_N_per_m = 8000.0",
        "stiffness_N_m = 8000.0",
        ["spring.pusher.stiffness_N_m", "not a unit of stiffness"],
    ),
    ('name = "strut"', 'name = "pusher"', ["spring.pusher", "used twice"]),
    (
        'body = "half"\nforce_N',
        'body = "hlf"\nforce_N',
        ["load.plume.body = 'hlf'", "did you mean 'half'?"],
    ),
    ("end_s = 0.4", "end_s = 0.2", ["load.plume.end_s = 0.2", "must be > start_s = 0.2"]),
    (
        "end_s = 0.4",
        "end_s = 0.2000000000004",
        ["load.plume.end_s = 0.2", "must be > start_s = 0.2, by more than 1e-12 s"],
    ),
    ('frame = "ground"', 'frame = "wind"', ["load.tug.frame = 'wind'", "body, ground"]),
    (
        'body = "half"\nforce_N',
        'body = "ground"\nforce_N',
        ["load.plume.body = 'ground'", "no such body"],
    ),
    (
        "[body.half]",
        "[body.ground]\nmass_kg = 1.0\ninertia_kg_m2 = [1.0, 1.0, 1.0]\ncg_m = [0.0, 0.0, "
        "0.0]\n[body.half]",
        ["body.ground", "is the name of the ground"],
    ),
    # motors
    (
        "time_s = [0.0, 0.05, 0.3]",
        "time_s = [0.0, 0.3, 0.05]",
        ["motor.retro.profile.time_s", "must rise strictly"],
    ),
    (
        "fraction = [0.0, 1.0, 0.6]",
        "fraction = [0.0, 1.0]",
        ["motor.retro.profile.fraction", "has 2 values, but time_s has 3"],
    ),
    (
        "time_s = [0.0, 0.05, 0.3], fraction = [0.0, 1.0, 0.6]",
        "time_s = [0.3], fraction = [0.6]",
        ["motor.retro.profile.time_s", "needs at least 2 values"],
    ),
    (
        "time_s = [0.0, 0.05, 0.3]",
        "time_s = [-0.02, 0.05, 0.3]",
        ["motor.retro.profile.time_s = -0.02", "must begin at 0 or later"],
    ),
    ("tail_off_s = 0.05", "tail_off_s = -0.05", ["motor.retro.tail_off_s = -0.05", "must be >= 0"]),
    # air and wind
    (
        'atmosphere = "table"',
        'atmosphere = "us1976"',
        ["environment.air", 'belongs to atmosphere = "table"'],
    ),
    ("[environment.air]", "[environment.aire]", ["environment.aire", "did you mean 'air'?"]),
    (
        "altitude_m = [0.0, 2000.0, 5000.0, 9000.0]",
        "altitude_m = [0.0, 5000.0, 2000.0, 9000.0]",
        ["environment.air.altitude_m", "must rise strictly"],
    ),
    (
        "density_kg_per_m3 = [1.2, 1.0, 0.7, 0.4]",
        "density_kg_per_m3 = [1.2, 1.0, 0.7]",
        ["environment.air.density_kg_per_m3", "has 3 values, but altitude_m has 4"],
    ),
    (
        "density_kg_per_m3 = [1.2, 1.0, 0.7, 0.4]",
        "density_kg_per_m3 = [1.2, 1.0, 0.7, 0.0]",
        ["environment.air.density_kg_per_m3", "must be > 0"],
    ),
    (
        "density_kg_per_m3 = [1.2, 1.0, 0.7, 0.4]",
        "density_kg_per_m3 = [1.2, 1.0, nan, 0.4]",
        ["environment.air.density_kg_per_m3", "must be finite"],
    ),
    (
        "speed_of_sound_m_s = [340.0, 332.0, 320.0, 304.0]",
        "speed_of_sound_m_s = [340.0, 332.0, -320.0, 304.0]",
        ["speed_of_sound_m_s", "must be > 0"],
    ),
    (
        "speed_of_sound_m_s = [340.0, 332.0, 320.0, 304.0]",
        "",
        ["environment.air.speed_of_sound_m_s", "is needed for tables over Mach number"],
    ),
    (
        "speed_m_s = [2.0, 10.0, 25.0]",
        "speed_m_s = [2.0, 10.0]",
        ["environment.wind.profile.speed_m_s", "has 2 values, but altitude_m has 3"],
    ),
    (
        "altitude_m = [0.0, 3000.0, 8000.0]",
        "altitude_m = [0.0, 8000.0, 8000.0]",
        ["environment.wind.profile.altitude_m", "must rise strictly"],
    ),
    (
        "density_factor = 1.1",
        "density_factor = -1.0",
        ["environment.density_factor = -1.0", "must be >= 0"],
    ),
    # aerodynamic tables and proximity
    (
        "mach = [0.1, 0.5, 0.9]",
        "mach = [0.1, 0.9, 0.5]",
        ["body.upper.aerodynamics.table.mach", "must rise strictly"],
    ),
    (
        "mach = [0.1, 0.5, 0.9]",
        "",
        ["body.upper.aerodynamics.table.axial", "is 3 x 4, but the axes ask for 4 (alpha_deg)"],
    ),
    (
        "mach = [0.1, 0.5, 0.9]\nalpha_deg = [-30.0, 0.0, 10.0, 30.0]",
        "",
        ["body.upper.aerodynamics.table", "needs an axis: mach, alpha_deg or beta_deg"],
    ),
    (
        ROWS,
        "[[0.3, 0.2, 0.2, 0.3], [0.3, 0.2, 0.2, 0.3]]",
        [
            "body.upper.aerodynamics.table.axial",
            "is 2 x 4, but the axes ask for 3 (mach) x 4 (alpha_deg)",
        ],
    ),
    (
        ROWS,
        "[[0.3, 0.2, 0.2], [0.3, 0.2, 0.2, 0.3]]",
        ["body.upper.aerodynamics.table.axial", "nested lists of numbers"],
    ),
    (ROWS, ROWS.replace("0.22", "'x'"), ["body.upper.aerodynamics.table.axial"]),
    (ROWS, ROWS.replace("0.22", "nan"), ["body.upper.aerodynamics.table.axial", "must be finite"]),
    (
        "[body.upper.aerodynamics.table]",
        "[body.upper.aerodynamics.tables]",
        ["body.upper.aerodynamics.tables", "did you mean 'table'?"],
    ),
    (
        'body = "lower"\njoint = "pins"',
        'body = "lwer"\njoint = "pins"',
        ["proximity.base.body = 'lwer'", "did you mean 'lower'?"],
    ),
    (
        'body = "lower"\njoint = "pins"',
        'body = "half"\njoint = "pins"',
        ["proximity.base.body = 'half'", "has no aerodynamics to add to"],
    ),
    (
        'body = "lower"\njoint = "pins"',
        'body = "lower"\njoint = "pns"',
        ["proximity.base.joint = 'pns'", "did you mean 'pins'?"],
    ),
    (
        "distance_mm = [0.0, 50.0, 200.0]",
        "distance_mm = [0.0, 200.0, 50.0]",
        ["proximity.base.distance_m", "must rise strictly"],
    ),
    (
        "axial = [-0.3, -0.1, 0.0]",
        "axial = [-0.3, -0.1]",
        ["proximity.base.axial", "has 2 values, but distance_m has 3"],
    ),
    # outlines and outputs
    (
        "stations_m = [2.2, 6.0]\nradii_m = [0.5, 0.5]",
        "stations_m = [2.2, 6.0]",
        ["body.lower.outline.0", "give stations_m and radii_m (a frustum), or points_m"],
    ),
    (
        "stations_m = [2.2, 6.0]\nradii_m = [0.5, 0.5]",
        "",
        ["body.lower.outline.0", "give stations_m and radii_m (a frustum), or points_m"],
    ),
    (
        "stations_m = [2.2, 6.0]\nradii_m = [0.5, 0.5]",
        "stations_m = [2.2, 6.0]\nradii_m = [0.5, -0.5]",
        ["body.lower.outline.0.radii_m", "must be >= 0"],
    ),
    (
        "stations_m = [-0.2, 2.2]",
        "stations_m = [2.2, 2.2]",
        ["body.half.outline.0.hollow", "only a frustum of some length can be hollow"],
    ),
    (
        "stations_m = [2.2, 6.0]\nradii_m = [0.5, 0.5]",
        "points_m = [[2.2, 0.5, 0.0]]\noffset_m = [0.1, 0.0]",
        ["body.lower.outline.0.offset_m = [0.1, 0.0]", "points_m give y and z themselves"],
    ),
    (
        'bodies = ["half", "upper"]',
        'bodies = ["half", "uper"]',
        ["clearance.shroud.bodies = 'uper'", "did you mean 'upper'?"],
    ),
    (
        'bodies = ["half", "upper"]',
        'bodies = ["half", "half"]',
        ["clearance.shroud.bodies", "two different bodies"],
    ),
    (
        'bodies = ["half", "upper"]',
        'bodies = ["half", "ground"]',
        ["clearance.shroud.bodies", "the ground has no outline"],
    ),
    (
        "[[body.lower.outline]]\nstations_m = [2.2, 6.0]\nradii_m = [0.5, 0.5]",
        "",
        ["clearance.stages.bodies", "body 'lower' has no outline", "[[body.lower.outline]]"],
    ),
    (
        'after = "pins"',
        'after = "pens"',
        ["clearance.stages.after = 'pens'", "did you mean 'pins'?"],
    ),
    (
        'loads = ["pins", "hinge"]',
        'loads = ["pins", "hinges"]',
        ["output.loads = 'hinges'", "did you mean 'hinge'?"],
    ),
    (
        'loads = ["pins", "hinge"]',
        'loads = ["pins", "pins"]',
        ["output.loads = ['pins', 'pins']", "names a joint twice"],
    ),
    (
        'guide = ["pins"]',
        'guide = ["hinge"]',
        ["output.guide", "joint 'hinge' has no pins: give [joint.hinge.guide]"],
    ),
    ('guide = ["pins"]', 'gide = ["pins"]', ["output.gide", "did you mean 'guide'?"]),
    # dispersions of what all cases share, and of what may not be
    (
        FAILS,
        '"spring.pusher.axis.x" = { uniform = 1.0 }',
        ["dispersion.spring.pusher.axis", "may be zero"],
    ),
    (
        FAILS,
        '"joint.pins.guide.pins" = { discrete = [3, 4] }',
        ["dispersion.joint.pins.guide.pins", "cannot vary"],
    ),
    (
        FAILS,
        '"environment.air.density_kg_per_m3.0" = { uniform = 0.1 }',
        ["dispersion.environment.air.density_kg_per_m3.0"],
    ),
    (
        FAILS,
        '"body.lower.outline.0.radii_m.0" = { uniform = [-0.1, 1.0] }',
        [
            "dispersion.body.lower.outline.0.radii_m.0",
            "the distribution reaches -0.1",
            "must be >= 0",
        ],
    ),
    (
        FAILS,
        '"phase.locked.until.any.2.force_kN" = { uniform = 5.0 }',
        ["dispersion.phase.locked.until.any.2.force_kN"],
    ),
    (
        FAILS,
        '"phase.locked.until.any.1.stroke_mm" = { uniform = 5.0 }',
        ["dispersion.phase.locked.until.any.1.stroke_mm", "is not set in this scene"],
    ),
    (
        FAILS,
        '"release.shed.when.angle_deg.x" = { uniform = 5.0 }',
        ["dispersion.release.shed.when.angle_deg.x"],
    ),
]


@pytest.fixture
def sepmc(tmp_path, monkeypatch):
    """The command line in an empty folder; a bad call must leave the folder as it found it."""
    monkeypatch.chdir(tmp_path)

    def call(*arguments):
        before = sorted(tmp_path.rglob("*"))
        result = CliRunner().invoke(main, [str(a) for a in arguments])
        assert isinstance(result.exception, SystemExit), (
            f"a traceback, not a message: {result.exception!r}"
        )
        assert result.exit_code == 2
        assert result.stdout == ""
        assert sorted(tmp_path.rglob("*")) == before, "something was written"
        return result.stderr

    return call


ACCEPTED = [  # the range of the law is looked at, not its values
    (
        RICH,
        FAILS,
        f'"joint.pins.fails" = {{ {law} }}',
        ["dispersion.joint.pins.fails", "must be discrete"],
    )
    for law in ("uniform = [0, 1]", "discrete = [0, 0.5, 1]")
]


@pytest.mark.parametrize(
    ("text", "old", "new", "message"),
    [(TEXT, *row) for row in BROKEN] + [(RICH, *row) for row in OTHERS] + ACCEPTED,
)
def test_file(sepmc, text, old, new, message):
    """One line starts with the file and names the place and what is allowed; no other line is
    longer than a line."""
    assert text.count(old) >= 1, "the file has changed: this test breaks nothing"
    Path("bad.toml").write_text(text.replace(old, new, 1), encoding="utf-8")
    lines = sepmc("campaign", "bad.toml", "--cases", "2", "--no-plots", "--quiet").splitlines()
    assert all(line.startswith("error: ") for line in lines)
    assert any(all(part in line for part in message) for line in lines), lines


def test_every_problem_is_told_at_once(sepmc):
    Path("bad.toml").write_text(
        TEXT.replace(MASS, "mass_kg = -3").replace("seed = 2019", "seed = -1"), encoding="utf-8"
    )
    for command in ("campaign", "check", "run"):
        assert sepmc(command, "bad.toml").splitlines() == [
            "error: bad.toml: body.upper.mass_kg = -3: must be > 0",
            "error: bad.toml: run.seed = -1: must be >= 0",
        ]


@pytest.mark.parametrize(
    "content",
    [
        b"this is = = not TOML",
        b"\x89PNG\r\n\x1a\n\x00\xff",
        b"\x00" * 9,
        bytes(range(128, 192)) + b"\xff",
        b"",
    ],
)
def test_no_toml(sepmc, content):
    Path("bad.toml").write_bytes(content)
    assert "error: bad.toml: " in sepmc("campaign", "bad.toml")


# OSError
def test_a_folder_that_is_no_run(sepmc, tmp_path):
    message = sepmc("campaign", str(tmp_path))
    assert f"{tmp_path}: is a folder, and not that of a run" in message


@pytest.mark.parametrize("file", ["nowhere.toml", "folder/nowhere.toml", "", "x" * 5000])
def test_no_such_file(sepmc, file):
    message = sepmc("campaign", file)
    assert "no such file, nor a shipped campaign" in message
    assert "did you mean" not in message  # of names that only end alike


def test_almost_the_name_of_a_shipped_campaign(sepmc):
    assert "did you mean 'table2'?" in sepmc("campaign", "tabel2.toml")


@pytest.mark.parametrize(
    ("options", "message"),
    [
        (["--cases", "0"], "--cases"),
        (["--cases", "-5"], "--cases"),
        (["--cases", "many"], "--cases"),
        (["--seed", "-1"], "--seed"),
        (["--threads", "0"], "--threads"),
        (["--threads", "4096"], "threads = 4096: must lie in 1 to "),
        (["--resume"], "--resume needs --out"),
        (["--overwrite"], "--overwrite needs --out"),
        (["--resume", "--overwrite", "--out", "x"], "exclude each other"),
        (["--keep-columns", "", "--out", "x"], "float32: apply only to rows that keep selects"),
        (["--set", "body.upper.mass_kg"], "must read path=value"),
        (["--set", "=3"], "must read path=value"),
        (["--set", "body.upper.mas_kg=3"], "did you mean 'mass_kg'?"),
        (["--set", "body.upper.mass_kg=heavy"], "body.upper.mass_kg = 'heavy': must be a number"),
        (["--set", "body.upper.mass_kg="], "body.upper.mass_kg = '': must be a number"),
        (["--set", "body.upper.mass_kg.x=3"], "the path must end before 'x'"),
        (["--set", "motor.retr.thrust_N=3"], "did you mean 'retro'?"),
        (["--set", "phase.guidd.until.stroke_mm=3"], "did you mean 'guided'?"),
        (["--set", "body.upper.cg_mm.w=3"], "'w' is no component; allowed: x, y, z"),
        (["--set", "run.cases=0"], "run.cases = 0: must be >= 1"),
        # says 'inertia_kg_m2' is missing
        (["--set", "body.uper.mass_kg=3"], "did you mean 'upper'?"),
        (["--set", "body.upper.cg_mm.xx=3"], "xx"),  # taken for x
        (["--set", "body.upper.inertia_kg_m2.xy=3"], "xy"),  # taken for xx
        (["--set", "body.upper.mass_kg=\udcff"], "body.upper.mass_kg"),  # UnicodeEncodeError
        (["--set", 'output.tip_off=["pinz"]'], "no such joint; did you mean 'pins'?"),
        (["--set", "dispersion.body.upper.mass_kg=5"], "such as { uniform = 20.0 }"),
        (["--samples", "plan.md"], "must end in .parquet, .csv"),
        (["--cases", "9" * 20, "--out", "x"], "--cases"),  # writes a manifest, then numpy's message
    ],
)
def test_options(sepmc, options, message):
    Path("plan.md").write_text("a text", encoding="utf-8")
    assert message in sepmc("campaign", "table2", "--quiet", "--no-plots", "--cases", "2", *options)


@pytest.mark.parametrize(
    "options", [["--case", "-1"], ["--case", "a"], ["--every-s", "0"], ["--every-s", "nan"]]
)
def test_options_of_run(sepmc, options):
    """nan: an empty run folder is left behind."""
    assert options[0].strip("-") in sepmc("run", "table2", "--quiet", "--no-plots", *options)


def test_folder_that_cannot_be_used(sepmc):
    """A file in the way, a place below a file, a folder of other things: even with --overwrite or
    --resume."""
    Path("file").write_text("mine", encoding="utf-8")
    Path("mine").mkdir()
    Path("mine/notes.txt").write_text("mine", encoding="utf-8")
    for command in ("campaign", "run"):
        flags = (
            [[], ["--overwrite"], ["--resume"]] if command == "campaign" else [[], ["--overwrite"]]
        )
        for flag in flags:
            assert "file: is a file" in sepmc(command, "table2", "--quiet", "--out", "file", *flag)
            assert "file/below: cannot be written" in sepmc(
                command, "table2", "--quiet", "--out", "file/below", *flag
            )
            message = sepmc(command, "table2", "--quiet", "--out", "mine", *flag)
            assert message.startswith("error: mine: ")
            assert "is not a run" in message
    for command in ("stats", "plot"):
        assert "mine" in sepmc(command, "mine")
        assert "nowhere" in sepmc(command, "nowhere")


def test_two_columns_of_one_name(pair):
    """A body called as an input, and one called as what a joint writes."""
    renamed = {
        "body.in_initial": {
            "mass_kg": 1.0,
            "inertia_kg_m2": [1.0, 2.0, 2.0],
            "cg_m": [5.0, 0.0, 0.0],
        }
    }
    with pytest.raises(ValueError, match="'in_initial_alpha_deg' would be the name of two columns"):
        _ = pair(renamed | {"dispersion": {"initial.alpha_deg": {"normal": 1.0}}}).layout


def test_a_clearance_of_shells_only(tmp_path):
    """Shells are not held against each other: a clearance between two bodies that have nothing else
    would never be a number."""
    text = (Path(__file__).parents[1] / "scenes" / "disc-in-shell.toml").read_text(encoding="utf-8")
    path = tmp_path / "shells.toml"
    path.write_text(
        text.replace(
            "stations_m = [2.5, 2.5]\nradii_m = [0.0, 0.4]",
            "stations_m = [2.0, 3.0]\nradii_m = [0.4, 0.4]\nhollow = true",
        )
    )
    with pytest.raises(SceneError, match=r"clearance\.c\.bodies.*shells only"):
        package.load(path)


@pytest.mark.parametrize(
    "law",
    [
        {"normal": [700.0, 0.02]},
        {"uniform": [690.0, 710.0]},
        {"triangular": [690.0, 700.0, 710.0]},
        {"normal": [-700.0, 0.02]},
    ],
)
def test_a_relative_law_in_the_unit_of_its_key_is_refused(pair, law):
    """Such a law would be flown at hundreds of times the nominal."""
    path = "body.fore.mass_kg"
    with pytest.raises(SceneError, match=r"relative = true multiplies all numbers by the nominal"):
        pair({"dispersion": {path: law | {"relative": True}}})
    near = {"normal": [1.0, 0.02], "relative": True}
    assert pair({"dispersion": {path: near}}).file.dispersions[0].numbers[0] == 3.0


@pytest.mark.parametrize(
    ("word", "known", "meant"),
    [
        ("hinge", ("fixed", "revolute", "slider"), "revolute"),
        ("ball", ("fixed", "revolute", "spherical"), "spherical"),
        ("weld", ("fixed", "revolute", "spherical"), "fixed"),
        ("gaussian", ("uniform", "normal", "discrete"), "normal"),
        ("clearance_gap", ("no-clearance", "gap_clearance_mm", "gap_clearance_time_s"),
         "gap_clearance_mm"),
        ("speed_separation", ("separation_speed_m_s", "separation_distance_mm"),
         "separation_speed_m_s"),
    ],
)  # fmt: skip
def test_words_of_other_tools_are_understood(word, known, meant):
    """A word of another tool, or parts in another order, lead to the name that is meant."""
    assert nearest(word, known) == f"did you mean {meant!r}?"
