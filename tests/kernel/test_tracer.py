"""Tracer of kernels: every call is written once and in order, values of the case are computed
before integration, and the text computes the traced expressions."""

import math

import pytest

from sepmc.engine import interpreted
from sepmc.kernel.tracer.formulas import (
    ZERO,
    air,
    guides,
    joints,
    loads,
    quat,
    scalar,
    vec3,
    vehicle,
)
from sepmc.kernel.tracer.text import Text, Workspace
from sepmc.kernel.tracer.tracer import SYMMETRIC, Scope, total, where


@pytest.fixture
def scope():
    workspace = Workspace()
    return Scope(workspace, Scope(workspace))


def test_the_same_call_is_written_once(scope):
    """A node that no output depends on is not written."""
    x = scope.load("X", 3)
    one, again = vec3.dot(x, x), vec3.dot(x, x)
    vec3.cross(x, x)
    scope.store("OUT", one * again + one)
    assert scope.lines() == [
        "x = get3(w, X + l)",
        "dot = vec3.dot(x, x)",
        "w[OUT + l] = dot * dot + dot",
    ]


def test_what_depends_on_the_case_alone_is_computed_before_the_flight(scope):
    """Parameters are read directly; derived values are stored in fields; unused values are not
    stored."""
    mass = scope.case.parameter(7)
    inverse = (1.0 / mass).called("inverse_mass")
    vec3.scale(mass, (1.0, 2.0, 3.0))
    scope.store("OUT", inverse * scope.load("FORCE") + mass)
    assert scope.lines() == [
        "w[OUT + l] = w[INVERSE_MASS_1 + l] * w[FORCE + l] + w[P + 7 * LANES + l]"
    ]
    assert scope.case.lines() == [
        "inverse_mass = 1.0 / w[P + 7 * LANES + l]",
        "w[INVERSE_MASS_1 + l] = inverse_mass",
    ]
    assert scope.workspace.counts == {"INVERSE_MASS_1": 1}


def test_a_symmetric_matrix_is_stored_as_six_numbers(scope):
    tensor = vehicle.inertia_tensor(
        1.0, *(tuple(scope.case.parameter(start + i) for i in range(3)) for start in (0, 3))
    )
    scope.store(
        "OUT", vec3.rotate(vec3.symmetric_inverse(tensor).called("inverse"), scope.load("X", 3))
    )
    assert (
        scope.lines()[-1] == "put3(w, OUT + l, vec3.rotate(get6(w, INVERSE_1 + l), get3(w, X + l)))"
    )
    assert scope.workspace.counts == {"INVERSE_1": 6}


def test_what_was_stored_is_what_is_read(scope):
    """Only the last value at a path is written; a value read before is read before the write."""
    before = scope.load("T")
    scope.store("T", before + 1.0)
    scope.store("T", scope.load("T") * 2.0)
    scope.store("LAST", before)
    assert scope.lines() == ["t = w[T + l]", "w[T + l] = (t + 1.0) * 2.0", "w[LAST + l] = t"]


def test_choices_are_between_values_that_are_there(scope):
    """Both operands are computed first, so that lanes do not diverge."""
    x = scope.load("X")
    scope.store("OUT", where((x > 0.0) & (x < math.inf), 1.0 / x, 0.0))
    assert scope.lines() == [
        "x = w[X + l]",
        "x_2 = 1.0 / x",
        "w[OUT + l] = x_2 if x > 0.0 and x < math.inf else 0.0",
    ]
    with pytest.raises(TypeError, match="use where"):
        bool(x > 0.0)


def test_zeros_and_ones_fall_out(scope):
    x = scope.load("X")
    assert 0.0 * x == 0.0
    assert total([1.0 * x, 0.0]) is not None
    scope.store("OUT", total([0.0 * x, 1.0 * x, -1.0 * x]) - 0.0)
    assert scope.lines() == ["x = w[X + l]", "w[OUT + l] = x + -x"]


def test_parentheses_are_those_that_are_needed(scope):
    a, b, c = (scope.load(name) for name in "ABC")
    scope.store("OUT", a - (b - c) * (a / (b * c)) - -c)
    assert scope.lines()[-1] == "w[OUT + l] = a - (b - c) * (a / (b * c)) - -c"


