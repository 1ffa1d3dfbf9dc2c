"""Reading of the files that a campaign names: their contents are put, as keys, into the TOML tree
of the campaign, which then needs no other file."""

import math
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

from sepmc.formats.datcom import is_datcom, read_datcom
from sepmc.formats.decks import read_deck
from sepmc.formats.soundings import read_air, read_wind
from sepmc.formats.text_table import FormatError
from sepmc.formats.thrust import read_thrust
from sepmc.scene.messages import Problems, shorten
from sepmc.scene.units import UNITS, is_number, split_unit

_ENDINGS = (".csv", ".txt", ".dat", ".tsv", ".parquet")
_ENDINGS_OF = {
    "thrust": (".eng",),
    "deck": (".out", ".dml"),
    "initial": (".oem", ".xml"),
    "mass": (".urdf", ".xml", ".mjcf"),
}
_OPTIONS = ("columns", "engine", "case", "configuration", "sideslip_deg")
_OPTIONS_OF = {
    "initial": ("attitude", "epoch", "azimuth_deg"),
    "mass": ("link", "axes", "origin_m"),
}
_IMPULSE = "total_impulse_"

Tables = Iterator[tuple[str, dict[str, Any], str, dict[str, Any]]]
Read = Callable[[Path, dict[str, Any]], tuple[dict[str, Any], list[str]]]


def file_places(tree: dict[str, Any]) -> Tables:
    """Yield the tables of a campaign that name a file.

    Parameters
    ----------
    tree : dict
        TOML tree of the campaign.

    Yields
    ------
    key_path : str
        TOML path of the table.
    table : dict
        The table itself, which has the key ``file``.
    kind : {"thrust", "deck", "wind", "air", "initial", "mass"}
        What the file contains.
    owner : dict
        Table that contains ``table``: that of the motor (thrust), the aerodynamics (deck), the body
        (mass), ``[environment.wind]``, ``[environment]`` (air) or ``[initial]``.
    """
    motors = tree.get("motor")
    for number, motor in enumerate(motors if isinstance(motors, list) else ()):
        if isinstance(motor, dict):
            name = motor.get("name", number)
            yield from _named(f"motor.{name}.profile", motor.get("profile"), "thrust", motor)
    bodies = tree.get("body")
    for name, body in bodies.items() if isinstance(bodies, dict) else ():
        if not isinstance(body, dict):
            continue
        yield from _named(f"body.{name}.mass_properties", body.get("mass_properties"), "mass", body)
        aero = body.get("aerodynamics")
        if isinstance(aero, dict):
            yield from _named(f"body.{name}.aerodynamics.table", aero.get("table"), "deck", aero)
    environment = tree.get("environment")
    if isinstance(environment, dict):
        yield from _named("environment.air", environment.get("air"), "air", environment)
        wind = environment.get("wind")
        if isinstance(wind, dict):
            yield from _named("environment.wind.profile", wind.get("profile"), "wind", wind)
    initial = tree.get("initial")
    if isinstance(initial, dict):
        yield from _named("initial.trajectory", initial.get("trajectory"), "initial", initial)


def _named(key_path: str, table: Any, kind: str, owner: dict[str, Any]) -> Tables:
    if isinstance(table, dict) and "file" in table:
        yield key_path, table, kind, owner


def read_files(tree: dict[str, Any], folder: Path, problems: Problems) -> list[str]:
    """Replace, in place, each key ``file`` of a campaign and its options by keys with the contents
    of that file; if it cannot be read, remove them.

    Parameters
    ----------
    tree : dict
        TOML tree of the campaign.
    folder : Path
        Folder that relative paths start from.
    problems : Problems
        Receives every file that cannot be read, with the reason, and every quantity that both the
        campaign and a file give.

    Returns
    -------
    list of str
        A sentence on what was read from each file, which begins with the TOML path of its table.
    """
    understood: list[str] = []
    for key_path, table, kind, owner in file_places(tree):
        file = table.pop("file")
        known = _OPTIONS_OF.get(kind, _OPTIONS)
        options: dict[str, Any] = {k: table.pop(k) for k in known if k in table}
        if not isinstance(file, str) or not file:
            problems.add(f"{key_path}.file", "must be the name of a file", file)
            continue
        path = folder / file
        endings = (*_ENDINGS, *_ENDINGS_OF.get(kind, ()))
        if path.suffix.lower() not in endings:
            problems.add(f"{key_path}.file", f"must end in {', '.join(endings)}", file)
            continue
        try:
            if kind == "thrust":
                sentences = _thrust(key_path, table, owner, path, options, problems)
            elif kind in ("initial", "mass"):
                # these readers need scipy, which takes longer to import than most campaigns to read
                if kind == "initial":
                    from sepmc.formats.ccsds import read_initial  # noqa: PLC0415

                    keys, sentences = read_initial(path, _located(options, folder))
                else:
                    from sepmc.formats.mass import read_mass  # noqa: PLC0415

                    keys, sentences = read_mass(path, options)
                _move(key_path, kind, owner, keys, problems)
            elif kind == "deck" and path.suffix.lower() == ".dml":
                from sepmc.formats.daveml import read_daveml  # noqa: PLC0415

                table_read, sentences = read_daveml(path, options, owner)
                if "interpolation" in table:
                    del table_read["interpolation"]
                _fill(key_path, table, table_read, problems)
            elif kind == "deck" and is_datcom(path):
                table_read, sentences = read_datcom(path, options, owner)
                _fill(key_path, table, table_read, problems)
            else:
                read: Read = {"deck": read_deck, "air": read_air, "wind": read_wind}[kind]
                table_read, sentences = read(path, options)
                if kind == "deck" and owner.get("convention") != "datcom":
                    sentences += _side_sign(table_read)
                _fill(key_path, table, table_read, problems)
        except FormatError as error:
            problems.add(f"{key_path}.file", str(error), file)
            continue
        understood += [f"{key_path}: {shorten(file)}: {'; '.join(sentences)}"]
    return understood


