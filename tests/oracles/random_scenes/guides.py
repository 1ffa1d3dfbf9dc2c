"""Pins of guides, and outputs of joint and pin loads, of a random scene."""

from oracles.random_scenes.draft import Draft, Tree
from oracles.random_scenes.joints import rows

_ROUGH = 1e-6  # accuracy asked where friction makes the equations stiff


def add_guides(draft: Draft) -> None:
    """Pins for joints that slide in some phase; two of three rub."""
    dice, tree = draft.dice, draft.tree
    if "guide" not in draft.late:
        return
    for name, joint in tree["joint"].items():
        kinds = {phase["joints"].get(name, "free") for phase in tree["phase"]}
        if not any(_is_guided(rows(draft, name, kind)) for kind in kinds) and dice.chance(0.9):
            continue
        pins = dice.pick([1, 2, 3, 4, 8])
        guide: Tree = {"pins": pins, "engaged_m": dice.between(0.05, 0.5)}
        if pins > 1 or dice.chance(0.3):
            guide["circle_m"] = dice.between(0.1, 0.5)
        if dice.chance(0.5):
            guide["clock_deg"] = dice.about(180.0)
        if dice.chance(0.66):
            guide["friction"] = dice.weighted(
                {dice.between(0.01, 0.15): 0.9, dice.between(0.3, 1.0): 0.1}
            )
            guide["slip_speed_m_s"] = dice.decades(0.05, 0.5)
        joint["guide"] = guide


def _is_guided(held: tuple[int, ...]) -> bool:
    return {0, 1, 2} & set(held) == {1, 2} and sum(row > 2 for row in held) >= 2


def add_outputs(draft: Draft) -> None:
    """Peaks, impulses and pin loads of some joints."""
    dice, tree = draft.dice, draft.tree
    guided = [name for name, joint in tree["joint"].items() if "guide" in joint]
    output = tree.setdefault("output", {})
    if "joint loads" in draft.late and tree["joint"]:
        output["loads"] = dice.some(list(tree["joint"]), dice.pick([1, 1, 2]))
    if guided and dice.chance(0.8):
        output["guide"] = dice.some(guided, dice.pick([1, 2]))
    if not output:
        del tree["output"]
    if any(joint.get("guide", {}).get("friction") for joint in tree["joint"].values()):
        solver = tree["solver"]
        solver["accuracy"] = max(_ROUGH, solver["accuracy"])
