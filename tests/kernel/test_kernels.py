"""Written kernels against the independent simulation, to the requested accuracy; rejected cases;
same bits in any lane."""

import dataclasses
import json
import os
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
from numpy.testing import assert_allclose, assert_array_equal
from oracles.independent import simulate
from small_scenes import SCENES, scene
from turning_pair import by_independent_flights

import sepmc
from sepmc import schema
from sepmc.campaign import cases
from sepmc.campaign.campaign import Campaign
from sepmc.campaign.execution import step_selection
from sepmc.campaign.execution.accuracy import decisive
from sepmc.engine.dispatch import integrate_cases, interpreted, load_kernel
from sepmc.engine.threads import max_threads
from sepmc.kernel.emit.compile_units import split
from sepmc.kernel.spec.methods import METHODS, method
from sepmc.kernel.spec.structure import make_kernel_spec
from sepmc.routines.lanes import LANES
from sepmc.scene import parameters
from sepmc.scene.read import parse_campaign
from sepmc.schema import Status

LOADS = ("N", "N m", "N s", "N m s")  # what joints carry
# cases flown, five blocks of lanes; those that are flown independently, each some seconds
COUNT, FEW = 40, 4
COMPILED, PLAIN = "stack", ("hanging", "ring")  # small scenes
QUIET = {"run.history_step_s": 0.0}
SHIPPED = (
    "table1",
    "table2",
    "nasa-fixed-joint",
    "spring-pushers",
    "residual-thrust",
    "srb",
    "hyper-x",
    "missile-rail",
)


def shipped(name, settings=None):
    """A shipped campaign without histories and without a fixed step."""
    campaign = sepmc.load(name)
    tree = dict(campaign.file.tree)
    tree["solver"] = {
        key: value for key, value in tree.get("solver", {}).items() if key != "step_s"
    }
    return Campaign(parse_campaign(tree, name, QUIET | (settings or {})))


def draws(campaign, count=COUNT, seed=None):
    """Samples in SI units, shape (count, d)."""
    return (
        cases.sample(
            campaign.file.dispersions, campaign.scene.run.seed if seed is None else seed, 0, count
        )
        * campaign.factors
    )


def outcomes(campaign, block, sound=slice(None)):
    return block.outcomes[sound, : len(campaign.outcome_columns)]


def special(campaign, flight, drawn, steps=None):
    """A block by the kernel alone; rejected cases have a negative status."""
    return integrate_cases(
        flight.kernel,
        campaign.layout,
        flight.steps if steps is None else steps,
        flight.durations,
        campaign.slots,
        drawn,
    )[0]


def difference(campaign, result, expected):
    """Largest relative difference; for an outcome that is zero to round-off (a constrained joint)
    relative to the largest of its unit. Times and positions of extremes are left out, they are
    uncertain where the extreme is flat. Impulses are quadratures, accurate to 1e-9: their
    differences count a hundredth."""
    decides, loads = (
        decisive(campaign.outcome_columns),
        [column.unit in LOADS for column in campaign.outcome_columns],
    )
    units = [column.unit for column in campaign.outcome_columns]
    errors = step_selection.relative_error(result, expected, units)
    sizes = np.abs(np.where(np.isnan(expected), 0.0, expected)).max(axis=0, initial=0.0)
    for i, unit in enumerate(units):
        largest = max(size for size, other in zip(sizes, units, strict=True) if other == unit)
        if 0.0 < sizes[i] < 1e-10 * largest or (loads[i] and sizes[i] < 1e-3 * largest):
            errors[i] = np.abs(result[:, i] - expected[:, i]).max() / largest
    errors[[column.unit in ("N s", "N m s") for column in campaign.outcome_columns]] /= 100.0
    worst = int(np.argmax(np.where(decides, errors, 0.0)))
    print(f"{campaign.name}: {errors[worst]:.1e} in {campaign.outcome_columns[worst].name}")
    return errors[worst]


def agree(campaign, most=1e-9):
    """At four times the steps, and by independent simulations; returns the number of rejected
    cases."""
    flight = step_selection.select_steps(campaign, history=campaign.scene.run.history_step > 0.0)
    assert flight.achieved.met
    drawn = draws(campaign)
    fast = special(campaign, flight, drawn, 4 * flight.steps)
    statuses, expected = by_independent_flights(campaign, FEW)
    assert_array_equal([Status(int(one)).label for one in fast.status[:FEW]], statuses)
    sound = np.flatnonzero(fast.status[:FEW] == 0)
    assert difference(campaign, outcomes(campaign, fast, sound), expected[sound]) <= most
    return int(np.count_nonzero(fast.status))


@pytest.fixture(scope="module")
def quiet():
    """Table 2 without histories."""
    return shipped("table2")


@pytest.fixture(scope="module")
def flight(quiet):
    return step_selection.select_steps(quiet)


