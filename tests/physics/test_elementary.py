"""Elementary functions, the standard atmosphere in a layer and predicted crossing times, against 60
digits or printed tables."""

import itertools
import math

import mpmath
import numpy as np
import pytest
from numpy.testing import assert_allclose
from support.compiled import compiled

from sepmc.physics.atmosphere import (
    NEAR,
    density_in_layer,
    density_near,
    density_series,
    geopotential,
    geopotential_rise,
    in_layer,
    us1976,
)
from sepmc.physics.elementary import (
    arctan2,
    arctan2_of_two,
    exponential,
    power_of_two,
    sine_cosine,
)
from sepmc.physics.gravity import inverse_square, inverse_square_near
from sepmc.physics.us1976_table import R0
from sepmc.routines.lanes import larger, nearest_turn, time_left

density_in_layer = compiled(density_in_layer)
density_near = compiled(density_near)
density_series = compiled(density_series)
geopotential = compiled(geopotential)
geopotential_rise = compiled(geopotential_rise)
in_layer = compiled(in_layer)
arctan2 = compiled(arctan2)
arctan2_of_two = compiled(arctan2_of_two)
exponential = compiled(exponential)
sine_cosine = compiled(sine_cosine)
inverse_square = compiled(inverse_square)
inverse_square_near = compiled(inverse_square_near)
larger = compiled(larger)
nearest_turn = compiled(nearest_turn)
time_left = compiled(time_left)
us1976 = compiled(us1976)


@compiled
def compiled_power(k):
    return power_of_two(k)


SAMPLES = 1000
INF, NAN = math.inf, math.nan


@pytest.fixture(scope="module", autouse=True)
def digits():
    """60 digits for all references."""
    with mpmath.workdps(60):
        yield


def units(result, exact):
    """Error in units of the last place of the exact value."""
    return float(abs(mpmath.mpf(float(result)) - exact) / mpmath.mpf(math.ulp(float(exact))))


def spread(low, high, n=SAMPLES, seed=1):
    """Random numbers of a range."""
    return np.random.default_rng(seed).uniform(low, high, n)


# -- exponential
# --------------------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("low", "high"), [(-708.4, 709.0), (-40.0, 1.0), (-0.4, 0.4), (-1e-8, 1e-8)]
)
def test_exponential(low, high):
    """Over the whole range, the range of the atmosphere and near 0: within one unit in the last
    place."""
    values = [
        *spread(low, high),
        low,
        high,
        *(k * math.log(2.0) / 2.0 for k in range(-5, 6) if low <= k * math.log(2.0) / 2.0 <= high),
    ]
    assert max(units(exponential(x), mpmath.exp(x)) for x in values) <= 1.0


@pytest.mark.parametrize(
    ("x", "expected"),
    [
        (0.0, 1.0),
        (-0.0, 1.0),
        (INF, INF),
        (-INF, 0.0),
        (NAN, NAN),
        (709.1, INF),
        (1e300, INF),
        (-708.5, 0.0),
        (-1e300, 0.0),
        (5e-324, 1.0),
    ],
)
def test_exponential_at_its_edges(x, expected):
    assert exponential(x) == pytest.approx(expected, abs=0, rel=0, nan_ok=True)


def test_exponential_rises_across_its_seams():
    """Where k changes, it decreases by no more than round-off."""
    for k in range(-20, 21):
        x = (k + 0.5) * math.log(2.0)
        around = [exponential(x * (1.0 + i * 1e-15)) for i in range(-3, 4)]
        assert_allclose(
            around, [math.exp(x * (1.0 + i * 1e-15)) for i in range(-3, 4)], rtol=4e-16, atol=0
        )


def test_power_of_two():
    """Exact, from the smallest normal number to the largest power; compiled and in Python."""
    for k in (-1022, -1021, -1, 0, 1, 52, 1000, 1023):
        assert power_of_two(float(k)) == math.ldexp(1.0, k)
        assert compiled_power(float(k)) == math.ldexp(1.0, k)
    assert math.isnan(power_of_two(NAN))


