"""Two bodies that separate along a guide, and helpers of tests of their outputs."""

SLIDER, FREE = {"pins": "slider"}, {}
# 2 m/s2 on the aft body: s = t^2
RETRO = {"name": "retro", "body": "aft", "thrust_N": 2.0, "station_m": 3.0, "cant_deg": 180.0}


def phases(*steps):
    """Phases p0, p1, ... of (joints, until); the last has no until."""
    return [
        {"name": f"p{i}", "joints": joints} | ({"until": until} if until else {})
        for i, (joints, until) in enumerate(steps)
    ]


GUIDED = phases(
    ({"pins": "fixed"}, {"time_s": 0.2}),
    (SLIDER, {"joint": "pins", "stroke_mm": 80.0}),
    (FREE, None),
)


def flown(campaign, step_s=0.01, status="ok"):
    history = campaign.simulate(step_s=step_s)
    assert history.attrs["status"] == status
    return history, history.attrs["outcomes"]
