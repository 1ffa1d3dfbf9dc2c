"""Dask executor: runs ranges of cases on worker processes of this machine or of a cluster. No other
module imports Dask."""

import os
import time
from collections.abc import Callable, Generator, Iterable, Iterator
from contextlib import contextmanager, suppress
from dataclasses import dataclass
from typing import Any

import dask
from distributed import CancelledError, Client, KilledWorker, LocalCluster, get_worker, wait
from distributed.comm import CommClosedError

from sepmc.wording import switch

_RANGES_AHEAD = 3  # ranges per worker submitted ahead of the oldest one that is not done
_TIMEOUT_S = 60.0  # to wait for a lost scheduler
_WORKER_TTL = "60 s"  # a worker of this machine without a heartbeat for this time is lost
# of workers of this machine: they keep freed memory. Dask's setting returns it after every range,
# and to get it again takes a sixth of the time.
_SPAWN_ENVIRONMENT = "distributed.nanny.pre-spawn-environ"
_ENVIRONMENT = {"MALLOC_TRIM_THRESHOLD_": 2**28, "MALLOC_MMAP_THRESHOLD_": 2**25}
# Dask (2026.8) closes the nanny of a lost worker for good after this time: longer than any run
_LOST_WORKER_TIMEOUT = "distributed.deploy.lost-worker-timeout"
_LOST_WORKER_LIMIT = "30 days"
_POLL_S = 10.0  # interval of checks for remaining workers


class ClusterError(RuntimeError):
    """Workers cannot be reached or were lost; the argument is the message to show."""


@dataclass
class DaskExecutor:
    """Executor that runs ranges of cases on the workers of a Dask scheduler.

    Attributes
    ----------
    client : distributed.Client
        Connection to the scheduler.
    address : str or None
        Address of the scheduler; None if `dask_executor` started the workers on this machine.
    workers : int
        Number of worker processes.
    threads : int or None
        Threads that each worker uses; None: as many as the worker was started with.
    """

    client: Any
    address: str | None
    workers: int
    threads: int | None

    def map(
        self,
        job: Any,
        function: Callable[[Any, int, int, int], Any],
        ranges: Iterable[tuple[int, int]],
    ) -> Generator[Any]:
        """Call ``function(job, first, end, threads)`` in the workers for every range of case
        numbers, ``first`` to ``end - 1``; yield the results as they complete, in any order.

        Dask runs the range of a lost worker on another one
        (``distributed.scheduler.allowed-failures``). If the scheduler at an address is lost, all
        ranges that are not done are submitted again once it is back. Raises ClusterError if it or
        all workers are gone for a minute, at once if the scheduler that started the workers on this
        machine is lost, or if a range ends every worker that runs it; an error of ``function`` is
        raised here, too.
        """
        source = iter(ranges)
        remaining: dict[int, tuple[int, int]] = {}
        next_index = oldest = 0
        futures: dict[Any, int] = {}
        exhausted = False
        try:
            while remaining or not exhausted:
                try:
                    while not exhausted and next_index - oldest < _RANGES_AHEAD * self.workers + 1:
                        try:
                            remaining[next_index] = next(source)
                        except StopIteration:
                            exhausted = True
                            break
                        next_index += 1
                    for index in sorted(remaining.keys() - set(futures.values())):
                        futures[self._submit(job, function, *remaining[index])] = index
                    for future in self._completed(futures):
                        index = futures.pop(future)
                        result = self._result(future, remaining[index])
                        del remaining[index]
                        oldest = min(remaining, default=next_index)
                        yield result
                except (_SchedulerLostError, CancelledError, CommClosedError) as error:
                    futures = {}
                    self._reconnect(error)
        finally:  # the caller stopped
            with suppress(Exception):
                self.client.cancel(list(futures))

    def _submit(self, job: Any, function: Any, first: int, end: int) -> Any:
        return self.client.submit(_run, function, job, first, end, self.threads, pure=False)

    def _completed(self, futures: dict[Any, int]) -> list[Any]:
        """Wait until at least one of the ``futures`` (each with its index of a range) has
        completed; return the completed ones. Without futures it returns an empty list at once.
        Raises ClusterError if there are no workers for a minute."""
        if not futures:
            return []
        last_seen = time.monotonic()  # time with workers
        while True:
            with suppress(TimeoutError):
                return list(
                    wait(list(futures), timeout=_POLL_S, return_when="FIRST_COMPLETED").done
                )
            if self.client.nthreads():
                last_seen = time.monotonic()
            elif time.monotonic() - last_seen > _TIMEOUT_S:
                raise ClusterError(
                    f"{self.address or 'this machine'}: all workers have been gone for "
                    f"{_TIMEOUT_S:g} s; finished cases are stored, and {switch('resume')} "
                    "continues from there"
                )

    def _result(self, future: Any, cases: tuple[int, int]) -> Any:
        """Return the result of a completed future, which ran the case numbers ``cases[0]`` to
        ``cases[1] - 1``.

        Raises the error that its function raised, ClusterError if the range ended every worker, or
        _SchedulerLostError if the scheduler no longer knows the future.
        """
        if future.status == "finished":
            return future.result()
        if future.status in ("lost", "cancelled"):
            raise _SchedulerLostError(future.status)
        error = future.exception()
        if isinstance(error, KilledWorker):
            raise ClusterError(
                f"cases {cases[0]} to {cases[1] - 1} ended every worker that ran them (out of "
                f"memory?); finished cases are stored, and {switch('resume')} continues from there"
            )
        raise error

    def _reconnect(self, error: BaseException) -> None:
        """Connect again to the scheduler at the same address, trying for at most a minute.

        ``error`` is what interrupted the run. Raises ClusterError if no scheduler with a worker
        comes back, or if the workers were those of this machine.
        """
        if self.address is None:
            raise ClusterError(
                f"the workers of this machine are gone: {error}; finished cases are stored, and "
                "the run can be resumed"
            ) from error
        with suppress(Exception):
            self.client.close(timeout=1)
        deadline = time.monotonic() + _TIMEOUT_S
        while time.monotonic() < deadline:
            try:
                self.client = Client(self.address, timeout=5)
                self.client.wait_for_workers(1, timeout=max(1.0, deadline - time.monotonic()))
            except (OSError, TimeoutError):
                time.sleep(0.5)
            else:
                return
        raise ClusterError(
            f"{self.address}: the scheduler, or all workers, have been gone for {_TIMEOUT_S:g} s; "
            f"finished cases are stored, and {switch('resume')} continues from there"
        ) from error


