"""Outlines of bodies and clearances between them, of a random scene."""

from oracles.random_scenes.draft import Draft, Tree
from oracles.random_scenes.rng import rounded


def add_clearances(draft: Draft) -> None:
    """One or two clearances; in some of them one body stands in a shell of the other, and few touch
    from the start."""
    dice, tree = draft.dice, draft.tree
    if "clearance" not in draft.late:
        return
    for body in draft.bodies:
        for _ in range(dice.pick([1, 1, 2])):
            tree["body"][body].setdefault("outline", []).append(_solid(draft, body))
    for _ in range(dice.pick([1, 1, 2])):
        bodies = dice.some(draft.bodies, 2)
        if dice.chance(0.35):
            tree["body"][bodies[0]]["outline"].append(_shell(draft, bodies[1]))
        if dice.chance(0.5):
            bodies.reverse()
        clearance: Tree = {"name": draft.names.new("clearance"), "bodies": bodies}
        if tree["joint"] and dice.chance(0.3):
            clearance["after"] = dice.pick(list(tree["joint"]))
        tree.setdefault("clearance", []).append(clearance)


def _solid(draft: Draft, body: str) -> Tree:
    """A frustum about the mass centre of a body, or points."""
    dice, (x, y, z) = draft.dice, draft.cg(body)
    if dice.chance(0.2):
        return {
            "points_m": [
                [
                    rounded(x + dice.about(0.5)),
                    rounded(y + dice.about(0.3)),
                    rounded(z + dice.about(0.3)),
                ]
                for _ in range(2)
            ]
        }
    radius = dice.between(0.05, 0.3)
    part: Tree = {
        "stations_m": [rounded(x - dice.between(0.1, 0.6)), rounded(x + dice.between(0.1, 0.6))],
        "radii_m": [
            radius,
            radius if dice.chance(0.4) else dice.weighted({0.0: 0.2, dice.between(0.05, 0.3): 0.8}),
        ],
    }
    if dice.chance(0.4):
        part["offset_m"] = dice.vector(0.1, 2)
    return part


def _shell(draft: Draft, inner: str) -> Tree:
    """The inside of a shell around a body."""
    dice, station = draft.dice, draft.cg(inner)[0]
    return {
        "stations_m": [
            rounded(station - dice.between(0.05, 1.0)),
            rounded(station + dice.between(0.05, 1.0)),
        ],
        "radii_m": [dice.between(0.35, 0.6), dice.between(0.35, 0.6)],
        "hollow": True,
    }
