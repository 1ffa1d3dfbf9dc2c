"""Constraint rows of a segment at a state, and the reduced constraint force equation for their
multipliers.

Each row is G(q) v' = gamma, with its line G of the Jacobian and the velocities v of the bodies. The
multipliers lambda follow from (G M^-1 G^T) lambda = gamma - G v'_free, with the mass matrix M and
the accelerations v'_free without joint forces (constraint force equation, NASA/TP-2016-219326). The
matrix G M^-1 G^T is called coupling here.
"""

from dataclasses import dataclass
from typing import Any

from sepmc.kernel.emit.context import component, reject_if, reject_unless
from sepmc.kernel.emit.geometry import (
    Line,
    Own,
    Pair,
    State,
    relative_acceleration,
    translation,
    translation_rate,
)
from sepmc.kernel.emit.loads import vector_sum
from sepmc.kernel.spec.kernel_spec import Row
from sepmc.kernel.spec.variant import Variant
from sepmc.kernel.tracer.formulas import ZERO, joints, linear, scalar, square_root, vec3
from sepmc.kernel.tracer.tracer import Expr, called, product, total, where
from sepmc.routines import layout as at
from sepmc.scene.model import GROUND
from sepmc.schema import Status

# minimum pivot relative to its diagonal element: below it, rows are redundant or nearly so
DEPENDENT = 1e-9


@dataclass
class JointRow:
    """Constraint row G v' = gamma of a joint at a state.

    ``e`` is the direction of a translation (zero for a rotation), ``arms`` are the moments on both
    bodies per unit of the multiplier; ground axes. By leader of each rigid group that the row acts
    on, ``normals`` has the angular part of G (body axes) and ``inverse_normals`` the inverse
    inertia times it. ``gamma`` is the right-hand side, also while the row is inactive. ``value`` is
    the residual of the constraint (m or rad) and ``rate`` its rate; these two are 0 while the row
    is inactive. ``mask`` is a number that is 1 while the row is active, else 0; ``own`` has the
    direction and lever of a translation within a rigid group, else None.
    """

    row: Row
    e: Any
    arms: tuple[Any, Any]
    normals: dict[str, Any]
    inverse_normals: dict[str, Any]
    gamma: Any
    value: Any
    rate: Any
    mask: Any = 1.0
    own: Own | None = None


