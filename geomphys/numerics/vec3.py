"""Compiled 3-vectors, quaternions and 3 x 3 rotations on plain tuples of floats.

A vector is ``(x, y, z)``, a quaternion ``(x, y, z, w)``, a rotation nine floats row by row. A pose row of an array is
``(px, py, pz, qx, qy, qz, qw)``; a frame row is the rotation's nine floats and then the position's three. Tuples stay
in registers: the same code on small arrays runs several times slower.
"""

from __future__ import annotations

import math
from typing import TypeAlias

from geomphys.jit.kernel import kernel

Vec: TypeAlias = tuple[float, float, float]
Quat: TypeAlias = tuple[float, float, float, float]
Rot: TypeAlias = tuple[float, float, float, float, float, float, float, float, float]


@kernel
def add(a: Vec, b: Vec) -> Vec:
    """Sum a + b."""
    return (a[0] + b[0], a[1] + b[1], a[2] + b[2])


@kernel
def sub(a: Vec, b: Vec) -> Vec:
    """Difference a - b."""
    return (a[0] - b[0], a[1] - b[1], a[2] - b[2])


@kernel
def neg(a: Vec) -> Vec:
    """Opposite -a."""
    return (-a[0], -a[1], -a[2])


@kernel
def scale(a: Vec, s: float) -> Vec:
    """Multiple s a."""
    return (a[0] * s, a[1] * s, a[2] * s)


@kernel
def add_scaled(a: Vec, b: Vec, s: float) -> Vec:
    """Sum a + s b."""
    return (a[0] + s * b[0], a[1] + s * b[1], a[2] + s * b[2])


@kernel
def dot(a: Vec, b: Vec) -> float:
    """Dot product a · b."""
    return a[0] * b[0] + a[1] * b[1] + a[2] * b[2]


@kernel
def cross(a: Vec, b: Vec) -> Vec:
    """Cross product a × b."""
    return (a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0])


@kernel
def norm(a: Vec) -> float:
    """Length |a|."""
    return math.sqrt(a[0] * a[0] + a[1] * a[1] + a[2] * a[2])


@kernel
def unit(a: Vec) -> Vec:
    """Unit vector a / |a|; the zero vector stays zero."""
    length = norm(a)
    if length == 0.0:
        return (0.0, 0.0, 0.0)
    return (a[0] / length, a[1] / length, a[2] / length)


@kernel
def perpendicular(a: Vec) -> Vec:
    """A unit vector at right angles to `a` (not zero), the same one each time."""
    if abs(a[0]) <= abs(a[1]) and abs(a[0]) <= abs(a[2]):
        return unit((0.0, -a[2], a[1]))
    if abs(a[1]) <= abs(a[2]):
        return unit((a[2], 0.0, -a[0]))
    return unit((-a[1], a[0], 0.0))


@kernel
def rotate(r: Rot, v: Vec) -> Vec:
    """Vector v rotated by r: R v."""
    return (
        r[0] * v[0] + r[1] * v[1] + r[2] * v[2],
        r[3] * v[0] + r[4] * v[1] + r[5] * v[2],
        r[6] * v[0] + r[7] * v[1] + r[8] * v[2],
    )


@kernel
def rotate_back(r: Rot, v: Vec) -> Vec:
    """Vector v rotated by the inverse of r: Rᵀ v."""
    return (
        r[0] * v[0] + r[3] * v[1] + r[6] * v[2],
        r[1] * v[0] + r[4] * v[1] + r[7] * v[2],
        r[2] * v[0] + r[5] * v[1] + r[8] * v[2],
    )


@kernel
def rot_sub(a: Rot, b: Rot) -> Rot:
    """Difference of two matrices: a - b."""
    return (
        a[0] - b[0],
        a[1] - b[1],
        a[2] - b[2],
        a[3] - b[3],
        a[4] - b[4],
        a[5] - b[5],
        a[6] - b[6],
        a[7] - b[7],
        a[8] - b[8],
    )


@kernel
def rot_mul(a: Rot, b: Rot) -> Rot:
    """Product A B of two rotations."""
    return (
        a[0] * b[0] + a[1] * b[3] + a[2] * b[6],
        a[0] * b[1] + a[1] * b[4] + a[2] * b[7],
        a[0] * b[2] + a[1] * b[5] + a[2] * b[8],
        a[3] * b[0] + a[4] * b[3] + a[5] * b[6],
        a[3] * b[1] + a[4] * b[4] + a[5] * b[7],
        a[3] * b[2] + a[4] * b[5] + a[5] * b[8],
        a[6] * b[0] + a[7] * b[3] + a[8] * b[6],
        a[6] * b[1] + a[7] * b[4] + a[8] * b[7],
        a[6] * b[2] + a[7] * b[5] + a[8] * b[8],
    )


