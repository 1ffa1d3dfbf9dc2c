"""Analysis of a run: inputs that drive its outcomes, and inputs that distinguish its failures."""

from collections.abc import Callable
from concurrent.futures import Executor
from dataclasses import dataclass
from functools import partial
from pathlib import Path

import numpy as np
import pandas as pd

from sepmc.analysis import constant_outcomes, failure_attribution, sensitivity
from sepmc.analysis.sensitivity import leading_inputs
from sepmc.analysis.statistics import column, ok_rows
from sepmc.campaign.campaign import Campaign
from sepmc.campaign.run_statistics import RunStatistics
from sepmc.campaign.store import folders, shards
from sepmc.cli.figures import ranked_outcomes, run_title, submitted
from sepmc.cli.render import warn
from sepmc.report.sensitivity_figures import (
    SCATTERED_INPUTS,
    attribution_figure,
    scatter_figure,
    tornado_figure,
)
from sepmc.scene.messages import nearest
from sepmc.scene.model import VIOLATION, Requirement
from sepmc.schema import Status

_DEFAULT = 4  # outcomes that are analysed unless some are named


@dataclass
class InputSensitivity:
    """Sensitivities of outcomes to inputs, and attribution of failures to inputs.

    A kind of failure is the name of a requirement that is violated, a status other than ok, or
    ``REQUIREMENT, missing``: cases without the required outcome.

    Attributes
    ----------
    sensitivities : dict of str to DataFrame
        By outcome: sensitivity measures, a row per input.
    attributions : dict of str to list of Attribution
        By kind of failure, also for requirements that no case violates: inputs, and pairs of
        inputs, that distinguish its cases. Empty if none does, or if the test is invalid for the
        ``design`` (sobol and saltelli).
    failures : dict of str to str
        By kind of failure that occurred: text with the number of its cases.
    keys : dict of str to str
        TOML path of each input, by column.
    design : str
        Sampling design of the run; see `Definition.design`.
    """

    sensitivities: dict[str, pd.DataFrame]
    attributions: dict[str, list[failure_attribution.Attribution]]
    failures: dict[str, str]
    keys: dict[str, str]
    design: str = "random"

    def texts(self, width: int) -> tuple[list[str], list[str]]:
        """Return two lists of texts, tables of ``width`` characters: the sensitivities of each
        outcome, and the attribution of each kind of failure."""
        return (
            [
                sensitivity.render_sensitivities(table, name, self.keys, width=width)
                for name, table in self.sensitivities.items()
            ],
            [
                failure_attribution.render_attribution(
                    sentence, self.attributions[name], self.keys, width=width, design=self.design
                )
                for name, sentence in self.failures.items()
            ],
        )

    def notes(self) -> list[str]:
        """Return sentences on what the figures do not show: how indices were estimated, and
        failures that no input distinguishes."""
        notes = [
            f"{name}: {note}"
            for name, table in self.sensitivities.items()
            for note in sensitivity.index_notes(table, self.keys)
        ]
        return notes + [
            failure_attribution.render_attribution(sentence, (), self.keys, design=self.design)
            for name, sentence in self.failures.items()
            if not self.attributions[name]
        ]


def check_outcomes(campaign: Campaign, names: tuple[str, ...]) -> None:
    """Raise StoreError if a campaign has no outcome of one of the ``names``."""
    known = [column.name for column in campaign.outcome_columns]
    for name in names:
        if name not in known:
            raise folders.StoreError(f"{name}: no such outcome; {nearest(name, known)}")


