"""Quality of rare-event estimates: ``python tests/measure/rare.py [REPEATS]`` on problems of known
probability 1e-6, ``python tests/measure/rare.py plain [CASES]`` beside plain cases of shipped
campaigns.

Coverage: fraction of 95 % intervals that contain the probability; of 100 repeats, 90 to 99 are
within chance (central 97 %). Bias and scatter are relative to the probability.
"""

import resource
import sys
import time
import tomllib
import warnings
from pathlib import Path

sys.path.insert(0, str(Path(__file__).parents[1]))

import numpy as np
from scipy import optimize, stats
from small_scenes import PAIR

import sepmc
from sepmc.analysis import subset_simulation
from sepmc.analysis.proportions import binomial_interval as of_share
from sepmc.campaign.campaign import Campaign
from sepmc.campaign.cases import generator
from sepmc.scene.read import parse_campaign

P, FLIGHTS = 1e-6, 100_000
_TOLD = 50_000_000  # plain cases between two progress messages


def linear(d):
    """Half space in d dimensions, with equal weights."""
    bound = stats.norm.isf(P)
    return d, lambda u: bound - u.sum(axis=1) / np.sqrt(d)


def slab(d, ways):
    """Beyond a bound on either side along each of ``ways`` axes."""
    beyond = -np.expm1(np.log1p(-P) / ways)  # of one axis
    bound = stats.norm.isf(beyond / 2.0)
    return d, lambda u: bound - np.abs(u[:, :ways]).max(axis=1)


def sphere(d):
    """Outside of a sphere."""
    bound = stats.chi2.isf(P, d)
    return d, lambda u: bound - (u**2).sum(axis=1)


def exponentials(d):
    """Sum of exponential variables."""
    bound = stats.gamma.isf(P, d)
    return d, lambda u: bound + stats.norm.logsf(u).sum(axis=1)


def corner(d):
    """Sum of variables uniform in 0 to 1, near its upper end: d! P = (d - bound)^d."""
    left = np.exp((np.log(P) + np.log(np.arange(1, d + 1)).sum()) / d)
    assert left <= 1.0
    return d, lambda u: stats.norm.sf(u).sum(axis=1) - left


def rare_way(d):
    """Two failure regions of equal probability: one with a gentle margin, and one with a margin so
    steep that only cases beyond 3 sigma see it."""
    bound = stats.norm.isf(P / 2.0)

    def margin(u):
        late = np.where(u[:, 1] > 3.0, 3.0 * (bound - u[:, 1]), np.inf)
        return np.minimum(bound - u[:, 0], late)

    return d, margin


def steps(d):
    """Half space whose margin has few values, as a counted outcome."""
    bound = stats.norm.isf(P)
    return d, lambda u: np.ceil(2.0 * (bound - u.sum(axis=1) / np.sqrt(d))) - 0.5


PROBLEMS = {
    "plane, d = 2": linear(2),
    "plane, d = 10": linear(10),
    "plane, d = 30": linear(30),
    "two sides, d = 5": slab(5, 1),
    "ten sides, d = 5": slab(5, 5),
    "sphere, d = 10": sphere(10),
    "exponentials, d = 8": exponentials(8),
    "uniform corner, d = 6": corner(6),
    "few values, d = 10": steps(10),
    "a way seen late, d = 5": rare_way(5),
}
# requirements with probabilities of about 1e-6 to 1e-5
PLAIN = {
    "table2": {
        "slow": {"metric": "separation_speed_m_s", "at_least": 0.378},
        "slower": {"metric": "separation_speed_m_s", "at_least": 0.371},
        "pitch": {"metric": "upper_pitch_deg", "at_least": -1.93, "at_most": 2.03},
        "roll": {"metric": "upper_roll_deg", "at_least": -6.35, "at_most": 6.35},
        "yaw": {"metric": "upper_yaw_deg", "at_least": -2.63, "at_most": 2.63},
    },
    "spring-pushers": {
        "tip_off": {
            "metric": "pushed_payload_omega_z_deg_s",
            "at_least": -3.25,
            "at_most": 3.25,
        },
        "moment": {"metric": "clamp_peak_moment_N_m", "at_most": 53.0},
    },
}


def known(repeats):
    """Print coverage on problems of known probability, and on a campaign with outcomes of known
    distributions: bodies that rotate steadily."""
    print(f"{'problem':28s} cover  bias  scatter  told  flights  doubted")
    for name, (d, margin) in PROBLEMS.items():

        def limit(u, margin=margin):
            return margin(u), np.empty((len(u), 0))

        def repeat(seed, limit=limit, d=d):
            one, _, flown = subset_simulation.estimate(
                limit, d, lambda what: generator(seed, what), FLIGHTS
            )
            return one.known, one.interval, flown, subset_simulation.estimate_warnings(one)

        tell(name, repeat, repeats)
    for coefficient in (0.0, 0.8):
        campaign = spinning(coefficient)
        for name in ("transverse", "roll") if coefficient == 0.0 else ("transverse",):

            def repeat(seed, campaign=campaign, name=name):
                one = campaign.rare(name, FLIGHTS, seed)
                return np.array(one.replicas), one.interval, one.flights, one.notes

            tell(f"campaign, {name}, r = {coefficient}", repeat, repeats)


