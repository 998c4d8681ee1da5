"""The coupled contact solve of driven and simulated bodies: projected Gauss-Seidel on velocities and offset rates.

Every row has a normal impulse p >= 0, which keeps the normal velocity at or above its target, and a friction impulse
within the disc μ p, which takes the sliding velocity to its target or else opposes it (Moreau 1988, Jean 1999). Rows are
swept forwards and backwards, with the extrapolation of accelerated gradient methods in between (Nesterov 1983), until no
impulse changes a velocity by more than a precision, or a bound is reached.
"""

from __future__ import annotations

import math

from geomphys.engine.coupled_state import Coupled, Limit
from geomphys.jit.kernel import kernel, outlined
from geomphys.numerics.row_vectors import set_vec, vec_of
from geomphys.numerics.vec3 import Vec, dot, sub
from geomphys.simulated.contact_points import apply_impulses, invert_mass, speed_at
from geomphys.simulated.impulses import stopping_impulse
from geomphys.simulated.settling import add_reversal, begin_row, extrapolated_impulse, local_impulse
from geomphys.simulated.state import Row, Simulation

SWEEPS = 20  # sweeps of a step, which warm-starts the next one
MOST_SWEEPS = 500  # sweeps of a step or an impact that has not converged before
EXTRAPOLATED = 150  # first sweeps, with extrapolation between them; with friction it need not converge
FULL = 16  # sweeps: the first two of so many visit all rows, the others those that had an impulse
RELAXATION = 0.5  # factor of the later sweeps, which are under-relaxed instead
SETTLED = 2e-5  # m/s: less than 0.1 um a step
CREEPS = 1e-4  # m/s: a solve that ends with larger changes has not converged
PRECISION = 1e-6  # m/s: of a step; the rest is corrected as slip or overlap
IMPACT_PRECISION = 1e-10  # m/s


@kernel
def relative_velocity(sim: Simulation, c: Coupled, r: Row) -> Vec:
    """Relative velocity at a row along its normal, tangent and binormal [m/s]."""
    v = speed_at(sim.velocity, r, r.a, r.b)
    n = dot(vec_of(r.normal), v) + r.prescribed[0]
    t = dot(vec_of(r.tangent), v) + r.prescribed[1]
    b = dot(vec_of(r.binormal), v) + r.prescribed[2]
    for e in range(r.first_effect, r.end_effect):
        effect = c.effects[e]
        u = c.unknowns[effect.unknown].solved
        n, t, b = n + effect.speed[0] * u, t + effect.speed[1] * u, b + effect.speed[2] * u
    return n, t, b


@kernel
def apply(sim: Simulation, c: Coupled, r: Row, j: Vec) -> None:
    """Apply impulses j [N s] along normal, tangent and binormal of a row to bodies and unknowns."""
    apply_impulses(sim, r, j)
    for e in range(r.first_effect, r.end_effect):
        effect = c.effects[e]
        c.unknowns[effect.unknown].solved += dot(vec_of(effect.response), j)


@kernel
def add_responses(sim: Simulation, c: Coupled, r: Row) -> None:
    """Add the responses of unknowns to those of a row, which are of its simulated bodies."""
    nn, nt, nb, tt, tb, bb = 0.0, 0.0, 0.0, 0.0, 0.0, 0.0
    for e in range(r.first_effect, r.end_effect):
        effect = c.effects[e]
        light = c.unknowns[effect.unknown].inverse_mass
        n, t, b = vec_of(effect.speed)
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
def set_limit_response(c: Coupled, k: int) -> None:
    """Set the response of limit k to a unit impulse."""
    g, total = c.limits[k], 0.0
    for e in range(g.first_effect, g.end_effect):
        effect = c.effects[e]
        total += effect.speed[0] ** 2 * c.unknowns[effect.unknown].inverse_mass
    g.response = total


@kernel
def add_impulse(c: Coupled, k: int, change: float) -> None:
    """Add to the impulse of limit k."""
    g = c.limits[k]
    if change == 0.0:
        return
    g.impulse += change
    for e in range(g.first_effect, g.end_effect):
        effect = c.effects[e]
        x = c.unknowns[effect.unknown]
        x.solved += effect.speed[0] * x.inverse_mass * change


@kernel
def visit_limit(c: Coupled, k: int) -> float:
    """One visit to limit k; returns how much it changed the rate of its clearance."""
    g = c.limits[k]
    if g.response <= 0.0:
        return 0.0
    v = g.prescribed
    for e in range(g.first_effect, g.end_effect):
        effect = c.effects[e]
        v += effect.speed[0] * c.unknowns[effect.unknown].solved
    change = max(0.0, g.impulse + (g.target_speed - v) / g.response) - g.impulse
    add_impulse(c, k, change)
    return float(abs(change) * g.response)


@kernel
def visit(sim: Simulation, c: Coupled, r: Row, relaxation: float) -> float:
    """One visit to a row: its normal impulse, then its friction; returns how much they changed its velocity [m/s]."""
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
    """Restart extrapolation from the impulses of rows and limits; none counts as idle."""
    for k in range(sim.counts.rows):
        begin_row(sim.rows[k])
        sim.rows[k].idle = 0
    for k in range(c.solve.limits):
        g = c.limits[k]
        g.swept = g.extrapolated = g.impulse
        g.idle = 0


