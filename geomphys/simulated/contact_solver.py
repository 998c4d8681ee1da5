"""Solves contacts together, each group of bodies in contact by itself: projected Gauss-Seidel sweeps with extrapolation.

A sweep visits the contacts of a group, forwards and backwards so that forces travel up and down a stack. A group that has not
converged after some sweeps is extrapolated between them (Nesterov 1983), with a restart where the sweeps reverse the
extrapolation (O'Donoghue and Candès 2015). A heap is solved less precisely: the next step goes on from there.
"""

from __future__ import annotations

import math

from geomphys.jit.kernel import kernel, noinline
from geomphys.numerics.row_vectors import set_vec, vec_of
from geomphys.numerics.vec3 import Vec, add_scaled, dot, sub
from geomphys.simulated.contact_points import apply_impulses, speed_at
from geomphys.simulated.impulses import solve_normal, stopping_impulse
from geomphys.simulated.state import ACTIVE, Contact, Simulation, has_changed

STILL = 1e-11  # m/s: sweeps end when none changes a velocity by more than this, or `STILL_PART`
STILL_PART = 1e-6  # of the fastest motion at a point of the group
SLOWEST_PART = 1e-2  # the same of the slowest motion that is solved
START_SWEEPS = 400  # sweeps at most over normal impulses alone
STACK = 12  # contacts: groups with more are solved less precisely while they move, as the next step goes on from there
COARSE = 300.0  # times `STILL_PART`: the precision of later sweeps over them
STACK_SWEEPS = 100  # sweeps at most over them; over a heap only while it moves, as it takes more to settle
HEAP = 24  # contacts: groups with more
MOVING = 0.02  # m/s: a heap moves if one of its points is faster
HEAP_VISITS = 200_000  # visits at most to the contacts of a larger heap, but for those of `STACK_SWEEPS`
HEAP_SLOWEST = 0.5  # of the slowest motion that is solved: later sweeps over a heap are no more precise
HEAP_STILL = 1e-6  # m/s: nor than this; at more than these 4 nm a step it sinks before it sleeps, and is lifted again
PLAIN = 4  # first sweeps, an even number, without extrapolation


@kernel
def local_impulse(r: Contact) -> Vec:
    """Impulses of a contact along normal, tangent and binormal [N s]."""
    return (r.normal_impulse, r.tangent_impulse[0], r.tangent_impulse[1])


@kernel
def begin_contact(r: Contact) -> None:
    """Restart the extrapolation of a contact from its impulses."""
    j = local_impulse(r)
    set_vec(r.previous_impulse, j)
    set_vec(r.extrapolated, j)


@kernel
def add_reversal(along: float, r: Contact) -> float:
    """`along` and by how much the last two sweeps reversed the extrapolation of a contact [J], for the gradient restart."""
    j = local_impulse(r)
    gradient, change = sub(vec_of(r.extrapolated), j), sub(j, vec_of(r.previous_impulse))
    along += gradient[0] * change[0] * r.inverse_mass_n
    along += (gradient[1] * change[1] + gradient[2] * change[2]) * r.inverse_mass_most
    return float(along)


@kernel
def speed_change(r: Contact, j: Vec) -> float:
    """How much a change `j` of the impulses of a contact [N s] changes its velocity [m/s]."""
    return float(max(abs(j[0]) * r.inverse_mass_n, (abs(j[1]) + abs(j[2])) * r.inverse_mass_most))


@kernel
def extrapolated_impulse(r: Contact, momentum: float) -> Vec:
    """Impulses of a contact, extrapolated by `momentum` times their change in two sweeps, projected onto their bounds [N s].

    They are noted in the contact, but not yet set.
    """
    j = local_impulse(r)
    n, t, b = add_scaled(j, sub(j, vec_of(r.previous_impulse)), momentum)
    n = min(r.impulse_limit, max(0.0, n))
    square, cap = t * t + b * b, r.friction * n
    if square > cap * cap:
        size = math.sqrt(square)
        t, b = t * cap / size, b * cap / size
    set_vec(r.previous_impulse, j)
    set_vec(r.extrapolated, (n, t, b))
    return (n, t, b)


