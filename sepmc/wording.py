"""Options as those name them who read a message: on the command line, or in Python."""

from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

_commands = 0  # of the command line that are under way


@contextmanager
def on_command_line() -> Iterator[None]:
    """Messages are read at the command line meanwhile."""
    global _commands  # noqa: PLW0603
    _commands += 1
    try:
        yield
    finally:
        _commands -= 1


def option(name: str, value: object = "") -> str:
    """An option, and its value if one is given: ``--keep-columns`` or ``keep_columns``."""
    text = str(value)
    if _commands:
        return f"--{name.replace('_', '-')}" + (f" {text}" if text else "")
    return f"{name}={text}" if text else name


def switch(name: str) -> str:
    """An option that is on: ``--resume`` or ``resume=True``."""
    return option(name) if _commands else f"{name}=True"


def setting(path: str, value: object) -> str:
    """A value that is put in place: ``--set run.cases=100`` or ``{"run.cases": 100}``."""
    return option("set", f"{path}={value}") if _commands else f'settings {{"{path}": {value}}}'


def another_place() -> str:
    """What to do where a folder holds something else."""
    return f"use {switch('overwrite')} or another {option('out')}"


def flying_again(folder: Path, file: str | None = None) -> str:
    """What flies what is missing in a run folder, by its own campaign or by another file."""
    if _commands:
        return f"sepmc campaign {file or folder} --out {folder} --resume"
    return f'sepmc.load("{file or folder}").run(out="{folder}", resume=True)'
