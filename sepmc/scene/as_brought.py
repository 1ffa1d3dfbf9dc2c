"""Data in other conventions, as brought: keys of a campaign that are written in those of this
project before the file is read.

The resolved tree, which a run stores, has the keys of the model only. `sepmc check` prints a
sentence on every conversion.
"""

from typing import Any

from sepmc.scene.brought_aerodynamics import convert_aerodynamics
from sepmc.scene.brought_air import convert_air, convert_wind
from sepmc.scene.brought_inertia import convert_inertia
from sepmc.scene.messages import Problems


def convert_tree(tree: dict[str, Any], problems: Problems) -> list[str]:
    """Convert data in other conventions in place.

    Parameters
    ----------
    tree : dict
        Tables of a campaign file, changed in place. Values of other types than expected stay, for
        the checks of the model.
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