# -- arctan2
# --------------------------------------------------------------------------------------------------


def test_arctan2():
    """All quadrants, ratios of 1e-16 to 1e16: within 2.5 units in the last place, since pi / 2 and
    pi are added as doubles."""
    rng = np.random.default_rng(2)
    points = rng.normal(size=(4 * SAMPLES, 2)) * 10.0 ** rng.uniform(-8, 8, (4 * SAMPLES, 2))
    assert max(units(arctan2(y, x), mpmath.atan2(y, x)) for y, x in points.tolist()) <= 2.5


def test_arctan2_of_small_angles():
    """Alpha and beta near the flight path: ratios below tan(pi / 8), in front; within one unit in
    the last place."""
    points = [(y, 1.0) for y in 10.0 ** spread(-12, math.log10(0.4), seed=3)]
    assert max(units(arctan2(y, x), mpmath.atan2(y, x)) for y, x in points) <= 1.0


@pytest.mark.parametrize(
    ("y", "x"),
    [
        *itertools.product((0.0, -0.0), (1.0, -1.0, 1e-300, -1e300)),
        *itertools.product((1.0, -1.0, 1e-300, -1e300), (0.0, -0.0)),
        *itertools.product((1.0, -2.0), (INF, -INF)),
        *itertools.product((INF, -INF), (1.0, -2.0)),
        *itertools.product((1.0, -1.0), (1.0, -1.0)),
        (5e-324, 1.0),
        (1.0, 5e-324),
        (0.0, 0.0),
        (-0.0, 0.0),
    ],
)
def test_arctan2_at_its_edges(y, x):
    """Axes, signed zeros, infinities and diagonals as in the library, with the sign of zero."""
    result, expected = arctan2(y, x), math.atan2(y, x)
    assert result == pytest.approx(expected, rel=2.3e-16, abs=0)
    assert math.copysign(1.0, result) == math.copysign(1.0, expected)


@pytest.mark.parametrize(
    ("y", "x"), [(NAN, 1.0), (1.0, NAN), (NAN, NAN), (0.0, NAN), (NAN, 0.0), (NAN, INF)]
)
def test_arctan2_keeps_nan(y, x):
    assert math.isnan(arctan2(y, x))


def test_arctan2_is_continuous_across_its_seams():
    """Where the formula changes: at tan(pi / 8), one, and where the larger coordinate changes."""
    for seam in (
        math.pi / 8,
        math.pi / 4,
        3 * math.pi / 8,
        math.pi / 2,
        5 * math.pi / 8,
        3 * math.pi / 4,
        7 * math.pi / 8,
    ):
        for angle in (seam - 1e-12, seam, seam + 1e-12):
            for sign in (1.0, -1.0):
                assert arctan2(sign * math.sin(angle), math.cos(angle)) == pytest.approx(
                    sign * angle, rel=0, abs=1e-15
                )


# -- sine and cosine
# --------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("size", [1e-3, 0.8, 7.0, 1e3, 1e5])
def test_sine_and_cosine(size):
    """Absolute error 2e-16 up to 1e5 rad; within two units in the last place, also near the zeros
    of either."""
    near = np.round(spread(-size, size, 200, seed=4) / (math.pi / 2)) * (math.pi / 2)
    for x in [*spread(-size, size).tolist(), *near.tolist()]:
        sine, cosine = sine_cosine(x)
        exact = mpmath.sin(x), mpmath.cos(x)
        assert abs(sine - exact[0]) <= 2e-16
        assert abs(cosine - exact[1]) <= 2e-16
        assert x == 0.0 or units(sine, exact[0]) <= 2.0
        assert units(cosine, exact[1]) <= 2.0


