"""Times at which strokes of springs end and at which joints are released in part."""

import math

import numpy as np
import pytest
from numpy.testing import assert_allclose
from oracles import independent
from small_scenes import PUSH, REDUCED
from turning_pair import BOTH, TURNING, agrees, alone

from sepmc.engine.dispatch import integrate_cases, interpreted, load_kernel
from sepmc.kernel.emit.module import emit
from sepmc.kernel.spec.structure import make_kernel_spec
from sepmc.kernel.spec.variant import Variant
from sepmc.scene.messages import SceneError
from sepmc.schema import Contents, Status, outcome_columns, partial_release_columns, stroke_columns

SLIDES = {"phase": [{"name": "guided", "joints": {"pins": "slider"}}]}
# force less stiffness times extension over 0.2 m: see `test_springs_and_loads.test_stroke_end`
SOFT = PUSH | {"stiffness_N_per_m": 40.0, "stroke_m": 0.2}
END = math.acos(1.0 / 3.0) / math.sqrt(40.0 / REDUCED)  # of that stroke, s
COLUMN = "push_stroke_end_time_s"


def cut(joint, when, name="cut", **more):
    return {"name": name, "joint": joint, "when": when} | more


@pytest.mark.parametrize("step_s", [0.02, 0.1, None])
def test_stroke_end_of_a_row_and_of_a_single_case(pair, plainly, step_s):
    """Both in closed form, at a given step and without."""
    solver = {"accuracy": 1e-9} if step_s is None else {"step_s": step_s}
    campaign = pair(SLIDES | {"spring": [SOFT], "run.end_time_s": 1.0, "solver": solver})
    result, history = campaign.run(cases=2), campaign.simulate()
    assert_allclose(result.table[COLUMN], END, rtol=1e-9)
    assert_allclose(history.attrs["outcomes"][COLUMN], END, rtol=1e-9)
    assert history.attrs["springs"] == {"push": history.attrs["outcomes"][COLUMN]}
    assert result.accuracy.errors[COLUMN] <= 1e-6
    assert COLUMN in history.attrs["errors"]
    at_end = np.isclose(history["time_s"], END, rtol=0, atol=1e-9)
    assert_allclose(history["separation_distance_mm"][at_end], 200.0, rtol=0, atol=1e-5)


def test_stroke_that_does_not_end(pair, plainly):
    """Overdrawn at 0.6 m, the spring swings back 1 mm before the end of its stroke."""
    campaign = pair(SLIDES | {"spring": [SOFT | {"stroke_m": 0.601}], "run.end_time_s": 2.0})
    assert np.isnan(campaign.run(cases=2).table[COLUMN]).all()
    assert math.isnan(campaign.simulate().attrs["springs"]["push"])


def test_only_springs_with_a_stroke_have_a_column(pair):
    """Of two springs the one with a stroke; of none, none. Other columns keep their order."""
    plain = [c.name for c in pair(SLIDES | {"spring": [PUSH]}).outcome_columns]
    assert not any("stroke_end" in name for name in plain)
    both = [PUSH | {"name": "endless"}, SOFT]
    names = [c.name for c in pair(SLIDES | {"spring": both}).outcome_columns]
    assert [name for name in names if name not in plain] == [COLUMN]
    assert [name for name in names if name in plain] == plain


def test_column_of_a_stroke_that_only_the_dispersion_gives(pair, plainly):
    """Without a nominal stroke the nominal case has the column too, without a value; every case,
    sampled or given, has that of its own stroke."""
    strokes = {"dispersion": {"spring.push.stroke_m": {"uniform": [0.1, 0.2]}}}
    bound = {"name": "soon", "metric": COLUMN, "at_most": 1.0}
    endless = {key: value for key, value in SOFT.items() if key != "stroke_m"}
    campaign = pair(
        SLIDES | {"spring": [endless], "run.end_time_s": 1.0, "requirement": [bound]} | strokes
    )
    table = campaign.run(cases=4).table
    w = math.sqrt(40.0 / REDUCED)
    expected = np.arccos(1.0 - table["in_spring_push_stroke_m"] / 0.3) / w
    assert_allclose(table[COLUMN], expected, rtol=1e-9)
    nominal = campaign.simulate().attrs
    assert list(nominal["outcomes"]) == [c.name for c in campaign.result_columns]
    assert math.isnan(nominal["outcomes"][COLUMN])
    for case in (2, campaign.case(2)):
        assert_allclose(campaign.simulate(case).attrs["springs"]["push"], expected[2], rtol=1e-9)


