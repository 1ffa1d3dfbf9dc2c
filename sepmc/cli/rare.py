"""`sepmc campaign FILE --rare REQUIREMENT`: estimate a rare-event probability."""

import sys
from collections.abc import Mapping
from typing import Any

import click

from sepmc.cli.exits import FAILED, INVALID, first_fault, stopped
from sepmc.cli.options import load_campaign, redundant
from sepmc.cli.progress import progress_bar
from sepmc.cli.render import for_screen, logger, render_accuracy, render_rare_event, warn
from sepmc.cli.results import ACCURACY_FAULT, phases

RARE = click.option(
    "--rare",
    metavar="REQUIREMENT",
    help="Estimate the probability that a requirement is violated, down to 1e-6 and below, by "
    "subset simulation with at most --cases cases (default 1e5).",
)
# parameters of `sepmc campaign` that have no meaning with --rare, and their options
_EXCLUDED = {
    "samples": "samples",
    "sampler": "sampler",
    "until": "until",
    "stats_only": "stats-only",
    "keep": "keep",
    "keep_columns": "keep-columns",
    "float32": "float32",
    "workers": "workers",
    "cluster": "cluster",
    "max_failures": "max-failures",
    "fail_fast": "fail-fast",
    "must_pass": "check",
}


def estimate_rare_event(requirement: str, parameters: Mapping[str, Any]) -> int:
    """Estimate the probability that a requirement is violated, write the estimate into a folder,
    and print it. ``parameters`` are the options of `sepmc campaign` by name; with its ``dry_run``
    only the request is checked and printed. Returns the exit code: 1 without a case whose status is
    ok, 3 if the audit or the accuracy fails, else 0. Raises UsageError for an option that a
    rare-event estimate cannot have."""
    for other, name in _EXCLUDED.items():
        if parameters[other] is not None and parameters[other] is not False:
            raise click.UsageError(f"--rare and --{name} exclude each other")
    if not isinstance(parameters["cases"], int | None):
        raise click.UsageError("--rare takes a number of cases, --cases 1e5, not a selection")
    log = logger(parameters["quiet"])
    campaign = load_campaign(parameters["file"], parameters["settings"])
    from sepmc.campaign.execution import limit_state, rare_event
    from sepmc.campaign.store import folders, manifests

    limit = limit_state.limit_state(campaign, requirement)
    flights = parameters["cases"] or rare_event.DEFAULT_FLIGHTS
    overwrite, resume = parameters["overwrite"], parameters["resume"]
    folder = parameters["out"] or folders.next_folder(f"{campaign.name}-rare")
    if parameters["dry_run"]:
        folders.check_folder(folder, overwrite, resume)
        click.echo(f"{campaign.name}: {limit.sentence}; at most {flights} cases, into {folder}")
        return 0
    with folders.opened(folder, overwrite, resume):
        with progress_bar(flights, parameters["quiet"]) as progress:
            try:
                estimate = campaign.rare(
                    requirement,
                    flights,
                    parameters["seed"],
                    folder,
                    threads=parameters["threads"],
                    resume=resume,
                    progress=progress,
                    announce=log,
                )
            except KeyboardInterrupt as error:
                word, code = stopped(error)
                click.echo(
                    f"\n{word}; finished cases are stored. Continue with the same command and "
                    f"--out {folder} --resume",
                    err=True,
                )
                sys.exit(code)
        warn(*estimate.notes, *redundant(campaign))
        log(render_rare_event(estimate))
        manifest = manifests.read_manifest(folder)
        accuracy = manifest["accuracy"]
        log(for_screen(render_accuracy(accuracy, phases(campaign, accuracy))))
        if not parameters["no_plots"]:
            from sepmc.report.rare_figures import rare_figure

            keys = {d.parameter.column: d.parameter.key for d in campaign.file.dispersions}
            title = f"{campaign.name}, {limit.sentence}"
            manifests.record_derived(folder, [rare_figure(estimate, folder, keys, title)])
        log(f"wrote {folder}")
    return first_fault(
        (not estimate.statuses.get("ok"), FAILED, "no case ended with status ok"),
        (manifest["audit_beyond"], INVALID, "the audit failed; shorten solver.step_s"),
        (not accuracy.get("met", True), INVALID, ACCURACY_FAULT),
    )
