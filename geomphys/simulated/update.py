"""One frame of the simulated loop: bodies move to their next impact, it is resolved, they move on.

A frame is divided in steps of at most `STEP`, at any frame rate: contact forces are constant over a step, and pairs that may
touch are searched step by step. Within a step the queue has the time of impact of each pair; the earliest is resolved, the
bodies that it concerns, and those that may touch them, get new forces and motions, and their pairs are queued again.
"""

from __future__ import annotations

import math

from geomphys.collision.penetration import separation
from geomphys.jit.kernel import kernel, outlined
from geomphys.numerics.row_vectors import add_vec, set_vec, vec_of
from geomphys.numerics.vec3 import norm
from geomphys.scene.arrays import DRIVEN
from geomphys.simulated.collisions import resolve
from geomphys.simulated.contact_points import add_rows, clear_impulse
from geomphys.simulated.energy import note_energies, note_new_energies, take_excess
from geomphys.simulated.frame import QUARANTINED, begin, finish, mark_all, put_back, undo_put_back
from geomphys.simulated.impact_queue import empty_queue, put, take_out
from geomphys.simulated.impulse_accumulation import drop_rows
from geomphys.simulated.islands import concerns_changed, mark_connected
from geomphys.simulated.motion import move_bases
from geomphys.simulated.pairs import any_beyond_range, find_pairs
from geomphys.simulated.position_projection import LEFT, TOUCHING, any_short, project_positions
from geomphys.simulated.resting_contact import FEW_SWEEPS, SWEEPS, hold
from geomphys.simulated.sleeping import wake
from geomphys.simulated.state import Simulation, has_changed, has_yielded, is_simulated
from geomphys.simulated.time_of_impact import first_touch, measure_pair, pose_pair

STEP = 1.0 / 240.0  # s: contact forces are constant for no longer
STEP_TOLERANCE = 0.01  # share of a step by which one may be longer: times of messages are rounded
ROTATION_PER_STEP = 0.1  # rad: a body that may touch something rotates no further in a step
LEAST_STEP = 1e-6  # s
LEAST_THRESHOLD = 1e-3  # m/s: also where there is no gravity, slower approaches do not bounce
TOUCH = 5.0  # gaps: clearance that counts as touching
MAX_ENCOUNTERS = 40  # impacts of a pair in a step, if one has prescribed motion: beyond, the pair is given up
MISSED = 3.0  # gaps: how far surfaces in resting contact may approach within a step if bodies are fast, ...
SLOW = 0.05  # m/s: ... and by one if they are slow: separating them again takes more energy than they have
PROJECTION_ROUNDS = 20
CLEARING_ROUNDS = 5

__all__ = ["IMPACT_BOUND", "QUARANTINED", "simulate"]

IMPACT_BOUND = 32
"""A bound was hit: of collisions, of impacts, or the capacity for pairs and contact points."""


@kernel
def lay_rows(sim: Simulation, t: float) -> float:
    """Find the contact points of changed bodies at time `t`. Returns the least clearance among them [m]."""
    drop_rows(sim, t)
    first = sim.counts.rows
    for k in range(sim.counts.pairs):
        if has_changed(sim, sim.pairs[k].body[0]):
            add_rows(sim, k, t)
    least = math.inf
    for k in range(first, sim.counts.rows):
        least = min(least, sim.rows[k].clearance)
    return least


@outlined
def part(sim: Simulation, t: float) -> float:
    """Contact points of the changed bodies at time `t`, after position projection.

    Returns the least clearance that is left [m], to first order where it is small.
    """
    least = lay_rows(sim, t)
    for _ in range(PROJECTION_ROUNDS):
        if not any_short(sim):
            break
        near = project_positions(sim)
        for k in range(sim.counts.pairs):
            if concerns_changed(sim, k):
                sim.pairs[k].seen_at = -1.0
        if least >= -3.0 * sim.frame.gap:
            return near
        least = lay_rows(sim, t)
    return least


