"""Check of the constraint rows of every joint kind: first and second time derivative, C' and C'',
of each constraint function C by the kernels' formulas, against derivatives of C along random
motions."""

import numpy as np

from sepmc.physics import joints
from sepmc.validation.lagrange import KINDS, PERPENDICULAR
from sepmc.validation.line import Line, worst

Array = np.ndarray
STATES = 12  # random states per kind
ROUND_OFF = 1e-11  # relative; the derivatives of C are good to 1e-14
RADIUS, POINTS = (
    0.25,
    48,
)  # radius, s, and points of the circle of complex times on which C is sampled
TIMES = RADIUS * np.exp(2j * np.pi * np.arange(POINTS) / POINTS)
AXES = dict(zip("xyz", np.eye(3), strict=True))
# C' by the row's coefficients, C' by the kernels' own formula, C''
Row = tuple[float, float, float]


class _Body:
    """Smooth random motion of a body, valid for complex times: position x + v t + a t^2 / 2,
    attitude exp([w t + w' t^2 / 2]) R0."""

    def __init__(self, random: np.random.Generator):
        self.x, self.v, self.a, self.w, self.w_rate = random.normal(size=(5, 3))
        self.r = np.linalg.qr(random.normal(size=(3, 3)))[0]
        self.r *= np.linalg.det(self.r)

    def turn(self, body: Array) -> Array:
        """Vector fixed in the body (3,), given in body axes, in ground axes at all n complex
        `TIMES`, (n, 3): Rodrigues' formula, whose coefficients are even in the angle."""
        t, start = TIMES[:, None], self.r @ body
        turned = self.w * t + 0.5 * self.w_rate * t * t
        angle = np.sqrt(np.sum(turned * turned, axis=1))[:, None]
        cross = np.cross(turned, start)
        return (
            start
            + np.sin(angle) / angle * cross
            + (1.0 - np.cos(angle)) / angle**2 * np.cross(turned, cross)
        )

    def point(self, body: Array) -> Array:
        """Position (n, 3), m, of a point fixed in the body, at all n complex `TIMES`, ground axes;
        ``body`` is its vector from the mass centre, body axes."""
        t = TIMES[:, None]
        return self.x + self.v * t + 0.5 * self.a * t * t + self.turn(body)


def derivatives(constraint: Array) -> Row:
    """C', C' again (a `Row` has it twice), and C'' at t = 0, from the values ``constraint`` (n,) of
    one function C at the n complex `TIMES`, a circle around 0: Cauchy's integral, exact to
    round-off for an entire function."""
    series = np.fft.fft(constraint).real / POINTS
    rate = float(series[1]) / RADIUS
    return rate, rate, 2.0 * float(series[2]) / RADIUS**2


def _gap(a: _Body, b: _Body, arms: Array) -> tuple[Array, Array, Array, Array]:
    """Vector d from the joint point of A to that of B, its rate d', and the vectors from both mass
    centres to their joint points, at t = 0, ground axes; ``arms`` has the latter in body axes."""
    rho_a, rho_b = a.r @ arms[0], b.r @ arms[1]
    return (
        b.x + rho_b - a.x - rho_a,
        b.v + np.cross(b.w, rho_b) - a.v - np.cross(a.w, rho_a),
        rho_a,
        rho_b,
    )


def _translation(a: _Body, b: _Body, arms: Array, axis: Array) -> tuple[Row, Row]:
    """Row (C' twice, C'') of a translation along ``axis``, fixed in A, by the kernels' formulas,
    and the same by `derivatives`; ``arms`` as for `_gap`."""
    d, d_rate, rho_a, rho_b = (tuple(v) for v in _gap(a, b, arms))
    e = a.r @ axis
    arm_a, arm_b, gamma = joints.translation(
        d, d_rate, tuple(e), rho_a, rho_b, tuple(a.w), tuple(b.w)
    )
    rate = joints.translation_rate(d, d_rate, tuple(e), tuple(a.w))
    row = _rates_of(a, b, e, arm_a, arm_b, gamma)
    return (row[0], rate, row[1]), derivatives(
        np.sum((b.point(arms[1]) - a.point(arms[0])) * a.turn(axis), axis=1)
    )


def _rod(a: _Body, b: _Body, arms: Array) -> tuple[Row, Row]:
    """Row (C' twice, C'') of a rod between the joint points, by the kernels' formulas, and the same
    by `derivatives`; ``arms`` as for `_gap`."""
    d, d_rate, rho_a, rho_b = _gap(a, b, arms)
    e, arm_a, arm_b, gamma = joints.rod(*(tuple(v) for v in (d, d_rate, rho_a, rho_b, a.w, b.w)))
    row = _rates_of(a, b, e, arm_a, arm_b, gamma)
    return (row[0], float(d_rate @ e), row[1]), derivatives(
        np.sqrt(np.sum((b.point(arms[1]) - a.point(arms[0])) ** 2, axis=1))
    )


def _rates_of(
    a: _Body, b: _Body, e: Array, arm_a: Array, arm_b: Array, gamma: float
) -> tuple[float, float]:
    """C' and C'' at t = 0 of a row, from its coefficients: ``e`` of the velocity of B's mass centre
    relative to A's, ``arm_a`` and ``arm_b`` of the angular rates of A and B. C'' is their product
    with the accelerations minus ``gamma``, which follows from the velocities."""
    first = np.dot(e, b.v - a.v) + np.dot(arm_a, a.w) + np.dot(arm_b, b.w)
    return float(first), float(
        np.dot(e, b.a - a.a) + np.dot(arm_a, a.w_rate) + np.dot(arm_b, b.w_rate) - gamma
    )


def _rotation(a: _Body, b: _Body, constrained: str) -> tuple[Row, Row]:
    """Row (C' twice, C'') of a constrained rotation, "x", "y" or "z", by the kernels' formulas, and
    the same by `derivatives`."""
    of_a, of_b = (AXES[axis] for axis in PERPENDICULAR[constrained])
    state = tuple(b.r @ of_b), tuple(a.r @ of_a), tuple(a.w), tuple(b.w)
    n, gamma = joints.rotation(*state)
    row = (
        float(np.dot(n, b.w - a.w)),
        joints.rotation_rate(*state),
        float(np.dot(n, b.w_rate - a.w_rate) - gamma),
    )
    return row, derivatives(np.sum(b.turn(of_b) * a.turn(of_a), axis=1))


def rows() -> list[Line]:
    """Check C' and C'' of the constraint rows of each joint kind against `derivatives` of C along
    12 random motions. Each kind has a line for C' and one for C'': the row that differs most; the
    tolerance is 1e-11 of the largest C' or C''."""
    lines = []
    for number, (kind, (translations, rotations)) in enumerate(KINDS.items()):
        if kind == "free":
            continue
        random, pairs = np.random.default_rng(number), []
        for _ in range(STATES):
            a, b, arms = _Body(random), _Body(random), random.normal(size=(2, 3))
            if translations == "length":
                arms[1] += 6.0  # far from zero length, where C has a corner
                pairs.append(_rod(a, b, arms))
            else:
                pairs += [_translation(a, b, arms, AXES[axis]) for axis in translations]
            pairs += [_rotation(a, b, axis) for axis in rotations]
        values, expected = np.array(pairs).transpose(1, 0, 2)
        for name, part in (("C'", slice(0, 2)), ("C''", slice(2, 3))):
            lines.append(
                worst(
                    f"rows of {kind}",
                    f"{name} of {len(pairs)} rows",
                    expected[:, part],
                    values[:, part],
                    ROUND_OFF,
                )
            )
    return lines
