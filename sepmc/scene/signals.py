"""Signals, formulas of quantities of the flight: reading and checking those of a file, and the
numbers of a scene that signals give during flight."""

import re
from collections.abc import Collection, Mapping
from typing import Any, NamedTuple

import msgspec
import numpy as np

from sepmc.scene.fields import fields_of, keys_of, to_si
from sepmc.scene.formula import (
    CONSTANTS,
    FUNCTIONS,
    FormulaError,
    Node,
    evaluate,
    names,
    parse,
)
from sepmc.scene.limits import LARGEST, NAME
from sepmc.scene.messages import Problems, nearest
from sepmc.scene.model import Driven, Load, Motor, Scene, Signal, Spring
from sepmc.scene.parameters import replace
from sepmc.scene.tables import read_table
from sepmc.scene.terms import signal_terms
from sepmc.scene.units import UNITS, split_unit

# kind of quantity of each name: of time, of a body, of a joint, of a spring, of an event
TIME = {"time": "time"}
OF_BODY = {
    **dict.fromkeys(("pitch", "yaw", "roll", "alpha", "beta"), "angle"),
    **dict.fromkeys(("omega_x", "omega_y", "omega_z"), "angular rate"),
    **dict.fromkeys(("x", "y", "z"), "length"),
    **dict.fromkeys(("vx", "vy", "vz", "airspeed"), "speed"),
    "dynamic_pressure": "pressure",
    "mach": "",
}
OF_JOINT = {
    **{"stroke": "length", "rate": "speed", "time_since_release": "time"},
    **{"angle": "angle", "angle_rate": "angular rate"},
}
OF_EVENT = {"time_since": "time"}
OF_SPRING = {"extension": "length", "rate": "speed"}
_OF_ITEM = {"joint": OF_JOINT, "spring": OF_SPRING, "event": OF_EVENT}
# fields of the tables of arrays that a signal may give
_DRIVEN: dict[str, tuple[type[msgspec.Struct], tuple[str, ...]]] = {
    "load": (Load, ("force", "moment")),
    "motor": (Motor, ("thrust", "deflection", "deflection_clock")),
    "spring": (Spring, ("force", "stiffness", "damping", "factor")),
}
_OWN_KEYS = tuple(keys_of(fields_of(Signal)))
_IDENTIFIER = re.compile(r"[A-Za-z][A-Za-z0-9_]*")
_WORDS = ("and", "or", "not", *FUNCTIONS, *CONSTANTS)
Items = Mapping[str, Collection[str]]  # names by table
_MOST_SAMPLES = 100_000
_TIMES = 400  # times at which `with_sizes` looks for the largest value


class Quantity(NamedTuple):
    """Quantity of the flight that a formula names, such as ``upper.pitch_deg``.

    ``table`` is "time", "body", "joint", "spring" or "event", ``item`` the name of that body,
    joint, spring or event (empty for time), ``key`` the quantity without unit ("pitch",
    "time_since" of an event), ``factor`` the factor from the unit of the name to SI.
    """

    table: str
    item: str
    key: str
    factor: float


def take_driven(tree: dict[str, Any]) -> tuple[dict[str, Any], dict[str, Any]]:
    """Replace by 0, and return, the names of signals that stand in place of numbers in the loads,
    motors and springs of a campaign.

    Parameters
    ----------
    tree : dict
        TOML tree of a campaign; it is not changed.

    Returns
    -------
    tree : dict
        A copy with 0 in place of each name.
    driven : dict of str to (str, Driven)
        For each name, its TOML path, for messages, and its signal with the factor of the key's
        unit; by the path, without units, of the number that the signal gives.
    """
    result, driven = dict(tree), dict[str, Any]()
    for array, (kind, fields) in _DRIVEN.items():
        if not isinstance(tree.get(array), list):
            continue
        keys = {
            key: (field, factor)
            for key, (field, factor) in keys_of(fields_of(kind)).items()
            if field.name in fields
        }
        result[array] = []
        for item in tree[array]:
            table = dict(item) if isinstance(item, dict) else item
            result[array].append(table)
            if not isinstance(item, dict) or not isinstance(item.get("name"), str):
                continue
            for key, (field, factor) in keys.items():
                if key not in item:
                    continue
                where = f"{array}.{item['name']}"
                table[key], taken = _without_names(item[key], field.quantity.components)
                for component, signal in taken:
                    path = ".".join(filter(None, (where, field.name, component)))
                    shown = ".".join(filter(None, (where, key, component)))
                    driven[path] = shown, Driven(signal, factor)
    return result, driven