@kernel
def missed(sim: Simulation, pair: int) -> float:
    """How far the surfaces of a pair in resting contact may approach within a step, in gaps."""
    for side in range(2):
        m = sim.motion[sim.pairs[pair].body[side]]
        if norm(vec_of(m.velocity)) + norm(vec_of(m.angular_velocity)) * m.reach > SLOW:
            return MISSED
    return 1.0


@kernel
def queue_pairs(sim: Simulation, t: float, t1: float) -> None:
    """Find the times of impact before `t1` of the pairs of changed bodies and queue them."""
    gap = sim.frame.gap
    for k in range(sim.counts.pairs):
        p = sim.pairs[k]
        if not concerns_changed(sim, k):
            continue
        due = math.inf
        if p.encounters >= MAX_ENCOUNTERS and not is_simulated(sim, p.body[1]):
            p.yielded = sim.bodies[p.body[1]].moves
        if not has_yielded(sim, k):
            target, slack = gap, 0.25 * gap
            if p.resting == 1:
                # contact forces act on it: only their error counts
                if sim.pairs[k].seen_at != t:
                    measure_pair(sim, k, t)
                target, slack = min(0.0, sim.pairs[k].distance) - missed(sim, k) * gap, 0.5 * gap
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
                    h = max(LEAST_STEP, ROTATION_PER_STEP / omega)
    return h


@kernel
def list_pairs_again(sim: Simulation, t: float, until: float) -> None:
    """Search again for pairs that may touch between times `t` and `until` of the frame; all bodies then count as changed."""
    mark_all(sim)
    move_bases(sim, t)
    drop_rows(sim, t)
    find_pairs(sim, t, until)
    wake(sim, False)
    mark_all(sim)
    move_bases(sim, t)
    empty_queue(sim)


@kernel
def depth_inside(sim: Simulation, k: int, t: float) -> float:
    """Depth of the changed body of pair k in a body that is not driven, at time `t` of the frame [m]; below 0: none."""
    p = sim.pairs[k]
    if not has_changed(sim, p.body[0]) or p.point_count == 0 or sim.bodies[p.body[1]].role == DRIVEN:
        return -math.inf
    pose_pair(sim, k, t)
    found = separation(sim.pieces, sim.frames, p.piece[0], p.piece[1], 0.0, vec_of(p.axis), sim.scratch)
    set_vec(p.axis, found[1])
    return -float(found[0])


@kernel
def clear_together(sim: Simulation, t: float, allowed: float) -> None:
    """Move changed bodies out of overlap by their contact points, and clear of driven links if that is possible."""
    f = sim.frame
    for k in range(sim.counts.pairs):
        if has_changed(sim, sim.pairs[k].body[0]):
            add_rows(sim, k, t)
    f.tolerance = allowed
    project_positions(sim)
    f.tolerance = TOUCHING * f.gap
    for k in range(sim.counts.rows):
        clear_impulse(sim.rows[k])
    sim.counts.rows = 0


@outlined
def clear_overlaps(sim: Simulation, t: float, awake: int) -> None:
    """Move the bodies of one kind of `awake` out of overlap with what is not driven, at time `t` of the frame.

    Removes the error of unfinished sweeps and of the step, micrometres; velocities do not change. First by all contact
    points, then pair by pair: contact points of a curved surface need not be its deepest. Bodies that are not solved together
    with driven trees (`awake` 1) may touch, as the scene file placed them. Driven links, which must be posed at `t`, are moved
    afterwards out of what moved into them.
    """
    allowed = (LEFT if awake == 2 else TOUCHING) * sim.frame.gap
    for s in range(len(sim.free)):
        sim.bodies[sim.free[s]].changed = 1 if sim.bodies[sim.free[s]].awake == awake else 0
    for clearing in range(CLEARING_ROUNDS):
        deepest = -math.inf
        for k in range(sim.counts.pairs):
            depth = depth_inside(sim, k, t)
            deepest = max(deepest, depth)
            if clearing > 0 and depth > allowed:
                p = sim.pairs[k]
                a, b = sim.motion[p.body[0]], sim.motion[p.body[1]]
                share = a.inverse_mass / (a.inverse_mass + b.inverse_mass)
                add_vec(a.position, vec_of(p.axis), share * (depth + allowed))
                if is_simulated(sim, p.body[1]):
                    add_vec(b.position, vec_of(p.axis), (share - 1.0) * (depth + allowed))
        if deepest <= allowed:
            return
        if clearing == 0:
            drop_rows(sim, t)
            clear_together(sim, t, allowed)