def tell(name, repeat, repeats):
    """Repeat an estimate, and print its quality."""
    ratios, inside, flights, told, doubted = [], 0, 0, [], 0
    for seed in range(repeats):
        each, (low, high), flown, doubts = repeat(seed)
        inside += low <= P <= high
        ratios.append(each.mean() / P)
        told.append(each.std(ddof=1) / each.mean() / np.sqrt(len(each)))
        flights, doubted = max(flights, flown), doubted + bool(doubts)
    print(
        f"{name:28s} {100 * inside / repeats:4.0f} % {np.mean(ratios) - 1.0:+.3f}  "
        f"{np.std(ratios):.3f}   {np.median(told):.3f}  {flights}  {doubted}",
        flush=True,
    )


def spinning(coefficient):
    """Two bodies whose transverse rates are normal and correlated, and whose roll rate is
    uniform."""
    angles = (np.arange(4096) + 0.5) * np.pi / 2048
    across = np.cos(angles) ** 2 / (1 + coefficient) + np.sin(angles) ** 2 / (1 - coefficient)

    def beyond(square):  # probability of the sum of squares, integrated over the direction
        density = np.exp(-0.5 * square * across) / across
        return np.mean(density) / np.sqrt(1 - coefficient**2) - P

    bound = float(np.sqrt(optimize.brentq(beyond, 1.0, 200.0, xtol=1e-12)))
    axes = [f"initial.omega_deg_s.{axis}" for axis in "yz"]
    settings = {
        "body.fore.inertia_kg_m2": [3.0, 4.0, 4.0],
        "initial.omega_deg_s": [0.0, 0.0, 0.0],
        "output.transverse": ["fore"],
        "dispersion": {
            **{axis: {"normal": 1.0} for axis in axes},
            "initial.omega_deg_s.x": {"uniform": 1.0},
        },
        "correlation": [{"parameters": axes, "coefficient": coefficient}],
        "requirement": [
            {"name": "transverse", "metric": "fore_transverse_rate_deg_s", "at_most": bound},
            {"name": "roll", "metric": "fore_omega_x_deg_s", "at_most": 1.0 - 2.0 * P},
        ],
    }
    return Campaign(parse_campaign(tomllib.loads(PAIR), "spinning", settings))


def plain(name, cases, repeats=10):
    """Print estimates beside plain cases of a shipped campaign, run for statistics only."""
    about = [{"name": key, **item} for key, item in PLAIN[name].items()]
    campaign = sepmc.load(name, {"requirement": about, "run.history_step_s": 0.0})

    before = [0]

    def tell(done, total, failures):
        if done // _TOLD > before[0]:
            before[0] = done // _TOLD
            print(f"{done} cases", file=sys.stderr, flush=True)

    result = campaign.run(cases, seed=4711, stats_only=True, progress=tell)
    counts, seconds = result.requirements()["violations"], result.timing["kernel"]
    memory = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024
    print(
        f"{cases:.0e} plain cases of {name}: {result.status_counts}; {seconds:.0f} s, "
        f"{1e6 * seconds / cases:.2f} us a case, {memory:.0f} MB at most",
        flush=True,
    )
    for item in about:
        begun, seeds = time.perf_counter(), range(1, repeats + 1)
        estimates = [campaign.rare(item["name"], seed=seed) for seed in seeds]
        each = (time.perf_counter() - begun) / repeats
        best = np.mean([one.probability for one in estimates])
        count = int(counts[item["name"]])
        share, (low, high) = count / cases, of_share(count, cases)
        ends = [one.interval for one in estimates]
        print(
            f"  {item['name']:8s} {count} violate: {share:.3e} ({low:.2e} to {high:.2e}); mean of "
            f"{repeats} estimates {best:.3e}, scatter "
            f"{np.std([one.probability for one in estimates]) / best:.2f}; of their intervals "
            f"{sum(a <= share <= b for a, b in ends)} hold it, "
            f"{sum(a <= high and low <= b for a, b in ends)} overlap; {each:.1f} s each",
            flush=True,
        )


def main():
    """Measure and print."""
    warnings.simplefilter("ignore")
    arguments = sys.argv[1:]
    if arguments[:1] == ["plain"]:
        cases = int(float(arguments[1])) if len(arguments) > 1 else 100_000_000
        for name in arguments[2:] or PLAIN:
            plain(name, cases)
    else:
        known(int(arguments[0]) if arguments else 100)


if __name__ == "__main__":
    main()
