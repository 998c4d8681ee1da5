"""One frame of the simulated loop: bodies move to their next impact, it is resolved, they move on.

A frame is divided in steps of at most `STEP`, at any frame rate: contact forces are constant over a step, and pairs that may
touch are searched step by step. Islands, of bodies that may touch, have substeps, bounds and solves of their own.
"""

from __future__ import annotations

import math

from geomphys.jit.kernel import kernel, noinline
from geomphys.numerics.row_vectors import vec_of
from geomphys.numerics.vec3 import norm
from geomphys.results import FLAG_IMPACT_BOUND, FLAG_TABLE_FULL
from geomphys.simulated.frame import begin, finish, go_on, put_back, undo_put_back
from geomphys.simulated.islands import is_label, mark_island
from geomphys.simulated.pairs import find_pairs
from geomphys.simulated.sleeping import sum_sleeping_forces, wake
from geomphys.simulated.state import OUT_OF_COLLISIONS, STOPPED, Simulation, is_disabled
from geomphys.simulated.substeps import DEEP, advance_step, build_contacts, project_out_of_overlap

STEP = 1.0 / 240.0  # s: contact forces are constant for no longer
STEP_TOLERANCE = 0.01  # fraction of a step by which one may be longer: times of messages are rounded
MAX_SUBSTEPS = 16  # substeps of a frame where driven and simulated bodies may touch
MIN_RESTITUTION_THRESHOLD = 1e-3  # m/s: also where there is no gravity, slower approaches do not bounce
TOUCH = 5.0  # gaps: clearance that counts as touching


@kernel
def substep_count(dt: float) -> int:
    """Number of equal steps of a frame of `dt` seconds: none is longer than `STEP`, and they are those of its substeps.

    The coupled step divides a frame in up to `MAX_SUBSTEPS` substeps, where driven and simulated bodies may touch.
    """
    count = max(1, math.ceil(dt / STEP - STEP_TOLERANCE))
    if count <= MAX_SUBSTEPS:
        return count
    return MAX_SUBSTEPS * math.ceil(dt / MAX_SUBSTEPS / STEP - STEP_TOLERANCE)


@kernel
def advance_frame(sim: Simulation, max_collisions: int) -> tuple[int, int]:
    """Move the simulated bodies through the frame, in equal steps, as if each were a frame of its own.

    Returns the number of collisions and flags.
    """
    steps, collisions, flags = substep_count(sim.frame.dt), 0, 0
    h = sim.frame.dt / steps
    for step in range(steps):
        sim.frame.step = h
        if step > 0:
            flags |= go_on(sim, h)
        if steps > 1:
            find_pairs(sim, h)
            wake(sim, True)
        sum_sleeping_forces(sim, h)
        collisions += advance_step(sim, max_collisions)
    for s in range(len(sim.free)):
        if is_label(sim, sim.free[s]):
            mark_island(sim, sim.free[s])
            bounded = sim.counts.changed > 0 and is_bounded(sim, sim.changed[0])
            if bounded:
                flags |= FLAG_IMPACT_BOUND
            if enable_pairs(sim) or bounded:
                project_or_put_back(sim)
    return collisions, flags


@kernel
def is_bounded(sim: Simulation, body: int) -> bool:
    """Whether the island of a body has met a bound on its work in this frame."""
    return bool(sim.bodies[body].bound in (OUT_OF_COLLISIONS, STOPPED))


@kernel
def enable_pairs(sim: Simulation) -> bool:
    """Enable the pairs of changed bodies again; returns whether any was disabled."""
    any_disabled = False
    for i in range(sim.counts.concerned):
        any_disabled = any_disabled or is_disabled(sim, sim.concerned[i])
        sim.pairs[sim.concerned[i]].disabled = 0
    return any_disabled


@noinline
def project_or_put_back(sim: Simulation) -> None:
    """Move the changed bodies, an island's, that overlap one of prescribed motion at the frame's end out of it, or put them back.

    A body pressed from two sides cannot be free where it is; at its pose at the frame's start the driven bodies left it clear.
    An island that is still deep in something is put back unless that leaves less clearance.
    """
    t, deep = sim.frame.step, -DEEP * sim.frame.gap
    for s in range(sim.counts.changed):
        sim.motion[sim.changed[s]].base_time = t
    least = project_out_of_overlap(sim, t)
    if least >= deep:
        return
    for s in range(sim.counts.changed):
        put_back(sim, sim.changed[s])
    if build_contacts(sim, t) < least:
        for s in range(sim.counts.changed):
            undo_put_back(sim, sim.changed[s])


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
    find_pairs(sim, dt)
    return wake(sim, True)


@noinline
def end_frame(sim: Simulation, max_collisions: int, any_awake: bool) -> tuple[int, int]:
    """Move the simulated bodies that are AWAKE through the frame that `begin_frame` began, and end it.

    Parameters
    ----------
    sim
        Written: the end poses and velocities of simulated bodies; `frames` of moving pieces, at the time last posed.
    max_collisions
        Collisions of an island resolved in the frame at most; beyond, approaching bodies are only stopped.
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
        collisions, flags = advance_frame(sim, max_collisions)
    else:
        sum_sleeping_forces(sim, sim.frame.dt)
    if sim.counts.lost > 0:
        # some pairs or contact points did not fit: nothing may move past them
        flags = FLAG_TABLE_FULL
        for s in range(len(sim.free)):
            put_back(sim, sim.free[s])
    return collisions, flags | finish(sim)
