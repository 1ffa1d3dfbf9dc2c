"""Functions in the language of kernels: compiled code and Python give the same."""

import itertools
import math

import numpy as np
import pytest
from numpy.testing import assert_array_equal
from support.compiled import compiled

from sepmc.jit import formula, noinline
from sepmc.translator.functions import TranslationError

INF, NAN = math.inf, math.nan
NUMBERS = (0.0, -0.0, 1.5, -2.25, 1e300, INF, -INF, NAN)
MIXED = (1, 2.5, 3)
WEIGHTS, TABLE = (0.5, 0.25, 2.0, 8.0), np.arange(12.0).reshape(3, 4)


def same(function, *arguments):
    """Compare a function compiled and in Python, signs of zeros included."""
    ours, expected = compiled(function)(*arguments), function(*arguments)
    assert_array_equal(ours, expected)
    assert_array_equal(_negative(ours), _negative(expected))


def _negative(numbers):
    return np.signbit(numbers) & ~np.isnan(numbers)


def extremes(a, b, c):
    return max(a, b, c), min(a, b, c), max(a, 1), min(2, b)


def comparisons(a, b, c):
    chained = a < b <= c, a != b, not a >= c
    return *chained, (a > 0.0) == (b > 0.0), a < b or b > c, (a < b) | (b < c)


def choices(a, b, c):
    if a > b:
        x, y = (a, b) if c > 0.0 else (b, 2)
    elif a < b and not c < 0.0:
        x, y = c, a if b > 1.0 else -a
    else:
        x = y = 0.5
    return x, y


@pytest.mark.parametrize("function", [extremes, comparisons, choices])
def test_numbers(function):
    """Ties, zeros of both signs, infinities, NaN."""
    for arguments in itertools.product(NUMBERS, repeat=3):
        same(function, *arguments)


def test_functions_of_numbers():
    def values(a, b, k):
        return (
            abs(a), abs(k), math.sqrt(abs(a)), math.copysign(a, b), np.floor(a), np.ceil(b),
            math.isnan(a), math.isfinite(b), -a, -k, a**2, a**3, abs(a) ** 0.5, int(b), float(k),
            math.hypot(a, b), k**2, k + a, k * b, 7 / 2, math.hypot(k, k), math.isnan(k),
            abs(a > b),
        )  # fmt: skip

    for arguments in ((2.25, -3.5, 4), (-0.7, 8.0, -3)):
        same(values, *arguments)


def test_whole_numbers_divide_as_in_python():
    def divided(a, b):
        return a // b, a % b, a - b, a * b

    for a, b in itertools.product((-7, -6, 0, 5, 6), (-3, 3)):
        same(divided, a, b)
        same(remainder, a, True)
    for a, b in itertools.product((-0.75, -0.0, 0.0, 0.3, 0.5, NAN), (0.25, -0.25, INF, -INF)):
        same(remainder, a, b)


def remainder(x, y):
    return x % y


def test_truth_values_are_ordered():
    def ordered(a, b):
        yes, no = a > b, a < b
        return yes < no, yes >= no, no < yes, max(yes, no), min(yes, no), yes != no, yes < 1

    same(ordered, 2.0, 1.0)
    same(ordered, 1.0, 2.0)


def test_membership():
    def is_any(a, b):
        return a in (b, 2.0), a in (1, 3)

    for a, b in itertools.product((1.0, 2.0, -0.0), (0.0, 5.0)):
        same(is_any, a, b)


def loops(w, n):
    total, last = 0.0, -1
    for i in range(n):
        if w[i] < 0.0:
            continue
        if w[i] > 100.0:
            break
        total += w[i]
        last = i
    for i in range(n - 1, -1, -1):
        for j in range(i):
            w[j] -= 0.5 * w[i]
    rounds = 0
    while total > 1.0 and rounds < 50:
        total *= 0.5
        rounds += 1
    for half, sign in ((1.0, 1), (-1.0, -1)):
        if total * half < 0.0:
            continue
        total += half * sign
    return total, last, rounds