# -- agreement
# --------------------------------------------------------------------------------------------------


@pytest.mark.slow
@pytest.mark.parametrize(
    ("name", "steps", "most"),
    [
        ("missile-rail", [4, 60, 20, 10], 1e-9),
        ("hyper-x", [6, 20, 4, 200], 3e-9),
        ("srb", [4, 3, 8], 1e-9),
    ],
)
def test_campaigns_with_a_step_of_their_own_agree(name, steps, most):
    """One case of each, interpreted, against an independent simulation: load events, delayed
    releases, tables over Mach number and angles, increments over a distance, clearances."""
    campaign = shipped(name, {"clearance": [], "run.end_time_s": 0.5} if name == "srb" else {})
    drawn = draws(campaign, 1)
    (status,), expected = by_independent_flights(campaign, 1)
    with interpreted():
        kernel = load_kernel(step_selection.kernel_text(campaign))
    assert len(step_selection.kernel_spec(campaign).segments) == kernel.n_segments
    steps, usual = np.array(steps), np.full(kernel.n_segments, np.inf)
    # how long it is latched sets the length of the steps until then
    for _ in range(2 if name == "missile-rail" else 1):
        fast, ends = integrate_cases(kernel, campaign.layout, steps, usual, campaign.slots, drawn)
        usual = np.diff(ends[:, 0], prepend=0.0)
    assert (status, fast.status[0]) == ("ok", 0)
    assert difference(campaign, outcomes(campaign, fast), expected) <= most


def with_all_loads(campaign):
    """The campaign with the loads of all joints."""
    return campaign.with_settings({"output.loads": list(campaign.scene.joint)})


@pytest.mark.slow
def test_a_small_scene_agrees_compiled():
    """Joints, loads and ends of phases, see `small_scenes`: 1e-9."""
    assert agree(with_all_loads(scene(COMPILED))) == 0


@pytest.mark.slow
@pytest.mark.parametrize("name", PLAIN)
def test_small_scenes_agree(name):
    """The other scenes as plain Python, with many steps."""
    campaign = with_all_loads(scene(name))
    drawn = draws(campaign, 2)
    statuses, expected = by_independent_flights(campaign, 2)
    with interpreted():
        kernel = load_kernel(step_selection.kernel_text(campaign))
    steps, usual = np.full(kernel.n_segments, 24), np.full(kernel.n_segments, np.inf)
    for _ in range(2):  # how long phases last sets the length of steps
        fast, ends = integrate_cases(kernel, campaign.layout, steps, usual, campaign.slots, drawn)
        usual = np.median(np.diff(ends, axis=0, prepend=0.0), axis=1)
    assert list(statuses) == ["ok", "ok"]
    assert list(fast.status) == [0, 0]
    assert difference(campaign, outcomes(campaign, fast), expected) <= 1e-9


@pytest.mark.slow
def test_a_small_scene_is_flown_whole():
    """Through `run`: rejected cases have outcomes too, and the audit is small."""
    campaign = with_all_loads(scene(COMPILED)).with_settings(QUIET)  # by the kernel that agrees
    table = campaign.run(cases=COUNT, seed=campaign.scene.run.seed).to_pandas()
    assert set(table["status"]) <= {"ok", "never-released"}
    assert np.count_nonzero(table["status"] == "ok") > COUNT // 2
    for column, bound in schema.AUDIT_BOUNDS.items():
        if column in table:
            assert table[column][table["status"] == "ok"].max() <= bound, column


# -- accuracy
# --------------------------------------------------------------------------------------------------


@pytest.mark.slow
@pytest.mark.parametrize(
    ("name", "accuracies"),
    [("dop853", (1e-3, 1e-6, 1e-9, 1e-11)), ("dopri5", (1e-3, 1e-6)), ("rk4", (1e-3, 1e-6))],
)
def test_accuracy_is_kept(quiet, flight, name, accuracies):
    """500 cases, none of the calibration, against many steps of the method of order 8; coarser
    accuracy takes fewer steps."""
    drawn = draws(quiet, 500, seed=77)
    fine = special(quiet, flight, drawn, np.array([4, 24, 16]))
    finer = special(quiet, flight, drawn, np.array([8, 36, 24]))
    assert difference(quiet, outcomes(quiet, fine), outcomes(quiet, finer)) <= 1e-12
    steps = []
    for accuracy in accuracies:
        campaign = quiet.with_settings({"solver.accuracy": accuracy, "solver.method": name})
        result = step_selection.select_steps(campaign)
        error = difference(
            quiet, outcomes(quiet, special(campaign, result, drawn)), outcomes(quiet, finer)
        )
        print(f"{name} at {accuracy}: steps {result.steps}, the pilot found {result.error:.1e}")
        assert error <= accuracy
        steps.append(int(result.steps.sum()))
    assert steps == sorted(set(steps))


