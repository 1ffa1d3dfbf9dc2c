"""The constraint force equations: constraint rows, then the full system of the paper or its reduced form."""

from sepmc.kernels import joints, vec3
from sepmc.kernels._jit import formula, stage
from sepmc.kernels.layout import (
    ACCEL,
    ATTITUDE,
    AXES_B,
    FORCE_A,
    FORCE_B,
    FULL,
    GAP,
    GAP_RATE,
    INVERSE,
    JOINT_WORK,
    LOAD,
    MASS,
    MOMENT_A,
    MOMENT_B,
    POSITION,
    RATE,
    RHO_A,
    RHO_B,
    ROW_A,
    ROW_B,
    ROW_E,
    ROW_GAMMA,
    ROW_JOINT,
    ROW_N,
    STATE,
    TENSOR,
    VELOCITY,
)
from sepmc.kernels.linear import solve_ldlt, solve_lu
from sepmc.kernels.places import body_params, body_work, first_body, joint_work, row_work, second_body


@formula
def _mass(b, w):
    return w[body_params(b) + MASS]


@formula
def attitude(b, m, w):
    """Attitude matrix of body b."""
    return vec3.get_matrix(w, body_work(b, m) + ATTITUDE)


@stage
def joint_geometry(y, j, m, w):
    """Lever arms and angular rates of both bodies in ground axes, and the gap d and d' of joint j (also left in w)."""
    a, b, at = first_body(j, m), second_body(j, m), joint_work(j, m)
    ra, rb = attitude(a, m, w), attitude(b, m, w)
    rho_a, rho_b = vec3.rotate(ra, vec3.get(w, at + RHO_A)), vec3.rotate(rb, vec3.get(w, at + RHO_B))
    ya, yb = a * STATE, b * STATE
    omega_a, omega_b = vec3.rotate(ra, vec3.get(y, ya + RATE)), vec3.rotate(rb, vec3.get(y, yb + RATE))
    d = vec3.sub(vec3.add(vec3.get(y, yb + POSITION), rho_b), vec3.add(vec3.get(y, ya + POSITION), rho_a))
    d_rate = vec3.sub(
        vec3.add(vec3.get(y, yb + VELOCITY), vec3.cross(omega_b, rho_b)), vec3.add(vec3.get(y, ya + VELOCITY), vec3.cross(omega_a, rho_a))
    )
    vec3.put(w, at + GAP, d)
    vec3.put(w, at + GAP_RATE, d_rate)
    return rho_a, rho_b, omega_a, omega_b, d, d_rate


@stage
def joint_axes(j, m, w):
    """Axes x, y, z of joint j as carried by its first body, then x and y as carried by the second, ground axes."""
    ra, rb = attitude(first_body(j, m), m, w), attitude(second_body(j, m), m, w)
    at = joint_work(j, m) + AXES_B
    return (
        vec3.rotate(ra, vec3.get(m.numbers, 10 * j)),
        vec3.rotate(ra, vec3.get(m.numbers, 10 * j + 3)),
        vec3.rotate(ra, vec3.get(m.numbers, 10 * j + 6)),
        vec3.rotate(rb, vec3.get(w, at)),
        vec3.rotate(rb, vec3.get(w, at + 3)),
    )


@stage
def build_rows(y, wanted, m, w):
    """Rows of every joint axis whose flag is set; flags start at m.table[wanted]. Returns the number of rows.

    Lever arms are stored in the body axes of their body, where inertia is constant.
    """
    r = 0
    zero = (0.0, 0.0, 0.0)
    for j in range(m.n_joints):
        ra, rb = attitude(first_body(j, m), m, w), attitude(second_body(j, m), m, w)
        rho_a, rho_b, omega_a, omega_b, d, d_rate = joint_geometry(y, j, m, w)
        ax, ay, az, bx, by = joint_axes(j, m, w)
        for k in range(6):
            if m.table[wanted + 6 * j + k] == 0:
                continue
            if k < 3:
                e = ax if k == 0 else (ay if k == 1 else az)
                n = zero
                arm_a, arm_b, gamma = joints.translation(d, d_rate, e, rho_a, rho_b, omega_a, omega_b)
            else:
                e = zero
                va, vb = joints.rotation_pair(k - 3, ax, ay, az, bx, by)
                n, gamma = joints.rotation(va, vb, omega_a, omega_b)
                arm_a, arm_b = vec3.scale(-1.0, n), n
            at = row_work(r, m)
            vec3.put(w, at + ROW_E, e)
            vec3.put(w, at + ROW_A, vec3.unrotate(ra, arm_a))
            vec3.put(w, at + ROW_B, vec3.unrotate(rb, arm_b))
            vec3.put(w, at + ROW_N, n)
            w[at + ROW_GAMMA] = gamma
            w[at + ROW_JOINT] = j
            r += 1
    return r


@stage
def free_motion(m, w):
    """Accelerations without constraints: m a = F, J w' = M - w x J w; paper eqs (8), (9) with the gyroscopic term."""
    for b in range(m.n_bodies):
        at = body_work(b, m)
        vec3.put(w, at + ACCEL, vec3.scale(1.0 / _mass(b, w), vec3.get(w, at + LOAD)))
        vec3.put(w, at + ACCEL + 3, vec3.rotate(vec3.get_matrix(w, at + INVERSE), vec3.get(w, at + LOAD + 3)))


