"""Constraint rows of a phase and the reduced constraint force equation, as expressions."""

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
from sepmc.kernel.emit.loads import add_all
from sepmc.kernel.spec.kernel_spec import Row
from sepmc.kernel.spec.variant import Variant
from sepmc.kernel.tracer.formulas import ZERO, joints, linear, scalar, square_root, vec3
from sepmc.kernel.tracer.tracer import Expr, called, product, total, where
from sepmc.routines import layout as at
from sepmc.scene.model import GROUND
from sepmc.schema import Status

# share of its diagonal below which a pivot is too small: rows are redundant, or nearly
DEPENDENT = 1e-9


@dataclass
class JointRow:
    """A row: direction e of a translation, arms of its two bodies (ground axes), normals n of the
    groups that it turns (body axes) and these times the inverse inertia, the component gamma of its
    second derivative, and how far it is off."""

    row: Row
    e: Any
    arms: tuple[Any, Any]
    normals: dict[str, Any]
    turned: dict[str, Any]
    gamma: Any
    value: Any
    rate: Any
    held: Any = 1.0  # 0 while its joint does not hold it
    own: Own | None = None  # of a translation of bodies that turn as one


class Rows:
    """The rows of a phase at a state: those that it is flown by, or others; of groups that turn as
    one, or of bodies ``apart``."""

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
            return self._sliding(row, line)
        e, arm_a, arm_b, gamma, value, rate = (
            self._turning(row, pair) if row.turns else self._moving(row, pair)
        )
        arms: dict[str, Any] = {}
        for body, arm in zip(self.bodies[row.joint], (arm_a, arm_b), strict=True):
            leader = body if self.per_body else s.segment.leader(body)
            if leader != GROUND:
                arms[leader] = vec3.add(arms[leader], arm) if leader in arms else arm
        gamma = self._pulled_back(gamma, value, rate)
        normals = {
            leader: vec3.unrotate(s.attitude(leader), arm).called("n")
            for leader, arm in arms.items()
        }
        turned = {
            leader: vec3.rotate(self.inverse[leader], n).called("turned")
            for leader, n in normals.items()
        }
        held = s.while_held(row.joint, row.kinds) if row.kinds else 1.0
        return JointRow(
            row, e, (arm_a, arm_b), normals, turned, gamma, held * value, held * rate, held
        )

    def _sliding(self, row: Row, line: Line) -> JointRow:
        """A row that holds a distance between bodies that turn as one: in the axes of their group
        it is a few numbers."""
        own = line.own
        assert own is not None
        held = self.s.while_held(row.joint, row.kinds) if row.kinds else 1.0
        inverse = self.s.scope.localize(self.inverse[own.leader])
        turned = tuple(
            called(product(own.lever, tuple(inverse[3 * i + k] for k in range(3))), "turned")
            for i in range(3)
        )
        return JointRow(
            row,
            line.e,
            (line.arm_a, line.arm_b),
            {own.leader: own.lever},
            {own.leader: turned},
            self._pulled_back(line.gamma, line.length, line.rate),
            held * line.length,
            held * line.rate,
            held,
            own,
        )

    def _pulled_back(self, gamma: Any, value: Any, rate: Any) -> Any:
        """The right-hand side of a row that is off by so much, if drift is to decay."""
        if self.s.spec.scene.solver.drift != "baumgarte":
            return gamma
        return gamma - at.BAUMGARTE_RATE * (2.0 * rate + at.BAUMGARTE_RATE * value)

    def _turning(self, row: Row, pair: Pair) -> tuple[Any, ...]:
        """A row that holds an angle."""
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

    def _moving(self, row: Row, pair: Pair) -> tuple[Any, ...]:
        """A row that holds a distance."""
        if row.code == at.ROD:
            line, gap = self.s.rod(pair), self.s.case.joint_ends(row.joint)[2]
            length = square_root(vec3.dot(gap, gap)).called("rod")
            return line.e, line.arm_a, line.arm_b, line.gamma, line.length - length, line.rate
        e = self.s.axis(row.joint, row.code)
        arm_a, arm_b, gamma = translation(pair, e)
        return e, arm_a, arm_b, gamma, vec3.dot(pair.d, e), translation_rate(pair, e)

    def coupling(self) -> list[list[Any]]:
        """G M^-1 G^T below and on its diagonal; of a row that is not held any more, that of a
        multiplier of zero."""
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
            product(two.normals[leader], one.turned[leader])
            if two.own or one.own
            else vec3.dot(two.normals[leader], one.turned[leader])
            for leader in one.normals
            if leader in two.normals
        ]
        found = one.held * two.held * total(terms) if terms else 0.0
        return found + (1.0 - one.held) if one is two else found

    def reject_independent(self, one: JointRow, factors: "Factors") -> None:
        """A case is lost where a row does not follow from these."""
        side = [self._coupling(one, other) for other in self.rows]
        own = self._coupling(one, one)
        left = own - total([x * y for x, y in zip(side, factors.solve(side), strict=True)])
        reject_unless(self.s.scope, left <= DEPENDENT * own, Variant.LEAST_SQUARES)

    def without_joints(
        self, acceleration: dict[str, Any], spin_rate: dict[str, Any], moving: bool = True
    ) -> list[Any]:
        """What accelerations without the joints leave of each row; by themselves, apart from what
        bodies do that are ``moving``."""
        found = []
        for one in self.rows:
            side = one.gamma if moving else 0.0
            if not one.row.turns:
                apart = relative_acceleration(acceleration, self.bodies[one.row.joint])
                if apart is not ZERO and one.own:
                    axes = self.s.attitude(one.own.leader)
                    side = side - product(one.own.e, vec3.unrotate(axes, apart).called("apart"))
                elif apart is not ZERO:
                    side = side - vec3.dot(one.e, apart)
            dot = product if one.own else vec3.dot
            for leader, normal in one.normals.items():
                if spin_rate[leader] is not ZERO:
                    side = side - dot(normal, spin_rate[leader])
            found.append(one.held * side)
        return found

    def act(self, multipliers: list[Any]) -> tuple[dict[str, Any], dict[str, Any]]:
        """What multipliers do to bodies, in ground axes, and to groups, in body axes."""
        linear, angular = {}, {}
        of_slides = self._slide_forces(multipliers)
        for body in self.s.spec.bodies:
            pulls = []
            for m, one in zip(multipliers, self.rows, strict=True):
                a, b = self.bodies[one.row.joint]
                if not one.row.turns and one.own is None and body in (a, b):
                    pulls.append(vec3.scale(-m if body == a else m, one.e))
            for joint, force in of_slides.items():
                a, b = self.bodies[joint]
                if body in (a, b):
                    pulls.append(vec3.scale(-1.0, force) if body == a else force)
            linear[body] = (
                vec3.scale(self.s.case.inverse_mass(body), add_all(pulls)) if pulls else None
            )
        for leader in self.s.segment.leaders:
            turns = [
                vec3.scale(m, one.turned[leader])
                for m, one in zip(multipliers, self.rows, strict=True)
                if leader in one.turned
            ]
            angular[leader] = add_all(turns) if turns else None
        return linear, angular

    def _slide_forces(self, multipliers: list[Any]) -> dict[str, Any]:
        """What multipliers do to the second bodies of joints whose bodies turn as one, ground
        axes."""
        own: dict[str, Any] = {}
        for m, one in zip(multipliers, self.rows, strict=True):
            if one.own:
                before = own.get(one.row.joint, ZERO)
                own[one.row.joint] = tuple(before[i] + m * one.own.e[i] for i in range(3))
        found = {}
        for joint, force in own.items():
            r = self.s.attitude(self.bodies[joint][0])
            found[joint] = tuple(
                called(product((r[3 * i], r[3 * i + 1], r[3 * i + 2]), force), "pull")
                for i in range(3)
            )
        return found

    def note_residuals(self) -> None:
        """How far the rows are off, into RESIDUAL_NOW: gaps and angles, then their rates."""
        scope = self.s.scope
        for one in self.rows:
            first = 1 if one.row.turns else 0
            for k, x in ((first, one.value), (first + 2, one.rate)):
                place = component("RESIDUAL_NOW", k)
                scope.store(place, scalar.larger(scope.load(place), scalar.abs(x)))