def _without_names(value: Any, components: tuple[str, ...]) -> tuple[Any, list[tuple[str, str]]]:
    """Copy of a key's value with 0 in place of each name of a signal, and a pair (component, name)
    for each name. ``components`` are the names of the components of a vector, which is a list or a
    table by component; for a number they are empty, and so is the component of a pair. A value of
    another form is returned as it is, with no pairs."""
    if isinstance(value, str):
        return (0.0, [("", value)]) if not components else (value, [])
    if components and isinstance(value, list) and len(value) == len(components):
        taken = [(c, v) for c, v in zip(components, value, strict=True) if isinstance(v, str)]
        return [0.0 if isinstance(v, str) else v for v in value], taken
    if components and isinstance(value, dict):
        taken = [(c, v) for c, v in value.items() if isinstance(v, str) and c in components]
        names_taken = dict(taken)
        return {c: 0.0 if c in names_taken else v for c, v in value.items()}, taken
    return value, []


def read_signals(tree: Any, problems: Problems) -> tuple[Signal, ...]:
    """Convert the array ``[[signal]]`` of a file: keys that are no field of `Signal` become
    constants of its formula. Adds problems. Only entries that cannot be converted to a `Signal` are
    left out: one whose name is reserved or used twice, or whose constant is not valid, stays."""
    if not isinstance(tree, list):
        problems.add("signal", "must be an array of tables: [[signal]]", tree)
        return ()
    signals: list[Signal] = []
    for number, table in enumerate(tree):
        name = table.get("name", number) if isinstance(table, dict) else number
        key_path = f"signal.{name}"
        own = (
            {key: value for key, value in table.items() if key in _OWN_KEYS}
            if isinstance(table, dict)
            else table
        )
        signal = read_table(Signal, own, key_path, problems)
        constants = {
            key: _constant(key, value, f"{key_path}.{key}", problems)
            for key, value in (table.items() if isinstance(table, dict) else ())
            if key not in _OWN_KEYS
        }
        if signal is None:
            continue
        _check_states(signal, key_path, problems)
        if signal.name in _WORDS:
            problems.add(f"{key_path}.name", "is a reserved word of formulas; choose another", name)
        if any(signal.name == other.name for other in signals):
            problems.add(key_path, "the name is used twice")
        signals.append(msgspec.structs.replace(signal, constants=constants))
    return tuple(signals)


def _check_states(signal: Signal, key_path: str, problems: Problems) -> None:
    """Add problems for keys of a signal that exclude or need each other: ``lag_s``, ``servo``,
    ``integral``, ``rate_limit``, ``delay_s``, ``sample_s``, ``initial``; and for a delay beyond
    ``sample_s``."""
    responses = {"lag_s": signal.lag, "servo": signal.servo, "integral": signal.integral or None}
    given = [key for key, value in responses.items() if value is not None]
    if len(given) > 1:
        problems.add(key_path, f"has {' and '.join(given)}: give only one of them")
    if signal.rate_limit is not None and signal.lag is None:
        problems.add(f"{key_path}.rate_limit", "needs lag_s", signal.rate_limit)
    if signal.delay > 0.0 and signal.sample is None:
        problems.add(f"{key_path}.delay_s", "needs sample_s", signal.delay)
    elif signal.sample is not None and signal.delay > signal.sample:
        reason = f"must be at most sample_s = {signal.sample:g}"
        problems.add(f"{key_path}.delay_s", reason, signal.delay)
    if signal.initial != 0.0 and "initial" in signal.without_effect:
        reason = "needs lag_s, servo, integral or delay_s: a formula alone has no initial value"
        problems.add(f"{key_path}.initial", reason, signal.initial)


def _constant(key: str, value: Any, key_path: str, problems: Problems) -> float:
    """Value of the constant ``key`` of a signal, as written in the file; 0, after adding a problem
    at ``key_path``, if its name or value is not valid."""
    if not _IDENTIFIER.fullmatch(key) or len(key) > NAME:
        problems.add(
            key_path, f"a name is a letter followed by at most {NAME - 1} letters, digits or _"
        )
    elif key in _WORDS:
        problems.add(key_path, "is a reserved word of formulas; choose another")
    elif isinstance(value, bool) or not isinstance(value, int | float):
        problems.add(key_path, "must be a number: a constant of the formula", value)
    elif not abs(to_si(value, 1.0)) <= LARGEST:
        problems.add(key_path, f"must be finite and at most {LARGEST:g} in size", value)
    else:
        return float(value)
    return 0.0


