"""A kernel's text is written once for a structure, whatever the values."""

import math

import msgspec
import pytest
from oracles.random_scenes.scenes import scene as random_scene

import sepmc
from sepmc.campaign.campaign import Campaign
from sepmc.campaign.execution.step_selection import kernel_text
from sepmc.engine import kernel_texts
from sepmc.kernel.emit.module import emit
from sepmc.kernel.spec.kernel_spec import KernelSpec
from sepmc.kernel.spec.parameter_layout import make_parameter_layout
from sepmc.kernel.spec.structure import make_kernel_spec
from sepmc.kernel.spec.variant import Variant
from sepmc.scene.read import parse_campaign

SHIPPED = (
    "hyper-x",
    "missile-rail",
    "nasa-fixed-joint",
    "residual-thrust",
    "spring-pushers",
    "srb",
    "table1",
    "table2",
)


def changed(node, change):
    """Copy of a scene with every value changed."""
    if isinstance(node, float):
        return change(node)
    if isinstance(node, msgspec.Struct):
        fields = {name: changed(getattr(node, name), change) for name in node.__struct_fields__}
        return msgspec.structs.replace(node, **fields)
    if isinstance(node, dict):
        return {name: changed(item, change) for name, item in node.items()}
    return type(node)(changed(x, change) for x in node) if isinstance(node, list | tuple) else node


def in_order(value):
    """Another value, which compares with all others and with 0, 1 and infinity as before."""
    return math.copysign(abs(value) ** 1.1, value) if math.isfinite(value) else value


def nearly(value):
    """A value that compares as before unless two of a scene are equal or nearly so."""
    return value if value in (0.0, 1.0, -1.0) or not math.isfinite(value) else 1.00001 * value


def spec_of(campaign, change, variant) -> KernelSpec:
    """Kernel specification of a campaign with every value changed."""
    layout = make_parameter_layout(changed(campaign.layout.scene, change), campaign.dispersed)
    return make_kernel_spec(layout, campaign.dispersed, variant)


@pytest.mark.parametrize("variant", list(Variant))
@pytest.mark.parametrize("name", [*SHIPPED, *range(4)])
def test_equal_structures_have_equal_texts(name, variant):
    if isinstance(name, str):
        campaign = sepmc.load(name)
    else:
        tree = random_scene(9000 + name)
        campaign = Campaign(parse_campaign(tree, "random"))
    layout = make_parameter_layout(campaign.layout.scene, campaign.dispersed)
    spec = make_kernel_spec(layout, campaign.dispersed, variant)
    structure, method = kernel_texts.structure_of(spec), campaign.scene.solver.method
    text, n_equal = emit(spec, method), 0
    for change in (in_order, nearly):
        other = spec_of(campaign, change, variant)
        if kernel_texts.structure_of(other) == structure:
            n_equal += 1
            assert emit(other, method) == text
    assert n_equal or name not in ("spring-pushers", "table2", "nasa-fixed-joint")


def test_text_is_not_written_again_for_another_value(monkeypatch):
    campaign = sepmc.load("spring-pushers")
    path = "spring.upper_right.force_N"
    text = kernel_text(campaign.with_settings({path: 901.0}))
    monkeypatch.setattr(kernel_texts, "_stored_or_emitted", None)  # no other text can be had
    for value in (902.0, 950.25):
        assert kernel_text(campaign.with_settings({path: value})) == text
    stiff = campaign.with_settings({"spring.upper_right.factor": 0.5})
    with pytest.raises(TypeError):  # a factor that is not 1 has a term in the force
        kernel_text(stiff)
