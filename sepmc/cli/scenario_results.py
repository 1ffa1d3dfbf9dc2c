"""Screen of `sepmc scenarios`."""

from sepmc.analysis.requirements import PASS
from sepmc.analysis.requirements_text import requirement_sentence
from sepmc.campaign.scenarios import ScenarioRuns
from sepmc.scene.scenarios import BASELINE
from sepmc.text_table import text_table


def render_scenarios(runs: ScenarioRuns) -> str:
    """Render the counts and verdicts of each scenario, a row each, and what is required: of all,
    and of a scenario that changes it."""
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


def verdicts_pass(runs: ScenarioRuns) -> bool:
    """Return True if every requirement is shown in every scenario."""
    verdicts = [one.requirements().get("verdict") for one in runs.results.values()]
    return all(one is not None and bool((one == PASS).all()) for one in verdicts)