def test_a_name_means_one_kind_of_thing_in_a_function():
    """A compiled variable has one type: another shape gets another name, in loops over lanes and
    hand-written lines of one function."""
    workspace, text = Workspace(), Text()
    for signature in ("one(w)", "two(w)"):
        lines = text.function(signature, "Says.")
        if signature == "one(w)":
            lines("row, turned = 0, 1")
        for shape in (3, 9, 3):
            scope = Scope(workspace, Scope(workspace))
            x = scope.load("X", shape)
            scope.store("ROW", vec3.dot(x, x).called("row"))
            scope.store("OUT", scope.load("ROW") * scope.load("ROW"))
            scope.write(lines)
    given = [line.strip().split(" = ")[0] for line in text.lines if " = " in line]
    names = [name for name in given if not name.startswith("w[")]
    assert names == [
        "row, turned", *("x", "row_2", "x_2", "row_2", "x", "row_2"),
        *("x", "row", "x_2", "row", "x", "row"),
    ]  # fmt: skip


def test_what_counts_a_loop_stands_for_nothing_else():
    """A value named like a later loop counter gets another name; two uses of one name are an
    error."""
    workspace, text = Workspace(), Text()
    lines, scope = text.function("one(w)", "Says."), Scope(workspace, Scope(workspace))
    x = scope.load("X", 3)
    scope.store("E", vec3.add(x, x).called("e"))
    scope.store("ROW", vec3.add(x, vec3.add(x, x)).called("turned"))
    scope.write(lines)
    lines("for e in range(48):", "    w[SPARE + e] = 0.0")
    assert any(line.strip().startswith("e_2 = ") for line in text.lines)
    with pytest.raises(TypeError, match="turned stands for two things in a function"):
        lines("for turned in range(3):")


def test_what_a_later_loop_needs_is_kept_or_read_again(scope):
    """Parameters are read again; values that another function needs are stored once, others in
    fields of their own; every loop reads only what it uses."""
    case = scope.case
    mass = case.parameter(7)
    root, inverse = (mass * 3.0).called("root"), (1.0 / mass).called("inverse")
    scope.store("OUT", inverse + scope.load("X"))
    case.store("A", root + inverse)
    case.store("B", root * inverse + mass)
    text = Text()
    case.write(text, 2)
    assert text.lines == [
        "for l in range(LANES):",
        "    parameter = w[P + 7 * LANES + l]",
        "    root = parameter * 3.0",
        "    w[ROOT_1 + l] = root",
        "for l in range(LANES):",
        "    parameter = w[P + 7 * LANES + l]",
        "    inverse = 1.0 / parameter",
        "    w[INVERSE_1 + l] = inverse",
        "for l in range(LANES):",
        "    parameter = w[P + 7 * LANES + l]",
        "    root = w[ROOT_1 + l]",
        "    inverse = w[INVERSE_1 + l]",
        "    w[A + l] = root + inverse",
        "    w[B + l] = root * inverse + parameter",
    ]


def test_the_items_of_a_tuple_that_a_later_loop_needs_are_kept(scope):
    """They are stored one after the other and read as they were."""
    case = scope.case
    around = guides.around_circle(case.parameter(1), case.parameter(2)).called("around")
    ends = vec3.add((case.parameter(3), 0.0, 0.0), (around[0], 1.0, 2.0)).called("end")
    case.store("A", around[0] * around[1])
    case.store("B", around[1] + ends[2])
    text = Text()
    case.write(text, 2)
    loops = "\n".join(text.lines).split("for l in range(LANES):\n")[1:]
    kept = ["    w[AROUND_1 + l] = around[0]", "    w[AROUND_1 + 1 * LANES + l] = around[1]"]
    assert [line for line in loops[0].splitlines() if "AROUND" in line] == kept
    assert "    around = (w[AROUND_1 + l], w[AROUND_1 + 1 * LANES + l])" in loops[1].splitlines()
    assert scope.workspace.counts["AROUND_1"] == 2


def test_a_name_never_meets_that_of_a_formula(scope):
    scope.store("OUT", total([scalar.larger(scope.load("A"), 0.0)] * 2))
    assert scope.lines() == ["larger_2 = larger(w[A + l], 0.0)", "w[OUT + l] = larger_2 + larger_2"]


