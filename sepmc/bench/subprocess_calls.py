"""Functions of this package called in a Python process of their own: with another cache folder,
without the JIT, or from a fresh start."""

import importlib
import json
import os
import subprocess
import sys
from typing import Any

_PROGRAM = "from sepmc.bench.subprocess_calls import main; main()"


def environment(changes: dict[str, str] | None = None) -> dict[str, str]:
    """Environment of a process that finds the packages that this one finds."""
    return {
        **os.environ,
        "PYTHONPATH": os.pathsep.join(path for path in sys.path if path),
        **(changes or {}),
    }


def call(function: str, arguments: list[Any], changes: dict[str, str] | None = None) -> Any:
    """What ``module:function`` of this package returns for some arguments, all of it as JSON.

    Parameters
    ----------
    changes : dict, optional
        Of the environment.

    Raises
    ------
    RuntimeError
        With the last line of the process's complaint.
    """
    told = json.dumps([function, arguments])
    done = run([sys.executable, "-c", _PROGRAM], changes, told)
    return json.loads(done.splitlines()[-1])


def run(command: list[str], changes: dict[str, str] | None = None, given: str = "") -> str:
    """What a command prints. Raises RuntimeError if it fails, with the last line of its
    complaint."""
    done = subprocess.run(
        command, input=given, env=environment(changes), capture_output=True, text=True, check=False
    )
    if done.returncode:
        lines = done.stderr.strip().splitlines() or [f"exit code {done.returncode}"]
        raise RuntimeError(f"a process of the bench failed: {lines[-1]}")
    return done.stdout


def main() -> None:
    """Read a call from standard input and print what it returns."""
    function, arguments = json.loads(sys.stdin.read())
    module, name = function.split(":")
    print(json.dumps(getattr(importlib.import_module(f"sepmc.bench.{module}"), name)(*arguments)))
