"""Free motion of a rigid body: the exact parabola, and rotation with constant angular momentum.

The state of a free body is its angular momentum L in the world frame, so it is conserved to the last bit. Its
orientation follows  q̇ = ½ ω q,  ω = R I⁻¹ Rᵀ L,  by the classical Runge-Kutta scheme of fourth order in rotations of at
most `ROTATION_STEP`, at any frame rate; with three equal moments I the angular velocity is known at all times, and the
rotation vector is the first two terms of Magnus's series (1954), its error of fifth order in h:

    h ω0 + h² τ / (2 I) + h³ τ × ω0 / (12 I),

exact without torque τ.
"""

from __future__ import annotations

import math

from geomphys.jit.kernel import kernel
from geomphys.numerics.vec3 import (
    Quat,
    Rot,
    Vec,
    add_scaled,
    cross,
    norm,
    quat_conjugate,
    quat_from_rotation_vector,
    quat_mul,
    quat_rotate,
    quat_unit,
    rot_from_quat,
    scale,
)

ROTATION_STEP = 0.03  # rad: one Runge-Kutta step rotates no further; its error per radian is then below 1e-8
MAX_STEPS = 20000  # Runge-Kutta steps of a call: bodies that rotate faster get larger ones


@kernel
def angular_velocity(q: Quat, inertia: Vec, momentum: Vec) -> Vec:
    """ω = R I⁻¹ Rᵀ L [rad/s, world] of a body whose principal axes have the orientation `q` (world_from_principal)."""
    own = quat_rotate(quat_conjugate(q), momentum)
    return quat_rotate(q, (own[0] / inertia[0], own[1] / inertia[1], own[2] / inertia[2]))


@kernel
def angular_momentum(q: Quat, inertia: Vec, omega: Vec) -> Vec:
    """Angular momentum R I Rᵀ ω [kg m²/s, world]: the inverse of `angular_velocity`."""
    own = quat_rotate(quat_conjugate(q), omega)
    return quat_rotate(q, (own[0] * inertia[0], own[1] * inertia[1], own[2] * inertia[2]))


@kernel
def slope(q: Quat, inertia: Vec, momentum: Vec) -> Quat:
    """q̇ = ½ ω q."""
    w = angular_velocity(quat_unit(q), inertia, momentum)
    r = quat_mul((w[0], w[1], w[2], 0.0), q)
    return (0.5 * r[0], 0.5 * r[1], 0.5 * r[2], 0.5 * r[3])


@kernel
def along(q: Quat, r: Quat, h: float) -> Quat:
    """Sum of q and h r."""
    return (q[0] + h * r[0], q[1] + h * r[1], q[2] + h * r[2], q[3] + h * r[3])


@kernel
def rotate_freely(q: Quat, inertia: Vec, momentum: Vec, torque: Vec, h: float) -> Quat:
    """Orientation after a time.

    Parameters
    ----------
    q
        world_from_principal at the start.
    inertia
        Principal moments [kg m²].
    momentum, torque
        Angular momentum L at the start [kg m²/s] and dL/dt [N m], constant meanwhile; world frame.
    h
        s.

    Returns
    -------
    tuple
        world_from_principal after `h`, a unit quaternion; `q` itself without rotation.
    """
    still = momentum[0] == 0.0 and momentum[1] == 0.0 and momentum[2] == 0.0
    free = torque[0] == 0.0 and torque[1] == 0.0 and torque[2] == 0.0
    if (still and free) or h == 0.0:
        return q
    if inertia[0] == inertia[1] and inertia[1] == inertia[2]:
        k = h / inertia[0]
        rotation = add_scaled(scale(momentum, k), torque, 0.5 * h * k)
        rotation = add_scaled(rotation, cross(torque, momentum), h * k * k / 12.0)
        return quat_unit(quat_mul(quat_from_rotation_vector(rotation), q))
    least = min(inertia[0], min(inertia[1], inertia[2]))
    angle = (norm(momentum) + norm(torque) * h) * h / least
    count = max(1, math.ceil(min(angle / ROTATION_STEP, MAX_STEPS)))
    step = h / count
    for k in range(count):
        l0 = add_scaled(momentum, torque, k * step)
        l1 = add_scaled(momentum, torque, (k + 0.5) * step)
        l2 = add_scaled(momentum, torque, (k + 1.0) * step)
        a = slope(q, inertia, l0)
        b = slope(along(q, a, 0.5 * step), inertia, l1)
        c = slope(along(q, b, 0.5 * step), inertia, l1)
        d = slope(along(q, c, step), inertia, l2)
        q = along(along(along(along(q, a, step / 6.0), b, step / 3.0), c, step / 3.0), d, step / 6.0)
        q = quat_unit(q)
    return q


@kernel
def inverse_inertia(q: Quat, inertia: Vec) -> Rot:
    """Inverse inertia R I⁻¹ Rᵀ of a body whose principal axes have the orientation `q`."""
    r = rot_from_quat(q)
    i, j, k = 1.0 / inertia[0], 1.0 / inertia[1], 1.0 / inertia[2]
    xx = i * r[0] * r[0] + j * r[1] * r[1] + k * r[2] * r[2]
    xy = i * r[0] * r[3] + j * r[1] * r[4] + k * r[2] * r[5]
    xz = i * r[0] * r[6] + j * r[1] * r[7] + k * r[2] * r[8]
    yy = i * r[3] * r[3] + j * r[4] * r[4] + k * r[5] * r[5]
    yz = i * r[3] * r[6] + j * r[4] * r[7] + k * r[5] * r[8]
    zz = i * r[6] * r[6] + j * r[7] * r[7] + k * r[8] * r[8]
    return (xx, xy, xz, xy, yy, yz, xz, yz, zz)