@kernel
def group_of(sim: Simulation, body: int) -> int:
    """The body that stands for the group of a simulated body."""
    while sim.bodies[body].contact_group != body:
        body = sim.bodies[body].contact_group
    return body


@kernel
def group_contacts(sim: Simulation) -> None:
    """Sort the ACTIVE contacts by groups of simulated bodies that they connect, into `order`.

    `contact_count` and `contact_end` of the body that stands for a group, its first, say where in `order` its contacts are.
    """
    contacts, bodies, count = sim.contacts, sim.bodies, sim.counts.contacts
    for s in range(sim.counts.changed):
        body = bodies[sim.changed[s]]
        body.contact_group = sim.changed[s]
        body.contact_count = 0
    for k in range(count):
        r = contacts[k]
        if r.mode == ACTIVE and has_changed(sim, r.b):
            a, b = group_of(sim, r.a), group_of(sim, r.b)
            bodies[max(a, b)].contact_group = min(a, b)
    for k in range(count):
        r = contacts[k]
        if r.mode == ACTIVE:
            bodies[group_of(sim, r.a)].contact_count += 1
    end = 0
    for s in range(sim.counts.changed):
        body = bodies[sim.changed[s]]
        body.contact_end = end
        end += body.contact_count
    for k in range(count):
        if contacts[k].mode == ACTIVE:
            group = bodies[group_of(sim, contacts[k].a)]
            sim.order[group.contact_end] = k
            group.contact_end += 1


@kernel
def update_contact(sim: Simulation, k: int) -> float:
    """One visit to contact k: its normal impulse, then its friction; returns how much they changed its velocity [m/s]."""
    r = sim.contacts[k]
    v = speed_at(sim.velocity, r, r.a, r.b)
    n, x, y = local_impulse(r)
    after = n + (r.target_speed - dot(vec_of(r.normal), v)) * r.mass_n
    after = min(r.impulse_limit, max(0.0, after))
    p, dx, dy = after - n, 0.0, 0.0
    cap = r.friction * after
    if cap > 0.0 or x != 0.0 or y != 0.0:
        vx = dot(vec_of(r.tangent), v) + r.inverse_mass_nt[0] * p
        vy = dot(vec_of(r.binormal), v) + r.inverse_mass_nt[1] * p
        to_x, to_y = stopping_impulse(r, vx, vy, cap)
        dx, dy = to_x - x, to_y - y
    if p == 0.0 and dx == 0.0 and dy == 0.0:
        return 0.0
    r.normal_impulse, r.tangent_impulse[0], r.tangent_impulse[1] = after, x + dx, y + dy
    apply_impulses(sim, r, (p, dx, dy))
    return speed_change(r, (p, dx, dy))


@kernel
def disturb(sim: Simulation, r: Contact, number: int) -> None:
    """Store that visit `number`, to contact `r`, changed the velocities of its bodies that have a finite mass."""
    if sim.motion[r.a].inverse_mass > 0.0:
        sim.bodies[r.a].disturbed = number
    if sim.motion[r.b].inverse_mass > 0.0:
        sim.bodies[r.b].disturbed = number


@kernel
def is_disturbed(sim: Simulation, r: Contact) -> bool:
    """Whether the velocities of the bodies of contact `r` have changed since it was visited."""
    last = r.visit
    return sim.bodies[r.a].disturbed >= last or sim.bodies[r.b].disturbed >= last


@kernel
def extrapolate(sim: Simulation, first: int, end: int, number: int, momentum: float, least: float) -> None:
    """Extrapolate the contacts `first` to `end` of `order` by `momentum` times their last change, after visit `number`.

    Where that changes a velocity by no more than `least` [m/s] nothing is done.
    """
    for i in range(first, end):
        r = sim.contacts[sim.order[i]]
        j = local_impulse(r)
        to = extrapolated_impulse(r, momentum)
        change = sub(to, j)
        if speed_change(r, change) > least:
            r.normal_impulse, r.tangent_impulse[0], r.tangent_impulse[1] = to
            apply_impulses(sim, r, change)
            disturb(sim, r, number)
        else:  # where it is: `add_reversal` compares it with that of the next sweep
            set_vec(r.extrapolated, j)


