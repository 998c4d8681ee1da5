"""Vectors kept in arrays: of three numbers, of four (quaternions), of nine (rotations, row by row).

``_of`` reads a whole one-dimensional array, ``_at`` a row of a two-dimensional one, ``_from`` consecutive numbers.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from geomphys.jit.kernel import kernel
from geomphys.numerics.vec3 import Quat, Rot, Vec

Floats = NDArray[np.float64]


@kernel
def vec_of(a: Floats) -> Vec:
    """The vector of an array (3,)."""
    return (a[0], a[1], a[2])


@kernel
def vec_at(a: Floats, i: int) -> Vec:
    """First three numbers of row i of an array (n, m)."""
    return (a[i, 0], a[i, 1], a[i, 2])


@kernel
def vec_from(a: Floats, i: int) -> Vec:
    """Three consecutive numbers of an array (n,) from element i on."""
    return (a[i], a[i + 1], a[i + 2])


@kernel
def set_vec(a: Floats, v: Vec) -> None:
    """Write a vector to an array (3,)."""
    a[0], a[1], a[2] = v


@kernel
def set_vec_at(a: Floats, i: int, v: Vec) -> None:
    """Write a vector to row i of an array (n, 3)."""
    a[i, 0], a[i, 1], a[i, 2] = v


@kernel
def set_vec_from(a: Floats, i: int, v: Vec) -> None:
    """Write a vector to consecutive numbers of an array (n,) from element i on."""
    a[i], a[i + 1], a[i + 2] = v


@kernel
def add_vec(a: Floats, v: Vec, s: float) -> None:
    """Add s v to an array (3,)."""
    a[0] += s * v[0]
    a[1] += s * v[1]
    a[2] += s * v[2]


@kernel
def add_vec_from(a: Floats, i: int, v: Vec, s: float) -> None:
    """Add s v to consecutive numbers of an array (n,) from element i on."""
    a[i] += s * v[0]
    a[i + 1] += s * v[1]
    a[i + 2] += s * v[2]


@kernel
def quat_of(a: Floats) -> Quat:
    """The quaternion of an array (4,)."""
    return (a[0], a[1], a[2], a[3])


@kernel
def quat_from(a: Floats, i: int) -> Quat:
    """Four consecutive numbers of an array (n,) from element i on."""
    return (a[i], a[i + 1], a[i + 2], a[i + 3])


@kernel
def set_quat(a: Floats, q: Quat) -> None:
    """Write a quaternion to an array (4,)."""
    a[0], a[1], a[2], a[3] = q


@kernel
def set_quat_from(a: Floats, i: int, q: Quat) -> None:
    """Write a quaternion to consecutive numbers of an array (n,) from element i on."""
    a[i], a[i + 1], a[i + 2], a[i + 3] = q


@kernel
def rot_of(a: Floats) -> Rot:
    """The rotation of an array of at least nine numbers."""
    return (a[0], a[1], a[2], a[3], a[4], a[5], a[6], a[7], a[8])


@kernel
def set_rot(a: Floats, r: Rot) -> None:
    """Write a rotation to the first nine numbers of an array."""
    for i in range(9):
        a[i] = r[i]


@kernel
def copy_pose(source: Floats, i: int, target: Floats, j: int) -> None:
    """Copy row `i` of the poses `source` (n, 7) to row `j` of `target` (m, 7)."""
    for k in range(7):
        target[j, k] = source[i, k]
