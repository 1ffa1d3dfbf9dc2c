"""Functions of the benchmark called in another Python process: with another cache folder, without
the JIT, or from a fresh start."""

import importlib
import json
import os
import subprocess
import sys
from typing import Any

_PROGRAM = "from sepmc.bench.subprocess_calls import main; main()"


def environment(changes: dict[str, str] | None = None) -> dict[str, str]:
    """Return the environment variables of a process that imports from the same path as this one,
    with ``changes``."""
    return {
        **os.environ,
        "PYTHONPATH": os.pathsep.join(path for path in sys.path if path),
        **(changes or {}),
    }


def call(function: str, arguments: list[Any], changes: dict[str, str] | None = None) -> Any:
    """Call ``module:function`` of this package in another process; arguments and result are JSON.

    Parameters
    ----------
    function : str
        Such as ``scaling:run_campaign``.
    arguments : list
    changes : dict, optional
        Environment variables to set.

    Returns
    -------
    any
        Result of the function.

    Raises
    ------
    RuntimeError
        With the last line of the process's error output.
    """
    message = json.dumps([function, arguments])
    output = run([sys.executable, "-c", _PROGRAM], changes, message)
    return json.loads(output.splitlines()[-1])


def run(command: list[str], changes: dict[str, str] | None = None, text: str = "") -> str:
    """Run a command.

    Parameters
    ----------
    command : list of str
    changes : dict, optional
        Environment variables to set.
    text : str
        Standard input.

    Returns
    -------
    str
        Standard output.

    Raises
    ------
    RuntimeError
        If it fails, with the last line of its error output.
    """
    result = subprocess.run(
        command, input=text, env=environment(changes), capture_output=True, text=True, check=False
    )
    if result.returncode:
        lines = result.stderr.strip().splitlines() or [f"exit code {result.returncode}"]
        raise RuntimeError(f"a process of the bench failed: {lines[-1]}")
    return result.stdout


def main() -> None:
    """Read a call from standard input and print its result."""
    function, arguments = json.loads(sys.stdin.read())
    module, name = function.split(":")
    print(json.dumps(getattr(importlib.import_module(f"sepmc.bench.{module}"), name)(*arguments)))
