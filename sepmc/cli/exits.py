"""Exit codes of commands, and the errors that end a command with a message and no traceback."""

import errno
import signal
import sys
import threading
from collections.abc import Iterator
from contextlib import contextmanager
from typing import TYPE_CHECKING, Any

import click

from sepmc import wording
from sepmc.paths import is_storage_error

if TYPE_CHECKING:
    from types import FrameType

DONE, FAILED, BAD_INPUT, INVALID, INTERRUPTED, TERMINATED = 0, 1, 2, 3, 130, 143
MEANINGS = (
    "Exit codes: 0 done; 1 no case completed, more failed than allowed, a requirement not shown "
    "(campaign --check), a case not ok or a row that differs (run, replay), a line failed (verify, "
    "stress) or damage (doctor); 2 bad input, or files that cannot be read or written; 3 the audit "
    "failed or the requested accuracy was not met; 130 interrupted; 143 terminated."
)

# errors that a command reports by their message; by name, as their modules are slow to import
_REPORTED = ("StoreError", "ClusterError", "StaleWorkerError")
# write errors without a file name: a full disk, and no folder for temporary files
_UNWRITABLE = (errno.ENOSPC, errno.EDQUOT, errno.EROFS, errno.ENOENT)


class Terminated(KeyboardInterrupt):
    """Raised at SIGTERM: ends a command as Ctrl-C does, but with exit code 143, not 130."""


class Program(click.Group):
    """Group of commands that end on the errors of `plain_errors` (bad input, unusable files), those
    of options included, with a message and no traceback; other errors pass."""

    def invoke(self, ctx: click.Context) -> Any:
        """Parse the options of a command and run it."""
        with wording.on_command_line(), plain_errors():
            return super().invoke(ctx)


def stopped(error: KeyboardInterrupt) -> tuple[str, int]:
    """Return "interrupted" or "terminated" for the error that stopped a command, and the exit
    code."""
    if isinstance(error, Terminated):
        return "terminated", TERMINATED
    return "interrupted", INTERRUPTED


@contextmanager
def _terminable() -> Iterator[None]:
    """Context manager: SIGTERM raises `Terminated`, unless a handler is installed already or this
    is not the main thread."""
    in_main = threading.current_thread() is threading.main_thread()
    if not in_main or signal.getsignal(signal.SIGTERM) is not signal.SIG_DFL:
        yield
        return

    def end(number: int, frame: "FrameType | None") -> None:
        raise Terminated

    signal.signal(signal.SIGTERM, end)
    try:
        yield
    finally:
        signal.signal(signal.SIGTERM, signal.SIG_DFL)


@contextmanager
def plain_errors() -> Iterator[None]:
    """Context manager: bad input, unusable files or folders, Ctrl-C and SIGTERM end the program
    with a message and an exit code; other errors pass."""
    from sepmc.scene.messages import InputError, SceneError

    try:
        with _terminable():
            yield
    except KeyboardInterrupt as error:
        word, code = stopped(error)
        click.echo(f"\n{word}", err=True)
        sys.exit(code)
    except InputError as error:
        for line in error.problems if isinstance(error, SceneError) else [error]:
            click.echo(f"error: {line}", err=True)
        sys.exit(BAD_INPUT)
    except OSError as error:
        if error.filename is None and error.errno not in _UNWRITABLE:
            raise
        path = "" if error.filename is None else f"{error.filename}: "
        click.echo(f"error: {path}{error.strerror}", err=True)
        sys.exit(BAD_INPUT)
    except Exception as error:
        names = [kind.__name__ for kind in type(error).__mro__]
        if not (set(names) & set(_REPORTED) or is_storage_error(error)):
            raise
        click.echo(f"error: {error}", err=True)
        sys.exit(BAD_INPUT)


def first_fault(*faults: tuple[Any, int, str]) -> int:
    """Print the message of the first of the ``faults``, tuples (has occurred, exit code, message),
    that has occurred, and return its exit code; 0 if none has."""
    for occurred, code, message in faults:
        if occurred:
            click.echo(f"error: {message}", err=True)
            return code
    return DONE
