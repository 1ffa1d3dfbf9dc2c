"""Positive directions of the coefficients of a DAVE-ML file: stated by the attribute ``sign`` of a
variable, or by a name in body axes, of which X points forward, Y right and Z down."""

import re

from sepmc.formats.text_table import FormatError
from sepmc.formats.xml_tree import Element
from sepmc.scene.messages import printable, shorten

# standard names of AIAA S-119: column of a deck, and direction in which it is positive
STANDARD = {
    "aeroBodyForceCoefficient_X": ("axial", "forward"),
    "aeroBodyForceCoefficient_Y": ("side", "right"),
    "aeroBodyForceCoefficient_Z": ("normal", "down"),
    "aeroBodyMomentCoefficient_Roll": ("roll", "right wing down"),
    "aeroBodyMomentCoefficient_Pitch": ("pitch", "nose up"),
    "aeroBodyMomentCoefficient_Yaw": ("yaw", "nose right"),
}
_BODY_AXES = {"x": "forward", "y": "right", "z": "down"}
_BODY_NAME = re.compile(r"c_?([xyz])[0-9]?", re.IGNORECASE)
# words of the direction in which a coefficient is positive here, and of the opposite one
_WORDS = {
    "axial": ("aft rear rearward back backward", "fwd forward front"),
    "normal": ("up", "down dwn dn"),
    "side": ("left lt", "right rt"),
    "roll": ("rwd right rt", "lwd left lt"),
    "pitch": ("anu up", "and down dwn dn"),
    "yaw": ("anr right rt", "anl left lt"),
}
_WORDS |= {"lift": _WORDS["normal"], "drag": _WORDS["axial"]}
_RATES = {"p": "roll", "q": "pitch", "r": "yaw"}
_HERE = {key: words[0].split()[0] for key, words in _WORDS.items()}
_HERE |= {"roll": "right wing down", "pitch": "nose up", "yaw": "nose right"}


def sign_of(key: str, element: Element) -> tuple[float, str, bool]:
    """Sign by which the values of a variable are multiplied to be a coefficient of CONVENTIONS.md.

    Parameters
    ----------
    key : str
        Coefficient or derivative, such as ``side`` or ``side_r``, or ``lift`` or ``drag``.
    element : Element
        The ``variableDef``.

    Returns
    -------
    sign : float
        1 or -1; 1 if the file does not state the direction.
    reason : str
        Direction in which the values are positive, and where the file states it, for the user; if
        it does not, the direction that CONVENTIONS.md gives the coefficient.
    stated : bool
        False if the file does not state it.

    Raises
    ------
    FormatError
        If the variable is in wind or stability axes, and the coefficient in body axes.
    """
    coefficient, _, rate = key.partition("_")
    name, variable = (element.attributes.get(each, "").strip() for each in ("name", "varID"))
    axes = element.attributes.get("axisSystem", "").lower()
    if key not in ("lift", "drag") and ("wind" in axes or "stab" in axes):
        raise FormatError(
            f"line {element.line}: {shorten(name)} has axisSystem = {shorten(axes)}: {key} must be "
            "in body axes"
        )
    text = printable(element.attributes.get("sign", "").strip(), 40)
    of_force, _, of_rate = text.partition("/")
    if sign := _direction(coefficient, of_force):
        if rate:
            sign *= _direction(_RATES[rate], of_rate) or 1.0
        return sign, f'sign = "{text}" in the file', True
    unclear = f', as its sign = "{text}" is not understood' if text else ""
    for each in (name, variable):
        column, direction = STANDARD.get(each, ("", ""))
        if not column and (match := _BODY_NAME.fullmatch(each)):
            direction = _BODY_AXES[match[1].lower()]
        if direction and (sign := _direction(coefficient, direction)):
            return sign, f"positive {direction} by the name {each}{unclear}", True
    return 1.0, f"positive {_HERE[coefficient]}{unclear}", False


def _direction(coefficient: str, text: str) -> float:
    """1 if a text names the direction in which a coefficient is positive here, -1 if it names the
    opposite one, 0 if it names none or both."""
    words = set(re.findall(r"[a-z]+", text.lower()))
    positive, negative = (bool(words & {*each.split()}) for each in _WORDS[coefficient])
    return float(positive) - float(negative)
