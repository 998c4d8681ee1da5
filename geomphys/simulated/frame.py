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
    norm,
    quat_mul,
    quat_rotate,
    sub,
)
from geomphys.results import FLAG_QUARANTINED
from geomphys.scene.arrays import Floats
from geomphys.simulated.contact_points import clear_impulses
from geomphys.simulated.integrate import angular_momentum
from geomphys.simulated.motion import refresh
from geomphys.simulated.sleeping import REST_TIME, note_rest
from geomphys.simulated.state import ASLEEP, AWAKE, BROKEN, Motion, Simulation, is_coupled


@kernel
def set_pose_of(m: Motion, pose: Floats) -> None:
    """Set reference point and orientation of a simulated body; `pose` (7,) is that of its origin."""
    q = quat_from(pose, 3)
    p = add(vec_from(pose, 0), quat_rotate(q, vec_of(m.centre)))
    m.travelled += norm(sub(p, vec_of(m.position))) + 2.0 * m.reach
    set_vec(m.position, p)
    set_quat(m.orientation, q)


@kernel
def set_free(sim: Simulation, body: int, pose: Floats) -> None:
    """Motion of a simulated body at the start of a step, from its `pose` (7,) and the reported velocity.

    Position and angular momentum are those of the step before unless the caller changed the pose or the angular velocity.
    """
    m, reported = sim.motion[body], sim.reported[body]
    same = True
    for i in range(7):
        same = same and pose[i] == m.reported_pose[i]
    if not same:
        set_pose_of(m, pose)
        for i in range(7):
            m.reported_pose[i] = pose[i]
    m.base_time = 0.0
    set_vec(m.velocity, vec_from(reported, 0))
    set_vec(m.acceleration, vec_of(sim.gravity))
    set_vec(m.torque, (0.0, 0.0, 0.0))
    omega = vec_from(reported, 3)
    if omega != vec_of(m.reported_angular_velocity) or omega == (0.0, 0.0, 0.0):
        q = quat_mul(quat_of(m.orientation), quat_of(m.principal))
        set_vec(m.angular_momentum, angular_momentum(q, vec_of(m.inertia), omega))
    refresh(m)
    sim.bodies[body].fresh = 0 if same else 1
    still = same and omega == (0.0, 0.0, 0.0) and vec_from(reported, 0) == (0.0, 0.0, 0.0)
    if not still and m.quiet_time >= REST_TIME:
        m.quiet_time = 0.0
    if not same or (sim.bodies[body].activation == ASLEEP and not still):
        m.slow_time = 0.0


@kernel
def begin(sim: Simulation, goes_on: bool) -> None:
    """Set up the motions of simulated bodies, and clear what was summed in the frame, unless it `goes_on`."""
    for body in range(len(sim.bodies)):
        sim.bodies[body].changed = 0
    sim.counts.changed = sim.counts.concerned = 0
    for s in range(len(sim.free)):
        body = sim.bodies[sim.free[s]]
        set_free(sim, sim.free[s], sim.start[sim.free[s]])
        if body.activation != ASLEEP:
            body.activation = AWAKE
        if not goes_on:
            body.all_moments = body.collisions = body.bound = 0
    sim.frame.elapsed = sim.frame.elapsed + sim.frame.step if goes_on else 0.0
    sim.frame.begun, sim.frame.step = 0.0, sim.frame.dt
    sim.counts.contacts = 0
    sim.counts.lost = 0
    for k in range(sim.counts.pairs):
        sim.pairs[k].disabled = 0
        if not goes_on:
            for m in range(4):
                clear_impulses(sim.slots[k, m])


@kernel
def go_on(sim: Simulation, h: float) -> int:
    """End a step of `h` seconds and begin another one within the frame; returns as `finish_body`."""
    flags = 0
    for s in range(len(sim.free)):
        body = sim.free[s]
        if is_coupled(sim, body):  # they have been moved to the frame's end
            sim.motion[body].base_time = sim.motion[body].base_time - h
        else:
            flags |= finish_body(sim, body)
            set_free(sim, body, sim.end[body])
    sim.frame.begun += h
    sim.frame.elapsed += h
    return flags


@kernel
def put_back(sim: Simulation, body: int) -> None:
    """Put a simulated body back to its pose at the frame's start, at rest; the pose it had is saved."""
    m = sim.motion[body]
    set_vec_from(m.saved_pose, 0, vec_of(m.position))
    set_quat_from(m.saved_pose, 3, quat_of(m.orientation))
    set_pose_of(m, sim.start[body])
    set_vec(m.velocity, (0.0, 0.0, 0.0))
    set_vec(m.angular_momentum, (0.0, 0.0, 0.0))
    refresh(m)


@kernel
def undo_put_back(sim: Simulation, body: int) -> None:
    """Return a body to the pose saved by `put_back`; it stays at rest."""
    m = sim.motion[body]
    m.travelled += norm(sub(vec_from(m.saved_pose, 0), vec_of(m.position))) + 2.0 * m.reach
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
def finish_body(sim: Simulation, body: int) -> int:
    """Write the pose and velocity of a simulated body at the step's end.

    One that is not finite goes back to where it was, at rest: returns `FLAG_QUARANTINED` then, else 0.
    """
    m, reported, pose = sim.motion[body], sim.reported[body], sim.end[body]
    q = quat_of(m.orientation)
    set_vec_from(pose, 0, sub(vec_of(m.position), quat_rotate(q, vec_of(m.centre))))
    set_quat_from(pose, 3, q)
    set_vec_from(reported, 0, vec_of(m.velocity))
    set_vec_from(reported, 3, vec_of(m.angular_velocity))
    broken = not (is_finite(pose) and is_finite(reported))
    if broken or sim.bodies[body].activation == ASLEEP:
        for i in range(7):
            pose[i] = m.reported_pose[i]
        for i in range(6):
            reported[i] = 0.0
    if broken:
        set_pose_of(m, pose)
        sim.bodies[body].bound = BROKEN
    note_rest(sim, body, reported)
    set_vec(m.reported_angular_velocity, vec_from(reported, 3))
    for i in range(7):
        m.reported_pose[i] = pose[i]
    return FLAG_QUARANTINED if broken else 0


@kernel
def finish(sim: Simulation) -> int:
    """Write the end poses and velocities of the simulated bodies; returns as `finish_body`."""
    flags = 0
    for s in range(len(sim.free)):
        flags |= finish_body(sim, sim.free[s])
    return flags
