"""Newton's method for the coupled contact solve, by proximal steps.

Of a contact with the velocity g off its target and the effective mass m, the impulse λ is to be  P(λ - m g),  with P the
projection onto p >= 0 and then onto the disc μ p of friction. A proximal step solves  λ = P(λ0 - s m g)  with s > 1 instead,
from the impulses λ0 of the last one (Rockafellar 1976): contacts yield in proportion to the change of their impulses, so that
there is a solution where they are more than the bodies have degrees of freedom, and redundant ones share a load as they did
before. It is an equation in the velocities alone, smooth but for kinks, which Newton's method solves in a few steps (Alart and
Curnier 1991).
"""

from __future__ import annotations

import math

from geomphys.engine.coupled_state import Constraint, Coupled
from geomphys.jit.kernel import kernel, noinline
from geomphys.numerics.row_vectors import rot_of, set_vec, vec_of
from geomphys.numerics.vec3 import Vec, add_scaled, dot, rotate, sub

STEPS = 8  # Newton steps of a proximal step
HALVINGS = 8  # of a Newton step that does not lessen the residual
SMOOTH = 1e-2  # of the residual: after a step that leaves no more its factors serve again
REPEATS = 4  # of a Newton step's factors


@kernel
def velocity_of(c: Coupled, r: Constraint) -> Vec:
    """Velocity of a constraint off its target [m/s]."""
    g = vec_of(r.off_target)
    for k in range(r.first_term, r.end_term):
        g = add_scaled(g, vec_of(c.terms[k].jacobian), c.rows[c.terms[k].row].change)
    return g


@kernel
def project(r: Constraint, j: Vec) -> Vec:
    """Project impulses of a constraint: normal impulse >= 0, friction in the disc; sets `sliding`: see `CONSTRAINT`."""
    n = max(0.0, j[0])
    size, cap = math.sqrt(j[1] * j[1] + j[2] * j[2]), r.friction * n
    r.sliding = 0
    if size <= cap:
        return (n, j[1], j[2])
    r.sliding = 1
    r.part, r.direction[0], r.direction[1] = cap / size, j[1] / size, j[2] / size
    return (n, j[1] * r.part, j[2] * r.part)


@kernel
def impulse_by(r: Constraint, g: Vec, s: float) -> Vec:
    """Impulses of a constraint with the velocity `g` off its target, that yields by s times its effective mass."""
    j, n, t = vec_of(r.reference), s * r.mass_n, s * r.mass_t
    return project(r, (j[0] - n * g[0], j[1] - t * g[1], j[2] - t * g[2]))


@noinline
def set_residual(c: Coupled, s: float) -> float:
    """Impulses by the velocities, and the residual M δv - Jᵀ (λ - λ_start) of the rows; returns its size, twice an energy [J]."""
    for i in range(c.solve.rows):
        c.rows[i].residual = c.rows[i].mass * c.rows[i].change
    for i in range(c.solve.blocks):
        k = c.blocks[i].row
        rotation = (c.rows[k].change, c.rows[k + 1].change, c.rows[k + 2].change)
        momentum = rotate(rot_of(c.blocks[i].inertia), rotation)
        c.rows[k].residual, c.rows[k + 1].residual, c.rows[k + 2].residual = momentum
    for i in range(c.solve.constraints):
        r = c.constraints[i]
        j = impulse_by(r, velocity_of(c, r), s)
        set_vec(r.impulse, j)
        change = sub(j, vec_of(r.start))
        if change != (0.0, 0.0, 0.0):
            for k in range(r.first_term, r.end_term):
                c.rows[c.terms[k].row].residual -= dot(vec_of(c.terms[k].jacobian), change)
    size = 0.0
    for i in range(c.solve.rows):
        row = c.rows[i]
        if row.mass > 0.0:
            size += row.residual * row.residual / row.mass
    for i in range(c.solve.blocks):
        k = c.blocks[i].row
        momentum = (c.rows[k].residual, c.rows[k + 1].residual, c.rows[k + 2].residual)
        size += dot(momentum, rotate(rot_of(c.blocks[i].inverse_inertia), momentum))
    return size


@kernel
def begin_matrix(c: Coupled) -> None:
    """Set the matrix to that of the masses."""
    rows = c.solve.rows
    for i in range(rows):
        for j in range(rows):
            c.matrix[i, j] = 0.0
        c.matrix[i, i] = c.rows[i].mass
    for i in range(c.solve.blocks):
        k = c.blocks[i].row
        for m in range(3):
            for n in range(3):
                c.matrix[k + n, k + m] = c.blocks[i].inertia[3 * m + n]


@kernel
def add_sticking(c: Coupled, r: Constraint, n: float, t: float) -> None:
    """`add_to_matrix` where friction is within its bound: B is diagonal, `n` along the normal and `t` across."""
    for k in range(r.first_term, r.end_term):
        j, row = vec_of(c.terms[k].jacobian), c.terms[k].row
        response = (n * j[0], t * j[1], t * j[2])
        c.matrix[row, row] += dot(j, response)
        for m in range(r.first_term, k):
            entry, other = dot(vec_of(c.terms[m].jacobian), response), c.terms[m].row
            c.matrix[row, other] += entry
            c.matrix[other, row] += entry


