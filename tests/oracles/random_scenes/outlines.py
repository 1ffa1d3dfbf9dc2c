"""Outlines of bodies and clearances between them, of a random scene."""

from oracles.random_scenes.draft import Draft, Tree
from oracles.random_scenes.rng import rounded


def add_clearances(draft: Draft) -> None:
    """Add one or two clearances; some between a body and a shell around it, few in contact at the
    start."""
    rng, tree = draft.rng, draft.tree
    if "clearance" not in draft.late:
        return
    for body in draft.bodies:
        for _ in range(rng.choice([1, 1, 2])):
            tree["body"][body].setdefault("outline", []).append(_solid(draft, body))
    for _ in range(rng.choice([1, 1, 2])):
        bodies = rng.subset(draft.bodies, 2)
        if rng.chance(0.35):
            tree["body"][bodies[0]]["outline"].append(_shell(draft, bodies[1]))
        if rng.chance(0.5):
            bodies.reverse()
        clearance: Tree = {"name": draft.names.new("clearance"), "bodies": bodies}
        if tree["joint"] and rng.chance(0.3):
            clearance["after"] = rng.choice(list(tree["joint"]))
        tree.setdefault("clearance", []).append(clearance)


def add_sectors(draft: Draft) -> None:
    """Make some frustums of outlines sectors, where a clearance has solids left."""
    rng, tree = draft.rng, draft.tree
    if "sector" not in draft.late:
        return
    for body in sorted({body for one in tree.get("clearance", []) for body in one["bodies"]}):
        outline = tree["body"][body]["outline"]
        frustums = [part for part in outline if "stations_m" in part and not part.get("hollow")]
        if len(frustums) > 1 or (len(outline) > 1 and frustums):
            first = rng.uniform(-180.0, 180.0)
            frustums[0]["sector_deg"] = [first, rounded(first + rng.uniform(60.0, 300.0))]


def name_parts(draft: Draft) -> None:
    """Name some parts of outlines, and some of them in clearances; others by their number."""
    rng, tree = draft.rng, draft.tree
    for body in tree["body"].values():
        for number, part in enumerate(body.get("outline", [])):
            if rng.chance(0.3):
                part["name"] = f"part{number}"
    for clearance in tree.get("clearance", []):
        outlines = [tree["body"][body]["outline"] for body in clearance["bodies"]]
        if all(len(outline) == 1 for outline in outlines) or rng.chance(0.4):
            continue
        names = [[part.get("name", str(k)) for k, part in enumerate(o)] for o in outlines]
        chosen = [rng.subset(one, rng.choice(range(len(one) + 1))) for one in names]
        kept = [
            [part for part, name in zip(o, one, strict=True) if not c or name in c]
            for o, one, c in zip(outlines, names, chosen, strict=True)
        ]
        if not all(
            part.get("hollow") or part.get("sector_deg") for parts in kept for part in parts
        ):
            clearance["outlines"] = chosen


def _solid(draft: Draft, body: str) -> Tree:
    """Frustum about the mass centre of a body, or points."""
    rng, (x, y, z) = draft.rng, draft.cg(body)
    if rng.chance(0.2):
        return {
            "points_m": [
                [
                    rounded(x + rng.symmetric(0.5)),
                    rounded(y + rng.symmetric(0.3)),
                    rounded(z + rng.symmetric(0.3)),
                ]
                for _ in range(2)
            ]
        }
    radius = rng.uniform(0.05, 0.3)
    part: Tree = {
        "stations_m": [rounded(x - rng.uniform(0.1, 0.6)), rounded(x + rng.uniform(0.1, 0.6))],
        "radii_m": [
            radius,
            radius
            if rng.chance(0.4)
            else rng.weighted_choice({0.0: 0.2, rng.uniform(0.05, 0.3): 0.8}),
        ],
    }
    if rng.chance(0.4):
        part["offset_m"] = rng.vector(0.1, 2)
    return part


def _shell(draft: Draft, inner: str) -> Tree:
    """Inside of a shell around a body."""
    rng, station = draft.rng, draft.cg(inner)[0]
    return {
        "stations_m": [
            rounded(station - rng.uniform(0.05, 1.0)),
            rounded(station + rng.uniform(0.05, 1.0)),
        ],
        "radii_m": [rng.uniform(0.35, 0.6), rng.uniform(0.35, 0.6)],
        "hollow": True,
    }
