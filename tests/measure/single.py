"""Time of the nominal case of every shipped campaign, and of hard scenes, each by `sepmc run` and
`sepmc check` in its own process: ``python tests/measure/single.py [NAME]``.

Cold is with an empty cache of compiled code and of kernels, warm is the same again. The last column
is the message on long simulations before they begin.
"""

import os
import subprocess
import sys
import tempfile
import time
import tomllib
from importlib.resources import files
from pathlib import Path

from sepmc.scene.campaign_files import shipped_campaigns

MOST_S, LIMIT_S = 10.0, 300.0
SAID = ("takes plain Python about", "its integrations take up to about", "compiling")
_HOT = """
reference_area_m2 = 1.0
reference_length_m = 1.0
axial = { const = 0.3 }
normal = { alpha = 2.0 }
side = { beta = 2.0 }
pitch = { alpha = -0.3 }
yaw = { beta = 0.3 }
"""
_MOTE = """
environment = { atmosphere = "none", gravity = "none" }
body.fore = { mass_kg = 1e5, inertia_kg_m2 = [3e5, 4e5, 5e5], cg_m = [1, 0, 0] }
body.aft = { mass_kg = 1e-4, inertia_kg_m2 = [1e-7, 2e-7, 2.5e-7], cg_m = [3, 0.1, 0] }
joint.pins = { bodies = ["fore", "aft"], point_m = [2, 0, 0] }
phase = [{ name = "held", joints = { pins = "spherical" }, until = { time_s = 0.5 } },
         { name = "free" }]
initial = { altitude_m = 1000, speed_m_s = 1, omega_deg_s = [18000, 0, 300] }
run = { end_time_s = 1 }
"""
_REVERSES = """
load = [{ name = "side", body = "aft", force_N = [0, 40, 0] }]
phase = [{ name = "guided", joints = { pins = "slider" } }]
initial = { altitude_m = 1000, speed_m_s = 1 }
run = { end_time_s = 4 }
environment = { atmosphere = "none", gravity = "none" }
body.fore = { mass_kg = 30, inertia_kg_m2 = [3, 4, 5], cg_m = [1, 0, 0] }
body.aft = { mass_kg = 10, inertia_kg_m2 = [1, 2, 2], cg_m = [3, 0.1, 0] }
[joint.pins]
bodies = ["fore", "aft"]
point_m = [2, 0, 0]
guide = { pins = 2, engaged_m = 2.0, circle_m = 0.2, friction = 0.2 }
[[spring]]
name = "swings"
bodies = ["fore", "aft"]
point_m = [2, 0, 0]
axis = [-1, 0, 0]
force_N = 60
stiffness_N_per_m = 4000
"""


def scenes(folder):
    """Files (name, path): shipped campaigns, the starter, and hard scenes, written to a folder."""
    starter = files("sepmc").joinpath("template.toml").read_text(encoding="utf-8")
    flown = starter.replace('atmosphere = "none"', 'atmosphere = "us1976"')
    for body in ("upper", "lower"):
        outline = f"[[body.{body}.outline]]"
        flown = flown.replace(outline, f"[body.{body}.aerodynamics]{_HOT}{outline}", 1)
    far = flown.replace("cg_m = [2.0, 0.0, 0.0]", "cg_m = [1950.0, 0.0, 0.0]")
    layers = flown.replace("end_time_s = 1.5", "end_time_s = 60")
    layers = layers.replace("altitude_km = 60.0", "altitude_km = 9").replace("= 1500.0", "= 1250")
    texts = {
        "starter": starter,
        "millimetres-as-metres": far.replace("altitude_km = 60.0", "altitude_km = 12"),
        "layers-at-mach-4": layers,
        "mote-on-a-top": _MOTE,
        "friction-that-reverses": _REVERSES,
    }
    for name, text in texts.items():
        tomllib.loads(text)
        (folder / f"{name}.toml").write_text(text)
    shipped = {name: str(path) for name, path in shipped_campaigns().items()}
    return shipped | {name: str(folder / f"{name}.toml") for name in texts}


def timed(command, cache):
    """Seconds of a command, its exit code, and its message on its duration."""
    begun = time.perf_counter()
    environment = os.environ | {"SEPMC_CACHE_DIR": str(cache)}
    try:
        process = subprocess.run(
            [sys.executable, "-m", "sepmc", *command],
            capture_output=True,
            text=True,
            env=environment,
            timeout=LIMIT_S,
            check=False,
        )
    except subprocess.TimeoutExpired:
        return LIMIT_S, "stopped", ""
    lines = (process.stdout + process.stderr).splitlines()
    said = next((line for line in lines if any(word in line for word in SAID)), "")
    return time.perf_counter() - begun, str(process.returncode), said


def main():
    """Print the table; exit code 1 if a scene takes longer than allowed without a message."""
    late = 0
    with tempfile.TemporaryDirectory() as made:
        folder = Path(made)
        files_of = scenes(folder)
        names = sys.argv[1:] or list(files_of)
        print(f"{'scene':24s} {'check':>8s} {'cold':>8s} {'warm':>8s}  exit  said before")
        for name in names:
            run = ["run", files_of[name], "--out", str(folder / "run"), "--overwrite", "--no-plots"]
            check = timed(["check", files_of[name]], folder / name)
            cold, warm = timed(run, folder / name), timed(run, folder / name)
            late += check[0] > MOST_S
            late += max(cold[0], warm[0]) > MOST_S and not cold[2]
            print(
                f"{name:24s} {check[0]:8.1f} {cold[0]:8.1f} {warm[0]:8.1f}  {warm[1]:>4s}  "
                f"{cold[2]}",
                flush=True,
            )
    print(f"{late} take longer than {MOST_S:g} s and said nothing before")
    return int(late > 0)


if __name__ == "__main__":
    sys.exit(main())
