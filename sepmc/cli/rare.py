"""What the command line does and tells of rare events: `sepmc campaign FILE --rare REQUIREMENT`."""

import math
import sys
from collections.abc import Mapping
from typing import TYPE_CHECKING, Any

import click

from sepmc.cli.options import load_campaign, redundant
from sepmc.cli.render import accuracy_text, for_screen, progress_bar, speaker, stopped

if TYPE_CHECKING:
    from sepmc.campaign.execution.rare_event import RareEventEstimate

RARE = click.option(
    "--rare",
    metavar="REQUIREMENT",
    help="Estimate how rarely a requirement is violated, down to 1e-6 and below, in no more "
    "flights than --cases (default 1e5).",
)
# options of `sepmc campaign` that have no meaning beside it, as they are read and written
_EXCLUDED = {
    "plan": "plan",
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
_INPUTS = 6  # that the violating cases have in common, on the screen


def tell_rare(requirement: str, given: Mapping[str, Any]) -> int:
    """Estimate how rarely a requirement is violated, into a folder, with what else was ``given`` to
    `sepmc campaign`. Returns the exit code: 3 if the audit failed or the accuracy asked was not
    met, 1 if no case came to its end."""
    for other, name in _EXCLUDED.items():
        if given[other]:
            raise click.UsageError(f"--rare and --{name} exclude each other")
    if not isinstance(given["cases"], int | None):
        raise click.UsageError("--rare takes how many flights are allowed, --cases 1e5, not which")
    say, loaded = speaker(given["quiet"]), load_campaign(given["file"], given["settings"])
    from sepmc.campaign.execution import limit_state, rare_event
    from sepmc.campaign.store import folders, manifests

    aim, most = (
        limit_state.limit_state(loaded, requirement),
        given["cases"] or rare_event.DEFAULT_FLIGHTS,
    )
    overwrite, resume, folder = given["overwrite"], given["resume"], given["out"]
    folder = folder or folders.next_folder(f"{loaded.name}-rare")
    if given["dry_run"]:
        folders.check_folder(folder, overwrite, resume)
        click.echo(f"{loaded.name}: {aim.sentence}; at most {most} flights, into {folder}")
        return 0
    with folders.opened(folder, overwrite, resume):
        with progress_bar(most, given["quiet"]) as progress:
            try:
                found = loaded.rare(
                    requirement,
                    most,
                    given["seed"],
                    folder,
                    threads=given["threads"],
                    resume=resume,
                    progress=progress,
                    announce=say,
                )
            except KeyboardInterrupt as error:
                word, code = stopped(error)
                click.echo(
                    f"\n{word}; what was flown is kept. Go on with the same command and "
                    f"--out {folder} --resume",
                    err=True,
                )
                sys.exit(code)
        for note in found.notes + redundant(loaded):
            click.echo(f"warning: {note}", err=True)
        say(text(found))
        manifest = manifests.read_manifest(folder)
        accuracy = manifest["accuracy"]
        stages = accuracy.get("stages") or [phase.name for phase in loaded.scene.phase]
        say(for_screen(accuracy_text(accuracy, stages)))
        if not given["no_plots"]:
            from sepmc.report.rare_figures import rare_figure

            keys = {d.parameter.column: d.parameter.key for d in loaded.file.dispersions}
            about = f"{loaded.name}, {aim.sentence}"
            manifests.record_derived(folder, [rare_figure(found, folder, keys, about)])
        say(f"wrote {folder}")
    faults = (
        (not found.statuses.get("ok"), 1, "no case was flown to the end"),
        (manifest["audit_beyond"], 3, "the audit failed; shorten solver.step_s"),
        (not accuracy.get("met", True), 3, "the accuracy asked was not met; see the warning above"),
    )
    code, why = next(((code, why) for fault, code, why in faults if fault), (0, ""))
    if code:
        click.echo(f"error: {why}", err=True)
    return code


def text(found: "RareEventEstimate") -> str:
    """An estimate as the screen shows it: levels, the probability, what violating cases have in
    common."""
    from sepmc.analysis.subset_simulation import equivalent_direct_cases

    unit = "" if found.unit == "1" else f" {found.unit}"
    low, high = found.interval
    lines = [
        f"{'level':>5s} {'margin' + unit:>14s} {'probability':>12s} {'of level':>9s} "
        f"{'accepted':>9s} {'cases':>7s}"
    ]
    for number, level in enumerate(found.levels):
        moves = "" if math.isnan(level.acceptance) else f"{level.acceptance:.2f}"
        lines.append(
            f"{number:5d} {level.threshold:14.5g} {level.reached:12.3e} {level.probability:9.3f} "
            f"{moves:>9s} {level.seeds:7d}"
        )
    mean = found.probability
    lines += [
        "",
        f"{found.requirement}: violated with a probability of {mean:.3e}, 95 % interval {low:.2e} "
        f"to {high:.2e}; {found.flights} flights",
    ]
    if found.unknown:
        lines.append(
            f"cases of which that is not known have a probability of {found.unknown:.2e}; from "
            f"none to all of them: {found.bounds[0]:.2e} to {found.bounds[1]:.2e}"
        )
    if mean and len(found.levels) > 1:
        least, greatest = min(found.replicas), max(found.replicas)
        plain = equivalent_direct_cases(mean, found.interval)
        lines.append(
            f"{len(found.replicas)} independent replicas: {least:.2e} to {greatest:.2e}"
            + (f"; plain cases for the same interval: {plain:.1e}" if plain > 0.0 else "")
        )
    if found.inputs:
        lines += ["", "cases that violate have in common (normal scores; of all cases 0 +- 1):"]
        some = list(found.inputs.items())[:_INPUTS]
        lines += [f"  {name:44s} {m:+6.2f} +- {s:.2f}" for name, (m, s) in some]
    return "\n".join(lines)
