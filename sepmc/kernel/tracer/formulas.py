"""Formulas (functions of `sepmc.physics` and `sepmc.routines`) that the emitter calls on symbolic
expressions, each with the shape of its result: a call becomes a line of the kernel."""

from typing import Any

from sepmc.kernel.tracer.tracer import CONDITION, NUMBER, SYMMETRIC, Formulas

vec3: Any = Formulas(
    "vec3",
    {
        **dict.fromkeys(
            ("add", "sub", "scale", "cross", "unit", "perpendicular", "rotate", "unrotate"), 3
        ),
        "dot": NUMBER,
        "add_matrices": SYMMETRIC,  # of inertias
        "symmetric_inverse": SYMMETRIC,
        "is_positive_definite": CONDITION,
    },
)
quat: Any = Formulas(
    "quat",
    {
        **{"matrix": 9, "rate": 4, "from_angles": 4, "heading": 4},
        **dict.fromkeys(("pitch", "yaw", "roll"), NUMBER),
        "turns_unclear": CONDITION,
    },
)
joints: Any = Formulas(
    "joints",
    {
        "between": (3, 3),
        "translation": (3, 3, NUMBER),
        "translation_rate": NUMBER,
        "rotation": (3, NUMBER),
        "rotation_rate": NUMBER,
        "rod": (3, 3, 3, NUMBER),
        "across": 3,
    },
)
guides: Any = Formulas(
    "guides",
    {
        "bearing_forces": ((NUMBER, NUMBER), (NUMBER, NUMBER)),
        **dict.fromkeys(("around_circle", "pin_force"), (NUMBER, NUMBER)),
        "friction_force": NUMBER,
    },
)
linear: Any = Formulas("linear", {"solve_min_norm": (NUMBER, NUMBER), "eliminate": NUMBER})
loads: Any = Formulas(
    "",
    {
        **dict.fromkeys(("flow_angles", "reported_angles"), (NUMBER, NUMBER)),
        **dict.fromkeys(("aero_force", "aero_moment", "thrust_direction", "thrust_arm", "wind"), 3),
        **dict.fromkeys(
            (
                "inverse_square",
                "inverse_square_near",
                "building_up",
                "tail_off",
                "springs.spring_force",
            ),
            NUMBER,
        ),
    },
)
air: Any = Formulas(
    "",
    {
        **dict.fromkeys(
            ("density_near", "geopotential", "geopotential_rise", "sound_speed"), NUMBER
        ),
        "density_series": 9,
        "layer": (4, NUMBER),
    },
)
signals: Any = Formulas(
    "signals",
    dict.fromkeys(("quotient", "root", "logarithm", "growth", "power", "sine", "cosine"), NUMBER),
)
vehicle: Any = Formulas("", {"inertia_tensor": SYMMETRIC, "arm": 3, "flight_direction": 3})
scalar: Any = Formulas(
    "",
    {
        **dict.fromkeys(
            (
                "larger",
                "abs",
                "arctan2",
                "exponential",
                "nearest_turn",
                "time_left",
                "largest3",
                "largest4",
                "math.sqrt",
            ),
            NUMBER,
        ),
        "math.isfinite": CONDITION,
    },
)


def square_root(x: Any) -> Any:
    """Square root of a symbolic number: a call of ``math.sqrt`` in the kernel.

    Parameters
    ----------
    x : Expr
        number, at least zero

    Returns
    -------
    Expr
    """
    return getattr(scalar, "math.sqrt")(x)


ZERO = (0.0, 0.0, 0.0)
UNIT = ((1.0, 0.0, 0.0), (0.0, 1.0, 0.0), (0.0, 0.0, 1.0))
