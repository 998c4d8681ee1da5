"""Contact points of a pair: found, matched with those of the step before, written as contacts for the solvers.

A contact has the response of both bodies to an impulse at the point.
"""

from __future__ import annotations

import math

from geomphys.collision.manifold import manifold
from geomphys.collision.support import Shapes
from geomphys.jit.kernel import inlined, kernel, noinline
from geomphys.jit.record_copy import copy_record
from geomphys.numerics.row_vectors import (
    add_vec,
    add_vec_from,
    quat_of,
    rot_of,
    set_vec,
    set_vec_at,
    vec_at,
    vec_from,
    vec_of,
)
from geomphys.numerics.vec3 import (
    Vec,
    add,
    add_scaled,
    cross,
    dot,
    perpendicular,
    quat_conjugate,
    quat_rotate,
    rotate,
    scale,
    sub,
)
from geomphys.scene.arrays import Floats
from geomphys.simulated.motion import point_at
from geomphys.simulated.state import ACTIVE, Contact, Motion, Simulation, Slot, is_disabled
from geomphys.simulated.time_of_impact import LOOK_FAR, is_apart, measure_pair_within, note_distance

NEAR = 4e-4  # m: contact points with no more clearance are solved
SAME = 4e-6  # m²: squared distance within which a point continues one of the step before


@kernel
def direction_of(r: Contact, axis: int) -> Vec:
    """Normal (axis 0), tangent (1) or binormal (2) of a contact."""
    if axis == 0:
        return vec_of(r.normal)
    return vec_of(r.tangent) if axis == 1 else vec_of(r.binormal)


@kernel
def clear_impulse(r: Contact) -> None:
    """Set the impulses of a contact to zero."""
    r.normal_impulse = r.tangent_impulse[0] = r.tangent_impulse[1] = 0.0


@kernel
def fill_masses(a: Motion, b: Motion, r: Contact) -> None:
    """Responses to unit impulses along normal and tangents: angular velocities of both bodies, relative velocity at the point.

    `a`, `b` are the bodies' records of `motion`.
    """
    ia, ib = rot_of(a.inverse_inertia), rot_of(b.inverse_inertia)
    ra, rb = vec_of(r.arm_a), vec_of(r.arm_b)
    light = a.inverse_mass + b.inverse_mass
    n, t, u = vec_of(r.normal), vec_of(r.tangent), vec_of(r.binormal)
    xa, ya, za = rotate(ia, cross(ra, n)), rotate(ia, cross(ra, t)), rotate(ia, cross(ra, u))
    xb, yb, zb = rotate(ib, cross(rb, n)), rotate(ib, cross(rb, t)), rotate(ib, cross(rb, u))
    set_vec_at(r.response_a, 0, xa)
    set_vec_at(r.response_a, 1, ya)
    set_vec_at(r.response_a, 2, za)
    set_vec_at(r.response_b, 0, xb)
    set_vec_at(r.response_b, 1, yb)
    set_vec_at(r.response_b, 2, zb)
    along_n = add(cross(xa, ra), cross(xb, rb))
    along_t = add(cross(ya, ra), cross(yb, rb))
    along_u = add(cross(za, ra), cross(zb, rb))
    r.inverse_mass_n = light + dot(n, along_n)
    r.inverse_mass_nt[0], r.inverse_mass_nt[1] = dot(t, along_n), dot(u, along_n)
    r.inverse_mass_t[0] = light + dot(t, along_t)
    r.inverse_mass_t[1] = dot(t, along_u)
    r.inverse_mass_t[2] = light + dot(u, along_u)
    invert_mass(r)


@kernel
def invert_mass(r: Contact) -> None:
    """Set the fields of contact `r` that derive from `inverse_mass_t`."""
    k_tt, k_tb, k_bb = vec_of(r.inverse_mass_t)
    inverse, half = 1.0 / (k_tt * k_bb - k_tb * k_tb), 0.5 * (k_tt - k_bb)
    set_vec(r.mass_t, (inverse * k_bb, -inverse * k_tb, inverse * k_tt))
    r.inverse_mass_most = 0.5 * (k_tt + k_bb) + math.sqrt(half * half + k_tb * k_tb)


@kernel
def clear_impulses(slot: Slot) -> None:
    """Set the accumulated impulses of a frame to zero."""
    slot.normal_impulse = 0.0
    set_vec(slot.friction_impulse, (0.0, 0.0, 0.0))
    set_vec(slot.normal_impulses, (0.0, 0.0, 0.0))


