"""Scenes that together have every kind of joint, load, phase end and atmosphere."""

import tomllib

from sepmc.campaign.campaign import Campaign
from sepmc.scene.read import parse_campaign

# two bodies on one axis in empty space, 3 kg ahead of 1 kg, mass centre at station 1.5 m
BODIES = """
environment = { atmosphere = "none", gravity = "none" }
[body.fore]
mass_kg = 3.0
inertia_kg_m2 = [3.0, 4.0, 5.0]
cg_m = [1.0, 0.0, 0.0]
[body.aft]
mass_kg = 1.0
inertia_kg_m2 = [1.0, 2.0, 2.0]
cg_m = [3.0, 0.0, 0.0]
"""

# these bodies, held together; nothing acts on them
PAIR = (
    BODIES
    + """
[joint.pins]
bodies = ["fore", "aft"]
point_m = [2.0, 0.0, 0.0]
[[phase]]
name = "locked"
joints = { pins = "fixed" }
[initial]
altitude_m = 1000.0
speed_m_s = 1.0
[run]
end_time_s = 0.5
[solver]
step_s = 0.05
"""
)

# these bodies, separated by a spring
SPRUNG = (
    BODIES
    + """
[[spring]]
name = "push"
bodies = ["fore", "aft"]
point_m = [2.0, 0.0, 0.0]
axis = [1.0, 0.0, 0.0]
force_N = 30.0
stroke_m = 0.02
[joint.pins]
bodies = ["fore", "aft"]
point_m = [2.0, 0.0, 0.0]
[[phase]]
name = "locked"
joints = { pins = "fixed" }
until = { time_s = 0.05 }
[[phase]]
name = "free"
[initial]
altitude_m = 1000.0
speed_m_s = 1.0
[run]
end_time_s = 0.3
cases = 12
seed = 4
[solver]
step_s = 0.05
[dispersion]
"body.fore.mass_kg" = { uniform = 0.5 }
"spring.push.force_N" = { normal = 1.0, truncate_sigma = 3 }
"""
)

# A spring between the two bodies of `conftest.pair`, and their reduced mass, kg.
PUSH = {
    "name": "push",
    "bodies": ["fore", "aft"],
    "point_m": [2.0, 0.0, 0.0],
    "axis": [-1.0, 0.0, 0.0],
    "force_N": 12.0,
}
REDUCED = 3.0 * 1.0 / (3.0 + 1.0)

