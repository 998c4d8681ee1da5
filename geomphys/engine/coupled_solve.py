"""The coupled contact solve of driven and simulated bodies: projected Gauss-Seidel on velocities and offset rates.

Every contact has a normal impulse p >= 0, which keeps the normal velocity at or above its target, and a friction impulse
within the disc μ p, which takes the sliding velocity to its target or else opposes it (Moreau 1988, Jean 1999). Contacts are
swept forwards and backwards, with the extrapolation of accelerated gradient methods in between (Nesterov 1983), until no
impulse changes a velocity by more than a precision, or a bound is reached.
"""

from __future__ import annotations

import math

from geomphys.engine.coupled_state import Coupled, Inequality
from geomphys.jit.kernel import kernel, noinline
from geomphys.numerics.row_vectors import set_vec, vec_of
from geomphys.numerics.vec3 import Vec, dot, sub
from geomphys.simulated.contact_points import apply_impulses, invert_mass, speed_at
from geomphys.simulated.contact_solver import add_reversal, begin_contact, extrapolated_impulse, local_impulse
from geomphys.simulated.impulses import stopping_impulse
from geomphys.simulated.state import ACTIVE, Contact, Simulation

SWEEPS = 20  # sweeps of a step, which warm-starts the next one
MAX_SWEEPS = 500  # sweeps of a step or an impact that has not converged before
EXTRAPOLATED = 150  # first sweeps, with extrapolation between them; with friction it need not converge
FULL = 6  # sweeps: the first two of so many visit all contacts, the others those that had an impulse
RELAXATION = 0.5  # factor of the later sweeps, which are under-relaxed instead
CONVERGED_SPEED = 2e-5  # m/s: less than 0.1 um a step
CREEPS = 1e-4  # m/s: a solve that ends with larger changes has not converged
PRECISION = 1e-6  # m/s: of a step; the rest is corrected as slip or overlap
IMPACT_PRECISION = 1e-10  # m/s


@kernel
def relative_velocity(sim: Simulation, c: Coupled, r: Contact) -> Vec:
    """Relative velocity at a contact along its normal, tangent and binormal [m/s]."""
    v = speed_at(sim.velocity, r, r.a, r.b)
    n = dot(vec_of(r.normal), v) + r.prescribed[0]
    t = dot(vec_of(r.tangent), v) + r.prescribed[1]
    b = dot(vec_of(r.binormal), v) + r.prescribed[2]
    for e in range(r.first_effect, r.end_effect):
        effect = c.effects[e]
        u = c.unknowns[effect.unknown].new_rate
        n, t, b = n + effect.jacobian[0] * u, t + effect.jacobian[1] * u, b + effect.jacobian[2] * u
    return n, t, b


@kernel
def apply(sim: Simulation, c: Coupled, r: Contact, j: Vec) -> None:
    """Apply impulses j [N s] along normal, tangent and binormal of a contact to bodies and unknowns."""
    apply_impulses(sim, r, j)
    for e in range(r.first_effect, r.end_effect):
        effect = c.effects[e]
        c.unknowns[effect.unknown].new_rate += dot(vec_of(effect.response), j)


@kernel
def add_responses(sim: Simulation, c: Coupled, r: Contact) -> None:
    """Add the responses of unknowns to those of a contact, which are of its simulated bodies."""
    nn, nt, nb, tt, tb, bb = 0.0, 0.0, 0.0, 0.0, 0.0, 0.0
    for e in range(r.first_effect, r.end_effect):
        effect = c.effects[e]
        light = c.unknowns[effect.unknown].inverse_mass
        n, t, b = vec_of(effect.jacobian)
        set_vec(effect.response, (n * light, t * light, b * light))
        nn, tt, tb, bb = nn + n * n * light, tt + t * t * light, tb + t * b * light, bb + b * b * light
        nt, nb = nt + n * t * light, nb + n * b * light
    r.inverse_mass_n += nn
    r.inverse_mass_t[0] += tt
    r.inverse_mass_t[1] += tb
    r.inverse_mass_t[2] += bb
    r.inverse_mass_nt[0] += nt
    r.inverse_mass_nt[1] += nb
    invert_mass(r)


