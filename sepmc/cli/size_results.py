"""Text that `sepmc size` prints, and the table of a trade-off that it writes."""

import shlex
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from sepmc import __version__
from sepmc.campaign.campaign import Campaign
from sepmc.campaign.design_search import cost_names
from sepmc.campaign.sizing import MAX_TRIES, Sizing
from sepmc.campaign.store import shards
from sepmc.campaign.trade_off import TradeOff
from sepmc.scene.design_tables import Variable
from sepmc.scene.messages import Problems
from sepmc.scene.setting_checks import expand, parts, split_units
from sepmc.schema import Column
from sepmc.text_table import text_table

if TYPE_CHECKING:
    import pandas as pd

_NEAREST = 12  # designs of the search that a record keeps


def repeat_command(sizing: Sizing, file: str, settings: Sequence[str], tree: dict[str, Any]) -> str:
    """Return the command that repeats the run for the verdict of a sizing; ``settings`` are the
    texts PATH=VALUE of the command line, and ``tree`` is the TOML tree of the campaign."""
    changed = [
        *other_settings(settings, sizing.values, tree),
        *(f"{key}={value:.17g}" for key, value in sizing.values.items()),
    ]
    words = ["sepmc", "campaign", file, *(word for one in changed for word in ("--set", one))]
    return shlex.join([*words, "--cases", str(sizing.cases), "--seed", str(sizing.seed)])


def sizing_record(
    sizing: Sizing,
    campaign: Campaign,
    variables: Sequence[Variable],
    minimise: str,
    subject_to: Sequence[str],
    command: str,
) -> dict[str, Any]:
    """Return all that a reviewer needs of a sizing as JSON data: what was varied and minimised, the
    search and the designs in it whose costs are nearest to that of the chosen one, and the verdict.

    Parameters
    ----------
    sizing : Sizing
    campaign : Campaign
        With the values of the file.
    variables : sequence of Variable
    minimise : str
        Formula of the cost.
    subject_to : sequence of str
        Names of the requirements; empty for all.
    command : str
        From `repeat_command`.

    Returns
    -------
    dict
    """
    searched = _distinct(sizing)
    nearest = (searched["cost"] - sizing.cost).abs().sort_values(kind="stable").index[:_NEAREST]
    return {
        "campaign": campaign.name,
        "digest": campaign.digest,
        "settings": campaign.settings,
        "sepmc": __version__,
        "minimise": minimise,
        "vary": {one.name: {"key": one.key, "low": one.low, "high": one.high} for one in variables},
        "subject_to": list(subject_to) or [item.name for item in campaign.file.requirements],
        "design": sizing.values,
        "cost": sizing.cost,
        "at_ends": list(sizing.at_ends),
        "nearest_not_accepted": _not_accepted(sizing),
        "search": {
            "cases": sizing.search_cases,
            "seed": sizing.search_seed,
            "searches": sizing.tries,
            "designs": len(searched),
            "accepted": int((searched["margin"] >= 0.0).sum()),
            "nearest": searched.loc[nearest].to_dict("records"),
        },
        "verdict": {
            "shown": sizing.shown,
            "cases": sizing.cases,
            "seed": sizing.seed,
            "confidence_raised_for_runs": MAX_TRIES,
            "requirements": sizing.verdicts.to_dict("index"),
            "warnings": list(sizing.verdict.notes),
        },
        "command": command,
    }


def _distinct(sizing: Sizing) -> "pd.DataFrame":
    """Return the table `Sizing.searched` with one row, the first, for each design."""
    return sizing.searched.drop_duplicates(list(sizing.values))


def _not_accepted(sizing: Sizing) -> dict[str, float] | None:
    """Return the design, as {TOML path: value}, that is nearest to the chosen one among those that
    the search did not accept. None with more than one design variable, or if all were accepted."""
    rejected = sizing.searched[sizing.searched["margin"] < 0.0]
    if len(sizing.values) > 1 or rejected.empty:
        return None
    ((key, value),) = sizing.values.items()
    values = rejected[key].to_numpy(float)
    return {key: float(values[np.abs(values - value).argmin()])}