# An arm and a bob hang from the ground in a wind: universal, spherical and revolute joints,
# aerodynamics with every term, phases that end by a time, a distance and a stroke along a custom
# joint's axis, a delay, constant gravity, motors with tail-off and profile,
# loads that come and go in both frames.
HANGING = """
[environment]
gravity = "constant"
surface_gravity_m_s2 = 9.7
density_factor = 1.2
[environment.wind]
speed_m_s = 9.0
direction_deg = 70.0
[body.arm]
mass_kg = 8.0
inertia_kg_m2 = [1.0, 4.0, 4.2]
inertia_products_kg_m2 = [0.1, -0.05, 0.08]
cg_m = [1.0, 0.02, -0.01]
[body.bob]
mass_kg = 3.0
inertia_kg_m2 = [0.4, 0.7, 0.6]
cg_m = [2.6, -0.03, 0.02]
[body.bob.aerodynamics]
reference_area_m2 = 0.2
reference_length_m = 0.4
moment_point_m = [2.7, 0.0, 0.0]
axial = { const = 0.3, alpha2 = 0.4 }
normal = { alpha = 1.1, alpha_beta = 0.3 }
side = { beta = 0.9, beta2 = 0.2 }
roll = { const = 0.01 }
pitch = { const = 0.02, alpha = -0.1, alpha3 = 0.05 }
yaw = { beta = -0.1 }
[body.plate]
mass_kg = 1.5
inertia_kg_m2 = [0.1, 0.2, 0.2]
cg_m = [3.4, 0.1, 0.0]
[[motor]]
name = "kick"
body = "bob"
thrust_N = 30.0
build_up_s = 0.03
ignition_s = 0.05
delay_s = 0.01
burn_s = 0.15
tail_off_s = 0.04
station_m = 2.8
offset_m = [0.01, 0.02]
cant_deg = 80.0
clock_deg = 40.0
[[motor]]
name = "spin"
body = "plate"
thrust_N = 12.0
profile = { time_s = [0.0, 0.1, 0.35], fraction = [0.2, 1.0, 0.5] }
station_m = 3.3
radius_m = 0.1
cant_deg = 100.0
[[load]]
name = "tug"
body = "bob"
force_N = [0.0, 8.0, -3.0]
moment_N_m = [0.2, 0.0, 0.1]
point_m = [2.5, 0.1, 0.0]
start_s = 0.1
end_s = 0.33
[[load]]
name = "drift"
body = "plate"
force_N = [3.0, -2.0, 1.0]
frame = "ground"
[[spring]]
name = "damper"
bodies = ["arm", "bob"]
point_m = [1.4, 0.2, 0.0]
second_point_m = [2.4, 0.3, 0.1]
force_N = -5.0
stiffness_N_per_m = 40.0
damping_N_s_per_m = 6.0
[[spring]]
name = "ejector"
bodies = ["bob", "plate"]
point_m = [3.1, 0.05, 0.05]
axis = [-1.0, 0.0, 0.0]
force_N = 60.0
stiffness_N_per_m = 300.0
stroke_mm = 40.0
[joint.nail]
bodies = ["ground", "arm"]
point_m = [0.0, 0.0, 0.0]
x_axis = [0.9, 0.3, -0.2]
y_axis = [0.1, 1.0, 0.3]
[joint.elbow]
bodies = ["arm", "bob"]
point_m = [2.0, 0.0, 0.0]
x_axis = [0.2, 0.1, 1.0]
y_axis = [1.0, 0.2, 0.0]
delay_s = 0.004
[joint.rail]
bodies = ["plate", "bob"]
point_m = [3.1, 0.0, 0.0]
y_axis = [0.0, 0.8, 0.6]
[joint.rail.kind.loose]
translations = ["y", "z"]
rotations = ["x"]
[[phase]]
name = "folded"
joints = { nail = "universal", elbow = "revolute", rail = "fixed" }
until = { time_s = 0.12 }
[[phase]]
name = "hinged"
joints = { nail = "universal", elbow = "spherical", rail = "fixed" }
until = { time_s = 0.2 }
[[phase]]
name = "swinging"
joints = { nail = "universal", rail = "fixed" }
until = { joint = "elbow", distance_mm = 40.0 }
[[phase]]
name = "sliding"
joints = { nail = "spherical", rail = "slider" }
until = { joint = "rail", stroke_mm = 25.0 }
[[phase]]
name = "rolling"
joints = { nail = "spherical", rail = "loose" }
until = { joint = "rail", stroke_mm = 60.0 }
[[phase]]
name = "free"
joints = { nail = "spherical" }
[output]
tip_off = ["elbow", "rail"]
[initial]
altitude_m = 20.0
speed_m_s = 0.0
pitch_deg = -35.0
yaw_deg = 10.0
[run]
end_time_s = 0.8
cases = 40
seed = 11
[solver]
accuracy = 1e-9
[dispersion]
"joint.elbow.delay_s" = { uniform = [0.0, 0.01] }
"motor.kick.delay_s" = { uniform = [0.0, 0.02] }
"motor.spin.thrust_N" = { uniform = 1.0 }
"load.tug.force_N.y" = { normal = 1.0 }
"phase.folded.until.time_s" = { uniform = 0.02 }
"phase.swinging.until.distance_mm" = { uniform = 5.0 }
"environment.density_factor" = { uniform = 0.1 }
"environment.wind.speed_m_s" = { uniform = 2.0 }
"initial.pitch_deg" = { uniform = 5.0 }
"body.bob.mass_kg" = { uniform = 0.2 }
"body.bob.cg_mm.y" = { uniform = 5.0 }
"""

# Three bodies in a ring of two ball joints and a rod, and a fourth that leaves on a plane, then on
# a point, while they tumble.
RING = """
environment = { atmosphere = "none", gravity = "inverse-square" }
[body.one]
mass_kg = 4.0
inertia_kg_m2 = [0.8, 1.5, 1.4]
inertia_products_kg_m2 = [0.1, 0.0, -0.1]
cg_m = [0.0, 0.0, 0.0]
[body.two]
mass_kg = 2.0
inertia_kg_m2 = [0.3, 0.5, 0.6]
cg_m = [1.2, 0.4, 0.0]
[body.three]
mass_kg = 3.0
inertia_kg_m2 = [0.5, 0.4, 0.7]
cg_m = [0.5, 1.3, 0.2]
[body.four]
mass_kg = 1.0
inertia_kg_m2 = [0.1, 0.12, 0.15]
cg_m = [-0.8, -0.3, 0.1]
[[spring]]
name = "across"
bodies = ["one", "three"]
point_m = [0.1, 0.3, 0.3]
second_point_m = [0.4, 0.9, 0.3]
force_N = 25.0
stiffness_N_per_m = 90.0
damping_N_s_per_m = 3.0
[[spring]]
name = "pusher"
bodies = ["one", "four"]
point_m = [-0.5, -0.2, 0.1]
axis = [1.0, 0.0, 0.0]
force_N = 40.0
stiffness_N_per_m = 200.0
stroke_mm = 30.0
[[load]]
name = "side"
body = "four"
force_N = [3.0, 1.0, 2.0]
[joint.ball]
bodies = ["one", "two"]
point_m = [0.6, 0.2, 0.0]
[joint.eye]
bodies = ["two", "three"]
point_m = [1.0, 0.9, 0.1]
[joint.link]
bodies = ["three", "one"]
point_m = [0.2, 1.1, 0.2]
second_point_m = [-0.2, 0.4, 0.0]
[joint.seat]
bodies = ["one", "four"]
point_m = [-0.5, -0.2, 0.0]
[[phase]]
name = "closed"
joints = { ball = "spherical", eye = "spherical", link = "rod", seat = "cylindrical" }
until = { joint = "seat", stroke_mm = 50.0 }
[[phase]]
name = "leaving"
joints = { ball = "spherical", eye = "spherical", link = "rod", seat = "point-on-line" }
until = { time_s = 0.45 }
[[phase]]
name = "open"
joints = { ball = "spherical", eye = "spherical", seat = "point-on-line" }
until = { joint = "link", distance_m = 0.86 }
[[phase]]
name = "loose"
joints = { ball = "spherical" }
[output]
tip_off = ["link", "seat"]
[initial]
altitude_m = 3000.0
speed_m_s = 20.0
omega_rad_s = [1.2, -0.7, 0.9]
pitch_deg = 15.0
[run]
end_time_s = 1.0
cases = 40
seed = 12
[solver]
accuracy = 1e-9
[dispersion]
"joint.link.delay_s" = { uniform = [0.0, 0.01] }
"initial.omega_rad_s.x" = { uniform = 0.2 }
"body.four.mass_kg" = { uniform = 0.1 }
"body.two.inertia_factor" = { uniform = 0.1 }
"spring.pusher.force_N" = { normal = 2.0 }
"spring.pusher.stroke_mm" = { uniform = 5.0 }
"spring.across.damping_N_s_per_m" = { uniform = 1.0 }
"phase.leaving.until.time_s" = { uniform = 0.02 }
"""

