"""A hand that rests is told from one that moves whatever the tracker's noise, and its frames are averaged."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from geomphys.authoring.resting_frames import (
    MIN_FRAMES,
    frame_of_touch,
    mean_frame,
    means_of_parts,
    rests,
    without_outliers,
)
from geomphys.results import Frame

COLUMNS = slice(0, 2)
RATE = 60.0


def frames(
    count: int, noise: float = 0.0, speed: float = 0.0, spin: float = 0.0, bend: float = 0.0, seed: int = 0
) -> list[Frame]:
    """A hand near (0.1, 0.2, 0.3), with noise [m, and 10 times in rad], speed [m/s], spin [rad/s], and joints in motion."""
    rng, out = np.random.default_rng(seed), []
    for k in range(count):
        t = k / RATE
        turn = Rotation.from_rotvec([0.2, 0.1, 0.3 + spin * t]) * Rotation.from_rotvec(rng.normal(0, 10 * noise, 3))
        position = np.array([0.1 + speed * t, 0.2, 0.3]) + rng.normal(0, noise, 3)
        sign = 1.0 if k % 2 else -1.0  # q and -q are one rotation
        roots = np.array([[*position, *(sign * turn.as_quat())]])
        angles = np.array([0.4 + bend * t, -0.1]) + rng.normal(0, 10 * noise, 2)
        out.append(Frame(k, round(t * 1e9), roots, angles, False, 0))
    return out


@pytest.mark.parametrize("noise", [0.0, 1e-4, 1e-3])
def test_a_hand_with_noise_alone_rests(noise: float) -> None:
    assert sum(rests(frames(30, noise, seed=k), 0, COLUMNS) for k in range(20)) >= 19


@pytest.mark.parametrize("motion", [{"speed": 0.05}, {"spin": 0.5}, {"bend": 0.5}])
@pytest.mark.parametrize("noise", [0.0, 1e-4])
def test_one_that_moves_does_not(motion: dict[str, float], noise: float) -> None:
    assert not any(rests(frames(30, noise, seed=k, **motion), 0, COLUMNS) for k in range(10))


def test_too_few_frames_show_nothing() -> None:
    assert not rests(frames(MIN_FRAMES - 1), 0, COLUMNS)


def test_the_mean_is_nearer_than_a_frame_and_its_rotation_is_one() -> None:
    true = frames(1)[0]
    found = mean_frame(frames(100, 1e-3), 0, COLUMNS)
    assert np.abs(found.roots[0, :3] - true.roots[0, :3]).max() < 4e-4
    assert np.linalg.norm(found.roots[0, 3:]) == pytest.approx(1.0, abs=1e-12)
    turn = Rotation.from_quat(found.roots[0, 3:]) * Rotation.from_quat(true.roots[0, 3:]).inv()
    assert turn.magnitude() < 6e-3
    assert np.abs(found.angles - true.angles).max() < 4e-3
    assert found.index == 50


def test_frames_far_from_their_neighbours_are_left_out() -> None:
    made = frames(40, 1e-4)
    for k in (7, 20):
        made[k].roots[0, 0] += 0.05
    left = [frame.index for frame in without_outliers(made, 0, COLUMNS)]
    assert left == [k for k in range(40) if k not in (7, 20)]


def test_a_touch_is_the_mean_about_its_time_where_the_hand_rests_and_the_frame_where_it_moves() -> None:
    still, time = frames(120, 1e-3), 1e9
    found = frame_of_touch(still, time, 0, COLUMNS)
    assert found is not None
    single = np.array([frame.roots[0, :3] for frame in still[46:75]])
    assert found.roots[0, :3] == pytest.approx(single.mean(axis=0), abs=2e-4)
    moving = frames(120, speed=0.3)
    found = frame_of_touch(moving, time, 0, COLUMNS)
    assert found is not None
    assert found.roots[0, 0] == pytest.approx(0.1 + 0.3, abs=0.3 * 0.016)
    assert frame_of_touch([], time, 0, COLUMNS) is None
    nearest = frame_of_touch(moving, 60e9, 0, COLUMNS)
    assert nearest is not None
    assert nearest.index >= 117  # frames at the ends have no neighbours on one side, and may count as outliers


def test_parts_of_a_stretch_are_averaged_where_the_hand_rests() -> None:
    parts = means_of_parts(frames(90, 1e-3), 3, 0, COLUMNS)
    assert [frame.index for frame in parts] == [15, 45, 75]
    single = frames(90, 1e-3)[15]
    assert parts[0].roots[0, 0] != single.roots[0, 0]
    moving = means_of_parts(frames(90, speed=0.3), 3, 0, COLUMNS)
    assert [frame.roots[0, 0] for frame in moving] == pytest.approx(
        [0.1 + 0.3 * k / RATE for k in (15, 45, 75)], abs=1.1 * 0.3 / RATE
    )