@kernel
def clear_slot(slot: Slot) -> None:
    """Clear a slot: no point, no accumulated impulses."""
    clear_impulses(slot)
    set_vec(slot.local, (0.0, 0.0, 0.0))
    set_vec(slot.friction_force, (0.0, 0.0, 0.0))
    set_vec(slot.slip_debt, (0.0, 0.0, 0.0))
    slot.normal_force = slot.depth = 0.0
    slot.used = 0


@kernel
def keep_old_slots(sim: Simulation, pair: int) -> None:
    """Copy the contact points of a pair to `old_slots`."""
    for m in range(4):
        copy_record(sim.old_slots[m], sim.slots[pair, m])


@kernel
def continued(sim: Simulation, x: Vec) -> int:
    """Which of the old contact points the point x (relative to a, a's frame) continues; -1: none. It is marked as matched."""
    best, slot = SAME, -1
    for m in range(4):
        if sim.old_slots[m].used == 0:
            continue
        e = sub(x, vec_of(sim.old_slots[m].local))
        if dot(e, e) < best:
            best, slot = dot(e, e), m
    if slot >= 0:
        sim.old_slots[slot].used = 0
    return slot


@kernel
def open_slot(sim: Simulation, pair: int, m: int, old: int, x: Vec, clearance: float) -> None:
    """Begin slot m of a pair at the point x (relative to a, a's frame), with the totals of the old point `old`, if any."""
    slot = sim.slots[pair, m]
    if old >= 0:
        copy_record(slot, sim.old_slots[old])
        clear_impulses(sim.old_slots[old])
    else:
        clear_slot(slot)
    set_vec(slot.local, x)
    slot.used = 1
    slot.depth = -clearance


@kernel
def hand_over_sums(sim: Simulation, pair: int, count: int) -> None:
    """Add the impulses of old points without a match to the first of the pair's `count` slots, so that none is lost."""
    for m in range(count, 4):
        clear_impulses(sim.slots[pair, m])
    first = sim.slots[pair, 0]
    for m in range(4):
        first.normal_impulse += sim.old_slots[m].normal_impulse
        add_vec(first.friction_impulse, vec_of(sim.old_slots[m].friction_impulse), 1.0)
        add_vec(first.normal_impulses, vec_of(sim.old_slots[m].normal_impulses), 1.0)


@kernel
def close_slots(sim: Simulation, pair: int, count: int) -> None:
    """Mark the slots from `count` on as holding no point; their accumulated impulses stay until `hand_over_sums`."""
    for m in range(count, 4):
        slot = sim.slots[pair, m]
        slot.used = 0
        slot.normal_force = 0.0
        set_vec(slot.friction_force, (0.0, 0.0, 0.0))
    sim.pairs[pair].point_count = count


@noinline
def add_contact(sim: Simulation, pair: int, count: int, t: float, n: Vec, x: Vec, clearance: float) -> None:
    """Append the contact of contact point number `count` of a pair: at x, normal n, both world."""
    p = sim.pairs[pair]
    a, b = sim.motion[p.body[0]], sim.motion[p.body[1]]
    k = sim.counts.contacts
    sim.counts.contacts = k + 1
    r = sim.contacts[k]
    tangent = perpendicular(n)
    set_vec(r.normal, n)
    set_vec(r.tangent, tangent)
    set_vec(r.binormal, cross(n, tangent))
    set_vec(r.arm_a, sub(x, vec_of(a.position)))
    set_vec(r.arm_b, sub(x, point_at(b, t)))
    r.clearance = clearance
    clear_impulse(r)
    r.target_speed = 0.0
    r.friction = p.friction
    r.restitution = p.restitution
    r.impulse_limit = math.inf
    fill_masses(a, b, r)
    sim.bodies[p.body[0]].touched = 1
    sim.bodies[p.body[1]].touched = 1
    r.pair = pair
    r.a = p.body[0]
    r.b = p.body[1]
    r.slot = count
    r.mode = ACTIVE
    local = quat_rotate(quat_conjugate(quat_of(a.orientation)), vec_of(r.arm_a))
    open_slot(sim, pair, count, continued(sim, local), local, clearance)