@kernel
def solve_normals(sim: Simulation, first: int, end: int) -> None:
    """Sweeps over the normal impulses alone of the contacts `first` to `end` of `order`: a start where no force is known yet."""
    for i in range(first, end):
        if local_impulse(sim.contacts[sim.order[i]]) != (0.0, 0.0, 0.0):
            return
    for _ in range(START_SWEEPS):
        most = 0.0
        for i in range(first, end):
            most = max(most, solve_normal(sim, sim.velocity, sim.order[i]))
        if most <= STILL:
            return


@kernel
def begin_group(sim: Simulation, first: int, end: int) -> float:
    """Begin the solve of the contacts `first` to `end` of `order`; returns the fastest motion at one of them [m/s]."""
    fastest = 0.0
    for i in range(first, end):
        r = sim.contacts[sim.order[i]]
        r.visit, r.mass_n = 0, 1.0 / r.inverse_mass_n
        sim.bodies[r.a].disturbed = sim.bodies[r.b].disturbed = 0
        fastest = max(fastest, r.speed)
    return fastest


@noinline
def solve_group(sim: Simulation, first: int, end: int, sweeps: int, precision: float, later: float) -> None:
    """`solve_contacts` for one group: the contacts `first` to `end` of `order`.

    Velocities get the `precision` [m/s], or after the first sweeps that of `later`. A contact whose bodies have not been
    disturbed by more than the latter since it was visited is skipped.
    """
    number, momentum = 0, 1.0
    for sweep in range(sweeps):
        most, backwards = 0.0, sweep & 1 == 1
        for i in range(first, end):
            k = sim.order[first + end - 1 - i if backwards else i]
            r = sim.contacts[k]
            if is_disturbed(sim, r):
                number += 1
                r.visit = number
                change = update_contact(sim, k)
                if change > later:
                    disturb(sim, r, number)
                most = max(most, change)
        if most <= (precision if sweep < PLAIN else later):
            return
        if not backwards or sweep + 1 < PLAIN:
            continue
        if sweep + 1 == PLAIN:
            for i in range(first, end):
                begin_contact(sim.contacts[sim.order[i]])
            continue
        before, along = momentum, 0.0
        momentum = 0.5 * (1.0 + math.sqrt(1.0 + 4.0 * momentum * momentum))
        for i in range(first, end):
            along = add_reversal(along, sim.contacts[sim.order[i]])
        if along > 0.0:
            before = momentum = 1.0
        extrapolate(sim, first, end, number, (before - 1.0) / momentum, later)


@kernel
def solve_contacts(sim: Simulation, sweeps: int, slowest: float, normals_first: bool) -> None:
    """Solve all ACTIVE contacts: v_n >= `target_speed`, normal impulses >= 0, friction within its cone.

    They start from their present impulses, which must already be part of `velocity`; with `normals_first` those of a group
    that has none from what its normal impulses are without friction. Groups of bodies that no contact connects are solved
    independently, but for those without a contact whose `speed` is above `slowest` [m/s]. A group is done when no sweep changes a
    velocity by more than `STILL_PART` of the fastest `speed`, `SLOWEST_PART` of `slowest`, or `STILL`, or after so many
    `sweeps`; one of more than `STACK` contacts earlier.
    """
    group_contacts(sim)
    for s in range(sim.counts.changed):
        group = sim.bodies[sim.changed[s]]
        first, end = group.contact_end - group.contact_count, group.contact_end
        if first == end:
            continue
        fastest = begin_group(sim, first, end)
        if fastest < slowest:
            continue
        if normals_first:
            solve_normals(sim, first, end)
        precision = max(STILL, STILL_PART * fastest)
        count, bound, later = end - first, sweeps, max(precision, SLOWEST_PART * slowest)
        if count > STACK:
            later = max(later, COARSE * STILL_PART * fastest)
        if count > HEAP:
            later = max(later, HEAP_SLOWEST * slowest, HEAP_STILL)
        if STACK < count <= HEAP or (count > HEAP and fastest > MOVING):
            bound = min(sweeps, STACK_SWEEPS)
        bound = min(bound, max(STACK_SWEEPS, HEAP_VISITS // count))
        solve_group(sim, first, end, bound, precision, later)