@outlined
def advance(sim: Simulation, t0: float, t1: float, budget: int, max_stops: int) -> tuple[int, int, bool]:
    """Move the simulated bodies from time `t0` of the frame to `t1`, from impact to impact.

    Returns the number of collisions resolved, the number of impacts, and whether a bound was hit; if it was that on
    impacts, the bodies are where the last one left them.
    """
    impacts, stops, bound = 0, 0, False
    t = t0
    mark_all(sim)
    empty_queue(sim)
    note_energies(sim)
    while True:
        move_bases(sim, t)
        part(sim, t)
        if t == t0:
            note_new_energies(sim)
        done, full = resolve(sim, t, budget - impacts)
        impacts += done
        bound = bound or full
        hold(sim, t, t1 - t, SWEEPS if stops == 0 else FEW_SWEEPS)
        if any_beyond_range(sim, t):
            list_pairs_again(sim, t, sim.frame.span_end)
            note_energies(sim)  # islands have changed
            continue
        queue_pairs(sim, t, t1)
        if sim.counts.queued == 0:
            break
        pair = sim.queue[0]
        t = sim.pairs[pair].due
        sim.pairs[pair].encounters = sim.pairs[pair].encounters + 1
        mark_connected(sim, pair, t)
        stops += 1
        if stops > max_stops:
            mark_all(sim)
            move_bases(sim, t)
            return impacts, stops, True
    mark_all(sim)
    move_bases(sim, t1)
    clear_overlaps(sim, t1, 1)
    take_excess(sim)
    return impacts, stops, bound


@kernel
def begin_step(sim: Simulation, t: float, t1: float, steps: int) -> None:
    """Begin the step of the frame from `t` to `t1` as if it were a frame of its own: later pairs are not searched."""
    if steps > 1:
        list_pairs_again(sim, t, t1)
    for k in range(sim.counts.pairs):
        sim.pairs[k].encounters = 0
    if t > 0.0:
        for s in range(len(sim.free)):
            sim.bodies[sim.free[s]].fresh = 0


@kernel
def play(sim: Simulation, max_impacts: int) -> tuple[int, int, float]:
    """Move the simulated bodies through the frame.

    Returns the number of collisions, 0 or `IMPACT_BOUND`, and the time of the frame that the bodies have reached.
    """
    dt = sim.frame.dt
    steps = max(1, math.ceil(dt / STEP - STEP_TOLERANCE))
    max_stops = 20 * steps + 2 * max_impacts
    t, step, looked, impacts, stops, flags = 0.0, 0, 0, 0, 0, 0
    if sim.counts.pairs == 0:
        steps = 1
    while step < steps and stops <= max_stops:
        t1 = dt * (step + 1) / steps
        if looked == step:
            looked += 1
            begin_step(sim, t, t1, steps)
        short = longest_step(sim, t1 - t)
        if short < t1 - t:
            t1 = t + short
        else:
            step += 1
        done, halted, full = advance(sim, t, t1, max_impacts - impacts, max_stops - stops)
        impacts += done
        stops += halted
        if full:
            flags = IMPACT_BOUND
        t = t1
    return impacts, flags, t


