"""Rigid transforms on arrays.

Three forms of ``a_from_b`` (takes coordinates in b to coordinates in a), each with any number of leading axes:

- a *matrix* (..., 4, 4), homogeneous;
- a *frame row* (..., 12): the rotation's nine numbers row by row, then the position's three;
- a *pose row* (..., 7): position [m], then the unit quaternion x y z w.

Neighbouring names cancel: ``world_from_link = compose(world_from_root, root_from_link)``.
"""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np
from numpy.typing import ArrayLike, NDArray

Floats = NDArray[np.float64]


def rotation_from_quaternion(quaternion: ArrayLike) -> Floats:
    """Rotations (..., 3, 3) of unit quaternions (..., 4) x y z w. The identity gives exact ones and zeros."""
    x, y, z, w = np.moveaxis(np.asarray(quaternion, dtype=np.float64), -1, 0)
    rows = [
        [1 - 2 * (y * y + z * z), 2 * (x * y - z * w), 2 * (x * z + y * w)],
        [2 * (x * y + z * w), 1 - 2 * (x * x + z * z), 2 * (y * z - x * w)],
        [2 * (x * z - y * w), 2 * (y * z + x * w), 1 - 2 * (x * x + y * y)],
    ]
    return np.stack([np.stack(row, axis=-1) for row in rows], axis=-2)


def quaternion_from_rotation(rotation: ArrayLike) -> Floats:
    """Unit quaternions (..., 4) x y z w, w >= 0, of rotations (..., 3, 3).

    The largest of the four components is computed from a square root and the others from it (Shepperd 1978), so that
    no rotation loses digits.
    """
    r = np.asarray(rotation, dtype=np.float64)
    flat = r.reshape(-1, 3, 3)
    a, b, c = flat[:, 0, 0], flat[:, 1, 1], flat[:, 2, 2]
    squares = np.stack([1 + a - b - c, 1 - a + b - c, 1 - a - b + c, 1 + a + b + c], axis=-1)
    xy, xz, yz = flat[:, 0, 1] + flat[:, 1, 0], flat[:, 0, 2] + flat[:, 2, 0], flat[:, 1, 2] + flat[:, 2, 1]
    xw, yw, zw = flat[:, 2, 1] - flat[:, 1, 2], flat[:, 0, 2] - flat[:, 2, 0], flat[:, 1, 0] - flat[:, 0, 1]
    x2, y2, z2, w2 = squares.T
    candidates = np.stack(
        [
            np.stack([x2, xy, xz, xw], axis=-1),
            np.stack([xy, y2, yz, yw], axis=-1),
            np.stack([xz, yz, z2, zw], axis=-1),
            np.stack([xw, yw, zw, w2], axis=-1),
        ],
        axis=1,
    )
    chosen = candidates[np.arange(len(flat)), np.argmax(squares, axis=1)]
    chosen = chosen / np.linalg.norm(chosen, axis=-1, keepdims=True)
    chosen = np.where(chosen[:, 3:] < 0, -chosen, chosen)
    result: Floats = (chosen + 0.0).reshape(*r.shape[:-2], 4)
    return result


def quaternion_from_rpy(degrees: Sequence[float]) -> tuple[float, float, float, float]:
    """Unit quaternion x y z w of roll, pitch and yaw [degrees] about fixed axes: R = Rz(yaw) Ry(pitch) Rx(roll).

    That is the convention of URDF. Multiples of 90 degrees give components of exactly 0, ±√½, ±½ or ±1.
    """
    (sr, cr), (sp, cp), (sy, cy) = (_half_angle(angle) for angle in degrees)
    return (
        sr * cp * cy - cr * sp * sy + 0.0,
        cr * sp * cy + sr * cp * sy + 0.0,
        cr * cp * sy - sr * sp * cy + 0.0,
        cr * cp * cy + sr * sp * sy + 0.0,
    )


def _half_angle(degrees: float) -> tuple[float, float]:
    """Sine and cosine of half an angle, exact where it is a multiple of 180 degrees, equal ones at 90."""
    quarters = math.remainder(degrees, 720.0) / 90.0
    if quarters.is_integer():
        root = math.sqrt(0.5)
        sines = (0.0, root, 1.0, root, 0.0, -root, -1.0, -root)
        return sines[int(quarters) % 8], sines[(int(quarters) + 2) % 8]
    return math.sin(math.radians(degrees) / 2), math.cos(math.radians(degrees) / 2)


