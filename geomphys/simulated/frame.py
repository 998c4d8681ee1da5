"""Begins and ends a frame: converts the poses and velocities of the caller to motions, and back."""

from __future__ import annotations

import math

from geomphys.jit.kernel import kernel
from geomphys.numerics.row_vectors import (
    quat_from,
    quat_of,
    set_quat,
    set_quat_from,
    set_vec,
    set_vec_from,
    vec_from,
    vec_of,
)
from geomphys.numerics.vec3 import (
    add,
    quat_mul,
    quat_rotate,
    sub,
)
from geomphys.results import FLAG_QUARANTINED
from geomphys.scene.arrays import Floats
from geomphys.simulated.contact_points import clear_impulses
from geomphys.simulated.driven_paths import fit_paths
from geomphys.simulated.integrate import angular_momentum
from geomphys.simulated.motion import refresh
from geomphys.simulated.sleeping import REST_TIME, note_rest
from geomphys.simulated.state import ASLEEP, AWAKE, Simulation


@kernel
def set_free(sim: Simulation, body: int) -> None:
    """Motion of a simulated body at the frame's start, from its pose and the reported velocity.

    The angular momentum is that of the frame before unless the caller changed the angular velocity.
    """
    m, reported, start = sim.motion[body], sim.reported[body], sim.start[body]
    q = quat_from(start, 3)
    m.base_time = 0.0
    set_vec(m.position, add(vec_from(start, 0), quat_rotate(q, vec_of(m.centre))))
    set_quat(m.orientation, q)
    set_vec(m.velocity, vec_from(reported, 0))
    set_vec(m.acceleration, vec_of(sim.gravity))
    set_vec(m.torque, (0.0, 0.0, 0.0))
    omega = vec_from(reported, 3)
    if omega != vec_of(m.reported_angular_velocity) or omega == (0.0, 0.0, 0.0):
        set_vec(m.angular_momentum, angular_momentum(quat_mul(q, quat_of(m.principal)), vec_of(m.inertia), omega))
    refresh(m)
    same = True
    for i in range(7):
        same = same and start[i] == m.reported_pose[i]
    sim.bodies[body].fresh = 0 if same else 1
    still = same and omega == (0.0, 0.0, 0.0) and vec_from(reported, 0) == (0.0, 0.0, 0.0)
    if not still and m.quiet_time >= REST_TIME:
        m.quiet_time = 0.0
    if not same or (sim.bodies[body].activation == ASLEEP and not still):
        m.slow_time = 0.0


@kernel
def begin(sim: Simulation, goes_on: bool) -> None:
    """Set up the motions of simulated bodies, and clear the accumulated impulses, unless the frame `goes_on`."""
    for s in range(len(sim.free)):
        set_free(sim, sim.free[s])
    fit_paths(sim)
    sim.counts.contacts = 0
    sim.counts.lost = 0
    for k in range(sim.counts.pairs):
        sim.pairs[k].encounters = 0
        sim.pairs[k].disabled = 0
        if not goes_on:
            for m in range(4):
                clear_impulses(sim.slots[k, m])


@kernel
def mark_all(sim: Simulation) -> None:
    """Mark the simulated bodies that are awake in this loop, and no others, as changed."""
    for s in range(len(sim.free)):
        body = sim.bodies[sim.free[s]]
        body.changed = 1 if body.activation == AWAKE else 0


@kernel
def put_back(sim: Simulation, body: int) -> None:
    """Put a simulated body back to its pose at the frame's start, at rest; the pose it had is saved."""
    m = sim.motion[body]
    set_vec_from(m.saved_pose, 0, vec_of(m.position))
    set_quat_from(m.saved_pose, 3, quat_of(m.orientation))
    q = quat_from(sim.start[body], 3)
    set_vec(m.position, add(vec_from(sim.start[body], 0), quat_rotate(q, vec_of(m.centre))))
    set_quat(m.orientation, q)
    set_vec(m.velocity, (0.0, 0.0, 0.0))
    set_vec(m.angular_momentum, (0.0, 0.0, 0.0))
    refresh(m)


@kernel
def undo_put_back(sim: Simulation, body: int) -> None:
    """Return a body to the pose saved by `put_back`; it stays at rest."""
    m = sim.motion[body]
    set_vec(m.position, vec_from(m.saved_pose, 0))
    set_quat(m.orientation, quat_from(m.saved_pose, 3))
    refresh(m)


@kernel
def is_finite(row: Floats) -> bool:
    """Whether all numbers of a row are finite."""
    for i in range(len(row)):  # noqa: SIM110
        if not math.isfinite(row[i]):
            return False
    return True


@kernel
def finish(sim: Simulation) -> int:
    """Write the end poses and velocities of the simulated bodies.

    One that is not finite goes back to where it was, at rest; returns `FLAG_QUARANTINED` if there is one, else 0.
    """
    flags = 0
    for s in range(len(sim.free)):
        body = sim.free[s]
        m, reported = sim.motion[body], sim.reported[body]
        pose, before = sim.end[body], sim.start[body]
        q = quat_of(m.orientation)
        set_vec_from(pose, 0, sub(vec_of(m.position), quat_rotate(q, vec_of(m.centre))))
        set_quat_from(pose, 3, q)
        set_vec_from(reported, 0, vec_of(m.velocity))
        set_vec_from(reported, 3, vec_of(m.angular_velocity))
        broken = not (is_finite(pose) and is_finite(reported))
        if broken or sim.bodies[body].activation == ASLEEP:
            for i in range(7):
                pose[i] = before[i]
            for i in range(6):
                reported[i] = 0.0
        if broken:
            flags = FLAG_QUARANTINED
        note_rest(sim, body, reported)
        set_vec(m.reported_angular_velocity, vec_from(reported, 3))
        for i in range(7):
            m.reported_pose[i] = pose[i]
    return flags
