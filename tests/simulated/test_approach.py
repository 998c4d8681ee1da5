"""Continuous collision against brute force: separations at a thousand moments of one frame."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from geomphys.collision.penetration import separation
from geomphys.collision.support import pose_pieces
from geomphys.scene import arrays as s
from geomphys.scene.pieces import Box, Capsule, Sphere
from geomphys.simulated.swept_boxes import reach_ahead
from tests.simulated.scenes import Player, Thing, floor
from tests.simulated.stages import Stage

DT = 1 / 30


def least_separation(player: Player, end: np.ndarray) -> float:
    """Of bodies 0 and 1 in one frame of even motion (a cube turns evenly)."""
    poses = player.poses.copy()
    start = [Rotation.from_quat(pose[3:]) for pose in player.poses]
    least, normal = np.inf, (0.0, 0.0, 0.0)
    for share in np.linspace(0, 1, 600):
        poses[0, :3] = player.poses[0, :3] + share * DT * player.velocity[0, :3]
        poses[0, 3:] = (Rotation.from_rotvec(share * DT * player.velocity[0, 3:]) * start[0]).as_quat()
        turn = (Rotation.from_quat(end[1, 3:]) * start[1].inv()).as_rotvec()
        poses[1, :3] = player.poses[1, :3] + share * (end[1, :3] - player.poses[1, :3])
        poses[1, 3:] = (Rotation.from_rotvec(share * turn) * start[1]).as_quat()
        pose_pieces(player.scene.pieces, poses, player.frames)
        apart, normal, _, _ = separation(player.packed.pieces, player.frames, 0, 1, 1.0, normal, player.packed.scratch)
        least = min(least, apart)
    return least


@pytest.mark.parametrize("seed", range(3))
def test_what_meets_in_a_frame_is_found_and_nothing_else(seed: int) -> None:
    rng = np.random.default_rng(seed)
    met = free = 0
    for k in range(20):
        away = rng.normal(size=3)
        away *= 0.2 / np.linalg.norm(away)
        cube = Thing(
            shape=Box((0.05, 0.05, 0.05)),
            turn=Rotation.random(random_state=100 * seed + k).as_quat(),
            v=6 * (away / np.linalg.norm(away)) + rng.normal(size=3),
            w=30 * rng.normal(size=3),
        )
        shape = Box(tuple(rng.uniform(0.003, 0.15, 3))) if k % 3 else Sphere(0.03)
        turn = Rotation.random(random_state=100 * seed + k + 50)
        other = Thing(shape=shape, role=s.FIXED, moving=True, at=away, turn=turn.as_quat())
        player = Player([cube, other], gravity=(0, 0, 0))
        end = player.poses.copy()
        end[1, :3] += 0.06 * rng.normal(size=3)
        end[1, 3:] = (Rotation.from_rotvec(0.8 * rng.normal(size=3)) * turn).as_quat()
        least = least_separation(player, end)
        pose_pieces(player.scene.pieces, player.poses, player.frames)
        if separation(player.packed.pieces, player.frames, 0, 1, 1.0, (0.0, 0.0, 0.0), player.packed.scratch)[0] < 1e-3:
            continue
        player.targets[1] = lambda _, end=end: end[1]
        player.step(DT)
        assert player.overlap() < 1e-5
        if least < -1e-4:
            met += 1
            assert player.impacts > 0
        elif least > 1e-4:
            free += 1
            assert player.impacts == 0
    assert met > 2
    assert free > 2


@pytest.mark.parametrize("rate", [30, 60, 240])
def test_the_tip_of_a_rod_that_dips_in_between_two_steps_strikes(rate: int) -> None:
    """At both ends of the step it is clear of the floor; its arc is not."""
    spin, reach, step = 20.0, 0.3, 1.0 / 240.0
    turn = Rotation.from_rotvec([0, np.pi - 2.5 * spin * step, 0])
    rod = Thing(shape=Capsule(0.01, reach - 0.01), at=(0, 0, reach - 1e-4), turn=turn.as_quat(), w=(0, spin, 0))
    player = Player([rod, floor()], gravity=(0, 0, 0))
    for _ in range(max(1, rate // 60)):
        player.step(1.0 / rate)
        assert player.overlap() < 1e-5
    assert player.impacts > 0


@pytest.mark.parametrize("spin", [0.0, 5.0, 80.0])
def test_no_point_goes_farther_than_a_body_reaches_ahead(spin: float) -> None:
    """Of a cube that flies and rotates, corners among them, at moments of a frame."""
    rng = np.random.default_rng(5)
    for _ in range(10):
        v, w = rng.normal(size=3), spin * rng.normal(size=3)
        cube = Thing(shape=Box((0.05, 0.03, 0.04)), at=(0, 0, 1), v=v, w=w, mass=1.0)
        stage = Stage(Player([cube, floor()]), DT)
        m = stage.motion[0]
        m["angular_velocity"], m["velocity"] = w, v
        corners = np.array([0.05, 0.03, 0.04]) * (np.array(np.meshgrid(*[[-1, 1]] * 3)).reshape(3, -1).T)
        reach = float(stage.call(reach_ahead, 0, DT))
        for t in np.linspace(0.0, DT, 50):
            turned = Rotation.from_rotvec(t * w).apply(corners)
            moved = t * v + 0.5 * t * t * np.array([0.0, 0.0, -9.81]) + turned - corners
            assert np.linalg.norm(moved, axis=1).max() <= reach + 1e-12