@kernel
def add_to_matrix(c: Coupled, r: Constraint, s: float) -> None:
    """Add Jᵀ B J of a pressed constraint, with B the derivative of minus its impulses by its velocity."""
    n, t = s * r.mass_n, s * r.mass_t
    if r.sliding == 0:
        add_sticking(c, r, n, t)
        return
    x, y = r.direction[0], r.direction[1]  # along it friction is μ p; across it, it turns with the direction
    t *= r.part
    n_t, n_b, tt, tb, bb = n * r.friction * x, n * r.friction * y, t * y * y, -t * x * y, t * x * x
    for k in range(r.first_term, r.end_term):
        j, column = vec_of(c.terms[k].jacobian), c.matrix[c.terms[k].row]
        response = (n * j[0], n_t * j[0] + tt * j[1] + tb * j[2], n_b * j[0] + tb * j[1] + bb * j[2])
        for m in range(r.first_term, r.end_term):
            column[c.terms[m].row] += dot(vec_of(c.terms[m].jacobian), response)


@noinline
def factorize_matrix(c: Coupled) -> bool:
    """LU factors of the matrix, without pivoting, in its place. False: it is singular."""
    rows, a = c.solve.rows, c.matrix
    for k in range(rows):
        if not abs(a[k, k]) > 0.0:
            return False
        inverse, below = 1.0 / a[k, k], rows - k - 1
        column, factors = a[k, k + 1 : rows], c.factors[:below]  # indexed from 0, LLVM makes vectors of them
        for i in range(below):
            column[i] *= inverse
            factors[i] = column[i]
        for j in range(k + 1, rows):
            pivot = a[j, k]
            if pivot != 0.0:
                other = a[j, k + 1 : rows]
                for i in range(below):
                    other[i] -= pivot * factors[i]
    return True


@noinline
def substitute(c: Coupled) -> None:
    """Set `step` to the Newton step of the present residual by the LU factors of the matrix."""
    rows, a, x = c.solve.rows, c.matrix, c.step
    for i in range(rows):
        x[i] = -c.rows[i].residual
    for k in range(rows):
        y, below, column = x[k], x[k + 1 : rows], a[k, k + 1 : rows]
        for i in range(rows - k - 1):
            below[i] -= column[i] * y
    for k in range(rows - 1, -1, -1):
        x[k] /= a[k, k]
        y, above, column = x[k], x[:k], a[k, :k]
        for i in range(k):
            above[i] -= y * column[i]


@kernel
def add_step(c: Coupled, part: float) -> None:
    """Add `part` of the Newton step to the velocities."""
    for i in range(c.solve.rows):
        c.rows[i].change += part * c.step[i]


@noinline
def newton_step(c: Coupled, s: float, size: float) -> float:
    """One Newton step of a proximal step, shortened until the residual is less than `size`; returns its size then."""
    begin_matrix(c)
    for i in range(c.solve.constraints):
        if c.constraints[i].impulse[0] > 0.0:
            add_to_matrix(c, c.constraints[i], s)
    if not factorize_matrix(c):
        return size
    substitute(c)
    add_step(c, 1.0)
    part, found = 1.0, set_residual(c, s)
    for _ in range(HALVINGS):
        if found < size:
            break
        part *= 0.5
        add_step(c, -part)
        found = set_residual(c, s)
    return found


@kernel
def repeat_step(c: Coupled, s: float, size: float, small: float) -> float:
    """Steps with the factors of the last Newton step, down to the size `small`, while they lessen the residual as much.

    Returns its size.
    """
    for _ in range(REPEATS):
        if size <= small:
            break
        substitute(c)
        add_step(c, 1.0)
        found = set_residual(c, s)
        if not found < size:
            add_step(c, -1.0)
            return set_residual(c, s)
        before, size = size, found
        if size > SMOOTH * before:
            break
    return size


@noinline
def proximal_step(c: Coupled, s: float, precision: float) -> bool:
    """One proximal step with contacts that yield by s times their effective mass: new `reference` impulses, and their velocities.

    It is solved to `precision` [m/s].

    False: Newton's method does not converge, and nothing is changed.
    """
    size, lightest = set_residual(c, s), math.inf
    for i in range(c.solve.constraints):
        r = c.constraints[i]
        lightest = min(lightest, r.mass_n)
        if r.friction > 0.0:
            lightest = min(lightest, r.mass_t)
    small = lightest * precision * precision  # no velocity of a constraint is off by more than the precision
    for _ in range(STEPS):
        if size <= small:
            break
        before, size = size, newton_step(c, s, size)
        if not size < before:
            break
        if size <= SMOOTH * before:
            size = repeat_step(c, s, size, small)
    if not size <= small:
        for i in range(c.solve.rows):
            c.rows[i].change = c.rows[i].accepted
        return False
    for i in range(c.solve.rows):
        if c.rows[i].mass > 0.0:
            c.rows[i].change -= c.rows[i].residual / c.rows[i].mass
    for i in range(c.solve.blocks):
        k = c.blocks[i].row
        momentum = (c.rows[k].residual, c.rows[k + 1].residual, c.rows[k + 2].residual)
        rotation = rotate(rot_of(c.blocks[i].inverse_inertia), momentum)
        for m in range(3):
            c.rows[k + m].change -= rotation[m]
    for i in range(c.solve.constraints):
        set_vec(c.constraints[i].reference, vec_of(c.constraints[i].impulse))
    for i in range(c.solve.rows):
        c.rows[i].accepted = c.rows[i].change
    return True


@noinline
def natural_residual(c: Coupled) -> float:
    """The largest |λ - P(λ - m g)| / m of a constraint [m/s]: zero for a solution."""
    most = 0.0
    for i in range(c.solve.constraints):
        r = c.constraints[i]
        d = sub(impulse_by(r, velocity_of(c, r), 1.0), vec_of(r.reference))
        most = max(most, abs(d[0]) / r.mass_n)
        if r.friction > 0.0:
            most = max(most, math.sqrt(d[1] * d[1] + d[2] * d[2]) / r.mass_t)
    return most