class Rows:
    """Constraint rows of joints at a state: those of its segment, or the given ``rows``. The
    attribute ``rows`` has them evaluated at the state (`JointRow`), in the same order.

    Bodies of a rigid group share its rotation; with ``per_body``, every body is treated as if it
    rotated by itself, and its name takes the place of the leader.
    """

    def __init__(self, s: State, rows: list[Row] | None = None, per_body: bool = False):
        self.s, self.bodies = s, {name: joint.bodies for name, joint in s.spec.scene.joint.items()}
        self.per_body, groups = (
            per_body,
            [(body,) for body in s.spec.bodies] if per_body else s.segment.groups,
        )
        self.inverse = {
            group[0]: s.case.inverse_inertia(group) for group in groups if GROUND not in group
        }
        self.rows: list[JointRow] = []
        for row in s.segment.rows if rows is None else rows:
            if not self.rows or row.joint != self.rows[-1].row.joint:
                s.scope.comment(f"joint {row.joint}")
            self.rows.append(self._row(row))

    def _row(self, row: Row) -> JointRow:
        """Evaluate a constraint row at the state: direction, levers, residual, its rate and the
        right-hand side with the stabilisation against drift. A row that may be inactive gets a
        mask, which makes its residual and rate 0 then."""
        s, pair = self.s, self.s.joint(row.joint)
        line = None
        if not (row.turns or row.code == at.ROD or self.per_body):
            line = s.sliding_line(row.joint, row.code)
        if line is not None:
            return self._group_translation(row, line)
        e, arm_a, arm_b, gamma, value, rate = (
            self._rotation(row, pair) if row.turns else self._translation(row, pair)
        )
        arms: dict[str, Any] = {}
        for body, arm in zip(self.bodies[row.joint], (arm_a, arm_b), strict=True):
            leader = body if self.per_body else s.segment.leader(body)
            if leader != GROUND:
                arms[leader] = vec3.add(arms[leader], arm) if leader in arms else arm
        gamma = self._stabilised(gamma, value, rate)
        normals = {
            leader: vec3.unrotate(s.attitude(leader), arm).called("n")
            for leader, arm in arms.items()
        }
        inverse_normals = {
            leader: vec3.rotate(self.inverse[leader], n).called("inverse_n")
            for leader, n in normals.items()
        }
        mask = s.is_active(row.joint, row.kinds) if row.kinds else 1.0
        return JointRow(
            row, e, (arm_a, arm_b), normals, inverse_normals, gamma, mask * value, mask * rate, mask
        )

    def _group_translation(self, row: Row, line: Line) -> JointRow:
        """Evaluate the row of a translation between bodies of one rigid group, which may slide,
        along ``line``, which must have the part ``own``; in the axes of the group the row has few
        terms."""
        own = line.own
        assert own is not None
        mask = self.s.is_active(row.joint, row.kinds) if row.kinds else 1.0
        inverse = self.s.scope.localize(self.inverse[own.leader])
        inverse_normal = tuple(
            called(
                product(own.lever, tuple(inverse[3 * i + k] for k in range(3))), "inverse_normal"
            )
            for i in range(3)
        )
        return JointRow(
            row,
            line.e,
            (line.arm_a, line.arm_b),
            {own.leader: own.lever},
            {own.leader: inverse_normal},
            self._stabilised(line.gamma, line.length, line.rate),
            mask * line.length,
            mask * line.rate,
            mask,
            own,
        )

    def _stabilised(self, gamma: Any, value: Any, rate: Any) -> Any:
        """Right-hand side of a row: ``gamma`` or, with ``solver.drift = "baumgarte"``, gamma minus
        the stabilising terms of the residual ``value`` and its rate."""
        if self.s.spec.scene.solver.drift != "baumgarte":
            return gamma
        return gamma - at.BAUMGARTE_RATE * (2.0 * rate + at.BAUMGARTE_RATE * value)

    def _rotation(self, row: Row, pair: Pair) -> tuple[Any, ...]:
        """Terms of a row that constrains a rotation, as six values: direction (zero), moment on the
        first and on the second body per unit of the multiplier (the ``arms`` of `JointRow`), gamma
        (rad/s2), residual (rad; the cosine between two axes), rate of the residual (rad/s). Vectors
        are in ground axes. ``pair`` is that of the joint's points."""
        of_second, of_first = (row.code - at.ROTATION) // 3, (row.code - at.ROTATION) % 3
        b, a = self.s.axis(row.joint, of_second, second=True), self.s.axis(row.joint, of_first)
        arm, gamma = joints.rotation(b, a, pair.spin_a, pair.spin_b).called("row")
        return (
            ZERO,
            vec3.scale(-1.0, arm),
            arm,
            gamma,
            vec3.dot(b, a),
            joints.rotation_rate(b, a, pair.spin_a, pair.spin_b),
        )

    def _translation(self, row: Row, pair: Pair) -> tuple[Any, ...]:
        """Terms of a row that constrains a translation, or the length of a rod, as six values:
        direction, moment on the first and on the second body per unit of the multiplier (the
        ``arms`` of `JointRow`, m), gamma (m/s2), residual (m), rate of the residual (m/s). Vectors
        are in ground axes. ``pair`` is that of the joint's points."""
        if row.code == at.ROD:
            line, gap = self.s.rod(pair), self.s.case.joint_ends(row.joint)[2]
            length = square_root(vec3.dot(gap, gap)).called("rod")
            return line.e, line.arm_a, line.arm_b, line.gamma, line.length - length, line.rate
        e = self.s.axis(row.joint, row.code)
        arm_a, arm_b, gamma = translation(pair, e)
        return e, arm_a, arm_b, gamma, vec3.dot(pair.d, e), translation_rate(pair, e)

    def coupling(self) -> list[list[Any]]:
        """Lower triangle of the coupling matrix G M^-1 G^T, row by row with the diagonal. An
        inactive row has 1 on the diagonal and 0 elsewhere, so that its multiplier is zero."""
        return [
            [self._coupling(one, two) for two in self.rows[: r + 1]]
            for r, one in enumerate(self.rows)
        ]

    def _coupling(self, one: JointRow, two: JointRow) -> Any:
        """Entry of the coupling matrix for the rows ``one`` and ``two``; the number 0.0 if it is
        known to be zero. An inactive row has the entry 1 with itself, 0 with others."""
        signs: dict[str, int] = {}
        if not one.row.turns and not two.row.turns:
            for body, sign in zip(self.bodies[one.row.joint], (-1, 1), strict=True):
                for other, other_sign in zip(self.bodies[two.row.joint], (-1, 1), strict=True):
                    if body == other != GROUND:
                        signs[body] = sign * other_sign
        perpendicular = (
            one.row.joint == two.row.joint
            and one is not two
            and at.ROD not in (one.row.code, two.row.code)
        )
        terms = []
        if signs and not perpendicular:
            masses = total(
                [float(sign) * self.s.case.inverse_mass(body) for body, sign in signs.items()]
            )
            terms.append(masses if one is two else masses * vec3.dot(one.e, two.e))
        terms += [
            product(two.normals[leader], one.inverse_normals[leader])
            if two.own or one.own
            else vec3.dot(two.normals[leader], one.inverse_normals[leader])
            for leader in one.normals
            if leader in two.normals
        ]
        coefficient = one.mask * two.mask * total(terms) if terms else 0.0
        return coefficient + (1.0 - one.mask) if one is two else coefficient

    def reject_independent(self, one: JointRow, factors: "Factors") -> None:
        """Add lines that leave cases to the kernel variant LEAST_SQUARES in which ``one``, a row
        left out as redundant, is independent of these rows, whose factorised coupling matrix is
        ``factors``."""
        side = [self._coupling(one, other) for other in self.rows]
        own = self._coupling(one, one)
        remainder = own - total([x * y for x, y in zip(side, factors.solve(side), strict=True)])
        reject_unless(self.s.scope, remainder <= DEPENDENT * own, Variant.LEAST_SQUARES)

    def without_joints(
        self, acceleration: dict[str, Any], spin_rate: dict[str, Any], moving: bool = True
    ) -> list[Any]:
        """Right-hand side of the equation for the multipliers, a number for each row: gamma minus G
        times the accelerations without joint forces: ``acceleration`` of mass centres by body,
        ground axes, ``spin_rate`` by leader, body axes (the object `ZERO` where one is known to be
        zero); 0 for an inactive row. Unless ``moving``, gamma is left out."""
        sides = []
        for one in self.rows:
            side = one.gamma if moving else 0.0
            if not one.row.turns:
                relative = relative_acceleration(acceleration, self.bodies[one.row.joint])
                if relative is not ZERO and one.own:
                    axes = self.s.attitude(one.own.leader)
                    side = side - product(
                        one.own.e, vec3.unrotate(axes, relative).called("relative")
                    )
                elif relative is not ZERO:
                    side = side - vec3.dot(one.e, relative)
            dot = product if one.own else vec3.dot
            for leader, normal in one.normals.items():
                if spin_rate[leader] is not ZERO:
                    side = side - dot(normal, spin_rate[leader])
            sides.append(one.mask * side)
        return sides

    def act(self, multipliers: list[Any]) -> tuple[dict[str, Any], dict[str, Any]]:
        """Accelerations that the joint forces cause, given the multiplier of each row: those of
        mass centres by body, ground axes, m/s2, and angular ones by leader, body axes, rad/s2; None
        for a body or group on which no row acts."""
        linear, angular = {}, {}
        group_forces = self._group_forces(multipliers)
        for body in self.s.spec.bodies:
            forces = []
            for m, one in zip(multipliers, self.rows, strict=True):
                a, b = self.bodies[one.row.joint]
                if not one.row.turns and one.own is None and body in (a, b):
                    forces.append(vec3.scale(-m if body == a else m, one.e))
            for joint, force in group_forces.items():
                a, b = self.bodies[joint]
                if body in (a, b):
                    forces.append(vec3.scale(-1.0, force) if body == a else force)
            linear[body] = (
                vec3.scale(self.s.case.inverse_mass(body), vector_sum(forces)) if forces else None
            )
        for leader in self.s.segment.leaders:
            terms = [
                vec3.scale(m, one.inverse_normals[leader])
                for m, one in zip(multipliers, self.rows, strict=True)
                if leader in one.inverse_normals
            ]
            angular[leader] = vector_sum(terms) if terms else None
        return linear, angular

    def _group_forces(self, multipliers: list[Any]) -> dict[str, Any]:
        """Force on the second body, ground axes, N, of each joint between bodies of one rigid
        group, by joint (`own_forces`), given the multiplier of each row. Joints whose force is
        known to be zero are left out."""
        forces = {}
        for joint, force in self.own_forces(multipliers).items():
            if all(isinstance(x, float) for x in force):
                continue
            r = self.s.attitude(self.bodies[joint][0])
            forces[joint] = tuple(
                called(product((r[3 * i], r[3 * i + 1], r[3 * i + 2]), force), "pull")
                for i in range(3)
            )
        return forces

    def own_forces(self, multipliers: list[Any]) -> dict[str, Any]:
        """Force on the second body, body axes of the group, N, of each joint between bodies of one
        rigid group without the ground, by joint: the sum, over its rows that constrain a
        translation within the group, of multiplier times direction. ``multipliers`` has one for
        each of ``rows``."""
        forces: dict[str, Any] = {}
        for m, one in zip(multipliers, self.rows, strict=True):
            if one.own:
                force_before = forces.get(one.row.joint, ZERO)
                forces[one.row.joint] = tuple(force_before[i] + m * one.own.e[i] for i in range(3))
        return forces

    def update_residuals(self) -> None:
        """Add lines that raise the four components of RESIDUAL_NOW to the largest residuals of the
        rows: of translations, m, of rotations, rad, and of their rates, m/s and rad/s."""
        scope = self.s.scope
        for one in self.rows:
            first = 1 if one.row.turns else 0
            for k, x in ((first, one.value), (first + 2, one.rate)):
                path = component("RESIDUAL_NOW", k)
                scope.store(path, scalar.larger(scope.load(path), scalar.abs(x)))