@pytest.mark.slow
@pytest.mark.parametrize(
    ("name", "counts", "less"),
    [
        ("rk4", (8, 16, 32), 0.4),
        ("dopri5", (8, 16, 32), 0.4),
        ("tp7", (6, 9, 13), 0.4),
        ("dop853", (6, 9, 13), 0.4),
        # between steps that are too long for its order to show, and round-off
        ("sharp9", (6, 8, 10), 0.7),
    ],
)
def test_order_of_the_lanes(quiet, flight, name, counts, less):
    """A whole run of table 2 at twenty times the rotation, with a number of steps per phase: the
    slope is the method's order, less 0.4, or a little more."""
    assert set(METHODS) == {"rk4", "dopri5", "tp7", "dop853", "sharp9"}
    campaign = quiet.with_settings({"solver.method": name, "solver.accuracy": 1e-3})
    kernel = step_selection.select_steps(campaign).kernel
    drawn = draws(campaign, 16)
    places = [
        [d.parameter.path for d in campaign.file.dispersions].index(f"initial.omega.{axis}")
        for axis in "xy"
    ]
    drawn[:, places] *= 20.0  # up to 100 deg/s
    energy = [column.name for column in campaign.result_columns].index("energy_residual")

    def flown(kernel, n):
        steps = np.full(3, n, dtype=np.int64)
        block, _ = integrate_cases(
            kernel, campaign.layout, steps, flight.durations, campaign.slots, drawn
        )
        lost = block.outcomes[:, energy]
        # few steps lose more than a row may
        assert_array_equal(block.status == 0, lost <= schema.AUDIT_BOUNDS["energy_residual"])
        return outcomes(campaign, block)

    reference = flown(flight.kernel, 64)
    errors = [difference(campaign, flown(kernel, n), reference) for n in counts]
    order = -np.polyfit(np.log(counts), np.log(errors), 1)[0]
    print(f"{name}: errors {errors}, order {order:.2f}")
    assert errors[-1] > 1e-12
    assert order >= method(name).order - less


# -- same bits
# --------------------------------------------------------------------------------------------------


@pytest.fixture(scope="module")
def sample(quiet):
    """300 cases of table 2 with a history every 20 ms."""
    return quiet.with_settings({"run.history_step_s": 0.02}).run(cases=300)


@pytest.mark.parametrize("chunk", [1, 7, 64, 4096])
@pytest.mark.parametrize("threads", [1, 2])
def test_same_bits_however_the_work_is_split(quiet, sample, threads, chunk):
    count = 24 if chunk == 1 else 300
    result = quiet.with_settings({"run.history_step_s": 0.02, "run.chunk": chunk}).run(
        cases=count, threads=min(threads, max_threads())
    )
    for name, values in sample.table.items():
        assert_array_equal(result.table[name], values[:count], err_msg=name)
    mine, all_of_it = result.histories(), sample.histories()
    assert_array_equal(mine.to_numpy(), all_of_it[all_of_it["case"] < count].to_numpy())


def test_same_bits_without_histories(quiet, sample):
    """Another kernel, which stores nothing of a step: the same outcomes."""
    result = quiet.run(cases=300)
    for name, values in sample.table.items():
        assert_array_equal(result.table[name], values, err_msg=name)


def test_same_bits_in_any_lane(quiet, flight):
    """Alone, in reverse, shuffled, shifted by one lane."""
    drawn = draws(quiet, 100)
    base = special(quiet, flight, drawn)
    for order in (
        np.arange(100)[::-1],
        np.random.default_rng(5).permutation(100),
        np.roll(np.arange(100), 1),
    ):
        result = special(quiet, flight, drawn[order])
        assert_array_equal(result.outcomes, base.outcomes[order])
        assert_array_equal(result.status, base.status[order])
    for i in (0, 1, LANES - 1, LANES, 99):
        assert_array_equal(special(quiet, flight, drawn[i : i + 1]).outcomes[0], base.outcomes[i])


@pytest.mark.slow
def test_same_bits_where_lanes_are_through_at_different_times():
    """A scene with switches, strokes and delayed releases within its phases: cases alone, in
    reverse and shuffled."""
    campaign = with_all_loads(scene(COMPILED))
    flight, drawn = step_selection.select_steps(campaign), draws(campaign, 5 * LANES)
    assert (
        max(
            segment.max_intervals
            for segment in make_kernel_spec(campaign.layout, campaign.dispersed).segments
        )
        > 1
    )
    base = special(campaign, flight, drawn)
    for order in (np.arange(len(drawn))[::-1], np.random.default_rng(5).permutation(len(drawn))):
        result = special(campaign, flight, drawn[order])
        assert_array_equal(result.outcomes, base.outcomes[order])
        assert_array_equal(result.indicators, base.indicators[order])
    for i in (0, LANES, len(drawn) - 1):
        assert_array_equal(
            special(campaign, flight, drawn[i : i + 1]).outcomes[0], base.outcomes[i]
        )


