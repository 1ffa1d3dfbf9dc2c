"""Constraint rows of a segment and the reduced constraint force equation.

Each row is G(q) v' = gamma with the Jacobian G; the multipliers follow from
(G M^-1 G^T) lambda = gamma - G v'_free (constraint force equation, NASA/TP-2016-219326).
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

    Direction ``e`` of a translation and arms of its two bodies (ground axes); by leader of the
    rigid groups that it rotates, ``normals`` (the angular part of G, body axes) and
    ``inverse_normals`` (inverse inertia times these); ``gamma``; residual ``value`` (m or rad) and
    its ``rate``.
    """

    row: Row
    e: Any
    arms: tuple[Any, Any]
    normals: dict[str, Any]
    inverse_normals: dict[str, Any]
    gamma: Any
    value: Any
    rate: Any
    mask: Any = 1.0  # 0 while the row is inactive
    own: Own | None = None  # of a translation between bodies of one rigid group


class Rows:
    """Constraint rows of the joints at a state: those of its segment, or the given ``rows``.

    Bodies of a rigid group share its rotation; ``per_body``, each body rotates by itself.
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
        """Row of a translation between bodies of one rigid group: in the axes of the group it has
        few terms."""
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
        """Right-hand side of a row: gamma or, if the scene asks for Baumgarte stabilisation, gamma
        minus its terms of the residual ``value`` and its rate."""
        if self.s.spec.scene.solver.drift != "baumgarte":
            return gamma
        return gamma - at.BAUMGARTE_RATE * (2.0 * rate + at.BAUMGARTE_RATE * value)

    def _rotation(self, row: Row, pair: Pair) -> tuple[Any, ...]:
        """Terms of a row that constrains a rotation: direction (zero), arms of both bodies, gamma,
        residual, rate of the residual."""
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
        """Terms of a row that constrains a translation: direction, arms of both bodies, gamma,
        residual, rate of the residual."""
        if row.code == at.ROD:
            line, gap = self.s.rod(pair), self.s.case.joint_ends(row.joint)[2]
            length = square_root(vec3.dot(gap, gap)).called("rod")
            return line.e, line.arm_a, line.arm_b, line.gamma, line.length - length, line.rate
        e = self.s.axis(row.joint, row.code)
        arm_a, arm_b, gamma = translation(pair, e)
        return e, arm_a, arm_b, gamma, vec3.dot(pair.d, e), translation_rate(pair, e)

    def coupling(self) -> list[list[Any]]:
        """Lower triangle of G M^-1 G^T, row by row; an inactive row has a 1 on the diagonal, so
        that its multiplier is zero."""
        return [
            [self._coupling(one, two) for two in self.rows[: r + 1]]
            for r, one in enumerate(self.rows)
        ]

    def _coupling(self, one: JointRow, two: JointRow) -> Any:
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
        """Reject cases in which the row ``one``, which was left out as redundant, is independent of
        the rows with the factorised coupling ``factors``."""
        side = [self._coupling(one, other) for other in self.rows]
        own = self._coupling(one, one)
        remainder = own - total([x * y for x, y in zip(side, factors.solve(side), strict=True)])
        reject_unless(self.s.scope, remainder <= DEPENDENT * own, Variant.LEAST_SQUARES)

    def without_joints(
        self, acceleration: dict[str, Any], spin_rate: dict[str, Any], moving: bool = True
    ) -> list[Any]:
        """Right-hand sides of the equations for the multipliers: gamma minus G times the
        accelerations without joints, by body and by leader; without gamma unless ``moving``."""
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
        """Accelerations that the joints cause, given the multiplier of each row: of mass centres,
        by body, in ground axes, and angular ones, by leader, in body axes; None where no row
        acts."""
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
        """Forces, ground axes, that joints between bodies of one rigid group put on their second
        bodies, by joint, given the multiplier of each row; without those that are known to be
        zero."""
        own: dict[str, Any] = {}
        for m, one in zip(multipliers, self.rows, strict=True):
            if one.own:
                force_before = own.get(one.row.joint, ZERO)
                own[one.row.joint] = tuple(force_before[i] + m * one.own.e[i] for i in range(3))
        forces = {}
        for joint, force in own.items():
            if all(isinstance(x, float) for x in force):
                continue
            r = self.s.attitude(self.bodies[joint][0])
            forces[joint] = tuple(
                called(product((r[3 * i], r[3 * i + 1], r[3 * i + 2]), force), "pull")
                for i in range(3)
            )
        return forces

    def update_residuals(self) -> None:
        """Update the field RESIDUAL_NOW of the largest residuals of the rows: of gaps, m, of
        angles, rad, of the rates of gaps and of angles."""
        scope = self.s.scope
        for one in self.rows:
            first = 1 if one.row.turns else 0
            for k, x in ((first, one.value), (first + 2, one.rate)):
                path = component("RESIDUAL_NOW", k)
                scope.store(path, scalar.larger(scope.load(path), scalar.abs(x)))


class LeastSquares:
    """Minimum-norm solutions of a symmetric, possibly singular system, whose matrix is given by the
    rows of its lower triangle; the written code calls `sepmc.routines.linear.solve_min_norm`."""

    def __init__(self, s: State, a: list[list[Any]], name: str = ""):
        self.s, self.matrix, self.solutions = s, [x for row in a for x in row], 0
        self.name = f"{s.segment.name}_{name}" if name else s.segment.name
        self.rank: Any = None
        self.smallest: Any = None  # smallest pivot relative to its diagonal element

    def solve(self, side: list[Any]) -> list[Any]:
        """Solution of minimum norm for a right-hand side; a case in which a diagonal element is not
        positive is rejected."""
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
    """Factorisation L D L^T of a symmetric matrix of expressions, given by the rows of its lower
    triangle."""

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
        """Solution for a right-hand side, an expression for each row."""
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
    """Condition that a state is finite: NaN and inf spread to the velocities of all bodies that
    they affect."""
    finite: Expr = getattr(scalar, "math.isfinite")(
        total([x for body in s.spec.bodies for x in s.velocity(body)])
    )
    return finite


def make_solver(s: State, coupling: list[list[Any]]) -> Solver:
    """Solver for the multipliers of the rows of a segment, given their coupling matrix (lower
    triangle): of minimum norm in a segment with least squares, else a factorisation."""
    return LeastSquares(s, coupling) if s.segment.least_squares else Factors(coupling)


def check_pivots(s: State, coupling: list[list[Any]], factors: Solver) -> None:
    """Update the field PIVOT of the smallest pivot relative to its diagonal element. Reject a case
    where it is too small (redundant rows); of a minimum-norm solution, update the number of
    redundant rows instead."""
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
