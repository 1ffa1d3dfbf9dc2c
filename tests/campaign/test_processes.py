"""Processes that work is shared among, interrupted."""

import os
import signal
import subprocess
import sys
import time

import pytest

SCRIPT = """
import faulthandler
import signal
import time
from sepmc.processes import processes

if __name__ == "__main__":
    signal.signal(signal.SIGINT, signal.default_int_handler)  # a job in the background ignores it
    faulthandler.dump_traceback_later(25.0, exit=True)
    try:
        with processes(2) as pool:
            pool.submit(time.sleep, 60.0)
            print("ready", flush=True)
            while True:  # an interruption just before a long sleep would wait for its end
                time.sleep(0.05)
    except KeyboardInterrupt:
        print("interrupted")
"""


@pytest.mark.slow
@pytest.mark.skipif(os.name != "posix", reason="signals of process groups")
def test_an_interruption_while_they_start(tmp_path):
    """Ctrl-C reaches the whole group: who asked says so once, and those that have just been started
    say nothing, whenever it comes."""
    path = tmp_path / "script.py"
    path.write_text(SCRIPT, encoding="utf-8")
    for k in range(12):
        process = subprocess.Popen(
            [sys.executable, str(path)],
            stdout=subprocess.PIPE,
            stderr=subprocess.PIPE,
            text=True,
            start_new_session=True,
        )
        assert process.stdout.readline() == "ready\n"
        time.sleep(0.03 * k)
        os.killpg(process.pid, signal.SIGINT)
        message, failed = process.communicate(timeout=30.0)
        assert (message, failed) == ("interrupted\n", "")