@pytest.mark.slow
def test_same_bits_where_a_load_is_there_as_its_phase_begins():
    """The minimum step of a case is a fraction of its own remaining time."""
    campaign = sepmc.load(Path(__file__).parents[1] / "scenes" / "load-there-at-another-time.toml")
    flight, drawn = step_selection.select_steps(campaign), draws(campaign, 1000)
    base = special(campaign, flight, drawn)
    assert_array_equal(special(campaign, flight, drawn[::-1]).outcomes[::-1], base.outcomes)


def test_same_bits_beside_a_lost_case(quiet, flight):
    """NaN, inf or a case outside the atmosphere in one lane affects no other lane."""
    drawn = draws(quiet, 64)
    base = special(quiet, flight, drawn)
    hurt = drawn.copy()
    paths = [d.parameter.path for d in quiet.file.dispersions]
    for lane, (path, value) in enumerate(
        [
            ("body.upper.mass", np.nan),
            ("body.lower.mass", -1.0),
            ("initial.altitude", 2e5),
            ("initial.speed", np.inf),
            ("body.upper.mass", 0.0),
        ]
    ):
        hurt[LANES * lane + lane, paths.index(path)] = value
    result = special(quiet, flight, hurt)
    lost = np.flatnonzero(result.status)
    assert_array_equal(lost, [LANES * lane + lane for lane in range(5)])
    rest = np.setdiff1d(np.arange(64), lost)
    assert_array_equal(result.outcomes[rest], base.outcomes[rest])


# -- cases it cannot vouch for
# --------------------------------------------------------------------------------------------------


def flown_independently(campaign, drawn, numbers):
    """Statuses (n,) and outcomes (n, o), SI units, of some samples (n, d), each by an independent
    simulation."""
    laws = campaign.file.dispersions
    flown = []
    for number in numbers:
        values = {law.parameter.path: float(x) for law, x in zip(laws, drawn[number], strict=True)}
        flown.append(
            simulate(
                dataclasses.replace(
                    campaign.nominal(), scene=parameters.replace(campaign.nominal().scene, values)
                ).to_dict()
            )
        )
    columns = campaign.outcome_columns
    return [one.status for one in flown], np.array(
        [[one.outcomes.get(c.name, np.nan) / c.scale for c in columns] for one in flown]
    )


def compare_statuses(campaign, drawn, numbers, most=3e-9):
    """Compare statuses and outcomes of some samples with independent simulations; returns the
    statuses of all."""
    result = step_selection.integrate(campaign, step_selection.select_steps(campaign), drawn)
    numbers = np.array(numbers)
    statuses, expected = flown_independently(campaign, drawn, numbers)
    assert [Status(int(one)).label for one in result.status[numbers]] == statuses
    ok = result.status[numbers] == Status.OK
    if ok.any():
        assert difference(campaign, outcomes(campaign, result, numbers[ok]), expected[ok]) <= most
    return result.status


def test_invalid_masses(quiet):
    """A normal distribution with a tail below zero, through `run`."""
    campaign = quiet.with_settings({"dispersion.body.upper.mass_kg": {"normal": 200.0}})
    table = campaign.run(cases=300).table
    impossible = table["in_body_upper_mass_kg"] <= 0.0
    assert 0 < np.sum(impossible) < 100
    assert_array_equal(table["status"] == "invalid-input", impossible)
    assert np.isnan(table["upper_omega_z_deg_s"][impossible]).all()
    assert np.isfinite(table["upper_omega_z_deg_s"][table["status"] == "ok"]).all()


def test_draws_that_are_no_numbers(quiet):
    drawn = draws(quiet, 40)
    hit = np.arange(drawn.shape[1])
    drawn[hit, hit] = np.resize([np.nan, np.inf, -np.inf], len(hit))
    status = compare_statuses(quiet, drawn, [len(hit), 39])
    assert (status[hit] == Status.INVALID_INPUT).all()
    assert (status[len(hit) :] == Status.OK).all()


@pytest.mark.slow
def test_beyond_the_atmosphere(quiet):
    drawn = draws(quiet, 40)
    height = [d.parameter.path for d in quiet.file.dispersions].index("initial.altitude")
    drawn[[3, 17], height] = 86_010.0, -5.0
    # leaves it; crosses the edge of a layer, 71 km', on the way
    drawn[[5, 30], height] = 85_999.0, 71_802.0
    status = compare_statuses(quiet, drawn, [0, 3, 5, 17, 30])
    assert (status[[3, 17]] == Status.OUTSIDE_ATMOSPHERE).all()
    assert status[30] == Status.OK


