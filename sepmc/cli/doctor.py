"""What `sepmc doctor --repair` does to a run folder."""

from collections.abc import Callable, Sequence
from pathlib import Path

import click

from sepmc.campaign.campaign import load
from sepmc.campaign.store import folders, manifests
from sepmc.cli.render import tell_results

FIGURES = (".png", ".svg", ".pdf")
TABLES = (".csv", ".html")


def mend(folder: Path, found: Sequence[manifests.Finding], say: Callable[[str], None]) -> int:
    """Make anew what was found wrong with a run folder; returns the exit code: 1 if it is not as it
    was afterwards.

    Raises
    ------
    StoreError
        If what was flown is gone or was changed: nothing tells what it was.
    """
    for finding in found:
        if not finding.repairable:
            raise folders.StoreError(f"{finding.text}. It cannot be mended; {finding.advice}")
    known = folders.ledger_is_intact(folder)
    manifests.ensure_ledger(folder)
    manifest = manifests.read_provenance(folder)
    loaded = load(folder, verify=False)
    result = loaded.run(
        manifest.get("numbers", manifest.get("cases")),
        manifest.get("seed"),
        out=folder,
        resume=True,
        announce=say,
    )
    flown = sum(result.status_counts.values()) - result.resumed
    figures = not known or any(finding.file.endswith(FIGURES) for finding in found)
    tell_results(folder, loaded, result.kept.summary, lambda text: None, plots=figures)
    say(f"{folder}: {flown} cases flown again{', figures drawn again' if figures else ''}")
    lost = manifests.forget_damaged(folder, FIGURES + TABLES)
    if lost:
        say(f"not made again: {', '.join(lost)}; sepmc plot, drivers, laws and report make them")
    left = manifests.diagnose(folder)
    for finding in left:
        click.echo(finding.text, err=True)
    return 1 if left else 0
