"""Names of kernels: none comes from a file, so names of a file cannot collide, and none hides an
imported one."""

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
    """The tree of a scene with other names of its items."""
    text = repr(tree)
    for old, new in names.items():
        text = re.sub(rf"'{re.escape(old)}'", f"'{new}'", text)
        text = re.sub(rf"(?<=[.]){re.escape(old)}(?=[.'])", new, text)
    return ast.literal_eval(text)


@pytest.mark.parametrize("name", SCENES)
def test_no_name_of_a_file_is_in_a_kernel(name):
    """The text of a kernel does not depend on the names in the file."""
    campaign = scene(name)
    originals = [
        *campaign.scene.body,
        *campaign.scene.joint,
        *(m.name for m in campaign.scene.motor),
        *(p.name for p in campaign.scene.phase),
    ]
    names = dict(zip(dict.fromkeys(originals), HOSTILE, strict=False))
    other = Campaign(parse_campaign(_renamed(campaign.file.tree, names), name))
    assert set(other.scene.body) != set(campaign.scene.body)
    assert step_selection.kernel_text(other) == step_selection.kernel_text(campaign)


@pytest.mark.parametrize("name", SCENES)
def test_no_name_of_a_kernel_hides_another(name):
    """A function or variable named like an imported routine or a function would replace it."""
    module = ast.parse(step_selection.kernel_text(scene(name), history=True))
    imports = [node for node in module.body if isinstance(node, ast.Import | ast.ImportFrom)]
    imported = {alias.asname or alias.name for node in imports for alias in node.names}
    functions = {node.name for node in module.body if isinstance(node, ast.FunctionDef)}
    names = [node for node in ast.walk(module) if isinstance(node, ast.Name)]
    variables = {node.id for node in names if isinstance(node.ctx, ast.Store)}
    assert functions
    assert not imported & functions
    assert not variables & (imported | functions)


@pytest.mark.parametrize("name", ["if", "l", "w", "LANES", "spin_a"])
def test_a_body_may_be_called_anything(pair, name):
    tree = _renamed(pair().file.tree, {"fore": name})
    del tree["solver"]
    campaign = Campaign(parse_campaign(tree, "pair"))
    ast.parse(step_selection.kernel_text(campaign))
    assert keyword.iskeyword("if")
    assert f"body1 {name}" in make_kernel_spec(campaign.layout, campaign.dispersed).names.legend[0]


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
