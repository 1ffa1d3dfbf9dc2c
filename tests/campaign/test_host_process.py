"""In a host's process: objects that are copied, and processes, threads and locks that are not
sepmc's own."""

import copy
import os
import pickle
import subprocess
import sys
import threading

import numpy as np
import pandas as pd
import pytest
from support.host_processes import measure

import sepmc
from sepmc.engine import cache_files

QUICK = {
    "solver.step_s": 0.1,
    "run.history_step_s": 0.0,
    "dispersion": {"body.upper.mass_kg": {"uniform": 20.0}},
}
WAYS = {"pickle": lambda x: pickle.loads(pickle.dumps(x)), "deepcopy": copy.deepcopy}


@pytest.fixture(scope="module")
def campaign():
    return sepmc.load("table2.toml", QUICK)


# copies


@pytest.mark.parametrize("name", ["table2", "spring-pushers", "srb"])
@pytest.mark.parametrize("way", WAYS)
def test_copies_of_campaigns_and_cases(name, way):
    """Scene, laws, settings and cases are those of the first, and its fields have their bounds."""
    first = sepmc.load(name, {"run.seed": 7})
    first.columns  # noqa: B018  (what is kept of a campaign is copied with it)
    for again in (WAYS[way](first), WAYS[way](WAYS[way](first))):
        assert (again.digest, again.settings) == (first.digest, {"run.seed": "7"})
        assert again.scene == first.scene
        np.testing.assert_array_equal(again.sample(0, 9), first.sample(0, 9))
        assert again.case(4).scene == WAYS[way](first.case(4)).scene == first.case(4).scene
        for one, other in zip(again.file.dispersions, first.file.dispersions, strict=True):
            assert one.parameter.field == other.parameter.field
        body = next(iter(first.scene.body))
        with pytest.raises(sepmc.SceneError, match="must be > 0"):
            again.with_settings({f"body.{body}.mass_kg": -1.0})


@pytest.mark.parametrize("way", WAYS)
@pytest.mark.parametrize("kind", ["memory", "folder", "statistics"])
def test_copies_of_results(campaign, way, kind, tmp_path):
    folder = tmp_path / "run" if kind == "folder" else None
    result = campaign.run(cases="3:9", out=folder, stats_only=kind == "statistics")
    again = WAYS[way](result)
    pd.testing.assert_frame_equal(again.statistics(), result.statistics(), check_exact=True)
    pd.testing.assert_frame_equal(again.requirements(), result.requirements())
    assert (again.status_counts, again.case(8)) == (result.status_counts, result.case(8))
    if kind != "statistics":
        pd.testing.assert_frame_equal(again.to_pandas(), result.to_pandas(), check_exact=True)
        pd.testing.assert_frame_equal(
            again.campaign.run(cases="3:9").to_pandas(),
            campaign.run(cases="3:9").to_pandas(),
            check_exact=True,
        )
    assert again.integration.method_names == result.integration.method_names


def test_copies_of_histories(campaign):
    history = campaign.simulate(3, step_s=0.1)
    for way in WAYS.values():
        again = way(history)
        pd.testing.assert_frame_equal(again, history, check_exact=True)
        assert again.attrs == history.attrs


def test_a_copied_kernel_holds_no_address(campaign):
    """It would be that of another process."""
    flight = campaign.run(cases=2).integration
    assert flight.kernel.address
    for way in WAYS.values():
        assert (way(flight).kernel.address, len(way(flight).kernel.table)) == (0, 0)


# processes made by fork

needs_fork = pytest.mark.skipif(not hasattr(os, "fork"), reason="no fork on this system")
HOST = """
import os, signal, sys, threading, warnings
import sepmc
from sepmc.engine import compile_workers, kernel_cache
from sepmc.code_cache import cache_lock

signal.alarm(120)  # whatever waits for ever ends here
warnings.simplefilter("always")
campaign = sepmc.load("table2.toml", {"solver.step_s": 0.1, "run.history_step_s": 0.0})

def forked(child):
    \"\"\"What a child says, and how it ended.\"\"\"
    sys.stdout.flush()
    number = os.fork()
    if number == 0:
        code = 1
        try:
            signal.alarm(60)
            child()
            code = 0
        finally:
            sys.stdout.flush()
            sys.stderr.flush()
            os._exit(code)
    return os.waitpid(number, 0)[1]

"""


def in_a_host(program, **environment):
    """Output of a program in a process of its own."""
    done = subprocess.run(
        [sys.executable, "-W", "default", "-c", HOST + program],
        capture_output=True,
        text=True,
        timeout=180,
        env={**os.environ, **environment},
        check=False,
    )
    assert done.returncode == 0, done.stderr
    return done.stdout, done.stderr


@needs_fork
def test_a_forked_child_flies_and_says_so_once():
    """The same bits on one thread, and one note, in the result and as a warning."""
    out, _ = in_a_host(
        """
rows = campaign.run(cases=40, seed=7).to_pandas()
def child():
    with warnings.catch_warnings(record=True) as caught:
        warnings.simplefilter("always")
        first, second = campaign.run(cases=40, seed=7), campaign.run(cases=4, seed=7)
    print(first.to_pandas().equals(rows), len(first.notes), len(second.notes), len(caught))
    print(first.notes[0])
assert forked(child) == 0
print(campaign.run(cases=40, seed=7).notes)
""",
        NUMBA_NUM_THREADS="2",
    )
    assert out.splitlines()[0] == "True 1 0 1"
    assert "this process was made by fork" in out.splitlines()[1]
    assert "one thread" in out.splitlines()[1]
    assert out.splitlines()[2] == "[]"


