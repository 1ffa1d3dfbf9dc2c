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
WEIGHTS, TABLE = (0.5, 0.25, 2.0, 8.0), np.arange(12.0).reshape(3, 4)


def same(function, *arguments):
    """Compare a function compiled and in Python."""
    assert_array_equal(compiled(function)(*arguments), function(*arguments))


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
            math.hypot(a, b), k**2, k + a, k * b, 7 / 2,
        )  # fmt: skip

    for arguments in ((2.25, -3.5, 4), (-0.7, 8.0, -3)):
        same(values, *arguments)


def test_whole_numbers_divide_as_in_python():
    def divided(a, b):
        return a // b, a % b, a - b, a * b

    for a, b in itertools.product((-7, -6, 0, 5, 6), (-3, 3)):
        same(divided, a, b)
    for a, b in itertools.product((-0.75, 0.0, 0.3, 0.5), (0.25, -0.25)):
        same(remainder, a, b)


def remainder(x, y):
    return x % y


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

    for k in range(3):
        same(read, np.array([1.0, 2.0, 3.0]), k, 0.5, 0.25)


def test_reads_behind_a_condition_are_not_made():
    """An index beyond the array, where the condition is false."""

    def guarded(w, k, n):
        value = w[k] if k < n else -1.0
        return value, k < n and w[k] > 0.0, k >= n or w[k] > 0.0

    far = 10**15
    assert compiled(guarded)(np.array([2.0]), far, 1) == (-1.0, False, True)
    assert compiled(guarded)(np.array([2.0]), 0, 1) == (2.0, True, True)


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


@pytest.mark.parametrize(
    ("function", "arguments", "reason"),
    [
        (_unknown, (1.0,), "unknown name nowhere"),
        (_text, (1.0,), "constant 'text'"),
        (_two_types, (1.0,), "a double does not fit a i64"),
        (_tries, (1.0,), "Try cannot be translated"),
        (_floats_index, (np.ones(2), 1.0), "a whole number for each axis"),
        (_named, (1.0,), "arguments have no names"),
    ],
)
def test_other_python_is_refused(function, arguments, reason):
    """With the function and the line."""
    with pytest.raises(TypeError, match=reason):
        compiled(function)(*arguments)


def test_place_of_an_error():
    with pytest.raises(TranslationError, match=r"_unknown, line \d+: "):
        compiled(_unknown)(1.0)
