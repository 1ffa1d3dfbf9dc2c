"""Work shared out among processes of this machine, or of many, by Dask: the only place that knows
it."""

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

_AHEAD = 3  # ranges for each worker that are handed out ahead of the oldest one that is not done
_PATIENCE_S = 60.0  # for a scheduler that is gone to come back
_SILENT = "60 s"  # so long a worker of this machine may say nothing, and is then given up
# Of workers of this machine. Memory that is let go stays theirs: what Dask sets gives it back after
# every range, and to get it again takes a sixth of the time.
_SPAWNED = "distributed.nanny.pre-spawn-environ"
_ENVIRONMENT = {"MALLOC_TRIM_THRESHOLD_": 2**28, "MALLOC_MMAP_THRESHOLD_": 2**25}
# So long after a worker was lost, Dask (2026.8) closes for good what starts it again, if it is down
# at that moment: later than any run ends.
_LOST = "distributed.deploy.lost-worker-timeout"
_LOST_AFTER = "30 days"
_LOOK_S = 10.0  # from one look at which workers are left to the next, while none is done
_TIMES = 3  # that a range whose worker was lost is handed out again


class ClusterError(RuntimeError):
    """Workers that cannot be had, or that are lost; its argument is the sentence to show."""


@dataclass
class DaskExecutor:
    """Workers of a Dask scheduler: those of this machine, or those at an ``address``. Each flies
    with so many ``threads``, or as many as it was started with."""

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
        """As `sepmc.campaign.execution.work_ranges.Executor.map`. A range whose worker was lost is
        handed out again; where the scheduler itself is gone, so is all that was not done, once it
        is back."""
        source = iter(ranges)
        left: dict[int, tuple[int, int]] = {}
        number = oldest = 0
        lost: dict[int, int] = {}
        futures: dict[Any, int] = {}
        ended = False
        try:
            while left or not ended:
                try:
                    while not ended and number - oldest < _AHEAD * self.workers + 1:
                        try:
                            left[number] = next(source)
                        except StopIteration:
                            ended = True
                            break
                        number += 1
                    for each in sorted(left.keys() - set(futures.values())):
                        futures[self._hand_out(job, function, *left[each])] = each
                    for future in self._done(futures):
                        each = futures.pop(future)
                        found = self._result(future, left[each], lost, each)
                        if found is not None:
                            del left[each]
                            oldest = min(left, default=number)
                            yield found
                except (_Gone, CancelledError, CommClosedError) as error:
                    futures = {}
                    self._reconnect(error)
        finally:  # of who asks for no more
            with suppress(Exception):
                self.client.cancel(list(futures))

    def _hand_out(self, job: Any, function: Any, first: int, end: int) -> Any:
        return self.client.submit(_work, function, job, first, end, self.threads, pure=False)

    def _done(self, futures: dict[Any, int]) -> list[Any]:
        """Those that are done, one at least. Raises ClusterError if there are no workers for a
        minute."""
        if not futures:
            return []
        seen = time.monotonic()  # when there were workers
        while True:
            with suppress(TimeoutError):
                return list(
                    wait(list(futures), timeout=_LOOK_S, return_when="FIRST_COMPLETED").done
                )
            if self.client.nthreads():
                seen = time.monotonic()
            elif time.monotonic() - seen > _PATIENCE_S:
                raise ClusterError(
                    f"{self.address or 'this machine'}: all workers are gone for {_PATIENCE_S:g} "
                    f"s; what is flown is kept, and {switch('resume')} goes on from there"
                )

    def _result(self, future: Any, cases: tuple[int, int], lost: dict[int, int], each: int) -> Any:
        """What a worker gave back; None if it was lost, and the range is to be handed out again."""
        if future.status == "finished":
            return future.result()
        if future.status in ("lost", "cancelled"):
            raise _Gone(future.status)
        error = future.exception()
        if not isinstance(error, KilledWorker):
            raise error
        lost[each] = lost.get(each, 0) + 1
        if lost[each] > _TIMES:
            raise ClusterError(
                f"cases {cases[0]} to {cases[1] - 1} ended every worker that flew them (out of "
                f"memory?); what is flown is kept, and {switch('resume')} goes on from there"
            )
        return None

    def _reconnect(self, error: BaseException) -> None:
        """Wait for a scheduler at the same address."""
        if self.address is None:
            raise ClusterError(f"the workers of this machine are gone: {error}") from error
        with suppress(Exception):
            self.client.close(timeout=1)
        until = time.monotonic() + _PATIENCE_S
        while time.monotonic() < until:
            try:
                self.client = Client(self.address, timeout=5)
                self.client.wait_for_workers(1, timeout=max(1.0, until - time.monotonic()))
            except (OSError, TimeoutError):
                time.sleep(0.5)
            else:
                return
        raise ClusterError(
            f"{self.address}: the scheduler, or all workers, are gone for {_PATIENCE_S:g} s; "
            f"what is flown is kept, and {switch('resume')} goes on from there"
        ) from error


class _Gone(Exception):
    """A scheduler that knows nothing of what it was given."""


def _work(function: Any, job: Any, first: int, end: int, threads: int | None) -> Any:
    """What a worker is asked for."""
    return function(job, first, end, threads or get_worker().state.nthreads)


@contextmanager
def crew(
    workers: int | None = None, address: str | None = None, threads: int | None = None
) -> Iterator[DaskExecutor]:
    """Workers: so many processes on this machine, or those of the scheduler at an ``address``.

    Parameters
    ----------
    threads : int, optional
        That each flies with; by default this machine's cores shared out, or as many as a worker of
        the scheduler was started with.

    Raises
    ------
    ClusterError
        If there is no such scheduler, or no worker.
    """
    if address is None:
        assert workers is not None
        own = threads or max(1, (os.cpu_count() or 1) // workers)
        with (
            dask.config.set(
                {
                    "distributed.scheduler.worker-ttl": _SILENT,
                    _LOST: _LOST_AFTER,
                    _SPAWNED: dask.config.get(_SPAWNED) | _ENVIRONMENT,
                }
            ),
            LocalCluster(
                n_workers=workers,
                threads_per_worker=2,  # one flies while the other writes
                memory_limit=0,
                dashboard_address=":0",  # any port, so that two of these do not meet
                silence_logs="CRITICAL",
            ) as cluster,
            Client(cluster) as client,
        ):
            yield DaskExecutor(client, None, workers, own)
        return
    try:
        client = Client(address, timeout=10)
        client.wait_for_workers(1, timeout=30)
    except (OSError, TimeoutError, ValueError) as error:
        raise ClusterError(f"{address}: no Dask scheduler with a worker there: {error}") from None
    found = DaskExecutor(client, address, max(1, len(client.scheduler_info()["workers"])), threads)
    try:
        yield found
    finally:
        with suppress(Exception):
            found.client.close(timeout=5)
