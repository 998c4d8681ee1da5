"""One frame of the simulated loop: bodies move to their next impact, it is resolved, they move on.

A frame is divided in steps of at most `STEP`, at any frame rate: contact forces are constant over a step, and pairs that may
touch are searched step by step. Within a step the queue has the time of impact of each pair; the earliest is resolved, the
bodies that it concerns, and those that may touch them, get new forces and motions, and their pairs are queued again.
"""

from __future__ import annotations

import math

from geomphys.jit.kernel import kernel, noinline
from geomphys.numerics.row_vectors import vec_of
from geomphys.numerics.vec3 import norm
from geomphys.results import FLAG_IMPACT_BOUND, FLAG_TABLE_FULL
from geomphys.simulated.collisions import resolve
from geomphys.simulated.contact_points import add_contacts
from geomphys.simulated.energy import note_energies, note_new_energies, take_excess
from geomphys.simulated.frame import begin, finish, mark_all, put_back, undo_put_back
from geomphys.simulated.impact_queue import empty_queue, put, take_out
from geomphys.simulated.impulse_accumulation import drop_contacts
from geomphys.simulated.islands import concerns_changed, mark_connected
from geomphys.simulated.motion import move_bases
from geomphys.simulated.overlap_clearing import clear_overlaps
from geomphys.simulated.pairs import any_beyond_range, find_pairs
from geomphys.simulated.position_projection import TOUCHING, any_short, project_positions
from geomphys.simulated.resting_contact import FEW_SWEEPS, SWEEPS, solve_resting_contact
from geomphys.simulated.sleeping import wake
from geomphys.simulated.state import AWAKE, Simulation, has_changed, is_disabled, is_simulated
from geomphys.simulated.time_of_impact import first_touch, measure_pair

STEP = 1.0 / 240.0  # s: contact forces are constant for no longer
STEP_TOLERANCE = 0.01  # fraction of a step by which one may be longer: times of messages are rounded
ROTATION_PER_STEP = 0.1  # rad: a body that may touch something rotates no further in a step
MIN_STEP = 1e-6  # s
MIN_RESTITUTION_THRESHOLD = 1e-3  # m/s: also where there is no gravity, slower approaches do not bounce
TOUCH = 5.0  # gaps: clearance that counts as touching
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
    first = sim.counts.contacts
    for k in range(sim.counts.pairs):
        if has_changed(sim, sim.pairs[k].body[0]):
            add_contacts(sim, k, t)
    least = math.inf
    for k in range(first, sim.counts.contacts):
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
        for k in range(sim.counts.pairs):
            if concerns_changed(sim, k):
                sim.pairs[k].measured_at = -1.0
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
    for k in range(sim.counts.pairs):
        p = sim.pairs[k]
        if not concerns_changed(sim, k):
            continue
        due = math.inf
        if p.encounters >= MAX_ENCOUNTERS and not is_simulated(sim, p.body[1]) and sim.bodies[p.body[1]].moves == 1:
            p.disabled = 1
        if not is_disabled(sim, k):
            target, slack = gap, 0.25 * gap
            if p.resting == 1:
                # contact forces act on it: only their error counts
                if sim.pairs[k].measured_at != t:
                    measure_pair(sim, k, t)
                target, slack = min(0.0, sim.pairs[k].distance) - allowed_approach(sim, k) * gap, 0.5 * gap
            due = first_touch(sim, k, t, t1, target, slack)
        if due < t1:
            put(sim, k, due)
        else:
            take_out(sim, k)


@kernel
def longest_step(sim: Simulation, left: float) -> float:
    """Longest step for the bodies that may touch something [s]."""
    h = left
    for k in range(sim.counts.pairs):
        p = sim.pairs[k]
        for side in range(2):
            body = p.body[side]
            if is_simulated(sim, body) and sim.arm[p.piece[side]] > 0.0:
                omega = norm(vec_of(sim.motion[body].angular_velocity))
                if omega * h > ROTATION_PER_STEP:
                    h = max(MIN_STEP, ROTATION_PER_STEP / omega)
    return h