class LeastSquares:
    """Solutions of least sum of squares of a symmetric system some of whose rows follow from
    others, given below and on its diagonal."""

    def __init__(self, s: State, a: list[list[Any]], name: str = ""):
        self.s, self.matrix, self.solved = s, [x for row in a for x in row], 0
        self.name = f"{s.segment.name}_{name}" if name else s.segment.name
        self.rank: Any = None
        self.smallest: Any = None  # share of its diagonal that a pivot keeps

    def solve(self, side: list[Any]) -> list[Any]:
        """The solution for a right-hand side."""
        scope, workspace, n = self.s.scope, self.s.c.workspace, len(side)
        self.solved += 1
        system, found, rank = (
            f"{field}_{self.name}_{self.solved}" for field in ("SYSTEM", "MULTIPLIERS", "RANK")
        )
        workspace.add(system, len(self.matrix) + n), workspace.add(found, n), workspace.add(rank, 1)
        workspace.add(f"SCRATCH_{self.name}", 3 * n**2 + 5 * n)
        for k, value in enumerate((*self.matrix, *side)):
            scope.store(component(system, k), value)
        w, here, there, scratch = map(
            scope.named, ("w", f"{system} + l", f"{found} + l", f"SCRATCH_{self.name}")
        )
        self.rank, self.smallest = linear.solve_min_norm(w, here, n, scratch, there).called(
            "solved"
        )
        scope.store(rank, self.rank)  # what is stored is written
        reject_if(scope, (self.rank <= 0.0) & is_finite(self.s), Status.SINGULAR_JOINT)
        return [scope.load(component(found, k)) for k in range(n)]


class Factors:
    """L D L^T of a symmetric matrix, given below and on its diagonal."""

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
        """The solution for a right-hand side."""
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
    """Whether a state is made of numbers: what is none spreads to the velocities of all bodies that
    it moves."""
    found: Expr = getattr(scalar, "math.isfinite")(
        total([x for body in s.spec.bodies for x in s.speed(body)])
    )
    return found


def make_solver(s: State, coupling: list[list[Any]]) -> Solver:
    """What solves for the multipliers of a phase's rows."""
    return LeastSquares(s, coupling) if s.segment.least_squares else Factors(coupling)


def check_pivots(s: State, coupling: list[list[Any]], factors: Solver) -> None:
    """Note the smallest share of its diagonal that a pivot keeps; a case is lost where that is too
    little: rows follow from others, or nearly do. If some are known to, note how many."""
    s.c.start("PIVOT", 1.0)
    least = s.scope.load("PIVOT")
    if isinstance(factors, LeastSquares):
        s.c.start("REDUNDANT", 0.0)
        s.scope.store(
            "REDUNDANT", scalar.larger(s.scope.load("REDUNDANT"), len(coupling) - factors.rank)
        )
        s.scope.store("PIVOT", where(factors.smallest < least, factors.smallest, least))
        return
    for row, pivot in zip(coupling, factors.diagonal, strict=True):
        if isinstance(pivot, Expr):
            share = (pivot / row[-1]).called("share")
            reject_unless(s.scope, share > DEPENDENT, Variant.LEAST_SQUARES)
            least = where(share < least, share, least).called("least")
    s.scope.store("PIVOT", least)
