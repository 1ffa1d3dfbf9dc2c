"""Emitter of the full constraint force equations (NASA/TP-2016-219326): one linear system for the
accelerations of all bodies and the wrenches at both ends of all joints.

Unknowns, in this order: of each body the acceleration of the mass centre (ground axes) and the
angular acceleration (body axes); of each joint with constraint rows the forces F_A, F_B and moments
M_A, M_B on its two bodies (ground axes).
"""

from typing import Any

from sepmc.kernel.emit.context import component, reject_unless
from sepmc.kernel.emit.geometry import State
from sepmc.kernel.emit.rows import JointRow, Rows
from sepmc.kernel.spec.kernel_spec import Segment
from sepmc.kernel.spec.variant import Variant
from sepmc.kernel.tracer.formulas import UNIT, linear, vec3
from sepmc.kernel.tracer.text import Text
from sepmc.routines import layout as at
from sepmc.scene.model import GROUND

_OF_BODY, _OF_JOINT = 6, 12  # unknowns of a body, of a joint
_FORCE_B, _MOMENT_A, _MOMENT_B = 3, 6, 9  # offsets in the unknowns of a joint; F_A comes first
Wrench = tuple[Any, Any]  # force and moment on the second body of a joint, ground axes


def before_full(text: Text, segment: Segment, bodies: list[str]) -> None:
    """Append lines that set the whole matrix of the full system of a segment to zero; only nonzero
    entries are written afterwards. ``bodies`` are all moving bodies."""
    n = _size(segment, bodies)
    text.components(f"{n * n} * LANES")(f"w[SYSTEM_{segment.name} + e + l] = 0.0")


def _size(segment: Segment, bodies: list[str]) -> int:
    """Number of unknowns of the full system of a segment: the six accelerations of each of
    ``bodies``, all moving bodies, and force and moment at both ends of each joint that
    constrains."""
    return _OF_BODY * len(bodies) + _OF_JOINT * len(_constraining_joints(segment))


def _constraining_joints(segment: Segment) -> list[str]:
    """Names of the joints that have constraint rows in a segment, each once."""
    return list(dict.fromkeys(row.joint for row in segment.rows))


