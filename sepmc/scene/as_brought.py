"""Conversion of data that a campaign file gives in other conventions (DATCOM signs, inertia
tensors, wind "from") to the keys and conventions of the model.

The converted tree, which a run stores, has keys of the model only. `sepmc check` prints a sentence
on every conversion.
"""

from typing import Any

from sepmc.scene.brought_aerodynamics import convert_aerodynamics
from sepmc.scene.brought_air import convert_air, convert_wind
from sepmc.scene.brought_inertia import convert_inertia
from sepmc.scene.messages import Problems


def convert_tree(tree: dict[str, Any], problems: Problems) -> list[str]:
    """Convert data in other conventions to those of the model, in place.

    Parameters
    ----------
    tree : dict
        TOML tree of a campaign file, changed in place. Values of an unexpected type are left
        unchanged: the checks of the model report them.
    problems : Problems
        Receives every problem.

    Returns
    -------
    list of str
        A sentence for each conversion, which begins with the TOML path of what it converted.
    """
    understood: list[str] = []
    bodies = tree.get("body")
    for name, body in bodies.items() if isinstance(bodies, dict) else ():
        if not isinstance(body, dict):
            continue
        key_path = f"body.{name}"
        understood += convert_inertia(key_path, body, problems)
        if isinstance(aero := body.get("aerodynamics"), dict):
            understood += convert_aerodynamics(f"{key_path}.aerodynamics", aero, problems)
    environment = tree.get("environment")
    if isinstance(environment, dict):
        understood += convert_air("environment.air", environment, problems)
        if isinstance(wind := environment.get("wind"), dict):
            understood += convert_wind("environment.wind", wind, problems)
    return understood
