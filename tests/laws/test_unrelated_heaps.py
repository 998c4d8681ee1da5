"""A heap does not depend on what lies in a heap elsewhere.

But for bodies that rotate by more than `ROTATION_PER_STEP` in a step: they divide the steps of all.
"""

from __future__ import annotations

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from geomphys.scene.pieces import Box
from tests.simulated.scenes import Player, Thing, floor

COUNT, FRAMES = 4, 90


def heap(seed: int, x: float, spin: float) -> list[Thing]:
    """Boxes that fall onto each other about `x` [m], each rotating at about `spin` [rad/s]."""
    rng = np.random.default_rng(seed)
    return [
        Thing(
            shape=Box(tuple(rng.uniform(0.03, 0.08, 3))),
            at=(x + rng.uniform(-0.05, 0.05), rng.uniform(-0.05, 0.05), 0.15 + 0.2 * k),
            turn=Rotation.random(random_state=10 * seed + k).as_quat(),
            w=spin * rng.normal(size=3),
        )
        for k in range(COUNT)
    ]


def path_beside(x: float, seed: int, spin: float, rate: float) -> np.ndarray:
    """Poses (n, `COUNT`, 7) of a heap beside another one about `x`."""
    player = Player([*heap(0, 0.0, 3.0), *heap(seed, x, spin), floor()])
    poses = []
    for _ in range(FRAMES):
        player.step(1 / rate)
        poses.append(player.poses[:COUNT].copy())
    return np.array(poses)


@pytest.mark.parametrize("rate", [60.0, 240.0])
def test_a_heap_far_away_changes_not_a_bit(rate: float) -> None:
    calm, other = path_beside(10.0, 1, 1.0, rate), path_beside(13.0, 2, 3.0, rate)
    np.testing.assert_array_equal(calm, other)