def check_signals(
    scene: Scene, driven: Mapping[str, tuple[str, Driven]], problems: Problems
) -> None:
    """Add a problem for each formula that cannot be parsed, name in one that is unknown, constant
    that is not used or has the name of a signal, signal with too many samples, and number of
    ``driven`` (see `take_driven`) whose signal does not exist; and one for the first signal that
    depends on its own present value."""
    for signal in scene.signal:
        if signal.sample is not None and scene.run.end_time / signal.sample > _MOST_SAMPLES:
            reason = (
                f"gives more than {_MOST_SAMPLES:,} samples up to {scene.run.end_time:g} s: "
                "give a longer interval"
            )
            problems.add(f"signal.{signal.name}.sample_s", reason, signal.sample)
    known = [signal.name for signal in scene.signal]
    for shown, drive in driven.values():
        if drive.signal not in known:
            reason = "must be a number or the name of a [[signal]]; "
            problems.add(shown, reason + nearest(drive.signal, known), drive.signal)
    trees: dict[str, Node] = {}
    with_states = [
        signal.name for signal in scene.signal if signal.states or signal.sample is not None
    ]
    for signal in scene.signal:
        key_path = f"signal.{signal.name}.formula"
        try:
            tree = parse(signal.formula)
        except FormulaError as error:
            problems.add(key_path, str(error), signal.formula)
            continue
        trees[signal.name] = tree
        for constant in signal.constants:
            if constant in known:
                reason = "is the name of a signal too; choose another name"
                problems.add(f"signal.{signal.name}.{constant}", reason)
            elif constant not in names(tree):
                reason = "is neither a key of signals nor a constant that the formula names"
                problems.add(f"signal.{signal.name}.{constant}", reason)
        for name in names(tree):
            others = [*signal.constants, *known]
            if name not in others and (reason := _unknown(name, scene, others)):
                problems.add(key_path, f"{name}: {reason}", signal.formula)
    for name in trees:
        direct = {one: tree for one, tree in trees.items() if one not in with_states or one == name}
        if name not in with_states and (cycle := _cycle(name, direct, ())):
            reason = f"depends on itself at once: {' -> '.join(cycle)}"
            remedy = "a lag_s, servo, integral or sample_s in between gives it a state"
            problems.add(f"signal.{name}.formula", f"{reason}; {remedy}")
            break


def _cycle(name: str, trees: Mapping[str, Node], above: tuple[str, ...]) -> tuple[str, ...]:
    """Names of signals on a dependency cycle that is reached from the signal ``name``, the first
    repeated at the end; empty if there is none. ``trees`` are the formulas by signal, ``above`` the
    signals followed so far."""
    if name in above:
        return (*above[above.index(name) :], name)
    for other in names(trees[name]):
        if other in trees and (cycle := _cycle(other, trees, (*above, name))):
            return cycle
    return ()


def quantity(name: str, items: Items) -> Quantity | None:
    """Quantity that a name in a formula means, such as ``time_s``, ``upper.pitch_deg`` or
    ``joint.ring.stroke_m``; None if it is unknown. ``items`` are the names of the scene's bodies,
    joints, springs and events (`items_of`)."""
    *head, last = name.split(".")
    key, unit = split_unit(last)
    if not head:
        table, item, kinds = "time", "", TIME
    elif len(head) == 1 and head[0] in items["body"]:
        table, item, kinds = "body", head[0], OF_BODY
    elif len(head) == 2 and head[0] in _OF_ITEM and head[1] in items[head[0]]:
        table, item, kinds = head[0], head[1], _OF_ITEM[head[0]]
    else:
        return None
    if kinds.get(last) == "":  # a number without a unit
        return Quantity(table, item, last, 1.0)
    factor = UNITS.get(kinds.get(key, ""), {}).get(unit)
    return None if factor is None else Quantity(table, item, key, factor)


def items_of(scene: Scene) -> Items:
    """Names of the bodies, joints, springs and events of a scene, by "body", "joint", "spring" and
    "event"."""
    return {
        "body": list(scene.body),
        "joint": list(scene.joint),
        "spring": [spring.name for spring in scene.spring],
        "event": [event.name for event in scene.event],
    }


def _unknown(name: str, scene: Scene, others: list[str]) -> str:
    """Reason, for a message, why a formula cannot use ``name``; empty if it is a quantity that the
    scene has. ``others`` are the names of constants and signals, which the message may suggest."""
    items = items_of(scene)
    known = quantity(name, items)
    if known is not None:
        aero = scene.body[known.item].aerodynamics if known.table == "body" else None
        in_air = aero is not None and scene.environment.atmosphere != "none"
        if known.key in ("dynamic_pressure", "mach") and not in_air:
            return "needs a body with aerodynamics, in an atmosphere"
        air = scene.environment.air
        has_no_sound = air is not None and not air.speed_of_sound
        needs_sound = known.key == "mach" and has_no_sound
        return "needs environment.air.speed_of_sound_m_s" if needs_sound else ""
    *head, last = name.split(".")
    if name in _OWN_KEYS:
        return "is a key of signals; give the constant another name"
    if head:
        return _unknown_of_item(head, last, scene, items)
    key = split_unit(last)[0]
    if key in TIME:
        return f"the unit is missing or wrong; allowed: {_spellings('', key, 'time')}"
    return "no such constant or signal; " + nearest(name, [*others, "time_s"])


