"""`sepmc compile`: compile the kernel of a file before it is run."""

import time

import click

from sepmc.cli.options import FILE, QUIET, SETTINGS, load_campaign
from sepmc.cli.render import logger


@click.command(name="compile", short_help="Compile the kernel of FILE before its first run.")
@FILE
@SETTINGS
@click.option(
    "--stats-only",
    is_flag=True,
    help="Compile the kernel of a campaign with --stats-only, which stores no histories.",
)
@click.option(
    "--fallbacks",
    is_flag=True,
    help="Also compile the fallback kernels, which run the cases that the standard one rejects.",
)
@QUIET
def compile_(
    file: str, settings: tuple[str, ...], stats_only: bool, fallbacks: bool, quiet: bool
) -> None:
    """Compile the kernel of FILE into the cache, so that its first campaign starts at once. Runs no
    case.

    \b
    Example:
      sepmc compile srb.toml --fallbacks
    """
    log = logger(quiet)
    campaign = load_campaign(file, settings)
    from sepmc.campaign.execution import step_selection
    from sepmc.engine.dispatch import load_kernel
    from sepmc.kernel.spec.structure import make_kernel_spec
    from sepmc.kernel.spec.variant import Variant

    history = campaign.scene.run.history_step > 0.0 and not stats_only
    spec = make_kernel_spec(campaign.layout, campaign.dispersed)
    variants = [Variant.STANDARD, *(spec.fallbacks if fallbacks else ())]
    start = time.perf_counter()
    for variant in variants:
        load_kernel(step_selection.kernel_text(campaign, history=history, variant=variant), log)
    kernels = "its kernel is" if len(variants) == 1 else f"its {len(variants)} kernels are"
    log(f"{campaign.name}: {kernels} in the cache, after {time.perf_counter() - start:.1f} s")
