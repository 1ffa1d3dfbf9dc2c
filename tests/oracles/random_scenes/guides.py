"""Pins of guides, and outputs of joint and pin loads, of a random scene."""

from oracles.random_scenes.draft import Draft, Tree
from oracles.random_scenes.joints import rows

_ROUGH = 1e-6  # requested accuracy where friction makes the equations stiff


def add_guides(draft: Draft) -> None:
    """Add pins to joints that slide in some phase; two of three have friction."""
    rng, tree = draft.rng, draft.tree
    if "guide" not in draft.late:
        return
    for name, joint in tree["joint"].items():
        kinds = {phase["joints"].get(name, "free") for phase in tree["phase"]}
        if not any(_is_guided(rows(draft, name, kind)) for kind in kinds) and rng.chance(0.9):
            continue
        pins = rng.choice([1, 2, 3, 4, 8])
        guide: Tree = {"pins": pins, "engaged_m": rng.uniform(0.05, 0.5)}
        if pins > 1 or rng.chance(0.3):
            guide["circle_m"] = rng.uniform(0.1, 0.5)
        if rng.chance(0.5):
            guide["clock_deg"] = rng.symmetric(180.0)
        if rng.chance(0.66):
            guide["friction"] = rng.weighted_choice(
                {rng.uniform(0.01, 0.15): 0.9, rng.uniform(0.3, 1.0): 0.1}
            )
            guide["slip_speed_m_s"] = rng.log_uniform(0.05, 0.5)
        joint["guide"] = guide


def _is_guided(active: tuple[int, ...]) -> bool:
    """True if the active rows leave x free but constrain sideways and against tilting."""
    return {0, 1, 2} & set(active) == {1, 2} and sum(row > 2 for row in active) >= 2


def add_outputs(draft: Draft) -> None:
    """Add outputs of peaks, impulses and pin loads of some joints."""
    rng, tree = draft.rng, draft.tree
    guided = [name for name, joint in tree["joint"].items() if "guide" in joint]
    output = tree.setdefault("output", {})
    if "joint loads" in draft.late and tree["joint"]:
        output["loads"] = rng.subset(list(tree["joint"]), rng.choice([1, 1, 2]))
    if guided and rng.chance(0.8):
        output["guide"] = rng.subset(guided, rng.choice([1, 2]))
    if not output:
        del tree["output"]
    if any(joint.get("guide", {}).get("friction") for joint in tree["joint"].values()):
        solver = tree["solver"]
        solver["accuracy"] = max(_ROUGH, solver["accuracy"])
