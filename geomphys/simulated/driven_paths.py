"""Motion of bodies with prescribed poses within a frame.

Only the poses at the frames are known. A kinematic body, which follows the recording whatever is in its way, moves from one
to the next on a parabola: its acceleration is the change of the mean velocity from frame to frame, extrapolated to the
middle of this frame, and zero where it reversed. A body that moves smoothly then hits and supports others with its true
velocity, at any frame rate; one that starts, stops or trembles moves on straight lines. Its path is that of the whole frame,
also where driven bodies divide the frame in parts. Driven bodies move on straight lines within such a part, whose ends lie on
such parabolas.
"""

from __future__ import annotations

import math

from geomphys.jit.kernel import kernel, noinline
from geomphys.numerics.row_vectors import quat_from, set_quat, set_quat_from, set_vec, set_vec_from, vec_from, vec_of
from geomphys.numerics.vec3 import Vec, add_scaled, dot, quat_conjugate, quat_mul, rotation_vector, scale, sub
from geomphys.scene.arrays import Floats
from geomphys.simulated.motion import orientation_at, point_at
from geomphys.simulated.state import Simulation, is_kinematic

UNEVEN = 3.0  # frames whose lengths differ by this factor give no acceleration


@kernel
def mean_velocities(start: Floats, end: Floats, dt: float) -> tuple[Vec, Vec]:
    """Mean velocity of the origin [m/s] and angular velocity [rad/s] from pose `start` (7,) to `end` (7,), `dt` [s] later."""
    rate = 1.0 / dt
    rotation = rotation_vector(quat_mul(quat_from(end, 3), quat_conjugate(quat_from(start, 3))))
    return scale(sub(vec_from(end, 0), vec_from(start, 0)), rate), scale(rotation, rate)


@kernel
def is_even(dt: float, last: float) -> bool:
    """Whether a frame of `dt` [s] after one of `last` [s] gives an acceleration."""
    return last < UNEVEN * dt and dt < UNEVEN * last


@kernel
def extrapolated(a: Vec, before: Vec) -> Vec:
    """Linear extrapolation of an acceleration, `before` and a frame later `a`, to half a frame after that.

    No longer than twice the shorter, and 0 where they, or the result and `a`, are at 90 degrees or more.
    """
    b = add_scaled(scale(a, 1.5), before, -0.5)
    if dot(a, before) <= 0.0 or dot(a, b) <= 0.0:
        return (0.0, 0.0, 0.0)
    most = 4.0 * min(dot(a, a), dot(before, before))
    square = dot(b, b)
    return b if square <= most else scale(b, math.sqrt(most / square))


@noinline
def fit_paths(sim: Simulation, end: Floats, dt: float) -> None:
    """Paths of the kinematic bodies that move through a frame of `dt` [s], from `start` to the poses `end` (B, 7)."""
    for k in range(len(sim.paths)):
        body = sim.paths[k]
        if not is_kinematic(sim, body):
            continue
        m, start = sim.motion[body], sim.start[body]
        v, w = mean_velocities(start, end[body], dt)
        last = m.path_duration
        a, b = (0.0, 0.0, 0.0), (0.0, 0.0, 0.0)
        if is_even(dt, last):
            rate = 2.0 / (dt + last)
            a, b = scale(sub(v, vec_from(m.path_velocity, 0)), rate), scale(sub(w, vec_from(m.path_velocity, 3)), rate)
        set_vec(m.acceleration, extrapolated(a, vec_from(m.path_acceleration, 0)))
        set_vec(m.half_angular_acceleration, scale(extrapolated(b, vec_from(m.path_acceleration, 3)), 0.5))
        m.base_time, m.step_duration = 0.0, dt
        set_vec(m.position, vec_from(start, 0))
        set_quat(m.orientation, quat_from(start, 3))
        set_vec(m.velocity, add_scaled(v, vec_of(m.acceleration), -0.5 * dt))
        set_vec(m.rotation_rate, w)
        set_vec_from(m.path_velocity, 0, v)
        set_vec_from(m.path_velocity, 3, w)
        set_vec_from(m.path_acceleration, 0, a)
        set_vec_from(m.path_acceleration, 3, b)
        m.path_duration = dt


@noinline
def follow_paths(sim: Simulation, t: float, poses: Floats) -> None:
    """Set the rows of `poses` (B, 7) of the kinematic bodies that move to where they are at time `t` [s] of the frame."""
    for k in range(len(sim.paths)):
        body = sim.paths[k]
        if is_kinematic(sim, body):
            m = sim.motion[body]
            m.base_time = 0.0
            set_vec_from(poses[body], 0, point_at(m, t))
            set_quat_from(poses[body], 3, orientation_at(m, t))


@kernel
def set_path(sim: Simulation, body: int) -> None:
    """Motion in the step at hand of a body that is not simulated: along its path, or straight through this part of the frame."""
    m = sim.motion[body]
    if is_kinematic(sim, body):
        m.base_time = -sim.frame.elapsed
    else:
        start = sim.start[body]
        v, w = mean_velocities(start, sim.end[body], sim.frame.dt)
        m.base_time = -sim.frame.begun
        set_vec(m.position, vec_from(start, 0))
        set_quat(m.orientation, quat_from(start, 3))
        set_vec(m.velocity, v)
        set_vec(m.rotation_rate, w)
    load_path(sim, body, 0.0)


@kernel
def load_path(sim: Simulation, body: int, t: float) -> None:
    """Write the velocities that a body that follows its path has at time `t` of the step to `velocity` of the state."""
    m, v = sim.motion[body], sim.velocity[body]
    tau = t - m.base_time
    set_vec_from(v, 0, add_scaled(vec_of(m.velocity), vec_of(m.acceleration), tau))
    set_vec_from(
        v, 3, add_scaled(vec_of(m.rotation_rate), vec_of(m.half_angular_acceleration), 2.0 * tau - m.step_duration)
    )


@kernel
def load_paths(sim: Simulation, t: float) -> None:
    """`load_path` for all kinematic bodies that move."""
    for k in range(len(sim.paths)):
        body = sim.paths[k]
        if is_kinematic(sim, body):
            load_path(sim, body, t)
