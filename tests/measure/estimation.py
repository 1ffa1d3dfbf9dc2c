"""How often `sepmc estimate` is right, on synthetic flights of its own prior:
``PYTHONPATH=tests python tests/measure/estimation.py [REPEATS]``.

Counts true parameters inside the 90 % intervals, and inside the 90 % region of all parameters
together (highest posterior density of the scores); false alarms of the check of the model (1 % are
stated); and flights with a load that the model lacks, as many, that are named a model shortfall.
"""

import sys
import time
from pathlib import Path
from tempfile import TemporaryDirectory

import numpy as np
from scipy.special import ndtri
from support.flight_problem import DISPERSED, MISSING, campaign, fly

from sepmc.campaign.cases import stream
from sepmc.campaign.estimation import estimate

CASES = 300
DELAY = 0.001  # standard deviation, s, of the clock in the flights of a model that is right
EVERY = 20  # flights between two reports


def true_scores(one, case):
    """Normal scores of the inputs of a case."""
    paths = [d.parameter.path for d in one.file.dispersions]
    seed = one.scene.run.seed
    return np.array([ndtri(stream(seed, path, case, 1)[0]) for path in paths])


def main(repeats: int) -> None:
    """Print the counts."""
    start = time.process_time()
    inside, regions, alarms, named = np.zeros(len(DISPERSED) + 1), 0, 0, 0
    with TemporaryDirectory() as temporary:
        folder = Path(temporary)
        one, known = campaign(folder, DELAY), campaign(folder)
        for case in range(repeats):
            delay = DELAY * np.random.default_rng(10_000 + case).standard_normal()
            values = np.append(fly(folder, case, case, delay), delay)
            result = estimate(one, CASES, seed=case, announce=str)
            inside += (result.table["low"] <= values) & (values <= result.table["high"])
            alarms += result.check.is_short or result.check.noise.fails
            scores = np.append(true_scores(one, case), delay / DELAY)
            sample = result.sample
            density = sample.log_likelihood - 0.5 * (sample.scores**2).sum(axis=1)
            regions += result.density_at(scores) >= np.quantile(density, 0.1)
            fly(folder, case, case, load=[MISSING])
            named += estimate(known, CASES, seed=case, announce=str).check.is_short
            if (case + 1) % EVERY == 0 or case + 1 == repeats:
                report(case + 1, inside, regions, alarms, named)
    print(f"{(time.process_time() - start) / (2 * repeats):.2f} s of CPU time a flight")


def report(flights, inside, regions, alarms, named):
    """Print the counts so far."""
    each = ", ".join(f"{100.0 * count / flights:.1f}" for count in inside)
    print(f"{flights} flights: true value inside the 90 % interval, % by parameter: {each}")
    print(f"  together {100.0 * inside.mean() / flights:.2f} %; inside joint regions {regions}")
    print(f"  false alarms {alarms}; missing load named a shortfall {named}", flush=True)


if __name__ == "__main__":
    main(int(sys.argv[1]) if len(sys.argv) > 1 else 200)
