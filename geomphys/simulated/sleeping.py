"""Sleep: islands at rest without a moving body near are left out of the loop until that changes.

An island sleeps when all its bodies have been at rest for `REST_TIME`: no point of them has moved farther than
`REST_DISTANCE` from where it was, however it trembles; a drift that slow is invisible for an hour. Asleep, a body keeps its pose
bit for bit.
"""

from __future__ import annotations

import math

from geomphys.jit.kernel import kernel, noinline
from geomphys.numerics.row_vectors import add_vec, quat_of, set_quat_from, set_vec, set_vec_from, vec_from, vec_of
from geomphys.numerics.vec3 import norm, sub
from geomphys.scene.arrays import Floats
from geomphys.simulated.state import ASLEEP, AWAKE, Motion, Simulation, is_coupled, is_simulated

REST_TIME = 0.25  # s
REST_DISTANCE = 4e-9  # m
REST_SPEED = 1e-6  # m/s, of any point
REST_ACCELERATION = 1e-3  # m/s²
SLOW_SPEED = 5e-3  # m/s, of any point: a supported body that moves no faster for
SLOW_TIME = 1.0  # s is at rest too: this stands in for rolling resistance
SPEEDING_UP = 1e-3  # m/s: unless it has become faster by as much, as on a slope


@kernel
def is_quiet(m: Motion) -> bool:
    """Whether a simulated body has been at rest, or slow, for long enough to sleep; `m` is its record of `motion`."""
    return bool(m.quiet_time >= REST_TIME or m.slow_time >= SLOW_TIME)


@kernel
def note_rest(sim: Simulation, body: int, reported: Floats) -> None:
    """Update how long a simulated body has been at rest at the step's end, and set the rest of its motion to zero.

    `reported` is its record of the velocities for the caller.
    """
    m, kind = sim.motion[body], sim.bodies[body]
    fastest = norm(vec_of(m.velocity)) + norm(vec_of(m.angular_velocity)) * m.reach
    borne = kind.touched == 1 and sim.frame.weight > 0.0
    steady = fastest < SLOW_SPEED and fastest < m.slow_from + SPEEDING_UP
    if steady and (borne or kind.activation == ASLEEP):
        m.slow_time = m.slow_time + sim.frame.step
    else:
        m.slow_time, m.slow_from = 0.0, fastest
    square = 0.0
    for i in range(4):
        change = m.orientation[i] - m.rest_pose[3 + i]
        square += change * change
    path = norm(sub(vec_of(m.position), vec_from(m.rest_pose, 0))) + 2.0 * math.sqrt(square) * m.reach
    if path < REST_DISTANCE and fastest < REST_SPEED and norm(vec_of(m.acceleration)) < REST_ACCELERATION:
        m.quiet_time = m.quiet_time + sim.frame.step
    else:
        m.quiet_time = 0.0
        set_vec_from(m.rest_pose, 0, vec_of(m.position))
        set_quat_from(m.rest_pose, 3, quat_of(m.orientation))
    if m.quiet_time >= REST_TIME:
        set_vec_from(reported, 0, (0.0, 0.0, 0.0))
        set_vec_from(reported, 3, (0.0, 0.0, 0.0))


@kernel
def is_moving(sim: Simulation, body: int) -> bool:
    """Whether a body that is not simulated moves in this frame, or is recorded to."""
    if sim.bodies[body].moves == 0:
        return False
    m = sim.motion[body]
    moving = norm(vec_of(m.velocity)) > 0.0 or norm(vec_of(m.rotation_rate)) > 0.0
    return moving or norm(vec_of(m.acceleration)) > 0.0 or norm(vec_of(m.half_angular_acceleration)) > 0.0


@kernel
def wake_island(sim: Simulation, body: int) -> None:
    """Wake the island of a body."""
    sim.bodies[sim.bodies[body].island].island_activation = AWAKE


@kernel
def lay_to_rest(sim: Simulation, body: int) -> None:
    """Set all motion of a body to zero."""
    m, nothing = sim.motion[body], (0.0, 0.0, 0.0)
    set_vec(m.velocity, nothing)
    set_vec(m.acceleration, nothing)
    set_vec(m.rotation_rate, nothing)
    set_vec(m.half_angular_acceleration, nothing)
    set_vec(m.angular_momentum, nothing)
    set_vec(m.torque, nothing)
    set_vec(m.angular_velocity, nothing)


@noinline
def wake(sim: Simulation, first: bool) -> bool:
    """Decide which bodies are awake, from the pairs just found.

    `first`: the step begins; bodies fall asleep only then. Those solved with driven ones stay so. Returns whether any is awake.
    """
    for s in range(len(sim.free)):
        sim.bodies[sim.free[s]].island_activation = ASLEEP
    for s in range(len(sim.free)):
        body = sim.free[s]
        if not is_quiet(sim.motion[body]) or (not first and sim.bodies[body].activation == AWAKE):
            wake_island(sim, body)
    for k in range(sim.counts.pairs):
        b = sim.pairs[k].body[1]
        if not is_simulated(sim, b) and is_moving(sim, b):
            wake_island(sim, sim.pairs[k].body[0])
    any_awake = False
    for s in range(len(sim.free)):
        body = sim.free[s]
        if is_coupled(sim, body):
            any_awake = True
            continue
        activation = sim.bodies[sim.bodies[body].island].island_activation
        sim.bodies[body].activation = activation
        any_awake = any_awake or activation == AWAKE
        if activation == ASLEEP:
            lay_to_rest(sim, body)
    return any_awake


@kernel
def sum_sleeping_forces(sim: Simulation, h: float) -> None:
    """Contact forces of sleeping bodies continue: add their impulses of a step of `h` seconds to the totals."""
    for k in range(sim.counts.pairs):
        if sim.bodies[sim.pairs[k].body[0]].activation == ASLEEP:
            for m in range(sim.pairs[k].point_count):
                slot = sim.slots[k, m]
                slot.since = h
                slot.normal_impulse = slot.normal_impulse + h * slot.normal_force
                add_vec(slot.friction_impulse, vec_of(slot.friction_force), h)
                add_vec(slot.normal_impulses, vec_of(sim.pairs[k].axis), h * slot.normal_force)