def test_across_an_edge_of_the_air(quiet):
    """Steps end where a body moves into the next atmosphere layer."""
    edge = 6_356_766.0 * 71e3 / (6_356_766.0 - 71e3)
    steep = quiet.with_settings(
        {
            "initial.pitch_deg": 40.0,
            "initial.alpha_deg": 0.0,
            "initial.altitude_m": edge - 500.0,
            "dispersion": {},
        }
    )
    campaign = steep.with_settings(
        {
            "dispersion.initial.altitude_m": {"uniform": 3000.0},
            "dispersion.initial.roll_deg": {"uniform": 3.0},
        }
    )
    flight = step_selection.select_steps(campaign)
    drawn = draws(campaign, 64)
    alone = special(campaign, flight, drawn)
    crossing = (drawn[:, 0] < edge) & (drawn[:, 0] > edge - 2000.0)
    # others fly 500 m in a step, as some beside the edge do
    assert (alone.status[crossing] == 0).mean() > 0.5
    assert (alone.status[~crossing & (np.abs(drawn[:, 0] - edge) > 2500.0)] == 0).all()
    compare_statuses(campaign, drawn, np.flatnonzero(crossing)[:4])


def test_never_released(quiet):
    """The end time is before the stroke end in some cases."""
    campaign = quiet.with_settings({"run.end_time_s": 0.285})
    status = compare_statuses(campaign, draws(campaign, 100), range(8))
    assert 0 < np.count_nonzero(status == Status.NEVER_RELEASED) < 50
    counts = campaign.run(cases=100).status_counts
    assert counts["never-released"] == np.count_nonzero(status == Status.NEVER_RELEASED)


def test_never_released_in_most_cases(quiet):
    """The run has all columns, and its rows have values."""
    campaign = quiet.with_settings({"run.end_time_s": 0.25})
    result = campaign.run(cases=30)
    assert_array_equal(result.table["status"][:FEW], by_independent_flights(campaign, FEW)[0])
    assert result.status_counts["never-released"] > 15
    assert list(result.table) == [column.name for column in campaign.columns]
    assert np.isfinite(result.table["upper_omega_z_deg_s"]).all()


def test_a_stroke_of_nothing(quiet):
    """Released as the guided phase begins: an event that is met before it can be predicted."""
    campaign = quiet.with_settings({"phase.guided.until.stroke_mm": 0.0})
    table = campaign.run(cases=100).table
    assert set(table["status"]) == {"ok"}
    assert np.abs(table["release_time_s"] - 0.05).max() <= 1e-9


@pytest.mark.slow
@pytest.mark.parametrize("distance", [500.0, 30.0, 41.0])
def test_an_event_that_is_over_as_its_phase_begins(distance, plainly):
    """The upper joint, released at 40 mm of stroke, is some 45 mm away by then: a phase until a
    smaller stroke ends at once, never earlier."""
    phases = [dict(phase) for phase in scene("stack").file.tree["phase"]]
    phases[2]["until"] = {"joint": "upper", "distance_mm": distance}
    campaign = scene(
        "stack", {"phase": phases, "dispersion": {"body.top.mass_kg": {"uniform": 5.0}}}
    )
    table = campaign.run(cases=3).table
    statuses, expected = by_independent_flights(campaign, 3)
    assert list(table["status"]) == statuses
    ok = np.array(statuses) == "ok"
    result = np.column_stack([table[c.name] / c.scale for c in campaign.outcome_columns])
    if ok.any():
        assert difference(campaign, result[ok], expected[ok]) <= 3e-9


@pytest.mark.slow
def test_a_stroke_just_missed(pair, monkeypatch):
    """A spring with its stroke end 1 to 10 um beyond its turning point: x = (1 - cos(w t)) / 2. The
    event is predicted until the motion reverses; the remaining time to the end is then not a short
    step."""
    spring = {
        "name": "s",
        "bodies": ["aft", "fore"],
        "point_m": [2.0, 0.0, 0.0],
        "axis": [1.0, 0.0, 0.0],
    }
    settings = {
        "spring": [spring | {"force_N": 1000.0, "stiffness_N_per_m": 2000.0, "stroke_m": 1.0}],
        "phase": [
            {"name": "held", "joints": {"pins": "fixed"}, "until": {"time_s": 0.05}},
            {"name": "slide", "joints": {"pins": "slider"}},
        ],
        "body.fore.mass_kg": 100.0,
        "body.aft.mass_kg": 50.0,
        "run.end_time_s": 0.6,
        "solver": {"accuracy": 1e-6},
        "dispersion": {"spring.s.stroke_m": {"uniform": [0.95, 1.05]}},
    }
    monkeypatch.setattr(step_selection, "CORNERS", 2)
    monkeypatch.setattr(step_selection, "SAMPLE", 16)
    campaign = pair(settings)
    with interpreted():
        flight = step_selection.select_steps(campaign)
        result = step_selection.integrate(
            campaign, flight, np.linspace(1.000001, 1.00001, 24)[:, None]
        )
    turn = np.sqrt(2000.0 * (1.0 / 100.0 + 1.0 / 50.0)) * 0.55
    names = [column.name for column in campaign.outcome_columns]
    distance = outcomes(campaign, result, result.status == Status.OK)[
        :, names.index("separation_distance_mm")
    ]
    assert len(distance) == 24
    assert_allclose(
        np.abs(distance), 0.5 * (1.0 - np.cos(turn)), rtol=3.0 * campaign.scene.solver.accuracy
    )