@formula
def _coupling(e, turned, mass, other, arm, w):
    """One body's share of G M^-1 G^T between a row (e, inverse inertia times its arm) and another row stored in w."""
    return vec3.dot(e, vec3.get(w, other + ROW_E)) / mass, vec3.dot(turned, vec3.get(w, other + arm))


@stage
def solve_reduced(rows, m, w):
    """Multipliers from (G M^-1 G^T) lambda = gamma - G M^-1 f, then accelerations and joint wrenches.

    The free motion must stand in w. Returns the smallest relative pivot, 0 if rows are dependent.
    """
    for r in range(rows):
        at = row_work(r, m)
        j = int(w[at + ROW_JOINT])
        a, b = first_body(j, m), second_body(j, m)
        wa, wb = body_work(a, m), body_work(b, m)
        e = vec3.get(w, at + ROW_E)
        w[m.rhs_w + r] = (
            w[at + ROW_GAMMA]
            - vec3.dot(e, vec3.sub(vec3.get(w, wb + ACCEL), vec3.get(w, wa + ACCEL)))
            - vec3.dot(vec3.get(w, at + ROW_A), vec3.get(w, wa + ACCEL + 3))
            - vec3.dot(vec3.get(w, at + ROW_B), vec3.get(w, wb + ACCEL + 3))
        )
        turned_a = vec3.rotate(vec3.get_matrix(w, wa + INVERSE), vec3.get(w, at + ROW_A))
        turned_b = vec3.rotate(vec3.get_matrix(w, wb + INVERSE), vec3.get(w, at + ROW_B))
        for s in range(r + 1):
            other = row_work(s, m)
            i = int(w[other + ROW_JOINT])
            c, d = first_body(i, m), second_body(i, m)
            total = 0.0  # translations act with -e on the first body of a joint and +e on the second
            if a == c:
                linear, angular = _coupling(e, turned_a, _mass(a, w), other, ROW_A, w)
                total += linear + angular
            if a == d:
                linear, angular = _coupling(e, turned_a, _mass(a, w), other, ROW_B, w)
                total += angular - linear
            if b == c:
                linear, angular = _coupling(e, turned_b, _mass(b, w), other, ROW_A, w)
                total += angular - linear
            if b == d:
                linear, angular = _coupling(e, turned_b, _mass(b, w), other, ROW_B, w)
                total += linear + angular
            w[m.matrix_w + r * rows + s] = total
    pivot = solve_ldlt(w, m.matrix_w, m.rhs_w, rows)
    if pivot <= 0.0:
        return pivot
    for r in range(rows):
        at = row_work(r, m)
        j = int(w[at + ROW_JOINT])
        multiplier = w[m.rhs_w + r]
        push = vec3.scale(multiplier, vec3.get(w, at + ROW_E))
        _add(w, joint_work(j, m) + FORCE_B, push)
        _add(w, joint_work(j, m) + MOMENT_B, vec3.scale(multiplier, vec3.get(w, at + ROW_N)))
        a, b = first_body(j, m), second_body(j, m)
        _accelerate(a, vec3.scale(-1.0, push), vec3.scale(multiplier, vec3.get(w, at + ROW_A)), m, w)
        _accelerate(b, push, vec3.scale(multiplier, vec3.get(w, at + ROW_B)), m, w)
    return pivot


@formula
def _add(w, k, v):
    vec3.put(w, k, vec3.add(vec3.get(w, k), v))


@stage
def _accelerate(b, force, moment, m, w):
    """Add what a force (ground axes) and a moment (body axes) do to the acceleration of body b."""
    at = body_work(b, m)
    _add(w, at + ACCEL, vec3.scale(1.0 / _mass(b, w), force))
    _add(w, at + ACCEL + 3, vec3.rotate(vec3.get_matrix(w, at + INVERSE), moment))


@formula
def _unit(k):
    return (1.0 if k == 0 else 0.0, 1.0 if k == 1 else 0.0, 1.0 if k == 2 else 0.0)


@stage
def _put_lever(row, column, n, rho, r, m, w):
    """Minus the moment, in body axes, of a force at ``column`` (lever rho) and of a moment six columns further."""
    for k in range(3):
        moment = vec3.unrotate(r, vec3.cross(rho, _unit(k)))
        turn = vec3.unrotate(r, _unit(k))
        for i in range(3):
            w[m.matrix_w + (row + i) * n + column + k] = -moment[i]
            w[m.matrix_w + (row + i) * n + column + 6 + k] = -turn[i]


@stage
def _put_bodies(n, m, w):
    """Equations of motion, paper eqs (12), (13), without the joints' terms."""
    for b in range(m.n_bodies):
        at = body_work(b, m)
        for i in range(3):
            row = 6 * b + i
            w[m.matrix_w + row * n + row] = _mass(b, w)
            w[m.rhs_w + row] = w[at + LOAD + i]
            w[m.rhs_w + row + 3] = w[at + LOAD + 3 + i]
            for k in range(3):
                w[m.matrix_w + (row + 3) * n + 6 * b + 3 + k] = w[at + TENSOR + 3 * i + k]