class LeastSquares:
    """Minimum-norm solutions of systems with one symmetric, possibly singular matrix; ``a`` has the
    rows of its lower triangle. Kernels call `sepmc.routines.linear.solve_min_norm` for them.
    ``name`` distinguishes the workspace fields of several matrices in one segment.

    ``rank`` (of the matrix) and ``smallest`` (smallest ratio of a pivot to its diagonal element)
    are those of the last solution, None before the first."""

    def __init__(self, s: State, a: list[list[Any]], name: str = ""):
        self.s, self.matrix, self.solutions = s, [x for row in a for x in row], 0
        self.name = f"{s.segment.name}_{name}" if name else s.segment.name
        self.rank: Any = None
        self.smallest: Any = None  # smallest pivot relative to its diagonal element

    def solve(self, side: list[Any]) -> list[Any]:
        """Return the solution of minimum norm for a right-hand side (a number for each row); add
        lines that compute it and end a case (status singular-joint) in which a diagonal element of
        the matrix is not positive. ``rank`` and ``smallest`` are then those of this solution."""
        scope, workspace, n = self.s.scope, self.s.c.workspace, len(side)
        self.solutions += 1
        system, solution, rank = (
            f"{field}_{self.name}_{self.solutions}" for field in ("SYSTEM", "MULTIPLIERS", "RANK")
        )
        (
            workspace.add(system, len(self.matrix) + n),
            workspace.add(solution, n),
            workspace.add(rank, 1),
        )
        workspace.add(f"SCRATCH_{self.name}", 3 * n**2 + 5 * n)
        for k, value in enumerate((*self.matrix, *side)):
            scope.store(component(system, k), value)
        w, system_path, solution_path, scratch = map(
            scope.named, ("w", f"{system} + l", f"{solution} + l", f"SCRATCH_{self.name}")
        )
        self.rank, self.smallest = linear.solve_min_norm(
            w, system_path, n, scratch, solution_path
        ).called("solved")
        scope.store(rank, self.rank)  # stored so that the call is written
        reject_if(scope, (self.rank <= 0.0) & is_finite(self.s), Status.SINGULAR_JOINT)
        return [scope.load(component(solution, k)) for k in range(n)]


