"""Reading of the mass properties of a body from files of URDF (a link), MJCF of MuJoCo (a body) and
JSBSim (the vehicle).

Inertias are read as a tensor about the centre of mass, in the axes of the file, from:

- URDF: entries of the tensor, in axes rotated by ``rpy`` of the inertial origin.
- MJCF: principal moments in axes rotated by the orientation of ``inertial``, or the entries of the
  tensor (``fullinertia``: 11, 22, 33, 12, 13, 23).
- JSBSim: structural axes aft, right, up; products are entries of the tensor, or with
  ``negated_crossproduct_inertia="false"`` positive integrals, whose signs are changed.
"""

from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from scipy.spatial.transform import Rotation

from sepmc.formats.text_table import FormatError, read_text
from sepmc.formats.xml_tree import Element, parse_xml
from sepmc.scene.brought_inertia import axes_matrix
from sepmc.scene.messages import Problems, nearest, shorten
from sepmc.scene.units import UNITS, is_number

_JSBSIM_AXES = "aft-right-up"
_ORIGIN = "origin_m"
# units of JSBSim, whose default stands first
_MASS = {"LBS": "lb", "KG": "kg", "SLUG": "slug"}
_LENGTH = {"IN": "in", "FT": "ft", "M": "m", "CM": "cm", "MM": "mm", "KM": "km"}
_INERTIA = {"SLUG*FT2": "slug_ft2", "KG*M2": "kg_m2"}


@dataclass
class MassProperties:
    """Mass properties of one body as a file has them, in the axes of the file.

    Attributes
    ----------
    mass : float
        kg.
    center : ndarray, shape (3,)
        Centre of mass relative to the origin of the file, m.
    tensor : ndarray, shape (3, 3)
        Inertia tensor about the centre of mass, kg m2.
    sentence : str
        Sentence on what was read, for the user.
    """

    mass: float
    center: np.ndarray
    tensor: np.ndarray
    sentence: str


def read_mass(path: Path, options: dict[str, Any]) -> tuple[dict[str, Any], list[str]]:
    """Read the mass properties of a body from a file.

    Parameters
    ----------
    path : Path
        URDF, MJCF or JSBSim, by the root element.
    options : dict
        ``link``: name of the link or body, needed if there are several. ``axes``: directions of the
        axes x, y and z of the file, such as "forward-left-up"; not needed for JSBSim. ``origin_m``:
        layout point of the origin of the file, as in ``cg_m``; [0, 0, 0] by default.

    Returns
    -------
    keys : dict
        Keys of ``[body.NAME]``: ``mass_kg``, ``cg_m``, ``inertia_tensor_kg_m2``, ``inertia_axes``.
    understood : list of str
        Sentences on what was read, for the user.

    Raises
    ------
    FormatError
        With the reason why the file is rejected.
    """
    text = read_text(path)
    if not text.lstrip().startswith("<"):
        raise FormatError(
            "is no URDF, MJCF or JSBSim, which are XML; write numbers of a data sheet as keys of "
            "the body: mass_kg, cg_m, inertia_tensor_kg_m2, inertia_axes"
        )
    root = parse_xml(text)
    readers: dict[str, Callable[[Element, Any], MassProperties]] = {
        "robot": _urdf,
        "mujoco": _mjcf,
        "fdm_config": _jsbsim,
    }
    if root.tag not in readers:
        raise FormatError(
            f"line {root.line}: the root is {shorten(root.tag)}; must be robot (URDF), mujoco "
            "(MJCF) or fdm_config (JSBSim)"
        )
    properties = readers[root.tag](root, options.get("link"))
    axes = options.get("axes", _JSBSIM_AXES if root.tag == "fdm_config" else None)
    problems = Problems()
    matrix = axes_matrix("axes", axes, problems)
    if matrix is None:
        raise FormatError(problems[0])
    origin = _origin(options.get(_ORIGIN, [0.0, 0.0, 0.0]))
    center = matrix.T @ properties.center
    if not properties.mass > 0.0:
        raise FormatError(f"has a mass of {properties.mass:g} kg: must be > 0")
    keys = {
        "mass_kg": properties.mass,
        # stations are positive aft of the nose, x of the body is forward
        "cg_m": [
            float(x) + 0.0
            for x in (origin[0] - center[0], origin[1] + center[1], origin[2] + center[2])
        ],
        "inertia_tensor_kg_m2": properties.tensor.tolist(),
        "inertia_axes": axes,
    }
    where = ", ".join(f"{x:g}" for x in origin)
    return keys, [
        properties.sentence,
        f"axes {axes}; the origin of the file at {_ORIGIN} = [{where}]",
    ]


