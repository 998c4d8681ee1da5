"""Rotations and rigid transforms over many frames: quaternions x y z w, transforms (n, 4, 4) named world_from_body."""

from __future__ import annotations

import numpy as np


def axis_turn(axis: tuple[float, float, float], angles: np.ndarray) -> np.ndarray:
    """(n, 4, 4) turns about a unit axis by angles (n,) in rad (Rodrigues)."""
    x, y, z = np.asarray(axis, dtype=float) / np.linalg.norm(axis)
    k = np.array([[0, -z, y], [z, 0, -x], [-y, x, 0]])
    c, s = np.cos(angles)[:, None, None], np.sin(angles)[:, None, None]
    out = np.tile(np.eye(4), (len(angles), 1, 1))
    out[:, :3, :3] = np.eye(3) + s * k + (1 - c) * (k @ k)
    return out


def euler(yaw: float, pitch: float, roll: float) -> np.ndarray:
    """Quaternion of turns in degrees about z, then the new y, then the new x."""
    out = np.array([0.0, 0.0, 0.0, 1.0])
    for axis, degrees in (((0, 0, 1), yaw), ((0, 1, 0), pitch), ((1, 0, 0), roll)):
        half = np.radians(degrees) / 2
        out = product(out, np.array([*(np.sin(half) * np.array(axis)), np.cos(half)]))
    return out


def product(a: np.ndarray, b: np.ndarray) -> np.ndarray:
    """Quaternion product a b over the last axis: b is applied first."""
    ax, ay, az, aw = np.moveaxis(np.asarray(a, dtype=float), -1, 0)
    bx, by, bz, bw = np.moveaxis(np.asarray(b, dtype=float), -1, 0)
    x = aw * bx + ax * bw + ay * bz - az * by
    y = aw * by - ax * bz + ay * bw + az * bx
    z = aw * bz + ax * by - ay * bx + az * bw
    w = aw * bw - ax * bx - ay * by - az * bz
    return np.stack([x, y, z, w], axis=-1)


def small_turns(vectors: np.ndarray) -> np.ndarray:
    """Quaternions of rotation vectors (n, 3) in rad."""
    angle = np.linalg.norm(vectors, axis=1, keepdims=True)
    return np.hstack([vectors * 0.5 * np.sinc(angle / (2 * np.pi)), np.cos(angle / 2)])


def slerp(a: np.ndarray, b: np.ndarray, part: np.ndarray) -> np.ndarray:
    """Shortest way from quaternion a to b (4,) at parts (n,) of it."""
    b = b if a @ b >= 0 else -b
    angle = np.arccos(min(1.0, float(a @ b)))
    if angle < 1e-9:
        return np.tile(a, (len(part), 1))
    wa, wb = np.sin((1 - part) * angle) / np.sin(angle), np.sin(part * angle) / np.sin(angle)
    return wa[:, None] * a + wb[:, None] * b


def transforms(positions: np.ndarray, quaternions: np.ndarray) -> np.ndarray:
    """(n, 4, 4) from positions (n, 3) and quaternions (n, 4), which are normalised."""
    x, y, z, w = (quaternions / np.linalg.norm(quaternions, axis=1, keepdims=True)).T
    out = np.tile(np.eye(4), (len(positions), 1, 1))
    out[:, 0, :3] = np.stack([1 - 2 * (y * y + z * z), 2 * (x * y - z * w), 2 * (x * z + y * w)], axis=1)
    out[:, 1, :3] = np.stack([2 * (x * y + z * w), 1 - 2 * (x * x + z * z), 2 * (y * z - x * w)], axis=1)
    out[:, 2, :3] = np.stack([2 * (x * z - y * w), 2 * (y * z + x * w), 1 - 2 * (x * x + y * y)], axis=1)
    out[:, :3, 3] = positions
    return out


def inverse(t: np.ndarray) -> np.ndarray:
    """Inverses of rigid transforms (n, 4, 4)."""
    out = np.tile(np.eye(4), (len(t), 1, 1))
    back = np.swapaxes(t[:, :3, :3], 1, 2)
    out[:, :3, :3] = back
    out[:, :3, 3] = -np.einsum("nij,nj->ni", back, t[:, :3, 3])
    return out


def quaternions(t: np.ndarray) -> np.ndarray:
    """Unit quaternions (n, 4) of transforms, without sign jumps from one frame to the next."""
    m = t[:, :3, :3]
    trace = m[:, 0, 0] + m[:, 1, 1] + m[:, 2, 2]
    squares = 0.25 * np.stack([1 + 2 * m[:, k, k] - trace for k in range(3)] + [1 + trace], axis=1)
    lead = squares.argmax(axis=1)
    products = np.empty((len(m), 4, 4))
    for i, j, k in ((0, 1, 2), (1, 2, 0), (2, 0, 1)):
        products[:, i, j] = products[:, j, i] = 0.25 * (m[:, i, j] + m[:, j, i])
        products[:, k, 3] = products[:, 3, k] = 0.25 * (m[:, j, i] - m[:, i, j])
    products[:, range(4), range(4)] = squares
    q = products[np.arange(len(m)), lead]
    q /= np.linalg.norm(q, axis=1, keepdims=True)
    flips = np.cumsum(np.r_[q[0, 3] < 0, np.einsum("ij,ij->i", q[1:], q[:-1]) < 0]) % 2
    return np.where(flips[:, None] == 1, -q, q)
