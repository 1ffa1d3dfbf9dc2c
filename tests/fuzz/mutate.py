"""Random changes of TOML trees and texts."""

import datetime
import math
import pickle
import tomllib
from pathlib import Path

ROOT = Path(__file__).parents[2]
FOLDERS = ("campaigns", "sepmc/validation/scenes", "tests/scenes", "tests", "sepmc")
NAMES = (
    "", "x", "..", "../../x", "/etc/passwd", "a/b", "a\0b", "a\nb", "'", '"', '"""', "}{", "{x}",
    "__import__('os').system('true')", "\N{SNOWMAN}", "\u202e", "\x1b[2J", "ground", "free", "none",
    "lambda", "LANES", "p", "%s", "$\\frac{", "body1", "a" * 300, "in_case", "case", "status",
)  # fmt: skip
NUMBERS = (
    0, -1, 1, 2, 7, 0.0, -0.0, 0.5, 1e-300, 5e-324, 1e-12, 1e-6, 1e6, 1e15, 1e154, 1e300, 1e308,
    -1e308, math.nan, math.inf, -math.inf, 2**31, 2**53 + 1, 2**63 - 1, 2**63, 10**9, 10**15,
    10**30, 16**5000, -(2**63), -(2**63) - 1, 89.0, 90.0, 180.0, 360.0, 86_000.0,
)  # fmt: skip
BYTES = (
    b"\0", b"\xff", b'"""', b"]]", b"[[", b"{", b"9e999", b"nan", b"inf", b"0x" + b"f" * 5000, b"-",
    b"#", b"\r", b"\n", b"=", b".", b"'", b"1979-05-27", b"true",
)  # fmt: skip
OTHERS = (
    True, False, datetime.date(1979, 5, 27), datetime.time(7, 32), datetime.datetime.max,
)  # fmt: skip


def bases():
    """Texts of campaigns to start from, by path."""
    texts = {}
    for folder in FOLDERS:
        for path in sorted((ROOT / folder).glob("*.toml")):
            text = path.read_text(encoding="utf-8")
            if "initial" in tomllib.loads(text):
                texts[path.relative_to(ROOT).as_posix()] = text
    return texts


class Trees:
    """Trees to start from, and the keys and values that they are made of."""

    def __init__(self):
        self.texts = list(bases().values())
        trees = [tomllib.loads(text) for text in self.texts]
        self.kept = [pickle.dumps(tree) for tree in trees]
        # small ones more often: faults appear there too, ten times as fast
        self.weights = [1.0 / (200 + len(text)) for text in self.texts]
        self.words, self.values = {}, {}
        for tree in trees:
            for node, key in slots(tree):
                if isinstance(key, str):
                    self.words[key] = None
                    self.values.setdefault(key, []).append(pickle.dumps(node[key]))
                if isinstance(node[key], str):
                    self.words[node[key]] = None
        self.words = list(self.words)

    def any(self, rng):
        """A tree without changes."""
        return pickle.loads(rng.choices(self.kept, self.weights)[0])

    def changed(self, rng):
        """A tree with one to six changes."""
        tree = self.any(rng)
        for _ in range(rng.choice((1, 1, 1, 2, 2, 3, 6))):
            tree = self.change(tree, rng)
        return tree

    def change(self, tree, rng):
        """The tree with one more change."""
        places = slots(tree)
        if not places:
            return tree
        node, key = rng.choice(places)
        way = rng.random()
        if way < 0.35:
            node[key] = self.value(rng, node[key])
        elif way < 0.5:
            node[key] = scaled(node[key], rng)
        elif way < 0.58:
            del node[key]
        elif way < 0.68:  # under another name
            value = node.pop(key)
            other = rng.choice(NAMES) if rng.random() < 0.3 else rng.choice(self.words)
            if isinstance(node, dict):
                node[other] = value
            else:
                node.append(value)
        elif way < 0.78:  # twice
            if isinstance(node, dict):
                node[rng.choice(self.words)] = pickle.loads(pickle.dumps(node[key]))
            else:
                node.insert(key, pickle.loads(pickle.dumps(node[key])))
        elif way < 0.86:
            other, there = rng.choice(places)
            one = pickle.dumps(node[key])
            node[key], other[there] = pickle.loads(pickle.dumps(other[there])), pickle.loads(one)
        elif way < 0.97:  # a key valid elsewhere, with its value
            word = rng.choice(list(self.values))
            value = pickle.loads(rng.choice(self.values[word]))
            (node if isinstance(node, dict) else tree)[word] = value
        else:
            node[key] = [node[key]] if rng.random() < 0.5 else {"x": node[key]}
        return tree

    def value(self, rng, was):
        """Another value instead of ``was``."""
        way = rng.random()
        if way < 0.5 and isinstance(was, int | float):
            return rng.choice(NUMBERS)
        if way < 0.6:
            return rng.choice(OTHERS)
        if way < 0.75:
            return rng.choice((rng.choice(NAMES), rng.choice(self.words)))
        if way < 0.9:
            return rng.choice(NUMBERS)
        return rng.choice(([], {}, [[]], [0.0, 1.0, 2.0], [1.0] * 7, [rng.choice(NUMBERS)] * 3, ""))

    def text(self, rng):
        """Text with bytes flipped, removed, duplicated, or copied from another."""
        said = bytearray(rng.choices(self.texts, self.weights)[0].encode())
        for _ in range(rng.choice((1, 1, 2, 4, 16))):
            place, way = rng.randrange(len(said) + 1), rng.random()
            length = rng.choice((1, 1, 3, 20, 300))
            if way < 0.3 and place < len(said):
                said[place] ^= 1 << rng.randrange(8)
            elif way < 0.5:
                del said[place : place + length]
            elif way < 0.65:
                said[place:place] = said[place : place + length]
            elif way < 0.8:
                other = rng.choice(self.texts).encode()
                begin = rng.randrange(len(other))
                said[place : place + length] = other[begin : begin + length]
            else:
                said[place:place] = rng.choice(BYTES)
        return bytes(said)


