"""Loads of gravity, air and motors on one body, for the reference simulation
`sepmc.validation.lagrange`.

They are written from CONVENTIONS.md, slow and plain, and share no code with the kernels. A key of
the case that this module does not include is refused, so that nothing is ignored silently.
"""

import math
import re
from collections.abc import Mapping
from typing import Any

import numpy as np
from scipy.spatial.transform import Rotation

Array = np.ndarray
EARTH_RADIUS = 6356766.0  # m, US Standard Atmosphere 1976
# US Standard Atmosphere 1976, table 4: geopotential base heights (m) and lapse rates (K/m); the
# last height is the top.
LAYER_BASE = np.array([0.0, 11e3, 20e3, 32e3, 47e3, 51e3, 71e3, 84852.0])
LAYER_LAPSE = np.array([-6.5e-3, 0.0, 1e-3, 2.8e-3, 0.0, -2.8e-3, -2e-3])
AERODYNAMICS = (
    *("reference_area", "reference_length", "axial", "normal", "side", "roll", "yaw", "pitch"),
    *("force_factor", "moment_factor", "moment_point"),
)
MOTOR = (
    *(
        "name",
        "body",
        "thrust",
        "build_up",
        "ignition",
        "delay",
        "burn",
        "station",
        "radius",
        "cant",
        "clock",
        "offset",
    ),
    *("deflection", "deflection_clock"),
)


def refuse_others(table: Mapping[str, Any], known: tuple[str, ...], where: str) -> None:
    """Raise if a table of a case sets a key that is not in ``known``.

    A key whose value is zero, False, None, empty, or a list of zeros counts as not set. ``where``
    is the path of the table, for the message.

    Raises
    ------
    ValueError
        If such a key is set; it names the key.
    """
    for key, value in table.items():
        sets = any(value) if isinstance(value, list | tuple) else value
        if key not in known and sets:
            raise ValueError(f"{where}.{key}: sepmc.validation.lagrange does not support this key")


def density(y: float) -> float:
    """Air density, kg/m3, of the US Standard Atmosphere 1976 (its equations 18, 23, 33 and 42) at
    geometric height y, m; raises ValueError above 86 km."""
    height = EARTH_RADIUS * y / (EARTH_RADIUS + y)
    gas, gravity = 8314.32 / 28.9644, 9.80665  # J/(kg K), m/s2
    temperature, pressure = 288.15, 101325.0
    for base, top, lapse in zip(LAYER_BASE[:-1], LAYER_BASE[1:], LAYER_LAPSE, strict=True):
        rise = min(height, top) - base
        if lapse:
            hotter = temperature + lapse * rise
            pressure *= (temperature / hotter) ** (gravity / (gas * lapse))
            temperature = hotter
        else:
            pressure *= math.exp(-gravity * rise / (gas * temperature))
        if height <= top:
            return pressure / (gas * temperature)
    raise ValueError(f"the 1976 atmosphere ends at a height of 86 km; the height is {y} m")


def polynomial(terms: Mapping[str, float] | None) -> list[tuple[float, int, int]]:
    """Terms of an aerodynamic coefficient, such as ``{"const": 1, "alpha_beta2": 3}``, as a list of
    (coefficient, power of alpha, power of beta); empty for None. Raises ValueError if a key is not
    such a term."""
    table = []
    for key, value in (terms or {}).items():
        power = {"alpha": 0, "beta": 0}
        for part in key.split("_") if key != "const" else ():
            match = re.fullmatch(r"(alpha|beta)(\d*)", part)
            if match is None:
                raise ValueError(
                    f"aerodynamic polynomial: term {key} is unknown; allowed are const and powers "
                    "of alpha and beta, such as alpha_beta2"
                )
            power[match[1]] += int(match[2] or 1)
        table.append((value, power["alpha"], power["beta"]))
    return table


