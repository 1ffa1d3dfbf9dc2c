"""Runge-Kutta methods as data: each checks its own row sums and order conditions of quadrature. No
numba here."""

from dataclasses import dataclass, field
from functools import cache

import numpy as np

from sepmc.kernel import dop853_coefficients as dop


@dataclass(frozen=True)
class Method:
    """An explicit Runge-Kutta method with a continuous extension.

    ``a`` (m, m) holds the stage matrix and, below row ``len(b)``, the stages only the extension
    needs; ``c`` (m,) the nodes; ``b`` (s,) the weights. The state at fraction theta of a step is
    ``y0 + h sum_i k_i sum_j dense[i, j] theta^j``. ``h sum_i k_i doubt_i`` is an estimate of low
    order of what a step does wrong: much larger than that, but it grows as that grows from case to
    case.
    """

    name: str
    order: int
    a: np.ndarray
    b: np.ndarray
    c: np.ndarray
    dense: np.ndarray
    dense_order: int
    doubt: np.ndarray
    checked: bool = field(init=False, default=True)

    def __post_init__(self):
        if not np.allclose(
            self.a.sum(axis=1), self.c, rtol=0, atol=1e-14 * np.abs(self.a).sum(axis=1).max()
        ):
            raise ValueError(f"{self.name}: rows of the stage matrix do not sum to the nodes")
        nodes = self.c[: len(self.b)]
        for power in range(self.order):
            if abs(self.b @ nodes**power - 1.0 / (power + 1)) > 1e-13:
                raise ValueError(f"{self.name}: the weights do not integrate degree {power}")
        if not abs(self.doubt @ nodes) + abs(self.doubt.sum()) < 1e-12:
            raise ValueError(f"{self.name}: doubt where a derivative grows evenly")
        full = np.zeros(len(self.dense))
        full[: len(self.b)] = self.b
        if not np.allclose(
            self.dense.sum(axis=1), full, rtol=0, atol=1e-12 * np.abs(self.dense).max()
        ):
            raise ValueError(f"{self.name}: the continuous extension does not end on the step")


def _rk4() -> Method:
    """The classical method; extension of order 3 (Hairer, Norsett, Wanner, Solving ODE I, II.6, eq
    6.8 ff.)."""
    a = np.zeros((4, 4))
    a[1, 0] = a[2, 1] = 0.5
    a[3, 2] = 1.0
    b = np.array([1.0, 2.0, 2.0, 1.0]) / 6.0
    dense = np.array(
        [
            [0.0, 1.0, -1.5, 2.0 / 3.0],
            [0.0, 0.0, 1.0, -2.0 / 3.0],
            [0.0, 0.0, 1.0, -2.0 / 3.0],
            [0.0, 0.0, -0.5, 2.0 / 3.0],
        ]
    )
    return Method(
        "rk4",
        4,
        a,
        b,
        np.array([0.0, 0.5, 0.5, 1.0]),
        dense,
        3,
        np.array([0.0, 1.0, -1.0, 0.0]) / 3.0,
    )


def _dop853() -> Method:
    """Dormand and Prince, order 8, twelve stages; extension of order 7 with four more (Hairer,
    Norsett, Wanner, II.5, II.6)."""
    stages, total = 12, 16
    a = np.zeros((total, total))
    for (i, j), value in dop.A.items():
        a[i, j] = value
    b = a[stages, :stages].copy()
    # The extension is y0 + t (F0 + u (F1 + t (F2 + u (F3 + ...)))), u = 1 - t; written here as
    # powers of t per stage.
    unit = np.eye(total)
    f = np.zeros((7, total))
    f[0, :stages] = b
    f[1] = unit[0] - f[0]
    f[2] = 2.0 * f[0] - unit[stages] - unit[0]
    for (i, j), value in dop.D.items():
        f[3 + i, j] = value
    dense = np.zeros((total, 8))
    for i in range(total):
        poly = np.polynomial.Polynomial([0.0])
        for k in range(6, -1, -1):
            poly = (poly + f[k, i]) * np.polynomial.Polynomial(
                [0.0, 1.0] if k % 2 == 0 else [1.0, -1.0]
            )
        dense[i, : len(poly.coef)] = poly.coef[:8]
    return Method("dop853", 8, a, b, np.array(dop.C), dense, 7, np.array(dop.E5))


def _dopri5() -> Method:
    """Dormand and Prince, order 5, with its seventh stage for the extension of order 4 (Hairer,
    Norsett, Wanner, II.5, table 5.2, II.6)."""
    a = np.zeros((7, 7))
    a[1, :1] = [1 / 5]
    a[2, :2] = [3 / 40, 9 / 40]
    a[3, :3] = [44 / 45, -56 / 15, 32 / 9]
    a[4, :4] = [19372 / 6561, -25360 / 2187, 64448 / 6561, -212 / 729]
    a[5, :5] = [9017 / 3168, -355 / 33, 46732 / 5247, 49 / 176, -5103 / 18656]
    a[6, :6] = b = np.array([35 / 384, 0.0, 500 / 1113, 125 / 192, -2187 / 6784, 11 / 84])
    d = [-12715105075 / 11282082432, 0.0, 87487479700 / 32700410799, -10690763975 / 1880347072,
         701980252875 / 199316789632, -1453857185 / 822651844, 69997945 / 29380423]  # fmt: skip
    # The extension is y0 + t (F0 + u (F1 + t (F2 + u F3))), u = 1 - t
    unit = np.eye(7)
    f0 = np.append(b, 0.0)
    f1 = unit[0] - f0
    f2 = 2.0 * f0 - unit[6] - unit[0]
    f3 = np.array(d)
    dense = np.stack([np.zeros(7), f0 + f1, -f1 + f2 + f3, -f2 - 2.0 * f3, f3], axis=1)
    c = np.array([0.0, 1 / 5, 3 / 10, 4 / 5, 8 / 9, 1.0, 1.0])
    used = [i for i in range(6) if b[i] != 0.0]
    # a divided difference of derivatives over the nodes: the published pair needs the seventh stage
    doubt = np.zeros(6)
    doubt[used] = [1.0 / np.prod([c[i] - c[j] for j in used if j != i]) for i in used]
    return Method("dopri5", 5, a, b, c, dense, 4, doubt)


METHODS = {"rk4": _rk4, "dopri5": _dopri5, "dop853": _dop853}


@cache
def method(name: str) -> Method:
    """The method called ``name``."""
    return METHODS[name]()
