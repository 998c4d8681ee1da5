"""Where each body is at any time of the frame; planning and carrying on its motion."""

from __future__ import annotations

from geomphys.jit.addresses import float_at, set_float
from geomphys.jit.kernel import kernel
from geomphys.numerics.vec3 import (
    Quat,
    Vec,
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
from geomphys.simulated.cells import add_vec, quat_at, rot_at, set_quat, set_vec, vec_at
from geomphys.simulated.integrate import angular_velocity, inverse_inertia, turn_freely
from geomphys.simulated.state import (
    AT_COUNT,
    AT_FRAMES,
    AT_LOCAL,
    AT_VELOCITY,
    BASE,
    BEND,
    INERTIA,
    INVERSE,
    LENGTH,
    MOMENTUM,
    OFFSET,
    POINT,
    PRINCIPAL,
    PULL,
    RATE,
    SPEED,
    SPIN,
    TORQUE,
    TURN,
    TURNED,
    entry,
    free_body,
    has_changed,
    motion_of,
    velocity_of,
)


@kernel
def point_at(m: int, t: float) -> Vec:
    """World position of the reference point at time `t` of the frame; `m` is the body's row of `motion`."""
    h = t - float_at(m, BASE)
    k = 0.5 * h * h
    p, v, a = vec_at(m, POINT), vec_at(m, SPEED), vec_at(m, PULL)
    return (p[0] + h * v[0] + k * a[0], p[1] + h * v[1] + k * a[1], p[2] + h * v[2] + k * a[2])


@kernel
def turned_by(m: int, t: float) -> Vec:
    """Rotation vector [rad] of a body from its base time to time `t` of the frame."""
    h = t - float_at(m, BASE)
    k = h * (h - float_at(m, LENGTH))
    w, d = vec_at(m, RATE), vec_at(m, BEND)
    return (h * w[0] + k * d[0], h * w[1] + k * d[1], h * w[2] + k * d[2])


@kernel
def fastest_turn(m: int) -> float:
    """Bound on the rate of turning over the step [rad/s]; `m` is a body's row of `motion`."""
    return norm(vec_at(m, RATE)) + norm(vec_at(m, BEND)) * float_at(m, LENGTH)


@kernel
def turn_at(m: int, t: float) -> Quat:
    """Orientation at time `t` of the frame."""
    q = quat_at(m, TURN)
    v = turned_by(m, t)
    if v[0] == 0.0 and v[1] == 0.0 and v[2] == 0.0:
        return q
    return quat_unit(quat_mul(quat_from_rotation_vector(v), q))


@kernel
def refresh(m: int) -> None:
    """Angular velocity and inverse inertia of a simulated body from its orientation and angular momentum."""
    inertia = vec_at(m, INERTIA)
    q = quat_mul(quat_at(m, TURN), quat_at(m, PRINCIPAL))
    set_vec(m, SPIN, angular_velocity(q, inertia, vec_at(m, MOMENTUM)))
    i = inverse_inertia(q, inertia)
    set_vec(m, INVERSE, (i[0], i[1], i[2]))
    set_vec(m, INVERSE + 3, (i[3], i[4], i[5]))
    set_vec(m, INVERSE + 6, (i[6], i[7], i[8]))


@kernel
def plan(m: int, h: float) -> None:
    """Lay out how a simulated body turns over the next `h` > 0 seconds, from its angular momentum and torque."""
    q0 = quat_mul(quat_at(m, TURN), quat_at(m, PRINCIPAL))
    q1 = turn_freely(q0, vec_at(m, INERTIA), vec_at(m, MOMENTUM), vec_at(m, TORQUE), h)
    turn = rotation_vector(quat_mul(q1, quat_conjugate(q0)))
    spin = vec_at(m, SPIN)
    rate = (turn[0] / h, turn[1] / h, turn[2] / h)
    set_vec(m, RATE, rate)
    set_vec(m, BEND, ((rate[0] - spin[0]) / h, (rate[1] - spin[1]) / h, (rate[2] - spin[2]) / h))
    set_float(m, LENGTH, h)


@kernel
def move_base(m: int, t: float) -> None:
    """Let a simulated body run to time `t` of the frame and make that its base."""
    h = t - float_at(m, BASE)
    if h != 0.0:
        p, q = point_at(m, t), turn_at(m, t)
        set_float(m, TURNED, float_at(m, TURNED) + norm(turned_by(m, t)))
        set_vec(m, POINT, p)
        set_quat(m, TURN, q)
        add_vec(m, SPEED, vec_at(m, PULL), h)
        add_vec(m, MOMENTUM, vec_at(m, TORQUE), h)
        set_float(m, BASE, t)
    refresh(m)


@kernel
def move_bases(sim: int, t: float) -> None:
    """Bring the changed bodies to time `t` of the frame."""
    for s in range(entry(sim, AT_COUNT)):
        if has_changed(sim, free_body(sim, s)):
            move_base(motion_of(sim, free_body(sim, s)), t)


@kernel
def load_velocities(sim: int) -> None:
    """Write the present velocities of the changed bodies to `velocity` of the state."""
    for s in range(entry(sim, AT_COUNT)):
        body = free_body(sim, s)
        if has_changed(sim, body):
            set_vec(velocity_of(entry(sim, AT_VELOCITY), body), 0, vec_at(motion_of(sim, body), SPEED))
            set_vec(velocity_of(entry(sim, AT_VELOCITY), body), 3, vec_at(motion_of(sim, body), SPIN))


@kernel
def place_piece(sim: int, body: int, piece: int, t: float) -> None:
    """Frame row of a piece of a body at time `t` of the frame."""
    m, f, local = motion_of(sim, body), entry(sim, AT_FRAMES) + 96 * piece, entry(sim, AT_LOCAL) + 96 * piece
    p, r = point_at(m, t), rot_from_quat(turn_at(m, t))
    o, at = rotate(r, vec_at(m, OFFSET)), rotate(r, vec_at(local, 9))
    turned = rot_mul(r, rot_at(local, 0))
    set_vec(f, 0, (turned[0], turned[1], turned[2]))
    set_vec(f, 3, (turned[3], turned[4], turned[5]))
    set_vec(f, 6, (turned[6], turned[7], turned[8]))
    set_vec(f, 9, (p[0] - o[0] + at[0], p[1] - o[1] + at[1], p[2] - o[2] + at[2]))
