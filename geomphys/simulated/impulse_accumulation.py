"""Applies impulses to the motions of bodies and accumulates them for each contact point of the frame."""

from __future__ import annotations

from geomphys.jit.kernel import kernel
from geomphys.numerics.row_vectors import add_vec, set_vec, vec_of
from geomphys.numerics.vec3 import Vec, add_scaled, cross, scale
from geomphys.simulated.state import Contact, Simulation, Slot, has_changed, is_disabled, is_simulated


@kernel
def impulse_of(r: Contact) -> Vec:
    """World impulse of contact `r` on body a [N s]."""
    j = scale(vec_of(r.normal), r.normal_impulse)
    j = add_scaled(j, vec_of(r.tangent), r.tangent_impulse[0])
    return add_scaled(j, vec_of(r.binormal), r.tangent_impulse[1])


@kernel
def give_velocity(sim: Simulation, k: int, j: Vec) -> None:
    """Give the impulse j [N s] of contact k to the motions of both bodies, to b's reversed."""
    r = sim.contacts[k]
    m = sim.motion[r.a]
    add_vec(m.velocity, j, 1.0 * m.inverse_mass)
    add_vec(m.angular_momentum, cross(vec_of(r.arm_a), j), 1.0)
    if is_simulated(sim, r.b):
        m = sim.motion[r.b]
        add_vec(m.velocity, j, -1.0 * m.inverse_mass)
        add_vec(m.angular_momentum, cross(vec_of(r.arm_b), j), -1.0)


@kernel
def give_force(sim: Simulation, k: int, j: Vec, rate: float) -> None:
    """Add the force `rate` j [N] of contact k to both bodies, to b reversed; `rate` is in 1/s."""
    r = sim.contacts[k]
    m = sim.motion[r.a]
    add_vec(m.acceleration, j, rate * m.inverse_mass)
    add_vec(m.torque, cross(vec_of(r.arm_a), j), rate)
    if is_simulated(sim, r.b):
        m = sim.motion[r.b]
        add_vec(m.acceleration, j, -rate * m.inverse_mass)
        add_vec(m.torque, cross(vec_of(r.arm_b), j), -rate)


@kernel
def note(slot: Slot, n: Vec, normal: float, friction: Vec) -> None:
    """Add an impulse [N s], `normal` along n and `friction` as a vector, to the totals of a contact point."""
    slot.normal_impulse = slot.normal_impulse + normal
    add_vec(slot.friction_impulse, friction, 1.0)
    add_vec(slot.normal_impulses, n, normal)


@kernel
def commit(sim: Simulation) -> None:
    """Apply the impulses of all contacts to the bodies, add them to the totals of their points, and clear them."""
    for k in range(sim.counts.contacts):
        r = sim.contacts[k]
        normal = r.normal_impulse
        if normal == 0.0 and r.tangent_impulse[0] == 0.0 and r.tangent_impulse[1] == 0.0:
            continue
        j = impulse_of(r)
        give_velocity(sim, k, j)
        n = vec_of(r.normal)
        note(sim.slots[r.pair, r.slot], n, normal, add_scaled(j, n, -normal))
        r.normal_impulse = r.tangent_impulse[0] = r.tangent_impulse[1] = 0.0


@kernel
def drop_contacts(sim: Simulation, t: float) -> None:
    """Add the impulses of contact forces on changed bodies until time `t` to the totals, and drop all contacts."""
    for i in range(sim.counts.concerned):
        k = sim.concerned[i]
        if not has_changed(sim, sim.pairs[k].body[0]):
            continue
        for m in range(sim.pairs[k].point_count):
            slot = sim.slots[k, m]
            elapsed = t - slot.since
            friction_force = vec_of(slot.friction_force)
            if elapsed > 0.0 and (slot.normal_force > 0.0 or friction_force != (0.0, 0.0, 0.0)):
                note(slot, vec_of(slot.normal), elapsed * slot.normal_force, scale(friction_force, elapsed))
                slot.since = t
            if is_disabled(sim, k):
                slot.normal_force = 0.0
                set_vec(slot.friction_force, (0.0, 0.0, 0.0))
    sim.counts.contacts = 0
