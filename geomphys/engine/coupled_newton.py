"""Newton's method for the coupled contact solve, by proximal steps.

Of a contact with the velocity g off its target and the effective mass m, the impulse λ is to be  P(λ - m g),  with P the
projection onto p >= 0 and then onto the disc μ p of friction. A proximal step solves  λ = P(λ0 - s m g)  with s > 1 instead,
from the impulses λ0 of the last one (Rockafellar 1976): contacts yield in proportion to the change of their impulses, so that
there is a solution where they are more than the bodies have degrees of freedom, and redundant ones share a load as they did
before. It is an equation in the velocities alone, smooth but for kinks, which Newton's method solves in a few steps (Alart and
Curnier 1991). Where pressed contacts have fewer velocities than the bodies, its linear system is one of theirs (Woodbury 1950).
"""

from __future__ import annotations

import math

from geomphys.engine.coupled_state import Constraint, Coupled, Floats
from geomphys.jit.kernel import kernel, noinline
from geomphys.numerics.row_vectors import rot_of, set_rot, set_vec, set_vec_from, vec_from, vec_of
from geomphys.numerics.vec3 import Vec, add_scaled, dot, rotate, rotate_back, sub

STEPS = 8  # Newton steps of a proximal step
FEW = 0.75  # of the rows: constraints with fewer velocities are solved for these, in a full matrix, the others by rows
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
def divide_by_masses(c: Coupled, x: Floats) -> None:
    """Turn momenta of the rows into their velocities, M⁻¹ x, in place."""
    for i in range(c.solve.rows):
        if c.rows[i].mass > 0.0:
            x[i] /= c.rows[i].mass
    for i in range(c.solve.blocks):
        k = c.blocks[i].row
        set_vec_from(x, k, rotate(rot_of(c.blocks[i].inverse_inertia), vec_from(x, k)))


@kernel
def velocity_by(c: Coupled, r: Constraint, x: Floats) -> Vec:
    """J x: velocity of a constraint by the velocities x of the rows."""
    v = (0.0, 0.0, 0.0)
    for k in range(r.first_term, r.end_term):
        v = add_scaled(v, vec_of(c.terms[k].jacobian), x[c.terms[k].row])
    return v


@noinline
def add_to_delassus(c: Coupled, number: int) -> None:
    """Give a constraint an index in the Delassus matrix W = J M⁻¹ Jᵀ, and set its rows and columns."""
    r, index = c.constraints[number], c.solve.indexed
    r.index = index
    c.indexed[index] = number
    c.solve.indexed += 1
    for axis in range(3):
        x = c.responses[axis]
        for i in range(c.solve.rows):
            x[i] = 0.0
        for k in range(r.first_term, r.end_term):
            x[c.terms[k].row] = c.terms[k].jacobian[axis]
        divide_by_masses(c, x)
        for m in range(index + 1):
            v = velocity_by(c, c.constraints[c.indexed[m]], x)
            set_vec_from(c.delassus[3 * index + axis], 3 * m, v)
            for i in range(3):
                c.delassus[3 * m + i, 3 * index + axis] = v[i]


@kernel
def set_yielding(r: Constraint, s: float) -> None:
    """Set B of a pressed constraint, the derivative of minus its impulses by its velocity."""
    n, t = s * r.mass_n, s * r.mass_t
    if r.sliding == 0:
        set_rot(r.yielding, (n, 0.0, 0.0, 0.0, t, 0.0, 0.0, 0.0, t))
        return
    x, y = r.direction[0], r.direction[1]  # along it friction is μ p; across it, it turns with the direction
    t *= r.part
    n_t, n_b, tt, tb, bb = n * r.friction * x, n * r.friction * y, t * y * y, -t * x * y, t * x * x
    set_rot(r.yielding, (n, 0.0, 0.0, n_t, tt, tb, n_b, tb, bb))


@noinline
def find_pressed(c: Coupled, s: float) -> None:
    """List the pressed constraints, with B of each, and decide whether to solve for their velocities, where those are few."""
    c.solve.pressed = 0
    for i in range(c.solve.constraints):
        if c.constraints[i].impulse[0] > 0.0:
            c.pressed[c.solve.pressed] = i
            c.solve.pressed += 1
            set_yielding(c.constraints[i], s)
    c.solve.reduced = 1 if 3 * c.solve.pressed < FEW * c.solve.rows else 0
    for m in range(c.solve.pressed):
        if c.solve.reduced == 1 and c.constraints[c.pressed[m]].index < 0:
            if c.solve.indexed == len(c.indexed):
                c.solve.reduced = 0
            else:
                add_to_delassus(c, c.pressed[m])


@noinline
def set_reduced_matrix(c: Coupled) -> None:
    """Set the matrix to I + W B of the pressed constraints."""
    for m in range(c.solve.pressed):
        r = c.constraints[c.pressed[m]]
        by, first = rot_of(r.yielding), 3 * r.index
        for n in range(c.solve.pressed):
            of = 3 * c.constraints[c.pressed[n]].index
            for axis in range(3):
                entries = rotate_back(by, vec_from(c.delassus[of + axis], first))
                for i in range(3):
                    c.matrix[3 * m + i, 3 * n + axis] = entries[i]
        for i in range(3):
            c.matrix[3 * m + i, 3 * m + i] += 1.0