class FullSystem:
    """Full linear system, at a state of a segment, for the accelerations of all bodies and the
    wrenches at both ends of all joints with constraint rows.

    It is made from the constraint ``rows`` and the loads on each body: ``force`` in ground axes, N,
    ``moment`` in body axes, N m. ``entries`` has the nonzero entries of the matrix by (line,
    column), ``side`` the right-hand side.
    """

    def __init__(self, s: State, rows: Rows, force: dict[str, Any], moment: dict[str, Any]):
        self.s, self.rows = s, rows
        bodies, joints = s.spec.bodies, _constraining_joints(s.segment)
        self.n = _size(s.segment, bodies)
        self.of_body = {body: _OF_BODY * k for k, body in enumerate(bodies)}
        self.of_joint = {
            joint: _OF_BODY * len(bodies) + _OF_JOINT * k for k, joint in enumerate(joints)
        }
        self.entries: dict[tuple[int, int], Any] = {}
        self.side: list[Any] = [0.0] * self.n
        for body in bodies:
            self._add_body(body, force[body], moment[body])
        for joint in joints:
            self._add_wrench(joint)
            self._add_joint(joint)

    def _add_body(self, body: str, force: Any, moment: Any) -> None:
        """Add the equations of motion of a body, eqs (12), (13) of the paper that README cites,
        without joint terms, from its loads: ``force``, N, in ground axes, and ``moment``, N m, in
        body axes."""
        case, first = self.s.case, self.of_body[body]
        inertia, omega = case.inertia(body), self.s.rate(body)
        turning = vec3.sub(moment, vec3.cross(omega, vec3.rotate(inertia, omega)))
        for i in range(3):
            self.entries[first + i, first + i] = case.mass(body)
            self.side[first + i], self.side[first + 3 + i] = force[i], turning[i]
            for k in range(3):
                self.entries[first + 3 + i, first + 3 + k] = inertia[3 * i + k]

    def _add_wrench(self, joint: str) -> None:
        """Add the wrenches of a joint to the equations of motion of its bodies, and the equations
        of action and reaction, F_A + F_B = 0 and M_A + M_B + d x F_B = 0 (eq (15) of the paper that
        README cites), with d from the joint point of A to that of B."""
        s, first, pair = self.s, self.of_joint[joint], self.s.joint(joint)
        for end, (body, rho) in enumerate(
            zip(s.spec.scene.joint[joint].bodies, (pair.rho_a, pair.rho_b), strict=True)
        ):
            if body == GROUND:
                continue
            row, column, axes = self.of_body[body], first + 3 * end, s.attitude(body)
            for k, unit in enumerate(UNIT):
                self.entries[row + k, column + k] = -1.0
                lever, turn = vec3.unrotate(axes, vec3.cross(rho, unit)), vec3.unrotate(axes, unit)
                for i in range(3):
                    self.entries[row + 3 + i, column + k] = -lever[i]
                    self.entries[row + 3 + i, column + _MOMENT_A + k] = -turn[i]
        for i in range(3):
            for column in (i, _FORCE_B + i):
                self.entries[first + i, first + column] = 1.0
            for column in (_MOMENT_A + i, _MOMENT_B + i):
                self.entries[first + 3 + i, first + column] = 1.0
        for k, unit in enumerate(UNIT):
            lever = vec3.cross(pair.d, unit)
            for i in range(3):
                self.entries[first + 3 + i, first + _FORCE_B + k] = lever[i]

    def _add_joint(self, joint: str) -> None:
        """Add one equation for each of the six degrees of freedom of a joint: its constraint rows,
        and, for each free direction, that the component of the wrench on body B along it is zero
        (eqs (24), (25) of the paper that README cites). Where a row is inactive, its equation is
        replaced by one for such a zero component."""
        first, rows = (
            self.of_joint[joint],
            [row for row in self.rows.rows if row.row.joint == joint],
        )
        line = first + 6
        for one in rows:
            self._add_constraint(line, first, one)
            line += 1
        moved, turned = ([one for one in rows if one.row.turns == turns] for turns in (False, True))
        for column, free in (
            (_FORCE_B, self._free_translations(joint, moved)),
            (_MOMENT_B, _free_rotations(turned)),
        ):
            for direction in free:
                for k in range(3):
                    self.entries[line, first + column + k] = direction[k]
                line += 1

    def _add_constraint(self, line: int, first: int, one: JointRow) -> None:
        """Add the constraint row ``one`` as equation number ``line``; while the row is inactive,
        the equation is that the joint carries no load along it. ``first`` is the column of the
        first unknown of its joint."""
        mask = one.mask
        for body, sign in zip(
            self.s.spec.scene.joint[one.row.joint].bodies, (-1.0, 1.0), strict=True
        ):
            if body == GROUND:
                continue
            for i in range(3):
                self.entries[line, self.of_body[body] + 3 + i] = mask * one.normals[body][i]
                if not one.row.turns:
                    self.entries[line, self.of_body[body] + i] = mask * (sign * one.e[i])
        self.side[line] = mask * one.gamma
        if one.row.kinds:  # the constraint while active, else zero load along it
            column, along = (_MOMENT_B, one.arms[1]) if one.row.turns else (_FORCE_B, one.e)
            for k in range(3):
                self.entries[line, first + column + k] = (1.0 - mask) * along[k]

    def _free_translations(self, joint: str, rows: list[JointRow]) -> list[Any]:
        """Directions (unit vectors, ground axes) along which a joint carries no force, given its
        translation ``rows``."""
        if any(one.row.code == at.ROD for one in rows):
            return _perpendicular(rows[0].e)
        constrained = {one.row.code for one in rows}
        return [self.s.axis(joint, k) for k in range(3) if k not in constrained]

    def solve(self) -> tuple[dict[str, Any], dict[str, Any], dict[str, Wrench]]:
        """Solve the system: add lines to the scope of the state that store the matrix, solve it,
        and leave a case in which it is singular to the kernel variant LEAST_SQUARES.

        Returns
        -------
        acceleration : dict of str to tuple of Expr
            acceleration of the mass centre by body, ground axes, m/s2
        spin_rate : dict of str to tuple of Expr
            angular acceleration by body, body axes, rad/s2
        wrenches : dict of str to Wrench
            force, N, and moment, N m, on the second body by joint, ground axes
        """
        s, n, name = self.s, self.n, self.s.segment.name
        workspace, scope = s.c.workspace, s.scope
        for field, size in (
            (f"SYSTEM_{name}", n * n + n),
            (f"SOLUTION_{name}", n),
            (f"SCRATCH_{name}", n * n + n),
        ):
            workspace.add(field, size)
        for (i, k), value in self.entries.items():
            scope.store(component(f"SYSTEM_{name}", i * n + k), value)
        for i, value in enumerate(self.side):
            scope.store(component(f"SYSTEM_{name}", n * n + i), value)
        w, system, solution, scratch = map(
            scope.named, ("w", f"SYSTEM_{name} + l", f"SOLUTION_{name} + l", f"SCRATCH_{name}")
        )
        pivot = linear.eliminate(w, system, n, scratch, solution).called("pivot")
        reject_unless(scope, pivot > 0.0, Variant.LEAST_SQUARES)

        def vector(k: int) -> Any:
            """Three components of the solution from number ``k`` on."""
            return tuple(scope.load(component(f"SOLUTION_{name}", k + i)) for i in range(3))

        acceleration = {body: vector(k) for body, k in self.of_body.items()}
        spin_rate = {body: vector(k + 3) for body, k in self.of_body.items()}
        return (
            acceleration,
            spin_rate,
            {
                joint: (vector(k + _FORCE_B), vector(k + _MOMENT_B))
                for joint, k in self.of_joint.items()
            },
        )


def _free_rotations(rows: list[JointRow]) -> list[Any]:
    """Directions (ground axes) about which a joint carries no moment, given its rotation
    ``rows``."""
    normals = [one.arms[1] for one in rows]
    if not normals:
        return list(UNIT)
    if len(normals) == 1:
        return _perpendicular(normals[0])
    return [vec3.cross(*normals)] if len(normals) == 2 else []


def _perpendicular(along: Any) -> list[Any]:
    """Two unit vectors that form a right-handed frame with the unit vector ``along``, which is the
    first of its axes."""
    one = vec3.perpendicular(along).called("perpendicular")
    return [one, vec3.cross(along, one)]
