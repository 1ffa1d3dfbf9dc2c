"""A test that takes more CPU time than its budget fails, whatever else the machine does."""

import os
import re
import resource
import sys

import pytest
from support import cpu_budgets

BURNS = """
import subprocess, sys, time
import pytest

def burn(seconds=0.2):
    end = time.process_time() + seconds
    while time.process_time() < end:
        pass

@pytest.fixture
def burned():
    burn()

def test_itself():
    burn()

def test_fixture(burned):
    pass

def test_child():
    code = "import time\\nwhile time.process_time() < 0.2: pass"
    subprocess.run([sys.executable, "-c", code], check=True)

def test_waiting():
    time.sleep(0.2)

@pytest.mark.slow
def test_slow():
    burn()
"""


@pytest.fixture
def outcomes(pytester, monkeypatch):
    """Run these tests as those of a folder; returns outcomes by name, and the output."""
    monkeypatch.setattr(cpu_budgets.compile_workers, "end_all", lambda: None)  # those of this run

    def run(folder, *arguments):
        path = pytester.mkdir(folder) / "test_burns.py"
        path.write_text(BURNS, encoding="utf-8")
        plugins = ("-p", "support.cpu_budgets", "-p", "no:cacheprovider")
        result = pytester.inline_run(*plugins, *arguments, folder)
        reports = [one for one in result.getreports("pytest_runtest_logreport") if one.failed]
        return {one.nodeid.partition("::")[2]: str(one.longrepr) for one in reports}, result.ret

    pytester.makeini("[pytest]\nmarkers = slow: slow")
    return run


def test_a_test_beyond_its_budget_fails(outcomes, monkeypatch, capsys):
    """Its own time, that of its fixtures and of its child processes count; waiting does not."""
    monkeypatch.setitem(cpu_budgets.BUDGETS_S, "physics", 0.02)
    failed, code = outcomes("physics")
    assert set(failed) == {"test_itself", "test_fixture", "test_child"}
    assert all("of CPU time, 5 times its budget of 0.02 s" in reason for reason in failed.values())
    assert code == pytest.ExitCode.TESTS_FAILED
    summary = capsys.readouterr().out
    assert summary.count("beyond its budget") == 3
    assert "test_waiting" not in summary


def test_budgets_are_those_of_the_folder_and_of_slow_tests(outcomes, monkeypatch):
    monkeypatch.setitem(cpu_budgets.BUDGETS_S, "physics", 0.02)
    monkeypatch.setattr(cpu_budgets, "SLOW_BUDGET_S", 0.02)
    failed, _ = outcomes("another")
    assert set(failed) == {"test_slow"}


def test_a_fast_suite_beyond_its_budget_fails(outcomes, monkeypatch, capsys):
    """Whatever each of its tests may take. Runs of other tests have no budget as a whole."""
    monkeypatch.setattr(cpu_budgets, "FAST_SUITE_S", 0.1)
    failed, code = outcomes("physics", "-m", "not slow", "-k", "waiting")
    assert not failed
    assert code == pytest.ExitCode.TESTS_FAILED
    assert "tests without the mark slow may take 0.1 s" in capsys.readouterr().out
    assert outcomes("routines", "-k", "waiting") == ({}, pytest.ExitCode.OK)


@pytest.mark.slow
def test_time_of_workers_counts_once(outcomes, pytester, monkeypatch):
    """The CPU time reported is that of the processes of a run."""
    longer = BURNS.replace("seconds=0.2", "seconds=1.5")  # than the processes take to start
    pytester.mkdir("physics").joinpath("test_burns.py").write_text(longer, encoding="utf-8")
    monkeypatch.setenv("PYTHONPATH", os.pathsep.join(filter(None, sys.path)))
    before = sum(resource.getrusage(resource.RUSAGE_CHILDREN)[:2])
    plugins = ("-p", "support.cpu_budgets", "-p", "no:cacheprovider")
    result = pytester.runpytest_subprocess(*plugins, "-n1", "-m", "not slow", "physics")
    used = sum(resource.getrusage(resource.RUSAGE_CHILDREN)[:2]) - before
    reported = re.search(r"^CPU time (\d+) s", str(result.stdout), re.MULTILINE)
    assert 0.5 * used < float(reported[1]) < used + 0.6, result.stdout