def test_sine_and_cosine_in_every_quadrant():
    """At and near the multiples of pi / 4, where the quadrant changes."""
    for k in range(-17, 18):
        for shift in (-1e-9, 0.0, 1e-9):
            x = k * math.pi / 4 + shift
            assert_allclose(sine_cosine(x), (math.sin(x), math.cos(x)), rtol=0, atol=2.3e-16)


def test_sine_and_cosine_at_their_edges():
    assert sine_cosine(0.0) == (0.0, 1.0)
    assert sine_cosine(-0.0) == (0.0, 1.0)
    assert sine_cosine(1e-300) == (1e-300, 1.0)
    for x in (NAN, INF, -INF):
        assert np.isnan(sine_cosine(x)).all()


# -- air
# --------------------------------------------------------------------------------------------------

# NOAA-S/T 76-1562, table 4: base, lapse rate, and with them temperature and pressure at the base by
# eqs (23), (33) in 60 digits
BASES = [
    (0.0, -6.5e-3),
    (11e3, 0.0),
    (20e3, 1e-3),
    (32e3, 2.8e-3),
    (47e3, 0.0),
    (51e3, -2.8e-3),
    (71e3, -2e-3),
    (84_852.0, 0.0),
]


def exact_air(height):
    """Density, pressure, temperature at a geometric height, by the formulas of the standard with
    powers and exponentials, 60 digits."""
    h = mpmath.mpf(R0) * height / (mpmath.mpf(R0) + height)
    gmr = mpmath.mpf("9.80665") * mpmath.mpf("28.9644") / mpmath.mpf("8314.32")
    t, p = mpmath.mpf("288.15"), mpmath.mpf(101325)
    for (base, lapse), (top, _) in itertools.pairwise(BASES):
        rate, up = mpmath.mpf(str(lapse)), min(h, mpmath.mpf(top) if top < 84e3 else h) - base
        warm = t + rate * up
        p *= mpmath.exp(-gmr * up / t) if lapse == 0.0 else (t / warm) ** (gmr / rate)
        t = warm
        if h <= top:
            break
    return p * mpmath.mpf("28.9644") / (mpmath.mpf("8314.32") * t), p, t


def geometric(h):
    return R0 * h / (R0 - h)


def test_air_by_the_formulas_of_the_standard():
    """Powers and exponentials of the standard against the common series: round-off of exp(-13) and
    ten operations."""
    edges = [geometric(base) * (1.0 + s) for base, _ in BASES[1:7] for s in (-1e-12, 0.0, 1e-12)]
    for height in [*spread(0.0, 86e3, 300, seed=5).tolist(), *edges, 0.0, 86e3]:
        assert_allclose(
            us1976(height),
            [float(x) for x in exact_air(height)],
            rtol=4e-15,
            atol=0,
            err_msg=str(height),
        )


# Base of each layer in geopotential height, m', kelvin, millibar: table 4 and, for pressure and
# density (kg/m3), table I of the standard
@pytest.mark.parametrize(
    ("h", "t", "mb", "rho"),
    [
        (0.0, 288.15, 1013.25, 1.2250),
        (11e3, 216.65, 226.3206, 3.6391e-1),
        (20e3, 216.65, 54.74889, 8.8034e-2),
        (32e3, 228.65, 8.680187, 1.3225e-2),
        (47e3, 270.65, 1.109063, 1.4275e-3),
        (51e3, 270.65, 0.6693887, 8.6160e-4),
        (71e3, 214.65, 0.03956420, 6.4211e-5),
    ],
)
def test_air_at_the_printed_bases(h, t, mb, rho):
    """Half a unit of the last printed digit, from both sides of the edge."""
    for side in (-1e-6, 0.0, 1e-6):
        if h + side >= 0.0:
            density, pressure, temperature = us1976(geometric(h + side))
            assert_allclose([temperature, pressure], [t, 100.0 * mb], rtol=1e-6)
            assert_allclose(density, rho, rtol=5e-5)