@pytest.mark.slow
def test_an_event_touched_but_not_crossed(quiet):
    """Strokes of all lengths under a weak motor: most phases last far longer than in calibration
    cases. Release times as in the independent simulation."""
    campaign = shipped(
        "table2", {"motor.retro.thrust_N": 150.0, "phase.guided.until.stroke_mm": 5.0}
    )
    campaign = campaign.with_settings(
        {"dispersion": {"phase.guided.until.stroke_mm": {"uniform": [0.01, 12.0]}}}
    )
    drawn = draws(campaign, 64)
    grazing = np.argsort(drawn[:, 0])[24:40:2]
    assert (compare_statuses(campaign, drawn, grazing, most=1e-8) == Status.OK).all()


@pytest.mark.parametrize(
    ("stroke", "release", "missed"),
    [(4.26, 0.8521001, False), (4.26478, 0.8766800, True), (4.2652, 2.8127990, True)],
)
def test_a_stroke_met_and_left_again_within_a_step(stroke, release, missed):
    """A slide that reverses at 4.264980 m and is pushed on later. Long steps may miss a stroke just
    short of that: such a case, and one with a stroke just beyond, is refined by itself; short steps
    find it."""
    campaign = sepmc.load(Path(__file__).parents[1] / "data" / "grazed.toml")
    with interpreted():
        kernel = load_kernel(step_selection.kernel_text(campaign))
    drawn, usual = np.array([[stroke]]), np.array([1.7, 4.3])
    column = [c.name for c in campaign.outcome_columns].index("release_time_s")
    long = integrate_cases(kernel, campaign.layout, np.array([6, 3]), usual, campaign.slots, drawn)[
        0
    ]
    short = integrate_cases(
        kernel, campaign.layout, np.array([60, 30]), usual, campaign.slots, drawn
    )[0]
    assert np.isnan(long.indicators).any() == missed
    assert_allclose(short.outcomes[0, column], release, atol=1e-6)


# -- histories
# --------------------------------------------------------------------------------------------------


@pytest.mark.slow
def test_histories_agree(quiet):
    """Separations every 10 ms, by polynomials of the steps, against converged single runs: 1e-8 of
    the largest."""
    campaign = quiet.with_settings({"run.history_step_s": 0.01})
    result = campaign.run(cases=5)
    histories = result.histories()
    for number in range(5):
        mine = histories[histories["case"] == number]
        alone = campaign.simulate(result.case(number), step_s=0.01).drop_duplicates(
            "time_s", keep="last"
        )
        assert_allclose(mine["time_s"], 0.01 * np.arange(51), rtol=1e-12)
        at = [int(np.abs(alone["time_s"] - t).to_numpy().argmin()) for t in mine["time_s"]]
        for column in ("separation_speed_m_s", "separation_distance_mm"):
            error = (
                np.abs(mine[column].to_numpy() - alone[column].to_numpy()[at]).max()
                / alone[column].abs().max()
            )
            assert error <= 1e-8, column


def test_histories_of_cases_that_are_never_released(quiet):
    """They continue to the end."""
    result = quiet.with_settings({"run.history_step_s": 0.01, "run.end_time_s": 0.285}).run(
        cases=60
    )
    late = np.flatnonzero(result.table["status"] == "never-released")
    assert 0 < len(late) < 30
    histories = result.histories()
    assert set(late) <= set(histories["case"])
    rows = histories[histories["case"] == late[0]]
    assert len(rows) == 29
    assert (np.diff(rows["separation_distance_mm"])[6:] > 0.0).all()


# -- texts
# --------------------------------------------------------------------------------------------------