def _origin(value: Any) -> list[float]:
    if not isinstance(value, list) or len(value) != 3 or not all(map(is_number, value)):
        raise FormatError(f"{_ORIGIN} = {shorten(value)}: must be three numbers, as cg_m")
    return [float(x) for x in value]


def _choose(elements: list[Element], name: Any, what: str) -> Element:
    """Return the element whose attribute ``name`` is ``name``, or the only element if that is None;
    ``what`` is the noun of messages. Raises FormatError if there is no such element, or there are
    several and ``name`` is None."""
    names = [each.attributes.get("name", "") for each in elements]
    if not elements:
        raise FormatError(f"has no {what} with mass properties")
    if name is None and len(elements) > 1:
        some = ", ".join(names[:12]) + (", ..." if len(names) > 12 else "")
        raise FormatError(
            f'has {len(elements)} elements <{what}>; choose one by link = "NAME": {some}'
        )
    if name is None:
        return elements[0]
    if name not in names:
        raise FormatError(f"has no {what} {shorten(name)}; {nearest(str(name), names)}")
    return elements[names.index(name)]


def _child(element: Element, tag: str) -> Element:
    child = element.child(tag)
    if child is None:
        raise FormatError(f"line {element.line}: {element.tag} has no {tag}")
    return child


def _attribute(element: Element, name: str, count: int, default: str | None = None) -> list[float]:
    text = element.attributes.get(name, default)
    if text is None:
        raise FormatError(f"line {element.line}: {element.tag} has no {name}")
    return element.numbers(text, name, count)


def _tensor(moments: list[float], products: list[float]) -> np.ndarray:
    """Symmetric matrix (3, 3) with the diagonal entries ``moments`` and the entries 12, 13, 23
    ``products``, without a change of sign."""
    tensor = np.diag(moments)
    for (i, j), value in zip(((0, 1), (0, 2), (1, 2)), products, strict=True):
        tensor[i, j] = tensor[j, i] = value
    return tensor


def _urdf(root: Element, name: Any) -> MassProperties:
    links = [each for each in root.children if each.tag == "link" and each.child("inertial")]
    link = _choose(links, name, "link")
    inertial = _child(link, "inertial")
    origin, inertia = inertial.child("origin"), _child(inertial, "inertia")
    center, angles = np.zeros(3), [0.0, 0.0, 0.0]
    if origin is not None:
        center = np.array(_attribute(origin, "xyz", 3, "0 0 0"))
        angles = _attribute(origin, "rpy", 3, "0 0 0")
    moments = [_attribute(inertia, key, 1)[0] for key in ("ixx", "iyy", "izz")]
    products = [_attribute(inertia, key, 1, "0")[0] for key in ("ixy", "ixz", "iyz")]
    turn = Rotation.from_euler("xyz", angles).as_matrix()  # fixed axes, roll first
    sentence = f"link {link.attributes.get('name', '')} of URDF: ixy, ixz, iyz are tensor entries"
    if any(angles):
        sentence += ", turned by the rpy of their origin"
    tensor = turn @ _tensor(moments, products) @ turn.T
    return MassProperties(_attribute(_child(inertial, "mass"), "value", 1)[0], center, tensor,
                          sentence)  # fmt: skip


# keys of MuJoCo's compiler that change inertia by the whole model, and their values that do not
_WHOLE_MODEL = (
    ("inertiafromgeom", ("auto", "false")),
    ("settotalmass", ("-1", "0")),
    ("boundmass", ("0",)),
    ("boundinertia", ("0",)),
    ("balanceinertia", ("false",)),
    ("coordinate", ("local",)),
)


