"""`sepmc check`: validate a file and describe its scene and kernel."""

import shlex
import warnings
from itertools import islice
from textwrap import fill
from typing import TYPE_CHECKING

import click

from sepmc.cli.options import FILE, SETTINGS, load_campaign, redundant, undispersed
from sepmc.cli.render import warn

if TYPE_CHECKING:
    from sepmc.campaign.campaign import Campaign
    from sepmc.kernel.spec.structure import KernelSpec

# cases per batch, and number of batches at most, to count inertias that no solid body has
_BATCH, _BATCHES = 65_536, 16
_ROUGH = 1e-4  # accuracy of the nominal case
_WORK = 1.2e7  # kernel lines of the nominal case at most: 4 s


@click.command(short_help="Validate FILE, and describe its scene and kernel.")
@FILE
@SETTINGS
@click.option(
    "--code", is_flag=True, help="Print the kernel generated for the scene, a Python module."
)
@click.option("--no-flight", is_flag=True, help="Do not simulate the nominal case.")
def check(file: str, settings: tuple[str, ...], code: bool, no_flight: bool) -> None:
    """Validate FILE and show what it contains, and what its kernel computes and leaves out. Warns
    of probable mistakes; for these, the nominal case is simulated roughly, in a few seconds.

    \b
    Examples:
      sepmc check table2.toml --set body.upper.mass_kg=460
      sepmc check table2.toml --code > kernel.py
    """
    campaign = load_campaign(file, settings)
    from sepmc.kernel.spec.structure import make_kernel_spec

    spec = make_kernel_spec(campaign.layout, campaign.dispersed)
    if code:
        from sepmc.campaign.execution.step_selection import kernel_text

        for line in spec.names.legend:
            click.echo(fill(line, 100, initial_indent="# ", subsequent_indent="#   "))
        click.echo(kernel_text(campaign, history=campaign.scene.run.history_step > 0.0))
        return
    _show_scene(campaign, spec)
    warnings_shown = _input_warnings(campaign)
    warn(*warnings_shown)
    if no_flight or _check_nominal(campaign, warnings_shown):
        click.echo("can be run")
    else:
        click.echo(
            "can be read; whether it runs is not known, as a check may only do little work: "
            f"sepmc run {shlex.quote(file)} compiles it and runs the nominal case in full"
        )


def _show_scene(campaign: "Campaign", spec: "KernelSpec") -> None:
    """Print scene, kernel, cases, dispersions, requirements, scenarios and measurements of a
    campaign; ``spec`` describes its kernel. Raises SceneError if a scenario is not valid."""
    from sepmc.analysis.requirements_text import requirement_sentence
    from sepmc.campaign.execution.step_selection import stage_names
    from sepmc.campaign.label import as_text
    from sepmc.kernel.emit.module import features
    from sepmc.kernel.spec.describe import lines
    from sepmc.scene.budget import budget_lines
    from sepmc.scene.units import unit_text
    from sepmc.schema import history_columns

    click.echo(f"{campaign.name}: {campaign.file.title or 'no title'}")
    for sentence in campaign.file.understood:
        click.echo("  " + fill("understood   " + sentence, 100, subsequent_indent=" " * 15))
    for line in lines(campaign.layout):
        click.echo("  " + line)
    for line in budget_lines(campaign.scene):
        click.echo("  " + line)
    click.echo("  kernel       generated for the scene (print it with --code)")
    body_names = spec.names.back
    for segment, name in zip(spec.segments, stage_names(spec), strict=True):
        groups = [
            " and ".join(body_names.get(body, body) for body in group)
            for group in segment.groups
            if len(group) > 1
        ]
        rotation = "; ".join(f"{group} rotate as one rigid group" for group in groups)
        rows = f"{len(segment.rows)} constraint rows solved" if segment.rows else "no constraints"
        click.echo(f"    {name:14s} {rotation or 'all bodies rotate freely'}, {rows}")
    included, left_out = features(spec)
    click.echo(f"    includes       {', '.join(included)}")
    click.echo(f"    left out       {', '.join(left_out)}")
    selection, _ = campaign.select_cases()
    which = "" if selection.are_first else f" ({selection})"
    run = campaign.scene.run
    click.echo(f"  cases        {selection.count}{which}, seed {run.seed}, sampler {run.sampler}")
    dispersions = campaign.file.dispersions
    click.echo(f"  dispersed    {len(dispersions)} parameters")
    for dispersion in dispersions:
        key, _, distribution = dispersion.sentence.partition(": ")
        click.echo(f"    {key:44s} {distribution} {unit_text(dispersion.parameter.unit)}")
    for copula in campaign.file.copulas:
        keys = [dispersions[index].parameter.key for index in copula.places]
        click.echo(f"    correlated: {', '.join(keys)}")
    required = campaign.file.requirements
    units_of_histories = {c.name: c.unit for c in history_columns(campaign.layout.contents)}
    units = {column.name: column.unit for column in campaign.outcome_columns}
    click.echo(f"  required     {len(required) or 'nothing'}")
    for item in required:
        click.echo("    " + requirement_sentence(item, units.get(item.metric, "")))
    campaign.scenarios()  # one that gives no valid campaign is reported here
    for scenario in campaign.file.scenarios:
        values = as_text(scenario.settings).items()
        click.echo(f"  scenario     {scenario.name}: {', '.join(f'{k} = {v}' for k, v in values)}")
    for one in campaign.file.measurements:
        delay = f", delay +- {one.delay_sigma:g} s" if one.delay_sigma else ""
        unit = units_of_histories[one.column]
        click.echo(f"  measured     {one.column}: {one.file}, sigma {one.sigma:g} {unit}{delay}")


def _input_warnings(campaign: "Campaign") -> list[str]:
    """Return warnings about a campaign that need no simulation: on its file and its sampling, and
    on the cases, among the first million or so, with inertias that no solid body can have."""
    from sepmc.campaign.execution.diagnostics import file_notes, sampling_notes
    from sepmc.campaign.execution.runner import implausible_note

    selection, total = campaign.select_cases()
    implausible = count = 0
    for first, end in islice(selection.split(_BATCH), _BATCHES):
        samples = campaign.sample(first, end - first, None, total)
        implausible += campaign.implausible_inertias(samples)
        count += end - first
    note = implausible_note(implausible, count)
    return [
        *sampling_notes(campaign, selection, total),
        *file_notes(campaign),
        *undispersed(campaign),
        *([note] if note else []),
        *redundant(campaign),
    ]


def _check_nominal(campaign: "Campaign", known: list[str]) -> bool:
    """Simulate the nominal case roughly; print its status, and its warnings that are not ``known``,
    which were printed before. Returns False if the case did not end within the work that a check
    may take."""
    from sepmc.campaign.execution.diagnostics import nominal_notes
    from sepmc.campaign.execution.single_case import UnknownError
    from sepmc.scene.messages import SceneWarning, no_log

    with warnings.catch_warnings():  # those of the file are shown already
        warnings.simplefilter("ignore", SceneWarning)
        rough = campaign.with_settings({"solver.accuracy": _ROUGH})
    try:
        history = rough.simulate(step_s=rough.scene.run.end_time, announce=no_log, plain_work=_WORK)
        attributes = history.attrs
    except UnknownError as error:
        click.echo("  nominal      did not reach its end")
        warn(f"the nominal case did not reach its end: {error}")
        return False
    click.echo(f"  nominal      {attributes['status']}")
    has_ended = attributes["status"] in ("ok", "never-released")
    messages = [*attributes["notes"], *nominal_notes(campaign, attributes["outcomes"], has_ended)]
    warn(*(message for message in messages if message not in known))
    return True