NUMBERS = [
    {"body.upper.mass_kg": 500.0},
    {"run.seed": 5, "run.cases": 7, "run.end_time_s": 0.6, "solver.accuracy": 1e-6},
    {"body.upper.aerodynamics.pitch.alpha": -0.5},
    {"body.lower.inertia_products_kg_m2": [1.0, 2.0, 3.0]},
    {"motor.retro.thrust_N": 800.0, "motor.retro.build_up_s": 0.2, "motor.retro.cant_deg": 170.0},
    {"phase.guided.until.stroke_mm": 30.0, "phase.locked.until.time_s": 0.1},
    {"initial.omega_deg_s": [1.0, 2.0, 3.0], "environment.wind.speed_m_s": 0.0},
    {"joint.pins.point_mm": [2300.0, 1.0, 2.0]},
    {"dispersion": {}},
    {"dispersion.body.upper.mass_kg": {"normal": 5.0}},
]
STRUCTURE = [
    {"load": [{"name": "tug", "body": "upper", "force_N": [1.0, 0.0, 0.0]}]},
    {"load": [{"name": "tug", "body": "upper", "force_N": [1.0, 0.0, 0.0], "start_s": 0.1}]},
    {"body.plug": {"mass_kg": 1.0, "inertia_kg_m2": [1.0, 1.0, 1.0], "cg_m": [3.0, 0.0, 0.0]}},
    {"dispersion.joint.pins.fails": {"discrete": [0, 1]}},
    {"motor.retro.burn_s": 0.2},
    {"body.upper.aerodynamics.pitch.beta": 0.1},
    {"environment.gravity": "none"},
    {"environment.atmosphere": "none"},
    {"solver.method": "rk4"},
    {"solver.drift": "none"},
    {"output.tip_off": ["pins"]},
    {
        "phase": [
            {"name": "locked", "joints": {"pins": "fixed"}, "until": {"time_s": 0.05}},
            {"name": "free"},
        ]
    },
]


@pytest.mark.parametrize("settings", NUMBERS, ids=str)
def test_numbers_do_not_stand_in_a_kernel(quiet, settings):
    """Scenes of equal structure share it, so that a study compiles once."""
    assert step_selection.kernel_text(quiet.with_settings(settings)) == step_selection.kernel_text(
        quiet
    )


def test_every_structure_has_a_kernel_of_its_own(quiet):
    texts = [
        step_selection.kernel_text(quiet.with_settings(settings)) for settings in [{}, *STRUCTURE]
    ]
    assert len(set(texts)) == len(texts)
    assert step_selection.kernel_text(quiet, history=True) not in texts


@pytest.mark.parametrize(
    ("settings", "history", "apart"),
    [
        ({}, True, {"load_cases", "integrate_block"}),
        (
            {"solver.step_s": 0.05},
            False,
            {
                "advance_sharp9",
                "advance_tp7",
                "event_step_phase2",
                "polish_event",
                "integrate_block",
                "set_event_flags",
                "set_event_polish_step",
                "set_step",
                "finish_step",
            },
        ),
        (
            {"solver.method": "rk4"},
            False,
            {"advance_sharp9", "advance_tp7", "load_cases", "write_results", "integrate_block"},
        ),
        ({"output.tip_off": ["pins"]}, False, {"load_cases", "write_results", "leave_phase2"}),
    ],
    ids=["histories", "a given step", "another method", "rates at release"],
)
def test_only_what_differs_is_compiled(quiet, settings, history, apart):
    """Compile units of table 2 that another kernel of it does not share."""
    other = {
        piece.text
        for piece in split(
            step_selection.kernel_text(quiet.with_settings(settings), history=history)
        )
    }
    assert {
        piece.name for piece in split(step_selection.kernel_text(quiet)) if piece.text not in other
    } == apart


def test_a_dispersed_delay_has_a_kernel_of_its_own():
    campaign = shipped("spring-pushers")
    laws = {
        key: law
        for key, law in campaign.file.tree["dispersion"].items()
        if key != "joint.clamp.delay_s"
    }
    assert step_selection.kernel_text(campaign) != step_selection.kernel_text(
        campaign.with_settings({"dispersion": laws})
    )


@pytest.mark.parametrize("name", [*SHIPPED, *SCENES])
def test_a_text_is_a_module_that_says_what_it_does(name):
    """It parses, has a docstring and no long line, and is reproducible."""
    campaign = shipped(name) if name in SHIPPED else scene(name)
    text = step_selection.kernel_text(campaign, history=True)
    compile(text, name, "exec")
    assert text.startswith('"""Kernel of ')
    assert text == step_selection.kernel_text(campaign, history=True)
    for number in range(1, len(campaign.scene.phase) + 1):
        assert f"def rates_phase{number}(w):" in text


@pytest.mark.parametrize("name", ["table2", "missile-rail"])
def test_kernels_with_and_without_histories_share_units(name):
    """With joint loads, too: fields that only some kernels have are stored after all others."""
    campaign = shipped(name).with_settings({"run.history_step_s": 0.0})
    plain, other = (
        {unit.text for unit in split(step_selection.kernel_text(campaign, history=history))}
        for history in (False, True)
    )
    assert len(plain & other) >= 0.85 * len(plain)


# -- machine code
# --------------------------------------------------------------------------------------------------