@kernel
def refresh_pairs(sim: Simulation, t: float, until: float) -> None:
    """Search again for pairs that may touch between times `t` and `until` of the frame; all bodies then count as changed."""
    mark_all(sim)
    move_bases(sim, t)
    drop_contacts(sim, t)
    find_pairs(sim, t, until)
    wake(sim, False)
    mark_all(sim)
    move_bases(sim, t)
    empty_queue(sim)


@noinline
def advance_step(sim: Simulation, t0: float, t1: float, max_collisions: int, max_events: int) -> tuple[int, int, bool]:
    """Move the simulated bodies from time `t0` of the frame to `t1`, from impact to impact.

    Returns the number of collisions resolved, the number of events (moments at which there was an impact), and whether a
    bound was hit; if it was that on events, the bodies are where the last one left them.
    """
    collisions, events, bounded = 0, 0, False
    t = t0
    mark_all(sim)
    empty_queue(sim)
    note_energies(sim)
    while True:
        move_bases(sim, t)
        project_out_of_overlap(sim, t)
        if t == t0:
            note_new_energies(sim)
        done, full = resolve(sim, t, max_collisions - collisions)
        collisions += done
        bounded = bounded or full
        solve_resting_contact(sim, t, t1 - t, SWEEPS if events == 0 else FEW_SWEEPS)
        if any_beyond_range(sim, t):
            refresh_pairs(sim, t, sim.frame.span_end)
            note_energies(sim)  # islands have changed
            continue
        queue_pairs(sim, t, t1)
        if sim.counts.queued == 0:
            break
        pair = sim.queue[0]
        t = sim.pairs[pair].due
        sim.pairs[pair].encounters = sim.pairs[pair].encounters + 1
        mark_connected(sim, pair, t)
        events += 1
        if events > max_events:
            mark_all(sim)
            move_bases(sim, t)
            return collisions, events, True
    mark_all(sim)
    move_bases(sim, t1)
    clear_overlaps(sim, t1, AWAKE)
    take_excess(sim)
    return collisions, events, bounded


@kernel
def begin_step(sim: Simulation, t: float, t1: float, steps: int) -> None:
    """Begin the step of the frame from `t` to `t1` as if it were a frame of its own: later pairs are not searched."""
    if steps > 1:
        refresh_pairs(sim, t, t1)
    for k in range(sim.counts.pairs):
        sim.pairs[k].encounters = 0
    if t > 0.0:
        for s in range(len(sim.free)):
            sim.bodies[sim.free[s]].fresh = 0


@kernel
def advance_frame(sim: Simulation, max_collisions: int) -> tuple[int, int, float]:
    """Move the simulated bodies through the frame, in equal steps, which are divided where bodies rotate fast.

    Returns the number of collisions, 0 or `FLAG_IMPACT_BOUND`, and the time of the frame that the bodies have reached.
    """
    dt = sim.frame.dt
    steps = max(1, math.ceil(dt / STEP - STEP_TOLERANCE))
    max_events = 20 * steps + 2 * max_collisions
    if sim.counts.pairs == 0:
        steps = 1
    t, collisions, events, flags = 0.0, 0, 0, 0
    for step in range(steps):
        if events > max_events:
            break
        end = dt * (step + 1) / steps
        begin_step(sim, t, end, steps)
        while t < end and events <= max_events:
            h = longest_step(sim, end - t)
            t1 = t + h if h < end - t else end
            done, more, bounded = advance_step(sim, t, t1, max_collisions - collisions, max_events - events)
            collisions += done
            events += more
            if bounded:
                flags = FLAG_IMPACT_BOUND
            t = t1
    return collisions, flags, t


@kernel
def is_put_back(sim: Simulation, body: int) -> bool:
    """Whether the island of a body goes back to its poses at the frame's start."""
    return sim.bodies[sim.bodies[body].island].island_put_back == 1