def test_loops():
    """`continue` and `break`, falling and empty ranges, `while`, loops over tuples."""
    for values in ([3.0, -1.0, 4.0, 200.0, 7.0], [], [0.25]):
        ours, expected = np.array(values), np.array(values)
        assert compiled(loops)(ours, len(values)) == loops(expected, len(values))
        assert_array_equal(ours, expected)


def test_first_values_of_loops():
    """Variables that a branch or the round before has assigned."""

    def search(w, n):
        best, where, previous = w[0], 0, 0.0
        for i in range(n):
            step = w[i] - previous
            found = (best, where)
            if step > 1.0:
                found = (w[i], i)
            if found[0] < best:
                best, where = found
            previous = w[i]
        return best, where, previous

    same(search, np.array([5.0, 6.5, 3.0, 4.5, 2.0]), 5)


@formula
def _norm(v):
    return math.sqrt(v[0] * v[0] + v[1] * v[1])


def _scaled(part, factor):
    noinline()
    (x, y), size = part
    return (factor * x, factor * y), size + 1


def test_calls_take_and_return_nested_tuples():
    def called(x, y):
        part = (x, y), 3
        (a, b), size = _scaled(part, 2.0)
        other = part if _norm(part[0]) > _norm((a, b)) else _scaled(part, 0.5)
        return a, b, size, other, *part

    assert compiled(called)(3.0, 4.0) == (6.0, 8.0, 4, ((1.5, 2.0), 4), (3.0, 4.0), 3)


def test_arrays_and_tuples_at_any_index():
    def read(w, k, x, y):
        items = (x, y, x + y)
        return WEIGHTS[k], TABLE[k, 2], TABLE.shape[1], items[k], len(items), w[k] + w[-1 + 2]

    def mixed(k):
        return MIXED[k]

    for k in range(3):
        same(mixed, k)
        same(read, np.array([1.0, 2.0, 3.0]), k, 0.5, 0.25)


def test_reads_behind_a_condition_are_not_made():
    """An index beyond the array, where the condition is false."""

    def guarded(w, k, n):
        value = w[k] if k < n else -1.0
        return value, k < n and w[k] > 0.0, k >= n or w[k] > 0.0

    far = 10**15
    assert compiled(guarded)(np.array([2.0]), far, 1) == (-1.0, False, True)
    assert compiled(guarded)(np.array([2.0]), 0, 1) == (2.0, True, True)

    def of_tuple(k, x, y):
        items = (x, y)
        return items[k] if k < 2 else 7.0

    same(of_tuple, far, 1.0, 2.0)


def _cleared(w):
    noinline()
    w[0] = 8.0
    return 1.0


def test_an_element_is_read_before_what_is_added_to_it():
    def added(w):
        w[0] += _cleared(w)
        return w[0]

    assert compiled(added)(np.array([2.0])) == added(np.array([2.0])) == 3.0


def early(a):
    if a < 0.0:
        return -1, NAN
    for i in range(9):
        if i * i > a:
            return i, a
    return 9, 0.0


@pytest.mark.parametrize("a", [-1.0, 0.0, 30.0, 1e9])
def test_early_returns(a):
    same(early, a)


def test_only_multiply_adds_are_contracted():
    """Products and sums in other orders would differ in the last bits."""

    def sums(a, b, c):
        return (a + b) + c, (a * b) * c, a / b, (a + b) - a

    random = np.random.default_rng(5)
    for a, b, c in random.normal(size=(200, 3)).tolist():
        same(sums, a, b, c)


# -- what cannot be translated
# --------------------------------------------------------------------------------------------------


def _unknown(a):
    return a + nowhere  # noqa: F821


def _calls_itself(a):
    return _calls_itself_too(a)


