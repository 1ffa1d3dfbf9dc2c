"""Entry points compared: a row and the replay of its case, a scene and its equivalents."""

import copy
import warnings
from typing import Any

import numpy as np

from oracles.random_scenes.compare import (
    Verdict,
    differences,
    reported_errors,
    sizes,
    snapped,
    standard_deviations,
    traceback_summary,
)
from oracles.random_scenes.draft import Tree
from oracles.random_scenes.equivalent_scenes import EQUIVALENTS, equivalent_column
from oracles.random_scenes.rng import RandomStream
from sepmc.campaign.campaign import Campaign
from sepmc.campaign.execution.accuracy import decisive
from sepmc.campaign.result import Result
from sepmc.scene.read import parse_campaign
from sepmc.schema import Column

_MARGIN, _FLOOR = (
    3.0,
    1e-8,
)  # factor on the sum of the reported errors; effect of another order of summation
_FLOWN = ("ok", "never-released")  # other cases did not finish


def check_entry_points(tree: Tree, name: str, verdict: Verdict) -> None:
    """Add the differences between the entry points to a verdict."""
    try:
        lines = entry_point_differences(tree, name)
    except Exception:
        verdict.crash = f"entry points: {traceback_summary()}"
        return
    for line in lines:
        verdict.count("entry")
        verdict.said.append(f"entry point: {line}")


def entry_point_differences(tree: Tree, name: str) -> list[str]:
    """Differences between the entry points, a line each: replays of two cases, and equivalents of
    the nominal scene."""
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        campaign = Campaign(parse_campaign(tree, name))
        result = campaign.run(cases=2)
        lines = [line for number in range(2) for line in _replay_differences(result, number)]
        nominal = {key: value for key, value in tree.items() if key != "dispersion"}
        plain = Campaign(parse_campaign(nominal, name)).run(cases=1)
        for variant, rewrite in EQUIVALENTS.items():
            other = rewrite(copy.deepcopy(nominal), RandomStream(len(variant)))
            lines += _variant_differences(
                plain, Campaign(parse_campaign(other, name)).run(cases=1), variant, nominal
            )
    return lines


def _replay_differences(result: Result, number: int) -> list[str]:
    """Differences of a row to the single run of its case, as `sepmc run RUN --case N` runs it."""
    table, columns = result.table, result.campaign.outcome_columns
    single = result.campaign.simulate(
        result.case(number), step_s=result.campaign.scene.run.end_time
    )
    outcomes, status = single.attrs["outcomes"], single.attrs["status"]
    if str(table["status"][number]) != status:
        return [f"replay of case {number}: {status}, its row {table['status'][number]}"]
    # the run reports that no step size converges
    if status not in _FLOWN or any("however short" in note for note in single.attrs["notes"]):
        return []
    row = np.array([table[c.name][number] for c in columns])
    return _difference(
        row,
        np.array([outcomes[c.name] for c in columns]),
        columns,
        result,
        2.0,
        f"replay of case {number}",
    )


def _variant_differences(
    first_run: Result, second_run: Result, variant: str, tree: Tree
) -> list[str]:
    """Differences of the nominal rows of a scene and an equivalent one."""
    first, second = first_run.table, second_run.table
    if first["status"][0] != second["status"][0]:
        return [f"{variant}: {second['status'][0]}, not {first['status'][0]}"]
    if first["status"][0] not in _FLOWN:
        return []
    columns = [
        c for c in first_run.campaign.outcome_columns if equivalent_column(c.name, variant, tree)
    ]
    row = np.array([first[c.name][0] for c in columns])
    other = np.array([second[str(equivalent_column(c.name, variant, tree))][0] for c in columns])
    return _difference(other, row, columns, first_run, 1.0, variant, _reported(second_run))


def _reported(result: Result) -> float:
    """Largest reported error of a run."""
    return max(reported_errors(result.accuracy).values(), default=0.0)


def _difference(
    values: Any,
    expected: Any,
    columns: list[Column],
    result: Result,
    fraction: float,
    label: str,
    other_error: float = 0.0,
) -> list[str]:
    """A line if outcomes differ by more than the run reports and was requested; times and locations
    of extremes are left to the comparison of rows."""
    requested = result.accuracy.asked if result.accuracy else 0.0
    allowed = max(_FLOOR, fraction * requested, _MARGIN * (_reported(result) + other_error))
    relative = differences(snapped(values[None], expected[None], columns)[0], expected, columns)
    scale = sizes(expected[None], columns, result.campaign.scene)[0]
    if (relative > allowed * scale).any() and result.campaign.file.dispersions:
        scale = np.maximum(
            scale, standard_deviations(result.campaign)
        )  # errors are reported relative to it too
    relative /= scale
    relative[~decisive(columns)] = 0.0
    worst = int(np.argmax(relative))
    if relative[worst] <= allowed:
        return []
    return [
        f"{label}: {columns[worst].name} = {values[worst]:.9g}, not {expected[worst]:.9g}, "
        f"off by {relative[worst]:.1e}"
    ]