@kernel
def add_sticking(c: Coupled, r: Constraint, sign: float) -> None:
    """Add a constraint to the sum of Jᵀ m J of those that stick, times `sign`."""
    for k in range(r.first_term, r.end_term):
        j, row = vec_of(c.terms[k].jacobian), c.terms[k].row
        response = (sign * r.mass_n * j[0], sign * r.mass_t * j[1], sign * r.mass_t * j[2])
        c.sticking[row, row] += dot(j, response)
        for m in range(r.first_term, k):
            entry, other = dot(vec_of(c.terms[m].jacobian), response), c.terms[m].row
            c.sticking[row, other] += entry
            c.sticking[other, row] += entry


@kernel
def add_sliding(c: Coupled, r: Constraint) -> None:
    """Add Jᵀ B J of a constraint to the matrix."""
    for k in range(r.first_term, r.end_term):
        column, response = c.matrix[c.terms[k].row], rotate(rot_of(r.yielding), vec_of(c.terms[k].jacobian))
        for m in range(r.first_term, r.end_term):
            column[c.terms[m].row] += dot(vec_of(c.terms[m].jacobian), response)


@noinline
def set_matrix(c: Coupled, s: float) -> None:
    """Set the matrix to M + Jᵀ B J. What sticks adds s Jᵀ m J, of which the sum is kept."""
    for i in range(c.solve.constraints):
        r = c.constraints[i]
        sticks = 1 if r.impulse[0] > 0.0 and r.sliding == 0 else 0
        if sticks != r.summed:
            add_sticking(c, r, 1.0 if sticks == 1 else -1.0)
            r.summed = sticks
    for i in range(c.solve.rows):
        column, of_sticking = c.matrix[i], c.sticking[i]
        for j in range(c.solve.rows):
            column[j] = s * of_sticking[j]
        column[i] += c.rows[i].mass
    for i in range(c.solve.blocks):
        k = c.blocks[i].row
        for m in range(3):
            for n in range(3):
                c.matrix[k + n, k + m] += c.blocks[i].inertia[3 * m + n]
    for m in range(c.solve.pressed):
        if c.constraints[c.pressed[m]].sliding == 1:
            add_sliding(c, c.constraints[c.pressed[m]])


@noinline
def factorize_matrix(c: Coupled, size: int) -> bool:
    """LU factors of the matrix, without pivoting, in its place. False: it is singular."""
    a = c.matrix
    for k in range(size):
        if not abs(a[k, k]) > 0.0:
            return False
        inverse, below = 1.0 / a[k, k], size - k - 1
        column, factors = a[k, k + 1 : size], c.factors[:below]  # indexed from 0, LLVM makes vectors of them
        for i in range(below):
            column[i] *= inverse
            factors[i] = column[i]
        for j in range(k + 1, size):
            pivot = a[j, k]
            if pivot != 0.0:
                other = a[j, k + 1 : size]
                for i in range(below):
                    other[i] -= pivot * factors[i]
    return True


@noinline
def substitute(c: Coupled, x: Floats, size: int) -> None:
    """Solve for x, which holds the right side, by the LU factors of the matrix."""
    a = c.matrix
    for k in range(size):
        y, below, column = x[k], x[k + 1 : size], a[k, k + 1 : size]
        for i in range(size - k - 1):
            below[i] -= column[i] * y
    for k in range(size - 1, -1, -1):
        x[k] /= a[k, k]
        y, above, column = x[k], x[:k], a[k, :k]
        for i in range(k):
            above[i] -= y * column[i]


@noinline
def find_step(c: Coupled) -> None:
    """Set `step` to the Newton step of the present residual r by the LU factors: x = -(M + Jᵀ B J)⁻¹ r.

    Reduced to the velocities u = J x of the pressed constraints:  (I + W B) u = -J M⁻¹ r,  x = -M⁻¹ (r + Jᵀ B u).
    """
    x, u = c.step, c.relative
    for i in range(c.solve.rows):
        x[i] = -c.rows[i].residual
    if c.solve.reduced == 0:
        substitute(c, x, c.solve.rows)
        return
    divide_by_masses(c, x)
    for m in range(c.solve.pressed):
        set_vec_from(u, 3 * m, velocity_by(c, c.constraints[c.pressed[m]], x))
    substitute(c, u, 3 * c.solve.pressed)
    for i in range(c.solve.rows):
        x[i] = -c.rows[i].residual
    for m in range(c.solve.pressed):
        r = c.constraints[c.pressed[m]]
        change = rotate(rot_of(r.yielding), vec_from(u, 3 * m))
        for k in range(r.first_term, r.end_term):
            x[c.terms[k].row] -= dot(vec_of(c.terms[k].jacobian), change)
    divide_by_masses(c, x)


@kernel
def add_step(c: Coupled, part: float) -> None:
    """Add `part` of the Newton step to the velocities."""
    for i in range(c.solve.rows):
        c.rows[i].change += part * c.step[i]


@noinline
def newton_step(c: Coupled, s: float, size: float) -> float:
    """One Newton step of a proximal step, shortened until the residual is less than `size`; returns its size then."""
    find_pressed(c, s)
    if c.solve.reduced == 1:
        set_reduced_matrix(c)
    else:
        set_matrix(c, s)
    if not factorize_matrix(c, 3 * c.solve.pressed if c.solve.reduced == 1 else c.solve.rows):
        return size
    find_step(c)
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
        find_step(c)
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
        c.step[i] = -c.rows[i].residual
    divide_by_masses(c, c.step)
    add_step(c, 1.0)
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