def test_invalid_stroke_of_a_case(pair, plainly):
    """A sampled stroke that is not positive: no row, with the columns of the campaign."""
    endless = {key: value for key, value in SOFT.items() if key != "stroke_m"}
    strokes = {"spring.push.stroke_m": {"normal": [0.01, 0.1]}}
    campaign = pair(SLIDES | {"spring": [endless], "dispersion": strokes})
    status = campaign.run(cases=20).table["status"]
    number = int(np.flatnonzero(status == "invalid-input")[0])
    attributes = campaign.simulate(number).attrs
    assert attributes["status"] == "invalid-input"
    assert math.isnan(attributes["springs"]["push"])


LONG = {
    "name": "long", "bodies": BOTH, "point_m": [2.0, -0.2, 0.1], "axis": [-1.0, 0.1, 0.0],
    "force_N": 15.0, "stroke_m": 0.03,
}  # fmt: skip
SHORT = LONG | {"name": "short", "point_m": [2.0, 0.2, 0.0], "stroke_m": 0.01}
FAR = LONG | {"name": "far", "stroke_m": 5.0, "factor": 0.0}
SPRINGS = {"spring": [SHORT, FAR, LONG]}
AGAIN = {"bodies": BOTH, "point_m": [2.1, 0.2, 0.0]}
SCENES = {
    "slider": SLIDES | SPRINGS,
    "free after a lock": SPRINGS
    | {
        "phase": [
            {"name": "locked", "joints": {"pins": "fixed"}, "until": {"time_s": 0.03}},
            {"name": "free"},
        ]
    },
    "its end ends a phase": SPRINGS
    | {
        "phase": [
            {"name": "guided", "joints": {"pins": "slider"}, "until": {"spring": "short"}},
            {"name": "free"},
        ]
    },
    "the end of all ends a phase": SPRINGS
    | {
        "phase": [
            {
                "name": "guided",
                "joints": {"pins": "slider"},
                "until": {"all": [{"spring": "short"}, {"spring": "long"}]},
            },
            {"name": "free"},
        ]
    },
    "its end releases a joint": SPRINGS
    | {
        "phase": [{"name": "guided", "joints": {"pins": "slider"}}],
        "release": [cut("pins", {"spring": "short"})],
        "joint.pins.delay_s": 0.01,
    },
    "redundant joints": SPRINGS
    | {
        "joint.again": AGAIN,
        "phase": [{"name": "guided", "joints": {"pins": "slider", "again": "slider"}}],
        "release": [cut("again", {"time_s": 0.05})],
    },
    "to the ground": {"spring": [SHORT | {"bodies": ["ground", "aft"]}]}
    | {"phase": [{"name": "free"}]},
}


@pytest.mark.slow
@pytest.mark.parametrize("name", SCENES)
def test_stroke_ends_as_the_independent_simulation(pair, name):
    """Every column, among them a spring that pushes nothing and ends nowhere."""
    campaign = pair(TURNING | SCENES[name])
    outcomes = agrees(campaign)
    ended = {k for k, v in stroke_columns(campaign.layout.contents).items() if outcomes[v] > 0.0}
    assert ended == {spring.name for spring in campaign.scene.spring} - {"far"}


