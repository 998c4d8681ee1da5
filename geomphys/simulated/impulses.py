"""Collisions: equations (7)–(10).

With n out of b into a and v_AB the velocity of a's contact point relative to b's, a collision is a contact with
v_n = n·v_AB < 0  (7). It leaves  v_n⁺ = -ε v_n⁻  (8), through the impulse

    j = -(1 + ε) v_n⁻ / (m_a⁻¹ + m_b⁻¹ + n·(I_a⁻¹(r_a × n) × r_a) + n·(I_b⁻¹(r_b × n) × r_b))      (9)

+j n on a and -j n on b, and then Coulomb's friction  j_t = -μ j v_t/|v_t|  (10), never more than stops the sliding.
Where two faces meet, the points of the collision get their normal impulses together, so that (8) holds at each, and
then their friction, by sweeps over the points. Each impulse acts on both bodies with opposite signs: momentum is kept
to rounding; each takes energy, as (1 - ε²) and friction do.

The points are the contacts with `mode` > 0; their impulses so far are `normal_impulse` and `tangent_impulse`. `velocity`
holds six numbers a body: velocity of the reference point and angular velocity.
"""

from __future__ import annotations

import math

from geomphys.jit.kernel import kernel
from geomphys.numerics.row_vectors import vec_of
from geomphys.numerics.vec3 import dot
from geomphys.scene.arrays import Floats
from geomphys.simulated.contact_points import apply_impulse, normal_speed, speed_at
from geomphys.simulated.state import IMPACTING, INACTIVE, Contact, Simulation, is_disabled

SWEEPS = 300
PRECISION = 1e-13  # of the fastest approach: sweeps over the points of a collision end when none changes by more


@kernel
def exclude_disabled(sim: Simulation) -> None:
    """Take the contacts of disabled pairs out of the solve."""
    for k in range(sim.counts.contacts):
        if is_disabled(sim, sim.contacts[k].pair):
            sim.contacts[k].mode = INACTIVE


@kernel
def apply_tangential(sim: Simulation, velocity: Floats, k: int, x: float, y: float) -> None:
    """Add the friction impulse (x, y) [N s] along tangent and binormal of contact k."""
    r, a, b = sim.contacts[k], sim.contacts[k].a, sim.contacts[k].b
    r.tangent_impulse[0] = r.tangent_impulse[0] + x
    r.tangent_impulse[1] = r.tangent_impulse[1] + y
    apply_impulse(sim, velocity, r, a, b, 1, x)
    apply_impulse(sim, velocity, r, a, b, 2, y)


@kernel
def apply_friction_once(sim: Simulation, velocity: Floats, k: int, cap: float) -> None:
    """Friction (10) at a single point: along -v_t, at most `cap` [N s], at most what stops the sliding."""
    r = sim.contacts[k]
    v = speed_at(velocity, r, r.a, r.b)
    x, y = dot(vec_of(r.tangent), v), dot(vec_of(r.binormal), v)
    speed = math.sqrt(x * x + y * y)
    if speed == 0.0:
        return
    x, y = x / speed, y / speed
    k_tt, k_tb, k_bb = vec_of(r.inverse_mass_t)
    j = min(cap, speed / (x * x * k_tt + 2.0 * x * y * k_tb + y * y * k_bb))
    apply_tangential(sim, velocity, k, -j * x, -j * y)


@kernel
def stopping_impulse(r: Contact, vx: float, vy: float, cap: float) -> tuple[float, float]:
    """Friction impulse (x, y) [N s] of a contact that stops the sliding (vx, vy) [m/s], if it is within the disc of radius `cap`.

    Else one step opposite to the sliding, put back onto the disc.
    """
    i_tt, i_tb, i_bb = vec_of(r.mass_t)
    x0, y0, mass = r.tangent_impulse[0], r.tangent_impulse[1], r.inverse_mass_most
    x, y = x0 - i_tt * vx - i_tb * vy, y0 - i_tb * vx - i_bb * vy
    if x * x + y * y > cap * cap:
        x, y = x0 - vx / mass, y0 - vy / mass
        size = math.sqrt(x * x + y * y)
        if size > cap:
            x, y = x * cap / size, y * cap / size
    return x, y


@kernel
def solve_friction(sim: Simulation, velocity: Floats, k: int, cap: float) -> float:
    """One sweep's change of the friction impulse at contact k within the disc of radius `cap` [N s].

    Returns how much it changed the sliding velocity [m/s].
    """
    r = sim.contacts[k]
    v = speed_at(velocity, r, r.a, r.b)
    vx, vy = dot(vec_of(r.tangent), v), dot(vec_of(r.binormal), v)
    x0, y0 = r.tangent_impulse[0], r.tangent_impulse[1]
    x, y = stopping_impulse(r, vx, vy, cap)
    if x != x0 or y != y0:
        apply_tangential(sim, velocity, k, x - x0, y - y0)
    return (abs(x - x0) + abs(y - y0)) * r.inverse_mass_most


@kernel
def solve_normal(sim: Simulation, velocity: Floats, k: int) -> float:
    """One sweep's change of the normal impulse at contact k, >= 0 in total, towards v_n >= `target_speed`.

    Returns how much it changed the normal velocity [m/s].
    """
    r, a, b = sim.contacts[k], sim.contacts[k].a, sim.contacts[k].b
    mass, before = r.inverse_mass_n, r.normal_impulse
    change = (r.target_speed - normal_speed(velocity, r, a, b)) / mass
    total = min(r.impulse_limit, max(0.0, before + change))
    change = total - before
    if change != 0.0:
        r.normal_impulse = total
        apply_impulse(sim, velocity, r, a, b, 0, change)
    return abs(change) * mass


@kernel
def collide(sim: Simulation, velocity: Floats, elastic: float) -> None:
    """Resolve one collision: the IMPACTING contacts, by (8)–(10); lists them in `order`.

    `elastic` is 1 for the restitution of the materials, 0 for none. The contacts' impulses must be zero on entry.
    """
    count, fastest = 0, 0.0
    for k in range(sim.counts.contacts):
        r = sim.contacts[k]
        if r.mode == IMPACTING:
            sim.order[count] = k
            count += 1
            v = normal_speed(velocity, r, r.a, r.b)
            r.target_speed = max(0.0, -elastic * r.restitution * v)
            fastest = max(fastest, -v)
    if count == 1:
        only = sim.order[0]
        solve_normal(sim, velocity, only)
        apply_friction_once(sim, velocity, only, sim.contacts[only].friction * sim.contacts[only].normal_impulse)
        return
    for _ in range(SWEEPS):
        most = 0.0
        for i in range(count):
            most = max(most, solve_normal(sim, velocity, sim.order[i]))
        if most <= PRECISION * fastest:
            break
    for _ in range(SWEEPS):
        most = 0.0
        for i in range(count):
            r = sim.contacts[sim.order[i]]
            most = max(most, solve_friction(sim, velocity, sim.order[i], r.friction * r.normal_impulse))
        if most <= PRECISION * fastest:
            break
