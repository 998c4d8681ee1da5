"""The largest change of shape in each frame of a block, against SciPy's rotations."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from geomphys.engine.block_motion import largest_chords


def test_the_largest_angle_of_some_bodies_is_found_whatever_the_sign_of_their_quaternions() -> None:
    rng = np.random.default_rng(3)
    recorded, corrected = rng.normal(size=(2, 5, 4, 7))
    for poses in (recorded, corrected):
        poses[..., 3:] /= np.linalg.norm(poses[..., 3:], axis=2, keepdims=True)
    rotations = (Rotation.from_quat(poses[..., 3:].reshape(-1, 4)) for poses in (recorded, corrected))
    first, second = rotations
    angles = (first.inv() * second).magnitude().reshape(5, 4)
    for bodies in ([0, 2, 3], [1], []):
        chords = np.empty(4)  # of the first four frames
        largest_chords(recorded, corrected, np.array(bodies, np.int64), chords)
        assert 4.0 * np.arcsin(0.5 * chords) == pytest.approx(angles[:4, bodies].max(axis=1, initial=0.0))


def test_a_body_that_is_not_finite_is_not_passed_over() -> None:
    poses = np.zeros((1, 3, 7))
    corrected = poses.copy()
    corrected[0, 1, 4] = np.nan
    chords = np.zeros(1)
    largest_chords(poses, corrected, np.arange(3), chords)
    assert np.isnan(chords).all()
