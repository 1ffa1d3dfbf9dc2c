"""Combined conditions, break loads, single releases, observed events and triggered ignitions of a
random scene."""

from collections.abc import Callable
from dataclasses import replace

from oracles.random_scenes.draft import Draft, Tree
from oracles.random_scenes.joints import rows
from oracles.random_scenes.loads import add_motor
from oracles.random_scenes.rng import rounded
from sepmc.scene.kinds import KINDS, is_subset
from sepmc.scene.messages import SceneError
from sepmc.scene.read import parse_campaign

_Condition = Callable[[], Tree]


def ending(draft: Draft, joints: dict[str, str], plain: _Condition) -> Tree:
    """Condition that ends a phase: a plain one from ``plain()``, or one of the later kinds."""
    rng = draft.rng
    if "break load" in draft.late and rng.chance(0.6):
        load = _break_load(draft, joints)
        if load:
            return load if rng.chance(0.3) else {"any": [load, plain()]}
    if "any and all" in draft.late and rng.chance(0.7):
        return _combined(draft, plain)
    return plain()


def _combined(draft: Draft, plain: _Condition, depth: int = 0) -> Tree:
    """Several keys in one table, or ``any`` or ``all`` of several conditions, which may be
    nested."""
    rng = draft.rng
    sort = rng.weighted_choice({"keys": 0.25, "any": 0.35, "all": 0.4})
    if sort == "keys":
        first, second = plain(), plain()
        clash = set(first) & set(second)
        return first if clash else first | second
    return {
        sort: [
            _combined(draft, plain, depth + 1) if depth < 1 and rng.chance(0.2) else plain()
            for _ in range(rng.choice([2, 2, 3]))
        ]
    }


def _break_load(draft: Draft, joints: dict[str, str]) -> Tree:
    """Force or moment at which a joint breaks; empty if all joints are free."""
    rng = draft.rng
    holding = [name for name, kind in joints.items() if kind != "free"]
    if not holding:
        return {}
    name = rng.choice(holding)
    mass = draft.reduced(draft.tree["joint"][name]["bodies"])
    if rng.chance(0.65):
        return {"joint": name, "force_N": rounded(mass * rng.log_uniform(0.5, 40.0))}
    return {"joint": name, "moment_N_m": rounded(mass * rng.log_uniform(0.1, 20.0))}


def add_releases(draft: Draft, until: Callable[[dict[str, str], float, float], Tree]) -> None:
    """Add releases of single joints, independent of phases; ``until(joints, span, past)`` samples a
    plain condition."""
    rng, tree = draft.rng, draft.tree
    if "release" not in draft.late:
        return
    kinds = {
        name: [phase["joints"].get(name, "free") for phase in tree["phase"]]
        for name in tree["joint"]
    }
    for name in rng.subset(
        [name for name, phases in kinds.items() if set(phases) != {"free"}], rng.choice([1, 1, 2])
    ):
        past = rng.uniform(0.15, 0.95) * draft.span
        joints = {joint: phases[0] for joint, phases in kinds.items()}
        when = ending(draft, joints, lambda joints=joints, past=past: until(joints, past, past))  # type: ignore[misc]
        to = (
            "free"
            if rng.chance(0.6)
            else rng.choice(_releasable_kinds(draft, name, kinds[name]) or ["free"])
        )
        tree.setdefault("release", []).append(
            {"name": draft.names.new("release"), "joint": name, "to": to, "when": when}
        )


def add_events(draft: Draft, until: Callable[[dict[str, str], float, float], Tree]) -> None:
    """Add observed events with conditions such as end phases (``until`` as in `add_releases`), and
    some at which one or several springs reach their end."""
    rng, tree = draft.rng, draft.tree
    if "event" not in draft.late:
        return
    joints = dict(tree["phase"][0]["joints"])
    for _ in range(rng.choice([1, 1, 2])):
        past = rng.uniform(0.05, 1.0) * draft.span
        when = ending(draft, joints, lambda past=past: until(joints, past, past))  # type: ignore[misc]
        _add_event(draft, when)
    springs = [s["name"] for s in tree.get("spring", []) if "stroke_m" in s]
    if springs and rng.chance(0.7):
        ends: list[Tree] = [{"spring": name} for name in rng.subset(springs, rng.choice([1, 2, 3]))]
        _add_event(draft, ends[0] if len(ends) == 1 else {rng.choice(["any", "all"]): ends})


