"""Sweeps of the coupled contact solve: projected Gauss-Seidel with extrapolation between them.

A visit to a contact sets its normal impulse p >= 0, which keeps the normal velocity at or above its target, and its friction
impulse within the disc μ p, which takes the sliding velocity to its target or else opposes it (Moreau 1988, Jean 1999).
Contacts are swept forwards and backwards, with the extrapolation of accelerated gradient methods in between (Nesterov 1983).
"""

from __future__ import annotations

import math

from geomphys.engine.coupled_impulses import add_impulse, apply, inequality_rate, relative_velocity
from geomphys.engine.coupled_state import Coupled
from geomphys.jit.kernel import kernel, noinline
from geomphys.numerics.vec3 import sub
from geomphys.simulated.contact_solver import add_reversal, begin_contact, extrapolated_impulse, local_impulse
from geomphys.simulated.impulses import stopping_impulse
from geomphys.simulated.state import ACTIVE, Contact, Simulation


@kernel
def update_inequality(c: Coupled, k: int) -> float:
    """One visit to inequality k; returns how much it changed the rate of its clearance."""
    g = c.inequalities[k]
    if g.response <= 0.0:
        return 0.0
    change = max(0.0, g.impulse + (g.target_speed - inequality_rate(c, k)) / g.response) - g.impulse
    add_impulse(c, k, change)
    return float(abs(change) * g.response)


@kernel
def update_contact(sim: Simulation, c: Coupled, r: Contact) -> float:
    """One visit to a contact: its normal impulse, then its friction; returns how much they changed its velocity [m/s]."""
    n, t, b = relative_velocity(sim, c, r)
    before = r.normal_impulse
    after = min(r.impulse_limit, max(0.0, before + (r.target_speed - n) / r.inverse_mass_n))
    x0, y0, p = r.tangent_impulse[0], r.tangent_impulse[1], after - before
    cap = r.friction * after
    x, y = 0.0, 0.0
    if cap > 0.0:
        t += r.inverse_mass_nt[0] * p - r.tangent_target[0]
        b += r.inverse_mass_nt[1] * p - r.tangent_target[1]
        x, y = stopping_impulse(r, t, b, cap)
    if p == 0.0 and x == x0 and y == y0:
        return 0.0
    r.normal_impulse, r.tangent_impulse[0], r.tangent_impulse[1] = after, x, y
    apply(sim, c, r, (p, x - x0, y - y0))
    return float(max(abs(p) * r.inverse_mass_n, (abs(x - x0) + abs(y - y0)) * r.inverse_mass_most))


@kernel
def begin_extrapolation(sim: Simulation, c: Coupled) -> None:
    """Restart extrapolation from the impulses of contacts and inequalities."""
    for k in range(sim.counts.contacts):
        begin_contact(sim.contacts[k])
    for k in range(c.solve.inequalities):
        g = c.inequalities[k]
        g.previous_impulse = g.extrapolated = g.impulse


@kernel
def is_reversed(sim: Simulation, c: Coupled) -> bool:
    """Whether the last two sweeps reversed the extrapolation: its gradient restart (O'Donoghue and Candès 2015)."""
    along = 0.0
    for k in range(sim.counts.contacts):
        r = sim.contacts[k]
        if r.mode == ACTIVE:
            along = add_reversal(along, r)
    for k in range(c.solve.inequalities):
        g = c.inequalities[k]
        along += (g.extrapolated - g.impulse) * (g.impulse - g.previous_impulse) * g.response
    return along > 0.0


@kernel
def extrapolate(sim: Simulation, c: Coupled, momentum: float) -> None:
    """Extrapolate impulses by `momentum` times their change in the last two sweeps.

    They are projected onto what they may be.
    """
    for k in range(sim.counts.contacts):
        r = sim.contacts[k]
        if r.mode != ACTIVE:
            continue
        j = local_impulse(r)
        n, t, b = extrapolated_impulse(r, momentum)
        if (n, t, b) != j:
            r.normal_impulse, r.tangent_impulse[0], r.tangent_impulse[1] = n, t, b
            apply(sim, c, r, sub((n, t, b), j))
    for k in range(c.solve.inequalities):
        g = c.inequalities[k]
        impulse = g.impulse
        g.extrapolated = max(0.0, impulse + momentum * (impulse - g.previous_impulse))
        g.previous_impulse = impulse
        add_impulse(c, k, g.extrapolated - impulse)


@kernel
def sweep_contacts(sim: Simulation, c: Coupled, backwards: bool) -> float:
    """One sweep over the ACTIVE contacts and the inequalities; returns the largest change of a velocity [m/s]."""
    contacts, most = sim.counts.contacts, 0.0
    total = contacts + c.solve.inequalities
    for i in range(total):
        k = total - 1 - i if backwards else i
        if k >= contacts:
            most = max(most, update_inequality(c, k - contacts))
        elif sim.contacts[k].mode == ACTIVE:
            most = max(most, update_contact(sim, c, sim.contacts[k]))
    return most


@noinline
def make_sweeps(sim: Simulation, c: Coupled, sweeps: int, precision: float) -> None:
    """Make so many sweeps, from the impulses, which are part of the velocities.

    After every two, forwards and backwards, the impulses are extrapolated, with a restart where the sweeps reverse it. They
    end when one changes no velocity by more than `precision` [m/s].
    """
    momentum = 1.0
    begin_extrapolation(sim, c)
    for sweep in range(sweeps):
        backwards = sweep & 1 == 1
        if sweep_contacts(sim, c, backwards) <= precision:
            return
        if backwards and sweep + 1 < sweeps:
            before, momentum = momentum, 0.5 * (1.0 + math.sqrt(1.0 + 4.0 * momentum * momentum))
            if is_reversed(sim, c):
                before = momentum = 1.0
            extrapolate(sim, c, (before - 1.0) / momentum)


@kernel
def contact_residual(sim: Simulation, c: Coupled, r: Contact) -> float:
    """How far the impulses of a contact are off the conditions of contact and friction, over its effective mass [m/s]."""
    n, t, b = relative_velocity(sim, c, r)
    p, x0, y0 = local_impulse(r)
    pressed, most = max(0.0, p - (n - r.target_speed) / r.inverse_mass_n), r.inverse_mass_most
    x, y = x0 - (t - r.tangent_target[0]) / most, y0 - (b - r.tangent_target[1]) / most
    size, cap = math.sqrt(x * x + y * y), r.friction * pressed
    part = cap / size if size > cap else 1.0
    x, y = part * x - x0, part * y - y0
    return float(max(abs(pressed - p) * r.inverse_mass_n, math.sqrt(x * x + y * y) * most))


@noinline
def residual_of(sim: Simulation, c: Coupled) -> float:
    """The largest residual of the ACTIVE contacts and all inequalities [m/s]."""
    most = 0.0
    for k in range(sim.counts.contacts):
        if sim.contacts[k].mode == ACTIVE:
            most = max(most, contact_residual(sim, c, sim.contacts[k]))
    for k in range(c.solve.inequalities):
        g = c.inequalities[k]
        if g.response > 0.0:
            off = inequality_rate(c, k) - g.target_speed
            most = max(most, abs(max(0.0, g.impulse - off / g.response) - g.impulse) * g.response)
    return most
