"""The doors a user has, against each other: a row and the replay of its case, one scene and the
same spelt in another way."""

import copy
import warnings
from typing import Any

import numpy as np

from oracles.random_scenes.compare import (
    Verdict,
    differences,
    last_line,
    settled,
    sizes,
    spread_of,
    told_errors,
)
from oracles.random_scenes.draft import Tree
from oracles.random_scenes.equivalent_scenes import SPELLINGS, spelt
from oracles.random_scenes.rng import Dice
from sepmc.campaign.campaign import Campaign
from sepmc.campaign.execution.accuracy import decisive
from sepmc.campaign.result import Result
from sepmc.scene.read import parse_campaign
from sepmc.schema import Column

_MARGIN, _FLOOR = 3.0, 1e-8  # of what both report together; what two orders of summation change
_FLOWN = ("ok", "never-released")  # what is left of other cases are numbers of an unfinished flight


def through(tree: Tree, name: str, verdict: Verdict) -> None:
    """Note what differs between the doors in a verdict on the rows."""
    try:
        found = doors(tree, name)
    except Exception:
        verdict.crash = f"doors: {last_line()}"
        return
    for line in found:
        verdict.count("door")
        verdict.said.append(f"door: {line}")


def doors(tree: Tree, name: str) -> list[str]:
    """What differs between the doors, a line each: the replays of two cases, and the nominal scene
    in other spellings."""
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        campaign = Campaign(parse_campaign(tree, name))
        result = campaign.run(cases=2)
        said = [line for number in range(2) for line in _replayed(result, number)]
        nominal = {key: value for key, value in tree.items() if key != "dispersion"}
        plain = Campaign(parse_campaign(nominal, name)).run(cases=1)
        for spelling, spell in SPELLINGS.items():
            other = spell(copy.deepcopy(nominal), Dice(len(spelling)))
            said += _same(
                plain, Campaign(parse_campaign(other, name)).run(cases=1), spelling, nominal
            )
    return said


def _replayed(result: Result, number: int) -> list[str]:
    """A row against the single run of its case, as `sepmc run RUN --case N` flies it."""
    table, columns = result.table, result.campaign.outcome_columns
    single = result.campaign.simulate(
        result.case(number), step_s=result.campaign.scene.run.end_time
    )
    outcomes, status = single.attrs["outcomes"], single.attrs["status"]
    if str(table["status"][number]) != status:
        return [f"replay of case {number}: {status}, its row {table['status'][number]}"]
    # it says that no step settles it
    if status not in _FLOWN or any("however short" in note for note in single.attrs["notes"]):
        return []
    row = np.array([table[c.name][number] for c in columns])
    return _off(
        row,
        np.array([outcomes[c.name] for c in columns]),
        columns,
        result,
        2.0,
        f"replay of case {number}",
    )


def _same(one: Result, two: Result, spelling: str, tree: Tree) -> list[str]:
    first, second = one.table, two.table
    if first["status"][0] != second["status"][0]:
        return [f"{spelling}: {second['status'][0]}, not {first['status'][0]}"]
    if first["status"][0] not in _FLOWN:
        return []
    columns = [c for c in one.campaign.outcome_columns if spelt(c.name, spelling, tree)]
    row = np.array([first[c.name][0] for c in columns])
    other = np.array([second[str(spelt(c.name, spelling, tree))][0] for c in columns])
    return _off(other, row, columns, one, 1.0, spelling, _reported(two))


def _reported(result: Result) -> float:
    return max(told_errors(result.accuracy).values(), default=0.0)


def _off(
    found: Any,
    expected: Any,
    columns: list[Column],
    result: Result,
    share: float,
    what: str,
    more: float = 0.0,
) -> list[str]:
    """A line if outcomes differ by more than the run reports and was asked for. Times and places of
    extremes, which a flat one leaves open, are left to the comparison of rows."""
    asked = result.accuracy.asked if result.accuracy else 0.0
    allowed = max(_FLOOR, share * asked, _MARGIN * (_reported(result) + more))
    off = differences(settled(found[None], expected[None], columns)[0], expected, columns)
    scale = sizes(expected[None], columns, result.campaign.scene)[0]
    if (off > allowed * scale).any() and result.campaign.file.dispersions:
        scale = np.maximum(scale, spread_of(result.campaign))  # errors are told as shares of it too
    off /= scale
    off[~decisive(columns)] = 0.0
    at = int(np.argmax(off))
    if off[at] <= allowed:
        return []
    return [
        f"{what}: {columns[at].name} = {found[at]:.9g}, not {expected[at]:.9g}, off by "
        f"{off[at]:.1e}"
    ]
