"""The contact solve that driven and simulated bodies share: projected Gauss-Seidel on velocities and offset rates.

Every row has a normal impulse p >= 0, which keeps the normal velocity at or above its target, and a friction impulse
within the disc μ p, which takes the sliding to its target or else opposes it (Moreau 1988, Jean 1999). Rows are swept to
and fro until no impulse changes a velocity by more than a precision, or a bound is reached.
"""

from __future__ import annotations

import math

from geomphys.engine.coupled_state import Coupled
from geomphys.jit.kernel import kernel, outlined
from geomphys.numerics.row_vectors import vec_of
from geomphys.numerics.vec3 import Vec, dot
from geomphys.simulated.contact_points import direction_of, invert_mass, push, speed_at
from geomphys.simulated.state import Row, Simulation

SWEEPS = 200
PRECISION = 1e-8  # m/s


@kernel
def relative_speed(sim: Simulation, c: Coupled, r: Row, axis: int) -> float:
    """Relative velocity at a row along its normal (0), tangent (1) or binormal (2) [m/s]."""
    v = dot(direction_of(r, axis), speed_at(sim.velocity, r, r.a, r.b)) + r.prescribed[axis]
    for e in range(r.first_effect, r.end_effect):
        effect = c.effects[e]
        v += effect.speed[axis] * c.unknowns[effect.unknown].solved
    return float(v)


@kernel
def apply(sim: Simulation, c: Coupled, r: Row, axis: int, j: float) -> None:
    """Apply an impulse j [N s] along an axis of a row to bodies and unknowns."""
    push(sim, sim.velocity, r, r.a, r.b, axis, j)
    for e in range(r.first_effect, r.end_effect):
        effect = c.effects[e]
        x = c.unknowns[effect.unknown]
        x.solved += effect.speed[axis] * x.inverse_mass * j


@kernel
def add_responses(c: Coupled, r: Row) -> None:
    """Add what unknowns do to the responses of a row, which are those of its simulated bodies."""
    nn, tt, tb, bb = 0.0, 0.0, 0.0, 0.0
    for e in range(r.first_effect, r.end_effect):
        effect = c.effects[e]
        light = c.unknowns[effect.unknown].inverse_mass
        n, t, b = effect.speed[0], effect.speed[1], effect.speed[2]
        nn, tt, tb, bb = nn + n * n * light, tt + t * t * light, tb + t * b * light, bb + b * b * light
    r.inverse_mass_n += nn
    r.inverse_mass_t[0] += tt
    r.inverse_mass_t[1] += tb
    r.inverse_mass_t[2] += bb
    invert_mass(r)


@kernel
def bound_response(c: Coupled, k: int) -> None:
    """Note what a unit impulse does to bound k."""
    g, total = c.bounds[k], 0.0
    for e in range(g.first_effect, g.end_effect):
        effect = c.effects[e]
        total += effect.speed[0] ** 2 * c.unknowns[effect.unknown].inverse_mass
    g.response = total


@kernel
def press_bound(c: Coupled, k: int) -> float:
    """One visit to bound k; returns how much it changed the rate of its clearance."""
    g = c.bounds[k]
    if g.response <= 0.0:
        return 0.0
    v = g.prescribed
    for e in range(g.first_effect, g.end_effect):
        effect = c.effects[e]
        v += effect.speed[0] * c.unknowns[effect.unknown].solved
    total = max(0.0, g.impulse + (g.target_speed - v) / g.response)
    change = total - g.impulse
    if change == 0.0:
        return 0.0
    g.impulse = total
    for e in range(g.first_effect, g.end_effect):
        effect = c.effects[e]
        x = c.unknowns[effect.unknown]
        x.solved += effect.speed[0] * x.inverse_mass * change
    return abs(change) * float(g.response)


@kernel
def press_row(sim: Simulation, c: Coupled, r: Row) -> float:
    """One visit to the normal impulse of a row; returns how much it changed the normal velocity [m/s]."""
    before = r.normal_impulse
    total = before + (r.target_speed - relative_speed(sim, c, r, 0)) / r.inverse_mass_n
    total = min(r.impulse_limit, max(0.0, total))
    if total == before:
        return 0.0
    r.normal_impulse = total
    apply(sim, c, r, 0, total - before)
    return abs(total - before) * float(r.inverse_mass_n)


@kernel
def rub_row(sim: Simulation, c: Coupled, r: Row) -> float:
    """One visit to the friction impulse of a row; returns how much it changed the sliding velocity [m/s]."""
    cap = r.friction * r.normal_impulse
    x0, y0 = r.tangent_impulse[0], r.tangent_impulse[1]
    if cap == 0.0 and x0 == 0.0 and y0 == 0.0:
        return 0.0
    vx = relative_speed(sim, c, r, 1) - r.tangent_target[0]
    vy = relative_speed(sim, c, r, 2) - r.tangent_target[1]
    i_tt, i_tb, i_bb = vec_of(r.mass_t)
    mass = r.inverse_mass_most
    x, y = x0 - i_tt * vx - i_tb * vy, y0 - i_tb * vx - i_bb * vy  # what ends the sliding, if the disc allows it
    if x * x + y * y > cap * cap:
        x, y = x0 - vx / mass, y0 - vy / mass
        size = math.sqrt(x * x + y * y)
        if size > cap:
            x, y = x * cap / size, y * cap / size
    if x == x0 and y == y0:
        return 0.0
    r.tangent_impulse[0], r.tangent_impulse[1] = x, y
    apply(sim, c, r, 1, x - x0)
    apply(sim, c, r, 2, y - y0)
    return (abs(x - x0) + abs(y - y0)) * float(mass)


@outlined
def solve_contacts(sim: Simulation, c: Coupled, precision: float) -> int:
    """Solve the rows whose `mode` is 1 and all bounds together, from the impulses they hold, which must be in the velocities.

    Returns the sweeps made; `SWEEPS` where they did not settle.
    """
    rows, bounds = sim.counts[0].rows, c.solve[0].bounds
    total = rows + bounds
    for sweep in range(SWEEPS):
        most = 0.0
        for i in range(total):
            k = i if sweep & 1 == 0 else total - 1 - i
            if k >= rows:
                most = max(most, press_bound(c, k - rows))
                continue
            r = sim.rows[k]
            if r.mode == 1:
                most = max(most, press_row(sim, c, r))
                most = max(most, rub_row(sim, c, r))
        if most <= precision:
            return sweep + 1
    return SWEEPS


@kernel
def impulse_vector(r: Row) -> Vec:
    """World friction impulse of a row [N s]."""
    t, b, x, y = vec_of(r.tangent), vec_of(r.binormal), r.tangent_impulse[0], r.tangent_impulse[1]
    return (x * t[0] + y * b[0], x * t[1] + y * b[1], x * t[2] + y * b[2])