def _unknown_of_item(head: list[str], last: str, scene: Scene, items: Items) -> str:
    """Reason, for a message, why a dotted name is no quantity of a body, joint, spring or event:
    ``head`` are its parts before the last dot, ``last`` is the one after it; ``items`` as in
    `quantity`."""
    if head[0] in _OF_ITEM and head[0] not in scene.body:
        kinds = _OF_ITEM[head[0]]
        if len(head) != 2 or head[1] not in items[head[0]]:
            reason = f"write {head[0]}.NAME.QUANTITY with the name of a {head[0]}"
            return f"{reason}; {nearest(head[1], items[head[0]])}" if len(head) == 2 else reason
    elif len(head) == 1 and head[0] in scene.body:
        kinds = OF_BODY
    elif head[0] == "clearance":
        return "a clearance is no quantity of signals; use a stroke, a hinge angle or positions"
    else:
        return "no such body; " + nearest(head[0], [*scene.body, *_OF_ITEM])
    stem, key = ".".join(head) + ".", split_unit(last)[0]
    meant = key if key in kinds else last if last in kinds else ""
    if meant and kinds[meant]:
        return f"the unit is missing or wrong; allowed: {_spellings(stem, meant, kinds[meant])}"
    spellings = [f"{one}_{next(iter(UNITS[kind]))}" if kind else one for one, kind in kinds.items()]
    return "no such quantity; " + nearest(last, spellings)


def _spellings(stem: str, key: str, kind: str) -> str:
    """Text that lists the names of a quantity in all units of its kind, each after ``stem``:
    "upper.pitch_deg, upper.pitch_rad"."""
    return ", ".join(f"{stem}{key}_{unit}" for unit in UNITS[kind])


def idle_signals(scene: Scene) -> list[str]:
    """Names of the signals that no number of the scene (of loads, motors, springs and aerodynamic
    polynomials) and no other signal uses. A signal that only such a signal uses is not included."""
    named = {drive.signal for drive in scene.driven.values()} | {*signal_terms(scene).values()}
    for signal in scene.signal:
        named |= set(names(parse(signal.formula))) - {signal.name, *signal.constants}
    return [signal.name for signal in scene.signal if signal.name not in named]


def with_sizes(scene: Scene) -> Scene:
    """Copy of a scene in which each number that a signal gives is the largest magnitude, SI, of the
    signal's formula at 400 times from 0 to the end time, with all other quantities of the flight at
    0 (`value_at`). NaN counts as 0, and the number is at most `LARGEST`. For estimates of scales,
    speeds and heights."""
    times = np.linspace(0.0, scene.run.end_time, _TIMES)
    sizes = {}
    for path, drive in scene.driven.items():
        values = np.abs(np.nan_to_num(value_at(scene, drive.signal, times), nan=0.0))
        sizes[path] = min(float(values.max()) * drive.factor, LARGEST)
    return replace(scene, sizes)


def value_at(scene: Scene, name: str, times: np.ndarray) -> np.ndarray:
    """Values (n,) of the formula of the signal ``name`` at ``times`` (n,), s, with all quantities
    but time at 0; lags, servos, integrals and samples are ignored. In a loop of signals, a signal
    whose value is being computed is read as 0."""
    by_name = {signal.name: signal for signal in scene.signal}
    known: dict[str, np.ndarray] = {}

    def value(signal: str) -> np.ndarray:
        if signal not in known:
            known[signal] = np.zeros(len(times))  # in a loop, which a state or a sample opens
            tree = parse(by_name[signal].formula)
            known[signal] = np.zeros(len(times)) + evaluate(
                tree, {one: of_name(by_name[signal], one) for one in names(tree)}
            )
        return known[signal]

    def of_name(signal: Signal, one: str) -> Any:
        if one in signal.constants:
            return signal.constants[one]
        if one in by_name:
            return value(one)
        known_quantity = quantity(one, items_of(scene))
        assert known_quantity is not None
        return times / known_quantity.factor if known_quantity.table == "time" else 0.0 * times

    return value(name)