# Three stages on two sliders one behind the other, released in turn, in thin air: the order of
# bodies in a state is not that of the file.
STACK = """
[environment.wind]
speed_m_s = 10.0
direction_deg = 30.0
[body.low]
mass_kg = 400.0
inertia_kg_m2 = [60.0, 900.0, 900.0]
cg_m = [6.0, 0.01, 0.0]
[body.mid]
mass_kg = 200.0
inertia_kg_m2 = [25.0, 160.0, 165.0]
cg_m = [3.5, 0.0, 0.01]
[body.top]
mass_kg = 100.0
inertia_kg_m2 = [8.0, 40.0, 40.0]
cg_m = [1.2, 0.0, 0.0]
[body.top.aerodynamics]
reference_area_m2 = 0.4
reference_length_m = 1.0
axial = { const = 0.2 }
normal = { alpha = 1.5 }
side = { beta = 1.5 }
pitch = { alpha = -0.5 }
yaw = { beta = 0.5 }
[body.low.aerodynamics]
reference_area_m2 = 0.6
reference_length_m = 1.0
axial = { const = 0.4 }
[[motor]]
name = "retro"
body = "low"
thrust_N = 1500.0
build_up_s = 0.05
station_m = 7.0
cant_deg = 178.0
[[spring]]
name = "left"
bodies = ["mid", "top"]
point_m = [2.4, 0.2, 0.1]
axis = [1.0, 0.0, 0.0]
force_N = 900.0
stiffness_N_per_m = 4000.0
stroke_mm = 60.0
[[spring]]
name = "right"
bodies = ["mid", "top"]
point_m = [2.4, -0.2, -0.1]
axis = [1.0, 0.0, 0.0]
force_N = 900.0
stiffness_N_per_m = 4000.0
stroke_mm = 80.0
[joint.upper]
bodies = ["mid", "top"]
point_m = [2.4, 0.0, 0.0]
[joint.lower]
bodies = ["low", "mid"]
point_m = [4.8, 0.0, 0.0]
[[phase]]
name = "locked"
joints = { upper = "fixed", lower = "fixed" }
until = { time_s = 0.05 }
[[phase]]
name = "first"
joints = { upper = "slider", lower = "fixed" }
until = { joint = "upper", stroke_mm = 40.0 }
[[phase]]
name = "between"
joints = { lower = "fixed" }
until = { time_s = 0.3 }
[[phase]]
name = "second"
joints = { lower = "slider" }
until = { joint = "lower", stroke_mm = 30.0 }
[[phase]]
name = "free"
[output]
tip_off = ["upper", "lower"]
[initial]
altitude_m = 45000.0
speed_m_s = 900.0
alpha_deg = 3.0
pitch_deg = 20.0
omega_deg_s = [5.0, 2.0, -3.0]
[run]
end_time_s = 0.7
cases = 40
seed = 13
[solver]
accuracy = 1e-9
[dispersion]
"phase.between.until.time_s" = { uniform = 0.02 }
"body.top.mass_kg" = { uniform = 5.0 }
"body.low.cg_mm.y" = { uniform = 5.0 }
"spring.left.force_N" = { normal = 20.0 }
"spring.right.stroke_mm" = { uniform = 5.0 }
"initial.alpha_deg" = { uniform = 1.0 }
"initial.altitude_m" = { uniform = 500.0 }
"motor.retro.deflection_deg" = { uniform = 0.5 }
"""

SCENES = {"hanging": HANGING, "ring": RING, "stack": STACK}


def scene(name, settings=None):
    """One of these campaigns."""
    return Campaign(parse_campaign(tomllib.loads(SCENES[name]), name, settings))
