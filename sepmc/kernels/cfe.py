"""The constraint force equations: constraint rows, then the full system of the paper or its reduced form."""

import math

from sepmc.kernels import joints, vec3
from sepmc.kernels import layout as at
from sepmc.kernels._jit import formula, keep_apart, stage
from sepmc.kernels.linear import solve_ldlt, solve_lu, solve_semidefinite
from sepmc.kernels.places import body_params, body_work, first_body, joint_axes_x, joint_work, kind_of, kind_rows, row_work, second_body


@formula
def attitude(b, m, w):
    """Attitude matrix of body b."""
    return vec3.get_matrix(w, body_work(b, m) + at.ATTITUDE)


@stage
def pair_geometry(y, a, b, arm_a, arm_b, m, w):
    """Of a point of body a and one of body b (arms in body axes): arms and angular rates in ground axes, d = r_B - r_A and d'."""
    ra, rb = attitude(a, m, w), attitude(b, m, w)
    rho_a, rho_b = vec3.rotate(ra, arm_a), vec3.rotate(rb, arm_b)
    ya, yb = a * at.STATE, b * at.STATE
    omega_a, omega_b = vec3.rotate(ra, vec3.get(y, ya + at.RATE)), vec3.rotate(rb, vec3.get(y, yb + at.RATE))
    x_a, v_a = vec3.get(y, ya + at.POSITION), vec3.get(y, ya + at.VELOCITY)
    x_b, v_b = vec3.get(y, yb + at.POSITION), vec3.get(y, yb + at.VELOCITY)
    d, d_rate = joints.between(x_a, v_a, rho_a, omega_a, x_b, v_b, rho_b, omega_b)
    return rho_a, rho_b, omega_a, omega_b, d, d_rate


@stage
def joint_geometry(y, j, m, w):
    """`pair_geometry` of joint j; leaves d and d' in w."""
    keep_apart()
    work = joint_work(j, m)
    found = pair_geometry(y, first_body(j, m), second_body(j, m), vec3.get(w, work + at.RHO_A), vec3.get(w, work + at.RHO_B), m, w)
    vec3.put(w, work + at.GAP, found[4])
    vec3.put(w, work + at.GAP_RATE, found[5])
    return found


@stage
def joint_axes(j, m, w):
    """Axes x, y, z of joint j as carried by its first body, then x and y as carried by the second, ground axes."""
    keep_apart()
    ra, rb = attitude(first_body(j, m), m, w), attitude(second_body(j, m), m, w)
    x, work = joint_axes_x(j), joint_work(j, m) + at.AXES_B
    return (
        vec3.rotate(ra, vec3.get(m.numbers, x)),
        vec3.rotate(ra, vec3.get(m.numbers, x + 3)),
        vec3.rotate(ra, vec3.get(m.numbers, x + 6)),
        vec3.rotate(rb, vec3.get(w, work)),
        vec3.rotate(rb, vec3.get(w, work + 3)),
    )


@stage
def separation(y, j, m, w):
    """Separation distance of joint j along its x axis since the start, positive apart, m, and its rate, m/s. Needs attitudes."""
    keep_apart()
    _, _, omega_a, _, d, d_rate = joint_geometry(y, j, m, w)
    x = joint_axes_x(j)
    e = vec3.rotate(attitude(first_body(j, m), m, w), vec3.get(m.numbers, x))
    sign = m.numbers[x + 9]
    return sign * (vec3.dot(d, e) - w[joint_work(j, m) + at.GAP_START]), sign * joints.translation_rate(d, d_rate, e, omega_a)


