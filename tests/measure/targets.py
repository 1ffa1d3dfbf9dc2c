"""Numbers that the tests require, each beside its target (about four minutes): ``python
tests/measure/targets.py``."""

import numpy as np

import sepmc
from sepmc.campaign.execution.step_selection import integrate, select_steps
from sepmc.validation import lagrange

SEEDS = (2019, 1, 2, 3, 4, 5)
SURVEY = range(1000, 1060)
REPEATS = 7


def line(what, target, measured):
    print(f"| {what} | {target} | {measured} |", flush=True)


def scaled_error(ours, reference, sigma):
    """Largest |difference| / max(|reference|, sigma over the campaign), and the outcome it belongs
    to."""
    error = ((ours - reference).abs() / reference.abs().clip(lower=sigma, axis=1)).max()
    return f"{error.max():.1e} ({error.idxmax()})"


def table3(campaign):
    rows = [campaign.run(seed=seed).statistics().loc[list(campaign.reference)] for seed in SEEDS]
    dev = {
        name: np.array([row[f"dev_{name}"] for row in rows])
        for name in ("mean", "sigma", "min", "max")
    }
    extremes = np.stack([dev["min"], dev["max"]])
    line("nine means, worst of 6 seeds", "<= 0.05 sigma", f"{np.abs(dev['mean']).max():.3f} sigma")
    line("nine sigmas, worst of 6 seeds", "<= 5 %", f"{100 * np.abs(dev['sigma']).max():.1f} %")
    line(
        "eighteen extremes, average of 6 seeds",
        "<= 0.6 sigma",
        f"{np.abs(extremes.mean(axis=1)).max():.2f} sigma",
    )
    line("eighteen extremes, any seed", "<= 0.9 sigma", f"{np.abs(extremes).max():.2f} sigma")


def survey(campaign):
    """How far extremes scatter from seed to seed, on seeds of their own."""
    bare, names = campaign.with_settings({"run.history_step_s": 0.0}), list(campaign.reference)
    rows = [bare.run(seed=seed).statistics().loc[names] for seed in SURVEY]
    dev = {
        f"{name} {end}": np.array([row.loc[name, f"dev_{end}"] for row in rows])
        for name in names
        for end in ("min", "max")
    }
    beyond = np.abs(np.array(list(dev.values()))).max(axis=0) > 0.9
    scatter = sorted(((x.std(ddof=1), name) for name, x in dev.items()), reverse=True)
    line(
        f"of {len(SURVEY)} further seeds, those with an extreme beyond 0.9 sigma",
        "-",
        f"{beyond.sum()}",
    )
    line(
        "scatter of an extreme from seed to seed",
        "-",
        f"{scatter[-1][0]:.2f} to {scatter[1][0]:.2f}; {scatter[0][1]} {scatter[0][0]:.2f} sigma",
    )


def table1():
    # the wrench on each stage is solved for
    history = sepmc.load("table1.toml", {"solver.formulation": "full"}).simulate()

    def vector(name, unit):
        return history[[f"{name}_{axis}_{unit}" for axis in "xyz"]].to_numpy()

    force_u, force_l = vector("pins_force_on_upper", "N"), vector("pins_force_on_lower", "N")
    moment_u, moment_l = (
        vector("pins_moment_on_upper", "N_m"),
        vector("pins_moment_on_lower", "N_m"),
    )
    balance = moment_u + moment_l + np.cross(vector("pins_gap", "m"), force_l)
    free = (history["phase"] == "free").to_numpy()
    after = history[history["phase"] != "locked"]
    wrench = np.abs(np.hstack([force_u, force_l, moment_u, moment_l])[free]).max()
    margin = (after["upper_axial_acceleration_m_s2"] - after["lower_axial_acceleration_m_s2"]).min()
    line(
        "Table 1 (full): release",
        "0.260 +- 0.005 s",
        f"{history.attrs['outcomes']['release_time_s']:.5f} s",
    )
    line(
        "Table 1 (full): largest abs(F_upper + F_lower)",
        "round-off",
        f"{np.abs(force_u + force_l).max():.1e} N",
    )
    line(
        "Table 1 (full): largest abs(M_u + M_l + (r_l - r_u) x F_l)",
        "<= 1e-9 N m",
        f"{np.abs(balance).max():.1e} N m",
    )
    line("Table 1 (full): largest wrench after release", "0", f"{wrench:g}")
    line(
        "Table 1 (full): least extra deceleration of the lower stage after unlock",
        "> 0",
        f"{margin:.3f} m/s2",
    )


def agreement(campaign):
    result = campaign.run()
    cases, outcomes = result.to_pandas(), result.outcomes
    sigma = cases[outcomes].std()
    step = campaign.with_settings({"solver.step_s": 0.05})
    reduced, full = (
        step.with_settings({"solver.formulation": f}).run(cases=1000).to_pandas()[outcomes]
        for f in ("reduced", "full")
    )
    line(
        "full against reduced, 1,000 cases, every outcome",
        "<= 1e-10",
        scaled_error(full, reduced, sigma),
    )
    flown = cases[outcomes][:50].copy()
    reference = flown.copy()
    for i in range(len(reference)):
        outcomes_of_case = lagrange.simulate(campaign.case(i).to_dict())
        reference.loc[i] = [outcomes_of_case[name] for name in outcomes]
    line(
        "accuracy 1e-9 against DOP853 at rtol 1e-13, 50 cases",
        "<= 1e-8",
        scaled_error(flown, reference, sigma),
    )
    line("joint gap, every case", "<= 1e-9 m", f"{cases['joint_gap_residual_m'].max():.1e} m")
    line(
        "joint angle, every case",
        "<= 1e-9 rad",
        f"{cases['joint_angle_residual_rad'].max():.1e} rad",
    )


def same_bits(campaign):
    base = campaign.run(threads=1)
    table = base.to_pandas().drop(columns="status").to_numpy()
    others = {
        "2 threads": campaign.run(threads=2),
        "chunk 64": campaign.with_settings({"run.chunk": 64}).run(),
        "chunk 4096": campaign.with_settings({"run.chunk": 4096}).run(),
    }
    equal = {
        name: np.array_equal(table, other.to_pandas().drop(columns="status").to_numpy())
        for name, other in others.items()
    }
    drawn = base.to_pandas()[[c.name for c in campaign.input_columns]].to_numpy() * campaign.factors
    bare = campaign.with_settings({"run.history_step_s": 0.0})
    flight = select_steps(bare)
    forward, reverse = (integrate(bare, flight, rows).outcomes for rows in (drawn, drawn[::-1]))
    equal["case order reversed"] = np.array_equal(reverse[::-1], forward)
    line("same bits: " + ", ".join(equal), "yes", "yes" if all(equal.values()) else str(equal))


def kernel_time(campaign):
    bare = campaign.with_settings({"run.history_step_s": 0.0})
    for name, which in (("with curves over time", campaign), ("outcomes only", bare)):
        seconds = sorted(which.run().timing["kernel"] for _ in range(REPEATS))
        line(
            f"kernel, 10,000 cases, {name} (median of {REPEATS})",
            "< 2 s",
            f"{seconds[REPEATS // 2]:.3f} s",
        )


if __name__ == "__main__":
    table2 = sepmc.load("table2.toml")
    print("| what | target | measured |\n|---|---|---|")
    table3(table2)
    survey(table2)
    table1()
    agreement(table2)
    same_bits(table2)
    kernel_time(table2)
