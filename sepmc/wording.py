"""Options in messages, written as on the command line (``--resume``) or as in Python
(``resume=True``), as the user called sepmc; and names of columns in words."""

from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

_commands = 0  # nested commands that are running
_never_overwriting = 0  # nested calls that are running and cannot overwrite


@contextmanager
def on_command_line() -> Iterator[None]:
    """Context in which the functions of this module write options as on the command line; outside
    of it they write them as in Python. It holds for all threads, and may be nested."""
    global _commands  # noqa: PLW0603
    _commands += 1
    try:
        yield
    finally:
        _commands -= 1


@contextmanager
def never_overwriting() -> Iterator[None]:
    """Context of a command or function without the option ``overwrite``: in it `another_place` does
    not advise that."""
    global _never_overwriting  # noqa: PLW0603
    _never_overwriting += 1
    try:
        yield
    finally:
        _never_overwriting -= 1


def option(name: str, value: object = "") -> str:
    """Return an option as text for a message, with its value if given: ``--keep-columns error`` on
    the command line, else ``keep_columns=error``; ``--keep-columns`` or ``keep_columns`` without a
    value."""
    text = str(value)
    if _commands:
        return f"--{name.replace('_', '-')}" + (f" {text}" if text else "")
    return f"{name}={text}" if text else name


def switch(name: str) -> str:
    """Return a yes-or-no option, switched on, as text for a message: ``--resume`` or
    ``resume=True``."""
    return option(name) if _commands else f"{name}=True"


def setting(path: str, value: object) -> str:
    """Return, as text for a message, how to set a key of a campaign, given by its ``path`` in the
    file: ``--set run.cases=100`` or ``settings {"run.cases": 100}``. The text of ``value`` is
    inserted as it is, without quotes."""
    return option("set", f"{path}={value}") if _commands else f'settings {{"{path}": {value}}}'


def another_place() -> str:
    """Return the advice, for messages, to overwrite a folder with other content or choose another;
    only the latter in `never_overwriting`."""
    if _never_overwriting:
        return f"use another {option('out')}"
    return f"use {switch('overwrite')} or another {option('out')}"


def exists(path: Path, resume: str = "", other: str | None = None) -> str:
    """Return the error message for an output file or folder that exists already.

    Parameters
    ----------
    path : Path
        The output that exists.
    resume : str
        Advice on resuming, placed before the advice to overwrite; empty for none.
    other : str, optional
        Text that names the argument for the path, which the user may change; by default the option
        ``out``.
    """
    ways = f"{resume}, {switch('overwrite')}" if resume else switch("overwrite")
    return f"{path}: exists; add {ways} to replace it, or choose another {other or option('out')}"


def flying_again(folder: Path, file: str | None = None) -> str:
    """Return, as text for a message, the command (in Python: the call) that runs the missing cases
    of the run in ``folder``: with the campaign stored there, or with that in ``file``."""
    if _commands:
        return f"sepmc campaign {file or folder} --out {folder} --resume"
    return f'sepmc.load("{file or folder}").run(out="{folder}", resume=True)'


def count_cases(count: int, separator: str = "") -> str:
    """Return a number of cases in words: ``1 case``, ``12 cases``. ``separator`` is "," or "_" to
    separate thousands."""
    return f"{count:{separator}} case{'' if count == 1 else 's'}"


def to_words(name: str, unit: str = "") -> str:
    """Return the name of a column in words, without the suffix for its unit:
    ``separation_speed_m_s`` with the unit ``m/s`` becomes "separation speed"."""
    suffix = "_" + unit.replace("/", "_").replace(" ", "_").replace("²", "2").replace("^", "")
    return (name.removesuffix(suffix) if unit else name).replace("_", " ")
