"""Text that `sepmc scenarios` prints."""

import math
from collections.abc import Hashable, Mapping
from typing import Any

from sepmc.analysis.requirements import NONE, PASS
from sepmc.analysis.requirements_text import requirement_sentence
from sepmc.campaign.campaign import Campaign
from sepmc.campaign.limit_cases import MET, NOMINAL, UNKNOWN, VIOLATED, WORST, LimitCases
from sepmc.campaign.scenarios import ScenarioRuns
from sepmc.scene.scenarios import BASELINE
from sepmc.text_table import text_table

_ENDS = ("low", "high", "between")
_LIMITS_SHOWN = 6  # limit cases of each requirement, at least


def render_scenarios(runs: ScenarioRuns) -> str:
    """Return text on the runs of scenarios: a table of counts and verdicts, a row each; then the
    requirements of the campaign, those that a scenario changes, and the titles."""
    required = {name: one.campaign.file.requirements for name, one in runs.results.items()}
    common = required[BASELINE]
    names = list(dict.fromkeys(item.name for items in required.values() for item in items))
    rows, sentences = [], []
    for name, result in runs.results.items():
        verdicts, counts = result.requirements().to_dict("index"), result.status_counts
        failed = ", ".join(f"{n} {status}" for status, n in counts.items() if status != "ok")
        cells = [
            f"{verdicts[one]['verdict'].upper()} ({verdicts[one]['violations']} violate)"
            if one in verdicts
            else "-"
            for one in names
        ]
        rows.append([name, str(sum(counts.values())), str(counts.get("ok", 0)), *cells, failed])
        units = {column.name: column.unit for column in result.campaign.outcome_columns}
        sentences += [
            ("" if name == BASELINE else f"{name}: ")
            + requirement_sentence(item, units.get(item.metric, ""))
            for item in required[name]
            if name == BASELINE or item not in common
        ]
    head = ["scenario", "cases", "ok", *names, "not ok"]
    lines = text_table([head, *rows], left=(0, len(head) - 1))
    lines += sentences
    lines += [f"{name}: {title}" for name, title in runs.titles.items() if title]
    return "\n".join(lines)


def render_limits(limits: LimitCases, campaign: Campaign) -> str:
    """Return text on limit cases: a table with the outcome of each requirement, a row per case;
    then the inputs of the worst combinations, and the requirements. If there are many cases, only
    the nominal one, the violating ones, the worst combinations, and, for each requirement, the
    `_LIMITS_SHOWN` with the smallest margins are shown."""
    table, names = limits.table, [item.name for item in limits.requirements]
    is_worst = table["limit"].str.startswith(WORST)
    shown = is_worst | (table["limit"] == NOMINAL) | (table[names] != MET).any(axis=1)
    for name in names:
        margin = table[f"{name}_margin"].where(~is_worst)
        shown |= margin.rank(method="first") <= _LIMITS_SHOWN
    rows = [
        [str(row["limit"]), *(_limit_cell(row, name) for name in names), str(row["status"])]
        for row in table[shown].to_dict("records")
    ]
    lines = text_table([["limit case", *names, "status"], *rows], left=(0, len(names) + 1))
    lines.append("outcome (margin to the bound), inputs at their ends and the others nominal")
    if (table[names] == UNKNOWN).any(axis=None):
        lines.append(f"{UNKNOWN}: the case lacks it, which counts as a violation in a verdict")
    if hidden := int((~shown).sum()):
        lines.append(f"{hidden} more limit cases violate nothing and have larger margins")
    for row in table[is_worst].to_dict("records"):
        ends = [f"{word}: {row[word].replace('; ', ', ')}" for word in _ENDS if row[word]]
        lines.append(f"{row['limit']}; {'; '.join(ends) or NOMINAL}")
    units = {column.name: column.unit for column in campaign.outcome_columns}
    lines += [
        requirement_sentence(item, units.get(item.metric, "")) for item in limits.requirements
    ]
    return "\n".join(lines)


def _limit_cell(row: Mapping[Hashable, Any], name: str) -> str:
    """Return text on requirement ``name`` in a limit case, a ``row`` of `LimitCases.table`: the
    outcome, its margin in parentheses and, if the requirement is not met, VIOLATED.

    A requirement without a numeric outcome, such as one on a status, has only its verdict. A case
    without the outcome counts as a violation: "no outcome VIOLATED".
    """
    verdict, value = row[name], row[f"{name}_outcome"]
    text = "" if math.isnan(value) else f"{value:.5g} ({row[f'{name}_margin']:+.3g})"
    if verdict == MET:
        return text or MET
    return f"{UNKNOWN if verdict == UNKNOWN else text} {VIOLATED.upper()}".lstrip()


def unmet_verdicts(runs: ScenarioRuns) -> list[str]:
    """Return a text for each run, of the file itself and of its scenarios, in which a verdict is
    not pass, or which has no requirement: the name of the scenario, and those verdicts, of which
    "none" comes with its reason."""
    texts = []
    for name, result in runs.results.items():
        verdicts = result.requirements().to_dict("index")
        unmet = [
            f"{one} {v['verdict'].upper()}" + (f" ({v['why']})" if v["verdict"] == NONE else "")
            for one, v in verdicts.items()
            if v["verdict"] != PASS
        ]
        if unmet or not verdicts:
            texts.append(f"{name}: {', '.join(unmet) or 'has no requirement, so no verdict'}")
    return texts