def rotation_about(axis: ArrayLike, angle: ArrayLike) -> Floats:
    """Rotations (..., 3, 3) by `angle` (...) rad about the unit vector `axis` (3,), right-handed (Rodrigues)."""
    x, y, z = (float(v) for v in np.asarray(axis, dtype=np.float64))
    angle = np.asarray(angle, dtype=np.float64)[..., None, None]
    cross = np.array([[0.0, -z, y], [z, 0.0, -x], [-y, x, 0.0]])
    rotation: Floats = np.eye(3) + np.sin(angle) * cross + 2 * np.sin(0.5 * angle) ** 2 * (cross @ cross)
    return rotation


def matrix_from_pose(pose: ArrayLike) -> Floats:
    """Matrices (..., 4, 4) of pose rows (..., 7)."""
    pose = np.asarray(pose, dtype=np.float64)
    matrix = np.zeros((*pose.shape[:-1], 4, 4))
    matrix[..., :3, :3] = rotation_from_quaternion(pose[..., 3:])
    matrix[..., :3, 3] = pose[..., :3]
    matrix[..., 3, 3] = 1.0
    return matrix


def pose_from_matrix(matrix: ArrayLike) -> Floats:
    """Pose rows (..., 7), w >= 0, of matrices (..., 4, 4)."""
    matrix = np.asarray(matrix, dtype=np.float64)
    return np.concatenate([matrix[..., :3, 3], quaternion_from_rotation(matrix[..., :3, :3])], axis=-1)


def matrix_from_frame(frame: ArrayLike) -> Floats:
    """Matrices (..., 4, 4) of frame rows (..., 12)."""
    frame = np.asarray(frame, dtype=np.float64)
    matrix = np.zeros((*frame.shape[:-1], 4, 4))
    matrix[..., :3, :3] = frame[..., :9].reshape(*frame.shape[:-1], 3, 3)
    matrix[..., :3, 3] = frame[..., 9:]
    matrix[..., 3, 3] = 1.0
    return matrix


def frame_from_matrix(matrix: ArrayLike) -> Floats:
    """Frame rows (..., 12) of matrices (..., 4, 4)."""
    matrix = np.asarray(matrix, dtype=np.float64)
    rotation = matrix[..., :3, :3].reshape(*matrix.shape[:-2], 9)
    return np.concatenate([rotation, matrix[..., :3, 3]], axis=-1)


def compose(a_from_b: ArrayLike, b_from_c: ArrayLike) -> Floats:
    """a_from_c of matrices (..., 4, 4)."""
    return np.asarray(a_from_b, dtype=np.float64) @ np.asarray(b_from_c, dtype=np.float64)


def invert(a_from_b: ArrayLike) -> Floats:
    """b_from_a of rigid matrices (..., 4, 4)."""
    matrix = np.asarray(a_from_b, dtype=np.float64)
    inverse = np.zeros_like(matrix)
    rotation = np.swapaxes(matrix[..., :3, :3], -1, -2)
    inverse[..., :3, :3] = rotation
    inverse[..., :3, 3] = -(rotation @ matrix[..., :3, 3:])[..., 0]
    inverse[..., 3, 3] = 1.0
    return inverse


def apply(a_from_b: ArrayLike, points: ArrayLike) -> Floats:
    """Points (n, 3) in a, of points (n, 3) in b and one matrix (4, 4)."""
    matrix = np.asarray(a_from_b, dtype=np.float64)
    return np.asarray(points, dtype=np.float64) @ matrix[:3, :3].T + matrix[:3, 3]


def quaternion_product(a: ArrayLike, b: ArrayLike) -> Floats:
    """Quaternions (..., 4) of the rotation b followed by the rotation a."""
    ax, ay, az, aw = np.moveaxis(np.asarray(a, dtype=np.float64), -1, 0)
    bx, by, bz, bw = np.moveaxis(np.asarray(b, dtype=np.float64), -1, 0)
    return np.stack(
        [
            aw * bx + ax * bw + ay * bz - az * by,
            aw * by - ax * bz + ay * bw + az * bx,
            aw * bz + ax * by - ay * bx + az * bw,
            aw * bw - ax * bx - ay * by - az * bz,
        ],
        axis=-1,
    )


def angle_between(a: ArrayLike, b: ArrayLike) -> Floats:
    """Angles (...) [rad, 0 to pi] between the rotations of unit quaternions (..., 4); exact for tiny angles too."""
    a, b = np.asarray(a, dtype=np.float64), np.asarray(b, dtype=np.float64)
    b = np.where(np.sum(a * b, axis=-1, keepdims=True) < 0, -b, b)
    angle: Floats = 4.0 * np.arctan2(np.linalg.norm(a - b, axis=-1), np.linalg.norm(a + b, axis=-1))
    return angle
