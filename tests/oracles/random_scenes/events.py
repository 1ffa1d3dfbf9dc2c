"""Conditions of several parts, break loads, releases apart from phases and instants that are told
of, of a random scene."""

from collections.abc import Callable
from dataclasses import replace

from oracles.random_scenes.draft import Draft, Tree
from oracles.random_scenes.joints import rows
from oracles.random_scenes.loads import add_motor
from oracles.random_scenes.rng import rounded
from sepmc.scene.kinds import KINDS, is_part
from sepmc.scene.messages import SceneError
from sepmc.scene.read import parse_campaign

_Condition = Callable[[], Tree]


def ending(draft: Draft, held: dict[str, str], one: _Condition) -> Tree:
    """The condition that ends a phase: a plain one by ``one()``, or one of the later kinds."""
    dice = draft.dice
    if "break load" in draft.late and dice.chance(0.6):
        load = _break_load(draft, held)
        if load:
            return load if dice.chance(0.3) else {"any": [load, one()]}
    if "any and all" in draft.late and dice.chance(0.7):
        return _combined(draft, one)
    return one()


def _combined(draft: Draft, one: _Condition, depth: int = 0) -> Tree:
    """Several keys in one table, or ``any`` or ``all`` of several conditions, some of which are
    such themselves."""
    dice = draft.dice
    sort = dice.weighted({"keys": 0.25, "any": 0.35, "all": 0.4})
    if sort == "keys":
        found, other = one(), one()
        clash = set(found) & set(other)
        return found if clash else found | other
    return {
        sort: [
            _combined(draft, one, depth + 1) if depth < 1 and dice.chance(0.2) else one()
            for _ in range(dice.pick([2, 2, 3]))
        ]
    }


def _break_load(draft: Draft, held: dict[str, str]) -> Tree:
    """Force or moment at which a joint that holds something breaks; nothing if none does."""
    dice = draft.dice
    holding = [name for name, kind in held.items() if kind != "free"]
    if not holding:
        return {}
    name = dice.pick(holding)
    mass = draft.reduced(draft.tree["joint"][name]["bodies"])
    if dice.chance(0.65):
        return {"joint": name, "force_N": rounded(mass * dice.decades(0.5, 40.0))}
    return {"joint": name, "moment_N_m": rounded(mass * dice.decades(0.1, 20.0))}


def add_releases(draft: Draft, until: Callable[[dict[str, str], float, float], Tree]) -> None:
    """Releases of single joints, whatever the phase; ``until(held, span, past)`` draws a plain
    condition."""
    dice, tree = draft.dice, draft.tree
    if "release" not in draft.late:
        return
    kinds = {
        name: [phase["joints"].get(name, "free") for phase in tree["phase"]]
        for name in tree["joint"]
    }
    for name in dice.some(
        [name for name, found in kinds.items() if set(found) != {"free"}], dice.pick([1, 1, 2])
    ):
        past = dice.between(0.15, 0.95) * draft.span
        held = {joint: found[0] for joint, found in kinds.items()}
        when = ending(draft, held, lambda held=held, past=past: until(held, past, past))  # type: ignore[misc]
        to = "free" if dice.chance(0.6) else dice.pick(_less(draft, name, kinds[name]) or ["free"])
        tree.setdefault("release", []).append(
            {"name": draft.names.new("release"), "joint": name, "to": to, "when": when}
        )


def add_events(draft: Draft, until: Callable[[dict[str, str], float, float], Tree]) -> None:
    """Instants that are told of, by conditions such as end phases (``until`` as above), and those
    at which springs have come to their ends, one or several."""
    dice, tree = draft.dice, draft.tree
    if "event" not in draft.late:
        return
    held = dict(tree["phase"][0]["joints"])
    for _ in range(dice.pick([1, 1, 2])):
        past = dice.between(0.05, 1.0) * draft.span
        when = ending(draft, held, lambda past=past: until(held, past, past))  # type: ignore[misc]
        _add_event(draft, when)
    springs = [s["name"] for s in tree.get("spring", []) if "stroke_m" in s]
    if springs and dice.chance(0.7):
        ends: list[Tree] = [{"spring": name} for name in dice.some(springs, dice.pick([1, 2, 3]))]
        _add_event(draft, ends[0] if len(ends) == 1 else {dice.pick(["any", "all"]): ends})