class Factors:
    """Factorisation L D L^T of a symmetric positive definite matrix of expressions; ``a`` has the
    rows of its lower triangle. ``diagonal`` has the pivots."""

    def __init__(self, a: list[list[Any]]):
        n = len(a)
        a = [list(row) for row in a]
        self.lower: list[list[Any]] = [[0.0] * n for _ in range(n)]
        self.diagonal, self.inverse = [], []
        for j in range(n):
            self.diagonal.append(a[j][j])
            self.inverse.append((1.0 / a[j][j]).called("inverse_pivot"))
            for i in range(j + 1, n):
                self.lower[i][j] = called(a[i][j] * self.inverse[j], "factor")
            for i in range(j + 1, n):
                for k in range(j + 1, i + 1):
                    a[i][k] = called(a[i][k] - self.lower[i][j] * a[k][j], "s")

    def solve(self, side: list[Any]) -> list[Any]:
        """Solution, an expression for each row, for a right-hand side."""
        x, n = list(side), len(side)
        for i in range(1, n):
            x[i] = called(x[i] - total([self.lower[i][j] * x[j] for j in range(i)]), "m")
        for i in reversed(range(n)):
            x[i] = x[i] * self.inverse[i]
            for j in range(i + 1, n):
                x[i] = x[i] - self.lower[j][i] * x[j]
            x[i] = called(x[i], "m")
        return x