def _mjcf(root: Element, name: Any) -> MassProperties:
    compiler: dict[str, str] = {}
    for each in root.children:
        compiler |= each.attributes if each.tag == "compiler" else {}
    for key, plain in _WHOLE_MODEL:
        if compiler.get(key, plain[0]) not in plain:
            raise FormatError(
                f"has {key} in its element <compiler>: inertia then follows from the whole model, "
                "which is not read"
            )
    bodies = [body for body in root.all("body") if body.child("inertial")]
    if name is not None and any(
        body.attributes.get("name") == name and body.child("inertial") is None
        for body in root.all("body")
    ):
        raise FormatError(
            f"body {shorten(name)} has no inertial: its inertia follows from its geoms; write it "
            "out by MuJoCo first (saveinertial)"
        )
    body = _choose(bodies, name, "body")
    inertial = _child(body, "inertial")
    mass = _attribute(inertial, "mass", 1)[0]
    center = np.array(_attribute(inertial, "pos", 3))
    called = body.attributes.get("name", "")
    if "fullinertia" in inertial.attributes:
        entries = _attribute(inertial, "fullinertia", 6)
        sentence = f"body {called} of MJCF: fullinertia are tensor entries 11, 22, 33, 12, 13, 23"
        return MassProperties(mass, center, _tensor(entries[:3], entries[3:]), sentence)
    moments = _attribute(inertial, "diaginertia", 3)
    turn = _orientation(inertial, compiler, next(root.all("include"), None))
    sentence = f"body {called} of MJCF: moments about its principal axes"
    return MassProperties(mass, center, turn @ np.diag(moments) @ turn.T, sentence)


def _orientation(
    inertial: Element, compiler: dict[str, str], include: Element | None
) -> np.ndarray:
    """Rotation matrix (3, 3) that takes components in the axes of MJCF's element ``inertial`` to
    those in the axes of its body.

    The orientation is one of ``quat``, ``euler``, ``axisangle``, ``xyaxes`` and ``zaxis``; without
    any the matrix is the identity. ``compiler`` has the attributes of MJCF's element ``compiler``:
    unit of angles and sequence of Euler angles. Raises FormatError for several orientations or one
    that is not valid, and for ``euler`` and ``axisangle`` if there is an element ``include``, whose
    file may change this unit and this sequence.
    """
    known = [k for k in ("quat", "euler", "axisangle", "xyaxes", "zaxis")
             if k in inertial.attributes]  # fmt: skip
    if not known:
        return np.eye(3)
    if len(known) > 1:
        raise FormatError(
            f"line {inertial.line}: inertial has {known[0]} and {known[1]}: must have only one"
        )
    kind = known[0]
    if include is not None and kind in ("euler", "axisangle"):
        raise FormatError(
            f"line {include.line}: an included file may say how {kind} is meant; write the model "
            "out by MuJoCo first"
        )
    is_degree = compiler.get("angle", "degree") == "degree"
    counts = {"quat": 4, "euler": 3, "axisangle": 4, "xyaxes": 6, "zaxis": 3}
    values = np.array(_attribute(inertial, kind, counts[kind]))
    axes = [values] if kind in ("quat", "zaxis") else [values[:3]]
    axes += [np.cross(values[:3], values[3:])] if kind == "xyaxes" else []
    if kind != "euler" and any(np.linalg.norm(axis) < 1e-9 for axis in axes):
        raise FormatError(
            f"line {inertial.line}: {kind} = {values.tolist()} gives no attitude: it must not be "
            "zero, nor its axes parallel"
        )
    if kind == "quat":
        return Rotation.from_quat(np.roll(values, -1)).as_matrix()
    if kind == "euler":
        sequence = compiler.get("eulerseq", "xyz")
        is_moving = sequence == sequence.lower()
        if (
            len(sequence) != 3
            or set(sequence.lower()) - set("xyz")
            or not (is_moving or sequence == sequence.upper())
        ):
            raise FormatError(
                f"eulerseq = {shorten(sequence)}: must be three letters "
                "of x, y, z, all small (moving axes) or all capital (fixed axes), such as xyz"
            )
        letters = sequence.upper() if is_moving else sequence.lower()  # scipy: capitals move
        if letters[0] == letters[1] or letters[1] == letters[2]:
            raise FormatError(
                f"eulerseq = {shorten(sequence)}: must not turn about one axis twice in a row"
            )
        return Rotation.from_euler(letters, values, degrees=is_degree).as_matrix()
    if kind == "axisangle":
        angle = np.radians(values[3]) if is_degree else values[3]
        return Rotation.from_rotvec(angle * values[:3] / np.linalg.norm(values[:3])).as_matrix()
    if kind == "xyaxes":
        x = values[:3] / np.linalg.norm(values[:3])
        y = values[3:] - x * (x @ values[3:])
        y /= np.linalg.norm(y)
        return np.column_stack([x, y, np.cross(x, y)])
    z = values / np.linalg.norm(values)
    axis, sine = np.cross([0.0, 0.0, 1.0], z), float(np.hypot(z[0], z[1]))
    angle = np.arctan2(sine, z[2])
    axis = axis / sine if sine > 1e-12 else np.array([1.0, 0.0, 0.0])
    return Rotation.from_rotvec(angle * axis).as_matrix()