def test_what_lanes_share_is_read_before_their_loop(scope):
    """A loop that reads a shared number is not vectorised."""
    text = Text()
    scope.store("OUT", scope.case.shared(9) * vec3.dot(scope.case.shared(0, 3), scope.load("X", 3)))
    scope.write(text)
    assert text.lines[:3] == [
        "shared_0 = vec3.get(w, SHARED + 0)",
        "shared_9 = w[SHARED + 9]",
        "for l in range(LANES):",
    ]
    assert text.lines[3:] == ["    w[OUT + l] = shared_9 * vec3.dot(shared_0, get3(w, X + l))"]


def test_long_statements_are_broken(scope):
    text = Text()
    scope.store("OUT", total([scope.load(f"QUANTITY_{i}") for i in range(20)]))
    scope.write(text)
    assert len(text.lines) > 2
    assert max(map(len, text.lines)) <= 100
    compile("\n".join(text.lines), "broken", "exec")


HOMES = {
    vec3: ["vec3"], quat: ["quat"], joints: ["joints"], loads: ["aerodynamics", "gravity",
    "propulsion", "springs", "wind"],
    air: ["atmosphere"], vehicle: ["vehicle"], scalar: ["lanes", "elementary"], guides: ["guides"],
}  # fmt: skip
ALL = [
    (module, name)
    for module in HOMES
    for name in module._shapes
    if not name.startswith("math.") and name != "abs"
]


@pytest.fixture(scope="module")
def plain():
    """The formulas as plain Python."""
    homes = ", ".join(home for names in HOMES.values() for home in names if home != "lanes")
    text = (
        f"N_INDICATORS, N_SEGMENTS, N_CHANGES, METHODS = 0, 0, 0, ()\n"
        f"from sepmc.physics import {homes}\nfrom sepmc.routines import lanes"
    )
    return interpreted.load(text).plain


def _sizes(value):
    return (
        tuple(_sizes(component) if isinstance(component, tuple) else 1 for component in value)
        if isinstance(value, tuple)
        else 1
    )


def _expected(shape):
    if isinstance(shape, tuple):
        return tuple(_expected(component) for component in shape)
    return (1,) * (9 if shape == SYMMETRIC else shape) if shape not in (1, "condition") else 1


@pytest.mark.parametrize(("module", "name"), ALL, ids=[name for _, name in ALL])
def test_formulas_give_what_the_tracer_expects(plain, module, name):
    """Shapes in `sepmc.kernel.tracer.formulas` agree with the results of the formulas."""
    last = name.rpartition(".")[2]
    real = next(
        getattr(getattr(plain, home), last)
        for home in HOMES[module]
        if hasattr(getattr(plain, home), last)
    )
    known = {
        "3": (0.1, 0.2, 0.3),
        "4": (0.9, 0.1, 0.2, 0.3),
        "9": (2.0, 0.1, 0.2, 0.1, 3.0, 0.3, 0.2, 0.3, 4.0),
        "1": 0.5,
    }
    given = _ARGUMENTS.get(name, "3" * real.__code__.co_argcount)
    assert _sizes(real(*(known[a] for a in given))) == _expected(module._shapes[name])


_ARGUMENTS = {
    "scale": "13", "rotate": "93", "unrotate": "93", "add_matrices": "99",
    "symmetric_inverse": "9", "is_positive_definite": "9",
    "matrix": "4", "rate": "43", "from_angles": "111", "pitch": "9", "yaw": "9", "roll": "9",
    "flow_angles": "3", "aero_force": "13",
    "aero_moment": "13", "thrust_direction": "1111", "thrust_arm": "311111", "wind": "11",
    "inverse_square": "11",
    "inverse_square_near": "11", "building_up": "111", "tail_off": "11",
    "springs.spring_force": "11111", "density_near": "91",
    "geopotential": "1", "sound_speed": "1", "geopotential_rise": "111", "density_series": "14",
    "layer": "1", "inertia_tensor": "133",
    "flight_direction": "11", "larger": "11", "arctan2": "11", "exponential": "1",
    "heading": "9", "turns_unclear": "44331",
    "bearing_forces": "3311", "around_circle": "1111", "pin_force": "3131",
    "friction_force": "1111",
    "nearest_turn": "11", "time_left": "1111", "largest3": "3", "largest4": "4",
}  # fmt: skip


def test_an_unknown_formula_is_an_error():
    with pytest.raises(AttributeError):
        vec3.divergence(ZERO)
