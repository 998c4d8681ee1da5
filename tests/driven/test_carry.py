"""What carries a body moves it as a rigid body: twin in scipy."""

from __future__ import annotations

import numpy as np
from scipy.spatial.transform import Rotation

from geomphys.driven.carry import motion_of


def frame(rng: np.random.Generator, turn: Rotation) -> tuple[np.ndarray, np.ndarray]:
    """A frame row and its position."""
    at = rng.normal(size=3)
    return np.concatenate([turn.as_matrix().ravel(), at]), at


def test_the_motion_of_a_piece_takes_a_point_where_a_rigid_body_takes_it() -> None:
    rng = np.random.default_rng(0)
    for angle in (0.0, 1e-9, 1e-3, 0.5, 3.0):
        axis = rng.normal(size=3)
        step = Rotation.from_rotvec(angle * axis / np.linalg.norm(axis))
        first = Rotation.random(rng=rng)
        (before, here), (after, there) = frame(rng, first), frame(rng, step * first)
        point = rng.normal(size=3)
        turn, way = motion_of(before[None], after[None], 0, tuple(map(float, point)))
        np.testing.assert_allclose(turn, step.as_rotvec(), rtol=0, atol=1e-12)
        np.testing.assert_allclose(point + np.array(way), step.apply(point - here) + there, rtol=0, atol=1e-12)
