"""Option names in messages, as on the command line or as in Python; names of columns in words."""

from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

_commands = 0  # nested commands that are running


@contextmanager
def on_command_line() -> Iterator[None]:
    """Context in which the functions of this module give names as on the command line, not as in
    Python."""
    global _commands  # noqa: PLW0603
    _commands += 1
    try:
        yield
    finally:
        _commands -= 1


def option(name: str, value: object = "") -> str:
    """Return an option as text for a message, with its value if given: ``--keep-columns error`` on
    the command line, else ``keep_columns=error``."""
    text = str(value)
    if _commands:
        return f"--{name.replace('_', '-')}" + (f" {text}" if text else "")
    return f"{name}={text}" if text else name


def switch(name: str) -> str:
    """Return an option that is on as text for a message: ``--resume`` or ``resume=True``."""
    return option(name) if _commands else f"{name}=True"


def setting(path: str, value: object) -> str:
    """Return a setting of a campaign, by its path in the file, as text for a message: ``--set
    run.cases=100`` or ``settings {"run.cases": 100}``."""
    return option("set", f"{path}={value}") if _commands else f'settings {{"{path}": {value}}}'


def another_place() -> str:
    """Return the advice, for messages, to overwrite a folder with other content or choose
    another."""
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
    """Return the command (in Python: the call) that runs the missing cases of the run in a folder:
    with the campaign stored there, or with that of another ``file``."""
    if _commands:
        return f"sepmc campaign {file or folder} --out {folder} --resume"
    return f'sepmc.load("{file or folder}").run(out="{folder}", resume=True)'


def to_words(name: str, unit: str = "") -> str:
    """Return a column's name in words, without its unit."""
    suffix = "_" + unit.replace("/", "_").replace(" ", "_").replace("²", "2").replace("^", "")
    return (name.removesuffix(suffix) if unit else name).replace("_", " ")
