"""Clearances of sectors of frustums, against the independent simulation and by hand."""

import math
import tomllib
from pathlib import Path

import pytest
from oracles import independent

from sepmc.campaign.campaign import Campaign
from sepmc.scene.messages import SceneError
from sepmc.scene.read import parse_campaign

NOZZLE = tomllib.loads((Path(__file__).parents[1] / "data" / "nozzle.toml").read_text())
HALF = {"name": "half", "stations_m": [7.0, 9.3], "radii_m": [0.8, 0.8], "sector_deg": [0, 180]}
FIN = {"name": "fin", "stations_m": [8.5, 9.0], "radii_m": [0.1, 0.1], "offset_m": [0.5, 1.6]}


def campaign(wall=HALF, solids=(), flipped=False, **more):
    """The nozzle scene, with a sector and further solids instead of the interstage."""
    bodies = {name: dict(body) for name, body in NOZZLE["body"].items()}
    bodies["lower"]["outline"] = [*solids[:1], wall, *solids[1:]]
    clearance = dict(NOZZLE["clearance"][0])
    if flipped:
        clearance["bodies"] = clearance["bodies"][::-1]
    tree = NOZZLE | {"body": bodies, "clearance": [clearance]} | more
    return Campaign(parse_campaign(tree, "nozzle.toml"))


def gaps(outcomes):
    """Outcomes of the clearance."""
    return {name: value for name, value in outcomes.items() if name.startswith("gap_")}


def simulated(case_campaign):
    case = case_campaign.nominal()
    return gaps(case_campaign.simulate(case, step_s=0.5).attrs["outcomes"])


@pytest.mark.slow
def test_a_sector_against_the_independent_simulation():
    scene = campaign()
    expected = independent.simulate(scene.nominal().to_dict()).outcomes
    result = simulated(scene)
    assert result["gap_clearance_mm"] == pytest.approx(expected["gap_clearance_mm"], abs=1e-6)
    assert 1.0 < result["gap_clearance_mm"] < 100.0
    time = expected["gap_clearance_time_s"]
    assert result["gap_clearance_time_s"] == pytest.approx(time, abs=1e-5)


@pytest.mark.slow
def test_a_sector_on_the_first_body_and_solids_beside_it():
    """The nearest point is that of the first body: on the sector there."""
    one, other = simulated(campaign()), simulated(campaign(solids=[FIN], flipped=True))
    assert one["gap_clearance_mm"] == pytest.approx(other["gap_clearance_mm"], abs=1e-9)
    aside = (other[f"gap_clearance_{axis}_m"] for axis in "yz")
    assert sum(x * x for x in aside) ** 0.5 == pytest.approx(0.8, abs=1e-9)


def test_angles_grow_from_the_right_down():
    """The sector around the crown is above the nozzle, 0.8 - 0.74 m away at the start; the one
    below as well, and the nozzle rim is at station 8.8."""
    for angles, up in (((180, 360), 1.0), ((0, 180), -1.0)):
        wall = HALF | {"sector_deg": list(angles), "radii_m": [0.75, 0.75]}
        narrow = wall | {"sector_deg": [angles[0] + 89, angles[1] - 89]}
        scene = campaign(narrow, flipped=True, run={"end_time_s": 0.12, "cases": 1})
        result = simulated(scene)
        assert result["gap_clearance_mm"] == pytest.approx(10.0, abs=0.5)
        assert result["gap_clearance_y_m"] * up > 0.7


