"""Screen of `sepmc scenarios`."""

from sepmc.analysis.requirements import PASS
from sepmc.analysis.requirements_text import requirement_sentence
from sepmc.campaign.campaign import Campaign
from sepmc.campaign.scenarios import ScenarioRuns
from sepmc.text_table import text_table


def render_scenarios(runs: ScenarioRuns, campaign: Campaign) -> str:
    """Render the counts and verdicts of each scenario, a row each, and what is required."""
    items = campaign.file.requirements
    units = {column.name: column.unit for column in campaign.outcome_columns}
    table, rows = runs.table, []
    for name, result in runs.results.items():
        own = table[table["scenario"] == name].set_index("name")
        counts = result.status_counts
        failed = ", ".join(f"{n} {status}" for status, n in counts.items() if status != "ok")
        row = [name, str(sum(counts.values())), str(counts.get("ok", 0))]
        for item in items:
            verdict = own.loc[item.name]
            row.append(f"{verdict['verdict'].upper()} ({verdict['violations']} violate)")
        rows.append([*row, failed])
    head = ["scenario", "cases", "ok", *(item.name for item in items), "not ok"]
    lines = text_table([head, *rows], left=(0, len(head) - 1))
    for item in items:
        lines.append(requirement_sentence(item, units.get(item.metric, "")))
    lines += [f"{name}: {title}" for name, title in runs.titles.items() if title]
    return "\n".join(lines)


def verdicts_pass(runs: ScenarioRuns) -> bool:
    """Return True if every requirement is shown in every scenario."""
    return bool((runs.table["verdict"] == PASS).all())
