"""Kernels as plain Python: Python's numbers, which do where they divide, round and take roots what
compiled code does."""

import itertools
import math
from pathlib import Path

import numpy as np
import pytest
from numpy.testing import assert_allclose, assert_array_equal

import sepmc
from sepmc.campaign.execution import step_selection
from sepmc.engine import interpreted
from sepmc.engine.dispatch import integrate_cases
from sepmc.physics import vec3
from sepmc.routines import linear

TEXT = """
import math
import numpy as np
from sepmc.physics import elementary, vec3
from sepmc.routines import linear
from sepmc.routines.clearances import search_clearance
N_INDICATORS, N_SEGMENTS, N_CHANGES, METHODS = 0, 0, 0, ()

def over(a, b):
    return a / b

def within(a, b):
    a /= (b / 3.0) / (a / b)
    return a

def power(a, b):
    return a**b

def root(a, b):
    return math.sqrt(a) + np.floor(b)
"""
NUMBERS = (0.0, -0.0, 1.5, -2.5, math.inf, -math.inf, math.nan, 1e-300, 1e300)


@pytest.fixture(scope="module")
def plain():
    return interpreted.load(TEXT).plain


@pytest.mark.parametrize("name", ["over", "within", "power", "root"])
def test_numbers_without_an_answer(plain, name):
    """As numpy's, bit for bit, signs of zeros and infinities among them; and Python's own
    numbers."""
    numpy_s = {}
    exec(compile(TEXT.replace("math.sqrt", "np.sqrt"), "numpy's", "exec"), numpy_s)
    with np.errstate(all="ignore"):
        for a, b in itertools.product(NUMBERS, NUMBERS):
            found, expected = (
                getattr(plain, name)(a, b),
                numpy_s[name](np.float64(a), np.float64(b)),
            )
            assert type(found) is float
            assert_array_equal(found, expected, err_msg=f"{name}({a}, {b})")
            assert math.copysign(1.0, found) == math.copysign(1.0, expected) or math.isnan(found)


@pytest.mark.parametrize("n", [2, 24])
@pytest.mark.parametrize("spoilt", ["", "rows alike", "zero row", "NaN", "last NaN"])
def test_elimination_is_that_of_the_kernels(plain, n, spoilt):
    """As the routine of the kernels; half of the numbers are zero, so that rows change places."""
    random, size = np.random.default_rng(7), n * n + n
    for _ in range(20):
        matrix = random.normal(size=(n, n)) * (random.random((n, n)) < 0.5) + np.eye(n)
        if spoilt == "rows alike":
            matrix[1] = matrix[0]
        elif spoilt == "zero row":
            matrix[1] = 0.0
        elif spoilt:
            matrix[(0, 1) if spoilt == "NaN" else (n - 1, n - 1)] = math.nan
        known = random.normal(size=n)
        numbers = [*matrix.ravel().tolist(), *known.tolist(), *[0.0] * (size + n)]
        routine_s = numbers[:size]
        pivot = linear.solve_lu.py_func(routine_s, 0, n * n, n)
        found = plain.linear.eliminate(numbers, 0, n, size, 2 * size)
        assert found == pytest.approx(pivot, rel=1e-9)
        solution = routine_s[n * n :] if pivot > 0.0 else np.full(n, math.nan)
        assert_allclose(numbers[2 * size :], solution, rtol=1e-9, atol=1e-11)
        if not spoilt:
            assert_allclose(matrix @ numbers[2 * size :], known, rtol=0, atol=1e-12)


@pytest.mark.parametrize("round_off", [0.0, 1e-14, 2e-13, 5e-12])
def test_rows_dependent_to_round_off_share_by_least_squares(plain, round_off):
    """A pivot that only round-off left is no row of its own: the multipliers are of least norm."""
    rows, lanes = np.array([[1.0, 0.5], [0.2, 1.0], [0.3, -0.7]]), plain.linear.LANES
    matrix, wanted = rows @ rows.T, rows @ [0.3, -0.4]
    right = matrix @ wanted + [0.0, 0.0, round_off]
    matrix[2, 2] *= 1.0 + round_off
    w = [0.0] * (54 * lanes)  # the system, its solution, and scratch
    w[: 9 * lanes : lanes] = [*matrix[np.tril_indices(3)].tolist(), *right.tolist()]
    rank, _ = plain.linear.share(w, 0, 3, 12 * lanes, 9 * lanes)
    assert rank == 2
    assert_allclose(w[9 * lanes : 12 * lanes : lanes], wanted, atol=20.0 * round_off + 1e-14)


def test_the_compiled_formulas_stay_as_they_are(plain):
    """The second copies are modules of their own, with lines where the files have them."""
    assert plain.vec3 is not vec3
    assert (
        plain.vec3.dot((1.0, 2.0, 3.0), (4.0, 5.0, 6.0))
        == vec3.dot((1.0, 2.0, 3.0), (4.0, 5.0, 6.0))
        == 32.0
    )
    assert plain.vec3.dot.__code__.co_firstlineno == vec3.dot.py_func.__code__.co_firstlineno
    assert plain.elementary.sine_cosine(0.3) == pytest.approx(
        (math.sin(0.3), math.cos(0.3)), abs=1e-15
    )
    assert type(plain.elementary.sine_cosine(0.3)[0]) is float


@pytest.mark.parametrize(
    "name",
    ["table2.toml", str(Path(__file__).parents[1] / "data" / "everything.toml"), "hyper-x.toml"],
)
def test_a_flight_is_in_pythons_numbers(name):
    """No number of the workspace is one of numpy's, which would make all that follows from it
    slow."""
    campaign = sepmc.load(name)
    kernel = interpreted.load(step_selection.kernel_text(campaign))
    kept, one = [], kernel.plain.integrate_block

    def integrate_block(w, first, arrays):
        one(w, first, arrays)
        kept.extend(w)

    kernel.plain.integrate_block = integrate_block
    steps, usual = (
        np.full(kernel.n_segments, 2),
        np.full(kernel.n_segments, campaign.scene.run.end_time / 3.0),
    )
    integrate_cases(
        kernel,
        campaign.plan,
        steps,
        usual,
        campaign.slots,
        step_selection.calibration_sample(campaign, 1),
    )
    kernel.plain.integrate_block = one
    assert {type(x) for x in kept} == {float}
