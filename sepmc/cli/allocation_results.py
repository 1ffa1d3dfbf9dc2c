"""Text that `sepmc allocate` prints."""

import shlex
from collections.abc import Mapping, Sequence
from typing import Any

from sepmc.campaign.allocation import MAX_TRIES, Allocation
from sepmc.cli.size_results import render_verdicts
from sepmc.scene.settings import inline_toml
from sepmc.text_table import text_table


def render_allocation(allocation: Allocation, file: str, settings: Sequence[str]) -> str:
    """Return an allocation as text: table of inputs, proposed spreads as lines for the campaign
    file, verdicts of the run that judges them, and the command that repeats that run. If there is
    no proposal, a sentence with the reason stands in place of all but the table. ``file`` and
    ``settings`` (texts PATH=VALUE) are those of the command line."""
    table = allocation.table
    head = [
        "input",
        "low",
        "high",
        "halved",
        "95 % interval",
        "doubled",
        "95 % interval",
        "verdict",
    ]
    rows = [
        [
            row["input"],
            f"{row['low']:.6g}",
            f"{row['high']:.6g}",
            *_change(row, "half"),
            *_change(row, "double"),
            _passes(row),
        ]
        for row in table.to_dict("records")
    ]
    if not allocation.passes:  # then no doubled spread passes either
        head, rows = head[:-1], [row[:-1] for row in rows]
    verdict = "passes" if allocation.passes else "does not pass"
    lines = [
        f"probability of a violation {allocation.probability:.4g} in {allocation.cases} cases: the "
        f"campaign {verdict}",
        "changes of this probability if the spread of one input is halved or doubled:",
        *text_table([head, *rows], left=(0,)),
        *(f"{row['input']}: {row['note']}" for row in table.to_dict("records") if row["note"]),
        "",
    ]
    if not allocation.factors or not allocation.shown:
        return "\n".join([*lines, _without_proposal(allocation)])
    verb = "doubled" if allocation.passes else "halved"
    lines.append(
        f"requirements shown with {len(allocation.factors)} of {len(table)} spreads {verb}:"
    )
    lines += [f"  {line}" for line in _file_lines(allocation.settings)]
    assert allocation.verdicts is not None
    lines += render_verdicts(allocation.verdicts)
    lines.append(
        f"verdicts of {allocation.cases} cases of seed {allocation.verdict_seed}, which were not "
        f"used to choose the spreads; confidence raised for {MAX_TRIES} tries"
    )
    changed = [
        *settings,
        *(f"{k}={inline_toml(value)}" for k, value in allocation.settings.items()),
    ]
    words = ["sepmc", "campaign", file, *(word for one in changed for word in ("--set", one))]
    words += ["--cases", str(allocation.cases), "--seed", str(allocation.verdict_seed)]
    return "\n".join([*lines, f"the same cases again: {shlex.join(words)}"])


def _without_proposal(allocation: Allocation) -> str:
    """Return the sentence that stands in place of a proposal: no spread helps when it is halved,
    halving all that help is not enough, or no spread can be doubled. The last one also says whether
    the unchanged spreads pass their run with another seed."""
    if allocation.verdicts is None:
        return (
            "no proposal: no single halved spread lowers the probability with 95 % confidence: "
            "change the design, or give more --cases"
        )
    if not allocation.passes:
        return (
            "no proposal: requirements not shown even with all spreads halved whose halving helps, "
            f"{len(allocation.factors)} of {len(allocation.table)}: change the design, or give "
            "more --cases"
        )
    unchanged = f"with no spread doubled, a run of seed {allocation.verdict_seed}"
    if allocation.shown:
        return f"no proposal: {unchanged} shows all requirements, no run with doubled spreads did"
    return (
        f"no proposal: even {unchanged} does not show all requirements at the confidence raised "
        f"for {MAX_TRIES} tries: the margin is too small for --cases {allocation.cases}"
    )


def _change(row: Mapping[Any, Any], name: str) -> list[str]:
    """Return two texts: the change of the violation probability if the spread of one input, a
    ``row`` of `Allocation.table`, is halved (``name`` is "half") or doubled ("double"), and its
    95 % interval; dashes if it is not known."""
    if row[name] != row[name]:
        return ["-", "-"]
    interval = f"{row[f'{name}_low']:+.3g} to {row[f'{name}_high']:+.3g}"
    return [f"{row[name]:+.3g}", interval]


def _passes(row: Mapping[Any, Any]) -> str:
    """Return "may be doubled" if the run with the doubled spread of one input, a ``row`` of
    `Allocation.table`, shows all requirements; else "fails", or a dash if that is unknown."""
    return {True: "may be doubled", False: "fails"}.get(row["double_passes"], "-")


def _file_lines(settings: Mapping[str, Any]) -> list[str]:
    """Return the lines of the table [dispersion] of a campaign file, without its header: one for
    each entry of ``settings``, the distributions by ``dispersion.`` and the key of the line."""
    return [
        f'"{key.removeprefix("dispersion.")}" = {inline_toml(value)}'
        for key, value in settings.items()
    ]