class Body:
    """Body ``name`` of a case: its mass, kg, inertia tensor (3, 3) about its mass centre, kg m2,
    and the external loads on it (`loads`). The case is as `sepmc.validation.lagrange.simulate`
    takes it.

    ``cg`` is the mass centre as a layout point, m; ``aero`` its table of aerodynamics or None;
    ``wind`` the velocity of the air, m/s, ground axes; ``motors`` the motors on it, as `_motor`
    returns them.
    """

    def __init__(self, name: str, case: Mapping[str, Any]):
        data, self.environment = case["body"][name], case["environment"]
        self.mass, self.cg = data["mass"], np.array(data["cg"], float)
        xy, xz, yz = data.get("inertia_products", (0.0, 0.0, 0.0))
        xx, yy, zz = data["inertia"]
        self.inertia = data.get("inertia_factor", 1.0) * np.array(
            [[xx, -xy, -xz], [-xy, yy, -yz], [-xz, -yz, zz]]
        )
        self.aero = data.get("aerodynamics")
        if self.aero:
            refuse_others(self.aero, AERODYNAMICS, f"body.{name}.aerodynamics")
            self.coefficients = [
                polynomial(self.aero.get(k))
                for k in ("axial", "normal", "side", "roll", "yaw", "pitch")
            ]
            self.aero_arm = self.from_cg(self.aero.get("moment_point", self.cg))
        wind = self.environment.get("wind") or {"speed": 0.0, "direction": 0.0}
        refuse_others(wind, ("speed", "direction"), "environment.wind")
        self.wind = wind["speed"] * np.array(
            [np.cos(wind["direction"]), 0.0, np.sin(wind["direction"])]
        )
        self.motors = [self._motor(m) for m in case.get("motor", []) if m["body"] == name]

    def from_cg(self, layout: Any) -> Array:
        """Vector (3,), m, body axes, from the mass centre to a layout point [station, y, z], m."""
        return (np.asarray(layout, float) - self.cg) * (-1.0, 1.0, 1.0)

    def _motor(self, m: Mapping[str, Any]) -> dict[str, Any]:
        """Table ``m`` of a motor with ``build_up``, s (0 if absent), and four entries more:
        ``force``, the direction of its thrust (unit vector, body axes); ``moment``, that of a unit
        thrust about the mass centre, m, body axes; ``ignition`` and ``burnout``, absolute times,
        s."""
        refuse_others(m, MOTOR, f"motor.{m['name']}")
        if isinstance(m.get("ignition"), Mapping):
            refuse_others(m["ignition"], (), f"motor.{m['name']}.ignition")
        clock, b, p = m.get("clock", 0.0), m.get("deflection", 0.0), m.get("deflection_clock", 0.0)
        nozzle_to_body = Rotation.from_euler("XY", [clock, -m["cant"]]).as_matrix()
        force = nozzle_to_body @ (np.cos(b), -np.sin(b) * np.sin(p), np.sin(b) * np.cos(p))
        dy, dz = m.get("offset", (0.0, 0.0))
        radius, ignition = m.get("radius", 0.0), m.get("ignition", 0.0) + m.get("delay", 0.0)
        arm = self.from_cg(
            [m["station"], -radius * np.sin(clock) + dy, radius * np.cos(clock) + dz]
        )
        times = {"ignition": ignition, "burnout": ignition + m.get("burn", np.inf)}
        return {"build_up": 0.0, **m, **times, "force": force, "moment": np.cross(arm, force)}

    def air(self, R: Array, v: Array) -> tuple[float, float, float]:
        """Airspeed, m/s, alpha and beta, rad, from the attitude R (body to ground) and the velocity
        v over ground, m/s, ground axes. In still air both angles are 0, not NaN."""
        u, v, w = R.T @ (v - self.wind)
        return np.sqrt(u * u + v * v + w * w), np.arctan2(-v, u), np.arctan2(w, np.hypot(u, v))

    def loads(
        self, t: float, t_mid: float, height: float, R: Array, v: Array
    ) -> tuple[Array, Array]:
        """Force, N, and moment about the mass centre, N m, of gravity, motors and air, both (3,) in
        body axes, at time t, s.

        Height in m, attitude R from body to ground, velocity v over ground, m/s, ground axes. A
        motor acts if it burns at ``t_mid``, s, the middle of an interval of integration without
        switches: so its thrust has no jump at the ends of the interval.
        """
        e = self.environment
        g = 0.0 if e["gravity"] == "none" else e["surface_gravity"]
        if e["gravity"] == "inverse-square":
            g *= (EARTH_RADIUS / (EARTH_RADIUS + height)) ** 2
        force, moment = -self.mass * g * R[1], np.zeros(3)  # R[1] is the vertical in body axes
        for m in self.motors:
            if m["ignition"] <= t_mid < m["burnout"]:
                build_up = -np.expm1((m["ignition"] - t) / m["build_up"]) if m["build_up"] else 1.0
                thrust = m["thrust"] * build_up
                force, moment = force + thrust * m["force"], moment + thrust * m["moment"]
        if self.aero and e["atmosphere"] == "us1976":
            speed, alpha, beta = self.air(R, v)
            axial, normal, side, roll, yaw, pitch = (
                sum(c * alpha**i * beta**j for c, i, j in p) for p in self.coefficients
            )
            qs = (
                0.5
                * density(height)
                * e.get("density_factor", 1.0)
                * speed**2
                * self.aero["reference_area"]
            )
            air = qs * self.aero.get("force_factor", 1.0) * np.array([-axial, normal, -side])
            qsl = qs * self.aero["reference_length"] * self.aero.get("moment_factor", 1.0)
            force, moment = (
                force + air,
                moment + qsl * np.array([roll, -yaw, pitch]) + np.cross(self.aero_arm, air),
            )
        return force, moment
