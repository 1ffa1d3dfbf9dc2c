"""Reduction of cases by a Latin hypercube and a Sobol sequence for the same error of means:
``python tests/measure/sampling.py [CASES [CAMPAIGN]]``.

The error of a mean is the root mean square difference, over repeats with other seeds, from the mean
of many Sobol cases. With random cases it falls with the root of their number, so the square of a
ratio of errors is a ratio of cases.
"""

import sys

import numpy as np

import sepmc

REPEATS, BEST = 24, 2**17


def means(campaign, cases, seed):
    """Means of the outcomes named in the campaign's reference, or of all."""
    table = campaign.run(cases=cases, seed=seed).statistics()
    return table["mean"][list(campaign.reference or table.index)].to_numpy()


def main():
    """Measure and print."""
    cases = int(sys.argv[1]) if len(sys.argv) > 1 else 1024
    name = sys.argv[2] if len(sys.argv) > 2 else "table2"
    campaigns = {s: sepmc.load(name, {"run.sampler": s}) for s in ("random", "lhs", "sobol")}
    best = means(campaigns["sobol"], BEST, 10_000)
    errors = {
        sampler: np.sqrt(
            np.mean([(means(c, cases, seed) - best) ** 2 for seed in range(REPEATS)], axis=0)
        )
        for sampler, c in campaigns.items()
    }
    fewer = {sampler: (errors["random"] / error) ** 2 for sampler, error in errors.items()}
    print(f"{name}, {cases} cases, {REPEATS} repeats: error of means; fewer cases than random")
    for i, outcome in enumerate(campaigns["random"].reference or best):
        told = ", ".join(f"{s} {e[i]:.2e} ({fewer[s][i]:.3g} x)" for s, e in errors.items())
        print(f"  {outcome:24s} {told}")


if __name__ == "__main__":
    main()
