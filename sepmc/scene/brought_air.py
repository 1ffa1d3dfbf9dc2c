"""Conversion of air and wind in other conventions: pressure and temperature, geopotential heights,
the direction from which the wind comes."""

import math
from typing import Any

from sepmc.physics.atmosphere import sound_speed, us1976
from sepmc.physics.us1976_table import M0, R0, R_STAR, TOP
from sepmc.scene.messages import Problems
from sepmc.scene.units import UNITS, is_number, split_unit

_GAS = R_STAR / M0  # J/(kg K)
_ABOVE = 500.0  # m, between rows that are added from the standard
_CELSIUS = 273.15
_COLD, _HOT = 100.0, 1e4  # K, of air


def convert_air(key_path: str, environment: dict[str, Any], problems: Problems) -> list[str]:
    """Convert a table of air in place: pressure and temperature to density and speed of sound, and
    geopotential to geometric heights; with ``above`` add rows of the standard atmosphere above the
    last row.

    Parameters
    ----------
    key_path : str
        TOML path of the table ``air``.
    environment : dict
        Table [environment], whose table ``air`` is changed in place.
    problems : Problems
        Receives every problem.

    Returns
    -------
    list of str
        A sentence for each conversion; empty without a table ``air``.
    """
    air = environment.get("air")
    if not isinstance(air, dict):
        return []
    understood = [
        *_heights(key_path, air, problems),
        *_state(key_path, air, problems),
        *_above(key_path, air, problems),
    ]
    return understood


def _heights(key_path: str, air: dict[str, Any], problems: Problems) -> list[str]:
    key = next((k for k in air if split_unit(k)[0] == "geopotential"), None)
    if key is None:
        return []
    unit = split_unit(key)[1]
    heights = _numbers(air[key])
    if heights is None or unit not in UNITS["length"]:
        reason = "must be a list of heights with a unit, such as geopotential_m = [0.0, 1000.0]"
        problems.add(f"{key_path}.{key}", reason)
        return []
    if any(split_unit(k)[0] == "altitude" for k in air):
        problems.add(f"{key_path}.{key}", "stands beside an altitude: give one of the two")
        return []
    factor = UNITS["length"][unit]
    del air[key]
    air["altitude_m"] = [
        R0 * h * factor / (R0 - h * factor) for h in heights
    ]  # equation 19 of the standard
    return [f"{key_path}: geopotential heights H converted to geometric ones, r0 H / (r0 - H)"]


def _state(key_path: str, air: dict[str, Any], problems: Problems) -> list[str]:
    keys = {split_unit(k)[0]: k for k in air}
    is_celsius = "temperature_degC" in air
    given = is_celsius or "temperature" in keys, "pressure" in keys
    if not any(given):
        return []
    if not all(given) or "density" in keys:
        problems.add(
            key_path,
            "needs pressure_Pa and temperature_K together, or density_kg_per_m3 in place of both",
        )
        return []
    key = "temperature_degC" if is_celsius else keys["temperature"]
    unit = split_unit(keys["pressure"])[1]
    if unit not in UNITS["pressure"] or not (is_celsius or split_unit(key)[1] == "K"):
        wrong = keys["pressure"] if unit not in UNITS["pressure"] else key
        units = ", ".join(f"pressure_{each}" for each in UNITS["pressure"])
        allowed = "temperature_K, temperature_degC" if wrong == key else units
        problems.add(f"{key_path}.{wrong}", f"must end in a unit; allowed: {allowed}")
        return []
    temperatures, pressures = _numbers(air[key]), _numbers(air[keys["pressure"]])
    if temperatures is None or pressures is None or len(temperatures) != len(pressures):
        reason = "temperature and pressure must be lists of equally many numbers"
        problems.add(f"{key_path}.{key}", reason)
        return []
    kelvin = [t + _CELSIUS for t in temperatures] if is_celsius else temperatures
    if not all(_COLD < t < _HOT for t in kelvin):
        problems.add(
            f"{key_path}.{key}", f"must be temperatures of {_COLD:g} to {_HOT:g} K", air[key]
        )
        return []
    del air[key], air[keys["pressure"]]
    factor = UNITS["pressure"][unit]
    air["density_kg_per_m3"] = [
        p * factor / (_GAS * t) for p, t in zip(pressures, kelvin, strict=True)
    ]
    if "speed_of_sound" not in keys:
        air["speed_of_sound_m_s"] = [math.sqrt(1.4 * _GAS * t) for t in kelvin]
    return [
        f"{key_path}: density p / (R T) with R = {_GAS:.6g} J/(kg K), speed of sound "
        "sqrt(1.4 R T), from pressure and temperature of dry air"
    ]


