"""Data in other conventions, as brought: keys of a campaign that are written in those of this
project before the file is read.

The resolved tree, which a run stores, has the keys of the model only. Every conversion is said in a
sentence, which `sepmc check` prints.
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
        Of a campaign file. Values of other types than expected stay, for the checks of the model.
    problems : Problems

    Returns
    -------
    list of str
        A sentence for each conversion, with its place.
    """
    said: list[str] = []
    bodies = tree.get("body")
    for name, body in bodies.items() if isinstance(bodies, dict) else ():
        if not isinstance(body, dict):
            continue
        place = f"body.{name}"
        said += convert_inertia(place, body, problems)
        if isinstance(aero := body.get("aerodynamics"), dict):
            said += convert_aerodynamics(f"{place}.aerodynamics", aero, problems)
    environment = tree.get("environment")
    if isinstance(environment, dict):
        said += convert_air("environment.air", environment, problems)
        if isinstance(wind := environment.get("wind"), dict):
            said += convert_wind("environment.wind", wind, problems)
    return said
