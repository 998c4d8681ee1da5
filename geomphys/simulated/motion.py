"""Poses of bodies at any time of the frame; planning and advancing their motion."""

from __future__ import annotations

from geomphys.jit.kernel import kernel
from geomphys.numerics.row_vectors import (
    add_vec,
    quat_of,
    rot_of,
    set_quat,
    set_rot,
    set_vec,
    set_vec_from,
    vec_from,
    vec_of,
)
from geomphys.numerics.vec3 import (
    Quat,
    Vec,
    add_scaled,
    norm,
    quat_conjugate,
    quat_from_rotation_vector,
    quat_mul,
    quat_unit,
    rot_from_quat,
    rot_mul,
    rotate,
    rotation_vector,
)
from geomphys.simulated.integrate import angular_velocity, inverse_inertia, rotate_freely
from geomphys.simulated.state import Motion, Simulation


@kernel
def point_at(m: Motion, t: float) -> Vec:
    """World position of the reference point at time `t` of the frame; `m` is the body's record of `motion`."""
    h = t - m.base_time
    k = 0.5 * h * h
    p, v, a = vec_of(m.position), vec_of(m.velocity), vec_of(m.acceleration)
    return (p[0] + h * v[0] + k * a[0], p[1] + h * v[1] + k * a[1], p[2] + h * v[2] + k * a[2])


@kernel
def velocity_at(m: Motion, t: float) -> Vec:
    """Velocity of the reference point at time `t` [m/s]."""
    return add_scaled(vec_of(m.velocity), vec_of(m.acceleration), t - m.base_time)


@kernel
def rotation_at(m: Motion, t: float) -> Vec:
    """Rotation vector [rad] of a body from its base time to time `t` of the frame."""
    h = t - m.base_time
    k = h * (h - m.step_duration)
    w, d = vec_of(m.rotation_rate), vec_of(m.half_angular_acceleration)
    return (h * w[0] + k * d[0], h * w[1] + k * d[1], h * w[2] + k * d[2])


@kernel
def angular_speed_bound(m: Motion) -> float:
    """Bound on the angular speed over the step [rad/s]; `m` is a body's record of `motion`."""
    return norm(vec_of(m.rotation_rate)) + norm(vec_of(m.half_angular_acceleration)) * m.step_duration


@kernel
def travelled_at(m: Motion, t: float) -> float:
    """How far any surface point of a simulated body may have moved until time `t`, summed [m]: a bound of its path."""
    h = t - m.base_time
    speed = norm(vec_of(m.velocity)) + 0.5 * h * norm(vec_of(m.acceleration)) + angular_speed_bound(m) * m.reach
    return float(m.travelled + h * speed)


@kernel
def orientation_at(m: Motion, t: float) -> Quat:
    """Orientation at time `t` of the frame."""
    q = quat_of(m.orientation)
    v = rotation_at(m, t)
    if v[0] == 0.0 and v[1] == 0.0 and v[2] == 0.0:
        return q
    return quat_unit(quat_mul(quat_from_rotation_vector(v), q))


@kernel
def refresh(m: Motion) -> None:
    """Angular velocity and inverse inertia of a simulated body from its orientation and angular momentum."""
    inertia = vec_of(m.inertia)
    q = quat_mul(quat_of(m.orientation), quat_of(m.principal))
    set_vec(m.angular_velocity, angular_velocity(q, inertia, vec_of(m.angular_momentum)))
    i = inverse_inertia(q, inertia)
    set_rot(m.inverse_inertia, i)


@kernel
def plan(m: Motion, h: float) -> None:
    """Plan the rotation of a simulated body over the next `h` > 0 seconds, from its angular momentum and torque."""
    q0 = quat_mul(quat_of(m.orientation), quat_of(m.principal))
    q1 = rotate_freely(q0, vec_of(m.inertia), vec_of(m.angular_momentum), vec_of(m.torque), h)
    rotation = rotation_vector(quat_mul(q1, quat_conjugate(q0)))
    omega = vec_of(m.angular_velocity)
    rate = (rotation[0] / h, rotation[1] / h, rotation[2] / h)
    set_vec(m.rotation_rate, rate)
    set_vec(m.half_angular_acceleration, ((rate[0] - omega[0]) / h, (rate[1] - omega[1]) / h, (rate[2] - omega[2]) / h))
    m.step_duration = h


@kernel
def move_base(m: Motion, t: float) -> None:
    """Advance a simulated body to time `t` of the frame and make that its base time."""
    h = t - m.base_time
    if h != 0.0:
        p, q = point_at(m, t), orientation_at(m, t)
        m.travelled = travelled_at(m, t)
        m.listed_rotation = m.listed_rotation + norm(rotation_at(m, t))
        set_vec(m.position, p)
        set_quat(m.orientation, q)
        add_vec(m.velocity, vec_of(m.acceleration), h)
        add_vec(m.angular_momentum, vec_of(m.torque), h)
        m.base_time = t
    refresh(m)


@kernel
def move_bases(sim: Simulation, t: float) -> None:
    """Bring the changed bodies to time `t` of the frame."""
    for s in range(sim.counts.changed):
        move_base(sim.motion[sim.changed[s]], t)


@kernel
def load_velocities(sim: Simulation) -> None:
    """Write the present velocities of the changed bodies to `velocity` of the state."""
    for s in range(sim.counts.changed):
        body = sim.changed[s]
        set_vec_from(sim.velocity[body], 0, vec_of(sim.motion[body].velocity))
        set_vec_from(sim.velocity[body], 3, vec_of(sim.motion[body].angular_velocity))


@kernel
def pose_piece(sim: Simulation, body: int, piece: int, t: float) -> None:
    """Frame row of a piece of a body at time `t` of the frame."""
    m, f, local = sim.motion[body], sim.frames[piece], sim.pieces.local[piece]
    p, r = point_at(m, t), rot_from_quat(orientation_at(m, t))
    o, at = rotate(r, vec_of(m.centre)), rotate(r, vec_from(local, 9))
    world_rotation = rot_mul(r, rot_of(local))
    set_rot(f, world_rotation)
    set_vec_from(f, 9, (p[0] - o[0] + at[0], p[1] - o[1] + at[1], p[2] - o[2] + at[2]))
