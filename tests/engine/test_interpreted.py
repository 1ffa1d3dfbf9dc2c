"""Kernels as plain Python: Python's numbers, with division, rounding and roots as in compiled
code."""

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
def test_division_powers_and_roots(plain, name):
    """As in numpy, bit for bit, with signs of zeros and infinities; and Python's own numbers."""
    reference = {}
    exec(compile(TEXT.replace("math.sqrt", "np.sqrt"), "numpy's", "exec"), reference)
    with np.errstate(all="ignore"):
        for a, b in itertools.product(NUMBERS, NUMBERS):
            result, expected = (
                getattr(plain, name)(a, b),
                reference[name](np.float64(a), np.float64(b)),
            )
            assert type(result) is float
            assert_array_equal(result, expected, err_msg=f"{name}({a}, {b})")
            assert math.copysign(1.0, result) == math.copysign(1.0, expected) or math.isnan(result)


@pytest.mark.parametrize("n", [2, 24])
@pytest.mark.parametrize("defect", ["", "rows alike", "zero row", "NaN", "last NaN"])
def test_elimination_agrees_with_kernels(plain, n, defect):
    """As the routine of the kernels; half of the numbers are zero, so that rows are exchanged."""
    random, size = np.random.default_rng(7), n * n + n
    for _ in range(20):
        matrix = random.normal(size=(n, n)) * (random.random((n, n)) < 0.5) + np.eye(n)
        if defect == "rows alike":
            matrix[1] = matrix[0]
        elif defect == "zero row":
            matrix[1] = 0.0
        elif defect:
            matrix[(0, 1) if defect == "NaN" else (n - 1, n - 1)] = math.nan
        known = random.normal(size=n)
        numbers = [*matrix.ravel().tolist(), *known.tolist(), *[0.0] * (size + n)]
        expected = numbers[:size]
        pivot = linear.solve_lu(expected, 0, n * n, n)
        smallest = plain.linear.eliminate(numbers, 0, n, size, 2 * size)
        assert smallest == pytest.approx(pivot, rel=1e-9)
        solution = expected[n * n :] if pivot > 0.0 else np.full(n, math.nan)
        assert_allclose(numbers[2 * size :], solution, rtol=1e-9, atol=1e-11)
        if not defect:
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
    rank, _ = plain.linear.solve_min_norm(w, 0, 3, 12 * lanes, 9 * lanes)
    assert rank == 2
    assert_allclose(w[9 * lanes : 12 * lanes : lanes], wanted, atol=20.0 * round_off + 1e-14)


def test_compiled_formulas_are_unchanged(plain):
    """The second copies are separate modules, with the line numbers of the files."""
    assert plain.vec3 is not vec3
    assert (
        plain.vec3.dot((1.0, 2.0, 3.0), (4.0, 5.0, 6.0))
        == vec3.dot((1.0, 2.0, 3.0), (4.0, 5.0, 6.0))
        == 32.0
    )
    assert plain.vec3.dot.__code__.co_firstlineno == vec3.dot.__code__.co_firstlineno
    assert plain.elementary.sine_cosine(0.3) == pytest.approx(
        (math.sin(0.3), math.cos(0.3)), abs=1e-15
    )
    assert type(plain.elementary.sine_cosine(0.3)[0]) is float


def test_functions_that_kernels_share_are_compiled_once():
    """Each has its line number in the kernel that it runs in."""
    text = step_selection.kernel_text(sepmc.load("table2.toml"))
    longer = text.replace("import math\n", "import math\n\nLINES = 2\n")
    code = {}
    for kernel_text in (text, longer):
        kernel = interpreted.load(kernel_text)
        lines = kernel_text.splitlines()
        for name in ("rates_phase1", "integrate_block"):
            function = vars(kernel.plain)[name].__wrapped__
            assert lines[function.__code__.co_firstlineno].startswith(f"def {name}(")
            code.setdefault(name, []).append(function.__code__)
    for one, other in code.values():
        assert other.co_firstlineno == one.co_firstlineno + 2
        assert other.co_consts is one.co_consts


@pytest.mark.slow
@pytest.mark.parametrize(
    "name",
    ["table2.toml", str(Path(__file__).parents[1] / "data" / "everything.toml"), "hyper-x.toml"],
)
def test_workspace_has_pythons_numbers(name):
    """No number of the workspace is one of numpy's, which would slow down all that depends on
    it."""
    campaign = sepmc.load(name)
    kernel = interpreted.load(step_selection.kernel_text(campaign))
    seen, original = [], kernel.plain.integrate_block

    def integrate_block(w, first, arrays):
        original(w, first, arrays)
        seen.extend(w)

    kernel.plain.integrate_block = integrate_block
    steps, typical = (
        np.full(kernel.n_segments, 2),
        np.full(kernel.n_segments, campaign.scene.run.end_time / 3.0),
    )
    integrate_cases(
        kernel,
        campaign.layout,
        steps,
        typical,
        campaign.slots,
        step_selection.calibration_sample(campaign, 1),
    )
    kernel.plain.integrate_block = original
    assert {type(x) for x in seen} == {float}