def add_ignitions(draft: Draft, until: Callable[[dict[str, str], float, float], Tree]) -> None:
    """Add motors that ignite at an event, at a release or when a joint becomes free (``until`` as
    in `add_releases`). Motors that would wait for themselves stay as they are."""
    rng, tree = draft.rng, draft.tree
    if "ignition" not in draft.late or draft.special == "still":
        return
    joints = dict(tree["phase"][0]["joints"])
    if not _instants(draft) or rng.chance(0.5):
        past = rng.uniform(0.05, 0.7) * draft.span
        _add_event(draft, ending(draft, joints, lambda: until(joints, past, past)))
    if not tree.get("motor") or rng.chance(0.4):
        add_motor(draft)
    instants = _instants(draft)
    for motor in rng.subset(tree["motor"], rng.choice([1, 1, 2])):
        key, name = rng.choice(instants)
        later = {"delay_s": rng.uniform(0.01, 0.3) * draft.span} if rng.chance(0.5) else {}
        before = dict(motor)
        motor.pop("ignition_s", None)
        motor["ignition"] = {key: name, **later}
        if not _is_accepted(tree):
            motor.clear()
            motor.update(before)


def _instants(draft: Draft) -> list[tuple[str, str]]:
    """Events, releases and joints that a motor can wait for."""
    tree = draft.tree
    instants = [(key, item["name"]) for key in ("event", "release") for item in tree.get(key, [])]
    phases = [phase["joints"] for phase in tree["phase"]]
    for joint in tree["joint"]:
        kinds = [phase.get(joint, "free") for phase in phases]
        releases = [each for each in tree.get("release", []) if each["joint"] == joint]
        if kinds[0] != "free" and (kinds[-1] == "free" or any(r["to"] == "free" for r in releases)):
            instants.append(("joint", joint))
    return instants


def _is_accepted(tree: Tree) -> bool:
    """True if the parser accepts a tree."""
    order = {key: value for key, value in tree.items() if not key.startswith("_")}
    try:
        parse_campaign(order, "draft")
    except SceneError:
        return False
    return True


def add_options(draft: Draft, until: Callable[[dict[str, str], float, float], Tree]) -> None:
    """Make some releases optional or nearly unreachable, at least one (``until`` as in
    `add_releases`)."""
    rng, tree = draft.rng, draft.tree
    if "optional" not in draft.late:
        return
    if not tree.get("release"):
        add_releases(replace(draft, late=draft.late | {"release"}), until)
    for release in tree.get("release", []):
        if rng.chance(0.5):
            release["optional"] = rng.chance(0.8)
        if rng.chance(0.4):
            far = _far(draft, release["joint"])
            both = {rng.weighted_choice({"all": 0.7, "any": 0.3}): [release["when"], far]}
            release["when"] = far if rng.chance(0.6) else both


def _far(draft: Draft, joint: str) -> Tree:
    """Condition that a simulation so short hardly ever meets."""
    rng, body = draft.rng, draft.rng.choice(draft.bodies)
    return rng.choice(
        [
            {"joint": joint, "stroke_m": rounded(1e3 * rng.uniform(1.0, 3.0))},
            {"joint": joint, "angle_deg": rng.uniform(120.0, 179.0)},
            {"joint": joint, "force_N": rounded(1e9 * rng.uniform(1.0, 3.0))},
            {"body": body, "altitude_m": rounded(1e6 * rng.uniform(1.0, 3.0))},
            {"body": body, "vertical_speed_m_s": rounded(1e5 * rng.symmetric(3.0))},
        ]
    )


def _add_event(draft: Draft, when: Tree) -> None:
    """Add an observed event."""
    event = {"name": draft.names.new("event"), "when": when}
    draft.tree.setdefault("event", []).append(event)


def _releasable_kinds(draft: Draft, name: str, kinds: list[str]) -> list[str]:
    """Kinds to which a joint with these kinds in its phases may be released."""
    every = [rows(draft, name, kind) for kind in kinds]
    custom = draft.tree["joint"][name].get("kind", {})
    released = []
    for kind in [*KINDS, *custom]:
        to = rows(draft, name, kind)
        comparable = all(is_subset(to, active) or is_subset(active, to) for active in every)
        if (
            kind != "rod"
            and comparable
            and any(is_subset(to, active) and to != active for active in every)
        ):
            released.append(kind)
    return released
