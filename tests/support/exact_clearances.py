"""Minimum clearances of one case from its history, by geometry that shares no code with kernels."""

import numpy as np
from oracles import geometry

ROWS_S = 0.0005  # time between rows of the history


def exact(campaign, case, history=None, every_s=ROWS_S):
    """Minimum clearances of one case, mm, and their times, s, by name of the clearance."""
    if history is None:
        history = campaign.simulate(case, step_s=every_s)
    outcomes, scene, clearances = history.attrs["outcomes"], case.scene, {}
    for clearance in scene.clearance:
        a, b = clearance.bodies
        first = 0.0
        if clearance.after:
            name = f"{clearance.after}_release_time_s"
            first = outcomes[name if name in outcomes else "release_time_s"]
        times = history["time_s"].to_numpy()
        times = np.unique(np.concatenate([[first], times[times > first]]))
        parts = (geometry.parts_of(scene.body[name]) for name in (a, b))
        minimum, when = geometry.min_clearance(
            geometry.relative_motion(history, a, b), *parts, times
        )
        clearances[clearance.name] = 1e3 * minimum, when
    return clearances