@kernel
def is_reversed(sim: Simulation, c: Coupled) -> bool:
    """Whether the last two sweeps reversed the extrapolation: its gradient restart (O'Donoghue and Candès 2015)."""
    along = 0.0
    for k in range(sim.counts.rows):
        r = sim.rows[k]
        if r.mode == 1 and r.idle == 0:
            along = add_reversal(along, r)
    for k in range(c.solve.limits):
        g = c.limits[k]
        along += (g.extrapolated - g.impulse) * (g.impulse - g.swept) * g.response
    return along > 0.0


@kernel
def extrapolate(sim: Simulation, c: Coupled, momentum: float) -> None:
    """Extrapolate impulses that are not idle by `momentum` times their change in the last two sweeps.

    They are projected onto what they may be.
    """
    for k in range(sim.counts.rows):
        r = sim.rows[k]
        if r.mode != 1 or r.idle == 1:
            continue
        j = local_impulse(r)
        n, t, b = extrapolated_impulse(r, momentum)
        if (n, t, b) != j:
            r.normal_impulse, r.tangent_impulse[0], r.tangent_impulse[1] = n, t, b
            apply(sim, c, r, sub((n, t, b), j))
    for k in range(c.solve.limits):
        g = c.limits[k]
        if g.idle == 1:
            continue
        impulse = g.impulse
        g.extrapolated = max(0.0, impulse + momentum * (impulse - g.swept))
        g.swept = impulse
        add_impulse(c, k, g.extrapolated - impulse)


@kernel
def note_idle_row(r: Row) -> None:
    """Store whether a row that was just visited has no impulse; the extrapolation of one that is idle no more begins anew."""
    idle = 1 if local_impulse(r) == (0.0, 0.0, 0.0) else 0
    if idle == 0 and r.idle == 1:
        begin_row(r)
    r.idle = idle


@kernel
def note_idle_limit(g: Limit) -> None:
    """`note_idle_row` of a limit."""
    idle = 1 if g.impulse == 0.0 else 0
    if idle == 0 and g.idle == 1:
        g.swept = g.extrapolated = g.impulse
    g.idle = idle


@kernel
def sweep_contacts(sim: Simulation, c: Coupled, backwards: bool, full: bool, relaxation: float) -> float:
    """One sweep over the rows whose `mode` is 1 and the limits, over idle ones only if it is `full`.

    Returns the largest change of a velocity [m/s].
    """
    rows, most = sim.counts.rows, 0.0
    total = rows + c.solve.limits
    for i in range(total):
        k = total - 1 - i if backwards else i
        if k >= rows:
            if full or c.limits[k - rows].idle == 0:
                most = max(most, visit_limit(c, k - rows))
                note_idle_limit(c.limits[k - rows])
        elif sim.rows[k].mode == 1 and (full or sim.rows[k].idle == 0):
            most = max(most, visit(sim, c, sim.rows[k], relaxation))
            note_idle_row(sim.rows[k])
    return most


@outlined
def solve_contacts(sim: Simulation, c: Coupled, sweeps: int, precision: float) -> int:
    """Solve the rows whose `mode` is 1 and all limits together, from their impulses, which must be part of the velocities.

    After every two sweeps, forwards and backwards, the impulses are extrapolated (Nesterov 1983), with a restart where the
    sweeps reverse it; later sweeps are under-relaxed. Most sweeps leave out what is idle. Done when in a sweep over all no
    impulse changes a velocity by more than `precision` [m/s], or after so many `sweeps` when none does by more than `SETTLED`,
    or after `MOST_SWEEPS`: counted as not converged if the last changed one by more than `CREEPS`. Returns the sweeps made.
    """
    momentum, most, settled = 1.0, 0.0, False
    begin_extrapolation(sim, c)
    for sweep in range(MOST_SWEEPS):
        backwards = sweep & 1 == 1
        full = settled or sweep % FULL < 2 or sweep + 1 == MOST_SWEEPS
        most = sweep_contacts(sim, c, backwards, full, 1.0 if sweep < EXTRAPOLATED else RELAXATION)
        settled = most <= precision or (sweep + 1 >= sweeps and most <= SETTLED)
        if settled and full:
            return sweep + 1
        if backwards and sweep < EXTRAPOLATED:
            before, momentum = momentum, 0.5 * (1.0 + math.sqrt(1.0 + 4.0 * momentum * momentum))
            if is_reversed(sim, c):
                before = momentum = 1.0
            extrapolate(sim, c, (before - 1.0) / momentum)
    if most > CREEPS:
        c.solve.unsettled += 1
    return MOST_SWEEPS


@kernel
def impulse_vector(r: Row) -> Vec:
    """World friction impulse of a row [N s]."""
    t, b, x, y = vec_of(r.tangent), vec_of(r.binormal), r.tangent_impulse[0], r.tangent_impulse[1]
    return (x * t[0] + y * b[0], x * t[1] + y * b[1], x * t[2] + y * b[2])