def render_sizing(sizing: Sizing, minimise: str, command: str) -> str:
    """Return a sizing as text: the chosen design, its cost, the verdicts of its run with another
    seed, and the ``command`` that repeats that run. ``minimise`` is the formula of the cost. If the
    verdicts do not show the requirements, a line says so."""
    lines = [f"{key} = {value:.6g}" for key, value in sizing.values.items()]
    searched = _distinct(sizing)
    accepted = int((searched["margin"] >= 0.0).sum())
    lines.append(
        f"{minimise} = {sizing.cost:.6g}, the smallest of {accepted} accepted designs, "
        f"of {len(searched)} searched with {sizing.search_cases} cases of seed "
        f"{sizing.search_seed}"
    )
    lines += [
        f"{key} = {value:.6g}, the nearest design searched, is not accepted"
        for key, value in (_not_accepted(sizing) or {}).items()
    ]
    lines += [
        f"{key} is at an end of its range: a wider range may be better" for key in sizing.at_ends
    ]
    lines += render_verdicts(sizing.verdicts)
    lines.append(
        f"verdicts of {sizing.cases} cases of seed {sizing.seed}, which were not used to choose "
        f"the design; confidence raised for {MAX_TRIES} tries"
    )
    if not sizing.shown:
        lines.append(f"requirements not shown after {sizing.tries} searches: give more --cases")
    lines.append(f"the same cases again: {command}")
    return "\n".join(lines)


def render_trade_off(result: TradeOff, variables: Sequence[Variable]) -> str:
    """Return the designs of a trade-off as text: a table of values, costs and verdicts, a row each;
    then the formulas of the costs and the TOML paths of the variables."""
    costs = cost_names(len(result.minimise))
    verdicts = [str(name) for name in result.table if f"{name}_violations" in result.table]
    head = [*(one.name for one in variables), *costs, *verdicts, "seed"]
    rows = [
        [
            *(f"{row[key]:.6g}" for key in (*(one.key for one in variables), *costs)),
            *(f"{row[name].upper()} ({row[f'{name}_violations']} violate)" for name in verdicts),
            str(row["seed"]),
        ]
        for row in result.table.to_dict("records")
    ]
    lines = text_table([head, *rows])
    lines += [f"{name} = {text}" for name, text in zip(costs, result.minimise, strict=True)]
    lines += [f"{one.name} = {one.key}" for one in variables]
    lines.append(
        f"verdicts of {result.cases} cases of these seeds, which were not used to choose the "
        f"designs; confidence raised for {result.tries} runs, so that it holds for all designs "
        "together"
    )
    if not result.shown:
        lines.append("requirements are not shown for every design: give more --cases")
    return "\n".join(lines)


def write_trade_off(result: TradeOff, campaign: Campaign, path: Path) -> Path:
    """Write the front of a trade-off as Parquet; return its path. The name and checksum of the
    campaign, and what each cost is, go into its metadata. Raises StoreError if it cannot be
    written."""
    about = {"campaign": campaign.name, "digest": campaign.digest, "sepmc": __version__}
    about |= {f"cost_{k}": text for k, text in enumerate(result.minimise, start=1)}
    columns = [Column(str(name), "", "") for name in result.table]
    values = {str(name): result.table[name].to_numpy() for name in result.table}
    shards.write_parquet(path, columns, values, about)
    return path


def render_verdicts(verdicts: "pd.DataFrame") -> list[str]:
    """Return the verdicts of a run (`Result.requirements`) as lines of a table: a header, then a
    row for each requirement."""
    head = ["requirement", "verdict", "violations", "allowed", "confidence"]
    rows = [
        [
            str(name),
            str(row["verdict"]).upper(),
            str(row["violations"]),
            str(row["allowed"]),
            f"{row['confidence']:.4g}",
        ]
        for name, row in verdicts.to_dict("index").items()
    ]
    return text_table([head, *rows], left=(0, 1))


def other_settings(
    settings: Sequence[str], design: Mapping[str, float], tree: dict[str, Any]
) -> list[str]:
    """Return the ``settings`` (texts PATH=VALUE) without those of parameters that a ``design``
    (values by TOML path) replaces, also if in another unit. If a path with wildcards names some of
    them, the settings of its other parameters remain, one by one; ``tree`` is the TOML tree of the
    campaign."""
    replaced = {_path(key) for key in expand(dict(design), tree, Problems())}
    kept = []
    for setting in settings:
        key, equals, value = setting.partition("=")
        keys = list(expand({key.strip(): None}, tree, Problems()))
        others = [one for one in keys if _path(one) not in replaced]
        kept += [setting] if others == keys else [f"{one}{equals}{value}" for one in others]
    return kept


def _path(key: str) -> tuple[str, ...]:
    """Return the keys of a TOML path without units: ("body", "upper", "mass") of
    "body.upper.mass_kg"."""
    return split_units(parts(key))[0]