@stage
def build_rows(y, m, w):
    """Constraint rows of every joint as it holds now. Returns their number. Needs attitudes.

    Lever arms are stored in the body axes of their body, where inertia is constant.
    """
    keep_apart()
    r = 0
    zero = (0.0, 0.0, 0.0)
    for j in range(m.scene.n_joints):
        kind = kind_rows(kind_of(j, m, w), m)
        count = m.table[kind]
        if count == 0:
            continue
        ra, rb = attitude(first_body(j, m), m, w), attitude(second_body(j, m), m, w)
        rho_a, rho_b, omega_a, omega_b, d, d_rate = joint_geometry(y, j, m, w)
        ax, ay, az, bx, by = joint_axes(j, m, w)
        for k in range(count):
            code = m.table[kind + 1 + k]
            if at.ROTATION <= code < at.ROD:
                e = zero
                va, vb = joints.perpendicular_pair((code - at.ROTATION) // 3, (code - at.ROTATION) % 3, ax, ay, az, bx, by)
                n, gamma = joints.rotation(va, vb, omega_a, omega_b)
                arm_a, arm_b = vec3.scale(-1.0, n), n
                value, rate = vec3.dot(va, vb), joints.rotation_rate(va, vb, omega_a, omega_b)
            else:
                n = zero
                if code == at.ROD:
                    e, arm_a, arm_b, gamma = joints.rod(d, d_rate, rho_a, rho_b, omega_a, omega_b)
                    value, rate = math.sqrt(vec3.dot(d, d)) - w[joint_work(j, m) + at.ROD_LENGTH], vec3.dot(d_rate, e)
                else:
                    e = ax if code == 0 else (ay if code == 1 else az)
                    arm_a, arm_b, gamma = joints.translation(d, d_rate, e, rho_a, rho_b, omega_a, omega_b)
                    value, rate = vec3.dot(d, e), joints.translation_rate(d, d_rate, e, omega_a)
            if m.scene.drift == at.BAUMGARTE:
                gamma -= at.BAUMGARTE_RATE * (2.0 * rate + at.BAUMGARTE_RATE * value)
            row = row_work(r, m)
            vec3.put(w, row + at.ROW_E, e)
            vec3.put(w, row + at.ROW_A, vec3.unrotate(ra, arm_a))
            vec3.put(w, row + at.ROW_B, vec3.unrotate(rb, arm_b))
            vec3.put(w, row + at.ROW_N, n)
            w[row + at.ROW_GAMMA] = gamma
            w[row + at.ROW_JOINT] = j
            w[row + at.ROW_VALUE] = value
            w[row + at.ROW_RATE] = rate
            r += 1
    return r


@formula
def is_translation(row, w):
    """Whether a row holds a translation or a rod, not a rotation."""
    return w[row + at.ROW_E] != 0.0 or w[row + at.ROW_E + 1] != 0.0 or w[row + at.ROW_E + 2] != 0.0


@stage
def free_motion(m, w):
    """Accelerations without constraints: m a = F, J w' = M - w x J w; paper eqs (8), (9) with the gyroscopic term."""
    for b in range(m.scene.n_bodies):
        work = body_work(b, m)
        vec3.put(w, work + at.ACCEL, vec3.scale(w[work + at.INVERSE_MASS], vec3.get(w, work + at.LOAD)))
        vec3.put(w, work + at.ACCEL + 3, vec3.rotate(vec3.get_matrix(w, work + at.INVERSE), vec3.get(w, work + at.LOAD + 3)))


@formula
def _coupling(e, turned, inverse_mass, other, arm, w):
    """One body's share of G M^-1 G^T between a row (e, inverse inertia times its arm) and another row stored in w."""
    return vec3.dot(e, vec3.get(w, other + at.ROW_E)) * inverse_mass, vec3.dot(turned, vec3.get(w, other + arm))


@stage
def _put_reduced(rows, m, w):
    """Lower triangle of G M^-1 G^T, and gamma - G M^-1 f on the right."""
    for r in range(rows):
        row = row_work(r, m)
        j = int(w[row + at.ROW_JOINT])
        a, b = first_body(j, m), second_body(j, m)
        wa, wb = body_work(a, m), body_work(b, m)
        e = vec3.get(w, row + at.ROW_E)
        w[m.scene.rhs_w + r] = (
            w[row + at.ROW_GAMMA]
            - vec3.dot(e, vec3.sub(vec3.get(w, wb + at.ACCEL), vec3.get(w, wa + at.ACCEL)))
            - vec3.dot(vec3.get(w, row + at.ROW_A), vec3.get(w, wa + at.ACCEL + 3))
            - vec3.dot(vec3.get(w, row + at.ROW_B), vec3.get(w, wb + at.ACCEL + 3))
        )
        turned_a = vec3.rotate(vec3.get_matrix(w, wa + at.INVERSE), vec3.get(w, row + at.ROW_A))
        turned_b = vec3.rotate(vec3.get_matrix(w, wb + at.INVERSE), vec3.get(w, row + at.ROW_B))
        mass_a, mass_b = w[wa + at.INVERSE_MASS], w[wb + at.INVERSE_MASS]
        for s in range(r + 1):
            other = row_work(s, m)
            i = int(w[other + at.ROW_JOINT])
            c, d = first_body(i, m), second_body(i, m)
            total = 0.0  # translations act with -e on the first body of a joint and +e on the second
            if a == c:
                linear, angular = _coupling(e, turned_a, mass_a, other, at.ROW_A, w)
                total += linear + angular
            if a == d:
                linear, angular = _coupling(e, turned_a, mass_a, other, at.ROW_B, w)
                total += angular - linear
            if b == c:
                linear, angular = _coupling(e, turned_b, mass_b, other, at.ROW_A, w)
                total += angular - linear
            if b == d:
                linear, angular = _coupling(e, turned_b, mass_b, other, at.ROW_B, w)
                total += linear + angular
            w[m.scene.matrix_w + r * rows + s] = total


@stage
def solve_reduced(rows, m, w):
    """Multipliers from (G M^-1 G^T) lambda = gamma - G M^-1 f, then accelerations and joint wrenches.

    The free motion must stand in w. Where rows are redundant, the multipliers of least sum of squares. Returns the smallest
    relative pivot, 0 if there is no solution.
    """
    keep_apart()
    _put_reduced(rows, m, w)
    pivot = solve_ldlt(w, m.scene.matrix_w, m.scene.rhs_w, rows)
    if not pivot > 0.0:
        _put_reduced(rows, m, w)
        rank, pivot = solve_semidefinite(w, m.scene.matrix_w, m.scene.rhs_w, rows)
        if rank == 0:
            return 0.0
        w[m.scene.work + at.REDUNDANT] = max(w[m.scene.work + at.REDUNDANT], rows - rank)
    for r in range(rows):
        row = row_work(r, m)
        j = int(w[row + at.ROW_JOINT])
        multiplier = w[m.scene.rhs_w + r]
        force = vec3.scale(multiplier, vec3.get(w, row + at.ROW_E))
        _add(w, joint_work(j, m) + at.FORCE_B, force)
        _add(w, joint_work(j, m) + at.MOMENT_B, vec3.scale(multiplier, vec3.get(w, row + at.ROW_N)))
        _accelerate(first_body(j, m), vec3.scale(-1.0, force), vec3.scale(multiplier, vec3.get(w, row + at.ROW_A)), m, w)
        _accelerate(second_body(j, m), force, vec3.scale(multiplier, vec3.get(w, row + at.ROW_B)), m, w)
    return pivot


@formula
def _add(w, k, v):
    vec3.put(w, k, vec3.add(vec3.get(w, k), v))


@stage
def _accelerate(b, force, moment, m, w):
    """Add what a force (ground axes) and a moment (body axes) do to the acceleration of body b."""
    work = body_work(b, m)
    _add(w, work + at.ACCEL, vec3.scale(w[work + at.INVERSE_MASS], force))
    _add(w, work + at.ACCEL + 3, vec3.rotate(vec3.get_matrix(w, work + at.INVERSE), moment))


@stage
def load_pair(a, b, force, e, arm_a, arm_b, m, w):
    """Add to the loads of bodies a and b a force, N, that pushes them apart along e; arms in ground axes, as of a row."""
    wa, wb = body_work(a, m), body_work(b, m)
    _add(w, wa + at.LOAD, vec3.scale(-force, e))
    _add(w, wb + at.LOAD, vec3.scale(force, e))
    _add(w, wa + at.LOAD + 3, vec3.scale(force, vec3.unrotate(attitude(a, m, w), arm_a)))
    _add(w, wb + at.LOAD + 3, vec3.scale(force, vec3.unrotate(attitude(b, m, w), arm_b)))


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
            w[m.scene.matrix_w + (row + i) * n + column + k] = -moment[i]
            w[m.scene.matrix_w + (row + i) * n + column + 6 + k] = -turn[i]


@stage
def _put_bodies(n, m, w):
    """Equations of motion, paper eqs (12), (13), without the joints' terms; the ground does not accelerate."""
    for b in range(m.scene.n_bodies):
        work, moves = body_work(b, m), b != m.scene.ground
        for i in range(3):
            row = 6 * b + i
            w[m.scene.matrix_w + row * n + row] = w[body_params(b) + at.MASS] if moves else 1.0
            w[m.scene.rhs_w + row] = w[work + at.LOAD + i] if moves else 0.0
            w[m.scene.rhs_w + row + 3] = w[work + at.LOAD + 3 + i] if moves else 0.0
            for k in range(3):
                unit = 1.0 if i == k else 0.0
                w[m.scene.matrix_w + (row + 3) * n + 6 * b + 3 + k] = w[work + at.TENSOR + 3 * i + k] if moves else unit


@stage
def _put_reaction(first, n, d, m, w):
    """Action and reaction, paper eq (15): F_A + F_B = 0 and M_A + M_B + d x F_B = 0."""
    for i in range(3):
        force, moment = m.scene.matrix_w + (first + i) * n + first, m.scene.matrix_w + (first + 3 + i) * n + first
        w[force + i] = 1.0
        w[force + 3 + i] = 1.0
        w[moment + 6 + i] = 1.0
        w[moment + 9 + i] = 1.0
        for k in range(3):
            w[moment + 3 + k] = vec3.cross(d, _unit(k))[i]


@stage
def _put_constraint(line, row, a, b, m, w):
    """A constraint row on the accelerations of bodies a and b, in the line of the matrix that starts at ``line``."""
    for i in range(3):
        w[line + 6 * a + i] = -w[row + at.ROW_E + i]
        w[line + 6 * b + i] = w[row + at.ROW_E + i]
        w[line + 6 * a + 3 + i] = w[row + at.ROW_A + i]
        w[line + 6 * b + 3 + i] = w[row + at.ROW_B + i]


@stage
def _freedom(count, i, v0, v1):
    """Direction ``i`` of those perpendicular to the ``count`` independent vectors v0, v1 (0, 1 or 2 of them)."""
    if count == 0:
        return _unit(i)
    if count == 2:
        return vec3.unit(vec3.cross(v0, v1))
    least = 0 if abs(v0[0]) <= min(abs(v0[1]), abs(v0[2])) else (1 if abs(v0[1]) <= abs(v0[2]) else 2)
    first = vec3.unit(vec3.cross(v0, _unit(least)))
    return first if i == 0 else vec3.unit(vec3.cross(v0, first))


@stage
def _put_joint(j, first, first_row, n, m, w):
    """Six equations of joint j: its constraints, and that its wrench has no part along what is free (paper eqs 24, 25).

    Freedom is set on the wrench on B at r_B, the body that does not carry the axes: that is where the constraints leave none.
    """
    keep_apart()
    a, b = first_body(j, m), second_body(j, m)
    count = m.table[kind_rows(kind_of(j, m, w), m)]
    zero = (0.0, 0.0, 0.0)
    forces, moments, e0, e1, n0, n1 = 0, 0, zero, zero, zero, zero
    for k in range(count):
        row = row_work(first_row + k, m)
        _put_constraint(m.scene.matrix_w + (first + 6 + k) * n, row, a, b, m, w)
        w[m.scene.rhs_w + first + 6 + k] = w[row + at.ROW_GAMMA]
        if is_translation(row, w):
            e0, e1 = (vec3.get(w, row + at.ROW_E), e1) if forces == 0 else (e0, vec3.get(w, row + at.ROW_E))
            forces += 1
        else:
            n0, n1 = (vec3.get(w, row + at.ROW_N), n1) if moments == 0 else (n0, vec3.get(w, row + at.ROW_N))
            moments += 1
    line = first + 6 + count
    for i in range(3 - forces):
        direction = _freedom(forces, i, e0, e1)
        for k in range(3):
            w[m.scene.matrix_w + line * n + first + 3 + k] = direction[k]
        line += 1
    for i in range(3 - moments):
        direction = _freedom(moments, i, n0, n1)
        for k in range(3):
            w[m.scene.matrix_w + line * n + first + 9 + k] = direction[k]
        line += 1
    return count


@stage
def solve_full(y, m, w):
    """The system as the paper prints it (eqs 12-25): 6 n + 12 m unknowns, LU with partial pivoting.

    Unknowns: per body a (ground axes) and w' (body axes); per joint F_A, F_B, M_A, M_B (ground axes).
    Returns the smallest pivot, 0 if singular.
    """
    keep_apart()
    n = 6 * m.scene.n_bodies + 12 * m.scene.n_joints
    for i in range(n * n):
        w[m.scene.matrix_w + i] = 0.0
    for i in range(n):
        w[m.scene.rhs_w + i] = 0.0
    _put_bodies(n, m, w)
    build_rows(y, m, w)
    first_row = 0
    for j in range(m.scene.n_joints):
        a, b = first_body(j, m), second_body(j, m)
        rho_a, rho_b, _, _, d, _ = joint_geometry(y, j, m, w)
        first = 6 * m.scene.n_bodies + 12 * j
        for body, column, rho in ((a, first, rho_a), (b, first + 3, rho_b)):
            if body != m.scene.ground:
                for i in range(3):
                    w[m.scene.matrix_w + (6 * body + i) * n + column + i] = -1.0
                _put_lever(6 * body + 3, column, n, rho, attitude(body, m, w), m, w)
        _put_reaction(first, n, d, m, w)
        first_row += _put_joint(j, first, first_row, n, m, w)
    pivot = solve_lu(w, m.scene.matrix_w, m.scene.rhs_w, n)
    for b in range(m.scene.n_bodies):
        for i in range(6):
            w[body_work(b, m) + at.ACCEL + i] = w[m.scene.rhs_w + 6 * b + i]
    for j in range(m.scene.n_joints):
        first, work = m.scene.rhs_w + 6 * m.scene.n_bodies + 12 * j, joint_work(j, m)
        vec3.put(w, work + at.FORCE_A, vec3.get(w, first))
        vec3.put(w, work + at.FORCE_B, vec3.get(w, first + 3))
        vec3.put(w, work + at.MOMENT_A, vec3.get(w, first + 6))
        vec3.put(w, work + at.MOMENT_B, vec3.get(w, first + 9))
    return pivot


@stage
def clear_wrenches(m, w):
    """No wrench on any joint."""
    for j in range(m.scene.n_joints):
        for i in range(at.FORCE_B, at.KIND):
            w[joint_work(j, m) + i] = 0.0


@stage
def held_rows(m, w):
    """Number of constraint rows of all joints as they hold now."""
    held = 0
    for j in range(m.scene.n_joints):
        held += m.table[kind_rows(kind_of(j, m, w), m)]
    return held


@stage
def solve_motion(y, m, w):
    """Accelerations and joint wrenches from the loads in w. Returns the smallest pivot (1 if nothing is constrained).

    Where the full system is singular because rows are redundant, the reduced one gives the wrenches of least norm.
    """
    keep_apart()
    clear_wrenches(m, w)
    if held_rows(m, w) == 0:
        free_motion(m, w)
        return 1.0
    if m.scene.formulation == at.FULL:
        pivot = solve_full(y, m, w)
        if pivot > 0.0:
            return pivot
        clear_wrenches(m, w)
    free_motion(m, w)
    pivot = solve_reduced(build_rows(y, m, w), m, w)
    for j in range(m.scene.n_joints):
        _react(j, m, w)
    return pivot


@stage
def _react(j, m, w):
    """Wrench on A from that on B, by action and reaction: what the virtual work of the rows gives (paper eq 15)."""
    work = joint_work(j, m)
    force_b, moment_b = vec3.get(w, work + at.FORCE_B), vec3.get(w, work + at.MOMENT_B)
    vec3.put(w, work + at.FORCE_A, vec3.scale(-1.0, force_b))
    vec3.put(w, work + at.MOMENT_A, vec3.scale(-1.0, vec3.add(moment_b, vec3.cross(vec3.get(w, work + at.GAP), force_b))))