@kernel
def add_contacts(sim: Simulation, pair: int, t: float) -> None:
    """`add_contacts_within` of `NEAR`, unless the pair is disabled."""
    if not is_disabled(sim, pair):
        add_contacts_within(sim, pair, t, NEAR)


@noinline
def add_contacts_within(sim: Simulation, pair: int, t: float, margin: float) -> None:
    """Find the contact points of a pair at time `t` of the frame and append a contact for each nearer than `margin` [m].

    The base times of simulated bodies must be `t`.
    """
    p = sim.pairs[pair]
    if p.point_count == 0 and is_apart(sim, pair, t, margin):
        return
    s, n, pa, pb = measure_pair_within(sim, pair, t, max(LOOK_FAR, margin))
    note_distance(sim, pair, t, s)
    if s > margin:
        if p.point_count > 0:
            close_slots(sim, pair, 0)
        return
    i, j = p.piece[0], p.piece[1]
    on_a, on_b = sim.scratch.on_a, sim.scratch.on_b
    found = manifold(Shapes(sim.pieces, sim.frames), i, j, (s, n, pa, pb), on_a, on_b, sim.scratch)
    if sim.counts.contacts + found > len(sim.contacts):
        sim.counts.lost += 1
        return
    keep_old_slots(sim, pair)
    count = 0
    for m in range(found):
        xa, xb = vec_at(on_a, m), vec_at(on_b, m)
        clearance = dot(n, sub(xa, xb))
        if clearance <= margin:
            add_contact(sim, pair, count, t, n, scale(add(xa, xb), 0.5), clearance)
            count += 1
    close_slots(sim, pair, count)
    if count > 0:
        hand_over_sums(sim, pair, count)


@kernel
def speed_at(velocity: Floats, r: Contact, a: int, b: int) -> Vec:
    """v_AB of contact `r`: velocity of body a's contact point relative to b's [m/s]; `velocity` holds rows of six."""
    va, vb = velocity[a], velocity[b]
    at_a = add(vec_from(va, 0), cross(vec_from(va, 3), vec_of(r.arm_a)))
    at_b = add(vec_from(vb, 0), cross(vec_from(vb, 3), vec_of(r.arm_b)))
    return sub(at_a, at_b)


@kernel
def normal_speed(velocity: Floats, r: Contact, a: int, b: int) -> float:
    """v_n of (7) at contact `r` [m/s]; negative: approaching."""
    return dot(vec_of(r.normal), speed_at(velocity, r, a, b))


@inlined
def apply_impulses(sim: Simulation, r: Contact, j: Vec) -> None:
    """Apply the impulses +j to a and -j to b [N s] along normal, tangent and binormal of contact `r` to `velocity`.

    Bodies with prescribed motion are left as they are.
    """
    velocity = sim.velocity
    a, b = sim.motion[r.a].inverse_mass, sim.motion[r.b].inverse_mass
    d = add_scaled(scale(vec_of(r.normal), j[0]), vec_of(r.tangent), j[1])
    d = add_scaled(d, vec_of(r.binormal), j[2])
    if a > 0.0:
        rotation = add_scaled(scale(vec_at(r.response_a, 0), j[0]), vec_at(r.response_a, 1), j[1])
        add_vec_from(velocity[r.a], 0, d, a)
        add_vec_from(velocity[r.a], 3, add_scaled(rotation, vec_at(r.response_a, 2), j[2]), 1.0)
    if b > 0.0:
        rotation = add_scaled(scale(vec_at(r.response_b, 0), j[0]), vec_at(r.response_b, 1), j[1])
        add_vec_from(velocity[r.b], 0, d, -b)
        add_vec_from(velocity[r.b], 3, add_scaled(rotation, vec_at(r.response_b, 2), j[2]), -1.0)


@kernel
def apply_impulse(sim: Simulation, velocity: Floats, r: Contact, a: int, b: int, axis: int, j: float) -> None:
    """Apply the impulse +j to a and -j to b [N s] along axis 0 (normal), 1 (tangent) or 2 (binormal) of contact `r`."""
    va, vb = velocity[a], velocity[b]
    d = direction_of(r, axis)
    add_vec_from(va, 0, d, j * sim.motion[a].inverse_mass)
    add_vec_from(vb, 0, d, -j * sim.motion[b].inverse_mass)
    add_vec_from(va, 3, vec_at(r.response_a, axis), j)
    add_vec_from(vb, 3, vec_at(r.response_b, axis), -j)