@pytest.mark.parametrize("variant", [Variant.ANY_ORDER, Variant.LEAST_SQUARES])
def test_every_kernel_writes_the_same(pair, variant):
    """Kernels that integrate what the standard one rejects have all columns, with the same
    values."""
    laws = {"spring.long.stroke_m": {"uniform": 0.01}, "spring.short.force_N": {"uniform": 5.0}}
    settings = {**SCENES["free after a lock"], "dispersion": laws, "run.end_time_s": 0.2}
    campaign = pair(TURNING | settings)
    draws = campaign.in_si(campaign.sample(0, 5))
    rows = []
    with interpreted():
        for which in (Variant.STANDARD, variant):
            spec = make_kernel_spec(campaign.layout, campaign.dispersed, which)
            kernel = load_kernel(emit(spec, campaign.scene.solver.method))
            ones = np.ones(kernel.n_segments, dtype=np.int64)
            block, _ = integrate_cases(
                kernel, campaign.layout, ones, np.inf * ones, campaign.slots, draws
            )
            assert (block.status == Status.OK).all()
            rows.append(block.outcomes[:, : len(campaign.outcome_columns)])
    assert_allclose(rows[1], rows[0], rtol=1e-8, atol=1e-9)
    k = [c.name for c in campaign.outcome_columns].index("long_stroke_end_time_s")
    assert (rows[0][:, k] > 0.05).all()
    assert len(set(rows[0][:, k])) == 5


def test_stroke_of_a_spring_between_bodies_that_stay_fixed(pair, plainly):
    """No kernel monitors it: the column is there, without a value."""
    campaign = pair({"spring": [SOFT]})
    assert np.isnan(campaign.run(cases=2).table[COLUMN]).all()
    assert math.isnan(campaign.simulate().attrs["springs"]["push"])


def test_two_columns_of_one_name_are_refused(pair):
    """An event of the name that the column of a spring has already."""
    event = {"name": "push_stroke_end", "when": {"time_s": 0.1}}
    with pytest.raises(SceneError, match="two outcomes called push_stroke_end_time_s"):
        pair(SLIDES | {"spring": [SOFT], "event": [event]})


# Releases to another kind than free: joint and kind by the expected time, s.
HELD = {
    "phase": [{"name": "held", "joints": {"pins": "fixed"}}],
    "output": {"loads": ["pins"], "transverse": ["fore"]},
}
TWO_PHASES = {
    "phase": [
        {"name": "held", "joints": {"pins": "fixed"}, "until": {"time_s": 0.2}},
        {"name": "loose", "joints": {"pins": "cylindrical"}},
    ]
}
AT_01, LATE = {"time_s": 0.1}, {"time_s": 0.9}
KEYED = {"joint.pins.kind": {"keyed": {"translations": ["y", "z"], "rotations": ["x", "y", "z"]}}}
SLIDER, ROLLER = "release_to_slider_time_s", "release_to_cylindrical_time_s"
PARTIAL = {
    "at a time": (HELD, [cut("pins", AT_01, to="slider")], {SLIDER: 0.1}),
    "at the start": (HELD, [cut("pins", {"time_s": 0.0}, to="slider")], {SLIDER: 0.0}),
    "late": (
        HELD | {"joint.pins.delay_s": 0.05},
        [cut("pins", AT_01, to="slider")],
        {SLIDER: 0.15},
    ),
    "optional, and not at all": (
        HELD,
        [cut("pins", LATE, to="slider", optional=True)],
        {SLIDER: math.nan},
    ),
    "either of two": (
        HELD,
        [cut("pins", LATE, to="slider"), cut("pins", AT_01, "other", to="slider")],
        {SLIDER: 0.1},
    ),
    "to one kind, then to another": (
        HELD,
        [
            cut("pins", AT_01, to="slider"),
            cut("pins", {"time_s": 0.3}, "more", to="cylindrical"),
        ],
        {SLIDER: 0.1, ROLLER: 0.3},
    ),
    "to the looser kind first": (
        HELD,
        [
            cut("pins", {"time_s": 0.3}, to="slider"),
            cut("pins", AT_01, "more", to="cylindrical"),
        ],
        {SLIDER: 0.1, ROLLER: 0.1},
    ),
    "free before": (
        HELD,
        [cut("pins", LATE, to="slider"), cut("pins", AT_01, "go")],
        {SLIDER: 0.1, "release_time_s": 0.1},
    ),
    "by a phase before": (
        TWO_PHASES,
        [cut("pins", LATE, to="slider", optional=True)],
        {SLIDER: 0.2},
    ),
    "before the phase": (TWO_PHASES, [cut("pins", AT_01, to="slider")], {SLIDER: 0.1}),
    "to a kind of the file": (
        HELD | KEYED,
        [cut("pins", AT_01, to="keyed"), cut("pins", {"time_s": 0.2}, "o", to="slider")],
        {"release_to_keyed_time_s": 0.1, SLIDER: 0.1},
    ),
    "one of two redundant joints": (
        {
            "joint.again": AGAIN,
            "phase": [{"name": "held", "joints": {"pins": "fixed", "again": "spherical"}}],
        },
        [cut("again", AT_01, to="point-on-plane")],
        {"again_release_to_point_on_plane_time_s": 0.1},
    ),
    "to a kind with a hyphen": (
        HELD,
        [cut("pins", AT_01, to="point-on-line")],
        {"release_to_point_on_line_time_s": 0.1},
    ),
}


