"""Runs in processes and threads of a host program: fork, spawn, daemons, threads, joblib, Jupyter
and pytest-xdist. ``measure`` counts the answers of one way.

The host runs a campaign first, so that the threads of compiled code exist; then it has the same
campaign run again in the way asked for. An answer is right if its rows are those of the host to the
last bit, or if the run is refused in one sentence. Waits are limited: no answer by then counts as
hung. A way whose package is not installed is reported and left out.
"""

import contextlib
import hashlib
import importlib.util
import json
import multiprocessing
import os
import random
import subprocess
import sys
import tempfile
import threading
from collections import Counter
from collections.abc import Callable, Iterator
from concurrent.futures import ThreadPoolExecutor
from multiprocessing.connection import Connection
from pathlib import Path

HERE = Path(__file__).resolve()
SETTINGS = {"solver.step_s": 0.1, "run.history_step_s": 0.0}
CASES = 40
WAIT_S = 120.0  # limit for one answer
THREADS = 8
MISSING = "not installed"


def _hear(_: str) -> None:
    """Ignore the notes of a run, which would be warnings otherwise."""


def answer(which: int = 0) -> str:
    """Digest of the rows of a run, or the sentence that refuses it."""
    import sepmc

    try:
        rows = sepmc.load("table2.toml", SETTINGS).run(cases=CASES, seed=7, announce=_hear).table
    except ValueError as error:
        return f"sentence: {error}"
    digest = hashlib.sha256()
    for name, values in rows.items():
        digest.update(name.encode() + b"".join(str(values.tolist()).encode().splitlines()))
    return digest.hexdigest()


def _by_processes(method: str, times: int) -> Iterator[str]:
    """Answers of a pool whose processes answer once each."""
    with multiprocessing.get_context(method).Pool(2, maxtasksperchild=1) as pool:
        results = [pool.apply_async(answer, (k,)) for k in range(times)]
        for each in results:
            try:
                yield each.get(timeout=WAIT_S)
            except multiprocessing.TimeoutError:
                yield "hung"
                return


def fork(times: int) -> Iterator[str]:
    """Children by fork of `multiprocessing`."""
    return _by_processes("fork", times)


def spawn(times: int) -> Iterator[str]:
    """Children by spawn."""
    return _by_processes("spawn", times)


def forkserver(times: int) -> Iterator[str]:
    """Children by forkserver."""
    return _by_processes("forkserver", times)


def _send(end: Connection) -> None:
    end.send(answer())


def daemon(times: int) -> Iterator[str]:
    """Daemonic processes, which may have no children, by fork and spawn in turn."""
    for k in range(times):
        context = multiprocessing.get_context(("fork", "spawn")[k % 2])
        mine, its = context.Pipe()
        process = context.Process(target=_send, args=(its,), daemon=True)
        process.start()
        its.close()
        yield _received(mine)
        process.join(WAIT_S)


def _received(end: Connection) -> str:
    if not end.poll(WAIT_S):
        return "hung"
    try:
        return str(end.recv())
    except EOFError:
        return "died"


def threads(times: int) -> Iterator[str]:
    """Rounds of eight Python threads at once; a round is right if all are."""
    with ThreadPoolExecutor(THREADS) as pool:
        for _ in range(times):
            answers = {
                each.result(WAIT_S) for each in [pool.submit(answer) for _ in range(THREADS)]
            }
            yield answers.pop() if len(answers) == 1 else "they differ"


def mixed(times: int) -> Iterator[str]:
    """Threads, some of which run single cases interpreted at the same time."""
    import sepmc

    case = sepmc.load("table2.toml", SETTINGS)
    expected = case.simulate(3, step_s=0.1, announce=_hear)

    def single() -> str:
        same = case.simulate(3, step_s=0.1, announce=_hear).equals(expected)
        return answer() if same else "single flights differ"

    with ThreadPoolExecutor(THREADS) as pool:
        for _ in range(times):
            futures = [pool.submit(work) for work in (answer, single) * 2]
            answers = {each.result(WAIT_S) for each in futures}
            yield answers.pop() if len(answers) == 1 else "they differ"


def prefork(times: int) -> Iterator[str]:
    """Workers forked once, as of Celery or gunicorn, that answer many times."""
    context = multiprocessing.get_context("fork")
    pipes = []
    for _ in range(2):
        mine, its = context.Pipe()
        context.Process(target=_serve, args=(its,), daemon=True).start()
        its.close()
        pipes.append(mine)
    for k in range(times):
        pipes[k % 2].send(k)
        yield _received(pipes[k % 2])


def _serve(end: Connection) -> None:
    while True:
        try:
            end.recv()
        except EOFError:
            return
        end.send(answer())


def joblib(times: int) -> Iterator[str]:
    """`joblib`: its processes, forked processes and threads in turn."""
    if importlib.util.find_spec("joblib") is None:
        yield MISSING
        return
    from joblib import Parallel, delayed

    left = times
    for k, backend in enumerate(("loky", "multiprocessing", "threading")):
        share = left // (3 - k)
        left -= share
        jobs = (delayed(answer)() for _ in range(share))
        yield from Parallel(n_jobs=2, backend=backend, timeout=WAIT_S)(jobs)


