"""Conversion of inertias in other conventions: tensors, and axes other than forward, up, right."""

from typing import Any

import numpy as np

from sepmc.scene.messages import Problems
from sepmc.scene.units import UNITS, are_numbers, split_unit

# unit vectors of named directions in body axes: x forward, y up, z right
DIRECTIONS = {
    "forward": (0, 1.0),
    "aft": (0, -1.0),
    "up": (1, 1.0),
    "down": (1, -1.0),
    "right": (2, 1.0),
    "left": (2, -1.0),
}
_OURS = "forward-up-right"
_PAIRS = ((0, 1), (0, 2), (1, 2))
_SYMMETRIC = 1e-6  # of the largest magnitude of an entry: larger differences are no round-off


def convert_inertia(key_path: str, body: dict[str, Any], problems: Problems) -> list[str]:
    """Replace ``inertia_tensor_*`` and ``inertia_axes`` of a body, in place, by moments
    ``inertia_*`` and products ``inertia_products_*`` (positive integrals) in body axes: x forward,
    y up, z right.

    Parameters
    ----------
    key_path : str
        TOML path of the body.
    body : dict
        Table of the body, changed in place.
    problems : Problems
        Receives every problem.

    Returns
    -------
    list of str
        A sentence for each conversion.
    """
    understood: list[str] = []
    key = next((key for key in body if split_unit(key)[0] == "inertia_tensor"), None)
    axes = body.get("inertia_axes")
    if key is None and axes is None:
        return understood
    unit = split_unit(key)[1] if key else ""
    if key is not None:
        if unit not in UNITS["inertia"]:
            allowed = ", ".join(f"inertia_tensor_{each}" for each in UNITS["inertia"])
            reason = f"the unit is missing or is no unit of inertia; allowed: {allowed}"
            problems.add(f"{key_path}.{key}", reason)
            return understood
        tensor = _tensor(f"{key_path}.{key}", body[key], problems)
        others = [other for other in body if split_unit(other)[0] in _MOMENTS]
        if others:
            problems.add(f"{key_path}.{others[0]}", f"is given by {key} too: give one of them")
        if tensor is None or others:
            return understood
        del body[key]
    else:
        moments = _moments(body)
        if moments is None:
            reason = "needs the inertia that it belongs to: three numbers, or an inertia_tensor"
            problems.add(f"{key_path}.inertia_axes", reason, axes)
            return understood
        tensor, unit = moments
    if axes is not None:
        del body["inertia_axes"]
        matrix = axes_matrix(f"{key_path}.inertia_axes", axes, problems)
        if matrix is None:
            return understood
        tensor = matrix.T @ tensor @ matrix + 0.0
        if axes != _OURS:
            understood.append(f"{key_path}: inertia in axes {axes}, {_map(str(axes))}")
    if key is not None:
        understood.append(
            f"{key_path}: {key} read as a tensor: entries off its diagonal are -xy, -xz, -yz of "
            "the positive integrals"
        )
    body[f"inertia_{unit}"] = [float(tensor[k, k]) for k in range(3)]
    body[f"inertia_products_{unit}"] = [float(0.0 - tensor[i, j]) for i, j in _PAIRS]
    return understood


_MOMENTS = ("inertia", "inertia_products")


def _tensor(key_path: str, value: Any, problems: Problems) -> np.ndarray | None:
    """Symmetric matrix (3, 3) from the TOML value at ``key_path``; None, after adding a problem, if
    the value is not one. Elements that differ by round-off from those across the diagonal are
    averaged."""
    try:
        tensor = np.array(value, dtype=float) if are_numbers(value) else np.zeros(0)
    except ValueError:
        tensor = np.zeros(0)
    if tensor.shape != (3, 3):
        problems.add(key_path, "must be three rows of three numbers", value)
        return None
    if np.abs(tensor - tensor.T).max() > _SYMMETRIC * np.abs(tensor).max():
        problems.add(key_path, "must be symmetric, the same numbers on both sides of its diagonal")
        return None
    return 0.5 * (tensor + tensor.T)


def _moments(body: dict[str, Any]) -> tuple[np.ndarray, str] | None:
    """Inertia tensor (3, 3) from the moments and products in the table of a body, and its unit,
    that of the moments. Products that the table does not give are 0. Removes the keys of both from
    the table. None, and nothing is removed, if there are no moments, or the moments or the products
    are not three numbers in a known unit."""
    keys = {split_unit(key)[0]: key for key in body if split_unit(key)[0] in _MOMENTS}
    if "inertia" not in keys:
        return None
    unit = split_unit(keys["inertia"])[1]
    units = UNITS["inertia"]
    values = {}
    for name, names in (("inertia", ("xx", "yy", "zz")), ("inertia_products", ("xy", "xz", "yz"))):
        value = body.get(keys.get(name, ""), [0.0, 0.0, 0.0])
        if isinstance(value, dict):
            value = [value.get(each, 0.0) for each in names]
        own = split_unit(keys[name])[1] if name in keys else unit
        if not are_numbers(value):
            return None
        try:
            values[name] = np.array(value, dtype=float) * (units[own] / units[unit])
        except (ValueError, KeyError):
            return None
        if values[name].shape != (3,):
            return None
    for key in keys.values():
        del body[key]
    tensor = np.diag(values["inertia"])
    for (i, j), product in zip(_PAIRS, values["inertia_products"], strict=True):
        tensor[i, j] = tensor[j, i] = -product
    return tensor, unit


def axes_matrix(key_path: str, axes: Any, problems: Problems) -> np.ndarray | None:
    """Matrix (3, 3) that converts components in body axes to axes given by named directions.

    Parameters
    ----------
    key_path : str
        TOML path of ``axes``, for messages.
    axes : object
        Directions of x, y and z, such as "forward-right-down".
    problems : Problems

    Returns
    -------
    ndarray or None
        Rows are the unit vectors of the named axes in body axes, which may be left-handed
        (determinant -1); None, after adding a problem, if ``axes`` is not three perpendicular
        directions.
    """
    words = axes.split("-") if isinstance(axes, str) else []
    known = [DIRECTIONS[word] for word in words if word in DIRECTIONS]
    if len(words) != 3 or len({number for number, _ in known}) != 3:
        problems.add(
            key_path,
            "must name the directions of x, y and z: three of forward or aft, up or down, right or "
            'left, such as "forward-right-down"',
            axes,
        )
        return None
    matrix = np.zeros((3, 3))
    for row, (number, sign) in enumerate(known):
        matrix[row, number] = sign
    return matrix


def _map(axes: str) -> str:
    """Text that says which moments and products in named axes become which in body axes: "where xx,
    zz, yy become Ixx, Iyy, Izz and ..."."""
    where = {number: (row, sign) for row, (number, sign) in
             enumerate(DIRECTIONS[word] for word in axes.split("-"))}  # fmt: skip
    moments = ", ".join(2 * "xyz"[where[k][0]] for k in range(3))
    products = []
    for i, j in _PAIRS:
        (a, one), (b, other) = where[i], where[j]
        sign = "-" if one * other < 0.0 else ""
        products.append(sign + "".join(sorted("xyz"[k] for k in (a, b))))
    return f"where {moments} become Ixx, Iyy, Izz and {', '.join(products)} become xy, xz, yz"
