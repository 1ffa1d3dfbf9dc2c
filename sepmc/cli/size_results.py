"""Screen of `sepmc size`."""

import shlex
from collections.abc import Sequence

from sepmc.campaign.sizing import MAX_TRIES, Sizing
from sepmc.text_table import text_table


def render_sizing(sizing: Sizing, minimise: str, file: str, settings: Sequence[str]) -> str:
    """Render the chosen design, its cost, and the verdicts of the run with fresh cases."""
    lines = [f"{key} = {value:.6g}" for key, value in sizing.values.items()]
    lines.append(f"{minimise} = {sizing.cost:.6g}, the smallest of {len(sizing.searched)} designs")
    lines += [
        f"{key} is at an end of its range: a wider one may be better" for key in sizing.at_ends
    ]
    head = ["requirement", "verdict", "violations", "may", "confidence"]
    rows = [
        [
            str(name),
            str(row["verdict"]).upper(),
            str(row["violations"]),
            str(row["allowed"]),
            f"{row['confidence']:.4g}",
        ]
        for name, row in sizing.verdicts.to_dict("index").items()
    ]
    lines += text_table([head, *rows], left=(0, 1))
    lines.append(
        f"verdicts of {sizing.cases} cases of seed {sizing.seed}, which did not choose the design; "
        f"confidence raised for {MAX_TRIES} tries"
    )
    if not sizing.shown:
        lines.append(f"not shown after {sizing.tries} searches: give more --cases")
    changed = [*settings, *(f"{key}={value:.17g}" for key, value in sizing.values.items())]
    words = ["sepmc", "campaign", file, *(word for one in changed for word in ("--set", one))]
    words += ["--cases", str(sizing.cases), "--seed", str(sizing.seed)]
    lines.append(f"the same cases again: {shlex.join(words)}")
    return "\n".join(lines)
