"""Files that `sepmc map` writes, and text that it prints."""

import json
from pathlib import Path

import numpy as np

from sepmc import __version__
from sepmc.analysis.proportions import required_cases
from sepmc.analysis.requirements import FAIL, PASS
from sepmc.analysis.requirements_text import requirement_sentence
from sepmc.campaign.campaign import Campaign
from sepmc.campaign.design_map import DesignMap
from sepmc.campaign.label import of_settings
from sepmc.campaign.store import folders, shards
from sepmc.scene.model import Requirement
from sepmc.scene.parameters import find, value
from sepmc.scene.setting_checks import matching_keys
from sepmc.schema import Column


def write_table(designs: DesignMap, campaign: Campaign, path: Path) -> Path:
    """Write the table of a map as CSV or Parquet, by the ending of ``path``; return ``path``.
    If it cannot be written, Parquet raises StoreError, and CSV OSError."""
    table = designs.table
    if path.suffix.lower() == ".csv":
        folders.write_text(path, table.to_csv(index=False))
        return path
    columns = [Column(str(name), "", "") for name in table]
    about = {
        "campaign": campaign.name,
        "digest": campaign.digest,
        "cases": " ".join(map(str, designs.looks)),
        "seed": str(designs.seed),
        "settings": json.dumps(campaign.settings),
        "sepmc": __version__,
    }
    shards.write_parquet(
        path, columns, {str(name): table[name].to_numpy() for name in table}, about
    )
    return path


def figure_paths(campaign: Campaign, path: Path) -> list[Path]:
    """Return the paths of the figures of a map, one for each requirement: beside its table at
    ``path``, with the name of the requirement, STEM-REQUIREMENT.png."""
    names = [item.name for item in campaign.file.requirements]
    return [path.with_name(f"{path.stem}-{name}.png") for name in names]


def write_figures(designs: DesignMap, campaign: Campaign, path: Path) -> list[Path]:
    """Draw a figure of a map for each requirement, beside its table at ``path``; return the paths
    of the figures."""
    from sepmc.report.map_figure import map_figure

    nominal = tuple(_nominal(campaign, axis.key) for axis in designs.axes)
    items, paths = campaign.file.requirements, figure_paths(campaign, path)
    settings = of_settings(campaign.settings)
    return [
        map_figure(designs, item, _sentence(campaign, item), nominal, campaign.name, into, settings)
        for item, into in zip(items, paths, strict=True)
    ]


def _sentence(campaign: Campaign, item: Requirement) -> str:
    """Return a requirement of a campaign as one sentence, its bounds in the unit of the outcome."""
    units = {column.name: column.unit for column in campaign.outcome_columns}
    return requirement_sentence(item, units.get(item.metric, ""))


def _nominal(campaign: Campaign, key: str) -> float | None:
    """Return the nominal value of the design variable ``key`` in its unit; None if the key names
    several parameters with different values."""
    parameters = [find(campaign.scene, one) for one in matching_keys(campaign.file.tree, key)]
    values = {value(campaign.scene, each.path) / each.factor for each in parameters}
    return values.pop() if len(values) == 1 else None


def render_map(designs: DesignMap, campaign: Campaign) -> str:
    """Return a map as text: the numbers of designs and cases, and for each requirement the number
    of designs at which it is shown, refuted or open, with the reason where more cases would hardly
    help or where the cases are too few to show it at all."""
    lines = [
        f"{len(designs.table)} designs, {designs.cases_text}, seed {designs.seed}; largest "
        f"numerical error {designs.table['error'].max():.1e}"
    ]
    n_looks, most = len(designs.looks), designs.looks[-1]
    if n_looks > 1:
        more = int((designs.table["cases"] > designs.looks[0]).sum())
        lines.append(
            f"{more} of them had more cases, up to {most:,}, as they were open with fewer; "
            f"confidence raised for {n_looks} looks"
        )
    for item in campaign.file.requirements:
        verdicts = designs.table[item.name].to_numpy()
        shown, refuted = (int(np.count_nonzero(verdicts == word)) for word in (PASS, FAIL))
        rest = len(verdicts) - shown - refuted
        sentence = _sentence(campaign, item)
        lines.append(f"{sentence}: shown at {shown} designs, refuted at {refuted}, open at {rest}")
        if lacking := int(np.count_nonzero(designs.open_by_lacking(item))):
            lines.append(
                f"  at {lacking} of the open designs, cases did not finish or lack the outcome: as "
                "violations they would refute it, as unknown cases they do not, and more cases "
                "hardly help"
            )
        needed = required_cases(0, item.probability, designs.confidence(item))
        if most < needed:
            option = "--max-cases" if n_looks > 1 else "--cases"
            lines.append(f"  {most} cases cannot show it; give at least {option} {needed}")
    return "\n".join(lines)