def analyse(
    folder: Path, campaign: Campaign, run: RunStatistics, names: tuple[str, ...] = ()
) -> InputSensitivity:
    """Compute the sensitivities of the outcomes ``names`` of a run, by default of the four most
    important ones, and attribute violations and failures to inputs.

    An outcome whose sensitivities cannot be computed is left out with a printed warning. Raises
    StoreError for an unknown outcome.
    """
    rows, table, design = shards.CaseColumns(folder), run.table, campaign.design
    check_outcomes(campaign, names)
    keys = {d.parameter.column: d.parameter.key for d in campaign.file.dispersions}
    sensitivities = {}
    for name in names or ranked_outcomes(campaign, table)[:_DEFAULT]:
        try:
            sensitivities[name] = sensitivity.input_sensitivities(
                rows,
                list(keys),
                name,
                design,
                correlated=campaign.correlated,
                spread=constant_outcomes.max_spread(table, name),
            )
        except ValueError as error:
            warn(str(error))
    failed = [
        label for label, count in run.summary.counts.items() if count and label != Status.OK.label
    ]
    required = campaign.file.requirements
    attributions, failures = {}, {}
    for item in [*required, *(Requirement(name=label, metric=label) for label in failed)]:
        attributions[item.name] = failure_attribution.attribute_violations(
            item, rows, list(keys), required, design
        )
        violates, known = failure_attribution.violation_masks(item, rows, required)
        if count := int((violates & known).sum()):
            unknown = rows.rows - int(known.sum())
            why = "have no such outcome"
            if item.metric in run.summary.counts:
                why = "ended with another status than ok"
            elif item.metric == VIOLATION:
                why = "are not known to"
            others = f" ({unknown} others {why})" if unknown else ""
            failures[item.name] = f"{item.name}, {count} of {known.sum()} cases{others}"
        if item.metric in table.index:
            count, of_missing = failure_attribution.attribute_missing(
                item.metric, rows, list(keys), design
            )
            if count:
                name = f"{item.name}, missing"
                failures[name] = f"{item.name}, {count} ok cases without {item.metric}"
                attributions[name] = of_missing
    return InputSensitivity(sensitivities, attributions, failures, keys, design)


def draw_sensitivities(
    drivers: InputSensitivity,
    folder: Path,
    campaign: Campaign,
    into: Path,
    suffix: str = ".png",
    second: Executor | None = None,
) -> Callable[[], list[Path]]:
    """Draw two figures into the folder ``into``, in the process ``second`` if there is one: tornado
    charts of the sensitivities of a run, and scatter plots of outcomes over their leading inputs.
    ``suffix`` is the ending of the files. Returns a function that waits for the two files and
    returns them, none without sensitivities."""
    if not drivers.sensitivities:
        return list
    units = {c.name: c.unit for c in campaign.outcome_columns}
    title = run_title(folder)
    cases, required = shards.CaseColumns(folder), campaign.file.requirements
    ok = ok_rows(cases)
    by_metric: dict[str, np.ndarray] = {}  # rows: known violations, then unknown cases
    of_any = np.zeros((2, cases.rows), dtype=bool)
    for item in required:
        violates, known = failure_attribution.violation_masks(item, cases, required)
        masks = np.array([violates & known, ~known])
        by_metric[item.metric] = by_metric.get(item.metric, False) | masks
        of_any |= masks
    violating = {name: by_metric.get(name, of_any)[:, ok] for name in drivers.sensitivities}
    tables, keys = drivers.sensitivities, drivers.keys
    inputs = {
        str(name)
        for table in tables.values()
        for name in leading_inputs(table, SCATTERED_INPUTS).index
    }
    rows = {name: column(cases, name)[ok] for name in {*drivers.sensitivities, *inputs}}
    drawn = [
        submitted(partial(tornado_figure, tables, into, units, keys, title, suffix), second),
        submitted(
            partial(scatter_figure, tables, rows, violating, into, units, keys, title, suffix),
            second,
        ),
    ]
    return lambda: [path() for path in drawn]


def draw_attributions(
    drivers: InputSensitivity, folder: Path, into: Path, suffix: str = ".png"
) -> list[Path]:
    """Draw one figure of the inputs that distinguish violating and failed cases of a run, into the
    folder ``into``; returns the list of its file, empty without such inputs. ``suffix`` is the
    ending of the file."""
    known = {name: drivers.attributions[name] for name in drivers.failures}
    shown = {name: each for name, each in known.items() if each}
    if not shown:
        return []
    keys, title = drivers.keys, run_title(folder)
    return [attribution_figure(shown, drivers.failures, into, keys, title, suffix)]
