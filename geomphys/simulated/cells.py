"""Vectors in rows of memory: reading, writing and adding to them."""

from __future__ import annotations

from geomphys.collision.support import vec_at
from geomphys.jit.addresses import float_at, set_float
from geomphys.jit.kernel import kernel
from geomphys.numerics.vec3 import Quat, Rot, Vec

__all__ = ["add_vec", "quat_at", "rot_at", "set_quat", "set_vec", "vec_at"]


@kernel
def set_vec(row: int, i: int, v: Vec) -> None:
    """Write three consecutive numbers from element i on."""
    set_float(row, i, v[0])
    set_float(row, i + 1, v[1])
    set_float(row, i + 2, v[2])


@kernel
def add_vec(row: int, i: int, v: Vec, s: float) -> None:
    """Add s v to three consecutive numbers."""
    set_float(row, i, float_at(row, i) + s * v[0])
    set_float(row, i + 1, float_at(row, i + 1) + s * v[1])
    set_float(row, i + 2, float_at(row, i + 2) + s * v[2])


@kernel
def quat_at(row: int, i: int) -> Quat:
    """Four consecutive numbers."""
    return (float_at(row, i), float_at(row, i + 1), float_at(row, i + 2), float_at(row, i + 3))


@kernel
def set_quat(row: int, i: int, q: Quat) -> None:
    """Write four consecutive numbers."""
    set_float(row, i, q[0])
    set_float(row, i + 1, q[1])
    set_float(row, i + 2, q[2])
    set_float(row, i + 3, q[3])


@kernel
def rot_at(row: int, i: int) -> Rot:
    """Nine consecutive numbers."""
    x, y, z = vec_at(row, i), vec_at(row, i + 3), vec_at(row, i + 6)
    return (x[0], x[1], x[2], y[0], y[1], y[2], z[0], z[1], z[2])
