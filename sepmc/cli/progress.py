"""Bars and lines that show the progress of a command."""

import sys
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager

import click

_EVERY_S = 5.0  # between lines of progress where there is no terminal


@contextmanager
def progress_bar(total: int, quiet: bool) -> Iterator[Callable[[int, int, int], None] | None]:
    """Context manager: yield a function to call with numbers of cases (done, total, failures). It
    shows a bar on a terminal, else it prints a line every five seconds. Yield None if ``quiet``.

    The first call, with 0 cases done, starts the clock of the rate. ``total`` is the number of
    cases that the bar shows until then.
    """
    if quiet:
        yield None
        return
    if sys.stderr.isatty():
        from tqdm import tqdm

        with tqdm(total=total, unit=" cases", dynamic_ncols=True) as bar:

            def on_terminal(done: int, count: int, failures: int) -> None:
                if done == 0:
                    bar.reset(total=count)
                    return
                bar.total = count
                bar.set_postfix(failures=failures, refresh=False)
                bar.update(done - bar.n)

            yield on_terminal
        return
    started = last = 0.0

    def in_lines(done: int, count: int, failures: int) -> None:
        nonlocal started, last
        now = time.perf_counter()
        if done == 0:  # called once before the first chunk: compiling does not count
            started = last = now
            return
        if now - last < _EVERY_S and done < count:
            return
        last = now
        rate = done / max(now - started, 1e-9)
        click.echo(
            f"{done}/{count} cases, {rate:.0f} cases/s, {(count - done) / rate:.0f} s left, "
            f"{failures} failures",
            err=True,
        )

    yield in_lines


@contextmanager
def check_bar(total: int, quiet: bool) -> Iterator[Callable[[str], None] | None]:
    """Context manager: yield a function to call with the name of each finished check, which
    advances a bar of ``total`` checks. Yield None if ``quiet`` or without a terminal."""
    if quiet or not sys.stderr.isatty():
        yield None
        return
    from tqdm import tqdm

    with tqdm(total=total, leave=False) as bar:

        def progress(name: str) -> None:
            bar.set_description(name)
            bar.update()

        yield progress
