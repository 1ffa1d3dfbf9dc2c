"""Explicit Runge-Kutta methods as data. Each checks itself when it is made: row sums of the stage
matrix, order conditions of quadrature, error weights, and the end of the continuous extension."""

from dataclasses import dataclass
from functools import cache

import numpy as np

from sepmc.kernel.spec import dop853_coefficients as dop
from sepmc.kernel.spec import sharp9_coefficients as sharp


@dataclass(frozen=True)
class Method:
    """Explicit Runge-Kutta method of s stages and of the order ``order``, with or without a
    continuous extension. Raises ValueError if its coefficients contradict each other or its
    order.

    Notes
    -----
    ``a`` (m, m) is the stage matrix, ``c`` (m,) the nodes, ``b`` (s,) the weights; rows of ``a``
    from index s on are stages that only the extension needs. The state at the fraction theta of a
    step of length h is ``y0 + h sum_i k_i sum_j dense[i, j] theta^j`` with j from 0, of order
    ``dense_order``; without an extension ``dense`` has no columns.

    ``h sum_i k_i error_weights_i`` over the s stages is a low-order estimate of the local error:
    much larger than the error, but it varies from case to case as the error does.

    ``within`` has the indices of some stages at times inside the step, in the order of time, whose
    states are among the most accurate. The coefficients are checked when a method is made.
    """

    name: str
    order: int
    a: np.ndarray
    b: np.ndarray
    c: np.ndarray
    dense: np.ndarray
    dense_order: int
    error_weights: np.ndarray
    within: tuple[int, ...] = ()

    def __post_init__(self):
        if not np.allclose(
            self.a.sum(axis=1), self.c, rtol=0, atol=1e-14 * np.abs(self.a).sum(axis=1).max()
        ):
            raise ValueError(
                f"method {self.name}: the rows of the stage matrix a do not sum to the nodes c"
            )
        nodes = self.c[: len(self.b)]
        for power in range(self.order):
            if abs(self.b @ nodes**power - 1.0 / (power + 1)) > 1e-13:
                raise ValueError(
                    f"method {self.name}: the weights b do not integrate t^{power} from 0 to 1"
                )
        if not abs(self.error_weights @ nodes) + abs(self.error_weights.sum()) < 1e-12:
            raise ValueError(
                f"method {self.name}: the error weights do not vanish for a linear derivative"
            )
        full = np.zeros(len(self.dense))
        full[: len(self.b)] = self.b
        if self.has_extension and not np.allclose(
            self.dense.sum(axis=1), full, rtol=0, atol=1e-12 * np.abs(self.dense).max()
        ):
            raise ValueError(
                f"method {self.name}: the continuous extension at theta = 1 is not the end of the "
                "step"
            )

    @property
    def stages(self) -> int:
        """Number s of evaluations of the derivative in a step, without those of the extension."""
        return len(self.b)

    @property
    def curve(self) -> np.ndarray:
        """Matrix, shape (k + 4, k + 4) for k stages ``within``, that fits a polynomial p'' to the
        second derivative of a function y over a step of unit length.

        It maps the vector of y'' at the start, at the stages ``within`` and at the end of the step,
        then y'(1) - y'(0), then y(1) - y(0) - y'(0), to the coefficients of p'' by ascending powers
        of the fraction of the step.
        """
        shares = np.array([0.0, *self.c[list(self.within)], 1.0])
        powers = np.arange(len(shares) + 2)
        rows = [*(shares[:, None] ** powers), 1.0 / (powers + 1)]
        return np.asarray(np.linalg.inv([*rows, 1.0 / ((powers + 1) * (powers + 2))]))

    @property
    def has_extension(self) -> bool:
        """True if the method has a continuous extension."""
        return self.dense.shape[1] > 0


def _rk4() -> Method:
    """Method rk4: the classical one of order 4, with an extension of order 3 (Hairer, Norsett,
    Wanner, Solving ODE I, II.6, eq 6.8 ff.). Its error estimate is a third of the step's length
    times the difference of the derivatives at the second and third stages, both in mid-step."""
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
        (2,),
    )


def _dop853() -> Method:
    """Method dop853: Dormand and Prince, order 8 in twelve stages, with an extension of order 7 by
    four more stages (Hairer, Norsett, Wanner, Solving ODE I, II.5, II.6)."""
    stages, total = 12, 16
    a = _matrix(total, dop.A)
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
    return Method("dop853", 8, a, b, np.array(dop.C), dense, 7, np.array(dop.E5), (6, 9, 10))


def _dopri5() -> Method:
    """Method dopri5: Dormand and Prince, order 5 in six stages, with a seventh stage for the
    extension of order 4 (Hairer, Norsett, Wanner, Solving ODE I, II.5, table 5.2, II.6)."""
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
    # the published pair needs the seventh stage
    error_weights = _divided_difference(c[:6], [i for i in range(6) if b[i] != 0.0])
    return Method("dopri5", 5, a, b, c, dense, 4, error_weights, (2, 3))