@stage
def _put_reaction(first, n, d, m, w):
    """Action and reaction, paper eq (15): F_A + F_B = 0 and M_A + M_B + d x F_B = 0."""
    for i in range(3):
        force, moment = m.matrix_w + (first + i) * n + first, m.matrix_w + (first + 3 + i) * n + first
        w[force + i] = 1.0
        w[force + 3 + i] = 1.0
        w[moment + 6 + i] = 1.0
        w[moment + 9 + i] = 1.0
        for k in range(3):
            w[moment + 3 + k] = vec3.cross(d, _unit(k))[i]


@stage
def _put_axis(row, first, at, a, b, holds, n, m, w):
    """One joint axis: its constraint, or that the wrench has no part along it (paper eqs 24, 25).

    A free moment is set on B, the body that does not carry the axes: that is where the constraints leave none.
    """
    line = m.matrix_w + row * n
    for i in range(3):
        if holds:
            w[line + 6 * a + i] = -w[at + ROW_E + i]
            w[line + 6 * b + i] = w[at + ROW_E + i]
            w[line + 6 * a + 3 + i] = w[at + ROW_A + i]
            w[line + 6 * b + 3 + i] = w[at + ROW_B + i]
        else:
            w[line + first + i] = w[at + ROW_E + i]
            w[line + first + 9 + i] = w[at + ROW_N + i]
    w[m.rhs_w + row] = w[at + ROW_GAMMA] if holds else 0.0


@stage
def solve_full(y, wanted, m, w):
    """The system as the paper prints it (eqs 12-25): 6 n + 12 m unknowns, LU with partial pivoting.

    Unknowns: per body a (ground axes) and w' (body axes); per joint F_A, F_B, M_A, M_B (ground axes).
    Returns the smallest pivot, 0 if singular.
    """
    n = 6 * m.n_bodies + 12 * m.n_joints
    for i in range(n * n):
        w[m.matrix_w + i] = 0.0
    for i in range(n):
        w[m.rhs_w + i] = 0.0
    _put_bodies(n, m, w)
    build_rows(y, m.all_axes_i, m, w)
    for j in range(m.n_joints):
        a, b = first_body(j, m), second_body(j, m)
        rho_a, rho_b, _, _, d, _ = joint_geometry(y, j, m, w)
        first = 6 * m.n_bodies + 12 * j
        for i in range(3):
            w[m.matrix_w + (6 * a + i) * n + first + i] = -1.0
            w[m.matrix_w + (6 * b + i) * n + first + 3 + i] = -1.0
        _put_lever(6 * a + 3, first, n, rho_a, attitude(a, m, w), m, w)
        _put_lever(6 * b + 3, first + 3, n, rho_b, attitude(b, m, w), m, w)
        _put_reaction(first, n, d, m, w)
        for k in range(6):
            _put_axis(first + 6 + k, first, row_work(6 * j + k, m), a, b, m.table[wanted + 6 * j + k] != 0, n, m, w)
    pivot = solve_lu(w, m.matrix_w, m.rhs_w, n)
    for b in range(m.n_bodies):
        for i in range(6):
            w[body_work(b, m) + ACCEL + i] = w[m.rhs_w + 6 * b + i]
    for j in range(m.n_joints):
        first, at = m.rhs_w + 6 * m.n_bodies + 12 * j, joint_work(j, m)
        vec3.put(w, at + FORCE_A, vec3.get(w, first))
        vec3.put(w, at + FORCE_B, vec3.get(w, first + 3))
        vec3.put(w, at + MOMENT_A, vec3.get(w, first + 6))
        vec3.put(w, at + MOMENT_B, vec3.get(w, first + 9))
    return pivot


@stage
def solve_motion(y, wanted, m, w):
    """Accelerations and joint wrenches from the loads in w. Returns the smallest pivot (1 if nothing is constrained)."""
    if m.formulation == FULL:
        return solve_full(y, wanted, m, w)
    for j in range(m.n_joints):
        for i in range(FORCE_B, JOINT_WORK):
            w[joint_work(j, m) + i] = 0.0
    free_motion(m, w)
    held = 0
    for k in range(6 * m.n_joints):
        held += m.table[wanted + k]
    if held == 0:
        return 1.0
    pivot = solve_reduced(build_rows(y, wanted, m, w), m, w)
    for j in range(m.n_joints):
        _react(j, m, w)
    return pivot


@stage
def _react(j, m, w):
    """Wrench on A from that on B, by action and reaction: what the virtual work of the rows gives (paper eq 15)."""
    at = joint_work(j, m)
    force_b, moment_b = vec3.get(w, at + FORCE_B), vec3.get(w, at + MOMENT_B)
    vec3.put(w, at + FORCE_A, vec3.scale(-1.0, force_b))
    vec3.put(w, at + MOMENT_A, vec3.scale(-1.0, vec3.add(moment_b, vec3.cross(vec3.get(w, at + GAP), force_b))))
