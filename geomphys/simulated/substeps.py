"""Moves islands through a step of the simulated loop, each in substeps of its own, from impact to impact.

Within a substep the queue has the time of impact of each pair; the earliest is resolved, the bodies that it concerns, and those
that may touch them, get new forces and motions, and their pairs are queued again.
"""

from __future__ import annotations

import math

from geomphys.jit.kernel import kernel, noinline
from geomphys.numerics.row_vectors import vec_of
from geomphys.numerics.vec3 import norm
from geomphys.simulated.collisions import resolve
from geomphys.simulated.contact_points import add_contacts
from geomphys.simulated.energy import energy, note_energies, note_new_energies, take_excess
from geomphys.simulated.impact_queue import put, take_out
from geomphys.simulated.impulse_accumulation import drop_contacts
from geomphys.simulated.islands import is_label, mark_connected, mark_island
from geomphys.simulated.motion import move_bases
from geomphys.simulated.overlap_clearing import clear_overlaps
from geomphys.simulated.pairs import any_beyond_range, find_pairs_again
from geomphys.simulated.position_projection import TOUCHING, any_short, project_positions
from geomphys.simulated.resting_contact import FEW_SWEEPS, SWEEPS, solve_resting_contact
from geomphys.simulated.sleeping import wake
from geomphys.simulated.state import (
    OUT_OF_COLLISIONS,
    STOPPED,
    UNBOUNDED,
    Simulation,
    has_changed,
    is_disabled,
    is_simulated,
)
from geomphys.simulated.time_of_impact import first_touch, measure_pair, stays_apart

ROTATION_PER_STEP = 0.1  # rad: a body that may touch something rotates no further in a substep
MIN_STEP = 1e-6  # s
MOMENTS = 320  # moments with impacts of an island in a frame, beside two for each collision that it may have
MAX_ENCOUNTERS = 40  # impacts of a pair in a step, if one has prescribed motion: beyond, the pair is disabled
APPROACH_IF_FAST = 3.0  # gaps: how far surfaces in resting contact may approach in a step if one is faster than `SLOW`
APPROACH_IF_SLOW = 1.0  # gaps: the same if none is: separating them again takes more energy than they have
SLOW = 0.05  # m/s
PROJECTION_ROUNDS = 20
DEEP = 3.0  # gaps: an overlap that linearised contacts no longer describe


@kernel
def build_contacts(sim: Simulation, t: float) -> float:
    """Find the contact points of changed bodies at time `t`. Returns the least clearance among them [m]."""
    drop_contacts(sim, t)
    for i in range(sim.counts.concerned):
        k = sim.concerned[i]
        if has_changed(sim, sim.pairs[k].body[0]):
            add_contacts(sim, k, t)
    least = math.inf
    for k in range(sim.counts.contacts):
        least = min(least, sim.contacts[k].clearance)
    return least


@noinline
def project_out_of_overlap(sim: Simulation, t: float) -> float:
    """Find the contact points of the changed bodies at time `t` and move the bodies until none of them overlaps.

    Returns the least clearance that is left [m]: as measured, or to first order where the overlap was shallow.
    """
    tolerance = TOUCHING * sim.frame.gap
    least = build_contacts(sim, t)
    for _ in range(PROJECTION_ROUNDS):
        if not any_short(sim, tolerance):
            break
        projected = project_positions(sim, tolerance)
        for i in range(sim.counts.concerned):
            sim.pairs[sim.concerned[i]].measured_at = -1.0
        if least >= -DEEP * sim.frame.gap:
            return projected
        least = build_contacts(sim, t)
    return least


@kernel
def allowed_approach(sim: Simulation, pair: int) -> float:
    """How far the surfaces of a pair in resting contact may approach within a step, in gaps."""
    for side in range(2):
        m = sim.motion[sim.pairs[pair].body[side]]
        if norm(vec_of(m.velocity)) + norm(vec_of(m.angular_velocity)) * m.reach > SLOW:
            return APPROACH_IF_FAST
    return APPROACH_IF_SLOW