@kernel
def set_inequality_response(c: Coupled, k: int) -> None:
    """Set the response of inequality k to a unit impulse."""
    g, total = c.inequalities[k], 0.0
    for e in range(g.first_effect, g.end_effect):
        effect = c.effects[e]
        total += effect.jacobian[0] ** 2 * c.unknowns[effect.unknown].inverse_mass
    g.response = total


@kernel
def add_impulse(c: Coupled, k: int, change: float) -> None:
    """Add to the impulse of inequality k."""
    g = c.inequalities[k]
    if change == 0.0:
        return
    g.impulse += change
    for e in range(g.first_effect, g.end_effect):
        effect = c.effects[e]
        x = c.unknowns[effect.unknown]
        x.new_rate += effect.jacobian[0] * x.inverse_mass * change


@kernel
def update_inequality(c: Coupled, k: int) -> float:
    """One visit to inequality k; returns how much it changed the rate of its clearance."""
    g = c.inequalities[k]
    if g.response <= 0.0:
        return 0.0
    v = g.prescribed
    for e in range(g.first_effect, g.end_effect):
        effect = c.effects[e]
        v += effect.jacobian[0] * c.unknowns[effect.unknown].new_rate
    change = max(0.0, g.impulse + (g.target_speed - v) / g.response) - g.impulse
    add_impulse(c, k, change)
    return float(abs(change) * g.response)


@kernel
def update_contact(sim: Simulation, c: Coupled, r: Contact, relaxation: float) -> float:
    """One visit to a contact: its normal impulse, then its friction; returns how much they changed its velocity [m/s]."""
    n, t, b = relative_velocity(sim, c, r)
    before = r.normal_impulse
    after = min(r.impulse_limit, max(0.0, before + (r.target_speed - n) / r.inverse_mass_n))
    after = before + relaxation * (after - before)
    x0, y0, p = r.tangent_impulse[0], r.tangent_impulse[1], after - before
    cap = r.friction * after
    x, y = 0.0, 0.0
    if cap > 0.0:
        t += r.inverse_mass_nt[0] * p - r.tangent_target[0]
        b += r.inverse_mass_nt[1] * p - r.tangent_target[1]
        x, y = stopping_impulse(r, t, b, cap)
    x, y = x0 + relaxation * (x - x0), y0 + relaxation * (y - y0)
    if p == 0.0 and x == x0 and y == y0:
        return 0.0
    r.normal_impulse, r.tangent_impulse[0], r.tangent_impulse[1] = after, x, y
    apply(sim, c, r, (p, x - x0, y - y0))
    return float(max(abs(p) * r.inverse_mass_n, (abs(x - x0) + abs(y - y0)) * r.inverse_mass_most))


@kernel
def begin_extrapolation(sim: Simulation, c: Coupled) -> None:
    """Restart extrapolation from the impulses of contacts and inequalities; none counts as idle."""
    for k in range(sim.counts.contacts):
        begin_contact(sim.contacts[k])
        sim.contacts[k].idle = 0
    for k in range(c.solve.inequalities):
        g = c.inequalities[k]
        g.previous_impulse = g.extrapolated = g.impulse
        g.idle = 0


@kernel
def is_reversed(sim: Simulation, c: Coupled) -> bool:
    """Whether the last two sweeps reversed the extrapolation: its gradient restart (O'Donoghue and Candès 2015)."""
    along = 0.0
    for k in range(sim.counts.contacts):
        r = sim.contacts[k]
        if r.mode == ACTIVE and r.idle == 0:
            along = add_reversal(along, r)
    for k in range(c.solve.inequalities):
        g = c.inequalities[k]
        along += (g.extrapolated - g.impulse) * (g.impulse - g.previous_impulse) * g.response
    return along > 0.0