@kernel
def enable_pairs(sim: Simulation) -> bool:
    """Enable all pairs again; returns whether any was disabled."""
    any_disabled = False
    for k in range(sim.counts.pairs):
        any_disabled = any_disabled or is_disabled(sim, k)
        sim.pairs[k].disabled = 0
    return any_disabled


@noinline
def project_or_put_back(sim: Simulation) -> None:
    """Move bodies that overlap one of prescribed motion at the frame's end out of it, or back to their poses at its start.

    A body pressed from two sides cannot be free where it is; at its pose at the frame's start the driven bodies left it clear.
    Islands that are still deep in something are put back, all of them or, if that leaves less clearance, none.
    """
    dt, deep = sim.frame.dt, -DEEP * sim.frame.gap
    mark_all(sim)
    for s in range(len(sim.free)):
        sim.motion[sim.free[s]].base_time = dt
        sim.bodies[sim.free[s]].island_put_back = 0
    least = project_out_of_overlap(sim, dt)
    if least >= deep:
        return
    for k in range(sim.counts.contacts):
        if sim.contacts[k].clearance < deep:
            sim.bodies[sim.bodies[sim.contacts[k].a].island].island_put_back = 1
    for s in range(len(sim.free)):
        if is_put_back(sim, sim.free[s]):
            put_back(sim, sim.free[s])
    if build_contacts(sim, dt) < least:
        for s in range(len(sim.free)):
            if is_put_back(sim, sim.free[s]):
                undo_put_back(sim, sim.free[s])


@noinline
def begin_frame(sim: Simulation, dt: float, gap: float, goes_on: bool) -> bool:
    """Begin a frame, or a further part of one: find pairs that may touch, and bodies that are awake.

    Parameters
    ----------
    sim
        What `make_simulation` made of the scene. Read: `start` and `end`, (B, 7) world poses of all bodies at the
        frame's start and end, between which driven bodies move at constant velocity; `reported`, (B, 6) world velocity of
        the centre of mass [m/s] and angular velocity [rad/s] of simulated bodies; `frames`, (P, 12), world_from_piece of
        still pieces.
    dt
        s, above 0.
    gap
        m; clearance kept between surfaces in contact.
    goes_on
        Whether this is a further part of the frame: the impulses of its contacts are added to those so far.

    Returns
    -------
    bool
        Whether any simulated body is awake.
    """
    f = sim.frame
    f.dt, f.gap, f.touch = dt, gap, TOUCH * gap
    f.weight = norm(vec_of(sim.gravity))
    f.restitution_threshold = max(MIN_RESTITUTION_THRESHOLD, 2.0 * f.weight * STEP)
    begin(sim, goes_on)
    find_pairs(sim, 0.0, dt)
    return wake(sim, True)


@noinline
def end_frame(sim: Simulation, max_collisions: int, any_awake: bool) -> tuple[int, int]:
    """Move the simulated bodies that are AWAKE through the frame that `begin_frame` began, and end it.

    Parameters
    ----------
    sim
        Written: the end poses and velocities of simulated bodies; `frames` of moving pieces, at the time last posed.
    max_collisions
        Collisions resolved in the frame at most; beyond, approaching bodies are only stopped.
    any_awake
        What `begin_frame` returned.

    Returns
    -------
    tuple
        Number of collisions resolved; bits `FLAG_IMPACT_BOUND`, `FLAG_TABLE_FULL` (of pairs or contact points) and
        `FLAG_QUARANTINED`.
    """
    collisions, flags = 0, 0
    if any_awake and sim.counts.lost == 0:
        collisions, flags, t = advance_frame(sim, max_collisions)
        mark_all(sim)
        drop_contacts(sim, t)
        if enable_pairs(sim) or flags != 0:
            project_or_put_back(sim)
    if sim.counts.lost > 0:
        # some pairs or contact points did not fit: nothing may move past them
        flags = FLAG_TABLE_FULL
        for s in range(len(sim.free)):
            put_back(sim, sim.free[s])
    return collisions, flags | finish(sim)