def add_ignitions(draft: Draft, until: Callable[[dict[str, str], float, float], Tree]) -> None:
    """Motors that light at an event, at a release or as a joint becomes free (``until`` as
    above). What waits for a burn-out may wait for one of these; what waits for itself is left."""
    dice, tree = draft.dice, draft.tree
    if "ignition" not in draft.late or draft.special == "still":
        return
    held = dict(tree["phase"][0]["joints"])
    if not _instants(draft) or dice.chance(0.5):
        past = dice.between(0.05, 0.7) * draft.span
        _add_event(draft, ending(draft, held, lambda: until(held, past, past)))
    if not tree.get("motor") or dice.chance(0.4):
        add_motor(draft)
    instants = _instants(draft)
    for motor in dice.some(tree["motor"], dice.pick([1, 1, 2])):
        key, name = dice.pick(instants)
        later = {"delay_s": dice.between(0.01, 0.3) * draft.span} if dice.chance(0.5) else {}
        before = dict(motor)
        motor.pop("ignition_s", None)
        motor["ignition"] = {key: name, **later}
        if not _is_read(tree):
            motor.clear()
            motor.update(before)


def _instants(draft: Draft) -> list[tuple[str, str]]:
    """Events, releases and joints that a motor may wait for."""
    tree = draft.tree
    found = [(key, item["name"]) for key in ("event", "release") for item in tree.get(key, [])]
    phases = [phase["joints"] for phase in tree["phase"]]
    for joint in tree["joint"]:
        kinds = [phase.get(joint, "free") for phase in phases]
        freed = [one for one in tree.get("release", []) if one["joint"] == joint]
        if kinds[0] != "free" and (kinds[-1] == "free" or any(r["to"] == "free" for r in freed)):
            found.append(("joint", joint))
    return found


def _is_read(tree: Tree) -> bool:
    """Whether a tree is one of a campaign file that can be flown."""
    order = {key: value for key, value in tree.items() if not key.startswith("_")}
    try:
        parse_campaign(order, "draft")
    except SceneError:
        return False
    return True


def add_options(draft: Draft, until: Callable[[dict[str, str], float, float], Tree]) -> None:
    """Releases that may be left out, and such as hardly ever come, one of them at least (``until``
    as above)."""
    dice, tree = draft.dice, draft.tree
    if "optional" not in draft.late:
        return
    if not tree.get("release"):
        add_releases(replace(draft, late=draft.late | {"release"}), until)
    for release in tree.get("release", []):
        if dice.chance(0.5):
            release["optional"] = dice.chance(0.8)
        if dice.chance(0.4):
            far = _far(draft, release["joint"])
            both = {dice.weighted({"all": 0.7, "any": 0.3}): [release["when"], far]}
            release["when"] = far if dice.chance(0.6) else both


def _far(draft: Draft, joint: str) -> Tree:
    """A condition that a flight so short does not meet, or hardly ever."""
    dice, body = draft.dice, draft.dice.pick(draft.bodies)
    return dice.pick(
        [
            {"joint": joint, "stroke_m": rounded(1e3 * dice.between(1.0, 3.0))},
            {"joint": joint, "angle_deg": dice.between(120.0, 179.0)},
            {"joint": joint, "force_N": rounded(1e9 * dice.between(1.0, 3.0))},
            {"body": body, "altitude_m": rounded(1e6 * dice.between(1.0, 3.0))},
            {"body": body, "vertical_speed_m_s": rounded(1e5 * dice.about(3.0))},
        ]
    )


def _add_event(draft: Draft, when: Tree) -> None:
    event = {"name": draft.names.new("event"), "when": when}
    draft.tree.setdefault("event", []).append(event)


def _less(draft: Draft, name: str, kinds: list[str]) -> list[str]:
    """Kinds to which a joint may be released that has these kinds in the phases."""
    every = [rows(draft, name, kind) for kind in kinds]
    own = draft.tree["joint"][name].get("kind", {})
    found = []
    for kind in [*KINDS, *own]:
        to = rows(draft, name, kind)
        comparable = all(is_part(to, held) or is_part(held, to) for held in every)
        if kind != "rod" and comparable and any(is_part(to, held) and to != held for held in every):
            found.append(kind)
    return found
