"""Names of a kernel: none comes from a file, so none of a file can meet another, and what things
are called changes nothing."""

import ast
import keyword
import re

import pytest
from small_scenes import SCENES, scene

import sepmc
from sepmc.campaign import pilot
from sepmc.campaign.campaign import Campaign
from sepmc.scene.read import parse_campaign

HOSTILE = [
    "a",
    "b",
    "A",
    "p",
    "q",
    "p_q",
    "l",
    "w",
    "x",
    "t",
    "spin_a",
    "Stage",
    "stage",
    "if",
    "lambda",
    "LANES",
    "vec3",
    "numbers",
]


def _body_of(text):
    """A kernel without its docstring, which says what stands for what."""
    return text.split('"""', 2)[2]


def _renamed(tree, names):
    """A scene in which each table's items are called otherwise, everywhere they are named."""
    text = repr(tree)
    for old, new in names.items():
        text = re.sub(rf"'{re.escape(old)}'", f"'{new}'", text)
        text = re.sub(rf"(?<=[.]){re.escape(old)}(?=[.'])", new, text)
    return ast.literal_eval(text)


@pytest.mark.parametrize("name", SCENES)
def test_what_things_are_called_changes_nothing(name):
    campaign = scene(name)
    own = [
        *campaign.scene.body,
        *campaign.scene.joint,
        *(m.name for m in campaign.scene.motor),
        *(p.name for p in campaign.scene.phase),
    ]
    called = dict(zip(dict.fromkeys(own), HOSTILE, strict=False))
    other = Campaign(parse_campaign(_renamed(campaign.file.tree, called), name))
    assert set(other.scene.body) != set(campaign.scene.body)
    assert _body_of(pilot.kernel_text(other)) == _body_of(pilot.kernel_text(campaign))


def test_no_name_of_a_file_stands_in_a_kernel():
    text = _body_of(pilot.kernel_text(sepmc.load("table2.toml")))
    words = {node.id for node in ast.walk(ast.parse(text)) if isinstance(node, ast.Name)}
    assert not any(
        part in ("upper", "lower", "pins", "retro", "locked", "guided")
        for word in words
        for part in word.lower().split("_")
    )


@pytest.mark.parametrize("name", ["if", "l", "w", "LANES", "spin_a"])
def test_a_body_may_be_called_anything(pair, name):
    tree = _renamed(pair().file.tree, {"fore": name})
    del tree["solver"]
    text = pilot.kernel_text(Campaign(parse_campaign(tree, "pair")))
    ast.parse(text)
    assert keyword.iskeyword("if")
    assert f"body1 {name}" in text