def jupyter(times: int) -> Iterator[str]:
    """Cells of a Jupyter kernel, restarted after twenty."""
    if importlib.util.find_spec("jupyter_client") is None:
        yield MISSING
        return
    from jupyter_client.manager import start_new_kernel

    for first in range(0, times, 20):
        manager, client = start_new_kernel(startup_timeout=WAIT_S)
        try:
            for _ in range(first, min(first + 20, times)):
                yield _of_cell(client)
        finally:
            client.stop_channels()
            manager.shutdown_kernel(now=True)


def _of_cell(client) -> str:
    said: list[str] = []

    def hear(message) -> None:
        said.append(message["content"].get("text", "") if message["msg_type"] == "stream" else "")

    code = f"import sys; sys.path.insert(0, {str(HERE.parents[1])!r})\n"
    code += "from support import host_processes as m\nprint('ANSWER', m.answer())"
    try:
        client.execute_interactive(code, timeout=WAIT_S, output_hook=hear)
    except TimeoutError:
        return "hung"
    lines = "".join(said).partition("ANSWER ")[2].split("\n")
    return lines[0] or "died"


def xdist(times: int) -> Iterator[str]:
    """Tests in processes of pytest-xdist."""
    if importlib.util.find_spec("xdist") is None:
        yield MISSING
        return
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "test_host.py"
        path.write_text(
            "import sys, pytest\n"
            f"sys.path.insert(0, {str(HERE.parents[1])!r})\n"
            "from support import host_processes as m\n"
            f"@pytest.mark.parametrize('k', range({times}))\n"
            "def test_answer(k, tmp_path_factory):\n"
            f"    with open({folder!r} + f'/answer-{{k}}', 'w') as file:\n"
            "        file.write(m.answer())\n",
            encoding="utf-8",
        )
        words = ["-m", "pytest", "-q", "-n2", "-p", "no:cacheprovider", str(path)]
        subprocess.run(
            [sys.executable, *words],
            timeout=WAIT_S * 4,
            check=False,
            cwd=folder,
            stdout=subprocess.DEVNULL,
        )
        for k in range(times):
            file = Path(folder) / f"answer-{k}"
            yield file.read_text(encoding="utf-8") if file.exists() else "died"


def restored(times: int) -> Iterator[str]:
    """Runs that must leave the host's number of threads unchanged."""
    import numba

    import sepmc

    campaign, most = sepmc.load("table2.toml", SETTINGS), numba.config.NUMBA_NUM_THREADS
    draw = random.Random(7)
    for _ in range(times):
        mine, its = draw.randint(1, most), draw.choice([None, *range(1, most + 1)])
        numba.set_num_threads(mine)
        campaign.run(cases=9, threads=its, announce=_hear)
        yield answer() if numba.get_num_threads() == mine else "threads were changed"


WAYS: dict[str, Callable[[int], Iterator[str]]] = {
    each.__name__: each
    for each in (
        fork, spawn, forkserver, daemon, prefork, threads, mixed, joblib, jupyter, xdist, restored
    )
}  # fmt: skip
LAYERS = {"threads": ("default", "workqueue"), "mixed": ("default", "workqueue")}


def tell(way: str, times: int) -> None:
    """Print one answer per line in JSON, the host's own first."""
    print(json.dumps(answer()), flush=True)
    for each in WAYS[way](times):
        print(json.dumps(each), flush=True)


def measure(way: str, times: int, layer: str = "default") -> Counter[str]:
    """Count right answers, sentences and other answers."""
    environment = {**os.environ, "NUMBA_THREADING_LAYER": layer}
    # at least two threads on any machine: with one nothing is shared
    environment.setdefault("NUMBA_NUM_THREADS", str(max(2, os.cpu_count() or 1)))
    words = [sys.executable, str(HERE), way, str(times)]
    host = subprocess.Popen(
        words, stdout=subprocess.PIPE, stderr=subprocess.DEVNULL, text=True, env=environment,
        start_new_session=True,
    )  # fmt: skip
    end = threading.Timer(WAIT_S + times * 10.0, _kill, (host.pid,))
    end.start()
    try:
        assert host.stdout is not None
        with host.stdout:
            lines = [json.loads(line) for line in host.stdout]
        host.wait()
    finally:
        end.cancel()
        _kill(host.pid)  # remaining processes
    right, *answers = lines or ["", "no host"]
    counts = Counter(
        "right" if each == right else each.partition(":")[0] if len(each) != 64 else "other rows"
        for each in answers
    )
    if MISSING not in counts and counts.total() < times:
        counts["no answer"] = times - counts.total()
    return counts


def _kill(group: int) -> None:
    with contextlib.suppress(ProcessLookupError, PermissionError):
        os.killpg(group, 9)


if __name__ == "__main__":
    tell(sys.argv[1], int(sys.argv[2]))
