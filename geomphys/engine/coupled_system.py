"""The coupled solve as compact tables: the velocities that contacts change, their masses, and the Jacobian of the contacts.

Rows of joints come first, each before those between it and the root, then those of roots, then of bodies: what moves with
different joints is coupled by what follows alone, so that elimination in this order fills in little.
"""

from __future__ import annotations

from geomphys.engine.coupled_impulses import add_impulse, apply, inequality_rate, relative_velocity
from geomphys.engine.coupled_state import Coupled
from geomphys.jit.kernel import kernel, noinline
from geomphys.numerics.row_vectors import rot_of, set_rot, set_vec, vec_of
from geomphys.numerics.vec3 import Rot, Vec, cross, sub
from geomphys.simulated.contact_solver import local_impulse
from geomphys.simulated.state import ACTIVE, Contact, Simulation, is_simulated

NEARLY = 0.02  # m/s: contacts that are this far from being pressed are included
REQUESTED = -2  # row of an unknown that is to have one
TERMS_OF_BODIES = 12  # most entries of the Jacobian of a contact that are of bodies


@kernel
def clear_rows(sim: Simulation, c: Coupled) -> None:
    """Give no unknown and no body a row."""
    for e in range(c.solve.effects):
        c.unknowns[c.effects[e].unknown].row = -1
    for k in range(sim.counts.contacts):
        c.body_rows[sim.contacts[k].a] = c.body_rows[sim.contacts[k].b] = -1
    c.solve.rows = c.solve.blocks = c.solve.terms = c.solve.constraints = c.solve.indexed = 0


@kernel
def request_rows(c: Coupled, first: int, end: int) -> None:
    """Request a row for each unknown of the effects `first` to `end`."""
    for e in range(first, end):
        x = c.unknowns[c.effects[e].unknown]
        if x.inverse_mass > 0.0:
            x.row = REQUESTED


@kernel
def add_rows_of_unknowns(c: Coupled) -> None:
    """Give the unknowns for which they are requested their rows, from the tips of the trees to their roots."""
    for i in range(len(c.unknowns)):
        x = c.unknowns[len(c.unknowns) - 1 - i]
        if x.row == REQUESTED and c.solve.rows < len(c.rows):
            x.row = c.solve.rows
            c.rows[x.row].change = c.rows[x.row].accepted = 0.0
            c.rows[x.row].mass = 1.0 / x.inverse_mass
            c.solve.rows += 1


@kernel
def inverse_of_symmetric(s: Rot) -> Rot:
    """Inverse of a symmetric 3 x 3 matrix."""
    a, b, d = s[4] * s[8] - s[5] * s[5], s[2] * s[5] - s[1] * s[8], s[1] * s[5] - s[2] * s[4]
    e, f, g = s[0] * s[8] - s[2] * s[2], s[1] * s[2] - s[0] * s[5], s[0] * s[4] - s[1] * s[1]
    q = 1.0 / (s[0] * a + s[1] * b + s[2] * d)
    return (a * q, b * q, d * q, b * q, e * q, f * q, d * q, f * q, g * q)


@kernel
def add_rows_of_body(sim: Simulation, c: Coupled, body: int) -> None:
    """Give a simulated body six rows."""
    if c.body_rows[body] >= 0 or not is_simulated(sim, body) or c.solve.rows + 6 > len(c.rows):
        return
    first, k = c.solve.rows, sim.motion[body]
    c.body_rows[body] = first
    for i in range(6):
        c.rows[first + i].change = c.rows[first + i].accepted = 0.0
        c.rows[first + i].mass = 1.0 / k.inverse_mass if i < 3 else 0.0
    block = c.blocks[c.solve.blocks]
    block.row = first + 3
    set_rot(block.inverse_inertia, rot_of(k.inverse_inertia))
    set_rot(block.inertia, inverse_of_symmetric(rot_of(k.inverse_inertia)))
    c.solve.rows += 6
    c.solve.blocks += 1


@kernel
def add_rows(sim: Simulation, c: Coupled) -> bool:
    """Give everything that the included contacts and inequalities may change its rows; whether some are left."""
    clear_rows(sim, c)
    for k in range(sim.counts.contacts):
        if sim.contacts[k].included == 1:
            request_rows(c, sim.contacts[k].first_effect, sim.contacts[k].end_effect)
    for k in range(c.solve.inequalities):
        if c.inequalities[k].included == 1:
            request_rows(c, c.inequalities[k].first_effect, c.inequalities[k].end_effect)
    add_rows_of_unknowns(c)
    for k in range(sim.counts.contacts):
        if sim.contacts[k].included == 1:
            add_rows_of_body(sim, c, sim.contacts[k].a)
            add_rows_of_body(sim, c, sim.contacts[k].b)
    for i in range(c.solve.rows):
        for j in range(c.solve.rows):
            c.sticking[i, j] = 0.0
    return bool(c.solve.rows + 6 <= len(c.rows))


@kernel
def add_term(c: Coupled, row: int, jacobian: Vec) -> None:
    """Append an entry of the Jacobian."""
    term = c.terms[c.solve.terms]
    c.solve.terms += 1
    term.row = row
    set_vec(term.jacobian, jacobian)


@kernel
def add_terms_of_unknowns(c: Coupled, first: int, end: int) -> None:
    """Append the effects `first` to `end` as entries of the Jacobian."""
    for e in range(first, end):
        row = c.unknowns[c.effects[e].unknown].row
        if row >= 0:
            add_term(c, row, vec_of(c.effects[e].jacobian))


