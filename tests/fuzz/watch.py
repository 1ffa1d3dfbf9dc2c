"""Detection of findings, and the processes that search for them."""

import contextlib
import faulthandler
import multiprocessing
import os
import random
import re
import resource
import signal
import time
import traceback
import warnings
from collections import Counter
from concurrent.futures import ProcessPoolExecutor

from sepmc.campaign.store.untrusted import StoreError
from sepmc.scene.messages import InputError, SceneWarning

LONGEST_S = 5.0
MEMORY = 4 << 30  # memory limit of a process, bytes
_OURS = ("/sepmc/", "/tests/")


class Hang(BaseException):
    """Raised if something takes too long."""


class Wrong(AssertionError):
    """Raised if an accepted or written value is wrong."""


@contextlib.contextmanager
def in_time(seconds=LONGEST_S):
    """Context that raises Hang after a time."""

    def stop(*_):
        raise Hang

    before = signal.signal(signal.SIGALRM, stop)
    signal.setitimer(signal.ITIMER_REAL, seconds)
    try:
        yield
    finally:
        signal.setitimer(signal.ITIMER_REAL, 0.0)
        signal.signal(signal.SIGALRM, before)


def where(error):
    """Kind of an error and the last lines of the package in its traceback."""
    frames = traceback.extract_tb(error.__traceback__)
    ours = [f for f in frames if any(part in f.filename for part in _OURS)] or frames
    lines = " < ".join(f"{os.path.basename(f.filename)}:{f.lineno}" for f in ours[:-4:-1])
    said = re.sub(r"0x[0-9a-f]+|\d{4,}", "N", str(error))[:120]
    return f"{type(error).__name__} {said} at {lines}"


def shown(what):
    """An input as printable text."""
    try:
        return repr(what)
    except (ValueError, RecursionError) as error:
        return f"what has no text: {error}"


def turns(count, until, tried):
    """Numbers of inputs, until no time is left."""
    for number in range(count):
        if time.monotonic() > until:
            return
        tried.counts["inputs"] += 1
        yield number


class Tried:
    """Inputs counted by result, and findings by kind, each with its first inputs."""

    def __init__(self):
        self.counts, self.findings, self.longest = Counter(), {}, (0.0, "")

    def look(self, what, act, seconds=LONGEST_S, works=False):
        """Try one input; returns its result, or None. With ``works``, as for a simulation in many
        steps, it may take longer."""
        begun = time.perf_counter()
        try:
            # what runs in C is not interrupted: the process ends, with the lines it was at
            faulthandler.dump_traceback_later(3.0 * seconds, exit=True)
            with in_time(seconds):
                given = act()
            self.counts["accepted"] += 1
            return given
        except (InputError, StoreError) as error:
            self.counts["refused"] += 1
            said = str(error)
            if not said.strip() or "\x1b" in said or "\0" in said:
                self.found(f"a sentence that cannot be read: {said[:80]!r}", what)
        except (Exception, Hang) as error:
            if works and isinstance(error, Hang):
                self.counts["slow"] += 1
            else:
                self.found(where(error), what)
        finally:
            faulthandler.cancel_dump_traceback_later()
            taken = time.perf_counter() - begun
            self.longest = max(self.longest, (round(taken, 2), shown(what)[:80]))
        return None

    def found(self, kind, what):
        """Add a finding."""
        self.counts["findings"] += 1
        seen = self.findings.setdefault(kind, [0, []])
        seen[0] += 1
        if len(seen[1]) < 2:
            seen[1].append(shown(what))

    def add(self, other):
        """Add the results of another process."""
        self.counts += other.counts
        self.longest = max(self.longest, other.longest)
        for kind, (count, inputs) in other.findings.items():
            seen = self.findings.setdefault(kind, [0, []])
            seen[0] += count
            seen[1] = (seen[1] + inputs)[:2]


def limited():
    """Limit the memory of this process, and turn all warnings of other packages into errors."""
    resource.setrlimit(resource.RLIMIT_AS, (MEMORY, MEMORY))
    warnings.simplefilter("error")
    warnings.simplefilter("ignore", SceneWarning)


def _work(job):
    part, seed, share, count, seconds = job
    limited()
    tried, until = Tried(), time.monotonic() + seconds
    part(random.Random(f"{part.__module__}.{part.__name__} {seed} {share}"), count, until, tried)
    return tried


def spread(part, count, seconds, seed, processes):
    """Try inputs of a part in several processes, within a time."""
    jobs = [(part, seed, k, -(-count // processes), seconds) for k in range(processes)]
    tried = Tried()
    if processes == 1:
        return _alone(jobs[0])
    context = multiprocessing.get_context("spawn")
    with ProcessPoolExecutor(processes, context) as pool:
        for one in pool.map(_work, jobs):
            tried.add(one)
    return tried


def _alone(job):
    part, seed, share, count, seconds = job
    tried, until = Tried(), time.monotonic() + seconds
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        warnings.simplefilter("ignore", SceneWarning)
        rng = random.Random(f"{part.__module__}.{part.__name__} {seed} {share}")
        part(rng, count, until, tried)
    return tried
