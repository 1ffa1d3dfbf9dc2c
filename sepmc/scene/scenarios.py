"""Scenarios: named variants of a campaign, such as failure cases, each given by a few values that
replace those of the file."""

import copy
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from typing import Any

from sepmc.scene.input_table import InputTable
from sepmc.scene.limits import NAME
from sepmc.scene.messages import Problems
from sepmc.scene.model import Scene
from sepmc.scene.parameters import UnknownPath, find
from sepmc.scene.setting_checks import check_settings, expand
from sepmc.scene.settings import apply_settings
from sepmc.scene.tables import NAME_PATTERN

BASELINE = "baseline"  # the campaign itself, beside its scenarios
_KEYS = ("name", "title", "set")
_NOT_OF_SCENARIOS = ("scenario", "map", "size")  # tables of the campaign itself
# components of vectors in paths; a path with those of another quantity names no parameter
_COMPONENTS = (("x", "y", "z"), ("xx", "yy", "zz"), ("xy", "xz", "yz"))


@dataclass(frozen=True)
class Scenario:
    """Named variant of a campaign: values that replace those of the file. A dispersed parameter
    among them becomes constant.

    Attributes
    ----------
    name : str
        Name of the scenario, unique in the campaign.
    title : str
        Text for users; empty if the file has none.
    settings : dict of str to any
        Values by TOML path; ``*`` in a path stands for any characters of a name.
    """

    name: str
    title: str
    settings: dict[str, Any]


def read_scenarios(tree: Any, problems: Problems) -> tuple[Scenario, ...]:
    """Convert the array ``[[scenario]]`` of a file, ``tree``, to scenarios in its order. Adds
    problems; entries without a valid name or without values are left out, those with other problems
    are not. A ``tree`` that is no list is a problem, None too, and gives no scenario."""
    if not isinstance(tree, list):
        problems.add("scenario", "must be an array of tables: [[scenario]]", tree)
        return ()
    scenarios: list[Scenario] = []
    for number, table in enumerate(tree):
        key_path = f"scenario.{number}"
        if not isinstance(table, dict):
            problems.add(key_path, "must be a table", table)
            continue
        name, title, settings = (table.get(key, "") for key in _KEYS)
        if not isinstance(name, str) or not NAME_PATTERN.fullmatch(name) or len(name) > NAME:
            reason = f"must be a letter followed by letters, digits or _, at most {NAME} characters"
            problems.add(f"{key_path}.name", reason, name)
            continue
        key_path = f"scenario.{name}"
        if name == BASELINE or name in [one.name for one in scenarios]:
            reason = "names the campaign itself" if name == BASELINE else "the name is used twice"
            problems.add(key_path, f"{reason}: choose another name")
        if not isinstance(title, str):
            problems.add(f"{key_path}.title", "must be text", title)
        for key in table:
            if key not in _KEYS:
                problems.add(f"{key_path}.{key}", "unknown key; known here: " + ", ".join(_KEYS))
        if not isinstance(settings, dict) or not settings:
            problems.add(
                f"{key_path}.set",
                'must be a table with at least one value, as { "spring.a.factor" = 0.0 }',
            )
            continue
        for key, value in settings.items():
            if isinstance(value, dict) and "." not in key:  # the keys of a path without quotes
                reason = 'put the path in quotes: "spring.a.factor" = 0.0'
                problems.add(f"{key_path}.set.{key}", reason)
        scenarios.append(Scenario(name, str(title), settings))
    return tuple(scenarios)


def scenario_tree(
    tree: dict[str, Any],
    scene: Scene,
    scenario: Scenario,
    problems: Problems,
    table: InputTable | None = None,
) -> dict[str, Any]:
    """TOML tree of a campaign with the values of a scenario, and without ``[[scenario]]``,
    ``[map]`` and ``[size]``.

    A parameter that the campaign disperses gets a constant distribution, so that the scenario needs
    no other kernel and its other parameters have the same random numbers.

    Parameters
    ----------
    tree : dict
        TOML tree of the campaign; it is not changed.
    scene : Scene
        Scene of the campaign without the scenario.
    scenario : Scenario
    problems : Problems
        Receives every problem.
    table : InputTable, optional
        The table that ``run.samples`` names: a parameter that has a column in it cannot be set.

    Returns
    -------
    dict
        A new tree; incomplete if there were problems.
    """
    changed, own = copy.deepcopy(tree), Problems()
    settings = expand(scenario.settings, tree, own)
    check_settings(settings, own)
    if not own:
        apply_settings(changed, settings, own)
    dispersed = {_path(scene, key): key for key in tree.get("dispersion", {})}
    for key, value in () if own else _numbers(settings):
        path = _path(scene, key)
        if path is not None and path in dispersed:
            parameter = find(scene, dispersed[path])
            if table is not None and table.has(parameter.column):
                own.add(key, f"is given by column {parameter.column} of run.samples in every case")
                continue
            factor = find(scene, key).factor / parameter.factor
            changed["dispersion"][dispersed[path]] = {"constant": value * factor}
    for problem in own:
        problems.append(f"scenario.{scenario.name}.set.{problem}")
    for name in _NOT_OF_SCENARIOS:
        changed.pop(name, None)
    return changed


def _numbers(settings: Mapping[str, Any]) -> Iterator[tuple[str, float]]:
    """Yield the TOML path and the value of each number in settings, also of those in vectors,
    tables and arrays. Which names the items of an array have is not known here: each is yielded
    under several (x, xx, xy, and its ``name`` or index), of which at most one is that of a
    parameter."""
    for key, value in settings.items():
        if isinstance(value, Mapping):
            yield from _numbers({f"{key}.{name}": item for name, item in value.items()})
        elif isinstance(value, list):
            numbers = [
                item.get("name", number) if isinstance(item, Mapping) else number
                for number, item in enumerate(value)
            ]
            for names in (*_COMPONENTS, numbers):
                items = zip(names, value, strict=False)
                yield from _numbers({f"{key}.{name}": item for name, item in items})
        elif isinstance(value, int | float):
            yield key, value


def _path(scene: Scene, key: str) -> str | None:
    """Path without units of the parameter that a TOML path names; None if it names none."""
    try:
        return find(scene, key).path
    except UnknownPath:
        return None
