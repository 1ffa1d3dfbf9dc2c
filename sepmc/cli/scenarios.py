"""`sepmc scenarios`: run a campaign and its failure cases, and show verdicts side by side."""

import sys
from pathlib import Path

import click

from sepmc.cli.options import CASES, CHECK, FILE, QUIET, SEED, SETTINGS, THREADS, load_campaign


@click.command(short_help="Run FILE and each of its scenarios, verdicts side by side.")
@FILE
@CASES
@SEED
@SETTINGS
@THREADS
@click.option(
    "--out",
    type=click.Path(path_type=Path),
    help="New folder, with a run folder for each scenario. Default: runs/NAME-scenarios-N.",
)
@click.option(
    "--limits",
    "with_limits",
    is_flag=True,
    help="Also simulate every input at its low and high end, one at a time, and the worst "
    "combination found for each requirement.",
)
@click.option("--resume", is_flag=True, help="Run only the cases missing in --out.")
@CHECK
@QUIET
def scenarios(
    file: str,
    cases: int | None,
    seed: int | None,
    settings: tuple[str, ...],
    threads: int | None,
    out: Path | None,
    with_limits: bool,
    resume: bool,
    must_pass: bool,
    quiet: bool,
) -> None:
    """Run the dispersed cases of FILE, and those of each of its [[scenario]] tables, into a folder
    with a run folder for each, and print the verdicts side by side.

    All runs have the same random numbers, so that they differ only by the scenarios. Each run
    folder works with every command that takes one.

    --limits adds limit cases of FILE itself, with outcomes and margins: one input at its low or
    high end and the others nominal, and the worst combinations of ends found. limits.csv in the
    folder is a table for --samples. If FILE has no [[scenario]], --limits runs the limit cases
    only. --check (exit code 1 unless every verdict is pass) does not judge limit cases: together
    with --limits it needs a [[scenario]].

    \b
    Example:
      sepmc scenarios rocket.toml --cases 2000 --out runs/failures
    """
    from sepmc.campaign.limit_cases import limit_cases
    from sepmc.campaign.scenarios import run_scenarios
    from sepmc.campaign.store import folders
    from sepmc.cli.exits import FAILED, first_fault
    from sepmc.cli.options import check_required
    from sepmc.cli.progress import progress_bar
    from sepmc.cli.render import logger, show
    from sepmc.cli.scenario_results import render_limits, render_scenarios, unmet_verdicts
    from sepmc.scene.messages import InputError
    from sepmc.scene.scenarios import BASELINE

    if resume and out is None:
        raise click.UsageError("--resume needs --out, the folder to continue in")
    campaign = load_campaign(file, settings)
    check_required(campaign, must_pass)
    if must_pass and with_limits and not campaign.file.scenarios:
        raise click.UsageError(
            f"--check judges the cases of scenarios, not limit cases: {campaign.name} needs a "
            "[[scenario]], or leave out --limits or --check"
        )
    folder = out or folders.next_folder(f"{campaign.name}-scenarios")
    has_runs = (folder / BASELINE).is_dir()
    if resume and not has_runs:
        raise InputError(
            f"{folder}: has no run of the scenarios to resume; to start one, leave out "
            "--resume and give --out a new folder"
        )
    if folder.exists() and not resume:
        resuming = "add --resume to run its missing cases, or " if has_runs else ""
        raise InputError(f"{folder}: exists; {resuming}choose another --out")
    log, runs, text = logger(quiet), None, []
    if campaign.file.scenarios or not with_limits:
        count = campaign.select_cases(cases)[0].count
        total = count * (1 + len(campaign.file.scenarios))
        finished: dict[str, int] = {}
        failures: dict[str, int] = {}
        with progress_bar(total, quiet) as report:

            def progress(name: str, done: int, _: int, failed: int) -> None:
                finished[name], failures[name] = done, failed
                if report:
                    report(sum(finished.values()), total, sum(failures.values()))

            runs = run_scenarios(campaign, cases, seed, threads, folder, log, progress, resume)
        folders.write_text(folder / "scenarios.csv", runs.table.to_csv(index=False))
        text.append(render_scenarios(runs))
    if with_limits:
        limits = limit_cases(campaign, threads, log)
        folder.mkdir(parents=True, exist_ok=True)
        folders.write_text(folder / "limits.csv", limits.table.to_csv(index=False))
        text.append(render_limits(limits, campaign))
    if not quiet:
        show("\n\n".join(text))
    tables = ", ".join(path.name for path in sorted(folder.glob("*.csv")))
    log(f"wrote {folder}: {tables}" + (", and a run folder for each" if runs else ""))
    unmet = unmet_verdicts(runs) if must_pass and runs else []
    message = f"--check: not every requirement is shown: {'; '.join(unmet)}"
    sys.exit(first_fault((unmet, FAILED, message)))