def _tp7() -> Method:
    """Method tp7: Tsitouras and Papakostas, order 7 in nine stages, with an embedded method of
    order 5 and no extension (Cheap error estimation for Runge-Kutta methods, SIAM J. Sci. Comput.
    20 (1999) 2067, NEW7(5))."""
    a = np.zeros((9, 9))
    a[1, 0], a[2, 1] = 1 / 18, 1 / 9
    a[3, [0, 2]] = [1 / 24, 1 / 8]
    a[4, [0, 2, 3]] = [2183971 / 4000000, -8340813 / 4000000, 3968421 / 2000000]
    a[5, [0, *range(2, 5)]] = [695768212 / 7463744411, -1803549175 / 7007942496,
                               3474507053 / 6790877290, 2188198899 / 15264927763]  # fmt: skip
    a[6, [0, *range(2, 6)]] = [-11894934857 / 8390623634, 53094780276 / 9800512003,
                               -8415376229 / 2277049503, -18647567697 / 10138317907,
                               27551494893 / 11905950217]  # fmt: skip
    a[7, [0, *range(2, 7)]] = [30828057951 / 7654644085, -4511704 / 324729,
                               16217851618 / 1651177175, 282768186839 / 40694064384,
                               -104400780537 / 15869257619, 5409241639 / 9600177208]  # fmt: skip
    a[8, [0, *range(2, 8)]] = [-133775720546 / 36753383835, 49608695511 / 4066590848,
                               -59896475201 / 7901259813, -48035527651 / 5727379426,
                               86266718551 / 10188951048, -7751618114 / 23575802495,
                               2289274942 / 8464405725]  # fmt: skip
    b, embedded, used = np.zeros(9), np.zeros(9), [0, *range(3, 9)]
    b[used] = [597988726 / 12374436915, 3138312158 / 11968408119, 480882843 / 7850665645,
               988558885 / 3512253271, 5302636961 / 26425940286, 1259489433 / 12163586030,
               1016647712 / 23899101975]  # fmt: skip
    embedded[used] = [1421940313 / 46193547077, 1943068601 / 5911217046, -3807140880 / 8205366359,
                      9377220888 / 11577671635, 586186883 / 5187186385, 1114095023 / 8014791121,
                      1016647712 / 23899101975]  # fmt: skip
    c = np.array([0.0, 1 / 18, 1 / 9, 1 / 6, 89 / 200, 56482 / 115069, 74 / 95, 8 / 9, 1.0])
    return Method("tp7", 7, a, b, c, np.empty((9, 0)), 0, b - embedded, (3, 5, 6))


def _sharp9() -> Method:
    """Method sharp9: Sharp, order 9 in fifteen stages, without an extension
    (`sepmc.kernel.spec.sharp9_coefficients`)."""
    stages = 15
    a, b, c = _matrix(stages, sharp.A), np.zeros(stages), np.array(sharp.C)
    b[list(sharp.B)] = list(sharp.B.values())
    error_weights = _divided_difference(c, [0, 9, 8, 10, 11, 12, 14])
    return Method("sharp9", 9, a, b, c, np.empty((stages, 0)), 0, error_weights, (9, 7, 12))


def _matrix(size: int, entries: dict[tuple[int, int], float]) -> np.ndarray:
    """Matrix, shape (size, size), with the given entries by (row, column), zero elsewhere."""
    matrix = np.zeros((size, size))
    for index, value in entries.items():
        matrix[index] = value
    return matrix


def _divided_difference(c: np.ndarray, used: list[int]) -> np.ndarray:
    """Weights, one for each node in ``c``, that give the divided difference of the derivatives at
    the nodes with the indices ``used``; zero for the other nodes."""
    weights = np.zeros(len(c))
    weights[used] = [1.0 / np.prod([c[i] - c[j] for j in used if j != i]) for i in used]
    return weights


METHODS = {"rk4": _rk4, "dopri5": _dopri5, "tp7": _tp7, "dop853": _dop853, "sharp9": _sharp9}
AUTO = "auto"  # as a method name: the method that takes the least work, for each segment
# method of segments in which states between the ends of steps are needed, for AUTO or if the
# method of the scene has no continuous extension
_EXTENDED = "dop853"
_SMOOTH = ("sharp9", "tp7")  # for AUTO: methods of the other segments, the most accurate first


@cache
def method(name: str) -> Method:
    """Runge-Kutta method by name; AUTO gives dop853, which has a continuous extension.

    Parameters
    ----------
    name : str
        key of `METHODS`, or AUTO

    Returns
    -------
    Method
    """
    return METHODS[_EXTENDED if name == AUTO else name]()


def methods_of(name: str, extended: bool, others: bool = False) -> tuple[Method, ...]:
    """Methods that a segment may be integrated by; a campaign then selects one of them.

    Parameters
    ----------
    name : str
        ``solver.method`` of the scene: key of `METHODS`, or AUTO
    extended : bool
        True if the segment needs states between the ends of steps: only methods with a continuous
        extension are returned then, and dop853 replaces a named method without one
    others : bool
        True if any segment of the kernel needs states between the ends of steps, so that dop853 is
        compiled anyway: AUTO then offers it for the other segments too

    Returns
    -------
    tuple of Method
        the most accurate first; one method unless ``name`` is AUTO
    """
    if name == AUTO:
        smooth = (*_SMOOTH, _EXTENDED) if others else _SMOOTH
        return tuple(map(method, (_EXTENDED,) if extended else smooth))
    return (method(name if method(name).has_extension or not extended else _EXTENDED),)