@pytest.mark.slow
def test_sectors_vary():
    """Rows of dispersed angles and radii are those of campaigns with these settings."""
    varied = campaign(
        dispersion={
            "body.lower.outline.half.radii_m.0": {"discrete": [0.8, 0.81]},
            "body.lower.outline.half.sector_deg.1": {"discrete": [60, 180]},
        },
        run={"end_time_s": 3.0, "cases": 12, "seed": 1},
    )
    rows = varied.run().to_pandas()
    radius = rows["in_body_lower_outline_half_radii_0_m"]
    angle = rows["in_body_lower_outline_half_sector_1_deg"]
    for r, a in ((0.8, 60), (0.8, 180), (0.81, 180)):
        case = varied.with_settings(
            {"body.lower.outline.half.radii_m.0": r, "body.lower.outline.half.sector_deg.1": a}
        )
        chosen = rows.loc[(radius == r) & (angle == a), "gap_clearance_mm"]
        assert len(chosen)
        expected = simulated(case)["gap_clearance_mm"]
        assert chosen.to_numpy() == pytest.approx(expected, abs=1e-6)


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"sector_deg": [0, 0]}, r"outline\.half\.sector_deg = \[0.0, 0.0\]: must be two angles"),
        ({"sector_deg": [0, 361]}, r"sector_deg = \[0.0, 361.0\]: must be two angles"),
        ({"sector_deg": [180, 0]}, r"sector_deg = \[180.0, 0.0\]: must be two angles"),
        ({"sector_deg": [0]}, r"outline\.half\.sector_deg"),
        ({"hollow": True}, r"outline\.half\.hollow: leave it out: a sector is already a thin wall"),
        ({"stations_m": [7.0, 7.0]}, r"sector_deg: only a frustum of some length has a sector"),
    ],
)
def test_wrong_sectors_are_refused(change, message):
    with pytest.raises(SceneError, match=message):
        campaign(HALF | change)


def passing(sector_deg, point=(4.0, 0.0, 0.0)):
    """A point of a body that leaves upwards at a constant speed through the wall of another."""
    ball = {"mass_kg": 10.0, "inertia_kg_m2": [2.0, 2.0, 2.0]}
    tube = {"stations_m": [3.0, 5.0], "radii_m": [0.5, 0.5], "sector_deg": sector_deg}
    tree = {
        "name": "passing",
        "environment": {"atmosphere": "none", "gravity": "none"},
        "body": {
            "one": ball | {"cg_m": [1.0, 0.0, 0.0], "outline": [tube]},
            "two": ball | {"cg_m": [4.0, 0.0, 0.0], "outline": [{"points_m": [list(point)]}]},
        },
        "joint": {
            "pin": {
                "bodies": ["one", "two"], "point_m": [2.0, 0.0, 0.0], "omega_deg_s": [0, 0, -30],
            }
        },
        "phase": [{"name": "free"}],
        "clearance": [{"name": "gap", "bodies": ["one", "two"]}],
        "initial": {"altitude_km": 100.0, "speed_m_s": 0.0},
        "run": {"end_time_s": 2.0, "cases": 1},
        "solver": {"step_s": 1.0},
    }  # fmt: skip
    return Campaign(parse_campaign(tree, "passing.toml"))


def test_a_point_that_passes_a_wall_within_a_step_meets_it():
    """Body x points forward and the second body is aft of the joint: turning down at the nose, it
    moves up. Through the upper half of the tube, or out of the open side of the lower one."""
    speed = math.radians(30.0) * 2.0
    result = simulated(passing([180, 360]))
    assert (result["gap_clearance_mm"], result["gap_recontact"]) == (0.0, 1.0)
    assert result["gap_clearance_time_s"] == pytest.approx(0.5 / speed, abs=1e-9)
    result = simulated(passing([0, 180]))
    assert result["gap_clearance_mm"] == pytest.approx(500.0, abs=1e-9)
    assert (result["gap_clearance_time_s"], result["gap_recontact"]) == (0.0, 0.0)


def test_walls_alone_have_no_clearance():
    bodies = NOZZLE["body"] | {
        name: dict(NOZZLE["body"][name]) | {"outline": [HALF]} for name in ("upper", "lower")
    }
    with pytest.raises(SceneError, match=r"clearance\.gap\.bodies: have shells only"):
        parse_campaign(NOZZLE | {"body": bodies}, "nozzle.toml")


def test_a_sector_that_may_have_no_width_is_refused():
    with pytest.raises(SceneError, match=r"half\.sector_deg.*the sector may have no width"):
        campaign(dispersion={"body.lower.outline.half.sector_deg.1": {"uniform": [-1, 90]}})