@pytest.mark.slow
@pytest.mark.parametrize("name", PARTIAL)
def test_partial_releases_as_the_independent_simulation(pair, name):
    """Every column of a single case, among them the expected times."""
    settings, releases, expected = PARTIAL[name]
    campaign = pair(TURNING | settings | {"release": releases})
    outcomes = agrees(campaign)
    times = partial_release_columns(campaign.layout.contents).values()
    assert list(times) == [column for column in expected if column != "release_time_s"]
    for column, time in expected.items():
        assert_allclose(outcomes[column], time, rtol=0, atol=1e-12)


@pytest.mark.slow
@pytest.mark.parametrize("name", ["late", "free before", "to the looser kind first"])
def test_partial_releases_of_rows(pair, plainly, name):
    """A kernel without a history writes the same times."""
    settings, releases, expected = PARTIAL[name]
    table = pair(TURNING | settings | {"release": releases}).run(cases=1).table
    for column, time in expected.items():
        assert_allclose(table[column], time, rtol=0, atol=1e-12)


def test_partial_release_of_one_of_several_joints(pair, plainly):
    """The column carries the name of the joint; releases to free have no further column."""
    settings = HELD | {"joint.again": AGAIN}
    settings["phase"] = [{"name": "held", "joints": {"pins": "fixed", "again": "spherical"}}]
    releases = [cut("pins", AT_01, to="slider"), cut("again", {"time_s": 0.05}, "other")]
    outcomes = agrees(pair(TURNING | settings | {"release": releases}))
    assert_allclose(outcomes["pins_release_to_slider_time_s"], 0.1, rtol=0, atol=1e-12)
    assert [name for name in outcomes if "_release_to_" in name] == [
        "pins_release_to_slider_time_s"
    ]


def test_phase_that_does_not_end_releases_nothing_in_part(pair):
    """A never-released case: what a later phase would have left counts for nothing."""
    phases = [
        {"name": "held", "joints": {"pins": "fixed"}, "until": {"joint": "pins", "force_N": 1e9}},
        {"name": "next", "joints": {"pins": "fixed"}, "until": {"time_s": 0.1}},
        {"name": "loose", "joints": {"pins": "cylindrical"}},
    ]
    release = cut("pins", LATE, to="slider", optional=True)
    campaign = pair(TURNING | {"phase": phases, "release": [release]})
    (status, outcomes), other = alone(campaign), independent.simulate(campaign.nominal().to_dict())
    assert status == other.status == "never-released"
    assert math.isnan(outcomes[SLIDER])
    assert math.isnan(other.outcomes[SLIDER])


def test_order_of_the_columns():
    """Ignition times, ends of strokes, partial releases, then transverse rates."""
    everything = Contents(
        ["one", "two"],
        {"lock": ("one", "two")},
        transverse=("one",),
        ignitions=("kick",),
        springs=("push",),
        partial_releases=(("lock", "point-on-line"),),
    )
    names = [column.name for column in outcome_columns(everything)]
    assert names[-4:] == [
        "kick_ignition_time_s",
        "push_stroke_end_time_s",
        "release_to_point_on_line_time_s",
        "one_transverse_rate_deg_s",
    ]
