"""Tables [map] and [size] of a campaign file."""

import pytest
from support.sizing_problem import campaign as sizing_campaign

from sepmc.campaign.campaign import Campaign
from sepmc.campaign.sizing import with_requirements
from sepmc.scene.design_tables import MapAxis, Variable
from sepmc.scene.messages import SceneError
from sepmc.scene.read import parse_campaign

PUSH = "spring.*.force_N=1000:6000"
MAP = {"x": f"{PUSH}:5", "y": "body.fore.mass_kg=60:100:3", "cases": 40}
SIZE = {"minimise": "2 * push", "vary": {"push": PUSH}}
ITEMS = [
    {"name": "fast", "metric": "separation_speed_m_s", "at_least": 2.0, "probability": 0.95},
    {"name": "slow", "metric": "separation_speed_m_s", "at_most": 9.0, "probability": 0.95},
]


def file(**tables):
    """Two bodies and a spring, with some tables."""
    return parse_campaign(sizing_campaign(*ITEMS).file.tree | tables, "p.toml")


def test_the_tables_are_read_and_change_no_row():
    both = file(map=MAP, size=SIZE | {"subject_to": "all"})
    force = "spring.*.force_N"
    axes = (MapAxis(force, 1000.0, 6000.0, 5), MapAxis("body.fore.mass_kg", 60.0, 100.0, 3))
    assert (both.map.axes, both.map.cases, both.map.max_cases) == (axes, 40, None)
    assert both.size.variables == (Variable("push", force, 1000.0, 6000.0),)
    assert (both.size.minimise, both.size.subject_to) == (("2 * push",), ())
    assert Campaign(both).digest == Campaign(file()).digest
    assert parse_campaign({**both.tree, "name": "again"}, "p.toml").map == both.map


def test_other_requirements_can_be_chosen_than_those_of_the_file():
    campaign = Campaign(file(size=SIZE | {"subject_to": ["fast"]}))
    assert with_requirements(campaign, ()) is campaign
    chosen = with_requirements(campaign, ["slow"])
    assert [item.name for item in chosen.file.requirements] == ["slow"]


def test_a_scenario_has_none_of_them():
    """It may remove what they name."""
    gone = {"name": "gone", "set": {"requirement": []}}
    campaign = Campaign(file(scenario=[gone], size=SIZE | {"subject_to": ["fast"]}))
    assert campaign.scenarios()["gone"].file.size is None


@pytest.mark.parametrize(
    ("tables", "message"),
    [
        ({"map": MAP | {"x": "push=1:2"}}, r"map\.x = push=1:2: must be KEY=LOW:HIGH:COUNT"),
        ({"map": MAP | {"y": "body.fore.mas_kg=1:2:3"}}, r"map\.y: body\.fore\.mas_kg: "),
        ({"map": MAP | {"x": "sprung.*.force_N=1:2:3"}}, r"map\.x: sprung.*no table has such"),
        ({"map": MAP | {"cases": 0}}, r"map\.cases = 0: must be >= 1"),
        ({"map": MAP | {"max_cases": 20}}, r"map\.max_cases = 20: must be at least cases = 40"),
        ({"map": MAP | {"z": "a"}}, r"map\.z: unknown key"),
        ({"map": {"y": MAP["y"]}}, r"map: 'x' is missing"),
        ({"map": [MAP]}, r"map = .*: must be a table"),
        ({"size": SIZE | {"vary": {"push": "a=1"}}}, r"size\.vary\.push = push=a=1: must be NAME"),
        ({"size": SIZE | {"vary": {"push": "a.b_N=1:2"}}}, r"size\.vary\.push: a\.b_N: "),
        ({"size": SIZE | {"vary": {}}}, r"size\.vary: has 0 variables"),
        ({"size": SIZE | {"minimise": "pull"}}, r"size\.minimise = pull: no variable 'pull'"),
        ({"size": SIZE | {"minimise": ["push", "1 +"]}}, r"size\.minimise = 1 \+: is no formula"),
        ({"size": SIZE | {"minimise": []}}, r"size\.minimise = \[\]: must be a formula, or a list"),
        ({"size": SIZE | {"minimise": 3}}, r"size\.minimise = 3: must be"),
        ({"size": SIZE | {"subject_to": ["fas"]}}, r"subject_to = fas: no such requirement; did"),
        ({"size": SIZE | {"subject_to": "fast"}}, r"size\.subject_to = 'fast': must be a list"),
        ({"size": {"minimise": "push"}}, r"size: 'vary' is missing"),
    ],
)
def test_wrong_tables_are_refused_when_the_file_is_read(tables, message):
    with pytest.raises(SceneError, match=message):
        file(**tables)