ASSEMBLY = """
import json, re
from sepmc.campaign.execution import step_selection
from sepmc.kernel.emit.compile_units import split
from sepmc.translator import compiler
import sepmc
text = step_selection.kernel_text(sepmc.load("table2.toml", {"output.loads": ["pins"]}))
code = []
for piece in split(text):
    module = compiler.optimised(compiler.assembly(piece.text, "entry"))
    lines = compiler.target_machine().emit_assembly(module).splitlines()
    code += [(piece.name, line) for line in lines]
found, function = {}, None
for name, line in code:
    label = re.match(r"([A-Za-z_][^\\s:]*):", line)
    if label:
        function = name if label[1] == "entry" else None
    if ".cfi_endproc" in line:
        function = None
    if function:
        counts = found.setdefault(function, {"packed": 0, "scalar": 0, "calls": 0})
        word = line.split()[0] if line.split() else ""
        wide = "%ymm" in line or "%zmm" in line or "ymmword" in line or "zmmword" in line
        plain = r"add|sub|mul|div|sqrt|fn?madd\\d+|fn?msub\\d+"
        packed = re.fullmatch(rf"v(f?n?m(ul|add|sub)\\d*|{plain})pd", word)
        counts["packed"] += bool(packed) and wide
        counts["scalar"] += bool(re.fullmatch(rf"v?({plain})sd", word))
        counts["calls"] += word.startswith("call")
print(json.dumps(found))
"""


@pytest.mark.slow
def test_machine_code_is_straight_and_wide(tmp_path):
    """Arithmetic is packed, of four or eight cases: in the derivative of every phase it outnumbers
    scalar arithmetic 20 to 1, without calls; no other piece of a kernel has more than a few scalar
    instructions. LLVM leaves a loop over lanes that it unrolls first scalar."""
    flags = Path("/proc/cpuinfo")
    if not flags.is_file() or " avx2 " not in flags.read_text(encoding="utf-8").replace(
        "\n", " \n"
    ):
        pytest.skip("no AVX2, or no way to know")
    # code from a cache cannot be looked at
    environment = {**os.environ, "SEPMC_CACHE_DIR": str(tmp_path)}
    done = subprocess.run(
        [sys.executable, "-c", ASSEMBLY],
        capture_output=True,
        text=True,
        env=environment,
        check=False,
    )
    assert done.returncode == 0, done.stderr
    content = json.loads(done.stdout)
    print(content)
    derivatives = {"rates_phase1", "rates_phase2", "rates_phase3"}
    assert derivatives | {"advance_sharp9", "interpolate_phase1", "note_indicators"} <= set(content)
    for function, counts in content.items():
        assert counts["scalar"] <= 8 + counts["packed"] / 20, function
    for function in derivatives:
        counts = content[function]
        assert counts["packed"] >= 200, function
        assert counts["packed"] >= 20 * counts["scalar"], function
        assert counts["calls"] == 0, function


WITHOUT_JIT = """
import json, sepmc
from sepmc.campaign.execution import step_selection
step_selection.CORNERS, step_selection.SAMPLE = 3, 16
campaign = sepmc.load("table2.toml", {"run.history_step_s": 0.1, "solver.accuracy": 1e-3})
result = campaign.run(cases=2, seed=7)
table = result.to_pandas().drop(columns="status").to_dict("list")
print(json.dumps({"table": table, "steps": result.integration.steps.tolist()}))
"""


@pytest.mark.slow
def test_python_and_compiled_agree(monkeypatch):
    """With the JIT off the written module is plain Python, with calibration and histories;
    calibration cases are few there."""
    environment = {**os.environ, "NUMBA_DISABLE_JIT": "1"}
    done = subprocess.run(
        [sys.executable, "-c", WITHOUT_JIT],
        capture_output=True,
        text=True,
        env=environment,
        check=False,
    )
    assert done.returncode == 0, done.stderr
    python = json.loads(done.stdout)
    monkeypatch.setattr(step_selection, "CORNERS", 3)
    monkeypatch.setattr(step_selection, "SAMPLE", 16)
    compiled = sepmc.load("table2.toml", {"run.history_step_s": 0.1, "solver.accuracy": 1e-3}).run(
        cases=2, seed=7
    )
    assert python["steps"] == compiled.integration.steps.tolist()
    for name, values in python["table"].items():
        if not name.endswith(
            (
                "_residual_m",
                "_residual_rad",
                "_residual_m_s",
                "_residual_rad_s",
                "_residual_s",
                "attitude_drift",
            )
        ):
            np.testing.assert_allclose(
                compiled.table[name], values, rtol=1e-9, atol=1e-10, err_msg=name
            )


def test_a_flight_at_twice_the_resolution(flight):
    refined = flight.refined()
    assert_array_equal(refined.steps, 2 * flight.steps)
    assert dataclasses.replace(refined, steps=flight.steps).kernel is flight.kernel
    assert dataclasses.replace(flight, step=0.1).refined().step == 0.05