def _jsbsim(root: Element, name: Any) -> MassProperties:
    if name is not None:
        raise FormatError("is a file of JSBSim, which has one vehicle: leave link out")
    balance = _child(root, "mass_balance")
    mass = _measured(_child(balance, "emptywt"), "mass", _MASS)
    moments, products = (
        [_inertia(balance, key, key in ("ixx", "iyy", "izz")) for key in keys]
        for keys in (("ixx", "iyy", "izz"), ("ixy", "ixz", "iyz"))
    )
    sign, how = 1.0, "tensor entries"
    if balance.attributes.get("negated_crossproduct_inertia", "true") == "false":
        sign, how = -1.0, "positive integrals, signs turned"
    location = next(
        (each for each in balance.children
         if each.tag == "location" and each.attributes.get("name") == "CG"), None
    )  # fmt: skip
    if location is None:
        raise FormatError(f"line {balance.line}: mass_balance has no location of CG")
    length = _unit(location, "length", _LENGTH)
    center = np.array(
        [length * _child(location, axis).numbers(_child(location, axis).text, axis, 1)[0]
         for axis in "xyz"]
    )  # fmt: skip
    points = sum(each.tag == "pointmass" for each in balance.children)
    sentence = f"empty vehicle of JSBSim: ixy, ixz, iyz are {how}"
    sentence += f"; {points} point masses are left out" if points else ""
    sentence += "; tanks are left out" if next(root.all("tank"), None) else ""
    return MassProperties(mass, center, _tensor(moments, [sign * x for x in products]), sentence)


def _inertia(balance: Element, tag: str, is_required: bool) -> float:
    element = balance.child(tag)
    if element is None and not is_required:
        return 0.0
    return _measured(_child(balance, tag), "inertia", _INERTIA)


def _measured(element: Element, kind: str, units: dict[str, str]) -> float:
    """Number in the text of an element, converted to SI. ``units`` maps the spellings of units in
    the file, the default first, to unit suffixes of the quantity ``kind`` (`_unit`). Raises
    FormatError for another unit, or if the text is not one number."""
    return _unit(element, kind, units) * element.numbers(element.text, element.tag, 1)[0]


def _unit(element: Element, kind: str, units: dict[str, str]) -> float:
    """Factor to SI of the unit of an element. ``units`` maps its spellings in upper case (the file
    may have any case), the first of which is the default, to unit suffixes of the quantity
    ``kind``. Raises FormatError for others."""
    unit = element.attributes.get("unit", next(iter(units))).upper()
    if unit not in units:
        raise FormatError(
            f"line {element.line}: {element.tag} is in {shorten(unit)}; must be in "
            f"{', '.join(units)}"
        )
    return UNITS[kind][units[unit]]