@pytest.mark.parametrize(("low", "lapse"), BASES[:7])
def test_air_of_a_layer_extends_beyond_its_edges(low, lapse):
    """Lanes keep the layer they started a step in: 500 m beyond either end its formula is valid to
    round-off (the case is then rejected)."""
    k = [base for base, _ in BASES].index(low)
    base_air = exact_air(geometric(low))
    layer = (low, lapse / float(base_air[2]), 1.0 / float(base_air[2]), float(base_air[1]))
    for h in (low - 500.0, low, 0.5 * (low + BASES[k + 1][0]), BASES[k + 1][0] + 500.0):
        up = mpmath.mpf(h) - low
        t = base_air[2] + mpmath.mpf(str(lapse)) * up
        gmr = mpmath.mpf("9.80665") * mpmath.mpf("28.9644") / mpmath.mpf("8314.32")
        p = base_air[1] * (
            mpmath.exp(-gmr * up / t)
            if lapse == 0.0
            else (base_air[2] / t) ** (gmr / mpmath.mpf(str(lapse)))
        )
        rho = p * mpmath.mpf("28.9644") / (mpmath.mpf("8314.32") * t)
        assert_allclose(in_layer(geometric(h), layer), [float(p), float(t)], rtol=1e-14)
        assert_allclose(density_in_layer(geometric(h), layer), float(rho), rtol=1e-14)


def test_geopotential():
    """Eq (18), and its printed values: 86 km is 84,852 m', 11,019 m is 11 km'."""
    assert geopotential(86e3) == pytest.approx(84_852.0, abs=0.1)
    assert geopotential(11_019.1) == pytest.approx(11e3, abs=0.1)
    assert geopotential(0.0) == 0.0


@pytest.mark.parametrize(("low", "lapse"), BASES[:7])
def test_density_about_a_height(low, lapse):
    """The series in the rise against the formula of the layer, to NEAR metres up and down from its
    base, middle and top: 1e-14."""
    k = [base for base, _ in BASES].index(low)
    base_air = exact_air(geometric(low))
    layer = (low, lapse / float(base_air[2]), 1.0 / float(base_air[2]), float(base_air[1]))
    for h in (low, 0.5 * (low + BASES[k + 1][0]), BASES[k + 1][0]):
        height = geometric(h)
        series = density_series(height, layer)
        for rise in np.linspace(-NEAR, NEAR, 21):
            above = geopotential(height + rise) - geopotential(height)
            assert_allclose(
                density_near(series, above),
                density_in_layer(height + rise, layer),
                rtol=2e-14,
                atol=0,
            )


@pytest.mark.parametrize("height", [0.0, 20e3, 86e3, 400e3])
def test_rises_about_a_height(height):
    """Geopotential height and gravity after a rise, to NEAR metres up and down, against 60
    digits."""
    one, centre = mpmath.mpf(1), mpmath.mpf(R0) + mpmath.mpf(height)
    for rise in np.linspace(-NEAR, NEAR, 21):
        if rise != 0.0:
            exact = (
                R0 * (mpmath.mpf(height) + rise) / (centre + rise)
                - R0 * mpmath.mpf(height) / centre
            )
            assert (
                units(geopotential_rise(rise, rise / (R0 + height), R0 / (R0 + height)), exact)
                <= 5.0
            )
        pull = inverse_square(9.80665, height)
        exact = mpmath.mpf(pull) * (one / (one + rise / centre)) ** 2
        assert units(inverse_square_near(pull, rise / (R0 + height)), exact) <= 3.0


