"""`sepmc template` writes a campaign to start from; `sepmc list` lists the shipped campaigns."""

from pathlib import Path

import click

from sepmc.cli.options import check_out_file, overwrite_option
from sepmc.text_table import text_table


@click.command(short_help="Write a starter campaign.")
@click.argument("file", default="separation.toml", type=click.Path(path_type=Path))
@overwrite_option("FILE")
def template(file: Path, overwrite: bool) -> None:
    """Write a commented campaign to start from into FILE (separation.toml): two stages, springs, a
    motor, a clearance and requirements. It runs as it is.

    \b
    Example:
      sepmc template rocket.toml
    """
    from importlib.resources import files

    check_out_file(file, (), overwrite, other="FILE")
    text = files("sepmc").joinpath("template.toml").read_text(encoding="utf-8")
    file.write_text(text.replace("separation.toml", file.name), encoding="utf-8")
    click.echo(f"wrote {file}; run it with: sepmc campaign {file}")


@click.command(name="list")
def list_campaigns() -> None:
    """List the campaigns that come with sepmc. Each name can be given as FILE to a command.

    \b
    Example:
      sepmc list
    """
    import tomllib

    from sepmc.scene.campaign_files import shipped_campaigns

    campaigns = shipped_campaigns().items()
    titles = {name: tomllib.loads(path.read_text(encoding="utf-8")) for name, path in campaigns}
    rows = [(name, tree.get("title", "")) for name, tree in titles.items()]
    click.echo("\n".join(text_table(rows, left=(0, 1))))
