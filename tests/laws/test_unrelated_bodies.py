"""A group of bodies moves as if nothing else were in the scene, bit for bit: whatever is elsewhere, before or after it in the file."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from geomphys.scene import arrays as s
from geomphys.scene.pieces import Box, Sphere
from tests.simulated.scenes import Player, Thing

AWAY = 10.0  # m
FRAMES = 90
GROUND = Thing(shape=Box((40.0, 40.0, 0.1)), role=s.FIXED, at=(0.0, 0.0, -0.1))


def heap(x: float, count: int, seed: int, spin: float) -> list[Thing]:
    """Boxes that fall onto each other about `x` [m], each rotating at about `spin` [rad/s]."""
    rng = np.random.default_rng(seed)
    return [
        Thing(
            shape=Box(tuple(rng.uniform(0.03, 0.08, 3))),
            at=(x + rng.uniform(-0.05, 0.05), rng.uniform(-0.05, 0.05), 0.15 + 0.2 * k),
            turn=Rotation.random(random_state=10 * seed + k).as_quat(),
            w=spin * rng.normal(size=3),
        )
        for k in range(count)
    ]


def boxes(x: float) -> list[Thing]:
    """A heap of four boxes."""
    return heap(x, 4, 0, 3.0)


def rolling(x: float) -> list[Thing]:
    """A ball that comes to roll, beside one that leaves it, and a cube asleep."""
    balls = [Thing(shape=Sphere(0.05), at=(x + 0.2 * k, 0, 0.0501), v=(0.4, 0.2 * k, 0)) for k in range(2)]
    return [*balls, Thing(shape=Box((0.05, 0.05, 0.05)), at=(x, 0.5, 0.05))]


def pair_that_meets(x: float) -> list[Thing]:
    """A ball so fast that it leaves the range in which its pairs were searched, and three that it hits."""
    balls = [Thing(shape=Sphere(0.05), at=(x + 0.2 + 0.1002 * k, 0, 0.05001)) for k in range(3)]
    return [Thing(shape=Sphere(0.05), at=(x, 0, 0.06), v=(6, 0.1, 0), w=(0, 90, 0), mass=3.0), *balls]


def nothing() -> list[Thing]:
    """No other bodies."""
    return []


def spinning_fast() -> list[Thing]:
    """A cube that spins at 200 rad/s on the ground, and one in the air."""
    cube = Box((0.05, 0.05, 0.05))
    return [Thing(shape=cube, at=(AWAY, y, 0.05 + y), w=(0, 0, 200.0)) for y in (0.0, 1.0)]


def falling_pile() -> list[Thing]:
    """Balls that fall onto each other, with hundreds of impacts."""
    return [
        Thing(shape=Sphere(0.03), at=(AWAY + 0.003 * (k % 5), 0.002 * (k % 3), 0.05 + 0.07 * k), material="rubber")
        for k in range(12)
    ]


def far_heap() -> list[Thing]:
    """Boxes that rotate fast as they fall onto each other."""
    return heap(AWAY, 5, 1, 40.0)


def flying() -> list[Thing]:
    """A ball in free flight, which never touches anything."""
    return [Thing(shape=Sphere(0.03), at=(AWAY, 0, 30.0), v=(1, 0, 0), w=(0, 30, 0))]


def path(group: list[Thing], before: list[Thing], after: list[Thing], rate: float, most: int = 500) -> np.ndarray:
    """Poses (n, G, 7) of a group among others."""
    player, first = Player([*before, *group, *after, GROUND]), len(before)
    poses = []
    for _ in range(FRAMES):
        player.step(1 / rate, most)
        poses.append(player.poses[first : first + len(group)].copy())
    return np.array(poses)


@pytest.mark.parametrize("rate", [30.0, 60.0, 240.0])
@pytest.mark.parametrize("others", [spinning_fast, falling_pile, far_heap, flying])
@pytest.mark.parametrize("group", [boxes, rolling, pair_that_meets])
def test_bodies_elsewhere_change_not_a_bit(
    group: Callable[[float], list[Thing]], others: Callable[[], list[Thing]], rate: float
) -> None:
    alone = path(group(0.0), [], [], rate)
    np.testing.assert_array_equal(path(group(0.0), others(), [], rate), alone)
    np.testing.assert_array_equal(path(group(0.0), [], others(), rate), alone)


@pytest.mark.parametrize("group", [boxes, rolling, pair_that_meets])
def test_a_bound_met_elsewhere_changes_not_a_bit(group: Callable[[float], list[Thing]]) -> None:
    """Two collisions a frame are too few for the pile, and enough for its neighbours or not as they are without it."""
    alone = path(group(0.0), [], [], 60.0, 2)
    np.testing.assert_array_equal(path(group(0.0), falling_pile(), [], 60.0, 2), alone)


@pytest.mark.parametrize("group", [boxes, rolling, pair_that_meets])
def test_a_group_placed_elsewhere_moves_the_same_way(group: Callable[[float], list[Thing]]) -> None:
    """To rounding, until impacts have amplified that of the positions."""
    here, there = path(group(0.0), [], [], 60.0), path(group(AWAY), [], [], 60.0)
    there[:, :, 0] -= AWAY
    assert np.abs(here - there)[:20].max() < 1e-9