@kernel
def queue_pairs(sim: Simulation, t: float, t1: float) -> None:
    """Find the times of impact before `t1` of the pairs of changed bodies and queue them."""
    gap = sim.frame.gap
    for i in range(sim.counts.concerned):
        k = sim.concerned[i]
        p, due = sim.pairs[k], math.inf
        if p.encounters >= MAX_ENCOUNTERS and not is_simulated(sim, p.body[1]) and sim.bodies[p.body[1]].moves == 1:
            p.disabled = 1
        if not is_disabled(sim, k):
            target, slack = gap, 0.25 * gap
            if p.resting == 1:
                # contact forces act on it: only their error counts
                if sim.pairs[k].measured_at != t:
                    measure_pair(sim, k, t)
                target, slack = min(0.0, sim.pairs[k].distance) - allowed_approach(sim, k) * gap, 0.5 * gap
            if not stays_apart(sim, k, t, t1, target + slack):
                due = first_touch(sim, k, t, t1, target, slack)
        if due < t1:
            put(sim, k, due)
        else:
            take_out(sim, k)


@kernel
def longest_substep(sim: Simulation, left: float) -> float:
    """Longest substep for the changed bodies, an island's [s]: those that may touch something do not rotate far in it."""
    h = left
    for i in range(sim.counts.concerned):
        p = sim.pairs[sim.concerned[i]]
        for side in range(2):
            body = p.body[side]
            if has_changed(sim, body) and sim.arm[p.piece[side]] > 0.0:
                omega = norm(vec_of(sim.motion[body].angular_velocity))
                if omega * h > ROTATION_PER_STEP:
                    h = max(MIN_STEP, ROTATION_PER_STEP / omega)
    return h


@kernel
def share_counts(sim: Simulation) -> None:
    """Give the changed bodies, an island's, the end of the substep and the counts of that among them which has most."""
    end, moments, all_moments, collisions, bound = math.inf, 0, 0, 0, UNBOUNDED
    for s in range(sim.counts.changed):
        body = sim.bodies[sim.changed[s]]
        end, moments = min(end, body.substep_end), max(moments, body.moments)
        all_moments, collisions = max(all_moments, body.all_moments), max(collisions, body.collisions)
        bound = max(bound, body.bound)
    for s in range(sim.counts.changed):
        body = sim.bodies[sim.changed[s]]
        body.substep_end, body.moments = end, moments
        body.all_moments, body.collisions, body.bound = all_moments, collisions, bound


@kernel
def merge_islands(sim: Simulation, t: float) -> int:
    """Search again for pairs of the changed bodies, an island's, at time `t`, and join islands that it may now touch.

    The bodies of the whole island are then marked as changed. Returns its label.
    """
    find_pairs_again(sim, t)
    wake(sim, False)
    label = sim.bodies[sim.changed[0]].island
    mark_island(sim, label)
    move_bases(sim, t)
    share_counts(sim)
    return int(label)


@noinline
def solve_moment(sim: Simulation, t: float, max_collisions: int) -> int:
    """Impacts and contact forces of the changed bodies, of one island, at time `t`, and their next impacts.

    Returns the number of collisions resolved.
    """
    label, done = sim.bodies[sim.changed[0]].island, 0
    while True:
        move_bases(sim, t)
        project_out_of_overlap(sim, t)
        first = sim.bodies[sim.changed[0]]
        if t == 0.0:
            note_new_energies(sim)
        resolved, full = resolve(sim, t, max_collisions - first.collisions)
        done += resolved
        if resolved > 0 or full:
            count_work(sim, label, resolved, 0, OUT_OF_COLLISIONS if full else UNBOUNDED)
        solve_resting_contact(sim, t, first.substep_end - t, SWEEPS if first.moments == 0 else FEW_SWEEPS)
        if not any_beyond_range(sim, t):
            break
        mark_island(sim, label)
        move_bases(sim, t)
        label = merge_islands(sim, t)
        if is_stopped(sim):
            stop_island(sim, label, t)
            return done
    queue_pairs(sim, t, sim.bodies[sim.changed[0]].substep_end)
    return done


@kernel
def count_work(sim: Simulation, label: int, collisions: int, moments: int, bound: int) -> None:
    """Add to the counts of an island, and note a bound that it has met."""
    for i in range(sim.islands[label].first_body, sim.islands[label].end_body):
        body = sim.bodies[sim.members[i]]
        body.collisions += collisions
        body.moments += moments
        body.all_moments += moments
        body.bound = max(body.bound, bound)


