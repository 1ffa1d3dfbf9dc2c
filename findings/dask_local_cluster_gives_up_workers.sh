#!/usr/bin/env bash
# distributed 2026.8.0: a `LocalCluster` whose worker process is lost while the timer of
# `distributed.deploy.lost-worker-timeout` (15 s as it comes) runs out closes that worker's nanny for
# good, although the nanny is about to start the worker again. The cluster then has a worker less
# for ever, without an error. A timer starts with each loss and looks only whether the worker is there
# when it runs out, so a second loss shortly before the end of the first timer does it as well.
# Seen: worker asked to restart once; timeout of 1 ms: 0 workers after 20 s; of 60 s: 1 worker.
# With no worker left, work that was submitted stays pending.
# Remedy: set the key far beyond the length of the work before `LocalCluster` is made (its value is
# read at each loss), wait for futures with a timeout, and look at the workers left.
set -euo pipefail
work=$(mktemp -d)
trap 'rm -rf "$work"' EXIT
python3 -m venv "$work/env"
"$work/env/bin/pip" install --quiet distributed==2026.8.0 dask==2026.8.0
cat >"$work/run.py" <<'PY'
import os
import signal
import sys
import time

import dask
from distributed import Client, LocalCluster


def workers_after_a_loss(timeout: str) -> int:
    dask.config.set({"distributed.deploy.lost-worker-timeout": timeout})
    with (
        LocalCluster(n_workers=1, threads_per_worker=1, dashboard_address=None) as cluster,
        Client(cluster) as client,
    ):
        (process,) = client.run(os.getpid).values()
        os.kill(process, signal.SIGTERM)
        time.sleep(20)
        return len(client.scheduler_info()["workers"])


if __name__ == "__main__":
    left = {timeout: workers_after_a_loss(timeout) for timeout in ("1ms", "60s")}
    print("workers after a loss, by timeout:", left)
    sys.exit(left != {"1ms": 0, "60s": 1})
PY
"$work/env/bin/python" "$work/run.py"
