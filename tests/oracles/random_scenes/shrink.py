"""Reduction of a failing scene: removes and simplifies items as long as the same fault remains."""

import copy
from collections.abc import Callable, Iterator
from typing import Any

from oracles.random_scenes.compare import FAULTS, Verdict, judge
from oracles.random_scenes.draft import GROUND, Tree
from oracles.random_scenes.rng import rounded
from sepmc.scene.messages import no_log

Judge = Callable[[Tree], Verdict]
_LISTS = ("motor", "spring", "load", "proximity", "clearance", "release", "event")


def shrink(
    tree: Tree,
    cases: int = 3,
    max_trials: int = 300,
    judged: Judge | None = None,
    log: Callable[[str], None] = no_log,
) -> Tree:
    """Smallest tree found that fails as ``tree`` does.

    Parameters
    ----------
    tree : dict
    cases : int
        Cases of a scene that are compared.
    max_trials : int
        Scenes tried.
    judged : callable, optional
        Verdict on a tree; `compare.judge` by default.
    log : callable
        Called with a message for each reduction.
    """
    judged = judged or (lambda t: judge(t, "shrunk", cases))
    fault = _fault_of(judged(tree))
    if not fault:
        raise ValueError("the scene does not fail")
    left, progress = max_trials, True
    while progress and left > 0:
        progress = False
        for edit in _edits(tree):
            smaller = edit
            left -= 1
            if left <= 0:
                break
            if _fault_of(judged(copy.deepcopy(smaller))) == fault:
                tree, progress = smaller, True
                log(f"{len(str(tree))} characters, {left} trials left")
                break
    return tree


def _fault_of(verdict: Verdict) -> tuple[str, ...]:
    """Fault that a failure is recognised by; empty if there is none."""
    if verdict.crash:
        return ("crash", verdict.crash.split(":")[0])
    faults = [key for key in FAULTS if verdict.rows.get(key)]
    return (faults[0],) if faults else ()


def _edits(tree: Tree) -> Iterator[Tree]:
    """Smaller trees, largest reductions first."""
    if tree.get("dispersion"):
        yield _without(tree, ("dispersion",))
        keys = list(tree["dispersion"])
        for half in (keys[: len(keys) // 2], keys[len(keys) // 2 :]):
            if len(keys) > 2:
                yield {
                    **tree,
                    "dispersion": {k: v for k, v in tree["dispersion"].items() if k not in half},
                }
    for body in list(tree["body"])[::-1]:
        if len(tree["body"]) > 1:
            yield _without_body(tree, body)
    for name in tree.get("joint", {}):
        yield _without_joints(tree, [name])
    for number in range(len(tree["phase"]) - 1, -1, -1):
        if len(tree["phase"]) > 1:
            phases = [dict(phase) for phase in tree["phase"]]
            del phases[number]
            phases[-1].pop("until", None)
            yield {**tree, "phase": phases}
    for path in _paths(tree):
        yield _without(tree, path)
    yield from _rounded(tree)


def _paths(node: Any, path: tuple[Any, ...] = ()) -> list[tuple[Any, ...]]:
    """Paths of keys of tables, and of elements of arrays of tables, breadth first."""
    level: list[tuple[Any, ...]] = []
    below: list[tuple[Any, ...]] = []
    items: list[tuple[Any, Any]] = []
    if isinstance(node, dict):
        items = list(node.items())
    elif isinstance(node, list) and node and isinstance(node[0], dict):
        items = list(enumerate(node))
    for key, value in items:
        level.append((*path, key))
        below += _paths(value, (*path, key))
    return level + below


def _without(tree: Tree, path: tuple[Any, ...]) -> Tree:
    """Tree without the item at a path."""
    smaller = copy.deepcopy(tree)
    node: Any = smaller
    for part in path[:-1]:
        node = node[part]
    del node[path[-1]]
    return smaller


def _without_body(tree: Tree, body: str) -> Tree:
    """Tree without a body and all items that name it."""
    smaller = copy.deepcopy(tree)
    del smaller["body"][body]
    for key in _LISTS:
        if key in smaller:
            smaller[key] = [
                item
                for item in smaller[key]
                if item.get("body") != body and body not in item.get("bodies", [])
            ]
    if "transverse" in smaller.get("output", {}):
        smaller["output"]["transverse"] = [
            name for name in smaller["output"]["transverse"] if name != body
        ]
    gone = [
        name
        for name, joint in smaller.get("joint", {}).items()
        if body in joint["bodies"] or set(joint["bodies"]) == {GROUND}
    ]
    return _with_known(_without_joints(smaller, gone))


def _without_joints(tree: Tree, gone: list[str]) -> Tree:
    """Tree without joints and all items that name them; phases ended by one of them end at a
    time."""
    smaller = copy.deepcopy(tree)
    smaller["joint"] = {
        name: joint for name, joint in smaller.get("joint", {}).items() if name not in gone
    }
    for number, phase in enumerate(smaller["phase"]):
        phase["joints"] = {
            name: kind for name, kind in phase.get("joints", {}).items() if name not in gone
        }
        if phase.get("until", {}).get("joint") in gone:
            phase["until"] = {
                "time_s": rounded(
                    smaller["run"]["end_time_s"] * (number + 1) / (len(smaller["phase"]) + 1)
                )
            }
    if "tip_off" in smaller.get("output", {}):
        smaller["output"]["tip_off"] = [
            name for name in smaller["output"]["tip_off"] if name not in gone
        ]
    return _with_known(smaller)


def _with_known(tree: Tree) -> Tree:
    """Tree without dispersions of items that are gone."""
    sorts = {key: set(tree.get(key, {})) for key in ("body", "joint")}
    sorts |= {key: {item.get("name") for item in tree.get(key, [])} for key in (*_LISTS, "phase")}
    dispersions = tree.get("dispersion", {})
    known = {
        key: dispersion
        for key, dispersion in dispersions.items()
        if (parts := key.split("."))[0] not in sorts or parts[1] in sorts[parts[0]]
    }
    return {**tree, "dispersion": known} if dispersions else tree


def _rounded(tree: Tree) -> Iterator[Tree]:
    """Trees all of whose numbers, outside of dispersions, have fewer digits."""
    for digits in (1, 2):
        simpler = {
            key: value if key in ("dispersion", "run", "solver") else _round(value, digits)
            for key, value in tree.items()
        }
        if simpler != tree:
            yield simpler


def _round(node: Any, digits: int) -> Any:
    """Value with all its numbers rounded."""
    if isinstance(node, dict):
        return {key: _round(value, digits) for key, value in node.items()}
    if isinstance(node, list):
        return [_round(value, digits) for value in node]
    return rounded(node, digits) if isinstance(node, float) else node
