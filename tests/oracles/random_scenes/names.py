"""Names in a random scene: plain ones, or ones that a generator of programs could trip over."""

from oracles.random_scenes.rng import RandomStream

_PLAIN = {
    "body": ["core", "booster", "payload", "adapter", "fairing"],
    "joint": ["bolt", "pins", "hinge", "strut", "clamp", "rail", "latch"],
    "spring": ["pusher", "damper", "piston", "ejector", "bumper", "spring5", "spring6", "spring7"],
    "motor": ["retro", "ullage", "spin", "kick"],
    "load": ["drag", "plume", "gust", "torque", "tug", "load6", "load7"],
    "phase": ["locked", "guided", "loose", "clear", "coast", "late"],
    "kind": ["keyed", "cupped"],
    "release": ["cut", "let_go"],
    "proximity": ["near", "wake"],
    "clearance": ["gap", "exit"],
    "event": ["apart", "spent", "instant"],
}
# Short names as in formulas, names that differ in case, keywords, names of modules and buffers,
# names that join to others.
_HOSTILE = [
    *(
        "a",
        "b",
        "A",
        "B",
        "p",
        "q",
        "p_q",
        "l",
        "w",
        "x",
        "y",
        "t",
        "d",
        "e",
        "m",
        "r",
        "v",
        "k",
        "i",
        "g",
    ),
    *(
        "spin_a",
        "spin_b",
        "spin",
        "rate",
        "value",
        "Stage",
        "stage",
        "p_q_r",
        "q_r",
        "r_a",
        "v_a",
        "x_a",
        "omega",
        "a_b",
        "b_a",
    ),
    *(
        "if",
        "lambda",
        "in",
        "None",
        "True",
        "class",
        "def",
        "is",
        "not",
        "pass",
        "return",
        "async",
        "del",
    ),
    *(
        "math",
        "np",
        "vec3",
        "quat",
        "joints",
        "springs",
        "LANES",
        "Y",
        "S",
        "D",
        "T",
        "K1",
        "STEP",
        "X_a",
        "Q_a",
        "OMEGA_a",
    ),
    *(
        "block",
        "table",
        "entry",
        "record",
        "numba",
        "prange",
        "print",
        "float",
        "range",
        "min",
        "abs",
        "self",
        "__",
        "air",
        "wind",
    ),
    *(
        "force",
        "moment",
        "thrust",
        "distance",
        "length",
        "phase",
        "cases",
        "ahead",
        "wait",
        "usual",
        "step",
        "end",
        "time",
        "body",
    ),
]
_HOSTILE.remove("__")  # a name must begin with a letter
_GROUND_LIKE = ["grounds", "Ground", "ground_"]


class Names:
    """Source of names, each once per sort of item; a joint and a spring may have the same name."""

    def __init__(self, rng: RandomStream):
        self.rng, self.hostile = rng, rng.chance(0.35)
        self.used: dict[str, list[str]] = {}

    def new(self, sort: str) -> str:
        """New name for a body, joint, spring, motor, load, phase or kind."""
        used = self.used.setdefault(sort, [])
        others = [name for names in self.used.values() for name in names if name not in used]
        if self.hostile and others and sort != "kind" and self.rng.chance(0.15):
            name = self.rng.choice(others)  # one name for two items
        elif self.hostile and self.rng.chance(0.9):
            free = [name for name in [*_HOSTILE, *_GROUND_LIKE] if name not in used]
            name = self.rng.choice(free)
        else:
            free = [name for name in _PLAIN[sort] if name not in used]
            name = free[0] if free else f"{sort}{len(used)}"
        used.append(name)
        return name
