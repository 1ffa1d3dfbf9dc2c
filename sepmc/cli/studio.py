"""`sepmc studio`: open a local page on which sliders change a campaign."""

import shlex
from typing import Any

import click

from sepmc.cli.exits import INTERRUPTED, stopped
from sepmc.cli.options import FILE, QUIET, SEED, SETTINGS, THREADS, load_campaign


def _parse_vary(text: str) -> tuple[str, tuple[float, float] | None]:
    """Parse the text ``KEY`` or ``KEY=LOW:HIGH``; return the key, and (low, high), or None if there
    is no range. Raises InputError for another form."""
    from sepmc.scene.design_tables import parse_range

    if "=" not in text:
        return text.strip(), None
    form = "KEY or KEY=LOW:HIGH, as spring.*.force_N=600:1200"
    key, (low, high) = parse_range(text, "--vary", form)
    return key, (low, high)


@click.command(short_help="Open a page with sliders for the parameters of FILE.")
@FILE
@click.option(
    "--vary",
    "varied",
    metavar="KEY[=LOW:HIGH]",
    multiple=True,
    help="Parameter that has a slider at the start, and the ends of the slider. Default: all "
    "dispersed parameters.",
)
@click.option(
    "--cases",
    type=int,
    default=2000,
    show_default=True,
    help="Cases of every run, on common random numbers.",
)
@SEED
@SETTINGS
@THREADS
@click.option(
    "--port",
    type=click.IntRange(min=0, max=65535),
    default=0,
    show_default=True,
    help="Port of this machine; 0: any free port.",
)
@click.option("--no-browser", is_flag=True, help="Print the address, and open no browser.")
@QUIET
def studio(
    file: str,
    varied: tuple[str, ...],
    cases: int,
    seed: int | None,
    settings: tuple[str, ...],
    threads: int | None,
    port: int,
    no_browser: bool,
    quiet: bool,
) -> None:
    """Open a page with sliders for values and spreads of the parameters of FILE. After each move of
    a slider the cases are run again, and histograms, verdicts and the worst case are updated.

    The page is served to this machine only, at an address with a secret token. Nothing is written;
    the page copies the settings as a command. Ctrl-C ends it.

    \b
    Example:
      sepmc studio table2.toml --vary motor.retro.thrust_N=300:700
    """
    from sepmc.cli.figures import ranked_outcomes
    from sepmc.cli.render import logger
    from sepmc.cli.size_results import other_settings
    from sepmc.processes import processes
    from sepmc.scene.settings import inline_toml, parse_setting
    from sepmc.studio.answers import Studio
    from sepmc.studio.server import Server
    from sepmc.studio.sliders import first_sliders

    def copies(changed: dict[str, Any], cases: int, seed: int) -> dict[str, str]:
        others = other_settings(settings, changed, campaign.file.tree)
        own = [f"{key}={inline_toml(value)}" for key, value in changed.items()]
        words = ["sepmc", "campaign", file, *(w for one in [*others, *own] for w in ("--set", one))]
        values = dict(parse_setting(text) for text in others) | changed
        return {
            "command": shlex.join([*words, "--cases", str(cases), "--seed", str(seed)]),
            "python": f"sepmc.load({file!r}, {values!r}).run({cases}, seed={seed})",
        }

    log = logger(quiet)
    campaign = load_campaign(file, (*settings, "run.history_step_s=0.0"))
    sliders = first_sliders(campaign, dict(_parse_vary(text) for text in varied))
    seed = campaign.checked_seed(seed)
    serving = False
    try:
        with processes(1) as second:  # ended at once by Ctrl-C
            answers = Studio(
                campaign, sliders, ranked_outcomes, copies, second, cases, seed, threads
            )
            with Server(answers, port) as server:
                answers.prepare(log)
                click.echo(f"{server.address}\nCtrl-C ends it")
                if not no_browser:
                    import webbrowser

                    webbrowser.open(server.address)
                serving = True
                server.serve_forever()
    except KeyboardInterrupt as error:
        if not serving or stopped(error)[1] != INTERRUPTED:
            raise
    log("ended")