def slots(tree):
    """All places (container, key) in a tree."""
    places, left = [], [tree]
    while left:
        node = left.pop()
        pairs = node.items() if isinstance(node, dict) else enumerate(node)
        for key, value in pairs:
            places.append((node, key))
            if isinstance(value, dict | list):
                left.append(value)
    return places


def scaled(value, rng):
    """A number slightly or strongly changed; lists likewise."""
    if isinstance(value, list):
        return [scaled(item, rng) if rng.random() < 0.5 else item for item in value]
    if isinstance(value, bool) or not isinstance(value, int | float):
        return value
    if isinstance(value, int):
        return value + rng.choice((-1, 1, 2, 1000, -value, 9 * value))
    factor = rng.choice((-1.0, 0.0, 0.5, 1.001, 2.0, 10.0, 1e3, 1e-3, 1e6, 1e-9, 1e12))
    return value * factor


def huge(rng):
    """A very large tree: (its kind, the tree)."""
    size = rng.choice((30, 300, 3000, 30_000))
    tree = tomllib.loads(SMALL)
    what = rng.choice(list(HUGE))
    HUGE[what](tree, size)
    return f"{what} {size}", tree


SMALL = """
environment = { atmosphere = "none", gravity = "none" }
body.a = { mass_kg = 3.0, inertia_kg_m2 = [3.0, 4.0, 5.0], cg_m = [1.0, 0.0, 0.0] }
body.b = { mass_kg = 1.0, inertia_kg_m2 = [1.0, 2.0, 2.0], cg_m = [3.0, 0.0, 0.0] }
joint.pins = { bodies = ["a", "b"], point_m = [2.0, 0.0, 0.0] }
phase = [
  { name = "locked", joints = { pins = "fixed" }, until = { time_s = 0.1 } }, { name = "free" },
]
initial = { altitude_m = 1000.0, speed_m_s = 1.0 }
run = { end_time_s = 0.5 }
solver = { step_s = 0.05 }
dispersion = { "body.a.mass_kg" = { uniform = 0.1 }, "body.b.mass_kg" = { uniform = 0.1 } }
"""


def _bodies(tree, size):
    tree["body"] |= {f"b{i}": tree["body"]["a"] for i in range(size)}


def _chain(tree, size):
    _bodies(tree, size)
    point = {"point_m": [2.0, 0.0, 0.0]}
    tree["joint"] |= {f"j{i}": {"bodies": ["a", f"b{i}"], **point} for i in range(size)}
    tree["phase"][0]["joints"] |= {f"j{i}": "spherical" for i in range(size)}


def _ring(tree, size):
    """As many joints between two bodies."""
    tree["joint"] |= {f"j{i}": tree["joint"]["pins"] for i in range(size)}
    tree["phase"][0]["joints"] |= {f"j{i}": "slider" for i in range(size)}


def _phases(tree, size):
    first = tree["phase"][0]
    more = [first | {"name": f"p{i}", "until": {"time_s": 0.1}} for i in range(size)]
    tree["phase"] = [first, *more, {"name": "free"}]


def _many(table, **item):
    def put(tree, size):
        tree[table] = [{"name": f"n{i}", **item} for i in range(size)]

    return put


