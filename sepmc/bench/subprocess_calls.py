"""Calls of functions of the benchmark in another Python process: with another cache folder, with
kernels as plain Python, or in a fresh start."""

import importlib
import json
import os
import subprocess
import sys
from typing import Any

_PROGRAM = "from sepmc.bench.subprocess_calls import main; main()"


def environment(changes: dict[str, str] | None = None) -> dict[str, str]:
    """Return the environment variables of this process, with a PYTHONPATH by which a new process
    imports from the same folders as this one, and with ``changes``, which overrule both."""
    return {
        **os.environ,
        "PYTHONPATH": os.pathsep.join(path for path in sys.path if path),
        **(changes or {}),
    }


def call(function: str, arguments: list[Any], changes: dict[str, str] | None = None) -> Any:
    """Call a function of this package in another process, and return its result; arguments and
    result must be JSON.

    Parameters
    ----------
    function : str
        ``MODULE:FUNCTION``, such as ``scaling:run_campaign``.
    arguments : list
        Positional arguments.
    changes : dict, optional
        Environment variables to set.

    Returns
    -------
    any
        Result of the function.

    Raises
    ------
    RuntimeError
        If the process fails, with the last line of its error output.
    """
    message = json.dumps([function, arguments])
    output = run([sys.executable, "-c", _PROGRAM], changes, message)
    return json.loads(output.splitlines()[-1])


def run(command: list[str], changes: dict[str, str] | None = None, text: str = "") -> str:
    """Run a command, wait for its end, and return its standard output.

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
        If its exit code is not 0, with the last line of its error output.
    """
    result = subprocess.run(
        command, input=text, env=environment(changes), capture_output=True, text=True, check=False
    )
    if result.returncode:
        lines = result.stderr.strip().splitlines() or [f"exit code {result.returncode}"]
        raise RuntimeError(
            f"a process that the benchmark started failed; its last line of errors is: {lines[-1]}"
        )
    return result.stdout


def main() -> None:
    """Read the call of a function and its arguments as JSON from standard input, make it, and print
    the result as JSON: the program of the process that `call` starts."""
    function, arguments = json.loads(sys.stdin.read())
    module, name = function.split(":")
    print(json.dumps(getattr(importlib.import_module(f"sepmc.bench.{module}"), name)(*arguments)))
