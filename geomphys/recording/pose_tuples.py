"""Rigid transforms as tuples of seven floats: position x y z, unit quaternion x y z w.

For single poses of streams; arrays of transforms are in `geomphys.numerics.transforms`. ``a_from_c = compose(a_from_b,
b_from_c)``. Composing with an identity rotation or zero offset leaves values unchanged to the bit.
"""

from __future__ import annotations

import math
from collections.abc import Sequence

PoseTuple = tuple[float, ...]

IDENTITY: PoseTuple = (0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 1.0)
_NO_OFFSET, _NO_ROTATION = IDENTITY[:3], IDENTITY[3:]


def rotate(quaternion: Sequence[float], vector: Sequence[float]) -> tuple[float, float, float]:
    """Rotate a vector: v + 2 w (u x v) + 2 u x (u x v), with u the vector part of the quaternion."""
    (x, y, z, w), (a, b, c) = quaternion, vector
    cx, cy, cz = 2 * (y * c - z * b), 2 * (z * a - x * c), 2 * (x * b - y * a)
    return (a + w * cx + y * cz - z * cy, b + w * cy + z * cx - x * cz, c + w * cz + x * cy - y * cx)


def compose(a_from_b: PoseTuple, b_from_c: PoseTuple) -> PoseTuple:
    """a_from_c."""
    px, py, pz, x, y, z, w = a_from_b
    offset, rotation = b_from_c[:3], b_from_c[3:]
    if offset != _NO_OFFSET:
        ox, oy, oz = offset
        cx, cy, cz = 2 * (y * oz - z * oy), 2 * (z * ox - x * oz), 2 * (x * oy - y * ox)
        px += ox + w * cx + y * cz - z * cy
        py += oy + w * cy + z * cx - x * cz
        pz += oz + w * cz + x * cy - y * cx
    if rotation != _NO_ROTATION:
        a, b, c, d = rotation
        x, y, z, w = (
            w * a + x * d + y * c - z * b,
            w * b - x * c + y * d + z * a,
            w * c + x * b - y * a + z * d,
            w * d - x * a - y * b - z * c,
        )
    return (px, py, pz, x, y, z, w)


def invert(a_from_b: PoseTuple) -> PoseTuple:
    """b_from_a."""
    x, y, z, w = a_from_b[3:]
    back = (-x, -y, -z, w)
    px, py, pz = rotate(back, a_from_b[:3])
    return (-px, -py, -pz, *back)


def interpolate_poses(a: PoseTuple, b: PoseTuple, w: float) -> PoseTuple:
    """Pose between a (w = 0) and b (w = 1): linear in position, slerp the short way round in rotation."""
    position = tuple(p + w * (q - p) for p, q in zip(a[:3], b[:3], strict=True))
    qa, qb = a[3:], b[3:]
    if sum(p * q for p, q in zip(qa, qb, strict=True)) < 0:
        qb = tuple(-q for q in qb)
    if qa == qb:
        return position + qa
    apart = math.sqrt(sum((p - q) ** 2 for p, q in zip(qa, qb, strict=True)))
    together = math.sqrt(sum((p + q) ** 2 for p, q in zip(qa, qb, strict=True)))
    angle = 2 * math.atan2(apart, together)  # between the quaternions: half the rotation between them
    if angle < 1e-6:
        u, v = 1 - w, w
    else:
        u, v = math.sin((1 - w) * angle) / math.sin(angle), math.sin(w * angle) / math.sin(angle)
    mixed = [u * p + v * q for p, q in zip(qa, qb, strict=True)]
    norm = math.sqrt(sum(q * q for q in mixed))
    return (*position, *(q / norm for q in mixed))