class _SchedulerLostError(Exception):
    """The scheduler was lost, and with it all ranges that were submitted and not done."""


def _run(function: Any, job: Any, first: int, end: int, threads: int | None) -> Any:
    """Call ``function(job, first, end, threads)`` in a worker and return the result. If ``threads``
    is None, the number of threads that the worker was started with is passed."""
    return function(job, first, end, threads or get_worker().state.nthreads)


@contextmanager
def dask_executor(
    workers: int | None = None, address: str | None = None, threads: int | None = None
) -> Iterator[DaskExecutor]:
    """Context of a Dask executor, whose workers are started on this machine for the time of the
    context, or belong to a scheduler that runs already.

    Parameters
    ----------
    workers : int, optional
        Number of processes on this machine; required without ``address``, else ignored.
    address : str, optional
        Address of a Dask scheduler that runs already, such as ``tcp://HOST:8786``.
    threads : int, optional
        Threads of each worker. By default, on this machine its cores divided by ``workers`` (at
        least 1), else as many as each worker was started with.

    Yields
    ------
    DaskExecutor

    Raises
    ------
    ClusterError
        If there is no scheduler at the address, or it has no worker.
    """
    if address is None:
        assert workers is not None
        own_threads = threads or max(1, (os.cpu_count() or 1) // workers)
        with (
            dask.config.set(
                {
                    "distributed.scheduler.worker-ttl": _WORKER_TTL,
                    _LOST_WORKER_TIMEOUT: _LOST_WORKER_LIMIT,
                    _SPAWN_ENVIRONMENT: dask.config.get(_SPAWN_ENVIRONMENT) | _ENVIRONMENT,
                }
            ),
            LocalCluster(
                n_workers=workers,
                threads_per_worker=2,  # one runs while the other writes
                memory_limit=0,
                dashboard_address=":0",  # any free port
                silence_logs="CRITICAL",
            ) as cluster,
            Client(cluster) as client,
        ):
            yield DaskExecutor(client, None, workers, own_threads)
        return
    try:
        client = Client(address, timeout=10)
        client.wait_for_workers(1, timeout=30)
    except (OSError, TimeoutError, ValueError) as error:
        raise ClusterError(f"{address}: no Dask scheduler with a worker there: {error}") from None
    result = DaskExecutor(client, address, max(1, len(client.scheduler_info()["workers"])), threads)
    try:
        yield result
    finally:
        with suppress(Exception):
            result.client.close(timeout=5)
