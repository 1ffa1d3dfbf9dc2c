"""Budgets of CPU time, enforced by every run of the tests.

A test fails if it takes `FACTOR` times the CPU time, that of child processes included, that a test
of its folder should take; the fast suite fails as a whole beyond its own budget. CPU time hardly
depends on what else a machine does: on a crowded one it doubles at most. Compile processes outlive
the test that needs a kernel first: their time counts only in the sum of a run.
"""

import os
from collections import Counter
from collections.abc import Generator

import pytest

from sepmc.engine import compile_workers

# CPU seconds that a test without the mark `slow` should take at most, by its folder
BUDGETS_S = dict.fromkeys(("analysis", "engine", "physics", "routines", "scene"), 1.0)
OTHER_BUDGET_S = 2.0  # in the other folders
SLOW_BUDGET_S = 30.0  # a test with the mark `slow`
FACTOR = 5.0  # of a budget at which a test fails
# CPU seconds of all tests without the mark `slow`: three minutes on two cores
FAST_SUITE_S = 360.0
FAST_SUITE = "not slow"  # its ``-m``

_CPU_S = "cpu_s"  # name of the CPU time among what a test reports
_TIMES = pytest.StashKey["_Times"]()
_ended_compilers_s = [0.0]  # CPU time of the compile processes that have been ended


class _Times:
    """CPU times of a run, s."""

    def __init__(self) -> None:
        self.processes = 0.0  # pytest-xdist workers
        self.folders: Counter[str] = Counter()  # tests without the mark `slow`
        self.beyond: list[str] = []  # of these, those beyond their budget


def _cpu_s(compilers: bool = False) -> float:
    """CPU time of this process and of its children that have ended; ``compilers``: also of those
    that compiled kernels."""
    return sum(os.times()[:4]) - (0.0 if compilers else _ended_compilers_s[0])


def _end_compiler(self: compile_workers.Compiler, end=compile_workers.Compiler.end) -> None:
    """End a compile process and note its CPU time."""
    before = _cpu_s()
    end(self)
    _ended_compilers_s[0] += _cpu_s() - before


compile_workers.Compiler.end = _end_compiler


def budget_s(folder: str, slow: bool) -> float:
    """CPU time that a test should take at most, s."""
    return SLOW_BUDGET_S if slow else BUDGETS_S.get(folder, OTHER_BUDGET_S)


def _within_budget(item: pytest.Item) -> Generator[None, object, object]:
    """Run a step of a test and note its CPU time; fails if that is far beyond the budget."""
    budget = budget_s(item.path.parent.name, bool(item.get_closest_marker("slow")))
    before = _cpu_s()
    try:
        result = yield
    finally:
        taken = _cpu_s() - before
        item.user_properties.append((_CPU_S, taken))
    if taken > FACTOR * budget:
        message = f"took {taken:.1f} s of CPU time, {FACTOR:g} times its budget of {budget:g} s"
        pytest.fail(f"{message}: tests/support/cpu_budgets.py", pytrace=False)
    return result


@pytest.hookimpl(wrapper=True, tryfirst=True)
def pytest_runtest_setup(item):
    """The budget holds for the fixtures of a test."""
    return (yield from _within_budget(item))


@pytest.hookimpl(wrapper=True, tryfirst=True)
def pytest_runtest_call(item):
    """The budget holds for the test."""
    return (yield from _within_budget(item))


def pytest_configure(config):
    """Start with no times."""
    config.stash[_TIMES] = _Times()
    config.pluginmanager.register(_Sum(config.stash[_TIMES]))


class _Sum:
    """Sums up what tests and pytest-xdist workers report."""

    def __init__(self, times: _Times):
        self.times = times

    def pytest_runtest_logreport(self, report):
        """Add the CPU time of a test without the mark `slow`, fixtures included."""
        if report.when != "teardown" or "slow" in report.keywords:
            return
        taken = sum(value for name, value in report.user_properties if name == _CPU_S)
        folder = os.path.basename(os.path.dirname(report.location[0]))
        self.times.folders[folder] += taken
        if taken > budget_s(folder, slow=False):
            self.times.beyond.append(f"{taken:5.1f} s {report.nodeid}")

    @pytest.hookimpl(optionalhook=True)
    def pytest_testnodedown(self, node):
        """Add the CPU time of a pytest-xdist worker that has ended."""
        self.times.processes += getattr(node, "workeroutput", {}).get(_CPU_S, 0.0)


def pytest_sessionfinish(session):
    """Send the CPU time of a pytest-xdist worker; fail a fast suite beyond its budget."""
    compile_workers.end_all()
    times = session.config.stash[_TIMES]
    # workers have counted themselves, and are among the ended children
    times.processes += sum(os.times()[:2]) if times.processes else _cpu_s(compilers=True)
    if hasattr(session.config, "workeroutput"):
        session.config.workeroutput[_CPU_S] = times.processes
    elif _is_too_long(session.config):
        session.exitstatus = pytest.ExitCode.TESTS_FAILED


def _is_too_long(config: pytest.Config) -> bool:
    """Return True for a fast suite that took more than its budget."""
    return config.option.markexpr == FAST_SUITE and config.stash[_TIMES].processes > FAST_SUITE_S


def pytest_terminal_summary(terminalreporter, config):
    """Report the CPU time of the run, and what should have the mark `slow`."""
    times, write = config.stash[_TIMES], terminalreporter.write_line
    folders = ", ".join(f"{folder} {s:.0f}" for folder, s in times.folders.most_common())
    write(f"CPU time {times.processes:.0f} s; of tests without the mark slow: {folders}")
    for line in times.beyond:
        write(f"beyond its budget: {line}")
    if _is_too_long(config):
        write(f"FAILED: tests without the mark slow may take {FAST_SUITE_S:g} s", red=True)
