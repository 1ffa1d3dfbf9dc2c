"""Mass properties of random bodies of MJCF and URDF, against MuJoCo's own reading."""

import numpy as np
import pytest
from numpy.testing import assert_allclose
from scipy.spatial.transform import Rotation

from sepmc.formats.mass import read_mass

SIZES = {"quat": 4, "euler": 3, "axisangle": 4, "xyaxes": 6, "zaxis": 3}


def text_of(values):
    return " ".join(repr(float(x)) for x in values)


def inertia_of(rng, form):
    """Attributes of a random inertial, and those of the compiler."""
    if form == "fullinertia":
        root = rng.standard_normal((3, 3))
        squares = root @ root.T
        tensor = np.trace(squares) * np.eye(3) - squares
        entries = [*np.diag(tensor), tensor[0, 1], tensor[0, 2], tensor[1, 2]]
        return f'fullinertia="{text_of(entries)}"', ""
    values, compiler = rng.uniform(-1.0, 1.0, SIZES[form]), ""
    if form == "euler":
        sequence = "".join(rng.permutation(list("xyz"))) if rng.random() < 0.7 else "zxz"
        sequence = sequence.upper() if rng.random() < 0.5 else sequence
        angle = "radian" if rng.random() < 0.5 else "degree"
        compiler = f'<compiler eulerseq="{sequence}" angle="{angle}"/>'
        values *= 1.0 if angle == "radian" else 90.0
    moments = text_of(rng.uniform(1.0, 2.0, 3))
    return f'diaginertia="{moments}" {form}="{text_of(values)}"', compiler


def mjcf(rng, form):
    inertia, compiler = inertia_of(rng, form)
    position = text_of(rng.uniform(-1.0, 1.0, 3))
    return (
        f'<mujoco>{compiler}<worldbody><body name="stage"><freejoint/>'
        f'<inertial pos="{position}" mass="3.5" {inertia}/></body></worldbody></mujoco>'
    )


def urdf(rng):
    root = rng.standard_normal((3, 3))
    squares = root @ root.T
    tensor = np.trace(squares) * np.eye(3) - squares
    pairs = {"ixx": (0, 0), "iyy": (1, 1), "izz": (2, 2), "ixy": (0, 1), "ixz": (0, 2),
             "iyz": (1, 2)}  # fmt: skip
    entries = " ".join(f'{name}="{float(tensor[at])!r}"' for name, at in pairs.items())
    xyz, rpy = text_of(rng.uniform(-1.0, 1.0, 3)), text_of(rng.uniform(-3.0, 3.0, 3))
    return (
        '<robot name="r"><link name="ground"/><link name="stage"><inertial>'
        f'<origin xyz="{xyz}" rpy="{rpy}"/><mass value="3.5"/><inertia {entries}/></inertial>'
        '</link><joint name="j" type="floating"><parent link="ground"/><child link="stage"/>'
        "</joint></robot>"
    )


@pytest.mark.parametrize("form", ["fullinertia", *SIZES, "urdf"])
def test_bodies_agree_with_mujoco(tmp_path, form):
    mujoco = pytest.importorskip("mujoco")
    rng = np.random.default_rng(len(form))
    for _ in range(20):
        text = urdf(rng) if form == "urdf" else mjcf(rng, form)
        (tmp_path / "m.xml").write_text(text)
        keys, _ = read_mass(tmp_path / "m.xml", {"axes": "forward-left-up", "link": "stage"})
        model = mujoco.MjModel.from_xml_string(text)
        body = model.body("stage").id
        turn = Rotation.from_quat(np.roll(model.body_iquat[body], -1)).as_matrix()
        tensor = turn @ np.diag(model.body_inertia[body]) @ turn.T
        assert_allclose(keys["inertia_tensor_kg_m2"], tensor, rtol=0.0, atol=1e-12 * tensor.max())
        x, y, z = model.body_ipos[body]
        assert_allclose(keys["cg_m"], [-x, z, -y], atol=1e-12)
        assert keys["mass_kg"] == model.body_mass[body]
