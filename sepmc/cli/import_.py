"""`sepmc import`: convert a file in a format of the field to TOML for a campaign."""

from pathlib import Path
from typing import Any

import click

from sepmc.cli.options import check_out_file, overwrite_option

_KINDS = ("motor", "aero", "air", "wind", "initial", "mass")
_BESIDE = ("convention", "per", "lateral_length", "reference_", "moment_point")


@click.command(name="import", short_help="Convert a file of the field to TOML for a campaign.")
@click.argument("file", type=click.Path(path_type=Path))
@click.option("--as", "kind", type=click.Choice(_KINDS), required=True, help="Content of FILE.")
@click.option(
    "--set",
    "settings",
    multiple=True,
    metavar="KEY=VALUE",
    help="A key that stands beside file in a campaign, such as engine=C6, case=2 or "
    "total_impulse_N_s=12; of a deck also one that stands beside its table, such as "
    "convention=datcom.",
)
@click.option(
    "--out", type=click.Path(path_type=Path), help="TOML file to write. Default: print the TOML."
)
@overwrite_option("the file in --out")
def import_(
    file: Path, kind: str, settings: tuple[str, ...], out: Path | None, overwrite: bool
) -> None:
    """Convert FILE, such as a thrust curve, an aerodynamic deck or a sounding, to the TOML table
    that file = "FILE" stands for in a campaign, and print it. Comments on standard error say how
    FILE was interpreted.

    \b
    Examples:
      sepmc import C6.eng --as motor
      sepmc import for006.dat --as aero --set case=2 --out deck.toml
    """
    import tomli_w

    from sepmc.formats.files import read_files
    from sepmc.scene.as_brought import convert_tree
    from sepmc.scene.messages import Problems
    from sepmc.scene.settings import parse_setting

    if out is not None:
        check_out_file(out, (".toml",), overwrite)
    table: dict[str, Any] = {"file": str(file.absolute())}
    table |= dict(map(parse_setting, settings))
    trees: dict[str, dict[str, Any]] = {
        "motor": {"motor": [{"name": "motor", "profile": table}]},
        "aero": {"body": {"body": {"aerodynamics": {"table": table}}}},
        "air": {"environment": {"air": table}},
        "wind": {"environment": {"wind": {"profile": table}}},
        "mass": {"body": {"body": {"mass_properties": table}}},
        "initial": {"initial": {"trajectory": table}},
    }
    tree = trees[kind]
    if kind == "aero":  # keys that stand beside the table
        aero = tree["body"]["body"]["aerodynamics"]
        for key in [each for each in table if each.startswith(_BESIDE)]:
            aero[key] = table.pop(key)
    azimuth = table.pop("azimuth_deg", None) if kind == "wind" else None
    if azimuth is not None:
        tree["environment"]["wind"]["azimuth_deg"] = azimuth
    problems = Problems()
    understood = read_files(tree, Path(), problems)
    if kind != "wind" or azimuth is not None:
        understood += convert_tree(tree, problems)
    problems.raise_if_any(file.name)
    text = tomli_w.dumps(tree)
    for sentence in understood:
        click.echo(f"# {sentence}", err=True)
    if out is None:
        click.echo(text, nl=False)
        return
    out.write_text(text, encoding="utf-8")
    click.echo(f"wrote {out}")