# -- lanes
# --------------------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("value", "rate", "acceleration", "jerk", "expected"),
    [
        (-6.0, 2.0, 0.0, 0.0, 3.0),  # straight on
        (-8.0, 0.0, 4.0, 0.0, 2.0),  # from rest: sqrt(2 s / a)
        (-5.0, 1.0, 2.0, 0.0, 0.5 * (math.sqrt(21.0) - 1.0)),
        # decelerates but crosses: the first of two crossings
        (-1.0, 3.0, -2.0, 0.0, 0.5 * (3.0 - math.sqrt(5.0))),
        (0.0, 2.0, 1.0, 0.0, 0.0),  # there
        (4.0, 2.0, 0.0, 0.0, -2.0),  # behind
        (3.0, 4.0, 2.0, 0.0, -1.0),
        (-1e-13, 0.5, 3.0, 1.0, 2e-13 - 1.2e-25),
    ],
)
def test_time_left_in_closed_form(value, rate, acceleration, jerk, expected):
    assert time_left(value, rate, acceleration, jerk) == pytest.approx(
        expected, rel=1e-14, abs=1e-26
    )


@pytest.mark.parametrize(
    ("value", "rate", "acceleration"),
    [(-1.0, 0.0, 0.0), (-1.0, -2.0, 0.0), (-1.0, 0.0, -1.0), (-2.0, 1.0, -1.0), (-1.0, -1.0, -3.0)],
)
def test_time_left_is_infinite_without_a_crossing(value, rate, acceleration):
    """At rest, moving away, or turning back before the crossing."""
    assert time_left(value, rate, acceleration, 0.0) == INF


def test_time_left_with_jerk():
    """Three Newton iterations to the root of the cubic: to round-off for a small jerk, closer than
    without it otherwise."""
    for wait, rate, acceleration, jerk in (
        (0.1, 1.0, 0.5, 2.0),
        (0.5, 2.0, -1.0, 1.5),
        (2.0, 0.3, 0.8, 0.05),
        (1.0, 1.0, 1.0, -1.0),
    ):
        value = -(wait * (rate + wait * (0.5 * acceleration + wait * jerk / 6.0)))
        assert time_left(value, rate, acceleration, jerk) == pytest.approx(wait, rel=1e-9)


def test_time_left_scales():
    """Twice as fast in time: half the time, to the last bit, since the factors are powers of
    two."""
    for value, rate, acceleration, jerk in np.random.default_rng(6).uniform(0.1, 3.0, (50, 4)):
        once = time_left(-value, rate, acceleration, jerk)
        assert time_left(-value, 2.0 * rate, 4.0 * acceleration, 8.0 * jerk) == 0.5 * once


@pytest.mark.parametrize(
    "numbers", [(NAN, 1.0, 0.0, 0.0), (-1.0, NAN, 0.0, 0.0), (-1.0, 1.0, NAN, 0.0)]
)
def test_time_left_of_nan_is_not_finite(numbers):
    """NaN must not give a finite step."""
    assert not math.isfinite(time_left(*numbers))


def test_nearest_turn():
    for last in (-20.0, -math.pi, 0.0, 1.0, 50.0):
        for angle in np.linspace(-math.pi, math.pi, 13):
            result = nearest_turn(angle, last)
            assert abs(result - last) <= math.pi * (1.0 + 1e-12)
            assert math.remainder(result - angle, 2.0 * math.pi) == pytest.approx(0.0, abs=1e-12)


def test_larger_takes_nan_from_the_second():
    assert (larger(1.0, 2.0), larger(2.0, 1.0)) == (2.0, 2.0)
    assert math.isnan(larger(1.0, NAN))


def test_two_arctangents_with_one_division():
    """As each by itself, to a few units in the last place; both zero in still air."""
    random = np.random.default_rng(6)
    points = random.normal(size=(SAMPLES, 4)) * 10.0 ** random.uniform(-8, 8, (SAMPLES, 4))
    for y, x, v, u in points.tolist():
        result = arctan2_of_two(y, x, v, u)
        assert result == pytest.approx((arctan2(y, x), arctan2(v, u)), rel=2e-15, abs=0)
    assert arctan2_of_two(0.0, 0.0, 0.0, 0.0) == (0.0, 0.0)
    assert all(map(math.isnan, arctan2_of_two(NAN, 1.0, NAN, 1.0)))
