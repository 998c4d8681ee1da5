"""Rigid transforms as tuples of seven numbers: position, then the unit quaternion x y z w.

For single poses on their way into streams; arrays of them are in `geomphys.numerics.transforms`. ``a_from_c = compose(a_from_b,
b_from_c)``. A part of the second transform that does nothing changes nothing, to the bit.
"""

from __future__ import annotations

from collections.abc import Sequence

Seven = tuple[float, ...]

IDENTITY: Seven = (0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 1.0)
_NO_OFFSET, _NO_ROTATION = IDENTITY[:3], IDENTITY[3:]


def rotate(quaternion: Sequence[float], vector: Sequence[float]) -> tuple[float, float, float]:
    """Rotate a vector: v + 2 w (u x v) + 2 u x (u x v), with u the vector part of the quaternion."""
    (x, y, z, w), (a, b, c) = quaternion, vector
    cx, cy, cz = 2 * (y * c - z * b), 2 * (z * a - x * c), 2 * (x * b - y * a)
    return (a + w * cx + y * cz - z * cy, b + w * cy + z * cx - x * cz, c + w * cz + x * cy - y * cx)


def compose(a_from_b: Seven, b_from_c: Seven) -> Seven:
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


def invert(a_from_b: Seven) -> Seven:
    """b_from_a."""
    x, y, z, w = a_from_b[3:]
    back = (-x, -y, -z, w)
    px, py, pz = rotate(back, a_from_b[:3])
    return (-px, -py, -pz, *back)
