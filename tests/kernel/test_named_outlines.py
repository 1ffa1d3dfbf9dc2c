"""Clearances between named parts of outlines."""

import tomllib
from pathlib import Path

import pytest
from oracles import independent

import sepmc
from sepmc.campaign.campaign import Campaign
from sepmc.scene.messages import SceneError
from sepmc.scene.read import parse_campaign

NOZZLE = tomllib.loads((Path(__file__).parents[1] / "data" / "nozzle.toml").read_text())
# A skirt flush with a ring: as near as 5 mm all the time while the nozzle leaves the interstage.
SKIRT = {"name": "skirt", "stations_m": [6.9, 7.0], "radii_m": [0.795, 0.795]}
RING = {"name": "ring", "stations_m": [6.95, 7.05], "radii_m": [0.8, 0.8], "hollow": True}


def tree(upper=(), lower=(), outlines=None, **more):
    """Tree of the nozzle with further parts, before and after it in its outline."""
    bodies = {name: dict(body) for name, body in NOZZLE["body"].items()}
    nozzle, wall = bodies["upper"]["outline"], bodies["lower"]["outline"]
    bodies["upper"]["outline"] = [*upper, *({**part, "name": "nozzle"} for part in nozzle), *upper]
    bodies["upper"]["outline"][len(upper) + 1 :] = [
        {**part, "name": f"{part['name']}_2"} for part in upper
    ]
    bodies["lower"]["outline"] = [*lower, *({**part, "name": "wall"} for part in wall)]
    clearance = NOZZLE["clearance"][0] | ({"outlines": outlines} if outlines else {})
    return NOZZLE | {"body": bodies, "clearance": [clearance]} | more


def campaign(*arguments, **more):
    return Campaign(parse_campaign(tree(*arguments, **more), "nozzle.toml"))


def outcomes(case_campaign):
    case = case_campaign.nominal()
    return {
        name: value
        for name, value in case_campaign.simulate(case, step_s=0.5).attrs["outcomes"].items()
        if name.startswith("gap_")
    }


@pytest.mark.slow
def test_a_clearance_of_named_parts_is_that_of_these_parts_alone():
    alone = outcomes(campaign())
    everything = outcomes(campaign([SKIRT], [RING]))
    named = outcomes(campaign([SKIRT], [RING], [["nozzle"], ["wall"]]))
    assert everything["gap_clearance_mm"] <= 5.0 + 1e-9
    assert alone["gap_clearance_mm"] > 20.0
    assert named == alone


@pytest.mark.slow
def test_parts_that_are_no_neighbours_are_searched_together():
    """The skirts stand before and after the nozzle in the outline."""
    both = campaign([SKIRT], [RING], [["skirt", "skirt_2"], []])
    expected = independent.simulate(both.nominal().to_dict()).outcomes
    result = outcomes(both)
    assert result["gap_clearance_mm"] == pytest.approx(expected["gap_clearance_mm"], abs=1e-6)
    assert result == outcomes(campaign([SKIRT], [RING]))  # the nozzle is further away


@pytest.mark.slow
def test_named_parts_vary_by_their_names():
    """A dispersed radius of a named part moves the clearance of a row by as much."""
    varied = campaign(
        [SKIRT],
        [RING],
        [["nozzle"], ["wall"]],
        dispersion={"body.lower.outline.wall.radii_m.0": {"discrete": [0.8, 0.81]}},
        run={"end_time_s": 3.0, "cases": 8, "seed": 1},
    )
    rows = varied.run().to_pandas()
    radius = rows["in_body_lower_outline_wall_radii_0_m"]
    assert sorted(set(radius)) == [0.8, 0.81]
    for value in (0.8, 0.81):
        case = varied.with_settings({"body.lower.outline.wall.radii_m.0": value})
        expected = outcomes(case)["gap_clearance_mm"]
        chosen = rows.loc[radius == value, "gap_clearance_mm"]
        assert chosen.to_numpy() == pytest.approx(expected, abs=1e-6)


@pytest.mark.parametrize(
    ("outlines", "message"),
    [
        ([["nozle"], []], r"clearance\.gap\.outlines\.0 = 'nozle': no such part of the outline of"),
        ([["nozzle", "nozzle"], []], r"clearance\.gap\.outlines\.0 .*names a part twice"),
        ([["nozzle"]], r"clearance\.gap\.outlines"),
        ([["0"], []], r"clearance\.gap\.outlines\.0 = '0'"),
        ("nozzle", r"clearance\.gap\.outlines"),
    ],
)
def test_wrong_names_are_refused(outlines, message):
    with pytest.raises(SceneError, match=message):
        campaign([SKIRT], [RING], outlines)


def test_named_shells_alone_have_no_clearance():
    shell = {"name": "inner", "stations_m": [7.2, 8.8], "radii_m": [0.5, 0.5], "hollow": True}
    with pytest.raises(SceneError, match=r"clearance\.gap\.outlines: have shells only"):
        campaign([shell], [], [["inner"], ["wall"]])
    assert isinstance(campaign([shell], [], [["nozzle"], ["wall"]]), sepmc.Campaign)


def test_two_parts_with_one_name_are_refused():
    with pytest.raises(SceneError, match=r"body\.upper\.outline\.nozzle: the name is used twice"):
        campaign([{**SKIRT, "name": "nozzle"}], [])
