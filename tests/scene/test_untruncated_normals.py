"""An untruncated normal distribution has the checks of its parameter, as any other has."""

import pytest
from small_scenes import SPRUNG

from sepmc.scene.messages import SceneError
from sepmc.scene.read import parse_campaign, read_text

GUIDED = """
[joint.pins.guide]
pins = 3
circle_m = 0.4
engaged_m = 0.1
"""
POINTS = """
[[body.fore.outline]]
points_m = [[1.0, 0.1, 0.0], [1.2, 0.1, 0.1]]
"""


@pytest.mark.parametrize("law", [{"normal": 0.1}, {"normal": 0.1, "truncate_sigma": 3}])
@pytest.mark.parametrize(
    ("more", "key", "message"),
    [
        ("", "joint.pins.fails", "must be discrete"),
        (GUIDED, "joint.pins.guide.friction", "nominal is > 0"),
        (POINTS, "body.fore.outline.0.offset_m.z", "belongs to a frustum's axis"),
    ],
)
def test_parameters_that_cannot_vary_are_refused(law, more, key, message):
    tree = read_text(f"{SPRUNG}{more}".encode(), "scene")
    tree["dispersion"] = {key: law}
    with pytest.raises(SceneError, match=message):
        parse_campaign(tree, "scene")
