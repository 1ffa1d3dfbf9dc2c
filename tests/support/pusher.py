"""Two bodies in vacuum that a pusher on their common axis separates: the speed is known."""

MASSES = 300.0, 100.0  # kg


def pusher_tree(spring, **more):
    """Tree of the campaign; ``spring`` gives the force of the pusher, ``more`` other tables."""
    return {
        "environment": {"atmosphere": "none", "gravity": "none"},
        "body": {
            name: {"mass_kg": mass, "inertia_kg_m2": [10.0, 50.0, 50.0], "cg_m": [x, 0.0, 0.0]}
            for name, mass, x in (("aft", MASSES[0], 2.0), ("fore", MASSES[1], 0.0))
        },
        "joint": {"ring": {"bodies": ["aft", "fore"], "point_m": [1.0, 0.0, 0.0]}},
        "spring": [
            {
                "name": "pusher",
                "bodies": ["aft", "fore"],
                "point_m": [1.0, 0.0, 0.0],
                "axis": [1.0, 0.0, 0.0],
            }
            | spring
        ],
        "phase": [{"name": "free"}],
        "initial": {"altitude_m": 1e5, "speed_m_s": 1000.0},
    } | more
