"""Names of a kernel: none comes from a file, so none of a file can meet another, and what things
are called changes nothing."""

import ast
import builtins
import importlib
import keyword
import re
import types

import pytest
from small_scenes import SCENES, scene

from sepmc.campaign.campaign import Campaign
from sepmc.campaign.execution import step_selection
from sepmc.kernel.spec.structure import make_kernel_spec
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


def _renamed(tree, names):
    """A scene in which each table's items are called otherwise, everywhere they are named."""
    text = repr(tree)
    for old, new in names.items():
        text = re.sub(rf"'{re.escape(old)}'", f"'{new}'", text)
        text = re.sub(rf"(?<=[.]){re.escape(old)}(?=[.'])", new, text)
    return ast.literal_eval(text)


@pytest.mark.parametrize("name", SCENES)
def test_no_name_of_a_file_stands_in_a_kernel(name):
    """What things are called changes nothing of its text."""
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
    assert step_selection.kernel_text(other) == step_selection.kernel_text(campaign)


@pytest.mark.parametrize("name", ["if", "l", "w", "LANES", "spin_a"])
def test_a_body_may_be_called_anything(pair, name):
    tree = _renamed(pair().file.tree, {"fore": name})
    del tree["solver"]
    campaign = Campaign(parse_campaign(tree, "pair"))
    ast.parse(step_selection.kernel_text(campaign))
    assert keyword.iskeyword("if")
    assert f"body1 {name}" in make_kernel_spec(campaign.plan, campaign.dispersed).names.legend[0]


@pytest.mark.parametrize("name", SCENES)
def test_no_function_of_a_kernel_shadows_an_import(name):
    """A function of a kernel that shadows a routine would call itself in its place."""
    body = ast.parse(step_selection.kernel_text(scene(name), history=True)).body
    imported = {
        alias.asname or alias.name
        for node in body
        if isinstance(node, ast.Import | ast.ImportFrom)
        for alias in node.names
    }
    defined = {node.name for node in body if isinstance(node, ast.FunctionDef)}
    assert defined
    assert not defined & imported


@pytest.mark.parametrize("name", SCENES)
def test_every_name_of_a_kernel_is_defined(name):
    """Functions of a kernel are compiled when they are called: a missing name would wait till
    then."""
    tree = ast.parse(step_selection.kernel_text(scene(name), history=True))
    namespace = set(dir(builtins))
    modules = {}
    for node in ast.walk(tree):
        if isinstance(node, ast.ImportFrom):
            for alias in node.names:
                value = getattr(importlib.import_module(node.module), alias.name, None)
                try:
                    value = importlib.import_module(f"{node.module}.{alias.name}")
                except ModuleNotFoundError:
                    assert value is not None, alias.name
                modules[alias.name] = value
            namespace |= {alias.name for alias in node.names}
        elif isinstance(node, ast.Import):
            namespace |= {alias.asname or alias.name for alias in node.names}
        elif isinstance(node, ast.FunctionDef):
            namespace |= {node.name, *(argument.arg for argument in node.args.args)}
        elif isinstance(node, ast.Name) and isinstance(node.ctx, ast.Store):
            namespace.add(node.id)
    names = [node for node in ast.walk(tree) if isinstance(node, ast.Name)]
    assert {node.id for node in names} <= namespace
    for node in ast.walk(tree):
        if isinstance(node, ast.Attribute) and isinstance(node.value, ast.Name):
            module = modules.get(node.value.id)
            assert not isinstance(module, types.ModuleType) or hasattr(module, node.attr), node.attr
