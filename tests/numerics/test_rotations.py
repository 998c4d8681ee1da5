"""Rotations by half: twice in a row they are the whole, and the same as by the rotation vector."""

from __future__ import annotations

import numpy as np
import pytest

from geomphys.numerics.vec3 import Quat, quat_from_rotation_vector, quat_half, quat_mul, rotation_vector, scale

ANGLES = [0.0, 1e-12, 1e-3, 0.7, 2.0, 3.1]


@pytest.mark.parametrize("angle", ANGLES)
@pytest.mark.parametrize("sign", [1.0, -1.0])
def test_a_half_rotation_made_twice_is_the_rotation(angle: float, sign: float) -> None:
    axis = (0.6, -0.48, 0.64)
    whole = quat_from_rotation_vector.py_func(scale.py_func(axis, angle))
    q: Quat = (sign * whole[0], sign * whole[1], sign * whole[2], sign * whole[3])
    half = quat_half.py_func(q)
    np.testing.assert_allclose(quat_mul.py_func(half, half), whole, rtol=0.0, atol=1e-15)
    np.testing.assert_allclose(rotation_vector.py_func(half), scale.py_func(axis, 0.5 * angle), rtol=0.0, atol=1e-15)