@outlined
def part_at_end(sim: Simulation, bounded: bool) -> None:
    """Move bodies that overlap one of prescribed motion out of it, or else back to their pose at the frame's start.

    A body pressed from two sides cannot be free where it is; at its pose at the frame's start the driven bodies left it clear.
    """
    left = bounded
    for k in range(sim.counts.pairs):
        left = left or has_yielded(sim, k)
        sim.pairs[k].yielded = 0
    if not left:
        return
    dt, margin = sim.frame.dt, -3.0 * sim.frame.gap
    mark_all(sim)
    for s in range(len(sim.free)):
        sim.motion[sim.free[s]].base_time = dt
    before = part(sim, dt)
    if before >= margin:
        return
    for k in range(sim.counts.rows):
        if sim.rows[k].clearance < margin:
            sim.bodies[sim.bodies[sim.rows[k].a].island].island_awake = 2
    for s in range(len(sim.free)):
        body = sim.free[s]
        if sim.bodies[sim.bodies[body].island].island_awake == 2:
            put_back(sim, body)
    if lay_rows(sim, dt) < before:
        for s in range(len(sim.free)):
            body = sim.free[s]
            if sim.bodies[sim.bodies[body].island].island_awake == 2:
                undo_put_back(sim, body)


@kernel
def simulate(sim: Simulation, dt: float, max_impacts: int, gap: float, goes_on: bool) -> tuple[int, int]:
    """Move the simulated bodies through one frame, or a part of one.

    Parameters
    ----------
    sim
        What `make_simulation` made of the scene. Read: `start` and `end`, (B, 7) world poses of all bodies at the
        frame's start and end, between which driven bodies move at constant velocity; `reported`, (B, 6) world velocity of
        the centre of mass [m/s] and angular velocity [rad/s] of simulated bodies; `frames`, (P, 12), world_from_piece of
        still pieces. Written: the end poses and velocities of simulated bodies; `frames` of moving pieces, at
        the time last posed.
    dt
        s, above 0.
    max_impacts
        Collisions resolved in the frame at most; beyond, approaching bodies are only stopped.
    gap
        m; clearance kept between surfaces in contact.
    goes_on
        Whether this is a further part of the frame: the impulses of its contacts are added to those so far.

    Returns
    -------
    tuple
        Number of collisions resolved; bits `IMPACT_BOUND` and `QUARANTINED`.
    """
    if len(sim.free) == 0:
        return 0, 0
    awake = begin_frame(sim, dt, gap, goes_on)
    return end_frame(sim, max_impacts, awake)


@outlined
def begin_frame(sim: Simulation, dt: float, gap: float, goes_on: bool) -> bool:
    """The first half of `simulate`: pairs that may touch, and bodies that are awake; returns whether any is."""
    f = sim.frame
    f.dt, f.gap, f.touch = dt, gap, TOUCH * gap
    f.weight = norm(vec_of(sim.gravity))
    f.tolerance = TOUCHING * gap
    f.threshold = max(LEAST_THRESHOLD, 2.0 * f.weight * STEP)
    begin(sim, goes_on)
    find_pairs(sim, 0.0, dt)
    return wake(sim, True)


@outlined
def end_frame(sim: Simulation, max_impacts: int, awake: bool) -> tuple[int, int]:
    """The second half of `simulate`: bodies that are `awake`, and not moved together with driven ones, move."""
    impacts, flags = 0, 0
    if awake and sim.counts.lost == 0:
        impacts, flags, t = play(sim, max_impacts)
        mark_all(sim)
        drop_rows(sim, t)
        part_at_end(sim, flags != 0)
    if sim.counts.lost > 0:
        # some pairs or contact points did not fit: nothing may move past them
        flags |= IMPACT_BOUND
        for s in range(len(sim.free)):
            put_back(sim, sim.free[s])
    return impacts, flags | finish(sim)
