"""`sepmc draw`: draw the vehicle of a file."""

from pathlib import Path

import click

from sepmc.cli.options import (
    FILE,
    SETTINGS,
    check_out_file,
    load_campaign,
    out_file_option,
    overwrite_option,
)


@click.command(short_help="Draw the vehicle of FILE.")
@FILE
@SETTINGS
@out_file_option("NAME.png", "PNG, SVG or PDF")
@overwrite_option("the drawing in --out")
def draw(file: str, settings: tuple[str, ...], out: Path | None, overwrite: bool) -> None:
    """Draw the vehicle of FILE at the start, from the side, from above and from behind, as NAME.png
    by default: outlines, centres of mass, joints, springs, motors with their thrust, and loads in
    body axes.

    \b
    Example:
      sepmc draw srb.toml --out srb.svg
    """
    campaign = load_campaign(file, settings)
    from sepmc.campaign.label import of_settings
    from sepmc.report.drawing import draw_vehicle

    path = out or Path(f"{campaign.name}.png")
    check_out_file(path, (".png", ".svg", ".pdf"), overwrite)
    name = campaign.file.title.replace("$", r"\$")  # matplotlib would set it as a formula
    title = f"{campaign.name}: {name}" if name else campaign.name
    title += of_settings(campaign.settings)
    click.echo(f"wrote {draw_vehicle(campaign.scene, campaign.file.dispersions, title, path)}")