def _calls_itself_too(a):
    return _calls_itself_too(0.5 * a)


def _text(a):
    return "text"


def _two_types(a):
    x = 1
    if a > 0.0:
        x = a
    return x


def _tries(a):
    try:
        return a
    finally:
        pass


def _floats_index(w, a):
    return w[a]


def _named(a):
    return max(a, key=1.0)


def _late(n):
    total = 0.0
    for i in range(n):
        if i > 0:
            total += INF  # noqa: F823
        INF = 2.0  # noqa: F841
    return total


def _for_else(n):
    for i in range(n):
        n -= i
    else:  # noqa: PLW0120
        n = 0
    return n


def _operand(a, b):
    return a or b


def _forms_of_choices(a, b):
    return ((a, b), a) if a > b else (a, (b, b))


def _forms_of_a_variable(a, b):
    x = a, b
    if a > b:
        x = ((a, b),)
    return x


def _forms_of_returns(a, b):
    if a > b:
        return a
    return (b,)


def _element_types(w, k, a):
    chosen = w if a > 0.0 else k
    return chosen[0]


def _from_the_end(w):
    return w[-1]


def _long_number(k):
    return k + 10**15 * 10**15


def _largest_of_a_tuple(a, b):
    return max((a, b))


def _identity(a):
    return a is True


def _too_few(a):
    return _norm(a, 1.0)


def _bool_remainder(a):
    return (a > 1.0) % (a > 0.0)


def _inside_of(size):
    def inside(a):
        return a + size

    return inside


@pytest.mark.parametrize(
    ("function", "arguments", "reason"),
    [
        (_unknown, (1.0,), "unknown name nowhere"),
        (_calls_itself, (1.0,), "_calls_itself_too calls itself"),
        (_text, (1.0,), "constant 'text'"),
        (_two_types, (1.0,), "a double does not fit a i64"),
        (_tries, (1.0,), "Try cannot be translated"),
        (_floats_index, (np.ones(2), 1.0), "a whole number for each axis"),
        (_named, (1.0,), "arguments have no names"),
        (_late, (3,), "INF is read before the first assignment in the text"),
        (_for_else, (3,), "a loop has no else"),
        (_operand, (1.0, 2.0), "`and` and `or` are for truth values"),
        (_forms_of_choices, (1.0, 2.0), "values of different forms"),
        (_forms_of_a_variable, (1.0, 2.0), "values of different forms"),
        (_forms_of_returns, (1.0, 2.0), "values of different forms"),
        (_element_types, (np.ones(2), np.ones(2, int), 1.0), "values of different forms"),
        (_from_the_end, (np.ones(2),), "counts from its first element"),
        (_long_number, (1,), "more than 64 bits"),
        (_largest_of_a_tuple, (1.0, 2.0), "two or more numbers"),
        (_identity, (1.0,), "no comparison Is"),
        (_too_few, (1.0,), "_norm takes 1 arguments"),
        (_bool_remainder, (2.0,), "no arithmetic with truth values"),
        (_inside_of(3.0), (1.0,), "uses variables of the function around it"),
    ],
)
def test_other_python_is_refused(function, arguments, reason):
    """With the function and the line."""
    with pytest.raises(TypeError, match=reason):
        compiled(function)(*arguments)


def test_changed_files_are_not_read(tmp_path):
    """The function in memory, not the one that is in its file by now, is what a caller means."""
    path = tmp_path / "module.py"
    path.write_text("def half(x):\n    return 0.5 * x\n")
    names = {}
    exec(compile(path.read_text(), path, "exec"), names)
    path.write_text("def half(x):\n    return 0.6 * x\n")
    with pytest.raises(TypeError, match="the file of half has changed"):
        compiled(names["half"])(1.0)


def test_place_of_an_error():
    with pytest.raises(TranslationError, match=r"_unknown, line \d+: "):
        compiled(_unknown)(1.0)
