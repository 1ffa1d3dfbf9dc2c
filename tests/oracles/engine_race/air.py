"""The atmosphere of all cases in one formula."""

import numpy as np

from oracles.engine_race.inputs import Inputs
from oracles.external_engines import loads
from sepmc.scene.messages import InputError


def atmosphere(inputs: Inputs) -> tuple[float, float, float, float]:
    """Density = base (a + b / (R + height))^k, with R the radius of the Earth, in the single layer
    of the standard of all cases."""
    reach = np.abs(inputs.velocity[:, 1]) * inputs.end + 10.0
    layers = {
        loads.layer_at(h)
        for h in ((inputs.altitude - reach).min(), (inputs.altitude + reach).max())
    }
    if len(layers) > 1 or loads.LAPSES[min(layers)] == 0.0:
        raise InputError(
            "the other engines of the bench fly within one layer of the atmosphere, not an "
            "isothermal one"
        )
    (layer,) = layers
    temperature, pressure = loads.to_base(layer)
    slope = loads.LAPSES[layer] / temperature
    radius = loads.EARTH_RADIUS
    power = -loads.LAPSE_GRAVITY / (loads.GAS * loads.LAPSES[layer]) - 1.0
    return (
        pressure / (loads.GAS * temperature),
        1.0 + slope * (radius - loads.BASES[layer]),
        -slope * radius**2,
        power,
    )