def _side_sign(table: dict[str, Any]) -> list[str]:
    """Sentence on the sign in which the side force of a deck is taken; an empty list if the deck
    has no side force."""
    if not {"side", "side_p", "side_r"} & table.keys():
        return []
    return [
        "C_Y taken as it stands, positive to the LEFT; if it points right, as in DATCOM, give "
        'convention = "datcom"'
    ]


def _located(options: dict[str, Any], folder: Path) -> dict[str, Any]:
    """Options of a trajectory in which the path of the attitude file, ``file`` of the table
    ``attitude``, if there is one, is preceded by the folder of the campaign; the given options are
    not changed."""
    attitude = options.get("attitude")
    if isinstance(attitude, dict) and isinstance(attitude.get("file"), str):
        return options | {"attitude": attitude | {"file": str(folder / attitude["file"])}}
    return options


def _move(
    key_path: str, kind: str, owner: dict[str, Any], keys: dict[str, Any], problems: Problems
) -> None:
    """Remove from ``owner`` the table at ``key_path``, which named the file, and put the keys read
    from the file into ``owner`` instead. Adds a problem for each other key of that table, which
    lists the keys allowed for its ``kind`` (a key of `_OPTIONS_OF`), and for each quantity that
    ``owner`` gives too; the value of the file then replaces one of an equal key."""
    parent, _, name = key_path.rpartition(".")
    for key in owner.pop(name):
        allowed = ", ".join(("file", *_OPTIONS_OF[kind]))
        problems.add(f"{key_path}.{key}", f"unknown key; allowed: {allowed}")
    _fill(parent, owner, keys, problems)


def _fill(
    key_path: str, table: dict[str, Any], table_read: dict[str, Any], problems: Problems
) -> None:
    """Put the keys read from a file (``table_read``) into ``table``, the one at ``key_path``, in
    place of equal keys. Adds a problem for each quantity that both give, in whatever unit."""
    own = {split_unit(key)[0] for key in table}
    for key, value in table_read.items():
        if split_unit(key)[0] in own:
            problems.add(f"{key_path}.{key}", "is given by the file too: leave it out here")
        table[key] = value


def _thrust(
    key_path: str,
    profile: dict[str, Any],
    motor: dict[str, Any],
    path: Path,
    options: dict[str, Any],
    problems: Problems,
) -> list[str]:
    """Put the thrust curve in a file into ``profile``, the table at ``key_path``. Forces become
    fractions of the thrust in ``motor``, which gets the peak as ``thrust_N`` if it has none; a
    curve of fractions is taken as it is. A key ``total_impulse_...`` of ``profile`` is removed, and
    forces are scaled to that impulse (with fractions it is a problem). ``options`` are those of
    `read_thrust`. Adds problems; returns sentences on what was read. Raises FormatError if the file
    is rejected."""
    curve = read_thrust(path, options)
    understood = curve.understood
    if any(split_unit(key)[0] == "build_up" and value for key, value in motor.items()):
        understood.append("build_up_s multiplies the curve too")
    wanted = next((key for key in profile if key.startswith(_IMPULSE)), None)
    factor = 1.0
    if wanted is not None:
        value, unit = profile.pop(wanted), wanted.removeprefix(_IMPULSE)
        size = UNITS["force"].get(unit.removesuffix("_s"))
        if size is None or not unit.endswith("_s") or not (is_number(value) and value > 0.0):
            problems.add(f"{key_path}.{wanted}", "must be an impulse > 0, total_impulse_N_s", value)
            return understood
        if curve.is_fraction or not curve.impulse > 0.0:
            reason = "scales a curve of forces: the file must have forces, with a positive impulse"
            problems.add(f"{key_path}.{wanted}", reason)
            return understood
        factor = value * size / curve.impulse
        if not math.isfinite(factor * max(map(abs, curve.thrust))):
            problems.add(
                f"{key_path}.{wanted}",
                "is too large for a curve of almost no duration: check the times of the file",
            )
            return understood
        understood.append(f"scaled by {factor:.6g} to an impulse of {value * size:.6g} N s")
    for key in ("time", "fraction"):
        if any(split_unit(each)[0] == key for each in profile):
            problems.add(f"{key_path}.{key}", "is given by the file too: leave it out here")
    thrust_key = next((key for key in motor if split_unit(key)[0] == "thrust"), None)
    if curve.is_fraction:
        fractions = curve.thrust
    else:
        full = max(map(abs, curve.thrust)) * factor
        if thrust_key is None:
            motor["thrust_N"] = full
            understood.append(f"thrust_N = {full:.6g}, the peak of the curve")
        else:
            given, unit = motor[thrust_key], split_unit(thrust_key)[1]
            if is_number(given) and given and unit in UNITS["force"]:
                full = float(given) * UNITS["force"][unit]
                understood.append(
                    f"fractions of {thrust_key} = {given:g}: the curve keeps its newtons"
                )
        if not full:
            raise FormatError("has no thrust at all: every force is 0")
        fractions = [f * factor / full for f in curve.thrust]
    profile["time_s"], profile["fraction"] = curve.time, fractions
    return understood