@kernel
def extrapolate(sim: Simulation, c: Coupled, momentum: float) -> None:
    """Extrapolate impulses that are not idle by `momentum` times their change in the last two sweeps.

    They are projected onto what they may be.
    """
    for k in range(sim.counts.contacts):
        r = sim.contacts[k]
        if r.mode != ACTIVE or r.idle == 1:
            continue
        j = local_impulse(r)
        n, t, b = extrapolated_impulse(r, momentum)
        if (n, t, b) != j:
            r.normal_impulse, r.tangent_impulse[0], r.tangent_impulse[1] = n, t, b
            apply(sim, c, r, sub((n, t, b), j))
    for k in range(c.solve.inequalities):
        g = c.inequalities[k]
        if g.idle == 1:
            continue
        impulse = g.impulse
        g.extrapolated = max(0.0, impulse + momentum * (impulse - g.previous_impulse))
        g.previous_impulse = impulse
        add_impulse(c, k, g.extrapolated - impulse)


@kernel
def note_idle_contact(r: Contact) -> None:
    """Store whether a contact that was just visited has no impulse; the extrapolation of one that is idle no more begins anew."""
    idle = 1 if local_impulse(r) == (0.0, 0.0, 0.0) else 0
    if idle == 0 and r.idle == 1:
        begin_contact(r)
    r.idle = idle


@kernel
def note_idle_inequality(g: Inequality) -> None:
    """`note_idle_contact` of an inequality."""
    idle = 1 if g.impulse == 0.0 else 0
    if idle == 0 and g.idle == 1:
        g.previous_impulse = g.extrapolated = g.impulse
    g.idle = idle


@kernel
def sweep_contacts(sim: Simulation, c: Coupled, backwards: bool, full: bool, relaxation: float) -> float:
    """One sweep over the ACTIVE contacts and the inequalities, over idle ones only if it is `full`.

    Returns the largest change of a velocity [m/s].
    """
    contacts, most = sim.counts.contacts, 0.0
    total = contacts + c.solve.inequalities
    for i in range(total):
        k = total - 1 - i if backwards else i
        if k >= contacts:
            if full or c.inequalities[k - contacts].idle == 0:
                most = max(most, update_inequality(c, k - contacts))
                note_idle_inequality(c.inequalities[k - contacts])
        elif sim.contacts[k].mode == ACTIVE and (full or sim.contacts[k].idle == 0):
            most = max(most, update_contact(sim, c, sim.contacts[k], relaxation))
            note_idle_contact(sim.contacts[k])
    return most


@noinline
def solve_contacts(sim: Simulation, c: Coupled, sweeps: int, precision: float) -> int:
    """Solve the ACTIVE contacts and all inequalities together, from their impulses, which are part of the velocities.

    After every two sweeps, forwards and backwards, the impulses are extrapolated (Nesterov 1983), with a restart where the
    sweeps reverse it; later sweeps are under-relaxed. Most sweeps leave out what is idle. Done when in a sweep over all no
    impulse changes a velocity by more than `precision` [m/s], or after so many `sweeps` when none does by more than
    `CONVERGED_SPEED`, or after `MAX_SWEEPS`: not converged if the last changed one by more than `CREEPS`. Returns the sweeps
    made.
    """
    momentum, most, has_converged = 1.0, 0.0, False
    begin_extrapolation(sim, c)
    for sweep in range(MAX_SWEEPS):
        backwards = sweep & 1 == 1
        full = has_converged or sweep % FULL < 2 or sweep + 1 == MAX_SWEEPS
        most = sweep_contacts(sim, c, backwards, full, 1.0 if sweep < EXTRAPOLATED else RELAXATION)
        has_converged = most <= precision or (sweep + 1 >= sweeps and most <= CONVERGED_SPEED)
        if has_converged and full:
            return sweep + 1
        if backwards and sweep < EXTRAPOLATED:
            before, momentum = momentum, 0.5 * (1.0 + math.sqrt(1.0 + 4.0 * momentum * momentum))
            if is_reversed(sim, c):
                before = momentum = 1.0
            extrapolate(sim, c, (before - 1.0) / momentum)
    if most > CREEPS:
        c.solve.unconverged += 1
    return MAX_SWEEPS


@kernel
def impulse_vector(r: Contact) -> Vec:
    """World friction impulse of a contact [N s]."""
    t, b, x, y = vec_of(r.tangent), vec_of(r.binormal), r.tangent_impulse[0], r.tangent_impulse[1]
    return (x * t[0] + y * b[0], x * t[1] + y * b[1], x * t[2] + y * b[2])
