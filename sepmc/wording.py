"""Option names in messages, as on the command line or as in Python."""

from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

_commands = 0  # nested commands that are running


@contextmanager
def on_command_line() -> Iterator[None]:
    """Write option names as on the command line within this context."""
    global _commands  # noqa: PLW0603
    _commands += 1
    try:
        yield
    finally:
        _commands -= 1


def option(name: str, value: object = "") -> str:
    """Return an option, with its value if given: ``--keep-columns`` or ``keep_columns``."""
    text = str(value)
    if _commands:
        return f"--{name.replace('_', '-')}" + (f" {text}" if text else "")
    return f"{name}={text}" if text else name


def switch(name: str) -> str:
    """Return an option that is on: ``--resume`` or ``resume=True``."""
    return option(name) if _commands else f"{name}=True"


def setting(path: str, value: object) -> str:
    """Return a setting: ``--set run.cases=100`` or ``settings {"run.cases": 100}``."""
    return option("set", f"{path}={value}") if _commands else f'settings {{"{path}": {value}}}'


def another_place() -> str:
    """Return the advice for a folder with other content."""
    return f"use {switch('overwrite')} or another {option('out')}"


def exists(path: Path, resume: str = "", other: str | None = None) -> str:
    """Return the message for an output that exists.

    Parameters
    ----------
    path : Path
    resume : str
        Advice on resuming, placed before the advice to overwrite.
    other : str, optional
        Argument that gives the path; default the option ``out``.
    """
    ways = f"{resume}, {switch('overwrite')}" if resume else switch("overwrite")
    return f"{path}: exists; add {ways} to replace it, or choose another {other or option('out')}"


def flying_again(folder: Path, file: str | None = None) -> str:
    """Return the command that runs the missing cases of a folder, by its own campaign or by another
    file."""
    if _commands:
        return f"sepmc campaign {file or folder} --out {folder} --resume"
    return f'sepmc.load("{file or folder}").run(out="{folder}", resume=True)'
