"""A process that judges scenes: a job a line in, a verdict a line out, as JSON. With the JIT off it flies the written text as it stands.

`python -m sepmc.trust.gate.worker`, started by `sepmc.trust.gate.workers`.
"""

import json
import os
import sys
import time
from typing import Any

from sepmc.trust.gate import general, plain
from sepmc.trust.gate.compare import judge
from sepmc.trust.gate.doors import through
from sepmc.trust.gate.scenes import scene
from sepmc.trust.gate.shrink import shrink


def work(job: dict[str, Any]) -> dict[str, Any]:
    """The verdict on one job: the scene of a ``seed``, or of a ``tree`` with a ``name``."""
    begun = time.perf_counter()
    if job.get("shrink"):
        return {"tree": shrink(job["tree"], job.get("cases", 3), job["shrink"], say=lambda text: print(text, file=sys.stderr))}
    tree = scene(job["seed"]) if "seed" in job else job["tree"]
    name = job.get("name") or f"seed {job['seed']}"
    found = judge(tree, name, job.get("cases", 3))
    if job.get("doors") and found.rows:
        through(tree, name, found)
    return {**found.to_dict(), "seconds": time.perf_counter() - begun, "seed": job.get("seed")}


def main() -> None:
    answers = os.fdopen(os.dup(1), "w")
    os.dup2(2, 1)  # what anything prints is not an answer
    if os.environ.get("NUMBA_DISABLE_JIT") == "1":
        plain.install()
        general.install()
    for line in sys.stdin:
        print(json.dumps(work(json.loads(line))), file=answers, flush=True)


if __name__ == "__main__":
    main()
