"""Tracked things of the scene push simulated ones and carry them along."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from geomphys.scene import arrays as s
from geomphys.scene.pieces import Box, Cylinder
from tests.simulated.scenes import FRICTION, Player, Thing, floor

HERE = (0.0, 0.0, 0.0, 1.0)


def test_a_moving_panel_of_the_scene_pushes_with_its_own_velocity() -> None:
    panel = Thing(shape=Box((0.02, 0.3, 0.3)), role=s.FIXED, moving=True, at=(-0.12, 0, 0.25))
    player = Player([Thing(shape=Box((0.05, 0.05, 0.05)), at=(0, 0, 0.05), mass=50.0), floor(), panel])
    player.targets[2] = lambda t: (-0.12 + 0.3 * t, 0.0, 0.25, *HERE)
    for _ in range(60):
        player.step(1 / 60)
        assert player.overlap() < 1e-5
    assert player.poses[0, 0] == pytest.approx(-0.12 + 0.3 + 0.07, abs=1e-4)
    assert player.velocity[0, 0] == pytest.approx(0.3, abs=1e-4)


def test_a_box_rides_a_lift() -> None:
    lift = Thing(shape=Box((0.3, 0.3, 0.05)), role=s.FIXED, moving=True, at=(0, 0, -0.05))
    player = Player([Thing(shape=Box((0.03, 0.03, 0.03)), at=(0.1, 0, 0.03)), lift])
    player.targets[1] = lambda t: (0, 0, -0.05 + 0.1 * (1 - np.cos(3 * t)), *HERE)
    for _ in range(120):
        player.step(1 / 60)
        assert player.poses[0, 2] - player.poses[1, 2] == pytest.approx(0.08, abs=1e-5)


def test_a_box_turns_with_a_turntable_until_friction_fails() -> None:
    for rate, holds in ((2.0, True), (9.0, False)):
        table = Thing(shape=Cylinder(0.5, 0.05), role=s.FIXED, moving=True, at=(0, 0, -0.05))
        box = Thing(shape=Box((0.03, 0.03, 0.03)), at=(0.2, 0, 0.03), v=(0, 0.2 * rate, 0), w=(0, 0, rate))
        player = Player([box, table])
        player.targets[1] = lambda t, rate=rate: (0, 0, -0.05, *Rotation.from_rotvec([0, 0, rate * t]).as_quat())
        player.run(0.3)
        assert (0.2 * rate**2 < FRICTION[0, 0] * 9.81) == holds
        assert (abs(np.hypot(*player.poses[0, :2]) - 0.2) < 1e-3) == holds