@needs_fork
def test_no_note_where_one_thread_was_asked_for():
    out, _ = in_a_host(
        """
campaign.run(cases=2)
assert forked(lambda: print(campaign.run(cases=2, threads=1).notes)) == 0
""",
        NUMBA_NUM_THREADS="2",
    )
    assert out == "[]\n"


@pytest.mark.slow
@needs_fork
def test_a_forked_child_leaves_the_compilers_of_its_parent(tmp_path):
    """It neither ends them as it ends, nor writes into their pipes, and starts its own."""
    out, _ = in_a_host(
        """
SHORT = '''from sepmc.translator.units import compile_unit, workspace
@compile_unit("")
def entry(address):
    w = workspace(address)
    w[0] = {}.0
'''
def compiled(number):
    return compile_workers.compile_all(kernel_cache.write_modules([SHORT.format(number)]))
assert compiled(1)
(mine,) = compile_workers.running()
def child():
    assert compile_workers.running() == []
    assert compiled(2)
    assert compile_workers.running()[0].process.pid != mine.process.pid
    compile_workers.end_all()
assert forked(child) == 0
assert mine.process.poll() is None
assert compiled(3)
assert compile_workers.running() == [mine]
print("as it was")
""",
        SEPMC_CACHE_DIR=str(tmp_path),
    )
    assert out == "as it was\n"


@needs_fork
def test_a_child_forked_while_others_compile_does_not_wait_for_them(tmp_path):
    """The locks that another thread holds at that moment are not its own."""
    out, _ = in_a_host(
        """
inside, go = threading.Event(), threading.Event()
def hold():
    with compile_workers._compiling, cache_lock("units"):
        inside.set()
        go.wait()
other = threading.Thread(target=hold)
other.start()
inside.wait()
go_on = os.pipe()
number = os.fork()
if number == 0:
    signal.alarm(60)
    os.read(go_on[0], 1)  # the other thread has let go
    assert not compile_workers._compiling.locked()
    with cache_lock("units"):
        os.write(1, b"child\\n")
    os._exit(0)
go.set()
other.join()
with cache_lock("units"):  # the child is there still, and holds nothing
    os.write(1, b"parent\\n")
os.write(go_on[1], b"1")
assert os.waitpid(number, 0)[1] == 0
""",
        SEPMC_CACHE_DIR=str(tmp_path),
    )
    assert out == "parent\nchild\n"


@needs_fork
def test_a_run_folder_is_its_writers_alone(tmp_path):
    """A child that is forked meanwhile may not write into it, and does not keep it locked."""
    out, _ = in_a_host(
        f"""
from pathlib import Path
from sepmc.campaign.store import folders
folder = Path({str(tmp_path / "run")!r})
stay = os.pipe()
with folders.opened(folder):
    (folder / "manifest.json").write_text("{{}}")
    number = os.fork()
    if number == 0:
        signal.alarm(60)
        try:
            with folders.opened(folder, overwrite=True):
                os.write(1, b"both write\\n")
        except folders.StoreError as error:
            os.write(1, str(error).encode()[-60:] + b"\\n")
        os.read(stay[0], 1)
        os._exit(0)
    import time
    time.sleep(1.0)
with folders.opened(folder, overwrite=True):
    os.write(1, b"its own again\\n")
os.write(stay[1], b"1")
assert os.waitpid(number, 0)[1] == 0
""",
    )
    first, second = out.splitlines()
    assert "writes into it; wait for it, or choose another out" in first
    assert second == "its own again"


# threads of the host


def test_files_of_the_cache_that_threads_write_at_once(tmp_path):
    """Each has a draft of its own, so none takes another's away."""
    faults = []

    def write():
        try:
            for k in range(200):
                cache_files.put(tmp_path / "one.sealed", b"x" * (k + 1))
        except OSError as error:
            faults.append(error)

    many = [threading.Thread(target=write) for _ in range(8)]
    for each in many:
        each.start()
    for each in many:
        each.join(timeout=60.0)
    assert faults == []
    assert [path.name for path in tmp_path.iterdir()] == ["one.sealed"]


def test_texts_are_written_by_one_thread_at_a_time(campaign, monkeypatch):
    """Formulas that another thread imports are exchanged meanwhile."""
    from sepmc.campaign.execution.step_selection import kernel_text
    from sepmc.engine import host_process, kernel_texts
    from sepmc.kernel.emit import module

    locked = []
    write = module.emit
    monkeypatch.setattr(
        module,
        "emit",
        lambda *given: locked.append(host_process.loading._is_owned()) or write(*given),
    )
    monkeypatch.setattr(cache_files, "read_sealed", lambda path: None)  # as if none was kept
    kernel_texts._texts.clear()
    kernel_text(campaign)
    assert locked == [True]


# hosts, a few answers of each; `python tests/measure/library.py` asks for a hundred


@pytest.mark.slow
@needs_fork
@pytest.mark.parametrize(
    ("way", "layer"),
    [
        ("fork", "default"),
        ("daemon", "default"),
        ("prefork", "default"),
        ("threads", "workqueue"),
        ("mixed", "default"),
        ("restored", "default"),
    ],
)
def test_a_host_gets_the_same_rows(way, layer):
    assert measure(way, 2, layer) == {"right": 2}