@kernel
def is_stopped(sim: Simulation) -> bool:
    """Whether the island of the changed bodies stands still for the rest of the frame; true if there are none."""
    return bool(sim.counts.changed == 0 or sim.bodies[sim.changed[0]].bound >= STOPPED)


@kernel
def stop_island(sim: Simulation, label: int, t: float) -> None:
    """Leave the bodies of an island where they are at time `t` until the frame's end."""
    mark_island(sim, label)
    move_bases(sim, t)
    drop_contacts(sim, t)
    count_work(sim, label, 0, 0, STOPPED)
    for i in range(sim.counts.concerned):
        take_out(sim, sim.concerned[i])
    for s in range(sim.counts.changed):
        sim.bodies[sim.changed[s]].substep_end = sim.frame.step


@kernel
def pass_impact(sim: Simulation, pair: int, max_collisions: int) -> int:
    """Go on to the impact of a pair; returns the number of collisions resolved."""
    p = sim.pairs[pair]
    t, label = p.due, sim.bodies[p.body[0]].island
    p.encounters = p.encounters + 1
    mark_connected(sim, pair, t)
    count_work(sim, label, 0, 1, UNBOUNDED)
    if sim.bodies[sim.changed[0]].all_moments > MOMENTS + 2 * max_collisions:
        stop_island(sim, label, t)
        return 0
    return solve_moment(sim, t, max_collisions)


@kernel
def begin_substep(sim: Simulation, label: int, t: float, max_collisions: int) -> int:
    """Begin a substep of an island at time `t` of the step; returns the number of collisions resolved."""
    mark_island(sim, label)
    if t == 0.0:
        share_counts(sim)
    if is_stopped(sim):
        return 0
    left = sim.frame.step - t
    h = longest_substep(sim, left)
    for s in range(sim.counts.changed):
        body = sim.bodies[sim.changed[s]]
        body.substep_end = t + h if h < left else sim.frame.step
        body.moments = 0
    move_bases(sim, t)
    if t > 0.0:
        note_energies(sim)
    return solve_moment(sim, t, max_collisions)


@kernel
def end_substep(sim: Simulation, label: int, t: float) -> None:
    """Move the bodies of an island to time `t` of the step, and out of the errors of the substep that ends then."""
    mark_island(sim, label)
    if is_stopped(sim):
        return
    move_bases(sim, t)
    drop_contacts(sim, t)
    clear_overlaps(sim, t, TOUCHING * sim.frame.gap)
    take_excess(sim)


@kernel
def next_to_end(sim: Simulation) -> int:
    """Label of the island whose substep ends first, before the step does; -1: none."""
    soonest, label = sim.frame.step, -1
    for s in range(len(sim.free)):
        body = sim.free[s]
        if sim.bodies[body].substep_end < soonest and is_label(sim, body):
            soonest, label = sim.bodies[body].substep_end, body
    return label


@noinline
def advance_step(sim: Simulation, max_collisions: int) -> int:
    """Move the simulated bodies through the step, from impact to impact; returns the number of collisions resolved.

    Moments and ends of substeps are passed in the order of time, so that an island that comes near another one finds it there.
    """
    collisions = 0
    for s in range(len(sim.free)):
        body = sim.bodies[sim.free[s]]
        body.substep_end, body.touched = sim.frame.step, 0
        sim.energy[sim.free[s]] = energy(sim, sim.free[s])
    for k in range(sim.counts.pairs):
        sim.pairs[k].encounters = 0
    for s in range(len(sim.free)):
        if is_label(sim, sim.free[s]):
            collisions += begin_substep(sim, sim.free[s], 0.0, max_collisions)
    while True:
        label = next_to_end(sim)
        end = sim.bodies[label].substep_end if label >= 0 else sim.frame.step
        if sim.counts.queued > 0 and sim.pairs[sim.queue[0]].due < end:
            collisions += pass_impact(sim, sim.queue[0], max_collisions)
        elif label >= 0:
            end_substep(sim, label, end)
            collisions += begin_substep(sim, label, end, max_collisions)
        else:
            break
    for s in range(len(sim.free)):
        if is_label(sim, sim.free[s]):
            end_substep(sim, sim.free[s], sim.frame.step)
    return collisions