@kernel
def add_terms_of_body(c: Coupled, r: Contact, row: int, arm: Vec, sign: float) -> None:
    """Append the Jacobian of the body with rows from `row` on: `sign` times the velocity of its point at `arm` along the axes."""
    if row < 0:
        return
    n, t, b = vec_of(r.normal), vec_of(r.tangent), vec_of(r.binormal)
    xn, xt, xb = cross(arm, n), cross(arm, t), cross(arm, b)
    add_term(c, row, (sign * n[0], sign * t[0], sign * b[0]))
    add_term(c, row + 1, (sign * n[1], sign * t[1], sign * b[1]))
    add_term(c, row + 2, (sign * n[2], sign * t[2], sign * b[2]))
    add_term(c, row + 3, (sign * xn[0], sign * xt[0], sign * xb[0]))
    add_term(c, row + 4, (sign * xn[1], sign * xt[1], sign * xb[1]))
    add_term(c, row + 5, (sign * xn[2], sign * xt[2], sign * xb[2]))


@kernel
def add_constraint(c: Coupled, number: int, effects: int) -> bool:
    """Append a constraint with so many effects; False: its table is full."""
    solve = c.solve
    if solve.constraints == len(c.constraints) or solve.terms + effects + TERMS_OF_BODIES > len(c.terms):
        return False
    r = c.constraints[solve.constraints]
    solve.constraints += 1
    r.number, r.index, r.summed = number, -1, 0
    r.first_term = solve.terms
    return True


@kernel
def add_contact(sim: Simulation, c: Coupled, k: int) -> bool:
    """Append contact k; False: its table is full."""
    r = sim.contacts[k]
    if not add_constraint(c, k, r.end_effect - r.first_effect):
        return False
    into = c.constraints[c.solve.constraints - 1]
    add_terms_of_unknowns(c, r.first_effect, r.end_effect)
    add_terms_of_body(c, r, c.body_rows[r.a], vec_of(r.arm_a), 1.0)
    add_terms_of_body(c, r, c.body_rows[r.b], vec_of(r.arm_b), -1.0)
    into.end_term = c.solve.terms
    into.mass_n, into.mass_t, into.friction = 1.0 / r.inverse_mass_n, 1.0 / r.inverse_mass_most, r.friction
    set_vec(into.start, local_impulse(r))
    set_vec(into.reference, local_impulse(r))
    n, t, b = relative_velocity(sim, c, r)
    set_vec(into.off_target, (n - r.target_speed, t - r.tangent_target[0], b - r.tangent_target[1]))
    return True


@kernel
def add_inequality_as_contact(sim: Simulation, c: Coupled, k: int) -> bool:
    """Append inequality k, a contact without friction; False: its table is full."""
    g = c.inequalities[k]
    if not add_constraint(c, sim.counts.contacts + k, g.end_effect - g.first_effect):
        return False
    into = c.constraints[c.solve.constraints - 1]
    add_terms_of_unknowns(c, g.first_effect, g.end_effect)
    into.end_term = c.solve.terms
    into.mass_n, into.mass_t, into.friction = 1.0 / g.response, 0.0, 0.0
    set_vec(into.start, (g.impulse, 0.0, 0.0))
    set_vec(into.reference, (g.impulse, 0.0, 0.0))
    set_vec(into.off_target, (inequality_rate(c, k) - g.target_speed, 0.0, 0.0))
    return True


@noinline
def include_nearly_pressed(sim: Simulation, c: Coupled) -> None:
    """Include the contacts and inequalities that have an impulse, or would with little more velocity, in the solve."""
    for k in range(sim.counts.contacts):
        r = sim.contacts[k]
        r.included = 0
        if r.mode == ACTIVE and (
            local_impulse(r) != (0.0, 0.0, 0.0) or relative_velocity(sim, c, r)[0] < r.target_speed + NEARLY
        ):
            r.included = 1
    for k in range(c.solve.inequalities):
        g = c.inequalities[k]
        g.included = 0
        if g.response > 0.0 and (g.impulse != 0.0 or inequality_rate(c, k) < g.target_speed + NEARLY):
            g.included = 1


@noinline
def include_violated(sim: Simulation, c: Coupled, precision: float) -> bool:
    """Include the others that the solution violates by more than `precision` [m/s]; whether there are any."""
    some = False
    for k in range(sim.counts.contacts):
        r = sim.contacts[k]
        if r.mode == ACTIVE and r.included == 0 and relative_velocity(sim, c, r)[0] < r.target_speed - precision:
            r.included, some = 1, True
    for k in range(c.solve.inequalities):
        g = c.inequalities[k]
        if g.response > 0.0 and g.included == 0 and inequality_rate(c, k) < g.target_speed - precision:
            g.included, some = 1, True
    return some


@noinline
def make_system(sim: Simulation, c: Coupled) -> bool:
    """The tables of the included contacts and inequalities; False: they are too many."""
    if not add_rows(sim, c):
        return False
    for k in range(sim.counts.contacts):
        if sim.contacts[k].included == 1 and not add_contact(sim, c, k):
            return False
    for k in range(c.solve.inequalities):
        if c.inequalities[k].included == 1 and not add_inequality_as_contact(sim, c, k):
            return False
    return True


@noinline
def apply_solution(sim: Simulation, c: Coupled) -> None:
    """Give contacts, inequalities and velocities the impulses that were solved for."""
    contacts = sim.counts.contacts
    for i in range(c.solve.constraints):
        k, to = c.constraints[i].number, vec_of(c.constraints[i].reference)
        if k < contacts:
            r = sim.contacts[k]
            j = local_impulse(r)
            if to != j:
                r.normal_impulse, r.tangent_impulse[0], r.tangent_impulse[1] = to
                apply(sim, c, r, sub(to, j))
        else:
            add_impulse(c, k - contacts, to[0] - c.inequalities[k - contacts].impulse)
