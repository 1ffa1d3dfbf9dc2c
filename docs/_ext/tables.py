"""Tables of the site, generated from the package: columns, statuses, messages, units, campaigns and
modules."""

import ast
import re
import textwrap
import tomllib
from collections.abc import Iterable, Iterator
from pathlib import Path

from messages import (
    ARGUMENT_ERRORS,
    FOLDER_ERRORS,
    NOTE,
    PROBLEM,
    message_list,
    message_table,
)
from remedies import OF_FOLDERS, OF_NOTES

from sepmc.schema import (
    AUDIT_BOUNDS,
    Column,
    Contents,
    Status,
    audit_columns,
    history_columns,
    outcome_columns,
)

ROOT = Path(__file__).parents[2]
# One body, joint, clearance, event, motor and spring, with every output that a file can ask for.
EVERY = Contents(
    ["BODY"],
    {"JOINT": ("BODY", "OTHER")},
    loads=("JOINT",),
    guides={"JOINT": 1},
    clearances=("CLEARANCE",),
    tip_off=("JOINT",),
    events=("EVENT",),
    pins={"JOINT": 1},
    transverse=("BODY",),
    ignitions=("MOTOR",),
    springs=("SPRING",),
    partial_releases=(("JOINT", "KIND"),),
    signals=("SIGNAL",),
    hinges=("JOINT",),
    relative=(("OTHER", "BODY"),),
)


def markdown(header: Iterable[str], rows: Iterable[Iterable[str]]) -> str:
    """Render a Markdown table."""
    header = list(header)
    lines = [header, ["---"] * len(header), *rows]
    return "\n".join(
        "| " + " | ".join(cell.replace("|", "\\|") for cell in r) + " |" for r in lines
    )


def _column_rows(columns: Iterable[Column]) -> Iterator[tuple[str, str, str]]:
    for column in columns:
        meaning = column.meaning.replace("pin 1", "pin N")
        yield f"`{column.name.replace('pin1', 'pinN')}`", column.unit, meaning


def outcomes() -> str:
    """Table of every outcome column: name, unit, meaning."""
    return markdown(("column", "unit", "meaning"), _column_rows(outcome_columns(EVERY)))


def audits() -> str:
    """Table of the audit columns: name, unit, bound, meaning."""
    bounds = {f"`{name}`": f"{bound:g}" for name, bound in AUDIT_BOUNDS.items()}
    rows = [
        (name, unit, bounds.get(name, "-"), meaning)
        for name, unit, meaning in _column_rows(audit_columns())
    ]
    return markdown(("column", "unit", "bound", "meaning"), rows)


def histories() -> str:
    """Table of the columns of one case's time history: name, unit, meaning."""
    return markdown(("column", "unit", "meaning"), _column_rows(history_columns(EVERY)))


def statuses() -> str:
    """Table of every status: label, meaning and remedy."""
    rows = [(f"`{status.label}`", status.meaning, status.remedy) for status in Status]
    return markdown(("status", "meaning", "what to do"), rows)


def notes() -> str:
    """Table of every warning and note, with its remedy."""
    return markdown(("message", "what to do"), message_table([NOTE], OF_NOTES))


def folder_errors() -> str:
    """Table of every error of run folders, workers and paths, with its remedy."""
    return markdown(("message", "what to do"), message_table(FOLDER_ERRORS, OF_FOLDERS))


def argument_errors() -> str:
    """List of every error of an argument or option."""
    return _message_list(ARGUMENT_ERRORS)


def problems() -> str:
    """List of every problem of a campaign file, by module."""
    return _message_list([PROBLEM, "FormatError"])


def _message_list(kinds: Iterable[str]) -> str:
    blocks = []
    for module, texts in message_list(kinds):
        wrapped = [
            textwrap.fill(text, 96, initial_indent="  ", subsequent_indent="      ")
            for text in texts
        ]
        blocks.append("\n".join([module, *wrapped, ""]))
    return "```text\n" + "\n".join(blocks) + "```"


def units() -> str:
    """Table of the units that may end a key, by kind of quantity."""
    from sepmc.scene.units import UNITS

    rows = [(kind, " ".join(f"`{suffix}`" for suffix in table)) for kind, table in UNITS.items()]
    return markdown(("quantity", "suffixes"), rows)


def campaigns() -> str:
    """Table of the shipped campaigns: name, title."""
    rows = []
    for file in sorted((ROOT / "campaigns").glob("*.toml")):
        title = tomllib.loads(file.read_text(encoding="utf-8")).get("title", "")
        rows.append((f"`{file.name}`", title))
    return markdown(("name", "title"), rows)


def modules() -> str:
    """Every module of the package with the first sentence of its docstring, by folder."""
    text: list[str] = []
    package = ROOT / "sepmc"
    folders = sorted({file.parent for file in package.rglob("*.py")})
    for folder in folders:
        title = folder.relative_to(ROOT).as_posix()
        summary = _first_sentence(folder / "__init__.py")
        text += [f"### `{title}/`", "", summary, ""]
        files = sorted(file for file in folder.glob("*.py") if file.name != "__init__.py")
        rows = [(f"`{file.name}`", _first_sentence(file)) for file in files]
        text += [markdown(("module", "content"), rows), ""] if rows else []
    return "\n".join(text)


def _first_sentence(file: Path) -> str:
    """First sentence of a module's docstring, as Markdown."""
    doc = ast.get_docstring(ast.parse(file.read_text(encoding="utf-8"))) if file.exists() else ""
    paragraph = " ".join((doc or "").split("\n\n")[0].split())
    head, stop, _ = paragraph.partition(". ")
    return (head + "." if stop else head).replace("*", "\\*").replace("<", "\\<")


def commands() -> str:
    """Every command with its usage, help, arguments and options, from click."""
    import click

    from sepmc.cli.app import main

    text: list[str] = []
    for name, command in sorted(main.commands.items()):
        context = click.Context(command, info_name=f"sepmc {name}", max_content_width=100)
        usage = " ".join(command.collect_usage_pieces(context))
        text += [f"## `sepmc {name}`", "", "```text", f"sepmc {name} {usage}", "```", ""]
        text += [_help(command.help or ""), ""]
        records = [
            record
            for parameter in command.get_params(context)
            if (record := parameter.get_help_record(context)) and "--help" not in record[0]
        ]
        rows = [(f"`{option}`", _escaped(about)) for option, about in records if about]
        text += [markdown(("option", "meaning"), rows), ""] if rows else []
    return "\n".join(text)


def _help(text: str) -> str:
    """Help text of a command as Markdown: paragraphs, and preformatted ones as code."""
    parts = []
    for paragraph in text.split("\n\n"):
        if paragraph.lstrip().startswith("\b"):
            lines = textwrap.dedent(paragraph.replace("\b", " ")).strip()
            parts.append(f"```text\n{lines}\n```")
        else:
            parts.append(_escaped(" ".join(paragraph.split())))
    return "\n\n".join(parts)


def _escaped(text: str) -> str:
    """Plain text as Markdown: option names and runs of special characters as they are."""
    text = re.sub(r"([\\*_<\[\]])", r"\\\1", text)
    return re.sub(r"(?<!\w)(--[a-z][a-z0-9-]*)", r"`\1`", text)


TABLES = {
    "commands": commands,
    "outcomes": outcomes,
    "audits": audits,
    "histories": histories,
    "statuses": statuses,
    "notes": notes,
    "folder_errors": folder_errors,
    "argument_errors": argument_errors,
    "problems": problems,
    "units": units,
    "campaigns": campaigns,
    "modules": modules,
}
