"""Nothing passes through anything, at any speed, turning or not."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from geomphys.scene import arrays as s
from geomphys.scene.pieces import Box, Capsule, Sphere
from tests.simulated.scenes import Player, Thing


@pytest.mark.parametrize("rate", [30, 240])
@pytest.mark.parametrize("speed", [50.0, 900.0])
def test_a_fast_ball_bounces_off_a_thin_panel(speed: float, rate: int) -> None:
    panel = Thing(shape=Box((0.0025, 0.5, 0.5)), role=s.FIXED)
    player = Player([Thing(shape=Sphere(0.02), at=(-0.7, 0.1, 0.05), v=(speed, 0, 0)), panel], gravity=(0, 0, 0))
    player.run(0.2, rate)
    np.testing.assert_allclose(player.velocity[0], [-0.3 * speed, 0, 0, 0, 0, 0], rtol=1e-12)
    assert player.impacts == 1


@pytest.mark.parametrize("seed", range(4))
def test_a_spinning_thin_plate_stays_between_thin_panels(seed: int) -> None:
    rng = np.random.default_rng(seed)
    w = rng.normal(size=3)
    panels = [Thing(shape=Box((50, 50, 0.0005)), role=s.FIXED, at=(0, 0, z)) for z in (0.0, 1.0)]
    plate = Thing(
        shape=Box((0.15, 0.1, 0.0005)), at=(0, 0, 0.5), v=5 * rng.normal(size=3), w=100 * w / np.linalg.norm(w)
    )
    player = Player([plate, *panels])
    for pose in player.run(1.0):
        corners = Rotation.from_quat(pose[0, 3:]).apply([[x, y, 0] for x in (-0.15, 0.15) for y in (-0.1, 0.1)])
        z = pose[0, 2] + corners[:, 2]
        assert z.min() > 0.0
        assert z.max() < 1.0
    assert player.impacts > 0


def test_two_fast_bodies_do_not_pass_each_other() -> None:
    player = Player(
        [
            Thing(shape=Sphere(0.005), at=(-1, 0, 0), v=(200, 0, 0)),
            Thing(shape=Box((0.001, 0.05, 0.05)), at=(1, 0, 0), v=(-200, 0, 0), w=(0, 0, 50)),
        ],
        gravity=(0, 0, 0),
    )
    p = player.scene.bodies.mass @ player.velocity[:, :3]
    player.run(0.1)
    assert player.impacts > 0
    np.testing.assert_allclose(player.scene.bodies.mass @ player.velocity[:, :3], p, rtol=0, atol=1e-12)


def test_a_rod_swung_past_a_post_meets_it() -> None:
    """Only the turning brings them together, within one frame."""
    rod = Thing(shape=Capsule(0.005, 0.4), w=(0, 0, 0), turn=Rotation.from_rotvec([np.pi / 2, 0, 0]).as_quat())
    post = Thing(shape=Capsule(0.004, 0.3), role=s.FIXED, at=(0.2, 0.2, 0))
    player = Player([rod, post], gravity=(0, 0, 0))
    player.velocity[0, 5] = -60.0
    player.step(1 / 30)
    assert player.impacts > 0
    assert player.overlap() == 0.0


@pytest.mark.parametrize("seed", range(3))
def test_a_closed_box_keeps_its_bees(seed: int) -> None:
    rng = np.random.default_rng(seed)
    walls = [
        Thing(
            shape=Box(tuple(0.001 if k == axis else 0.3 for k in range(3))),
            role=s.FIXED,
            at=0.3 * sign * np.eye(3)[axis],
            material="rubber",
        )
        for axis in range(3)
        for sign in (-1, 1)
    ]
    bees = [
        Thing(
            shape=Box((0.03, 0.02, 0.01)),
            at=(0.12 * k - 0.18, 0, 0),
            v=20 * rng.normal(size=3),
            w=40 * rng.normal(size=3),
            material="rubber",
        )
        for k in range(4)
    ]
    player = Player([*bees, *walls])
    for _ in range(60):
        player.step(1 / 30)
        assert np.abs(player.poses[:4, :3]).max() < 0.3
        assert player.overlap() < 1e-5