@kernel
def rot_transposed_mul(a: Rot, b: Rot) -> Rot:
    """Product Aᵀ B of two rotations."""
    return (
        a[0] * b[0] + a[3] * b[3] + a[6] * b[6],
        a[0] * b[1] + a[3] * b[4] + a[6] * b[7],
        a[0] * b[2] + a[3] * b[5] + a[6] * b[8],
        a[1] * b[0] + a[4] * b[3] + a[7] * b[6],
        a[1] * b[1] + a[4] * b[4] + a[7] * b[7],
        a[1] * b[2] + a[4] * b[5] + a[7] * b[8],
        a[2] * b[0] + a[5] * b[3] + a[8] * b[6],
        a[2] * b[1] + a[5] * b[4] + a[8] * b[7],
        a[2] * b[2] + a[5] * b[5] + a[8] * b[8],
    )


@kernel
def quat_mul(a: Quat, b: Quat) -> Quat:
    """Quaternion product a b (b is applied first)."""
    return (
        a[3] * b[0] + a[0] * b[3] + a[1] * b[2] - a[2] * b[1],
        a[3] * b[1] - a[0] * b[2] + a[1] * b[3] + a[2] * b[0],
        a[3] * b[2] + a[0] * b[1] - a[1] * b[0] + a[2] * b[3],
        a[3] * b[3] - a[0] * b[0] - a[1] * b[1] - a[2] * b[2],
    )


@kernel
def quat_conjugate(q: Quat) -> Quat:
    """The inverse of a unit quaternion."""
    return (-q[0], -q[1], -q[2], q[3])


@kernel
def quat_unit(q: Quat) -> Quat:
    """Unit quaternion q / |q|; the zero quaternion becomes the identity."""
    length = math.sqrt(q[0] * q[0] + q[1] * q[1] + q[2] * q[2] + q[3] * q[3])
    if length == 0.0:
        return (0.0, 0.0, 0.0, 1.0)
    return (q[0] / length, q[1] / length, q[2] / length, q[3] / length)


@kernel
def quat_rotate(q: Quat, v: Vec) -> Vec:
    """Vector v rotated by the unit quaternion q."""
    u = (q[0], q[1], q[2])
    c = cross(u, v)
    t = (c[0] + c[0], c[1] + c[1], c[2] + c[2])
    d = cross(u, t)
    return (v[0] + q[3] * t[0] + d[0], v[1] + q[3] * t[1] + d[1], v[2] + q[3] * t[2] + d[2])


@kernel
def quat_from_rotation_vector(v: Vec) -> Quat:
    """Unit quaternion of the rotation by |v| rad about v; exact for tiny angles."""
    angle = norm(v)
    if angle < 1e-9:
        return quat_unit((0.5 * v[0], 0.5 * v[1], 0.5 * v[2], 1.0))
    s = math.sin(0.5 * angle) / angle
    return (v[0] * s, v[1] * s, v[2] * s, math.cos(0.5 * angle))


@kernel
def rotation_vector(q: Quat) -> Vec:
    """Axis times angle [rad] of a unit quaternion, the shorter way round."""
    s = 1.0 if q[3] >= 0.0 else -1.0
    sine = math.sqrt(q[0] * q[0] + q[1] * q[1] + q[2] * q[2])
    if sine < 1e-12:
        return (2.0 * s * q[0], 2.0 * s * q[1], 2.0 * s * q[2])
    k = s * 2.0 * math.atan2(sine, s * q[3]) / sine
    return (k * q[0], k * q[1], k * q[2])


@kernel
def quat_half(q: Quat) -> Quat:
    """Rotation by half the angle of a unit quaternion, the shorter way round: midway between it and the identity."""
    s = 1.0 if q[3] >= 0.0 else -1.0
    return quat_unit((s * q[0], s * q[1], s * q[2], s * q[3] + 1.0))


@kernel
def slerp(a: Quat, b: Quat, w: float) -> Quat:
    """Spherical interpolation from a (w = 0) to b, along the shorter arc; a itself at 0."""
    if w == 0.0:
        return a
    step = rotation_vector(quat_mul(quat_conjugate(a), b))
    return quat_unit(quat_mul(a, quat_from_rotation_vector(scale(step, w))))


@kernel
def rot_from_quat(q: Quat) -> Rot:
    """Rotation of a unit quaternion."""
    x, y, z, w = q
    return (
        1.0 - 2.0 * (y * y + z * z),
        2.0 * (x * y - z * w),
        2.0 * (x * z + y * w),
        2.0 * (x * y + z * w),
        1.0 - 2.0 * (x * x + z * z),
        2.0 * (y * z - x * w),
        2.0 * (x * z - y * w),
        2.0 * (y * z + x * w),
        1.0 - 2.0 * (x * x + y * y),
    )