def _deep(tree, size):
    inner = {"time_s": 0.1}
    for _ in range(size):
        inner = {"any": [inner]}
    tree["phase"][0]["until"] = inner


def _deep_list(tree, size):
    inner = 1.0
    for _ in range(size):
        inner = [inner]
    tree["body"]["a"]["mass_kg"] = inner


def _rows(tree, size):
    series = [float(i) for i in range(size)]
    wind = {"altitude_m": series, "speed_m_s": series, "direction_deg": series}
    tree["environment"]["wind"] = {"profile": wind}


def _air(tree, size):
    series = [float(i) for i in range(size)]
    air = {"altitude_m": series, "density_kg_per_m3": [1.0] * size}
    tree["environment"] |= {"atmosphere": "table", "air": air}


def _grid(tree, size):
    n = max(2, round(size**0.5))
    axis = [float(i) for i in range(n)]
    air = {"mach": axis, "alpha_deg": axis, "beta_deg": axis[:20]}
    table = {"axial": [[[1.0] * len(axis[:20])] * n] * n}
    tree["body"]["a"] = tree["body"]["a"] | {
        "aerodynamics": {"reference_area_m2": 1.0, "reference_length_m": 1.0, "table": air | table}
    }


def _profile(tree, size):
    rows = {"time_s": [0.1 * i for i in range(size)], "fraction": [1.0] * size}
    motor = {"name": "m", "body": "a", "thrust_N": 1.0, "station_m": 0.0, "profile": rows}
    tree["motor"] = [motor]


def _points(tree, size):
    part = {"points_m": [[float(i), 0.0, 0.0] for i in range(size)]}
    for name in ("a", "b"):
        tree["body"][name] = tree["body"][name] | {"outline": [part]}
    tree["clearance"] = [{"name": "c", "bodies": ["a", "b"]}]


def _parts(tree, size):
    parts = [{"stations_m": [0.0, 1.0], "radii_m": [1.0, 1.0]}] * size
    for name in ("a", "b"):
        tree["body"][name] = tree["body"][name] | {"outline": parts}
    tree["clearance"] = [{"name": "c", "bodies": ["a", "b"]}]


def _discrete(tree, size):
    tree["dispersion"] = {"body.a.mass_kg": {"discrete": [1.0 + i for i in range(size)]}}


def _correlated(tree, size):
    pair = ["body.a.mass_kg", "body.b.mass_kg"]
    tree["correlation"] = [{"parameters": pair * (size // 2), "coefficient": 0.1}]


def _correlations(tree, size):
    pair = ["body.a.mass_kg", "body.b.mass_kg"]
    tree["correlation"] = [{"parameters": pair, "coefficient": 0.1}] * size


def _unknown(tree, size):
    tree["body"]["a"] = tree["body"]["a"] | {f"mass_kgx{i}": 1.0 for i in range(size)}


def _laws(tree, size):
    tree["dispersion"] = {f"body.a.mas{i}_kg": {"uniform": 1.0} for i in range(size)}


def _long(tree, size):
    tree["title"] = "x" * (30 * size)
    tree["body"]["x" * size] = tree["body"]["a"]


def _long_key(tree, size):
    tree["mass" * size] = 1.0
    tree["run"]["samples"] = "y" * size + ".csv"


def _cases(tree, size):
    tree["run"] |= {"cases": size**4, "seed": size**5, "chunk": size**4}


def _whole(tree, size):
    tree["run"] |= {"cases": 10**9, "sampler": "lhs", "chunk": size**3}


HUGE = {
    "bodies": _bodies,
    "chain": _chain,
    "ring": _ring,
    "phases": _phases,
    "deep": _deep,
    "deep list": _deep_list,
    "wind rows": _rows,
    "air rows": _air,
    "grid": _grid,
    "profile": _profile,
    "points": _points,
    "parts": _parts,
    "discrete": _discrete,
    "correlated": _correlated,
    "correlations": _correlations,
    "unknown keys": _unknown,
    "laws": _laws,
    "long": _long,
    "long key": _long_key,
    "cases": _cases,
    "lhs": _whole,
    "motors": _many("motor", body="a", thrust_N=1.0, station_m=0.0, burn_s=0.1),
    "springs": _many("spring", bodies=["a", "b"], point_m=[2.0, 0.0, 0.0], force_N=1.0),
    "loads": _many("load", body="a", force_N=[1.0, 0.0, 0.0], start_s=0.1, end_s=0.2),
    "events": _many("event", when={"time_s": 0.1}),
    "releases": _many("release", joint="pins", when={"time_s": 0.1}),
    "requirements": _many("requirement", metric="unresolved"),
    "clearances": _many("clearance", bodies=["a", "b"]),
}