def _above(key_path: str, air: dict[str, Any], problems: Problems) -> list[str]:
    if (above := air.pop("above", None)) is None:
        return []
    if above != "us1976":
        problems.add(f"{key_path}.above", 'must be "us1976"', above)
        return []
    keys = {split_unit(k)[0]: k for k in air}
    columns = [keys.get(name) for name in ("altitude", "density")]
    values = [_numbers(air.get(key or "")) for key in columns]
    if values[0] is None or values[1] is None or len(values[0]) != len(values[1]):
        reason = "needs altitude_m and density_kg_per_m3, lists of equally many numbers"
        problems.add(f"{key_path}.above", reason)
        return []
    (height_key, density_key), (heights, densities) = columns, values
    assert height_key is not None and heights is not None  # noqa: PT018
    assert density_key is not None and densities is not None  # noqa: PT018
    length = UNITS["length"].get(split_unit(height_key)[1])
    density = UNITS["density"].get(split_unit(density_key)[1])
    if length is None or density is None or not heights:
        return []  # noted by the model

    top = heights[-1] * length
    rows = [h for h in _rising(top) if h > top]
    states = [tuple(map(float, us1976(h))) for h in rows]
    air[height_key] = heights + [h / length for h in rows]
    air[density_key] = densities + [state[0] / density for state in states]
    if sound_key := keys.get("speed_of_sound"):
        factor = UNITS["speed"].get(split_unit(sound_key)[1], 1.0)
        air[sound_key] = list(air[sound_key]) + [sound_speed(state[2]) / factor for state in states]
    return [
        f"{key_path}: {len(rows)} rows of the standard atmosphere above {top:.6g} m, every "
        f"{_ABOVE:g} m up to {TOP:g} m"
    ]


def _rising(top: float) -> list[float]:
    first = math.floor(top / _ABOVE) + 1
    heights = [k * _ABOVE for k in range(first, round(TOP / _ABOVE) + 1)]
    return [h for h in heights if h >= top + 0.5 * _ABOVE]


def convert_wind(key_path: str, wind: dict[str, Any], problems: Problems) -> list[str]:
    """Convert wind and its profile in place: ``from_deg``, the compass direction from which the
    wind comes, to ``direction_deg``, the direction from ground x to which it blows (not reduced to
    0 to 360), and geopotential to geometric heights.

    ``from_deg`` needs ``azimuth_deg``, the compass direction of ground x, which is removed from the
    table; without ``from_deg``, or beside ``direction_deg``, either is a problem.

    Parameters
    ----------
    key_path : str
        TOML path of the wind.
    wind : dict
        Table of the wind, changed in place.
    problems : Problems
        Receives every problem.

    Returns
    -------
    list of str
        A sentence for each conversion.
    """
    tables = [(key_path, wind)]
    if isinstance(profile := wind.get("profile"), dict):
        tables.append((f"{key_path}.profile", profile))
    understood = [x for where, table in tables[1:] for x in _heights(where, table, problems)]
    azimuth = wind.pop("azimuth_deg", None)
    used = [(where, table) for where, table in tables if "from_deg" in table]
    if azimuth is not None and not used:
        reason = "belongs to from_deg, which is missing: give from_deg, or leave azimuth_deg out"
        problems.add(f"{key_path}.azimuth_deg", reason, azimuth)
    for where, table in used:
        if not is_number(azimuth):
            problems.add(
                f"{where}.from_deg",
                f"needs {key_path}.azimuth_deg, the compass direction of ground x (downrange)",
            )
            continue
        if "direction_deg" in table or "direction_rad" in table:
            problems.add(
                f"{where}.from_deg", "stands beside direction_deg or direction_rad: give only one"
            )
            continue
        value = table.pop("from_deg")
        values = [value] if is_number(value) else _numbers(value)
        if values is None:
            problems.add(f"{where}.from_deg", "must be a number or a list of numbers", value)
            continue
        turned = [x + 180.0 - azimuth for x in values]
        table["direction_deg"] = turned[0] if is_number(value) else turned
        understood.append(
            f"{where}: from_deg taken as where the wind comes from, by compass; direction_deg = "
            f"from_deg + 180 - {azimuth:g}"
        )
    return understood


def _numbers(value: Any) -> list[float] | None:
    """A TOML value as a list of floats; None if it is no list of finite numbers."""
    if isinstance(value, list) and all(map(is_number, value)):
        return [float(x) for x in value]
    return None