Solver = Factors | LeastSquares


def is_finite(s: State) -> Expr:
    """Condition that a state is finite; only the velocities of the mass centres are checked, to
    which NaN and inf of other components spread."""
    finite: Expr = getattr(scalar, "math.isfinite")(
        total([x for body in s.spec.bodies for x in s.velocity(body)])
    )
    return finite


def make_solver(s: State, coupling: list[list[Any]]) -> Solver:
    """Solver for the multipliers of the rows of a segment, given the lower triangle of their
    coupling matrix: `LeastSquares` (minimum norm) in a segment with ``least_squares``, else
    `Factors`."""
    return LeastSquares(s, coupling) if s.segment.least_squares else Factors(coupling)


def check_pivots(s: State, coupling: list[list[Any]], factors: Solver) -> None:
    """Add lines that lower the field PIVOT to the smallest pivot of the solver ``factors`` relative
    to its diagonal element in ``coupling``. Where it is too small (redundant rows), a case is
    left to the kernel variant LEAST_SQUARES; with a minimum-norm solver, the largest number of
    redundant rows so far is stored in REDUNDANT instead."""
    s.c.start("PIVOT", 1.0)
    smallest = s.scope.load("PIVOT")
    if isinstance(factors, LeastSquares):
        s.c.start("REDUNDANT", 0.0)
        s.scope.store(
            "REDUNDANT", scalar.larger(s.scope.load("REDUNDANT"), len(coupling) - factors.rank)
        )
        s.scope.store("PIVOT", where(factors.smallest < smallest, factors.smallest, smallest))
        return
    for row, pivot in zip(coupling, factors.diagonal, strict=True):
        if isinstance(pivot, Expr):
            ratio = (pivot / row[-1]).called("ratio")
            reject_unless(s.scope, ratio > DEPENDENT, Variant.LEAST_SQUARES)
            smallest = where(ratio < smallest, ratio, smallest).called("smallest")
    s.scope.store("PIVOT", smallest)
