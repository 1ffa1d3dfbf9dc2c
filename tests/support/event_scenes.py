"""Two bodies whose phases end upon events, and helpers of tests of event times."""

import numpy as np

FIXED, SLIDER, FREE = ({"pins": kind} for kind in ("fixed", "slider", "free"))


EXACT = 1e-12  # s: two times closer than this are one


def flown(campaign, step_s=0.05):
    """History and outcomes of a case that must end ok."""
    history = campaign.simulate(step_s=step_s)
    assert history.attrs["status"] == "ok"
    assert history.attrs["outcomes"]["event_residual_s"] <= EXACT
    return history, history.attrs["outcomes"]


def changes(history):
    """Times with two rows each, and the phases before and after."""
    time, phase = history["time_s"].to_numpy(), history["phase"].to_numpy()
    twice = np.flatnonzero(np.diff(time) == 0.0)
    assert np.all(np.diff(time) >= 0.0)
    return [(time[i], phase[i], phase[i + 1]) for i in twice]
